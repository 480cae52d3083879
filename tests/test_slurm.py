"""The documented script for SLURM, on a batch system that is imitated: its jobs begin at once, on this machine."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from test_cli import LONG, cli, environment, same_data, write

pytestmark = pytest.mark.slow
PAGE = Path(__file__).parents[1] / "docs" / "clusters.md"

#: What the batch system's own commands do, as far as dask-jobqueue needs them.
SBATCH = """#!/bin/sh
cp "$1" "$JOBS/script"
setsid bash "$JOBS/script" >> "$JOBS/log" 2>&1 &
echo $! >> "$JOBS/submitted"
echo "Submitted batch job $!"
"""
SCANCEL = """#!/bin/sh
echo "$1" >> "$JOBS/cancelled"
kill -- "-$1"
"""


@pytest.fixture
def batch_system(tmp_path):
    """Environment in which `sbatch` and `scancel` are found, and the folder of their jobs."""
    commands, jobs = tmp_path / "bin", tmp_path / "jobs"
    for folder in (commands, jobs):
        folder.mkdir()
    for name, text in {"sbatch": SBATCH, "scancel": SCANCEL}.items():
        (commands / name).write_text(text)
        (commands / name).chmod(0o755)
    path = f"{commands}{os.pathsep}{os.environ['PATH']}"
    yield environment(PATH=path, JOBS=str(jobs)), jobs
    for job in (jobs / "submitted").read_text().split() if (jobs / "submitted").exists() else ():
        subprocess.run(["sh", "-c", f"kill -9 -- -{job}"], check=False, capture_output=True)


def documented(**changes):
    """Return the script of the page, in which some of its words are others."""
    (script,) = (text for text in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL) if "SLURM" in text)
    for old, new in changes.items():
        assert f"{old}=" in script
        script = re.sub(rf"\b{old}=[^,)]+", f"{old}={new}", script)
    return script


def test_the_documented_script(batch_system, tmp_path):
    """Two jobs of one process each do the work; both are cancelled at the end."""
    pytest.importorskip("dask_jobqueue")
    env, jobs = batch_system
    write(tmp_path, LONG.replace("dt = 1e-6", "dt = 1e-5"), "study.toml")
    cli("run", "study.toml", "-o", "here.nc", cwd=tmp_path)
    write(tmp_path, documented(cores=1, processes=1, memory='"4GB"', jobs=2), "script.py")
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, env=env, capture_output=True, text=True, check=False, timeout=500
    )
    assert done.returncode == 0, done.stderr + (jobs / "log").read_text()
    same_data(tmp_path / "study.nc", tmp_path / "here.nc")
    log = (tmp_path / "study.nc.log").read_text()
    assert 1 <= log.count(" takes part, with 1 threads") <= 2
    submitted = (jobs / "submitted").read_text().split()
    assert len(submitted) == 2
    assert sorted((jobs / "cancelled").read_text().split()) == sorted(submitted)
    script = (jobs / "script").read_text()
    assert "export NUMBA_NUM_THREADS=1" in script
    assert "#SBATCH -t 08:00:00" in script
    assert "--nthreads 1" in script
    assert "--lifetime 470m" in script
