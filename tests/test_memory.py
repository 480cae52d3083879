"""Sweeps larger than what may be held of them: free memory, slabs and disk."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections import namedtuple
from pathlib import Path
from types import SimpleNamespace

import netCDF4
import numpy as np
import pytest
from scenes import OUTPUTS, make, same
from test_cli import bad, edited, write

from pounding_sweep.base.errors import OutputError, SweepError
from pounding_sweep.output import describe as describing
from pounding_sweep.output import netcdf as writing
from pounding_sweep.output.netcdf import write_cube
from pounding_sweep.run.diagnosis import FreeMemory, free_memory
from pounding_sweep.variables.registry import cube_variables

pytestmark = pytest.mark.usefixtures("stub_module")


MIB = 2**20


MANY = """
import json, os, sys
import numpy as np
import pounding_sweep as ps
from pounding_sweep.output.describe import describe

jolt = ps.Record("jolt", 0.02, 3.0 * np.sin(np.arange(4)))

def memory(what):
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) * 1024 for line in file if line.startswith(what))

def sweep(gaps, factors, restitutions, out):
    job = ps.Sweep(
        "mate2015", jolt, "linear", gaps=np.linspace(0.0, 1e-6, gaps), dt=0.01, audit=0,
        stiffness_factors=np.linspace(0.01, 0.02, factors), restitutions=np.linspace(0.1, 0.9, restitutions),
    )
    with job.run(out, overwrite=True) as cube:
        describe(cube)
        status = np.unique(cube["status"].values).tolist()
    return {"run": job.last_outcome.run, "status": status, "file": os.path.getsize(out)}

sizes, out = json.loads(sys.argv[1]), sys.argv[2]
sweep(10, 2, 2, out)  # what is loaded and compiled once is no part of the question
before = memory("VmRSS")
with open("/proc/self/clear_refs", "w") as file:
    file.write("5")  # the peak is that of what follows
print(json.dumps({**sweep(*sizes, out), "before": before, "peak": memory("VmHWM")}))
"""


def peak_of(sizes, folder):
    if not os.access("/proc/self/clear_refs", os.W_OK):
        pytest.skip("needs /proc")
    command = [sys.executable, "-c", MANY, json.dumps(sizes), str(folder / "out.nc")]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


@pytest.mark.slow
def test_a_million_scenarios_stay_below_a_gibibyte(tmp_path):
    found = peak_of([10_000, 100, 1], tmp_path)
    assert found["run"] == 1_000_000 + 1
    assert found["file"] > 440 * MIB
    assert found["peak"] - found["before"] < 300 * MIB
    assert found["peak"] < 1024 * MIB


def test_a_cube_that_does_not_fit_is_refused_before_it_is_run(monkeypatch):
    sweep = make()
    needed = 3 * sweep.plan().bytes_per_scenario * sweep.spec.n_scenarios
    monkeypatch.setattr("pounding_sweep.plan.plan.PLAN_BYTES", 1)
    monkeypatch.setattr("pounding_sweep.run.diagnosis.free_memory", lambda: FreeMemory(needed - 1, "limit of a test"))
    with pytest.raises(
        SweepError,
        match=r"the cube of 180 scenarios needs about .*B of memory, .*B are free \(limit of a test\); give an output",
    ):
        sweep.run()


@pytest.fixture
def small_slabs(monkeypatch):
    """Blocks of four scenarios, slabs of some blocks, chunks of a lane group, none of which stays in memory."""
    for module in (describing, writing):
        monkeypatch.setattr(module, "SLAB_BYTES", 2000)
    monkeypatch.setattr(writing, "BLOCK_BYTES", 100)
    monkeypatch.setattr("pounding_sweep.plan.plan.CHUNK_SECONDS", 0.0)


@pytest.fixture(scope="module")
def reference(stub_module):
    """The small sweep, in memory and in one piece, some of it refused."""
    return make(stiffness_factors=[1.0, 1e3]).run(scheduler="synchronous")


@pytest.mark.usefixtures("small_slabs")
def test_slabs_change_no_bit(reference, tmp_path):
    sweep = make(stiffness_factors=[1.0, 1e3])
    with sweep.run(tmp_path / "out.nc", workers=2) as stored:
        same(stored, reference)
    same(sweep.run(workers=2), reference)
    write_cube(reference, tmp_path / "whole.nc")
    with netCDF4.Dataset(tmp_path / "out.nc") as file, netCDF4.Dataset(tmp_path / "whole.nc") as whole:
        assert set(file.ncattrs()) == set(whole.ncattrs())
        assert file.coordinates == whole.coordinates
        assert set(file.variables) == set(whole.variables)
        for name, other in whole.variables.items():
            assert file[name].dtype == other.dtype, name
            assert file[name].dimensions == other.dimensions, name
            assert set(file[name].ncattrs()) == set(other.ncattrs()), name
            for key in other.ncattrs():
                np.testing.assert_array_equal(file[name].getncattr(key), other.getncattr(key), err_msg=f"{name} {key}")
        for name in cube_variables(OUTPUTS):
            assert file[name].chunking() == [1, 1, 1, 2, 2, 1, *file[name].shape[6:]], name
            assert not file[name].filters()["zlib"]


def test_a_cube_that_does_not_fit_on_the_disk(tmp_path, monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr("shutil.disk_usage", lambda folder: usage(10**6, 10**6 - 9000, 9000))
    needs = r"the cube of 180 scenarios, .*needs about .* [kM]B of disk, 9 kB are free .*path on another"
    with pytest.raises(OutputError, match=needs):
        make().run(tmp_path / "out.nc")
    assert list(tmp_path.iterdir()) == []


KILLED = """
import os, signal, sys
sys.path.insert(0, sys.argv[2])
from pounding_sweep.output import netcdf as writing
import stub_engine
from scenes import make

stub_engine.install()
writing.SLAB_BYTES, writing.BLOCK_BYTES = 2000, 100
true_slabs = writing.slabs

def killed(*arguments):
    for number, slab in enumerate(true_slabs(*arguments)):
        if number == 2:
            os.kill(os.getpid(), signal.SIGKILL)
        yield slab

writing.slabs = killed
make(stiffness_factors=[1.0, 1e3]).run(sys.argv[1])
"""


@pytest.mark.slow
def test_killed_while_the_cube_is_written(reference, tmp_path):
    out, parts = tmp_path / "out.nc", tmp_path / "out.nc.parts"
    code = [sys.executable, "-c", KILLED, str(out), os.path.dirname(__file__)]
    assert subprocess.run(code, check=False).returncode == -signal.SIGKILL
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.nc.log", parts.name]  # no half cube
    assert [p for p in parts.iterdir() if p.name.startswith(".pounding_sweep")]
    sweep = make(stiffness_factors=[1.0, 1e3])
    with pytest.warns(RuntimeWarning, match="was killed .* goes on"), sweep.run(out) as cube:
        same(cube.drop_attrs(), reference.drop_attrs())
    assert sweep.last_outcome.run == 0
    assert sweep.last_outcome.reused > 0
    assert sorted(p.name for p in tmp_path.iterdir()) == [out.name, "out.nc.log"]


GIB = 2**30


def files(folder, limit, used, cached=0, v1=False):
    """Files of a control group."""
    names = ("memory.limit_in_bytes", "memory.usage_in_bytes") if v1 else ("memory.max", "memory.current")
    at = f"sys/fs/cgroup/{folder}".rstrip("/")
    stat = f"anon 5\n{'total_' if v1 else ''}inactive_file {cached}"
    return {f"{at}/{names[0]}": limit, f"{at}/{names[1]}": used, f"{at}/memory.stat": stat}


V1, V2 = {"proc/self/cgroup": "5:cpu,cpuacct:/\n4:memory:/job"}, {"proc/self/cgroup": "0::/slurm/job"}
CASES = {
    "a machine": ({}, 32 * GIB, "the machine"),
    "version 2": ({**V2, **files("slurm/job", 8 * GIB, 7 * GIB, 2 * GIB)}, 3 * GIB, "slurm/job"),
    "a group above": ({**V2, **files("slurm/job", "max", GIB), **files("slurm", 4 * GIB, 3 * GIB)}, GIB, "slurm"),
    "nothing left": ({**V2, **files("slurm/job", GIB, 2 * GIB)}, 0, "slurm/job"),
    "a container": ({**V2, **files("", 3 * GIB, GIB)}, 2 * GIB, "cgroup"),
    "version 1": ({**V1, **files("memory/job", 6 * GIB, 4 * GIB, GIB, v1=True)}, 3 * GIB, "memory/job"),
}


@pytest.mark.parametrize(("system", "expected", "limit"), CASES.values(), ids=CASES)
def test_the_smallest_limit_counts(tmp_path, monkeypatch, system, expected, limit):
    monkeypatch.setattr("psutil.virtual_memory", lambda: SimpleNamespace(available=32 * GIB))
    for name, text in system.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(f"{text}\n")
    free = free_memory(tmp_path)
    assert free.bytes == expected
    assert free.limit.endswith(limit)


#: A hundred million scenarios.
ENDLESS = edited(
    "gaps = [0.001, 0.005, 1.0]",
    "gaps = { start = 1e-4, stop = 5e-3, count = 10000 }\n"
    "stiffness_factors = { start = 0.5, stop = 2.0, count = 5000 }",
).replace('["kelvin_voigt", "none"]', '["kelvin_voigt"]')
REFUSED = (
    r"planning 100,000,000 scenarios needs about 32 GB of memory, (\S+) (\S+) are free \({}\); "
    "take fewer values on an axis, make several"
)


@pytest.mark.skipif(not Path("/proc/self/limits").exists(), reason="needs /proc")
@pytest.mark.slow  # by day limits are read from files
def test_more_than_the_limit_on_address_space_is_refused(tmp_path):
    write(tmp_path, ENDLESS)
    start = "import resource, runpy; resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30)); "
    start += "runpy.run_module('pounding_sweep', run_name='__main__', alter_sys=True)"
    command = ("run", "sweep.toml", "-o", "out.nc")
    said = bad(*command, cwd=tmp_path, start=("-c", start), env={"OPENBLAS_NUM_THREADS": "1"})
    number, unit = re.match(REFUSED.format("limit on address space, ulimit -v"), said).groups()
    assert 0.0 < float(number) * {"MB": 1e6, "GB": 1e9}[unit] < 4 * GIB
    assert sorted(path.name for path in tmp_path.iterdir()) == ["sweep.toml"]
