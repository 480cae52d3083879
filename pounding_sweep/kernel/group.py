"""A group of lanes: its state, the scene's constants, the law, and what is asked of it."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterator, Sequence
from copy import copy
from functools import cached_property
from itertools import groupby
from types import SimpleNamespace
from typing import Any

from llvmlite import ir

from pounding_sweep.kernel.lanes import (
    Contact,
    Count,
    Counts,
    Lookup,
    Rows,
    Table,
    Tracer,
    Vector,
    count_to,
    everywhere,
    maximum,
    minimum,
    power,
    roughly_power,
    sqrt,
    where,
)
from pounding_sweep.kernel.spec import TOLERANCES, KernelSpec, LawShape, input_slots, property_slots, result_slots
from pounding_sweep.model.formula import read, value
from pounding_sweep.model.laws import RESTING_SPEED

#: Constants that all lanes share even where buildings vary.
SHARED = frozenset({"u0", "v0", "cap", "newmark_beta", "newmark_gamma"})
#: What a reducer asks of each sub-step of a closed contact, each with those before it: nothing, the penetration at
#: both ends, the force too, or that forces and their rates at both ends are kept for all floors.
LOOKS = ("", "depth", "force", "ends")
#: Rows of what floors move by beside their acceleration at the start of a sub-step of stages, in shares of its length
#: to the third, fourth and fifth power.
BENDS = ("c3", "c4", "c5")
#: Share of an elastic contact's duration over which sub-steps grow to a whole step, where they are graded.
GRADED_SHARE = 0.5
#: The same in the longer sub-steps of exact flight, of a damper that begins with a steeper root than forces do.
STEEP_SHARE = 1.0


def power_of(x: Any, exponent: float) -> Any:
    """Return x to a constant power: products and roots where they do, of which lanes have instructions; else x >= 0."""
    whole, quarters = divmod(4.0 * exponent, 4.0)
    if not (0.0 <= exponent <= 4.0 and quarters == round(quarters)):
        return power(maximum(x, 0.0), exponent)
    factors = [x] * int(whole)
    if quarters:
        root = sqrt(maximum(x, 0.0))
        factors += [root] * (quarters >= 2.0) + ([sqrt(root)] if quarters % 2.0 else [])
    return math.prod(factors[1:], start=factors[0]) if factors else 1.0


#: Functions in the formulas of laws.
_FUNCTIONS: dict[str, Callable[..., Any]] = {"max": maximum, "sqrt": sqrt, "pow": power_of}


class LaneLaw:
    """The formulas of a contact law, as functions of lanes.

    Of stiffness `k`, damping `c`, penetration `d` (m) and its rate `v` (m/s): kN.
    """

    def __init__(self, shape: LawShape, order: int, exact: float, share: float = GRADED_SHARE) -> None:
        self.shape = shape
        self.touch_power, self.release_power = shape.grading(order)
        self.graded = max(self.touch_power, self.release_power) > 1.0
        #: Shares by which graded sub-steps grow after a touch and shrink before a release.
        self.touch_share, self.release_share = (
            1.0 / (q * share ** (1.0 - 1.0 / q)) for q in (self.touch_power, self.release_power)
        )
        #: Least root of a graded sub-step, in durations of the contact: its error is that of rounding.
        self.least_share = exact ** (1.0 / (order + 1))
        degree = 1.0 / (shape.exponent + 1.0)
        factor = 2.0 * math.sqrt(math.pi) * math.gamma(1.0 + degree) / math.gamma(0.5 + degree)
        self._duration = factor * (0.5 * (shape.exponent + 1.0)) ** degree, degree

    def _evaluate(self, text: str, d: Any, **given: Any) -> Any:
        formula = read(text)
        if any(isinstance(part, ast.Name) and part.id == "r" for part in ast.walk(formula)):
            given["r"] = sqrt(maximum(d, 0.0))
        return value(formula, {"d": d, **given}, _FUNCTIONS)

    def elastic(self, k: Any, c: Any, d: Any) -> Any:
        """Elastic force."""
        return self._evaluate(self.shape.elastic, d, k=k, c=c)

    def elastic_slope(self, k: Any, d: Any) -> Any:
        """Its derivative by d."""
        return self._evaluate(self.shape.elastic_slope, d, k=k)

    def damper(self, c: Any, d: Any) -> Any:
        """Force by rate; 0.0 where the law has none."""
        return self._evaluate(self.shape.damper, d, c=c) if self.shape.damper else 0.0

    def pressing(self, k: Any, c: Any, d: Any, v: Any) -> Any:
        """Force before any cut."""
        found = self.elastic(k, c, d)
        return found + self.damper(c, d) * v if self.shape.damper else found

    def pressing_rate(self, k: Any, c: Any, d: Any, v: Any, a: Any) -> Any:
        """Its derivative by time."""
        slope = self.elastic_slope(k, d)
        if not self.shape.damper:
            return slope * v
        return (slope + self._evaluate(self.shape.damper_slope or "0.0", d, c=c) * v) * v + self.damper(c, d) * a

    def damped_rate(self, v: Any) -> Any:
        """Rate of the penetration that the damper feels."""
        if self.shape.rebound_only:
            return minimum(v, 0.0)
        return maximum(v, 0.0) if self.shape.approach_only else v

    def closed_force(self, k: Any, c: Any, d: Any, v: Any) -> Any:
        """Force of a closed contact, cut at zero where the law cannot pull."""
        found = self.elastic(k, c, d)
        found = found + self.damper(c, d) * self.damped_rate(v) if self.shape.damper else found
        return found if self.shape.tension else where(d > 0.0, maximum(found, 0.0), 0.0)

    def memoryless(self, k: Any, c: Any, fastest: Any, d: Any, v: Any) -> Any:
        """Force where nothing but the present state decides it; `fastest` is the rate of approach so far."""
        if self.shape.per_speed:
            c = c / maximum(maximum(fastest, v), RESTING_SPEED)
        return where(d > 0.0, self.closed_force(k, c, d, v), 0.0)

    def duration(self, k: Any, v: Any, mass: Any) -> Any:
        """How long an elastic contact of this stiffness lasts (s), to six figures."""
        factor, share = self._duration
        n, v = self.shape.exponent, maximum(v, RESTING_SPEED)
        pace = mass / k
        if n != 1.0:
            pace = pace / sqrt(v) if n == 1.5 else pace * roughly_power(v, 1.0 - n)
        found = factor * (sqrt(pace) if n == 1.0 else roughly_power(pace, share))
        if self.shape.is_power:
            return found
        # beside the power with which it begins, by the slopes where that one would turn
        deepest = roughly_power(0.5 * (n + 1.0) * mass * v * v / k, share)
        return found * sqrt(n * k * roughly_power(deepest, n - 1.0) / self.elastic_slope(k, deepest))


class Group:
    """Lanes side by side, and all that their steps share."""

    # `trace` is None for the NumPy twin, which has `constants` of the scene (`property_slots`) as an array and a
    # `memory` of its own for the state; `reducers` say what is kept

    def __init__(
        self,
        spec: KernelSpec,
        scheme: Any,
        reducers: Sequence[Any],
        trace: Tracer | None,
        lanes: int,
        constants: Any,
        memory: Any = None,
    ) -> None:
        self.spec, self.trace, self.lanes, self.constants = spec, trace, lanes, constants
        self.scheme, self.reducers, self.asked = scheme, reducers, spec.reducers
        #: Whether motions are followed between the ends of steps.
        self.follows = any(reducer.follows for reducer in reducers)
        self.contacts = spec.contacts if spec.law is not None else ()
        self.touching = len(self.contacts) > 0
        #: Whether steps are cut at events: of contacts, or of storeys that yield.
        self.eventful = self.touching or bool(spec.yielding)
        self.limit = SimpleNamespace(**TOLERANCES[spec.precision])
        steep = [spec.staged and law.damper and 0.0 < law.damper_exponent < 1.0 for law in spec.laws]
        shares = [STEEP_SHARE if each else GRADED_SHARE for each in steep]
        self.laws = [LaneLaw(law, spec.order, self.limit.exact, x) for law, x in zip(spec.laws, shares, strict=True)]
        #: Number of the step that lanes are within: one for all, or one each.
        self.number: Callable[[], Any] = lambda: 0
        self._places, self._inputs = property_slots(spec), input_slots(spec)
        self.state = Rows(trace, self._rows(), lanes, memory)
        self._scene = Table(trace, constants, lanes)

    def _rows(self) -> dict[str, int]:
        """Name all rows of state: inputs, results, motion, and what the scheme and the contacts need."""
        spec, nc, nb = self.spec, len(self.spec.contacts), self.spec.n_buildings
        rows, n = self._inputs.count | result_slots(spec, self.reducers).count, spec.n_moving
        rows |= {"u": n, "v": n, "u0": n, "v0": n, "h": 1, "g0": 1, "g1": 1}
        if spec.implicit or self.eventful or spec.links:
            rows |= {"a0": n}
        if "acceleration" in self.asked:
            rows |= dict.fromkeys(("acc0", "acc1", "rate0", "rate1"), n)
        if not spec.fused:  # sums over the stages of a step, and its stages
            rows |= dict.fromkeys(("din", "ddamp"), nb)
            if self.eventful or spec.links:
                stages = [f"s{k}" for k in range(6 if spec.flies_exactly else 4)]
                rows |= dict.fromkeys(("x", "y", "push", *stages), n) | dict.fromkeys(("dwork", "dimpulse"), nc)
        if "links" in self.asked:  # sums over the stages of a step
            rows |= {"dgiven": nb, "dlost": len(spec.links)}
        if spec.implicit and self.touching:
            rows |= {"response": (n if spec.whole else 2 * max(spec.storeys)) * nc, "diagonal": max(spec.storeys)}
        if self.eventful:
            rows |= dict.fromkeys(("time_left", "fraction", "ahead", "ga", "gb", "tries", "land", "taken"), 1)
            rows |= dict.fromkeys(("fallback", "unsolved", "stiff"), 1)
        if spec.yielding:
            rows |= dict.fromkeys(("phase", "slip", "kt", "ct", "turn", "then"), n)
            rows |= {"kd": n} if spec.tangent else {}
            rows |= {"slip0": n} if spec.smooth else {}
            rows |= {"flow": n, "rest": n} if spec.smooth and spec.implicit else {}
            rows |= {"set": n} if spec.flies_exactly else {}
        if self.touching:
            rows |= dict.fromkeys(("mode", "next", "event", "ke", "ce", "kl", "cl", "vrun", "age", "lasts"), nc)
            rows |= dict.fromkeys(("d0", "d1", "w0", "w1", "f0", "f1", "q0", "q1", "force", "asks"), nc)
            if "transfer" in self.asked:  # energy given so far, in the step, and powers
                rows |= dict.fromkeys(("now", "gain", "given", "given0", "given1"), nb)
        # what depends on the law comes last: flight, which does not, finds its rows at one place under all laws
        if spec.implicit or spec.impulsive:
            rows |= {"a": n, "alone": n}
        rows |= {"joining": nc} if spec.impulsive else {}
        if any(law.yields for law in spec.laws):
            rows |= {"plastic": nc, "yield": nc}
        #: What no step leaves to the next follows, from this row on.
        self.passing = sum(rows.values())
        rows |= dict.fromkeys(BENDS, n) if spec.staged else {}
        rows |= {"peak": n, "there": n, "press": nc} if self.presses and "acceleration" in self.asked else {}
        if spec.series:
            order, laws = spec.series, spec.laws
            rows |= {"jet": n * (order + 1), "dj": nc * (order + 1), "pick": order + 1}
            rows |= {"fj": nc * order} if any(law.damper for law in laws) else {}
            rows |= {"wj": nc * order} if any(law.damper_exponent == 1.0 for law in laws) else {}
            rows |= dict.fromkeys(("x", "y", "push"), n)
            rows |= dict.fromkeys(("span", "picked", "aim", "low", "high", "bends"), 1)
            rows |= {"ruled_out": 2 * (nc + n)}
            rows |= {"swing": nb} if "transfer" in self.asked and self.touching else {}
        return rows

    def in_lanes(self, lanes: int) -> Group:
        """Return the same for so many lanes, of whatever they are; its state is that of the scenarios."""
        found = copy(self)
        found.lanes = lanes
        if self.trace is not None:
            found.trace = Tracer(self.trace.builder, self.spec.precision, lanes)
        return found

    @property
    def presses(self) -> bool:
        """Whether forces of contacts, and accelerations beside them, follow from the motion between a step's ends."""
        spec = self.spec
        return spec.located and self.touching and not (spec.implicit or spec.impulsive or spec.series)

    def looks(self, what: str) -> bool:
        """Whether a reducer asks `what` (out of `LOOKS`) of each sub-step of a closed contact."""
        return any(LOOKS.index(reducer.looks) >= LOOKS.index(what) for reducer in self.reducers)

    def change(self, i: Any, kind: int) -> Any:
        """Return the number of a kind of change, of a contact or of a storey, these counted after contacts."""
        return i + kind * (len(self.contacts) + self.spec.n_dof)

    # what the scene gives ------------------------------------------------------------------------------------------

    def yields(self, i: Any) -> bool:
        """Whether the storey below floor i may yield; floors known at run time only have rows as those that may."""
        return bool(self.spec.yielding) and (not isinstance(i, int) or i in self.spec.yielding)

    def dashed(self, i: Any) -> bool:
        """Whether the storey below floor i has a dashpot; of floors known at run time, whether any has."""
        return bool(self.spec.dashpots) and (not isinstance(i, int) or i in self.spec.dashpots)

    def own_damper(self, i: Any) -> bool:
        """Whether the damper of the storey below floor i is no share of its stiffness."""
        return self.yields(i) or self.dashed(i)

    def prop(self, name: str, i: int = 0) -> Any:
        """Return a constant of the scene: of a floor, building or contact; per lane where buildings vary."""
        if self.spec.varied and name not in SHARED and f"p_{name}" in self._inputs.count:
            return self.state[f"p_{name}", i]
        at = self._places.first[name] + i
        return self._scene.number(at, fixed=True)

    def clock(self, h: Any) -> Any:
        """Time (s) since the start of the motion, of lanes that are within a step of length h."""
        rest = self.state["time_left"]
        number = self.number()
        if self.trace is None:
            return number * h + (h - rest)
        t, b = self.trace, self.trace.builder
        double = ir.DoubleType()
        many = isinstance(number, Counts)
        kind = ir.VectorType(double, t.lanes)
        steps = b.sitofp(number.value, kind if many else double)
        steps = steps if many else t.spread(steps)
        wide = (lambda x: x) if t.size == 8 else (lambda x: b.fpext(x, kind))
        time = b.fadd(b.fmul(steps, wide(self.full(h).value)), wide((h - rest).value))
        return Vector(t, time if t.size == 8 else b.fptrunc(time, t.vector))

    def longest(self, h: Any) -> Any:
        """Longest sub-step of a step of length h."""
        return self.prop("longest") if self.spec.staged else h

    def full(self, x: Any) -> Any:
        """Return a number or a truth in all lanes."""
        return everywhere(self.trace, x, self.lanes)

    def floor(self, x: Any, i: Any) -> Any:
        """Return floor i's of all floors' values, of the rows of a name, or of a function."""
        if isinstance(x, str):
            return self.state[x, i]
        return x(i) if callable(x) else x[i]

    def floors(self, name: str) -> list[Any]:
        """Return a row of each floor, and of foundations."""
        return [self.state[name, i] for i in range(self.spec.n_moving)]

    @cached_property
    def building_floors(self) -> list[list[int]]:
        """Floors of each building."""
        return [list(range(self.spec.home(b), self.spec.home(b) + n)) for b, n in enumerate(self.spec.storeys)]

    @property
    def long(self) -> bool:
        """Whether the row has too many floors for one straight line of code: it goes through them at run time."""
        return self.trace is not None and not self.spec.fused

    def each_contact(self, straight: bool = False, touching: bool = True) -> Iterator[Any]:
        """Go through the contacts, at run time (in a short row, if not `straight`); not `touching`: closings too."""
        contacts = self.contacts if touching else self.spec.contacts
        if self.trace is None or (straight and not self.long):
            yield from range(len(contacts))
            return

        def kind(j: int) -> tuple[tuple[bool, ...], tuple[int, bool], int]:
            """Return what contacts in one loop have in common: walls, struck columns, the law."""
            return tuple(i < 0 for i in contacts[j][:2]), self._columns(j), self.law_index(j)

        table = Lookup([i for contact in contacts for i in contact])
        for (walls, columns, law), same in groupby(range(len(contacts)), key=kind):
            some = list(same)
            if len(some) == 1:
                yield some[0]
                continue
            for q in count_to(len(some)):
                j = q + some[0]
                sides = [table[3 * j + side] for side in range(3)]
                left, right = (-1 if wall else side for wall, side in zip(walls, sides, strict=False))
                yield Contact(j, (left, right, sides[2]), columns, law)

    def each_link(self) -> Iterator[tuple[Any, tuple[Any, Any]]]:
        """Go through the links and the floors that they join; in a long row at run time."""
        if not (self.long and self.spec.links):
            yield from enumerate(self.spec.links)
            return
        table = Lookup([i for ends in self.spec.links for i in ends])
        for j in count_to(len(self.spec.links)):
            yield j, (table[2 * j], table[2 * j + 1])

    def law_index(self, j: Any) -> int:
        """Return the number of the law of contact j."""
        if isinstance(j, Contact):
            return j.law
        return self.spec.bumped[j] if self.spec.bumped else 0

    def law_of(self, j: Any) -> LaneLaw:
        """Return the law of contact j."""
        return self.laws[self.law_index(j)]

    def _columns(self, j: Any) -> tuple[int, bool]:
        """Side of contact j whose columns are struck (-1: floors meet), and whether they stand on the ground."""
        if isinstance(j, Contact):
            return j.columns
        side = self.spec.struck[j] if self.spec.struck else -1
        return side, side >= 0 and self.spec.bottom[self.spec.contacts[j][side]]

    def each_building(self) -> Iterator[tuple[Any, list[Any]]]:
        """Go through the buildings and their floors; those of a long row that are equally high at run time."""
        if not self.long:
            yield from enumerate(self.building_floors)
            return
        spec, done = self.spec, 0
        order = sorted(range(spec.n_buildings), key=lambda b: spec.storeys[b])
        table = Lookup([i for b in order for i in (b, spec.home(b))])
        for n, same in groupby(order, key=lambda b: spec.storeys[b]):
            some = list(same)
            if len(some) == 1:
                yield some[0], self.building_floors[some[0]]
            else:
                for q in count_to(len(some)):
                    at = 2 * (q + done)
                    home = table[at + 1]
                    yield table[at], [home + s for s in range(n)]
            done += len(some)

    def each_storey(self, those: Sequence[int], straight: bool = True) -> Iterator[tuple[Any, Any]]:
        """Go through some floors and those below (None: the ground), in a short row at run time if not `straight`."""
        if not self.long and (straight or self.trace is None or self.spec.foundations):
            yield from ((i, self.spec.below(i)) for i in those)
            return
        for bottom in (True, False):
            some = [i for i in those if self.spec.bottom[i] is bottom]
            for q in count_to(len(some)) if some else ():
                i = Lookup(some)[q]
                yield i, None if bottom else i - 1

    def each_part(self, whole: bool = False) -> Iterator[tuple[list[tuple[Any, list[Any]]], list[Any]]]:
        """Go through what is worked out at once, and its degrees of freedom: buildings, or the `whole` row."""
        if whole or self.spec.foundations:
            yield list(enumerate(self.building_floors)), list(range(self.spec.n_moving))
            return
        for b, floors in self.each_building():
            yield [(b, floors)], floors

    def base(self, floor: Any) -> tuple[int, int] | None:
        """Sway and rocking of the foundation below a floor; None where there is none."""
        return self.spec.base_of(floor) if self.spec.foundations else None

    def drift(self, i: Any, below: Any, x: Any = "u") -> Any:
        """Drift of the storey below floor i, of a row's name or of values floor by floor; `below` None: the ground."""
        found, base = self.floor(x, i), self.base(i)
        found = found if below is None else found - self.floor(x, below)
        return found if base is None else found - self.prop("height", i) * self.floor(x, base[1])

    def deformation(self, i: Any, x: Any, p: Any) -> Any:
        """Motion relative to the base of floor i, whose value is number p of `x`."""
        base = self.base(i)
        return x[p] if base is None else x[p] - x[base[0]] - self.prop("elevation", i) * x[base[1]]

    def rocks(self, i: Any) -> bool:
        """Whether a degree of freedom is a rotation, which the ground does not accelerate."""
        return bool(self.spec.foundations) and i >= self.spec.n_dof and (i - self.spec.n_dof) % 2 == 1

    def each(self, n: Any, straight: bool = True) -> Iterator[Any]:
        """Count to n, at run time in a long row."""
        if self.long or not straight or isinstance(n, Count):
            yield from count_to(n)
        else:
            yield from range(n)

    def sides(self, j: Any) -> tuple[Any, Any, Any]:
        """Left floor, right floor (-1: a wall) and gap of contact j."""
        found: tuple[Any, Any, Any] = j.sides if isinstance(j, Contact) else self.spec.contacts[j]
        return found

    def home_of(self, floor: Any) -> tuple[Any, Any, Any]:
        """Lowest floor, number of storeys, and number of the building of a floor."""
        spec, at = self.spec, 3 * floor
        table = Lookup([x for b in spec.building_of for x in (spec.home(b), spec.storeys[b], b)])
        return table[at], spec.storeys[0] if len(set(spec.storeys)) == 1 else table[at + 1], table[at + 2]

    def floors_of(self, j: Any, side: int) -> list[tuple[Any, Any]]:
        """Floors that contact j acts on at its left (0) or right (1) side, and the share of each (None: all)."""
        floor, (struck, grounded) = self.sides(j)[side], self._columns(j)
        if is_wall(floor):
            return []
        if side != struck:
            return [(floor, None)]
        upper = (floor, self.prop("upper", j))
        return [upper] if grounded else [(floor - 1, self.prop("lower", j)), upper]

    def ends(self, j: Any) -> list[tuple[Any, str, Any]]:
        """Floors that contact j pushes: the floor, the sign of the force on it, and its share (None: all)."""
        return [(floor, sign, share) for side, sign in enumerate("-+") for floor, share in self.floors_of(j, side)]

    def between(self, x: Any, j: Any) -> Any:
        """Left minus right of the floors of contact j, a wall being at rest; x: of all floors, or a row's name."""
        left, right = (_weighted(self.floors_of(j, side), lambda i: self.floor(x, i)) for side in (0, 1))
        if left is None:
            return -right
        return left if right is None else left - right

    def stiffness(self, j: Any) -> Any:
        """Stiffness of contact j (kN/m**exponent)."""
        return self.state["k", j] if self.spec.own_stiffness else self.state["k"]

    def gap(self, j: Any) -> Any:
        """Gap of contact j (m)."""
        return self.state["gap", self.sides(j)[2]]


def _weighted(floors: Sequence[tuple[Any, Any]], read: Callable[[Any], Any]) -> Any:
    """Sum of what is read of floors by their shares; None of none."""
    parts = [read(i) if share is None else share * read(i) for i, share in floors]
    return parts[0] + parts[1] if len(parts) > 1 else parts[0] if parts else None


def part_of(force: Any, share: Any) -> Any:
    """Return the share of a force (None: all of it)."""
    return force if share is None else share * force


def is_wall(floor: Any) -> bool:
    """Whether a side of a contact is a wall."""
    return not isinstance(floor, Count) and floor < 0
