"""One scenario with full histories."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import InputError, StabilityError
from pounding_sweep.engine.row_kernel import RowKernel
from pounding_sweep.kernel.spec import history_slots
from pounding_sweep.model.laws import LAWS, Law, find_law, realised_restitution
from pounding_sweep.model.presets import get_preset
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import variants_of
from pounding_sweep.output.dataset import Coordinates, assemble
from pounding_sweep.outputs.variables import DIMS, VARIABLES, Status, scatter
from pounding_sweep.plan.plan import make_plan
from pounding_sweep.records import Record, resolve_record
from pounding_sweep.run.refinement import STATES, ended, run_scenarios
from pounding_sweep.spec.axes import contact_stiffness
from pounding_sweep.spec.build import build_spec
from pounding_sweep.spec.spec import json_data

if TYPE_CHECKING:
    import xarray as xr

#: Outputs that no history is told with.
NOT_OF_ONE = ("closing_max", "time_step", "error_estimate", "amplification")


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
    initial_velocity: Sequence[Any] | None = None,
    beta: float | None = None,
    gamma: float | None = None,
    force_unstable: bool = False,
    restitution_basis: str = "published",
    precision: str | None = None,
    accuracy: float | None = None,
    output_step: float | None = None,
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
    method : str, optional
        Scheme, one of `pounding_sweep.schemes.SCHEMES`; "rk4" by default, with `accuracy` the cheapest that reaches it.
    dt : float, optional
        Largest time step (s); 1e-3 by default, with `accuracy` the largest that reaches it.
    locate : bool
        Locate contacts and peaks inside the step.
    initial_velocity : sequence, optional
        Velocity (m/s) of the floors relative to the ground at the start: one
        sequence (or number for all floors) per building, left to right.
    beta, gamma : float, optional
        Newmark's parameters.
    force_unstable : bool
        Run beyond the stability limit.
    restitution_basis : {"published", "realised"}
        Whether damping follows from the restitution by the law's published formula,
        or so that two free masses rebound at exactly it.
    precision : {"float64", "float32"}, optional
        Number format of the kernel; "float64" by default, with `accuracy` the cheaper that reaches it.
    accuracy : float, optional
        Relative error asked for, 1e-6 to 1e-2, instead of a step.
    output_step : float, optional
        Largest time (s) from one instant of the histories to the next; by default the step. Where it is shorter
        than the step, the run takes steps as short. Peaks are located between instants whatever it is: variables
        of a cube may be larger than what the histories show, see `peaks_shown`.

    Returns
    -------
    xarray.Dataset
        On ``time`` (s): ``displacement``, ``velocity`` (m, m/s, relative to the
        ground), ``acceleration`` (m/s2, total), ``ground_acceleration``,
        ``contact_force`` (kN), ``penetration`` (m, zero while open), and energies
        (kN m) ``input``, ``kinetic``, ``strain``, ``damping`` and ``transfer`` per
        building and ``work`` per pair; where storeys yield ``storey_drift``, ``plastic_drift``
        (m), ``storey_shear`` (kN) and ``hysteretic`` (kN m); where neighbours are linked
        ``link_force`` (kN) and ``given_to_links`` (kN m); of foundations ``foundation_sway`` (m) and
        ``foundation_rotation`` (rad); beside them every variable of a cube that the row can have. The attribute
        ``scene`` holds the row as JSON.

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
        row = replace(row, gaps=[gaps] * len(row.gaps) if isinstance(gaps, int | float) else gaps)
    if law is None and row.gaps:
        raise InputError(
            f"simulate needs law=, one of {', '.join(LAWS)}; law='none' runs the buildings without contact"
        )
    contact = find_law(law or "none")
    outputs = tuple(name for name in VARIABLES if name not in NOT_OF_ONE)
    spec = build_spec(
        scene=row,
        records=motion,
        laws=contact,
        stiffnesses=stiffness if contact.has_contact else None,
        restitutions=restitution if contact.takes_restitution else None,
        method=method,
        dt=dt,
        locate=locate,
        beta=beta,
        gamma=gamma,
        force_unstable=force_unstable,
        restitution_basis=restitution_basis,
        precision=precision,
        accuracy=accuracy,
        outputs=outputs,
    )
    row = spec.scene
    outputs = tuple(name for name in outputs if any(row.yields) or not VARIABLES[name].of_yielding)
    velocities = None if initial_velocity is None else _velocities(row, initial_velocity)
    approaches = [sum(share * velocities[i] for i, share in c.ends) for c in row.contacts if velocities]
    plan = make_plan(spec, initial_speed=max([0.0, *approaches]))
    steps = int(plan.steps[0])
    if output_step is not None:
        if not (math.isfinite(output_step) and output_step > 0.0):
            raise InputError(f"output_step is {output_step!r}; it must be a positive number of seconds")
        steps = max(steps, math.ceil(motion.dt / output_step * (1.0 - 1e-9)))
    limit = float(plan.limit[0])
    if motion.dt / steps > limit and not force_unstable:
        raise StabilityError(
            f"the step {motion.dt / steps:.6g} s is beyond the stability limit of {plan.numerics.method} for this "
            f"scene and contact stiffness; give dt <= {limit:.6g} s, {plan.numerics.scheme.without_limit} or "
            "force_unstable=True"
        )
    kernel = replace(plan.kernel(0, record=0, steps=steps), history=True, initial_velocity=velocities)
    values = run_scenarios(kernel, motion, plan.unique, plan.variants, (*outputs, "time_step"))
    states, step = values.pop(STATES)[0], float(values.pop("time_step")[0])
    kernel = ended(kernel, motion, round(motion.dt / step))
    e, has = spec.restitutions[0], contact.has_contact
    attributes = {
        "title": spec.title or f"{motion.name}: {contact.title}",
        "law": contact.key,
        "stiffness": contact_stiffness(row, contact, stiffness=stiffness),
        "restitution": e if contact.takes_restitution else "none",
        "restitution_realised": float(realised_restitution(contact, e, restitution_basis)) if has else "none",
        "restitution_basis": restitution_basis,
        "record": motion.name,
        "method": kernel.numerics.method,
        "precision": kernel.numerics.precision,
        "time_step": step,
        "located": spec.locate,
        "unit_system": "kN, t, m, s",
        "scene": json.dumps(json_data(row), sort_keys=True, separators=(",", ":"), allow_nan=False),
    }
    if accuracy is not None:
        attributes |= {"accuracy": accuracy, "accuracy_choice": plan.choice}
    pair_gaps = [row.gaps[pair] for pair in row.pair_of_label]
    extra: Coordinates = {}
    if pair_gaps:
        extra["pair_gap"] = (("pair",), pair_gaps, {"units": "m", "long_name": "gap of the pair"})
    variables = {name: v[0] for name, v in values.items() if name not in NOT_OF_ONE}
    dataset = assemble(row, {}, variables, attributes, extra)
    if int(variables["status"]) != Status.DIVERGED:
        every = max(1, int(output_step / step * (1.0 + 1e-9))) if output_step is not None else 1
        time = np.linspace(0.0, motion.duration, len(states))
        dataset = dataset.assign(histories(kernel, states[::every], motion, time[::every]))
    return dataset


#: Peaks that a cube has, the histories in which they are seen, and on which side: 0 for either.
_SEEN = {
    "displacement_max": ("displacement", 1),
    "displacement_min": ("displacement", -1),
    "acceleration_max": ("acceleration", 0),
    "impact_force_max": ("contact_force", 0),
}


def peaks_shown(one: xr.Dataset) -> float:
    """Return the least share of a reported peak that its history shows, of displacements, accelerations and forces."""
    # peaks are located between the instants of the histories; the share is that of the largest of all floors or
    # contacts, 1 where every peak is shown
    shares = [1.0]
    for peak, (history, sign) in _SEEN.items():
        if peak in one and history in one:
            series = one[history]
            seen, reported = ((abs(each) if sign == 0 else sign * each).max().item() for each in (series, one[peak]))
            if reported > 0.0:
                shares.append(seen / reported)
    return min(shares)


def _velocities(scene: Scene, given: Sequence[Any]) -> tuple[float, ...]:
    """Return the velocity (m/s) of each floor, of one number or one for each floor of every building."""
    storeys = {building.name: building.n_storeys for building in scene.buildings}
    try:
        parts = [np.broadcast_to(np.asarray(v, float), n) for v, n in zip(given, storeys.values(), strict=True)]
    except (TypeError, ValueError):
        parts = [np.full(1, np.nan)]
    floors = np.concatenate(parts)
    if not np.isfinite(floors).all():
        wanted = ", ".join(f"{n} of {name!r}" for name, n in storeys.items())
        raise InputError(
            f"initial_velocity is {given!r}; give one entry per building (m/s): a finite number, or one for each of "
            f"its storeys, bottom first ({wanted})"
        )
    return tuple(floors.tolist())


#: Histories in the order of the Dataset: what there is one of each for, unit, and what it is.
HISTORIES = {
    "displacement": ("floor", "m", "floor displacement relative to the ground"),
    "velocity": ("floor", "m s-1", "floor velocity relative to the ground"),
    "acceleration": ("floor", "m s-2", "total floor acceleration"),
    "ground_acceleration": ("scenario", "m s-2", "ground acceleration"),
    "input": ("building", "kN m", "input energy"),
    "damping": ("building", "kN m", "energy dissipated by structural damping"),
    "kinetic": ("building", "kN m", "kinetic energy"),
    "strain": ("building", "kN m", "strain energy"),
    "transfer": (
        "building",
        "kN m",
        "transferred energy: input - kinetic - damping - strain - yielding - given to links since the start",
    ),
    "storey_drift": ("floor", "m", "interstorey displacement"),
    "plastic_drift": ("floor", "m", "plastic part of the interstorey displacement"),
    "storey_shear": ("floor", "kN", "storey shear, dampers not included"),
    "hysteretic": ("building", "kN m", "energy lost in yielding"),
    "link_force": ("link", "kN", "force of the link, positive where it draws the floors together"),
    "given_to_links": ("building", "kN m", "energy given to links"),
    "foundation_sway": ("base", "m", "displacement of the foundation relative to the ground"),
    "foundation_rotation": ("base", "rad", "rotation of the foundation relative to the ground"),
    "contact_force": ("contact", "kN", "contact force, pressing positive"),
    "penetration": ("contact", "m", "penetration, zero while open"),
    "work": ("pair", "kN m", "work of the contacts: what they took in"),
}


def histories(kernel: RowKernel, states: np.ndarray, record: Record, time: np.ndarray) -> dict[str, xr.DataArray]:
    """Return ``time`` and all histories that the row has, from its states at these times, shape (time, slots)."""
    import xarray as xr

    scene, slots = kernel.scene, history_slots(kernel.shape)
    row, n = variants_of(scene), scene.n_dof
    part = {name: states[:, first : first + slots.count[name]] for name, first in slots.first.items()}
    moved, moving = part["u"], part["v"]  # of floors, then of foundations
    u, v = moved[:, :n], moving[:, :n]
    drifts, deformations = (_by_motion(scene, name) for name in ("drifts", "deformations"))
    owner = np.repeat(np.arange(len(scene.buildings)), [b.n_storeys for b in scene.buildings])
    owned = np.equal.outer([*owner, *np.repeat(scene.foundations, 2)], range(len(scene.buildings))).astype(float)
    masses, base = np.hstack([row.masses, row.base_masses])[0], row.base_stiffnesses[0]
    alpha, beta = (factor[0, owner] for factor in row.rayleigh_factors)

    # storeys: the elastic part, and that which may yield
    drift, plastic, stiffnesses, soft = (
        moved @ drifts.T,
        part.get("slip", 0.0),
        row.stiffnesses[0],
        1.0 - row.hardenings[0],
    )
    spring = stiffnesses * (drift - soft * plastic)
    strain = 0.5 * stiffnesses * ((1.0 - soft) * drift**2 + soft * (drift - plastic) ** 2)
    strengths = np.where(scene.yields, row.yield_strengths[0], 0.0)
    hysteretic = ((1.0 - row.elastic_hardenings[0]) * strengths * part.get("travel", np.zeros_like(u))) @ owned[:n]
    damper = (beta * part.get("kd", stiffnesses) + row.dashpots[0]) * (moving @ drifts.T)

    # contacts and links: what each floor moves them by
    pressed = np.zeros((len(scene.contacts), n))
    for j, contact in enumerate(scene.contacts):
        for floor, share in contact.ends:
            pressed[j, floor] = share
    linked = np.zeros((len(scene.linked_floors), n))
    for j, link in enumerate(scene.linked_floors):
        linked[j, [link.left, link.right]] = 1.0, -1.0
    gaps = np.array([scene.gaps[contact.pair] for contact in scene.contacts]) - scene.thicknesses(kernel.law.thickness)
    force = part.get("force", np.zeros((len(time), len(pressed))))
    pull = (u @ linked.T) * [link.stiffness for link in scene.linked_floors]
    pull += (v @ linked.T) * [link.damping for link in scene.linked_floors]
    labels = np.equal.outer([contact.place for contact in scene.contacts], range(len(scene.pair_labels)))

    on_floors = -alpha * masses[:n] * (moving @ deformations.T) - (spring + damper) @ drifts[:, :n]
    on_floors -= force @ pressed + pull @ linked
    kinetic = (0.5 * masses * moving**2) @ owned
    strain = np.hstack([strain, 0.5 * base * moved[:, n:] ** 2]) @ owned
    given = part.get("e_link", np.zeros_like(kinetic))
    values = {
        "displacement": u,
        "velocity": v,
        "acceleration": on_floors / masses[:n],
        "ground_acceleration": np.interp(time, record.time, record.acceleration)[:, None],
        "input": part["e_in"],
        "damping": part["e_damp"],
        "kinetic": kinetic,
        "strain": strain,
        "transfer": part["e_in"] - part["e_damp"] - strain - (kinetic - kinetic[0]) - hysteretic - given,
    }
    if any(scene.yields):
        shear = spring + row.geometric_stiffnesses[0] * drift
        values |= {"storey_drift": drift, "plastic_drift": plastic, "storey_shear": shear, "hysteretic": hysteretic}
    if scene.links:
        values |= {"link_force": pull, "given_to_links": given}
    if scene.foundations:
        values |= {"foundation_sway": moved[:, n::2], "foundation_rotation": moved[:, n + 1 :: 2]}
    if scene.pair_names:
        work = part.get("work", np.zeros_like(force)) @ labels.astype(float)
        values |= {"contact_force": force, "penetration": np.maximum(u @ pressed.T - gaps, 0.0), "work": work}
    found = {"time": xr.DataArray(time, dims="time", attrs={"units": "s", "long_name": "time", "axis": "T"})}
    for name, (per, units, long_name) in HISTORIES.items():
        if name in values:
            about = {"units": units, "long_name": long_name}
            found[name] = xr.DataArray(scatter(values[name], scene, per), dims=("time", *DIMS[per]), attrs=about)
    return found


def _by_motion(scene: Scene, name: str) -> np.ndarray:
    """Return a matrix that each building has, for the whole row, shape (floors, floors and bases)."""
    n = scene.n_dof
    result = np.zeros((n, n + 2 * len(scene.foundations)))
    for b, building in enumerate(scene.buildings):
        floors = np.arange(*scene.offsets[b : b + 2])
        bases = 2 * scene.foundations.index(b) + np.array([n, n + 1]) if building.foundation else ()
        result[np.ix_(floors, [*floors, *bases])] = getattr(building, name)
    return result
