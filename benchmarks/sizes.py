"""Rows of other sizes: what a scenario costs, and what its kernel takes to compile and to load."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import pounding_sweep as ps
from benchmarks.engine import OUTPUTS, run_chunks
from pounding_sweep.engine.compile import CACHE_VARIABLE, to_json
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.plan.plan import Plan
from pounding_sweep.records import Record
from pounding_sweep.run.sweep import Sweep

#: Gap (m) at which nothing touches: the arithmetic of the row is measured, not how often it pounds.
WIDE = 10.0
#: Lane groups of one timed call.
GROUPS = 8


def row_of(buildings: int, storeys: int) -> ps.Scene:
    """Return a row of equal heights and alternating stiffness, whose neighbours meet at every floor."""
    row = [
        ps.Building(f"b{i}", masses=[175.0] * storeys, stiffnesses=[4.0e5 + 1.5e5 * (i % 2)] * storeys)
        for i in range(buildings)
    ]
    return ps.Scene(row, gaps=[WIDE] * (buildings - 1), contact=ps.ContactProperties(linear_stiffness=2e6))


def plan_of(scene: ps.Scene, record: Record, *, method: str = "rk4", dt: float = 2.5e-3) -> Plan:
    """Return the plan of whole lane groups of a row that never touches, contacts compiled in."""
    gaps = WIDE * np.linspace(1.0, 1.1, GROUPS * LANES)
    return Sweep(scene, record, "linear", gaps=gaps, method=method, dt=dt, outputs=OUTPUTS).plan()


def steps_of(plan: Plan) -> int:
    """Integrated steps of one scenario of a plan with one record."""
    return (plan.spec.records[0].n_points - 1) * int(plan.steps.max())


def job_of(plan: Plan) -> Callable[[], object]:
    """Return what runs a plan, compiled and warm."""
    run_chunks(plan)
    return lambda: run_chunks(plan)


@dataclass(frozen=True)
class Start:
    """Seconds (s) that one kernel takes in a new process: compiled, then loaded from disk."""

    compiled: float
    loaded: float


_LOAD = """
import json, sys, time
from pounding_sweep.engine.compile import get_kernel
from pounding_sweep.engine.compile import from_json
shape = from_json(json.load(sys.stdin))
started = time.perf_counter()
get_kernel(shape)
print(time.perf_counter() - started)
"""


def start_of(plan: Plan) -> Start:
    """Compile the kernel of a plan's first law in a new process and an empty cache; load it in another."""
    shape = json.dumps(to_json(plan.kernel(0).shape))
    with tempfile.TemporaryDirectory() as folder:
        environment: dict[str, Any] = {**os.environ, CACHE_VARIABLE: folder}
        options: dict[str, Any] = {"input": shape, "env": environment, "capture_output": True, "text": True}
        runs = [subprocess.run([sys.executable, "-c", _LOAD], check=True, **options) for _ in range(2)]
    return Start(*(float(run.stdout) for run in runs))
