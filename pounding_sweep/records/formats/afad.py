"""Text files of AFAD (Türkiye's strong-motion network): three components in columns."""

from __future__ import annotations

from pounding_sweep.records.formats.columns import read_header, read_table
from pounding_sweep.records.reader import Content, Reader, RecordText, fields_of
from pounding_sweep.records.steps import field_step


def _parse(source: RecordText) -> Content:
    header, line, row = read_header(source)
    fields = fields_of(header)
    source.check_quantity(fields, "DATA TYPE")
    content = read_table(source, header, line, row, field_step(source, fields, "SAMPLING INTERVAL (sec)"))
    points = source.number(fields, "NUMBER OF DATA")
    if len(content.values) != points:
        source.fail(f"its header says {points:g} points, it holds {len(content.values)}; get the file again")
    return content


READER = Reader(
    name="AFAD, three components",
    step="`SAMPLING INTERVAL (sec)`",
    unit="`UNITS`",
    suffixes=(".txt",),
    matches=lambda head: "STRONG GROUND MOTION RECORDS OF TURK" in head[0].upper(),
    parse=_parse,
)
