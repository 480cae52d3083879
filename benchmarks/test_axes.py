"""Axes over building properties and over the record's scale keep the throughput of a gap axis."""

from __future__ import annotations

import pytest

from benchmarks.axes import AXES, relative_throughput


@pytest.mark.parametrize("axis", [name for name in AXES if name != "gap"])
def test_every_axis_keeps_the_throughput_of_gaps(axis, short_work, benchmark):
    """At least 70 % of the scenarios per second of a gap sweep."""
    found = benchmark.pedantic(lambda: relative_throughput(short_work, 5, [axis], method="exact", dt=2.5e-3), rounds=1)
    benchmark.extra_info["throughput_over_gaps"] = found[axis]
    assert found[axis] >= 0.7
