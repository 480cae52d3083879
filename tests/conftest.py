"""Fixtures of several test modules."""

from __future__ import annotations

import os

import pytest
from hypothesis import HealthCheck, settings

# kernels are compiled inside examples, on cores that other tests use too
settings.register_profile("compiled", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("compiled")


def _compile(kernels):
    if "PYTEST_XDIST_WORKER" not in os.environ:  # else the cores are taken: each test compiles its own
        from pounding_sweep.kernels.prepare import prepare

        prepare([kernel.shape for kernel in kernels], workers=2)


@pytest.fixture(scope="session")
def pair_kernels():
    """Compile, on two cores, what `simulate` needs for two 2-storey buildings: every law and scheme."""
    import test_kernels as t

    _compile([t.row_kernel("pair", law, method, 1e-3) for method in t.METHODS for law in t.LAWS])


@pytest.fixture(scope="session")
def row_kernels():
    """Compile, on two cores, what the other rows of `test_kernels` need."""
    import test_kernels as t

    _compile([t.row_kernel(row, law, method, 1e-3) for row, law, _, method, _, _ in t.OTHER_ROWS])
