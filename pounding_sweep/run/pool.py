"""Chunks handed to dask's workers, and what they found handed back as it comes."""

from __future__ import annotations

import asyncio
import time
import warnings
from collections import Counter, deque
from collections.abc import Callable, Coroutine, Hashable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np

from pounding_sweep.base.errors import ClusterError
from pounding_sweep.emit.spec import KernelSpec
from pounding_sweep.engine.row_kernel import RowKernel
from pounding_sweep.model.variants import Variants
from pounding_sweep.output.provenance import fingerprint
from pounding_sweep.plan.chunks import Job, Run, Take
from pounding_sweep.plan.scenarios import Scenarios
from pounding_sweep.records import Record
from pounding_sweep.resume.reuse import EarlierCube
from pounding_sweep.run.cluster import cluster_client

#: Chunks under way per thread of a worker: one runs, one waits beside it, one is on its way back.
IN_FLIGHT = 3
#: Seconds between two looks at who works.
LOOK_SECONDS = 1.0
#: Seconds without any worker that can take part after which that is said.
ALONE_SECONDS = 10.0
#: Seconds without any of the processes that the run has started after which it ends: nobody else will come.
OWN_SECONDS = 120.0
#: Seconds that those who are there at the start have to say what they have installed, before the rest begins.
ANSWER_SECONDS = 5.0
#: Seconds without a word from a worker after which the others go on without it, until it is heard again.
QUIET_SECONDS = 30.0
#: Times that a chunk may lose its worker while others run there too, before it runs alone.
TOGETHER = 2
#: Times that it may do so while it runs alone, before it is given up.
ALONE = 3


def _same(thing: Any) -> Any:
    """Give back what came with the task."""
    return thing


def _ready(shape: KernelSpec) -> bool:
    """Make a kernel ready in a worker; returns whether it had to be compiled."""
    from pounding_sweep.engine.cache import get_kernel, is_cached, is_loaded

    there = is_loaded(shape) or is_cached(shape)
    get_kernel(shape)
    return not there


def _heard(dask_scheduler: Any) -> dict[str, tuple[int, str, float]]:
    """Return threads, status and seconds since the last word, of each worker of a scheduler."""
    now = time.time()
    return {
        address: (worker.nthreads, worker.status.name, now - worker.last_seen)
        for address, worker in dask_scheduler.workers.items()
    }


def _by_turns(room: Mapping[str, int]) -> Iterator[str]:
    """Give each worker's name as often as it has room, those with most room first."""
    for level in range(max(room.values(), default=0), 0, -1):
        yield from (worker for worker, free in room.items() if free >= level)


class _UnfitError(Exception):
    """The worker at an address is not the one that was asked: it has other versions."""


def _run_there(
    versions: str,
    run: Run,
    kernel: RowKernel,
    record: Record,
    table: Scenarios,
    factors: tuple[np.ndarray, np.ndarray, np.ndarray],
    outputs: Sequence[str],
) -> np.ndarray | str:
    """Run a chunk in a worker, if it still has the versions that it said."""
    if fingerprint() != versions:
        from distributed import get_worker

        raise _UnfitError(get_worker().address)
    return run(kernel, record, table, Variants(kernel.scene, *factors), outputs)


@dataclass(frozen=True)
class _Flight:
    """A chunk on its way: its position, its worker, and how often it was lost with one.

    What was lost may have been what its worker died of: after the second time it runs where nothing else does.
    """

    position: int
    worker: str = ""
    losses: int = 0

    @property
    def suspect(self) -> bool:
        """Whether it must run alone."""
        return self.losses >= TOGETHER


class FarWorkers:
    """The workers of a cluster."""

    def __init__(self, client: Any, records: Sequence[Record], run: Run, note: Callable[[str], None]) -> None:
        self.client, self._records, self._run, self._note = client, records, run, note
        self._lent: dict[Hashable, tuple[Any, frozenset[str]]] = {}
        self._numbers = count()
        self._threads: dict[str, int] = {}  # of the workers that can take part
        self._unfit: dict[str, str] = {}
        self._hung = False  # somebody has become quiet, and what runs may wait for it
        self._looked = -np.inf
        self._alone_since: float | None = None
        self._told_alone = False
        self._asked: set[str] = set()
        self._answers: SimpleQueue[tuple[str, Future[Any]]] = SimpleQueue()
        self.most_in_flight = 0

    def prepare(self, shapes: Sequence[KernelSpec], advance: Callable[[int], None] | None = None) -> int:
        """Make kernels ready on every machine that is there; returns how many had to be compiled."""
        from distributed.comm import get_address_host

        self._check_scheduler()
        while not self._look():
            time.sleep(LOOK_SECONDS / 10)
        patience = time.monotonic() + ANSWER_SECONDS
        while self._asked and time.monotonic() < patience:
            time.sleep(LOOK_SECONDS / 10)
            self._look()
        hosts: dict[str, list[str]] = {}
        for address in self._threads:
            hosts.setdefault(get_address_host(address), []).append(address)
        done: SimpleQueue[tuple[str, Future[Any]]] = SimpleQueue()
        under_way: dict[str, tuple[Any, list[str], KernelSpec]] = {}

        def begin(there: list[str], shape: KernelSpec) -> None:
            future = self.client.submit(_ready, shape, workers=there, pure=False)
            under_way[future.key] = future, there, shape
            self._fetch(future, done)

        for there in hosts.values():
            for shape in shapes:
                begin(there, shape)
        total, told, compiled = len(under_way), 0, 0
        while under_way:
            with suppress(Empty):
                key, found = done.get(timeout=LOOK_SECONDS)
                under_way.pop(key, None)
                with suppress(Exception):  # the first chunk that needs it says what is wrong
                    compiled += found.result()
            if time.monotonic() - self._looked > LOOK_SECONDS:
                self._look()
                hung = self._has_hung()
                for key, (future, there, shape) in list(under_way.items()):
                    left = [address for address in there if address in self._threads]
                    if hung or not left:  # where nobody is left, nobody needs it
                        del under_way[key]
                        future.release()
                        if left:
                            begin(left, shape)
            ready = (total - len(under_way)) * len(shapes) // total
            if advance and ready > told:
                advance(ready - told)
                told = ready
        return compiled

    def run(self, n: int, job: Callable[[int], Job], take: Take) -> None:
        """Run `n` chunks; see `Dispatcher.run`."""
        done: SimpleQueue[tuple[str, Future[Any]]] = SimpleQueue()
        flying: dict[str, tuple[Any, _Flight]] = {}
        fresh, again, suspects = map(_Flight, range(n)), deque[_Flight](), deque[_Flight]()
        busy: Counter[str] = Counter()  # chunks by worker
        left = n

        def begin(flight: _Flight, worker: str) -> None:
            future = self._submit(job(flight.position), worker)
            flying[future.key] = future, replace(flight, worker=worker)
            busy[worker] += 1
            self._fetch(future, done)
            self.most_in_flight = max(self.most_in_flight, len(flying))

        def end(key: str) -> tuple[Any, _Flight]:
            future, flight = flying.pop(key)
            busy[flight.worker] -= 1
            return future, flight

        def land(flight: _Flight, found: np.ndarray | str) -> None:
            nonlocal left
            left -= 1
            take(flight.position, found)

        def repeat(flight: _Flight) -> None:
            (suspects if flight.suspect else again).append(flight)

        def lose(flight: _Flight, why: object) -> None:
            lost = replace(flight, losses=flight.losses + 1)
            if lost.losses < TOGETHER + ALONE:
                repeat(lost)
            else:
                land(lost, f"lost {ALONE} times while nothing else ran on its worker: {why}")

        free: Iterable[str] = list(self._threads)  # workers that may have room
        while left:
            if time.monotonic() - self._looked > LOOK_SECONDS:
                self._look()
                free = list(self._threads)
                for key in self._stranded(flying):
                    future, flight = end(key)
                    future.release()
                    if flight.worker in self._threads:
                        repeat(flight)
                    else:
                        lose(flight, "it died, or no longer answers")
            room = {it: IN_FLIGHT * self._threads[it] - busy[it] for it in free if it in self._threads}
            for worker in _by_turns(room):
                following = again.popleft() if again else next(fresh, None)
                if following is None:
                    break
                begin(following, worker)
            if suspects and all(flight.suspect for _, flight in flying.values()):
                for worker in [worker for worker in self._threads if not busy[worker]][: len(suspects)]:
                    begin(suspects.popleft(), worker)
            free = ()
            try:
                key, found = done.get(timeout=LOOK_SECONDS)
            except Empty:
                continue
            if key not in flying:  # it was stranded
                continue
            future, flight = end(key)
            free = (flight.worker,)
            try:
                table = found.result()
            except _UnfitError as error:
                self._threads.pop(error.args[0], None)  # it is asked again
                repeat(flight)
                continue
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

    def _submit(self, mine: Job, worker: str) -> Any:
        client, variants = self.client, mine.variants
        return client.submit(
            _run_there,
            fingerprint(),
            self._run,
            self._lend("kernel", mine.kernel, mine.kernel),
            self._lend("record", mine.record, self._records[mine.record]),
            mine.table,
            (variants.period_factor, variants.mass_factor, variants.damping_ratio),
            mine.outputs,
            key=f"chunk-{mine.key}-{client.id}-{next(self._numbers)}",
            pure=False,
            workers=[worker],
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
        if self._has_hung() or any(workers.isdisjoint(self._threads) for _, workers in self._lent.values()):
            self._lent.clear()
            return list(flying)
        return [key for key, (_, flight) in flying.items() if flight.worker not in self._threads]

    def _has_hung(self) -> bool:
        """Whether somebody became quiet since this was last asked: whatever runs may wait for what it has."""
        hung, self._hung = self._hung, False
        return hung

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
            heard = self.client.run_on_scheduler(_heard)
        except Exception as error:  # whatever it is: the scheduler does not answer
            raise self._gone(error) from None
        there = {
            address: threads
            for address, (threads, status, silent) in heard.items()
            if status == "running" and silent < QUIET_SECONDS
        }
        left = [address for address in self._threads if address not in there]
        for address in left:
            del self._threads[address]
        for address in left:
            _, status, silent = heard.get(address, (0, "has left", 0.0))
            if silent >= QUIET_SECONDS:
                self._hung, status = True, f"says nothing for {QUIET_SECONDS:.0f} s"
            self._note(f"worker {address}: {status}; {len(self._threads)} are there, what it ran is run again")
        for address in self._unfit.keys() - there.keys():
            del self._unfit[address]
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
            self._note(f"worker {address}: takes part, with {threads} threads; {len(self._threads)} do")
        elif not isinstance(answer, OSError):  # that one died just now
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


class Dispatcher:
    """Workers of dask: threads of this process, processes, or those of a cluster."""

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

    def prepare(self, shapes: Sequence[KernelSpec], advance: Callable[[int], None] | None = None) -> int:
        """Make kernels ready where they will run; returns how many had to be compiled."""
        if not shapes:
            return 0
        if self._is_far:
            return self.far.prepare(shapes, advance)
        from pounding_sweep.engine.compile import prepare

        return prepare(shapes, self.workers, advance)

    def run(self, n: int, job: Callable[[int], Job], take: Take) -> None:
        """Run `n` chunks, begun in the order given, and take their results in this thread as they come."""
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
    """Workers that run only what an earlier cube does not hold."""

    def __init__(self, workers: Dispatcher, earlier: EarlierCube) -> None:
        self._workers, self._earlier = workers, earlier

    def prepare(self, shapes: Sequence[KernelSpec], advance: Callable[[int], None] | None = None) -> int:
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
