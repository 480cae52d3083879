"""Everything that the report is made of: cubes, histories, spectra and measured errors of both readings."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.spectra import floor_spectra, response_spectrum
from pounding_sweep.base.errors import InputError
from pounding_sweep.model.laws import MATE2015_MODELS, get_law
from pounding_sweep.outputs.differences import relative_errors
from pounding_sweep.paper.hertz import hertz_fit
from pounding_sweep.paper.published import RECORDS
from pounding_sweep.paper.readings import (
    GAP,
    METHOD,
    OUTPUTS,
    READINGS,
    RESTITUTION,
    STEP,
    Reading,
    paper_records,
    reading_of,
    sweep_of,
)
from pounding_sweep.paper.steps import step_errors
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


def kept(one: xr.Dataset) -> xr.Dataset:
    """Bring the histories of one scenario down to those of the figures."""
    every = round(INTERVAL / (float(one["time"][1]) - float(one["time"][0])))
    at = one.isel(time=slice(None, None, every))
    energy = at["kinetic"] + at["damping"] + at["strain"]
    roofs = one["contact_force"].isel(storey=-1)
    force = roofs.coarsen(time=every, boundary="pad", coord_func="min").max()
    about = {"units": "kN", "long_name": "largest contact force at the roofs in each interval"}
    return xr.Dataset(
        {
            "roof_displacement": at["displacement"].isel(storey=-1).assign_attrs(long_name="roof displacement"),
            "structural_energy": energy.assign_attrs(
                units="kN m", long_name="structural energy", comment="kinetic + damping + strain energy of a building"
            ),
            "roof_force": force.assign_attrs(about),
        }
    ).reset_coords(drop=True)


def paper_histories(
    reading: Reading, records: Sequence[Record], advance: Callable[[int], None] = lambda count: None
) -> tuple[xr.Dataset, xr.Dataset]:
    """Run Models I to VII of one reading under all records."""
    histories: list[list[Any]] = []
    spectra: list[list[Any]] = []
    for law in MATE2015_MODELS:
        histories.append([])
        spectra.append([])
        for record in records:
            one = scenario(reading, record, law)
            histories[-1].append(kept(one))
            roofs = floor_spectra(one.isel(storey=[-1]), PERIODS, DAMPING)
            spectra[-1].append(roofs.isel(storey=0).reset_coords(drop=True))
            advance(1)
    labels = {
        "law": xr.DataArray(list(MATE2015_MODELS), dims="law", attrs={"long_name": "contact law"}),
        "record": xr.DataArray([r.name for r in records], dims="record", attrs={"long_name": "ground-motion record"}),
    }

    def together(parts: list[list[Any]]) -> xr.Dataset:
        rows = [xr.concat(row, "record", join="outer", combine_attrs="override") for row in parts]
        return xr.concat(rows, "law", combine_attrs="override").assign_coords(labels).assign_attrs(reading=reading.key)

    return together(histories), together(spectra)


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
    steps: xr.Dataset  # see `pounding_sweep.paper.steps.step_errors`
    hertz: xr.Dataset  # see `pounding_sweep.paper.hertz.hertz_fit`


def study(cubes: Sequence[xr.Dataset] = (), *, folders: Folders = None, progress: Progress | None = None) -> Study:
    """Run or take up both readings, and everything else that the report shows."""
    progress = progress or Progress()
    records, missing = paper_records(folders)
    taken = _by_reading(cubes)
    if taken:
        records, missing = _at_hand(list(taken.values()), records, missing)
        if not records:
            why = "; ".join(missing.values())
            msg = f"no record of the cubes can be used: {why}"
            raise InputError(msg)
    else:
        taken = {key: sweep_of(reading, records).run(progress=progress) for key, reading in READINGS.items()}
    readings = [READINGS[key] for key in taken]
    cube = _together({key: _paper_slice(one) for key, one in taken.items()})
    error = _together({r.key: _error(r, taken[r.key], records, progress) for r in readings})
    histories, spectra = _histories(readings, records, progress)
    progress.stage("time steps", 0)
    steps = step_errors(readings, progress)
    progress.stage("Hertz stiffness", 0)
    hertz = hertz_fit(records)
    return Study(cube, tuple(records), missing, _motions(records), histories, spectra, error, steps, hertz)


def _motions(records: Sequence[Record]) -> xr.Dataset:
    """Ground motions and their spectra."""
    return records_dataset(records).merge(response_spectrum(records, PERIODS, DAMPING))


def _by_reading(cubes: Sequence[xr.Dataset]) -> dict[str, xr.Dataset]:
    """Return the cubes by reading, in the order of `READINGS`."""
    found: dict[str, xr.Dataset] = {}
    for number, cube in enumerate(cubes, start=1):
        key = reading_of(cube, f"cube {number}").key
        if key in found:
            msg = f"cube {number} is of the reading {READINGS[key].label!r}, as one before it; give one of each reading"
            raise InputError(msg)
        found[key] = cube
    return {key: found[key] for key in READINGS if key in found}


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
            msg = (
                f"the cube has no {axis} of {value:g}, the paper's; its values are {cube[axis].values.tolist()}. "
                "Make it with 'pounding-sweep run sweeps/mate2015.toml'"
            )
            raise InputError(msg)
        cube = cube.isel({axis: int(at[0])}, drop=True)
    for axis, names in (("law", MATE2015_MODELS), ("record", RECORDS)):
        own = [name for name in names if name in cube[axis].values]
        if axis == "law" and len(own) < len(names):
            lacking = ", ".join(sorted(set(names) - set(own)))
            msg = f"the cube lacks the laws {lacking}; run the sweep with laws 'mate2015'"
            raise InputError(msg)
        cube = cube.sel({axis: own})
    return cube[[*OUTPUTS, "status"]].reset_coords(drop=True).load()


def _together(parts: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Put datasets of the readings side by side, records in the paper's order."""
    labels = xr.DataArray(list(parts), dims="reading", attrs={"long_name": "reading of the paper's data"})
    found: xr.Dataset = xr.concat(list(parts.values()), labels, join="outer", combine_attrs="drop_conflicts")
    return found.sel(record=[name for name in RECORDS if name in found["record"].values])


def _error(reading: Reading, cube: xr.Dataset, records: Sequence[Record], progress: Progress) -> xr.Dataset:
    """Relative difference of a cube to a run at half the step; see `pounding_sweep.outputs.differences`."""
    names = [record.name for record in records]
    dims = ("law", "record")

    def values(one: xr.Dataset) -> dict[str, np.ndarray]:
        one = _paper_slice(one).sel(record=names).transpose(*dims, "building", "pair", "storey")
        return {name: one[name].values.reshape(-1, *one[name].shape[2:]) for name in OUTPUTS}

    half = values(sweep_of(reading, records, step=0.5 * STEP, audit=0.0).run(progress=progress))
    found = relative_errors(OUTPUTS, values(cube), half)
    shape = (len(MATE2015_MODELS), len(names))
    about = {"units": "1", "comment": "largest difference to a run at half the step, over the largest value"}
    data: dict[str, Any] = {
        name: (dims, error.reshape(shape), {**about, "long_name": f"relative error of {name}"})
        for name, error in found.items()
    }
    return xr.Dataset(data, {"law": list(MATE2015_MODELS), "record": names})


def _histories(
    readings: Sequence[Reading], records: Sequence[Record], progress: Progress
) -> tuple[xr.Dataset, xr.Dataset]:
    progress.stage("histories", len(readings) * len(MATE2015_MODELS) * len(records))
    parts = {reading.key: paper_histories(reading, records, progress.advance) for reading in readings}
    histories, spectra = (_together({key: part[i] for key, part in parts.items()}) for i in (0, 1))
    return histories, spectra
