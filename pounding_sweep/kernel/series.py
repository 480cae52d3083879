"""Steps beside contacts whose forces are polynomials of the motion: series in time.

While no contact changes its mode, and the ground acceleration is linear, the motion of a row whose contacts press by
F = k d + c d', or by k d + c d d', is analytic: u(t) = sum over n of U_n (t / h)**n follows from the equation of motion
by comparing powers (Moore 1966; Corliss & Chang 1982). Events, peaks and the motion at any instant are read from it.
Rows with storeys of Bouc and Wen go by series all along.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import nullcontext
from functools import partial, reduce
from itertools import chain, count
from operator import add
from typing import Any

import numpy as np

from pounding_sweep.kernel import forces, hysteresis, links, march, transfers
from pounding_sweep.kernel.forces import MAX_TRIES, OPEN, PRESSING, REBOUND, SLACK
from pounding_sweep.kernel.group import Contact, Element, Group, Spring, StoreySpring
from pounding_sweep.kernel.peaks import followed, take_extremes
from pounding_sweep.kernel.roots import NEVER, Series, newton, tangents, turn
from pounding_sweep.kernel.row import Pushes, accelerations, iter_powers, powers
from pounding_sweep.kernel.types import Index, Instant, Lanes, Truths
from pounding_sweep.lanes import (
    Cell,
    Lookup,
    any_lane,
    count_to,
    fma,
    lane_of,
    maximum,
    minimum,
    not_,
    once_if,
    real,
    roughly_power,
    rounded,
    side_by_side,
    size,
    when_any,
    where,
    while_any,
)
from pounding_sweep.model.storeys import DriftGauge, SignGauge, law_of

#: Largest last term of a series beside its first ones, in both number formats.
LEFT_OUT = {"float64": 5e-12, "float32": 1e-6}
#: The same where storeys yield.
LEFT_OUT_YIELDING = {"float64": 1e-11, "float32": 2e-7}
#: Nodes of the quadrature of powers over a step, in both number formats.
NODES = {"float64": 6, "float32": 4}
#: Most that a motion leaves its ends by, in its rates there times the step.
BULGE = 0.2
#: Newton's rounds to where a motion turns, in both number formats, at least.
TURNS = {"float64": 3, "float32": 2}
#: Parts of a step in which extremes of motions are looked for.
PARTS = 4
#: Most halvings of a step in which an event may hide, and its part after which none is sought.
HALVINGS = 6
HALVED = 0.5**HALVINGS
#: Kinds of changes of a contact or by a gauge of a spring, at most.
KINDS = 3
#: Terms by which an open contact may touch in a step, the last counted twice for all that follow.
SEEN = 7
#: Where a step ends if floors that part bend back, over when a parabola is at its start again; its least part, if cut.
PAST, SOONEST = -1.5, 1e-3


def declare_rows(group: Group) -> None:
    """Declare coefficients of motions, penetrations and forces, and what is known of events."""
    spec, declare, terms = group.spec, partial(group.declare, passing=True), group.spec.series + 1
    contacts, springs = len(spec.contacts), len(spec.hysteretic)
    if spec.series:
        declare(spec.n_moving, "x", "y", "push")
        declare(spec.n_moving * terms, "taylor_u")
        declare(contacts * terms, "taylor_pen", "taylor_force", "taylor_pen_rate")
        declare(terms, "event_poly")
        declare(1, "span", "event_number", "event_target", "low", "high", "bends")
        declare(KINDS * (1 + bool(spec.limited)) * (contacts + springs), "ruled_out")
        declare(spec.n_buildings if "transfer" in group.requested else 0, "swing")
    for _, name, compiled in spec.hysteretic if spec.series and spec.flowing else ():
        law: Any = law_of(name, compiled)
        own = {} if law.straight else law.series_rows(compiled, spec.series)
        for row, many in {"taylor_slip": terms, "event_row": 1, "event_sign": 1, **own}.items():
            declare(springs * many, row)


def substep(group: Group, h: Lanes) -> None:
    """One sub-step of every lane that has some of its step of length h left: to the first event, at most."""
    march.look_ahead(group, h)
    s, spec = group.state, group.spec
    s["span"] = s["h"]
    for i in group.indices(spec.n_moving):
        s["taylor_u", i] = s["u0", i]
    for e in range(len(spec.hysteretic) if spec.flowing else 0):
        s["taylor_slip", e] = s["slip0", e]
    if spec.yielding and group.touching and not group.looped:  # while storeys yield, contacts are open as a rule
        closed = any_lane(forces.is_closed(group))
        for case, contacts in ((closed, True), (not_(closed), False)):
            for _ in once_if(case):
                _expand_row(group, contacts)
    else:
        _expand_row(group, group.touching)
    for contact in group.iter_contacts() if not (spec.yielding or group.looped) else ():
        _coefficients(contact, "taylor_pen")[spec.series] = contact.between(_Term(group, spec.series))
    if group.skips:
        _mark_contacts(group)
    _find_event(group)
    s["h"] = s["span"] * s["fraction"]
    if not spec.yielding:
        _place(group)
    _take_contacts(group)
    _take_turns(group)
    if "link_force" in group.requested:
        _take_links(group)
    _integrate(group)
    if "acceleration" in group.requested:
        _take_accelerations(group)
    march.close(group, forces, h)


def _mark_contacts(group: Group) -> None:
    """Mark the contacts that are closed or may touch in the step, and find what is missing of their penetrations."""
    s, order = group.state, group.spec.series
    for contact in group.iter_contacts():
        depths, closed, d = _coefficients(contact, "taylor_pen"), contact.mode > OPEN, contact.penetration("u0")
        bends = [size(_stretched(contact, k)) for k in range(2, SEEN)]
        farthest = reduce(add, bends, d + maximum(_stretched(contact, 1), 0.0)) + bends[-1]
        active = (s["time_left"] > 0.0) & (closed | (farthest > 0.0))
        contact.may_change = where(active, 1.0, 0.0)
        with when_any(active):
            depths[order] = _stretched(contact, order)
            for _ in once_if(not_(any_lane(closed))):
                depths[0] = d
                for k in count_to(order - 1):
                    depths[k + 1] = _stretched(contact, k + 1)


def _expand_row(group: Group, contacts: bool) -> None:
    """Find the coefficients of all floors, and if need be of contacts' penetrations and forces."""
    inverse = Lookup([1.0 / (k + 1.0) for k in range(group.spec.series)])
    rises = group.cell(1.0)
    _expand_term(group, contacts, 0, group.ground.at(0.0), inverse)
    for q in count_to(group.spec.series - 1):  # written out for each, it would not fit into caches
        _expand_term(group, contacts, q + 1, lambda b: rises.now * group.ground.rise(b), inverse)
        rises.now = 0.0


def _expand_term(group: Group, contacts: bool, k: Index, ground: Instant, inverse: Lookup) -> None:
    """Find coefficient k + 1 of all floors from coefficient k of displacements, and of velocities in ``y``."""
    x, push = _Term(group, k), Pushes(group)
    for contact in group.iter_contacts(straight=True) if contacts else ():
        with when_any(contact.mode > OPEN) if group.looped else nullcontext():
            push.add(contact, _press(contact, k, x))
    push.add_links(x, x.rates)
    hysteresis.begin_term(group, k, x)
    s, n, per = group.state, group.spec.n_moving, group.state["h"] * inverse[k]
    for part in group.iter_parts():  # numbers are read building by building: there is room for few
        moving = part.dofs
        moved, sped = [x[i] for i in moving], [s[x.rates, i] for i in moving]
        a = accelerations(group, part, moved, sped, ground, push.on(moving), x.constant)
        for i, yi, ai in zip(moving, sped, a, strict=True):
            s["taylor_u", i + (k + 1) * n] = yi * per
            s["y", i] = ai * per
    hysteresis.end_term(group, k, x, per)


class _Term:
    """One coefficient of all floors."""

    def __init__(self, group: Group, k: Index) -> None:
        #: Where rows of the coefficient begin.
        self.order, self.begin = k, k * group.spec.n_moving
        self._state = group.state
        #: Whether what follows from it has the constants that rates are without.
        self.constant = isinstance(k, int) and k == 0
        #: Rows of the same coefficient of velocities, while coefficients are found.
        self.rates = "v0" if self.constant else "y"

    def __getitem__(self, i: Index) -> Lanes:
        return self._state["taylor_u", i + self.begin]


class _Coefficients:
    """Coefficients of a contact or a floor, in rows of the state."""

    def __init__(self, group: Group, name: str, i: Index, many: int) -> None:
        self._state, self._name, self._i, self._many = group.state, name, i, many

    def __getitem__(self, k: Index) -> Lanes:
        return self._state[self._name, self._i + k * self._many]

    def __setitem__(self, k: Index, x: Lanes) -> None:
        self._state[self._name, self._i + k * self._many] = x


def _coefficients(contact: Contact, name: str) -> _Coefficients:
    return _Coefficients(contact.group, name, contact.index, len(contact.group.contacts))


def _press(contact: Contact, k: Index, x: _Term) -> Lanes:
    """Coefficient k of a contact's force, of the floors' motion `x`."""
    depths, d, w = _coefficients(contact, "taylor_pen"), contact.between(x), contact.between(x.rates)
    if x.constant:
        d = d - contact.gap
    depths[k] = d
    if not contact.law.shape.damper:
        return contact.k_active * d
    if not contact.law.shape.is_product:
        f = fma(contact.k_active, d, contact.c_active * w)
    else:
        rates, total = _coefficients(contact, "taylor_pen_rate"), contact.group.cell(0.0)
        rates[k] = w
        for i in range(k + 1) if isinstance(k, int) else count_to(k + 1):
            total.now = fma(depths[i], rates[k - i], total.now)
        f = fma(contact.k_active, d, contact.c_active * total.now)
    _coefficients(contact, "taylor_force")[k] = f
    return f


def _floor(group: Group, i: Index) -> Series:
    """Displacement of a floor."""
    return Series(_Coefficients(group, "taylor_u", i, group.spec.n_moving).__getitem__, group.spec.series)


def _slip(spring: StoreySpring) -> Series:
    """Plastic drift of a spring that flows."""
    return Series(partial(spring.term, "taylor_slip"), spring.group.spec.series)


def _depth(contact: Contact) -> Series:
    """Penetration of a contact."""
    group = contact.group

    def read(k: int) -> Lanes:
        return _stretched(contact, k) if k else _stretched(contact, k) - contact.gap

    return Series(read if group.spec.yielding else _coefficients(contact, "taylor_pen").__getitem__, group.spec.series)


def _force(contact: Contact) -> Series:
    """Force of a contact, while its mode lasts."""
    damped, depths = contact.law.shape.damper, _coefficients(contact, "taylor_pen")
    read: Any = _coefficients(contact, "taylor_force").__getitem__ if damped else lambda k: contact.k_active * depths[k]
    return Series(read, contact.group.spec.series - 1)


def _per(group: Group) -> Lanes:
    """Inverse of the length of the whole step, zero in lanes that wait."""
    span = group.state["span"]
    return where(span > 0.0, 1.0 / span, 0.0)


def _find_event(group: Group) -> None:
    """Find the first instant at which contacts change their modes: ``fraction``, of the step."""
    s = group.state
    ongoing = s["time_left"] > 0.0
    s["accepted"] = where(ongoing, 1.0, 0.0)
    s["fraction"] = group.full(1.0)
    for contact in group.iter_contacts():
        contact.event, contact.next = group.full(NEVER), contact.mode
        if group.spec.yielding:
            contact.may_change = group.full(1.0)
    for spring in group.iter_springs(straight=False):
        spring.turn, spring.then = group.full(NEVER), group.full(0.0)
    for _, numbers, _ in _changes(group):
        for number in numbers:
            s["ruled_out", number] = 0.0
    _converge(group)
    s["fraction"] = maximum(s["fraction"], SOONEST)  # of what rests, no first term tells the size
    for spring in hysteresis.flowing(group):
        signs = [gauge.sign for gauge in spring.law.gauges(spring)]
        rests = ongoing & (signs[0] == 0.0) & (spring.drift("v0") == 0.0)
        with when_any(rests):  # the first instants of its motion tell its signs
            moves = rests & ~(_drift(spring, spring.drift("u0"), 1.0).value(1.0) == 0.0)
            s.put(moves, SOONEST, "fraction")
    if group.spec.yielding:
        _place(group)
    events = len(group.contacts) + len(group.spec.hysteretic)
    active, ends = Cell(ongoing & (s["tries"] < MAX_TRIES)), group.cell(False)
    # what comes first is guessed, and looked for again before what was found, where what did not show at the end may
    for _ in while_any(lambda: active.now, at_most=4 * events + HALVINGS):
        choice = _choose(group, active.now)
        doubt = choice.doubt.now
        located = choice.located.now & ~doubt
        active.now = doubt | (located & (choice.several.now | ends.now))
        ends.now |= located
        with when_any(doubt | located):
            s["fraction"] = where(doubt, 0.5 * s["fraction"], s["fraction"])
            _locate(group, located)
            if group.spec.yielding:
                _place(group)
    s["land"] = where(s["fraction"] < 1.0, 1.0, 0.0)


def _changes(group: Group) -> Iterator[tuple[Element | StoreySpring, list[Index], tuple[str, str]]]:
    """Go through contacts and storeys: numbers of kinds of changes, and rows of when and to what one changes."""
    # of a contact, of its penetration's sign, and of that of its rate or its force
    for contact in group.iter_contacts():
        law = contact.law.shape
        kinds = 2 if law.approach_only or law.clips else 1
        yield contact, [group.change(contact.index, kind) for kind in range(kinds)], ("event", "next")
    for spring in group.iter_springs(straight=False):
        yield spring, list(chain(*_kinds(spring))), ("turn", "then")


def _kinds(spring: StoreySpring) -> list[list[Index]]:
    """Numbers of the changes of each gauge of a spring: its drift leaves a range above, below, turns; or a kink."""
    first, kinds, counts = spring.number + len(spring.group.contacts), count(), []
    for gauge in hysteresis.gauges(spring):
        counts.append([spring.group.change(first, next(kinds)) for _ in range(1 + 2 * isinstance(gauge, DriftGauge))])
    return counts


def _converge(group: Group) -> None:
    """End the step where series leave out more than their share, or floors that part come back."""
    # Those may touch again and be gone by the end of a longer step, which its ends do not tell. Least quotients are two
    # numbers each: divisions of lanes take long.
    s, n, order, yielding = group.state, group.spec.n_moving, group.spec.series, group.spec.yielding
    share = (LEFT_OUT_YIELDING if yielding else LEFT_OUT)[group.spec.precision]
    most, last, parts, bends = (group.cell(x) for x in (1.0, 1.0, 1.0, -PAST))

    def take(first: Lanes, term: Lanes) -> None:
        allowed, left_out = share * first, size(term)
        less = left_out * most.now > allowed * last.now
        most.now, last.now = where(less, allowed, most.now), where(less, left_out, last.now)

    for contact in _active(group, straight=True):
        depth = _depth(contact)
        d, v, bend = (depth.read(k) for k in range(3))
        take(reduce(maximum, map(size, (d, v, bend))), depth.read(order))
        returns = (contact.mode == OPEN) & (v < 0.0) & (bend > 0.0) & (d + v + bend > 0.0)
        sooner = returns & (parts.now * bend > -v * bends.now)
        parts.now, bends.now = where(sooner, -v, parts.now), where(sooner, bend, bends.now)
    for i in group.indices(n, straight=False) if yielding else ():
        # the fourth of them too: a floor at rest begins with the ground's ramp
        take(reduce(maximum, [size(s["taylor_u", i + k * n]) for k in range(4)]), s["taylor_u", i + order * n])
    for spring in hysteresis.flowing(group):
        take(spring.yield_drift, _slip(spring).read(order))
    short = last.now > most.now
    with when_any(short):
        s["fraction"] = where(short, roughly_power(most.now / last.now, 1.0 / order), s["fraction"])
    s["fraction"] = minimum(s["fraction"], -PAST * parts.now / bends.now)


class _Choice:
    """The event that seems to come first, in each lane; its series in ``event_poly``."""

    def __init__(self, group: Group) -> None:
        self.group, nobody = group, group.full(False)
        self.soonest, self.located = group.cell(NEVER), Cell(nobody)
        #: Lanes in which the step is too long to tell.
        self.doubt = Cell(nobody)
        #: Lanes in which some change may come, and several may: then others than the one that is chosen.
        self._some, self.several = Cell(nobody), Cell(group.full(bool(group.spec.flowing)))
        for row in ("bends", *(["event_row"] if group.spec.flowing else [])):
            group.state[row] = group.full(0.0)

    def expect(self, lanes: Truths) -> None:
        """Take note that a change may come in some lanes."""
        self.several.now |= self._some.now & lanes
        self._some.now |= lanes

    def propose(
        self, number: Index, lanes: Truths, sign: Lanes, series: Series, target: Lanes, leans: Truths = None
    ) -> Truths:
        """Consider that sign times a series turns positive, by the end or before; where it `leans`, if it rises yet.

        Returns the lanes in which it stays negative, however much of the step is looked at.
        """
        group, s, end = self.group, self.group.state, self.group.state["fraction"]
        e0, r0, e1, r1 = (sign * x for x in (series.read(0), series.read(1), *series.with_slope(end)))
        crosses = e1 > 0.0
        if leans is not None:
            crosses = crosses & (~leans | (r1 >= 0.0))
        # as far as it is a cubic, no farther than its tangents at thirds
        third, bulge = (1.0 / 3.0) * end, series.bulge(end)
        reach = maximum(fma(third, r0, e0), fma(-third, r1, e1)) + bulge
        hops = lanes & ~crosses & (r0 > 0.0) & (r1 < 0.0) & (reach > 0.0)
        # one that turns twice may have been positive before: half the step tells
        above = (r0 > 0.0) & ~(r1 < 0.0) & (crosses | (fma(end, r0, e0) > 0.0))
        below = (r0 < 0.0) & ~(r1 > 0.0) & ~crosses & (fma(-end, r1, e1) > 0.0)
        unseen = lanes & (above | below) & (end > HALVED)
        with when_any(unseen):
            bends = sign * r0 * series.rate.value(0.5 * end) < 0.0
            self.doubt.now |= unseen & (bends | _turns_twice(group, series))
        rises = crosses & (r0 < 0.0) & (r1 > 0.0)  # the other way first: it may begin at its event
        lanes = lanes & (crosses | hops)
        with when_any(lanes):
            low = minimum(e0, 0.0)
            guess = where(crosses, end * (low / (low - e1)), 0.5 * end)
            guess = where(guess >= 0.0, guess, 0.0)
            self.located.now |= lanes
            better = lanes & (guess < self.soonest.now)
            self.soonest.now = where(better, guess, self.soonest.now)
            for k in range(group.spec.series + 1):
                term = sign * series.read(k) if k <= series.order else 0.0
                s["event_poly", k] = where(better, term, s["event_poly", k])
            by_row = [("event_row", 0.0)] if group.spec.flowing else []
            for row, x in (("event_number", number), ("event_target", target), *by_row):
                s[row] = where(better, x, s[row])
            s["bends"] = where(better, where(hops, -1.0, where(rises, 1.0, 0.0)), s["bends"])
        return maximum(reach, e1 + bulge) < 0.0


def _choose(group: Group, asks: Truths) -> _Choice:
    """Find what may change first before ``fraction``, in lanes that ask."""
    s, choice, per = group.state, _Choice(group), _per(group)
    for contact in _active(group, straight=False):
        if not group.spec.yielding:
            _propose_contact(contact, choice, asks, per)
            continue
        # what the whole step rules out is not looked at again in a part of it
        mask = asks & (contact.may_change > 0.0)
        with when_any(mask):
            farthest, _ = _hull(group, *(contact.between(name) for name in ("u0", "u", "v0", "v")))
            may_touch = farthest + _depth(contact).bulge(s["fraction"]) > contact.gap
            mask = mask & ((contact.mode > OPEN) | may_touch)
            contact.may_change = where(mask, 1.0, 0.0)
            with when_any(mask):
                _propose_contact(contact, choice, mask, per)
    for spring in group.iter_springs(straight=False):
        for gauge, kinds in zip(hysteresis.gauges(spring), _kinds(spring), strict=True):
            if isinstance(gauge, DriftGauge):
                stays, goes_on = (s["ruled_out", kinds[0]] > 1.0), s["ruled_out", kinds[2]] > 0.0
                mask = asks & ~((~gauge.ranged | stays) & ((gauge.way == 0.0) | goes_on))
                with when_any(mask):
                    _propose_ends(spring, gauge, kinds, choice, mask)
            else:
                _propose_kink(spring, gauge, kinds[0], choice, asks)
    if group.spec.flowing:
        _gather_kinks(group)
    return choice


def _active(group: Group, straight: bool) -> Iterator[Contact]:
    """Go through the contacts that may change in the step; of a short row through all."""
    for contact in group.iter_contacts(straight):
        with when_any(contact.may_change > 0.0) if group.skips else nullcontext():
            yield contact


def _propose_contact(contact: Contact, choice: _Choice, asks: Truths, per: Lanes) -> None:
    """Consider the changes of a contact's mode, in lanes that ask."""
    group, law, depth, mode = contact.group, contact.law, _depth(contact), contact.mode
    s = group.state
    closed, pressing = mode > OPEN, mode == PRESSING

    def propose(kind: int, lanes: Truths, sign: Lanes, series: Series, target: Lanes, leans: Truths = None) -> None:
        number = group.change(contact.index, kind)
        is_next = (contact.next == target) & ~(contact.event > s["fraction"])
        lanes = lanes & ~is_next & ~(s["ruled_out", number] > 0.0)
        with when_any(lanes):
            stays = choice.propose(real(number), lanes, sign, series, target, leans)
            s["ruled_out", number] = where(lanes & stays, 1.0, s["ruled_out", number])
            choice.expect(lanes & ~stays)

    sign = where(closed, -1.0, 1.0)
    # one that has touched but for a rounding error goes on, and one that has parted so does not touch
    inside = depth.read(0) > 0.0
    leans = where(closed, ~inside, inside & (depth.read(1) < 0.0))
    parts = asks
    if law.shape.clips and not law.shape.is_product:  # its force turns negative before it parts
        parts = asks & ~(pressing & (contact.c_law > 0.0))
    propose(0, parts, sign, depth, where(closed, OPEN, PRESSING), leans)
    if law.shape.approach_only:
        toward = where(pressing, -1.0, 1.0)
        propose(1, asks & closed, toward, depth.rate, where(pressing, REBOUND, PRESSING))
    if law.shape.clips:
        k, c = contact.k_law, contact.c_law * per

        def press(n: int) -> Lanes:  # what the sign of a force follows: k d + c d', or k d + c d d' without d
            damped, product = c * depth.rate.read(n), law.shape.is_product
            if n:
                return damped if product else fma(k, depth.read(n), damped)
            elastic = k if product else k * depth.read(0)
            # at its own event the sign of a force is one of rounding
            return where(size(elastic + damped) > group.limit.at_release * size(elastic), elastic + damped, 0.0)

        toward, target = where(pressing, -1.0, 1.0), where(pressing, SLACK, PRESSING)
        propose(1, asks & closed & (c > 0.0), toward, Series(press, depth.order - 1), target)


def _stretched(element: Element, k: int) -> Lanes:
    """Coefficient k of the stretch of an element."""
    return element.between(_Term(element.group, k))


def _drift(storey: StoreySpring, first: Lanes, sign: Lanes) -> Series:
    """Sign times the drift of a storey, its first coefficient given."""
    group = storey.group
    return Series(lambda k: sign * storey.drift(_Term(group, k)) if k else first, group.spec.series)


def _hull(group: Group, x0: Lanes, x1: Lanes, v0: Lanes, v1: Lanes) -> tuple[Lanes, Lanes]:
    """Bounds of a motion up to ``fraction``, as far as it is a cubic: those of the hull of its ends and tangents."""
    third = (1.0 / 3.0) * (group.state["span"] * group.state["fraction"])
    early, late = fma(third, v0, x0), fma(-third, v1, x1)
    return maximum(x1, maximum(early, late)), minimum(x1, minimum(early, late))


def _propose_ends(spring: StoreySpring, gauge: DriftGauge, kinds: list[Index], choice: _Choice, asks: Truths) -> None:
    """Consider that a drift leaves the range of its branch, or turns back, before ``fraction``, in lanes that ask."""
    group, s, end = spring.group, spring.group.state, spring.group.state["fraction"]
    above, below, turned = kinds
    (d0, d1, v0, v1), more = spring.ends(), hysteresis.margin(spring, gauge, group.limit.same_time)
    ends_step, high, low = ~(spring.turn > end), gauge.high + more, gauge.low - more

    def is_next(phase: Lanes) -> Truths:  # by an event that ends the step as it is
        return ends_step & (spring.then == phase)

    ranged = asks & gauge.ranged
    with when_any(ranged):
        drift = _drift(spring, d0, 1.0)
        (most, least), bulge = _hull(group, d0, d1, v0, v1), drift.bulge(end)
        leaves, beyond = ranged & ((most + bulge > high) | (least - bulge < low)), (d1 > high) | (d1 < low)
        s["ruled_out", above] = where(ranged & ~leaves, 2.0, s["ruled_out", above])
        choice.expect(leaves)
        # where it may turn twice, it may be beyond and back: half the step tells
        unseen = leaves & ~ends_step & (v0 * v1 >= 0.0) & ~beyond
        with when_any(unseen):
            _, early, late, last = tangents(drift.rate, end)
            twice = minimum(last * early, last * late) < 0.0  # the first rate may be none, as where it yielded
            choice.doubt.now |= unseen & twice
        with when_any(leaves):
            # it is beyond its range at the end, or leaves it on the side to which it moves first, and comes back
            rises, over = v0 > 0.0, d1 > gauge.middle
            stays = beyond & ~is_next(where(over, gauge.above, gauge.below))
            turns = (v0 * v1 < 0.0) & where(rises, most + bulge > high, least - bulge < low)
            ruled_out = where(rises, s["ruled_out", above], s["ruled_out", below]) > 0.0
            choice.expect(stays & turns)
            hops = turns & ~stays & ~is_next(where(rises, gauge.above, gauge.below)) & ~ruled_out
            side = where(where(hops, rises, over), 1.0, -1.0)
            target, bound = (where(side > 0.0, *pair) for pair in ((gauge.above, gauge.below), (gauge.high, gauge.low)))
            start = side * (d0 - bound)
            start = where(start > -more, start - more, start)
            lanes = leaves & (hops | stays)
            number = where(side > 0.0, group.full(real(above)), group.full(real(below)))
            choice.propose(number, lanes, 1.0, _drift(spring, start, side), target)
    held = asks & ~(gauge.way == 0.0) & ~is_next(gauge.turned) & ~(s["ruled_out", turned] > 0.0)
    with when_any(held):
        rate = _drift(spring, d0, 1.0).rate
        last, per = s["span"] * v1, (1.0 / 3.0) * end
        early, late = fma(per, rate.read(1), rate.read(0)), fma(-per, rate.rate.value(end), last)
        turns = held & (minimum(gauge.way * last, minimum(gauge.way * early, gauge.way * late)) < rate.bulge(end))
        s["ruled_out", turned] = where(held & ~turns, 1.0, s["ruled_out", turned])
        choice.expect(turns)
        with when_any(turns):
            choice.propose(real(turned), turns, -gauge.way, rate, gauge.turned)


def _propose_kink(spring: StoreySpring, gauge: SignGauge, number: Index, choice: _Choice, asks: Truths) -> None:
    """Consider that a quantity changes its sign before ``fraction``, in lanes that ask."""
    s = spring.group.state
    start, end = gauge.sign * gauge.start, gauge.sign * gauge.end
    is_next = (spring.then == gauge.kink) & ~(spring.turn > s["fraction"])
    allowed = asks & ~is_next
    changes, begins = allowed & (end < 0.0), maximum(start, 0.0)
    guess = s["fraction"] * (begins / (begins - end))
    better = changes & (guess < choice.soonest.now)
    choice.located.now |= changes
    choice.soonest.now = where(better, guess, choice.soonest.now)
    news = {"event_number": real(number), "event_target": gauge.kink, "event_sign": -gauge.sign, "bends": 0.0}
    for to, x in (news | {"event_row": real(s.first[gauge.row] + spring.number)}).items():
        s.put(better, x, to)
    if gauge.slopes is None:  # the drift may turn twice if it would by its rate at the start
        ahead = fma(s["fraction"], gauge.sign * spring.term(gauge.row, 1), start)
        twice = allowed & (end > 0.0) & (ahead < 0.0) & ~(s["ruled_out", number] > 0.0)
        with when_any(twice):
            rate = _drift(spring, spring.drift("u0"), 1.0).rate
            choice.propose(real(number), twice, -gauge.sign, rate, gauge.kink)


def _gather_kinks(group: Group) -> None:
    """Read the series of the kink that each lane has chosen, once, however many springs have one."""
    s, many = group.state, len(group.spec.hysteretic)
    lanes, rows = s["event_row"] > 0.0, [rounded(lane_of(s["event_row"], lane)) for lane in range(group.lanes)]
    with when_any(lanes):
        for k in range(group.spec.series):
            x = s["event_sign"] * side_by_side(group.trace, [s.lane(row + k * many, i) for i, row in enumerate(rows)])
            s.put(lanes, x if k else minimum(x, 0.0), "event_poly", k)
        s.put(lanes, 0.0, "event_poly", group.spec.series)


def _locate(group: Group, lanes: Truths) -> None:
    """Find when the chosen event happens; one that does not is ruled out."""
    s = group.state
    polynomial, end, bends = Series(lambda k: s["event_poly", k], group.spec.series), s["fraction"], s["bends"]
    s["low"], s["high"], happens = group.full(0.0), end, Cell(lanes)
    with when_any(lanes & ~(bends == 0.0)):
        extreme = newton(group, lanes & ~(bends == 0.0), 0.0, end, polynomial.rate, bends)
        turns = bends < 0.0
        s["low"], s["high"] = where(bends > 0.0, extreme, s["low"]), where(turns, extreme, s["high"])
        happens.now = lanes & ~(turns & (polynomial.value(extreme) <= 0.0))
    t = newton(group, happens.now, s["low"], s["high"], polynomial, 1.0)
    s["fraction"] = where(happens.now, t, end)
    for changed, numbers, (when_row, to_row) in _changes(group):
        for number in numbers:
            chosen = lanes & (s["event_number"] == real(number))
            changed.put(chosen & happens.now, **{when_row: t, to_row: s["event_target"]})
            s["ruled_out", number] = where(chosen & ~happens.now, 1.0, s["ruled_out", number])


def _place(group: Group) -> None:
    """Find displacements and velocities at ``fraction``, of the step."""
    s, t, per = group.state, group.state["fraction"], _per(group)
    for i in group.indices(group.spec.n_moving, straight=False):
        s["u", i], rate = _floor(group, i).with_slope(t, halves=not group.spec.yielding)
        s["v", i] = where(s["span"] > 0.0, rate * per, s["v0", i])
    for spring in hysteresis.flowing(group):
        spring.slip = _slip(spring).value(t)


def _take_contacts(group: Group) -> None:
    """Take the largest forces and penetrations of closed contacts."""
    s, r = group.state, group.requested
    moves = s["span"] > 0.0
    for contact in group.iter_contacts() if r & {"force", "penetration"} else ():
        closed, depth, force = (contact.mode > OPEN) & moves, _depth(contact), _force(contact)
        with when_any(closed):
            if "penetration" in r:
                ends = contact.penetration(), s["span"] * contact.between("v")
                contact.dmax = _largest(group, closed, depth, ends, contact.dmax)
            if "force" in r:  # of itself, a spring's too: the same bits in the kernel of a damped law
                contact.fmax = _largest(group, closed, force, force.with_slope(s["fraction"]), contact.fmax)


def _largest(group: Group, lanes: Truths, series: Series, ends: tuple[Lanes, Lanes], so_far: Lanes) -> Lanes:
    """Return the largest value of a series, given its value and slope at the end of the step; that `so_far` or more."""
    t, x0, r0, (x1, r1) = group.state["fraction"], series.read(0), series.read(1), ends
    most, third = Cell(where(lanes, maximum(so_far, maximum(x0, x1)), so_far)), (1.0 / 3.0) * t
    reach = maximum(fma(third, r0, x0), fma(-third, r1, x1)) + series.bulge(t)
    beyond = lanes & (reach > most.now)

    def take(turns: Truths, start: Lanes, end: Lanes) -> None:
        at = newton(group, turns, start, end, series.rate, -1.0)  # a force may turn soon after a touch
        most.now = maximum(most.now, where(turns, series.value(at), 0.0))

    turns = beyond & (r0 > 0.0) & (r1 < 0.0)
    with when_any(turns):
        take(turns, 0.0, t)
    with when_any(beyond):
        twice = beyond & _turns_twice(group, series)
        with when_any(twice):
            for start, end in _parts(group):
                falls = twice & (series.rate.value(start) > 0.0) & (series.rate.value(end) < 0.0)
                with when_any(falls):
                    take(falls, start, end)
    return most.now


def _turns_twice(group: Group, series: Series) -> Truths:
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
                rate = group.cell(course.read(1))
                for a, b in _parts(group):  # a floor that all but rests in a contact may turn thrice
                    r0, r1 = rate.now, course.rate.value(b)
                    rate.now = r1
                    with when_any(turns := asks & (r0 * r1 < 0.0)):
                        at = turn(group, turns, TURNS[group.spec.precision], course.rate.with_slope, (a, b), (r0, r1))
                        take_extremes(group, motion, turns, (course.value(at), x0, x1))
                take_extremes(group, motion, asks, (x0, x0, x1))


def _parts(group: Group) -> Iterator[tuple[Lanes, Lanes]]:
    """Go through the parts of the step: start and end."""
    for q in count_to(PARTS):
        start, end = ((1.0 / PARTS) * real(number) * group.state["fraction"] for number in (q, q + 1))
        yield start, end


def _integrate(group: Group) -> None:
    """Add energies, work and impulse over the step (Gauss & Legendre)."""
    s, r, n = group.state, group.requested, group.spec.n_moving
    if not r & {"energy", "work", "impulse", "transfer", "links", "hysteretic"}:
        return
    nodes, weights = np.polynomial.legendre.leggauss(NODES[group.spec.precision])
    table = Lookup([*(0.5 + 0.5 * nodes), *(0.5 * weights)])
    if "links" in r:
        links.clear_powers(group)
    if "transfer" in r:
        for b in group.indices(group.spec.n_buildings):
            s["gain", b] = s["swing", b] = group.full(0.0)
    per = _per(group)
    for q in count_to(len(nodes)):
        t, weight = s["fraction"] * table[q], s["h"] * table[q + len(nodes)]
        for i in group.indices(n, straight=False) if r & {"energy", "transfer", "links"} else ():
            s["y", i] = _velocity(group, t)(i)
        if "links" in r:
            for i in group.indices(n, straight=False):
                s["x", i] = _floor(group, i).value(t)
            links.add_powers(group, "x", "y", weight, first=False)
        for spring in hysteresis.flowing(group) if "hysteretic" in r else ():
            slip, rate = _slip(spring).with_slope(t)
            drift = _drift(spring, spring.drift("u0"), 1.0).value(t)
            spring.travel = fma(weight * per, spring.law.lost(spring, drift, slip, rate), spring.travel)
        if "energy" in r:
            for part in group.iter_parts():
                gains = powers(group, part, [s["y", i] for i in part.dofs], group.ground.at(t))
                for (b, *_), (gained, damped) in zip(part.blocks, gains, strict=True):
                    s["e_in", b] = fma(weight, gained, s["e_in", b])
                    s["e_damp", b] = fma(weight, damped, s["e_damp", b])
        for contact in group.iter_contacts() if r & {"work", "impulse", "transfer"} else ():
            closed = contact.mode > OPEN
            with when_any(closed):
                force = _force_at(contact, t)
                if "transfer" in r:
                    for b, gain in iter_powers(contact, force, "y"):
                        s["gain", b] = fma(weight, gain, s["gain", b])
                        s["swing", b] = fma(weight, size(gain), s["swing", b])
                if "impulse" in r:
                    contact.impulse = fma(weight, force, contact.impulse)
                if "work" in r:
                    contact.work = fma(weight, force * (_depth(contact).rate.value(t) * per), contact.work)
    if "links" in r:
        links.record(group, 1.0)
    if "transfer" in r:
        transfers.by_series(group, NODES[group.spec.precision], (_force_at, _velocity))


def _force_at(contact: Contact, t: Lanes) -> Lanes:
    """Force of a contact at a part t of the whole step."""
    group = contact.group
    closed, force = contact.mode > OPEN, group.cell(0.0)
    with when_any(closed):
        force.now = where(closed, _force(contact).value(t), 0.0)
    return force.now


def _velocity(group: Group, t: Lanes) -> Callable[[Index], Lanes]:
    """Return what gives velocities of floors at a part t of the whole step."""
    return lambda i: _floor(group, i).rate.value(t) * _per(group)


def _take_size(group: Group, name: str, i: Index, x: Series) -> None:
    """Take the largest absolute value of a series over the step."""
    s, moves = group.state, group.state["span"] > 0.0
    most = Cell(where(moves, size(x.read(0)), 0.0))
    for start, end in _parts(group):  # beside other contacts it may turn more than once
        r0, r1 = x.rate.value(start), x.rate.value(end)
        most.now = maximum(most.now, where(moves, size(x.value(end)), 0.0))
        with when_any(turns := moves & (r0 * r1 < 0.0)):
            at = newton(group, turns, start, end, x.rate, where(r0 > 0.0, -1.0, 1.0))
            most.now = maximum(most.now, where(turns, size(x.value(at)), 0.0))
    s[name, i] = maximum(s[name, i], most.now)


def _take_links(group: Group) -> None:
    """Take the forces of links over the step."""
    for link in group.iter_links():
        stretch, per = Series(partial(_stretched, link), group.spec.series), _per(group)

        def pull(n: int, link: Spring = link, stretch: Series = stretch, per: Lanes = per) -> Lanes:
            return fma(link.damping * per, stretch.rate.read(n), link.stiffness * stretch.read(n))

        _take_size(group, "link_force", link.index, Series(pull, group.spec.series - 1))


def _take_accelerations(group: Group) -> None:
    """Take the total accelerations of all floors over the step."""
    per = _per(group)
    for i in group.indices(group.spec.n_dof, straight=False):
        bend, b = _floor(group, i).rate.rate, group.home_of(i)[2]

        def total(k: int, bend: Series = bend, b: Index = b) -> Lanes:
            coefficient = bend.read(k) * (per * per)
            return coefficient + (group.ground.at(0.0), group.ground.rise)[k](b) if k < 2 else coefficient

        _take_size(group, "acc", i, Series(total, bend.order))
