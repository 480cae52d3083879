"""Kernels compiled once and kept on disk, several at once, each process its share.

A kernel is a file of object code, named by a digest of all that decides it: what it is compiled for, the sources that
trace it, numba, llvmlite and the processor. numba compiles, under one lock per process, so missing kernels are shared
out to child processes; what is on disk is loaded without it, since it takes long to load itself.
"""

from __future__ import annotations

import ctypes
import gc
import hashlib
import json
import os
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import lru_cache, partial
from importlib.metadata import version
from pathlib import Path
from threading import RLock
from typing import Any

import numpy as np

from pounding_sweep.base.files import expanded
from pounding_sweep.engine.flight import aligned
from pounding_sweep.engine.kernel import ENTRY, compile_library, run_twin, state_size
from pounding_sweep.kernel.spec import FRAME, FUSED_DOF, KernelSpec, from_json, to_json

#: Environment variable that names another folder for compiled kernels.
CACHE_VARIABLE = "POUNDING_SWEEP_CACHE"
#: Environment variable of numba's by which kernels run as Python on arrays.
TWIN_VARIABLE = "NUMBA_DISABLE_JIT"
_LOCK = RLock()
#: What this process has: the engines that run what is compiled by itself, kernels and flights.
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
#: CPU seconds that a kernel takes to compile, by what adds to them, where a plain function of ``benchmarks.compiling``
#: takes 1.42 s. Fitted to what ``python -m benchmarks.compiling 3,3,3`` prints, which is 0.5 to 1.4 times as long.
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
BEGINNING = 0.6


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
    processor += " ".join(os.environ.get(name, "") for name in ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"))
    return f"{digest.hexdigest()} {version('numba')} {version('llvmlite')} {processor}"


def source_digest(piece: KernelSpec) -> str:
    """Name of what is compiled by itself, by a digest of all that decides its code."""
    text = _surroundings() + json.dumps(to_json(piece), sort_keys=True)
    return "pounding_kernel_" + hashlib.sha256(text.encode()).hexdigest()[:24]


def _path(piece: KernelSpec) -> Path:
    return cache_folder() / f"{source_digest(piece)}.o"


def is_cached(pieces: Iterable[KernelSpec]) -> bool:
    """Whether this process or the disk has all of these, each of which is compiled by itself."""
    return all(piece in _COMPILED or _path(piece).exists() for piece in pieces)


def _object_code(piece: KernelSpec) -> bytes:
    """Return the object code of a piece, kept with its digest at the end: compiled where it is not there yet."""
    path, often = _path(piece), gc.get_threshold()
    with suppress(OSError):
        kept = path.read_bytes()
        code, digest = kept[:-32], kept[-32:]
        if hashlib.sha256(code).digest() == digest:
            return code
        text = f"damaged kernels in {str(path.parent)!r} are compiled anew; if that comes again, check its disk"
        warnings.warn(text, RuntimeWarning, stacklevel=3)
    gc.set_threshold(50_000, 20, 100)  # compiling makes millions of objects, and most of them stay
    try:
        _, _, (code, _) = compile_library(piece).serialize_using_object_code()
    finally:
        gc.set_threshold(*often)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_suffix(f".{os.getpid()}")
        temporary.write_bytes(code + hashlib.sha256(code).digest())
        temporary.replace(path)
    except OSError as error:
        warnings.warn(
            f"compiled kernels can't be kept in {str(path.parent)!r} ({error.strerror or error}), so every process "
            f"compiles its own; mend that, or name another folder in {CACHE_VARIABLE}",
            RuntimeWarning,
            stacklevel=3,
        )
    return bytes(code)


def compile_piece(piece: KernelSpec) -> int:
    """Return the address of what is compiled by itself, a function of the address of a frame: a kernel, or a flight."""
    from llvmlite import binding

    with _LOCK:
        if piece not in _COMPILED:
            code = _object_code(piece)
            binding.initialize_native_target()
            binding.initialize_native_asmprinter()
            machine = binding.Target.from_default_triple().create_target_machine()
            engine = binding.create_mcjit_compiler(binding.parse_assembly(""), machine)
            engine.add_object_file(binding.ObjectFileRef.from_data(code))
            engine.finalize_object()
            _COMPILED[piece] = engine
        return int(_COMPILED[piece].get_function_address(ENTRY))


@lru_cache(maxsize=256)
def get_kernel(shape: KernelSpec) -> Callable[..., None]:
    """Return the kernel as a function of all of `PARAMETERS` but what it adds itself: the last three."""
    if os.environ.get(TWIN_VARIABLE, "0") != "0":
        return partial(run_twin, shape)
    flight = 0 if shape.flight is None else compile_piece(shape.flight)
    compiled, (size, passing) = ctypes.CFUNCTYPE(None, ctypes.c_int64)(compile_piece(shape)), state_size(shape)

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
