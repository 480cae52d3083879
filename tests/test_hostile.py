"""Hostile input: the answer is right or a clear error, in bounds, in a message that a terminal can bear."""

from __future__ import annotations

import collections
import json
import math
import os
import pickle
import random
import re
import signal
import tracemalloc
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

import h5py
import netCDF4
import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from record_files import NETWORKS, knet
from scenes import LAWS, call, hand_cube, make, random_fill
from test_cli import bad
from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK

import pounding_sweep as ps
from pounding_sweep.base import STANDARD_GRAVITY, errors
from pounding_sweep.base.errors import (
    InputError,
    PoundingSweepError,
    RecordError,
    SceneError,
    SweepError,
    repr_short,
    unknown,
)
from pounding_sweep.base.text import print_json, print_pairs, print_table
from pounding_sweep.model.building import Building
from pounding_sweep.model.scene import Wall
from pounding_sweep.output.dataset import VERSION_ATTRIBUTE, CubeParts
from pounding_sweep.output.describe import describe
from pounding_sweep.output.export import export_cube
from pounding_sweep.output.netcdf import NETCDF_LOCK, open_cube, write_cube, write_in_slabs
from pounding_sweep.plan.plan import make_plan
from pounding_sweep.records import Record, find_record, list_records, read_record, resolve_records
from pounding_sweep.request.axes import Range
from pounding_sweep.request.build import build_spec
from pounding_sweep.request.toml import load_spec

SWEEPS = Path(__file__).parent.parent / "sweeps"

VALUES = [round(0.1 * ((7 * i) % 11 - 5), 7) for i in range(40)]
_BODY = "\n".join("".join(f"{v:15.7E}" for v in VALUES[i : i + 5]) for i in range(0, len(VALUES), 5))
RECORDS = {
    "new.at2": "PEER STRONG MOTION DATABASE RECORD\nNORTHRIDGE 01/17/94, ARLETA, 90\n"
    f"ACCELERATION TIME SERIES IN UNITS OF G\nNPTS=    {len(VALUES)}, DT=  .02000 SEC\n{_BODY}\n",
    "old.AT2": "PACIFIC ENGINEERING AND ANALYSIS STRONG-MOTION DATA\nARLETA\n"
    f"ACCELERATION TIME HISTORY IN UNITS OF G\n   {len(VALUES)}   .0200   NPTS, DT\n{_BODY}\n",
    "knet.NS": knet([round(1e5 * v) for v in VALUES], seconds=len(VALUES) / 100),
    "two.csv": "time (s),acc (m/s2)\n" + "".join(f"{0.01 * i:.2f},{v}\n" for i, v in enumerate(VALUES)),
    **NETWORKS,
}


def twin(path):
    """Read a record the plain way: numbers after the header, as float() has them; ValueError where it has none."""
    lines = path.read_bytes().decode("utf-8").split("\n")
    if path.suffix == ".csv":
        rows = [[float(cell) for cell in line.split(",")] for line in lines[1:] if line.strip()]
        return np.array([row[1] for row in rows])
    if path.suffix == ".NS":
        counts = np.array([float(word) for line in lines[17:] for word in line.split()])
        full, steps = re.search(r"^Scale Factor +(.+)\(gal\)/(.+)$", "\n".join(lines), re.MULTILINE).groups()
        return (counts - counts.mean()) * (float(full) / float(steps) * 0.01)
    if path.suffix.lower() != ".at2":
        raise ValueError
    return np.array([float(word) for line in lines[4:] for word in line.split()]) * STANDARD_GRAVITY


def damage_all(tmp_path, sources, read, per_source, seed):
    """Read damaged copies of every source."""
    here = collections.Counter()
    for name, raw in sources.items():
        path = tmp_path / name
        for kind, data in damaged(raw, TEXT_FAULTS, per_source, seed):
            path.write_bytes(data)
            try:
                with not_hanging(f"{name}, {kind}"):
                    read(path)
            except PoundingSweepError:
                here["refused"] += 1
            else:
                here["read"] += 1
    assert here["refused"] > per_source * len(sources) / 4
    assert here["read"] > 0


def check_record(path):
    """Read a record; where the plain way reads it too, both agree."""
    record = read_record(path)
    assert np.isfinite(record.acceleration).all()
    assert record.dt > 0
    try:
        plain = twin(path)
    except (ValueError, IndexError, AttributeError):
        return
    if record.n_points == len(plain) and np.isfinite(plain).all():
        np.testing.assert_allclose(record.acceleration, plain, rtol=1e-12)


def check_sweep(path):
    """Read a sweep file: one that still is valid has a size."""
    assert ps.load_sweep(path).spec.n_scenarios > 0


#: How often each file is damaged, and the seed.
MANY = [(24, 1), pytest.param(720, 3, marks=pytest.mark.slow)]


@pytest.mark.parametrize(("count", "seed"), MANY)
def test_damaged_records(tmp_path, count, seed):
    sources = {name: text.encode() for name, text in RECORDS.items()}
    damage_all(tmp_path, sources, check_record, count, seed)


@pytest.mark.parametrize(("count", "seed"), MANY)
def test_damaged_sweep_files(tmp_path, count, seed):
    """Those that users copy."""
    sources = {name: (SWEEPS / name).read_bytes() for name in ("quickstart.toml", "two_buildings_and_wall.toml")}
    damage_all(tmp_path, sources, check_sweep, count, seed + 1)


@given(data=st.one_of(st.binary(max_size=300), st.text(max_size=200).map(lambda text: text.encode("utf-8", "ignore"))))
def test_any_bytes_as_a_record_or_a_sweep(data, tmp_path_factory):
    path = tmp_path_factory.getbasetemp() / "any.txt"
    path.write_bytes(data)
    with not_hanging("any bytes"), suppress(RecordError):
        assert np.isfinite(read_record(path, dt=0.01, units="g").acceleration).all()
    with not_hanging("any bytes"), suppress(SweepError):
        check_sweep(path)


scalars = st.one_of(
    st.booleans(),
    st.integers(-(2**70), 2**70),
    st.floats(width=64),
    st.text(st.characters(codec="utf-8", exclude_characters='"\\\x7f', min_codepoint=32), max_size=12),
)
values = st.recursive(scalars, lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(
    st.sampled_from(["start", "stop", "count", "left", "period_factor", "law", "path", "record", "pulse", "wall"]),
    inner, max_size=3,
)), max_leaves=6)  # fmt: skip
KEYS = {
    "scene": ["preset", "row", "gaps", "contact", "contact.hertz"],
    "sweep": ["records", "laws", "gaps", "scales", "building", "building.left", "cases", "restitutions"],
    "solver": ["dt", "beta", "method", "accuracy"],
    "output": ["variables"],
}
keys = st.sampled_from(["title", *KEYS, *(f"{table}.{key}" for table, listed in KEYS.items() for key in listed)])


def toml(value):
    """Write a value as TOML."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, float):
        return repr(value) if np.isfinite(value) else str(value)
    return json.dumps(value, ensure_ascii=False)


@given(changes=st.dictionaries(keys, values, min_size=1, max_size=3))
def test_any_values_in_a_sweep_file(changes, tmp_path_factory):
    """Valid TOML of the wrong types, anywhere."""
    path = tmp_path_factory.getbasetemp() / "any.toml"
    usual = {"scene.preset": "mate2015", "sweep.records": ["el_centro"], "sweep.laws": ["linear"]}
    path.write_text("".join(f"{key} = {toml(value)}\n" for key, value in (usual | changes).items()), encoding="utf-8")
    with not_hanging("any values"), suppress(SweepError):
        assert ps.load_sweep(path).spec.n_scenarios >= 1


@pytest.fixture
def places(tmp_path):
    """Return a folder of records and a record outside of it."""
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    for folder in (inside, outside):
        folder.mkdir()
    (inside / "mine.at2").write_text(RECORDS["new.at2"])
    (outside / "secret.at2").write_text(RECORDS["new.at2"])
    return inside, outside


@pytest.mark.parametrize("name", ["../outside/secret", "../outside/secret.at2", "/{}", "..", "*", "\0"])
def test_a_name_never_leaves_the_folders(places, name):
    inside, outside = places
    assert find_record("mine", folders=inside).n_points == len(VALUES)
    with pytest.raises(RecordError):
        find_record(name.format(outside / "secret.at2"), folders=inside)
    with pytest.raises(SweepError, match=r"records\[0\]"):
        ps.load_sweep(_sweep_file(inside, '[{ record = "../outside/secret" }]'))


def _sweep_file(folder, records, axes=""):
    path = folder / "s.toml"
    path.write_text(f'[scene]\npreset = "mate2015"\n[sweep]\nrecords = {records}\nlaws = ["kelvin_voigt"]\n{axes}\n')
    return path


def test_a_sweep_file_that_is_none(tmp_path):
    impossible = dict.fromkeys(["\0", "~nobody-of-this-name/x.toml", "x" * 5000], "can't be read")
    (tmp_path / "latin.toml").write_bytes('title = "\xfc"'.encode("latin-1"))
    others = {tmp_path / "latin.toml": "is not UTF-8", tmp_path: "Is a directory"}
    others |= {tmp_path / "absent.toml": "can't be read: No such file"}
    for path, why in (impossible | others).items():
        with pytest.raises(SweepError, match=why):
            ps.load_sweep(path)


def test_too_large_a_sweep_is_refused_before_anything_is_made(tmp_path):
    axes = {"gaps": 10**6, "scales": 10**6}
    size = math.prod(axes.values())
    given = {name: Range(0.5, 0.9, n) for name, n in axes.items()}
    ranges = "\n".join(f"{name} = {{ start = 0.5, stop = 0.9, count = {n} }}" for name, n in axes.items())
    file = _sweep_file(tmp_path, '["el_centro"]', ranges)
    for ask in (lambda: ps.Sweep("mate2015", "el_centro", "kelvin_voigt", **given), lambda: ps.load_sweep(file)):
        with pytest.raises(SweepError):  # what is loaded once, such as modules and the record, is not its memory
            ask()
        tracemalloc.start()
        try:
            with (
                not_hanging("refusing"),
                pytest.raises(SweepError, match=re.escape(f"= {size} scenarios ({size:.3g})")),
            ):
                ask()
            assert tracemalloc.get_traced_memory()[1] < 20e6
        finally:
            tracemalloc.stop()


def small_cube():
    axes = {"law": LAWS, "gap": [0.01, 0.02, 0.03], "record": ["one", "two"]}
    return hand_cube(axes, random_fill(1, "displacement_max", "impact_force_max", "impact_count"))


@pytest.mark.parametrize("lock", [NETCDF_LOCK, NETCDF4_PYTHON_LOCK], ids=["ours", "xarray's"])
def test_values_of_a_cube_are_read_under_the_lock(tmp_path, lock):
    """And under that of xarray, whose `to_netcdf` writes while threads of dask read."""
    path = write_cube(small_cube(), tmp_path / "cube.nc")
    with open_cube(path) as cube, ThreadPoolExecutor(1) as pool:
        with lock:
            reads = pool.submit(lambda: cube["impact_count"].values)
            with pytest.raises(TimeoutError):
                reads.result(0.3)
        assert reads.result(60).shape == cube["impact_count"].shape
        with NETCDF_LOCK:
            cube["displacement_max"].load()  # of the same thread


def test_a_cube_in_chunks_is_written(tmp_path):
    """By threads of dask, or by this one, as each must have the lock to read."""
    path = write_cube(small_cube(), tmp_path / "cube.nc")
    with open_cube(path) as cube:
        export_cube(cube.chunk(gap=1), tmp_path / "again.csv")
        with open_cube(write_cube(cube.chunk(gap=1), tmp_path / "again.nc")) as again:
            assert again.identical(cube)


@pytest.mark.usefixtures("stub_engine")
def test_what_is_written_anew_with_xarray_is_a_cube_again(tmp_path):
    """Also a part, and a cube that was never in a file; none has texts of any length."""
    path = write_cube(small_cube(), tmp_path / "cube.nc")
    with open_cube(path) as cube:
        cube.to_netcdf(tmp_path / "whole.nc")
        cube.isel(law=[0], gap=0).to_netcdf(tmp_path / "part.nc")
        cube.chunk(gap=1).to_netcdf(tmp_path / "chunked.nc")
    make().run().to_netcdf(tmp_path / "memory.nc")
    for name in ("whole", "part", "chunked", "memory"):
        with netCDF4.Dataset(tmp_path / f"{name}.nc") as file:
            assert not [key for key, variable in file.variables.items() if variable.dtype is str]
            assert file["law"].dtype == "S1"
        open_cube(tmp_path / f"{name}.nc").close()
    with open_cube(path) as cube, open_cube(tmp_path / "whole.nc") as again:
        assert again.identical(cube)


def test_attributes_beyond_ascii_are_characters_too(tmp_path):
    """Also of a cube that was sent to another process."""
    cube = small_cube().assign_attrs(title="Étude № 5")
    cube["gap"].attrs["comment"] = "größer"
    path = write_cube(cube, tmp_path / "cube.nc")
    with h5py.File(path) as file:
        for attributes, name in ((file.attrs, "title"), (file["gap"].attrs, "comment")):
            assert not attributes.get_id(name).get_type().is_variable_str()
    with open_cube(path) as again, pickle.loads(pickle.dumps(again)) as sent:
        assert (again.attrs["title"], again["gap"].attrs["comment"]) == ("Étude № 5", "größer")
        assert again.identical(cube)
        assert sent.identical(cube)
    links = [os.readlink(link) for link in Path("/proc/self/fd").iterdir() if link.is_symlink()]
    assert str(path) not in links  # others may write to the file then, whoever still has the dataset


def test_a_flipped_bit_of_a_value_is_noticed(tmp_path):
    """Arrays carry checksums, compressed or not: a value is as written, or can't be read."""
    values = np.random.default_rng(1).random((3, 3, 2))
    made = {"status": np.zeros(3, "i1"), "drift_max": values}
    data_vars = {"status": (("gap",), made["status"], {}), "drift_max": (("gap", "building", "storey"), values, {})}
    cube = CubeParts(data_vars, {}, {VERSION_ATTRIBUTE: "0.1.0"})
    path = write_in_slabs(cube, tmp_path / "cube.nc", lambda _: made)
    data = bytearray(path.read_bytes())
    data[data.index(values.tobytes()) + 3] ^= 1
    (tmp_path / "flipped.nc").write_bytes(data)
    with open_cube(path) as whole:
        np.testing.assert_array_equal(whole["drift_max"], values)
    with open_cube(tmp_path / "flipped.nc") as flipped, pytest.raises(RuntimeError, match="NetCDF: HDF error"):
        flipped["drift_max"].load()
    said = "values of a netCDF file can't be read (NetCDF: HDF error): it is damaged; make it again"
    assert bad("info", tmp_path / "flipped.nc") == said


SWEEP = '[scene]\npreset = "mate2015"\n[sweep]\nrecords = ["el_centro"]\nlaws = ["linear"]\n'
LINES = "two\nlines"
ESCAPE = "\x1b[2Jcleared"


def write(folder, text, name="s.toml"):
    path = folder / name
    path.write_bytes(text.encode("utf-8"))
    return path


def refused(folder, text):
    with pytest.raises(SweepError) as caught:
        load_spec(write(folder, text))
    assert len(str(caught.value)) < 20_000
    return str(caught.value)


@pytest.mark.parametrize("depth", [20, 500, 100_000])
@pytest.mark.parametrize("form", ["{}", "gaps = {}", "records = {}", "cases = [{}]", "building = {{ left = {} }}"])
def test_deep_values_are_refused(tmp_path, depth, form):
    deep = "[" * depth + "]" * depth
    text = f"[scene]\npreset = 'mate2015'\n[sweep]\n{form.format('x = ' + deep if form == '{}' else deep)}\n"
    assert "its arrays are too deep" in refused(tmp_path, text) or depth <= 500


@pytest.mark.parametrize("key", ["sweep.gaps", "scene.preset"])
@pytest.mark.parametrize(
    "value", ['"' + "x" * 300_000 + '"', "[" + "7," * 20_000 + "[]]", "0x" + "f" * 9000], ids=["text", "list", "number"]
)
def test_long_values_make_short_messages(tmp_path, key, value):
    usual = {"scene.preset": "'mate2015'", "sweep.records": "['el_centro']", "sweep.laws": "['linear']"}
    refused(tmp_path, "".join(f"{name} = {given}\n" for name, given in (usual | {key: value}).items()))


def test_a_mark_of_utf8_is_no_part_of_the_text(tmp_path):
    (tmp_path / "s.toml").write_bytes(b"\xef\xbb\xbf" + SWEEP.replace("\n", "\r\n").encode())
    assert load_spec(tmp_path / "s.toml").laws == ("linear",)


SLOW = {"records": Record("slow", 1e9, [0.0, 1.0])}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (SLOW, "record 'slow' would take 1e.12 steps.*or cut the record"),
        (SLOW | {"accuracy": 1e-3}, "accuracy 0.001: record 'slow' .*smaller dt"),
    ],
)
def test_too_many_steps_are_refused(change, message):
    with pytest.raises(SweepError, match=message):
        make_plan(build_spec(**{"scene": "mate2015", "records": "el_centro", "laws": ["linear"], **change}))


@pytest.mark.parametrize("name", [LINES, ESCAPE, "caf\udce9", "\u202eevil", "x" * 201, "\x9b", "a\u2028b"])
def test_names_that_are_no_labels_are_refused(name):
    for named in (lambda: Record(name, 0.1, [1.0]), lambda: Building(name, [1.0], [1.0]), lambda: Wall(name)):
        with pytest.raises(
            (RecordError, SceneError), match=r"no line breaks, no control characters|at most 200"
        ) as caught:
            named()
        assert str(caught.value).isprintable()


@pytest.mark.parametrize("name", ["El Centro", "café", "地震", "a\u00a0b", "x" * 200, "नेपाल", "می‌خواهم"])
def test_names_in_any_script_are_labels(name):
    assert Record(name, 0.1, [1.0]).name == Building(name, [1.0], [1.0]).name == name


def test_a_file_whose_name_is_no_text(tmp_path, monkeypatch):
    monkeypatch.setenv("POUNDING_SWEEP_RECORDS", str(tmp_path))
    path = os.fsencode(tmp_path) + b"/caf\xe9.csv"
    with open(path, "wb") as file:
        file.write(b"time (s),acc (g)\n0,0.1\n0.01,0.2\n")
    name = os.fsdecode(path)
    with pytest.raises(RecordError, match=r"has the character \\udce9, .*give it another one: name = ") as caught:
        read_record(name)
    assert str(caught.value).encode()
    record = read_record(name, name="cafe")
    assert record.source.encode() == b"caf\\udce9.csv"
    (fault,) = [said for _, said in list_records() if isinstance(said, str)]
    assert "give it another one" in fault


def test_titles_are_one_line(tmp_path):
    assert "title: 'two\\nlines' has the character \\u000a" in refused(tmp_path, f'title = """{LINES}"""\n{SWEEP}')
    assert load_spec(write(tmp_path, f"title = '{'t' * 1000}'\n{SWEEP}")).title == "t" * 1000


def test_nothing_of_a_file_moves_the_cursor(tmp_path, capsys):
    cube = xr.Dataset(
        {"peak": ("gap", [1.0], {"units": ESCAPE, "long_name": ESCAPE})},
        {"gap": ("gap", [0.1], {"long_name": ESCAPE}), "record": ESCAPE},
        {"title": ESCAPE, "records": json.dumps([{"name": ESCAPE, "pga": 1.0, "source": ESCAPE}]), "a": ESCAPE}
        | {"history": f"{ESCAPE}\n{ESCAPE}", "accuracy_choice": ESCAPE, "x_version": ESCAPE, ESCAPE: 1},
    )
    text = describe(cube)
    assert "\\u001b[2Jcleared" in text
    assert all(line.isprintable() for line in text.split("\n"))
    print_pairs([(ESCAPE, LINES)])
    print_table([ESCAPE], [[LINES]])
    print_json({ESCAPE: "\x9b\u202e"})
    assert all(line.isprintable() for line in capsys.readouterr().out.split("\n"))
    key = write(tmp_path, '"a\\u001b[2J" = 1\n' + SWEEP)
    done = call("plan", key, code=2)
    assert "a\\u001b[2J" in done.stderr
    assert "\x1b" not in done.stderr


def nested(depth):
    value = []
    for _ in range(depth):
        value = [value]
    return value


LONG_VALUES = {
    "deep": lambda: nested(10**5),
    "text": lambda: "x" * 10**6,
    "list": lambda: list(range(10**5)),
    "number": lambda: 16**9000,
    "dict": lambda: {1: nested(2000)},
    "bytes": lambda: b"x" * 999,
}


@pytest.mark.parametrize("kind", LONG_VALUES)
def test_values_are_shown_in_short(kind):
    value = LONG_VALUES[kind]()
    assert len(repr_short(value)) <= errors.MAX_CHARACTERS
    assert len(unknown("thing", value, ["one", "two"])) < 2 * errors.MAX_CHARACTERS


NOBODY = "~nobody-of-this-name/x"


def test_home_folders_that_are_not_known(tmp_path, monkeypatch):
    from pounding_sweep.engine.compile import cache_folder
    from pounding_sweep.run.diagnosis import diagnose

    calls = [
        lambda: read_record(f"{NOBODY}.AT2"),
        lambda: resolve_records(f"{NOBODY}.AT2"),
        lambda: find_record("arleta", NOBODY),
        lambda: list_records(NOBODY),
        lambda: load_spec(NOBODY),
        lambda: load_spec(write(tmp_path, SWEEP.replace('"el_centro"', f'{{ path = "{NOBODY}.AT2" }}'))),
        diagnose,
        cache_folder,
    ]
    monkeypatch.setenv("POUNDING_SWEEP_RECORDS", NOBODY)
    monkeypatch.setenv("POUNDING_SWEEP_CACHE", NOBODY)
    for read in calls:
        with pytest.raises(InputError, match="the home folder that '~' stands for is not known here; write it out"):
            read()
    assert "is not known here" in call("records", code=2).stderr
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("POUNDING_SWEEP_CACHE", "~/kernels")
    assert cache_folder() == tmp_path / "kernels"
    monkeypatch.delenv("POUNDING_SWEEP_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert cache_folder() == tmp_path / ".cache" / "pounding_sweep" / "kernels"


#: Processor time (s) after which reading one small file counts as hanging: thousands of times what it takes.
HANGING = 30.0

NUMBERS = [b"1e999", b"-1e308", b"9" * 400, b"1e-400", b"nan", b"-inf", b"0", b"-0.0", b"1_0", b"0x1f", b"1e", b"--1"]
WORDS = [b"NPTS", b"DT=", b"units", b"[sweep]", b"[[scene.row]]", b"true", b"inf", b"time", b"g", b'"""', b"'''"]
NOT_TEXT = [b"\x00", b"\xff\xfe", b"\xc3\x28", b"\xed\xa0\x80", b"\xef\xbb\xbf", b"\x1a", b"\x7f", b"\x85"]
NOT_TEXT += [b"\xe2\x80\xa8"]
MARKS = list(b"0123456789.+-eEdD,;:= \t\r\n\"'#[]{}()_/\\")
NESTS = (b"[", b"{a=", b"[[", b"a.", b"(")
Fault = Callable[[bytearray, random.Random], None]


def _flip(data: bytearray, rng: random.Random) -> None:
    for _ in range(rng.choice((1, 1, 3, 20))):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def _punctuate(data: bytearray, rng: random.Random) -> None:
    for _ in range(rng.choice((1, 2, 6))):
        data[rng.randrange(len(data))] = rng.choice(MARKS)


def _number(data: bytearray, rng: random.Random) -> None:
    """Put an extreme number in the place of one that is there."""
    if numbers := [match.span() for match in re.finditer(rb"[0-9][0-9.]*", data)]:
        start, end = rng.choice(numbers)
        data[start:end] = rng.choice(NUMBERS)


def _replace(lost: tuple[int, ...], put: Callable[[random.Random], bytes] = lambda _: b"") -> Fault:
    """Make the fault that something stands in the place of so many bytes."""

    def replace(data: bytearray, rng: random.Random) -> None:
        at = rng.randrange(len(data))
        data[at : at + rng.choice(lost)] = put(rng)

    return replace


def _lines(change: Callable[[list[bytes], int, random.Random], None]) -> Fault:
    """Make a fault of one of the lines."""

    def changed(data: bytearray, rng: random.Random) -> None:
        lines = bytes(data).split(b"\n")
        change(lines, rng.randrange(len(lines)), rng)
        data[:] = b"\n".join(lines)

    return changed


def _swap(lines: list[bytes], at: int, rng: random.Random) -> None:
    other = rng.randrange(len(lines))
    lines[at], lines[other] = lines[other], lines[at]


def _lengthen(lines: list[bytes], at: int, rng: random.Random) -> None:
    lines[at] += rng.choice((b"1 ", b"-", b"(", b"x", b"9")) * rng.choice((5_000, 100_000))


#: Kinds of damage to text files.
TEXT_FAULTS: dict[str, Fault] = {
    "bits flipped": _flip,
    "cut": _replace((2**40,)),
    "bytes lost": _replace((1, 8, 100)),
    "line lost": _lines(lambda lines, at, _: lines.pop(at) and None),
    "line repeated": _lines(lambda lines, at, rng: lines.extend([lines[at]] * rng.choice((1, 2, 500)))),
    "lines swapped": _lines(_swap),
    "line very long": _lines(_lengthen),
    "number extreme": _number,
    "word misplaced": _replace((0, 0, 1, 4), lambda rng: rng.choice(WORDS)),
    "not text": _replace((0, 0, 1, 4), lambda rng: rng.choice(NOT_TEXT)),
    "punctuation": _punctuate,
    "nested deeply": _replace((0,), lambda rng: rng.choice(NESTS) * rng.choice((3, 200, 20_000))),
}


def damaged(raw: bytes, faults: dict[str, Fault], count: int, seed: int) -> Iterator[tuple[str, bytes]]:
    """Give `count` damaged copies of `raw`, each with the kind of its first fault; every fourth has several."""
    rng = random.Random(seed)
    kinds = list(faults)
    for index in range(count):
        data = bytearray(raw)
        first = kinds[index % len(kinds)]
        faults[first](data, rng)
        if index % 4 == 3:
            for _ in range(rng.randrange(1, 4)):
                if data:
                    faults[rng.choice(kinds)](data, rng)
        yield first, bytes(data)


@contextmanager
def not_hanging(what: str, seconds: float = HANGING) -> Iterator[None]:
    """Raise TimeoutError after so much processor time of this process (not of the clock: other work does not count)."""

    def stop(*_: object) -> None:
        raise TimeoutError(f"{what} took more than {seconds:g} s of processor time")

    before = signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)
