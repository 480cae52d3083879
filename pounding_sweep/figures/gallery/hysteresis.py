"""Hysteresis of storeys that yield: shear against drift, building by building."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.figures import figure_of
from pounding_sweep.figures.shown import WIDTH, heading
from pounding_sweep.figures.style import COLOURS, put_title

#: Panels in a row of the figure, and storeys in a panel: those whose drifts are largest.
COLUMNS, STOREYS = 3, 4


@figure_of(
    "histories",
    "storey shear against drift of the storeys that yield, from 'simulate'",
    needs=("time", "storey_drift", "storey_shear", "plastic_drift"),
)
def hysteresis(one: xr.Dataset) -> Figure:
    """Draw the hysteresis loops of each building's storeys."""
    names = one.building.values.tolist()
    columns = min(COLUMNS, len(names))
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(1.0 + 3.1 * columns, 0.9 + 3.0 * rows), layout="constrained")
    axes = np.atleast_1d(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)).ravel()
    for ax in axes[len(names) :]:
        ax.set_visible(False)
    for place, (ax, building) in enumerate(zip(axes, names, strict=False)):
        mine = one.sel(building=building).dropna("storey", how="all", subset=["storey_drift"])
        largest = np.argsort(-np.abs(mine.storey_drift).max("time").values)[:STOREYS]
        for number in sorted(largest.tolist(), reverse=True):  # the lowest storey is drawn last
            part = mine.isel(storey=number)
            yields = "" if bool((part.plastic_drift != 0.0).any()) else ", elastic"
            ax.plot(
                part.storey_drift * 1e3,
                part.storey_shear * 1e-3,
                color=COLOURS[number % len(COLOURS)],
                linewidth=0.7,
                label=f"storey {int(part.storey)}{yields}",
            )
        ax.set_title(building, fontsize=9)
        ax.legend(*(items[::-1] for items in ax.get_legend_handles_labels()), loc="upper left", fontsize=7)
        if place >= len(names) - columns:
            ax.set_xlabel("drift (mm)")
            ax.tick_params(labelbottom=True)
        if place % columns == 0:
            ax.set_ylabel("storey shear (MN)")
    put_title(figure, heading(one, width=WIDTH))
    return figure
