"""Bilinear storeys with kinematic hardening.

    V = r k d + (1 - r) k (d - p),    |d - p| <= dy

d is the drift, p its plastic part, r the hardening and dy the yield drift. While a storey is elastic (phase 0) p stands
still; while it yields (phase 1 or -1) p follows the drift at the distance dy, until it turns. With a cap, an ultimate
drift or deterioration, the lines of both directions are those of a backbone, and unloading goes from one to the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import Any, Literal

import numpy as np

from pounding_sweep.base.errors import SceneError
from pounding_sweep.lanes import maximum, minimum, size, where
from pounding_sweep.model.faults import checked
from pounding_sweep.model.storeys.backbone import FAR, UNLOADING, Backbone, BackboneLaw
from pounding_sweep.model.storeys.base import DriftGauge, Numbers, StoreyLaw


@checked
class BilinearParameters(Backbone):
    """Bilinear shear with kinematic hardening, of `yield_strengths` and `hardening`; of a backbone, if it has more.

    References
    ----------
    Clough & Johnston (1966), Effect of stiffness degradation on earthquake ductility requirements, Proc. Japan
    Earthquake Engineering Symposium. Lignos & Krawinkler (2011), Deterioration modeling of steel components in support
    of collapse prediction of steel moment frames under earthquake loading, J. Struct. Eng. 137(11).
    """

    law: Literal["bilinear"] = field(default="bilinear", kw_only=True, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.deterioration is not None and self.deterioration.reloading is not None:
            raise SceneError("bilinear storeys do not reload to a drift; leave it out", ("deterioration", "reloading"))


class Bilinear(StoreyLaw):
    """Two lines, and elastic unloading of twice the yield drift."""

    name = "bilinear"
    Parameters = BilinearParameters

    def compiled(self, parameters: BilinearParameters) -> tuple[float, ...]:
        """Return whether it deteriorates, of one that has more of a backbone."""
        more = parameters.cap_drift, parameters.ultimate_drift, parameters.deterioration
        return () if more == (None, None, None) else CAPPED.compiled(parameters)

    def variant(self, compiled: tuple[float, ...]) -> StoreyLaw:
        """Return the law of one that has more of a backbone."""
        return CAPPED if compiled else self

    def ultimate_drifts(self, parameters: BilinearParameters, numbers: Numbers) -> tuple[Any, Any]:
        """Return those of the backbone."""
        return CAPPED.ultimate_drifts(parameters, numbers)

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


class Capped(BackboneLaw):
    """Elastic between the backbones of both directions, which do not move but by deterioration."""

    name = "bilinear"
    Parameters = BilinearParameters

    def _unload_to(self, p: Any) -> Any:
        """Return where unloading ends: on the other backbone, or without shear, where that may change the backbone."""
        if p.spring.compiled[0]:
            return super()._unload_to(p)
        other = self._side(p.spring, ~p.up)
        self._backbone(other)
        return -self._meet(other, -p.x, -p.f, p.unload)

    def _meet(self, p: Any, x: Any, f: Any, k: Any) -> Any:
        """Drift at which a line of stiffness k through a point below it meets a backbone."""
        steeper = k > p.hard
        hard = where(steeper, x + (p.hard_line + p.hard * x - f) / where(steeper, k - p.hard, 1.0), FAR)
        soft = x + (p.soft_line + p.soft_stiffness * x - f) / (k - p.soft_stiffness)
        return maximum(x, maximum(minimum(hard, soft), x + (p.residual - f) / k))

    def _go_on(self, p: Any) -> tuple[Any, ...]:
        """Go on elastically as the shear changes its sign, else along the backbone."""
        rank, slope, offset, low, high = self._on_backbone(p)
        if p.spring.compiled[0]:
            elastic = p.crosses
            rank, slope = where(elastic, UNLOADING, rank), where(elastic, p.unload, slope)
            offset = where(elastic, p.f - p.unload * p.x, offset)
            low, high = where(elastic, p.x, low), where(elastic, self._meet(p, p.x, p.f, p.unload), high)
        return rank, slope, offset, low, high


CAPPED = Capped()
LAW = Bilinear()
