"""The display of a running sweep: a bar on a terminal, now and then a line elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import IO, Any, cast

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bars

from pounding_sweep.base.text import seconds_text
from pounding_sweep.run.execute import STAGES, Progress

#: Seconds between two lines of progress.
BETWEEN_LINES = 30.0


class _LenientStream:
    """A stream whose errors end nothing: its terminal, or the reader of its pipe, may go away during a run."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write the text, if that is possible."""
        with suppress(OSError):
            self._stream.write(text)
            self._stream.flush()
        return len(text)

    def flush(self) -> None:
        """Do nothing: each text is flushed."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


class ProgressDisplay(Progress):
    """Stage, done, total and time left on stderr: a bar on a terminal, else a line every `BETWEEN_LINES` seconds."""

    def __init__(self, console: Console | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        console = console or Console(stderr=True, force_terminal=sys.stderr.isatty())
        console.file = cast("IO[str]", _LenientStream(console.file))  # a thread of the bars writes too
        columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
        self._bars = Bars(
            *columns,
            TextColumn("left"),
            TimeRemainingColumn(),
            console=console,
            transient=True,
            get_time=clock,
            speed_estimate_period=2.0 * BETWEEN_LINES,
        )
        self._stream, self._is_terminal, self._clock = console.file, console.is_terminal, clock
        self._begun = self._line = clock()

    def stage(self, name: str, total: int) -> None:
        """Begin a stage of `total` steps; 0 stands for an unknown number."""
        for task in self._bars.task_ids:
            self._bars.remove_task(task)
        self._bars.add_task(STAGES.get(name, name), total=total or None)
        self._begun = self._clock()
        if self._is_terminal:
            self._bars.start()
        elif name == "compiling":  # longer than many a run
            print("compiling kernels, once for sweeps of this kind", file=self._stream)

    def advance(self, count: int) -> None:
        """Count steps of the stage as done."""
        if not self._bars.tasks:
            return
        (task,), now = self._bars.tasks, self._clock()
        if now - self._begun < 1.0:
            task.completed += count  # without a rate: what an earlier run finished
        else:
            self._bars.advance(task.id, count)
        if now - self._line >= BETWEEN_LINES and not self._is_terminal:
            self._line = now
            share = f" of {task.total:,.0f} ({task.percentage:.0f}%)" if task.total else ""
            end = f", about {seconds_text(left)} left" if (left := task.time_remaining) else ""
            print(f"{task.description} {task.completed:,.0f}{share}{end}", file=self._stream)

    def close(self) -> None:
        """Remove the display; may be called more than once."""
        if self._is_terminal:
            self._bars.stop()
