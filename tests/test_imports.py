"""Modules of the package import each other in one direction; the layers stand in pyproject.toml."""

from __future__ import annotations

import graphlib

import pytest


def test_no_module_imports_itself_through_others():
    """Imports inside functions and for type checkers count too; a failure shows the circle."""
    grimp = pytest.importorskip("grimp", reason="import-linter, which CI installs, is not installed")
    graph = grimp.build_graph("pounding_sweep", cache_dir=None)
    found = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    assert len(found) > 100
    graphlib.TopologicalSorter(found).prepare()
