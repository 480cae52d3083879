"""What a format of record files is, and what all readers share: safe text, numbers, bounds, messages."""

from __future__ import annotations

import re
import stat
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
import numpy.typing as npt

from pounding_sweep.base.errors import MissingRecordError, RecordError
from pounding_sweep.base.text import printable
from pounding_sweep.records.record import number

MAX_FILE_BYTES = 64 * 2**20
"""Larger files are refused: the longest strong-motion records have a few MiB."""
MOST_POINTS = 10_000_000
"""Longer records are refused: they are a day of motion at 100 points per second."""

#: Characters that are read at a time; whole lines.
BLOCK = 2**16
#: A line that is longer than this and a block is no row of a record.
LONGEST_LINE = 2**20
#: Longer words are no numbers.
LONGEST_WORD = 4096
#: Lines by which a format is told.
HEAD = 32

# Possessive quantifiers (Python 3.11) keep every match linear in the text's length.
_UNSIGNED = r"(?:\d++(?:\.\d*+)?|\.\d++)(?:[EeDd][+-]?\d++)?"
NUMBER = re.compile(rf"[+-]?{_UNSIGNED}", re.ASCII)
# Fortran fields that fill their width touch; only a sign can tell where the next begins.
RUN = re.compile(rf"[+-]?{_UNSIGNED}(?:[+-]{_UNSIGNED})*+", re.ASCII)
_NOT_FINITE = re.compile(r"[+-]?(?:nan|inf|infinity)(?:\(\w*\))?", re.ASCII | re.IGNORECASE)
STATED_DT = re.compile(rf"\bDT\s*[=:]\s*({NUMBER.pattern})", re.ASCII | re.IGNORECASE)
# Of blocks that hold nothing but numbers, numpy makes an array at once.
_PLAIN = re.compile(r"[\d.eEdD+\-,\s]*+", re.ASCII)
_FORTRAN = str.maketrans({",": " ", "D": "E", "d": "e"})

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Content:
    """What a record file says: accelerations, step (s), text with their unit, title, and the unit if that has none."""

    # `name` is the record's label where the file name without its ending tells too little

    values: Array
    dt: float
    header: str
    title: str
    default_units: str | None = None
    name: str | None = None


@dataclass(frozen=True)
class Reader:
    """One format of record files; `READER` of each module of `pounding_sweep.records.formats` is one."""

    name: str  # what the format is called, for the documentation
    needs: str  # what a file of it must have, for the documentation
    suffixes: tuple[str, ...]  # endings that files of it have in folders, in lower case
    told: Callable[[list[str]], bool] | None  # whether the first lines are of it; None: takes what no other does
    parse: Callable[[RecordText, float | None], Content]  # a file, and the caller's time step (s) if there is one


@dataclass(frozen=True)
class RecordText:
    """A record file as text, whatever its encoding and line ends."""

    file: Path
    text: str

    def fail(self, message: str) -> NoReturn:
        """Raise `RecordError` of this file."""
        fail(self.file, message)

    def check_points(self, points: int) -> None:
        """Refuse more points than a record has."""
        if points > MOST_POINTS:
            self.fail(f"has more than {MOST_POINTS:,} points; is it a record? If so, cut it")

    def blocks(self, line: int = 1) -> Iterator[tuple[int, str]]:
        """Cut the text from that line on into blocks of whole lines, each with the number of its first."""
        start = 0
        for _ in range(line - 1):
            start = self.text.find("\n", start) + 1 or len(self.text)
        while start < len(self.text):
            end = self.text.find("\n", start + BLOCK)
            end = len(self.text) if end < 0 else end
            block = self.text[start:end] + "\n"
            if len(block) > BLOCK + LONGEST_LINE:
                last = line + block.count("\n") - 1
                self.fail(f"line {last} has more than {LONGEST_LINE} characters; write the values in lines")
            yield line, block
            line += block.count("\n")
            start = end + 1

    def numbers(self, line: int) -> Array:
        """Read all numbers from that line on."""
        parts, count = [np.empty(0)], 0
        for first, block in self.blocks(line):
            part = plain_words(block)
            if part is None:
                rows = enumerate(block.split("\n"), first)
                part = np.array([value for row, text in rows for value in self._numbers_of(row, text)])
            parts.append(part)
            count += len(part)
            self.check_points(count)
        return np.concatenate(parts)

    def _numbers_of(self, line: int, text: str) -> list[float]:
        found = words(text)
        if isinstance(found, str):
            self.fail(f"line {line}: {in_quotes(found)} is not a number, nor numbers that touch but can be told apart")
        return found

    def agreed_dt(self, stated: str | None, given: float | None) -> float:
        """Choose between the time step of the header, as it is written, and the caller's, in s."""
        if stated is None:
            return self.fail("has no time step; give dt= in seconds") if given is None else given
        step = number(to_float(stated), f"{self.file}: DT of its header (s)", positive=True)
        if given is not None and abs(given - step) > 1e-6 * step:
            self.fail(f"its time step is {step:g} s, dt={given:g} was given; leave dt out")
        return step


def fail(path: Path, text: str) -> NoReturn:
    """Raise `RecordError` of a file."""
    msg = f"{printable(str(path))}: {text}"
    raise RecordError(msg)


def in_quotes(word: str) -> str:
    """Return a word of a file for a message, cut where it is long."""
    return repr(word if len(word) <= 24 else word[:24] + "...")


def to_float(text: str) -> float:
    """Convert one matched number, with Fortran's D exponents too."""
    return float(text.translate(_FORTRAN))


def words(line: str) -> list[float] | str:
    """Split a line into numbers, touching ones too; return the first word that isn't one."""
    values: list[float] = []
    for word in line.replace(",", " ").split():
        if len(word) <= LONGEST_WORD and RUN.fullmatch(word):
            values += map(to_float, NUMBER.findall(word))
        elif _NOT_FINITE.fullmatch(word):
            values.append(float("nan" if "nan" in word.lower() else "inf"))
        else:
            return word
    return values


def plain_words(block: str) -> Array | None:
    """Read a block that has nothing but numbers apart from each other, as `float` does; None for any other."""
    if not _PLAIN.fullmatch(block):
        return None
    try:
        return np.array(block.translate(_FORTRAN).split(), dtype=np.float64)
    except ValueError:
        return None


def load_text(file: Path, record: str) -> RecordText:
    """Read a regular file of bounded size as text, whatever its encoding; `record` is the name it is read for."""
    try:
        status = file.stat()
    except FileNotFoundError:
        about = "check the path; by name alone a sweep finds records in the folders of POUNDING_SWEEP_RECORDS"
        msg = f"{file}: no such file; {about}"
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
    wide = raw.startswith((b"\xff\xfe", b"\xfe\xff"))
    try:
        text = raw.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError:
        if wide:
            fail(file, "has a UTF-16 mark but is no UTF-16 text; save it as plain text")
        text = raw.decode("latin-1")
    text = text.replace("\r\n", "\n").replace("\r", "\n").rstrip("\x1a\n\t ")  # DOS files may end in ^Z
    if not text.strip():
        fail(file, "is empty; a record needs at least 1 point")
    if re.search(r"[\x00-\x08\x0b\x0e-\x1f\x7f]", text):
        fail(file, "is binary, not text; give a PEER AT2, CSV or text file")
    return RecordText(file, text)
