"""How far floors came towards each other, against the gap between them."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.analysis.rebuild import stored_scene
from pounding_sweep.figures import figure_of, one_instant
from pounding_sweep.figures.shown import WIDTH, heading, zoomed
from pounding_sweep.figures.style import COLOURS, history_look, legend_beside, put_title, subplots


@figure_of(
    "histories",
    "relative displacement of the floors that can meet against time, beside their gap, onsets marked, from 'simulate'",
    needs=("time", "pair", "displacement"),
    also=one_instant,
)
def closing(one: xr.Dataset, *, start: float | None = None, end: float | None = None, ax: Any = None) -> Figure:
    """Draw the displacement of each left floor less that of the right one: they touch where it reaches the gap.

    Circles mark the onsets of contact that the histories show. Where there are bumpers, floors touch their thickness
    earlier.

    Parameters
    ----------
    one : xarray.Dataset
        What `pounding_sweep.simulate` returned.
    start, end : float, optional
        Part of the record that is drawn (s); all of it by default.
    ax : matplotlib.axes.Axes, optional
        Axes for a row of one pair.
    """
    whole, one = one, zoomed(one, start, end)
    scene, time = stored_scene(one), one.time.values
    moved = one.displacement.transpose("time", "building", "storey").values
    floors = [moved[:, b, : building.n_storeys] for b, building in enumerate(scene.buildings)]
    u = np.column_stack(floors)
    pairs = scene.pair_names
    figure, axes = subplots(len(pairs), 1, (7.2, 1.2 + 2.0 * len(pairs)), ax)
    for number, (pair, gap) in enumerate(zip(pairs, scene.gaps, strict=True)):
        panel = axes[number, 0]
        onsets: list[tuple[float, Any]] = []
        both = zip(scene.contacts, 1e3 * (gap - scene.thicknesses()), strict=True)
        mine = [(contact, face) for contact, face in both if contact.pair == number]
        for line, (contact, face) in enumerate(mine):
            relative = 1e3 * sum(share * u[:, floor] for floor, share in contact.ends)
            label = f"storey {contact.storey}{' and columns' if contact.struck >= 0 else ''}"
            panel.plot(time, relative, label=label, **history_look(line))
            closed = relative > face
            onsets.append((face, time[1:][closed[1:] & ~closed[:-1]]))
        panel.axhline(1e3 * gap, color="0.4", linewidth=1.6, label="gap")
        for face in sorted({face for _, face in mine} - {1e3 * gap}):
            panel.axhline(face, color="0.4", linewidth=1.6, linestyle="--", label="bumpers")
        panel.axhspan(1e3 * gap, max(1e3 * gap, panel.get_ylim()[1]), color="0.9", linewidth=0.0, zorder=0)
        for line, (face, at) in enumerate(onsets):
            if len(at):
                look = {"markerfacecolor": "white", "markersize": 5, "color": COLOURS[line % len(COLOURS)]}
                panel.plot(at, np.full(len(at), face), "o", zorder=3, **look)
        panel.set_ylabel(f"{pair}\nrelative displacement (mm)")
        panel.set_xlim(time[0], time[-1])
        legend_beside(panel)
    axes[-1, 0].set_xlabel("time (s)")
    put_title(figure, heading(whole, width=WIDTH))
    return figure
