"""Histories of one scenario: the ground, the floors and the contacts."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.figures import figure_of, one_instant
from pounding_sweep.figures.shown import WIDTH, heading, zoomed
from pounding_sweep.figures.style import COLOURS, history_look, legend_beside, put_title


@figure_of(
    "histories",
    "ground acceleration, floor displacements and contact forces against time, peaks marked, from 'simulate'",
    needs=("time", "ground_acceleration", "displacement"),
    also=one_instant,
)
def histories(one: xr.Dataset, *, start: float | None = None, end: float | None = None) -> Figure:
    """Draw the histories of one scenario: ground acceleration, top floors, contact forces.

    Circles are the peaks that are reported, located between the instants of the histories, at the instant next to them.

    Parameters
    ----------
    one : xarray.Dataset
        What `pounding_sweep.simulate` returned.
    start, end : float, optional
        Part of the record that is drawn (s); all of it by default.
    """
    whole, one = one, zoomed(one, start, end)
    time = one.time.values
    pairs = one.pair.values.tolist() if "contact_force" in one else []
    figure = Figure(figsize=(7.2, 1.4 + 1.5 * (2 + len(pairs))), layout="constrained")
    axes = figure.subplots(2 + len(pairs), 1, sharex=True)
    axes[0].plot(time, one.ground_acceleration, color="black", linewidth=0.7)
    axes[0].set_ylabel("ground acc. (m/s²)")
    for number, building in enumerate(one.building.values.tolist()):
        floors = whole.displacement.sel(building=building).dropna("storey", how="all")
        top = floors.isel(storey=-1)
        axes[1].plot(time, top.sel(time=time) * 1e3, label=building, **history_look(number))
        for name, sign in (("displacement_max", 1.0), ("displacement_min", -1.0)):
            if name in whole:
                peak = whole[name].sel(building=building, storey=top.storey)
                _mark(axes[1], sign * top, float(peak) * 1e3, (time[0], time[-1]), number)
    axes[1].set_ylabel("top floor (mm)")
    legend_beside(axes[1])
    low, high = 0.0, 0.0
    for ax, pair in zip(axes[2:], pairs, strict=True):
        forces = whole.contact_force.sel(pair=pair).fillna(0.0)
        for number, storey in enumerate(one.storey.values.tolist()):
            force = forces.sel(storey=storey)
            if force.sel(time=time).any():
                ax.plot(time, force.sel(time=time), label=f"storey {storey}", **history_look(number))
                if "impact_force_max" in whole:
                    reported = float(whole.impact_force_max.sel(pair=pair, storey=storey))
                    high = max(high, _mark(ax, force, reported, (time[0], time[-1]), number))
        if not ax.lines:
            ax.text(0.5, 0.5, "no contact", transform=ax.transAxes, ha="center", va="center", color="0.35")
        forces = forces.sel(time=time)
        low, high = min(low, float(forces.min())), max(high, float(forces.max()))
        ax.set_ylabel(f"{pair}\nforce (kN)")
        legend_beside(ax)
    for ax in axes[2:]:
        ax.set_ylim(1.05 * low, 1.08 * high or 1.0)
    axes[-1].set_xlabel("time (s)")
    axes[-1].set_xlim(time[0], time[-1])
    put_title(figure, heading(whole, width=WIDTH))
    return figure


def _mark(ax: Any, series: xr.DataArray, peak: float, window: tuple[float, float], number: int) -> float:
    """Mark a reported peak at the instant at which its history is largest, if that is drawn; return its height."""
    at = float(series.time[int(np.nanargmax(series.values))])
    if not window[0] <= at <= window[1] or not np.isfinite(peak):
        return 0.0
    ax.plot(at, peak, "o", markerfacecolor="none", markersize=6, color=COLOURS[number % len(COLOURS)])
    return peak
