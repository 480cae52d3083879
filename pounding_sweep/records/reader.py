"""What all readers of record files share: safe text, numbers, bounds, messages; and which unit and step a file has."""

from __future__ import annotations

import re
import stat
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np
import numpy.typing as npt

from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.base.errors import MissingRecordError, RecordError, unknown
from pounding_sweep.base.files import near_file
from pounding_sweep.base.text import printable

MAX_FILE_BYTES = 64 * 2**20
"""Larger files are refused: the longest strong-motion records have a few MiB."""
MOST_POINTS = 10_000_000
"""Longer records are refused: they are a day of motion at 100 points per second."""

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
        if RUN.fullmatch(word):
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


UNITS = {"g": STANDARD_GRAVITY, "m/s2": 1.0, "cm/s2": 0.01, "mm/s2": 1e-3}
UNITS |= {"mg": 1e-3 * STANDARD_GRAVITY, "%g": 0.01 * STANDARD_GRAVITY}
"""Acceleration units of files, each with its size in m/s2."""

_QUANTITIES = {
    **dict.fromkeys(UNITS, "acceleration"),
    **dict.fromkeys(("m/s", "cm/s", "mm/s", "in/s", "ft/s", "ms-1", "cms-1", "mms-1", "mps"), "velocity"),
    **dict.fromkeys(("m", "cm", "mm", "in", "inch", "ft"), "displacement"),
}
_ALIASES = {
    **{"gal": "cm/s2", "gals": "cm/s2", "g's": "g", "ms-2": "m/s2", "cms-2": "cm/s2", "mms-2": "mm/s2"},
    **{"ms2": "m/s2", "cms2": "cm/s2", "mms2": "mm/s2", "mps2": "m/s2", "milli-g": "mg", "percentg": "%g"},
}
_SPELLING = (
    *(("²", "2"), ("⁻", "-"), ("−", "-"), ("**", ""), ("^", ""), ("·", ""), ("*", "")),
    *(("second", "s"), ("sec", "s"), ("/s/s", "/s2")),
)
_TIMES = ("s", "ms", "min", "h", "hz")

_ACC = r"(?<![^\W_])(?:acc(?:n|l|[eé]l(?:[eé]ration)?s?)?|acel(?:eraci[oó]n)?|accelerazione|beschl(?:eunigung)?|ivme)"
_BRACKET = r"[(\[]\s*([^()\[\]\n]{1,24}?)\s*[)\]]"
#: What stands behind the name of an acceleration: perhaps its component, then the unit and nothing else.
_TAIL = re.compile(
    rf"{_ACC}(?![^\W_])[\s_.,:;/=-]*(?:(?:[xyzhvneu123]|ns|ew|ud|n-s|e-w|u-d|h[12])[\s_.,:;/-]+)?(?:in\s+)?([^\s:=].{{0,15}})$",
    re.IGNORECASE,
)
_BEHIND_ACC = re.compile(rf"{_ACC}\.?(?:[ \t]+[^\W\d_]+){{0,3}}?[ \t]*{_BRACKET}", re.IGNORECASE)
_UNITS = re.compile(
    r"(?:\bin\s+)?\b(?:units?|unidad(?:es)?|einheit(?:en)?|unit[ée]s?)\b\s*"
    r"((?:[:=]|(?:of|in|is|are|en)\b\s*[:=]?)?\s*[(\[]?)([^()\[\]\n]{1,40})",
    re.IGNORECASE,
)
_IN = re.compile(r"\b(?:in|en)\s+([^\s,;()\[\]][^,;()\[\]\n]{0,23})", re.IGNORECASE)
_VALUES = re.compile(rf"{_ACC}|(?:values?|data|amplitudes?|motions?|samples|ordinates|series)\s*$", re.IGNORECASE)
#: Lines that speak of other numbers than the values as they are: peaks, and units that were or will be.
_ASIDE = re.compile(
    r"convert|conversion|umgerechnet|multipl|divide|\bfrom\b.*\bto\b|\bwas\b|original|->|=>|→"
    r"|(?:[x×*/]|\btimes|\bby)\s*(?:9[.,]8|98[01]|386|32[.,][12])|\b(?:peak|max|min|pga|pgv|amax|rms|range|sensitiv|full.?scale|sensor|gain|resol|trigger)",
    re.IGNORECASE,
)
_NAMED = re.compile(
    r"(?<![^\W_])(?:(v_?g(?![^\W_])|vel(?![^\W_])|veloc|geschw|vitesse|velocidad)"
    r"|[ud]_?g(?![^\W_])|displ?(?![^\W_])|displac|verschieb|d[ée]plac|desplaz)",
    re.IGNORECASE,
)
_SERIES = re.compile(
    r"(?:^\W*(?:(?:ground|base|input|corrected|filtered|relative|absolute|horizontal|vertical)\s+)*"
    r"(veloc|displac)\w*\s*(?:$|[,;([]|at\b|of\b|record))|(veloc|displac)\w*\s+(?:time|data|histor|in\b)",
    re.IGNORECASE,
)


def _plain(text: str) -> str:
    plain = "".join(text.lower().split()).strip(".,;:")
    for spelled, meant in _SPELLING:
        plain = plain.replace(spelled, meant)
    return _ALIASES.get(plain, plain)


def _quantity(text: str) -> str | None:
    """Return the quantity, acceleration, velocity or displacement, that has the unit which `text` spells."""
    return _QUANTITIES.get(_plain(text))


def match_unit(text: str) -> str | None:
    """Find the unit of `UNITS` that `text` spells, or None."""
    return plain if (plain := _plain(text)) in UNITS else None


def require_unit(text: object) -> str:
    """Find the unit of `UNITS` that `text` spells, or raise `RecordError`."""
    unit = match_unit(text) if isinstance(text, str) else None
    if unit is None:
        raise RecordError(unknown("acceleration unit", text, [*UNITS, "gal", "m/s^2", "m/s**2", "cm/s^2", "cm/s/s"]))
    return unit


def _leading_unit(text: str) -> str:
    """Return the first words of a text that are a unit, with nothing but punctuation behind them; else the text."""
    words = text.split()
    for count in range(len(words), 0, -1):
        phrase = " ".join(words[:count])
        if _quantity(phrase) and (count == len(words) or phrase[-1] in ".,;:"):
            return phrase
    return text.strip()


def _of_heading(line: int, heading: str) -> list[Stated]:
    """Return the unit at a column's heading: in brackets at its end, else behind "in" or the word acceleration."""
    where = f"{heading!r}, line {line}"
    if _ASIDE.search(heading):
        return []
    bracket = re.search(_BRACKET + r"\W*$", heading)
    if bracket and (_quantity(bracket[1]) or "/" in bracket[1]):
        return [Stated(bracket[1], where)]
    plain = heading[: bracket.start()] if bracket else heading
    tail = _TAIL.search(plain.strip())
    text = tail[1] if tail else plain
    for spelled in (text, text.replace("_", "/"), text.replace("_", "")):
        if match_unit(spelled) and (tail or _plain(spelled) != "g"):
            return [Stated(spelled, where)]
    return []


def _of_remark(line: int, text: str) -> list[Stated]:
    """Return the units that a line of a header states: after "units", after "in", in brackets behind "acceleration"."""
    if _ASIDE.search(text):
        return []
    found: list[tuple[str, str]] = []
    for match in _UNITS.finditer(text):
        pieces = [_leading_unit(piece) for piece in re.split(r"[,;]", match[2])]
        units = [piece for piece in pieces if _quantity(piece)]
        units = units or [piece for piece in pieces[:1] if match[1] and piece and _plain(piece) not in _TIMES]
        found += [(unit, match[0][: match[0].index(unit) + len(unit)]) for unit in units]
    if not found:
        found += [(match[1], match[0]) for match in _BEHIND_ACC.finditer(text)]
        for match in _IN.finditer(text):
            unit = _leading_unit(match[1])
            if match_unit(unit) and (_plain(unit) not in ("g", "mg") or _VALUES.search(text[: match.start()])):
                found.append((unit, match[0][: match[0].index(unit) + len(unit)]))
        for piece in re.split(r"[,;|\t]", text):
            found += [(unit.text, piece) for unit in _of_heading(line, piece.strip()) if _TAIL.search(piece.strip())]
    return [Stated(unit, f"{' '.join(phrase.split())!r}, line {line}") for unit, phrase in found]


def stated_units(lines: Iterable[tuple[int, str]], heading: tuple[int, str] | None = None) -> list[Stated]:
    """Collect the units that the lines of a header state for the column with a heading."""
    found = _of_heading(*heading) if heading else []
    return list(dict.fromkeys(found + [unit for line, text in lines for unit in _of_remark(line, text)]))


def other_quantity(lines: Iterable[tuple[int, str]], heading: tuple[int, str] | None = None) -> tuple[str, str] | None:
    """Tell velocity or displacement by the column's heading, or else by a title, with the text that says so."""
    if heading and not re.search(_ACC, heading[1], re.IGNORECASE) and (match := _NAMED.search(heading[1])):
        return "velocity" if match[1] else "displacement", f"{heading[1]!r}, line {heading[0]}"
    for line, text in lines:
        match = _SERIES.search(text)
        if match and not re.search(r"acc", text, re.IGNORECASE):
            kind = "velocity" if (match[1] or match[2]).lower() == "veloc" else "displacement"
            return kind, f"{text.strip(' #%!/')[:60]!r}, line {line}"
    return None


def choose_unit(
    stated: Sequence[Stated], default: tuple[str, str] | None, wanted: str | None, shown: str
) -> tuple[str, str]:
    """Choose the unit of a file, and say where it is from.

    `default` is the unit of a format that states none, and why; `wanted` what the caller gave, which always wins;
    `shown` what the header has in place of a unit. Raises `RecordError` without the name of the file.
    """
    units: dict[str, Stated] = {}
    unreadable: dict[str, Stated] = {}
    for item in stated:
        if unit := match_unit(item.text):
            units.setdefault(unit, item)
        elif not _quantity(item.text):
            unreadable.setdefault(item.text, item)
    for item in stated:
        if not units and (quantity := _quantity(item.text)):
            raise RecordError(not_acceleration(quantity, item.where))
    if wanted:
        over = [item.where for unit, item in (units | unreadable).items() if unit != wanted]
        return wanted, f"given{', in place of ' + ' and '.join(over) if over else ''}"
    remedy = f"give units= one of {', '.join(map(repr, UNITS))}"
    if len(units) > 1 or (units and unreadable):
        both = " and ".join(f"{item.text!r} ({item.where})" for item in (*units.values(), *unreadable.values()))
        raise RecordError(f"states several units: {both}; {remedy}")
    if units:
        ((unit, item),) = units.items()
        return unit, item.where
    if default and not unreadable:
        return default
    header = ", ".join(f"{item.text!r} ({item.where})" for item in unreadable.values()) or shown
    raise RecordError(f"its units are not known{f'; its header says {header}' if header else ''}; {remedy}")


_SECONDS = {"s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "segundos": 1.0, "": 1.0}
_SECONDS |= dict.fromkeys(("ms", "msec", "msecs", "millisec", "milliseconds", "millisecond"), 1e-3)
_SECONDS |= dict.fromkeys(("us", "µs", "usec", "microseconds"), 1e-6) | {"min": 60.0}
_N, _IN_BRACKETS = NUMBER.pattern, r"[(\[]\s*(\w+)\s*[)\]]"
_STEP = re.compile(
    r"(?<![^\W_])(?:d_?t|delta[ _]?t|Δt|time[ _-]?(?:step|interval|increment)|sampl\w*[ _-]?(?:interval|period|step)|"
    rf"intervalo de muestreo|zeitschritt|pas de temps)(?:[ _]s)?\s*(?:{_IN_BRACKETS})?\s*(?:[=:]|\bof\b|\bis\b)?\s*"
    rf"({_N})[ \t]*([^\W\d_]*)",
    re.IGNORECASE,
)
_RATE = re.compile(
    r"(?<![^\W_])(?:(?:sampl\w*|data)[ _-]?(?:rate|freq\w*)|fs(?=\s*[=:])|sampled at|(?:frecuencia|tasa|vel\w*\.?) de "
    r"muestreo|abtast\w*)\s*(?:[(\[]\s*(?:hz|sps|samples/s\w*|muestras/s\w*)\s*[)\]])?\s*(?:[=:]|\bof\b|\bis\b)?\s*"
    rf"({_N})(?:\s*(?:hz|sps))?|({_N})\s*(?:(?:muestras|samples|points|puntos)\s*(?:/|por|per)\s*s|sps\b)",
    re.IGNORECASE,
)
#: Lines that tell how a motion came about, in which a step may be that of another motion.
_STORY = re.compile(
    r"\bfrom\b|resampl|interpol|decimat|original|\bwas\b|\bwere\b|\bold\b|\bnow\b|before|after|->|→", re.I
)
#: Steps that differ by less are one.
_SAME = 1e-6


def stated_steps(lines: Iterable[tuple[int, str]], firm: bool = False) -> list[StatedStep]:
    """Collect the steps, and the inverse of sampling rates, that lines of a header state."""
    found = []
    for line, text in lines:
        for match in _STEP.finditer(text) if firm or not _STORY.search(text) else ():
            unit = (match[1] or match[3]).lower()
            if match[1] is None or unit in _SECONDS:
                found.append(
                    StatedStep(to_float(match[2]) * _SECONDS.get(unit, 1.0), f"{match[0].strip()!r}, line {line}", firm)
                )
        for match in _RATE.finditer(text) if firm or not _STORY.search(text) else ():
            rate = to_float(match[1] or match[2])
            found.append(StatedStep(1.0 / rate if rate else float("inf"), f"{match[0].strip()!r}, line {line}", firm))
    return found


def field_step(source: RecordText, fields: Mapping[str, Stated], key: str, rate: bool = False) -> list[StatedStep]:
    """Return the step (s) that the header of a format states, perhaps as a rate (1/s)."""
    value = source.number(fields, key)
    return [StatedStep((1.0 / value if value else -1.0) if rate else value, fields[key].where, firm=True)]


def choose_step(
    source: RecordText, stated: Sequence[StatedStep], lines: Iterable[tuple[int, str]] = ()
) -> tuple[float, str]:
    """Choose the time step (s) of a file without times, and say where it is from; a failure shows `lines`."""
    for step in stated:
        if not 0.0 < step.value < float("inf"):
            source.fail(f"its time step is {step.value:g} s ({step.where}); it must be positive and finite")
    different = list({f"{step.value:.6g}": step for step in reversed(stated)}.values())
    if source.dt is not None:
        wrong = [step for step in different if abs(step.value - source.dt) > _SAME * step.value]
        for step in wrong:
            if step.firm:
                text = f"its time step is {step.value:g} s, dt={source.dt:g} was given; leave dt out ({step.where})"
                source.fail(text)
        return source.dt, f"given{', in place of ' + ' and '.join(step.where for step in wrong) if wrong else ''}"
    if len(different) > 1:
        both = " and ".join(f"{step.value:g} s ({step.where})" for step in different)
        source.fail(f"states several time steps: {both}; give dt= in seconds")
    if not different:
        told = [f"{text.strip(' #%!/')[:60]!r}, line {line}" for line, text in lines if _STEP.search(text)]
        source.fail(f"has no time step{' of its own (' + told[0] + ')' if told else ''}; give dt= in seconds")
    return different[0].value, different[0].where


def _places(words: Iterable[str], size: int) -> Array:
    """Return the size of one unit in the last printed place in use, e.g. 0.01 for "1.25", of each number."""

    def place(word: str) -> float:
        mantissa, _, exponent = word.lower().replace("d", "e").partition("e")
        return 10.0 ** (max(-400, min(300, int(exponent[:6] or 0))) - len(mantissa.partition(".")[2]))

    # Writers drop trailing zeros, and "%g" coarsens as time grows: the finest place still to come is the one in use.
    sizes = np.fromiter(map(place, words), np.float64, size)
    return np.minimum.accumulate(sizes[::-1])[::-1]


@np.errstate(all="ignore")
def step_of_times(
    source: RecordText,
    time: Array,
    printed: Callable[[], Iterator[tuple[int, str]]],
    stated: Sequence[StatedStep],
    what: str,
) -> tuple[float, str]:
    """Find the constant step (s) that explains the printed times, each right to half a unit in its last place.

    `printed` goes through lines and printed times; `what` names their column. A `dt` of the caller wins where it
    explains the times too.
    """

    def row(wrong: npt.NDArray[np.bool_], shift: int = 1) -> tuple[int, str]:
        return next(islice(printed(), int(wrong.argmax()) + shift, None))

    remedy = "a record needs a constant time step; resample it"
    bad = ~np.isfinite(time)
    if bad.any():
        source.fail(f"line {row(bad, 0)[0]}: its time is not a finite number")
    if time.size == 1:
        return choose_step(source, stated)
    passed, index, steps = time[1:] - time[0], np.arange(1, time.size), np.diff(time)
    slack = (0.51 if time[0] == 0 else 1.02) * _places((word for _, word in printed()), time.size)[1:]
    slack += 2e-7 * np.maximum(np.maximum(np.abs(time[1:]), abs(time[0])), passed)  # for float32 times
    if source.dt is not None and (np.abs(passed - index * source.dt) <= slack + 1e-6 * source.dt * index).all():
        return source.dt, "given, and explains the times"
    if (steps <= 0).any():
        remedy = (
            f"{remedy}; or give dt= if its times are rounded, layout='rows' if it has none"
            if source.dt is None
            else remedy
        )
        source.fail(f"line {row(steps <= 0)[0]}: its time does not increase; {remedy}")
    slack = np.minimum(slack, 0.15 * np.median(steps))
    low = np.maximum.accumulate((passed - slack) / index)
    high = np.minimum.accumulate((passed + slack) / index)
    middle = float(low[-1] + high[-1]) / 2
    if not 1e-9 < 2 * middle < 1e9:
        source.fail(f"its time step of about {middle:g} s makes no sense; times must be in seconds")
    if low[-1] > high[-1]:
        line, text = row(low > high)
        source.fail(f"line {line}: time {text} s does not continue the steps before it; {remedy}")
    if source.dt is not None:
        source.fail(f"its time step is {middle:g} s, dt={source.dt:g} was given; leave dt out")
    rounded = [float(f"{middle:.{digits}e}") for digits in range(6)]
    candidates = (*rounded[:3], 1 / max(1, round(1 / middle)), *rounded[3:])
    step = next((value for value in candidates if low[-1] <= value <= high[-1]), middle)
    for other in stated:
        if abs(other.value - step) > 1e-3 * step and not low[-1] <= other.value <= high[-1]:
            source.fail(
                f"states several time steps: {step:g} s ({what}) and {other.value:g} s ({other.where}); give dt="
            )
    return step, what
