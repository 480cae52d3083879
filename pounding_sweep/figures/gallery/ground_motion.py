"""Ground motions: acceleration histories beside response spectra."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.base.errors import InputError
from pounding_sweep.figures import figure_of
from pounding_sweep.figures.gallery.response_spectra import MOST_LINES, draw_spectra
from pounding_sweep.figures.shown import record_name
from pounding_sweep.figures.style import COLOURS

#: More histories than this in one column are too flat to be read.
_ROWS = 12


@figure_of(
    "spectra",
    "acceleration histories and response spectra of records, as 'records plot' draws them",
    needs=("record", "time", "ground_acceleration", "period", "pseudo_acceleration", "damping_ratio"),
)
def ground_motion(motions: xr.Dataset) -> Figure:
    """Draw the acceleration history of each record, and the response spectra of all."""
    n = motions.sizes["record"]
    if not n:
        msg = "there is no record to draw; give at least one"
        raise InputError(msg)
    columns = math.ceil(n / _ROWS)
    rows = math.ceil(n / columns)
    width = 4.6 if columns == 1 else 2.7 * columns
    figure = Figure(figsize=(width + 4.2, max(4.2, 0.6 + 0.95 * rows)), layout="constrained")
    halves: Any = figure.subfigures(1, 2, width_ratios=[width, 4.2])
    left, right = halves
    axes = left.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for number, ax in enumerate(axes.T.ravel()):
        if number < n:
            colour = COLOURS[number] if n <= MOST_LINES else COLOURS[0]
            _history(ax, motions.isel(record=number), colour)
        else:
            ax.set_axis_off()
    limit = 1.3 * float(np.nanmax(np.abs(motions["ground_acceleration"].values)) or 1.0)
    axes[0, 0].set_ylim(-limit, limit)
    axes[0, 0].set_xlim(0.0, float(np.nanmax(motions["time"].values)) or 1.0)
    for column in range(columns):
        axes[min(rows, n - column * rows) - 1, column].tick_params(labelbottom=True)
    left.supxlabel("time (s)", fontsize=9)
    left.supylabel("ground acceleration (m/s²); dots: peaks", fontsize=9)
    ax = right.subplots()
    draw_spectra(ax, motions["pseudo_acceleration"], "pseudo-acceleration (m/s²)")
    ax.set_xlabel("period (s)")
    ax.set_ylim(bottom=0)
    ax.set_title(f"response spectra, damping ratio {motions['damping_ratio'].item():g}")
    if n > 1:
        right.legend(loc="outside lower center", ncols=2)
    return figure


def _history(ax: Any, motion: xr.Dataset, colour: str) -> None:
    time, acceleration = motion["time"].values, motion["ground_acceleration"].values
    peak = int(np.nanargmax(np.abs(acceleration)))
    ax.plot(time, acceleration, color=colour, linewidth=0.7)
    ax.plot(time[peak], acceleration[peak], "o", color=colour, markersize=3.5)
    ax.set_title(
        f"{record_name(motion['record'].item())}: {abs(acceleration[peak]):.3g} m/s²", loc="left", fontsize=7, pad=2
    )
