"""The display of a run: bars on a terminal, plain lines elsewhere; one that fails ends nothing."""

from __future__ import annotations

import io
import re
import sys
import threading
import time
from itertools import count
from types import SimpleNamespace

import pytest
from rich.console import Console
from scenes import make

from pounding_sweep.cli.progress import BETWEEN_LINES, ProgressDisplay
from pounding_sweep.run import execute

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
