"""From a cube back to what it was made of: the row, the records, the building properties that vary.

A cube carries its sweep as JSON (attribute ``sweep``), in which records stand by name and digest only: their motions
must be found again, and are taken only where the digest agrees.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import cache
from typing import Any

import xarray as xr

from pounding_sweep.base.errors import InputError, RecordError
from pounding_sweep.model.scene import Scene
from pounding_sweep.records import RECORD_SETS, Record, find_record, list_records
from pounding_sweep.records.fema_p695 import read_component, set_components
from pounding_sweep.records.synthetic import remade
from pounding_sweep.spec.axes import AXES
from pounding_sweep.spec.spec import scene_of

#: Records that an error names.
_NAMED = 3
#: What is read of a stored sweep.
_KEYS = {"scene", "records", "cases", *(name for name, axis in AXES.items() if not axis.unsaid)}


def stored_sweep(cube: xr.Dataset) -> dict[str, Any]:
    """Return a cube's sweep as it is stored."""
    try:
        found = json.loads(cube.attrs["sweep"])
        lacking = sorted(_KEYS - set(found))
    except (KeyError, TypeError, ValueError):
        msg = (
            "this cube does not carry its sweep (attribute 'sweep'), from which the row of buildings would be known; "
            "give a cube as 'pounding-sweep run' wrote it"
        )
        raise InputError(msg) from None
    if lacking:
        msg = (
            f"the sweep that this cube carries (attribute 'sweep') lacks {', '.join(lacking)}: the cube was made by "
            "another version of this package, or changed; run the sweep again"
        )
        raise InputError(msg)
    return found


def stored_scene(one: xr.Dataset) -> Scene:
    """Return the row of a scenario with its histories."""
    try:
        return scene_of(json.loads(one.attrs["scene"]))
    except (AttributeError, KeyError, TypeError, ValueError):
        msg = (
            "this file does not carry its row of buildings (attribute 'scene'), from which the walls beside it would "
            "be known: it was made by another version of this package, or changed; simulate the scenario again"
        )
        raise InputError(msg) from None


def records_of(
    sweep: Mapping[str, Any],
    given: Iterable[Record] = (),
    folders: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | None = None,
) -> list[Record]:
    """Find the records of a stored sweep again."""
    offered = {record.sha256: record for record in given}
    at_hand = cache(lambda: [record for _, record in list_records(folders) if isinstance(record, Record)])
    found, missing = [], []
    for entry in sweep["records"]:
        record = offered.get(entry["sha256"]) or _by_name(entry, folders, at_hand)
        if isinstance(record, Record):
            found.append(record.renamed(entry["name"]))
        else:
            missing.append(f"{entry['name']!r} ({record})")
    if missing:
        more = f" and {len(missing) - _NAMED} more" if len(missing) > _NAMED else ""
        msg = (
            f"{len(missing)} of the {len(sweep['records'])} records of this cube's sweep can't be found again: "
            f"{', '.join(missing[:_NAMED])}{more}; give the folder of their files, or the records themselves"
        )
        raise InputError(msg)
    return found


def _by_name(entry: Mapping[str, Any], folders: Any, at_hand: Callable[[], list[Record]]) -> Record | str:
    """Return the record of that name and digest, as found or scaled as the sweep says; or why there is none."""
    record = remade(entry["source"], entry["n_points"])
    if record is None:
        record = _named(entry["name"], folders)
    if record is not None and (same := _same_motion(record, entry)) is not None:
        return same
    for other in at_hand():  # a record may have been renamed
        if other.dt == entry["dt"] and other.n_points == entry["n_points"]:
            same = _same_motion(other, entry)
            if same is not None:
                return same
    return "the record found by that name is another motion" if record is not None else "none of that name or motion"


def _named(name: str, folders: Any) -> Record | None:
    """Return the record of that name, of those at hand and of the components of sets; None where there is none."""
    with suppress(RecordError):
        return find_record(name, folders)
    for key in (key for key in RECORD_SETS if not key.endswith("_normalized")):
        with suppress(RecordError):
            if name in set_components(key):
                return read_component(key, name)
    return None


def _same_motion(record: Record, entry: Mapping[str, Any]) -> Record | None:
    for candidate in (record, record.scaled(entry["scale"] / record.scale) if record.scale else record):
        if candidate.sha256 == entry["sha256"]:
            return candidate
    return None
