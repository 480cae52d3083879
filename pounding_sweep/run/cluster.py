"""Workers of a dask cluster: one at an address, or processes of this machine that are started here."""

from __future__ import annotations

import signal
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

import dask
import numpy as np
from distributed import Client, LocalCluster, WorkerPlugin, as_completed
from distributed.comm import get_address_host

from pounding_sweep.base.errors import ClusterError
from pounding_sweep.engine.compile import prepare
from pounding_sweep.kernel.spec import KernelSpec
from pounding_sweep.output.identity import fingerprint
from pounding_sweep.plan.scenarios import ChunkTask
from pounding_sweep.run.diagnosis import THREAD_LIMITS

#: Chunks in flight per thread of a worker: one runs, one waits next to it, one is on its way back.
IN_FLIGHT = 3
#: Seconds between two looks at which workers are there, and between two at what is done.
POLL_SECONDS, GLANCE_SECONDS = 1.0, 0.01
#: Seconds without any worker that can take part after which that is said.
ALONE_SECONDS = 10.0
#: Times that all workers of a chunk may die before it runs alone, and again until it is given up.
LOSSES = 2
#: Settings of the cluster that is started here: workers may take long to start again, and a chunk beside which its
#: worker died twice runs alone.
SETTINGS = {"distributed.deploy.lost-worker-timeout": 600.0, "distributed.scheduler.allowed-failures": 1}
#: One scenario runs in one thread, and a worker has as many as its cluster gave it: no library starts more.
ONE_THREAD = dict.fromkeys(THREAD_LIMITS, "1")


class IgnoreSignals(WorkerPlugin):
    """Workers that are started here leave Ctrl-C and SIGHUP to their client, though all get them."""

    def setup(self, worker: object) -> None:
        """Ignore both; dask calls this in the main thread of each worker, those that join later too."""
        for number in (signal.SIGINT, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)


@contextmanager
def _interrupts_later() -> Iterator[None]:
    """Have Ctrl-C, SIGTERM and SIGHUP wait for the end of the block; only a main thread can be interrupted at all."""
    waiting: list[int] = []
    in_main = threading.current_thread() is threading.main_thread()
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP) if in_main else ()
    before = {number: signal.signal(number, lambda number, _: waiting.append(number)) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if waiting:
            signal.raise_signal(waiting[0])


@contextmanager
def cluster_client(scheduler: str | Client, workers: int) -> Iterator[Client]:
    """Give a client of the cluster at an address, or of processes that are started here and end with it."""
    if not isinstance(scheduler, str):
        yield scheduler  # the caller's own, who closes it
        return
    with ExitStack() as opened:
        if "://" in scheduler:
            try:
                client = opened.enter_context(Client(scheduler, set_as_default=False))
            except (OSError, ValueError, TypeError, ImportError) as error:  # the last two: of tls:// and ucx://
                raise ClusterError(
                    f"no dask scheduler answers at {scheduler!r} ({error}); start one with 'dask scheduler' and give "
                    "the address that it prints, or run with the scheduler 'threads'"
                ) from None
        else:
            opened.enter_context(dask.config.set(SETTINGS))
            with _interrupts_later():
                try:
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
                except RuntimeError as error:  # dask says no more
                    raise ClusterError(
                        f"no process of {workers} could be started ({error}); see what it printed"
                    ) from None
                client = opened.enter_context(Client(opened.enter_context(cluster), set_as_default=False))
                client.register_plugin(IgnoreSignals())
        yield client


class ClusterWorkers:
    """The workers of a cluster that have the versions of this process; dask shares chunks out among them."""

    def __init__(self, client: Client, run: Callable[..., np.ndarray | str], note: Callable[[str], None]) -> None:
        self.client, self._run, self._note = client, run, note
        self._versions: dict[str, Any] = {}  # what each worker has installed, or why it can't tell
        self._threads: dict[str, int] = {}  # of the workers that take part
        self._looked, self._alone_since = -np.inf, np.inf

    def prepare(self, shapes: Sequence[KernelSpec], advance: Callable[[int], None]) -> int:
        """Make kernels ready on every machine that is there; returns how many had to be compiled."""
        try:
            self.client.run_on_scheduler(fingerprint)  # it unpacks what goes to the workers
        except (ImportError, AttributeError) as error:
            raise ClusterError(
                f"the dask scheduler at {self.client.scheduler.address!r} can't load the package ({error}); install "
                f"{fingerprint()} in its environment, as here"
            ) from None
        while not self._threads:
            self._look()
            time.sleep(GLANCE_SECONDS)
        hosts: dict[str, dict[str, int]] = {}
        for address, threads in self._threads.items():
            hosts.setdefault(get_address_host(address), {})[address] = threads

        def submit(workers: dict[str, int]) -> Any:
            present = list(workers.keys() & self._threads.keys()) or list(self._threads)
            return self.client.submit(prepare, shapes, sum(workers.values()), workers=present, pure=False)

        # where it fails, the first chunk that needs a kernel says what is wrong
        counts = [result for _, result in self._complete(hosts.values(), submit) if isinstance(result, int)]
        advance(len(shapes))
        return sum(counts)

    def run(self, items: Iterable[Any], task_of: Callable[[Any], ChunkTask]) -> Iterator[tuple[Any, np.ndarray | str]]:
        """Run a task for each item; see `Dispatcher.run`."""

        def submit(item: Any) -> Any:
            return self.client.submit(self._run, task_of(item), workers=list(self._threads), pure=False)

        failed = []
        for item, result in self._complete(items, submit):
            if isinstance(result, Exception):
                failed.append(item)
            else:
                yield item, result
        for item in failed:  # it may only have run beside what killed its worker: it has another chance alone
            for _, result in self._complete([item], submit):
                yield item, f"{type(result).__name__}: {result}" if isinstance(result, Exception) else result

    def _complete(self, items: Iterable[Any], submit: Callable[[Any], Any]) -> Iterator[tuple[Any, Any]]:
        """Submit tasks in order, few at a time; give their results, or the errors that ended them, as they come."""
        waiting = deque((item, 0) for item in items)  # and how often all of its workers died
        in_flight: dict[Any, tuple[Any, int, set[str]]] = {}
        done = as_completed(loop=self.client.loop, with_results=True, raise_errors=False)
        while waiting or in_flight:
            self._look()
            for future, (item, losses, workers) in list(in_flight.items()):
                if workers.isdisjoint(self._threads):  # for which dask waits for ever
                    del in_flight[future]
                    future.cancel()
                    if losses + 1 < LOSSES:
                        waiting.append((item, losses + 1))
                    else:
                        yield item, RuntimeError("its workers died, or no longer answered")
            while waiting and len(in_flight) < IN_FLIGHT * sum(self._threads.values()):
                item, losses = waiting.popleft()
                future = submit(item)
                in_flight[future] = item, losses, set(self._threads)
                done.add(future)
            if not done.has_ready():
                time.sleep(GLANCE_SECONDS)
            for future, answer in done.next_batch(block=False):
                if future in in_flight:
                    item, *_ = in_flight.pop(future)
                    result = answer[1] if future.status != "finished" and isinstance(answer, tuple) else answer
                    if future.cancelled():
                        raise self._gone(result)
                    yield item, result

    def _gone(self, error: object) -> ClusterError:
        return ClusterError(
            f"the dask scheduler at {self.client.scheduler.address!r} is gone, or was restarted ({error}); "
            "start it and its workers again, and run again, which goes on from the chunks that an output has"
        )

    def _look(self) -> None:
        """See now and then who is there, what newcomers have installed, and whether anybody can take part."""
        now, expected = time.monotonic(), fingerprint()
        if now - self._looked < POLL_SECONDS:
            return
        self._looked = now
        try:
            present = self.client.nthreads()
            if newcomers := present.keys() - self._versions.keys():
                self._versions |= self.client.run(fingerprint, workers=list(newcomers), on_error="return")
        except Exception as error:  # whatever it is: the scheduler does not answer
            raise self._gone(error) from None
        for address in self._versions.keys() - present.keys():
            del self._versions[address]
            if self._threads.pop(address, None):
                self._note(f"worker {address}: has left; {len(self._threads)} are there, what it ran is run again")
        for address in newcomers:
            if (versions := self._versions.get(address)) == expected:
                self._threads[address] = present[address]
                self._note(f"worker {address}: takes part, with {present[address]} threads; {len(self._threads)} do")
            else:
                self._note(f"worker {address}: takes no part, it has {versions}, here is {expected}")
        self._alone_since = np.inf if self._threads else min(now, self._alone_since)
        if now - self._alone_since > ALONE_SECONDS:
            for address, versions in self._versions.items():
                raise ClusterError(
                    f"none of the {len(self._versions)} dask workers can take part: {address} has {versions}; it must "
                    f"be {expected}, as here. Install the same versions in the environment of the workers"
                )
            msg = f"no workers at {self.client.scheduler.address}; waiting for some to join"
            warnings.warn(msg, RuntimeWarning, stacklevel=2)
            self._alone_since = now
