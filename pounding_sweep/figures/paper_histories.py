"""Figures 11 to 13 and 17 to 21 of the paper: histories of structural energy, roof displacement and impact force."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.figures.paper_grid import model_grid, model_label
from pounding_sweep.figures.style import COLOURS, legend_below, styled
from pounding_sweep.paper.published import record_title
from pounding_sweep.paper.readings import READINGS

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

#: A record's end is not drawn once everything stays below this share of the largest value.
QUIET = 0.1


@styled
def structural_energy(histories: xr.Dataset, building: str) -> Figure:
    """Draw the structural energy of a building against time, model by model.

    Parameters
    ----------
    histories : xarray.Dataset
        ``structural_energy`` (kN m) on ``reading``, ``law``, ``record``, ``time`` (s), ``building``.
    building : str
        Which one.

    Returns
    -------
    matplotlib.figure.Figure
    """
    here = histories.sel(building=building)

    def line(ax: Any, one: xr.Dataset, look: dict[str, Any]) -> None:
        values = one["structural_energy"].dropna("time")
        ax.plot(values["time"], values, **look)
        ax.set_xlim(0.0, float(values["time"][-1]))

    # records differ by an order of magnitude
    figure = model_grid(here, line, "time (s)", "energy (kN m)", share_y=False)
    for ax in figure.axes:
        ax.set_ylim(bottom=0)
    return figure


@styled
def roof_displacement(histories: xr.Dataset, building: str, record: str) -> Figure:
    """Draw the displacement of a roof against time, each model on that without pounding.

    Parameters
    ----------
    histories : xarray.Dataset
        ``roof_displacement`` (m) on ``reading``, ``law``, ``record``, ``time`` (s), ``building``.
    building, record : str
        Which ones.

    Returns
    -------
    matplotlib.figure.Figure
    """
    here = histories["roof_displacement"].sel(building=building, record=record).dropna("time") * 1e3
    return _by_model(here, "displacement (mm)", alone=True)


@styled
def roof_force(histories: xr.Dataset, pair: str, record: str) -> Figure:
    """Draw the contact force between two roofs against time, model by model.

    Parameters
    ----------
    histories : xarray.Dataset
        ``roof_force`` (kN) on ``reading``, ``law``, ``record``, ``time`` (s), ``pair``.
    pair, record : str
        Which ones.

    Returns
    -------
    matplotlib.figure.Figure
    """
    here = histories["roof_force"].sel(pair=pair, record=record).dropna("time", how="all") * 1e-3
    return _by_model(here, "force (MN)", alone=False)


def _by_model(values: xr.DataArray, label: str, alone: bool) -> Figure:
    """One row per model with contact, one column per reading; without the quiet end of the record."""
    from matplotlib.figure import Figure

    readings = values["reading"].values.tolist()
    laws = [law for law in values["law"].values.tolist() if law != "none"]
    time = values["time"].values
    loud = abs(values).max([dim for dim in values.dims if dim != "time"])
    last = float(time[np.flatnonzero(loud >= QUIET * loud.max())[-1]])
    figure = Figure(figsize=(2.0 + 4.2 * len(readings), 0.8 + 1.25 * len(laws)), layout="constrained")
    axes = figure.subplots(len(laws), len(readings), squeeze=False, sharex=True, sharey=alone)
    for row, law in enumerate(laws):
        for column, reading in enumerate(readings):
            ax = axes[row, column]
            one = values.sel(reading=reading)
            if alone:
                ax.plot(time, one.sel(law="none"), color="0.6", linewidth=1.6, label="no pounding")
            ax.plot(time, one.sel(law=law), color=COLOURS[1], linewidth=0.9, label="with pounding")
            ax.set_title(model_label(law), loc="left", fontsize=8)
            ax.set_xlim(0.0, 1.05 * last)
    record = record_title(str(values["record"].item()))
    for column, reading in enumerate(readings):
        title = f"{record}, {READINGS[reading].label}\n{model_label(laws[0])}"
        axes[0, column].set_title(title, loc="left", fontsize=8)
        axes[-1, column].set_xlabel("time (s)")
    if alone:
        legend_below(figure, axes[0, 0], most=2)
    else:
        for ax in axes.ravel():
            ax.set_ylim(bottom=0)
    figure.supylabel(label, fontsize=9)
    return figure
