"""What memory is free: by made-up systems, and by real processes that get no more."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from scenes import AXES, motions, row
from test_cli import bad, cli, edited, environment, write

from pounding_sweep.base.memory import FreeMemory, free_memory
from pounding_sweep.output.netcdf import open_cube
from pounding_sweep.outputs.variables import Status
from pounding_sweep.run import execute
from pounding_sweep.run.diagnosis import diagnose
from pounding_sweep.run.sweep import Sweep

MIB, GIB = 2**20, 2**30
MACHINE = {"proc/meminfo": "MemTotal: 67108864 kB\nMemAvailable:   33554432 kB\nSwapFree: 0 kB\n"}
AVAILABLE = 32 * GIB
V2 = "31 23 0:28 / /sys/fs/cgroup rw,relatime shared:9 - cgroup2 cgroup2 rw,nsdelegate\n"
V1 = "35 31 0:32 {root} /sys/fs/cgroup/memory rw,relatime - cgroup cgroup rw,memory\n"
OTHERS = "22 1 8:1 / / rw - ext4 /dev/sda1 rw\n36 31 0:33 / /sys/fs/cgroup/cpu rw - cgroup cgroup rw,cpu,cpuacct\n"
STATUS = "Name:\tpython3\nVmSize:\t 2097152 kB\nVmData:\t 1048576 kB\n"
LIMITS = (
    "Limit                     Soft Limit           Hard Limit           Units     \n"
    "Max data size             {data:<20} unlimited            bytes     \n"
    "Max processes             100                  100                  processes \n"
    "Max address space         {space:<20} unlimited            bytes     \n"
)


def group2(folder, most, used, cached=0, **more):
    """A control group of version 2."""
    at = f"sys/fs/cgroup/{folder}".rstrip("/")
    texts = {"memory.max": most, "memory.current": used, "memory.stat": f"anon 5\ninactive_file {cached}\nfile 9\n"}
    return {f"{at}/{name}": f"{value}\n" for name, value in {**texts, **more}.items()}


def group1(folder, most, used, cached=0):
    """A control group of version 1."""
    at = f"sys/fs/cgroup/memory/{folder}".rstrip("/")
    stat = f"inactive_file 1\ntotal_inactive_file {cached}\n"
    return {
        f"{at}/memory.limit_in_bytes": f"{most}\n",
        f"{at}/memory.usage_in_bytes": f"{used}\n",
        f"{at}/memory.stat": stat,
    }


def system(folder, files):
    """Write a made-up system."""
    for name, text in {**MACHINE, **files}.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


V1_SELF = {"proc/self/mountinfo": OTHERS + V1.format(root="/"), "proc/self/cgroup": "5:cpu,cpuacct:/\n4:memory:/job\n"}
V2_SELF = {"proc/self/mountinfo": OTHERS + V2, "proc/self/cgroup": "0::/slurm/job/step\n"}
UNLIMITED = 2**63 - 4096

CASES = {
    "a machine": ({}, AVAILABLE, "the machine"),
    "version 2": ({**V2_SELF, **group2("slurm/job/step", 8 * GIB, 3 * GIB)}, 5 * GIB, "slurm/job/step"),
    "a group above": (
        {
            **V2_SELF,
            **group2("slurm/job/step", "max", GIB),
            **group2("slurm/job", 4 * GIB, 3 * GIB),
            **group2("slurm", 64 * GIB, 30 * GIB),
        },
        GIB,
        "slurm/job",
    ),
    "cached files are given back": (
        {**V2_SELF, **group2("slurm/job/step", 8 * GIB, 7 * GIB, 2 * GIB)},
        3 * GIB,
        "slurm/job/step",
    ),
    "slowed before it is refused": (
        {**V2_SELF, **group2("slurm/job/step", 8 * GIB, 3 * GIB, **{"memory.high": 4 * GIB})},
        GIB,
        "slurm/job/step",
    ),
    "nothing left": ({**V2_SELF, **group2("slurm/job/step", GIB, 2 * GIB)}, 0, "slurm/job/step"),
    "no limits": (
        {**V2_SELF, **group2("slurm/job/step", "max", GIB), **group2("slurm", "max", GIB, **{"memory.high": "max"})},
        AVAILABLE,
        "the machine",
    ),
    "more than there is": ({**V2_SELF, **group2("slurm", 64 * GIB, 0)}, AVAILABLE, "the machine"),
    "version 1": ({**V1_SELF, **group1("job", 6 * GIB, 4 * GIB, GIB), **group1("", UNLIMITED, 0)}, 3 * GIB, "job"),
    "version 1, the whole": ({**V1_SELF, **group1("", 6 * GIB, 4 * GIB)}, 2 * GIB, "memory"),
    "a container that sees its own group as the mounted one": (
        {
            "proc/self/mountinfo": V1.format(root="/docker/0a1b"),
            "proc/self/cgroup": "4:memory:/docker/0a1b/inner\n",
            **group1("inner", 2 * GIB, GIB),
            **group1("", 3 * GIB, GIB),
        },
        GIB,
        "memory/inner",
    ),
    "a group that can't be seen": (
        {"proc/self/mountinfo": V2, "proc/self/cgroup": "0::/../other\n", **group2("", 3 * GIB, GIB)},
        2 * GIB,
        "cgroup",
    ),
    "both versions": (
        {
            "proc/self/mountinfo": V1.format(root="/") + V2.replace("/sys/fs/cgroup", "/sys/fs/cgroup/unified"),
            "proc/self/cgroup": "4:memory:/job\n0::/\n",
            **group1("job", 2 * GIB, GIB),
        },
        GIB,
        "memory/job",
    ),
    "a limit on address space": (
        {"proc/self/status": STATUS, "proc/self/limits": LIMITS.format(data="unlimited", space=5 * GIB)},
        3 * GIB,
        "limit on address space, ulimit -v",
    ),
    "a limit on data": (
        {"proc/self/status": STATUS, "proc/self/limits": LIMITS.format(data=3 * GIB, space=5 * GIB)},
        2 * GIB,
        "limit on data, ulimit -d",
    ),
    "a limit that was set too late": (
        {"proc/self/status": STATUS, "proc/self/limits": LIMITS.format(data="unlimited", space=GIB)},
        0,
        "limit on address space, ulimit -v",
    ),
}


@pytest.mark.parametrize(("files", "expected", "limit"), CASES.values(), ids=CASES)
def test_the_least_counts(tmp_path, files, expected, limit):
    found = free_memory(system(tmp_path, files))
    assert found.bytes == expected
    assert found.limit.endswith(limit)
    assert found.limit.startswith("limit o") or found.limit == "the machine"


def test_a_system_that_does_not_tell(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "sysconf", {"SC_AVPHYS_PAGES": 1000, "SC_PAGE_SIZE": 4096}.__getitem__)
    assert free_memory(tmp_path) == FreeMemory(4_096_000, "the machine")

    def unknown(name):
        msg = "unrecognized configuration name"
        raise ValueError(msg)

    monkeypatch.setattr(os, "sysconf", unknown)
    assert free_memory(tmp_path) is None
    monkeypatch.setattr("pounding_sweep.base.memory.free_memory", lambda: None)
    assert diagnose()["memory"] == {"free_bytes": None, "limit": None}
    assert Sweep("mate2015", "el_centro", "none").plan().n_asked == 1
    monkeypatch.setattr("pounding_sweep.base.memory.free_memory", lambda: FreeMemory(GIB, "the machine"))
    assert diagnose()["memory"] == {"free_bytes": GIB, "limit": "the machine"}


# -- real limits -------------------------------------------------------------------------------------------------------

#: A hundred million scenarios.
MANY = edited(
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
    write(tmp_path, MANY)
    start = "import resource, runpy; resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30)); "
    start += "runpy.run_module('pounding_sweep', run_name='__main__', alter_sys=True)"
    command = ("run", "sweep.toml", "-o", "out.nc")
    said = bad(*command, cwd=tmp_path, start=("-c", start), env={"OPENBLAS_NUM_THREADS": "1"})
    number, unit = re.match(REFUSED.format("limit on address space, ulimit -v"), said).groups()
    assert 0.0 < float(number) * {"MB": 1e6, "GB": 1e9}[unit] < 4 * GIB
    assert sorted(path.name for path in tmp_path.iterdir()) == ["sweep.toml"]


@contextmanager
def control_group(most):
    """A control group inside that of this process; skips where none may be made."""
    controllers = dict(line.split(":", 2)[1:] for line in Path("/proc/self/cgroup").read_text().splitlines())
    old = Path("/sys/fs/cgroup/memory").is_dir() and "memory" in controllers
    above = Path("/sys/fs/cgroup/memory" if old else "/sys/fs/cgroup") / controllers["memory" if old else ""].lstrip(
        "/"
    )
    folder = above / f"pounding-sweep-test-{os.getpid()}"
    try:
        folder.mkdir()
    except OSError as error:
        pytest.skip(f"no control group can be made here ({error.strerror})")
    try:
        try:
            (folder / ("memory.limit_in_bytes" if old else "memory.max")).write_text(str(most))
        except OSError as error:
            pytest.skip(f"control groups without a limit of memory here ({error.strerror})")
        yield folder
    finally:
        folder.rmdir()


@pytest.mark.skipif(not Path("/proc/self/cgroup").exists(), reason="needs control groups")
@pytest.mark.slow  # a process of its own; by day limits are read from files
def test_more_than_the_limit_of_a_control_group_is_refused(tmp_path):
    write(tmp_path, MANY)
    with control_group(GIB) as group:
        join = f"import os, pathlib; pathlib.Path({str(group / 'cgroup.procs')!r}).write_text(str(os.getpid())); "
        start = join + "import runpy; runpy.run_module('pounding_sweep', run_name='__main__', alter_sys=True)"
        said = bad("plan", "sweep.toml", cwd=tmp_path, start=("-c", start))
    number, unit = re.match(REFUSED.format(f"limit of the control group {group}"), said).groups()
    assert 0.5 * GIB < float(number) * {"MB": 1e6, "GB": 1e9}[unit] < GIB


@pytest.mark.slow  # another process; by day `diagnose` is asked in this one, above
@pytest.mark.skipif(not Path("/proc/self/cgroup").exists(), reason="needs control groups")
def test_the_doctor_tells_the_control_group():
    with control_group(GIB) as group:
        join = f"import os, pathlib; pathlib.Path({str(group / 'cgroup.procs')!r}).write_text(str(os.getpid())); "
        start = join + "import runpy; runpy.run_module('pounding_sweep', run_name='__main__', alter_sys=True)"
        told = json.loads(cli("doctor", "--no-check", "--json", start=("-c", start)).stdout)["memory"]
    assert told["limit"] == f"limit of the control group {group}"


@pytest.mark.usefixtures("stub_engine")
def test_results_that_find_no_memory_cost_their_own_scenarios_only(monkeypatch):
    """As a worker finds it when it puts them into a table."""
    monkeypatch.setattr("pounding_sweep.plan.plan.CHUNK_SECONDS", 0.0)
    sweep = Sweep(scene=row(), records=motions(), **AXES, audit=0)
    reference, real, calls = sweep.run(scheduler="synchronous"), execute.to_table, iter(range(1, 10**6))

    def to_table(*arguments):
        if next(calls) == 4:
            raise MemoryError("Unable to allocate 8.00 MiB")
        return real(*arguments)

    monkeypatch.setattr(execute, "to_table", to_table)
    with pytest.warns(RuntimeWarning, match="^1 chunks have no result .*: MemoryError: Unable to allocate 8"):
        cube = sweep.run(scheduler="synchronous")
    lost = cube["status"] == Status.NOT_RUN
    assert 0 < int(lost.sum()) < lost.size / 2
    for name in reference.data_vars:
        np.testing.assert_array_equal(cube[name].where(~lost), reference[name].where(~lost), err_msg=name)


#: A run that has no room for the ground motion of one record, once its kernels are ready.
SHORT = """
import resource, sys, warnings
import numpy as np
from scenes import AXES, motions, row
from pounding_sweep.records import Record
from pounding_sweep.run.execute import Progress
from pounding_sweep.run.sweep import Sweep

def limit(most):
    resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))

class Limited(Progress):
    def stage(self, name, total):
        if name == "no pounding":
            pages = int(open("/proc/self/statm").read().split()[0])
            limit(pages * resource.getpagesize() + (16 << 20))
        if name == "cube":
            limit(resource.RLIM_INFINITY)

long = Record("long", 0.02, np.full(4_000_000, 1e-3))  # 32 MB
sweep = Sweep(scene=row(), records=[*motions(), long], **AXES, audit=0)
sweep.run(sys.argv[1], scheduler="synchronous", progress=Limited())
print(sweep.last_outcome.failures)
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs /proc")
def test_a_chunk_without_memory_costs_its_own_scenarios_only(tmp_path):
    out = tmp_path / "out.nc"
    reference = Sweep(scene=row(), records=motions(), **AXES, audit=0).run()  # compiles the kernels, too
    done = subprocess.run(
        [sys.executable, "-c", SHORT, out],
        cwd=Path(__file__).parent,
        env=environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "chunks have no result (status not_run)" in done.stderr
    assert "MemoryError: Unable to allocate" in done.stderr
    with open_cube(out) as cube:
        lost = cube["status"] == Status.NOT_RUN
        assert lost.sel(record="long").all()
        rest = cube.sel(record=["one", "two"])
        assert not lost.sel(record=["one", "two"]).any()
        for name in reference.data_vars:
            np.testing.assert_array_equal(rest[name], reference[name], err_msg=name)
    assert (tmp_path / "out.nc.parts").is_dir()  # what is finished waits for a run with more memory
