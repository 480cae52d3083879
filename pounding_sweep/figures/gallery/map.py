"""A response over two axes of a sweep, as a map: where in between it is large, and where nothing touches."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.analysis.comparisons.amplification import RESPONSES as AMPLIFIED
from pounding_sweep.analysis.comparisons.amplification import needed_for
from pounding_sweep.analysis.scenarios import COMPARISON
from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.figures import figure_of
from pounding_sweep.figures.shown import (
    along,
    drawn_response,
    drawn_unit,
    labels_with_values,
    law_name,
    median_over_records,
    middle,
    over_storeys,
    panels_of,
    result_of,
)
from pounding_sweep.figures.sides import Side, drawn_side, logarithmic, sides_of
from pounding_sweep.figures.style import cell_edges, joined, label_edges, put_title, subplots
from pounding_sweep.outputs.variables import STATUS

#: Rows of panels at most.
_LAWS = 3
#: Values along both axes from which lines of equal value are more than a guess.
_CONTOURED = 3
#: Lines of equal value at most.
_LINES = 7
#: Cells along each axis up to which the share of records that touch is written into them.
_WRITTEN = 16
#: Dimension of the one panel of what a scenario has one value of.
_WHOLE = "scenario"
#: Amplifications that have a line, and a tick as well as 1.
_LEVELS = (0.1, 0.2, 0.5, 0.7, 0.85, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0)


def _lacks(cube: xr.Dataset) -> str:
    """Say that a cube has fewer than two axes of numbers that vary."""
    varied = {side.dim for side in sides_of(cube).values()}
    return "" if len(varied) > 1 else "two axes of several numbers, such as gap and restitution"


@figure_of(
    "cube", "a response or its amplification over two axes of the sweep, pair by pair and law by law", also=_lacks
)
def response_map(
    cube: xr.Dataset,
    *,
    x: str | None = None,
    y: str | None = None,
    value: str | None = None,
    contours: bool = False,
    ax: Any = None,
) -> Figure:
    """Draw a map of the peak impact force, or of another response, over two axes.

    One column per pair or building, one row per law, three at most. Shown is the largest over storeys (of what is
    negative or comes first, the smallest), of several records the median, of the other axes the middle value at which
    floors touch, which the title names. Grey cells have no contact under any record, light grey ones under more than
    half of them (with the share of records that touch), hatched ones no value. All panels share one scale of colours;
    of amplifications its middle is 1, no change. A value of whole scenarios, such as ``status``, has one column; of the
    status of several records the worst is shown.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube.
    x, y : str, optional
        Axes of several numbers, or coordinates along one, such as ``period_ratio_left_right``;
        ``period_ratio`` means the first of these. By default the first that vary of: period
        ratios, gap, stiffness, scale, restitution, other building properties.
    value : str, optional
        A variable of the cube, or the amplification of one, such as ``drift_max_ratio``, for which the sweep has the
        law "none". By default the peak impact force, else the first response that is there.
    contours : bool
        Whether lines of equal value are drawn as well.
    ax : matplotlib.axes.Axes, optional
        Axes for a map of one panel.
    """
    upward = drawn_side(cube, y) if y else None
    ratios = [name for name, side in sides_of(cube).items() if name.startswith("period_ratio_")]
    free = [name for name in ratios if upward is None or sides_of(cube)[name].dim != upward.dim]
    across = drawn_side(cube, x or next(iter(free), None), but=[upward.dim] if upward else [])
    upward = upward or drawn_side(cube, None, but=[across.dim] if across else [])
    assert across is not None
    assert upward is not None
    cube, name, label, factor, per = _response(cube, value)
    cube = along(along(cube, "law", absent=""), per, absent="")
    ratio = name.endswith("_ratio") and "touches" in cube
    over = "largest of the storeys" if "storey" in cube[name].dims else ""
    cube = cube.assign({name: over_storeys(cube[name])})
    cube, shown = _of_records(cube, name, ("law", per, across.dim, upward.dim), ratio)
    cube = cube.sortby([across.name, upward.name])
    there = [law for law in labels_with_values(cube, "law", [name]) if per != "pair" or law != "none"]
    laws = there[:_LAWS]
    cut = f"{len(laws)} of {len(there)} laws" if len(laws) < len(there) else ""
    ends = panels_of(cube, per, [name])
    order = ("law", per, upward.dim, across.dim)
    peaks = (cube[name] * factor).transpose(*order).sel({"law": laws, per: ends})
    share = cube[_SHARE] if ratio or per == "pair" else xr.full_like(cube[name], np.nan, float)
    apart = (share == 0.0) if ratio else (peaks == 0.0) & (share == 0.0)
    some = (share > 0.0) & ((cube["touches"] == 0.0) if ratio else peaks == 0.0)
    peaks = peaks.where(~(apart | some))
    share = share.where(apart | some)
    size = (2.2 + 2.6 * len(ends), 1.3 + 2.3 * max(1, len(laws))) if len(ends) * len(laws) > 1 else (5.6, 4.2)
    figure, axes = subplots(max(1, len(laws)), len(ends), size, ax)
    look, levels = _status_colours(peaks.values) if name == "status" else _colours(peaks.values, ratio)
    lines = levels if contours else levels[:0]
    mesh = None
    for row, law in enumerate(laws):
        for column, end in enumerate(ends):
            where = {"law": law, per: end}
            grey = share.sel({dim: at for dim, at in where.items() if dim in share.dims}).transpose(*order[2:])
            mesh = _panel(axes[row, column], (across, upward), cube, peaks.sel(where).values, grey.values, look, lines)
            axes[row, column].set_title(
                "\n".join(filter(None, (law_name(cube, law), f"{per} {end}" if end != "" else "")))
            )
    label_edges(axes, across.label, [upward.label] * len(axes))
    if mesh is not None:
        ticks: dict[str, Any] = {"ticks": sorted((*_LEVELS, 1.0)), "format": "%g"} if ratio else {}
        bar = axes[0, 0].figure.colorbar(mesh, ax=axes, label=label, **ticks)
        bar.minorticks_off()
        if name == "status":
            codes = [int(code) for code in np.unique(peaks.values[np.isfinite(peaks.values)])]
            labels = {int(status): status.label for status in STATUS}
            bar.set_ticks(codes, labels=[labels.get(code, f"code {code}") for code in codes])
    grey_text = "grey: no contact" if bool(apart.any()) else ""
    light_text = "light grey: the share of records that touch, less than half" if bool(some.any()) else ""
    put_title(figure, shown, cut, over, grey_text, light_text)
    return figure


#: Variable of the share of records under which floors touch.
_SHARE = "share_of_records_that_touch"


def _of_records(cube: xr.Dataset, name: str, keep: tuple[str, ...], ratio: bool) -> tuple[xr.Dataset, str]:
    """Take the median of several records (the worst status), the share that touches, and the middle of other axes."""
    records = cube.sizes.get("record", 1)
    cube, shown = middle(cube, (*keep, "record") if records > 1 else keep, [name])
    touch = (cube["touches"] > 0.0 if ratio else cube[name] != 0.0).where(cube[name].notnull())
    if records < 2:
        return cube.assign({_SHARE: touch}), shown
    share, worst = touch.mean("record"), cube[name].max("record", keep_attrs=True)
    cube, median = median_over_records(cube, shown, [name])
    if name == "status":
        return cube.assign({_SHARE: share, name: worst}), joined(f"worst of {records} records", shown)
    return cube.assign({_SHARE: share}), median


def _status_colours(values: np.ndarray) -> tuple[dict[str, Any], np.ndarray]:
    """Return a colour for each status that is drawn."""
    from matplotlib import colormaps
    from matplotlib.colors import BoundaryNorm, ListedColormap

    codes = np.unique(values[np.isfinite(values)])
    codes = codes if codes.size else np.array([0.0])
    edges = np.concatenate([[codes[0] - 0.5], 0.5 * (codes[1:] + codes[:-1]), [codes[-1] + 0.5]])
    colours = [colormaps["tab10"](int(code) % 10) if code else (0.85, 0.92, 0.85) for code in codes]
    return {"cmap": ListedColormap(colours), "norm": BoundaryNorm(edges, len(codes))}, np.empty(0)


def _response(cube: xr.Dataset, value: str | None) -> tuple[xr.Dataset, str, str, float, str]:
    """Return a dataset with what is drawn, its name, label and factor, and what has a column of panels."""
    if value is None and COMPARISON not in cube.attrs:
        return (cube, *drawn_response(cube, "map"))
    value = value or str(next(iter(cube.data_vars)))
    ratios = [f"{name}_ratio" for name in ("displacement_peak", *AMPLIFIED)]
    if value in ratios and value not in cube.data_vars:
        cube = result_of(cube, "amplification", responses=needed_for([value]))
    numbers = [str(name) for name, found in cube.data_vars.items() if found.dtype.kind in "iuf"]
    if value not in numbers:
        raise InputError(unknown("value to draw", value, [*numbers, *ratios]))
    about = cube[value].attrs
    unit, factor = drawn_unit(about)
    words = str(about.get("long_name", value.replace("_", " ")))
    per = next((dim for dim in ("pair", "building") if dim in cube[value].dims), _WHOLE)
    return cube, value, f"{words} ({unit or '-'})", factor, per


def _colours(values: np.ndarray, ratio: bool) -> tuple[dict[str, Any], np.ndarray]:
    """Return colours of all panels, from 0 upwards or to both sides of an amplification of 1, and levels of lines."""
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import MaxNLocator

    there = values[np.isfinite(values)]
    low, high = (float(there.min()), float(there.max())) if there.size else (0.0, 1.0)
    if ratio:
        wide = max(high, 1.0 / low if low > 0.0 else high, 1.05)
        return {"cmap": "PuOr_r", "norm": LogNorm(1.0 / wide, wide)}, np.array(_LEVELS)
    return {"cmap": "viridis", "vmin": min(low, 0.0), "vmax": max(high, 0.0) or 1.0}, np.array(
        MaxNLocator(_LINES).tick_values(low, high)
    )


def _panel(
    ax: Any,
    sides: tuple[Side, Side],
    cube: xr.Dataset,
    values: np.ndarray,
    grey: np.ndarray,
    look: dict[str, Any],
    levels: np.ndarray,
) -> Any:
    """Draw one map into a panel; return what a scale of colours is made of."""
    at = [side.values(cube) for side in sides]
    edges = [cell_edges(found, even=not logarithmic(found)) for found in at]
    ax.patch.set(hatch="////", edgecolor="0.75", linewidth=0.0)
    # cells without a colour: darkest where no record touches, the lighter the more do
    ax.pcolormesh(*edges, np.where(grey > 0.0, 0.9 - grey, 1.8 - grey), cmap="Greys", vmin=0.0, vmax=6.0)
    if max(values.shape) <= _WRITTEN:
        for i, j in np.argwhere(grey > 0.0):
            ax.text(at[0][j], at[1][i], f"{grey[i, j]:.0%}", ha="center", va="center", fontsize=6, color="0.3")
    mesh = ax.pcolormesh(*edges, values, **look)
    if len(levels) and min(values.shape) >= _CONTOURED and np.isfinite(values).any():
        lines = ax.contour(*at, values, levels, colors="black", linewidths=0.7)
        ax.clabel(lines, fontsize=7, fmt="%g")
    ax.grid(visible=False)
    for axis, side, found in zip((ax.xaxis, ax.yaxis), sides, at, strict=True):
        side.draw(axis, found, marked=True)
    return mesh
