"""The formats of record files, told by their content, and reading one: unit and step from where they stand, scaling."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pounding_sweep.base.errors import MissingRecordError, RecordError, check_choice, unknown
from pounding_sweep.base.files import FilePath, expanded, read_data
from pounding_sweep.base.text import printable
from pounding_sweep.records.reader import (
    ACC,
    BEHIND_IN,
    CONVERTED,
    MOST_HEADER,
    NUMBER,
    RUN,
    STEP_RANGE,
    UNITS,
    Array,
    Content,
    Lines,
    RecordText,
    Stated,
    Step,
    check_count,
    check_peak,
    check_points,
    check_quantity,
    choose_step,
    choose_unit,
    find_peak,
    floats,
    load_text,
    match_unit,
    not_a_number,
    not_acceleration,
    plain_words,
    stated_steps,
    stated_units,
    step_of_times,
    to_float,
)
from pounding_sweep.records.record import Reading, Record, number

#: Lines by which a format is told.
_HEAD = 100
#: How the values of a component are laid out.
_LAYOUTS = ("columns", "rows")

# --- columns: acceleration alone, or with its time, or several components, told apart by their headings ---------------

_COMMENT = ("#", "%", "!", "//")
_TIME = r"(?:times?|temps|zeit|tiempo|tempo|zaman|t)"
_UNIT = (
    r"(?:ms|msecs?|millis|milli-?\s?sec(?:ond)?s?|[uµμ]s|[uµμ]?secs|micro-?\s?sec(?:ond)?s?|ns|min|mins|minutes?|hr?s?|"
    r"hours?|days?)"
)
_NOT_COMPONENT = r"(?!(?:ns|h)(?![^\W_]))"
#: A heading of time in another unit than seconds: "time (ms)", "t/ms", "time in ms"; or the unit alone, but NS and H.
_NOT_SECONDS = (
    rf"(?im)(?<![^\W_]){_TIME}(?:[^,;\n]{{0,12}}[(\[]\s*|\s*[_/]\s*|[\s_]+in[\s_]+)({_UNIT})(?![^\W_])"
    rf"|(?<![^\W_]){_TIME}[ \t]+{_NOT_COMPONENT}({_UNIT})(?![^\W_])|^\W*{_NOT_COMPONENT}({_UNIT})\s*[,;\t]"
)
_TIME_HEADING = re.compile(rf"\W*(?:(?:relative)?{_TIME}|elapsed|s|secs?|seconds?)(?![^\W_])", re.IGNORECASE)
#: Headings of spectra, and titles of them.
_SPECTRAL = re.compile(
    r"(?i)\W*(?:periods?|per[ií]odo|freq\w*|frecuencia|hz|p?s[avd]|fas|(?:pseudo[\s-]*)?spectral|fourier)(?![^\W_])"
    r"|.*[(\[]\s*(?:hz|rad/s)\s*[)\]]"
)
_SPECTRUM = (
    r"^\W*(?!.*(?:match|compatib|target|scaled))(?:\w+[\s-]+){0,3}?(?:response|fourier)\b.{0,60}\bspectr(?:um|a)\b"
)
_INDEX_HEADING = re.compile(
    r"\W*(?:index|idx|i|n|no|nr|num|number|point|points|sample|samples|step|steps|row|id|unnamed\b.*)?\W*",
    re.IGNORECASE,
)
#: A heading where blanks separate columns: words, each with what stands in brackets behind it.
_HEADING = r"[^\s(\[]+(?:\s*(?:\([^)]*\)|\[[^\]]*\]))?"
_COMMA = r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?"
#: What a row has that is split at a sign, in order, and whether its comma is the decimal sign.
_SEPARATORS = (
    (re.compile(";"), ";", True),
    (re.compile(rf"^\s*{_COMMA}(?:\s+{_COMMA})+\s*$", re.ASCII), None, True),
    (re.compile(r"\d\s*,|^[^\t]*,[^\t]*$"), ",", False),
    (re.compile(rf"^(?!{NUMBER.pattern}).*\t"), "\t", False),
)
_EMPTY_CELL = r"(?m)(?:^|,)[ \t]*,"
#: The number of points in the headers of ESM, China, AFAD, GeoCSV and UNAM; rows of the first two wrap.
_COUNT = (
    r"^\W*(NDATA|NO\. OF POINTS|NUMBER OF DATA|sample_count|NUM\. TOTAL DE MUESTRAS, C1-C6)\s*:\s*/?(\d{1,9})(?![\w.])"
)
#: A date or a time of day, or both, in the first columns of a row.
_DAY, _CLOCK = r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}", r"\d{1,2}(?::[\d.]+)+Z?"
_DATE = re.compile(rf"\s*\"?(?:{_DAY}(?:[T ,;|\t]{_CLOCK})?|{_CLOCK})\"?(?:\s*[,;|]\s*|\s+)")
#: Headings of components, of which rows of one component have none.
_COMPONENT = re.compile(r"[NSEWUDHVXYZLT][1-3]?|N-?S|E-?W|U-?D|UP|[NS]\d+[EW]|.*[(\[].*[)\]]", re.IGNORECASE)


def parse_columns(source: RecordText) -> Content:
    """Read columns from the first row of numbers on, or rows of one component."""
    points, where, wraps, start = None, "", source.layout == "rows", 1
    counts = source.find(_COUNT) if source.firm else []
    if len(counts) > 1:
        raise RecordError(f"holds {len(counts)} records one after another (line {counts[1][1]}); split the file")
    for match, place in counts:
        wraps = wraps or match[1] in ("NDATA", "NO. OF POINTS")
        points, where, start = int(match[2]), f"line {place}", place + 1
    header, line, row = _read_header(source, start)
    steps = stated_steps(source, header)
    # a first line "N dt" or "dt N", perhaps with further numbers, or one with the number of rows below it
    rows, first = list(_rows(source, line + 1)), _numbers(row) or []
    second = (_numbers(rows[0][1]) or []) if rows else []
    interval, count = sorted(first[:2]) if len(first) in (2, 3) else (0.0, 0.0)
    fits = second and count.is_integer() and count > 1 and 0.0 < interval < 1.0
    counts_rows = len(rows) > 1 and len(rows) in first
    if counts_rows or (fits and (len(second) != len(first) or (len(second) == 2 and abs(second[0]) <= interval))):
        points, where = len(rows) if counts_rows else int(count), f"line {line}"
        intervals = [number for number in first if STEP_RANGE[0] <= number <= STEP_RANGE[1]]
        steps[:0] = [(number, f"{row[:40]!r}, {where}") for number in intervals[:1]]
        line, row = rows[0]
        wraps = wraps or not (counts_rows or (len(_cells(row)) == 2 and source.numbers(line).size == 2 * points))
    column: str | None = None
    heading: list[tuple[int, str]] = []
    number = 1
    if wraps:
        _check_rows(source, header, line, row)
        values, step = source.numbers(line, points, where), choose_step(source, steps)
    else:
        values, step, heading, column, number = _read_table(source, header, line, row, steps)
        if points is not None:
            more = "MUESTRAS" in source.lines[start - 2]  # UNAM's files have a few points more
            check_count(points, min(len(values), points) if more else len(values), where)
    # the line of headings of several components states no unit for all of them
    remarks = [item for item in header if column is None or item[0] != heading[0][0]] if heading else header
    heading = heading or header[-1:]
    check_quantity(remarks, *heading)
    quoted = [f"{text[:60]!r} (line {place})" for place, text in dict.fromkeys([*heading, *remarks[:2]])]
    title = header[0][1].lstrip("#%!/ ") if len(header) > 1 else ""
    peak = find_peak(source, line, number) if source.firm else None
    units = stated_units(remarks, *heading)
    return Content(values, step, units, title, header=", ".join(quoted), column=column, peak=peak)


def _read_header(source: RecordText, start: int) -> tuple[Lines, int, str]:
    """Find the lines before the first row of numbers from line `start` on, and that row with its line."""
    header: Lines = []
    for line, text in enumerate(source.lines[: MOST_HEADER + 1], 1):
        row = text.strip()
        if line >= start and (floats(row) if source.layout == "rows" else _numbers(row)):
            return header, line, row
        if (date := _DATE.match(row)) and _numbers(row[date.end() :]):
            what = f"{date[0].strip(' ,;')!r}, line {line}"
            raise RecordError(f"its first column holds dates ({what}), not times; delete it, and give dt= in seconds")
        header += [(line, row[:MOST_HEADER])] if re.search(r"\w", row) else []
    raise RecordError(
        f"has no row of numbers in its first {MOST_HEADER} lines; give a PEER AT2 file, two columns (time, "
        "acceleration) or one of acceleration"
    )


def _check_rows(source: RecordText, header: Lines, line: int, row: str) -> None:
    """Refuse rows that are not values of one component one after another."""
    texts, columns = [text for _, text in _rows(source, line)], len(_cells(row))
    heads = _headings(header[-1][1], row, columns) if header else []
    rises, fault = np.diff([(_numbers(text) or [0.0])[0] for text in texts[:50]]), ""
    if heads and all(_COMPONENT.fullmatch(head) or _TIME_HEADING.match(head) for head in heads):
        fault = f"line {header[-1][0]} heads several components: {heads}"
    elif columns > 1 and len(rises) > 2 and 0.0 < rises.max() < 1.5 * rises.min():
        fault = f"line {line} begins a column that rises like times"
    elif columns > 1 and not re.search(r"[.eE]", row) and any("." in text for text in texts):
        fault = f"line {line} holds whole numbers, unlike rows below, as headers do"
    if fault:
        raise RecordError(f"{fault}; delete what is above the values, or give column= in place of layout='rows'")


def _read_table(
    source: RecordText, header: Lines, line: int, row: str, steps: list[Step]
) -> tuple[Array, Step, Lines, str | None, int]:
    """Read columns from a row on: the acceleration, its step, heading, name among several components, and number."""
    columns, text = len(_cells(row)), "\n".join(text for _, text in header)
    where, heads = 0, list[str]()
    for place, remark in header:  # remarks may follow the line of headings
        names = _headings(remark, row, columns)
        if names and (any(map(_TIME_HEADING.match, names)) or (place == header[-1][0] and not heads)):
            where, heads = place, names
    motion = [head for head in heads if re.search(ACC, head, re.IGNORECASE) and not _SPECTRAL.match(head)]
    timed = [index for index, head in enumerate(heads) if _TIME_HEADING.match(head)]
    spectral = [(where, head) for head in heads if _SPECTRAL.match(head)]
    spectral += [] if timed else [(place, match[0]) for match, place in source.find(_SPECTRUM, last=line)]
    for place, words in spectral if columns > 1 and not (timed and motion) else ():
        raise not_acceleration("a spectrum", f"{words.strip()!r}, line {place}")
    if columns > 1 and re.search(_NOT_SECONDS, text):
        raise RecordError(f"its times are not in seconds ({text[:24]!r}); convert them")
    if columns > 2 and not heads and source.column is None:
        raise RecordError(
            f"line {line} has {columns} columns without headings; give layout='rows' with dt= and units= if they are "
            "values of one component one after another, or column= a number from 1 for one of several components"
        )
    values = _values(source, line, columns)
    timed = [index for index in timed if heads[index] != "T" or (np.diff(values[:, index]) > 0.0).all()]
    first, passed = values[0, 0], np.diff(values[:, 0])
    rises = len(passed) > 1 and passed.min() > 0.0 and passed.max() < 3.0 * passed.min()
    untitled = not heads or bool(_INDEX_HEADING.fullmatch(heads[0]))
    time = -1 if columns == 1 else timed[0] if timed else 0 if rises or (columns == 2 and untitled) else -1
    if heads and time == columns - 1 and all(_INDEX_HEADING.fullmatch(head) for head in heads[:time]):
        raise RecordError(f"has no column of acceleration: its columns are headed {heads}")
    names = heads or [str(index + 1) for index in range(columns)]
    at = source.first_column
    chosen, column = source.choose({index + at: name for index, name in enumerate(names) if index != time})
    counts = time == 0 and not timed and first in (0.0, 1.0) and len(passed) > 0 and bool((passed == 1.0).all())
    if counts and source.dt is None and not steps:
        head = f", headed {heads[0]!r}," if heads else ""
        raise RecordError(
            f"its first column{head} counts by ones: points, or seconds? Give dt= in seconds (dt=1 if they are), "
            "or head the column 'time (s)'"
        )
    motions = np.abs(np.delete(values, [time] if time >= 0 else [], axis=1)).max(axis=1)
    if 2.0 * motions[0] > len(motions) > 9 and motions[0] > 20.0 * motions[1:].max() > 0.0:
        raise RecordError(
            f"line {line}: its first values are far above all others; delete that row if it belongs to the header"
        )
    if time < 0 or counts or (not timed and not untitled and (steps or source.dt is not None)):
        step = choose_step(source, steps)
    elif not timed and not untitled:
        raise RecordError(f"has no time step: its first column is headed {heads[0]!r}, not time; give dt= in seconds")
    else:

        def printed() -> Iterator[tuple[int, str]]:
            return ((place, _cells(text)[time]) for place, text in _rows(source, line))

        what = f"{heads[time]!r}, line {where}" if heads else f"times in column {time + 1}"
        step = step_of_times(source, values[:, time], printed, steps, what)
        # a row before the first, of which some value is no number, looks like a line of the header
        last = header[-1][1] if header else ""
        before = floats("".join(_cells(last)[:1]))
        if before and np.allclose(before, values[0, time] - step[0], rtol=1e-3, atol=1e-6):
            raise RecordError(f"{last[:24]!r} before line {line} is a row of data with a value that is no number")
    heading = [(where, heads[chosen - at])] if heads else []
    return values[:, chosen - at], step, heading, column, chosen


def _rows(source: RecordText, start: int) -> Iterator[tuple[int, str]]:
    """Go through the lines from one on that are neither blank nor remarks."""
    stripped = ((line, text.strip()) for line, text in enumerate(source.lines[start - 1 :], start))
    return ((line, text) for line, text in stripped if text and not text.startswith(_COMMENT))


def _values(source: RecordText, start: int, columns: int) -> Array:
    """Read the rows from a line on. Shape (rows, columns)."""
    lines = source.lines[start - 1 :]
    block = "\n".join(lines)
    values = None if re.search(_EMPTY_CELL, block) else plain_words(block)
    if values is None or {len(text.replace(",", " ").split()) for text in lines} - {0} != {columns}:
        rows: list[float] = []
        for line, row in _rows(source, start):
            wrapped = "; give layout='rows' with dt= and units= if its values wrap" if columns > 2 else ""
            if not (cells := _numbers(row)):
                raise RecordError(f"{not_a_number(line, row)}{wrapped}")
            if len(cells) != columns:
                raise RecordError(f"line {line} has {len(cells)} columns where line {start} has {columns}{wrapped}")
            rows += cells
        values = np.array(rows)
    check_points(values.size / columns)
    return values.reshape(-1, columns)


def _headings(line: str, row: str, columns: int) -> list[str]:
    """Split the line before the first row into the headings of its columns; nothing if it has another number."""
    plain = line.lstrip("#%!/ ")
    if columns == 1:
        return []
    separators = [next((sign for sign in ";,\t" if sign in text), " ") for text in (plain, row)]
    same = separators[0] == separators[1]
    if same:
        splits = [re.findall(_HEADING, plain) if separators[0] == " " else _cells(plain)]
    else:
        splits = [re.split(sign, plain) for sign in (r"\s*[;,]\s*", r"\s*\t\s*|\s{2,}")]
        if plain.startswith("DataSequence:"):  # of CWA: "DataSequence: Time U(+); N(+); E(+)"
            splits.append(re.findall("[A-Za-z]+", plain)[1:])
    for heads in splits:
        # two words are a title, unless they look like headings; numbers are none
        recognised = any(_TIME_HEADING.match(head) or re.search(r"[(\[]", head) for head in heads) or _SPECTRAL.match(
            plain
        )
        title = separators[0] == " " and columns == 2 and not recognised and not all(map(_COMPONENT.fullmatch, heads))
        if title or (any(map(NUMBER.fullmatch, heads)) and not _TIME_HEADING.match(heads[0])):
            continue
        if len(heads) == columns and (same or _TIME_HEADING.match(heads[0]) or _INDEX_HEADING.fullmatch(heads[0])):
            return [head.strip("\"' ") for head in heads]
    return []


def _cells(line: str) -> list[str]:
    """Split a row at semicolons (then a comma is the decimal sign), tabs, commas or blanks."""
    for fits, separator, decimal_comma in _SEPARATORS:
        if fits.search(line):
            cells = (line.replace(",", ".") if decimal_comma else line).split(separator)
            cells = [cell.strip(" \t\"'") for cell in cells]
            while cells and not cells[-1]:
                cells.pop()
            return cells
    cells = line.split()
    return NUMBER.findall(cells[0]) if len(cells) == 1 and RUN.fullmatch(cells[0]) else cells  # columns may touch


def _numbers(row: str) -> list[float] | None:
    """Return the numbers of the cells of a row; None if there are none or any cell is no number."""
    values: list[float] = []
    for cell in _cells(row):
        if "," in cell or not (value := floats(cell)) or len(value) > 1:
            return None
        values += value
    return values or None


# --- NIED's CSV and GeoCSV: columns behind one of dates; ObsPy's and IRIS' lists of values, perhaps with dates --------

_TRACE = rf"^TIMESERIES\s+([^\s,]+),\s*(\d{{1,9}}) samples,\s*({NUMBER.pattern} sps),[^,]*,[^,]*,[^,]*(?:,(.*))?$"


def _without_dates(lines: list[str]) -> list[str]:
    return [_DATE.sub("", re.sub(r"^(\W*)Time\s*[,;|]\s*", r"\1", text), 1) for text in lines]


def _parse_dated(source: RecordText) -> Content:
    content = parse_columns(replace(source, lines=_without_dates(source.lines), first_column=2))
    for _, line in source.find(r"^#Offset\W*$", last=MOST_HEADER):  # of NIED: what the recorder shows at rest
        heads, offsets = (_cells(text.lstrip("#")) for text in source.lines[line : line + 2])
        offset = dict(zip(heads, map(to_float, offsets), strict=True))[content.column or heads[0]]
        content = replace(content, values=content.values - offset)
    for _, line in source.find(r"^#DurationTime\(s\)", last=MOST_HEADER):  # in whole seconds
        points = round(to_float(source.lines[line].strip("#, ")) / content.step[0])
        if abs(points - len(content.values)) * content.step[0] > 1.0 + 1e-9:
            check_count(points, len(content.values), f"line {line + 1}")
    return content


def _parse_timeseries(source: RecordText) -> Content:
    traces = source.find(_TRACE)
    chosen, column = source.choose({i: match[1] for i, (match, _) in enumerate(traces, 1)})
    match, line = traces[chosen - 1]
    values = replace(source, lines=_without_dates(source.lines)).numbers(line + 1, int(match[2]), f"line {line}")
    units = [Stated(word, f"its last word, line {line}") for word in (match[4] or "").split()[:1]]
    step = choose_step(source, stated_steps(source, [(line, match[3])]))
    return Content(values, step, units, match[1], column=column)


# --- COSMOS: a line of points, step and unit above the values --------------------------------------------------------

_ABOVE = r"^\s*(\d{1,9})\s+(?:points of |raw )?(\w+)\.?\s+(?:pts,\s*approx|data equally spaced at|points at)"


def _parse_cosmos(source: RecordText) -> Content:
    above = source.find(_ABOVE)
    blocks = [(match, line) for match, line in above if match[2].lower().startswith("acc")]
    if not blocks:
        raise not_acceleration(above[0][0][2].lower(), f"line {above[0][1]}")
    headings = source.find(r"\bChan(?:nel)?\s*\d+")[::-1]
    names = (next((head[0] for head, at in headings if at < line), "a channel") for _, line in blocks)
    chosen, column = source.choose(dict(enumerate(names, 1)))
    match, line = blocks[chosen - 1]
    stated = [(line, " ".join(source.lines[line - 1][:MOST_HEADER].split()))]
    steps = stated_steps(source, stated)
    for _, start in source.find("real-header", last=line)[-1:]:
        real = floats(" ".join(source.lines[start : start + 17]))
        if real and len(real) > 61 and not steps:
            places = (1e-3 * real[61], 62), (real[33], 34)
            steps = [(step, f"real header, number {place}") for step, place in places if step > 0.0][:1]
    values = source.numbers(line + 1, int(match[1]), f"line {line}")
    title = " ".join(source.lines[0].split())
    step, peak = choose_step(source, steps), find_peak(source, line)
    return Content(values, step, stated_units(stated), title, column=column, peak=peak)


# --- GeoNet: for each component lines of text, perhaps 100 numbers, then values ten a row ----------------------------
# https://www.geonet.org.nz/data/supplementary/strong_motion_file_formats

_GEONET_POINTS = r"Number of points +(\d{1,9})"
_GEONET_UNIT = r"in units of +([\d.]+) +(\S+)|Acceleration: +peak +[-\d.]+ +(\S+)"


def _parse_geonet(source: RecordText) -> Content:
    starts = [line for _, line in source.find(r"^\s*(?:un)?corrected accelerogram")]
    parts = list(zip(starts, [*starts[1:], len(source.lines) + 1], strict=True))
    components = [source.find(r"^Component (\S+)", *part) for part in parts]
    names = {i: component[0][0][1] if component else "unnamed" for i, component in enumerate(components, 1)}
    chosen, column = source.choose(names)
    start, end = parts[chosen - 1]
    first = next((line for line in range(start, end) if floats(source.lines[line - 1]) is not None), end)
    steps = stated_steps(source, enumerate(source.lines[start - 1 : first - 1], start))
    points, (unit, line) = source.find(_GEONET_POINTS, start, first)[0][0], source.find(_GEONET_UNIT, start, first)[0]
    count, values = int(points[1]), replace(source, lines=source.lines[: end - 1]).numbers(first)
    if len(values) >= count + 100 and count in (values[30], values[33]):
        steps.append((float(values[65]), "number 66 of the header"))
        values = values[100:]
    if len(values) != 3 * count:  # velocity and displacement may follow
        check_count(count, len(values), f"line {start}")
    units = [Stated(unit[2] or unit[3], f"{unit[0]!r}, line {line}")]
    title = f"{source.lines[start].strip()}, {names[chosen]}"
    values, peak = values[:count] * float(unit[1] or 1.0), find_peak(source, first)
    return Content(values, choose_step(source, steps), units, title, column=column, peak=peak)


# --- K-NET and KiK-net: 17 lines of header, then counts of the recorder in rows of eight -----------------------------
# https://www.kyoshin.bosai.go.jp/kyoshin/man/knetform_en.html

_SCALE = rf"^Scale Factor\s+({NUMBER.pattern})\s*\(gal\)\s*/\s*(?=\S*[1-9])({NUMBER.pattern})"


def _parse_knet(source: RecordText) -> Content:
    end = [line for _, line in source.find("^Memo", last=18)]
    if not end:
        raise RecordError("has no line 'Memo.' at the end of its header; get the file again")
    step = choose_step(source, stated_steps(source, enumerate(source.lines[: end[0]], 1)))
    scales, durations = source.find(_SCALE), source.find(rf"^Duration Time\(s\)\s+({NUMBER.pattern})")
    if not scales or not durations:
        raise RecordError("has no line 'Scale Factor' or 'Duration Time(s)' with numbers; get the file again")
    (scale, _), (duration, line) = scales[0], durations[0]
    points = to_float(duration[1]) / step[0]
    check_points(points)
    motion = source.numbers(end[0] + 1)
    if len(motion) == 0 or abs(len(motion) - points) * step[0] > 1.0 + 1e-9:  # the header has whole seconds
        check_count(round(points), len(motion), f"line {line}")
    # Recorders have an offset; the maximum in the header is also that of the record without its mean.
    with np.errstate(invalid="ignore", over="ignore"):  # the record tells of what is not finite
        motion = (motion - motion.mean()) * (to_float(scale[1]) / to_float(scale[2]))
    fields = {text[:18].strip(): text[18:].strip() for text in source.lines[: end[0]]}
    title = f"{fields.get('Station Code')} {fields.get('Dir.')}, earthquake of {fields.get('Origin Time')}"
    return Content(motion, step, [Stated("gal", "Scale Factor, in gal")], title, peak=find_peak(source, end[0]))


# --- PEER: a header with the number of points and the time step, then accelerations row by row -----------------------

_POINTS = rf"\bNPTS\s*[=:]\s*(\d{{1,12}})(?!\d)|^\s*(\d{{1,12}})[\s,]+({NUMBER.pattern})[\s,]+NPTS\s*,"


def _parse_peer(source: RecordText) -> Content:
    place = source.find(r"\bNPTS\b", last=_HEAD + 1)[-1][1]  # the last of several headers is that of the values
    text = source.lines[place - 1].strip()
    points = re.search(_POINTS, text, re.IGNORECASE)
    if points is None:
        raise RecordError(
            f"line {place}: no readable number of points in {text[:24]!r}; write e.g. NPTS= 2000, DT= .02 SEC"
        )
    header = [(line, text[:MOST_HEADER]) for line, text in enumerate(source.lines[:place], 1)]
    steps = [(to_float(points[3]), f"{text[:60]!r}, line {place}")] if points[3] else stated_steps(source, header[-1:])
    if not steps and (steps := stated_steps(source, [(place + 1, "".join(source.lines[place : place + 1]))])):
        header.append((place + 1, ""))
    step = choose_step(source, steps or stated_steps(source, header[-2:-1]))
    check_quantity(header)
    values = source.numbers(len(header) + 1, int(points[1] or points[2]), "NPTS")
    titles = [line.strip() for _, line in header[: place - 1] if line.strip()]
    peer = source.file.suffix.lower() == ".at2" or bool(source.find(r"\bPEER\b|STRONG[ -]MOTION DATA", last=place))
    default = ("g", "AT2 files are in g unless they say otherwise") if peer else None
    # words behind IN that are no known unit, and factors between units, leave no default
    units, last = stated_units(header), len(header) + 1
    phrases = ([] if units else source.find(BEHIND_IN, last=last)) + source.find(rf"(?<!\d){CONVERTED}\S*", last=last)
    units += [Stated(match[match.re.groups].strip(), f"{match[0][:60]!r}, line {line}") for match, line in phrases]
    return Content(values, step, units, "".join(titles[:2][-1:]), default)


# --- SMC: 11 lines of text, 48 whole numbers, 50 numbers, remarks with |, then values in cm/s2 -----------------------
# https://escweb.wr.usgs.gov/nsmp-data/smcfmt.html


def _parse_smc(source: RecordText) -> Content:
    lines, title = source.lines, source.lines[0].strip()
    if match := re.search("velocity|displacement|spectra", title, re.IGNORECASE):
        raise not_acceleration(match[0].lower().replace("spectra", "a spectrum"), f"{title!r}, line 1")
    integers, real = (floats(" ".join(lines[first:last])) for first, last in ((11, 17), (17, 27)))
    if not integers or not real or len(integers) != 48 or len(real) != 50:
        raise RecordError("lines 12 to 27 are not the numbers of an SMC header; get the file again")
    where = f"second real number of the header, {real[1]:g} samples/s, line 18"
    steps = [(1.0 / (real[1] or float("nan")), where)] if real[1] < 1e38 else []  # 1.7e38: missing
    remarks, points = map(int, integers[15:17])
    first = 28 + remarks if remarks >= 0 else next(n for n, text in enumerate(lines[27:], 28) if text[:1] != "|")
    step, peak = choose_step(source, steps), find_peak(source, 12)
    values = source.numbers(first, points if points >= 0 else None, "the number of points")
    return Content(values, step, [Stated("cm/s2", "that of SMC files")], " ".join(lines[5].split()), peak=peak)


class Reader(NamedTuple):
    """One format of record files, an entry of `READERS`."""

    name: str  # what the format is called, for the documentation
    step: str  # where its time step stands, for the documentation
    unit: str  # where its unit stands
    suffixes: str  # endings that files of it have in folders, in lower case
    pattern: str  # what the first lines of a file of it match, in any case
    parser: str  # key of `_PARSERS`


_PARSERS: dict[str, Callable[[RecordText], Content]] = {
    "columns": parse_columns,
    "cosmos": _parse_cosmos,
    "dated": _parse_dated,
    "geonet": _parse_geonet,
    "knet": _parse_knet,
    "peer": _parse_peer,
    "smc": _parse_smc,
    "timeseries": _parse_timeseries,
}

READERS = tuple(Reader(**entry) for entry in read_data("records.toml")["format"])
"""All formats; the first one that matches reads a file."""

RECORD_SUFFIXES = tuple(dict.fromkeys(re.findall(r"\.\w+", " ".join(reader.suffixes for reader in READERS))))
"""File name endings taken for record files when a folder is searched."""


def read_record(
    path: FilePath,
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

    PEER AT2, the formats of networks, columns of time and acceleration, or acceleration alone: the content decides, not
    the file name. ``record.reading`` says where unit and step were read.

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
    RecordError
        If there is no such file (`MissingRecordError`), or it holds no record, another quantity, another number of
        points than its header says, values that are not finite, an uneven time step, several components without
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
    label = printable(str(file))
    if pga is not None and scale != 1.0:
        raise RecordError(f"{label}: scale={scale!r} and pga={pga!r} exclude each other; give one of them")
    wanted = None if units is None else match_unit(str(units))
    if units is not None and wanted is None:
        raise RecordError(unknown("acceleration unit", units, [*UNITS, "gal", "m/s^2", "m/s**2", "cm/s^2", "cm/s/s"]))
    dt = None if dt is None else number(dt, f"{label}: dt (s)", positive=True)
    if layout is not None:
        check_choice("layout", layout, _LAYOUTS, RecordError)
    try:
        text = load_text(file, file.stem if name is None else name)
        head, flags = "\n".join(text.lines[:_HEAD]), re.IGNORECASE | re.MULTILINE
        reader = next(reader for reader in READERS if re.search(reader.pattern, head, flags))
        source = replace(text, dt=dt, column=column, layout=layout, firm=reader is not READERS[-1])
        content = _PARSERS[reader.parser](source)
        unit, unit_from = choose_unit(content, wanted)
        if content.peak:
            check_peak(content.peak, content.values, unit)
        if "in place of" in unit_from:
            warnings.warn(f"{file}: units={wanted!r} is {unit_from}", UserWarning, stacklevel=2)
        with np.errstate(over="ignore"):
            motion = content.values * UNITS[unit]
        title = f"{content.title[:200]} ({file.name})" if content.title else file.name
        reading = Reading(unit, unit_from, content.step[1], content.column)
        if name is None:
            name = file.name if reader.parser == "knet" else file.stem  # the ending tells the component
        record = Record(name, content.step[0], motion, title, reading=reading)
        return record.scaled_to(pga) if pga is not None else record.scaled(scale)
    except MissingRecordError:
        raise
    except RecordError as error:
        raise RecordError(f"{label}: {error}") from None
    except (ArithmeticError, ValueError, LookupError) as error:  # numbers of a header that are none
        raise RecordError(f"{label}: its header is damaged ({error}); get the file again") from None
