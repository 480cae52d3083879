"""The sweep of a million scenarios, run from the command line in a process of its own."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from pounding_sweep.run.sweep import load_sweep

SWEEP = Path(__file__).parents[1] / "sweeps" / "million.toml"


@dataclass(frozen=True)
class Run:
    """What one run from the command line took."""

    scenarios: int  # scenarios asked for
    seconds: float  # wall time (s) from start to exit, the cube written
    peak_bytes: int  # largest resident memory of the process
    cube_bytes: int  # size of the file


def _watch(process: subprocess.Popen[bytes]) -> int:
    """Wait for a process; return its peak resident memory (bytes)."""
    # what the system says of an ended child counts the memory of this process too, which it had before it became
    # another
    peak = 0
    while process.poll() is None:
        try:
            lines = Path(f"/proc/{process.pid}/status").read_text(encoding="utf-8").splitlines()
            peak = max([peak, *(1024 * int(line.split()[1]) for line in lines if line.startswith("VmHWM"))])
        except OSError:  # it has just ended
            pass
        time.sleep(0.02)
    return peak


def run_file(path: Path = SWEEP) -> Run:
    """Run a sweep file by ``pounding-sweep run``; kernels that are on disk already are loaded."""
    with tempfile.TemporaryDirectory() as folder:
        cube = Path(folder) / "cube.nc"
        command = [sys.executable, "-m", "pounding_sweep", "run", str(path), "-o", str(cube), "--quiet"]
        with tempfile.TemporaryFile("w+") as messages:
            started = time.perf_counter()
            process = subprocess.Popen(command, stdout=messages, stderr=messages)
            peak = _watch(process)
            seconds = time.perf_counter() - started
            messages.seek(0)
            if process.returncode:
                raise RuntimeError(f"{' '.join(command)} failed: {messages.read()}")
        return Run(load_sweep(path).spec.n_scenarios, seconds, peak, cube.stat().st_size)
