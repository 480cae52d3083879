"""The display of a running sweep on the terminal."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from rich.progress import BarColumn, ProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bars
from rich.text import Text

from pounding_sweep.sweep.execute import Progress

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Task, TaskID

#: What the stages of a run are called on the display.
STAGES = {
    "kernels": "kernels",
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


class TerminalProgress(Progress):
    """Progress bars on stderr: stage, done and total, per second, time so far and left.

    Parameters
    ----------
    console : rich.console.Console, optional
        Where to draw; by default stderr.

    Notes
    -----
    One bar at a time; the display is removed when it is closed, so that only the
    summary stays.
    """

    def __init__(self, console: Console | None = None) -> None:
        if console is None:
            from rich.console import Console

            console = Console(stderr=True)
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

    def stage(self, name: str, total: int) -> None:
        """Begin a stage of `total` steps; 0 stands for an unknown number."""
        if self._task is None:
            self._bars.start()
        else:
            self._bars.remove_task(self._task)
        self._task = self._bars.add_task(STAGES.get(name, name), total=total if total > 0 else None)

    def advance(self, count: int) -> None:
        """Count steps of the stage as done."""
        if self._task is not None:
            self._bars.advance(self._task, count)

    def close(self) -> None:
        """Remove the display; may be called more than once."""
        self._bars.stop()
        self._task = None


def make_progress(quiet: bool = False) -> Progress:
    """Return a display for this process: silent if `quiet` or where stderr is not a terminal."""
    return Progress() if quiet or not sys.stderr.isatty() else TerminalProgress()
