"""Dask clusters of real processes: workers die, start again, join late or have another version; nothing is lost."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import textwrap
import threading
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import dask
import numpy as np
import psutil
import pytest
from dask_cluster import DaskCluster
from distributed import Client, KilledWorker, LocalCluster, get_worker
from test_cli import HEEDING, LONG, environment, write
from test_execute import make, same

import pounding_sweep
from pounding_sweep.base.errors import ClusterError
from pounding_sweep.model.variants import Variants
from pounding_sweep.output.provenance import fingerprint
from pounding_sweep.outputs.variables import Status
from pounding_sweep.plan.chunks import ChunkTask
from pounding_sweep.resume.checkpoint import MANIFEST
from pounding_sweep.run import cluster as far_workers
from pounding_sweep.run.execute import Progress
from pounding_sweep.run.pool import Dispatcher

# where all have died, the next may take long to start on a busy machine
pytestmark = pytest.mark.filterwarnings("ignore:(no )?workers at .*; waiting:RuntimeWarning")


@pytest.fixture
def count(counts):
    """Count what was done to clusters, and what came of it."""

    def add(what, number=1):
        counts["clusters", what] += number

    return add


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
    monkeypatch.setattr(far_workers, "LOOK_SECONDS", 0.05)


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


@pytest.fixture
def whole(count):
    """Check that nothing is missing or different."""

    def check(cube, sweep, reference):
        count("cubes compared")
        count("chunks lost", len(sweep.last_outcome.failures))
        assert not sweep.last_outcome.failures
        same(cube, reference)

    return check


# -- workers that die, start again and join ----------------------------------------------------------------------------


@pytest.mark.slow
def test_workers_are_killed_and_others_join(reference, tmp_path, whole, count):
    """All workers that were there at the start are gone before the end, with everything that was sent to them."""
    with DaskCluster(tmp_path) as cluster:
        cluster.add("first").add("second")

        def replace(old, new):
            cluster.kill(old)
            cluster.add(new, wait=False)

        events = Events((8, lambda: replace("first", "third")), (40, lambda: replace("second", "fourth")))
        sweep = make()
        with sweep.run(tmp_path / "out.nc", scheduler=cluster.address, progress=events) as cube:
            whole(cube, sweep, reference)
        assert not events.events
        log = (tmp_path / "out.nc.log").read_text()
        assert log.count(" takes part, with 1 threads") >= 3
        assert log.count(": has left; ") == cluster.killed == 2
        count("workers killed", cluster.killed)
        count("workers that joined late", log.count(" takes part") - 2)


@pytest.mark.slow
@pytest.mark.parametrize(
    "given_up_after",
    [far_workers.RESTART_SECONDS, pytest.param(0.01, marks=pytest.mark.release)],
)
def test_own_processes_are_killed(monkeypatch, reference, whole, count, given_up_after):
    """Those that `processes` starts too, again and again; also where dask gives them up before they are back."""
    monkeypatch.setattr(far_workers, "RESTART_SECONDS", given_up_after)
    killed = []

    def die():
        for worker in started_by(os.getpid())[:1]:
            worker.kill()
            killed.append(worker.pid)

    events = Events(*((at, die) for at in (8, 16, 40, 64)))
    sweep = make()
    whole(sweep.run(scheduler="processes", workers=2, progress=events), sweep, reference)
    assert not events.events
    assert len(killed) >= 2
    count("workers killed", len(killed))


@pytest.mark.slow
@pytest.mark.usefixtures("impatient")
def test_workers_that_come_later(reference, tmp_path, whole, count):
    """A scheduler without workers, as when they wait in a batch system's queue, is waited for."""
    with DaskCluster(tmp_path) as cluster:
        events, sweep = Events(), make()
        cluster_waits = threading.Thread(target=lambda: (time.sleep(1.0), cluster.add("late", wait=False)))
        cluster_waits.start()
        with pytest.warns(RuntimeWarning, match=f"no workers at {cluster.address}; waiting"):
            whole(sweep.run(scheduler=cluster.address, progress=events), sweep, reference)
        cluster_waits.join()
        assert "takes part" in events.notes[0]
        count("workers that joined late")


@pytest.mark.slow
def test_workers_that_answer_late_get_their_kernels_first(monkeypatch, reference, tmp_path, whole):
    """A busy machine may take seconds to say what it has installed; the others wait for that, if not for ever."""
    monkeypatch.setattr(far_workers, "ANSWER_SECONDS", 300.0)
    with DaskCluster(tmp_path) as cluster:
        cluster.add("first").add("slow").freeze("slow")
        thaw = threading.Timer(1.5, cluster.thaw, ["slow"])
        thaw.start()
        events, sweep = Events(), make()
        events.stage = lambda name, total: events.notes.append(name)
        whole(sweep.run(scheduler=cluster.address, progress=events), sweep, reference)
        thaw.join()
    kinds = ["takes part" if "takes part" in note else note for note in events.notes]
    assert kinds[: kinds.index("no pounding")].count("takes part") == 2


@pytest.mark.slow
@pytest.mark.usefixtures("importable")
def test_all_workers_die_at_once(tmp_path, count):
    """Their chunks are handed out again as all others: nothing tells that one of them killed."""
    from distributed import Client

    found, events = {}, []
    with DaskCluster(tmp_path) as cluster:
        cluster.add("a").add("b")

        def take(position, result):
            found[position] = result
            if len(found) == 10:
                cluster.kill("a")
                cluster.kill("b")
                cluster.add("c", wait=False).add("d", wait=False)
                for name in "cd":
                    cluster.wait_for(name)
                with Client(cluster.address, set_as_default=False) as client:
                    client.run(fingerprint)  # both have imported all that they need

        with Dispatcher(cluster.address, 2, [None, None], where, events.append) as dispatcher:
            dispatcher.run(30, jobs(30, SimpleNamespace(scene=None)), take)
        with Client(cluster.address, set_as_default=False) as client:
            there = set(client.run(os.getpid).values())
    assert set(found) == set(range(30))
    assert sum("has left; 0 are there" in note for note in events) == 2
    assert {int(result[1]) for result in found.values() if int(result[1]) in there} == there
    count("workers killed", 2)


@pytest.mark.slow
def test_the_scheduler_dies(reference, tmp_path, whole, count):
    """The run ends with an error that says so; the next one goes on from what is there."""
    out = tmp_path / "out.nc"
    with DaskCluster(tmp_path) as cluster:
        cluster.add("only")
        events, sweep = Events((24, cluster.kill_scheduler)), make()
        with pytest.raises(ClusterError, match=rf"the dask scheduler at '{cluster.address}' is gone"):
            sweep.run(out, scheduler=cluster.address, progress=events)
    count("schedulers killed")
    sweep = make()
    with sweep.run(out) as cube:
        whole(cube, sweep, reference)
    assert sweep.last_outcome.reused > 0


@pytest.mark.slow
def test_the_client_is_killed(reference, tmp_path, whole):
    """Its cluster lives on, and the next client of the same scheduler continues."""
    code = (
        "import os, signal, sys; sys.path.insert(0, sys.argv[3]); from test_distributed import *\n"
        "import pounding_sweep.plan.plan as planning; planning.CHUNK_SECONDS = 0.0\n"
        "die = Events((40, lambda: os.kill(os.getpid(), signal.SIGKILL)))\n"
        "make().run(sys.argv[1], scheduler=sys.argv[2], progress=die)\n"
    )
    with DaskCluster(tmp_path) as cluster:
        cluster.add("only")
        arguments = [str(tmp_path / "out.nc"), cluster.address, str(Path(__file__).parent)]
        command = [sys.executable, "-c", code, *arguments]
        assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
        manifest = (tmp_path / "out.nc.parts" / MANIFEST).read_text().splitlines()
        sweep = make()
        with (
            pytest.warns(RuntimeWarning, match="was killed .* goes on"),
            sweep.run(tmp_path / "out.nc", scheduler=cluster.address) as cube,
        ):
            whole(cube, sweep, reference)
        assert sweep.last_outcome.reused == sum(json.loads(line)["rows"] for line in manifest) > 0


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
        assert re.fullmatch(r"pounding-sweep: interrupted; .*\n", err)
        assert not (tmp_path / "out.nc").exists()
        again = subprocess.run(
            [sys.executable, "-m", "pounding_sweep", *run, scheduler if "://" in scheduler else "threads", "--json"],
            check=True, cwd=tmp_path, env=environment(), capture_output=True, text=True,
        )  # fmt: skip
        return json.loads(again.stdout)["scenarios"]

    return check


@pytest.mark.slow
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_an_interrupt_while_processes_start(interrupted, name):
    """It waits until they are there, and ends them in order."""
    found = interrupted(f"""
        import os, signal, distributed

        class Interrupted(distributed.LocalCluster):
            def __init__(self, *args, **settings):
                os.kill(os.getpid(), signal.{name})
                super().__init__(*args, **settings)

        distributed.LocalCluster = Interrupted
    """)
    assert found["run"] == 129
    assert found["reused"] == 0


def wait_for_chunks(process, folder):
    """Wait until some chunks of a run are kept."""
    manifest, limit = folder / "out.nc.parts" / MANIFEST, time.monotonic() + 300
    while process.poll() is None and not (manifest.exists() and manifest.read_text().count("\n") > 1):
        assert time.monotonic() < limit
        time.sleep(0.01)


@pytest.mark.slow
def test_an_interrupt_from_the_keyboard_is_for_the_client(interrupted, tmp_path):
    """A terminal sends it to the workers too; they end with their client, which keeps what is done."""
    workers = []

    def event(process):
        wait_for_chunks(process, tmp_path)
        workers.extend(started_by(process.pid))
        os.killpg(process.pid, signal.SIGINT)

    found = interrupted(event=event)
    assert found["reused"] > 0
    assert found["run"] + found["reused"] == 129
    assert len(workers) == 2
    assert not any(worker.is_running() for worker in workers)


@pytest.mark.slow
def test_an_interrupt_leaves_the_cluster_as_it_is(interrupted, tmp_path):
    """SIGTERM, as a batch system sends it; the next run goes on with the same workers."""

    def event(process):
        wait_for_chunks(process, tmp_path)
        process.terminate()

    with DaskCluster(tmp_path) as cluster:
        cluster.add("only")
        found = interrupted(event=event, scheduler=cluster.address)
    assert found["reused"] > 0
    assert found["run"] + found["reused"] == 129
    assert (tmp_path / "out.nc.log").read_text().count(" takes part, with 1 threads") == 2


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
def test_a_worker_of_another_version_takes_no_part(reference, tmp_path, other_package, whole):
    with DaskCluster(tmp_path) as cluster:
        cluster.add("other", env=other_package)
        with pytest.raises(
            ClusterError, match=r"none of the 1 dask workers can take part: .*Install the same versions"
        ):
            make().run(scheduler=cluster.address)
        cluster.add("same")
        events, sweep = Events(), make()
        whole(sweep.run(scheduler=cluster.address, progress=events), sweep, reference)
        assert sum("takes no part, it has pounding_sweep" in note for note in events.notes) == 1

        events, sweep = Events((8, lambda: cluster.add("late", env=other_package))), make()
        whole(sweep.run(scheduler=cluster.address, progress=events), sweep, reference)
        assert not events.events


class Fake:
    """A client whose scheduler has some workers; nothing that it is given ends."""

    scheduler, cluster, loop = SimpleNamespace(address="tcp://scheduler"), None, None

    def __init__(self, *names):
        self.names = names

    def nthreads(self):
        return dict.fromkeys(self.names, 1)

    def submit(self, function, workers, **more):
        return workers[0]


@pytest.fixture
def looking(monkeypatch):
    """Whoever is without workers says so soon; what they have installed is put into `answers`."""
    monkeypatch.setattr(far_workers, "ALONE_SECONDS", 0.0)
    monkeypatch.setattr(far_workers, "OWN_SECONDS", 0.0)

    def make(fake):
        answers, notes = [], []
        queue = SimpleNamespace(add=lambda future: None, next_batch=lambda block: [answers.pop() for _ in answers[:]])
        monkeypatch.setattr(far_workers.ClusterWorkers, "_completed", lambda self, futures=(): queue)
        return far_workers.ClusterWorkers(fake, [], None, notes.append), answers, notes

    return make


def test_workers_that_have_not_answered_are_waited_for(looking):
    """One takes its time to import the package; it may be the only one that fits."""
    workers, answers, notes = looking(Fake("tcp://other", "tcp://slow"))
    assert not workers._look()
    answers.append(("tcp://other", "pounding_sweep 0.0.9"))
    with pytest.warns(RuntimeWarning, match="workers at tcp://scheduler have not said yet what they have installed"):
        assert not workers._look()
    answers.append(("tcp://slow", fingerprint()))
    assert workers._look()
    assert ["takes no part, it has pounding_sweep 0.0.9" in note for note in notes] == [True, False]


def test_workers_that_do_not_fit_are_told_of(looking):
    workers, answers, _ = looking(Fake("tcp://other"))
    assert not workers._look()
    answers.append(("tcp://other", (ImportError, ImportError("no such module"), None)))
    with pytest.raises(ClusterError, match=r"none of the 1 dask workers can take part: tcp://other has ImportError"):
        workers._look()


def test_processes_that_do_not_come_back_are_not_waited_for(looking):
    asked, fake = [], Fake()
    fake.cluster = SimpleNamespace(worker_spec={0: {}}, scale=asked.append)
    workers, *_ = looking(fake)
    assert not workers._look()
    assert asked == [1]
    with pytest.raises(ClusterError, match=r"all processes of this run are gone, and none has started again"):
        workers._look()


@pytest.mark.slow
def test_a_worker_of_another_version_at_an_address_that_is_known(
    monkeypatch, reference, tmp_path, other_package, whole, count
):
    """It gets work before anybody has asked it; it refuses that, and another does it."""
    monkeypatch.setattr(far_workers, "LOOK_SECONDS", 1.0)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with DaskCluster(tmp_path) as cluster:
        cluster.add("old", "--worker-port", port)

        def change():
            cluster.kill("old")
            cluster.add("new", "--worker-port", port, env=other_package)
            cluster.add("third", wait=False)

        events, sweep = Events((8, change)), make()
        whole(sweep.run(scheduler=cluster.address, progress=events), sweep, reference)
        assert not events.events
        assert sum("takes no part, it has pounding_sweep" in note for note in events.notes) == 1
        count("workers killed", cluster.killed)


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
    import dask
    import distributed  # noqa: F401 - whose settings are there from then on

    with (
        dask.config.set({"distributed.comm.timeouts.connect": "200ms"}),
        pytest.raises(ClusterError, match=r"no dask scheduler answers at 'tcp://127.0.0.1:9' .*dask scheduler"),
    ):
        make().run(tmp_path / "out.nc", scheduler="tcp://127.0.0.1:9")


# -- what goes over the wire -------------------------------------------------------------------------------------------


class Counted:
    """Anything that is sent; counts how often."""

    sent = 0

    def __init__(self, value):
        self.value = value

    def __reduce__(self):
        type(self).sent += 1
        return type(self), (self.value,)


def jobs(n, kernel):
    none = np.zeros(0)
    return lambda position: ChunkTask(
        f"{position}", kernel, position % 2, position, Variants(None, none, none, none), ()
    )


def add_up(kernel, record, table, variants, outputs):
    time.sleep(0.03)  # more than it takes to hand out a task: both workers get some
    return np.array([kernel.value + record.value + table, os.getpid()])


def where(kernel, record, table, variants, outputs):
    time.sleep(0.03)
    return np.array([table, os.getpid()])


def poison(kernel, record, table, variants, outputs):
    if table == 7:
        os.kill(os.getpid(), signal.SIGKILL)
    return np.array([table])


def ending(kernel, record, table, variants, outputs):
    """What `poison` is for a worker that lives in this process."""
    if table == 7:
        worker = get_worker()
        worker.loop.add_callback(worker.close, executor_wait=False)
        time.sleep(0.2)
    return np.array([table])


def lost_once(record):
    """Give back a record, except for the first time."""
    if not LOST:
        LOST.append(record)
        raise KilledWorker("record", None, 3)
    return record


LOST = []


def settings(kernel, record, table, variants, outputs):
    import numba

    names = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    return np.array([numba.config.NUMBA_NUM_THREADS, *(int(os.environ[name]) for name in names)])


@pytest.fixture
def importable(monkeypatch):
    """Workers find this module."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]))


@pytest.mark.slow
@pytest.mark.usefixtures("importable")
def test_sent_once_and_few_in_flight():
    """Each record goes to the scheduler once, and few results wait, however many chunks there are."""
    n, found = 120, {}
    Counted.sent = 0
    records = [Counted(100.0), Counted(200.0)]
    with Dispatcher("processes", 2, records, add_up) as dispatcher:
        slow = threading.Event()

        def take(position, result):
            assert position not in found
            found[position] = result
            slow.wait(0.03)  # results come faster than they are taken
            far = dispatcher.cluster
            # and what was lent, and what dask is about to let go
            assert len(far.client.futures) <= 2 * far.most_under_way + 3

        dispatcher.cluster.prepare([])  # both are there
        dispatcher.run(n, jobs(n, SimpleNamespace(value=0.5, scene=None)), take)
        assert dispatcher.cluster.most_under_way == 2 * far_workers.UNDER_WAY
    assert {at: result[0] for at, result in found.items()} == {i: 0.5 + 100.0 * (1 + i % 2) + i for i in range(n)}
    assert len({result[1] for result in found.values()}) == 2
    # dask tries two picklers, and the scheduler of this process hands on what it got
    assert Counted.sent <= 2 * 5


@pytest.fixture
def in_this_process():
    """A cluster of two workers in threads of this process, others of which come for those that end."""
    with (
        dask.config.set({"distributed.deploy.lost-worker-timeout": 0.01}),
        LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            processes=False,
            dashboard_address=None,
            scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
            silence_logs=50,
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        yield client


def only_one_is_lost(found):
    bad = found.pop(7)
    assert isinstance(bad, str)
    assert bad.startswith("lost 3 times while nothing else ran on its worker: ")
    assert {at: result if isinstance(result, str) else result.tolist() for at, result in found.items()} == {
        i: [i] for i in range(40) if i != 7
    }


def test_a_chunk_that_ends_its_worker_costs_itself_only(in_this_process, count):
    found, notes = {}, []
    workers = far_workers.ClusterWorkers(in_this_process, [None, None], ending, notes.append)
    workers.run(40, jobs(40, SimpleNamespace(scene=None)), found.__setitem__)
    only_one_is_lost(found)
    ended = sum("has left" in note for note in notes)
    assert ended >= far_workers.ALONE
    count("workers ended", ended)


@pytest.mark.slow
@pytest.mark.usefixtures("importable")
def test_a_chunk_that_kills_costs_itself_only(count):
    found, notes = {}, []
    with Dispatcher("processes", 2, [None, None], poison, notes.append) as dispatcher:
        dispatcher.run(40, jobs(40, SimpleNamespace(scene=None)), found.__setitem__)
    only_one_is_lost(found)
    count("workers killed", sum("has left" in note for note in notes))


def test_a_record_whose_workers_died_is_sent_again(in_this_process, monkeypatch):
    """Else all chunks of it would be lost with it."""
    monkeypatch.setattr(far_workers, "_same", lost_once)
    found = {}
    workers = far_workers.ClusterWorkers(in_this_process, [None, None], where, [].append)
    workers.run(12, jobs(12, SimpleNamespace(scene=None)), found.__setitem__)
    assert len(LOST) == 1
    assert {at: result if isinstance(result, str) else result[0] for at, result in found.items()} == {
        i: i for i in range(12)
    }


@pytest.mark.slow
@pytest.mark.usefixtures("importable")
def test_one_thread_per_process():
    found = {}
    with Dispatcher("processes", 2, [None, None], settings) as dispatcher:
        dispatcher.run(2, jobs(2, SimpleNamespace(scene=None)), found.__setitem__)
        client = dispatcher.cluster.client
        assert set(client.nthreads().values()) == {1}
        # a share of little memory is filled by the libraries alone: dask would stop such a worker for ever
        assert {worker["memory_limit"] for worker in client.scheduler_info()["workers"].values()} == {0}
    assert [result.tolist() for result in found.values()] == [[1, 1, 1, 1, 1]] * 2
