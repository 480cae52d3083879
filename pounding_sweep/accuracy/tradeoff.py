"""The speed-accuracy trade of a sweep, measured on a sample of its own scenarios.

Errors are measured on scenarios drawn at random, costs on scenarios that stand side by side in the sweep: neighbouring
gaps share a lane group there, and contacts that fall together cost less.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from pounding_sweep.accuracy.certificate import prepare_kernels
from pounding_sweep.base.errors import InputError, check_choice
from pounding_sweep.base.text import finite
from pounding_sweep.engine.row_kernel import Numerics
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.output.dataset import global_attributes, unit_attributes
from pounding_sweep.output.identity import library_versions
from pounding_sweep.output.labels import listed_coordinates
from pounding_sweep.outputs.variables import CHANGE, OK_CLAIM, STATUS, Status, comparable, inner_shape, relative_errors
from pounding_sweep.plan.advice import measured_schemes
from pounding_sweep.plan.plan import Plan, make_plan, untouched
from pounding_sweep.plan.scenarios import ChunkTask, Scenarios, changed
from pounding_sweep.records import Record
from pounding_sweep.run.diagnosis import diagnose
from pounding_sweep.run.execute import Progress
from pounding_sweep.run.refinement import run_once
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.schemes import SCHEMES, reference_scheme
from pounding_sweep.schemes.stability import largest_step
from pounding_sweep.spec.spec import METHODS, PRECISIONS, SweepSpec, digest, seconds_of_rest, to_json

#: Steps (s) compared by default.
DEFAULT_STEPS = (5e-3, 2.5e-3, 1e-3, 5e-4, 2.5e-4)
#: Largest step (s) of the runs without pounding that tell which scenarios can touch.
CLOSING_STEP = 1.0e-3
#: Scenarios of one timed call.
TIMED = 2 * LANES
#: The converged solution's step is the finest compared over this, and at most that share of the stability limit.
REFINEMENT, REFERENCE_SHARE = 8, 0.125
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
#: Attribute by which a dataset is known as a trade, and its value.
KIND_ATTRIBUTE, KIND = "pounding_sweep_kind", "tradeoff"
_ERROR = "relative error: largest difference over the largest value of the scenario; infinite: diverged"
_REFERENCE_ERROR = "upper estimate (its difference to twice its step) of the converged solution's own relative error"
#: Long name and units (or meanings of flags) of what a trade holds; ``law_error`` has those of ``error``.
_ABOUT = {
    "error": (_ERROR, "1"),
    "resolution": ("least relative error that can be told from the converged solution's own", "1"),
    "resolved": (f"error at least {RESOLUTION:g} times the converged solution's own", "no yes"),
    "pareto": ("no other configuration is as good in cost and error and better in one", "no yes"),
    "cost": ("processor time of one core per thousand scenarios, best of the passes", "s"),
    "cost_median": ("processor time of one core per thousand scenarios, median of the passes", "s"),
    "status_count": ("scenarios of the sample by status", "1"),
    "reference_error": (_REFERENCE_ERROR, "1"),
    "scenario_error": (_ERROR, "1"),
    "scenario_status": ("status of the scenario", " ".join(s.label for s in STATUS)),
    "scenario_reference_error": (_REFERENCE_ERROR, "1"),
    "sensitivity": (f"largest relative change of an output when all inputs change by {CHANGE:g}", "1"),
    "sensitive": (f"sensitivity above {OK_CLAIM:g}", "steady sensitive"),
    "located": ("contacts and peaks located inside the step", "no yes"),
    "step": ("largest time step", "s"),
    "time_step": ("time step: the record's own, divided evenly", "s"),
    "population": ("; ".join(f"{key}: {text}" for key, text in POPULATIONS.items()), ""),
    "statistic": ("the error that this share of the scenarios does not exceed: 0.5, 0.9, 1", ""),
}

Values = dict[str, np.ndarray]


def run_rows(
    plan: Plan,
    table: Scenarios,
    numerics: Numerics,
    outputs: Sequence[str],
    refused: np.ndarray | bool = False,
    closing: bool = False,
) -> Values:
    """Run scenarios of a plan as a sweep does, but for the `refused` ones; variables of shape (rows, *inner)."""
    able = ~np.broadcast_to(refused, len(table))
    values = {name: np.full((len(table), *inner_shape(name, plan.spec.scene)), np.nan) for name in outputs}
    values["status"] = np.full(len(table), int(Status.BEYOND_STABILITY_LIMIT))
    for law, record in {*zip(table.law[able].tolist(), table.record[able].tolist(), strict=True)}:
        places = np.flatnonzero((table.law == law) & (table.record == record) & able)
        kernel, part = replace(plan.kernel(law, closing), numerics=numerics), table[places]
        result = run_once(ChunkTask(kernel, plan.spec.records[record], part, plan.variants[part.variant], outputs))
        for name in values.keys() & result.keys():
            values[name][places] = result[name]
    return values


def find_touching(plan: Plan) -> np.ndarray:
    """Rows of the plan's unique table in which floors can meet, found by runs without pounding."""
    one = np.ones(len(plan.variants))
    limit = largest_step(plan.variants, plan.laws[-1], 0.0 * one, one, method="rk4")
    numerics = Numerics("rk4", min(CLOSING_STEP, 0.5 * float(limit.min())), rest=plan.numerics.rest)
    closing = run_rows(plan, plan.uncoupled_runs, numerics, ("closing_max",), closing=True)["closing_max"]
    return ~untouched(plan, closing)


class TradeSample(NamedTuple):
    """Scenarios of a sweep that are run to measure a trade, as rows of its plan's table."""

    rows: np.ndarray  # for errors: random scenarios
    timed: tuple[np.ndarray, ...]  # for costs: whole lane groups of each law, side by side in the sweep
    touching: np.ndarray  # which rows can touch, shape (unique,)


def draw(plan: Plan, scenarios: int, seed: int) -> TradeSample:
    """Draw the scenarios of a trade: every law alike, records as often as the sweep has them."""
    rng = np.random.default_rng(seed)
    touching, table = find_touching(plan), plan.unique
    laws = np.unique(table.law[touching]).tolist()
    if not laws:
        raise InputError(
            "no scenario of this sweep can touch, so there is no contact to compare schemes by; give smaller gaps"
        )
    size = min(LANES, -(-scenarios // len(laws)))
    n_groups = max(len(laws), round(scenarios / size))
    groups, timed = [], []
    for i, law in enumerate(laws):
        free = np.flatnonzero(touching & (table.law == law))
        rows = free[table.record[free] == table.record[rng.choice(free)]]
        order = np.concatenate([chunk.rows for chunk in plan.chunks(rows)])
        first = int(rng.integers(max(1, len(order) - TIMED + 1)))
        timed.append(np.resize(order[first : first + TIMED], TIMED))
        for _ in range(n_groups // len(laws) + (i < n_groups % len(laws))):
            if len(free):
                rows = free[table.record[free] == table.record[rng.choice(free)]]
                groups.append(np.sort(rng.choice(rows, min(size, len(rows)), replace=False)))
                free = np.setdiff1d(free, groups[-1])
    return TradeSample(np.concatenate(groups), tuple(timed), touching)


def measure(
    spec: SweepSpec,
    axes: Mapping[str, Sequence[Any]],
    *,
    scenarios: int,
    seed: int,
    repeats: int,
    workers: int | None,
    progress: Progress,
) -> xr.Dataset:
    """Run a sample of a sweep's scenarios in every configuration of `axes`: errors and costs, not summed up yet."""
    outputs = comparable(spec.outputs)
    if not outputs:
        raise InputError(
            f"the outputs {', '.join(spec.outputs)} have no error; ask for others, such as impact_force_max"
        )
    finest = axes["step"][-1]
    base = replace(spec, method="rk4", dt=finest, locate=True, precision="float64", accuracy=None)
    plan = Sweep.from_spec(base).plan()
    sample = draw(plan, scenarios, seed)
    table, n = plan.unique[sample.rows], len(sample.rows)
    stable = REFERENCE_SHARE * float(plan.limit[sample.touching].min())
    method = reference_scheme(spec.scene, table.gaps)
    settings: dict[str, Any] = {"beta": spec.beta, "gamma": spec.gamma, "rest": seconds_of_rest(spec.rest)}
    reference = Numerics(method, min(finest / REFINEMENT, stable), True, **settings)
    grid = [Numerics(m, step, mode, precision=p, **settings) for m, mode, p, step in product(*axes.values())]
    limits = {name: make_plan(replace(base, method=name)).limit for name in axes["scheme"]}
    true_steps = np.array([[_step(record, step) for step in axes["step"]] for record in spec.records])
    refused = [
        (true_steps[plan.unique.record, axes["step"].index(one.dt)] > limits[one.method]) & (not spec.force_unstable)
        | (one.scheme.flies_exactly and not one.locate)
        for one in grid
    ]
    timed_laws = [int(plan.unique.law[rows[0]]) for rows in sample.timed]
    able = [reference, *(numerics for numerics, rows in zip(grid, refused, strict=True) if not rows.all())]
    kernels = [replace(plan.kernel(law), numerics=numerics) for numerics in able for law in timed_laws]
    prepare_kernels(kernels, workers, progress)

    def run(numerics: Numerics, part: Scenarios, is_refused: np.ndarray | bool = False) -> Values:
        values = run_rows(plan, part, numerics, outputs, is_refused)
        progress.advance(n)
        return values

    progress.stage("converged solution", 3 * n)
    double = replace(reference, dt=2.0 * reference.dt)
    checked = run(double, changed(table, 2.0**-52))  # no step changes what flies exactly, only its rounding
    converged, moved = run(reference, table), run(double, changed(table))
    reference_error = _errors(outputs, checked, converged)

    progress.stage("comparisons", len(grid) * n)
    ran = [run(numerics, table, rows[sample.rows]) for numerics, rows in zip(grid, refused, strict=True)]
    errors = np.stack([_errors(outputs, values, converged) for values in ran], axis=-1)
    errors[np.isnan(reference_error)] = np.nan

    seconds = np.full((len(sample.timed), len(grid), repeats), np.nan)
    progress.stage("costs", repeats * len(grid))
    of_laws = [sample.touching & (plan.unique.law == law) for law in timed_laws]
    for repeat, i in product(range(repeats), range(len(grid))):
        for j, rows in enumerate(sample.timed):
            if not refused[i][of_laws[j]].any():
                kernel, part = replace(plan.kernel(timed_laws[j]), numerics=grid[i]), plan.unique[rows]
                record, variants = spec.records[part.record[0]], plan.variants[part.variant]
                task = ChunkTask(kernel, record, part, variants, plan.spec.outputs)
                started = time.thread_time()
                run_once(task)
                seconds[j, i, repeat] = (time.thread_time() - started) / len(rows)
        progress.advance(1)
    # of the sweep's mix of laws, by the mean length of their records
    durations = np.array([record.duration for record in spec.records])[plan.unique.record]
    lengths = [durations[rows].mean() / durations[timed[0]] for rows, timed in zip(of_laws, sample.timed, strict=True)]
    best, median = (1e3 * s.T * np.array(lengths) for s in (seconds.min(axis=-1), np.median(seconds, axis=-1)))
    shares = np.mean(of_laws, axis=1) / sample.touching.mean()

    shape = [len(values) for values in axes.values()]
    statuses = np.stack([values["status"] for values in ran], axis=-1).astype(np.int8)
    data = {
        "scenario_error": (("scenario", "output", *CONFIGURATION), errors.reshape(n, len(outputs), *shape)),
        "scenario_status": (("scenario", *CONFIGURATION), statuses.reshape(n, *shape)),
        "scenario_reference_error": (("scenario", "output"), reference_error),
        "sensitivity": (("scenario",), _errors(outputs, moved, checked).max(axis=1)),
        "law_cost": (("law", *CONFIGURATION), best.T.reshape(-1, *shape)),
        "cost": (CONFIGURATION, (best @ shares).reshape(shape)),
        "cost_median": (CONFIGURATION, (median @ shares).reshape(shape)),
    }
    coordinates = {
        **{name: list(values) for name, values in axes.items()},
        "located": np.array(axes["located"], np.int8),
        "time_step": (("record", "step"), true_steps),
        "output": list(outputs),
        "status": [s.label for s in STATUS],
        "law": [plan.laws[law].key for law in timed_laws],
        "record": [record.name for record in spec.records],
        "pair": list(spec.scene.pair_labels),
        "scenario": np.arange(1, n + 1),
        **listed_coordinates(plan, sample.rows, "scenario", "scenario_"),
    }
    state = diagnose()
    machine = {name: state["processor"][name] for name in ("name", "vector_bits", "lanes_per_kernel", "cores")}
    attributes = {
        **global_attributes(f"Speed-accuracy trade: {spec.title or 'sweep of seismic pounding of adjacent buildings'}"),
        KIND_ATTRIBUTE: KIND,
        "sample_scenarios": n,
        "touching_scenarios": int(sample.touching.sum()),
        "unique_scenarios": len(plan.unique),
        "reference": f"{reference.method}, located, {reference.precision}",
        "reference_step": reference.dt,
        "resolution_factor": RESOLUTION,
        "input_change": CHANGE,
        "sensitive_change": OK_CLAIM,
        "machine": json.dumps({"system": state["system"], **machine}),
        "unit_system": "kN, t, m, s",
        "sweep": to_json(spec),
        "sweep_sha256": digest(spec),
        **{f"{name}_version": version for name, version in library_versions().items()},
        "seed": seed,
        "repeats": repeats,
    }
    return xr.Dataset(data, coordinates, attributes)


def _step(record: Record, step: float) -> float:
    """Time step (s) that is taken for a largest one: the record's, divided evenly."""
    return record.dt / Numerics("rk4", step).steps(record)


def _errors(outputs: Sequence[str], values: Values, reference: Values) -> np.ndarray:
    """Relative errors (n, outputs): infinite where the run diverged, NaN where it or the reference has no values."""
    errors = relative_errors(outputs, values, reference)
    table = np.stack([errors[name] for name in outputs], axis=1)
    table[values["status"] == Status.DIVERGED] = np.inf
    table[(values["status"] == Status.BEYOND_STABILITY_LIMIT) | (reference["status"] == Status.DIVERGED)] = np.nan
    return table


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
    return finite & ~(as_good & ~as_good.T).any(axis=1)


def statistics(errors: xr.DataArray, among: xr.DataArray | bool = True) -> xr.DataArray:
    """Return the statistics of scenarios' errors; each is the error of one of them, so that infinity stays infinity."""
    valid = errors.notnull().all("output") & among
    errors = errors.where(valid)
    rising = errors.copy(data=np.sort(errors, axis=errors.get_axis_num("scenario")))
    share = xr.DataArray(list(STATISTICS.values()), dims="statistic", coords={"statistic": list(STATISTICS)})
    last = np.ceil(share * valid.sum("scenario")).astype(int) - 1
    return rising.reset_coords(drop=True).drop_vars("scenario", errors="ignore").isel(scenario=last.clip(0))


def summarise(measured: xr.Dataset) -> xr.Dataset:
    """Sum up what `measure` found, over all laws and by law."""
    runs = measured.assign(sensitive=(measured.sensitivity > OK_CLAIM).astype(np.int8))
    sensitive, ok = runs.sensitive == 1, runs.scenario_status == Status.OK
    compared = runs.scenario_error.notnull().all("output")

    def populations(ok: xr.DataArray) -> xr.DataArray:
        masks = [xr.ones_like(ok), ~sensitive, sensitive, ok, ok & ~sensitive]
        together = xr.Dataset(dict(enumerate(masks))).to_array("population")
        return together.assign_coords(population=list(POPULATIONS))

    def summary(selected: xr.DataArray | bool, cost: xr.DataArray) -> xr.Dataset:
        among = populations(ok) & selected
        error = statistics(runs.scenario_error, among).transpose(*CONFIGURATION, "output", "population", ...)
        resolution = RESOLUTION * statistics(runs.scenario_reference_error, among & compared).transpose(*error.dims)
        reached = np.maximum(error.values, resolution.values)  # below it, two errors can't be told apart
        front = [pareto_front(cost.values.ravel(), column) for column in reached.reshape(cost.size, -1).T]
        pareto = error.copy(data=np.stack(front, axis=-1).astype(np.int8).reshape(error.shape))
        resolved = (error >= resolution).astype(np.int8)
        return xr.Dataset({"error": error, "resolution": resolution, "resolved": resolved, "pareto": pareto})

    costs = [(runs.scenario_law == law, runs.law_cost.sel(law=law, drop=True)) for law in runs.law.values]
    by_law = xr.concat([summary(*law) for law in costs], runs.law).drop_vars("resolution")
    codes = xr.DataArray([int(status) for status in STATUS], {"status": runs.status}, dims="status")
    reference = statistics(runs.scenario_reference_error, populations(xr.ones_like(sensitive)))
    by_law = by_law.rename({name: f"law_{name}" for name in by_law.data_vars})
    trade = runs.merge(summary(True, runs.cost)).merge(by_law)
    trade["status_count"] = (runs.scenario_status == codes).sum("scenario").astype(np.int32)
    trade["reference_error"] = reference.transpose("output", "population", "statistic")
    for name, variable in trade.variables.items():
        if about := _ABOUT.get(str(name).removeprefix("law_")):
            text, units = about
            flags = {"flag_values": np.arange(len(units.split()), dtype=np.int8), "flag_meanings": units}
            variable.attrs = {"long_name": text} | (flags if " " in units else unit_attributes(units))
    return trade.assign_attrs(sensitive_scenarios=int(sensitive.sum()))


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
    located, precisions : iterable of bool and of str
        With contacts located inside the step, without, or both; number formats, out of "float64" and "float32".
    scenarios, seed : int
        About how many scenarios errors are measured on, and the seed of the random sample.
    repeats : int
        Passes over all configurations in which costs are measured.
    workers, progress : int and Progress, optional
        Processes that compile kernels, one per core by default (costs are always of one core); and the display.

    Returns
    -------
    xarray.Dataset
        ``error`` on (scheme, located, precision, step, output, population, statistic), ``cost`` (s per thousand
        scenarios), ``status_count``, ``pareto``, the same by law, and the errors of every single scenario; settings,
        machine and sweep as attributes.

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
    modes = tuple(dict.fromkeys(bool(value) for value in located))
    for name, count in (("scenarios", scenarios), ("repeats", repeats), ("located", len(modes))):
        if count < 1:
            raise InputError(f"{name} = {count!r} must be at least 1")
    axes = {
        "scheme": _chosen("method", measured_schemes() if methods is None else methods, METHODS),
        "located": modes,
        "precision": _chosen("precision", precisions, PRECISIONS),
        "step": _distinct_steps(sweep.spec, steps),
    }
    sizes = {"scenarios": scenarios, "seed": seed, "repeats": repeats}
    return summarise(measure(sweep.spec, axes, workers=workers, progress=progress or Progress(), **sizes))


def _chosen(kind: str, requested: Iterable[str], valid: Sequence[str]) -> tuple[str, ...]:
    """Return the names asked for, in the order of `valid`."""
    names = set(requested)
    for name in names:
        check_choice(kind, name, valid)
    if not names:
        raise InputError(f"no {kind} is given; valid: {', '.join(valid)}")
    return tuple(name for name in valid if name in names)


def _distinct_steps(spec: SweepSpec, steps: Iterable[float]) -> tuple[float, ...]:
    """Return the steps from the largest to the smallest, one of those that cut every record alike."""
    by_cut: dict[tuple[float, ...], float] = {}
    for step in sorted((float(s) for s in steps), reverse=True):
        if not (math.isfinite(step) and step > 0):
            raise InputError(f"step {step!r} must be a positive number (s), such as 1e-3")
        by_cut.setdefault(tuple(_step(record, step) for record in spec.records), step)
    if not by_cut:
        raise InputError("no steps are given; give one or more (s), such as 1e-3")
    return tuple(by_cut.values())


# --- reports ----------------------------------------------------------------------------------------------------------

#: Outputs that a reader looks at first, and their names in tables.
LEADING = {"impact_force_max": "force", "displacement_max": "displ."}
#: What is told of an error: its name, the variable and its type.
_CELL = {"value": ("error", float), "resolution": ("resolution", float), "pareto": ("pareto", bool)}
#: Smallest order of convergence that is shown: errors of rounding do not fall with the step.
LEAST_ORDER = 0.05


def check_trade(dataset: xr.Dataset) -> None:
    """Raise `InputError` unless a dataset was made by `tradeoff`."""
    if dataset.attrs.get(KIND_ATTRIBUTE) != KIND:
        raise InputError(
            "this file is no speed-accuracy trade; make one with 'pounding-sweep tradeoff SWEEP.toml -o TRADE.nc'"
        )


def leading_outputs(trade: xr.Dataset) -> list[str]:
    """Return the two outputs that tables and figures show: peak force and displacement where they are there."""
    outputs = trade["output"].values.tolist()
    return [*(name for name in LEADING if name in outputs), *(name for name in outputs if name not in LEADING)][:2]


def _by_label(values: Any, *labels: Sequence[str]) -> Any:
    """Return nested lists as dictionaries by the labels of each of their dimensions."""
    if not labels:
        return finite(values)
    return {label: _by_label(part, *labels[1:]) for label, part in zip(labels[0], values, strict=True)}


def trade_rows(trade: xr.Dataset) -> list[dict[str, Any]]:
    """Return one row per configuration."""
    check_trade(trade)
    trade, rows = trade.load(), []
    labels = [trade[dim].values.tolist() for dim in ("output", "population", "statistic")]
    for place in product(*(range(trade.sizes[dim]) for dim in CONFIGURATION)):
        one = trade.isel(dict(zip(CONFIGURATION, place, strict=True)))
        if SCHEMES[one["scheme"].item()].flies_exactly and not one["located"]:
            continue  # there is no such thing: it flies exactly between located touches
        cells = [one[name].values.astype(kind).astype(object) for name, kind in _CELL.values()]
        rows.append(
            {name: one[name].item() for name in CONFIGURATION}
            | {"located": bool(one["located"]), "time_steps": one["time_step"].to_series().to_dict()}
            | {name: finite(one[name].item()) for name in ("cost", "cost_median")}
            | {"statuses": {label: count for label, count in one["status_count"].to_series().items() if count}}
            | {"errors": _by_label(np.stack(cells, axis=-1).tolist(), *labels, list(_CELL))}
        )
    return rows


def report(trade: xr.Dataset) -> dict[str, Any]:
    """Return every output, population and statistic of a trade, for JSON."""
    counts = ("sample_scenarios", "sensitive_scenarios", "touching_scenarios", "unique_scenarios")
    errors = trade["reference_error"].transpose("output", "population", "statistic")
    return {
        **{name: int(trade.attrs[name]) for name in counts},
        "reference_step": float(trade.attrs["reference_step"]),
        "reference_errors": _by_label(errors.values.tolist(), *(errors[dim].values.tolist() for dim in errors.dims)),
        "configurations": trade_rows(trade),
    }


def table_of(trade: xr.Dataset, population: str = "steady") -> tuple[list[str], list[list[str]]]:
    """Return the headings and rows of the table on the terminal."""
    columns = list(product(leading_outputs(trade), ("median", "worst")))
    rows = []
    for row in trade_rows(trade):
        statuses = dict(row["statuses"])
        ok = statuses.pop(Status.OK.label, 0)
        is_refused = statuses.get(Status.BEYOND_STABILITY_LIMIT.label) == trade.sizes["scenario"]
        steps = sorted(set(row["time_steps"].values()))
        others = ", ".join(f"{count} {label.replace('_', ' ')}" for label, count in statuses.items())
        rows.append(
            [
                row["scheme"],
                "yes" if row["located"] else "no",
                row["precision"],
                " to ".join(f"{step:.4g}" for step in dict.fromkeys((steps[0], steps[-1]))),
                "-" if row["cost"] is None else f"{row['cost']:.3g}",
                *(_error_text(row["errors"][name][population][statistic], is_refused) for name, statistic in columns),
                str(ok),
                others or "-",
            ]
        )
    errors = [f"{LEADING.get(name, name)} {statistic}" for name, statistic in columns]
    return ["scheme", "located", "precision", "step s", "s per 1000", *errors, "ok", "not ok"], rows


def _error_text(error: dict[str, Any], is_refused: bool) -> str:
    value, resolution = error["value"], error["resolution"]
    if value is None:
        text = "-" if is_refused or resolution is None else "diverged"
    else:
        text = f"{value:.1e}" if resolution is None or value >= resolution else f"<{resolution:.1e}"
    return text + ("*" if error["pareto"] else " ")


def order_table(trade: xr.Dataset) -> tuple[list[str], list[list[str]]]:
    """Return the headings and rows of the orders of convergence: one row per law and leading output."""
    schemes = trade["scheme"].values.tolist()
    median = trade.sel(population="steady", statistic="median", precision="float64")
    median = median.isel(located=int(np.argmax(trade["located"].values)))
    rows = []
    for law, output in product(trade["law"].values.tolist(), leading_outputs(trade)):
        cells = [law, LEADING.get(output, output)]
        for scheme in schemes:
            one = median.sel(law=law, output=output, scheme=scheme)
            error, step = one["law_error"].values, one["step"].values
            fitted = np.isfinite(error) & (error > 0.0) & (one["law_resolved"].values == 1)
            fit = np.polyfit(np.log(step[fitted]), np.log(error[fitted]), 1)[0] if fitted.sum() >= 3 else math.nan
            cells.append(f"{fit:.1f}" if fit >= LEAST_ORDER else "-")  # else all errors are rounding
        rows.append(cells)
    return ["law", "output", *(f"{scheme} order" for scheme in schemes)], rows
