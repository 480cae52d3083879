"""Running a plan: kernels made ready, chunks fanned out by dask, results gathered.

Workers return arrays; only this process writes. A chunk that fails costs its
own scenarios (status ``not_run``), never the batch.
"""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pounding_sweep.cube.assemble import inner_shape
from pounding_sweep.cube.variables import Status, cube_variables, get_variable
from pounding_sweep.errors import InputError, unknown
from pounding_sweep.records import Record
from pounding_sweep.sweep.blocks import RowKernel, variables_of
from pounding_sweep.sweep.cluster import clients
from pounding_sweep.sweep.plan import Chunk, Plan, untouched
from pounding_sweep.sweep.scenarios import Scenarios
from pounding_sweep.sweep.store import ChunkCorrupt, ChunkStore

#: Names of the schedulers that start on this machine.
SCHEDULERS = ("threads", "processes", "synchronous")


@dataclass
class Progress:
    """What a display is told while a sweep runs; this one is silent.

    ``stage`` names what goes on; ``advance`` counts scenarios.
    """

    def stage(self, name: str, total: int) -> None:
        """Begin a stage of `total` steps."""

    def advance(self, count: int) -> None:
        """Count steps of the stage as done."""

    def close(self) -> None:
        """End the display."""


@dataclass
class Outcome:
    """Results of the unique scenarios of a plan.

    Attributes
    ----------
    values : dict of str to ndarray
        Variable -> shape (unique, *inner).
    run : int
        Scenarios integrated.
    untouched : int
        Unique scenarios answered by the run without pounding.
    reused : int
        Scenarios read from an interrupted run.
    compiled : int
        Kernels that had to be compiled.
    compile_seconds, run_seconds : float
        Wall time of the two stages.
    failures : list of str
        What went wrong in chunks that have no result.
    left_out : ndarray of bool or None
        Unique scenarios answered by a run without pounding; None where nothing was run.
    """

    values: dict[str, np.ndarray]
    run: int = 0
    untouched: int = 0
    reused: int = 0
    compiled: int = 0
    compile_seconds: float = 0.0
    run_seconds: float = 0.0
    failures: list[str] = field(default_factory=list)
    left_out: np.ndarray | None = None


def run_chunk(
    kernel: RowKernel, record: Record, table: Scenarios, outputs: Sequence[str]
) -> dict[str, np.ndarray] | str:
    """Run the scenarios of one chunk; returns variables of shape (n, *inner), or what went wrong."""
    try:
        raw = kernel.run(
            record,
            scale=table.scale,
            gaps=table.gaps,
            stiffness=table.stiffness,
            restitution=table.restitution,
        )
        return variables_of(kernel, raw, outputs, record)
    except Exception as error:  # reported with the chunk: a batch never dies of one scenario
        return f"{type(error).__name__}: {error}"


def check_scheduler(scheduler: str, workers: int | None) -> int:
    """Return the number of workers; raise `InputError` for an unknown scheduler or less than one worker."""
    if scheduler not in SCHEDULERS and "://" not in scheduler:
        msg = unknown("scheduler", scheduler, [*SCHEDULERS, "tcp://HOST:PORT"])
        raise InputError(msg)
    if workers is not None and workers < 1:
        msg = f"workers = {workers!r} must be at least 1"
        raise InputError(msg)
    if workers is not None:
        return workers
    return 1 if scheduler == "synchronous" else len(os.sched_getaffinity(0))


def execute(
    plan: Plan,
    *,
    scheduler: str = "threads",
    workers: int | None = None,
    store: ChunkStore | None = None,
    progress: Progress | None = None,
) -> Outcome:
    """Run a plan and gather the results of its unique scenarios.

    Parameters
    ----------
    plan : Plan
        What to run.
    scheduler : str
        "threads", "processes", "synchronous", or the address of a dask scheduler.
    workers : int, optional
        Threads or processes; by default one per core.
    store : ChunkStore, optional
        Open store: completed chunks are read from it, new ones written to it.
    progress : Progress, optional
        Display.

    Returns
    -------
    Outcome
        Values that do not depend on scheduler, workers or what was resumed.
    """
    n_workers = check_scheduler(scheduler, workers)
    progress = progress or Progress()
    try:
        outcome = _execute(plan, scheduler, n_workers, store, progress)
    finally:
        progress.close()
    if outcome.failures:
        shown_failures = "; ".join(sorted(set(outcome.failures))[:3])
        warnings.warn(
            f"{len(outcome.failures)} chunks have no result (status not_run): {shown_failures}",
            RuntimeWarning,
            stacklevel=2,
        )
    return outcome


def _execute(plan: Plan, scheduler: str, workers: int, store: ChunkStore | None, progress: Progress) -> Outcome:
    from pounding_sweep.kernels.prepare import prepare

    kernels = plan.kernels()
    shapes = list(dict.fromkeys(kernel.shape for kernel in kernels.values()))
    progress.stage("kernels", len(shapes))
    started = time.perf_counter()
    shown = 0

    def notify(ready: int, total: int) -> None:
        nonlocal shown
        del total
        progress.advance(ready - shown)
        shown = ready

    compiled = prepare(shapes, workers, notify)
    outcome = Outcome(_empty(plan), compiled=compiled, compile_seconds=time.perf_counter() - started)
    outcome.values["status"][plan.refused] = Status.BEYOND_STABILITY_LIMIT
    started = time.perf_counter()
    if kernels:
        _run_all(plan, store, progress, scheduler, workers, outcome)
    outcome.run_seconds = time.perf_counter() - started
    return outcome


def _empty(plan: Plan) -> dict[str, np.ndarray]:
    values = {}
    for name in cube_variables(plan.outputs):
        variable = get_variable(name)
        fill: Any = int(Status.NOT_RUN) if name == "status" else variable.fill
        values[name] = np.full((len(plan.unique), *inner_shape(name, plan.spec.scene)), fill, dtype=variable.dtype)
    return values


def _run_all(
    plan: Plan,
    store: ChunkStore | None,
    progress: Progress,
    scheduler: str,
    workers: int,
    outcome: Outcome,
) -> None:
    table, last = plan.unique, len(plan.laws) - 1
    outputs = plan.outputs
    motions = [
        (r, s) for r, s in plan.motions if bool(((table.record == r) & (table.scale == s) & ~plan.refused).any())
    ]
    # the run without pounding of each motion decides which scenarios can touch at all
    progress.stage("no pounding", len(motions))
    closing: dict[tuple[int, float], np.ndarray] = {}
    still: dict[tuple[int, float], dict[str, np.ndarray]] = {}
    wide = (*outputs, "closing_max")
    for record in sorted({r for r, _ in motions}):
        mine = [s for r, s in motions if r == record]
        n = len(mine)
        rows = Scenarios(
            np.full(n, last),
            np.full(n, record),
            np.array(mine),
            np.zeros(n),
            np.ones(n),
            np.full((n, table.gaps.shape[1]), np.inf),
        )
        kernel = plan.kernel(last, closing=True, record=record, steps=plan.still[record])
        result = run_chunk(kernel, plan.spec.records[record], rows, wide)
        progress.advance(n)
        if isinstance(result, str):
            outcome.failures.append(result)
            continue
        contacts = plan.spec.scene.contacts
        for i, scale in enumerate(mine):
            still[record, scale] = {name: values[i] for name, values in result.items() if name != "closing_max"}
            if contacts:
                found = np.array([result["closing_max"][i, c.pair, c.storey - 1] for c in contacts])
                ok = result["status"][i] == Status.OK
                closing[record, scale] = found if ok else np.full(len(contacts), np.inf)
            if "closing_max" in outputs:
                still[record, scale]["closing_max"] = result["closing_max"][i]
        outcome.run += n
    left_out = untouched(plan, closing) & ~plan.refused
    outcome.left_out = left_out
    outcome.untouched = int((left_out & ~plan.no_contact).sum())
    for (record, scale), values in still.items():
        rows_of = np.flatnonzero(left_out & (table.record == record) & (table.scale == scale))
        for name, value in values.items():
            outcome.values[name][rows_of] = value

    chunks = plan.chunks(np.flatnonzero(~left_out & ~plan.refused))
    progress.stage("scenarios", int(sum(len(c.rows) for c in chunks)))
    waiting: list[Chunk] = []
    done = store.completed() if store is not None else set()
    for chunk in chunks:
        if store is not None and chunk.key in done:
            try:
                _place(outcome, chunk, store.read(chunk.key))
            except ChunkCorrupt as error:
                warnings.warn(f"{error}; it is computed again", RuntimeWarning, stacklevel=4)
                store.forget(chunk.key)
            else:
                outcome.reused += len(chunk.rows)
                progress.advance(len(chunk.rows))
                continue
        waiting.append(chunk)

    def take(chunk: Chunk, found: dict[str, np.ndarray] | str) -> None:
        if isinstance(found, str):
            outcome.failures.append(found)
        else:
            if store is not None:
                store.write(chunk.key, found)
            _place(outcome, chunk, found)
            outcome.run += len(chunk.rows)
        progress.advance(len(chunk.rows))

    run = _run_distributed if scheduler == "processes" or "://" in scheduler else _run_local
    run(plan, waiting, scheduler, workers, take)


def _place(outcome: Outcome, chunk: Chunk, found: dict[str, np.ndarray]) -> None:
    for name, values in outcome.values.items():
        values[chunk.rows] = found[name]


Take = Callable[[Chunk, "dict[str, np.ndarray] | str"], None]


def _run_local(
    plan: Plan,
    chunks: list[Chunk],
    scheduler: str,
    workers: int,
    take: Take,
) -> None:
    """Threads (or this thread) of this process; results are taken as they come."""
    import dask
    from dask.callbacks import Callback

    by_key: dict[str, Chunk] = {}
    tasks = []
    for chunk in chunks:
        name = f"chunk-{chunk.key}"
        by_key[name] = chunk
        tasks.append(dask.delayed(_Task(plan, chunk), pure=False)(dask_key_name=name))

    class Gather(Callback):
        def _posttask(self, key: str, result: Any, dsk: Any, state: Any, worker_id: Any) -> None:
            del dsk, worker_id
            if key in by_key:
                take(by_key[key], result.value)
                result.value = None  # the values are placed; nothing is kept twice

    with Gather():
        dask.compute(*tasks, scheduler=scheduler, num_workers=workers, optimize_graph=False)


class _Box:
    """A result that can be emptied once it is taken."""

    def __init__(self, value: Any) -> None:
        self.value = value


class _Task:
    """One chunk as a callable of no arguments."""

    def __init__(self, plan: Plan, chunk: Chunk) -> None:
        self.plan, self.chunk = plan, chunk

    def __call__(self) -> _Box:
        plan, chunk = self.plan, self.chunk
        kernel = plan.kernel(chunk.law, record=chunk.record, steps=chunk.steps)
        return _Box(run_chunk(kernel, plan.spec.records[chunk.record], plan.unique[chunk.rows], plan.outputs))


def _run_distributed(
    plan: Plan,
    chunks: list[Chunk],
    scheduler: str,
    workers: int,
    take: Take,
) -> None:
    """Run in processes of a dask cluster; each record is sent once, and few results are in flight at a time."""
    from distributed import as_completed

    if not chunks:
        return
    for client in clients(scheduler, workers):
        records = {
            r: client.scatter(plan.spec.records[r], broadcast=True, hash=False) for r in {c.record for c in chunks}
        }

        def submit(chunk: Chunk, client: Any = client, records: Any = records) -> Any:
            kernel = plan.kernel(chunk.law, record=chunk.record, steps=chunk.steps)
            args = (kernel, records[chunk.record], plan.unique[chunk.rows], plan.outputs)
            return client.submit(run_chunk, *args, key=f"chunk-{chunk.key}", pure=False)

        queue = iter(chunks)
        at_once = max(8, 4 * sum(client.nthreads().values()))
        flying: dict[str, Chunk] = {}
        completed = as_completed(loop=client.loop)  # the client is not the process's default one
        for chunk in queue:
            future = submit(chunk)
            flying[future.key] = chunk
            completed.add(future)
            if len(flying) >= at_once:
                break
        for future in completed:
            chunk = flying.pop(future.key)
            try:
                found = future.result()
            except Exception as error:  # a lost worker costs its chunk
                found = f"{type(error).__name__}: {error}"
            take(chunk, found)
            future.release()
            following = next(queue, None)
            if following is not None:
                started = submit(following)
                flying[started.key] = following
                completed.add(started)
