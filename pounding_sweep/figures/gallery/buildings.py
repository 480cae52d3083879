"""What each building has to bear: peak responses over its height, and where its energy went."""

from __future__ import annotations

from itertools import product
from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.figures import figure_of
from pounding_sweep.figures.select import (
    drawn_unit,
    labels_with_values,
    law_name,
    result_of,
    select_default,
    with_dims,
)
from pounding_sweep.figures.style import COLOURS, MARKED, legend_below, put_title, subplots
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
    "law",
    "floor_elevation",
    "displacement_max|displacement_min|drift_max|storey_shear_max|acceleration_max",
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
            for law in others:
                label = "other laws" if law == others[0] else ""
                _draw_profile(ax, here.sel(law=law), response, label, color="0.75", linewidth=1.0)
            if by_law and "none" in laws:
                dotted = {"color": "black", "linestyle": ":"}
                _draw_profile(ax, here.sel(law="none"), response, law_name(cube, "none"), **dotted)
            if by_law:
                bold = {"color": COLOURS[2], "marker": "o", "linewidth": 1.6}
                _draw_profile(ax, here.sel(law=own), response, "law of the row", **bold)
            for law, style in zip(laws if not by_law else (), MARKED, strict=False):
                _draw_profile(ax, here.sel(law=law), response, law_name(cube, law), **style)
            if len(response[0]) > 1:
                ax.axvline(0.0, color="0.6", linewidth=0.8, zorder=0)
            if not by_law or own == by_law[-1]:
                ax.set_xlabel(f"{response[1]} ({drawn_unit({'units': VARIABLES[response[0][0]].units})[0]})")
        if len(response[0]) == 1:
            line[0].set_xlim(left=0)
        title = f"{fill(law_name(cube, own), 18, break_on_hyphens=False)}\n" if own else ""
        line[0].set_ylabel(f"{title}elevation (m)")
    for ax, building in zip(axes[0], buildings, strict=True):
        ax.set_title(f"building {building}")
    axes[0, 0].set_ylim(bottom=0)
    legend_below(figure, axes[0, 0], most=3 if by_law else 4)
    put_title(figure, shown)
    return figure


def _draw_profile(ax: Any, one: xr.Dataset, response: Any, label: str, **style: Any) -> None:
    """Draw a response, one of `_ROWS`, of one building under one law; of two variables both."""
    names, _, where = response
    floors = np.isfinite(one.floor_elevation.values)
    heights = one.floor_elevation.values[floors]
    for name in (name for name in names if name in one.data_vars):
        x, y, marked = one[name].values[floors] * drawn_unit({"units": VARIABLES[name].units})[1], heights, slice(None)
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
    *("building", "energy_input", "energy_damping", "energy_kinetic", "energy_strain"),
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
    put_title(figure, shown)
    return figure
