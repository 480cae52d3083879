"""A group of lanes: its state, the scene's constants, the law, and what is asked of it."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import groupby
from operator import add, or_
from types import SimpleNamespace
from typing import Any, NamedTuple

from llvmlite import ir

from pounding_sweep import lanes as lane_code
from pounding_sweep.kernel.spec import TOLERANCES, Code, KernelSpec, LawShape, input_slots, property_slots, result_slots
from pounding_sweep.kernel.types import ByFloor, End, Index, Instant, Lanes, Truths
from pounding_sweep.lanes import Cell, Lookup, Rows, count_to, fma, maximum, roughly_power, sqrt, where
from pounding_sweep.model.formula import read, value
from pounding_sweep.model.laws import RESTING_SPEED, duration_of
from pounding_sweep.model.storeys import Elastic, law_of

#: Rows of the ground's acceleration at both ends of a sub-step, and of the step that events cut into these.
ENDS, ENDS_OF_STEP = ("ground0", "ground"), ("step_ground0", "step_ground")
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


#: Functions in the formulas of laws.
_FUNCTIONS: dict[str, Callable[..., Any]] = {"max": maximum, "sqrt": sqrt, "pow": lane_code.power_of}


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
        self._duration = duration_of(shape.exponent)

    def _evaluate(self, text: str, d: Lanes, **variables: Lanes) -> Lanes:
        formula = read(text)
        if any(isinstance(part, ast.Name) and part.id == "r" for part in ast.walk(formula)):
            variables["r"] = sqrt(maximum(d, 0.0))
        return value(formula, {"d": d, **variables}, _FUNCTIONS)

    def elastic(self, k: Lanes, c: Lanes, d: Lanes) -> Lanes:
        """Elastic force."""
        return self._evaluate(self.shape.elastic, d, k=k, c=c)

    def elastic_slope(self, k: Lanes, d: Lanes) -> Lanes:
        """Its derivative by d."""
        return self._evaluate(self.shape.elastic_slope, d, k=k)

    def damper(self, c: Lanes, d: Lanes) -> Lanes:
        """Force by rate; 0.0 where the law has none."""
        return self._evaluate(self.shape.damper, d, c=c) if self.shape.damper else 0.0

    def pressing(self, k: Lanes, c: Lanes, d: Lanes, v: Lanes) -> Lanes:
        """Force before any cut."""
        force = self.elastic(k, c, d)
        return force + self.damper(c, d) * v if self.shape.damper else force

    def pressing_rate(self, k: Lanes, c: Lanes, d: Lanes, v: Lanes, a: Lanes) -> Lanes:
        """Its derivative by time."""
        slope = self.elastic_slope(k, d)
        if not self.shape.damper:
            return slope * v
        return (slope + self._evaluate(self.shape.damper_slope or "0.0", d, c=c) * v) * v + self.damper(c, d) * a

    def closed_force(self, k: Lanes, c: Lanes, d: Lanes, v: Lanes) -> Lanes:
        """Force of a closed contact, cut at zero where the law cannot pull."""
        force = self.elastic(k, c, d)
        if self.shape.damper:
            felt = maximum(v, 0.0) if self.shape.approach_only else v
            force = force + self.damper(c, d) * (lane_code.minimum(v, 0.0) if self.shape.rebound_only else felt)
        return force if self.shape.tension else where(d > 0.0, maximum(force, 0.0), 0.0)

    def memoryless(self, k: Lanes, c: Lanes, fastest: Lanes, d: Lanes, v: Lanes) -> Lanes:
        """Force where nothing but the present state decides it; `fastest` is the rate of approach so far."""
        if self.shape.per_speed:
            c = c / maximum(maximum(fastest, v), RESTING_SPEED)
        return where(d > 0.0, self.closed_force(k, c, d, v), 0.0)

    def duration(self, k: Lanes, v: Lanes, mass: Lanes) -> Lanes:
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
        trace: lane_code.Tracer | None,
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
        self.number: Callable[[], Index] = lambda: 0
        self._places, self._inputs = property_slots(spec), input_slots(spec)
        # rows that steps leave to the next under all laws, those of this law, and those that no step leaves, in this
        # order: flight, which is one of all laws, finds its rows at one place
        self._rows: list[dict[str, int]] = [self._inputs.count | result_slots(spec, reducers).count, {}, {}]
        self.declare(spec.n_moving, "u", "v", "u0", "v0")
        self.declare(1, "h", *ENDS)
        scheme.declare_rows(self)
        #: How many rows steps leave to the next.
        self.n_persistent_rows = sum((self._rows[0] | self._rows[1]).values())
        self.state = Rows(trace, reduce(or_, self._rows), lanes, memory)
        self._scene, self.ground = lane_code.Table(trace, constants, lanes), GroundMotion(self.state)

    def declare(self, count: int, *names: str, of_law: bool = False, passing: bool = False) -> None:
        """Let there be rows of state, so many of each name: an owner declares what it needs."""
        self._rows[2 if passing else of_law] |= dict.fromkeys(names, count)

    @property
    def presses(self) -> bool:
        """Whether forces of contacts, and accelerations beside them, follow from the motion between a step's ends."""
        spec = self.spec
        return spec.located and self.touching and not (spec.implicit or spec.impulsive or spec.series)

    def looks(self, what: str) -> bool:
        """Whether a reducer asks `what` (out of `LOOKS`) of each sub-step of a closed contact."""
        return any(LOOKS.index(reducer.looks) >= LOOKS.index(what) for reducer in self.reducers)

    def change(self, i: Index, kind: int) -> Index:
        """Return the number of a kind of change, of a contact or of a storey, these counted after contacts."""
        return i + kind * (len(self.contacts) + len(self.spec.hysteretic))

    # what the scene gives ------------------------------------------------------------------------------------------

    def yields(self, i: Index) -> bool:
        """Whether the storey below floor i may yield; floors known at run time only have rows as those that may."""
        return bool(self.spec.yielding) and (not isinstance(i, int) or i in self.spec.yielding)

    def dashed(self, i: Index) -> bool:
        """Whether the storey below floor i has a dashpot; of floors known at run time, whether any has."""
        return bool(self.spec.dashpots) and (not isinstance(i, int) or i in self.spec.dashpots)

    def prop(self, name: str, i: int = 0) -> Lanes:
        """Return a constant of the scene: of a floor, building or contact; per lane where buildings vary."""
        if f"p_{name}" in self._inputs.count:
            return self.state[f"p_{name}", i]
        return self._scene.number(self._places.first[name] + i, fixed=True)

    def clock(self, h: Lanes) -> Lanes:
        """Time (s) since the start of the motion, of lanes that are within a step of length h."""
        rest = self.state["time_left"]
        number = self.number()
        if self.trace is None:
            return number * h + (h - rest)
        t, b = self.trace, self.trace.builder
        double = ir.DoubleType()
        many = isinstance(number, lane_code.Counts)
        kind = ir.VectorType(double, t.lanes)
        steps = b.sitofp(number.value, kind if many else double)
        steps = steps if many else t.spread(steps)
        wide = (lambda x: x) if t.size == 8 else (lambda x: b.fpext(x, kind))
        time = b.fadd(b.fmul(steps, wide(self.full(h).value)), wide((h - rest).value))
        return lane_code.Vector(t, time if t.size == 8 else b.fptrunc(time, t.vector))

    def full(self, x: Lanes) -> Lanes:
        """Return a number or a truth in all lanes."""
        return lane_code.everywhere(self.trace, x, self.lanes)

    def cell(self, x: Lanes) -> Cell:
        """Return a variable with a number or a truth in all lanes."""
        return Cell(self.full(x))

    def floor(self, x: ByFloor, i: Index) -> Lanes:
        """Return floor i's of all floors' values, of the rows of a name, or of a function."""
        if isinstance(x, str):
            return self.state[x, i]
        return x(i) if callable(x) else x[i]

    def floors(self, name: str) -> list[Lanes]:
        """Return a row of each floor, and of foundations."""
        return [self.state[name, i] for i in range(self.spec.n_moving)]

    @property
    def looped(self) -> bool:
        """Whether the row has too many floors for one straight line of code: it goes through them at run time."""
        return self.trace is not None and not self.spec.fused

    @property
    def skips(self) -> bool:
        """Whether steps by series leave out contacts that are open throughout, in all lanes."""
        return self.looped and not self.spec.yielding

    def _in_runs(self, items: Sequence[tuple[int, ...]], key: Callable[[int], Any]) -> Iterator[tuple[Any, Index, Any]]:
        """Go through rows of whole numbers: what those in a run have in common, number, row; of several at run time."""
        for kind, run in groupby(range(len(items)), key):
            first, *others = run
            if not others:
                yield kind, first, items[first]
                continue
            width, table = len(items[first]), Lookup([x for k in (first, *others) for x in items[k]])
            for q in count_to(1 + len(others)):
                yield kind, q + first, [table[width * q + k] for k in range(width)]

    def _ends(self, dofs: Iterable[Index], kinds: Sequence[tuple[int, str]], number: Index) -> list[End]:
        """Return the ends of element `number`: degrees of freedom, or their places, by signs and names of shares."""
        return [
            (i, sign, self.prop(share, number) if share else None) for i, (sign, share) in zip(dofs, kinds, strict=True)
        ]

    def iter_contacts(self, straight: bool = False, touching: bool = True, static: bool = False) -> Iterator[Contact]:
        """Go through contacts, at run time unless `static`, or `straight` in a short row; not `touching`: closings."""
        spec, contacts = self.spec, self.contacts if touching else self.spec.contacts
        static = static or self.trace is None or (straight and not self.looped)
        shapes = [spec.contact_ends(j) for j in range(len(contacts))]
        rows = [(gap, *dofs) for (*_, gap), (dofs, _) in zip(contacts, shapes, strict=True)]
        runs = self._in_runs(rows, lambda j: (shapes[j][1], spec.bumped[j] if spec.bumped else 0, j if static else 0))
        for (kinds, law, _), j, (gap, *dofs) in runs:
            yield Contact(self, j, self._ends(dofs, kinds, j), gap_index=gap, law_index=law)

    def iter_links(self, straight: bool = False) -> Iterator[Spring]:
        """Go through the links; in a long row at run time, if not `straight`."""
        links = self.spec.links
        at_run_time = self.looped and not straight
        for _, j, dofs in self._in_runs(links, lambda j: None if at_run_time else j):
            k, c = self.prop("link_k", j), self.prop("link_c", j)
            yield Spring(self, j, self._ends(dofs, ((1, ""), (-1, "")), j), stiffness=k, damping=c)

    def iter_buildings(self) -> Iterator[tuple[Index, list[Index]]]:
        """Go through the buildings and their floors; those of a long row that are equally high at run time."""
        if not self.looped:
            yield from enumerate(self.spec.floors)
            return
        spec = self.spec
        order = sorted(range(spec.n_buildings), key=lambda b: spec.storeys[b])
        homes = [(b, spec.floors[b][0]) for b in order]
        for n, _, (b, home) in self._in_runs(homes, lambda k: spec.storeys[order[k]]):
            yield b, [home + s for s in range(n)]

    def iter_storeys(self, those: Sequence[int], straight: bool = True) -> Iterator[Storey]:
        """Go through some storeys, in a short row at run time if not `straight`."""
        if not self.looped and (straight or self.trace is None or self.spec.foundations):
            yield from (self.storey(i) for i in those)
            return
        bottom = self.spec.bottom
        shapes = [self.spec.storey_ends(i) for i in sorted(those, key=lambda i: not bottom[i])]
        for kinds, _, dofs in self._in_runs([dofs for dofs, _ in shapes], lambda k: shapes[k][1]):
            yield Storey(self, dofs[0], self._ends(dofs, kinds, dofs[0]))

    def iter_springs(self, straight: bool = True) -> Iterator[StoreySpring]:
        """Go through the springs that follow storey laws, in a short row at run time if not `straight`."""
        straight = straight or bool(self.spec.flowing) or self.spec.shares_storeys
        for code, numbers in self.spec.springs_by_code.items():
            for storey in self.iter_storeys(list(numbers), straight):
                yield StoreySpring(storey, code)

    def storey(self, i: int) -> Storey:
        """Return a storey whose number is known."""
        return Storey(self, i, self._ends(*self.spec.storey_ends(i), i))

    def part(self, *buildings: tuple[Index, list[Index]]) -> Part:
        """Return what is worked out at once: some buildings, each with its floors."""
        spec, dofs, places = self.spec, list[Index](), dict[int, int]()
        models = [b if isinstance(b, int) else spec.storeys.index(len(floors)) for b, floors in buildings]
        for like, (_, floors) in zip(models, buildings, strict=True):
            places |= {i: len(dofs) + s for s, i in enumerate(spec.floors[like])}
            dofs += floors
        for like in models:
            places |= {i: len(dofs) + k for k, i in enumerate(spec.base(like) or ())}
            dofs += spec.base(like) or ()
        blocks = []
        for like, (b, floors) in zip(models, buildings, strict=True):
            numbers = [places[i] for i in (*spec.floors[like], *(spec.base(like) or ()))]
            blocks.append(Block(b, numbers, len(numbers) == len(floors), self._elements(like, b, floors, places)))
        return Part(dofs, blocks)

    def iter_parts(self, as_row: bool = False) -> Iterator[Part]:
        """Go through what is worked out at once: buildings, or the whole row (`as_row`)."""
        if as_row or self.spec.foundations:
            yield self.part(*enumerate(self.spec.floors))
            return
        for building in self.iter_buildings():
            yield self.part(building)

    def _elements(self, like: int, b: Index, floors: list[Index], places: Mapping[int, int]) -> list[Spring | Matrices]:
        """Elements of a building, which is like one that is known, their ends by the places of that one's."""
        spec, base = self.spec, self.spec.base(like) or ()

        pairs = list(zip(spec.floors[like], floors, strict=True))
        storeys = [(i, *spec.storey_ends(k)) for k, i in pairs]
        elements: list[Spring | Matrices] = []
        for i, dofs, kinds in storeys:
            ends = self._ends([places[k] for k in dofs], kinds, i)
            if "k" not in spec.letters(like):
                elements.append(Storey(self, i, ends, building=b))
            elif self.dashed(i):
                elements.append(Spring(self, i, ends, stiffness=None, damping=self.prop("dashpot", i)))
        if spec.letters(like):
            elements.append(Matrices(self, b, [places[k] for k in spec.dofs(like)]))
        for k, i in pairs if base else ():  # what its a m of Rayleigh's resists is the motion relative to the base
            ends = self._ends([places[k], *(places[q] for q in base)], ((1, ""), (-1, ""), (-1, "elevation")), i)
            drag = self.prop("m", i) * self.prop("alpha", b)
            elements.append(Spring(self, i, ends, stiffness=None, damping=drag))
        for i in base:
            k, c = self.prop("k", i), self.prop("dashpot", i)
            elements.append(Spring(self, i, [(places[i], 1, None)], stiffness=k, damping=c))
        return elements

    def rocks(self, i: Index) -> bool:
        """Whether a degree of freedom is a rotation, which the ground does not accelerate."""
        return bool(self.spec.foundations) and i >= self.spec.n_dof and (i - self.spec.n_dof) % 2 == 1

    def indices(self, n: Index, straight: bool = True) -> Iterator[Index]:
        """Count to n, at run time in a long row."""
        if self.looped or not straight or isinstance(n, lane_code.Count):
            yield from count_to(n)
        else:
            yield from range(n)

    def home_of(self, floor: Index) -> tuple[Index, Index, Index]:
        """Lowest floor, number of storeys, and number of the building of a floor."""
        spec, at = self.spec, 3 * floor
        table = Lookup([x for b in spec.building_of for x in (spec.floors[b][0], spec.storeys[b], b)])
        return table[at], spec.storeys[0] if len(set(spec.storeys)) == 1 else table[at + 1], table[at + 2]


@dataclass(frozen=True)
class GroundMotion:
    """Acceleration of the ground, linear in each sub-step; one motion below all buildings."""

    state: Rows

    def go(self, start: Lanes, end: Lanes, lanes: Truths = None, rows: tuple[str, str] = ENDS) -> None:
        """Go through a sub-step, or through that of other `rows`, between two accelerations, in some lanes."""
        for name, x in zip(rows, (start, end), strict=True):
            self.state.put(lanes, x, name)

    def rise(self, b: Index) -> Lanes:
        """Acceleration below building b at the end of the sub-step, less that at its start."""
        return self.at(1.0)(b) - self.at(0.0)(b)

    def at(self, t: Lanes) -> Instant:
        """Return the accelerations at a part t of the sub-step: a number, or one in each lane."""
        start, end = (self.state[name] for name in ENDS)
        ends = {0.0: start, 0.5: 0.5 * (start + end), 1.0: end}
        x = ends[t] if isinstance(t, float) and t in ends else fma(t, end - start, start)
        return lambda b: x


class Block(NamedTuple):
    """A building of what is worked out at once."""

    b: Index  # its number
    places: list[int]  # of its floors, then of its foundation's sway and rocking
    on_ground: bool  # it has no foundation: a m of Rayleigh's resists the motion relative to the ground
    elements: list[Spring | Matrices]  # whose ends are places


class Part(NamedTuple):
    """What is worked out at once."""

    dofs: list[Index]  # degree of freedom at each place
    blocks: list[Block]


def signed_sum(terms: Sequence[tuple[int, Lanes]]) -> Lanes:
    """Sum of some terms, each after its sign (1 or -1)."""
    (sign, total), *rest = sorted(terms[:2], key=lambda term: -term[0]) + list(terms[2:])
    total = total if sign > 0 else -total
    for sign, x in rest:
        total = total + x if sign > 0 else total - x
    return total


class _InRows:
    """What has rows of the state, and properties of the scene, as attributes; its index may be one of a loop."""

    group: Group
    index: Index

    def _place(self, name: str) -> Index:
        return self.index

    def __getattr__(self, name: str) -> Any:
        group, place = self.group, self._place(name)
        return group.state[name, place] if name in group.state.first else group.prop(name, place)

    def __setattr__(self, name: str, x: Lanes) -> None:
        self.group.state[name, self._place(name)] = x

    def put(self, lanes: Truths, **rows: Lanes) -> None:
        """Write rows in some lanes (None: all)."""
        for name, x in rows.items():
            self.group.state.put(lanes, x, name, self._place(name))


class Element(_InRows):
    """What resists a stretch, the sum of its ends' displacements by signs and shares."""

    # numbers: what else is known of it

    def __init__(self, group: Group, index: Index, ends: Sequence[End], **numbers: Any) -> None:
        self.__dict__.update(group=group, index=index, ends=ends, **numbers)

    def between(self, x: ByFloor = "u", rounding: bool = False) -> Lanes:
        """Stretch of a row's name, or of values of its ends; or the sum of sizes by which it is rounded."""
        parts = [(sign, part_of(self.group.floor(x, i), share)) for i, sign, share in self.ends]
        return reduce(add, [lane_code.size(part) for _, part in parts]) if rounding else signed_sum(parts)

    def on_ends(self, force: Lanes) -> list[tuple[Index, int, Lanes]]:
        """Return what a force that resists the stretch does at each end: the sign, to the right, and how much of it."""
        return [(i, -sign, part_of(force, share)) for i, sign, share in self.ends]


class Spring(Element):
    """A linear spring and a dashpot, of a `stiffness` and a `damping`; without stiffness (None) the dashpot alone."""

    @property
    def is_plain(self) -> bool:
        """Whether its force is a share of the stretch of x + beta y."""
        return False

    def pushes(self, x: ByFloor, y: ByFloor, w: ByFloor, constant: bool) -> Iterator[tuple[Index, int, Lanes]]:
        """Go through what it does to each end, by displacements x, velocities y, and w = x + beta y."""
        yield from self.on_ends(self.force(x, y, w, constant))

    def entries(self, be: Lanes, ga: Lanes) -> Iterator[tuple[Index, Index, int, Lanes]]:
        """Go through what it adds to M + ga C + be K: both ends, the sign and the entry."""
        resistance = self.resistance(be, ga)
        for n, (p, sign, share) in enumerate(self.ends):
            for q, other, part_of_it in self.ends[n:]:
                yield p, q, sign * other, part_of(part_of(resistance, share), part_of_it)

    def force(self, x: ByFloor, y: ByFloor, *_: Any) -> Lanes:
        """Force at displacements x and velocities y."""
        if self.stiffness is None:
            return self.damping * self.between(y)
        return fma(self.damping, self.between(y), self.stiffness * self.between(x))

    def resistance(self, be: Lanes, ga: Lanes) -> Lanes:
        """Stiffness against an acceleration at the end of a Newmark step: stiffness by `be`, damping by `ga`."""
        return ga * self.damping if self.stiffness is None else fma(ga, self.damping, be * self.stiffness)

    def lost(self, y: ByFloor) -> Lanes:
        """Power (kW) that its damping takes."""
        rate = self.between(y)
        return self.damping * (rate * rate)

    def stored(self, x: ByFloor, about_rest: bool = False) -> Lanes:
        """Energy (kJ) that its spring holds."""
        stretch = self.between(x)
        return 0.0 if self.stiffness is None else 0.5 * self.stiffness * stretch * stretch


class Matrices:
    """Matrices K and C of a building's degrees of freedom: its floors and foundation."""

    # places: of these; storeys: whether K is that of storeys, so that only C is dense

    def __init__(self, group: Group, b: int, places: Sequence[Index]) -> None:
        spec = group.spec
        self._group, self._b, self._places, letters = group, b, places, spec.letters(b)
        self.is_plain, self._has_damping = "k" in letters, letters not in ("", "k")
        self._first = {"dense_k": sum(spec.dense_sizes("k")[:b]), "dense_c": sum(spec.dense_sizes("mc")[:b])}

    def _entry(self, name: str, i: int, j: int) -> Lanes:
        low, high = sorted((i, j))
        return self._group.prop(name, self._first[name] + high * (high + 1) // 2 + low)

    def against(self, i: int) -> Lanes:
        """Stiffness against the displacement of the building's degree of freedom number i alone."""
        return self._entry("dense_k", i, i)

    def _times(self, name: str, x: ByFloor) -> list[Lanes]:
        """Product of a matrix and values by place."""
        values = [x[p] for p in self._places]
        rows = [[(self._entry(name, i, j), v) for j, v in enumerate(values)] for i in range(len(values))]
        return [reduce(lambda total, term: fma(*term, total), rest, first[0] * first[1]) for first, *rest in rows]

    def pushes(self, x: ByFloor, y: ByFloor, w: ByFloor, constant: bool) -> Iterator[tuple[Index, int, Lanes]]:
        """Go through what it does at each place, as that of a `Spring`."""
        for name, values, exists in (("dense_k", w, self.is_plain), ("dense_c", y, self._has_damping)):
            for p, force in zip(self._places, self._times(name, values) if exists else (), strict=False):
                yield p, -1, force

    def entries(self, be: Lanes, ga: Lanes) -> Iterator[tuple[Index, Index, int, Lanes]]:
        """Go through what it adds to M + ga C + be K, as that of a `Spring`."""
        beta = self._group.prop("beta", self._b)
        for name, factor, exists in (("dense_k", fma(ga, beta, be), self.is_plain), ("dense_c", ga, self._has_damping)):
            for n, p in enumerate(self._places) if exists else ():
                for k, q in enumerate(self._places[n:], n):
                    yield p, q, 1, factor * self._entry(name, n, k)

    def lost(self, y: ByFloor) -> Lanes:
        """Power (kW) that its damping takes."""
        terms = [self._quadratic("dense_c", y)] if self._has_damping else []
        if self.is_plain:
            terms.append(self._group.prop("beta", self._b) * self._quadratic("dense_k", y))
        return reduce(add, terms)

    def stored(self, x: ByFloor, about_rest: bool = False) -> Lanes:
        """Energy (kJ) that it holds."""
        return 0.5 * self._quadratic("dense_k", x) if self.is_plain else 0.0

    def _quadratic(self, name: str, x: ByFloor) -> Lanes:
        pairs = zip(self._places, self._times(name, x), strict=True)
        return reduce(add, [x[p] * force for p, force in pairs])


class Contact(Element):
    """A contact that is known beforehand, or at run time; a wall is at rest."""

    # gap_index, law_index: which gap and which of the kernel's laws are its own

    @property
    def law(self) -> LaneLaw:
        """Its law."""
        return self.group.laws[self.law_index]

    @property
    def stiffness(self) -> Lanes:
        """Stiffness (kN/m**exponent)."""
        return self.group.state["k", self.index] if self.group.spec.stiffness_per_contact else self.group.state["k"]

    @property
    def gap(self) -> Lanes:
        """Gap (m)."""
        return self.group.state["gap", self.gap_index]

    @property
    def sides(self) -> list[Index]:
        """Floors that meet, the left one first, of struck columns the floor above; of a wall None."""
        floors = {sign: i for i, sign, _ in self.ends}
        return [floors.get(1), floors.get(-1)]

    def penetration(self, name: str = "u") -> Lanes:
        """Penetration (m)."""
        return self.between(name) - self.gap


class Storey(Spring):
    """The storey below a floor, which is its index."""

    # building: its number, where forces are asked for
    drift = Element.between

    @property
    def stiffness(self) -> Lanes:
        """Elastic stiffness (kN/m)."""
        return self.group.prop("k", self.index)

    @property
    def damping(self) -> Lanes:
        """Its damper: beta k of Rayleigh's, of the stiffness that this follows, and a dashpot (kN s/m)."""
        group, i = self.group, self.index
        k = group.state["kd", i] if group.spec.tangent and group.yields(i) else self.stiffness
        damping = group.prop("beta", self.building) * k
        return damping + group.prop("dashpot", i) if group.dashed(i) else damping

    @property
    def rest_drift(self) -> Lanes:
        """Its drift without shear, while it is elastic."""
        return -self.ct / self.stiffness

    @property
    def is_plain(self) -> bool:
        """Whether it is elastic, and its damper a share of its stiffness: its force is k (x + beta y)."""
        return not (self.group.yields(self.index) or self.group.dashed(self.index))

    def force(self, x: ByFloor, y: ByFloor, w: ByFloor, constant: bool) -> Lanes:
        """Force at displacements x, velocities y, and w = x + beta y; of rates without its `constant`."""
        group, i = self.group, self.index
        if self.is_plain:
            return self.stiffness * self.between(w)
        drift, rate = self.between(x), self.between(y)
        if not group.yields(i):
            elastic = self.stiffness * drift
        elif constant or (group.spec.series and i in group.spec.flowing):
            elastic = fma(self.kt, drift, self.ct)
        else:
            elastic = self.kt * drift
        return fma(self.damping, rate, elastic)

    def resistance(self, be: Lanes, ga: Lanes) -> Lanes:
        """Stiffness against an acceleration at the end of a Newmark step, its damper included."""
        if self.is_plain:
            return fma(ga, self.group.prop("beta", self.building), be) * self.stiffness
        k = self.kt if self.group.yields(self.index) else self.stiffness
        return fma(ga, self.damping, be * k)

    def stored(self, x: ByFloor, about_rest: bool = False) -> Lanes:
        """Elastic energy (kJ), of a storey that yields about zero or about the drift at which it rests."""
        drift, i, yields = self.between(x), self.index, self.group.yields(self.index)
        if yields and about_rest:
            drift = drift - self.rest_drift
        elastic = 0.5 * self.stiffness * drift * drift
        if about_rest or not yields:
            return elastic
        if isinstance(i, int):
            return reduce(add, [spring.law.stored(spring, drift) for spring in self.springs()])
        total = elastic  # of a storey that is known at run time
        for code, numbers in self.group.spec.springs_by_code.items():
            has = Lookup([int(floor in numbers) for floor in range(self.group.spec.n_dof)])[i] > 0
            spring = StoreySpring(self, code)
            total = where(has, spring.law.stored(spring, drift), total)
        return total

    def springs(self) -> list[StoreySpring]:
        """Return those of its springs that follow storey laws, its index being known."""
        by_code = self.group.spec.springs_by_code.items()
        return [StoreySpring(self, code) for code, numbers in by_code if self.index in numbers]


class StoreySpring(_InRows, Elastic):
    """An element of a storey that follows a storey law: its rows and constants, and those of the storey."""

    def __init__(self, storey: Storey, code: Code) -> None:
        spec, i = storey.group.spec, storey.index
        name, compiled, _, is_infill = code
        numbers = spec.springs_by_code[code]
        if isinstance(i, int):
            number: Index = numbers[i]
        elif all(e == floor for floor, e in numbers.items()):
            number = i
        else:
            number = Lookup([numbers.get(floor, 0) for floor in range(spec.n_dof)])[i]
        law = law_of(name, compiled)
        self.__dict__.update(storey=storey, number=number, law=law, compiled=compiled, group=storey.group)
        self.__dict__["is_infill"] = is_infill

    def _place(self, name: str) -> Index:
        return self.number if name in self.group.spec.spring_names else self.storey.index

    @property
    def stiffness(self) -> Lanes:
        """Elastic stiffness (kN/m)."""
        k = self.storey.stiffness
        return self.stiffness_share * k if self.group.spec.shares_storeys else k

    def drift(self, x: ByFloor = "u", rounding: bool = False) -> Lanes:
        """Drift (m) of its storey, see `Storey.drift`."""
        return self.storey.drift(x, rounding)

    def ends(self) -> tuple[Lanes, Lanes, Lanes, Lanes]:
        """Drifts and their rates at the start and the end of the sub-step: d0, d1, v0, v1."""
        return self.drift("u0"), self.drift("u"), self.drift("v0"), self.drift("v")

    def term(self, name: str, k: Index) -> Lanes:
        """Coefficient k of a row of coefficients."""
        return self.group.state[name, self.number + k * len(self.group.spec.hysteretic)]

    def put_term(self, name: str, k: Index, x: Lanes) -> None:
        """Write coefficient k of a row of coefficients."""
        self.group.state[name, self.number + k * len(self.group.spec.hysteretic)] = x


def part_of(force: Lanes, share: Lanes) -> Lanes:
    """Return the share of a force (None: all of it)."""
    return force if share is None else share * force
