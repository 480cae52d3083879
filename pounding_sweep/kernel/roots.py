"""Polynomials of the time within a sub-step, and where lanes find a change of sign."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pounding_sweep.kernel.group import BENDS, Group
from pounding_sweep.kernel.types import Lanes, Truths
from pounding_sweep.lanes import Cell, fma, maximum, minimum, size, sqrt, when_any, where, while_any

#: Newton's last change of a root (in steps) that it need not repeat, in both number formats.
SETTLED = {"float64": 1e-8, "float32": 1e-3}
#: Newton's last change of where a peak is (in steps) beyond which it goes on: a peak is flat.
NEAR = 0.01
#: Most that t**4 to t**8 leave the cubics through their values and slopes at 0 and 1 by; of motions that turn by less
#: than 2.8 in a step, all higher powers add a fifteenth at most.
LEAVES = tuple(1.07 * most for most in (0.0625, 0.157, 0.27, 0.394, 0.525))
#: Fraction of a sub-step that stands for: not in it.
NEVER = 2.0


def horner(t: Lanes, coefficients: Sequence[Lanes]) -> Lanes:
    """Value of a polynomial; of a long one in two halves, which need not wait for each other."""
    if len(coefficients) > 8:
        square = t * t
        return fma(t, horner(square, coefficients[1::2]), horner(square, coefficients[::2]))
    x = coefficients[-1]
    for coefficient in reversed(coefficients[:-1]):
        x = fma(t, x, coefficient)
    return x


def with_slope(t: Lanes, coefficients: Sequence[Lanes], halves: bool = True) -> tuple[Lanes, Lanes]:
    """Value and slope of a polynomial of at least two coefficients, in `halves` as in `horner`."""
    if halves and len(coefficients) > 8:
        square = t * t
        (even, rise), (odd, lift) = (with_slope(square, coefficients[k::2]) for k in (0, 1))
        return fma(t, odd, even), fma(t + t, fma(t, lift, rise), odd)
    x, slope = fma(t, coefficients[-1], coefficients[-2]), coefficients[-1]
    for coefficient in reversed(coefficients[:-2]):
        slope = fma(t, slope, x)
        x = fma(t, x, coefficient)
    return x, slope


@dataclass(frozen=True)
class Series:
    """A polynomial of the time since the start of a step, in steps: its coefficients, and the highest."""

    read: Callable[[int], Lanes]
    order: int

    @classmethod
    def of(cls, *coefficients: Lanes) -> Series:
        """Return that of the coefficients."""
        return cls(coefficients.__getitem__, len(coefficients) - 1)

    def begun(self, x: Lanes) -> Series:
        """Return the same that begins with x."""
        return Series(lambda n: self.read(n) if n else x, self.order)

    def value(self, t: Lanes) -> Lanes:
        """Its value."""
        return horner(t, [self.read(n) for n in range(self.order + 1)])

    def with_slope(self, t: Lanes, halves: bool = True) -> tuple[Lanes, Lanes]:
        """Its value, and that of its derivative."""
        return with_slope(t, [self.read(n) for n in range(self.order + 1)], halves)

    @property
    def rate(self) -> Series:
        """Its derivative."""
        return Series(lambda n: float(n + 1) * self.read(n + 1), self.order - 1)

    def bulge(self, t: Lanes) -> Lanes:
        """Most that it leaves the cubic through its values and slopes at 0 and t by."""
        square = t * t
        powers = [share * size(self.read(n)) for n, share in enumerate(LEAVES, 4)]
        return square * square * horner(t, powers)


def cubic(x0: Lanes, x1: Lanes, s0: Lanes, s1: Lanes) -> Series:
    """Cubic with values x and rates s at 0 and 1."""
    return Series.of(x0, s0, -3.0 * (x0 - x1) - (2.0 * s0 + s1), 2.0 * (x0 - x1) + (s0 + s1))


def course(group: Group, read: Callable[[str], Lanes]) -> Series:
    """Return a motion in the sub-step just tried, by parts of it; `read` gives it by the names of the floors' rows."""
    h = group.state["h"]
    d0, b1, b2 = read("u0"), h * read("v0"), 0.5 * h * h * read("a0")
    if group.spec.staged:  # without differences of the motion
        return Series.of(d0, b1, b2, *(h * h * read(name) for name in BENDS))
    rise = read("u") - d0 - b1 - b2
    turn = h * read("v") - b1 - 2.0 * b2
    return Series.of(d0, b1, b2, 4.0 * rise - turn, turn - 3.0 * rise)


def tangents(series: Series, t: Lanes) -> tuple[Lanes, Lanes, Lanes, Lanes]:
    """Its value at the start, those of the tangents at both ends of 0 to t at thirds of it, and that at the end."""
    start, third, (end, slope) = series.read(0), (1.0 / 3.0) * t, series.with_slope(t)
    return start, fma(third, series.read(1), start), fma(-third, slope, end), end


def crossing(group: Group, asks: Truths, low: Lanes, high: Lanes, series: Series, sign: Lanes) -> Lanes:
    """Where sign times a series turns positive, in lanes that ask; at huge steps there may be several."""
    if group.spec.implicit:
        return root(group, asks, low, high, lambda t: sign * series.value(t))
    return newton(group, asks, low, high, series, sign)


def first_crossing(
    group: Group,
    lanes: Truths,
    series: Series,
    sign: Lanes,
    crosses: Truths,
    turns: Truths,
    rises: Truths = None,
    least: Lanes = 0.0,
    end: Lanes = 1.0,
) -> Lanes:
    """Where sign times a series turns positive, in some lanes: before the `end`, where it `crosses`, else `NEVER`."""
    # where it `rises` only after it fell, it may begin at its event; where it `turns`, it must have been above `least`
    rises = group.full(False) if rises is None else rises
    bends = lanes & (turns | rises)
    low, high, event = group.cell(0.0), group.cell(end), Cell(lanes & crosses)
    with when_any(bends):
        extreme = crossing(group, bends, 0.0, end, series.rate, where(rises, sign, -sign))
        event.now = lanes & (crosses | (turns & (sign * series.value(extreme) > least)))
        low.now, high.now = where(rises, extreme, 0.0), where(turns, extreme, end)
    return where(event.now, crossing(group, event.now, low.now, high.now, series, sign), NEVER)


def newton(group: Group, asks: Truths, low: Lanes, high: Lanes, series: Series, sign: Lanes) -> Lanes:
    """Where sign times a series turns positive between two instants, in lanes that ask (Newton in a bracket)."""
    low, high = group.full(low), group.full(high)
    (at_low, rises), at_high = (sign * x for x in series.with_slope(low)), sign * series.value(high)
    at_once = (at_low > 0.0) | ((at_low == 0.0) & (rises > 0.0))
    active = Cell(asks & ~at_once & (at_high > 0.0))
    begin = where(at_once, low, high)
    # from zero it turns negative first: that is not the change which is sought
    secant = where(at_low < 0.0, low + (high - low) * (at_low / (at_low - at_high)), 0.5 * (low + high))
    lo, hi, at = Cell(low), Cell(high), Cell(where(active.now, secant, begin))
    settled, exact = SETTLED[group.spec.precision], group.limit.exact
    for _ in while_any(lambda: active.now, at_most=60):
        t, mask = at.now, active.now
        x, rate = (sign * value for value in series.with_slope(t))
        up = x > 0.0
        a, b = where(up, lo.now, t), where(up, t, hi.now)
        lo.now, hi.now = a, b
        then = t - x / rate
        then = where((then >= a) & (then <= b), then, 0.5 * (a + b))
        at.now = where(mask, then, t)
        active.now = mask & (size(then - t) > settled) & (b - a > exact)
    return at.now


def turn(
    group: Group,
    lanes: Truths,
    rounds: int,
    rate: Callable[[Lanes], tuple[Lanes, Lanes]],
    ends: tuple[Lanes, Lanes],
    rates: tuple[Lanes, Lanes],
) -> Lanes:
    """Where a rate, given with its slope, changes its sign between two instants, in some lanes: Newton in a bracket."""
    (start, end), (r0, r1) = ends, rates

    def nearer(t: Lanes, low: Lanes, high: Lanes) -> tuple[Lanes, Lanes, Lanes]:
        x, slope = rate(t)
        early, then = x * r0 > 0.0, t - x / slope
        low, high = where(early, t, low), where(early, high, t)
        return where((then >= low) & (then <= high), then, 0.5 * (low + high)), low, high

    brackets = [(start + (end - start) * (r0 / (r0 - r1)), group.full(start), group.full(end))]
    for _ in range(rounds):
        brackets.append(nearer(*brackets[-1]))
    now, low, high = (Cell(x) for x in brackets[-1])
    active = Cell(lanes & (size(now.now - brackets[-2][0]) > NEAR))
    for _ in while_any(lambda: active.now, at_most=6):
        t, mask = now.now, active.now
        then, low.now, high.now = nearer(t, low.now, high.now)
        now.now, active.now = where(mask, then, t), mask & (size(then - t) > NEAR)
    return now.now


def root(group: Group, asks: Truths, low: Lanes, high: Lanes, f: Callable[[Lanes], Lanes]) -> Lanes:
    """Where f turns positive between two instants, in lanes that ask (Illinois, then the upper end)."""
    low, high = group.full(low), group.full(high)
    at_low, at_high = f(low), f(high)
    early = at_low > 0.0
    lo, hi, flo, fhi = Cell(low), Cell(where(early, low, high)), Cell(at_low), Cell(at_high)
    side, active, least = group.cell(0.0), Cell(asks & ~early & (at_high > 0.0)), 0.75 * group.limit.exact
    for _ in while_any(lambda: active.now, at_most=100):
        a, b, fa, fb, last = lo.now, hi.now, flo.now, fhi.now, side.now
        active.now &= b - a > group.limit.exact
        t = b - fb * (b - a) / (fb - fa)
        t = minimum(maximum(t, a + least), b - least)  # so that a root beside an end is enclosed at once
        t = where((t > a) & (t < b), t, 0.5 * (a + b))
        x = f(t)
        up, down = active.now & (x > 0.0), active.now & (x < 0.0)
        hi.now = where(active.now & ~down, t, b)
        lo.now = where(down, t, a)
        fhi.now = where(up, x, where(down & (last < 0.0), 0.5 * fb, fb))
        flo.now = where(down, x, where(up & (last > 0.0), 0.5 * fa, fa))
        side.now = where(up, 1.0, where(down, -1.0, last))
        active.now = up | down
    return hi.now


def cubic_turn(x0: Lanes, x1: Lanes, s0: Lanes, s1: Lanes) -> Lanes:
    """Where a cubic with values x and rates s (times the step) at its ends turns, from s0 > 0 to s1 < 0."""
    rise = x1 - x0
    b, c = 3.0 * rise - 2.0 * s0 - s1, s0 + s1 - 2.0 * rise
    return s0 / (sqrt(b * b - 3.0 * c * s0) - b)
