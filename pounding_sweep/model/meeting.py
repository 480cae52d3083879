"""Which floors of neighbours meet, and where floors strike columns.

Units kN, t, m, s.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from pounding_sweep.base.errors import SceneError
from pounding_sweep.model.building import Building

#: Floors of neighbours meet where their slabs miss each other by no more than this (m), where nothing else is said.
FLOOR_TOLERANCE = 1.0e-3
#: What of neighbours can meet: level floors, or beside them floors and the columns that they stand before.
CONTACTS = ("floors", "floors and columns")


@dataclass(frozen=True)
class Contact:
    """Two floors that can meet, or a floor and columns of its neighbour."""

    pair: int  # index of the pair of neighbours
    #: label (1 at the bottom) in results: the left building's, or the right one's where the left neighbour is a wall;
    #: of columns, that of the floor that strikes them
    storey: int
    #: degrees of freedom of floors, numbered building by building; -1 for a wall; of columns, the floor above them
    left: int
    right: int
    mass: float = math.nan  # effective mass (t), see `effective_mass`
    place: int = 0  # index of its label along ``pair`` in results, see `Scene.pair_labels`
    struck: int = -1  # side whose columns are struck, 0 the left, 1 the right; -1 where floors meet
    xi: float = 1.0  # height of the struck point above the storey's lower floor, over the storey's height
    below: int = -1  # degree of freedom of that lower floor; -1 for the ground
    restrainer: Any = None  # that holds the floors; None where they meet
    tension: bool = False  # whether that holds them as they move apart, not together

    @property
    def ends(self) -> tuple[tuple[int, float], ...]:
        """Floors that it acts on, walls and the ground left out, and the share of each in the penetration."""
        ends: list[tuple[int, float]] = []
        way = -1.0 if self.tension else 1.0
        for side, floor, sign in ((0, self.left, way), (1, self.right, -way)):
            if side == self.struck:
                lower, upper = column_shares(self.xi)
                ends += [(self.below, sign * lower)] if self.below >= 0 else []
                ends.append((floor, sign * upper))
            elif floor >= 0:
                ends.append((floor, sign))
        return tuple(ends)

    @property
    def slack(self) -> float:
        """How far floors move (m) until a restrainer holds them; NaN where they meet, by the gap of the pair."""
        return (
            math.nan
            if self.restrainer is None
            else (self.restrainer.closing_slack, self.restrainer.slack)[self.tension]
        )


class Contacts(tuple[Contact, ...]):
    """All contacts of a scene, and which of `CONTACTS` was asked for."""

    kind: str = CONTACTS[0]


class Facing(NamedTuple):
    """A floor of one neighbour (from 0) before the columns of a storey (from 0) of the other, at the fraction xi."""

    floor: int
    storey: int
    xi: float


def meetings(left: Building, right: Building, tolerance: float) -> tuple[list[tuple[int, int]], list[list[Facing]]]:
    """Return the floors (from 0) of neighbours that are level, and of both those that stand before columns."""
    (z, d), (y, e) = ((item.levels, np.array(item.slab_depths or 0.0)) for item in (left, right))
    over = z[:, None] - y[None, :]
    level = np.argwhere((over <= tolerance + d.reshape(-1, 1)) & (-over <= tolerance + e.reshape(1, -1)))
    facing: list[list[Facing]] = []
    for side, middles, elevations, base in (
        (0, z - 0.5 * d, y, right.base_elevation),
        (1, y - 0.5 * e, z, left.base_elevation),
    ):
        levels = np.append(base, elevations)
        storeys = np.searchsorted(levels, middles) - 1
        floors = np.setdiff1d(np.flatnonzero((storeys >= 0) & (storeys < len(elevations))), level[:, side])
        below = storeys[floors]
        xi = (middles[floors] - levels[below]) / np.diff(levels)[below]
        facing.append(list(map(Facing, floors.tolist(), below.tolist(), xi.tolist())))
    return [(s, t) for s, t in level.tolist()], facing


def contacts_of(
    pair: int, name: str, neighbours: Sequence[Any], starts: Sequence[int], tolerance: float, *, columns: bool
) -> list[tuple[str, list[Contact]]]:
    """Return what of a pair of neighbours can meet, by label, bottom first; who is no building is a wall."""
    (left, right), (i, j) = neighbours, starts
    if not isinstance(right, Building):
        return [(name, [Contact(pair, s + 1, i + s, -1) for s in range(left.n_storeys)])]
    if not isinstance(left, Building):
        return [(name, [Contact(pair, s + 1, -1, j + s) for s in range(right.n_storeys)])]
    level, faced = meetings(left, right, tolerance)
    for item, met in zip(neighbours, zip(*level, strict=True), strict=False):
        if len(set(met)) < len(met):
            floor = max(met, key=met.count)
            raise SceneError(
                f"floor {floor + 1} of {item.name!r} is level with {met.count(floor)} floors of its neighbour; "
                "give smaller slab_depths or a smaller tolerance, so that it meets one"
            )
    groups = [(name, [Contact(pair, s + 1, i + s, j + t) for s, t in level])]
    for side, facing in enumerate(faced if columns else ()):
        struck = []
        for f in facing:
            floor, above = starts[side] + f.floor, starts[1 - side] + f.storey
            below = above - 1 if f.storey else -1
            first, second = (floor, above)[:: 1 - 2 * side]
            struck.append(Contact(pair, f.floor + 1, first, second, struck=1 - side, xi=f.xi, below=below))
        groups.append((f"{name} columns of {(right, left)[side].name}", struck))
    return groups


def column_shares(xi: float) -> tuple[float, float]:
    """Shares 1 - 3 xi^2 + 2 xi^3 and 3 xi^2 - 2 xi^3 of the floors below and above of a push on a column at xi."""
    # it is fixed at both ends against rotation; the same shares give the displacement of the struck point
    upper = xi * xi * (3.0 - 2.0 * xi)
    return 1.0 - upper, upper


def effective_mass(ends: Iterable[tuple[int, float]], masses: Any) -> Any:
    """Return the effective mass (t) of floors that meet, of their shares in the penetration and the masses of all."""
    return reduce(lambda a, b: a * b / (a + b), (masses[floor] / share**2 for floor, share in ends if share))


def column_softness(xi: float) -> float:
    """Deflection of a struck column (fixed at both ends, its floors held) times its 12 E I / L^3, for a unit force."""
    return 4.0 * (xi * (1.0 - xi)) ** 3
