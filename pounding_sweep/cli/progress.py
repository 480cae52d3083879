"""The display of a running sweep: bars on a terminal, now and then a line elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import IO, TYPE_CHECKING, Any, TextIO, cast

from rich.progress import BarColumn, ProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bars
from rich.text import Text

from pounding_sweep.base.tables import seconds_text
from pounding_sweep.run.execute import Progress

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Task, TaskID

#: Seconds between two lines of progress.
BETWEEN_LINES = 30.0
#: Seconds at the beginning of a stage that say nothing about its rate: what an earlier run finished is counted in them.
TAKING_UP = 1.0
#: What the stages of a run are called on the display.
STAGES = {
    "kernels": "kernels",
    "compiling": "compiling kernels",
    "no pounding": "runs without pounding",
    "scenarios": "scenarios",
    "audit": "audit",
    "cube": "cube",
}


class _Count(ProgressColumn):
    """Done of total; only what is done where the total is not known."""

    def render(self, task: Task) -> Text:
        """Write the count of one stage."""
        done = f"{task.completed:,.0f}"
        return Text(done if task.total is None else f"{done}/{task.total:,.0f}", style="progress.download")


class _Rate(ProgressColumn):
    """Steps per second."""

    def render(self, task: Task) -> Text:
        """Write the rate of one stage, once there is one."""
        speed = task.finished_speed or task.speed
        return Text(f"{speed:,.0f}/s" if speed else "", style="progress.data.speed")


class _Unfailing:
    """A stream that ends nothing when it fails, as a terminal that has gone: from then on nothing more is written."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream, self._gone = stream, False

    def write(self, text: str) -> int:
        """Write, if it can be."""
        self._attempt(self._stream.write, text)
        return len(text)

    def flush(self) -> None:
        """Flush, if it can be."""
        self._attempt(self._stream.flush)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def _attempt(self, what: Callable[..., object], *arguments: str) -> None:
        if self._gone:
            return
        try:
            what(*arguments)
        except OSError:
            self._gone = True


class TerminalProgress(Progress):
    """Progress bars on stderr, one at a time: stage, done and total, per second, time so far and left."""

    # the time left is that at the rate of the last half minute; steps of the first `TAKING_UP` seconds of a stage are
    # left out of it. A terminal that has gone does not end the run

    def __init__(self, console: Console | None = None) -> None:
        if console is None:
            from rich.console import Console

            console = Console(stderr=True)
        console.file = cast("IO[str]", _Unfailing(console.file))  # a thread of the bars writes too
        self._bars = Bars(
            TextColumn("{task.description}"),
            BarColumn(),
            _Count(),
            _Rate(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=console,
            transient=True,
        )
        self._task: TaskID | None = None
        self._begun = 0.0

    def stage(self, name: str, total: int) -> None:
        """Begin a stage of `total` steps; 0 stands for an unknown number."""
        if self._task is None:
            self._bars.start()
        else:
            self._bars.remove_task(self._task)
        self._task = self._bars.add_task(STAGES.get(name, name), total=total if total > 0 else None)
        self._begun = time.monotonic()

    def advance(self, count: int) -> None:
        """Count steps of the stage as done."""
        if self._task is None:
            return
        if time.monotonic() - self._begun < TAKING_UP:
            self._bars.tasks[-1].completed += count  # without a rate
        else:
            self._bars.advance(self._task, count)

    def close(self) -> None:
        """Remove the display; may be called more than once."""
        self._bars.stop()
        self._task = None


class LineProgress(Progress):
    """Lines of plain text, for stderr that goes into a file or a pipe: stage, done and total, time left."""

    # a line at most every `BETWEEN_LINES` seconds, so that short runs say nothing. The time left is that at the rate
    # since the line before, or since the stage began; steps of the first `TAKING_UP` seconds are left out of it

    def __init__(self, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream, self._clock = stream or sys.stderr, clock
        self._name, self._total, self._done = "", 0, 0
        self._begun = self._last = clock()
        self._since, self._before = self._begun, 0  # the rate counts from there

    def stage(self, name: str, total: int) -> None:
        """Begin a stage of `total` steps; 0 stands for an unknown number."""
        self._name, self._total, self._done = STAGES.get(name, name), total, 0
        self._begun = self._clock()
        if name == "compiling":  # once for a kind of row, but longer than many a run
            self._print("compiling kernels, once for sweeps of this kind")
        self._since, self._before = self._begun, 0

    def advance(self, count: int) -> None:
        """Count steps of the stage as done."""
        self._done += count
        now = self._clock()
        if now - self._begun < TAKING_UP:
            self._since, self._before = now, self._done
        if now - self._last >= BETWEEN_LINES:
            self._write(now)
            self._last = self._since = now
            self._before = self._done

    def _write(self, now: float) -> None:
        text = f"{self._name} {self._done:,}"
        if self._total:
            text += f" of {self._total:,} ({self._done / self._total:.0%})"
        rate = (self._done - self._before) / (now - self._since) if now > self._since else 0.0
        if rate and self._total:
            text += f", about {seconds_text((self._total - self._done) / rate)} left"
        self._print(text)

    def _print(self, text: str) -> None:
        with suppress(OSError):
            print(text, file=self._stream, flush=True)


def make_progress(quiet: bool = False) -> Progress:
    """Return a display for this process: silent if `quiet`, bars on a terminal, lines where stderr is none."""
    if quiet:
        return Progress()
    return TerminalProgress() if sys.stderr.isatty() else LineProgress()
