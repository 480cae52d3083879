"""The speed-accuracy trade of a sweep, measured on a sample of its own scenarios.

Every scheme, step, number format, located or not, is run on the same scenarios and compared with a converged solution;
its cost is measured beside it. The converged solution is itself checked, by its own double step.

Errors are measured on scenarios drawn at random, costs on scenarios that stand side by side in the sweep: neighbouring
gaps share a lane group there, and contacts that fall together cost less.
"""

from __future__ import annotations

import json
import math
import os
import time
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.engine.compile import prepare
from pounding_sweep.engine.postprocess import variables_of
from pounding_sweep.engine.row_kernel import Numerics
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.output.dataset import made_here
from pounding_sweep.outputs.differences import CHANGE, comparable, relative_errors
from pounding_sweep.outputs.variables import OK_CLAIM, STATUS, Status, inner_shape
from pounding_sweep.plan.advice import measured_schemes
from pounding_sweep.plan.plan import Plan, make_plan, untouched
from pounding_sweep.plan.scenarios import changed
from pounding_sweep.run.diagnosis import diagnose
from pounding_sweep.run.execute import Progress
from pounding_sweep.run.refinement import run_once
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.schemes.stability import largest_step
from pounding_sweep.spec.spec import METHODS, PRECISIONS, SweepSpec, digest, to_json

#: Largest step (s) of the runs without pounding that tell which scenarios can touch.
CLOSING_STEP = 1.0e-3
#: Lane groups of one timed call.
TIMED_GROUPS = 2


@dataclass(frozen=True)
class KernelCall:
    """Scenarios of one law and one record: one kernel call."""

    #: index into the plan's laws and records
    law: int
    record: int
    rows: np.ndarray  # rows of the plan's table of unique scenarios


@dataclass(frozen=True)
class TradeSample:
    """What is run to measure a trade."""

    groups: tuple[KernelCall, ...]  # random scenarios, for errors
    #: one per law: scenarios that stand side by side in the sweep, in whole lane groups, for costs
    timed: tuple[KernelCall, ...]
    touching: np.ndarray  # rows of the plan's table in which floors can meet

    @property
    def rows(self) -> np.ndarray:
        """Rows of all scenarios whose errors are measured, group by group."""
        return np.concatenate([group.rows for group in self.groups])


def find_touching(plan: Plan) -> np.ndarray:
    """Rows of the plan's unique table in which floors can meet, found by runs without pounding."""
    last = len(plan.laws) - 1
    contacts = plan.spec.scene.contacts
    if not contacts:
        return np.zeros(len(plan.unique), bool)
    one = np.ones(len(plan.variants))
    limit = largest_step(plan.variants, plan.laws[last], 0.0 * one, one, method="rk4")
    step = min(CLOSING_STEP, 0.5 * float(limit.min()))
    kernel = replace(plan.kernel(last, closing=True), numerics=Numerics("rk4", step))
    motions = plan.uncoupled_runs
    closing = np.full((len(motions), len(contacts)), np.inf)
    for record in np.unique(motions.record):
        rows, motion = np.flatnonzero(motions.record == record), plan.spec.records[record]
        table = motions[rows]
        variants = plan.variants[table.variant]
        values: dict[str, Any] = {"scale": table.scale, "stiffness": table.stiffness, "restitution": table.restitution}
        raw = kernel.run(motion, gaps=table.gaps, variants=variants, **values)
        found = variables_of(kernel, raw, ("closing_max",), motion, variants)["closing_max"]
        for j, contact in enumerate(contacts):
            closing[rows, j] = found[:, contact.place, contact.storey - 1]
    return ~untouched(plan, closing)


def draw(plan: Plan, scenarios: int, seed: int) -> TradeSample:
    """Draw the scenarios of a trade: every law alike, records as often as the sweep has them."""
    rng = np.random.default_rng(seed)
    touching = find_touching(plan)
    table = plan.unique
    laws = np.unique(table.law[touching]).tolist()
    if not laws:
        msg = "no scenario of this sweep can touch, so there is no contact to compare schemes by; give smaller gaps"
        raise InputError(msg)
    size = min(LANES, -(-scenarios // len(laws)))
    n_groups = max(len(laws), round(scenarios / size))
    groups, timed = [], []
    for place, law in enumerate(laws):
        free = np.flatnonzero(touching & (table.law == law))
        record = int(table.record[rng.choice(free)])
        timed.append(KernelCall(law, record, _side_by_side(plan, free[table.record[free] == record], rng)))
        for _ in range(n_groups // len(laws) + (place < n_groups % len(laws))):
            if not len(free):
                break
            record = int(table.record[rng.choice(free)])
            mine = free[table.record[free] == record]
            rows = np.sort(rng.choice(mine, min(size, len(mine)), replace=False))
            groups.append(KernelCall(law, record, rows))
            free = np.setdiff1d(free, rows)
    return TradeSample(tuple(groups), tuple(timed), touching)


def _side_by_side(plan: Plan, rows: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Whole lane groups out of `rows` of one law and record, in the order in which a sweep runs them."""
    order = np.concatenate([chunk.rows for chunk in plan.chunks(rows)])
    size = TIMED_GROUPS * LANES
    first = int(rng.integers(max(1, len(order) - size + 1)))
    return np.resize(order[first : first + size], size)


#: The converged solution's step is the finest compared over this; it is checked at twice its step.
REFINEMENT = 8
#: And it is at most this share of the stability limit.
REFERENCE_SHARE = 0.125

Values = dict[str, np.ndarray]


@dataclass(frozen=True)
class Compared:
    """Schemes, modes, number formats and steps of which every combination is measured."""

    methods: tuple[str, ...]
    located: tuple[bool, ...]  # with contacts located inside the step, without, or both
    precisions: tuple[str, ...]
    steps: tuple[float, ...]  # largest time steps (s), from the largest to the smallest
    #: Newmark's parameters
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
class MeasuredTrade:
    """Everything measured, before it is summed up."""

    spec: SweepSpec  # the sweep as it was given
    plan: Plan  # its scenarios
    sample: TradeSample  # those that were run
    outputs: tuple[str, ...]  # outputs whose errors were measured
    compared: Compared  # what was compared
    reference: Numerics  # how the converged solution was integrated
    reference_errors: np.ndarray  # upper estimate of its relative error; NaN where it has no values; shape (n, outputs)
    sensitivity: np.ndarray  # largest relative change of an output when all inputs change by `CHANGE`; shape (n,)
    #: relative errors; infinite where the scenario diverged, NaN where it was refused; shape (*compared.shape, n,
    #: outputs)
    errors: np.ndarray
    statuses: np.ndarray  # `Status` of each scenario; shape (*compared.shape, n)
    #: processor time (s) of one scenario; NaN where the law is refused in some scenario of the sweep; shape
    #: (*compared.shape, timed groups, repeats)
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
) -> MeasuredTrade:
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
    return MeasuredTrade(
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


def _compile(
    plan: Plan, sample: TradeSample, every: Sequence[Numerics], workers: int | None, progress: Progress
) -> None:
    """Make every kernel ready before anything is timed."""
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
    plan: Plan, group: KernelCall, rows: np.ndarray, numerics: Numerics, outputs: Sequence[str], change: bool = False
) -> Values:
    """Run scenarios of one group as a sweep does; returns shape (rows, *inner)."""
    kernel = replace(plan.kernel(group.law), numerics=numerics)
    record, table = plan.spec.records[group.record], plan.unique[rows]
    return run_once(kernel, record, changed(table) if change else table, plan.variants[table.variant], outputs)


def _run(
    plan: Plan,
    groups: Sequence[KernelCall],
    numerics: Numerics,
    outputs: Sequence[str],
    progress: Progress,
    *,
    change: bool = False,
    skip: np.ndarray | None = None,
) -> Values:
    """Run all scenarios of a sample but those to `skip`, which are given as refused."""
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
    sample: TradeSample,
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


#: Errors below this many times the converged solution's own error are not resolved.
RESOLUTION = 3.0
#: Shares of the scenarios whose error is at most the statistic.
STATISTICS = {"median": 0.5, "p90": 0.9, "worst": 1.0}
#: Sets of scenarios that statistics are made of.
POPULATIONS = {
    "all": "every scenario that was not refused",
    "steady": "those that are not sensitive",
    "sensitive": "those that are",
    "ok": "those whose status is ok in this configuration",
    "ok_steady": "those whose status is ok in this configuration and that are not sensitive",
}
#: Dimensions of a configuration.
CONFIGURATION = ("scheme", "located", "precision", "step")
_SUMMED = ("output", "population", "statistic")
#: Attribute by which a dataset is known as a trade.
KIND_ATTRIBUTE = "pounding_sweep_kind"
KIND = "tradeoff"

_FLAGS = {"flag_values": np.array([0, 1], np.int8), "flag_meanings": "no yes"}
_ERROR = {
    "units": "1",
    "long_name": "relative error",
    "comment": "Largest difference over floors or pairs over the largest value of the scenario; infinite: diverged.",
}
_OWN = {"units": "1", "long_name": "upper estimate of the converged solution's own relative error"}
_RESOLVED = _FLAGS | {"long_name": f"error at least {RESOLUTION:g} times the converged solution's own"}
_PARETO = _FLAGS | {"long_name": "no other configuration is as good in cost and error and better in one"}
_COST = {
    "units": "s",
    "comment": "Processor time of one core, kernels compiled, lane groups full; missing where any scenario is refused.",
}
_STATUSES = {
    "flag_values": np.array([int(s) for s in STATUS], np.int8),
    "flag_meanings": " ".join(s.label for s in STATUS),
}
_EACH = ("scenario",)
_SUMMARY = (*CONFIGURATION, *_SUMMED)
#: Every variable: dimensions and attributes.
_VARIABLES: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {
    "error": (_SUMMARY, _ERROR),
    "resolution": (
        _SUMMARY,
        {"units": "1", "long_name": "least relative error that can be told from the converged solution's own"},
    ),
    "resolved": (_SUMMARY, _RESOLVED),
    "pareto": (_SUMMARY, _PARETO),
    "cost": (CONFIGURATION, _COST | {"long_name": "time per thousand scenarios, best of the passes"}),
    "cost_median": (CONFIGURATION, _COST | {"long_name": "time per thousand scenarios, median of the passes"}),
    "status_count": ((*CONFIGURATION, "status"), {"units": "1", "long_name": "scenarios of the sample by status"}),
    "law_error": (("law", *_SUMMARY), _ERROR),
    "law_resolved": (("law", *_SUMMARY), _RESOLVED),
    "law_pareto": (("law", *_SUMMARY), _PARETO),
    "law_cost": (("law", *CONFIGURATION), _COST | {"long_name": "time per thousand scenarios, best of the passes"}),
    "reference_error": (_SUMMED, _OWN),
    "scenario_error": ((*_EACH, "output", *CONFIGURATION), _ERROR),
    "scenario_status": ((*_EACH, *CONFIGURATION), _STATUSES | {"long_name": "status of the scenario"}),
    "scenario_reference_error": ((*_EACH, "output"), _OWN),
    "sensitivity": (
        _EACH,
        {"units": "1", "long_name": f"largest relative change of an output when all inputs change by {CHANGE:g}"},
    ),
    "sensitive": (
        _EACH,
        _FLAGS | {"flag_meanings": "steady sensitive", "long_name": f"sensitivity above {OK_CLAIM:g}"},
    ),
}


def pareto_front(cost: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Say which points no other point beats: none is as good in both and better in one.

    Parameters
    ----------
    cost, error : ndarray, shape (n,)
        Smaller is better; a point with a number that is not finite is never on the front.

    Returns
    -------
    ndarray of bool, shape (n,)

    Examples
    --------
    >>> pareto_front(np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.01])).tolist()
    [True, False, True]
    """
    cost, error = np.asarray(cost, float), np.asarray(error, float)
    finite = np.isfinite(cost) & np.isfinite(error)
    x, y = np.where(finite, cost, np.inf), np.where(finite, error, np.inf)
    as_good = (x[None, :] <= x[:, None]) & (y[None, :] <= y[:, None])
    better = (x[None, :] < x[:, None]) | (y[None, :] < y[:, None])
    return finite & ~(as_good & better).any(axis=1)


def statistics(errors: np.ndarray) -> np.ndarray:
    """Return the statistics of scenarios' errors; each is the error of one of them, so that infinity stays infinity."""
    kept = np.sort(errors[~np.isnan(errors).any(axis=1)], axis=0)
    if not len(kept):
        return np.full((errors.shape[1], len(STATISTICS)), np.nan)
    places = [math.ceil(share * len(kept)) - 1 for share in STATISTICS.values()]
    return np.asarray(kept[places].T)


def make_dataset(measured: MeasuredTrade, settings: Mapping[str, Any]) -> xr.Dataset:
    """Sum up and label what was measured."""
    m = measured
    rows_law = m.plan.unique.law[m.sample.rows]
    populations = _populations(np.broadcast_to(m.sensitive, m.statuses.shape), m.statuses == Status.OK)
    law_cost, cost, cost_median = _costs(m)
    error, resolution = _sums(m, populations, np.ones(len(rows_law), bool))
    by_law = [_sums(m, populations, rows_law == group.law) for group in m.sample.timed]
    values = {
        "error": error,
        "resolution": resolution,
        "resolved": _flag(error >= resolution),
        "pareto": _fronts(cost, error, resolution),
        "cost": cost,
        "cost_median": cost_median,
        "status_count": np.stack([(m.statuses == int(s)).sum(axis=-1) for s in STATUS], axis=-1).astype(np.int32),
        "law_error": np.stack([found for found, _ in by_law]),
        "law_resolved": np.stack([_flag(found >= limit) for found, limit in by_law]),
        "law_pareto": np.stack([_fronts(law_cost[i], *found) for i, found in enumerate(by_law)]),
        "law_cost": law_cost,
        "reference_error": _reference_sums(m),
        "scenario_error": np.moveaxis(m.errors, (-2, -1), (0, 1)),
        "scenario_status": np.moveaxis(m.statuses, -1, 0).astype(np.int8),
        "scenario_reference_error": m.reference_errors,
        "sensitivity": m.sensitivity,
        "sensitive": _flag(m.sensitive),
    }
    data = {name: (dims, values[name], attributes) for name, (dims, attributes) in _VARIABLES.items()}
    return xr.Dataset(data, coords=_coordinates(m), attrs=_attributes(m, settings))


def _fronts(cost: np.ndarray, error: np.ndarray, resolution: np.ndarray) -> np.ndarray:
    """Pareto front of the configurations for each output, population and statistic."""
    result = np.zeros(error.shape, np.int8)
    for i in np.ndindex(error.shape[len(CONFIGURATION) :]):
        every = (..., *i)
        reached = np.maximum(error[every], resolution[every])  # below it, two errors can't be told apart
        result[every] = pareto_front(cost.ravel(), reached.ravel()).reshape(cost.shape)
    return result


def _flag(values: np.ndarray) -> np.ndarray:
    return np.asarray(values, np.int8)


def _populations(sensitive: np.ndarray, ok: np.ndarray) -> dict[str, np.ndarray]:
    """Masks of the scenarios."""
    masks = {
        "all": np.ones(ok.shape, bool),
        "steady": ~sensitive,
        "sensitive": sensitive,
        "ok": ok,
        "ok_steady": ok & ~sensitive,
    }
    return {name: masks[name] for name in POPULATIONS}


def _sums(m: MeasuredTrade, populations: dict[str, np.ndarray], mine: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Statistics of the errors and of their resolution, shape (*configurations, outputs, populations, statistics)."""
    shape = m.statuses.shape[:-1]
    error = np.full((*shape, len(m.outputs), len(populations), len(STATISTICS)), np.nan)
    resolution = error.copy()
    for i in np.ndindex(shape):
        for j, population in enumerate(populations.values()):
            rows = population[i] & mine
            error[i][:, j] = statistics(m.errors[i][rows])
            compared = ~np.isnan(m.errors[i]).any(axis=1)
            resolution[i][:, j] = RESOLUTION * statistics(m.reference_errors[rows & compared])
    return error, resolution


def _reference_sums(m: MeasuredTrade) -> np.ndarray:
    """Statistics of the converged solution's own error, shape (outputs, populations, statistics)."""
    chosen = _populations(m.sensitive, np.ones(m.sensitive.shape, bool))
    return np.stack([statistics(m.reference_errors[rows]) for rows in chosen.values()], axis=1)


def _costs(m: MeasuredTrade) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time per thousand scenarios: of each law, and of the sweep's mix of laws (best and median of the passes)."""
    table, touching = m.plan.unique, m.sample.touching
    durations = np.array([record.duration for record in m.spec.records])
    best, median = m.seconds.min(axis=-1), np.median(m.seconds, axis=-1)
    shares, lengths = [], []
    for group in m.sample.timed:
        rows = touching & (table.law == group.law)
        shares.append(rows.sum() / touching.sum())
        lengths.append(durations[table.record[rows]].mean() / durations[group.record])
    per_law = 1e3 * best * np.array(lengths)
    mixed = [1e3 * found * np.array(lengths) @ np.array(shares) for found in (best, median)]
    return np.moveaxis(per_law, -1, 0), mixed[0], mixed[1]


def _coordinates(m: MeasuredTrade) -> dict[str, Any]:
    spec, plan = m.spec, m.plan
    table = plan.unique[m.sample.rows]
    by_step = m.compared.configurations[: len(m.compared.steps)]
    steps = [[r.dt / numerics.steps(r) for numerics in by_step] for r in spec.records]
    labels: dict[str, tuple[Any, str]] = {
        "scheme": (list(m.compared.methods), "time-stepping scheme"),
        "precision": (list(m.compared.precisions), "number format of the kernels"),
        "output": (list(m.outputs), "output of the sweep"),
        "population": (list(POPULATIONS), "; ".join(f"{k}: {v}" for k, v in POPULATIONS.items())),
        "statistic": (list(STATISTICS), "the error that this share of the scenarios does not exceed: 0.5, 0.9, 1"),
        "status": ([s.label for s in STATUS], "status of a scenario"),
        "law": ([plan.laws[group.law].key for group in m.sample.timed], "contact law"),
        "record": ([r.name for r in spec.records], "ground-motion record"),
        "pair": (list(spec.scene.pair_labels), "pair of neighbours, left-right"),
    }
    found: dict[str, Any] = {name: ((name,), values, {"long_name": text}) for name, (values, text) in labels.items()}
    per = ("scenario",)
    return {
        **found,
        "located": (
            ("located",),
            np.array(m.compared.located, np.int8),
            _FLAGS | {"long_name": "contacts and peaks located inside the step"},
        ),
        "step": (("step",), np.array(m.compared.steps), {"units": "s", "long_name": "largest time step"}),
        "time_step": (
            ("record", "step"),
            np.array(steps),
            {"units": "s", "long_name": "time step: the record's own, divided evenly"},
        ),
        "scenario": (per, np.arange(1, len(table) + 1), {"units": "1", "long_name": "scenario of the sample"}),
        "scenario_law": (per, [plan.laws[i].key for i in table.law], {"long_name": "contact law"}),
        "scenario_record": (per, [spec.records[i].name for i in table.record], {"long_name": "ground-motion record"}),
        "scenario_scale": (per, table.scale, {"units": "1", "long_name": "factor on the record"}),
        "scenario_gap": (
            ("scenario", "pair"),
            table.gaps[:, spec.scene.pair_of_label],
            {"units": "m", "long_name": "gap of the pair"},
        ),
        "scenario_stiffness": (
            per,
            table.stiffness,
            {"long_name": "contact stiffness", "comment": "kN/m for force ~ d, kN/m^1.5 for force ~ d^1.5"},
        ),
        "scenario_restitution": (
            per,
            table.restitution,
            {"units": "1", "long_name": "nominal coefficient of restitution"},
        ),
    }


def _attributes(m: MeasuredTrade, settings: Mapping[str, Any]) -> dict[str, Any]:
    import numba
    import xarray

    machine = diagnose()
    processor = {k: machine["processor"][k] for k in ("name", "vector_bits", "lanes_per_kernel", "cores")}
    records = [
        {"name": r.name, "pga": r.pga, "dt": r.dt, "points": r.n_points, "sha256": r.sha256, "source": r.source}
        for r in m.spec.records
    ]
    return {
        **made_here(f"Speed-accuracy trade: {m.spec.title or 'sweep of seismic pounding of adjacent buildings'}"),
        KIND_ATTRIBUTE: KIND,
        "sample_scenarios": len(m.sample.rows),
        "sensitive_scenarios": int(m.sensitive.sum()),
        "touching_scenarios": int(m.sample.touching.sum()),
        "unique_scenarios": len(m.plan.unique),
        "reference": f"{m.reference.method}, located, {m.reference.precision}",
        "reference_step": m.reference.dt,
        "reference_check": "the same at twice the step; their difference is reference_error",
        "resolution_factor": RESOLUTION,
        "input_change": CHANGE,
        "sensitive_change": OK_CLAIM,
        "newmark_beta": m.spec.beta,
        "newmark_gamma": m.spec.gamma,
        **settings,
        "machine": json.dumps({"system": machine["system"], **processor}, sort_keys=True),
        "records": json.dumps(records, sort_keys=True, ensure_ascii=False),
        "unit_system": "kN, t, m, s",
        "sweep": to_json(m.spec),
        "sweep_sha256": digest(m.spec),
        "python_version": str(machine["versions"]["python"]),
        "numba_version": numba.__version__,
        "numpy_version": np.__version__,
        "xarray_version": xarray.__version__,
    }


#: Steps (s) compared by default.
DEFAULT_STEPS = (5e-3, 2.5e-3, 1e-3, 5e-4, 2.5e-4)
#: A converged solution with a larger error of its own is worth a warning.
DOUBTFUL = 1e-5


def tradeoff(
    sweep: Sweep,
    *,
    steps: Iterable[float] = DEFAULT_STEPS,
    methods: Iterable[str] | None = None,
    located: Iterable[bool] = (True, False),
    precisions: Iterable[str] = PRECISIONS,
    scenarios: int = 96,
    seed: int = 0,
    repeats: int = 5,
    workers: int | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Measure errors and costs of schemes and steps on a sample of a sweep's scenarios.

    Parameters
    ----------
    sweep : Sweep
        The sweep; its own scheme, step and number format don't matter.
    steps : iterable of float
        Largest time steps (s); of those that cut a record alike, one is kept.
    methods : iterable of str, optional
        Schemes, out of `pounding_sweep.schemes.SCHEMES`; those that ``accuracy`` chooses from by default.
    located : iterable of bool
        With contacts located inside the step, without, or both.
    precisions : iterable of str
        Number formats, out of "float64" and "float32".
    scenarios : int
        About how many scenarios errors are measured on.
    seed : int
        Of the random sample.
    repeats : int
        Passes over all configurations in which costs are measured.
    workers : int, optional
        Processes that compile kernels; one per core by default. Costs are always of one core.
    progress : Progress, optional
        Display.

    Returns
    -------
    xarray.Dataset
        ``error`` on (scheme, located, precision, step, output, population, statistic),
        ``cost`` (s per thousand scenarios), ``status_count``, ``pareto``, the same by law,
        and the errors of every single scenario; settings, machine and sweep as attributes.

    Raises
    ------
    InputError
        An argument is not valid, or no scenario can touch.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> sweep = ps.Sweep("mate2015", records="el_centro", laws="linear", gaps=[0.005, 0.01])
    >>> only = {"methods": ["rk4"], "located": [True], "precisions": ["float64"]}
    >>> trade = ps.tradeoff(sweep, steps=[1e-3], scenarios=2, repeats=1, **only)
    >>> worst = trade.error.sel(population="all", statistic="worst", output="impact_force_max")
    >>> bool(worst.item() < 1e-3)
    True
    """
    spec = sweep.spec
    modes = tuple(dict.fromkeys(bool(value) for value in located))
    for name, count in (("scenarios", scenarios), ("repeats", repeats), ("located", len(modes))):
        if count < 1:
            msg = f"{name} = {count!r} must be at least 1"
            raise InputError(msg)
    compared = Compared(
        _chosen("method", measured_schemes() if methods is None else methods, METHODS),
        modes,
        _chosen("precision", precisions, PRECISIONS),
        _distinct_steps(spec, steps),
        spec.beta,
        spec.gamma,
    )
    found = measure(
        spec,
        compared,
        scenarios=scenarios,
        seed=seed,
        repeats=repeats,
        workers=workers,
        progress=progress or Progress(),
    )
    warn_of_doubt(found)
    return make_dataset(found, {"seed": seed, "repeats": repeats})


def warn_of_doubt(measured: MeasuredTrade) -> None:
    """Warn, with the worst case by name, where the converged solution is not converged."""
    own = np.nan_to_num(measured.reference_errors, posinf=np.inf)
    doubtful = int((own.max(axis=1) > DOUBTFUL).sum())
    if not doubtful:
        return
    row, output = np.unravel_index(np.argmax(own), own.shape)
    table = measured.plan.unique[measured.sample.rows]
    gaps = ", ".join(f"{gap:g}" for gap in table.gaps[row])
    warnings.warn(
        f"the converged solution of {doubtful} of {len(own)} scenarios differs from that of twice its step by more "
        f"than {DOUBTFUL:g}, so their smaller errors can't be told; worst {own[row, output]:.1e} in "
        f"{measured.outputs[output]} of law {measured.plan.laws[table.law[row]].key}, gaps {gaps} m, stiffness "
        f"{table.stiffness[row]:g}, restitution {table.restitution[row]:g}. Compare a smaller finest step",
        RuntimeWarning,
        stacklevel=3,
    )


def _chosen(kind: str, given: Iterable[str], valid: Sequence[str]) -> tuple[str, ...]:
    """Return the names asked for, in the order of `valid`."""
    names = (given,) if isinstance(given, str) else tuple(given)
    for name in names:
        if name not in valid:
            raise InputError(unknown(kind, name, valid))
    if not names:
        msg = f"no {kind} is given; valid: {', '.join(valid)}"
        raise InputError(msg)
    return tuple(name for name in valid if name in names)


def _distinct_steps(spec: SweepSpec, steps: Iterable[float]) -> tuple[float, ...]:
    """Return the steps from the largest to the smallest, one of those that cut every record alike."""
    found: dict[tuple[int, ...], float] = {}
    for step in sorted((float(s) for s in steps), reverse=True):
        if not (math.isfinite(step) and step > 0):
            msg = f"step {step!r} must be a positive number (s), such as 1e-3"
            raise InputError(msg)
        cut = tuple(Numerics("rk4", step).steps(record) for record in spec.records)
        found.setdefault(cut, step)
    if not found:
        msg = f"no steps are given; give one or more (s), such as {', '.join(f'{s:g}' for s in DEFAULT_STEPS)}"
        raise InputError(msg)
    return tuple(found.values())
