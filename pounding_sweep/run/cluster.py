"""Clients of dask clusters: one at an address, or processes of this machine."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from pounding_sweep.base.errors import ClusterError
from pounding_sweep.run import ignore_signals

#: One scenario runs in one thread, and a worker has as many as its cluster gave it: no library starts more.
ONE_THREAD = {name: "1" for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}

#: What ends a run in order.
_INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def cluster_client(scheduler: str, workers: int) -> Iterator[Any]:
    """Give a client of the cluster at an address, or of processes that are started here and end with it."""
    import dask
    from distributed import Client, LocalCluster

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
                preload=[*dask.config.get("distributed.worker.preload"), ignore_signals.__name__],
            )
            opened.enter_context(cluster)
            client = opened.enter_context(Client(cluster, set_as_default=False))
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
