"""SMC files of the USGS: 11 lines of text, 48 whole numbers, 50 numbers, remarks with |, then values in cm/s2.

https://escweb.wr.usgs.gov/nsmp-data/smcfmt.html
"""

from __future__ import annotations

import re

from pounding_sweep.records.reader import Content, Reader, RecordText, Stated, StatedStep, not_acceleration, words
from pounding_sweep.records.steps import choose_step

_FIRST = re.compile(r"\s*\d\s+(?:(?:UN)?CORRECTED\s+ACCELEROGRAM|VELOCITY|DISPLACEMENT)", re.IGNORECASE)


def _parse(source: RecordText) -> Content:
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


READER = Reader(
    name="USGS SMC",
    step="the second real number of the header, samples/s",
    unit="cm/s2, by the definition of the format",
    suffixes=(".smc",),
    matches=lambda head: bool(_FIRST.match(head[0])),
    parse=_parse,
)
