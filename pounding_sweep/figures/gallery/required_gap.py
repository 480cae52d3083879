"""The gap that each pair needs, exactly and by separation rules."""

from __future__ import annotations

from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.figures import figure_of
from pounding_sweep.figures.shown import middle, panels_of, record_name, result_of
from pounding_sweep.figures.style import COLOURS, MARKERS, legend_below, put_title

#: More records than this are not named below the axis.
_NAMED = 8


@figure_of("cube", "the gap that each pair needs, exactly and by separation rules", needs=("pair", "record|case|exact"))
def required_gap(cube: xr.Dataset) -> Figure:
    """Draw the required gap of each pair, record by record, and what separation rules ask for over it.

    One column per pair. Above, the exact required gap (bars) and that of each rule
    (markers), records in the order of the exact one; below, the ratio of each rule to
    it, one dot per record and a bar at the median: below 1 a rule is unsafe.
    """
    result = result_of(cube, "required-gap")
    trials = "case" if "case" in result.dims else "record"
    if trials not in result.dims:
        result = result.expand_dims(trials)
    result, shown = middle(result, (trials, "rule"), ["exact"])
    pairs, rules = panels_of(result, "pair", ["exact"]), result["rule"].values.tolist()
    figure = Figure(figsize=(2.0 + 3.2 * len(pairs), 6.2), layout="constrained")
    axes = figure.subplots(2, len(pairs), squeeze=False, sharex=False, sharey="row")
    for column, pair in enumerate(pairs):
        part = result.sel(pair=pair).sortby("exact")
        _gaps(axes[0, column], part, trials, rules)
        _ratios(axes[1, column], part, trials, rules)
        axes[0, column].set_title(f"pair {pair}")
        axes[0, column].set_axisbelow(True)
    axes[0, 0].set_ylim(bottom=0.0)
    axes[0, 0].set_ylabel("required gap (mm)")
    axes[1, 0].set_ylabel("rule over exact (-)")
    legend_below(figure, axes[0, 0], most=4)
    put_title(figure, shown)
    return figure


def _gaps(ax: Any, part: xr.Dataset, trials: str, rules: list[str]) -> None:
    """Draw bars of the exact gap and marks of the rules, trial by trial."""
    x = np.arange(part.sizes[trials])
    ax.bar(x, part["exact"].values * 1e3, color="0.8", width=0.8, label="exact", zorder=1)
    for number, rule in enumerate(rules):
        ax.plot(
            x,
            part["rule_gap"].sel(rule=rule).values * 1e3,
            linestyle="none",
            label=rule.replace("_", " "),
            **_mark(number),
        )
    if len(x) <= _NAMED and trials == "record":
        keys = np.atleast_1d(part["record"].values).tolist() if "record" in part.coords else ["-"]
        names = [fill(record_name(key), 22) for key in keys]
        ax.set_xticks(x, names, rotation=30, ha="right", rotation_mode="anchor")
    else:
        ax.set_xlabel(f"{trials}s, by rising required gap")
    ax.grid(visible=False, axis="x")


def _ratios(ax: Any, part: xr.Dataset, trials: str, rules: list[str]) -> None:
    """Draw a dot per trial for each rule, and a bar at the median."""
    ax.axhline(1.0, color="0.4", linewidth=0.9, zorder=0)
    spread = np.linspace(-0.22, 0.22, part.sizes[trials]) if part.sizes[trials] > 1 else np.zeros(1)
    for number, rule in enumerate(rules):
        values = part["ratio"].sel(rule=rule).values
        ax.plot(number + spread, values, linestyle="none", **_mark(number))
        if np.isfinite(values).any():
            ax.plot([number - 0.35, number + 0.35], [np.nanmedian(values)] * 2, color="black", linewidth=1.6)
    ax.set_xticks(
        range(len(rules)), [rule.replace("_", " ") for rule in rules], rotation=30, ha="right", rotation_mode="anchor"
    )
    ax.grid(visible=False, axis="x")


def _mark(number: int) -> dict[str, Any]:
    """Return colour and marker of a rule; black is the exact gap's."""
    hollow = {"markerfacecolor": "none", "markersize": 6} if number % 2 else {}  # one seen through the other
    return {"color": COLOURS[1 + number % (len(COLOURS) - 1)], "marker": MARKERS[number % len(MARKERS)], **hollow}
