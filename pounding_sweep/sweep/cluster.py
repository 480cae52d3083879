"""Clients of dask clusters: one at an address, or processes of this machine."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def cluster_client(scheduler: str, workers: int) -> Iterator[Any]:
    """Give a client of the cluster at an address, or of processes that are started here and end with it."""
    from distributed import Client, LocalCluster

    if "://" in scheduler:
        with Client(scheduler, set_as_default=False) as client:
            yield client
        return
    with _deaf_to_interrupt():  # Ctrl-C is for this process; the workers it starts inherit what stands here
        cluster = LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
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
