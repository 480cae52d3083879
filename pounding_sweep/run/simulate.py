"""One scenario with full histories."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import InputError, StabilityError
from pounding_sweep.model.laws import LAWS, Law, realised_restitution
from pounding_sweep.model.presets import get_preset
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import variants_of
from pounding_sweep.output.dataset import assemble
from pounding_sweep.outputs.declare import scatter_base, scatter_contact, scatter_dof, scatter_link
from pounding_sweep.outputs.differences import comparable
from pounding_sweep.outputs.variables import Status
from pounding_sweep.records import Record, resolve_record
from pounding_sweep.spec.axes import contact_stiffness
from pounding_sweep.spec.build import build_spec
from pounding_sweep.spec.own_laws import find_law
from pounding_sweep.spec.spec import scene_data

if TYPE_CHECKING:
    import xarray as xr

    from pounding_sweep.engine.row_kernel import RowKernel


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
    from pounding_sweep.engine.postprocess import variables_of
    from pounding_sweep.engine.row_kernel import RowKernel
    from pounding_sweep.kernel.spec import history_slots
    from pounding_sweep.outputs.variables import VARIABLES, reducers_for
    from pounding_sweep.plan.plan import make_plan

    motion = resolve_record(record)
    row = get_preset(scene) if isinstance(scene, str) else scene
    if isinstance(row, Scene):
        if gaps is not None:
            row = replace(row, gaps=[gaps] * len(row.gaps) if isinstance(gaps, int | float) else gaps)
        if law is None and row.gaps:
            msg = f"simulate needs law=, one of {', '.join(LAWS)}; law='none' runs the buildings without contact"
            raise InputError(msg)
    found = find_law(law or "none")
    outputs = tuple(name for name in VARIABLES if name not in NOT_OF_ONE)
    spec = build_spec(
        scene=row,
        records=motion,
        laws=found,
        stiffnesses=stiffness if found.has_contact else None,
        restitutions=restitution if found.takes_restitution else None,
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
    velocities = _velocities(row, initial_velocity)
    k = contact_stiffness(row, found, stiffness=stiffness)
    e = spec.restitutions[0]
    plan = make_plan(spec, initial_speed=_approach(row, velocities))
    steps = int(plan.steps[0])
    if output_step is not None:
        steps = max(steps, math.ceil(motion.dt / _checked_step(output_step) * (1.0 - 1e-9)))
    numerics = replace(plan.numerics, dt=motion.dt / steps)
    limit = float(plan.limit[0])
    step = motion.dt / numerics.steps(motion)
    if step > limit and not force_unstable:
        msg = (
            f"the step {step:.6g} s is beyond the stability limit of {numerics.method} for this scene and contact "
            f"stiffness; give dt <= {limit:.6g} s, {numerics.scheme.without_limit} or force_unstable=True"
        )
        raise StabilityError(msg)
    kernel = RowKernel(
        row,
        found,
        numerics,
        reducers_for(outputs),
        history=True,
        initial_velocity=velocities,
        basis=restitution_basis,
    )

    def run(kernel: RowKernel) -> tuple[dict[str, np.ndarray], np.ndarray]:
        n_steps = (motion.n_points - 1) * kernel.numerics.steps(motion)
        history = np.zeros((n_steps + 1, max(1, history_slots(kernel.shape).size)))
        gaps = np.array([row.gaps], dtype=float).reshape(1, -1)
        alone = np.ones(1)
        raw = kernel.run(motion, scale=alone, gaps=gaps, stiffness=k * alone, restitution=e * alone, history=history)
        return variables_of(kernel, raw, outputs, motion), history

    variables, history = run(kernel)
    if spec.accuracy is not None:
        kernel, variables, history = _refined(kernel, motion, run, variables, spec.accuracy)
    numerics, n_steps = kernel.numerics, len(history) - 1
    step = motion.dt / numerics.steps(motion)
    values = {name: v[0] for name, v in variables.items()}
    realised = realised_restitution(found, e, restitution_basis)
    attributes = {
        "title": spec.title or f"{motion.name}: {found.title}",
        "law": found.key,
        "stiffness": k,
        "restitution": e if found.takes_restitution else "none",
        "restitution_realised": float(realised) if found.has_contact else "none",
        "restitution_basis": restitution_basis,
        "record": motion.name,
        "method": numerics.method,
        "precision": numerics.precision,
        "time_step": step,
        "located": spec.locate,
        "unit_system": "kN, t, m, s",
        "scene": json.dumps(scene_data(row), sort_keys=True, separators=(",", ":"), allow_nan=False),
    }
    if spec.accuracy is not None:
        attributes |= {"accuracy": spec.accuracy, "accuracy_choice": plan.choice}
    own = [row.gaps[pair] for pair in row.pair_of_label]
    extra = {"pair_gap": (("pair",), own, {"units": "m", "long_name": "gap of the pair"})} if own else None
    dataset = assemble(row, [], values, attributes, extra)
    if int(values["status"]) != Status.DIVERGED:
        time = np.linspace(0.0, motion.duration, n_steps + 1)
        every = max(1, int(output_step / step * (1.0 + 1e-9))) if output_step is not None else 1
        dataset = dataset.assign(_histories(kernel, history[::every], motion, time[::every]))
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


#: Histories of foundations: name, unit, what it is.
_OF_BASES = (("foundation_sway", "m", "displacement"), ("foundation_rotation", "rad", "rotation"))


def _checked_step(output_step: float) -> float:
    """Return an output step that is a positive number."""
    if not (math.isfinite(output_step) and output_step > 0.0):
        msg = f"output_step is {output_step!r}; it must be a positive number of seconds"
        raise InputError(msg)
    return output_step


def _refined(
    kernel: RowKernel,
    motion: Record,
    run: Callable[[RowKernel], tuple[dict[str, np.ndarray], np.ndarray]],
    coarse: dict[str, np.ndarray],
    accuracy: float,
) -> tuple[RowKernel, dict[str, np.ndarray], np.ndarray]:
    """Halve the step until no output errs by more than `accuracy`; see `pounding_sweep.run.refinement`."""
    from pounding_sweep.run.refinement import (
        MOST_HALVINGS,
        SINGLE_HALVINGS,
        differences,
        halved,
        leeway,
        strictness,
    )

    for halving in range(MOST_HALVINGS):
        kernel = halved(kernel if halving < SINGLE_HALVINGS else kernel.in_double, motion)
        fine, history = run(kernel)
        allowed = accuracy / strictness(fine)
        estimate = differences(comparable(fine), coarse, fine, leeway(kernel, accuracy, allowed))
        if estimate[0] <= allowed[0] and fine["status"][0] == Status.OK:
            return kernel, fine, history
        coarse = fine
    settled = (estimate <= accuracy) | (fine["status"] != Status.OK)
    fine["status"] = np.where(settled, fine["status"], Status.UNSETTLED)
    return kernel, fine, history


def _velocities(scene: Scene, given: Sequence[Any] | None) -> tuple[float, ...] | None:
    if given is None:
        return None
    buildings = scene.buildings
    if len(given) != len(buildings):
        msg = f"initial_velocity has {len(given)} entries for {len(buildings)} buildings; give one per building (m/s)"
        raise InputError(msg)
    result: list[float] = []
    for building, values in zip(buildings, given, strict=True):
        floors = np.asarray(values, dtype=float)
        if floors.ndim == 0:
            floors = np.full(building.n_storeys, float(floors))
        if floors.shape != (building.n_storeys,) or not np.isfinite(floors).all():
            msg = (
                f"initial_velocity of building {building.name!r} is {values!r}; "
                f"give {building.n_storeys} finite numbers (m/s), bottom first"
            )
            raise InputError(msg)
        result += [float(v) for v in floors]
    return tuple(result)


def _approach(scene: Scene, velocities: tuple[float, ...] | None) -> float:
    """Largest speed (m/s) at which floors that can meet approach each other at the start."""
    if velocities is None:
        return 0.0
    return max([0.0, *(sum(share * velocities[i] for i, share in contact.ends) for contact in scene.contacts)])


def _building_sum(values: np.ndarray, scene: Scene) -> np.ndarray:
    return np.add.reduceat(values, np.array(scene.offsets[:-1]), axis=1)


def _with_base(values: np.ndarray, base: np.ndarray, scene: Scene, shapes: str) -> np.ndarray:
    """Add what the bases of those with foundations make of values of floors, by matrices of buildings of a name."""
    result = values.copy()
    for q, b in enumerate(scene.foundations):
        start, stop = scene.offsets[b : b + 2]
        result[:, start:stop] += base[:, 2 * q : 2 * q + 2] @ getattr(scene.buildings[b], shapes)[:, -2:].T
    return result


def _drifts(values: np.ndarray, base: np.ndarray, scene: Scene) -> np.ndarray:
    """Storey drifts of floors and of the bases of those that have foundations."""
    drifts = values.copy()
    for start, stop in pairwise(scene.offsets):
        drifts[:, start + 1 : stop] -= values[:, start : stop - 1]
    return _with_base(drifts, base, scene, "drifts")


def _histories(kernel: Any, history: np.ndarray, motion: Record, time: np.ndarray) -> dict[str, Any]:
    import xarray as xr

    from pounding_sweep.kernel.spec import history_slots

    scene = kernel.scene
    slots = history_slots(kernel.shape)

    def part(name: str) -> np.ndarray:
        return history[:, slots.first[name] : slots.first[name] + slots.count[name]]

    ground = np.interp(time, motion.time, motion.acceleration)
    buildings = scene.buildings
    masses = np.concatenate([b.masses for b in buildings])
    row = variants_of(scene)
    stiffnesses, pushed = row.stiffnesses[0], row.geometric_stiffnesses[0]
    storeys = [b.n_storeys for b in buildings]
    owner = np.repeat(np.arange(len(buildings)), storeys)
    alpha = np.array([b.rayleigh[0] for b in buildings])[owner]
    beta = np.array([b.rayleigh[1] for b in buildings])[owner]
    (u, u_base), (v, v_base) = (np.split(part(name), [scene.n_dof], axis=1) for name in "uv")
    taken = part("e_in")
    n_contacts = len(scene.contacts)
    force = part("force") if "force" in slots.first else np.zeros((len(time), n_contacts))
    gap = np.array([scene.gaps[c.pair] for c in scene.contacts]) - scene.thicknesses(kernel.law.thickness)
    penetration = np.zeros((len(time), n_contacts))
    on_floor = -alpha * masses * _with_base(v, v_base, scene, "deformations")
    drift, damped, yields = _drifts(u, u_base, scene), stiffnesses, any(scene.yields)
    storey = stiffnesses * drift
    strains = 0.5 * stiffnesses * drift**2
    hysteretic = np.zeros_like(taken)
    if yields:
        soft = 1.0 - row.hardenings[0]
        plastic, strengths = (
            part("slip"),
            np.concatenate([b.yield_strengths or (0.0,) * b.n_storeys for b in buildings]),
        )
        storey = stiffnesses * (drift - soft * plastic)
        strains = 0.5 * stiffnesses * ((1.0 - soft) * drift**2 + soft * (drift - plastic) ** 2)
        lost = (1.0 - row.elastic_hardenings[0]) * np.where(scene.yields, strengths, 0.0) * part("travel")
        hysteretic = _building_sum(lost, scene)
        damped = part("kd") if "kd" in slots.first else damped
    shear = storey + pushed * drift
    dashpots = np.concatenate([b.dashpots or (0.0,) * b.n_storeys for b in buildings])
    storey = storey + (beta * damped + dashpots) * _drifts(v, v_base, scene)
    on_floor -= storey
    for b, first in zip(buildings, scene.offsets[:-1], strict=True):
        on_floor[:, first : first + b.n_storeys - 1] += storey[:, first + 1 : first + b.n_storeys]
    for j, c in enumerate(scene.contacts):
        closing = np.zeros(len(time))
        for floor, share in c.ends:
            closing += share * u[:, floor]
            on_floor[:, floor] -= share * force[:, j]
        penetration[:, j] = np.maximum(closing - gap[j], 0.0)
    pulls = np.zeros((len(time), len(scene.linked_floors)))
    for j, link in enumerate(scene.linked_floors):
        d, rate = (x[:, link.left] - x[:, link.right] for x in (u, v))
        pulls[:, j] = link.stiffness * d + link.damping * rate
        on_floor[:, link.left] -= pulls[:, j]
        on_floor[:, link.right] += pulls[:, j]
    given = part("e_link") if scene.links else np.zeros_like(taken)
    kinetic = _building_sum(0.5 * masses * v**2, scene)
    strain = _building_sum(strains, scene)
    for q, b in enumerate(scene.foundations):
        mine = slice(2 * q, 2 * q + 2)
        kinetic[:, b] += v_base[:, mine] ** 2 @ (0.5 * row.base_masses[0, mine])
        strain[:, b] += u_base[:, mine] ** 2 @ (0.5 * row.base_stiffnesses[0, mine])
    damping = part("e_damp")
    axis = ("time",)
    floors, pairs = (*axis, "building", "storey"), (*axis, "pair", "storey")
    variables: dict[str, Any] = {
        "displacement": (floors, scatter_dof(u, scene), "m", "floor displacement relative to the ground"),
        "velocity": (floors, scatter_dof(v, scene), "m s-1", "floor velocity relative to the ground"),
        "acceleration": (floors, scatter_dof(on_floor / masses, scene), "m s-2", "total floor acceleration"),
        "ground_acceleration": (axis, ground, "m s-2", "ground acceleration"),
        "input": ((*axis, "building"), taken, "kN m", "input energy"),
        "damping": ((*axis, "building"), damping, "kN m", "energy dissipated by structural damping"),
        "kinetic": ((*axis, "building"), kinetic, "kN m", "kinetic energy"),
        "strain": ((*axis, "building"), strain, "kN m", "strain energy"),
        "transfer": (
            (*axis, "building"),
            taken - damping - strain - (kinetic - kinetic[0]) - hysteretic - given,
            "kN m",
            "transferred energy: input - kinetic - damping - strain - yielding - given to links since the start",
        ),
    }
    if yields:
        variables |= {
            "storey_drift": (floors, scatter_dof(drift, scene), "m", "interstorey displacement"),
            "plastic_drift": (floors, scatter_dof(plastic, scene), "m", "plastic part of the interstorey displacement"),
            "storey_shear": (floors, scatter_dof(shear, scene), "kN", "storey shear, dampers not included"),
            "hysteretic": ((*axis, "building"), hysteretic, "kN m", "energy lost in yielding"),
        }
    if scene.links:
        about = "force of the link, positive where it draws the floors together"
        variables["link_force"] = (pairs, scatter_link(pulls, scene), "kN", about)
        variables["given_to_links"] = ((*axis, "building"), given, "kN m", "energy given to links")
    for side, (name, unit, what) in enumerate(_OF_BASES) if scene.foundations else ():
        moved = scatter_base(u_base[:, side::2], scene)
        variables[name] = ((*axis, "building"), moved, unit, f"{what} of the foundation relative to the ground")
    if scene.pair_names:
        variables["contact_force"] = (pairs, scatter_contact(force, scene), "kN", "contact force, pressing positive")
        variables["penetration"] = (pairs, scatter_contact(penetration, scene), "m", "penetration, zero while open")
        work = np.zeros((len(time), len(scene.pair_labels)))
        if "work" in slots.first:
            for j, c in enumerate(scene.contacts):
                work[:, c.place] += part("work")[:, j]
        variables["work"] = ((*axis, "pair"), work, "kN m", "work of the contacts: what they took in")
    result: dict[str, Any] = {
        "time": xr.DataArray(time, dims=axis, attrs={"units": "s", "long_name": "time", "axis": "T"})
    }
    for name, (dims, values, units, long_name) in variables.items():
        result[name] = xr.DataArray(values, dims=dims, attrs={"units": units, "long_name": long_name})
    return result
