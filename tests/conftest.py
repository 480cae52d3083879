"""Fixtures of several test modules."""

from __future__ import annotations

import os

import pytest
from hypothesis import HealthCheck, settings

# kernels are compiled inside examples, on cores that other tests use too
settings.register_profile("compiled", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("compiled")


def _compile(*wanted):
    from pounding_sweep.kernels.prepare import prepare

    prepare([kernel.shape for kernels in wanted for kernel in kernels()], workers=2)


def _pair_kernels():
    """Return what `simulate` needs for two 2-storey buildings: every law and scheme."""
    import test_kernels as t

    return [t.row_kernel("pair", law, method, 1e-3) for method in t.METHODS for law in t.LAWS]


def _row_kernels():
    """Return what the other rows of `test_kernels` need."""
    import test_kernels as t

    return [t.row_kernel(row, law, method, 1e-3) for row, law, _, method, _, _ in t.OTHER_ROWS]


def pytest_sessionstart(session):
    """Compile what most tests need before the workers start, each kernel once; not for a part of the tests."""
    workers = getattr(session.config.option, "numprocesses", None)
    if workers and session.config.args_source is pytest.Config.ArgsSource.TESTPATHS:
        _compile(_pair_kernels, _row_kernels)


@pytest.fixture(scope="session")
def pair_kernels():
    """Compile `_pair_kernels` on two cores."""
    if "PYTEST_XDIST_WORKER" not in os.environ:  # else the cores are taken: each test compiles its own
        _compile(_pair_kernels)


@pytest.fixture(scope="session")
def row_kernels():
    """Compile `_row_kernels` on two cores."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        _compile(_row_kernels)
