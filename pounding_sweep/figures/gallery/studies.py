"""What inputs matter, and what accuracy costs."""

from __future__ import annotations

from collections.abc import Collection
from itertools import product
from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.accuracy.tradeoff import check_trade, leading_outputs
from pounding_sweep.base.errors import InputError
from pounding_sweep.figures import SALTELLI, figure_of
from pounding_sweep.figures.select import (
    RESPONSES,
    NothingToDrawError,
    check_value,
    coord_text,
    labels_with_values,
    law_name,
    record_name,
    result_of,
    use_logarithms,
    with_dims,
)
from pounding_sweep.figures.style import COLOURS, MARKED, finish, join_nonempty, subplots
from pounding_sweep.outputs.variables import get_variable

#: Rows of panels at most.
_GROUPS = 3
#: What tells groups of scenarios apart.
_GROUP = ("law", "record", "beside")
#: What is drawn of each input: how it is called, colour, marker, and how far above its place.
_INDICES = {
    "first": ("first index: of the input alone", COLOURS[1], "o", 0.16),
    "total": ("total index: with what it does together with others", COLOURS[2], "s", -0.16),
}


@figure_of("sensitivity", "design", SALTELLI)
def sensitivity(cube: xr.Dataset, *, value: str | None = None, ax: Any = None) -> Figure:
    """Draw which inputs of a design matter: first and total Sobol indices.

    Bars are confidence intervals; inputs that matter most are at the top. One column per pair or building, at its
    highest storey that has indices, one row per law, record and value of other axes, three at most.
    """
    result = result_of(cube, "sensitivity")
    names = [str(name).removesuffix("_total") for name in result.data_vars if str(name).endswith("_total")]
    check_value(value, names)
    valued = [name for name in (*RESPONSES, *names) if name in names and result[f"{name}_total"].notnull().any()]
    if not valued or value not in (None, *valued):
        raise NothingToDrawError
    value = value or valued[0]
    key = f"{value}_total"
    per = next((dim for dim in ("pair", "building") if dim in result[key].dims), "scenario")
    result = with_dims(result, per, absent="")
    result = result.sel({per: labels_with_values(result, per, [key])})
    if "storey" in result[key].dims:  # the highest that has indices
        there = result[key].notnull().any(["group", "input"])
        result = result.isel(storey=there.cumsum("storey").argmax("storey"))
    complete = result[key].notnull().all("input").any(per).values
    groups = np.flatnonzero(complete) if complete.any() else np.arange(1)
    shown = groups[:_GROUPS]
    rank = result[key].isel(group=shown).mean(["group", per])
    order = np.argsort(rank.fillna(0.0).values, kind="stable")  # the largest last, at the top
    figure, axes = subplots(len(shown), result.sizes[per], (2.2, 2.4, 1.5, 0.6 + 0.3 * len(order)), ax)
    varied = [name for name in _GROUP if name in result.coords and len({*result[name].values[groups].tolist()}) > 1]
    extremes = [0.0, 1.0]
    for (row, column), panel in np.ndenumerate(axes):
        part = result.isel({per: column, "group": int(shown[row]), "input": order})
        for name, (label, colour, marker, up) in _INDICES.items():
            at = np.arange(len(order)) + up
            low, high = part[f"{value}_{name}_interval"].transpose("bound", "input").values
            panel.hlines(at, low, high, color=colour, linewidth=1.0)
            panel.plot(part[f"{value}_{name}"], at, color=colour, marker=marker, linestyle="none", label=label)
            extremes += [*low, *high]
        panel.axvline(0.0, color="0.6", linewidth=0.8, zorder=0)
        place = [coord_text(part, dim) for dim in (per, "storey") if dim in part.coords]
        lines = [join_nonempty(*place), _describe_group(part, varied)]
        panel.set_title("\n".join(fill(text, 34) for text in lines if text))
    inputs = [str(name).replace("_", " ") for name in result["input"].values[order]]
    limits = {"xlim": (np.nanmin(extremes) - 0.03, np.nanmax(extremes) + 0.03), "ylim": (-0.6, len(order) - 0.4)}
    for panel in axes[:, 0]:
        panel.set(yticks=range(len(inputs)), yticklabels=inputs, **limits)
    what = str(result[key].attrs["long_name"]).removeprefix("total Sobol index: ")
    cut = f"{len(shown)} of {len(groups)} groups of scenarios" if len(shown) < len(groups) else ""
    same = _describe_group(result.isel(group=int(shown[0])), [name for name in _GROUP if name not in varied])
    title = f"Sobol indices of the {what}", f"{result.attrs['confidence']:.0%} intervals", same, cut
    return finish(figure, axes, "share of the variance (-)", ["input"] * len(shown), *title, legend=1)


def _describe_group(group: xr.Dataset, names: Collection[str]) -> str:
    """Say that of a group of scenarios which `names` mean."""
    law, record, beside = (str(group[name].item()) if name in names and name in group.coords else "" for name in _GROUP)
    of = "records drawn" if record == "drawn" else f"record {record_name(record)}" if record else ""
    return join_nonempty(law_name(group, law) if law else "", of, beside.replace("_", " "))


@figure_of("work-precision", "trade", "scheme, located, error, cost")
def work_precision(trade: xr.Dataset) -> Figure:
    """Draw worst error of schemes, steps and number formats against their cost, from 'tradeoff'.

    The cost is seconds per thousand scenarios; there is one line per scheme, located or not, and number format.
    Along a line the step changes. Colour and marker tell scheme and locating; a hollow marker on a dashed line is
    float32. A ring marks the Pareto front: configurations that no other is cheaper than and as accurate as. Errors
    in the grey band are below what the converged solution resolves.
    """
    check_trade(trade)
    chosen = trade.sel(population="steady", statistic="worst")
    valued = np.isfinite(chosen["error"]) & np.isfinite(chosen["cost"]) & (chosen["error"] > 0.0)
    if not valued.any():
        raise InputError("figure 'work-precision' has nothing to show: all is refused or diverged; measure finer steps")
    outputs = leading_outputs(trade)
    figure, axes = subplots(1, len(outputs), (1.2, 3.6, 4.6, 0.0))
    ring = {"marker": "o", "markersize": 11, "markerfacecolor": "none", "linestyle": "none", "color": "0.35"}
    for ax, output in zip(axes[0], outputs, strict=True):
        one = chosen.where(valued).sel(output=output)
        kinds = product(one["scheme"].values, one["located"].values)
        for ((scheme, located), style), precision in product(zip(kinds, MARKED, strict=False), one["precision"].values):
            line = one.sel(scheme=scheme, located=located, precision=precision).dropna("step", subset=["error"])
            hollow = {"linestyle": "--", "markerfacecolor": "white"} if precision == "float32" else {}
            label = f"{scheme}, {'located' if located else 'not located'}, {precision}"
            if line.sizes["step"]:
                ax.plot(line["cost"], line["error"], label=label, **style | hollow)
        front = one.where(one["pareto"] == 1)
        cost, error = xr.broadcast(front["cost"], front["error"])
        ax.plot(cost.values.ravel(), error.values.ravel(), label="Pareto front", **ring)
        ax.set(yscale="log", title=get_variable(output).long_name)
        use_logarithms(ax.xaxis)
    bottom = axes[0, 0].get_ylim()[0]
    for ax, output in zip(axes[0], outputs, strict=True):
        limit = float(chosen["resolution"].sel(output=output).max())
        if limit > bottom:
            ax.axhspan(bottom, limit, color="0.9", zorder=0, linewidth=0)
    axes[0, 0].set_ylim(bottom=bottom)
    count = int(trade.attrs["sample_scenarios"]) - int(trade.attrs["sensitive_scenarios"])
    steps = trade["step"].values * 1e3
    title = f"{count} scenarios; steps {steps[0]:g} ms (left) to {steps[-1]:g} ms (right)"
    return finish(figure, axes, "cost (s per thousand scenarios, one core)", ["worst relative error"], title, legend=2)
