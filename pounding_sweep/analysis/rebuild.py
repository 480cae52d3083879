"""From a cube back to what it was made of: the row, the records, and the runs without pounding.

A cube carries its sweep as JSON (attribute ``sweep``), in which records stand by name and digest only: their motions
must be found again, and are taken only where the digest agrees. Runs without pounding are the planner's own, by which
scenarios that never touch are left out of sweeps: the law "none" with the output ``closing_max``.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.scenarios import (
    IGNORED,
    NO_POUNDING,
    law_keys,
    present,
    uncoupled_cases,
    without_pounding,
)
from pounding_sweep.base.errors import InputError, RecordError
from pounding_sweep.model.scene import CONTACTS, Scene
from pounding_sweep.outputs.variables import INNER_DIMS
from pounding_sweep.records import RECORD_SETS, Record, find_record, list_records, resolve_records
from pounding_sweep.records.catalogue import read_component, set_components
from pounding_sweep.records.synthetic import remade
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.spec.axes import AXES, axes_of, case_of
from pounding_sweep.spec.spec import scene_of

#: Records that an error names.
_NAMED = 3
#: What is read of a stored sweep.
_KEYS = {"scene", "records", "cases", *(name for name, axis in AXES.items() if not axis.unsaid)}
#: What a run without pounding must report.
OUTPUTS = ("displacement_max", "displacement_min", "closing_max")
#: Step (s) of the exact scheme, whose free flight has no error: peaks are looked for inside it.
STEP = 1e-3


def stored_sweep(cube: xr.Dataset) -> dict[str, Any]:
    """Return a cube's sweep as it is stored."""
    try:
        sweep: dict[str, Any] = json.loads(cube.attrs["sweep"])
        lacking = sorted(_KEYS - set(sweep))
    except (KeyError, TypeError, ValueError):
        raise InputError(
            "this cube does not carry its sweep (attribute 'sweep'), from which the row of buildings would be known; "
            "give a cube as 'pounding-sweep run' wrote it"
        ) from None
    if lacking:
        raise InputError(
            f"the sweep that this cube carries (attribute 'sweep') lacks {', '.join(lacking)}: the cube was made by "
            "another version of this package, or changed; run the sweep again"
        )
    return sweep


def stored_scene(one: xr.Dataset) -> Scene:
    """Return the row of a scenario with its histories."""
    try:
        return scene_of(json.loads(one.attrs["scene"]))
    except (AttributeError, KeyError, TypeError, ValueError):
        raise InputError(
            "this file does not carry its row of buildings (attribute 'scene'), from which the walls beside it would "
            "be known: it was made by another version of this package, or changed; simulate the scenario again"
        ) from None


def records_of(
    sweep: Mapping[str, Any],
    given: Iterable[Record] = (),
    folders: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | None = None,
) -> list[Record]:
    """Find the records of a stored sweep again."""
    offered = {record.sha256: record for record in given}
    at_hand = cache(lambda: [record for _, record in list_records(folders) if isinstance(record, Record)])
    records, missing = [], []
    for entry in sweep["records"]:
        record = offered.get(entry["sha256"]) or _by_name(entry, folders, at_hand)
        if isinstance(record, Record):
            records.append(record.renamed(entry["name"]))
        else:
            missing.append(f"{entry['name']!r} ({record})")
    if missing:
        more = f" and {len(missing) - _NAMED} more" if len(missing) > _NAMED else ""
        raise InputError(
            f"{len(missing)} of the {len(sweep['records'])} records of this cube's sweep can't be found again: "
            f"{', '.join(missing[:_NAMED])}{more}; give the folder of their files, or the records themselves"
        )
    return records


def _by_name(entry: Mapping[str, Any], folders: Any, at_hand: Callable[[], list[Record]]) -> Record | str:
    """Return the record of that name and digest, as found or scaled as the sweep says; or why there is none."""
    name, scale = entry["name"], entry["scale"]
    record = remade(entry["source"], entry["n_points"])
    if record is None:
        with suppress(RecordError):
            record = find_record(name, folders)
    for key in RECORD_SETS if record is None else ():
        with suppress(RecordError):
            if not key.endswith("_normalized") and name in set_components(key):
                record = read_component(key, name)
                break

    def candidates() -> Iterator[Record]:
        yield from [record] if record is not None else []
        yield from (other for other in at_hand() if (other.dt, other.n_points) == (entry["dt"], entry["n_points"]))

    for candidate in candidates():  # a record may have been renamed
        for same in (candidate, candidate.scaled(scale / candidate.scale) if candidate.scale else candidate):
            if same.sha256 == entry["sha256"]:
                return same
    return "the record found by that name is another motion" if record is not None else "none of that name or motion"


#: A row, in which floors meet columns too, and its runs without pounding: `OUTPUTS` on ``record``, and on ``scale``,
#: building properties or ``case``, with first periods (s) and damping ratios as coordinates along ``building``.
UncoupledRuns = tuple[Scene, xr.Dataset]


def runs_of_row(scene: Scene | str, records: Any, folders: Any) -> UncoupledRuns:
    """Run a row without pounding, once for each record."""
    spec = Sweep(scene, records, NO_POUNDING, folders=folders).spec
    scene, cube = _run(spec.scene, spec.records)
    return scene, _reduced(scene, cube).isel(scale=0, drop=True)


def runs_of_cube(cube: xr.Dataset, records: Any, folders: Any) -> UncoupledRuns:
    """Return the runs without pounding that belong to a cube; see `required_gap`."""
    sweep = stored_sweep(cube)
    scene = scene_of(sweep["scene"])
    row: dict[str, list[Any]] = {"building": [building.name for building in scene.buildings]}
    row |= {"pair": list(scene.pair_labels), "storey": list(range(1, scene.n_storeys + 1))}
    # a part of the row is no row
    whole = all(dim in cube.dims and sorted(cube[dim].values.tolist()) == sorted(row[dim]) for dim in row)
    cube = cube.sel(row) if whole else cube  # in the row's order, which a user may have changed
    stored = whole and NO_POUNDING in law_keys(cube) and len(present(cube, OUTPUTS)) == len(OUTPUTS)
    if sweep["cases"] is not None:
        stored = stored and min(uncoupled_cases(cube)) >= 0
    runs = cube
    if not stored or _with_columns(scene) is not scene:
        try:
            motions = records_of(sweep, resolve_records(records, folders), folders)
        except InputError as error:
            raise InputError(
                f"{error}; or run the sweep with the law {NO_POUNDING!r} and the outputs {', '.join(OUTPUTS)}"
            ) from None
        scene, runs = _run(scene, motions, **_axes(sweep))
    if sweep["cases"] is not None:
        uncoupled = runs.isel(case=np.flatnonzero(runs["law"].values.astype(str) == NO_POUNDING))
        return scene, uncoupled.assign_coords(_first_modes(scene, uncoupled))
    runs = _reduced(scene, runs)  # to what belongs to a cube, which may be a selection from what its sweep has
    at = {dim: cube[dim].values for dim in runs.dims if dim in cube.coords and dim not in INNER_DIMS}
    return scene, runs.sel(at)


def _with_columns(scene: Scene) -> Scene:
    """Return a row in which floors meet columns too."""
    if not scene.pair_names:
        raise InputError(
            "the required gap needs a pair of neighbours, and this row is a single building; add a wall or a building"
        )
    row = replace(scene, contacts=CONTACTS[1])
    return scene if row == scene else row


def _run(scene: Scene, records: Sequence[Record], **axes: Any) -> UncoupledRuns:
    """Run a row without pounding, by the exact scheme where all is elastic."""
    scene = _with_columns(scene)
    method = "rk4" if any(scene.yields) or SCHEMES["exact"].refuses(scene) else "exact"
    axes = axes if "cases" in axes else {"laws": NO_POUNDING, **axes}
    sweep = Sweep(scene, records, outputs=list(OUTPUTS), method=method, dt=STEP, audit=0.0, **axes)
    return scene, sweep.run()


def _reduced(scene: Scene, cube: xr.Dataset) -> xr.Dataset:
    """Return the runs without pounding of a product without the axes that they ignore."""
    uncoupled = without_pounding(cube, "the required gap")
    ignored = {dim: 0 for dim in IGNORED if dim in uncoupled.dims}
    return uncoupled.isel(ignored).reset_coords(drop=True).assign_coords(_first_modes(scene, cube))


def _first_modes(scene: Scene, cube: xr.Dataset) -> dict[str, xr.DataArray]:
    """Return coordinates of a cube: first periods and damping ratios of its buildings, by default those of the row."""
    names = [building.name for building in scene.buildings]
    of_row = {"fundamental_period": [float(b.periods[0]) for b in scene.buildings]}
    of_row["first_damping_ratio"] = [b.first_damping for b in scene.buildings]
    return {
        name: cube.coords.get(name, xr.DataArray(values, {"building": names}, ("building",))).reset_coords(drop=True)
        for name, values in of_row.items()
    }


def _axes(sweep: Mapping[str, Any]) -> dict[str, Any]:
    """Return the axes of a stored sweep that a run without pounding does not ignore, or its cases but for those."""
    parameters = {axis.parameter: sweep[axis.parameter] for axis in AXES.values() if axis.parameter in sweep}
    if sweep["cases"] is not None:
        ignored: dict[str, Any] = dict.fromkeys(IGNORED)
        cases = [replace(case_of(case), law=NO_POUNDING, **ignored) for case in sweep["cases"]]
        return {"cases": list(dict.fromkeys(cases)), **parameters}
    values = axes_of(sweep)
    axes = {name: getattr(values, name) for name, axis in AXES.items() if axis.of_buildings or axis.column == "scale"}
    axes = {name: dict(value) if AXES[name].by_building else value for name, value in axes.items() if value}
    return axes | parameters
