"""Names that packages and registries load late: every one is there, and an unknown one is an ordinary error."""

from __future__ import annotations

import subprocess
import sys

import pytest

import pounding_sweep
from pounding_sweep import analysis, figures
from pounding_sweep.analysis.comparisons import COMPARISONS
from pounding_sweep.figures import FIGURES


@pytest.mark.parametrize("package", [pounding_sweep, analysis, figures])
def test_every_name_of_a_package_is_there(package):
    assert dir(package)
    for name in dir(package):
        assert getattr(package, name) is not None
    with pytest.raises(AttributeError, match=rf"module '{package.__name__}' has no attribute 'nothing'"):
        package.nothing


@pytest.mark.parametrize("registry", [COMPARISONS, FIGURES], ids=["comparisons", "figures"])
def test_every_module_of_a_registry_defines_its_entry(registry):
    assert len(registry) == len(list(registry)) > 5
    for key, entry in registry.items():
        assert entry.key == key
    with pytest.raises(KeyError):
        registry["nothing"]


def test_packages_are_reached_without_their_import():
    """And load nothing that takes long before it is used; figures are functions of their package."""
    code = "import sys, pounding_sweep as ps; ps.analysis.COMPARISONS; ps.figures.FIGURES; dir(ps.figures)"
    heavy = "{'numpy', 'xarray', 'matplotlib', 'numba'} & set(sys.modules)"
    done = subprocess.run([sys.executable, "-c", f"{code}; print({heavy})"], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
    assert figures.force_gap is FIGURES["force-gap"].draw


def test_keys_are_known_before_anything_is_loaded():
    """Of what command lines print of registries, nothing that takes long is imported."""
    code = (
        "import sys, pounding_sweep.cli; from pounding_sweep.analysis import COMPARISONS; assert 'laws' in COMPARISONS"
    )
    heavy = "{'numpy', 'xarray', 'matplotlib', 'numba'} & set(sys.modules)"
    done = subprocess.run([sys.executable, "-c", f"{code}; print({heavy})"], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
