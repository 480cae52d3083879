"""Numbers with a unit that are zero or above, as scenes are made of."""

from __future__ import annotations

import math
import numbers
from typing import Any

from pounding_sweep.base.errors import SceneError, shown


def quantity(value: Any, what: str, unit: str, *, positive: bool = False, why: str = "") -> float:
    """Return a finite number, zero or above, or `positive`; raise `SceneError` for anything else."""
    real = isinstance(value, numbers.Real) and not isinstance(value, bool)
    if not (real and value < math.inf and (value > 0 if positive else value >= 0)):
        must = "a positive number" if positive else "zero or a positive number"
        msg = f"{what} is {shown(value)} {unit}; it must be {must}{why}"
        raise SceneError(msg)
    return float(value)
