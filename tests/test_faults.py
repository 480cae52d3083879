"""Faults really injected into sweeps on disk, and what they cost: nothing that was finished, never a wrong number."""

from __future__ import annotations

import json
import random
import re
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from test_cli import LONG, ROOT, TINY, cli, environment, wait_until, write

from pounding_sweep.output.netcdf import open_cube
from pounding_sweep.resume import HOLDER, MANIFEST
from pounding_sweep.run.sweep import load_sweep

#: In this process; those that are started, and what they are compared with, have kernels.
pytestmark = pytest.mark.usefixtures("stub_by_day")

OUT, PARTS = "out.nc", "out.nc.parts"


def values(path):
    with open_cube(path) as cube:
        return {name: cube[name].values.tobytes() for name in cube.variables}


def own_package(folder):
    """Copy the package, to be changed, or not to be; returns the environment in which it is found first."""
    shutil.copytree(ROOT / "pounding_sweep", folder / "pounding_sweep", ignore=shutil.ignore_patterns("__pycache__"))
    return {"PYTHONPATH": str(folder)}


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


# -- changes -----------------------------------------------------------------------------------------------------------

#: Has all chunks finished, and stops before the cube.
STOPPED = """
from pounding_sweep import cli
from pounding_sweep.run import cube_writer as filling

def stop(*arguments, **more):
    raise KeyboardInterrupt

filling.write_cube_of = stop
cli.main()
"""
PULSE = 'records = [{ pulse = "sine", amplitude = 5.0, period = 0.5, dt = 0.01, duration = 2.0 }]'
CHANGED = ["run", "sweep.toml", "-o", OUT]


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    """A study of its own record, under a package of its own, with all chunks finished and no cube."""
    folder = tmp_path_factory.mktemp("stopped")
    motion = 5.0 * np.sin(0.1 * np.arange(100))
    lines = [f"{0.01 * i:.2f},{a:.6f}" for i, a in enumerate(motion)]
    write(folder, "\n".join(["time (s),acceleration (m/s2)", *lines, ""]), "shake.csv")
    assert PULSE in TINY
    write(folder, TINY.replace(PULSE, 'records = "shake.csv"'))
    (folder / "package").mkdir()
    env = own_package(folder / "package")
    assert "interrupted" in cli(*CHANGED, cwd=folder, env=env, code=130, start=("-c", STOPPED)).stderr
    return folder


def edit(path, old, new):
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")


def installed(folder, name):
    """Have another version of a distribution found first."""
    (folder / "package" / f"{name}-9.9.dist-info").mkdir()
    write(
        folder / "package" / f"{name}-9.9.dist-info", f"Metadata-Version: 2.1\nName: {name}\nVersion: 9.9\n", "METADATA"
    )


CHANGES = {
    "nothing": (lambda folder: None, None),
    "a value of the sweep": (
        lambda folder: edit(folder / "sweep.toml", "0.005", "0.006"),
        r"gaps \(\[0\.001, 0\.005, 1\.0\] there, \[0\.001, 0\.006, 1\.0\] here\), sweep \(\w{60} there",
    ),
    "the step": (
        lambda folder: edit(folder / "sweep.toml", "1e-3", "5e-4"),
        r"dt \(0\.001 there, 0\.0005 here\), sweep \(",
    ),
    "a value of the record": (
        lambda folder: edit(folder / "shake.csv", "0.50,-4.794621", "0.50,-4.794622"),
        r"record shake \(\w{60} there, \w{60} here\), sweep \(",
    ),
    "a kernel": (
        lambda folder: edit(
            folder / "package/pounding_sweep/kernel/spec.py", "CONTACT_CAP = 0.25", "CONTACT_CAP = 0.5"
        ),
        r"source \(\w{60} there, \w{60} here\);",
    ),
    "a law": (
        lambda folder: edit(folder / "package/pounding_sweep/data/laws.toml", "0.75*(1 - e*e)", "0.7*(1 - e*e)"),
        r"source \(\w{60} there, \w{60} here\);",
    ),
    "the version": (lambda folder: installed(folder, "pounding_sweep"), r"package \(\S+ there, 9\.9 here\);"),
    "numba": (lambda folder: installed(folder, "numba"), r"libraries \(numba \S+, .* there, numba 9\.9, .* here\);"),
}


#: The package as it stands in a folder, in a process of its own.
PROGRAM = ("-m", "pounding_sweep")


@pytest.mark.slow  # by day a sweep and a source that differ are, in `test_execute`, and chunks, in `test_store`
@pytest.mark.parametrize("what", CHANGES)
def test_what_changed_is_named_and_nothing_stale_is_taken_up(stopped, tmp_path, what):
    folder = tmp_path / "study"
    shutil.copytree(stopped, folder)
    change, named = CHANGES[what]
    change(folder)
    before = {path.name: path.read_bytes() for path in (folder / PARTS).iterdir()}
    env = {"PYTHONPATH": str(folder / "package")}
    if named is None:  # the same chunks are taken up where nothing changed
        report = json.loads(cli(*CHANGED, "--json", cwd=folder, env=env, start=PROGRAM).stdout)["scenarios"]
        assert report["run"] == 0
        assert report["reused"] > 0
        return
    said = cli(*CHANGED, cwd=folder, env=env, code=2, start=PROGRAM).stderr
    assert re.search(rf"belong to another sweep: they differ in {named}", said)
    assert {path.name: path.read_bytes() for path in (folder / PARTS).iterdir()} == before
    assert not (folder / OUT).exists()
