"""Figures of cubes: responses along axes and heights, energies, and what suites of ground motions do."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.analysis.comparisons import EVENTS, MOTION_DIMS
from pounding_sweep.analysis.comparisons.fragility import TRIALS, FitStatus, crossed, merged, sentence
from pounding_sweep.analysis.comparisons.responses import RESPONSES as AMPLIFIED
from pounding_sweep.analysis.comparisons.responses import needed_for
from pounding_sweep.analysis.comparisons.suites import NO_FRACTILES, directions
from pounding_sweep.analysis.scenarios import COMPARISON, TOUCH_VARIABLES, pounding_only
from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.figures import CONTACT, NO_CONTACT, figure_of
from pounding_sweep.figures.select import (
    PlotAxis,
    choose_axis,
    choose_response,
    coord_text,
    drawn_unit,
    first_varied,
    is_log,
    labels_with_values,
    law_name,
    over_records,
    over_storeys,
    plot_axes,
    plot_axis,
    record_name,
    result_of,
    scale_axis,
    select_default,
    select_lines,
    use_logarithms,
    with_dims,
)
from pounding_sweep.figures.style import (
    COLOURS,
    DASHED,
    MARKED,
    MARKERS,
    cell_edges,
    finish,
    join_nonempty,
    label_edges,
    legend_below,
    put_title,
    spell_units,
    subplots,
    unit_text,
)
from pounding_sweep.outputs.variables import Status

_FORCES = {"impact_force_max": "peak impact force (kN)", "impact_count": "impacts of one floor"}
#: Amplifications, the first three of which that are there are drawn.
_AMPLIFIED = {
    "displacement_peak_ratio": "displacement",
    "drift_max_ratio": "drift",
    "acceleration_max_ratio": "acceleration",
    "storey_shear_max_ratio": "storey shear",
    "displacement_max_ratio": "displacement to the right",
    "displacement_min_ratio": "displacement to the left",
}
_RESPONSES = "displacement_max|displacement_min|drift_max|storey_shear_max|acceleration_max"
_RATIOS = "|".join(f"{name}_ratio" for name in _RESPONSES.split("|"))
#: Outputs by which laws are compared, the first that is there.
_COMPARED = {
    "impact_force_max": "peak impact force",
    "penetration_max": "penetration",
    "impulse": "impulse",
    "approach_speed_max": "approach speed",
    "impact_count": "number of impacts",
}
_COMPARISONS = "|".join([*_COMPARED, *(f"{name}_compared" for name in _COMPARED)])


def _draw_laws(lines: xr.DataArray, axis: PlotAxis, size: tuple[float, float], ax: Any = None) -> tuple[Any, Any]:
    """Draw a line for each law that has values; `lines` has the dimensions row, column, law and that of the axis."""
    rows, columns, law, _ = lines.dims
    lines = lines.sortby(axis.name)
    laws = labels_with_values(lines.to_dataset(name="lines"), str(law), ["lines"])
    figure, axes = subplots(lines.sizes[rows], lines.sizes[columns], size, ax, styles=MARKED)
    at = axis.values(lines)
    names = [law_name(lines, law) for law in laws]
    for (row, column), panel in np.ndenumerate(axes):
        panel.plot(at, lines[row, column].sel(law=laws).T, label=names)
        scale_axis(panel.xaxis, at)
        if row == 0:
            panel.set_title(f"{columns} {lines[columns].values[column]}")
    return figure, axes


def _choose_rows(value: str | None, valid: Sequence[str], most: int) -> list[str]:
    """Return the variable that was asked for, else the first that are there."""
    if value not in (None, *valid):
        raise InputError(unknown("value to draw", value, valid))
    return [value] if value else [*valid][:most]


@figure_of(
    "force-gap",
    "cube",
    "peak impact force and impacts of each pair against the gap, or another axis, law by law",
    f"law, gap, pair, impact_force_max, impact_count, {CONTACT}",
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
    rows = _choose_rows(value, [*_FORCES], 2)
    cube = pounding_only(with_dims(cube, "law", "gap"))
    axis = choose_axis(cube, x or ("gap" if cube.sizes["gap"] > 1 else None)) or plot_axis(cube, "gap")
    cube, shown = select_default(cube, ("law", axis.dim), _FORCES)
    pairs = labels_with_values(cube, "pair", ["impact_force_max"], panels=True)
    lines = cube[rows].sel(pair=pairs).max("storey").to_dataarray("row").transpose("row", "pair", "law", axis.dim)
    figure, axes = _draw_laws(lines, axis, (2.0 + 3.2 * len(pairs), 0.8 + 2.2 * len(rows)), ax)
    for panel in axes[:, 0]:
        panel.set_ylim(bottom=0.0)
    return finish(figure, axes, axis.label, [_FORCES[name] for name in rows], shown)


@figure_of(
    "amplification",
    "cube",
    "responses with pounding over responses without, by building and law",
    f"law, {_RESPONSES}|{_RATIOS}, {CONTACT}, {NO_CONTACT}|{_RATIOS}",
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
    present = [name for name in _AMPLIFIED if name in cube or {*needed_for([name])} <= {*cube.data_vars}]
    rows = _choose_rows(value, present, 3)
    result = with_dims(result_of(with_dims(cube, "law"), "amplification", responses=needed_for(rows)), "building")
    axis = choose_axis(result, x) or plot_axis(with_dims(result, "storey"), "storey")
    result, shown = select_default(result, ("law", axis.dim), rows, median=True)
    lines = result[rows].to_dataarray("row")
    over = "largest of the storeys" if axis.dim != "storey" and lines.sizes.get("storey", 1) > 1 else ""
    lines = lines if axis.dim == "storey" else over_storeys(lines)
    buildings = lines.sizes["building"]
    size = (1.6 + 2.4 * buildings, 1.3 + 1.7 * len(rows)) if buildings * len(rows) > 1 else (5.6, 4.2)
    figure, axes = _draw_laws(lines.transpose("row", "building", "law", axis.dim), axis, size, ax)
    for panel in axes.flat:
        panel.axhline(1.0, color="0.6", linewidth=0.8, zorder=0)
        if axis.dim == "storey":
            panel.set_xticks(axis.values(lines))
    return finish(figure, axes, axis.label, [f"{_AMPLIFIED[name]}\nover no pounding (-)" for name in rows], shown, over)


@figure_of(
    "law-comparison",
    "cube",
    "impact forces over those of a reference law, at equal nominal and at equal realised restitution",
    f"law, pair, {_COMPARISONS}, several law",
)
def law_comparison(cube: xr.Dataset, *, x: str | None = None) -> Figure:
    """Draw the peak impact force of each law over that of the reference law.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube of several laws with contact, or what `pounding_sweep.analysis.compare_laws` made of one.
    x : str, optional
        Axis of several numbers, or a coordinate along one, to draw along; by default the restitution, or, where
        there is one, the first axis that varies.
    """
    drawn = next((name for name in _COMPARED if name in cube), None)
    result = result_of(cube, "laws", outputs=drawn and [drawn])
    name = next(name for name in _COMPARED if f"{name}_compared" in result)
    reference = result.attrs["reference_law"]
    peak = over_storeys(with_dims(result, "pair")[f"{name}_compared"])
    base = peak.sel(law=reference, drop=True).reset_coords(drop=True)
    ratio = (peak / base.where(base != 0.0)).to_dataset(name="ratio")
    axis = choose_axis(ratio, x or ("restitution" if ratio.sizes.get("restitution", 1) > 1 else None), but=["basis"])
    if axis is None:
        raise InputError(
            "figure 'law-comparison' needs an axis along which values vary: gap, stiffness, restitution, scale, ..."
        )
    ratio, shown = select_default(ratio, ("law", "basis", axis.dim), ["ratio"], median=True)
    pairs = labels_with_values(peak.to_dataset(name=name), "pair", [name], panels=True)
    lines = ratio["ratio"].sel(pair=pairs).transpose("basis", "pair", "law", axis.dim)
    bases = lines["basis"].values.tolist()
    figure, axes = _draw_laws(lines, axis, (1.8 + 2.8 * len(pairs), 1.4 + 2.1 * len(bases)))
    for row, basis in zip(axes, bases, strict=True):
        for panel, pair in zip(row, pairs, strict=True):
            panel.set_title(f"pair {pair}\nequal {basis} restitution")
    label = "coefficient of restitution (-)" if axis.name == "restitution" else axis.label  # nominal or realised
    rows = [f"{_COMPARED[name]}\nover the reference's (-)"] * len(bases)
    return finish(figure, axes, label, rows, f"reference law: {law_name(ratio, reference)}", shown)


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


@figure_of(
    "map",
    "cube",
    "a response or its amplification over two axes of the sweep, pair by pair and law by law",
    "",
    lambda cube: (
        "two axes of several numbers, such as gap and restitution"
        * (len({axis.dim for axis in plot_axes(cube).values()}) < 2)
    ),
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
        if name == "status":
            cube, shown = (
                cube.max("record", keep_attrs=True),
                join_nonempty(f"worst of {cube.sizes['record']} records", shown),
            )
        else:
            cube, shown = over_records(cube, shown, [name])
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
    return put_title(figure, shown, cut, over, grey_text, light_text)


def _choose_colours(values: np.ndarray, name: str, ratio: bool) -> tuple[dict[str, Any], Any, dict[Any, str]]:
    """Return colours of all panels, levels of lines of equal value, and ticks of the scale of colours."""
    from matplotlib import colormaps
    from matplotlib.colors import BoundaryNorm, LogNorm
    from matplotlib.ticker import MaxNLocator

    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    if name == "status":  # a colour for each that is drawn
        codes = np.unique(finite)
        named = {status: status.label for status in Status if status in codes}
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
    "peak_force_error, status, scheme, stiffness, dt",
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
    return put_title(figure, str(cube.attrs.get("title", "")))


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
#: Parts of the energy input, from below; told apart by colour and hatching.
_PARTS: dict[str, dict[str, Any]] = {
    "energy_damping": {"label": "lost in damping", "color": COLOURS[1]},
    "hysteretic_energy": {"label": "lost in yielding", "color": COLOURS[4], "hatch": "xx"},
    "energy_links": {"label": "given to links", "color": COLOURS[3], "hatch": "--"},
    "stored": {"label": "kinetic and strain at the end", "color": COLOURS[6], "hatch": ".."},
    "energy_transfer": {"label": "given to neighbours and contacts", "color": COLOURS[2], "hatch": "//"},
}


@figure_of(
    "profiles",
    "cube",
    "peak displacement, drift, storey shear and acceleration over the height, law by law",
    f"law, floor_elevation, {_RESPONSES}",
    lambda cube: "the storeys from the first on" if 1 not in np.atleast_1d(cube.get("storey", 1)) else "",
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
    row_of = {name: row for row in _ROWS for name in row[0] if name in cube.data_vars}
    if value not in (None, *row_of):
        raise InputError(unknown("value to draw", value, row_of))
    cube, shown = select_default(with_dims(cube, "law"), ("law",), row_of)
    laws, buildings = labels_with_values(cube, "law", row_of), cube.building.values.tolist()
    by_law = [law for law in laws if law != "none"] if len(laws) > _TOGETHER else []
    responses = [row for row in _ROWS if row in row_of.values()]
    if value or by_law:
        responses = [row_of[value or ("drift_max" if "drift_max" in row_of else next(iter(row_of)))]]
    rows = list(product(by_law or [""], responses))
    height = 1.3 + (1.9 if len(rows) <= len(_ROWS) else 1.3) * len(rows)
    sharing: Any = {"sharex": "all" if by_law else "row", "sharey": True}
    figure, axes = subplots(len(rows), len(buildings), (1.4 + 2.4 * len(buildings), height), **sharing)
    for line, (own, response) in zip(axes, rows, strict=True):
        for ax, building in zip(line, buildings, strict=True):
            here = cube.sel(building=building)
            others = [law for law in by_law if law != own]
            drawn = [(law, "other laws" * (law == others[0]), {"color": "0.75", "linewidth": 1.0}) for law in others]
            if by_law and "none" in laws:
                drawn.append(("none", law_name(cube, "none"), {"color": "black", "linestyle": ":"}))
            if by_law:
                drawn.append((own, "law of the row", {"color": COLOURS[2], "marker": "o", "linewidth": 1.6}))
            else:
                drawn = [(law, law_name(cube, law), style) for law, style in zip(laws, MARKED, strict=False)]
            for law, label, style in drawn:
                _draw_profile(ax, here.sel(law=law), response, label, **style)
            if len(response[0]) > 1:
                ax.axvline(0.0, color="0.6", linewidth=0.8, zorder=0)
            names = [name for name in response[0] if name in cube]
            if not by_law or own == by_law[-1]:
                ax.set_xlabel(f"{response[1]} ({drawn_unit(cube[names[0]].attrs)[0]})")
        if len(response[0]) == 1:
            line[0].set_xlim(left=0)
        title = f"{fill(law_name(cube, own), 18, break_on_hyphens=False)}\n" if own else ""
        line[0].set_ylabel(f"{title}elevation (m)")
    for ax, building in zip(axes[0], buildings, strict=True):
        ax.set_title(f"building {building}")
    axes[0, 0].set_ylim(bottom=0)
    legend_below(figure, axes[0, 0], most=3 if by_law else 4)
    return put_title(figure, shown)


def _draw_profile(ax: Any, one: xr.Dataset, response: Any, label: str, **style: Any) -> None:
    """Draw a response, one of `_ROWS`, of one building under one law; of two variables both."""
    names, _, where = response
    floors = np.isfinite(one.floor_elevation.values)
    heights = one.floor_elevation.values[floors]
    for name in (name for name in names if name in one.data_vars):
        x, y, marked = one[name].values[floors] * drawn_unit(one[name].attrs)[1], heights, slice(None)
        if where == "storeys":  # straight from the floor below to the floor above, marked halfway
            below = np.concatenate([[0.0], heights[:-1]])
            x, y = np.repeat(x, 3), np.column_stack([below, 0.5 * (below + heights), heights]).ravel()
            marked = slice(1, None, 3)
        elif where == "floors and base":
            x, y, marked = np.concatenate([[0.0], x]), np.concatenate([[0.0], y]), slice(1, None)
        ax.plot(x, y, label=label, markevery=marked, **style)
        label = ""


@figure_of(
    "energy-budget",
    "cube",
    "where the energy of each building went, law by law",
    "building, energy_input, energy_damping, energy_kinetic, energy_strain",
)
def energy_budget(cube: xr.Dataset) -> Figure:
    """Draw each building's energy budget at the end of the record, one bar per law that has values.

    One panel per building: what was lost in damping (and in yielding, or given to links, where there are), what is left
    and what was given away, stacked; energy taken from neighbours hangs below zero. A line marks the input, which the
    bar's parts sum to. The last panel is the work that the contacts of each pair took. Of all axes but ``law`` the
    middle value is shown: an energy balance is one scenario's.
    """
    result, shown = select_default(result_of(cube, "energy"), ("law",), ["energy_input"])
    result = with_dims(result, "law", absent="")
    laws, buildings = labels_with_values(result, "law", ["energy_input"]), result["building"].values.tolist()
    result = result.sel(law=laws).fillna(0.0)
    result["stored"] = result["energy_kinetic"] + result["energy_strain"]
    names = [fill(law_name(result, law), 16) for law in laws]
    longest = max(len(line) for name in names for line in name.split("\n"))
    panels = len(buildings) + ("contact_work" in result)
    figure, axes = subplots(1, panels, (1.0 + 1.9 * panels, 3.6 + 0.09 * longest), sharex=False, sharey=False)
    x, extremes = np.arange(len(laws)), [0.0, *result["energy_input"].values.ravel()]
    for ax, building in zip(axes[0], buildings, strict=False):
        part = result.sel(building=building)
        above, below = np.zeros((2, len(laws)))
        for name in (name for name in _PARTS if name in part):
            values = part[name].values
            ax.bar(x, values, 0.7, bottom=np.where(values >= 0.0, above, below), edgecolor="white", **_PARTS[name])
            above, below = above + np.maximum(values, 0.0), below + np.minimum(values, 0.0)
        extremes += [*above, *below]
        ax.hlines(part["energy_input"], x - 0.42, x + 0.42, color="black", linewidth=1.6, label="input")
        ax.set_title(f"building {building}")
    if "contact_work" in result:  # with a scale of its own
        ax, pairs = axes[0, -1], result["pair"].values.tolist()
        width = 0.7 / len(pairs)
        for number, (pair, shade) in enumerate(zip(pairs, np.linspace(0.25, 0.75, len(pairs)), strict=True)):
            at = x - 0.35 + (number + 0.5) * width
            ax.bar(at, result["contact_work"].sel(pair=pair), width, color=str(shade), label=pair)
        ax.set_title("work of the contacts (kN m)")
        ax.margins(y=0.3)  # room for the legend above the bars
        ax.legend(loc="upper right", fontsize=8)
    low, high = min(extremes), max(extremes)
    margin = 0.05 * (high - low) or 1.0  # else bars would end at the frame
    for number, ax in enumerate(axes[0]):
        ax.axhline(0.0, color="black", linewidth=0.8)
        ax.set_xticks(x, names, rotation=60, ha="right", rotation_mode="anchor")
        ax.grid(visible=False, axis="x")
        ax.set_axisbelow(True)
        if number < len(buildings):
            ax.set_ylim(low - margin if low < 0.0 else 0.0, high + margin)
            ax.tick_params(labelleft=number == 0)
    axes[0, 0].set_ylabel("energy (kN m)")
    legend_below(figure, axes[0, 0], most=2)
    return put_title(figure, shown)


#: Dashes of fractiles.
_DASHES = ("--", "-", "-.", ":") * 3
#: Trials of many intensities are put together into so many classes of about equal size to show their shares.
_CLASSES = 6
#: Characters of a line of a legend.
_ENTRY = 48
#: More records than this are not named below the axis.
_NAMED = 8


def _draw_intensities(ax: Any, result: xr.Dataset) -> str:
    """Make the x of a panel, of intensities, logarithmic if the scales are, else begin at zero; return its label."""
    scales = next((result[dim].values for dim in MOTION_DIMS[1:] if dim in result.dims), np.ones(1))
    if is_log(np.sort(scales)):
        use_logarithms(ax.xaxis)
    else:
        ax.set_xlim(left=0.0)
    attrs = result["intensity"].attrs
    return fill(f"{attrs['long_name']} ({unit_text(attrs) or '-'})", 36)


def _name_records(result: xr.Dataset) -> str:
    """Say which record, or how many, a result is of."""
    if result.sizes.get("record", 1) > 1:
        return f"{result.sizes['record']} records"
    return coord_text(result, "record", result["record"].values.item()) if "record" in result.coords else ""


@figure_of(
    "fragility",
    "cube",
    "probability that a pair touches, against intensity, with its confidence",
    f"pair, {CONTACT}, several {'|'.join(TRIALS)}",
)
def fragility(cube: xr.Dataset) -> Figure:
    """Draw the probability of an event against intensity.

    One panel per pair or building. Lines are the values of the first axis that varies (gap, stiffness, ...), five at
    most, evenly chosen, or else the laws; of the other axes, and of the laws, the middle value is shown. Bands are
    confidence intervals, between the least and the greatest intensity tried; marks are the shares observed at each
    intensity where trials share them (stripes), else in classes of about equal numbers of trials. The title says where
    curves cross. Where there is no fit, the legend says why.
    """
    from matplotlib.transforms import ScaledTranslation

    result = result_of(cube, "fragility")
    words, per = spell_units(result.attrs["event_in_words"]), EVENTS[result.attrs["event"]].per
    result = with_dims(result, *(dim for dim in ("law", per) if dim in result.coords))
    keep = (*TRIALS, "bound", "intensity", "quantile")
    axis = first_varied(result, but=keep) or "law"
    result, shown = select_default(result, (*keep, axis), ["happened"])
    result = with_dims(result, axis, absent="")
    ends, lines = result[per].values.tolist(), select_lines(result, axis)
    figure, axes = subplots(1, len(ends), (1.4 + 3.4 * len(ends), 4.6))
    for ax, end in zip(axes[0], ends, strict=True):
        for place, style, marker in zip(lines, DASHED, MARKERS, strict=False):
            part = result.isel({axis: place}).sel({per: end})
            label = coord_text(part, axis, part[axis].item())
            _draw_fit(ax, part, style, marker, f"{label}: " if label else "")
        ax.set(ylim=(-0.02, 1.02), title=f"{per} {end}")
    label = _draw_intensities(axes[0, 0], result)  # shared: nothing drawn later would move it
    below = ScaledTranslation(0.0, -0.4 - 0.16 * label.count("\n"), figure.dpi_scale_trans)  # of the label
    for ax in axes[0]:
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), bbox_transform=ax.transAxes + below, fontsize=8)
    cross = "curves cross, as each has its own dispersion" if crossed(result.isel({axis: lines})) else ""
    one = f"one dispersion along {result.attrs['one_dispersion']}" if "one_dispersion" in result.attrs else ""
    title = words, _name_records(result), shown, cross, one
    return finish(figure, axes, label, [f"probability that\n{words} (-)"], *title, legend=0)


def _draw_fit(ax: Any, part: xr.Dataset, style: dict[str, Any], marker: str, label: str) -> None:
    """Draw one fit with its band and the observed shares."""
    x, happened = part["trial_intensity"].values.ravel(), part["happened"].values.ravel()
    x, happened = x[np.isfinite(happened)], happened[np.isfinite(happened)]
    mark = {"color": style["color"], "marker": marker, "linestyle": "none"}
    units = unit_text(part["median"].attrs)
    if int(part["fit_status"]) == FitStatus.FITTED:
        at, band = part["intensity"].values, part["probability_interval"].values
        tried = (at >= x.min()) & (at <= x.max()) & np.isfinite(band).all()
        ax.fill_between(at, *band, where=tried, color=style["color"], alpha=0.15, linewidth=0)
        fitted = f"{label}median {part['median']:.3g} {units}, dispersion {part['dispersion']:.2g}"
        ax.plot(at, part["probability"].values, label=fill(fitted, _ENTRY), **style)
    else:
        ax.plot([], [], label=fill(label + spell_units(sentence(part)), _ENTRY), **mark)
    order = np.argsort(x, kind="stable")  # a mark for trials of one intensity, if several share it, else of a class
    groups = np.split(order, np.flatnonzero(np.diff(merged(x)[order])) + 1) if x.size else []
    groups = groups if groups and min(map(len, groups)) > 1 else np.array_split(order, min(_CLASSES, len(order)) or 1)
    ax.plot(*([values[group].mean() for group in groups if group.size] for values in (x, happened)), **mark)


@figure_of(
    "incremental",
    "cube",
    "response against intensity, record by record, with the fractiles of the suite",
    f"several {'|'.join(MOTION_DIMS[1:])}",
)
def incremental(cube: xr.Dataset) -> Figure:
    """Draw responses against intensity as records are scaled up; of one record its curve alone, without fractiles."""
    name, label, factor, per = choose_response(cube, "incremental")
    touch = next((name for name in TOUCH_VARIABLES if name in cube), name)  # by which the default is selected
    result = with_dims(
        result_of(cube, "incremental", outputs=dict.fromkeys((name, touch))), "law", per, "storey", absent=""
    )
    scaled = next(dim for dim in MOTION_DIMS[1:] if dim in result.dims)
    result, shown = select_default(result, ("law", "record", scaled, "quantile", "level"), [name])
    laws = [law for law in labels_with_values(result, "law", [name]) if per == "building" or law != "none"]
    laws, ends = laws[:_LAWS], labels_with_values(result, per, [name], panels=True)
    ways, suite = directions(result[scaled].values), result.sizes["record"] > 1
    thin = {"color": "0.7", "linewidth": 0.8} if suite else {"color": COLOURS[0]}
    figure, axes = subplots(len(laws), len(ends), (1.6 + 2.6 * len(ends), 1.3 + 2.0 * len(laws)))
    for row, law in zip(axes, laws, strict=True):
        for ax, end in zip(row, ends, strict=True):
            part = result.sel({"law": law, per: end})
            largest = part[name].max(["record", scaled])
            part = part.isel(storey=int(largest.fillna(-np.inf).argmax("storey")))
            for way in ways:
                curves = part.isel({scaled: way}).transpose(scaled, ...)
                dot = "" if len(way) > 1 else "."  # of one scale there is no line
                ax.plot(curves["intensity"], curves[name] * factor, marker=dot, **thin)
            ax.lines[0].set_label("record")
            whole = part[f"{name}_count"] == part.sizes["record"] * len(ways)  # of fewer, a curve would jump
            fractiles = part[f"{name}_fractiles"].where(whole) * factor
            for q, dashes in zip(part["quantile"].values if suite and whole.any() else (), _DASHES, strict=False):
                words, style = f"{q:.0%} fractile", {"color": COLOURS[2], "linestyle": dashes}
                if q == 0.5:
                    words, style = "median", {"color": COLOURS[0]}
                ax.plot(part["level"], fractiles.sel(quantile=q), linewidth=1.8, label=words, **style)
            place = f"{per} {end}, storey {part['storey'].item()}"
            ax.set_title("\n".join(filter(None, (law_name(result, law), place))))
        row[0].set_ylim(bottom=0.0)
    intensity = _draw_intensities(axes[0, 0], result)  # shared by all, as y is by a row
    finish(figure, axes, intensity, [label] * len(laws), _name_records(result), shown, legend=4)
    if suite and NO_FRACTILES in result.attrs:
        words = f"No fractiles: {spell_units(result.attrs[NO_FRACTILES])}."
        words = fill(words, int(12.5 * figure.get_figwidth()))
        figure.suptitle("\n".join(filter(None, (figure.get_suptitle(), words))))
    return figure


@figure_of(
    "gap-for-probability",
    "cube",
    "probability that a pair touches, and its annual rate, against the gap",
    "pair, several record",
)
def gap_for_probability(cube: xr.Dataset) -> Figure:
    """Draw the probability that a pair touches against its gap, and the rate where the result has a hazard.

    One column per pair. Lines are the lognormal of the records' required gaps, bands its confidence intervals of the
    gap, steps the shares of the records; one line for each intensity, else for each scale of the cube, five at most,
    evenly chosen. Below, with a hazard, is the annual rate, and a cross at the row's own gap.
    """
    result = with_dims(result_of(cube, "gap-for-probability"), "pair")
    axis = next((dim for dim in ("intensity", *MOTION_DIMS[1:]) if dim in result.dims), "suite")
    result, shown = select_default(result, ("record", "probability", "curve", axis), ["median"])
    pairs = labels_with_values(result, "pair", ["trial_gap"], panels=True)
    rows = ["probability of touching (-)", *["annual rate of touching (1/year)"] * ("gap_in_years" in result)]
    figure, axes = subplots(len(rows), len(pairs), (1.6 + 3.0 * len(pairs), 0.9 + 2.7 * len(rows)))
    result = with_dims(result, axis, absent="")
    for column, pair in enumerate(pairs):
        ax, whole = axes[0, column], result.sel(pair=pair)
        for place, style in zip(select_lines(result, axis), DASHED, strict=False):
            part = whole.isel({axis: place})
            label = "lognormal" if axis == "suite" else coord_text(part, axis, part[axis].item())
            _draw_gaps(ax, part, "curve_gap", part["curve"].values, style, label)
            gaps = 1e3 * np.sort(part["trial_gap"].dropna("record").values)
            shares = 1.0 - np.arange(gaps.size) / max(gaps.size, 1)
            ax.plot(gaps, shares, color=style["color"], linestyle="none", marker=".", markersize=3)
        ax.set(title=f"pair {pair}", yscale="log", ylim=(1e-3, 1.0))
        if len(rows) > 1:
            ax, part = axes[1, column], whole.isel({axis: 0})
            rate = -np.log1p(-part["curve"].values) / float(part.attrs["years"])
            _draw_gaps(ax, part, "curve_gap_in_years", rate, {"color": COLOURS[0]}, "lognormal")
            observed = 1e3 * part["curve_gap_in_years_observed"]
            ax.plot(observed, rate, color=COLOURS[2], linestyle=":", label="the records")
            if "rate" in part:
                ax.plot(1e3 * part["row_gap"], part["rate"], "kX", label="the row's gap")
            ax.set_yscale("log")
            ax.legend(loc="upper right", fontsize=8)
    axes[0, 0].set_xlim(left=0.0)
    intensity = spell_units(result.attrs.get("intensity", ""))
    said = f"{result.attrs['confidence']:.0%} intervals; dots: shares of the {result.attrs['suite']} records"
    finish(figure, axes, "gap (mm)", rows, f"lognormal with {said}", shown)
    figure.legends[0].set_title(intensity or None, {"size": 9})
    return figure


def _draw_gaps(ax: Any, part: xr.Dataset, name: str, y: np.ndarray, style: dict[str, Any], label: str) -> None:
    """Draw a lognormal with the band of its gaps."""
    low, high = (part[f"{name}_{end}"].values * 1e3 for end in ("lower", "upper"))
    finite = np.isfinite(low) & np.isfinite(high)
    ax.fill_betweenx(y, low, high, where=finite, color=style["color"], alpha=0.15, linewidth=0)
    ax.plot(part[name].values * 1e3, y, label=label, **style)


@figure_of(
    "required-gap",
    "cube",
    "the gap that each pair needs, exactly and by separation rules",
    "pair, record|case|exact",
)
def required_gap(cube: xr.Dataset) -> Figure:
    """Draw the required gap of each pair, record by record, and what separation rules ask for over it.

    One column per pair. Above, the exact required gap (bars) and that of each rule
    (markers), records in the order of the exact one; below, the ratio of each rule to
    it, one dot per record and a bar at the median: below 1 a rule is unsafe.
    """
    result = result_of(cube, "required-gap")
    trials = "case" if "case" in result.dims else "record"
    result, shown = select_default(with_dims(result, trials, absent="-"), (trials, "rule"), ["exact"])
    pairs, rules = labels_with_values(result, "pair", ["exact"], panels=True), result["rule"].values.tolist()
    names = [str(rule).replace("_", " ") for rule in rules]
    figure, axes = subplots(2, len(pairs), (2.0 + 3.2 * len(pairs), 6.2), sharex=False)
    x = np.arange(result.sizes[trials])
    spread = np.linspace(-0.22, 0.22, len(x)) if len(x) > 1 else np.zeros(1)
    tilted: Any = {"rotation": 30, "ha": "right", "rotation_mode": "anchor"}
    for pair, gaps, ratios in zip(pairs, *axes, strict=True):
        part = result.sel(pair=pair).sortby("exact")
        gaps.bar(x, part["exact"].values * 1e3, color="0.8", width=0.8, label="exact", zorder=1)
        ratios.axhline(1.0, color="0.4", linewidth=0.9, zorder=0)
        for number, rule in enumerate(rules):
            hollow = {"markerfacecolor": "none", "markersize": 6} if number % 2 else {}  # one seen through the other
            mark = {"color": COLOURS[1:][number % 7], "marker": MARKERS[number % 8], "linestyle": "none", **hollow}
            ratio = part["ratio"].sel(rule=rule)
            gaps.plot(x, 1e3 * part["rule_gap"].sel(rule=rule), label=names[number], **mark)
            ratios.plot(number + spread, ratio, **mark)
            ratios.plot([number - 0.35, number + 0.35], [ratio.median()] * 2, color="black", linewidth=1.6)
        if len(x) <= _NAMED and trials == "record":
            gaps.set_xticks(x, [fill(record_name(key), 22) for key in part["record"].values.tolist()], **tilted)
        else:
            gaps.set_xlabel(f"{trials}s, by rising required gap")
        ratios.set_xticks(range(len(rules)), names, **tilted)
        gaps.set(title=f"pair {pair}", axisbelow=True)
        for panel in (gaps, ratios):
            panel.grid(visible=False, axis="x")
    axes[0, 0].set_ylim(bottom=0.0)
    for panel, label in zip(axes[:, 0], ("required gap (mm)", "rule over exact (-)"), strict=True):
        panel.set_ylabel(label)
    legend_below(figure, axes[0, 0], most=4)
    return put_title(figure, shown)
