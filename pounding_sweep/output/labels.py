"""What a sweep's cube is labelled with: its axes, further coordinates and global attributes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.model.laws import get_law, realised_restitution
from pounding_sweep.output.dataset import Axis
from pounding_sweep.output.property_labels import product_coordinates, property_axis, row_coordinates
from pounding_sweep.output.provenance import library_attribute
from pounding_sweep.output.source import library_versions
from pounding_sweep.spec.spec import contact_stiffness, to_json

if TYPE_CHECKING:
    from pounding_sweep.output.results import Outcome
    from pounding_sweep.plan.plan import Plan

_AXES = {
    "law": ("", "contact law"),
    "gap": ("m", "gap of every pair"),
    "stiffness_factor": ("1", "factor on the scene's reference contact stiffness"),
    "restitution": ("1", "nominal coefficient of restitution"),
    "record": ("", "ground-motion record"),
    "scale": ("1", "factor on the record"),
}
_REALISED = {
    "units": "1",
    "long_name": "realised coefficient of restitution",
    "comment": "restitution of two free masses under the damping that the sweep used (see restitution_basis); "
    "1 for laws without damping, missing without contact",
}


def scenario_axes(plan: Plan) -> tuple[list[Axis], dict[str, Any]]:
    """Return the dimensions of the scenarios, and what further coordinates say of them."""
    return _case_axes(plan) if plan.spec.cases is not None else _product_axes(plan)


def _product_axes(plan: Plan) -> tuple[list[Axis], dict[str, Any]]:
    spec = plan.spec
    axes = []
    properties = {axis.dimension: axis for axis in spec.property_axes}
    for name, given in spec.axes.items():
        if name in properties:
            axes.append(property_axis(properties[name]))
            continue
        values = given
        units, long_name = _AXES.get(name, ("", name))
        if name == "gap" and spec.gaps is None:
            uniform = len(set(spec.scene.gaps)) == 1
            values = (spec.scene.gaps[0],) if uniform else (min(spec.scene.gaps, default=np.nan),)
            long_name = "gap of every pair" if uniform else "smallest gap of the scene (see pair_gap)"
        if name == "stiffness":
            exponents = {law.exponent for law in plan.laws if law.exponent is not None}
            exponent = exponents.pop() if exponents else 1.0
            units = "kN m-1" if exponent == 1 else f"kN m-{exponent:g}"
            long_name = "contact stiffness"
        axes.append(Axis(name, values, units, long_name))
    extra: dict[str, Any] = {}
    n_pairs = len(spec.scene.pair_names)
    if n_pairs:
        gaps = [spec.scene.gaps] if spec.gaps is None else [[g] * n_pairs for g in spec.gaps]
        extra["pair_gap"] = (("gap", "pair"), np.array(gaps, float), {"units": "m", "long_name": "gap of the pair"})
    if spec.stiffness_factors is not None:
        table = [
            [
                contact_stiffness(spec.scene, key, stiffness_factor=f) if get_law(key).exponent is not None else np.nan
                for f in spec.stiffness_factors
            ]
            for key in spec.laws
        ]
        about = {"long_name": "contact stiffness", "comment": "kN/m for force ~ d, kN/m^1.5 for force ~ d^1.5"}
        extra["contact_stiffness"] = (("law", "stiffness_factor"), np.array(table, float), about)
    realised = [realised_restitution(get_law(key), spec.restitutions, spec.restitution_basis) for key in spec.laws]
    extra["restitution_realised"] = (("law", "restitution"), np.array(realised, float), _REALISED)
    extra["record_pga"] = (
        ("record",),
        np.array([r.pga for r in spec.records]),
        {"units": "m s-2", "long_name": "peak ground acceleration of the record at scale 1"},
    )
    return axes, extra | product_coordinates(spec.scene, spec.property_axes)


def _case_axes(plan: Plan) -> tuple[list[Axis], dict[str, Any]]:
    spec = plan.spec
    cases = spec.cases or ()
    first = spec.records[0].name

    def number(value: float | None) -> float:
        return np.nan if value is None else float(value)

    extra: dict[str, Any] = {
        "law": (("case",), [c.law for c in cases], {"long_name": "contact law"}),
        "record": (("case",), [c.record or first for c in cases], {"long_name": "ground-motion record"}),
        "scale": (("case",), [c.scale for c in cases], {"units": "1", "long_name": "factor on the record"}),
        "restitution": (
            ("case",),
            [number(c.restitution) for c in cases],
            {"units": "1", "long_name": "nominal coefficient of restitution"},
        ),
        "contact_stiffness": (
            ("case",),
            [
                np.nan
                if get_law(c.law).exponent is None
                else contact_stiffness(spec.scene, c.law, stiffness=c.stiffness, stiffness_factor=c.stiffness_factor)
                for c in cases
            ],
            {"long_name": "contact stiffness", "comment": "kN/m for force ~ d, kN/m^1.5 for force ~ d^1.5"},
        ),
    }
    keys, nominal = np.array([c.law for c in cases]), np.array([number(c.restitution) for c in cases])
    realised = np.empty(len(cases))
    for key in np.unique(keys):
        rows = keys == key
        realised[rows] = realised_restitution(get_law(str(key)), nominal[rows], spec.restitution_basis)
    extra["restitution_realised"] = (("case",), realised, _REALISED)
    n_pairs = len(spec.scene.pair_names)
    if n_pairs:
        gaps = np.empty((len(cases), n_pairs))
        for i, case in enumerate(cases):
            gaps[i] = spec.scene.gaps if case.gap is None else case.gap
        extra["pair_gap"] = (("case", "pair"), gaps, {"units": "m", "long_name": "gap of the pair"})
    if len(plan.variants) > 1:
        extra |= row_coordinates(plan.variants[plan.unique.variant[plan.inverse]], "case")
    return [Axis("case", np.arange(1, len(cases) + 1), "1", "listed scenario")], extra


def global_attributes(plan: Plan, outcome: Outcome) -> dict[str, Any]:
    """Return what the cube says of the sweep as a whole."""
    import xarray

    spec = plan.spec
    records = [
        {"name": r.name, "pga": r.pga, "dt": r.dt, "points": r.n_points, "sha256": r.sha256, "source": r.source}
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
        "xarray_version": xarray.__version__,
    }
    if spec.accuracy is None:
        found["time_step"] = [r.dt / plan.numerics.steps(r) for r in spec.records]
    else:
        found |= {"accuracy": spec.accuracy, "accuracy_choice": plan.choice}
    if spec.records_left_out:
        found["records_left_out"] = spec.records_left_out
    if spec.title:
        found["title"] = spec.title
    return found
