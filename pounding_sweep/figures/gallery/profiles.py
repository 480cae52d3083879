"""Peak responses over the height of each building, law by law."""

from __future__ import annotations

from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.figures import figure_of
from pounding_sweep.figures.shown import along, drawn_unit, labels_with_values, law_name, middle
from pounding_sweep.figures.style import COLOURS, legend_below, look, put_title
from pounding_sweep.outputs.variables import VARIABLES

#: Rows: the variables drawn in it, what they are called, and where their values are: at "floors" (displacements are
#: zero at the base as well), or in the "storeys" below them.
_ROWS: tuple[tuple[tuple[str, ...], str, str], ...] = (
    (("displacement_max", "displacement_min"), "displacement", "floors and base"),
    (("drift_max",), "interstorey drift", "storeys"),
    (("storey_shear_max",), "storey shear", "storeys"),
    (("acceleration_max",), "total acceleration", "floors"),
)
#: Lines that are told apart in one panel; of more laws each has a row of panels.
_TOGETHER = 3


@figure_of(
    "cube",
    "peak displacement, drift, storey shear and acceleration over the height, law by law",
    needs=("law", "floor_elevation", "displacement_max|displacement_min|drift_max|storey_shear_max|acceleration_max"),
    also=lambda cube: "the storeys from the first on" if 1 not in np.atleast_1d(cube.get("storey", 1)) else "",
)
def profiles(cube: xr.Dataset, *, value: str | None = None) -> Figure:
    """Draw peak displacement, drift, storey shear and total acceleration over the height.

    One column per building. Of up to three laws one row per response, the laws as lines; of
    more laws one row per law, the others behind it in grey, and one response. Of all other axes
    the middle value is shown at which floors touch; the title names it.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube.
    value : str, optional
        One response only: ``displacement_max``, ``drift_max``, ``storey_shear_max`` or
        ``acceleration_max``; by default all, or of many laws the drift, else the first that is there.
    """
    cube, shown = middle(along(cube, "law"), ("law",))
    rows = [row for row in _ROWS if any(name in cube.data_vars for name in row[0])]
    names = {name: row for row in rows for name in row[0] if name in cube.data_vars}
    laws = labels_with_values(cube, "law", names)
    if value not in (None, *names):
        raise InputError(unknown("value to draw", value, names))
    if value is not None:
        rows = [names[value]]
    if len(laws) > _TOGETHER:
        figure = _law_by_law(cube, laws, names.get("drift_max", rows[0]) if value is None else rows[0])
    else:
        figure = _together(cube, laws, rows)
    put_title(figure, shown)
    return figure


def _panels(cube: xr.Dataset, rows: int, sharex: Any) -> tuple[Figure, Any]:
    """Return a figure and its panels, a column for each building."""
    buildings = cube.building.values.tolist()
    height = 1.3 + (1.9 if rows <= len(_ROWS) else 1.3) * rows
    figure = Figure(figsize=(1.4 + 2.4 * len(buildings), height), layout="constrained")
    axes = figure.subplots(rows, len(buildings), squeeze=False, sharex=sharex, sharey=True)
    for ax, building in zip(axes[0], buildings, strict=True):
        ax.set_title(f"building {building}")
    return figure, axes


def _together(cube: xr.Dataset, laws: list[str], rows: list[Any]) -> Figure:
    """Draw one row of panels for each response, and in them a line for each law."""
    figure, axes = _panels(cube, len(rows), "row")
    for line, (names, words, where) in zip(axes, rows, strict=True):
        for ax, building in zip(line, cube.building.values.tolist(), strict=True):
            for number, law in enumerate(laws):
                _draw(ax, cube.sel(building=building, law=law), names, where, law_name(cube, law), **look(number))
            ax.set_xlabel(_label(names, words))
        _margin(line, names)
        line[0].set_ylabel("elevation (m)")
    axes[0, 0].set_ylim(bottom=0)
    legend_below(figure, axes[0, 0], most=4)
    return figure


def _law_by_law(cube: xr.Dataset, laws: list[str], row: Any) -> Figure:
    """Draw one response: a row of panels for each law with contact, the others behind its line in grey."""
    names, words, where = row
    own = [law for law in laws if law != "none"]
    figure, axes = _panels(cube, len(own), "all")
    for line, law in zip(axes, own, strict=True):
        for ax, building in zip(line, cube.building.values.tolist(), strict=True):
            here = cube.sel(building=building)
            for number, other in enumerate(other for other in own if other != law):
                label = "other laws" if not number else ""
                _draw(ax, here.sel(law=other), names, where, label, color="0.75", linewidth=1.0)
            if "none" in laws:
                still = here.sel(law="none")
                _draw(ax, still, names, where, law_name(cube, "none"), color="black", linestyle=":", linewidth=1.4)
            _draw(ax, here.sel(law=law), names, where, "law of the row", color=COLOURS[2], marker="o", linewidth=1.6)
        line[0].set_ylabel(f"{fill(law_name(cube, law), 18, break_on_hyphens=False)}\nelevation (m)")
    _margin(axes[0], names)
    for ax in axes[-1]:
        ax.set_xlabel(_label(names, words))
    axes[0, 0].set_ylim(bottom=0)
    legend_below(figure, axes[0, 0])
    return figure


def _label(names: tuple[str, ...], words: str) -> str:
    """Return the label of a response, with its unit."""
    return f"{words} ({drawn_unit({'units': VARIABLES[names[0]].units})[0]})"


def _margin(line: Any, names: tuple[str, ...]) -> None:
    """Begin panels at zero where nothing is below it, else mark it."""
    for ax in line:
        if len(names) > 1:
            ax.axvline(0.0, color="0.6", linewidth=0.8, zorder=0)
    if len(names) == 1:
        line[0].set_xlim(left=0)


def _draw(ax: Any, one: xr.Dataset, names: tuple[str, ...], where: str, label: str, **style: Any) -> None:
    """Draw a response of one building under one law, of two variables both."""
    heights = one.floor_elevation.values
    floors = np.isfinite(heights)
    for name in (name for name in names if name in one.data_vars):
        factor = drawn_unit({"units": VARIABLES[name].units})[1]
        x, y, marked = _line(one[name].values[floors] * factor, heights[floors], where)
        ax.plot(x, y, label=label if name == names[0] or names[0] not in one else None, markevery=marked, **style)


def _line(values: np.ndarray, heights: np.ndarray, where: str) -> tuple[np.ndarray, np.ndarray, slice]:
    """Points of one line, and which of them are marked."""
    if where == "storeys":  # straight from the floor below to the floor above, marked halfway
        below = np.concatenate([[0.0], heights[:-1]])
        return (
            np.repeat(values, 3),
            np.column_stack([below, 0.5 * (below + heights), heights]).ravel(),
            slice(1, None, 3),
        )
    if where == "floors":
        return values, heights, slice(None)
    return np.concatenate([[0.0], values]), np.concatenate([[0.0], heights]), slice(1, None)
