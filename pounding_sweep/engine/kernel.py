"""A kernel: one lane group after another over the record, traced into a function that numba compiles; and its twin."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import count
from typing import Any

import numpy as np
from llvmlite import ir

from pounding_sweep.kernel import march
from pounding_sweep.kernel.flight import Flight, Layout
from pounding_sweep.kernel.flight_tables import Blocks, Tables
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import (
    Count,
    Ledger,
    Real,
    Rows,
    Table,
    Tracer,
    count_to,
    has_wide_registers,
    lane_of,
    tracing,
    when,
)
from pounding_sweep.kernel.spec import GIVEN, LANES, PARAMETERS, KernelSpec, Slots, history_slots, input_slots
from pounding_sweep.outputs.variables import output_slots, reducers_of
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.schemes.exact import Course, Flights, run_scenarios

_I64, _DOUBLE = ir.IntType(64), ir.DoubleType()
#: Share of its largest size by which what flight watches is widened in windows, for rounding.
MARGIN = {"float64": 1e-12, "float32": 4e-6}


class Ground:
    """The record as a kernel steps through it, its numbers in double precision."""

    def __init__(self, trace: Tracer, arrays: dict[str, Any]) -> None:
        self.trace, (self._pointer, (points,)), b = trace, arrays["motion"], trace.builder
        steps = [arrays[name] for name in ("steps", "substeps")]
        self.intervals, self.steps, self.substeps = (Count(trace, x) for x in (b.sub(points, _I64(1)), *steps))
        self.h, self.long = (self._narrow(b.fdiv(arrays["length"], b.sitofp(n, _DOUBLE))) for n in steps)
        #: The ground at the ends of all steps, for lanes that each have their own.
        self.track = arrays["track"][0]

    def _narrow(self, x: Any) -> Real:
        t = self.trace
        return Real(t, x if t.size == 8 else t.builder.fptrunc(x, t.real))

    def start(self) -> Real:
        """Acceleration at the first point."""
        return self._narrow(self._at(Count(self.trace, _I64(0))))

    def _at(self, i: Any) -> Any:
        t = self.trace
        return t.load(t.builder.gep(self._pointer, [i.value], inbounds=True), _DOUBLE, 8, fixed=True)

    def _between(self, i: Any, j: Any) -> Any:
        b = self.trace.builder
        share = b.fdiv(b.sitofp(j.value, _DOUBLE), b.sitofp(self.steps.value, _DOUBLE))
        first = self._at(i)
        return b.fadd(first, b.fmul(b.fsub(self._at(i + 1), first), share))

    def ends(self, i: Any, j: Any) -> tuple[Real, Real]:
        """Accelerations at both ends of a step."""
        b = self.trace.builder
        late = b.select((j == self.steps - 1).value, self._at(i + 1), self._between(i, j + 1))
        return self._narrow(self._between(i, j)), self._narrow(late)

    def time(self, number: Any) -> Real:
        """Time (s) after so many steps."""
        b, t = self.trace.builder, self.trace
        h = self.h.value if t.size == 8 else b.fpext(self.h.value, _DOUBLE)
        return self._narrow(b.fmul(b.sitofp(number.value, _DOUBLE), h))


class TwinGround:
    """The record as the kernel's twin steps through it."""

    def __init__(self, arrays: dict[str, Any]) -> None:
        self._motion, self.track, self.steps, self.substeps = (
            arrays[name] for name in ("motion", "track", "steps", "substeps")
        )
        self.h, self.long = arrays["length"] / self.steps, arrays["length"] / self.substeps
        self.intervals = len(self._motion) - 1

    def start(self) -> Any:
        """Acceleration at the first point."""
        return self._motion[0]

    def _between(self, i: int, j: int) -> Any:
        return self._motion[i] + (self._motion[i + 1] - self._motion[i]) * (j / self.steps)

    def ends(self, i: int, j: int) -> tuple[Any, Any]:
        """Accelerations at both ends of a step."""
        return self._between(i, j), self._motion[i + 1] if j == self.steps - 1 else self._between(i, j + 1)

    def time(self, number: int) -> float:
        """Time (s) after so many steps."""
        return number * self.h


def width(precision: str) -> int:
    """Scenarios side by side in one vector: as many as a register of the processor holds."""
    return (64 if has_wide_registers() else 32) // (8 if precision == "float64" else 4)


def make_group(spec: KernelSpec, trace: Tracer | None, lanes: int, constants: Any, memory: Any = None) -> Group:
    """Return lanes side by side under the scheme and the reducers of a kernel."""
    return Group(spec, SCHEMES[spec.scheme], reducers_of(spec), trace, lanes, constants, memory)


def state_size(spec: KernelSpec) -> tuple[int, int]:
    """Numbers of the memory that the kernel's state takes, and how many of its rows a step leaves to the next."""
    lanes = width(spec.precision)
    group = make_group(spec, None, lanes, None)
    return group.state.size * lanes + (_own_size(group) if spec.flies_exactly else 0), group.passing


def _own_size(group: Group) -> int:
    """Numbers of flight's own rows."""
    layout = Layout(group)
    return sum(layout.scratch.values()) * layout.lanes


def run_group(group: Group, ground: Any, note: Callable[[Any], None] | None) -> None:
    """Take a lane group whose inputs are there over the record."""
    march.begin(group, ground.start())
    if note is not None:
        note(Count(group.trace, _I64(0)) if group.trace else 0)
    group.scheme.march(group, ground, note)
    march.finish(group)


@np.errstate(all="ignore")
def run_twin(spec: KernelSpec, *numbers: Any) -> None:
    """Do what the compiled kernel of `spec` does, by the same source on NumPy arrays in double precision."""
    arrays = dict(zip(PARAMETERS, numbers, strict=False))
    ground, constants, history = TwinGround(arrays), arrays["constants"], arrays["history"]

    def put(row: int, column: int, value: np.ndarray) -> None:
        history[row, column] = value[0]

    def rows_of(slots: Slots, values: np.ndarray) -> Iterator[tuple[tuple[str, int], np.ndarray]]:
        places = [(name, i) for name, n in slots.count.items() for i in range(n)]
        return zip(places, values.reshape(-1, LANES), strict=True)

    if spec.flies_exactly:
        group = make_group(spec, None, width(spec.precision), constants)
        note = noter(group, put, True) if spec.history else None
        given = {**arrays, "memory": None} | {name: arrays[name].reshape(-1, LANES) for name in ("inputs", "results")}
        counts = arrays["rows"], arrays["scenarios"], group.passing
        flights = make_flights(group, ground, given, counts, note, Ledger())
        run_scenarios(group, ground, flights.serve, flights.course, note)
        return
    for inputs, results in zip(arrays["inputs"], arrays["results"], strict=True):
        group = make_group(spec, None, LANES, constants)
        for place, row in rows_of(input_slots(spec), inputs):
            group.state[place] = row
        run_group(group, ground, noter(group, put, True) if spec.history else None)
        for place, row in rows_of(output_slots(spec), results):
            row[:] = group.state[place]


def emit(spec: KernelSpec, builder: Any, place: Any) -> None:
    """Write the kernel of `spec`, or its flight, where `builder` stands; `place` is the address of its frame."""
    with tracing(trace := Tracer(builder, spec.precision, width(spec.precision))):
        _emit(spec, trace, place)


def _emit(spec: KernelSpec, trace: Tracer, place: Any) -> None:
    builder = trace.builder
    frame = builder.inttoptr(place, _I64.as_pointer())
    arrays = _read_frame(trace, frame)
    state, ground = arrays["state"][0], Ground(trace, arrays)
    group = make_group(spec, trace, trace.lanes, arrays["constants"][0], state)
    put = _putter(trace, arrays["history"])
    if not spec.flies_exactly:
        _emit_groups(group, ground, arrays, put)
        return
    # flight's own rows come before those of the state
    group.state.table.pointer = builder.gep(state, [_I64(_own_size(group))], inbounds=True)
    note = noter(group, put, True) if spec.history else None
    ledger = Ledger(builder.gep(frame, [_I64(GIVEN)], inbounds=True), begins=not spec.only_flight)
    if spec.only_flight:
        given = {name: arrays[name][0] for name in ("inputs", "results", "tables", "decays")} | {"memory": state}
        counts = [Count(trace, arrays[name]) for name in ("rows", "scenarios", "passing")]
        make_flights(group, ground, given, counts, note, ledger).serve()
        return
    kind = ir.FunctionType(ir.VoidType(), [_I64])
    flight = builder.inttoptr(arrays["flight"], kind.as_pointer())
    run_scenarios(group, ground, lambda: builder.call(flight, [place]), Course(group, ledger.cell), note)


def _read_frame(trace: Tracer, frame: Any) -> dict[str, Any]:
    """Return what a kernel is given, by name: of arrays a pointer and the shape."""
    b, places = trace.builder, count()

    def take() -> Any:
        return b.load(b.gep(frame, [_I64(next(places))], inbounds=True))

    arrays: dict[str, Any] = {}
    for name, kind in PARAMETERS.items():
        if "[" in kind:
            real = trace.real if "real" in kind else _DOUBLE
            arrays[name] = b.inttoptr(take(), real.as_pointer()), [take() for _ in range(1 + kind.count(","))]
        else:
            arrays[name] = take() if kind == "int64" else b.bitcast(take(), _DOUBLE)
    return arrays


def _emit_groups(group: Group, ground: Ground, arrays: dict[str, Any], put: Callable[[Any, int, Any], None]) -> None:
    """Write a kernel that takes one lane group after another over the record."""
    spec, trace, builder = group.spec, ground.trace, ground.trace.builder
    parts = LANES // trace.lanes
    for each in count_to(Count(trace, arrays["inputs"][1][0]) * parts):
        row = each // parts
        part = each - row * parts
        for i in count_to(group.state.size * trace.lanes):
            group.state.table.put_number(i, 0.0)

        def rows_of(name: str, slots: Slots, row: Any = row, part: Any = part) -> Rows:
            data, (_, columns) = arrays[name]
            first = builder.gep(data, [builder.add(builder.mul(row.value, columns), (part * trace.lanes).value)])
            return Rows(trace, slots.count, trace.lanes, first, LANES, double=True)

        inputs = rows_of("inputs", input_slots(spec))
        for name, n in inputs.count.items():
            for i in count_to(n):
                group.state[name, i] = inputs[name, i]
        run_group(group, ground, noter(group, put, part == 0) if spec.history else None)
        results = rows_of("results", output_slots(spec))
        for name, n in results.count.items():
            for i in count_to(n):
                results[name, i] = group.state[name, i]


def make_flights(
    group: Group, ground: Any, arrays: dict[str, Any], counts: Sequence[Any], note: Any, ledger: Ledger
) -> Flights:
    """Return the flight of all scenarios of a call."""
    # `arrays` are inputs, results, tables, decays and flight's own memory, by name; `counts` are those of rows of
    # buildings, of scenarios, and of rows of the state that a step leaves to the next
    trace, spec, (rows, scenarios, kept) = group.trace, group.spec, counts
    points = ground.intervals * ground.substeps + 1
    flight = Flight(group, arrays["tables"], points, arrays["memory"])
    wide = None if trace is None else Tracer(trace.builder, "float64", flight.lanes)
    own = flight, Table(wide, arrays["decays"], flight.lanes), MARGIN[spec.precision]
    course = Course(group, ledger.cell)
    if spec.blocks:
        flight.blocks = Blocks(*own, rows, ledger.cell)
    fill = flight.blocks.fill if spec.blocks else partial(Tables(*own).fill, rows)
    inputs, results = (
        Rows(trace, slots.count, LANES, arrays[name], double=True)
        for slots, name in ((input_slots(spec), "inputs"), (output_slots(spec), "results"))
    )
    tables = fill, flight.blocks.blocks if spec.blocks else points
    return Flights(group, ground, flight, course, (inputs, results, scenarios), tables, kept, note)


def noter(group: Group, put: Callable[[Any, int, Any], None], first: Any) -> Callable[[Any], None]:
    """Return what makes the state of lane 0 a row of the history, by `put` of a row's column, in the `first` lanes."""
    s, place = group.state, history_slots(group.spec)

    def note(row: Any) -> None:
        for name, n in (item for _ in when(first) for item in place.count.items()):
            for q in range(n):
                if name != "force":
                    value = s[name, q]
                elif group.spec.only_flight:
                    value = group.full(0.0)
                elif group.spec.impulsive or not group.spec.located:
                    value = s["f1", q]
                else:
                    contact = group.known_contacts()[q]
                    d, v = contact.penetration(), contact.between(group.floors("v"))
                    value = contact.law.pressing(contact.ke, contact.ce, d, v)
                put(row, place.first[name] + q, value)

    return note


def _putter(trace: Tracer, array: Any) -> Callable[[Any, int, Any], None]:
    """Return what stores lane 0 in an array of two dimensions."""
    data, (_, columns) = array
    b = trace.builder

    def put(row: Any, column: int, value: Any) -> None:
        x = lane_of(value, 0).value
        at = b.add(b.mul(row.value, columns), _I64(column))
        b.store(x if trace.size == 8 else b.fpext(x, _DOUBLE), b.gep(data, [at])).align = 8

    return put


def _optimise_once(library: Any) -> None:
    """Have a kernel's code go through one optimisation, where numba has two; its vectors are written as such."""
    from llvmlite import binding

    def functions(module: Any) -> None:
        module.data_layout = library.codegen._data_layout

    def all_of_it() -> None:
        options = binding.create_pipeline_tuning_options(speed_level=3)
        options.loop_vectorization = options.slp_vectorization = options.loop_interleaving = False
        options.loop_unrolling = False  # which takes long, and longer code
        builder = binding.create_pass_builder(library.codegen._tm, options)
        builder.getModulePassManager().run(library._final_module, builder)

    # should numba give these other names, kernels only take longer to compile
    library._optimize_functions, library._optimize_final_module = functions, all_of_it


def write_body(spec: KernelSpec, context: Any, builder: Any, place: Any) -> Any:
    """Write the kernel of `spec`, or its flight, as the body of an intrinsic of numba's; returns nothing's value."""
    _optimise_once(context.active_code_library)
    emit(spec, builder, place)
    return context.get_dummy_value()
