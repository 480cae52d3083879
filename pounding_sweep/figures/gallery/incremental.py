"""Response against intensity: one thin line per record and direction, thick lines for the fractiles of the suite."""

from __future__ import annotations

import itertools
from textwrap import fill

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.analysis.comparisons import MOTION_DIMS
from pounding_sweep.analysis.comparisons.incremental import NO_FRACTILES, directions
from pounding_sweep.analysis.scenarios import TOUCH_VARIABLES
from pounding_sweep.figures import figure_of
from pounding_sweep.figures.shown import (
    along,
    drawn_response,
    draws_one,
    law_name,
    middle,
    panels_of,
    records_of,
    result_of,
)
from pounding_sweep.figures.sides import draw_intensities, intensity_label
from pounding_sweep.figures.style import (
    COLOURS,
    label_edges,
    legend_below,
    put_title,
    start_at_zero,
    subplots,
    unit_text,
)

_LINES = ("--", "-", "-.", ":")
#: Rows of panels at most.
_LAWS = 3
#: Characters of a title in an inch.
_CHARACTERS = 12.5


@figure_of(
    "cube",
    "response against intensity, record by record, with the fractiles of the suite",
    several=("|".join(MOTION_DIMS[1:]),),
)
def incremental(cube: xr.Dataset) -> Figure:
    """Draw responses against intensity as records are scaled up; of one record its curve alone, without fractiles."""
    name, label, factor, per = drawn_response(cube, "incremental")
    touch = next((name for name in TOUCH_VARIABLES if name in cube), name)  # by which `middle` chooses
    result = result_of(cube, "incremental", outputs=dict.fromkeys((name, touch)))
    for dim in ("law", per, "storey"):
        result = along(result, dim, absent="")
    scaled = next(dim for dim in MOTION_DIMS[1:] if dim in result.dims)
    keep = ("law", "record", scaled, "quantile", "level")
    result, shown = middle(result, keep, [name])
    laws = [law for law in panels_of(result, "law", [name]) if per == "building" or law != "none"]
    draws_one(result, "law", _LAWS)
    laws = laws[:_LAWS]
    ways = directions(result[scaled].values)
    suite = result.sizes["record"] > 1
    ends = panels_of(result, per, [name])
    figure, axes = subplots(len(laws), len(ends), (1.6 + 2.6 * len(ends), 1.3 + 2.0 * len(laws)))
    intensity = intensity_label(result)
    for row, law in enumerate(laws):
        for column, end in enumerate(ends):
            ax = axes[row, column]
            part = result.sel({"law": law, per: end})
            largest = part[name].max(["record", scaled])
            part = part.isel(storey=int(largest.fillna(-np.inf).argmax("storey")))
            for record, way in itertools.product(range(part.sizes["record"]), ways):
                one = part.isel({"record": record, scaled: way}).sortby("intensity")
                ax.plot(
                    one["intensity"],
                    one[name] * factor,
                    color="0.7" if suite else COLOURS[0],
                    linewidth=0.8 if suite else 1.4,
                    marker="" if len(way) > 1 else ".",  # of one scale there is no line
                    label="record" if not ax.lines else None,
                )
            for number, q in enumerate(part["quantile"].values.tolist() if suite else ()):
                whole = part[f"{name}_count"] == part.sizes["record"] * len(ways)  # of fewer, a curve would jump
                line = part[f"{name}_fractiles"].sel(quantile=q).where(whole) * factor
                if not line.notnull().any():
                    continue
                ax.plot(
                    part["level"],
                    line,
                    color=COLOURS[0] if q == 0.5 else COLOURS[2],
                    linestyle="-" if q == 0.5 else _LINES[number % len(_LINES)],
                    linewidth=1.8,
                    label="median" if q == 0.5 else f"{q:.0%} fractile",
                )
            place = f"{per} {end}, storey {part['storey'].item()}"
            ax.set_title("\n".join(filter(None, (law_name(result, law), place))))
        start_at_zero(axes[row, 0])
    draw_intensities(axes[0, 0], result)  # shared by all, as y is by a row
    label_edges(axes, intensity, [label] * len(laws))
    legend_below(figure, axes[0, 0], most=4)
    put_title(figure, records_of(result), shown)
    if suite and NO_FRACTILES in result.attrs:
        units = result["intensity"].attrs
        why = result.attrs[NO_FRACTILES].replace(units["units"], unit_text(units))
        words = fill(f"No fractiles: {why}.", int(_CHARACTERS * figure.get_figwidth()))
        figure.suptitle("\n".join(filter(None, (figure.get_suptitle(), words))), fontsize=9)
    return figure
