"""Files that stand under their name only when they are complete, and what can be done where one can't be written."""

from __future__ import annotations

import errno
import os
import re
import secrets
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from pounding_sweep.base.lock import own_folder, remove_abandoned

_TEMPORARY = re.compile(r"\.pounding_sweep-[0-9a-f]{16}\.part")


def is_temporary(name: str) -> bool:
    """Whether a file of that name was being written by `replacing`."""
    return _TEMPORARY.fullmatch(name) is not None


def sync_folder(folder: Path) -> None:
    """Make the names in a folder lasting, where its file system can."""
    with suppress(OSError):  # some network file systems can't sync a folder
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def remove_leftovers(folder: Path) -> None:
    """Remove from a folder what killed processes were writing there with `replacing`."""
    with suppress(OSError):  # it may be written, but not listed
        for left in filter(is_temporary, os.listdir(folder)):
            remove_abandoned(folder / left)


def _moves(folder: Path, other: Path, name: str) -> bool:
    """Whether files can be moved between two folders; `name` is there in neither."""
    if folder.stat().st_dev != other.stat().st_dev:
        return False
    try:
        os.rename(folder / name, other / name)
    except OSError as error:
        return error.errno != errno.EXDEV
    return True


@contextmanager
def replacing(path: Path, folder: Path | None = None) -> Iterator[Path]:
    """Give a temporary name; when the block ends well, make what stands there `path` for good."""
    with ExitStack() as contexts:
        name = f".pounding_sweep-{secrets.token_hex(8)}.part"
        if folder is None or not _moves(folder, path.parent, name):
            remove_leftovers(path.parent)
            folder = contexts.enter_context(own_folder(path.parent / name))
        temporary = folder / name
        try:
            yield temporary
            handle = os.open(temporary, os.O_RDONLY)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)
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
        remedy = "make the folder writable and run again"
    elif number in (errno.ENOENT, errno.ENOTDIR, errno.ESTALE):
        name = getattr(error, "filename", None)
        reason += "" if name is None else f": {os.fspath(name)!r}"
        remedy = "what is missing was removed meanwhile: run again, and leave it"
    elif number in (errno.ENOSPC, errno.EDQUOT) or number is None or number < 0:  # the netCDF library gives no reason
        remedy = "free some space and run again"
    else:
        remedy = "see to the disk, or give a path on another one, and run again"
    return f"{what} failed ({reason}); {remedy}"
