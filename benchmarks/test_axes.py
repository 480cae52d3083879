"""Axes over building properties and over the record's scale keep the throughput of a gap axis."""

from __future__ import annotations

import pytest

from benchmarks.axes import AXES, relative_throughput

#: Least share of a gap sweep's scenarios per second. Scenarios of other gaps share one motion without pounding; where
#: each has one of its own, as along periods and damping, finding that motion costs as much as the impacts do.
LEAST = {"building.left.period_factor": 0.45, "damping_ratio": 0.36}
OTHERS = 0.55


@pytest.mark.parametrize("axis", [name for name in AXES if name != "gap"])
def test_every_axis_keeps_much_of_the_throughput_of_gaps(axis, short_work, benchmark, measured):
    least = LEAST.get(axis, OTHERS)
    found = measured(
        lambda: relative_throughput(short_work, 5, [axis], method="exact", dt=2.5e-3)[axis],
        lambda ratio: ratio >= least,
    )
    benchmark.extra_info["throughput_over_gaps"] = found
    assert found[-1] >= least
