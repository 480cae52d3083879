"""What a run does where nobody reads what it says, and where it is told twice to stop."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys

import pytest
from test_cli import TINY, cli, environment, same_data, write
from test_faults import STOPPED

from pounding_sweep.sweep.store import MANIFEST

RUN = ("run", "sweep.toml", "-o", "out.nc")


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    """A run stopped before its cube, one of its chunks damaged, of which the next one warns; and the cube."""
    folder = tmp_path_factory.mktemp("stopped")
    write(folder, TINY)
    cli("run", "sweep.toml", "-o", "whole.nc", cwd=folder)
    cli(*RUN, cwd=folder, code=130, start=("-c", STOPPED))
    chunk = min((folder / "out.nc.parts").glob("chunk-*.npy"))
    content = chunk.read_bytes()
    chunk.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    return folder


def through(shell, folder, *args, **more):
    """Run the command line by a line of shell, in which it is "$@"."""
    command = ["sh", "-c", shell, "sh", sys.executable, "-m", "pounding_sweep", *args]
    return subprocess.run(command, cwd=folder, env=environment(), text=True, check=False, timeout=300, **more)


@pytest.mark.parametrize("where", ["gone", "full", "closed"])
def test_a_warning_that_nobody_reads_ends_nothing(stopped, tmp_path, where):
    folder = tmp_path / "study"
    shutil.copytree(stopped, folder)
    if where == "gone":
        theirs, ours = os.pipe()
        os.close(theirs)
        done = through('"$@"', folder, *RUN, stdout=subprocess.PIPE, stderr=ours)
        os.close(ours)
    else:
        redirected = {"full": '"$@" 2>/dev/full', "closed": '"$@" 2>&-'}[where]
        done = through(redirected, folder, *RUN, stdout=subprocess.PIPE)
    assert done.returncode == 0
    assert done.stdout.splitlines()[-1] == "out.nc"
    assert "pounding-sweep: warning" not in done.stdout
    same_data(folder / "out.nc", folder / "whole.nc")
    told = (folder / "out.nc.log").read_text()
    assert re.search(r"warning: chunk .* is damaged: .*; it is computed again$", told, re.MULTILINE)
    assert not (folder / "out.nc.parts").exists()


@pytest.mark.parametrize("closed", [">&-", "<&- >&- 2>&-"])
def test_streams_that_are_closed(stopped, tmp_path, closed):
    """What is opened in their place is no file of the run, into which somebody might print."""
    for name in ("sweep.toml", "whole.nc"):
        shutil.copy(stopped / name, tmp_path)
    said = subprocess.PIPE if "2>" not in closed else None
    done = through(f'"$@" {closed}', tmp_path, *RUN, stderr=said)
    assert (done.returncode, done.stderr or "") == (0, "")
    same_data(tmp_path / "out.nc", tmp_path / "whole.nc")
    assert through(f'"$@" {closed}', tmp_path, "info", "out.nc").returncode == 0


@pytest.mark.parametrize("buffered", ["", "1"])
def test_a_result_that_cannot_be_printed(stopped, tmp_path, buffered):
    """The cube is complete by then; one line says what failed."""
    for name in ("sweep.toml", "whole.nc"):
        shutil.copy(stopped / name, tmp_path)
    full = f'PYTHONUNBUFFERED={buffered} "$@" >/dev/full'
    for command in (RUN, ("info", "out.nc"), ("laws",)):
        done = through(full, tmp_path, *command, stderr=subprocess.PIPE)
        assert done.returncode == 1
        assert done.stderr == (
            "pounding-sweep: failed: stdout can't be written (No space left on device), give it another place\n"
        )
    same_data(tmp_path / "out.nc", tmp_path / "whole.nc")


SLEEPS = """
import signal, sys, time
from pounding_sweep import cli
from pounding_sweep.sweep import execute

signal.signal(signal.SIGINT, signal.default_int_handler)
real = execute.run_chunk

def run_chunk(kernel, *more):
    if kernel.law.key == "none":
        return real(kernel, *more)
    time.sleep(0.5)  # until then the main thread waits, and can be interrupted in that
    print("begun", flush=True)
    time.sleep(600)

execute.run_chunk = run_chunk
cli.main()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_second_signal_does_not_wait(stopped, tmp_path, number):
    shutil.copy(stopped / "sweep.toml", tmp_path)
    how = {"cwd": tmp_path, "env": environment(), "text": True, "stdin": subprocess.DEVNULL}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", SLEEPS, *RUN], **how, **pipes) as process:
        assert process.stdout.readline() == "begun\n"
        process.send_signal(number)
        said = process.stderr.readline()
        process.send_signal(number)
        assert process.wait(timeout=300) == 130
    kept = (tmp_path / "out.nc.parts" / MANIFEST).read_text().count("\n")
    assert said == (
        f"pounding-sweep: interrupted; {kept} finished chunks are kept in {tmp_path}/out.nc.parts: "
        "running the same command again continues from there\n"
    )
    assert kept == 1
