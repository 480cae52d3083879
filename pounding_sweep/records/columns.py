"""Records in columns: acceleration alone, or time and acceleration, told apart by headings and by what they hold."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from pounding_sweep.records.loading import Content, fail, in_bounds, in_quotes
from pounding_sweep.records.numbers import LONGEST_WORD, NUMBER, RUN, Array, blocks, plain_rows, to_float, words
from pounding_sweep.records.steps import agreed_dt, even_step, resolution

STATED_DT = re.compile(rf"\bDT\s*[=:]\s*({NUMBER.pattern})", re.ASCII | re.IGNORECASE)
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
_FIRST = re.compile(r"^[ \t]*+([^\s,]++)", re.MULTILINE)
_SECOND = re.compile(r"([^\s,]++)[ \t]*+,?+[ \t]*+$", re.MULTILINE)


def parse_columns(file: Path, text: str, dt: float | None) -> Content:
    """Read one column of acceleration, or two with its time; `dt` (s) is the step, if it was given."""
    table = _Table(file)
    for line, block in blocks(file, text):
        table.add(line, block)
    if not table.columns:
        fail(file, "holds no numbers; give a PEER AT2 file, two columns (time, acceleration) or one of acceleration")
    header, values = "\n".join(table.header), np.concatenate(table.parts)
    table.parts.clear()
    stated = None if (match := STATED_DT.search(header)) is None else to_float(match[1])
    if table.columns == 1:
        step = agreed_dt(file, stated, dt)
    elif _counts(values[:, table.time]) and not table.timed:
        if dt is None and stated is None:
            head = f", headed {table.heads[0]!r}," if table.heads else ""
            fail(
                file,
                f"its first column{head} counts by ones: points, or seconds? Give dt= in seconds (dt=1 if they are), "
                "or head the column 'time (s)'",
            )
        step = agreed_dt(file, stated, dt)
    else:
        step = _step_of(file, text, table, values[:, table.time], dt)
        last = table.header[-1] if table.header else ""
        before = words(_cells(last)[0]) if _cells(last) else []
        if isinstance(before, list) and len(before) == 1 and abs(values[0, 0] - step - before[0]) < step / 2:
            fail(file, f"{in_quotes(last)} before line {table.line} is a row of data with a value that is no number")
    title = table.header[0].lstrip("#%!/ ") if len(table.header) > 1 else ""
    if table.time == 1:  # the unit is looked for in the last column
        header = "\n".join([*table.header[:-1], ",".join(reversed(table.heads))])
    return Content(values[:, table.columns - 1 - table.time if table.columns == 2 else 0], step, header, title, None)


def _counts(column: Array) -> bool:
    """Whether a column is 0, 1, 2, ... or 1, 2, 3, ..."""
    return column.size > 1 and column[0] in (0.0, 1.0) and bool((np.diff(column) == 1.0).all())


def _step_of(file: Path, text: str, table: _Table, time: Array, dt: float | None) -> float:
    lines = np.concatenate(table.lines)

    def word(point: int) -> tuple[int, str]:
        line = int(lines[point])
        found = next(
            block.split("\n")[line - first] for first, block in blocks(file, text) if line < first + block.count("\n")
        )
        return line, _row(found.strip())[0][table.time]

    return even_step(file, time, np.concatenate(table.places), word, dt)


class _Table:
    """Rows of a file, as they are read block by block."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.header: list[str] = []
        self.parts: list[Array] = []
        self.columns = self.line = self.time = self.count = 0
        self.heads: list[str] = []
        self.timed = False
        self.lines: list[np.ndarray] = []
        self.places: list[Array] = []

    def add(self, line: int, block: str) -> None:
        """Take the rows of a block whose first line has that number."""
        found = plain_rows(block, self.columns) if self.columns else None
        if found is None:
            self._add_lines(line, block)
            return
        self.parts.append(found)
        self.count += len(found)
        in_bounds(self.file, self.count)
        if self.columns == 2:
            self.lines.append(np.arange(line, line + len(found), dtype=np.int32))
            printed = (_SECOND if self.time else _FIRST).findall(block)
            self.places.append(np.array([resolution(word) for word in printed]))

    def _add_lines(self, line: int, block: str) -> None:
        rows: list[list[float]] = []
        lines: list[int] = []
        places: list[float] = []
        for number, text in enumerate(block.split("\n"), line):
            plain = text.strip()
            if not plain or (self.columns and plain.startswith(_COMMENT)):
                continue
            cells, found = _row(plain)
            if isinstance(found, str) or not found:
                if self.columns:
                    what = in_quotes(found if isinstance(found, str) and found else plain)
                    fail(self.file, f"line {number}: {what} is not a number")
                self.header.append(plain)
                if len(self.header) > _MOST_HEADER:
                    fail(self.file, f"its first {_MOST_HEADER} lines hold no row of numbers; is it a record?")
                continue
            if not self.columns:
                self._begin(number, plain, len(found))
            if len(found) != self.columns:
                has = f"line {number} has {len(found)} columns where line {self.line} has {self.columns}"
                fail(self.file, has)
            rows.append(found)
            if self.columns == 2:
                lines.append(number)
                places.append(resolution(cells[self.time]))
        self.count += len(rows)
        in_bounds(self.file, self.count)
        self.parts += [np.array(rows)] if rows else []
        self.lines += [np.array(lines, np.int32)] if lines else []
        self.places += [np.array(places)] if places else []

    def _begin(self, number: int, row: str, columns: int) -> None:
        """Tell the columns by the first row and the heading before it."""
        if columns > 2:
            fail(
                self.file,
                f"line {number} has {columns} columns; give time and acceleration, or acceleration alone "
                "(a PEER file needs its header with NPTS and DT)",
            )
        self.line, self.columns = number, columns
        if columns == 1:
            return
        text = "\n".join(self.header)
        if _NOT_SECONDS.search(text):
            fail(self.file, f"its times are not in seconds ({in_quotes(text)}); convert them")
        self.heads = _headings(self.header[-1], row) if self.header else []
        if self.heads:
            first, second = (bool(_TIME_HEADING.match(head)) for head in self.heads)
            if second and not first:
                if _INDEX_HEADING.fullmatch(self.heads[0]):
                    fail(self.file, f"has no column of acceleration: its columns are headed {self.heads}")
                self.time = 1
            self.timed = first or second


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
    """Split a row into cells and their numbers, or the first cell that isn't a number."""
    cells = _cells(line)
    if len(cells) == 1:  # fixed-width columns may touch
        run = RUN.fullmatch(cells[0]) if len(cells[0]) <= LONGEST_WORD else None
        cells = NUMBER.findall(cells[0]) if run else cells
    values: list[float] = []
    for cell in cells:
        one = words(cell) if "," not in cell else cell
        if isinstance(one, str) or len(one) != 1:
            return cells, cell
        values += one
    return cells, values
