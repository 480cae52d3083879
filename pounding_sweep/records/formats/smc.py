"""SMC files of the USGS: 11 lines of text, 48 whole numbers, 50 numbers, remarks with |, then values in cm/s2.

https://escweb.wr.usgs.gov/nsmp-data/smcfmt.html
"""

from __future__ import annotations

import re

from pounding_sweep.records.reader import Content, Reader, RecordText, StatedStep, words
from pounding_sweep.records.steps import choose_step
from pounding_sweep.records.units import StatedUnit

_FIRST = re.compile(r"\s*\d\s+(?:(?:UN)?CORRECTED\s+ACCELEROGRAM|VELOCITY|DISPLACEMENT)", re.IGNORECASE)


def _parse(source: RecordText) -> Content:
    lines = source.text.split("\n", 28)
    kind = lines[0].split()[-1].lower()
    if kind in ("velocity", "displacement"):
        source.fail(f"holds {kind}, not acceleration ({lines[0].strip()!r}, line 1); take the file of the acceleration")
    whole, real = (words(" ".join(lines[first:last])) for first, last in ((11, 17), (17, 27)))
    if isinstance(whole, str) or isinstance(real, str) or len(whole) != 48 or len(real) != 50:
        source.fail("lines 12 to 27 are not the numbers of an SMC header; get the file again")
    remarks, points, rate = int(whole[15]), int(whole[16]), real[1]
    where = f"second real number of the header, {rate:g} samples/s, line 18"
    step = choose_step(source, [StatedStep(1 / rate if rate > 0 else -1.0, where, firm=True)])
    values = source.exactly(28 + max(remarks, 0), points, "the number of points")
    return Content(values, step, [StatedUnit("cm/s2", "that of SMC files")], " ".join(lines[5].split()))


READER = Reader(
    name="USGS SMC",
    step="the second real number of the header, samples/s",
    unit="cm/s2, by the definition of the format",
    suffixes=(".smc",),
    matches=lambda head: bool(_FIRST.match(head[0])),
    parse=_parse,
)
