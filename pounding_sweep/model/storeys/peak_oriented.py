"""Storeys whose reloading is oriented to the largest drift that was left: reinforced concrete in bending."""

from __future__ import annotations

from dataclasses import field
from typing import Any, ClassVar, Literal

from pounding_sweep.lanes import where
from pounding_sweep.model.faults import checked
from pounding_sweep.model.storeys.backbone import PINCHED, TO_LARGEST, TO_LAST, UNLOADING, Backbone, BackboneLaw


@checked
class PeakOrientedParameters(Backbone):
    """Peak-oriented hysteresis of a backbone.

    References
    ----------
    Ibarra, Medina & Krawinkler (2005), Hysteretic models that incorporate strength and stiffness deterioration,
    Earthq. Eng. Struct. Dyn. 34(12).
    """

    law: Literal["peak_oriented"] = field(default="peak_oriented", kw_only=True, repr=False)


class PeakOriented(BackboneLaw):
    """Reloading goes to the last drift that was left, then to the largest."""

    name = "peak_oriented"
    Parameters: ClassVar[Any] = PeakOrientedParameters

    def _go_on(self, p: Any) -> tuple[Any, ...]:
        """Go on to the pinching point, to what was left last or farthest, or along the backbone."""
        beyond = p.crosses & ~(p.x < p.largest)  # unloading that softens may end beyond all drifts that were left
        p.largest = where(beyond, p.x + p.largest_force / p.unload, p.largest)
        if p.spring.compiled[0]:
            p.largest_force = where(p.crosses, self._at(p, p.largest), p.largest_force)
        again, crosses = (p.now == UNLOADING) & ~p.crosses, p.crosses
        x, f, largest, at_largest = p.x, p.f, p.largest, p.largest_force

        def steepness(to: Any, force: Any) -> Any:
            ahead = to - x
            return (force - f) / where(ahead == 0.0, 1.0, ahead)

        k_largest = steepness(largest, at_largest)
        pinched, at_pinch, k_pinch = self._pinch(p, again, steepness)
        k_last = steepness(p.last, p.last_force)
        ahead = (x < p.last) & (f < p.last_force) & (p.last_force < at_largest)
        to_last = ~pinched & (crosses | (p.now == PINCHED)) & ahead & (k_last > k_largest)
        loads = crosses | again | (p.now == PINCHED) | (p.now == TO_LAST)
        to_largest = ~pinched & ~to_last & loads & (x < largest)
        rank, slope, offset, low, high = self._on_backbone(p)
        for lanes, phase, k, end, force in (
            (to_largest, TO_LARGEST, k_largest, largest, at_largest),
            (to_last, TO_LAST, k_last, p.last, p.last_force),
            (pinched, PINCHED, k_pinch, *at_pinch),
        ):
            rank, slope = where(lanes, phase, rank), where(lanes, k, slope)
            offset = where(lanes, force - k * end, offset)
            low, high = where(lanes, x - (end - x), low), where(lanes, end, high)
        return rank, slope, offset, low, high

    def _pinch(self, p: Any, again: Any, steepness: Any) -> tuple[Any, tuple[Any, Any], Any]:
        """Return where it goes to the pinching point, that point, and how steeply: nowhere."""
        return p.turned & False, (p.x, p.f), p.f


LAW = PeakOriented()
