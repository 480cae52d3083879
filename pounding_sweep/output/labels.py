"""What a sweep's cube is labelled with: its axes, further coordinates and global attributes."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.model.laws import LAWS, realised_restitution
from pounding_sweep.model.scene import Building, Scene
from pounding_sweep.model.variants import Variants
from pounding_sweep.output.dataset import Coordinates, law_coordinates
from pounding_sweep.output.identity import library_versions
from pounding_sweep.outputs.variables import scatter_dof
from pounding_sweep.plan.scenarios import requested_scenarios
from pounding_sweep.records.record import record_measures
from pounding_sweep.spec.axes import AXES, PropertyAxis, plain_name
from pounding_sweep.spec.design import BLOCK, SAMPLE
from pounding_sweep.spec.spec import SweepSpec, to_json

if TYPE_CHECKING:
    from pounding_sweep.output.results import Outcome
    from pounding_sweep.plan.plan import Plan


#: Axes by dimension, of building properties by kind.
_AXES = {axis.dimension: axis for axis in AXES.values()}
_TEXTS = {"law": "contact law", "record": "ground-motion record"}
_CONTACT_STIFFNESS = "kN/m for force ~ d, kN/m^1.5 for force ~ d^1.5"
_REALISED = (
    "restitution of two free masses under the damping that the sweep used (see restitution_basis); 1 for laws without "
    "damping, missing without contact"
)
#: Kind of axis -> name, symbol, value as given, unit and long name of what it multiplies.
_MULTIPLIES: dict[str, tuple[str, str, Callable[[Building], float], str, str]] = {
    "period_factor": ("period", "T", lambda building: float(building.periods[0]), "s", "fundamental period"),
    "mass_factor": ("mass", "m", lambda building: float(sum(building.masses)), "t", "total mass"),
}


def product_coordinates(scene: Scene, axes: tuple[PropertyAxis, ...]) -> Coordinates:
    """Return the period or mass of each building along its axis, and its ratio to that of each neighbour."""
    result: Coordinates = {}

    def add(label: str, dims: tuple[str, ...], values: np.ndarray, **about: str) -> None:
        result[plain_name(label, (*(axis.dimension for axis in axes), *result))] = (dims, values, about)

    for kind, (short, symbol, value, units, what) in _MULTIPLIES.items():
        varied = {axis.building: axis for axis in axes if axis.kind == kind}
        for building in scene.buildings:
            if building.name in varied:
                axis = varied[building.name]
                values, text = value(building) * np.array(axis.values), f"{what} of building {building.name}"
                add(f"{short}_{building.name}", (axis.dimension,), values, units=units, long_name=text)
        for left, right in pairwise(scene.row):
            along = [varied[item.name] for item in (left, right) if item.name in varied]
            if along and isinstance(left, Building) and isinstance(right, Building):
                top, bottom = (np.array(varied[b.name].values if b.name in varied else [1.0]) for b in (left, right))
                ratio = value(left) / value(right) * top[:, None] / bottom[None, :]
                add(
                    f"{short}_ratio_{left.name}_{right.name}",
                    tuple(axis.dimension for axis in along),
                    ratio.reshape([len(axis.values) for axis in along]),
                    units="1",
                    long_name=f"{short} ratio {symbol}1/{symbol}2 of {left.name} and {right.name}",
                    comment=f"{what} of building {left.name} over that of building {right.name}",
                )
    return result


def row_coordinates(variants: Variants, dimension: str, prefix: str = "") -> Coordinates:
    """Return how the buildings vary along a dimension of listed scenarios, one of each row of `variants`."""
    result: Coordinates = {}
    for name in ("period_factor", "mass_factor", "damping_ratio", "strength_factor", "hardening"):
        if name not in ("strength_factor", "hardening") or any(variants.scene.yields):
            values, axis = getattr(variants, name), _AXES[name]
            missing = "; missing where it is the building's own" if name in ("damping_ratio", "hardening") else ""
            about = {"units": axis.unit, "long_name": f"{axis.long_name}{missing}"}
            result[prefix + name] = ((dimension, "building")[: values.ndim], values, about)
    return result


def building_coordinates(variants: Variants, along: Mapping[str, tuple[str, int]]) -> Coordinates:
    """Return masses, stiffnesses, periods and damping of all buildings, along the dimensions that change them."""
    # `along` has the dimensions of `variants`: the kind of property that they vary, "" for any, and their size
    scene, frequencies = variants.scene, variants.frequencies
    missing = np.full(len(frequencies[0]), np.nan)
    floors, each = ("building", "storey"), ("building",)
    table: list[Any] = [
        ("floor_mass", floors, scatter_dof(variants.masses, scene), ("mass_factor",), "t", "mass of the floor"),
        (
            *("storey_stiffness", floors, scatter_dof(variants.elastic_stiffnesses, scene)),
            *(("mass_factor", "period_factor"), "kN m-1", "stiffness of the storey"),
        ),
    ]
    for mode, (name, text) in enumerate((("fundamental", "fundamental"), ("second", "second natural"))):
        own = np.stack([w[:, mode] if w.shape[1] > mode else missing for w in frequencies], axis=1)
        table.append((f"{name}_period", each, 2.0 * np.pi / own, ("period_factor",), "s", f"{text} period"))
    for mode, name in enumerate(("first", "second")):
        ratios = []
        for b, (building, w) in enumerate(zip(scene.buildings, frequencies, strict=True)):
            (alpha, beta), own = variants.rayleigh(b), w[:, mode] if w.shape[1] > mode else missing
            founded = building.foundation is not None
            ratios.append(variants.modal_damping(b, mode) if founded else 0.5 * (alpha / own + beta * own))
        text = f"damping ratio of the {name} mode"
        table.append((f"{name}_damping_ratio", each, np.stack(ratios, axis=1), ("damping_ratio",), "1", text))
    if any(building.p_delta for building in scene.buildings):
        theta = scatter_dof(variants.geometric_stiffnesses / variants.elastic_stiffnesses, scene)
        text = "stability coefficient P / (k h) of the storey"
        table.append(("stability_coefficient", floors, theta, ("period_factor",), "1", text))
    result: Coordinates = {}
    for name, inner, values, kinds, units, text in table:
        varying = tuple(dim for dim, (kind, _) in along.items() if kind in ("", *kinds))
        at = tuple(slice(None) if dim in varying else 0 for dim in along)
        whole = values.reshape(*(size for _, size in along.values()), *values.shape[1:])
        result[name] = ((*varying, *inner), whole[at], {"units": units, "long_name": text})
    return result


def scenario_axes(plan: Plan) -> tuple[Coordinates, Coordinates]:
    """Return the dimensions of the scenarios, and what further coordinates say of them."""
    spec, requested = plan.spec, requested_scenarios(plan.spec)
    cases, own_laws = spec.cases or (), [spec.law(key) for key in spec.laws]
    axes, values = _axes(plan), requested.values
    (stiffness, _), (scale, _) = spec.needed_axis("stiffness"), spec.needed_axis("scale")
    restitution = np.array([np.nan if case.restitution is None else case.restitution for case in cases])
    law, nominal = np.broadcast_arrays(requested.law, restitution if cases else values["restitution"])
    realised = np.empty(law.shape)
    for i, item in enumerate(own_laws):
        realised[law == i] = realised_restitution(item, nominal[law == i], spec.restitution_basis)
    touches = np.array([item.exponent is not None for item in own_laws])[requested.law]
    names = np.array([record.name for record in spec.records])
    contact = np.where(touches, values["stiffness"], np.nan)
    gaps = np.broadcast_to(values["gap"], (*values["gap"].shape[:-1], len(spec.scene.pair_names)))
    # values of the scenarios, the dimensions on which these depend, units, long name and comment
    columns: dict[str, tuple[np.ndarray, tuple[str, ...], str, str, str]] = {
        "law": (np.array(spec.laws)[requested.law], ("law",), "", _TEXTS["law"], ""),
        "record": (names[requested.record], ("record",), "", _TEXTS["record"], ""),
        "scale": (values["scale"], ("record", scale.dimension), "1", "factor on the record", ""),
        "restitution": (nominal, ("restitution",), "1", "nominal coefficient of restitution", ""),
        "contact_stiffness": (contact, ("law", stiffness.dimension), "", "contact stiffness", _CONTACT_STIFFNESS),
        "restitution_realised": (
            realised,
            ("law", "restitution"),
            "1",
            "realised coefficient of restitution",
            _REALISED,
        ),
        **{
            axis.dimension: (
                np.array([getattr(case, axis.dimension) for case in cases], float),
                *((), axis.unit, axis.long_name, axis.comment),
            )
            for axis in AXES.values()
            if axis.listed and any(getattr(case, axis.dimension) is not None for case in cases)
        },
        "pair_gap": (gaps[..., spec.scene.pair_of_label], ("gap", "pair"), "m", "gap of the pair", ""),
    }
    if not spec.scene.pair_names:
        columns.pop("pair_gap")
    extra = design_coordinates(spec)
    outer, n = tuple(axes), len(requested.shape)
    for name, (column, dims, units, text, comment) in columns.items():
        whole, about = np.broadcast_to(column, (*requested.shape, *column.shape[n:])), {"units": units}
        about |= {"long_name": text, "comment": comment}
        if cases:
            extra[name] = (("case", *(dim for dim in dims if dim == "pair")), whole, about)
        elif name not in outer and (name != "contact_stiffness" or "stiffness" not in outer):
            at = tuple(slice(None) if i < len(outer) and outer[i] in dims else 0 for i in range(n))
            extra[name] = (dims, whole[at], about)
    if spec.own_laws:
        where, keys = extra["law"][:2] if cases else (("law",), spec.laws)
        extra |= law_coordinates(where, keys, {law.key: law for law in (*LAWS.values(), *spec.own_laws)})
    if not cases:
        about = {"units": "m s-2", "long_name": "peak ground acceleration of the record at scale 1"}
        extra["record_pga"] = (("record",), np.array([record.pga for record in spec.records]), about)
    extra |= product_coordinates(spec.scene, spec.property_axes)
    if len(plan.variants) == 1:
        return axes, extra | building_coordinates(plan.variants, {})
    variants = plan.variants[requested.variant.reshape(-1)]
    along = {axis.dimension: (axis.kind, len(axis.values)) for axis in spec.property_axes}
    if cases:
        extra |= row_coordinates(variants, "case")
        along = {"case": ("", len(cases))}
    return axes, extra | building_coordinates(variants, along)


def _axes(plan: Plan) -> Coordinates:
    """Return the dimensions of the scenarios."""
    spec = plan.spec
    if spec.cases is not None:
        numbers = np.arange(1, len(spec.cases) + 1)
        return {"case": (("case",), numbers, {"units": "1", "long_name": "listed scenario"})}
    result: Coordinates = {}
    properties = {axis.dimension: axis for axis in spec.property_axes}
    for name, values in spec.axes.items():
        building = properties[name].building if name in properties else None
        about = {"long_name": _TEXTS.get(name, "")}
        if name not in _TEXTS:
            axis = _AXES[properties[name].kind if name in properties else name]
            of = "" if building is None else f" of building {building}"
            about = {"units": axis.unit, "long_name": f"{axis.long_name}{of}", "comment": axis.comment}
        result[name] = ((name,), values, about)
        if name == "gap" and spec.gaps is None:
            uniform = len(set(spec.scene.gaps)) == 1
            about["long_name"] = "gap of every pair" if uniform else "smallest gap of the scene (see pair_gap)"
            result[name] = ((name,), (min(spec.scene.gaps, default=np.nan),), about)
        if name == "stiffness":
            exponents = {law.exponent for law in plan.laws if law.exponent is not None}
            exponent = exponents.pop() if exponents else 1.0
            about["units"] = "kN m-1" if exponent == 1 else f"kN m-{exponent:g}"
    return result


def design_coordinates(spec: SweepSpec) -> Coordinates:
    """Return what a design drew for each of its cases, and which point of which block each is."""
    if spec.design is None or spec.cases is None:
        return {}
    found: Coordinates = {}
    for each in spec.design.inputs:
        if each.argument == "records":
            continue  # the record of a case is told anyway
        axis = AXES[each.argument]
        if each.building is None:
            values = [getattr(case, axis.dimension) for case in spec.cases]
        else:
            values = [dict(getattr(case, each.argument)).get(each.building, 1.0) for case in spec.cases]
        of = "" if each.building is None else f" of building {each.building}"
        found[each.name] = (("case",), values, {"units": axis.unit, "long_name": f"{axis.long_name}{of}"})
    place = np.arange(len(spec.cases)) % len(spec.design)
    about = {"units": "1", "long_name": "point of the design, from 1"}
    found[SAMPLE] = (("case",), place % spec.design.samples + 1, about)
    if len(spec.design.blocks) > 1:
        blocks = np.array(spec.design.blocks)[place // spec.design.samples]
        text = "block of the design: A, B, or the input that A has of B"
        found[BLOCK] = (("case",), blocks, {"long_name": text})
    return found


def global_attributes(plan: Plan, outcome: Outcome) -> dict[str, Any]:
    """Return what the cube says of the sweep as a whole."""
    spec = plan.spec
    records = [
        {
            **{"name": r.name, "dt": r.dt, "points": r.n_points, "sha256": r.sha256, "source": r.source},
            **asdict(record_measures(r)),
        }
        for r in spec.records
    ]
    found: dict[str, Any] = {
        "records": records,
        "scenarios_asked": plan.n_asked,
        "scenarios_run": outcome.run + outcome.reused,
        "scenarios_never_touching": outcome.untouched,
        "method": plan.numerics.method,
        "precision": plan.numerics.precision,
        "located": spec.locate,
        "restitution_basis": spec.restitution_basis,
        "unit_system": "kN, t, m, s",
        "sweep": to_json(spec),
        "sweep_sha256": plan.digest,
        "sa_period": spec.sa_period,
        "records_left_out": spec.records_left_out or None,
        **{f"{name}_version": version for name, version in library_versions().items()},
    }
    if spec.accuracy is None:
        found["time_step"] = [r.dt / plan.numerics.steps(r) for r in spec.records]
    else:
        numbers = json.dumps(plan.choice_numbers)
        found |= {"accuracy": spec.accuracy, "accuracy_choice": plan.choice, "accuracy_numbers": numbers}
    if spec.title:
        found["title"] = spec.title
    return found
