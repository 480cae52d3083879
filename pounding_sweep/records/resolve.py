"""Turning what a user gives - records, paths, names, names of sets - into records."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from pounding_sweep.base.errors import MissingRecordError, RecordError, shown
from pounding_sweep.base.paths import expanded
from pounding_sweep.records.catalogue import Folders, find_record, plain_name
from pounding_sweep.records.fema_p695 import RECORD_SETS, read_record_set
from pounding_sweep.records.formats import RECORD_SUFFIXES
from pounding_sweep.records.reading import read_record
from pounding_sweep.records.record import Record


def resolve_records(
    items: Record | str | os.PathLike[str] | Iterable[Record | str | os.PathLike[str]],
    folders: Folders = None,
    base: str | os.PathLike[str] | None = None,
) -> list[Record]:
    """Turn records, paths and names into records, in order.

    Parameters
    ----------
    items
        Records, paths, or texts: a text with a path separator or a record file's
        ending (`RECORD_SUFFIXES`) is a path, any other a name for `find_record`.
        A path without folder that is not in `base` is looked for in `folders`.
        The name of a record set ("fema_p695_far_field") stands for all its records,
        and ``SET/RECORD`` for one of them.
    folders
        As in `find_record`.
    base
        Folder that relative paths start from; by default the current one.

    Returns
    -------
    list of Record
        One per item, and as many as it has per set.

    Raises
    ------
    MissingRecordError
        If an item is not found.
    RecordError
        If an item can't be read or is of another type, or if two records have
        the same name: they could not be told apart on an axis.

    Examples
    --------
    >>> resolve_records(["el_centro", Record("step", dt=1.0, acceleration=[1.0, 1.0])])
    [Record('el_centro', 1560 points, dt=0.02 s, PGA 3.128 m/s2), Record('step', 2 points, dt=1 s, PGA 1 m/s2)]
    """
    given = [items] if isinstance(items, Record | str | os.PathLike) else list(items)
    records: list[Record] = []
    for item in given:
        records += _several(item, folders, base)
    seen: dict[str, int] = {}
    for index, record in enumerate(records):
        if record.name in seen:
            msg = (
                f"records {seen[record.name] + 1} and {index + 1} have the same name {record.name!r}; "
                "rename one: record.renamed('other')"
            )
            raise RecordError(msg)
        seen[record.name] = index
    return records


def _several(item: object, folders: Folders, base: str | os.PathLike[str] | None) -> list[Record]:
    if isinstance(item, str) and plain_name(item) in RECORD_SETS:
        return read_record_set(plain_name(item))
    return [resolve_record(item, folders, base)]


def resolve_record(item: object, folders: Folders = None, base: str | os.PathLike[str] | None = None) -> Record:
    """Turn a record, a path or a name into one record.

    Parameters
    ----------
    item, folders, base
        As in `resolve_records`; a record set is refused.

    Raises
    ------
    MissingRecordError
        If it is not found.
    RecordError
        If it can't be read, is of another type, or stands for several records.
    """
    if isinstance(item, Record):
        return item
    if not isinstance(item, str | os.PathLike):
        msg = f"a record must be a Record, a path or a name, not {shown(item)}"
        raise RecordError(msg)
    text = os.fspath(item)
    if not isinstance(text, str):
        msg = f"a record's path must be text, not {shown(item)}"
        raise RecordError(msg)
    separated = any(separator in text for separator in {"/", os.sep, os.altsep or os.sep})
    in_set = plain_name(text.partition("/")[0]) in RECORD_SETS
    is_name = in_set or not (separated or Path(text).suffix.lower() in RECORD_SUFFIXES)
    if isinstance(item, str) and is_name:
        return find_record(text, folders)
    try:
        path = (Path() if base is None else Path(base)) / expanded(text, RecordError)
        absent = not path.exists()
    except RecordError:
        raise
    except (OSError, ValueError) as error:
        msg = f"{shown(text)} is no usable path: {error}"
        raise RecordError(msg) from None
    if absent and not separated:
        try:
            return find_record(text, folders)
        except MissingRecordError as error:
            msg = f"no file {path}, and as a name: {error}"
            raise MissingRecordError(msg, error.record) from None
    return read_record(path)
