"""What the stability suite demands of a scenario, whatever it is: the judge.

Five things are demanded of a run, at any step:

1. It ends, within a bounded time, and with Newmark's method it stays bounded.
2. Its status tells the truth: a scenario with values has finite ones only, one
   without has none.
3. Its energy is possible. The ground can bring no more energy into a row than
   ``(sqrt(M) int |a_g| dt + sqrt(2 E_0))**2 / 2`` (M all masses, E_0 the energy at the start), because contacts and
   dampers only take energy; that bounds the energy at the end and every displacement, resolved or not.
4. Where the status is ok, contacts create no energy: their work is not negative.
5. Where the status is ok, and a run at half the step agrees within `SETTLED`,
   the peaks are within `OK_CLAIM` of those of a converged run, unless it is
   sensitive: `CHANGE` of all inputs changes a peak by more than that.

All ok scenarios that are farther off are counted as missed by the rules of the
status, whether half the step tells them or not and however sensitive they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pounding_sweep.accuracy.extreme_scenes import PEAKS, YIELDING_PEAKS, Batch, run_batch, stable_step, take
from pounding_sweep.engine.resolution import displacement_limit, energy_limit
from pounding_sweep.outputs.differences import CHANGE, relative_error
from pounding_sweep.outputs.readout import scatter_contact, scatter_dof
from pounding_sweep.outputs.variables import OK_CLAIM, SETTLED, STATUS, Status, get_variable
from pounding_sweep.schemes import SCHEMES

#: A reference run is believed where one of half the step agrees with it this closely.
CONVERGED = 0.1 * OK_CLAIM
#: Most energy that contacts may create in an ok scenario, relative to the largest energy of its balance.
CREATED_BOUND = 0.01
#: Most energy of a scenario, relative to what the ground can bring in: ok, and any other with values.
ENERGY_BOUND = {True: 1.01, False: 1.1}
#: Seconds that a run of a few scenarios may take.
TIME_LIMIT = 60.0
#: Longest reference run (steps of the record).
REFERENCE_STEPS = 4_000_000


@dataclass(frozen=True)
class Reference:
    """What the scenarios of a batch should find."""

    peaks: dict[str, np.ndarray]  # the peaks, shape (n, ...); NaN where there is no reference
    known: np.ndarray  # whether the reference converged; shape (n,)
    step: np.ndarray  # its time step (s); shape (n,)


@dataclass(frozen=True)
class BatchVerdict:
    """What the judge found of a batch in one scheme at one step; arrays of shape (n,)."""

    batch: Batch  # the scenarios
    #: scheme and number format
    method: str
    precision: str
    dt: float  # largest time step (s)
    status: np.ndarray  # status of each scenario
    error: np.ndarray  # largest relative error of a peak; NaN where it was not to be judged
    #: ok, but off by more than the claim; and those of them that half the step gives away
    missed: np.ndarray
    told: np.ndarray
    sensitive: np.ndarray  # missed, and sensitive
    unknown: np.ndarray  # ok, but without a converged reference
    created: np.ndarray  # energy created by contacts, relative to the largest of the balance
    energy: np.ndarray  # largest energy, over what the ground can have brought in
    seconds: float  # wall time of the run
    faults: list[tuple[int, str]]  # scenario and what is wrong with it


def peaks_of(found: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the judged peaks, those that are there; both displacements as one, so that the larger is the measure."""
    both = np.stack([found["displacement_max"], found["displacement_min"]], axis=1)
    return {"displacement_max": both, **{name: found[name] for name in (*PEAKS[2:], *YIELDING_PEAKS) if name in found}}


def peak_error(found: Mapping[str, np.ndarray], reference: Mapping[str, np.ndarray]) -> np.ndarray:
    """Largest relative error of the peaks of each scenario, shape (n,)."""
    return np.max([relative_error(name, found[name], reference[name]) for name in reference], axis=0)


def make_reference(batch: Batch, wanted: np.ndarray, shortest: np.ndarray) -> Reference:
    """Run scenarios at ever finer steps until half the step changes nothing that matters."""
    empty = peaks_of(run_batch(take(batch, np.zeros(0, int)), "rk4", batch.record.dt))
    peaks = {name: np.full((len(batch), *values.shape[1:]), np.nan) for name, values in empty.items()}
    known, steps = np.zeros(len(batch), bool), np.full(len(batch), np.nan)
    rows = np.flatnonzero(wanted)
    if not len(rows):
        return Reference(peaks, known, steps)
    lasted = float(shortest[rows].min())
    step = min(min(batch.steps) / 4.0, lasted / 40.0, float(stable_step(batch, "rk4")[rows].min()) / 4.0)
    coarse = run_batch(take(batch, rows), "rk4", step)
    while len(rows) and batch.record.duration / step <= REFERENCE_STEPS:
        step /= 2.0
        fine = run_batch(take(batch, rows), "rk4", step)
        both_ok = (fine["status"] == Status.OK) & (coarse["status"] == Status.OK)
        done = both_ok & (peak_error(peaks_of(coarse), peaks_of(fine)) <= CONVERGED)
        for name, values in peaks_of(fine).items():
            peaks[name][rows[done]] = values[done]
        known[rows[done]], steps[rows[done]] = True, step
        rows = rows[~done]
        coarse = {name: values[~done] for name, values in fine.items()}
    return Reference(peaks, known, steps)


def sensitive_rows(batch: Batch, reference: Reference, rows: np.ndarray) -> np.ndarray:
    """Whether a change of all inputs by `CHANGE` changes a peak of each of those scenarios by more than the claim."""
    if not len(rows):
        return np.zeros(0, bool)
    base, against = take(batch, rows), {name: values[rows] for name, values in reference.peaks.items()}
    step, sensitive = float(np.nanmin(reference.step[rows])), np.zeros(len(rows), bool)
    for change in (CHANGE, -CHANGE):  # a touch that is just missed comes with less gap, one that just is goes with more
        moved = replace(
            base,
            gaps=base.gaps * (1.0 + change),
            stiffness=base.stiffness * (1.0 + change),
            scale=base.scale * (1.0 - change),
        )
        sensitive |= peak_error(peaks_of(run_batch(moved, "rk4", step)), against) > OK_CLAIM
    return sensitive


def told_rows(
    batch: Batch, method: str, dt: float, precision: str, found: Mapping[str, np.ndarray], rows: np.ndarray
) -> np.ndarray:
    """Whether a run at half the step of each of those scenarios differs by more than `SETTLED`."""
    half = run_batch(take(batch, rows), method, dt / 2.0, precision, refinement=2.0)
    differs = peak_error(peaks_of({name: values[rows] for name, values in found.items()}), peaks_of(half)) > SETTLED
    return np.asarray(differs | (half["status"] != Status.OK))


def energy_share(batch: Batch, found: Mapping[str, np.ndarray]) -> np.ndarray:
    """Energy at the end, or as the displacements imply, over what the ground can have brought in, shape (n,)."""
    limit = energy_limit(batch.scene, batch.record, batch.scale, batch.initial_velocity)
    share = (found["energy_kinetic"] + found["energy_strain"]).sum(axis=1)
    yields = any(batch.scene.yields)  # beyond yielding a displacement grows up to like its energy, not like the root
    reach = scatter_dof(displacement_limit(batch.scene, limit if yields else np.ones(len(batch))), batch.scene)
    for name in ("displacement_max", "displacement_min"):
        part = np.abs(found[name]) / np.where(reach > 0.0, reach, 1e-300)
        implied = (limit[:, None, None] * part if yields else np.square(part)).reshape(len(batch), -1)
        share = np.maximum(share, np.max(np.nan_to_num(implied, nan=0.0, posinf=np.inf), axis=1))
    return np.where(share == 0.0, 0.0, share / np.where(limit > 0.0, limit, 1e-300))


def created_energy(found: Mapping[str, np.ndarray]) -> np.ndarray:
    """Energy that contacts created, over the largest energy of the balance, shape (n,)."""
    if found["contact_work"].shape[1] == 0:
        return np.zeros(len(found["status"]))
    work = found["contact_work"]
    size = np.max(
        [
            np.abs(found["energy_input"]).sum(axis=1),
            found["energy_damping"].sum(axis=1),
            (found["energy_kinetic"] + found["energy_strain"]).sum(axis=1),
            np.abs(work).sum(axis=1),
        ],
        axis=0,
    )
    return np.asarray(np.maximum(0.0, -work.min(axis=1)) / np.where(size > 0.0, size, 1.0))


def judge(
    batch: Batch,
    method: str,
    dt: float,
    found: Mapping[str, np.ndarray],
    reference: Reference,
    *,
    seconds: float = 0.0,
    precision: str = "float64",
) -> BatchVerdict:
    """Judge what a run of a batch found."""
    status = np.asarray(found["status"])
    ok = status == Status.OK
    faults: list[tuple[int, str]] = []

    def fault(rows: np.ndarray, text: str, values: np.ndarray | None = None) -> None:
        for row in np.flatnonzero(rows):
            faults.append((int(row), text if values is None else text.format(float(values[row]))))

    has_values = np.isin(status, [int(s) for s in STATUS if s.has_values])
    bad, numbers = np.zeros(len(batch), bool), np.zeros(len(batch), bool)
    for name, values in found.items():
        if name in ("status", "steps_per_contact") or (batch.law.impulsive and get_variable(name).of_force):
            continue
        flat = _only_real(batch, name, values)
        bad |= ~np.isfinite(flat).all(axis=1)
        numbers |= np.isfinite(flat).any(axis=1)
    fault(has_values & bad, "has values that are not finite")
    fault(~has_values & numbers, "has no result by its status, but finite values")
    fault(status == Status.NOT_RUN, "was not run")
    fault((status == Status.DIVERGED) & SCHEMES[method].implicit, "diverged, though its contact is implicit")
    sound = has_values & ~bad
    with np.errstate(invalid="ignore", over="ignore"):
        created = np.where(sound, created_energy(found), 0.0)
        share = np.where(sound, energy_share(batch, found), 0.0)
    fault(ok & (created > CREATED_BOUND), "its contacts created energy: {:.3g} of the balance", created)
    for is_ok, bound in ENERGY_BOUND.items():
        fault((ok == is_ok) & (share > bound), "holds {:.4g} times the energy that can have come in", share)
    judged = ok & sound & reference.known
    error = np.where(judged, peak_error(peaks_of(found), reference.peaks), np.nan)
    beyond = judged & (error > OK_CLAIM)
    sensitive, told = np.zeros(len(batch), bool), np.zeros(len(batch), bool)
    rows = np.flatnonzero(beyond)
    if len(rows):
        sensitive[rows] = sensitive_rows(batch, reference, rows)
        told[rows] = told_rows(batch, method, dt, precision, found, rows)
    fault(
        beyond & ~told & ~sensitive,
        f"is ok at half the step too, but a peak is off by {{:.3g}} (claim {OK_CLAIM:g})",
        error,
    )
    if seconds > TIME_LIMIT:
        faults.append((0, f"took {seconds:.0f} s"))
    unknown = ok & sound & ~reference.known
    return BatchVerdict(
        batch, method, precision, dt, status, error, beyond, told, sensitive, unknown, created, share, seconds, faults
    )


def _only_real(batch: Batch, name: str, values: np.ndarray) -> np.ndarray:
    """Values of what exists: without walls, missing storeys and floors that meet nothing; shape (n, values)."""
    dims = get_variable(name).dims
    scene = batch.scene
    if dims == ("building", "storey"):
        exists = np.where(scene.yields, 0.0, np.nan) if name in YIELDING_PEAKS else np.zeros(scene.n_dof)
        there = np.isfinite(scatter_dof(exists[None], scene))[0]
    elif dims == ("pair", "storey"):
        there = np.isfinite(scatter_contact(np.zeros((1, len(scene.contacts))), scene))[0]
    else:
        there = np.ones(values.shape[1:], bool)
    return values[:, there]
