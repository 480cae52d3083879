"""What is kept of the motion: extremes inside a step, accelerations.

Peaks are the extremes of the cubic through value and rate at both ends of a step, in which the rate changes its sign.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from pounding_sweep.kernel import forces, hysteresis
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.roots import Series, course, cubic, turn
from pounding_sweep.kernel.row import add_forces, put_accelerations
from pounding_sweep.kernel.types import ByFloor, Index, Lanes, Truths
from pounding_sweep.lanes import Cell, any_lane, count_to, fma, maximum, minimum, once_if, size, sqrt, when_any, where

#: Most that a cubic leaves its ends by, in its rates there times the step.
REACH = 4.0 / 27.0
#: Parts of a step that are looked at where a motion may turn more than once; a power of two.
PARTS = 16
#: Share of the largest acceleration so far from which on a cubic's peak beside a closed contact is looked at.
NEARLY = 0.9
#: Shares of the fourth and fifth rates in powers of a step.
SHARES = (1.0 / 24.0, 1.0 / 120.0)
#: Rate that a motion at rest is given, over that at the end of its step: next to nothing.
LEAVES = 2.0**-30


def declare_rows(group: Group) -> None:
    """Declare accelerations and their rates at both ends of a sub-step, and what those inside it need."""
    n = group.spec.n_moving
    if "acceleration" in group.requested:
        group.declare(n, "acc_start", "acc_end", "acc_rate_start", "acc_rate_end")
        if group.presses:
            group.declare(n, "peak", "acc_inside", passing=True)
            group.declare(len(group.contacts), "press", passing=True)


def extreme(curve: Series, s1: Lanes, nearer: bool = False) -> Lanes:
    """Extreme inside a step of a polynomial, whose rate is s1 at its end, about where the rate turns."""
    s0 = curve.read(1)
    t = where(s0 * s1 < 0.0, s0 / (s0 - s1), 0.0)
    if nearer:
        slope, bend = curve.rate.with_slope(t)
        then = t - slope / bend
        t = where((then > 0.0) & (then < 1.0), then, t)
    return curve.value(t)


def cubic_turns(curve: Series) -> tuple[Lanes, Lanes]:
    """Where a cubic turns inside the step, as parts of it; else 0."""
    _, s0, b, a = (curve.read(n) for n in range(4))
    root = sqrt(b * b - 3.0 * a * s0)  # of what never turns not a number
    far = -(b + where(b < 0.0, -root, root))
    t, u = (where((x > 0.0) & (x < 1.0), x, 0.0) for x in (far / (3.0 * a), s0 / far))
    return t, u


def septic_extremes(
    group: Group,
    lanes: Truths,
    start: Sequence[Lanes],
    end: Sequence[Lanes],
    so_far: tuple[Lanes, Lanes],
    higher: Callable[[], Sequence[tuple[Lanes, Lanes]]],
    *,
    bounds: bool = False,
) -> tuple[Lanes, Lanes]:
    """Largest and least values, in lanes, of the polynomial with value and three rates (by powers of the step) at ends.

    Those that go beyond the largest and least value `so_far` are of the polynomial that has the fourth and fifth rates
    too: `higher` gives these at the start and the end. Where it may turn more than once, only those beyond are looked
    for, if these are `bounds`.
    """
    (x0, at_start, c0, j0), (x1, s1, c1, j1) = start, end
    # at rest as if the motion turned, so that one is seen that goes and comes back
    s0 = where(at_start == 0.0, -LEAVES * s1, at_start)
    # what spans the hull that its rate keeps within, which changes its sign no more often than they do
    spans = [s0, s0 + (1.0 / 6.0) * c0, s0 + (1.0 / 3.0) * c0 + (1.0 / 30.0) * j0]
    spans += [s1 - (1.0 / 3.0) * c1 + (1.0 / 30.0) * j1, s1 - (1.0 / 6.0) * c1, s1]
    spans.insert(3, 7.0 * (x1 - x0) - sum(spans[1:], spans[0]))
    changed = back = group.full(False)
    for span in spans[1:]:
        back = back | (changed & (span * s0 >= 0.0))
        changed = changed | (span * s0 < 0.0)
    once, again = lanes & (s0 * s1 < 0.0), Cell(lanes & back)
    above, below = Cell(maximum(x0, x1)), Cell(minimum(x0, x1))
    high, low = so_far
    for _ in once_if(any_lane(again.now)) if bounds else ():
        x, most, least = x0, above.now, below.now
        for span in spans:
            x = x + (1.0 / 7.0) * span
            most, least = maximum(most, x), minimum(least, x)
        again.now &= (most > high) | (least < low)

    def take(mask: Truths, x: Lanes) -> None:
        above.now = where(mask, maximum(above.now, x), above.now)
        below.now = where(mask, minimum(below.now, x), below.now)

    for _ in once_if(any_lane(once | again.now)):
        # the polynomial with value and three rates (times powers of the step) at its ends
        c, j = 0.5 * c0, (1.0 / 6.0) * j0
        r, r1 = x1 - x0 - at_start - c - j, s1 - at_start - c0 - 0.5 * j0
        r2, r3 = c1 - c0 - j0, j1 - j0
        b4 = 35.0 * r - 15.0 * r1 + 2.5 * r2 - (1.0 / 6.0) * r3
        b5 = -84.0 * r + 39.0 * r1 - 7.0 * r2 + 0.5 * r3
        b6 = 70.0 * r - 34.0 * r1 + 6.5 * r2 - 0.5 * r3
        b7 = -20.0 * r + 10.0 * r1 - 2.0 * r2 + (1.0 / 6.0) * r3
        curve = Series.of(x0, at_start, c, j, b4, b5, b6, b7)
        t = turn(group, once, 2, curve.rate.with_slope, (0.0, 1.0), (s0, s1))
        x = Cell(curve.value(t))
        for _ in once_if(any_lane(once & ((x.now > high) | (x.now < low)))):
            (d0, d1), (e0, e1) = (
                (share * early, share * late) for share, (early, late) in zip(SHARES, higher(), strict=True)
            )
            r0, r1 = d0 - b4, d1 - (b4 + 5.0 * b5 + 15.0 * b6 + 35.0 * b7)
            rest = cubic(r0, r1, e0 - b5 + 4.0 * r0, e1 - (b5 + 6.0 * b6 + 21.0 * b7) - 4.0 * r1)
            square = t * (1.0 - t) * t * (1.0 - t)
            x.now = fma(square * square, rest.value(t), x.now)
        take(once, x.now)
        for _ in once_if(any_lane(again.now)):
            t, x, s = group.cell(0.0), Cell(x0), Cell((1.0 / PARTS) * at_start)
            for _ in count_to(PARTS):
                t.now += 1.0 / PARTS
                then, rate = curve.with_slope(t.now)
                rate = (1.0 / PARTS) * rate
                take(again.now, extreme(cubic(x.now, then, s.now, rate), rate))
                x.now, s.now = then, rate
                take(again.now, then)
    return above.now, below.now


@dataclass(frozen=True)
class Motion:
    """A motion whose extremes are kept."""

    #: rows of its largest and its smallest value; without a `least` one that of the largest
    most: tuple[str, Index]
    least: tuple[str, Index] | None
    sized: bool  # it is its absolute value that counts
    soft: Callable[[], Lanes]  # square of the most by which a free vibration departs from rest, over twice its energy
    of: Callable[[ByFloor], Lanes]  # reads it, or its rate
    shear: Index = -1  # floor above the storey that yields, of whose hysteresis it is the shear; -1: of none
    alone: bool = True  # it may turn where no other motion does that is followed
    pulls: bool = False  # it follows velocities too: the force of a link


def followed(group: Group, straight: bool) -> Iterator[Motion]:
    """Go through the motions whose extremes are kept."""
    for reducer in group.reducers:
        if reducer.follows:
            yield from reducer.follows(group, straight)


def turns(group: Group) -> None:
    """Take the extremes of the motion that lie inside the step just taken."""
    s = group.state
    h = s["h"]
    for motion in followed(group, straight=False):
        x0, x1, v0, v1 = (motion.of(name) for name in ("u0", "u", "v0", "v"))
        high, sized, least = s[motion.most], motion.sized, motion.least
        reach = REACH * h * (size(v0) + size(v1))
        above = (maximum(size(x0), size(x1)) if sized else maximum(x0, x1)) + reach - high
        if least is not None:
            above = maximum(above, s[least] - minimum(x0, x1) + reach)
        with when_any(asks := (v0 * v1 <= 0.0) & (above > 0.0)):
            bends = group.spec.staged and isinstance(motion.shear, int) and motion.shear < 0
            curve = course(group, motion.of) if bends else cubic(x0, x1, h * v0, h * v1)
            p = extreme(curve, h * v1, nearer=bends)
            take_extremes(group, motion, asks, (p, x0, x1))


def take_extremes(group: Group, motion: Motion, lanes: Truths, values: tuple[Lanes, Lanes, Lanes]) -> None:
    """Take three values of a motion, in some lanes: others must not know that their neighbours turn."""
    s, (p, x0, x1) = group.state, values
    high = s[motion.most]
    largest = maximum(size(p), maximum(size(x0), size(x1))) if motion.sized else maximum(p, maximum(x0, x1))
    s[motion.most] = where(lanes, maximum(high, largest), high)
    if motion.least is not None:
        low = s[motion.least]
        s[motion.least] = where(lanes, minimum(low, minimum(p, minimum(x0, x1))), low)


def samples(group: Group, lanes: Truths = None) -> None:
    """Take the motion at the present state, in some lanes."""
    s = group.state
    for motion in followed(group, straight=True):
        x = motion.of("u")
        s.put(lanes, maximum(s[motion.most], size(x) if motion.sized else x), *motion.most)
        if motion.least is not None:
            s.put(lanes, minimum(s[motion.least], x), *motion.least)


def reduce_step(group: Group) -> None:
    """Let reducers take what they keep of each located step."""
    for reducer in group.reducers:
        if reducer.step:
            reducer.step(group)


def turning(group: Group) -> Truths:
    """Return what is zero or less where some of the motion that is followed turns in the step just taken."""
    product = group.cell(1.0)
    for motion in followed(group, straight=True):
        if motion.alone:
            product.now = minimum(product.now, motion.of("v0") * motion.of("v"))
    return product.now


def largest_accelerations(
    group: Group, located: bool, pressed: bool = False, force_rates: Callable[[Group, str], None] | None = None
) -> None:
    """Take the total accelerations of all floors over the step just taken; `pressed`: contacts may be closed."""
    # `force_rates`: finds rates of forces that hold floors together at an end, by those of accelerations without them
    s = group.state
    ends = [("end", "u", "v", 1.0)] + ([("start", "u0", "v0", 0.0)] if located else [])
    for end, u, v, _ in ends:
        hysteresis.put_lines(group, f"v{u[1:]}")
        put_accelerations(group, f"acc_{end}", u, v)
    for end, *_ in ends if group.touching else ():
        add_forces(group, f"acc_{end}", f"force_{end}")
    if not located:
        for i in group.indices(group.spec.n_dof):
            s["acc", i] = maximum(s["acc", i], size(s["acc_end", i]))
        return

    def relative(end: str, t: float, i: Index) -> Lanes:
        return s[f"acc_{end}", i] - (0.0 if group.rocks(i) else group.ground.at(t)(group.home_of(i)[2]))

    for end, _, v, t in ends:
        hysteresis.put_lines(group, v)
        put_accelerations(group, f"acc_rate_{end}", v, partial(relative, end, t), rates=True)
    hysteresis.put_lines(group)
    for end, *_ in ends if group.touching else ():
        if force_rates is not None:
            force_rates(group, end)
        add_forces(group, f"acc_rate_{end}", f"force_rate_{end}")
    h = s["h"]
    closed = forces.is_closed(group) & (h > 0.0) if pressed else group.full(False)
    again = group.cell(False)
    for i in group.indices(group.spec.n_dof):
        early, late = s["acc_start", i], s["acc_end", i]
        s1 = h * s["acc_rate_end", i]
        p = _acceleration_turn(group, cubic(early, late, h * s["acc_rate_start", i], s1), s1)[1]
        ends = maximum(size(early), size(late))
        # of a lane that waits, forces may be of another instant
        s["acc", i] = maximum(s["acc", i], where(h > 0.0, where(closed, ends, maximum(p, ends)), 0.0))
        if pressed:
            s["peak", i] = where(p > ends, p, 0.0)
            again.now |= closed & (s["peak", i] > NEARLY * s["acc", i])
    if pressed:
        with when_any(again.now):
            for i in group.indices(group.spec.n_dof, straight=False):
                mask = closed & (s["peak", i] > NEARLY * s["acc", i])
                with when_any(mask):
                    _take_acceleration(group, i, mask)


def _acceleration_turn(group: Group, curve: Series, s1: Lanes) -> tuple[Lanes, Lanes]:
    """Where an acceleration is largest inside a sub-step, by a cubic of rate s1 at the end, and its size there."""
    if not group.spec.staged:  # by whose rates it may turn where it does not: those of forces may be means
        s0 = curve.read(1)
        return where(s0 * s1 < 0.0, s0 / (s0 - s1), 0.0), size(extreme(curve, s1))
    t, u = cubic_turns(curve)
    p, q = size(curve.value(t)), size(curve.value(u))
    return where(p > q, t, u), maximum(p, q)


def _take_acceleration(group: Group, i: Index, lanes: Truths) -> None:
    """Take the acceleration of a floor beside closed contacts where it turns inside the sub-step, in some lanes."""
    s, h = group.state, group.state["h"]
    s1 = h * s["acc_rate_end", i]
    curve = cubic(s["acc_start", i], s["acc_end", i], h * s["acc_rate_start", i], s1)
    at = Cell(_acceleration_turn(group, curve, s1)[0])
    for _ in count_to(2):  # once where the cubic turns, once nearer
        t = at.now
        hysteresis.part(group, t)
        put_accelerations(group, "acc_inside", moved(group, t), moved(group, t, velocities=True))
        hysteresis.put_lines(group)
        for contact in group.iter_contacts():
            contact.press = 0.0
            with when_any(contact.mode > forces.OPEN):
                contact.press = forces.force_at(contact, t)
        add_forces(group, "acc_inside", "press")
        acc, rest = s["acc_inside", i], t * (1.0 - t)
        s["acc", i] = maximum(s["acc", i], where(lanes, size(acc), 0.0))
        miss = acc - curve.value(t)  # it grows as the square of `rest`
        slope, bend = curve.rate.with_slope(t)
        slope = slope + 2.0 * miss * (1.0 - 2.0 * t) / rest
        bend = bend + 2.0 * miss * (1.0 - 6.0 * rest) / (rest * rest)
        nearer = t - slope / bend
        at.now = where((nearer > 0.0) & (nearer < 1.0), nearer, t)


def moved(group: Group, t: Lanes, velocities: bool = False) -> Callable[[Index], Lanes]:
    """Return what gives displacements of floors at a part t of the sub-step just tried, or their velocities."""
    s = group.state

    def of(i: Index) -> Lanes:
        motion = course(group, lambda name: s[name, i])
        return motion.rate.value(t) / s["h"] if velocities else motion.value(t)

    return of
