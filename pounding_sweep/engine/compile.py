"""Kernels compiled once and kept on disk, several at once, each process its share.

A kernel is a module of one function, named by a digest of all that decides its machine code: what it is compiled for,
the sources that trace it, numba, llvmlite and the processor. numba compiles under one lock per process, so missing
kernels are shared out to child processes.
"""

from __future__ import annotations

import atexit
import gc
import hashlib
import json
import os
import runpy
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterable, Sequence
from functools import cache, lru_cache, partial
from importlib.metadata import version
from pathlib import Path
from threading import RLock
from typing import Any

import numpy as np

from pounding_sweep.base.files import expanded
from pounding_sweep.engine.flight import aligned
from pounding_sweep.kernel.spec import FRAME, FUSED_DOF, KernelSpec, from_json, to_json

#: Environment variable that names another folder for compiled kernels.
CACHE_VARIABLE = "POUNDING_SWEEP_CACHE"
_LOCK = RLock()
#: What this process has: numba's functions of what is compiled by itself, kernels and flights.
_COMPILED: dict[KernelSpec, Any] = {}

#: What decides the code of a kernel beside what it is compiled for: folders and files of the package.
SOURCES = (
    "lanes.py",
    "kernel",
    "schemes",
    "variables",
    "engine/kernel.py",
    "model/storeys",
    "model/formula.py",
    "model/laws.py",
    "model/rebound.py",
)
#: A kernel's module: one signature, compiled when loaded. What traces the body is loaded only then.
MODULE = '''"""A pounding_sweep kernel, written by the package. Editing it has no effect on the package."""

import json

from numba import cfunc, types
from numba.extending import intrinsic

SPEC = {spec!r}


@intrinsic
def body(typing, frame):
    def write(context, builder, signature, values):
        from pounding_sweep.engine.kernel import write_body
        from pounding_sweep.kernel.spec import from_json

        return write_body(from_json(json.loads(SPEC)), context, builder, values[0])

    return types.void(frame), write


@cfunc("void(int64)", cache=True, error_model="numpy", boundscheck=False, fastmath=False)
def run(frame):
    body(frame)
'''
#: CPU seconds that a kernel takes to compile, by what adds to them, where a plain function of ``benchmarks.compiling``
#: takes 1.42 s. Fitted to what ``python -m benchmarks.compiling 3,3,3`` prints, which is 0.6 to 1.2 times as long.
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


def cache_folder() -> Path:
    """Folder of compiled kernels (``POUNDING_SWEEP_CACHE``, else below the user's cache folder)."""
    if named := os.environ.get(CACHE_VARIABLE):
        return expanded(named)
    return expanded(os.environ.get("XDG_CACHE_HOME") or "~/.cache") / "pounding_sweep" / "kernels"


@lru_cache(maxsize=1)
def _surroundings() -> str:
    """Digest of the sources that trace kernels, and what compiles them for which processor."""
    from llvmlite import binding

    package, digest = Path(__file__).parent.parent, hashlib.sha256()
    for name in SOURCES:
        path = package / name
        for file in sorted(path.glob("*.py")) if path.is_dir() else [path]:
            digest.update(f"{file.name} {hashlib.sha256(file.read_bytes()).hexdigest()}\n".encode())
    processor = f"{binding.get_host_cpu_name()} {binding.get_host_cpu_features().flatten()}"
    return f"{digest.hexdigest()} {version('numba')} {version('llvmlite')} {processor}"


def module_text(piece: KernelSpec) -> str:
    """Text of the module of a kernel, or of a flight."""
    return MODULE.format(spec=json.dumps(to_json(piece), sort_keys=True))


def source_digest(piece: KernelSpec) -> str:
    """Name of that module, by a digest of all that decides its code."""
    return "pounding_kernel_" + hashlib.sha256((_surroundings() + module_text(piece)).encode()).hexdigest()[:24]


def is_cached(pieces: Iterable[KernelSpec]) -> bool:
    """Whether this process or the disk has all of these, each of which is compiled by itself."""
    return all(
        piece in _COMPILED or {path.suffix for path in _files(cache_folder(), source_digest(piece))} >= {".nbi", ".nbc"}
        for piece in pieces
    )


def _files(folder: Path, name: str) -> list[Path]:
    """Return the files that numba keeps of a module."""
    return list((folder / "__pycache__").glob(f"{name}.*"))


def _load(folder: Path, piece: KernelSpec) -> Any:
    """Return the function of a module, which is written where it is not there yet; numba compiles or loads it."""
    name, text = source_digest(piece), module_text(piece)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.py"
    if not path.exists() or path.read_bytes() != text.encode():
        temporary = folder / f"{name}.{os.getpid()}"
        temporary.write_text(text, encoding="utf-8")
        # one fixed time stamp: numba's index is keyed by it, and equal text is the same kernel for every process
        os.utime(temporary, (1_000_000_000, 1_000_000_000))
        temporary.replace(path)
    try:
        return runpy.run_path(str(path), run_name=name)["run"]
    except (OSError, MemoryError):
        raise
    except Exception:  # whatever numba makes of cut or damaged files
        if not (files := _files(folder, name)):
            raise
        for file in files:
            file.unlink(missing_ok=True)
        text = f"damaged kernels in {str(folder)!r} are compiled anew; if that comes again, check its disk"
        warnings.warn(text, RuntimeWarning, stacklevel=2)
        return runpy.run_path(str(path), run_name=name)["run"]


@cache
def _private_folder() -> Path:
    """Return a folder of this process alone, removed at its end."""
    folder = tempfile.TemporaryDirectory(prefix="pounding_sweep_")
    atexit.register(folder.cleanup)
    return Path(folder.name)


def compile_piece(piece: KernelSpec) -> Any:
    """Return what is compiled by itself, numba's function of the address of a frame: a kernel, or a flight."""
    import numba

    config: Any = numba.config
    with _LOCK:
        if piece not in _COMPILED:
            folder, often, elsewhere = cache_folder(), gc.get_threshold(), config.CACHE_DIR
            gc.set_threshold(50_000, 20, 100)  # compiling makes millions of objects, and most of them stay
            config.CACHE_DIR = ""  # kernels stay in their own folder, whatever NUMBA_CACHE_DIR says
            try:
                _COMPILED[piece] = _load(folder, piece)
            except OSError as error:
                warnings.warn(
                    f"compiled kernels can't be kept in {str(folder)!r} ({error.strerror or error}), so every process "
                    f"compiles its own; mend that, or name another folder in {CACHE_VARIABLE}",
                    RuntimeWarning,
                    stacklevel=2,
                )
                _COMPILED[piece] = _load(_private_folder(), piece)
            finally:
                gc.set_threshold(*often)
                config.CACHE_DIR = elsewhere
        return _COMPILED[piece]


@lru_cache(maxsize=256)
def get_kernel(shape: KernelSpec) -> Callable[..., None]:
    """Return the kernel as a function of all of `PARAMETERS` but what it adds itself: the last three."""
    from numba import config

    from pounding_sweep.engine.kernel import run_twin, state_size

    if getattr(config, "DISABLE_JIT", False):
        return partial(run_twin, shape)
    flight = 0 if shape.flight is None else compile_piece(shape.flight).address
    compiled, (size, passing) = compile_piece(shape).ctypes, state_size(shape)

    def run(*arguments: Any) -> None:
        state, frame = aligned(size, shape.precision), aligned(FRAME, "int64")
        state[:] = 0.0
        numbers: list[Any] = []
        for x in (*arguments, state, passing, flight):
            if isinstance(x, np.ndarray):
                numbers += [x.ctypes.data, *x.shape]
            else:
                numbers.append(np.float64(x).view(np.int64) if isinstance(x, float) else x)
        frame[: len(numbers)] = numbers
        compiled(frame.ctypes.data)

    return run


def compiling_parts(piece: KernelSpec) -> dict[str, int]:
    """Count what adds to the time that one piece takes to compile, by the names of `COMPILING`."""
    floors, yielding, laws = min(piece.n_dof, MOST_FLOORS), min(len(piece.yielding), MOST_FLOORS), len(piece.laws)
    by_floor = floors * len(piece.reducers)
    if piece.only_flight:
        return {"flight": 1, "floor and reducer in flight": by_floor, "storey that yields in flight": yielding}
    return {
        "any": 1,
        "contacts": laws,
        "implicit contacts": laws * piece.implicit,
        "floor in contacts": floors * (piece.law is not None),
        "floor and reducer": by_floor,
        "yielding": int(yielding > 0),
        "storey that yields": yielding,
        "floor and reducer by series": by_floor * bool(piece.series),
    }


def compiling_seconds(pieces: Iterable[KernelSpec]) -> float:
    """Estimate the CPU seconds that pieces take to compile: a kernel's are itself and its flight."""
    return sum(COMPILING[name] * n for piece in pieces for name, n in compiling_parts(piece).items())


def missing_kernels(shapes: Iterable[KernelSpec]) -> tuple[list[KernelSpec], list[KernelSpec]]:
    """Return the kernels that are not at hand, and what of them must be compiled; laws share their flight."""
    missing = [shape for shape in dict.fromkeys(shapes) if not is_cached(shape.pieces)]
    pieces = dict.fromkeys(piece for shape in missing for piece in shape.pieces)
    return missing, [piece for piece in pieces if not is_cached([piece])]


def still_to_compile(shapes: Iterable[KernelSpec]) -> tuple[int, float]:
    """Count the kernels that are not at hand yet, and estimate the CPU seconds that they take."""
    missing, pieces = missing_kernels(shapes)
    return len(missing), compiling_seconds(pieces)


def shares(pieces: Sequence[KernelSpec], n: int) -> list[list[KernelSpec]]:
    """Cut pieces into at most `n` shares that take about as long to compile, each worth a process of its own."""
    n = max(1, min(n, len(pieces), int(compiling_seconds(pieces) / BEGINNING)))
    longest_first = sorted(pieces, key=lambda piece: -compiling_seconds([piece]))
    return [longest_first[i::n] for i in range(n)]


def prepare(shapes: Sequence[KernelSpec], workers: int = 1, advance: Callable[[int], None] | None = None) -> int:
    """Make kernels ready to run in this process; returns how many had to be compiled."""
    missing, pieces = missing_kernels(shapes)
    first, *others = shares(pieces, workers)
    elsewhere = {piece for part in others for piece in part}
    children = []
    for part in others:
        child = subprocess.Popen(
            [sys.executable, "-m", "pounding_sweep.engine.compile"],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert child.stdin is not None
        child.stdin.write(json.dumps([to_json(piece) for piece in part]))
        child.stdin.close()
        children.append(child)
    try:
        for shape in sorted(dict.fromkeys(shapes), key=lambda shape: not elsewhere.isdisjoint(shape.pieces)):
            if not elsewhere.isdisjoint(shape.pieces):
                for piece in first:
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
