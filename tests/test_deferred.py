"""Names that packages and registries load late: every one is there, and an unknown one is an ordinary error."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from stub_engine import ENVIRONMENT

import pounding_sweep
from pounding_sweep import analysis, figures
from pounding_sweep.analysis.comparisons import COMPARISONS
from pounding_sweep.figures import FIGURES

QUICKSTART = Path(__file__).parents[1] / "sweeps" / "quickstart.toml"


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
import pounding_sweep.variables.registry, pounding_sweep.output.dataset, pounding_sweep.output.describe
import pounding_sweep.output.netcdf, pounding_sweep.records, pounding_sweep.resume
print({"numba", "dask", "matplotlib", "scipy", "xarray", "netCDF4", "filelock", "psutil"} & set(sys.modules))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["set()"] * 2
    assert figures.force_gap is FIGURES["force-gap"].draw


@pytest.mark.parametrize("command", [["plan"], ["run", "--quiet", "--output=out.nc"]], ids=lambda command: command[0])
def test_a_sweep_is_run_without_xarray_and_numba(command, tmp_path):
    """They take longer to load than the quickstart to run."""
    name, *options = command
    module = "pounding_sweep" if name == "plan" else "stub_engine"
    command = [sys.executable, "-X", "importtime", "-m", module, name, QUICKSTART, *options]
    environment = os.environ | ENVIRONMENT | {"POUNDING_SWEEP_CACHE": str(tmp_path)}  # kernels that it has are timed
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    loaded = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert "numpy" in loaded
    assert not {"xarray", "pandas", "dask", "numba"} & loaded
