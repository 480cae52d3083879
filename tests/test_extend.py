"""Sweeps with more values or more cases: only what is new runs, and the cube is that of the whole, to the last bit."""

from __future__ import annotations

import json
import re
import shutil
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import OUTPUTS, call, motions, row
from test_limits import At, stop

from pounding_sweep import Sweep
from pounding_sweep.base.errors import InputError, WriteError
from pounding_sweep.output.describe import describe
from pounding_sweep.output.merge import merge_cubes
from pounding_sweep.output.netcdf import open_cube, write_cube
from pounding_sweep.plan import plan as planning
from pounding_sweep.records import Record
from pounding_sweep.resume import MANIFEST
from pounding_sweep.run import audit as auditing
from pounding_sweep.run import execute
from pounding_sweep.run.reuse import EarlierCube
from pounding_sweep.variables.registry import Status

pytestmark = pytest.mark.usefixtures("stub_module")

WHOLE = {
    "laws": ["linear", "none", "kelvin_voigt"],
    "gaps": [0.0005, 0.5, 0.002, 0.01, 0.02],
    "stiffness_factors": [1.0, 0.5],
    "restitutions": [0.3, 0.7],
    "scales": [1.0, 1.5],
    "records": motions(),
}
LESS = {
    "laws": ["kelvin_voigt", "none"],
    "gaps": [0.01, 0.002, 0.5],
    "stiffness_factors": [0.5],
    "restitutions": [0.7],
    "scales": [1.5],
    "records": motions()[1:],
}
#: No axis of the smaller sweep has fewer values than it takes for a run without pounding to be worth it.
SETTINGS = {"method": "rk4", "dt": 0.005, "outputs": OUTPUTS, "audit": 0.2}


def sweep(scene=None, **changes):
    return Sweep(scene or row(), **{**SETTINGS, **WHOLE, **changes})


@pytest.fixture(scope="module")
def whole():
    job = sweep()
    cube = job.run(workers=1)
    cube.attrs["unique_run"] = job.last_outcome.run
    return cube


@contextmanager
def listed_runs():
    """List the scenarios that workers really run, by (law, record, scale, stiffness, restitution, gaps)."""
    found, audits = [], []
    real, real_audit = execute.Dispatcher.run, auditing.audit

    def audit(*arguments):
        audits.append(True)
        result = real_audit(*arguments)
        audits.clear()
        return result

    def run(self, chunks, job):
        def told(chunk):
            mine = job(chunk)
            if "closing_max" not in mine.outputs and not audits:
                t, law, record = mine.table, mine.kernel.law.key, mine.record.name
                rows = zip(t.scale, t.stiffness, t.restitution, map(tuple, t.gaps), strict=True)
                found.extend((law, record, *row) for row in rows)
            return mine

        return real(self, chunks, told)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(execute.Dispatcher, "run", run)
        patch.setattr(auditing, "audit", audit)
        yield found


@pytest.fixture
def ran():
    with listed_runs() as found:
        yield found


def same(found, expected):
    """Compare every value and label, the audit's too, bit for bit."""
    assert set(found.variables) == set(expected.variables)
    for name in expected.variables:
        a, b = found[name], expected[name]
        assert a.dims == b.dims, name
        assert a.dtype.kind == b.dtype.kind, name
        np.testing.assert_array_equal(a.values, b.values, err_msg=name)
        np.testing.assert_equal(a.attrs, b.attrs, err_msg=name)
    assert found.attrs["sweep"] == expected.attrs["sweep"]
    assert found.attrs["sweep_sha256"] == expected.attrs["sweep_sha256"]


@pytest.mark.parametrize("axis", [*(pytest.param(axis, marks=pytest.mark.slow) for axis in WHOLE), "all"])
def test_what_is_new_on_an_axis_is_run(whole, ran, tmp_path, monkeypatch, axis):
    monkeypatch.setattr(planning, "CHUNK_SECONDS", 1e-5)
    monkeypatch.setattr("pounding_sweep.run.reuse.SLAB_BYTES", 2000)  # read in several parts
    less = LESS if axis == "all" else {axis: LESS[axis]}
    with sweep(**less).run(tmp_path / "old.nc", workers=1):
        before = set(ran)
    ran.clear()
    job = sweep()
    found = job.run(extend=tmp_path / "old.nc", workers=1)
    same(found, whole)
    taken = json.loads(found.attrs["extended_from"])
    assert taken["scenarios_taken"] > 0
    assert taken["file"] == str(tmp_path / "old.nc")
    assert job.last_outcome.run + taken["scenarios_taken"] == whole.attrs["unique_run"]
    assert before.isdisjoint(ran)
    assert len(ran) == len(set(ran))


def test_a_sweep_too_small_for_runs_without_pounding(tmp_path):
    """Scenarios that never touch may come from another kernel: those are run again rather than taken."""
    few = {
        "laws": "kelvin_voigt",
        "scales": 1.0,
        "records": motions()[:1],
        "restitutions": 0.7,
        "stiffness_factors": 1.0,
    }
    sweep(**few, gaps=[0.0005, 0.01, 0.4, 0.5]).run(tmp_path / "old.nc", workers=1).close()
    same(
        sweep(**few, gaps=[0.01, 0.5]).run(extend=tmp_path / "old.nc", workers=1),
        sweep(**few, gaps=[0.01, 0.5]).run(workers=1),
    )


def test_building_properties(tmp_path):
    axes = {"laws": "kelvin_voigt", "stiffness_factors": 1.0, "restitutions": 0.5, "scales": 1.0}
    less = sweep(**axes, period_factors={"a": [0.9, 1.1]}, damping_ratios=[0.02])
    more = sweep(**axes, period_factors={"a": [1.1, 1.3, 0.9]}, damping_ratios=[0.05, 0.02])
    less.run(tmp_path / "old.nc", workers=1).close()
    found = more.run(extend=tmp_path / "old.nc", workers=1)
    same(found, more.run(workers=1))
    assert json.loads(found.attrs["extended_from"])["scenarios_taken"] > 0
    case = {"law": "kelvin_voigt", "record": "one", "damping_ratio": 0.02, "gap": 0.002}
    job = listed([{**case, "period_factors": {"a": 1.1}}, {**case, "period_factors": {"a": 1.2}}])
    found = job.run(extend=tmp_path / "old.nc", workers=1)
    same(found, job.run(workers=1))
    assert found_taken(found) == 1
    with pytest.raises(InputError, match="only one of the two sweeps varies building properties"):
        sweep(**axes).run(extend=tmp_path / "old.nc")


def test_a_record_of_the_same_name_is_another_if_its_motion_is(ran, tmp_path):
    few = {"laws": "kelvin_voigt", "scales": 1.0, "stiffness_factors": 1.0}
    sweep(**few).run(tmp_path / "old.nc", workers=1).close()
    ran.clear()
    one, two = motions()
    job = sweep(**few, records=[Record("one", one.dt, one.acceleration * 1.01), two])
    found = job.run(extend=tmp_path / "old.nc", workers=1)
    assert {record for _, record, *_ in ran} == {"one"}
    same(found, job.run(workers=1))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"dt": 0.0025}, r"'.*old\.nc' and this sweep .* study: dt is 0\.005 in the first and 0\.0025 in the second"),
        ({"outputs": OUTPUTS[:2]}, r"outputs is \['displacement_max'.* in the first"),
        ({"locate": False}, "locate is True in the first and False in the second"),
        ({"method": "newmark"}, "method is 'rk4' in the first and 'newmark'"),
        ({"scene": row(gaps=(0.01, 0.03))}, "scene is "),
    ],
)
def test_another_study_is_refused(whole_file, changes, says):
    with pytest.raises(InputError, match=says):
        EarlierCube(whole_file, sweep(**changes).plan())


@pytest.fixture(scope="module")
def whole_file(whole, tmp_path_factory):
    """The whole in a file."""
    return write_cube(whole, tmp_path_factory.mktemp("whole") / "old.nc")


@pytest.mark.parametrize(
    ("told", "says"),
    [
        pytest.param({"pounding_sweep_version": "0.0"}, r"_version is '0\.0' in the first", marks=pytest.mark.slow),
        ({"package_sha256": None}, "does not say what it needs to be extended"),
        ({"package_sha256": "new"}, r"package_sha256 is 'new' in the first and '[0-9a-f]{64}' in the second\. The"),
        (
            {"llvmlite_version": "0.44.0", "numpy_version": None},
            r"llvmlite_version is '0\.44\.0' in the first and '\S+' in the second; numpy_version is 'None' in the "
            r"first and '\S+' in the second\. The same scenario may have another result with each: run one again",
        ),
    ],
)
def test_another_maker_is_refused(tmp_path, whole, told, says):
    """Kernels compiled by others may differ in the last bits: what differs is named, with both versions."""
    old = whole.copy()
    old.attrs = {key: value for key, value in {**whole.attrs, **told}.items() if value is not None}
    with pytest.raises(InputError, match=says):
        sweep().run(tmp_path / "new.nc", extend=write_cube(old, tmp_path / "old.nc"))
    assert [path.name for path in tmp_path.iterdir()] == ["old.nc"]


def test_where_results_are_from(tmp_path, monkeypatch):
    """Extended twice, then from a merged cube: each cube on the way is named, with what it said of itself."""
    monkeypatch.chdir(tmp_path)
    few, gaps = {"laws": ["linear", "none"], "scales": 1.0, "stiffness_factors": 1.0, "audit": 0.0}, WHOLE["gaps"]
    sweep(**few, gaps=gaps[:1]).run("a.nc", workers=1).close()
    sweep(**few, gaps=gaps[:2]).run("b.nc", extend="a.nc", workers=1).close()
    sweep(**few, gaps=gaps[2:3]).run("c.nc", workers=1).close()
    merge_cubes(["b.nc", "c.nc"], "bc.nc")
    sweep(**few, gaps=gaps[:4]).run("d.nc", extend="bc.nc", workers=1).close()
    attributes = {}
    for path in tmp_path.glob("*.nc"):
        with open_cube(path) as cube:
            attributes[path.name] = cube.attrs
    with open_cube("d.nc") as cube:
        described = describe(cube)

    keys = ("history", "sweep_sha256", "scenarios_asked", "scenarios_run", "package_sha256")
    keys += tuple(f"{name}_version" for name in ("pounding_sweep", "numba", "llvmlite", "numpy", "xarray"))
    whole = json.loads(attributes["d.nc"]["extended_from"])
    (a,), (b, c) = ([json.loads(attributes["b.nc"]["extended_from"])], json.loads(attributes["bc.nc"]["merged_from"]))
    for told, file in ((whole, "bc.nc"), (b, "b.nc"), (a, "a.nc"), (c, "c.nc")):
        assert told["file"] == file
        assert {key: told.get(key) for key in keys} == {key: attributes[file].get(key) for key in keys}
    assert [told.get("made_from") for told in (whole, b, c)] == [["b.nc", "c.nc"], ["a.nc"], None]
    assert whole["scenarios_taken"] > a["scenarios_taken"] > 0
    extended = r"\S+Z extended from another cube by pounding_sweep \S+ \(see extended_from\)"
    assert [bool(re.fullmatch(extended, attributes[f"{name}.nc"]["history"])) for name in "abcd"] == [0, 1, 0, 1]
    lines = described.split("Made from\n")[1].split("\n\n")[0].splitlines()
    (line,), told = lines, attributes["bc.nc"]
    assert re.match(rf"  extended from +bc.nc +{re.escape(told['history'])} ", line)
    assert f"scenarios_taken {whole['scenarios_taken']}" in described
    assert "made_from b.nc, c.nc" in line
    assert f"package_sha256 {told['package_sha256'][:12]}, " in line
    assert f"numba_version {told['numba_version']}" in line
    assert "extended_from" not in described.split("Attributes\n")[1]


def listed(cases, **changes):
    return Sweep(row(), **{**SETTINGS, "records": motions(), "cases": cases, **changes})


#: Scenarios that touch or do not, each in two spellings of the same.
POOL = [
    ({"law": law, "record": record, "scale": scale, **one}, {"law": law, "record": record, "scale": scale, **two})
    for law, record, scale, one, two in [
        ("kelvin_voigt", "one", 1.0, {}, {"gap": [0.01, 0.02], "restitution": 0.5}),
        ("kelvin_voigt", "one", 1.5, {"gap": 0.002}, {"gap": [0.002, 0.002], "stiffness": 2e5}),
        ("kelvin_voigt", "two", 1.0, {"gap": 0.0005, "restitution": 0.3}, {"gap": 0.0005, "restitution": 0.3}),
        ("kelvin_voigt", "two", 1.0, {"gap": 0.0005, "restitution": 0.7}, {"gap": 0.0005, "restitution": 0.7}),
        ("kelvin_voigt", "one", 1.0, {"gap": 0.5}, {"gap": [0.5, 0.5]}),
        ("kelvin_voigt", "two", 2.0, {"gap": [0.5, 0.4]}, {"gap": [0.5, 0.4]}),
        ("kelvin_voigt", "two", 1.5, {"stiffness_factor": 0.5}, {"stiffness": 1e5}),
        ("linear", "two", 1.0, {"restitution": 0.3}, {"restitution": 0.9}),
        ("linear", "one", 1.0, {"gap": 0.002}, {"gap": 0.002, "restitution": 0.2}),
        ("linear", "one", 1.0, {"gap": 0.3}, {"gap": 0.3}),
        ("linear", "one", 1.0, {"gap": 0.4}, {"gap": 0.4}),
        ("none", "one", 1.0, {}, {"gap": 0.3}),
        ("none", "two", 2.0, {"gap": 0.1}, {}),
    ]
]
#: Lists of some of them in any order and spelling.
LISTS = st.lists(
    st.tuples(st.integers(0, len(POOL) - 1), st.booleans()), min_size=1, unique_by=lambda choice: choice[0]
).map(lambda chosen: [POOL[i][spelling] for i, spelling in chosen])


@settings(max_examples=settings().max_examples // 5)
@given(LISTS, LISTS, st.sampled_from([1e-5, 0.25]))
def test_listed_cases(tmp_path_factory, old, new, chunk_seconds):
    folder = tmp_path_factory.mktemp("cases")
    with pytest.MonkeyPatch.context() as patch, listed_runs() as ran:
        patch.setattr(planning, "CHUNK_SECONDS", chunk_seconds)
        listed(old).run(folder / "old.nc", workers=1).close()
        before = set(ran)
        ran.clear()
        job = listed(new)
        whole = job.run(workers=1)
        wanted, n = set(ran), job.last_outcome.run
        ran.clear()
        found = job.run(extend=folder / "old.nc", workers=1)
    same(found, whole)
    assert set(ran) >= wanted - before  # what never touches may run again
    assert job.last_outcome.run + found_taken(found) == n


def found_taken(cube):
    """Return how many scenarios a cube took from the one it extends."""
    return json.loads(cube.attrs["extended_from"])["scenarios_taken"]


@pytest.fixture(scope="module")
def few():
    """Cube of some listed cases."""
    return listed([one for one, _ in POOL[:4]]).run(workers=1)


def test_cases_under_labels(few, ran, tmp_path):
    """They don't belong to the scenario."""
    old = write_cube(few.assign_coords(case=["w", "x", "y", "z"]), tmp_path / "old.nc")
    cases = [case for case, _ in POOL[:4]]
    found = listed(cases[::-1]).run(extend=old, workers=1)
    assert ran == []
    assert found_taken(found) == 4
    assert found.case.values.tolist() == [1, 2, 3, 4]
    np.testing.assert_array_equal(found.impact_force_max, few.impact_force_max[::-1])
    some = [i for i, case in enumerate(cases) if case["record"] == "two"]
    found = listed([cases[i] for i in some], records=motions()[1:]).run(extend=old, workers=1)  # the other is gone
    assert ran == []
    np.testing.assert_array_equal(found.impact_force_max, few.impact_force_max[some])


def test_a_part_of_a_cube_is_refused(few, whole, tmp_path):
    for part, says in (
        (few.isel(case=[0, 1]), r"'.*part\.nc' has 2 values of case, its sweep had 4; give the cube as it was made"),
        (few.isel(case=0), "has the axes none, its sweep had case"),
        (whole.isel(gap=[1, 0]), "other values of gap than its sweep; give the cube as it was made"),
        (whole.isel(gap=0), r"has the axes law, .*, its sweep had law, gap"),
    ):
        with pytest.raises(InputError, match=says):
            sweep().run(extend=write_cube(part, tmp_path / "part.nc", overwrite=True))


def test_cases_with_and_without_building_properties_run_in_different_kernels(few, tmp_path):
    """Also where the case that has some is of a record that the new sweep has not."""
    plain = {"law": "kelvin_voigt", "record": "one"}
    varied = {"law": "kelvin_voigt", "record": "two", "period_factors": {"a": 1.1}}
    with pytest.raises(InputError, match="only one of the two sweeps varies building properties"):
        listed([varied, plain]).run(extend=write_cube(few, tmp_path / "few.nc"))
    listed([varied, plain]).run(tmp_path / "old.nc", workers=1).close()
    with pytest.raises(InputError, match="only one of the two sweeps varies building properties"):
        listed([plain], records=motions()[:1]).run(extend=tmp_path / "old.nc")


def test_cases_extend_axes_and_axes_cases(whole, tmp_path):
    """A scenario is the same, whether it is listed or stands on axes."""
    some = [case for pair in POOL for case in pair[:1] if case["scale"] < 2.0]
    some += [
        {"law": "linear", "gap": 0.002, "record": "two", "scale": 1.5, "stiffness": 1e5},
        {"law": "kelvin_voigt", "gap": [0.02, 0.02], "record": "one", "restitution": 0.7},
    ]
    with listed_runs() as ran:
        cases = listed(some)
        expected = cases.run(tmp_path / "cases.nc", workers=1)
        write_cube(whole, tmp_path / "whole.nc")
        listed_there = set(ran)
        ran.clear()
        found = cases.run(extend=tmp_path / "whole.nc", workers=1)
        same(found, expected)
        on_axes = {(law, record, scale, k, e) for law, record, scale, k, e, gaps in listed_there - set(ran)}
        assert len(on_axes) == found_taken(found) > 4
        ran.clear()
        job = sweep()
        found = job.run(extend=tmp_path / "cases.nc", workers=1)
        same(found, whole)
        assert listed_there.isdisjoint(ran)
        assert job.last_outcome.run + found_taken(found) == whole.attrs["unique_run"]
    expected.close()


@pytest.mark.slow  # kernels of its own
def test_an_accuracy_is_chosen_for_the_sweep_as_a_whole(tmp_path):
    few = {"laws": ["linear", "none"], "scales": 1.0, "restitutions": 0.7, "dt": None, "method": None, "accuracy": 1e-2}
    sweep(**few, gaps=[0.002, 0.01]).run(tmp_path / "old.nc", workers=1).close()
    job = sweep(**few)
    found = job.run(extend=tmp_path / "old.nc", workers=1)
    same(found, job.run(workers=1))
    assert json.loads(found.attrs["extended_from"])["scenarios_taken"] > 0
    fewer = sweep(**{**few, "laws": "linear"})
    found = fewer.run(extend=tmp_path / "old.nc", workers=1)
    same(found, fewer.run(workers=1))
    assert found_taken(found) > 0
    fewer = sweep(**few, records=motions()[1:])
    found = fewer.run(extend=tmp_path / "old.nc", workers=1)
    same(found, fewer.run(workers=1))
    assert found_taken(found) > 0


def test_what_kept_an_accuracy_answers_whatever_scheme_was_chosen(stub_engine, tmp_path):
    """A tighter accuracy answers too, a looser one does not; nor does any for a scheme that is named."""
    axes = {"restitutions": 0.7, "dt": None, "method": None}
    old, other = tmp_path / "old.nc", tmp_path / "other.nc"
    sweep(**axes, accuracy=1e-3, laws="linear").run(old, workers=1).close()
    with open_cube(old) as cube:
        write_cube(cube.load().assign_attrs(method="another", precision="float16"), other)
    for accuracy in (1e-3, 1e-2):
        job = sweep(**axes, accuracy=accuracy, laws=["linear", "kelvin_voigt"])
        found = job.run(extend=other, workers=1)
        assert found_taken(found) > 4
        assert float(found.error_estimate.max()) <= accuracy
    with pytest.raises(InputError, match=r"accuracy is 0\.001 in the first and 0\.0001 in the second"):
        sweep(**axes, accuracy=1e-4, laws="linear").run(extend=other)
    with pytest.raises(InputError, match="method is None in the first and 'rk4' in the second"):
        sweep(**{**axes, "method": "rk4"}, accuracy=1e-3, laws="linear").run(extend=other)
    # parts of which each chose a scheme are one cube, which a sweep may extend
    sweep(**axes, accuracy=1e-3, laws="hertz").run(tmp_path / "hertz.nc", workers=1).close()
    merged = merge_cubes([other, tmp_path / "hertz.nc"], tmp_path / "both.nc")
    with open_cube(merged.path) as cube:
        assert cube.attrs["method"].startswith("another | ")
    found = sweep(**axes, accuracy=1e-3, laws=["linear", "hertz"]).run(extend=merged.path, workers=1)
    assert found_taken(found) > 8


def test_a_disk_that_gets_full_while_results_are_taken(whole, earlier, tmp_path, monkeypatch):
    new, full = tmp_path / "new.nc", OSError(28, "No space left on device")
    with monkeypatch.context() as patch:
        patch.setattr(np, "save", lambda *_, **__: (_ for _ in ()).throw(full))
        with pytest.raises(WriteError, match=r"writing chunk .* failed \(No space left on device\); free some space"):
            sweep().run(new, extend=earlier[0], workers=1)
    assert finished(whole, sweep(), new, extend=earlier[0])[2] == 32


def finished(whole, job, out, **settings):
    """Run to the end, check the cube and that nothing is left, and return how many are (run, kept, taken)."""
    log = out.with_name("new.nc.log")
    log.unlink(missing_ok=True)
    with job.run(out, workers=1, **settings) as found:
        same(found, whole)
        told = json.loads(found.attrs.get("extended_from", '{"scenarios_taken": 0}'))
        counts = job.last_outcome.run, job.last_outcome.reused, told["scenarios_taken"]
        assert sum(counts) == whole.attrs["unique_run"]
        assert found.attrs["scenarios_run"] == sum(counts[:2])
    if "file" in told:
        assert log.read_text().count(f" {counts[2]} scenarios taken from {told['file']}\n") == 1
    assert not out.with_name("new.nc.parts").exists()
    return counts


def interrupted(job, out, after, **settings):
    """Run until so many scenarios are there, and return how many chunks have taken some."""
    with pytest.raises(KeyboardInterrupt):
        job.run(out, workers=1, progress=At("scenarios", stop, after), **settings)
    lines = (out.with_name("new.nc.parts") / MANIFEST).read_text().splitlines()
    return sum("origin" in line for line in lines)


@pytest.fixture(scope="module")
def two_cubes(tmp_path_factory):
    """Of which chunks of the whole have all, half or none of their scenarios in the first, half in the second."""
    folder, less = tmp_path_factory.mktemp("earlier"), {key: LESS[key] for key in ("records", "restitutions")}
    sweep(**less, audit=0.0).run(folder / "old.nc", workers=1).close()
    sweep(audit=0.0, gaps=[0.01, 0.0005]).run(folder / "other.nc", workers=1).close()
    return folder / "old.nc", folder / "other.nc"


@pytest.fixture
def earlier(two_cubes, tmp_path, monkeypatch):
    """Copies of both, and chunks of few scenarios."""
    monkeypatch.setattr(planning, "CHUNK_SECONDS", 1e-5)
    return tuple(Path(shutil.copy(path, tmp_path)) for path in two_cubes)


@pytest.mark.parametrize(
    ("after", "lines", "there", "with_it"),  # what is taken comes first
    [
        (70, 2, 32, False),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in ((70, 2, 32, True), (1, 1, 16, True), (1, 1, 16, False))
        ),
    ],
)
def test_an_interrupted_extension_continues(whole, earlier, tmp_path, after, lines, there, with_it):
    """What was taken is told, as without an interrupt, whether it goes on with the other cube or without it."""
    (old, _), new = earlier, tmp_path / "new.nc"
    assert interrupted(sweep(), new, after, extend=old) == lines
    again = finished(whole, sweep(), new, **({"extend": old} if with_it else {}))
    assert again[2] == (32 if with_it else there)


def test_an_extension_goes_on_with_another_cube(whole, earlier, tmp_path):
    """The cube tells of the one that is given last; what was taken from another is among what was kept."""
    (old, other), new = earlier, tmp_path / "new.nc"
    assert interrupted(sweep(), new, 40, extend=old) == 2
    assert interrupted(sweep(), new, 70, extend=other) > 2
    _, kept, taken = finished(whole, sweep(), new, extend=other)
    assert kept > 32
    assert taken > 0


def test_a_chunk_that_fails_keeps_what_was_taken_for_it(whole, earlier, tmp_path, monkeypatch):
    """Else results would be lost where the cube that is extended is replaced."""
    real, new = execute.run_chunk, earlier[0].rename(tmp_path / "new.nc")

    def failing(task):
        audit, without_pounding = task.kernel.numerics.method == "exact", "closing_max" in task.outputs
        return real(task) if audit or without_pounding else "MemoryError: no room"

    job = sweep()
    with monkeypatch.context() as patch:
        patch.setattr(execute, "run_chunk", failing)
        with pytest.warns(RuntimeWarning, match=r"\d+ chunks have no result \(status not_run\): MemoryError: no room"):
            found = job.run(new, extend=new, workers=1, overwrite=True)
    there = found["status"] == Status.OK
    assert there.sel(record="two", restitution=0.7).all()
    assert (found["status"].where(~there, Status.NOT_RUN) == Status.NOT_RUN).all()
    for name in OUTPUTS:
        np.testing.assert_array_equal(found[name], whole[name].where(there))
    assert (job.last_outcome.run, found_taken(found)) == (len(job.plan().uncoupled_to_run), 32)
    assert 0 < job.last_outcome.failures.count("MemoryError: no room") == len(job.last_outcome.failures)
    found.close()
    finished(whole, sweep(), new, extend=new, overwrite=True)


def test_an_audit_without_result_is_made_up_for_as_the_warning_says(whole, tmp_path, monkeypatch):
    real = execute.run_chunk

    def failing(task):
        return "MemoryError: no room" if task.kernel.numerics.method == "exact" else real(task)

    out = tmp_path / "new.nc"
    with monkeypatch.context() as patch:
        patch.setattr(execute, "run_chunk", failing)
        with pytest.warns(RuntimeWarning, match=r"no room\. .*--extend OUT\.nc --overwrite"):
            cube = sweep().run(out, workers=1)
    assert "audit" not in cube.dims
    cube.close()
    run, _, taken = finished(whole, sweep(), out, extend=out, overwrite=True)  # audited like the whole
    assert run == len(sweep().plan().uncoupled_to_run)
    assert taken > run


SWEEP = """
[scene]
preset = "mate2015"

[sweep]
records = [{ pulse = "sine", amplitude = 5.0, period = 0.5, dt = 0.02, duration = 1.0 }]
laws = ["kelvin_voigt", "none"]
gaps = GAPS

[solver]
method = "rk4"
dt = 0.005

[output]
variables = ["displacement_max", "displacement_min", "impact_force_max", "impact_count", "first_impact_time"]
"""


def test_command(tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "160")
    for name, gaps in (("less", "[0.002, 0.01]"), ("more", "[0.0005, 0.002, 0.01]")):
        (tmp_path / f"{name}.toml").write_text(SWEEP.replace("GAPS", gaps))

    def run(name, *more):
        return call("run", tmp_path / f"{name}.toml", "--quiet", *more).stdout

    old, new, whole = (str(tmp_path / f"{name}.nc") for name in ("old", "new", "whole"))
    assert "taken" not in run("less", "-o", old)
    assert f"6 asked, 2 run, 2 taken from {old}" in run("more", "-o", new, "--extend", old)
    report = json.loads(run("more", "-o", old, "--extend", old, "--overwrite", "--json"))
    assert report["extended_from"]["scenarios_taken"] == 2
    assert "6 asked, 4 run\n" in run("more", "-o", whole)
    with open_cube(whole) as expected:
        for path in (old, new):
            with open_cube(path) as found:
                same(found, expected)
