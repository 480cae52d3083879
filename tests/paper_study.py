"""A study of the paper made by hand: every dataset that the report reads, without running anything."""

from __future__ import annotations

import json

import numpy as np
import xarray as xr

from pounding_sweep.analysis.spectra import response_spectrum
from pounding_sweep.model.laws import MATE2015_MODELS
from pounding_sweep.outputs.variables import Status, get_variable
from pounding_sweep.paper.published import BUILDINGS, OUTPUTS, PAIRS, READINGS, STOREYS, sweep_of
from pounding_sweep.paper.study import HERTZ_LAWS, STEP_OUTPUTS, Study
from pounding_sweep.records import find_record, records_dataset
from pounding_sweep.spec.spec import to_json

LAWS = list(MATE2015_MODELS)
INNER = {"building": list(BUILDINGS), "pair": list(PAIRS), "storey": list(STOREYS)}


def outputs(records=("el_centro",), readings=tuple(READINGS), **values):
    """Outputs of a cube: those given (anything that broadcasts), all others 1 and 0 without contact."""
    coords = {"reading": list(readings), "law": LAWS, "record": list(records), **INNER}
    found = {}
    for name in OUTPUTS:
        dims = ("reading", "law", "record", *get_variable(name).dims)
        array = np.ones([len(coords[dim]) for dim in dims])
        if "pair" in dims:
            array[:, LAWS.index("none")] = 0.0
        found[name] = (dims, array)
    made = xr.Dataset(found, coords)
    return made.assign({name: (made[name] * 0.0 + given).transpose(*made[name].dims) for name, given in values.items()})


def by_law(*values):
    """One number per law, in the paper's order."""
    return xr.DataArray(np.array(values, float), dims="law", coords={"law": LAWS})


def spectra(records=("el_centro",), readings=tuple(READINGS), grow=2.0, wide=True):
    """Spectra that are narrow without pounding; with it `grow` times as high, and flat or as narrow."""
    period = np.geomspace(0.02, 3.0, 150)
    narrow = np.exp(-0.5 * (np.log(period / 0.3) / 0.1) ** 2)
    flat = np.full_like(period, 1.0)
    one = np.stack([grow * (flat if wide else narrow)] * 6 + [narrow])
    coords = {"law": LAWS, "period": ("period", period, {"units": "s"})}
    data = xr.DataArray(one, dims=("law", "period"), coords=coords)
    outer = {"reading": list(readings), "record": list(records), "building": list(BUILDINGS)}
    return xr.Dataset({"pseudo_acceleration": data.expand_dims(outer)})


def histories(records=("el_centro",), readings=tuple(READINGS)):
    """Waves that fade, and forces at their crests."""
    time = np.arange(0.0, 8.0, 0.01)
    wave = np.exp(-0.2 * time) * np.sin(9.0 * time)
    outer = {"reading": list(readings), "law": LAWS, "record": list(records)}
    coords = {"time": ("time", time, {"units": "s"})}

    def filled(values, **inner):
        return xr.DataArray(values, dims="time", coords=coords).expand_dims({**outer, **inner})

    return xr.Dataset(
        {
            "roof_displacement": filled(0.02 * wave, building=list(BUILDINGS)),
            "structural_energy": filled(np.cumsum(wave**2), building=list(BUILDINGS)),
            "roof_force": filled(np.maximum(wave - 0.5, 0.0) * 1e3, pair=list(PAIRS)),
        }
    )


def steps(readings=tuple(READINGS), step=(2e-2, 1e-3)):
    """Errors that fall with the square of the step; the largest step is refused."""
    step = np.array(step)
    coords = {
        "reading": list(readings),
        "scheme": ["rk4", "newmark"],
        "located": np.array([1, 0], np.int8),
        "step": step,
        "output": list(STEP_OUTPUTS),
    }
    shape = [len(values) for values in coords.values()]
    error = np.broadcast_to(step[:, None] ** 2, shape)
    status = np.broadcast_to(
        np.where(step > 1e-2, Status.BEYOND_STABILITY_LIMIT, Status.OK).astype(np.int8), shape[:-1]
    )
    return xr.Dataset({"error": (list(coords), error), "status": (list(coords)[:-1], status)}, coords)


def hertz():
    """Ratios of 20 and 1."""
    coords = {
        "law": list(HERTZ_LAWS),
        "stiffness": [1.88e7, 2.79e4],
        "law_model": ("law", ["IV", "V", "VI"]),
    }
    dims, shape = ("law", "stiffness"), (3, 2)
    ratio = np.broadcast_to([20.0, 1.0], shape)
    return xr.Dataset(
        {
            "force_ratio": (dims, ratio),
            "ratio_spread": (dims, np.full(shape, np.nan)),
            "cells": (dims, np.full(shape, 4, np.int32)),
        },
        coords,
    )


def make_study(cube=None, **more):
    """A study of El Centro alone."""
    record = find_record("el_centro")
    if cube is None:
        cube = outputs(storey_shear_max=xr.DataArray([3.0, 2.0, 1.0], dims="storey", coords={"storey": list(STOREYS)}))
    error = xr.Dataset({name: xr.full_like(cube["energy_residual"], 1e-6) for name in OUTPUTS})
    parts = {
        "cube": cube,
        "records": (record,),
        "missing": {"arleta": "record 'arleta' is missing: get it from https://example.org"},
        "motions": records_dataset([record]).merge(response_spectrum([record], [0.1, 0.5, 1.0])),
        "histories": histories(),
        "floor_spectra": spectra(),
        "error": error,
        "steps": steps(),
        "hertz": hertz(),
    }
    return Study(**{**parts, **more})


def run_cube(reading="as_printed", **values):
    """A cube as `run` makes it, with the axes of a sweep and what its attributes say."""
    spec = sweep_of(READINGS[reading], [find_record("el_centro")]).spec
    cube = outputs(readings=(reading,), **values).isel(reading=0, drop=True)
    cube = cube.expand_dims(gap=[0.01], stiffness_factor=[1.0], restitution=[0.6], scale=[1.0])
    records = [{"name": record.name, "sha256": record.sha256} for record in spec.records]
    cube["status"] = xr.zeros_like(cube["energy_residual"], dtype=np.int8)
    return cube.assign_attrs(sweep=to_json(spec), records=json.dumps(records))
