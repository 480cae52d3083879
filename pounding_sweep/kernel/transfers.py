"""Energies that buildings give to their contacts.

What a building has given has its extremes where the sum of its contacts' powers changes its sign: about there in steps
that are tried, by the cubic through energies and powers at the ends of a sub-step; part by part in steps by series.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from pounding_sweep.kernel.forces import OPEN, force_at, is_closed
from pounding_sweep.kernel.group import Contact, Group
from pounding_sweep.kernel.peaks import cubic_turns, moved
from pounding_sweep.kernel.roots import cubic, root
from pounding_sweep.kernel.row import iter_powers
from pounding_sweep.kernel.types import Index, Lanes, Truths
from pounding_sweep.lanes import Cell, Lookup, count_to, fma, maximum, minimum, size, when_any, where

#: Gauss points between the start of a sub-step that was tried and an extreme.
NODES = 3
#: Parts of a step by series, shorter beside its ends, at whose ends a power's sign is asked for.
PARTS = 16
#: Share of a step's mean power by which that at its ends may go against it unseen: its square is what is lost.
AGAINST = 1e-4
#: Room for what Gauss points miss of the integral of a power's size.
MARGIN = 1.5
#: Force of a contact, and velocities of floors, at a part of a sub-step.
Course = tuple[Callable[[Contact, Lanes], Lanes], Callable[[Group, Lanes], Callable[[Index], Lanes]]]
#: Those of a sub-step that was tried.
TRIED: Course = force_at, partial(moved, velocities=True)


def declare_rows(group: Group) -> None:
    """Declare energy given so far, in the step, and powers."""
    if group.touching and "transfer" in group.requested:
        group.declare(group.spec.n_buildings, "now", "gain", "power", "power_start", "power_end")


def plain(group: Group) -> None:
    """Add what buildings gave in an unlocated step, and take the sum at its end."""
    s = group.state
    for b in group.indices(group.spec.n_buildings):
        s["now", b] = now = s["now", b] + s["gain", b]
        _take(group, b, now)


def jumped(group: Group) -> None:
    """Take what buildings have given where velocities have jumped."""
    for b in group.indices(group.spec.n_buildings):
        _take(group, b, group.state["now", b])


def _take(group: Group, b: Index, energy: Lanes) -> None:
    s = group.state
    s["tmax", b], s["tmin", b] = maximum(s["tmax", b], energy), minimum(s["tmin", b], energy)


def substep(group: Group, accepted: Truths) -> None:
    """Add what buildings gave over the sub-step that some lanes have taken, and take its extremes."""
    s, h, implicit = group.state, group.state["h"], group.spec.implicit
    closed = accepted & is_closed(group)
    with when_any(closed):
        _find_ends(group, lambda contact: (contact.force_start, contact.force_end))
        for b in group.indices(group.spec.n_buildings, straight=False):
            early, late = h * s["power_start", b], h * s["power_end", b]
            gain = 0.5 * (early + late) if implicit else s["gain", b]  # these have forces at the ends only
            e0 = s["now", b]
            s["now", b] = e1 = e0 + where(closed, gain, 0.0)
            _take(group, b, e1)
            curve = cubic(e0, e1, early, late)
            for turn in cubic_turns(curve):
                if implicit or group.spec.impulsive:
                    _take(group, b, where(closed, curve.value(turn), e1))
                    continue
                turns = closed & (turn > 0.0)
                with when_any(turns):
                    at = turn - h * _power(group, b, turn, TRIED) / curve.rate.rate.value(turn)
                    at = where((at > 0.0) & (at < 1.0), at, turn)
                    _take(group, b, where(turns, e0 + h * _mean_power(group, b, at, NODES, TRIED), e1))


def _find_ends(group: Group, forces_of: Callable[[Contact], Lanes]) -> None:
    """Find the powers that buildings give at both ends of a sub-step, by forces of contacts there."""
    s = group.state
    for b in group.indices(group.spec.n_buildings):
        s["power_start", b] = s["power_end", b] = 0.0
    for contact in group.iter_contacts():
        for row, force, v in zip(("power_start", "power_end"), forces_of(contact), ("v0", "v"), strict=True):
            for b, power in iter_powers(contact, force, v):
                s[row, b] += power


def _mean_power(group: Group, b: Index, t: Lanes, nodes: int, course: Course) -> Lanes:
    """Mean power of a building from the start of the sub-step until a part t of it, times t (Gauss & Legendre)."""
    at, weights = np.polynomial.legendre.leggauss(nodes)
    table, total = Lookup([*(0.5 + 0.5 * at), *(0.5 * weights)]), group.cell(0.0)
    for q in count_to(nodes):
        total.now = fma(table[q + nodes], _power(group, b, t * table[q], course), total.now)
    return t * total.now


def _power(group: Group, b: Index, t: Lanes, course: Course) -> Lanes:
    """Power that a building gives at a part t of the sub-step."""
    s, (force, velocities) = group.state, course
    v = velocities(group, t)
    for building in group.indices(group.spec.n_buildings):
        s["power", building] = 0.0
    for contact in group.iter_contacts():
        with when_any(contact.mode > OPEN):
            for building, power in iter_powers(contact, force(contact, t), v):
                s["power", building] += power
    return s["power", b]


# steps by series -----------------------------------------------------------------------------------------------------


def by_series(group: Group, nodes: int, course: Course) -> None:
    """Take the largest and smallest transfers of the step, whose Gauss points have been added."""
    s = group.state
    closed = is_closed(group) & (s["h"] > 0.0)
    with when_any(closed):
        _find_ends(group, lambda contact: tuple(course[0](contact, t) for t in (group.full(0.0), s["fraction"])))
        for b in group.indices(group.spec.n_buildings, straight=False):
            s["now", b] += s["gain", b]
            _take(group, b, s["now", b])
        for b in group.indices(group.spec.n_buildings, straight=False):
            # lanes in which the transfer may have had an extreme of its own inside the step
            gain, swing, high = s["gain", b], s["swing", b], s["now", b]
            ends = s["h"] * minimum(s["power_start", b] * gain, s["power_end", b] * gain)
            turns = (swing - size(gain) > group.limit.same_time * swing) | (ends < -AGAINST * gain * gain)
            reach = 0.5 * (MARGIN * swing - gain)  # beyond the end, if all that goes one way came first
            beyond = (high + reach > s["tmax", b]) | (high - (reach + gain) < s["tmin", b])
            turning = closed & (turns & beyond)
            with when_any(turning):
                _take_turns(group, b, turning, nodes, course)


def _take_turns(group: Group, b: Index, lanes: Truths, nodes: int, course: Course) -> None:
    """Take the transfers of a building at which its power changes its sign, in some lanes."""
    s, end, power = group.state, group.state["fraction"], partial(_power, group, b, course=course)
    table = Lookup([*(0.5 - 0.5 * np.cos(np.pi * np.arange(1, PARTS + 1) / PARTS))])
    begun, low, at_low = s["now", b] - s["gain", b], group.cell(0.0), Cell(s["power_start", b])
    for q in count_to(PARTS):
        a, high = low.now, end * table[q]
        x = power(high)
        turns = lanes & ~(at_low.now * x > 0.0)
        with when_any(turns):
            side = where(x > 0.0, 1.0, -1.0)
            t = root(group, turns, a, high, lambda t: side * power(t))  # noqa: B023
            _take(group, b, where(turns, fma(s["span"], _mean_power(group, b, t, nodes, course), begun), s["now", b]))
        low.now, at_low.now = high, x
