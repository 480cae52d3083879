"""Memory that this process may still take: of the machine, of its control groups, under its own limits."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import psutil

#: Limit and use of a control group, and what of its use is given back on demand; version 2, version 1.
_GROUP_FILES = (
    ("", "memory.max", "memory.current", "inactive_file"),
    ("memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
)


@dataclass(frozen=True)
class FreeMemory:
    """Memory that can be had, and what keeps it from being more: the machine, or a limit of process or group."""

    bytes: int
    limit: str


def free_memory(root: Path = Path("/")) -> FreeMemory:
    """Return the memory that this process can still have without swapping."""
    used = psutil.Process().memory_info()
    limits = [FreeMemory(psutil.virtual_memory().available, "the machine"), *_control_groups(root)]
    for kind, size, name in (
        (resource.RLIMIT_AS, used.vms, "limit on address space, ulimit -v"),
        (resource.RLIMIT_DATA, getattr(used, "data", 0), "limit on data, ulimit -d"),
    ):
        if (limit := resource.getrlimit(kind)[0]) != resource.RLIM_INFINITY:
            limits.append(FreeMemory(max(0, limit - size), name))
    return min(limits, key=lambda one: one.bytes)


def _control_groups(root: Path) -> Iterator[FreeMemory]:
    """Yield what is left in each control group that holds this process."""
    groups: dict[str, str] = {}
    with suppress(OSError):
        for line in (root / "proc/self/cgroup").read_text().splitlines():
            _, controllers, path = line.split(":", 2)
            groups.update(dict.fromkeys(controllers.split(","), path))
    for controller, limit, used, cached in _GROUP_FILES:
        top = root / "sys/fs/cgroup" / controller
        group = top / groups.get(controller, "").lstrip("/")
        for folder in (group, *group.parents):
            with suppress(OSError, ValueError):  # there is none, it can't be seen from here, or its limit is "max"
                free = int((folder / limit).read_text()) - int((folder / used).read_text())
                stat = dict(line.split() for line in (folder / "memory.stat").read_text().splitlines())
                yield FreeMemory(max(0, free + int(stat.get(cached, 0))), f"limit of the control group {folder}")
            if folder == top:
                break
