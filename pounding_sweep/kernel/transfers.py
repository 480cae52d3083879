"""Energies that buildings give to their contacts, in steps that are tried (of those by series: `series_transfers`).

What a building has given changes by the powers of its contacts, which a scheme sums over its stages, and has its
extremes where their sum changes its sign. About where, the cubic through energies and powers at the ends of a sub-step
tells; how much was given by then, the motion that the scheme found between them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pounding_sweep.kernel import forces
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import Cell, Lookup, count_to, fma, maximum, minimum, when_any, where
from pounding_sweep.kernel.peaks import Between, cubic_extremes, cubic_turns, velocity
from pounding_sweep.kernel.row import each_given

#: Gauss points between the start of a sub-step and an extreme.
NODES = 3


def plain(group: Group) -> None:
    """Add what buildings gave in an unlocated step, and take the sum at its end."""
    s = group.state
    for b in group.each(group.spec.n_buildings):
        s["now", b] = now = s["now", b] + s["gain", b]
        _take(group, b, now)


def jumped(group: Group) -> None:
    """Take what buildings have given where velocities have jumped."""
    for b in group.each(group.spec.n_buildings):
        _take(group, b, group.state["now", b])


def _take(group: Group, b: Any, energy: Any) -> None:
    s = group.state
    s["tmax", b], s["tmin", b] = maximum(s["tmax", b], energy), minimum(s["tmin", b], energy)


def substep(group: Group, taken: Any) -> None:
    """Add what buildings gave over the sub-step that some lanes have taken, and take its extremes."""
    closed = taken & forces.is_closed(group)
    with when_any(closed):
        _add(group, closed)


def _add(group: Group, closed: Any) -> None:
    s, h, implicit = group.state, group.state["h"], group.spec.implicit
    for b in group.each(group.spec.n_buildings):
        s["given0", b] = s["given1", b] = 0.0
    for j in group.each_contact():
        for row, force, v in (("given0", "f0", "v0"), ("given1", "f1", "v")):
            for b, power in each_given(group, j, s[force, j], v):
                s[row, b] = s[row, b] + power
    for b in group.each(group.spec.n_buildings, straight=False):
        early, late = h * s["given0", b], h * s["given1", b]
        gain = 0.5 * (early + late) if implicit else s["gain", b]  # these have forces at the ends only
        e0 = s["now", b]
        s["now", b] = e1 = e0 + where(closed, gain, 0.0)
        _take(group, b, e1)
        if implicit or group.spec.impulsive:
            for x in cubic_extremes(e0, e1, early, late):
                _take(group, b, where(closed, x, e1))
            continue
        bend, bent = -6.0 * (e0 - e1) - 2.0 * (2.0 * early + late), 12.0 * (e0 - e1) + 6.0 * (early + late)
        for turn in cubic_turns(e0, e1, early, late):
            turns = closed & (turn > 0.0)
            with when_any(turns):
                at = turn - h * _power(group, b, turn) / fma(turn, bent, bend)
                at = where((at > 0.0) & (at < 1.0), at, turn)
                _take(group, b, where(turns, e0 + _given(group, b, at), e1))


def _given(group: Group, b: Any, t: Any) -> Any:
    """Energy that a building gives from the start of the sub-step until a part t of it (Gauss & Legendre)."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    table, total = Lookup(group.trace, [*(0.5 + 0.5 * nodes), *(0.5 * weights)]), Cell(group.full(0.0))
    for q in count_to(NODES, group.trace):
        total.now = fma(table[q + NODES], _power(group, b, t * table[q]), total.now)
    return group.state["h"] * t * total.now


def _power(group: Group, b: Any, t: Any) -> Any:
    """Power that a building gives at a part t of the sub-step."""
    s, v = group.state, Between(velocity, group, t)
    for each in group.each(group.spec.n_buildings):
        s["given", each] = 0.0
    for j in group.each_contact():
        with when_any(s["mode", j] > forces.OPEN):
            for each, power in each_given(group, j, forces.force_at(group, j, t), v):
                s["given", each] = s["given", each] + power
    return s["given", b]
