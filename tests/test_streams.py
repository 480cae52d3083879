"""What a run does where nobody reads what it says, and where it is told, once or twice, to stop."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys

import pytest
from test_cli import TINY, cli, environment, same_data, write

from pounding_sweep.output import describe
from pounding_sweep.resume import ChunkStore
from pounding_sweep.run import cube_writer

pytestmark = pytest.mark.usefixtures("stub_module")

RUN = ("run", "sweep.toml", "-o", "out.nc")


@pytest.fixture(scope="module")
def stopped(tmp_path_factory, stub_module):
    """A run stopped before its cube, one of its chunks damaged, of which the next one warns; and the cube."""
    folder = tmp_path_factory.mktemp("stopped")
    write(folder, TINY)
    cli("run", "sweep.toml", "-o", "whole.nc", cwd=folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cube_writer, "write_cube_of", lambda *arguments, **more: terminate())
        cli(*RUN, cwd=folder, code=130)
    chunk = min((folder / "out.nc.parts").glob("chunk-*.npy"))
    content = chunk.read_bytes()
    chunk.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    return folder


def through(shell, folder, *args, **more):
    """Run the command line by a line of shell, in which it is "$@"."""
    command = ["sh", "-c", shell, "sh", sys.executable, "-m", "stub_engine", *args]
    return subprocess.run(command, cwd=folder, env=environment(), text=True, check=False, timeout=300, **more)


@pytest.mark.slow
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


@pytest.mark.parametrize("buffered", ["", pytest.param("1", marks=pytest.mark.slow)])
@pytest.mark.slow
def test_a_result_that_cannot_be_printed(stopped, tmp_path, buffered):
    """The cube is complete by then; one line says what failed, and that."""
    for name in ("sweep.toml", "whole.nc"):
        shutil.copy(stopped / name, tmp_path)
    full = f'PYTHONUNBUFFERED={buffered} "$@" >/dev/full'
    for command in (RUN, ("info", "out.nc"), ("laws",)):
        done = through(full, tmp_path, *command, stderr=subprocess.PIPE)
        assert done.returncode == 1
        assert done.stderr.removeprefix("compiling kernels, once for sweeps of this kind\n") == (
            "pounding-sweep: failed: stdout can't be written (No space left on device), give it another place"
            f"{'; the cube out.nc is complete' if command is RUN else ''}\n"
        )
    same_data(tmp_path / "out.nc", tmp_path / "whole.nc")


#: A command whose end in order takes long, as that of workers that are busy.
SLOW = """
import signal, time
from pounding_sweep.cli.app import reporting

signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the tests may have been begun by nohup
with reporting():
    try:
        print("begun", flush=True)
        time.sleep(600)
    finally:
        try:
            print("ending", flush=True)
            time.sleep(600)
        finally:
            print("told again", flush=True)
"""


@pytest.mark.parametrize("names", ["SIGINT SIGINT", pytest.param("SIGHUP SIGTERM", marks=pytest.mark.slow)])
def test_a_second_signal_does_not_wait_for_the_end_in_order(tmp_path, names):
    first, second = (signal.Signals[name] for name in names.split())
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", SLOW], cwd=tmp_path, env=environment(), text=True, **pipes) as process:
        assert process.stdout.readline() == "begun\n"
        process.send_signal(first)
        assert process.stdout.readline() == "ending\n"
        process.send_signal(second)
        assert process.communicate(timeout=300) == ("", "")
    assert process.returncode == 130


#: A command that sends itself a signal which it was started to ignore, and one which it was not.
SENT = """
import signal, sys
import typer
from pounding_sweep.cli.app import reporting

signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
ignored, other = (signal.Signals[name] for name in sys.argv[1:])
signal.signal(ignored, signal.SIG_IGN)
try:
    with reporting():
        signal.raise_signal(ignored)
        print("here", flush=True)
        signal.raise_signal(other)
        print("never here")
except typer.Exit as ended:
    sys.exit(ended.exit_code)
"""


@pytest.mark.parametrize("names", ["SIGINT SIGHUP", pytest.param("SIGHUP SIGTERM", marks=pytest.mark.slow)])
def test_what_is_ignored_stays_ignored(tmp_path, names):
    """As SIGHUP under nohup, or SIGINT in the background of a script; the others end the command."""
    done = cli(*names.split(), cwd=tmp_path, code=130, start=("-c", SENT))
    assert (done.stdout, done.stderr) == ("here\n", "pounding-sweep: interrupted\n")


@pytest.fixture
def when(monkeypatch):
    """Have something happen when a run comes to a function."""

    def happens(owner, name, event):
        real = getattr(owner, name)
        monkeypatch.setattr(owner, name, lambda *arguments, **more: (event(), real(*arguments, **more))[1])

    return happens


def terminate():
    signal.raise_signal(signal.SIGTERM)


@pytest.mark.parametrize(
    ("where", "older", "message"),
    [
        ((ChunkStore, "discard"), False, "the cube out.nc is complete"),
        pytest.param((describe, "summarize"), True, "the cube out.nc is complete", marks=pytest.mark.slow),
        (
            (cube_writer, "write_cube_of"),
            True,
            "what is finished is kept in {parts}: running the same command again continues from there",
        ),
    ],
)
def test_what_an_interrupted_run_leaves_is_told(stopped, tmp_path, when, where, older, message):
    """The cube, if it is this run's; an older one that it was to replace is none."""
    for name in ("sweep.toml", "whole.nc"):
        shutil.copy(stopped / name, tmp_path)
    more = []
    if older:
        shutil.copy(stopped / "whole.nc", tmp_path / "out.nc")
        more = ["--overwrite"]
    when(*where, terminate)
    done = cli(*RUN, *more, cwd=tmp_path, code=130)
    assert done.stdout == ""
    assert done.stderr == f"pounding-sweep: interrupted; {message.format(parts=tmp_path / 'out.nc.parts')}\n"
    same_data(tmp_path / "out.nc", tmp_path / "whole.nc")


def test_a_working_folder_that_is_removed(stopped, tmp_path, when):
    """What is said is what went wrong in the run."""
    folder = tmp_path / "work"
    folder.mkdir()
    shutil.copy(stopped / "sweep.toml", folder)
    when(cube_writer, "write_cube_of", lambda: shutil.rmtree(folder))
    done = cli(*RUN, cwd=folder, code=1)
    assert done.stdout == ""
    assert done.stderr.splitlines()[-1] == (
        f"pounding-sweep: failed: the folder '{folder}/out.nc.parts' was removed or moved during the run; "
        "run again, and leave it"
    )
    assert "Traceback" not in done.stderr
