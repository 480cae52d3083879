"""Storeys that centre themselves: rocking walls, post-tensioned frames, braces of shape-memory alloy.

    V = r k d + (1 - r) k (d - p)
    p >= 0 for d > 0:    (1 - beta) dy <= d - p <= dy,    or p = 0 below

d is the drift, p its inelastic part, r the hardening, dy the drift of first yield (where a gap opens) and beta the
height of the flag over the yield strength; negative drifts mirror this. Between both lines the storey is elastic (phase
0). On the upper line (phase 1 or -1) p follows the drift out, on the lower one (phase 2 or -2) back until it is zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from pounding_sweep.lanes import size, where
from pounding_sweep.model.faults import Number, checked
from pounding_sweep.model.storeys.base import DriftGauge, Numbers, Shares, StoreyLaw

#: What enters phase 0 where the lower line has come down to an inelastic drift of zero.
_CENTRED = 3.0


@checked
class FlagParameters(Shares):
    """Self-centring storeys, whose loops are flags: of `yield_strengths` and `hardening`.

    Parameters
    ----------
    beta : float
        Height of the flag over the yield strength, above 0 and at most 1: a storey that has yielded unloads elastically
        by beta times its yield strength (less what hardening adds), then along a line parallel to the hardening.
    stiffness_share, strength_share : float
        Shares of the storey's stiffness and strength, where several elements share a storey.

    References
    ----------
    Christopoulos, Filiatrault & Folz (2002), Seismic response of self-centring hysteretic SDOF systems, Earthq. Eng.
    Struct. Dyn. 31, 1131-1150.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> flag = {"law": "flag", "beta": 0.8}
    >>> wall = ps.Building("a", [100.0], [4e4], yield_strengths=[200.0], hardening=0.05, hysteresis=flag)
    >>> ps.cyclic_test(wall, [0.02, 0.01, 0.0]).shear.values.round(6).tolist()
    [230.0, 58.0, 0.0]
    """

    beta: Annotated[Number, Field(gt=0.0, le=1.0)]
    law: Literal["flag"] = field(default="flag", kw_only=True, repr=False)


class Flag(StoreyLaw):
    """An elastic range at the origin, and a flag to either side."""

    name = "flag"
    Parameters = FlagParameters
    constants = ("hardening", "yield_drift", "flag_height")

    def values(self, parameters: FlagParameters, numbers: Numbers) -> dict[str, Any]:
        """Return those of bilinear storeys, and the height of the flag."""
        return super().values(parameters, numbers) | {"flag_height": parameters.beta}

    def _parts(self, spring: Any) -> tuple[Any, Any, Any]:
        """Return where it is on the lower line, what d - p is there for p > 0, and what it is on the present line."""
        phase, dy = spring.phase, spring.yield_drift
        lower, least = size(phase) == 2.0, (1.0 - spring.flag_height) * dy
        return lower, least, where(lower, 0.5 * phase * least, phase * dy)

    def line(self, spring: Any) -> tuple[Any, Any]:
        """Elastic, or along a line of a side."""
        k, (hard, soft), elastic = spring.stiffness, spring.hardened, spring.phase == 0.0
        return where(elastic, k, hard), where(elastic, -soft * spring.slip, soft * self._parts(spring)[2])

    def gauges(self, spring: Any) -> Sequence[DriftGauge]:
        """Return the range between both lines, or the end of the lower one; a drift that turns leaves either line."""
        p, dy, phase, (lower, least, _) = spring.slip, spring.yield_drift, spring.phase, self._parts(spring)
        side = where(lower, phase, p)
        inner = where(side < 0.0, -least, least) + where(lower, 0.0, p)
        low, high = where(side > 0.0, inner, p - dy), where(side < 0.0, inner, p + dy)
        below = where(side > 0.0, where(lower, _CENTRED, 2.0), -1.0)
        above = where(side < 0.0, where(lower, _CENTRED, -2.0), 1.0)
        middle, reach, way = 0.5 * (low + high), 0.5 * (high - low), where(lower, -0.5 * phase, phase)
        return [DriftGauge(lower | (phase == 0.0), low, high, below, above, middle, reach, way, 0.0)]

    def switch(self, spring: Any, lanes: Any) -> None:
        """Enter a phase."""
        centred = lanes & (spring.then == _CENTRED)
        spring.put(lanes, phase=where(centred, 0.0, spring.then))
        spring.put(centred, slip=0.0)
        self.follow(spring)

    def follow(self, spring: Any) -> None:
        """Let the inelastic drift follow the drift along a line; the upper ones lose beta of what it takes."""
        phase, p = spring.phase, spring.slip
        slip = where(phase == 0.0, p, spring.drift() - self._parts(spring)[2])
        spring.slip = slip
        if "hysteretic" in spring.group.requested:
            spring.travel += where(size(phase) == 1.0, spring.flag_height * size(slip - p), 0.0)

    def stored(self, spring: Any, d: Any) -> Any:
        """Energy of both springs, and of what draws the inelastic drift back."""
        (hard, soft), z, least = spring.hardened, d - spring.slip, self._parts(spring)[1]
        return 0.5 * (hard * d * d + soft * z * z) + soft * least * size(spring.slip)

    def residual(self, spring: Any) -> Any:
        """Return zero, or (1 - r) p where weights hold what the lower line does not draw back; NaN where it falls."""
        p, r, dy = spring.slip, spring.hardening, spring.yield_drift
        rest = np.where(r * np.abs(p) + (1.0 - spring.flag_height) * dy > 0.0, 0.0, (1.0 - r) * p)
        return np.where(r * np.abs(p) + dy < 0.0, np.nan, rest)


LAW = Flag()
