"""K-NET and KiK-net ASCII of NIED, Japan: 17 lines of header, then counts of the recorder in rows of eight.

https://www.kyoshin.bosai.go.jp/kyoshin/man/knetform_en.html
"""

from __future__ import annotations

import re

import numpy as np

from pounding_sweep.records.reader import HEAD, NUMBER, Content, Reader, RecordText, StatedStep, in_quotes, to_float
from pounding_sweep.records.steps import choose_step
from pounding_sweep.records.units import StatedUnit

_RATE = re.compile(rf"({NUMBER.pattern})\s*Hz", re.ASCII | re.IGNORECASE)
_SCALE = re.compile(rf"({NUMBER.pattern})\s*\(gal\)\s*/\s*({NUMBER.pattern})", re.ASCII | re.IGNORECASE)
_SECONDS = re.compile(rf"({NUMBER.pattern})", re.ASCII)


def _parse(source: RecordText) -> Content:
    lines = source.text.split("\n", HEAD)[:HEAD]
    end = next((index for index, line in enumerate(lines) if line.startswith("Memo")), None)
    if end is None:
        source.fail("has no line 'Memo.' at the end of its header; get the file again")

    def said(key: str) -> str:
        return next((line[len(key) :].strip() for line in lines[:end] if line.startswith(key)), "")

    def positive(key: str, form: re.Pattern[str]) -> list[float]:
        match = form.fullmatch(said(key))
        values = [to_float(text) for text in match.groups()] if match else [0.0]
        if not all(0 < value < float("inf") for value in values):
            source.fail(f"its header says {in_quotes(said(key))} as {key!r}; get the file again")
        return values

    (rate,) = positive("Sampling Freq(Hz)", _RATE)
    full, counts = positive("Scale Factor", _SCALE)
    (seconds,) = positive("Duration Time(s)", _SECONDS)
    step = choose_step(source, [StatedStep(1 / rate, "Sampling Freq(Hz)", firm=True)])
    source.check_points(round(min(seconds * rate, 1e15)))
    values = source.numbers(end + 2)
    if len(values) == 0 or abs(len(values) - seconds * rate) > rate:  # the header has whole seconds
        source.fail(
            f"its header says {seconds:g} s at {rate:g} points per second, it holds {len(values)} points; "
            "get the file again"
        )
    # Recorders have an offset; the maximum in the header is also that of the record without its mean.
    with np.errstate(invalid="ignore", over="ignore"):  # what is not finite is told of by the record
        values = (values - values.mean()) * (full / counts)
    title = f"{said('Station Code')} {said('Dir.')}, earthquake of {said('Origin Time')}"
    unit = StatedUnit("gal", "Scale Factor, in gal")
    return Content(values, step, [unit], title, name=source.file.name)


READER = Reader(
    name="K-NET and KiK-net ASCII of NIED, one component a file",
    step="`Sampling Freq(Hz)`",
    unit="`Scale Factor`, in gal; the offset (mean) is taken out, as NIED does for the maximum in the header",
    suffixes=tuple(f".{component}{place}" for place in ("", 1, 2) for component in ("ns", "ew", "ud")),
    matches=lambda head: head[0].startswith("Origin Time"),
    parse=_parse,
)
