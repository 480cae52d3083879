"""A text file beside the cube that says what ran, on what, for how long, and how it ended."""

from __future__ import annotations

import os
import platform
import shlex
import socket
import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pounding_sweep.run.execute import Progress

if TYPE_CHECKING:
    from distributed import Client

    from pounding_sweep.plan.plan import Plan

#: Logs of the runs of this process; each hears of every warning that is shown.
_OPEN: list[RunLog] = []


@dataclass(eq=False)
class RunLog(Progress):
    """Writes down a run and passes progress on to a display."""

    path: Path
    display: Progress
    warnings: set[str] = field(default_factory=set)  # that are in it
    _stage: str = ""
    _since: float = 0.0
    _count: int = 0

    def note(self, text: str) -> None:
        """Write a line with the time in front; after an error the log ends."""
        stamp = datetime.now().astimezone().isoformat(timespec="seconds")
        try:
            with self.path.open("a", encoding="utf-8", errors="backslashreplace") as file:
                file.write(f"{stamp} {' '.join(text.split())}\n")
        except OSError as error:
            msg = f"the log {str(self.path)!r} can't be written ({error.strerror or error}); the run goes on without"
            self.path = Path(os.devnull)
            warnings.warn(msg, RuntimeWarning, stacklevel=2)

    def stage(self, name: str, total: int) -> None:
        """End the stage before, and begin one of `total` steps, if it has a name; 0 stands for an unknown number."""
        if self._stage:
            seconds = time.perf_counter() - self._since
            self.note(f"stage {self._stage} ends: {self._count} done in {seconds:.3f} s")
        self._stage, self._since, self._count = name, time.perf_counter(), 0
        if name:
            self.note(f"stage {name} begins" + (f": {total}" if total else ""))
            self.display.stage(name, total)

    def advance(self, count: int) -> None:
        """Count steps of the stage as done."""
        self._count += count
        self.display.advance(count)

    def close(self) -> None:
        """End the stage and the display; may be called more than once."""
        self.stage("", 0)
        self.display.close()


@contextmanager
def run_log(
    path: Path, display: Progress, plan: Plan, scheduler: str | Client = "threads", workers: int = 1
) -> Iterator[RunLog]:
    """Log a run in a file, after those that are there: what runs and on what, and the warnings that are shown."""
    from pounding_sweep.run.diagnosis import installed_versions, processor

    log, started, show = RunLog(path, display), time.perf_counter(), warnings.showwarning
    if not hasattr(show, "writes_logs"):

        def show_and_log(message: Warning | str, *args: Any, **kwargs: Any) -> None:
            for other in tuple(_OPEN):
                if str(message) not in other.warnings:
                    other.warnings.add(str(message))
                    other.note(f"warning: {message}")
            show(message, *args, **kwargs)

        show_and_log.writes_logs = True  # type: ignore[attr-defined]
        warnings.showwarning = show_and_log
    _OPEN.append(log)
    cpu, ending, reason = processor(), "ended", ""
    where = scheduler if isinstance(scheduler, str) else str(scheduler.scheduler.address)
    where += "" if "://" in where else f", {workers} workers"
    versions = [f"{name} {version}" for name, version in installed_versions().items() if version]
    try:
        for line in (
            f"begins: {shlex.join(sys.argv)}",
            f"process {os.getpid()} on {socket.gethostname()}, in {Path.cwd()}",
            f"sweep {plan.digest} {plan.spec.title}".rstrip(),
            f"{plan.n_asked} scenarios asked, at most {plan.n_unique} to run, in {len(plan.uncoupled_runs)} motions",
            f"versions: {', '.join(versions)}",
            f"machine: {platform.platform()}, {cpu['name']}, vectors of {cpu['vector_bits']} bits, "
            f"{cpu['cores_usable']} of {cpu['cores']} cores; scheduler {where}",
        ):
            log.note(line)
        yield log
    except KeyboardInterrupt:
        ending = "interrupted"
        raise
    except BaseException as error:
        ending, reason = "failed", f": {type(error).__name__}: {error}"
        raise
    finally:
        log.close()
        log.note(f"{ending} after {time.perf_counter() - started:.1f} s{reason}")
        _OPEN.remove(log)
