"""What the engine around the kernels costs: planning, scheduling, writing."""

from __future__ import annotations

import os
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from benchmarks.engine import OUTPUTS
from benchmarks.work import GAPS, Work
from pounding_sweep.run.sweep import Sweep


@dataclass(frozen=True)
class Throughput:
    """One sweep from its description to its file."""

    scenarios: int  # scenarios of the cube
    workers: int  # threads
    seconds: float  # wall time (s) of everything: plan, run, write
    kernel_seconds: float  # wall time (s) inside compiled kernels, summed over the threads

    @property
    def efficiency(self) -> float:
        """Share of the workers' time that passes in compiled kernels: 1 is the kernels' own throughput."""
        return self.kernel_seconds / (self.workers * self.seconds)


@contextmanager
def kernel_clock() -> Iterator[Callable[[], float]]:
    """Count the seconds that all threads of this process spend in compiled kernels."""
    from pounding_sweep.engine import compile

    lock, total = threading.Lock(), 0.0
    find = compile.get_kernel

    def get_kernel(shape: Any) -> Callable[..., None]:
        kernel = find(shape)

        def run(*arguments: Any) -> None:
            nonlocal total
            started = time.perf_counter()
            kernel(*arguments)
            taken = time.perf_counter() - started
            with lock:
                total += taken

        return run

    with mock.patch.object(compile, "get_kernel", get_kernel):
        yield lambda: total


def grid_sweep(work: Work, scenarios: int, **settings: Any) -> Sweep:
    """Return a sweep of about so many scenarios, none like another: gaps over `GAPS` by contact stiffnesses."""
    n_gaps = min(100, scenarios)
    return Sweep(
        work.scene,
        work.record,
        work.law,
        gaps=np.linspace(*GAPS, n_gaps),
        stiffness_factors=np.geomspace(0.5, 2.0, max(1, scenarios // n_gaps)),
        outputs=OUTPUTS,
        audit=0.0,
        **settings,
    )


def run_sweep(sweep: Sweep, workers: int | None = None) -> Throughput:
    """Run a sweep into a file on threads, its kernels already compiled, and time it."""
    workers = workers or len(os.sched_getaffinity(0))
    with tempfile.TemporaryDirectory() as folder, kernel_clock() as clock:
        started = time.perf_counter()
        sweep.run(Path(folder) / "cube.nc", scheduler="threads", workers=workers)
        seconds = time.perf_counter() - started
        return Throughput(sweep.spec.n_scenarios, workers, seconds, clock())


def plan_seconds(work: Work, scenarios: int) -> float:
    """Seconds (s) to plan a sweep of so many scenarios."""
    sweep = grid_sweep(work, scenarios, method="exact", dt=2.5e-3)
    started = time.perf_counter()
    sweep.plan()
    return time.perf_counter() - started
