"""What it costs to have processes integrate."""

from __future__ import annotations

from benchmarks.tasks import task_overhead


def test_tasks_cost_little(work, benchmark):
    """In chunks of half a second, less than 5 % of the workers' time passes with anything but integrating."""
    run = benchmark.pedantic(lambda: task_overhead(work, 0.5, 8.0, method="exact", dt=2.5e-3), rounds=1)
    benchmark.extra_info |= {"chunks": run.chunks, "seconds_per_chunk": run.chunk_seconds, "overhead": run.overhead}
    assert run.overhead < 0.05
