"""Compiling several kernels at once, each process its share.

numba compiles under one lock per process, so kernels that are not on disk yet
are shared out to child processes, which leave them in the disk cache.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Sequence

from pounding_sweep.engine.cache import compile_piece, get_kernel, is_cached, is_loaded, is_piece_cached
from pounding_sweep.kernel.spec import FUSED_DOF, KernelSpec, from_json, to_json

#: CPU seconds that a kernel takes to compile, by what adds to them, where a plain function of ``benchmarks.compiling``
#: takes 1.42 s. Fitted to what ``python -m benchmarks.compiling 3,3,3`` prints, which is 0.9 to 1.4 times as long.
COMPILING = {
    "any": 0.19,
    "contacts": 0.063,
    "implicit contacts": 0.14,
    "floor in contacts": 0.015,
    "floor and reducer": 0.0056,
    "yielding": 0.085,
    "storey that yields": 0.017,
    "floor and reducer by series": 0.0065,
    "flight": 0.65,
    "floor and reducer in flight": 0.0038,
    "storey that yields in flight": 0.039,
}
#: Floors from which on kernels do not grow with a row: it runs through loops.
MOST_FLOORS = FUSED_DOF + 2
#: CPU seconds that it costs to begin a process that compiles.
BEGINNING = 1.3


def compiling_parts(shape: KernelSpec) -> dict[str, int]:
    """Count what adds to the time that one piece takes to compile, by the names of `COMPILING`."""
    floors, touching = min(shape.n_dof, MOST_FLOORS), shape.law is not None
    if shape.only_flight:
        return {
            "flight": 1,
            "floor and reducer in flight": floors * len(shape.reducers),
            "storey that yields in flight": min(len(shape.yielding), MOST_FLOORS),
        }
    return {
        "any": 1,
        "contacts": len(shape.laws),
        "implicit contacts": len(shape.laws) * shape.implicit,
        "floor in contacts": floors * touching,
        "floor and reducer": floors * len(shape.reducers),
        "yielding": int(bool(shape.yielding)),
        "storey that yields": min(len(shape.yielding), MOST_FLOORS),
        "floor and reducer by series": floors * len(shape.reducers) * bool(shape.series),
    }


def compiling_seconds(shape: KernelSpec) -> float:
    """Estimate the CPU seconds that a kernel takes to compile, with its flight."""
    return sum(map(_piece_seconds, shape.pieces))


def _piece_seconds(piece: KernelSpec) -> float:
    return sum(COMPILING[name] * n for name, n in compiling_parts(piece).items())


def _missing(shapes: Sequence[KernelSpec]) -> list[KernelSpec]:
    return [shape for shape in shapes if not (is_loaded(shape) or is_cached(shape))]


def still_to_compile(shapes: Sequence[KernelSpec]) -> tuple[int, float]:
    """Count the kernels that are not at hand yet, and estimate the CPU seconds that they take."""
    missing = _missing(list(dict.fromkeys(shapes)))
    return len(missing), sum(map(_piece_seconds, _missing_pieces(missing)))


def _missing_pieces(missing: Sequence[KernelSpec]) -> list[KernelSpec]:
    """Return what must be compiled for kernels that are not at hand; laws share their flight."""
    return [
        piece for piece in dict.fromkeys(p for shape in missing for p in shape.pieces) if not is_piece_cached(piece)
    ]


def shares(pieces: Sequence[KernelSpec], n: int) -> list[list[KernelSpec]]:
    """Cut pieces into at most `n` shares that take about as long to compile, each worth a process of its own."""
    takes = {piece: _piece_seconds(piece) for piece in pieces}
    total = sum(takes.values())
    found: list[list[KernelSpec]] = [[] for _ in range(max(1, min(n, int(total / BEGINNING))))]
    done = 0.0
    for piece, seconds in takes.items():
        found[int((done + seconds / 2) * len(found) / total)].append(piece)
        done += seconds
    return [share for share in found if share]


def prepare(shapes: Sequence[KernelSpec], workers: int = 1, advance: Callable[[int], None] | None = None) -> int:
    """Make kernels ready to run in this process; returns how many had to be compiled."""
    wanted = list(dict.fromkeys(shapes))
    missing = _missing(wanted)
    mine, *others = shares(_missing_pieces(missing), workers) or [[]]
    theirs = {piece for share in others for piece in share}
    children = []
    for share in others:
        text = json.dumps([to_json(piece) for piece in share])
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
        for shape in sorted(wanted, key=lambda shape: not theirs.isdisjoint(shape.pieces)):
            if not theirs.isdisjoint(shape.pieces):
                for piece in mine:
                    compile_piece(piece)
                for child in children:
                    child.wait()
            get_kernel(shape)  # from the disk cache; compiled here should a child have failed
            if advance:
                advance(1)
    except BaseException:
        for child in children:
            child.kill()
        raise
    return len(missing)


if __name__ == "__main__":
    for item in json.load(sys.stdin):
        compile_piece(from_json(item))
