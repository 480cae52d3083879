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

from collections.abc import Callable
from typing import Any

import numpy as np

from pounding_sweep.kernel import forces, located, series_yielding
from pounding_sweep.kernel.forces import MAX_TRIES, NEVER, OPEN, PRESSING, REBOUND, SLACK
from pounding_sweep.kernel.group import Group, part_of
from pounding_sweep.kernel.lanes import (
    Cell,
    Table,
    any_lane,
    count_to,
    fma,
    maximum,
    minimum,
    not_,
    power,
    real,
    size,
    when,
    when_any,
    where,
    while_any,
)
from pounding_sweep.kernel.peaks import Motion, followed, septic_extreme, take_extremes
from pounding_sweep.kernel.roots import Series, newton
from pounding_sweep.kernel.row import accelerations, powers, pushes

#: Largest last term of a series beside its first ones, in both number formats.
LEFT_OUT = {"float64": 1e-14, "float32": 2e-7}
#: Nodes of the quadrature of powers over a step, in both number formats.
NODES = {"float64": 6, "float32": 4}
#: Most that a motion leaves its ends by, in its rates there times the step.
BULGE = 0.2


def _is_product(group: Group) -> bool:
    """Whether dampers grow with the penetration."""
    law = group.spec.law
    return law is not None and bool(law.damper) and law.damper_exponent == 1.0


def substep(group: Group, h: Any) -> None:
    """One sub-step of every lane that has some of its step of length h left: to the first event, at most."""
    s = group.state
    located.look_ahead(group, h)
    _expand(group)
    _meet(group)
    _go(group)
    _take_contacts(group)
    _take_turns(group)
    _integrate(group)
    if "acceleration" in group.asked:
        _take_accelerations(group)
    s["tries"] = s["tries"] + s["taken"]
    located.close(group, forces, h)


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
    s, n = group.state, group.spec.n_dof
    if group.long:
        _expand_in_rounds(group)
    else:
        x, y, ground = group.floors("u0"), group.floors("v0"), [s["g0"], s["g1"] - s["g0"]]
        row = list(enumerate(group.building_floors))
        for k in range(group.spec.series):
            held = [_press(group, j, k, x, y, 1.0 if k == 0 else 0.0) for j in range(contacts)]
            now = ground[k] if k < 2 else group.full(0.0)
            a = accelerations(group, row, x, y, now, pushes(group, held), k == 0)
            per = s["h"] * (1.0 / (k + 1.0))
            x, y = [each * per for each in y], [each * per for each in a]
            for i in range(n):
                s["jet", (k + 1) * n + i] = x[i]


class _Term:
    """One coefficient of all floors."""

    def __init__(self, group: Group, k: Any) -> None:
        self._state, self._first = group.state, k * group.spec.n_dof

    def __getitem__(self, i: Any) -> Any:
        return self._state["jet", i + self._first]


def _press(group: Group, j: Any, k: Any, x: Any, y: Any, gaps: Any) -> Any:
    """Coefficient k of a contact's force; `x` and `y` are those of the floors' motion, `gaps` times gaps are taken."""
    s, nc = group.state, len(group.contacts)
    assert group.law is not None
    d, w = group.between(x, j), group.between(y, j)
    if not isinstance(gaps, float) or gaps:
        d = d - gaps * group.gap(j)
    s["dj", j + k * nc] = d
    if not group.law.shape.damper:
        f = s["ke", j] * d
    elif not _is_product(group):
        f = fma(s["ke", j], d, s["ce", j] * w)
    else:
        s["wj", j + k * nc] = w
        total = Cell(group.full(0.0))
        for i in range(k + 1) if isinstance(k, int) else count_to(k + 1, group.trace):
            total.now = fma(s["dj", j + i * nc], s["wj", j + (k - i) * nc], total.now)
        f = fma(s["ke", j], d, s["ce", j] * total.now)
    s["fj", j + k * nc] = f
    return f


def _expand_in_rounds(group: Group) -> None:
    """Find coefficient after coefficient at run time, of a long row."""
    s, n = group.state, group.spec.n_dof
    for i in group.each(n):
        s["x", i], s["y", i] = s["u0", i], s["v0", i]
    now, later, gaps = Cell(s["g0"]), Cell(s["g1"] - s["g0"]), Cell(group.full(1.0))
    for k in count_to(group.spec.series, group.trace):
        for i in group.each(n):
            s["push", i] = 0.0
        for j in group.each_contact():
            force = _press(group, j, k, "x", "y", gaps.now)
            for floor, sign, share in group.ends(j):
                before, part = s["push", floor], part_of(force, share)
                s["push", floor] = before - part if sign == "-" else before + part
        per = s["h"] * (1.0 / real(k + 1))
        for b, floors in group.each_building():
            x, y = [s["x", i] for i in floors], [s["y", i] for i in floors]
            push = [[("+", s["push", i])] for i in floors]
            a = accelerations(group, [(b, floors)], x, y, now.now, push, gaps.now)
            for i, yi, ai in zip(floors, y, a, strict=True):
                s["jet", i + (k + 1) * n] = s["x", i] = yi * per
                s["y", i] = ai * per
        now.now, later.now, gaps.now = later.now, group.full(0.0), group.full(0.0)


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
    return Series(lambda k: s["fj", j + k * nc], group.spec.series - 1)


def _peak(group: Group, asks: Any, series: Series) -> Any:
    """Return the largest value of a series whose rate falls through zero in the step, in lanes that ask."""
    t = newton(group, asks, 0.0, group.state["fraction"], series.rate, -1.0)
    return series.value(t)


def _meet(group: Group) -> None:
    """Find the first instant at which contacts change their modes: ``fraction``, of the step."""
    s = group.state
    ongoing = s["time_left"] > 0.0
    s["taken"] = where(ongoing, 1.0, 0.0 * s["h"])
    s["fraction"] = group.full(1.0)
    for j in group.each_contact():
        s["event", j], s["next", j] = group.full(NEVER), s["mode", j]
        _converge(group, j)
    if group.spec.yielding:
        series_yielding.begin(group)
        series_yielding.place(group)
    events = len(group.contacts) + len(group.spec.yielding)
    going = Cell(ongoing & (s["tries"] < MAX_TRIES))
    # what comes first is guessed, and looked for again before what was found where more may happen
    for _ in while_any(lambda: going.now, group.trace, at_most=4 * events):
        found, more = _choose(group, going.now)
        going.now = found & more
        with when_any(found):
            before = s["fraction"]
            _locate(group, found)
            if group.spec.yielding:  # a storey that does not yield to one side may to the other
                going.now = found & (more | ~(s["fraction"] < before))
                series_yielding.place(group)
    s["land"] = where(s["fraction"] < 1.0, 1.0, 0.0)


def _converge(group: Group, j: Any) -> None:
    """End the step where the last term of a closed contact's series is that of rounding."""
    s, depth, order = group.state, _depth(group, j), group.spec.series
    large = maximum(maximum(size(depth.read(0)), size(depth.read(1))), size(depth.read(2)))
    left_out = series_yielding.LEFT_OUT if group.spec.yielding else LEFT_OUT
    most, last = left_out[group.spec.precision] * large, size(depth.read(order))
    short = (s["mode", j] > OPEN) & (last > most)
    with when_any(short):
        s["fraction"] = where(short, minimum(s["fraction"], power(most / last, 1.0 / order)), s["fraction"])


class _Choice:
    """The event that seems to come first, in each lane; its series in ``pick``."""

    def __init__(self, group: Group) -> None:
        self.group, nobody = group, group.lanes_where(False)
        self.soonest, self.more, self.found = Cell(group.full(NEVER)), Cell(nobody), Cell(nobody)
        group.state["bends"] = 0.0

    def _reach(self, early: Any, late: Any, e0: Any, e1: Any) -> Any:
        """How far it may go between its ends, by its tangents there: where storeys yield, as a cubic may."""
        if not self.group.spec.yielding:
            return minimum(early, late)
        return maximum(e0 + (1.0 / 3.0) * (early - e0), e1 + (1.0 / 3.0) * (late - e1))

    def offer(self, number: Any, lanes: Any, sign: Any, series: Series, target: Any, crosses: Any = True) -> None:
        """Consider that sign times a series turns positive: by the end where it `crosses`, or in between."""
        s, end = self.group.state, self.group.state["fraction"]
        e0, r0, e1, r1 = (sign * x for x in (series.read(0), series.read(1), series.value(end), series.rate.value(end)))
        crosses = (e1 > 0.0) & crosses
        hops = ~crosses & (r0 > 0.0) & (r1 < 0.0) & (self._reach(e0 + end * r0, e1 - end * r1, e0, e1) > 0.0)
        rises = crosses & (r0 < 0.0) & (r1 > 0.0)  # the other way first: it may begin at its event
        lanes = lanes & (crosses | hops)
        with when_any(lanes):
            low = minimum(e0, 0.0)
            guess = where(crosses, end * (low / (low - e1)), 0.5 * end)
            guess = where(guess >= 0.0, guess, 0.0)
            self.more.now = self.more.now | (lanes & self.found.now)
            self.found.now = self.found.now | lanes
            better = lanes & (guess < self.soonest.now)
            self.soonest.now = where(better, guess, self.soonest.now)
            for k in range(self.group.spec.series + 1):
                term = sign * series.read(k) if k <= series.order else 0.0
                s["pick", k] = where(better, term, s["pick", k])
            s["picked"], s["aim"] = where(better, real(number), s["picked"]), where(better, target, s["aim"])
            s["bends"] = where(better, where(hops, -1.0, where(rises, 1.0, 0.0 * e0)), s["bends"])


def _choose(group: Group, asks: Any) -> tuple[Any, Any]:
    """Find the lanes in which something may change before ``fraction``, and those in which more than one may."""
    s, choice = group.state, _Choice(group)
    per = where(s["span"] > 0.0, 1.0 / s["span"], 0.0)
    for j in group.each_contact():
        if not group.spec.yielding:
            _offer_contact(group, choice, j, asks, per)
            continue
        mine = asks & ((s["mode", j] > OPEN) | series_yielding.may_touch(group, j))
        with when_any(mine):
            _offer_contact(group, choice, j, mine, per)
    if group.spec.yielding:
        series_yielding.offer(group, asks, choice)
    return choice.found.now, choice.more.now


def _offer_contact(group: Group, choice: _Choice, j: Any, asks: Any, per: Any) -> None:
    """Consider the changes of a contact's mode, in lanes that ask."""
    s, law, depth = group.state, group.law, _depth(group, j)
    assert law is not None

    def offer(lanes: Any, sign: Any, series: Series, target: Any, crosses: Any = True) -> None:
        choice.offer(j, lanes & ~(s["next", j] == target), sign, series, target, crosses)

    mode = s["mode", j]
    closed, pressing = mode > OPEN, mode == PRESSING
    sign = where(closed, -1.0, group.full(1.0))
    # else a closed contact has touched but for a rounding error, and goes on
    leaves = (depth.read(0) > 0.0) | (depth.rate.value(s["fraction"]) <= 0.0) | ~closed
    offer(asks, sign, depth, where(closed, OPEN, group.full(PRESSING)), leaves)
    if law.shape.approach_only:
        toward = where(pressing, -1.0, group.full(1.0))
        offer(asks & closed, toward, depth.rate, where(pressing, REBOUND, group.full(PRESSING)))
    if law.shape.clips:
        k, c = s["kl", j], s["cl", j] * per
        press = Series(_pressing(group, depth, k, c), depth.order - 1)
        toward, target = where(pressing, -1.0, group.full(1.0)), where(pressing, SLACK, group.full(PRESSING))
        offer(asks & closed & (c > 0.0), toward, press, target)


def _pressing(group: Group, depth: Series, k: Any, c: Any) -> Callable[[int], Any]:
    """Coefficients of what the sign of a force follows, of a contact that may be slack: of k d + c d d' without d."""

    def read(n: int) -> Any:
        damped = c * depth.rate.read(n)
        if _is_product(group):
            return k + damped if n == 0 else damped
        return fma(k, depth.read(n), damped)

    return read


def _locate(group: Group, found: Any) -> None:
    """Find when the chosen event happens; what does not is not asked for again."""
    s = group.state
    pick, end, bends = Series(lambda k: s["pick", k], group.spec.series), s["fraction"], s["bends"]
    s["low"], s["high"], happens = group.full(0.0), end, Cell(found)
    with when_any(found & ~(bends == 0.0)):
        extreme = newton(group, found & ~(bends == 0.0), 0.0, end, pick.rate, bends)
        turns = bends < 0.0
        s["low"], s["high"] = where(bends > 0.0, extreme, s["low"]), where(turns, extreme, s["high"])
        happens.now = found & ~(turns & (pick.value(extreme) <= 0.0))
    t = newton(group, happens.now, s["low"], s["high"], pick, 1.0)
    s["fraction"] = where(happens.now, t, end)
    for j in group.each_contact():
        mine = found & (s["picked"] == real(j))
        s["event", j] = where(mine & happens.now, t, s["event", j])
        s["next", j] = where(mine, s["aim"], s["next", j])
    if group.spec.yielding:
        series_yielding.keep(group, found, happens.now, t)


def _go(group: Group) -> None:
    """Go to the end of the step, or to the event that ends it."""
    s, t = group.state, group.state["fraction"]
    moves = s["span"] > 0.0
    per = where(moves, 1.0 / s["span"], 0.0)
    s["h"] = s["span"] * t
    if group.spec.yielding:  # it is there
        return
    for i in group.each(group.spec.n_dof, straight=False):
        floor = _floor(group, i)
        s["u", i] = floor.value(t)
        s["v", i] = where(moves, floor.rate.value(t) * per, s["v0", i])


def _take_contacts(group: Group) -> None:
    """Take forces and penetrations of closed contacts at the ends of the step and between them."""
    s, r, t = group.state, group.asked, group.state["fraction"]
    needs_force, needs_ends = "force" in r, group.looks("ends")
    moves = s["span"] > 0.0
    for j in group.each_contact() if needs_force or needs_ends or "penetration" in r else ():
        closed, depth, force = (s["mode", j] > OPEN) & moves, _depth(group, j), _force(group, j)
        for name in ("f0", "f1", "q0", "q1") if needs_ends else ():
            s[name, j] = 0.0
        with when_any(closed):
            for name, series in (("dmax", depth), ("fmax", force)):
                if ("penetration" if name == "dmax" else "force") not in r:
                    continue
                x1, r1 = series.value(t), series.rate.value(t)
                most = maximum(s[name, j], where(closed, maximum(series.read(0), x1), 0.0))
                s[name, j] = most
                between = closed & (series.read(1) > 0.0) & (r1 < 0.0)
                with when_any(between):
                    s[name, j] = maximum(most, where(between, _peak(group, between, series), 0.0))
            if needs_ends:
                per = where(moves, 1.0 / s["span"], 0.0)
                s["f0", j], s["f1", j] = force.read(0), force.value(t)
                s["q0", j], s["q1", j] = force.read(1) * per, force.rate.value(t) * per


def _take_turns(group: Group) -> None:
    """Take the extremes of the motion that lie inside the step."""
    if not group.follows:
        return
    s, t, h = group.state, group.state["fraction"], group.state["h"]

    def asks(motion: Motion) -> Any:
        x0, x1, v0, v1 = (motion.of(name) for name in ("u0", "u", "v0", "v"))
        above = (maximum(size(x0), size(x1)) if motion.sized else maximum(x0, x1)) - s[motion.most]
        if motion.least is not None:
            above = maximum(above, s[motion.least] - minimum(x0, x1))
        return (v0 * v1 <= 0.0) & (above + BULGE * h * (size(v0) + size(v1)) > 0.0)

    per = where(s["span"] > 0.0, 1.0 / s["span"], 0.0)
    for i in group.each(group.spec.n_dof, straight=False):
        bend, per2 = _floor(group, i).rate.rate, per * per
        for name, x in (("a", bend), ("j", bend.rate)):
            s[f"{name}0", i], s[f"{name}1", i] = x.read(0) * per2, x.value(t) * per2
            per2 = per2 * per
    for motion in followed(group, straight=False):
        with when_any(turned := asks(motion)):
            x0, x1, v0, v1 = (motion.of(name) for name in ("u0", "u", "v0", "v"))
            c0, c1 = (h * h * motion.of(name) for name in ("a0", "a1"))
            j0, j1 = (h * h * h * motion.of(name) for name in ("j0", "j1"))
            inner = septic_extreme((x0, h * v0, c0, j0), (x1, h * v1, c1, j1))
            take_extremes(group, motion, turned, (where(v0 * v1 < 0.0, inner, x1), x0, x1))


def _integrate(group: Group) -> None:
    """Add energies, work and impulse over the step (Gauss & Legendre)."""
    s, r, n = group.state, group.asked, group.spec.n_dof
    if not r & {"energy", "work", "impulse"}:
        return
    nodes, weights = np.polynomial.legendre.leggauss(NODES[group.spec.precision])
    table = Table(group.trace, [*(0.5 + 0.5 * nodes), *(0.5 * weights)])
    per = where(s["span"] > 0.0, 1.0 / s["span"], 0.0)
    for q in count_to(len(nodes), group.trace):
        t, weight = s["fraction"] * table[q], s["h"] * table[q + len(nodes)]
        if "energy" in r:
            for i in group.each(n, straight=False):
                s["y", i] = _floor(group, i).rate.value(t) * per
            ground = fma(t, s["g1"] - s["g0"], s["g0"])
            for b, floors in group.each_building():
                for gained, lost in powers(group, [(b, floors)], [s["y", i] for i in floors], ground):
                    s["e_in", b] = fma(weight, gained, s["e_in", b])
                    s["e_damp", b] = fma(weight, lost, s["e_damp", b])
        for j in group.each_contact() if r & {"work", "impulse"} else ():
            force = _force(group, j).value(t)
            if "impulse" in r:
                s["impulse", j] = fma(weight, force, s["impulse", j])
            if "work" in r:
                s["work", j] = fma(weight, force * (_depth(group, j).rate.value(t) * per), s["work", j])


def _take_accelerations(group: Group) -> None:
    """Take the total accelerations of all floors over the step."""
    s, t = group.state, group.state["fraction"]
    moves = s["span"] > 0.0
    per = where(moves, 1.0 / s["span"], 0.0)
    for i in group.each(group.spec.n_dof, straight=False):
        bend = _floor(group, i).rate.rate

        def total(k: int, bend: Series = bend) -> Any:
            found = bend.read(k) * (per * per)
            return found + (s["g0"], s["g1"] - s["g0"])[k] if k < 2 else found

        shake = Series(total, bend.order)
        early, late = shake.read(0), shake.value(t)
        r0, r1 = shake.read(1), shake.rate.value(t)
        s["acc", i] = maximum(s["acc", i], where(moves, maximum(size(early), size(late)), 0.0))
        sign = where(r0 > 0.0, -1.0, group.full(1.0))
        turns = moves & (r0 * r1 < 0.0)
        with when_any(turns):
            at = newton(group, turns, 0.0, t, shake.rate, sign)
            s["acc", i] = maximum(s["acc", i], where(turns, size(shake.value(at)), 0.0))
