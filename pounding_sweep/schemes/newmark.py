"""Newmark's method, in acceleration form; contact is implicit.

    u~ = u + h v + h^2 (1/2 - beta) a,    v~ = v + h (1 - gamma) a
    (M + gamma h C + beta h^2 K) a' = -M g' - C v~ - K u~ (+ contact)
    u' = u~ + beta h^2 a',    v' = v~ + gamma h a'

Each contact sees the row through one compliance, so its force at the end of the step is one scalar equation, solved
within a bracket; the contacts are swept until none changes any more (block Gauss-Seidel).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from pounding_sweep.kernel import forces, hysteresis, impulse, links, row
from pounding_sweep.kernel.forces import OPEN, REBOUND, SIDES, SLACK
from pounding_sweep.kernel.group import Contact, Group, Part, Storey, part_of, signed_sum
from pounding_sweep.kernel.march import keep_start, refuse
from pounding_sweep.kernel.row import powers
from pounding_sweep.kernel.types import Index, Lanes, Truths
from pounding_sweep.lanes import Cell, constant, fma, maximum, minimum, size, when_any, where, while_any
from pounding_sweep.schemes.base import Scheme

#: Sweeps over the contacts before the implicit solution is given up (the lane is flagged).
MAX_SWEEPS = 500
#: Product of sub-step and contact rate beyond which the contact's end force acts over all of the sub-step.
STIFF_RATE = 2.0
#: Landings on the same touch that Newton improves, and those in all.
MAX_NEWTON, MAX_LANDINGS = 4.0, 40.0
#: Most of its duration by which a contact may be switched on late: by its square, energy would come from nothing.
LATE = 0.01
#: Floors that a contact acts on at one of its sides, and the share of each (None: all).
Floors = list[tuple[Index, Lanes]]


def _solve_row(group: Group, part: Part, be: Lanes, ga: Lanes, right: Sequence[Lanes]) -> list[Lanes]:
    """Return (M + ga C + be K)^-1 `right` of buildings that move as one."""
    # Floors are eliminated in the order in which they have the fewest others left beside them, which is known when the
    # kernel is written.
    diagonal, coupling = _matrix(group, part, be, ga)
    x, left, done = list(right), set(range(len(right))), []
    while left:
        i = min(left, key=lambda i: (len(coupling[i]), i))
        left.remove(i)
        others, inverse = sorted(coupling[i]), 1.0 / diagonal[i]
        for p in others:
            share = coupling[i][p] * inverse
            x[p] = fma(-share, x[i], x[p])
            diagonal[p] = fma(-share, coupling[i][p], diagonal[p])
            for q in (q for q in others if q > p):
                change = -share * coupling[i][q]
                coupling[p][q] = coupling[q][p] = coupling[p][q] + change if q in coupling[p] else change
            del coupling[p][i]
        done.append((i, inverse))
    for i, inverse in reversed(done):
        for p, value in coupling[i].items():
            x[i] = fma(-value, x[p], x[i])
        x[i] = x[i] * inverse
    return x


def _matrix(group: Group, part: Part, be: Lanes, ga: Lanes) -> tuple[list[Lanes], list[dict[int, Lanes]]]:
    """Return M + ga C + be K: its diagonal, and what lies beside it."""
    terms: dict[tuple[int, int], list[tuple[int, Lanes]]] = {}
    links = list(group.iter_links(straight=True)) if group.spec.solves_row else []
    for element in [*(element for block in part.blocks for element in block.elements), *links]:
        for p, q, sign, entry in element.entries(be, ga):
            terms.setdefault((min(p, q), max(p, q)), []).append((sign, entry))
    diagonal: list[Lanes] = [None] * len(part.dofs)
    for b, places, on_ground, _ in part.blocks:
        for p in places:
            m, stiff = group.prop("m", part.dofs[p]), signed_sum(terms.pop((p, p)))
            diagonal[p] = (fma(m, ga * group.prop("alpha", b), m) if on_ground else m) + stiff
    coupling: list[dict[int, Lanes]] = [{} for _ in part.dofs]
    for (p, q), values in terms.items():
        coupling[p][q] = coupling[q][p] = signed_sum(values)
    return diagonal, coupling


def _sides(contact: Contact) -> list[tuple[Index, Floors, float]]:
    """Sides of a contact that move: where their responses begin, the floors, the sign of the force on them."""
    group = contact.group
    if group.spec.solves_row:  # both are of one whole, whose response is to the push on both
        pushed = [(i, float(sign) * share) for i, sign, share in contact.on_ends(group.full(1.0))]
        return [(contact.index * group.spec.n_moving, pushed, 1.0)]
    most = max(group.spec.storeys)
    sides = ([(i, share) for i, sign, share in contact.ends if sign == of] for of in (1, -1))
    signed = enumerate(zip(sides, (-1.0, 1.0), strict=True))
    return [((contact.index * 2 + side) * most, floors, sign) for side, (floors, sign) in signed if floors]


def _moving_floors(group: Group, floor: Index) -> tuple[Index, Index]:
    """First floor and number of floors of what moves as one with a floor in a step."""
    return (0, group.spec.n_moving) if group.spec.solves_row else group.home_of(floor)[:2]


def _keep_compliance(group: Group, first: Index, floors: Floors, be: Lanes, ga: Lanes) -> None:
    """Keep the acceleration of every floor of a building for a unit force on some at the end of a Newmark step."""
    s = group.state
    if group.spec.solves_row:
        right = [group.full(0.0) for _ in range(group.spec.n_moving)]
        for floor, share in floors:
            right = [where(constant(floor == i), share, x) for i, x in enumerate(right)]
        for i, x in enumerate(_solve_row(group, group.part(*enumerate(group.spec.floors)), be, ga, right)):
            s["response", first + i] = x
        return
    home, storeys, b = group.home_of(floors[0][0])

    def stiffness(i: Index) -> Lanes:
        return Storey(group, i, (), building=b).resistance(be, ga)

    def ahead(p: Index) -> tuple[Lanes, Lanes]:
        i, top, above = home + p, p + 1 == storeys, 0.0
        if not isinstance(top, bool):
            above = where(top, group.full(0.0), group.full(stiffness(where(top, i, i + 1))))
        elif not top:
            above = stiffness(i + 1)
        pushed = None
        for floor, share in floors:
            is_floor = constant(i == floor)
            pushed = where(
                is_floor, group.full(1.0 if share is None else share), group.full(0.0) if pushed is None else pushed
            )
        return group.prop("m", i) * (1.0 + ga * group.prop("alpha", b)) + stiffness(i) + above, pushed

    # elimination from the bottom, as in the flight step
    s["diagonal"], s["response", first] = ahead(0)
    for q in group.indices(storeys - 1):
        k, (diagonal, right) = stiffness(home + q + 1), ahead(q + 1)
        low = -k / s["diagonal", q]
        s["diagonal", q + 1] = diagonal + low * k
        s["response", first + q + 1] = right - low * s["response", first + q]
    last = storeys - 1
    s["response", first + last] = s["response", first + last] / s["diagonal", last]
    for q in group.indices(last):
        p = last - 1 - q
        x = s["response", first + p] + stiffness(home + p + 1) * s["response", first + p + 1]
        s["response", first + p] = x / s["diagonal", p]


def _solve(
    group: Group, asks: Truths, d: Lanes, v: Lanes, share: tuple[Lanes, Lanes], law: Callable[[Lanes, Lanes], Lanes]
) -> Lanes:
    """Force F with F = law(d - bg F, v - gg F), in the lanes that ask."""
    bg, gg = share
    f0 = law(d, v)
    asks = asks & ~(f0 == 0.0)

    def miss(force: Lanes) -> Lanes:
        return law(d - bg * force, v - gg * force) - force

    lo, glo, hi = group.cell(0.0), Cell(f0), Cell(f0)
    ghi = Cell(miss(f0))
    wide = Cell(asks & (ghi.now * f0 > 0.0))
    for _ in while_any(lambda: wide.now, at_most=60):
        mask = wide.now
        lo.now, glo.now = where(mask, hi.now, lo.now), where(mask, ghi.now, glo.now)
        hi.now = where(mask, hi.now * 2.0, hi.now)
        ghi.now = where(mask, miss(hi.now), ghi.now)
        wide.now = mask & (ghi.now * f0 > 0.0)
    side, active = group.cell(0.0), Cell(asks)
    for _ in while_any(lambda: active.now, at_most=200):
        a, b, ga, gb, last = lo.now, hi.now, glo.now, ghi.now, side.now
        mask = active.now & ~(gb == 0.0) & ~(size(b - a) <= group.limit.exact * (size(b) + size(a)))
        t = b - gb * (b - a) / (gb - ga)
        t = where((t > minimum(a, b)) & (t < maximum(a, b)), t, 0.5 * (a + b))
        g = miss(t)
        same, exact = mask & (g * f0 > 0.0), mask & (g == 0.0)
        other = mask & ~same & ~exact
        lo.now, glo.now = where(same, t, a), where(same, g, where(other & (last > 0.0), 0.5 * ga, ga))
        hi.now = where(other | exact, t, b)
        ghi.now = where(other, g, where(same & (last < 0.0), 0.5 * gb, gb))
        side.now = where(same, -1.0, where(other, 1.0, last))
        active.now = same | other
    return where(asks, hi.now, 0.0)


def _iterate(
    group: Group,
    live: Truths,
    share: Lanes,
    ends: tuple[Lanes, Lanes],
    update: Callable[[Contact, Truths], tuple[Lanes, Lanes]],
) -> None:
    """Sweep over the contacts until their forces, new and changed by `update`, move the end of the step no more."""
    s, (be, ga) = group.state, ends
    active, largest, moved = Cell(live), group.cell(0.0), group.cell(0.0)
    for _ in while_any(lambda: active.now, at_most=MAX_SWEEPS):
        most, change_most = group.cell(0.0), group.cell(0.0)
        for contact in group.iter_contacts():
            pressing = _active(contact, active.now)
            with when_any(pressing):
                old = contact.force
                new, change = update(contact, pressing)
                most.now = where(pressing, maximum(most.now, size(new)), most.now)
                change_most.now = where(pressing, maximum(change_most.now, size(change)), change_most.now)
                moves = pressing & ~(change == 0.0)
                with when_any(moves):
                    contact.force = where(moves, new, old)
                    for first, floors, sign in _sides(contact):
                        push = (-share if sign < 0.0 else share) * change
                        home, storeys = _moving_floors(group, floors[0][0])
                        for p in group.indices(storeys):
                            a = push * s["response", first + p]
                            for name, x in (("a", a), ("u", be * a), ("v", ga * a)):
                                s.put(moves, s[name, home + p] + x, name, home + p)
        largest.now, moved.now = where(active.now, most.now, largest.now), where(active.now, change_most.now, moved.now)
        active.now &= ~(change_most.now <= group.limit.swept * most.now)
    s.put(active.now & (moved.now > group.limit.unswept * largest.now), 1.0, "unsolved")


def _active(contact: Contact, lanes: Truths) -> Truths:
    """Those of some lanes in which a contact may press."""
    return lanes & ~(contact.k_active == 0.0) if contact.group.spec.located else lanes


def correct(group: Group, h: Lanes) -> None:
    """Find the contact forces at the end of the step and correct its end with them."""
    # floors at rest on each other accelerate as one
    s, spec, h = group.state, group.spec, group.full(h)
    may_press = group.cell(False)
    for contact in group.iter_contacts():
        contact.force = 0.0
        may_press.now |= ~(contact.k_active == 0.0) if spec.located else contact.penetration() > 0.0
    live = may_press.now & (h > 0.0)
    with when_any(live):
        be, ga = group.prop("newmark_beta") * h * h, group.prop("newmark_gamma") * h
        share = where(s["stiff"] > 0.0, 1.0 / group.prop("newmark_gamma"), 1.0) if not spec.impulsive else 1.0
        for contact in group.iter_contacts():
            with when_any(_active(contact, live)):
                for first, floors, _ in _sides(contact):
                    _keep_compliance(group, first, floors, be, ga)

        def force_of(contact: Contact, d: Lanes, v: Lanes) -> Lanes:
            law = contact.law
            if not spec.located:
                return law.memoryless(contact.stiffness, contact.c, contact.fastest, d, v)
            pressed = law.closed_force(contact.k_active, contact.c_active, d, v)
            return where(s["stiff"] > 0.0, forces.force_at_end(contact, d), pressed) if law.shape.yields else pressed

        def update(contact: Contact, lanes: Truths) -> tuple[Lanes, Lanes]:
            unit, old = group.full(0.0), contact.force  # relative acceleration for a unit force
            for first, floors, _ in _sides(contact):
                for floor, part in floors:
                    unit = unit + part_of(s["response", first + (floor - _moving_floors(group, floor)[0])], part)
            if spec.impulsive:
                change = contact.between("a") / unit
                return old + change, change
            unit = unit * share
            d, v = contact.penetration() + be * unit * old, contact.between("v") + ga * unit * old
            new = where(lanes, _solve(group, lanes, d, v, (be * unit, ga * unit), partial(force_of, contact)), old)
            return new, new - old

        _iterate(group, live, share, (be, ga), update)


class Newmark(Scheme):
    """Newmark's method with its beta and gamma, average acceleration by default."""

    name = "newmark"
    title = "Newmark's method, with contact implicit; average acceleration unless `beta` and `gamma` are given"
    source = "Newmark 1959"
    order = 2
    implicit = True
    min_ground_steps = 8.0
    follows_flow = True
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
        return 1.0 / np.sqrt(w2 * (gamma / 2.0 - beta))

    def phase_error(self, x: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        """By the first terms."""
        return np.hypot((0.5 * beta - 1.0 / 24.0) * x * x, 0.5 * (gamma - 0.5) * x)

    def declare_rows(self, group: Group) -> None:
        """Declare accelerations, and how floors respond to forces of contacts."""
        super().declare_rows(group)
        spec, most = group.spec, max(group.spec.storeys)
        group.declare(spec.n_moving, "a", "alone", of_law=True)
        if group.touching:
            group.declare((spec.n_moving if spec.solves_row else 2 * most) * len(spec.contacts), "response")
            group.declare(most, "diagonal")

    def begin(self, group: Group) -> None:
        """Accelerations at the start, which are part of the state."""
        if group.spec.impulsive and group.touching:
            impulse.resting_accelerations(group, group.full(True))
        else:
            self.balance(group, None)

    def flight(self, group: Group, h: Lanes) -> Callable[[], None]:
        """Take a step of all lanes without contact."""
        if group.spec.flowing:
            keep_start(group)
            return self.trial(group)
        self._reach(group, h, flies=True)
        return partial(self._add_gains, group)

    def plain(self, group: Group, h: Lanes) -> Callable[[], None]:
        """Take a step of all lanes whose contacts follow from the present state alone."""
        add = self.flight(group, h)
        correct(group, h)
        return add

    def trial(self, group: Group) -> Callable[[], None]:
        """Try a sub-step of every lane's own length, contacts implicit."""

        def take() -> None:
            self._reach(group, group.state["h"])
            if group.touching:
                correct(group, group.state["h"])

        if group.spec.flowing:
            hysteresis.solve_step(group, take)
        else:
            take()
        return partial(self._add_gains, group)

    def _reach(self, group: Group, h: Lanes, flies: bool = False) -> None:
        """Go to the end of a sub-step, shears of storeys in straight lines; if it `flies`, from the present state."""
        s, beta, gamma, h = group.state, group.prop("newmark_beta"), group.prop("newmark_gamma"), group.full(h)
        be, gg, pu, pv = (beta * (h * h), gamma * h, h * h * (0.5 - beta), h * (1.0 - gamma))
        for part in group.iter_parts(group.spec.solves_row):
            moving = part.dofs
            before = u, v, a = [[s[name if flies else f"{name}0", i] for i in moving] for name in "uva"]
            every = range(len(u))
            x, y = [fma(pu, a[p], fma(h, v[p], u[p])) for p in every], [fma(pv, a[p], v[p]) for p in every]
            push = row.Pushes(group, rows=False)
            push.add_links(x, y)
            loads = row.accelerations(group, part, x, y, group.ground.at(1.0), push.on(every), loads=True)
            ends = _solve_row(group, part, be, gg, loads)
            after = [fma(be, ends[p], x[p]) for p in every], [fma(gg, ends[p], y[p]) for p in every], ends
            for name, old, new in zip("uva", before, after, strict=True):
                for i, x0, x1 in zip(moving, old, new, strict=True):
                    if flies:
                        s[f"{name}0", i] = x0
                    # a lane that is done waits with h = 0: its acceleration, contact included, stays as it is
                    s[name, i] = where(h > 0.0, x1, x0) if name == "a" and not flies else x1

    def _add_gains(self, group: Group) -> None:
        """Add the energies of a step: powers of input and damping at both ends, by the trapezoid."""
        s = group.state
        h6 = s["h"] * (1.0 / 6.0)
        for part in group.iter_parts() if "energy" in group.requested else ():
            early = powers(group, part, [s["v0", i] for i in part.dofs], group.ground.at(0.0))
            late = powers(group, part, [s["v", i] for i in part.dofs], group.ground.at(1.0))
            for (b, *_), first, last in zip(part.blocks, early, late, strict=True):
                for name, x0, x1 in zip(("e_in", "e_damp"), first, last, strict=True):
                    s[name, b] = fma(h6, 3.0 * (x0 + x1), s[name, b])
        if "hysteretic" in group.requested:
            hysteresis.add_dissipated(group)
        if "links" in group.requested:
            links.add_powers(group, "u0", "v0", 3.0, first=True)
            links.add_powers(group, "u", "v", 3.0, first=False)
            links.record(group, h6)

    def balance(self, group: Group, lanes: Truths, end: float = 1.0) -> None:
        """Find the accelerations at the end of a step by the equation of motion; at its start (0.0) no contacts act."""
        s = group.state
        row.put_accelerations(group, "alone", "u", "v", group.ground.at(end))
        if end == 1.0 and group.spec.located and group.touching and not group.spec.impulsive:

            def force(contact: Contact) -> Lanes:
                k, d, v = contact.k_active, contact.penetration(), contact.between("v")
                return where(k == 0.0, 0.0, contact.law.pressing(k, contact.c_active, d, v))

            row.add_forces(group, "alone", force)
        for i in group.indices(group.spec.n_moving):
            s.put(lanes, s["alone", i], "a", i)

    def soften(self, group: Group) -> None:
        """Mark lanes in which a closed contact is too stiff for the next sub-step."""
        s, h = group.state, group.state["h"]
        waits = (s["time_left"] > 0.0) & ~(s["land"] > 0.0)
        s.put(waits, 0.0, "stiff")
        closed = waits & forces.is_closed(group)
        with when_any(closed):
            hard = group.cell(False)
            for contact in group.iter_contacts():
                law, lanes = contact.law, closed & (contact.mode > OPEN)
                d, v = contact.penetration(), contact.between("v")
                if law.shape.yields:
                    forces.set_plastic(contact, lanes & (contact.mode == REBOUND), d)
                # the clip and the phase are those of the end, which `closed_force` knows
                contact.put(lanes, k_active=contact.k_law, c_active=contact.c_law)
                if law.shape.yields:
                    forces.stick(contact, lanes)
                ahead = maximum(d + maximum(v, 0.0) * minimum(h, contact.duration), 0.0)
                fastest = forces.contact_rate(law, contact.k_active, contact.c_active, contact.reduced, ahead)
                hard.now |= lanes & (h * fastest > STIFF_RATE)
            stiff = hard.now
            s.put(stiff, 1.0, "stiff")
            soft = closed & ~stiff
            for contact in group.iter_contacts():
                slack, rebounds = soft & (contact.mode == SLACK), soft & (contact.mode == REBOUND)
                contact.put(slack | rebounds, c_active=0.0)
                contact.put(slack, k_active=0.0)
                if contact.law.shape.yields:
                    forces.slip(contact, rebounds, contact.penetration())
            with when_any(stiff):
                self.balance(group, stiff, end=0.0)
                for i in group.indices(group.spec.n_moving):
                    s.put(stiff, s["a", i], "a0", i)

    def settle(self, group: Group, lanes: Truths) -> None:
        """Work, peaks and modes of the closed contacts of marked lanes at the end of their sub-step."""
        r, h = group.requested, group.state["h"]
        for contact in group.iter_contacts():
            law, closed = contact.law, lanes & (contact.mode > OPEN)
            d, v, force = contact.penetration(), contact.between("v"), contact.force
            if "force" in r:
                contact.put(closed, fmax=maximum(contact.fmax, force))
            if "penetration" in r:
                contact.put(closed, dmax=maximum(contact.dmax, d))
            if "impulse" in r:
                contact.put(closed, impulse=contact.impulse + h * force)
            if "work" in r:
                contact.put(closed, work=contact.work + 0.5 * h * force * (contact.between("v0") + v))
            nears, parting = SIDES[law.shape.rebound_only]
            mode = where(d > 0.0, nears, OPEN)
            if law.shape.one_sided:
                mode = where((d > 0.0) & (v < 0.0), parting, mode)
            if law.shape.clips:
                slack = (contact.c_law > 0.0) & (law.pressing(contact.k_law, contact.c_law, d, v) <= 0.0)
                mode = where((d > 0.0) & slack, SLACK, mode)
            pressing = mode == forces.PRESSING
            contact.put(
                closed,
                k_active=where(pressing | (mode == REBOUND), contact.k_law, 0.0),
                c_active=where(pressing, contact.c_law, 0.0),
            )
            if law.shape.yields:
                mode = where(closed & pressing, forces.settle_yielding(contact, closed & pressing, d, v), mode)
            contact.put(closed, mode=mode)

    def correct_landings(self, group: Group, lands: Truths) -> Truths:
        """Let lanes that miss the touch on which they land try again; return those in which another came before it."""
        # at large steps the quartic misses the touch by enough for a stiff contact to feel; Newton on the step
        s, early = group.state, lands & (group.state["land"] <= MAX_NEWTON)
        with when_any(early):
            change = self._touch_miss(group)
            again = early & ~(change == 0.0)
            s.put(again, minimum(maximum(s["h"] - change, 0.0), s["time_left"]), "ahead")
            with when_any(again):
                refuse(group, again)
        # on the way that Newton changed, another contact may have touched before
        misses = Cell(lands & (s["accepted"] > 0.0) & (s["land"] <= MAX_LANDINGS))
        with when_any(misses.now):
            late = group.cell(False)  # an open one would be switched on, now or later, deeper than `LATE` of its length
            for contact in group.iter_contacts():
                d, v = contact.pen_end, contact.rate_end
                closes = (contact.mode == OPEN) & (d > group.limit.exact) & (v > 0.0)
                with when_any(closes):
                    lasts = contact.law.duration(contact.stiffness, v, contact.reduced)
                    late.now |= closes & (d > LATE * v * lasts)
            misses.now &= late.now
        return misses.now

    def _touch_miss(self, group: Group) -> Lanes:
        """Time (s) by which a lane's sub-step went beyond (or fell short of) the touch that ends it."""
        late = group.cell(0.0)
        for contact in group.iter_contacts():
            nears = SIDES[contact.law.shape.rebound_only][0]
            d, v = contact.penetration(), contact.between("v")
            touches = (contact.mode == OPEN) & (contact.next == nears)
            touches = touches & (contact.event <= group.state["fraction"] + group.limit.same_time)
            touches = touches & (v > 0.0) & (size(d) > group.limit.exact)
            late.now = where(touches, where(late.now == 0.0, d / v, maximum(late.now, d / v)), late.now)
        return late.now
