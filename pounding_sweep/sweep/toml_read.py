"""Reading a sweep file within bounds, whatever its name leads to."""

from __future__ import annotations

import stat
from pathlib import Path

#: Larger sweep files are refused: tens of thousands of listed cases have a few MiB.
MAX_FILE_BYTES = 64 * 2**20


def read_bounded(file: Path) -> bytes:
    """Read a regular file of at most `MAX_FILE_BYTES`; opening a pipe would wait, a device may never end.

    Raises
    ------
    OSError, ValueError
        It can't be read, is no regular file, or is larger.
    """
    status = file.stat()
    if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):  # a folder can't be read: said below
        msg = "it is no regular file; save the sweep to one first"
        raise ValueError(msg)
    if status.st_size > MAX_FILE_BYTES:
        msg = f"it has {status.st_size:,} bytes, at most {MAX_FILE_BYTES:,} are read; give axes as ranges"
        raise ValueError(msg)
    return file.read_bytes()
