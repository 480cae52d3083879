"""Responses under a suite of records: fractiles with counts of what they are of, and curves against intensity."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.comparisons import check_needs, comparison, over_text
from pounding_sweep.analysis.rebuild import intensity_of
from pounding_sweep.analysis.scenarios import (
    ROUND_OFF,
    check_levels,
    check_quantiles,
    described,
    fractiles_over,
    interpolate,
    labelled,
    need_variables,
    present,
    trusted,
    values,
)
from pounding_sweep.outputs.variables import STATUS, VARIABLES
from pounding_sweep.spec.axes import DIMENSIONS

#: Lower, median and upper fractile of a suite: a normal variable's mean and one standard deviation to each side.
QUANTILES = (0.16, 0.5, 0.84)
#: Results that are no response.
_NO_RESPONSES = ("status", "energy_residual", "steps_per_contact", "time_step")


@comparison("fractiles")
def fractiles(
    cube: xr.Dataset, quantiles: Sequence[float] = QUANTILES, dim: str = "record", outputs: Iterable[str] | None = None
) -> xr.Dataset:
    """Return fractiles of every response over the records of a suite.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with the axis `dim`.
    quantiles : sequence of float
        In [0, 1].
    dim : str
        The axis to take together.
    outputs : iterable of str, optional
        Variables of the cube; by default all that are responses.

    Returns
    -------
    xarray.Dataset
        On ``quantile`` and the cube's other axes, ``<output>_fractiles`` in the output's own units, and
        ``<output>_count``, how many values its fractiles are of: values are missing where a scenario is not ok, and
        some where it is (no time of a first impact without one, no such storey). ``scenarios`` is the number along
        `dim` that is ok, and ``left_out_<status>`` how many are not, for each status that occurs. Fractiles are of what
        is left: where scenarios were left out because they are extreme, they are too low, which the counts tell.

    Raises
    ------
    InputError
        The cube has no such axis, one value of it, or no such output; a quantile is outside [0, 1].

    Examples
    --------
    >>> import xarray as xr
    >>> cube = xr.Dataset({"drift_max": ("record", [0.01, 0.02, 0.04])})
    >>> fractiles(cube, [0.5]).drift_max_fractiles.values.tolist()
    [0.02]
    """
    what = "taking fractiles"
    check_quantiles(quantiles)
    check_needs(cube, what, several=[dim])
    names = responses(cube) if outputs is None else need_variables(cube, what, list(outputs))
    result: dict[str, xr.DataArray] = {}
    for name in names:
        part = values(cube, name)
        if dim in part.dims:  # a selection may not vary along it
            result[f"{name}_fractiles"], count = fractiles_over(part, [dim], quantiles)
            result[f"{name}_count"] = described(count, "1", f"values that the fractiles of {name} are of")
    ok = trusted(cube)
    if dim in ok.dims:
        result["scenarios"] = described(ok.sum(dim), "1", f"scenarios along {dim} that are ok", bare=True)
        for status in STATUS[1:]:
            count = (cube["status"] == int(status)).sum(dim)
            text = f"scenarios along {dim} that are left out: {status.label}"
            if count.any():
                result[f"left_out_{status.label}"] = described(count, "1", text, bare=True)
    return xr.Dataset(result, attrs={"over": over_text({dim: cube.sizes[dim]})})


def responses(cube: xr.Dataset) -> list[str]:
    """Return the variables of a cube that are responses of its scenarios."""
    return [name for name in present(cube, VARIABLES) if name not in _NO_RESPONSES]


#: Intensities at which the fractiles of a suite are given, where none are.
LEVELS = 25
#: Attribute that says why there are no fractiles of all records.
NO_FRACTILES = "no_fractiles"


@comparison("incremental")
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
        As for `pounding_sweep.analysis.rebuild.intensity_of`.
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
    units, long_name = strength.attrs["units"], strength.attrs["long_name"]
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
    level = labelled("level", at, long_name, units)
    result: dict[str, xr.DataArray] = {}
    for name in names:
        whole = result[name] = values(cube, name).transpose("record", ..., scaled)
        curves = zip(whole.values, x, strict=True)
        rows = np.stack([interpolate(row[..., way], motion[way], at) for row, motion in curves for way in ways])
        coords = {dim: whole[dim] for dim in whole.dims[1:-1] if dim in whole.coords} | {"level": level}
        on_levels = xr.DataArray(rows, coords, ("curve", *whole.dims[1:-1], "level"), attrs=whole.attrs)
        result[f"{name}_fractiles"], count = fractiles_over(on_levels, ["curve"], quantiles)
        result[f"{name}_count"] = described(count, "1", f"curves that the fractiles of {name} are of")
    about = {
        "curves": len(x) * len(ways),
        "intensity": f"{long_name} ({units})",
        "over": over_text({"record": len(x), "direction": len(ways)}),
    }
    if not ((at >= low * (1.0 - ROUND_OFF)) & (at <= high * (1.0 + ROUND_OFF))).any():
        about[NO_FRACTILES] = (
            f"none of these intensities is within the scales of all {len(ends)} curves (one begins at {low:.3g} "
            f"{units}, one ends at {high:.3g}); scale the records to equal peaks (pgas), or over a wider range"
        )
    return xr.Dataset(result, attrs=about).assign_coords(intensity=strength)


def directions(scales: np.ndarray) -> list[np.ndarray]:
    """Return the positions of the scales of each direction of the ground motion, as recorded and reversed."""
    return [np.flatnonzero(sign * scales >= 0.0) for sign in (1.0, -1.0) if (sign * scales > 0.0).any()]
