"""Figures of cubes: responses, energies, suites of ground motions, inputs that matter, and what accuracy costs."""

from __future__ import annotations

import math
from collections.abc import Collection
from itertools import cycle, product
from string import ascii_lowercase
from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.colors import BoundaryNorm, LogNorm
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler
from matplotlib.ticker import FuncFormatter, MaxNLocator

from pounding_sweep.accuracy.tradeoff import compared, leading_outputs
from pounding_sweep.analysis.comparisons import EVENTS, MOTION_DIMS
from pounding_sweep.analysis.comparisons import fragility as fits
from pounding_sweep.analysis.comparisons.fragility import TOO_WIDE, WIDE, FitStatus, crossed, median_words, merged
from pounding_sweep.analysis.comparisons.responses import RESPONSES as AMPLIFIED
from pounding_sweep.analysis.comparisons.responses import directions, needed_for, on_levels, responses_of
from pounding_sweep.analysis.scenarios import TOUCH_VARIABLES, fractiles_over, long_name, pounding_only
from pounding_sweep.base.errors import InputError
from pounding_sweep.figures import CONTACT, FIRST_STOREY, LABELS, NO_CONTACT, SALTELLI, TABLES, TWO_AXES, figure_of
from pounding_sweep.figures.select import (
    RESPONSES,
    NothingToDrawError,
    PlotAxis,
    check_value,
    choose_axis,
    choose_response,
    coord_text,
    drawn_unit,
    is_log,
    labels_with_values,
    law_name,
    over_records,
    panels,
    plot_axes,
    plot_axis,
    record_name,
    result_of,
    scale_axis,
    select_default,
    select_lines,
    several_records,
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
    legend_below,
    spell_units,
    subplots,
    unit_text,
)
from pounding_sweep.variables.registry import Status, get_variable

_FORCES = ("impact_force_max", "impact_count")
#: Amplifications, the first three of which that are there are drawn.
_AMPLIFIED = (
    *("displacement_peak_ratio", "drift_max_ratio", "acceleration_max_ratio"),
    *("storey_shear_max_ratio", "displacement_max_ratio", "displacement_min_ratio"),
)
#: Lines of records, what their band is called, and the number of impacts from which their axis is logarithmic.
_EACH: Any = {"linewidth": 0.5, "linestyle": "-", "alpha": 0.3, "marker": "", "zorder": 1.6}
_LARGEST: Any = {"linewidth": 0.8, "linestyle": ":"}
_BAND, _MANY = "16 to 84 % of the records", 100
_RESPONSES = "displacement_max|displacement_min|drift_max|storey_shear_max|acceleration_max|drift_ratio_max"
_RATIOS = "|".join(f"{name}_ratio" for name in _RESPONSES.split("|"))
#: Outputs by which laws are compared, the first that is there.
_COMPARED = ("impact_force_max", "penetration_max", "impulse", "approach_speed_max", "impact_count")
_COMPARISONS = "|".join([*_COMPARED, *(f"{name}_compared" for name in _COMPARED)])


#: Laws at most, of figures that draw the first ones.
_LAWS = 3


def _draw_records(panel: Any, along: np.ndarray, values: np.ndarray, style: Any, *, upright: bool = False) -> None:
    """Draw a line for each of few records (axis 1), of many their middle two thirds; 0 is no contact but `upright`."""
    values_drawn = values if upright else np.where(values == 0.0, np.nan, values)
    if values.shape[1] <= _NAMED:
        panel.plot(*(values_drawn, along)[:: 1 if upright else -1], **style | _EACH)
        panel.plot([], [], label="each record", **_EACH | {"color": "0.4", "alpha": 1.0})
        return
    valued = np.isfinite(values_drawn).any(axis=1)
    band = np.nanquantile(values[valued], (0.16, 0.84), axis=1)
    fill_band = panel.fill_betweenx if upright else panel.fill_between
    for colour, ends, label in ((style["color"], (along[valued], *band), ""), ("0.2", ([],) * 3, _BAND)):
        fill_band(*ends, facecolor=(colour, 0.1), edgecolor=(colour, 0.4), linewidth=0.6, label=label)
    if not upright:
        panel.plot(along[valued], np.nanmax(values_drawn[valued], axis=1), color=style["color"], **_LARGEST)
        panel.plot([], [], color="0.2", label="largest of the records", **_LARGEST)


def _first_laws(cube: xr.Dataset, *, contact: bool) -> tuple[list[str], str]:
    """Return the first three laws, or laws with contact; if there are more, the text says so."""
    laws = [law for law in cube["law"].values.tolist() if law != "none" or not contact]
    return laws[:_LAWS], f"{_LAWS} of {len(laws)} laws, --at law=... for others" * (len(laws) > _LAWS)


def _draw_laws(
    result: xr.Dataset, rows: Collection[str], per: str, axis: PlotAxis, size: Any, words: str, ax: Any = None
) -> tuple[Any, str]:
    """Draw a row of panels for each variable, a column for each `per`, a line (median of records) for each law."""
    result = result[[*rows]].sortby(axis.name)
    median, words = over_records(result, words, rows)
    axes = subplots(len(rows), result.sizes[per], size, ax)
    at = axis.values(result)
    for row, name in zip(axes, rows, strict=True):
        for column, (panel, part) in enumerate(panels(row, median, per)):
            for law, style in zip(part["law"].values, MARKED(), strict=False):
                line = part[name].sel(law=law)
                panel.plot(at, line.where(line != 0.0), label=law_name(result, law), **style)
                if "record" in result.dims:
                    chosen = result[name].sel(law=law).isel({per: column}).transpose(axis.dim, "record")
                    _draw_records(panel, at, chosen.values, style)
            panel.update_datalim(np.column_stack([at, at]), updatey=False)  # lines may end before
            scale_axis(panel.xaxis, at)
    return axes, words


@figure_of("force-gap", "cube", f"law, gap, pair, impact_force_max, impact_count, {CONTACT}")
def force_gap(cube: xr.Dataset, *, x: str | None = None, value: str | None = None, ax: Any = None) -> Figure:
    """Draw the largest contact force and the impacts of each pair against the gap, or another axis, law by law.

    Of the storeys of a pair the largest is shown. Of several records lines are the median, beside each or, of more than
    eight, a band; they end where more than half do not touch. Of other axes the middle value is shown at which floors
    touch; the caption names it.
    """
    check_value(value, _FORCES)
    cube = pounding_only(with_dims(cube, "law", "gap"))
    axis = choose_axis(cube, x or ("gap" if cube.sizes["gap"] > 1 else None)) or plot_axis(cube, "gap")
    cube, selection = select_default(cube, ("law", axis.dim, *several_records(cube)), ["impact_force_max"])
    rows = {name: choose_response(cube, "force-gap", name)[1] for name in _FORCES if value in (None, name)}
    peaks = cube[[*rows]].max("storey")
    axes, selection = _draw_laws(peaks, rows, "pair", axis, (2.0, 3.2, 0.8, 2.2), selection, ax)
    for panel, name in zip(axes[:, 0], rows, strict=True):
        if name == "impact_count" and peaks[name].max() >= _MANY:
            panel.set_yscale("symlog", linthresh=1.0)
            panel.yaxis.set_major_formatter("{x:g}")
        panel.set_ylim(bottom=0.0)
    subject = " and ".join(long_name(cube[name], name) for name in rows)
    return finish(axes, axis.label, [*rows.values()], f"{subject} by {axis.name}", selection)


@figure_of("amplification", "cube", f"law, {_RESPONSES}|{_RATIOS}, {CONTACT}, {NO_CONTACT}|{_RATIOS}")
def amplification(cube: xr.Dataset, *, x: str | None = None, value: str | None = None, ax: Any = None) -> Figure:
    """Draw responses with pounding over responses without, by building and law.

    One column per building, one row per response, three at most, one line per law: the largest over storeys, or over
    the storeys where no axis varies. Of several records lines are the median, beside each or, of more than eight, their
    band; of other axes the middle value is shown, which the caption names. The grey line at 1 is no change.
    """
    present = [name for name in _AMPLIFIED if name in cube or {*needed_for([name])} <= {*cube.data_vars}]
    check_value(value, present)
    rows = [value] if value else present[:3]
    result = with_dims(result_of(with_dims(cube, "law"), "amplification", responses=needed_for(rows)), "building")
    axis = choose_axis(result, x) or plot_axis(with_dims(result, "storey"), "storey")
    result, selection = select_default(result, ("law", axis.dim, *several_records(result)), rows)
    result, over = result[rows], ""
    if axis.dim != "storey" and "storey" in result.dims:
        over = "largest of the storeys" * (result.sizes["storey"] > 1)
        result = result.max("storey")
    size = (1.6, 2.4, 1.3, 1.7) if result.sizes["building"] * len(rows) > 1 else (5.6, 0.0, 4.2, 0.0)
    axes, selection = _draw_laws(result, rows, "building", axis, size, selection, ax)
    for panel in axes.flat:
        panel.axhline(1.0, color="0.6", linewidth=0.8, zorder=0)
        if axis.dim == "storey":
            panel.set_xticks(axis.values(result))
    labels = [fill(choose_response(result, "amplification", name)[1], 24) for name in rows]
    return finish(
        axes, axis.label, labels, f"Responses with pounding over those without by {axis.name}", selection, over
    )


@figure_of("law-comparison", "cube", f"law, pair, {_COMPARISONS}, several law")
def law_comparison(cube: xr.Dataset, *, x: str | None = None) -> Figure:
    """Draw impact forces over those of a reference law, at equal nominal and at equal realised restitution.

    By default along the restitution, or, where there is one, along the first axis that varies.
    """
    drawn = next((name for name in _COMPARED if name in cube), None)
    result = result_of(cube, "laws", outputs=drawn and [drawn])
    name = next(name for name in _COMPARED if f"{name}_compared" in result)
    reference = result.attrs["reference_law"]
    peak = with_dims(result, "pair", "storey", absent="")[f"{name}_compared"].max("storey")
    base = peak.sel(law=reference).reset_coords(drop=True)
    ratio = (peak / base.where(base != 0.0)).to_dataset(name="ratio")
    axis = choose_axis(ratio, x or ("restitution" if ratio.sizes.get("restitution", 1) > 1 else None), but=["basis"])
    if axis is None:
        raise InputError(
            "figure 'law-comparison' needs an axis along which values vary: gap, stiffness, restitution, scale, ..."
        )
    ratio, selection = select_default(ratio, ("law", "basis", axis.dim, *several_records(ratio)), ["ratio"])
    bases = ratio["ratio"].to_dataset("basis")
    axes, selection = _draw_laws(bases, [*bases], "pair", axis, (1.8, 2.8, 1.4, 2.1), selection)
    for panel, (basis, pair) in zip(axes.flat, product(bases, bases["pair"].values), strict=True):
        panel.set_title(f"pair {pair}\nequal {basis} restitution")
    label = "coefficient of restitution (-)" if axis.name == "restitution" else axis.label  # nominal or realised
    response = f"{get_variable(name).long_name}\nover the reference's (-)"
    subject = f"{get_variable(name).long_name} over that of {law_name(ratio, reference)}, by {axis.name}"
    return finish(axes, label, response, subject, selection)


#: Amplifications that have a line, and a tick as well as 1.
_LEVELS = (0.1, 0.2, 0.5, 0.7, 0.85, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0)


@figure_of("map", "cube", TWO_AXES)
def response_map(
    cube: xr.Dataset,
    *,
    x: str | None = None,
    y: str | None = None,
    value: str | None = None,
    contours: bool = False,
    ax: Any = None,
) -> Figure:
    """Draw a response or its amplification over two axes, records or storeys, pair by pair and law by law.

    ``value`` is a variable of the cube, or the amplification of one, such as ``drift_max_ratio``, for which the sweep
    has the law "none". Axes may be coordinates along one, such as ``period_ratio_left_right``; ``period_ratio`` means
    the first of these.

    One column per pair or building, one row per law, three at most. Shown is the largest over storeys (of what is
    negative or comes first, the smallest), of several records the median (of the status the worst), of other axes the
    middle value, which the caption names. Grey cells have no contact under any record, light grey ones under more than
    half of them (with the share that touches), hatched ones no scenario that is ok. Panels share one scale of colours,
    logarithmic for 100 impacts and more; of amplifications its middle is 1.
    """
    upward = choose_axis(cube, y, labels=LABELS) if y else None
    used = [upward.dim] if upward else []
    periods = (axis.name for axis in plot_axes(cube).values() if "period_ratio_" in axis.name and axis.dim not in used)
    across = choose_axis(cube, x or next(periods, None), used, LABELS)
    upward = upward or choose_axis(cube, None, [across.dim] if across else [], LABELS)
    assert across is not None
    assert upward is not None
    cube, per, name, label, is_ratio, notes = _prepare_map(cube, across, upward, value)
    size, along_both = (2.2, 2.6, 1.3, 2.3), (upward.dim, across.dim)
    if cube.sizes["law"] * cube.sizes[per] == 1:
        size = (5.6, 0.0, 4.2, 0.0)
    axes = subplots(cube.sizes["law"], cube.sizes[per], size, ax)
    colours, levels, ticks = _choose_colours(cube["value"].values, name, is_ratio)
    levels = levels if contours and "record" not in along_both else ()
    grid = [axis.values(cube) for axis in (across, upward)]
    for panel, part in panels(axes, cube, "law", per):
        mesh = _fill_map(panel, part, grid, colours, levels)
        for axis, along, at in zip((panel.xaxis, panel.yaxis), (across, upward), grid, strict=True):
            scale_axis(axis, at, marked=True)
            if names := _label_ticks(cube, along.name, per):
                axis.set_ticks(at, names, rotation=30 * (axis is panel.xaxis), ha="right")
    axes[0, 0].figure.colorbar(mesh, ax=axes, label=label, **ticks).minorticks_off()
    hatched, shade = bool((cube["value"].isnull() & cube["share"].isnull()).any()), colormaps["Greys"]
    none = "no such storey or " * ("storey" in along_both) + "not ok"
    for text, is_drawn, look in (
        (none, hatched, {"facecolor": "white", "edgecolor": "0.75", "hatch": "////"}),
        ("no contact", (cube["share"] == 0.0).any(), {"color": shade(0.3)}),
        ("less than half of the records touch", (cube["share"] > 0.0).any(), {"color": shade(0.1)}),
    ):
        axes[0, 0].fill_between([], [], label=text if is_drawn else "", **look)
    subject = f"{long_name(cube['value'], name)} by {across.name} and {upward.name}"
    return finish(axes, across.label, upward.label, subject, *notes, "hatched: info --status says why" * hatched)


def _prepare_map(cube: xr.Dataset, across: PlotAxis, upward: PlotAxis, value: str | None) -> tuple[Any, ...]:
    """Return ``value`` as drawn and ``share`` that touches; who has columns; name and label; is it a ratio; notes."""
    ratios = [f"{name}_ratio" for name in ("displacement_peak", *AMPLIFIED)]
    if value in ratios and value not in cube:
        cube = result_of(cube, "amplification", responses=needed_for([value]))
    check_value(value, [str(key) for key, variable in cube.data_vars.items() if variable.dtype.kind in "iuf"], ratios)
    name, label, factor, per = choose_response(cube, "map", value)
    cube = with_dims(cube, "law", per, absent="")
    dims, has_storeys = (upward.dim, across.dim), "storey" in cube[name].dims
    if "storey" in dims and not has_storeys:
        raise InputError(
            f"{name} is not a value of storeys, along which this map is drawn; give other axes, or --value"
        )
    over_storeys = has_storeys and "storey" not in dims
    if over_storeys:
        cube = cube.assign({name: _over_storeys(cube[name])})
    cube, selection = select_default(cube, ("law", per, *dims, *several_records(cube)), [name])
    ratio = name.endswith("_ratio") and "touches" in cube
    touch = (cube["touches"] > 0.0 if ratio else cube[name] != 0.0).where(cube[name].notnull())
    records = [] if "record" in dims else several_records(cube)
    if records:
        cube, selection = over_records(cube, selection, [name], worst=name == "status")
    share = touch.mean(records)
    share = share.where((share < 0.5) & (ratio or per == "pair"))  # else there is a colour
    laws, others = _first_laws(cube, contact=per == "pair")
    cube = cube.assign(value=factor * cube[name].where(share.isnull()), share=share)[["value", "share"]].sel(law=laws)
    cube = cube.sortby([axis.name for axis in (across, upward) if axis.name != "record"])
    if "storey" in dims:
        cube = cube.sel(storey=labels_with_values(cube, "storey", ["value", "share"]))
    notes = selection, others, "largest of the storeys" * over_storeys
    return cube.transpose("law", per, *dims), per, name, label, ratio, notes


def _fill_map(panel: Any, part: xr.Dataset, grid: list[np.ndarray], colours: Any, levels: Any) -> Any:
    """Draw the cells of one panel and lines at `levels`; returns the coloured ones."""
    grey, values = part["share"].values, part["value"].values
    edges = [cell_edges(at, even=not is_log(at)) for at in grid]
    panel.patch.set(hatch="////", edgecolor="0.75", linewidth=0.0)
    # cells without a colour: darkest where no record touches, the lighter the more do
    panel.pcolormesh(*edges, np.where(grey > 0.0, 0.9 - grey, 1.8 - grey), cmap="Greys", vmin=0.0, vmax=6.0)
    for i, j in np.argwhere(grey > 0.0) if max(grey.shape) <= 16 else ():
        panel.text(grid[0][j], grid[1][i], f"{grey[i, j]:.0%}", ha="center", va="center", fontsize=6, color="0.3")
    mesh = panel.pcolormesh(*edges, values, **colours)
    if len(levels) and min(values.shape) >= 3 and np.isfinite(values).any():
        ends = [np.r_[edge[0], at, edge[-1]] for edge, at in zip(edges, grid, strict=True)]  # of the outer cells
        lines = panel.contour(*ends, np.pad(values, 1, mode="edge"), levels, colors="black", linewidths=0.7)
        panel.clabel(lines, fontsize=7, fmt="%g", inline_spacing=2)
    panel.grid(visible=False)
    return mesh


def _over_storeys(part: xr.DataArray) -> xr.DataArray:
    """Return the largest over storeys, of what is negative or comes first the smallest."""
    if "storey" not in part.dims:
        return part
    smallest = str(part.name).endswith("_min") or part.name == "first_impact_time"
    return part.min("storey") if smallest else part.max("storey")


def _label_ticks(cube: xr.Dataset, name: str, per: str) -> list[str]:
    """Return the names of few records, or storeys with their heights if all panels have the same; else nothing."""
    if name == "record" and cube.sizes[name] <= _NAMED:
        return [fill(record_name(key), 22) for key in cube[name].values.tolist()]
    heights = cube.get("contact_elevation" if per == "pair" else "floor_elevation")
    if name != "storey" or heights is None or (heights.max(per) != heights.min(per)).any():
        return []
    return [
        f"{storey} ({height:g} m)" for storey, height in zip(cube[name].values, heights.max(per).values, strict=True)
    ]


def _choose_colours(values: np.ndarray, name: str, ratio: bool) -> tuple[dict[str, Any], Any, dict[str, Any]]:
    """Return colours of all panels, levels of lines of equal value, and ticks of the colour bar."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    if name == "status":  # a colour for each that is drawn
        codes = np.unique(finite)
        norm = BoundaryNorm([*(codes - 0.5), high + 0.5], len(codes))
        ticks = {"ticks": codes, "format": FuncFormatter(lambda code, _: Status(int(code)).label)}
        return {"cmap": colormaps["YlOrRd"].resampled(len(codes)), "norm": norm}, (), ticks
    if ratio:  # to both sides of 1
        wide = max(high, 1.0 / low if low > 0.0 else high, 1.05)
        ticks = {"ticks": sorted((*_LEVELS, 1.0)), "format": "%g"}
        return {"cmap": "PuOr_r", "norm": LogNorm(1.0 / wide, wide)}, _LEVELS, ticks
    if name == "impact_count" and high >= _MANY:
        return {"cmap": "viridis", "norm": LogNorm(low or 1.0, high)}, [1, 10, 100, 1000], {"format": "%g"}
    levels = MaxNLocator(7).tick_values(low, high)
    return {"cmap": "viridis", "vmin": min(low, 0.0), "vmax": max(high, 0.0) or 1.0}, levels, {}


@figure_of("stability-map", "map", "peak_force_error, status, scheme, stiffness, dt")
def stability_map(cube: xr.Dataset) -> Figure:
    """Draw error and status over contact stiffness and time step, from 'extremes --map'.

    One panel per scheme and number format.
    """
    schemes = cube.scheme.values.tolist()
    columns = min(2, len(schemes))
    rows = -(-len(schemes) // columns)
    axes = subplots(rows, columns, (1.2, 3.4, 1.2, 2.8))
    edges = [cell_edges(cube[name].values) for name in ("dt", "stiffness")]
    for ax, scheme in zip(axes.flat, schemes, strict=False):
        part = cube.sel(scheme=scheme).transpose("stiffness", "dt", ...)
        mesh = ax.pcolormesh(*edges, part.peak_force_error.clip(1e-8, 1.0), norm=LogNorm(1e-8, 1.0), cmap="viridis_r")
        for status, (marker, colour, label) in TABLES["marks"].items():
            i, j = np.nonzero(part.status.values == int(Status[status]))
            if len(i):
                ax.scatter(cube.dt[j], cube.stiffness[i], 14, colour, marker=marker, linewidths=0.8, label=label)
        ax.set(xscale="log", yscale="log", title=scheme)
        ax.grid(visible=False)
    for ax in axes.flat[len(schemes) :]:
        ax.set_visible(False)
    axes[0, 0].figure.colorbar(mesh, ax=axes, label="relative error of the peak contact force")
    legend_below(axes.flat, most=2)
    label = f"contact stiffness ({unit_text(cube.stiffness.attrs) or '-'})"
    return finish(axes, "time step (s)", label, str(cube.attrs.get("title", "")), legend=0)


@figure_of("profiles", "cube", f"law, floor_elevation, {_RESPONSES}, {FIRST_STOREY}")
def profiles(cube: xr.Dataset, *, value: str | None = None) -> Figure:
    """Draw peak displacement, drift, storey shear and acceleration over the height, law by law.

    One column per building, one row per response, one line per law, three with contact at most. Of several records
    lines are the median, beside each or, of more than eight, their band. Of other axes the middle value is shown; the
    caption names it.
    """
    row_of = {name: row for row in TABLES["rows"] for name in row[0] if name in cube.data_vars}
    check_value(value, row_of)
    chosen, selection = select_default(with_dims(cube, "law"), ("law", *several_records(cube)), row_of)
    laws, others = _first_laws(chosen, contact=True)
    chosen = chosen[[*row_of]].sel(law=[law for law in chosen["law"].values if law in (*laws, "none")])
    cube, selection = over_records(chosen, selection, row_of)
    responses = [row for row in TABLES["rows"] if row in row_of.values() and value in (None, *row[0])]
    size = (1.4, 2.4, 1.3, 1.9)
    axes = subplots(len(responses), cube.sizes["building"], size, sharex="row", sharey=True)
    for row, (both, words, where) in zip(axes, responses, strict=True):
        names = [name for name in both if name in cube]
        unit, factor = drawn_unit(cube[names[0]].attrs)
        for ax, part in panels(row, cube, "building"):
            floors = np.isfinite(part.floor_elevation.values)
            heights = part.floor_elevation.values[floors]
            for (law, style), name in product(zip(part["law"].values, MARKED, strict=False), names):
                values = factor * part[name].sel(law=law).values[floors]
                x, y, marked = _along_height(values, heights, where)
                ax.plot(x, y, markevery=marked, label=law_name(cube, law), **style)
                if "record" in chosen.dims:
                    one = chosen[name].sel(law=law, building=part["building"]).transpose("storey", "record")
                    x, y, _ = _along_height(factor * one.values[floors], heights, where)
                    _draw_records(ax, y, x, style, upright=True)
            if where == "floors and base":
                ax.axvline(0.0, color="0.6", linewidth=0.8, zorder=0)
            ax.set_xlabel(label := f"{words} ({unit})")
        if where != "floors and base":
            row[0].set_xlim(left=0)
    axes[0, 0].set_ylim(bottom=0)
    return finish(axes, label, "elevation (m)", "Peak responses over the height", selection, others, legend=4)


def _along_height(values: np.ndarray, heights: np.ndarray, where: str) -> tuple[np.ndarray, np.ndarray, slice]:
    """Return lines of values of floors, the first axis: values, heights, and the points that are marked."""
    if where == "storeys":  # straight from the floor below to the floor above, marked halfway
        below = np.append(0.0, heights[:-1])
        at = np.column_stack([below, 0.5 * (below + heights), heights]).ravel()
        return np.repeat(values, 3, axis=0), at, slice(1, None, 3)
    if where == "floors and base":
        return np.concatenate([0.0 * values[:1], values]), np.append(0.0, heights), slice(1, None)
    return values, heights, slice(None)


@figure_of("energy-budget", "cube", "building, energy_input, energy_damping, energy_held")
def energy_budget(cube: xr.Dataset) -> Figure:
    """Draw where the energy of each building went, law by law.

    One bar per law, at the end of the run: what was lost in damping, in yielding or to links, what is left and what was
    given away, stacked; energy taken from neighbours hangs below zero. A line marks the input, which the parts sum to.
    The last panel is the work that the contacts of each pair took. Of all axes but ``law`` the middle value is shown.
    """
    result, selection = select_default(result_of(cube, "energy"), ("law",), ["energy_input"])
    result = with_dims(result, "law", absent="").fillna(0.0)
    buildings, x = result.sizes["building"], np.arange(result.sizes["law"])
    names = [fill(law_name(result, law), 16) for law in result["law"].values]
    longest = max(map(len, "\n".join(names).split("\n")))
    count = buildings + ("contact_work" in result)
    axes = subplots(1, count, (1.0, 1.9, 3.6 + 0.09 * longest, 0.0), sharex=False, sharey=False)
    for ax in axes[0, 1:buildings]:
        ax.sharey(axes[0, 0])
        ax.tick_params(labelleft=False)
    for ax, part in panels(axes[0, :buildings], result, "building"):
        ax.use_sticky_edges = False  # bars would end at the frame
        above, below = np.zeros((2, len(x)))
        for name in (name for name in TABLES["energies"] if name in part):
            values = part[name].values
            bottom, look = np.where(values >= 0.0, above, below), TABLES["energies"][name]
            ax.bar(x, values, 0.7, bottom=bottom, edgecolor="white", **look)
            above, below = above + np.maximum(values, 0.0), below + np.minimum(values, 0.0)
        ax.hlines(part["energy_input"], x - 0.42, x + 0.42, color="black", linewidth=1.6, label="input")
    if "contact_work" in result:  # with a scale of its own
        ax, pairs = axes[0, -1], result["pair"].values
        shades, width = np.linspace(0.25, 0.75, len(pairs)), 0.7 / len(pairs)
        for number, (pair, shade) in enumerate(zip(pairs, shades, strict=True)):
            work = result["contact_work"].sel(pair=pair)
            ax.bar(x - 0.35 + (number + 0.5) * width, work, width, color=str(shade), label=pair)
        ax.set_title("work of the contacts (kN m)")
        ax.margins(y=0.3)  # space for the legend above the bars
        ax.legend(loc="upper right", fontsize=8)
    if min(ax.dataLim.y0 for ax in axes[0, :buildings]) >= 0.0:
        axes[0, 0].set_ylim(bottom=0.0)
    for ax in axes[0]:
        ax.axhline(0.0, color="black", linewidth=0.8)
        ax.set_xticks(x, names, rotation=60, ha="right", rotation_mode="anchor")
        ax.grid(visible=False, axis="x")
        ax.set_axisbelow(True)
    return finish(axes[:, :buildings], "", "energy (kN m)", "Where the energy went", selection, legend=2)


#: Dashes of fractiles but the median, and looks of records that are named: none is black.
_DASHES = ("--", "-.", ":") * 4
_RECORD_DASHES = ("-", "--", "-.", ":", (0, (6, 2)), (0, (1, 1)), (0, (6, 1, 1, 1)))
_NAMED_LINES = cycler(linestyle=_RECORD_DASHES) * cycler(color=COLOURS[1:])
#: More records than this are not named below the axis.
_NAMED = 8


def _scale_intensities(axis: Any, result: xr.Dataset) -> str:
    """Make an axis of a panel, of intensities, logarithmic if the scales are, else begin at zero; return its label."""
    scales = next((result[dim].values for dim in MOTION_DIMS[1:] if dim in result.dims), np.ones(1))
    if is_log(np.sort(scales)):
        use_logarithms(axis)
    else:
        axis.axes.set(**{f"{axis.axis_name}lim": (0.0, None)})
    attrs = result["intensity"].attrs
    return fill(f"{attrs['long_name']} ({unit_text(attrs) or '-'})", 36)


def _name_records(result: xr.Dataset) -> str:
    """Say which record, or how many, a result is of."""
    if result.sizes.get("record", 1) > 1:
        return f"{result.sizes['record']} records"
    return coord_text(result, "record") if "record" in result.coords else ""


@figure_of("fragility", "cube", f"pair|building, several {'|'.join(MOTION_DIMS)}")
def fragility(cube: xr.Dataset, *, event: str | None = None, level: str | float | None = None) -> Figure:
    """Draw the probability of an event, by default that a pair touches, against intensity, with its confidence.

    One panel per pair or building. Lines are the values of the first axis that varies, five at most, or else the laws;
    of the others the middle value is shown. Bands are confidence intervals; marks are the shares observed at each
    intensity where trials share them (stripes), else in classes of about equal numbers of trials. The caption says
    where curves cross, footnotes why there is no fit or no band.
    """
    result = result_of(cube, "fragility", event=event or "touch", level=level)
    if event not in (None, result.attrs["event"]):
        raise InputError(f"this file is of the event {result.attrs['event']!r}, not {event!r}; draw its cube instead")
    words, per = spell_units(result.attrs["event_in_words"]), EVENTS[result.attrs["event"]].per
    result = with_dims(result, *(dim for dim in ("law", per) if dim in result.coords))
    keep = (*MOTION_DIMS, "bound", "intensity", "quantile")
    varied = choose_axis(result, None, keep)
    axis, cube = varied.dim if varied else "law", result
    if varied and "law" in result.dims and (result["law"] != "none").any():
        result = result.sel(law=result["law"] != "none")
    result, selection = select_default(result, (*keep, axis), ["happened"])
    lines = select_lines(with_dims(result, axis, absent=""), axis)
    without = []  # curves without pounding: one for each line, or one if all are the same
    if axis != "law" and "none" in cube.coords.get("law", []) and result["law"] != "none":
        same = {dim: result[dim] for dim in cube.dims if dim in result.coords and not result[dim].ndim}
        bare = cube.sel(same | {"law": "none", axis: lines[axis]})
        count = lines.sizes[axis] if bare["happened"].fillna(-1.0).diff(axis).any() else 1
        without = [bare.isel({axis: number}) for number in range(count)]
    axes = subplots(1, result.sizes[per], (1.4, 3.4, 4.6, 0.0))
    notes: dict[str, str] = {}
    for ax, end in panels(axes[0], lines, per):
        for number, style, marker in zip(range(lines.sizes[axis]), DASHED, MARKERS, strict=False):
            _draw_fit(ax, end.isel({axis: number}), [axis], style, marker, notes)
        for part, dashes in zip(without, DASHED, strict=False):
            grey = dashes | {"color": "0.55"}
            _draw_fit(ax, part.sel({per: end[per]}), ["law", axis][: len(without)], grey, "*", notes)
        ax.set_ylim(-0.02, 1.02)
    label = _scale_intensities(axes[0, 0].xaxis, result)  # shared: nothing drawn later would move it
    below = 4.1 + 1.45 * label.count("\n")  # the label, in font sizes
    for ax in axes[0]:
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), borderaxespad=below, fontsize=8)
    cross = "curves cross, as each has its own dispersion" if crossed(lines) else ""
    common = f"one dispersion along {result.attrs['one_dispersion']}" if "one_dispersion" in result.attrs else ""
    footnotes = [f"{letter} {note}" for note, letter in notes.items()]
    details = _name_records(result), selection, cross, common, result.attrs.get("advice", ""), *footnotes
    figure = finish(axes, label, f"probability (-):\n{words}", f"Fragility: {words}", *details, legend=0)
    text = "\n".join(fill(note, int(15 * figure.get_figwidth())) for note in footnotes)
    figure.supxlabel(text.strip(), x=0.02, ha="left", fontsize=8)
    return figure


def _draw_fit(ax: Any, part: xr.Dataset, names: Any, style: dict[str, Any], marker: str, notes: dict[str, str]) -> None:
    """Draw one fit with its band and the observed shares; notes say what is missing."""
    happened = part["happened"].values.ravel()
    tried = np.isfinite(happened)
    x, happened = part["trial_intensity"].values.ravel()[tried], happened[tried]
    mark = {"color": style["color"], "marker": marker, "linestyle": "none"}
    units, fit = unit_text(part["median"].attrs), int(part["fit_status"])
    note = fits.MEANINGS[fit]
    if fit == FitStatus.FITTED:
        at, band = part["intensity"].values, part["probability_interval"].values
        low, high = part[["median_interval", "dispersion_interval"]].to_dataarray().transpose("bound", ...).values
        missing = "confidence" in part.attrs and bool(np.isnan(high).any())
        note = TOO_WIDE if (high > WIDE * low).any() else fits.NO_INTERVAL * missing
        ax.fill_between(
            at, *band, where=np.isfinite(band).all(axis=0) & (not note), color=style["color"], alpha=0.15, linewidth=0
        )
        known = f"median {part['median']:.3g} {units}, dispersion {part['dispersion']:.2g}"
        ax.plot(at, part["probability"].values, **style)
    else:
        known = f"median {spell_units(median_words(part))}".removesuffix("median ")
    letter = notes.setdefault(note, f"({ascii_lowercase[len(notes)]})") if note else ""
    named = join_nonempty(*(coord_text(part, name) for name in names))
    label = ": ".join(filter(None, (named, f"{known} {letter}".strip())))
    ax.plot([], [], label=fill(label, 48), **(mark if fit else style))
    order = np.argsort(x, kind="stable")  # a mark for trials of one intensity, if several share it, else of a class
    groups = np.split(order, np.flatnonzero(np.diff(merged(x)[order])) + 1)
    groups = groups if min(map(len, groups)) > 1 else np.array_split(order, min(6, len(order)) or 1)
    ax.plot(*([values[group].mean() for group in groups if group.size] for values in (x, happened)), **mark)


#: What stands for infinity (in the axis' unit): where a building falls, the line to it is flat.
_FAR = 1e9


@figure_of("incremental", "cube", f"several {'|'.join(MOTION_DIMS[1:])}")
def incremental(cube: xr.Dataset, *, value: str | None = None, turn: bool = False, names: bool = False) -> Figure:
    """Draw intensity against a response, record by record, with the fractiles of the suite (IDA curves).

    One column per pair or building, one row per law, three at most. Shown is the largest over storeys, or the selected
    one. Fractiles are drawn where half of the curves reach, and enough that one lies beyond the fractile (7 for 16 %).
    """
    check_value(value, responses_of(cube, "an incremental curve", None))
    name, label, factor, per = choose_response(cube, "incremental", value)
    touch = next((name for name in TOUCH_VARIABLES if name in cube), name)  # by which the default is selected
    result = with_dims(result_of(cube, "incremental", outputs=dict.fromkeys((name, touch))), "law", per, absent="")
    scaled = next(dim for dim in MOTION_DIMS[1:] if dim in result.dims)
    result, selection = select_default(result, ("law", "record", scaled, "quantile", "level"), [name])
    laws, others = _first_laws(result, contact=per == "pair")
    response = factor * _over_storeys(result[name].sel(law=laws))
    quantiles, ways = result["quantile"].values.tolist(), directions(result[scaled].values)
    suite = on_levels(response, result["intensity"], result["level"])
    fractiles, count = fractiles_over(suite, ["curve"], quantiles)
    curves, most = response.sizes["record"] * len(ways), int(count.max())
    # half of the curves, and so many that one is expected beyond the fractile
    needed = {q: max(0.5 * curves, 1.0 / (round(min(q, 1.0 - q), 9) or 1.0)) for q in quantiles}
    below = 1.3 + 0.08 * names * response.sizes["record"]  # inches for the legend
    shared = (True, "col") if turn else ("col", True)  # a response axis for each building
    axes = subplots(len(laws), response.sizes[per], (1.6, 2.6, below, 2.2), sharex=shared[0], sharey=shared[1])
    thin = {"color": "0.7", "linewidth": 0.8} if curves > 1 else {"color": COLOURS[0]}
    records = [*zip(result["record"].values.tolist(), cycle(_NAMED_LINES if names else [thin]), strict=False)]
    lines = xr.Dataset({"curve": response, "count": count, "fractile": fractiles})
    for ax, part in panels(axes, lines.where(~np.isinf(lines), _FAR), "law", per):
        for (record, look), way in product(records, ways):
            curve = part["curve"].sel(record=record), result["intensity"].sel(record=record)
            look |= {"label": record_name(record) if names else "record", "marker": "" if len(way) > 1 else "."}
            ax.plot(*(values[way] for values in curve[:: -1 if turn else 1]), **look)
        for q, dashes in zip(quantiles, _DASHES, strict=False):
            drawn = part["fractile"].sel(quantile=q).where(part["count"] >= needed[q]), part["level"]
            look = {"label": "median"} if q == 0.5 else {"label": f"{q:.0%} fractile", "linestyle": dashes}
            if most >= needed[q]:
                ax.plot(*drawn[:: -1 if turn else 1], color="black", linewidth=1.8, **look)
    intensity = _scale_intensities(axes[0, 0].xaxis if turn else axes[0, 0].yaxis, result)  # shared by all
    ends = response.where(np.isfinite(response)).max([dim for dim in response.dims if dim != per]) * 1.05
    for ax, end in zip(axes[0], np.atleast_1d(ends), strict=True) if response.min() >= 0.0 else ():
        ax.set(**{"ylim" if turn else "xlim": (0.0, end if np.isinf(response).any() else None)})
    storeys = "largest of the storeys" * (result[name].sizes.get("storey", 1) > 1)
    short = [q for q in quantiles if (count < needed[q]).any()]
    words, numbers = ", ".join(f"{q:.0%}" for q in short), ", ".join(f"{math.ceil(needed[q])}" for q in short)
    why = f"fractiles of {words} need {numbers} curves at one intensity, at most {most} reach" if short else ""
    x, y = (intensity, label) if turn else (label, intensity)
    notes = _name_records(result), storeys, selection, others, why
    return finish(axes, x, fill(y, 32), "Incremental dynamic analysis", *notes, legend=4)


@figure_of("gap-for-probability", "cube", "pair, several record|gap_number")
def gap_for_probability(cube: xr.Dataset) -> Figure:
    """Draw the probability that a pair touches, and its annual rate, against the gap.

    One column per pair. Lines are the lognormal of the records' required gaps, bands its confidence intervals of the
    gap, dots the shares of the records; one line for each intensity, else for each scale of the cube, five at most,
    evenly chosen. Bars are intervals for the least probability. Below, with a hazard: in years, and gaps by rules; of a
    row that yields that alone, by the cube's own runs.
    """
    result = with_dims(result_of(cube, "gap-for-probability"), "pair")
    axis = next((dim for dim in ("intensity", *MOTION_DIMS[1:]) if dim in result.dims), "suite")
    keep = {"record", "curve", "rule", "probability", "gap_number", axis}
    result, selection = select_default(result, keep, ["median", "trial_gap", "rate"])
    words, years = result.attrs.get("answer", ""), float(result.attrs.get("years", 0.0))
    rows = ["probability of touching (-)"] * ("gap" in result) + [f"probability in {years:g} years (-)"] * bool(years)
    axes = subplots(len(rows), result.sizes["pair"], (2.2, 3.4, 1.2, 2.7))
    for ax in axes[:, 0]:
        ax.set(yscale="log", ylim=(1e-3, 1.0))
    result = select_lines(with_dims(result, axis, absent=""), axis).sel(probability=result["probability"].min())
    for ax, pair in panels(axes[0], result, "pair") if "gap" in result else ():
        for number, style in zip(range(result.sizes[axis]), DASHED, strict=False):
            part = pair.isel({axis: number})
            label = "lognormal" if axis == "suite" else coord_text(part, axis)
            _draw_gaps(ax, part, "gap", style, label)
            gaps = 1e3 * np.sort(part["trial_gap"].dropna("record").values)
            shares = np.linspace(1.0, 0.0, gaps.size, endpoint=False)
            dots = {"marker": ".", "markersize": 3, "label": "shares of the records" if not number else ""}
            ax.plot(gaps, shares, color=style["color"], linestyle="none", **dots)
    for ax, pair in panels(axes[-1], result.isel({axis: 0}), "pair") if years else ():
        _draw_gaps(ax, pair, "gap_in_years", {"color": COLOURS[0]}, "lognormal")
        if "rate" in pair:
            row_gaps, shares = 1e3 * np.ravel(pair["row_gap"]), -np.expm1(-years * np.ravel(pair["rate"]))
            label = "gaps of the cube" if "gap_number" in pair.dims else f"the row's gap: {row_gaps[0]:.3g} mm"
            ax.plot(row_gaps, shares, "kX", clip_on=False, label=label)
        for name, number in _group_rules(pair).items() if "rule_gap" in pair else ():
            gap = 1e3 * pair["rule_gap"].values[number]
            ax.axvline(gap, 0.0, 0.2, color=COLOURS[1 + number], linewidth=2.0, label=f"{name}: {gap:.3g} mm")
        rates, right = 10.0 ** np.arange(-6, 0), ax.secondary_yaxis("right")
        right.set_yticks(-np.expm1(-years * rates), [f"{rate:g}" for rate in rates])
        right.minorticks_off()
        right.set_ylabel("annual rate (1/year)")
        if len(rows) > 1:
            ax.legend(loc="upper right", fontsize=8)
    drawn = [name for name in ("trial_gap", "curve_gap", "curve_gap_in_years", "row_gap", "rule_gap") if name in result]
    axes[0, 0].set_xlim(0.0, 1.05e3 * result.reset_coords()[drawn].to_dataarray().max().item())
    rules = spell_units(result["rule_gap"].attrs["long_name"]) if "rule_gap" in result else ""
    intervals = f"lognormal with {result.attrs['confidence']:.0%} intervals"
    notes = words, f"{result.attrs['suite']} records", intervals, rules, selection
    figure = finish(axes, "gap (mm)", rows, "Probability that a pair touches, by gap", *notes)
    figure.legends[0].set_title(spell_units(result.attrs.get("intensity", "")), {"size": 9})
    return figure


def _draw_gaps(ax: Any, part: xr.Dataset, name: str, style: dict[str, Any], label: str) -> None:
    """Draw a lognormal with the band of its gaps, and the gap for its probability, with the interval."""
    low, high = (part[f"curve_{name}_{end}"].values * 1e3 for end in ("lower", "upper"))
    finite, y = np.isfinite(low) & np.isfinite(high), part["curve"].values
    ax.fill_betweenx(y, low, high, where=finite, color=style["color"], alpha=0.15, linewidth=0)
    ax.plot(part[f"curve_{name}"].values * 1e3, y, label=label, **style)
    gaps = [1e3 * part[f"{name}{end}"] for end in ("_lower", "", "_upper")]
    ax.plot(gaps, np.full(3, part["probability"]), "|-", color=style["color"], markersize=9)


@figure_of("required-gap", "cube", "pair, record|case|exact")
def required_gap(cube: xr.Dataset) -> Figure:
    """Draw the gap that each pair needs, exactly and by separation rules.

    One column per pair. Above, the exact required gap (line) and that of each rule (markers), records in the order of
    the exact one; below, the ratio of each rule to it, one mark per record and a bar at the median: below 1 a rule is
    unsafe. Rules that agree are drawn once.
    """
    result = result_of(cube, "required-gap")
    trials = "case" if "case" in result.dims else "record"
    result, selection = select_default(with_dims(result, trials, absent="-"), (trials, "rule"), ["exact"])
    axes = subplots(2, result.sizes["pair"], (2.0, 3.2, 6.2, 0.0), sharex=False)
    x = np.arange(result.sizes[trials])
    offsets = 0.44 * (x + 0.5) / len(x) - 0.22
    few = len(x) <= _NAMED
    tilted: Any = {"rotation": 30, "ha": "right", "rotation_mode": "anchor"}
    for (gaps, pair), ratios in zip(panels(axes[0], result, "pair"), axes[1], strict=True):
        part = pair.sortby("exact")
        gaps.plot(x, part["exact"].values * 1e3, "k.-", label="exact", linewidth=1.8)
        ratios.axhline(1.0, color="0.4", linewidth=0.9, zorder=0)
        groups = _group_rules(pair)
        for place, (name, number) in enumerate(groups.items()):
            mark: Any = {"color": COLOURS[1 + number], "marker": MARKERS[number], "markersize": 6 if few else 3.5}
            mark |= {"linestyle": "none", "markerfacecolor": "none"}
            rule = part.isel(rule=number)
            gaps.plot(x, 1e3 * rule["rule_gap"], label=name, **mark)
            ratios.plot(place + offsets, rule["ratio"], **mark)
            ratios.hlines(rule["ratio"].median(), place - 0.35, place + 0.35, color="black", linewidth=1.6, zorder=2)
        if few and trials == "record":
            gaps.set_xticks(x, [fill(record_name(key), 22) for key in part["record"].values.tolist()], **tilted)
        else:
            gaps.set(xticks=[], xlabel=f"{len(x)} {trials}s, by rising required gap")
        ratios.set_xticks(range(len(groups)), groups, **tilted)
        gaps.margins(y=0.1)
    axes[0, 0].set_ylim(bottom=0.0)
    rows = "required gap (mm)", "rule over exact (-)\nbelow 1: too small"
    notes = selection, f"factors {result.attrs['factors']}"
    return finish(axes, "", rows, "Required gaps, exact and by separation rules", *notes, legend=4)


def _group_rules(pair: xr.Dataset) -> dict[str, int]:
    """Return the first of those separation rules that agree, by their names."""
    groups: dict[bytes, list[int]] = {}
    for number, gaps in enumerate(pair["rule_gap"].transpose("rule", ...).round(9)):
        groups.setdefault(gaps.values.tobytes(), []).append(number)
    if len(groups) == 1:
        return {"all rules": -1}
    return {fill(", ".join(pair["rule_name"].values[numbers]), 20): numbers[0] for numbers in groups.values()}


#: What tells groups of scenarios apart.
_GROUP = ("law", "record", "beside")


@figure_of("sensitivity", "design", SALTELLI)
def sensitivity(cube: xr.Dataset, *, value: str | None = None, ax: Any = None) -> Figure:
    """Draw which inputs of a design matter, by first and total Sobol indices, or which axes of a grid, as a tornado.

    Of a design, bars are confidence intervals. Of a grid, they go from the smallest to the largest mean at a value of
    an axis, over all values of the others; at the ends are these values, at the right is the share of the variance.
    What matters most is at the top. One column per pair or building, at its highest storey that has indices, one row
    per law, record and value of other axes of a design, three at most.
    """
    result = result_of(cube, "sensitivity")
    names = [str(name).removesuffix("_total") for name in result.data_vars if str(name).endswith("_total")]
    check_value(value, names)
    valued = [name for name in (*RESPONSES, *names) if name in names and result[f"{name}_total"].notnull().any()]
    if not valued or value not in (None, *valued):
        raise NothingToDrawError
    value = value or valued[0]
    key = f"{value}_total"
    per = next((dim for dim in ("pair", "building") if dim in result[key].dims), "scenario")
    result = with_dims(result, per, absent="")
    result = result.sel({per: labels_with_values(result, per, [key])})
    if "storey" in result[key].dims:  # the highest that has indices
        valid = result[key].notnull().any(["group", "input"])
        result = result.isel(storey=valid.cumsum("storey").argmax("storey"))
    complete = result[key].notnull().all("input").any(per).values
    groups = np.flatnonzero(complete) if complete.any() else np.arange(1)
    varied = [name for name in _GROUP if name in result.coords and len({*result[name].values[groups].tolist()}) > 1]
    result = result.isel(group=groups[:_LAWS])
    means = result.get(f"{value}_mean_interval")  # of a grid
    size = result[key] if means is None else means.diff("bound").sum("bound")
    result = result.sortby(size.mean(["group", per]).fillna(0.0))  # the largest last, at the top
    rows, n = result.sizes["group"], result.sizes["input"]
    axes = subplots(rows, result.sizes[per], (2.2, 2.4, 1.5, 0.6 + 0.3 * n), ax)
    draw = _draw_indices if means is None else _draw_effects
    extremes: list[float] = []
    for (row, column), panel in np.ndenumerate(axes):
        part = result.isel({per: column, "group": row})
        extremes += draw(panel, part, value)
        panel.axvline(0.0, color="0.6", linewidth=0.8, zorder=0)
        place = [coord_text(part, dim) for dim in (per, "storey") if dim in part.coords]
        lines = [join_nonempty(*place), _describe_group(part, varied)]
        panel.set_title("\n".join(fill(text, 34) for text in lines if text))
    inputs = [spell_units(str(name)).replace("_", " ") for name in result["input"].values]
    low, high = np.nanmin(extremes), np.nanmax(extremes)
    margin = 0.03 if means is None else 0.4 * (high - low)
    for panel in axes[:, 0]:
        panel.set(yticks=range(n), yticklabels=inputs, xlim=(low - margin, high + margin), ylim=(-0.6, n - 0.4))
    if means is not None:
        axes[0, 0].locator_params("x", nbins=6)
        axes[0, 0].set_xticks([tick for tick in axes[0, 0].get_xticks() if min(0.0, low) <= tick <= high + margin])
        words = "bars: means at values of one axis", "share: of the variance, by that axis alone"
        subject = f"mean {long_name(means, value)}"
        label, over = f"{subject} ({drawn_unit(means.attrs)[0] or '-'})", result.attrs["over"].partition(":")[0]
        return finish(axes, label, "", f"{subject}: what matters", over, *words, legend=0)
    response = str(result[key].attrs["long_name"]).removeprefix("total Sobol index: ")
    title = [f"Sobol indices of the {response}", f"{result.attrs['confidence']:.0%} intervals"]
    title.append(_describe_group(result.isel(group=0), [name for name in _GROUP if name not in varied]))
    title.append(f"{rows} of {len(groups)} groups of scenarios" if rows < len(groups) else "")
    return finish(axes, "share of the variance (-)", "input", *title, legend=1)


def _draw_indices(panel: Any, part: xr.Dataset, value: str) -> list[float]:
    """Draw both indices of each input and their intervals; return the ends of these, and of all shares."""
    extremes = [0.0, 1.0]
    for name, (label, colour, marker, up) in TABLES["indices"].items():
        y = np.arange(part.sizes["input"]) + up
        low, high = part[f"{value}_{name}_interval"].transpose("bound", "input").values
        panel.hlines(y, low, high, color=colour, linewidth=1.0)
        panel.plot(part[f"{value}_{name}"], y, color=colour, marker=marker, linestyle="none", label=label)
        extremes += [*low, *high]
    return extremes


def _draw_effects(panel: Any, part: xr.Dataset, value: str) -> list[float]:
    """Draw bars between the smallest and largest mean along each axis, where they are, and shares; return the means."""
    means = part[f"{value}_mean_interval"]
    low, high = drawn_unit(means.attrs)[1] * means.transpose("bound", "input").values
    panel.barh(range(len(low)), high - low, left=low, height=0.5, zorder=2)
    shares = part[f"{value}_first"].values
    panel.text(1.02, len(low) - 0.5, "share", fontsize=7, transform=panel.get_yaxis_transform())
    for y, ends in enumerate(part[f"{value}_at_interval"].transpose("input", "bound").values):
        lower, upper = (fill(f"{end:g}" if isinstance(end, float) else end.replace("_", " "), 14) for end in ends)
        for x, text, side, apart in ((low[y], lower, "right", -3), (high[y], upper, "left", 3)):
            panel.annotate(text, (x, y), (apart, 0), textcoords="offset points", ha=side, va="center", fontsize=7)
        panel.text(1.02, y, f"{shares[y]:.0%}", va="center", fontsize=7, transform=panel.get_yaxis_transform())
    return [*low, *high]


def _describe_group(group: xr.Dataset, names: Collection[str]) -> str:
    """Say that of a group of scenarios which `names` mean."""
    law, record, others = (str(group[name].item()) if name in names and name in group.coords else "" for name in _GROUP)
    records = "records drawn" if record == "drawn" else f"record {record_name(record)}" if record else ""
    return join_nonempty(law_name(group, law) if law else "", records, others.replace("_", " "))


@figure_of("work-precision", "trade", "setting, error, cost")
def work_precision(trade: xr.Dataset) -> Figure:
    """Draw worst error of accuracies, schemes and steps against their cost, from 'tradeoff': lower left is better.

    The cost is seconds per thousand scenarios. Along a line of a scheme the step changes. A star marks the sweep's own
    setting, a ring what no other setting is cheaper than and as accurate as. Of more than six lines those nearest the
    lower left are drawn.
    """
    chosen, front = trade.sel(population="steady", statistic="worst"), compared(trade)["front"].values
    drawn = (chosen["error"] > 0.0) & (chosen["error"] < np.inf) & (chosen["cost"] < np.inf)
    if not drawn.any():
        raise InputError("figure 'work-precision' has nothing to show: all is refused or diverged; measure finer steps")
    outputs = leading_outputs(trade)
    labels = [label.rpartition(", ")[0] for label in trade["setting"].values.tolist()]  # without steps
    names = np.array([label.replace("float32", "single precision") or "accuracy" for label in labels])
    product_of = (chosen["error"].where(drawn).max("output") * chosen["cost"]).fillna(np.inf).values
    nearest = sorted(dict.fromkeys(names), key=lambda name: (name != "accuracy", product_of[names == name].min()))
    axes = subplots(1, len(outputs), (1.2, 3.6, 4.6, 0.0))
    own = trade["setting"].values == trade.attrs["own_setting"]
    marks = (
        (front, "none cheaper and as accurate", {"marker": "o", "markersize": 11, "markerfacecolor": "none"}),
        (own, "your setting", {"marker": "*", "markersize": 13, "zorder": 4}),
    )
    for ax, output in zip(axes[0], outputs, strict=True):
        one = chosen.sel(output=output).where(drawn.sel(output=output))
        for name, style in zip(nearest[:6], MARKED, strict=False):
            line = one.isel(setting=names == name).sortby("cost")
            ax.plot(line["cost"], line["error"], label=name, **style)
        for rows, label, style in marks:
            ax.plot(one["cost"][rows], one["error"][rows], label=label, linestyle="none", color="0.35", **style)
        ax.set(yscale="log", title=get_variable(output).long_name)
        use_logarithms(ax.xaxis)
    bottom = axes[0, 0].get_ylim()[0]
    for ax, output in zip(axes[0], outputs, strict=True):
        limit = float(trade["resolution"].sel(population="steady", statistic="worst", output=output).max())
        if limit > bottom:
            label = "below what the converged solution tells"
            ax.axhspan(bottom, limit, color="0.9", zorder=0, linewidth=0, label=label)
    axes[0, 0].set_ylim(bottom=bottom)
    count = int(trade.attrs["sample_scenarios"]) - int(trade.attrs["sensitive_scenarios"])
    steps = 1e3 * trade["step"].max().item(), 1e3 * trade["step"].min().item()
    notes = f"{count} scenarios", f"steps {steps[0]:g} ms (left) to {steps[1]:g} ms (right)"
    label = "cost (s per thousand scenarios, one core)"
    return finish(axes, label, "worst relative error", "Worst error by cost: lower left is better", *notes, legend=2)
