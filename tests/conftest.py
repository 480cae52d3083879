"""Fixtures of several test modules."""

from __future__ import annotations

import os

import pytest
from counting import (  # noqa: F401 - hooks and a fixture
    counts,
    pytest_configure,
    pytest_sessionfinish,
    pytest_terminal_summary,
    pytest_testnodedown,
)
from hypothesis import HealthCheck, settings
from stub_engine import installed

# kernels are compiled inside examples, on cores that other tests use too
settings.register_profile("compiled", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("compiled")


#: Laws under which each scheme is tested by default, one of each kind. The rest differ in their formula, whose text all
#: schemes share, and in its slopes, which Newmark needs and `test_laws` holds against the formula; the rebound
#: under every law is tested by `test_restitution`. The contacts of exact flight are RK4's, text for text, which
#: `test_kernels` holds them to.
KINDS = {
    "rk4": frozenset(
        {
            "none",
            "linear",
            "kelvin_voigt",
            "kelvin_voigt_tension",
            "modified_kelvin_voigt",
            "linear_viscoelastic",
            "hertz",
            "hertz_damped",
            "nonlinear_viscoelastic",
            "hysteretic",
            "stereomechanical",
        }
    ),
    "newmark": frozenset(
        {"none", "linear", "hertz_damped", "nonlinear_viscoelastic", "hysteretic", "stereomechanical"}
    ),
    "exact": frozenset(
        {"none", "linear", "kelvin_voigt", "hertz_damped", "nonlinear_viscoelastic", "hysteretic", "stereomechanical"}
    ),
}


def pytest_addoption(parser):
    """Add the switch for what is left out by default."""
    parser.addoption("--all-laws", action="store_true", help="test every scheme under every law, not one of a kind")


#: Modules that take longest, in that order: they begin first, so that all cores have work until the end.
LONGEST = (
    "test_extremes",
    "test_distributed",
    "test_tradeoff",
    "test_precision",
    "test_faults",
    "test_properties",
    "test_limits",
    "test_cache",
    "test_restitution",
    "test_accuracy",
    "test_stereomechanical",
    "test_two_hosts",
    "test_doctor",
    "test_kernels",
)


def pytest_collection_modifyitems(config, items):
    """Put long modules first; leave out laws that repeat what another one tests."""
    turns = {name: turn for turn, name in enumerate(LONGEST)}
    items.sort(key=lambda item: turns.get(item.path.stem, len(LONGEST)))
    if config.getoption("--all-laws"):
        return
    left_out = [item for item in items if hasattr(item, "callspec") and _repeats(item.callspec.params)]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in set(left_out)]


def _repeats(parameters):
    kinds = KINDS.get(parameters.get("method"))
    return kinds is not None and parameters.get("law", "none") not in kinds


def _compile(*wanted):
    from pounding_sweep.engine.compile import prepare

    prepare([kernel.shape for kernels in wanted for kernel in kernels()], workers=2)


def _pair_kernels():
    """Return what `simulate` needs for two 2-storey buildings: every law and scheme."""
    import test_kernels as t

    pairs = [(law, method) for method in t.METHODS for law in t.LAWS if not _repeats({"law": law, "method": method})]
    return [t.row_kernel("pair", law, method, 1e-3) for law, method in pairs]


def _row_kernels():
    """Return what the other rows of `test_kernels` need."""
    import test_kernels as t

    return [t.row_kernel(row, law, method, 1e-3) for row, law, _, method, _, _ in t.OTHER_ROWS]


def _twin_kernels():
    """Return what holds RK4 against the twin under every law."""
    import test_kernels as t

    return [t.row_kernel("pair", law, "rk4", 1e-3) for law in t.LAWS]


def _sweep_kernels():
    """Return what sweeps of the rows of `scenes` need in several test modules."""
    from scenes import AXES, EVERY, motions, pair, row

    import pounding_sweep as ps

    pairs = {"scene": pair(), "records": motions(), "laws": "kelvin_voigt", "outputs": EVERY}
    sweeps = [
        ps.Sweep(row(), motions(), **AXES),
        *(ps.Sweep(**pairs, method=method) for method in ("rk4", "newmark", "exact")),
        *(ps.Sweep(**pairs, method=method, damping_ratios=[0.02]) for method in ("rk4", "newmark", "exact")),
    ]
    return [kernel for sweep in sweeps for kernel in sweep.plan().kernels().values()]


def pytest_sessionstart(session):
    """Compile what most tests need before the workers start, each kernel once; not for a part of the tests."""
    given = session.config.option
    whole = session.config.args_source is pytest.Config.ArgsSource.TESTPATHS and "not slow" in given.markexpr
    if whole and getattr(given, "numprocesses", None):
        _compile(_pair_kernels, _row_kernels, _twin_kernels, _sweep_kernels)


@pytest.fixture
def stub_engine():
    """Put the numbers of a formula in the place of compiled kernels for one test."""
    with installed() as stub:
        yield stub


@pytest.fixture(scope="module")
def stub_module():
    """Do so for all tests of a module, and its fixtures."""
    with installed() as stub:
        yield stub


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
