"""Quartics through the ends of a sub-step, and where lanes find a change of sign."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import Cell, maximum, minimum, where, while_any

#: Coefficients of t, t**2, t**3, t**4.
Quartic = tuple[Any, Any, Any, Any]


def quartic(t: Any, x0: Any, b: Quartic) -> Any:
    """Its value at t = time / h."""
    return x0 + t * (b[0] + t * (b[1] + t * (b[2] + t * b[3])))


def along(x0: Any, b: Quartic, sign: float = 1.0) -> Callable[[Any], Any]:
    """Return it, or its negative, as a function of t."""
    return lambda t: sign * quartic(t, x0, b)


def rate(b: Quartic) -> tuple[Any, Quartic]:
    """Its derivative: the value at 0 and the coefficients."""
    return b[0], (2.0 * b[1], 3.0 * b[2], 4.0 * b[3], 0.0 * b[0])


def coefficients(h: Any, d0: Any, d1: Any, v0: Any, v1: Any, a0: Any) -> Quartic:
    """Quartic through value, rate and second rate at t = 0, value and rate at t = 1."""
    b1 = h * v0
    b2 = 0.5 * h * h * a0
    rise = d1 - d0 - b1 - b2
    turn = h * v1 - b1 - 2.0 * b2
    return b1, b2, 4.0 * rise - turn, turn - 3.0 * rise


def root(group: Group, asks: Any, low: Any, high: Any, f: Callable[[Any], Any]) -> Any:
    """Where f turns positive between two instants, in lanes that ask (Illinois, then the upper end)."""
    low, high = group.full(low), group.full(high)
    at_low, at_high = f(low), f(high)
    early = at_low > 0.0
    lo, hi, flo, fhi = Cell(low), Cell(where(early, low, high)), Cell(at_low), Cell(at_high)
    side, going, least = Cell(group.full(0.0)), Cell(asks & ~early & (at_high > 0.0)), 0.75 * group.limit.exact
    for _ in while_any(lambda: going.now, group.trace, at_most=100):
        a, b, fa, fb, last = lo.now, hi.now, flo.now, fhi.now, side.now
        going.now = going.now & (b - a > group.limit.exact)
        t = b - fb * (b - a) / (fb - fa)
        t = minimum(maximum(t, a + least), b - least)  # so that a root beside an end is enclosed at once
        t = where((t > a) & (t < b), t, 0.5 * (a + b))
        x = f(t)
        up, down = going.now & (x > 0.0), going.now & (x < 0.0)
        hi.now = where(going.now & ~down, t, b)
        lo.now = where(down, t, a)
        fhi.now = where(up, x, where(down & (last < 0.0), 0.5 * fb, fb))
        flo.now = where(down, x, where(up & (last > 0.0), 0.5 * fa, fa))
        side.now = where(up, 1.0, where(down, -1.0, last))
        going.now = up | down
    return hi.now


def peak(group: Group, asks: Any, r0: Any, r1: Any, f: Callable[[Any], Any]) -> Any:
    """Where a rate f turns from r0 > 0 to r1 < 0, in lanes that ask, as near as a peak's size asks for (Illinois)."""
    lo, hi, at = Cell(group.full(0.0)), Cell(group.full(1.0)), Cell(group.full(0.0))
    flo, fhi, side, going = Cell(r0), Cell(r1), Cell(group.full(0.0)), Cell(asks)
    for _ in while_any(lambda: going.now, group.trace, at_most=40):
        a, b, fa, fb, last, mine = lo.now, hi.now, flo.now, fhi.now, side.now, going.now
        t = a + (b - a) * (fa / (fa - fb))
        x = f(t)
        up = x > 0.0
        done = where(up, t - a, b - t) < group.limit.at_peak
        lo.now, hi.now = where(mine & up, t, a), where(mine & ~up, t, b)
        flo.now = where(mine, where(up, x, where(last < 0.0, 0.5 * fa, fa)), fa)
        fhi.now = where(mine, where(up, where(last > 0.0, 0.5 * fb, fb), x), fb)
        side.now = where(mine, where(up, 1.0, -1.0), last)
        at.now = where(mine, t, at.now)
        going.now = mine & ~done
    return at.now
