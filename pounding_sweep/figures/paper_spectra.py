"""Figures 14 to 16 of the paper: spectra of the total acceleration of one building's roof."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pounding_sweep.figures.paper_grid import model_grid
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

    def line(ax: Any, one: xr.Dataset, look: dict[str, Any]) -> None:
        ax.plot(one["period"], one["pseudo_acceleration"] / STANDARD_GRAVITY, **look)

    figure = model_grid(here, line, "period (s)", "spectral acceleration (g)")
    for ax in figure.axes:
        ax.set(xscale="log", yscale="log")
        ax.set_xticks([0.03, 0.1, 0.3, 1, 3], labels=["0.03", "0.1", "0.3", "1", "3"])
        ax.minorticks_off()
    return figure
