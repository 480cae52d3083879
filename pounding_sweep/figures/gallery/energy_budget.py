"""Where the energy of each building went, law by law, and what the contacts took."""

from __future__ import annotations

from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.base.errors import InputError
from pounding_sweep.figures import figure_of
from pounding_sweep.figures.shown import along, labels_with_values, law_name, middle, nothing_to_draw, result_of
from pounding_sweep.figures.style import COLOURS, legend_below, put_title

#: Parts of the input, from below; told apart by colour and hatching.
_PARTS: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("energy_damping", "lost in damping", {"color": COLOURS[1]}),
    ("hysteretic_energy", "lost in yielding", {"color": COLOURS[4], "hatch": "xx"}),
    ("energy_links", "given to links", {"color": COLOURS[3], "hatch": "--"}),
    ("stored", "kinetic and strain at the end", {"color": COLOURS[6], "hatch": ".."}),
    ("energy_transfer", "given to neighbours and contacts", {"color": COLOURS[2], "hatch": "//"}),
)


@figure_of(
    "cube",
    "where the energy of each building went, law by law",
    needs=("building", "energy_input", "energy_damping", "energy_kinetic", "energy_strain"),
)
def energy_budget(cube: xr.Dataset) -> Figure:
    """Draw each building's energy budget at the end of the record, one bar per law that has values.

    One panel per building: what was lost in damping (and in yielding, or given to links, where there are), what is left
    and what was given away, stacked; energy taken from neighbours hangs below zero. A line marks the input, which the
    bar's parts sum to. The last panel is the work that the contacts of each pair took. Of all axes but ``law`` the
    middle value is shown: an energy balance is one scenario's.
    """
    result = result_of(cube, "energy")
    result, shown = middle(result, ("law",), ["energy_input"])
    result = along(result, "law", absent="")
    laws, buildings = labels_with_values(result, "law", ["energy_input"]), result["building"].values.tolist()
    if not laws:
        raise InputError(nothing_to_draw(cube, "energy-budget"))
    result = result.sel(law=laws)
    names = [fill(law_name(result, law), 16) for law in laws]
    result["stored"] = result["energy_kinetic"] + result["energy_strain"]
    panels = len(buildings) + ("contact_work" in result)
    longest = max(len(line) for name in names for line in name.split("\n"))
    figure = Figure(figsize=(1.0 + 1.9 * panels, 3.6 + 0.09 * longest), layout="constrained")
    axes = figure.subplots(1, panels, squeeze=False)[0]
    for ax in axes[1 : len(buildings)]:  # the contacts' work has a scale of its own
        ax.sharey(axes[0])
        ax.tick_params(labelleft=False)
    x = np.arange(len(laws))
    highest = [np.nanmax(result["energy_input"].values)]
    lowest = [0.0]
    for ax, building in zip(axes, buildings, strict=False):
        part = result.sel(building=building)
        above, below = np.zeros(len(laws)), np.zeros(len(laws))
        for name, label, style in (part for part in _PARTS if part[0] in result):
            values = np.nan_to_num(part[name].values)
            ax.bar(
                x, values, 0.7, bottom=np.where(values >= 0.0, above, below), label=label, edgecolor="white", **style
            )
            above, below = above + np.maximum(values, 0.0), below + np.minimum(values, 0.0)
        highest.append(above.max())
        lowest.append(below.min())
        ends = part["energy_input"].values
        ax.hlines(ends, x - 0.42, x + 0.42, color="black", linewidth=1.6, label="input")
        ax.set_title(f"building {building}")
    if "contact_work" in result:
        _work(axes[-1], result, x)
    for ax in axes:
        ax.axhline(0.0, color="black", linewidth=0.8)
        ax.set_xticks(x, names, rotation=60, ha="right", rotation_mode="anchor")
        ax.grid(visible=False, axis="x")
        ax.set_axisbelow(True)
    low, high = min(lowest), max(highest)
    margin = 0.05 * (high - low) or 1.0  # else bars would end at the frame
    axes[0].set_ylim(low - margin if low < 0.0 else 0.0, high + margin)
    axes[0].set_ylabel("energy (kN m)")
    legend_below(figure, axes[0], most=2)
    put_title(figure, shown)
    return figure


def _work(ax: Any, result: xr.Dataset, x: np.ndarray) -> None:
    """Draw bars of the work of each pair's contacts, side by side, each with its name."""
    pairs = result["pair"].values.tolist()
    width = 0.7 / len(pairs)
    shades = np.linspace(0.25, 0.75, len(pairs))
    for number, (pair, shade) in enumerate(zip(pairs, shades, strict=True)):
        at = x - 0.35 + (number + 0.5) * width
        ax.bar(at, result["contact_work"].sel(pair=pair).values, width, color=str(shade), label=pair)
    ax.set_title("work of the contacts (kN m)")
    ax.margins(y=0.3)  # room for the legend above the bars
    ax.legend(loc="upper right", fontsize=8)
