"""Damage at which HDF5 never ends: a heap of texts and references with an object that takes no room.

HDF5 2.0 and before walk from object to object by their sizes, and stand still at one of
size 0, so that a cube with a blank sector in the wrong place would hang whoever opens it.
"""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from pathlib import Path

#: Bytes at the beginning and at the end of a file that are looked through: labels and attributes stand there.
LOOKED_AT = 2**26

_SIGNATURE = b"GCOL\x01\x00\x00\x00"
_HEADER = 16


def has_endless_heap(path: Path) -> bool:
    """Whether a global heap (HDF5 File Format Specification, III.E) of a file leads nowhere.

    Parameters
    ----------
    path : Path
        Any file that is not empty.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        return any(not _ends(data, at) for at in _heaps(data))


def _heaps(data: mmap.mmap) -> Iterator[int]:
    parts = [(0, len(data))] if len(data) <= 2 * LOOKED_AT else [(0, LOOKED_AT), (len(data) - LOOKED_AT, len(data))]
    for start, stop in parts:
        at = data.find(_SIGNATURE, start, stop)
        while at >= 0:
            yield at
            at = data.find(_SIGNATURE, at + 1, stop)


def _ends(data: mmap.mmap, at: int) -> bool:
    """Walk through a heap as HDF5 does; False where an object takes no room, or more than there is."""
    end = min(at + int.from_bytes(data[at + 8 : at + 16], "little"), len(data))
    here = at + _HEADER
    while here + _HEADER <= end:
        index = int.from_bytes(data[here : here + 2], "little")
        size = int.from_bytes(data[here + 8 : here + 16], "little")
        taken = _HEADER + (size + 7) // 8 * 8 if index else size  # object 0 is the room that is left, header and all
        if not _HEADER <= taken <= end - here:
            return False
        here += taken
    return True
