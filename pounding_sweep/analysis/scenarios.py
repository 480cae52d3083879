"""What every comparison asks of a cube: its scenario axes, values to be trusted, its runs without pounding."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.output.audited import AUDIT_DIMS
from pounding_sweep.output.dataset import VERSION_ATTRIBUTE
from pounding_sweep.outputs.variables import INNER_DIMS, VARIABLES, Status
from pounding_sweep.spec.axes import DIMENSIONS

#: Key of the law without contact.
NO_POUNDING = "none"
#: Attribute by which the result of a comparison is known.
COMPARISON = "comparison"
#: Axes that a run without pounding ignores.
IGNORED = tuple(dim for column in ("gap", "stiffness", "restitution") for dim in DIMENSIONS[column])
#: What tells listed cases apart that a run without pounding does not ignore.
_CASE_KEYS = ("record", "scale", "period_factor", "mass_factor", "damping_ratio", "strength_factor", "hardening")
#: What is below this share of the largest of its kind is rounding, and no divisor of a ratio.
ROUND_OFF = 1e-9
#: What tells that floors touched, the surest first; above zero in a scenario that did.
TOUCH_VARIABLES = ("impact_count", "impact_force_max", "penetration_max", "approach_speed_max", "impulse")


def scenario_dims(cube: xr.Dataset | xr.DataArray) -> tuple[str, ...]:
    """Return the dimensions along which scenarios differ, in the cube's order."""
    return tuple(str(dim) for dim in cube.dims if dim not in (*INNER_DIMS, *AUDIT_DIMS))


def scenarios_only(cube: xr.Dataset) -> xr.Dataset:
    """Return the cube without what has dimensions of its own: its audit, and histories on ``time`` of one scenario."""
    return cube.drop_dims([dim for dim in (*AUDIT_DIMS, "time") if dim in cube.dims])


def trusted(cube: xr.Dataset) -> xr.DataArray:
    """Whether each scenario is ok; true where the cube has no ``status``."""
    if "status" not in cube.data_vars:
        return xr.DataArray(True)
    return cube["status"] == int(Status.OK)


def values(cube: xr.Dataset, name: str) -> xr.DataArray:
    """Return a variable as float64 with its attributes, missing where the scenario is not ok or has no value."""
    found = cube[name]
    given = found.astype(np.float64)
    if found.dtype.kind in "iu" and name in VARIABLES and VARIABLES[name].fill is not None:
        given = given.where(found != VARIABLES[name].fill)
    return given.where(trusted(cube)).assign_attrs(found.attrs)


def present(cube: xr.Dataset, names: Iterable[str]) -> list[str]:
    """Return those of `names` that the cube has, in their order."""
    return [name for name in names if name in cube.data_vars]


def need_variables(cube: xr.Dataset, what: str, names: Sequence[str], *, one: bool = False) -> list[str]:
    """Return those of `names` that the cube has; raise `InputError` where one lacks, or all with `one`."""
    found = present(cube, names)
    lacking = [name for name in names if name not in found]
    if found if one else not lacking:
        return found
    quoted = (" or " if one else ", ").join(map(repr, lacking))
    which = "the output" if len(lacking) == 1 else "one of the outputs" if one else "the outputs"
    remedy = "it" if one or len(lacking) == 1 else "them"
    msg = f"{what} needs {which} {quoted}, which this cube lacks; run the sweep with {remedy}"
    raise InputError(msg)


def chosen_variables(
    cube: xr.Dataset, what: str, given: Iterable[str] | None, valid: Sequence[str], kind: str
) -> list[str]:
    """Return what was asked for out of `valid`, or all of it that the cube has where nothing was."""
    if given is None:
        return need_variables(cube, what, valid, one=True)
    names = list(given)
    for name in names:
        if name not in valid:
            raise InputError(unknown(kind, name, valid))
    return need_variables(cube, what, names)


def labelled(dim: str, labels: Iterable[Any], long_name: str, units: str = "") -> xr.DataArray:
    """Return the coordinate of a dimension."""
    attributes = {"long_name": long_name} | ({"units": units} if units else {})
    return xr.DataArray(list(labels), dims=dim, coords={dim: list(labels)}, attrs=attributes)


def need_dims(cube: xr.Dataset, what: str, dims: Iterable[str]) -> None:
    """Raise `InputError` unless the cube has all those dimensions."""
    for dim in dims:
        if dim in cube.dims:
            continue
        if "case" in cube.dims:
            msg = f"{what} needs the axis {dim!r}, and this cube lists its scenarios as cases; run a sweep over axes"
        else:
            has = ", ".join(scenario_dims(cube)) or "none"
            msg = f"{what} needs the axis {dim!r}; this cube's axes: {has}. Run a sweep over several values of it"
        raise InputError(msg)


def need_several(cube: xr.Dataset, what: str, dim: str) -> None:
    """Raise `InputError` unless the cube has that dimension with more than one value."""
    need_dims(cube, what, [dim])
    if cube.sizes[dim] < 2:
        msg = f"{what} needs several values of {dim!r}, and this cube has one; run a sweep over several"
        raise InputError(msg)


def law_keys(cube: xr.Dataset) -> list[str]:
    """Return the keys of the laws of a cube in the order in which they first occur; none where it does not say."""
    return list(dict.fromkeys(map(str, np.atleast_1d(cube["law"].values)))) if "law" in cube.coords else []


def of_law(cube: xr.Dataset, keep: Iterable[str]) -> xr.Dataset:
    """Return the scenarios of the laws `keep`, for ``law`` an axis, a coordinate of listed cases or a single value."""
    if "law" not in cube.coords or not cube["law"].dims:
        return cube
    (dim,) = cube["law"].dims
    return cube.isel({dim: np.flatnonzero(np.isin(cube["law"].values.astype(str), list(keep)))})


def pounding_only(cube: xr.Dataset) -> xr.Dataset:
    """Return the scenarios of all laws with contact."""
    return of_law(cube, [law for law in law_keys(cube) if law != NO_POUNDING])


def without_pounding(cube: xr.Dataset, what: str) -> xr.Dataset:
    """Return the run without pounding that belongs to each scenario."""
    laws = law_keys(cube)
    if NO_POUNDING not in laws:
        msg = (
            f"{what} needs the runs without pounding (law {NO_POUNDING!r}), which this cube lacks: it has "
            f"{', '.join(laws) or 'no law'}. Add {NO_POUNDING!r} to the laws of the sweep and run it again"
        )
        raise InputError(msg)
    law = cube["law"]
    if law.dims == ("law",):
        return _of_any_gap(cube.sel(law=NO_POUNDING, drop=True).reset_coords(drop=True))
    if not law.dims:
        return cube.reset_coords(drop=True)
    twin = np.array(uncoupled_cases(cube))
    found = cube.isel(case=np.maximum(twin, 0)).reset_coords(drop=True).assign_coords(case=cube["case"])
    known = cube["case"].copy(data=twin >= 0)
    status = found["status"] if "status" in found else known.astype("i1") * 0
    return found.assign(status=status.where(known, int(Status.NOT_RUN)).astype("i1"))


def _of_any_gap(uncoupled: xr.Dataset) -> xr.Dataset:
    """Return runs without pounding of a merged cube, of which some gaps may lack those that others have."""
    lacking = uncoupled["status"] == int(Status.NOT_RUN) if "status" in uncoupled else xr.DataArray(False)
    dims = [dim for dim in IGNORED if dim in lacking.dims]
    if not dims or not bool(lacking.any()):
        return uncoupled
    return uncoupled.isel(lacking.argmin(dims)).reset_coords(drop=True)


def uncoupled_cases(cube: xr.Dataset) -> list[int]:
    """Return the position of the case without pounding that belongs to each listed case, -1 where there is none."""

    def keys() -> list[bytes]:
        columns = [cube[name].values for name in _CASE_KEYS if name in cube.coords and "case" in cube[name].dims]
        rows = zip(*columns, strict=True) if columns else [()] * cube.sizes["case"]
        return [repr([np.asarray(cell).tolist() for cell in row]).encode() for row in rows]

    laws, found = cube["law"].values.astype(str), keys()
    first: dict[bytes, int] = {}
    for position, (law, key) in enumerate(zip(laws, found, strict=True)):
        if law == NO_POUNDING:
            first.setdefault(key, position)
    return [first.get(key, -1) for key in found]


def touched(cube: xr.Dataset, what: str) -> xr.DataArray:
    """Return 1 where floors touched, 0 where they did not, missing where the scenario is not ok or no floors meet."""
    for name in present(cube, TOUCH_VARIABLES):
        found = values(cube, name)
        if bool(found.notnull().any()):
            return (found > 0.0).astype(np.float64).where(found.notnull())
    need_variables(cube, what, TOUCH_VARIABLES, one=True)
    return values(cube, present(cube, TOUCH_VARIABLES)[0])  # there, but nothing has a value


def peak_displacement(cube: xr.Dataset) -> xr.DataArray:
    """Return the largest absolute displacement of each floor (m), from its largest and smallest."""
    low, high = values(cube, "displacement_min"), values(cube, "displacement_max")
    low, high = abs(low), abs(high)
    units = str(cube["displacement_max"].attrs.get("units", "m"))
    return described(high.where(~(low > high), low), units, "largest absolute floor displacement")


def described(part: xr.DataArray, units: str, name: str, comment: str = "", *, bare: bool = False) -> xr.DataArray:
    """Return values with these attributes and no others, `bare` of scalar coordinates: what they were made of."""
    found = part.reset_coords(drop=True) if bare else part.copy(deep=False)
    found.attrs = {"units": units, "long_name": name, **({"comment": comment} if comment else {})}
    return found


def over(value: xr.DataArray, base: xr.DataArray, least: xr.DataArray) -> xr.DataArray:
    """Divide by a base; missing where that is no larger than `least`."""
    return value / base.where(abs(base) > least)


def largest_of(part: xr.DataArray, *more: str) -> xr.DataArray:
    """Return the largest size of a variable in the row, and along `more` dimensions."""
    return abs(part).max([dim for dim in (*INNER_DIMS, *more) if dim in part.dims])


def long_name(cube: xr.Dataset, name: str) -> str:
    """Return what a variable is called in words."""
    return str(cube[name].attrs.get("long_name", name.replace("_", " ")))


def finished(result: xr.Dataset, cube: xr.Dataset, comparison: str, **more: Any) -> xr.Dataset:
    """Return a comparison's result, read into memory, with attributes that say which it is and of which sweep."""
    kept = {key: cube.attrs[key] for key in ("title", "sweep_sha256", "source", VERSION_ATTRIBUTE) if key in cube.attrs}
    found = result.load()
    found.attrs = {COMPARISON: comparison, **kept, **more}
    return found
