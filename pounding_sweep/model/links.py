"""Links between neighbours' floors: springs and dashpots that pull as well as push."""

from __future__ import annotations

import numbers
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pounding_sweep.base.errors import SceneError, shown
from pounding_sweep.model.quantity import quantity

#: Unit of each property.
UNITS = {"stiffness": "kN/m", "damping": "kN s/m"}


@dataclass(frozen=True)
class Link:
    """Springs and dashpots between floors of two neighbours, alike at all the storeys that are named.

    A link's force is stiffness * d + damping * d', d being the displacement of its left floor less that of its
    right one; it acts on both, whatever its sign.

    Parameters
    ----------
    pair : str
        Name of the pair of neighbours, ``"left-right"``.
    storeys : sequence of int or (int, int)
        Storeys of the floors that are linked, 1 at the bottom: one number where it is the same in both buildings,
        otherwise the left building's and the right one's.
    stiffness : float
        Of each link (kN/m).
    damping : float
        Coefficient of each link's dashpot (kN s/m).

    Raises
    ------
    SceneError
        A value is negative, both are zero, or storeys are no whole numbers.

    Examples
    --------
    >>> Link("a-b", [1, (2, 3)], damping=500.0).floors
    ((1, 1), (2, 3))
    """

    pair: str
    storeys: Sequence[int | Sequence[int]]
    stiffness: float = 0.0
    damping: float = 0.0

    def __post_init__(self) -> None:
        for what, unit in UNITS.items():
            object.__setattr__(self, what, quantity(getattr(self, what), f"link: {what}", unit))
        if not (self.stiffness or self.damping):
            raise SceneError(
                f"link of pair {shown(self.pair)}: stiffness and damping are zero; give one of them, or leave it out"
            )
        object.__setattr__(self, "storeys", _storeys(self.storeys))

    @property
    def floors(self) -> tuple[tuple[int, int], ...]:
        """Storeys of the left and of the right building, link by link."""
        both = ((each, each) if isinstance(each, int) else each for each in self.storeys)
        return tuple((left, right) for left, right in both)


@dataclass(frozen=True)
class LinkedFloors:
    """One link of a scene."""

    #: index of the pair of neighbours, and the storey of its left floor
    pair: int
    storey: int
    #: degrees of freedom
    left: int
    right: int
    #: kN/m and kN s/m
    stiffness: float
    damping: float
    place: int  # index of its label along ``pair`` in results


def _storeys(given: Sequence[int | Sequence[int]]) -> tuple[int | tuple[int, int], ...]:
    """Check the storeys of a link."""

    def whole(x: object) -> bool:
        return isinstance(x, numbers.Integral) and not isinstance(x, bool)

    found: list[int | tuple[int, int]] = []
    for each in given if isinstance(given, Iterable) and not isinstance(given, str) else ():
        if whole(each):
            found.append(int(each))  # type: ignore[arg-type]
        elif isinstance(each, Sequence | np.ndarray) and len(each) == 2 and all(map(whole, each)):
            found.append((int(each[0]), int(each[1])))
        else:
            found.clear()
            break
    if not found:
        raise SceneError(
            f"link: storeys are {shown(given)}; give a list of whole numbers, or of two, the left and the right storey"
        )
    return tuple(found)
