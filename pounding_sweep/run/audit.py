"""The audit: a sample of a sweep's own scenarios run again at half the step.

A cube then carries the error of its own numbers, by measurement. The sample
is drawn by a generator that the sweep's digest seeds, so that the same sweep
has the same audit, whoever runs it and however often it was interrupted.

Each group of lanes holds scenarios at half the step, and the same ones with gaps,
contact stiffness and ground motion changed by `CHANGE`. Where such a change,
below any engineering meaning, changes an output by more than the error looked for, the
scenario is called sensitive; its error counts all the same. A scenario whose error is
beyond what was asked is run once more, in double precision and at ever finer steps:
that tells its error whatever the number format was. Only where these runs settle on no
answer is it set apart, as undecided.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from pounding_sweep.engine.row_kernel import RowKernel
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.output.dataset import stored_as
from pounding_sweep.output.labels import row_coordinates
from pounding_sweep.outputs.differences import CHANGE, comparable, relative_errors
from pounding_sweep.outputs.variables import STATUS, Status
from pounding_sweep.plan.chunks import ChunkTask
from pounding_sweep.plan.plan import REFINED
from pounding_sweep.plan.scenarios import BLOCK, changed, joined
from pounding_sweep.run.pool import Dispatcher
from pounding_sweep.run.refinement import ended, halved

if TYPE_CHECKING:
    import xarray as xr

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
#: Tasks that the sample is cut into, and most lane groups of one.
BATCHES, LARGEST_BATCH = 8, 64
#: Estimated duration (s) of a task below which it is not worth one of its own.
BATCH_SECONDS = 0.1
#: How the flags are spelt in a cube.
FLAGS = {
    "audit_sensitive": {"flag_values": np.array([0, 1], np.int8), "flag_meanings": "steady sensitive"},
    "audit_undecided": {"flag_values": np.array([0, 1], np.int8), "flag_meanings": "decided undecided"},
}


@dataclass(frozen=True)
class Rerun:
    """Scenarios of one law, record and step that are run again together."""

    rows: np.ndarray  # rows of the plan's unique scenarios; int
    law: int  # index of the law
    record: int  # and of the record
    steps: int  # per record interval, with which the scenarios ended in the sweep
    begun: int  # with which they began

    def cost(self, plan: Plan) -> int:
        """Lane-steps of a lane group of it, filled or not."""
        times = FINER if plan.spec.accuracy is None else FINER * ENDS
        return LANES * times * self.steps * (plan.spec.records[self.record].n_points - 1)


@dataclass(frozen=True)
class Audit:
    """Measured errors of a sample of scenarios.

    Attributes
    ----------
    rows : ndarray of int, shape (n,)
        Rows of the plan's unique scenarios, rising.
    outputs : tuple of str
        Outputs that have an error.
    error, sensitivity : ndarray, shape (n, outputs)
        Relative difference to half the step, and relative change by the perturbation.
    status : ndarray of int, shape (n,)
        How the scenario ended in the sweep.
    sensitive : ndarray of bool, shape (n,)
        Where the perturbation changes an output by more than the tolerance, or a number of impacts.
    undecided : ndarray of bool, shape (n,)
        Beyond the tolerance, and no step settles it in double precision.
    touching : int
        Touching scenarios of the sweep that the sample was drawn from.
    share : float
        Cost over that of the touching scenarios in the sweep, in lane-steps.
    tolerance : float
        Error that was asked for, or `TOLERANCE`.
    """

    rows: np.ndarray
    outputs: tuple[str, ...]
    error: np.ndarray
    sensitivity: np.ndarray
    status: np.ndarray
    sensitive: np.ndarray
    undecided: np.ndarray
    touching: int
    share: float
    tolerance: float

    @property
    def exceeding(self) -> np.ndarray:
        """Scenarios with status ok, not undecided, whose error is beyond the tolerance."""
        return ~self.undecided & (self.status == Status.OK) & (self.error.max(axis=1) > self.tolerance)


def candidates(plan: Plan, outcome: Outcome) -> np.ndarray:
    """Rows of the unique scenarios that touched and have values."""
    if outcome.left_out is None:
        return np.zeros(0, dtype=int)
    # nothing here takes more than a byte for each of what may be many millions
    found = outcome.results.touched & ~outcome.left_out
    for index, law in enumerate(plan.laws):
        if law.impulsive:
            found |= (plan.unique.law == index) & ~outcome.left_out
    for status in STATUS:
        if not status.has_values:
            found &= outcome.results.status != int(status)
    return np.flatnonzero(found).astype(np.int32)


def sweep_cost(plan: Plan, rows: np.ndarray) -> int:
    """Lane-steps of the scenarios `rows` in the sweep."""
    points = np.array([record.n_points - 1 for record in plan.spec.records])
    times = 1 if plan.spec.accuracy is None else REFINED
    blocks = (rows[first : first + BLOCK] for first in range(0, len(rows), BLOCK))
    return times * sum(int((plan.steps[some] * points[plan.unique.record[some]]).sum()) for some in blocks)


def draw(plan: Plan, rows: np.ndarray) -> list[Rerun]:
    """Draw the groups of an audit."""
    if not len(rows) or plan.spec.audit <= 0.0:
        return []
    random = np.random.Generator(np.random.PCG64(int(plan.digest[:16], 16)))
    table = plan.unique
    kinds = np.zeros(1, np.int64)
    for column in (table.record, table.law, plan.steps):
        if column.strides[0]:  # else one value for all
            own = column[rows]
            kinds = kinds * (int(own.max()) + 1) + own
    alike, weights = [], []
    for kind in np.unique(kinds):
        own = rows if len(kinds) == 1 else rows[kinds == kind]
        mine = random.permutation(own)[:MOST]
        steps = int(plan.steps[mine[0]])
        alike.append(Rerun(mine, int(table.law[mine[0]]), int(table.record[mine[0]]), steps, steps))
        each = np.full(-(-len(mine) // GROUP), GROUP)  # groups by their sizes, each for its share of the kind
        each[-1] = (len(mine) - 1) % GROUP + 1
        weights.append(each * (len(own) / len(mine)))
    first = np.cumsum([0, *map(len, weights)])
    costs = np.repeat([part.cost(plan) for part in alike], np.diff(first))
    sizes = np.concatenate(weights)
    order = random.choice(len(sizes), size=len(sizes), replace=False, p=sizes / sizes.sum())
    left, budget = min(MOST, max(1, len(rows) // 2)), plan.spec.audit * sweep_cost(plan, rows)
    cheapest = costs.min()
    affordable = order[costs[order] <= budget] if cheapest <= budget else order[:1]
    chosen: list[Rerun] = []
    for index in affordable:
        if chosen and (not left or budget < cheapest):
            break
        if not chosen or costs[index] <= budget:
            kind = int(np.searchsorted(first, index, "right")) - 1
            begin = GROUP * int(index - first[kind])
            group = alike[kind].rows[begin : begin + GROUP]
            chosen.append(replace(alike[kind], rows=np.sort(group[:left])))
            left -= len(chosen[-1].rows)
            budget -= costs[index]
    return chosen


def audit(plan: Plan, outcome: Outcome, dispatcher: Dispatcher) -> Audit | None:
    """Run a sample of a sweep's scenarios again at half the step.

    Parameters
    ----------
    plan : Plan
        The sweep.
    outcome : Outcome
        Its results. The kernels are those that it compiled.
    dispatcher : Dispatcher
        Open; its workers run the sample.

    Returns
    -------
    Audit or None
        None where nothing touched, nothing has an error, or the sweep wants no audit.

    Warns
    -----
    RuntimeWarning
        An ok scenario's error is beyond what was asked for (5 % where nothing was), or the sample could not be run.
    """
    outputs = comparable(plan.spec.outputs)
    rows = candidates(plan, outcome)
    samples = draw(plan, rows) if outputs else []
    if not samples:
        return None
    tolerance = TOLERANCE if plan.spec.accuracy is None else plan.spec.accuracy
    share = sum(sample.cost(plan) for sample in samples) / sweep_cost(plan, rows)
    where = np.sort(np.concatenate([sample.rows for sample in samples]))
    own = outcome.results.gather(where)
    pair = _run(plan, dispatcher, outputs, where, own)
    if pair is None:
        return None
    fine, moved = pair
    error = _table(relative_errors(outputs, own, fine))
    sensitivity = _table(relative_errors(outputs, moved, fine))
    sensitive = _counts_differ(moved, fine) | (sensitivity.max(axis=1) > tolerance)
    undecided = np.zeros(len(where), bool)
    again = np.flatnonzero((own["status"] == Status.OK) & (error.max(axis=1) > tolerance))
    if len(again):
        some = {name: values[again] for name, values in own.items()}
        settled = _run(plan, dispatcher, outputs, where[again], some, accuracy=CONVERGED * tolerance)
        if settled is None:
            return None
        error[again] = _table(relative_errors(outputs, some, settled[0]))
        undecided[again] = settled[0]["status"] != Status.OK
    result = Audit(where, outputs, error, sensitivity, own["status"], sensitive, undecided, len(rows), share, tolerance)
    _warn(plan, result)
    return result


def _run(
    plan: Plan,
    dispatcher: Dispatcher,
    outputs: Sequence[str],
    rows: np.ndarray,
    own: dict[str, np.ndarray],
    accuracy: float | None = None,
) -> list[dict[str, np.ndarray]] | None:
    """Run scenarios at half the step, as they are and with all inputs changed, or in double precision to an accuracy.

    Returns the results in the order of their rows; None, with a warning, if some could not be run.
    """
    batches = _batches(plan, rows, own)
    measured: list[tuple[np.ndarray, np.ndarray]] = []
    failures: list[str] = []

    def task_of(position: int) -> ChunkTask:
        batch = batches[position]
        kernel, table = replace(_kernel_of(plan, batch), accuracy=None), plan.unique[batch.rows]
        if accuracy is None:
            table = joined([table, changed(table)])
        else:
            kernel = replace(kernel.in_double, accuracy=accuracy)
        key = f"audit-{plan.digest[:32]}-{'halved' if accuracy is None else 'settled'}-{position}"
        return ChunkTask(key, kernel, batch.record, table, plan.variants[table.variant], tuple(outputs))

    def receive(position: int, found: np.ndarray | str) -> None:
        if isinstance(found, str):
            failures.append(found)
        else:
            mine = batches[position].rows
            measured.append((mine, found.reshape(-1, len(mine))))

    dispatcher.run(len(batches), task_of, receive)
    if failures:
        warnings.warn(
            f"the audit has no result: {failures[0]}. The cube has none; to have it audited again, run the sweep with "
            "that cube as the one to extend (--extend OUT.nc --overwrite), which takes all else from it",
            RuntimeWarning,
            stacklevel=4,
        )
        return None
    which, tables = (np.concatenate(part, axis=-1) for part in zip(*measured, strict=True))
    return [{name: table[name] for name in table.dtype.names or ()} for table in tables[:, np.argsort(which)]]


def _batches(plan: Plan, rows: np.ndarray, own: dict[str, np.ndarray]) -> list[Rerun]:
    """Put scenarios together that are of one law and record, and began and ended with the same step."""
    table, steps = plan.unique[rows], plan.steps[rows]
    if plan.spec.accuracy is not None:
        interval = np.array([record.dt for record in plan.spec.records])[table.record]
        steps = np.rint(interval / own["time_step"]).astype(int)
    kinds, which = np.unique(np.stack([table.law, table.record, steps, plan.steps[rows]]), axis=1, return_inverse=True)
    alike = [rows[which.ravel() == number] for number in range(kinds.shape[1])]
    groups = sum(-(-len(mine) // LANES) for mine in alike)
    batches = []
    for mine, kind in zip(alike, kinds.T.tolist(), strict=True):
        worth = int(BATCH_SECONDS / (LANES * plan.scenario_seconds(kind[1], FINER * kind[2])))
        most = LANES * max(min(LARGEST_BATCH, math.ceil(groups / BATCHES)), worth)
        batches += [Rerun(mine[i : i + most], *kind) for i in range(0, len(mine), most)]
    return batches


def _kernel_of(plan: Plan, sample: Rerun) -> RowKernel:
    """Return the kernel of a sample at half the step that it ended with, in the number format that it ended in."""
    record = plan.spec.records[sample.record]
    kernel = plan.kernel(sample.law, record=sample.record, steps=sample.begun)
    return halved(ended(kernel, record, sample.steps), record)


def _counts_differ(first: dict[str, np.ndarray], second: dict[str, np.ndarray]) -> np.ndarray:
    """Whether impacts were won or lost, where the sweep counts them."""
    n = len(first["status"])
    if "impact_count" not in first:
        return np.zeros(n, bool)
    return np.asarray((first["impact_count"] != second["impact_count"]).reshape(n, -1).any(axis=1))


def _table(errors: dict[str, np.ndarray]) -> np.ndarray:
    """One column per output."""
    return np.stack(list(errors.values()), axis=1)


def _warn(plan: Plan, found: Audit) -> None:
    exceeding = found.exceeding
    if not exceeding.any():
        return
    worst = np.where(exceeding[:, None], found.error, 0.0).max(axis=0)
    output = int(np.argmax(worst))
    asked = f"the {found.tolerance:g} asked for" if plan.spec.accuracy is not None else f"{found.tolerance:.0%}"
    remedy = "ask for a smaller accuracy" if plan.spec.accuracy is not None else "use a smaller dt"
    warnings.warn(
        f"the audit of {len(found.rows)} scenarios found {int(exceeding.sum())} with status ok whose error is beyond "
        f"{asked}, the worst {worst[output]:.2g} in {found.outputs[output]}; {remedy} (see audit_error in the cube)",
        RuntimeWarning,
        stacklevel=4,
    )


def add_to_cube(cube: xr.Dataset, plan: Plan, found: Audit) -> xr.Dataset:
    """Put an audit into a cube: dimensions ``audit`` and ``output``, and attributes on every output."""
    import xarray as xr

    table, rows = plan.unique[found.rows], ("audit",)
    dt = np.array([record.dt for record in plan.spec.records])[table.record] / plan.steps[found.rows]
    laws = [plan.laws[i].key for i in table.law.tolist()]
    records = [plan.spec.records[i].name for i in table.record.tolist()]
    sensitive = f"whether that is more than {found.tolerance:g}, or changes a number of impacts"
    data = {
        "audit_error": ((*rows, "output"), found.error, "relative error, by the difference to half the time step", "1"),
        "audit_sensitivity": ((*rows, "output"), found.sensitivity, f"relative change by a change of {CHANGE:g}", "1"),
        "audit_sensitive": (rows, found.sensitive.astype(np.int8), sensitive, "1"),
        "audit_undecided": (rows, found.undecided.astype(np.int8), "whether no step settles it", "1"),
        "audit_status": (rows, found.status.astype(np.int8), "status of the scenario in the sweep", "1"),
    }
    coordinates = {
        "audit": (rows, np.arange(1, len(laws) + 1, dtype=np.int32), "scenario run again", "1"),
        "output": (("output",), np.array(found.outputs), "output whose error it is", ""),
        "audit_law": (rows, np.array(laws), "contact law", ""),
        "audit_record": (rows, np.array(records), "ground-motion record", ""),
        "audit_scale": (rows, table.scale, "factor on the record", "1"),
        "audit_stiffness": (rows, table.stiffness, "contact stiffness (kN/m**exponent of the law)", ""),
        "audit_restitution": (rows, table.restitution, "nominal coefficient of restitution, 1 for laws without", "1"),
        "audit_gap": ((*rows, "pair"), table.gaps[:, plan.spec.scene.pair_of_label], "gap of the pair", "m"),
        "audit_time_step": (rows, dt, "time step in the sweep", "s"),
    }
    if len(plan.variants) > 1:
        for name, (dims, values, about) in row_coordinates(plan.variants[table.variant], "audit", "audit_").items():
            coordinates[name] = (dims, values, about["long_name"], about["units"])

    result = cube.copy()
    for name, (dims, values, long_name, units) in (data | coordinates).items():
        stored = xr.Variable(dims, values, {"long_name": long_name, **({"units": units} if units else {})})
        stored.encoding = stored_as("", stored, is_coordinate=True)
        result[name] = stored
    result = result.set_coords(coordinates)
    flags = FLAGS | {"audit_status": {key: cube["status"].attrs[key] for key in ("flag_values", "flag_meanings")}}
    for name, attributes in flags.items():
        result[name].attrs |= attributes
    decided = ~found.undecided
    for i, name in enumerate(found.outputs):
        if decided.any() and name in result:
            errors = found.error[decided, i]
            result[name].attrs |= {
                "audit_error_max": float(errors.max()),
                "audit_error_median": float(np.median(errors)),
            }
    return result.assign_attrs(
        audit_scenarios=len(laws),
        audit_touching=found.touching,
        audit_share=found.share,
        audit_perturbation=CHANGE,
        audit_undecided_share=float(found.undecided.mean()),
    )
