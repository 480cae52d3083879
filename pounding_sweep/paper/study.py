"""The paper's Tables 3 to 6, the two readings of its data, and all that the report computes of them."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from pounding_sweep.accuracy.tradeoff import tradeoff
from pounding_sweep.analysis.spectra import floor_spectra, response_spectrum
from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.base.errors import InputError, MissingRecordError
from pounding_sweep.model.laws import LAWS, MATE2015_MODELS, get_law
from pounding_sweep.model.presets import PRESETS
from pounding_sweep.records import Record, find_record, records_dataset
from pounding_sweep.records.catalogue import Folders
from pounding_sweep.request.spec import AUDIT_SHARE, json_data
from pounding_sweep.run.execute import Progress
from pounding_sweep.run.simulate import simulate
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.variables.registry import WITH_VALUES, Status, get_variable, relative_errors

_FOLDER = files("pounding_sweep") / "data" / "mate2015"
#: Ground motions, tables, readings, limits, conclusions and findings; see the file.
PAPER: dict[str, Any] = tomllib.loads((_FOLDER / "paper.toml").read_text("utf-8"))
#: Table 2, by the keys of records in `pounding_sweep.records.NAMED_RECORDS`.
GROUND_MOTIONS: dict[str, tuple[float, float]] = PAPER["ground_motions"]
RECORDS = tuple(GROUND_MOTIONS)
TABLES = {int(number): title for number, title in PAPER["tables"].items()}
BUILDINGS = ("left", "middle", "right")
PAIRS = ("left-middle", "middle-right")
STOREYS = (1, 2, 3)
#: The paper's model numbers -> law.
MODELS = {LAWS[key].model: key for key in MATE2015_MODELS}
#: Dimensions of the tables, with the values in the paper's order. Tables 3 and 4 compare two programs.
_DIMENSIONS = {
    "law": MATE2015_MODELS,
    "record": RECORDS,
    "program": ("sap2000", "matlab"),
    "building": BUILDINGS,
    "pair": PAIRS,
    "storey": STOREYS,
}


def record_title(name: str) -> str:
    """Write the name of a record as in headings."""
    return name.replace("_", " ").title()


def published(number: int) -> xr.Dataset:
    """Return a table of the paper as outputs of a cube."""
    with (_FOLDER / f"table{number}.csv").open() as file:
        frame = pd.read_csv(file).replace({"model": MODELS}).rename(columns={"model": "law"})
    dims = [dim for dim in _DIMENSIONS if dim in frame]
    if "direction" in frame:
        frame = frame.pivot(index=dims, columns="direction", values="displacement_m").reset_index()
    columns = frame.set_index(dims).to_xarray()
    labels = {dim: [value for value in _DIMENSIONS[dim] if value in columns[dim]] for dim in dims}
    columns = columns.sel(labels).assign_coords(labels)
    table = xr.Dataset(attrs={"title": f"Table {number}: {TABLES[number]}"})
    for column, (name, sign) in PAPER["columns"].items():
        if column in columns:
            attrs = {"units": get_variable(name).units, "long_name": get_variable(name).long_name}
            table[name] = (sign * columns[column].astype(float) + 0.0).assign_attrs(attrs)  # no -0
    return table


#: Gap (m) and restitution of every scenario.
GAP, RESTITUTION = 0.01, 0.6
#: The paper's values of the axes that its scenarios don't vary.
FIXED = {"gap": GAP, "restitution": RESTITUTION, "stiffness_factor": 1.0, "scale": 1.0}
#: Scheme and largest time step (s); the report measures what error they leave.
METHOD, STEP = "rk4", 5e-4
#: Outputs that the tables, figures and conclusions are made of.
OUTPUTS: list[str] = PAPER["outputs"]
#: Records that are brought to the paper's peak ground acceleration, because at hand is another processing of them.
RESCALED = frozenset({"san_fernando"})


class Reading(NamedTuple):
    """One way to read the paper's data."""

    key: str  # label on the ``reading`` axis
    preset: str  # key in `PRESETS`
    label: str  # in figures and tables
    note: str  # what it takes, and why


#: Readings by key, in the order of the report.
READINGS: dict[str, Reading] = {item["key"]: Reading(**item) for item in PAPER["readings"]}


def sweep_of(reading: Reading, records: Sequence[Record], step: float = STEP, audit: float = AUDIT_SHARE) -> Sweep:
    """Return the sweep of a reading: Models I to VII, all records."""
    return Sweep(
        reading.preset,
        records,
        "mate2015",
        gaps=[GAP],
        restitutions=[RESTITUTION],
        method=METHOD,
        dt=step,
        rest=0.0,
        outputs=OUTPUTS,
        audit=audit,
        title=f"Mate, Bakre & Jaiswal (2015), {reading.label}: Models I to VII",
    )


def paper_records(folders: Folders = None) -> tuple[list[Record], dict[str, str]]:
    """Find the paper's four records."""
    records, missing = [], {}
    for key, (pga, _) in GROUND_MOTIONS.items():
        try:
            record = find_record(key, folders)
            records.append(record.scaled_to(pga * STANDARD_GRAVITY) if key in RESCALED else record)
        except MissingRecordError as error:
            missing[key] = str(error)
    return records, missing


def reading_of(cube: xr.Dataset, name: str = "the cube") -> Reading:
    """Tell which reading a cube was run for, by the scene in its attributes."""
    remedy = "make it with 'pounding-sweep run sweeps/mate2015.toml'"
    lacking = [output for output in OUTPUTS if output not in cube]
    lacking += [f"law {law}" for law in MATE2015_MODELS if law not in cube["law"].values]
    fixed = {axis: value for axis, value in FIXED.items() if axis in cube.dims}
    lacking += [f"{axis} {x:g}" for axis, x in fixed.items() if not np.isclose(cube[axis], x, rtol=1e-9).any()]
    if lacking:
        raise InputError(f"{name} lacks {', '.join(lacking)}; {remedy}")
    scene = json.loads(cube.attrs.get("sweep", "{}")).get("scene")
    for reading in READINGS.values():
        if json_data(PRESETS[reading.preset].scene) == scene:
            return reading
    presets = ", ".join(reading.preset for reading in READINGS.values())
    raise InputError(f"{name} was run for another row of buildings than those of the presets {presets}; {remedy}")


#: Relative error of displacements and forces that an engineer may accept.
LIMIT = 0.01
#: Outputs compared by step, with what they are called.
STEP_OUTPUTS: dict[str, str] = PAPER["step_outputs"]
#: Laws whose stiffness the Hertz stiffness is.
HERTZ_LAWS = ("hertz", "hertz_damped", "nonlinear_viscoelastic")
#: Interval (s) of the histories that are kept; a divisor of every record's step.
INTERVAL = 0.01
#: Damping ratio of the spectra, and their periods (s): from 0.02 to 3 s.
DAMPING = 0.05
PERIODS = np.geomspace(0.02, 3.0, 150)


def step_errors(reading: Reading, progress: Progress) -> xr.Dataset:
    """Measure what each scheme and step errs by, in the response that the paper varied the step for."""
    sweep = Sweep(reading.preset, "el_centro", "linear", gaps=[GAP], rest=0.0, outputs=list(STEP_OUTPUTS))
    choices: Any = {"methods": ("rk4", "newmark"), "precisions": ("float64",), "scenarios": 1, "repeats": 1}
    choices |= {"located": (False, True), "accuracies": ()}
    trade = tradeoff(sweep, steps=(2e-2, 1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4), progress=progress, **choices)
    one = trade[["scenario_error", "scenario_status"]].isel(scenario=0, setting=trade["step"].notnull().values)
    one = one.set_index(setting=["scheme", "located", "step"]).unstack("setting").sortby("step", ascending=False)
    one["scenario_status"] = one["scenario_status"].fillna(int(Status.BEYOND_STABILITY_LIMIT))
    return one.rename(scenario_error="error", scenario_status="status").reset_coords(drop=True)


def largest_steps(steps: xr.Dataset) -> xr.DataArray:
    """Return the largest step (s) from which on all errors are within `LIMIT` and the number of impacts is right."""
    rising = steps.sortby("step")
    limits = xr.where(rising["output"] == "impact_count", 0.0, LIMIT)
    fine = (rising["error"] <= limits).all("output") & rising["status"].isin(WITH_VALUES)
    return rising["step"].where(fine.astype(int).cumprod("step") == 1).max("step")


def hertz_fit(records: Sequence[Record]) -> xr.Dataset:
    """Compare the forces of Models IV to VI with Table 5 under the Hertz stiffnesses of both readings."""
    cube = Sweep(
        READINGS["as_run"].preset,
        records,
        HERTZ_LAWS,
        gaps=[GAP],
        stiffnesses=[PRESETS[reading.preset].scene.contact.hertz_stiffness for reading in READINGS.values()],
        restitutions=[RESTITUTION],
        method=METHOD,
        dt=STEP,
        rest=0.0,
        outputs=OUTPUTS,
        audit=0.0,
    ).run()
    return force_fit(cube["impact_force_max"].squeeze(["gap", "restitution", "scale"], drop=True))


def force_fit(force: xr.DataArray) -> xr.Dataset:
    """Return median and spread (90 % over 10 % fractile) of peak forces over those of Table 5, and of how many."""
    paper = published(5)["impact_force_max"].sel(law=force["law"].values, record=force["record"].values)
    ratio = (force / paper.where(paper > 0)).stack(cell=("record", "pair", "storey"))
    cells = ratio.notnull().sum("cell")
    filled = ratio.where(cells > 0, 1.0)  # the fractiles of nothing would warn
    low, middle, high = (filled.quantile(q, "cell").drop_vars("quantile").where(cells > 0) for q in (0.1, 0.5, 0.9))
    return xr.Dataset({"force_ratio": middle, "ratio_spread": high / low.where(low > 0), "cells": cells})


def scenario(reading: Reading, record: Record, law: str) -> xr.Dataset:
    """Run one of the paper's scenarios with full histories; see `pounding_sweep.simulate`."""
    restitution = RESTITUTION if get_law(law).takes_restitution else None
    return simulate(reading.preset, record, law=law, restitution=restitution, method=METHOD, dt=STEP, rest=0.0)


def thin_out(one: xr.Dataset) -> xr.Dataset:
    """Bring the histories of a scenario down to those of the figures (m, kN m, kN); of forces the largest are kept."""
    every = round(INTERVAL / (float(one["time"][1]) - float(one["time"][0])))
    at, roof_force = one.isel(time=slice(None, None, every)), one["contact_force"].isel(storey=-1)
    thin = {
        "roof_displacement": at["displacement"].isel(storey=-1),
        "structural_energy": at["kinetic"] + at["damping"] + at["strain"],
        "roof_force": roof_force.coarsen(time=every, boundary="pad", coord_func="min").max(),
    }
    return xr.Dataset(thin).reset_coords(drop=True)


class Study(NamedTuple):
    """What was computed for the report."""

    cube: xr.Dataset  # the outputs on ``reading``, ``law``, ``record`` and what is inside a scenario
    records: tuple[Record, ...]  # ground motions that histories were run for
    missing: Mapping[str, str]  # records of the paper that are not in the cube or not at hand -> why
    motions: xr.Dataset  # the ground motions and their 5 % response spectra, on ``record``
    #: histories and spectra of the roofs, their total acceleration, on ``reading``, ``law``, ``record``
    histories: xr.Dataset
    #: relative difference of every output to a run at half the step, on ``reading``, ``law``, ``record``
    error: xr.Dataset
    steps: xr.Dataset  # of `step_errors`, on ``reading``
    hertz: xr.Dataset  # of `hertz_fit`


def study(cubes: Sequence[xr.Dataset] = (), *, folders: Folders = None, progress: Progress | None = None) -> Study:
    """Run or take up both readings, and everything else that the report shows."""
    progress = progress or Progress()
    records, missing = paper_records(folders)
    stored = {reading_of(cube, f"cube {number}").key: cube for number, cube in enumerate(cubes, start=1)}
    used = [{one["name"]: one["sha256"] for one in json.loads(cube.attrs["records"])} for cube in stored.values()]
    for record in records:
        if any(names.get(record.name) != record.sha256 for names in used):
            missing[record.name] = (
                f"record {record.name!r} at hand is not a motion that the cubes were run with (another file, or "
                "another scale); run the sweep again with it"
            )
    records = [record for record in records if record.name not in missing]
    if not records:
        raise InputError(f"no record of the cubes can be used: {'; '.join(missing.values())}")
    readings = [reading for key, reading in READINGS.items() if key in stored or not stored]
    runs = [stored[r.key] if stored else sweep_of(r, records).run(progress=progress) for r in readings]
    axes = {
        "reading": [reading.key for reading in readings],
        "law": list(MATE2015_MODELS),
        "record": [record.name for record in records],
    }

    def combine(parts: Iterable[xr.Dataset]) -> xr.Dataset:
        """Put datasets of the readings side by side."""
        whole = xr.concat(list(parts), "reading", join="outer", combine_attrs="drop_conflicts")
        return whole.assign_coords(reading=axes["reading"])

    cube = combine(map(_paper_slice, runs))
    cube = cube.sel(record=[name for name in RECORDS if name in cube["record"].values])
    error = combine(_error(*run, records, progress) for run in zip(readings, runs, strict=True))
    progress.stage("histories", len(readings) * len(MATE2015_MODELS) * len(records))
    nested = [
        [[_histories(reading, record, law, progress) for record in records] for law in MATE2015_MODELS]
        for reading in readings
    ]
    histories = xr.combine_nested(nested, list(axes), join="outer", combine_attrs="override").assign_coords(axes)
    progress.stage("time steps", 0)
    steps = combine(step_errors(reading, progress) for reading in readings)
    progress.stage("Hertz stiffness", 0)
    motions = records_dataset(records).merge(response_spectrum(records, PERIODS, DAMPING, rest=0.0))
    return Study(cube, tuple(records), missing, motions, histories, error, steps, hertz_fit(records))


def _histories(reading: Reading, record: Record, law: str, progress: Progress) -> xr.Dataset:
    """Run a scenario: its histories as the figures draw them, and the spectra of its roofs."""
    one = scenario(reading, record, law)
    roofs = floor_spectra(one.isel(storey=[-1]), PERIODS, DAMPING).isel(storey=0).reset_coords(drop=True)
    progress.advance(1)
    return thin_out(one).merge(roofs, combine_attrs="drop")


def _paper_slice(cube: xr.Dataset) -> xr.Dataset:
    """Take the paper's scenarios out of a cube: its fixed gap, restitution and factors, its laws and records."""
    cube = cube.sel({axis: value for axis, value in FIXED.items() if axis in cube.dims}, method="nearest", drop=True)
    records = [name for name in RECORDS if name in cube["record"].values]
    return cube[[*OUTPUTS, "status"]].sel(law=list(MATE2015_MODELS), record=records).reset_coords(drop=True).load()


def _error(reading: Reading, cube: xr.Dataset, records: Sequence[Record], progress: Progress) -> xr.Dataset:
    """Relative difference of a cube to a run at half the step; see `pounding_sweep.variables.registry`."""
    half = sweep_of(reading, records, step=0.5 * STEP, audit=0.0).run(progress=progress)
    runs = [_paper_slice(one).sel(record=[record.name for record in records]) for one in (cube, half)]
    runs = [run.stack(case=("law", "record")).transpose("case", ...) for run in runs]
    errors = relative_errors(OUTPUTS, *({name: run[name].values for name in OUTPUTS} for run in runs))
    cases = xr.Dataset({name: ("case", error) for name, error in errors.items()}, {"case": runs[0]["case"]})
    return cases.unstack("case")
