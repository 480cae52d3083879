"""GeoNet's V1A and V2A files: for each component lines of text, perhaps 100 numbers, then values ten a row.

https://www.geonet.org.nz/data/supplementary/strong_motion_file_formats
"""

from __future__ import annotations

import re
from dataclasses import replace

from pounding_sweep.records.reader import Content, Reader, RecordText, Stated, StatedStep, words
from pounding_sweep.records.steps import choose_step

_FIRST = re.compile(r"\s*(?:un)?corrected accelerogram", re.IGNORECASE)
_POINTS = re.compile(r"Number of points +(\d{1,9})", re.IGNORECASE)
_STEP = re.compile(r"\bat (?:intervals of )?([\d.]+) s(?:ec intervals)?\s*$", re.IGNORECASE)
_UNIT = re.compile(r"in units of +([\d.]+) +(\S+)|Acceleration: +peak +[-\d.]+ +(\S+)", re.IGNORECASE)


def _parse(source: RecordText) -> Content:
    starts = [index for index, text in enumerate(source.lines) if _FIRST.match(text)]
    parts = zip(starts, [*starts[1:], len(source.lines)], strict=True)
    heads = [[text for text in source.lines[a : min(a + 26, b)] if isinstance(words(text), str)] for a, b in parts]
    names = [next((text.split()[1] for text in head if text.startswith("Component ")), "unnamed") for head in heads]
    chosen = source.choose(names)
    head, start, end = heads[chosen], starts[chosen], [*starts, len(source.lines)][chosen + 1]

    def search(pattern: re.Pattern[str]) -> list[tuple[re.Match[str], str]]:
        lines = enumerate(head, start + 1)
        return [(match, f"{match[0]!r}, line {line}") for line, text in lines if (match := pattern.search(text))]

    points = int(search(_POINTS)[0][0][1])
    values = replace(source, lines=source.lines[:end]).numbers(start + len(head) + 1)
    steps = [StatedStep(float(match[1]), where, firm=True) for match, where in search(_STEP)]
    if len(values) >= points + 100 and points in (values[30], values[33]):
        steps.append(StatedStep(float(values[65]), "number 66 of the header", firm=True))
        values = values[100:]
    if points == 0 or len(values) not in (points, 3 * points):
        source.fail(f"its header says {points} points, it holds {len(values)}; get the file again")
    (unit, where), *_ = search(_UNIT)
    motion = values[:points] * float(unit[1] or 1.0)  # velocity and displacement may follow
    title, column = f"{source.lines[start + 1].strip()}, {names[chosen]}", names[chosen] if len(names) > 1 else None
    return Content(motion, choose_step(source, steps), [Stated(unit[2] or unit[3], where)], title, column=column)


READER = Reader(
    name="GeoNet V1A and V2A",
    step="`data at ... sec intervals`, `at intervals of`",
    unit="`in units of`, or that of its peak",
    suffixes=(".v1a", ".v2a"),
    matches=lambda head: bool(_FIRST.match(head[0])) and any(_POINTS.search(text) for text in head),
    parse=_parse,
)
