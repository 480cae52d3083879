"""Where two neighbours face each other: slabs that are level, and slabs that stand before columns.

The slab of a floor reaches from the floor's elevation down by its depth. Two slabs are level where they overlap in
elevation, or miss each other by no more than a tolerance. A slab that is level with none stands before the columns of
the storey that its middle lies in, at the fraction xi of the storey's height.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pounding_sweep.base.errors import SceneError

#: Floors of neighbours meet where their slabs miss each other by no more than this (m), where nothing else is said.
FLOOR_TOLERANCE = 1.0e-3
#: Elevations (m) and slab depths (m) of the floors of a building, bottom first.
Slabs = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Facing:
    """A floor of one neighbour (from 0) before the columns of a storey (from 0) of the other, at the fraction xi."""

    floor: int
    storey: int
    xi: float


def level_floors(left: Slabs, right: Slabs, tolerance: float) -> list[tuple[int, int]]:
    """Return the floors, counted from 0, of two neighbours that are level, bottom first."""
    (z, d), (y, e) = left, right
    over, under = z[:, None] - y[None, :], y[None, :] - z[:, None]
    meets = (over <= tolerance + d[:, None]) & (under <= tolerance + e[None, :])
    return [(int(s), int(t)) for s, t in np.argwhere(meets)]


def facing_columns(slabs: Slabs, other: Slabs, level: Sequence[int]) -> list[Facing]:
    """Return the floors of a building, those that are `level` with one left out, that stand before columns."""
    found, levels = [], np.concatenate([[0.0], other[0]])
    for s, middle in enumerate(slabs[0] - 0.5 * slabs[1]):
        storey = int(np.searchsorted(levels, middle)) - 1
        if s not in level and storey < len(other[0]):
            below, above = levels[storey], levels[storey + 1]
            found.append(Facing(s, storey, float((middle - below) / (above - below))))
    return found


def column_shares(xi: float) -> tuple[float, float]:
    """Shares 1 - 3 xi^2 + 2 xi^3 and 3 xi^2 - 2 xi^3 of the floors below and above of a push on a column at xi."""
    # the column is fixed at both ends against rotation; the same shares give the displacement of the struck point by
    # those of the floors
    if not 0.0 <= xi <= 1.0:
        raise SceneError(f"a column is struck at the fraction xi = {xi!r} of its height; it must be in [0, 1]")
    upper = xi * xi * (3.0 - 2.0 * xi)
    return 1.0 - upper, upper


def column_softness(xi: float) -> float:
    """Deflection of a struck column (fixed at both ends, its floors held) times its 12 E I / L^3, for a unit force."""
    return 4.0 * (xi * (1.0 - xi)) ** 3
