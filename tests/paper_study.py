"""A study of the paper made by hand: every dataset that the report reads, without running anything."""

from __future__ import annotations

import json

import numpy as np
import xarray as xr

from pounding_sweep.analysis.spectra import response_spectrum
from pounding_sweep.model.laws import MATE2015_MODELS
from pounding_sweep.paper.study import (
    BUILDINGS,
    HERTZ_LAWS,
    OUTPUTS,
    PAIRS,
    READINGS,
    STEP_OUTPUTS,
    STOREYS,
    Study,
    sweep_of,
)
from pounding_sweep.records import find_record, records_dataset
from pounding_sweep.request.spec import to_json
from pounding_sweep.variables.registry import Status, get_variable

LAWS = list(MATE2015_MODELS)
OUTER = {"reading": list(READINGS), "law": LAWS, "record": ["el_centro"]}
INNER = {"building": list(BUILDINGS), "pair": list(PAIRS), "storey": list(STOREYS)}


def along(dim, *values):
    """One number for each label of a dimension."""
    labels = (OUTER | INNER)[dim]
    return xr.DataArray(np.array(values, float), dims=dim, coords={dim: labels})


def outputs(**values):
    """Outputs of a cube: those of `values` (anything that broadcasts), all others 1 and 0 without contact."""
    coords = OUTER | INNER
    contact = along("law", 1, 1, 1, 1, 1, 1, 0)
    result = {}
    for name in OUTPUTS:
        dims = ("reading", "law", "record", *get_variable(name).dims)
        ones = xr.DataArray(np.ones([len(coords[dim]) for dim in dims]), {dim: coords[dim] for dim in dims}, dims)
        value = values.get(name, contact if "pair" in dims else 1.0)
        result[name] = (0.0 * ones + value).transpose(*dims)
    return xr.Dataset(result)


def spectra(grow=2.0, wide=True):
    """Spectra that are narrow without pounding; with it `grow` times as high, and flat or as narrow."""
    period = np.geomspace(0.02, 3.0, 150)
    narrow = np.exp(-0.5 * (np.log(period / 0.3) / 0.1) ** 2)
    values = np.stack([grow * (np.ones_like(period) if wide else narrow)] * 6 + [narrow])
    data = xr.DataArray(values, {"law": LAWS, "period": ("period", period, {"units": "s"})}, ("law", "period"))
    return data.expand_dims(reading=OUTER["reading"], record=OUTER["record"], building=INNER["building"])


def histories(quiet_after=8.0):
    """Waves that fade, and forces at their crests; and `spectra`."""
    time = np.arange(0.0, 8.0, 0.01)
    wave = np.exp(-0.2 * time) * np.sin(9.0 * time) * (time < quiet_after)
    parts = {
        "roof_displacement": (0.02 * wave, "building"),
        "structural_energy": (np.cumsum(wave**2), "building"),
        "roof_force": (np.maximum(wave - 0.5, 0.0) * 1e3, "pair"),
    }
    coords = {"time": ("time", time, {"units": "s"})}
    made = {
        name: xr.DataArray(values, coords, ("time",)).expand_dims({**OUTER, dim: INNER[dim]})
        for name, (values, dim) in parts.items()
    }
    return xr.Dataset({**made, "pseudo_acceleration": spectra()})


def steps(step=(2e-2, 1e-3)):
    """Errors that fall with the square of the step; the largest step is refused."""
    step = np.array(step)
    coords = {"reading": OUTER["reading"], "scheme": ["rk4", "newmark"], "located": np.array([1, 0], np.int8)}
    coords |= {"step": step, "output": list(STEP_OUTPUTS)}
    shape = [len(values) for values in coords.values()]
    status = np.where(step > 1e-2, Status.BEYOND_STABILITY_LIMIT, Status.OK).astype(np.int8)
    data = {
        "error": (list(coords), np.broadcast_to(step[:, None] ** 2, shape)),
        "status": (list(coords)[:-1], np.broadcast_to(status, shape[:-1])),
    }
    return xr.Dataset(data, coords)


def hertz():
    """Ratios of 20 and 1."""
    coords = {"law": list(HERTZ_LAWS), "stiffness": [1.88e7, 2.79e4], "law_model": ("law", ["IV", "V", "VI"])}
    values = {"force_ratio": np.broadcast_to([20.0, 1.0], (3, 2)), "ratio_spread": np.full((3, 2), np.nan)}
    values["cells"] = np.full((3, 2), 4, np.int32)
    return xr.Dataset({name: (("law", "stiffness"), part) for name, part in values.items()}, coords)


def make_study():
    """A study of El Centro alone."""
    record = find_record("el_centro")
    cube = outputs(storey_shear_max=along("storey", 3, 2, 1))
    error = xr.Dataset({name: xr.full_like(cube["energy_residual"], 1e-6) for name in OUTPUTS})
    missing = {"arleta": "record 'arleta' is missing: get it from https://example.org"}
    motions = records_dataset([record]).merge(response_spectrum([record], [0.1, 0.5, 1.0]))
    return Study(cube, (record,), missing, motions, histories(), error, steps(), hertz())


def run_cube(reading="as_printed", **values):
    """A cube as `run` makes it, with the axes of a sweep and what its attributes say."""
    spec = sweep_of(READINGS[reading], [find_record("el_centro")]).spec
    cube = outputs(**values).sel(reading=reading, drop=True)
    cube = cube.expand_dims(gap=[0.01], stiffness_factor=[1.0], restitution=[0.6], scale=[1.0])
    records = [{"name": record.name, "sha256": record.sha256} for record in spec.records]
    cube["status"] = xr.zeros_like(cube["energy_residual"], dtype=np.int8)
    return cube.assign_attrs(sweep=to_json(spec), records=json.dumps(records))
