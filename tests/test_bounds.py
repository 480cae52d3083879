"""What is too large, too deep or not printable is refused or cut, in a message that a terminal can bear."""

from __future__ import annotations

import json
import os

import pytest
import xarray as xr
from scenes import call

from pounding_sweep.base import errors
from pounding_sweep.base.errors import InputError, RecordError, SceneError, SweepError, repr_short, unknown
from pounding_sweep.base.text import print_json, print_pairs, print_table
from pounding_sweep.model.building import Building
from pounding_sweep.model.scene import Wall
from pounding_sweep.output.describe import describe
from pounding_sweep.plan.plan import make_plan
from pounding_sweep.records import Record, find_record, list_records, read_record, resolve_records
from pounding_sweep.request.build import build_spec
from pounding_sweep.request.toml import load_spec

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
    for make in (lambda: Record(name, 0.1, [1.0]), lambda: Building(name, [1.0], [1.0]), lambda: Wall(name)):
        with pytest.raises(
            (RecordError, SceneError), match=r"no line breaks, no control characters|at most 200"
        ) as caught:
            make()
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


VALUES = {
    "deep": lambda: nested(10**5),
    "text": lambda: "x" * 10**6,
    "list": lambda: list(range(10**5)),
    "number": lambda: 16**9000,
    "dict": lambda: {1: nested(2000)},
    "bytes": lambda: b"x" * 999,
}


@pytest.mark.parametrize("kind", VALUES)
def test_values_are_shown_in_short(kind):
    value = VALUES[kind]()
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
