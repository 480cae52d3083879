"""Chunks on disk: what an interruption, a fault or another sweep may do to them."""

from __future__ import annotations

import mmap
import os
import subprocess
import sys
import tempfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pounding_sweep.base import files
from pounding_sweep.base.errors import OutputError
from pounding_sweep.base.lock import HOLDER, LOCK
from pounding_sweep.resume import checkpoint as storing
from pounding_sweep.resume.checkpoint import IDENTITY, MANIFEST, ChunkCorrupt, ChunkStore

KIND = np.dtype([("drift_max", "f8", (1, 2)), ("impact_count", "i4"), ("status", "i1")], align=True)
TABLE = np.array(
    [([[0.1, np.nan]], 3, 0), ([[-0.0, 5e-324]], -1, 1), ([[np.inf, -1e308]], 2**31 - 1, -127)],
    KIND,
)


def one(*numbers):
    """A table of one field."""
    return np.array([(number,) for number in numbers], [("a", "f8")])


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


def test_a_cube_may_be_written_in_the_folder_while_it_is_made_ready(tmp_path):
    store = ChunkStore(tmp_path / "out.chunks", "digest-1")
    with store.lock() as begun, files.replacing(tmp_path / "out.nc", store.folder) as temporary:
        assert not begun
        temporary.write_text("cube")
        store.open()
    assert (tmp_path / "out.nc").read_text() == "cube"


def test_round_trip(store):
    assert store.completed() == set()
    assert store.size() == 0
    store.write("a1", TABLE)
    store.write("b2", one(1.0))
    other = again(store)
    assert other.completed() == {"a1", "b2"}
    same(other.read("a1"), TABLE)
    same(other.read("b2"), one(1.0))
    assert other.size() == sum(p.stat().st_size for p in store.folder.glob("chunk-*.npy")) > TABLE.nbytes


NUMBERS = st.sampled_from(["f8", "f4", "i8", "i4", "i2", "i1", "u1", "u8", ">f8", ">i4"])
FIELDS = st.lists(
    st.tuples(st.from_regex(r"[a-z][a-z_0-9]{0,8}", fullmatch=True), NUMBERS, hnp.array_shapes(max_dims=2, max_side=4)),
    min_size=1,
    max_size=4,
    unique_by=lambda field: field[0],
)


@given(st.data(), FIELDS, st.booleans())
def test_any_numbers_come_back_bit_for_bit(data, fields, align):
    kind = np.dtype(fields, align=align)
    n = data.draw(st.integers(1, 4))
    table = np.frombuffer(data.draw(st.binary(min_size=n * kind.itemsize, max_size=n * kind.itemsize)), kind)
    with tempfile.TemporaryDirectory() as folder:
        store = ChunkStore(folder, "x").open()
        store.write("k", table)
        same(store.read("k"), table)


def test_views_and_order_do_not_matter(store):
    store.write("k", np.concatenate([TABLE, TABLE])[::-2])
    same(store.read("k"), np.concatenate([TABLE, TABLE])[::-2].copy())


def test_a_chunk_is_a_plain_table(store):
    """Read without this package, and no more of it than is used."""
    store.write("k", TABLE)
    same(np.load(store.path("k"), allow_pickle=False), TABLE)
    assert isinstance(store.read("k").base.obj, mmap.mmap)


def test_written_again_the_last_one_counts(store):
    store.write("k", one(1.0))
    store.write("k", one(2.0))
    assert store.read("k")["a"].tolist() == [2.0]
    assert store.completed() == {"k"}


@pytest.mark.parametrize("key", ["", ".", "../up", "a/b", "-x", "a b", "x" * 129, "é"])
def test_keys_that_are_no_file_names(store, key):
    with pytest.raises(OutputError, match="chunk key"):
        store.write(key, TABLE)


@pytest.mark.parametrize(
    "table",
    [
        np.zeros(3),
        np.zeros((2, 2), KIND),
        np.zeros(0, KIND),
        np.zeros(2, [("a", "U4")]),
        np.zeros(2, [("a", object)]),
        np.zeros(2, [("a", "c16")]),
        np.zeros(2, [("a", "f8"), ("b", "?")]),
    ],
)
def test_what_is_no_table_of_numbers(store, table):
    with pytest.raises(OutputError, match="is no table; give one row per scenario"):
        store.write("k", table)
    assert store.completed() == set()


@pytest.mark.parametrize("cut", [1, 10, 60])
def test_a_torn_manifest_line_is_no_completion(store, cut):
    store.write("a", TABLE)
    whole = (store.folder / MANIFEST).read_bytes()
    store.write("b", TABLE)
    text = (store.folder / MANIFEST).read_bytes()
    (store.folder / MANIFEST).write_bytes(text[: len(whole) + cut])
    other = again(store)
    assert other.completed() == {"a"}
    with pytest.raises(OutputError, match="not complete"):
        other.read("b")
    # What follows is not glued to the torn line.
    other.write("c", TABLE)
    other.write("b", TABLE)
    assert again(store).completed() == {"a", "b", "c"}


def test_a_line_without_its_line_break_is_whole_or_torn(store):
    store.write("a", TABLE)
    path = store.folder / MANIFEST
    path.write_bytes(path.read_bytes().removesuffix(b"\n"))
    assert store.completed() == {"a"}
    store.write("b", TABLE)
    assert store.completed() == {"a", "b"}


@pytest.mark.parametrize(
    "line", [b"\x00\xff\xfe", b"[]", b"3", b'{"key": 1, "crc32": 0}', b'{"key": "../x", "crc32": 0}']
)
def test_lines_that_are_no_entries(store, line):
    store.write("a", TABLE)
    with (store.folder / MANIFEST).open("ab") as file:
        file.write(line + b"\n")
    store.write("b", TABLE)
    assert store.completed() == {"a", "b"}


def test_a_listed_chunk_without_file_is_not_complete(store):
    store.write("a", TABLE)
    store.path("a").unlink()
    assert store.completed() == set()
    store.write("b", TABLE)
    store.forget("b")
    store.forget("never")
    assert store.completed() == set()


def test_a_chunk_may_be_written_while_others_are_listed(store, monkeypatch):
    """The thread that writes is not waited for when the next stage looks what is there."""
    store.write("a", TABLE)
    path = store.path

    def meanwhile(key):
        monkeypatch.setattr(store, "path", path)
        store.write("b", TABLE)
        return path(key)

    monkeypatch.setattr(store, "path", meanwhile)
    assert store.completed() == {"a"}
    same(store.read("b"), TABLE)
    assert store.completed() == {"a", "b"}


def test_a_file_that_the_manifest_does_not_list_is_not_complete(store):
    store.write("a", TABLE)
    (store.folder / MANIFEST).unlink()
    assert again(store).completed() == set()


@pytest.mark.parametrize("damage", ["flip", "cut", "empty"])
def test_a_damaged_chunk_is_found(store, damage):
    store.write("a", TABLE)
    path = store.path("a")
    content = bytearray(path.read_bytes())
    if damage == "flip":
        content[len(content) // 2] ^= 1
    path.write_bytes({"flip": bytes(content), "cut": bytes(content[:-7]), "empty": b""}[damage])
    with pytest.raises(ChunkCorrupt, match=r"^chunk 'a' in '.*' is damaged: its CRC-32 is [^;]*$"):
        store.read("a")
    assert issubclass(ChunkCorrupt, OutputError)
    store.forget("a")
    store.write("a", TABLE)
    same(store.read("a"), TABLE)


@pytest.mark.parametrize(
    "change",
    [
        lambda table: table[[0, *range(len(table))]],
        lambda table: table[["status"]],
        lambda table: table.astype([(name, "f4", table.dtype[name].shape) for name in table.dtype.names]),
    ],
)
@pytest.mark.filterwarnings("ignore:overflow encountered in cast")
def test_a_chunk_of_another_form_is_damaged(store, change):
    """Whatever the manifest says of it."""
    store.write("a", np.array(change(TABLE)))
    with pytest.raises(ChunkCorrupt, match="is damaged: it is another table than it should be"):
        store.read("a", KIND, len(TABLE))


def test_another_sweep_is_refused(store):
    store.write("a", TABLE)
    other = ChunkStore(store.folder, "digest-2", {"dt": "0.002", "method": "rk4"})
    with pytest.raises(
        OutputError, match=r"they differ in dt \(0.001 there, 0.002 here\); identity 'digest-1' there, 'digest-2' here"
    ):
        other.open()
    with pytest.raises(OutputError, match="Give another output path"), other.lock():
        pass
    assert again(store).completed() == {"a"}


@pytest.mark.parametrize("text", ["", "{", "[]", "3"])
def test_a_damaged_identity(store, text):
    (store.folder / IDENTITY).write_text(text)
    with pytest.raises(OutputError, match="is damaged"):
        again(store)


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


def test_folders_that_cannot_be(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="is not a folder"):
        ChunkStore(tmp_path / "file", "x").open()
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with pytest.raises(OutputError, match="can't be made or written"):
        ChunkStore(tmp_path / "link", "x").open()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "link"]


def test_discard_removes_only_what_is_its_own(store):
    store.write("a", TABLE)
    (store.folder / "notes.txt").write_text("mine")
    store.discard()
    assert [p.name for p in store.folder.iterdir()] == ["notes.txt"]
    (store.folder / "notes.txt").unlink()
    store.discard()
    assert not store.folder.exists()
    store.discard()


def test_what_nfs_keeps_of_removed_files_is_nobodys(store):
    """A removed file that is open somewhere stays under such a name until it is closed."""
    store.write("a", TABLE)
    kept = store.folder / ".nfs00000000012ab34c00000001"
    kept.write_text("removed")
    store.discard()
    assert [p.name for p in store.folder.iterdir()] == [kept.name]
    with store.lock():
        assert again(store).completed() == set()
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
        mended.write("a", TABLE)
    assert ChunkStore(first.folder, "two").open().completed() == {"a"}
    with pytest.raises(OutputError, match="belong to another sweep"):
        first.open()


def test_who_locks_removes_what_a_killed_run_was_writing(store):
    store.write("a", TABLE)
    with files.replacing(store.folder / "cube", store.folder) as temporary:
        temporary.write_text("half")
        with store.lock():
            assert not temporary.exists()
        temporary.write_text("")
    (store.folder / "cube").unlink()
    assert again(store).completed() == {"a"}


def test_chunks_that_are_removed_while_they_are_counted(store, monkeypatch):
    store.write("a", TABLE)
    monkeypatch.setattr(store, "completed", lambda: {"a", "gone"})
    assert store.size() == store.path("a").stat().st_size


def test_a_failed_write_leaves_nothing(store, monkeypatch):
    def full(path, table):
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(storing, "_save", full)
    with pytest.raises(OutputError, match=r"No space left on device.*free some space"):
        store.write("a", TABLE)
    assert [p.name for p in store.folder.iterdir()] == [IDENTITY]


KILLED = """
import os, sys
import numpy as np
from pounding_sweep.output import netcdf as write
from pounding_sweep.resume import checkpoint as storing

store = storing.ChunkStore(sys.argv[1], "x").open()
store.write("first", np.zeros(3, [("a", "f8")]))
die = lambda *a, **k: os.kill(os.getpid(), 9)
where = sys.argv[2]
if where == "in the file":
    storing._save = lambda path, table: (path.write_bytes(b"half"), die())
elif where == "before the manifest":
    store._append = die
elif where == "in the manifest":
    def append(line):
        with open(store._manifest, "ab") as file:
            file.write(line[:30].encode())
        die()
    store._append = append
store.write("second", np.ones(4, [("a", "f8")]))
"""


@pytest.mark.parametrize(
    "where",
    [*(pytest.param(w, marks=pytest.mark.slow) for w in ("in the file", "before the manifest")), "in the manifest"],
)
def test_a_killed_run_continues(tmp_path, where):
    folder = tmp_path / "chunks"
    done = subprocess.run([sys.executable, "-c", KILLED, str(folder), where], check=False)
    assert done.returncode == -9
    store = ChunkStore(folder, "x").open()
    assert store.completed() == {"first"}
    same(store.read("first"), one(0.0, 0.0, 0.0))
    store.write("second", np.ones(4, [("a", "f8")]))
    assert store.completed() == {"first", "second"}
    store.discard()
    assert not folder.exists()


def test_killed_before_the_identity(tmp_path):
    folder = tmp_path / "chunks"
    folder.mkdir()
    name = ".pounding_sweep-0123456789abcdef.part"
    (folder / name).write_text("{")
    assert files.is_temporary(name)
    assert ChunkStore(folder, "x").open().completed() == set()


def test_the_chunk_is_on_disk_before_the_manifest_names_it(store, monkeypatch):
    steps = []
    fsync = os.fsync

    def watch(handle):
        steps.append((os.path.basename(os.readlink(f"/proc/self/fd/{handle}")), "k" in store.completed()))
        fsync(handle)

    if not os.path.isdir("/proc/self/fd"):
        pytest.skip("needs /proc")
    monkeypatch.setattr(os, "fsync", watch)
    store.write("k", TABLE)
    names = [name for name, _ in steps]
    assert files.is_temporary(names[0])
    assert names[1:] == [store.folder.name, MANIFEST, store.folder.name]
    assert [complete for _, complete in steps[:2]] == [False, False]
