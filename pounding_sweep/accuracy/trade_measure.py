"""Running what a speed-accuracy trade compares: the converged solution, every configuration, and their costs."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from pounding_sweep.accuracy.trade_sample import Group, Sample, draw
from pounding_sweep.base.errors import InputError
from pounding_sweep.engine.row_kernel import Numerics
from pounding_sweep.outputs.differences import comparable, relative_errors
from pounding_sweep.outputs.variables import OK_CLAIM, Status
from pounding_sweep.plan.plan import Plan, make_plan
from pounding_sweep.plan.scenarios import changed
from pounding_sweep.run.execute import Progress
from pounding_sweep.run.refinement import run_once
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.spec.spec import SweepSpec

#: The converged solution's step is the finest compared over this; it is checked at twice its step.
REFINEMENT = 8
#: And it is at most this share of the stability limit.
REFERENCE_SHARE = 0.125

Values = dict[str, np.ndarray]


@dataclass(frozen=True)
class Compared:
    """Schemes, modes, number formats and steps of which every combination is measured.

    Attributes
    ----------
    methods : tuple of str
        Schemes.
    located : tuple of bool
        With contacts located inside the step, without, or both.
    precisions : tuple of str
        Number formats.
    steps : tuple of float
        Largest time steps (s), from the largest to the smallest.
    beta, gamma : float
        Newmark's parameters.
    """

    methods: tuple[str, ...]
    located: tuple[bool, ...]
    precisions: tuple[str, ...]
    steps: tuple[float, ...]
    beta: float
    gamma: float

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Number of methods, modes, number formats and steps."""
        return len(self.methods), len(self.located), len(self.precisions), len(self.steps)

    @cached_property
    def configurations(self) -> tuple[Numerics, ...]:
        """Every combination, in C order of `shape`."""
        every = product(self.methods, self.located, self.precisions, self.steps)
        return tuple(Numerics(m, step, mode, self.beta, self.gamma, p) for m, mode, p, step in every)


@dataclass(frozen=True)
class Measured:
    """Everything measured, before it is summed up.

    Attributes
    ----------
    spec : SweepSpec
        The sweep as it was given.
    plan : Plan
        Its scenarios.
    sample : Sample
        Those that were run.
    outputs : tuple of str
        Outputs whose errors were measured.
    compared : Compared
        What was compared.
    reference : Numerics
        How the converged solution was integrated.
    reference_errors : ndarray, shape (n, outputs)
        Upper estimate of its relative error; NaN where it has no values.
    sensitivity : ndarray, shape (n,)
        Largest relative change of an output when all inputs change by `CHANGE`.
    errors : ndarray, shape (*compared.shape, n, outputs)
        Relative errors; infinite where the scenario diverged, NaN where it was refused.
    statuses : ndarray of int, shape (*compared.shape, n)
        `Status` of each scenario.
    seconds : ndarray, shape (*compared.shape, timed groups, repeats)
        Processor time (s) of one scenario; NaN where the law is refused in some scenario of the sweep.
    """

    spec: SweepSpec
    plan: Plan
    sample: Sample
    outputs: tuple[str, ...]
    compared: Compared
    reference: Numerics
    reference_errors: np.ndarray
    sensitivity: np.ndarray
    errors: np.ndarray
    statuses: np.ndarray
    seconds: np.ndarray

    @property
    def sensitive(self) -> np.ndarray:
        """Scenarios (n,) of which a change of the inputs that nobody can tell changes an output beyond `OK_CLAIM`."""
        return np.asarray(self.sensitivity > OK_CLAIM)


def measure(
    spec: SweepSpec,
    compared: Compared,
    *,
    scenarios: int,
    seed: int,
    repeats: int,
    workers: int | None,
    progress: Progress,
) -> Measured:
    """Run a sample of a sweep's scenarios in every configuration; see `pounding_sweep.accuracy.tradeoff.tradeoff`."""
    outputs = comparable(spec.outputs)
    if not outputs:
        msg = f"the outputs {', '.join(spec.outputs)} have no error; ask for others, such as impact_force_max"
        raise InputError(msg)
    finest = compared.steps[-1]
    base = replace(spec, method="rk4", dt=finest, locate=True, precision="float64", accuracy=None)
    plan = Sweep.from_spec(base).plan()
    sample = draw(plan, scenarios, seed)
    stable = REFERENCE_SHARE * float(plan.limit[sample.touching].min())
    reference = Numerics("rk4", min(finest / REFINEMENT, stable), True, spec.beta, spec.gamma)
    grid = compared.configurations
    limits = {name: make_plan(replace(base, method=name)).limit for name in compared.methods}
    beyond = [_beyond_limit(plan, numerics, limits[numerics.method]) for numerics in grid]
    able = [numerics for numerics, refused in zip(grid, beyond, strict=True) if not refused.all()]
    _compile(plan, sample, [reference, *able], workers, progress)

    progress.stage("converged solution", 3 * len(sample.rows))
    converged = _run(plan, sample.groups, reference, outputs, progress)
    double = replace(reference, dt=2.0 * reference.dt)
    checked = _run(plan, sample.groups, double, outputs, progress)
    moved = _run(plan, sample.groups, double, outputs, progress, change=True)
    reference_errors = _errors(outputs, checked, converged)
    sensitivity = _errors(outputs, moved, checked).max(axis=1)

    progress.stage("comparisons", len(grid) * len(sample.rows))
    errors, statuses = [], []
    for numerics, refused in zip(grid, beyond, strict=True):
        values = _run(plan, sample.groups, numerics, outputs, progress, skip=refused[sample.rows])
        errors.append(np.where(np.isnan(reference_errors), np.nan, _errors(outputs, values, converged)))
        statuses.append(values["status"])
    seconds = _time(plan, sample, grid, beyond, repeats, progress)
    return Measured(
        spec,
        plan,
        sample,
        outputs,
        compared,
        reference,
        reference_errors,
        sensitivity,
        np.array(errors).reshape(*compared.shape, *errors[0].shape),
        np.array(statuses).reshape(*compared.shape, -1),
        seconds.reshape(*compared.shape, *seconds.shape[1:]),
    )


def _compile(plan: Plan, sample: Sample, every: Sequence[Numerics], workers: int | None, progress: Progress) -> None:
    """Make every kernel ready before anything is timed."""
    from pounding_sweep.engine.compile import prepare

    laws = [group.law for group in sample.timed]
    shapes = list(dict.fromkeys(replace(plan.kernel(law), numerics=n).shape for n in every for law in laws))
    progress.stage("kernels", len(shapes))
    prepare(shapes, workers or len(os.sched_getaffinity(0)), progress.advance)


def _beyond_limit(plan: Plan, numerics: Numerics, limit: np.ndarray) -> np.ndarray:
    """Rows of the plan's table that a sweep refuses: a step beyond the stability limit, or `exact` without locating."""
    if numerics.scheme.flies_exactly and not numerics.locate:
        return np.ones(len(plan.unique), bool)
    step = np.array([r.dt / numerics.steps(r) for r in plan.spec.records])[plan.unique.record]
    return np.zeros(len(step), bool) if plan.spec.force_unstable else step > limit


def _run_rows(
    plan: Plan, group: Group, rows: np.ndarray, numerics: Numerics, outputs: Sequence[str], change: bool = False
) -> Values:
    """Run scenarios of one group as a sweep does; returns shape (rows, *inner)."""
    kernel = replace(plan.kernel(group.law), numerics=numerics)
    record, table = plan.spec.records[group.record], plan.unique[rows]
    return run_once(kernel, record, changed(table) if change else table, plan.variants[table.variant], outputs)


def _run(
    plan: Plan,
    groups: Sequence[Group],
    numerics: Numerics,
    outputs: Sequence[str],
    progress: Progress,
    *,
    change: bool = False,
    skip: np.ndarray | None = None,
) -> Values:
    """Run all scenarios of a sample but those to `skip`, which are given as refused."""
    from pounding_sweep.outputs.layout import inner_shape

    n = sum(len(group.rows) for group in groups)
    result = {name: np.full((n, *inner_shape(name, plan.spec.scene)), np.nan) for name in outputs}
    result["status"] = np.full(n, int(Status.BEYOND_STABILITY_LIMIT))
    first = 0
    for group in groups:
        places = np.arange(first, first + len(group.rows))
        first += len(group.rows)
        kept = np.ones(len(places), bool) if skip is None else ~skip[places]
        if kept.any():
            found = _run_rows(plan, group, group.rows[kept], numerics, outputs, change)
            for name, values in result.items():
                values[places[kept]] = found[name]
        progress.advance(len(places))
    return result


def _errors(outputs: Sequence[str], values: Values, reference: Values) -> np.ndarray:
    """Relative errors (n, outputs): infinite where the run diverged, NaN where it or the reference has no values."""
    found = relative_errors(outputs, values, reference)
    table = np.stack([found[name] for name in outputs], axis=1)
    table[values["status"] == Status.DIVERGED] = np.inf
    absent = (values["status"] == Status.BEYOND_STABILITY_LIMIT) | (reference["status"] == Status.DIVERGED)
    table[absent] = np.nan
    return table


def _time(
    plan: Plan,
    sample: Sample,
    grid: Sequence[Numerics],
    beyond: Sequence[np.ndarray],
    repeats: int,
    progress: Progress,
) -> np.ndarray:
    """Processor time (s) of one scenario: shape (configurations, timed groups, repeats)."""
    seconds = np.full((len(grid), len(sample.timed), repeats), np.nan)
    progress.stage("costs", repeats * len(grid))
    for repeat in range(repeats):
        for i, numerics in enumerate(grid):
            for j, group in enumerate(sample.timed):
                if not (beyond[i] & sample.touching & (plan.unique.law == group.law)).any():
                    started = time.thread_time()
                    _run_rows(plan, group, group.rows, numerics, plan.spec.outputs)
                    seconds[i, j, repeat] = (time.thread_time() - started) / len(group.rows)
            progress.advance(1)
    return seconds
