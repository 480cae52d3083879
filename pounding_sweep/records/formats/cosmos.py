"""COSMOS and CSMIP (CDMG) volumes 1 and 2: headers, then a line of points, step and unit above the values."""

from __future__ import annotations

import re

from pounding_sweep.records.reader import Content, Reader, RecordText, Stated, StatedStep, not_acceleration, words
from pounding_sweep.records.steps import choose_step

_ABOVE = re.compile(
    r"\s*(\d{1,9})\s+(\w+)\s+pts,\s*approx\s+(?P<seconds>[\d.]+)\s*secs?,\s*units\s*=\s*([^,(]+)(?:\((?P<code>\d+)\))?"
    r"|\s*(\d{1,9})\s+points of (\w+) data equally spaced at\s*(?P<step>[\d.]+)\s*sec\w*[.,]?\s*(?:in\s+([^.()\s]+))?",
    re.IGNORECASE,
)
#: Units by their code in COSMOS's table.
_CODES = {"02": "g", "04": "cm/s2", "05": "cm/s", "06": "cm", "10": "gal", "11": "mg", "50": "counts"}


def _parse(source: RecordText) -> Content:
    above = [(line, match) for line, text in enumerate(source.lines, 1) if (match := _ABOVE.match(text))]
    blocks = [(line, match) for line, match in above if (match[2] or match[7]).lower().startswith("acc")]
    if not blocks:
        line, match = above[0]
        source.fail(not_acceleration((match[2] or match[7]).lower(), f"line {line}"))
    names = []
    for number, (line, _) in enumerate(blocks, 1):
        channels = (re.search(r"\bChan(?:nel)?\s*\d+", text) for text in source.lines[line - 2 :: -1])
        names.append(next((channel[0] for channel in channels if channel), f"channel {number}"))
    chosen = source.choose(names)
    line, match = blocks[chosen]
    points, where = int(match[1] or match[6]), f"{' '.join(match[0].split())!r}, line {line}"
    code = _CODES.get(match["code"], f"code {match['code']}") if match["code"] else None
    units = [Stated(text.strip(), where) for text in (match[4], match[9], code) if text]
    steps = [StatedStep(float(match["step"]), where, firm=True)] if match["step"] else _of_header(source, line)
    seconds = float(match["seconds"] or 0.0)
    if steps and seconds and abs(points * steps[0].value - seconds) > 1.0 + 0.05 * seconds:
        steps.append(StatedStep(seconds / points, where))
    values, step = source.exactly(line + 1, points, f"line {line}"), choose_step(source, steps)
    column = names[chosen] if len(names) > 1 else None
    return Content(values, step, units, " ".join(source.lines[0].split()), column=column)


def _of_header(source: RecordText, line: int) -> list[StatedStep]:
    """Return the step of the last real header above a line: its number 62 in ms, or else 34 in s."""
    start = next((i for i in range(line - 1, 0, -1) if "real-header" in source.lines[i - 1].lower()), line)
    real = words(" ".join(source.lines[start : start + 17]))
    places = () if isinstance(real, str) or len(real) < 62 else ((1e-3 * real[61], 62), (real[33], 34))
    return [StatedStep(step, f"real header, number {place}", firm=True) for step, place in places if step > 0.0][:1]


READER = Reader(
    name="COSMOS and CSMIP (CDMG), volumes 1 and 2",
    step="the real header (numbers 62 or 34), or `equally spaced at`",
    unit="`units=` or `in` above the values",
    suffixes=(".v1", ".v2", ".v1c", ".v2c"),
    matches=lambda head: any("real-header" in text.lower() or _ABOVE.match(text) for text in head),
    parse=_parse,
)
