"""Chunks written to disk beside the run, so that no worker waits for the disk; none where a run is soon over."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np

from pounding_sweep.resume.checkpoint import ChunkStore

#: Seconds for which finished chunks are held in memory, and most bytes of them.
HELD_SECONDS, HELD_BYTES = 2.0, 2**24
#: Tables that may wait for the disk; the run waits where there are more.
WAITING = 8


class AsyncWriter:
    """Writes finished chunks to a store, one after another, in a thread of its own.

    It begins when the run has lasted `HELD_SECONDS` or holds `HELD_BYTES`, and `at_once` in a folder where chunks are.
    A run that fails or is interrupted writes all that it has; one that ends well, no more than it was about to.
    """

    def __init__(self, store: ChunkStore, *, at_once: bool = False) -> None:
        self.store = store
        self._bytes, self._due, self._dropped = 0, time.monotonic() + HELD_SECONDS, False
        self._begin = threading.Event()
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="chunks")
        self._ready = self._thread.submit(self._open)
        self._waiting: deque[Future[None]] = deque()
        if at_once:
            self._begin.set()
            self._ready.result()

    def __enter__(self) -> AsyncWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *raised: Any) -> None:
        self._dropped = kind is None
        self._begin.set()
        self._thread.shutdown(wait=True, cancel_futures=self._dropped)  # what ended the run is told, not what followed

    def expect(self, chunks: Mapping[str, Any]) -> None:
        """Have noted of which chunks the sweep will consist."""
        self._submit(partial(self.store.expect, chunks))

    def save(self, key: str, table: np.ndarray, moved: Callable[[Callable[[], np.ndarray]], None], **more: Any) -> None:
        """Have a chunk written, with `more` in its line; `moved` then hears how it is read from its file."""

        def write() -> None:
            self.store.write(key, table, **more)
            moved(partial(self.store.read, key))

        self._bytes += table.nbytes
        if self._bytes > HELD_BYTES:
            self._begin.set()
        self._submit(write)
        while self._waiting and (self._waiting[0].done() or (self._has_begun and len(self._waiting) > WAITING)):
            self._waiting.popleft().result()

    def settle(self, *, begin: bool) -> None:
        """Wait until all is written, if that has begun, or is to."""
        if begin or self._has_begun:
            self._begin.set()
            while self._waiting:
                self._waiting.popleft().result()

    @property
    def _has_begun(self) -> bool:
        return self._begin.is_set() or time.monotonic() >= self._due

    def _open(self) -> bool:
        self._begin.wait(max(0.0, self._due - time.monotonic()))
        if not self._dropped:
            self.store.folder.stat()  # it is there since it was locked; one that was removed is not made again
            self.store.open()
        return not self._dropped

    def _submit(self, write: Callable[[], None]) -> None:
        def once_open() -> None:
            if self._ready.result():
                write()

        self._waiting.append(self._thread.submit(once_open))
