"""The audit: a sample of a sweep's own scenarios run again at half the step.

The sweep's digest seeds the sample, so the same sweep has the same audit. Scenarios run at half the step and again with
gaps, contact stiffness and ground motion changed by `CHANGE`: a scenario is sensitive if that changes an output by more
than the tolerance. One whose error is beyond the tolerance runs once more, in double precision and at ever finer steps;
it is undecided if these runs do not settle.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from pounding_sweep.base.errors import RunError
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.output.audited import add_audit
from pounding_sweep.output.dataset import Coordinates, CubeParts, unit_attributes
from pounding_sweep.output.labels import listed_coordinates
from pounding_sweep.outputs.variables import CHANGE, VARIABLES, WITH_VALUES, Status, relative_errors
from pounding_sweep.plan.plan import CHUNK_BYTES, REFINED
from pounding_sweep.plan.scenarios import Chunk, ChunkTask, changed, cut, joined, row_codes
from pounding_sweep.run.execute import Dispatcher
from pounding_sweep.run.refinement import Values, ended, halved

if TYPE_CHECKING:
    from pounding_sweep.output.results import Outcome
    from pounding_sweep.plan.plan import Plan

#: Scenarios of one lane group, which is run twice.
GROUP = LANES // 2
#: Most scenarios of an audit: with them, 19 of 20 audits hold one of a kind that one scenario in 700 is of.
MOST = 2048
#: Steps of the audit in one step of the sweep.
FINER = 2
#: Steps that most scenarios end with, over those that they begin with, where they are refined for an accuracy.
ENDS = 2
#: Error of an ok scenario beyond which a warning is given, where the sweep asked for none.
TOLERANCE = 0.05
#: Share of the tolerance within which the runs agree that tell the error of a scenario beyond it.
CONVERGED = 0.25
#: Estimated duration (s) of the longest chunk of the sample; the last ones are a quarter of it.
LONGEST_CHUNK = 0.4


@dataclass(frozen=True)
class Audit:
    """Measured errors of a sample of scenarios, the arrays of shape (n,) or (n, outputs)."""

    rows: np.ndarray  # of the plan's unique scenarios, rising
    outputs: tuple[str, ...]  # that have an error
    error: np.ndarray  # relative difference to half the step
    sensitivity: np.ndarray  # relative change by the perturbation
    status: np.ndarray  # how the scenario ended in the sweep
    sensitive: np.ndarray  # whether the perturbation changes an output beyond the tolerance, or a number of impacts
    undecided: np.ndarray  # whether it is beyond the tolerance and no step settles it in double precision
    touching: int  # scenarios of the sweep that the sample was drawn from
    share: float  # cost over that of the touching scenarios in the sweep, in lane-steps
    tolerance: float  # error that was asked for, or `TOLERANCE`

    @property
    def exceeding(self) -> np.ndarray:
        """Scenarios with status ok, not undecided, whose error is beyond the tolerance."""
        return ~self.undecided & (self.status == Status.OK) & (self.error.max(axis=1) > self.tolerance)

    @property
    def warning(self) -> str:
        """What is said where there are such scenarios."""
        worst = self.error[self.exceeding].max(axis=0)
        return (
            f"the audit of {len(self.rows)} scenarios found {int(self.exceeding.sum())} with status ok whose error is "
            f"beyond {self.tolerance:g}, the worst {worst.max():.2g} in {self.outputs[int(worst.argmax())]}; use a "
            "smaller dt, or ask for a smaller accuracy (see audit_error in the cube)"
        )


def candidates(plan: Plan, outcome: Outcome) -> np.ndarray:
    """Rows of the unique scenarios that touched and have values."""
    jumps = [index for index, law in enumerate(plan.laws) if law.impulsive]
    touched = outcome.results.touched | np.isin(plan.unique.law, jumps)
    return np.flatnonzero(touched & ~outcome.left_out & np.isin(outcome.results.status, WITH_VALUES)).astype(np.int32)


def draw(plan: Plan, rows: np.ndarray) -> tuple[np.ndarray, float]:
    """Draw the scenarios of an audit from `rows`; returns them, rising, and what they cost over all `rows`."""
    if not len(rows) or plan.spec.audit <= 0.0:
        return rows[:0], 0.0
    table, is_refined = plan.unique, plan.spec.accuracy is not None
    lengths = plan.steps * np.array([record.n_points - 1 for record in plan.spec.records])[table.record]
    whole = (REFINED if is_refined else 1) * int(lengths[rows].sum())
    # lane groups of scenarios of one record, law and number of steps
    random = np.random.Generator(np.random.PCG64(int(plan.digest[:16], 16)))
    rows = random.permutation(rows)
    kinds = row_codes([column[rows] for column in (table.record, table.law, plan.steps)])
    order = np.argsort(kinds, kind="stable")
    rows, kinds = rows[order], kinds[order]
    begins = np.searchsorted(kinds, kinds)  # where the kind of a scenario begins
    starts = np.flatnonzero((np.arange(len(rows)) - begins) % GROUP == 0)
    sizes = np.diff([*starts, len(rows)])
    costs = LANES * FINER * (ENDS if is_refined else 1) * lengths[rows[starts]]
    # groups in random order, each as likely as it is large, as far as their costs go
    order = np.argsort(random.exponential(size=len(starts)) / sizes)
    spent, most = np.cumsum(costs[order]), min(MOST, max(1, len(rows) // 2))
    enough = int(np.searchsorted(np.cumsum(sizes[order]), most)) + 1
    count = max(1, min(enough, int(np.searchsorted(spent, plan.spec.audit * whole, "right"))))
    groups = np.split(rows, starts[1:])
    sample = np.concatenate([groups[index] for index in order[:count]])[:most]
    return np.sort(sample), float(spent[count - 1] / whole)


def audit(plan: Plan, outcome: Outcome, dispatcher: Dispatcher) -> Audit | None:
    """Run a sample of a sweep's scenarios again at half the step; warns of errors beyond what was asked for."""
    rows, accuracy = candidates(plan, outcome), plan.spec.accuracy
    outputs = tuple(name for name in plan.spec.outputs if VARIABLES[name].error)
    sample, share = draw(plan, rows) if outputs else (rows[:0], 0.0)
    if not len(sample):
        return None
    tolerance = TOLERANCE if accuracy is None else accuracy
    swept, undecided = outcome.results.gather(sample), np.zeros(len(sample), bool)
    try:
        fine, moved = _run(plan, dispatcher, outputs, sample, swept)
        error, sensitivity = (
            np.stack([*relative_errors(outputs, values, fine).values()], axis=1) for values in (swept, moved)
        )
        again = np.flatnonzero((swept["status"] == Status.OK) & (error.max(axis=1) > tolerance))
        if len(again):
            part = {name: values[again] for name, values in swept.items()}
            (settled,) = _run(plan, dispatcher, outputs, sample[again], part, accuracy=CONVERGED * tolerance)
            error[again] = np.stack([*relative_errors(outputs, part, settled).values()], axis=1)
            undecided[again] = settled["status"] != Status.OK
    except RunError as failure:
        warnings.warn(
            f"the audit has no result: {failure}. The cube has none; to have it audited again, run the sweep with "
            "that cube as the one to extend (--extend OUT.nc --overwrite), which takes all else from it",
            RuntimeWarning,
            stacklevel=3,
        )
        return None
    sensitive = sensitivity.max(axis=1) > tolerance
    if "impact_count" in fine:  # impacts that are won or lost
        sensitive |= (moved["impact_count"] != fine["impact_count"]).reshape(len(sample), -1).any(axis=1)
    measured = error, sensitivity, swept["status"], sensitive, undecided
    result = Audit(sample, outputs, *measured, len(rows), share, tolerance)
    if len(again) and result.exceeding.any():
        warnings.warn(result.warning, RuntimeWarning, stacklevel=3)
    return result


def _run(
    plan: Plan,
    dispatcher: Dispatcher,
    outputs: tuple[str, ...],
    rows: np.ndarray,
    swept: Values,
    accuracy: float | None = None,
) -> list[Values]:
    """Run scenarios at half the step, as they are and with all inputs changed, or in double precision to an accuracy.

    Returns the results in the order of their rows; raises `RunError` if some could not be run.
    """
    table, begun, records = plan.unique[rows], plan.steps[rows], plan.spec.records
    steps = begun
    if plan.spec.accuracy is not None:
        steps = np.rint(np.array([record.dt for record in records])[table.record] / swept["time_step"]).astype(int)
    chunks = cut(
        table,
        np.arange(len(rows)),
        steps,
        begun,
        name=f"audit:{plan.digest}:{accuracy}",
        longest=LONGEST_CHUNK,
        most=CHUNK_BYTES // plan.bytes_per_scenario,
        seconds=lambda record, count: plan.scenario_seconds(record, FINER * count),
    )

    def task_of(chunk: Chunk) -> ChunkTask:
        record, scenarios = records[chunk.record], table[chunk.rows]
        kernel = plan.kernel(chunk.law, record=chunk.record, steps=int(begun[chunk.rows[0]]))
        kernel = halved(ended(kernel, record, chunk.steps), record)
        if accuracy is None:
            scenarios = joined([scenarios, changed(scenarios)])
        else:
            kernel = kernel.in_double
        kernel = replace(kernel, accuracy=accuracy)
        return ChunkTask(kernel, record, scenarios, plan.variants[scenarios.variant], outputs)

    order, tables = [], []
    for chunk, result in dispatcher.run(chunks, task_of):
        if isinstance(result, str):
            raise RunError(result)
        order.append(chunk.rows)
        tables.append(result.reshape(-1, len(chunk.rows)))
    whole = np.concatenate(tables, axis=1)[:, np.argsort(np.concatenate(order))]
    return [{name: part[name] for name in part.dtype.names or ()} for part in whole]


def add_to_cube(cube: CubeParts, plan: Plan, result: Audit) -> None:
    """Put an audit into a cube: dimensions ``audit`` and ``output``, attributes on every output."""
    rows, both = ("audit",), ("audit", "output")
    dt = np.array([record.dt for record in plan.spec.records])[plan.unique.record[result.rows]]
    sensitive = f"whether that is more than {result.tolerance:g}, or changes a number of impacts"
    arrays = {
        "audit_error": (both, result.error, "relative error, by the difference to half the time step", "1"),
        "audit_sensitivity": (both, result.sensitivity, f"relative change by a change of {CHANGE:g}", "1"),
        "audit_sensitive": (rows, result.sensitive.astype(np.int8), sensitive, "1"),
        "audit_undecided": (rows, result.undecided.astype(np.int8), "whether no step settles it", "1"),
        "audit_status": (rows, result.status.astype(np.int8), "status of the scenario in the sweep", "1"),
        "audit": (rows, np.arange(1, len(dt) + 1, dtype=np.int32), "scenario run again", "1"),
        "output": (("output",), np.array(result.outputs), "output whose error it is", ""),
        "audit_time_step": (rows, dt / plan.steps[result.rows], "time step in the sweep", "s"),
    }
    described: Coordinates = {
        name: (dims, values, {"long_name": text, **unit_attributes(units)})
        for name, (dims, values, text, units) in arrays.items()
    }
    described |= listed_coordinates(plan, result.rows, "audit", "audit_")
    status, flags = cube.data_vars["status"][2], {"flag_values": np.array([0, 1], np.int8)}
    described["audit_sensitive"][2].update(flags, flag_meanings="steady sensitive")
    described["audit_undecided"][2].update(flags, flag_meanings="decided undecided")
    described["audit_status"][2].update({key: status[key] for key in ("flag_values", "flag_meanings")})
    add_audit(cube, described, result.touching, result.share)
