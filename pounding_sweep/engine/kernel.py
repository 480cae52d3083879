"""A kernel: one lane group after another over the record, traced into a function that numba compiles; and its twin."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import count
from typing import Any

import numpy as np
from llvmlite import ir

from pounding_sweep import lanes as lane_code
from pounding_sweep.kernel import march
from pounding_sweep.kernel.flight import Flight, Layout
from pounding_sweep.kernel.flight_tables import Blocks, Tables
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.spec import LANES, N_ARGUMENTS, PARAMETERS, KernelSpec, history_slots, input_slots
from pounding_sweep.kernel.turns import Course, Flights, Turns, run_scenarios
from pounding_sweep.lanes import Count, Ledger, Real, Rows, Table, Tracer, count_to, lesser, narrow
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.variables.registry import output_slots, reducers_of

_I64, _DOUBLE = ir.IntType(64), ir.DoubleType()
#: Name of the compiled function.
ENTRY = "run"
#: Share of its largest size by which what flight watches is widened in windows, for rounding.
MARGIN = {"float64": 1e-12, "float32": 4e-6}


class Ground:
    """The record as a kernel steps through it, its numbers in double precision."""

    def __init__(self, trace: Tracer | None, values: Mapping[str, Any], points: Any) -> None:
        self._trace, length = trace, values["length"]
        self._wide = None if trace is None else length.trace
        self._motion = Table(self._wide, values["motion"], 1)
        #: Intervals of the record, and of the ground, which may end with one in which it comes to rest.
        self.record, self.intervals = values["record"], points - 1
        self.steps, self.substeps = values["steps"], values["substeps"]
        self.h, self.long = (narrow(trace, length / self._double(n)) for n in (self.steps, self.substeps))
        #: The ground at the ends of all steps, for lanes that each have their own.
        self.track = values["track"]

    def _double(self, n: Any) -> Any:
        """Return a whole number as one of double precision."""
        return lane_code.real(n if self._wide is None else Count(self._wide, n.value))

    def start(self) -> Any:
        """Acceleration at the first point."""
        return narrow(self._trace, self._motion.number(0, fixed=True))

    def _between(self, i: Any, j: Any) -> Any:
        share = self._double(j) / self._double(self.steps)
        first, second = (self._motion.number(lesser(at, self.intervals), fixed=True) for at in (i, i + 1))
        return first + (second - first) * share

    def ends(self, i: Any, j: Any) -> tuple[Any, Any]:
        """Accelerations at both ends of a step."""
        last = self._motion.number(lesser(i + 1, self.intervals), fixed=True)
        late = lane_code.where(j == self.steps - 1, last, self._between(i, j + 1))
        return narrow(self._trace, self._between(i, j)), narrow(self._trace, late)

    def time(self, number: Any) -> Any:
        """Time (s) after so many steps."""
        h = self.h
        if self._wide is not None and h.trace.size < 8:
            h = Real(self._wide, self._wide.builder.fpext(h.value, _DOUBLE))
        return narrow(self._trace, self._double(number) * h)


def width(precision: str) -> int:
    """Scenarios side by side in one vector: as many as a register of the processor holds."""
    return (64 if lane_code.has_wide_registers() else 32) // (8 if precision == "float64" else 4)


def make_group(spec: KernelSpec, trace: Tracer | None, lanes: int, constants: Any, memory: Any = None) -> Group:
    """Return lanes side by side under the scheme and the reducers of a kernel."""
    return Group(spec, SCHEMES[spec.scheme], reducers_of(spec), trace, lanes, constants, memory)


def state_size(spec: KernelSpec) -> tuple[int, int]:
    """Numbers of the memory that the kernel's state takes, and how many of its rows a step leaves to the next."""
    lanes = width(spec.precision)
    group = make_group(spec, None, lanes, None)
    return group.state.size * lanes + (_table_size(group) if spec.flies_exactly else 0), group.n_persistent_rows


def _table_size(group: Group) -> int:
    """Numbers of flight's own rows."""
    layout = Layout(group)
    return sum(layout.scratch.values()) * layout.lanes


@np.errstate(all="ignore")
def run_twin(spec: KernelSpec, *numbers: Any) -> None:
    """Do what the compiled kernel of `spec` does, by the same source on NumPy arrays in double precision."""
    arrays = dict(zip(PARAMETERS, numbers, strict=False))
    values = {name: x.reshape(-1) if isinstance(x, np.ndarray) else x for name, x in arrays.items()}
    _run(spec, None, values, {name: np.shape(x) for name, x in arrays.items()}, Ledger())


def emit(spec: KernelSpec, builder: Any, place: Any) -> None:
    """Write the kernel of `spec`, or its flight, where `builder` stands; `place` is the address of its frame."""
    with lane_code.tracing(
        trace := Tracer(writer := lane_code.Builder(builder.block), spec.precision, width(spec.precision))
    ):
        frame = writer.inttoptr(place, _I64.as_pointer())
        values, shapes = _read_frame(trace, frame)
        ledger = Ledger(writer.gep(frame, [_I64(N_ARGUMENTS)], inbounds=True), begins=not spec.only_flight)
        kind = ir.FunctionType(ir.VoidType(), [_I64]).as_pointer()
        fly = partial(writer.call, writer.inttoptr(values["flight"].value, kind), [place])
        _run(spec, trace, values, shapes, ledger, fly)
    builder.position_at_end(writer.block)


def _read_frame(trace: Tracer, frame: Any) -> tuple[dict[str, Any], dict[str, list[Count]]]:
    """Return what a kernel is given, by name: of arrays where they begin, and their shapes."""
    b, places, wide = trace.builder, count(), Tracer(trace.builder, "float64", trace.lanes)

    def take() -> Any:
        return b.load(b.gep(frame, [_I64(next(places))], inbounds=True))

    values, shapes = dict[str, Any](), dict[str, list[Count]]()
    for name, kind in PARAMETERS.items():
        if "[" in kind:
            values[name] = b.inttoptr(take(), (trace.real if "real" in kind else _DOUBLE).as_pointer())
            shapes[name] = [Count(trace, take()) for _ in range(1 + kind.count(","))]
        else:
            values[name] = Count(trace, take()) if kind == "int64" else Real(wide, b.bitcast(take(), _DOUBLE))
    return values, shapes


def _run(
    spec: KernelSpec,
    trace: Tracer | None,
    values: dict[str, Any],
    shapes: Mapping[str, Sequence[Any]],
    ledger: Ledger,
    fly: Callable[[], None] | None = None,
) -> None:
    """Take all scenarios of a call over the record, or write what does; `fly` calls the flight of a kernel."""
    free_running = spec.flies_exactly or spec.series  # each lane has a time and a scenario of its own
    lanes = width(spec.precision) if trace is not None or free_running else LANES
    group = make_group(spec, trace, lanes, values["constants"], values.get("state"))
    ground, columns = Ground(trace, values, shapes["motion"][0]), shapes["history"][1]
    history = Table(trace, values["history"], 1, double=True)

    def put(row: Any, column: int, value: Any) -> None:
        history.put_number(row * columns + column, lane_code.lane_of(value, 0))

    if not free_running:
        _run_groups(group, ground, values, shapes["inputs"][0], put)
        return
    note = noter(group, put, True) if spec.history else None
    if not spec.flies_exactly:
        turns = Turns(group, ground, Course(group, lane_code.Cell), *_scenarios(group, ground, values), note)
        run_scenarios(group, ground, turns.serve, turns.course, note)
        return
    if trace is not None:  # flight's own rows come before those of the state
        group.state.table.pointer = trace.builder.gep(values["state"], [_I64(_table_size(group))], inbounds=True)
    if fly is not None and not spec.only_flight:
        run_scenarios(group, ground, fly, Course(group, ledger.cell), note)
        return
    flights = make_flights(group, ground, values, note, ledger)
    if spec.only_flight:
        flights.serve()
    else:
        run_scenarios(group, ground, flights.serve, flights.course, note)


def _run_groups(group: Group, ground: Ground, values: dict[str, Any], groups: Any, put: Callable[..., None]) -> None:
    """Take one lane group after another over the record."""
    spec, trace, lanes, state = group.spec, group.trace, group.lanes, group.state
    parts = LANES // lanes
    for item in count_to(groups * parts):
        row = item // parts
        part = item - row * parts
        for i in count_to(state.size * lanes):
            state.table.put_number(i, 0.0)
        inputs, results = (
            Rows(trace, slots.count, lanes, _from(trace, values[name], at), LANES, double=True)
            for name, slots in (("inputs", input_slots(spec)), ("results", output_slots(spec)))
            for at in [row * (slots.size * LANES) + part * lanes]
        )
        for name, n in inputs.count.items():
            for i in count_to(n):
                state[name, i] = inputs[name, i]
        note = noter(group, put, part == 0) if spec.history else None
        march.begin(group, ground.start())
        if note is not None:
            note(lane_code.constant(0))

        def leave(ended: Any, results: Rows = results) -> None:
            for name, n in results.count.items():
                for i in count_to(n):
                    results.put(ended, state[name, i], name, i)

        march.FixedSteps(group, ground, note, leave).run()


def _from(trace: Tracer | None, numbers: Any, at: Any) -> Any:
    """Return numbers from one on."""
    return numbers[at:] if trace is None else trace.builder.gep(numbers, [at.value])


def _scenarios(group: Group, ground: Ground, values: Mapping[str, Any]) -> tuple[Rows, Rows, Any, Any, Any]:
    """Return what `Turns` takes of a call's scenarios: from their inputs to short steps in one of flight's grid."""
    slots = {"inputs": input_slots(group.spec), "results": output_slots(group.spec)}
    inputs, results = (Rows(group.trace, x.count, LANES, values[name], double=True) for name, x in slots.items())
    persistent = values.get("passing", group.n_persistent_rows)
    return inputs, results, values["scenarios"], persistent, ground.steps // ground.substeps


def make_flights(group: Group, ground: Any, arrays: dict[str, Any], note: Any, ledger: Ledger) -> Flights:
    """Return the flight of all scenarios of a call."""
    trace, spec, rows = group.trace, group.spec, arrays["rows"]
    points = ground.intervals * ground.substeps + 1
    flight = Flight(group, arrays["tables"], points, arrays.get("state"))
    wide = None if trace is None else Tracer(trace.builder, "float64", flight.lanes)
    common = flight, Table(wide, arrays["decays"], flight.lanes), MARGIN[spec.precision]
    course = Course(group, ledger.cell)
    if spec.blocks:
        flight.blocks = Blocks(*common, rows, ledger.cell)
    fill = flight.blocks.fill if spec.blocks else partial(Tables(*common).fill, rows)
    stops = flight.blocks.blocks if spec.blocks else points
    return Flights(flight, fill, stops, group, ground, course, *_scenarios(group, ground, arrays), note)


def noter(group: Group, put: Callable[[Any, int, Any], None], first: Any) -> Callable[[Any], None]:
    """Return what makes the state of lane 0 a row of the history, by `put` of a row's column, in the `first` lanes."""
    s, place = group.state, history_slots(group.spec)

    def note(row: Any) -> None:
        for name, n in (item for _ in lane_code.once_if(first) for item in place.count.items()):
            for q in range(n):
                if name != "force":
                    value = s[name, q]
                elif group.spec.only_flight:
                    value = group.full(0.0)
                elif group.spec.impulsive or not group.spec.located:
                    value = s["force_end", q]
                else:
                    contact = list(group.iter_contacts(static=True))[q]
                    d, v = contact.penetration(), contact.between(group.floors("v"))
                    value = contact.law.pressing(contact.k_active, contact.c_active, d, v)
                put(row, place.first[name] + q, value)

    return note


def _optimise_once(library: Any, spec: KernelSpec) -> None:
    """Have a kernel go through some of LLVM's passes, once: more take longer, and it is no faster."""
    from llvmlite import binding

    def optimise(module: Any) -> None:
        module.data_layout = str(library.codegen.target_data)
        options = binding.create_pipeline_tuning_options(speed_level=1)
        options.loop_vectorization = options.slp_vectorization = options.loop_interleaving = False
        options.loop_unrolling = False  # which takes long, and longer code
        builder = binding.create_pass_builder(library.codegen._tm, options)
        passes, beside_contacts = builder.getFunctionPassManager(), not spec.only_flight
        if beside_contacts and spec.series:  # which passes over whole modules make 2 % faster, and others no faster
            builder.getModulePassManager().run(module, builder)
            return
        if beside_contacts and spec.staged:  # what is moved out of its loops finds no register: 9 % slower
            passes = binding.create_new_function_pass_manager()
            passes.add_sroa_pass()
            passes.add_instruction_combine_pass()
            passes.add_simplify_cfg_pass()
        for function in module.functions:
            if not function.is_declaration:
                passes.run(function, builder)

    # should numba give these other names, kernels only take longer to compile
    library._optimize_functions, library._optimize_final_module = optimise, lambda: None


def compile_library(spec: KernelSpec) -> Any:
    """Compile the kernel of `spec`, or its flight: numba's library of a function `ENTRY` of the address of a frame."""
    from numba.core.codegen import JITCPUCodegen
    from numba.core.compiler_lock import global_compiler_lock

    with global_compiler_lock:
        library = JITCPUCodegen(ENTRY).create_library(ENTRY)
        library.enable_object_caching()
        module = library.create_ir_module(ENTRY)
        function = ir.Function(module, ir.FunctionType(ir.VoidType(), [_I64]), ENTRY)
        builder = ir.IRBuilder(function.append_basic_block())
        emit(spec, builder, *function.args)
        builder.ret_void()
        _optimise_once(library, spec)
        library.add_ir_module(module)
        library.finalize()
    return library
