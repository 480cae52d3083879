"""Figures: each takes a dataset and returns a matplotlib figure.

Each is defined and registered in a module of `pounding_sweep.figures.gallery` that is named after it. matplotlib is
imported in this package, by the paper's figures, and nowhere else.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pounding_sweep.base.deferred import Registry, key_of
from pounding_sweep.base.errors import InputError, OutputError, unknown
from pounding_sweep.base.paths import expanded
from pounding_sweep.figures.style import in_style

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

#: What figures are drawn from: name -> where such a file comes from.
SOURCES: dict[str, str] = {
    "cube": "a cube of 'pounding-sweep run'",
    "histories": "histories of 'pounding-sweep simulate'",
    "trade": "the file of 'pounding-sweep tradeoff'",
    "map": "the file of 'pounding-sweep extremes --map MAP.nc'",
    "spectra": "the file of 'pounding-sweep records plot --data MOTIONS.nc'",
}


@dataclass(frozen=True)
class Kind:
    """A figure by name, what draws it, and what a dataset must have for that; see `figure_of`."""

    key: str
    title: str
    source: str
    draw: Callable[[xr.Dataset], Figure]
    needs: tuple[str, ...]
    several: tuple[str, ...]
    also: Callable[[xr.Dataset], str]

    def lacks(self, dataset: xr.Dataset) -> tuple[str, ...]:
        """Return in words what a dataset has not of what it needs."""
        there = {*map(str, dataset.variables), *map(str, dataset.sizes), *_kinds_of_laws(dataset)}
        needs = [need.split("|") for need in self.needs]
        several = [axes.split("|") for axes in self.several]
        absent = [" or ".join(names) for names in needs if there.isdisjoint(names)]
        single = [axes for axes in several if all(_size(dataset, axis) < 2 for axis in axes)]
        several_of = [f"several {' or '.join(_PLURAL[axis] for axis in axes)}" for axes in single]
        return tuple(filter(None, (*absent, *several_of, self.also(dataset))))


#: A law with contact, and the one without, as needs.
CONTACT, NO_CONTACT = "a law with contact", "the law 'none'"


def _kinds_of_laws(dataset: xr.Dataset) -> set[str]:
    """Return which of `CONTACT` and `NO_CONTACT` a dataset has; both where it does not say."""
    from pounding_sweep.analysis.scenarios import law_keys

    return {NO_CONTACT if law == "none" else CONTACT for law in law_keys(dataset) or ("", "none")}


#: What several values of an axis are called.
_PLURAL = {"law": "laws with contact", "record": "records", "scale": "scales", "pga": "PGAs"}


def _size(dataset: xr.Dataset, axis: str) -> int:
    """Return the number of values along an axis, of laws with contact where it is theirs; 1 where it is none."""
    if axis == "law" and axis in dataset.dims:
        return int((dataset[axis] != "none").sum())
    return int(dataset.sizes.get(axis, 1))


def one_instant(dataset: xr.Dataset) -> str:
    """Say that a figure of histories lacks times where one was chosen."""
    return "several times" if "time" in dataset.coords and dataset.sizes.get("time", 1) < 2 else ""


#: All figures by name, in alphabetical order.
FIGURES: Registry[Kind] = Registry("pounding_sweep.figures.gallery")


def figure_of(
    source: str,
    title: str,
    *,
    needs: tuple[str, ...] = (),
    several: tuple[str, ...] = (),
    also: Callable[[xr.Dataset], str] = lambda dataset: "",
) -> Callable[[Callable[[Any], Figure]], Callable[[Any], Figure]]:
    """Register a function of a dataset as the figure of its module; it draws in the package's style.

    Parameters
    ----------
    source : str
        What it is drawn from, a key of `SOURCES`.
    title : str
        What it shows.
    needs : tuple of str
        Variables, coordinates, dimensions, `CONTACT` or `NO_CONTACT` that the dataset must have; of
        alternatives, separated by ``|``, any one.
    several : tuple of str
        Axes of which it must have more than one value, again with alternatives; of the
        laws those with contact count.
    also : callable, optional
        Says in words what else a dataset lacks; "" where that is nothing.
    """

    def register(draw: Callable[[Any], Figure]) -> Callable[[Any], Figure]:
        key = key_of(draw.__module__)

        @wraps(draw)
        def drawn(dataset: xr.Dataset) -> Figure:
            require(dataset, key)
            with in_style():
                return draw(dataset)

        FIGURES.add(key, Kind(key, title, source, drawn, needs, several, also))
        return drawn

    return register


#: Dots per inch that a page can be drawn in.
_DPI = (10, 1200)


def require(dataset: xr.Dataset, key: str) -> None:
    """Raise `InputError` where a dataset lacks what a figure needs."""
    kind = FIGURES[key]
    lacking = kind.lacks(dataset)
    if lacking:
        msg = (
            f"figure {key!r} needs {', '.join(lacking)}, which this file has not; it is drawn from "
            f"{SOURCES[kind.source]}"
        )
        if kind.source == "cube" and "status" in dataset.variables:
            msg += ": choose others with --at, or run the sweep again with such a law, axis or output"
        raise InputError(msg)


def plot(dataset: xr.Dataset, kind: str, path: str | os.PathLike[str], *, dpi: float = 150.0) -> Path:
    """Draw a figure of a dataset into a file (PNG, SVG, PDF by its suffix).

    Parameters
    ----------
    dataset : xarray.Dataset
        A cube, or what else the figure is drawn from.
    kind : str
        A key of `FIGURES`.
    path : path
        File to write.
    dpi : float
        Dots per inch of a PNG, 10 to 1200.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        The figure is unknown, the dataset lacks what it needs or has no value to be drawn,
        or `dpi` is out of range.
    OutputError
        The file can't be written.
    """
    from pounding_sweep.figures.shown import nothing_to_draw, shows_values

    if kind not in FIGURES:
        raise InputError(unknown("figure", kind, FIGURES))
    low, high = _DPI
    if not low <= dpi <= high:
        msg = f"dpi is {dpi:g}; it must be from {low} to {high}"
        raise InputError(msg)
    target = expanded(path)
    figure = FIGURES[kind].draw(dataset)
    if not shows_values(figure):
        raise InputError(nothing_to_draw(dataset, kind))
    try:
        figure.savefig(target, dpi=dpi)
    except (OSError, ValueError) as error:
        msg = (
            f"can't write {str(target)!r} ({error}); give a file in a folder that exists, ending in .png, .svg or .pdf"
        )
        raise OutputError(msg) from error
    return target
