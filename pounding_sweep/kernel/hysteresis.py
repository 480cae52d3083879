"""Storeys that follow storey laws: their springs, the events of these, and what flows between events.

A storey's shear is that of all its springs. Between events it is V = KT d + CT, of the drift d, with KT and CT frozen
within a sub-step, or follows internal variables that flow: stage by stage, by the trapezoid, or by their series.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import reduce
from itertools import accumulate
from operator import add, or_
from typing import Any

from pounding_sweep.kernel import collapse
from pounding_sweep.kernel.group import Group, Storey, StoreySpring
from pounding_sweep.kernel.roots import NEVER, course, crossing, cubic
from pounding_sweep.kernel.types import ByFloor, Index, Lanes, Truths
from pounding_sweep.lanes import Cell, fma, maximum, minimum, size, when_any, where, while_any
from pounding_sweep.model.storeys import FAILED, DriftGauge, SignGauge

#: Rounds of Newton's method over the end of an implicit step; from within the reach two or three are enough.
MAX_ROUNDS = 30


def declare_rows(group: Group) -> None:
    """Declare what storeys need that yield, and their springs: what their laws say."""
    spec, many = group.spec, len(group.spec.hysteretic)
    if spec.yielding:
        group.declare(spec.n_moving, "kt", "ct", "set", *(["kd"] if spec.tangent else []))
        moving = [f"{name}0" for name in spec.of_springs("moving")]
        group.declare(many, *spec.of_springs("rows"), *moving, "turn", "then")
        group.declare(many, *(("flow", "rest") if spec.flowing and spec.implicit else ()))
        group.declare(1, *(["collapsed"] if spec.falling else []))


def flowing(group: Group) -> list[StoreySpring]:
    """Return the springs whose internal variables flow between events."""
    return [spring for spring in group.iter_springs() if not spring.law.straight]


# shears --------------------------------------------------------------------------------------------------------------


def begin(group: Group, lanes: Truths = None) -> None:
    """Let all springs be in their first state, in all lanes or some."""
    for i in group.indices(group.spec.n_dof):
        for name in ("kt", "kd") if group.spec.tangent else ("kt",):
            group.state.put(lanes, group.full(group.prop("k", i)), name, i)
    for spring in group.iter_springs():
        spring.law.begin(spring, lanes)
        if not spring.law.flies:
            _put_line(spring, lanes)


def _line(spring: StoreySpring, name: ByFloor, constant: bool) -> tuple[Lanes, Lanes]:
    """Tangent and constant of a shear: at displacements of a name, as it changes with rates, or in a term."""
    law: Any = spring.law
    if law.straight:
        kt, ct = law.line(spring)
        return kt, ct if constant else 0.0
    if not isinstance(name, str):
        return law.line_at(spring, spring.term("taylor_slip", name.order))
    slip = getattr(spring, f"slip{name[1:]}")
    if name.startswith("u"):
        return law.line_at(spring, slip)
    return law.tangent(spring, spring.drift(f"u{name[1:]}"), spring.drift(name), slip)


def _sum(lines: Iterable[tuple[Lanes, Lanes]]) -> tuple[Lanes, Lanes]:
    kt, ct = (reduce(add, parts) for parts in zip(*lines, strict=True))
    return kt, ct


def put_lines(
    group: Group, name: ByFloor = "u", line: Callable[[StoreySpring], tuple[Lanes, Lanes]] | None = None
) -> None:
    """Make shears of storeys in which a spring flows those of `_line`, or of another line of these springs."""
    constant = isinstance(name, str) or name.constant
    for i in group.spec.flowing:
        storey, own = group.storey(i), []
        for spring in storey.springs():
            own.append(_line(spring, name, constant) if line is None or spring.law.straight else line(spring))
        storey.kt, storey.ct = _sum(own)


def _put_line(spring: StoreySpring, lanes: Truths) -> None:
    """Make a storey's shear that of its springs in their present branches, in some lanes."""
    springs = spring.storey.springs() if isinstance(spring.storey.index, int) else [spring]
    kt, ct = _sum(each.law.line(each) for each in springs)
    spring.put(lanes, kt=kt, ct=ct)
    if spring.group.spec.tangent:
        k = spring.storey.stiffness
        spring.put(lanes, kd=maximum(fma(spring.storey.tangent, kt - k, spring.group.full(k)), 0.0))


def shear(storey: Storey, name: ByFloor = "u") -> Lanes:
    """Storey shear, dampers not included; of rates, or of what says that it has no `constant`, its rate."""
    constant = name.startswith(("u", "set")) if isinstance(name, str) else name.constant
    kt, ct = storey.kt, storey.ct
    if isinstance(storey.index, int) and storey.index in storey.group.spec.flowing:
        kt, ct = _sum(_line(spring, name, constant) for spring in storey.springs())
        constant = constant or not isinstance(name, str)
    rising = kt * storey.drift(name)
    return rising + ct if constant else rising


def borne(storey: Storey, name: ByFloor = "u") -> Lanes:
    """Shear of a storey, which bears what the weights above it push too."""
    if not storey.group.spec.p_delta:
        return shear(storey, name)
    return shear(storey, name) + storey.geometric * storey.drift(name)


def find_sets(group: Group) -> None:
    """Find the displacements at which buildings rest that nothing else holds back, as their storeys have yielded."""
    for _, floors in group.iter_buildings():
        drifts = [-group.state["ct", i] / group.prop("k", i) for i in floors]
        for i, total in zip(floors, accumulate(drifts), strict=True):
            group.state["set", i] = total


def is_yielding(group: Group) -> Truths:
    """Lanes in which any storey has another stiffness than at first."""
    lanes = group.cell(False)
    for storey in group.iter_storeys(group.spec.yielding):
        lanes.now |= ~(storey.kt == storey.stiffness)
    return lanes.now


# events --------------------------------------------------------------------------------------------------------------


def gauges(spring: StoreySpring) -> list[DriftGauge | SignGauge]:
    """Return what ends the present branch of a spring, or the scenario as its storey falls."""
    i, limited = spring.storey.index, spring.group.spec.limited
    falls = limited and (i in limited if isinstance(i, int) else True)
    return [*spring.law.gauges(spring), *([collapse.gauge(spring)] if falls else [])]


def margin(spring: StoreySpring, gauge: DriftGauge, share: float) -> Lanes:
    """By what a drift is beyond a bound for more than rounding, `share` of the bound's distance from the middle."""
    ends = spring.drift("u0", rounding=True) + spring.drift("u", rounding=True)
    return fma(gauge.reach, share, (size(gauge.middle) + ends) * spring.group.limit.exact)


def _may_end(spring: StoreySpring, gauge: DriftGauge | SignGauge, h: Lanes) -> Truths:
    """Lanes in which a branch may have ended in the step just taken."""
    if isinstance(gauge, SignGauge):
        return gauge.sign * gauge.end < 0.0
    (d0, d1, v0, v1), more = spring.ends(), margin(spring, gauge, spring.group.limit.at_release)
    early, late = d0 + h * v0, d1 - h * v1
    over, under = maximum(d1, minimum(early, late)), minimum(d1, maximum(early, late))
    leaves = gauge.ranged & ((over > gauge.high + more) | (under < gauge.low - more))
    return leaves | (minimum(gauge.way * v0, gauge.way * v1) < 0.0)


def may_change(group: Group, h: Lanes) -> Truths:
    """Lanes in which a branch of any spring, or a storey, may have ended in the step just taken, or too long a one."""
    lanes = group.cell(False)
    for spring in group.iter_springs():
        for gauge in gauges(spring):
            lanes.now |= _may_end(spring, gauge, h)
        if not spring.law.straight:
            lanes.now |= _too_long(spring, h)
    return lanes.now


def locate_event(group: Group, asks: Truths) -> Lanes:
    """Fraction of the trial at which the first branch ends (1: none), in the lanes that ask."""
    first = group.cell(1.0)
    for spring in group.iter_springs(straight=False):
        spring.put(asks, turn=NEVER)
        for gauge in gauges(spring):
            busy = asks & _may_end(spring, gauge, group.state["h"])
            with when_any(busy):
                locate: Any = _locate_kink if isinstance(gauge, SignGauge) else _locate_end
                locate(spring, gauge, busy)
        first.now = minimum(first.now, spring.turn)
    return first.now


def _locate_end(spring: StoreySpring, gauge: DriftGauge, busy: Truths) -> None:
    """Find when the drift ends a branch in the trial, and which follows."""
    group, (d0, d1, v0, v1) = spring.group, spring.ends()
    more = margin(spring, gauge, group.limit.at_release)
    high, low, drift = gauge.high + more, gauge.low - more, course(group, spring.drift)
    free = gauge.way == 0.0
    turns = busy & where(free, v0 * v1 < 0.0, minimum(gauge.way * v0, gauge.way * v1) < 0.0)
    toward = where(free, where(v0 > 0.0, 1.0, -1.0), gauge.way)
    extreme = where(turns, crossing(group, turns, 0.0, 1.0, drift.rate, -toward), 1.0)
    # a drift leaves its range before it turns, or after, unless the turn ends the branch
    farthest = drift.value(extreme)
    before = turns & gauge.ranged & where(toward > 0.0, farthest > high, farthest < low)
    after = busy & gauge.ranged & ~before & ((d1 > high) | (d1 < low)) & ~(turns & ~free)
    side = where(before, toward, where(d1 > gauge.middle, 1.0, -1.0))
    start = side * minimum(side * (d0 - where(side > 0.0, gauge.high, gauge.low)), 0.0)
    first, last = where(after & turns, extreme, 0.0), where(before, extreme, 1.0)
    leaves = before | after
    when = crossing(group, leaves, first, last, drift.begun(start), side)
    turn = where(leaves, when, where(turns & ~free, extreme, NEVER))
    then = where(leaves, where(side > 0.0, gauge.above, gauge.below), gauge.turned)
    spring.put(busy & (turn < spring.turn), turn=turn, then=then)


def _locate_kink(spring: StoreySpring, gauge: SignGauge, busy: Truths) -> None:
    """Find when a quantity changes its sign in the trial; a kink next to an end is at that end."""
    group, h = spring.group, spring.group.state["h"]
    slopes = gauge.slopes
    curve = cubic(gauge.start, gauge.end, *slopes(h)) if slopes else course(group, spring.drift).rate
    t = crossing(group, busy, 0.0, 1.0, curve, -gauge.sign)
    inside = busy & (t > group.limit.at_kink) & (t < 1.0 - group.limit.at_kink)
    spring.put(inside & (t < spring.turn), turn=t, then=gauge.kink)


def apply_events(group: Group, lands: Truths, h: Lanes) -> Truths:
    """Enter the phases that begin at the end of this sub-step, of a step of length h; returns where lines changed."""
    switched = group.cell(False)
    for spring in group.iter_springs(straight=False):
        turn = spring.turn
        due = lands & (turn < 1.0) & (turn <= group.state["fraction"] + group.limit.same_time)
        with when_any(due):
            enters = due
            if spring.law.softens and "shear" in group.requested:  # which is largest where a branch ends
                spring.put(due, shear=maximum(spring.shear, size(borne(spring.storey))))
            if group.spec.limited:
                falls = spring.then == collapse.FALLEN
                collapse.fall(spring, due & falls, h)
                enters = due & ~falls
            spring.law.switch(spring, enters)
            if spring.law.straight:
                _put_line(spring, enters)
            if spring.law.can_fail:
                collapse.fail(spring, enters & (spring.phase == FAILED), h)
        if spring.law.straight:
            switched.now |= due
    if group.spec.falling:
        group.state.put(~collapse.stands(group), 0.0, "time_left")
    return switched.now


def follow(group: Group) -> None:
    """Let internal variables follow the motion to the present state."""
    for spring in group.iter_springs():
        spring.law.follow(spring)
    put_lines(group)


# what flows between events -------------------------------------------------------------------------------------------


def part(group: Group, t: Lanes) -> None:
    """Make shears those at a part t of the sub-step just taken, between whose ends plastic drifts are cubics."""
    h = group.state["h"]

    def line(spring: StoreySpring) -> tuple[Lanes, Lanes]:
        p0, p1 = spring.slip0, spring.slip
        d0, d1, v0, v1 = spring.ends()
        r0, r1 = (h * spring.law.flow(spring, d, v, p) for d, v, p in ((d0, v0, p0), (d1, v1, p1)))
        return spring.law.line_at(spring, cubic(p0, p1, r0, r1).value(t))

    put_lines(group, line=line)


def _too_long(spring: StoreySpring, h: Lanes) -> Truths:
    """Lanes in which the drift moved farther than it may in the step just taken."""
    fastest = maximum(size(spring.drift("v0")), size(spring.drift("v")))
    return ~(h * fastest <= (1.0 + spring.group.limit.at_kink) * spring.law.reach(spring))


def longest(group: Group, h: Lanes) -> Lanes:
    """Longest sub-step from the present state, h where it may be as long."""
    length = group.cell(h)
    for spring in flowing(group):
        speed, reach = size(spring.drift("v")), spring.law.reach(spring)
        length.now = minimum(length.now, where(speed * h > reach, reach / speed, h))
    return length.now


class Flow:
    """Plastic drifts of a row within a step, stage by stage."""

    def __init__(self, group: Group) -> None:
        self._group, self._springs = group, flowing(group)
        self._start = self._now = [spring.slip0 for spring in self._springs]
        self._rates: list[list[Lanes]] = [[] for _ in self._springs]
        #: Sums of weight x rate of what is lost, by spring.
        self.dissipated: dict[int, Lanes] = {}

    def set_stage(self, x: Sequence[Lanes], y: Sequence[Lanes], weight: float) -> None:
        """Make shears those of this stage, of displacements x and velocities y."""
        slips = dict[int, Lanes]()
        for spring, slip, rates in zip(self._springs, self._now, self._rates, strict=True):
            moved, v, e = spring.drift(x), spring.drift(y), spring.number
            law: Any = spring.law
            rates.append(law.flow(spring, moved, v, slip))
            slips[e] = slip
            if "hysteretic" in self._group.requested:
                part = weight * law.lost(spring, moved, slip, rates[-1])
                self.dissipated[e] = self.dissipated[e] + part if e in self.dissipated else part
        put_lines(self._group, line=lambda spring: spring.law.line_at(spring, slips[spring.number]))

    def advance(self, after: Callable[..., tuple[Lanes, Lanes]], stage: int, h: Lanes) -> None:
        """Go on from a stage, as `after` does with velocities."""
        pairs = zip(self._start, self._rates, strict=True)
        self._now = [after(stage, start, start, start, rates, h)[1] for start, rates in pairs]

    def store_end(self) -> None:
        """Leave the plastic drifts of the step's end."""
        for spring, slip in zip(self._springs, self._now, strict=True):
            spring.slip = slip
        put_lines(self._group)


def solve_step(group: Group, take: Callable[[], None]) -> None:
    """Take an implicit step, shears in straight lines, again and again until they are those of the laws at its end."""
    # of each spring p1 = REST + FLOW d1
    s, springs = group.state, flowing(group)
    moves = s["h"] > 0.0
    for spring in springs:
        spring.flow = spring.law.predict(spring)
        spring.rest = spring.slip0 - spring.flow * spring.drift("u0")
    active, astray = Cell(moves), group.cell(False)
    for _ in while_any(lambda: active.now, at_most=MAX_ROUNDS):
        put_lines(group, line=_line_of_round)
        take()
        # lanes that are there stay there, and do the same in each round that others need
        running, again, far, better = active.now, group.cell(False), group.cell(False), []
        for spring in springs:
            law: Any = spring.law
            d = spring.drift()
            p = where(moves, fma(spring.flow, d, spring.rest), spring.slip0)
            flow, then = law.solve(spring, d, p)
            miss, scale = size(then - p), size(d) + law.reach(spring)
            spring.slip = p
            better.append((spring, flow, then - flow * d))
            again.now |= ~(miss <= group.limit.swept * scale)
            far.now |= ~(miss <= group.limit.unswept * scale)
        active.now, astray.now = running & again.now, running & far.now
        for spring, flow, rest in better:
            spring.put(active.now, flow=flow, rest=rest)
    # one that is tried as a whole step is tried again in shorter ones where it was too long
    short = s["time_left"] > 0.0
    short = short | ~reduce(or_, [_too_long(spring, s["h"]) for spring in springs])
    s.put(astray.now & short, 1.0, "unsolved")


def _line_of_round(spring: StoreySpring) -> tuple[Lanes, Lanes]:
    """Return the line of a spring whose plastic drift is REST + FLOW d."""
    kt, c0 = spring.law.line_at(spring, spring.rest)
    return kt + spring.law.line_at(spring, spring.flow)[1], c0


def add_dissipated(group: Group) -> None:
    """Add what has been lost in an implicit step."""
    for spring in flowing(group):
        d0, d1, _, _ = spring.ends()
        p0, p1 = spring.slip0, spring.slip
        spring.travel += spring.law.lost(spring, 0.5 * (d0 + d1), 0.5 * (p0 + p1), p1 - p0)


# steps by series -----------------------------------------------------------------------------------------------------


def begin_term(group: Group, k: Index, x: ByFloor) -> None:
    """Keep what coefficient k of floors gives of springs, and make shears those of this coefficient."""
    for spring in flowing(group):
        spring.law.begin_term(spring, k, x)
    put_lines(group, x)


def end_term(group: Group, k: Index, x: ByFloor, per: Lanes) -> None:
    """Find coefficient k + 1 of plastic drifts."""
    for law in {id(spring.law): spring.law for spring in flowing(group)}.values():
        law.end_term([spring for spring in flowing(group) if spring.law is law], k, x, per)
