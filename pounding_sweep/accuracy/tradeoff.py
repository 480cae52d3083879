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
from pounding_sweep.base.errors import InputError, SweepError, check_choice
from pounding_sweep.base.files import read_data
from pounding_sweep.base.text import finite, scientific
from pounding_sweep.engine.row_kernel import Numerics
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.output.dataset import global_attributes, unit_attributes
from pounding_sweep.output.identity import library_versions
from pounding_sweep.output.labels import listed_coordinates
from pounding_sweep.plan.plan import Plan, make_plan, untouched
from pounding_sweep.plan.scenarios import Scenarios, changed
from pounding_sweep.request.spec import DEFAULT_ACCURACY, METHODS, PRECISIONS, SweepSpec, digest, to_json, with_accuracy
from pounding_sweep.run.diagnosis import diagnose
from pounding_sweep.run.execute import Progress
from pounding_sweep.run.refinement import run_scenarios
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.schemes.stability import largest_step
from pounding_sweep.variables.registry import CHANGE, OK_CLAIM, STATUS, Status, comparable, inner_shape, relative_errors

#: Steps (s) compared by default.
DEFAULT_STEPS = (5e-3, 2.5e-3, 1e-3, 5e-4, 2.5e-4)
#: Schemes and accuracies compared by default.
DEFAULT_METHODS, DEFAULT_ACCURACIES = ("rk4", "exact"), (1e-2, 1e-3, 1e-4)
#: Largest step (s) of the runs without pounding that tell which scenarios can touch.
CLOSING_STEP = 1.0e-3
#: Scenarios of one timed call.
TIMED = 4 * LANES
#: The converged solution's step is the finest compared over this, and at most that share of the stability limit.
REFINEMENT, REFERENCE_SHARE = 8, 0.125
#: Errors below this many times the converged solution's own error are not resolved.
RESOLUTION = 3.0
#: Shares of the scenarios whose error is at most the statistic.
STATISTICS = {"median": 0.5, "p90": 0.9, "worst": 1.0}
#: Attribute by which a dataset is known as a trade, and its value.
KIND_ATTRIBUTE, KIND = "pounding_sweep_kind", "tradeoff"
_TEXTS = read_data("tradeoff.toml")
#: Sets of scenarios that statistics are made of.
POPULATIONS: dict[str, str] = _TEXTS["populations"]
_NUMBERS: dict[str, Any] = {"RESOLUTION": RESOLUTION, "CHANGE": CHANGE, "OK_CLAIM": OK_CLAIM}
_NUMBERS["STATUS"] = " ".join(status.label for status in STATUS)
#: Long name and units (or meanings of flags) of what a trade holds; ``law_error`` has those of ``error``.
_ABOUT = {name: [text.format(**_NUMBERS) for text in texts] for name, texts in _TEXTS["variables"].items()}
_ABOUT["population"] = ["; ".join(f"{key}: {text}" for key, text in POPULATIONS.items()), ""]

Values = dict[str, np.ndarray]


def run_rows(plan: Plan, table: Scenarios, steps: np.ndarray, outputs: Sequence[str], closing: bool = False) -> Values:
    """Run scenarios of a plan, at `steps` per record interval, as a sweep does; variables of shape (rows, *inner)."""
    values = {name: np.full((len(table), *inner_shape(name, plan.spec.scene)), np.nan) for name in outputs}
    values["status"] = np.full(len(table), Status.NOT_RUN)
    for law in np.unique(table.law).tolist():
        of_law = np.flatnonzero(table.law == law)
        for index, count, places in table[of_law].by_step(steps[of_law]):
            rows = of_law[places]
            task = plan.task(table[rows], law, index, count, closing=closing, outputs=outputs)
            result = run_scenarios(task._replace(once=False))
            for name in values.keys() & result.keys():
                values[name][rows] = result[name]
    return values


def at_step(plan: Plan, numerics: Numerics) -> Plan:
    """Return the plan with another scheme and step."""
    counts = np.array([numerics.steps(record) for record in plan.spec.records])
    return replace(plan, numerics=numerics, steps=counts[plan.unique.record], uncoupled_steps=counts[:, None])


def find_touching(plan: Plan) -> np.ndarray:
    """Rows of the plan's unique table in which floors can meet, found by runs without pounding."""
    one, table = np.ones(len(plan.variants)), plan.uncoupled_runs
    limit = largest_step(plan.variants, plan.laws[-1], 0.0 * one, one, method="rk4")
    alone = at_step(plan, replace(plan.numerics, method="rk4", dt=min(CLOSING_STEP, 0.5 * limit.min())))
    steps = alone.uncoupled_steps[table.record, 0]
    return ~untouched(plan, run_rows(alone, table, steps, ("closing_max",), closing=True)["closing_max"])


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


def setting_label(spec: SweepSpec, numerics: Numerics) -> str:
    """Name the setting of a sweep, as tables and figures do."""
    fixed = spec.accuracy is None
    parts = [
        f"accuracy {scientific(spec.accuracy)}" if spec.accuracy else "",
        numerics.method if fixed or spec.method else "",
        "" if spec.locate else "not located",
        numerics.precision if numerics.precision != "float64" and (fixed or spec.precision) else "",
        f"{1e3 * numerics.dt:.4g} ms" if fixed else "",
    ]
    return ", ".join(filter(None, parts))


def plan_setting(spec: SweepSpec, touching: np.ndarray) -> Plan | None:
    """Return the plan of a sweep, None where a run refuses it, or some of its scenarios that can touch."""
    try:
        plan = make_plan(spec)
    except SweepError:
        return None
    return None if plan.refused[touching].any() else plan


def fixed_settings(spec: SweepSpec, axes: Mapping[str, Sequence[Any]]) -> list[SweepSpec]:
    """Return the sweep with each scheme and step that takes its row."""
    return [
        replace(spec, method=method, locate=located, precision=precision, dt=step, accuracy=None)
        for method, located, precision, step in product(*axes.values())
        if SCHEMES[method].refuses(spec.scene, precision) is None and (located or not SCHEMES[method].flies_exactly)
    ]


class Trial(NamedTuple):
    """The settings to be measured, and the scenarios and the converged solution by which."""

    spec: SweepSpec
    plan: Plan  # of the sweep at the finest step
    sample: TradeSample
    table: Scenarios  # those that errors are measured on
    settings: Mapping[str, Plan]  # what is measured, by name: the sweep by a scheme at a step, or to an accuracy
    current: str  # name of the sweep's own, "" where a run refuses it
    reference: Numerics  # those of the converged solution


def plan_trial(
    spec: SweepSpec, axes: Mapping[str, Sequence[Any]], choices: Iterable[SweepSpec], scenarios: int, seed: int
) -> Trial:
    """Draw the scenarios of a trade and collect the settings that they run in."""
    if not comparable(spec.outputs):
        raise InputError(
            f"the outputs {', '.join(spec.outputs)} have no error; ask for others, such as impact_force_max"
        )
    finest = axes["step"][-1]
    plan = make_plan(replace(spec, method="rk4", dt=finest, locate=True, precision="float64", accuracy=None))
    sample = draw(plan, scenarios, seed)
    stable = REFERENCE_SHARE * plan.limit[sample.touching].min()
    exact = (name for name in SCHEMES if SCHEMES[name].flies_exactly and SCHEMES[name].refuses(spec.scene) is None)
    method = next(exact, "rk4")
    finer = REFINEMENT if SCHEMES[method].flies_exactly else 1.0  # than steps alone make it
    reference = replace(plan.numerics, method=method, dt=min(finest / REFINEMENT, stable), refinement=finer)
    chosen = (replace(one, method=None, locate=True, precision=None) for one in choices)
    current, *others = (plan_setting(one, sample.touching) for one in (spec, *chosen, *fixed_settings(spec, axes)))
    settings = {setting_label(one.spec, one.numerics): one for one in (*others, current) if one}
    if not settings:
        raise InputError("a run refuses every setting that was to be measured; give smaller steps")
    name = setting_label(current.spec, current.numerics) if current else ""
    return Trial(spec, plan, sample, plan.unique[sample.rows], settings, name, reference)


def measure(trial: Trial, *, repeats: int, workers: int | None, progress: Progress) -> xr.Dataset:
    """Run the scenarios of a trial in every setting: errors and costs, not summed up yet."""
    laws, plans = np.unique(trial.table.law).tolist(), (at_step(trial.plan, trial.reference), *trial.settings.values())
    kernels = [plan.kernel(law) for plan in plans for law in laws]
    doubles = [kernel.in_double for kernel in kernels if kernel.accuracy is not None]
    prepare_kernels([*kernels, *doubles], workers, progress)
    data = measure_errors(trial, progress) | measure_costs(trial, repeats, progress)
    return xr.Dataset(data, _coordinates(trial), _attributes(trial))


def measure_errors(trial: Trial, progress: Progress) -> dict[str, Any]:
    """Run scenarios in each setting, and compare them with their converged solution."""
    plan, table, settings, reference = trial.plan, trial.table, trial.settings, trial.reference
    outputs, n = comparable(plan.spec.outputs), len(table)

    def run(part: Scenarios, setting: Plan) -> Values:
        values = run_rows(setting, part, setting.steps[trial.sample.rows], plan.spec.outputs)
        progress.advance(n)
        return values

    progress.stage("converged solution", 3 * n)
    fine, twice = (
        at_step(plan, replace(reference, dt=k * reference.dt, refinement=reference.refinement / k)) for k in (1.0, 2.0)
    )
    rounded = changed(table, np.finfo(float).eps)  # no step changes what flies exactly, only its rounding
    converged = run(table, fine)
    checked, moved = (run(part, twice) for part in (rounded, changed(table)))
    reference_error = _errors(outputs, checked, converged)
    progress.stage("comparisons", len(settings) * n)
    ran = [run(table, setting) for setting in settings.values()]
    errors = np.stack([_errors(outputs, values, converged) for values in ran], axis=-1)
    errors[np.isnan(reference_error)] = np.nan
    statuses = np.stack([values["status"] for values in ran], axis=-1).astype(np.int8)
    return {
        "scenario_error": (("scenario", "output", "setting"), errors),
        "scenario_status": (("scenario", "setting"), statuses),
        "scenario_reference_error": (("scenario", "output"), reference_error),
        "sensitivity": (("scenario",), _errors(outputs, moved, checked).max(axis=1)),
    }


def measure_costs(trial: Trial, repeats: int, progress: Progress) -> dict[str, Any]:
    """Time each setting in turn, and weigh its laws as the sweep has them."""
    plan, (_, timed, touching), settings = trial.plan, trial.sample, trial.settings
    seconds = np.full((len(timed), len(settings), repeats), np.nan)
    progress.stage("costs", repeats * len(settings))
    for repeat, (i, setting) in product(range(repeats), enumerate(settings.values())):
        for j, rows in enumerate(timed):
            started = time.thread_time()
            run_rows(setting, plan.unique[rows], setting.steps[rows], plan.spec.outputs)
            seconds[j, i, repeat] = (time.thread_time() - started) / len(rows)
        progress.advance(1)
    of_laws = [touching & (plan.unique.law == plan.unique.law[rows[0]]) for rows in timed]
    # of the sweep's mix of laws, by the mean length of their records
    durations = np.array([record.duration for record in plan.spec.records])[plan.unique.record]
    lengths = [durations[rows].mean() / durations[first] for rows, (first, *_) in zip(of_laws, timed, strict=True)]
    best, median = (1e3 * s.T * np.array(lengths) for s in (seconds.min(axis=-1), np.median(seconds, axis=-1)))
    shares = np.mean(of_laws, axis=1) / touching.mean()
    costs = {"cost": best @ shares, "cost_median": median @ shares}
    return {"law_cost": (("law", "setting"), best.T), **{name: (("setting",), cost) for name, cost in costs.items()}}


def _coordinates(trial: Trial) -> dict[str, Any]:
    """Say what the settings of a trade are, and label its scenarios."""
    spec, plan, settings = trial.spec, trial.plan, trial.settings
    rows, touching = trial.sample.rows, trial.sample.touching
    intervals = np.array([record.dt for record in spec.records])
    least = np.full((len(intervals), len(settings)), np.iinfo(np.int32).max)
    for column, setting in zip(least.T, settings.values(), strict=True):
        np.minimum.at(column, plan.unique.record[touching], setting.steps[touching])
    numerics = [setting.numerics for setting in settings.values()]
    accuracy = np.array([setting.spec.accuracy or math.nan for setting in settings.values()])
    return {
        "setting": list(settings),
        "scheme": ("setting", [one.method for one in numerics]),
        "located": ("setting", np.array([one.locate for one in numerics], np.int8)),
        "precision": ("setting", [one.precision for one in numerics]),
        "accuracy": ("setting", accuracy),
        "step": ("setting", np.where(np.isnan(accuracy), [one.dt for one in numerics], np.nan)),
        "time_step": (("record", "setting"), intervals[:, None] / least),
        "output": list(comparable(spec.outputs)),
        "status": [s.label for s in STATUS],
        "law": [plan.laws[plan.unique.law[timed[0]]].key for timed in trial.sample.timed],
        "record": [record.name for record in spec.records],
        "pair": list(spec.scene.pair_labels),
        "scenario": np.arange(1, len(rows) + 1),
        **listed_coordinates(plan, rows, "scenario", "scenario_"),
    }


def _attributes(trial: Trial) -> dict[str, Any]:
    """Where a trade comes from: sweep, converged solution, machine."""
    spec, reference, state = trial.spec, trial.reference, diagnose()
    machine = {name: state["processor"][name] for name in ("name", "vector_bits", "lanes_per_kernel", "cores")}
    return {
        **global_attributes(f"Speed-accuracy trade: {spec.title or 'sweep of seismic pounding of adjacent buildings'}"),
        KIND_ATTRIBUTE: KIND,
        "own_setting": trial.current,
        "sample_scenarios": len(trial.sample.rows),
        "touching_scenarios": int(trial.sample.touching.sum()),
        "unique_scenarios": len(trial.plan.unique),
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
    }


def _errors(outputs: Sequence[str], values: Values, reference: Values) -> np.ndarray:
    """Relative errors (n, outputs): infinite where the run diverged, NaN where it or the reference has no values."""
    errors = relative_errors(outputs, values, reference)
    table = np.stack([errors[name] for name in outputs], axis=1)
    table[values["status"] == Status.DIVERGED] = np.inf
    table[(values["status"] == Status.BEYOND_STABILITY_LIMIT) | (reference["status"] == Status.DIVERGED)] = np.nan
    return table


def pareto_front(cost: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Say which points (of finite cost and error) no other one beats, as good in both and better in one.

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
        error = statistics(runs.scenario_error, among).transpose("setting", "output", "population", ...)
        resolution = RESOLUTION * statistics(runs.scenario_reference_error, among & compared).transpose(*error.dims)
        reached = np.maximum(error.values, resolution.values)  # below it, two errors can't be told apart
        front = [pareto_front(cost.values.ravel(), column) for column in reached.reshape(cost.size, -1).T]
        pareto = error.copy(data=np.stack(front, axis=-1).astype(np.int8).reshape(error.shape))
        resolved = (error >= resolution).astype(np.int8)
        return xr.Dataset({"error": error, "resolution": resolution, "resolved": resolved, "pareto": pareto})

    costs = [(runs.scenario_law == law, runs.law_cost.sel(law=law, drop=True)) for law in runs.law.values]
    by_law = xr.concat([summary(*law) for law in costs], runs.law).drop_vars("resolution")
    codes = xr.DataArray(list(STATUS), {"status": runs.status}, dims="status")
    reference = statistics(runs.scenario_reference_error, populations(xr.ones_like(sensitive)))
    by_law = by_law.rename({name: f"law_{name}" for name in by_law.data_vars})
    trade = runs.assign(summary(True, runs.cost)).assign(by_law)
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
    methods: Iterable[str] = DEFAULT_METHODS,
    located: Iterable[bool] = (True,),
    precisions: Iterable[str] = PRECISIONS,
    accuracies: Iterable[float] = DEFAULT_ACCURACIES,
    scenarios: int = 96,
    seed: int = 0,
    repeats: int = 2,
    workers: int | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Measure errors and costs of accuracies, schemes and steps on a sample of a sweep's scenarios.

    Parameters
    ----------
    sweep : Sweep
        The sweep, whose own setting is measured too.
    steps : iterable of float
        Largest time steps (s); of those that cut a record alike, one is kept.
    methods, located, precisions : iterable of str, of bool and of str
        Schemes; with contacts located inside the step, without, or both; number formats.
    accuracies : iterable of float
        Relative errors for which scheme and steps are chosen.
    scenarios, seed : int
        About how many scenarios errors are measured on, and the seed of the random sample.
    repeats : int
        Passes over all settings in which costs are measured.
    workers, progress : int and Progress, optional
        Processes that compile kernels, one per core by default (costs are always of one core); and the display.

    Returns
    -------
    xarray.Dataset
        ``error`` on (setting, output, population, statistic), ``cost`` (s per thousand scenarios), ``status_count``,
        ``pareto``, the same by law, and the errors of every scenario. A setting that a run refuses is left out.
        Machine, sweep and its ``own_setting`` are attributes.

    Raises
    ------
    InputError
        An argument is not valid, or no scenario can touch.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> sweep = ps.Sweep("mate2015", records="el_centro", laws="linear", gaps=[0.005, 0.01])
    >>> only = {"methods": ["exact"], "precisions": ["float64"], "accuracies": []}
    >>> trade = ps.tradeoff(sweep, steps=[1e-3], scenarios=2, repeats=1, **only)
    >>> worst = trade.error.sel(population="all", statistic="worst", output="impact_force_max")
    >>> bool((worst < 1e-3).all())
    True
    """
    modes = tuple(dict.fromkeys(bool(value) for value in located))
    for name, count in (("scenarios", scenarios), ("repeats", repeats), ("located", len(modes))):
        if count < 1:
            raise InputError(f"{name} = {count!r} must be at least 1")
    axes = {
        "scheme": _chosen("method", methods, METHODS),
        "located": modes,
        "precision": _chosen("precision", precisions, PRECISIONS),
        "step": _distinct_steps(sweep.spec, steps),
    }
    choices = [with_accuracy(sweep.spec, accuracy) for accuracy in accuracies]
    trial = plan_trial(sweep.spec, axes, choices, scenarios, seed)
    measured = measure(trial, repeats=repeats, workers=workers, progress=progress or Progress())
    return summarise(measured.assign_attrs(seed=seed, repeats=repeats))


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
        by_cut.setdefault(tuple(Numerics("rk4", step).steps(record) for record in spec.records), step)
    if not by_cut:
        raise InputError("no steps are given; give one or more (s), such as 1e-3")
    return tuple(by_cut.values())


# --- reports ----------------------------------------------------------------------------------------------------------

#: Outputs that a reader looks at first, and their names in tables.
LEADING = {"impact_force_max": "force", "displacement_max": "displ."}
#: What is told of an error: its name, the variable and its type.
_CELL = {"value": ("error", float), "resolution": ("resolution", float), "pareto": ("pareto", bool)}
#: Share of a cost that is noise.
NOISE = 0.1


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
    """Return one row per setting."""
    check_trade(trade)
    trade, rows = trade.load(), []
    labels = [trade[dim].values.tolist() for dim in ("output", "population", "statistic")]
    for place in range(trade.sizes["setting"]):
        one = trade.isel(setting=place)
        cells = [one[name].values.astype(kind).astype(object) for name, kind in _CELL.values()]
        rows.append(
            {name: one[name].item() for name in ("setting", "scheme", "precision")}
            | {"located": bool(one["located"]), "time_steps": one["time_step"].to_series().to_dict()}
            | {name: finite(one[name].item()) for name in ("accuracy", "step", "cost", "cost_median")}
            | {"statuses": {label: count for label, count in one["status_count"].to_series().items() if count}}
            | {"errors": _by_label(np.stack(cells, axis=-1).tolist(), *labels, list(_CELL))}
        )
    return rows


def compared(trade: xr.Dataset) -> xr.Dataset:
    """Return cost and worst error of each setting: of leading outputs, and no less than is resolved."""
    check_trade(trade)
    steady = int(trade.attrs["sample_scenarios"]) > int(trade.attrs["sensitive_scenarios"])
    at = {"output": leading_outputs(trade), "population": "steady" if steady else "all", "statistic": "worst"}
    error = trade[["error", "resolution"]].sel(at, drop=True).to_array().max(["variable", "output"])
    front = pareto_front(trade["cost"].values, error.values)
    return trade[["cost"]].assign(error=error, front=("setting", front))


def answer(trade: xr.Dataset) -> dict[str, Any]:
    """Return which setting to take, what to write into the sweep file, and how the sweep's own one compares.

    It is the cheapest accuracy as strict as the sweep's own or the default one, since that holds for every scenario;
    without one the cheapest setting that errs no more in the sample, and else the one that errs least.
    """
    settings, current = compared(trade), trade.attrs["own_setting"]
    accuracy, error = settings["accuracy"].values, settings["error"].values
    is_current = settings["setting"].values == current
    stated = accuracy[is_current & ~np.isnan(accuracy)]
    wanted = float(stated[0]) if len(stated) else DEFAULT_ACCURACY
    expected = is_current | (accuracy == wanted)  # noise is no reason for another one
    cost = settings["cost"].values * np.where(expected, 1.0 - NOISE, 1.0)
    ok = trade["status_count"].sel(status=Status.OK.label).values
    fitting, least = (error <= wanted) & (ok == ok.max()), error == np.fmin.reduce(error)

    def cheapest(*choices: np.ndarray) -> dict[str, Any]:
        able = next((rows for rows in choices if rows.any()), np.ones(len(cost), bool))
        return numbers_of(settings["setting"].values[np.where(able, cost, math.inf).argmin()])

    def numbers_of(label: str) -> dict[str, Any]:
        one, names = (
            settings.sel(setting=label),
            ("setting", "scheme", "precision", "accuracy", "step", "cost", "error"),
        )
        return {name: finite(one[name].item()) for name in names} | {"located": bool(one["located"])}

    best = cheapest(accuracy <= wanted, fitting, least)
    solver = {name: best[key] for name, key in (("method", "scheme"), ("dt", "step"), ("locate", "located"))}
    solver = solver | {"precision": best["precision"]} if best["accuracy"] is None else {"accuracy": best["accuracy"]}
    compared_with = {"own": numbers_of(current) if current else None, "fastest": cheapest(fitting, least)}
    return {"wanted": wanted, "solver": solver, "best": best, **compared_with}


def report(trade: xr.Dataset) -> dict[str, Any]:
    """Return every output, population and statistic of a trade, for JSON."""
    counts = ("sample_scenarios", "sensitive_scenarios", "touching_scenarios", "unique_scenarios")
    errors = trade["reference_error"].transpose("output", "population", "statistic")
    return {
        **{name: int(trade.attrs[name]) for name in counts},
        "answer": answer(trade),
        "reference_step": float(trade.attrs["reference_step"]),
        "reference_errors": _by_label(errors.values.tolist(), *(errors[dim].values.tolist() for dim in errors.dims)),
        "settings": trade_rows(trade),
    }


def table_of(trade: xr.Dataset, population: str = "steady", full: bool = True) -> tuple[list[str], list[list[str]]]:
    """Return the headings and rows of the table on the terminal: of few settings, or in `full`."""
    columns, settings = list(product(leading_outputs(trade), ("median", "worst"))), compared(trade)
    current, is_front = settings["setting"].values == trade.attrs["own_setting"], settings["front"].values
    order = np.arange(trade.sizes["setting"]) if full else np.argsort(settings["cost"].values)
    listed, rows = current | is_front | np.isfinite(settings["accuracy"].values) | full, []
    all_rows = trade_rows(trade)
    for place in order[listed[order]].tolist():
        row = all_rows[place]
        statuses = dict(row["statuses"])
        statuses.pop(Status.OK.label, 0)
        others = ", ".join(f"{count} {label.replace('_', ' ')}" for label, count in statuses.items())
        cells = (_error_text(row["errors"][name][population][statistic]) for name, statistic in columns)
        label = row["setting"] + "*" * bool(is_front[place]) + " (yours)" * bool(current[place])
        rows.append([label, f"{row['cost']:.3g}", *cells, others or "-"])
    errors = [f"{LEADING.get(name, name)} {statistic}" for name, statistic in columns]
    return ["setting", "s/1000", *errors, "not ok"], rows


def _error_text(error: dict[str, Any]) -> str:
    value, resolution = error["value"], error["resolution"]
    if value is None:
        return "-" if resolution is None else "diverged"
    return f"{value:.1e}" if resolution is None or value >= resolution else f"<{resolution:.1e}"
