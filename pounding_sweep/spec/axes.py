"""What varies in a sweep: evenly spaced values, building properties, listed cases."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Literal

#: Factor by name of the building, in the order of the row.
Factors = tuple[tuple[str, float], ...]
#: Factors on a building's properties, by the argument that gives them.
FACTOR_KINDS = {"period_factors": "period_factor", "mass_factors": "mass_factor"}


@dataclass(frozen=True)
class Range:
    """Evenly spaced values of an axis, expanded only once the sweep's size is known.

    Values are rounded to 12 significant digits (of the larger end, where the
    spacing is linear), so that 0.002 to 0.024 in 12 values holds 0.006 itself;
    the ends are exact.

    Parameters
    ----------
    start, stop : float
        First and last value, in the axis' unit.
    count : int
        Number of values, >= 1.
    spacing : {"linear", "log"}
        Equal differences or equal ratios.

    Examples
    --------
    >>> Range(0.0, 0.3, 4).values()
    (0.0, 0.1, 0.2, 0.3)
    """

    start: float
    stop: float
    count: int
    spacing: Literal["linear", "log"] = "linear"

    def __len__(self) -> int:
        return self.count

    def values(self) -> tuple[float, ...]:
        """Return the values, ``count`` of them."""
        first, last, steps = float(self.start), float(self.stop), self.count - 1
        if not steps:
            return (first,)
        if self.spacing == "log":
            inner = [float(f"{first * (last / first) ** (i / steps):.12g}") for i in range(1, steps)]
        else:
            largest = max(abs(first), abs(last))
            digits = 12 - math.ceil(math.log10(largest)) if largest else 12
            inner = [round(first + (last - first) * (i / steps), digits) + 0.0 for i in range(1, steps)]
        return (first, *inner, last)


@dataclass(frozen=True)
class PropertyAxis:
    """An axis over a property of the buildings.

    Attributes
    ----------
    kind : {"period_factor", "mass_factor", "damping_ratio"}
        What it varies.
    building : str or None
        Name of the building; None: all of them.
    values : tuple of float
        Values, as the user gave them.
    dimension : str
        Name of the dimension in the cube: letters, digits and "_".
    """

    kind: str
    building: str | None
    values: tuple[float, ...]
    dimension: str

    @property
    def key(self) -> str:
        """Name of the axis as a sweep file has it."""
        return "damping_ratios" if self.building is None else f"building.{self.building}.{self.kind}"


def property_axes(
    factors: Mapping[str, tuple[tuple[str, tuple[float, ...]], ...]], damping_ratios: tuple[float, ...] | None
) -> tuple[PropertyAxis, ...]:
    """Return the axes over building properties, in the order of the cube."""
    found: dict[str, PropertyAxis] = {}
    for kind, listed in factors.items():
        for building, values in listed:
            dimension = plain_name(f"{kind}_{building}", found)
            found[dimension] = PropertyAxis(kind, building, values, dimension)
    if damping_ratios is not None:
        found["damping_ratio"] = PropertyAxis("damping_ratio", None, damping_ratios, "damping_ratio")
    return tuple(found.values())


def plain_name(text: str, taken: Collection[str]) -> str:
    """Return a name for a cube, letters, digits and "_" only, that is not taken."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", text)
    same = sum(re.fullmatch(rf"{plain}(_no\d+)?", name) is not None for name in taken)
    return f"{plain}_no{same + 1}" if same else plain


@dataclass(frozen=True)
class Case:
    """One listed scenario of a sweep that is no product of axes.

    Parameters
    ----------
    law : str
        Contact law.
    gap : float or tuple of float, optional
        Gap of every pair, or one per pair (m); the scene's own where not given.
    stiffness : float, optional
        Contact stiffness (kN/m**exponent of the law).
    stiffness_factor : float, optional
        Factor on the scene's reference stiffness instead; 1 where neither is given.
    restitution : float, optional
        Coefficient of restitution; the scene's where not given.
    record : str, optional
        Name of one of the sweep's records; needed where it has more than one.
    scale : float
        Factor on the record.
    period_factors, mass_factors : mapping of str to float
        Factors on all periods and on all masses of buildings, by name; 1 for those not named.
    damping_ratio : float, optional
        Damping ratio of all buildings; their own where not given.
    """

    law: str
    gap: float | tuple[float, ...] | None = None
    stiffness: float | None = None
    stiffness_factor: float | None = None
    restitution: float | None = None
    record: str | None = None
    scale: float = 1.0
    period_factors: Factors | Mapping[str, float] = ()
    mass_factors: Factors | Mapping[str, float] = ()
    damping_ratio: float | None = None
