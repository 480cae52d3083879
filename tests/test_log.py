"""What a run leaves in writing: the log beside the cube, and lines where there is no terminal."""

from __future__ import annotations

import io
import os
import re
import signal
import warnings
from datetime import datetime

import numpy as np
import pytest
from scenes import AXES, motions, row
from test_cli import TINY, cli, write

from pounding_sweep.cube.assemble import package_version
from pounding_sweep.progress import BETWEEN_LINES, LineProgress
from pounding_sweep.sweep import execute
from pounding_sweep.sweep.execute import Progress
from pounding_sweep.sweep.log_file import RunLog
from pounding_sweep.sweep.sweep import Sweep, load_sweep


def make(**changes):
    return Sweep(**{"scene": row(), "records": motions(), **AXES, "title": "Row", **changes})


def lines(path):
    """The lines of a log without their times, which are checked."""
    found = [line.split(" ", 1) for line in path.read_text(encoding="utf-8").splitlines()]
    times = [datetime.fromisoformat(stamp) for stamp, _ in found]
    assert times == sorted(times)
    assert all(time.tzinfo is not None for time in times)
    return [text for _, text in found]


def test_a_log_of_the_command_line(tmp_path):
    sweep = write(tmp_path, TINY)
    done = cli("run", sweep, "-o", "out.nc", cwd=tmp_path)
    assert done.stderr == ""
    told = lines(tmp_path / "out.nc.log")
    assert re.fullmatch(rf"begins: \S+ run {re.escape(str(sweep))} -o out\.nc", told[0])
    assert re.fullmatch(rf"process \d+ on \S+, in {re.escape(str(tmp_path))}", told[1])
    assert told[2] == f"sweep {load_sweep(sweep).plan().digest} Tiny"
    assert f"pounding-sweep {package_version()}" in told[4]
    assert f"numpy {np.__version__}," in told[4]
    assert told[5].startswith("machine: ")
    assert told[5].endswith(f"scheduler threads, {len(os.sched_getaffinity(0))} workers")
    stages = [line.split()[1] for line in told if re.match(r"stage .* ends: ", line)]
    assert stages == ["kernels", "no", "scenarios", "audit", "cube"]
    assert re.search(r"stage cube ends: 12 done in \d+\.\d{3} s", "\n".join(told))
    size = (tmp_path / "out.nc").stat().st_size
    assert told[-2].startswith(
        "result: 5 scenarios run, 0 kept from an interrupted run, 2 never touch, 0 chunks failed"
    )
    assert told[-2].endswith(f"{tmp_path / 'out.nc'} has {size} bytes")
    assert re.fullmatch(r"ended after \d+\.\d s", told[-1])


def test_runs_stand_one_after_another_and_tell_how_they_ended(tmp_path, monkeypatch):
    out, log = tmp_path / "out.nc", tmp_path / "out.nc.log"

    class Stop(Progress):
        def stage(self, name, total):
            if name == "audit":
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make().run(out, progress=Stop())
    assert lines(log)[-1].startswith("interrupted after ")
    with monkeypatch.context() as patch:
        patch.setattr(execute, "untouched", lambda plan, closing: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            make().run(out)
    assert re.fullmatch(r"failed after \d+\.\d s: ZeroDivisionError: division by zero", lines(log)[-1])
    before = lines(log)
    make().run(out).close()
    assert lines(log)[: len(before)] == before
    assert lines(log)[-1].startswith("ended after ")
    assert sum(line.startswith("begins: ") for line in lines(log)) == 3


def test_a_run_that_may_not_begin_leaves_no_log(tmp_path):
    (tmp_path / "out.nc").write_text("precious")
    with pytest.raises(OSError, match="exists"):
        make().run(tmp_path / "out.nc")
    assert [path.name for path in tmp_path.iterdir()] == ["out.nc"]


def test_a_sweep_in_memory_has_no_log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    make().run()
    assert list(tmp_path.iterdir()) == []


def test_warnings_are_told_once_each_and_passed_on(tmp_path):
    shown = warnings.showwarning
    texts = ["mind the gap", "mind the gap", "mind the\nstep"]
    with warnings.catch_warnings(record=True) as caught, RunLog(tmp_path / "log", Progress()):
        warnings.simplefilter("always")
        for text in texts:
            warnings.warn(text, UserWarning, stacklevel=1)
    assert [str(w.message) for w in caught] == texts
    assert lines(tmp_path / "log")[:-1] == ["warning: mind the gap", "warning: mind the step"]
    assert warnings.showwarning is shown


def test_chunks_that_fail_are_in_the_log(tmp_path, monkeypatch):
    monkeypatch.setattr(execute, "run_chunk", lambda kernel, *more: "on purpose")
    with pytest.warns(RuntimeWarning, match="on purpose"):
        make().run(tmp_path / "out.nc", scheduler="synchronous").close()
    told = "\n".join(lines(tmp_path / "out.nc.log"))
    assert re.search(r"warning: \d+ chunks have no result \(status not_run\): on purpose", told)
    assert re.search(r"result: 0 scenarios run, .* [1-9]\d* chunks failed", told)


def hangs(*arguments):
    pytest.fail("the log waits")


@pytest.mark.parametrize("kind", [os.mkdir, os.mkfifo, lambda path: os.symlink("/dev/null", path)])
def test_a_log_that_cannot_be_written_stops_nothing(tmp_path, kind):
    kind(tmp_path / "out.nc.log")
    before = signal.signal(signal.SIGALRM, hangs)
    signal.setitimer(signal.ITIMER_REAL, 60.0, 1.0)  # a pipe is opened when somebody reads it
    try:
        with pytest.warns(RuntimeWarning, match=r"log' can't be written \(not a regular file\); .*goes on") as caught:
            make().run(tmp_path / "out.nc").close()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert len(caught) == 1


# -- lines -------------------------------------------------------------------------------------------------------------


def test_lines_come_now_and_then_and_are_plain():
    stream, now = io.StringIO(), [0.0]
    progress = LineProgress(stream, lambda: now[0])
    progress.stage("no pounding", 4)
    progress.advance(4)
    progress.stage("scenarios", 10000)
    for _ in range(5):
        now[0] += 0.4 * BETWEEN_LINES
        progress.advance(1000)
    progress.stage("something else", 0)
    now[0] += BETWEEN_LINES
    progress.advance(3)
    progress.close()
    assert stream.getvalue().splitlines() == [
        "scenarios 3,000 of 10,000 (30%), about 84 s left",
        "something else 3",
    ]


def test_lines_have_no_control_characters(monkeypatch):
    """A whole run with a line at every step."""
    monkeypatch.setattr("pounding_sweep.progress.BETWEEN_LINES", 0.0)
    stream = io.StringIO()
    make().run(progress=LineProgress(stream))
    said = stream.getvalue()
    assert re.search(r"^cube 180 of 180 \(100%\), about 0 s left$", said, re.MULTILINE)
    assert said.replace("\n", "").isprintable()


def test_a_reader_that_has_gone_does_not_end_the_run():
    theirs, ours = os.pipe()
    os.close(theirs)
    with os.fdopen(ours, "w") as stream:
        progress = LineProgress(stream, iter(range(0, 1000, 100)).__next__)
        progress.stage("scenarios", 2)
        progress.advance(1)
        progress.advance(1)
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
