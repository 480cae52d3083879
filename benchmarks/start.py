"""How long a user waits before anything happens: new processes, timed from outside."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.timing import medians

#: What is started, by name; the first is the bare interpreter.
COMMANDS = {
    "python": ("-c", "pass"),
    "import": ("-c", "import pounding_sweep"),
    "--help": ("-m", "pounding_sweep", "--help"),
}


def start_seconds(rounds: int = 5) -> dict[str, float]:
    """Median wall time (s) of starting each of `COMMANDS`, in turns."""

    def job(arguments: tuple[str, ...]) -> None:
        subprocess.run([sys.executable, *arguments], check=True, capture_output=True)

    jobs = [lambda arguments=arguments: job(arguments) for arguments in COMMANDS.values()]
    for one in jobs:  # byte code written, files in the page cache
        one()
    return dict(zip(COMMANDS, medians(*jobs, rounds=rounds, clock=time.perf_counter), strict=True))


def first_run_ratio(rounds: int = 3) -> float:
    """Wall time of the main job's first run, no kernel compiled before, over that of its file with rk4 at 1 ms."""
    text = Path("sweeps/quickstart.toml").read_text(encoding="utf-8")
    named = re.sub("^accuracy = .*$", 'method = "rk4"\ndt = 1e-3', text, flags=re.MULTILINE)

    def job(content: str) -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "sweep.toml"
            path.write_text(content, encoding="utf-8")
            command = sys.executable, "-m", "pounding_sweep", "run", path, "-o", path.with_suffix(".nc"), "--quiet"
            state = {**os.environ, "POUNDING_SWEEP_CACHE": f"{folder}/kernels"}
            subprocess.run(command, check=True, capture_output=True, env=state)

    first, second = medians(lambda: job(text), lambda: job(named), rounds=rounds, clock=time.perf_counter)
    return first / second
