"""Cubes of one study, from several machines or days, put together along their axes or their listed cases."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import os
from collections.abc import Hashable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from pounding_sweep.base.errors import InputError, shown
from pounding_sweep.output.audited import AUDIT_DIMS, has_audit
from pounding_sweep.output.dataset import VERSION_ATTRIBUTE, as_read, as_stored, package_version
from pounding_sweep.output.integrity import (
    AXIS_KEYS,
    BUILDING_AXES,
    FREE,
    OWN_LAWS,
    REMEDY,
    check_attributes,
    check_axes,
    check_statuses,
    check_variables,
    damaged,
    differing_laws,
    load_labels,
    outer_dims,
    recorded_axes,
    recorded_sweep,
)
from pounding_sweep.output.netcdf import check_output, check_space, open_cube, reading, write_in_slabs
from pounding_sweep.output.provenance import MAKER_ATTRIBUTES, ORIGINS, Maker, makers, origin, plain, runs
from pounding_sweep.output.scenario_key import KNOWN_BY, motion_of, numbered, scenario_keys
from pounding_sweep.output.slabs import BLOCK_BYTES, SLAB_BYTES, block_shape, slab_shape, slabs
from pounding_sweep.outputs.variables import INNER_DIMS, VARIABLES, Status
from pounding_sweep.spec.design import BLOCK, SAMPLE

#: Cubes by the name of their file
Parts = Mapping[str, "xr.Dataset"]
#: Dimension of listed scenarios.
CASE = "case"


def lists_cases(cube: xr.Dataset) -> bool:
    """Whether the scenarios of a cube are listed ones."""
    return CASE in cube.dims


def of_one_design(parts: dict[str, xr.Dataset]) -> dict[str, xr.Dataset]:
    """Return cubes without what designs say of their cases, where these were not drawn by one design."""
    designs = [_design(cube) for cube in parts.values()]
    if all(each == designs[0] for each in designs):
        return parts
    names = {SAMPLE, BLOCK, *(each["name"] for design in designs for each in design.get("inputs", ()))} - {*KNOWN_BY}
    return {file: cube.drop_vars([name for name in names if name in cube.coords]) for file, cube in parts.items()}


def _design(cube: xr.Dataset) -> dict[str, Any]:
    try:
        return dict(json.loads(cube.attrs["sweep"])["design"])
    except (KeyError, TypeError, ValueError, RecursionError):  # none, or no sweep: said later
        return {}


def check_cases(parts: Parts, sweeps: Sequence[Mapping[str, Any]]) -> None:
    """Raise `InputError` where the cases of cubes are not those of their sweeps, or ran in different kernels."""
    for (name, cube), sweep in zip(parts.items(), sweeps, strict=True):
        for key in ("law", "record"):
            if key not in cube.coords or cube[key].values.tolist() != [case[key] for case in sweep["cases"] or ()]:
                raise InputError(f"{name!r} has other cases than its sweep; {REMEDY}")
        for key in KNOWN_BY:
            if key in cube.coords and cube[key].dims[:1] != (CASE,):
                raise damaged(name, f"coordinate {key!r} is not along {CASE!r} first")
        labels = cube[CASE].values
        if labels.dtype.kind == "f" and not np.isfinite(labels).all():
            raise damaged(name, "a case has no label")
    (first, base), *others = parts.items()
    for (name, cube), key in itertools.product(others, ("period_factor", *KNOWN_BY)):
        if (key in cube.coords) != (key in base.coords):
            has, lacks = (first, name) if key in base.coords else (name, first)
            msg = f"{lacks!r} has no coordinate {key!r}, {has!r} has; give the cubes as they were made"
            if key == "period_factor":
                msg = (
                    f"{has!r} varies building properties and {lacks!r} doesn't, so they ran in different kernels: add "
                    "a case with such a property to the sweep of the second and run it again"
                )
            raise InputError(msg)


class Cases(NamedTuple):
    """Cubes with each of their cases once, the keys of those, and the labels and descriptions of all cases."""

    parts: dict[str, xr.Dataset]
    keys: list[list[bytes]]
    labels: list[Any]
    described: list[dict[str, Any]]


def cases_together(parts: Parts, sweeps: Sequence[Mapping[str, Any]]) -> Cases:
    """Find out which cases of cubes are the same: a list may name one in two spellings."""
    labelled = any(cube[CASE].values.tolist() != list(range(1, cube.sizes[CASE] + 1)) for cube in parts.values())
    texts: dict[str, int] = {}
    found, keys = {}, []
    described: dict[bytes, dict[str, Any]] = {}
    for (file, cube), sweep in zip(parts.items(), sweeps, strict=True):
        # with what the law ignores, too: a case was listed with it, and is selected by it
        names = [name for name in (*([CASE] if labelled else []), *KNOWN_BY) if name in cube.coords]
        known = scenario_keys({name: numbered(cube[name].values, texts) for name in names}).tolist()
        first = {key: position for position, key in reversed(list(enumerate(known)))}
        places = sorted(first.values())
        for position in places:
            described.setdefault(known[position], sweep["cases"][position])
        found[file] = cube if len(first) == cube.sizes[CASE] else cube.isel(case=places)
        keys.append([known[position] for position in places])
    labels = _labels(found, keys) if labelled else list(range(1, len(described) + 1))
    return Cases(found, keys, labels, list(described.values()))


def _labels(parts: Parts, keys: Sequence[Sequence[bytes]]) -> list[Any]:
    """Return the labels of all cases, each once, in the order given."""
    found: dict[Any, tuple[bytes, str, int]] = {}
    for (file, cube), mine in zip(parts.items(), keys, strict=True):
        for position, (label, key) in enumerate(zip(cube[CASE].values.tolist(), mine, strict=True)):
            known, other, place = found.setdefault(label, (key, file, position))
            if known != key:
                one, two = case_name(parts[other].coords, place), case_name(cube.coords, position)
                msg = f"case {label!r} is {one} in {other!r}, and {two} in {file!r}; give one of them another label"
                raise InputError(msg)
    kinds = sorted({type(label).__name__ for label in found})
    if len(kinds) > 1:
        msg = f"some cases have labels of type {kinds[0]}, others of type {kinds[1]}; give all of them text"
        raise InputError(msg)
    return list(found)


def telling(coordinates: Mapping[Any, xr.Variable]) -> list[str]:
    """Return those coordinates of listed cases in which they differ."""
    found = []
    for name in (name for name in KNOWN_BY if name in coordinates):
        values = coordinates[name].values
        if values.dtype.kind == "f":
            values = np.nan_to_num(values, nan=-np.inf)
        if (values != values[:1]).any():
            found.append(name)
    return found


def case_name(coordinates: Mapping[Any, Any], position: int, names: Sequence[str] = KNOWN_BY) -> str:
    """Say which scenario a listed case is, by those of its coordinates that have a value."""
    told = []
    for name in (name for name in names if name in coordinates):
        values = list(dict.fromkeys(np.ravel(coordinates[name].values[position]).tolist()))
        if not any(isinstance(value, float) and math.isnan(value) for value in values):
            told.append(f"{name}={'/'.join(map(str, values))}")
    return " ".join(told)


#: Global attributes that say how a part came to be, or are made anew.
OWN_ATTRIBUTES = frozenset(
    {
        *("history", "title", "records", "records_left_out", "sweep", "sweep_sha256", "time_step"),
        *("accuracy_choice", "accuracy_numbers"),
        *("scenarios_asked", "scenarios_run", "scenarios_never_touching", "scenarios_missing"),
        *("audit_scenarios", "audit_touching", "audit_share", "audit_perturbation", "audit_undecided_share"),
        *("source", VERSION_ATTRIBUTE, "xarray_version", *MAKER_ATTRIBUTES, *ORIGINS),
    }
)


def check_parts(parts: Parts, *, mix_sources: bool) -> list[dict[str, Any]]:
    """Return what cubes of one study say of their sweeps."""
    for name, cube in parts.items():
        if "status" not in cube.data_vars or "sweep" not in cube.attrs:
            msg = f"{name!r} is no cube of a sweep: it has no status, or no attribute 'sweep'; give cubes made by 'run'"
            raise InputError(msg)
        strange = [str(key) for key in scenario_variables(cube) if key not in VARIABLES]
        if strange:
            msg = f"{name!r} has the variables {', '.join(strange)}, which sweeps don't make; give cubes made by 'run'"
            raise InputError(msg)
    sweeps = [_check_whole(name, cube) for name, cube in parts.items()]
    _check_makers(parts, mix_sources=mix_sources)
    (first, base), *others = parts.items()
    for (name, cube), sweep in zip(others, sweeps[1:], strict=True):
        if lists_cases(base) != lists_cases(cube):
            cases, axes = (first, name) if lists_cases(base) else (name, first)
            msg = (
                f"{cases!r} lists its scenarios as cases, {axes!r} has axes. List those scenarios of the second that "
                f"you want as cases, run that sweep with --extend {axes}, which takes their results from it, and merge "
                "the cube so made with the first"
            )
            raise InputError(msg)
        for what, here, there in _differences(base, cube, sweeps[0], sweep):
            msg = (
                f"{first!r} and {name!r} are not parts of one study: {what} is {shown(here)} in the first and "
                f"{shown(there)} in the second; run one of them again with the other's"
            )
            raise InputError(msg)
    if lists_cases(base):
        check_cases(parts, sweeps)
    _check_labels(parts)
    return sweeps


def _check_whole(name: str, cube: xr.Dataset) -> dict[str, Any]:
    """Return what a cube says of its sweep; raise where it can't be what that sweep wrote."""
    told = recorded_sweep(name, cube)
    check_axes(name, cube, recorded_axes(cube, told))
    check_variables(name, cube, map(str, scenario_variables(cube)))
    check_attributes(name, cube, told)
    load_labels(name, cube)
    return told


def _check_makers(parts: Parts, *, mix_sources: bool) -> None:
    """Raise `InputError` where cubes were made by other versions of the package or of libraries, or another source."""
    (first, base), *others = parts.items()
    for name, cube in others:
        released = plain(cube.attrs[VERSION_ATTRIBUTE]) == plain(base.attrs[VERSION_ATTRIBUTE])
        both = parts_makers({first: base, name: cube})
        if released and (mix_sources or (len(both) == 1 and all(maker.source is not None for maker in both))):
            continue
        told = [key for key in Maker._fields if key == "source" or len({getattr(maker, key) for maker in both}) > 1]
        msg = (
            f"{first!r} was made by {_made_by(base, told)}, {name!r} by {_made_by(cube, told)}: the same scenario may "
            "have another result in each. Run them again with one of them, such as the installed package (version "
            f"{package_version()})"
        )
        if released:
            msg += (
                "; or, where you know that what changed between them touches no result, allow both: mix_sources=True, "
                "on the command line --mix-sources. The cube then says which file is of which"
            )
        raise InputError(msg)


def parts_makers(parts: Parts) -> set[Maker]:
    """Return what made cubes, or their parts."""
    return set().union(*(makers(cube.attrs) for cube in parts.values()))


def _made_by(cube: xr.Dataset, told: Sequence[str]) -> str:
    """Say what made a cube, by its version and those fields of its makers."""
    found = set()
    for maker in makers(cube.attrs):
        values = {**maker._asdict(), "source": maker.source and maker.source[:12]}  # the first digits tell enough
        found.add(", ".join(f"{k} {values[k]}" if values[k] else f"of a {k} it does not name" for k in told))
    return f"version {cube.attrs[VERSION_ATTRIBUTE]} ({'; '.join(sorted(found))})"


def _check_labels(parts: Parts) -> None:
    """Raise `InputError` where coordinates of cubes, or their audits, are not of one form."""
    (first, base), *others = parts.items()
    for name, cube in others:
        for key in sorted({*map(str, base.coords), *map(str, cube.coords)} - {CASE}):
            here, there = _form(base, key), _form(cube, key)
            if here != there and not _is_audit(base, key) and not _is_audit(cube, key):
                msg = (
                    f"coordinate {key!r} is {here} in {first!r} and {there} in {name!r}; "
                    "cubes of one study have the same, give them as they were made"
                )
                raise InputError(msg)
    audits = [(name, cube) for name, cube in parts.items() if has_audit(cube)]
    for name, cube in audits[1:]:
        first, base = audits[0]
        keys = [str(key) for key in base.variables if key in cube.variables and _is_audit(base, str(key))]
        unlike = [key for key in keys if _form(base, key) != _form(cube, key)]
        if unlike or base["output"].values.tolist() != cube["output"].values.tolist():
            what = unlike[0] if unlike else "output"
            msg = f"the audits of {first!r} and {name!r} differ in {what!r}; run one of the sweeps again"
            raise InputError(msg)


def _is_audit(cube: xr.Dataset, key: str) -> bool:
    """Whether a variable or coordinate belongs to the audit."""
    return key in cube.variables and bool(set(AUDIT_DIMS) & set(cube.variables[key].dims))


def _form(cube: xr.Dataset, key: str) -> str:
    """Say what kind of a coordinate a cube has under a name."""
    if key not in cube.variables:
        return "missing"
    kind = "numbers" if cube[key].dtype.kind in "iuf" else "text"
    return f"{kind} along ({', '.join(map(str, cube[key].dims))})"


def _differences(
    a: xr.Dataset, b: xr.Dataset, one: Mapping[str, Any], two: Mapping[str, Any]
) -> list[tuple[str, Any, Any]]:
    found: list[tuple[str, Any, Any]] = [
        ("the list of axes", outer_dims(a), outer_dims(b)),
        ("the list of variables", scenario_variables(a), scenario_variables(b)),
    ]
    found += differing_laws(one, two)
    for key in sorted({*one, *two} - AXIS_KEYS - BUILDING_AXES - FREE - {OWN_LAWS}):
        found.append((f"{key!r} of the sweep", one.get(key), two.get(key)))
    for key in sorted(AXIS_KEYS):
        found.append((f"whether {key!r} are given", one.get(key) is not None, two.get(key) is not None))
    for key in sorted({*a.attrs, *b.attrs} - OWN_ATTRIBUTES):
        found.append((f"attribute {key!r}", plain(a.attrs.get(key)), plain(b.attrs.get(key))))
    for name in INNER_DIMS:
        here, there = (cube[name].values.tolist() if name in cube.dims else [] for cube in (a, b))
        found.append((f"the list of {name}s", here, there))
    motions = {record["name"]: record for record in two["records"]}
    for record in one["records"]:
        if record["name"] in motions:
            other = motions[record["name"]]
            here, there = (list(motion_of(each)) for each in (record, other))
            found.append((f"record {record['name']!r}", here, there))
    return [each for each in found if each[1] != each[2]]


def scenario_variables(cube: xr.Dataset) -> list[Hashable]:
    """Variables of a cube that are not its audit's."""
    return [name for name, array in cube.data_vars.items() if AUDIT_DIMS[0] not in array.dims]


#: Values of an axis that differ by less than this were meant to be the same.
NEARLY = 1e-9


def together(what: str, parts: Sequence[Sequence[Any]]) -> list[Any]:
    """Return all values of an axis, each once: rising or falling if all parts are, else as they come."""
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
    """Return the coordinates of all parts; missing (NaN, "") where no part has both values of two axes."""
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
    given = next(iter(parts.values())).variables[name].dtype
    text = given.kind not in "iuf"
    whole = np.full(shape, "", object) if text else np.full(shape, np.nan)
    origin = np.full(shape, -1)
    for index, ((file, cube), at) in enumerate(zip(parts.items(), where, strict=True)):
        box = np.ix_(*(at[str(d)] if d in axes else np.arange(cube.sizes[d]) for d in dims))
        values = cube.variables[name].transpose(*dims).values
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
    """Return what a cube says of its parts: what they share, the sweep of all, where each is from."""
    cubes = list(parts.values())
    whole = {**described[0], "cases": cases}
    if any(each.get("design") != described[0].get("design") for each in described):
        whole.pop("design", None)
    for key in AXIS_KEYS:
        if whole.get(key) is not None:
            whole[key] = together(key, [each[key] for each in described])
    for key in BUILDING_AXES & whole.keys():
        each_building = zip(*(each[key] for each in described), strict=True)
        whole[key] = [[alike[0][0], together(key, [values for _, values in alike])] for alike in each_building]
    if own := {key: law for each in described for key, law in each.get(OWN_LAWS, {}).items()}:
        whole[OWN_LAWS] = own
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


def _first_of_each(audits: Sequence[xr.Dataset], names: Sequence[Hashable]) -> np.ndarray:
    """Where, along audits one after another, a scenario comes first, by the coordinates that say which it is."""
    texts: dict[str, int] = {}
    along = [[audit[name].transpose(AUDIT_DIMS[0], ...).values for name in names] for audit in audits]
    known = [{str(i): numbered(values, texts) for i, values in enumerate(each)} for each in along]
    return np.sort(np.unique(np.concatenate(list(map(scenario_keys, known))), return_index=True)[1])


def with_audit(cube: xr.Dataset, parts: Parts) -> xr.Dataset:
    """Put the audits of all parts, one after another, into their cube; of each scenario the first one."""
    audits = [part for part in parts.values() if has_audit(part)]
    if not audits:
        return cube
    first = audits[0]
    names = [name for name in first.variables if set(AUDIT_DIMS) & set(first[name].dims)]
    names = [name for name in names if all(name in audit.variables for audit in audits)]
    scenarios = [name for name in names if name in first.coords and name not in AUDIT_DIMS]
    chosen = _first_of_each(audits, scenarios)
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


#: Scenarios, missing or in conflict, that are named.
NAMED = 5
#: Relative difference between two results of the same scenario that is no conflict.
TOLERANCE = 1e-6


@dataclass
class Merged:
    """What a merge found.

    Attributes
    ----------
    path : Path
        The cube of all parts.
    scenarios : int
        Scenarios of it: every combination of the values on its axes, or all listed cases.
    overlapping : int
        Scenarios that several parts have a result of.
    missing : int
        Scenarios that no part has a result of; their status is not_run.
    named : list of str
        The first of the missing, by what they differ in from others.
    sources : int
        States of the package's source that made the parts, each with other versions of the libraries that compute
        counted apart.
    """

    path: Path
    scenarios: int
    overlapping: int = 0
    missing: int = 0
    named: list[str] = field(default_factory=list)
    sources: int = 1


def merge_cubes(
    paths: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    tolerance: float = TOLERANCE,
    mix_sources: bool = False,
) -> Merged:
    """Put cubes of one study together: same scene, numerics and outputs, other or overlapping axes or listed cases.

    Parameters
    ----------
    paths : sequence of path-like
        Cubes made by sweeps, at least two: all over the same axes, or all of listed cases.
    out : path-like
        netCDF file for the cube of all of them.
    overwrite : bool
        Whether a file `out` may be replaced.
    tolerance : float
        Relative difference at which two results of the same scenario are in conflict; of
        a variable's largest value in the scenario.
    mix_sources : bool
        Whether the parts may be made by several states of one version's source, or with several versions of numba,
        llvmlite or numpy; each is named in ``merged_from``, and the cube itself can't be extended.

    Returns
    -------
    Merged
        What was found. The cube's attribute ``merged_from`` says where each part is from.

    Raises
    ------
    InputError
        The cubes are not of one study, one is given twice or is not as it was made, or they have
        different results of the same scenario; the message names what differs, where, and both values.
    OutputError
        A cube can't be read, or the file can't be written.

    Notes
    -----
    No more than a slab of the cube is in memory at a time. Of identical results of a scenario the
    first part's is taken. Counts of what was run are sums over the runs that made the parts, each once: a part may
    hold others of them, or be a copy of one.

    Cases are known by law, record, scale, gaps, stiffness, restitution and building properties. The cube has each
    once, in the order given, numbered anew; labels that a user gave them in place of numbers are kept.
    """
    if len(paths) < 2 or not math.isfinite(tolerance) or tolerance < 0:
        msg = f"merging takes at least two cubes and a tolerance >= 0, not {len(paths)} and {tolerance!r}"
        raise InputError(msg)
    _check_distinct(paths)
    target = check_output(out, overwrite)
    with ExitStack() as files:
        parts = of_one_design({os.fspath(path): files.enter_context(open_cube(path)) for path in paths})
        merge = _Merge(parts, check_parts(parts, mix_sources=mix_sources), tolerance)
        blocks, values = merge.blocks(), merge.slabs()
        check_space(target.parent, merge.n_bytes, f"the cube of {merge.scenarios:,} scenarios")
        merge.found.path = write_in_slabs(merge.frame(), target, blocks, values, overwrite=overwrite)
    return merge.found


def _check_distinct(paths: Sequence[str | os.PathLike[str]]) -> None:
    """Raise `InputError` where two paths lead to one file: most likely another one was meant."""
    for first, path in itertools.combinations([os.fspath(path) for path in paths], 2):
        try:
            same = Path(first).expanduser().samefile(Path(path).expanduser())
        except (OSError, ValueError, RuntimeError):
            continue  # opening it tells what is wrong
        if same:
            twice = f"{path!r} is given twice" if first == path else f"{first!r} and {path!r} are the same file"
            raise InputError(f"{twice}; give each cube once")


class _Merge:
    """Parts on their way into one cube."""

    def __init__(self, parts: Mapping[str, xr.Dataset], sweeps: list[dict[str, Any]], tolerance: float) -> None:
        dims = outer_dims(next(iter(parts.values())))
        listed = cases_together(parts, sweeps) if dims == [CASE] else None
        if listed:
            parts, along = listed.parts, [{CASE: keys} for keys in listed.keys]
        else:
            along = [{dim: cube[dim].values.tolist() for dim in dims} for cube in parts.values()]
        axes = {dim: together(dim, [values[dim] for values in along]) for dim in dims}
        self.parts, self.tolerance, self.where = parts, tolerance, places(along, axes)
        self.axes = {CASE: listed.labels} if listed else axes
        self.labels = coordinates(parts, self.axes, self.where)
        self.telling = telling(self.labels) if listed else []
        base = next(iter(parts.values()))
        self.base, self.names = base, [str(name) for name in scenario_variables(base)]
        self.sizes = [len(values) for values in self.axes.values()]
        self.scenarios = math.prod(self.sizes)
        self.inner = {name: [base.sizes[dim] for dim in VARIABLES[name].dims] for name in self.names}
        each = {name: np.dtype(VARIABLES[name].dtype).itemsize * math.prod(self.inner[name]) for name in self.names}
        self.n_bytes = self.scenarios * sum(each.values())
        self.block = block_shape(self.sizes, BLOCK_BYTES // max(each.values()))
        self.slab = slab_shape(self.sizes, self.block, max(1, SLAB_BYTES // sum(each.values())))
        self.found = Merged(Path(), self.scenarios, sources=len(parts_makers(parts)))
        self.about = attributes(parts, sweeps, self.scenarios, listed.described if listed else None)
        self.conflicts: list[str] = []
        self.n_conflicts = 0

    def blocks(self) -> dict[str, tuple[int, ...]]:
        """Shape of the blocks in which the file stores each variable."""
        return {name: (*self.block, *self.inner[name]) for name in self.names}

    def frame(self) -> xr.Dataset:
        """Return the cube of all parts without its values, which would not fit into memory."""
        data = {}
        for name in self.names:
            zero = as_read(name, np.zeros((), VARIABLES[name].dtype))
            about = {key: v for key, v in self.base[name].attrs.items() if not str(key).startswith("audit_")}
            whole = np.broadcast_to(zero, (*self.sizes, *self.inner[name]))
            data[name] = ((*self.axes, *VARIABLES[name].dims), whole, about)
        cube = xr.Dataset(data, self.labels, self.about)
        for name, variable in self.labels.items():
            cube[name].encoding = variable.encoding
        return with_audit(cube, self.parts)

    def slabs(self) -> Iterator[tuple[tuple[slice, ...], dict[str, np.ndarray]]]:
        """Values of all parts as they are stored; raises `InputError` at the end if some are in conflict."""
        for slab in slabs(self.sizes, self.slab):
            shape = [part.stop - part.start for part in slab]
            values = {
                name: np.full((*shape, *self.inner[name]), VARIABLES[name].fill, VARIABLES[name].dtype)
                for name in self.names
                if name != "status"
            }
            values["status"] = np.full(shape, int(Status.NOT_RUN), np.int8)
            origin = np.full(shape, -1)
            for index, at in enumerate(self.where):
                self._lay(index, at, slab, values, origin)
            gone = values["status"] == Status.NOT_RUN
            self.found.missing += int(gone.sum())
            self.found.named += self._names(gone, slab, NAMED - len(self.found.named))
            yield slab, values
        if self.conflicts:
            more = self.n_conflicts - len(self.conflicts)
            msg = (
                f"parts have different results of {self.n_conflicts} scenarios: {'; '.join(self.conflicts)}"
                f"{f'; and {more} more' if more else ''}. Leave one of the parts out, or allow a larger tolerance"
            )
            raise InputError(msg)

    def _lay(
        self,
        index: int,
        at: Mapping[str, np.ndarray],
        slab: tuple[slice, ...],
        values: dict[str, np.ndarray],
        origin: np.ndarray,
    ) -> None:
        """Put what a part has of a slab into it, and compare it with what is there."""
        mine = {dim: np.flatnonzero((at[dim] >= s.start) & (at[dim] < s.stop)) for dim, s in zip(at, slab, strict=True)}
        if not all(len(positions) for positions in mine.values()):
            return
        file, cube = list(self.parts.items())[index]
        with reading(file):
            given = self._read(cube, mine)
        check_statuses(file, given["status"])
        box = np.ix_(*(at[dim][mine[dim]] - s.start for dim, s in zip(at, slab, strict=True)))
        there = values["status"][box] != Status.NOT_RUN
        new = ~there & (given["status"] != Status.NOT_RUN)
        both = there & (given["status"] != Status.NOT_RUN)
        self.found.overlapping += int(both.sum())
        if both.any():
            before = {name: values[name][box] for name in self.names}
            self._compare(before, given, both, origin[box], file, box, slab)
        for name in self.names:
            held = values[name][box]
            held[new] = given[name][new]
            values[name][box] = held
        held = origin[box]
        held[new] = index
        origin[box] = held

    def _read(self, cube: xr.Dataset, mine: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return the values of a part at rising places on its axes, as they are stored."""
        if CASE not in mine:
            return self._values(cube, mine)
        pieces = []  # cases may lie anywhere, and would be read one by one: what is between them is read, too
        cuts = np.flatnonzero(np.diff(mine[CASE] // self.slab[0])) + 1
        for some in np.split(mine[CASE], cuts):
            first, last = some[0], some[-1]
            whole = self._values(cube, {CASE: slice(first, last + 1)})
            pieces.append({name: array[some - first] for name, array in whole.items()})
        return {name: np.concatenate([piece[name] for piece in pieces]) for name in self.names}

    def _values(self, cube: xr.Dataset, part: Mapping[str, np.ndarray | slice]) -> dict[str, np.ndarray]:
        read = {name: cube.variables[name].isel(part) for name in self.names}
        return {
            name: as_stored(name, values.transpose(*self.axes, *VARIABLES[name].dims).values)
            for name, values in read.items()
        }

    def _compare(
        self,
        before: Mapping[str, np.ndarray],
        given: Mapping[str, np.ndarray],
        both: np.ndarray,
        origin: np.ndarray,
        file: str,
        box: tuple[np.ndarray, ...],
        slab: tuple[slice, ...],
    ) -> None:
        """Note the scenarios of which two parts have different results."""
        told = np.zeros(both.shape, bool)
        for name in self.names:
            a, b = before[name], given[name]
            inner = tuple(range(both.ndim, a.ndim))
            differs = a != b
            if VARIABLES[name].dtype == "f8":
                differs &= ~(np.isnan(a) & np.isnan(b))
                size = np.fmax(np.abs(a), np.abs(b))
                # of ratios, such as the residual of the energies, 1 is the whole
                least = 1.0 if VARIABLES[name].units == "1" else 0.0
                scale = np.fmax.reduce(size, axis=inner, keepdims=True, initial=least)
                with np.errstate(invalid="ignore"):
                    differs &= ~(np.abs(a - b) <= self.tolerance * scale)
            first = differs & both.reshape(*both.shape, *(1,) * len(inner))
            scenarios = first.any(axis=inner) & ~told
            told |= scenarios
            self.n_conflicts += int(scenarios.sum())
            for where in np.argwhere(scenarios)[: NAMED - len(self.conflicts)].tolist():
                place = tuple(where)
                spot = (*place, *np.argwhere(np.atleast_1d(first[place]))[0].tolist()[: len(inner)])
                whole = [int(axis.ravel()[i]) + s.start for axis, i, s in zip(box, where, slab, strict=True)]
                other = list(self.parts)[int(origin[place])]
                self.conflicts.append(
                    f"{self._name(whole)}: {name} {a[spot].item()!r} in {other!r}, {b[spot].item()!r} in {file!r}"
                )

    def _names(self, chosen: np.ndarray, slab: tuple[slice, ...], most: int) -> list[str]:
        found = np.argwhere(chosen)[: max(0, most)] + [part.start for part in slab]
        return [self._name(place) for place in found.tolist()]

    def _name(self, place: Sequence[int]) -> str:
        """Values of the axes at a place, of those that have several; of a listed case also what it differs in."""
        told = [f"{axis}={v[i]}" for (axis, v), i in zip(self.axes.items(), place, strict=True) if len(v) > 1]
        if CASE in self.axes and told:
            told.append(case_name(self.labels, place[0], self.telling))
        return " ".join(told) or "the scenario"
