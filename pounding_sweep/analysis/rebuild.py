"""From a cube back to what it was made of: the row, the records with their intensities, the runs without pounding."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis import scenarios
from pounding_sweep.analysis.scenarios import NO_POUNDING, described, of_law, uncoupled_cases, without_pounding
from pounding_sweep.analysis.spectra import DEFAULT_DAMPING, response_spectrum
from pounding_sweep.base.errors import InputError, RecordError, check_choice
from pounding_sweep.model.meeting import CONTACTS
from pounding_sweep.model.scene import Scene
from pounding_sweep.records import RECORD_SETS, Record, find_record, list_records, record_measures, resolve_records
from pounding_sweep.records.synthetic import remade
from pounding_sweep.request.axes import AXES, NAMED_KINDS, axes_of, case_of, plain_name
from pounding_sweep.request.spec import SweepSpec, scene_of, spec_of
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.variables.registry import INNER_DIMS

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


def stored_spec(
    cube: xr.Dataset, folders: Any = None, *, record: str | None = None, case: int | None = None
) -> SweepSpec:
    """Return the sweep of a cube, of one `record` or listed `case` only that record; `folders` are searched first."""
    sweep = stored_sweep(cube)
    listed = sweep["cases"] or []
    if case is not None and 1 <= case <= len(listed):
        record = listed[case - 1]["record"]
    if record is not None:
        check_choice("record of this cube", record, [entry["name"] for entry in sweep["records"]])
        sweep["records"] = [entry for entry in sweep["records"] if entry["name"] == record]
    files = list_records(folders) if folders else []
    return spec_of(sweep, records_of(sweep, [item for _, item in files if isinstance(item, Record)], folders))


def stored_scene(dataset: xr.Dataset) -> Scene:
    """Return the row of a cube, or of a scenario with its histories."""
    if "scene" not in dataset.attrs and "sweep" in dataset.attrs:
        return scene_of(stored_sweep(dataset)["scene"])
    try:
        return scene_of(json.loads(dataset.attrs["scene"]))
    except (KeyError, ValueError):
        raise InputError(
            "this file does not carry its row of buildings (attribute 'scene'), from which the walls beside it would "
            "be known: it was made by another version of this package, or changed; simulate the scenario again"
        ) from None


def records_of(sweep: Mapping[str, Any], offered: Iterable[Record] = (), folders: Any = None) -> list[Record]:
    """Find the records of a stored sweep again: by their digest among those `offered`, else by name and digest."""
    by_digest = {record.sha256: record for record in offered}
    records, missing = [], []
    for entry in sweep["records"]:
        record = by_digest.get(entry["sha256"])
        named = None if record else remade(entry["source"], entry["n_points"])
        sets = [] if record or named else [f"{key}/{entry['name']}" for key in RECORD_SETS]
        for name in [entry["name"], *sets] if sets else ():
            with suppress(RecordError):
                named = find_record(name, folders)
                break
        if named is not None:  # as it was found, or scaled as the sweep says
            scaled = named.scaled(entry["scale"] / named.scale) if named.scale else named
            record = next((one for one in (named, scaled) if one.sha256 == entry["sha256"]), None)
        if record is not None:
            records.append(record.renamed(entry["name"]))
        else:
            why = "none of that name" if named is None else "the record found by that name is another motion"
            missing.append(f"{entry['name']!r} ({why})")
    if missing:
        more = f" and {len(missing) - _NAMED} more" if len(missing) > _NAMED else ""
        raise InputError(
            f"{len(missing)} of the {len(sweep['records'])} records of this cube's sweep can't be found again: "
            f"{', '.join(missing[:_NAMED])}{more}; give the folder of their files (--records FOLDER), or the records "
            "themselves"
        )
    return records


def uncoupled_runs(source: Scene | str | xr.Dataset, records: Any, folders: Any) -> tuple[Scene, xr.Dataset]:
    """Return a row, in which floors meet columns too, and `OUTPUTS` of its runs without pounding, of a cube or anew."""
    if isinstance(source, xr.Dataset):
        scene, runs = _runs_of_cube(source, records, folders)
    elif records is None:
        raise InputError("the required gap of a row needs records: required_gap(scene, records)")
    else:
        spec = Sweep(source, records, NO_POUNDING, folders=folders).spec
        scene, runs = _run(spec.scene, spec.records)
        runs = runs.isel(scale=0, drop=True)
    if "case" in runs.dims:
        return scene, of_law(runs, [NO_POUNDING])
    modes = {name: runs[name] for name in ("fundamental_period", "first_damping_ratio") if name in runs.coords}
    runs = without_pounding(runs, "the required gap")
    runs = runs.isel(dict.fromkeys(scenarios.ignored_dims(runs), 0))
    runs = runs.reset_coords(drop=True).assign_coords(modes)
    if isinstance(source, xr.Dataset):  # it may be a selection from what its sweep has
        axes = {*runs.dims} & {*source.coords} - {*INNER_DIMS}
        runs = runs.sel({dim: source[dim].values for dim in axes})
    return scene, runs


def _runs_of_cube(cube: xr.Dataset, records: Any, folders: Any) -> tuple[Scene, xr.Dataset]:
    """Return the row of a cube, and the cube if it has the runs without pounding, else what these are in."""
    sweep = stored_sweep(cube)
    scene = stored_scene(cube)
    row: dict[str, list[Any]] = {"building": [building.name for building in scene.buildings]}
    row |= {"pair": list(scene.pair_labels), "storey": list(range(1, scene.n_storeys + 1))}
    # a part of the row is no row
    stored = all(dim in cube.dims and cube[dim].values.tolist() == labels for dim, labels in row.items())
    stored = stored and NO_POUNDING in scenarios.law_keys(cube) and {*OUTPUTS} <= {*cube.data_vars}
    stored = stored and replace(scene, contacts=CONTACTS[1]) == scene
    if stored and (sweep["cases"] is None or min(uncoupled_cases(cube)) >= 0):
        return scene, cube
    try:
        motions = records_of(sweep, resolve_records(records or [], folders), folders)
    except InputError as error:
        raise InputError(
            f"{error}; or run the sweep with the law {NO_POUNDING!r} and the outputs {', '.join(OUTPUTS)}"
        ) from None
    # its axes that a run without pounding does not ignore, or its cases but for those
    if sweep["cases"] is not None:
        ignored: dict[str, Any] = dict.fromkeys(scenarios.IGNORED) | dict.fromkeys(NAMED_KINDS["pair"], ())
        cases = [replace(case_of(case), law=NO_POUNDING, **ignored) for case in sweep["cases"]]
        axes: dict[str, Any] = {"cases": list(dict.fromkeys(cases))}
    else:
        varied = axes_of(sweep)
        chosen = [key for key, axis in AXES.items() if axis.of_buildings or axis.column == "scale"]
        axes = {key: value for key in chosen if (value := getattr(varied, key))}
    return _run(scene, motions, sa_period=sweep.get("sa_period"), **axes)


def _run(scene: Scene, records: Iterable[Record], **axes: Any) -> tuple[Scene, xr.Dataset]:
    """Run a row without pounding, by the exact scheme where all is elastic."""
    if not scene.pair_names:
        raise InputError(
            "the required gap needs a pair of neighbours, and this row is a single building; add a wall or a building"
        )
    scene = replace(scene, contacts=CONTACTS[1])
    method = "rk4" if any(scene.yields) or SCHEMES["exact"].refuses(scene) else "exact"
    laws = {} if "cases" in axes else {"laws": NO_POUNDING}
    sweep = Sweep(scene, records, outputs=list(OUTPUTS), method=method, dt=STEP, audit=0.0, **laws, **axes)
    return scene, sweep.run()


_SPECTRAL = re.compile(r"sa(?:\((.+)\))?")
_SPECTRAL_NAME = f"spectral acceleration, {DEFAULT_DAMPING:.0%} damping,"
#: What an intensity may be called.
NAMES = "pga, pgv, sa(PERIOD in s), sa(BUILDING) at its first period, sa: geometric mean at those of all buildings"


def intensity_of(
    cube: xr.Dataset, intensity: str | xr.DataArray | None = None, *, records: Any = None, folders: Any = None
) -> xr.DataArray:
    """Return the intensity of each record at each scale: one of `NAMES`, or an array of the records at scale 1.

    By default it is what they are scaled to. `records` are looked through before others are looked for by name.
    """
    if "record" not in cube.coords:
        raise InputError("the intensity of the ground motion needs the record of each scenario (coordinate 'record')")
    scaled_to = intensity_axis(cube)
    intensity = scaled_to if intensity is None else intensity
    record = cube["record"]
    if isinstance(intensity, xr.DataArray):
        if intensity.dims != ("record",) or "record" not in intensity.coords:
            raise InputError(
                f"the intensity has dimensions {intensity.dims}; it must be along 'record' alone, at scale 1"
            )
        base = intensity.sel(record=record).assign_attrs(intensity.attrs)
    elif intensity == scaled_to != "pga":
        name = f"{_SPECTRAL_NAME} at {cube.attrs['sa_period']:g} s"
        return described(cube["sa"].broadcast_like(cube["scale"]), "m s-2", name, bare=True)
    elif intensity != "pga":
        base = _measured(cube, intensity, records, folders).sel(record=record)
    else:
        peaks = {entry["name"]: entry["pga"] for entry in json.loads(cube.attrs.get("records", "[]"))}
        stored = xr.apply_ufunc(lambda name: peaks.get(str(name), np.nan), record, vectorize=True)
        base = described(cube.coords.get("record_pga", stored), "m s-2", "peak ground acceleration")
    about = {"units": "1", "long_name": "intensity"} | base.attrs
    scale = abs(cube["scale"]) if "scale" in cube.coords else 1.0
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


def intensity_axis(cube: xr.Dataset) -> str:
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
    first = {b.name: float(b.periods[0]) for b in stored_scene(cube).buildings}
    period = spectral[1]
    if period is None or period in first:
        return first if period is None else {period: first[period]}
    with suppress(ValueError):
        if 0.0 < float(period) < math.inf:
            return {"": float(period)}
    raise InputError(
        f"intensity {name!r}: {period!r} is no period above 0 s, and no building; there are {', '.join(first)}"
    )


def _measured(cube: xr.Dataset, name: str, records: Any, folders: Any) -> xr.DataArray:
    """Return an intensity of the records at scale 1 by its name, from their motions."""
    periods, sweep = periods_of(cube, name), stored_sweep(cube)
    sweep["records"] = [entry for entry in sweep["records"] if entry["name"] in cube["record"].values.astype(str)]
    motions = records_of(sweep, resolve_records(records or [], folders), folders)
    names = scenarios.labelled("record", (motion.name for motion in motions), "ground-motion record")
    if not periods:
        velocities = [record_measures(motion).pgv for motion in motions]
        return described(names.copy(data=velocities), "m s-1", "peak ground velocity")
    mean = "geometric mean " * (len(periods) > 1)
    of = f" of {name[3:-1]}" * (name[3:-1] in periods)
    at = ", ".join(f"{period:{'g' if key == '' else '.3g'}}" for key, period in periods.items())
    logs: Any = np.log(response_spectrum(motions, list(periods.values()))["pseudo_acceleration"])
    spectral = names.copy(data=np.exp(logs.mean("period")))
    return described(spectral, "m s-2", f"{_SPECTRAL_NAME} {mean}at {at} s{of}")
