"""Benchmarks: ratios within one run and deterministic facts, never absolute times."""

from __future__ import annotations

import pytest
from stub_engine import installed

from benchmarks.work import make_work

#: Times that a ratio is measured at most.
TRIES = 4


@pytest.fixture(scope="session")
def work():
    """Return the paper's row under all of El Centro, linear law."""
    return make_work()


@pytest.fixture(scope="session")
def short_work():
    """Return the same under the first seconds of the record, its strong phase among them."""
    return make_work(short=True)


@pytest.fixture
def measured(benchmark):
    """Measure until a bound is kept, at most `TRIES` times; returns all that was found."""

    def measure(job, kept):
        found = [benchmark.pedantic(job, rounds=1)]
        while not kept(found[-1]) and len(found) < TRIES:
            found.append(job())
        return found

    return measure


@pytest.fixture(scope="module")
def stub_module():
    """Put the numbers of a formula in the place of compiled kernels."""
    with installed() as stub:
        yield stub
