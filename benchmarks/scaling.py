"""How cost grows: one quantity varied at a time, and the exponent fitted to what it costs."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.engine import plan_gaps
from benchmarks.sizes import job_of, plan_of, row_of
from benchmarks.throughput import grid_sweep, run_sweep
from benchmarks.timing import medians
from benchmarks.work import SHORT_SECONDS, Work, cut, neighbouring_gaps
from pounding_sweep.records import Record

#: Storeys of two neighbours, and neighbours of three storeys.
STOREYS, BUILDINGS = (1, 2, 4, 8, 16), (2, 3, 5, 10)
#: Durations (s) and numbers of scenarios.
DURATIONS, SCENARIOS = (5.0, 10.0, 20.0, 30.0), (1_000, 4_000, 16_000, 64_000)

Notify = Callable[[str], None]


@dataclass(frozen=True)
class Growth:
    """Cost against one quantity."""

    #: what was varied, and what the cost is counted in
    quantity: str
    unit: str
    #: where it was measured
    values: tuple[float, ...]
    costs: tuple[float, ...]

    @property
    def exponent(self) -> float:
        """Slope of log cost over log value, by least squares; NaN from one value alone."""
        if len(self.values) < 2:
            return math.nan
        return float(np.polyfit(np.log(self.values), np.log(self.costs), 1)[0])


def measure_growth(work: Work, *, rounds: int, notify: Notify) -> list[Growth]:
    """Return the growth of cost with degrees of freedom, pairs, record length, scenarios and workers."""
    motion = cut(work.record, SHORT_SECONDS)
    return [
        _sizes("degrees of freedom (two buildings)", [(2, n) for n in STOREYS], 0, motion, rounds, notify),
        _sizes("pairs of three-storey buildings", [(n, 3) for n in BUILDINGS], 1, motion, rounds, notify),
        _durations(work, rounds, notify),
        _scenarios(work, notify),
        _workers(work, notify),
    ]


def _sizes(
    quantity: str, sizes: Sequence[tuple[int, int]], pairs: int, motion: Record, rounds: int, notify: Notify
) -> Growth:
    jobs = []
    for buildings, storeys in sizes:
        notify(f"scaling: {buildings} x {storeys} storeys")
        jobs.append(job_of(plan_of(row_of(buildings, storeys), motion)))
    values = tuple(float(b - 1 if pairs else b * s) for b, s in sizes)
    return Growth(quantity, "s of one core, rk4", values, tuple(medians(*jobs, rounds=rounds)))


def _durations(work: Work, rounds: int, notify: Notify) -> Growth:
    notify("scaling: record length")
    longest = work.record.duration
    durations = [d for d in DURATIONS if d <= longest]
    works = [replace(work, record=cut(work.record, d)) for d in durations]
    jobs = [job_of(plan_gaps(each, neighbouring_gaps(64), method="exact", dt=2.5e-3)) for each in works]
    return Growth("record length (s)", "s of one core, exact", tuple(durations), tuple(medians(*jobs, rounds=rounds)))


def _scenarios(work: Work, notify: Notify) -> Growth:
    notify("scaling: scenarios")
    run_sweep(grid_sweep(work, 100, method="exact", dt=2.5e-3))
    costs = [run_sweep(grid_sweep(work, n, method="exact", dt=2.5e-3)).seconds for n in SCENARIOS]
    return Growth("scenarios", "s, cube written, exact", tuple(map(float, SCENARIOS)), tuple(costs))


def _workers(work: Work, notify: Notify) -> Growth:
    notify("scaling: workers")
    cores = len(os.sched_getaffinity(0))
    counts = sorted({1, *(2**i for i in range(1, cores.bit_length()) if 2**i <= cores), cores})
    sweep = grid_sweep(work, SCENARIOS[-2], method="exact", dt=2.5e-3)
    costs = [run_sweep(sweep, workers).seconds for workers in counts]
    return Growth("workers (threads)", "s, cube written, exact", tuple(map(float, counts)), tuple(costs))
