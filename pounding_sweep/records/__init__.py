"""Ground-motion records: reading, finding, scaling and making them."""

from pounding_sweep.records.catalogue import (
    KNOWN_RECORDS,
    RECORDS_VARIABLE,
    KnownRecord,
    find_record,
    list_records,
    resolve_records,
)
from pounding_sweep.records.reading import MAX_FILE_BYTES, RECORD_SUFFIXES, read_record
from pounding_sweep.records.record import STANDARD_GRAVITY, UNITS, Record
from pounding_sweep.records.synthetic import PULSES, Pulse, pulse_record, synthetic_record

__all__ = [
    "KNOWN_RECORDS",
    "MAX_FILE_BYTES",
    "PULSES",
    "RECORDS_VARIABLE",
    "RECORD_SUFFIXES",
    "STANDARD_GRAVITY",
    "UNITS",
    "KnownRecord",
    "Pulse",
    "Record",
    "find_record",
    "list_records",
    "pulse_record",
    "read_record",
    "resolve_records",
    "synthetic_record",
]
