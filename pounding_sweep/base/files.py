"""Paths as users write them, locked folders, and files that stand under their name only when they are complete."""

from __future__ import annotations

import difflib
import errno
import os
import secrets
import shutil
import time
import tomllib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pounding_sweep.base.errors import InputError, repr_short

if TYPE_CHECKING:
    from filelock import BaseFileLock

#: A path as users give it.
FilePath = str | os.PathLike[str]
#: Said where a text of a sweep file has a backslash by accident.
ESCAPE_HINT = "in double quotes \\ begins an escape: write / in its place, or the text in single quotes"
#: The lock file of a folder, and that of a drive that grants no locks (some NFS mounts).
LOCK, SOFT_LOCK = "lock", "lock.soft"
#: Names of what is being written, where a random number stands for the star, and the age (s) of a leftover: younger
#: ones may not have their lock yet.
TEMPORARY, LEFT_AFTER = ".pounding_sweep-*.part", 60.0


@cache
def read_data(name: str) -> dict[str, Any]:
    """Read a table of the package's own data."""
    return tomllib.loads(files("pounding_sweep").joinpath("data", name).read_text(encoding="utf-8"))


def expanded(raw: FilePath) -> Path:
    """Return a path with the home folder in the place of ``~`` or ``~user``."""
    try:
        return Path(raw).expanduser()
    except RuntimeError:
        raise InputError(
            f"{repr_short(os.fspath(raw))}: the home folder that '~' stands for is not known here; write it out in full"
        ) from None


def absolute(path: FilePath) -> Path:
    """Return an absolute path, ``~`` expanded and links followed, whether or not it exists."""
    return Path(os.path.realpath(expanded(path)))


def near_file(path: Path) -> str:
    """Ask whether a file of nearly that name was meant, such as one in another case; "" if there is none."""
    try:
        names = {name.lower(): name for name in sorted(os.listdir(path.parent))}
    except (OSError, ValueError):
        return ""
    close = difflib.get_close_matches(path.name.lower(), names, n=1, cutoff=0.8)
    return f"did you mean {repr_short(names[close[0]])}? " if close else ""


def acquire_lock(folder: Path, timeout: float = -1.0) -> BaseFileLock:
    """Lock a folder, waiting at most `timeout` seconds (-1: without limit); raises `filelock.Timeout`."""
    from filelock import FileLock, SoftFileLock

    lock: BaseFileLock = FileLock(folder / LOCK, timeout=timeout)
    try:
        lock.acquire()
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP):
            raise
        lock = SoftFileLock(folder / SOFT_LOCK, timeout=timeout)
        lock.acquire()
    return lock


def _temporary_name() -> str:
    return TEMPORARY.replace("*", secrets.token_hex(8))


def sync(path: Path) -> None:
    """Put a file, or the names in a folder, on disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def sync_folder(folder: Path) -> None:
    """Make the names in a folder lasting, where its file system can."""
    with suppress(OSError):  # some network file systems can't sync a folder
        sync(folder)


def remove_leftovers(folder: Path) -> None:
    """Remove from a folder what killed processes were writing there with `replacing`."""
    for left in folder.glob(TEMPORARY):
        with suppress(OSError), ExitStack() as contexts:
            if time.time() - left.stat().st_mtime > LEFT_AFTER:
                contexts.callback(acquire_lock(left, 0.0).release)
                shutil.rmtree(left, ignore_errors=True)


@contextmanager
def replacing(path: Path, folder: Path | None = None) -> Iterator[Path]:
    """Give a temporary name, in a `folder` on the same disk if need be; when the block ends well, make that `path`."""
    with ExitStack() as contexts:
        if folder is None:
            remove_leftovers(path.parent)
            folder = path.parent / _temporary_name()
            folder.mkdir()
            contexts.callback(acquire_lock(folder).release)
            contexts.callback(shutil.rmtree, folder, ignore_errors=True)
        temporary = folder / _temporary_name()
        try:
            yield temporary
            sync(temporary)
            temporary.replace(path)
        except BaseException:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
            raise
        sync_folder(path.parent)


def failure(what: str, error: Exception) -> str:
    """Say of a write that it failed, and what can be done about it."""
    number, reason = getattr(error, "errno", None), str(getattr(error, "strerror", None) or error)
    if number in (errno.EACCES, errno.EPERM, errno.EROFS):
        remedy = "make the folder writable (on a drive without locks: set HDF5_USE_FILE_LOCKING=FALSE) and run again"
    elif number in (errno.ENOENT, errno.ENOTDIR, errno.ESTALE):
        remedy = "what is missing was removed meanwhile: run again, and leave it"
    elif number in (errno.ENOSPC, errno.EDQUOT) or number is None or number < 0:  # the netCDF library gives no reason
        remedy = "free some space and run again"
    else:
        remedy = "see to the disk, or give a path on another one, and run again"
    return f"{what} failed ({reason}); {remedy}"
