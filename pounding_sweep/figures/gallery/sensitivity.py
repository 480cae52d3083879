"""Sobol indices of the inputs of a design, with their intervals."""

from __future__ import annotations

from collections.abc import Collection
from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.figures import figure_of
from pounding_sweep.figures.shown import RESPONSES, law_name, record_name, result_of
from pounding_sweep.figures.style import COLOURS, joined, label_edges, legend_below, put_title, subplots

#: Rows of panels at most.
_GROUPS = 3
#: What tells groups of scenarios apart.
_GROUP = ("law", "record", "beside")
#: What is drawn of each input: how it is called, colour, marker, and how far above its place.
_INDICES = {
    "first": ("first index: of the input alone", COLOURS[1], "o", 0.16),
    "total": ("total index: with what it does together with others", COLOURS[2], "s", -0.16),
}
#: Characters of a line of a panel's title.
_TITLE = 34


def _lacks(cube: xr.Dataset) -> str:
    """Say that a dataset is neither of a design that has indices nor these themselves."""
    return "" if {"input", "design_block"} & {*map(str, cube.coords)} else 'a design of kind "saltelli"'


@figure_of("design", "which inputs of a design matter: first and total Sobol indices", also=_lacks)
def sensitivity(cube: xr.Dataset, *, value: str | None = None, ax: Any = None) -> Figure:
    """Draw the Sobol indices of an output with their intervals; inputs that matter most are at the top.

    One column per pair or building, at its highest storey that has indices, one row per law, record and value of
    other axes, three at most.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube of a design of kind "saltelli", or what `pounding_sweep.analysis.sensitivity` made of one.
    value : str, optional
        An output; by default the peak impact force, else the first response that has indices.
    ax : matplotlib.axes.Axes, optional
        Axes for a figure of one panel.
    """
    result = result_of(cube, "sensitivity")
    names = [str(name).removesuffix("_total") for name in result.data_vars if str(name).endswith("_total")]
    if value not in (None, *names):
        raise InputError(unknown("value to draw", value, names))
    there = [name for name in (*RESPONSES, *names) if name in names and bool(result[f"{name}_total"].notnull().any())]
    value = value or next(iter(there or names))
    total = result[f"{value}_total"]
    per = next((dim for dim in ("pair", "building") if dim in total.dims), "")
    places = [
        _highest(result.sel({per: end}) if per else result, value) for end in (result[per].values if per else [0])
    ]
    held = np.any([place[f"{value}_total"].notnull().all("input") for place in places], axis=0)
    groups = np.flatnonzero(held) if held.any() else np.arange(1)
    shown = groups[:_GROUPS]
    rank = np.mean([place[f"{value}_total"].isel(group=shown).mean("group") for place in places], axis=0)
    order = np.argsort(np.nan_to_num(rank), kind="stable")  # the largest last, at the top
    size = (2.2 + 2.4 * len(places), 1.5 + len(shown) * (0.6 + 0.3 * len(order)))
    figure, axes = subplots(len(shown), len(places), size, ax)
    varied = [name for name in _GROUP if name in result.coords and len({*result[name].values[groups].tolist()}) > 1]
    ends = [0.0, 1.0]
    for row, group in enumerate(shown):
        for column, place in enumerate(places):
            part = place.isel(group=int(group), input=order)
            ends += _panel(axes[row, column], part, value)
            titles = [f"{dim} {part[dim].item()}" for dim in (per, "storey") if dim in part.coords]
            lines = [joined(*titles), _told(part, varied)]
            axes[row, column].set_title("\n".join(fill(text, _TITLE) for text in lines if text))
    axes[0, 0].set(xlim=(min(ends) - 0.03, max(ends) + 0.03), ylim=(-0.6, len(order) - 0.4))
    inputs = [str(name).replace("_", " ") for name in result["input"].values[order]]
    for panel in axes[:, 0]:
        panel.set(yticks=range(len(inputs)), yticklabels=inputs, ylim=axes[0, 0].get_ylim())
    label_edges(axes, "share of the variance (-)", ["input"] * len(shown))
    legend_below(figure, axes[0, 0], most=1)
    what = str(total.attrs["long_name"]).removeprefix("total Sobol index: ")
    cut = f"{len(shown)} of {len(groups)} groups of scenarios" if len(shown) < len(groups) else ""
    own = _told(result.isel(group=int(shown[0])), [name for name in _GROUP if name not in varied])
    put_title(figure, f"Sobol indices of the {what}", f"{result.attrs['confidence']:.0%} intervals", own, cut)
    return figure


def _highest(part: xr.Dataset, value: str) -> xr.Dataset:
    """Return the indices of the highest storey that has any."""
    if "storey" not in part[f"{value}_total"].dims:
        return part
    there = part[f"{value}_total"].notnull().any([dim for dim in part[f"{value}_total"].dims if dim != "storey"])
    return part.isel(storey=int(np.flatnonzero(there)[-1]) if bool(there.any()) else 0)


def _panel(ax: Any, part: xr.Dataset, value: str) -> list[float]:
    """Draw the indices of one output at one place; returns the ends of the longest interval."""
    ends = []
    for name, (label, colour, marker, up) in _INDICES.items():
        at = np.arange(part.sizes["input"]) + up
        low, high = part[f"{value}_{name}_interval"].transpose("bound", "input").values
        ax.hlines(at, low, high, color=colour, linewidth=1.0)
        ax.plot(part[f"{value}_{name}"].values, at, color=colour, marker=marker, linestyle="none", label=label)
        ends += [float(end) for end in (*low, *high) if np.isfinite(end)]
    ax.axvline(0.0, color="0.6", linewidth=0.8, zorder=0)
    return ends


def _told(group: xr.Dataset, names: Collection[str]) -> str:
    """Say that of a group of scenarios which `names` mean."""
    law, record, beside = (str(group[name].item()) if name in names and name in group.coords else "" for name in _GROUP)
    of = "records drawn" if record == "drawn" else f"record {record_name(record)}" if record else ""
    return joined(law_name(group, law) if law else "", of, beside.replace("_", " "))
