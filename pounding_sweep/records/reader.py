"""What all readers of record files share: safe text, numbers, bounds, messages."""

from __future__ import annotations

import re
import stat
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np
import numpy.typing as npt

from pounding_sweep.base.errors import MissingRecordError, RecordError
from pounding_sweep.base.files import near_file
from pounding_sweep.base.text import printable

MAX_FILE_BYTES = 64 * 2**20
"""Larger files are refused: the longest strong-motion records have a few MiB."""
MOST_POINTS = 10_000_000
"""Longer records are refused: they are a day of motion at 100 points per second."""

#: Longer words are no numbers.
LONGEST_WORD = 4096
#: Lines by which a format is told.
HEAD = 100
#: How the values of a component are laid out.
LAYOUTS = ("columns", "rows")

# Possessive quantifiers (Python 3.11) keep every match linear in the text's length.
_UNSIGNED = r"(?:\d++(?:\.\d*+)?|\.\d++)(?:[EeDd][+-]?\d++)?"
NUMBER = re.compile(rf"[+-]?{_UNSIGNED}", re.ASCII)
# Fortran fields that fill their width touch; only a sign can tell where the next begins.
RUN = re.compile(rf"[+-]?{_UNSIGNED}(?:[+-]{_UNSIGNED})*+", re.ASCII)
_NOT_FINITE = re.compile(r"[+-]?(?:nan|inf|infinity)(?:\(\w*\))?", re.ASCII | re.IGNORECASE)
# Of blocks that hold nothing but numbers, numpy makes an array at once.
_PLAIN = re.compile(r"[\d.eEdD+\-,\s]*+", re.ASCII)
_FORTRAN = str.maketrans({",": " ", "D": "E", "d": "e"})

_TO_COLUMNS = "which is not read; write time and acceleration in columns"
#: Files that are recognised and not read, and what to do.
_NOT_READ = tuple(
    (re.compile(pattern, re.DOTALL | re.IGNORECASE), what)
    for pattern, what in (
        (rb"PK\x03\x04.{0,4000}(?:xl/|\[Content_Types)", "an Excel workbook; save its sheet as CSV"),
        (rb"\xd0\xcf\x11\xe0", "an old Excel workbook; save its sheet as CSV"),
        (rb"PK\x03\x04|\x1f\x8b|BZh|\xfd7zXZ|7z\xbc\xaf|Rar!", "compressed; unpack it first"),
        (
            rb"\s*<(?:!doctype|html|head|\?xml)",
            "a page of HTML, perhaps a login page; log in and download the file again",
        ),
        (rb"version https://git-lfs", "a git-lfs pointer in place of the file; get the file with: git lfs pull"),
        (rb".{304}(?:[\6\7]\0\0\0|\0\0\0[\6\7])", f"a SAC binary, {_TO_COLUMNS}, as ObsPy does"),
        (rb"\d{6}[DRQM][ \0]", f"miniSEED, {_TO_COLUMNS}, as ObsPy does"),
        (rb"%PDF|\x89HDF|MATLAB 5", f"a PDF, HDF5 or MATLAB file, {_TO_COLUMNS}"),
        (rb"[^\0]{0,3000}UNIVERSIDAD DE CHILE - RENADIC", f"a file of RENADIC, {_TO_COLUMNS}"),
        (rb"\s*\* ?VOL|[^\0]{0,2000}\bBHRC\b", f"a file of BHRC (Iran), {_TO_COLUMNS}"),
    )
)

Array = npt.NDArray[np.float64]


class Stated(NamedTuple):
    """What a file states: the text, or a number, and where it stands."""

    text: str
    where: str


class StatedStep(NamedTuple):
    """A time step (s) that a file states, and where; `firm` where a `dt` of the caller must agree with it."""

    value: float
    where: str
    firm: bool = False


@dataclass(frozen=True)
class Content:
    """What a file says: accelerations in its unit, step (s) and where it is from, and the units that it states."""

    values: Array
    step: tuple[float, str]
    units: Sequence[Stated]
    title: str
    default_unit: tuple[str, str] | None = None  # where the file states none: the unit of its format, and why
    header: str = ""  # what messages show of a file without a unit
    column: str | None = None  # the component that was chosen among several
    name: str | None = None  # the record's label where the file name without its ending tells too little


@dataclass(frozen=True)
class RecordText:
    """The lines of a record file, whatever its encoding and line ends, and what the caller says of it."""

    file: Path
    lines: list[str]
    dt: float | None = None
    column: str | int | None = None
    layout: str | None = None

    def fail(self, message: str) -> NoReturn:
        """Raise `RecordError` of this file."""
        fail(self.file, message)

    def check_points(self, points: float) -> None:
        """Refuse more points than a record has."""
        if points > MOST_POINTS:
            self.fail(f"has more than {MOST_POINTS:,} points; is it a record? If so, cut it")

    def numbers(self, line: int, points: int | None = None) -> Array:
        """Read all numbers from that line on; if `points` are known, what follows them may be a footer of words."""
        self.check_points(points or 0)
        plain = plain_words("\n".join(self.lines[line - 1 :]))
        if plain is not None:
            self.check_points(plain.size)
            return plain
        values: list[float] = []
        for row, text in enumerate(self.lines[line - 1 :], line):
            found = words(text)
            if isinstance(found, str):
                if points is not None and len(values) >= points:
                    break
                self.not_a_number(row, found, ", nor numbers that touch but can be told apart")
            values += found
        self.check_points(len(values))
        return np.array(values)

    def exactly(self, line: int, points: int, where: str) -> Array:
        """Read as many numbers from that line on as the header states; a footer of words may follow."""
        values = self.numbers(line, points)
        if len(values) != points or points == 0:
            cause = "it was cut short" if len(values) < points else "the header or the file is damaged"
            said = f"its header says {points} points, it holds {len(values)}"
            self.fail(f"{said}: {cause}; get the file again, or mend {where}")
        return values

    def not_a_number(self, line: int, word: str, more: str = "") -> NoReturn:
        """Say that a word is no number, and name a character that only looks like part of one."""
        odd = next((sign for sign in word if ord(sign) > 127), None)
        if odd:
            more = f": it has the character U+{ord(odd):04X} ({unicodedata.name(odd, 'unnamed')}); write - . or digits"
        self.fail(f"line {line}: {in_quotes(word)} is not a number{more}")

    def choose(self, headings: Sequence[str], numbers: Sequence[int] = ()) -> int:
        """Return the index of the component that `column` names, by heading or number; numbers count from 1."""
        numbers = numbers or range(1, len(headings) + 1)
        listed = ", ".join(f"{heading!r} ({number})" for number, heading in zip(numbers, headings, strict=True))
        if self.column is None:
            if len(headings) > 1:
                self.fail(f"has {len(headings)} components: {listed}; give column= a heading or a number")
            return 0
        wanted = str(self.column).strip().lower()
        plain = [re.sub(r"\s*[(\[].*", "", heading) for heading in headings]
        for names in (headings, plain, map(str, numbers)):
            matches = [index for index, name in enumerate(names) if name.strip().lower() == wanted]
            if len(matches) == 1:
                return matches[0]
        return self.fail(f"has no column {self.column!r}; it has {listed}")

    def number(self, fields: Mapping[str, Stated], key: str) -> float:
        """Return the number that a header states."""
        found = words(fields[key].text) if key in fields else ""
        if isinstance(found, str) or len(found) != 1:
            said = in_quotes(fields[key].text) if key in fields else "nothing"
            self.fail(f"its header says {said} as {key!r}; get the file again")
        return found[0]

    def check_quantity(self, fields: Mapping[str, Stated], key: str) -> None:
        """Refuse a file whose header states another quantity than acceleration."""
        if key in fields and fields[key].text.lower() != "acceleration":
            self.fail(not_acceleration(fields[key].text.lower(), fields[key].where))


def fields_of(lines: Iterable[tuple[int, str]]) -> dict[str, Stated]:
    """Return the lines "key: value" of a header by their key."""
    fields: dict[str, Stated] = {}
    for line, text in lines:
        key, colon, value = (part.strip() for part in text.lstrip("#").partition(":"))
        if colon:
            fields.setdefault(key, Stated(value, f"{f'{key}: {value}'!r}, line {line}"))
    return fields


def not_acceleration(quantity: str, where: str) -> str:
    """Say that a file holds another quantity."""
    return f"holds {quantity}, not acceleration ({where}); take the file of the acceleration"


def fail(path: Path, text: str) -> NoReturn:
    """Raise `RecordError` of a file."""
    raise RecordError(f"{printable(str(path))}: {text}")


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
        raise MissingRecordError(f"{file}: no such file; {near_file(file)}{about}", record) from None
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
    if other := next((what for pattern, what in _NOT_READ if pattern.match(raw)), None):
        fail(file, f"is {other}")
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
    return RecordText(file, text.split("\n"))
