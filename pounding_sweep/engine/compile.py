"""Compiling several kernels at once, each process its share.

numba compiles under one lock per process, so kernels that are not on disk yet
are shared out to child processes, which leave them in the disk cache.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

from pounding_sweep.emit.spec import KernelSpec, LawShape
from pounding_sweep.engine.cache import get_kernel, is_cached, is_loaded, text_sizes


def to_json(shape: KernelSpec) -> dict[str, Any]:
    """Return the shape as plain data."""
    return {**asdict(shape), "reducers": sorted(shape.reducers)}


def from_json(data: dict[str, Any]) -> KernelSpec:
    """Return the shape of `to_json`."""
    own = {
        "storeys": tuple(data["storeys"]),
        "contacts": tuple((int(a), int(b), int(c)) for a, b, c in data["contacts"]),
        "law": None if data["law"] is None else LawShape(**data["law"]),
        "reducers": frozenset(data["reducers"]),
    }
    return KernelSpec(**{**data, **own})


def shares(shapes: Sequence[KernelSpec], n: int) -> list[list[KernelSpec]]:
    """Cut kernels into at most `n` shares that take about as long to compile; none is empty."""
    sizes = {shape: text_sizes(shape) for shape in shapes}
    rows: dict[str, dict[KernelSpec, int]] = {}
    for shape, (row, row_size, main_size) in sizes.items():
        here = rows.setdefault(row, {})
        here[shape] = main_size + (0 if here else row_size)
    total, done = sum(sum(here.values()) for here in rows.values()), 0.0
    found: list[list[KernelSpec]] = [[] for _ in range(max(1, n))]
    for shape, size in (item for here in rows.values() for item in here.items()):
        found[int((done + size / 2) * len(found) / total)].append(shape)
        done += size
    return [share for share in found if share]


def prepare(shapes: Sequence[KernelSpec], workers: int = 1, advance: Callable[[int], None] | None = None) -> int:
    """Make kernels ready to run in this process; returns how many had to be compiled."""
    wanted = list(dict.fromkeys(shapes))
    missing = [shape for shape in wanted if not (is_loaded(shape) or is_cached(shape))]
    mine, *others = shares(missing, workers) or [[]]
    children = []
    for theirs in others:
        text = json.dumps([to_json(shape) for shape in theirs])
        child = subprocess.Popen(
            [sys.executable, "-m", "pounding_sweep.engine.compile"],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert child.stdin is not None
        child.stdin.write(text)
        child.stdin.close()
        children.append(child)
    try:
        for shape in [*mine, *(s for s in wanted if s not in missing)]:
            get_kernel(shape)
            if advance:
                advance(1)
        for child in children:
            child.wait()
    except BaseException:
        for child in children:
            child.kill()
        raise
    for shape in (shape for theirs in others for shape in theirs):
        get_kernel(shape)  # from the disk cache; compiled here should a child have failed
        if advance:
            advance(1)
    return len(missing)


if __name__ == "__main__":
    for item in json.load(sys.stdin):
        get_kernel(from_json(item))
