"""Counts of the faults that tests injected and of what came of them, printed after the tests."""

from __future__ import annotations

from collections import Counter

import pytest

_KEY = pytest.StashKey[Counter]()


def pytest_configure(config):
    """Begin with no counts."""
    config.stash[_KEY] = Counter()


@pytest.fixture(scope="session")
def counts(pytestconfig):
    """Counter of (kind of fault, what is counted)."""
    return pytestconfig.stash[_KEY]


def pytest_sessionfinish(session):
    """Hand the counts of a worker of pytest-xdist to the process that started it."""
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["counts"] = list(session.config.stash[_KEY].items())


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node):
    """Take over the counts of a worker."""
    for key, count in getattr(node, "workeroutput", {}).get("counts", ()):
        node.config.stash[_KEY][tuple(key)] += count


def pytest_terminal_summary(terminalreporter, config):
    """Print them."""
    kinds: dict[str, list[str]] = {}
    for (kind, what), count in config.stash[_KEY].items():
        kinds.setdefault(kind, []).append(f"{count} {what}")
    if kinds:
        terminalreporter.section("faults injected")
    for kind, told in sorted(kinds.items()):
        terminalreporter.write_line(f"{kind}: {', '.join(told)}")
