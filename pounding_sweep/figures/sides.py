"""Axes that figures draw along: which there are, their labels, and whether they are logarithmic."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.scenarios import scenario_dims
from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.figures.shown import drawn_unit, first_varied
from pounding_sweep.figures.style import axis_label
from pounding_sweep.spec.axes import DIMENSIONS

#: Characters in a line of an axis label.
_LABEL = 36
#: Values of an axis up to which each has a tick of its own.
_TICKS = 8
#: Largest over smallest value from which an axis may be logarithmic.
_WIDE = 3.999


@dataclass(frozen=True)
class Side:
    """An axis to draw along."""

    dim: str  # dimension of the cube
    name: str  # the dimension, or a coordinate along it by which it is drawn, such as the ratio of two periods
    label: str  # name with its unit
    factor: float  # from the unit of the cube to the one drawn

    def values(self, result: xr.Dataset) -> np.ndarray:
        """Return the values that are drawn."""
        return np.asarray(result[self.name].values, dtype=float) * self.factor

    def draw(self, axis: Any, values: np.ndarray, *, marked: bool = False) -> None:
        """Give an axis of a panel the scale that these values have; `marked`: a tick at each, if they are few."""
        log = logarithmic(values)
        if log:
            _logarithms(axis)
        if len(values) <= _TICKS and (log or marked):
            axis.set_ticks(values, [f"{value:g}" for value in values])


def _logarithms(axis: Any) -> None:
    """Make an axis of a panel logarithmic."""
    from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

    axis.axes.set(**{f"{axis.axis_name}scale": "log"})
    axis.set_minor_locator(NullLocator())
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(FormatStrFormatter("%g"))


def intensity_label(result: xr.Dataset) -> str:
    """Return the label of an axis of intensities."""
    return fill(axis_label(result["intensity"].attrs["long_name"], result["intensity"].attrs), _LABEL)


def draw_intensities(ax: Any, result: xr.Dataset) -> None:
    """Make the x of a panel, of intensities, logarithmic where the scales are; else it begins at zero."""
    scales = next((result[dim].values for dim in DIMENSIONS["scale"] if dim in result.dims), np.ones(1))
    if logarithmic(np.sort(scales)):
        _logarithms(ax.xaxis)
    else:
        ax.set_xlim(left=0.0)


def logarithmic(values: np.ndarray) -> bool:
    """Whether values are spaced in even ratios rather than evenly, over a wide range."""
    if len(values) < 3 or values.min() <= 0.0 or values.max() < _WIDE * values.min():
        return False
    steps, ratios = np.diff(values), np.diff(np.log(values))
    return bool(np.ptp(ratios) / ratios.mean() < np.ptp(steps) / steps.mean())


def sides_of(result: xr.Dataset) -> dict[str, Side]:
    """Return what can be drawn along, by name: axes of several numbers, and coordinates that follow one of them."""
    dims = [dim for dim in scenario_dims(result) if result.sizes[dim] > 1 and dim in result.coords]
    dims = [dim for dim in dims if dim != "case" and result[dim].dtype.kind in "iuf"]
    more = [str(name) for name in result.coords if len(result[name].dims) == 1 and result[name].dims[0] in dims]
    more = [name for name in more if name not in dims and result[name].dtype.kind in "iuf"]
    return {name: side_of(result, name) for name in (*dims, *more)}


def side_of(result: xr.Dataset, name: str) -> Side:
    """Return an axis, or a coordinate along one, to draw along."""
    about = result[name].attrs
    unit, factor = drawn_unit(about)
    words = "gap" if name == "gap" else str(about.get("long_name", name.replace("_", " ")))
    label = fill(f"{words}\xa0({unit or '-'})", _LABEL).replace("\xa0", " ")  # a unit stays beside the last word
    return Side(str(result[name].dims[0]), name, label, factor)


def drawn_side(result: xr.Dataset, asked: str | None, but: Collection[str] = ()) -> Side | None:
    """Return the axis that was asked for, else the first that has several numbers; None where none has."""
    # along a building property without a name of its own, the ratio to the neighbour's is drawn. `period_ratio` alone
    # means the first of such names.
    found = sides_of(result)
    if asked is None:
        dim = first_varied(result, but)
        ratios = [side for side in found.values() if side.dim == dim and "_ratio_" in side.name]
        return ratios[0] if ratios else found.get(str(dim))
    name = next((name for name in found if name.startswith(f"{asked}_")), asked)
    name = asked if asked in found else name
    if name in result.coords and len(dims := result[name].dims) > 1:
        varied = " and ".join(str(dim) for dim in dims)
        msg = f"{name} varies with {varied}; choose one value of all but one of them with --at, such as {dims[0]}=..."
        raise InputError(msg)
    if name not in found:
        raise InputError(unknown("axis to draw along", asked, found))
    if found[name].dim in but:
        msg = f"{name} and the other axis are the same, {found[name].dim}; valid: {', '.join(found)}"
        raise InputError(msg)
    return found[name]
