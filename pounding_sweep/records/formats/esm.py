"""ESM and ITACA .ASC files (DYNA headers), also of AFAD's newer ones: one component, a value a line."""

from __future__ import annotations

from pounding_sweep.records.formats.columns import read_header
from pounding_sweep.records.reader import Content, Reader, RecordText
from pounding_sweep.records.steps import choose_step
from pounding_sweep.records.units import StatedUnit


def _parse(source: RecordText) -> Content:
    header, line, _ = read_header(source)
    fields = source.fields(header)
    fields.check_quantity("DATA_TYPE")
    step = choose_step(source, fields.step("SAMPLING_INTERVAL_S"))
    values = source.exactly(line, int(fields.number("NDATA")), "NDATA")
    units = [StatedUnit(fields["UNITS"], fields.where("UNITS"))] if "UNITS" in fields else []
    title = ", ".join(fields[key] for key in ("EVENT_NAME", "STATION_CODE", "STREAM") if fields.get(key))
    return Content(values, step, units, title)


READER = Reader(
    name="ESM and ITACA .ASC",
    step="`SAMPLING_INTERVAL_S`",
    unit="`UNITS`",
    suffixes=(".asc",),
    matches=lambda head: any(line.startswith("SAMPLING_INTERVAL_S") for line in head),
    parse=_parse,
)
