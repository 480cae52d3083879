"""Finished chunks on their way to the store: held in memory at first, so that short runs write nothing."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from pounding_sweep.plan.plan import Plan
from pounding_sweep.plan.scenarios import Chunk
from pounding_sweep.resume.checkpoint import ChunkStore
from pounding_sweep.resume.survey import expect

#: Seconds for which finished chunks are held in memory, and most bytes of them.
HELD_SECONDS, HELD_BYTES = 2.0, 2**24


class ChunkWriter:
    """Writes finished chunks to a store, once a run has lasted `HELD_SECONDS` or holds `HELD_BYTES`, or `at_once`.

    A run that fails or is interrupted writes all that it has; one that ends well before, nothing.
    """

    def __init__(self, store: ChunkStore, *, at_once: bool = False) -> None:
        self.store = store
        self._bytes, self._due, self._is_open = 0, time.monotonic() + HELD_SECONDS, False
        self._waiting: list[Callable[[], None]] = []
        if at_once:
            self.flush()

    def __enter__(self) -> ChunkWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, *_: Any) -> None:
        if error is not None:
            try:
                self.flush()
            except Exception as failure:  # what ended the run is told, not what followed
                error.add_note(str(failure))

    def expect(self, plan: Plan, stage: str, chunks: Sequence[Chunk]) -> None:
        """Note of which chunks a stage will consist."""
        self._write(partial(expect, self.store, plan, stage, chunks))

    def save(
        self, chunk: Chunk, table: np.ndarray, moved: Callable[[Callable[[], np.ndarray]], None], **more: Any
    ) -> None:
        """Write a chunk, with `more` in its line; `moved` then hears how it is read from its file."""

        def write() -> None:
            self.store.write(chunk.key, table, chunk.rows, law=chunk.law, record=chunk.record, **more)
            moved(partial(self.store.read, chunk.key))

        self._bytes += table.nbytes
        self._write(write)

    def flush(self) -> None:
        """Write all that is held."""
        if not self._is_open:
            self.store.folder.stat()  # it is there since it was locked; one that was removed is not made again
            self.store.open()
            self._is_open = True
        while self._waiting:
            self._waiting.pop(0)()

    def _write(self, write: Callable[[], None]) -> None:
        self._waiting.append(write)
        if self._is_open or self._bytes > HELD_BYTES or time.monotonic() >= self._due:
            self.flush()
