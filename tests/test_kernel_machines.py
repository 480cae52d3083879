"""Kernels on machines with fewer vector instructions, and of rows that are gone through at run time."""

import os
import subprocess
import sys

import numpy as np
import pytest

import pounding_sweep as ps
from pounding_sweep.engine import cache, kernel
from pounding_sweep.engine.kernel import width
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel import lanes, spec

pytestmark = pytest.mark.slow
MACHINES = {
    "AVX2": ("haswell", "+avx2,+fma,+avx,+bmi,+bmi2,+popcnt,+lzcnt,+sse4.2"),
    "no vector instructions beyond SSE2": ("x86-64", "+sse2"),
}
#: Prints all results of two kernels, bit by bit.
RUN = """
from test_kernel_machines import results
for case in (("hertz_damped", "rk4", "float64"), ("linear", "newmark", "float64"), ("linear", "exact", "float32")):
    for name, values in sorted(results(*case).items()):
        print(name, values.tobytes().hex())
"""


def results(law, method, precision="float64", storeys=(2, 3, 2), walls=False):
    buildings = [
        ps.Building(f"b{i}", [20.0 + 5.0 * i] * n, stiffnesses=[30e3 + 4e3 * i] * n, damping_ratio=0.04)
        for i, n in enumerate(storeys)
    ]
    row = ps.Scene(
        [ps.Wall("left"), *buildings, ps.Wall("right")] if walls else buildings,
        gaps=[0.005] * (len(buildings) - 1 + 2 * walls),
    )
    t = np.arange(200) * 0.02
    record = ps.Record("sweep", dt=0.02, acceleration=6.0 * np.sin(2.0 * np.pi * (0.5 + t) * t))
    reducers = frozenset(
        {"displacement", "drift", "acceleration", "closing", "energy", "force", "count", "work", "impulse", "transfer"}
    )
    found = RowKernel(row, ps.get_law(law), Numerics(method, 5e-3, precision=precision), reducers)
    scale = np.linspace(0.5, 2.0, 16)
    gaps = np.full((16, len(row.pair_names)), 0.005) * scale[::-1, None]
    return found.run(record, scale=scale, gaps=gaps, stiffness=1e5 * scale, restitution=np.full(16, 0.6))


def another_machine(monkeypatch, name):
    """Keep kernels that are compiled from now on apart."""
    surroundings = cache._surroundings() + name
    monkeypatch.setattr(cache, "_surroundings", lambda: surroundings)
    cache.get_kernel.cache_clear()


def _printed(machine, folder):
    environment = dict(
        os.environ, POUNDING_SWEEP_CACHE=str(folder), PYTHONPATH=os.pathsep.join([os.path.dirname(__file__), *sys.path])
    )
    environment.update(zip(("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"), machine, strict=False))
    done = subprocess.run(
        [sys.executable, "-c", RUN], env=environment, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_bits_are_those_of_any_machine(tmp_path):
    here = _printed((), tmp_path)
    assert "fmax" in here
    for name, machine in MACHINES.items():
        assert _printed(machine, tmp_path) == here, name


@pytest.mark.parametrize(
    ("law", "method", "precision"),
    [
        ("hertz_damped", "rk4", "float64"),
        ("linear", "newmark", "float32"),
        ("linear", "exact", "float64"),
        ("linear", "exact", "float32"),
        ("hertz_damped", "exact", "float32"),
        ("stereomechanical", "exact", "float64"),
    ],
)
def test_bits_are_those_of_registers_of_another_width(law, method, precision, monkeypatch):
    here, before = results(law, method, precision), width(precision)
    wide = not lanes.has_wide_registers()
    for module in (lanes, kernel):
        monkeypatch.setattr(module, "has_wide_registers", lambda: wide)
    another_machine(monkeypatch, "registers of another width")
    assert width(precision) != before
    there = results(law, method, precision)
    cache.get_kernel.cache_clear()
    assert here["count"].sum() > 100
    for name, values in here.items():
        np.testing.assert_array_equal(there[name], values, err_msg=name)


@pytest.mark.parametrize("law", ["linear", "stereomechanical"])
@pytest.mark.parametrize("method", ["rk4", "newmark", "exact"])
def test_a_row_gone_through_at_run_time_moves_as_one_straight_line_does(law, method, monkeypatch):
    scene = {"storeys": (2, 3, 2, 1), "walls": True}
    straight = results(law, method, **scene)
    monkeypatch.setattr(spec, "FUSED_DOF", 0)
    another_machine(monkeypatch, "rows in loops")
    looped = results(law, method, **scene)
    cache.get_kernel.cache_clear()
    assert straight["count"].sum() > 100
    for name, values in straight.items():
        size = max(np.nanmax(np.abs(values)), 1e-9)
        np.testing.assert_allclose(looped[name], values, rtol=0, atol=1e-7 * size, err_msg=name)
