"""Exact flight between contacts (Nigam & Jennings 1969), series or Runge-Kutta beside them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pounding_sweep.kernel.group import BENDS, Group
from pounding_sweep.kernel.types import Index, Lanes
from pounding_sweep.lanes import fma
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import coupled_modes, variants_of
from pounding_sweep.schemes.base import SAFETY
from pounding_sweep.schemes.explicit import Explicit, Rk4

#: Largest share of a motion that may be lost between floors and modes, by number format.
MAX_MODE_ERROR = {"float64": 1e-5, "float32": 1e-4}
#: By what errors of contacts fall at least where long steps are halved.
LEAST_FALL = 7.6


#: Butcher's six stages of fifth order: what each takes of the accelerations before it, the last row that of the end.
STAGES = (
    (),
    (1 / 4,),
    (1 / 8, 1 / 8),
    (0, -1 / 2, 1),
    (3 / 16, 0, 0, 9 / 16),
    (-3 / 7, 2 / 7, 12 / 7, -12 / 7, 8 / 7),
    (7 / 90, 0, 32 / 90, 12 / 90, 32 / 90, 7 / 90),
)
#: The same of displacements, which velocities of the stages lead to.
TWICE = tuple(
    tuple(sum(row[k] * STAGES[k][j] for k in range(j + 1, len(row))) for j in range(len(row) - 1)) for row in STAGES
)
#: The same of the acceleration at the end, to third order.
LAST = (4 / 45, 0, -16 / 45, 24 / 45, -16 / 45, 49 / 45)
#: What the powers of the time in a quintic, from the third on, have of what the acceleration at the start leaves
#: of displacement, velocity and acceleration at the end.
_HERMITE = ((10.0, -4.0, 0.5), (-15.0, 7.0, -1.0), (6.0, -3.0, 0.5))
#: The same of these powers, as shares of the accelerations.
QUINTIC = tuple(
    tuple(
        math.fsum(
            part * (row[k] - start * (k == 0))
            for part, row, start in zip(parts, ((*TWICE[-1], 0.0), STAGES[-1], LAST), (0.5, 1.0, 1.0), strict=True)
        )
        for k in range(6)
    )
    for parts in _HERMITE
)


class Exact(Explicit):
    """Exact flight; a step with contact is a series, or one of six stages."""

    name = "exact"
    title = "exact flight between contacts, Taylor series beside them or, where forces are roots, Butcher's six stages"
    source = "Nigam & Jennings 1969, Butcher 1964"
    undamped_radius, damped_radius = 0.85, 1.25  # from a damping ratio of 1e-3 on; sub-steps of the stages keep to them
    nodes = tuple((sum(row), 6.0 * weight) for row, weight in zip(STAGES, STAGES[-1], strict=False))
    order = 4  # of contacts, whose forces begin with a root
    phase = ((5, 5760.0), (6, 5040.0))
    min_steps_located = 1.5
    flies_exactly = True
    follows_flow = True  # by series or stages alone: its plastic drifts flow all along
    step_cost = 0.4
    ladder = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0)
    finest_float32 = 2.0

    @property
    def leeway(self) -> float:
        """By the least fall of contacts' errors, whose forces begin with a root."""
        return (LEAST_FALL - 1.0) / SAFETY

    def stability_limit(self, w2: np.ndarray, rate: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        """By the radii of `Rk4`: sub-steps of the stages are as short as theirs ask anyhow, series have none."""
        return Rk4().stability_limit(w2, rate, beta, gamma)

    def after(self, stage: int, u: Lanes, v: Lanes, x: Lanes, a: Sequence[Lanes], h: Lanes) -> tuple[Lanes, Lanes]:
        """State that each stage leads to."""
        moved, sped = _mean(TWICE[stage], a), _mean(STAGES[stage], a)
        start = fma(h if stage == len(self.nodes) else h * self.nodes[stage][0], v, u)
        return start if moved is None else fma(h * h, moved, start), fma(h, sped, v)

    def keep(self, group: Group, i: Index, a: Sequence[Lanes]) -> None:
        """Keep the quintic of a floor's motion through displacement, velocity and acceleration at both ends."""
        super().keep(group, i, a)
        for name, shares in zip(BENDS, QUINTIC, strict=True) if group.spec.staged else ():
            group.state[name, i] = _mean(shares, a)

    def refuses(self, scene: Scene, precision: str = "float64") -> str | None:
        """Rows whose modes are too near to each other for the number format."""
        why = super().refuses(scene, precision)
        if why is not None or scene.has_classical_modes or not all(spring.law.flies for spring in scene.springs):
            return why
        error = coupled_modes(variants_of(scene), precision).error[0]
        if error <= MAX_MODE_ERROR[precision]:
            return None
        return f"flies in modes, and those of this row's dashpots and links lose {error:.1g} of a motion in {precision}"


def _mean(shares: Sequence[float], a: Sequence[Lanes]) -> Lanes:
    """Sum of accelerations by their shares; None of none."""
    total: Lanes = None
    for share, acceleration in zip(shares, a, strict=False):
        if share:
            total = share * acceleration if total is None else fma(share, acceleration, total)
    return total
