"""Tables of a sweep that describe its scene, its records and its design."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field, ValidationInfo

from pounding_sweep.base.errors import InputError, SweepError, shown
from pounding_sweep.base.files import expanded
from pounding_sweep.model.faults import Number, Table, called, key, number, one_of
from pounding_sweep.records import Record, find_record, near_fault_record, pulse_record, read_record, synthetic_record
from pounding_sweep.records.catalogue import Folders
from pounding_sweep.spec.axes import Range
from pounding_sweep.spec.design import KINDS, POWERS

#: More values than this on one axis are refused.
MAX_AXIS = 1_000_000


def _reaches(count: int, info: ValidationInfo) -> int:
    start, stop = info.data.get("start"), info.data.get("stop")
    if count == 1 and start != stop:
        raise InputError(f"1 value can't reach from start {shown(start)} to stop {shown(stop)}; give at least 2")
    return count


def _spaces(spacing: str, info: ValidationInfo) -> str:
    start, stop = info.data.get("start"), info.data.get("stop")
    if spacing == "log" and not ((start or 0) > 0 and (stop or 0) > 0):
        raise InputError(f"log needs start and stop above 0, not {shown(start)} and {shown(stop)}")
    return spacing


class RangeTable(Table):
    """An axis as evenly spaced values."""

    start: Number = number("the first value")
    stop: Number = number("the last value")
    count: Annotated[int, AfterValidator(_reaches)] = Field(
        ge=1, le=MAX_AXIS, description=f"a whole number from 1 to {MAX_AXIS}, how many values"
    )
    spacing: Annotated[Any, one_of("spacing", ("linear", "log")), AfterValidator(_spaces)] = key("a text", "linear")


def read_range(value: Range | dict[str, Any]) -> Range:
    """Check evenly spaced values, given as a table or as such."""
    return Range(**dict(RangeTable.model_validate(value if isinstance(value, dict) else vars(value))))


def _balanced(samples: int, info: ValidationInfo) -> int:
    kind, below = info.data.get("kind"), 1 << (samples.bit_length() - 1)
    if samples != below and kind in POWERS:
        raise InputError(
            f"{kind} points are balanced at powers of 2 only, and {samples} is none; give {below} or {2 * below}"
        )
    return samples


class DesignTable(Table):
    """[design]: inputs that are drawn."""

    kind: Annotated[Any, one_of("kind of design", KINDS)] = key(f"one of {', '.join(KINDS)}")
    samples: Annotated[int, AfterValidator(_balanced)] = Field(ge=1, description="a whole number of points, at least 1")
    seed: int = Field(0, ge=0, description="a whole number, at least 0")
    inputs: dict[str, Any] = key("tables [design.inputs] of distributions by the name of an axis")


def _named(
    record: str, *, name: str | None = None, scale: float = 1.0, pga: float | None = None, folders: Any = None
) -> Record:
    """Find a record by name, and scale or rename it."""
    found = find_record(record, folders)
    if pga is not None and scale != 1.0:
        raise SweepError("scale and pga exclude each other; give one of them")
    found = found.scaled(scale) if pga is None else found.scaled_to(pga)
    return found if name is None else found.renamed(name)


#: Kinds of record tables, by the key that tells them, with what makes the record.
RECORD_TABLES: dict[str, Callable[..., Record]] = {
    "path": read_record,
    "record": _named,
    "synthetic": synthetic_record,
    "pulse": pulse_record,
    "near_fault": near_fault_record,
}
#: Keys of records that exist: the spectral acceleration that they are scaled to, and its period.
SPECTRAL = ("sa", "sa_period")


def record_of_table(value: Any, folder: Path, folders: Folders) -> Record:
    """Make the record that a table describes."""
    kinds = [kind for kind in RECORD_TABLES if isinstance(value, dict) and kind in value]
    if len(kinds) != 1:
        what = f"has {' and '.join(kinds)}" if kinds else f"{shown(value)} won't do"
        raise InputError(f"{what}; give a name, a path, or a table with one of {', '.join(RECORD_TABLES)}")
    (kind,) = kinds
    table, make = dict(value), RECORD_TABLES[kind]
    if kind == "path" and isinstance(table["path"], str):
        table["path"] = folder / expanded(table["path"])
    more = {"folders": folders} if kind == "record" else {}
    spectral = SPECTRAL if kind in ("path", "record") else ()
    sa, period = (table.pop(name, None) if spectral else None for name in SPECTRAL)
    if sa is period is None:
        return called(make, table, kind, spectral, **more)
    if sa is None or period is None:
        raise SweepError(
            "sa and sa_period belong together: a spectral acceleration (m/s2) and its period (s); give both"
        )
    for name in ("pga", "scale"):
        if name in table:
            raise SweepError(f"sa and {name} exclude each other; give one of them")
    from pounding_sweep.engine.spectrum import scaled_to_sa

    record = called(make, table, kind, SPECTRAL, **more)
    return called(scaled_to_sa, {"sa": sa, "period": period}, record=record)
