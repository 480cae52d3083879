"""Impact forces, amplifications and laws over a reference law along an axis of the sweep, a line for each law."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.analysis.comparisons.amplification import needed_for
from pounding_sweep.analysis.scenarios import pounding_only
from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.figures import CONTACT, NO_CONTACT, figure_of
from pounding_sweep.figures.select import (
    PlotAxis,
    choose_axis,
    labels_with_values,
    law_name,
    over_storeys,
    plot_axis,
    result_of,
    scale_axis,
    select_default,
    with_dims,
)
from pounding_sweep.figures.style import MARKED, finish, subplots

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
    *("law", "gap", "pair", "impact_force_max", "impact_count", CONTACT),
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
    finish(figure, axes, axis.label, [_FORCES[name] for name in rows], shown)
    return figure


@figure_of(
    "amplification",
    "cube",
    "responses with pounding over responses without, by building and law",
    *("law", f"{_RESPONSES}|{_RATIOS}", CONTACT, f"{NO_CONTACT}|{_RATIOS}"),
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
    finish(figure, axes, axis.label, [f"{_AMPLIFIED[name]}\nover no pounding (-)" for name in rows], shown, over)
    return figure


@figure_of(
    "law-comparison",
    "cube",
    "impact forces over those of a reference law, at equal nominal and at equal realised restitution",
    *("law", "pair", "|".join([*_COMPARED, *(f"{name}_compared" for name in _COMPARED)]), "several law"),
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
    finish(figure, axes, label, rows, f"reference law: {law_name(ratio, reference)}", shown)
    return figure
