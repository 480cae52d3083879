"""What contacts cost beside another commit: ``python -m benchmarks.contacts COMMIT [--cases linear cold ...]``.

The paper's row at small gaps under El Centro, some 200 impacts a scenario: one law after another, storeys that yield, a
record of 5 ms, and ten buildings; `exact` at 1 ms and to an accuracy of 1e-3, usual outputs. Processor time of compiled
kernels alone, by turns. The last row is a process that runs one scenario, no kernel compiled. COMMIT may be a folder.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

#: Law, buildings, strength of a storey over its stiffness (m), points of the record for each point of El Centro.
CASES = {law: (law, 3, 0.0, 1) for law in ("linear", "kelvin_voigt", "hertz")}
CASES |= {"bilinear": ("kelvin_voigt", 3, 0.004, 1), "5 ms": ("kelvin_voigt", 3, 0.0, 4)}
CASES |= {"ten": ("kelvin_voigt", 10, 0.0, 1), "cold": ("kelvin_voigt", 3, 0.0, 1)}
SETTINGS: dict[str, dict[str, Any]] = {"1 ms": {"method": "exact", "dt": 1e-3}, "1e-3": {"accuracy": 1e-3}}
FACTORS, SCALES = [0.25, 0.5, 0.75, 1.0, 1.5, 2.0], [0.5, 1.0, 1.5, 2.0, 2.5]


def sweep_of(case: str, setting: str) -> Any:
    """Return the sweep of a case."""
    import numpy as np

    import pounding_sweep as ps

    law, many, drift, parts = CASES[case]
    base: Any = ps.get_preset("mate2015")
    row = [replace(base.row[i % 3], name=f"b{i}") for i in range(many)]
    if drift:
        row = [replace(b, yield_strengths=[drift * k for k in b.stiffnesses], hardening=0.05) for b in row]
    motion, scene = ps.find_record("el_centro"), ps.Scene(row, [0.01] * (many - 1), base.contact)
    at = np.arange((motion.n_points - 1) * parts + 1) / parts
    motion = ps.Record("motion", motion.dt / parts, np.interp(at, np.arange(motion.n_points), motion.acceleration))
    gaps = [5e-4 * (2 + i) for i in range({"cold": 1, "ten": 4}.get(case, 20))]
    axes: dict[str, Any] = {} if case == "cold" else {"stiffness_factors": FACTORS, "scales": SCALES}
    return ps.Sweep(scene, motion, law, gaps=gaps, **axes, audit=0.0, **SETTINGS[setting])


def serve() -> None:
    """Run sweeps that standard input names, one a line; print numbers of scenarios, and seconds of their kernels."""
    from pounding_sweep.engine import compile

    module: Any = compile
    seconds, get_kernel = [0.0], module.get_kernel

    def run(kernel: Any, *arguments: Any) -> None:
        started = time.thread_time()
        kernel(*arguments)
        seconds[0] += time.thread_time() - started

    module.get_kernel, sweep = (lambda shape: partial(run, get_kernel(shape))), cache(sweep_of)
    for line in sys.stdin:
        job, seconds[0] = sweep(*line.strip().split("|")), 0.0
        print(job.run(scheduler="synchronous")["status"].size, seconds[0], flush=True)


def compare(folders: list[str], cases: list[str], rounds: int) -> None:
    """Print the table of the versions in two folders."""
    command, states = [sys.executable, __file__, "serve"], [{**os.environ, "PYTHONPATH": each} for each in folders]
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    servers: list[Any] = [subprocess.Popen(command, env=state, **pipes) for state in states]
    print("| what | setting | scenarios | before (ms) | after (ms) | ratio |\n|---|---|---|---|---|---|")

    def measure(which: int, case: str, setting: str) -> tuple[str, float]:
        if case == "cold":
            with tempfile.TemporaryDirectory() as kernels:
                before = os.times().children_user
                state = {**states[which], "POUNDING_SWEEP_CACHE": kernels}
                subprocess.run(command, env=state, input=f"{case}|{setting}".encode(), check=True, capture_output=True)
                return "1", os.times().children_user - before
        print(f"{case}|{setting}", file=servers[which].stdin, flush=True)
        count, taken = servers[which].stdout.readline().split()
        return count, float(taken)

    for case, setting in [(case, setting) for case in cases for setting in SETTINGS]:
        pairs = []
        for turn in range(rounds + 1):
            found = {which: measure(which, case, setting) for which in (turn % 2, 1 - turn % 2)}
            pairs.append((found[0][1], found[1][1]))
        before, after = (1e3 * min(column) for column in zip(*pairs[1:], strict=True))
        ratio = statistics.median(new / old for old, new in pairs[1:])
        print(f"| {case} | {setting} | {found[0][0]} | {before:.1f} | {after:.1f} | {ratio:.3f} |", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.contacts", description=__doc__)
    parser.add_argument("commit", help="to compare with, or a folder with its files")
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES), help="all where none are named")
    parser.add_argument("--rounds", type=int, default=9, help="turns that count")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if not Path(before := arguments.commit).is_dir():
            files = subprocess.run(["git", "archive", before], check=True, capture_output=True).stdout
            subprocess.run(["tar", "-x", "-C", before := folder], check=True, input=files)
        compare([before, str(Path(__file__).parents[1])], arguments.cases, arguments.rounds)


if __name__ == "__main__":
    serve() if sys.argv[1:] == ["serve"] else main()
