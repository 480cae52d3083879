"""Compiled kernels on disk.

A kernel's text is complete in itself, so the file that holds it is named by the
SHA-256 of that text: any edit to a law, a scheme or a reducer that changes the
generated code gives another file and is compiled afresh, and an edit that does
not changes nothing. numba's own index beside the file adds the CPU and the numba
version to the key. numba trusts its files; so that damaged ones are compiled anew,
the SHA-256 of each file of machine code is kept beside it.
"""

from __future__ import annotations

import atexit
import gc
import hashlib
import importlib.util
import os
import shutil
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from threading import RLock
from types import ModuleType
from typing import Any

from pounding_sweep.base.errors import InputError
from pounding_sweep.base.paths import expanded
from pounding_sweep.emit.spec import KernelSpec
from pounding_sweep.engine.kernel import ROW_NAME, kernel_text

#: Environment variable that names another folder for compiled kernels.
CACHE_VARIABLE = "POUNDING_SWEEP_CACHE"
_LOCK = RLock()
_LOADED: set[KernelSpec] = set()
#: Folders of which it was said that they are damaged, or can't be used.
_TOLD: set[Path] = set()

#: One signature per kernel: compiled when loaded, never again for another kind of array.
SIGNATURE = "void(float64[::1], float64, int64, int64, {real}[::1], float64[:, ::1], float64[:, ::1], float64[:, ::1])"
#: Kernels not used for this long (s) are removed when a new one is written.
KEEP_SECONDS = 90 * 24 * 3600.0
#: Ending of the file beside machine code that holds its SHA-256.
DIGEST = ".sha256"
#: Seconds in which a process that replaced machine code replaces its digest too.
SETTLE_SECONDS = 0.2


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


def module_name(text: str) -> str:
    """Name generated code by a digest of its text."""
    return "pounding_kernel_" + hashlib.sha256(text.encode()).hexdigest()[:24]


def _texts(shape: KernelSpec) -> list[tuple[str, str]]:
    """Name and text of the row module and of the main module, with disk caching switched on."""
    text = kernel_text(shape)
    row = text.row.replace("@njit(**OPTIONS)", "@njit(cache=True, **OPTIONS)")
    row_name = module_name(row)
    main = text.main.replace(f"from {ROW_NAME} import *", f"from {row_name} import *")
    signature = SIGNATURE.format(real=shape.precision)
    main = main.replace("\n@njit(**OPTIONS)\ndef run(", f"\n@njit({signature!r}, cache=True, **ENTRY)\ndef run(")
    return [(row_name, row), (module_name(main), main)]


def source_digest(shape: KernelSpec) -> str:
    """Return the name of the kernel's main module, which its whole text decides."""
    return _texts(shape)[-1][0]


def text_sizes(shape: KernelSpec) -> tuple[str, int, int]:
    """Return the name of the kernel's row module, and the lengths of both texts: what compiling takes goes by them."""
    (row_name, row), (_, main) = _texts(shape)
    return row_name, len(row), len(main)


def is_loaded(shape: KernelSpec) -> bool:
    """Whether this process has the kernel already."""
    return shape in _LOADED


def is_cached(shape: KernelSpec) -> bool:
    """Whether a compiled form of this kernel is on disk (for some CPU), and not seen to be damaged."""
    name = source_digest(shape)
    try:
        found = _compiled(cache_folder(), [name])
        kinds = {path.suffix for path in found if path.name.startswith(f"{name}.run-")}
        return kinds >= {".nbi", ".nbc"} and not _damaged(found)
    except OSError:
        return False


def _write(folder: Path, name: str, text: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.py"
    if path.exists():
        if path.read_bytes() == text.encode():
            os.utime(folder / f"{name}.used") if (folder / f"{name}.used").exists() else None
            return path
        path.unlink()
    _put(path, text)
    (folder / f"{name}.used").touch()
    _prune(folder)
    return path


def _put(path: Path, text: str) -> None:
    """Write a file that is there whole or not at all."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(text.encode())
        # one fixed time stamp: numba's index is keyed by it, and equal text is the same kernel for every process
        os.utime(temporary, (1_000_000_000, 1_000_000_000))
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def _prune(folder: Path) -> None:
    """Remove kernels that have not been used for `KEEP_SECONDS`."""
    limit = time.time() - KEEP_SECONDS
    for used in folder.glob("pounding_kernel_*.used"):
        try:
            if used.stat().st_mtime < limit:
                for path in [*folder.glob(f"{used.stem}.*"), *(folder / "__pycache__").glob(f"{used.stem}.*")]:
                    path.unlink(missing_ok=True)
        except OSError:
            continue


def _compiled(folder: Path, names: Sequence[str]) -> list[Path]:
    """Return the files that Python and numba keep of modules; not those that they are writing."""
    kept = folder / "__pycache__"
    try:
        found = os.listdir(kept)
    except FileNotFoundError:
        return []
    begins = tuple(f"{name}." for name in names)
    return [kept / name for name in found if name.startswith(begins) and name.endswith((".nbi", ".nbc", ".pyc"))]


def _digest_file(path: Path) -> Path:
    return path.with_name(path.name + DIGEST)


def _kept_digest(path: Path) -> str | None:
    """Return the digest kept beside machine code; None where there is none."""
    try:
        return _digest_file(path).read_text(encoding="latin-1")
    except FileNotFoundError:
        return None


def _is_damaged(path: Path) -> bool:
    """Whether a file is seen not to be what numba wrote: a whole pickle, and of its digest where that is kept."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:  # another process has just forgotten it
        return False
    if not (content.startswith(b"\x80") and content.endswith(b".")):
        return True
    kept = _kept_digest(path)
    return kept is not None and kept != hashlib.sha256(content).hexdigest()


def _damaged(files: Iterable[Path]) -> list[Path]:
    """Return those of numba's files that are damaged."""
    found = [path for path in files if path.suffix != ".pyc" and _is_damaged(path)]
    if found:
        time.sleep(SETTLE_SECONDS)
    return [path for path in found if _is_damaged(path)]


def _forget(files: Iterable[Path]) -> None:
    for path in files:
        path.unlink(missing_ok=True)
        _digest_file(path).unlink(missing_ok=True)


def _keep_digests(folder: Path, names: Sequence[str]) -> None:
    """Write the digests of machine code that has none, or that of a file before."""
    for path in _compiled(folder, names):
        if path.suffix == ".nbc" and _kept_digest(path) != (found := hashlib.sha256(path.read_bytes()).hexdigest()):
            _digest_file(path).unlink(missing_ok=True)  # that of a file before: a full disk takes no other in its place
            _put(_digest_file(path), found)


@lru_cache(maxsize=1)
def _own_folder() -> Path:
    """Return a folder of this process alone, removed at its end."""
    folder = tempfile.mkdtemp(prefix="pounding_sweep_")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def _load(name: str, path: Path) -> ModuleType:
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
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


def _load_all(folder: Path, texts: Sequence[tuple[str, str]]) -> ModuleType:
    """Return the last of a kernel's modules; after a failure none of them is loaded."""
    try:
        for name, text in texts:
            module = _load(name, _write(folder, name, text))
    except Exception:
        for name, _ in texts:
            sys.modules.pop(name, None)
        raise
    return module


def _load_sound(folder: Path, texts: Sequence[tuple[str, str]]) -> ModuleType:
    """Return the last of a kernel's modules; what is damaged of them is compiled anew."""
    names = [name for name, _ in texts]
    damaged = _damaged(_compiled(folder, names))
    _forget(damaged)
    try:
        module = _load_all(folder, texts)
    except (OSError, MemoryError):
        raise
    except Exception:  # whatever numba makes of a damaged file
        damaged = _compiled(folder, names)
        if not damaged:
            raise
        _forget(damaged)
        module = _load_all(folder, texts)
    if any(module.run.stats.cache_misses.values()):  # compiled here
        with suppress(OSError):
            _keep_digests(folder, names)
    if damaged:
        _tell(
            folder,
            f"compiled kernels in {str(folder)!r} were damaged or half written, and are compiled anew; if that comes "
            f"again, check its disk, or name another folder in {CACHE_VARIABLE}",
        )
    return module


def _tell(folder: Path, text: str) -> None:
    """Warn about a folder, once."""
    if folder not in _TOLD:
        _TOLD.add(folder)
        warnings.warn(text, RuntimeWarning, stacklevel=2)


@lru_cache(maxsize=256)
def get_kernel(shape: KernelSpec) -> Callable[..., Any]:
    """Return the kernel's compiled ``run`` function, loaded from the disk cache where it is there."""
    with _LOCK, _seldom_collected():
        folder, texts = cache_folder(), _texts(shape)
        try:
            module = _load_sound(folder, texts)
        except OSError as error:
            module = _load_all(_own_folder(), texts)
            _tell(
                folder,
                f"compiled kernels can't be kept in {str(folder)!r} ({error.strerror or error}), so every process "
                f"compiles its own; mend that, or name another folder in {CACHE_VARIABLE}",
            )
    _LOADED.add(shape)
    run: Callable[..., Any] = module.run
    return run
