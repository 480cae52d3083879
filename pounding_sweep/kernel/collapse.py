"""Storeys that fall: the scenario ends where the drift of one reaches its limit, or its own springs have failed.

Lanes whose scenario has ended wait with steps of no length.
"""

from __future__ import annotations

from functools import reduce
from operator import and_

from pounding_sweep.kernel.group import Group, StoreySpring
from pounding_sweep.kernel.types import Lanes, Truths
from pounding_sweep.lanes import maximum, size, where
from pounding_sweep.model.storeys import FAILED, DriftGauge

#: What the phase of a storey that falls is called.
FALLEN = 1000.0
#: Largest share of its limit that a drift passes in a step which resolves its fall.
RESOLVED = 0.25
#: Bits of the output ``flags``, in the row ``collapsed``: a fall, and one in a step that does not resolve it.
FLAG_COLLAPSED, FLAG_BLURRED = 8, 16


def stands(group: Group) -> Truths:
    """Lanes in which no storey has fallen."""
    return group.state["collapsed"] == 0.0


def gauge(spring: StoreySpring) -> DriftGauge:
    """Return what ends a scenario: the drift of a storey reaches its limit."""
    limit, zero = spring.drift_limit, spring.group.full(0.0)
    return DriftGauge(spring.group.full(True), -limit, limit, FALLEN, FALLEN, zero, limit, zero, 0.0)


def fail(spring: StoreySpring, lanes: Truths, h: Lanes) -> None:
    """Let a spring lose its strength in some lanes, in a step of length h: its storey falls with its last own one."""
    if spring.is_infill:
        if "failure" in spring.group.requested:
            spring.put(lanes, failure_time=spring.group.clock(h))
        return
    springs = spring.storey.springs() if spring.group.spec.shares_storeys else [spring]
    frame = [part for part in springs if not part.is_infill]
    if all(part.law.can_fail for part in frame):
        fall(spring, reduce(and_, [part.phase == FAILED for part in frame], lanes), h)


def fall(spring: StoreySpring, lanes: Truths, h: Lanes) -> None:
    """End the scenarios of some lanes, in which a storey falls in a step of length h."""
    group, s, spec = spring.group, spring.group.state, spring.group.spec
    flag = group.full(float(FLAG_COLLAPSED))
    if spec.limited:
        step = 0.0 if spec.series else group.prop("longest") if spec.staged else h  # series are right at any length
        resolved = step * size(spring.drift("v")) <= RESOLVED * spring.drift_limit
        flag = where(resolved, flag, float(FLAG_BLURRED))
    spring.put(lanes, collapse_time=group.clock(h))
    s.put(lanes, maximum(s["collapsed"], flag), "collapsed")
