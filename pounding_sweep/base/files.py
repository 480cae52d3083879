"""Files that stand under their name only when they are complete, and what can be done where one can't be written."""

from __future__ import annotations

import errno
import os
import re
import secrets
import shutil
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from pounding_sweep.base.lock import acquire_lock

_TEMPORARY = re.compile(r"\.pounding_sweep-[0-9a-f]{16}\.part")


def _temporary_name() -> str:
    return f".pounding_sweep-{secrets.token_hex(8)}.part"


def is_temporary(name: str) -> bool:
    """Whether a file of that name was being written by `replacing`."""
    return _TEMPORARY.fullmatch(name) is not None


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


@contextmanager
def _own_folder(parent: Path) -> Iterator[Path]:
    """Make a hidden folder that is locked while the context is open, and remove it with all that is in it."""
    while True:
        folder = parent / _temporary_name()
        folder.mkdir()
        with suppress(FileNotFoundError, FileExistsError):
            lock = acquire_lock(folder)
            if folder.exists():
                break
            lock.release()  # somebody took the folder for a leftover before it was locked
    try:
        yield folder
    finally:
        lock.release()
        for pause in (0.0, 0.05, 0.5):  # threads of a library that gave up may still write for a moment
            time.sleep(pause)
            shutil.rmtree(folder, ignore_errors=True)
            if not folder.exists():
                break


def remove_leftovers(folder: Path) -> None:
    """Remove from a folder what killed processes were writing there with `replacing`."""
    with suppress(OSError):  # it may be written, but not listed
        for left in [folder / name for name in os.listdir(folder) if is_temporary(name)]:
            with suppress(OSError):
                lock = acquire_lock(left, timeout=0)
                shutil.rmtree(left, ignore_errors=True)
                lock.release()


@contextmanager
def replacing(path: Path, folder: Path | None = None) -> Iterator[Path]:
    """Give a temporary name, in `folder` if it is on the same disk; when the block ends well, make that `path`."""
    with ExitStack() as contexts:
        if folder is None or folder.stat().st_dev != path.parent.stat().st_dev:
            remove_leftovers(path.parent)
            folder = contexts.enter_context(_own_folder(path.parent))
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
        name = getattr(error, "filename", None)
        reason += "" if name is None else f": {os.fspath(name)!r}"
        remedy = "what is missing was removed meanwhile: run again, and leave it"
    elif number in (errno.ENOSPC, errno.EDQUOT) or number is None or number < 0:  # the netCDF library gives no reason
        remedy = "free some space and run again"
    else:
        remedy = "see to the disk, or give a path on another one, and run again"
    return f"{what} failed ({reason}); {remedy}"
