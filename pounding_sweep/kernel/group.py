"""A group of lanes: its state, the scene's constants, the law, and what is asked of it."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, reduce
from itertools import groupby
from operator import add, sub
from types import SimpleNamespace
from typing import Any

from llvmlite import ir

from pounding_sweep.kernel.spec import TOLERANCES, KernelSpec, LawShape, input_slots, property_slots, result_slots
from pounding_sweep.lanes import (
    Cell,
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
    size,
    sqrt,
    where,
)
from pounding_sweep.model.formula import read, value
from pounding_sweep.model.laws import RESTING_SPEED

#: Constants that all lanes share even where buildings vary.
SHARED = frozenset({"u0", "v0", "cap", "newmark_beta", "newmark_gamma", "settles"})
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
    n, quarters = divmod(4.0 * exponent, 4.0)
    if not (0.0 <= exponent <= 4.0 and quarters == round(quarters)):
        return power(maximum(x, 0.0), exponent)
    factors = [x] * int(n)
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

    def _evaluate(self, text: str, d: Any, **variables: Any) -> Any:
        formula = read(text)
        if any(isinstance(part, ast.Name) and part.id == "r" for part in ast.walk(formula)):
            variables["r"] = sqrt(maximum(d, 0.0))
        return value(formula, {"d": d, **variables}, _FUNCTIONS)

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
        force = self.elastic(k, c, d)
        return force + self.damper(c, d) * v if self.shape.damper else force

    def pressing_rate(self, k: Any, c: Any, d: Any, v: Any, a: Any) -> Any:
        """Its derivative by time."""
        slope = self.elastic_slope(k, d)
        if not self.shape.damper:
            return slope * v
        return (slope + self._evaluate(self.shape.damper_slope or "0.0", d, c=c) * v) * v + self.damper(c, d) * a

    def closed_force(self, k: Any, c: Any, d: Any, v: Any) -> Any:
        """Force of a closed contact, cut at zero where the law cannot pull."""
        force = self.elastic(k, c, d)
        if self.shape.damper:
            felt = maximum(v, 0.0) if self.shape.approach_only else v
            force = force + self.damper(c, d) * (minimum(v, 0.0) if self.shape.rebound_only else felt)
        return force if self.shape.tension else where(d > 0.0, maximum(force, 0.0), 0.0)

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
        time = factor * (sqrt(pace) if n == 1.0 else roughly_power(pace, share))
        if self.shape.is_power:
            return time
        # beside the power with which it begins, by the slopes where that one would turn
        deepest = roughly_power(0.5 * (n + 1.0) * mass * v * v / k, share)
        return time * sqrt(n * k * roughly_power(deepest, n - 1.0) / self.elastic_slope(k, deepest))


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
        self.scheme, self.reducers, self.requested = scheme, reducers, spec.reducers
        #: Whether motions are followed between the ends of steps.
        self.follows = any(reducer.follows for reducer in reducers)
        self.contacts = spec.contacts if spec.law is not None else ()
        self.touching = len(self.contacts) > 0
        #: Whether steps are cut at events: of contacts, or of storeys that yield.
        self.has_events = self.touching or bool(spec.yielding)
        self.limit = SimpleNamespace(**TOLERANCES[spec.precision])
        steep = [spec.staged and law.damper and 0.0 < law.damper_exponent < 1.0 for law in spec.laws]
        shares = [STEEP_SHARE if is_steep else GRADED_SHARE for is_steep in steep]
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
        if spec.implicit or self.has_events or spec.links:
            rows |= {"a0": n}
        if not spec.by_series:
            rows |= {"flexibility": n}
        if "acceleration" in self.requested:
            rows |= dict.fromkeys(("acc_start", "acc_end", "acc_rate_start", "acc_rate_end"), n)
        if not spec.fused:  # sums over the stages of a step, and its stages
            rows |= dict.fromkeys(("din", "ddamp"), nb)
            if self.has_events or spec.links:
                stages = [f"s{k}" for k in range(6 if spec.flies_exactly else 4)]
                rows |= dict.fromkeys(("x", "y", "push", *stages), n) | dict.fromkeys(("dwork", "dimpulse"), nc)
        if "links" in self.requested:  # sums over the stages of a step
            rows |= {"dlink": nb, "dlink_loss": len(spec.links)}
        if spec.implicit and self.touching:
            rows |= {"response": (n if spec.solves_row else 2 * max(spec.storeys)) * nc, "diagonal": max(spec.storeys)}
        if self.has_events:
            rows |= dict.fromkeys(("time_left", "fraction", "ahead", "ga", "gb", "tries", "land", "accepted"), 1)
            rows |= dict.fromkeys(("fallback", "unsolved", "stiff"), 1)
        if spec.yielding:
            rows |= dict.fromkeys(("phase", "slip", "kt", "ct", "turn", "then"), n)
            rows |= {"kd": n} if spec.tangent else {}
            rows |= {"slip0": n} if spec.smooth else {}
            rows |= dict.fromkeys(("z_sign", "rate_sign"), n) if spec.smooth and spec.series else {}
            rows |= {"flow": n, "rest": n} if spec.smooth and spec.implicit else {}
            rows |= {"fall": n, "collapsed": 1} if spec.falling else {}
            rows |= {"set": n}
        if self.touching:
            # mode, the next one and when it comes (in sub-steps); stiffness and damping in this mode, and of the law
            # (kN/m, kN s/m); rate of approach (m/s); time since the touch, and of an elastic contact (s)
            rows |= dict.fromkeys(("mode", "next", "event", "k_active", "c_active", "k_law", "c_law"), nc)
            rows |= dict.fromkeys(("fastest", "age", "duration"), nc)
            # penetration (m), its rate (m/s), the force (kN) and its rate at both ends of a sub-step; that of an
            # implicit step, and whether an event may be in it
            rows |= dict.fromkeys(("pen_start", "pen_end", "rate_start", "rate_end"), nc)
            rows |= dict.fromkeys(("force_start", "force_end", "force_rate_start", "force_rate_end"), nc)
            rows |= dict.fromkeys(("force", "may_change"), nc)
            if "transfer" in self.requested:  # energy given so far, in the step, and powers
                rows |= dict.fromkeys(("now", "gain", "power", "power_start", "power_end"), nb)
        # what depends on the law comes last: flight, which does not, finds its rows at one place under all laws
        if spec.implicit or spec.impulsive:
            rows |= {"a": n, "alone": n}
        rows |= {"joining": nc} if spec.impulsive else {}
        if any(law.yields for law in spec.laws):
            rows |= {"plastic": nc, "yield_depth": nc}
        #: What no step leaves to the next follows, from this row on.
        self.n_persistent_rows = sum(rows.values())
        rows |= dict.fromkeys(BENDS, n) if spec.staged else {}
        rows |= {"peak": n, "acc_inside": n, "press": nc} if self.presses and "acceleration" in self.requested else {}
        if spec.series:
            order, laws = spec.series, spec.laws
            rows |= {"taylor_u": n * (order + 1), "taylor_pen": nc * (order + 1), "event_poly": order + 1}
            rows |= {"taylor_force": nc * order} if any(law.damper for law in laws) else {}
            rows |= {"taylor_pen_rate": nc * order} if any(law.damper_exponent == 1.0 for law in laws) else {}
            rows |= dict.fromkeys(("x", "y", "push"), n)
            if spec.smooth:  # plastic drifts, rates of drifts, powers of z; what flows over its product with the rate
                rows |= {"taylor_slip": n * (order + 1), "taylor_rate": n * order}
                rows |= {f"taylor_z{k}": n * order for k in range(1, 1 + int(max(m for _, m in spec.smooth)))}
                rows |= {"flow": n, "event_row": 1, "event_sign": 1}
            rows |= dict.fromkeys(("span", "event_number", "event_target", "low", "high", "bends"), 1)
            rows |= {"ruled_out": 2 * (nc + n)}
            rows |= {"swing": nb} if "transfer" in self.requested and self.touching else {}
        return rows

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

    def has_separate_damper(self, i: Any) -> bool:
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

    def full(self, x: Any) -> Any:
        """Return a number or a truth in all lanes."""
        return everywhere(self.trace, x, self.lanes)

    def cell(self, x: Any) -> Cell:
        """Return a variable with a number or a truth in all lanes."""
        return Cell(self.full(x))

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
    def looped(self) -> bool:
        """Whether the row has too many floors for one straight line of code: it goes through them at run time."""
        return self.trace is not None and not self.spec.fused

    def _in_runs(self, items: Sequence[tuple[int, ...]], key: Callable[[int], Any]) -> Iterator[tuple[Any, Any, Any]]:
        """Go through rows of whole numbers: what those in a run have in common, number, row; of several at run time."""
        table = Lookup([x for item in items for x in item])
        for kind, run in groupby(range(len(items)), key):
            first, *others = run
            if not others:
                yield kind, first, items[first]
                continue
            for q in count_to(1 + len(others)):
                number, width = q + first, len(items[first])
                yield kind, number, [table[width * number + k] for k in range(width)]

    def static_contacts(self, touching: bool = True) -> list[Contact]:
        """Return all contacts, whose numbers are known."""
        contacts = enumerate(self.contacts if touching else self.spec.contacts)
        return [Contact(self, j, sides, *self._kind(j)) for j, sides in contacts]

    def _kind(self, j: int) -> tuple[int, bool, int]:
        """Side of contact j whose columns are struck (-1: floors meet), whether they stand on the ground, its law."""
        spec = self.spec
        side = spec.struck[j] if spec.struck else -1
        grounded = side >= 0 and spec.bottom[spec.contacts[j][side]]
        return side, grounded, spec.bumped[j] if spec.bumped else 0

    def iter_contacts(self, straight: bool = False, touching: bool = True) -> Iterator[Contact]:
        """Go through the contacts, at run time (in a short row, if not `straight`); not `touching`: closings too."""
        contacts = self.contacts if touching else self.spec.contacts
        if self.trace is None or (straight and not self.looped):
            yield from self.static_contacts(touching)
            return

        def kind_of(j: int) -> tuple[tuple[bool, ...], tuple[int, bool, int]]:
            return tuple(i < 0 for i in contacts[j][:2]), self._kind(j)

        for (walls, kind), j, (*sides, gap) in self._in_runs(contacts, kind_of):
            left, right = (-1 if wall else side for wall, side in zip(walls, sides, strict=True))
            yield Contact(self, j, (left, right, gap), *kind)

    def iter_links(self) -> Iterator[tuple[Any, tuple[Any, Any]]]:
        """Go through the links and the floors that they join; in a long row at run time."""
        if not (self.looped and self.spec.links):
            yield from enumerate(self.spec.links)
            return
        for _, j, (left, right) in self._in_runs(self.spec.links, lambda _: 0):
            yield j, (left, right)

    def iter_buildings(self) -> Iterator[tuple[Any, list[Any]]]:
        """Go through the buildings and their floors; those of a long row that are equally high at run time."""
        if not self.looped:
            yield from enumerate(self.building_floors)
            return
        spec = self.spec
        order = sorted(range(spec.n_buildings), key=lambda b: spec.storeys[b])
        homes = [(b, spec.home(b)) for b in order]
        for n, _, (b, home) in self._in_runs(homes, lambda k: spec.storeys[order[k]]):
            yield b, [home + s for s in range(n)]

    def iter_storeys(self, those: Sequence[int], straight: bool = True) -> Iterator[Storey]:
        """Go through some storeys, in a short row at run time if not `straight`."""
        if not self.looped and (straight or self.trace is None or self.spec.foundations):
            yield from (self.storey(i) for i in those)
            return
        bottom = self.spec.bottom
        floors = sorted(those, key=lambda i: not bottom[i])
        for grounded, _, (i,) in self._in_runs([(i,) for i in floors], lambda k: bottom[floors[k]]):
            yield Storey(self, i, None if grounded else i - 1)

    def storey(self, i: int) -> Storey:
        """Return a storey whose number is known."""
        return Storey(self, i, self.spec.below(i))

    def iter_parts(self, as_row: bool = False) -> Iterator[tuple[list[tuple[Any, list[Any]]], list[Any]]]:
        """Go through what is worked out at once, and its degrees of freedom: buildings, or the whole row (`as_row`)."""
        if as_row or self.spec.foundations:
            yield list(enumerate(self.building_floors)), list(range(self.spec.n_moving))
            return
        for b, floors in self.iter_buildings():
            yield [(b, floors)], floors

    def deformation(self, i: Any, x: Any, p: Any) -> Any:
        """Motion relative to the base of floor i, whose value is number p of `x`."""
        base = self.spec.base_of(i)
        return x[p] if base is None else x[p] - x[base[0]] - self.prop("elevation", i) * x[base[1]]

    def rocks(self, i: Any) -> bool:
        """Whether a degree of freedom is a rotation, which the ground does not accelerate."""
        return bool(self.spec.foundations) and i >= self.spec.n_dof and (i - self.spec.n_dof) % 2 == 1

    def indices(self, n: Any, straight: bool = True) -> Iterator[Any]:
        """Count to n, at run time in a long row."""
        if self.looped or not straight or isinstance(n, Count):
            yield from count_to(n)
        else:
            yield from range(n)

    def home_of(self, floor: Any) -> tuple[Any, Any, Any]:
        """Lowest floor, number of storeys, and number of the building of a floor."""
        spec, at = self.spec, 3 * floor
        table = Lookup([x for b in spec.building_of for x in (spec.home(b), spec.storeys[b], b)])
        return table[at], spec.storeys[0] if len(set(spec.storeys)) == 1 else table[at + 1], table[at + 2]


class Indexed:
    """A contact or a storey of a loop: its rows of the state, and properties of the scene, are its attributes."""

    def __init__(self, group: Group, index: Any) -> None:
        self.__dict__.update(group=group, index=index)

    def __getattr__(self, name: str) -> Any:
        state = self.group.state
        return state[name, self.index] if name in state.first else self.group.prop(name, self.index)

    def __setattr__(self, name: str, x: Any) -> None:
        self.group.state[name, self.index] = x

    def put(self, lanes: Any, **rows: Any) -> None:
        """Write rows in some lanes (None: all)."""
        for name, x in rows.items():
            self.group.state.put(lanes, x, name, self.index)


class Contact(Indexed):
    """A contact that is known beforehand, or at run time."""

    # sides: left floor, right floor (-1: a wall), gap
    # struck: the side whose columns are struck, -1 where floors meet; whether they stand on the ground

    def __init__(
        self, group: Group, index: Any, sides: Sequence[Any], struck: int, grounded: bool, law_index: int
    ) -> None:
        super().__init__(group, index)
        self.__dict__.update(sides=sides, struck=struck, grounded=grounded, law_index=law_index)

    @property
    def law(self) -> LaneLaw:
        """Its law."""
        return self.group.laws[self.law_index]

    @property
    def stiffness(self) -> Any:
        """Stiffness (kN/m**exponent)."""
        return self.group.state["k", self.index] if self.group.spec.stiffness_per_contact else self.group.state["k"]

    @property
    def gap(self) -> Any:
        """Gap (m)."""
        return self.group.state["gap", self.sides[2]]

    def floors_of(self, side: int) -> list[tuple[Any, Any]]:
        """Floors that it acts on at its left (0) or right (1) side, and the share of each (None: all)."""
        floor = self.sides[side]
        if is_wall(floor):
            return []
        if side != self.struck:
            return [(floor, None)]
        return [(floor, self.upper)] if self.grounded else [(floor - 1, self.lower), (floor, self.upper)]

    def ends(self) -> list[tuple[Any, str, Any]]:
        """Floors that it pushes: the floor, the sign of the force on it, and its share (None: all)."""
        return [(floor, sign, share) for side, sign in enumerate("-+") for floor, share in self.floors_of(side)]

    def between(self, x: Any) -> Any:
        """Left minus right of its floors, a wall being at rest; x: of all floors, or a row's name."""
        sums: list[Any] = []
        for side in (0, 1):
            parts = [part_of(self.group.floor(x, i), share) for i, share in self.floors_of(side)]
            sums.append(parts[0] + parts[1] if len(parts) > 1 else parts[0] if parts else None)
        left, right = sums
        if left is None:
            return -right
        return left if right is None else left - right

    def penetration(self, name: str = "u") -> Any:
        """Penetration (m)."""
        return self.between(name) - self.gap


class Storey(Indexed):
    """The storey below a floor, which is its index; `below` is the floor at its foot (None: the ground)."""

    def __init__(self, group: Group, index: Any, below: Any) -> None:
        super().__init__(group, index)
        self.__dict__["below"] = below

    @property
    def stiffness(self) -> Any:
        """Elastic stiffness (kN/m)."""
        return self.group.prop("k", self.index)

    @property
    def exponent(self) -> float:
        """Exponent of the law of Bouc and Wen."""
        return dict(self.group.spec.smooth)[self.index]

    @property
    def hardened(self) -> tuple[Any, Any]:
        """Stiffness while it yields, and what that is less than the elastic one."""
        return self.hardening * self.stiffness, (1.0 - self.hardening) * self.stiffness

    def drift(self, x: Any = "u", rounding: bool = False) -> Any:
        """Drift (m), of a row's name or of values floor by floor; or the sum of sizes by which it is rounded."""
        group, base = self.group, self.group.spec.base_of(self.index)
        parts = [group.floor(x, i) for i in (self.index, self.below) if i is not None]
        parts += [] if base is None else [self.height * group.floor(x, base[1])]
        return reduce(add, map(size, parts)) if rounding else reduce(sub, parts)


def part_of(force: Any, share: Any) -> Any:
    """Return the share of a force (None: all of it)."""
    return force if share is None else share * force


def is_wall(floor: Any) -> bool:
    """Whether a side of a contact is a wall."""
    return not isinstance(floor, Count) and floor < 0
