"""Peak impact force and number of impacts against the gap, law by law."""

from __future__ import annotations

from typing import Any

import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.analysis.scenarios import pounding_only
from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.figures import CONTACT, figure_of
from pounding_sweep.figures.shown import along, labels_with_values, law_name, middle, panels_of
from pounding_sweep.figures.sides import drawn_side, side_of
from pounding_sweep.figures.style import label_edges, legend_below, look, put_title, start_at_zero, subplots

#: Rows of panels: variable and label.
_ROWS = {"impact_force_max": "peak impact force (kN)", "impact_count": "impacts of one floor"}


@figure_of(
    "cube",
    "peak impact force and impacts of each pair against the gap, or another axis, law by law",
    needs=("law", "gap", "pair", "impact_force_max", "impact_count", CONTACT),
)
def force_gap(cube: xr.Dataset, *, x: str | None = None, value: str | None = None, ax: Any = None) -> Figure:
    """Draw peak impact force and impacts of each pair, of its storeys the largest, law by law.

    Of all other axes the middle value is shown at which floors touch; the title names it.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube.
    x : str, optional
        Axis of several numbers, or a coordinate along one, to draw along; by default the gap, or, where
        there is one gap, the first axis that varies.
    value : {"impact_force_max", "impact_count"}, optional
        One of both; both by default.
    ax : matplotlib.axes.Axes, optional
        Axes for a figure of one panel: of one pair and one value.
    """
    if value not in (None, *_ROWS):
        raise InputError(unknown("value to draw", value, _ROWS))
    rows = [value] if value else list(_ROWS)
    cube = pounding_only(along(along(cube, "law"), "gap"))
    side = drawn_side(cube, x or ("gap" if cube.sizes["gap"] > 1 else None)) or side_of(cube, "gap")
    cube, shown = middle(cube, ("law", side.dim))
    cube = cube.sortby(side.name)
    laws = labels_with_values(cube, "law", list(_ROWS))
    pairs = panels_of(cube, "pair", ["impact_force_max"])
    figure, axes = subplots(len(rows), len(pairs), (2.0 + 3.2 * len(pairs), 0.8 + 2.2 * len(rows)), ax)
    at = side.values(cube)
    for row, shows in enumerate(rows):
        for column, pair in enumerate(pairs):
            panel = axes[row, column]
            for number, law in enumerate(laws):
                values = cube[shows].sel(law=law, pair=pair).max("storey")
                panel.plot(at, values, label=law_name(cube, law), **look(number))
            if row == 0:
                panel.set_title(f"pair {pair}")
            side.draw(panel.xaxis, at)
        start_at_zero(axes[row, 0])
    label_edges(axes, side.label, [_ROWS[shows] for shows in rows])
    legend_below(figure, axes[0, 0])
    put_title(figure, shown)
    return figure
