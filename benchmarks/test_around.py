"""What a sweep costs around its kernels."""

from __future__ import annotations

from benchmarks.around import around


def test_little_is_done_around_kernels(benchmark, measured):
    """A sweep whose kernels cost nothing takes less than 25 times what the netCDF library takes to write its cube."""
    found = measured(lambda: around(200_000, rounds=3), lambda run: run.outside < 25.0 * run.netcdf)
    benchmark.extra_info |= {
        "microseconds": [1e6 * run.outside for run in found],
        "times_netcdf": [run.outside / run.netcdf for run in found],
    }
    assert found[-1].outside < 25.0 * found[-1].netcdf
