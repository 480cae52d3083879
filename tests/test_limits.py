"""Runs that are stopped, meet each other, lose their disk or suffer faults: what is told, and what is kept."""

from __future__ import annotations

import errno
import json
import os
import random
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from contextlib import nullcontext
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
import pytest
from scenes import call, make
from test_cli import HEEDING, LONG, TINY, cli, environment, wait_until, write

from pounding_sweep.base import files
from pounding_sweep.base.errors import OutputError, RunError, WriteError
from pounding_sweep.base.files import LOCK
from pounding_sweep.output.netcdf import open_cube
from pounding_sweep.resume import HOLDER, MANIFEST, ChunkCorrupt, ChunkStore, locked, running, survey
from pounding_sweep.run import execute
from pounding_sweep.run.execute import Progress
from pounding_sweep.run.sweep import load_sweep

#: In this process; those that are started, and what they are compared with, have kernels.
pytestmark = pytest.mark.usefixtures("stub_by_day")

#: Eight chunks of some tenths of a second, after one without pounding.
SWEEP = LONG.replace("dt = 1e-6", "dt = 1.25e-6")
RUN = ["run", "sweep.toml", "-o", "out.nc", "--workers", "1"]


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """What an uninterrupted run gives."""
    return load_sweep(write(tmp_path_factory.mktemp("whole"), SWEEP)).run(workers=2)


def same(path, reference):
    with open_cube(path) as found:
        for name in reference.variables:
            assert found[name].values.tobytes() == reference[name].values.tobytes(), name


def begin(folder, *, finished, start=("-c", HEEDING)):
    """Start a run, and return its process, held by SIGSTOP, when so many chunks are finished."""
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen([sys.executable, *start, *RUN], cwd=folder, env=environment(), text=True, **pipes)
    wait_until(lambda: done(folder) >= finished, process)
    process.send_signal(signal.SIGSTOP)
    return process


def done(folder):
    """Finished chunks, by the manifest."""
    manifest = folder / "out.nc.parts" / MANIFEST
    return manifest.read_text().count('"key"') if manifest.exists() else 0


# -- signals and locks -------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_night(tmp_path, reference):
    """Ended by SIGTERM, begun again, disturbed by a second run, killed, begun again: nothing is lost."""
    write(tmp_path, SWEEP)
    with begin(tmp_path, finished=2) as process:
        process.send_signal(signal.SIGTERM)
        process.send_signal(signal.SIGCONT)
        out, err = process.communicate(timeout=300)
    kept = done(tmp_path)
    assert (process.returncode, out) == (130, ""), err
    kept_in = rf"what is finished is kept in {tmp_path}/out\.nc\.parts: .*again.*"
    assert re.fullmatch(rf"pounding-sweep: interrupted; {kept_in}\n", err)
    assert not (tmp_path / "out.nc").exists()
    assert not (tmp_path / "out.nc.parts" / LOCK).exists()
    assert kept >= 2

    with begin(tmp_path, finished=kept + 1) as process:
        refused = cli(*RUN, cwd=tmp_path, code=2).stderr
        seen = cli("info", "out.nc", cwd=tmp_path).stdout
        process.kill()
    assert f"another run is at work in '{tmp_path / 'out.nc.parts'}': process {process.pid} on " in refused
    assert "wait for it, stop it, or give another output path" in refused
    assert re.search(rf"^state +process {process.pid} on .* is at work on it$", seen, re.MULTILINE)

    found = survey(tmp_path / "out.nc.parts")
    assert found.now is None
    more = sum(part.chunks_done for part in found.parts)
    assert more == done(tmp_path) > kept
    last = cli(*RUN, "--json", cwd=tmp_path)
    assert f"the run before this one was killed (process {process.pid} on " in last.stderr
    report = json.loads(last.stdout)
    assert report["scenarios"]["reused"] == sum(part.scenarios_done for part in found.parts)
    assert report["scenarios"]["reused"] + report["scenarios"]["run"] == 129
    same(tmp_path / "out.nc", reference)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.nc", "out.nc.log", "sweep.toml"]
    told = [line.split()[1] for line in (tmp_path / "out.nc.log").read_text().splitlines()]
    assert [told.count(word) for word in ("begins:", "interrupted", "ended")] == [3, 1, 1]


@pytest.fixture(params=["locks", "no locks"])
def drive(request, monkeypatch):
    """Run a test on a drive with locks, and on one (such as some NFS mounts) that grants none."""
    if request.param == "no locks":
        fcntl = pytest.importorskip("fcntl")

        def flock(*args):
            raise OSError(errno.ENOLCK, "No locks available")

        monkeypatch.setattr(fcntl, "flock", flock)


@pytest.fixture
def parts(tmp_path):
    folder = tmp_path / "parts"
    folder.mkdir()
    return folder


def test_a_process_cannot_lock_twice(parts, drive, monkeypatch):
    monkeypatch.setattr("pounding_sweep.resume.PATIENCE", 0.0)
    with locked(parts):
        with pytest.raises(OutputError, match=rf"another run is at work.*process {os.getpid()} on"), locked(parts):
            pass
        assert running(parts).startswith(f"process {os.getpid()} on ")


@pytest.mark.parametrize("text", ["", "process 7 on elsewhere, since 2026-01-01T00:00:00+00:00"])
def test_a_lock_that_nobody_holds_is_free(parts, drive, text):
    (parts / LOCK).touch()
    (parts / HOLDER).write_text(text)
    assert running(parts) is None
    told = (
        pytest.warns(RuntimeWarning, match=r"was killed \(process 7 on elsewhere,.* goes on")
        if "7" in text
        else nullcontext()
    )
    with told, locked(parts):
        assert running(parts).startswith(f"process {os.getpid()} on {socket.gethostname()}, since ")
    assert not parts.exists()


# -- disks -------------------------------------------------------------------------------------------------------------

#: Mounts a small file system of its own, and runs a program that sees it.
MOUNTED = 'mount -t tmpfs -o "$1" tmpfs "$2" && shift 2 && exec "$@"'
UNSHARED = ("unshare", "--user", "--map-root-user", "--mount", "sh", "-c", MOUNTED, "sh")


def on_a_disk_of_its_own(folder, options, program, *arguments):
    """Run a program of Python on a new file system at `folder`; skips where none may be mounted."""
    folder.mkdir()
    if shutil.which("unshare") is None or subprocess.run([*UNSHARED, options, folder, "true"], check=False).returncode:
        pytest.skip("no file system may be mounted here")
    done = subprocess.run(
        [*UNSHARED, options, folder, sys.executable, "-c", program, folder, *arguments],
        **{"cwd": Path(__file__).parent, "env": environment(), "capture_output": True, "text": True, "timeout": 300},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


FILLED = """
import json, signal, sys
from pathlib import Path
from test_cli import cli, write
from test_limits import SWEEP, RUN, begin, done

disk, kept = Path(sys.argv[1]), Path(sys.argv[2])
BALLAST = '''
def fill(path):
    with open(path, "wb", buffering=0) as file:
        for size in (65536, 1):
            try:
                while True:
                    file.write(bytes(size))
            except OSError as error:
                assert error.errno == 28
'''
exec(BALLAST)
ballast, told = disk / "ballast", {}
write(disk, SWEEP)

with begin(disk, finished=1) as process:  # full while chunks are written
    fill(ballast)
    process.send_signal(signal.SIGCONT)
    told["chunks"] = (process.wait(), process.stderr.read(), done(disk))
ballast.unlink()
code = BALLAST + '''
from pounding_sweep import cli
from pounding_sweep.output import netcdf as filling
slabs = filling.slabs
def full(*arguments):
    fill("ballast")
    yield from slabs(*arguments)
filling.slabs = full
cli.main()
'''
failed = cli(*RUN, cwd=disk, code=1, start=("-c", code))  # full while the cube is written
told["cube"] = (failed.returncode, failed.stderr, done(disk))
told["left"] = sorted(path.name for path in disk.iterdir())
ballast.unlink()
told["last"] = json.loads(cli(*RUN, "--json", cwd=disk).stdout)["scenarios"]
for name in ("out.nc", "out.nc.log"):
    (kept / name).write_bytes((disk / name).read_bytes())
print(json.dumps(told))
"""


@pytest.mark.slow  # five processes
def test_a_full_disk(tmp_path, reference):
    told = json.loads(on_a_disk_of_its_own(tmp_path / "disk", "size=3m", FILLED, tmp_path))
    written = (
        r"writing (chunk .*|to '.*out\.nc\.parts') failed \(No space left on device\); free some space and run again"
    )
    for stage, failure in (("chunks", written), ("cube", r"writing '.*out\.nc' failed \(.*\); free some .*")):
        code, said, kept = told[stage]
        assert code == 1
        assert re.search(rf"pounding-sweep: failed: {failure}; what is finished is kept", said)
        assert "Traceback" not in said
        assert kept >= 1
    assert told["left"] == ["ballast", "out.nc.log", "out.nc.parts", "sweep.toml"]
    assert (told["last"]["run"], told["last"]["reused"]) == (0, 129)
    same(tmp_path / "out.nc", reference)


REMEDIES = {
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT), "free some space and run again"),
    errno.EROFS: "make the folder writable",
    errno.EACCES: r"make the folder writable \(on a drive without locks: set HDF5_USE_FILE_LOCKING=FALSE\)",
    errno.ESTALE: "what is missing was removed meanwhile: run again, and leave it",
    errno.EIO: "see to the disk, or give a path on another one, and run again",
}


@pytest.mark.parametrize(("number", "remedy"), REMEDIES.items())
def test_a_write_that_fails_tells_its_remedy(tmp_path, monkeypatch, number, remedy):
    def fails(*_):
        raise OSError(number, os.strerror(number))

    store = ChunkStore(tmp_path)
    monkeypatch.setattr("pounding_sweep.base.files.replacing", fails)
    with pytest.raises(WriteError, match=rf"failed \({os.strerror(number)}\); {remedy}"):
        store.write("k", np.zeros(1, [("a", "f8")]), [0])
    assert store.completed() == {}


class At(Progress):
    """Does something when a stage begins, or when some scenarios of it are done."""

    def __init__(self, name, action, after=0):
        self.name, self.action, self.after, self.current = name, action, after, ""

    def stage(self, name, total):
        self.current = name
        if name == self.name and not self.after:
            self.action()

    def advance(self, count):
        if self.current == self.name and self.after > 0:
            self.after -= count
            if self.after <= 0:
                self.action()


@pytest.mark.parametrize(("stage", "held"), [("scenarios", 0.0), ("scenarios", 600.0), ("cube", 0.0)])
def test_an_output_folder_that_is_gone_during_the_run(tmp_path, monkeypatch, stage, held):
    monkeypatch.setattr("pounding_sweep.resume.BUFFER_SECONDS", held)
    folder = tmp_path / "results"
    folder.mkdir()
    sweep = make()
    gone = "was removed or moved during the run; run again, and leave it"
    unlogged = r"the log .* can't be written \(No such file or directory\)"
    with pytest.warns(RuntimeWarning, match=unlogged), pytest.raises(WriteError, match=gone):
        sweep.run(folder / "out.nc", progress=At(stage, lambda: folder.rename(tmp_path / "gone")))
    assert not folder.exists()
    folder.mkdir()
    sweep.run(folder / "out.nc").close()
    assert sorted(path.name for path in folder.iterdir()) == ["out.nc", "out.nc.log"]


def test_chunks_that_are_damaged_before_the_cube_is_made(tmp_path, monkeypatch):
    """No number of the cube is from such a chunk."""

    def damages():
        path = max((tmp_path / "out.nc.parts").glob("chunk-*"), key=lambda path: path.stat().st_size)
        data = bytearray(path.read_bytes())
        data[-9] ^= 4
        path.write_bytes(data)

    sweep = make(audit=0.0)  # an audit would have read some
    whole = sweep.run(tmp_path / "whole.nc")
    damaged = r"chunk '\w+' in '.*out\.nc\.parts' is damaged: its CRC-32 .* made anew by the"
    with pytest.raises(WriteError, match=damaged):
        sweep.run(tmp_path / "out.nc", progress=At("cube", damages))
    assert not (tmp_path / "out.nc").exists()
    with pytest.warns(RuntimeWarning, match=r"is damaged: .*; it is computed again"):
        again = sweep.run(tmp_path / "out.nc")
    for name in whole.data_vars:
        np.testing.assert_array_equal(again[name], whole[name])


def test_chunks_whose_folder_is_closed(tmp_path, monkeypatch):
    """Both who runs and who asks is told why, and of whom to ask access."""
    write(tmp_path, TINY)
    parts = tmp_path / "out.nc.parts"
    parts.mkdir()
    (parts / MANIFEST).touch()
    real = Path.read_bytes

    def closed(path):
        if path.parent == parts:
            raise PermissionError(errno.EACCES, "Permission denied")
        return real(path)

    monkeypatch.setattr(Path, "read_bytes", closed)
    monkeypatch.chdir(tmp_path)
    said = r"the chunk folder '.*out\.nc\.parts' can't be read \(Permission denied\); ask its owner for access, or give"
    for command in (RUN, ["info", "out.nc"]):
        assert re.match(rf"pounding-sweep: error: {said} another path\n", call(*command, code=2).stderr)


def test_a_cube_is_not_replaced_by_one_without_any_result(tmp_path, monkeypatch):
    out = tmp_path / "out.nc"
    sweep = make()
    sweep.run(out).close()
    before = out.read_bytes()
    real = execute.run_chunk
    monkeypatch.setattr(execute, "run_chunk", lambda task: "on purpose")
    failed = r"all \d+ chunks failed \(on purpose\): '.*out\.nc' stays as it was; see to"
    with pytest.warns(RuntimeWarning, match="have no result"), pytest.raises(RunError, match=failed):
        sweep.run(out, overwrite=True, scheduler="synchronous")
    assert out.read_bytes() == before
    some = lambda task: real(task) if task.kernel.law.key == "none" else "on purpose"  # noqa: E731
    monkeypatch.setattr(execute, "run_chunk", some)
    with pytest.warns(RuntimeWarning, match="have no result"):
        sweep.run(out, overwrite=True, scheduler="synchronous").close()
    assert out.read_bytes() != before
    assert (tmp_path / "out.nc.parts").is_dir()


# -- what a half-finished folder tells ---------------------------------------------------------------------------------


def stop():
    raise KeyboardInterrupt


def test_what_is_done_and_what_is_missing(tmp_path, monkeypatch):
    monkeypatch.setattr("pounding_sweep.plan.plan.CHUNK_SECONDS", 0.0)
    sweep, parts = make(title="Row"), tmp_path / "out.nc.parts"
    with pytest.raises(KeyboardInterrupt):
        sweep.run(tmp_path / "out.nc", scheduler="synchronous", progress=At("no pounding", stop, 1))
    first = survey(parts)
    assert (first.title, first.asked, first.at_most) == ("Row", sweep.plan().n_asked, sweep.plan().n_unique)
    assert not first.planned
    assert [(p.stage, p.law, p.record, p.chunks, p.chunks_done) for p in first.parts] == [
        ("no pounding", "none", "one", 1, 1),
        ("no pounding", "none", "two", 1, 0),
    ]
    said = call("info", parts).stdout
    assert "(which of them have to is known after the runs without pounding)" in said
    assert re.search(r"^no pounding +none +two +1 +0 +1 +1 +0 +1$", said, re.MULTILINE)

    with pytest.raises(KeyboardInterrupt):
        sweep.run(tmp_path / "out.nc", scheduler="synchronous", progress=At("scenarios", stop, 20))
    second = survey(parts)
    assert (second.planned, second.now) == (True, None)
    files = list(parts.glob("chunk-*.npy"))
    assert sum(part.chunks_done for part in second.parts) == len(files)
    assert sum(part.scenarios_done for part in second.parts) == sum(len(np.load(path)) for path in files)
    files[0].unlink()
    lost = survey(parts)
    assert sum(part.chunks_done for part in lost.parts) == len(files) - 1
    missing = sum(part.scenarios - part.scenarios_done for part in lost.parts)
    sweep.run(tmp_path / "out.nc", scheduler="synchronous").close()
    assert sweep.last_outcome.run == missing > 0
    said = call("info", tmp_path / "out.nc").stdout
    assert "Variables" in said
    assert "unfinished" not in said

    with pytest.raises(KeyboardInterrupt):  # beside a cube that is finished
        sweep.run(tmp_path / "out.nc", overwrite=True, scheduler="synchronous", progress=At("scenarios", stop, 20))
    said = call("info", tmp_path / "out.nc")
    assert said.stdout.endswith(f"\nAn unfinished run stands beside this cube:\n{call('info', parts).stdout}")
    assert said.stderr == ""


def test_folders_that_are_not_half_finished(tmp_path):
    with pytest.raises(
        OutputError, match=r"no folder of finished chunks: it has no manifest\.jsonl; give OUT\.nc\.parts"
    ):
        survey(tmp_path)
    assert "it has no manifest.jsonl" in call("info", tmp_path, code=2).stderr
    ChunkStore(tmp_path, {"package": "1"}).flush()
    assert "no run came as far as its first stage" in call("info", tmp_path).stdout


OUT, PARTS = "out.nc", "out.nc.parts"


def values(path):
    with open_cube(path) as cube:
        return {name: cube[name].values.tobytes() for name in cube.variables}


#: Some twenty chunks of a tenth of a second, which are written at once.
NIGHT = LONG.replace("dt = 1e-6", "dt = 5e-6").replace("count = 128", "count = 320")
KILLED = ["run", "sweep.toml", "-o", OUT, "--workers", "1", "--quiet", "--json"]
START = """
from pounding_sweep import cli
from pounding_sweep import resume

resume.BUFFER_SECONDS = 0.0
cli.main()
"""


@pytest.mark.slow
def test_a_run_that_is_killed_and_damaged_again_and_again(tmp_path):
    """Only what no kill and no fault has taken is made again, and the cube is that of an undisturbed run."""
    write(tmp_path, NIGHT)
    draw, manifest = random.Random(1), tmp_path / PARTS / MANIFEST

    def chunk_lines():
        return [line for line in manifest.read_text().splitlines() if '"key"' in line and line.endswith("}")]

    def finished():
        return len(chunk_lines()) if manifest.exists() else 0

    damaged = set()
    for kind in ("byte flipped", "file truncated", "line cut", "stale holder", "none"):
        before = finished()
        with subprocess.Popen([sys.executable, "-c", START, *KILLED], cwd=tmp_path, env=environment()) as run:
            wait_until(lambda before=before: finished() > before, run)
            time.sleep(draw.uniform(0.0, 0.05))
            run.kill()
        assert run.returncode == -signal.SIGKILL
        first, *_ = chunk_lines()
        entry = json.loads(first)
        chunk = tmp_path / PARTS / f"chunk-{entry['key']}.npy"
        if kind == "byte flipped":
            content = bytearray(chunk.read_bytes())
            content[draw.randrange(len(content))] ^= 1
            chunk.write_bytes(content)
        elif kind == "file truncated":
            chunk.write_bytes(chunk.read_bytes()[:-3])
        elif kind == "line cut":
            manifest.write_text(manifest.read_text().replace(f"{first}\n", "") + first[:20])
        elif kind == "stale holder":
            (tmp_path / PARTS / HOLDER).write_text("process 7 on a machine, since 2026")
        damaged |= {entry["key"]} if kind in ("byte flipped", "file truncated") else set()
    report = json.loads(cli(*KILLED, cwd=tmp_path, start=("-c", START)).stdout)["scenarios"]
    assert report["reused"] > 0
    log = (tmp_path / f"{OUT}.log").read_text()
    assert set(re.findall(r"warning: chunk '(\w+)' in .* is damaged: .*; it is computed again", log)) == damaged
    assert sorted(path.name for path in tmp_path.iterdir()) == [OUT, f"{OUT}.log", "sweep.toml"]
    cube = load_sweep(tmp_path / "sweep.toml").run(workers=2)
    assert values(tmp_path / OUT) == {name: cube[name].values.tobytes() for name in cube.variables}


KIND = np.dtype([("drift_max", "f8", (1, 2)), ("impact_count", "i4"), ("status", "i1")], align=True)
TABLE = np.array([([[0.1, np.nan]], 3, 0), ([[-0.0, 5e-324]], -1, 1), ([[np.inf, -1e308]], 2**31 - 1, -127)], KIND)


def one(*numbers):
    """A table of one field."""
    return np.array([(number,) for number in numbers], [("a", "f8")])


def put(store, key, table):
    store.write(key, table, np.arange(len(table)) + 5)


def same_table(a, b):
    assert a.dtype == b.dtype
    assert np.array_equal(np.ascontiguousarray(a).view(np.uint8), np.ascontiguousarray(b).view(np.uint8))


@pytest.fixture
def store(tmp_path):
    (tmp_path / "out.chunks").mkdir()
    return again(ChunkStore(tmp_path / "out.chunks", {"dt": "0.001", "method": "rk4"}))


def again(store):
    other = ChunkStore(store.folder, store.details)
    other.flush()
    other.completed()
    return other


def test_round_trip(store):
    """A chunk is a plain table, read without this package, and no more of it than is used."""
    assert store.completed() == {}
    put(store, "a1", TABLE)
    put(store, "b2", one(1.0))
    other = again(store)
    assert set(other.completed()) == {"a1", "b2"}
    same_table(other.read("a1"), TABLE)
    same_table(np.load(store.path("a1"), allow_pickle=False), TABLE)
    assert isinstance(other.read("a1").base, np.memmap)
    assert other.rows("a1").tolist() == [5, 6, 7]
    store.path("a1").unlink()
    assert set(again(store).completed()) == {"b2"}


@pytest.mark.parametrize("cut", [1, 10, 40])
def test_a_torn_manifest_line_is_no_completion(store, cut):
    put(store, "a", TABLE)
    whole = (store.folder / MANIFEST).read_bytes()
    put(store, "b", TABLE)
    text = (store.folder / MANIFEST).read_bytes()
    (store.folder / MANIFEST).write_bytes(text[: len(whole) + cut])
    other = again(store)
    assert set(other.completed()) == {"a"}
    # What follows is not glued to the torn line.
    put(other, "c", TABLE)
    put(other, "b", TABLE)
    assert set(again(store).completed()) == {"a", "b", "c"}


@pytest.mark.parametrize("damage", ["flip", "flip table", "cut", "empty"])
def test_a_damaged_chunk_is_found(store, damage):
    put(store, "a", TABLE)
    path = store.path("a")
    content = bytearray(path.read_bytes())
    if "flip" in damage:
        content[-2 if damage == "flip" else -20] ^= 1
    path.write_bytes({"cut": bytes(content[:-7]), "empty": b""}.get(damage, bytes(content)))
    with pytest.raises(ChunkCorrupt, match=r"^chunk 'a' in '.*' is damaged: [^;]*$"):
        store.read("a")
    assert issubclass(ChunkCorrupt, OutputError)
    put(store, "a", TABLE)
    same_table(store.read("a"), TABLE)


def test_a_sweep_that_finished_nothing_leaves_its_folder_to_the_next(tmp_path):
    """As when somebody stops a run at once, mends the sweep file, and runs it again."""
    folder = tmp_path / "out.parts"
    first = ChunkStore(folder, {"dt": "0.001"})
    with first.lock():
        first.flush()
        (folder / "chunk-b.npy").write_bytes(b"not in the manifest yet")
    mended = ChunkStore(folder, {"dt": "0.002"})
    with mended.lock():
        mended.flush()
        assert [path.name for path in sorted(folder.iterdir())] == [HOLDER, LOCK, MANIFEST]
        put(mended, "a", TABLE)
    assert set(again(mended).completed()) == {"a"}
    differ = r"belong to another sweep: they differ in dt \(0.002 there, 0.001 here\); give another output path"
    with pytest.raises(OutputError, match=differ), first.lock():
        pass


def test_the_chunk_is_on_disk_before_the_manifest_names_it(store, monkeypatch):
    steps = []
    fsync = os.fsync

    def watch(handle):
        steps.append((os.path.basename(os.readlink(f"/proc/self/fd/{handle}")), "k" in store.completed()))
        fsync(handle)

    if not os.path.isdir("/proc/self/fd"):
        pytest.skip("needs /proc")
    monkeypatch.setattr(os, "fsync", watch)
    put(store, "k", TABLE)
    names = [name for name, _ in steps]
    assert fnmatch(names[0], files.TEMPORARY)
    assert names[1:] == [store.folder.name, MANIFEST]
    assert [complete for _, complete in steps[:2]] == [False, False]
