"""One scenario of a sweep, run with its full histories."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.model.laws import Law, find_law
from pounding_sweep.plan.scenarios import case_variants
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.spec.axes import AXES, COLUMNS, DIMENSIONS, FACTOR_KINDS, Case, contact_stiffness, plain_name
from pounding_sweep.spec.spec import SweepSpec

if TYPE_CHECKING:
    import xarray as xr


def scenario_of(spec: SweepSpec, case: int | None = None) -> dict[str, Any]:
    """Return the scenario in the middle of a sweep, or a listed case and its number: values by `selectors`."""
    if spec.cases is None:
        if case is not None:
            raise InputError(f"case {case} is not there; the sweep is a product of axes, choose by their values")
        law = next((key for key in spec.laws if spec.law(key).has_contact), spec.laws[0])
        return {name: values[(len(values) - 1) // 2] for name, values in spec.axes.items() if values} | {"law": law}
    if case is not None and not 1 <= case <= len(spec.cases):
        raise InputError(f"case {case} is not listed; the sweep has cases 1 to {len(spec.cases)}")
    case = case or next((i for i, item in enumerate(spec.cases, 1) if spec.law(item.law).has_contact), 1)
    listed = spec.cases[case - 1]
    values = {name: _value(listed, *field) for name, field in selectors(spec).items()}
    axes = [pair[0].dimension for column in COLUMNS if (pair := listed.axis(column))]  # not the scale where a PGA is
    ignored = {dim for column in COLUMNS for dim in DIMENSIONS[column]} - {*axes}
    return {"case": case} | {name: v for name, v in values.items() if v is not None and name not in ignored}


def selectors(spec: SweepSpec) -> dict[str, tuple[str, str | None]]:
    """Return what of a scenario may be chosen by name -> field of `Case`, and building of a property that has one."""
    names = ("law", "record", *(dim for column in COLUMNS for dim in DIMENSIONS[column]))
    found: dict[str, tuple[str, str | None]] = {name: (name, None) for name in names}
    for argument, axis in sorted(AXES.items(), key=lambda item: not item[1].by_building):
        if axis.by_building:
            mine = {each.building: each.dimension for each in spec.property_axes if each.kind == axis.column}
            for building in spec.scene.buildings:
                name = mine.get(building.name) or plain_name(f"{axis.dimension}_{building.name}", found)
                found[name] = (argument, building.name)
        elif axis.of_buildings and not axis.listed:
            found[axis.dimension] = (axis.dimension, None)
    return found


def _value(case: Case, field: str, building: str | None) -> Any:
    """Return a field of a case, or of a building's property in it; None where it has none."""
    return getattr(case, field) if building is None else dict(getattr(case, field)).get(building)


def _checked(spec: SweepSpec, choice: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is chosen, without None, if it is known and valid, and nothing is chosen in two ways."""
    fields = selectors(spec)
    for name in choice:
        if name not in fields:
            raise InputError(unknown("choice", name, fields))
    choice = {name: value for name, value in choice.items() if value is not None}
    for name, value in choice.items():
        axis = next((axis for argument, axis in AXES.items() if fields[name][0] in (argument, axis.dimension)), None)
        if axis is not None and axis.of_buildings:
            axis.check(value, (), "")
    for column in COLUMNS:
        if len(ways := [dim for dim in DIMENSIONS[column] if dim in choice]) > 1:
            raise InputError(f"{' and '.join(ways)} exclude each other; give one of them")
    return choice


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

    scenario, choice = scenario_of(spec, case), _checked(spec, choice)
    replaced = {dim for column in COLUMNS for dim in DIMENSIONS[column] if choice.keys() & {*DIMENSIONS[column]}}
    values = {name: value for name, value in scenario.items() if name not in replaced} | choice
    fields: dict[str, Any] = {}
    for name, (field, building) in selectors(spec).items():
        if name in values:
            fields[field] = values[name] if building is None else fields.get(field, {}) | {building: values[name]}
    names = [record.name for record in spec.records]
    chosen = Case(**{"record": names[0], **fields})
    if chosen.record not in names:
        raise InputError(unknown("record of this sweep", chosen.record, names))
    variants, index = case_variants(spec.scene, [chosen])
    scene, gap = variants.scene_of(index[0]), chosen.gap
    if gap is not None:
        scene = scene.with_gaps(gap if isinstance(gap, Sequence) else [gap] * len(scene.gaps))
    law = next((law for law in spec.own_laws if law.key == chosen.law), None) or find_law(chosen.law)
    given, exponent = values.get("stiffness"), spec.law(scenario["law"]).exponent
    if "stiffness" not in choice and given and exponent and law.exponent and exponent != law.exponent:
        raise InputError(
            f"the stiffness of this scenario, {given:g} {_unit(exponent)}, is that of law {scenario['law']!r}, and law "
            f"{law.key!r} takes {_unit(law.exponent)}; give a stiffness ({_unit(law.exponent)}), or a stiffness factor "
            "on the scene's reference"
        )
    stiffness = contact_stiffness(scene, law, stiffness=chosen.stiffness, stiffness_factor=chosen.stiffness_factor)
    settings = ["method", "dt", "accuracy", "locate", "force_unstable", "restitution_basis", "precision"]
    settings += SCHEMES[spec.method].parameters if spec.method else ()
    one = simulate(
        scene,
        spec.record(chosen.record).scaled(spec.case_value(chosen, "scale")),
        law=law,
        stiffness=None if law.exponent is None else stiffness,
        restitution=chosen.restitution,
        output_step=output_step,
        **{name: getattr(spec, name) for name in settings},
    )
    details = "; ".join(_details(spec, values, law, choice))
    return one.assign_attrs({"scenario": details} if details else {})


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


def _unit(exponent: float) -> str:
    """Return the unit of the contact stiffness of a law of that force exponent."""
    return "kN/m" if exponent == 1 else f"kN/m^{exponent:g}"


def _details(spec: SweepSpec, values: Mapping[str, Any], law: Law, choice: Mapping[str, Any]) -> Iterator[str]:
    """Say what tells a scenario from others of its sweep, and what was chosen in place of the sweep's."""
    if "case" in values:
        yield f"case {values['case']}"
    values = {"restitution": spec.scene.contact.restitution, **values}
    ignored = {"law", "record", "gap"} | (set() if law.takes_restitution else {"restitution"})
    ignored |= {"stiffness", "stiffness_factor"} if law.exponent is None else set()
    for name, (field, building) in selectors(spec).items():
        listed = [_value(item, field, building) for item in spec.cases or ()]
        differs = name in choice or len({*spec.axes.get(name, listed)}) > 1 or (building and spec.cases is not None)
        if differs and name not in ignored and values.get(name) is not None:
            what = name if building is None else f"{FACTOR_KINDS[field]} of {building}"
            unit = f" {_unit(law.exponent or 1)}" if name == "stiffness" else ""
            yield f"{what.replace('_', ' ')} {values[name]:g}{unit}"
