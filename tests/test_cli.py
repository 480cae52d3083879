"""The command line as users meet it: by what it prints and how it ends; here, but for a few processes of its own."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import subprocess
import sys
import time
import warnings
from contextlib import chdir, contextmanager, nullcontext, redirect_stderr, redirect_stdout
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest
import xarray as xr
from bad_sweeps import BAD
from typer.main import get_command

from pounding_sweep.cli.app import INTERRUPTS, app, open_streams
from pounding_sweep.model.laws import LAWS
from pounding_sweep.output.describe import summarize
from pounding_sweep.output.netcdf import write_cube
from pounding_sweep.records import NAMED_RECORDS
from pounding_sweep.request.spec import overview
from pounding_sweep.run import execute
from pounding_sweep.run.sweep import load_sweep
from pounding_sweep.variables.registry import Status

pytestmark = pytest.mark.usefixtures("stub_module")
ROOT = Path(__file__).resolve().parent.parent
QUICKSTART = ROOT / "sweeps" / "quickstart.toml"
#: Whether a process heeds SIGINT is inherited; this one does, whatever started the tests. It holds no chunks.
HEEDING = (
    "import runpy, signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "from pounding_sweep import resume; resume.BUFFER_SECONDS = 0.0; "
    "runpy.run_module('pounding_sweep', run_name='__main__', alter_sys=True)"
)

#: The scene and laws of the README's example, so that both use the same kernels.
TINY = """\
title = "Tiny"

[scene]
gaps = [0.002]
contact = { linear_stiffness = 1e6, restitution = 0.6 }

[[scene.row]]
name = "high"
masses = [100.0, 90.0]
stiffnesses = [8e4, 7e4]

[[scene.row]]
name = "low"
masses = [120.0]
stiffnesses = [2e5]

[sweep]
records = [{ pulse = "sine", amplitude = 5.0, period = 0.5, dt = 0.01, duration = 2.0 }]
laws = ["kelvin_voigt", "none"]
gaps = [0.001, 0.005, 1.0]
restitutions = [0.4, 0.8]

[solver]
method = "rk4"
dt = 1e-3
"""
#: Eight chunks; more than enough steps to be interrupted in.
LONG = (
    TINY.replace("gaps = [0.001, 0.005, 1.0]", "gaps = { start = 1e-4, stop = 5e-3, count = 128 }")
    .replace("restitutions = [0.4, 0.8]", "")
    .replace("dt = 1e-3", "dt = 1e-6")
)


def environment(**more):
    env = {key: value for key, value in os.environ.items() if key not in ("POUNDING_SWEEP_RECORDS", "FORCE_COLOR")}
    paths = [str(ROOT), env.get("PYTHONPATH", "")]
    return {**env, "PYTHONPATH": os.pathsep.join(filter(None, paths)), "COLUMNS": "100", **more}


@contextmanager
def as_a_user(cwd=None, env=None):
    """Folder, environment, warnings and signals of a process that a user starts."""
    there = nullcontext() if cwd is None else chdir(cwd)
    with there, patch.dict(os.environ, environment(**(env or {})), clear=True), warnings.catch_warnings():
        warnings.resetwarnings()
        warnings.simplefilter("ignore", DeprecationWarning)
        before = {number: signal.getsignal(number) for number in INTERRUPTS}
        yield
        for number, handler in before.items():  # which a process that is told to end keeps otherwise
            signal.signal(number, handler)


def cli(*args, cwd=None, code=0, env=None, start=()):
    """Run the command line here, or by `start` in its own process; returns what it printed, its exit code checked."""
    if start:
        command = [sys.executable, *start, *map(str, args)]
        more = {"cwd": cwd, "env": environment(**(env or {})), "stdin": subprocess.DEVNULL}
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600, **more)
    else:
        out, err, returncode = io.StringIO(), io.StringIO(), 0
        given = ["pounding-sweep", *map(str, args)]
        with as_a_user(cwd, env), patch.object(sys, "argv", given), redirect_stdout(out), redirect_stderr(err):
            try:
                app(prog_name="pounding-sweep")
            except SystemExit as end:
                returncode = end.code or 0
        done = SimpleNamespace(stdout=out.getvalue(), stderr=err.getvalue(), returncode=returncode)
    assert done.returncode == code, done.stderr
    return done


def bad(*args, **more):
    """Run what must be refused; returns the message, having checked that there is nothing else."""
    done = cli(*args, code=2, **more)
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert done.stderr.startswith("pounding-sweep: error: ")
    return done.stderr.removeprefix("pounding-sweep: error: ").rstrip("\n")


def wait_until(reached, process):
    """Wait until something is reached by a process."""
    limit = time.monotonic() + 300
    while not reached():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < limit
        time.sleep(0.002)


def write(folder, text, name="sweep.toml"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def edited(old, new):
    assert TINY.count(old) == 1
    return TINY.replace(old, new)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory, stub_module):
    """The tiny sweep, run once: its folder, what was printed."""
    folder = tmp_path_factory.mktemp("tiny")
    write(folder, TINY)
    return folder, cli("run", "sweep.toml", "-o", "out.nc", cwd=folder)


def test_every_command_has_help():
    text = cli("--help").stdout
    assert "--install-completion" not in text
    for command in get_command(app).commands:
        assert re.search(rf"^ +{command} ", text, re.MULTILINE), command
        assert f"pounding-sweep {command}" in cli(command, "--help").stdout
    for start in ((), ("-m", "pounding_sweep")):
        assert re.fullmatch(r"pounding-sweep \S.*\n", cli("--version", start=start).stdout)


@pytest.mark.parametrize("width", [40, 100])
def test_laws_lists_the_registry_in_full(width):
    """What is too wide for a table is told law by law, nothing of it cut off."""
    lines, _, _ = cli("laws", env={"COLUMNS": str(width)}).stdout.partition("\nd: penetration (m)")
    assert max(map(len, lines.splitlines())) <= width
    text = " ".join(lines.split())
    rows = json.loads(cli("laws", "--json").stdout)
    for law, row in zip(LAWS.values(), rows, strict=True):
        assert (row["key"], row["source"]) == (law.key, law.reference)
        for part in (law.key, law.formula, law.stiffness_unit, law.validity, law.number_text, law.reference):
            assert part in text


def at2(points, said=None):
    values = "".join(f"{0.1 * (-1) ** i:15.7E}" + "\n" * (i % 5 == 4) for i in range(points))
    return (
        "PEER STRONG MOTION DATABASE RECORD\nNORTHRIDGE 01/17/94, ARLETA, 090\n"
        f"ACCELERATION TIME HISTORY IN UNITS OF G\nNPTS= {said or points}, DT= .02000 SEC\n{values}\n"
    )


def test_records_lists_what_is_there_and_what_is_missing(tmp_path):
    (tmp_path / "ARL090.AT2").write_text(at2(50))
    (tmp_path / "short.AT2").write_text(at2(50, said=60))
    done = cli("records", "--records", tmp_path)
    assert re.search(r"^el_centro +0\.3188 .* 31\.18 +0\.02 +1560$", done.stdout, re.MULTILINE)
    assert re.search(r"^el_centro +Imperial Valley .*; unit g: ", done.stdout, re.MULTILINE)
    assert re.search(r"^arleta +0\.1000 .* 0\.98 +0\.02 +50$", done.stdout, re.MULTILINE)
    assert "short" not in done.stdout
    assert re.match("pounding-sweep: warning: .*short", done.stderr)
    missing = done.stdout.partition("not at hand")[2]
    assert "RSN 1077" in missing
    assert "arleta" not in missing
    report = json.loads(cli("records", "--json", env={"POUNDING_SWEEP_RECORDS": str(tmp_path)}).stdout)
    names = {part: [row["name"] for row in report[part]] for part in ("records", "unreadable", "missing")}
    missing = [name for name in NAMED_RECORDS if name not in ("el_centro", "arleta")]
    assert names == {"records": ["el_centro", "arleta"], "unreadable": ["short"], "missing": missing}


def test_examples_are_written_with_the_laws_they_need(tmp_path):
    listed = json.loads(cli("init", "--list", "--json").stdout)
    assert listed.keys() == {path.stem for path in (ROOT / "sweeps").glob("*.toml")}
    assert all(listed.values())
    done = cli("init", "mine.toml", "--from", "bumpers", cwd=tmp_path)
    assert done.stdout == "mine.toml\nbumpers.py\n"
    assert "pounding-sweep run mine.toml -o" in (tmp_path / "mine.toml").read_text()
    assert json.loads(cli("plan", "mine.toml", "--json", cwd=tmp_path).stdout)["asked"] > 0
    cli("init", "mine.toml", "--overwrite", cwd=tmp_path)  # the quickstart, where no example is named
    assert (tmp_path / "mine.toml").read_text().count("mate2015") > 0
    for args, message in (
        (("init", "mine.toml"), "exists"),
        (("init", "--from", "yeilding"), "did you mean 'yielding'?"),
        (("run", "quickstart"), "`pounding-sweep init quickstart.toml --from quickstart` writes it"),
        (("plan", "Mine.TOML"), "did you mean 'mine.toml'?"),
    ):
        assert message in bad(*args, cwd=tmp_path)


def test_names_on_a_terminal_of_ascii(monkeypatch):
    stdout = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", stdout)
    open_streams()
    print("Geb\u00e4ude")
    stdout.flush()
    assert stdout.buffer.getvalue() == b"Geb\\xe4ude\n"


def test_plan_of_the_quickstart_runs_nothing(tmp_path):
    cache = tmp_path / "kernels"
    done = cli("plan", QUICKSTART, env={"POUNDING_SWEEP_CACHE": str(cache)}, cwd=tmp_path)
    for part in ("1008 asked, at most 649 to run", "\nkernels    4, 4 to compile\n", " (el_centro) per scenario"):
        assert part in done.stdout
    assert re.search(
        r"^time +about .* to compile, then (about .*|under a second) to run, with \d+ workers?$",
        done.stdout,
        re.MULTILINE,
    )
    assert done.stderr == ""
    assert list(tmp_path.iterdir()) == []
    report = json.loads(cli("plan", QUICKSTART, "--json", "--workers", 3).stdout)
    assert [part["name"] for part in report["row"]] == ["left", "middle", "right", "left-middle", "middle-right"]
    assert report["row"][-1]["about"] == "floors meet at 3, 6, 9 m"
    assert [report[name] for name in ("asked", "at_most", "refused", "workers")] == [1008, 649, 0, 3]


def test_plan_says_what_an_accuracy_takes(tmp_path):
    sweep = write(tmp_path, edited("dt = 1e-3\n", "accuracy = 1e-4\n"))
    text = cli("plan", sweep).stdout
    assert max(map(len, text.splitlines())) <= 100
    said = next(line for line in re.sub(r"\n +", " ", text).splitlines() if line.startswith("accuracy "))
    assert re.match(
        r"accuracy +0\.0001: (rk4|exact) float(32|64), [\d to]+ steps? per record interval to begin with", said
    )
    assert re.search(r"^steps +\d+( to \d+)? \(sine\) per scenario", text, re.MULTILINE)
    report = json.loads(cli("plan", sweep, "--json").stdout)
    assert report["steps_least"]["sine"] <= report["steps"]["sine"]
    assert report["accuracy_choice"] in said
    numbers = report["accuracy_numbers"]
    assert (numbers["accuracy"], numbers["method"] in said, "kelvin_voigt" in str(numbers)) == (1e-4, True, True)
    write(tmp_path, TINY)
    assert re.search("^accuracy +0.001: rk4 float", cli("plan", sweep, "--accuracy", "1e-3").stdout, re.MULTILINE)
    assert "accuracy is 1.0; it must be in [1e-06, 0.1]" in bad("plan", sweep, "--accuracy", "1")


def test_run_prints_a_summary_and_the_path(tiny):
    folder, done = tiny
    row, records, *lines = done.stdout.split("\n\n", 2)
    assert records == "sine  201 points, dt 0.01 s, PGA 0.5087 g; sine pulse: amplitude=5 m/s2, period=0.5 s, dt=0.01 s"
    assert row == "\n".join(
        f"{name:8}  {text}" for name, text in overview(load_sweep(folder / "sweep.toml").spec.scene)
    )
    lines = re.sub(r"\n +", " ", "".join(lines)).splitlines()
    assert lines[0].split() == ["law", "pair", "peak", "force", "kN", "impacts", "median", "touching"]
    assert re.match("kelvin_voigt.*4/6$", lines[1])
    assert lines[2].split() == ["none", "high-low", "0", "0", "-", "0/6"]
    # two gaps and two restitutions run, and once without pounding; the two at 1 m never touch; none counts once
    assert "scenarios  12 asked, 5 run" in lines
    assert "not run    2 never touch, 5 equal another scenario" in lines
    errors = next(line for line in lines if line.startswith("errors "))
    assert re.match("errors +all 4 touching scenarios, all laws, compared with (exact|half the step): largest ", errors)
    assert 0.0 < float(re.search(r"largest error (\S+) \(", errors)[1]) < 1e-3
    assert lines[-1] == "out.nc"
    assert {*done.stderr.splitlines()} == {"compiling kernels, once for sweeps of this kind"}
    assert sorted(path.name for path in folder.iterdir()) == ["out.nc", "out.nc.log", "sweep.toml"]
    text = cli("info", folder / "out.nc").stdout
    assert text.startswith("Tiny\n")
    for part in ("12 scenarios asked, 5 run", "all 4 touching scenarios", "impact_force_max", "sine", "numba"):
        assert part in text
    figures = cli("plot", folder / "out.nc", "--list").stdout
    assert re.search("^force-gap .*^work-precision +setting, error, cost", figures, re.MULTILINE | re.DOTALL)


def test_run_as_json_equals_the_table(tiny, tmp_path):
    folder, printed = tiny
    done = cli("run", folder / "sweep.toml", "-o", tmp_path / "again.nc", "--json", "--scheduler", "synchronous")
    report = json.loads(done.stdout)
    assert report["scenarios"] == {"asked": 12, "usable": 12, "run": 5} | {
        "reused": 0,
        "never_touching": 2,
        "broadcast": 5,
    }
    assert report["cube"] == str(tmp_path / "again.nc")
    assert [part["name"] for part in report["row"]] == ["high", "low", "high-low"]
    assert (report["failures"], report["warnings"], report["accuracy_choice"], done.stderr) == ([], [], "", "")
    assert {item["output"] for item in report["audit"]} >= {"impact_force_max", "displacement_max"}
    assert all(item["scenarios"] + item["undecided"] == 4 for item in report["audit"])
    assert [item["label"] for item in report["statuses"]] == ["ok"]
    row = report["summary"][0]
    assert (row["law"], row["pair"], row["touching"], row["scenarios"]) == ("kelvin_voigt", "high-low", 4, 6)
    assert f"{row['peak_force']:.0f}" in printed.stdout
    same_data(folder / "out.nc", tmp_path / "again.nc")


def same_data(first, second):
    with xr.open_dataset(first) as a, xr.open_dataset(second) as b:
        xr.testing.assert_identical(a.load().drop_attrs(deep=False), b.load().drop_attrs(deep=False))


def test_a_run_replaces_nothing_unasked(tiny, tmp_path):
    folder, _ = tiny
    out = write(tmp_path, "mine", "out.nc")
    assert re.search("exists.*--overwrite", bad("run", folder / "sweep.toml", "-o", out))
    assert out.read_text() == "mine"
    cli("run", folder / "sweep.toml", "-o", out, "--overwrite", "--quiet")
    same_data(folder / "out.nc", out)
    write(tmp_path, TINY, "row.toml")  # without an output file it is written here
    done = cli("run", "row.toml", cwd=tmp_path)
    assert "the cube is written to row.nc" in done.stderr
    assert done.stdout.endswith("\nrow.nc\n")
    assert "'row.nc' exists" in bad("run", "row.toml", cwd=tmp_path)


def written_files(command=None, name=""):
    """Options of all commands that name a file to write: (command and option, its help, the command's options)."""
    command = command or get_command(app)
    for key, inner in getattr(command, "commands", {}).items():
        yield from written_files(inner, f"{name} {key}".strip())
    options = {option: item for item in command.params for option in item.opts}
    for option in ("-o", "--plot", "--map", "--data"):
        if option in options:
            yield f"{name} {option}", options[option].help, options


def test_data_are_never_replaced_unasked_and_figures_say_that_they_are():
    pictures = {f"{name} -o" for name in ("plot", "animate", "records plot", "view", "report")}
    pictures |= {"tradeoff --plot", "extremes --plot", "storey -o"}
    for name, told, options in written_files():
        assert told.endswith("replaced if it exists.") == (name in pictures), name
        assert name in pictures or "--overwrite" in options, name


def test_plan_and_run_say_what_is_wrong_with_scenarios_and_how_to_mend_it(tmp_path):
    sweep = write(tmp_path, edited("[solver]", "stiffness_factors = [1e5]\n[solver]").replace(', "none"', ""))
    planned = cli("plan", sweep).stdout
    assert re.search(r"^refused +6: beyond the stability limit; .*smaller dt", planned, re.MULTILINE)
    done = cli("run", sweep, "-o", tmp_path / "out.nc", code=1)  # all are refused: no kernel is needed
    assert done.stdout.startswith("0 of 6 scenarios usable: each ended with a status that says why")
    report = json.loads(cli("run", sweep, "-o", tmp_path / "out.nc", "--overwrite", "--json", code=1).stdout)
    assert (report["scenarios"]["usable"], report["failures"]) == (0, [])
    status = Status.BEYOND_STABILITY_LIMIT
    assert f"{status.label}  6: {status.meaning}; {status.remedy}" in re.sub(
        "  +", "  ", re.sub(r"\n +", " ", done.stdout)
    )
    assert re.search(r"^kelvin_voigt +high-low +- +- +- +0/0$", done.stdout, re.MULTILINE)


def test_a_chunk_that_fails_is_told_and_the_rest_is_kept(tiny, tmp_path, monkeypatch):
    folder, _ = tiny
    real = execute.run_chunk
    args = ("run", folder / "sweep.toml", "-o", tmp_path / "out.nc")
    with monkeypatch.context() as patch:
        fails = lambda task: real(task) if task.kernel.law.key == "none" else "on purpose"  # noqa: E731
        patch.setattr(execute, "run_chunk", fails)
        done = cli(*args, code=1)
    assert done.stderr.count("on purpose") == 1
    assert "pounding-sweep: warning: " in done.stderr
    assert f"{tmp_path / 'out.nc'}.parts" in done.stderr
    assert "not_run" in done.stdout
    assert done.stdout.splitlines()[-1] == str(tmp_path / "out.nc")
    cli(*args, "--overwrite")
    same_data(folder / "out.nc", tmp_path / "out.nc")
    assert not (tmp_path / "out.nc.parts").exists()


def test_an_unforeseen_error_exits_with_1(tiny, tmp_path, monkeypatch):
    monkeypatch.setattr(execute, "Results", lambda *_: 1 / 0)
    done = cli("run", tiny[0] / "sweep.toml", "-o", tmp_path / "o.nc", code=1)
    assert "pounding-sweep: failed: ZeroDivisionError: division by zero" in done.stderr
    assert "Traceback" in done.stderr
    assert done.stdout == ""


def test_all_errors_of_a_file_are_told_at_once_with_their_lines(tmp_path):
    """What they say of each fault is in golden/bad_sweeps.txt."""
    write(tmp_path, BAD)
    head, *lines = bad("plan", "sweep.toml", cwd=tmp_path).splitlines()
    assert head == f"sweep.toml: {len(lines)} problems"
    assert len(lines) > 25
    assert all(re.match(r"  sweep\.toml:\d+: [\w.\[\]]+: ", line) for line in lines)


WINDOWS = "in double quotes \\ begins an escape: write / in its place, or the text in single quotes"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            '"kelvin_voigt"',
            '"kelvin_void"',
            "sweep.toml:19: sweep.laws[0]: unknown contact law 'kelvin_void'; did you ",
        ),
        (None, r'records = ["C:\Users\me\new.AT2"]', WINDOWS),
        (None, r'records = ["D:\Records\x.AT2"]', WINDOWS),
        (None, 'records = ["g02.at2"]', "did you mean 'G02.AT2'?"),
        (None, 'records = ["./g02.at2"]', "did you mean 'G02.AT2'?"),
    ],
)
def test_messages_tell_line_and_remedy(tmp_path, old, new, message):
    (tmp_path / "G02.AT2").touch()
    records = next(line for line in TINY.splitlines() if line.startswith("records"))
    write(tmp_path, edited(old or records, new))
    assert message in bad("plan", "sweep.toml", cwd=tmp_path)


def test_bad_paths_and_options(tiny, tmp_path):
    sweep, out = tiny[0] / "sweep.toml", tmp_path / "out.nc"
    file = write(tmp_path, "", "file")
    for args, message in (
        (("run", "no_such.toml", "-o", "out.nc"), "no_such.toml: the sweep file can't be read"),
        (("run", sweep, "-o", file / "out.nc"), "is not a folder"),
        (("run", sweep, "-o", tmp_path / "gone" / "out.nc"), "is not a folder"),
        (("run", sweep, "-o", tmp_path), "is a folder"),
        (("run", sweep, "-o", out, "--scheduler", "thread"), "did you mean 'threads'?"),
        (("run", sweep, "-o", out, "--workers", 0), "at least 1"),
        (("info", tmp_path / "gone.nc"), "does not exist"),
        (("info", sweep), "can't be read as netCDF"),
        (("plot", tiny[0] / "out.nc", "force-gab", "-o", tmp_path / "x.png"), "did you mean 'force-gap'?"),
    ):
        assert message in bad(*args, cwd=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("args", ["", "rum", "run", "run x.toml -o x.nc --fast", "plan x --workers a"])
def test_wrong_usage(args):
    done = cli(*args.split(), code=2)
    assert "Traceback" not in done.stderr
    assert "Usage: pounding-sweep" in done.stdout + done.stderr


def cube():
    """Two laws, three gaps, two pairs, two storeys; the second storey of the second pair meets nothing."""
    force = np.zeros((2, 3, 2, 2))
    force[0, 0] = [[10.0, 40.0], [5.0, np.nan]]
    force[0, 1] = [[20.0, 30.0], [0.0, np.nan]]
    force[0, 2] = [[999.0, 0.0], [0.0, np.nan]]  # not ok
    force[1, :, 1, 1] = np.nan
    count = np.where(np.isnan(force), np.nan, np.ceil(force / 10))
    status = np.zeros((2, 3), np.int8)
    status[0, 2] = Status.UNDER_RESOLVED_CONTACT
    dims = ("law", "gap", "pair", "storey")
    data = {"impact_force_max": (dims, force), "impact_count": (dims, count), "status": (("law", "gap"), status)}
    return xr.Dataset(data, coords={"law": ["linear", "none"], "pair": ["a-b", "b-c"], "storey": [1, 2]})


@pytest.fixture
def summary(tmp_path):
    """What is reported of a cube, once it is written."""
    return lambda cube, part="summary": summarize(write_cube(cube, tmp_path / "cube.nc", overwrite=True))[part]


COLUMNS = ("law", "pair", "touching", "peak_force", "impacts_max", "impacts_median", "scenarios")


@pytest.mark.parametrize("size", [8, 10**6])
def test_summary_of_a_product_of_listed_cases_and_in_parts(summary, monkeypatch, size):
    monkeypatch.setattr("pounding_sweep.output.describe.SLAB_BYTES", size)
    rows = summary(cube())
    assert [tuple(row[name] for name in COLUMNS) for row in rows] == [
        ("linear", "a-b", 2, 40.0, 4, 3.5, 2),
        ("linear", "b-c", 1, 5.0, 1, 1.0, 2),
        ("none", "a-b", 0, 0.0, 0, None, 3),
        ("none", "b-c", 0, 0.0, 0, None, 3),
    ]
    cases = cube().stack(case=("law", "gap"), create_index=False).transpose("case", "pair", "storey")
    assert summary(cases) == rows
    statuses = summary(cube(), "statuses")
    assert [(item["label"], item["count"]) for item in statuses] == [("ok", 5), ("under_resolved_contact", 1)]
    assert statuses[1]["remedy"] == Status.UNDER_RESOLVED_CONTACT.remedy


README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_readme_example_runs(tmp_path):
    (code,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    done = cli(start=("-W", "error", "-c", code), cwd=tmp_path)
    assert done.stdout.splitlines()[-1] == "0 scenarios are not ok"
    assert done.stderr == ""
    assert (tmp_path / "two_buildings.nc").is_file()


def test_the_readme_names_pages_that_are_there_and_no_files_that_a_wheel_lacks():
    titles = {path.read_text("utf-8").partition("\n")[0].removeprefix("# ") for path in ROOT.glob("docs/*.md")}
    titles |= {
        json.loads(p.read_text("utf-8"))["cells"][0]["source"][0].strip("# \n") for p in ROOT.glob("docs/*.ipynb")
    }
    pages = re.findall(r"(?<!\*)\*([A-Z][^*]+)\*(?!\*)", README)
    assert len(pages) > 15
    assert {*pages} <= titles
    assert not re.search(r"`(docs|sweeps|pounding_sweep)/", README)


def test_the_readme_and_the_front_page_give_the_same_two_commands():
    main, tests, _ = re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
    assert f"```sh\n{main}{tests}```" in (ROOT / "docs/index.md").read_text("utf-8")
