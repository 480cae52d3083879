"""What dask takes of its workers' time: chunks sent to processes, results sent back."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks.engine import plan_gaps
from benchmarks.work import GAPS, Work
from pounding_sweep.plan.scenarios import ChunkTask
from pounding_sweep.run.execute import Dispatcher, run_chunk

#: Scenarios of the chunks by which the time of one is found.
PROBE = 1024


@dataclass(frozen=True)
class Tasks:
    """Chunks of one sweep run by processes."""

    chunks: int  # chunks
    chunk_seconds: float  # mean time (s) of a chunk in its worker
    #: share of a worker's time in which it does not integrate, from the beginning of a chunk to that of its next: the
    #: median over all, which the few that other programs hold up don't change
    overhead: float


def task_overhead(work: Work, chunk_seconds: float, seconds: float, **settings: Any) -> Tasks:
    """Run a sweep of about so many seconds on every core, each in a process of its own, in equal chunks."""
    workers = len(os.sched_getaffinity(0))
    probe = plan_gaps(work, np.linspace(*GAPS, PROBE), **settings)
    with Dispatcher("processes", workers) as dispatcher:
        dispatcher.prepare([probe.kernel(0).shape])
        _spans(dispatcher, 2 * workers, _part_of(probe, PROBE))  # workers load what they need
        each = _seconds(_spans(dispatcher, 2 * workers, _part_of(probe, PROBE))) / (2 * workers * PROBE)
        size = max(16, 16 * round(chunk_seconds / each / 16))
        plan = plan_gaps(work, np.linspace(*GAPS, size), **settings)
        n = workers * max(1, round(seconds / chunk_seconds))
        spans = _spans(dispatcher, n, _part_of(plan, size))
    idle = [(after - stop) / (after - start) for mine in spans for (start, stop), (after, _) in pairwise(sorted(mine))]
    return Tasks(n, _seconds(spans) / n, statistics.median(idle))


def _part_of(plan: Any, size: int) -> Callable[[int], ChunkTask]:
    """Return jobs of `size` scenarios under the first law, over and over."""
    kernel = plan.kernel(0, record=0, steps=int(plan.steps[0]))
    rows = np.flatnonzero(plan.unique.law == 0)[:size]
    table = plan.unique[rows]
    return lambda position: ChunkTask(kernel, plan.spec.records[0], table, plan.variants[table.variant], plan.outputs)


def _spans(dispatcher: Dispatcher, n: int, job: Callable[[int], ChunkTask]) -> list[list[tuple[float, float]]]:
    """Run `n` jobs; return when (s since 1970) each began and ended in its worker, for each worker."""
    assert dispatcher.cluster is not None
    client = dispatcher.cluster.client
    client.get_task_stream()  # from here on the scheduler keeps it
    begun = time.time()
    failures = [result for _, result in dispatcher.run(range(n), job) if isinstance(result, str)]
    if failures:
        raise RuntimeError(failures[0])
    spans: dict[str, list[tuple[float, float]]] = {}
    for task in client.get_task_stream(start=begun):
        if task["key"].startswith(run_chunk.__name__):
            spans.setdefault(task["worker"], []).extend(
                (span["start"], span["stop"]) for span in task["startstops"] if span["action"] == "compute"
            )
    return list(spans.values())


def _seconds(spans: list[list[tuple[float, float]]]) -> float:
    """Return the time (s) that all workers spent in their jobs."""
    return sum(stop - start for mine in spans for start, stop in mine)
