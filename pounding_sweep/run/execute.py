"""Running a plan: kernels made ready, chunks fanned out to workers, results kept.

Workers return tables; only this process writes. A chunk that fails costs its
own scenarios (status ``not_run``), never the batch.
"""

from __future__ import annotations

import inspect
import linecache
import os
import re
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import InputError, RunError, unknown
from pounding_sweep.engine.compile import still_to_compile
from pounding_sweep.engine.row_kernel import RowKernel
from pounding_sweep.model.variants import Variants
from pounding_sweep.output.results import Outcome, Results, to_table
from pounding_sweep.outputs.variables import Status, cube_variables
from pounding_sweep.plan.plan import Plan, untouched
from pounding_sweep.plan.scenarios import Chunk, ChunkTask, Scenarios
from pounding_sweep.records import Record
from pounding_sweep.resume.checkpoint import ChunkCorrupt
from pounding_sweep.run.chunk_writer import ChunkWriter
from pounding_sweep.run.pool import Dispatcher
from pounding_sweep.run.refinement import run_scenarios

if TYPE_CHECKING:
    from distributed import Client

    from pounding_sweep.resume.reuse import EarlierCube

#: Names of the schedulers that start on this machine.
SCHEDULERS = ("threads", "processes", "synchronous")


@dataclass
class Progress:
    """What a display is told while a sweep runs; this one is silent."""

    # `stage` names what goes on; `advance` counts scenarios

    def stage(self, name: str, total: int) -> None:
        """Begin a stage of `total` steps."""

    def advance(self, count: int) -> None:
        """Count steps of the stage as done."""

    def note(self, text: str) -> None:
        """Hear of something that is worth a line in a log: workers that come and go."""

    def close(self) -> None:
        """End the display."""


def run_chunk(
    kernel: RowKernel, record: Record, table: Scenarios, variants: Variants, outputs: Sequence[str]
) -> np.ndarray | str:
    """Run the scenarios of one chunk; returns their table of results, or what went wrong."""
    try:
        found = run_scenarios(kernel, record, table, variants, outputs)
        return to_table(found, found, kernel.scene)
    except Exception as error:  # reported with the chunk: a batch never dies of one scenario
        return f"{type(error).__name__}: {error}"


def is_client(scheduler: object) -> bool:
    """Whether it is a client of a dask cluster."""
    return hasattr(scheduler, "submit") and hasattr(scheduler, "scheduler_info")


def check_scheduler(scheduler: str | Client, workers: int | None) -> int:
    """Return the number of workers.

    Raises
    ------
    InputError
        The scheduler is unknown, or `workers` is no whole number of at least 1.
    RunError
        Processes are asked for by a script without ``if __name__ == "__main__":``.
    """
    if not is_client(scheduler):
        _check_name(scheduler)
    elif getattr(scheduler, "asynchronous", False):
        raise InputError(
            "the dask client is asynchronous; give one made without asynchronous=True, or the scheduler's address"
        )
    if scheduler == "processes":
        check_main_guard()
    if workers is None:
        return 1 if scheduler == "synchronous" else len(os.sched_getaffinity(0))
    if not isinstance(workers, int | np.integer) or workers < 1:
        raise InputError(f"workers = {workers!r} must be a whole number, at least 1")
    return int(workers)


def _check_name(scheduler: object) -> None:
    """Raise `InputError` unless a text names a scheduler."""
    if not isinstance(scheduler, str) or (scheduler not in SCHEDULERS and "://" not in scheduler):
        raise InputError(unknown("scheduler", scheduler, [*SCHEDULERS, "tcp://HOST:PORT", "a dask Client"]))
    if re.match(r"(tcp|tls)://", scheduler) and not re.search(r":\d+/?$", scheduler):
        raise InputError(
            f"the address {scheduler!r} has no port; give one such as {scheduler.partition(':')[0]}://HOST:8786"
        )


def check_main_guard() -> None:
    """Raise `RunError` if the running script would start its processes again in each of them, which import it."""
    main = sys.modules.get("__main__")
    file, spec = getattr(main, "__file__", None), getattr(main, "__spec__", None)
    if file is None or (spec is not None and spec.name.endswith("__main__")):
        return  # a notebook or an interpreter, or `python -m PACKAGE`
    frame = inspect.currentframe()
    while frame is not None and not (frame.f_code.co_name == "<module>" and frame.f_globals is vars(main)):
        frame = frame.f_back
    lines = linecache.getlines(file)
    line = lines[frame.f_lineno - 1] if frame is not None and lines else ""
    has_guard = any("__name__" in each for each in lines)
    if not line or (has_guard and (line[0].isspace() or "__name__" in line)):
        return
    raise RunError(
        f"{file}:{lines.index(line) + 1}: the new processes import this script and would run this line again. Put it "
        f'below a guard:\n\n    if __name__ == "__main__":\n        {line.strip()}\n\n'
        'or run with scheduler="threads"'
    )


def dispatcher_for(
    plan: Plan, scheduler: str | Client = "threads", workers: int | None = None, progress: Progress | None = None
) -> Dispatcher:
    """Return the workers of a run; see `check_scheduler` for what is valid. `progress` hears of them."""
    note = (progress or Progress()).note
    return Dispatcher(scheduler, check_scheduler(scheduler, workers), plan.spec.records, run_chunk, note)


def execute(
    plan: Plan,
    dispatcher: Dispatcher,
    *,
    writer: ChunkWriter | None = None,
    progress: Progress | None = None,
    earlier: EarlierCube | None = None,
) -> Outcome:
    """Run a plan and keep the results of its unique scenarios."""
    progress = progress or Progress()
    shapes = plan.shapes()
    to_compile, _ = still_to_compile(shapes)
    progress.stage("compiling" if to_compile else "kernels", len(shapes))
    started = time.perf_counter()
    compiled = dispatcher.prepare(shapes, progress.advance)
    results = Results(cube_variables(plan.outputs), plan.spec.scene, len(plan.unique))
    results.status[plan.refused] = Status.BEYOND_STABILITY_LIMIT
    outcome = Outcome(results, compiled=compiled, compile_seconds=time.perf_counter() - started)
    outcome.taken_from = None if earlier is None else earlier.origin
    started = time.perf_counter()
    if shapes:
        stages = _Stages(plan, outcome, writer, dispatcher, progress, earlier)
        stages.without_pounding()
        stages.scenarios()
        if writer is not None and outcome.failures:
            writer.flush()  # the next run makes what is missing
    outcome.run_seconds = time.perf_counter() - started
    if outcome.taken_from is not None:
        progress.note(f"{outcome.taken} scenarios taken from {outcome.taken_from['file']}")
    if outcome.failures:
        shown_failures = "; ".join(sorted(set(outcome.failures))[:3])
        warnings.warn(
            f"{len(outcome.failures)} chunks have no result (status not_run): {shown_failures}",
            RuntimeWarning,
            stacklevel=2,
        )
    return outcome


@dataclass
class _Stages:
    """The two stages of a run: the runs without pounding, and what may touch by them."""

    plan: Plan
    outcome: Outcome
    writer: ChunkWriter | None
    dispatcher: Dispatcher
    progress: Progress
    earlier: EarlierCube | None

    def without_pounding(self) -> None:
        """Run those that are worth it, and find the scenarios that never touch: they are answered by it."""
        plan, outcome, results = self.plan, self.outcome, self.outcome.results
        contacts, n = plan.spec.scene.contacts, len(plan.uncoupled_runs)
        closing = np.full((n, len(contacts)), np.inf)
        status, slot = np.full(n, int(Status.NOT_RUN), np.int8), np.full(n, -1)

        def keep(rows: np.ndarray, table: np.ndarray, slots: np.ndarray) -> None:
            status[rows], slot[rows] = table["status"], slots
            ok = table["status"] == Status.OK
            for j, contact in enumerate(contacts):
                found = table["closing_max"][:, contact.place, contact.storey - 1]
                closing[rows, j] = np.where(ok, found, np.inf)

        outputs = (*plan.outputs, "closing_max")
        runs, worth = plan.uncoupled_runs, plan.uncoupled_to_run
        self._run("no pounding", worth, runs, outputs, keep, plan.uncoupled_chunks, closing=True)
        left_out = untouched(plan, closing) & ~plan.refused
        outcome.left_out = left_out
        outcome.untouched = int((left_out & ~plan.no_contact).sum())
        rows = np.flatnonzero(left_out)
        run = plan.uncoupled_of[rows]
        results.answer(rows, slot[run], status[run], touched=False)

    def scenarios(self) -> None:
        """Run the scenarios that may touch."""
        plan, results, left_out = self.plan, self.outcome.results, self.outcome.left_out
        assert left_out is not None

        def keep(rows: np.ndarray, table: np.ndarray, slots: np.ndarray) -> None:
            results.answer(rows, slots, table["status"], np.isfinite(table["steps_per_contact"]))

        rows = np.flatnonzero(~left_out & ~plan.refused).astype(np.int32)
        self._run("scenarios", rows, plan.unique, plan.outputs, keep, plan.chunks)

    def _run(
        self,
        stage: str,
        rows: np.ndarray,
        table: Scenarios,
        outputs: tuple[str, ...],
        keep: Callable[[np.ndarray, np.ndarray, np.ndarray], None],
        cut: Callable[[np.ndarray], list[Chunk]],
        *,
        closing: bool = False,
    ) -> None:
        """Take rows of a table from the store and the earlier cube, run the others in the chunks that `cut` makes.

        `keep` gets rows, results and where these stand.
        """
        plan, outcome, results = self.plan, self.outcome, self.outcome.results
        self.progress.stage(stage, len(rows))
        missing, known = np.zeros(len(table), bool), []
        missing[rows] = True

        def answer(chunk: Chunk, found: np.ndarray, read: Callable[[], np.ndarray] | None = None, **origin: Any) -> int:
            index, slots = results.hold(found, read)
            new = missing[chunk.rows]
            keep(chunk.rows[new], found[new], slots[new])
            missing[chunk.rows] = False
            if self.writer is not None and read is None:
                self.writer.save(chunk, found, partial(results.move, index), stage=stage, **origin)
            if new.any():
                self.progress.advance(int(new.sum()))
            return int(new.sum())

        for chunk, found, read, origin in self._stored(stage):
            n = answer(chunk, found, read)
            if self._is_taken(origin):
                outcome.taken += n
            else:
                outcome.reused += n
            known.append(chunk)
        if self.earlier is not None and not closing:
            for chunk, found in self.earlier.chunks(np.flatnonzero(missing)):
                outcome.taken += answer(chunk, found, origin=self.earlier.origin)
                known.append(chunk)
        waiting = cut(np.flatnonzero(missing))
        if self.writer is not None:
            self.writer.expect(plan, stage, [*known, *waiting])

        def task_of(position: int) -> ChunkTask:
            chunk = waiting[position]
            kernel = plan.kernel(chunk.law, closing=closing, record=chunk.record, steps=chunk.steps)
            mine = table[chunk.rows]
            return ChunkTask(chunk.key, kernel, chunk.record, mine, plan.variants[mine.variant], outputs)

        def receive(position: int, found: np.ndarray | str) -> None:
            chunk = waiting[position]
            if isinstance(found, str):  # the next run makes what is missing
                outcome.failures.append(found)
                self.progress.advance(len(chunk.rows))
                return
            outcome.run += answer(chunk, found)

        self.dispatcher.run(len(waiting), task_of, receive)

    def _stored(self, stage: str) -> Iterator[tuple[Chunk, np.ndarray, Callable[[], np.ndarray], Any]]:
        """Go through the finished chunks of a stage: table, what reads it again, and the cube it was taken from."""
        if self.writer is None:
            return
        store = self.writer.store
        for key, entry in sorted(store.completed().items()):
            if entry.get("stage") == stage:
                try:
                    table = store.read(key)
                except ChunkCorrupt as error:
                    store.forget(key)
                    warnings.warn(f"{error}; it is computed again", RuntimeWarning, stacklevel=2)
                else:
                    chunk = Chunk(key, entry["law"], entry["record"], store.rows(key), 0)
                    yield chunk, table, partial(store.read, key), entry.get("origin")

    def _is_taken(self, origin: Mapping[str, Any] | None) -> bool:
        """Whether results are from the earlier cube that this one tells of, wherever it stands."""
        if origin is None:
            return False
        if self.outcome.taken_from is None:
            self.outcome.taken_from = origin
        return {**origin, "file": ""} == {**self.outcome.taken_from, "file": ""}
