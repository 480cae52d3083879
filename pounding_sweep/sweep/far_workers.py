"""Chunks run by the workers of a dask cluster, which may die, start again and join while they do.

What many chunks need (record, kernel) goes to the scheduler once, as a task that
gives it back: workers pass it on among each other, and where all of them that had
it died, the scheduler has it made again. Few chunks are under way at a time,
however many there are, and their number follows that of the workers.
"""

from __future__ import annotations

import asyncio
import time
import warnings
from collections import deque
from collections.abc import Callable, Coroutine, Hashable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np

from pounding_sweep.errors import ClusterError
from pounding_sweep.kernels.shape import KernelShape
from pounding_sweep.records import Record
from pounding_sweep.sweep.blocks import RowKernel
from pounding_sweep.sweep.jobs import Job, Run, Take
from pounding_sweep.sweep.scenarios import Scenarios
from pounding_sweep.sweep.source import fingerprint
from pounding_sweep.sweep.variants import Variants

#: Chunks under way per thread of the cluster: one runs, one waits beside it, one is on its way back.
IN_FLIGHT = 3
#: Chunks under way however few threads there are, so that workers who join find something to do.
LEAST_IN_FLIGHT = 8
#: Seconds between two looks at who works.
LOOK_SECONDS = 1.0
#: Seconds without any worker that can take part after which that is said.
ALONE_SECONDS = 10.0
#: Times that a chunk may lose its worker while nothing else runs, before it is given up.
ATTEMPTS = 3


def _same(thing: Any) -> Any:
    """Give back what came with the task."""
    return thing


def _ready(shape: KernelShape) -> bool:
    """Make a kernel ready in a worker; returns whether it had to be compiled."""
    from pounding_sweep.kernels.cache import get_kernel, is_cached, is_loaded

    there = is_loaded(shape) or is_cached(shape)
    get_kernel(shape)
    return not there


def _run_there(
    run: Run,
    kernel: RowKernel,
    record: Record,
    table: Scenarios,
    factors: tuple[np.ndarray, np.ndarray, np.ndarray],
    outputs: Sequence[str],
) -> np.ndarray | str:
    """Run a chunk in a worker."""
    return run(kernel, record, table, Variants(kernel.scene, *factors), outputs)


@dataclass(frozen=True)
class _Flight:
    """A chunk handed out: its position, and the workers that may run it.

    One that was lost may have been what its workers died of: it is `suspect`, and runs again
    where nothing else does; `losses` counts how often it was lost there.
    """

    position: int
    workers: frozenset[str] = frozenset()
    suspect: bool = False
    losses: int = 0


class FarWorkers:
    """The workers of a cluster.

    Parameters
    ----------
    client : distributed.Client
        Open.
    records : sequence of Record
        Ground motions by index.
    run : callable
        What is done with a chunk; can be pickled.
    note : callable
        Told of workers that come and go.

    Attributes
    ----------
    client : distributed.Client
        As given.
    most_in_flight : int
        Largest number of chunks that were under way at a time.
    """

    def __init__(self, client: Any, records: Sequence[Record], run: Run, note: Callable[[str], None]) -> None:
        self.client, self._records, self._run, self._note = client, records, run, note
        self._lent: dict[Hashable, tuple[Any, frozenset[str]]] = {}
        self._numbers = count()
        self._threads: dict[str, int] = {}  # of the workers that can take part
        self._unfit: dict[str, str] = {}
        self._looked = -np.inf
        self._alone_since: float | None = None
        self._told_alone = False
        self._asked: set[str] = set()
        self._answers: SimpleQueue[tuple[str, Future[Any]]] = SimpleQueue()
        self.most_in_flight = 0

    def prepare(self, shapes: Sequence[KernelShape], advance: Callable[[int], None] | None = None) -> int:
        """Make kernels ready on every machine that is there; returns how many had to be compiled.

        Machines that join later make theirs ready as chunks need them.
        """
        from distributed.comm import get_address_host

        self._check_scheduler()
        while not self._look():
            time.sleep(LOOK_SECONDS / 10)
        hosts: dict[str, list[str]] = {}
        for address in self._threads:
            hosts.setdefault(get_address_host(address), []).append(address)
        done: SimpleQueue[tuple[str, Future[Any]]] = SimpleQueue()
        under_way = {}
        for there in hosts.values():
            for shape in shapes:
                future = self.client.submit(_ready, shape, workers=there, pure=False)
                under_way[future.key] = there, future
                self._fetch(future, done)
        total, told, compiled = len(under_way), 0, 0
        while under_way:
            with suppress(Empty):
                key, found = done.get(timeout=LOOK_SECONDS)
                under_way.pop(key, None)
                with suppress(Exception):  # the first chunk that needs it says what is wrong
                    compiled += found.result()
            if time.monotonic() - self._looked > LOOK_SECONDS:
                self._look()
            for key, (there, _) in list(under_way.items()):
                if not any(address in self._threads for address in there):  # nobody else may do it
                    del under_way[key]
            ready = (total - len(under_way)) * len(shapes) // total
            if advance and ready > told:
                advance(ready - told)
                told = ready
        return compiled

    def run(self, n: int, job: Callable[[int], Job], take: Take) -> None:
        """Run `n` chunks; see `Dispatcher.run`.

        Raises
        ------
        ClusterError
            The scheduler is gone, or none of the workers can take part.
        """
        done: SimpleQueue[tuple[str, Future[Any]]] = SimpleQueue()
        flying: dict[str, tuple[Any, _Flight]] = {}
        fresh, again, suspects = map(_Flight, range(n)), deque[_Flight](), deque[_Flight]()
        left = n

        def begin(flight: _Flight) -> None:
            future = self._submit(job(flight.position), flight.workers)
            flying[future.key] = future, flight
            self._fetch(future, done)
            self.most_in_flight = max(self.most_in_flight, len(flying))

        def land(flight: _Flight, found: np.ndarray | str) -> None:
            nonlocal left
            left -= 1
            take(flight.position, found)

        def lose(flight: _Flight, why: object) -> None:
            losses = flight.losses + flight.suspect
            if losses < ATTEMPTS:
                suspects.append(replace(flight, suspect=True, losses=losses))
            else:
                land(flight, f"lost {ATTEMPTS} times while nothing else ran: {why}")

        while left:
            if time.monotonic() - self._looked > LOOK_SECONDS:
                self._look()
                for key in self._stranded(flying):
                    future, flight = flying.pop(key)
                    future.release()
                    if flight.workers.isdisjoint(self._threads):
                        lose(flight, "its worker died")
                    else:
                        (suspects if flight.suspect else again).append(flight)
            room = max(LEAST_IN_FLIGHT, IN_FLIGHT * sum(self._threads.values()))
            while self._threads and len(flying) < room:
                following = again.popleft() if again else next(fresh, None)
                if following is None:
                    break
                begin(replace(following, workers=frozenset(self._threads)))
            if self._threads and suspects and not flying:
                begin(replace(suspects.popleft(), workers=frozenset([min(self._threads)])))
            try:
                key, found = done.get(timeout=LOOK_SECONDS)
            except Empty:
                continue
            if key not in flying:  # it was stranded
                continue
            future, flight = flying.pop(key)
            try:
                table = found.result()
            except Exception as error:  # a task gives back what goes wrong in it: this is of the cluster
                if future.cancelled():
                    raise self._gone(error) from None
                lose(flight, f"{type(error).__name__}: {error}")
                continue
            future.release()
            land(flight, table)

    def _fetch(self, future: Any, done: SimpleQueue[tuple[str, Future[Any]]]) -> None:
        """Have the result of a task put into `done`, once it is here; one that does not come keeps no other waiting."""
        self._begin(self.client.gather(future, asynchronous=True), future.key, done)

    def _begin(
        self, coroutine: Coroutine[Any, Any, Any], name: str, done: SimpleQueue[tuple[str, Future[Any]]]
    ) -> None:
        """Begin something in the client's thread; what comes of it is put into `done` under its name."""
        begun = asyncio.run_coroutine_threadsafe(coroutine, self.client.loop.asyncio_loop)
        begun.add_done_callback(lambda it: done.put((name, it)))

    def _submit(self, mine: Job, workers: Iterable[str]) -> Any:
        client, variants = self.client, mine.variants
        return client.submit(
            _run_there,
            self._run,
            self._lend("kernel", mine.kernel, mine.kernel),
            self._lend("record", mine.record, self._records[mine.record]),
            mine.table,
            (variants.period_factor, variants.mass_factor, variants.damping_ratio),
            mine.outputs,
            key=f"chunk-{mine.key}-{client.id}-{next(self._numbers)}",
            pure=False,
            workers=list(workers),
        )

    def _lend(self, kind: str, known_by: Hashable, thing: Any) -> Any:
        """Return the task of the scheduler that gives `thing`, sent when it is first asked for."""
        if (kind, known_by) not in self._lent:
            key = f"{kind}-{self.client.id}-{next(self._numbers)}"
            workers = frozenset(self._threads)
            # before all chunks that wait: those of every worker need it
            future = self.client.submit(_same, thing, key=key, pure=False, workers=list(workers), priority=1)
            self._lent[kind, known_by] = future, workers
        return self._lent[kind, known_by][0]

    def _stranded(self, flying: Mapping[str, tuple[Any, _Flight]]) -> list[str]:
        """Return what nobody can run any more, or what needs that: dask waits for the workers it was meant for."""
        if any(workers.isdisjoint(self._threads) for _, workers in self._lent.values()):
            self._lent.clear()
            return list(flying)
        return [key for key, (_, flight) in flying.items() if flight.workers.isdisjoint(self._threads)]

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
        for address in {*self._threads, *self._unfit} - set(there):
            self._unfit.pop(address, None)
            if self._threads.pop(address, None) is not None:
                self._note(f"worker {address} has left; {len(self._threads)} are there, what it ran is run again")
        while not self._answers.empty():
            address, answers = self._answers.get()
            self._asked.discard(address)
            try:
                answer = answers.result()[address]
            except Exception:  # whatever it was: it is asked again at the next look
                continue
            if address in there:
                self._hear(address, answer, there[address])
        self._asked &= set(there)
        self._ask(address for address in there if address not in {*self._threads, *self._unfit, *self._asked})
        self._check_fit()
        cluster = self.client.cluster
        if cluster is not None and len(self._threads) < len(cluster.worker_spec):
            cluster.scale(len(cluster.worker_spec))  # in the place of those that nobody starts again
        return bool(self._threads)

    def _ask(self, newcomers: Iterable[str]) -> None:
        """Have workers asked what they have installed; one that does not answer keeps nobody waiting."""
        for address in newcomers:
            self._asked.add(address)
            asking = self.client.run(fingerprint, workers=[address], on_error="return", asynchronous=True)
            self._begin(asking, address, self._answers)

    def _hear(self, address: str, answer: Any, threads: int) -> None:
        """Take note of what a worker has installed, or of the error that it answered with."""
        if answer == fingerprint():
            self._threads[address] = threads
            self._note(f"worker {address} takes part, with {threads} threads; {len(self._threads)} do")
        elif not isinstance(answer, OSError):  # that one died just now
            self._unfit[address] = answer if isinstance(answer, str) else f"{type(answer).__name__}: {answer}"
            self._note(f"worker {address} takes no part: it has {self._unfit[address]}, here is {fingerprint()}")

    def _check_fit(self) -> None:
        """Say once that nobody is there; raise `ClusterError` where all who are there can't take part."""
        now = time.monotonic()
        if self._threads:
            self._alone_since, self._told_alone = None, False
        elif self._alone_since is None:
            self._alone_since = now
        elif now - self._alone_since > ALONE_SECONDS:
            if self._unfit:
                address, found = next(iter(self._unfit.items()))
                msg = (
                    f"none of the {len(self._unfit)} dask workers can take part: {address} has {found}; it must be "
                    f"{fingerprint()}, as here. Install the same versions in the environment of the workers"
                )
                raise ClusterError(msg)
            if not self._told_alone:
                self._told_alone = True
                msg = f"no workers at {self.client.scheduler.address}; waiting for some to join"
                warnings.warn(msg, RuntimeWarning, stacklevel=2)
