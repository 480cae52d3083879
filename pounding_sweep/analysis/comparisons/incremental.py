"""Response against intensity as records are scaled up: a curve per record and direction, and the suite's fractiles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.comparisons import comparison, over_text
from pounding_sweep.analysis.comparisons.fractiles import QUANTILES, responses
from pounding_sweep.analysis.intensity import intensity_of
from pounding_sweep.analysis.scenarios import (
    ROUND_OFF,
    check_levels,
    check_quantiles,
    described,
    fractiles_over,
    interpolate,
    need_variables,
    values,
)
from pounding_sweep.spec.axes import DIMENSIONS

#: Intensities at which the fractiles of a suite are given, where none are.
LEVELS = 25
#: Attribute that says why there are no fractiles of all records.
NO_FRACTILES = "no_fractiles"


@comparison(
    "responses against intensity as records are scaled up, with the fractiles of the suite",
    needs="an axis of several scales or peak ground accelerations",
    requires={"several": DIMENSIONS["scale"]},
    columns=("law", "building", "pair", "quantile", "level"),
    variables=("_fractiles",),
    lead=("drift_max_fractiles", "impact_force_max_fractiles"),
    figure="incremental",
    arguments=("intensity", "quantiles", "levels", "folders"),
)
def incremental_curves(
    cube: xr.Dataset,
    outputs: Iterable[str] | None = None,
    *,
    intensity: str | xr.DataArray | None = None,
    quantiles: Sequence[float] = QUANTILES,
    levels: Sequence[float] | None = None,
    records: Any = None,
    folders: Any = None,
) -> xr.Dataset:
    """Return responses against intensity, record by record and for the suite.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with the axis ``scale`` or ``pga``, and ``record`` where there are several.
    outputs : iterable of str, optional
        Variables of the cube; by default all that are responses.
    intensity, records, folders : optional
        As for `pounding_sweep.analysis.intensity.intensity_of`.
    quantiles : sequence of float
        In [0, 1].
    levels : sequence of float, optional
        Intensities (in its units) at which fractiles are given; by default the cube's own where all curves share them,
        else `LEVELS` of them, evenly spaced over the range that all curves share. Where they share none, over that of
        the cube, and the attribute ``no_fractiles`` says so.

    Returns
    -------
    xarray.Dataset
        Each output on the cube's axes in its own units, beside the coordinate ``intensity`` (record, scale); and
        ``<output>_fractiles`` on ``quantile`` and ``level`` instead of record and scale, with ``<output>_count``, how
        many curves have a value there. A curve's value at a level is linear between its two nearest scales, missing
        outside the range of its scales and next to a scenario that is not ok: nothing is extrapolated, and a count
        below the number of curves (attribute ``curves``) says so.

    Raises
    ------
    InputError
        The cube has fewer than two scales, or not the outputs; a level or quantile is not valid.

    Notes
    -----
    A record at negative scales is that record reversed: another ground motion of the same
    intensities, which a row that is not symmetric answers otherwise. Where the cube has scales of both
    signs, each record is two curves, one per direction (see `directions`), and both count in the fractiles.

    Examples
    --------
    >>> import xarray as xr
    >>> drift = (("record", "scale"), [[0.01, 0.03], [0.02, 0.05]])
    >>> axes = {"record": ["a", "b"], "scale": [1.0, 2.0], "record_pga": ("record", [3.0, 3.0])}
    >>> curves = incremental_curves(xr.Dataset({"drift_max": drift}, axes), quantiles=[0.5], levels=[4.5])
    >>> curves.drift_max_fractiles.round(4).values.tolist()
    [[0.0275]]
    """
    check_quantiles(quantiles)
    scaled = next(dim for dim in DIMENSIONS["scale"] if dim in cube.dims)
    names = responses(cube) if outputs is None else need_variables(cube, "an incremental curve", list(outputs))
    strength = intensity_of(cube, intensity, records=records, folders=folders)
    if "record" not in cube.dims:
        cube, strength = cube.expand_dims("record"), strength.expand_dims("record")
    strength = strength.transpose("record", scaled)
    x = np.asarray(strength.values, dtype=float)
    ways = directions(cube[scaled].values)
    at, why = _levels(x, ways, levels, str(strength.attrs["units"]))
    level = xr.DataArray(at, dims="level", coords={"level": at}, attrs=strength.attrs)
    result: dict[str, xr.DataArray] = {}
    for name in names:
        whole = result[name] = values(cube, name).transpose("record", ..., scaled)
        curves = zip(whole.values, x, strict=True)
        rows = np.stack([interpolate(row[..., way], motion[way], at) for row, motion in curves for way in ways])
        inner = whole.isel({"record": 0, scaled: 0}, drop=True)
        coords = {dim: inner[dim] for dim in inner.dims if dim in inner.coords}
        on_levels = xr.DataArray(rows, {**coords, "level": level}, ("curve", *inner.dims, "level"), attrs=whole.attrs)
        result[f"{name}_fractiles"], count = fractiles_over(on_levels, ["curve"], quantiles)
        result[f"{name}_count"] = described(count, "1", f"curves that the fractiles of {name} are of")
    about = {
        "curves": len(x) * len(ways),
        "intensity": f"{strength.attrs['long_name']} ({strength.attrs['units']})",
        "over": over_text({"record": len(x), "direction": len(ways)}),
    }
    return xr.Dataset(result, attrs={**about, **why}).assign_coords(intensity=strength)


def _levels(
    x: np.ndarray, ways: list[np.ndarray], levels: Sequence[float] | None, units: str
) -> tuple[np.ndarray, dict[str, str]]:
    """Return the intensities of fractiles, and why there are none of all curves."""
    ends = np.array([[motion[way].min(), motion[way].max()] for motion in x for way in ways])
    low, high = float(ends[:, 0].max()), float(ends[:, 1].min())
    if levels is not None:
        at = check_levels(levels, units)
    elif low > high * (1.0 + ROUND_OFF):
        at = np.linspace(float(x.min()), float(x.max()), LEVELS)
    elif len(ways) == 1 and np.allclose(x, x[0], rtol=ROUND_OFF, atol=0.0):
        at = np.sort(x[0])
    else:
        at = np.linspace(low, high, LEVELS)
    if ((at >= low * (1.0 - ROUND_OFF)) & (at <= high * (1.0 + ROUND_OFF))).any():
        return at, {}
    why = (
        f"none of these intensities is within the scales of all {len(ends)} curves (one begins at {low:.3g} {units}, "
        f"one ends at {high:.3g}); scale the records to equal peaks (pgas), or over a wider range"
    )
    return at, {NO_FRACTILES: why}


def directions(scales: np.ndarray) -> list[np.ndarray]:
    """Return the positions of the scales of each direction of the ground motion, as recorded and reversed."""
    return [np.flatnonzero(sign * scales >= 0.0) for sign in (1.0, -1.0) if (sign * scales > 0.0).any()]
