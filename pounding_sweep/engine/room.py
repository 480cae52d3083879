"""Memory that kernels work in."""

from __future__ import annotations

import numpy as np

#: Bytes that the processor fetches at once, and of its widest vectors.
LINE = 64


def aligned(numbers: int, precision: str) -> np.ndarray:
    """Return room for numbers, none of whose vectors lies across two lines of the processor's cache."""
    room = np.empty(numbers + LINE, precision)
    first = -room.ctypes.data % LINE // room.itemsize
    return room[first : first + numbers]
