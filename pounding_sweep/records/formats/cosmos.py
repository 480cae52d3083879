"""COSMOS and CSMIP (CDMG) volumes 1 and 2: headers, then a line of points, step and unit above the values."""

from __future__ import annotations

import re

from pounding_sweep.records.reader import NUMBER, Content, Reader, RecordText, StatedStep, to_float, words
from pounding_sweep.records.steps import choose_step
from pounding_sweep.records.units import StatedUnit

_COSMOS = re.compile(
    r"\s*(\d{1,9})\s+(\w+)\s+pts,\s*approx\s+([\d.]+)\s*secs?,\s*units\s*=\s*([^,(]+)(?:\((\d+)\))?", re.I
)
_CSMIP = re.compile(
    rf"\s*(\d{{1,9}})\s+points of (\w+) data equally spaced at\s*({NUMBER.pattern})\s*sec\w*[.,]?\s*"
    r"(?:\(?(?:in|units?:)\s+([^.()\s]+))?",
    re.IGNORECASE,
)
#: Units by their code in COSMOS's table.
_CODES = {2: "g", 4: "cm/s2", 5: "cm/s", 6: "cm", 10: "gal", 11: "mg", 50: "counts"}


def _parse(source: RecordText) -> Content:
    lines = source.text.split("\n")
    matches = [(number, _COSMOS.match(text) or _CSMIP.match(text)) for number, text in enumerate(lines, 1)]
    heads = [(number, match) for number, match in matches if match]
    blocks = [(number, match) for number, match in heads if match[2].lower().startswith("acc")]
    if not heads:
        source.fail("has no line of points, step and unit above its values; get the file again")
    if not blocks:
        source.fail(
            f"holds {heads[0][1][2].lower()}, not acceleration (line {heads[0][0]}); take that of the acceleration"
        )
    names = [_channel(lines[:number], place) for place, (number, _) in enumerate(blocks, 1)]
    chosen = source.choose(names)
    line, match = blocks[chosen]
    units = [StatedUnit(match[4].strip(), f"{match[4].strip()}, line {line}")] if match[4] else []
    if match.re is _CSMIP:
        steps = [StatedStep(to_float(match[3]), f"{match[3]} sec, line {line}", firm=True)]
    else:
        units += (
            [StatedUnit(_CODES.get(int(match[5]), f"code {match[5]}"), f"({match[5]}), line {line}")]
            if match[5]
            else []
        )
        steps = _real_header(lines[: line - 1], int(match[1]), to_float(match[3]))
    step = choose_step(source, steps)
    values = source.exactly(line + 1, int(match[1]), f"line {line}")
    return Content(values, step, units, " ".join(lines[0].split()), column=names[chosen] if len(names) > 1 else None)


def _channel(before: list[str], place: int) -> str:
    return next(
        (m[0] for text in reversed(before) if (m := re.search(r"\bChan(?:nel)?\s*\d+", text))), f"channel {place}"
    )


def _real_header(before: list[str], points: int, seconds: float) -> list[StatedStep]:
    """Return the steps that the real header above the values states, and a wholly different one by the duration."""
    start = max(i for i, text in enumerate(["Real-header", *before]) if "real-header" in text.lower())
    real = words(" ".join(before[start : start + 17]))
    steps = [(real[61] * 1e-3, 62), (real[33], 34)] if not isinstance(real, str) and len(real) >= 62 else []
    found = [StatedStep(step, f"real header, number {place}", firm=True) for step, place in steps if step > 0.0][:1]
    if found and seconds and abs(points * found[0].value - seconds) > 1.0 + 0.05 * seconds:
        found.append(StatedStep(seconds / points, f"approx {seconds:g} secs of {points} points"))
    return found


READER = Reader(
    name="COSMOS and CSMIP (CDMG), volumes 1 and 2",
    step="the real header (numbers 62 or 34), or `equally spaced at`",
    unit="`units=` or `in` above the values",
    suffixes=(".v1", ".v2", ".v1c", ".v2c"),
    matches=lambda head: any(
        "real-header" in text.lower() or _COSMOS.match(text) or _CSMIP.match(text) for text in head
    ),
    parse=_parse,
)
