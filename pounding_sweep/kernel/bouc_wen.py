"""Storeys whose hysteresis is smooth: the law of Bouc and Wen.

    V = r k d + (1 - r) k z,    z = d - p
    p' = |z / dy|^n (GAMMA d' + BETA |d'| sign z)

d is the drift, p its plastic part, r the hardening and dy = Vy / k. The shear is k d - (1 - r) k p, p flowing stage by
stage, or, in an implicit step, by the trapezoid over the drift. Its rate has a kink where the drift turns and where z
changes its sign: sub-steps end there, and are so short that z can't reach its limit from anywhere within one. Between
kinks p' is a polynomial of z and d' where n is whole: `exact` finds p by its series, term by term with the motion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from pounding_sweep.kernel.group import Group, Storey, power_of
from pounding_sweep.kernel.roots import course, crossing, cubic
from pounding_sweep.lanes import Cell, count_to, fma, maximum, minimum, size, when_any, where, while_any

#: Share of its limit, over n, by which a drift may move in a sub-step.
REACH = 0.5
#: Rounds of Newton's method over the end of an implicit step; from within the reach two or three are enough.
MAX_ROUNDS = 30


def iter_storeys(group: Group) -> Iterator[Storey]:
    """Go through the storeys of this law."""
    for i, _ in group.spec.smooth:
        yield group.storey(i)


def _share(storey: Storey, z: Any, v: Any) -> Any:
    """Rate of the plastic drift over that of the drift."""
    beta = storey.wen_beta
    filled = power_of(size(z) / storey.yield_drift, storey.exponent)
    return filled * (storey.wen_gamma + where(z * v < 0.0, -beta, beta))


def _end(storey: Storey, end: str) -> tuple[Any, Any]:
    """Return z and the drift's rate at the start ("0") or the end ("") of the sub-step."""
    z = storey.drift(f"u{end}") - getattr(storey, f"slip{end}")
    return z, storey.drift(f"v{end}")


def shear(storey: Storey, name: Any) -> Any:
    """Storey shear at the displacements of that name; of rates, its rate."""
    k, (_, soft), moves = storey.stiffness, storey.hardened, storey.drift(name)
    if not isinstance(name, str):  # a term of the series
        return k * moves - soft * storey.group.state["taylor_slip", storey.index + name.begin]
    if name.startswith("v"):
        return (k - soft * _share(storey, *_end(storey, name[1:]))) * moves
    return k * moves - soft * getattr(storey, f"slip{name[1:]}")


class Flow:
    """Plastic drifts of a row within a step, stage by stage."""

    def __init__(self, group: Group) -> None:
        self._group = group
        self._storeys = list(iter_storeys(group))
        self._now = [storey.slip0 for storey in self._storeys]
        self._start, self._rates = list(self._now), [[] for _ in self._storeys]  # type: ignore[var-annotated]
        #: Sums of weight x rate of what yielding has lost, in (1 - r) Vy, by storey.
        self.dissipated: dict[int, Any] = {}

    def set_stage(self, x: Sequence[Any], y: Sequence[Any], weight: float) -> None:
        """Make shears those of this stage, of displacements x and velocities y."""
        group = self._group
        for storey, slip, rates in zip(self._storeys, self._now, self._rates, strict=True):
            moved, v = (storey.drift(values) for values in (x, y))
            z = moved - slip
            rates.append(_share(storey, z, v) * v)
            storey.ct = -storey.hardened[1] * slip
            if "hysteretic" in group.requested:
                part = weight * (z / storey.yield_drift * rates[-1])
                i = storey.index
                self.dissipated[i] = self.dissipated[i] + part if i in self.dissipated else part

    def advance(self, after: Callable[..., tuple[Any, Any]], stage: int, h: Any) -> None:
        """Go on from a stage, as `after` does with velocities."""
        pairs = zip(self._start, self._rates, strict=True)
        self._now = [after(stage, start, start, start, rates, h)[1] for start, rates in pairs]

    def store_end(self) -> None:
        """Leave the plastic drifts of the step's end."""
        for storey, slip in zip(self._storeys, self._now, strict=True):
            storey.slip = slip
        recompute(self._group)


def rounds(group: Group) -> Iterator[None]:
    """Go round an implicit step, shears in straight lines, until they are those of the law at its end."""
    # With the drift's change D = d1 - d0 and the share q of it that flows into p,
    #     p1 = p0 + D (q(z0, D) + q(z1, D)) / 2,
    # of which Newton's method finds p1 and d1 together: p1 = REST + FLOW d1. It loses (p1 - p0) (z0 + z1) / 2. As q
    # does not fall while z is loaded, p1 is the only one, with z1 within what `_tangent` allows.
    s, storeys = group.state, list(iter_storeys(group))
    moves = s["h"] > 0.0
    for storey in storeys:
        storey.flow = _share(storey, *_end(storey, "0"))
        storey.rest = storey.slip0 - storey.flow * storey.drift("u0")
    active, astray = Cell(moves), group.cell(False)
    for _ in while_any(lambda: active.now, at_most=MAX_ROUNDS):
        for storey in storeys:
            soft = storey.hardened[1]
            storey.kt = fma(-soft, storey.flow, group.full(storey.stiffness))
            storey.ct = -soft * storey.rest
        yield
        # lanes that are there stay there, and do the same in each round that others need
        running, again, far, better = active.now, group.cell(False), group.cell(False), []
        for storey in storeys:
            d = storey.drift()
            p = where(moves, fma(storey.flow, d, storey.rest), storey.slip0)
            flow, then = _tangent(storey, d, p)
            miss, scale = size(then - p), size(d) + storey.yield_drift * storey.wen_limit
            storey.slip = p
            better.append((storey, flow, then - flow * d))
            again.now |= ~(miss <= group.limit.swept * scale)
            far.now |= ~(miss <= group.limit.unswept * scale)
        active.now, astray.now = running & again.now, running & far.now
        for storey, flow, rest in better:
            storey.put(active.now, flow=flow, rest=rest)
    # one that is tried as a whole step is tried again in shorter ones where it was too long
    short = (s["time_left"] > 0.0) | ~_too_long(group, s["h"])
    s.put(astray.now & short, 1.0, "unsolved")


def _tangent(storey: Storey, d: Any, p: Any) -> tuple[Any, Any]:
    """Return dp/dd at the end of an implicit step whose drift is d, and what Newton's method makes of p there."""
    n, p0, dy, d0 = storey.exponent, storey.slip0, storey.yield_drift, storey.drift("u0")
    beta, gamma, change = storey.wen_beta, storey.wen_gamma, 0.5 * (d - d0)
    z0 = d0 - p0
    # the largest |z|: there the share is twice that at which z would stand still
    most = maximum(size(z0), 2.0 ** (1.0 / n) * (dy * storey.wen_limit))
    z = minimum(maximum(d - p, -most), most)
    filled = size(z) / dy
    slope = power_of(filled, n - 1.0) * (gamma + where(z * change < 0.0, -beta, beta))
    shares = _share(storey, z0, change) + filled * slope
    bends = (n / dy) * change * where(z < 0.0, -slope, slope)
    inverse = 1.0 / (1.0 + bends)
    at = d - z
    return (0.5 * shares + bends) * inverse, at - (at - p0 - change * shares) * inverse


def add_dissipated(storey: Storey) -> None:
    """Add what yielding has lost in an implicit step."""
    mean = 0.5 * (_end(storey, "0")[0] + _end(storey, "")[0])
    storey.travel = fma(storey.slip - storey.slip0, mean / storey.yield_drift, storey.travel)


def recompute(group: Group) -> None:
    """Make shears those of the present state."""
    for storey in iter_storeys(group):
        storey.kt = group.full(storey.stiffness)
        storey.ct = -storey.hardened[1] * storey.slip


def part(group: Group, t: Any) -> None:
    """Make shears those at a part t of the sub-step just taken, between whose ends plastic drifts are cubics."""
    _s, h = group.state, group.state["h"]
    for storey in iter_storeys(group):
        p0, p1 = storey.slip0, storey.slip
        r0, r1 = (h * _share(storey, z, v) * v for z, v in (_end(storey, end) for end in ("0", "")))
        slip = cubic(p0, p1, r0, r1).value(t)
        storey.kt, storey.ct = group.full(storey.stiffness), -storey.hardened[1] * slip


def linearise(group: Group, end: str) -> None:
    """Make shears and their rates those of the start ("0") or the end ("") of the sub-step."""
    for storey in iter_storeys(group):
        z, v = _end(storey, end)
        less = storey.hardened[1] * _share(storey, z, v)
        slip = getattr(storey, f"slip{end}")
        storey.kt = storey.stiffness - less
        storey.ct = less * (z + slip) - storey.hardened[1] * slip


def _reach(storey: Storey) -> Any:
    """How far the drift may move in a sub-step."""
    return (REACH / storey.exponent) * (storey.yield_drift * storey.wen_limit)


def longest(group: Group, h: Any) -> Any:
    """Longest sub-step from the present state, h where it may be as long."""
    length = group.cell(h)
    for storey in iter_storeys(group):
        speed, reach = size(storey.drift("v")), _reach(storey)
        length.now = minimum(length.now, where(speed * h > reach, reach / speed, h))
    return length.now


def may_change(group: Group, h: Any) -> Any:
    """Lanes in which a drift turned, or its z changed sign, in the step just taken, or that was too long."""
    lanes = Cell(_too_long(group, h))
    for storey in iter_storeys(group):
        (z0, v0), (z1, v1) = (_end(storey, end) for end in ("0", ""))
        lanes.now |= (v0 * v1 < 0.0) | (z0 * z1 < 0.0)
    return lanes.now


def _too_long(group: Group, h: Any) -> Any:
    """Lanes in which a drift moved farther than it may in the step just taken."""
    lanes = group.cell(False)
    for storey in iter_storeys(group):
        fastest = maximum(size(storey.drift("v0")), size(storey.drift("v")))
        lanes.now |= ~(h * fastest <= (1.0 + group.limit.at_kink) * _reach(storey))
    return lanes.now


def locate_event(group: Group, asks: Any) -> Any:
    """Fraction of the trial at which the first kink is (1: none), in the lanes that ask."""
    h, first = group.state["h"], group.cell(1.0)
    for storey in iter_storeys(group):
        (z0, v0), (z1, v1) = (_end(storey, end) for end in ("0", ""))
        turns, crosses = asks & (v0 * v1 < 0.0), asks & (z0 * z1 < 0.0)
        with when_any(turns | crosses):
            moves = course(group, storey.drift)
            turn = crossing(group, turns, 0.0, 1.0, moves.rate, where(v0 > 0.0, -1.0, 1.0))
            w0, w1 = (h * (v - _share(storey, z, v) * v) for z, v in ((z0, v0), (z1, v1)))
            side = where(z0 > 0.0, -1.0, 1.0)
            cross = crossing(group, crosses, 0.0, 1.0, cubic(z0, z1, w0, w1), side)
            for kinks, t in ((turns, turn), (crosses, cross)):
                inside = kinks & (t > group.limit.at_kink) & (t < 1.0 - group.limit.at_kink)
                first.now = where(inside, minimum(first.now, t), first.now)
    return first.now


# steps by series -----------------------------------------------------------------------------------------------------


def begin_term(group: Group, x: Any) -> None:
    """Keep a coefficient of z and of drifts' rates, by that of floors, and make shears those of this coefficient."""
    s = group.state
    for storey in iter_storeys(group):
        row = storey.index + x.begin
        slip = s["taylor_slip", row]
        storey.ct = -storey.hardened[1] * slip
        s["taylor_z1", row] = storey.drift(x) - slip
        s["taylor_rate", row] = storey.drift(x.rates)


def end_term(group: Group, k: Any, x: Any, per: Any) -> None:
    """Find coefficient k + 1 of plastic drifts: that of p' = FLOW z^n d', FLOW following the signs of z and d'."""
    s, n, storeys = group.state, group.spec.n_moving, list(iter_storeys(group))
    for storey in storeys if x.constant else ():
        _begin_signs(storey)

    def products(some: Sequence[Storey], names: Sequence[str], other: str) -> Iterator[tuple[Storey, Any]]:
        sums = [group.cell(0.0) for _ in some]
        for q in range(k + 1) if isinstance(k, int) else count_to(k + 1):
            for storey, name, total in zip(some, names, sums, strict=True):
                total.now = fma(s[name, storey.index + q * n], s[other, storey.index + (k - q) * n], total.now)
        yield from ((storey, total.now) for storey, total in zip(some, sums, strict=True))

    for power in range(2, 1 + int(max(storey.exponent for storey in storeys))):
        some = [storey for storey in storeys if storey.exponent >= power]
        for storey, total in products(some, [f"taylor_z{power - 1}"] * len(some), "taylor_z1"):
            s[f"taylor_z{power}", storey.index + k * n] = total
    for storey, total in products(storeys, [f"taylor_z{storey.exponent:.0f}" for storey in storeys], "taylor_rate"):
        s["taylor_slip", storey.index + (k + 1) * n] = per * (storey.flow * total)


def _begin_signs(storey: Storey) -> None:
    """Find what flows of z^n d' in the sub-step to come: the signs stay, once the storey moves, until the next kink."""

    def sign(name: str, change: Any, otherwise: Any) -> Any:
        by_more = size(change) > storey.group.limit.at_rest * storey.drift(name, rounding=True)
        return where(by_more, where(change < 0.0, -1.0, 1.0), otherwise)

    way, side, n = storey.rate_sign, storey.z_sign, storey.exponent
    # at rest the sign of what it begins to do, or none
    starts = sign("v0", storey.drift("v0"), sign("y", storey.drift("y"), 0.0))
    storey.rate_sign = way = where(way == 0.0, starts, way)
    storey.z_sign = side = where(side == 0.0, sign("u0", _end(storey, "0")[0], way), side)
    share = (storey.wen_gamma + side * way * storey.wen_beta) / power_of(storey.yield_drift, n)
    storey.flow = share * side if n % 2.0 else share


def apply_events(group: Group, lands: Any) -> None:
    """Change the signs that have a kink at the end of this sub-step."""
    for storey in iter_storeys(group):
        due = lands & (storey.turn <= group.state["fraction"])
        for kind, name in enumerate(("rate_sign", "z_sign"), 1):
            storey.put(due & (storey.then == float(kind)), **{name: -getattr(storey, name)})
