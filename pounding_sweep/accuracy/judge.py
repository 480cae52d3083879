"""What the stability suite demands of a scenario, whatever it is: the judge.

Five things are demanded of a run, at any step:

1. It ends, within a bounded time, and with Newmark's method it stays bounded.
2. Its status tells the truth: a scenario with values has finite ones only, one without has none.
3. Its energy is possible. The ground can bring no more energy into a row than
   ``(sqrt(M) int |a_g| dt + sqrt(2 E_0))**2 / 2`` (M all masses, E_0 the energy at the start), because contacts and
   dampers only take energy; that bounds the energy at the end and every displacement, resolved or not.
4. Where the status is ok, contacts create no energy: their work is not negative.
5. Where the status is ok, and a run at half the step agrees within `SETTLED`, the peaks are within `OK_CLAIM` of those
   of a converged run, unless it is sensitive: `CHANGE` of all inputs changes a peak by more than that.

All ok scenarios that are farther off are counted as missed by the rules of the status, whether half the step tells them
or not and however sensitive they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pounding_sweep.accuracy.extreme_scenes import PEAKS, YIELDING_PEAKS, Batch
from pounding_sweep.engine.postprocess import displacement_limit, energy_limit
from pounding_sweep.outputs.variables import (
    CHANGE,
    OK_CLAIM,
    SETTLED,
    STATUS,
    Status,
    get_variable,
    relative_error,
    scatter_contact,
    scatter_dof,
)
from pounding_sweep.plan.scenarios import changed
from pounding_sweep.run.refinement import Values
from pounding_sweep.schemes import SCHEMES

#: A reference run is believed where one of half the step agrees with it this closely.
CONVERGED = 0.1 * OK_CLAIM
#: Most energy that contacts may create in an ok scenario, relative to the largest energy of its balance.
CREATED_BOUND = 0.01
#: Most energy of a scenario, relative to what the ground can bring in: ok, and any other with values.
ENERGY_BOUND = {True: 1.01, False: 1.1}
#: Seconds of CPU time that a run of a few scenarios may take.
TIME_LIMIT = 60.0
#: Longest reference run (steps of the record).
REFERENCE_STEPS = 4_000_000


@dataclass(frozen=True)
class Reference:
    """What the scenarios of a batch should give."""

    peaks: dict[str, np.ndarray]  # the peaks, shape (n, ...); NaN where there is no reference
    known: np.ndarray  # whether the reference converged; shape (n,)
    step: np.ndarray  # its time step (s); shape (n,)


@dataclass(frozen=True)
class Run:
    """What a batch gave in one scheme at one step."""

    batch: Batch
    method: str
    dt: float  # largest time step (s)
    values: Values
    precision: str = "float64"
    seconds: float = 0.0  # CPU time

    @property
    def status(self) -> np.ndarray:
        """Status of each scenario."""
        return self.values["status"]


@dataclass(frozen=True)
class Verdict:
    """What the judge found in a run; arrays of shape (n,)."""

    run: Run
    error: np.ndarray  # largest relative error of a peak; NaN where it was not to be judged
    #: ok, but off by more than the claim; those of them that half the step gives away, and that are sensitive
    missed: np.ndarray
    told: np.ndarray
    sensitive: np.ndarray
    unknown: np.ndarray  # ok, but without a converged reference
    created: np.ndarray  # energy created by contacts, relative to the largest of the balance
    energy: np.ndarray  # largest energy, over what the ground can have brought in
    faults: list[tuple[int, str]]  # scenario and what is wrong with it


def peaks_of(values: Mapping[str, np.ndarray]) -> Values:
    """Return the judged peaks, those that are there; both displacements as one, so that the larger is the measure."""
    both = np.stack([values["displacement_max"], values["displacement_min"]], axis=1)
    names = (name for name in (*PEAKS[2:], *YIELDING_PEAKS) if name in values)
    return {"displacement_max": both, **{name: values[name] for name in names}}


def peak_error(peaks: Mapping[str, np.ndarray], reference: Mapping[str, np.ndarray]) -> np.ndarray:
    """Largest relative error of the peaks of each scenario, shape (n,)."""
    return np.max([relative_error(name, peaks[name], reference[name]) for name in reference], axis=0)


def make_reference(batch: Batch, wanted: np.ndarray, shortest: np.ndarray) -> Reference:
    """Run scenarios by RK4 at ever finer steps until half the step changes nothing that matters.

    `shortest` contact (s) of each scenario.
    """
    known, steps, rows = np.zeros(len(batch), bool), np.full(len(batch), np.nan), np.flatnonzero(wanted)
    step = batch.record.dt
    if len(rows):
        step = min(min(batch.steps) / 4.0, shortest[rows].min() / 40.0, batch.stable_step("rk4")[rows].min() / 4.0)
    coarse = batch[rows].run("rk4", step)
    peaks = {name: np.full((len(batch), *each.shape[1:]), np.nan) for name, each in peaks_of(coarse).items()}
    while len(rows) and batch.record.duration / step <= REFERENCE_STEPS:
        step /= 2.0
        fine = batch[rows].run("rk4", step)
        done = (fine["status"] == Status.OK) & (coarse["status"] == Status.OK)
        done &= peak_error(peaks_of(coarse), peaks_of(fine)) <= CONVERGED
        for name, values in peaks_of(fine).items():
            peaks[name][rows[done]] = values[done]
        known[rows[done]], steps[rows[done]] = True, step
        rows, coarse = rows[~done], {name: values[~done] for name, values in fine.items()}
    return Reference(peaks, known, steps)


def sensitive_rows(batch: Batch, reference: Reference, rows: np.ndarray) -> np.ndarray:
    """Whether a change of all inputs by `CHANGE` changes a peak of each of those scenarios by more than the claim."""
    sensitive = np.zeros(len(rows), bool)
    against = {name: values[rows] for name, values in reference.peaks.items()}
    for change in (CHANGE, -CHANGE) if len(rows) else ():  # a touch that just comes goes with more gap, and the reverse
        moved = replace(batch, table=changed(batch.table[rows], change))
        peaks = peaks_of(moved.run("rk4", float(np.nanmin(reference.step[rows]))))
        sensitive |= peak_error(peaks, against) > OK_CLAIM
    return sensitive


def told_rows(run: Run, rows: np.ndarray) -> np.ndarray:
    """Whether a run at half the step of each of those scenarios differs by more than `SETTLED`."""
    half = run.batch[rows].run(run.method, run.dt / 2.0, run.precision, refinement=2.0)
    whole = {name: values[rows] for name, values in run.values.items()}
    return (peak_error(peaks_of(whole), peaks_of(half)) > SETTLED) | (half["status"] != Status.OK)


def energy_share(batch: Batch, values: Mapping[str, np.ndarray]) -> np.ndarray:
    """Energy at the end, or as the displacements imply, over what the ground can have brought in, shape (n,)."""
    limit = energy_limit(batch.scene, batch.record, batch.table.scale, batch.initial_velocity)
    share = (values["energy_kinetic"] + values["energy_strain"]).sum(axis=1)
    yields = any(batch.scene.yields)  # beyond yielding a displacement grows up to like its energy, not like the root
    reach = scatter_dof(displacement_limit(batch.scene, limit if yields else np.ones(len(batch))), batch.scene)
    for name in ("displacement_max", "displacement_min"):
        part = np.abs(values[name]) / np.where(reach > 0.0, reach, 1e-300)
        implied = (limit[:, None, None] * part if yields else np.square(part)).reshape(len(batch), -1)
        share = np.maximum(share, np.max(np.nan_to_num(implied, nan=0.0, posinf=np.inf), axis=1))
    return np.where(share == 0.0, 0.0, share / np.where(limit > 0.0, limit, 1e-300))


def created_energy(values: Mapping[str, np.ndarray]) -> np.ndarray:
    """Energy that contacts created, over the largest energy of the balance, shape (n,)."""
    work = values["contact_work"]
    gained = values["energy_kinetic"] + values["energy_strain"]
    parts = [np.abs(values["energy_input"]), values["energy_damping"], gained, np.abs(work)]
    size = np.max([part.sum(axis=1) for part in parts], axis=0)
    return np.asarray(np.abs(work.min(axis=1, initial=0.0)) / np.where(size > 0.0, size, 1.0))


def judge(run: Run, reference: Reference) -> Verdict:
    """Judge what a run of a batch gave."""
    batch, values, status = run.batch, run.values, run.status
    ok, has_values = status == Status.OK, np.isin(status, [int(s) for s in STATUS if s.has_values])
    finite, empty = np.ones(len(batch), bool), np.ones(len(batch), bool)
    for name in values:
        if name not in ("status", "steps_per_contact") and not (batch.law.impulsive and get_variable(name).of_force):
            found = np.isfinite(values[name][:, _exists(batch, name, values[name])])
            finite &= found.all(axis=1)
            empty &= ~found.any(axis=1)
    sound = has_values & finite
    with np.errstate(invalid="ignore", over="ignore"):
        created = np.where(sound, created_energy(values), 0.0)
        share = np.where(sound, energy_share(batch, values), 0.0)
    judged = ok & sound & reference.known
    error = np.where(judged, peak_error(peaks_of(values), reference.peaks), np.nan)
    missed = judged & (error > OK_CLAIM)
    sensitive, told = np.zeros(len(batch), bool), np.zeros(len(batch), bool)
    rows = np.flatnonzero(missed)
    if len(rows):
        sensitive[rows], told[rows] = sensitive_rows(batch, reference, rows), told_rows(run, rows)
    off = f"is ok at half the step too, but a peak is off by {{:.3g}} (claim {OK_CLAIM:g})"
    beyond = share > np.where(ok, ENERGY_BOUND[True], ENERGY_BOUND[False])
    demands = (
        (has_values & ~finite, "has values that are not finite", share),
        (~has_values & ~empty, "has no result by its status, but finite values", share),
        (status == Status.NOT_RUN, "was not run", share),
        ((status == Status.DIVERGED) & SCHEMES[run.method].implicit, "diverged, though its contact is implicit", share),
        (ok & (created > CREATED_BOUND), "its contacts created energy: {:.3g} of the balance", created),
        (beyond, "holds {:.4g} times the energy that can have come in", share),
        (missed & ~told & ~sensitive, off, error),
        ((np.arange(len(batch)) == 0) & (run.seconds > TIME_LIMIT), f"took {run.seconds:.0f} s", share),
    )
    faults = [(int(i), text.format(float(of[i]))) for rows, text, of in demands for i in np.flatnonzero(rows)]
    unknown = ok & sound & ~reference.known
    return Verdict(run, error, missed, told, sensitive, unknown, created, share, faults)


def _exists(batch: Batch, name: str, values: np.ndarray) -> np.ndarray:
    """Whether there is what a value is of, not so at walls, missing storeys and floors that meet nothing."""
    dims, scene = get_variable(name).dims, batch.scene
    if dims == ("building", "storey"):
        exists = np.where(scene.yields, 0.0, np.nan) if name in YIELDING_PEAKS else np.zeros(scene.n_dof)
        return np.isfinite(scatter_dof(exists[None], scene))[0]
    if dims == ("pair", "storey"):
        return np.isfinite(scatter_contact(np.zeros((1, len(scene.contacts))), scene))[0]
    return np.ones(values.shape[1:], bool)
