"""Text files of Taiwan's CWA: a header of lines with #, then the time and three components in columns."""

from __future__ import annotations

import re
from dataclasses import replace

from pounding_sweep.records.formats.columns import read_header, read_table
from pounding_sweep.records.reader import Content, Reader, RecordText
from pounding_sweep.records.units import StatedUnit


def _parse(source: RecordText) -> Content:
    header, line, row = read_header(source)
    fields = source.fields(header)
    names = re.findall(r"[A-Za-z]+", fields.get("DataSequence", "Time U N E"))
    content = read_table(
        source, [*header, (line, " ".join(names))], line, row, fields.step("SampleRate(Hz)", rate=True)
    )
    unit = re.match(r"[^\s.]*", fields.get("AmplitudeUnit", ""))
    units = [StatedUnit(unit[0], fields.where("AmplitudeUnit"))] if unit and unit[0] else []
    return replace(content, units=units, title=f"{fields.get('StationCode', '')} {fields.get('StartTime', '')}".strip())


READER = Reader(
    name="CWA of Taiwan, three components",
    step="`#SampleRate(Hz)`, and its times",
    unit="`#AmplitudeUnit`",
    suffixes=(".dat",),
    matches=lambda head: any(line.startswith("#DataSequence") for line in head),
    parse=_parse,
)
