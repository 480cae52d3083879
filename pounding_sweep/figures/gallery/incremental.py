"""Response against intensity: one thin line per record and direction, thick lines for the fractiles of the suite."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from pounding_sweep.analysis.comparisons.incremental import directions
from pounding_sweep.figures import figure_of
from pounding_sweep.figures.shown import along, drawn_response, labels_with_values, middle, result_of
from pounding_sweep.figures.style import (
    COLOURS,
    axis_label,
    label_edges,
    legend_below,
    put_title,
    start_at_zero,
    subplots,
)

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

_LINES = ("--", "-", "-.", ":")
#: Rows of panels at most.
_LAWS = 3


@figure_of("cube", "response against intensity, record by record, with the fractiles of the suite", several=("scale",))
def incremental(cube: xr.Dataset) -> Figure:
    """Draw responses against intensity as records are scaled up."""
    result = result_of(cube, "incremental")
    name, label, factor, per = drawn_response(result, "incremental")
    for dim in ("law", per, "storey"):
        result = along(result, dim, absent="")
    keep = ("law", "record", "scale", "quantile", "level")
    result, shown = middle(result, keep, [name])
    there = labels_with_values(result, "law", [name]) or result["law"].values.tolist()
    laws = [law for law in there if per == "building" or law != "none"][:_LAWS]
    ways = directions(result["scale"].values)
    ends = result[per].values.tolist()
    figure, axes = subplots(len(laws), len(ends), (1.6 + 2.6 * len(ends), 1.3 + 2.0 * len(laws)))
    intensity = axis_label(result["intensity"].attrs["long_name"], result["intensity"].attrs)
    for row, law in enumerate(laws):
        for column, end in enumerate(ends):
            ax = axes[row, column]
            part = result.sel({"law": law, per: end})
            largest = part[name].max(["record", "scale"])
            storey = int(largest.fillna(-np.inf).argmax("storey"))
            part = part.isel(storey=storey)
            for record, way in itertools.product(range(part.sizes["record"]), ways):
                one = part.isel(record=record, scale=way).sortby("intensity")
                ax.plot(
                    one["intensity"],
                    one[name] * factor,
                    color="0.7",
                    linewidth=0.8,
                    marker="" if len(way) > 1 else ".",  # of one scale there is no line
                    label="record" if not ax.lines else None,
                )
            for number, q in enumerate(part["quantile"].values.tolist()):
                whole = part[f"{name}_count"] == part.sizes["record"] * len(ways)  # of fewer, a curve would jump
                line = part[f"{name}_fractiles"].sel(quantile=q).where(whole) * factor
                ax.plot(
                    part["level"],
                    line,
                    color=COLOURS[0] if q == 0.5 else COLOURS[2],
                    linestyle="-" if q == 0.5 else _LINES[number % len(_LINES)],
                    linewidth=1.8,
                    label="median" if q == 0.5 else f"{q:.0%} fractile",
                )
            ax.set_title(f"{law + ', ' if law else ''}{per} {end}, storey {storey + 1}")
        start_at_zero(axes[row, 0])
    axes[0, 0].set_xlim(left=0.0)  # shared by all, as y is by a row
    label_edges(axes, intensity, [label] * len(laws))
    legend_below(figure, axes[0, 0], most=4)
    put_title(figure, shown)
    return figure
