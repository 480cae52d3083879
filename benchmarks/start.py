"""How long a user waits before anything happens: new processes, timed from outside."""

from __future__ import annotations

import subprocess
import sys
import time

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
