"""The text of a record file: its lines and numbers, and the units, steps and quantities that its header states."""

from __future__ import annotations

import re
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.base.errors import MissingRecordError, RecordError
from pounding_sweep.base.files import near_file, read_data

MAX_FILE_BYTES = 64 * 2**20
"""Larger files are refused: the longest strong-motion records have a few MiB."""
MOST_POINTS = 10_000_000
"""Longer records are refused: they are a day of motion at 100 points per second."""
STEP_RANGE = 1e-4, 0.1
"""Steps (s) that a file may state; a caller's `dt` may be any."""

# Possessive quantifiers (Python 3.11) keep every match linear in the text's length.
_UNSIGNED = r"(?:\d++(?:\.\d*+)?|\.\d++)(?:[EeDd][+-]?\d++)?"
NUMBER = re.compile(rf"[+-]?{_UNSIGNED}", re.ASCII)
# Fortran fields that fill their width touch; only a sign can tell where the next begins.
RUN = re.compile(rf"[+-]?{_UNSIGNED}(?:[+-]{_UNSIGNED})*+", re.ASCII)
_NOT_FINITE = re.compile(r"[+-]?(?:nan|inf|infinity)(?:\(\w*\))?", re.ASCII | re.IGNORECASE)
# Of blocks that hold nothing but numbers, numpy makes an array at once.
_PLAIN = re.compile(r"[\d.eEdD+\-,\s]*+", re.ASCII)
_FORTRAN = str.maketrans({",": " ", "D": "E", "d": "e"})
_DASHES = str.maketrans(dict.fromkeys("‐‑‒–—−", "-"))

Array = npt.NDArray[np.float64]
#: Lines of a file, each with its number from 1.
Lines = list[tuple[int, str]]
#: A time step (s) and where it is from.
Step = tuple[float, str]


class Stated(NamedTuple):
    """A unit as a file spells it, and where it stands."""

    text: str
    where: str


class Peak(NamedTuple):
    """The largest acceleration that a header states: value, unit ("" for that of the values), last place, and where."""

    value: float
    unit: str
    last_place: float
    where: str


@dataclass(frozen=True)
class Content:
    """What a file says: accelerations in its unit, the time step, and the units that it states."""

    values: Array
    step: Step
    units: Sequence[Stated]
    title: str
    default_unit: tuple[str, str] | None = None  # where the file states none: the unit of its format, and why
    header: str = ""  # what messages show of a file without a unit
    column: str | None = None  # the component that was chosen among several
    peak: Peak | None = None


@dataclass(frozen=True)
class RecordText:
    """The lines of a record file, whatever its encoding and line ends, and what the caller says of it."""

    file: Path
    lines: list[str]
    dt: float | None = None
    column: str | int | None = None
    layout: str | None = None
    first_column: int = 1  # the number of the first column, 2 behind one of dates
    firm: bool = True  # whether a `dt` of the caller must agree with the steps that the header states

    def find(self, pattern: str, first: int = 1, last: int | None = None) -> list[tuple[re.Match[str], int]]:
        """Return where lines from `first` on, to before `last`, hold a pattern, in any case."""
        lines = enumerate(self.lines[first - 1 : None if last is None else last - 1], first)
        return [(match, line) for line, text in lines if (match := re.search(pattern, text, re.IGNORECASE))]

    def numbers(self, first: int, points: int | None = None, where: str = "") -> Array:
        """Read all numbers from a line on: as many `points` as the header states at `where`, then perhaps a footer."""
        check_points(points or 0)
        values = plain_words("\n".join(self.lines[first - 1 :]))
        if values is None:
            numbers: list[float] = []
            for line, text in enumerate(self.lines[first - 1 :], first):
                if (part := floats(text)) is None:
                    if points is not None and len(numbers) >= points:
                        break
                    raise not_a_number(line, text)
                numbers += part
            values = np.array(numbers)
        check_points(values.size)
        if points is not None:
            check_count(points, values.size, where)
        return values

    def choose(self, headings: Mapping[int, str]) -> tuple[int, str | None]:
        """Return the number of the component that `column` names, by heading or number; its heading among several."""
        listed = ", ".join(f"{heading!r} ({number})" for number, heading in headings.items())
        wanted, numbers = str(self.column).strip().lower(), list(headings)
        if self.column is not None:
            plain = {number: re.sub(r"\s*[(\[].*", "", heading).lower() for number, heading in headings.items()}
            numbers = [n for n, heading in headings.items() if wanted in (heading.lower(), plain[n])]
            if not numbers or isinstance(self.column, int):  # headings may be numbers
                numbers = [n for n in headings if wanted == str(n)]
        elif len(headings) > 1:
            raise RecordError(f"has {len(headings)} components: {listed}; give column= a heading or a number")
        if len(numbers) != 1:
            raise RecordError(f"has no column {self.column!r}; it has {listed}")
        return numbers[0], headings[numbers[0]] if len(headings) > 1 else None


def check_points(points: float) -> None:
    """Refuse more points than a record has."""
    if points > MOST_POINTS:
        raise RecordError(f"has more than {MOST_POINTS:,} points; is it a record? If so, cut it")


def check_count(stated: int, points: int, where: str) -> None:
    """Refuse another number of points than the header states."""
    if stated != points or stated == 0:
        cause = "it was cut short" if points < stated else "the header or the file is damaged"
        raise RecordError(
            f"its header says {stated} points, it holds {points}: {cause}; get the file again, or mend {where}"
        )


def not_a_number(line: int, text: str) -> RecordError:
    """Say of a line which word of it is no number."""
    word = next((word for word in re.split(r"[\s,;]+", text) if floats(word) is None), text)
    return RecordError(f"line {line}: {word[:24]!r} is not a number")


def not_acceleration(quantity: str, where: str) -> RecordError:
    """Say that a file holds another quantity."""
    return RecordError(f"holds {quantity.lower()}, not acceleration ({where}); take the file of the acceleration")


def to_float(text: str) -> float:
    """Convert one matched number, with Fortran's D exponents too."""
    return float(text.translate(_FORTRAN))


def floats(text: str) -> list[float] | None:
    """Split a text into numbers, touching ones too; None if any word of it is no number."""
    values: list[float] = []
    for word in text.replace(",", " ").split():
        if RUN.fullmatch(word):
            values += map(to_float, NUMBER.findall(word))
        elif _NOT_FINITE.fullmatch(word):
            values.append(float("nan" if "nan" in word.lower() else "inf"))
        else:
            return None
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
        regular, size = stat.S_ISREG(status.st_mode), status.st_size
        raw = file.read_bytes() if regular and size <= MAX_FILE_BYTES else b""  # opening a pipe would wait for ever
    except FileNotFoundError:
        about = "check the path; by name alone a sweep finds records in the folders of POUNDING_SWEEP_RECORDS"
        raise MissingRecordError(f"{file}: no such file; {near_file(file)}{about}", record) from None
    except (OSError, ValueError) as error:
        raise RecordError(f"can't be read: {getattr(error, 'strerror', None) or error}") from None
    if not regular:
        raise RecordError("is a folder or a device; give a file")
    if size > MAX_FILE_BYTES:
        raise RecordError(f"has {size / 2**20:.0f} MiB; more than {MAX_FILE_BYTES // 2**20} MiB are refused; cut it")
    for pattern, what in read_data("records.toml")["not_read"].items():
        if re.match(pattern.encode(), raw, re.DOTALL | re.IGNORECASE):
            raise RecordError(f"is {what}")
    try:
        text = raw.decode("utf-16" if raw.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    text = text.translate(_DASHES).replace("\r\n", "\n").replace("\r", "\n").rstrip("\x1a\n\t ")  # ^Z: of DOS
    if not text.strip():
        raise RecordError("is empty; a record needs at least 1 point")
    if re.search(r"[\x00-\x08\x0b\x0e-\x1f\x7f]", text):
        raise RecordError("is binary, not text; give a PEER AT2, CSV or text file")
    return RecordText(file, text.split("\n"))


UNITS = {"g": STANDARD_GRAVITY, "m/s2": 1.0, "cm/s2": 0.01, "mm/s2": 1e-3}
UNITS |= {"mg": 1e-3 * STANDARD_GRAVITY, "%g": 0.01 * STANDARD_GRAVITY}
"""Acceleration units of files, each with its size in m/s2."""

_SPELLINGS = read_data("records.toml")["spellings"]
_QUANTITIES = {unit: quantity for quantity in _SPELLINGS["units"] for unit in _SPELLINGS["units"][quantity]}
_ALIASES = {spelling: unit for unit in _SPELLINGS["aliases"] for spelling in _SPELLINGS["aliases"][unit]}
_SIGNS = str.maketrans({"²": "2", "⁻": "-", "_": "/", **dict.fromkeys("^*·")})

ACC = r"(?<![^\W_])(?:acc(?:n|l|[eé]l(?:[eé]ration)?s?)?|acel(?:eraci[oó]n)?|accelerazione|beschl(?:eunigung)?|ivme)"
_S = r"s(?:ec(?:ond)?s?)?"
_ACCELERATION_UNIT = (
    rf"(?:(?:[cm]?m|in|ft)[\s/_·*]*{_S}[\s/_^*·]*(?:{_S}(?![^\W_])|[-⁻]?\s?[2²])|mps2|(?:m|%\s?|milli-?|percent\s?)?g(?:'s)?"
    r"|gals?)(?![^\W_])"
)
_UNIT = rf"(?:{_ACCELERATION_UNIT}|(?:(?:[cm]?m|in|ft)[\s/_·*]*{_S}(?:-1)?|mps|[cm]?m|in(?:ch)?|ft|counts?)(?![^\W_]))"
#: What stands behind the name of an acceleration: perhaps its component, then the unit and nothing else.
_BEHIND = rf"(?:(?:[xyzhvneu123]|ns|ew|ud|n-s|e-w|u-d|h[12])[\s_.,:;/-]+)?(?:in\s+)?(?P<unit>{_ACCELERATION_UNIT})"
#: Units of a column by its heading: in brackets at its end, behind the word acceleration, or as the heading.
_HEADING_UNITS = (
    rf"[(\[]\s*(?P<unit>{_UNIT}\.?|[^()\[\]\n]{{0,24}}/[^()\[\]\n]{{0,24}}?)\s*[)\]]\W*$",
    rf"{ACC}(?![^\W_])[\s_.,:;/=-]*{_BEHIND}\W*(?:[(\[].*)?$",
    rf"^\W*(?P<unit>(?!g\W*$){_ACCELERATION_UNIT})\W*$",
)
_UNITS = (
    r"(?:\bin\s+)?(?:\b|(?<=amplitude)|(?<=field_))(?:units?|unidad(?:es)?|einheit(?:en)?|unit[ée]s?)\b\s*"
    r"(?:de los datos\s*)?"
    r"(?P<sign>[:=]|(?:of|in|is|are|en)\b\s*[:=]?)?\s*(?P<bracket>[(\[])?\s*"
)
_END = r"(?=\s*(?:[.,;:()\[\]]|$))"
#: Units that a line of a header states: after "units", or else after "in", or behind the word acceleration.
_REMARK_UNITS = (
    (rf"{_UNITS}(?:utc[\s|]+|(?:[^,;()\[\]\n]{{1,20}}[,;]\s*){{0,3}}?)(?P<unit>{_ACCELERATION_UNIT}){_END}",),
    (rf"{_UNITS}(?:{_S}\s*[,;]\s*|utc[\s,;|]+)?(?P<unit>{_UNIT}){_END}",),
    (rf"{_UNITS}(?(sign)|(?(bracket)|(?!)))(?!\s*(?:{_S}|ms|min|hz?)\s*(?:$|[,;)\]]))(?P<unit>[^()\[\],;\n]{{1,40}})",),
    (
        rf"{ACC}\.?(?:[ \t]+[^\W\d_]+){{0,3}}?[ \t]*[(\[]\s*(?P<unit>[^()\[\]\n]{{1,24}}?)\s*[)\]]",
        rf"\b(?:in|en)\s+(?P<unit>(?!m?g\b){_ACCELERATION_UNIT}|counts?){_END}",
        rf"(?:{ACC}.{{0,80}}?|(?:values?|data|amplitudes?|motions?|samples|ordinates|series)\s+)\b(?:in|en)\s+"
        rf"(?P<unit>m?g(?:'s)?){_END}",
        rf"{ACC}(?![^\W_])[\s_.:/=-]*{_BEHIND}(?=[\s.]*(?:[,;|\t]|$))",
    ),
)
#: Factors that turn one unit of acceleration into another.
CONVERTED = r"(?:[x×*/]|\btimes|\b(?:scaled\s+)?by)\s*(?:9[.,]8|98[01]|386|32[.,][12]|0?[.,]0*102)"
#: What stands behind IN, of a line that speaks of the values.
BEHIND_IN = rf"(?:{ACC}|series|history|values|data)\b.*?\bin\s+(?:units?\s+of\s+)?([^\s,;.()=][^,;()=\n]{{0,29}})"
#: Lines that speak of other numbers than the values as they are: peaks, factors, and units that were or will be.
_ASIDE = (
    r"(?i)convert|conversion|umgerechnet|multipl|divide|\bfrom\b.*\bto\b|\bwas\b|original|->|=>|→"
    rf"|{CONVERTED}|\bscaled\s+by\s+(?!0*1(?:\.0*)?(?![\d.]))|[)\]]\s*[x×*/]\s*\d|\d\s*[x×*]\s*{ACC}"
    r"|\b(?:peak|max|min|pga|pgv|amax|rms|range|sensitiv|full.?scale|sensor|gain|resol|trigger)"
)
_NAMED = (
    r"(?i)(?<![^\W_])(?:(v_?g(?![^\W_])|vel(?![^\W_])|veloc|geschw|vitesse|velocidad)"
    r"|[ud]_?g(?![^\W_])|displ?(?![^\W_])|displac|verschieb|d[ée]plac|desplaz)"
)
_SERIES = (
    r"(?i)"
    r"(?:^\W*(?:(?:data[ _]type\s*:|ground|base|input|corrected|filtered|relative|absolute|horizontal|vertical)\s+)*"
    r"(veloc|displac)\w*\s*(?:$|[,;([]|at\b|of\b|record))|(veloc|displac)\w*\s+(?:time|data|histor|in\b)"
)


def plain_unit(text: str) -> str:
    """Return a unit in the spelling of `UNITS`, if it is one of acceleration."""
    plain = "".join(text.lower().translate(_SIGNS).split()).strip(".,;:")
    plain = re.sub("sec(?:ond)?", "s", plain).replace("/s/s", "/s2")
    return _ALIASES.get(plain, plain)


def match_unit(text: str) -> str | None:
    """Find the unit of `UNITS` that `text` spells, or None."""
    return unit if (unit := plain_unit(text)) in UNITS else None


def _units_of(patterns: Iterable[str], text: str) -> list[tuple[str, str]]:
    """Return the units that a text states in any of some ways, each with the words that do so."""
    matches = (match for pattern in patterns for match in re.finditer(pattern, text, re.IGNORECASE))
    return [] if re.search(_ASIDE, text) else [(match["unit"].strip(), match[0]) for match in matches]


def stated_units(lines: Iterable[tuple[int, str]], heading: tuple[int, str] | None = None) -> list[Stated]:
    """Collect the units that the lines of a header state for the column with a heading."""
    place, title = heading or (0, "")
    units = [Stated(unit, f"{title!r}, line {place}") for unit, _ in _units_of(_HEADING_UNITS, title)[:1]]
    for line, text in lines:
        ways = (_units_of(patterns, text) for patterns in _REMARK_UNITS)
        for unit, phrase in next(filter(None, ways), []):
            units.append(Stated(unit, f"{' '.join(phrase.split())!r}, line {line}"))
    return list(dict.fromkeys(units))


def check_quantity(lines: Iterable[tuple[int, str]], heading: tuple[int, str] | None = None) -> None:
    """Refuse velocity or displacement by the column's heading, or else by a title."""
    if heading and not re.search(ACC, heading[1], re.IGNORECASE) and (match := re.search(_NAMED, heading[1])):
        raise not_acceleration("velocity" if match[1] else "displacement", f"{heading[1]!r}, line {heading[0]}")
    for line, text in lines:
        match = re.search(_SERIES, text)
        if match and not re.search("(?i)acc", text):
            quantity = "velocity" if (match[1] or match[2]).lower() == "veloc" else "displacement"
            raise not_acceleration(quantity, f"{text.strip(' #%!/')[:60]!r}, line {line}")


#: Peaks that headers state, of the values as they are: one number, or one of each column.
_PEAK = (
    r"(?:^peak value\s*:|^PGA_\S+?\s*:|(?<!uncor )\bmax\s*=|^peak +acceleration\s*=|^acceleration: +peak\b"
    r"|\bpk(?: +acc)?\s*=|^max\. acc\.|(^(?:raw )?PGA values?\b|^acel\. max\.\(\w+\), C1-C6))(.*)"
)


def find_peak(source: RecordText, last: int, column: int = 1) -> Peak | None:
    """Find the peak of a column that the header before a line states: the last one, where components follow another."""
    for match, line in reversed(source.find(_PEAK, last=last)):
        numbers = NUMBER.findall(re.sub(r"\(.*?\)", "", match[2]))[column - 1 if match[1] else 0 :]
        if numbers and (value := to_float(numbers[0])):
            units = filter(None, map(match_unit, re.split(r"[\s(),:_]+", match[0])))
            last_place = 10.0 ** -len(numbers[0].partition(".")[2])
            return Peak(value, next(units, ""), last_place, f"{' '.join(match[0].split())[:60]!r}, line {line}")
    return None


def check_peak(peak: Peak, values: Array, unit: str) -> None:
    """Refuse values that do not reach the peak that their header states, or exceed it."""
    ratio = UNITS[peak.unit or unit] / UNITS[unit]
    stated, reached = abs(peak.value) * ratio, float(np.abs(values).max(initial=0.0))
    if np.isfinite(reached) and abs(reached - stated) > 0.02 * stated + peak.last_place * ratio:
        raise RecordError(
            f"its header states a peak of {stated:.4g} {unit} ({peak.where}), its values reach {reached:.4g} {unit}: "
            "in another unit, scaled, cut or damaged; get the file again, give units=, or correct the peak"
        )


def choose_unit(content: Content, wanted: str | None) -> tuple[str, str]:
    """Choose the unit of a file, and say where it is from; `wanted` is what the caller gave, which always wins."""
    stated: dict[str, Stated] = {}
    others = [item for item in content.units if plain_unit(item.text) in _QUANTITIES.keys() - UNITS.keys()]
    for item in content.units:
        if item not in others:
            stated.setdefault(match_unit(item.text) or item.text, item)
    valid = [unit for unit in stated if unit in UNITS]
    if others and not valid:
        raise not_acceleration(_QUANTITIES[plain_unit(others[0].text)], others[0].where)
    if wanted:
        over = " and ".join(item.where for unit, item in stated.items() if unit != wanted)
        return wanted, f"given{', in place of ' + over if over else ''}"
    if len(stated) == len(valid) == 1:
        return valid[0], stated[valid[0]].where
    if content.peak and content.peak.unit and not stated:
        return content.peak.unit, content.peak.where
    if content.default_unit and not stated:
        return content.default_unit
    listed = [f"{item.text!r} ({item.where})" for item in stated.values()]
    fault = f"states several units: {' and '.join(listed)}"
    if not valid:
        header = ", ".join(listed) or content.header
        fault = f"its units are not known{f'; its header says {header}' if header else ''}"
    raise RecordError(f"{fault}; give units= one of {', '.join(map(repr, UNITS))}")


_SECONDS = {name: float(size) for size in _SPELLINGS["seconds"] for name in _SPELLINGS["seconds"][size]}
_STEP = (
    r"(?i)(?<![^\W_])"
    r"(?:d_?t|delta[ _]?t|Δt|time[ _-]?(?:step|interval|increment)|sampl\w*[ _-]?(?:interval|period|step)|"
    r"intervalo de muestreo(?:, C1-C6)?|zeitschritt|pas de temps|equally spaced (?:at|intervals of)|at intervals of|"
    r"at(?=\s+[\d.]+ sec intervals))(?:[ _]s)?\s*(?:[(\[]\s*(\w+)\s*[)\]])?"
    rf"\s*(?:[=:]|\bof\b|\bis\b)?\s*/?\s*({NUMBER.pattern})[ \t]*((?!(?:and|at|for|from|in|with)\b)[^\W\d_]*+)"
    r"(?!\s*[=:(])"
)
_RATE = (
    r"(?i)(?<![^\W_])"
    r"(?:(?:sampl\w*|data)[ _-]?(?:rate|freq\w*)(?:_hz)?|fs(?=\s*[=:])|sampled at|(?:frecuencia|tasa|vel\w*\.?) de "
    r"muestreo(?:, C1-C6)?|abtast\w*)\s*(?:[(\[]\s*(?:hz|sps|samples/s\w*|muestras/s\w*)\s*[)\]])?"
    rf"\s*(?:[=:]|\bof\b|\bis\b)?\s*/?\s*({NUMBER.pattern})(?:\s*(?:hz|sps))?"
    rf"|({NUMBER.pattern})\s*(?:(?:muestras|samples|points|pts|puntos)\s*(?:/|por|per)\s*s|sps\b)"
)
#: Headers of more lines are of no record; of longer lines only the beginning counts.
MOST_HEADER = 1000
#: Lines that tell how a motion came about, in which a step may be that of another motion.
_STORY = r"(?i)\bfrom\b|resampl|interpol|decimat|original|\bwas\b|\bwere\b|\bold\b|\bnow\b|before|after|->|→"


def stated_steps(source: RecordText, lines: Iterable[tuple[int, str]]) -> list[Step]:
    """Collect the steps (s), and the inverse of sampling rates, that lines of a header state; NaN of unknown units."""
    steps: list[Step] = []
    for line, text in ((line, text[:MOST_HEADER]) for line, text in islice(lines, MOST_HEADER)):
        if not source.firm and re.search(_STORY, text):
            continue
        for match in re.finditer(_STEP, text):
            unit = (match[1] or match[3]).lower()
            number, where = to_float(match[2]), f"{match[0].strip()!r}, line {line}"
            if unit in ("hz", "sps"):
                steps.append((1.0 / (number or float("nan")), where))
            elif match[1] is None or unit in _SECONDS:
                steps.append((number * _SECONDS.get(unit, float("nan")), where))
        for match in re.finditer(_RATE, text):
            rate = to_float(match[1] or match[2])
            steps.append((1.0 / (rate or float("nan")), f"{match[0].strip()!r}, line {line}"))
    return steps


def check_step(step: float, where: str) -> None:
    """Refuse a step that no record has; a caller may give it."""
    if not STEP_RANGE[0] <= step <= STEP_RANGE[1]:
        fault = f"its time step is {step:g} s ({where})" if step >= 0.0 else f"its time step is not known ({where})"
        raise RecordError(f"{fault}; files have steps of {STEP_RANGE[0]:g} to {STEP_RANGE[1]:g} s: give dt= in seconds")


def choose_step(source: RecordText, stated: Sequence[Step]) -> Step:
    """Choose the time step of a file without times."""
    for step, where in stated if source.dt is None else ():
        check_step(step, where)
    different = list({f"{step:.6g}": (step, where) for step, where in reversed(stated)}.values())
    if source.dt is not None:
        wrong = [(step, where) for step, where in different if abs(step - source.dt) > 1e-6 * step]
        if wrong and source.firm and STEP_RANGE[0] <= wrong[0][0] <= STEP_RANGE[1]:
            step, where = wrong[0]
            raise RecordError(f"its time step is {step:g} s, dt={source.dt:g} was given; leave dt out ({where})")
        over = " and ".join(where for _, where in wrong)
        return source.dt, f"given{', in place of ' + over if over else ''}"
    if len(different) != 1:
        steps = " and ".join(f"{step:g} s ({where})" for step, where in different)
        fault = f"states several time steps: {steps}" if different else "has no time step"
        raise RecordError(f"{fault}; give dt= in seconds")
    return different[0]


def _last_places(numbers: Iterable[str]) -> Array:
    """Return the size of one unit in the last printed place in use, e.g. 0.01 for "1.25", of each number."""
    parts = [number.lower().replace("d", "e").partition("e") for number in numbers]
    powers = [max(-400, min(300, int(exponent[:6] or 0))) - len(x.partition(".")[2]) for x, _, exponent in parts]
    # Writers drop trailing zeros, and "%g" coarsens as time grows: the finest place still to come is the one in use.
    return np.minimum.accumulate(10.0 ** np.array(powers[::-1], float))[::-1]


@np.errstate(all="ignore")
def step_of_times(
    source: RecordText,
    time: Array,
    printed: Callable[[], Iterator[tuple[int, str]]],
    stated: Sequence[Step],
    where: str,
) -> Step:
    """Find the constant step that explains the printed times (lines and texts), each right to half its last place."""

    def row(index: int) -> tuple[int, str]:
        return next(islice(printed(), index, None))

    remedy = "a record needs a constant time step; resample it"
    if not np.isfinite(time).all():
        raise RecordError(f"line {row(int(np.isfinite(time).argmin()))[0]}: its time is not a finite number")
    if time.size == 1:
        return choose_step(source, stated)
    passed, index, steps = time[1:] - time[0], np.arange(1, time.size), np.diff(time)
    slack = (0.51 if time[0] == 0 else 1.02) * _last_places(word for _, word in printed())[1:]
    slack += 2e-7 * np.maximum(np.maximum(np.abs(time[1:]), abs(time[0])), passed)  # for float32 times
    if source.dt is not None and (np.abs(passed - index * source.dt) <= slack + 1e-6 * source.dt * index).all():
        return source.dt, "given, and explains the times"
    if (steps <= 0).any():
        if source.dt is None:
            remedy += "; or give dt= if its times are rounded, layout='rows' if it has none"
        raise RecordError(f"line {row(int((steps <= 0).argmax()) + 1)[0]}: its time does not increase; {remedy}")
    slack = np.minimum(slack, 0.15 * np.median(steps))
    low = np.maximum.accumulate((passed - slack) / index)
    high = np.minimum.accumulate((passed + slack) / index)
    middle = float(low[-1] + high[-1]) / 2
    if low[-1] > high[-1]:
        line, text = row(int((low > high).argmax()) + 1)
        raise RecordError(f"line {line}: time {text} s does not continue the steps before it; {remedy}")
    if source.dt is not None:
        raise RecordError(f"its time step is {middle:g} s, dt={source.dt:g} was given; leave dt out")
    rounded = [float(f"{middle:.{digits}e}") for digits in range(6)]
    candidates = (*rounded[:3], 1 / max(1, round(1 / middle)), *rounded[3:])
    step = next((value for value in candidates if low[-1] <= value <= high[-1]), middle)
    check_step(step, where)
    for other, place in stated:
        if abs(other - step) > 1e-3 * step and not low[-1] <= other <= high[-1]:
            raise RecordError(f"states several time steps: {step:g} s ({where}) and {other:g} s ({place}); give dt=")
    return step, where
