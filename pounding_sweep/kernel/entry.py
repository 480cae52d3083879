"""A kernel as numba compiles it: one `@njit` function whose body is traced."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir

from pounding_sweep.emit.spec import LANES, KernelSpec, history_slots, input_slots
from pounding_sweep.kernel import life, located
from pounding_sweep.kernel.exact import March
from pounding_sweep.kernel.forces import penetration
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import Count, Real, Rows, Tracer, count_to

_I64, _DOUBLE = ir.IntType(64), ir.DoubleType()


class Ground:
    """The record as a kernel steps through it, its numbers in double precision."""

    def __init__(self, trace: Tracer, pointer: Any, points: Any, length: Any, steps: Any) -> None:
        self._trace, self._pointer, self._length = trace, pointer, length
        self.intervals, self.steps = Count(trace, points) - 1, Count(trace, steps)
        self.h = self._narrow(trace.builder.fdiv(length, trace.builder.sitofp(steps, _DOUBLE)))

    def _narrow(self, x: Any) -> Real:
        t = self._trace
        return Real(t, x if t.size == 8 else t.builder.fptrunc(x, t.real))

    def at(self, i: Any) -> Any:
        """Acceleration at a point of the record."""
        t = self._trace
        return t.load(t.builder.gep(self._pointer, [i.value], inbounds=True), _DOUBLE, 8, fixed=True)

    def between(self, i: Any, j: Any) -> Any:
        """Acceleration `j` steps after a point."""
        b = self._trace.builder
        share = b.fdiv(b.sitofp(j.value, _DOUBLE), b.sitofp(self.steps.value, _DOUBLE))
        first = self.at(i)
        return b.fadd(first, b.fmul(b.fsub(self.at(i + 1), first), share))

    def ends(self, i: Any, j: Any) -> tuple[Real, Real]:
        """Accelerations at both ends of a step."""
        b = self._trace.builder
        late = b.select((j == self.steps - 1).value, self.at(i + 1), self.between(i, j + 1))
        return self._narrow(self.between(i, j)), self._narrow(late)

    def time(self, number: Any) -> Real:
        """Time (s) after so many steps."""
        b, t = self._trace.builder, self._trace
        h = self.h.value if t.size == 8 else b.fpext(self.h.value, _DOUBLE)
        return self._narrow(b.fmul(b.sitofp(number.value, _DOUBLE), h))


def width(precision: str) -> int:
    """Scenarios side by side in one vector."""
    return 8 if precision == "float64" else LANES


def emit(spec: KernelSpec, builder: Any, arrays: dict[str, Any], dtr: Any, steps: Any, substeps: Any) -> None:
    """Write the kernel of `spec` at a builder; arrays are (data, shape)."""
    trace = Tracer(builder, spec.precision, width(spec.precision))
    parts = LANES // trace.lanes
    group = Group(spec, trace, trace.lanes, arrays["constants"][0], arrays["state"][0])
    data, (points,) = arrays["ag"]
    ground = Ground(trace, data, points, dtr, steps)
    march, track = None, None
    if spec.scheme == "exact":
        track = arrays["track"][0]
        short, last = Count(trace, steps) // Count(trace, substeps), ground.intervals * ground.steps
        long = ground._narrow(builder.fdiv(dtr, builder.sitofp(substeps, _DOUBLE)))
    groups, columns = arrays["X"][1]
    results = arrays["O"]
    history = spec.history
    count = Count(trace, groups) if history else Count(trace, groups) * parts
    for each in count_to(count, trace):
        row = each if history else each // parts
        half = builder.mul((each - row * parts).value, ir.Constant(_I64, trace.lanes)) if not history else ir.Constant(_I64, 0)
        for i in count_to(group.state.size * trace.lanes, trace):
            zero = trace.number(0.0)
            builder.store(zero, builder.gep(group.state.pointer, [i.value], inbounds=True))
        given = input_slots(spec)
        pointer = builder.gep(arrays["X"][0], [builder.add(builder.mul(row.value, columns), half)])
        inputs = Rows(trace, list(given.count.items()), trace.lanes, pointer, LANES, wide=True)
        for name, n in given.count.items():
            _copy(trace, inputs, group.state, name, n)
        life.begin(group, ground._narrow(ground.at(Count(trace, ir.Constant(_I64, 0)))))
        note: Callable[[Any], None] | None = None
        if history:
            note = _noter(group, arrays["H"])
            note(Count(trace, ir.Constant(_I64, 0)))
        if spec.scheme == "exact":
            march = March(group, track, short, last, (ground.h, long))
            march.run(lambda: located.substep(group, life.rk4_trial, ground.h), note)
        else:
            life.FixedSteps(group, ground, note).run()
        life.finish(group)
        pointer = builder.gep(results[0], [builder.add(builder.mul(row.value, results[1][1]), half)])
        kept = Rows(trace, life.outputs(group), trace.lanes, pointer, LANES, wide=True)
        for name, n in life.outputs(group):
            _copy(trace, group.state, kept, name, n)


def _copy(trace: Tracer, source: Rows, target: Rows, name: str, n: int) -> None:
    """Copy rows of a name; many in a loop."""
    if n <= 40:
        for i in range(n):
            target[name, i] = source[name, i]
        return
    for i in count_to(n, trace):
        target[name, i] = source[name, i]


def _noter(group: Group, array: Any) -> Callable[[Any], None]:
    """Return what makes the state of lane 0 a row of the history."""
    data, (_, columns) = array
    trace, s, place = group.trace, group.state, history_slots(group.spec)
    assert trace is not None
    b = trace.builder

    def note(row: Any) -> None:
        for name, n in place.count.items():
            for q in range(n):
                if name != "force":
                    value = s[name, q]
                elif group.spec.impulsive or not group.spec.located:
                    value = s["f1", q]
                else:
                    assert group.law is not None
                    v = group.between(group.floors("v"), q)
                    value = group.law.pressing(s["ke", q], s["ce", q], penetration(group, q), v)
                x = b.extract_element(value.value, ir.Constant(ir.IntType(32), 0))
                x = x if trace.size == 8 else b.fpext(x, _DOUBLE)
                at = b.add(b.mul(row.value, columns), ir.Constant(_I64, place.first[name] + q))
                kept = b.store(x, b.gep(data, [at]))
                kept.align = 8

    return note


def body_of(spec: KernelSpec) -> Any:
    """Return the kernel's body, as an intrinsic that numba puts into a function."""
    from numba import types
    from numba.core import cgutils
    from numba.extending import intrinsic

    names = ("ag", "dtr", "steps", "substeps", "constants", "X", "O", "H", "track", "state")

    @intrinsic
    def body(typing: Any, ag: Any, dtr: Any, steps: Any, substeps: Any, constants: Any, X: Any, O: Any, H: Any, track: Any, state: Any) -> Any:  # noqa: E741, N803
        given = (ag, dtr, steps, substeps, constants, X, O, H, track, state)

        def codegen(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            arrays = {}
            for name, kind, value in zip(names, signature.args, values, strict=True):
                if isinstance(kind, types.Array):
                    array = context.make_array(kind)(context, builder, value)
                    arrays[name] = array.data, tuple(cgutils.unpack_tuple(builder, array.shape, kind.ndim))
            emit(spec, builder, arrays, values[1], values[2], values[3])
            return context.get_dummy_value()

        return types.void(*given), codegen

    return body


def compiled(spec: KernelSpec) -> Callable[..., None]:
    """Compile the kernel of `spec`."""
    from numba import njit

    body, real = body_of(spec), spec.precision
    size = Group(spec, None, 1, None).state.size * width(real)
    signature = f"void(float64[::1], float64, int64, int64, {real}[::1], float64[:, ::1], float64[:, ::1], float64[:, ::1], {real}[::1], {real}[::1])"

    @njit(signature, error_model="numpy", nogil=True, boundscheck=False, fastmath=False)
    def inner(ag: Any, dtr: Any, steps: Any, substeps: Any, constants: Any, X: Any, O: Any, H: Any, track: Any, state: Any) -> None:  # noqa: E741, N803
        body(ag, dtr, steps, substeps, constants, X, O, H, track, state)

    def run(ag: Any, dtr: Any, steps: Any, substeps: Any, constants: Any, X: Any, O: Any, H: Any) -> None:  # noqa: E741, N803
        track = np.zeros(1, real)
        if spec.scheme == "exact":
            share = np.arange(steps) / steps
            inner_points = ag[:-1, None] + (ag[1:] - ag[:-1])[:, None] * share
            track = np.append(inner_points.ravel(), ag[-1]).astype(real)
        inner(ag, dtr, steps, substeps, np.asarray(constants, real), X, O, H, track, np.zeros(size, real))

    return run
