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
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.base.errors import InputError, shown
from pounding_sweep.output.audited import AUDIT_DIMS, has_audit
from pounding_sweep.output.dataset import (
    VERSION_ATTRIBUTE,
    CubeParts,
    as_read,
    as_stored,
    encoding_of,
    package_version,
)
from pounding_sweep.output.identity import (
    AXIS_KEYS,
    BUILDING_AXES,
    FREE,
    KNOWN_BY,
    LIBRARIES,
    MAKER_ATTRIBUTES,
    ORIGINS,
    OWN_LAWS,
    REMEDY,
    check_axes,
    differing_laws,
    makers,
    motion_of,
    numbered,
    outer_dims,
    plain,
    recorded_axes,
    recorded_sweep,
    runs,
    scenario_keys,
)
from pounding_sweep.output.netcdf import (
    BLOCK_BYTES,
    SLAB_BYTES,
    block_shape,
    check_output,
    check_space,
    open_cube,
    reading,
    slab_shape,
    slabs,
    write_in_slabs,
)
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
    """Raise `InputError` if the cases of cubes are not those of their sweeps, or ran in different kernels."""
    for (name, cube), sweep in zip(parts.items(), sweeps, strict=True):
        for key in ("law", "record"):
            if key not in cube.coords or cube[key].values.tolist() != [case[key] for case in sweep["cases"]]:
                raise InputError(f"{name!r} has other cases than its sweep; {REMEDY}")
    (first, base), *others = parts.items()
    for name, cube in others:
        if ("period_factor" in cube.coords) != ("period_factor" in base.coords):
            has, lacks = (first, name) if "period_factor" in base.coords else (name, first)
            raise InputError(
                f"{has!r} varies building properties and {lacks!r} doesn't, so they ran in different kernels: add "
                "a case with such a property to the sweep of the second and run it again"
            )


def number_cases(
    parts: Parts, sweeps: Sequence[Mapping[str, Any]]
) -> tuple[dict[str, xr.Dataset], list[Any], list[dict[str, Any]]]:
    """Return cubes with each of their cases once, numbered over all cubes, and labels and descriptions of all cases."""
    labelled = any(cube[CASE].values.tolist() != list(range(1, cube.sizes[CASE] + 1)) for cube in parts.values())
    codes: dict[str, int] = {}
    numbers: dict[bytes, int] = {}
    labels: dict[Any, tuple[bytes, str, int]] = {}
    described, result = [], {}
    for (file, cube), sweep in zip(parts.items(), sweeps, strict=True):
        # with what the law ignores, too: a case was listed with it, and is selected by it
        names = [name for name in (*([CASE] if labelled else []), *KNOWN_BY) if name in cube.coords]
        keys = scenario_keys({name: numbered(cube[name].values, codes) for name in names}).tolist()
        positions = {key: position for position, key in reversed(list(enumerate(keys)))}
        positions = dict(sorted(positions.items(), key=lambda item: item[1]))  # a list may name a case in two spellings
        for key, position in positions.items():
            if key not in numbers:
                numbers[key] = len(numbers)
                described.append(sweep["cases"][position])
            label = cube[CASE].values[position].item()
            other_key, other, at = labels.setdefault(label, (key, file, position))
            if labelled and other_key != key:
                one, two = case_name(parts[other].coords, at), case_name(cube.coords, position)
                raise InputError(
                    f"case {label!r} is {one} in {other!r}, and {two} in {file!r}; give one of them another label"
                )
        chosen = cube if len(positions) == cube.sizes[CASE] else cube.isel(case=list(positions.values()))
        result[file] = chosen.assign_coords({CASE: [numbers[key] for key in positions]})
    kinds = sorted({type(label).__name__ for label in labels})
    if len(kinds) > 1:
        raise InputError(f"some cases have labels of type {kinds[0]}, others of type {kinds[1]}; give all of them text")
    return result, list(labels) if labelled else list(range(1, len(numbers) + 1)), described


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
            raise InputError(
                f"{name!r} is no cube of a sweep: it has no status, or no attribute 'sweep'; give cubes made by 'run'"
            )
        strange = [str(key) for key in scenario_variables(cube) if key not in VARIABLES]
        if strange:
            raise InputError(
                f"{name!r} has the variables {', '.join(strange)}, which sweeps don't make; give cubes made by 'run'"
            )
    _check_makers(parts, mix_sources=mix_sources)
    sweeps = [recorded_sweep(name, cube) for name, cube in parts.items()]
    for (name, cube), sweep in zip(parts.items(), sweeps, strict=True):
        check_axes(name, cube, recorded_axes(cube, sweep))
    (first, base), *others = parts.items()
    for (name, cube), sweep in zip(others, sweeps[1:], strict=True):
        if lists_cases(base) != lists_cases(cube):
            cases, axes = (first, name) if lists_cases(base) else (name, first)
            raise InputError(
                f"{cases!r} lists its scenarios as cases, {axes!r} has axes. List those scenarios of the second that "
                f"you want as cases, run that sweep with --extend {axes}, which takes their results from it, and merge "
                "the cube so made with the first"
            )
        for what, here, there in _differences(base, cube, sweeps[0], sweep):
            raise InputError(
                f"{first!r} and {name!r} are not parts of one study: {what} is {shown(here)} in the first and "
                f"{shown(there)} in the second; run one of them again with the other's"
            )
    if lists_cases(base):
        check_cases(parts, sweeps)
    labels = [
        {key for key, label in cube.coords.items() if not {*AUDIT_DIMS} & {*label.dims}} for cube in parts.values()
    ]
    for (name, _), keys in zip(others, labels[1:], strict=True):
        for key in sorted(map(str, keys ^ labels[0])):
            has, lacks = (first, name) if key in labels[0] else (name, first)
            raise InputError(f"coordinate {key!r} of {has!r} is missing in {lacks!r}; give the cubes as they were made")
    return sweeps


def _check_makers(parts: Parts, *, mix_sources: bool) -> None:
    """Raise `InputError` if cubes were made by other versions of the package or of libraries, or another source."""
    (first, base), *others = parts.items()
    for name, cube in others:
        released = plain(cube.attrs.get(VERSION_ATTRIBUTE)) == plain(base.attrs[VERSION_ATTRIBUTE])
        both = makers(base.attrs) | makers(cube.attrs)
        if released and (mix_sources or (len(both) == 1 and all(maker[0] is not None for maker in both))):
            continue
        different = [i for i, values in enumerate(zip(*both, strict=True)) if not i or len(set(values)) > 1]
        msg = (
            f"{first!r} was made by {_made_by(base, different)}, {name!r} by {_made_by(cube, different)}: the same "
            "scenario may have another result in each. Run them again with one of them, such as the installed package "
            f"(version {package_version()})"
        )
        if released:
            msg += (
                "; or, where you know that what changed between them touches no result, allow both: mix_sources=True, "
                "on the command line --mix-sources. The cube then says which file is of which"
            )
        raise InputError(msg)


def _made_by(cube: xr.Dataset, different: Sequence[int]) -> str:
    """Say what made a cube, by its version and those of its makers' attributes."""
    names = ("source", *LIBRARIES)
    texts = {
        ", ".join(f"{names[i]} {str(maker[i])[:12]}" if maker[i] else f"no known {names[i]}" for i in different)
        for maker in makers(cube.attrs)
    }
    return f"version {cube.attrs[VERSION_ATTRIBUTE]} ({'; '.join(sorted(texts))})"


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


def merge_values(what: str, parts: Sequence[Sequence[Any]]) -> list[Any]:
    """Return all values of an axis, each once: rising or falling if all parts are, else as they come."""
    values = list(dict.fromkeys(value for part in parts for value in part))
    if not all(isinstance(value, int | float) for value in values):
        return values
    rising, held = sorted(values), [set(part) for part in parts]
    for a, b in pairwise(rising):
        near = abs(b - a) <= NEARLY * max(abs(a), abs(b))
        if near and not any(a in part and b in part for part in held):  # a part with both means them apart
            raise InputError(
                f"{what} has the values {a!r} and {b!r}, the same but for rounding; run one part again with the other"
            )
    if all(a < b for part in parts for a, b in pairwise(part)):
        return rising
    return rising[::-1] if all(a > b for part in parts for a, b in pairwise(part)) else values


def merge_labels(parts: Parts, axes: Mapping[str, list[Any]]) -> dict[str, xr.Variable]:
    """Return the coordinates of all parts; missing (NaN, "") if no part has both values of two axes."""
    base = next(iter(parts.values()))
    labels = {
        file: part.drop_vars(part.data_vars).drop_dims(AUDIT_DIMS, errors="ignore").reset_coords().reindex(axes)
        for file, part in parts.items()
    }
    result = {}
    for name in map(str, base.coords):
        if {*AUDIT_DIMS} & {*base[name].dims}:
            continue
        dims, dtype = base[name].dims, base[name].dtype
        (_, whole), *others = ((file, each[name].transpose(*dims).variable) for file, each in labels.items())
        for file, values in others:
            differs = (whole.notnull() & values.notnull() & (whole != values)).values
            if differs.any():
                one, two = (each.values[differs].tolist()[0] for each in (whole, values))
                earlier = next(
                    f for f, each in labels.items() if each[name].transpose(*dims).notnull().values[differs][0]
                )
                raise InputError(
                    f"coordinate {name!r} is {one!r} in {earlier!r}, and {two!r} at the same place in {file!r}; "
                    "cubes of one study agree in it, so one is damaged or was changed: run it again"
                )
            whole = whole.where(whole.notnull(), values)
        if dtype.kind == "U":
            whole = whole.where(whole.notnull(), "").astype(np.str_)
        elif dtype.kind in "iu" and bool(whole.notnull().all()):
            whole = whole.astype(dtype)
        result[name] = xr.Variable(dims, whole.values, base[name].attrs, {"_FillValue": None})
    return result


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
            whole[key] = merge_values(key, [each[key] for each in described])
    for key in BUILDING_AXES & whole.keys():
        each_building = zip(*(each[key] for each in described), strict=True)
        whole[key] = [[alike[0][0], merge_values(key, [values for _, values in alike])] for alike in each_building]
    if own := {key: law for each in described for key, law in each.get(OWN_LAWS, {}).items()}:
        whole[OWN_LAWS] = own
    whole["records"] = list(_by_name([each["records"] for each in described]).values())
    there = {record["name"] for record in whole["records"]}
    left_out = merge_values("records_left_out", [each["records_left_out"] for each in described])
    whole["records_left_out"] = [name for name in left_out if name not in there]
    text = json.dumps(whole, sort_keys=True, separators=(",", ":"), allow_nan=False)
    base = cubes[0].attrs
    found = {key: value for key, value in base.items() if key not in OWN_ATTRIBUTES or key == "title"}
    told = _by_name([json.loads(cube.attrs["records"]) for cube in cubes])
    found["records"] = json.dumps([told[record["name"]] for record in whole["records"]], sort_keys=True)
    found |= {"sweep": text, "sweep_sha256": hashlib.sha256(text.encode()).hexdigest(), "scenarios_asked": n}
    all_runs = runs({file: cube.attrs for file, cube in parts.items()})
    for key in ("scenarios_run", "scenarios_never_touching"):
        found[key] = sum(int(run.get(key, 0)) for run in all_runs)
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
    all_makers = set().union(*(makers(cube.attrs) for cube in cubes))
    for key, values in zip(MAKER_ATTRIBUTES, zip(*all_makers, strict=True), strict=True):
        if len(set(values)) == 1 and values[0] is not None:
            found[key] = values[0]
    now = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}"
    found["history"] = f"{now} merged from {len(cubes)} cubes by pounding_sweep {package_version()} (see merged_from)"
    found["merged_from"] = json.dumps(all_runs)
    return found


def _by_name(listed: list[list[dict[str, Any]]]) -> dict[str, dict[str, Any]]:
    """Return the records of several lists, each once, the first one of its name."""
    found: dict[str, dict[str, Any]] = {}
    for records in listed:
        for record in records:
            found.setdefault(record["name"], record)
    return found


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
        dims, values = first[name].dims, first[name].values
        if AUDIT_DIMS[0] in dims:
            along = dims.index(AUDIT_DIMS[0])
            values = np.concatenate([audit[name].values for audit in audits], axis=along).take(chosen, axis=along)
        if name == AUDIT_DIMS[0]:
            values = np.arange(1, n + 1, dtype=np.int32)
        found[name] = xr.Variable(dims, values, first[name].attrs, {"_FillValue": None})
    labels = {name: variable for name, variable in found.items() if name in first.coords}
    result = cube.assign({name: v for name, v in found.items() if name not in labels}).assign_coords(labels)
    decided = found["audit_undecided"].values == 0
    for i, name in enumerate(found["output"].values.tolist()):
        if decided.any() and name in result:
            error = found["audit_error"].values[decided, i]
            result[name].attrs |= {"audit_error_max": float(error.max()), "audit_error_median": float(np.median(error))}
    audited = runs({file: part.attrs for file, part in parts.items() if has_audit(part)})
    audited = [run for run in audited if "audit_touching" in run]
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
        raise InputError(f"merging takes at least two cubes and a tolerance >= 0, not {len(paths)} and {tolerance!r}")
    _check_distinct(paths)
    target = check_output(out, overwrite)
    with ExitStack() as files:
        parts = of_one_design({os.fspath(path): files.enter_context(open_cube(path)) for path in paths})
        merge = _Merge(parts, check_parts(parts, mix_sources=mix_sources), tolerance)
        blocks, values = merge.blocks(), merge.slabs()
        check_space(target.parent, merge.n_bytes, f"the cube of {merge.scenarios:,} scenarios")
        merge.found.path = write_in_slabs(merge.cube(), target, blocks, values, overwrite=overwrite)
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

    def __init__(self, parts: Parts, sweeps: list[dict[str, Any]], tolerance: float) -> None:
        base = next(iter(parts.values()))
        self.base, self.tolerance = base, tolerance
        self.names = [str(name) for name in scenario_variables(base)]
        cases = None
        if dims := [dim for dim in outer_dims(base) if dim != CASE]:
            along = [{dim: cube[dim].values.tolist() for dim in dims} for cube in parts.values()]
            self.axes = {dim: merge_values(dim, [values[dim] for values in along]) for dim in dims}
        else:
            kind = np.result_type(*(part[CASE].dtype for part in parts.values()))
            parts, labels, cases = number_cases(parts, sweeps)
            self.axes = {CASE: list(range(len(labels)))}
        self.parts = parts
        self.results = {file: part[self.names].reset_coords(drop=True) for file, part in parts.items()}
        self.labels = merge_labels(parts, self.axes)
        if cases is not None:
            values = np.array(labels, kind if kind.kind in "iuf" else np.str_)
            self.labels[CASE] = xr.Variable((CASE,), values, base[CASE].attrs, {"_FillValue": None})
        self.telling = [] if cases is None else telling(self.labels)
        self.sizes = [len(values) for values in self.axes.values()]
        self.scenarios = math.prod(self.sizes)
        self.inner = {name: [base.sizes[dim] for dim in VARIABLES[name].dims] for name in self.names}
        sizes = {name: np.dtype(VARIABLES[name].dtype).itemsize * math.prod(self.inner[name]) for name in self.names}
        self.n_bytes = self.scenarios * sum(sizes.values())
        self.block = block_shape(self.sizes, BLOCK_BYTES // max(sizes.values()))
        self.slab = slab_shape(self.sizes, self.block, max(1, SLAB_BYTES // sum(sizes.values())))
        self.found = Merged(
            Path(), self.scenarios, sources=len(set().union(*(makers(p.attrs) for p in parts.values())))
        )
        self.about = attributes(parts, sweeps, self.scenarios, cases)
        self.conflicts: list[str] = []
        self.n_conflicts = 0

    def blocks(self) -> dict[str, tuple[int, ...]]:
        """Shape of the blocks in which the file stores each variable."""
        return {name: (*self.block, *self.inner[name]) for name in self.names}

    def cube(self) -> CubeParts:
        """Return the cube of all parts without its values, which would not fit into memory."""
        data = {}
        for name in self.names:
            zero = as_read(name, np.zeros((), VARIABLES[name].dtype))
            about = {key: v for key, v in self.base[name].attrs.items() if not str(key).startswith("audit_")}
            whole = np.broadcast_to(zero, (*self.sizes, *self.inner[name]))
            data[name] = ((*self.axes, *VARIABLES[name].dims), whole, about)
        cube = with_audit(xr.Dataset(data, self.labels, self.about), self.parts)
        parts = CubeParts({}, {}, cube.attrs)
        for key, v in cube.variables.items():
            encoding = encoding_of(str(key), v.dtype, is_coordinate=key in cube.coords)
            stored = (tuple(map(str, v.dims)), v.values, v.attrs, encoding)
            (parts.coords if key in cube.coords else parts.data_vars)[str(key)] = stored
        return parts

    def slabs(self) -> Iterator[tuple[tuple[slice, ...], dict[str, np.ndarray]]]:
        """Values of all parts as they are stored; raises `InputError` at the end if some are in conflict."""
        for slab in slabs(self.sizes, self.slab):
            labels = {dim: values[part] for (dim, values), part in zip(self.axes.items(), slab, strict=True)}
            shape = [len(values) for values in labels.values()]
            values = {
                name: np.full((*shape, *self.inner[name]), VARIABLES[name].fill, VARIABLES[name].dtype)
                for name in self.names
                if name != "status"
            }
            values["status"] = np.full(shape, int(Status.NOT_RUN), np.int8)
            origin = np.full(shape, -1)
            for index, file in enumerate(self.parts):
                results = self._read(file, labels)
                if results is None:
                    continue
                exists = results["status"] != Status.NOT_RUN
                new, both = exists & (origin < 0), exists & (origin >= 0)
                self.found.overlapping += int(both.sum())
                if both.any():
                    self._compare(values, results, both, origin, file, slab)
                for name in self.names:
                    values[name][new] = results[name][new]
                origin[new] = index
            self.found.missing += int((origin < 0).sum())
            missing = np.argwhere(origin < 0)[: max(0, NAMED - len(self.found.named))]
            self.found.named += [
                self._name(position) for position in (missing + [part.start for part in slab]).tolist()
            ]
            yield slab, values
        if self.conflicts:
            more = self.n_conflicts - len(self.conflicts)
            raise InputError(
                f"parts have different results of {self.n_conflicts} scenarios: {'; '.join(self.conflicts)}"
                f"{f'; and {more} more' if more else ''}. Leave one of the parts out, or allow a larger tolerance"
            )

    def _read(self, file: str, labels: Mapping[str, list[Any]]) -> dict[str, np.ndarray] | None:
        """Return what a part has of a slab, as it is stored and missing elsewhere; None if it has nothing of it."""
        part, chosen = self.results[file], {}
        for dim, values in labels.items():
            positions = np.flatnonzero(part.indexes[dim].isin(values))
            if not len(positions):
                return None
            first, last = positions[0], positions[-1]  # a range is read in one piece
            chosen[dim] = slice(first, last + 1) if last - first < 4 * len(positions) else positions
        with reading(file):
            read = part.isel(chosen).load()
        read = read.reindex(labels, fill_value={"status": int(Status.NOT_RUN)})
        return {
            name: as_stored(name, read[name].transpose(*self.axes, *VARIABLES[name].dims).values) for name in self.names
        }

    def _compare(
        self,
        before: Mapping[str, np.ndarray],
        results: Mapping[str, np.ndarray],
        both: np.ndarray,
        origin: np.ndarray,
        file: str,
        slab: tuple[slice, ...],
    ) -> None:
        """Note the scenarios of which two parts have different results."""
        noted = np.zeros(both.shape, bool)
        for name in self.names:
            a, b = before[name], results[name]
            inner = tuple(range(both.ndim, a.ndim))
            differs = a != b
            if VARIABLES[name].dtype == "f8":
                # of ratios, such as the residual of the energies, 1 is the whole
                least = 1.0 if VARIABLES[name].units == "1" else 0.0
                scale = np.fmax.reduce(np.fmax(np.abs(a), np.abs(b)), axis=inner, keepdims=True, initial=least)
                with np.errstate(invalid="ignore"):
                    differs &= ~(np.isnan(a) & np.isnan(b)) & ~(np.abs(a - b) <= self.tolerance * scale)
            differs &= both.reshape(*both.shape, *(1,) * len(inner))
            scenarios = differs.any(axis=inner) & ~noted
            noted |= scenarios
            self.n_conflicts += int(scenarios.sum())
            for position in np.argwhere(scenarios)[: NAMED - len(self.conflicts)].tolist():
                place = tuple(position)
                spot = (*place, *np.argwhere(np.atleast_1d(differs[place]))[0].tolist()[: len(inner)])
                name_of = self._name([i + part.start for i, part in zip(position, slab, strict=True)])
                other = list(self.parts)[int(origin[place])]
                self.conflicts.append(
                    f"{name_of}: {name} {a[spot].item()!r} in {other!r}, {b[spot].item()!r} in {file!r}"
                )

    def _name(self, position: Sequence[int]) -> str:
        """Return the values of the axes that have several, and of a listed case also what it differs in."""
        labels = [(axis, self.labels[axis].values[i].item()) for axis, i in zip(self.axes, position, strict=True)]
        texts = [f"{axis}={label}" for axis, label in labels if len(self.axes[axis]) > 1]
        if CASE in self.axes and texts:
            texts.append(case_name(self.labels, position[0], self.telling))
        return " ".join(texts) or "the scenario"
