"""Chunks run by the workers of a dask cluster, which may die, start again and join while they do.

What many chunks need (record, kernel) goes to the scheduler once, as a task that
gives it back: workers pass it on among each other, and where all of them that had
it died, the scheduler has it made again. Few chunks are under way at a time,
however many there are, and their number follows that of the workers.
"""

from __future__ import annotations

import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
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
#: Seconds in which a result that is there must come; else its worker has died, and it is made again.
FETCH_SECONDS = 20.0
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


class _LostError(Exception):
    """A chunk did not come back."""


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
        self._told_alone = self._asking = False
        self._answers: SimpleQueue[dict[str, Any]] = SimpleQueue()
        self.most_in_flight = 0

    def prepare(self, shapes: Sequence[KernelShape], notify: Callable[[int, int], None] | None = None) -> int:
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
                with suppress(Exception):  # the first chunk that needs it says what is wrong
                    compiled += future.result(timeout=FETCH_SECONDS)
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
        flying: dict[str, tuple[Any, _Flight]] = {}
        fresh, again, suspects = map(_Flight, range(n)), deque[_Flight](), deque[_Flight]()
        left = n

        def begin(flight: _Flight) -> None:
            future = self._submit(job(flight.position), flight.workers)
            flying[future.key] = future, flight
            future.add_done_callback(done.put)
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
                future = done.get(timeout=LOOK_SECONDS)
            except Empty:
                continue
            if future.key not in flying:
                continue
            flight = flying[future.key][1]
            try:
                found = self._result(future)
            except TimeoutError:  # made again, wherever that is
                future.add_done_callback(done.put)
                continue
            except _LostError as error:
                del flying[future.key]
                lose(flight, error)
                continue
            del flying[future.key]
            future.release()
            land(flight, found)

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
            future = self.client.submit(_same, thing, key=key, pure=False, workers=list(workers))
            self._lent[kind, known_by] = future, workers
        return self._lent[kind, known_by][0]

    def _stranded(self, flying: Mapping[str, tuple[Any, _Flight]]) -> list[str]:
        """Return what nobody can run any more, or what needs that: dask waits for the workers it was meant for."""
        if any(workers.isdisjoint(self._threads) for _, workers in self._lent.values()):
            self._lent.clear()
            return list(flying)
        return [key for key, (_, flight) in flying.items() if flight.workers.isdisjoint(self._threads)]

    def _result(self, future: Any) -> np.ndarray | str:
        """Return the table of a chunk, or what went wrong in it.

        Raises
        ------
        TimeoutError
            Its worker died with it.
        _LostError
            It does not come.
        """
        try:
            found: np.ndarray | str = future.result(timeout=FETCH_SECONDS)
            return found
        except TimeoutError:
            raise
        except Exception as error:
            if future.cancelled():
                raise self._gone(error) from None
            msg = f"{type(error).__name__}: {error}"
            raise _LostError(msg) from None

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
            self._asking = False
            for address, answer in self._answers.get().items():
                if address in there:
                    self._hear(address, answer, there[address])
        self._ask(address for address in there if address not in self._threads and address not in self._unfit)
        self._check_fit()
        cluster = self.client.cluster
        if cluster is not None and len(self._threads) < len(cluster.worker_spec):
            cluster.scale(len(cluster.worker_spec))  # in the place of those that nobody starts again
        return bool(self._threads)

    def _ask(self, newcomers: Iterable[str]) -> None:
        """Have workers asked what they have installed; one that does not answer keeps nobody waiting but newcomers."""
        addresses = list(newcomers)
        if not addresses or self._asking:
            return
        self._asking = True

        def ask() -> None:
            answers = {}
            with suppress(Exception):  # they are asked again at the next look
                answers = self.client.run(fingerprint, workers=addresses, on_error="return")
            self._answers.put(answers)

        threading.Thread(target=ask, daemon=True).start()

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
