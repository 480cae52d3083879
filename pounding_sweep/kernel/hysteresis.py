"""Storeys that yield: bilinear shear with kinematic hardening.

    V = r k d + (1 - r) k (d - p),    |d - p| <= dy

d is the drift, p its plastic part, r the hardening and dy the yield drift. While a storey is elastic (phase 0) p stands
still; while it yields (phase 1 or -1) p follows the drift at the distance dy, until it turns. In either phase the shear
is V = KT d + CT, with KT = k, CT = -(1 - r) k p, or KT = r k, CT = +-(1 - r) k dy; it is frozen within a sub-step.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import accumulate
from typing import Any

from pounding_sweep.kernel.group import Group, Storey
from pounding_sweep.kernel.roots import NEVER, course, crossing
from pounding_sweep.lanes import maximum, minimum, size, when_any, where


def iter_storeys(group: Group, straight: bool = False) -> Iterator[Storey]:
    """Go through bilinear storeys; at run time if not `straight`."""
    yield from group.iter_storeys(group.spec.bilinear, straight)


def begin(group: Group, lanes: Any = None) -> None:
    """Let all storeys be elastic, in all lanes or some."""
    for i in group.indices(group.spec.n_dof):
        for name in ("kt", "kd") if group.spec.tangent else ("kt",):
            group.state.put(lanes, group.full(group.prop("k", i)), name, i)


def find_sets(group: Group) -> None:
    """Find the displacements at which buildings rest that nothing else holds back, as their storeys have yielded."""
    for _, floors in group.iter_buildings():
        drifts = [(1.0 - group.prop("hardening", i)) * group.state["slip", i] for i in floors]
        for i, total in zip(floors, accumulate(drifts), strict=True):
            group.state["set", i] = total


def shear(storey: Storey, name: Any = "u") -> Any:
    """Storey shear, dampers not included; of rates, or of what says that it has no `constant`, its rate."""
    constant = name.startswith(("u", "set")) if isinstance(name, str) else name.constant
    rising = storey.kt * storey.drift(name)
    return rising + storey.ct if constant else rising


def drift_scale(storey: Storey) -> Any:
    """How far a storey's floors are at both ends of a step, and its plastic drift: what its drift is rounded by."""
    return size(storey.slip) + storey.drift("u0", rounding=True) + storey.drift("u", rounding=True)


def _limits(storey: Storey) -> tuple[Any, Any]:
    """Yield drift, and with a margin for rounding."""
    dy, limit = storey.yield_drift, storey.group.limit
    return dy, dy + (dy * limit.at_release + drift_scale(storey) * limit.exact)


def _ends(storey: Storey) -> tuple[Any, Any, Any, Any]:
    """Elastic drifts and rates of drifts at both ends of the step."""
    z0, z1 = storey.drift("u0") - storey.slip, storey.drift() - storey.slip
    return z0, z1, storey.drift("v0"), storey.drift("v")


def _may_change(storey: Storey, h: Any) -> Any:
    """Lanes in which a storey may begin to yield, or turn, in the step just taken."""
    phase, top, (z0, z1, v0, v1) = storey.phase, _limits(storey)[1], _ends(storey)
    early, late = z0 + h * v0, z1 - h * v1
    over, under = maximum(z1, minimum(early, late)), minimum(z1, maximum(early, late))
    return where(phase == 0.0, (over > top) | (-under > top), minimum(phase * v0, phase * v1) < 0.0)


def may_change(group: Group, h: Any) -> Any:
    """Lanes in which any storey may begin to yield, or turn, in the step just taken."""
    lanes = group.cell(False)
    for storey in iter_storeys(group, straight=True):
        lanes.now |= _may_change(storey, h)
    return lanes.now


def locate_event(group: Group, asks: Any) -> Any:
    """Fraction of the trial at which the first storey changes its phase (1: none), in the lanes that ask."""
    first = group.cell(1.0)
    for storey in iter_storeys(group):
        storey.put(asks, turn=NEVER)
        busy = asks & _may_change(storey, group.state["h"])
        with when_any(busy):
            _event(storey, busy)
        first.now = minimum(first.now, storey.turn)
    return first.now


def _event(storey: Storey, busy: Any) -> None:
    """Find when a storey changes its phase in the trial, and to which."""
    group, phase, (dy, top), (z0, z1, v0, v1) = storey.group, storey.phase, _limits(storey), _ends(storey)
    z = course(group, storey.drift).begun(z0)
    elastic = phase == 0.0
    turns = busy & where(elastic, v0 * v1 < 0.0, minimum(phase * v0, phase * v1) < 0.0)
    toward = where(elastic, where(v0 > 0.0, 1.0, -1.0), phase)
    extreme = where(turns, crossing(group, turns, 0.0, 1.0, z.rate, -toward), 1.0)
    # an elastic drift leaves its range before it turns, or after
    before = turns & elastic & (toward * z.value(extreme) > top)
    after = busy & elastic & ~before & (size(z1) > top)
    side = where(before, toward, where(z1 > 0.0, 1.0, -1.0))
    start = side * minimum(side * z0 - dy, 0.0)
    low, high = where(after & turns, extreme, 0.0), where(before, extreme, 1.0)
    leaves = before | after
    when = crossing(group, leaves, low, high, z.begun(start), side)
    storey.put(busy, turn=where(leaves, when, where(turns & ~elastic, extreme, NEVER)), then=where(elastic, side, 0.0))


def apply_events(group: Group, lands: Any) -> Any:
    """Switch the storeys whose event ends this sub-step; returns the lanes in which any did."""
    switched = group.cell(False)
    for storey in iter_storeys(group):
        turn = storey.turn
        due = lands & (turn < 1.0) & (turn <= group.state["fraction"] + group.limit.same_time)
        with when_any(due):
            phase = where(due, storey.then, storey.phase)
            storey.phase = phase
            _update_plastic_drift(storey)
            k, (hard, soft) = storey.stiffness, storey.hardened
            elastic = phase == 0.0
            yielding = phase * (soft * storey.yield_drift)
            storey.put(due, kt=where(elastic, k, hard), ct=where(elastic, -soft * storey.slip, yielding))
            if group.spec.tangent:
                storey.put(due, kd=where(elastic, k, k - storey.tangent * soft))
        switched.now |= due
    return switched.now


def _update_plastic_drift(storey: Storey) -> None:
    """Let the plastic drift of a storey that yields follow its drift."""
    phase, p = storey.phase, storey.slip
    slip = where(phase == 0.0, p, storey.drift() - phase * storey.yield_drift)
    storey.slip = slip
    if "hysteretic" in storey.group.requested:
        storey.travel += size(slip - p)


def update_plastic_drifts(group: Group) -> None:
    """Let the plastic drifts of storeys that yield follow the motion to the present state."""
    for storey in iter_storeys(group, straight=True):
        _update_plastic_drift(storey)


def is_yielding(group: Group) -> Any:
    """Lanes in which any storey yields."""
    lanes = group.cell(False)
    for storey in iter_storeys(group, straight=True):
        lanes.now |= ~(storey.phase == 0.0)
    return lanes.now
