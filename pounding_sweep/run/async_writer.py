"""Chunks written to disk beside the run, so that no worker waits for the disk."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np

from pounding_sweep.base.errors import OutputError
from pounding_sweep.output.results import Results
from pounding_sweep.resume.checkpoint import ChunkStore

#: Tables that may wait for the disk; the run waits where there are more.
WAITING = 8


class AsyncWriter:
    """Writes finished chunks to a store, one after another, in a thread of its own."""

    def __init__(self, store: ChunkStore, results: Results) -> None:
        self._store, self._results = store, results
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="chunks")
        self._waiting: deque[Future[None]] = deque()

    def __enter__(self) -> AsyncWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *raised: Any) -> None:
        self._thread.shutdown(wait=True)
        with suppress(*([OutputError] if kind is not None else [])):  # what ended the run is told, not what followed
            for future in self._waiting:
                future.result()

    def save(self, key: str, table: np.ndarray, index: int, **more: Any) -> None:
        """Have a chunk written, with `more` in its line; table `index` of the results is then read from its file."""
        self._waiting.append(self._thread.submit(self._write, key, table, index, more))
        while len(self._waiting) > WAITING or (self._waiting and self._waiting[0].done()):
            self._waiting.popleft().result()

    def _write(self, key: str, table: np.ndarray, index: int, more: dict[str, Any]) -> None:
        self._store.write(key, table, **more)
        self._results.move(index, partial(self._store.read, key))
