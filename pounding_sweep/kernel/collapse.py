"""Storeys that fall: the scenario ends where the drift of one reaches its limit.

Lanes whose scenario has ended wait with steps of no length.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pounding_sweep.kernel.group import Group, Storey
from pounding_sweep.kernel.roots import NEVER, Series, first_crossing
from pounding_sweep.lanes import maximum, minimum, size, when_any, where

#: Largest share of its limit that a drift passes in a step which resolves its fall.
RESOLVED = 0.25
#: Bits of the output ``flags``, in the row ``collapsed``: a fall, and one in a step that does not resolve it.
FLAG_COLLAPSED, FLAG_BLURRED = 8, 16


def stands(group: Group) -> Any:
    """Lanes in which no storey has fallen."""
    return group.state["collapsed"] == 0.0


def _may_fall(storey: Storey, h: Any) -> Any:
    """Lanes in which the drift of a storey may reach its limit in the step just taken."""
    d0, d1, v0, v1 = (storey.drift(name) for name in ("u0", "u", "v0", "v"))
    early, late = d0 + h * v0, d1 - h * v1
    over, under = maximum(d1, minimum(early, late)), minimum(d1, maximum(early, late))
    return maximum(over, -under) >= storey.drift_limit


def may_fall(group: Group, h: Any) -> Any:
    """Lanes in which any storey may fall in the step just taken."""
    lanes = group.cell(False)
    for storey in group.iter_storeys(group.spec.falling):
        lanes.now |= _may_fall(storey, h)
    return lanes.now


def locate_event(group: Group, asks: Any, h: Any, motion: Callable[[Storey], Series], end: Any = 1.0) -> Any:
    """Fraction of the step at which the first storey falls (`NEVER`: none) before `end`, h later, in lanes that ask."""
    first = group.cell(NEVER)
    for storey in group.iter_storeys(group.spec.falling):
        storey.put(asks, fall=NEVER)
        busy = asks & _may_fall(storey, h)
        with when_any(busy):
            limit, (d0, d1, v0, v1) = storey.drift_limit, (storey.drift(name) for name in ("u0", "u", "v0", "v"))
            passes = size(d1) >= limit
            side = where(where(passes, d1, v0) < 0.0, -1.0, 1.0)
            turns = busy & ~passes & (v0 * v1 < 0.0)
            beyond = motion(storey).begun(d0 - side * limit)
            storey.put(busy, fall=first_crossing(group, busy, beyond, side, busy & passes, turns, end=end))
        first.now = minimum(first.now, storey.fall)
    return first.now


def apply_events(group: Group, lands: Any, h: Any) -> None:
    """End the scenarios in which a fall ends this sub-step of a step of length h."""
    s, spec = group.state, group.spec
    step = 0.0 if spec.series else group.prop("longest") if spec.staged else h  # series are right at any length
    for storey in group.iter_storeys(group.spec.falling):
        due = lands & (storey.fall <= s["fraction"] + group.limit.same_time)
        with when_any(due):
            resolved = step * size(storey.drift("v")) <= RESOLVED * storey.drift_limit
            flag = where(resolved, float(FLAG_COLLAPSED), float(FLAG_BLURRED))
            storey.put(due, collapse_time=group.clock(h))
            s.put(due, maximum(s["collapsed"], flag), "collapsed")
    s.put(~stands(group), 0.0, "time_left")
