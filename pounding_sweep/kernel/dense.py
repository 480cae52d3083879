"""Dense output: the motion between the ends of a sub-step that was tried."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pounding_sweep.kernel.group import BENDS, Group
from pounding_sweep.kernel.lanes import fma
from pounding_sweep.kernel.roots import coefficients, polynomial, rate


def displacement(group: Group, i: Any, t: Any) -> Any:
    """Displacement of a floor at a part t of the sub-step just tried."""
    s, h = group.state, group.state["h"]
    if group.spec.staged:  # the quintic that the stages left
        bends = (h * s["v0", i], *(h * h * x for x in (0.5 * s["a0", i], *(s[name, i] for name in BENDS))))
        return polynomial(t, s["u0", i], bends)
    return polynomial(t, s["u0", i], coefficients(h, s["u0", i], s["u", i], s["v0", i], s["v", i], s["a0", i]))


def velocity(group: Group, i: Any, t: Any) -> Any:
    """Velocity of a floor at a part t of the sub-step just tried."""
    s, h = group.state, group.state["h"]
    if group.spec.staged:
        bends = tuple(n * s[name, i] for n, name in enumerate(BENDS, 3))
        return fma(h * t, polynomial(t, s["a0", i], bends), s["v0", i])
    return polynomial(t, *rate(coefficients(h, s["u0", i], s["u", i], s["v0", i], s["v", i], s["a0", i]))) / h


class Between:
    """Displacements or velocities of all floors at a part of the sub-step, each worked out where it is asked for."""

    def __init__(self, of: Callable[[Group, Any, Any], Any], group: Group, t: Any) -> None:
        self._of, self._group, self._t = of, group, t

    def __getitem__(self, i: Any) -> Any:
        return self._of(self._group, i, self._t)
