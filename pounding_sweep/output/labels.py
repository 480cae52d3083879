"""What a sweep's cube is labelled with: its axes, further coordinates and global attributes."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict
from functools import lru_cache
from importlib.metadata import version
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.model.laws import LAWS, realised_restitution
from pounding_sweep.model.scene import Building, Scene
from pounding_sweep.model.variants import Variants
from pounding_sweep.output.dataset import CubeAxis, law_coordinates
from pounding_sweep.output.identity import library_attribute, library_versions
from pounding_sweep.outputs.variables import scatter_dof
from pounding_sweep.records.measures import record_measures
from pounding_sweep.spec.axes import AXES, PropertyAxis, plain_name
from pounding_sweep.spec.design import BLOCK, SAMPLE
from pounding_sweep.spec.spec import SweepSpec, to_json

if TYPE_CHECKING:
    from pounding_sweep.output.results import Outcome
    from pounding_sweep.plan.plan import Plan


#: name -> (dimensions, values, attributes)
Coordinates = dict[str, tuple[tuple[str, ...], Any, dict[str, Any]]]

#: Axes by dimension, of building properties by kind.
_AXES = {axis.dimension: axis for axis in AXES.values()}
#: What axes that are no values of a scenario themselves come to: name, dimension beside the axis' own, attributes.
_COMES_TO: dict[str, tuple[str, str, dict[str, str]]] = {
    "stiffness": (
        "contact_stiffness",
        "law",
        {"long_name": "contact stiffness", "comment": "kN/m for force ~ d, kN/m^1.5 for force ~ d^1.5"},
    ),
    "scale": ("scale", "record", {"units": "1", "long_name": "factor on the record"}),
}


#: Kind of axis -> name, symbol, value as given, unit and long name of what it multiplies.
_MULTIPLIES: dict[str, tuple[str, str, Callable[[Building], float], str, str]] = {
    "period_factor": ("period", "T", lambda building: float(building.periods[0]), "s", "fundamental period"),
    "mass_factor": ("mass", "m", lambda building: float(sum(building.masses)), "t", "total mass"),
}


def property_axis(axis: PropertyAxis) -> CubeAxis:
    """Return an axis over a building property as the cube has it."""
    known = _AXES[axis.kind]
    long_name = known.long_name if axis.building is None else f"{known.long_name} of building {axis.building}"
    return CubeAxis(axis.dimension, axis.values, known.unit, long_name, known.comment)


def product_coordinates(scene: Scene, axes: tuple[PropertyAxis, ...]) -> Coordinates:
    """Return the period or mass of each building along its axis, and its ratio to that of each neighbour."""
    found: Coordinates = {}
    taken = [axis.dimension for axis in axes]

    def add(label: str, dims: tuple[str, ...], values: np.ndarray, units: str, *about: str) -> None:
        name = plain_name(label, (*taken, *found))
        told = dict(zip(("long_name", "comment"), about, strict=False))
        found[name] = (dims, values, {"units": units, **told})

    for kind, (short, symbol, own, units, what) in _MULTIPLIES.items():
        mine = {axis.building: axis for axis in axes if axis.kind == kind}
        for building in scene.buildings:
            if building.name in mine:
                axis = mine[building.name]
                values = own(building) * np.array(axis.values)
                add(f"{short}_{building.name}", (axis.dimension,), values, units, f"{what} of building {building.name}")
        for left, right in pairwise(scene.row):
            varied = [mine[item.name] for item in (left, right) if item.name in mine]
            if varied and isinstance(left, Building) and isinstance(right, Building):
                top, bottom = (np.array(mine[b.name].values if b.name in mine else [1.0]) for b in (left, right))
                ratio = own(left) / own(right) * top[:, None] / bottom[None, :]
                add(
                    f"{short}_ratio_{left.name}_{right.name}",
                    tuple(axis.dimension for axis in varied),
                    ratio.reshape([len(axis.values) for axis in varied]),
                    "1",
                    f"{short} ratio {symbol}1/{symbol}2 of {left.name} and {right.name}",
                    f"{what} of building {left.name} over that of building {right.name}",
                )
    return found


def row_coordinates(variants: Variants, dimension: str, prefix: str = "") -> Coordinates:
    """Return what the buildings are along a dimension of listed scenarios, one of each row of `variants`."""
    periods = np.stack(
        [2.0 * np.pi / variants.frequencies(b)[:, 0] for b in range(len(variants.scene.buildings))], axis=1
    )
    each = dimension, "building"
    own = "; missing where it is the building's own"
    about = {kind: {"units": axis.unit, "long_name": axis.long_name} for kind, axis in _AXES.items()}
    about["damping_ratio"]["long_name"] += own
    yielding: Coordinates = {}
    if any(variants.scene.yields):
        about["hardening"]["long_name"] += own
        yielding = {
            f"{prefix}strength_factor": (each, variants.strength_factor, about["strength_factor"]),
            f"{prefix}hardening": (each, variants.hardening, about["hardening"]),
        }
    return {
        f"{prefix}period_factor": (each, variants.period_factor, about["period_factor"]),
        f"{prefix}mass_factor": (each, variants.mass_factor, about["mass_factor"]),
        f"{prefix}fundamental_period": (each, periods, {"units": "s", "long_name": "fundamental period"}),
        f"{prefix}damping_ratio": ((dimension,), variants.damping_ratio, about["damping_ratio"]),
        **yielding,
    }


def building_coordinates(
    variants: Variants, dims: Sequence[tuple[str, str]], shape: Sequence[int], taken: Collection[str]
) -> Coordinates:
    """Return masses, stiffnesses, periods and damping of all buildings, along the dimensions that change them."""
    # `dims` are names of the dimensions of `variants`, of that shape, with the kind of property that they vary; "": any
    scene, n = variants.scene, range(len(variants.scene.buildings))
    modes = [[variants.frequencies(b)[:, mode : mode + 1] for b in n] for mode in (0, 1)]

    def periods(mode: int) -> np.ndarray:
        own = [w if w.shape[1] else np.full((len(w), 1), np.nan) for w in modes[mode]]
        return np.asarray(2.0 * np.pi / np.concatenate(own, axis=1))

    def ratios(mode: int) -> np.ndarray:
        own = []
        for b in n:
            (alpha, beta), w = variants.rayleigh(b), 2.0 * np.pi / periods(mode)[:, b]
            founded = scene.buildings[b].foundation is not None
            own.append(variants.modal_damping(b, mode) if founded else 0.5 * (alpha / w + beta * w))
        return np.stack(own, axis=1)

    floors, each = ("building", "storey"), ("building",)
    found: Coordinates = {}
    stability: list[Any] = []
    if any(building.p_delta for building in scene.buildings):
        theta = scatter_dof(variants.geometric_stiffnesses / variants.elastic_stiffnesses, scene)
        text = "stability coefficient P / (k h) of the storey"
        stability = [("stability_coefficient", floors, theta, ("period_factor",), "1", text)]
    for name, inner, values, kinds, units, text in (
        ("floor_mass", floors, scatter_dof(variants.masses, scene), ("mass_factor",), "t", "mass of the floor"),
        (
            *("storey_stiffness", floors, scatter_dof(variants.elastic_stiffnesses, scene)),
            *(("mass_factor", "period_factor"), "kN m-1", "stiffness of the storey"),
        ),
        ("fundamental_period", each, periods(0), ("period_factor",), "s", "fundamental period"),
        ("second_period", each, periods(1), ("period_factor",), "s", "second natural period"),
        ("first_damping_ratio", each, ratios(0), ("damping_ratio",), "1", "damping ratio of the first mode"),
        ("second_damping_ratio", each, ratios(1), ("damping_ratio",), "1", "damping ratio of the second mode"),
        *stability,
    ):
        whole = values.reshape(*shape, *values.shape[1:])
        kept = [name for name, kind in dims if kind in ("", *kinds)]
        at = tuple(slice(None) if dim in kept else 0 for dim, _ in dims)
        if name not in taken:
            found[name] = ((*kept, *inner), whole[at], {"units": units, "long_name": text})
    return found


_TEXTS = {"law": "contact law", "record": "ground-motion record"}
_PAIR_GAP = {"units": "m", "long_name": "gap of the pair"}
_REALISED = {
    "units": "1",
    "long_name": "realised coefficient of restitution",
    "comment": "restitution of two free masses under the damping that the sweep used (see restitution_basis); "
    "1 for laws without damping, missing without contact",
}


def scenario_axes(plan: Plan) -> tuple[list[CubeAxis], dict[str, Any]]:
    """Return the dimensions of the scenarios, and what further coordinates say of them."""
    axes, extra = _case_axes(plan) if plan.spec.cases is not None else _product_axes(plan)
    if plan.spec.own_laws:
        dims, keys = extra["law"][:2] if "law" in extra else (("law",), plan.spec.laws)
        extra |= law_coordinates(dims, keys, {law.key: law for law in (*LAWS.values(), *plan.spec.own_laws)})
    return axes, extra


def _product_axes(plan: Plan) -> tuple[list[CubeAxis], dict[str, Any]]:
    spec = plan.spec
    axes = []
    properties = {axis.dimension: axis for axis in spec.property_axes}
    for name, given in spec.axes.items():
        if name in properties:
            axes.append(property_axis(properties[name]))
            continue
        values = given
        units, long_name = ("", _TEXTS[name]) if name in _TEXTS else (_AXES[name].unit, _AXES[name].long_name)
        if name == "gap" and spec.gaps is None:
            uniform = len(set(spec.scene.gaps)) == 1
            values = (spec.scene.gaps[0],) if uniform else (min(spec.scene.gaps, default=np.nan),)
            long_name = "gap of every pair" if uniform else "smallest gap of the scene (see pair_gap)"
        if name == "stiffness":
            exponents = {law.exponent for law in plan.laws if law.exponent is not None}
            exponent = exponents.pop() if exponents else 1.0
            units = "kN m-1" if exponent == 1 else f"kN m-{exponent:g}"
        axes.append(CubeAxis(name, values, units, long_name))
    extra: dict[str, Any] = {}
    n_pairs = len(spec.scene.pair_names)
    if n_pairs:
        gaps = np.array([spec.scene.gaps] if spec.gaps is None else [[g] * n_pairs for g in spec.gaps], float)
        extra["pair_gap"] = (("gap", "pair"), gaps[:, spec.scene.pair_of_label], _PAIR_GAP)
    for column, (name, dim, about) in _COMES_TO.items():
        axis, values = spec.needed_axis(column)
        if axis.dimension != column:
            laws = [spec.law(key) for key in spec.laws]
            if dim == "law":
                each = [[axis.value(v, scene=spec.scene, law=law) for v in values] for law in laws]
                table = np.where([[law.exponent is None] for law in laws], np.nan, each)
            else:
                table = np.array([[spec.scale(axis, v, record) for v in values] for record in spec.records])
            extra[name] = ((dim, axis.dimension), table, about)
    realised = [realised_restitution(spec.law(key), spec.restitutions, spec.restitution_basis) for key in spec.laws]
    extra["restitution_realised"] = (("law", "restitution"), np.array(realised, float), _REALISED)
    extra["record_pga"] = (
        ("record",),
        np.array([r.pga for r in spec.records]),
        {"units": "m s-2", "long_name": "peak ground acceleration of the record at scale 1"},
    )
    named = product_coordinates(spec.scene, spec.property_axes)
    varied, along = (plan.variants[1:], spec.property_axes) if len(plan.variants) > 1 else (plan.variants, ())
    dims, shape = [(axis.dimension, axis.kind) for axis in along], [len(axis.values) for axis in along]
    return axes, extra | named | building_coordinates(varied, dims, shape, {*named})


def _case_axes(plan: Plan) -> tuple[list[CubeAxis], dict[str, Any]]:
    spec = plan.spec
    cases = spec.cases or ()
    first = spec.records[0].name

    def number(value: float | None) -> float:
        return np.nan if value is None else float(value)

    extra: dict[str, Any] = {
        "law": (("case",), [c.law for c in cases], {"long_name": "contact law"}),
        "record": (("case",), [c.record or first for c in cases], {"long_name": "ground-motion record"}),
        "scale": (("case",), [spec.case_value(c, "scale") for c in cases], _COMES_TO["scale"][2]),
        "restitution": (
            ("case",),
            [number(c.restitution) for c in cases],
            {"units": "1", "long_name": "nominal coefficient of restitution"},
        ),
        "contact_stiffness": (
            ("case",),
            [np.nan if spec.law(c.law).exponent is None else spec.case_value(c, "stiffness") for c in cases],
            _COMES_TO["stiffness"][2],
        ),
    }
    keys, nominal = np.array([c.law for c in cases]), np.array([number(c.restitution) for c in cases])
    realised = np.empty(len(cases))
    for key in np.unique(keys):
        rows = keys == key
        realised[rows] = realised_restitution(spec.law(str(key)), nominal[rows], spec.restitution_basis)
    extra["restitution_realised"] = (("case",), realised, _REALISED)
    for axis in AXES.values():
        if axis.listed and any(getattr(case, axis.dimension) is not None for case in cases):
            about = {"units": axis.unit, "long_name": axis.long_name, "comment": axis.comment}
            extra[axis.dimension] = (("case",), [number(getattr(case, axis.dimension)) for case in cases], about)
    n_pairs = len(spec.scene.pair_names)
    if n_pairs:
        gaps = np.empty((len(cases), n_pairs))
        for i, case in enumerate(cases):
            gaps[i] = spec.scene.gaps if case.gap is None else case.gap
        extra["pair_gap"] = (("case", "pair"), gaps[:, spec.scene.pair_of_label], _PAIR_GAP)
    if len(plan.variants) > 1:
        varied = plan.variants[plan.unique.variant[plan.inverse]]
        extra |= row_coordinates(varied, "case")
        extra |= building_coordinates(varied, [("case", "")], [len(cases)], {*extra})
    else:
        extra |= building_coordinates(plan.variants, [], [], {*extra})
    extra = design_coordinates(spec) | extra
    return [CubeAxis("case", np.arange(1, len(cases) + 1), "1", "listed scenario")], extra


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


@lru_cache(maxsize=1)
def _xarray_version() -> str:
    """Return the version of xarray, which is not loaded for it."""
    return version("xarray")


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
        **{library_attribute(name): version for name, version in library_versions().items()},
        "xarray_version": _xarray_version(),
    }
    if spec.accuracy is None:
        found["time_step"] = [r.dt / plan.numerics.steps(r) for r in spec.records]
    else:
        numbers = json.dumps(plan.choice_numbers)
        found |= {"accuracy": spec.accuracy, "accuracy_choice": plan.choice, "accuracy_numbers": numbers}
    if spec.sa_period is not None:
        found["sa_period"] = spec.sa_period
    if spec.records_left_out:
        found["records_left_out"] = spec.records_left_out
    if spec.title:
        found["title"] = spec.title
    return found
