"""A response over two axes of a sweep, as a map: where in between it is large, and where nothing touches."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.figures import figure_of
from pounding_sweep.figures.shown import (
    RESPONSES,
    along,
    drawn_axis,
    drawn_response,
    first_varied,
    labels_with_values,
    middle_over_records,
    over_storeys,
)
from pounding_sweep.figures.style import cell_edges, label_edges, put_title, subplots

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

#: Rows of panels at most.
_LAWS = 3
#: Values of an axis up to which each has a tick of its own.
_TICKS = 8


def _lacks(cube: xr.Dataset) -> str:
    """Say that a cube has fewer than two axes of numbers that vary."""
    return "" if len(_axes(cube)) == 2 else "two axes of several numbers, such as gap and restitution"


def _axes(cube: xr.Dataset) -> list[str]:
    first = first_varied(cube)
    second = first_varied(cube, but=[first]) if first else None
    return [axis for axis in (first, second) if axis]


@figure_of(
    "cube",
    "a response over two axes of the sweep, pair by pair and law by law",
    needs=("|".join(name for name, *_ in RESPONSES),),
    also=_lacks,
)
def response_map(cube: xr.Dataset) -> Figure:
    """Draw a map of the peak impact force, or of another response, over two axes.

    One column per pair or building, one row per law, three at most. The axes are the
    first two that vary: gap, stiffness, scale, restitution, building properties; give the
    others with ``--at``. Shown is the largest over storeys, of several records the median,
    of the other axes the middle value, which the title names. Grey cells have no contact,
    hatched ones no value. All panels share one scale of colours.
    """
    name, label, factor, per = drawn_response(cube, "response-map")
    cube = along(along(cube, "law", absent=""), per)
    horizontal, vertical = _axes(cube)
    cube = cube.assign({name: over_storeys(cube[name])})
    cube, shown = middle_over_records(cube, ("law", horizontal, vertical), [name])
    cube = cube.sortby([horizontal, vertical])
    laws = [law for law in labels_with_values(cube, "law", [name]) if per == "building" or law != "none"][:_LAWS]
    ends = cube[per].values.tolist()
    peaks = (cube[name] * factor).transpose("law", per, vertical, horizontal).sel(law=laws)
    sides = [drawn_axis(cube, axis) for axis in (horizontal, vertical)]
    even = [_even(values) for values, _ in sides]
    edges = [cell_edges(values, even=flag) for (values, _), flag in zip(sides, even, strict=True)]
    figure, axes = subplots(max(1, len(laws)), len(ends), (2.2 + 2.6 * len(ends), 1.1 + 2.2 * max(1, len(laws))))
    largest = float(peaks.max()) if bool(peaks.notnull().any()) else 1.0
    mesh = None
    for row, law in enumerate(laws):
        for column, end in enumerate(ends):
            ax, values = axes[row, column], peaks.sel({"law": law, per: end}).values
            ax.patch.set(hatch="////", edgecolor="0.75", linewidth=0.0)
            ax.pcolormesh(*edges, np.where(values == 0.0, 1.0, np.nan), cmap="Greys", vmin=0.0, vmax=6.0)
            drawn = np.where(values == 0.0, np.nan, values)
            mesh = ax.pcolormesh(*edges, drawn, cmap="viridis", vmin=0.0, vmax=largest or 1.0)
            ax.grid(visible=False)
            ax.set_title(f"{law + ', ' if law else ''}{per} {end}")
    for ax in axes.ravel():
        ax.set(xscale="linear" if even[0] else "log", yscale="linear" if even[1] else "log")
        _ticks(ax.xaxis, sides[0][0])
        _ticks(ax.yaxis, sides[1][0])
    label_edges(axes, sides[0][1], [sides[1][1]] * len(axes))
    if mesh is not None:
        figure.colorbar(mesh, ax=axes, label=label)
    put_title(figure, shown, "grey: no contact" if bool((peaks == 0.0).any()) else "")
    return figure


def _even(values: np.ndarray) -> bool:
    """Whether values are spaced evenly rather than in even ratios."""
    if values.min() <= 0.0 or len(values) < 3:
        return True
    steps, ratios = np.diff(values), np.diff(np.log(values))
    return bool(np.ptp(steps) / steps.mean() <= np.ptp(ratios) / ratios.mean())


def _ticks(axis: Any, values: np.ndarray) -> None:
    """Put ticks at the values of an axis, or at some of them."""
    from matplotlib.ticker import NullLocator

    shown = values[:: -(-len(values) // _TICKS)]
    axis.set_ticks(shown, [f"{value:g}" for value in shown])
    axis.set_minor_locator(NullLocator())
