"""Loaded by dask in the workers that are started here: Ctrl-C and SIGHUP are for the client, though all get them."""

from __future__ import annotations

import signal


def dask_setup(worker: object) -> None:
    """Ignore both; dask calls this in the worker's main thread."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
