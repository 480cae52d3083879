"""Paths as users write them: ``~``, and a working folder that may be gone."""

from __future__ import annotations

import difflib
import os
from pathlib import Path

from pounding_sweep.base.errors import InputError, shown

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
