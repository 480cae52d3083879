"""Cubes of one study, from several machines or days, put together along their axes or their listed cases."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.base.errors import InputError, shown
from pounding_sweep.output.audited import AUDIT_DIMS, add_audit, has_audit
from pounding_sweep.output.dataset import (
    VERSION_ATTRIBUTE,
    CubeParts,
    as_stored,
    coordinate_values,
    package_version,
    unfilled,
)
from pounding_sweep.output.identity import (
    AXIS_KEYS,
    BUILDING_AXES,
    KNOWN_BY,
    LIBRARIES,
    MAKER_ATTRIBUTES,
    ORIGINS,
    OWN_LAWS,
    REMEDY,
    check_axes,
    differing_sweeps,
    makers,
    motion_of,
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
#: Global attributes that say how a part came to be, or are made anew, and how others of them begin.
OWN_ATTRIBUTES = frozenset(
    {
        *("history", "title", "records", "records_left_out", "sweep", "sweep_sha256", "time_step"),
        *("accuracy_choice", "accuracy_numbers", *MAKER_ATTRIBUTES, *ORIGINS),
    }
)
OWN_BEGINNINGS = ("scenarios_", "audit_")
#: Values of an axis that differ by less than this were meant to be the same.
NEARLY = 1e-9
#: Scenarios, missing or in conflict, that are named.
NAMED = 5
#: Relative difference between two results of the same scenario that is no conflict.
TOLERANCE = 1e-6


def check_parts(parts: Parts, *, mix_sources: bool) -> list[dict[str, Any]]:
    """Return what cubes of one study say of their sweeps."""
    for name, cube in parts.items():
        if "status" not in cube.data_vars or "sweep" not in cube.attrs:
            raise InputError(
                f"{name!r} is no cube of a sweep: it has no status, or no attribute 'sweep'; give cubes made by 'run'"
            )
    _check_makers(parts, mix_sources=mix_sources)
    sweeps = [recorded_sweep(name, cube) for name, cube in parts.items()]
    (first, base), *_ = parts.items()
    for (name, cube), sweep in zip(parts.items(), sweeps, strict=True):
        check_axes(name, cube, recorded_axes(sweep))
        for what, here, there in _differences(base, cube, sweeps[0], sweep):
            raise InputError(
                f"{first!r} and {name!r} are not parts of one study: {what} is {shown(here)} in the first and "
                f"{shown(there)} in the second; run one of them again with the other's"
            )
        for key in ("law", "record") if CASE in cube.dims else ():
            if key not in cube.coords or cube[key].values.tolist() != [case[key] for case in sweep["cases"]]:
                raise InputError(f"{name!r} has other cases than its sweep; {REMEDY}")
    return sweeps


def _check_makers(parts: Parts, *, mix_sources: bool) -> None:
    """Raise `InputError` if cubes were made by other versions of the package or of libraries, or another source."""
    (first, base), *others = parts.items()
    for name, cube in others:
        released = plain(cube.attrs.get(VERSION_ATTRIBUTE)) == plain(base.attrs[VERSION_ATTRIBUTE])
        both = makers(base.attrs) | makers(cube.attrs)
        if released and (mix_sources or len(both) == 1):
            continue
        remedy = (
            "; or, where you know that what changed between them touches no result, allow both: mix_sources=True, "
            "on the command line --mix-sources. The cube then says which file is of which"
        )
        raise InputError(
            f"{first!r} was made by {_made_by(base)}, {name!r} by {_made_by(cube)}: the same scenario may have another "
            "result in each. Run them again with one of them, such as the installed package "
            f"(version {package_version()}){remedy if released else ''}"
        )


def _made_by(cube: xr.Dataset) -> str:
    """Say what made a cube, by its version, source and libraries."""
    names = ("source", *LIBRARIES)
    texts = [
        ", ".join(f"{name} {str(value)[:12]}" for name, value in zip(names, maker, strict=True))
        for maker in makers(cube.attrs)
    ]
    return f"version {cube.attrs[VERSION_ATTRIBUTE]} ({'; '.join(sorted(texts))})"


def _differences(
    a: xr.Dataset, b: xr.Dataset, one: Mapping[str, Any], two: Mapping[str, Any]
) -> list[tuple[str, Any, Any]]:
    varying = "period_factor" in a.coords, "period_factor" in b.coords
    found: list[tuple[str, Any, Any]] = [
        ("the list of axes", outer_dims(a), outer_dims(b)),
        ("the list of variables", scenario_variables(a), scenario_variables(b)),
        ("whether building properties vary, in kernels of their own,", *varying),
        *differing_sweeps(one, two),
    ]
    for key in sorted(AXIS_KEYS):
        found.append((f"whether {key!r} are given", one.get(key) is not None, two.get(key) is not None))
    for key in sorted({*shared(a), *shared(b)}):
        found.append((f"attribute {key!r}", plain(a.attrs.get(key)), plain(b.attrs.get(key))))
    for name in INNER_DIMS:
        here, there = (cube[name].values.tolist() if name in cube.dims else [] for cube in (a, b))
        found.append((f"the list of {name}s", here, there))
    motions = {record["name"]: record for record in two["records"]}
    for record in one["records"]:
        here, there = (list(motion_of(each)) for each in (record, motions.get(record["name"], record)))
        found.append((f"record {record['name']!r}", here, there))
    return [each for each in found if each[1] != each[2]]


def shared(cube: xr.Dataset) -> dict[str, Any]:
    """Global attributes of a cube in which all parts agree."""
    return {k: v for k, v in cube.attrs.items() if k not in OWN_ATTRIBUTES and not k.startswith(OWN_BEGINNINGS)}


def scenario_variables(cube: xr.Dataset) -> list[str]:
    """Variables of a cube that are not its audit's."""
    return [str(name) for name, array in cube.data_vars.items() if AUDIT_DIMS[0] not in array.dims]


def of_one_design(parts: Parts, sweeps: Sequence[Mapping[str, Any]]) -> dict[str, xr.Dataset]:
    """Return cubes without what designs say of their cases, where these were not drawn by one design."""
    designs = [sweep.get("design") or {} for sweep in sweeps]
    if all(design == designs[0] for design in designs):
        return dict(parts)
    names = {SAMPLE, BLOCK, *(each["name"] for design in designs for each in design.get("inputs", ()))} - {*KNOWN_BY}
    return {file: cube.drop_vars(names & {*cube.coords}) for file, cube in parts.items()}


def number_cases(
    parts: Parts, sweeps: Sequence[Mapping[str, Any]]
) -> tuple[dict[str, xr.Dataset], list[Any], list[dict[str, Any]]]:
    """Return cubes with each of their cases once, numbered over all cubes, and labels and descriptions of all cases."""
    labelled = any(cube[CASE].values.tolist() != list(range(1, cube.sizes[CASE] + 1)) for cube in parts.values())
    numbers: dict[bytes, int] = {}
    labels: dict[Any, tuple[bytes, str, int]] = {}
    described, result = [], {}
    for (file, cube), sweep in zip(parts.items(), sweeps, strict=True):
        # with what the law ignores, too: a case was listed with it, and is selected by it
        names = [name for name in (*([CASE] if labelled else []), *KNOWN_BY) if name in cube.coords]
        positions: dict[bytes, int] = {}
        for position, key in enumerate(scenario_keys({name: cube[name].values for name in names}).tolist()):
            if key in positions:  # a list may name a case in two spellings
                continue
            positions[key] = position
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
        chosen = cube.isel(case=list(positions.values()))
        result[file] = chosen.assign_coords({CASE: [numbers[key] for key in positions]})
    return result, list(labels) if labelled else list(range(1, len(numbers) + 1)), described


def case_name(coordinates: Mapping[Any, Any], position: int) -> str:
    """Say which scenario a listed case is, by those of its coordinates that have a value."""
    told = []
    for name in (name for name in KNOWN_BY if name in coordinates):
        values = list(dict.fromkeys(np.ravel(coordinates[name].values[position]).tolist()))
        if not any(isinstance(value, float) and math.isnan(value) for value in values):
            told.append(f"{name}={'/'.join(map(str, values))}")
    return " ".join(told)


def merge_values(what: str, parts: Sequence[Sequence[Any]]) -> list[Any]:
    """Return all values of an axis, each once: rising or falling if all parts are, else as they come."""
    values = list(dict.fromkeys(value for part in parts for value in part))
    if not all(isinstance(value, int | float) for value in values):
        return values
    rising = sorted(values)
    for a, b in pairwise(rising):
        near = abs(b - a) <= NEARLY * max(abs(a), abs(b))
        if near and not any(a in part and b in part for part in parts):  # a part with both means them apart
            raise InputError(
                f"{what} has the values {a!r} and {b!r}, the same but for rounding; run one part again with the other"
            )
    if all(a < b for part in parts for a, b in pairwise(part)):
        return rising
    return rising[::-1] if all(a > b for part in parts for a, b in pairwise(part)) else values


def merge_labels(parts: Parts, axes: Mapping[str, list[Any]]) -> dict[str, xr.Variable]:
    """Return the coordinates of all parts; missing (NaN, "") if no part has both values of two axes."""
    labels = [
        part.drop_vars(part.data_vars).drop_dims(AUDIT_DIMS, errors="ignore").reset_coords().reindex(axes)
        for part in parts.values()
    ]
    try:
        merged = xr.merge(labels, compat="no_conflicts", join="exact", combine_attrs="override")
    except xr.MergeError as error:
        raise InputError(
            f"the cubes are not of one study, or one was changed: {str(error).partition(' on objects')[0]} of the same "
            "place; run it again"
        ) from None
    result = {}
    for name, variable in merged.variables.items():
        dtype = next(part[name].dtype for part in parts.values() if name in part)
        if dtype.kind == "U":
            values = np.where(variable.notnull(), variable.values, "").astype(str)
        else:
            values = variable.values.astype(dtype if variable.notnull().all() else float)
        result[str(name)] = variable.copy(data=values)
    return result


def merge_attributes(
    parts: Parts, sweeps: Sequence[Mapping[str, Any]], n: int, cases: list[dict[str, Any]] | None
) -> dict[str, Any]:
    """Return what a cube says of its parts: what they share, the sweep of all, where each is from."""
    cubes = list(parts.values())
    whole = {**sweeps[0], "cases": cases}
    if any(sweep.get("design") != sweeps[0].get("design") for sweep in sweeps):
        whole.pop("design", None)
    for key in AXIS_KEYS:
        if whole.get(key) is not None:
            whole[key] = merge_values(key, [sweep[key] for sweep in sweeps])
    for key in BUILDING_AXES & whole.keys():
        each_building = zip(*(sweep[key] for sweep in sweeps), strict=True)
        whole[key] = [[alike[0][0], merge_values(key, [values for _, values in alike])] for alike in each_building]
    if laws := {key: law for sweep in sweeps for key, law in sweep.get(OWN_LAWS, {}).items()}:
        whole[OWN_LAWS] = laws
    records = {record["name"]: record for sweep in reversed(sweeps) for record in sweep["records"]}
    described = {record["name"]: record for cube in reversed(cubes) for record in json.loads(cube.attrs["records"])}
    names = merge_values("record", [[record["name"] for record in sweep["records"]] for sweep in sweeps])
    whole["records"] = [records[name] for name in names]
    left_out = merge_values("records_left_out", [sweep["records_left_out"] for sweep in sweeps])
    whole["records_left_out"] = [name for name in left_out if name not in records]
    text = json.dumps(whole, sort_keys=True, separators=(",", ":"), allow_nan=False)
    all_runs = runs({file: cube.attrs for file, cube in parts.items()})
    now = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}"
    attributes = shared(cubes[0]) | {
        **{key: cubes[0].attrs[key] for key in ("title",) if key in cubes[0].attrs},
        "records": json.dumps([described[name] for name in names], sort_keys=True),
        "sweep": text,
        "sweep_sha256": hashlib.sha256(text.encode()).hexdigest(),
        "scenarios_asked": n,
        **{key: sum(int(run.get(key, 0)) for run in all_runs) for key in ("scenarios_run", "scenarios_never_touching")},
        "history": f"{now} merged from {len(cubes)} cubes by pounding_sweep {package_version()} (see merged_from)",
        "merged_from": json.dumps(all_runs),
    }
    if "time_step" in cubes[0].attrs:
        steps = {
            record["name"]: step
            for sweep, cube in zip(sweeps, cubes, strict=True)
            for record, step in zip(sweep["records"], np.ravel(cube.attrs["time_step"]).tolist(), strict=True)
        }
        attributes["time_step"] = np.array([steps[name] for name in names])
    if "accuracy_choice" in cubes[0].attrs:
        attributes["accuracy_choice"] = " | ".join(dict.fromkeys(str(cube.attrs["accuracy_choice"]) for cube in cubes))
    if whole["records_left_out"]:
        attributes["records_left_out"] = json.dumps(whole["records_left_out"])
    all_makers = set().union(*(makers(cube.attrs) for cube in cubes))
    for key, values in zip(MAKER_ATTRIBUTES, zip(*all_makers, strict=True), strict=True):
        if len(set(values)) == 1 and values[0] is not None:
            attributes[key] = values[0]
    return attributes


def merge_audits(cube: CubeParts, parts: Parts) -> None:
    """Put the audits of all parts, one after another, into their cube; of each scenario the first one."""
    audited = {file: part for file, part in parts.items() if has_audit(part)}
    if not audited:
        return
    first = next(iter(audited.values()))
    names = {name for name, variable in first.variables.items() if {*AUDIT_DIMS} & {*variable.dims}}
    whole = xr.concat(
        [part.drop_vars({*part.variables} - names).reset_coords() for part in audited.values()],
        "audit",
        data_vars="minimal",
        coords="minimal",
        compat="override",
        join="override",
        combine_attrs="override",
    )
    known = [name for name in names & {*first.coords} if name not in AUDIT_DIMS]
    keys = scenario_keys({str(name): whole[name].transpose("audit", ...).values for name in known})
    whole = whole.isel(audit=np.sort(np.unique(keys, return_index=True)[1]))
    whole["audit"] = ("audit", np.arange(1, whole.sizes["audit"] + 1, dtype=np.int32), first["audit"].attrs)
    totals = [run for run in runs({file: p.attrs for file, p in audited.items()}) if "audit_touching" in run]
    touching = [int(run["audit_touching"]) for run in totals]
    add_audit(
        cube,
        {str(name): (tuple(map(str, v.dims)), v.values, v.attrs) for name, v in whole.variables.items()},
        sum(touching),
        float(np.average([float(run["audit_share"]) for run in totals], weights=touching)),
    )


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
        parts = {os.fspath(path): files.enter_context(open_cube(path)) for path in paths}
        merge = _Merge(parts, check_parts(parts, mix_sources=mix_sources), tolerance)
        check_space(target.parent, merge.n_bytes, f"the cube of {merge.result.scenarios:,} scenarios")
        blocks = {name: (*merge.block, *merge.inner[name]) for name in merge.names}
        merge.result.path = write_in_slabs(merge.cube, target, blocks, merge.slabs(), overwrite=overwrite)
    return merge.result


def _check_distinct(paths: Sequence[str | os.PathLike[str]]) -> None:
    """Raise `InputError` where two paths lead to one file: most likely another one was meant."""
    for first, path in itertools.combinations([os.fspath(path) for path in paths], 2):
        if os.path.exists(first) and os.path.exists(path) and os.path.samefile(first, path):
            twice = f"{path!r} is given twice" if first == path else f"{first!r} and {path!r} are the same file"
            raise InputError(f"{twice}; give each cube once")


class _Merge:
    """Parts on their way into one cube."""

    def __init__(self, parts: Parts, sweeps: list[dict[str, Any]], tolerance: float) -> None:
        base = next(iter(parts.values()))
        self.tolerance, self.names = tolerance, scenario_variables(base)
        self.parts, cases = of_one_design(parts, sweeps), None
        if CASE in base.dims:
            self.parts, case_labels, cases = number_cases(self.parts, sweeps)
            self.axes: dict[str, list[Any]] = {CASE: list(range(len(case_labels)))}
        else:
            along = {dim: [part[dim].values.tolist() for part in parts.values()] for dim in outer_dims(base)}
            self.axes = {dim: merge_values(dim, values) for dim, values in along.items()}
        self.labels = merge_labels(self.parts, self.axes)
        if cases is not None:
            self.labels[CASE] = xr.Variable(CASE, coordinate_values(case_labels), base[CASE].attrs)
        self.sizes = [len(values) for values in self.axes.values()]
        n = math.prod(self.sizes)
        self.inner = {name: [base.sizes[dim] for dim in VARIABLES[name].dims] for name in self.names}
        sizes = {name: np.dtype(VARIABLES[name].dtype).itemsize * math.prod(self.inner[name]) for name in self.names}
        self.n_bytes = n * sum(sizes.values())
        self.block = block_shape(self.sizes, BLOCK_BYTES // max(sizes.values()))
        self.slab = slab_shape(self.sizes, self.block, max(1, SLAB_BYTES // sum(sizes.values())))
        self.result = Merged(Path(), n, sources=len(set().union(*(makers(part.attrs) for part in parts.values()))))
        self.conflicts: list[str] = []
        self.n_conflicts = 0
        #: without its values, which would not fit into memory
        self.cube = CubeParts({}, {}, merge_attributes(parts, sweeps, n, cases))
        for name in self.names:
            values = unfilled(name, (*self.sizes, *self.inner[name]))
            attributes = {key: v for key, v in base[name].attrs.items() if not str(key).startswith("audit_")}
            dims = (*self.axes, *VARIABLES[name].dims)
            self.cube.data_vars[name] = (dims, values, attributes)
        for name, label in self.labels.items():
            self.cube.coords[name] = (tuple(map(str, label.dims)), label.values, label.attrs)
        merge_audits(self.cube, self.parts)

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
                self.result.overlapping += int(both.sum())
                if both.any():
                    self._compare(values, results, both, origin, file, slab)
                for name in self.names:
                    values[name][new] = results[name][new]
                origin[new] = index
            missing = np.argwhere(origin < 0)
            self.result.missing += len(missing)
            for position in missing[: max(0, NAMED - len(self.result.named))].tolist():
                self.result.named.append(self._name(position, slab))
            yield slab, values
        if self.conflicts:
            more = self.n_conflicts - len(self.conflicts)
            raise InputError(
                f"parts have different results of {self.n_conflicts} scenarios: {'; '.join(self.conflicts)}"
                f"{f'; and {more} more' if more else ''}. Leave one of the parts out, or allow a larger tolerance"
            )

    def _read(self, file: str, labels: Mapping[str, list[Any]]) -> dict[str, np.ndarray] | None:
        """Return what a part has of a slab, as it is stored and missing elsewhere; None if it has nothing of it."""
        part = self.parts[file][self.names].reset_coords(drop=True)
        chosen = {dim: np.flatnonzero(part.indexes[dim].isin(values)) for dim, values in labels.items()}
        if not all(map(len, chosen.values())):
            return None
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
            scenarios = differs.any(axis=inner) & both & ~noted
            noted |= scenarios
            self.n_conflicts += int(scenarios.sum())
            for position in np.argwhere(scenarios)[: NAMED - len(self.conflicts)].tolist():
                place = tuple(position)
                spot = np.unravel_index(np.argmax(differs[place]), differs[place].shape)
                one, two = (each[place][spot].item() for each in (a, b))
                other = list(self.parts)[int(origin[place])]
                name_of = self._name(position, slab)
                self.conflicts.append(f"{name_of}: {name} {one!r} in {other!r}, {two!r} in {file!r}")

    def _name(self, position: Sequence[int], slab: tuple[slice, ...]) -> str:
        """Return the values of the axes that have several, and what a listed case is."""
        places = [i + part.start for i, part in zip(position, slab, strict=True)]
        texts = [
            f"{axis}={self.labels[axis].values[i].item()}"
            for (axis, values), i in zip(self.axes.items(), places, strict=True)
            if len(values) > 1
        ]
        if CASE in self.axes:
            texts.append(case_name(self.labels, places[0]))
        return " ".join(texts) or "the scenario"
