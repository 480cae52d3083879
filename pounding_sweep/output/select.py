"""Parts of a cube by the values of its axes."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
import xarray as xr

from pounding_sweep.base.errors import InputError, check_choice, repr_short
from pounding_sweep.output.audited import AUDIT_DIMS, has_audit

#: Relative difference from a value of an axis at which a number still means it.
NEAR = 1e-6
#: Dimension of listed scenarios, of which parts are taken by what they list too.
_CASE = "case"
#: Axes with at most so many values are shown in full.
_FEW = 8


def select(
    cube: xr.Dataset, values: Mapping[str, str | float | Sequence[str | float]], keep: Collection[str] = ()
) -> xr.Dataset:
    """Take one value or several of some axes.

    A number that is not on an axis means the value of the axis within a millionth of it, if there is
    only one; numbers of cases and other whole numbers must be exact.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube.
    values : mapping of str to str, float or sequence of them
        Axis -> value or values, numbers also as text. Along listed cases also what they list, such as ``law``:
        all cases with that value are taken.
    keep : collection of str
        Axes that stay dimensions where one value is taken too.

    Returns
    -------
    xarray.Dataset
        The cube at these values. An axis of which one is taken stays as a scalar coordinate; several
        stay a dimension, in the order of the cube.

    Raises
    ------
    InputError
        The cube has no such axis, or the axis no such value, or two that are meant alike; or it is a
        dimension of the cube's audit.

    Examples
    --------
    >>> import xarray as xr
    >>> cube = xr.Dataset({"x": ("gap", [3.0, 4.0, 5.0])}, {"gap": [0.01, 0.02, 0.03]})
    >>> float(select(cube, {"gap": "0.02"}).x)
    4.0
    >>> select(cube, {"gap": [0.03, 0.01]}).x.values.tolist()
    [3.0, 5.0]
    """
    audit = AUDIT_DIMS if has_audit(cube) else ()
    for axis, raw in values.items():
        of_cases = [str(name) for name, label in cube.coords.items() if label.dims == (_CASE,) and name != _CASE]
        valid = [*(str(dim) for dim in cube.sizes if dim not in audit), *of_cases]
        check_choice("axis", axis, valid)
        wanted = [raw] if isinstance(raw, str) or not isinstance(raw, Sequence | np.ndarray) else raw
        if not len(wanted):
            raise InputError(f"no value of {axis} is given; give one or several")
        labels = cube[axis].values
        if axis in of_cases:
            unique, inverse = np.unique(labels, return_inverse=True)
            cube = cube.isel({_CASE: np.isin(inverse, [_place(axis, unique, value) for value in wanted])})
            continue
        places = sorted({_place(axis, labels, value) for value in wanted})
        cube = cube.isel({axis: places if len(places) > 1 or axis in keep else places[0]})
    return cube


def _place(axis: str, labels: np.ndarray, value: str | float) -> int:
    """Index of a value on an axis."""
    if labels.dtype.kind not in "iuf":
        check_choice(axis, value, labels.tolist())
        return labels.tolist().index(value)
    rising = np.sort(labels).tolist()
    try:
        number = float(value)
        fault = "is not on the axis"
    except (ValueError, TypeError, OverflowError):
        number, fault = np.nan, "is no number"
    places = np.flatnonzero(labels == number)
    if not places.size and labels.dtype.kind == "f":
        places = np.flatnonzero(np.isclose(labels, number, rtol=NEAR, atol=0.0))
    if places.size > 1:
        near = ", ".join(map(repr, labels[places[:_FEW]].tolist()))
        fault = f"is within {NEAR:g} of {places.size} values ({near}); give all figures of one"
    elif not places.size and labels.size <= _FEW:
        fault += f"; it has {', '.join(map(repr, labels.tolist()))}"
    elif not places.size:
        at = int(np.searchsorted(rising, number))
        near = " and ".join(map(repr, rising[max(0, at - 1) : at + 1]))
        fault += f"; it has {len(rising)} values from {rising[0]!r} to {rising[-1]!r}; next to that: {near}"
    if places.size != 1:
        raise InputError(f"{axis} {repr_short(value)} {fault}")
    return int(places[0])
