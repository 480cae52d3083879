"""Running sweeps: any scheduler, interrupted or not, with failures or not, the same numbers."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import AXES, OUTPUTS, make, motions, row, same
from test_limits import At, stop

from pounding_sweep import resume
from pounding_sweep.base.errors import InputError, OutputError
from pounding_sweep.engine.row_kernel import RowKernel
from pounding_sweep.output import identity
from pounding_sweep.output.netcdf import open_cube
from pounding_sweep.plan.scenarios import Scenarios, cut
from pounding_sweep.records import Record
from pounding_sweep.request.spec import to_json
from pounding_sweep.resume import ChunkStore
from pounding_sweep.run.execute import Progress
from pounding_sweep.variables.registry import Status, get_variable


def scenarios_of(cube):
    """A cube without its audit, whose sample is another one in another sweep."""
    return cube.drop_dims(["audit", "output"], errors="ignore")


@pytest.fixture(scope="module")
def reference():
    """The cube of `make()` from one thread, in chunks as large as they come."""
    cube = make().run(scheduler="synchronous")
    assert (cube["status"] == Status.OK).all()
    assert float(cube["impact_count"].sum()) > 100
    return cube


@pytest.fixture
def small_chunks(monkeypatch):
    """Chunks of one lane group at most: six of them, of 8 and 16 scenarios."""
    monkeypatch.setattr("pounding_sweep.plan.plan.CHUNK_SECONDS", 0.0)


@pytest.mark.parametrize("chunk_seconds", [0.0, 2e-4, 10.0])
@pytest.mark.parametrize(
    ("scheduler", "workers"),
    [pytest.param("threads", 1, marks=pytest.mark.slow), ("threads", 2), ("threads", 3), ("synchronous", None)],
)
def test_no_scheduler_and_no_chunk_size_changes_a_bit(reference, monkeypatch, scheduler, workers, chunk_seconds):
    monkeypatch.setattr("pounding_sweep.plan.plan.CHUNK_SECONDS", chunk_seconds)
    same(make().run(scheduler=scheduler, workers=workers), reference)


def results_of(cube):
    """What scenarios end with; numbers of runs and which are copies depend on what else is asked for."""
    return scenarios_of(cube).drop_vars(["origin", "run"])


def test_order_and_company_do_not_matter(reference):
    """A scenario is the same alone, in another order and in another lane."""
    for gap in AXES["gaps"]:
        alone = make(gaps=gap, laws=["kelvin_voigt"], restitutions=0.3, stiffness_factors=0.5).run(workers=1)
        among = results_of(reference).sel(law=["kelvin_voigt"], gap=[gap], restitution=[0.3], stiffness_factor=[0.5])
        for name in among.data_vars:
            np.testing.assert_array_equal(alone[name].values, among[name].values, err_msg=f"{name} {gap}")
    backwards = make(gaps=AXES["gaps"][::-1], laws=AXES["laws"][::-1]).run(workers=2)
    same(results_of(backwards).sel(law=AXES["laws"], gap=AXES["gaps"]), results_of(reference))


@pytest.mark.usefixtures("small_chunks")
def test_sweeps_in_threads_keep_to_themselves():
    sweeps = [make(scales=scale) for scale in (0.5, 1.0, 1.5, 2.0)]
    alone = [sweep.run(workers=1) for sweep in sweeps]
    with ThreadPoolExecutor(len(sweeps)) as pool:
        for _ in range(2):
            together = pool.map(lambda sweep: sweep.run(workers=1), [make(scales=s) for s in (0.5, 1.0, 1.5, 2.0)])
            for cube, expected in zip(together, alone, strict=True):
                same(cube, expected)


@pytest.mark.parametrize(
    ("scheduler", "workers", "says"),
    [
        ("thread", None, "did you mean 'threads'"),
        ("cloud", None, "valid: .*processes.*tcp://HOST:PORT"),
        ("threads", 0, "workers = 0 must be a whole number, at least 1"),
        ("processes", -1, "workers = -1 must be a whole number, at least 1"),
        ("threads", math.nan, "workers = nan must be a whole number, at least 1"),
        ("threads", "2", "workers = '2' must be a whole number, at least 1"),
        (None, None, "unknown scheduler None; valid: "),
    ],
)
def test_a_scheduler_that_is_none(tmp_path, scheduler, workers, says):
    with pytest.raises(InputError, match=says):
        make().run(tmp_path / "out.nc", scheduler=scheduler, workers=workers)
    assert list(tmp_path.iterdir()) == []


@given(
    st.lists(st.tuples(st.integers(0, 2), st.integers(0, 1), st.integers(1, 3)), min_size=1, max_size=400),
    st.floats(0.0, 40.0),
)
def test_scenarios_are_cut_into_chunks_that_end_together(kinds, longest):
    """Each scenario once, alike ones side by side, the dearest first, in whole lane groups that get fewer."""
    record, law, steps = (np.array(column) for column in zip(*kinds, strict=True))
    n, none = len(kinds), np.zeros(len(kinds))
    scale, gaps, variant = np.arange(n) % 3 - 1.5, np.arange(n)[:, None] % 7 + 1.0, np.arange(n) % 2
    table = Scenarios(law, record, scale, none, none, gaps, variant)

    def seconds(record, steps):
        return (1.0 + record) * steps

    settings = {"name": "x", "longest": longest * 16, "most": 50, "seconds": seconds, "elastic": True}
    chunks = cut(table, np.arange(n), steps, np.zeros(n, int), **settings)
    assert sorted(row for chunk in chunks for row in chunk.rows.tolist()) == list(range(n))
    assert len({chunk.key for chunk in chunks}) == len(chunks)
    for chunk, following in itertools.pairwise(chunks):
        here, there = ((c.record, c.law, c.steps) for c in (chunk, following))
        assert seconds(here[0], here[2]) >= seconds(there[0], there[2])
        assert here != there or (len(chunk.rows) % 16 == 0 and len(chunk.rows) >= len(following.rows))
    for chunk in chunks:
        assert len(chunk.rows) <= max(16, 50, 16 * longest / seconds(chunk.record, chunk.steps))
        for name, column in (("record", record), ("law", law), ("steps", steps)):
            assert set(column[chunk.rows]) == {getattr(chunk, name)}
        assert (np.diff(100.0 * variant[chunk.rows] + gaps[chunk.rows, 0] / np.abs(scale[chunk.rows])) >= -1e-9).all()


class StopAfter(Progress):
    """Ctrl-C after so many chunks."""

    def __init__(self, chunks):
        self.left, self.name = chunks, ""

    def stage(self, name, total):
        self.name = name

    def advance(self, count):
        if self.name == "scenarios":
            self.left -= 1
            if self.left <= 0:
                raise KeyboardInterrupt


class Counting(Progress):
    def __init__(self):
        self.stages, self.totals, self.closed = [], [], False

    def stage(self, name, total):
        self.stages.append((name, total))
        self.totals.append(0)

    def advance(self, count):
        assert count > 0
        self.totals[-1] += count

    def close(self):
        self.closed = True


def interrupted(out, after=3, scheduler="threads", **changes):
    sweep = make(**changes)
    with pytest.raises(KeyboardInterrupt):
        sweep.run(out, scheduler=scheduler, workers=2, progress=StopAfter(after))
    return out.with_name(out.name + ".parts")


def rows_in(chunks):
    """Scenarios in chunk files."""
    return sum(len(np.load(path)) for path in chunks)


@pytest.mark.usefixtures("small_chunks")
@pytest.mark.parametrize("scheduler", [pytest.param("threads", marks=pytest.mark.slow), "synchronous"])
def test_an_interrupted_run_continues(reference, tmp_path, monkeypatch, scheduler):
    out = tmp_path / "out.nc"
    parts = interrupted(out, 3, scheduler)
    assert not out.exists()
    done = list(parts.glob("chunk-*.npy"))
    assert len(done) == 2 + 3  # the runs without pounding of two records too
    finished = rows_in(done)
    ran = []
    true_write = ChunkStore.write
    monkeypatch.setattr(
        ChunkStore,
        "write",
        lambda self, key, table, *more, **line: ran.append(len(table)) or true_write(self, key, table, *more, **line),
    )
    sweep, display = make(), Counting()
    cube = sweep.run(out, scheduler=scheduler, workers=3, progress=display)
    same(cube, reference)
    outcome = sweep.last_outcome
    assert outcome.reused == finished >= 26
    assert outcome.run == sum(ran)
    assert outcome.run + outcome.reused + outcome.untouched == sweep.plan().n_unique
    assert cube.attrs["scenarios_run"] == outcome.run + outcome.reused
    assert not parts.exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.nc", "out.nc.log"]
    with open_cube(out) as stored:
        same(stored.load(), reference)
    # the display was told of every scenario, reused ones too
    assert [name for name, _ in display.stages] == ["kernels", "no pounding", "scenarios", "audit", "cube"]
    assert display.totals == [total for _, total in display.stages]
    assert display.closed


@pytest.fixture
def held(monkeypatch):
    """Files of chunks in the order in which they are written; none is before it must."""
    monkeypatch.setattr(resume, "BUFFER_SECONDS", 600.0)
    true_write, written = ChunkStore.write, []

    def write(self, key, *more, **line):
        true_write(self, key, *more, **line)
        written.append(self.path(key))

    monkeypatch.setattr(ChunkStore, "write", write)
    return written


@pytest.mark.usefixtures("small_chunks")
def test_a_run_that_is_soon_over_writes_no_chunks(reference, tmp_path, held):
    beside = []

    class Looks(Progress):
        def stage(self, name, total):
            beside.append(sorted(path.name for path in (tmp_path / "out.nc.parts").iterdir()))

    same(make().run(tmp_path / "out.nc", workers=2, progress=Looks()), reference)
    assert beside == [["holder.txt", "lock"]] * 5
    assert held == []
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.nc", "out.nc.log"]


@pytest.mark.usefixtures("small_chunks")
def test_what_was_held_is_written_where_a_run_is_interrupted(reference, tmp_path, held):
    out, sweep = tmp_path / "out.nc", make()
    with pytest.raises(KeyboardInterrupt):
        sweep.run(out, workers=2, progress=At("cube", stop))
    finished = rows_in(held)
    same(sweep.run(out, workers=2), reference)
    assert sweep.last_outcome.reused == finished > 0


@pytest.mark.usefixtures("small_chunks")
def test_the_parts_of_another_sweep_are_not_used(reference, tmp_path, monkeypatch):
    out = tmp_path / "out.nc"
    parts = interrupted(out, 2)
    before = sorted((p.name, p.stat().st_mtime_ns) for p in parts.iterdir())
    one, two = motions()
    other = Record("one", one.dt, one.acceleration * (1.0 + 1e-12))
    for changes, named in (
        ({"dt": 0.0025}, r"dt \(0.005 there, 0.0025 here\), sweep"),
        ({"gaps": [0.0005, 0.6, 0.002, 0.01, 0.02]}, r"gaps \(\[0.0005, 0.5, .* here\), sweep"),
        ({"records": one}, "records .*, record two"),
        ({"records": [other, two]}, "record one"),
    ):
        with pytest.raises(OutputError, match=rf"belong to another sweep: they differ in {named}"):
            make(**changes).run(out)
    for name, key in (("package_version", "package"), ("package_digest", "source"), ("libraries", "libraries")):
        with monkeypatch.context() as patch:
            patch.setattr(f"pounding_sweep.resume.{name}", lambda: "another")
            with pytest.raises(OutputError, match=rf"they differ in {key} \(.* there, another here\);"):
                make().run(out)
    assert sorted((p.name, p.stat().st_mtime_ns) for p in parts.iterdir()) == before
    assert not out.exists()
    same(make().run(out), reference)


def test_every_source_of_the_package_counts(tmp_path, monkeypatch):
    """Kernels and laws among them: chunks and cubes of another state of them are not reused."""
    package = Path(identity.__file__).parents[1]
    shutil.copytree(package, tmp_path / "copy", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(identity, "__file__", str(tmp_path / "copy" / "output" / "identity.py"))
    digest = identity.package_digest.__wrapped__
    assert digest() == identity.package_digest()
    for edited in ("kernel/spec.py", "data/laws.toml", "data/measured.json"):
        with (tmp_path / "copy" / edited).open("a") as file:
            file.write(" ")
        assert digest() != identity.package_digest(), edited


def fails(monkeypatch, when):
    """Let kernels fail where `when(kernel, record)`."""
    true_run = RowKernel.run

    def run(self, record, **arguments):
        if when(self, record):
            raise MemoryError("the machine is on fire")
        return true_run(self, record, **arguments)

    monkeypatch.setattr(RowKernel, "run", run)


@pytest.mark.usefixtures("small_chunks")
@pytest.mark.parametrize("scheduler", ["threads", pytest.param("synchronous", marks=pytest.mark.slow)])
def test_a_failing_chunk_costs_its_own_scenarios_only(reference, tmp_path, monkeypatch, scheduler):
    out = tmp_path / "out.nc"
    sweep = make()
    with monkeypatch.context() as patch:
        fails(patch, lambda kernel, record: kernel.law.key == "kelvin_voigt" and record.name == "two")
        with pytest.warns(RuntimeWarning, match=r"chunks have no result \(status not_run\): MemoryError: the machine"):
            cube = sweep.run(out, scheduler=scheduler, workers=2)
    assert sweep.last_outcome.failures
    hurt = (cube["status"] == Status.NOT_RUN).sel(law="kelvin_voigt", record="two")
    touched = ~np.isnan(reference["first_impact_time"]).all(["pair", "storey"]).sel(law="kelvin_voigt", record="two")
    assert (hurt.values == touched.values).all()  # the never touching ones need no kernel of the law
    assert (cube["status"] == Status.NOT_RUN).sum() == hurt.sum() > 0
    fine = cube["status"] == Status.OK
    assert (fine | (cube["status"] == Status.NOT_RUN)).all()
    for name in OUTPUTS:
        assert np.isnan(cube[name].where(~fine)).all(), name
        np.testing.assert_array_equal(cube[name].where(fine), reference[name].where(fine))
    # what did run waits for the next attempt
    assert (tmp_path / "out.nc.parts").is_dir()
    again = make()
    same(again.run(out, overwrite=True), reference)
    assert again.last_outcome.reused > 0
    assert not (tmp_path / "out.nc.parts").exists()


def test_no_run_without_pounding_leaves_the_others(reference, monkeypatch):
    """Where nothing tells which scenarios never touch, all are run."""
    sweep = make()
    fails(monkeypatch, lambda kernel, record: kernel.law.key == "none")
    with pytest.warns(RuntimeWarning, match="no result"):
        cube = sweep.run()
    assert (cube["status"].sel(law="none") == Status.NOT_RUN).all()
    assert sweep.last_outcome.untouched == 0
    laws = ["linear", "kelvin_voigt"]
    for name in results_of(reference).data_vars:
        np.testing.assert_array_equal(cube[name].sel(law=laws), reference[name].sel(law=laws), err_msg=str(name))


def no_values(cube):
    """Where every output is missing."""
    inner = {"building", "pair", "storey"}
    return np.all([np.isnan(cube[name]).all({*cube[name].dims} & inner).values for name in OUTPUTS], axis=0)


def test_a_step_beyond_the_limit_is_refused_and_the_rest_is_run(reference):
    sweep = make(stiffness_factors=[1.0, 1e3])
    with_stiff = sweep.run()
    refused = with_stiff["status"] == Status.BEYOND_STABILITY_LIMIT
    assert refused.sel(stiffness_factor=1e3, law=["linear", "kelvin_voigt"]).all()
    assert refused.sum() == 2 * 5 * 3 * 2
    assert no_values(with_stiff)[refused.values].all()
    assert (with_stiff["status"].values[~refused.values] == Status.OK).all()
    own, want = (cube.sel(stiffness_factor=1.0) for cube in (with_stiff, reference))
    for name in OUTPUTS:
        np.testing.assert_array_equal(own[name], want[name])
    assert sweep.plan().n_unique == 2 + 2 * 5 + 2 * 5 * 3
    assert with_stiff.attrs["scenarios_run"] + sweep.last_outcome.untouched == sweep.plan().n_unique


def test_the_cube_says_what_it_is(tmp_path):
    sweep = make(scene=row((0.002, 0.003)), gaps=None, title="a small sweep")
    out = tmp_path / "out.nc"
    cube = sweep.run(out)
    text = cube.attrs["sweep"]
    assert text == to_json(sweep.spec)
    assert hashlib.sha256(text.encode()).hexdigest() == cube.attrs["sweep_sha256"]
    for told, record in zip(json.loads(cube.attrs["records"]), motions(), strict=True):
        given = (told["name"], told["sha256"], told["pga"], told["dt"], told["points"])
        assert given == (record.name, record.sha256, record.pga, record.dt, 150)
    assert (cube.attrs["title"], cube.attrs["scenarios_asked"]) == ("a small sweep", 3 * 1 * 2 * 3 * 2)
    assert cube.attrs["time_step"].tolist() == [0.005, 0.005]
    # coordinates: the scene's own gaps, and stiffness of each law
    assert cube["pair_gap"].dims == ("gap", "pair")
    assert cube["pair_gap"].values.tolist() == [[0.002, 0.003]]
    assert cube["contact_stiffness"].dims == ("law", "stiffness_factor")
    np.testing.assert_array_equal(cube["contact_stiffness"], [[2e5, 1e5], [np.nan, np.nan], [2e5, 1e5]])
    with netCDF4.Dataset(out) as file:
        axes = ("law", "gap", "stiffness_factor", "restitution", "record", "scale")
        assert file["impact_force_max"].dimensions == (*axes, "pair", "storey")
        assert (list(file["law"][:]), file["gap"][:].tolist()) == (AXES["laws"], [0.002])
        assert (file["status"].dtype, file["impact_count"].dtype) == (np.int8, np.int32)
        meanings = zip(file["status"].flag_meanings.split(), file["status"].flag_values.tolist(), strict=True)
        assert dict(meanings) == {s.label: int(s) for s in Status}
        for name in OUTPUTS:
            assert file[name].units == get_variable(name).units


@pytest.mark.parametrize(
    ("call", "guarded"),
    [
        ("run()", False),
        ('"""Without `if __name__ == "__main__":`."""\nprint(__name__, end="")\nrun()', False),
        ('if "__main__" == __name__:\n    run()', True),
    ],
)
def test_processes_need_a_script_with_a_guard(tmp_path, call, guarded):
    """A script that its processes would run again ends in one error before any of them is started."""
    script = tmp_path / "script.py"
    script.write_text(
        "from pounding_sweep.run.execute import check_scheduler as check\n\n"
        f"def run():\n    print(check('processes', 2))\n\n{call}\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    if guarded:
        assert done.stdout == "2\n"
    else:
        assert "RunError" in done.stderr
        assert 'if __name__ == "__main__":\n        ' in done.stderr


def test_a_process_that_imports_a_script_does_not_run_its_sweeps(tmp_path):
    """It ends in one line, before it makes a file or a folder."""
    script = tmp_path / "script.py"
    script.write_text(
        "import multiprocessing\nimport pounding_sweep as ps\n\n"
        'sweep = ps.Sweep("mate2015", "el_centro", "none", method="rk4", dt=0.02)\n'
        'if __name__ == "__main__":\n'
        '    process = multiprocessing.get_context("spawn").Process(target=print)\n'
        "    process.start()\n    process.join()\n    print(process.exitcode)\n"
        'else:\n    sweep.run("out.nc")\n'
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stdout == "1\n"
    (line,) = done.stderr.splitlines()
    assert "put that below a guard" in line
    assert [path.name for path in tmp_path.iterdir()] == ["script.py"]


@pytest.mark.usefixtures("stub_engine")
def test_a_client_of_a_dask_cluster_is_a_scheduler():
    from distributed import Client, LocalCluster

    with LocalCluster(n_workers=1, processes=False, dashboard_address=None) as cluster, Client(cluster) as client:
        cube = make().run(scheduler=client)
        assert client.status == "running"
    same(scenarios_of(cube), scenarios_of(make().run()))
