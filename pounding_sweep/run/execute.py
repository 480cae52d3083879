"""Running a plan: kernels made ready, chunks fanned out to workers, results kept.

Workers return tables; only this process writes. A chunk that fails costs its
own scenarios (status ``not_run``), never the batch.
"""

from __future__ import annotations

import ast
import multiprocessing
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import InputError, RunError, unknown
from pounding_sweep.engine.compile import missing_kernels, prepare
from pounding_sweep.kernel.spec import LANES, KernelSpec
from pounding_sweep.output.results import Outcome, Results, to_table
from pounding_sweep.plan.plan import Plan, untouched
from pounding_sweep.plan.scenarios import Chunk, ChunkTask
from pounding_sweep.resume import ChunkCorrupt, ChunkStore
from pounding_sweep.run.refinement import run_scenarios
from pounding_sweep.variables.registry import VALID, Status, cube_variables, inner_shape

if TYPE_CHECKING:
    from distributed import Client

    from pounding_sweep.run.reuse import EarlierCube

#: Names of the schedulers that start on this machine.
SCHEDULERS = ("threads", "processes", "synchronous")
#: Chunks under way per thread of this process: one runs, one waits beside it.
AHEAD = 2


#: What the stages of a run are called on displays.
STAGES = {"compiling": "compiling kernels", "no pounding": "runs without pounding"}


class Progress:
    """What a display is told while a sweep runs; this one is silent."""

    def stage(self, name: str, total: int) -> None:
        """Begin a stage of `total` steps."""

    def advance(self, count: int) -> None:
        """Count steps of the stage as done."""

    def note(self, text: str) -> None:
        """Hear of something that is worth a line in a log: workers that come and go."""

    def close(self) -> None:
        """End the display."""


class NotebookProgress(Progress):
    """Stage, done and total in the output of a notebook's cell, as a bar that the end of the run removes."""

    _shown, _next = False, 0.0

    def stage(self, name: str, total: int) -> None:
        """Begin a stage of `total` steps; 0 stands for an unknown number."""
        self._name, self._done, self._total = STAGES.get(name, name), 0, total
        self.advance(0)

    def advance(self, count: int) -> None:
        """Count steps of the stage as done."""
        self._done += count
        if time.monotonic() >= self._next:
            known = f'<progress max="{self._total}" value="{self._done}"></progress> {self._done:,} of {self._total:,}'
            self._show(f"{self._name} {known if self._total else '<progress></progress>'}")

    def close(self) -> None:
        """Remove the bar."""
        self._show("")

    def _show(self, html: str) -> None:
        notebook = sys.modules["IPython.display"]
        notebook.display(notebook.HTML(html), display_id=str(id(self)), update=self._shown)
        self._shown, self._next = True, time.monotonic() + 0.2  # five times a second


def run_chunk(task: ChunkTask) -> np.ndarray | str:
    """Run the scenarios of one chunk; returns their table of results, or what went wrong."""
    try:
        return to_table(run_scenarios(task), task.kernel.scene)
    except Exception as error:  # reported with the chunk: a batch never dies of one scenario
        return f"{type(error).__name__}: {error}"


def check_scheduler(scheduler: str | Client, workers: int | None) -> int:
    """Return the number of workers.

    Raises
    ------
    InputError
        The scheduler is unknown, or `workers` is no whole number of at least 1.
    RunError
        Processes are asked for by a script without ``if __name__ == "__main__":``.
    """
    is_known = scheduler in SCHEDULERS or (isinstance(scheduler, str) and "://" in scheduler)
    if not is_known and not hasattr(scheduler, "scheduler_info"):
        raise InputError(unknown("scheduler", scheduler, [*SCHEDULERS, "tcp://HOST:PORT", "a dask Client"]))
    check_main_guard(scheduler == "processes")
    if workers is None:
        return 1 if scheduler == "synchronous" else len(os.sched_getaffinity(0))
    if not isinstance(workers, int) or workers < 1:
        raise InputError(f"workers = {workers!r} must be a whole number, at least 1")
    return workers


def check_main_guard(starts_processes: bool) -> None:
    """Raise `RunError` if the running script has no guard: each new process imports it, and would run it again."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):  # as multiprocessing itself knows
        sys.exit("a new process imports the script and would run its sweep again; put that below a guard")
    main = sys.modules["__main__"]
    file = None if getattr(main, "__spec__", None) else getattr(main, "__file__", None)
    if not starts_processes or file is None:
        return
    nodes = (node for node in ast.walk(ast.parse(Path(file).read_bytes())) if isinstance(node, ast.Compare))
    if not any(getattr(side, "id", "") == "__name__" for node in nodes for side in (node.left, *node.comparators)):
        raise RunError(
            f"{file}: the new processes import this script and would run it again. Put what it runs below a guard:\n\n"
            '    if __name__ == "__main__":\n        ...\n\nor run with scheduler="threads"'
        )


class Dispatcher(ExitStack):
    """Workers: threads of this process, processes that are started here, or those of a dask cluster."""

    def __init__(self, scheduler: str | Client, workers: int, progress: Progress | None = None) -> None:
        super().__init__()
        self.scheduler, self.workers, self.progress, self.cluster = scheduler, workers, progress or Progress(), None
        if scheduler not in ("threads", "synchronous"):
            from pounding_sweep.run.cluster import ClusterWorkers, cluster_client

            client = self.enter_context(cluster_client(scheduler, workers))
            self.cluster = ClusterWorkers(client, run_chunk, self.progress.note)
        self._threads = ThreadPoolExecutor(workers, thread_name_prefix="sweep")
        # who interrupts a run does not wait for its chunks
        self.callback(self._threads.shutdown, wait=False, cancel_futures=True)

    def prepare(self, shapes: Sequence[KernelSpec]) -> int:
        """Make kernels ready where they will run, a stage of its own; returns how many had to be compiled."""
        self.progress.stage("compiling" if missing_kernels(shapes)[0] else "kernels", len(shapes))
        advance = self.progress.advance
        return self.cluster.prepare(shapes, advance) if self.cluster else prepare(shapes, self.workers, advance)

    def run(self, items: Iterable[Any], task_of: Callable[[Any], ChunkTask]) -> Iterator[tuple[Any, np.ndarray | str]]:
        """Run a task for each item, begun in their order; gives items with tables, or what went wrong, as they come."""
        if self.cluster:
            yield from self.cluster.run(items, task_of)
        elif self.scheduler == "synchronous":
            for item in items:
                yield item, run_chunk(task_of(item))
        else:
            following, in_flight = iter(items), dict[Future[Any], Any]()
            while True:
                for item in islice(following, AHEAD * self.workers - len(in_flight)):
                    in_flight[self._threads.submit(run_chunk, task_of(item))] = item
                if not in_flight:
                    break
                for future in wait(in_flight, return_when=FIRST_COMPLETED).done:
                    yield in_flight.pop(future), future.result()


def execute(
    plan: Plan, dispatcher: Dispatcher, *, store: ChunkStore | None = None, earlier: EarlierCube | None = None
) -> Outcome:
    """Run a plan and keep the results of its unique scenarios."""
    progress, shapes, n = dispatcher.progress, plan.shapes(), len(plan.unique)
    outcome = Outcome(Results(cube_variables(plan.outputs), plan.spec.scene, n), np.ones(n, bool))
    outcome.results.status[plan.refused] = Status.BEYOND_STABILITY_LIMIT
    outcome.copied_from = None if earlier is None else earlier.origin
    started = time.perf_counter()
    outcome.compiled = dispatcher.prepare(shapes) if shapes else 0
    begun = time.perf_counter()
    if shapes:
        twice = replace(plan, once=False)
        run_stage = partial(_run_stage, outcome, dispatcher, store, earlier)
        runs = len(plan.uncoupled_runs)
        closing = np.full((runs, *inner_shape("closing_max", plan.spec.scene)), np.inf)
        slot, status = np.full(runs, -1), np.full(runs, Status.NOT_RUN, np.int8)
        for rows, table, slots in run_stage(twice, "no pounding", plan.uncoupled_to_run):
            status[rows], slot[rows] = table["status"], slots
            ok = np.isin(table["status"], VALID)
            closing[rows[ok]] = table["closing_max"][ok]
        # scenarios that never touch are answered by their run without pounding
        outcome.left_out = untouched(plan, closing) & ~plan.refused & (not plan.shares_kernel)
        outcome.untouched = int((outcome.left_out & ~plan.no_contact).sum())
        if len(rows := np.flatnonzero(outcome.left_out)):
            run = plan.uncoupled_of[rows]
            outcome.results.answer(rows, slot[run], status[run], touched=False)
        rest = np.flatnonzero(~outcome.left_out & ~plan.refused).astype(np.int32)
        sample = plan.sample(rest)
        is_enough = len(sample) > 0
        for stage, part in [("sample", sample)] * is_enough + [("scenarios", np.setdiff1d(rest, sample))]:
            once = is_enough and stage == "scenarios"
            for rows, table, slots in run_stage(plan if once else twice, stage, part):
                outcome.results.answer(rows, slots, table["status"], np.isfinite(table["steps_per_contact"]))
                if stage == "sample":
                    is_enough &= bool(((table["status"] == Status.OK) & ~is_refined(plan, rows, table)).all())
        if store is not None and outcome.failures:
            store.flush()  # the next run makes what is missing
    outcome.compile_seconds, outcome.run_seconds = begun - started, time.perf_counter() - begun
    if outcome.copied_from is not None:
        progress.note(f"{outcome.copied} scenarios taken from {outcome.copied_from['file']}")
    if outcome.failures:
        reasons = "; ".join(sorted(set(outcome.failures))[:3])
        text = f"{len(outcome.failures)} chunks have no result (status not_run): {reasons}"
        warnings.warn(text, RuntimeWarning, stacklevel=2)
    return outcome


def is_refined(plan: Plan, rows: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Whether the steps of scenarios were halved more than once."""
    intervals = np.array([record.dt for record in plan.spec.records])[plan.unique.record[rows]]
    return intervals / table["time_step"] > 3.0 * plan.steps[rows]


def _run_stage(
    outcome: Outcome,
    dispatcher: Dispatcher,
    store: ChunkStore | None,
    earlier: EarlierCube | None,
    plan: Plan,
    stage: str,
    rows: np.ndarray,
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Take rows of a stage from the store and the earlier cube, run the others; give rows, results and their slots."""
    progress = dispatcher.progress
    progress.stage(stage, len(rows))
    closing, table, outputs = False, plan.unique, plan.outputs
    if stage == "no pounding":
        closing, table, outputs = True, plan.uncoupled_runs, (*plan.outputs, "closing_max")
    missing, stored = np.zeros(len(table), bool), list[Chunk]()
    missing[rows] = True

    def answer(
        count: str, chunk: Chunk, values: np.ndarray, *, is_stored: bool = False, **origin: Any
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        if store is not None and not is_stored:
            store.save(chunk, values, stage=stage, **origin)
        slots = outcome.results.hold(values, None if store is None else partial(store.read, chunk.key))
        new = missing[chunk.rows]
        missing[chunk.rows] = False
        setattr(outcome, count, getattr(outcome, count) + int(new.sum()))
        if new.any():
            progress.advance(int(new.sum()))
        return chunk.rows[new], values[new], slots[new]

    for key, entry in sorted(store.completed().items()) if store is not None else ():
        if store is None or entry["stage"] != stage:
            continue
        try:
            values = store.read(key)
        except ChunkCorrupt as error:
            store.path(key).unlink(missing_ok=True)
            warnings.warn(f"{error}; it is computed again", RuntimeWarning, stacklevel=2)
            continue
        origin = entry.get("origin")
        outcome.copied_from = outcome.copied_from or origin
        # from the earlier cube that this one tells of, wherever it stands
        is_taken = origin and {**origin, "file": ""} == {**(outcome.copied_from or {}), "file": ""}
        stored.append(Chunk(key, entry["law"], entry["record"], store.rows(key), 0))
        yield answer("copied" if is_taken else "reused", stored[-1], values, is_stored=True)
    if earlier is not None and not closing:
        for chunk, values in earlier.chunks(np.flatnonzero(missing)):
            yield answer("copied", chunk, values, origin=earlier.origin)
            stored.append(chunk)
    waiting = plan.chunks(np.flatnonzero(missing), uncoupled=closing)
    if store is not None:
        store.expect(plan, stage, [*stored, *waiting])

    def task_of(chunk: Chunk) -> ChunkTask:
        kind = chunk.law, chunk.record, chunk.steps
        return plan.task(table[chunk.rows], *kind, closing=closing, outputs=outputs)

    for chunk, result in dispatcher.run(waiting, task_of):
        if isinstance(result, str):  # the next run makes what is missing
            outcome.failures.append(result)
            progress.advance(len(chunk.rows))
        else:
            if plan.spec.accuracy is not None and not closing:
                outcome.refined += int(is_refined(plan, chunk.rows, result).sum())
            yield answer("run", chunk, result)


def measured_seconds(plan: Plan) -> float | None:
    """Return the seconds that the scenarios of a plan take on one core, by some of each law; None without kernels.

    Of a law's estimate by steps, so many times are taken as of that of two groups of its scenarios, which are timed.
    """
    if missing_kernels(plan.shapes())[0]:
        return None
    total, table, random = 0.0, plan.unique, np.random.default_rng(0)
    rows = np.flatnonzero(~plan.refused)
    for law in np.unique(table.law[rows]).tolist():
        of_law = rows[table.law[rows] == law]
        first = random.choice(of_law)
        alike = of_law[(table.record[of_law] == table.record[first]) & (plan.steps[of_law] == plan.steps[first])]
        group = random.choice(alike, 2 * LANES)
        record, steps = int(table.record[first]), int(plan.steps[first])
        task = plan.task(table[group], law, record, steps)
        run_scenarios(task)
        started = time.perf_counter()
        run_scenarios(task)
        seconds = (time.perf_counter() - started) / len(group)
        total += plan.seconds_of(of_law).sum() * seconds / plan.scenario_seconds(record, steps)
    return total
