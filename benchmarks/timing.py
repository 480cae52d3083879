"""Times that can be compared: jobs take turns, and the medians of their processor time are kept."""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

#: Turns of each job.
ROUNDS = 7


def medians(
    *jobs: Callable[[], object], rounds: int = ROUNDS, clock: Callable[[], float] = time.process_time
) -> list[float]:
    """Median seconds of each job, the jobs, which are compiled, taking turns."""
    # a slow moment of the machine falls on all jobs alike; processor time (of all threads of this process) does not
    # count what other programs do on the same core
    taken: list[list[float]] = [[] for _ in jobs]
    for _ in range(rounds):
        for seconds, job in zip(taken, jobs, strict=True):
            started = clock()
            job()
            seconds.append(clock() - started)
    return [statistics.median(seconds) for seconds in taken]


@contextmanager
def one_core() -> Iterator[None]:
    """Keep this thread, and all that it starts, on one core."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
