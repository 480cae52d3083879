"""Contacts that are found together with the step that they act on (Newmark-beta).

The contact forces at the end of the step solve the contact law together with the end state that they themselves change.
Each contact sees the row through one compliance, so each is one scalar equation, solved within a bracket; the contacts
are swept until none changes any more (block Gauss-Seidel).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from pounding_sweep.kernel import links, yielding
from pounding_sweep.kernel.forces import OPEN, PRESSING, REBOUND, SIDES, SLACK, contact_rate, is_closed, penetration
from pounding_sweep.kernel.group import Group, part_of
from pounding_sweep.kernel.impulse import alone
from pounding_sweep.kernel.lanes import Cell, count_to, flag, maximum, minimum, size, when_any, where, while_any
from pounding_sweep.kernel.row import damper_stiffness

#: Sweeps over the contacts before the implicit solution is given up (the lane is flagged).
MAX_SWEEPS = 500
#: Product of sub-step and contact rate beyond which the contact's end force acts over all of the sub-step.
STIFF_RATE = 2.0


#: Floors that a contact acts on at one of its sides, and the share of each (None: all).
Floors = list[tuple[Any, Any]]


def _sides(group: Group, j: Any) -> list[tuple[Any, Floors, float]]:
    """Sides of a contact that move: where their responses begin, the floors, the sign of the force on them."""
    if group.spec.whole:  # both are of one whole, whose response is to the push on both
        both = [(i, share if side else -share) for side in (0, 1) for i, share in _shares(group, j, side)]
        return [(j * group.spec.n_moving, both, 1.0)]
    most = max(group.spec.storeys)
    sides = ((side, group.floors_of(j, side), sign) for side, sign in enumerate((-1.0, 1.0)))
    return [((j * 2 + side) * most, floors, sign) for side, floors, sign in sides if floors]


def _shares(group: Group, j: Any, side: int) -> Floors:
    """Floors that a contact acts on at a side, with numbers for shares."""
    return [(i, group.full(1.0) if share is None else share) for i, share in group.floors_of(j, side)]


def _whole(group: Group, floor: Any) -> tuple[Any, Any]:
    """First floor and number of floors of what moves as one with a floor in a step."""
    return (0, group.spec.n_moving) if group.spec.whole else group.home_of(floor)[:2]


def _count(group: Group, n: Any) -> Iterator[Any]:
    """Count to n storeys, at run time unless a short row's buildings are all equally high."""
    return iter(range(n)) if isinstance(n, int) and not group.long else count_to(n, group.trace)


def storey_stiffness(group: Group, b: Any, i: Any, be: Any, ga: Any) -> Any:
    """Stiffness by which a storey resists an acceleration at the end of a Newmark step, its damper included."""
    k = group.state["kt", i] if group.yields(i) else group.prop("k", i)
    found = be * k + ga * group.prop("beta", b) * damper_stiffness(group, i)
    return found + ga * group.prop("dashpot", i) if group.dashed(i) else found


def _keep_compliance(group: Group, first: Any, floors: Floors, h: Any) -> None:
    """Keep the acceleration of every floor of a building for a unit force on some, in a Newmark step of length h."""
    s = group.state
    if group.spec.whole:
        _keep_whole_compliance(group, first, floors, h)
        return
    home, storeys, b = group.home_of(floors[0][0])
    beta, gamma = group.prop("newmark_beta"), group.prop("newmark_gamma")
    be, ga = beta * h * h, gamma * h
    alpha, stiff = group.prop("alpha", b), be + ga * group.prop("beta", b)
    apart = bool(group.spec.yielding or group.spec.dashpots)  # storeys differ in the share of their dampers
    stiff = 1.0 if apart else stiff

    def stiffness(i: Any) -> Any:
        return storey_stiffness(group, b, i, be, ga) if apart else group.prop("k", i)

    def ahead(p: Any, above: Any) -> tuple[Any, Any]:
        i = home + p
        diagonal = group.prop("m", i) * (1.0 + ga * alpha) + stiff * (stiffness(i) + above)
        pushed = None
        for floor, share in floors:
            here, own = flag(group.trace, i == floor), group.full(1.0 if share is None else share)
            pushed = where(here, own, group.full(0.0) if pushed is None else pushed)
        return diagonal, pushed

    def above(p: Any) -> Any:
        top = p + 1 == storeys
        if not isinstance(top, bool):
            i = where(top, home + p, home + p + 1)
            return where(top, group.full(0.0), group.full(stiffness(i)))
        return 0.0 if top else stiffness(home + p + 1)

    # elimination from the bottom, as in the flight step
    s["diagonal"], s["response", first] = ahead(0, above(0))
    for q in _count(group, storeys - 1):
        p = q + 1
        k = stiffness(home + p)
        diagonal, right = ahead(p, above(p))
        low = -stiff * k / s["diagonal", q]
        s["diagonal", p] = diagonal + low * stiff * k
        s["response", first + p] = right - low * s["response", first + q]
    last = storeys - 1
    s["response", first + last] = s["response", first + last] / s["diagonal", last]
    for q in _count(group, last):
        p = last - 1 - q
        found = s["response", first + p] + stiff * stiffness(home + p + 1) * s["response", first + p + 1]
        s["response", first + p] = found / s["diagonal", p]


def _keep_whole_compliance(group: Group, first: Any, floors: Floors, h: Any) -> None:
    """Keep the same of every floor of a row that moves as one."""
    be, ga = group.prop("newmark_beta") * h * h, group.prop("newmark_gamma") * h
    row = enumerate(group.building_floors)
    own = [storey_stiffness(group, b, i, be, ga) for b, storeys in row for i in storeys]
    right = [group.full(0.0) for _ in range(group.spec.n_moving)]
    for floor, share in floors:
        right = [where(flag(group.trace, floor == i), share, x) for i, x in enumerate(right)]
    for i, x in enumerate(links.solve(group, be, ga, own, right)):
        group.state["response", first + i] = x


def _push(group: Group, first: Any, floors: Floors, be: Any, ga: Any, change: Any, lanes: Any) -> None:
    """Add a change (kN) of force to the end state of a building."""
    s = group.state
    home, storeys = _whole(group, floors[0][0])
    for p in _count(group, storeys):
        i = home + p
        a = change * s["response", first + p]
        s["a", i] = where(lanes, s["a", i] + a, s["a", i])
        s["u", i] = where(lanes, s["u", i] + be * a, s["u", i])
        s["v", i] = where(lanes, s["v", i] + ga * a, s["v", i])


def _unit(group: Group, j: Any) -> Any:
    """Relative acceleration of a contact's floors for a unit force."""
    unit = group.full(0.0)
    for first, floors, _ in _sides(group, j):
        for floor, share in floors:
            unit = unit + part_of(group.state["response", first + (floor - _whole(group, floor)[0])], share)
    return unit


def solve(group: Group, asks: Any, d: Any, v: Any, share: tuple[Any, Any], law: Callable[[Any, Any], Any]) -> Any:
    """Force F with F = law(d - bg F, v - gg F), in the lanes that ask."""
    bg, gg = share
    f0 = law(d, v)
    asks = asks & ~(f0 == 0.0)

    def miss(force: Any) -> Any:
        return law(d - bg * force, v - gg * force) - force

    lo, glo, hi = Cell(group.full(0.0)), Cell(f0), Cell(f0)
    ghi = Cell(miss(f0))
    wide = Cell(asks & (ghi.now * f0 > 0.0))
    for _ in while_any(lambda: wide.now, group.trace, at_most=60):
        mine = wide.now
        lo.now, glo.now = where(mine, hi.now, lo.now), where(mine, ghi.now, glo.now)
        hi.now = where(mine, hi.now * 2.0, hi.now)
        ghi.now = where(mine, miss(hi.now), ghi.now)
        wide.now = mine & (ghi.now * f0 > 0.0)
    side, going = Cell(group.full(0.0)), Cell(asks)
    for _ in while_any(lambda: going.now, group.trace, at_most=200):
        a, b, ga, gb, last = lo.now, hi.now, glo.now, ghi.now, side.now
        mine = going.now & ~(gb == 0.0) & ~(size(b - a) <= group.limit.exact * (size(b) + size(a)))
        t = b - gb * (b - a) / (gb - ga)
        t = where((t > minimum(a, b)) & (t < maximum(a, b)), t, 0.5 * (a + b))
        g = miss(t)
        same, exact = mine & (g * f0 > 0.0), mine & (g == 0.0)
        other = mine & ~same & ~exact
        lo.now, glo.now = where(same, t, a), where(same, g, where(other & (last > 0.0), 0.5 * ga, ga))
        hi.now = where(other | exact, t, b)
        ghi.now = where(other, g, where(same & (last < 0.0), 0.5 * gb, gb))
        side.now = where(same, -1.0, where(other, 1.0, last))
        going.now = same | other
    return where(asks, hi.now, 0.0)


def correct(group: Group, h: Any) -> None:
    """Find the contact forces at the end of the step and correct its end with them."""
    s, spec = group.state, group.spec
    h = group.full(h)
    some = Cell(group.lanes_where(False))
    for j in group.each_contact():
        s["force", j] = 0.0
        some.now = some.now | (~(s["ke", j] == 0.0) if spec.located else penetration(group, j) > 0.0)
    live = some.now & (h > 0.0)
    with when_any(live):
        _sweep(group, live, h)


def _sweep(group: Group, live: Any, h: Any) -> None:
    s, spec = group.state, group.spec
    be, ga = group.prop("newmark_beta") * h * h, group.prop("newmark_gamma") * h
    share = where(s["stiff"] > 0.0, 1.0 / group.prop("newmark_gamma"), group.full(1.0))
    for j in group.each_contact():
        with when_any(live & ~(s["ke", j] == 0.0) if spec.located else live):
            for first, floors, _ in _sides(group, j):
                _keep_compliance(group, first, floors, h)

    def force_of(j: Any) -> Callable[[Any, Any], Any]:
        law = group.law_of(j)

        def force(d: Any, v: Any) -> Any:
            if not spec.located:
                return law.memoryless(group.stiffness(j), s["c", j], s["vrun", j], d, v)
            pressed = law.closed_force(s["ke", j], s["ce", j], d, v)
            return where(s["stiff"] > 0.0, yielding.held_force(group, j, d), pressed) if law.shape.yields else pressed

        return force

    def update(j: Any, here: Any) -> tuple[Any, Any]:
        unit = _unit(group, j) * share
        old = s["force", j]
        d = penetration(group, j) + be * unit * old
        v = group.between("v", j) + ga * unit * old
        new = where(here, solve(group, here, d, v, (be * unit, ga * unit), force_of(j)), old)
        return new, new - old

    _iterate(group, live, share, (be, ga), update)


def _iterate(
    group: Group, live: Any, share: Any, ends: tuple[Any, Any], update: Callable[[Any, Any], tuple[Any, Any]]
) -> None:
    """Sweep over the contacts until their forces, new and changed by `update`, move the end of the step no more."""
    s, spec, (be, ga) = group.state, group.spec, ends
    going, largest, moved = Cell(live), Cell(group.full(0.0)), Cell(group.full(0.0))
    for _ in while_any(lambda: going.now, group.trace, at_most=MAX_SWEEPS):
        mine = going.now
        most, change_most = Cell(group.full(0.0)), Cell(group.full(0.0))
        for j in group.each_contact():
            here = mine & ~(s["ke", j] == 0.0) if spec.located else mine
            with when_any(here):
                old = s["force", j]
                new, change = update(j, here)
                most.now = where(here, maximum(most.now, size(new)), most.now)
                change_most.now = where(here, maximum(change_most.now, size(change)), change_most.now)
                moves = here & ~(change == 0.0)
                with when_any(moves):
                    s["force", j] = where(moves, new, old)
                    for first, floors, sign in _sides(group, j):
                        _push(group, first, floors, be, ga, (-share if sign < 0.0 else share) * change, moves)
        largest.now, moved.now = where(mine, most.now, largest.now), where(mine, change_most.now, moved.now)
        going.now = mine & ~(change_most.now <= group.limit.swept * most.now)
    failed = going.now & (moved.now > group.limit.unswept * largest.now)
    s["unsolved"] = where(failed, 1.0, s["unsolved"])


def correct_resting(group: Group, h: Any) -> None:
    """Find the end forces by which resting floors accelerate as one; correct the end of the step with them."""
    s = group.state
    h = group.full(h)
    live = is_closed(group) & (h > 0.0)
    with when_any(live):
        be, ga = group.prop("newmark_beta") * h * h, group.prop("newmark_gamma") * h
        for j in group.each_contact():
            with when_any(live & (s["ke", j] > 0.0)):
                for first, floors, _ in _sides(group, j):
                    _keep_compliance(group, first, floors, h)
            s["force", j] = where(live, 0.0, s["force", j])

        def update(j: Any, here: Any) -> tuple[Any, Any]:
            del here
            change = group.between("a", j) / _unit(group, j)
            return s["force", j] + change, change

        _iterate(group, live, 1.0, (be, ga), update)


def balance(group: Group, lanes: Any, ground: Any, pressed: bool) -> None:
    """Find the accelerations of the equation of motion at the present state, contacts' forces in it if `pressed`."""
    s = group.state
    alone(group, ground)
    if pressed and group.spec.located and group.touching and not group.spec.impulsive:
        for j in group.each_contact():
            k = s["ke", j]
            force = group.law_of(j).pressing(k, s["ce", j], penetration(group, j), group.between("v", j))
            force = where(k == 0.0, 0.0, force)
            for floor, sign, share in group.ends(j):
                before = s["alone", floor]
                change = part_of(force, share) * group.prop("im", floor)
                s["alone", floor] = before - change if sign == "-" else before + change
    for i in group.each(group.spec.n_moving):
        s["a", i] = s["alone", i] if lanes is None else where(lanes, s["alone", i], s["a", i])


def soften(group: Group) -> None:
    """Mark lanes in which a closed contact is too stiff for the next sub-step."""
    s, h = group.state, group.state["h"]
    mine = (s["time_left"] > 0.0) & ~(s["land"] > 0.0)
    s["stiff"] = where(mine, 0.0, s["stiff"])
    closed = mine & is_closed(group)
    with when_any(closed):
        hard = Cell(closed & ~closed)
        for j in group.each_contact():
            law, here = group.law_of(j), closed & (s["mode", j] > OPEN)
            d, v = penetration(group, j), group.between("v", j)
            if law.shape.yields:
                yielding.set_plastic(group, j, here & (s["mode", j] == REBOUND), d)
            # the clip and the phase are those of the end, which `closed_force` knows
            s["ke", j], s["ce", j] = where(here, s["kl", j], s["ke", j]), where(here, s["cl", j], s["ce", j])
            if law.shape.yields:
                yielding.stick(group, j, here)
            ahead = maximum(d + maximum(v, 0.0) * minimum(h, s["lasts", j]), 0.0)
            hard.now = hard.now | (
                here & (h * contact_rate(law, s["ke", j], s["ce", j], group.prop("reduced", j), ahead) > STIFF_RATE)
            )
        stiff = hard.now
        s["stiff"] = where(stiff, 1.0, s["stiff"])
        soft = closed & ~stiff
        for j in group.each_contact():
            slack = soft & (s["mode", j] == SLACK)
            s["ce", j] = where(slack | (soft & (s["mode", j] == REBOUND)), 0.0, s["ce", j])
            s["ke", j] = where(slack, 0.0, s["ke", j])
            if group.law_of(j).shape.yields:
                yielding.slip(group, j, soft & (s["mode", j] == REBOUND), penetration(group, j))
        with when_any(stiff):
            balance(group, stiff, s["g0"], pressed=False)
            for i in group.each(group.spec.n_moving):
                s["a0", i] = where(stiff, s["a", i], s["a0", i])


def settle(group: Group, lanes: Any) -> None:
    """Work, peaks and modes of the closed contacts of marked lanes at the end of their sub-step."""
    s, r, h = group.state, group.asked, group.state["h"]
    for j in group.each_contact():
        law, here = group.law_of(j), lanes & (s["mode", j] > OPEN)
        d, v, force = penetration(group, j), group.between("v", j), s["force", j]
        if "force" in r:
            s["fmax", j] = where(here, maximum(s["fmax", j], force), s["fmax", j])
        if "penetration" in r:
            s["dmax", j] = where(here, maximum(s["dmax", j], d), s["dmax", j])
        if "impulse" in r:
            s["impulse", j] = where(here, s["impulse", j] + h * force, s["impulse", j])
        if "work" in r:
            w = 0.5 * h * force * (group.between("v0", j) + v)
            s["work", j] = where(here, s["work", j] + w, s["work", j])
        nears, parting = SIDES[law.shape.rebound_only]
        mode = where(d > 0.0, group.full(nears), OPEN)
        if law.shape.one_sided:
            mode = where((d > 0.0) & (v < 0.0), parting, mode)
        if law.shape.clips:
            slack = (s["cl", j] > 0.0) & (law.pressing(s["kl", j], s["cl", j], d, v) <= 0.0)
            mode = where((d > 0.0) & slack, SLACK, mode)
        pressing = mode == PRESSING
        s["ke", j] = where(here, where(pressing | (mode == REBOUND), s["kl", j], 0.0), s["ke", j])
        s["ce", j] = where(here, where(pressing, s["cl", j], 0.0), s["ce", j])
        if law.shape.yields:
            mode = where(here & pressing, yielding.settle(group, j, here & pressing, d, v), mode)
        s["mode", j] = where(here, mode, s["mode", j])


def touch_miss(group: Group) -> Any:
    """Time (s) by which a lane's sub-step went beyond (or fell short of) the touch that ends it."""
    s, late = group.state, Cell(group.full(0.0))
    for j in group.each_contact():
        nears = SIDES[group.law_of(j).shape.rebound_only][0]
        d, v = penetration(group, j), group.between("v", j)
        mine = (
            (s["mode", j] == OPEN) & (s["next", j] == nears) & (s["event", j] <= s["fraction"] + group.limit.same_time)
        )
        mine = mine & (v > 0.0) & (size(d) > group.limit.exact)
        late.now = where(mine, where(late.now == 0.0, d / v, maximum(late.now, d / v)), late.now)
    return late.now
