"""What a run leaves in its folder: a cube, finished chunks, and a log of what ran, on what, and how it ended."""

from __future__ import annotations

import os
import platform
import shlex
import socket
import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import RunError, WriteError
from pounding_sweep.output.netcdf import check_output, check_space
from pounding_sweep.resume import ChunkStore, identity_of, parts_folder
from pounding_sweep.run.diagnosis import check_memory, installed_versions, processor
from pounding_sweep.run.execute import Progress
from pounding_sweep.variables.registry import Status

if TYPE_CHECKING:
    from distributed import Client

    from pounding_sweep.output.results import Outcome
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


@dataclass
class RunFolder:
    """Where a run leaves its results: a file, with chunks and a log beside it, or memory alone."""

    target: Path | None
    progress: Progress
    store: ChunkStore | None = None

    def check_results(self, outcome: Outcome) -> None:
        """Raise `RunError` where a file is there and no scenario has a result to replace it by."""
        failures, status = outcome.failures, outcome.results.status
        without = np.isin(status, [Status.NOT_RUN, Status.BEYOND_STABILITY_LIMIT])
        if self.target is not None and self.target.exists() and failures and without.all():
            raise RunError(
                f"no scenario has a result, all {len(failures)} chunks failed ({failures[0]}): "
                f"{str(self.target)!r} stays as it was; see to what failed and run again"
            )

    def finish(self, outcome: Outcome) -> None:
        """Say in the log what the run came to, and remove the chunks of a complete cube."""
        self.progress.close()
        outcome.results.tables.clear()  # status and touched remain
        self.progress.note(
            f"result: {outcome.run} scenarios run, {outcome.reused} kept from an interrupted run, "
            f"{outcome.untouched} never touch, {len(outcome.failures)} chunks failed, "
            f"{outcome.compiled} kernels compiled"
            + (f"; {self.target} has {self.target.stat().st_size} bytes" if self.target else "")
        )
        if self.store is not None and not outcome.failures:
            try:
                self.store.discard()
            except OSError as error:
                msg = f"the cube {str(self.target)!r} is complete, but not all of its chunks are removed: {error}"
                warnings.warn(msg, RuntimeWarning, stacklevel=4)


@contextmanager
def run_folder(
    target: Path | None,
    plan: Plan,
    display: Progress,
    scheduler: str | Client,
    workers: int,
    *,
    overwrite: bool,
    at_once: bool,
) -> Iterator[RunFolder]:
    """Keep other runs out of the folder of a run, log it there, and say what is wrong if the folder is removed."""
    if target is None:
        check_memory(plan.n_asked, 3 * plan.bytes_per_scenario, "the cube of", "give an output file")
        with closing(display):
            yield RunFolder(None, display)
        return
    store = ChunkStore(parts_folder(target), identity_of(plan), at_once=at_once)
    with store.lock():
        check_output(target, overwrite)  # a run that ended just now may have made it
        needed = (plan.n_asked + plan.n_unique) * plan.bytes_per_scenario
        needed -= sum(store.path(key).stat().st_size for key in store.completed())
        check_space(target.parent, needed, f"the cube of {plan.n_asked:,} scenarios, with its chunks,")
        with run_log(Path(f"{target}.log"), display, plan, scheduler, workers) as log:
            try:
                yield RunFolder(target, log, store)
            except OSError as error:
                if store.folder.is_dir():
                    raise
                raise WriteError(
                    f"the folder {str(store.folder)!r} was removed or moved during the run; run again, and leave it"
                ) from error
