"""Ground-motion records: reading, finding, scaling and making them."""

# ruff: noqa: F401  names of the package

from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.records.catalogue import (
    NAMED_RECORDS,
    RECORD_SETS,
    RECORDS_VARIABLE,
    NamedRecord,
    RecordSet,
    find_record,
    list_records,
    read_record_set,
    resolve_record,
    resolve_records,
)
from pounding_sweep.records.formats import RECORD_SUFFIXES, read_record
from pounding_sweep.records.reader import MAX_FILE_BYTES, UNITS
from pounding_sweep.records.record import Reading, Record, RecordMeasures, record_measures, records_dataset
from pounding_sweep.records.synthetic import PULSES, near_fault_record, pulse_record, synthetic_record
