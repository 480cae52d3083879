"""Workers of a dask cluster: one at an address, or processes of this machine that are started here."""

from __future__ import annotations

import signal
import threading
import time
import warnings
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

import dask
import numpy as np
from distributed import Client, LocalCluster, WorkerPlugin, as_completed, get_worker
from distributed.comm import get_address_host

from pounding_sweep.base.errors import ClusterError
from pounding_sweep.engine.row_kernel import RowKernel
from pounding_sweep.kernel.spec import KernelSpec
from pounding_sweep.model.variants import Variants
from pounding_sweep.output.identity import fingerprint
from pounding_sweep.plan.scenarios import ChunkTask, Receive, Run, Scenarios
from pounding_sweep.records import Record

#: Chunks in flight per thread of a worker: one runs, one waits next to it, one is on its way back.
IN_FLIGHT = 3
#: Seconds between two looks at which workers are there, and between two at what is done.
POLL_SECONDS, GLANCE_SECONDS = 1.0, 0.01
#: Seconds without any worker that can take part after which that is said.
ALONE_SECONDS = 10.0
#: Seconds that workers which are there at the start have to say what they have installed, before the rest begins.
ANSWER_SECONDS = 5.0
#: Times that all workers of a chunk may die before it runs alone, and again until it is given up.
LOSSES = 2
#: Settings of the cluster that is started here: a process that ended has time to start again even on a busy machine,
#: and a chunk beside which its worker died twice runs alone.
SETTINGS = {"distributed.deploy.lost-worker-timeout": 600.0, "distributed.scheduler.allowed-failures": 1}
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
            raise ClusterError(
                f"no dask scheduler answers at {scheduler!r} ({error}); start one with 'dask scheduler' and give the "
                "address that it prints, or run with the scheduler 'threads'"
            ) from None
        with client:
            yield client
        return
    with ExitStack() as opened:
        opened.enter_context(dask.config.set(SETTINGS))
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


class ClusterWorkers:
    """The workers of a cluster that have the versions of this process; dask shares chunks out among them."""

    def __init__(self, client: Client, records: Sequence[Record], run: Run, note: Callable[[str], None]) -> None:
        self.client, self._records, self._run, self._note = client, records, run, note
        self._sent: dict[int, Any] = {}  # tasks that give records, which dask repeats for those that need them
        self._versions: dict[str, Any] = {}  # of each worker, the task that tells what it has installed
        self._fit: dict[str, int] = {}  # threads of the workers that can take part
        self._unfit: dict[str, str] = {}  # what the others have installed
        self._polled, self._alone_since = -np.inf, np.inf

    def prepare(self, shapes: Sequence[KernelSpec], advance: Callable[[int], None] | None = None) -> int:
        """Make kernels ready on every machine that is there; returns how many had to be compiled."""
        self._check_scheduler()
        patience = time.monotonic() + ANSWER_SECONDS
        while not self._fit or (self._unanswered and time.monotonic() < patience):
            self._poll_workers()
            time.sleep(GLANCE_SECONDS)
        hosts = sorted({get_address_host(address) for address in self._fit})
        compiled = done = 0

        def submit(position: int) -> Any:
            host, shape = hosts[position % len(hosts)], shapes[position // len(hosts)]
            there = [address for address in self._fit if get_address_host(address) == host]
            return self._submit(there or list(self._fit), _ready, shape)

        def receive(position: int, result: Any) -> None:
            nonlocal compiled, done
            compiled, done = compiled + (result is True), done + 1
            if advance and not done % len(hosts):
                advance(1)

        for position, _ in self._complete(range(len(hosts) * len(shapes)), submit, receive):
            receive(position, False)  # the first chunk that needs it says what is wrong
        return compiled

    def run(self, n: int, task_of: Callable[[int], ChunkTask], receive: Receive) -> None:
        """Run `n` chunks; see `Dispatcher.run`."""

        def submit(position: int) -> Any:
            task = task_of(position)
            more = self._send(task.record), task.table, task.variants.columns, task.outputs
            return self._submit(list(self._fit), _run_there, fingerprint(), self._run, task.kernel, *more)

        # what failed may only have run beside what killed its worker: it has another chance alone
        for position, _ in self._complete(range(n), submit, receive):
            for _, error in self._complete([position], submit, receive):
                receive(position, f"{type(error).__name__}: {error}")

    def _complete(
        self, positions: Sequence[int], submit: Callable[[int], Any], receive: Callable[[int, Any], None]
    ) -> list[tuple[int, Exception]]:
        """Submit tasks in order, few at a time, and take their results; returns those that failed, and their errors."""
        waiting, losses = deque(positions), Counter[int]()
        in_flight: dict[Any, tuple[int, set[str]]] = {}
        failed: list[tuple[int, Exception]] = []
        done = as_completed(loop=self.client.loop, with_results=True, raise_errors=False)
        while waiting or in_flight:
            self._poll_workers()
            for future, (position, workers) in list(in_flight.items()):
                if workers.isdisjoint(self._fit):  # for which dask waits for ever
                    del in_flight[future]
                    future.cancel()
                    losses[position] += 1
                    if losses[position] < LOSSES:
                        waiting.append(position)
                    else:
                        failed.append((position, RuntimeError("its workers died, or no longer answered")))
            while waiting and len(in_flight) < IN_FLIGHT * sum(self._fit.values()):
                position = waiting.popleft()
                try:
                    future = submit(position)
                except MemoryError as error:  # it costs this chunk only
                    receive(position, f"MemoryError: {error}")
                    continue
                in_flight[future] = position, set(self._fit)
                done.add(future)
            if not done.has_ready():
                time.sleep(GLANCE_SECONDS)
            for future, result in done.next_batch(block=False):
                if future not in in_flight:
                    continue
                position, _ = in_flight.pop(future)
                if future.status == "finished":
                    receive(position, result)
                    continue
                cause = result[1] if isinstance(result, tuple) else result
                if future.cancelled():
                    raise self._gone(cause)
                if isinstance(cause, _UnfitError):  # it is asked again
                    self._fit.pop(cause.args[0], None)
                    self._versions.pop(cause.args[0], None)
                failed.append((position, cause))
        return failed

    def _submit(self, workers: Sequence[str], function: Callable[..., Any], *arguments: Any, priority: int = 0) -> Any:
        return self.client.submit(function, *arguments, workers=workers, pure=False, priority=priority)

    def _send(self, index: int) -> Any:
        """Return the task that gives a record, sent once; what is scattered would be lost with its worker."""
        if index not in self._sent or self._sent[index].status == "error":  # all who held it died beside others
            # before all chunks that wait: those of every worker need it
            self._sent[index] = self._submit(list(self._fit), _same, self._records[index], priority=1)
        return self._sent[index]

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
            raise ClusterError(
                f"the dask scheduler at {self.client.scheduler.address!r} can't load the package ({error}); install "
                f"{fingerprint()} in its environment, as here"
            ) from None
        except OSError as error:
            raise self._gone(error) from None

    @property
    def _unanswered(self) -> int:
        """How many workers have not said yet what they have installed."""
        return len(self._versions) - len(self._fit) - len(self._unfit)

    def _poll_workers(self) -> None:
        """See now and then who is there, and what newcomers have installed."""
        now = time.monotonic()
        if now - self._polled < POLL_SECONDS:
            return
        self._polled = now
        try:
            there = self.client.nthreads()
        except Exception as error:  # whatever it is: the scheduler does not answer
            raise self._gone(error) from None
        before = set(self._fit)
        for address in self._versions.keys() - there.keys():
            del self._versions[address]
            self._unfit.pop(address, None)
            if self._fit.pop(address, None):
                self._note(f"worker {address}: has left; {len(self._fit)} are there, what it ran is run again")
        for address, threads in there.items():
            if address not in self._versions:
                self._versions[address] = self._submit([address], fingerprint, priority=2)
            elif address not in self._fit and address not in self._unfit and self._versions[address].done():
                self._admit(address, threads)
        if before != set(self._fit):
            self._sent.clear()  # a record is for the workers that were there when it was sent
        self._check_fit(now)

    def _admit(self, address: str, threads: int) -> None:
        """Let a worker take part that has the versions of this process."""
        answer = self._versions[address]
        versions = answer.result() if answer.status == "finished" else repr(answer.exception())
        if versions == fingerprint():
            self._fit[address] = threads
            self._note(f"worker {address}: takes part, with {threads} threads; {len(self._fit)} do")
        else:
            self._unfit[address] = versions
            self._note(f"worker {address}: takes no part, it has {versions}, here is {fingerprint()}")

    def _check_fit(self, now: float) -> None:
        """Say once that nobody can take part; raise `ClusterError` if all that are there have other versions."""
        self._alone_since = np.inf if self._fit else min(now, self._alone_since)
        if now - self._alone_since > ALONE_SECONDS:
            if self._unfit and not self._unanswered:
                address, versions = next(iter(self._unfit.items()))
                raise ClusterError(
                    f"none of the {len(self._unfit)} dask workers can take part: {address} has {versions}; it must be "
                    f"{fingerprint()}, as here. Install the same versions in the environment of the workers"
                )
            where = self.client.scheduler.address
            msg = f"no workers at {where}; waiting for some to join"
            if self._unanswered:
                msg = f"workers at {where} have not said yet what they have installed; waiting for that"
            warnings.warn(msg, RuntimeWarning, stacklevel=2)
            self._alone_since = now
