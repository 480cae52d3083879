"""Faults really injected into sweeps on disk, and what they cost: nothing that was finished, never a wrong number."""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
import warnings
import zlib
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import power_cut
import pytest
from scenes import OUTPUTS, motions, row
from test_cli import LONG, ROOT, TINY, cli, environment, write

from pounding_sweep.base.errors import OutputError
from pounding_sweep.base.files import is_temporary
from pounding_sweep.base.lock import HOLDER, LOCK
from pounding_sweep.output.netcdf import open_cube
from pounding_sweep.resume.checkpoint import MANIFEST, ChunkStore
from pounding_sweep.run.sweep import Sweep, load_sweep

#: In this process; those that are started, and what they are compared with, have kernels.
pytestmark = pytest.mark.usefixtures("stub_by_day")

OUT, PARTS = "out.nc", "out.nc.parts"


def make(**changes):
    """One run without pounding and three chunks of one lane group."""
    axes = {"laws": ["kelvin_voigt", "none"], "gaps": np.linspace(5e-4, 5e-3, 48).tolist()}
    return Sweep(row(), motions()[:1], **{**axes, "dt": 0.005, "outputs": OUTPUTS, "audit": 0.0, **changes})


def values(path):
    with open_cube(path) as found:
        return {name: found[name].values.tobytes() for name in found.variables}


def own_package(folder):
    """Copy the package, to be changed, or not to be; returns the environment in which it is found first."""
    shutil.copytree(ROOT / "pounding_sweep", folder / "pounding_sweep", ignore=shutil.ignore_patterns("__pycache__"))
    return {"PYTHONPATH": str(folder)}


@pytest.fixture
def small_chunks(monkeypatch):
    monkeypatch.setattr("pounding_sweep.plan.plan.CHUNK_SECONDS", 0.0)


@pytest.fixture
def written(monkeypatch):
    """Keys of the chunks that are written, as they are."""
    keys, write = [], ChunkStore.write

    def told(self, key, table):
        write(self, key, table)
        keys.append(key)

    monkeypatch.setattr(ChunkStore, "write", told)
    return keys


# -- power cuts --------------------------------------------------------------------------------------------------------


def record(folder, *, before=None, **how):
    """Run the sweep in a folder under watch; returns every moment at which the power may fail."""
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # the run before was killed
        recorder = power_cut.Recorder(folder, patch, before)
        write = ChunkStore.write

        def promises(self, key, table):
            write(self, key, table)
            recorder.promise(key)

        numbers = itertools.count()
        patch.setattr("secrets.token_hex", lambda size: f"{next(numbers):0{2 * size}x}")  # the same names every time
        patch.setattr(ChunkStore, "write", promises)
        try:
            make().run(folder / OUT, scheduler="synchronous", **how).close()
        finally:
            recorder.close()
    return recorder.cuts


@dataclass
class Tally:
    """What power cuts left, and what the next run made of it."""

    cuts: int = 0
    states: int = 0
    cubes: int = 0
    promised: int = 0
    lost: int = 0
    damaged: int = 0
    refused: int = 0
    wrong: int = 0

    def told(self, kind):
        """Return what is counted, for the fixture of that name."""
        words = {
            "cut points": self.cuts,
            "states of the disk": self.states,
            "of them with the cube in place": self.cubes,
            "chunks promised": self.promised,
            "chunks lost": self.lost,
            "damaged chunks found and made again": self.damaged,
            "damaged cubes and folders refused": self.refused,
            "wrong cubes": self.wrong,
        }
        return {(kind, word): number for word, number in words.items()}


def left(cuts, tally, damages):
    """Return states that the cuts may leave, by so many damages, each once, with what must be there in it."""
    found = {}
    for number, cut in enumerate(cuts):
        tally.cuts += 1
        for state in cut.states(number, damages):
            key = hashlib.sha256(repr(sorted(state.items())).encode()).digest()
            found[key] = (state, found.get(key, (state, frozenset()))[1] | cut.promised)
    return list(found.values())


def entries(manifest):
    """Entries of a manifest by the key of their chunk; what is torn is none."""
    found = {}
    for line in manifest.split(b"\n"):
        with suppress(ValueError):
            entry = json.loads(line)
            found[entry["key"]] = entry
    return found


def chunks_by_manifest(content):
    """Chunks of the manifest whose file is there, and those whose file is what was written."""
    listed = entries(content(f"{PARTS}/{MANIFEST}") or b"")
    files = {key: content(f"{PARTS}/{entry['file']}") for key, entry in listed.items()}
    there = {key for key, file in files.items() if file is not None}
    return there, {key for key in there if zlib.crc32(files[key]) == listed[key]["crc32"]}


def is_wrong(path, reference, tally):
    """Whether a cube has other values; one that can't be read is none, and is counted."""
    try:
        return values(path) != reference
    except (OutputError, RuntimeError):
        tally.refused += 1
        return False


def survive(folder, state, promised, reference, written, tally, earlier=None):
    """Let the next run go on from what a cut left, and count what that costs."""
    power_cut.make(folder, state)
    tally.states += 1
    out, there = folder / OUT, state.get(OUT)
    complete = there is not None and there != earlier
    if complete:
        tally.cubes += 1
        tally.wrong += is_wrong(out, reference, tally)
        with pytest.raises(OutputError, match="exists; give another path, or overwrite it"):
            make().run(out)
    written.clear()
    damaged = set.difference(*chunks_by_manifest(state.get))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            make().run(out, scheduler="synchronous", overwrite=there is not None).close()
        except OutputError as error:
            if not re.search(r"identity\.json' is damaged; remove the folder|is not one of chunks", str(error)):
                raise
            tally.refused += 1
            damaged = set()
            shutil.rmtree(folder / PARTS)
            make().run(out, scheduler="synchronous", overwrite=there is not None).close()
    if not complete:
        tally.promised += len(promised)
        tally.lost += len(promised & set(written))
    texts = {str(warning.message) for warning in said}
    again = {text for text in texts if re.search("chunk .* is damaged: .*; it is computed again$", text)}
    assert len(again) == len(damaged)
    assert all("the run before this one was killed" in text for text in texts - again)
    tally.damaged += len(damaged)
    tally.wrong += is_wrong(out, reference, tally)
    assert sorted(path.name for path in folder.iterdir()) == [OUT, f"{OUT}.log"]
    shutil.rmtree(folder)


@pytest.fixture
def cut_off(tmp_path, counts, small_chunks, written):
    """Have the next run go on from each of many states, and count."""
    with make().run(tmp_path / "whole.nc") as cube:
        reference = {name: cube[name].values.tobytes() for name in cube.variables}

    def all_of(kind, states, tally, earlier=None):
        for number, (state, promised) in enumerate(states):
            survive(tmp_path / f"state-{number}", state, promised, reference, written, tally, earlier)
        counts.update(tally.told(kind))

    return all_of


def begun(folder):
    folder.mkdir()
    return folder


@pytest.mark.parametrize(
    "most",
    [pytest.param(100, id="some", marks=pytest.mark.slow), pytest.param(None, id="all", marks=pytest.mark.release)],
)
def test_power_cuts(tmp_path, cut_off, most):
    """At every moment of a run, while its cube is written and while its chunks are removed."""
    tally = Tally()
    states = left(record(begun(tmp_path / "run")), tally, damages=5)
    cut_off("power cuts", random.Random(1).sample(states, most or len(states)), tally)
    assert tally.promised > 0
    assert tally.cubes > 0
    assert (tally.lost, tally.damaged, tally.refused, tally.wrong) == (0, 0, 0, 0)


@pytest.mark.slow
def test_power_cuts_while_a_cube_is_replaced(tmp_path, cut_off):
    """The old cube is there until the new one is."""
    tally, folder = Tally(), begun(tmp_path / "run")
    make(gaps=[0.001, 0.002]).run(folder / OUT).close()
    earlier = (folder / OUT).read_bytes()
    states = left(record(folder, overwrite=True), tally, damages=5)
    assert all(state[OUT] for state, _ in states)
    cut_off("power cuts, replacing a cube", random.Random(2).sample(states, 100), tally, earlier)
    assert tally.promised > 0
    assert (tally.lost, tally.damaged, tally.refused, tally.wrong) == (0, 0, 0, 0)


def not_lasting(cut):
    """Chunks that were promised and that a power cut might take, as long as there is no cube."""
    if cut.lasting(OUT) is not None:
        return set()
    return set(cut.promised) - chunks_by_manifest(cut.lasting)[1]


@pytest.mark.slow
@pytest.mark.usefixtures("small_chunks")
def test_power_cuts_after_a_kill(tmp_path, counts):
    """What a killed run left is there for the next one to see, and not all of it is lasting."""
    cuts = record(begun(tmp_path / "run"))
    kills = [cut for cut in cuts if OUT not in cut.after(cut.pending)]
    checked = promised = lost = 0
    for number, cut in enumerate(kills):
        for later in record(begun(tmp_path / f"run-{number}"), before=cut):
            checked += 1
            promised += len(later.promised)
            lost += len(not_lasting(later))
    told = {"kills": len(kills), "cut points": checked, "times a chunk was promised": promised, "times lost": lost}
    counts.update({("power cuts after a kill", word): number for word, number in told.items()})
    assert promised > checked
    assert lost == 0


# -- kills -------------------------------------------------------------------------------------------------------------

#: Some twenty chunks of a tenth of a second.
NIGHT = LONG.replace("dt = 1e-6", "dt = 5e-6").replace("count = 128", "count = 320")
RUN = ["run", "sweep.toml", "-o", f"study/{OUT}", "--workers", "1", "--quiet", "--json"]

#: Starts processes that have loaded what a run needs, so that they can be killed in its work and not while they load.
NURSERY = r"""
import os, sys
from pounding_sweep import cli
from pounding_sweep.run import chunk_writer
from pounding_sweep.run.sweep import load_sweep

chunk_writer.HELD_SECONDS = 0.0
load_sweep("warm.toml").run(scheduler="synchronous")
for line in sys.stdin:
    if line == "start\n":
        child = os.fork()
        if not child:
            for number, name in enumerate(("stdout", "stderr"), 1):
                os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644), number)
            sys.argv[:] = ["pounding-sweep", *sys.argv[1:]]
            cli.main()
        print(child, flush=True)
    else:  # until then the process is not forgotten, and its number not given to another
        os.kill(child, 9)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""
DAMAGE = ("file truncated", "byte flipped", "line cut", "zeros after the manifest", "stale lock")


class Night:
    """One sweep in one folder, run by one process after another, each of which is killed."""

    def __init__(self, folder, seed):
        self.folder, self.study, self.draw = folder, folder / "study", random.Random(seed)
        self.study.mkdir()
        self.env = own_package(folder)  # nobody edits it meanwhile
        write(folder, NIGHT)
        write(folder, TINY, "warm.toml")
        self.kills, self.faults, self.hit = Counter(), Counter(), set()
        self.written = self.destroyed = self.lost = 0

    def __enter__(self):
        how = {"cwd": self.folder, "env": environment(**self.env), "text": True}
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        self._nursery = subprocess.Popen([sys.executable, "-c", NURSERY, *RUN], **how, **pipes)
        return self

    def __exit__(self, *raised):
        self._nursery.communicate(timeout=300)

    def _tell(self, word):
        self._nursery.stdin.write(f"{word}\n")
        self._nursery.stdin.flush()
        return int(self._nursery.stdout.readline())

    def log(self):
        path = self.study / f"{OUT}.log"
        return path.read_text() if path.exists() else ""

    def sound(self):
        """Chunks that are there and are what was written."""

        def content(name):
            path = self.study / name
            return path.read_bytes() if path.is_file() else None

        return chunks_by_manifest(content)[1]

    def _lines(self):
        path = self.study / PARTS / MANIFEST
        return sum(line.endswith(b"}") for line in path.read_bytes().split(b"\n")) if path.exists() else 0

    def life(self, kind):
        """Start a run and kill it: while it loads, at any moment, in its chunks, in the cube, or after that."""
        before, listed, said = self.sound(), self._lines(), len(self.log())
        more, limit = self.draw.randrange(1, 3), time.monotonic() + 300
        reached = {
            "in its chunks": lambda: self._lines() >= listed + more,
            "in the cube": lambda: "stage cube begins" in self.log()[said:],
            "at its end": (self.study / OUT).exists,
        }.get(kind, lambda: True)
        if kind == "while it loads":
            run = subprocess.Popen(
                [sys.executable, "-m", "pounding_sweep", *RUN],
                cwd=self.folder,
                env=environment(**self.env),
                stderr=subprocess.DEVNULL,
            )
            time.sleep(self.draw.uniform(0.0, 2.0))
            run.kill()
            code = run.wait()
        else:
            self._tell("start")
            over = "(ended|failed|interrupted) after" + ("|stage cube begins" if kind == "in its chunks" else "")
            while not reached() and not re.search(over, self.log()[said:]):
                assert time.monotonic() < limit, self.log()[said:]
                time.sleep(0.001)
            time.sleep(self.draw.uniform(0.0, {"at any moment": 0.5, "at its end": 0.01}.get(kind, 0.1)))
            code = self._tell("kill")
        assert code == -signal.SIGKILL or (self.study / OUT).exists(), self.log()[said:]
        # a chunk and what is expected may be written at once; what earlier runs were writing is gone
        assert sum(map(is_temporary, os.listdir(self.study / PARTS) if (self.study / PARTS).exists() else [])) <= 2
        self.kills[kind] += 1
        if not (self.study / OUT).exists():
            self.lost += len(before - self.sound())
            self.written += self._lines() - listed

    def damage(self):
        """Damage something that the last run left."""
        before, draw, parts = self.sound(), self.draw, self.study / PARTS
        kind, key, manifest = draw.choice(DAMAGE), draw.choice(sorted(before)), parts / MANIFEST
        if kind == "stale lock":
            (parts / LOCK).touch()
            (parts / HOLDER).write_text(draw.choice(["process 7 on a machine, since 2026", "", "\0" * 80]))
        elif kind == "zeros after the manifest":
            manifest.write_bytes(manifest.read_bytes() + bytes(draw.randrange(1, 4096)))
        elif kind == "line cut":
            lines = manifest.read_bytes().split(b"\n")
            cut = [line[: draw.randrange(len(line))] if key.encode() in line else line for line in lines]
            manifest.write_bytes(b"\n".join(cut))
        else:
            path = parts / f"chunk-{key}.npy"
            content = bytearray(path.read_bytes())
            if kind == "byte flipped":
                content[draw.randrange(len(content))] ^= 1 << draw.randrange(8)
            else:
                del content[draw.randrange(len(content)) :]
            path.write_bytes(content)
            self.hit.add(key)
        self.faults[kind] += 1
        self.destroyed += len(before - self.sound())


#: Nights that are tried before a release.
RELEASE = [pytest.param(seed, marks=pytest.mark.release) for seed in (2, 3)]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """What a run gives that nobody disturbs."""
    cube = load_sweep(write(tmp_path_factory.mktemp("undisturbed"), NIGHT)).run(workers=2)
    return {name: cube[name].values.tobytes() for name in cube.variables}


@pytest.mark.parametrize("seed", [pytest.param(1, marks=pytest.mark.slow), *RELEASE])
def test_kills(tmp_path, counts, undisturbed, seed):
    """One sweep, killed again and again and damaged in between, until it completes."""
    with Night(tmp_path, seed) as night:
        while night.kills["in the cube"] < 10 and not (night.study / OUT).exists():
            kinds, weights = ["while it loads", "at any moment", "in its chunks"], [1, 4, 4]
            if "stage cube begins" in night.log():
                kinds, weights = ["in the cube"], [1]
            night.life(night.draw.choices(kinds, weights)[0])
            if night.sound() and night.draw.random() < 0.5:
                night.damage()
        if not (night.study / OUT).exists():
            night.life("at its end")
    assert values(night.study / OUT) == undisturbed
    plan = load_sweep(tmp_path / "sweep.toml").plan()
    chunks = len(plan.uncoupled_chunks()) + len(plan.chunks(np.flatnonzero(~plan.no_contact)))
    assert night.written <= chunks + night.destroyed
    kept = sum(len(np.load(night.study / PARTS / f"chunk-{key}.npy")) for key in night.sound())
    report = json.loads(cli(*RUN, "--overwrite", cwd=tmp_path, env=night.env).stdout)["scenarios"]
    assert (report["reused"], report["run"]) == (kept, plan.n_unique - kept)
    assert values(night.study / OUT) == undisturbed
    assert sorted(path.name for path in night.study.iterdir()) == [OUT, f"{OUT}.log"]
    said = set(re.findall(r"warning: chunk '(\w+)' in .* is damaged: .*; it is computed again", night.log()))
    assert said == night.hit
    assert night.lost == 0
    assert night.kills.total() >= 20
    counts.update({("kills", kind): number for kind, number in night.kills.items()})
    counts.update({("faults between kills", kind): number for kind, number in night.faults.items()})
    counts.update(
        {("chunks of killed runs", "finished"): chunks, ("chunks of killed runs", "lost by a kill"): night.lost}
    )
    counts["chunks of killed runs", "damaged and made again"] += night.destroyed


# -- changes -----------------------------------------------------------------------------------------------------------

#: Has all chunks finished, and stops before the cube.
STOPPED = """
from pounding_sweep import cli
from pounding_sweep.run import cube_writer as filling

def stop(*arguments, **more):
    raise KeyboardInterrupt

filling.write_cube_of = stop
cli.main()
"""
PULSE = 'records = [{ pulse = "sine", amplitude = 5.0, period = 0.5, dt = 0.01, duration = 2.0 }]'
CHANGED = ["run", "sweep.toml", "-o", OUT]


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    """A study of its own record, under a package of its own, with all chunks finished and no cube."""
    folder = tmp_path_factory.mktemp("stopped")
    motion = 5.0 * np.sin(0.1 * np.arange(100))
    lines = [f"{0.01 * i:.2f},{a:.6f}" for i, a in enumerate(motion)]
    write(folder, "\n".join(["time (s),acceleration (m/s2)", *lines, ""]), "shake.csv")
    assert PULSE in TINY
    write(folder, TINY.replace(PULSE, 'records = "shake.csv"'))
    (folder / "package").mkdir()
    env = own_package(folder / "package")
    assert "interrupted" in cli(*CHANGED, cwd=folder, env=env, code=130, start=("-c", STOPPED)).stderr
    return folder


def edit(path, old, new):
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")


def installed(folder, name):
    """Have another version of a distribution found first."""
    (folder / "package" / f"{name}-9.9.dist-info").mkdir()
    write(
        folder / "package" / f"{name}-9.9.dist-info", f"Metadata-Version: 2.1\nName: {name}\nVersion: 9.9\n", "METADATA"
    )


CHANGES = {
    "nothing": (lambda folder: None, None),
    "a value of the sweep": (
        lambda folder: edit(folder / "sweep.toml", "0.005", "0.006"),
        r"gaps \(\[0\.001, 0\.005, 1\.0\] there, \[0\.001, 0\.006, 1\.0\] here\), sweep \(\w{12}\.\.\. there",
    ),
    "the step": (
        lambda folder: edit(folder / "sweep.toml", "1e-3", "5e-4"),
        r"dt \(0\.001 there, 0\.0005 here\), sweep \(",
    ),
    "a value of the record": (
        lambda folder: edit(folder / "shake.csv", "0.50,-4.794621", "0.50,-4.794622"),
        r"record shake \(\w{12}\.\.\. there, \w{12}\.\.\. here\), sweep \(",
    ),
    "a kernel": (
        lambda folder: edit(
            folder / "package/pounding_sweep/model/laws.py",
            '"elastic": "k*d", "elastic_slope": "k"}',
            '"elastic": "2.0*k*d", "elastic_slope": "2.0*k"}',
        ),
        r"source \(\w{12}\.\.\. there, \w{12}\.\.\. here\);",
    ),
    "what each scheme was measured to cost": (
        lambda folder: edit(folder / "package/pounding_sweep/data/measured.json", '"cost": {', '"cost":  {'),
        r"source \(\w{12}\.\.\. there, \w{12}\.\.\. here\);",
    ),
    "the version": (lambda folder: installed(folder, "pounding_sweep"), r"package \(\S+ there, 9\.9 here\);"),
    "numba": (lambda folder: installed(folder, "numba"), r"libraries \(numba \S+, .* there, numba 9\.9, .* here\);"),
}


#: The package as it stands in a folder, in a process of its own.
PROGRAM = ("-m", "pounding_sweep")


@pytest.mark.slow  # by day a sweep and a source that differ are, in `test_execute`, and chunks, in `test_store`
@pytest.mark.parametrize("what", CHANGES)
def test_what_changed_is_named_and_nothing_stale_is_taken_up(stopped, tmp_path, what):
    folder = tmp_path / "study"
    shutil.copytree(stopped, folder)
    change, named = CHANGES[what]
    change(folder)
    before = {path.name: path.read_bytes() for path in (folder / PARTS).iterdir()}
    env = {"PYTHONPATH": str(folder / "package")}
    if named is None:  # the same chunks are taken up where nothing changed
        report = json.loads(cli(*CHANGED, "--json", cwd=folder, env=env, start=PROGRAM).stdout)["scenarios"]
        assert report["run"] == 0
        assert report["reused"] > 0
        return
    said = cli(*CHANGED, cwd=folder, env=env, code=2, start=PROGRAM).stderr
    assert re.search(rf"belong to another sweep: they differ in {named}", said)
    assert {path.name: path.read_bytes() for path in (folder / PARTS).iterdir()} == before
    assert not (folder / OUT).exists()


PEAK = """
import json
import test_cache as t
run = t.get_kernel(t.kernel_of().shape)
print(json.dumps({"compiled": t.hits_and_misses(run)[1], "soft": t.peak(k=2e5), "stiff": t.peak(k=4e5)}))
"""


@pytest.mark.slow  # compiles
def test_an_edited_kernel_is_compiled_anew(tmp_path):
    """By a process that finds the kernel of the package as it was on disk: twice the stiffness by formula."""

    def run(package):
        path = os.pathsep.join([*package.values(), str(ROOT / "tests")])
        env = environment(PYTHONPATH=path, POUNDING_SWEEP_CACHE=str(tmp_path / "kernels"))
        return json.loads(subprocess.check_output([sys.executable, "-c", PEAK], env=env, cwd=tmp_path, text=True))

    before, copy = run({"as it is": str(ROOT)}), tmp_path / "package"
    copy.mkdir()
    package = own_package(copy)
    assert run(package) == {**before, "compiled": 0}
    CHANGES["a kernel"][0](tmp_path)
    after = run(package)
    assert before["compiled"] == after["compiled"] == 1
    assert after["soft"] == before["stiff"] > 1.1 * before["soft"]
