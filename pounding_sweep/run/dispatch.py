"""Chunks handed to dask's workers, and what they found handed back as it comes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from pounding_sweep.emit.spec import KernelShape
from pounding_sweep.plan.jobs import Job, Run, Take
from pounding_sweep.records import Record
from pounding_sweep.resume.extend import EarlierCube
from pounding_sweep.run.cluster import cluster_client
from pounding_sweep.run.far_workers import FarWorkers


class Dispatcher:
    """Workers of dask: threads of this process, processes, or those of a cluster.

    Parameters
    ----------
    scheduler : str
        "threads", "processes", "synchronous", or the address of a dask scheduler.
    workers : int
        Threads or processes.
    records : sequence of Record
        Ground motions by index.
    run : callable
        What is done with a job's kernel, record, table, variants and outputs.
    note : callable, optional
        Told of workers that come and go.

    Notes
    -----
    A context: a cluster is reached, and processes are started, when they are first needed; they end with it.
    """

    def __init__(
        self,
        scheduler: str,
        workers: int,
        records: Sequence[Record],
        run: Run,
        note: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.scheduler, self.workers, self.records, self._run = scheduler, workers, records, run
        self._note = note
        self._open = ExitStack()

    def __enter__(self) -> Dispatcher:
        return self

    def __exit__(self, *raised: Any) -> None:
        self._open.__exit__(*raised)

    def prepare(self, shapes: Sequence[KernelShape], advance: Callable[[int], None] | None = None) -> int:
        """Make kernels ready where they will run; returns how many had to be compiled.

        Parameters
        ----------
        shapes : sequence of KernelShape
            Kernels that will be needed.
        advance : callable, optional
            Called with the number of kernels that became ready.
        """
        if not shapes:
            return 0
        if self._is_far:
            return self.far.prepare(shapes, advance)
        from pounding_sweep.engine.compile import prepare

        return prepare(shapes, self.workers, advance)

    def run(self, n: int, job: Callable[[int], Job], take: Take) -> None:
        """Run `n` chunks, begun in the order given, and take their results in this thread as they come.

        Parameters
        ----------
        n : int
            Number of chunks.
        job : callable
            Position -> its job; asked for when the chunk is about to run.
        take : callable
            Told of each result.

        Raises
        ------
        ClusterError
            The cluster can't be reached, is gone, or none of its workers can take part.
        """
        if not n:
            return
        if self._is_far:
            self.far.run(n, job, take)
        else:
            self._near(n, job, take)

    @property
    def _is_far(self) -> bool:
        return self.scheduler == "processes" or "://" in self.scheduler

    @cached_property
    def far(self) -> FarWorkers:
        """The workers of a cluster, reached when they are first asked for."""
        client = self._open.enter_context(cluster_client(self.scheduler, self.workers))
        return FarWorkers(client, self.records, self._run, self._note)

    def _near(self, n: int, job: Callable[[int], Job], take: Take) -> None:
        import dask
        import dask.threaded
        from dask.callbacks import Callback

        following = iter(range(n))  # dask keeps an order of its own: whatever task begins takes the next chunk

        def task() -> list[Any]:
            position = next(following)
            try:
                mine = job(position)
            except MemoryError as error:  # it costs this chunk only
                return [position, f"MemoryError: {error}"]
            record = self.records[mine.record]
            return [position, self._run(mine.kernel, record, mine.table, mine.variants, mine.outputs)]

        class Gather(Callback):
            def _posttask(self, key: str, result: Any, dsk: Any, state: Any, worker_id: Any) -> None:
                del key, dsk, state, worker_id
                take(*result)
                result.clear()  # dask keeps the list until the end

        graph = {f"chunk-{i}": (task,) for i in range(n)}
        get = dask.get if self.scheduler == "synchronous" else dask.threaded.get
        # not as a context: dask would tell this of every graph that any thread begins meanwhile
        get(graph, list(graph), num_workers=self.workers, callbacks=[Gather()._callback])


class ExtendingDispatcher(Dispatcher):
    """Workers that run only what an earlier cube does not hold.

    Parameters
    ----------
    workers : Dispatcher
        Open; what runs the rest. They are left open.
    earlier : EarlierCube
        What is known.
    """

    def __init__(self, workers: Dispatcher, earlier: EarlierCube) -> None:
        self._workers, self._earlier = workers, earlier

    def prepare(self, shapes: Sequence[KernelShape], advance: Callable[[int], None] | None = None) -> int:
        """See `Dispatcher.prepare`."""
        return self._workers.prepare(shapes, advance)

    def run(self, n: int, job: Callable[[int], Job], take: Take) -> None:
        """See `Dispatcher.run`; chunks that are known as a whole come first."""
        earlier, waiting = self._earlier, []
        partly: dict[int, tuple[str, np.ndarray]] = {}  # position -> key and rows of chunks that are known in part
        for position in range(n):
            try:
                mine = job(position)
                rows = earlier.find(mine)
                known = rows >= 0
                whole = earlier.results(rows) if known.all() else None
            except MemoryError as error:  # it costs this chunk only
                take(position, f"MemoryError: {error}")
                continue
            if whole is not None:
                earlier.taken[mine.key] = len(rows)
                take(position, whole)
                continue
            waiting.append(position)
            if known.any():
                partly[position] = mine.key, rows

        def rest(index: int) -> Job:
            whole = job(waiting[index])
            if waiting[index] not in partly:
                return whole
            new = partly[waiting[index]][1] < 0
            return replace(whole, table=whole.table[new], variants=whole.variants[new])

        def together(index: int, found: np.ndarray | str) -> None:
            key, rows = partly.pop(waiting[index], ("", None))
            if rows is not None:
                try:
                    if isinstance(found, str):  # costs only what was to be run
                        earlier.lost[key], found = found, earlier.without(rows)
                    else:
                        found = earlier.completed(rows, found)
                    earlier.taken[key] = int((rows >= 0).sum())
                except MemoryError as error:
                    found = f"MemoryError: {error}"
            take(waiting[index], found)

        self._workers.run(len(waiting), rest, together)
