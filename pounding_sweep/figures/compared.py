"""Figures of comparisons: they take a cube, or the result that a comparison made of it."""

from __future__ import annotations

from collections.abc import Iterable
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from pounding_sweep.analysis.comparisons import COMPARISONS
from pounding_sweep.analysis.scenarios import COMPARISON, scenario_dims
from pounding_sweep.figures.style import axis_label
from pounding_sweep.spec.axes import DIMENSIONS

if TYPE_CHECKING:
    import xarray as xr

#: Axes against which a comparison is drawn, the first of those that vary.
_AXES = ("gap", "stiffness_factor", "stiffness", *DIMENSIONS["scale"], "restitution")

#: Characters in a line of an axis label.
_LABEL = 36


def result_of(dataset: xr.Dataset, key: str) -> xr.Dataset:
    """Return a comparison's result: the dataset itself where it is one, else what the comparison makes of the cube."""
    return dataset if dataset.attrs.get(COMPARISON) == key else COMPARISONS[key].load()(dataset)


def first_varied(result: xr.Dataset, but: Iterable[str] = ()) -> str | None:
    """Return the axis to draw along: the first that has several values, building properties last; None without one."""
    others = [dim for dim in scenario_dims(result) if dim not in (*_AXES, "law", "record", "case", *but)]
    for axis in (*_AXES, *others):
        if result.sizes.get(axis, 1) > 1 and result[axis].dtype.kind in "iuf" and axis not in but:
            return axis
    return None


def over_storeys(part: xr.DataArray) -> xr.DataArray:
    """Return the largest value over storeys, or the value itself of a single one."""
    return part.max("storey") if "storey" in part.dims else part


def drawn_axis(result: xr.Dataset, axis: str) -> tuple[np.ndarray, str]:
    """Return the values of an axis to draw along, and its label with the unit."""
    if axis == "gap":
        return np.asarray(result[axis].values) * 1e3, "gap (mm)"
    ratios = [str(name) for name in result.coords if "_ratio_" in str(name) and result[name].dims == (axis,)]
    drawn = result[ratios[0] if ratios else axis]
    name = str(drawn.attrs.get("long_name", axis.replace("_", " ")))
    return np.asarray(drawn.values), fill(axis_label(name, drawn.attrs), _LABEL)
