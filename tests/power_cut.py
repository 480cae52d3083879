"""What a power cut may leave of a folder, by what POSIX promises and nothing more.

The content of a file is lasting once it was fsynced, a name once its folder was. At a cut, of what is
not lasting, any part may be on the disk: a name is the old one or the new one, each by itself and in any
order; what was written to a file is there, is lost, stops half way, or is zeros. Within a folder a rename
is atomic; between two folders it is a name more in the one and a name less in the other.
"""

from __future__ import annotations

import itertools
import os
import random
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import RLock

#: Calls that change names or make something lasting; the folder is looked at before and after each.
CALLS = ("open", "fsync", "replace", "rename", "unlink", "remove", "mkdir", "rmdir")
#: What becomes of written bytes that were not made lasting. "mixed": of each file something else.
DAMAGES = ("whole", "lost", "half", "zeros", "mixed")
#: Where no more names than this are not lasting, every subset of them is tried.
FEW = 4

#: Path below the folder -> content; None for a folder.
State = dict[str, bytes | None]


@dataclass(frozen=True)
class Change:
    """Names of one folder that change together: path -> what it stands for from then on (None: nothing)."""

    folder: str
    names: dict[str, int | None]


@dataclass(frozen=True)
class Cut:
    """A moment at which the power may fail.

    Attributes
    ----------
    names : dict of str to int
        Lasting names, and the number of the file or folder that each stands for.
    pending : tuple of Change
        What happened to names since, in order.
    files : dict of int to (bytes, bytes) or None
        Lasting and present content of each file; None for a folder.
    promised : frozenset of str
        What must be there, whatever the cut leaves.
    """

    names: dict[str, int]
    pending: tuple[Change, ...]
    files: dict[int, tuple[bytes, bytes] | None]
    promised: frozenset[str]

    def after(self, changes: tuple[Change, ...]) -> dict[str, int]:
        """Return the names when some changes are on the disk."""
        names: dict[str, int | None] = dict(self.names)
        for change in changes:
            names.update(change.names)
        return {path: number for path, number in names.items() if number is not None}

    def lasting(self, path: str) -> bytes | None:
        """Return what a file begins with whatever the cut leaves; None where there may be no such file."""
        folder = os.path.dirname(path)
        if path not in self.names or (folder and folder not in self.names):
            return None
        if any(path in change.names or folder in change.names for change in self.pending):
            return None
        stored, present = self.files[self.names[path]] or (b"", b"")
        return stored if present.startswith(stored) else b""

    def states(self, seed: int, damages: int = len(DAMAGES)) -> Iterator[State]:
        """Return what the cut may leave: names that are lasting or not, times so many of the damages, drawn by seed."""
        draw = random.Random(seed)
        for chosen in _subsets(len(self.pending), draw):
            names = self.after(tuple(self.pending[i] for i in chosen))
            for damage in draw.sample(DAMAGES, damages):
                yield self._state(names, damage, draw)

    def _state(self, names: dict[str, int], damage: str, draw: random.Random) -> State:
        found: State = {}
        for path in sorted(names):  # a folder before what is in it
            folder = os.path.dirname(path)
            content = self.files[names[path]]
            if folder and found.get(folder, b"") is not None:
                continue  # the name of the folder is lost, and with it this one
            how = draw.choice(DAMAGES[:-1]) if damage == "mixed" else damage
            found[path] = None if content is None else _damaged(*content, how)
        return found


def _subsets(n: int, draw: random.Random) -> Iterator[tuple[int, ...]]:
    """Return subsets of n changes: all of few; of many, the first ones, all but one, one alone, and some at random."""
    if n <= FEW:
        for size in range(n + 1):
            yield from itertools.combinations(range(n), size)
        return
    everything = tuple(range(n))
    yield from (everything[:i] for i in range(n + 1))
    yield from (everything[:i] + everything[i + 1 :] for i in range(n - 1))
    yield from ((i,) for i in range(1, n))
    yield from (tuple(i for i in everything if draw.random() < 0.5) for _ in range(n))


def _damaged(lasting: bytes, present: bytes, how: str) -> bytes:
    if how == "whole" or lasting == present:
        return present
    if how == "lost":
        return lasting
    kept = len(lasting) if present.startswith(lasting) else 0
    new = present[kept:]
    return present[:kept] + (new[: len(new) // 2] if how == "half" else bytes(len(new)))


class Recorder:
    """Watches what this process does to a folder, and keeps every moment at which the power may fail.

    Parameters
    ----------
    root : Path
        The folder; what is in it is lasting, unless `before` says otherwise.
    patch : pytest.MonkeyPatch
        Puts the calls of `os` under watch, until it is undone.
    before : Cut, optional
        A moment of an earlier process that was killed there: `root` is made as that one saw it, and what was
        not lasting then still is not.

    Notes
    -----
    What other modules write (C libraries too) is seen when the next call is watched.
    """

    def __init__(self, root: Path, patch, before: Cut | None = None) -> None:
        self.root, self.cuts = root, []
        self._before = {} if before is None else before.files
        self._guard = RLock()
        self._real = {name: getattr(os, name) for name in CALLS}
        self._held: list[int] = []
        self._numbers: dict[int, int] = {}
        self._free = itertools.count(0 if before is None else 1 + max(before.files, default=0))
        if before is not None:
            _make(root, before._state(before.after(before.pending), "whole", random.Random(0)))
        self._names, content = self._seen(None if before is None else before.after(before.pending))
        self._lasting = dict(self._names) if before is None else before.names
        self._pending = () if before is None else before.pending
        self._stored = dict(content) if before is None else {n: c and c[0] for n, c in before.files.items()}
        self.promised: set[str] = set() if before is None else set(before.promised)
        for name in CALLS:
            patch.setattr(os, name, self._watched(name))

    def close(self) -> None:
        """Let go of the files."""
        for handle in self._held:
            os.close(handle)

    def promise(self, what: str) -> None:
        """From now on it must outlast a power cut."""
        self.promised.add(what)
        self._look()

    def _watched(self, name: str):
        real = self._real[name]

        def call(*args, **more):
            with self._guard:
                self._look()
                if name == "fsync":
                    self._sync(os.fstat(args[0]))
                result = real(*args, **more)
                self._look()
                return result

        return call

    def _seen(self, known: dict[str, int] | None = None) -> tuple[dict[str, int], dict[int, bytes | None]]:
        """Return names with the numbers of their files, and contents by number."""
        names, content = {}, {}
        for folder, folders, files in os.walk(self.root):
            for name in sorted((*folders, *files)):
                path = os.path.join(folder, name)
                below = os.path.relpath(path, self.root)
                handle = self._real["open"](path, os.O_RDONLY)  # held, so that its inode is not given away again
                inode = os.fstat(handle).st_ino
                if inode in self._numbers:
                    os.close(handle)
                else:
                    self._held.append(handle)
                    self._numbers[inode] = next(self._free) if known is None else known[below]
                number = names[below] = self._numbers[inode]
                content[number] = None if name in folders else Path(path).read_bytes()
        return names, content

    def _look(self) -> None:
        """Take down what changed since the last look, and the moment."""
        with self._guard:
            names, content = self._seen()
            self._pending += tuple(_changes(self._names, names))
            self._names = names
            for number, held in content.items():
                self._stored.setdefault(number, None if held is None else b"")
            files = {n: None if c is None else (self._stored[n], c) for n, c in content.items()}
            gone = self.cuts[-1].files if self.cuts else self._before
            wanted = {*self._lasting.values(), *(n for change in self._pending for n in change.names.values())} - {None}
            files |= {n: gone[n] for n in wanted - set(files)}  # without a name now, but the disk may have it
            cut = Cut(dict(self._lasting), self._pending, files, frozenset(self.promised))
            if not self.cuts or self.cuts[-1] != cut:
                self.cuts.append(cut)

    def _sync(self, status: os.stat_result) -> None:
        """Make the content of a file lasting, or the names in a folder."""
        number = self._numbers.get(status.st_ino)
        if not stat.S_ISDIR(status.st_mode):
            if number is not None:
                content = self.cuts[-1].files[number]
                assert content is not None
                self._stored[number] = content[1]
            return
        folders = [path for path, known in self._names.items() if known == number]
        folder = folders[0] if folders else ""
        if not folders and not os.path.samestat(status, self.root.stat()):
            return
        done = tuple(change for change in self._pending if change.folder == folder)
        self._lasting = Cut(self._lasting, done, {}, frozenset()).after(done)
        self._pending = tuple(change for change in self._pending if change.folder != folder)


def _changes(old: dict[str, int], new: dict[str, int]) -> Iterator[Change]:
    """Return what happened to names between two looks."""
    added = {path: number for path, number in new.items() if old.get(path) != number}
    removed = {path: number for path, number in old.items() if path not in new}
    for path, number in added.items():
        source = next((before for before, known in removed.items() if known == number), None)
        folder = os.path.dirname(path)
        if source is not None and os.path.dirname(source) == folder:
            del removed[source]
            yield Change(folder, {source: None, path: number})
        else:
            yield Change(folder, {path: number})
    for path in removed:
        yield Change(os.path.dirname(path), {path: None})


def _make(root: Path, state: State) -> None:
    for path, content in state.items():
        if content is None:
            (root / path).mkdir()
        else:
            (root / path).write_bytes(content)


def make(root: Path, state: State) -> Path:
    """Make a folder that holds a state."""
    root.mkdir()
    _make(root, state)
    return root
