"""What every comparison asks of a cube: its scenario axes, values to be trusted, its no-contact runs, fractiles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.base.errors import InputError, check_choice, repr_short
from pounding_sweep.base.text import read_share
from pounding_sweep.output.audited import AUDIT_DIMS
from pounding_sweep.output.scenario_rows import scenario_keys
from pounding_sweep.request.axes import BUILDING_DEFAULTS, DIMENSIONS
from pounding_sweep.variables.registry import INNER_DIMS, VALID, VARIABLES, Status

#: Key of the law without contact.
NO_POUNDING = "none"
#: Attribute by which the result of a comparison is known.
COMPARISON = "comparison"
#: Axes that a run without pounding ignores.
IGNORED = tuple(dim for column in ("gap", "stiffness", "restitution") for dim in DIMENSIONS[column])
#: The same, and those by pair, begin so.
_IGNORED = tuple(f"{dim}_" for dim in IGNORED)
#: What tells listed cases apart that a run without pounding does not ignore.
_CASE_KEYS = ("record", "scale", *BUILDING_DEFAULTS)
#: What is below this share of the largest of its kind is rounding, and no divisor of a ratio.
ROUND_OFF = 1e-9
#: Arguments of comparisons that are numbers, and where they must lie.
INTERVALS = dict.fromkeys(("probabilities", "curve", "confidence"), "(0, 1)")
INTERVALS |= {"quantiles": "[0, 1]"} | dict.fromkeys(("years", "levels"), "(0, inf)")
#: Dimensions of what is of no scenario alone: the audit of a cube, and histories.
OTHER_DIMS = (*AUDIT_DIMS, "time")
#: What tells that floors touched, the surest first; above zero in a scenario that did.
TOUCH_VARIABLES = ("impact_count", "impact_force_max", "penetration_max", "approach_speed_max", "impulse")


def scenario_dims(cube: xr.Dataset | xr.DataArray) -> tuple[str, ...]:
    """Return the dimensions along which scenarios differ, in the cube's order."""
    return tuple(str(dim) for dim in cube.dims if dim not in (*INNER_DIMS, *AUDIT_DIMS))


def ignored_dims(part: xr.Dataset | xr.DataArray) -> list[str]:
    """Return the dimensions that a run without pounding ignores."""
    return [str(dim) for dim in part.dims if f"{dim}_".startswith(_IGNORED)]


def trusted(cube: xr.Dataset) -> xr.DataArray:
    """Whether each scenario is ok, or so up to a fall; true where the cube has no ``status``."""
    return cube["status"].isin(VALID) if "status" in cube.data_vars else xr.DataArray(True)


def fell(cube: xr.Dataset) -> xr.DataArray:
    """Whether each scenario ends where a storey falls."""
    return cube["status"] == int(Status.COLLAPSED) if "status" in cube.data_vars else xr.DataArray(False)


def values(cube: xr.Dataset, name: str, fallen: float = np.inf) -> xr.DataArray:
    """Return a variable as float64, missing where not ok; drift and ductility of a building that fell are `fallen`."""
    part = cube[name].astype(np.float64).where(trusted(cube))
    if "collapsed_storey" in cube and name in VARIABLES and VARIABLES[name].unbounded:
        part = part.where(~(cube["collapsed_storey"] > 0) | part.isnull(), fallen)
    return part.assign_attrs(cube[name].attrs)


def need_variables(cube: xr.Dataset, what: str, names: Iterable[str], *, one: bool = False) -> list[str]:
    """Return those of `names` that the cube has; raise `InputError` where one lacks, or all with `one`."""
    names = list(names)
    lacking = [name for name in names if name not in cube.data_vars]
    if lacking and not (one and len(lacking) < len(names)):
        quoted = (" or " if one else ", ").join(map(repr, lacking))
        raise InputError(
            f"{what} needs {quoted}, which this cube lacks; add to the outputs of the sweep and run it again"
        )
    return [name for name in names if name not in lacking]


def chosen_variables(
    cube: xr.Dataset, what: str, names: Iterable[str] | None, valid: Sequence[str], kind: str
) -> list[str]:
    """Return `names`, which must be among `valid`; by default all of these that the cube has."""
    names = None if names is None else list(names)
    for name in names or ():
        check_choice(kind, name, valid)
    return need_variables(cube, what, valid if names is None else names, one=names is None)


def numbers_in(interval: str, numbers: Any, what: str) -> np.ndarray:
    """Return numbers, one or more; raises `InputError` unless all lie in an interval such as "[0, 1)"."""
    try:
        items = np.atleast_1d(np.asarray(numbers, dtype=object))
        at: np.ndarray = np.array([read_share(item) for item in items.ravel()]).reshape(items.shape)
    except ValueError:
        at = np.array([])
    low, high = map(float, interval[1:-1].split(","))
    inside = (at >= low if interval[0] == "[" else at > low) & (at <= high if interval[-1] == "]" else at < high)
    if at.ndim != 1 or not at.size:
        raise InputError(f"{what}: {repr_short(numbers)}; give a number in {interval}, or a list of one or more")
    if not inside.all():
        raise InputError(f"{what}: {at[~inside][0]:g} is not in {interval}")
    return at


def labelled(dim: str, labels: Iterable[Any], long_name: str, units: str = "") -> xr.DataArray:
    """Return the coordinate of a dimension."""
    attributes = {"long_name": long_name} | ({"units": units} if units else {})
    names = list(labels)
    return xr.DataArray(names, {dim: (dim, names, attributes)}, (dim,), attrs=attributes)


def law_keys(cube: xr.Dataset) -> list[str]:
    """Return the keys of the laws of a cube in the order in which they first occur; none where it does not say."""
    return list(dict.fromkeys(map(str, np.atleast_1d(cube["law"].values)))) if "law" in cube.coords else []


def of_law(cube: xr.Dataset, laws: Iterable[str]) -> xr.Dataset:
    """Return the scenarios of these laws, for ``law`` an axis, a coordinate of listed cases or a single value."""
    if "law" not in cube.coords or not cube["law"].dims:
        return cube
    (dim,) = cube["law"].dims
    return cube.isel({dim: np.flatnonzero(np.isin(cube["law"].values.astype(str), list(laws)))})


def pounding_only(cube: xr.Dataset) -> xr.Dataset:
    """Return the scenarios of all laws with contact."""
    return of_law(cube, {*law_keys(cube)} - {NO_POUNDING})


def without_pounding(cube: xr.Dataset, what: str) -> xr.Dataset:
    """Return the run without pounding that belongs to each scenario."""
    laws = law_keys(cube)
    if NO_POUNDING not in laws:
        raise InputError(
            f"{what} needs the runs without pounding (law {NO_POUNDING!r}), which this cube lacks: it has "
            f"{', '.join(laws) or 'no law'}. Add {NO_POUNDING!r} to the laws of the sweep and run it again"
        )
    if "case" in cube["law"].dims:
        twin = np.array(uncoupled_cases(cube))
        runs = cube.isel(case=twin).assign_coords(case=cube["case"])
        return runs.where(xr.DataArray(twin >= 0, dims="case")).reset_coords(drop=True)
    if cube["law"].dims:
        cube = cube.sel(law=NO_POUNDING)
        not_run = cube["status"] == int(Status.NOT_RUN) if "status" in cube else xr.DataArray(False)
        # of a merged cube some gaps may lack the run that others have
        dims = ignored_dims(not_run)
        cube = cube.isel(not_run.argmin(dims)) if dims and not_run.any() else cube
    return cube.reset_coords(drop=True)


def uncoupled_cases(cube: xr.Dataset) -> list[int]:
    """Return the position of the case without pounding that belongs to each listed case, -1 where there is none."""
    columns = {n: cube[n].values for n in _CASE_KEYS if n in cube.coords and "case" in cube[n].dims}
    keys = scenario_keys(columns or {"": np.zeros(cube.sizes["case"])}).tolist()
    still = np.flatnonzero(cube["law"].values.astype(str) == NO_POUNDING)
    first = {keys[row]: row for row in reversed(still)}
    return [first.get(key, -1) for key in keys]


def touched(cube: xr.Dataset, what: str) -> xr.DataArray:
    """Return 1 where floors touched, 0 where they did not, missing where the scenario is not ok or no floors meet."""
    parts = [values(cube, name) for name in need_variables(cube, what, TOUCH_VARIABLES, one=True)]
    surest = next((part for part in parts if part.notnull().any()), parts[0])
    return (surest > 0.0).astype(np.float64).where(surest.notnull())


def exceeds(cube: xr.Dataset, what: str, variable: str, level: float | None) -> xr.DataArray:
    """Return 1 where an output exceeds a level at any storey, or floors touch (""), 0 where not, missing if unknown."""
    if variable == "collapsed_storey" and variable not in cube:
        raise InputError(f"{what}: no storey of this row may fall; give its buildings p_delta and yield_strengths")
    if not variable:
        happened = touched(cube, what)
    else:
        need_variables(cube, what, [variable])
        response = values(cube, variable)
        happened = (response > (level or 0.0)).astype(np.float64).where(response.notnull())
        if "collapsed_storey" in cube and "building" in VARIABLES[variable].dims:
            happened = happened.where(~fell(cube) | (cube["collapsed_storey"] > 0) | (happened > 0.0))
    return happened.max("storey") if "storey" in happened.dims else happened


def peak_displacement(cube: xr.Dataset) -> xr.DataArray:
    """Return the largest absolute displacement of each floor (m), from its largest and smallest."""
    low, high = abs(values(cube, "displacement_min")), abs(values(cube, "displacement_max"))
    return described(high.where(~(low > high), low), "m", "largest absolute floor displacement")


def described(part: xr.DataArray, units: str, name: str, comment: str = "", *, bare: bool = False) -> xr.DataArray:
    """Return values with these attributes and no others, `bare` of scalar coordinates: what they were made of."""
    result = part.reset_coords(drop=True) if bare else part.copy(deep=False)
    result.attrs = {"units": units, "long_name": name} | ({"comment": comment} if comment else {})
    return result


def ratio(value: xr.DataArray, base: xr.DataArray, of: xr.DataArray, share: float = ROUND_OFF) -> xr.DataArray:
    """Divide by a base; missing where that is no larger than a share of the largest size of `of` in the row."""
    largest = abs(of).max([dim for dim in INNER_DIMS if dim in of.dims])
    return value / base.where(abs(base) > share * largest)


def long_name(part: xr.DataArray, name: str) -> str:
    """Return what a variable is called in words."""
    return str(part.attrs.get("long_name", name.replace("_", " ")))


def interpolate(table: np.ndarray, at: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Interpolate linearly along the last axis; nothing is extrapolated, and a place itself needs no neighbour."""
    finite = np.flatnonzero(np.isfinite(at))
    places, first = np.unique(at[finite], return_index=True)
    if not places.size:
        return np.full((*table.shape[:-1], len(targets)), np.nan)
    table = table[..., finite[first]]
    inside = np.clip(targets, places[0], places[-1])
    position = np.interp(inside, places, np.arange(len(places)))
    low = position.astype(int)
    high, share = np.minimum(low + 1, len(places) - 1), position - low
    with np.errstate(invalid="ignore"):  # of a building that fell at one of them infinite
        between = (1.0 - share) * table[..., low] + share * table[..., high]
    result = np.where(share == 0.0, table[..., low], between)
    return np.where(abs(targets - inside) <= ROUND_OFF * abs(places).max(), result, np.nan)


def fractiles_over(
    part: xr.DataArray, over: Sequence[str], quantiles: Sequence[float], dim: str = "quantile"
) -> tuple[xr.DataArray, xr.DataArray]:
    """Return fractiles over dimensions taken together, along a first one of their own, and counts of their values."""
    inner = part.isel(dict.fromkeys(over, 0), drop=True).reset_coords(drop=True)
    rows = part.transpose(*over, ...).values.reshape(-1, *inner.shape)
    ordered = np.sort(rows, axis=0)  # NaN sorts last; numpy's own nanquantile goes row by row
    count = np.sum(~np.isnan(ordered), axis=0)
    last = np.maximum(count - 1, 0)
    place = np.multiply.outer(np.asarray(quantiles, float), last)
    low = place.astype(np.intp)
    bottom, top = (np.take_along_axis(ordered, np.minimum(low + i, last), axis=0) for i in (0, 1))
    coords = {**inner.coords, dim: labelled(dim, quantiles, "share of the values below", "1")}
    with np.errstate(invalid="ignore"):  # those of buildings that fell are infinite
        between = np.where((top == bottom) | (place == low), bottom, bottom + (place - low) * (top - bottom))
    fractiles = xr.DataArray(between, coords, (dim, *inner.dims), attrs=part.attrs)
    return fractiles, inner.copy(data=count)
