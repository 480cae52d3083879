"""Maps over two axes: a response of a sweep, and the error of the peak force over stiffness and time step."""

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
from pounding_sweep.figures.select import (
    choose_axis,
    choose_response,
    is_log,
    labels_with_values,
    law_name,
    over_records,
    over_storeys,
    plot_axes,
    result_of,
    scale_axis,
    select_default,
    with_dims,
)
from pounding_sweep.figures.style import cell_edges, label_edges, put_title, subplots, unit_text
from pounding_sweep.outputs.variables import STATUS, Status

#: Rows of panels at most.
_LAWS = 3
#: Values along both axes from which lines of equal value are more than a guess, and lines at most.
_CONTOURED, _LINES = 3, 7
#: Cells along each axis up to which the share of records that touch is written into them.
_WRITTEN = 16
#: Amplifications that have a line, and a tick as well as 1.
_LEVELS = (0.1, 0.2, 0.5, 0.7, 0.85, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0)
#: Mark of a status, and what it is called in the legend.
_MARKS: dict[Status, tuple[dict[str, Any], str]] = {
    Status.BEYOND_STABILITY_LIMIT: ({"marker": "x", "color": "0.35"}, "refused: beyond the stability limit"),
    Status.UNDER_RESOLVED_CONTACT: ({"marker": ".", "color": "black"}, "under-resolved contact"),
    Status.UNDER_RESOLVED_MOTION: ({"marker": "_", "color": "black"}, "under-resolved motion"),
    Status.NEWTON_NOT_CONVERGED: ({"marker": "^", "color": "black"}, "implicit contact not solved"),
    Status.DIVERGED: ({"marker": "D", "color": "#D55E00"}, "diverged"),
}


def _missing_axes(cube: xr.Dataset) -> str:
    """Say that a cube has fewer than two axes of numbers that vary."""
    several = len({axis.dim for axis in plot_axes(cube).values()}) > 1
    return "" if several else "two axes of several numbers, such as gap and restitution"


@figure_of(
    "map",
    "cube",
    "a response or its amplification over two axes of the sweep, pair by pair and law by law",
    _missing_axes,
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
    upward = choose_axis(cube, y) if y else None
    free = (axis for axis in plot_axes(cube).values() if upward is None or axis.dim != upward.dim)
    ratio_axis = next((axis.name for axis in free if axis.name.startswith("period_ratio_")), None)
    across = choose_axis(cube, x or ratio_axis, but=[upward.dim] if upward else [])
    upward = upward or choose_axis(cube, None, but=[across.dim] if across else [])
    assert across is not None
    assert upward is not None
    value = value or (str(next(iter(cube.data_vars))) if COMPARISON in cube.attrs else None)
    ratios = [f"{name}_ratio" for name in ("displacement_peak", *AMPLIFIED)]
    if value in ratios and value not in cube.data_vars:
        cube = result_of(cube, "amplification", responses=needed_for([value]))
    numbers = [str(name) for name, variable in cube.data_vars.items() if variable.dtype.kind in "iuf"]
    if value not in (None, *numbers):
        raise InputError(unknown("value to draw", value, [*numbers, *ratios]))
    name, label, factor, per = choose_response(cube, "map", value)
    cube = with_dims(cube, "law", per, absent="")
    ratio, order = name.endswith("_ratio") and "touches" in cube, ("law", per, upward.dim, across.dim)
    over = "largest of the storeys" if "storey" in cube[name].dims else ""
    cube = cube.assign({name: over_storeys(cube[name])})
    records = ["record"] if cube.sizes.get("record", 1) > 1 else []
    cube, shown = select_default(cube, (*order, *records), [name])
    touch = (cube["touches"] > 0.0 if ratio else cube[name] != 0.0).where(cube[name].notnull())
    if records:
        cube, shown = over_records(cube, shown, [name], "worst" if name == "status" else "median")
    cube = cube.assign(share=touch.mean(records)).sortby([across.name, upward.name])
    valued = [law for law in labels_with_values(cube, "law", [name]) if per != "pair" or law != "none"]
    laws, ends = valued[:_LAWS], labels_with_values(cube, per, [name], panels=True)
    peaks, share = (cube[key].transpose(*order).sel({"law": laws, per: ends}) for key in (name, "share"))
    share = share.where((share < 0.5) & (ratio or per == "pair"))  # else there is a colour
    peaks = factor * peaks.where(share.isnull())
    size = (2.2 + 2.6 * len(ends), 1.3 + 2.3 * len(laws)) if len(ends) * len(laws) > 1 else (5.6, 4.2)
    figure, axes = subplots(len(laws), len(ends), size, ax)
    look, levels, ticks = _choose_colours(peaks.values, name, ratio)
    at = [axis.values(cube) for axis in (across, upward)]
    edges = [cell_edges(values, even=not is_log(values)) for values in at]
    for (row, column), panel in np.ndenumerate(axes):
        where = {"law": laws[row], per: ends[column]}
        grey, values = share.sel(where).values, peaks.sel(where).values
        panel.patch.set(hatch="////", edgecolor="0.75", linewidth=0.0)
        # cells without a colour: darkest where no record touches, the lighter the more do
        panel.pcolormesh(*edges, np.where(grey > 0.0, 0.9 - grey, 1.8 - grey), cmap="Greys", vmin=0.0, vmax=6.0)
        for i, j in np.argwhere(grey > 0.0) if max(grey.shape) <= _WRITTEN else ():
            panel.text(at[0][j], at[1][i], f"{grey[i, j]:.0%}", ha="center", va="center", fontsize=6, color="0.3")
        mesh = panel.pcolormesh(*edges, values, **look)
        if contours and len(levels) and min(values.shape) >= _CONTOURED and np.isfinite(values).any():
            panel.clabel(panel.contour(*at, values, levels, colors="black", linewidths=0.7), fontsize=7, fmt="%g")
        panel.grid(visible=False)
        for axis, along in zip((panel.xaxis, panel.yaxis), at, strict=True):
            scale_axis(axis, along, marked=True)
        titles = (law_name(cube, laws[row]), f"{per} {ends[column]}" if ends[column] != "" else "")
        panel.set_title("\n".join(filter(None, titles)))
    label_edges(axes, across.label, [upward.label] * len(axes))
    bar = axes[0, 0].figure.colorbar(mesh, ax=axes, label=label)
    bar.minorticks_off()
    if ticks:
        bar.set_ticks([*ticks], labels=[*ticks.values()])
    cut = f"{len(laws)} of {len(valued)} laws" if len(laws) < len(valued) else ""
    grey_text = "grey: no contact" if bool((share == 0.0).any()) else ""
    light_text = "light grey: the share of records that touch, less than half" if bool((share > 0.0).any()) else ""
    put_title(figure, shown, cut, over, grey_text, light_text)
    return figure


def _choose_colours(values: np.ndarray, name: str, ratio: bool) -> tuple[dict[str, Any], Any, dict[Any, str]]:
    """Return colours of all panels, levels of lines of equal value, and ticks of the scale of colours."""
    from matplotlib import colormaps
    from matplotlib.colors import BoundaryNorm, LogNorm
    from matplotlib.ticker import MaxNLocator

    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    if name == "status":  # a colour for each that is drawn
        codes = np.unique(finite)
        labels = {int(status): status.label for status in STATUS}
        named = {code: labels.get(code, f"code {code:g}") for code in codes}
        norm = BoundaryNorm([*(codes - 0.5), high + 0.5], len(codes))
        return {"cmap": colormaps["YlOrRd"].resampled(len(codes)), "norm": norm}, (), named
    if ratio:  # to both sides of 1
        wide = max(high, 1.0 / low if low > 0.0 else high, 1.05)
        ticks = {level: f"{level:g}" for level in sorted((*_LEVELS, 1.0)) if 1.0 / wide <= level <= wide}
        return {"cmap": "PuOr_r", "norm": LogNorm(1.0 / wide, wide)}, _LEVELS, ticks
    levels = MaxNLocator(_LINES).tick_values(low, high)
    return {"cmap": "viridis", "vmin": min(low, 0.0), "vmax": max(high, 0.0) or 1.0}, levels, {}


@figure_of(
    "stability-map",
    "map",
    "error and status over contact stiffness and time step, from 'extremes --map'",
    *("peak_force_error", "status", "scheme", "stiffness", "dt"),
)
def stability_map(cube: xr.Dataset) -> Figure:
    """Draw a map of `pounding_sweep.accuracy.extremes`: one panel per scheme and number format."""
    from matplotlib.colors import LogNorm

    schemes = cube.scheme.values.tolist()
    columns = min(2, len(schemes))
    rows = -(-len(schemes) // columns)
    figure, axes = subplots(rows, columns, (1.2 + 3.4 * columns, 1.2 + 2.8 * rows))
    edges = [cell_edges(cube[name].values) for name in ("dt", "stiffness")]
    legend: dict[str, Any] = {}
    for ax, scheme in zip(axes.flat, schemes, strict=False):
        part = cube.sel(scheme=scheme).transpose("stiffness", "dt", ...)
        mesh = ax.pcolormesh(*edges, part.peak_force_error.clip(1e-8, 1.0), norm=LogNorm(1e-8, 1.0), cmap="viridis_r")
        for status, (look, label) in _MARKS.items():
            i, j = np.nonzero(part.status.values == int(status))
            if len(i):
                legend[label] = ax.scatter(cube.dt[j], cube.stiffness[i], s=14, linewidths=0.8, label=label, **look)
        ax.set(xscale="log", yscale="log", title=scheme)
        ax.grid(visible=False)
    for ax in axes.flat[len(schemes) :]:
        ax.set_visible(False)
    label_edges(axes, "time step (s)", [f"contact stiffness ({unit_text(cube.stiffness.attrs) or '-'})"] * rows)
    figure.colorbar(mesh, ax=axes, label="relative error of the peak contact force")
    if legend:
        figure.legend(handles=[*legend.values()], loc="outside lower center", ncols=2)
    put_title(figure, str(cube.attrs.get("title", "")))
    return figure
