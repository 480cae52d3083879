"""Fixtures of several test modules."""

from __future__ import annotations

import gc
import os
from contextlib import nullcontext
from functools import cache as once
from pathlib import Path

import pytest
import typer.testing
from hypothesis import HealthCheck, settings
from kernels_used import SIMULATED, UNLOCATED, kernels
from stub_engine import installed

from pounding_sweep import resume
from pounding_sweep.engine import compile

# nothing that is imported or collected is garbage
gc.disable()
gc.set_threshold(20_000, 20, 20)
# kernels are compiled inside examples, on cores that other tests use too
settings.register_profile("nightly", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("day", settings.get_profile("nightly"), max_examples=10)
# the command line is made of its declarations once, not for every call of it
typer.testing._get_command = once(typer.testing._get_command)


#: Modules that take longest, in that order: they begin first, so that all cores have work until the end.
LONGEST = (
    *("test_distributed", "test_properties", "test_limits", "test_kernels"),
    *("test_yielding", "test_kernel_forms", "test_tradeoff", "test_spectra"),  # at the end by name
)
#: Modules whose tests compile kernels of their own, each in a fraction of a second.
SMALL = ("test_cache", "test_kernel_forms")
#: The test that runs, where it is one of the default run.
NOW: list[str] = []


def pytest_configure(config):
    """Fail tests of the default run that ask for a kernel beyond those of `kernels_used`; say how many examples."""
    resume.BUFFER_SECONDS = 0.0  # short as tests are, their chunks are written
    settings.load_profile("day" if "not slow" in config.option.markexpr else "nightly")
    ask = compile.get_kernel

    def get_kernel(shape):
        if NOW and compile.TWIN_VARIABLE not in os.environ and shape not in kernels():
            pytest.fail(f"{NOW[0]} asks for a kernel that is not one of `kernels_used`; mark it slow: {shape}")
        return ask(shape)

    if "not slow" in config.option.markexpr:
        get_kernel.cache_clear = getattr(ask, "cache_clear", None)
        compile.get_kernel = get_kernel


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    """Tell `get_kernel` what runs."""
    if item.path.stem not in SMALL and not any(item.get_closest_marker(name) for name in ("slow", "release")):
        NOW[:] = [item.nodeid]
    result = yield
    NOW.clear()
    return result


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Put long modules first; mark as slow what needs another kernel for the pair than the default run has."""
    turns = {name: turn for turn, name in enumerate(LONGEST)}
    items.sort(key=lambda item: turns.get(item.path.stem, len(LONGEST)))
    for item in items:
        if "pair_kernels" in item.fixturenames and hasattr(item, "callspec") and _is_slow(item.callspec.params):
            item.add_marker(pytest.mark.slow)


def pytest_collection_finish():
    """Have what was loaded by now left out of every later search for garbage, which are rare."""
    gc.collect()
    gc.freeze()
    gc.enable()


def _is_slow(parameters):
    method, law = parameters.get("method", "rk4"), parameters.get("law")
    if not parameters.get("locate", True):
        return (method, law) != UNLOCATED
    return law is not None and law not in SIMULATED.get(method, ())


def pytest_sessionstart(session):
    """Compile the kernels of the default run before it, by two processes; not for a part of the tests."""
    option = session.config.option
    whole = session.config.args_source is pytest.Config.ArgsSource.TESTPATHS and "not slow" in option.markexpr
    if whole and getattr(option, "numprocesses", None):
        compile.prepare([kernel for kernel in kernels() if not compile.is_cached(kernel.pieces)], workers=2)


@pytest.fixture(scope="session")
def pair_kernels():
    """Tell that a test runs under laws and schemes of which the default run has those in `kernels_used.SIMULATED`."""


@pytest.fixture
def stub_engine():
    """Put the numbers of a formula in the place of compiled kernels for one test."""
    with installed() as stub:
        yield stub


@pytest.fixture
def not_rendered(monkeypatch):
    """Have figures drawn and no picture made of them: the options with which each would have been, in turn."""
    asked = []

    def savefig(self, file, **options):
        Path(file).write_bytes(b"drawn")
        asked.append(options)

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", savefig)
    return asked


@pytest.fixture(scope="module")
def stub_by_day(pytestconfig):
    """Do so in the default run; in one that has slow tests too, all tests of the module have real kernels."""
    with installed() if "not slow" in pytestconfig.option.markexpr else nullcontext():
        yield


@pytest.fixture(scope="module")
def stub_module():
    """Do so for all tests of a module, and its fixtures."""
    with installed() as stub:
        yield stub


@pytest.fixture
def twin(monkeypatch):
    """Let kernels run as Python on arrays: nothing is compiled."""
    monkeypatch.setenv(compile.TWIN_VARIABLE, "1")
    compile.get_kernel.cache_clear()
    yield
    compile.get_kernel.cache_clear()
