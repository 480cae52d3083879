"""Damaged and hostile cubes given to `merge` and `run --extend`: refused in one message, or taken as they were made."""

from __future__ import annotations

import collections
import gzip
import hashlib
import itertools
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import h5py
import netCDF4
import numpy as np
import pytest
import taking
from fuzz import BINARY_FAULTS, damaged, not_hanging
from scenes import motions
from taking import COMMANDS, OUT, content, take
from test_extend import SWEEP
from typer.testing import CliRunner

from pounding_sweep.cli.app import app
from pounding_sweep.output.netcdf import _beside, open_cube, write_cube

pytestmark = pytest.mark.usefixtures("stub_module")

ANSWERS = {
    "same": "taken with the same results",
    "2": "refused",
    "1": "failed",
    "changed": "changed unnoticed",
    "died": "crash or hang",
}


#: What is swept in the first cube, in the second, and in both together.
OVER_GAPS = {"a": "[0.002, 0.01]", "b": "[0.0005]", "all": "[0.002, 0.01, 0.0005]"}
CASES = [
    '{ law = "kelvin_voigt", gap = 0.002, restitution = 0.7, building.a.period_factor = 1.1 }',
    '{ law = "kelvin_voigt", gap = [0.01, 0.002], building.b.mass_factor = 2.0, damping_ratio = 0.02 }',
    '{ law = "none" }',
    '{ law = "kelvin_voigt", gap = 0.0005, building.c.period_factor = 0.9 }',
]


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    """Return a folder with two cubes of one study, `a.nc` and `b.nc`, and a sweep over both, `all.toml`."""
    plain = SWEEP.replace("dt = 0.005", "dt = 0.005\naudit = 0.0")  # the listed ones have an audit
    texts = {name: plain.replace("GAPS", gaps) for name, gaps in OVER_GAPS.items()}
    return made(tmp_path_factory.mktemp("parts"), texts)


@pytest.fixture(scope="module")
def listed_parts(tmp_path_factory):
    """Return the same for listed cases."""
    axes = 'laws = ["kelvin_voigt", "none"]\ngaps = GAPS\n'
    assert axes in SWEEP
    texts = {
        name: SWEEP.replace(axes, f"cases = [{', '.join(cases)}]\n")
        for name, cases in (("a", CASES[:3]), ("b", CASES[2:]), ("all", CASES))
    }
    return made(tmp_path_factory.mktemp("listed"), texts)


def made(folder, texts):
    """Write sweep files, and run the first two; return the folder."""
    one = motions()[0]
    lines = [f"{i * one.dt:.2f},{a!r}" for i, a in enumerate(one.acceleration.tolist())]
    (folder / "one.csv").write_text("time (s),acceleration (m/s2)\n" + "\n".join(lines) + "\n")
    for name, text in texts.items():
        (folder / f"{name}.toml").write_text(text)
    for name in "ab":
        run = ["run", str(folder / f"{name}.toml"), "-o", str(folder / f"{name}.nc"), "--quiet"]
        ran = CliRunner().invoke(app, run)
        assert ran.exit_code == 0, ran.output
    return folder


def take_all(folder, takes, alone=True):
    """Take cubes into others, each by a command; return what came of each, and the last words on it."""
    if not alone:
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(folder)
            expected = taking.of_whole("a.nc")
            return [(ANSWERS[code], words) for code, words in (taking.answer(*each, expected) for each in takes)]
    found, todo = [], list(takes)
    while todo:
        done = subprocess.run(
            [sys.executable, Path(__file__).with_name("taking.py"), "a.nc"], cwd=folder,
            input="\n".join(f"{command} {path}" for command, path in todo),
            capture_output=True, text=True, check=False, timeout=1200,
        )  # fmt: skip
        lines = done.stdout.splitlines()
        answers = [line.partition(" ") for line in lines if line != "?"]
        found += [(ANSWERS[code], words) for code, _, words in answers]
        if done.returncode:
            assert lines[-1:] == ["?"], done.stderr
            found.append((ANSWERS["died"], f"signal {-done.returncode}: {done.stderr[-300:]}"))
        todo = takes[len(found) :]
    return found


def damage(counts, folder, tmp_path, count, seed):
    """Damage a cube; every copy is refused, naming a cube, or described and taken with the values that were written."""
    paths = []
    for index, (_, data) in enumerate(damaged((folder / "a.nc").read_bytes(), BINARY_FAULTS, count, seed)):
        paths.append(tmp_path / f"{index}.nc")
        paths[-1].write_bytes(data)
    takes = list(itertools.product(COMMANDS, paths))
    answers = list(zip(takes, take_all(folder, takes, alone=count > MANY[0]), strict=True))
    for command in COMMANDS:
        here = collections.Counter(answer for (by, _), (answer, _) in answers if by == command)
        kind = f"cubes to {command}"
        counts.update({(kind, "damaged"): count, **{(kind, name): here[name] for name in ANSWERS.values()}})
        assert here[ANSWERS["2"]] > count / 4
        assert here[ANSWERS["died"]] <= max(count > MANY[0], count // 100)  # HDF5 goes for ever round a heap of zeros
    wrong = [
        (command, path.name, *answer)
        for (command, path), answer in answers
        if answer != (ANSWERS["same"], "")
        and answer[0] != ANSWERS["died"]
        and not (answer[0] == ANSWERS["2"] and _one_message(answer[1], path))
    ]
    assert wrong == []
    assert (ANSWERS["same"], "") in dict(answers).values()


def _one_message(words, path):
    """Whether a command said what is wrong, once, and of which file."""
    return words.count("pounding-sweep: ") == 1 and "Traceback" not in words and str(path) in words


#: Bytes in a tree of blocks: size of a block, its place, its address, and the place of the next.
IN_A_TREE = [24, 40, 41, 48, 56, 64]


@pytest.mark.parametrize("each", [pytest.param(4, marks=pytest.mark.slow), pytest.param(1, marks=pytest.mark.release)])
def test_a_damaged_tree_of_blocks(parts, tmp_path, each):
    """Which tells where values stand, and has no checksum: each byte counts, or changes nothing that is read."""
    data, takes = (parts / "a.nc").read_bytes(), []
    trees = [tree.start() for tree in re.finditer(rb"TREE\x01", data)]
    assert len(trees) > 10
    for place in [tree + at for at in IN_A_TREE for tree in trees][::each]:
        path = tmp_path / f"{place}.nc"
        path.write_bytes(data[:place] + b"\x03" + data[place + 1 :])
        takes.append(("merge", path))
    answers = [answer for answer, _ in take_all(parts, takes)]
    assert set(answers) <= {ANSWERS["2"], ANSWERS["same"]}
    assert ANSWERS["2"] in answers


#: How many cubes are damaged; those few by this process, which they neither crash nor hang.
MANY = [3, pytest.param(40, marks=pytest.mark.slow), pytest.param(1000, marks=pytest.mark.release)]


@pytest.mark.parametrize("count", MANY)
def test_damaged_cubes(counts, parts, tmp_path, count):
    damage(counts, parts, tmp_path, count, seed=8)


@pytest.mark.parametrize("count", MANY[1:])
def test_damaged_cubes_of_cases(counts, listed_parts, tmp_path, count):
    damage(counts, listed_parts, tmp_path, count, seed=9)


TAKING = ("merge", "extend")

# --- changed by hand, every checksum right --------------------------------------------------------------------------


def attributes(**changes):
    """Return what gives a cube other global attributes."""
    return lambda cube: cube.assign_attrs(changes)


def sweeps(**changes):
    """Return what makes a cube say that another sweep made it, with the digest that fits."""

    def change(cube):
        text = json.dumps(json.loads(cube.attrs["sweep"]) | changes)
        return cube.assign_attrs(sweep=text, sweep_sha256=hashlib.sha256(text.encode()).hexdigest())

    return change


def statuses(code):
    """Return what gives one scenario another status."""

    def change(cube):
        cube["status"].values.flat[1] = code
        return cube

    return change


def texts(name, old, new):
    """Return what changes a text in a coordinate, as damage to it may: texts carry no checksum."""
    return lambda cube: cube.assign_coords({name: cube[name].copy(data=np.char.replace(cube[name].values, old, new))})


def numbers(name, values):
    """Return what gives a coordinate other numbers."""
    return lambda cube: cube.assign_coords({name: cube[name].copy(data=np.asarray(values, cube[name].dtype))})


OTHER = "has other values of {} than its sweep; give the cube as it was made, not a part of it"
CHANGED = "is damaged, or was changed after it was made: {}"
NO_SWEEP = "its attribute 'sweep' is damaged; make the cube again"
#: What is done to a cube -> what merging and extending say of it; "" where they take it as it was.
CHANGES = {
    "status of no meaning": (statuses(77), *[CHANGED.format("status 77 has no meaning; valid: 0 ok, 1 diverged")] * 2),
    "no status": (lambda c: c.drop_vars("status"), "no cube of a sweep", "does not say what it needs to be extended"),
    "no storeys": (
        lambda c: c.assign(impact_count=c.impact_count.isel(storey=0)),
        *[r"variable 'impact_count' has dimensions ('law', 'gap', 'stiffness_factor', 'restitution', 'record'"] * 2,
    ),
    "a pair less": (lambda c: c.isel(pair=[0]), "the list of pairs is ['a-b'] in the first", OTHER.format("pair")),
    "buildings turned": (lambda c: c.isel(building=[2, 1, 0]), "the list of buildings is", OTHER.format("building")),
    "gap twice, and so the sweep": (
        lambda c: sweeps(gaps=[0.01, 0.01])(numbers("gap", [0.01, 0.01])(c)),
        *[CHANGED.format("axis 'gap' has a value twice")] * 2,
    ),
    "gaps unknown": (lambda c: c.drop_vars("gap"), *["axis 'gap' has no values"] * 2),
    "another law": (texts("law", "none", "nine"), *[OTHER.format("law")] * 2),
    "another building": (texts("building", "b", "c"), "the list of buildings is", OTHER.format("building")),
    "other gaps of pairs": (lambda c: c.drop_vars("pair_gap"), "coordinate 'pair_gap' is missing in", ""),
    "a coordinate elsewhere": (
        lambda c: c.assign_coords(more=("elsewhere", [1.0])), *["'more' has dimensions ('elsewhere',)"] * 2,
    ),
    "number as sweep": (attributes(sweep=3.0), *[NO_SWEEP] * 2),
    "nested sweep": (attributes(sweep="[" * 100_000), *[NO_SWEEP] * 2),
    "sweep of another digest": (
        lambda c: c.assign_attrs(sweep=c.attrs["sweep"].replace("0.002", "0.003")), *[NO_SWEEP] * 2,
    ),
    "no digest": (lambda c: c.attrs.pop("sweep_sha256") and c, *[NO_SWEEP] * 2),
    "gaps that are no list": (sweeps(gaps={"a": 1}), *[NO_SWEEP] * 2),
    "records without names": (sweeps(records=[{}]), *[NO_SWEEP] * 2),
    "factors of a building": (sweeps(period_factors=[["a", [1.0]]]), *["its sweep had law, gap, stiffness_factor"] * 2),
    "cases": (
        sweeps(cases=[{"law": "none", "record": "one"}]),
        "its sweep had case", "its sweep lists no valid cases",
    ),
    "text as a count": (attributes(scenarios_run="many"), "attribute 'scenarios_run' is 'many', no number", ""),
    "numbers as records": (attributes(records=np.arange(2)), "attribute 'records' is not what a sweep writes", ""),
    "text as a step": (attributes(time_step="x"), "attribute 'time_step' is not one step for each record", ""),
    "merged from parts of nothing": (
        attributes(merged_from='[{"file": "x", "merged_from": 3}]'),
        *["attribute 'merged_from' is not what a sweep"] * 2,
    ),
    "merged from a run of no number": (
        attributes(merged_from='[{"file": "x", "scenarios_run": "3"}]'),
        *["attribute 'merged_from' is not what a sweep"] * 2,
    ),
    "merged from an audit of nothing": (
        attributes(merged_from='[{"file": "x", "audit_touching": 0, "audit_share": 0.1}]'),
        *["attribute 'merged_from' is not what a sweep"] * 2,
    ),
    "merged from half an audit": (
        attributes(merged_from='[{"file": "x", "audit_touching": 3}]'),
        *["attribute 'merged_from' is not what a sweep"] * 2,
    ),
    "merged from too much": (
        attributes(merged_from='[{"file": "x", "merged_from": ' * 10_000 + "[]" + "}]" * 10_000),
        *["attribute 'merged_from' is not what a sweep"] * 2,
    ),
    "extended from no file": (
        attributes(extended_from='{"file": 3}'), *["attribute 'extended_from' is not what a sweep writes"] * 2,
    ),
    "no choice for an accuracy": (
        sweeps(accuracy=0.01), "attribute 'accuracy_choice' is no text", "accuracy is 0.01 there and None here",
    ),
    "storeys before buildings": (
        lambda c: c.assign(displacement_max=c.displacement_max.transpose(..., "storey", "building")), "", "",
    ),
    "number as source": (
        attributes(package_sha256=3.0), "(source 3.0), 'b.nc' by version", "as SHA-256, is 3.0 there",
    ),
    "number as version": (
        attributes(pounding_sweep_version=3.0), "was made by version 3.0", "version is 3.0 there",
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def undamaged(parts):
    """The cube that is changed, in memory."""
    with open_cube(parts / "a.nc") as cube:
        return cube.load()


@pytest.fixture(scope="module")
def expected(parts):
    """What comes of the undamaged cube, by command."""
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(parts)
        for command in TAKING:
            assert take(command, "a.nc") == (0, "")
            found[command] = content(OUT)
    return found


def check(command, path, says, expected):
    """Take a cube into another: a refusal says what is expected, and what is taken is as it was."""
    Path(OUT).unlink(missing_ok=True)
    with not_hanging(f"{command} {path}"):
        code, words = take(command, path)
    if says:
        assert says in words
        assert code == 2
        assert words.count("pounding-sweep: ") == 1
        assert "Traceback" not in words
        assert not Path(OUT).exists()
    else:
        assert (code, words) == (0, "")
        assert content(OUT) == expected[command]
    assert not [name for name in os.listdir() if name.endswith(".part")]


#: Refused by the same line as another of them.
ALIKE = (
    "no digest",
    "a pair less",
    "factors of a building",
    "merged from parts of nothing",
    "number as version",
    "number as sweep",
    "records without names",
    "merged from a run of no number",
    "merged from half an audit",
    "another building",
    "buildings turned",
)


def by_command():
    """Changes and who is given them: by day, what both refuse by the same check is given to one."""
    for change, (_, *told) in CHANGES.items():
        if change in ALIKE:
            yield pytest.param(change, TAKING, marks=pytest.mark.slow)
        elif told[0] and told[0] == told[1]:
            yield pytest.param(change, TAKING[:1], marks=pytest.mark.slow)
            yield change, TAKING[1:]
        else:
            yield change, TAKING


@pytest.mark.parametrize(("change", "commands"), list(by_command()))
def test_a_cube_that_was_changed(counts, parts, undamaged, expected, tmp_path, monkeypatch, change, commands):
    monkeypatch.chdir(parts)
    how, *told = CHANGES[change]
    path = write_cube(how(undamaged.copy(deep=True)), tmp_path / "changed.nc")
    for command, says in zip(TAKING, told, strict=True):
        if command in commands:
            check(command, path, says, expected)
            counts.update({("cubes changed by hand", "taken" if not says else "refused"): 1})


@pytest.mark.parametrize(
    ("name", "stored", "says"),
    [
        (
            "impact_force_max",
            {"dtype": "f4"},
            "'impact_force_max' is stored as float32, missing as nan, not as float64",
        ),
        pytest.param(
            *("impact_force_max", {"_FillValue": 7.0}),
            "'impact_force_max' is stored as float64, missing as 7.0, not as",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            *("impact_count", {"dtype": "f8", "_FillValue": -1.0}),
            "'impact_count' is stored as float64, missing as -1.0",
            marks=pytest.mark.slow,
        ),
        (
            "impact_count",
            {"_FillValue": 2},
            "'impact_count' is stored as int32, missing as 2, not as int32, missing as -1",
        ),
        pytest.param(
            *("status", {"dtype": "i4"}),
            "'status' is stored as int32, missing as None, not as int8, missing as None",
            marks=pytest.mark.slow,
        ),
        ("impact_force_max", {"fletcher32": False}, "'impact_force_max' has no checksums, which sweeps write"),
    ],
)
def test_values_stored_otherwise(parts, expected, tmp_path, monkeypatch, name, stored, says):
    """Numbers of another type, or with another value for missing ones, would not be what they were."""
    monkeypatch.chdir(parts)
    usual = {"fletcher32": True}
    with open_cube("a.nc") as cube:
        fill = {key: array.encoding.get("_FillValue") for key, array in cube.data_vars.items()}
        kinds = {key: array.encoding["dtype"] for key, array in cube.data_vars.items()}
        cube.load()
        for variable in cube.variables.values():
            variable.encoding = dict(variable.encoding) if variable.dtype.kind == "U" else {}
        encoding = {key: {"dtype": kinds[key], "_FillValue": fill[key], **usual} for key in fill}
        encoding[name] |= stored
        cube.assign(_beside(cube)).to_netcdf(tmp_path / "odd.nc", engine="netcdf4", encoding=encoding)
    for command in TAKING:
        check(command, tmp_path / "odd.nc", says, expected)


def _text(path, whole):
    path.write_text("law,gap\n")


def _empty(path, whole):
    path.touch()


def _folder(path, whole):
    path.mkdir()


def _packed(path, whole):
    path.write_bytes(gzip.compress(whole))


def _half(path, whole):
    path.write_bytes(whole[: len(whole) // 2])


def _other(path, whole):
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("x", 1)


def _linked(path, whole):
    path.write_bytes(whole)
    with h5py.File(path, "a") as file:
        del file["impact_force_max"]
        file["impact_force_max"] = h5py.ExternalLink("b.nc", "/impact_force_max")


def _nothing(path, whole):
    """Leave out the file."""


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (_text, "can't be read as netCDF"),
        (_empty, "can't be read as netCDF"),
        (_folder, "is not a file"),
        (_packed, "can't be read as netCDF"),
        (_half, "can't be read as netCDF"),
        (_other, "is a netCDF file, but not one of this package"),
        (_linked, "is damaged, or not made by this package ('impact_force_max' is a link to something else)"),
        (_nothing, "does not exist"),
    ],
)
def test_files_that_are_no_cubes(parts, expected, tmp_path, monkeypatch, make, says):
    monkeypatch.chdir(parts)
    path = tmp_path / "odd.nc"
    make(path, Path("a.nc").read_bytes())
    for command in TAKING:
        check(command, path, f"{str(path)!r} {says}", expected)
