"""Foundations that give way: a rigid base on springs and dashpots of sway and of rocking."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

from pounding_sweep.model.quantity import quantity

#: Unit of each property.
_UNITS = {
    "mass": "t",
    "inertia": "t m2",
    "sway_stiffness": "kN/m",
    "rocking_stiffness": "kN m/rad",
    "sway_damping": "kN s/m",
    "rocking_damping": "kN m s/rad",
}


@dataclass(frozen=True)
class Foundation:
    """A rigid foundation under a building, free to sway and to rock on the soil's springs and dashpots.

    Two degrees of freedom beside the building's floors: the base's displacement relative to the free field and its
    rotation. At a rotation theta a floor at elevation h moves by h theta with its base.

    Parameters
    ----------
    mass : float
        Mass (t) of the base.
    inertia : float
        Mass moment of inertia (t m2) of the base about its own centre, and of the floors about theirs: their masses at
        their elevations are not part of it.
    sway_stiffness : float
        Stiffness K_h (kN/m) of the soil against sway.
    rocking_stiffness : float
        Stiffness K_theta (kN m/rad) of the soil against rocking.
    sway_damping : float
        Coefficient c_h (kN s/m) of the soil's dashpot against sway, of its material and of radiation.
    rocking_damping : float
        Coefficient c_theta (kN m s/rad) of that against rocking.

    Raises
    ------
    SceneError
        A value is not a positive number, or a damping is negative.

    References
    ----------
    Veletsos & Meek (1974), Dynamic behaviour of building-foundation systems, Earthq. Eng. Struct. Dyn. 3, 121-138.
    Wolf (1985), Dynamic soil-structure interaction, Prentice-Hall.

    Examples
    --------
    >>> from pounding_sweep import Building
    >>> soft = Foundation(mass=100.0, inertia=800.0, sway_stiffness=4e5, rocking_stiffness=9e6)
    >>> firm, swaying = Building("a", [100.0], [1e5]), Building("a", [100.0], [1e5], foundation=soft)
    >>> round(float(firm.periods[0]), 3), round(float(swaying.periods[0]), 3)
    (0.199, 0.236)
    """

    mass: float
    inertia: float
    sway_stiffness: float
    rocking_stiffness: float
    sway_damping: float = 0.0
    rocking_damping: float = 0.0

    def __post_init__(self) -> None:
        for each in fields(self):
            name, value = each.name, getattr(self, each.name)
            given: dict[str, Any] = {"positive": not name.endswith("damping"), "why": _why(name, value)}
            object.__setattr__(self, name, quantity(value, f"foundation: {name}", _UNITS[name], **given))

    def scaled(self, mass: float, period: float) -> Foundation:
        """Return one of so many times the mass, and of so many times the periods."""
        powers = {"stiffness": 2, "damping": 1}
        factors = {each.name: mass / period ** powers.get(each.name.split("_")[-1], 0) for each in fields(self)}
        return Foundation(**{name: factor * getattr(self, name) for name, factor in factors.items()})

    @property
    def masses(self) -> tuple[float, float]:
        """Of sway and of rocking."""
        return self.mass, self.inertia

    @property
    def stiffnesses(self) -> tuple[float, float]:
        """Of sway and of rocking."""
        return self.sway_stiffness, self.rocking_stiffness

    @property
    def dashpots(self) -> tuple[float, float]:
        """Of sway and of rocking."""
        return self.sway_damping, self.rocking_damping


def _why(name: str, value: object) -> str:
    """Say why a base needs what it was given as nothing."""
    if value == 0 and name in ("mass", "inertia"):
        return ", as the base has its own equation of motion; give that of the foundation slab"
    if value == math.inf:
        return "; leave the foundation out where the base is fixed"
    if value == 0:
        return ", as nothing else holds the base"
    return ""
