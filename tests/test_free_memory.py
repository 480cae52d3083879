"""What memory is free: by made-up systems, and by real processes that get no more."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import pytest
from test_cli import bad, edited, write

from pounding_sweep.run.diagnosis import free_memory

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
