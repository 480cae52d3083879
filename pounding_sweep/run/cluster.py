"""Workers of a dask cluster: one at an address, or processes of this machine that are started here."""

from __future__ import annotations

import signal
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import dask
import numpy as np
from distributed import Client, KilledWorker, LocalCluster, WorkerPlugin, as_completed, get_worker
from distributed.comm import get_address_host

from pounding_sweep.base.errors import ClusterError
from pounding_sweep.engine.row_kernel import RowKernel
from pounding_sweep.kernel.spec import KernelSpec
from pounding_sweep.model.variants import Variants
from pounding_sweep.output.provenance import fingerprint
from pounding_sweep.plan.chunks import ChunkTask, Receive, Run
from pounding_sweep.plan.scenarios import Scenarios
from pounding_sweep.records import Record

#: Chunks under way per thread of a worker: one runs, one waits beside it, one is on its way back.
UNDER_WAY = 3
#: Seconds between two looks at who works, and between two at what has come.
LOOK_SECONDS, GLANCE_SECONDS = 1.0, 0.01
#: Seconds without any worker that can take part after which that is said.
ALONE_SECONDS = 10.0
#: Seconds without any of the processes that the run has started after which it ends: nobody else will come.
OWN_SECONDS = 120.0
#: Seconds that a process which ended has to start again, before dask stops waiting and another is started: on a busy
#: machine that takes longer than dask's own 15 s, after which the new one was stopped in the midst of its first chunk.
RESTART_SECONDS = 60.0
#: Seconds that those who are there at the start have to say what they have installed, before the rest begins.
ANSWER_SECONDS = 5.0
#: Times that a chunk may lose all its workers while others run there too, before it runs alone.
TOGETHER = 2
#: Times that it may do so while it runs alone, before it is given up.
ALONE = 3
#: One scenario runs in one thread, and a worker has as many as its cluster gave it: no library starts more.
ONE_THREAD = {name: "1" for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}

#: What ends a run in order.
_INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class IgnoreSignals(WorkerPlugin):
    """Workers that are started here leave Ctrl-C and SIGHUP to their client, though all get them."""

    def setup(self, worker: object) -> None:
        """Ignore both; dask calls this in the main thread of each worker, those that join later too."""
        for number in (signal.SIGINT, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)


@contextmanager
def cluster_client(scheduler: str | Client, workers: int) -> Iterator[Client]:
    """Give a client of the cluster at an address, or of processes that are started here and end with it."""
    if not isinstance(scheduler, str):
        yield scheduler  # the caller's own, who closes it
        return
    if "://" in scheduler:
        try:
            client = Client(scheduler, set_as_default=False)
        except (OSError, ValueError, TypeError, ImportError) as error:  # the last two: of tls:// and ucx://
            msg = (
                f"no dask scheduler answers at {scheduler!r} ({error}); start one with 'dask scheduler' and give the "
                "address that it prints, or run with the scheduler 'threads'"
            )
            raise ClusterError(msg) from None
        with client:
            yield client
        return
    with ExitStack() as opened:
        opened.enter_context(dask.config.set({"distributed.deploy.lost-worker-timeout": RESTART_SECONDS}))
        with _interrupts_later():
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                memory_limit=None,  # else dask stops workers where the libraries alone fill their share
                dashboard_address=None,
                scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},  # else dask opens port 8787 all the same
                silence_logs=50,
                env=ONE_THREAD,
            )
            opened.enter_context(cluster)
            client = opened.enter_context(Client(cluster, set_as_default=False))
            client.register_plugin(IgnoreSignals())
        yield client


@contextmanager
def _interrupts_later() -> Iterator[None]:
    """Have SIGINT, SIGTERM and SIGHUP wait for the end of the block; only a main thread can be interrupted at all."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[int] = []
    own = [each for each in _INTERRUPTS if signal.getsignal(each) is not None]  # None: not set from Python
    before = {each: signal.signal(each, lambda number, frame: waiting.append(number)) for each in own}
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)
        for number in waiting[:1]:
            signal.raise_signal(number)


def _same(thing: Any) -> Any:
    """Give back what came with the task."""
    return thing


def _ready(shape: KernelSpec) -> bool:
    """Make a kernel ready in a worker; returns whether it had to be compiled."""
    from pounding_sweep.engine.cache import get_kernel, is_cached, is_loaded

    there = is_loaded(shape) or is_cached(shape)
    get_kernel(shape)
    return not there


class _UnfitError(Exception):
    """The worker at an address is not the one that was asked: it has other versions."""


def _run_there(
    versions: str,
    run: Run,
    kernel: RowKernel,
    record: Record,
    table: Scenarios,
    factors: tuple[np.ndarray, ...],
    outputs: Sequence[str],
) -> np.ndarray | str:
    """Run a chunk in a worker, if it still has the versions that it said."""
    if fingerprint() != versions:
        raise _UnfitError(get_worker().address)
    return run(kernel, record, table, Variants(kernel.scene, *factors), outputs)


@dataclass(frozen=True)
class _Attempt:
    """A chunk on its way: its position, who may run it, and how often all of those were lost."""

    # what was lost may have been what they died of: after the second time it runs where nothing else does

    position: int
    workers: frozenset[str] = frozenset()
    losses: int = 0

    @property
    def suspect(self) -> bool:
        """Whether it must run alone."""
        return self.losses >= TOGETHER


class ClusterWorkers:
    """The workers of a cluster that have the versions of this process; dask shares chunks out among them."""

    def __init__(self, client: Client, records: Sequence[Record], run: Run, note: Callable[[str], None]) -> None:
        self.client, self._records, self._run, self._note = client, records, run, note
        self._sent: dict[int, tuple[Any, frozenset[str]]] = {}  # records, and who may have them
        self._numbers = count()
        self._threads: dict[str, int] = {}  # of the workers that can take part
        self._unfit: dict[str, str] = {}
        self._asked: dict[str, Any] = {}
        self._answers = self._completed()
        self._looked = -np.inf
        self._alone_since: float | None = None
        self._told_alone = False
        self.most_under_way = 0

    def prepare(self, shapes: Sequence[KernelSpec], advance: Callable[[int], None] | None = None) -> int:
        """Make kernels ready on every machine that is there; returns how many had to be compiled."""
        self._check_scheduler()
        while not self._look():
            time.sleep(LOOK_SECONDS / 10)
        patience = time.monotonic() + ANSWER_SECONDS
        while self._asked and time.monotonic() < patience:
            time.sleep(LOOK_SECONDS / 10)
            self._look()
        hosts: dict[str, set[str]] = {}
        for address in self._threads:
            hosts.setdefault(get_address_host(address), set()).add(address)
        under_way = {self._submit(there, _ready, shape): there for there in hosts.values() for shape in shapes}
        done, total, told, compiled = self._completed(under_way), len(under_way), 0, 0
        while under_way:
            for future, found in self._come(done):
                under_way.pop(future)
                compiled += found is True  # the first chunk that needs it says what is wrong
            for future, there in under_way.items():
                if there.isdisjoint(self._threads):  # where nobody is left, nobody needs it
                    future.cancel()
            ready = (total - len(under_way)) * len(shapes) // total
            if advance and ready > told:
                advance(ready - told)
                told = ready
        return compiled

    def run(self, n: int, task_of: Callable[[int], ChunkTask], receive: Receive) -> None:
        """Run `n` chunks; see `Dispatcher.run`."""
        under_way: dict[Any, _Attempt] = {}
        fresh, again, suspects = map(_Attempt, range(n)), deque[_Attempt](), deque[_Attempt]()
        done, left = self._completed(), n

        def begin(attempt: _Attempt, workers: Collection[str]) -> None:
            try:
                future = self._submit_chunk(task_of(attempt.position), workers)
            except MemoryError as error:  # it costs this chunk only
                land(attempt, f"MemoryError: {error}")
                return
            under_way[future] = replace(attempt, workers=frozenset(workers))
            done.add(future)
            self.most_under_way = max(self.most_under_way, len(under_way))

        def land(attempt: _Attempt, found: np.ndarray | str) -> None:
            nonlocal left
            left -= 1
            receive(attempt.position, found)

        def repeat(attempt: _Attempt) -> None:
            (suspects if attempt.suspect else again).append(attempt)

        def lose(attempt: _Attempt, why: object, losses: int = 1) -> None:
            lost = replace(attempt, losses=max(attempt.losses + 1, losses))
            if lost.losses < TOGETHER + ALONE:
                repeat(lost)
            else:
                land(lost, f"lost {ALONE} times while nothing else ran on its worker: {why}")

        while left:
            while len(under_way) < UNDER_WAY * sum(self._threads.values()):
                following = again.popleft() if again else next(fresh, None)
                if following is None:
                    break
                begin(following, self._threads)
            if suspects and all(attempt.suspect for attempt in under_way.values()):
                busy = {worker for attempt in under_way.values() for worker in attempt.workers}
                for worker in [worker for worker in self._threads if worker not in busy][: len(suspects)]:
                    begin(suspects.popleft(), [worker])
            for future, found in self._come(done):
                if future not in under_way:  # it was stranded
                    continue
                attempt = under_way.pop(future)
                if future.status == "finished":
                    land(attempt, found)
                    continue
                error = found[1] if isinstance(found, tuple) else found
                if future.cancelled():
                    raise self._gone(error)
                if isinstance(error, _UnfitError):
                    self._threads.pop(error.args[0], None)  # it is asked again
                    repeat(attempt)
                else:  # a task gives back what goes wrong in it: this is of the cluster
                    together = TOGETHER if isinstance(error, KilledWorker) else 1
                    lose(attempt, f"{type(error).__name__}: {error}", together)
            # dask waits for ever for the workers that something was meant for
            unsent = any(workers.isdisjoint(self._threads) for _, workers in self._sent.values())
            if unsent:
                self._sent.clear()
            for future, attempt in list(under_way.items()):
                if dead := attempt.workers.isdisjoint(self._threads) or unsent:
                    del under_way[future]
                    future.cancel()
                    if dead:
                        lose(attempt, "it died, or no longer answers")
                    else:
                        repeat(attempt)

    def _completed(self, futures: Collection[Any] = ()) -> Any:
        """Tasks as they end, with what they gave or the error that ended them."""
        return as_completed(list(futures), loop=self.client.loop, with_results=True, raise_errors=False)

    def _come(self, done: Any) -> list[tuple[Any, Any]]:
        """Return what has ended, after a moment if nothing has; looks at who works when it is time to."""
        if time.monotonic() - self._looked > LOOK_SECONDS:
            self._look()
        if not done.has_ready():
            time.sleep(GLANCE_SECONDS)
        found: list[tuple[Any, Any]] = done.next_batch(block=False)
        return found

    def _submit(self, workers: Collection[str], function: Callable[..., Any], *arguments: Any, **more: Any) -> Any:
        return self.client.submit(function, *arguments, workers=list(workers), pure=False, **more)

    def _submit_chunk(self, mine: ChunkTask, workers: Collection[str]) -> Any:
        variants = mine.variants
        return self._submit(
            workers,
            _run_there,
            fingerprint(),
            self._run,
            mine.kernel,
            self._send(mine.record),
            mine.table,
            variants.columns,
            mine.outputs,
            key=f"chunk-{mine.key}-{self.client.id}-{next(self._numbers)}",
        )

    def _send(self, index: int) -> Any:
        """Return the task that gives a record, sent once; what is scattered would be lost with its worker."""
        if index not in self._sent or self._sent[index][0].status == "error":  # all who held it died beside others
            key = f"record-{self.client.id}-{next(self._numbers)}"
            # before all chunks that wait: those of every worker need it
            future = self._submit(self._threads, _same, self._records[index], key=key, priority=1)
            self._sent[index] = future, frozenset(self._threads)
        return self._sent[index][0]

    def _gone(self, error: object) -> ClusterError:
        return ClusterError(
            f"the dask scheduler at {self.client.scheduler.address!r} is gone, or was restarted ({error}); "
            "start it and its workers again, and run again, which goes on from the chunks that an output has"
        )

    def _check_scheduler(self) -> None:
        """Raise `ClusterError` where the scheduler has not the package: it unpacks what goes to the workers."""
        try:
            self.client.run_on_scheduler(fingerprint)
        except (ImportError, AttributeError) as error:
            msg = (
                f"the dask scheduler at {self.client.scheduler.address!r} can't load the package ({error}); install "
                f"{fingerprint()} in its environment, as here"
            )
            raise ClusterError(msg) from None
        except OSError as error:
            raise self._gone(error) from None

    def _look(self) -> bool:
        """See who works; returns whether anybody can take part."""
        self._looked = time.monotonic()
        try:
            there = self.client.nthreads()
        except Exception as error:  # whatever it is: the scheduler does not answer
            raise self._gone(error) from None
        left = self._threads.keys() - there.keys()
        self._threads = {address: threads for address, threads in self._threads.items() if address in there}
        for address in left:
            self._note(f"worker {address}: has left; {len(self._threads)} are there, what it ran is run again")
        for known in (self._unfit, self._asked):
            for address in known.keys() - there.keys():
                del known[address]
        for future, answer in self._answers.next_batch(block=False):
            address = next((address for address, asked in self._asked.items() if asked is future), None)
            if address is not None:
                del self._asked[address]
                self._hear(address, answer[1] if isinstance(answer, tuple) else answer, there[address])
        for address in there.keys() - self._threads.keys() - self._unfit.keys() - self._asked.keys():
            self._asked[address] = self._submit([address], fingerprint, priority=2)
            self._answers.add(self._asked[address])
        self._check_fit()
        cluster = self.client.cluster
        if cluster is not None and len(self._threads) < len(cluster.worker_spec):
            cluster.scale(len(cluster.worker_spec))  # in the place of those that nobody starts again
        return bool(self._threads)

    def _hear(self, address: str, answer: Any, threads: int) -> None:
        """Take note of what a worker has installed, or of the error that it answered with."""
        if answer == fingerprint():
            self._threads[address] = threads
            self._note(f"worker {address}: takes part, with {threads} threads; {len(self._threads)} do")
        elif not isinstance(answer, OSError | KilledWorker):  # that one died just now
            self._unfit[address] = answer if isinstance(answer, str) else f"{type(answer).__name__}: {answer}"
            self._note(f"worker {address}: takes no part, it has {self._unfit[address]}, here is {fingerprint()}")

    def _check_fit(self) -> None:
        """Say once that nobody is there; raise `ClusterError` where nobody will come, or none of them can take part."""
        now = time.monotonic()
        if self._threads:
            self._alone_since, self._told_alone = None, False
        elif self._alone_since is None:
            self._alone_since = now
        elif now - self._alone_since > ALONE_SECONDS:
            if self._unfit and not self._asked:
                address, found = next(iter(self._unfit.items()))
                msg = (
                    f"none of the {len(self._unfit)} dask workers can take part: {address} has {found}; it must be "
                    f"{fingerprint()}, as here. Install the same versions in the environment of the workers"
                )
                raise ClusterError(msg)
            if self.client.cluster is not None and now - self._alone_since > OWN_SECONDS:
                msg = (
                    f"all processes of this run are gone, and none has started again for {OWN_SECONDS:.0f} s; run "
                    "again, which goes on from the chunks that an output has, perhaps with fewer workers"
                )
                raise ClusterError(msg)
            if not self._told_alone:
                self._told_alone = True
                address = self.client.scheduler.address
                msg = f"no workers at {address}; waiting for some to join"
                if self._asked:
                    msg = f"workers at {address} have not said yet what they have installed; waiting for that"
                warnings.warn(msg, RuntimeWarning, stacklevel=2)
