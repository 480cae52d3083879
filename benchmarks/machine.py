"""What was measured on, and with what."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Iterable
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from benchmarks.c_kernel import find_compiler
from benchmarks.peers import Peer

#: Instruction sets that decide how wide vectors are.
SETS = ("avx512f", "avx2", "fma", "avx", "sse2", "asimd", "sve")
#: Libraries whose versions matter to the engine.
LIBRARIES = ("pounding-sweep", "numba", "llvmlite", "numpy", "xarray", "netCDF4", "dask")


def describe(peers: Iterable[Peer] = ()) -> dict[str, str]:
    """Return machine, versions and date, by what they are."""
    known: dict[str, str] = {}
    cpu = Path("/proc/cpuinfo")
    if cpu.exists():
        for line in cpu.read_text(encoding="utf-8").splitlines():
            name, _, value = line.partition(":")
            known.setdefault(name.strip(), value.strip())
    flags = set((known.get("flags") or known.get("Features") or "").split())
    found = {
        "processor": known.get("model name") or platform.processor() or platform.machine(),
        "vector instructions": " ".join(name for name in SETS if name in flags) or "unknown",
        "cores in use": str(len(os.sched_getaffinity(0))),
        "system": f"{platform.system()} {platform.machine()}",
        "Python": platform.python_version(),
    }
    if compiler := find_compiler():
        done = subprocess.run([compiler, "--version"], check=False, capture_output=True, text=True)
        found["C compiler"] = done.stdout.partition("\n")[0]
    for name in (*LIBRARIES, *dict.fromkeys(peer.package for peer in peers)):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    found["date"] = date.today().isoformat()
    return found
