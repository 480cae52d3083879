"""A text file beside the cube that says what ran, on what, for how long, and how it ended."""

from __future__ import annotations

import os
import platform
import shlex
import socket
import sys
import time
import warnings
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pounding_sweep.output.results import Outcome
from pounding_sweep.run.execute import Progress

if TYPE_CHECKING:
    from distributed import Client

    from pounding_sweep.plan.plan import Plan


#: Logs of the runs of this process, which hear of every warning that is shown.
_OPEN: list[RunLog] = []


class RunLog(Progress):
    """Writes down a run, after those that were there before; passes progress on."""

    def __init__(self, path: Path, display: Progress) -> None:
        self.path, self._display = path, display
        self._started = time.perf_counter()
        self._stage, self._since, self._count = "", 0.0, 0
        self._written: set[str] = set()
        self._writable = True

    def __enter__(self) -> RunLog:
        _OPEN.append(self)
        show = warnings.showwarning
        if not hasattr(show, "tells_logs"):

            def show_and_log(message: Warning | str, *args: Any, **kwargs: Any) -> None:
                for log in tuple(_OPEN):
                    if (text := f"warning: {message}") not in log._written:
                        log._written.add(text)
                        log.info(text)
                show(message, *args, **kwargs)

            show_and_log.tells_logs = True  # type: ignore[attr-defined]
            warnings.showwarning = show_and_log
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, *_: Any) -> None:
        self.close()
        after = f"after {time.perf_counter() - self._started:.1f} s"
        if error is None:
            self.info(f"ended {after}")
        elif isinstance(error, KeyboardInterrupt):
            self.info(f"interrupted {after}")
        else:
            self.info(f"failed {after}: {type(error).__name__}: {error}")
        _OPEN.remove(self)

    def info(self, text: str) -> None:
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

        cpu = processor()
        where = scheduler if isinstance(scheduler, str) else str(scheduler.scheduler.address)
        where += "" if "://" in where else f", {workers} workers"
        versions = ", ".join(f"{name} {version}" for name, version in installed_versions().items() if version)
        for line in (
            f"begins: {shlex.join(sys.argv)}",
            f"process {os.getpid()} on {socket.gethostname()}, in {Path.cwd()}",
            f"sweep {plan.digest} {plan.spec.title}".rstrip(),
            f"{plan.n_asked} scenarios asked, at most {plan.n_unique} to run, in {len(plan.uncoupled_runs)} motions",
            f"versions: {versions}",
            f"machine: {platform.platform()}, {cpu['name']}, vectors of {cpu['vector_bits']} bits, "
            f"{cpu['cores_usable']} of {cpu['cores']} cores; scheduler {where}",
        ):
            self.info(line)

    def result(self, outcome: Outcome, cube: Path) -> None:
        """Write what came of it."""
        self.info(
            f"result: {outcome.run} scenarios run, {outcome.reused} kept from an interrupted run, "
            f"{outcome.untouched} never touch, {len(outcome.failures)} chunks failed, "
            f"{outcome.compiled} kernels compiled; {cube} has {cube.stat().st_size} bytes"
        )

    def stage(self, name: str, total: int) -> None:
        """Begin a stage of `total` steps; 0 stands for an unknown number."""
        self._end_stage()
        self._stage, self._since, self._count = name, time.perf_counter(), 0
        self.info(f"stage {name} begins" + (f": {total}" if total else ""))
        self._display.stage(name, total)

    def advance(self, count: int) -> None:
        """Count steps of the stage as done."""
        self._count += count
        self._display.advance(count)

    def note(self, text: str) -> None:
        """Write a line."""
        self.info(text)
        self._display.note(text)

    def close(self) -> None:
        """End the display; may be called more than once."""
        self._end_stage()
        self._display.close()

    def _end_stage(self) -> None:
        if self._stage:
            self.info(f"stage {self._stage} ends: {self._count} done in {time.perf_counter() - self._since:.3f} s")
            self._stage = ""
