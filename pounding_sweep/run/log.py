"""A text file beside the cube that says what ran, on what, for how long, and how it ended."""

from __future__ import annotations

import os
import platform
import shlex
import socket
import sys
import threading
import time
import warnings
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pounding_sweep.output.results import Outcome
from pounding_sweep.run.execute import Progress

if TYPE_CHECKING:
    from distributed import Client

    from pounding_sweep.plan.plan import Plan


class _Hook:
    """Tells all open logs of warnings, in the place of `warnings.showwarning` from the first log to the last."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._logs: list[RunLog] = []
        self._installed: Callable[..., None] | None = None
        self._before: Callable[..., None] = warnings.showwarning

    def add(self, log: RunLog) -> None:
        """Tell a log of what is shown from now on."""
        with self._lock:
            self._logs.append(log)
            if warnings.showwarning is not self._installed:
                self._install()

    def remove(self, log: RunLog) -> None:
        """Tell a log no more."""
        with self._lock:
            self._logs.remove(log)
            if not self._logs and warnings.showwarning is self._installed:  # else somebody put theirs over it
                warnings.showwarning, self._installed = self._before, None

    def _install(self) -> None:
        before = warnings.showwarning

        def show(message: Warning | str, *more: Any, **named: Any) -> None:
            for log in tuple(self._logs):
                log.warned(str(message))
            before(message, *more, **named)

        self._before, self._installed = before, show
        warnings.showwarning = show


_HOOK = _Hook()


class RunLog(Progress):
    """Writes down a run, after those that were there before; passes progress on."""

    def __init__(self, path: Path, display: Progress) -> None:
        self.path, self._display = path, display
        self._started = time.perf_counter()
        self._stage: tuple[str, float] | None = None
        self._count = 0
        self._warned: set[str] = set()
        self._lock = threading.Lock()
        self._writable = True

    def __enter__(self) -> RunLog:
        _HOOK.add(self)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, *_: Any) -> None:
        try:
            self.close()
            after = f"after {time.perf_counter() - self._started:.1f} s"
            if error is None:
                self.say(f"ended {after}")
            elif isinstance(error, KeyboardInterrupt):
                self.say(f"interrupted {after}")
            else:
                self.say(f"failed {after}: {type(error).__name__}: {error}")
        finally:
            _HOOK.remove(self)

    def say(self, text: str) -> None:
        """Write a line with the time in front."""
        if not self._writable:
            return
        stamp = datetime.now().astimezone().isoformat(timespec="seconds")
        try:
            with self.path.open("a", encoding="utf-8", errors="backslashreplace") as file:
                file.write(f"{stamp} {' '.join(text.split())}\n")
        except OSError as error:
            self._writable = False
            msg = f"the log {str(self.path)!r} can't be written ({error.strerror or error}); the run goes on without"
            warnings.warn(msg, RuntimeWarning, stacklevel=2)

    def begin(self, plan: Plan, scheduler: str | Client, workers: int) -> None:
        """Write what is about to run, and on what."""
        from pounding_sweep.run.diagnosis import installed_versions, processor

        here = processor()
        scheduler = scheduler if isinstance(scheduler, str) else str(scheduler.scheduler.address)
        workers_text = "" if "://" in scheduler else f", {workers} workers"
        self.say(f"begins: {shlex.join(sys.argv)}")
        self.say(f"process {os.getpid()} on {socket.gethostname()}, in {_working_folder()}")
        self.say(f"sweep {plan.digest} {plan.spec.title}".rstrip())
        self.say(
            f"{plan.n_asked} scenarios asked, at most {plan.n_unique} to run, in {len(plan.uncoupled_runs)} motions"
        )
        self.say("versions: " + ", ".join(f"{name} {version}" for name, version in installed_versions().items()))
        self.say(
            f"machine: {platform.platform()}, {here['name']}, vectors of {here['vector_bits']} bits, "
            f"{here['cores_usable']} of {here['cores']} cores; scheduler {scheduler}{workers_text}"
        )

    def result(self, outcome: Outcome, cube: Path) -> None:
        """Write what came of it."""
        self.say(
            f"result: {outcome.run} scenarios run, {outcome.reused} kept from an interrupted run, "
            f"{outcome.untouched} never touch, {len(outcome.failures)} chunks failed, "
            f"{outcome.compiled} kernels compiled; {cube} has {cube.stat().st_size} bytes"
        )

    def stage(self, name: str, total: int) -> None:
        """Begin a stage of `total` steps; 0 stands for an unknown number."""
        self._end_stage()
        self._stage, self._count = (name, time.perf_counter()), 0
        self.say(f"stage {name} begins" + (f": {total}" if total else ""))
        self._display.stage(name, total)

    def advance(self, count: int) -> None:
        """Count steps of the stage as done."""
        self._count += count
        self._display.advance(count)

    def note(self, text: str) -> None:
        """Write a line."""
        self.say(text)
        self._display.note(text)

    def close(self) -> None:
        """End the display; may be called more than once."""
        self._end_stage()
        self._display.close()

    def _end_stage(self) -> None:
        if self._stage is not None:
            name, since = self._stage
            self.say(f"stage {name} ends: {self._count} done in {time.perf_counter() - since:.3f} s")
            self._stage = None

    def warned(self, text: str) -> None:
        """Write a warning, once."""
        with self._lock:  # in whatever thread it was shown
            known = text in self._warned
            self._warned.add(text)
        if not known:
            self.say(f"warning: {text}")


def _working_folder() -> str:
    try:
        return str(Path.cwd())
    except OSError:
        return "a folder that is gone"
