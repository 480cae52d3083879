"""Central differences, in the form of velocity Verlet, as explicit pounding codes use them.

With the acceleration a1 at the start and a2 at the end, where the dampers see the predicted velocity v + h a1,

    u' = u + h v + h^2/2 a1
    v' = v + h/2 (a1 + a2)

Of the step of an oscillator with x = omega h and y = c h / m, the trace is 2 - x^2 - y + x^2 y/4 + y^2/2 and the
determinant 1 - y + y^2/2 - x^2 y/4, so that it is stable where y <= 2 and x^2 <= 4 - 2 y + y^2: undamped to x = 2,
and whatever y to the least of that, x^2 = 3 at y = 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from pounding_sweep.kernel.lanes import fma
from pounding_sweep.schemes.explicit import Explicit


class CentralDifference(Explicit):
    """Explicit and of second order: half the work of a Runge-Kutta step, and no energy of its own without dampers."""

    name = "central_difference"
    title = "explicit central differences (velocity Verlet), dampers by a predicted velocity"
    source = "Newmark 1959 (beta = 0); Swope et al. 1982"
    order = 2
    min_ground_steps = 8.0
    min_steps_located = 1.5
    step_cost = 1.6
    undamped_radius = 2.0
    damped_radius = math.sqrt(3.0)
    nodes = ((0.0, 3.0), (1.0, 3.0))

    def phase_error(self, x: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        """Of free vibration, whose size is kept."""
        return x * x / 24.0

    def after(self, stage: int, u: Any, v: Any, x: Any, a: Sequence[Any], h: Any) -> tuple[Any, Any]:
        """State that each stage leads to."""
        half = 0.5 * h
        if stage == 1:
            return fma(half * h, a[0], fma(h, v, u)), fma(h, a[0], v)
        return x, fma(half, a[0] + a[1], v)
