"""Storeys that yield, within steps by series: when they begin to, and when they turn.

A storey's shear is one straight line in its drift while its phase lasts, so that the series of
the row goes on to hold. An elastic storey begins to yield where its drift, a series, is the
yield drift away from its plastic part; one that yields turns where the rate of that series
changes its sign.
"""

from __future__ import annotations

from functools import reduce
from typing import Any

from pounding_sweep.kernel import hysteresis
from pounding_sweep.kernel.forces import NEVER
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import Cell, fma, maximum, minimum, power, real, size, when_any, where
from pounding_sweep.kernel.roots import Series, tangents

#: Largest last term of a series beside its first ones, in both number formats.
LEFT_OUT = {"float64": 1e-11, "float32": 2e-7}


def begin(group: Group) -> None:
    """Let no storey change its phase yet, and end the step where the series of a floor is left out too early."""
    s, n, order = group.state, group.spec.n_dof, group.spec.series
    for i, _ in hysteresis.each_storey(group):
        s["turn", i], s["then", i] = group.full(NEVER), s["phase", i]
        for kind in range(2):
            s["ruled_out", group.change(i + len(group.contacts), kind)] = 0.0

    def terms(i: Any) -> tuple[Any, Any]:
        # the fourth of them too: a floor at rest begins with the ground's ramp
        first = reduce(maximum, [size(s["jet", i + k * n]) for k in range(4)])
        return LEFT_OUT[group.spec.precision] * first, size(s["jet", i + order * n])

    over = Cell(group.full(0.0))
    for i in group.each(n):
        most, last = terms(i)
        over.now = maximum(over.now, last - most)
    with when_any(over.now > 0.0):
        share = Cell(group.full(1.0))
        for i in group.each(n, straight=False):
            most, last = terms(i)
            share.now = minimum(share.now, where(last > most, most / last, 1.0))
        s["fraction"] = minimum(s["fraction"], power(share.now, 1.0 / order))


def _drift(group: Group, i: Any, below: Any, constant: Any, sign: Any) -> Series:
    """Sign times the drift of a storey, its first coefficient given."""
    s, n = group.state, group.spec.n_dof

    def read(k: int) -> Any:
        if k == 0:
            return constant
        x = s["jet", i + k * n]
        return sign * (x if below is None else x - s["jet", below + k * n])

    return Series(read, group.spec.series)


def place(group: Group) -> None:
    """Find displacements and velocities at ``fraction``, of the step."""
    s, n, order, t = group.state, group.spec.n_dof, group.spec.series, group.state["fraction"]
    moves = s["span"] > 0.0
    per = where(moves, 1.0 / s["span"], 0.0)
    for i in group.each(n, straight=False):
        x = rate = s["jet", i + order * n]
        x = fma(t, x, s["jet", i + (order - 1) * n])
        for k in range(order - 2, -1, -1):
            rate = fma(t, rate, x)
            x = fma(t, x, s["jet", i + k * n])
        s["u", i], s["v", i] = x, where(moves, rate * per, s["v0", i])


def _hull(group: Group, x0: Any, x1: Any, v0: Any, v1: Any) -> tuple[Any, Any]:
    """Bounds of a motion up to ``fraction``, as far as it is a cubic: those of the hull of its ends and tangents."""
    third = (1.0 / 3.0) * (group.state["span"] * group.state["fraction"])
    early, late = fma(third, v0, x0), fma(-third, v1, x1)
    return maximum(x1, maximum(early, late)), minimum(x1, minimum(early, late))


def may_touch(group: Group, j: Any, depth: Series) -> Any:
    """Lanes in which an open contact may close."""
    most, _ = _hull(group, *(group.between(name, j) for name in ("u0", "u", "v0", "v")))
    return most + depth.bulge(group.state["fraction"]) > group.gap(j)


def offer(group: Group, asks: Any, choice: Any) -> None:
    """Consider changes of storeys' phases before ``fraction``, in lanes that ask."""
    s, first = group.state, len(group.contacts)
    for i, below in hysteresis.each_storey(group):
        phase, dy, p = s["phase", i], group.prop("yield_drift", i), s["slip", i]
        # that of an event that ends the step as it is
        then = where(s["turn", i] > s["fraction"], phase, s["then", i])
        sides = [group.change(first + i, kind) for kind in range(2)]
        margin = fma(dy, group.limit.same_time, hysteresis.far(group, i, below) * group.limit.exact)
        v0, v1 = (hysteresis.drift(group, i, below, name) for name in ("v0", "v"))
        z0, z1 = (hysteresis.drift(group, i, below, name) - p for name in ("u0", "u"))
        elastic = asks & (phase == 0.0)
        with when_any(elastic):
            most, least = _hull(group, z0, z1, v0, v1)
            bulge = _drift(group, i, below, z0, 1.0).bulge(s["fraction"])
            most, least = most + bulge, least - bulge
            leaves, beyond = elastic & (maximum(most, -least) > dy + margin), size(z1) > dy + margin
            # where it may turn twice, it may be beyond and back: half the step tells
            unseen = leaves & (then == 0.0) & (v0 * v1 >= 0.0) & ~beyond
            with when_any(unseen):
                _, early, late, last = tangents(_drift(group, i, below, z0, 1.0).rate, s["fraction"])
                twice = minimum(last * early, last * late) < 0.0  # the first rate may be none, as where it yielded
                choice.doubt.now = choice.doubt.now | (unseen & twice)
            with when_any(leaves):
                toward = where(v0 > 0.0, 1.0, group.full(-1.0))
                # it leaves its range on the side to which it moves first, and comes back, or stays beyond
                turns = (v0 * v1 < 0.0) & (where(v0 > 0.0, most, -least) > dy + margin)
                ruled_out = where(toward > 0.0, *(s["ruled_out", each] for each in sides))
                hops = turns & ~(toward * z1 > dy + margin) & ~(then == toward) & ~(ruled_out > 0.0)
                side = where(hops, toward, where(z1 > 0.0, 1.0, group.full(-1.0)))
                start = side * z0 - dy
                start = where(start > -margin, start - margin, start)
                lanes = leaves & (hops | beyond) & ~(then == side)
                number = where(side > 0.0, *(group.full(real(each)) for each in sides))
                choice.offer(number, lanes, 1.0, _drift(group, i, below, start, side), side)
        yields = asks & ~(phase == 0.0) & ~(then == 0.0) & ~(s["ruled_out", sides[0]] > 0.0)
        with when_any(yields):
            rate = _drift(group, i, below, z0, 1.0).rate
            end, last, per = s["fraction"], s["span"] * v1, (1.0 / 3.0) * s["fraction"]
            early, late = fma(per, rate.read(1), rate.read(0)), fma(-per, rate.rate.value(end), last)
            turns = yields & (minimum(phase * last, minimum(phase * early, phase * late)) < 0.0)
            with when_any(turns):
                choice.offer(real(sides[0]), turns, -phase, rate, 0.0)


def keep(group: Group, found: Any, happens: Any, t: Any) -> None:
    """Keep what was found of the storeys that were chosen."""
    s, first = group.state, len(group.contacts)
    for i, _ in hysteresis.each_storey(group):
        for kind in range(2):
            number = group.change(i + first, kind)
            mine = found & (s["picked"] == real(number))
            s["turn", i] = where(mine & happens, t, s["turn", i])
            s["then", i] = where(mine & happens, s["aim"], s["then", i])
            s["ruled_out", number] = where(mine & ~happens, 1.0, s["ruled_out", number])
