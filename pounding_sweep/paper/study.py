"""Everything that the report is made of: cubes, histories, spectra and measured errors of both readings.

And what the paper leaves open: which time step is fine enough, compared under El Centro for Model I, and which Hertz
stiffness it used, of the two that its Eqs 9 to 11 can give.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from pounding_sweep.accuracy.tradeoff import tradeoff
from pounding_sweep.analysis.spectra import floor_spectra, response_spectrum
from pounding_sweep.base.errors import InputError
from pounding_sweep.model.laws import MATE2015_MODELS, get_law
from pounding_sweep.model.presets import get_preset
from pounding_sweep.outputs.variables import STATUS, relative_errors
from pounding_sweep.paper.published import (
    FIXED,
    GAP,
    METHOD,
    OUTPUTS,
    READINGS,
    RECORDS,
    RESTITUTION,
    STEP,
    Reading,
    paper_records,
    published,
    reading_of,
    sweep_of,
)
from pounding_sweep.records import Record, records_dataset
from pounding_sweep.records.catalogue import Folders
from pounding_sweep.run.execute import Progress
from pounding_sweep.run.simulate import simulate
from pounding_sweep.run.sweep import Sweep

#: Steps (s) compared. The paper names 0.02 s, the record's own, as the least that is in use.
STEPS_COMPARED = (2e-2, 1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4)
#: Relative error of displacements and forces that an engineer may accept.
LIMIT = 0.01
#: Outputs compared by step, with what they are called.
STEP_OUTPUTS = {
    "displacement_max": "displacement, forth",
    "displacement_min": "displacement, back",
    "impact_force_max": "peak force",
    "impact_count": "number of impacts",
}
#: Laws whose stiffness the Hertz stiffness is.
HERTZ_LAWS = ("hertz", "hertz_damped", "nonlinear_viscoelastic")
#: Interval (s) of the histories that are kept; a divisor of every record's step.
INTERVAL = 0.01
#: Damping ratio of the spectra, and their periods (s): from 0.02 to 3 s.
DAMPING = 0.05
PERIODS = np.geomspace(0.02, 3.0, 150)


def step_errors(reading: Reading, progress: Progress) -> xr.Dataset:
    """Measure what each scheme and step errs by, in the response that the paper varied the step for."""
    sweep = Sweep(reading.preset, "el_centro", "linear", gaps=[GAP], outputs=list(STEP_OUTPUTS))
    trade = tradeoff(
        sweep,
        steps=STEPS_COMPARED,
        methods=("rk4", "newmark"),
        precisions=("float64",),
        scenarios=1,
        repeats=1,
        progress=progress,
    )
    one = trade[["scenario_error", "scenario_status"]].isel(scenario=0, precision=0, drop=True)
    return one.rename(scenario_error="error", scenario_status="status").reset_coords(drop=True)


def largest_steps(steps: xr.Dataset) -> xr.DataArray:
    """Return the largest step (s) from which on all errors are within `LIMIT` and the number of impacts is right."""
    rising = steps.sortby("step")
    valued = rising["status"].isin([int(s) for s in STATUS if s.has_values])
    within = (rising["error"].drop_sel(output="impact_count") <= LIMIT).all("output")
    fine = valued & within & (rising["error"].sel(output="impact_count", drop=True) == 0.0)
    return rising["step"].where(fine.astype(int).cumprod("step") == 1).max("step")


def hertz_fit(records: Sequence[Record]) -> xr.Dataset:
    """Compare the forces of Models IV to VI with Table 5 under the Hertz stiffnesses of both readings."""
    cube = Sweep(
        READINGS["as_run"].preset,
        records,
        HERTZ_LAWS,
        gaps=[GAP],
        stiffnesses=[get_preset(reading.preset).contact.hertz_stiffness for reading in READINGS.values()],
        restitutions=[RESTITUTION],
        method=METHOD,
        dt=STEP,
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
    return simulate(reading.preset, record, law=law, restitution=restitution, method=METHOD, dt=STEP)


def thin_out(one: xr.Dataset) -> xr.Dataset:
    """Bring the histories of a scenario down to those of the figures (m, kN m, kN); of forces the largest are kept."""
    every = round(INTERVAL / (float(one["time"][1]) - float(one["time"][0])))
    at = one.isel(time=slice(None, None, every))
    roof_force = one["contact_force"].isel(storey=-1).coarsen(time=every, boundary="pad", coord_func="min").max()
    thin = {
        "roof_displacement": at["displacement"].isel(storey=-1),
        "structural_energy": at["kinetic"] + at["damping"] + at["strain"],
        "roof_force": roof_force,
    }
    return xr.Dataset(thin).reset_coords(drop=True)


@dataclass(frozen=True)
class Study:
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
    motions = records_dataset(records).merge(response_spectrum(records, PERIODS, DAMPING))
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
    """Relative difference of a cube to a run at half the step; see `pounding_sweep.outputs.variables`."""
    dims, names = ("law", "record"), [record.name for record in records]
    half = sweep_of(reading, records, step=0.5 * STEP, audit=0.0).run(progress=progress)
    runs = [_paper_slice(one).sel(record=names).stack(case=dims).transpose("case", ...) for one in (cube, half)]
    errors = relative_errors(OUTPUTS, *({name: run[name].values for name in OUTPUTS} for run in runs))
    return xr.Dataset({name: ("case", error) for name, error in errors.items()}, {"case": runs[0]["case"]}).unstack(
        "case"
    )
