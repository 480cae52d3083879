"""Faults really injected into sweeps on disk, and what they cost: nothing that was finished, never a wrong number."""

from __future__ import annotations

import json
import random
import re
import signal
import subprocess
import sys
import time

import pytest
from test_cli import LONG, cli, environment, wait_until, write

from pounding_sweep.output.netcdf import open_cube
from pounding_sweep.resume import HOLDER, MANIFEST
from pounding_sweep.run.sweep import load_sweep

#: In this process; those that are started, and what they are compared with, have kernels.
pytestmark = pytest.mark.usefixtures("stub_by_day")

OUT, PARTS = "out.nc", "out.nc.parts"


def values(path):
    with open_cube(path) as cube:
        return {name: cube[name].values.tobytes() for name in cube.variables}


#: Some twenty chunks of a tenth of a second, which are written at once.
NIGHT = LONG.replace("dt = 1e-6", "dt = 5e-6").replace("count = 128", "count = 320")
RUN = ["run", "sweep.toml", "-o", OUT, "--workers", "1", "--quiet", "--json"]
START = """
from pounding_sweep import cli
from pounding_sweep import resume

resume.BUFFER_SECONDS = 0.0
cli.main()
"""


@pytest.mark.slow
def test_a_run_that_is_killed_and_damaged_again_and_again(tmp_path):
    """Only what no kill and no fault has taken is made again, and the cube is that of an undisturbed run."""
    write(tmp_path, NIGHT)
    draw, manifest = random.Random(1), tmp_path / PARTS / MANIFEST

    def chunk_lines():
        return [line for line in manifest.read_text().splitlines() if '"key"' in line and line.endswith("}")]

    def finished():
        return len(chunk_lines()) if manifest.exists() else 0

    damaged = set()
    for kind in ("byte flipped", "file truncated", "line cut", "stale holder", "none"):
        before = finished()
        with subprocess.Popen([sys.executable, "-c", START, *RUN], cwd=tmp_path, env=environment()) as run:
            wait_until(lambda before=before: finished() > before, run)
            time.sleep(draw.uniform(0.0, 0.05))
            run.kill()
        assert run.returncode == -signal.SIGKILL
        first, *_ = chunk_lines()
        entry = json.loads(first)
        chunk = tmp_path / PARTS / f"chunk-{entry['key']}.npy"
        if kind == "byte flipped":
            content = bytearray(chunk.read_bytes())
            content[draw.randrange(len(content))] ^= 1
            chunk.write_bytes(content)
        elif kind == "file truncated":
            chunk.write_bytes(chunk.read_bytes()[:-3])
        elif kind == "line cut":
            manifest.write_text(manifest.read_text().replace(f"{first}\n", "") + first[:20])
        elif kind == "stale holder":
            (tmp_path / PARTS / HOLDER).write_text("process 7 on a machine, since 2026")
        damaged |= {entry["key"]} if kind in ("byte flipped", "file truncated") else set()
    report = json.loads(cli(*RUN, cwd=tmp_path, start=("-c", START)).stdout)["scenarios"]
    assert report["reused"] > 0
    log = (tmp_path / f"{OUT}.log").read_text()
    assert set(re.findall(r"warning: chunk '(\w+)' in .* is damaged: .*; it is computed again", log)) == damaged
    assert sorted(path.name for path in tmp_path.iterdir()) == [OUT, f"{OUT}.log", "sweep.toml"]
    cube = load_sweep(tmp_path / "sweep.toml").run(workers=2)
    assert values(tmp_path / OUT) == {name: cube[name].values.tobytes() for name in cube.variables}
