"""The sweep of a million scenarios, run from the command line in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from pounding_sweep.sweep.sweep import load_sweep

SWEEP = Path(__file__).parents[1] / "sweeps" / "million.toml"


@dataclass(frozen=True)
class Run:
    """What one run from the command line took.

    Attributes
    ----------
    scenarios : int
        Scenarios asked for.
    seconds : float
        Wall time (s) from start to exit, the cube written.
    peak_bytes : int
        Largest resident memory of the process.
    cube_bytes : int
        Size of the file.
    """

    scenarios: int
    seconds: float
    peak_bytes: int
    cube_bytes: int


def run_file(path: Path = SWEEP) -> Run:
    """Run a sweep file by ``pounding-sweep run``; kernels that are on disk already are loaded.

    Raises
    ------
    RuntimeError
        The command failed; the message is what it printed.
    """
    with tempfile.TemporaryDirectory() as folder:
        cube = Path(folder) / "cube.nc"
        command = [sys.executable, "-m", "pounding_sweep", "run", str(path), "-o", str(cube), "--quiet"]
        with tempfile.TemporaryFile("w+") as messages:
            started = time.perf_counter()
            process = subprocess.Popen(command, stdout=messages, stderr=messages)
            _, status, used = os.wait4(process.pid, 0)
            seconds = time.perf_counter() - started
            process.returncode = os.waitstatus_to_exitcode(status)
            messages.seek(0)
            if process.returncode:
                msg = f"{' '.join(command)} failed: {messages.read()}"
                raise RuntimeError(msg)
        return Run(load_sweep(path).spec.n_scenarios, seconds, used.ru_maxrss * 1024, cube.stat().st_size)
