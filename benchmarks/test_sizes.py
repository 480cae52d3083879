"""Rows of other sizes: what a degree of freedom costs, and what a kernel takes to compile and to load."""

from __future__ import annotations

import pytest

from benchmarks.sizes import plan_of, row_of, start_of
from benchmarks.suite import SHORT_SIZES, SIZES, measure_sizes

#: Cost of a degree of freedom over that in the paper's row.
LIMIT = 2.5


def check(work, sizes, benchmark, measured):
    found = measured(
        lambda: measure_sizes(work, sizes, 5, starts=False, notify=lambda line: None),
        lambda sizes: max(size.relative for size in sizes) <= LIMIT,
    )
    benchmark.extra_info |= {f"{s.buildings}x{s.storeys}": s.relative for s in found[-1]}
    assert max(size.relative for size in found[-1]) <= LIMIT


def test_a_degree_of_freedom_costs_about_the_same_in_every_row(short_work, benchmark, measured):
    check(short_work, SHORT_SIZES, benchmark, measured)


@pytest.mark.slow
def test_a_degree_of_freedom_costs_about_the_same_in_large_rows(short_work, benchmark, measured):
    check(short_work, SIZES, benchmark, measured)


@pytest.mark.slow
def test_a_hundred_degrees_of_freedom_are_compiled_once(short_work, benchmark):
    """Loading the kernel of ten buildings of ten storeys takes a tenth of compiling it, or less."""
    plan = plan_of(row_of(10, 10), short_work.record)
    start = benchmark.pedantic(lambda: start_of(plan), rounds=1)
    benchmark.extra_info |= {"compiled_seconds": start.compiled, "loaded_seconds": start.loaded}
    assert start.loaded < 0.1 * start.compiled
