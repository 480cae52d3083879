"""A kernel: one lane group after another over the record, traced into the body of a function that numba compiles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir

from pounding_sweep.kernel import march
from pounding_sweep.kernel.forces import penetration
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import Count, Real, Rows, Tracer, count_to, first_lane, when
from pounding_sweep.kernel.spec import LANES, PARAMETERS, KernelSpec, history_slots, input_slots
from pounding_sweep.outputs.variables import output_slots, reducers_of
from pounding_sweep.schemes import SCHEMES

_I64, _DOUBLE = ir.IntType(64), ir.DoubleType()
#: Pointer and shape of arrays, by name.
Arrays = dict[str, tuple[Any, tuple[Any, ...]]]


class Ground:
    """The record as a kernel steps through it, its numbers in double precision."""

    def __init__(self, trace: Tracer, arrays: Arrays, length: Any, steps: Any, substeps: Any) -> None:
        self._trace, (self._pointer, (points,)), b = trace, arrays["motion"], trace.builder
        self.intervals, self.steps, self.substeps = (
            Count(trace, points) - 1,
            Count(trace, steps),
            Count(trace, substeps),
        )
        self.h, self.long = (self._narrow(b.fdiv(length, b.sitofp(parts, _DOUBLE))) for parts in (steps, substeps))
        #: The ground at the ends of all steps, for lanes that each have their own.
        self.track = arrays["track"][0]

    def _narrow(self, x: Any) -> Real:
        t = self._trace
        return Real(t, x if t.size == 8 else t.builder.fptrunc(x, t.real))

    def start(self) -> Real:
        """Acceleration at the first point."""
        return self._narrow(self._at(Count(self._trace, ir.Constant(_I64, 0))))

    def _at(self, i: Any) -> Any:
        t = self._trace
        return t.load(t.builder.gep(self._pointer, [i.value], inbounds=True), _DOUBLE, 8, fixed=True)

    def _between(self, i: Any, j: Any) -> Any:
        b = self._trace.builder
        share = b.fdiv(b.sitofp(j.value, _DOUBLE), b.sitofp(self.steps.value, _DOUBLE))
        first = self._at(i)
        return b.fadd(first, b.fmul(b.fsub(self._at(i + 1), first), share))

    def ends(self, i: Any, j: Any) -> tuple[Real, Real]:
        """Accelerations at both ends of a step."""
        b = self._trace.builder
        late = b.select((j == self.steps - 1).value, self._at(i + 1), self._between(i, j + 1))
        return self._narrow(self._between(i, j)), self._narrow(late)

    def time(self, number: Any) -> Real:
        """Time (s) after so many steps."""
        b, t = self._trace.builder, self._trace
        h = self.h.value if t.size == 8 else b.fpext(self.h.value, _DOUBLE)
        return self._narrow(b.fmul(b.sitofp(number.value, _DOUBLE), h))


def width(precision: str) -> int:
    """Scenarios side by side in one vector."""
    return 8 if precision == "float64" else LANES


def make_group(spec: KernelSpec, trace: Tracer | None, lanes: int, constants: Any, memory: Any = None) -> Group:
    """Return lanes side by side under the scheme and the reducers of a kernel."""
    return Group(spec, SCHEMES[spec.scheme], reducers_of(spec), trace, lanes, constants, memory)


def state_size(spec: KernelSpec) -> int:
    """Numbers of the memory that the kernel's state takes."""
    return make_group(spec, None, 1, None).state.size * width(spec.precision)


def run_group(group: Group, ground: Any, note: Callable[[Any], None] | None) -> None:
    """Take a lane group whose inputs are there over the record."""
    march.begin(group, ground.start())
    if note is not None:
        note(Count(group.trace, ir.Constant(_I64, 0)) if group.trace else 0)
    group.scheme.march(group, ground, note)
    march.finish(group)


def emit(spec: KernelSpec, builder: Any, arrays: Arrays, length: Any, steps: Any, substeps: Any) -> None:
    """Write the kernel of `spec` where `builder` stands."""
    trace = Tracer(builder, spec.precision, width(spec.precision))
    parts = LANES // trace.lanes
    group = make_group(spec, trace, trace.lanes, arrays["constants"][0], arrays["state"][0])
    ground = Ground(trace, arrays, length, steps, substeps)
    groups, columns = arrays["inputs"][1]
    for each in count_to(Count(trace, groups) * parts, trace):
        row = each // parts
        part = each - row * parts
        half = (part * trace.lanes).value
        for i in count_to(group.state.size * trace.lanes, trace):
            builder.store(trace.number(0.0), builder.gep(group.state.pointer, [i.value], inbounds=True))
        given = list(input_slots(spec).count.items())
        pointer = builder.gep(arrays["inputs"][0], [builder.add(builder.mul(row.value, columns), half)])
        inputs = Rows(trace, given, trace.lanes, pointer, LANES, wide=True)
        for name, n in given:
            _copy(trace, inputs, group.state, name, n)
        note = noter(group, _putter(trace, arrays["history"]), part == 0) if spec.history else None
        run_group(group, ground, note)
        results, found = arrays["results"], list(output_slots(spec).count.items())
        pointer = builder.gep(results[0], [builder.add(builder.mul(row.value, results[1][1]), half)])
        kept = Rows(trace, found, trace.lanes, pointer, LANES, wide=True)
        for name, n in found:
            _copy(trace, group.state, kept, name, n)


def _copy(trace: Tracer, source: Rows, target: Rows, name: str, n: int) -> None:
    """Copy rows of a name; many in a loop."""
    if n <= 40:
        for i in range(n):
            target[name, i] = source[name, i]
        return
    for i in count_to(n, trace):
        target[name, i] = source[name, i]


def noter(group: Group, put: Callable[[Any, int, Any], None], first: Any) -> Callable[[Any], None]:
    """Return what makes the state of lane 0 a row of the history, by `put` of a row's column, in the `first` lanes."""
    s, place = group.state, history_slots(group.spec)

    def note(row: Any) -> None:
        for name, n in (item for _ in when(first) for item in place.count.items()):
            for q in range(n):
                if name != "force":
                    value = s[name, q]
                elif group.spec.impulsive or not group.spec.located:
                    value = s["f1", q]
                else:
                    assert group.law is not None
                    v = group.between(group.floors("v"), q)
                    value = group.law.pressing(s["ke", q], s["ce", q], penetration(group, q), v)
                put(row, place.first[name] + q, value)

    return note


def _putter(trace: Tracer, array: Any) -> Callable[[Any, int, Any], None]:
    """Return what stores lane 0 in an array of two dimensions."""
    data, (_, columns) = array
    b = trace.builder

    def put(row: Any, column: int, value: Any) -> None:
        x = first_lane(value).value
        at = b.add(b.mul(row.value, columns), ir.Constant(_I64, column))
        b.store(x if trace.size == 8 else b.fpext(x, _DOUBLE), b.gep(data, [at])).align = 8

    return put


def write_body(spec: KernelSpec, context: Any, builder: Any, signature: Any, values: Any) -> Any:
    """Write the kernel of `spec` as the body of an intrinsic of numba's; returns nothing's value."""
    from numba import types
    from numba.core import cgutils

    found: dict[str, Any] = {}
    for name, kind, value in zip(PARAMETERS, signature.args, values, strict=True):
        found[name] = value
        if isinstance(kind, types.Array):
            array = context.make_array(kind)(context, builder, value)
            found[name] = array.data, tuple(cgutils.unpack_tuple(builder, array.shape, kind.ndim))
    emit(spec, builder, found, found["length"], found["steps"], found["substeps"])
    return context.get_dummy_value()
