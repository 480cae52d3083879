"""Chunks run by the workers of a dask cluster, which may die, start again and join while they do.

What many chunks need (record, kernel) goes to the scheduler once, as a task that
gives it back: workers pass it on among each other, and where all of them that had
it died, the scheduler has it made again. Few chunks are under way at a time,
however many there are, and their number follows that of the workers.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Hashable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
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
#: Seconds in which a result that is there must come; else its worker has died, and it is made again.
FETCH_SECONDS = 60.0
#: Seconds without any worker after which that is said.
ALONE_SECONDS = 10.0
#: Times that a chunk is handed out, each of which ended with several dead workers, before it is given up.
ATTEMPTS = 2
#: Times that a chunk may come back from workers that can't take part; between two of them is a look at who can.
REFUSALS = 20


class _OtherSourceError(Exception):
    """A worker's package is not the one that planned the sweep."""


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
    planned: str,
    kernel: RowKernel,
    record: Record,
    table: Scenarios,
    factors: tuple[np.ndarray, np.ndarray, np.ndarray],
    outputs: Sequence[str],
) -> Any:
    """Run a chunk in a worker."""
    if fingerprint() != planned:
        raise _OtherSourceError
    return run(kernel, record, table, Variants(kernel.scene, *factors), outputs)


@dataclass(frozen=True)
class _Flight:
    """A chunk under way: its position, how often workers died of it, and how often it was refused."""

    position: int
    deaths: int = 0
    refusals: int = 0


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
        self._lent: dict[Hashable, Any] = {}
        self._threads: dict[str, int] = {}  # of the workers that can take part
        self._unfit: dict[str, str] = {}
        self._looked = -np.inf
        self._alone_since: float | None = None
        self.most_in_flight = 0

    def prepare(self, shapes: Sequence[KernelShape], notify: Callable[[int, int], None] | None = None) -> int:
        """Make kernels ready on every machine that is there; returns how many had to be compiled.

        Machines that join later make theirs ready as chunks need them.
        """
        from distributed.comm import get_address_host

        while not self._look():
            time.sleep(LOOK_SECONDS)
        hosts: dict[str, list[str]] = {}
        for address in self._threads:
            hosts.setdefault(get_address_host(address), []).append(address)
        done: SimpleQueue[Any] = SimpleQueue()
        under_way = {}
        for there in hosts.values():
            for shape in shapes:
                future = self.client.submit(_ready, shape, workers=there, pure=False)
                future.add_done_callback(done.put)
                under_way[future.key] = there, future
        total, compiled = len(under_way), 0
        while under_way:
            with suppress(Empty):
                future = done.get(timeout=LOOK_SECONDS)
                under_way.pop(future.key, None)
                if future.status == "finished":  # else the first chunk that needs it says what is wrong
                    compiled += future.result()
            if time.monotonic() - self._looked > LOOK_SECONDS:
                self._look()
            for key, (there, _) in list(under_way.items()):
                if not any(address in self._threads for address in there):  # nobody else may do it
                    del under_way[key]
            if notify:
                notify((total - len(under_way)) * len(shapes) // total, len(shapes))
        return compiled

    def run(self, n: int, job: Callable[[int], Job], take: Take) -> None:
        """Run `n` chunks; see `Dispatcher.run`.

        Raises
        ------
        ClusterError
            The scheduler is gone, or none of the workers can take part.
        """
        done: SimpleQueue[Any] = SimpleQueue()
        flying: dict[str, _Flight] = {}
        fresh, again, refused = iter(range(n)), deque[_Flight](), deque[_Flight]()
        left = n
        while left:
            if time.monotonic() - self._looked > LOOK_SECONDS:
                self._look()
                again.extend(refused)
                refused.clear()
            room = max(LEAST_IN_FLIGHT, IN_FLIGHT * sum(self._threads.values()))
            while self._threads and len(flying) < room:
                flight = again.popleft() if again else _next(fresh)
                if flight is None:
                    break
                future = self._submit(job(flight.position))
                flying[future.key] = flight
                future.add_done_callback(done.put)
                self.most_in_flight = max(self.most_in_flight, len(flying))
            try:
                future = done.get(timeout=LOOK_SECONDS)
            except Empty:
                continue
            flight = flying[future.key]
            try:
                found = self._result(future, flight)
            except TimeoutError:
                future.add_done_callback(done.put)
                continue
            del flying[future.key]
            future.release()
            if isinstance(found, _Flight):
                (refused if found.refusals > flight.refusals else again).append(found)
            else:
                left -= 1
                take(flight.position, found)

    def _submit(self, mine: Job) -> Any:
        client, variants = self.client, mine.variants
        return client.submit(
            _run_there,
            self._run,
            fingerprint(),
            self._lend("kernel", mine.kernel, mine.kernel),
            self._lend("record", mine.record, self._records[mine.record]),
            mine.table,
            (variants.period_factor, variants.mass_factor, variants.damping_ratio),
            mine.outputs,
            key=f"chunk-{mine.key}-{client.id}-{time.time_ns()}",
            **self._preferring(),
        )

    def _preferring(self) -> dict[str, Any]:
        """Return how tasks are handed out: to those who can take part as long as they live."""
        if not self._unfit:
            return {"pure": False}
        return {"pure": False, "workers": list(self._threads), "allow_other_workers": True}

    def _lend(self, kind: str, known_by: Hashable, thing: Any) -> Any:
        """Return the task of the scheduler that gives `thing`, sent where it is first asked for, or was refused."""
        lent = self._lent.get((kind, known_by))
        if lent is None or lent.status == "error":
            key = f"{kind}-{self.client.id}-{time.time_ns()}"
            lent = self._lent[kind, known_by] = self.client.submit(_same, thing, key=key, **self._preferring())
        return lent

    def _result(self, future: Any, flight: _Flight) -> np.ndarray | str | _Flight:
        """Return the table of a chunk, what went wrong with it, or the flight that it takes next.

        Raises
        ------
        TimeoutError
            It has to be made again.
        """
        from distributed import KilledWorker

        try:
            found: np.ndarray | str = future.result(timeout=FETCH_SECONDS)
            return found
        except TimeoutError:
            raise
        except KilledWorker as error:
            if flight.deaths + 1 < ATTEMPTS:
                return replace(flight, deaths=flight.deaths + 1)
            return f"its workers died, {ATTEMPTS} times over: {error}"
        except (_OtherSourceError, ImportError) as error:
            if flight.refusals < REFUSALS:
                return replace(flight, refusals=flight.refusals + 1)
            return f"no worker could run it, the last one for: {type(error).__name__}: {error}"
        except Exception as error:
            if future.cancelled():
                raise self._gone(error) from None
            return f"{type(error).__name__}: {error}"

    def _gone(self, error: object) -> ClusterError:
        return ClusterError(
            f"the dask scheduler at {self.client.scheduler.address!r} is gone, or was restarted ({error}); "
            "start it and its workers again, and run again, which goes on from the chunks that an output has"
        )

    def _look(self) -> bool:
        """See who works; returns whether anybody can take part."""
        self._looked = time.monotonic()
        try:
            there = self.client.nthreads()
            known = {*self._threads, *self._unfit}
            told = self._ask([address for address in there if address not in known])
        except OSError as error:
            raise self._gone(error) from None
        for address in known - set(there):
            self._unfit.pop(address, None)
            if self._threads.pop(address, None) is not None:
                self._note(f"worker {address} has left; {len(self._threads)} are there, what it ran is run again")
        for address, answer in told.items():
            if answer == fingerprint():
                self._threads[address] = there[address]
                self._note(f"worker {address} takes part, with {there[address]} threads; {len(self._threads)} do")
            elif not isinstance(answer, OSError):  # that one died just now
                self._unfit[address] = answer if isinstance(answer, str) else f"{type(answer).__name__}: {answer}"
                self._note(f"worker {address} takes no part: it has {self._unfit[address]}, here is {fingerprint()}")
        if self._unfit and not self._threads:
            address, found = next(iter(self._unfit.items()))
            msg = (
                f"none of the {len(self._unfit)} dask workers can take part: {address} has {found}; it must be "
                f"{fingerprint()}, as here. Install the same versions in the environment of the workers"
            )
            raise ClusterError(msg)
        self._wait_alone()
        cluster = self.client.cluster
        if cluster is not None and len(self._threads) < len(cluster.worker_spec):
            cluster.scale(len(cluster.worker_spec))  # in the place of those that nobody starts again
        return bool(self._threads)

    def _ask(self, addresses: list[str]) -> dict[str, Any]:
        """Return what workers have installed, or the error that they answered with."""
        if not addresses:
            return {}
        answers: dict[str, Any] = self.client.run(fingerprint, workers=addresses, on_error="return")
        return answers

    def _wait_alone(self) -> None:
        """Say once that nobody is there."""
        if self._threads:
            self._alone_since = None
        elif self._alone_since is None:
            self._alone_since = time.monotonic()
        elif time.monotonic() - self._alone_since > ALONE_SECONDS:
            self._alone_since = np.inf
            self._note(f"no workers at {self.client.scheduler.address}; waiting for some to join")


def _next(fresh: Any) -> _Flight | None:
    position = next(fresh, None)
    return None if position is None else _Flight(position)
