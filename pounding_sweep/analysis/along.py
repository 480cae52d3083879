"""Interpolation and fractiles along an axis in which values may be missing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from pounding_sweep.analysis.scenarios import labelled
from pounding_sweep.base.errors import InputError

#: A target so far outside, as a share of the largest place, stands at the end of the range.
ROUNDING = 1e-9


def interpolate(values: np.ndarray, at: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Interpolate linearly along the last axis; nothing is extrapolated."""
    places, first = np.unique(at, return_index=True)
    known = np.isfinite(places)
    places, table = places[known], values[..., first[known]]
    result = np.full((*values.shape[:-1], len(targets)), np.nan)
    if not len(places):
        return result
    slack = ROUNDING * np.abs(places).max()
    inside = np.flatnonzero((targets >= places[0] - slack) & (targets <= places[-1] + slack))
    wanted = np.clip(targets[inside], places[0], places[-1])
    low = np.clip(np.searchsorted(places, wanted, side="right") - 1, 0, len(places) - 1)
    high = np.minimum(low + 1, len(places) - 1)
    share = (wanted - places[low]) / np.where(high > low, places[high] - places[low], 1.0)
    between = (1.0 - share) * table[..., low] + share * table[..., high]
    result[..., inside] = np.where(share == 0.0, table[..., low], between)  # a place itself needs no neighbour
    return result


def fractiles_along(values: np.ndarray, quantiles: Sequence[float], axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Return fractiles of the values that are there, and how many there are."""
    ordered = np.sort(np.moveaxis(values, axis, 0), axis=0)  # NaN sorts last
    count = np.sum(~np.isnan(ordered), axis=0)
    found = np.full((len(quantiles), *count.shape), np.nan)
    if ordered.shape[0]:
        for i, q in enumerate(quantiles):
            place = q * np.maximum(count - 1, 0)
            low = np.floor(place).astype(np.intp)
            high = np.minimum(low + 1, np.maximum(count - 1, 0))
            bottom = np.take_along_axis(ordered, low[None], axis=0)[0]
            top = np.take_along_axis(ordered, high[None], axis=0)[0]
            found[i] = bottom + (place - low) * (top - bottom)
    return found, count


def check_quantiles(quantiles: Sequence[float]) -> None:
    """Raise `InputError` unless there are quantiles, each in [0, 1]."""
    if not len(quantiles) or not all(0.0 <= q <= 1.0 for q in quantiles):
        msg = f"quantiles are {list(quantiles)}; give one or more numbers in [0, 1]"
        raise InputError(msg)


def fractiles_over(
    given: xr.DataArray, over: Sequence[str], quantiles: Sequence[float]
) -> tuple[xr.DataArray, xr.DataArray]:
    """Return fractiles over dimensions taken together, along a first ``quantile``, and counts of their values."""
    rows = given.stack(_together=list(over), create_index=False) if over else given.expand_dims("_together")
    found, count = fractiles_along(rows.values, quantiles, int(rows.get_axis_num("_together")))
    kept = rows.isel(_together=0, drop=True).reset_coords(drop=True)
    index = labelled("quantile", quantiles, "share of the values below", "1")
    fractiles = xr.DataArray(found, dims=("quantile", *kept.dims), coords={**kept.coords, "quantile": index})
    return fractiles.assign_attrs(given.attrs), xr.DataArray(count, dims=kept.dims, coords=kept.coords)
