"""Error against cost of every scheme, step and number format: the work-precision diagram."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.accuracy.trade_report import check_trade, leading_outputs
from pounding_sweep.base.errors import InputError
from pounding_sweep.figures import figure_of
from pounding_sweep.figures.style import COLOURS, MARKERS, legend_below, put_title, subplots
from pounding_sweep.outputs.variables import get_variable

_POPULATION, _STATISTIC = "steady", "worst"


@figure_of(
    "trade",
    "worst error of schemes, steps and number formats against their cost, from 'tradeoff'",
    needs=("scheme", "located", "error", "cost"),
)
def work_precision(trade: xr.Dataset) -> Figure:
    """Draw worst error against seconds per thousand scenarios, one line per scheme, located or not, and number format.

    Along a line the step changes. Colour and marker tell scheme and locating; a hollow marker on a dashed line is
    float32. A ring marks the Pareto front: configurations that no other is cheaper than and as accurate as. Errors in
    the grey band are below what the converged solution resolves.
    """
    check_trade(trade)
    chosen = trade.sel(population=_POPULATION, statistic=_STATISTIC)
    if not np.isfinite(chosen["error"].values * chosen["cost"].values[..., None]).any():
        msg = "figure 'work-precision' has nothing to show: all is refused or diverged; measure finer steps"
        raise InputError(msg)
    outputs = leading_outputs(trade)
    figure, axes = subplots(1, len(outputs), (1.2 + 3.6 * len(outputs), 4.6))
    for ax, output in zip(axes[0], outputs, strict=True):
        one = chosen.sel(output=output)
        _lines(ax, one)
        _front(ax, one)
        ax.set(xscale="log", yscale="log", xlabel="cost (s per thousand scenarios, one core)")
        ax.set_title(get_variable(output).long_name)
        _plain_ticks(ax.xaxis)
    axes[0, 0].set_ylabel("worst relative error")
    bottom = axes[0, 0].get_ylim()[0]
    for ax, output in zip(axes[0], outputs, strict=True):
        limit = float(np.nanmax(chosen["resolution"].sel(output=output).values))
        if limit > bottom:
            ax.axhspan(bottom, limit, color="0.9", zorder=0, linewidth=0)
    axes[0, 0].set_ylim(bottom=bottom)
    legend_below(figure, axes[0, 0], most=2)
    count = int(trade.attrs["sample_scenarios"]) - int(trade.attrs["sensitive_scenarios"])
    steps = trade["step"].values * 1e3
    put_title(figure, f"{count} scenarios; steps {steps[0]:g} ms (left) to {steps[-1]:g} ms (right)")
    return figure


def _lines(ax: Any, one: xr.Dataset) -> None:
    kinds = list(product(one["scheme"].values, one["located"].values))
    for number, (scheme, located) in enumerate(kinds):
        for precision in one["precision"].values:
            line = one.sel(scheme=scheme, located=located, precision=precision)
            cost, error = line["cost"].values, line["error"].values
            shown = np.isfinite(cost) & np.isfinite(error) & (error > 0.0)
            if not shown.any():
                continue
            narrow = precision == "float32"
            ax.plot(
                cost[shown],
                error[shown],
                color=COLOURS[number % len(COLOURS)],
                marker=MARKERS[number % len(MARKERS)],
                linestyle="--" if narrow else "-",
                markerfacecolor="white" if narrow else None,
                label=f"{scheme}, {'located' if located else 'not located'}, {precision}",
            )


def _front(ax: Any, one: xr.Dataset) -> None:
    on = (one["pareto"].values == 1) & (one["error"].values > 0.0)
    ax.plot(
        one["cost"].values[on],
        one["error"].values[on],
        linestyle="none",
        marker="o",
        markersize=11,
        markerfacecolor="none",
        markeredgecolor="0.35",
        markeredgewidth=1.0,
        label="Pareto front",
    )


def _plain_ticks(axis: Any) -> None:
    """Write 0.1, 0.2, 0.5, ... on a logarithmic axis, however few decades it has."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())
