"""Storeys whose reloading is pinched: cracks close before they bear, as in reinforced concrete in shear, and infill."""

from __future__ import annotations

from dataclasses import field
from typing import Annotated, Any, Literal

from pydantic import Field

from pounding_sweep.lanes import where
from pounding_sweep.model.faults import Number, checked
from pounding_sweep.model.storeys.backbone import Backbone
from pounding_sweep.model.storeys.base import Numbers
from pounding_sweep.model.storeys.peak_oriented import PeakOriented

_Share = Annotated[Number, Field(gt=0.0, le=1.0)]


@checked
class PinchingParameters(Backbone):
    """Peak-oriented hysteresis of a backbone, that reloads by way of a pinching point.

    Parameters
    ----------
    pinch_force : float
        Share of the line to the largest drift that was left, on which the pinching point lies.
    pinch_drift : float
        Share of the drift left without shear by which the pinching point falls short of it.

    References
    ----------
    Ibarra, Medina & Krawinkler (2005), Hysteretic models that incorporate strength and stiffness deterioration,
    Earthq. Eng. Struct. Dyn. 34(12).
    """

    pinch_force: _Share = field(default=0.3, kw_only=True)
    pinch_drift: _Share = field(default=0.3, kw_only=True)
    law: Literal["pinching"] = field(default="pinching", kw_only=True, repr=False)


class Pinching(PeakOriented):
    """Reloading goes to the pinching point first."""

    name = "pinching"
    Parameters = PinchingParameters
    constants = (*PeakOriented.constants, "pinch_force", "pinch_drift")
    rows = (*PeakOriented.rows, "pinch_x", "pinch_f")

    def values(self, parameters: Any, numbers: Numbers) -> dict[str, Any]:
        """Return those of the backbone, and both shares."""
        shares = {"pinch_force": parameters.pinch_force, "pinch_drift": parameters.pinch_drift}
        return super().values(parameters, numbers) | shares

    def _pinch(self, p: Any, again: Any, steepness: Any) -> tuple[Any, tuple[Any, Any], Any]:
        """Return where it goes to the pinching point, that point, of the side it goes to, and how steeply."""
        spring, x, largest = p.spring, p.x, p.largest
        at = (1.0 - spring.pinch_drift) * (largest - p.largest_force / p.unload)
        across = where(largest > x, largest - x, 1.0)
        to = where(p.crosses, at, spring.pinch_x)
        force = where(p.crosses, spring.pinch_force * p.largest_force * (at - x) / across, spring.pinch_f)
        spring.put(p.lanes & p.crosses, pinch_x=at, pinch_f=force)
        k, straight = steepness(to, force), steepness(largest, p.largest_force)
        between = (p.last < to) & (p.last_force < force) & (to < largest) & (force < p.largest_force)
        return where(p.crosses, x < at, again & between & (k < straight)), (to, force), k


LAW = Pinching()
