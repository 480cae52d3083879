"""From a cube back to what it was made of: the row, the records with their intensities, the runs without pounding.

A cube carries its sweep as JSON (attribute ``sweep``), in which records stand by name and digest only: their motions
must be found again, and are taken only where the digest agrees. Runs without pounding are the planner's own, by which
scenarios that never touch are left out of sweeps: the law "none" with the output ``closing_max``.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.scenarios import (
    IGNORED,
    NO_POUNDING,
    described,
    labelled,
    law_keys,
    uncoupled_cases,
    without_pounding,
)
from pounding_sweep.analysis.spectra import response_spectrum
from pounding_sweep.base.errors import InputError, RecordError
from pounding_sweep.model.scene import CONTACTS, Scene
from pounding_sweep.outputs.variables import INNER_DIMS
from pounding_sweep.records import RECORD_SETS, Record, find_record, record_measures, resolve_records
from pounding_sweep.records.synthetic import remade
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.spec.axes import AXES, axes_of, case_of, plain_name
from pounding_sweep.spec.spec import scene_of

#: Records that an error names.
_NAMED = 3
#: What a run without pounding must report.
OUTPUTS = ("displacement_max", "displacement_min", "closing_max")
#: Step (s) of the exact scheme, whose free flight has no error: peaks are looked for inside it.
STEP = 1e-3


def stored_sweep(cube: xr.Dataset) -> dict[str, Any]:
    """Return a cube's sweep as it is stored."""
    try:
        return dict(json.loads(cube.attrs["sweep"]))
    except (KeyError, ValueError):
        raise InputError(
            "this cube does not carry its sweep (attribute 'sweep'), from which the row of buildings would be known; "
            "give a cube as 'pounding-sweep run' wrote it"
        ) from None


def stored_scene(histories: xr.Dataset) -> Scene:
    """Return the row of a scenario with its histories."""
    try:
        return scene_of(json.loads(histories.attrs["scene"]))
    except (KeyError, ValueError):
        raise InputError(
            "this file does not carry its row of buildings (attribute 'scene'), from which the walls beside it would "
            "be known: it was made by another version of this package, or changed; simulate the scenario again"
        ) from None


def records_of(
    sweep: Mapping[str, Any],
    offered: Iterable[Record] = (),
    folders: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | None = None,
) -> list[Record]:
    """Find the records of a stored sweep again."""
    by_digest = {record.sha256: record for record in offered}
    records, missing = [], []
    for entry in sweep["records"]:
        record = by_digest.get(entry["sha256"]) or _by_name(entry, folders)
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


def _by_name(entry: Mapping[str, Any], folders: Any) -> Record | str:
    """Return the record of that name and digest, as found or scaled as the sweep says; or why there is none."""
    name = entry["name"]
    record = remade(entry["source"], entry["n_points"])
    if record is None:
        with suppress(RecordError):
            record = find_record(name, folders)
    for key in RECORD_SETS if record is None else ():
        with suppress(RecordError):
            record = find_record(f"{key}/{name}")
            break
    if record is None:
        return "none of that name"
    scaled = record.scaled(entry["scale"] / record.scale) if record.scale else record
    same = (one for one in (record, scaled) if one.sha256 == entry["sha256"])
    return next(same, "the record found by that name is another motion")


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
    stored = all(dim in cube.dims and cube[dim].values.tolist() == labels for dim, labels in row.items())
    stored = stored and NO_POUNDING in law_keys(cube) and {*OUTPUTS} <= {*cube.data_vars}
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
    parameters = {"sa_period": sweep.get("sa_period")}
    if sweep["cases"] is not None:
        ignored: dict[str, Any] = dict.fromkeys(IGNORED)
        cases = [replace(case_of(case), law=NO_POUNDING, **ignored) for case in sweep["cases"]]
        return {"cases": list(dict.fromkeys(cases)), **parameters}
    values = axes_of(sweep)
    axes = {name: getattr(values, name) for name, axis in AXES.items() if axis.of_buildings or axis.column == "scale"}
    axes = {name: dict(value) if AXES[name].by_building else value for name, value in axes.items() if value}
    return axes | parameters


#: Damping ratio of spectral accelerations.
DAMPING = 0.05
_SPECTRAL = re.compile(r"sa(?:\((.+)\))?")
_SPECTRAL_NAME = f"spectral acceleration, {DAMPING:.0%} damping,"
#: What an intensity may be called.
NAMES = "pga, pgv, sa(PERIOD in s), sa(BUILDING) at its first period, sa: geometric mean at those of all buildings"


def intensity_of(
    cube: xr.Dataset, intensity: str | xr.DataArray | None = None, *, records: Any = None, folders: Any = None
) -> xr.DataArray:
    """Return the intensity of each record at each scale, along ``record`` and what scales it."""
    # by one of `NAMES`, or given for the records at scale 1; by default what they are scaled to. `records` are looked
    # through before others are looked for by name
    if "record" not in cube.coords:
        raise InputError("the intensity of the ground motion needs the record of each scenario (coordinate 'record')")
    scaled_to = own_intensity(cube)
    intensity = scaled_to if intensity is None else intensity
    if isinstance(intensity, str) and intensity == scaled_to != "pga":
        name = f"{_SPECTRAL_NAME} at {cube.attrs['sa_period']:g} s"
        return described(cube["sa"].broadcast_like(cube["scale"]), "m s-2", name, bare=True)
    record = cube["record"]
    names = [str(name) for name in np.atleast_1d(record.values)]
    if isinstance(intensity, xr.DataArray):
        if intensity.dims != ("record",) or "record" not in intensity.coords:
            raise InputError(
                f"the intensity has dimensions {intensity.dims}; it must be along 'record' alone, at scale 1"
            )
        base = intensity.sel(record=record).assign_attrs(intensity.attrs)
    elif intensity != "pga":
        base = _measured(cube, intensity, names, records, folders).sel(record=record)
    elif "record_pga" in cube.coords:
        base = described(cube["record_pga"], "m s-2", "peak ground acceleration")
    else:
        peaks = {entry["name"]: entry["pga"] for entry in json.loads(cube.attrs.get("records", "[]"))}
        base = record.copy(data=np.reshape([peaks.get(name, np.nan) for name in names], record.shape))
        base = described(base, "m s-2", "peak ground acceleration")
    scale = abs(cube["scale"]) if "scale" in cube.coords else 1.0
    about = {"units": "1", "long_name": "intensity"} | base.attrs
    return described(base * scale, about["units"], about["long_name"], bare=True)


def with_intensities(cube: xr.Dataset, names: Iterable[str], *, records: Any = None, folders: Any = None) -> xr.Dataset:
    """Return a cube with intensities of its ground motions as coordinates: ``ground_sa_0_5`` for ``sa(0.5)``.

    A table of it has a column for each.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with records.
    names : iterable of str
        Intensities, see `intensity_of`.
    records, folders : optional
        As for `intensity_of`.

    Returns
    -------
    xarray.Dataset
        The cube, with coordinates along ``record`` and what scales it.

    Raises
    ------
    InputError
        An intensity is unknown, or the cube or its records do not tell it.

    Examples
    --------
    >>> import xarray as xr
    >>> cube = xr.Dataset({"drift": ("record", [0.01])}, {"record": ["a"], "record_pga": ("record", [2.0])})
    >>> with_intensities(cube, ["pga"]).ground_pga.values.tolist()
    [2.0]
    """
    for name in names:
        coordinate = plain_name(f"ground_{name}".rstrip(")"), [str(each) for each in cube.coords])
        cube = cube.assign_coords({coordinate: intensity_of(cube, name, records=records, folders=folders)})
    return cube


def with_intensity(rows: Iterable[Mapping[str, Any]], strength: xr.DataArray, name: str) -> list[dict[str, Any]]:
    """Return rows of a table with an intensity before their values; None where they are of several motions."""
    result = []
    for row in rows:
        at = {dim: row.get(str(dim)) for dim in strength.dims if strength.sizes[dim] > 1}
        value = None if None in at.values() else float(strength.sel(at).values.item())
        before, items = list(row).index("values"), list(row.items())
        result.append(dict([*items[:before], (f"{name} {strength.attrs['units']}", value), *items[before:]]))
    return result


def own_intensity(cube: xr.Dataset) -> str:
    """Return what the records of a cube are scaled to: a spectral acceleration, else "pga"."""
    scaled = "sa" in cube.coords and bool(cube["sa"].notnull().all())
    return f"sa({cube.attrs['sa_period']:g})" if scaled else "pga"


def check_intensity(name: str) -> None:
    """Raise `InputError` unless a text names an intensity."""
    if name not in ("pga", "pgv") and not _SPECTRAL.fullmatch(name):
        raise InputError(
            f"unknown intensity {name!r}; valid: {NAMES}; or, from Python, a DataArray along 'record' with its units"
        )


def periods_of(cube: xr.Dataset, name: str) -> dict[str, float]:
    """Return the periods (s) of a spectral intensity by what has them, a building or ""; none of another."""
    check_intensity(name)
    spectral = _SPECTRAL.fullmatch(name)
    if not spectral:
        return {}
    first = {b.name: float(b.periods[0]) for b in scene_of(stored_sweep(cube)["scene"]).buildings}
    period = spectral[1]
    if period is None or period in first:
        return first if period is None else {period: first[period]}
    with suppress(ValueError):
        if 0.0 < float(period) < math.inf:
            return {"": float(period)}
    raise InputError(
        f"intensity {name!r}: {period!r} is no period above 0 s, and no building; there are {', '.join(first)}"
    )


def _measured(cube: xr.Dataset, name: str, wanted: Collection[str], records: Any, folders: Any) -> xr.DataArray:
    """Return an intensity of the records at scale 1 by its name, from their motions."""
    periods = periods_of(cube, name)
    sweep = stored_sweep(cube)
    sweep["records"] = [entry for entry in sweep["records"] if entry["name"] in wanted]
    motions = records_of(sweep, [] if records is None else resolve_records(records, folders), folders)
    names = labelled("record", (motion.name for motion in motions), "ground-motion record")
    if not periods:
        velocities = [record_measures(motion).pgv for motion in motions]
        return described(names.copy(data=velocities), "m s-1", "peak ground velocity")
    mean = "geometric mean " * (len(periods) > 1)
    of = f" of {name[3:-1]}" * (name[3:-1] in periods)
    at = ", ".join(f"{period:{'g' if key == '' else '.3g'}}" for key, period in periods.items())
    logs: Any = np.log(response_spectrum(motions, list(periods.values()), DAMPING)["pseudo_acceleration"])
    spectral = names.copy(data=np.exp(logs.mean("period")))
    return described(spectral, "m s-2", f"{_SPECTRAL_NAME} {mean}at {at} s{of}")
