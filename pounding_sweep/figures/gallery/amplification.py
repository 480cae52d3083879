"""Responses with pounding over responses without, by building."""

from __future__ import annotations

from typing import Any

import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.analysis.comparisons.amplification import needed_for
from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.figures import CONTACT, NO_CONTACT, figure_of
from pounding_sweep.figures.shown import along, labels_with_values, law_name, middle_over_records, result_of
from pounding_sweep.figures.sides import drawn_side, side_of
from pounding_sweep.figures.style import label_edges, legend_below, look, put_title, subplots

#: Responses, the first three of which that are there are drawn.
_ROWS = {
    "displacement_peak_ratio": "displacement",
    "drift_max_ratio": "drift",
    "acceleration_max_ratio": "acceleration",
    "storey_shear_max_ratio": "storey shear",
    "displacement_max_ratio": "displacement to the right",
    "displacement_min_ratio": "displacement to the left",
}


#: Of which a cube must have one, and what the comparison makes of them.
_RESPONSES = "displacement_max|displacement_min|drift_max|storey_shear_max|acceleration_max"
_RATIOS = "|".join(f"{name}_ratio" for name in _RESPONSES.split("|"))


@figure_of(
    "cube",
    "responses with pounding over responses without, by building and law",
    needs=("law", f"{_RESPONSES}|{_RATIOS}", CONTACT, f"{NO_CONTACT}|{_RATIOS}"),
)
def amplification(cube: xr.Dataset, *, x: str | None = None, value: str | None = None, ax: Any = None) -> Figure:
    """Draw the amplification of each building's responses by pounding.

    One column per building, one row per response, one line per law that has values: the largest over storeys; over the
    storeys themselves where no axis varies. Of several records the median is shown, of the other axes the middle value
    at which floors touch, which the title names. The thin line at 1 is no change.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with the law "none" among its laws, or what `pounding_sweep.analysis.amplification` made of one.
    x : str, optional
        Axis of several numbers, or a coordinate along one, to draw along; by default the first of gap, stiffness,
        scale, restitution and building properties that varies.
    value : str, optional
        One response only, such as ``drift_max_ratio``; by default the first three that are there.
    ax : matplotlib.axes.Axes, optional
        Axes for a figure of one panel: of one building and one response.
    """
    if "case" in cube.dims:
        msg = (
            "figure 'amplification' needs axes, and this cube lists its scenarios as cases; give the axes of the sweep"
        )
        raise InputError(msg)
    rows = [name for name in _ROWS if name in cube or {*needed_for([name])} <= {*cube.data_vars}]
    if not rows:
        msg = (
            "figure 'amplification' shows displacements, drifts, accelerations and shears, none of which this cube has"
        )
        raise InputError(msg)
    if value not in (None, *rows):
        raise InputError(unknown("value to draw", value, rows))
    rows = [value] if value else rows[:3]
    result = result_of(cube, "amplification", responses=needed_for(rows))
    result = along(along(along(result, "law"), "building"), "storey")
    side = drawn_side(result, x) or side_of(result, "storey")
    over = "" if side.dim == "storey" or result.sizes["storey"] < 2 else "largest of the storeys"
    result, shown = middle_over_records(result, ("law", side.dim), rows)
    result = result.sortby(side.name)
    buildings, laws = result["building"].values.tolist(), labels_with_values(result, "law", rows)
    size = (1.6 + 2.4 * len(buildings), 1.3 + 1.7 * len(rows)) if len(buildings) * len(rows) > 1 else (5.6, 4.2)
    figure, axes = subplots(len(rows), len(buildings), size, ax)
    at = side.values(result)
    for row, name in enumerate(rows):
        for column, building in enumerate(buildings):
            panel = axes[row, column]
            panel.axhline(1.0, color="0.6", linewidth=0.8, zorder=0)
            for number, law in enumerate(laws):
                values = result[name].sel(law=law, building=building)
                values = values if side.dim == "storey" else values.max("storey")
                panel.plot(at, values, label=law_name(result, law), **look(number))
            side.draw(panel.xaxis, at)
            if side.dim == "storey":
                panel.set_xticks(at)
            if row == 0:
                panel.set_title(f"building {building}")
    label_edges(axes, side.label, [f"{_ROWS[name]}\nover no pounding (-)" for name in rows])
    legend_below(figure, axes[0, 0])
    put_title(figure, shown, over)
    return figure
