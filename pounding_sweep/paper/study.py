"""Everything that the report is made of: cubes, histories, spectra and measured errors of both readings."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from pounding_sweep.analysis.spectra import floor_spectra, response_spectrum
from pounding_sweep.base.errors import InputError
from pounding_sweep.model.laws import MATE2015_MODELS, get_law
from pounding_sweep.outputs.variables import relative_errors
from pounding_sweep.paper.published import RECORDS
from pounding_sweep.paper.questions import hertz_fit, step_errors
from pounding_sweep.paper.readings import (
    GAP,
    METHOD,
    OUTPUTS,
    READINGS,
    RESTITUTION,
    STEP,
    Reading,
    paper_records,
    reading_axis,
    reading_of,
    sweep_of,
)
from pounding_sweep.records import Record, records_dataset
from pounding_sweep.records.catalogue import Folders
from pounding_sweep.run.execute import Progress
from pounding_sweep.run.simulate import simulate

#: Interval (s) of the histories that are kept; a divisor of every record's step.
INTERVAL = 0.01
#: Damping ratio of the spectra, and their periods (s): from 0.02 to 3 s.
DAMPING = 0.05
PERIODS = np.geomspace(0.02, 3.0, 150)


def scenario(reading: Reading, record: Record, law: str) -> xr.Dataset:
    """Run one of the paper's scenarios with full histories; see `pounding_sweep.simulate`."""
    restitution = RESTITUTION if get_law(law).takes_restitution else None
    return simulate(reading.preset, record, law=law, restitution=restitution, method=METHOD, dt=STEP)


def thin_out(one: xr.Dataset) -> xr.Dataset:
    """Bring the histories of one scenario down to those of the figures."""
    every = round(INTERVAL / (float(one["time"][1]) - float(one["time"][0])))
    at = one.isel(time=slice(None, None, every))
    force = one["contact_force"].isel(storey=-1).coarsen(time=every, boundary="pad", coord_func="min").max()
    about = {
        "roof_displacement": ("m", "roof displacement"),
        "structural_energy": ("kN m", "kinetic + damping + strain energy of a building"),
        "roof_force": ("kN", "largest contact force at the roofs in each interval"),
    }
    values = at["displacement"].isel(storey=-1), at["kinetic"] + at["damping"] + at["strain"], force
    data = {
        name: one.assign_attrs(units=units, long_name=text)
        for (name, (units, text)), one in zip(about.items(), values, strict=True)
    }
    return xr.Dataset(data).reset_coords(drop=True)


def paper_histories(
    reading: Reading, records: Sequence[Record], advance: Callable[[int], None] = lambda count: None
) -> tuple[xr.Dataset, xr.Dataset]:
    """Run Models I to VII of one reading under all records: their histories, and the spectra of their roofs."""
    parts: tuple[list[list[xr.Dataset]], list[list[xr.Dataset]]] = ([], [])
    for law in MATE2015_MODELS:
        ran: list[tuple[xr.Dataset, xr.Dataset]] = []
        for record in records:
            one = scenario(reading, record, law)
            roofs = floor_spectra(one.isel(storey=[-1]), PERIODS, DAMPING).isel(storey=0).reset_coords(drop=True)
            ran.append((thin_out(one), roofs))
            advance(1)
        for part, row in zip(parts, zip(*ran, strict=True), strict=True):
            part.append(list(row))
    labels = {
        "law": ("law", list(MATE2015_MODELS), {"long_name": "contact law"}),
        "record": ("record", [record.name for record in records], {"long_name": "ground-motion record"}),
    }
    histories, spectra = (
        xr.combine_nested(part, ["law", "record"], join="outer", combine_attrs="override").assign_coords(labels)
        for part in parts
    )
    return histories.assign_attrs(reading=reading.key), spectra.assign_attrs(reading=reading.key)


#: The paper's values of the axes that its scenarios don't vary.
_FIXED = {"gap": GAP, "restitution": RESTITUTION, "stiffness_factor": 1.0, "scale": 1.0}


@dataclass(frozen=True)
class Study:
    """What was computed for the report."""

    cube: xr.Dataset  # the outputs on ``reading``, ``law``, ``record`` and what is inside a scenario
    records: tuple[Record, ...]  # ground motions that histories were run for
    missing: Mapping[str, str]  # records of the paper that are not in the cube or not at hand -> why
    motions: xr.Dataset  # the ground motions and their 5 % response spectra, on ``record``
    histories: xr.Dataset  # see `pounding_sweep.paper.study.paper_histories`; on ``reading`` too
    #: spectra of the roofs' total acceleration, on ``reading``, ``law``, ``record``, ``building``, ``period``
    floor_spectra: xr.Dataset
    #: relative difference of every output to a run at half the step, on ``reading``, ``law``, ``record``
    error: xr.Dataset
    steps: xr.Dataset  # see `pounding_sweep.paper.questions.step_errors`
    hertz: xr.Dataset  # see `pounding_sweep.paper.questions.hertz_fit`


def study(cubes: Sequence[xr.Dataset] = (), *, folders: Folders = None, progress: Progress | None = None) -> Study:
    """Run or take up both readings, and everything else that the report shows."""
    progress = progress or Progress()
    records, missing = paper_records(folders)
    by_reading = _by_reading(cubes)
    if by_reading:
        records, missing = _at_hand(list(by_reading.values()), records, missing)
        if not records:
            raise InputError(f"no record of the cubes can be used: {'; '.join(missing.values())}")
    else:
        by_reading = {key: sweep_of(reading, records).run(progress=progress) for key, reading in READINGS.items()}
    readings = [READINGS[key] for key in by_reading]

    def together(parts: Iterable[xr.Dataset]) -> xr.Dataset:
        """Put datasets of the readings side by side, records in the paper's order."""
        joined = xr.concat(list(parts), reading_axis(readings), join="outer", combine_attrs="drop_conflicts")
        return joined.sel(record=[name for name in RECORDS if name in joined["record"].values])

    cube = together(_paper_slice(one) for one in by_reading.values())
    error = together(_error(READINGS[key], one, records, progress) for key, one in by_reading.items())
    progress.stage("histories", len(readings) * len(MATE2015_MODELS) * len(records))
    ran = [paper_histories(reading, records, progress.advance) for reading in readings]
    histories, spectra = (together(part) for part in zip(*ran, strict=True))
    progress.stage("time steps", 0)
    steps = step_errors(readings, progress)
    progress.stage("Hertz stiffness", 0)
    motions = records_dataset(records).merge(response_spectrum(records, PERIODS, DAMPING))
    return Study(cube, tuple(records), missing, motions, histories, spectra, error, steps, hertz_fit(records))


def _by_reading(cubes: Sequence[xr.Dataset]) -> dict[str, xr.Dataset]:
    """Return the cubes by reading, in the order of `READINGS`."""
    by_reading: dict[str, xr.Dataset] = {}
    for number, cube in enumerate(cubes, start=1):
        key = reading_of(cube, f"cube {number}").key
        if key in by_reading:
            raise InputError(
                f"cube {number} is of the reading {READINGS[key].label!r}, as one before it; give one of each reading"
            )
        by_reading[key] = cube
    return {key: by_reading[key] for key in READINGS if key in by_reading}


def _at_hand(
    cubes: Sequence[xr.Dataset], records: Sequence[Record], missing: Mapping[str, str]
) -> tuple[list[Record], dict[str, str]]:
    """Keep the records that every cube was run with, the very same motion; say why the others are left out."""
    usable, why = [], dict(missing)
    used = [{one["name"]: one["sha256"] for one in json.loads(cube.attrs["records"])} for cube in cubes]
    for record in records:
        if any(record.name not in names for names in used):
            why[record.name] = f"record {record.name!r} is not in the cube; run its sweep with it"
        elif any(names[record.name] != record.sha256 for names in used):
            why[record.name] = (
                f"record {record.name!r} at hand is not the motion that the cube was run with (another file, or "
                "another scale); run the sweep again with it"
            )
        else:
            usable.append(record)
    return usable, {key: why[key] for key in RECORDS if key in why}


def _paper_slice(cube: xr.Dataset) -> xr.Dataset:
    """Take the paper's scenarios out of a cube: its fixed gap, restitution and factors, its laws and records."""
    for axis, value in _FIXED.items():
        if axis not in cube.dims:
            continue
        at = np.flatnonzero(np.isclose(cube[axis].values, value, rtol=1e-9))
        if not len(at):
            raise InputError(
                f"the cube has no {axis} of {value:g}, the paper's; its values are {cube[axis].values.tolist()}. "
                "Make it with 'pounding-sweep run sweeps/mate2015.toml'"
            )
        cube = cube.isel({axis: int(at[0])}, drop=True)
    for axis, names in (("law", MATE2015_MODELS), ("record", RECORDS)):
        present = [name for name in names if name in cube[axis].values]
        if axis == "law" and len(present) < len(names):
            lacking = ", ".join(sorted(set(names) - set(present)))
            raise InputError(f"the cube lacks the laws {lacking}; run the sweep with laws 'mate2015'")
        cube = cube.sel({axis: present})
    return cube[[*OUTPUTS, "status"]].reset_coords(drop=True).load()


def _error(reading: Reading, cube: xr.Dataset, records: Sequence[Record], progress: Progress) -> xr.Dataset:
    """Relative difference of a cube to a run at half the step; see `pounding_sweep.outputs.variables`."""
    dims, names = ("law", "record"), [record.name for record in records]
    half = sweep_of(reading, records, step=0.5 * STEP, audit=0.0).run(progress=progress)
    runs = [_paper_slice(one).sel(record=names).stack(case=dims).transpose("case", ...) for one in (cube, half)]
    errors = relative_errors(OUTPUTS, *({name: run[name].values for name in OUTPUTS} for run in runs))
    about = {"units": "1", "comment": "largest difference to a run at half the step, over the largest value"}
    data = {
        name: ("case", error, {**about, "long_name": f"relative error of {name}"}) for name, error in errors.items()
    }
    return xr.Dataset(data, {"case": runs[0]["case"]}).unstack("case")
