"""Results of finished chunks on disk, so that an interrupted sweep continues where it stopped.

A folder holds ``identity.json`` (which sweep it belongs to), ``expected.json``
(the chunks of which it will consist, as far as known), one ``chunk-<key>.npy``
per finished chunk and ``manifest.jsonl``, one line per chunk, written after the
chunk is safely on disk. A chunk is complete when the manifest says so and at no
other time. ``lock`` and ``holder.txt`` are there while somebody runs.

A chunk is a table in numpy's own format, one row per scenario and one field
per variable: it is written in one piece, and any of its rows can be read
without the others. Behind the table stand the numbers of the scenarios in the
plan of the sweep; the manifest says of which stage they are, and from which
earlier cube, if they were taken from one.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import OutputError, WriteError
from pounding_sweep.base.files import (
    HOLDER,
    LOCK,
    SOFT_LOCK,
    FolderLock,
    absolute,
    expanded,
    failure,
    is_temporary,
    replacing,
    sync_folder,
)
from pounding_sweep.output.dataset import package_version
from pounding_sweep.output.identity import libraries, package_digest
from pounding_sweep.spec.spec import to_json

if TYPE_CHECKING:
    from pounding_sweep.plan.plan import Plan


#: What stands for the whole; the rest of the details are parts of the sweep, to name what changed.
WHOLE = ("sweep", "package", "source", "libraries")
#: Longest text (characters) that is told as it is.
_LONGEST = 60


def identity_of(plan: Plan) -> tuple[str, dict[str, str]]:
    """Return what the chunks of a sweep are known by."""
    whole = (plan.digest, package_version(), package_digest(), libraries())
    details = {**dict(zip(WHOLE, whole, strict=True)), **_parts(json.loads(to_json(plan.spec)))}
    return hashlib.sha256(json.dumps(details, sort_keys=True).encode()).hexdigest(), details


def differing_in(there: Mapping[str, str], here: Mapping[str, str]) -> list[str]:
    """Return in what two details differ, the parts of the sweep before what stands for the whole."""
    keys = sorted({*there, *here}, key=lambda key: (key in WHOLE, key))
    return [
        f"{key} ({_short(there.get(key, 'none'))} there, {_short(here.get(key, 'none'))} here)"
        for key in keys
        if there.get(key) != here.get(key)
    ]


def _parts(sweep: dict[str, Any]) -> dict[str, str]:
    """Return each part of a described sweep as a short text that is another one where the part is."""
    records = {f"record {record['name']}": record["sha256"] for record in sweep["records"]}
    rest = {**sweep, "records": [{**record, "sha256": ""} for record in sweep["records"]]}
    laws = {f"law {key}": law["sha256"] for key, law in rest.pop("own_laws", {}).items()}
    return {**records, **laws, **{key: _digest(json.dumps(value, sort_keys=True)) for key, value in rest.items()}}


def _digest(text: str) -> str:
    return text if len(text) <= _LONGEST else hashlib.sha256(text.encode()).hexdigest()


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:12]}..."


#: How the number of a scenario is stored.
ROW = np.dtype("<i4")
IDENTITY = "identity.json"
EXPECTED = "expected.json"
MANIFEST = "manifest.jsonl"

_KEY = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,127}")
_CHUNK_FILE = re.compile(rf"chunk-{_KEY.pattern}\.npy")
#: What NFS makes of a file that is removed while it is open; it goes by itself.
_REMOVED = re.compile(r"\.nfs[0-9a-f]+")


class ChunkCorrupt(OutputError):  # noqa: N818 - an event of the store, caught by the executor
    """A chunk on disk is not what was written."""


def parts_folder(out: str | os.PathLike[str]) -> Path:
    """Return the folder of a run's chunks: beside the cube `out`, links followed."""
    return Path(f"{absolute(out)}.parts")


def unreadable(folder: Path, error: OSError) -> str:
    """Say that a folder of chunks can't be read, which says nothing against the chunks."""
    why = error.strerror or error
    return f"the chunk folder {str(folder)!r} can't be read ({why}); ask its owner for access, or give another path"


def _own(name: str) -> bool:
    """Whether a file of that name is the store's, its identity apart."""
    return name in (EXPECTED, MANIFEST) or _CHUNK_FILE.fullmatch(name) is not None or is_temporary(name)


class ChunkStore:
    """Finished chunks of one sweep in one folder, in which one thread of one process writes while it has the `lock`."""

    def __init__(self, folder: str | os.PathLike[str], identity: str, details: Mapping[str, str] | None = None) -> None:
        self.folder = expanded(folder)
        self.identity = identity
        self.details = {str(key): str(value) for key, value in (details or {}).items()}
        self._entries: dict[str, dict[str, Any]] = {}
        self._checked: set[str] = set()

    @property
    def _manifest(self) -> Path:
        return self.folder / MANIFEST

    def path(self, key: str) -> Path:
        """Return the file of a chunk."""
        return self.folder / f"chunk-{key}.npy"

    @contextmanager
    def lock(self) -> Iterator[bool]:
        """Keep other runs out of the folder while the context is open; gives whether this sweep has begun there."""
        self._check()
        with FolderLock(self.folder):
            begun = self._check()
            left = is_temporary if begun else _own  # by a killed run: what it was writing, or of which it finished none
            self._remove(path for path in self.folder.iterdir() if left(path.name))
            yield begun

    def open(self) -> ChunkStore:
        """Make the folder ready, which `lock` cleared; a cube may be written in it meanwhile."""
        try:
            if self._check():  # the run before may have been killed before the folder's name was lasting
                sync_folder(self.folder.parent)
                self._entries = self._lines()
                return self
            self.folder.mkdir(parents=True, exist_ok=True)
            text = json.dumps({"identity": self.identity, "details": self.details}, indent=1)
            with replacing(self.folder / IDENTITY, self.folder) as temporary:
                temporary.write_text(text + "\n", encoding="utf-8")
            sync_folder(self.folder.parent)
            self._entries = {}
        except OSError as error:
            if isinstance(error, OutputError):
                raise
            raise OutputError(
                f"the chunk folder {str(self.folder)!r} can't be made or written ({error}); give another output path"
            ) from error
        return self

    def _check(self) -> bool:
        """Return whether the folder is this sweep's; False where it is missing, unused, or no chunk was finished."""
        found = self._identity()
        if found is None:
            return False
        if found.get("identity") != self.identity:
            if b"\n" not in self._manifest_text():
                return False
            there = found.get("details")
            differing = differing_in(there if isinstance(there, dict) else {}, self.details)
            what = f"they differ in {', '.join(differing)}; " if differing else ""
            raise OutputError(
                f"the chunks in {str(self.folder)!r} belong to another sweep: {what}identity "
                f"{str(found.get('identity'))[:12]!r} there, {self.identity[:12]!r} here. "
                "Give another output path, go back to the sweep that began there, or remove the folder"
            )
        return True

    def _identity(self) -> dict[str, Any] | None:
        """Read whose chunks stand in the folder; None where it is missing or unused."""
        try:
            found = json.loads((self.folder / IDENTITY).read_bytes())
            if not isinstance(found, dict):
                raise TypeError
            return found
        except FileNotFoundError:
            others = self._others()
            if not others or IDENTITY in others:  # another run has begun there just now
                return None
            raise OutputError(
                f"the folder {str(self.folder)!r} is not one of chunks: it has no {IDENTITY}, but "
                f"{', '.join(others[:3])}{' ...' if len(others) > 3 else ''}; give another output path"
            ) from None
        except NotADirectoryError:
            raise OutputError(f"{str(self.folder)!r} is not a folder; give another output path") from None
        except OSError as error:
            raise OutputError(unreadable(self.folder, error)) from None
        except (ValueError, TypeError):
            raise OutputError(
                f"{str(self.folder / IDENTITY)!r} is damaged; remove the folder and run the sweep again"
            ) from None

    def _manifest_text(self) -> bytes:
        try:
            return self._manifest.read_bytes()
        except (FileNotFoundError, NotADirectoryError):
            return b""
        except OSError as error:
            raise OutputError(unreadable(self.folder, error)) from None

    def _others(self) -> list[str]:
        """Names in the folder that neither a run nor the file system made."""
        try:
            names = os.listdir(self.folder)
        except FileNotFoundError:
            return []
        except OSError as error:
            raise OutputError(unreadable(self.folder, error)) from None
        passing = (LOCK, SOFT_LOCK, HOLDER)
        return sorted(n for n in names if not (is_temporary(n) or _REMOVED.fullmatch(n) or n in passing))

    def write(self, key: str, table: np.ndarray, rows: np.ndarray, **more: Any) -> None:
        """Store a chunk with the numbers of its scenarios; when this returns, it outlasts a power cut."""
        path, table, numbers = self.path(key), np.ascontiguousarray(table), np.asarray(rows, ROW).tobytes()
        try:
            with replacing(path, self.folder) as temporary, temporary.open("wb") as file:
                np.save(file, table, allow_pickle=False)
                file.write(numbers)
            line = {
                **more,
                "key": key,
                "file": path.name,
                "crc32": zlib.crc32(numbers, zlib.crc32(table.view(np.uint8).data)),
                "rows": len(table),
            }
            self._append(json.dumps(line, sort_keys=True))
        except OSError as error:
            raise WriteError(failure(f"writing chunk {key!r} to {str(self.folder)!r}", error)) from error
        self._checked.discard(key)
        self._entries[key] = line

    def expect(self, chunks: Mapping[str, Any]) -> None:
        """Note of which chunks the sweep will consist, for who looks at an unfinished folder; raises `WriteError`."""
        try:
            with replacing(self.folder / EXPECTED, self.folder) as temporary:
                temporary.write_text(json.dumps(chunks) + "\n", encoding="utf-8")
        except OSError as error:
            raise WriteError(failure(f"writing to {str(self.folder)!r}", error)) from error

    def _append(self, line: str) -> None:
        new = not self._manifest.exists()
        with self._manifest.open("ab+") as file:
            end = file.seek(0, os.SEEK_END)
            torn = False
            if end:
                file.seek(end - 1)
                torn = file.read(1) != b"\n"
            # A line that an interrupted run left half written is closed off, so that it spoils only itself.
            file.write((b"\n" if torn else b"") + line.encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
        if new:
            sync_folder(self.folder)

    def _lines(self) -> dict[str, dict[str, Any]]:
        """Read the manifest by key, later lines winning; a line that is no entry is passed over."""
        entries: dict[str, dict[str, Any]] = {}
        for line in self._manifest_text().split(b"\n"):
            try:
                entry = json.loads(line)
                key, checksum = entry["key"], entry["crc32"]
            except (ValueError, TypeError, KeyError):
                continue
            if isinstance(key, str) and isinstance(checksum, int):
                entries[key] = entry
        return entries

    def completed(self) -> dict[str, dict[str, Any]]:
        """Return the manifest's lines of those chunks whose file is there, by key; raises `OutputError`."""
        entries = self._lines()
        self._entries.update(entries)  # not replaced, nor gone through: the thread that writes may add to it meanwhile
        return {key: entry for key, entry in entries.items() if self.path(key).is_file()}

    def rows(self, key: str) -> np.ndarray:
        """Return the numbers of the scenarios of a chunk."""
        path, n_bytes = self.path(key), self._entries[key]["rows"] * ROW.itemsize
        return np.fromfile(path, ROW, offset=path.stat().st_size - n_bytes)

    def read(self, key: str) -> np.ndarray:
        """Return a chunk, mapped; when it is first read, after a check that it is what was written."""
        entry = self._entries.get(key)
        if entry is None:
            raise OutputError(f"chunk {key!r} is not complete in {str(self.folder)!r}")
        damaged = f"chunk {key!r} in {str(self.folder)!r} is damaged: "
        try:
            table = np.asarray(np.load(self.path(key), mmap_mode="r", allow_pickle=False))
        except FileNotFoundError:
            raise OutputError(f"chunk {key!r} was removed from {str(self.folder)!r}") from None
        except (OSError, ValueError, EOFError) as error:
            raise ChunkCorrupt(f"{damaged}{error}") from error
        if key not in self._checked:
            table_checksum = zlib.crc32(np.ascontiguousarray(table).view(np.uint8).data)
            checksum = zlib.crc32(self.rows(key).data, table_checksum)
            if checksum != entry["crc32"]:
                raise ChunkCorrupt(f"{damaged}its CRC-32 is {checksum:08x}, it was written as {entry['crc32']:08x}")
            self._checked.add(key)
        return table

    def size(self) -> int:
        """Bytes of the chunks that are complete, whoever removes them meanwhile."""
        total = 0
        for key in self.completed():
            with suppress(FileNotFoundError):
                total += self.path(key).stat().st_size
        return total

    def forget(self, key: str) -> None:
        """Remove a chunk, so that the next run makes it again; no error where it is not there."""
        self.path(key).unlink(missing_ok=True)

    def discard(self) -> None:
        """Remove the store's own files, and the folder if nothing else is in it and it is no link."""
        self._identity()  # raises where the folder is somebody else's
        if not self.folder.is_dir():
            return
        own = [path for path in self.folder.iterdir() if _own(path.name)]
        self._remove(sorted(own, key=lambda path: path.name != MANIFEST))  # first: what is left is not complete
        sync_folder(self.folder)  # a power cut must not bring back chunks of a folder that says of no sweep it is
        self._remove([self.folder / IDENTITY])
        with suppress(OSError):  # the lock or somebody else's files are in it, or it is a link
            self.folder.rmdir()

    def _remove(self, paths: Iterable[Path]) -> None:
        try:
            for path in paths:
                path.unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"{error.filename!r} can't be removed ({error.strerror}); remove it by hand") from error
