"""Chunks on disk: what an interruption, a fault or another sweep may do to them."""

from __future__ import annotations

import os
from fnmatch import fnmatch

import numpy as np
import pytest

from pounding_sweep.base import files
from pounding_sweep.base.errors import OutputError
from pounding_sweep.base.files import LOCK
from pounding_sweep.resume import HOLDER, MANIFEST, ChunkCorrupt, ChunkStore

KIND = np.dtype([("drift_max", "f8", (1, 2)), ("impact_count", "i4"), ("status", "i1")], align=True)
TABLE = np.array([([[0.1, np.nan]], 3, 0), ([[-0.0, 5e-324]], -1, 1), ([[np.inf, -1e308]], 2**31 - 1, -127)], KIND)


def one(*numbers):
    """A table of one field."""
    return np.array([(number,) for number in numbers], [("a", "f8")])


def write(store, key, table):
    store.write(key, table, np.arange(len(table)) + 5)


def same(a, b):
    assert a.dtype == b.dtype
    assert np.array_equal(np.ascontiguousarray(a).view(np.uint8), np.ascontiguousarray(b).view(np.uint8))


@pytest.fixture
def store(tmp_path):
    (tmp_path / "out.chunks").mkdir()
    return again(ChunkStore(tmp_path / "out.chunks", {"dt": "0.001", "method": "rk4"}))


def again(store):
    other = ChunkStore(store.folder, store.details)
    other.flush()
    other.completed()
    return other


def test_round_trip(store):
    """A chunk is a plain table, read without this package, and no more of it than is used."""
    assert store.completed() == {}
    write(store, "a1", TABLE)
    write(store, "b2", one(1.0))
    other = again(store)
    assert set(other.completed()) == {"a1", "b2"}
    same(other.read("a1"), TABLE)
    same(np.load(store.path("a1"), allow_pickle=False), TABLE)
    assert isinstance(other.read("a1").base, np.memmap)
    assert other.rows("a1").tolist() == [5, 6, 7]
    store.path("a1").unlink()
    assert set(again(store).completed()) == {"b2"}


@pytest.mark.parametrize("cut", [1, 10, 40])
def test_a_torn_manifest_line_is_no_completion(store, cut):
    write(store, "a", TABLE)
    whole = (store.folder / MANIFEST).read_bytes()
    write(store, "b", TABLE)
    text = (store.folder / MANIFEST).read_bytes()
    (store.folder / MANIFEST).write_bytes(text[: len(whole) + cut])
    other = again(store)
    assert set(other.completed()) == {"a"}
    # What follows is not glued to the torn line.
    write(other, "c", TABLE)
    write(other, "b", TABLE)
    assert set(again(store).completed()) == {"a", "b", "c"}


@pytest.mark.parametrize("damage", ["flip", "flip table", "cut", "empty"])
def test_a_damaged_chunk_is_found(store, damage):
    write(store, "a", TABLE)
    path = store.path("a")
    content = bytearray(path.read_bytes())
    if "flip" in damage:
        content[-2 if damage == "flip" else -20] ^= 1
    path.write_bytes({"cut": bytes(content[:-7]), "empty": b""}.get(damage, bytes(content)))
    with pytest.raises(ChunkCorrupt, match=r"^chunk 'a' in '.*' is damaged: [^;]*$"):
        store.read("a")
    assert issubclass(ChunkCorrupt, OutputError)
    write(store, "a", TABLE)
    same(store.read("a"), TABLE)


def test_a_sweep_that_finished_nothing_leaves_its_folder_to_the_next(tmp_path):
    """As when somebody stops a run at once, mends the sweep file, and runs it again."""
    folder = tmp_path / "out.parts"
    first = ChunkStore(folder, {"dt": "0.001"})
    with first.lock():
        first.flush()
        (folder / "chunk-b.npy").write_bytes(b"not in the manifest yet")
    mended = ChunkStore(folder, {"dt": "0.002"})
    with mended.lock():
        mended.flush()
        assert [path.name for path in sorted(folder.iterdir())] == [HOLDER, LOCK, MANIFEST]
        write(mended, "a", TABLE)
    assert set(again(mended).completed()) == {"a"}
    differ = r"belong to another sweep: they differ in dt \(0.002 there, 0.001 here\); give another output path"
    with pytest.raises(OutputError, match=differ), first.lock():
        pass


def test_the_chunk_is_on_disk_before_the_manifest_names_it(store, monkeypatch):
    steps = []
    fsync = os.fsync

    def watch(handle):
        steps.append((os.path.basename(os.readlink(f"/proc/self/fd/{handle}")), "k" in store.completed()))
        fsync(handle)

    if not os.path.isdir("/proc/self/fd"):
        pytest.skip("needs /proc")
    monkeypatch.setattr(os, "fsync", watch)
    write(store, "k", TABLE)
    names = [name for name, _ in steps]
    assert fnmatch(names[0], files.TEMPORARY)
    assert names[1:] == [store.folder.name, MANIFEST]
    assert [complete for _, complete in steps[:2]] == [False, False]
