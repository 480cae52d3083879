"""Paths as users write them, locked folders, and files that stand under their name only when they are complete."""

from __future__ import annotations

import difflib
import errno
import os
import re
import secrets
import shutil
import socket
import time
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from filelock import BaseFileLock, FileLock, SoftFileLock, Timeout

from pounding_sweep.base.errors import InputError, OutputError, shown

#: Said where a text of a sweep file has a backslash by accident.
ESCAPE_HINT = "in double quotes \\ begins an escape: write / in its place, or the text in single quotes"


def expanded(path: str | os.PathLike[str], error: type[InputError] = InputError) -> Path:
    """Return a path with the home folder in the place of ``~`` or ``~user``."""
    try:
        return Path(path).expanduser()
    except RuntimeError:
        raise error(
            f"{shown(os.fspath(path))}: the home folder that '~' stands for is not known here; write it out in full"
        ) from None


def absolute(path: str | os.PathLike[str]) -> Path:
    """Return an absolute path, ``~`` expanded and links followed, whether or not it exists."""
    found = expanded(path)
    try:
        return Path(os.path.realpath(found))
    except FileNotFoundError:
        raise InputError(
            f"{shown(os.fspath(path))}: the working folder was removed; change to another one, or give a whole path"
        ) from None


def near_file(path: Path) -> str:
    """Ask whether a file of nearly that name was meant, such as one in another case; "" if there is none."""
    try:
        names = {name.lower(): name for name in sorted(os.listdir(path.parent))}
    except (OSError, ValueError):
        return ""
    close = difflib.get_close_matches(path.name.lower(), names, n=1, cutoff=0.8)
    return f"did you mean {shown(names[close[0]])}? " if close else ""


LOCK = "lock"
#: The lock file of a drive that grants no locks.
SOFT_LOCK = "lock.soft"
NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)
#: Who has the lock, as text; what a killed run left tells the next one of it.
HOLDER = "holder.txt"
#: Seconds for which a lock is waited for: `running` holds it for a moment when it looks.
PATIENCE = 0.5


def acquire_lock(folder: Path, timeout: float = -1.0) -> BaseFileLock:
    """Lock a folder that exists, waiting at most `timeout` seconds (-1: without limit); raises `Timeout`."""
    lock: BaseFileLock = FileLock(folder / LOCK, timeout=timeout, thread_local=False)
    try:
        lock.acquire()
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise
        lock = SoftFileLock(folder / SOFT_LOCK, timeout=timeout, thread_local=False)
        lock.acquire()
    return lock


def _holder(folder: Path) -> str:
    try:
        text = (folder / HOLDER).read_text(encoding="utf-8").strip()
    except (OSError, ValueError):
        return ""
    return text if text.isprintable() else ""


def running(folder: Path) -> str | None:
    """Return who runs on a folder now; None where nobody does."""
    if not any((folder / name).exists() for name in (LOCK, SOFT_LOCK)):
        return None
    try:
        acquire_lock(folder, timeout=0).release()
        return None
    except OSError:  # somebody has it, or it may not be looked at: the text is all there is
        return _holder(folder) or "a process that has not said its name"


class FolderLock:
    """Keeps other runs out of a folder while the context is open."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._lock: BaseFileLock | None = None

    def __enter__(self) -> FolderLock:
        limit = time.monotonic() + 10.0
        while self._lock is None:
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
                self._lock = acquire_lock(self.folder, PATIENCE)
                self._sign()
            except Timeout:
                raise OutputError(
                    f"another run is at work in {str(self.folder)!r}: {running(self.folder) or 'it has just ended'}; "
                    "wait for it, stop it, or give another output path"
                ) from None
            except OSError as error:
                self._release()
                gone = isinstance(error, FileNotFoundError) and self.folder.parent.is_dir()
                if gone and time.monotonic() < limit:
                    time.sleep(0.01)  # the run that ended just now has removed the folder
                    continue
                msg = f"the chunk folder {str(self.folder)!r} can't be made or written ({error}); "
                raise OutputError(msg + "give another output path") from error
        return self

    def _release(self) -> None:
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    def _sign(self) -> None:
        """Tell of a run before this one that was killed, and say who is here now."""
        before = _holder(self.folder)
        now = datetime.now().astimezone().isoformat(timespec="seconds")
        text = f"process {os.getpid()} on {socket.gethostname()}, since {now}\n"
        (self.folder / HOLDER).write_text(text, encoding="utf-8")
        if before:
            msg = f"the run before this one was killed ({before}); this one goes on from what it finished"
            warnings.warn(msg, RuntimeWarning, stacklevel=5)

    def __exit__(self, *raised: Any) -> None:
        with suppress(OSError):  # the folder may be gone
            for name in (HOLDER, LOCK):
                (self.folder / name).unlink(missing_ok=True)
        self._release()
        with suppress(OSError):  # chunks are in it, or it is a link
            self.folder.rmdir()


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
