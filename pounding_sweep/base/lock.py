"""Folders that one process at a time has for itself: those of chunks, and of files that are being written.

The lock is the kernel's (``flock``), so that it ends with the process that
holds it, however that ends. The file's text says who that is, or was: where a
file system keeps locks to each machine, a lock that is free here may be held
elsewhere, and only the text tells.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import json
import os
import shutil
import socket
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from pounding_sweep.base.errors import OutputError
from pounding_sweep.base.regular import open_own, parse_json

LOCK = "lock"
#: Seconds for which a lock is waited for: `running` holds it for a moment when it looks.
PATIENCE = 0.5
#: Seconds more for a folder that is gone whenever it was made: several runs begin and end in it.
COMES_AND_GOES = 10.0
#: Seconds after which a folder whose lock names nobody is abandoned: its process was killed before it could.
NAMELESS = 3600.0
#: Bytes of a lock's text at most.
_LONGEST = 2**16


@dataclass(frozen=True)
class Holder:
    """Who runs on a folder.

    Attributes
    ----------
    host : str
        Machine.
    pid : int
        Process on it.
    started : str
        When it took the lock (ISO 8601).
    boot : str
        Identity of the kernel since it started, the same in all containers on it; empty where there is none.
    machine : str
        Digest of what the system is known by, the same after it starts again; empty where there is none.
    """

    host: str
    pid: int
    started: str
    boot: str = ""
    machine: str = ""

    def has_ended(self) -> bool:
        """Whether a lock that is free here tells that this process is gone, here being its machine."""
        here = _here()
        if self.boot and self.boot == here.boot:
            return True
        again = not self.boot or (self.machine != "" and self.machine == here.machine)
        return again and self.host == here.host

    def __str__(self) -> str:
        return f"process {self.pid} on {self.host}, since {self.started}"


def _text(path: str) -> str:
    try:
        return Path(path).read_text(encoding="utf-8").strip()
    except (OSError, ValueError):
        return ""


def _here() -> Holder:
    """Return this process as a holder from now on."""
    system = _text("/etc/machine-id")  # not to be shown to others as it is
    return Holder(
        socket.gethostname(),
        os.getpid(),
        datetime.now().astimezone().isoformat(timespec="seconds"),
        _text("/proc/sys/kernel/random/boot_id"),
        hashlib.sha256(f"pounding_sweep {system}".encode()).hexdigest()[:16] if system else "",
    )


def _read(handle: int) -> Holder | None:
    """Read who an open lock file names; None where it was not written to the end."""
    try:
        found = parse_json(os.pread(handle, _LONGEST, 0))
        more = (str(found.get(name, "")) for name in ("boot", "machine"))
        return Holder(str(found["host"]), int(found["pid"]), str(found["started"]), *more)
    except (OSError, ValueError, TypeError, KeyError, AttributeError, OverflowError):
        return None


def _take(handle: int, how: int) -> bool:
    """Lock an open file; False where somebody else has it."""
    try:
        fcntl.flock(handle, how | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
            return False
        raise
    return True


def running(folder: Path) -> Holder | None:
    """Return who runs on a folder now; None where nobody on this machine does, and nobody elsewhere says so."""
    try:
        handle = open_own(folder / LOCK, os.O_RDONLY)
    except OSError:
        return None
    found = _read(handle)
    try:
        free = _take(handle, fcntl.LOCK_SH)
    except OSError:  # no locks on this file system: the text is all there is
        return found
    finally:
        os.close(handle)
    return None if free and (found is None or found.has_ended()) else found


def _sign(handle: int) -> None:
    """Have a lock file say who holds it."""
    os.ftruncate(handle, 0)
    os.pwrite(handle, (json.dumps(asdict(_here())) + "\n").encode(), 0)


@contextmanager
def own_folder(folder: Path) -> Iterator[Path]:
    """Make a folder, have it locked while the context is open, and remove it with all that is in it."""
    folder.mkdir()
    handle = -1
    try:
        handle = open_own(folder / LOCK, os.O_RDWR | os.O_CREAT)
        with suppress(OSError):  # where nothing can be locked, nobody finds it abandoned
            fcntl.flock(handle, fcntl.LOCK_EX)  # who looks whether it is abandoned has it for a moment
        _sign(handle)
        os.fsync(handle)  # a name that a power cut takes away would leave the folder for long
        yield folder
    finally:
        for pause in (0.0, 0.05, 0.5):  # threads of a library that gave up may still write for a moment
            time.sleep(pause)
            shutil.rmtree(folder, ignore_errors=True)
            if not folder.exists():
                break
        if handle >= 0:
            os.close(handle)


def remove_abandoned(folder: Path) -> bool:
    """Remove a folder of `own_folder` whose process was killed; returns whether it did."""
    try:
        handle = open_own(folder / LOCK, os.O_RDWR)
    except OSError:  # it is being made or removed, or somebody else's
        return False
    try:
        free, who = _take(handle, fcntl.LOCK_EX), _read(handle)
        ended = time.time() - os.fstat(handle).st_mtime > NAMELESS if who is None else who.has_ended()
        if not free or not ended:
            return False
        shutil.rmtree(folder, ignore_errors=True)
        return True
    except OSError:
        return False
    finally:
        os.close(handle)


class FolderLock:
    """Keeps other runs out of a folder while the context is open."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._handle = -1

    @property
    def _path(self) -> Path:
        return self.folder / LOCK

    def __enter__(self) -> FolderLock:
        try:
            self._lock()
            _sign(self._handle)
        except BaseException as error:
            self._close()
            if isinstance(error, OutputError) or not isinstance(error, OSError):
                raise
            msg = f"the chunk folder {str(self.folder)!r} can't be made or written ({error}); give another output path"
            raise OutputError(msg) from error
        return self

    def __exit__(self, *raised: Any) -> None:
        with suppress(OSError):  # the folder may be gone, and with it the need to unlock
            if self._is_current():
                self._path.unlink()
        self._close()
        if os.path.isdir(self.folder):
            with suppress(OSError):  # chunks are in it, or it is a link
                self.folder.rmdir()

    def _close(self) -> None:
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1

    def _is_current(self) -> bool:
        """Whether the open file is the one that stands in the folder, not one that its holder has removed."""
        try:
            return os.path.samestat(os.fstat(self._handle), self._path.stat())
        except FileNotFoundError:
            return False

    def _lock(self) -> None:
        limit = time.monotonic() + PATIENCE
        while True:
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
                self._handle = open_own(self._path, os.O_RDWR | os.O_CREAT)
            except (FileNotFoundError, FileExistsError) as error:  # the run that ended just now has removed the folder
                if time.monotonic() > limit + (COMES_AND_GOES if isinstance(error, FileNotFoundError) else 0.0):
                    raise
                continue
            try:
                free = _take(self._handle, fcntl.LOCK_EX)
            except OSError as error:
                msg = (
                    f"the file system of {str(self.folder)!r} can't lock ({error}): "
                    "nothing keeps two runs on this output apart; start only one"
                )
                warnings.warn(msg, RuntimeWarning, stacklevel=4)
                return
            if free and self._is_current():
                self._take_over()
                return
            if not free and time.monotonic() > limit:
                self._refuse()
            self._close()
            time.sleep(0.02)

    def _refuse(self) -> None:
        who = _read(self._handle)
        msg = (
            f"another run is at work in {str(self.folder)!r}: {who or 'a process that has not said its name'}; "
            "wait for it, stop it, or give another output path"
        )
        raise OutputError(msg)

    def _take_over(self) -> None:
        """Judge what the file says of the run before, which did not unlock."""
        who = _read(self._handle)
        if who is None:
            return
        if not who.has_ended():
            msg = (
                f"{str(self.folder)!r} is locked by {who}, another machine, whose processes can't be seen from here. "
                f"If that run has ended, remove {str(self._path)!r} and run again; else wait for it or give "
                "another output path"
            )
            raise OutputError(msg)
        msg = f"the run before this one was killed ({who}); this one goes on from what it finished"
        warnings.warn(msg, RuntimeWarning, stacklevel=5)
