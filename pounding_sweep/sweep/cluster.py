"""Clients of dask clusters: one at an address, or processes of this machine."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from pounding_sweep.errors import ClusterError

#: One scenario runs in one thread, and a worker has as many as its cluster gave it: no library starts more.
ONE_THREAD = {name: "1" for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}


@contextmanager
def cluster_client(scheduler: str, workers: int) -> Iterator[Any]:
    """Give a client of the cluster at an address, or of processes that are started here and end with it.

    Raises
    ------
    ClusterError
        No dask scheduler answers at the address.
    """
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
    with _deaf_to_interrupt():  # Ctrl-C is for this process; the workers it starts inherit what stands here
        cluster = LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},  # else dask opens port 8787 all the same
            silence_logs=50,
            env=ONE_THREAD,
        )
    with cluster, Client(cluster, set_as_default=False) as client:
        yield client


@contextmanager
def _deaf_to_interrupt() -> Iterator[None]:
    """Ignore SIGINT for a moment; only a main thread can."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
