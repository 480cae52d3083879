"""The trade as rows: one per configuration, for a table or for JSON."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.accuracy.tradeoff import CONFIGURATION, KIND, KIND_ATTRIBUTE
from pounding_sweep.base.errors import InputError
from pounding_sweep.base.text import finite
from pounding_sweep.outputs.variables import Status, get_variable
from pounding_sweep.schemes import SCHEMES

#: Outputs that a reader looks at first.
LEADING = ("impact_force_max", "displacement_max")
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
    outputs = [str(name) for name in trade["output"].values]
    leading = [name for name in LEADING if name in outputs]
    return (leading + [name for name in outputs if name not in leading])[: len(LEADING)]


def trade_rows(trade: xr.Dataset) -> list[dict[str, Any]]:
    """Return one row per configuration."""
    check_trade(trade)
    trade = trade.load()
    dims = ("output", "population", "statistic")
    outputs, populations, statistics = (trade[dim].values.tolist() for dim in dims)
    rows = []
    for place in product(*(range(trade.sizes[dim]) for dim in CONFIGURATION)):
        one = trade.isel(dict(zip(CONFIGURATION, place, strict=True)))
        row: dict[str, Any] = {name: one[name].item() for name in CONFIGURATION} | {"located": bool(one["located"])}
        if (scheme := SCHEMES.get(row["scheme"])) is not None and scheme.flies_exactly and not row["located"]:
            continue  # there is no such thing: it flies exactly between located touches
        row["time_steps"] = dict(zip(one["record"].values.tolist(), one["time_step"].values.tolist(), strict=True))
        row |= {name: finite(one[name].item()) for name in ("cost", "cost_median")}
        counts = zip(one["status"].values.tolist(), one["status_count"].values.tolist(), strict=True)
        row["statuses"] = {label: count for label, count in counts if count}
        values, limits, front = (one[name].transpose(*dims).values for name in ("error", "resolution", "pareto"))

        def cell(*at: int, values: Any = values, limits: Any = limits, front: Any = front) -> dict[str, Any]:
            numbers = {"value": finite(float(values[at])), "resolution": finite(float(limits[at]))}
            return numbers | {"pareto": bool(front[at])}

        row["errors"] = {
            output: {
                population: {statistic: cell(i, j, k) for k, statistic in enumerate(statistics)}
                for j, population in enumerate(populations)
            }
            for i, output in enumerate(outputs)
        }
        rows.append(row)
    return rows


def table_of(trade: xr.Dataset, population: str = "steady") -> tuple[list[str], list[list[str]]]:
    """Return the headings and rows of the table on the terminal."""
    shown = leading_outputs(trade)
    headings = ["scheme", "located", "precision", "step s", "s per 1000"]
    headings += [f"{_short(name)} {statistic}" for name in shown for statistic in ("median", "worst")]
    headings += ["ok", "not ok"]
    rows = []
    for row in trade_rows(trade):
        statuses = dict(row["statuses"])
        ok = statuses.pop(Status.OK.label, 0)
        refused = statuses.get(Status.BEYOND_STABILITY_LIMIT.label, 0) == trade.sizes["scenario"]
        true_steps = sorted(set(row["time_steps"].values()))
        cells = [
            row["scheme"],
            "yes" if row["located"] else "no",
            row["precision"],
            " to ".join(f"{s:.4g}" for s in true_steps[:: max(1, len(true_steps) - 1)]),
            "-" if row["cost"] is None else f"{row['cost']:.3g}",
        ]
        for name in shown:
            errors = row["errors"][name][population]
            cells += [_error_text(errors[statistic], refused) for statistic in ("median", "worst")]
        cells += [str(ok), ", ".join(f"{count} {label.replace('_', ' ')}" for label, count in statuses.items()) or "-"]
        rows.append(cells)
    return headings, rows


def order_table(trade: xr.Dataset) -> tuple[list[str], list[list[str]]]:
    """Return the headings and rows of the orders of convergence: one row per law and leading output."""
    schemes = [str(name) for name in trade["scheme"].values]
    median = trade.sel(population="steady", statistic="median")
    rows = []
    for law in (str(name) for name in trade["law"].values):
        for output in leading_outputs(trade):
            cells = [law, _short(output)]
            for scheme in schemes:
                place = {"law": law, "output": output, "scheme": scheme, "precision": "float64"}
                one = median.sel(place).isel(located=int(np.argmax(trade["located"].values)))
                error, step = one["law_error"].values, one["step"].values
                fitted = np.isfinite(error) & (error > 0.0) & (one["law_resolved"].values == 1)
                points = np.log(step[fitted]), np.log(error[fitted])
                fit = np.polyfit(*points, 1)[0] if fitted.sum() >= 3 else math.nan
                cells.append(f"{fit:.1f}" if fit >= LEAST_ORDER else "-")  # else all errors are rounding
            rows.append(cells)
    return ["law", "output", *(f"{scheme} order" for scheme in schemes)], rows


def _error_text(error: dict[str, Any], refused: bool) -> str:
    value, resolution = error["value"], error["resolution"]
    mark = "*" if error["pareto"] else " "
    if value is None:
        return f"{'-' if refused or resolution is None else 'diverged'}{mark}"
    if resolution is not None and value < resolution:
        return f"<{resolution:.1e}{mark}"
    return f"{value:.1e}{mark}"


def _short(name: str) -> str:
    """Name an output briefly."""
    return {"impact_force_max": "force", "displacement_max": "displ."}.get(name, get_variable(name).name)
