"""Peak responses over the height of each building, law by law."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.figures import figure_of
from pounding_sweep.figures.shown import along, labels_with_values, middle
from pounding_sweep.figures.style import legend_below, look, put_title

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

#: Rows: the variables drawn in it, label, factor, and where their values are: at "floors" (displacements are zero at
#: the base as well), or in the "storey" below a floor.
_ROWS: tuple[tuple[tuple[str, ...], str, float, str], ...] = (
    (("displacement_max", "displacement_min"), "displacement (mm)", 1e3, "floors and base"),
    (("drift_max",), "interstorey drift (mm)", 1e3, "storeys"),
    (("storey_shear_max",), "storey shear (MN)", 1e-3, "storeys"),
    (("acceleration_max",), "total acceleration (m/s²)", 1.0, "floors"),
)


@figure_of(
    "cube",
    "peak displacement, drift, storey shear and acceleration over the height, law by law",
    needs=("law", "floor_elevation", "displacement_max|displacement_min|drift_max|storey_shear_max|acceleration_max"),
    also=lambda cube: "the storeys from the first on" if 1 not in np.atleast_1d(cube.get("storey", 1)) else "",
)
def profiles(cube: xr.Dataset) -> Figure:
    """Draw peak displacement, drift, storey shear and total acceleration over the height."""
    from matplotlib.figure import Figure

    cube, shown = middle(along(cube, "law"), ("law",))
    rows = [row for row in _ROWS if any(name in cube.data_vars for name in row[0])]
    buildings = cube.building.values.tolist()
    laws = labels_with_values(cube, "law", [name for names, *_ in rows for name in names if name in cube.data_vars])
    figure = Figure(figsize=(1.4 + 2.4 * len(buildings), 1.3 + 1.9 * len(rows)), layout="constrained")
    axes = figure.subplots(len(rows), len(buildings), squeeze=False, sharex="row", sharey=True)
    for line, (names, label, factor, where) in enumerate(rows):
        for column, building in enumerate(buildings):
            ax = axes[line, column]
            here = cube.sel(building=building)
            heights = here.floor_elevation.values
            floors = np.isfinite(heights)
            for number, law in enumerate(laws):
                for name in (name for name in names if name in cube.data_vars):
                    values = here[name].sel(law=law).values[floors] * factor
                    x, y, marked = _line(values, heights[floors], where)
                    ax.plot(
                        x, y, label=law if name == names[0] else None, markevery=marked, **_thinner(number, len(laws))
                    )
            if len(names) > 1:
                ax.axvline(0.0, color="0.6", linewidth=0.8, zorder=0)
            ax.set_xlabel(label)
            if line == 0:
                ax.set_title(f"building {building}")
            if column == 0:
                ax.set_ylabel("elevation (m)")
        if len(names) == 1:
            axes[line, 0].set_xlim(left=0)
    axes[0, 0].set_ylim(bottom=0)
    legend_below(figure, axes[0, 0], most=4)
    put_title(figure, shown)
    return figure


def _thinner(number: int, count: int) -> dict[str, Any]:
    """Look of the `number`-th line of so many: each thinner than those below it, so that equal ones all show."""
    below = count - 1 - number
    return look(number) | {"linewidth": 1.0 + 0.35 * below, "markersize": 3.0 + 0.8 * below}


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
