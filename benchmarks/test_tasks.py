"""What it costs to have processes integrate."""

from __future__ import annotations

from benchmarks.tasks import task_overhead


def test_tasks_cost_little(work, benchmark, measured):
    """In chunks of half a second, less than 5 % of the workers' time passes with anything but integrating."""
    found = measured(lambda: task_overhead(work, 0.5, 8.0, method="exact", dt=2.5e-3), lambda run: run.overhead < 0.05)
    benchmark.extra_info |= {
        "chunks": found[-1].chunks,
        "seconds_per_chunk": found[-1].chunk_seconds,
        "overhead": [run.overhead for run in found],
    }
    assert min(run.overhead for run in found) < 0.05
