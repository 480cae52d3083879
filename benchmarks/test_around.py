"""What a sweep costs around its kernels."""

from __future__ import annotations

from benchmarks.around import around


def test_little_is_done_around_kernels(benchmark, measured):
    """A sweep whose kernels cost nothing takes less than 40 times what hashing and writing its cube's bytes takes."""
    found = measured(lambda: around(200_000, rounds=3), lambda run: run.outside < 40.0 * run.bytes_alone)
    benchmark.extra_info |= {
        "microseconds": [1e6 * run.outside for run in found],
        "times_its_bytes": [run.outside / run.bytes_alone for run in found],
    }
    assert found[-1].outside < 40.0 * found[-1].bytes_alone
