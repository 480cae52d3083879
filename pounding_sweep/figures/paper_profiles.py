"""Figures 5 to 10 of the paper: signed peak displacement and peak shear over the height of one building."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pounding_sweep.figures.paper_grid import label_grid, model_label, model_look, record_grid
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
    figure, panels = record_grid(here)
    storeys = np.concatenate([[0], here["storey"].values])
    for ax, place in panels:
        for law in here["law"].values.tolist():
            one = here.sel({**place, "law": law})
            for name, label in (("displacement_max", model_label(law)), ("displacement_min", None)):
                values = np.concatenate([[0.0], one[name].values]) * 1e3
                ax.plot(values, storeys, label=label, **model_look(law))
        ax.axvline(0.0, color="0.4", linewidth=0.8)
        ax.set_yticks(storeys)
    label_grid(figure, here["reading"].values.tolist(), "displacement (mm)", "floor")
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
    figure, panels = record_grid(here)
    edges = np.concatenate([[0], here["storey"].values])
    for ax, place in panels:
        for law in here["law"].values.tolist():
            shear = here["storey_shear_max"].sel({**place, "law": law}).values * 1e-3
            # constant over a storey: from one floor to the next
            ax.plot(np.repeat(shear, 2), np.repeat(edges, 2)[1:-1], label=model_label(law), **model_look(law))
        ax.set_yticks(edges)
    for ax in figure.axes:
        ax.set_xlim(left=0)
    label_grid(figure, here["reading"].values.tolist(), "storey shear (MN)", "floor")
    return figure
