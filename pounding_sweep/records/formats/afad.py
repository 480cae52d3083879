"""Text files of AFAD (Türkiye's strong-motion network): three components in columns."""

from __future__ import annotations

from dataclasses import replace

from pounding_sweep.records.formats.columns import read_header, read_table
from pounding_sweep.records.reader import Content, Reader, RecordText


def _parse(source: RecordText) -> Content:
    header, line, row = read_header(source)
    fields = source.fields(header)
    fields.check_quantity("DATA TYPE")
    content = read_table(source, header, line, row, fields.step("SAMPLING INTERVAL (sec)"))
    points = fields.number("NUMBER OF DATA")
    if len(content.values) != points:
        source.fail(f"its header says {points:g} points, it holds {len(content.values)}; get the file again")
    return replace(content, title=", ".join(fields.get(key, "") for key in ("PLACE", "EARTHQUAKE DATE")))


READER = Reader(
    name="AFAD, three components",
    step="`SAMPLING INTERVAL (sec)`",
    unit="`UNITS`",
    suffixes=(".txt",),
    matches=lambda head: "STRONG GROUND MOTION RECORDS OF TURK" in head[0].upper(),
    parse=_parse,
)
