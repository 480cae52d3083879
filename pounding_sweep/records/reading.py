"""Reading record files as they are published: PEER AT2, CSV and plain text.

The format is told from the content: a header with ``NPTS`` is PEER AT2,
otherwise one column is acceleration and two are time and acceleration.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pounding_sweep.errors import RecordError
from pounding_sweep.records.loading import fail, load_text
from pounding_sweep.records.record import UNITS, Record, match_unit, number, require_unit

RECORD_SUFFIXES = (".at2", ".csv", ".txt", ".dat")
"""File name endings taken for record files when a folder is searched."""

# Possessive quantifiers (Python 3.11) keep every match linear in the text's length.
_UNSIGNED = r"(?:\d++(?:\.\d*+)?|\.\d++)(?:[EeDd][+-]?\d++)?"
_NUMBER = re.compile(rf"[+-]?{_UNSIGNED}", re.ASCII)
# Fortran fields that fill their width touch; only a sign can tell where the next begins.
_RUN = re.compile(rf"[+-]?{_UNSIGNED}(?:[+-]{_UNSIGNED})*+", re.ASCII)
_NOT_FINITE = re.compile(r"[+-]?(?:nan|inf|infinity)(?:\(\w*\))?", re.ASCII | re.IGNORECASE)
_LONGEST_WORD = 4096

_NPTS = re.compile(r"\bNPTS\b", re.IGNORECASE)
_NPTS_NEW = re.compile(r"\bNPTS\s*[=:]\s*(\d{1,12})(?!\d)", re.ASCII | re.IGNORECASE)
_NPTS_OLD = re.compile(rf"^\s*(\d{{1,12}})[\s,]+({_NUMBER.pattern})[\s,]+NPTS\s*,\s*DT", re.ASCII | re.IGNORECASE)
_DT = re.compile(rf"\bDT\s*[=:]\s*({_NUMBER.pattern})", re.ASCII | re.IGNORECASE)
_NOT_ACCELERATION = re.compile(r"\b(VELOCITY|DISPLACEMENT)\s+TIME[ -](?:SERIES|HISTORY)", re.IGNORECASE)
_PEER = re.compile(r"\bPEER\b|STRONG[ -]MOTION DATA", re.IGNORECASE)
_HEADER_LINES = 32

_UNITS_STATED = re.compile(r"\bunits?\b(?:\s+(?:of|in|is|are))?\s*[:=]?\s*[(\[]?([^,;()\[\]\n]{1,24})", re.IGNORECASE)
_BRACKETED = re.compile(r"[(\[]([^()\[\]\n]{1,24})[)\]]")
_TIME_NOT_SECONDS = re.compile(r"\b(?:time|t)\b[^,;\n]{0,8}[(\[]\s*(ms|msec|milliseconds|min|minutes|h)\s*[)\]]", re.I)


@dataclass(frozen=True)
class _Content:
    """What a file says, before units and scaling."""

    values: list[float]
    dt: float
    header: str
    title: str
    default_units: str | None


def read_record(
    path: str | os.PathLike[str],
    *,
    name: str | None = None,
    dt: float | None = None,
    units: str | None = None,
    scale: float = 1.0,
    pga: float | None = None,
) -> Record:
    r"""Read one ground-motion record from a file.

    PEER AT2 (old and NGA headers), two columns of time and acceleration (CSV
    or separated by blanks, at a constant step), or one column of acceleration
    with `dt`. The content decides, not the file name.

    Parameters
    ----------
    path
        The file, of at most 64 MiB.
    name
        Label of the record; by default the file name without its ending.
    dt
        Time step in s. Needed for one column without ``DT=`` in its header; where the file has a step, it must agree.
    units
        Units of the file: "g" (9.81 m/s2), "m/s2" or "cm/s2" ("gal"). Needed where the header
        doesn't state them; AT2 files are in g. Where the header does, both must agree.
    scale
        Factor on the motion.
    pga
        Peak ground acceleration to scale to, in m/s2; excludes `scale`.

    Returns
    -------
    Record
        Acceleration in m/s2; the first point is at time 0.

    Raises
    ------
    MissingRecordError
        If there is no such file.
    RecordError
        If the file can't be read, holds no record, holds fewer or more points than its header says,
        values that are not finite, an uneven time step, or if time step or units are not known.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "demo.csv")
    ...     _ = file.write_text("time (s),acc (g)\n0.00,0.0\n0.01,0.2\n0.02,-0.1\n")
    ...     read_record(file, scale=0.5)
    Record('demo', 3 points, dt=0.01 s, PGA 0.981 m/s2)
    """
    try:
        file = Path(path).expanduser()
    except (TypeError, RuntimeError):
        msg = f"a record's path must be a text or a path, not {path!r}"
        raise RecordError(msg) from None
    if pga is not None and scale != 1.0:
        msg = f"{file}: scale={scale!r} and pga={pga!r} exclude each other; give one of them"
        raise RecordError(msg)
    given_units = None if units is None else require_unit(units)
    given_dt = None if dt is None else number(dt, f"{file}: dt (s)", positive=True)
    label = file.stem if name is None else name
    content = parse_text(file, load_text(file, label), given_dt)
    factor = UNITS[_choose_units(file, content, given_units)]
    with np.errstate(over="ignore"):
        motion = np.array(content.values, dtype=np.float64) * factor
    source = f"{content.title} ({file.name})" if content.title else file.name
    try:
        record = Record(label, content.dt, motion, source)
        return record.scaled_to(pga) if pga is not None else record.scaled(scale)
    except RecordError as error:
        fail(file, str(error))


def parse_text(file: Path, text: str, dt: float | None) -> _Content:
    """Tell the format of `text` and take header, step (s) and values from it."""
    lines = text.split("\n")
    for index, line in enumerate(lines[:_HEADER_LINES]):
        if _NPTS.search(line):
            return _parse_at2(file, lines, index, dt)
    return _parse_columns(file, lines, dt)


def _float(text: str) -> float:
    """Convert one matched number, with Fortran's D exponents too."""
    return float(text.replace("D", "E").replace("d", "e"))


def _words(line: str) -> list[float] | str:
    """Split a line into numbers, touching ones too; return the first word that isn't one."""
    values: list[float] = []
    for word in line.replace(",", " ").split():
        if len(word) <= _LONGEST_WORD and _RUN.fullmatch(word):
            values += [_float(part) for part in _NUMBER.findall(word)]
        elif _NOT_FINITE.fullmatch(word):
            values.append(float("nan" if "nan" in word.lower() else "inf"))
        else:
            return word
    return values


def _shown(word: str) -> str:
    return repr(word if len(word) <= 24 else word[:24] + "...")


def _parse_at2(file: Path, lines: list[str], npts_line: int, dt: float | None) -> _Content:
    start = npts_line + 1
    if start < len(lines) and _DT.search(lines[start]):
        start += 1
    header = "\n".join(lines[:start])
    wrong = _NOT_ACCELERATION.search(header)
    if wrong:
        fail(file, f"holds {wrong[1].lower()}, not acceleration; take the .AT2 file of the same record")
    old = _NPTS_OLD.search(lines[npts_line])
    points = old or _NPTS_NEW.search(header)
    if points is None:
        shown = _shown(lines[npts_line].strip())
        fail(file, f"line {npts_line + 1}: no readable number of points in {shown}; write e.g. NPTS= 2000, DT= .02 SEC")
    step = old[2] if old else (match[1] if (match := _DT.search(header)) else None)
    dt = _agreed_dt(file, None if step is None else _float(step), dt)
    values: list[float] = []
    for row, line in enumerate(lines[start:], start + 1):
        found = _words(line)
        if isinstance(found, str):
            fail(file, f"line {row}: {_shown(found)} is not a number, nor numbers that touch but can be told apart")
        values += found
    expected = int(points[1])
    if len(values) != expected or expected == 0:
        cause = "it was cut short" if len(values) < expected else "the header or the file is damaged"
        found_points = f"its header says {expected} points, it holds {len(values)}"
        fail(file, f"{found_points}: {cause}; get the file again, or mend NPTS")
    titles = [line.strip() for line in lines[:npts_line] if line.strip()]
    title = titles[1] if len(titles) > 1 else "".join(titles)
    peer = bool(_PEER.search(header)) or file.suffix.lower() == ".at2"
    return _Content(values, dt, header, title[:200], "g" if peer else None)


def _agreed_dt(file: Path, stated: float | None, given: float | None) -> float:
    """Choose between the header's time step and the caller's, in s."""
    if stated is None:
        if given is None:
            fail(file, "has no time step; give dt= in seconds")
        return given
    stated = number(stated, f"{file}: DT of its header (s)", positive=True)
    if given is not None and abs(given - stated) > 1e-6 * stated:
        fail(file, f"its time step is {stated:g} s, dt={given:g} was given; leave dt out")
    return stated


def _cells(line: str) -> list[str]:
    """Split a row at semicolons (then a comma is the decimal sign), commas or blanks."""
    if ";" in line:
        cells = [cell.replace(",", ".") for cell in line.split(";")]
    elif "," in line:
        cells = line.split(",")
    else:
        return line.split()
    cells = [cell.strip().strip("\"'").strip() for cell in cells]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _row(line: str) -> tuple[list[str], list[float] | str]:
    """Split a row into cells and their numbers, or the first cell that isn't a number."""
    cells = _cells(line)
    if len(cells) == 1:  # fixed-width columns may touch
        run = _RUN.fullmatch(cells[0]) if len(cells[0]) <= _LONGEST_WORD else None
        cells = _NUMBER.findall(cells[0]) if run else cells
    values: list[float] = []
    for cell in cells:
        one = _words(cell) if "," not in cell else cell
        if isinstance(one, str) or len(one) != 1:
            return cells, cell
        values += one
    return cells, values


def _parse_columns(file: Path, lines: list[str], dt: float | None) -> _Content:
    header: list[str] = []
    rows: list[list[float]] = []
    times: list[str] = []
    numbers: list[int] = []
    for index, line in enumerate(lines, 1):
        plain = line.strip()
        if not plain:
            continue
        cells, found = _row(plain)
        if isinstance(found, str) or not found:
            if not rows:
                header.append(plain)
            elif not plain.startswith(("#", "%", "!", "//")):
                fail(
                    file,
                    f"line {index}: {_shown(found if isinstance(found, str) and found else plain)} is not a number",
                )
            continue
        if rows and len(found) != len(rows[0]):
            fail(file, f"line {index} has {len(found)} columns where line {numbers[0]} has {len(rows[0])}")
        rows.append(found)
        times.append(cells[0])
        numbers.append(index)
    if not rows:
        fail(file, "holds no numbers; give a PEER AT2 file, two columns (time, acceleration) or one of acceleration")
    columns = len(rows[0])
    if columns > 2:
        fail(
            file,
            f"line {numbers[0]} has {columns} columns; give time and acceleration, or acceleration alone "
            "(a PEER file needs its header with NPTS and DT)",
        )
    text = "\n".join(header)
    if columns == 2:
        if _TIME_NOT_SECONDS.search(text):
            fail(file, f"its times are not in seconds ({_shown(text)}); convert them")
        step = _even_step(file, np.array([row[0] for row in rows]), times, numbers, dt)
        before = _words(_cells(header[-1])[0]) if header and _cells(header[-1]) else []
        if isinstance(before, list) and len(before) == 1 and abs(rows[0][0] - step - before[0]) < step / 2:
            fail(file, f"{_shown(header[-1])} before line {numbers[0]} is a row of data with a value that is no number")
    else:
        match = _DT.search(text)
        step = _agreed_dt(file, None if match is None else _float(match[1]), dt)
    title = header[0].lstrip("#%!/ ") if len(header) > 1 else ""
    return _Content([row[-1] for row in rows], step, text, title[:200], None)


def _resolution(word: str) -> float:
    """Size of one unit in the last printed place of a number, e.g. 0.01 for "1.25"."""
    mantissa, _, exponent = word.lower().replace("d", "e").partition("e")
    return 10.0 ** (max(-400, min(300, int(exponent[:6] or 0))) - len(mantissa.partition(".")[2]))


@np.errstate(all="ignore")
def _even_step(file: Path, time: np.ndarray, words: list[str], rows: list[int], dt: float | None) -> float:
    """Find the constant step (s) that explains the printed times, each right to half a unit in its last place."""
    remedy = "a record needs a constant time step; resample it"
    bad = ~np.isfinite(time)
    if bad.any():
        fail(file, f"line {rows[int(bad.argmax())]}: its time is not a finite number")
    if time.size == 1:
        if dt is None:
            fail(file, "has one point only, so no time step; give dt= in seconds")
        return dt
    steps = np.diff(time)
    if (steps <= 0).any():
        fail(file, f"line {rows[int((steps <= 0).argmax()) + 1]}: its time does not increase; {remedy}")
    # Writers drop trailing zeros, and "%g" coarsens as time grows: the finest place still to come is the one in use.
    places = np.minimum.accumulate(np.array([_resolution(word) for word in words])[::-1])[::-1]
    slack = (0.51 if time[0] == 0 else 1.02) * places[1:] + 2e-7 * np.abs(time[1:])  # the latter for float32 times
    slack = np.minimum(slack, 0.15 * np.median(steps))
    index = np.arange(1, time.size)
    low = np.maximum.accumulate((time[1:] - time[0] - slack) / index)
    high = np.minimum.accumulate((time[1:] - time[0] + slack) / index)
    if not 1e-9 < low[-1] + high[-1] < 1e9:
        fail(file, f"its time step of about {(low[-1] + high[-1]) / 2:g} s makes no sense; times must be in seconds")
    if low[-1] > high[-1]:
        row = int((low > high).argmax()) + 1
        fail(file, f"line {rows[row]}: time {words[row]} s does not continue the steps before it; {remedy}")
    if dt is not None:
        if not low[-1] * (1 - 1e-6) <= dt <= high[-1] * (1 + 1e-6):
            fail(file, f"its time step is {(low[-1] + high[-1]) / 2:g} s, dt={dt:g} was given; leave dt out")
        return dt
    middle = float(low[-1] + high[-1]) / 2
    rounded = [float(f"{middle:.{digits}e}") for digits in range(6)]
    for candidate in (*rounded[:3], 1 / max(1, round(1 / middle)), *rounded[3:]):
        if low[-1] <= candidate <= high[-1]:
            return candidate
    return middle


def _header_units(header: str) -> tuple[str | None, str]:
    """Find the acceleration unit a header states; else the text it has in that place."""
    stated = [match.strip() for match in _UNITS_STATED.findall(header)]
    phrases = [" ".join(words[:n]) for text in stated for words in [text.split()] for n in range(len(words), 0, -1)]
    last = header.rpartition("\n")[2]
    columns = re.split(r"[,;]", last)
    words = re.split(r"[\s,;]+", last)
    tails = [word.split("_", n)[n].replace("_", "/") for word in words for n in range(1, word.count("_") + 1)]
    tiers = [phrases, _BRACKETED.findall(columns[-1]), _BRACKETED.findall(header), words + tails]
    for tier in tiers:
        found = {unit for text in tier if (unit := match_unit(text))}
        if len(found) == 1:
            return found.pop(), ""
        if tier is phrases and phrases:
            return None, stated[0]
        if found:
            break
    return None, last.strip()


def _choose_units(file: Path, content: _Content, given: str | None) -> str:
    found, text = _header_units(content.header)
    if found and given and found != given:
        fail(file, f"its header says {found!r}, units={given!r} was given; leave units out, or mend the header")
    if found or given:
        return found or given or ""
    stated = bool(_UNITS_STATED.search(content.header))
    if content.default_units and not stated:
        return content.default_units
    said = f"; its header says {_shown(text)}" if text else ""
    fail(file, f"its units are not known{said}; give units= one of {', '.join(map(repr, UNITS))}")
