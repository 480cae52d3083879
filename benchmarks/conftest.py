"""Benchmarks: ratios within one run and deterministic facts, never absolute times."""

from __future__ import annotations

import pytest

from benchmarks.work import make_work


@pytest.fixture(scope="session")
def work():
    """Return the paper's row under all of El Centro, linear law."""
    return make_work()


@pytest.fixture(scope="session")
def short_work():
    """Return the same under the first seconds of the record, its strong phase among them."""
    return make_work(short=True)
