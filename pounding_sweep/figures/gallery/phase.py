"""Phase plots: velocity against displacement of the top floors."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.analysis.rebuild import stored_scene
from pounding_sweep.figures import figure_of, one_instant
from pounding_sweep.figures.shown import heading, zoomed
from pounding_sweep.figures.style import COLOURS, put_title, subplots


@figure_of(
    "histories",
    "velocity against displacement of the top floors, in contact and out of it, from 'simulate'",
    needs=("time", "displacement", "velocity"),
    also=one_instant,
)
def phase(one: xr.Dataset, *, start: float | None = None, end: float | None = None, ax: Any = None) -> Figure:
    """Draw the velocity of each building's top floor against its displacement; where the building is in contact, bold.

    Parameters
    ----------
    one : xarray.Dataset
        What `pounding_sweep.simulate` returned.
    start, end : float, optional
        Part of the record that is drawn (s); all of it by default.
    ax : matplotlib.axes.Axes, optional
        Axes for a row of one building.
    """
    whole, one = one, zoomed(one, start, end)
    buildings = one.building.values.tolist()
    figure, axes = subplots(1, len(buildings), (1.4 + 2.6 * len(buildings), 3.6), ax)
    for panel, building in zip(axes[0], buildings, strict=True):
        here = one.sel(building=building).dropna("storey", how="all", subset=["displacement"]).isel(storey=-1)
        u, v = 1e3 * here.displacement.values, here.velocity.values
        panel.plot(u, v, color="0.55", linewidth=0.7, label="apart")
        near = _in_contact(one, building)
        panel.plot(
            np.where(near, u, np.nan), np.where(near, v, np.nan), color=COLOURS[2], linewidth=1.8, label="in contact"
        )
        panel.set_title(f"building {building}")
        panel.set_xlabel("top floor displacement (mm)")
    axes[0, 0].set_ylabel("velocity (m/s)")
    axes[0, 0].legend(loc="upper left", fontsize=8)
    put_title(figure, heading(whole))
    return figure


def _in_contact(one: xr.Dataset, building: str) -> np.ndarray:
    """Whether any floor of a building is in contact, at each instant."""
    near = np.zeros(one.sizes["time"], bool)
    if "contact_force" in one:
        names = [item.name for item in stored_scene(one).row]
        at = names.index(building)
        for pair in {at - 1, at} & set(range(len(names) - 1)):
            near |= (one.contact_force.isel(pair=pair).fillna(0.0) != 0.0).any("storey").values
    return near
