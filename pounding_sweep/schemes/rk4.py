"""The classical fourth-order Runge-Kutta method of Kutta, with fewer operations for second-order systems.

With stage accelerations a1..a4,

    u' = u + h v + h^2/6 (a1 + a2 + a3)
    v' = v + h/6 (a1 + 2 a2 + 2 a3 + a4)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from pounding_sweep.kernel.lanes import fma
from pounding_sweep.schemes.explicit import Explicit


class Rk4(Explicit):
    """Classical Runge-Kutta."""

    name = "rk4"
    title = "classical fourth-order Runge-Kutta"
    source = "Hairer, Nørsett & Wanner 1993"
    order = 4
    follows_smooth = True
    min_steps_located = 1.5
    min_ground_steps = 1.0
    step_cost = 2.6
    ladder = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96)
    finest_float32 = 64
    undamped_radius = 2.0 * math.sqrt(2.0)
    damped_radius = 2.615
    nodes = ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0))

    def phase_error(self, x: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        """Of the classical method."""
        return np.hypot(x**4 / 120.0, x**5 / 144.0)

    def after(self, stage: int, u: Any, v: Any, x: Any, a: Sequence[Any], h: Any) -> tuple[Any, Any]:
        """State that each stage leads to."""
        half = 0.5 * h
        if stage == 1:
            return fma(half, v, u), fma(half, a[0], v)
        if stage == 2:
            return fma(half * half, a[0], x), fma(half, a[1], v)
        if stage == 3:
            return fma(half * h, a[1], fma(h, v, u)), fma(h, a[2], v)
        sixth = h * (1.0 / 6.0)
        return fma(h * sixth, a[0] + a[1] + a[2], fma(h, v, u)), fma(sixth, fma(2.0, a[1] + a[2], a[0] + a[3]), v)
