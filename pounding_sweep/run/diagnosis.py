"""What this installation runs on: versions, processor, free memory and kernel cache."""

from __future__ import annotations

import os
import platform
import re
import resource
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any, NamedTuple

from pounding_sweep.base.errors import SweepError
from pounding_sweep.base.text import bytes_text

#: Name of the distribution.
NAME = "pounding-sweep"
#: Its extras that users install; the others are for its development.
EXTRAS = ("records", "export")
#: Register width (bits) by the processor feature that brings it, widest first.
_WIDTHS = {"avx512f": 512, "avx": 256, "sse2": 128, "neon": 128}
#: Variables of the environment that limit the threads of the libraries below.
THREAD_LIMITS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def diagnose() -> dict[str, Any]:
    """Look at the installation; changes nothing."""
    from pounding_sweep.engine.compile import CACHE_VARIABLE, cache_folder, compiling_seconds
    from pounding_sweep.engine.row_kernel import Numerics, kernel_shape
    from pounding_sweep.model.laws import LAWS
    from pounding_sweep.model.presets import get_preset
    from pounding_sweep.variables.registry import DEFAULT_OUTPUTS, VARIABLES, reducers_for

    versions, memory, cpu = installed_versions(), free_memory(), processor()
    optional = {name: extra for name, extra in _required().items() if extra}
    problems = [
        f"{name} is not installed; install the package: pip install ."
        for name, installed in versions.items()
        if installed is None and name not in optional
    ]
    kernels = cache_folder()
    parent = next((path for path in (kernels, *kernels.parents) if path.exists()), Path())
    if not (parent.is_dir() and os.access(parent, os.W_OK)):
        problems.append(
            f"the kernel cache {str(kernels)!r} can't be written, so every run compiles its kernels anew; name another "
            f"folder in {CACHE_VARIABLE}"
        )
    files = [path for path in kernels.rglob("pounding_kernel_*") if path.is_file()]
    row, law, numerics = get_preset("mate2015"), LAWS["linear"], Numerics("rk4", 1e-3)
    return {
        "versions": versions,
        "optional": optional,
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "processor": cpu,
        "threads": {
            "workers": cpu["cores_usable"],
            "environment": {name: os.environ[name] for name in THREAD_LIMITS if name in os.environ},
        },
        "memory": {"free_bytes": memory.bytes, "limit": memory.limit},
        "kernel_cache": {
            "folder": str(kernels),
            "kernels": sum(path.suffix == ".o" for path in files),
            "bytes": sum(path.stat().st_size for path in files),
        },
        # CPU time for a kernel of the paper's row, by what is asked for
        "compile_seconds": {
            name: compiling_seconds([kernel_shape(row, law, numerics, reducers_for(outputs))])
            for name, outputs in (("default", DEFAULT_OUTPUTS), ("all", VARIABLES))
        },
        "problems": problems,
    }


@cache
def installed_versions() -> dict[str, str | None]:
    """Return the versions of Python, the package and what it uses; None where that is not installed."""
    from pounding_sweep.output.identity import LIBRARIES

    required = _required()
    needed = sorted({*LIBRARIES, *(name for name, extra in required.items() if not extra)}, key=str.lower)
    versions: dict[str, str | None] = {"python": platform.python_version()}
    for name in (NAME, *needed, *required):
        versions[name] = None
        with suppress(PackageNotFoundError):
            versions[name] = version(name)
    return versions


def _required() -> dict[str, str]:
    """Return the distributions that the installed package requires: name -> extra that does, or ""."""
    lines: list[str] = []
    with suppress(PackageNotFoundError):
        lines = sorted(requires(NAME) or [])
    pattern = r"([\w.-]+)(?:.*extra == ['\"](\w+))?"
    required = [match.groups("") for line in lines if (match := re.match(pattern, line))]
    # the last one counts, which is that without an extra
    return {name: extra for extra in (*EXTRAS, "") for name, by in required if by == extra}


@cache
def processor() -> dict[str, Any]:
    """Return name, features, vector width (bits) and cores of the processor."""
    from llvmlite import binding

    from pounding_sweep.kernel.spec import LANES

    features = sorted(name for name, present in binding.get_host_cpu_features().items() if present)
    return {
        "name": binding.get_host_cpu_name(),
        "vector_bits": next((bits for name, bits in _WIDTHS.items() if name in features), None),
        "lanes_per_kernel": LANES,
        "cores_usable": len(os.sched_getaffinity(0)),
        "cores": os.cpu_count(),
        "features": features,
    }


class FreeMemory(NamedTuple):
    """Memory that can be had, and what keeps it from being more: the machine, or a limit of process or group."""

    bytes: int
    limit: str


def free_memory(root: Path = Path("/")) -> FreeMemory:
    """Return the memory that this process can still have without swapping."""
    import psutil

    used = psutil.Process().memory_info()
    limits = [FreeMemory(psutil.virtual_memory().available, "the machine")]
    for kind, size, name in (
        (resource.RLIMIT_AS, used.vms, "limit on address space, ulimit -v"),
        (resource.RLIMIT_DATA, getattr(used, "data", 0), "limit on data, ulimit -d"),
    ):
        if (limit := resource.getrlimit(kind)[0]) != resource.RLIM_INFINITY:
            limits.append(FreeMemory(max(0, limit - size), name))
    groups: dict[str, str] = {}
    with suppress(OSError):
        for line in (root / "proc/self/cgroup").read_text().splitlines():
            _, controllers, path = line.split(":", 2)
            groups.update(dict.fromkeys(controllers.split(","), path))
    # limit and use of a control group, and what of its use is given back on demand; version 2, version 1
    for controller, most, use, cached in (
        ("", "memory.max", "memory.current", "inactive_file"),
        ("memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
    ):
        top = root / "sys/fs/cgroup" / controller
        group = top / groups.get(controller, "").lstrip("/")
        for folder in [path for path in (group, *group.parents) if path.is_relative_to(top)]:
            with suppress(OSError, ValueError):  # there is none, it can't be seen from here, or its limit is "max"
                free = int((folder / most).read_text()) - int((folder / use).read_text())
                stat = dict(line.split() for line in (folder / "memory.stat").read_text().splitlines())
                free = max(0, free + int(stat.get(cached, 0)))
                limits.append(FreeMemory(free, f"limit of the control group {folder}"))
    return min(limits)


def check_memory(scenarios: int, bytes_of_one: int, what: str, remedy: str) -> None:
    """Raise `SweepError` where `scenarios` times `bytes_of_one` are more than this process may still take."""
    free = free_memory()
    if scenarios * bytes_of_one > free.bytes:
        raise SweepError(
            f"{what} {scenarios:,} scenarios needs about {bytes_text(scenarios * bytes_of_one)} of memory, "
            f"{bytes_text(free.bytes)} are free ({free.limit}); {remedy}, make several sweeps of it, "
            "or go where more is free"
        )
