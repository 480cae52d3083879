"""What the outputs of a kernel mean: the variables of the cube, and the status of each scenario.

Whether a time step resolves contacts, the buildings' motion and the ground's is said by rules that need no finer run.
Their limits were set by measurement, so that the peaks of a scenario that passes them all are within `OK_CLAIM`; the
stability suite (`pounding_sweep.accuracy.extremes`) checks that claim. A motion that no ground can bring about has
diverged, however finite it is: `energy_limit` tells.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np

from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.records import Record
from pounding_sweep.variables.registry import VARIABLES, KernelResults, Status, cube_variables

#: Largest phase error of a building's fundamental motion (rad).
MAX_PHASE_ERROR = 0.01
#: Weight of the second mode in it, which moves the building less but decides how it hits.
SECOND_MODE = 0.25
#: Most energy, in multiples of `energy_limit`, of a motion that has not diverged.
MAX_ENERGY = 2.0


def phase_error(row: Scene | Variants, record: Record, numerics: Numerics) -> np.ndarray:
    """Phase by which a scheme misses the first two modes (rad), the largest of all buildings."""
    systems, h = variants_of(row).systems, record.dt / numerics.steps(record)
    w, decay = (np.concatenate([array[:, :2].T for array in parts]) for parts in zip(*systems, strict=True))
    weights = np.concatenate([(1.0, SECOND_MODE)[: array.shape[1]] for array, _ in systems])
    share = numerics.scheme.phase_error(w * h, numerics.beta, numerics.gamma)
    rest = np.where(decay > 0.0, numerics.rest, 0.0)
    lasting = np.minimum(record.duration + rest, 2.0 / np.maximum(decay, 1e-300))
    return np.max(weights[:, None] * w * lasting * share, axis=0, initial=0.0)


@lru_cache(maxsize=64)
def loses_ground(record: Record, numerics: Numerics) -> bool:
    """Whether the ground turns back within more of single steps than the scheme follows."""
    steps, need = numerics.steps(record), numerics.scheme.min_ground_steps
    # around its peak alone the ground gains the velocity of at least a quarter of a record interval
    if steps >= 4.0 * need or not record.duration or not record.pga:
        return False
    points = np.arange((record.n_points - 1) * steps + 1) / steps
    a = np.interp(points, np.arange(record.n_points), record.acceleration)
    gained = np.cumsum(0.5 * (a[1:] + a[:-1]))  # velocity over the step
    reach = max(gained.max(), 0.0) - min(gained.min(), 0.0)  # in steps of its largest acceleration
    return bool(reach / record.pga < need * (1.0 - 1e-9))


def energy_limit(
    row: Scene | Variants, record: Record, scale: np.ndarray, initial_velocity: Sequence[float] | None = None
) -> np.ndarray:
    """Most energy that a row can ever hold (kN m), shape of `scale`."""
    masses, bases = variants_of(row).masses, variants_of(row).base_masses[:, ::2]
    a = np.abs(np.append(record.acceleration, 0.0))  # in one more step of the record the ground comes to rest
    pushed = 0.5 * float(np.sum(a[1:] + a[:-1])) * record.dt  # never less than the integral
    start = 0.0 if initial_velocity is None else np.sqrt((masses * np.square(initial_velocity)).sum(axis=1))
    total = masses.sum(axis=1) + bases.sum(axis=1)
    return 0.5 * (np.sqrt(total) * pushed * np.abs(scale) + start) ** 2


def displacement_limit(row: Scene | Variants, energy: np.ndarray) -> np.ndarray:
    """Largest displacement of every floor (m) that the energies (kN m) allow, shape (n, floors)."""
    variants, twice = variants_of(row), 2.0 * np.asarray(energy)[:, None]
    scene, k, r, yields = variants.scene, variants.stiffnesses, variants.hardenings, any(variants.scene.yields)
    factor = np.repeat(variants.stiffness_factors, np.diff(scene.offsets), axis=1)
    moves = np.zeros((2, scene.n_dof))  # of each floor, by sway and by rocking of its base, by the roots of the springs
    for building, first in zip(scene.buildings, scene.offsets, strict=False):
        if building.foundation is not None:
            sway, rocking = building.foundation.stiffnesses
            moves[0, first : first + building.n_storeys] = sway**-0.5
            moves[1, first : first + building.n_storeys] = building.elevations * rocking**-0.5
    # a push at floor i bends all storeys below it, each by 1 / k, and what the building stands on
    storeys = 1.0 / k
    if yields:
        k = variants.own_stiffnesses  # whatever infill bears
        # its springs hold at most that energy, and its yielding has lost at most what the ground put in, twice that
        held = np.sqrt(twice / k)
        with np.errstate(divide="ignore"):
            hard = np.where(r > 0.0, held / np.sqrt(r), np.inf)
        soft = (1.0 - variants.elastic_hardenings) * variants.yield_strengths
        slid = held + twice / soft
        unbounded = [spring for spring in scene.springs if not (spring.law.bounds_drifts or spring.is_infill)]
        slid[:, [spring.floor for spring in unbounded]] = np.inf
        hard[:, [spring.floor for spring in unbounded if spring.law.can_fail]] = np.inf
        # no energy bounds the drift of one that softens under its weight, but the limit at which it falls, and rounding
        storeys = np.where(r < 0.0, 1.01 * variants.drift_limits, np.minimum(hard, slid))
    parts = np.split(storeys, scene.offsets[1:-1], axis=1)
    for b, building in enumerate(scene.buildings):
        if building.stiffness_matrix is None:
            parts[b] = np.cumsum(parts[b], axis=1)  # from the ground up
        else:
            soft = np.diag(np.linalg.inv(building.lateral_matrix)) / variants.stiffness_factors[:, b, None]
            parts[b] = np.sqrt(twice * soft) if yields else soft
    summed = np.concatenate(parts, axis=1)
    if yields:
        return summed + np.sqrt(twice / factor) * moves.sum(axis=0)
    return np.sqrt(twice * (summed + np.square(moves).sum(axis=0) / factor))


@np.errstate(over="ignore", invalid="ignore")  # the numbers of a diverged scenario, which are not reported
def variables_of(
    kernel: RowKernel,
    raw: Mapping[str, np.ndarray],
    outputs: Sequence[str],
    record: Record,
    variants: Variants | None = None,
) -> dict[str, np.ndarray]:
    """Turn a kernel's outputs into the variables of the cube."""
    row = variants_of(kernel.scene) if variants is None else variants
    raw = {name: np.asfortranarray(values) for name, values in raw.items()}  # scenarios side by side: see `scatter`
    step = record.dt / kernel.numerics.steps(record)
    stored = KernelResults(kernel.scene, raw, row, step, kernel.initial_velocity)
    result = {name: VARIABLES[name].read(stored) for name in cube_variables(outputs)}
    for name, values in result.items() if kernel.law.impulsive else ():
        if VARIABLES[name].of_force:  # where velocities jump, kernels leave a mark instead of a force
            result[name] = np.where(values > 0.0, np.nan, values)
    result["status"] = _status(kernel, raw, stored.steps_by_law, record, row)
    return result


def _status(
    kernel: RowKernel, raw: Mapping[str, np.ndarray], steps: np.ndarray, record: Record, row: Variants
) -> np.ndarray:
    from pounding_sweep.kernel.collapse import FLAG_BLURRED, FLAG_COLLAPSED
    from pounding_sweep.kernel.march import FLAG_DIVERGED, FLAG_FALLBACK, FLAG_UNSOLVED

    numerics, flags = kernel.numerics, raw["flags"][:, 0].astype(int)
    status = np.full(len(flags), Status.OK, np.int8)
    if not kernel.shape.stepless:
        blurred = (phase_error(row, record, numerics) > MAX_PHASE_ERROR) | loses_ground(record, numerics)
        if kernel.shape.flies_exactly:  # what never touches has no error of a step
            blurred = blurred & np.isfinite(steps).any(axis=1)
        status[np.broadcast_to(blurred, status.shape)] = Status.UNDER_RESOLVED_MOTION
        fastest = np.fmin.reduce(steps / raw.get("quickening", 1.0), axis=1)
        needed = numerics.scheme.min_steps_located if numerics.locate else numerics.scheme.min_steps_sampled
        status[fastest < needed] = Status.UNDER_RESOLVED_CONTACT
    touching = kernel.shape.law is not None  # else it is storeys that yield too often within a step
    status[flags & FLAG_FALLBACK > 0] = Status.UNDER_RESOLVED_CONTACT if touching else Status.UNDER_RESOLVED_MOTION
    status[flags & FLAG_UNSOLVED > 0] = Status.NEWTON_NOT_CONVERGED
    status[flags & (FLAG_DIVERGED | FLAG_BLURRED) > 0] = Status.DIVERGED
    if "umax" in raw:  # farther than the energy that the ground can bring in allows
        energy = MAX_ENERGY * energy_limit(row, record, raw["scale"][:, 0], kernel.initial_velocity)
        limit = displacement_limit(row, energy)
        status[~np.all((raw["umax"] <= limit) & (-raw["umin"] <= limit), axis=1)] = Status.DIVERGED
    fell = flags & FLAG_COLLAPSED > 0
    status[fell] = np.where(status[fell] == Status.OK, Status.COLLAPSED, Status.DIVERGED)
    return status
