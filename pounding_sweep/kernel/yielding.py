"""Contacts with a yielding part: a spring beside one that slips between no force and its yield force.

    F = KL d + CL (d - s),    0 <= d - s <= YIELD

The plastic part s of the penetration stands still while the contact sticks (mode 1). While
it slips (mode 2) the yielding part holds its force: its yield force as d grows, or, once it
has given back all, none as d falls; it sticks again where v turns. In either mode the force
is KE d + CE.
"""

from __future__ import annotations

from typing import Any

from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import maximum, minimum, power, sqrt, where
from pounding_sweep.kernel.roots import NEVER, Series, crossing, first_crossing
from pounding_sweep.model.laws import RESTING_SPEED
from pounding_sweep.model.rebound import YIELD_SHARE


def may_change(group: Group, j: Any, mode: Any, d1: Any, early: Any, late: Any, v1: Any) -> Any:
    """Lanes in which a closed contact may slip, or stick again."""
    s = group.state
    low = s["plastic", j]
    top, slips = low + s["yield", j], s["ce", j] > 0.0
    leaves = (maximum(d1, minimum(early, late)) > top) | (minimum(d1, maximum(early, late)) < low)
    return ((mode == 1.0) & leaves) | ((mode == 2.0) & ((slips & (v1 < 0.0)) | (~slips & (v1 > 0.0))))


def begin(group: Group, j: Any, lanes: Any, k: Any, loss: Any, v: Any, mass: Any) -> None:
    """Properties of a contact that begins at the rate v, meant for the depth of an elastic Hertz contact."""
    s = group.state
    speed = maximum(v, RESTING_SPEED)
    deepest = power(1.25 * mass * speed * speed / k, 0.4)
    effective = k * sqrt(deepest)
    lost = 0.4 * loss * effective
    yields = where(loss > 0.0, YIELD_SHARE * deepest, group.limit.far)
    for name, value in (
        ("kl", effective - lost / (1.0 - YIELD_SHARE)),
        ("cl", lost / (YIELD_SHARE * (1.0 - YIELD_SHARE))),
        ("yield", yields),
        ("plastic", 0.0),
    ):
        s[name, j] = where(lanes, value, s[name, j])
    stick(group, j, lanes)


def set_plastic(group: Group, j: Any, lanes: Any, d: Any) -> None:
    """Plastic part of a contact that has slipped to the penetration d."""
    s = group.state
    s["plastic", j] = where(lanes, where(s["ce", j] > 0.0, d - s["yield", j], d), s["plastic", j])


def stick(group: Group, j: Any, lanes: Any) -> None:
    """Let the plastic part stand still from here on."""
    s = group.state
    s["ke", j] = where(lanes, s["kl", j] + s["cl", j], s["ke", j])
    s["ce", j] = where(lanes, -s["cl", j] * s["plastic", j], s["ce", j])


def slip(group: Group, j: Any, lanes: Any, d: Any) -> None:
    """Let the yielding part hold the force that it has reached: all of it or none."""
    s = group.state
    deep = d - s["plastic", j] > 0.5 * s["yield", j]
    s["ke", j] = where(lanes, s["kl", j], s["ke", j])
    s["ce", j] = where(lanes, where(deep, s["cl", j] * s["yield", j], 0.0), s["ce", j])


def switch(group: Group, j: Any, due: Any, mode: Any, target: Any) -> None:
    """Go over to another mode, in the lanes in which that is due."""
    s = group.state
    d = group.between("u", j) - group.gap(j)
    opens, sticks, slips = due & (target == 0.0), due & (target == 1.0), due & (target == 2.0)
    for name in ("ke", "ce"):
        s[name, j] = where(opens, 0.0, s[name, j])
    set_plastic(group, j, sticks & (mode > 0.0), d)
    stick(group, j, sticks)
    slip(group, j, slips, d)


def held_force(group: Group, j: Any, d: Any) -> Any:
    """Force at penetration d, the plastic part being what it must be there."""
    s = group.state
    stretch = minimum(maximum(d - s["plastic", j], 0.0), s["yield", j])
    return where(d > 0.0, s["kl", j] * d + s["cl", j] * stretch, 0.0)


def settle(group: Group, j: Any, lanes: Any, d: Any, v: Any) -> Any:
    """Mode of a contact that went to the penetration d by `held_force`."""
    s = group.state
    stretch, top = d - s["plastic", j], s["yield", j]
    plastic = where(stretch > top, d - top, where(stretch < 0.0, d, s["plastic", j]))
    s["plastic", j] = where(lanes, plastic, s["plastic", j])
    slips = lanes & (((stretch >= top) & (v > 0.0)) | ((stretch <= 0.0) & (v < 0.0)))
    slip(group, j, slips, d)
    stick(group, j, lanes & ~slips)
    return where(slips, 2.0, group.full(1.0))


def event(group: Group, j: Any, asks: Any, ends: tuple[Any, Any, Any, Any], depth: Series) -> Any:
    """Fraction of the sub-step at which a closed contact begins to slip, or sticks again (2: not in it)."""
    s, (d0, d1, v0, v1) = group.state, ends
    slipping, slips = s["mode", j] == 2.0, s["ce", j] > 0.0
    falls = asks & slipping & slips & (v1 < 0.0)
    grows = asks & slipping & ~slips & (v1 > 0.0)
    low = s["plastic", j]
    toward = where(falls, -1.0, group.full(1.0))
    found = where(falls | grows, crossing(group, falls | grows, 0.0, 1.0, depth.rate, toward), NEVER)
    # it sticks where v is zero and d at one of both limits: rounding there is no crossing
    margin = group.limit.at_release * s["yield", j]
    for sign, limit, may in ((1.0, low + s["yield", j], asks), (-1.0, low, asks & (low > 0.0))):
        crosses = sign * (d1 - limit) > margin
        turns = ~crosses & (sign * v0 > 0.0) & (sign * v1 < 0.0)
        begun = depth.begun(sign * minimum(sign * (d0 - limit), 0.0))
        when = first_crossing(group, may & ~slipping, begun, sign, crosses, turns, least=margin)
        found = minimum(found, when)
    return found
