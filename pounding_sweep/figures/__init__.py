"""Figures of cubes: each takes a dataset and returns a matplotlib figure.

matplotlib is imported here and nowhere else in the package.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pounding_sweep.errors import InputError, OutputError, unknown

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Kind:
    """A figure by name.

    Attributes
    ----------
    key : str
        Name on the command line.
    title : str
        What it shows.
    place : str
        ``module:function`` that draws it.
    """

    key: str
    title: str
    place: str

    def load(self) -> Callable[..., Any]:
        """Return the function that draws it."""
        module, _, name = self.place.partition(":")
        found: Callable[..., Any] = getattr(import_module(module), name)
        return found


#: All figures by name.
FIGURES: dict[str, Kind] = {
    kind.key: kind
    for kind in (
        Kind(
            "force-gap",
            "peak impact force and impacts of each pair against the gap, law by law",
            "pounding_sweep.figures.force_gap:force_gap",
        ),
        Kind(
            "work-precision",
            "worst error of schemes, steps and number formats against their cost, from 'tradeoff'",
            "pounding_sweep.figures.work_precision:work_precision",
        ),
        Kind(
            "stability-map",
            "error and status over contact stiffness and time step, from 'extremes --map'",
            "pounding_sweep.figures.stability_map:stability_map",
        ),
    )
}


def plot(cube: xr.Dataset, kind: str, path: str | os.PathLike[str]) -> Path:
    """Draw a figure of a cube into a file (PNG, SVG, PDF by its suffix).

    Parameters
    ----------
    cube : xarray.Dataset
        A cube.
    kind : str
        A key of `FIGURES`.
    path : path
        File to write.

    Raises
    ------
    InputError
        The figure is unknown, or the cube lacks what it needs.
    OutputError
        The file can't be written.
    """
    if kind not in FIGURES:
        raise InputError(unknown("figure", kind, FIGURES))
    figure = FIGURES[kind].load()(cube)
    target = Path(path)
    try:
        figure.savefig(target)
    except (OSError, ValueError) as error:
        msg = (
            f"can't write {str(target)!r} ({error}); give a file in a folder that exists, ending in .png, .svg or .pdf"
        )
        raise OutputError(msg) from error
    return target
