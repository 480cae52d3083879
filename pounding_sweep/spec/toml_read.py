"""Reading a sweep file within bounds, whatever its name leads to and however it is written."""

from __future__ import annotations

import re
import stat
import tomllib
from pathlib import Path
from typing import Any

from pounding_sweep.base.errors import SweepError

#: Larger sweep files are refused: tens of thousands of listed cases have a few MiB.
MAX_FILE_BYTES = 64 * 2**20
#: Deeper tables and arrays are refused, and longer dotted keys: those of sweep files have six parts at most.
MAX_DEPTH = 20

_PART = r"""(?:[A-Za-z0-9_-]++|"(?:\\.|[^"\\\n])*+"|'[^'\n]*+')"""
#: What a file is made of: comments and strings, which may hold anything, words, and dotted keys that are too long.
_TOKEN = re.compile(
    r"#[^\n]*+"
    r'|"{3}(?:\\.|[^"\\]|"(?!""))*+(?:"{3,5}|\Z)'
    r"|'{3}(?:[^']|'(?!''))*+(?:'{3,5}|\Z)"
    rf"|(?P<key>{_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{MAX_DEPTH}}}+)"
    r'|"(?:\\.|[^"\\\n])*+(?:"|(?=\n)|\Z)'
    r"|'[^'\n]*+(?:'|(?=\n)|\Z)"
    r"|[A-Za-z0-9_-]++",
    re.DOTALL,
)


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


def parse_bounded(text: str) -> dict[str, Any]:
    """Parse TOML of at most `MAX_DEPTH` levels; the parser takes the square of the parts of a key in time and memory.

    Raises
    ------
    tomllib.TOMLDecodeError
        It is no TOML.
    ValueError
        A key, table or array is too deep, or a number too long.
    """
    for token in _TOKEN.finditer(text):
        if token["key"]:
            line = text.count("\n", 0, token.start()) + 1
            msg = f"line {line}: a key of more than {MAX_DEPTH} parts; those of sweep files have six at most"
            raise ValueError(msg)
    try:
        data = tomllib.loads(text)
    except RecursionError:
        data = None
    if data is None or _is_deep(data):
        msg = f"tables or arrays are more than {MAX_DEPTH} levels deep; those of sweep files are six at most"
        raise ValueError(msg)
    return data


def _is_deep(data: dict[str, Any]) -> bool:
    level: list[Any] = [data]
    for _ in range(MAX_DEPTH + 1):
        level = [
            item
            for given in level
            for item in (given.values() if isinstance(given, dict) else given)
            if isinstance(item, dict | list)
        ]
    return bool(level)


def syntax_error(path: str, text: str, error: tomllib.TOMLDecodeError) -> SweepError:
    """Put the place of a TOML syntax error in front of what it says."""
    said = str(error)
    match = re.search(r" \(at line (\d+), column (\d+)\)$", said)
    if match:
        place, said = f"{path}:{match[1]}:{match[2]}", said[: match.start()]
    else:
        place, said = f"{path}:{len(text.splitlines()) or 1}", re.sub(r" \(at (end of document)\)$", r" at \1", said)
    problem = f"{place}: no valid TOML: {said[:1].lower()}{said[1:]}"
    return SweepError(problem, [problem])
