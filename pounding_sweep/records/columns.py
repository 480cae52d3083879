"""Records in columns: acceleration alone, or with its time, or several components, told apart by their headings."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np

from pounding_sweep.records.reader import (
    LONGEST_WORD,
    NUMBER,
    RUN,
    Array,
    Content,
    RecordText,
    StatedStep,
    in_quotes,
    not_acceleration,
    plain_words,
    words,
)
from pounding_sweep.records.stated import choose_step, other_quantity, stated_steps, stated_units, step_of_times

Lines = list[tuple[int, str]]

_COMMENT = ("#", "%", "!", "//")
#: Longer headers are of no record.
_MOST_HEADER = 1000

_TIME = r"(?:times?|temps|zeit|tiempo|tempo|zaman|t)"
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
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?", re.ASCII)
_DASHES = str.maketrans(dict.fromkeys("‐‑‒–—−", "-"))


def parse_columns(source: RecordText) -> Content:
    """Read one column of acceleration, with or without its time, or rows of one component."""
    header, line, row = read_header(source)
    first = cells_of(row)[1]
    count = _count_line(source, line, first)
    steps: list[StatedStep] = []
    if count:
        points, step = count
        steps = [StatedStep(step, f"{row[:40]!r}, line {line}")]
        line, row = next(_lines(source, line + 1), (line, row))
        first = cells_of(row)[1]
    steps += stated_steps(header)
    if source.layout == "rows" or (count and (len(first) != 2 or source.numbers(line).size != 2 * points)):
        values = source.exactly(line, points, f"line {line - 1}") if count else source.numbers(line)
        return described(source, header, values, choose_step(source, steps, header))
    return read_table(source, header, line, row, steps)


def described(
    source: RecordText,
    header: Lines,
    values: Array,
    step: tuple[float, str],
    heading: tuple[int, str] | None = None,
    column: str | None = None,
) -> Content:
    """Put together what a file holds: its unit by the heading of the column, or by the lines before it."""
    # The line of headings of several components states no unit for all of them.
    remarks = [item for item in header if heading is None or column is None or item[0] != heading[0]]
    heading = heading or (header[-1] if header else None)
    if other := other_quantity(remarks, heading):
        source.fail(not_acceleration(*other))
    lines = [item for item in remarks if heading is None or item[0] != heading[0]][:2]
    shown = ", ".join(f"{text[:60]!r} (line {line})" for line, text in [*([heading] if heading else []), *lines])
    title = header[0][1].lstrip("#%!/ ") if len(header) > 1 else ""
    return Content(values, step, stated_units(remarks, heading), title, header=shown, column=column)


def read_table(source: RecordText, header: Lines, line: int, row: str, steps: Sequence[StatedStep]) -> Content:
    """Read columns from a line on; `row` is that line."""
    columns = len(cells_of(row)[1])
    text = "\n".join(text for _, text in header)
    split = [(number, heads) for number, text in header if (heads := _headings(text, row, columns))]
    # Remarks may follow the line of headings.
    where, heads = next(
        (item for item in split[::-1] if item[0] == header[-1][0] or any(map(_TIME_HEADING.match, item[1]))), (0, [])
    )
    if columns > 1 and _NOT_SECONDS.search(text):
        source.fail(f"its times are not in seconds ({in_quotes(text)}); convert them")
    if columns > 2 and not heads and source.column is None:
        source.fail(
            f"line {line} has {columns} columns without headings; give layout='rows' with dt= and units= if they are "
            "values of one component one after another, or column= a number from 1 for one of several components"
        )
    timed = [bool(_TIME_HEADING.match(head)) for head in heads]
    values = _values(source, line, columns)
    time = timed.index(True) if any(timed) else (0 if columns == 2 or _rises(values[:, 0]) else None)
    if columns == 1:
        time = None
    if heads and time == columns - 1 and all(_INDEX_HEADING.fullmatch(head) for head in heads[:time]):
        source.fail(f"has no column of acceleration: its columns are headed {heads}")
    others = [index for index in range(columns) if index != time]
    names = heads or [str(index + 1) for index in range(columns)]
    chosen = others[source.choose([names[index] for index in others], [index + 1 for index in others])]
    heading = (where, heads[chosen]) if heads else None
    counts = time is not None and not any(timed) and _counts(values[:, time])
    if time is None or counts:
        if counts and source.dt is None and not steps:
            head = f", headed {heads[0]!r}," if heads else ""
            source.fail(
                f"its first column{head} counts by ones: points, or seconds? Give dt= in seconds (dt=1 if they are), "
                "or head the column 'time (s)'"
            )
        step = choose_step(source, steps, header)
    else:

        def printed(time: int = time) -> Iterator[tuple[int, str]]:
            return ((number, cells_of(text)[0][time]) for number, text in _lines(source, line))

        what = f"{heads[time]!r}, line {where}" if heads else f"times in column {time + 1}"
        step = step_of_times(source, values[:, time], printed, steps, what)
        _check_first_row(source, header, line, values[0, time] - step[0])
    return described(source, header, values[:, chosen], step, heading, names[chosen] if len(others) > 1 else None)


def _check_first_row(source: RecordText, header: Lines, line: int, before: float) -> None:
    """Refuse a row before the first whose time is that before it: a row of data with a value that is no number."""
    cells = cells_of(header[-1][1])[0] if header else []
    number = words(cells[0]) if cells else ""
    if isinstance(number, list) and len(number) == 1 and abs(before - number[0]) < 1e-6 + 1e-3 * abs(before):
        last = in_quotes(header[-1][1])
        source.fail(f"{last} before line {line} is a row of data with a value that is no number")


def _count_line(source: RecordText, line: int, first: list[float] | str) -> tuple[int, float] | None:
    """Return the number of points and the step (s) of a first line "N dt" (or "dt N"), perhaps with a third number."""
    if isinstance(first, str) or len(first) not in (2, 3):
        return None
    points, step = (first[0], first[1]) if first[0] > first[1] else (first[1], first[0])
    following = next(_lines(source, line + 1), None)
    if following is None or points != int(points) or not (points > 1 and 0.0 < step < 1.0):
        return None
    second = cells_of(following[1])[1]
    if isinstance(second, str) or (len(second) == len(first) and not (len(second) == 2 and abs(second[0]) <= step)):
        return None
    return int(points), step


def read_header(source: RecordText) -> tuple[Lines, int, str]:
    """Find the lines before the first row of numbers, and that row with its line."""
    header: Lines = []
    for line, text in enumerate(source.lines[: _MOST_HEADER + 1], 1):
        row = text.strip()
        if row and not isinstance(cells_of(row)[1], str):
            return header, line, row
        if row and not isinstance(cells_of(row.translate(_DASHES))[1], str):
            source.not_a_number(line, str(cells_of(row)[1]))
        header += [(line, row)] if row else []
    if len(source.lines) > _MOST_HEADER:
        source.fail(f"its first {_MOST_HEADER} lines hold no row of numbers; is it a record?")
    source.fail("holds no numbers; give a PEER AT2 file, two columns (time, acceleration) or one of acceleration")


def _lines(source: RecordText, start: int) -> Iterator[tuple[int, str]]:
    """Go through the lines from one on that are neither blank nor remarks."""
    stripped = ((line, text.strip()) for line, text in enumerate(source.lines[start - 1 :], start))
    return ((line, text) for line, text in stripped if text and not text.startswith(_COMMENT))


def _values(source: RecordText, start: int, columns: int) -> Array:
    """Read the rows from a line on. Shape (rows, columns)."""
    text = "\n".join(source.lines[start - 1 :])
    apart = r"(?:[ \t]*+,[ \t]*+|[ \t]++)[^\s,]++"
    only = re.compile(rf"(?:[ \t]*+[^\s,]++(?:{apart}){{{columns - 1}}}[ \t]*+,?+[ \t]*+(?:\n|$))++")
    values = plain_words(text) if only.fullmatch(text) else None
    if values is None:
        rows: list[float] = []
        for line, row in _lines(source, start):
            cells = cells_of(row)[1]
            if isinstance(cells, str):
                source.not_a_number(line, cells)
            if len(cells) != columns:
                source.fail(f"line {line} has {len(cells)} columns where line {start} has {columns}")
            rows += cells
        values = np.array(rows)
    source.check_points(values.size / columns)
    return values.reshape(-1, columns)


def _counts(column: Array) -> bool:
    """Whether a column is 0, 1, 2, ... or 1, 2, 3, ..."""
    return column.size > 1 and column[0] in (0.0, 1.0) and bool((np.diff(column) == 1.0).all())


def _rises(column: Array) -> bool:
    """Whether a column rises by nearly equal steps, as times do."""
    steps = np.diff(column)
    return column.size > 2 and bool((steps > 0.0).all() and steps.max() < 3.0 * steps.min())


def _headings(line: str, row: str, columns: int) -> list[str]:
    """Split the line before the first row into the headings of its columns; nothing if it has another number."""
    plain = line.lstrip("#%!/ ")
    if columns == 1:
        return []
    same = _separator(plain) == _separator(row)
    splits = [_cells(plain) if _separator(plain).strip() or "\t" in plain else _HEADING.findall(plain)] if same else []
    splits += [re.split(sign, plain) for sign in (r"\s*[;,]\s*", r"\s*\t\s*|\s{2,}") if not same]
    for found in splits:
        if len(found) == columns and (same or _TIME_HEADING.match(found[0]) or _INDEX_HEADING.fullmatch(found[0])):
            return [head.strip("\"' ") for head in found]
    return []


def _separator(line: str) -> str:
    return next((sign for sign in ";,\t" if sign in line), " ")


def _cells(line: str) -> list[str]:
    """Split a row at semicolons (then a comma is the decimal sign), tabs, commas or blanks."""
    apart = line.split("\t") if "\t" in line else line.split()
    if ";" in line:
        cells = [cell.replace(",", ".") for cell in line.split(";")]
    elif len(apart) > 1 and all(_DECIMAL_COMMA.fullmatch(cell.strip()) for cell in apart):
        cells = [cell.replace(",", ".") for cell in apart]
    elif "," in line and not ("\t" in line and not re.search(r"\d\s*,", line)):
        cells = line.split(",")
    elif "\t" in line and not NUMBER.match(line):
        cells = apart
    else:
        return line.split()
    cells = [cell.strip().strip("\"'").strip() for cell in cells]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def cells_of(line: str) -> tuple[list[str], list[float] | str]:
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
