"""Dask clusters of real processes: workers die, start again, join late or have another version; SLURM's script."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import textwrap
import threading
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import dask
import numpy as np
import psutil
import pytest
from dask_cluster import DaskCluster
from scenes import make, same
from test_cli import HEEDING, LONG, cli, environment, same_data, wait_until, write
from test_limits import done

import pounding_sweep
from pounding_sweep.base.errors import ClusterError
from pounding_sweep.model.variants import Variants
from pounding_sweep.plan.scenarios import ChunkTask
from pounding_sweep.run import cluster as far_workers
from pounding_sweep.run.execute import Progress
from pounding_sweep.variables.registry import Status

# where all have died, the next may take long to start on a busy machine
pytestmark = pytest.mark.filterwarnings("ignore:(no )?workers at .*; waiting:RuntimeWarning")


@pytest.fixture(scope="module")
def reference():
    """The cube that no cluster made."""
    cube = make().run(scheduler="synchronous")
    assert (cube["status"] == Status.OK).all()
    return cube


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch):
    """Chunks of one lane group at most, and a close look at the workers."""
    monkeypatch.setattr("pounding_sweep.plan.plan.CHUNK_SECONDS", 0.0)
    monkeypatch.setattr(far_workers, "POLL_SECONDS", 0.05)


def started_by(pid):
    """Worker processes that live below a process."""
    found = []
    for process in psutil.Process(pid).children():
        with suppress(psutil.Error):  # dead, or dying
            if "spawn_main" in " ".join(process.cmdline()):
                found.append(process)
    return found


@pytest.fixture
def impatient(monkeypatch):
    """Whoever is without workers says so soon."""
    monkeypatch.setattr(far_workers, "ALONE_SECONDS", 0.2)


class Events(Progress):
    """Does something when so many scenarios are done; keeps the notes."""

    def __init__(self, *events):
        self.events, self.done, self.notes = list(events), 0, []

    def stage(self, name, total):
        self.done = 0

    def advance(self, count):
        self.done += count
        while self.events and self.done >= self.events[0][0]:
            self.events.pop(0)[1]()

    def note(self, text):
        self.notes.append(text)


def run_whole(reference, **options):
    """Run the sweep; nothing is missing or different."""
    sweep = make()
    with sweep.run(**options) as cube:
        assert not sweep.last_outcome.failures
        same(cube, reference)
    return sweep.last_outcome


# -- workers that die, start again and join ----------------------------------------------------------------------------


@pytest.mark.slow
def test_workers_are_killed_and_others_join(reference, tmp_path):
    """All workers that were there at the start are gone before the end, with everything that was sent to them."""
    with DaskCluster(tmp_path) as cluster:
        cluster.add("first").add("second")

        def replace(old, new):
            cluster.kill(old)
            cluster.add(new, wait=False)

        events = Events((8, lambda: replace("first", "third")), (40, lambda: replace("second", "fourth")))
        run_whole(reference, out=tmp_path / "out.nc", scheduler=cluster.address, progress=events)
        assert not events.events
        log = (tmp_path / "out.nc.log").read_text()
        assert log.count(" takes part, with 1 threads") >= 3
        assert log.count(": has left; ") == 2


@pytest.mark.slow
def test_own_processes_are_killed(reference):
    """Those that `processes` starts too, again and again."""
    killed = []

    def die():
        for worker in started_by(os.getpid())[:1]:
            worker.kill()
            killed.append(worker.pid)

    events = Events(*((at, die) for at in (8, 16, 40, 64)))
    run_whole(reference, scheduler="processes", workers=2, progress=events)
    assert not events.events
    assert len(killed) >= 2


@pytest.mark.slow
@pytest.mark.usefixtures("impatient")
def test_workers_that_come_later(reference, tmp_path):
    """A scheduler without workers, as when they wait in a batch system's queue, is waited for."""
    with DaskCluster(tmp_path) as cluster:
        events = Events()
        late = threading.Timer(1.0, lambda: cluster.add("late", wait=False))
        late.start()
        with pytest.warns(RuntimeWarning, match=f"no workers at {cluster.address}; waiting"):
            run_whole(reference, scheduler=cluster.address, progress=events)
        late.join()
        assert "takes part" in events.notes[0]


@pytest.mark.slow
def test_the_scheduler_dies(reference, tmp_path):
    """The run ends with an error that says so; the next one goes on from what is there."""
    out = tmp_path / "out.nc"
    with DaskCluster(tmp_path) as cluster:
        cluster.add("only")
        with pytest.raises(ClusterError, match=rf"the dask scheduler at '{cluster.address}' is gone"):
            make().run(out, scheduler=cluster.address, progress=Events((24, cluster.kill_scheduler)))
    assert run_whole(reference, out=out).reused > 0


# -- interrupts --------------------------------------------------------------------------------------------------------


@pytest.fixture
def interrupted(tmp_path):
    """Run a sweep in a process of its own, interrupted by `event`; check how it ends, and run it again."""
    write(tmp_path, LONG.replace("dt = 1e-6", "dt = 3e-6"))

    def check(code="", event=lambda process: None, scheduler="processes"):
        run = ["run", "sweep.toml", "-o", "out.nc", "--quiet", "--workers", "2", "--scheduler"]
        command = [sys.executable, "-c", f"{textwrap.dedent(code)}\n{HEEDING}", *run, scheduler]
        more = {"cwd": tmp_path, "env": environment(), "text": True, "start_new_session": True}
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **more) as process:
            event(process)
            out, err = process.communicate(timeout=300)
        assert process.returncode == 130, err
        assert out == ""
        assert re.fullmatch(r"pounding-sweep: interrupted(; .*)?\n", err)
        assert not (tmp_path / "out.nc").exists()
        again = subprocess.run(
            [sys.executable, "-m", "pounding_sweep", *run, scheduler if "://" in scheduler else "threads", "--json"],
            check=True, cwd=tmp_path, env=environment(), capture_output=True, text=True,
        )  # fmt: skip
        return json.loads(again.stdout)["scenarios"]

    return check


@pytest.mark.slow
def test_an_interrupt_while_processes_start(interrupted):
    found = interrupted("""
        import os, signal, distributed

        class Interrupted(distributed.LocalCluster):
            def __init__(self, *args, **settings):
                os.kill(os.getpid(), signal.SIGTERM)
                super().__init__(*args, **settings)

        distributed.LocalCluster = Interrupted
    """)
    assert found["run"] == 129
    assert found["reused"] == 0


@pytest.mark.slow
def test_an_interrupt_from_the_keyboard_is_for_the_client(interrupted, tmp_path):
    """A terminal sends it to the workers too; they end with their client, which keeps what is done."""
    workers = []

    def event(process):
        wait_until(lambda: done(tmp_path) > 1, process)
        workers.extend(started_by(process.pid))
        os.killpg(process.pid, signal.SIGINT)

    found = interrupted(event=event)
    assert found["reused"] > 0
    assert found["run"] + found["reused"] == 129
    assert len(workers) == 2
    assert not any(worker.is_running() for worker in workers)


# -- workers that can't take part --------------------------------------------------------------------------------------


@pytest.fixture
def other_package(tmp_path):
    """A copy of the package with one more line."""
    copy = tmp_path / "other" / "pounding_sweep"
    shutil.copytree(Path(pounding_sweep.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    with (copy / "scene.py").open("a") as file:
        file.write("\n# changed\n")
    return {"PYTHONPATH": str(copy.parent)}


@pytest.mark.slow
@pytest.mark.usefixtures("impatient")
def test_a_worker_of_another_version_takes_no_part(reference, tmp_path, other_package):
    with DaskCluster(tmp_path) as cluster:
        cluster.add("other", env=other_package)
        with pytest.raises(ClusterError, match=r"none of the 1 dask workers can take part: .*Install the same ver"):
            make().run(scheduler=cluster.address)
        cluster.add("same")
        events = Events((8, lambda: cluster.add("late", env=other_package)))
        run_whole(reference, scheduler=cluster.address, progress=events)
        assert sum("takes no part, it has pounding_sweep" in note for note in events.notes) >= 1
        assert not events.events


@pytest.mark.slow
def test_a_scheduler_without_the_package(tmp_path):
    """It would fail each task, for a reason that no task tells."""
    (tmp_path / "none").mkdir()
    (tmp_path / "none" / "pounding_sweep.py").write_text("raise ImportError('not installed')\n")
    with DaskCluster(tmp_path, env={"PYTHONPATH": str(tmp_path / "none")}) as cluster:
        cluster.add("only")
        with pytest.raises(ClusterError, match=r"can't load the package \(.*\); install pounding_sweep .* in its env"):
            make().run(scheduler=cluster.address)


def test_nobody_at_the_address(tmp_path):
    import distributed  # noqa: F401 - whose settings are there from then on

    with (
        dask.config.set({"distributed.comm.timeouts.connect": "200ms"}),
        pytest.raises(ClusterError, match=r"no dask scheduler answers at 'tcp://127.0.0.1:9' .*dask scheduler"),
    ):
        make().run(tmp_path / "out.nc", scheduler="tcp://127.0.0.1:9")


# -- what goes over the wire -------------------------------------------------------------------------------------------


def jobs(kernel):
    none = np.zeros(0)
    return lambda position: ChunkTask(kernel, None, position, Variants(None, none, none, none), ())


def poison(task):
    if task.table == 7:
        os.kill(os.getpid(), signal.SIGKILL)
    return np.array([task.table])


def settings(task):
    import numba

    names = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    return np.array([numba.config.NUMBA_NUM_THREADS, *(int(os.environ[name]) for name in names)])


@pytest.fixture
def importable(monkeypatch):
    """Workers find this module."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]))


@pytest.mark.slow
@pytest.mark.usefixtures("importable")
def test_a_chunk_that_kills_costs_itself_only():
    with far_workers.cluster_client("processes", 2) as client:
        found = dict(
            far_workers.ClusterWorkers(client, poison, print).run(range(40), jobs(SimpleNamespace(scene=None)))
        )
    bad = found.pop(7)
    assert isinstance(bad, str)
    assert re.match("KilledWorker: |RuntimeError: its workers died", bad)
    assert {at: result if isinstance(result, str) else result.tolist() for at, result in found.items()} == {
        i: [i] for i in range(40) if i != 7
    }


@pytest.mark.slow
@pytest.mark.usefixtures("importable")
def test_one_thread_per_process():
    with far_workers.cluster_client("processes", 2) as client:
        found = dict(
            far_workers.ClusterWorkers(client, settings, print).run(range(2), jobs(SimpleNamespace(scene=None)))
        )
        assert set(client.nthreads().values()) == {1}
        # a share of little memory is filled by the libraries alone: dask would stop such a worker for ever
        assert {worker["memory_limit"] for worker in client.scheduler_info()["workers"].values()} == {0}
    assert [result.tolist() for result in found.values()] == [[1, 1, 1, 1, 1]] * 2


PAGE = Path(__file__).parents[1] / "docs" / "clusters.md"

#: What the batch system's own commands do, as far as dask-jobqueue needs them.
SBATCH = """#!/bin/sh
cp "$1" "$JOBS/script"
setsid bash "$JOBS/script" >> "$JOBS/log" 2>&1 &
echo $! >> "$JOBS/submitted"
echo "Submitted batch job $!"
"""
SCANCEL = """#!/bin/sh
echo "$1" >> "$JOBS/cancelled"
kill -- "-$1"
"""


@pytest.fixture
def batch_system(tmp_path):
    """Environment in which `sbatch` and `scancel` are found, and the folder of their jobs."""
    commands, jobs = tmp_path / "bin", tmp_path / "jobs"
    for folder in (commands, jobs):
        folder.mkdir()
    for name, text in {"sbatch": SBATCH, "scancel": SCANCEL}.items():
        (commands / name).write_text(text)
        (commands / name).chmod(0o755)
    path = f"{commands}{os.pathsep}{os.environ['PATH']}"
    yield environment(PATH=path, JOBS=str(jobs)), jobs
    for job in (jobs / "submitted").read_text().split() if (jobs / "submitted").exists() else ():
        subprocess.run(["sh", "-c", f"kill -9 -- -{job}"], check=False, capture_output=True)


def documented(**changes):
    """Return the script of the page, in which some of its words are others."""
    (script,) = (text for text in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL) if "SLURM" in text)
    for old, new in changes.items():
        assert f"{old}=" in script
        script = re.sub(rf"\b{old}=[^,)]+", f"{old}={new}", script)
    return script


@pytest.mark.slow
def test_the_documented_script(batch_system, tmp_path):
    """Two jobs of one process each do the work; both are cancelled at the end."""
    pytest.importorskip("dask_jobqueue")
    env, jobs = batch_system
    write(tmp_path, LONG.replace("dt = 1e-6", "dt = 1e-5"), "study.toml")
    cli("run", "study.toml", "-o", "here.nc", cwd=tmp_path)
    write(tmp_path, documented(cores=1, processes=1, memory='"4GB"', jobs=2), "script.py")
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, env=env, capture_output=True, text=True, check=False, timeout=500
    )
    assert done.returncode == 0, done.stderr + (jobs / "log").read_text()
    same_data(tmp_path / "study.nc", tmp_path / "here.nc")
    log = (tmp_path / "study.nc.log").read_text()
    assert 1 <= log.count(" takes part, with 1 threads") <= 2
    submitted = (jobs / "submitted").read_text().split()
    assert len(submitted) == 2
    assert sorted((jobs / "cancelled").read_text().split()) == sorted(submitted)
    script = (jobs / "script").read_text()
    assert "export NUMBA_NUM_THREADS=1" in script
    assert "#SBATCH -t 08:00:00" in script
    assert "--nthreads 1" in script
    assert "--lifetime 470m" in script
