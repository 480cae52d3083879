"""Memory that this process may still take: of the machine, of its control groups, under its own limits."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

#: Files of a control group by the type of its file system: limits, what is used, and the part of ``memory.stat``
#: that is given back when it is needed. Above ``memory.high`` a group is slowed until it hardly moves.
_GROUP_FILES = {
    "cgroup2": (("memory.max", "memory.high"), "memory.current", "inactive_file"),
    "cgroup": (("memory.limit_in_bytes",), "memory.usage_in_bytes", "total_inactive_file"),
}

#: Limits of a process as ``/proc/self/limits`` names them, what is counted in ``/proc/self/status``, and the name.
_PROCESS_LIMITS = (
    ("Max address space", "VmSize:", "limit on address space, ulimit -v"),
    ("Max data size", "VmData:", "limit on data, ulimit -d"),
)


@dataclass(frozen=True)
class FreeMemory:
    """Memory that can be had, and what keeps it from being more: the machine, or a limit of process or group."""

    bytes: int
    limit: str


def free_memory(root: Path = Path("/")) -> FreeMemory | None:
    """Return the memory that this process can still have without swapping."""
    found = [*_machine(root), *_control_groups(root), *_process_limits(root)]
    return min(found, key=lambda one: one.bytes, default=None)


def _machine(root: Path) -> Iterator[FreeMemory]:
    available = _number(root / "proc/meminfo", "MemAvailable:")
    if available is None:
        with suppress(ValueError, OSError):
            available = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if available is not None:
        yield FreeMemory(available, "the machine")


def _control_groups(root: Path) -> Iterator[FreeMemory]:
    """Yield what is left in each control group that holds this process."""
    own = {}  # list of controllers -> the group; of version 2, which has all in one tree, the list is empty
    for line in _lines(root / "proc/self/cgroup"):
        controllers, _, path = line.partition(":")[2].partition(":")
        own.update(dict.fromkeys(controllers.split(","), PurePosixPath(path)))
    for line in _lines(root / "proc/self/mountinfo"):
        place, _, rest = line.partition(" - ")
        kind, _, options = rest.partition(" ")
        if kind not in _GROUP_FILES or (kind == "cgroup" and "memory" not in options.split(" ")[-1].split(",")):
            continue
        mine = own.get("memory" if kind == "cgroup" else "")
        if mine is None:
            continue
        top, mount = (PurePosixPath(part) for part in place.split(" ")[3:5])
        # in a container the group may be the mounted one, or one outside of what can be seen
        seen = mine.is_relative_to(top) and ".." not in mine.parts
        inside = mine.relative_to(top) if seen else PurePosixPath()
        for group in (inside, *inside.parents):
            yield from _group(root / mount.relative_to("/") / group, *_GROUP_FILES[kind])


def _group(folder: Path, limits: tuple[str, ...], used: str, cached: str) -> Iterator[FreeMemory]:
    most = [int(text) for name in limits for text in _lines(folder / name) if text.isdecimal()]  # or "max"
    taken = next((int(text) for text in _lines(folder / used) if text.isdecimal()), None) if most else None
    if taken is not None:
        taken -= _number(folder / "memory.stat", cached) or 0
        yield FreeMemory(max(0, min(most) - taken), f"limit of the control group {folder}")


def _process_limits(root: Path) -> Iterator[FreeMemory]:
    for line in _lines(root / "proc/self/limits"):
        for name, counted, text in _PROCESS_LIMITS:
            most = line.removeprefix(name).split()[:1] if line.startswith(name) else []
            used = _number(root / "proc/self/status", counted) if most and most[0].isdecimal() else None  # "unlimited"
            if used is not None:
                yield FreeMemory(max(0, int(most[0]) - used), text)


def _number(path: Path, name: str) -> int | None:
    """Read the whole number of a line that begins with a name; one in kB as bytes."""
    for line in _lines(path):
        if line.startswith(name):
            own, number, *unit = [*line.split(), "", ""][:3]
            if own == name and number.isdecimal():
                return int(number) * (1024 if unit == ["kB"] else 1)
    return None


def _lines(path: Path) -> list[str]:
    """Read a file of the kernel; nothing where there is none."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
