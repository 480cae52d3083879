"""Benchmarks: ratios within one run and deterministic facts, never absolute times."""

from __future__ import annotations

import numpy as np
import pytest

import pounding_sweep as ps
from pounding_sweep.cube.variables import reducers_for
from pounding_sweep.sweep.blocks import Numerics, RowKernel

OUTPUTS = ("displacement_max", "displacement_min", "impact_force_max", "impact_count")


@pytest.fixture(scope="session")
def record():
    """El Centro 1940 N-S, whole."""
    return ps.find_record("el_centro")


@pytest.fixture(scope="session")
def runner(record):
    """Return what runs one group of sixteen gaps of the paper's row under a law, and the steps it takes."""
    scene = ps.get_preset("mate2015")
    gaps = np.repeat(np.linspace(0.006, 0.012, 16)[:, None], 2, axis=1)

    def make(law: str, stiffness: float, located: bool, dt: float = 1e-3, outputs=OUTPUTS):
        kernel = RowKernel(scene, ps.get_law(law), Numerics("rk4", dt, located), reducers_for(outputs))
        values = {"scale": np.ones(16), "stiffness": np.full(16, stiffness), "restitution": np.full(16, 0.6)}
        kernel.run(record, gaps=gaps, **values)  # compiled, or loaded, before anything is timed
        return lambda: kernel.run(record, gaps=gaps, **values)

    return make
