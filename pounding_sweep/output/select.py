"""Parts of a cube by the values of its axes."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress

import numpy as np
import xarray as xr

from pounding_sweep.base.errors import InputError, shown, unknown
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
    for axis, given in values.items():
        if axis in audit:
            more = "; variables are chosen by their names (--var of export)" if axis == "output" else ""
            raise InputError(f"{axis!r} is a dimension of the cube's audit, no axis of its scenarios{more}")
        of_cases = [str(name) for name, label in cube.coords.items() if label.dims == (_CASE,) and name != _CASE]
        if axis not in (*cube.dims, *of_cases):
            raise InputError(unknown("axis", axis, (*(str(d) for d in cube.sizes if d not in audit), *of_cases)))
        there = cube[axis].values
        wanted = [given] if isinstance(given, str) or not isinstance(given, Sequence | np.ndarray) else given
        if not len(wanted):
            raise InputError(f"no value of {axis} is given; give one or several")
        if axis in of_cases:
            each, inverse = np.unique(there, return_inverse=True)
            found = [_place(axis, each, value) for value in wanted]
            cube = cube.isel({_CASE: np.flatnonzero(np.isin(inverse, found))})
            continue
        places = sorted({_place(axis, there, value) for value in wanted})
        cube = cube.isel({axis: places if len(places) > 1 or axis in keep else places[0]})
    return cube


def _place(axis: str, there: np.ndarray, value: str | float) -> int:
    """Index of a value on an axis."""
    if there.dtype.kind not in "iuf":
        found = np.flatnonzero(there == value)
        if not found.size:
            raise InputError(unknown(axis, value, map(str, there.tolist())))
        return int(found[0])
    number = _number(axis, there, value)
    found = np.flatnonzero(there == number)
    if not found.size and there.dtype.kind == "f":
        found = np.flatnonzero(np.isclose(there, number, rtol=NEAR, atol=0.0))
    if found.size > 1:
        near = ", ".join(map(repr, there[found[:_FEW]].tolist()))
        raise InputError(
            f"{axis} {shown(value)} is within {NEAR:g} of {found.size} values ({near}); give all figures of one"
        )
    if not found.size:
        raise InputError(f"{axis} {shown(value)} is not on the axis; {_has(there, number)}")
    return int(found[0])


def _number(axis: str, there: np.ndarray, value: str | float) -> float:
    """Return a value as a number; on axes of whole numbers those stay whole, as not all are floats."""
    try:
        if there.dtype.kind in "iu" and isinstance(value, str):
            with suppress(ValueError):
                return int(value)
        return float(value) if there.dtype.kind == "f" or isinstance(value, str) else value + 0
    except (ValueError, TypeError, OverflowError):
        raise InputError(f"{axis} {shown(value)} is no number; {_has(there, np.nan)}") from None


def _has(there: np.ndarray, number: float) -> str:
    """Say what an axis has: all values if they are few, else its range and what is next to a number."""
    if there.size <= _FEW:
        return f"it has {', '.join(f'{v!r}' for v in there.tolist())}"
    low, high = there.min().item(), there.max().item()
    below, above = there[there < number], there[there > number]
    beside = [
        repr(part.item()) for part in (*([below.max()] if below.size else []), *([above.min()] if above.size else []))
    ]
    near = f"; next to that: {' and '.join(beside)}" if beside else ""
    return f"it has {there.size} values from {low!r} to {high!r}{near}"
