"""ESM and ITACA .ASC files (DYNA headers), also AFAD's newer ones: one component, a value a line."""

from __future__ import annotations

from pounding_sweep.records.formats.columns import read_header
from pounding_sweep.records.reader import Content, Reader, RecordText, fields_of
from pounding_sweep.records.steps import choose_step, field_step


def _parse(source: RecordText) -> Content:
    header, line, _ = read_header(source)
    fields = fields_of(header)
    source.check_quantity(fields, "DATA_TYPE")
    values = source.exactly(line, int(source.number(fields, "NDATA")), "NDATA")
    title = ", ".join(fields[key].text for key in ("EVENT_NAME", "STATION_CODE", "STREAM") if key in fields)
    step = choose_step(source, field_step(source, fields, "SAMPLING_INTERVAL_S"))
    return Content(values, step, [fields["UNITS"]] if "UNITS" in fields else [], title)


READER = Reader(
    name="ESM and ITACA .ASC",
    step="`SAMPLING_INTERVAL_S`",
    unit="`UNITS`",
    suffixes=(".asc",),
    matches=lambda head: any(line.startswith("SAMPLING_INTERVAL_S") for line in head),
    parse=_parse,
)
