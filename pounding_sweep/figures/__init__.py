"""Figures: each takes a dataset and returns a matplotlib figure; `force_gap` draws ``force-gap``, and so do all others.

Each is defined and registered in a module of `pounding_sweep.figures.gallery` that is named after it. matplotlib is
imported in this package, by the paper's figures, and nowhere else.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial, wraps
from inspect import signature
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from pounding_sweep.base.deferred import Registry, attribute, key_of
from pounding_sweep.base.errors import InputError, OutputError, unknown
from pounding_sweep.base.paths import expanded
from pounding_sweep.figures.style import in_style

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

#: What figures are drawn from: name -> where such a file comes from.
SOURCES: dict[str, str] = {
    "cube": "a cube of 'pounding-sweep run'",
    "design": "a cube of 'pounding-sweep run' over a [design]",
    "histories": "histories of 'pounding-sweep simulate'",
    "trade": "the file of 'pounding-sweep tradeoff'",
    "map": "the file of 'pounding-sweep extremes --map MAP.nc'",
    "spectra": "the file of 'pounding-sweep records plot --data MOTIONS.nc'",
}


@dataclass(frozen=True)
class Kind:
    """A figure by name, what draws it, and what a dataset must have for that."""

    key: str
    draw: Callable[..., Figure]
    source: str  # what it is drawn from, a key of `SOURCES`
    title: str  # what it shows
    #: variables, coordinates, dimensions, `CONTACT` or `NO_CONTACT` that the dataset must have; of alternatives,
    #: separated by ``|``, any one
    needs: tuple[str, ...] = ()
    #: axes of which it must have more than one value, again with alternatives; of the laws those with contact count
    several: tuple[str, ...] = ()
    #: says in words what else a dataset lacks; "" where that is nothing
    also: Callable[[xr.Dataset], str] = lambda dataset: ""

    @property
    def options(self) -> tuple[str, ...]:
        """What of the figure may be chosen: the arguments of its function that are given by name."""
        parameters = signature(self.draw).parameters.values()
        return tuple(each.name for each in parameters if each.kind is each.KEYWORD_ONLY)

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
_PLURAL = {
    "law": "laws with contact",
    "record": "records",
    "scale": "scales",
    "pga": "PGAs",
    "sa": "spectral accelerations",
}


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


def figure_of(source: str, title: str, **about: Any) -> Callable[[Callable[..., Any]], Callable[..., Figure]]:
    """Register a function of a dataset as the figure of its module, `about` being fields of `Kind`; in our style."""
    # its arguments after the dataset, by name only, are options of the figure. With `ax` among them, it may return the
    # axes it was given

    def register(draw: Callable[..., Any]) -> Callable[..., Figure]:
        key = key_of(draw.__module__)

        @wraps(draw)
        def drawn(dataset: xr.Dataset, **options: Any) -> Figure:
            from matplotlib.axes import Axes

            from pounding_sweep.output.netcdf import with_texts

            whole = with_inner_dims(with_texts(dataset))
            require(whole, key)
            with in_style():
                found = draw(whole, **options)
            if isinstance(found, Axes):
                return cast("Figure", found.get_figure())
            found._repr_png_ = partial(_png, found)  # notebooks show it, though pyplot knows nothing of it
            return cast("Figure", found)

        FIGURES.add(key, Kind(key, drawn, source, title, **about))
        return drawn

    return register


def with_inner_dims(dataset: xr.Dataset) -> xr.Dataset:
    """Return a cube whose variables have the dimensions again of a building, pair or storey that was selected."""
    from pounding_sweep.outputs.variables import INNER_DIMS, VARIABLES

    for dim in INNER_DIMS:
        if dim in dataset.coords and not dataset[dim].ndim:
            names = [name for name in map(str, dataset.data_vars) if name in VARIABLES and dim in VARIABLES[name].dims]
            spread = {name: dataset[name].expand_dims(dim, -1) for name in names}
            dataset = dataset.drop_vars([*names, dim]).assign(spread) if names else dataset
    return dataset


def _png(figure: Figure) -> bytes:
    """Return a figure as a PNG."""
    file = BytesIO()
    figure.savefig(file, format="png")
    return file.getvalue()


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


def plot(dataset: xr.Dataset, kind: str, path: str | os.PathLike[str], *, dpi: float = 150.0, **options: Any) -> Path:
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
    **options
        Options of the figure, such as ``x``, ``y`` and ``value``; None leaves one out.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        The figure is unknown or has no such option, the dataset lacks what it needs or has no value
        to be drawn, or `dpi` is out of range.
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
    given = {name: value for name, value in options.items() if value is not None}
    for name in given:
        if name not in FIGURES[kind].options:
            takers = ", ".join(key for key, each in FIGURES.items() if name in each.options)
            msg = f"figure {kind!r} takes no {name}; " + (f"{takers} do" if takers else "nor does any other")
            raise InputError(msg)
    figure = FIGURES[kind].draw(dataset, **given)
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


#: Public names that are loaded where they are first used, beside the figures.
_HOME = {"animate": "pounding_sweep.figures.animation"}


def __getattr__(name: str) -> Any:
    key = name.replace("_", "-")
    return FIGURES[key].draw if key in FIGURES else attribute(__name__, _HOME, name)


def __dir__() -> list[str]:
    return sorted(["FIGURES", "SOURCES", "plot", *_HOME, *(key.replace("-", "_") for key in FIGURES)])
