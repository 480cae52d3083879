"""Parts of a cube by the values of its axes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from pounding_sweep.errors import InputError, unknown

if TYPE_CHECKING:
    import xarray as xr


def select(cube: xr.Dataset, values: Mapping[str, str | float]) -> xr.Dataset:
    """Take one value of some axes; numbers need be right to six figures only.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube.
    values : mapping of str to str or float
        Axis -> value, a number also as text.

    Returns
    -------
    xarray.Dataset
        The cube at these values, which stay in it as scalar coordinates.

    Raises
    ------
    InputError
        The cube has no such axis, or the axis no such value.

    Examples
    --------
    >>> import xarray as xr
    >>> cube = xr.Dataset({"x": ("gap", [3.0, 4.0])}, {"gap": [0.01, 0.02]})
    >>> float(select(cube, {"gap": "0.02"}).x)
    4.0
    """
    for axis, value in values.items():
        if axis not in cube.dims:
            raise InputError(unknown("axis", axis, map(str, cube.sizes)))
        there = cube[axis].values
        if there.dtype.kind in "iuf":
            try:
                found = np.flatnonzero(np.isclose(there, float(value), rtol=1e-6, atol=0.0))
            except ValueError:
                msg = f"{axis} {value!r} is no number; the axis has {', '.join(f'{v:g}' for v in there)}"
                raise InputError(msg) from None
            if not found.size:
                msg = f"{axis} {float(value):g} is not on the axis; it has {', '.join(f'{v:g}' for v in there)}"
                raise InputError(msg)
        else:
            found = np.flatnonzero(there == value)
            if not found.size:
                raise InputError(unknown(axis, value, there.tolist()))
        cube = cube.isel({axis: int(found[0])})
    return cube
