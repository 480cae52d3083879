"""Cubes of one study, from several machines or days, put together along their axes or their listed cases."""

from __future__ import annotations

import hashlib
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

from pounding_sweep.base.errors import InputError
from pounding_sweep.base.files import FilePath
from pounding_sweep.output import dataset, identity
from pounding_sweep.output.audited import AUDIT_DIMS, add_audit, has_audit
from pounding_sweep.output.dataset import CubeParts, as_stored, coordinate_values, package_version, unfilled
from pounding_sweep.output.netcdf import Slab, check_output, check_space, open_cube, reading, write_in_slabs
from pounding_sweep.output.results import number_runs
from pounding_sweep.output.scenario_rows import cube_columns, scenario_keys
from pounding_sweep.request.axes import BUILDING_DEFAULTS
from pounding_sweep.request.design import BLOCK, SAMPLE
from pounding_sweep.variables.registry import INNER_DIMS, NEVER_TOUCHES, NOT_RUN, VARIABLES, Status

#: Cubes by the name of their file.
Parts = Mapping[str, "xr.Dataset"]
#: Descriptions of sweeps, in the order of the cubes that they made.
Sweeps = Sequence[Mapping[str, Any]]
#: Dimension of listed scenarios.
CASE = "case"
#: What tells listed cases apart, what their law ignores too: a case is selected by it.
CASE_COORDINATES = (
    *("law", "record", "scale", "restitution", "contact_stiffness", "pair_gap", "pair_restitution"),
    *BUILDING_DEFAULTS,
)
#: Global attributes that say how a part came to be, or are made anew, and how others of them begin.
PART_ATTRIBUTES = frozenset(
    {
        *("history", "title", "records", "records_left_out", "sweep", "sweep_sha256", "time_step"),
        *("accuracy_choice", "accuracy_numbers", *identity.MAKER_ATTRIBUTES, *identity.ORIGINS),
    }
)
PART_PREFIXES = ("scenarios_", "audit_")
#: Attributes that an accuracy chooses.
CHOSEN = ("method", "precision")
#: Variables that follow from all parts.
_OF_CUBE = ("origin", "run")
#: What else helps where parts were made by two sources.
MIX_REMEDY = (
    "Where you know that what changed between sources or libraries of one version touches no result, allow both: "
    "mix_sources=True, on the command line --mix-sources; the cube names the source of each"
)
#: Scenarios, missing or in conflict, that are named.
NAMED = 5
#: Relative difference between two results of the same scenario that is no conflict.
TOLERANCE = 1e-6


@dataclass
class Merged:
    """What a merge found."""

    path: Path  #: the cube of all parts
    scenarios: int  #: of it: every combination of the values on its axes, or all listed cases
    overlapping: int = 0  #: scenarios that several parts have a result of
    missing: int = 0  #: scenarios that no part has a result of; their status is not_run
    named: list[str] = field(default_factory=list)  #: the first of the missing, by what they differ in from others
    #: states of the package's source that made the parts, each with other versions of the libraries counted apart
    sources: int = 1


def merge_cubes(
    paths: Sequence[FilePath],
    out: FilePath,
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
    No more than a slab of the cube is in memory at a time. Of identical results the first part's is taken. Counts are
    sums over the runs that made the parts, each once. The cube has each case once, in the order given, numbered anew
    unless a user gave them labels.

    Examples
    --------
    >>> import tempfile
    >>> import pounding_sweep as ps
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for gap in (0.01, 0.02):
    ...         ps.Sweep("mate2015", "el_centro", "linear", gaps=gap).run(f"{folder}/{gap}.nc").close()
    ...     merge_cubes([f"{folder}/0.01.nc", f"{folder}/0.02.nc"], f"{folder}/both.nc").scenarios
    2
    """
    if len(paths) < 2 or not math.isfinite(tolerance) or tolerance < 0:
        raise InputError(f"merging takes at least two cubes and a tolerance >= 0, not {len(paths)} and {tolerance!r}")
    real = [os.path.realpath(path) for path in paths]
    if twice := [path for path in real if real.count(path) > 1]:
        raise InputError(f"{twice[0]!r} is given twice; give each cube once")
    target = check_output(out, overwrite)
    with ExitStack() as files:
        parts: Parts = {os.fspath(path): files.enter_context(open_cube(path)) for path in paths}
        sweeps = check_parts(parts, mix_sources=mix_sources)
        sources = set().union(*(identity.makers(part.attrs) for part in parts.values()))
        base, cases = next(iter(parts.values())), None
        if CASE in base.dims:
            designs = [sweep.get("design") or {} for sweep in sweeps]
            if any(design != designs[0] for design in designs):  # then what they say of their cases tells no more
                drawn = {SAMPLE, BLOCK, *(item["name"] for design in designs for item in design.get("inputs", ()))}
                drawn -= {*CASE_COORDINATES}
                parts = {file: cube.drop_vars(drawn, errors="ignore") for file, cube in parts.items()}
            parts, case_labels, cases = _number_cases(parts, sweeps)
            axes: dict[str, list[Any]] = {CASE: list(range(len(case_labels)))}
        else:
            axes = {
                str(dim): merge_values(str(dim), [part[dim].values.tolist() for part in parts.values()])
                for dim in base["status"].dims
            }
        labels = _merge_labels(parts, axes)
        if cases is not None:
            labels[CASE] = xr.Variable(CASE, coordinate_values(case_labels), base[CASE].attrs)
        sizes = [len(values) for values in axes.values()]
        result = Merged(target, math.prod(sizes), sources=len(sources))
        cube = CubeParts({}, {}, _merge_attributes(parts, sweeps, result.scenarios, cases))
        for name in scenario_variables(base):
            dims, about = VARIABLES[name].dims, base[name].attrs
            values = unfilled(name, (*sizes, *(base.sizes[dim] for dim in dims)))
            attributes = {key: value for key, value in about.items() if not str(key).startswith("audit_")}
            cube.data_vars[name] = ((*axes, *dims), values, attributes)
        for name, label in labels.items():
            cube.coords[name] = (tuple(map(str, label.dims)), label.values, label.attrs)
        n_bytes = sum(values.nbytes for _, values, _ in cube.data_vars.values())
        check_space(target.parent, n_bytes, f"the cube of {result.scenarios:,} scenarios")
        _merge_audits(cube, parts)
        everything = tuple(slice(0, size) for size in sizes)
        runs = _merge_slab(_with_equal_runs(parts, sweeps), axes, labels, tolerance, Merged(target, 0), everything)
        origin, run = number_runs(runs["origin"], runs["run"])
        parts = {file: part.drop_vars(_OF_CUBE) for file, part in parts.items()}

        def values_of(slab: Slab) -> dict[str, np.ndarray]:
            values = _merge_slab(parts, axes, labels, tolerance, result, slab)
            return values | {"origin": origin[slab], "run": run[slab]}

        write_in_slabs(cube, target, values_of, overwrite=overwrite)
    return result


def scenario_variables(cube: xr.Dataset) -> list[str]:
    """Variables of a cube that are not its audit's."""
    return [str(name) for name, array in cube.data_vars.items() if AUDIT_DIMS[0] not in array.dims]


def check_parts(parts: Parts, *, mix_sources: bool) -> list[dict[str, Any]]:
    """Return the sweeps of cubes of one study; raises `InputError` where they are of several."""
    for name, cube in parts.items():
        if "status" not in cube.data_vars or "sweep" not in cube.attrs:
            raise InputError(
                f"{name!r} is no cube of a sweep: it has no status, or no attribute 'sweep'; give cubes made by 'run'"
            )
    sweeps = [identity.recorded_sweep(name, cube) for name, cube in parts.items()]
    (first, base), *_ = parts.items()
    for (name, cube), sweep in zip(parts.items(), sweeps, strict=True):
        one, two = identity.made_by(base.attrs), identity.made_by(cube.attrs)
        pairs = [(key, one[key], two[key]) for key in ([dataset.VERSION_ATTRIBUTE] if mix_sources else one)]
        identity.check_one_study(repr(first), repr(name), pairs, f"{identity.MAKERS_REMEDY}. {MIX_REMEDY}")
        remedy = "Run one of them again with the other's"
        identity.check_one_study(repr(first), repr(name), _differences(base, cube, sweeps[0], sweep), remedy)
        for key in ("law", "record") if CASE in cube.dims else ():
            if cube[key].values.tolist() != [case[key] for case in sweep["cases"]]:
                raise InputError(f"{name!r} has other cases than its sweep; give the cube as it was made")
    return sweeps


def _differences(
    a: xr.Dataset, b: xr.Dataset, one: Mapping[str, Any], two: Mapping[str, Any]
) -> Iterator[tuple[str, Any, Any]]:
    """Compare two cubes and their sweeps in all that parts of one study share."""
    yield "the list of axes", [*a["status"].dims], [*b["status"].dims]
    yield "the list of variables", scenario_variables(a), scenario_variables(b)
    varying = "period_factor" in a.coords, "period_factor" in b.coords
    yield "whether building properties vary, in kernels of their own,", *varying
    yield from identity.differing_sweeps(one, two)
    for key in sorted(identity.AXIS_KEYS):
        yield f"whether {key!r} are given", one.get(key) is not None, two.get(key) is not None
    for key in sorted({*_shared(a), *_shared(b)}):
        yield f"attribute {key!r}", identity.plain(a.attrs.get(key)), identity.plain(b.attrs.get(key))
    for name in INNER_DIMS:
        yield f"the list of {name}s", *(cube[name].values.tolist() if name in cube.dims else [] for cube in (a, b))
    motions = identity.motions_of(two)
    for name, motion in identity.motions_of(one).items():
        yield f"record {name!r}", motion, motions.get(name, motion)


def _shared(cube: xr.Dataset) -> dict[str, Any]:
    """Return the global attributes in which all parts agree; for an accuracy each chose its scheme."""
    of_part = {*PART_ATTRIBUTES, *(CHOSEN if "accuracy" in cube.attrs else ())}
    return {k: v for k, v in cube.attrs.items() if k not in of_part and not k.startswith(PART_PREFIXES)}


def _number_cases(parts: Parts, sweeps: Sweeps) -> tuple[Parts, list[Any], list[dict[str, Any]]]:
    """Return cubes with each case once, numbered over all cubes, and labels and descriptions of all cases."""
    labelled = any(cube[CASE].values.tolist() != list(range(1, cube.sizes[CASE] + 1)) for cube in parts.values())
    numbers: dict[bytes, int] = {}
    labels: dict[Any, tuple[bytes, str, int]] = {}
    described, result = [], {}
    for (file, cube), sweep in zip(parts.items(), sweeps, strict=True):
        names = [name for name in (*([CASE] if labelled else []), *CASE_COORDINATES) if name in cube.coords]
        keys = scenario_keys({name: cube[name].values for name in names}).tolist()
        for i, (key, label) in enumerate(zip(keys, cube[CASE].values.tolist(), strict=True)):
            if key not in numbers:
                numbers[key] = len(numbers)
                described.append(sweep["cases"][i])
            other_key, other, j = labels.setdefault(label, (key, file, i))
            if labelled and other_key != key:
                one, two = _case_name(parts[other].coords, j), _case_name(cube.coords, i)
                raise InputError(
                    f"case {label!r} is {one} in {other!r}, and {two} in {file!r}; give one of them another label"
                )
        # a list may name a case in two spellings
        result[file] = cube.assign_coords({CASE: [numbers[key] for key in keys]}).drop_duplicates(CASE)
    return result, list(labels) if labelled else list(range(1, len(numbers) + 1)), described


def _case_name(coordinates: Mapping[Any, Any], position: int) -> str:
    """Say which scenario a listed case is, by those of its coordinates that have a value."""
    texts = []
    for name in (name for name in CASE_COORDINATES if name in coordinates):
        values = list(dict.fromkeys(np.ravel(coordinates[name].values[position]).tolist()))
        if not any(isinstance(value, float) and math.isnan(value) for value in values):
            texts.append(f"{name}={'/'.join(map(str, values))}")
    return " ".join(texts)


def merge_values(what: str, parts: Sequence[Sequence[Any]]) -> list[Any]:
    """Return all values of an axis, each once: rising or falling if all parts are, else as they come."""
    values = list(dict.fromkeys(value for part in parts for value in part))
    if not all(isinstance(value, int | float) for value in values):
        return values
    rising = sorted(values)
    for a, b in pairwise(rising):
        near = abs(b - a) <= 1e-9 * max(abs(a), abs(b))
        if near and not any(a in part and b in part for part in parts):  # a part with both means them apart
            raise InputError(
                f"{what} has the values {a!r} and {b!r}, the same but for rounding; run one part again with the other"
            )
    if all(a < b for part in parts for a, b in pairwise(part)):
        return rising
    return rising[::-1] if all(a > b for part in parts for a, b in pairwise(part)) else values


def _merge_labels(parts: Parts, axes: Mapping[str, list[Any]]) -> dict[str, xr.Variable]:
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


def _merge_sweeps(sweeps: Sweeps, cases: list[dict[str, Any]] | None) -> dict[str, Any]:
    """Return the description of the sweep that asks for what all ask for."""
    merged = {**sweeps[0], "cases": cases}
    if any(sweep.get("design") != sweeps[0].get("design") for sweep in sweeps):
        merged.pop("design", None)
    for key in identity.AXIS_KEYS:
        if merged.get(key) is not None:
            merged[key] = merge_values(key, [sweep[key] for sweep in sweeps])
    for key in identity.NAMED_AXES & merged.keys():
        by_name = zip(*(sweep[key] for sweep in sweeps), strict=True)
        merged[key] = [[axes[0][0], merge_values(key, [values for _, values in axes])] for axes in by_name]
    if laws := {key: law for sweep in sweeps for key, law in sweep.get(identity.CUSTOM_LAWS, {}).items()}:
        merged[identity.CUSTOM_LAWS] = laws
    records = {record["name"]: record for sweep in reversed(sweeps) for record in sweep["records"]}
    names = dict.fromkeys(record["name"] for sweep in sweeps for record in sweep["records"])
    merged["records"] = [records[name] for name in names]
    left_out = dict.fromkeys(name for sweep in sweeps for name in sweep["records_left_out"])
    merged["records_left_out"] = [name for name in left_out if name not in records]
    return merged


def _merge_attributes(parts: Parts, sweeps: Sweeps, n: int, cases: list[dict[str, Any]] | None) -> dict[str, Any]:
    """Return what a cube says of its parts: what they share, the sweep of all, where each is from."""
    cubes = list(parts.values())
    merged, base = _merge_sweeps(sweeps, cases), cubes[0].attrs
    names = [record["name"] for record in merged["records"]]
    text = json.dumps(merged, sort_keys=True, separators=(",", ":"), allow_nan=False)
    described = {record["name"]: record for cube in reversed(cubes) for record in json.loads(cube.attrs["records"])}
    all_runs = identity.runs({file: cube.attrs for file, cube in parts.items()})
    now = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}"
    attributes = _shared(cubes[0]) | {
        **{key: base[key] for key in ("title",) if key in base},
        "records": json.dumps([described[name] for name in names], sort_keys=True),
        "sweep": text,
        "sweep_sha256": hashlib.sha256(text.encode()).hexdigest(),
        "scenarios_asked": n,
        **{key: sum(int(run.get(key, 0)) for run in all_runs) for key in ("scenarios_run", "scenarios_never_touching")},
        "history": f"{now} merged from {len(cubes)} cubes by pounding_sweep {package_version()} (see merged_from)",
        "merged_from": json.dumps(all_runs),
    }
    if "time_step" in base:
        steps: dict[str, float] = {}
        for sweep, cube in zip(sweeps, cubes, strict=True):
            steps |= dict(zip(identity.motions_of(sweep), np.ravel(cube.attrs["time_step"]).tolist(), strict=True))
        attributes["time_step"] = np.array([steps[name] for name in names])
    for key in (key for key in (*CHOSEN, "accuracy_choice") if key in base):
        attributes[key] = " | ".join(dict.fromkeys(str(cube.attrs[key]) for cube in cubes))
    if merged["records_left_out"]:
        attributes["records_left_out"] = json.dumps(merged["records_left_out"])
    all_makers = set().union(*(identity.makers(cube.attrs) for cube in cubes))
    for key, values in zip(identity.MAKER_ATTRIBUTES, zip(*all_makers, strict=True), strict=True):
        if len(set(values)) == 1 and values[0] is not None:
            attributes[key] = values[0]
    return attributes


def _merge_audits(cube: CubeParts, parts: Parts) -> None:
    """Put the audits of all parts, one after another, into their cube; of each scenario the first one."""
    audited = {file: part for file, part in parts.items() if has_audit(part)}
    if not audited:
        return
    first = next(iter(audited.values()))
    names = {name for name, variable in first.variables.items() if {*AUDIT_DIMS} & {*variable.dims}}
    audits = [part.drop_vars({*part.variables} - names).reset_coords() for part in audited.values()]
    merged = xr.concat(
        audits, "audit", data_vars="minimal", coords="minimal", compat="override", join="override",
        combine_attrs="override",
    )  # fmt: skip
    coords = [name for name in names & {*first.coords} if name not in AUDIT_DIMS]
    keys = scenario_keys({str(name): merged[name].transpose("audit", ...).values for name in coords})
    merged = merged.isel(audit=np.sort(np.unique(keys, return_index=True)[1]))
    merged["audit"] = ("audit", np.arange(1, merged.sizes["audit"] + 1, dtype=np.int32), first["audit"].attrs)
    totals = [run for run in identity.runs({file: p.attrs for file, p in audited.items()}) if "audit_touching" in run]
    touching = [int(run["audit_touching"]) for run in totals]
    add_audit(
        cube,
        {str(name): (tuple(map(str, v.dims)), v.values, v.attrs) for name, v in merged.variables.items()},
        sum(touching),
        float(np.average([float(run["audit_share"]) for run in totals], weights=touching)),
        " or ".join(dict.fromkeys(str(part.attrs["audit_reference"]) for part in audited.values())),
    )


def _merge_slab(
    parts: Parts,
    axes: Mapping[str, list[Any]],
    labels: Mapping[str, xr.Variable],
    tolerance: float,
    result: Merged,
    slab: Slab,
) -> dict[str, np.ndarray]:
    """Return the values of all parts in a slab as they are stored; raises `InputError` if some are in conflict."""
    files, conflicts, n_conflicts = list(parts), list[str](), 0
    along = {dim: values[part] for (dim, values), part in zip(axes.items(), slab, strict=True)}

    def name_of(position: Sequence[int]) -> str:
        """Return the values of the axes that have several, and what a listed case is."""
        at = {dim: i + part.start for dim, i, part in zip(axes, position, slab, strict=True)}
        texts = [f"{dim}={labels[dim].values[i].item()}" for dim, i in at.items() if len(axes[dim]) > 1]
        texts += [_case_name(labels, at[CASE])] if CASE in at else []
        return " ".join(texts) or "the scenario"

    values = _read_part(files[0], parts[files[0]], along)
    origin = np.where(values["status"] != Status.NOT_RUN, 0, -1)  # the part that each result is from
    for index, file in enumerate(files[1:], 1):
        read = _read_part(file, parts[file], along)
        has_result = read["status"] != Status.NOT_RUN
        new, overlap = has_result & (origin < 0), has_result & (origin >= 0)
        result.overlapping += int(overlap.sum())
        in_conflict = np.zeros(overlap.shape, bool)
        for name in (name for name in values if overlap.any() and not VARIABLES[name].of_cube):
            differs = _differ(name, values[name], read[name], overlap.ndim, tolerance)
            scenarios = differs.any(axis=tuple(range(overlap.ndim, differs.ndim))) & overlap & ~in_conflict
            in_conflict |= scenarios
            n_conflicts += int(scenarios.sum())
            for place in map(tuple, np.argwhere(scenarios)[: NAMED - len(conflicts)].tolist()):
                spot = (*place, *np.argwhere(differs[place])[0])
                one, two = (f"{array[name][spot].item()!r}" for array in (values, read))
                conflicts.append(f"{name_of(place)}: {name} {one} in {files[origin[place]]!r}, {two} in {file!r}")
        for name in values:
            values[name][new] = read[name][new]
        origin[new] = index
    if conflicts:
        more = f"; and {n_conflicts - len(conflicts)} more" if n_conflicts > len(conflicts) else ""
        raise InputError(
            f"parts have different results of {n_conflicts} scenarios or more: {'; '.join(conflicts)}{more}. "
            "Leave one of the parts out, or allow a larger tolerance"
        )
    missing = np.argwhere(origin < 0)
    result.missing += len(missing)
    result.named += map(name_of, missing[: NAMED - len(result.named)].tolist())
    return values


def _with_equal_runs(parts: Parts, sweeps: Sweeps) -> Parts:
    """Return status, ``origin`` and ``run`` of cubes, with one number for equal runs of all of them."""
    result, keys = dict[str, xr.Dataset](), list[np.ndarray]()
    for (file, part), sweep in zip(parts.items(), sweeps, strict=True):
        with reading(file):
            cube = part.drop_vars({*part.data_vars} - {"status", *_OF_CUBE}).load()
        _, first, number = np.unique(cube["run"], return_index=True, return_inverse=True)
        places = zip(cube["run"].dims, np.unravel_index(first, cube["run"].shape), strict=True)
        one = cube.isel({dim: ("each", place) for dim, place in places})
        law = one["law"].where(one["origin"] != NEVER_TOUCHES, "none")
        result[file] = cube.assign(run=cube["run"].copy(data=number.reshape(cube["run"].shape) + sum(map(len, keys))))
        keys.append(scenario_keys(cube_columns(one.assign_coords(law=law), sweep, ["each"])))
    numbers = np.unique(np.concatenate(keys), return_inverse=True)[1].astype(np.int32)
    return {file: cube.assign(run=cube["run"].copy(data=numbers[cube["run"]])) for file, cube in result.items()}


def _read_part(file: str, part: xr.Dataset, along: Mapping[str, list[Any]]) -> dict[str, np.ndarray]:
    """Return what a part has at values of the axes, as it is stored; what it has not as not run."""
    names = scenario_variables(part)
    chosen = {dim: np.flatnonzero(part.indexes[dim].isin(values)) for dim, values in along.items()}
    with reading(file):
        read = part[names].reset_coords(drop=True).isel(chosen).load()
    missing = {"status": int(Status.NOT_RUN), "origin": NOT_RUN}
    missing = {name: missing.get(name, 0) for name in names if VARIABLES[name].fill is None}
    read = read.reindex(along, fill_value=missing)
    dims = {name: (*along, *VARIABLES[name].dims) for name in names}
    return {name: np.array(as_stored(name, read[name].transpose(*dims[name]).values)) for name in names}


def _differ(name: str, a: np.ndarray, b: np.ndarray, n_outer: int, tolerance: float) -> np.ndarray:
    """Return where two results of a variable differ by more than the tolerance allows."""
    differs = a != b
    if VARIABLES[name].dtype == "f8":
        # of ratios, such as the residual of the energies, 1 is the whole
        least = 1.0 if VARIABLES[name].units == "1" else 0.0
        inner, largest = tuple(range(n_outer, a.ndim)), np.fmax(np.abs(a), np.abs(b))
        scale = np.fmax.reduce(largest, axis=inner, keepdims=True, initial=least)
        with np.errstate(invalid="ignore"):
            differs &= ~(np.isnan(a) & np.isnan(b)) & ~(np.abs(a - b) <= tolerance * scale)
    return differs
