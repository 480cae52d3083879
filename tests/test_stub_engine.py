"""The stand-in for compiled kernels keeps what the code around kernels relies on."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import EVERY, motions, pair

import pounding_sweep as ps
from pounding_sweep.outputs.variables import Status

SWEEP = {"scene": pair(), "records": motions(), "laws": ["none", "kelvin_voigt"], "gaps": [0.0005, 0.01, 1.0]}


def test_a_sweep_runs_without_a_compiler(stub_engine, monkeypatch):
    """No kernel is asked of the cache; numbers are finite, energies balance, and a pair out of reach is untouched."""
    monkeypatch.setattr("pounding_sweep.engine.compile._load", None)
    outputs = [*EVERY, "energy_residual"]
    cube = ps.Sweep(**SWEEP, stiffness_factors=[1.0, 2.0], outputs=outputs).run(progress=False)
    assert len(stub_engine.compiled) == 2
    assert (cube.status == Status.OK).all()
    assert np.isfinite(cube.displacement_max).all()
    assert float(cube.energy_residual.max()) < 1e-12
    hit = cube.impact_count.sel(law="kelvin_voigt").max(("pair", "storey"))
    assert (hit.isel(gap=0) > 0).all()
    assert (hit.isel(gap=-1) == 0).all()
    far = cube.isel(gap=-1).displacement_max
    np.testing.assert_array_equal(far.sel(law="kelvin_voigt"), far.sel(law="none"))


@pytest.mark.parametrize(
    "change",
    [
        {"scales": [1.1]},
        {"stiffness_factors": [1.1]},
        {"records": motions()[1]},
        {"precision": "float32"},
        pytest.param({"gaps": [0.0006]}, marks=pytest.mark.slow),
        pytest.param({"restitutions": [0.5]}, marks=pytest.mark.slow),
        pytest.param({"mass_factors": {"a": [1.1]}}, marks=pytest.mark.slow),
        pytest.param({"dt": 0.004}, marks=pytest.mark.slow),
    ],
    ids=lambda change: next(iter(change)),
)
def test_everything_that_a_scenario_is_made_of_shows(stub_engine, change):
    """Another value of any axis or setting is another largest displacement of some floor."""
    usual = {**SWEEP, "records": motions()[0], "laws": "kelvin_voigt", "gaps": [0.0005]}
    first, second = (
        ps.Sweep(**asked, outputs=["displacement_max"]).run(progress=False) for asked in (usual, {**usual, **change})
    )
    assert (first.displacement_max.values != second.displacement_max.values).any()


def test_workers_have_it_too(stub_engine):
    """Processes of dask give the bits of this one."""
    here = ps.Sweep(**SWEEP).run(progress=False)
    there = ps.Sweep(**SWEEP).run(progress=False, scheduler="processes", workers=1)
    assert there.drop_attrs().identical(here.drop_attrs())
