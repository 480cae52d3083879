"""Loaded by dask in the workers that are started here: Ctrl-C is for the client, though a terminal sends it to all."""

from __future__ import annotations

import signal


def dask_setup(worker: object) -> None:
    """Ignore SIGINT; dask calls this in the worker's main thread."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
