"""Numbers that scenes are made of: with a unit, zero or above; fractions."""

from __future__ import annotations

import math
import numbers
from typing import Any

from pounding_sweep.base.errors import SceneError, shown


def quantity(value: Any, what: str, unit: str, *, positive: bool = False, why: str = "") -> float:
    """Return a finite number, zero or above, or `positive`; raise `SceneError` for anything else."""
    try:
        found = float(value) if isinstance(value, numbers.Real) and not isinstance(value, bool) else math.nan
    except OverflowError:  # a whole number beyond all others
        found = math.inf
    if not (found < math.inf and (found > 0 if positive else found >= 0)):
        must = "a positive number" if positive else "zero or a positive number"
        raise SceneError(f"{what} is {shown(value)} {unit}; it must be {must}{why}")
    return found


def fraction(value: Any, what: str) -> float:
    """Return a number in [0, 1); raise `SceneError` for anything else."""
    real = isinstance(value, numbers.Real) and not isinstance(value, bool)
    if not (real and 0 <= value < 1):
        raise SceneError(f"{what} is {shown(value)}; it must be in [0, 1)")
    return float(value)
