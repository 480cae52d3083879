"""Kernels compiled once and kept on disk.

A kernel is a small module whose one function has the traced kernel for its body. Its
name is a digest of all that decides its machine code: what it is compiled for, the
sources that trace it, the versions of numba and llvmlite, the processor. So an edited
law, scheme or reducer is another file, compiled afresh.
"""

from __future__ import annotations

import atexit
import gc
import hashlib
import importlib.util
import json
import os
import shutil
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache, partial
from pathlib import Path
from threading import RLock
from types import ModuleType
from typing import Any

import numpy as np

from pounding_sweep.base.errors import InputError
from pounding_sweep.base.files import expanded
from pounding_sweep.engine.flight import aligned
from pounding_sweep.kernel import READ
from pounding_sweep.kernel.spec import FRAME, KernelSpec, to_json

#: Environment variable that names another folder for compiled kernels.
CACHE_VARIABLE = "POUNDING_SWEEP_CACHE"
_LOCK = RLock()
_LOADED: set[KernelSpec] = set()

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
#: Kernels not used for this long (s) are removed when a new one is written.
KEEP_SECONDS = 90 * 24 * 3600.0


def cache_folder() -> Path:
    """Folder of compiled kernels (``POUNDING_SWEEP_CACHE``, else below the user's cache folder)."""
    return lasting_folder() or _own_folder()


def lasting_folder() -> Path | None:
    """Folder of compiled kernels that outlasts the process; None where no home folder is known."""
    named = os.environ.get(CACHE_VARIABLE)
    if named:
        return expanded(named)
    base = os.environ.get("XDG_CACHE_HOME", "")
    if not os.path.isabs(base):  # the standard of that variable has others ignored
        try:
            base = str(expanded("~") / ".cache")
        except InputError:
            return None
    return Path(base) / "pounding_sweep" / "kernels"


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
            if file.stat().st_mtime > READ:  # this process may have read another text
                digest.update(os.urandom(16))
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


def _write(folder: Path, name: str, text: str) -> Path:
    """Write a kernel's module where it is not there yet, and mark it as used."""
    folder.mkdir(parents=True, exist_ok=True)
    path, used = folder / f"{name}.py", folder / f"{name}.used"
    if not path.exists() or path.read_bytes() != text.encode():
        handle, temporary = tempfile.mkstemp(dir=folder, prefix=name, suffix=".tmp")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(text.encode())
            # one fixed time stamp: numba's index is keyed by it, and equal text is the same kernel for every process
            os.utime(temporary, (1_000_000_000, 1_000_000_000))
            os.replace(temporary, path)
        finally:
            Path(temporary).unlink(missing_ok=True)
        _prune(folder)
    with suppress(OSError):
        used.touch()
    return path


def _prune(folder: Path) -> None:
    """Remove kernels that have not been used for `KEEP_SECONDS`."""
    limit = time.time() - KEEP_SECONDS
    with suppress(OSError):  # another process does the same
        for used in folder.glob("pounding_kernel_*.used"):
            if used.stat().st_mtime < limit:
                for path in [*_compiled_files(folder, used.stem), *folder.glob(f"{used.stem}.*")]:
                    path.unlink(missing_ok=True)


@lru_cache(maxsize=1)
def _own_folder() -> Path:
    """Return a folder of this process alone, removed at its end."""
    folder = tempfile.mkdtemp(prefix="pounding_sweep_")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def _load(folder: Path, name: str, text: str) -> ModuleType:
    """Return a kernel's module; after a failure it is not loaded."""
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, _write(folder, name, text))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    del module.__file__  # programs that read the source of all loaded modules need not read generated text
    return module


def _load_or_compile(folder: Path, name: str, text: str) -> ModuleType:
    """Return a kernel's module, compiled anew if its files are cut or damaged so that numba can't read them."""
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


@lru_cache(maxsize=64)
def _warn_once(text: str) -> None:
    warnings.warn(text, RuntimeWarning, stacklevel=2)


@contextmanager
def _seldom_collected() -> Iterator[None]:
    """Have Python look for garbage less often: compiling makes millions of objects, and most of them stay."""
    before = gc.get_threshold()
    if before[0]:  # else it never looks
        gc.set_threshold(max(before[0], 50_000), max(before[1], 20), max(before[2], 100))
    try:
        yield
    finally:
        gc.set_threshold(*before)


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


def compile_piece(piece: KernelSpec) -> Any:
    """Return what is compiled by itself, numba's function of the address of a frame: a kernel, or a flight."""
    with _LOCK, _seldom_collected():
        folder, name, text = cache_folder(), source_digest(piece), module_text(piece)
        try:
            return _load_or_compile(folder, name, text).run
        except OSError as error:
            _warn_once(
                f"compiled kernels can't be kept in {str(folder)!r} ({error.strerror or error}), so every process "
                f"compiles its own; mend that, or name another folder in {CACHE_VARIABLE}"
            )
            return _load(_own_folder(), name, text).run


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
