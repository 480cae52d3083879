"""Histories of one scenario: the ground, the floors and the contacts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pounding_sweep.figures import figure_of, one_instant
from pounding_sweep.figures.shown import WIDTH, heading
from pounding_sweep.figures.style import COLOURS, LINES, put_title

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


@figure_of(
    "histories",
    "ground acceleration, floor displacements and contact forces against time, from 'simulate'",
    needs=("time", "ground_acceleration", "displacement"),
    also=one_instant,
)
def histories(one: xr.Dataset) -> Figure:
    """Draw the histories of one scenario: ground acceleration, top floors, contact forces."""
    from matplotlib.figure import Figure

    time = one.time.values
    pairs = one.pair.values.tolist() if "contact_force" in one else []
    figure = Figure(figsize=(7.2, 1.4 + 1.5 * (2 + len(pairs))), layout="constrained")
    axes = figure.subplots(2 + len(pairs), 1, sharex=True)
    axes[0].plot(time, one.ground_acceleration, color="black", linewidth=0.7)
    axes[0].set_ylabel("ground acc. (m/s²)")
    for number, building in enumerate(one.building.values.tolist()):
        floors = one.displacement.sel(building=building).dropna("storey", how="all")
        axes[1].plot(time, floors.isel(storey=-1) * 1e3, label=building, **_line(number))
    axes[1].set_ylabel("top floor (mm)")
    _legend(axes[1])
    low, high = 0.0, 0.0
    for ax, pair in zip(axes[2:], pairs, strict=True):
        forces = one.contact_force.sel(pair=pair).fillna(0.0) * 1e-3
        for number, storey in enumerate(one.storey.values.tolist()):
            if forces.sel(storey=storey).any():
                ax.plot(time, forces.sel(storey=storey), label=f"storey {storey}", **_line(number))
        if not ax.lines:
            ax.text(0.5, 0.5, "no contact", transform=ax.transAxes, ha="center", va="center", color="0.35")
        low, high = min(low, float(forces.min())), max(high, float(forces.max()))
        ax.set_ylabel(f"{pair}\nforce (MN)")
        _legend(ax)
    for ax in axes[2:]:
        ax.set_ylim(1.05 * low, 1.05 * high or 1.0)
    axes[-1].set_xlabel("time (s)")
    axes[-1].set_xlim(time[0], time[-1])
    put_title(figure, heading(one, width=WIDTH))
    return figure


def _line(number: int) -> dict[str, Any]:
    """Colour and line style: histories have too many points for markers."""
    return {"color": COLOURS[number % len(COLOURS)], "linestyle": LINES[number % len(LINES)], "linewidth": 1.0}


def _legend(ax: Any) -> None:
    """Put the legend beside the panel, where it hides nothing."""
    if ax.lines:
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
