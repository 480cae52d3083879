"""Reading a file of any origin as text, safely."""

from __future__ import annotations

import re
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
import numpy.typing as npt

from pounding_sweep.base.errors import MissingRecordError, RecordError
from pounding_sweep.base.text import printable

MAX_FILE_BYTES = 64 * 2**20
"""Larger files are refused: the longest strong-motion records have a few MiB."""
MOST_POINTS = 10_000_000
"""Longer records are refused: they are a day of motion at 100 points per second."""


@dataclass(frozen=True)
class Content:
    """What a record file says, before units and scaling: accelerations, step (s), header, title and usual units."""

    values: npt.NDArray[np.float64]
    dt: float
    header: str
    title: str
    default_units: str | None


def fail(path: Path, text: str) -> NoReturn:
    """Raise `RecordError` of a file."""
    msg = f"{printable(str(path))}: {text}"
    raise RecordError(msg)


def in_bounds(path: Path, points: int) -> None:
    """Raise `RecordError` of a file that has too many points."""
    if points > MOST_POINTS:
        fail(path, f"has more than {MOST_POINTS:,} points; is it a record? If so, cut it")


def in_quotes(word: str) -> str:
    """Return a word of a file for a message, cut where it is long."""
    return repr(word if len(word) <= 24 else word[:24] + "...")


def load_text(file: Path, record: str) -> str:
    """Read a regular file of bounded size as text, whatever its encoding; `record` is the name it is read for."""
    try:
        status = file.stat()
    except FileNotFoundError:
        msg = f"{file}: no such file; check the path, or name a folder of records in POUNDING_SWEEP_RECORDS"
        raise MissingRecordError(msg, record) from None
    except (OSError, ValueError) as error:
        fail(file, f"can't be read: {getattr(error, 'strerror', None) or error}")
    if stat.S_ISDIR(status.st_mode):
        fail(file, "is a folder; give a file in it")
    if not stat.S_ISREG(status.st_mode):  # opening a pipe would wait for ever
        fail(file, "is not a regular file; save the record to a file first")
    if status.st_size > MAX_FILE_BYTES:
        size, limit = status.st_size / 2**20, MAX_FILE_BYTES // 2**20
        fail(file, f"has {size:.0f} MiB; files of more than {limit} MiB are refused: is it a record? If so, cut it")
    try:
        with file.open("rb") as stream:
            raw = stream.read(status.st_size + 1)  # memory for what is asked is taken at once
    except OSError as error:
        fail(file, f"can't be read: {error.strerror or error}")
    if raw.startswith((b"PK\x03\x04", b"\x1f\x8b", b"BZh")):
        fail(file, "is compressed; unpack it first")
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            text = raw.decode("utf-16")
        except UnicodeDecodeError:
            fail(file, "has a UTF-16 mark but is no UTF-16 text; save it as plain text")
    else:
        try:
            text = raw.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = raw.decode("latin-1")
    text = text.replace("\r\n", "\n").replace("\r", "\n").rstrip("\x1a\n\t ")  # DOS files may end in ^Z
    if not text.strip():
        fail(file, "is empty; a record needs at least 1 point")
    if re.search(r"[\x00-\x08\x0b\x0e-\x1f\x7f]", text):
        fail(file, "is binary, not text; give a PEER AT2, CSV or text file")
    return text
