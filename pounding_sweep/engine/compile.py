"""Kernels compiled once and kept on disk, several at once, each process its share.

A kernel is a small module whose one function has the traced kernel for its body. Its name is a digest of all that
decides its machine code: what it is compiled for, the sources that trace it, the versions of numba and llvmlite, the
processor. numba compiles under one lock per process, so missing kernels are shared out to child processes.
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
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache, partial
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
#: Kernels that this process has, and what is compiled by itself, by the names of the modules.
_LOADED: set[KernelSpec] = set()
_COMPILED: dict[str, Any] = {}

#: What decides the code of a kernel beside what it is compiled for: folders and files of the package.
SOURCES = ("kernel", "schemes", "outputs", "engine/kernel.py", "model/formula.py", "model/laws.py", "model/rebound.py")
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


def cache_folder() -> Path:
    """Folder of compiled kernels (``POUNDING_SWEEP_CACHE``, else below the user's cache folder)."""
    if named := os.environ.get(CACHE_VARIABLE):
        return expanded(named)
    return expanded(os.environ.get("XDG_CACHE_HOME") or "~/.cache") / "pounding_sweep" / "kernels"


@lru_cache(maxsize=1)
def _surroundings() -> str:
    """Digest of the sources that trace kernels, and what compiles them for which processor."""
    import llvmlite
    import numba
    from llvmlite import binding

    package, digest = Path(__file__).parent.parent, hashlib.sha256()
    for name in SOURCES:
        path = package / name
        for file in sorted(path.glob("*.py")) if path.is_dir() else [path]:
            digest.update(f"{file.name} {hashlib.sha256(file.read_bytes()).hexdigest()}\n".encode())
    processor = f"{binding.get_host_cpu_name()} {binding.get_host_cpu_features().flatten()}"
    return f"{digest.hexdigest()} {numba.__version__} {llvmlite.__version__} {processor}"


def module_text(shape: KernelSpec) -> str:
    """Text of a kernel's module, or of its flight's."""
    return MODULE.format(spec=json.dumps(to_json(shape), sort_keys=True))


def source_digest(shape: KernelSpec) -> str:
    """Name of a kernel's module, by a digest of all that decides its code."""
    return "pounding_kernel_" + hashlib.sha256((_surroundings() + module_text(shape)).encode()).hexdigest()[:24]


def is_loaded(shape: KernelSpec) -> bool:
    """Whether this process has the kernel already."""
    return shape in _LOADED


def is_cached(shape: KernelSpec) -> bool:
    """Whether a compiled form of this kernel, and of its flight, is on disk (for some CPU)."""
    return all(map(is_piece_cached, shape.pieces))


def is_piece_cached(piece: KernelSpec) -> bool:
    """Whether what is compiled by itself is on disk."""
    return {path.suffix for path in _compiled_files(cache_folder(), source_digest(piece))} >= {".nbi", ".nbc"}


def _compiled_files(folder: Path, name: str) -> list[Path]:
    """Return the files that numba keeps of a module."""
    return list((folder / "__pycache__").glob(f"{name}.*"))


def _load(folder: Path, name: str, text: str) -> Any:
    """Return the function of a kernel's module, which is written where it is not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.py"
    if not path.exists() or path.read_bytes() != text.encode():
        temporary = folder / f"{name}.{os.getpid()}"
        temporary.write_text(text, encoding="utf-8")
        # one fixed time stamp: numba's index is keyed by it, and equal text is the same kernel for every process
        os.utime(temporary, (1_000_000_000, 1_000_000_000))
        temporary.replace(path)
    return runpy.run_path(str(path), run_name=name)["run"]


def _load_or_compile(folder: Path, name: str, text: str) -> Any:
    """Return it compiled anew if its files are cut or damaged so that numba can't read them."""
    try:
        return _load(folder, name, text)
    except (OSError, MemoryError):
        raise
    except Exception:  # whatever numba makes of such a file
        files = _compiled_files(folder, name)
        if not files:
            raise
        for path in files:
            path.unlink(missing_ok=True)
        _warn_once(f"damaged kernels in {str(folder)!r} are compiled anew; if that comes again, check its disk")
        return _load(folder, name, text)


@lru_cache(maxsize=1)
def _own_folder() -> Path:
    """Return a folder of this process alone, removed at its end."""
    folder = tempfile.TemporaryDirectory(prefix="pounding_sweep_")
    atexit.register(folder.cleanup)
    return Path(folder.name)


@lru_cache(maxsize=64)
def _warn_once(text: str) -> None:
    warnings.warn(text, RuntimeWarning, stacklevel=2)


@contextmanager
def _seldom_collected() -> Iterator[None]:
    """Have Python look for garbage less often: compiling makes millions of objects, and most of them stay."""
    before = gc.get_threshold()
    gc.set_threshold(50_000, 20, 100)
    try:
        yield
    finally:
        gc.set_threshold(*before)


def compile_piece(piece: KernelSpec) -> Any:
    """Return what is compiled by itself, numba's function of the address of a frame: a kernel, or a flight."""
    with _LOCK, _seldom_collected():
        name, text = source_digest(piece), module_text(piece)
        if name not in _COMPILED:
            folder = cache_folder()
            try:
                _COMPILED[name] = _load_or_compile(folder, name, text)
            except OSError as error:
                _warn_once(
                    f"compiled kernels can't be kept in {str(folder)!r} ({error.strerror or error}), so every process "
                    f"compiles its own; mend that, or name another folder in {CACHE_VARIABLE}"
                )
                _COMPILED[name] = _load(_own_folder(), name, text)
        return _COMPILED[name]


@lru_cache(maxsize=256)
def get_kernel(shape: KernelSpec) -> Callable[..., None]:
    """Return the kernel as a function of all of `PARAMETERS` but what it adds itself: the last three."""
    # it is compiled, or loaded from the disk cache where it is there; where numba's JIT is disabled, it is the twin
    from numba import config

    found = twin_of(shape) if getattr(config, "DISABLE_JIT", False) else _compiled_kernel(shape)
    _LOADED.add(shape)
    return found


def twin_of(shape: KernelSpec) -> Callable[..., None]:
    """Return what does the same as the kernel, slowly, in plain Python."""
    from pounding_sweep.engine.kernel import run_twin

    return partial(run_twin, shape)


def _compiled_kernel(shape: KernelSpec) -> Callable[..., None]:
    from pounding_sweep.engine.kernel import state_size

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
