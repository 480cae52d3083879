"""Small files that runs leave for one another, read and opened within bounds, whatever stands under their names."""

from __future__ import annotations

import errno
import json
import os
import stat
from contextlib import suppress
from pathlib import Path
from typing import Any

#: Larger files are not read: what a run of a million chunks says of itself has less.
LARGEST = 2**28


def open_own(path: Path, flags: int) -> int:
    """Open a file that is to be written; a link would lead to somebody else's, and a pipe has nobody who reads."""
    strange = f"{path.name!r} is no regular file; remove it"
    try:
        handle = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o666)
    except OSError as error:
        with suppress(OSError):
            if not stat.S_ISREG(os.lstat(path).st_mode):
                error.strerror = strange
        raise
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise OSError(errno.EINVAL, strange, os.fspath(path))
    return handle


def read_regular(path: Path) -> bytes:
    """Read a regular file of at most `LARGEST` bytes; opening a pipe would wait, a device may never end."""
    with open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)) as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise ValueError(f"{str(path)!r} is no regular file")
        if status.st_size > LARGEST:
            raise ValueError(f"{str(path)!r} has {status.st_size:,} bytes, at most {LARGEST:,} are read")
        return file.read(status.st_size)


def parse_json(text: bytes) -> Any:
    """Parse JSON; raises ValueError where it is none, or nested too deep."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deep") from None
