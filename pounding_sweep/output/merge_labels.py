"""Axes, coordinates, attributes and audit of several cubes of one study together.

Listed cases are an axis whose values are what each case is known by; see `pounding_sweep.output.merge_cases`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Hashable, Mapping, Sequence
from datetime import UTC, datetime
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import InputError
from pounding_sweep.output.audited import AUDIT_DIMS, has_audit
from pounding_sweep.output.dataset import VERSION_ATTRIBUTE, package_version
from pounding_sweep.output.merge_cases import CASE, Parts
from pounding_sweep.output.merge_checks import AXES, BUILDING_AXES
from pounding_sweep.output.merge_study import OWN_ATTRIBUTES, parts_makers
from pounding_sweep.output.provenance import MAKER_ATTRIBUTES, origin, runs

if TYPE_CHECKING:
    import xarray as xr

#: Values of an axis that differ by less than this were meant to be the same.
NEARLY = 1e-9


def together(what: str, parts: Sequence[Sequence[Any]]) -> list[Any]:
    """Return all values of an axis, each once: rising or falling if all parts are, else as they come.

    Raises
    ------
    InputError
        Two of them, which no part holds both of, are the same but for rounding.

    Examples
    --------
    >>> together("gap", [[0.01, 0.03], [0.02]]), together("law", [["linear", "none"], ["hertz"]])
    ([0.01, 0.02, 0.03], ['linear', 'none', 'hertz'])
    """
    values = list(dict.fromkeys(value for part in parts for value in part))
    if not all(isinstance(value, int | float) for value in values):
        return values
    rising, held = sorted(values), [set(part) for part in parts]
    for a, b in pairwise(rising):
        near = abs(b - a) <= NEARLY * max(abs(a), abs(b))
        if near and not any(a in part and b in part for part in held):  # a part with both means them apart
            msg = f"{what} has the values {a!r} and {b!r}, the same but for rounding; run one part again with the other"
            raise InputError(msg)
    if all(a < b for part in parts for a, b in pairwise(part)):
        return rising
    return rising[::-1] if all(a > b for part in parts for a, b in pairwise(part)) else values


def places(along: Sequence[Mapping[str, Sequence[Any]]], axes: Mapping[str, list[Any]]) -> list[dict[str, np.ndarray]]:
    """Where the values of each part's axes stand on the axes of all."""
    where = {axis: {value: i for i, value in enumerate(values)} for axis, values in axes.items()}
    return [{axis: np.array([at[value] for value in mine[axis]]) for axis, at in where.items()} for mine in along]


def coordinates(parts: Parts, axes: Mapping[str, list[Any]], where: list[dict[str, np.ndarray]]) -> dict[str, Any]:
    """Return the coordinates of all parts; missing (NaN, "") where no part has both values of two axes.

    Raises
    ------
    InputError
        Parts give different values at the same place.
    """
    import xarray as xr

    base = next(iter(parts.values()))
    found: dict[str, Any] = {}
    for name, given in base.coords.items():
        if set(AUDIT_DIMS) & set(given.dims):
            continue
        shape = [len(axes[str(dim)]) if dim in axes else base.sizes[dim] for dim in given.dims]
        if name == CASE:  # each part may number its own from 1
            kind = np.result_type(*(cube[CASE].dtype for cube in parts.values()))
            whole = np.array(axes[CASE], kind if kind.kind in "iuf" else np.str_)
        else:
            whole = _whole(str(name), given.dims, shape, parts, axes, where)
        stored = xr.Variable(given.dims, whole, given.attrs)
        stored.encoding = {"_FillValue": None}
        found[str(name)] = stored
    return found


def _whole(
    name: str,
    dims: Sequence[Hashable],
    shape: Sequence[int],
    parts: Parts,
    axes: Mapping[str, list[Any]],
    where: list[dict[str, np.ndarray]],
) -> np.ndarray:
    """Return the values of a coordinate from all parts."""
    given = next(iter(parts.values()))[name].dtype
    text = given.kind not in "iuf"
    whole = np.full(shape, "", object) if text else np.full(shape, np.nan)
    origin = np.full(shape, -1)
    for index, ((file, cube), at) in enumerate(zip(parts.items(), where, strict=True)):
        box = np.ix_(*(at[str(d)] if d in axes else np.arange(cube.sizes[d]) for d in dims))
        values = cube[name].transpose(*dims).values
        differs = (origin[box] >= 0) & (whole[box] != values)
        if not text:
            differs &= ~(np.isnan(whole[box]) & np.isnan(values))
        if differs.any():
            one, two = whole[box][differs].tolist()[0], values[differs].tolist()[0]
            earlier = list(parts)[int(origin[box][differs][0])]
            msg = (
                f"coordinate {name!r} is {one!r} in {earlier!r}, and {two!r} at the same place in {file!r}; "
                "cubes of one study agree in it, so one is damaged or was changed: run it again"
            )
            raise InputError(msg)
        whole[box], origin[box] = values, index
    if text:
        return whole.astype(np.str_)
    return whole.astype(given) if given.kind in "iu" and (origin >= 0).all() else whole


def attributes(
    parts: Parts, described: Sequence[Mapping[str, Any]], n: int, cases: list[dict[str, Any]] | None
) -> dict[str, Any]:
    """Return what a cube says of its parts: what they share, the sweep of all, where each is from.

    Parameters
    ----------
    parts : mapping of str to xarray.Dataset
        Cubes of one study.
    described : sequence of dict
        What they say of their sweeps.
    n : int
        Scenarios of all of them together.
    cases : list of dict or None
        What is to be said of those, where they are listed cases.
    """
    cubes = list(parts.values())
    whole = {**described[0], "cases": cases}
    for key in AXES:
        if whole[key] is not None:
            whole[key] = together(key, [each[key] for each in described])
    for key in BUILDING_AXES:
        each_building = zip(*(each[key] for each in described), strict=True)
        whole[key] = [[alike[0][0], together(key, [values for _, values in alike])] for alike in each_building]
    whole["records"] = list(_by_name([each["records"] for each in described]).values())
    there = {record["name"] for record in whole["records"]}
    left_out = together("records_left_out", [each["records_left_out"] for each in described])
    whole["records_left_out"] = [name for name in left_out if name not in there]
    text = json.dumps(whole, sort_keys=True, separators=(",", ":"), allow_nan=False)
    base = cubes[0].attrs
    found = {key: value for key, value in base.items() if key not in OWN_ATTRIBUTES or key == "title"}
    told = _by_name([json.loads(cube.attrs["records"]) for cube in cubes])
    found["records"] = json.dumps([told[record["name"]] for record in whole["records"]], sort_keys=True)
    found |= {"sweep": text, "sweep_sha256": hashlib.sha256(text.encode()).hexdigest(), "scenarios_asked": n}
    for key in ("scenarios_run", "scenarios_never_touching"):
        found[key] = sum(int(run.get(key, 0)) for run in _runs(parts))
    steps = [
        dict(zip((r["name"] for r in each["records"]), np.atleast_1d(cube.attrs["time_step"]).tolist(), strict=True))
        for each, cube in zip(described, cubes, strict=True)
        if "time_step" in cube.attrs
    ]
    if steps:
        every = {name: step for each in steps for name, step in each.items()}
        found["time_step"] = np.array([every[record["name"]] for record in whole["records"]])
    if "accuracy_choice" in base:
        found["accuracy_choice"] = " | ".join(dict.fromkeys(str(cube.attrs["accuracy_choice"]) for cube in cubes))
    if whole["records_left_out"]:
        found["records_left_out"] = json.dumps(whole["records_left_out"])
    for key in ("source", VERSION_ATTRIBUTE):  # the same for all
        if key in base:
            found[key] = base[key]
    for key, values in zip(MAKER_ATTRIBUTES, zip(*parts_makers(parts), strict=True), strict=True):
        if len(set(values)) == 1 and values[0] is not None:
            found[key] = values[0]
    now = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}"
    found["history"] = f"{now} merged from {len(cubes)} cubes by pounding_sweep {package_version()} (see merged_from)"
    found["merged_from"] = json.dumps([origin(file, cube.attrs) for file, cube in parts.items()])
    return found


def _by_name(listed: list[list[dict[str, Any]]]) -> dict[str, dict[str, Any]]:
    """Return the records of several lists, each once, the first one of its name."""
    found: dict[str, dict[str, Any]] = {}
    for records in listed:
        for record in records:
            found.setdefault(record["name"], record)
    return found


def _runs(parts: Parts) -> list[dict[str, Any]]:
    """Return what is said of the runs that made cubes, each once: one may be a part of another, or a copy."""
    found: dict[str, dict[str, Any]] = {}
    for file, cube in parts.items():
        found |= runs(file, cube.attrs)
    return list(found.values())


def _first_of_each(audits: Sequence[Sequence[xr.DataArray]]) -> list[int]:
    """Where, along audits one after another, a scenario comes first, by the coordinates that say which it is."""
    found: dict[str, int] = {}
    position = 0
    for audit in audits:
        columns = [array.transpose(AUDIT_DIMS[0], ...).values.tolist() for array in audit]
        for row in zip(*columns, strict=True):
            found.setdefault(repr(row), position)  # as text, in which a missing value equals another
            position += 1
    return list(found.values())


def with_audit(cube: xr.Dataset, parts: Parts) -> xr.Dataset:
    """Put the audits of all parts, one after another, into their cube; of each scenario the first one."""
    import xarray as xr

    audits = [part for part in parts.values() if has_audit(part)]
    if not audits:
        return cube
    first = audits[0]
    names = [name for name in first.variables if set(AUDIT_DIMS) & set(first[name].dims)]
    names = [name for name in names if all(name in audit.variables for audit in audits)]
    scenarios = [name for name in names if name in first.coords and name not in AUDIT_DIMS]
    chosen = _first_of_each([[audit[name] for name in scenarios] for audit in audits])
    n = len(chosen)
    found = {}
    for name in names:
        dims = first[name].dims
        values = first[name].values
        if AUDIT_DIMS[0] in dims:
            along = dims.index(AUDIT_DIMS[0])
            values = np.concatenate([audit[name].values for audit in audits], axis=along).take(chosen, axis=along)
        found[name] = xr.Variable(dims, values, first[name].attrs)
        found[name].encoding = {"_FillValue": None}
    found["audit"] = xr.Variable(("audit",), np.arange(1, n + 1, dtype=np.int32), first["audit"].attrs)
    found["audit"].encoding = {"_FillValue": None}
    labels = {name: variable for name, variable in found.items() if name in first.coords}
    result = cube.assign({name: v for name, v in found.items() if name not in labels}).assign_coords(labels)
    decided = found["audit_undecided"].values == 0
    for i, name in enumerate(found["output"].values.tolist()):
        if decided.any() and name in result:
            error = found["audit_error"].values[decided, i]
            result[name].attrs |= {"audit_error_max": float(error.max()), "audit_error_median": float(np.median(error))}
    audited = [run for run in _runs({f: p for f, p in parts.items() if has_audit(p)}) if "audit_touching" in run]
    touching = np.array([int(run["audit_touching"]) for run in audited])
    share = np.array([float(run["audit_share"]) for run in audited])
    result.attrs |= {
        "audit_scenarios": n,
        "audit_touching": int(touching.sum()),
        "audit_share": float((share * touching).sum() / touching.sum()),
        "audit_perturbation": first.attrs["audit_perturbation"],
        "audit_undecided_share": float(1.0 - decided.mean()),
    }
    return result
