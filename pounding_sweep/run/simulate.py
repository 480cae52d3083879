"""One scenario with full histories: of a scene and a record, or out of a sweep."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import InputError, StabilityError, check_choice
from pounding_sweep.model.faults import is_number
from pounding_sweep.model.laws import LAWS, Law, find_law, realised_restitution
from pounding_sweep.model.presets import get_preset
from pounding_sweep.model.scene import Scene
from pounding_sweep.output.dataset import Coordinates, assemble
from pounding_sweep.plan.plan import make_plan
from pounding_sweep.plan.scenarios import ChunkTask
from pounding_sweep.records import Record, resolve_record
from pounding_sweep.request import axes
from pounding_sweep.request.axes import AXES, COLUMNS, DIMENSIONS, Case, contact_stiffness, names_by, plain_name
from pounding_sweep.request.build import build_spec
from pounding_sweep.request.spec import DEFAULT_STEP, SweepSpec, canonical, case_variants, json_data
from pounding_sweep.run.histories import histories, instants_in_contact, peak_share
from pounding_sweep.run.refinement import STATES, ended, run_scenarios
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.variables.registry import VARIABLES, Status

if TYPE_CHECKING:
    import xarray as xr

#: Outputs that no history is told with.
NOT_OF_ONE = ("closing_max", "time_step", "error_estimate", "amplification", "origin", "run")


def simulate(
    scene: Scene | str,
    record: Record | str,
    *,
    law: str | Law | None = None,
    gaps: float | Sequence[float] | None = None,
    stiffness: float | None = None,
    restitution: float | None = None,
    method: str | None = None,
    dt: float | None = None,
    locate: bool = True,
    rest: float | str = "auto",
    initial_velocity: Sequence[Any] | None = None,
    beta: float | None = None,
    gamma: float | None = None,
    force_unstable: bool = False,
    restitution_basis: str = "published",
    precision: str | None = None,
    accuracy: float | None = None,
    output_step: float | None = None,
    pair_stiffness_factors: Mapping[str, float] | None = None,
    pair_restitutions: Mapping[str, float] | None = None,
) -> xr.Dataset:
    """Run one scenario and return its histories.

    Parameters
    ----------
    scene : Scene or str
        The row (kN, t, m, s), or the name of a preset.
    record : Record or str
        Ground motion, or its name or file.
    law : str or Law
        Contact law; "none" for a run without pounding. May be left out for a single building.
    gaps : float or sequence of float, optional
        Gap (m) of all pairs, or one of each, instead of the scene's.
    stiffness : float, optional
        Contact stiffness (kN/m**exponent); the scene's reference where not given.
    restitution : float, optional
        Coefficient of restitution; the scene's where not given.
    method, dt, locate, rest, beta, gamma, force_unstable, restitution_basis, precision, accuracy
        As of `pounding_sweep.request.build.build_spec`: by default an accuracy of 1e-3, by the cheapest scheme that
        reaches it; in "float64".
    initial_velocity : sequence, optional
        Velocity (m/s) of the floors relative to the ground at the start: one sequence (or number for all floors) per
        building, left to right.
    output_step : float, optional
        Largest time (s) between instants of the histories; by default the step, where an accuracy chooses that at most
        1e-3 s. Peaks are located between instants: they may be larger than what the histories show.
    pair_stiffness_factors, pair_restitutions : mapping of str to float, optional
        Factors on the contact stiffness of pairs, and their coefficients of restitution, by name.

    Returns
    -------
    xarray.Dataset
        On ``time`` (s): ``displacement``, ``velocity`` (m, m/s, relative to the ground), ``acceleration`` (m/s2,
        total), ``ground_acceleration``, ``contact_force`` (kN), ``penetration`` (m, zero while open), and energies (kN
        m) ``input``, ``kinetic``, ``strain``, ``damping`` and ``transfer`` per building and ``work`` per pair; those of
        storeys that yield, links and foundations; beside them every variable of a cube that the row can have. The
        attribute ``scene`` holds the row as JSON. Histories end where a storey falls.

    Raises
    ------
    InputError
        An argument is not valid.
    StabilityError
        The step is beyond the stability limit; the message gives the largest one.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> one = ps.simulate("mate2015", "el_centro", law="linear", stiffness=2e6)
    >>> round(float(one.impact_force_max.max()) / 1e3, 1)
    3.7
    """
    motion = resolve_record(record)
    row = get_preset(scene) if isinstance(scene, str) else scene
    if gaps is not None:
        row = replace(row, gaps=gaps)  # type: ignore[arg-type]  # one number is that of all pairs
    if law is None and row.gaps:
        raise InputError(
            f"simulate needs law=, one of {', '.join(LAWS)}; law='none' runs the buildings without contact"
        )
    contact = find_law(law or "none")
    spec = build_spec(
        scene=row,
        records=motion,
        laws=contact,
        stiffnesses=stiffness if contact.has_contact else None,
        restitutions=restitution if contact.takes_restitution else None,
        pair_stiffness_factors=pair_stiffness_factors,
        pair_restitutions=pair_restitutions,
        method=method,
        dt=dt,
        locate=locate,
        rest=rest,
        beta=beta,
        gamma=gamma,
        force_unstable=force_unstable,
        restitution_basis=restitution_basis,
        precision=precision or "float64",
        accuracy=accuracy,
        outputs=tuple(name for name in VARIABLES if name not in NOT_OF_ONE),
    )
    row = spec.scene
    outputs = tuple(name for name in spec.outputs if any(row.yields) or not VARIABLES[name].of_yielding)
    velocities = None if initial_velocity is None else _velocities(row, initial_velocity)
    approaches = [sum(share * velocities[i] for i, share in c.ends) for c in row.contacts if velocities]
    plan = make_plan(spec, initial_speed=max([0.0, *approaches]))
    spec, steps, limit = plan.spec, int(plan.steps[0]), plan.limit[0]
    longest = DEFAULT_STEP if output_step is None and spec.accuracy is not None else output_step
    if longest is not None:
        if not (is_number(longest) and 0.0 < longest < math.inf):
            raise InputError(f"output_step is {output_step!r}; it must be a positive number of seconds")
        steps = max(steps, math.ceil(motion.dt / longest * (1.0 - 1e-9)))
    if motion.dt / steps > limit and not force_unstable:
        raise StabilityError(
            f"the step {motion.dt / steps:.6g} s is beyond the stability limit of {plan.numerics.method} for this "
            f"scene and contact stiffness; give dt <= {limit:.6g} s, {plan.numerics.scheme.without_limit} or "
            "force_unstable=True"
        )
    kernel = replace(plan.kernel(0, record=0, steps=steps), history=True, initial_velocity=velocities)
    values = run_scenarios(ChunkTask(kernel, motion, plan.unique, plan.variants, (*outputs, "time_step")))
    states, step = values.pop(STATES)[0], float(values["time_step"][0])
    kernel = ended(kernel, motion, round(motion.dt / step))
    e, has, takes = spec.restitutions[0], contact.has_contact, contact.takes_restitution
    attributes = {
        "title": spec.title or f"{motion.name}: {contact.title}",
        "law": contact.key,
        "stiffness": contact_stiffness(row, contact, stiffness=stiffness),
        "restitution": e if takes else "none",
        "restitution_realised": float(realised_restitution(contact, e, restitution_basis)) if has else "none",
        "restitution_basis": restitution_basis,
        "record": motion.name,
        "method": kernel.numerics.method,
        "precision": kernel.numerics.precision,
        "time_step": step,
        "located": spec.locate,
        "rest": spec.rest,
        "unit_system": "kN, t, m, s",
        "scene": canonical(json_data(row)),
    }
    attributes |= {"accuracy": spec.accuracy} if spec.accuracy is not None else {}
    attributes |= {"accuracy_choice": plan.choice} if plan.choice else {}
    gap: Coordinates = {}
    if row.pair_labels:
        pair_gaps = [row.gaps[pair] for pair in row.pair_of_label]
        gap["pair_gap"] = (("pair",), pair_gaps, {"units": "m", "long_name": "gap of the pair"})
    variables = {name: value[0] for name, value in values.items() if name not in NOT_OF_ONE}
    dataset = assemble(row, {}, variables, attributes, gap)
    if int(variables["status"]) != Status.DIVERGED:
        every = max(1, int(output_step / step * (1.0 + 1e-9))) if output_step is not None else 1
        time = step * np.arange(len(states))
        fall = np.fmin.reduce(variables.get("collapse_time", [np.inf]), initial=np.inf)
        end = int(np.searchsorted(time, fall, "right"))
        dataset = dataset.assign(histories(kernel, states[:end:every], motion, time[:end:every]))
    return dataset


def _velocities(scene: Scene, values: Sequence[Any]) -> tuple[float, ...]:
    """Return the velocity (m/s) of each floor, of one number or one for each floor of every building."""
    storeys = {building.name: building.n_storeys for building in scene.buildings}
    try:
        parts = [np.broadcast_to(np.asarray(v, float), n) for v, n in zip(values, storeys.values(), strict=True)]
    except (TypeError, ValueError):
        parts = [np.full(1, np.nan)]
    floors = np.concatenate(parts)
    if not np.isfinite(floors).all():
        wanted = ", ".join(f"{n} of {name!r}" for name, n in storeys.items())
        raise InputError(
            f"initial_velocity is {values!r}; give one entry per building (m/s): a finite number, or one for each of "
            f"its storeys, bottom first ({wanted})"
        )
    return tuple(floors.tolist())


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
    if values["pga"] is not None or values["sa"] is not None:  # which the scale follows from
        del values["scale"]
    return {"case": case} | {name: value for name, value in values.items() if value is not None}


def selectors(spec: SweepSpec) -> dict[str, tuple[str, str | None]]:
    """Return what of a scenario may be chosen by name -> field of `Case`, and building or pair that it belongs to."""
    names = ("law", "record", *(dim for column in COLUMNS for dim in DIMENSIONS[column]))
    fields: dict[str, tuple[str, str | None]] = {name: (name, None) for name in names}
    for argument, axis in sorted(AXES.items(), key=lambda item: not item[1].by):
        if axis.by:
            named = {item.name: item.dimension for item in spec.named_axes("building", "pair") if item.axis is axis}
            for owner in names_by(spec.scene, axis.by):
                fields[named.get(owner) or plain_name(f"{axis.dimension}_{owner}", fields)] = (argument, owner)
        elif axis.of_buildings and not axis.listed:
            fields[axis.dimension] = (axis.dimension, None)
    return fields


def _value(case: Case, field: str, building: str | None) -> Any:
    """Return a field of a case, or of a building's or pair's property in it; None where it has none."""
    return getattr(case, field) if building is None else dict(getattr(case, field)).get(building)


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
        In place of the values of `scenario_of`: ``law``, ``gap`` (m; of all pairs, or one per pair), ``stiffness``
        (kN/m**exponent) or ``stiffness_factor``, ``restitution``, ``record``, ``scale`` or ``pga`` (m/s2), and
        properties of buildings and pairs by their dimension in a cube, such as ``period_factor_left``.

    Returns
    -------
    xarray.Dataset
        What `pounding_sweep.simulate` returns. The attribute ``scenario`` tells what distinguishes it in the sweep.

    Raises
    ------
    InputError
        A choice is unknown or not valid, or the stiffness is that of a law of another force exponent.

    Examples
    --------
    >>> from pounding_sweep.request.build import build_spec
    >>> spec = build_spec(scene="mate2015", records="el_centro", laws=["none", "linear"], gaps=[0.005, 0.01])
    >>> simulate_one(spec, gap=0.01).attrs["law"]
    'linear'
    """
    scenario, fields = scenario_of(spec, case), dict[str, Any]()
    selected = selectors(spec)
    for name in choice:
        check_choice("choice", name, selected)
    choice = {name: value for name, value in choice.items() if value is not None}
    for name, value in choice.items():
        if axis := AXES.get(selected[name][0]):  # others are checked with the scenario
            axis.check(value)
    for column in COLUMNS:
        if len(ways := [dim for dim in DIMENSIONS[column] if dim in choice]) > 1:
            raise InputError(f"{' and '.join(ways)} exclude each other; give one of them")
        if ways:
            scenario = {name: value for name, value in scenario.items() if name not in DIMENSIONS[column]}
    if isinstance(choice.get("gap"), Sequence):  # one for each pair
        scenario = {name: value for name, value in scenario.items() if selected.get(name, "")[0] != "pair_gaps"}
    values = scenario | choice
    for name, (field, building) in selected.items():
        if name in values:
            fields[field] = values[name] if building is None else fields.get(field, {}) | {building: values[name]}
    names = [record.name for record in spec.records]
    chosen = Case(**{"record": names[0], **fields})
    check_choice("record of this sweep", chosen.record, names)
    variants, index = case_variants(spec.scene, [chosen])
    scene = variants.scene_of(index[0])
    scene = scene.with_gaps(chosen.gaps_of(scene))
    law = next((law for law in spec.user_laws if law.key == chosen.law), None) or find_law(chosen.law)
    number, before = values.get("stiffness"), spec.law(scenario["law"])
    if "stiffness" not in choice and number and before.exponent and law.exponent not in (None, before.exponent):
        raise InputError(
            f"the stiffness of this scenario, {number:g} {_stiffness_unit(before)}, is that of law {before.key!r}, "
            f"and law {law.key!r} takes {_stiffness_unit(law)}; give a stiffness ({_stiffness_unit(law)}), or a "
            "stiffness factor on the scene's reference"
        )
    stiffness = contact_stiffness(scene, law, stiffness=chosen.stiffness, stiffness_factor=chosen.stiffness_factor)
    settings = ["method", "dt", "accuracy", "locate", "rest", "force_unstable", "restitution_basis", "precision"]
    settings += SCHEMES[spec.method].parameters if spec.method else ()
    one = simulate(
        scene,
        spec.record(str(chosen.record)).scaled(spec.case_value(chosen, "scale")),
        law=law,
        stiffness=None if law.exponent is None else stiffness,
        restitution=chosen.restitution,
        output_step=output_step,
        pair_stiffness_factors=dict(chosen.pair_stiffness_factors),
        pair_restitutions=dict(chosen.pair_restitutions),
        **{name: getattr(spec, name) for name in settings},
    )
    details = "; ".join(_details(spec, values, law, choice))
    return one.assign_attrs({"scenario": details} if details else {})


#: Share of every reported peak that histories show, instants of their deepest contact, and how often the step is
#: halved for them at most.
PEAK_SHARE, _INSTANTS, _HALVINGS = 0.99, 40, 8


def simulate_finely(spec: SweepSpec, output_step: float | None = None, **choice: Any) -> xr.Dataset:
    """Run one scenario as `simulate_one`, by default at steps so short that histories show peaks and contacts."""
    one = simulate_one(spec, output_step=output_step, **choice)
    for _ in range(_HALVINGS if output_step is None else 0):
        if peak_share(one) >= PEAK_SHARE and instants_in_contact(one) >= _INSTANTS:
            break
        one = simulate_one(spec, output_step=0.5 * one.attrs["time_step"], **choice)
    return one


def _stiffness_unit(law: Law) -> str:
    """Return the unit of a law's contact stiffness as titles and messages spell it."""
    return "kN/m" if law.exponent == 1 else f"kN/m^{law.exponent:g}"


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
        if differs and name not in ignored and field != "pair_gaps" and values.get(name) is not None:
            what = name if building is None else f"{axes.FACTOR_KINDS[field]} of {building}"
            unit = f" {_stiffness_unit(law)}" if name == "stiffness" else ""
            yield f"{what.replace('_', ' ')} {values[name]:g}{unit}"
