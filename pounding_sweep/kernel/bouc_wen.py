"""Storeys whose hysteresis is smooth: the law of Bouc and Wen.

    V = r k d + (1 - r) k z,    z = d - p
    p' = |z / dy|^n (GAMMA d' + BETA |d'| sign z)

d is the drift, p its plastic part, r the hardening and dy = Vy / k. The shear is k d - (1 - r) k p,
as that of a bilinear storey whose plastic part stands still; here it flows along: stage by stage, or,
in an implicit step, by the trapezoid over the drift. Its rate has a kink where the drift turns and
where z changes its sign: sub-steps end there. They are so short that z can't reach its limit, where it
would be stiff, from anywhere within one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

from pounding_sweep.kernel.group import Group, power_of
from pounding_sweep.kernel.hysteresis import hardened
from pounding_sweep.kernel.lanes import Cell, fma, maximum, minimum, size, when_any, where, while_any
from pounding_sweep.kernel.roots import course, crossing, cubic

#: Share of its limit, over n, by which a drift may move in a sub-step.
REACH = 0.5
#: Rounds of Newton's method over the end of an implicit step; from within the reach two or three are enough.
MAX_ROUNDS = 30


def each_storey(group: Group) -> Iterator[tuple[int, int | None, float]]:
    """Go through the storeys with the floors below (None: the ground) and their exponents."""
    for i, n in group.spec.smooth:
        yield i, group.spec.below(i), n


def _share(group: Group, i: int, n: float, z: Any, v: Any) -> Any:
    """Rate of the plastic drift over that of the drift."""
    beta = group.prop("wen_beta", i)
    filled = power_of(size(z) / group.prop("yield_drift", i), n)
    return filled * (group.prop("wen_gamma", i) + where(z * v < 0.0, -beta, beta))


def _end(group: Group, i: int, below: int | None, end: str) -> tuple[Any, Any]:
    """Return z and the drift's rate at the start ("0") or the end ("") of the sub-step."""
    z = group.drift(i, below, f"u{end}") - group.state[f"slip{end}", i]
    return z, group.drift(i, below, f"v{end}")


def shear(group: Group, i: int, below: int | None, n: float, name: str) -> Any:
    """Storey shear at the displacements of that name; of rates, its rate."""
    end = name[1:]
    k, (_, soft), moves = group.prop("k", i), hardened(group, i), group.drift(i, below, name)
    if name.startswith("v"):
        return (k - soft * _share(group, i, n, *_end(group, i, below, end))) * moves
    return k * moves - soft * group.state[f"slip{end}", i]


class Flow:
    """Plastic drifts of a row within a step, stage by stage."""

    def __init__(self, group: Group) -> None:
        self._group = group
        self._storeys = list(each_storey(group))
        self._now = [group.state["slip0", i] for i, *_ in self._storeys]
        self._start, self._rates = list(self._now), [[] for _ in self._storeys]  # type: ignore[var-annotated]
        #: Sums of weight x rate of what yielding has lost, in (1 - r) Vy, by storey.
        self.lost: dict[int, Any] = {}

    def hold(self, x: Sequence[Any], y: Sequence[Any], weight: float) -> None:
        """Make shears those of this stage, of displacements x and velocities y."""
        group = self._group
        for (i, below, n), slip, rates in zip(self._storeys, self._now, self._rates, strict=True):
            moved, v = (group.drift(i, below, values) for values in (x, y))
            z = moved - slip
            rates.append(_share(group, i, n, z, v) * v)
            group.state["ct", i] = -hardened(group, i)[1] * slip
            if "hysteretic" in group.asked:
                part = weight * (z / group.prop("yield_drift", i) * rates[-1])
                self.lost[i] = self.lost[i] + part if i in self.lost else part

    def advance(self, after: Callable[..., tuple[Any, Any]], stage: int, h: Any) -> None:
        """Go on from a stage, as `after` does with velocities."""
        pairs = zip(self._start, self._rates, strict=True)
        self._now = [after(stage, start, start, start, rates, h)[1] for start, rates in pairs]

    def end(self) -> None:
        """Leave the plastic drifts of the step's end."""
        for (i, *_), slip in zip(self._storeys, self._now, strict=True):
            self._group.state["slip", i] = slip
        settle(self._group)


def rounds(group: Group) -> Iterator[None]:
    """Go round an implicit step, shears in straight lines, until they are those of the law at its end."""
    # With the drift's change D = d1 - d0 and the share q of it that flows into p,
    #     p1 = p0 + D (q(z0, D) + q(z1, D)) / 2,
    # of which Newton's method finds p1 and d1 together: p1 = REST + FLOW d1. It loses (p1 - p0) (z0 + z1) / 2. As q
    # does not fall while z is loaded, p1 is the only one, with z1 in what `_most` returns.
    s, storeys = group.state, list(each_storey(group))
    moves = s["h"] > 0.0
    for i, below, n in storeys:
        s["flow", i] = _share(group, i, n, *_end(group, i, below, "0"))
        s["rest", i] = s["slip0", i] - s["flow", i] * group.drift(i, below, "u0")
    going, astray = Cell(moves), Cell(moves & ~moves)
    for _ in while_any(lambda: going.now, at_most=MAX_ROUNDS):
        for i, *_ in storeys:
            soft = hardened(group, i)[1]
            s["kt", i] = fma(-soft, s["flow", i], group.full(group.prop("k", i)))
            s["ct", i] = -soft * s["rest", i]
        yield
        # lanes that are there stay there, and do the same in each round that others need
        mine, again, far, better = going.now, Cell(moves & ~moves), Cell(moves & ~moves), {}
        for i, below, n in storeys:
            d = group.drift(i, below)
            p = where(moves, fma(s["flow", i], d, s["rest", i]), s["slip0", i])
            flow, then = _tangent(group, i, below, n, d, p)
            miss, scale = size(then - p), size(d) + group.prop("yield_drift", i) * group.prop("wen_limit", i)
            s["slip", i], better[i] = p, {"flow": flow, "rest": then - flow * d}
            again.now |= ~(miss <= group.limit.swept * scale)
            far.now |= ~(miss <= group.limit.unswept * scale)
        going.now, astray.now = mine & again.now, mine & far.now
        for i, lines in better.items():
            for name, value in lines.items():
                s.put(going.now, value, name, i)
    # one that is tried as a whole step is tried again in shorter ones where it was too long
    short = (s["time_left"] > 0.0) | ~_too_long(group, s["h"])
    s.put(astray.now & short, 1.0, "unsolved")


def _most(group: Group, i: int, n: float, z0: Any) -> Any:
    """Largest |z| at the end of an implicit step: there the share is twice that at which z would stand still."""
    return maximum(size(z0), 2.0 ** (1.0 / n) * (group.prop("yield_drift", i) * group.prop("wen_limit", i)))


def _tangent(group: Group, i: int, below: int | None, n: float, d: Any, p: Any) -> tuple[Any, Any]:
    """Return dp/dd at the end of an implicit step whose drift is d, and what Newton's method makes of p there."""
    p0, dy, d0 = group.state["slip0", i], group.prop("yield_drift", i), group.drift(i, below, "u0")
    beta, gamma, change = group.prop("wen_beta", i), group.prop("wen_gamma", i), 0.5 * (d - d0)
    most, z0 = _most(group, i, n, d0 - p0), d0 - p0
    z = minimum(maximum(d - p, -most), most)
    filled = size(z) / dy
    slope = power_of(filled, n - 1.0) * (gamma + where(z * change < 0.0, -beta, beta))
    both = _share(group, i, n, z0, change) + filled * slope
    bends = (n / dy) * change * where(z < 0.0, -slope, slope)
    inverse = 1.0 / (1.0 + bends)
    at = d - z
    return (0.5 * both + bends) * inverse, at - (at - p0 - change * both) * inverse


def add_lost(group: Group) -> None:
    """Add what yielding has lost in an implicit step."""
    s = group.state
    for i, below, _ in each_storey(group) if "hysteretic" in group.asked else ():
        mean = 0.5 * (_end(group, i, below, "0")[0] + _end(group, i, below, "")[0])
        s["travel", i] = fma(s["slip", i] - s["slip0", i], mean / group.prop("yield_drift", i), s["travel", i])


def settle(group: Group) -> None:
    """Make shears those of the present state."""
    for i, _ in group.spec.smooth:
        group.state["kt", i] = group.full(group.prop("k", i))
        group.state["ct", i] = -hardened(group, i)[1] * group.state["slip", i]


def part(group: Group, t: Any) -> None:
    """Make shears those at a part t of the sub-step just taken, between whose ends plastic drifts are cubics."""
    s, h = group.state, group.state["h"]
    for i, below, n in each_storey(group):
        p0, p1 = s["slip0", i], s["slip", i]
        r0, r1 = (h * _share(group, i, n, z, v) * v for z, v in (_end(group, i, below, end) for end in ("0", "")))
        slip = cubic(p0, p1, r0, r1).value(t)
        s["kt", i], s["ct", i] = group.full(group.prop("k", i)), -hardened(group, i)[1] * slip


def linearise(group: Group, end: str) -> None:
    """Make shears and their rates those of the start ("0") or the end ("") of the sub-step."""
    s = group.state
    for i, below, n in each_storey(group):
        z, v = _end(group, i, below, end)
        less = hardened(group, i)[1] * _share(group, i, n, z, v)
        slip = s[f"slip{end}", i]
        s["kt", i] = group.prop("k", i) - less
        s["ct", i] = less * (z + slip) - hardened(group, i)[1] * slip


def _reach(group: Group, i: int, n: float) -> Any:
    """How far the drift may move in a sub-step."""
    return (REACH / n) * (group.prop("yield_drift", i) * group.prop("wen_limit", i))


def longest(group: Group, h: Any) -> Any:
    """Longest sub-step from the present state, h where it may be as long."""
    found = Cell(group.full(h))
    for i, below, n in each_storey(group):
        speed, reach = size(group.drift(i, below, "v")), _reach(group, i, n)
        found.now = minimum(found.now, where(speed * h > reach, reach / speed, h))
    return found.now


def may_change(group: Group, h: Any) -> Any:
    """Lanes in which a drift turned, or its z changed sign, in the step just taken, or that was too long."""
    found = Cell(_too_long(group, h))
    for i, below, _ in each_storey(group):
        (z0, v0), (z1, v1) = (_end(group, i, below, end) for end in ("0", ""))
        found.now |= (v0 * v1 < 0.0) | (z0 * z1 < 0.0)
    return found.now


def _too_long(group: Group, h: Any) -> Any:
    """Lanes in which a drift moved farther than it may in the step just taken."""
    found = Cell(group.full(False))
    for i, below, n in each_storey(group):
        fastest = maximum(size(group.drift(i, below, "v0")), size(group.drift(i, below, "v")))
        found.now |= ~(h * fastest <= (1.0 + group.limit.at_kink) * _reach(group, i, n))
    return found.now


def first_event(group: Group, asks: Any) -> Any:
    """Fraction of the trial at which the first kink is (1: none), in the lanes that ask."""
    h, first = group.state["h"], Cell(group.full(1.0))
    for i, below, n in each_storey(group):
        (z0, v0), (z1, v1) = (_end(group, i, below, end) for end in ("0", ""))
        turns, crosses = asks & (v0 * v1 < 0.0), asks & (z0 * z1 < 0.0)
        with when_any(turns | crosses):
            moves = course(group, partial(group.drift, i, below))
            turn = crossing(group, turns, 0.0, 1.0, moves.rate, where(v0 > 0.0, -1.0, 1.0))
            w0, w1 = (h * (v - _share(group, i, n, z, v) * v) for z, v in ((z0, v0), (z1, v1)))
            side = where(z0 > 0.0, -1.0, 1.0)
            cross = crossing(group, crosses, 0.0, 1.0, cubic(z0, z1, w0, w1), side)
            for kinks, t in ((turns, turn), (crosses, cross)):
                inside = kinks & (t > group.limit.at_kink) & (t < 1.0 - group.limit.at_kink)
                first.now = where(inside, minimum(first.now, t), first.now)
    return first.now
