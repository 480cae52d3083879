"""Contact force against penetration: the loops of a contact law."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.figures import figure_of, one_instant
from pounding_sweep.figures.shown import heading, zoomed
from pounding_sweep.figures.style import history_look, put_title, subplots


@figure_of(
    "histories",
    "contact force against penetration, pair by pair, from 'simulate'",
    needs=("time", "contact_force", "penetration"),
    also=one_instant,
)
def force_penetration(
    one: xr.Dataset, *, start: float | None = None, end: float | None = None, ax: Any = None
) -> Figure:
    """Draw the contact force against the penetration: one loop per impact, whose area is the energy it took.

    Parameters
    ----------
    one : xarray.Dataset
        What `pounding_sweep.simulate` returned. Contacts are short: smaller steps (``output_step``) draw rounder loops.
    start, end : float, optional
        Part of the record that is drawn (s); all of it by default.
    ax : matplotlib.axes.Axes, optional
        Axes for a row of one pair.
    """
    whole, one = one, zoomed(one, start, end)
    pairs = one.pair.values.tolist()
    figure, axes = subplots(1, len(pairs), (1.4 + 3.2 * len(pairs), 3.8), ax)
    for panel, pair in zip(axes[0], pairs, strict=True):
        for number, storey in enumerate(one.storey.values.tolist()):
            depth, force = (one[name].sel(pair=pair, storey=storey).values for name in ("penetration", "contact_force"))
            near = depth > 0.0  # with the instants before and after, at which floors are apart
            near[:-1] |= near[1:]
            near[1:] |= near[:-1]
            if near.any():
                loops = [np.where(near, values, np.nan) for values in (1e3 * depth, force)]
                panel.plot(*loops, label=f"storey {storey}", **history_look(number))
        if panel.lines:
            panel.legend(loc="upper left", fontsize=8)
        else:
            panel.text(0.5, 0.5, "no contact", transform=panel.transAxes, ha="center", va="center", color="0.35")
        panel.set_title(f"pair {pair}")
        panel.set_xlabel("penetration (mm)")
    axes[0, 0].set_ylabel("contact force (kN)")
    put_title(figure, heading(whole))
    return figure
