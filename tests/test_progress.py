"""What a run tells: its display, the log beside the cube, where nobody reads it, and where it is told to stop."""

from __future__ import annotations

import io
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
import warnings
from contextlib import ExitStack
from datetime import datetime
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console
from scenes import make
from test_cli import TINY, cli, environment, same_data, write
from test_limits import At, stop

from pounding_sweep.cli.progress import BETWEEN_LINES, ProgressDisplay
from pounding_sweep.output import describe
from pounding_sweep.output.dataset import package_version
from pounding_sweep.resume import ChunkStore
from pounding_sweep.run import cube_writer, execute
from pounding_sweep.run.execute import Progress
from pounding_sweep.run.folder import run_log
from pounding_sweep.run.sweep import load_sweep

pytestmark = pytest.mark.usefixtures("stub_module")


def test_bars_are_shown_on_the_terminal_of_stderr(monkeypatch):
    shown = io.StringIO()
    shown.isatty = lambda: True
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setenv("TERM", "xterm")
    progress = ProgressDisplay()
    progress.advance(1)  # before any stage: nothing to count
    for stage, total in (("kernels", 0), ("scenarios", 2000)):
        progress.stage(stage, total)
        progress.advance(2000)
    progress.close()
    progress.close()
    assert "scenarios" in shown.getvalue()
    assert "2000/2000" in shown.getvalue()


class Going(io.StringIO):
    """A terminal that is gone from a moment on."""

    def __init__(self):
        super().__init__()
        self.gone, self.failed = False, threading.Event()

    def write(self, text):
        if not self.gone:
            return super().write(text)
        self.failed.set()
        raise OSError(5, "Input/output error")


@pytest.mark.parametrize("when", ["before", "stage", "thread", "close"])
def test_a_terminal_that_goes_away_does_not_end_the_run(when):
    file = Going()
    file.gone = when == "before"
    progress = ProgressDisplay(Console(file=file, force_terminal=True, width=120))
    progress.stage("kernels", 1)
    file.gone |= when == "stage"
    progress.advance(1)
    progress.stage("scenarios", 3)
    if when == "thread":
        file.gone = True
        assert file.failed.wait(60)  # of what draws now and then
    file.gone = True
    progress.advance(3)
    progress.close()


def lines_of(*events):
    """The lines that a display writes where there is no terminal, of (seconds that pass, stage or count of steps)."""
    stream, now = io.StringIO(), [0.0]
    progress = ProgressDisplay(Console(file=stream, force_terminal=False), lambda: now[0])
    for seconds, event in events:
        now[0] += seconds
        if isinstance(event, tuple):
            progress.stage(*event)
        else:
            progress.advance(event)
    progress.close()
    return stream.getvalue().splitlines()


def test_lines_come_now_and_then_and_are_plain():
    assert lines_of(
        (0.0, ("no pounding", 4)),
        (0.0, 4),
        (0.0, ("scenarios", 10000)),
        *[(0.4 * BETWEEN_LINES, 1000)] * 5,
        (0.0, ("something else", 0)),
        (BETWEEN_LINES, 3),
    ) == ["scenarios 3,000 of 10,000 (30%), about 84 s left", "something else 3"]
    assert lines_of((0.0, ("kernels", 1)), (1.0, 1)) == []
    assert lines_of((0.0, ("compiling", 2))) == ["compiling kernels, once for sweeps of this kind"]


def test_time_left_of_a_run_that_continues():
    """Chunks of an earlier run are counted at once, and say nothing about the rate."""
    lines = lines_of((0.0, ("scenarios", 100_000)), *[(0.01, 1000)] * 90, *[(31.0, 310)] * 10)  # ten a second
    left = [re.search(r"about (.*) left$", line) for line in lines]
    truth = [f"{round((10_000 - 310 * count) / 10.0 / 60.0)} min" for count in range(1, 11)]
    assert [each and each[1] for each in left] == [None, *truth[1:]]


def test_lines_have_no_control_characters(monkeypatch):
    """A whole run with a line at every step."""
    monkeypatch.setattr("pounding_sweep.cli.progress.BETWEEN_LINES", 0.0)
    stream = io.StringIO()
    progress = ProgressDisplay(Console(file=stream, force_terminal=False))
    make().run(progress=progress)
    said = stream.getvalue()
    assert re.search(r"^cube 180 of 180 \(100%\)$", said, re.MULTILINE)
    assert said.replace("\n", "").isprintable()


def test_notebooks_show_a_bar_while_a_sweep_runs(monkeypatch):
    """It is there while the run goes on, and gone at its end; elsewhere nothing is shown."""
    ipython = pytest.importorskip("IPython")
    pytest.importorskip("IPython.display")
    shown = []
    monkeypatch.setattr("IPython.display.display", lambda html, **how: shown.append((html.data, how)))
    clocks = SimpleNamespace(monotonic=count().__next__, perf_counter=time.perf_counter)
    monkeypatch.setattr(execute, "time", clocks)
    make().run(workers=1)
    assert not shown
    monkeypatch.setattr(ipython, "get_ipython", lambda: SimpleNamespace(kernel=None))
    make().run(workers=1)
    assert [how["update"] for _, how in shown] == [False] + [True] * (len(shown) - 1)
    assert len({how["display_id"] for _, how in shown}) == 1
    (of_scenarios, *_) = [html for html, _ in shown if html.startswith("scenarios")]
    assert re.fullmatch(r'scenarios <progress max="(\d+)" value="0"></progress> 0 of \1', of_scenarios)
    assert shown[-1][0] == ""


def lines(path):
    """The lines of a log without their times, which are checked."""
    found = [line.split(" ", 1) for line in path.read_text(encoding="utf-8").splitlines()]
    times = [datetime.fromisoformat(stamp) for stamp, _ in found]
    assert times == sorted(times)
    assert all(time.tzinfo is not None for time in times)
    return [text for _, text in found]


def test_a_log_of_the_command_line(tmp_path):
    sweep = write(tmp_path, TINY)
    done = cli("run", sweep, "-o", "out.nc", cwd=tmp_path)
    assert {*done.stderr.splitlines()} <= {"compiling kernels, once for sweeps of this kind"}
    told = lines(tmp_path / "out.nc.log")
    assert re.fullmatch(rf"begins: \S+ run {re.escape(str(sweep))} -o out\.nc", told[0])
    assert re.fullmatch(rf"process \d+ on \S+, in {re.escape(str(tmp_path))}", told[1])
    assert told[2] == f"sweep {load_sweep(sweep).plan().digest} Tiny"
    assert f"pounding-sweep {package_version()}" in told[4]
    assert f"numpy {np.__version__}," in told[4]
    assert told[5].startswith("machine: ")
    assert told[5].endswith(f"scheduler threads, {len(os.sched_getaffinity(0))} workers")
    stages = [line.split()[1] for line in told if re.match(r"stage .* ends: ", line)]
    assert stages[0] in ("kernels", "compiling")
    assert [stage for stage in stages[1:] if stage != "compiling"] == ["no", "scenarios", "audit", "cube"]
    assert re.search(r"stage cube ends: 12 done in \d+\.\d{3} s", "\n".join(told))
    size = (tmp_path / "out.nc").stat().st_size
    assert told[-2].startswith(
        "result: 5 scenarios run, 0 kept from an interrupted run, 2 never touch, 0 chunks failed"
    )
    assert told[-2].endswith(f"{tmp_path / 'out.nc'} has {size} bytes")
    assert re.fullmatch(r"ended after \d+\.\d s", told[-1])


def test_runs_stand_one_after_another_and_tell_how_they_ended(tmp_path, monkeypatch):
    out, log = tmp_path / "out.nc", tmp_path / "out.nc.log"

    with pytest.raises(KeyboardInterrupt):
        make().run(out, progress=At("audit", stop))
    assert lines(log)[-1].startswith("interrupted after ")
    with monkeypatch.context() as patch:
        patch.setattr(execute, "untouched", lambda plan, closing: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            make().run(out)
    assert re.fullmatch(r"failed after \d+\.\d s: ZeroDivisionError: division by zero", lines(log)[-1])
    before = lines(log)
    make().run(out).close()
    assert lines(log)[: len(before)] == before
    assert lines(log)[-1].startswith("ended after ")
    assert sum(line.startswith("begins: ") for line in lines(log)) == 3


def test_a_run_in_memory_or_that_may_not_begin_leaves_no_log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    make().run()
    (tmp_path / "out.nc").write_text("precious")
    with pytest.raises(OSError, match="exists"):
        make().run(tmp_path / "out.nc")
    assert [path.name for path in tmp_path.iterdir()] == ["out.nc"]


def test_warnings_are_in_the_logs_of_runs_that_overlap(tmp_path):
    """The first to begin ends first, as runs of two threads may: each log tells those of its time, once each."""
    shown, plan = [], make().plan()
    with warnings.catch_warnings(), ExitStack() as first, ExitStack() as second:
        warnings.simplefilter("always")
        warnings.showwarning = lambda message, *args, **kwargs: shown.append(str(message))
        first.enter_context(run_log(tmp_path / "first", Progress(), plan))
        for text in ("one", "two", "two", "three", "four"):
            if len(shown) == 1:
                second.enter_context(run_log(tmp_path / "second", Progress(), plan))
            if text == "three":
                first.close()
            if text == "four":
                second.close()
            warnings.warn(text, UserWarning, stacklevel=1)
    assert shown == ["one", "two", "two", "three", "four"]
    assert lines(tmp_path / "first")[6:-1] == ["warning: one", "warning: two"]
    assert lines(tmp_path / "second")[6:-1] == ["warning: two", "warning: three"]


def test_a_log_that_cannot_be_written_stops_nothing(tmp_path):
    (tmp_path / "out.nc.log").mkdir()
    with pytest.warns(RuntimeWarning, match=r"log' can't be written \(Is a directory\); .*goes on") as caught:
        make().run(tmp_path / "out.nc").close()
    assert len(caught) == 1


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
