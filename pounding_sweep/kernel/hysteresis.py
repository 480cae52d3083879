"""Storeys that yield: bilinear shear with kinematic hardening.

    V = r k d + (1 - r) k (d - p),    |d - p| <= dy

d is the drift, p its plastic part, r the hardening and dy the yield drift. While a storey is
elastic (phase 0) p stands still; while it yields to a side (phase 1 or -1) p follows the drift
at the distance dy, until the drift turns. In either phase the shear is

    V = KT d + CT

with KT = k, CT = -(1 - r) k p, or KT = r k, CT = +-(1 - r) k dy. The phase is frozen within a
sub-step, which ends where the first storey begins to yield or turns.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import Cell, maximum, minimum, size, when_any, where
from pounding_sweep.kernel.roots import NEVER, course, crossing


def each_storey(group: Group, straight: bool = False) -> Iterator[tuple[Any, Any]]:
    """Go through bilinear storeys, with the floors below (None: the ground); at run time if not `straight`."""
    yield from group.each_storey(group.spec.bilinear, straight)


def begin(group: Group, lanes: Any = None) -> None:
    """Let all storeys be elastic, in all lanes or some."""
    s = group.state
    for i in group.each(group.spec.n_dof):
        for name in ("kt", "kd") if group.spec.tangent else ("kt",):
            s.put(lanes, group.full(group.prop("k", i)), name, i)


def shear(group: Group, i: Any, below: Any, name: Any = "u") -> Any:
    """Storey shear, dampers not included; of rates, or of what says that it has no `constant`, its rate."""
    s = group.state
    found = s["kt", i] * group.drift(i, below, name)
    constant = name.startswith("u") if isinstance(name, str) else name.constant
    return found + s["ct", i] if constant else found


def hardened(group: Group, i: Any) -> tuple[Any, Any]:
    """Stiffness of a storey that yields, and what that is less than the elastic one."""
    k, share = group.prop("k", i), group.prop("hardening", i)
    return share * k, (1.0 - share) * k


def far(group: Group, i: Any, below: Any) -> Any:
    """How far a storey's floors are at both ends of a step, and its plastic drift: what its drift is rounded by."""
    found, base = size(group.state["slip", i]), group.base(i)
    for name in ("u0", "u"):
        for k in (i,) if below is None else (i, below):
            found = found + size(group.floor(name, k))
        if base is not None:
            found = found + size(group.prop("height", i) * group.floor(name, base[1]))
    return found


def _limits(group: Group, i: Any, below: Any) -> tuple[Any, Any]:
    """Yield drift, and with a margin for rounding."""
    dy = group.prop("yield_drift", i)
    return dy, dy + (dy * group.limit.at_release + far(group, i, below) * group.limit.exact)


def _may_change(group: Group, i: Any, below: Any, h: Any) -> Any:
    """Lanes in which a storey may begin to yield, or turn, in the step just taken."""
    s = group.state
    p, phase, top = s["slip", i], s["phase", i], _limits(group, i, below)[1]
    z0, z1 = group.drift(i, below, "u0") - p, group.drift(i, below) - p
    v0, v1 = group.drift(i, below, "v0"), group.drift(i, below, "v")
    early, late = z0 + h * v0, z1 - h * v1
    over, under = maximum(z1, minimum(early, late)), minimum(z1, maximum(early, late))
    return where(phase == 0.0, (over > top) | (-under > top), minimum(phase * v0, phase * v1) < 0.0)


def may_change(group: Group, h: Any) -> Any:
    """Lanes in which any storey may begin to yield, or turn, in the step just taken."""
    found = Cell(group.full(False))
    for i, below in each_storey(group, straight=True):
        found.now |= _may_change(group, i, below, h)
    return found.now


def first_event(group: Group, asks: Any) -> Any:
    """Fraction of the trial at which the first storey changes its phase (1: none), in the lanes that ask."""
    s = group.state
    first = Cell(group.full(1.0))
    for i, below in each_storey(group):
        s.put(asks, NEVER, "turn", i)
        busy = asks & _may_change(group, i, below, s["h"])
        with when_any(busy):
            _event(group, i, below, busy)
        turn = s["turn", i]
        first.now = where(turn < first.now, turn, first.now)
    return first.now


def _event(group: Group, i: Any, below: Any, busy: Any) -> None:
    """Find when a storey changes its phase in the trial, and to which."""
    s = group.state
    p, phase, (dy, top) = s["slip", i], s["phase", i], _limits(group, i, below)
    z0, z1 = group.drift(i, below, "u0") - p, group.drift(i, below) - p
    v0, v1 = group.drift(i, below, "v0"), group.drift(i, below, "v")
    z = course(group, partial(group.drift, i, below)).begun(z0)
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
    found = where(leaves, when, where(turns & ~elastic, extreme, NEVER))
    s.put(busy, found, "turn", i)
    s.put(busy, where(elastic, side, 0.0), "then", i)


def apply_events(group: Group, lands: Any) -> Any:
    """Switch the storeys whose event ends this sub-step; returns the lanes in which any did."""
    s = group.state
    switched = Cell(lands & ~lands)
    for i, below in each_storey(group):
        turn = s["turn", i]
        due = lands & (turn < 1.0) & (turn <= s["fraction"] + group.limit.same_time)
        with when_any(due):
            phase = where(due, s["then", i], s["phase", i])
            s["phase", i] = phase
            _follow(group, i, below)
            k, (hard, soft) = group.prop("k", i), hardened(group, i)
            elastic = phase == 0.0
            held = phase * (soft * group.prop("yield_drift", i))
            s.put(due, where(elastic, k, hard), "kt", i)
            s.put(due, where(elastic, -soft * s["slip", i], held), "ct", i)
            if group.spec.tangent:
                less = group.prop("tangent", i) * soft
                s.put(due, where(elastic, k, k - less), "kd", i)
        switched.now |= due
    return switched.now


def _follow(group: Group, i: Any, below: Any) -> None:
    """Let the plastic drift of a storey that yields follow its drift."""
    s = group.state
    phase, p = s["phase", i], s["slip", i]
    new = where(phase == 0.0, p, group.drift(i, below) - phase * group.prop("yield_drift", i))
    s["slip", i] = new
    if "hysteretic" in group.asked:
        s["travel", i] += size(new - p)


def follow(group: Group) -> None:
    """Let the plastic drifts of storeys that yield follow the motion to the present state."""
    for i, below in each_storey(group, straight=True):
        _follow(group, i, below)


def is_yielding(group: Group) -> Any:
    """Lanes in which any storey yields."""
    found = Cell(group.full(False))
    for i, _ in each_storey(group, straight=True):
        found.now |= ~(group.state["phase", i] == 0.0)
    return found.now


def strain(group: Group, i: Any, drifted: Any) -> Any:
    """Strain energy of a storey at its drift."""
    (hard, soft), z = hardened(group, i), drifted - group.state["slip", i]
    return 0.5 * (hard * drifted * drifted + soft * z * z)
