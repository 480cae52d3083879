"""Names that packages and registries load late: every one is there, and an unknown one is an ordinary error."""

from __future__ import annotations

import pytest

import pounding_sweep
from pounding_sweep import analysis
from pounding_sweep.analysis.comparisons import COMPARISONS
from pounding_sweep.figures import FIGURES


@pytest.mark.parametrize("package", [pounding_sweep, analysis])
def test_every_name_of_a_package_is_there(package):
    assert dir(package)
    for name in dir(package):
        assert getattr(package, name) is not None
    with pytest.raises(AttributeError, match=rf"module '{package.__name__}' has no attribute 'nothing'"):
        package.nothing


@pytest.mark.parametrize("registry", [COMPARISONS, FIGURES], ids=["comparisons", "figures"])
def test_every_function_of_a_registry_is_there(registry):
    for key, entry in registry.items():
        function = entry.load()
        assert f"{function.__module__}:{function.__name__}" == entry.place, key
