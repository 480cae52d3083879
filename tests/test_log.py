"""What a run leaves in writing: the log beside the cube."""

from __future__ import annotations

import os
import re
import warnings
from contextlib import ExitStack
from datetime import datetime

import numpy as np
import pytest
from scenes import make
from test_cli import TINY, cli, write
from test_limits import At, stop

from pounding_sweep.output.dataset import package_version
from pounding_sweep.run import execute
from pounding_sweep.run.execute import Progress
from pounding_sweep.run.folder import run_log
from pounding_sweep.run.sweep import load_sweep

pytestmark = pytest.mark.usefixtures("stub_module")


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
    assert {*done.stderr.splitlines()} <= {"compiling kernels, once for sweeps of this kind"}
    told = lines(tmp_path / "out.nc.log")
    assert re.fullmatch(rf"begins: \S+ run {re.escape(str(sweep))} -o out\.nc", told[0])
    assert re.fullmatch(rf"process \d+ on \S+, in {re.escape(str(tmp_path))}", told[1])
    assert told[2] == f"sweep {load_sweep(sweep).plan().digest} Tiny"
    assert f"pounding-sweep {package_version()}" in told[4]
    assert f"numpy {np.__version__}," in told[4]
    assert told[5].startswith("machine: ")
    assert told[5].endswith(f"scheduler threads, {len(os.sched_getaffinity(0))} workers")
    stages = [line.split()[1] for line in told if re.match(r"stage .* ends: ", line)]
    assert stages[0] in ("kernels", "compiling")
    assert [stage for stage in stages[1:] if stage != "compiling"] == ["no", "scenarios", "audit", "cube"]
    assert re.search(r"stage cube ends: 12 done in \d+\.\d{3} s", "\n".join(told))
    size = (tmp_path / "out.nc").stat().st_size
    assert told[-2].startswith(
        "result: 5 scenarios run, 0 kept from an interrupted run, 2 never touch, 0 chunks failed"
    )
    assert told[-2].endswith(f"{tmp_path / 'out.nc'} has {size} bytes")
    assert re.fullmatch(r"ended after \d+\.\d s", told[-1])


def test_runs_stand_one_after_another_and_tell_how_they_ended(tmp_path, monkeypatch):
    out, log = tmp_path / "out.nc", tmp_path / "out.nc.log"

    with pytest.raises(KeyboardInterrupt):
        make().run(out, progress=At("audit", stop))
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


def test_a_run_in_memory_or_that_may_not_begin_leaves_no_log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    make().run()
    (tmp_path / "out.nc").write_text("precious")
    with pytest.raises(OSError, match="exists"):
        make().run(tmp_path / "out.nc")
    assert [path.name for path in tmp_path.iterdir()] == ["out.nc"]


def test_warnings_are_in_the_logs_of_runs_that_overlap(tmp_path):
    """The first to begin ends first, as runs of two threads may: each log tells those of its time, once each."""
    shown, plan = [], make().plan()
    with warnings.catch_warnings(), ExitStack() as first, ExitStack() as second:
        warnings.simplefilter("always")
        warnings.showwarning = lambda message, *args, **kwargs: shown.append(str(message))
        first.enter_context(run_log(tmp_path / "first", Progress(), plan))
        for text in ("one", "two", "two", "three", "four"):
            if len(shown) == 1:
                second.enter_context(run_log(tmp_path / "second", Progress(), plan))
            if text == "three":
                first.close()
            if text == "four":
                second.close()
            warnings.warn(text, UserWarning, stacklevel=1)
    assert shown == ["one", "two", "two", "three", "four"]
    assert lines(tmp_path / "first")[6:-1] == ["warning: one", "warning: two"]
    assert lines(tmp_path / "second")[6:-1] == ["warning: two", "warning: three"]


def test_a_log_that_cannot_be_written_stops_nothing(tmp_path):
    (tmp_path / "out.nc.log").mkdir()
    with pytest.warns(RuntimeWarning, match=r"log' can't be written \(Is a directory\); .*goes on") as caught:
        make().run(tmp_path / "out.nc").close()
    assert len(caught) == 1
