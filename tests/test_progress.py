"""The display of a run: bars on a terminal, plain lines elsewhere; one that fails ends nothing."""

from __future__ import annotations

import io
import os
import re
import select
import subprocess
import sys
import threading
from types import SimpleNamespace

import pytest
from rich.console import Console
from scenes import AXES, motions, row
from test_cli import TINY, environment, write

from pounding_sweep.cli.progress import BETWEEN_LINES, LineProgress, TerminalProgress
from pounding_sweep.run.sweep import Sweep

pytestmark = pytest.mark.usefixtures("stub_module")

# -- bars --------------------------------------------------------------------------------------------------------------


def test_bars_are_shown_on_the_terminal_of_stderr(monkeypatch):
    shown = io.StringIO()
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    progress = TerminalProgress()
    progress.stage("scenarios", 2)
    progress.advance(2)
    progress.close()
    assert "scenarios" in shown.getvalue()
    assert "2/2" in shown.getvalue()


class Going(io.StringIO):
    """A terminal that is gone from a moment on."""

    def __init__(self):
        super().__init__()
        self.gone, self.refused, self.failed = False, 0, threading.Event()

    def write(self, text):
        if not self.gone:
            return super().write(text)
        self.refused += 1
        self.failed.set()
        raise OSError(5, "Input/output error")


@pytest.mark.parametrize("when", ["before", "stage", "thread", "close"])
def test_a_terminal_that_goes_away_is_told_nothing_more(when):
    file = Going()
    file.gone = when == "before"
    progress = TerminalProgress(Console(file=file, force_terminal=True, width=120))
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
    progress.close()
    assert file.refused == 1


#: Tells when it is about to write the cube, and waits for word to go on; stdout is the display's meanwhile.
WAITS = """
import os
import stub_engine
from pounding_sweep import cli
from pounding_sweep.run import cube_writer as filling

real = filling.write_cube_of

def waits(*arguments, **more):
    os.write(1, b"begun")
    os.read(0, 1)
    return real(*arguments, **more)

filling.write_cube_of = waits
stub_engine.install()
cli.main()
"""


@pytest.mark.slow  # a process of its own
def test_a_run_outlives_its_terminal(tmp_path):
    write(tmp_path, TINY)
    ours, theirs = os.openpty()
    command = [sys.executable, "-c", WAITS, "run", "sweep.toml", "-o", "out.nc"]
    more = {"cwd": tmp_path, "env": environment(TERM="xterm"), "start_new_session": True}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": theirs}
    with subprocess.Popen(command, **more, **pipes) as process:
        os.close(theirs)
        shown = b""
        while process.stdout not in (ready := select.select([ours, process.stdout], [], [], 300)[0]):
            assert ready
            shown += os.read(ours, 4096)
        assert process.stdout.read(5) == b"begun"
        os.close(ours)
        out, _ = process.communicate(b"y", timeout=300)
    assert b"scenarios" in shown
    assert process.returncode == 0
    assert out.splitlines()[-1] == b"out.nc"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.nc", "out.nc.log", "sweep.toml"]
    assert re.search(r" ended after \d+\.\d s$", (tmp_path / "out.nc.log").read_text())


# -- lines -------------------------------------------------------------------------------------------------------------


def test_lines_come_now_and_then_and_are_plain():
    stream, now = io.StringIO(), [0.0]
    progress = LineProgress(stream, lambda: now[0])
    progress.stage("no pounding", 4)
    progress.advance(4)
    progress.stage("scenarios", 10000)
    for _ in range(5):
        now[0] += 0.4 * BETWEEN_LINES
        progress.advance(1000)
    progress.stage("something else", 0)
    now[0] += BETWEEN_LINES
    progress.advance(3)
    progress.close()
    assert stream.getvalue().splitlines() == [
        "scenarios 3,000 of 10,000 (30%), about 84 s left",
        "something else 3",
    ]


def told(stream):
    """The time left in each line; None where none is told."""
    return [found and found[1] for found in (re.search(r"about (.*) left$", line) for line in stream)]


def test_time_left_of_a_run_that_continues():
    """What was kept is taken up at once, and says nothing about the rate."""
    stream, now = io.StringIO(), [0.0]
    progress = LineProgress(stream, lambda: now[0])
    progress.stage("scenarios", 100_000)
    for _ in range(90):
        now[0] += 0.01
        progress.advance(1000)
    for _ in range(10):  # ten scenarios a second
        now[0] += 31.0
        progress.advance(310)
    truth = [f"{round((10_000 - 310 * lines) / 10.0 / 60.0)} min" for lines in range(1, 11)]
    assert told(stream.getvalue().splitlines()) == truth


def test_time_left_where_a_line_comes_while_chunks_are_taken_up():
    """None is told then; and where taking up outlasts a line, the time is right from the second line after it."""
    stream, now = io.StringIO(), [0.0]
    progress = LineProgress(stream, lambda: now[0])
    now[0] += BETWEEN_LINES
    progress.stage("scenarios", 100_000)
    progress.advance(50_000)
    now[0] += BETWEEN_LINES
    progress.advance(40_000)
    for _ in range(2):
        now[0] += BETWEEN_LINES
        progress.advance(300)
    first, second, third, last = told(stream.getvalue().splitlines())
    assert first is None
    assert second == "7.5 s"
    assert (third, last) == ("16 min", "16 min")


def test_bars_of_a_run_that_continues(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("pounding_sweep.cli.progress.time", SimpleNamespace(monotonic=lambda: now[0]))
    file = io.StringIO()
    console = Console(file=file, force_terminal=True, width=120, get_time=lambda: now[0])
    progress = TerminalProgress(console)
    progress.stage("scenarios", 100_000)
    for _ in range(90):
        now[0] += 0.01
        progress.advance(1000)
    for _ in range(3):  # ten scenarios a second
        now[0] += 5.0
        progress.advance(50)
    [task] = progress._bars.tasks
    assert task.completed == 90_150
    assert task.speed == pytest.approx(10.0)
    assert task.time_remaining == 985
    progress.close()


def test_lines_have_no_control_characters(monkeypatch):
    """A whole run with a line at every step."""
    monkeypatch.setattr("pounding_sweep.cli.progress.BETWEEN_LINES", 0.0)
    stream = io.StringIO()
    Sweep(scene=row(), records=motions(), **AXES).run(progress=LineProgress(stream))
    said = stream.getvalue()
    assert re.search(r"^cube 180 of 180 \(100%\)$", said, re.MULTILINE)
    assert said.replace("\n", "").isprintable()


def test_a_reader_that_has_gone_does_not_end_the_run():
    theirs, ours = os.pipe()
    os.close(theirs)
    with os.fdopen(ours, "w") as stream:
        progress = LineProgress(stream, iter(range(0, 1000, 100)).__next__)
        progress.stage("scenarios", 2)
        progress.advance(1)
        progress.advance(1)
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
