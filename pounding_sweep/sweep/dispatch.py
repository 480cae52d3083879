"""Chunks handed to dask's workers, and what they found handed back as it comes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np

from pounding_sweep.records import Record
from pounding_sweep.sweep.blocks import RowKernel
from pounding_sweep.sweep.cluster import cluster_client
from pounding_sweep.sweep.scenarios import Scenarios
from pounding_sweep.sweep.variants import Variants


@dataclass(frozen=True)
class Job:
    """One chunk, ready to be run by anybody.

    Attributes
    ----------
    key : str
        Name of the chunk.
    kernel : RowKernel
        What runs.
    record : int
        Index of the record.
    table : Scenarios
        Scenarios to run.
    variants : Variants
        Their building properties.
    outputs : tuple of str
        Variables asked for.
    """

    key: str
    kernel: RowKernel
    record: int
    table: Scenarios
    variants: Variants
    outputs: tuple[str, ...]


#: (kernel, record, scenarios, variants, outputs) -> table of results, or what went wrong; can be pickled
Run = Callable[..., "np.ndarray | str"]
#: (position of the chunk, its table or what went wrong)
Take = Callable[[int, "np.ndarray | str"], None]


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

    Notes
    -----
    A context: processes are started when they are first needed, and end with it.
    """

    def __init__(self, scheduler: str, workers: int, records: Sequence[Record], run: Run) -> None:
        self.scheduler, self.workers, self.records, self._run = scheduler, workers, records, run
        self._open = ExitStack()
        self._client: Any = None
        self._sent: dict[int, Any] = {}

    def __enter__(self) -> Dispatcher:
        return self

    def __exit__(self, *raised: Any) -> None:
        self._open.__exit__(*raised)

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
        """
        if not n:
            return
        if self.scheduler == "processes" or "://" in self.scheduler:
            self._far(n, job, take)
        else:
            self._near(n, job, take)

    def _near(self, n: int, job: Callable[[int], Job], take: Take) -> None:
        import dask
        import dask.threaded
        from dask.callbacks import Callback

        following = iter(range(n))  # dask keeps an order of its own: whatever task begins takes the next chunk

        def task() -> list[Any]:
            position = next(following)
            mine = job(position)
            record = self.records[mine.record]
            return [position, self._run(mine.kernel, record, mine.table, mine.variants, mine.outputs)]

        class Gather(Callback):
            def _posttask(self, key: str, result: Any, dsk: Any, state: Any, worker_id: Any) -> None:
                del key, dsk, state, worker_id
                take(*result)
                result.clear()  # dask keeps the list until the end

        graph = {f"chunk-{i}": (task,) for i in range(n)}
        get = dask.get if self.scheduler == "synchronous" else dask.threaded.get
        with Gather():
            get(graph, list(graph), num_workers=self.workers)

    def _far(self, n: int, job: Callable[[int], Job], take: Take) -> None:
        """Each record is sent once, and few results are in flight at a time."""
        from distributed import as_completed

        if self._client is None:
            self._client = self._open.enter_context(cluster_client(self.scheduler, self.workers))
        client, flying = self._client, {}
        completed = as_completed(loop=client.loop)  # the client is not the process's default one
        waiting = iter(range(n))

        def begin() -> None:
            position = next(waiting, None)
            if position is None:
                return
            mine = job(position)
            if mine.record not in self._sent:
                self._sent[mine.record] = client.scatter(self.records[mine.record], broadcast=True, hash=False)
            arguments = (mine.kernel, self._sent[mine.record], mine.table, mine.variants, mine.outputs)
            future = client.submit(self._run, *arguments, key=f"chunk-{mine.key}", pure=False)
            flying[future.key] = position
            completed.add(future)

        for _ in range(max(8, 4 * sum(client.nthreads().values()))):
            begin()
        for future in completed:
            try:
                found = future.result()
            except Exception as error:  # a lost worker costs its chunk
                found = f"{type(error).__name__}: {error}"
            take(flying.pop(future.key), found)
            future.release()
            begin()
