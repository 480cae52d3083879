"""Chunks handed to workers, and what they found handed back as it comes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack
from functools import cached_property
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.kernel.spec import KernelSpec
from pounding_sweep.plan.scenarios import ChunkTask, Receive, Run
from pounding_sweep.records import Record

if TYPE_CHECKING:
    from distributed import Client

    from pounding_sweep.run.cluster import ClusterWorkers

#: Chunks under way per thread of this process: one runs, one waits beside it.
AHEAD = 2


class Dispatcher:
    """Workers: threads of this process, processes that are started here, or those of a dask cluster."""

    def __init__(
        self,
        scheduler: str | Client,
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

    def prepare(self, shapes: Sequence[KernelSpec], advance: Callable[[int], None] | None = None) -> int:
        """Make kernels ready where they will run; returns how many had to be compiled."""
        if not shapes:
            return 0
        if self._has_cluster:
            return self.cluster.prepare(shapes, advance)
        from pounding_sweep.engine.compile import prepare

        return prepare(shapes, self.workers, advance)

    def run(self, n: int, task_of: Callable[[int], ChunkTask], receive: Receive) -> None:
        """Run `n` chunks, begun in the order given, and take their results in this thread as they come."""
        if not n:
            return
        if self._has_cluster:
            self.cluster.run(n, task_of, receive)
        elif self.scheduler == "synchronous":
            for position in range(n):
                receive(position, self._run_here(task_of, position))
        else:
            self._run_in_threads(n, task_of, receive)

    @property
    def _has_cluster(self) -> bool:
        return not isinstance(self.scheduler, str) or self.scheduler == "processes" or "://" in self.scheduler

    @cached_property
    def cluster(self) -> ClusterWorkers:
        """The workers of a cluster, reached when they are first asked for."""
        from pounding_sweep.run.cluster import ClusterWorkers, cluster_client

        client = self._open.enter_context(cluster_client(self.scheduler, self.workers))
        return ClusterWorkers(client, self.records, self._run, self._note)

    @cached_property
    def _threads(self) -> ThreadPoolExecutor:
        """The threads of this process, from the first chunk on."""
        pool = ThreadPoolExecutor(self.workers, thread_name_prefix="sweep")
        # who interrupts a run does not wait for its chunks
        self._open.callback(pool.shutdown, wait=False, cancel_futures=True)
        return pool

    def _run_here(self, task_of: Callable[[int], ChunkTask], position: int) -> np.ndarray | str:
        try:
            mine = task_of(position)
        except MemoryError as error:  # it costs this chunk only
            return f"MemoryError: {error}"
        return self._run(mine.kernel, self.records[mine.record], mine.table, mine.variants, mine.outputs)

    def _run_in_threads(self, n: int, task_of: Callable[[int], ChunkTask], receive: Receive) -> None:
        following = iter(range(n))
        under_way: dict[Future[np.ndarray | str], int] = {}
        while True:
            for position in islice(following, AHEAD * self.workers - len(under_way)):
                under_way[self._threads.submit(self._run_here, task_of, position)] = position
            if not under_way:
                break
            for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                receive(under_way.pop(future), future.result())
