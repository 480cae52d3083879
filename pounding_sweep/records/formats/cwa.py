"""Text files of Taiwan's CWA: a header of lines with #, then the time and three components in columns."""

from __future__ import annotations

import re
from dataclasses import replace

from pounding_sweep.records.formats.columns import read_header, read_table
from pounding_sweep.records.reader import Content, Reader, RecordText, Stated, fields_of
from pounding_sweep.records.steps import field_step


def _parse(source: RecordText) -> Content:
    header, line, row = read_header(source)
    fields = fields_of(header)
    names = " ".join(re.findall(r"[A-Za-z]+", fields["DataSequence"].text))
    steps = field_step(source, fields, "SampleRate(Hz)", rate=True)
    content = read_table(source, [*header, (line, names)], line, row, steps)
    unit = fields.get("AmplitudeUnit")
    units = [Stated(re.split(r"[\s.]", unit.text)[0], unit.where)] if unit else []
    return replace(content, units=units, title=fields.get("StationCode", Stated("", "")).text)


READER = Reader(
    name="CWA of Taiwan, three components",
    step="`#SampleRate(Hz)`, and its times",
    unit="`#AmplitudeUnit`",
    suffixes=(".dat",),
    matches=lambda head: any(line.startswith("#DataSequence") for line in head),
    parse=_parse,
)
