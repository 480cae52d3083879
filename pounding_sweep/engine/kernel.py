"""A kernel: one lane group after another over the record, traced into the body of a function that numba compiles."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from llvmlite import ir

from pounding_sweep.kernel import march
from pounding_sweep.kernel.flight import Flight, Layout, scratch
from pounding_sweep.kernel.flight_blocks import Blocks
from pounding_sweep.kernel.flight_tables import Tables
from pounding_sweep.kernel.forces import penetration
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import (
    Count,
    Ledger,
    Real,
    Rows,
    Tracer,
    count_to,
    first_lane,
    flag,
    has_wide_registers,
    rounded,
    when,
)
from pounding_sweep.kernel.spec import LANES, PARAMETERS, KernelSpec, history_slots, input_slots
from pounding_sweep.outputs.variables import output_slots, reducers_of
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.schemes.exact import Course, Events, Flights

_I64, _DOUBLE = ir.IntType(64), ir.DoubleType()
#: Parameters that kernels hand on to flight.
FLIGHT_PARAMETERS = {name: kind for name, kind in PARAMETERS.items() if name != "flight"} | {"passing": "int64"}
#: Share of its largest size by which what flight watches is widened in windows, for rounding.
MARGIN = {"float64": 1e-12, "float32": 4e-6}
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
    """Scenarios side by side in one vector: as many as a register of the processor holds."""
    return (64 if has_wide_registers() else 32) // (8 if precision == "float64" else 4)


def make_group(spec: KernelSpec, trace: Tracer | None, lanes: int, constants: Any, memory: Any = None) -> Group:
    """Return lanes side by side under the scheme and the reducers of a kernel."""
    return Group(spec, SCHEMES[spec.scheme], reducers_of(spec), trace, lanes, constants, memory)


def state_size(spec: KernelSpec) -> int:
    """Numbers of the memory that the kernel's state takes."""
    lanes = width(spec.precision)
    rows = make_group(spec, None, lanes, None)
    return rows.state.size * lanes + (_own_size(rows) if spec.flies_exactly else 0)


def _own_size(group: Group) -> int:
    """Numbers of flight's own rows."""
    layout = Layout(group)
    return sum(scratch(layout).values()) * layout.lanes


def run_group(group: Group, ground: Any, note: Callable[[Any], None] | None) -> None:
    """Take a lane group whose inputs are there over the record."""
    march.begin(group, ground.start())
    if note is not None:
        note(Count(group.trace, ir.Constant(_I64, 0)) if group.trace else 0)
    group.scheme.march(group, ground, note)
    march.finish(group)


def emit(spec: KernelSpec, builder: Any, arrays: dict[str, Any]) -> None:
    """Write the kernel of `spec` where `builder` stands; `arrays` are what it is given, by its `PARAMETERS`."""
    if spec.flies_exactly:
        _emit_events(spec, builder, arrays)
        return
    trace = Tracer(builder, spec.precision, width(spec.precision))
    parts = LANES // trace.lanes
    group = make_group(spec, trace, trace.lanes, arrays["constants"][0], arrays["state"][0])
    ground = Ground(trace, arrays, *(arrays[name] for name in ("length", "steps", "substeps")))
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


class ScenarioQueue:
    """The scenarios of a call, as lanes ask for them."""

    # inputs, results: rows of `LANES` scenarios, one after another
    # count: how many scenarios there are
    # base: where the tables of a row of buildings begin, by its number

    def __init__(self, group: Group, inputs: Rows, results: Rows, count: Any, base: Callable[[Any], Any]) -> None:
        self._group, self._inputs, self._results, self.count, self._base = group, inputs, results, count, base

    def _each(self, rows: Rows, number: Any) -> Iterator[tuple[Any, Any]]:
        """Go through the rows of a scenario: the row of the state, and its own."""
        own, first = self._group.state.first, rows.first
        block = number // LANES * rows.size
        for name, n in rows.count.items():
            for i in count_to(n, self._group.trace) if n > 8 else range(n):
                yield own[name] + i, block + first[name] + i

    def put(self, number: Any, lane: Any) -> None:
        """Put a scenario's inputs into a lane."""
        column = number - number // LANES * LANES
        for row, mine in self._each(self._inputs, number):
            self._group.state.put_lane(row, lane, self._inputs.lane(mine, column))

    def take(self, number: Any, lane: Any) -> None:
        """Take a scenario's results from a lane."""
        column = number - number // LANES * LANES
        for row, mine in self._each(self._results, number):
            self._results.put_lane(mine, column, self._group.state.lane(row, lane))

    def tables(self, number: Any) -> Any:
        """Where the tables of a scenario's row of buildings begin."""
        if "tables" not in self._inputs:
            return self._base(number * 0)
        column = number - number // LANES * LANES
        at = number // LANES * self._inputs.size + self._inputs.first["tables"]
        return self._base(rounded(self._inputs.lane(at, column)))


def make_flights(
    group: Group, ground: Any, arrays: dict[str, Any], scenarios: Any, rows: tuple[Any, Any], note: Any, ledger: Ledger
) -> Flights:
    """Return the flight of all scenarios of a call."""
    # `arrays` are inputs, results, tables, decays and flight's own memory, by name; `rows` counts those of buildings
    # and those of the state that a step leaves to the next
    trace = group.trace
    points = ground.intervals * ground.substeps + 1
    flight = Flight(group, arrays["tables"], points, arrays["memory"])
    wide = None if trace is None else Tracer(trace.builder, "float64", flight.lanes)
    own = flight, arrays["decays"], wide, MARGIN[group.spec.precision]
    course = Course(group, ledger.cell)
    fill: Callable[[], None]
    if group.spec.blocks:
        flight.blocks = Blocks(*own, rows[0], ledger.cell)
        fill = flight.blocks.fill
    else:
        fill = partial(Tables(*own).fill, rows[0])
    flight.find_places()
    given, found = (
        Rows(trace, list(slots.count.items()), LANES, arrays[name], wide=True)
        for slots, name in ((input_slots(group.spec), "inputs"), (output_slots(group.spec), "results"))
    )
    stops = flight.blocks.blocks if group.spec.blocks else points
    those = ScenarioQueue(group, given, found, scenarios, lambda row: flight.layout.base(row, stops))
    return Flights(group, ground, flight, those, course, fill, rows[1], note)


class CalledFlights:
    """Flight as the kernel of a law calls it: compiled by itself, once for all laws."""

    # What the kernel was given lies, as whole numbers, before the variables that both share.

    #: What flight is asked to do.
    BEGIN, SERVE = range(2)
    #: Whole numbers before the shared variables, and in all.
    GIVEN = 32
    SIZE = GIVEN + 8 * Ledger.ROOM // 8

    def __init__(self, builder: Any, arrays: dict[str, Any]) -> None:
        self._builder = builder
        with builder.goto_entry_block():
            memory = builder.alloca(ir.ArrayType(_I64, self.SIZE))
        memory.align = Ledger.ROOM
        self.memory = builder.bitcast(memory, _I64.as_pointer())
        for i, x in enumerate(x for name in FLIGHT_PARAMETERS for x in _numbers(builder, arrays[name])):
            builder.store(x, self._at(builder, self.memory, i))
        kind = ir.FunctionType(ir.VoidType(), [_I64, _I64])
        self._function = builder.inttoptr(arrays["flight"], kind.as_pointer())

    @staticmethod
    def _at(builder: Any, memory: Any, i: int) -> Any:
        return builder.gep(memory, [ir.Constant(_I64, i)], inbounds=True)

    @classmethod
    def shared(cls, builder: Any, memory: Any) -> Any:
        """Where the variables lie that both share."""
        return cls._at(builder, memory, cls.GIVEN)

    @classmethod
    def given(cls, trace: Tracer, memory: Any) -> dict[str, Any]:
        """Return what the kernel was given."""
        b, numbers = trace.builder, iter(range(cls.GIVEN))

        def take() -> Any:
            return b.load(cls._at(b, memory, next(numbers)))

        found: dict[str, Any] = {}
        for name, kind in FLIGHT_PARAMETERS.items():
            if "[" in kind:
                real = trace.real if "real" in kind else _DOUBLE
                found[name] = b.inttoptr(take(), real.as_pointer()), tuple(take() for _ in range(1 + kind.count(",")))
            else:
                found[name] = take() if kind == "int64" else b.bitcast(take(), _DOUBLE)
        return found

    def begin(self) -> None:
        """Let all lanes be free, and fill the tables."""
        self._call(self.BEGIN)

    def serve(self) -> None:
        """Fly the scenarios of the lanes that leave, or take others."""
        self._call(self.SERVE)

    def _call(self, what: int) -> None:
        b = self._builder
        b.call(self._function, [b.ptrtoint(self.memory, _I64), ir.Constant(_I64, what)])


def _numbers(builder: Any, given: Any) -> list[Any]:
    """Return what a kernel was given by one name, as whole numbers."""
    if isinstance(given, tuple):
        return [builder.ptrtoint(given[0], _I64), *given[1]]
    return [builder.bitcast(given, _I64) if given.type == _DOUBLE else given]


def _flying_group(spec: KernelSpec, trace: Tracer, arrays: dict[str, Any]) -> tuple[Group, Any, Any]:
    """Return the lanes of a kernel that flies, the ground, and flight's own rows, before those of the state."""
    state = arrays["state"][0]
    group = make_group(spec, trace, trace.lanes, arrays["constants"][0])
    group.state.pointer = trace.builder.gep(state, [ir.Constant(_I64, _own_size(group))], inbounds=True)
    ground = Ground(trace, arrays, *(arrays[name] for name in ("length", "steps", "substeps")))
    return group, ground, state


def _emit_events(spec: KernelSpec, builder: Any, arrays: dict[str, Any]) -> None:
    """Write a kernel whose scenarios go through its lanes one after another."""
    trace = Tracer(builder, spec.precision, width(spec.precision))
    group, ground, *_ = _flying_group(spec, trace, arrays)
    note = noter(group, _putter(trace, arrays["history"]), flag(trace, True)) if spec.history else None
    flights = CalledFlights(builder, arrays | {"passing": ir.Constant(_I64, group.passing)})
    course = Course(group, Ledger(trace, flights.shared(builder, flights.memory)).cell)
    Events(group, ground, flights, course, note).run()


def emit_flight(spec: KernelSpec, builder: Any, place: Any, what: Any) -> None:
    """Write the flight that kernels call."""
    trace = Tracer(builder, spec.precision, width(spec.precision))
    memory = builder.inttoptr(place, _I64.as_pointer())
    arrays = CalledFlights.given(trace, memory)
    group, ground, own = _flying_group(spec, trace, arrays)
    note = noter(group, _putter(trace, arrays["history"]), flag(trace, True)) if spec.history else None
    given = {name: arrays[name][0] for name in ("inputs", "results", "tables", "decays")} | {"memory": own}
    ledger = Ledger(trace, CalledFlights.shared(builder, memory))
    counts = Count(trace, arrays["rows"]), Count(trace, arrays["passing"])
    flights = make_flights(group, ground, given, Count(trace, arrays["scenarios"]), counts, note, ledger)
    for number, do in ((CalledFlights.BEGIN, flights.begin), (CalledFlights.SERVE, flights.serve)):
        for _ in when(Count(trace, what) == number):
            do()


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
                elif group.spec.only_flight:
                    value = group.full(0.0)
                elif group.spec.impulsive or not group.spec.located:
                    value = s["f1", q]
                else:
                    v = group.between(group.floors("v"), q)
                    value = group.law_of(q).pressing(s["ke", q], s["ce", q], penetration(group, q), v)
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


def write_body(spec: KernelSpec, context: Any, builder: Any, signature: Any, values: Any) -> Any:
    """Write the kernel of `spec`, or its flight, as the body of an intrinsic of numba's; returns nothing's value."""
    from numba import types
    from numba.core import cgutils

    _optimise_once(context.active_code_library)
    if spec.only_flight:
        emit_flight(spec, builder, *values)
        return context.get_dummy_value()
    found: dict[str, Any] = {}
    for name, kind, value in zip(PARAMETERS, signature.args, values, strict=True):
        found[name] = value
        if isinstance(kind, types.Array):
            array = context.make_array(kind)(context, builder, value)
            found[name] = array.data, tuple(cgutils.unpack_tuple(builder, array.shape, kind.ndim))
    emit(spec, builder, found)
    return context.get_dummy_value()
