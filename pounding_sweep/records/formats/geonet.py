"""GeoNet's V1A and V2A files: for each component lines of text, perhaps 100 numbers, then values ten a row.

https://www.geonet.org.nz/data/supplementary/strong_motion_file_formats
"""

from __future__ import annotations

import re
from dataclasses import replace

from pounding_sweep.records.reader import NUMBER, Content, Reader, RecordText, StatedStep, to_float, words
from pounding_sweep.records.steps import choose_step
from pounding_sweep.records.units import StatedUnit

_FIRST = re.compile(r"\s*(?:un)?corrected accelerogram", re.IGNORECASE)
_POINTS = re.compile(r"Number of points\s+(\d{1,9})", re.IGNORECASE)
_STEP = re.compile(rf"\bat (?:intervals of )?({NUMBER.pattern})\s*s(?:ec)?\b", re.IGNORECASE)
_RAW = re.compile(rf"in units of\s+({NUMBER.pattern})\s*(\S+)", re.IGNORECASE)
_PEAK = re.compile(rf"Acceleration:\s*peak\s+{NUMBER.pattern}\s*(\S+)", re.IGNORECASE)


def _parse(source: RecordText) -> Content:
    lines = source.text.split("\n")
    starts = [index for index, text in enumerate(lines) if _FIRST.match(text)]
    parts = [list(enumerate(lines))[first:last] for first, last in zip(starts, [*starts[1:], len(lines)], strict=True)]
    heads = [[item for item in part[:26] if isinstance(words(item[1]), str)] for part in parts]
    names = [
        next((m[1] for _, t in head if (m := re.match(r"Component\s+(\S+)", t))), f"{i}")
        for i, head in enumerate(heads, 1)
    ]
    chosen = source.choose(names)
    head, part = heads[chosen], parts[chosen]

    def search(*patterns: re.Pattern[str]) -> tuple[re.Match[str], str] | None:
        found = ((m, f"{m[0]}, line {i + 1}") for p in patterns for i, text in head if (m := p.search(text)))
        return next(found, None)

    count, unit = search(_POINTS), search(_RAW, _PEAK)
    if count is None:
        return source.fail("has no line 'Number of points' in its header; get the file again")
    points, first = int(count[0][1]), head[-1][0] + 1
    part_text = "\n" * first + "\n".join(lines[first : part[-1][0] + 1])
    values = replace(source, text=part_text).numbers(first + 1)
    steps = [
        StatedStep(to_float(m[1]), f"{m[0]}, line {i + 1}", firm=True)
        for i, t in head
        if "eak" not in t
        for m in _STEP.finditer(t)
    ]
    numbered = len(values) >= points + 100 and points in (values[30], values[33])
    steps += [StatedStep(float(values[65]), "number 66 of the header", firm=True)] if numbered else []
    start = 100 if numbered else 0  # velocity and displacement may follow
    if points == 0 or (
        len(values) - start not in (points, 3 * points) and not (numbered and len(values) - start > points)
    ):
        source.fail(f"its header says {points} points, it holds {len(values) - start}; get the file again")
    scale = to_float(unit[0][1]) if unit and unit[0].re is _RAW else 1.0
    units = [StatedUnit(unit[0][unit[0].re.groups], unit[1])] if unit else []
    title = f"{' '.join(lines[1].split())}, {names[chosen]}"
    column = names[chosen] if len(names) > 1 else None
    return Content(values[start : start + points] * scale, choose_step(source, steps), units, title, column=column)


READER = Reader(
    name="GeoNet V1A and V2A",
    step="`data at ... sec intervals`, `at intervals of`",
    unit="`in units of`, or that of its peak",
    suffixes=(".v1a", ".v2a"),
    matches=lambda head: bool(_FIRST.match(head[0])) and any(_POINTS.search(text) for text in head),
    parse=_parse,
)
