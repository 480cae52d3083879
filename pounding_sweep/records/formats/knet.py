"""K-NET and KiK-net ASCII of NIED, Japan: 17 lines of header, then counts of the recorder in rows of eight.

https://www.kyoshin.bosai.go.jp/kyoshin/man/knetform_en.html
"""

from __future__ import annotations

import re

import numpy as np

from pounding_sweep.records.reader import NUMBER, Content, Reader, RecordText, Stated, StatedStep, in_quotes, to_float
from pounding_sweep.records.steps import choose_step

_N = NUMBER.pattern
#: What the header states in numbers, each in its form.
_FORMS = {
    "Sampling Freq(Hz)": rf"({_N})\s*Hz",
    "Scale Factor": rf"({_N})\s*\(gal\)\s*/\s*({_N})",
    "Duration Time(s)": rf"({_N})",
}


def _parse(source: RecordText) -> Content:
    end = next((index for index, line in enumerate(source.lines[:17]) if line.startswith("Memo")), None)
    if end is None:
        source.fail("has no line 'Memo.' at the end of its header; get the file again")
    said = {line[:18].strip(): line[18:].strip() for line in source.lines[:end]}
    numbers: list[float] = []
    for key, form in _FORMS.items():
        match = re.fullmatch(form, said.get(key, ""), re.ASCII | re.IGNORECASE)
        values = [to_float(text) for text in match.groups()] if match else [0.0]
        if not all(0 < value < float("inf") for value in values):
            source.fail(f"its header says {in_quotes(said.get(key, ''))} as {key!r}; get the file again")
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
    title = f"{said.get('Station Code')} {said.get('Dir.')}, earthquake of {said.get('Origin Time')}"
    return Content(motion, step, [Stated("gal", "Scale Factor, in gal")], title, name=source.file.name)


READER = Reader(
    name="K-NET and KiK-net ASCII of NIED, one component a file",
    step="`Sampling Freq(Hz)`",
    unit="`Scale Factor`, in gal; the offset (mean) is taken out, as NIED does for the maximum in the header",
    suffixes=tuple(f".{component}{place}" for place in ("", 1, 2) for component in ("ns", "ew", "ud")),
    matches=lambda head: head[0].startswith("Origin Time"),
    parse=_parse,
)
