"""Figures 14 to 16 of the paper: spectra of the total acceleration of one building's roof."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pounding_sweep.figures.paper_grid import label_grid, model_label, model_look, record_grid
from pounding_sweep.figures.style import styled
from pounding_sweep.records.record import STANDARD_GRAVITY

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


@styled
def roof_spectra(spectra: xr.Dataset, building: str) -> Figure:
    """Draw the pseudo-acceleration spectra of a roof, model by model.

    Parameters
    ----------
    spectra : xarray.Dataset
        ``pseudo_acceleration`` (m/s2) on ``reading``, ``law``, ``record``, ``building``, ``period`` (s).
    building : str
        Which one.

    Returns
    -------
    matplotlib.figure.Figure
    """
    here = spectra.sel(building=building)
    figure, panels = record_grid(here)
    for ax, place in panels:
        for law in here["law"].values.tolist():
            values = here["pseudo_acceleration"].sel({**place, "law": law}) / STANDARD_GRAVITY
            ax.plot(values["period"], values, label=model_label(law), **model_look(law))
        ax.set(xscale="log", yscale="log")
        ax.set_xticks([0.03, 0.1, 0.3, 1, 3], labels=["0.03", "0.1", "0.3", "1", "3"])
        ax.minorticks_off()
    label_grid(figure, here["reading"].values.tolist(), "period (s)", "spectral acceleration (g)")
    return figure
