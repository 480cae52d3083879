"""One scenario of a sweep, run with its full histories."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.model.laws import Law
from pounding_sweep.plan.scenarios import case_variants
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.spec.axes import AXES, COLUMNS, DIMENSIONS, FACTOR_KINDS, Case, contact_stiffness, plain_name
from pounding_sweep.spec.own_laws import find_law
from pounding_sweep.spec.spec import SweepSpec

if TYPE_CHECKING:
    import xarray as xr

#: What of a scenario may be chosen otherwise than the sweep has it.
SELECTORS = ("law", "record", *(dim for column in COLUMNS for dim in DIMENSIONS[column]))
#: Attribute of the histories: what tells the scenario from others of its sweep, beside law, record and gaps.
SCENARIO_ATTRIBUTE = "scenario"


def scenario_of(spec: SweepSpec, case: int | None = None) -> Case:
    """Return the scenario in the middle of a sweep, or one of its listed cases."""
    if spec.cases is not None:
        if case is None:
            return next((c for c in spec.cases if spec.law(c.law).has_contact), spec.cases[0])
        if not 1 <= case <= len(spec.cases):
            msg = f"case {case} is not listed; the sweep has cases 1 to {len(spec.cases)}"
            raise InputError(msg)
        return spec.cases[case - 1]
    if case is not None:
        msg = f"case {case} is not there; the sweep is a product of axes, choose by their values"
        raise InputError(msg)
    middle = {name: values[(len(values) - 1) // 2] for name, values in spec.axes.items() if values}
    law = next((key for key in spec.laws if spec.law(key).has_contact), spec.laws[0])
    values = {dim: middle[dim] for column in COLUMNS for dim in DIMENSIONS[column] if dim in middle}
    factors: dict[str, dict[str, float]] = {argument: {} for argument in FACTOR_KINDS}
    for argument, kind in FACTOR_KINDS.items():
        for axis in spec.property_axes:
            if axis.kind == kind and axis.building is not None:
                factors[argument][axis.building] = middle[axis.dimension]
    ratio = middle.get("damping_ratio")
    given = {argument: each for argument, each in factors.items() if each}
    return Case(law=law, record=middle["record"], damping_ratio=ratio, **{**values, **given})


def selectors(spec: SweepSpec) -> dict[str, tuple[str, str | None]]:
    """Return what of a scenario may be chosen by name -> field of `Case`, and building of a property that has one."""
    found: dict[str, tuple[str, str | None]] = {name: (name, None) for name in SELECTORS}
    for argument, axis in AXES.items():
        if axis.by_building:
            mine = {each.building: each.dimension for each in spec.property_axes if each.kind == axis.column}
            for building in spec.scene.buildings:
                name = mine.get(building.name) or plain_name(f"{axis.dimension}_{building.name}", found)
                found[name] = (argument, building.name)
        elif axis.of_buildings and not axis.listed:
            found[axis.dimension] = (axis.dimension, None)
    return found


def _chosen(spec: SweepSpec, own: Case, choice: Mapping[str, Any]) -> Case:
    """Return a scenario with what is chosen otherwise."""
    known, changes = selectors(spec), dict[str, Any]()
    for name, value in choice.items():
        field, building = known[name]
        axis = next((axis for argument, axis in AXES.items() if field in (argument, axis.dimension)), None)
        if axis is not None and axis.of_buildings:
            axis.check(value, (), "")
        changes[field] = (
            value if building is None else {**dict(changes.get(field, getattr(own, field))), building: value}
        )
    for column in COLUMNS:  # one way to give a stiffness, or a scale, stands for the others
        if len(given := [dim for dim in DIMENSIONS[column] if dim in choice]) > 1:
            msg = f"{' and '.join(given)} exclude each other; give one of them"
            raise InputError(msg)
        if given:
            changes |= {dim: getattr(Case, dim) for dim in DIMENSIONS[column] if dim not in given}
    return replace(own, **changes)


def simulate_one(
    spec: SweepSpec, *, case: int | None = None, output_step: float | None = None, **choice: Any
) -> xr.Dataset:
    """Run one scenario of a sweep and return its histories.

    Parameters
    ----------
    spec : SweepSpec
        A sweep; its scheme, step and number format are used.
    case : int, optional
        Number of a listed case, from 1.
    output_step : float, optional
        See `pounding_sweep.simulate`.
    **choice
        ``law``, ``gap`` (m; of all pairs, or a sequence of one per pair), ``stiffness``
        (kN/m**exponent) or ``stiffness_factor``, ``restitution``, ``record`` (a name of the
        sweep's), ``scale`` or ``pga`` (m/s2), and building properties by the dimension that
        their axis has in a cube, such as ``period_factor_left`` and ``damping_ratio``: in place
        of the scenario's own, which is that of `scenario_of`. None leaves it as it is.

    Returns
    -------
    xarray.Dataset
        What `pounding_sweep.simulate` returns. The attribute ``scenario`` tells the case, the
        stiffness, the restitution, the scale and the building properties where the sweep has
        several of them, or where they are chosen here; it is not there where none is told.

    Raises
    ------
    InputError
        A choice is unknown or not valid, or the scenario's stiffness is that of a law of
        another force exponent.

    Examples
    --------
    >>> from pounding_sweep.spec.build import build_spec
    >>> spec = build_spec(scene="mate2015", records="el_centro", laws=["none", "linear"], gaps=[0.005, 0.01])
    >>> simulate_one(spec, gap=0.01).attrs["law"]
    'linear'
    """
    from pounding_sweep.run.simulate import simulate

    own = scenario_of(spec, case)
    for name in choice:
        if name not in (known := selectors(spec)):
            raise InputError(unknown("choice", name, known))
    choice = {name: value for name, value in choice.items() if value is not None}
    names = [record.name for record in spec.records]
    chosen = _chosen(spec, own, {"record": own.record or names[0], **choice})
    if chosen.record not in names:
        raise InputError(unknown("record of this sweep", chosen.record, names))
    variants, index = case_variants(spec.scene, [chosen])
    scene, gap = variants.scene_of(index[0]), chosen.gap
    if gap is not None:
        scene = scene.with_gaps(gap if isinstance(gap, Sequence) else [gap] * len(scene.gaps))
    law = _law(spec, chosen.law)
    if not choice.keys() & {"stiffness", "stiffness_factor"}:
        _check_unit(spec, own, law)
    stiffness = contact_stiffness(scene, law, stiffness=chosen.stiffness, stiffness_factor=chosen.stiffness_factor)
    parameters = SCHEMES[spec.method].parameters if spec.method else ()
    one = simulate(
        scene,
        spec.record(chosen.record).scaled(spec.case_value(chosen, "scale")),
        law=law,
        stiffness=None if law.exponent is None else stiffness,
        restitution=chosen.restitution,
        method=spec.method,
        dt=spec.dt,
        accuracy=spec.accuracy,
        locate=spec.locate,
        beta=spec.beta if "beta" in parameters else None,
        gamma=spec.gamma if "gamma" in parameters else None,
        force_unstable=spec.force_unstable,
        restitution_basis=spec.restitution_basis,
        precision=spec.precision,
        output_step=output_step,
    )
    details = "; ".join(_details(spec, chosen, law, choice, case))
    return one.assign_attrs({SCENARIO_ATTRIBUTE: details} if details else {})


#: Share of every reported peak that histories show, and how often the step is halved for it at most.
SHOWN, _HALVINGS = 0.99, 8


def simulate_shown(spec: SweepSpec, output_step: float | None = None, **choice: Any) -> xr.Dataset:
    """Run one scenario as `simulate_one`, by default at steps so short that its histories show the peaks it reports."""
    from pounding_sweep.run.simulate import peaks_shown

    one = simulate_one(spec, output_step=output_step, **choice)
    for _ in range(_HALVINGS if output_step is None else 0):
        if peaks_shown(one) >= SHOWN:
            break
        one = simulate_one(spec, output_step=0.5 * one.attrs["time_step"], **choice)
    return one


def _law(spec: SweepSpec, given: str | Law) -> Law:
    """Return a law of the sweep by its key, or another one."""
    return next((law for law in spec.own_laws if law.key == given), None) or find_law(given)


def _unit(exponent: float) -> str:
    """Return the unit of the contact stiffness of a law of that force exponent."""
    return "kN/m" if exponent == 1 else f"kN/m^{exponent:g}"


def _check_unit(spec: SweepSpec, own: Case, law: Law) -> None:
    """Raise `InputError` where a law would take the stiffness of one of another exponent for its own."""
    meant = spec.law(own.law).exponent
    if own.stiffness is None or meant is None or law.exponent is None or meant == law.exponent:
        return
    msg = (
        f"the stiffness of this scenario, {own.stiffness:g} {_unit(meant)}, is that of law {own.law!r}, and law "
        f"{law.key!r} takes {_unit(law.exponent)}; give a stiffness ({_unit(law.exponent)}), or a stiffness factor on "
        "the scene's reference"
    )
    raise InputError(msg)


def _details(spec: SweepSpec, chosen: Case, law: Law, choice: Mapping[str, Any], number: int | None) -> Iterator[str]:
    """Say what tells a scenario from others of its sweep, and what was chosen in place of the sweep's."""

    def differs(name: str) -> bool:
        values = spec.axes.get(name, ()) if spec.cases is None else [getattr(case, name) for case in spec.cases]
        return name in choice or len(set(values)) > 1

    if spec.cases is not None:
        yield f"case {number or spec.cases.index(scenario_of(spec)) + 1}"
    restitution = spec.scene.contact.restitution if chosen.restitution is None else chosen.restitution
    scale = chosen.axis("scale")
    for name, value, exists, unit in (
        ("stiffness", chosen.stiffness, law.exponent is not None, f" {_unit(law.exponent or 1)}"),
        ("stiffness_factor", chosen.stiffness_factor, law.exponent is not None, ""),
        ("restitution", restitution, law.takes_restitution, ""),
        *((dim, scale[1], scale[0].dimension == dim, "") for dim in DIMENSIONS["scale"] if scale),
    ):
        if exists and value is not None and differs(name):
            yield f"{name.replace('_', ' ')} {value:g}{unit}"
    single = {(axis.kind, axis.building) for axis in spec.property_axes if len(axis.values) == 1}
    asked = {place for name, place in selectors(spec).items() if name in choice}
    for plural, kind in FACTOR_KINDS.items():
        for building, factor in dict(getattr(chosen, plural)).items():
            if (kind, building) not in single or (plural, building) in asked:
                yield f"{kind.replace('_', ' ')} of {building} {factor:g}"
    if chosen.damping_ratio is not None and differs("damping_ratio"):
        yield f"damping ratio {chosen.damping_ratio:g}"
