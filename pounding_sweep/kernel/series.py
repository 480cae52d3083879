"""Steps beside contacts whose forces are polynomials of the motion: series in time.

While no contact changes its mode, and the ground acceleration is linear, the motion of a row
whose contacts press by F = k d + c d', or by k d + c d d', is analytic. Its Taylor series

    u(t) = sum over n of U_n (t / h)**n

follows from the equation of motion by comparing powers of t / h (Moore 1966; Corliss & Chang
1982). It holds all along the step: contacts' events, the peaks of forces and penetrations and
the motion at any instant are read from it, so that a step needs no trial, and a contact
a few steps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from typing import Any

import numpy as np

from pounding_sweep.kernel import forces, hysteresis, links, march, transfers
from pounding_sweep.kernel.forces import MAX_TRIES, OPEN, PRESSING, REBOUND, SLACK
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import (
    Cell,
    Lookup,
    any_lane,
    count_to,
    fma,
    maximum,
    minimum,
    not_,
    real,
    roughly_power,
    size,
    when,
    when_any,
    where,
    while_any,
)
from pounding_sweep.kernel.peaks import followed, take_extremes
from pounding_sweep.kernel.roots import NEVER, Series, first_crossing, newton, tangents
from pounding_sweep.kernel.row import Pushes, accelerations, powers

#: Largest last term of a series beside its first ones, in both number formats.
LEFT_OUT = {"float64": 1e-14, "float32": 1e-6}
#: The same where storeys yield.
LEFT_OUT_YIELDING = {"float64": 1e-11, "float32": 2e-7}
#: Nodes of the quadrature of powers over a step, in both number formats.
NODES = {"float64": 6, "float32": 4}
#: Most that a motion leaves its ends by, in its rates there times the step.
BULGE = 0.2
#: Parts of a step in which extremes of motions are looked for.
PARTS = 4
#: Most halvings of a step in which an event may hide, and its part after which none is sought.
HALVINGS = 6
HALVED = 0.5**HALVINGS
#: Where a step ends if floors that part bend back, over when a parabola is at its start again; its least part, if cut.
PAST, SOONEST = -1.5, 1e-3


def _is_product(group: Group, j: Any) -> bool:
    """Whether the damper of a contact grows with the penetration."""
    law = group.law_of(j).shape
    return bool(law.damper) and law.damper_exponent == 1.0


def substep(group: Group, h: Any) -> None:
    """One sub-step of every lane that has some of its step of length h left: to the first event, at most."""
    march.look_ahead(group, h)
    _expand(group)
    _meet(group)
    _place(group)
    group.state["h"] = group.state["span"] * group.state["fraction"]
    _take_contacts(group)
    _take_turns(group)
    if "link_force" in group.asked:
        _take_links(group)
    _integrate(group)
    if "acceleration" in group.asked:
        _take_accelerations(group)
    march.close(group, forces, h)


def _expand(group: Group) -> None:
    """Find the series of floors, penetrations and forces from the start of the step on."""
    s, n, order = group.state, group.spec.n_dof, group.spec.series
    s["span"] = s["h"]
    for i in group.each(n):
        s["jet", i] = s["u0", i]
    if group.spec.yielding and group.touching and not group.long:  # while storeys yield, contacts are open as a rule
        closed = any_lane(forces.is_closed(group))
        for held, contacts in ((closed, len(group.contacts)), (not_(closed), 0)):
            for _ in when(held):
                _expand_row(group, contacts)
    else:
        _expand_row(group, len(group.contacts))
    for j in group.each_contact() if not group.spec.yielding else ():
        s["dj", j + order * len(group.contacts)] = group.between(_Term(group, order), j)


def _expand_row(group: Group, contacts: int) -> None:
    """Find the coefficients of all floors, and of as many contacts' penetrations and forces."""
    s = group.state
    inverse = Lookup(group.trace, [1.0 / (k + 1.0) for k in range(group.spec.series)])
    ground = Cell(s["g1"] - s["g0"])
    _expand_term(group, contacts, 0, s["g0"], inverse)
    for q in count_to(group.spec.series - 1, group.trace):  # written out for each, it would not fit into caches
        _expand_term(group, contacts, q + 1, ground.now, inverse)
        ground.now = group.full(0.0)


def _expand_term(group: Group, contacts: int, k: Any, ground: Any, inverse: Lookup) -> None:
    """Find coefficient k + 1 of all floors from coefficient k of displacements, and of velocities in ``y``."""
    x, push = _Term(group, k), Pushes(group)
    for j in range(contacts) if not group.long else group.each_contact() if contacts else ():
        push.add_contact(j, _press(group, j, k, x))
    push.add_links(x, x.rates)
    s, n, per = group.state, group.spec.n_dof, group.state["h"] * inverse[k]
    for b, floors in group.each_building():  # numbers are read building by building: there is room for few
        moved, sped = [x[i] for i in floors], [s[x.rates, i] for i in floors]
        a = accelerations(group, [(b, floors)], moved, sped, ground, push.on(floors), x.constant)
        for i, yi, ai in zip(floors, sped, a, strict=True):
            s["jet", i + (k + 1) * n] = yi * per
            s["y", i] = ai * per


class _Term:
    """One coefficient of all floors."""

    def __init__(self, group: Group, k: Any) -> None:
        self._state, self._begin = group.state, k * group.spec.n_dof
        #: Whether what follows from it has the constants that rates are without.
        self.constant = isinstance(k, int) and k == 0
        #: Rows of the same coefficient of velocities, while coefficients are found.
        self.rates = "v0" if self.constant else "y"

    def __getitem__(self, i: Any) -> Any:
        return self._state["jet", i + self._begin]


def _press(group: Group, j: Any, k: Any, x: _Term) -> Any:
    """Coefficient k of a contact's force, of the floors' motion `x`."""
    s, nc = group.state, len(group.contacts)
    d, w = group.between(x, j), group.between(x.rates, j)
    if x.constant:
        d = d - group.gap(j)
    s["dj", j + k * nc] = d
    if not group.law_of(j).shape.damper:
        return s["ke", j] * d
    if not _is_product(group, j):
        f = fma(s["ke", j], d, s["ce", j] * w)
    else:
        s["wj", j + k * nc] = w
        total = Cell(group.full(0.0))
        for i in range(k + 1) if isinstance(k, int) else count_to(k + 1, group.trace):
            total.now = fma(s["dj", j + i * nc], s["wj", j + (k - i) * nc], total.now)
        f = fma(s["ke", j], d, s["ce", j] * total.now)
    s["fj", j + k * nc] = f
    return f


def _floor(group: Group, i: Any) -> Series:
    """Displacement of a floor."""
    s, n = group.state, group.spec.n_dof
    return Series(lambda k: s["jet", i + k * n], group.spec.series)


def _depth(group: Group, j: Any) -> Series:
    """Penetration of a contact."""
    s, nc = group.state, len(group.contacts)
    if group.spec.yielding:

        def read(k: int) -> Any:
            d = group.between(_Term(group, k), j)
            return d if k else d - group.gap(j)

        return Series(read, group.spec.series)
    return Series(lambda k: s["dj", j + k * nc], group.spec.series)


def _force(group: Group, j: Any) -> Series:
    """Force of a contact, while its mode lasts."""
    s, nc = group.state, len(group.contacts)
    if not group.law_of(j).shape.damper:
        return Series(lambda k: s["ke", j] * s["dj", j + k * nc], group.spec.series - 1)
    return Series(lambda k: s["fj", j + k * nc], group.spec.series - 1)


def _per(group: Group) -> Any:
    """Inverse of the length of the whole step, zero in lanes that wait."""
    span = group.state["span"]
    return where(span > 0.0, 1.0 / span, 0.0)


def _meet(group: Group) -> None:
    """Find the first instant at which contacts or storeys change their modes: ``fraction``, of the step."""
    s = group.state
    ongoing = s["time_left"] > 0.0
    s["taken"] = where(ongoing, 1.0, 0.0 * s["h"])
    for j in group.each_contact():
        s["event", j], s["next", j] = group.full(NEVER), s["mode", j]
    for i, _ in hysteresis.each_storey(group) if group.spec.yielding else ():
        s["turn", i], s["then", i] = group.full(NEVER), s["phase", i]
    _converge(group)
    going = Cell(ongoing & (s["tries"] < MAX_TRIES))
    for _ in while_any(lambda: going.now, group.trace, at_most=HALVINGS + 1):
        asks, first, doubt = going.now, Cell(s["fraction"]), Cell(group.lanes_where(False))
        if group.spec.yielding:
            _place(group)
            _look_at_storeys(group, asks, doubt, first)
        for j in group.each_contact():
            mine = Cell(asks)
            if group.spec.yielding:
                most, _ = _hull(group, *(group.between(name, j) for name in ("u0", "u", "v0", "v")))
                nears = most + _depth(group, j).bulge(s["fraction"]) > group.gap(j)
                mine.now = asks & ((s["mode", j] > OPEN) | nears)
            with when_any(mine.now):
                _look_at_contact(group, j, mine.now, doubt)
            first.now = minimum(first.now, s["event", j])
        going.now = asks & doubt.now  # half the step tells
        s["fraction"] = where(going.now, 0.5 * s["fraction"], first.now)
    s["land"] = where(s["fraction"] < 1.0, 1.0, 0.0)


def _converge(group: Group) -> None:
    """Find where series leave out more than rounding, or floors that part come back: ``fraction``, of the step."""
    # These may touch again and be gone by the end of a longer step, which its ends do not tell.
    s, n, order, precision = group.state, group.spec.n_dof, group.spec.series, group.spec.precision
    room, back = Cell(group.full(1.0)), Cell(group.full(1.0))

    def keep(lanes: Any, first: Sequence[Any], last: Any) -> None:
        most = (LEFT_OUT_YIELDING if group.spec.yielding else LEFT_OUT)[precision] * reduce(maximum, map(size, first))
        short = lanes & (size(last) > most)
        room.now = where(short, minimum(room.now, most / size(last)), room.now)

    for j in group.each_contact(straight=True):
        depth, closed = _depth(group, j), s["mode", j] > OPEN
        d, v, bend = (depth.read(k) for k in range(3))
        keep(closed, (d, v, bend), depth.read(order))
        returns = ~closed & (v < 0.0) & (bend > 0.0) & (d + v + bend > 0.0)
        back.now = where(returns, minimum(back.now, PAST * v / where(returns, bend, 1.0)), back.now)
    for i in group.each(n) if group.spec.yielding else ():
        # the fourth of them too: a floor at rest begins with the ground's ramp
        keep(group.lanes_where(True), [s["jet", i + k * n] for k in range(4)], s["jet", i + order * n])
    s["fraction"] = group.full(1.0)
    with when_any(room.now < 1.0):
        s.put(room.now < 1.0, roughly_power(room.now, 1.0 / order), "fraction")
    # of what rests, no first term tells the size
    s["fraction"] = maximum(minimum(s["fraction"], back.now), SOONEST)


def _first(group: Group, lanes: Any, sign: Any, series: Series, doubt: Cell, leans: Any = None) -> Any:
    """Where sign times a series turns positive by ``fraction`` or before; where it `leans`, if it rises there."""
    end = group.state["fraction"]
    e0, r0, e1, r1 = (sign * x for x in (series.read(0), series.read(1), *series.with_slope(end)))
    crosses = e1 > 0.0
    if leans is not None:
        crosses = crosses & (~leans | (r1 >= 0.0))
    turns = lanes & ~crosses & (r0 > 0.0) & (r1 < 0.0)
    reach, found = Cell(group.full(-1.0)), Cell(group.full(NEVER))
    with when_any(turns):
        third = (1.0 / 3.0) * end
        reach.now = maximum(fma(third, r0, e0), fma(-third, r1, e1)) + series.bulge(end)
    # one that turns twice may have been positive before
    above = (r0 > 0.0) & ~(r1 < 0.0) & (crosses | (fma(end, r0, e0) > 0.0))
    below = (r0 < 0.0) & ~(r1 > 0.0) & ~crosses & (fma(-end, r1, e1) > 0.0)
    unseen = lanes & (above | below) & (end > HALVED)
    with when_any(unseen):
        bends = sign * r0 * series.rate.value(0.5 * end) < 0.0
        doubt.now = doubt.now | (unseen & (bends | _turns_twice(group, series)))
    turns = turns & (reach.now > 0.0)
    lanes = lanes & (crosses | turns)
    with when_any(lanes):
        found.now = first_crossing(group, lanes, series, sign, crosses, turns, (r0 < 0.0) & (r1 > 0.0) & crosses, end)
    return found.now


def _look_at_contact(group: Group, j: Any, asks: Any, doubt: Cell) -> None:
    """Find the first change of a contact's mode before ``fraction``, in lanes that ask."""
    s, law, depth, mode = group.state, group.law_of(j), _depth(group, j), group.state["mode", j]
    closed, toward = mode > OPEN, where(mode == PRESSING, -1.0, group.full(1.0))
    # one that has touched but for a rounding error goes on, and one that has parted so does not touch
    inside = depth.read(0) > 0.0
    leans = where(closed, ~inside, inside & (depth.read(1) < 0.0))
    changes = [(asks, where(closed, -1.0, group.full(1.0)), depth, where(closed, OPEN, group.full(PRESSING)), leans)]
    if law.shape.approach_only:
        target = where(mode == PRESSING, REBOUND, group.full(PRESSING))
        changes.append((asks & closed, toward, depth.rate, target, None))
    if law.shape.clips:
        c = s["cl", j] * _per(group)
        press = Series(_pressing(depth, s["kl", j], c, _is_product(group, j), group.limit.at_release), depth.order - 1)
        target = where(mode == PRESSING, SLACK, group.full(PRESSING))
        changes.append((asks & closed & (c > 0.0), toward, press, target, None))
    for lanes, sign, series, target, leaning in changes:
        t = _first(group, lanes, sign, series, doubt, leaning)
        sooner = t < s["event", j]
        s.put(sooner, t, "event", j)
        s.put(sooner, target, "next", j)


def _pressing(depth: Series, k: Any, c: Any, product: bool, least: float) -> Callable[[int], Any]:
    """Coefficients of what the sign of a force follows, of a contact that may be slack: of k d + c d d' without d."""

    def read(n: int) -> Any:
        damped = c * depth.rate.read(n)
        if n:
            return damped if product else fma(k, depth.read(n), damped)
        elastic = k if product else k * depth.read(0)
        # at its own event the sign of a force is one of rounding
        return where(size(elastic + damped) > least * size(elastic), elastic + damped, 0.0)

    return read


def _drift(group: Group, i: Any, below: Any, first: Any, sign: Any) -> Series:
    """Sign times the drift of a storey, its first coefficient given."""
    s, n = group.state, group.spec.n_dof

    def read(k: int) -> Any:
        if k == 0:
            return first
        x = s["jet", i + k * n]
        return sign * (x if below is None else x - s["jet", below + k * n])

    return Series(read, group.spec.series)


def _hull(group: Group, x0: Any, x1: Any, v0: Any, v1: Any) -> tuple[Any, Any]:
    """Bounds of a motion up to ``fraction``, as far as it is a cubic: those of the hull of its ends and tangents."""
    third = (1.0 / 3.0) * (group.state["span"] * group.state["fraction"])
    early, late = fma(third, v0, x0), fma(-third, v1, x1)
    return maximum(x1, maximum(early, late)), minimum(x1, minimum(early, late))


def _look_at_storeys(group: Group, asks: Any, doubt: Cell, first: Cell) -> None:
    """Find the first changes of storeys' phases before ``fraction``, in lanes that ask."""
    # A storey's shear is one straight line in its drift while its phase lasts, so that the series goes on to hold.
    s = group.state
    for i, below in hysteresis.each_storey(group):
        phase, dy, p = s["phase", i], group.prop("yield_drift", i), s["slip", i]
        margin = fma(dy, group.limit.same_time, hysteresis.far(group, i, below) * group.limit.exact)
        v0, v1 = (group.drift(i, below, name) for name in ("v0", "v"))
        z0, z1 = (group.drift(i, below, name) - p for name in ("u0", "u"))
        elastic, drift = asks & (phase == 0.0), _drift(group, i, below, z0, 1.0)
        yields = asks & ~(phase == 0.0)

        def take(t: Any, then: Any, i: Any = i) -> None:
            sooner = t < s["turn", i]
            s.put(sooner, t, "turn", i)
            s.put(sooner, then, "then", i)

        with when_any(elastic):
            most, least = _hull(group, z0, z1, v0, v1)
            bulge = drift.bulge(s["fraction"])
            most, least = most + bulge, least - bulge
            leaves, beyond = elastic & (maximum(most, -least) > dy + margin), size(z1) > dy + margin
            # where it may turn twice, it may be beyond and back
            unseen = leaves & (v0 * v1 >= 0.0) & ~beyond
            with when_any(unseen):
                _, early, late, last = tangents(drift.rate, s["fraction"])
                twice = minimum(last * early, last * late) < 0.0  # the first rate may be none, as where it yielded
                doubt.now = doubt.now | (unseen & twice)
            with when_any(leaves):
                toward = where(v0 > 0.0, 1.0, group.full(-1.0))
                # it leaves its range on the side to which it moves first, and comes back, or stays beyond
                turns = (v0 * v1 < 0.0) & (where(v0 > 0.0, most, -least) > dy + margin)
                hops = turns & ~(toward * z1 > dy + margin)
                side = where(hops, toward, where(z1 > 0.0, 1.0, group.full(-1.0)))
                start = side * z0 - dy
                start = where(start > -margin, start - margin, start)
                lanes = leaves & (hops | beyond)
                take(_first(group, lanes, 1.0, _drift(group, i, below, start, side), doubt), side)
        with when_any(yields):
            end, last, third = s["fraction"], s["span"] * v1, (1.0 / 3.0) * s["fraction"]
            early, late = fma(third, drift.read(2) * 2.0, drift.read(1)), fma(-third, drift.rate.rate.value(end), last)
            turns = yields & (minimum(phase * last, minimum(phase * early, phase * late)) < 0.0)
            with when_any(turns):
                take(_first(group, turns, -phase, drift.rate, doubt), 0.0)
        first.now = minimum(first.now, s["turn", i])


def _place(group: Group) -> None:
    """Go to ``fraction``, of the step."""
    s, t, per = group.state, group.state["fraction"], _per(group)
    for i in group.each(group.spec.n_dof, straight=False):
        s["u", i], rate = _floor(group, i).with_slope(t)
        s["v", i] = where(s["span"] > 0.0, rate * per, s["v0", i])


def _take_contacts(group: Group) -> None:
    """Take the largest forces and penetrations of closed contacts."""
    s, r = group.state, group.asked
    for j in group.each_contact() if r & {"force", "penetration"} else ():
        closed, depth, force = (s["mode", j] > OPEN) & (s["span"] > 0.0), _depth(group, j), _force(group, j)
        with when_any(closed):
            # of the force itself, a spring's too: the same bits in the kernel of a damped law
            for reducer, most, series in (("penetration", "dmax", depth), ("force", "fmax", force)):
                if reducer in r:
                    x, rate = series.with_slope(s["fraction"])
                    s[most, j] = maximum(s[most, j], where(closed, maximum(series.read(0), x), 0.0))
                    turns = closed & (((series.read(1) > 0.0) & (rate < 0.0)) | _turns_twice(group, series))
                    with when_any(turns):
                        s[most, j] = maximum(s[most, j], where(turns, _extremes(group, turns, series)[0], 0.0))


def _extremes(group: Group, lanes: Any, series: Series) -> tuple[Any, Any]:
    """Return the largest and the least value of a series over the step, in some lanes."""
    x0, rate0 = Cell(series.read(0)), Cell(series.read(1))
    most, least, low = Cell(x0.now), Cell(x0.now), Cell(0.0 * x0.now)
    for q in count_to(PARTS, group.trace):  # beside other contacts it may turn more than once
        end = (1.0 / PARTS) * real(q + 1) * group.state["fraction"]
        x, rate = series.with_slope(end)
        turns, there = lanes & (rate0.now * rate < 0.0), Cell(x)
        with when_any(turns):
            at = newton(group, turns, low.now, end, series.rate, where(rate0.now > 0.0, -1.0, group.full(1.0)))
            there.now = where(turns, series.value(at), x)
        most.now = maximum(most.now, maximum(x, there.now))
        least.now = minimum(least.now, minimum(x, there.now))
        low.now, rate0.now = end, rate
    return most.now, least.now


def _turns_twice(group: Group, series: Series) -> Any:
    """Lanes in which a series may turn twice in the step, beside other contacts: by tangents of its rate at thirds."""
    r0, early, late, r1 = tangents(series.rate, group.state["fraction"])
    return (r0 * r1 > 0.0) & (minimum(r0 * early, r0 * late) < 0.0)


def _take_turns(group: Group) -> None:
    """Take the extremes of the motion that lie inside the step."""
    if not group.follows:
        return
    s, h = group.state, group.state["h"]
    for motion in followed(group, straight=False):
        if motion.pulls:
            continue
        x0, x1, v0, v1 = (motion.of(name) for name in ("u0", "u", "v0", "v"))
        above = (maximum(size(x0), size(x1)) if motion.sized else maximum(x0, x1)) - s[motion.most]
        if motion.least is not None:
            above = maximum(above, s[motion.least] - minimum(x0, x1))
        near = above + BULGE * h * (size(v0) + size(v1)) > 0.0
        with when_any(near):
            course = Series(lambda k: motion.of(_Term(group, k)), group.spec.series)  # noqa: B023
            asks = near & ((v0 * v1 <= 0.0) | _turns_twice(group, course))
            with when_any(asks):
                take_extremes(group, motion, asks, (*_extremes(group, asks, course), x1))


def _integrate(group: Group) -> None:
    """Add energies, work and impulse over the step (Gauss & Legendre)."""
    s, r, n = group.state, group.asked, group.spec.n_dof
    if not r & {"energy", "work", "impulse", "transfer", "links"}:
        return
    nodes, weights = np.polynomial.legendre.leggauss(NODES[group.spec.precision])
    table = Lookup(group.trace, [*(0.5 + 0.5 * nodes), *(0.5 * weights)])
    if "links" in r:
        links.clear_powers(group)
    if "transfer" in r:
        transfers.begin(group)
    per = _per(group)
    for q in count_to(len(nodes), group.trace):
        t, weight = s["fraction"] * table[q], s["h"] * table[q + len(nodes)]
        for i in group.each(n, straight=False) if r & {"energy", "transfer", "links"} else ():
            s["y", i] = _velocity(group, t)(i)
        if "links" in r:
            for i in group.each(n, straight=False):
                s["x", i] = _floor(group, i).value(t)
            links.add_powers(group, "x", "y", weight, first=False)
        if "energy" in r:
            ground = fma(t, s["g1"] - s["g0"], s["g0"])
            for b, floors in group.each_building():
                for gained, lost in powers(group, [(b, floors)], [s["y", i] for i in floors], ground):
                    s["e_in", b] = fma(weight, gained, s["e_in", b])
                    s["e_damp", b] = fma(weight, lost, s["e_damp", b])
        for j in group.each_contact() if r & {"work", "impulse", "transfer"} else ():
            closed = s["mode", j] > OPEN
            with when_any(closed):
                force = _force_at(group, j, t)
                if "transfer" in r:
                    transfers.add(group, j, force, weight)
                if "impulse" in r:
                    s["impulse", j] = fma(weight, force, s["impulse", j])
                if "work" in r:
                    s["work", j] = fma(weight, force * (_depth(group, j).rate.value(t) * per), s["work", j])
    if "links" in r:
        links.record(group, 1.0)
    if "transfer" in r:
        transfers.by_series(group, NODES[group.spec.precision], (_force_at, _velocity))


def _force_at(group: Group, j: Any, t: Any) -> Any:
    """Force of a contact at a part t of the whole step."""
    closed, found = group.state["mode", j] > OPEN, Cell(group.full(0.0))
    with when_any(closed):
        found.now = where(closed, _force(group, j).value(t), 0.0)
    return found.now


def _velocity(group: Group, t: Any) -> Callable[[Any], Any]:
    """Return what gives velocities of floors at a part t of the whole step."""
    return lambda i: _floor(group, i).rate.value(t) * _per(group)


def _take_size(group: Group, name: str, i: Any, x: Series) -> None:
    """Take the largest absolute value of a series over the step."""
    s, moves = group.state, group.state["span"] > 0.0
    most, least = _extremes(group, moves, x)
    s[name, i] = maximum(s[name, i], where(moves, maximum(most, -least), 0.0))


def _take_links(group: Group) -> None:
    """Take the forces of links over the step."""
    for j, (left, right) in group.each_link():
        k, c = group.prop("link_k", j), group.prop("link_c", j) * _per(group)
        floors = _floor(group, left), _floor(group, right)

        def pull(n: int, k: Any = k, c: Any = c, floors: Any = floors) -> Any:
            a, b = floors
            return fma(c, a.rate.read(n) - b.rate.read(n), k * (a.read(n) - b.read(n)))

        _take_size(group, "link_force", j, Series(pull, group.spec.series - 1))


def _take_accelerations(group: Group) -> None:
    """Take the total accelerations of all floors over the step."""
    s, per = group.state, _per(group)
    for i in group.each(group.spec.n_dof, straight=False):
        bend = _floor(group, i).rate.rate

        def total(k: int, bend: Series = bend) -> Any:
            found = bend.read(k) * (per * per)
            return found + (s["g0"], s["g1"] - s["g0"])[k] if k < 2 else found

        _take_size(group, "acc", i, Series(total, bend.order))
