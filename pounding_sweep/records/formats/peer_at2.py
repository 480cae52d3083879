"""PEER's AT2 files: a header with the number of points and the time step, then accelerations row by row."""

from __future__ import annotations

import re
from collections.abc import Iterator

from pounding_sweep.records.reader import HEAD, NUMBER, STATED_DT, Content, Reader, RecordText, in_quotes

_NPTS = re.compile(r"\bNPTS\b", re.IGNORECASE)
_NPTS_NEW = re.compile(r"\bNPTS\s*[=:]\s*(\d{1,12})(?!\d)", re.ASCII | re.IGNORECASE)
_NPTS_OLD = re.compile(rf"^\s*(\d{{1,12}})[\s,]+({NUMBER.pattern})[\s,]+NPTS\s*,\s*DT", re.ASCII | re.IGNORECASE)
_NOT_ACCELERATION = re.compile(r"\b(VELOCITY|DISPLACEMENT)\s+TIME[ -](?:SERIES|HISTORY)", re.IGNORECASE)
_PEER = re.compile(r"\bPEER\b|STRONG[ -]MOTION DATA", re.IGNORECASE)


def _places(lines: list[str]) -> Iterator[int]:
    """Find the lines that speak of the number of points."""
    return (index for index, line in enumerate(lines) if _NPTS.search(line))


def _parse(source: RecordText, dt: float | None) -> Content:
    lines = source.text.split("\n", HEAD + 1)
    place = next(_places(lines))
    start = place + 1
    if start < len(lines) and STATED_DT.search(lines[start]):
        start += 1
    header = "\n".join(lines[:start])
    wrong = _NOT_ACCELERATION.search(header)
    if wrong:
        source.fail(f"holds {wrong[1].lower()}, not acceleration; take the .AT2 file of the same record")
    old = _NPTS_OLD.search(lines[place])
    points = old or _NPTS_NEW.search(header)
    if points is None:
        given = in_quotes(lines[place].strip())
        source.fail(f"line {place + 1}: no readable number of points in {given}; write e.g. NPTS= 2000, DT= .02 SEC")
    step = old[2] if old else (match[1] if (match := STATED_DT.search(header)) else None)
    dt = source.agreed_dt(step, dt)
    expected = int(points[1])
    source.check_points(expected)
    values = source.numbers(start + 1)
    if len(values) != expected or expected == 0:
        cause = "it was cut short" if len(values) < expected else "the header or the file is damaged"
        found_points = f"its header says {expected} points, it holds {len(values)}"
        source.fail(f"{found_points}: {cause}; get the file again, or mend NPTS")
    titles = [line.strip() for line in lines[:place] if line.strip()]
    title = titles[1] if len(titles) > 1 else "".join(titles)
    peer = bool(_PEER.search(header)) or source.file.suffix.lower() == ".at2"
    return Content(values, dt, header, title, "g" if peer else None)


READER = Reader(
    name="PEER AT2, old and NGA headers",
    needs="`NPTS` and `DT` in the header; in g unless it says otherwise",
    suffixes=(".at2",),
    told=lambda head: any(True for _ in _places(head)),
    parse=_parse,
)
