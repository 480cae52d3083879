"""Rules that say how far apart buildings must stand, from the displacements of each alone.

All of them take the largest absolute displacements u of the two floors that could meet, relative to the ground, by the
linear run of each building alone under the record itself. Standards find theirs from forces divided by a behaviour
factor and multiply them by it again; what is taken here was never divided, so that the factors are 1 unless the user
gives others (an amplification of displacements by yielding, say, or displacements that were reduced).

Adding a rule is adding one `SeparationRule` to `SEPARATION_RULES`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from pounding_sweep.base.errors import InputError

#: What is said of every clause of a standard.
FROM_MEMORY = "stated from memory of the standard; the standard was not consulted"


@dataclass(frozen=True)
class BehaviourFactors:
    """Factors by which standards turn reduced displacements into real ones, and what they divide by.

    Each is one number for all buildings, or a mapping of building name to number. All are 1 by default, because the
    displacements that the rules take come from linear runs under the record itself and were reduced by nothing.

    Attributes
    ----------
    cd : float or mapping
        Deflection amplification Cd of ASCE 7.
    importance : float or mapping
        Importance factor Ie of ASCE 7, a divisor.
    q : float or mapping
        Displacement behaviour factor q of Eurocode 8.
    r : float or mapping
        Response reduction factor R of IS 1893.
    """

    cd: float | Mapping[str, float] = 1.0
    importance: float | Mapping[str, float] = 1.0
    q: float | Mapping[str, float] = 1.0
    r: float | Mapping[str, float] = 1.0

    def of(self, factor: str, building: str) -> float:
        """Return a factor of a building.

        Raises
        ------
        InputError
            It is not given for that building, or is no positive number.
        """
        given = getattr(self, factor)
        if isinstance(given, Mapping) and building not in given:
            raise InputError(
                f"factor {factor!r} is given for {', '.join(given) or 'no building'}, but not for {building!r}"
            )
        value = float(given[building] if isinstance(given, Mapping) else given)
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"factor {factor!r} of building {building!r} is {value!r}; it must be a positive number")
        return value

    def text(self, factor: str) -> str:
        """Return a factor in words."""
        given = getattr(self, factor)
        return ", ".join(f"{k}: {v:g}" for k, v in given.items()) if isinstance(given, Mapping) else f"{given:g}"


@dataclass(frozen=True)
class Neighbours:
    """What a rule is given of two floors that could meet; arrays share their dimensions."""

    left: xr.DataArray  # largest absolute displacements (m); 0 for a wall, which moves with the ground
    right: xr.DataArray
    correlation: xr.DataArray  # correlation of the two responses, see `cqc_correlation`; 0 at a wall
    level: xr.DataArray  # two buildings, every floor of the lower of which is level with one of the other
    factors: Mapping[str, Sequence[xr.DataArray]]  # behaviour factors of both sides


@dataclass(frozen=True)
class SeparationRule:
    """A rule for the distance between two buildings."""

    key: str  # name in tables
    title: str  # the rule in words
    formula: str  # of the displacements u1 and u2 (m)
    clause: str  # where it is from
    edition: str
    note: str  # what else is to be said of it
    gap: Callable[[Neighbours], xr.DataArray]  # `Neighbours` -> needed gap (m)


def cqc_correlation(
    period_1: xr.DataArray, period_2: xr.DataArray, damping_1: xr.DataArray, damping_2: xr.DataArray
) -> xr.DataArray:
    """Correlation of the responses of two oscillators to broad-band ground motion."""
    r = period_2 / period_1
    product = damping_1 * damping_2
    top = 8.0 * product**0.5 * (damping_2 + damping_1 * r) * r**1.5
    bottom = (1.0 - r**2) ** 2 + 4.0 * product * r * (1.0 + r**2) + 4.0 * (damping_1**2 + damping_2**2) * r**2
    same = bottom == 0.0  # undamped, equal periods
    return (top + same) / (bottom + same)


def _root_of_squares(one: xr.DataArray, other: xr.DataArray) -> xr.DataArray:
    return (one**2 + other**2) ** 0.5


def _asce7(ends: Neighbours) -> xr.DataArray:
    (cd_1, cd_2), (importance_1, importance_2) = ends.factors["cd"], ends.factors["importance"]
    return _root_of_squares(ends.left * cd_1 / importance_1, ends.right * cd_2 / importance_2)


#: All rules by key.
SEPARATION_RULES: dict[str, SeparationRule] = {
    rule.key: rule
    for rule in (
        SeparationRule(
            "abs",
            "sum of the largest displacements",
            "u1 + u2",
            "-",
            "-",
            "an upper bound: both displacements at once, towards each other",
            lambda ends: ends.left + ends.right,
        ),
        SeparationRule(
            "srss",
            "square root of the sum of squares",
            "sqrt(u1^2 + u2^2)",
            "-",
            "-",
            "for responses that are not correlated",
            lambda ends: _root_of_squares(ends.left, ends.right),
        ),
        SeparationRule(
            "double_difference",
            "double-difference combination",
            "sqrt(u1^2 + u2^2 - 2 rho u1 u2)",
            "Jeng, Kasai & Maison, Earthquake Spectra 8(2), 201-223",
            "1992",
            "rho by Der Kiureghian (1980), from the first periods and damping ratios",
            lambda ends: (
                (ends.left**2 + ends.right**2 - 2.0 * ends.correlation * ends.left * ends.right).clip(min=0.0) ** 0.5
            ),
        ),
        SeparationRule(
            "asce7",
            "ASCE/SEI 7, structural separation",
            "sqrt(dM1^2 + dM2^2), dM = Cd u / Ie",
            "12.12.3",
            "ASCE/SEI 7-16, 7-22",
            FROM_MEMORY,
            _asce7,
        ),
        SeparationRule(
            "ec8",
            "Eurocode 8, seismic joint condition, buildings of one owner",
            "sqrt((q1 u1)^2 + (q2 u2)^2), times 0.7 where all floors are level",
            "4.4.2.7",
            "EN 1998-1:2004",
            FROM_MEMORY,
            lambda ends: (
                _root_of_squares(ends.left * ends.factors["q"][0], ends.right * ends.factors["q"][1])
                * (1.0 - 0.3 * ends.level)
            ),
        ),
        SeparationRule(
            "is1893",
            "IS 1893, separation between adjacent units",
            "R1 u1 + R2 u2, halved where all floors are level",
            "7.11.3",
            "IS 1893 (Part 1):2016",
            FROM_MEMORY,
            lambda ends: (
                (ends.left * ends.factors["r"][0] + ends.right * ends.factors["r"][1]) * (1.0 - 0.5 * ends.level)
            ),
        ),
    )
}
