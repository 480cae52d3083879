"""Contacts that press by a law: touch, release and changes of phase inside a step.

Within a sub-step the penetration is the quartic that matches d, d', d'' at the start and d, d' at the end (beside exact
flight the quintic of its stages); its roots are touch and release. A contact is in one mode, frozen within a sub-step:

    0  open: no force             1  pressing: E(d) + B(d) v
    2  rebound: E(d) alone        3  slack: closed, the clipped force is zero
       of a law that yields: its yielding part slips; of one damped on rebound only: approach

The force in any mode is that of the stiffness ``k_active`` and the damping ``c_active``.
"""

from __future__ import annotations

from contextlib import nullcontext
from functools import reduce

from pounding_sweep.kernel.group import Contact, Group, LaneLaw
from pounding_sweep.kernel.roots import NEVER, Series, course, crossing, cubic_turn, first_crossing, root
from pounding_sweep.kernel.types import Lanes, Truths
from pounding_sweep.lanes import Cell, maximum, minimum, power, power_of, roughly_power, size, sqrt, when_any, where
from pounding_sweep.model.laws import RESTING_SPEED
from pounding_sweep.model.rebound import YIELD_SHARE

#: Sub-steps of one step before events are no longer followed (the lane is flagged), and what one counts that no event
#: ends: beside contacts of high rates many are needed, in long steps.
MAX_TRIES, PLAIN_TRY = 1000, 1 / 16
OPEN, PRESSING, REBOUND, SLACK = 0.0, 1.0, 2.0, 3.0
#: Modes of approach and of rebound, of most laws and of those damped on rebound only.
SIDES = ((PRESSING, REBOUND), (REBOUND, PRESSING))
#: Lengths of a contact beyond which its touch, or its release, is far; there powers to six figures suffice.
LONG = 1000.0
#: Product of a contact's rate and the step below which sub-steps by series get no longer.
SOFTEST = 2.0
#: How much longer than floors need to part, at the rate they have, the sub-step is in which they should.
OVER = 1.05
#: Most that penetration and its rate leave their ends by in a sub-step, by the sum of its rates there, with a margin:
#: a cubic leaves them by 4/27.
BEYOND = 0.25
#: Longest sub-step that graded ones of stages grow to, in durations of a contact, by the largest product of its rate.
GRADED = 0.8


def declare_rows(group: Group) -> None:
    """Declare what contacts need."""
    many = len(group.contacts)
    if group.touching:
        # mode, the next one and when it comes (in sub-steps); stiffness and damping in this mode, and of the law
        # (kN/m, kN s/m); rate of approach (m/s); time since the touch, that of an elastic contact (s) and its inverse
        group.declare(many, "mode", "next", "event", "k_active", "c_active", "k_law", "c_law")
        group.declare(many, "fastest", "age", "duration", "pace")
        # penetration (m), its rate (m/s), the force (kN) and its rate at both ends of a sub-step; that of an
        # implicit step, and whether an event may be in it
        group.declare(many, "pen_start", "pen_end", "rate_start", "rate_end")
        group.declare(many, "force_start", "force_end", "force_rate_start", "force_rate_end", "force", "may_change")
    if any(law.shape.yields for law in group.laws):
        group.declare(many, "plastic", "yield_depth", of_law=True)


def is_capped(group: Group) -> bool:
    """Whether sub-steps are cut to what an explicit scheme can follow of a closed contact."""
    return not group.spec.implicit and not group.spec.impulsive


def longest_substep(group: Group, h: Lanes) -> Lanes:
    """How long the next sub-step may be for the contacts that are closed."""
    s, capped = group.state, is_capped(group)
    if not capped and not any(law.graded for law in group.laws):
        return group.full(h)
    longest, fastest = group.cell(h), group.cell(0.0)
    for contact in group.iter_contacts():
        law = contact.law
        with when_any(closed := (contact.mode > OPEN) & (s["time_left"] > 0.0)):
            now, v = contact.penetration(), contact.between("v")
            # divisions of lanes take long: one of a mass that all share does not
            lasts, pace, k, per = contact.duration, contact.pace, contact.k_active, 1.0 / contact.reduced
            if capped:
                d = maximum(now + maximum(v, 0.0) * minimum(group.full(h), lasts), 0.0)
                rate2 = law.elastic_slope(k, d) * per
                if law.shape.damper:
                    b = law.damper(contact.c_active, d) * per
                    if group.spec.series:  # the size of the roots of x**2 + b x + w**2
                        b = 0.5 * b + sqrt(0.25 * b * b + rate2)
                    rate2 = maximum(rate2, b * b)
                if group.spec.series:  # a run of another cap is not the same where contacts outlast steps
                    soft = SOFTEST / h
                    rate2 = maximum(rate2, group.full(soft * soft))
                fastest.now = maximum(fastest.now, where(closed, rate2, 0.0))
            most = h * pace
            if group.spec.staged:
                most = minimum(most, GRADED * group.prop("cap"))
            if law.touch_power > 1.0:
                share = maximum(law.touch_share * most, law.least_share)
                age = minimum(contact.age * pace, LONG)
                x = _power(age, 1.0 / law.touch_power) + share
                grown = lasts * (_power(x, law.touch_power) - age)
                longest.now = minimum(longest.now, where(k > 0.0, grown, h))
            if law.release_power > 1.0:
                rest = minimum(maximum(now, 0.0) * pace / -v, LONG)
                share = maximum(law.release_share * most, law.least_share)
                x = _power(rest, 1.0 / law.release_power) - share
                shrunk = lasts * (rest - _power(x, law.release_power))
                near = (k > 0.0) & (v < 0.0) & (x > share)  # else the release is within this sub-step
                if group.spec.staged:  # which it ends, as near as one can tell
                    parts = (k > 0.0) & (v < 0.0)
                    last = lasts * maximum(OVER * rest, _power(group.full(law.least_share), law.release_power))
                    longest.now = minimum(longest.now, where(parts, where(near, shrunk, last), h))
                else:
                    longest.now = minimum(longest.now, where(near, shrunk, h))
    return minimum(longest.now, group.prop("cap") / sqrt(fastest.now)) if capped else longest.now


def _power(x: Lanes, exponent: float) -> Lanes:
    """Power of a number >= 0, by products and roots where they do, else to six figures; of others anything."""
    x, exponent = (x * x, 2.0) if exponent == 4.0 else (x, exponent)
    quick = 4.0 * exponent in (1.0, 2.0, 8.0)
    return power_of(x, exponent) if quick else roughly_power(maximum(x, 0.0), exponent)


def update_penetrations(group: Group) -> Truths:
    """Keep penetrations and their rates at both ends of the trial; returns the lanes in which something may happen."""
    s = group.state
    h, look = s["h"], group.cell(False)
    for contact in group.iter_contacts():
        law = contact.law
        mode, k, c = contact.mode, contact.k_active, contact.c_active
        v0, v1 = contact.between("v0"), contact.between("v")
        d0, d1 = contact.penetration("u0"), contact.penetration()
        contact.pen_start, contact.pen_end, contact.rate_start, contact.rate_end = d0, d1, v0, v1
        early, late = d0 + h * v0, d1 - h * v1
        parts, closed = group.cell(False), mode > OPEN
        with when_any(closed):
            may = (d1 <= 0.0) | ((v0 < 0.0) & (v1 > 0.0) & (maximum(early, late) < 0.0))
            if law.shape.one_sided:
                nears, parting = SIDES[law.shape.rebound_only]
                may = may | ((mode == nears) & (v1 < 0.0)) | ((mode == parting) & (v1 > 0.0))
            if law.shape.clips:
                p = law.pressing(contact.k_law, contact.c_law, d1, v1)
                may = may | ((mode == PRESSING) & (p <= 0.0)) | ((mode == SLACK) & (p > 0.0))
            if law.shape.yields:
                low, top, slips = contact.plastic, contact.plastic + contact.yield_depth, c > 0.0
                leaves = (maximum(d1, minimum(early, late)) > top) | (minimum(d1, maximum(early, late)) < low)
                may = may | ((mode == 1.0) & leaves) | ((mode == 2.0) & ((slips & (v1 < 0.0)) | (~slips & (v1 > 0.0))))
            parts.now = may
            if is_capped(group):
                cap, mass, deep = group.prop("cap"), contact.reduced, maximum(d0, d1)
                length = group.prop("longest") if group.spec.staged else h
                # deeper than the sub-step was made for
                deeper = closed & (d1 > d0 + maximum(v0, 0.0) * minimum(group.full(length), contact.duration))
                with when_any(deeper):
                    fast = h * h * law.elastic_slope(k, deep) > (4.0 * cap * cap) * mass
                    if law.shape.damper:
                        fast = fast | (h * law.damper(c, deep) > (2.0 * cap) * mass)
                    parts.now |= deeper & fast
        meets = maximum(d1, minimum(early, late)) > 0.0
        may_happen = where(closed, parts.now, meets)
        contact.may_change = where(may_happen, 1.0, 0.0)
        look.now |= may_happen
    return look.now


def contact_rate(law: LaneLaw, k: Lanes, c: Lanes, mass: Lanes, deepest: Lanes) -> Lanes:
    """Fastest rate (1/s) of a contact down to a penetration: of its spring or of its damper."""
    spring = sqrt(law.elastic_slope(k, deepest) / mass)
    return maximum(spring, law.damper(c, deepest) / mass) if law.shape.damper else spring


def locate_event(group: Group, asks: Truths) -> Lanes:
    """Fraction of the trial at which the first contact changes its mode (1: none), in the lanes that ask."""
    first, cap = group.cell(1.0), group.cell(1.0)
    for contact in group.iter_contacts():
        contact.put(asks, event=NEVER)
        with when_any(busy := asks & (contact.may_change > 0.0)):
            event, target = _event(contact, busy, cap)
            first.now = minimum(first.now, event)
            contact.put(busy, event=event, next=target)
    return minimum(first.now, cap.now)


def course_of(contact: Contact) -> Series:
    """Penetration of a contact in the sub-step just tried, by parts of it."""
    rows = {"u0": "pen_start", "u": "pen_end", "v0": "rate_start", "v": "rate_end"}
    return course(contact.group, lambda name: getattr(contact, rows[name]) if name in rows else contact.between(name))


def _event(contact: Contact, busy: Truths, cap: Cell) -> tuple[Lanes, Lanes]:
    """Find when a contact changes its mode in the trial, and to which."""
    group, law, depth = contact.group, contact.law, course_of(contact)
    s, h = group.state, group.state["h"]
    mode, d0, d1, v0, v1 = contact.mode, contact.pen_start, contact.pen_end, contact.rate_start, contact.rate_end
    closed = mode > OPEN
    if group.spec.implicit:  # of a stiff contact the mode follows from the end of the sub-step
        busy = busy & ~(closed & (s["stiff"] > 0.0))
    sign = where(closed, -1.0, 1.0)
    # else a closed contact has touched but for a rounding error, and goes on
    crosses = where(closed, (d1 <= 0.0) & ((d0 > 0.0) | (v1 <= 0.0)), d1 > 0.0)
    dips = (v0 < 0.0) & (v1 > 0.0) & (maximum(d0 + h * v0, d1 - h * v1) < 0.0)
    turns = ~crosses & where(closed, dips, (v0 > 0.0) & (v1 < 0.0))
    rises = crosses & (sign * v0 < 0.0) & (sign * v1 > 0.0)
    if group.spec.implicit:
        rises = rises & closed
    begun = depth.begun(where(closed, d0, minimum(d0, 0.0)))
    when = first_crossing(group, busy, begun, sign, crosses, turns, rises)
    nears, parting = SIDES[law.shape.rebound_only]
    target = where(when < NEVER, where(closed, OPEN, nears), mode)
    if law.shape.one_sided:
        slows, speeds = (mode == nears) & (v1 < 0.0), (mode == parting) & (v1 > 0.0)
        toward = where(slows, -1.0, 1.0)
        t = crossing(group, busy & (slows | speeds), 0.0, 1.0, depth.rate, toward)
        sooner = busy & (slows | speeds) & (t < when)
        when, target = where(sooner, t, when), where(sooner, where(slows, parting, nears), target)
    if law.shape.yields:
        t = _slips(contact, busy & closed, (d0, d1, v0, v1), depth)
        sooner = busy & closed & (t < when)
        when, target = where(sooner, t, when), where(sooner, 3.0 - mode, target)
    if law.shape.clips:
        when, target = _slack(contact, busy, (when, target), depth)
    if is_capped(group):
        rate = contact_rate(law, contact.k_active, contact.c_active, group.full(contact.reduced), maximum(d0, d1))
        fast, most = h * rate, group.prop("cap")
        deep = busy & ((mode == PRESSING) | (mode == REBOUND)) & (fast > 2.0 * most)  # deeper than foreseen
        cap.now = where(deep, minimum(cap.now, maximum(most / fast, 1e-3)), cap.now)
    return when, target


def _slack(contact: Contact, asks: Truths, event: tuple[Lanes, Lanes], depth: Series) -> tuple[Lanes, Lanes]:
    """Look for the instant at which a force that cannot pull ends, or begins again, before any other event."""
    group, law, (when, target) = contact.group, contact.law, event
    mode, k, c = contact.mode, contact.k_law, contact.c_law

    def press(t: Lanes) -> tuple[Lanes, Lanes, Lanes]:
        values = ([of.read(n) for n in range(of.order, -1, -1)] for of in (depth, depth.rate))
        d, slope = (reduce(lambda x, coefficient: coefficient + t * x, powers) for powers in values)
        return law.pressing(k, c, d, slope / group.state["h"]), d, slope

    asks = asks & (c > 0.0) & ((mode == PRESSING) | (mode == SLACK))
    # not the release itself, where E and B v both end
    end = where(mode == PRESSING, minimum(when - group.limit.at_release, 1.0), minimum(when, 1.0))
    ends, begins, first = group.cell(False), group.cell(False), group.cell(0.0)
    with when_any(asks):
        p1, d, slope = press(end)
        ends.now = asks & (mode == PRESSING) & (p1 <= 0.0) & (slope < 0.0)
        begins.now = asks & (mode == SLACK) & (p1 > 0.0) & (d > 0.0)
        with when_any(ends.now | begins.now):
            p0 = press(group.full(group.limit.just_after))[0]  # at its own event the sign of a force is one of rounding
            sign = where(ends.now, -1.0, 1.0)
            inside = (ends.now & (p0 > 0.0)) | (begins.now & (p0 <= 0.0))
            with when_any(inside):
                t0 = root(group, inside, group.limit.just_after, end, lambda t: sign * press(t)[0])
                first.now = where(inside, t0, 0.0)
    t, ends, begins = first.now, ends.now, begins.now
    sooner = ends | (begins & (t < when))
    return where(sooner, t, when), where(sooner, where(ends, SLACK, PRESSING), target)


def sample_forces(group: Group, length: Lanes) -> None:
    """Take forces and penetrations of the sub-step just taken, at its ends and between them."""
    s, r, h = group.state, group.requested, group.state["h"]
    implicit = group.spec.implicit
    needs_force = group.looks("force") or (implicit and bool(r & {"work", "impulse"}))
    follows = None
    if implicit:  # where contacts are too stiff for a sub-step, it is their end force that counts
        follows = (s["accepted"] > 0.0) & ~(s["stiff"] > 0.0) & is_closed(group)
    for contact in group.iter_contacts() if needs_force or "penetration" in r else ():
        d0, d1, v0, v1 = contact.pen_start, contact.pen_end, contact.rate_start, contact.rate_end
        closed = contact.mode > OPEN
        if follows is not None:
            closed = closed & follows
        looks = closed & (h > 0.0)
        if group.looks("ends") and not implicit:
            contact.put(None, force_start=0.0, force_end=0.0, force_rate_start=0.0, force_rate_end=0.0)
        counts = closed
        if group.spec.staged and not (group.looks("ends") or "penetration" in r):
            counts = looks
            if contact.law.shape.grows:  # lanes in which the force may exceed its largest so far
                rates = size(v0) + size(v1)
                deepest, fastest = maximum(d0, d1) + BEYOND * h * rates, maximum(maximum(v0, v1), 0.0) + BEYOND * rates
                counts = counts & (
                    contact.law.pressing(contact.k_active, contact.c_active, deepest, fastest) > contact.fmax
                )
        with nullcontext() if implicit else when_any(counts):  # of open ones implicit steps keep what was
            depth = course_of(contact)
            if "penetration" in r:
                contact.dmax = maximum(contact.dmax, where(closed, maximum(d0, d1), 0.0))
                deepens = looks & (v0 > 0.0) & (v1 < 0.0)
                with when_any(deepens):
                    t = crossing(group, deepens, 0.0, 1.0, depth.rate, -1.0)
                    contact.dmax = maximum(contact.dmax, where(deepens, depth.value(t), 0.0))
            if needs_force:
                _force_ends(contact, looks, length, depth, follows)


def force_at(contact: Contact, t: Lanes) -> Lanes:
    """Force of a contact at a part t of the sub-step just taken."""
    d, slope = course_of(contact).with_slope(t)
    force = contact.law.pressing(contact.k_active, contact.c_active, d, slope / contact.group.state["h"])
    return where(contact.mode > OPEN, force, 0.0)


def _force_ends(contact: Contact, looks: Truths, length: Lanes, depth: Series, follows: Truths) -> None:
    """Take the force of one contact at the ends of a sub-step, its rates there, and its largest value between them."""
    group, law, k, c, mode = contact.group, contact.law, contact.k_active, contact.c_active, contact.mode
    d0, d1, v0, v1 = contact.pen_start, contact.pen_end, contact.rate_start, contact.rate_end
    s, r, h, limit = group.state, group.requested, group.state["h"], group.limit
    a0, a1 = contact.between("a0"), depth.rate.rate.value(1.0) / (h * h)
    f0, f1 = law.pressing(k, c, d0, v0), law.pressing(k, c, d1, v1)
    r0, r1 = law.pressing_rate(k, c, d0, v0, a0), law.pressing_rate(k, c, d1, v1, a1)
    mean = (f1 - f0) / maximum(h, limit.tiny)
    if not group.spec.staged:
        short = ~(h >= limit.short * length)
        r0, r1 = where(short, mean, r0), where(short, mean, r1)
    presses = (mode == PRESSING) | (mode == REBOUND)
    if follows is not None:
        presses = presses & follows
        f0, f1, r0, r1, mean = (where(presses, x, 0.0) for x in (f0, f1, r0, r1, mean))
    if "force" in r:
        contact.fmax = maximum(contact.fmax, maximum(f0, f1))
        between = looks & presses & (r0 > 0.0) & (r1 < 0.0)
        turn = group.cell(0.0)
        if group.spec.staged:  # of a graze, whose force has no rate at its ends, about where it is deepest
            grazes = looks & presses & ~between & ~(r0 < 0.0) & (v0 > 0.0) & (v1 < 0.0)
            with when_any(grazes):
                turn.now = cubic_turn(d0, d1, h * v0, h * v1)
            between = between | grazes
        with when_any(between):
            t = cubic_turn(f0, f1, h * r0, h * r1)
            t = where(grazes, turn.now, t) if group.spec.staged else t
            d, slope = depth.with_slope(t)
            peak = law.pressing(k, c, d, slope / h)
            if group.spec.staged:  # long ones, in which a force with roots is no cubic: regula falsi on its rate
                rate = law.pressing_rate(k, c, d, slope / h, depth.rate.rate.value(t) / (h * h))
                t = where(rate > 0.0, t + (1.0 - t) * rate / (rate - r1), t * r0 / (r0 - rate))
                d, slope = depth.with_slope(t)
                peak = maximum(peak, where(grazes, peak, law.pressing(k, c, d, slope / h)))
            contact.fmax = maximum(contact.fmax, where(between, peak, 0.0))
    if follows is not None:
        if "impulse" in r:
            contact.put(presses, impulse=contact.impulse + 0.5 * h * (f0 + f1))
        if "work" in r:
            contact.put(presses, work=contact.work + 0.5 * h * (f0 * v0 + f1 * v1))
    if group.looks("ends"):
        q0, q1 = where(size(r0) < limit.far, r0, mean), where(size(r1) < limit.far, r1, mean)
        if follows is None:
            contact.force_start, contact.force_end, contact.force_rate_start, contact.force_rate_end = f0, f1, q0, q1
        else:  # a lane that did not take its trial stays where it is
            accepted, stiff = s["accepted"] > 0.0, s["stiff"] > 0.0
            force = where(stiff & ~follows, contact.force, 0.0)
            contact.force_start = where(accepted, where(follows, f0, force), contact.force_end)
            contact.put(accepted, force_end=where(follows, f1, force))
            contact.force_rate_start = where(accepted, where(follows, q0, 0.0), contact.force_rate_end)
            contact.put(accepted, force_rate_end=where(follows, q1, 0.0))


def is_due(contact: Contact, lands: Truths) -> Truths:
    """Lanes in which the event of a contact ends this sub-step."""
    group = contact.group
    return lands & (contact.event < 1.0) & (contact.event <= group.state["fraction"] + group.limit.same_time)


def apply_events(group: Group, lands: Truths, h: Lanes) -> Truths:
    """Switch the contacts whose event ends this sub-step; returns the lanes in which any did."""
    s = group.state
    switched = group.cell(False)
    for contact in group.iter_contacts():
        law, which = contact.law, contact.law_index
        due = is_due(contact, lands)
        switched.now |= due
        with when_any(due):
            mode, target = contact.mode, contact.next
            touches = due & (mode == OPEN) & (target > OPEN)
            with when_any(touches):
                v, k, c = contact.between("v"), contact.stiffness, contact.c
                lasts = law.duration(k, v, contact.reduced)
                contact.put(touches, duration=lasts, pace=1.0 / lasts, age=0.0)
                s.put(touches, minimum(s["shortest", which], lasts), "shortest", which)
                if law.shape.per_speed:
                    c = c / maximum(v, RESTING_SPEED)
                note_onset(contact, touches, touches, v, group.clock(h))
                contact.put(touches, k_law=k, c_law=c)
                if law.shape.yields:
                    _begin_yielding(contact, touches, k, c, v)
            k, c = contact.k_law, contact.c_law
            if law.shape.yields:
                d, sticks = contact.penetration(), due & (target == 1.0)
                contact.put(due & (target == 0.0), k_active=0.0, c_active=0.0)
                set_plastic(contact, sticks & (mode > 0.0), d)
                stick(contact, sticks)
                slip(contact, due & (target == 2.0), d)
            else:
                pressing = target == PRESSING
                contact.put(
                    due, k_active=where(pressing | (target == REBOUND), k, 0.0), c_active=where(pressing, c, 0.0)
                )
            contact.mode = where(due, target, mode)
    return switched.now


def note_onset(contact: Contact, lanes: Truths, fresh: Truths, speed: Lanes, time: Lanes) -> None:
    """Tell reducers of onsets in some lanes, at a rate and a time; in `fresh` lanes they count as ones of their own."""
    for reducer in contact.group.reducers:
        if reducer.touch:
            reducer.touch(contact, lanes, fresh, speed, time)


def is_closed(group: Group) -> Truths:
    """Lanes in which any contact is closed."""
    closed = group.cell(False)
    for contact in group.iter_contacts(straight=True):
        closed.now |= contact.mode > OPEN
    return closed.now


# contacts that yield -------------------------------------------------------------------------------------------------
#     F = KL d + CL (d - s),    0 <= d - s <= YIELD
#
# The plastic part s of the penetration stands still while the contact sticks (mode 1). While
# it slips (mode 2) the yielding part holds its force: its yield force as d grows, or, once it
# has given back all, none as d falls; it sticks again where v turns. In either mode the force
# is KE d + CE.


def _begin_yielding(contact: Contact, lanes: Truths, k: Lanes, loss: Lanes, v: Lanes) -> None:
    """Properties of a contact that begins at the rate v, meant for the depth of an elastic Hertz contact."""
    speed = maximum(v, RESTING_SPEED)
    deepest = power(1.25 * contact.reduced * speed * speed / k, 0.4)
    effective = k * sqrt(deepest)
    loop = 0.4 * loss * effective
    contact.put(
        lanes,
        k_law=effective - loop / (1.0 - YIELD_SHARE),
        c_law=loop / (YIELD_SHARE * (1.0 - YIELD_SHARE)),
        yield_depth=where(loss > 0.0, YIELD_SHARE * deepest, contact.group.limit.far),
        plastic=0.0,
    )
    stick(contact, lanes)


def set_plastic(contact: Contact, lanes: Truths, d: Lanes) -> None:
    """Plastic part of a contact that has slipped to the penetration d."""
    contact.put(lanes, plastic=where(contact.c_active > 0.0, d - contact.yield_depth, d))


def stick(contact: Contact, lanes: Truths) -> None:
    """Let the plastic part stand still from here on."""
    contact.put(lanes, k_active=contact.k_law + contact.c_law, c_active=-contact.c_law * contact.plastic)


def slip(contact: Contact, lanes: Truths, d: Lanes) -> None:
    """Let the yielding part hold the force that it has reached: all of it or none."""
    deep = d - contact.plastic > 0.5 * contact.yield_depth
    contact.put(lanes, k_active=contact.k_law, c_active=where(deep, contact.c_law * contact.yield_depth, 0.0))


def force_at_end(contact: Contact, d: Lanes) -> Lanes:
    """Force at penetration d, the plastic part being what it must be there."""
    stretch = minimum(maximum(d - contact.plastic, 0.0), contact.yield_depth)
    return where(d > 0.0, contact.k_law * d + contact.c_law * stretch, 0.0)


def settle_yielding(contact: Contact, lanes: Truths, d: Lanes, v: Lanes) -> Lanes:
    """Mode of a contact that went to the penetration d by `force_at_end`."""
    stretch, top = d - contact.plastic, contact.yield_depth
    contact.put(lanes, plastic=where(stretch > top, d - top, where(stretch < 0.0, d, contact.plastic)))
    slips = lanes & (((stretch >= top) & (v > 0.0)) | ((stretch <= 0.0) & (v < 0.0)))
    slip(contact, slips, d)
    stick(contact, lanes & ~slips)
    return where(slips, 2.0, 1.0)


def _slips(contact: Contact, asks: Truths, ends: tuple[Lanes, Lanes, Lanes, Lanes], depth: Series) -> Lanes:
    """Fraction of the sub-step at which a closed contact begins to slip, or sticks again (2: not in it)."""
    group, (d0, d1, v0, v1) = contact.group, ends
    slipping, slips = contact.mode == 2.0, contact.c_active > 0.0
    falls = asks & slipping & slips & (v1 < 0.0)
    grows = asks & slipping & ~slips & (v1 > 0.0)
    low = contact.plastic
    toward = where(falls, -1.0, 1.0)
    event = where(falls | grows, crossing(group, falls | grows, 0.0, 1.0, depth.rate, toward), NEVER)
    # it sticks where v is zero and d at one of both limits: rounding there is no crossing
    margin = group.limit.at_release * contact.yield_depth
    for sign, limit, may in ((1.0, low + contact.yield_depth, asks), (-1.0, low, asks & (low > 0.0))):
        crosses = sign * (d1 - limit) > margin
        turns = ~crosses & (sign * v0 > 0.0) & (sign * v1 < 0.0)
        begun = depth.begun(sign * minimum(sign * (d0 - limit), 0.0))
        when = first_crossing(group, may & ~slipping, begun, sign, crosses, turns, least=margin)
        event = minimum(event, when)
    return event
