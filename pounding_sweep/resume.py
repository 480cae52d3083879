"""Finished chunks of a sweep in the folder ``OUT.nc.parts``, so that an interrupted run continues where it stopped.

A chunk is a table in numpy's own format, one row per scenario and one field per variable, of which any rows can be
read without the others; behind it stand the numbers of the scenarios in the plan. ``manifest.jsonl`` says whose
chunks they are, of which chunks each stage consists, and in a line per chunk what is finished: that line is written
after the chunk is safely on disk, and no chunk counts without it. While somebody runs, the folder is locked.
"""

from __future__ import annotations

import hashlib
import json
import os
import socket
import time
import warnings
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base import files
from pounding_sweep.base.errors import OutputError, WriteError
from pounding_sweep.base.files import FilePath
from pounding_sweep.output.dataset import package_version
from pounding_sweep.output.identity import libraries, package_digest
from pounding_sweep.request.spec import to_json

if TYPE_CHECKING:
    from pounding_sweep.plan.plan import Plan
    from pounding_sweep.plan.scenarios import Chunk

MANIFEST = "manifest.jsonl"
#: Who has the lock, as text; what a killed run left tells the next one of it.
HOLDER = "holder.txt"
#: Seconds for which a lock is waited for: who looks whether somebody runs holds it for a moment.
PATIENCE = 0.5
#: Seconds for which finished chunks are held in memory, and most bytes of them.
BUFFER_SECONDS, BUFFER_BYTES = 2.0, 2**24
#: What of the details stands for the whole sweep; the rest are parts of it, to name what changed.
SWEEP_KEYS = ("sweep", "package", "source", "libraries")
#: Longest text (characters) of a part that is stored as it is.
LONGEST = 60
#: How the number of a scenario is stored.
ROW = np.dtype("<i4")


class ChunkCorrupt(OutputError):  # noqa: N818 - an event of the store, caught by the executor
    """A chunk on disk is not what was written."""


def parts_folder(out: FilePath) -> Path:
    """Return the folder of a run's chunks: beside the cube `out`, links followed."""
    return Path(f"{files.absolute(out)}.parts")


def identity_of(plan: Plan) -> dict[str, str]:
    """Return what the chunks of a sweep are known by: its parts as short texts, then what stands for the whole."""
    sweep = json.loads(to_json(plan.spec))
    details = {f"law {key}": law["sha256"] for key, law in sweep.pop("user_laws", {}).items()}
    details |= {f"record {record['name']}": record.pop("sha256") for record in sweep["records"]}
    texts = {key: json.dumps(value, sort_keys=True) for key, value in sweep.items()}
    details |= {k: t if len(t) <= LONGEST else hashlib.sha256(t.encode()).hexdigest() for k, t in texts.items()}
    return details | dict(zip(SWEEP_KEYS, (plan.digest, package_version(), package_digest(), libraries()), strict=True))


def running(folder: Path) -> str | None:
    """Return who runs on a folder now; None if nobody does."""
    if not any((folder / name).exists() for name in (files.LOCK, files.SOFT_LOCK)):
        return None
    try:
        files.acquire_lock(folder, 0.0).release()
    except OSError:  # somebody has it
        return _holder(folder) or "a process that has not said its name"
    return None


def _holder(folder: Path) -> str:
    with suppress(OSError):
        return (folder / HOLDER).read_text(encoding="utf-8", errors="replace").strip()
    return ""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Make a folder and keep other runs out of it while the context is open; it is removed if it is empty then."""
    from filelock import Timeout

    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = files.acquire_lock(folder, PATIENCE)
    except Timeout:
        raise OutputError(
            f"another run is at work in {str(folder)!r}: {running(folder) or 'it has just ended'}; "
            "wait for it, stop it, or give another output path"
        ) from None
    except OSError as error:
        raise _not_writable(folder, error) from error
    try:
        if before := _holder(folder):
            msg = f"the run before this one was killed ({before}); this one goes on from what it finished"
            warnings.warn(msg, RuntimeWarning, stacklevel=5)
        now = datetime.now().astimezone().isoformat(timespec="seconds")
        try:
            (folder / HOLDER).write_text(f"process {os.getpid()} on {socket.gethostname()}, since {now}\n", "utf-8")
        except OSError as error:
            raise _not_writable(folder, error) from error
        yield
    finally:
        with suppress(OSError):  # the folder may be gone
            for name in (HOLDER, files.LOCK):
                (folder / name).unlink(missing_ok=True)
        lock.release()
        with suppress(OSError):  # chunks are in it, or it is a link
            folder.rmdir()


def _not_writable(folder: Path, error: OSError) -> OutputError:
    return OutputError(f"the chunk folder {str(folder)!r} can't be made or written ({error}); give another output path")


class ChunkStore:
    """Finished chunks of one sweep in one folder.

    They are buffered until a run has lasted `BUFFER_SECONDS` or holds `BUFFER_BYTES`; one that goes on from others,
    or writes `at_once`, does so from its start. A run that ends well before writes nothing, one that fails or is
    interrupted all that it has.
    """

    def __init__(self, folder: Path, details: Mapping[str, str] | None = None, *, at_once: bool = False) -> None:
        self.folder, self.details = folder, dict(details or {})
        self._entries: dict[str, dict[str, Any]] = {}
        self._buffered: dict[str, np.ndarray] = {}
        self._checked: set[str] = set()
        self._bytes, self._is_open = 0, False
        self._due = 0.0 if at_once else time.monotonic() + BUFFER_SECONDS
        self._waiting: list[Callable[[], None]] = []

    @contextmanager
    def lock(self) -> Iterator[ChunkStore]:
        """Keep other runs out of the folder while the context is open."""
        with locked(self.folder):
            begun = self._has_begun()
            # all but what is finished goes: what a killed run was writing
            self._remove([MANIFEST, *(self.path(key).name for key in self.completed())] if begun else [])
            if begun:
                self._due = 0.0
            try:
                yield self
            except BaseException as error:
                try:
                    if self._waiting:
                        self.flush()
                except Exception as failed:  # what ended the run is told, not what followed
                    error.add_note(str(failed))
                raise

    def _has_begun(self) -> bool:
        """Whether this sweep has finished chunks in the folder; raises `OutputError` if it is not this sweep's."""
        lines = self.lines()
        sweeps = [line["sweep"] for line in lines if "sweep" in line]
        if not sweeps or not any("key" in line for line in lines):
            return False
        then, now = sweeps[-1], self.details
        differing = [
            f"{key} ({then.get(key, 'none'):.{LONGEST}} there, {now.get(key, 'none'):.{LONGEST}} here)"
            for key in {**now, **then}
            if then.get(key) != now.get(key)
        ]
        if differing:
            raise OutputError(
                f"the chunks in {str(self.folder)!r} belong to another sweep: they differ in {', '.join(differing)}; "
                "give another output path, go back to the sweep that began there, or remove the folder"
            )
        return True

    def lines(self) -> list[dict[str, Any]]:
        """Read the manifest; a line that an interrupted run left half written is passed over."""
        lines = []
        try:
            for line in (self.folder / MANIFEST).read_bytes().splitlines():
                with suppress(ValueError):
                    lines.append(json.loads(line))
        except FileNotFoundError:
            return []
        except OSError as error:
            raise OutputError(
                f"the chunk folder {str(self.folder)!r} can't be read ({error.strerror}); ask its owner for access, "
                "or give another path"
            ) from None
        return lines

    def completed(self) -> dict[str, dict[str, Any]]:
        """Return the manifest's lines of those chunks whose file is there, by key."""
        self._entries = {line["key"]: line for line in self.lines() if "key" in line}
        return {key: entry for key, entry in self._entries.items() if self.path(key).is_file()}

    def path(self, key: str) -> Path:
        """Return the file of a chunk."""
        return self.folder / f"chunk-{key}.npy"

    def rows(self, key: str) -> np.ndarray:
        """Return the numbers of the scenarios of a chunk."""
        path, n_bytes = self.path(key), self._entries[key]["rows"] * ROW.itemsize
        return np.fromfile(path, ROW, offset=path.stat().st_size - n_bytes)

    def read(self, key: str) -> np.ndarray:
        """Return a chunk, mapped if it is in its file; when it is first read, it is checked to be what was written."""
        if key in self._buffered:
            return self._buffered[key]
        try:
            table = np.asarray(np.load(self.path(key), mmap_mode="r", allow_pickle=False))
            if key not in self._checked:
                checksum, written = _checksum(table, self.rows(key)), self._entries[key]["crc32"]
                if checksum != written:
                    raise ValueError(f"its CRC-32 is {checksum:08x}, it was written as {written:08x}")
        except (OSError, ValueError, EOFError) as error:
            raise ChunkCorrupt(f"chunk {key!r} in {str(self.folder)!r} is damaged: {error}") from error
        self._checked.add(key)
        return table

    def expect(self, plan: Plan, stage: str, chunks: Sequence[Chunk]) -> None:
        """Note of which chunks a stage consists, for who looks at an unfinished folder."""
        line = {
            "stage": stage,
            "chunks": [[chunk.key, chunk.law, chunk.record, len(chunk.rows)] for chunk in chunks],
            "title": plan.spec.title,
            "asked": plan.n_asked,
            "at_most": plan.n_unique,
            "laws": [law.key for law in plan.laws],
            "records": [record.name for record in plan.spec.records],
        }
        self._when_due(partial(self._append, line))

    def save(self, chunk: Chunk, table: np.ndarray, **more: Any) -> None:
        """Write a chunk once it is due, with `more` in its line."""
        self._buffered[chunk.key] = table
        self._bytes += table.nbytes
        self._when_due(partial(self.write, chunk.key, table, chunk.rows, law=chunk.law, record=chunk.record, **more))

    def _when_due(self, write: Callable[[], None]) -> None:
        self._waiting.append(write)
        if self._is_open or self._bytes > BUFFER_BYTES or time.monotonic() >= self._due:
            self.flush()

    def flush(self) -> None:
        """Write all that is held."""
        if not self._is_open:
            self._append({"sweep": self.details}, lead="\n")  # which closes off a line that a killed run left half
            files.sync_folder(self.folder)
            files.sync_folder(self.folder.parent)
            self._is_open = True
        while self._waiting:
            self._waiting.pop(0)()

    def write(self, key: str, table: np.ndarray, rows: np.ndarray, **more: Any) -> None:
        """Store a chunk with the numbers of its scenarios; when this returns, it outlasts a power cut."""
        rows, path = np.asarray(rows, ROW), self.path(key)
        with (
            self._writing(f"chunk {key!r} "),
            files.replacing(path, self.folder) as temporary,
            temporary.open("wb") as file,
        ):
            np.save(file, table, allow_pickle=False)
            file.write(rows.tobytes())
        self._entries[key] = {**more, "key": key, "crc32": _checksum(table, rows), "rows": len(table)}
        self._append(self._entries[key])
        self._buffered.pop(key, None)

    def _append(self, line: Mapping[str, Any], lead: str = "") -> None:
        """Add a line to the manifest."""
        with self._writing(), (self.folder / MANIFEST).open("a", encoding="utf-8") as file:
            file.write(f"{lead}{json.dumps(line)}\n")
            file.flush()
            os.fsync(file.fileno())

    @contextmanager
    def _writing(self, what: str = "") -> Iterator[None]:
        """Raise `WriteError` where something can't be written."""
        try:
            yield
        except OSError as error:
            raise WriteError(files.failure(f"writing {what}to {str(self.folder)!r}", error)) from error

    def discard(self) -> None:
        """Remove the store's own files; what was held is not written any more."""
        self._waiting.clear()
        (self.folder / MANIFEST).unlink(missing_ok=True)  # first: what is left is not complete
        files.sync_folder(self.folder)
        self._remove()

    def _remove(self, but_for: Collection[str] = ()) -> None:
        for pattern in (MANIFEST, self.path("*").name, files.TEMPORARY):
            for path in self.folder.glob(pattern):
                if path.name not in but_for:
                    path.unlink(missing_ok=True)


def _checksum(table: np.ndarray, rows: np.ndarray) -> int:
    return zlib.crc32(rows.data, zlib.crc32(np.ascontiguousarray(table).view(np.uint8).data))


@dataclass
class Part:
    """Chunks of one stage, law and record."""

    stage: str  #: runs without pounding, or scenarios
    law: str  #: key of the contact law
    record: str  #: name of the ground motion
    chunks: int = 0  #: how many there are
    chunks_done: int = 0  #: how many of them are finished
    scenarios: int = 0  #: scenarios in all of them
    scenarios_done: int = 0  #: scenarios in those that are finished


@dataclass
class Survey:
    """An unfinished sweep."""

    folder: Path  #: where its chunks stand
    details: dict[str, str]  #: digests of the sweep and of the package's source, versions
    title: str = ""  #: title of the sweep
    asked: int | None = None  #: scenarios asked for; None where no run came as far as its first stage
    at_most: int | None = None  #: those of them that may have to run
    parts: list[Part] = field(default_factory=list)  #: by stage, law and record, as far as planned
    planned: bool = False  #: whether all chunks are known, which is after the runs without pounding
    now: str | None = None  #: who runs on it


def survey(folder: Path) -> Survey:
    """Look at the folder of a sweep that is not finished; nothing is changed.

    Parameters
    ----------
    folder : Path
        ``OUT.nc.parts``.

    Returns
    -------
    Survey
        Chunks count as done when the manifest lists them and their file is there; the
        files are not read.

    Raises
    ------
    OutputError
        The folder does not hold chunks, or can't be read.
    """
    store = ChunkStore(folder)
    lines, done = store.lines(), store.completed()
    sweeps = [line["sweep"] for line in lines if "sweep" in line]
    if not sweeps:
        raise OutputError(
            f"{str(folder)!r} is no folder of finished chunks: it has no {MANIFEST}; give OUT.nc.parts of a run"
        )
    result = Survey(folder, {key: sweeps[-1][key] for key in SWEEP_KEYS if key in sweeps[-1]}, now=running(folder))
    stages = {line["stage"]: line for line in lines if "chunks" in line}
    result.planned = "scenarios" in stages
    for stage, line in stages.items():
        result.title, result.asked, result.at_most = line["title"], line["asked"], line["at_most"]
        parts: dict[tuple[int, int], Part] = {}
        for key, law, record, scenarios in sorted(line["chunks"], key=lambda chunk: chunk[1:]):
            part = parts.setdefault((law, record), Part(stage, line["laws"][law], line["records"][record]))
            part.chunks += 1
            part.scenarios += scenarios
            part.chunks_done += key in done
            part.scenarios_done += scenarios * (key in done)
        result.parts += parts.values()
    return result
