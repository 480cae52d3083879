"""Bilinear storeys with kinematic hardening.

    V = r k d + (1 - r) k (d - p),    |d - p| <= dy

d is the drift, p its plastic part, r the hardening and dy the yield drift. While a storey is elastic (phase 0) p stands
still; while it yields (phase 1 or -1) p follows the drift at the distance dy, until it turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import Any, Literal

import numpy as np

from pounding_sweep.lanes import size, where
from pounding_sweep.model.faults import checked
from pounding_sweep.model.storeys.base import DriftGauge, Shares, StoreyLaw


@checked
class BilinearParameters(Shares):
    """Bilinear shear with kinematic hardening, of `yield_strengths` and `hardening`.

    Parameters
    ----------
    stiffness_share, strength_share : float
        Shares of the storey's stiffness and strength, where several elements share a storey.

    References
    ----------
    Clough & Johnston (1966), Effect of stiffness degradation on earthquake ductility requirements, Proc. Japan
    Earthquake Engineering Symposium.
    """

    law: Literal["bilinear"] = field(default="bilinear", kw_only=True, repr=False)


class Bilinear(StoreyLaw):
    """Two lines, and elastic unloading of twice the yield drift."""

    name = "bilinear"
    Parameters = BilinearParameters

    def line(self, spring: Any) -> tuple[Any, Any]:
        """Elastic, or along the line of a side."""
        k, (hard, soft), elastic = spring.stiffness, spring.hardened, spring.phase == 0.0
        yielding = spring.phase * (soft * spring.yield_drift)
        return where(elastic, k, hard), where(elastic, -soft * spring.slip, yielding)

    def gauges(self, spring: Any) -> Sequence[DriftGauge]:
        """Return the range of an elastic drift, and the turn of one that yields."""
        p, dy, phase = spring.slip, spring.yield_drift, spring.phase
        return [DriftGauge(phase == 0.0, p - dy, p + dy, -1.0, 1.0, p, dy, phase, 0.0)]

    def switch(self, spring: Any, lanes: Any) -> None:
        """Enter a phase."""
        spring.phase = where(lanes, spring.then, spring.phase)
        self.follow(spring)

    def follow(self, spring: Any) -> None:
        """Let the plastic drift of a storey that yields follow its drift."""
        phase, p = spring.phase, spring.slip
        slip = where(phase == 0.0, p, spring.drift() - phase * spring.yield_drift)
        spring.slip = slip
        if "hysteretic" in spring.group.requested:
            spring.travel += size(slip - p)

    def stored(self, spring: Any, d: Any) -> Any:
        """Energy of both springs."""
        (hard, soft), z = spring.hardened, d - spring.slip
        return 0.5 * (hard * d * d + soft * z * z)

    def residual(self, spring: Any) -> Any:
        """Return (1 - r) p, as far as the storey does not yield back, at r d = (1 - r) dy; NaN where it falls."""
        p, r, limit = spring.slip, spring.hardening, spring.yield_drift
        back = np.where(r != 0.0, limit / np.where(r != 0.0, np.abs(r), 1.0), np.inf)
        rest = (1.0 - r) * np.sign(p) * np.minimum(np.abs(p), back)
        return np.where((r < 0.0) & (np.abs(p) > back), np.nan, rest)


LAW = Bilinear()
