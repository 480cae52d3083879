"""Records in columns: acceleration alone, or time and acceleration, told apart by headings and by what they hold."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice

import numpy as np
import numpy.typing as npt

from pounding_sweep.records.reader import (
    LONGEST_WORD,
    NUMBER,
    RUN,
    STATED_DT,
    Array,
    Content,
    Reader,
    RecordText,
    in_quotes,
    plain_words,
    words,
)

_COMMENT = ("#", "%", "!", "//")
#: Longer headers are of no record.
_MOST_HEADER = 1000

_TIME = r"(?:times?|temps|zeit|tiempo|tempo|t)"
_UNIT = (
    r"(?:ms|msecs?|millis|milli-?\s?sec(?:ond)?s?|[uµμ]s|[uµμ]?secs|micro-?\s?sec(?:ond)?s?|ns|min|mins|minutes?|hr?s?|"
    r"hours?|days?)"
)
#: A heading of time in another unit than seconds: "time (ms)", "Time_ms", "t/ms", "time in ms"; or the unit alone.
_NOT_SECONDS = re.compile(
    rf"(?<![^\W_]){_TIME}(?:[^,;\n]{{0,12}}[(\[]\s*|\s*[_/]\s*|[\s_]+in[\s_]+|[ \t]+)({_UNIT})(?![^\W_])"
    rf"|^\W*({_UNIT})\s*[,;\t]",
    re.IGNORECASE | re.MULTILINE,
)
_TIME_HEADING = re.compile(rf"\W*(?:{_TIME}|elapsed|s|secs?|seconds?)(?![^\W_])", re.IGNORECASE)
_INDEX_HEADING = re.compile(
    r"\W*(?:index|idx|i|n|no|nr|num|number|point|points|sample|samples|step|steps|row|id|unnamed\b.*)?\W*",
    re.IGNORECASE,
)
#: A heading where blanks separate columns: words, each with what stands in brackets behind it.
_HEADING = re.compile(r"[^\s(\[]+(?:\s*(?:\([^)]*\)|\[[^\]]*\]))?")
#: Blocks that are rows of one or two words, apart from what the words are.
_ROWS = {
    1: re.compile(r"(?:[ \t]*+[^\s,]++[ \t]*+,?+[ \t]*+\n)++"),
    2: re.compile(r"(?:[ \t]*+[^\s,]++(?:[ \t]*+,[ \t]*+[^\s,]++[ \t]*+,?+|[ \t]++[^\s,]++)[ \t]*+\n)++"),
}


def _parse(source: RecordText, dt: float | None) -> Content:
    """Read one column of acceleration, or two with its time."""
    header, line, row = _header(source)
    columns = len(_row(row)[1])
    if columns > 2:
        source.fail(
            f"line {line} has {columns} columns; give time and acceleration, or acceleration alone "
            "(a PEER file needs its header with NPTS and DT)"
        )
    text = "\n".join(header)
    if columns == 2 and _NOT_SECONDS.search(text):
        source.fail(f"its times are not in seconds ({in_quotes(text)}); convert them")
    heads = _headings(header[-1], row) if header and columns == 2 else []
    timed = [bool(_TIME_HEADING.match(head)) for head in heads]
    time = int(timed == [False, True])
    if time and _INDEX_HEADING.fullmatch(heads[0]):
        source.fail(f"has no column of acceleration: its columns are headed {heads}")
    values = _values(source, line, columns)
    stated = match[1] if (match := STATED_DT.search(text)) else None
    counts = columns == 2 and not any(timed) and _counts(values[:, time])
    if counts and dt is None and stated is None:
        head = f", headed {heads[0]!r}," if heads else ""
        source.fail(
            f"its first column{head} counts by ones: points, or seconds? Give dt= in seconds (dt=1 if they are), "
            "or head the column 'time (s)'"
        )
    if columns == 1 or counts:
        step = source.agreed_dt(stated, dt)
    else:
        step = _even_step(source, values[:, time], line, time, dt)
        cells = _cells(header[-1]) if header else []
        before = words(cells[0]) if cells else ""
        if isinstance(before, list) and len(before) == 1 and abs(values[0, 0] - step - before[0]) < step / 2:
            last = in_quotes(header[-1])
            source.fail(f"{last} before line {line} is a row of data with a value that is no number")
    title = header[0].lstrip("#%!/ ") if len(header) > 1 else ""
    if time:  # the unit is looked for in the last column
        text = "\n".join([*header[:-1], ",".join(reversed(heads))])
    return Content(values[:, columns - 1 - time], step, text, title)


def _header(source: RecordText) -> tuple[list[str], int, str]:
    """Find the lines before the first row of numbers, and that row with its line."""
    header: list[str] = []
    for line, row in _lines(source, 1):
        if not isinstance(_row(row)[1], str):
            return header, line, row
        header.append(row)
        if len(header) > _MOST_HEADER:
            source.fail(f"its first {_MOST_HEADER} lines hold no row of numbers; is it a record?")
    source.fail("holds no numbers; give a PEER AT2 file, two columns (time, acceleration) or one of acceleration")


def _lines(source: RecordText, start: int) -> Iterator[tuple[int, str]]:
    """Go through the lines from one on that are not blank."""
    for first, block in source.blocks(start):
        for line, text in enumerate(block.split("\n"), first):
            if plain := text.strip():
                yield line, plain


def _values(source: RecordText, start: int, columns: int) -> Array:
    """Read the rows from a line on. Shape (rows, columns)."""
    parts, count = [], 0
    for first, block in source.blocks(start):
        found = plain_words(block) if _ROWS[columns].fullmatch(block) else None
        if found is None:
            rows = []
            for line, text in enumerate(block.split("\n"), first):
                plain = text.strip()
                if not plain or plain.startswith(_COMMENT):
                    continue
                row = _row(plain)[1]
                if isinstance(row, str):
                    source.fail(f"line {line}: {in_quotes(row)} is not a number")
                if len(row) != columns:
                    source.fail(f"line {line} has {len(row)} columns where line {start} has {columns}")
                rows += row
            found = np.array(rows)
        parts.append(found.reshape(-1, columns))
        count += len(parts[-1])
        source.check_points(count)
    return np.concatenate(parts)


def _counts(column: Array) -> bool:
    """Whether a column is 0, 1, 2, ... or 1, 2, 3, ..."""
    return column.size > 1 and column[0] in (0.0, 1.0) and bool((np.diff(column) == 1.0).all())


def _headings(line: str, row: str) -> list[str]:
    """Split the line before the first row into the headings of two columns; nothing if it has no two."""
    plain = line.lstrip("#%!/ ")
    if _separator(plain) != _separator(row):
        return []
    found = _cells(plain) if _separator(plain).strip() else _HEADING.findall(plain)
    return found if len(found) == 2 else []


def _separator(line: str) -> str:
    return next((sign for sign in ";," if sign in line), " ")


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
    """Split a row into cells and their numbers, or what of it is no number."""
    cells = _cells(line)
    if len(cells) == 1:  # fixed-width columns may touch
        run = RUN.fullmatch(cells[0]) if len(cells[0]) <= LONGEST_WORD else None
        cells = NUMBER.findall(cells[0]) if run else cells
    values: list[float] = []
    for cell in cells:
        one = words(cell) if "," not in cell else cell
        if isinstance(one, str) or len(one) != 1:
            return cells, cell or line
        values += one
    return cells, values or line


def _resolution(word: str) -> float:
    """Size of one unit in the last printed place of a number, e.g. 0.01 for "1.25"."""
    mantissa, _, exponent = word.lower().replace("d", "e").partition("e")
    return 10.0 ** (max(-400, min(300, int(exponent[:6] or 0))) - len(mantissa.partition(".")[2]))


@np.errstate(all="ignore")
def _even_step(source: RecordText, time: Array, start: int, column: int, dt: float | None) -> float:
    """Find the constant step (s) that explains the printed times, each right to half a unit in its last place."""
    remedy = "a record needs a constant time step; resample it"

    def printed() -> Iterator[tuple[int, str]]:
        rows = (row for row in _lines(source, start) if not row[1].startswith(_COMMENT))
        return ((line, _row(text)[0][column]) for line, text in rows)

    def at(wrong: npt.NDArray[np.bool_], shift: int = 1) -> tuple[int, str]:
        return next(islice(printed(), int(wrong.argmax()) + shift, None))

    bad = ~np.isfinite(time)
    if bad.any():
        source.fail(f"line {at(bad, 0)[0]}: its time is not a finite number")
    if time.size == 1:
        return source.fail("has one point only, so no time step; give dt= in seconds") if dt is None else dt
    steps = np.diff(time)
    if (steps <= 0).any():
        source.fail(f"line {at(steps <= 0)[0]}: its time does not increase; {remedy}")
    # Writers drop trailing zeros, and "%g" coarsens as time grows: the finest place still to come is the one in use.
    places = np.fromiter((_resolution(word) for _, word in printed()), np.float64, time.size)
    places = np.minimum.accumulate(places[::-1])[::-1]
    slack = (0.51 if time[0] == 0 else 1.02) * places[1:] + 2e-7 * np.abs(time[1:])  # the latter for float32 times
    slack = np.minimum(slack, 0.15 * np.median(steps))
    index = np.arange(1, time.size)
    low = np.maximum.accumulate((time[1:] - time[0] - slack) / index)
    high = np.minimum.accumulate((time[1:] - time[0] + slack) / index)
    middle = float(low[-1] + high[-1]) / 2
    if not 1e-9 < 2 * middle < 1e9:
        source.fail(f"its time step of about {middle:g} s makes no sense; times must be in seconds")
    if low[-1] > high[-1]:
        line, text = at(low > high)
        source.fail(f"line {line}: time {text} s does not continue the steps before it; {remedy}")
    if dt is not None:
        if not low[-1] * (1 - 1e-6) <= dt <= high[-1] * (1 + 1e-6):
            source.fail(f"its time step is {middle:g} s, dt={dt:g} was given; leave dt out")
        return dt
    rounded = [float(f"{middle:.{digits}e}") for digits in range(6)]
    for candidate in (*rounded[:3], 1 / max(1, round(1 / middle)), *rounded[3:]):
        if low[-1] <= candidate <= high[-1]:
            return candidate
    return middle


READER = Reader(
    name="time and acceleration, in CSV (`,` or `;`) or apart by blanks; or acceleration alone",
    needs="times in seconds at a constant step, or `dt` given, or `DT=` in the header; the unit of the acceleration in "
    "the heading, as `acc (g)`, or given",
    suffixes=(".csv", ".txt", ".dat"),
    told=None,
    parse=_parse,
)
