"""What a sweep's cube is labelled with: its axes, further coordinates and global attributes."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.engine.row_kernel import SMALL_MOTION, longest_rest
from pounding_sweep.model.building import Building
from pounding_sweep.model.laws import LAWS, realised_restitution
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import Variants
from pounding_sweep.output import dataset
from pounding_sweep.output.dataset import Coordinates, coordinate, law_coordinates, package_version, unit_attributes
from pounding_sweep.output.identity import library_versions, package_digest
from pounding_sweep.plan.scenarios import requested_scenarios
from pounding_sweep.records.record import record_measures
from pounding_sweep.request.axes import AXES, BUILDING_DEFAULTS, NamedAxis, plain_name
from pounding_sweep.request.design import BLOCK, SAMPLE
from pounding_sweep.request.spec import SweepSpec, to_json
from pounding_sweep.variables.registry import scatter_dof

if TYPE_CHECKING:
    from pounding_sweep.output.results import Outcome
    from pounding_sweep.plan.plan import Plan


#: Axes by dimension, of building properties by kind.
_AXES = {axis.dimension: axis for axis in AXES.values() if axis.by != "pair"}
_TEXTS = {"law": "contact law", "record": "ground-motion record"}
_REALISED = (
    "realised coefficient of restitution",
    "restitution of two free masses under the damping that the sweep used (see restitution_basis); 1 for laws without "
    "damping, missing without contact",
)
#: Kind of axis -> name, symbol, value as given, unit and long name of what it multiplies.
_MULTIPLIES: dict[str, tuple[str, str, Callable[[Building], float], str, str]] = {
    "period_factor": ("period", "T", lambda building: float(building.periods[0]), "s", "fundamental period"),
    "mass_factor": ("mass", "m", lambda building: float(sum(building.masses)), "t", "total mass"),
}


def product_coordinates(scene: Scene, axes: tuple[NamedAxis, ...]) -> Coordinates:
    """Return the period or mass of each building along its axis, and its ratio to that of each neighbour."""
    result: Coordinates = {}
    dimensions = [axis.dimension for axis in axes]
    for kind, (short, symbol, value, units, what) in _MULTIPLIES.items():
        varied = {str(axis.name): axis for axis in axes if axis.kind == kind}
        factors = {b.name: np.array(varied[b.name].values if b.name in varied else [1.0]) for b in scene.buildings}
        for building in (building for building in scene.buildings if building.name in varied):
            name, text = f"{short}_{building.name}", f"{what} of building {building.name}"
            values, dims = value(building) * factors[building.name], [varied[building.name].dimension]
            result[plain_name(name, (*dimensions, *result))] = coordinate(dims, values, units, text)
        for left, right in pairwise(scene.row):
            along = tuple(varied[item.name].dimension for item in (left, right) if item.name in varied)
            if along and isinstance(left, Building) and isinstance(right, Building):
                ratio = value(left) / value(right) * factors[left.name][:, None] / factors[right.name][None, :]
                text = f"{short} ratio {symbol}1/{symbol}2 of {left.name} and {right.name}"
                comment = f"{what} of building {left.name} over that of building {right.name}"
                name = plain_name(f"{short}_ratio_{left.name}_{right.name}", (*dimensions, *result))
                shape = [size for size, item in zip(ratio.shape, (left, right), strict=True) if item.name in varied]
                result[name] = coordinate(along, ratio.reshape(shape), "1", text, comment)
    return result


def row_coordinates(variants: Variants, dimension: str) -> Coordinates:
    """Return how the buildings vary along a dimension of listed scenarios, one of each row of `variants`."""
    result, names = Coordinates(), [building.name for building in variants.scene.buildings]
    for name, default in BUILDING_DEFAULTS.items():
        values, axis = getattr(variants, name), _AXES[name]
        if len(list(axis.requires(variants.scene, names, ()))) < len(names):  # some building may have it
            missing = "; missing where it is the building's own" if np.isnan(default) else ""
            dims = (dimension, "building")[: values.ndim]
            result[name] = coordinate(dims, values, axis.unit, f"{axis.long_name}{missing}")
    return result


def listed_coordinates(plan: Plan, rows: np.ndarray, dimension: str, prefix: str) -> Coordinates:
    """Return what unique scenarios of a plan are, along a dimension that lists them."""
    table, spec, dims = plan.unique[rows], plan.spec, (dimension,)
    laws, records = (np.array(names) for names in ([x.key for x in plan.laws], [x.name for x in spec.records]))
    restitution = "nominal coefficient of restitution, 1 for laws without"
    result = {
        "law": coordinate(dims, laws[table.law], "", _TEXTS["law"]),
        "record": coordinate(dims, records[table.record], "", _TEXTS["record"]),
        "scale": coordinate(dims, table.scale, "1", "factor on the record"),
        "stiffness": coordinate(dims, table.stiffness, "", "contact stiffness (kN/m**exponent of the law)"),
        "restitution": coordinate(dims, table.restitution, "1", restitution),
        "gap": coordinate(dims, table.gaps, "m", "gap of the pair"),
    }
    for name, (_, column, about) in result.items():
        if column.ndim > 1:
            result[name] = ((*dims, "pair"), column[:, spec.scene.pair_of_label], about)
    if len(plan.variants) > 1:
        result |= row_coordinates(plan.variants[table.variant], dimension)
    return {
        prefix + name: (along, values, {"long_name": about["long_name"], **unit_attributes(about["units"])})
        for name, (along, values, about) in result.items()
    }


def building_coordinates(variants: Variants, along: Mapping[str, tuple[str, int]]) -> Coordinates:
    """Return masses, stiffnesses, periods and damping of all buildings, along the dimensions that change them."""
    # `along` has the dimensions of `variants`: the kind of property that they vary, "" for any, and their size
    scene = variants.scene
    by_storeys = np.concatenate([building.storey_stiffnesses for building in scene.buildings])
    stiffnesses = np.where(np.isnan(by_storeys), np.nan, variants.elastic_stiffnesses)
    factors, floors = ("mass_factor", "period_factor"), ("building", "storey")
    # values, inner dimensions, the kinds of property that change them, unit and long name
    table: dict[str, tuple[np.ndarray, tuple[str, ...], tuple[str, ...], str, str]] = {
        "floor_mass": (scatter_dof(variants.masses, scene), floors, factors[:1], "t", "mass of the floor"),
        "storey_stiffness": (scatter_dof(stiffnesses, scene), floors, factors, "kN m-1", "stiffness of the storey"),
    }
    # of the first two modes, shape (2, n, buildings); a building of one storey has no second
    frequencies, ratios = (
        np.stack([np.column_stack([values, np.full(len(variants), np.nan)])[:, :2].T for values in of_modes], axis=2)
        for of_modes in (variants.frequencies, map(variants.modal_damping, range(len(scene.buildings))))
    )
    for w, name, text in zip(frequencies, ("fundamental", "second"), ("fundamental", "second natural"), strict=True):
        table[f"{name}_period"] = (2.0 * np.pi / w, floors[:1], factors[1:], "s", f"{text} period")
    for ratio, name in zip(ratios, ("first", "second"), strict=True):
        text = f"damping ratio of the {name} mode"
        table[f"{name}_damping_ratio"] = (ratio, floors[:1], ("damping_ratio",), "1", text)
    if any(building.p_delta for building in scene.buildings):
        theta = scatter_dof(variants.geometric_stiffnesses / stiffnesses, scene)
        text = "stability coefficient P / (k h) of the storey"
        table["stability_coefficient"] = (theta, floors, factors[1:], "1", text)
    result: Coordinates = {}
    for name, (values, inner, kinds, units, text) in table.items():
        varying = tuple(dim for dim, (kind, _) in along.items() if kind in ("", *kinds))
        at = tuple(slice(None) if dim in varying else 0 for dim in along)
        grid = values.reshape(*(size for _, size in along.values()), *values.shape[1:])
        result[name] = coordinate((*varying, *inner), grid[at], units, text)
    return result


def scenario_axes(plan: Plan) -> tuple[Coordinates, Coordinates]:
    """Return the dimensions of the scenarios, and what further coordinates say of them."""
    spec, requested = plan.spec, requested_scenarios(plan.spec)
    cases, laws = spec.cases or (), [spec.law(key) for key in spec.laws]
    axes, values = _axes(plan), requested.values
    (stiffness, _), (scale, _) = spec.needed_axis("stiffness"), spec.needed_axis("scale")
    restitution = (
        np.array([case.restitution for case in cases], float)
        if cases
        else values.get("row_restitution", values["restitution"])
    )
    law, nominal = np.broadcast_arrays(requested.law, restitution)
    realised = np.empty(law.shape)
    for i, item in enumerate(laws):
        realised[law == i] = realised_restitution(item, nominal[law == i], spec.restitution_basis)
    touches = np.array([item.exponent is not None for item in laws])[requested.law]
    names = np.array([record.name for record in spec.records])
    contact = np.where(touches.T, values["stiffness"].T, np.nan).T
    units_of_contact = "kN/m for force ~ d, kN/m^1.5 for force ~ d^1.5"
    # the dimensions that values of the scenarios depend on, these values, units, long name and comment
    columns: dict[str, tuple[Any, ...]] = {
        "law": (("law",), np.array(spec.laws)[requested.law], "", _TEXTS["law"]),
        "record": (("record",), names[requested.record], "", _TEXTS["record"]),
        "scale": (("record", scale.dimension), values["scale"], "1", "factor on the record"),
        "restitution": (("restitution",), nominal, "1", "nominal coefficient of restitution"),
        "contact_stiffness": (("law", stiffness.dimension), contact, "", "contact stiffness", units_of_contact),
        "restitution_realised": (("law", "restitution"), realised, "1", *_REALISED),
    }
    for axis in (axis for axis in AXES.values() if axis.listed):
        listed = [getattr(case, axis.dimension) for case in cases]
        if any(value is not None for value in listed):
            columns[axis.dimension] = ((), np.array(listed, float), axis.unit, axis.long_name, axis.comment)
    if spec.scene.pair_names:
        columns["pair_gap"] = ("gap",), values["gap"], "m", "gap of the pair"
    if "row_restitution" in values:
        columns["pair_restitution"] = ("restitution",), values["restitution"], "1", "restitution of the pair"
    extra, outer, n = design_coordinates(spec) if spec.design else {}, tuple(axes), len(requested.shape)
    for name, (dims, column, *about) in [*columns.items()]:
        if column.ndim > n:
            grid = np.broadcast_to(column, (*column.shape[:-1], len(spec.scene.pair_names)))
            by_pair = [axis.dimension for axis in spec.named_axes("pair") if axis.kind == name.partition("_")[2]]
            columns[name] = (*dims, *by_pair, "pair"), grid[..., spec.scene.pair_of_label], *about
    for name, (dims, column, *about) in columns.items():
        grid = np.broadcast_to(column, (*requested.shape, *column.shape[n:]))
        if cases:
            extra[name] = coordinate(("case", *(dim for dim in dims if dim == "pair")), grid, *about)
        elif name not in outer and (name != "contact_stiffness" or "stiffness" not in outer or "pair" in dims):
            at = tuple(slice(None) if i < len(outer) and outer[i] in dims else 0 for i in range(n))
            extra[name] = coordinate(dims, grid[at], *about)
    if spec.user_laws:
        where, keys = extra["law"][:2] if cases else (("law",), spec.laws)
        extra |= law_coordinates(where, keys, {law.key: law for law in (*LAWS.values(), *spec.user_laws)})
    if not cases:
        text = "peak ground acceleration of the record at scale 1"
        extra["record_pga"] = coordinate(("record",), [record.pga for record in spec.records], "m s-2", text)
    if properties := spec.named_axes("building"):
        extra |= product_coordinates(spec.scene, properties)
    if len(plan.variants) == 1:
        return axes, extra | building_coordinates(plan.variants, {})
    variants = plan.variants[requested.variant.reshape(-1)]
    along = {axis.dimension: (axis.kind, len(axis.values)) for axis in properties}
    if cases:
        extra |= row_coordinates(variants, "case")
        along = {"case": ("", len(cases))}
    return axes, extra | building_coordinates(variants, along)


def _axes(plan: Plan) -> Coordinates:
    """Return the dimensions of the scenarios."""
    spec = plan.spec
    if spec.cases is not None:
        return {"case": coordinate(("case",), np.arange(1, len(spec.cases) + 1), "1", "listed scenario")}
    result: Coordinates = {}
    named = {axis.dimension: axis for axis in spec.named_axes("building", "pair")}
    for name, axis_values in spec.axes.items():
        if name in _TEXTS:
            result[name] = coordinate((name,), axis_values, "", _TEXTS[name])
            continue
        axis, owner = (named[name].axis, named[name].name) if name in named else (_AXES[name], None)
        text, units = axis.long_name + ("" if owner is None else f" of {axis.by} {owner}"), axis.unit
        values: Any = axis_values
        if name == "gap" and spec.gaps is None:
            if spec.pair_gaps or len({*spec.scene.gaps}) != 1:
                text = "smallest gap of the scene (see pair_gap)"
            values = (min(spec.scene.gaps, default=np.nan),)
        elif name == "gap" and spec.pair_gaps:
            text += " without gaps of its own"
        if name == "stiffness":
            exponent = next((law.exponent for law in plan.laws if law.exponent is not None), 1.0)
            units = "kN m-1" if exponent == 1 else f"kN m-{exponent:g}"
        result[name] = coordinate((name,), values, units, text, axis.comment)
    return result


def design_coordinates(spec: SweepSpec) -> Coordinates:
    """Return what a design drew for each of its cases, and which point of which block each is."""
    if spec.design is None or spec.cases is None:
        return {}
    result: Coordinates = {}
    for item in spec.design.inputs:
        if item.argument != "records":  # the record of a case is told anyway
            axis = AXES[item.argument]
            values = [getattr(case, item.argument if item.building else axis.dimension) for case in spec.cases]
            text = axis.long_name
            if item.building is not None:
                values = [dict(value).get(item.building, axis.neutral) for value in values]
                text = f"{text} of {axis.by} {item.building}"
            result[item.name] = coordinate(("case",), values, axis.unit, text)
    place = np.arange(len(spec.cases)) % len(spec.design)
    result[SAMPLE] = coordinate(("case",), place % spec.design.samples + 1, "1", "point of the design, from 1")
    if len(spec.design.blocks) > 1:
        text = "block of the design: A, B, or the input that A has of B"
        result[BLOCK] = coordinate(("case",), np.array(spec.design.blocks)[place // spec.design.samples], "", text)
    return result


def global_attributes(plan: Plan, outcome: Outcome) -> dict[str, Any]:
    """Return what the cube says of the sweep as a whole."""
    # which scenarios end before nothing can change any more
    notes = ["rows without damping end with the record"] * bool((longest_rest(plan.variants)[0] == 0.0).any())
    degrade = ["rows with storeys that degrade"] * any(spring.law.softens for spring in plan.spec.scene.springs)
    if those := degrade + ["floors without a gap"] * bool((plan.unique.gaps <= 0.0).any()):
        decayed = f"until a free motion has decayed to {SMALL_MOTION:g} of itself"
        notes.append(f"{' and '.join(those)} are followed {decayed}")
    spec = plan.spec
    records = [
        {
            **{"name": r.name, "dt": r.dt, "points": r.n_points, "sha256": r.sha256, "source": r.source},
            **asdict(record_measures(r)),
        }
        for r in spec.records
    ]
    result: dict[str, Any] = {
        "records": records,
        "scenarios_asked": plan.n_asked,
        "scenarios_run": outcome.run + outcome.reused,
        "scenarios_never_touching": outcome.untouched,
        "method": plan.numerics.method,
        "precision": plan.numerics.precision,
        "located": spec.locate,
        "rest": spec.rest,
        "rest_note": ("; ".join(notes) or None) if spec.rest == "auto" else None,
        "restitution_basis": spec.restitution_basis,
        "unit_system": "kN, t, m, s",
        "sweep": to_json(spec),
        "sweep_sha256": plan.digest,
        dataset.SOURCE_ATTRIBUTE: package_digest(),
        "sa_period": spec.sa_period,
        "records_left_out": spec.records_left_out or None,
        **{f"{name}_version": version for name, version in library_versions().items()},
    }
    if spec.accuracy is None:
        result["time_step"] = [r.dt / plan.numerics.steps(r) for r in spec.records]
    else:
        result |= {"accuracy": spec.accuracy, "accuracy_numbers": json.dumps(plan.choice_numbers)}
    if plan.choice:
        result["accuracy_choice"] = plan.choice
    if spec.title:
        result["title"] = spec.title
    if outcome.copied_from is not None:
        extended = f"extended from another cube by pounding_sweep {package_version()} (see extended_from)"
        result["history"] = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ} {extended}"
        result["extended_from"] = {**outcome.copied_from, "scenarios_taken": outcome.copied}
    return result
