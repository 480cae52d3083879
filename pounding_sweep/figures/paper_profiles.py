"""Figures 5 to 10 of the paper: signed peak displacement and peak shear over the height of one building."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.figures.paper_grid import model_grid
from pounding_sweep.figures.style import styled

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


@styled
def displacement_profiles(cube: xr.Dataset, building: str) -> Figure:
    """Draw the signed peak displacements of a building's floors, model by model.

    Parameters
    ----------
    cube : xarray.Dataset
        ``displacement_max`` and ``displacement_min`` (m) on ``reading``, ``law``, ``record``, ``building``,
        ``storey``.
    building : str
        Which one.

    Returns
    -------
    matplotlib.figure.Figure
    """
    here = cube.sel(building=building)
    storeys = np.concatenate([[0], here["storey"].values])

    def line(ax: Any, one: xr.Dataset, look: dict[str, Any]) -> None:
        for name, label in (("displacement_max", look["label"]), ("displacement_min", None)):
            ax.plot(np.concatenate([[0.0], one[name].values]) * 1e3, storeys, **{**look, "label": label})

    figure = model_grid(here, line, "displacement (mm)", "floor")
    for ax in figure.axes:
        ax.axvline(0.0, color="0.4", linewidth=0.8)
        ax.set_yticks(storeys)
    return figure


@styled
def shear_profiles(cube: xr.Dataset, building: str) -> Figure:
    """Draw the peak shears of a building's storeys, model by model.

    Parameters
    ----------
    cube : xarray.Dataset
        ``storey_shear_max`` (kN) on ``reading``, ``law``, ``record``, ``building``, ``storey``.
    building : str
        Which one.

    Returns
    -------
    matplotlib.figure.Figure
    """
    here = cube.sel(building=building)
    edges = np.concatenate([[0], here["storey"].values])

    def line(ax: Any, one: xr.Dataset, look: dict[str, Any]) -> None:
        shear = one["storey_shear_max"].values * 1e-3  # constant over a storey: from one floor to the next
        ax.plot(np.repeat(shear, 2), np.repeat(edges, 2)[1:-1], **look)

    figure = model_grid(here, line, "storey shear (MN)", "floor")
    for ax in figure.axes:
        ax.set_xlim(left=0)
        ax.set_yticks(edges)
    return figure
