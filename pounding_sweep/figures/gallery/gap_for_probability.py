"""Probability that a pair touches against its gap, at each intensity; with a hazard the annual rate as well."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.analysis.comparisons import MOTION_DIMS
from pounding_sweep.figures import figure_of
from pounding_sweep.figures.shown import along, lines_of, middle, panels_of, result_of, told
from pounding_sweep.figures.style import COLOURS, LINES, MARKERS, label_edges, put_title, subplots


@figure_of(
    "cube",
    "probability that a pair touches, and its annual rate, against the gap",
    needs=("pair",),
    several=("record",),
)
def gap_for_probability(cube: xr.Dataset) -> Figure:
    """Draw the probability that a pair touches against its gap, and the rate where the result has a hazard.

    One column per pair. Lines are the lognormal of the records' required gaps, bands its confidence intervals of the
    gap, steps the shares of the records; one line for each intensity, else for each scale of the cube, five at most,
    evenly chosen. Below, with a hazard, is the annual rate, and a cross at the row's own gap.
    """
    result = result_of(cube, "gap-for-probability")
    result = along(result, "pair")
    axis = next((dim for dim in ("intensity", *MOTION_DIMS[1:]) if dim in result.dims), "")
    result, shown = middle(result, ("record", "probability", "curve", axis), ["median"])
    pairs, hazard = panels_of(result, "pair", ["trial_gap"]), "gap_in_years" in result
    size = 2 if hazard else 1
    figure, axes = subplots(size, len(pairs), (1.6 + 3.0 * len(pairs), 0.9 + 2.7 * size))
    result = result if axis else result.expand_dims("suite")
    axis = axis or "suite"
    for column, pair in enumerate(pairs):
        ax, whole = axes[0, column], result.sel(pair=pair)
        for number, place in enumerate(lines_of(result, axis)):
            part = whole.isel({axis: place})
            look = {"color": COLOURS[number % len(COLOURS)], "linestyle": LINES[number % len(LINES)]}
            label = told(part, axis, part[axis].item()) if axis in part.coords else "lognormal"
            _curve(ax, part, "curve_gap", part["curve"].values, look, label)
            _steps(ax, part["trial_gap"].values, look["color"])
        ax.set(title=f"pair {pair}", yscale="log", ylim=(1e-3, 1.0))
        if hazard:
            _rates(axes[1, column], whole.isel({axis: 0}))
    axes[0, 0].set_xlim(left=0.0)
    label_edges(axes, "gap (mm)", ["probability of touching (-)", "annual rate of touching (1/year)"][:size])
    handles, labels = axes[0, 0].get_legend_handles_labels()
    heading = str(result.attrs.get("intensity", "")).replace("m s-2", "m/s²").replace("m s-1", "m/s")
    figure.legend(handles, labels, loc="outside lower center", ncols=3, title=heading or None, title_fontsize=9)
    said = f"{result.attrs['confidence']:.0%} intervals; dots: shares of the {result.attrs['suite']} records"
    put_title(figure, f"lognormal with {said}", shown)
    return figure


def _curve(ax: Any, part: xr.Dataset, name: str, y: np.ndarray, look: dict[str, Any], label: str) -> None:
    """Draw a lognormal with the band of its gaps."""
    low, high = (part[f"{name}_{end}"].values * 1e3 for end in ("lower", "upper"))
    there = np.isfinite(low) & np.isfinite(high)
    ax.fill_betweenx(y[there], low[there], high[there], color=look["color"], alpha=0.15, linewidth=0)
    ax.plot(part[name].values * 1e3, y, label=label, **look)


def _steps(ax: Any, gaps: np.ndarray, colour: str) -> None:
    """Draw the share of the records that touch, against the gap."""
    gaps = np.sort(gaps[np.isfinite(gaps)]) * 1e3
    shares = 1.0 - np.arange(gaps.size) / max(gaps.size, 1)
    ax.plot(gaps, shares, color=colour, linestyle="none", marker=".", markersize=3)


def _rates(ax: Any, part: xr.Dataset) -> None:
    """Draw the annual rate against the gap, and the row's own."""
    rate = -np.log1p(-part["curve"].values) / float(part.attrs["years"])
    _curve(ax, part, "curve_gap_in_years", rate, {"color": COLOURS[0], "linestyle": "-"}, "lognormal")
    ax.plot(part["curve_gap_in_years_observed"] * 1e3, rate, color=COLOURS[2], linestyle=":", label="the records")
    if "rate" in part:
        own = float(part["row_gap"]) * 1e3
        ax.plot(own, float(part["rate"]), color=COLOURS[0], marker=MARKERS[6], linestyle="none", label="the row's gap")
    ax.set_yscale("log")
    ax.legend(loc="upper right", fontsize=8)
