"""How many scenarios a sweep took from an earlier cube, in this run and in those that it goes on from.

The line of a chunk in the manifest says how many of its scenarios were taken, and from what: a digest, which
names the file beside the chunks that holds what that cube said of itself. The file is there before the line.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pounding_sweep.base.errors import WriteError
from pounding_sweep.base.files import failure, replacing
from pounding_sweep.base.regular import parse_json, read_regular
from pounding_sweep.output.dataset import package_version
from pounding_sweep.resume.checkpoint import ChunkStore

if TYPE_CHECKING:
    from pounding_sweep.resume.extend import EarlierCube


class Taken:
    """Counts what was taken.

    Parameters
    ----------
    store : ChunkStore, optional
        Open store, which tells of earlier runs.
    earlier : EarlierCube, optional
        The cube that this run extends.

    Attributes
    ----------
    origin : mapping or None
        What the cube said of itself that scenarios are from: the one of this run, else the first that is met
        among the chunks. None where there is no such cube.
    scenarios : int
        Scenarios taken from it so far. What was taken from another one is not counted.
    """

    def __init__(self, store: ChunkStore | None, earlier: EarlierCube | None) -> None:
        self.origin: Mapping[str, Any] | None = None
        self._name = ""
        if earlier is not None:
            self.origin, self._name = earlier.origin, _digest(earlier.origin)
        self.scenarios = 0
        self._store, self._now = store, {} if earlier is None else earlier.taken
        self._lost = {} if earlier is None else earlier.lost
        self._written = False

    def new(self, key: str) -> int:
        """Count what a chunk of this run took."""
        taken = self._now.get(key, 0)
        self.scenarios += taken
        return taken

    def lost(self, key: str) -> str:
        """Return what went wrong with what a chunk of this run did not take; "" where all of it has a result."""
        return self._lost.get(key, "")

    def kept(self, key: str) -> int:
        """Count what a chunk of an earlier run took."""
        assert self._store is not None
        told = self._store.told(key)
        taken, name = told.get("taken"), told.get("from")
        if not isinstance(taken, int) or not isinstance(name, str):
            return 0
        if self.origin is None:
            self.origin, self._name = self._read(name), name
        if self.origin is None or self._name != name:
            return 0
        self.scenarios += taken
        return taken

    def line(self, taken: int) -> dict[str, Any]:
        """Return what the manifest is to say of a chunk that took so many; raises `WriteError`."""
        if not taken or self._store is None or self.origin is None:
            return {}
        if not self._written:
            try:
                with replacing(_file(self._store, self._name), self._store.folder) as temporary:
                    temporary.write_text(json.dumps(self.origin) + "\n", encoding="utf-8")
            except OSError as error:
                raise WriteError(failure(f"writing to {str(self._store.folder)!r}", error)) from error
            self._written = True
        return {"taken": taken, "from": self._name}

    def _read(self, name: str) -> Mapping[str, Any] | None:
        """Return what a cube said of itself; None where the file is not what was written."""
        assert self._store is not None
        try:
            found = parse_json(read_regular(_file(self._store, name)))
            return found if _digest(found) == name else None
        except (OSError, ValueError, TypeError, AttributeError):
            return None


def _file(store: ChunkStore, name: str) -> Path:
    return store.folder / f"earlier-{name}.json"


def _digest(origin: Mapping[str, Any]) -> str:
    """Digest of what a cube says of itself, wherever it stands."""
    told = {key: value for key, value in origin.items() if key != "file"}
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:32]


def extension_attributes(origin: Mapping[str, Any], taken: int) -> dict[str, Any]:
    """Return what a cube says of the one that it extends: global attributes.

    Parameters
    ----------
    origin : mapping
        What that one said of itself, with its ``file``.
    taken : int
        Scenarios taken from it.

    Examples
    --------
    >>> extension_attributes({"file": "old.nc"}, 12)["extended_from"]
    {'file': 'old.nc', 'scenarios_taken': 12}
    """
    now = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}"
    return {
        "history": f"{now} extended from another cube by pounding_sweep {package_version()} (see extended_from)",
        "extended_from": {**origin, "scenarios_taken": taken},
    }
