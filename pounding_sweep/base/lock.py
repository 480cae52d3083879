"""One run at a time in a folder: the lock is the kernel's, so that it ends with the process that holds it.

A drive without locks (some NFS mounts) has a file that marks the folder as in use instead.
"""

from __future__ import annotations

import errno
import os
import socket
import time
import warnings
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from filelock import BaseFileLock, FileLock, SoftFileLock, Timeout

from pounding_sweep.base.errors import OutputError

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
