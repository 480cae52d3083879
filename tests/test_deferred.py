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
def test_every_entry_of_a_registry_has_its_key(registry):
    assert len(registry) == len(list(registry)) > 5
    for key, entry in registry.items():
        assert entry.key == key
    with pytest.raises(KeyError):
        registry["nothing"]


def test_nothing_heavy_is_loaded_before_it_is_used():
    """Packages are reached, keys known and command lines made without numpy; records, descriptions without more."""
    code = """
import sys, pounding_sweep as ps
ps.analysis.COMPARISONS; ps.figures.plot
import pounding_sweep.cli
assert "laws" in ps.analysis.COMPARISONS
print({"numpy", "xarray", "matplotlib", "numba"} & set(sys.modules))
import pounding_sweep.outputs.variables, pounding_sweep.output.dataset, pounding_sweep.output.describe
import pounding_sweep.output.netcdf, pounding_sweep.records, pounding_sweep.resume.checkpoint
print({"numba", "dask", "matplotlib", "scipy", "xarray", "netCDF4", "pydantic"} & set(sys.modules))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["set()"] * 2
    assert figures.force_gap is FIGURES["force-gap"].draw
