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
def within(benchmark):
    """Measure a ratio until it is at most a bound, a few times where other programs are in the way."""

    def check(ratio, most):
        ratios = [benchmark.pedantic(ratio, rounds=1)]
        while ratios[-1] > most and len(ratios) < TRIES:
            ratios.append(ratio())
        benchmark.extra_info["ratio"] = ratios
        assert ratios[-1] <= most

    return check


@pytest.fixture(scope="module")
def stub_module():
    """Put the numbers of a formula in the place of compiled kernels."""
    with installed() as stub:
        yield stub
