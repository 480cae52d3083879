"""The classical fourth-order Runge-Kutta method of Kutta, with fewer operations for second-order systems.

With stage accelerations a1..a4,

    u' = u + h v + h^2/6 (a1 + a2 + a3)
    v' = v + h/6 (a1 + 2 a2 + 2 a3 + a4)
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pounding_sweep.schemes.explicit import Explicit


class Rk4(Explicit):
    """Classical Runge-Kutta."""

    name = "rk4"
    title = "classical fourth-order Runge-Kutta"
    source = "Hairer, Nørsett & Wanner 1993"
    order = 4
    min_steps_located = 1.5
    step_cost = 2.6
    ladder: tuple[float, ...] = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96)
    finest_float32: float = 64
    undamped_radius = 2.0 * math.sqrt(2.0)
    damped_radius = 2.615
    lengths = "hh = 0.5 * h; q = hh * hh; h2 = hh * h; h6 = h * SIXTH; h26 = h * h6"
    nodes = (("g0", "1.0"), ("gm", "2.0"), ("gm", "2.0"), ("g1", "1.0"))

    def phase_error(self, x: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        """Of the classical method."""
        return np.hypot(x**4 / 120.0, x**5 / 144.0)

    def after(self, stage: int, u: str, v: str, x: str, a: Sequence[str]) -> tuple[str, str]:
        """State that each stage leads to."""
        if stage == 1:
            return f"fma(hh, {v}, {u})", f"fma(hh, {a[0]}, {v})"
        if stage == 2:
            return f"fma(q, {a[0]}, {x})", f"fma(hh, {a[1]}, {v})"
        if stage == 3:
            return f"fma(h2, {a[1]}, fma(h, {v}, {u}))", f"fma(h, {a[2]}, {v})"
        return (
            f"fma(h26, {a[0]} + {a[1]} + {a[2]}, fma(h, {v}, {u}))",
            f"fma(h6, fma(2.0, {a[1]} + {a[2]}, {a[0]} + {a[3]}), {v})",
        )
