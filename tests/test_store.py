"""Chunks on disk: what an interruption, a fault or another sweep may do to them."""

from __future__ import annotations

import os

import numpy as np
import pytest

from pounding_sweep.base import files
from pounding_sweep.base.errors import OutputError
from pounding_sweep.base.files import HOLDER, LOCK
from pounding_sweep.resume.checkpoint import IDENTITY, MANIFEST, ChunkCorrupt, ChunkStore

KIND = np.dtype([("drift_max", "f8", (1, 2)), ("impact_count", "i4"), ("status", "i1")], align=True)
TABLE = np.array(
    [([[0.1, np.nan]], 3, 0), ([[-0.0, 5e-324]], -1, 1), ([[np.inf, -1e308]], 2**31 - 1, -127)],
    KIND,
)


def one(*numbers):
    """A table of one field."""
    return np.array([(number,) for number in numbers], [("a", "f8")])


def write(store, key, table):
    store.write(key, table, np.arange(len(table)) + 5)


def same(a, b):
    assert a.dtype.names == b.dtype.names
    for name in b.dtype.names:
        assert a[name].dtype == b[name].dtype, name
        assert a[name].shape == b[name].shape, name
        assert a[name].tobytes() == b[name].tobytes(), name


@pytest.fixture
def store(tmp_path):
    return ChunkStore(tmp_path / "out.chunks", "digest-1", {"dt": "0.001", "method": "rk4"}).open()


def again(store):
    return ChunkStore(store.folder, store.identity, store.details).open()


def test_round_trip(store):
    assert store.completed() == {}
    assert store.size() == 0
    write(store, "a1", TABLE)
    write(store, "b2", one(1.0))
    other = again(store)
    assert set(other.completed()) == {"a1", "b2"}
    same(other.read("a1"), TABLE)
    same(other.read("b2"), one(1.0))
    assert other.rows("a1").tolist() == [5, 6, 7]
    assert other.size() == sum(p.stat().st_size for p in store.folder.glob("chunk-*.npy")) > TABLE.nbytes


def test_a_chunk_is_a_plain_table(store):
    """Read without this package, and no more of it than is used."""
    write(store, "k", TABLE)
    same(np.load(store.path("k"), allow_pickle=False), TABLE)
    assert isinstance(store.read("k").base, np.memmap)


def test_written_again_the_last_one_counts(store):
    write(store, "k", one(1.0))
    write(store, "k", one(2.0))
    assert store.read("k")["a"].tolist() == [2.0]
    assert set(store.completed()) == {"k"}


@pytest.mark.parametrize("cut", [1, 10, 60])
def test_a_torn_manifest_line_is_no_completion(store, cut):
    write(store, "a", TABLE)
    whole = (store.folder / MANIFEST).read_bytes()
    write(store, "b", TABLE)
    text = (store.folder / MANIFEST).read_bytes()
    (store.folder / MANIFEST).write_bytes(text[: len(whole) + cut])
    other = again(store)
    assert set(other.completed()) == {"a"}
    with pytest.raises(OutputError, match="not complete"):
        other.read("b")
    # What follows is not glued to the torn line.
    write(other, "c", TABLE)
    write(other, "b", TABLE)
    assert set(again(store).completed()) == {"a", "b", "c"}


def test_a_listed_chunk_without_file_is_not_complete(store):
    write(store, "a", TABLE)
    store.path("a").unlink()
    assert store.completed() == {}
    write(store, "b", TABLE)
    store.forget("b")
    store.forget("never")
    assert store.completed() == {}


def test_a_chunk_may_be_written_while_others_are_listed(store, monkeypatch):
    """The thread that writes is not waited for when the next stage looks what is there."""
    write(store, "a", TABLE)
    path = store.path

    def meanwhile(key):
        monkeypatch.setattr(store, "path", path)
        write(store, "b", TABLE)
        return path(key)

    monkeypatch.setattr(store, "path", meanwhile)
    assert set(store.completed()) == {"a"}
    same(store.read("b"), TABLE)
    assert set(store.completed()) == {"a", "b"}


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
    store.forget("a")
    write(store, "a", TABLE)
    same(store.read("a"), TABLE)


def test_another_sweep_is_refused(store):
    write(store, "a", TABLE)
    other = ChunkStore(store.folder, "digest-2", {"dt": "0.002", "method": "rk4"})
    with pytest.raises(
        OutputError, match=r"they differ in dt \(0.001 there, 0.002 here\); identity 'digest-1' there, 'digest-2' here"
    ):
        other.open()
    with pytest.raises(OutputError, match="Give another output path"), other.lock():
        pass
    assert set(again(store).completed()) == {"a"}


def test_somebody_elses_folder_is_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("years of work")
    (tmp_path / "chunk-1.npy").write_text("also mine")
    store = ChunkStore(tmp_path, "x")
    for attempt in (store.open, store.lock().__enter__, store.discard):
        with pytest.raises(
            OutputError, match=r"not one of chunks: it has no identity\.json, but chunk-1\.npy, thesis\.txt"
        ):
            attempt()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["chunk-1.npy", "thesis.txt"]


def test_discard_removes_only_what_is_its_own(store):
    write(store, "a", TABLE)
    (store.folder / "notes.txt").write_text("mine")
    store.discard()
    assert [p.name for p in store.folder.iterdir()] == ["notes.txt"]
    (store.folder / "notes.txt").unlink()
    store.discard()
    assert not store.folder.exists()
    store.discard()


def test_what_nfs_keeps_of_removed_files_is_nobodys(store):
    """A removed file that is open somewhere stays under such a name until it is closed."""
    write(store, "a", TABLE)
    kept = store.folder / ".nfs00000000012ab34c00000001"
    kept.write_text("removed")
    store.discard()
    assert [p.name for p in store.folder.iterdir()] == [kept.name]
    with store.lock():
        assert again(store).completed() == {}
        kept.unlink()
        store.discard()
    assert not store.folder.exists()


def test_a_sweep_that_finished_nothing_leaves_its_folder_to_the_next(tmp_path):
    """As when somebody stops a run at once, mends the sweep file, and runs it again."""
    first = ChunkStore(tmp_path / "out.parts", "one", {"dt": "0.001"}).open()
    first.expect({"scenarios": 3})
    (first.folder / "chunk-b.npy").write_bytes(b"not in the manifest yet")
    mended = ChunkStore(first.folder, "two", {"dt": "0.002"})
    with mended.lock():
        mended.open()
        assert [path.name for path in sorted(first.folder.iterdir())] == [HOLDER, IDENTITY, LOCK]
        write(mended, "a", TABLE)
    assert set(ChunkStore(first.folder, "two").open().completed()) == {"a"}
    with pytest.raises(OutputError, match="belong to another sweep"):
        first.open()


def test_a_failed_write_leaves_nothing(store, monkeypatch):
    def full(file, table, **_):
        file.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "save", full)
    with pytest.raises(OutputError, match=r"No space left on device.*free some space"):
        write(store, "a", TABLE)
    assert [p.name for p in store.folder.iterdir()] == [IDENTITY]


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
    assert files.is_temporary(names[0])
    assert names[1:] == [store.folder.name, MANIFEST, store.folder.name]
    assert [complete for _, complete in steps[:2]] == [False, False]
