"""Newmark's method; contact is implicit.

Acceleration form: predictors

    u~ = u + h v + h^2 (1/2 - beta) a,    v~ = v + h (1 - gamma) a

then (M + gamma h C + beta h^2 K) a' = -M g' - C v~ - K u~ (+ contact), and
u' = u~ + beta h^2 a', v' = v~ + gamma h a'. The matrix is tridiagonal per building.

The contact forces at the end of the step solve the contact law together with the end state that they themselves change.
Each contact sees the row through one compliance, so each is one scalar equation, solved within a bracket; the contacts
are swept until none changes any more (block Gauss-Seidel).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from pounding_sweep.kernel import bouc_wen, impulse, links
from pounding_sweep.kernel.forces import (
    OPEN,
    PRESSING,
    REBOUND,
    SIDES,
    SLACK,
    contact_rate,
    held_force,
    is_closed,
    penetration,
    set_plastic,
    settle_yielding,
    slip,
    stick,
)
from pounding_sweep.kernel.group import Group, part_of
from pounding_sweep.kernel.lanes import Cell, constant, fma, maximum, minimum, size, when_any, where, while_any
from pounding_sweep.kernel.march import keep_start
from pounding_sweep.kernel.row import (
    Part,
    Pushes,
    accelerations,
    add_forces,
    damper_stiffness,
    powers,
    put_accelerations,
)
from pounding_sweep.schemes.base import Scheme

#: Sweeps over the contacts before the implicit solution is given up (the lane is flagged).
MAX_SWEEPS = 500
#: Product of sub-step and contact rate beyond which the contact's end force acts over all of the sub-step.
STIFF_RATE = 2.0
#: Floors that a contact acts on at one of its sides, and the share of each (None: all).
Floors = list[tuple[Any, Any]]


def _step(group: Group, part: Part, start: Sequence[Sequence[Any]], h: Any) -> tuple[list[Any], list[Any], list[Any]]:
    """Return displacements, velocities and accelerations after a step from those of its start."""
    beta, gamma, (u, v, a) = group.prop("newmark_beta"), group.prop("newmark_gamma"), start
    h = group.full(h)
    be, gg, pu, pv = beta * (h * h), gamma * h, h * h * (0.5 - beta), h * (1.0 - gamma)
    every = range(len(u))
    x = [fma(pu, a[p], fma(h, v[p], u[p])) for p in every]
    y = [fma(pv, a[p], v[p]) for p in every]
    push = Pushes(group, rows=False)
    push.add_links(x, y)
    ends = _solve_row(
        group, part, be, gg, accelerations(group, part, x, y, group.state["g1"], push.on(every), loads=True)
    )
    return [fma(be, ends[p], x[p]) for p in every], [fma(gg, ends[p], y[p]) for p in every], ends


def _solve_row(group: Group, part: Part, be: Any, ga: Any, right: Sequence[Any]) -> list[Any]:
    """Return (M + ga C + be K)^-1 `right` of buildings that move as one."""
    # Floors are eliminated in the order in which they have the fewest others left beside them, which is known when the
    # kernel is written.
    storeys = [_storey_stiffness(group, b, i, be, ga) for b, floors in part for i in floors]
    diagonal: list[Any] = []
    beside: list[dict[int, Any]] = [{} for _ in right]
    for b, floors in part:
        for s, i in enumerate(floors):
            p, m = len(diagonal), group.prop("m", i)
            if group.base(i) is not None:
                diagonal.append(m)
                continue
            own = storeys[p] if i is floors[-1] else storeys[p] + storeys[p + 1]
            diagonal.append(fma(m, ga * group.prop("alpha", b), m) + own)
            if s:
                beside[p][p - 1] = beside[p - 1][p] = -storeys[p]
    _stiffen(group, diagonal, beside, storeys, be, ga)
    for j, (p, q) in enumerate(group.spec.links):
        held = fma(ga, group.prop("link_c", j), be * group.prop("link_k", j))
        diagonal[p], diagonal[q] = diagonal[p] + held, diagonal[q] + held
        beside[p][q] = beside[q][p] = -held
    x, left, done = list(right), set(range(len(right))), []
    while left:
        i = min(left, key=lambda i: (len(beside[i]), i))
        left.remove(i)
        others, inverse = sorted(beside[i]), 1.0 / diagonal[i]
        for p in others:
            share = beside[i][p] * inverse
            x[p] = fma(-share, x[i], x[p])
            diagonal[p] = fma(-share, beside[i][p], diagonal[p])
            for q in (q for q in others if q > p):
                change = -share * beside[i][q]
                beside[p][q] = beside[q][p] = beside[p][q] + change if q in beside[p] else change
            del beside[p][i]
        done.append((i, inverse))
    for i, inverse in reversed(done):
        for p, value in beside[i].items():
            x[i] = fma(-value, x[p], x[i])
        x[i] = x[i] * inverse
    return x


def _stiffen(
    group: Group, diagonal: list[Any], beside: list[dict[int, Any]], storeys: Sequence[Any], be: Any, ga: Any
) -> None:
    """Add to the matrix of an implicit step what foundations, and storeys above them by `storeys`, add to it."""

    def add(share: Any, moved: dict[int, Any]) -> None:  # share times the square of a sum of weighted motions
        for p, x in moved.items():
            part = share * x
            diagonal[p] = fma(part, x, diagonal[p])
            for q, z in moved.items():
                if q > p:
                    other = part * z
                    beside[p][q] = beside[q][p] = beside[p][q] + other if q in beside[p] else other

    for b in group.spec.foundations:
        floors, base = group.building_floors[b], group.spec.base(b)
        assert base is not None
        sway, rocks = base
        for i in base:
            held = fma(ga, group.prop("dashpot", i), be * group.prop("k", i))
            diagonal.append(group.prop("m", i) + held)
        for i in floors:
            below = group.spec.below(i)
            assert below is not None
            one = group.full(1.0)
            add(storeys[i], {i: one, below: -one, rocks: -group.full(group.prop("height", i))})
            drag = ga * group.prop("alpha", b) * group.prop("m", i)
            add(drag, {i: one, sway: -one, rocks: -group.full(group.prop("elevation", i))})


def _storey_stiffness(group: Group, b: Any, i: Any, be: Any, ga: Any) -> Any:
    """Stiffness by which a storey resists an acceleration at the end of a Newmark step, its damper included."""
    if not group.own_damper(i):
        return fma(ga, group.prop("beta", b), be) * group.prop("k", i)
    k = group.state["kt", i] if group.yields(i) else group.prop("k", i)
    found = be * k + ga * group.prop("beta", b) * damper_stiffness(group, i)
    return found + ga * group.prop("dashpot", i) if group.dashed(i) else found


def _sides(group: Group, j: Any) -> list[tuple[Any, Floors, float]]:
    """Sides of a contact that move: where their responses begin, the floors, the sign of the force on them."""
    if group.spec.whole:  # both are of one whole, whose response is to the push on both
        each = ((i, sign, group.full(1.0) if share is None else share) for i, sign, share in group.ends(j))
        both = [(i, -share if sign == "-" else share) for i, sign, share in each]
        return [(j * group.spec.n_moving, both, 1.0)]
    most = max(group.spec.storeys)
    sides = ((side, group.floors_of(j, side), sign) for side, sign in enumerate((-1.0, 1.0)))
    return [((j * 2 + side) * most, floors, sign) for side, floors, sign in sides if floors]


def _whole(group: Group, floor: Any) -> tuple[Any, Any]:
    """First floor and number of floors of what moves as one with a floor in a step."""
    return (0, group.spec.n_moving) if group.spec.whole else group.home_of(floor)[:2]


def _keep_compliance(group: Group, first: Any, floors: Floors, h: Any) -> None:
    """Keep the acceleration of every floor of a building for a unit force on some, in a Newmark step of length h."""
    s, beta, gamma = group.state, group.prop("newmark_beta"), group.prop("newmark_gamma")
    be, ga = beta * h * h, gamma * h
    if group.spec.whole:
        right = [group.full(0.0) for _ in range(group.spec.n_moving)]
        for floor, share in floors:
            right = [where(constant(floor == i), share, x) for i, x in enumerate(right)]
        for i, x in enumerate(_solve_row(group, list(enumerate(group.building_floors)), be, ga, right)):
            s["response", first + i] = x
        return
    home, storeys, b = group.home_of(floors[0][0])

    def stiffness(i: Any) -> Any:
        return _storey_stiffness(group, b, i, be, ga)

    def ahead(p: Any, above: Any) -> tuple[Any, Any]:
        i = home + p
        diagonal = group.prop("m", i) * (1.0 + ga * group.prop("alpha", b)) + stiffness(i) + above
        pushed = None
        for floor, share in floors:
            here, own = constant(i == floor), group.full(1.0 if share is None else share)
            pushed = where(here, own, group.full(0.0) if pushed is None else pushed)
        return diagonal, pushed

    def above(p: Any) -> Any:
        top = p + 1 == storeys
        if not isinstance(top, bool):
            i = where(top, home + p, home + p + 1)
            return where(top, 0.0, group.full(stiffness(i)))
        return 0.0 if top else stiffness(home + p + 1)

    # elimination from the bottom, as in the flight step
    s["diagonal"], s["response", first] = ahead(0, above(0))
    for q in group.each(storeys - 1):
        p = q + 1
        k = stiffness(home + p)
        diagonal, right = ahead(p, above(p))
        low = -k / s["diagonal", q]
        s["diagonal", p] = diagonal + low * k
        s["response", first + p] = right - low * s["response", first + q]
    last = storeys - 1
    s["response", first + last] = s["response", first + last] / s["diagonal", last]
    for q in group.each(last):
        p = last - 1 - q
        found = s["response", first + p] + stiffness(home + p + 1) * s["response", first + p + 1]
        s["response", first + p] = found / s["diagonal", p]


def _push(group: Group, first: Any, floors: Floors, be: Any, ga: Any, change: Any, lanes: Any) -> None:
    """Add a change (kN) of force to the end state of a building."""
    s = group.state
    home, storeys = _whole(group, floors[0][0])
    for p in group.each(storeys):
        i = home + p
        a = change * s["response", first + p]
        s.put(lanes, s["a", i] + a, "a", i)
        s.put(lanes, s["u", i] + be * a, "u", i)
        s.put(lanes, s["v", i] + ga * a, "v", i)


def _unit(group: Group, j: Any) -> Any:
    """Relative acceleration of a contact's floors for a unit force."""
    unit = group.full(0.0)
    for first, floors, _ in _sides(group, j):
        for floor, share in floors:
            unit = unit + part_of(group.state["response", first + (floor - _whole(group, floor)[0])], share)
    return unit


def _solve(group: Group, asks: Any, d: Any, v: Any, share: tuple[Any, Any], law: Callable[[Any, Any], Any]) -> Any:
    """Force F with F = law(d - bg F, v - gg F), in the lanes that ask."""
    bg, gg = share
    f0 = law(d, v)
    asks = asks & ~(f0 == 0.0)

    def miss(force: Any) -> Any:
        return law(d - bg * force, v - gg * force) - force

    lo, glo, hi = Cell(group.full(0.0)), Cell(f0), Cell(f0)
    ghi = Cell(miss(f0))
    wide = Cell(asks & (ghi.now * f0 > 0.0))
    for _ in while_any(lambda: wide.now, at_most=60):
        mine = wide.now
        lo.now, glo.now = where(mine, hi.now, lo.now), where(mine, ghi.now, glo.now)
        hi.now = where(mine, hi.now * 2.0, hi.now)
        ghi.now = where(mine, miss(hi.now), ghi.now)
        wide.now = mine & (ghi.now * f0 > 0.0)
    side, going = Cell(group.full(0.0)), Cell(asks)
    for _ in while_any(lambda: going.now, at_most=200):
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
    some = Cell(group.full(False))
    for j in group.each_contact():
        s["force", j] = 0.0
        some.now |= ~(s["ke", j] == 0.0) if spec.located else penetration(group, j) > 0.0
    live = some.now & (h > 0.0)
    with when_any(live):
        be, ga = group.prop("newmark_beta") * h * h, group.prop("newmark_gamma") * h
        share = where(s["stiff"] > 0.0, 1.0 / group.prop("newmark_gamma"), 1.0)
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
                return where(s["stiff"] > 0.0, held_force(group, j, d), pressed) if law.shape.yields else pressed

            return force

        def update(j: Any, here: Any) -> tuple[Any, Any]:
            unit = _unit(group, j) * share
            old = s["force", j]
            d = penetration(group, j) + be * unit * old
            v = group.between("v", j) + ga * unit * old
            new = where(here, _solve(group, here, d, v, (be * unit, ga * unit), force_of(j)), old)
            return new, new - old

        _iterate(group, live, share, (be, ga), update)


def _iterate(
    group: Group, live: Any, share: Any, ends: tuple[Any, Any], update: Callable[[Any, Any], tuple[Any, Any]]
) -> None:
    """Sweep over the contacts until their forces, new and changed by `update`, move the end of the step no more."""
    s, spec, (be, ga) = group.state, group.spec, ends
    going, largest, moved = Cell(live), Cell(group.full(0.0)), Cell(group.full(0.0))
    for _ in while_any(lambda: going.now, at_most=MAX_SWEEPS):
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
    s.put(failed, 1.0, "unsolved")


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
            s.put(live, 0.0, "force", j)

        def update(j: Any, here: Any) -> tuple[Any, Any]:
            del here
            change = group.between("a", j) / _unit(group, j)
            return s["force", j] + change, change

        _iterate(group, live, 1.0, (be, ga), update)


def balance(group: Group, lanes: Any, end: str = "1") -> None:
    """Find the accelerations at the end of a step by the equation of motion; at its start ("0") without contacts."""
    s = group.state
    put_accelerations(group, "alone", "u", "v", s[f"g{end}"])
    if end == "1" and group.spec.located and group.touching and not group.spec.impulsive:

        def force(j: Any) -> Any:
            k, d, v = s["ke", j], penetration(group, j), group.between("v", j)
            return where(k == 0.0, 0.0, group.law_of(j).pressing(k, s["ce", j], d, v))

        add_forces(group, "alone", force)
    for i in group.each(group.spec.n_moving):
        s.put(lanes, s["alone", i], "a", i)


def soften(group: Group) -> None:
    """Mark lanes in which a closed contact is too stiff for the next sub-step."""
    s, h = group.state, group.state["h"]
    mine = (s["time_left"] > 0.0) & ~(s["land"] > 0.0)
    s.put(mine, 0.0, "stiff")
    closed = mine & is_closed(group)
    with when_any(closed):
        hard = Cell(closed & ~closed)
        for j in group.each_contact():
            law, here = group.law_of(j), closed & (s["mode", j] > OPEN)
            d, v = penetration(group, j), group.between("v", j)
            if law.shape.yields:
                set_plastic(group, j, here & (s["mode", j] == REBOUND), d)
            # the clip and the phase are those of the end, which `closed_force` knows
            s.put(here, s["kl", j], "ke", j)
            s.put(here, s["cl", j], "ce", j)
            if law.shape.yields:
                stick(group, j, here)
            ahead = maximum(d + maximum(v, 0.0) * minimum(h, s["lasts", j]), 0.0)
            hard.now |= here & (
                h * contact_rate(law, s["ke", j], s["ce", j], group.prop("reduced", j), ahead) > STIFF_RATE
            )
        stiff = hard.now
        s.put(stiff, 1.0, "stiff")
        soft = closed & ~stiff
        for j in group.each_contact():
            slack = soft & (s["mode", j] == SLACK)
            s.put(slack | (soft & (s["mode", j] == REBOUND)), 0.0, "ce", j)
            s.put(slack, 0.0, "ke", j)
            if group.law_of(j).shape.yields:
                slip(group, j, soft & (s["mode", j] == REBOUND), penetration(group, j))
        with when_any(stiff):
            balance(group, stiff, end="0")
            for i in group.each(group.spec.n_moving):
                s.put(stiff, s["a", i], "a0", i)


def settle(group: Group, lanes: Any) -> None:
    """Work, peaks and modes of the closed contacts of marked lanes at the end of their sub-step."""
    s, r, h = group.state, group.asked, group.state["h"]
    for j in group.each_contact():
        law, here = group.law_of(j), lanes & (s["mode", j] > OPEN)
        d, v, force = penetration(group, j), group.between("v", j), s["force", j]
        if "force" in r:
            s.put(here, maximum(s["fmax", j], force), "fmax", j)
        if "penetration" in r:
            s.put(here, maximum(s["dmax", j], d), "dmax", j)
        if "impulse" in r:
            s.put(here, s["impulse", j] + h * force, "impulse", j)
        if "work" in r:
            w = 0.5 * h * force * (group.between("v0", j) + v)
            s.put(here, s["work", j] + w, "work", j)
        nears, parting = SIDES[law.shape.rebound_only]
        mode = where(d > 0.0, group.full(nears), OPEN)
        if law.shape.one_sided:
            mode = where((d > 0.0) & (v < 0.0), parting, mode)
        if law.shape.clips:
            slack = (s["cl", j] > 0.0) & (law.pressing(s["kl", j], s["cl", j], d, v) <= 0.0)
            mode = where((d > 0.0) & slack, SLACK, mode)
        pressing = mode == PRESSING
        s.put(here, where(pressing | (mode == REBOUND), s["kl", j], 0.0), "ke", j)
        s.put(here, where(pressing, s["cl", j], 0.0), "ce", j)
        if law.shape.yields:
            mode = where(here & pressing, settle_yielding(group, j, here & pressing, d, v), mode)
        s.put(here, mode, "mode", j)


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


def add_gains(group: Group) -> None:
    """Add the energies of a step: powers of input and damping at both ends, by the trapezoid."""
    s = group.state
    h6 = s["h"] * (1.0 / 6.0)
    for part, moving in group.each_part() if "energy" in group.asked else ():
        early = powers(group, part, [s["v0", i] for i in moving], s["g0"])
        late = powers(group, part, [s["v", i] for i in moving], s["g1"])
        for (b, _), first, last in zip(part, early, late, strict=True):
            s["e_in", b] = fma(h6, 3.0 * (first[0] + last[0]), s["e_in", b])
            s["e_damp", b] = fma(h6, 3.0 * (first[1] + last[1]), s["e_damp", b])
    if group.spec.smooth:
        bouc_wen.add_lost(group)
    if "links" in group.asked:
        links.add_powers(group, "u0", "v0", 3.0, first=True)
        links.add_powers(group, "u", "v", 3.0, first=False)
        links.record(group, h6)


class Newmark(Scheme):
    """Newmark's method with its beta and gamma, average acceleration by default."""

    name = "newmark"
    title = "Newmark's method, with contact implicit; average acceleration unless `beta` and `gamma` are given"
    source = "Newmark 1959"
    order = 2
    implicit = True
    min_ground_steps = 8.0
    follows_smooth = True
    parameters = ("beta", "gamma")
    without_limit = "beta >= (gamma + 0.5)^2 / 4, which has no limit,"
    min_steps_located = 12.0
    step_cost = 4.5
    ladder = (1, 2, 4, 8, 16, 32, 64, 128, 256)  # its second order needs many
    finest_float32 = 128

    def stability_limit(self, w2: np.ndarray, rate: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        """Of the undamped motion, which damping only extends; infinite where beta and gamma leave none."""
        if beta >= 0.25 * (gamma + 0.5) ** 2 or gamma / 2.0 - beta <= 0.0:
            return np.full(w2.shape, np.inf)
        return np.asarray(1.0 / np.sqrt(w2 * (gamma / 2.0 - beta)))

    def phase_error(self, x: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        """By the first terms."""
        return np.hypot((0.5 * beta - 1.0 / 24.0) * x * x, 0.5 * (gamma - 0.5) * x)

    soften, settle = staticmethod(soften), staticmethod(settle)
    balance, touch_miss = staticmethod(balance), staticmethod(touch_miss)

    def begin(self, group: Group) -> None:
        """Accelerations at the start, which are part of the state."""
        if group.spec.impulsive and group.touching:
            impulse.rest(group, group.state["scale"] == group.state["scale"])
        else:
            balance(group, None)

    def flight(self, group: Group, h: Any) -> Callable[[], None]:
        """Take a step of all lanes without contact."""
        if group.spec.smooth:
            keep_start(group)
            return self.trial(group)
        self._reach(group, h, flies=True)
        return lambda: add_gains(group)

    def plain(self, group: Group, h: Any) -> Callable[[], None]:
        """Take a step of all lanes whose contacts follow from the present state alone."""
        add = self.flight(group, h)
        correct(group, h)
        return add

    def trial(self, group: Group) -> Callable[[], None]:
        """Try a sub-step of every lane's own length, contacts implicit."""
        for _ in bouc_wen.rounds(group) if group.spec.smooth else (None,):
            self._reach(group, group.state["h"])
        return lambda: add_gains(group)

    def _reach(self, group: Group, h: Any, flies: bool = False) -> None:
        """Go to the end of a sub-step, shears of storeys in straight lines; if it `flies`, from the present state."""
        s = group.state
        for part, moving in group.each_part(group.spec.whole):
            before = [[s[name if flies else f"{name}0", i] for i in moving] for name in "uva"]
            for name, old, new in zip("uva", before, _step(group, part, before, h), strict=True):
                for i, x, y in zip(moving, old, new, strict=True):
                    if flies:
                        s[f"{name}0", i] = x
                    # a lane that is done waits with h = 0: its acceleration, contact included, stays as it is
                    s[name, i] = where(h > 0.0, y, x) if name == "a" and not flies else y
        if flies:
            return
        if group.spec.impulsive:
            correct_resting(group, h)
        elif group.touching:
            correct(group, h)
