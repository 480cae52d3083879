"""The audit: scenarios of a sweep at a fixed step, compared with runs that are more exact.

A sweep by a scheme that steps all along is compared with exact flight in all of its scenarios where that costs little
beside the sweep; else a sample runs again at half the step, in double precision: a group of each law with its extreme
stiffnesses and smallest gap, and others at random. A scenario beyond the tolerance runs once more, at ever finer steps;
it is undecided if these do not settle. Sweeps whose scenarios have an ``error_estimate`` need none.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from pounding_sweep.base.errors import RunError
from pounding_sweep.engine.compile import compiling_seconds, missing_kernels
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.output.audited import add_audit
from pounding_sweep.output.dataset import Coordinates, CubeParts, unit_attributes
from pounding_sweep.output.labels import listed_coordinates
from pounding_sweep.plan.scenarios import Chunk, ChunkTask, row_codes
from pounding_sweep.run.execute import Dispatcher
from pounding_sweep.run.refinement import MOST_HALVINGS, halved
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.variables.registry import VARIABLES, WITH_VALUES, Status, relative_errors

if TYPE_CHECKING:
    from pounding_sweep.output.results import Outcome
    from pounding_sweep.plan.plan import Plan

#: Most scenarios of a sample, and most that are compared where all are.
MOST, MOST_OF_ALL = 2048, 200_000
#: Steps of the audit in one step of the sweep.
FINER = 2
#: Error of an ok scenario beyond which a warning is given.
TOLERANCE = 0.05
#: Share of the tolerance within which the runs agree that tell the error of a scenario beyond it.
CONVERGED = 0.25
#: Estimated seconds that an audit may take beside any sweep, and share of the sweep's that comparing all may.
LEAST_SECONDS, SHARE_OF_ALL = 2.0, 1.0 / 3.0
#: Largest step (s) of exact flight that others are compared with.
EXACT_STEP = 1e-3


@dataclass(frozen=True)
class Audit:
    """Measured errors of scenarios, the arrays of shape (n,) or (n, outputs)."""

    rows: np.ndarray  # of the plan's unique scenarios, rising
    random: np.ndarray  # which of them were drawn at random
    outputs: tuple[str, ...]  # that have an error
    error: np.ndarray  # relative difference to the more exact run
    status: np.ndarray  # how the scenario ended in the sweep
    undecided: np.ndarray  # whether it is beyond the tolerance and no step settles it
    touching: int  # scenarios of the sweep that have contacts and values
    reference: str  # what they were compared with
    share: float  # estimated cost over that of the touching scenarios in the sweep
    tolerance: float  # accuracy asked for, else `TOLERANCE`

    @property
    def exceeding(self) -> np.ndarray:
        """Scenarios with status ok, not undecided, whose error is beyond the tolerance."""
        return ~self.undecided & (self.status == Status.OK) & (self.error.max(axis=1) > self.tolerance)


def candidates(plan: Plan, outcome: Outcome) -> np.ndarray:
    """Rows of the unique scenarios that touched and have values."""
    jumps = [index for index, law in enumerate(plan.laws) if law.impulsive]
    touched = outcome.results.touched | np.isin(plan.unique.law, jumps)
    return np.flatnonzero(touched & ~outcome.left_out & np.isin(outcome.results.status, WITH_VALUES)).astype(np.int32)


def draw(plan: Plan, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Draw scenarios of an audit from `rows`: rising, which of them at random, and their cost over that of all."""
    if not len(rows) or plan.spec.audit <= 0.0:
        return rows[:0], np.zeros(0, bool), 0.0
    random, table = np.random.Generator(np.random.PCG64(int(plan.digest[:16], 16))), plan.unique[rows]
    kinds = row_codes([table.record, table.law, plan.steps[rows]])
    cost = LANES * FINER * plan.seconds_of(rows)  # of a group of lanes
    order = np.concatenate([*_representatives(plan, rows, random), random.permutation(len(rows))])
    _, first = np.unique(order, return_index=True)
    is_random = first >= len(order) - len(rows)
    order = order[np.sort(first)]
    by_kind = np.argsort(kinds[order], kind="stable")  # the place of each among those of its kind, in that order
    sorted_kinds = kinds[order][by_kind]
    place = np.empty(len(rows), int)
    place[by_kind] = np.arange(len(rows)) - np.searchsorted(sorted_kinds, sorted_kinds)
    spent = np.cumsum(np.where(place % LANES == 0, cost[order], 0.0))
    whole = cost.sum() / (LANES * FINER)
    allowed = max(LEAST_SECONDS, plan.spec.audit * whole)
    count = min(MOST, max(1, int(np.searchsorted(spent, allowed, "right"))))
    sample = np.sort(order[:count])
    return rows[sample], is_random[sample], float(spent[count - 1] / whole)


def _representatives(plan: Plan, rows: np.ndarray, random: np.random.Generator) -> list[np.ndarray]:
    """Places in `rows` of a group of each law, records in turn: extreme stiffnesses, smallest gap, and others."""
    table, groups = plan.unique[rows], list[np.ndarray]()
    for turn, law in enumerate(np.unique(table.law).tolist()):
        of_law = np.flatnonzero(table.law == law)
        records = np.unique(table.record[of_law])
        part = random.permutation(of_law[table.record[of_law] == records[turn % len(records)]])
        stiffness, gap = np.atleast_2d(table.stiffness[part].T).max(axis=0), table.gaps[part].min(axis=1)
        extremes = part[[int(stiffness.argmin()), int(stiffness.argmax()), int(gap.argmin())]]
        groups.append(np.concatenate([extremes, part[: LANES - len(extremes)]]))
    return groups


def exact_kernel(plan: Plan) -> Callable[[RowKernel], RowKernel] | None:
    """Return what makes of a kernel that of exact flight; None where the sweep ran by it, or the row refuses it."""
    schemes = [s for s in SCHEMES.values() if s.flies_exactly and s.refuses(plan.spec.scene) is None]
    if plan.numerics.scheme.flies_exactly or not schemes:
        return None
    numerics = Numerics(schemes[0].name, min(EXACT_STEP, plan.numerics.dt), rest=plan.numerics.rest)
    return lambda kernel: replace(kernel, numerics=numerics)


def audit(plan: Plan, outcome: Outcome, dispatcher: Dispatcher, check: bool = False) -> Audit | None:
    """Compare scenarios with more exact runs, with `check` all of them; warns of errors beyond the tolerance."""
    rows, outputs = candidates(plan, outcome), tuple(name for name in plan.spec.outputs if VARIABLES[name].error)
    if not outputs or not len(rows) or (not check and ("error_estimate" in plan.outputs or plan.spec.audit <= 0.0)):
        return None
    accuracy = plan.spec.accuracy
    seconds, exact = plan.seconds_of(rows), exact_kernel(plan) if accuracy is None else None
    tolerance = TOLERANCE if accuracy is None else accuracy
    sample, random, share, reference = *draw(plan, rows), "half the step"
    if exact is not None:
        kernels = [exact(plan.kernel(law)) for law in np.unique(plan.unique.law[rows]).tolist()]
        ratio = kernels[0].numerics.scheme.step_cost / plan.numerics.scheme.step_cost
        steps = max(1.0, plan.numerics.dt / kernels[0].numerics.dt)
        allowed = max(LEAST_SECONDS, SHARE_OF_ALL * seconds.sum())
        pieces = {piece for kernel in kernels for piece in kernel.shape.pieces}
        cost = ratio * steps * seconds.sum()
        if check or (cost + compiling_seconds(pieces) <= allowed and len(rows) <= MOST_OF_ALL):
            sample, random, share = rows, np.zeros(len(rows), bool), float(cost / seconds.sum())
            reference = kernels[0].numerics.method
            if missing_kernels(shapes := [kernel.shape for kernel in kernels])[0]:
                dispatcher.prepare(shapes)
    elif check:
        sample, random, share = rows, np.zeros(len(rows), bool), float(FINER)
        reference = reference if accuracy is None else f"runs to {CONVERGED:g} of the accuracy"
    is_exact = exact is not None and reference == kernels[0].numerics.method
    compared = partial(compare, plan, outcome, dispatcher, outputs, exact if is_exact else None)
    dispatcher.progress.stage("audit", len(sample))
    status, undecided = outcome.results.status[sample], np.zeros(len(sample), bool)
    try:
        error, _ = compared(sample, None if accuracy is None else CONVERGED * accuracy)
        again = np.flatnonzero((status == Status.OK) & (error.max(axis=1) > tolerance))
        # what no step settles takes the most of them: so many scenarios are followed as take no longer than the audit
        longest = 2.0 ** (MOST_HALVINGS + 1) * seconds.mean()
        again = again[: max(LANES, int(max(LEAST_SECONDS, share * seconds.sum()) / longest))]
        if len(again):
            error[again], ended = compared(sample[again], CONVERGED * tolerance)
            undecided[again] = ended != Status.OK
    except RunError as failure:
        warnings.warn(
            f"the audit has no result: {failure}. The cube has none; to have it audited again, run the sweep with "
            "that cube as the one to extend (--extend OUT.nc --overwrite), which takes all else from it",
            RuntimeWarning,
            stacklevel=3,
        )
        return None
    result = Audit(sample, random, outputs, error, status, undecided, len(rows), reference, share, tolerance)
    if len(again) and (exceeding := result.exceeding).any():
        worst = error[exceeding].max(axis=0)
        warnings.warn(
            f"the audit of {len(sample)} scenarios found {exceeding.sum()} with status ok whose error is beyond "
            f"{tolerance:g}, the worst {worst.max():.2g} in {outputs[worst.argmax()]}; use a smaller dt, or ask for an "
            "accuracy (see audit_error in the cube)",
            RuntimeWarning,
            stacklevel=3,
        )
    return result


def compare(
    plan: Plan,
    outcome: Outcome,
    dispatcher: Dispatcher,
    outputs: tuple[str, ...],
    exact: Callable[[RowKernel], RowKernel] | None,
    rows: np.ndarray,
    accuracy: float | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return errors (n, outputs) beside more exact runs, and how these ended.

    They are by `exact`, else at half the step in double precision; with an `accuracy` they are refined to it.
    """

    def task_of(chunk: Chunk) -> ChunkTask:
        task = plan.task(plan.unique[chunk.rows], chunk.law, chunk.record, chunk.steps, outputs=outputs)
        kernel = halved(task.kernel, task.record).in_double if exact is None else exact(task.kernel)
        return task._replace(kernel=replace(kernel, accuracy=accuracy), once=False)

    error, status = np.zeros((len(rows), len(outputs))), np.zeros(len(rows), np.int8)
    for chunk, fine in dispatcher.run(plan.chunks(rows), task_of):
        if isinstance(fine, str):
            raise RunError(fine)
        swept, places = outcome.results.gather(chunk.rows), np.searchsorted(rows, chunk.rows)
        reference = {name: fine[name] for name in fine.dtype.names or ()}
        error[places] = np.stack([*relative_errors(outputs, swept, reference).values()], axis=1)
        status[places] = reference["status"]
        dispatcher.progress.advance(len(places))
    return error, status


def add_to_cube(cube: CubeParts, plan: Plan, result: Audit) -> None:
    """Put an audit into a cube: dimensions ``audit`` and ``output``, attributes on every output."""
    rows, both = ("audit",), ("audit", "output")
    dt = np.array([record.dt for record in plan.spec.records])[plan.unique.record[result.rows]]
    arrays = {
        "audit_error": (both, result.error, f"relative error, by the difference to {result.reference}", "1"),
        "audit_undecided": (rows, result.undecided.astype(np.int8), "whether no step settles it", "1"),
        "audit_random": (rows, result.random.astype(np.int8), "whether it was drawn at random", "1"),
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
    described["audit_random"][2].update(flags, flag_meanings="chosen random")
    described["audit_undecided"][2].update(flags, flag_meanings="decided undecided")
    described["audit_status"][2].update({key: status[key] for key in ("flag_values", "flag_meanings")})
    add_audit(cube, described, result.touching, result.share, result.reference)
