"""Spectra of floors, from the histories of one scenario."""

from __future__ import annotations

import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.analysis.spectra import floor_spectra
from pounding_sweep.figures import figure_of
from pounding_sweep.figures.gallery.response_spectra import response_spectra
from pounding_sweep.figures.shown import heading
from pounding_sweep.figures.style import put_title


@figure_of(
    "histories",
    "5 % response spectra of the floors' total accelerations, from 'simulate'",
    needs=("time", "acceleration"),
)
def floor_response(histories: xr.Dataset) -> Figure:
    """Draw the 5 % spectra of the total acceleration of every floor."""
    figure = response_spectra(floor_spectra(histories))
    put_title(figure, heading(histories), "floor spectra, damping ratio 0.05")
    return figure
