"""A group of lanes: its state, the scene's constants, the law, and what is asked of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np
from llvmlite import ir

from pounding_sweep.kernel.lanes import Counts, Real, Rows, Tracer, Vector, maximum, power, sqrt, where, where_count
from pounding_sweep.kernel.precision import TOLERANCES
from pounding_sweep.kernel.spec import KernelSpec, LawShape, input_slots, property_slots, result_slots
from pounding_sweep.model.laws import RESTING_SPEED

#: Constants that all lanes share even where buildings vary.
SHARED = frozenset({"u0", "v0", "cap", "newmark_beta", "newmark_gamma"})
#: What a reducer asks of each sub-step of a closed contact, each with those before it: nothing, the penetration at
#: both ends, the force too, or that forces and their rates at both ends are kept for all floors.
LOOKS = ("", "depth", "force", "ends")
#: Share of an elastic contact's duration over which sub-steps grow to a whole step, where they are graded.
GRADED_SHARE = 0.5


class Law:
    """The formulas of a contact law, as functions of lanes.

    Of stiffness `k`, damping `c`, penetration `d` (m) and its rate `v` (m/s): kN.
    """

    def __init__(self, shape: LawShape, order: int, exact: float) -> None:
        self.shape = shape
        self.touch_power, self.release_power = shape.grading(order)
        self.graded = max(self.touch_power, self.release_power) > 1.0
        #: Shares by which graded sub-steps grow after a touch and shrink before a release.
        self.touch_share, self.release_share = (
            1.0 / (q * GRADED_SHARE ** (1.0 - 1.0 / q)) for q in (self.touch_power, self.release_power)
        )
        #: Least root of a graded sub-step, in durations of the contact: its error is that of rounding.
        self.least_share = exact ** (1.0 / (order + 1))
        share = 1.0 / (shape.exponent + 1.0)
        factor = 2.0 * math.sqrt(math.pi) * math.gamma(1.0 + share) / math.gamma(0.5 + share)
        self._duration = factor * (0.5 * (shape.exponent + 1.0)) ** share, share, (1.0 - shape.exponent) * share

    def _evaluate(self, text: str, d: Any, **given: Any) -> Any:
        root = sqrt(maximum(d, 0.0)) if "r" in compile(text, "law", "eval").co_names else None
        return eval(text, {"max": maximum, "math": SimpleNamespace(sqrt=sqrt), "d": d, "r": root, **given})

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

    def closed_force(self, k: Any, c: Any, d: Any, v: Any) -> Any:
        """Force of a closed contact, cut at zero where the law cannot pull."""
        pull = maximum(v, 0.0) if self.shape.approach_only else v
        found = self.elastic(k, c, d)
        found = found + self.damper(c, d) * pull if self.shape.damper else found
        return found if self.shape.tension else where(d > 0.0, maximum(found, 0.0), 0.0)

    def memoryless(self, k: Any, c: Any, fastest: Any, d: Any, v: Any) -> Any:
        """Force where nothing but the present state decides it; `fastest` is the rate of approach so far."""
        if self.shape.per_speed:
            c = c / maximum(maximum(fastest, v), RESTING_SPEED)
        return where(d > 0.0, self.closed_force(k, c, d, v), 0.0)

    def duration(self, k: Any, v: Any, mass: Any) -> Any:
        """How long an elastic contact of this stiffness lasts (s)."""
        factor, share, speed = self._duration
        found = factor * power(mass / k, share)
        return found * power(maximum(v, RESTING_SPEED), speed) if speed else found


class Group:
    """Lanes side by side, and all that their steps share.

    Parameters
    ----------
    spec : KernelSpec
        What the kernel is for.
    scheme : object
        How its steps are taken, a `pounding_sweep.schemes.Scheme`.
    reducers : sequence
        What is kept of them, `pounding_sweep.outputs.declare.Reducer`.
    trace : Tracer or None
        None: the NumPy twin.
    lanes : int
        Scenarios side by side.
    constants : LLVM pointer or ndarray
        Constants of the scene, `property_slots`.
    memory : LLVM pointer, optional
        Where the state lies; the twin has its own.
    """

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
        self.spec, self.trace, self.lanes, self._constants = spec, trace, lanes, constants
        self.scheme, self.reducers, self.asked = scheme, reducers, spec.reducers
        #: Whether motions are followed between the ends of steps.
        self.follows = any(reducer.follows for reducer in reducers)
        self.contacts = spec.contacts if spec.law is not None else ()
        self.touching = len(self.contacts) > 0
        self.limit = SimpleNamespace(**TOLERANCES[spec.precision])
        self.law = Law(spec.law, spec.order, self.limit.exact) if spec.law is not None else None
        #: Number of the step that lanes are within: one for all, or one each.
        self.number: Callable[[], Any] = lambda: 0
        self._places, self._inputs = property_slots(spec), input_slots(spec)
        self.state = Rows(trace, list(self._rows().items()), lanes)
        if trace is not None:
            self.state.pointer = memory

    def _rows(self) -> dict[str, int]:
        """Name all rows of state: inputs, results, motion, and what the scheme and the contacts need."""
        spec, n, nc, nb = self.spec, self.spec.n_dof, len(self.spec.contacts), self.spec.n_buildings
        rows = self._inputs.count | result_slots(spec, self.reducers).count
        rows |= {"u": n, "v": n, "u0": n, "v0": n, "h": 1, "g0": 1, "g1": 1}
        if spec.implicit or self.touching:
            rows |= {"a0": n}
        if spec.implicit or spec.impulsive:
            rows |= {"a": n}
        if self.touching:
            rows |= dict.fromkeys(("time_left", "fraction", "ahead", "ga", "gb", "tries", "land", "taken"), 1)
            rows |= dict.fromkeys(("fallback", "unsolved", "stiff"), 1)
            rows |= dict.fromkeys(("mode", "next", "event", "ke", "ce", "kl", "cl", "vrun", "age", "lasts"), nc)
            rows |= dict.fromkeys(("d0", "d1", "w0", "w1", "f0", "f1", "q0", "q1", "force"), nc)
            rows |= {"now": nb}
            if spec.law is not None and spec.law.yields:
                rows |= {"plastic": nc, "yield": nc}
        for slot in (slot for reducer in self.reducers for slot in reducer.keeps):
            rows |= {slot.name: slot.count(spec)}
        return rows

    def looks(self, what: str) -> bool:
        """Whether a reducer asks `what` (out of `LOOKS`) of each sub-step of a closed contact."""
        return any(LOOKS.index(reducer.looks) >= LOOKS.index(what) for reducer in self.reducers)

    # what the scene gives ------------------------------------------------------------------------------------------

    def prop(self, name: str, i: int = 0) -> Any:
        """Return a constant of the scene: of a floor, building or contact; per lane where buildings vary."""
        if self.spec.varied and name not in SHARED and f"p_{name}" in self._inputs.count:
            return self.state[f"p_{name}", i]
        at = self._places.first[name] + i
        if self.trace is None:
            return self._constants[at]
        t = self.trace
        pointer = t.builder.gep(self._constants, [ir.Constant(ir.IntType(64), at)], inbounds=True)
        return Real(t, t.load(pointer, t.real, t.size, fixed=True))

    def transition(self, stepping: Any, i: int) -> Any:
        """Return number `i` of the table of exact flight over a short step (`stepping`) or a long one."""
        if self.spec.varied:
            short, long = (self.state.first[f"p_{name}"] for name in ("short", "glide"))
            return self.state.row(where_count(self.trace, stepping, short, long) + i)
        short, long = (self._places.first[name] for name in ("short", "glide"))
        at = where_count(self.trace, stepping, short, long) + i
        if self.trace is None:
            return self._constants[at]
        t = self.trace
        return Real(t, t.load(t.builder.gep(self._constants, [at.value], inbounds=True), t.real, t.size, fixed=True))

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
        """Return a number in all lanes."""
        if self.trace is None:
            return np.array(np.broadcast_to(x, self.lanes), float)
        return (
            x
            if isinstance(x, Vector)
            else Vector(self.trace, self.trace.spread(x.value if isinstance(x, Real) else self.trace.number(x)))
        )

    def floors(self, name: str) -> list[Any]:
        """Return a row of each floor."""
        return [self.state[name, i] for i in range(self.spec.n_dof)]

    def put(self, name: str, values: Sequence[Any]) -> None:
        """Write rows."""
        for i, x in enumerate(values):
            self.state[name, i] = x

    @cached_property
    def building_floors(self) -> list[list[int]]:
        """Floors of each building."""
        return [list(range(self.spec.home(b), self.spec.home(b) + n)) for b, n in enumerate(self.spec.storeys)]

    def between(self, x: Sequence[Any], j: int) -> Any:
        """Left minus right of the floors of contact j, a wall being at rest."""
        left, right, _ = self.spec.contacts[j]
        if left < 0:
            return -x[right]
        return x[left] if right < 0 else x[left] - x[right]

    def gap(self, j: int) -> Any:
        """Gap of contact j (m)."""
        return self.state["gap", self.spec.contacts[j][2]]
