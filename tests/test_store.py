"""Chunks on disk: what an interruption, a fault or another sweep may do to them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile

import netCDF4
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pounding_sweep.cube import write as writing
from pounding_sweep.errors import OutputError
from pounding_sweep.sweep import store as storing
from pounding_sweep.sweep.store import IDENTITY, MANIFEST, ChunkCorrupt, ChunkStore

ARRAYS = {
    "drift_max": np.array([[0.1, np.nan], [-0.0, 5e-324]]),
    "impact_count": np.array([3, -1, 2**31 - 1], dtype=np.int32),
    "status": np.array([0, 1, -127], dtype=np.int8),
    "seconds": np.array(1.5),
    "nothing": np.zeros((4, 0, 2)),
}


def same(a, b):
    assert set(a) == set(b)
    for name in a:
        assert a[name].dtype == b[name].dtype, name
        assert a[name].shape == b[name].shape, name
        assert a[name].tobytes() == b[name].tobytes(), name


@pytest.fixture
def store(tmp_path):
    return ChunkStore(tmp_path / "out.chunks", "digest-1", {"dt": "0.001", "method": "rk4"}).open()


def again(store):
    return ChunkStore(store.folder, store.identity, store.details).open()


def test_round_trip(store):
    assert store.completed() == set()
    store.write("a1", ARRAYS)
    store.write("b2", {"status": np.zeros(2, "i1")})
    other = again(store)
    assert other.completed() == {"a1", "b2"}
    same(other.read("a1"), ARRAYS)
    same(other.read("b2"), {"status": np.zeros(2, "i1")})


@settings(max_examples=40, deadline=None)
@given(
    st.dictionaries(
        st.from_regex(r"[a-z][a-z_0-9]{0,8}", fullmatch=True),
        hnp.arrays(
            st.sampled_from(["f8", "f4", "i8", "i4", "i2", "i1", "u1", "u8", ">f8", ">i4"]),
            hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
        ),
        max_size=4,
    )
)
def test_any_numbers_come_back_bit_for_bit(arrays):
    with tempfile.TemporaryDirectory() as folder:
        store = ChunkStore(folder, "x").open()
        store.write("k", arrays)
        native = {name: array.astype(array.dtype.newbyteorder("=")) for name, array in arrays.items()}
        same(store.read("k"), native)


def test_views_and_order_do_not_matter(store):
    base = np.arange(24.0).reshape(2, 3, 4)
    store.write("k", {"t": base.transpose(2, 0, 1), "s": base[:, ::2, 1]})
    same(store.read("k"), {"t": base.transpose(2, 0, 1), "s": base[:, ::2, 1]})


def test_a_chunk_is_plain_netcdf(store):
    store.write("k", ARRAYS)
    with netCDF4.Dataset(store.path("k")) as file:
        assert set(file.variables) == set(ARRAYS)
        assert not {**file.groups, **file.cmptypes, **file.vltypes, **file.enumtypes}


def test_written_again_the_last_one_counts(store):
    store.write("k", {"a": np.array([1.0])})
    store.write("k", {"a": np.array([2.0])})
    assert store.read("k")["a"].tolist() == [2.0]
    assert store.completed() == {"k"}


@pytest.mark.parametrize("key", ["", ".", "../up", "a/b", "-x", "a b", "x" * 129, "é"])
def test_keys_that_are_no_file_names(store, key):
    with pytest.raises(OutputError, match="chunk key"):
        store.write(key, ARRAYS)


@pytest.mark.parametrize(
    "arrays",
    [
        {"a": np.array(["text"])},
        {"a": np.array([object()])},
        {"a": np.array([1j])},
        {"a": np.array([True])},
        {"a": np.zeros(2, dtype=np.float16)},
    ],
)
def test_what_is_no_number(store, arrays):
    with pytest.raises(OutputError, match="only real numbers"):
        store.write("k", arrays)
    assert store.completed() == set()


def test_a_name_that_is_not_valid(store):
    with pytest.raises(OutputError, match="no valid name"):
        store.write("k", {"a/b": np.zeros(1)})


@pytest.mark.parametrize("cut", [1, 10, 60])
def test_a_torn_manifest_line_is_no_completion(store, cut):
    store.write("a", ARRAYS)
    whole = (store.folder / MANIFEST).read_bytes()
    store.write("b", ARRAYS)
    text = (store.folder / MANIFEST).read_bytes()
    (store.folder / MANIFEST).write_bytes(text[: len(whole) + cut])
    other = again(store)
    assert other.completed() == {"a"}
    with pytest.raises(OutputError, match="not complete"):
        other.read("b")
    # What follows is not glued to the torn line.
    other.write("c", ARRAYS)
    other.write("b", ARRAYS)
    assert again(store).completed() == {"a", "b", "c"}


def test_a_line_without_its_line_break_is_whole_or_torn(store):
    store.write("a", ARRAYS)
    path = store.folder / MANIFEST
    path.write_bytes(path.read_bytes().removesuffix(b"\n"))
    assert store.completed() == {"a"}
    store.write("b", ARRAYS)
    assert store.completed() == {"a", "b"}


@pytest.mark.parametrize(
    "line", [b"\x00\xff\xfe", b"[]", b"3", b'{"key": 1, "sha256": "0"}', b'{"key": "../x", "sha256": "0"}']
)
def test_lines_that_are_no_entries(store, line):
    store.write("a", ARRAYS)
    with (store.folder / MANIFEST).open("ab") as file:
        file.write(line + b"\n")
    store.write("b", ARRAYS)
    assert store.completed() == {"a", "b"}


def test_a_listed_chunk_without_file_is_not_complete(store):
    store.write("a", ARRAYS)
    store.path("a").unlink()
    assert store.completed() == set()
    store.write("b", ARRAYS)
    store.forget("b")
    store.forget("never")
    assert store.completed() == set()


def test_a_file_that_the_manifest_does_not_list_is_not_complete(store):
    store.write("a", ARRAYS)
    (store.folder / MANIFEST).unlink()
    assert again(store).completed() == set()


@pytest.mark.parametrize("damage", ["flip", "cut", "empty"])
def test_a_damaged_chunk_is_found(store, damage):
    store.write("a", ARRAYS)
    path = store.path("a")
    content = bytearray(path.read_bytes())
    if damage == "flip":
        content[len(content) // 2] ^= 1
    path.write_bytes({"flip": bytes(content), "cut": bytes(content[:-7]), "empty": b""}[damage])
    with pytest.raises(ChunkCorrupt, match=r"chunk 'a' .* is damaged.*; remove chunk-a\.nc and run the sweep again"):
        store.read("a")
    assert issubclass(ChunkCorrupt, OutputError)
    store.forget("a")
    store.write("a", ARRAYS)
    same(store.read("a"), ARRAYS)


def test_another_sweep_is_refused(store):
    store.write("a", ARRAYS)
    other = ChunkStore(store.folder, "digest-2", {"dt": "0.002", "method": "rk4"})
    with pytest.raises(
        OutputError, match=r"'digest-1' there, 'digest-2' here; they differ in dt \(0.001 there, 0.002 here\)"
    ):
        other.open()
    with pytest.raises(OutputError, match="Give another output path"):
        other.open("read")
    assert again(store).completed() == {"a"}
    assert other.open("fresh").completed() == set()
    with pytest.raises(OutputError, match="another sweep"):
        again(store)


def test_another_format_is_refused(store):
    (store.folder / IDENTITY).write_text(json.dumps({"format": 99, "identity": "digest-1"}))
    with pytest.raises(OutputError, match="format 99, not 1"):
        again(store)


@pytest.mark.parametrize("text", ["", "{", "[]", "3"])
def test_a_damaged_identity(store, text):
    (store.folder / IDENTITY).write_text(text)
    with pytest.raises(OutputError, match="is damaged"):
        again(store)


def test_somebody_elses_folder_is_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("years of work")
    (tmp_path / "chunk-1.nc").write_text("also mine")
    store = ChunkStore(tmp_path, "x")
    for attempt in (store.open, lambda: store.open("fresh"), store.discard):
        with pytest.raises(
            OutputError, match=r"not one of chunks: it has no identity\.json, but chunk-1\.nc, thesis\.txt"
        ):
            attempt()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["chunk-1.nc", "thesis.txt"]


def test_folders_that_cannot_be(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="is not a folder"):
        ChunkStore(tmp_path / "file", "x").open()
    with pytest.raises(OutputError, match="can't be made or written"):
        ChunkStore(tmp_path / "file" / "below", "x").open()
    with pytest.raises(OutputError, match="run the sweep first"):
        ChunkStore(tmp_path / "none", "x").open("read")
    assert not (tmp_path / "none").exists()
    with pytest.raises(OutputError, match="unknown mode 'w'"):
        ChunkStore(tmp_path / "none", "x").open("w")


def test_read_mode_reads(store):
    store.write("a", ARRAYS)
    same(ChunkStore(store.folder, "digest-1").open("read").read("a"), ARRAYS)


def test_discard_removes_only_what_is_its_own(store):
    store.write("a", ARRAYS)
    (store.folder / "notes.txt").write_text("mine")
    store.discard()
    assert [p.name for p in store.folder.iterdir()] == ["notes.txt"]
    (store.folder / "notes.txt").unlink()
    store.discard()
    assert not store.folder.exists()
    store.discard()


def test_fresh_keeps_foreign_files_and_works(store):
    store.write("a", ARRAYS)
    (store.folder / "notes.txt").write_text("mine")
    store.open("fresh")
    assert sorted(p.name for p in store.folder.iterdir()) == [IDENTITY, "notes.txt"]
    assert store.completed() == set()


def test_a_failed_write_leaves_nothing(store, monkeypatch):
    def full(path, arrays):
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(storing, "_save", full)
    with pytest.raises(OutputError, match=r"No space left on device.*free some space"):
        store.write("a", ARRAYS)
    assert [p.name for p in store.folder.iterdir()] == [IDENTITY]


KILLED = """
import os, sys
import numpy as np
from pounding_sweep.cube import write
from pounding_sweep.sweep import store as storing

store = storing.ChunkStore(sys.argv[1], "x").open()
store.write("first", {"a": np.arange(3.0)})
die = lambda *a, **k: os.kill(os.getpid(), 9)
where = sys.argv[2]
if where == "in the file":
    storing._sha256 = die
elif where == "before the manifest":
    store._append = die
elif where == "in the manifest":
    def append(line):
        with open(store._manifest, "ab") as file:
            file.write(line[:30].encode())
        die()
    store._append = append
store.write("second", {"a": np.arange(4.0)})
"""


@pytest.mark.parametrize("where", ["in the file", "before the manifest", "in the manifest"])
def test_a_killed_run_continues(tmp_path, where):
    folder = tmp_path / "chunks"
    done = subprocess.run([sys.executable, "-c", KILLED, str(folder), where], check=False)
    assert done.returncode == -9
    store = ChunkStore(folder, "x").open()
    assert store.completed() == {"first"}
    same(store.read("first"), {"a": np.arange(3.0)})
    store.write("second", {"a": np.arange(4.0)})
    assert store.completed() == {"first", "second"}
    store.discard()
    assert not folder.exists()


def test_killed_before_the_identity(tmp_path):
    folder = tmp_path / "chunks"
    folder.mkdir()
    name = ".pounding_sweep-0123456789abcdef.part"
    (folder / name).write_text("{")
    assert writing.is_temporary(name)
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
    store.write("k", ARRAYS)
    names = [name for name, _ in steps]
    assert writing.is_temporary(names[0])
    assert names[1:] == [store.folder.name, MANIFEST, store.folder.name]
    assert [complete for _, complete in steps[:2]] == [False, False]
