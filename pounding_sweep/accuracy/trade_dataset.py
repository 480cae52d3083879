"""From measured errors and costs to a labelled dataset: statistics, the Pareto front, CF attributes."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.accuracy.trade_measure import Measured
from pounding_sweep.output.dataset import CONVENTIONS, VERSION_ATTRIBUTE, package_version
from pounding_sweep.outputs.differences import CHANGE
from pounding_sweep.outputs.variables import OK_CLAIM, STATUS, Status
from pounding_sweep.spec.spec import digest, to_json

if TYPE_CHECKING:
    import xarray as xr

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


def make_dataset(measured: Measured, settings: Mapping[str, Any]) -> xr.Dataset:
    """Sum up and label what was measured."""
    import xarray as xr

    m = measured
    rows_law = m.plan.unique.law[m.sample.rows]
    populations = _populations(m)
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


def _populations(m: Measured) -> dict[str, np.ndarray]:
    """Masks of the scenarios, shape (*configurations, n)."""
    shape = m.statuses.shape
    sensitive = np.broadcast_to(m.sensitive, shape)
    ok = m.statuses == Status.OK
    masks = {
        "all": np.ones(shape, bool),
        "steady": ~sensitive,
        "sensitive": sensitive,
        "ok": ok,
        "ok_steady": ok & ~sensitive,
    }
    return {name: masks[name] for name in POPULATIONS}


def _sums(m: Measured, populations: dict[str, np.ndarray], mine: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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


def _reference_sums(m: Measured) -> np.ndarray:
    """Statistics of the converged solution's own error, shape (outputs, populations, statistics)."""
    sensitive = m.sensitive
    every = np.ones_like(sensitive)
    chosen = {
        "all": every,
        "steady": ~sensitive,
        "sensitive": sensitive,
        "ok": every,
        "ok_steady": ~sensitive,
    }
    return np.stack([statistics(m.reference_errors[chosen[name]]) for name in POPULATIONS], axis=1)


def _costs(m: Measured) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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


def _coordinates(m: Measured) -> dict[str, Any]:
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
        "pair": (list(spec.scene.pair_names), "pair of neighbours, left-right"),
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
        "scenario_record": (
            per,
            [spec.records[i].name for i in table.record],
            {"long_name": "ground-motion record"},
        ),
        "scenario_scale": (per, table.scale, {"units": "1", "long_name": "factor on the record"}),
        "scenario_gap": (("scenario", "pair"), table.gaps, {"units": "m", "long_name": "gap of the pair"}),
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


def _attributes(m: Measured, settings: Mapping[str, Any]) -> dict[str, Any]:
    import numba
    import xarray

    from pounding_sweep.run.diagnosis import diagnose

    version = package_version()
    machine = diagnose()
    processor = {k: machine["processor"][k] for k in ("name", "vector_bits", "lanes_per_kernel", "cores")}
    records = [
        {"name": r.name, "pga": r.pga, "dt": r.dt, "points": r.n_points, "sha256": r.sha256, "source": r.source}
        for r in m.spec.records
    ]
    return {
        "Conventions": CONVENTIONS,
        "title": f"Speed-accuracy trade: {m.spec.title or 'sweep of seismic pounding of adjacent buildings'}",
        "source": f"pounding_sweep {version}",
        "history": f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ} made by pounding_sweep {version}",
        VERSION_ATTRIBUTE: version,
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
