"""The formats of record files, told by their content, and reading one: unit and step from where they stand, scaling."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pounding_sweep.base.errors import RecordError, unknown
from pounding_sweep.base.files import expanded
from pounding_sweep.records.reader import (
    HEAD,
    LAYOUTS,
    NUMBER,
    RUN,
    UNITS,
    Array,
    Content,
    RecordText,
    Stated,
    StatedStep,
    choose_step,
    choose_unit,
    fail,
    field_step,
    fields_of,
    in_quotes,
    load_text,
    not_acceleration,
    other_quantity,
    plain_words,
    require_unit,
    stated_steps,
    stated_units,
    step_of_times,
    to_float,
    words,
)
from pounding_sweep.records.record import Reading, Record, number

# --- columns: acceleration alone, or with its time, or several components, told apart by their headings ---------------

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
        cells = NUMBER.findall(cells[0]) if RUN.fullmatch(cells[0]) else cells
    values: list[float] = []
    for cell in cells:
        one = words(cell) if "," not in cell else cell
        if isinstance(one, str) or len(one) != 1:
            return cells, cell or line
        values += one
    return cells, values or line


@dataclass(frozen=True)
class Reader:
    """One format of record files, an entry of `READERS`."""

    name: str  # what the format is called, for the documentation
    step: str  # where its time step stands, for the documentation
    unit: str  # where its unit stands
    suffixes: tuple[str, ...]  # endings that files of it have in folders, in lower case
    matches: Callable[[list[str]], bool]  # whether the first lines of a file are of it
    parse: Callable[[RecordText], Content]


# --- headers of lines "key: value" -----------------------------------------------------------------------------------


def _parse_afad(source: RecordText) -> Content:
    header, line, row = read_header(source)
    fields = fields_of(header)
    source.check_quantity(fields, "DATA TYPE")
    content = read_table(source, header, line, row, field_step(source, fields, "SAMPLING INTERVAL (sec)"))
    points = source.number(fields, "NUMBER OF DATA")
    if len(content.values) != points:
        source.fail(f"its header says {points:g} points, it holds {len(content.values)}; get the file again")
    return content


def _parse_cwa(source: RecordText) -> Content:
    header, line, row = read_header(source)
    fields = fields_of(header)
    names = " ".join(re.findall(r"[A-Za-z]+", fields["DataSequence"].text))
    steps = field_step(source, fields, "SampleRate(Hz)", rate=True)
    content = read_table(source, [*header, (line, names)], line, row, steps)
    unit = fields.get("AmplitudeUnit")
    units = [Stated(re.split(r"[\s.]", unit.text)[0], unit.where)] if unit else []
    return replace(content, units=units, title=fields.get("StationCode", Stated("", "")).text)


def _parse_esm(source: RecordText) -> Content:
    header, line, _ = read_header(source)
    fields = fields_of(header)
    source.check_quantity(fields, "DATA_TYPE")
    values = source.exactly(line, int(source.number(fields, "NDATA")), "NDATA")
    title = ", ".join(fields[key].text for key in ("EVENT_NAME", "STATION_CODE", "STREAM") if key in fields)
    step = choose_step(source, field_step(source, fields, "SAMPLING_INTERVAL_S"))
    return Content(values, step, [fields["UNITS"]] if "UNITS" in fields else [], title)


# --- COSMOS: a line of points, step and unit above the values --------------------------------------------------------

_ABOVE = re.compile(
    r"\s*(?P<points>\d{1,9})\s+(?:"
    r"(?P<pts>\w+)\s+pts,\s*approx\s+[\d.]+\s*secs?,\s*units\s*=\s*(?P<units>[^,(]+)"
    r"|points of (?P<data>\w+) data equally spaced at\s*(?P<step>[\d.]+)\s*sec\w*[.,]?\s*(?:in\s+(?P<in>[^.()\s]+))?)",
    re.IGNORECASE,
)


def _parse_cosmos(source: RecordText) -> Content:
    above = [(line, match) for line, text in enumerate(source.lines, 1) if (match := _ABOVE.match(text))]
    blocks = [(line, match) for line, match in above if (match["pts"] or match["data"]).lower().startswith("acc")]
    if not blocks:
        line, match = above[0]
        source.fail(not_acceleration((match["pts"] or match["data"]).lower(), f"line {line}"))
    names = []
    for position, (line, _) in enumerate(blocks, 1):
        channels = (re.search(r"\bChan(?:nel)?\s*\d+", text) for text in source.lines[line - 2 :: -1])
        names.append(next((channel[0] for channel in channels if channel), f"channel {position}"))
    chosen = source.choose(names)
    line, match = blocks[chosen]
    where, unit = f"{' '.join(match[0].split())!r}, line {line}", match["units"] or match["in"]
    steps = [StatedStep(float(match["step"]), where, firm=True)] if match["step"] else _real_header_step(source, line)
    values = source.exactly(line + 1, int(match["points"]), f"line {line}")
    column, units = names[chosen] if len(names) > 1 else None, [Stated(unit.strip(), where)] if unit else []
    return Content(values, choose_step(source, steps), units, " ".join(source.lines[0].split()), column=column)


def _real_header_step(source: RecordText, line: int) -> list[StatedStep]:
    """Return the step of the last real header above a line: its number 62 in ms, or else 34 in s."""
    start = next((i for i in range(line - 1, 0, -1) if "real-header" in source.lines[i - 1].lower()), line)
    real = words(" ".join(source.lines[start : start + 17]))
    places = () if isinstance(real, str) or len(real) < 62 else ((1e-3 * real[61], 62), (real[33], 34))
    return [StatedStep(step, f"real header, number {place}", firm=True) for step, place in places if step > 0.0][:1]


# --- GeoNet: for each component lines of text, perhaps 100 numbers, then values ten a row ----------------------------
# https://www.geonet.org.nz/data/supplementary/strong_motion_file_formats

_GEONET = re.compile(r"\s*(?:un)?corrected accelerogram", re.IGNORECASE)
_GEONET_POINTS = re.compile(r"Number of points +(\d{1,9})", re.IGNORECASE)
_GEONET_STEP = re.compile(r"\bat (?:intervals of )?([\d.]+) s(?:ec intervals)?\s*$", re.IGNORECASE)
_GEONET_UNIT = re.compile(r"in units of +([\d.]+) +(\S+)|Acceleration: +peak +[-\d.]+ +(\S+)", re.IGNORECASE)


def _parse_geonet(source: RecordText) -> Content:
    starts = [index for index, text in enumerate(source.lines) if _GEONET.match(text)]
    parts = zip(starts, [*starts[1:], len(source.lines)], strict=True)
    heads = [[text for text in source.lines[a : min(a + 26, b)] if isinstance(words(text), str)] for a, b in parts]
    names = [next((text.split()[1] for text in head if text.startswith("Component ")), "unnamed") for head in heads]
    chosen = source.choose(names)
    head, start, end = heads[chosen], starts[chosen], [*starts, len(source.lines)][chosen + 1]

    def search(pattern: re.Pattern[str]) -> list[tuple[re.Match[str], str]]:
        lines = enumerate(head, start + 1)
        return [(match, f"{match[0]!r}, line {line}") for line, text in lines if (match := pattern.search(text))]

    points = int(search(_GEONET_POINTS)[0][0][1])
    values = replace(source, lines=source.lines[:end]).numbers(start + len(head) + 1)
    steps = [StatedStep(float(match[1]), where, firm=True) for match, where in search(_GEONET_STEP)]
    if len(values) >= points + 100 and points in (values[30], values[33]):
        steps.append(StatedStep(float(values[65]), "number 66 of the header", firm=True))
        values = values[100:]
    if points == 0 or len(values) not in (points, 3 * points):
        source.fail(f"its header says {points} points, it holds {len(values)}; get the file again")
    (unit, where), *_ = search(_GEONET_UNIT)
    motion = values[:points] * float(unit[1] or 1.0)  # velocity and displacement may follow
    title, column = f"{source.lines[start + 1].strip()}, {names[chosen]}", names[chosen] if len(names) > 1 else None
    return Content(motion, choose_step(source, steps), [Stated(unit[2] or unit[3], where)], title, column=column)


# --- K-NET and KiK-net: 17 lines of header, then counts of the recorder in rows of eight -----------------------------
# https://www.kyoshin.bosai.go.jp/kyoshin/man/knetform_en.html

#: What the header states in numbers, each in its form.
_KNET_NUMBERS = {
    "Sampling Freq(Hz)": rf"({NUMBER.pattern})\s*Hz",
    "Scale Factor": rf"({NUMBER.pattern})\s*\(gal\)\s*/\s*({NUMBER.pattern})",
    "Duration Time(s)": rf"({NUMBER.pattern})",
}


def _parse_knet(source: RecordText) -> Content:
    end = next((index for index, line in enumerate(source.lines[:17]) if line.startswith("Memo")), None)
    if end is None:
        source.fail("has no line 'Memo.' at the end of its header; get the file again")
    fields = {line[:18].strip(): line[18:].strip() for line in source.lines[:end]}
    numbers: list[float] = []
    for key, form in _KNET_NUMBERS.items():
        match = re.fullmatch(form, fields.get(key, ""), re.ASCII | re.IGNORECASE)
        values = [to_float(text) for text in match.groups()] if match else [0.0]
        if not all(0 < value < float("inf") for value in values):
            source.fail(f"its header says {in_quotes(fields.get(key, ''))} as {key!r}; get the file again")
        numbers += values
    rate, full, counts, seconds = numbers
    source.check_points(seconds * rate)
    motion = source.numbers(end + 2)
    if len(motion) == 0 or abs(len(motion) - seconds * rate) > rate:  # the header has whole seconds
        held = f"{seconds:g} s at {rate:g} points per second, it holds {len(motion)} points"
        source.fail(f"its header says {held}; get the file again")
    # Recorders have an offset; the maximum in the header is also that of the record without its mean.
    with np.errstate(invalid="ignore", over="ignore"):  # the record tells of what is not finite
        motion = (motion - motion.mean()) * (full / counts)
    step = choose_step(source, [StatedStep(1 / rate, "Sampling Freq(Hz)", firm=True)])
    title = f"{fields.get('Station Code')} {fields.get('Dir.')}, earthquake of {fields.get('Origin Time')}"
    return Content(motion, step, [Stated("gal", "Scale Factor, in gal")], title, name=source.file.name)


# --- PEER: a header with the number of points and the time step, then accelerations row by row -----------------------

_NPTS = re.compile(r"\bNPTS\b", re.IGNORECASE)
_AT2 = re.compile(r"^[^#%!]*\bNPTS\s*(?:[=:]|,\s*DT)", re.IGNORECASE)
_POINTS = re.compile(r"\bNPTS\s*[=:]\s*(\d{1,12})(?!\d)", re.ASCII | re.IGNORECASE)
_OLD = re.compile(rf"^\s*(\d{{1,12}})[\s,]+({NUMBER.pattern})[\s,]+NPTS\s*,\s*DT", re.ASCII | re.IGNORECASE)
_PEER = re.compile(r"\bPEER\b|STRONG[ -]MOTION DATA", re.IGNORECASE)


def _parse_peer(source: RecordText) -> Content:
    lines = list(enumerate(source.lines[:HEAD], 1))
    place = [line for line, text in lines if _NPTS.search(text)][
        -1
    ]  # where headers stand above each other, the last one is that of the values
    text = lines[place - 1][1]
    old = _OLD.search(text)
    points = old or _POINTS.search(text)
    if points is None:
        stated = in_quotes(text.strip())
        source.fail(f"line {place}: no readable number of points in {stated}; write e.g. NPTS= 2000, DT= .02 SEC")
    steps = [StatedStep(to_float(old[2]), f"{text.strip()[:60]!r}, line {place}", firm=True)] if old else []
    start = place
    for line in (place, place + 1, place - 1):
        if not steps and 0 < line <= len(lines) and (steps := stated_steps([lines[line - 1]], firm=True)):
            start = max(line, place)
    header = lines[:start]
    step = choose_step(source, steps)
    if other := other_quantity(header):
        source.fail(not_acceleration(*other))
    values = source.exactly(start + 1, int(points[1]), "NPTS")
    titles = [text.strip() for _, text in lines[: place - 1] if text.strip()]
    title = titles[1] if len(titles) > 1 else "".join(titles)
    peer = source.file.suffix.lower() == ".at2" or any(_PEER.search(text) for _, text in header)
    default = ("g", "AT2 files are in g unless they say otherwise") if peer else None
    return Content(values, step, stated_units(header), title, default)


# --- SMC: 11 lines of text, 48 whole numbers, 50 numbers, remarks with |, then values in cm/s2 -----------------------
# https://escweb.wr.usgs.gov/nsmp-data/smcfmt.html

_SMC = re.compile(r"\s*\d\s+(?:(?:UN)?CORRECTED\s+ACCELEROGRAM|VELOCITY|DISPLACEMENT)", re.IGNORECASE)


def _parse_smc(source: RecordText) -> Content:
    lines = source.lines
    quantity = lines[0].split()[-1].lower()
    if quantity in ("velocity", "displacement"):
        source.fail(not_acceleration(quantity, f"{lines[0].strip()!r}, line 1"))
    whole, real = (words(" ".join(lines[first:last])) for first, last in ((11, 17), (17, 27)))
    if isinstance(whole, str) or isinstance(real, str) or len(whole) != 48 or len(real) != 50:
        source.fail("lines 12 to 27 are not the numbers of an SMC header; get the file again")
    rate = real[1]
    where = f"second real number of the header, {rate:g} samples/s, line 18"
    step = choose_step(source, [StatedStep(1 / rate if rate else -1.0, where, firm=True)])
    values = source.exactly(28 + int(whole[15]), int(whole[16]), "the number of points")
    return Content(values, step, [Stated("cm/s2", "that of SMC files")], " ".join(lines[5].split()))


READERS = (
    Reader(
        name="AFAD, three components",
        step="`SAMPLING INTERVAL (sec)`",
        unit="`UNITS`",
        suffixes=(".txt",),
        matches=lambda head: "STRONG GROUND MOTION RECORDS OF TURK" in head[0].upper(),
        parse=_parse_afad,
    ),
    Reader(
        name="COSMOS and CSMIP (CDMG), volumes 1 and 2",
        step="the real header (numbers 62 or 34), or `equally spaced at`",
        unit="`units=` or `in` above the values",
        suffixes=(".v1", ".v2", ".v1c", ".v2c"),
        matches=lambda head: any("real-header" in text.lower() or _ABOVE.match(text) for text in head),
        parse=_parse_cosmos,
    ),
    Reader(
        name="CWA of Taiwan, three components",
        step="`#SampleRate(Hz)`, and its times",
        unit="`#AmplitudeUnit`",
        suffixes=(".dat",),
        matches=lambda head: any(line.startswith("#DataSequence") for line in head),
        parse=_parse_cwa,
    ),
    Reader(
        name="ESM and ITACA .ASC",
        step="`SAMPLING_INTERVAL_S`",
        unit="`UNITS`",
        suffixes=(".asc",),
        matches=lambda head: any(line.startswith("SAMPLING_INTERVAL_S") for line in head),
        parse=_parse_esm,
    ),
    Reader(
        name="GeoNet V1A and V2A",
        step="`data at ... sec intervals`, `at intervals of`",
        unit="`in units of`, or that of its peak",
        suffixes=(".v1a", ".v2a"),
        matches=lambda head: bool(_GEONET.match(head[0])) and any(_GEONET_POINTS.search(text) for text in head),
        parse=_parse_geonet,
    ),
    Reader(
        name="K-NET and KiK-net ASCII of NIED, one component a file",
        step="`Sampling Freq(Hz)`",
        unit="`Scale Factor`, in gal; the offset (mean) is taken out, as NIED does for the maximum in the header",
        suffixes=tuple(f".{component}{place}" for place in ("", 1, 2) for component in ("ns", "ew", "ud")),
        matches=lambda head: head[0].startswith("Origin Time"),
        parse=_parse_knet,
    ),
    Reader(
        name="PEER AT2, old and NGA headers",
        step="`DT` on the line of `NPTS`, or next to it",
        unit="`IN UNITS OF`, `IN CM/S/S`; else g",
        suffixes=(".at2",),
        matches=lambda head: any(_AT2.search(line) for line in head),
        parse=_parse_peer,
    ),
    Reader(
        name="USGS SMC",
        step="the second real number of the header, samples/s",
        unit="cm/s2, by the definition of the format",
        suffixes=(".smc",),
        matches=lambda head: bool(_SMC.match(head[0])),
        parse=_parse_smc,
    ),
    Reader(
        name="columns of time and accelerations, in CSV (`,` or `;`) or apart by blanks or tabs; acceleration alone; a "
        "first line `N dt` as of eqsig, DEEPSOIL and RspMatch; one component in rows, with `layout`",
        step="the column of times, the line `N dt`, or a remark such as `dt = 0.01 s` or `200 samples/s`",
        unit="the heading, as `acc (g)` or `acc_g`, or a remark such as `units: g` or `acceleration in g`",
        suffixes=(".csv", ".txt", ".dat", ".acc"),
        matches=lambda head: True,
        parse=parse_columns,
    ),
)
"""All formats; the first one that matches reads a file."""

RECORD_SUFFIXES = tuple(dict.fromkeys(suffix for reader in READERS for suffix in reader.suffixes))
"""File name endings taken for record files when a folder is searched."""


def read_record(
    path: str | os.PathLike[str],
    *,
    name: str | None = None,
    dt: float | None = None,
    units: str | None = None,
    scale: float = 1.0,
    pga: float | None = None,
    column: str | int | None = None,
    layout: str | None = None,
) -> Record:
    r"""Read one ground-motion record from a file.

    PEER AT2, the formats of networks in `pounding_sweep.records.formats`, columns of time and acceleration (CSV or
    separated by blanks, at a constant step), or acceleration alone. The content decides, not the file name. Headings
    tell time from acceleration, whichever is first. ``record.reading`` says where unit and step were read.

    Parameters
    ----------
    path
        The file, of at most 64 MiB and 10,000,000 points.
    name
        Label of the record; by default the file name, without its ending unless that tells the component.
    dt
        Time step in s. Needed where the file states none; where its times or the header of its format do, it must agree
        with them. It takes precedence over remarks, and over times that it explains to their last printed place.
    units
        Unit of the file: "g" (9.81 m/s2), "mg", "%g", "m/s2", "cm/s2" ("gal") or "mm/s2". Needed where the file states
        none, or several. It takes precedence over what the file states, with a warning.
    scale
        Factor on the motion.
    pga
        Peak ground acceleration to scale to, in m/s2; excludes `scale`.
    column
        Which of several components: a heading, or the number of the column in the file, from 1.
    layout
        "rows" for one component whose values wrap in rows of several; "columns" otherwise.

    Returns
    -------
    Record
        Acceleration in m/s2; the first point is at time 0.

    Raises
    ------
    MissingRecordError
        If there is no such file.
    RecordError
        If the file can't be read, holds no record, velocity or displacement, fewer or more points than its header says,
        values that are not finite, an uneven time step, times that are not in seconds, several components without
        `column`, or if time step or units are not known.

    Warns
    -----
    UserWarning
        If `units` takes precedence over another unit in the file.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "demo.csv")
    ...     _ = file.write_text("time (s),acc (g)\n0.00,0.0\n0.01,0.2\n0.02,-0.1\n")
    ...     record = read_record(file, scale=0.5)
    >>> record
    Record('demo', 3 points, dt=0.01 s, PGA 0.981 m/s2)
    >>> print(record.reading)
    unit g: 'acc (g)', line 1; step: 'time (s)', line 1
    """
    file = expanded(path)
    if pga is not None and scale != 1.0:
        raise RecordError(f"{file}: scale={scale!r} and pga={pga!r} exclude each other; give one of them")
    wanted = None if units is None else require_unit(units)
    step = None if dt is None else number(dt, f"{file}: dt (s)", positive=True)
    if layout is not None and layout not in LAYOUTS:
        raise RecordError(unknown("layout", layout, LAYOUTS))
    source = replace(load_text(file, file.stem if name is None else name), dt=step, column=column, layout=layout)
    try:
        content = next(r for r in READERS if r.matches(source.lines[:HEAD])).parse(source)
    except RecordError:
        raise
    except (ArithmeticError, ValueError, LookupError) as error:  # numbers of a header that are none
        fail(file, f"its header is damaged ({error}); get the file again")
    label = (content.name or file.stem) if name is None else name
    try:
        unit, unit_from = choose_unit(content.units, content.default_unit, wanted, content.header)
        if "in place of" in unit_from:
            warnings.warn(f"{file}: units={wanted!r} is {unit_from}", UserWarning, stacklevel=2)
        with np.errstate(over="ignore"):
            motion = content.values * UNITS[unit]
        title = f"{content.title[:200]} ({file.name})" if content.title else file.name
        reading = Reading(unit, unit_from, content.step[1], content.column)
        record = Record(label, content.step[0], motion, title, reading=reading)
        return record.scaled_to(pga) if pga is not None else record.scaled(scale)
    except RecordError as error:
        fail(file, str(error))
