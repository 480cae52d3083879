"""PEER's AT2 files: a header with the number of points and the time step, then accelerations row by row."""

from __future__ import annotations

import re

from pounding_sweep.records.reader import (
    HEAD,
    NUMBER,
    Content,
    Reader,
    RecordText,
    StatedStep,
    in_quotes,
    not_acceleration,
    to_float,
)
from pounding_sweep.records.steps import choose_step, stated_steps
from pounding_sweep.records.units import other_quantity, stated_units

_NPTS = re.compile(r"\bNPTS\b", re.IGNORECASE)
_TOLD = re.compile(r"^[^#%!]*\bNPTS\s*(?:[=:]|,\s*DT)", re.IGNORECASE)
_POINTS = re.compile(r"\bNPTS\s*[=:]\s*(\d{1,12})(?!\d)", re.ASCII | re.IGNORECASE)
_OLD = re.compile(rf"^\s*(\d{{1,12}})[\s,]+({NUMBER.pattern})[\s,]+NPTS\s*,\s*DT", re.ASCII | re.IGNORECASE)
_PEER = re.compile(r"\bPEER\b|STRONG[ -]MOTION DATA", re.IGNORECASE)
#: What follows the line of NPTS that is that of the values: perhaps a line of DT, then a number.
_VALUES = re.compile(r"\s*(?:[^\n]*\bDT\b[^\n]*\s+)?[-+]?\.?\d", re.IGNORECASE)


def _parse(source: RecordText) -> Content:
    lines = list(enumerate(source.lines[:HEAD], 1))
    places = [line for line, text in lines if _NPTS.search(text)]
    # Where headers stand above each other, the last one is that of the values.
    place = next(
        (line for line in reversed(places) if _VALUES.match("\n".join(text for _, text in lines[line:]))), places[0]
    )
    text = lines[place - 1][1]
    old = _OLD.search(text)
    points = old or _POINTS.search(text)
    if points is None:
        shown = in_quotes(text.strip())
        source.fail(f"line {place}: no readable number of points in {shown}; write e.g. NPTS= 2000, DT= .02 SEC")
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


READER = Reader(
    name="PEER AT2, old and NGA headers",
    step="`DT` on the line of `NPTS`, or next to it",
    unit="`IN UNITS OF`, `IN CM/S/S`; else g",
    suffixes=(".at2",),
    matches=lambda head: any(_TOLD.search(line) for line in head),
    parse=_parse,
)
