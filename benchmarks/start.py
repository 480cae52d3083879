"""How long a user waits before anything happens: new processes, timed from outside."""

from __future__ import annotations

import json
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
#: Libraries that only a run may load.
HEAVY = ("numba", "dask", "distributed", "matplotlib", "scipy", "xarray", "pandas", "netCDF4")


def start_seconds(rounds: int = 5) -> dict[str, float]:
    """Median wall time (s) of starting each of `COMMANDS`, in turns."""

    def job(arguments: tuple[str, ...]) -> None:
        subprocess.run([sys.executable, *arguments], check=True, capture_output=True)

    jobs = [lambda arguments=arguments: job(arguments) for arguments in COMMANDS.values()]
    for one in jobs:  # byte code written, files in the page cache
        one()
    return dict(zip(COMMANDS, medians(*jobs, rounds=rounds, clock=time.perf_counter), strict=True))


def loaded_by(statement: str) -> list[str]:
    """Return those of `HEAVY` that are loaded once a statement has run in a new process."""
    code = f"import json, sys\n{statement}\nprint(json.dumps([n for n in {HEAVY!r} if n in sys.modules]))"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    found: list[str] = json.loads(done.stdout.splitlines()[-1])
    return found
