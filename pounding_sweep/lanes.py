"""Numbers of many scenarios side by side, one per lane.

A kernel is written once, as plain functions over these values. On NumPy arrays it runs as Python, its slow, debuggable
twin; on traced values every operation adds an instruction to the LLVM function that a `Tracer` builds. `where` chooses
lane by lane, and what stands below `when_any` is left out where no lane asks for it, so it must leave all other lanes
as they are. No fast-math flag is ever set: a lane's arithmetic is fixed by the source, whatever its neighbours do.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from llvmlite.binding import get_host_cpu_features
from llvmlite.ir.instructions import LoadInstr

_I1, _I32, _I64, _SINGLE, _DOUBLE = ir.IntType(1), ir.IntType(32), ir.IntType(64), ir.FloatType(), ir.DoubleType()
#: Root of a half in single precision, as a whole number.
_ROOT_HALF = int(np.float32(0.5**0.5).view(np.int32))


@cache
def has_wide_registers() -> bool:
    """Whether code is compiled for a processor with registers of 64 bytes, and some for masks (AVX-512)."""
    features = os.environ.get("NUMBA_CPU_FEATURES")  # by which numba compiles: it takes long to load, to ask it
    return "+avx512f" in (get_host_cpu_features().flatten() if features is None else features).split(",")


@cache
def _constant(kind: Any, text: str) -> Any:
    """Return a constant of LLVM, one object for the same number: its text is written once."""
    return ir.Constant(kind, float(text) if kind in (_SINGLE, _DOUBLE) else int(text))


@cache
def _spread(x: Any, lanes: int) -> Any:
    return ir.Constant(ir.VectorType(x.type, lanes), [x.constant] * lanes)


def _once(name: str) -> Any:
    def write(self: Builder, *operands: Any, **options: Any) -> Any:
        parts = (x if isinstance(x, list | ir.Type) else [x] for x in operands)
        key = name, *(x if isinstance(x, ir.Type) else tuple(map(id, x)) for x in parts)
        if key not in self.written:
            self.written[key] = getattr(ir.IRBuilder, name)(self, *operands, **options), operands
        return self.written[key][0]

    return write


class Builder(ir.IRBuilder):
    """A builder that writes the same address or whole number once, where what follows has it."""

    add, sub, mul, bitcast, gep = map(_once, ("add", "sub", "mul", "bitcast", "gep"))

    def __init__(self, block: Any) -> None:
        super().__init__(block)
        #: Values by how they are written; their operands, whose identities tell them apart, last as long.
        self.written: dict[Any, Any] = {}

    @contextmanager
    def if_then(self, pred: Any, likely: bool | None = None) -> Iterator[Any]:
        """Write what may be passed over, so that nothing of it is there afterwards."""
        count = len(self.written)
        with super().if_then(pred, likely) as end:
            yield end
        while len(self.written) > count:
            self.written.popitem()


class Tracer:
    """The LLVM function that is being built."""

    # builder: stands where the next instruction goes
    # real: number format of the lanes
    # lanes: scenarios side by side

    def __init__(self, builder: Any, precision: str, lanes: int) -> None:
        self.builder, self.lanes, self.module = builder, lanes, builder.module
        self.real = _DOUBLE if precision == "float64" else _SINGLE
        self.size = 8 if precision == "float64" else 4
        self.vector, self.truths, self.integers = (ir.VectorType(kind, lanes) for kind in (self.real, _I1, _I64))
        #: A mask: of processors that keep masks in vectors, as wide as numbers, all bits of a lane alike.
        self.mask = self.truths if has_wide_registers() else ir.VectorType(ir.IntType(8 * self.size), lanes)

    def number(self, x: float) -> Any:
        """Return a constant, narrowed to what the number format holds."""
        x = float(x)
        if self.size == 4 and x != 0.0 and np.isfinite(x):
            x = float(np.float32(np.copysign(min(max(abs(x), 1e-37), 1e38), x)))
        return _constant(self.real, repr(x))

    def spread(self, x: Any) -> Any:
        """Return a value in all lanes."""
        kind = ir.VectorType(x.type, self.lanes)
        if isinstance(x, ir.Constant):
            return _spread(x, self.lanes)
        one = self.builder.insert_element(ir.Constant(kind, ir.Undefined), x, ir.Constant(_I32, 0))
        return self.shuffle(one, ir.Constant(kind, ir.Undefined), [0] * self.lanes)

    def shuffle(self, a: Any, b: Any, order: Sequence[int]) -> Any:
        """Return lanes of two vectors in an order, those of the second counted after those of the first."""
        return self.builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_I32, self.lanes), [*order]))

    def call(self, name: str, *arguments: Any) -> Any:
        """Call an LLVM intrinsic of one vector type."""
        full = f"llvm.{name}.v{self.lanes}f{8 * self.size}"
        kind = ir.FunctionType(self.vector, [self.vector] * len(arguments))
        function = self.module.globals.get(full) or ir.Function(self.module, kind, full)
        return self.builder.call(function, arguments)

    def load(self, pointer: Any, kind: Any, align: int, fixed: bool = False) -> Any:
        """Load a value; a `fixed` one never changes while the kernel runs."""
        value = self.builder.load(self.builder.bitcast(pointer, kind.as_pointer()))
        value.align = align
        if fixed:
            value.set_metadata("invariant.load", self.module.add_metadata([]))
        return value

    def go_round(self, asks: Callable[[], Any]) -> Iterator[None]:
        """Go round while a truth holds that is worked out before each round."""
        b = self.builder
        b.branch(head := b.append_basic_block("ask"))
        b.position_at_end(head)
        with b.if_then(asks()):
            yield
            b.branch(head)


def _lifted(a: Any, b: Any) -> tuple[Tracer, Any, Any, Any]:
    """Return two values, of which one is traced, in the same form, after its tracer and this form."""
    traced = b if not isinstance(a, Value) or (isinstance(b, Value) and b.per_lane) else a
    trace, form = traced.trace, _FORMS[traced.kind, traced.per_lane]
    return trace, form, form.lift(trace, a), form.lift(trace, b)


def _operator(**instructions: str) -> tuple[Any, Any]:
    """Return an operator and the one of its other side: an instruction for each kind of value."""

    def apply(a: Any, b: Any) -> Any:
        trace, form, *operands = _lifted(a, b)
        return form(trace, getattr(trace.builder, instructions[form.kind])(*operands))

    return apply, lambda self, other: apply(other, self)


def _comparison(sign: str) -> Any:
    def compare(a: Any, b: Any) -> Any:
        trace, form, *operands = _lifted(a, b)
        truth = getattr(trace.builder, "fcmp_ordered" if form.kind == "number" else "icmp_signed")(sign, *operands)
        return Mask.compared(trace, truth) if form.per_lane else Flag(trace, truth)

    return compare


def _unary(instruction: str) -> Any:
    return lambda x: type(x)(x.trace, getattr(x.trace.builder, instruction)(x.value))


class Value:
    """A traced value: truths, whole numbers or numbers, one for all lanes or one per lane."""

    __hash__ = None  # type: ignore[assignment]
    kind: str
    per_lane: bool

    __add__, __radd__ = _operator(number="fadd", integer="add")
    __sub__, __rsub__ = _operator(number="fsub", integer="sub")
    __mul__, __rmul__ = _operator(number="fmul", integer="mul")
    __truediv__, __rtruediv__ = _operator(number="fdiv")
    __floordiv__, _ = _operator(integer="sdiv")
    __and__, __rand__ = _operator(truth="and_")
    __or__, __ror__ = _operator(truth="or_")
    __neg__, __invert__ = _unary("fneg"), _unary("not_")
    __lt__, __le__, __gt__, __ge__, __eq__ = map(_comparison, ("<", "<=", ">", ">=", "=="))

    def __init__(self, trace: Tracer, value: Any) -> None:
        self.trace, self.value = trace, value

    def __bool__(self) -> bool:
        raise TypeError("a traced value is not known while it is traced: use `where`, `once_if` or `when_any`")

    @classmethod
    def lift(cls, trace: Tracer, x: Any) -> Any:
        """Return LLVM's value of x, known or traced, in this form."""
        if isinstance(x, Value):
            return trace.spread(x.value) if cls.per_lane and not x.per_lane else x.value
        if cls is Mask:
            return ir.Constant(trace.mask, [-int(bool(x))] * trace.lanes)
        literal = trace.number(x) if cls.kind == "number" else _constant(_INTEGERS[cls.kind], str(int(x)))
        return trace.spread(literal) if cls.per_lane else literal


class Flag(Value):
    """One truth for all lanes."""

    kind, per_lane = "truth", False


class Mask(Value):
    """One truth per lane."""

    kind, per_lane = "truth", True

    def __init__(self, trace: Tracer, value: Any, truths: Any = None) -> None:
        super().__init__(trace, value)
        self._truths = value if trace.mask is trace.truths else truths

    @classmethod
    def compared(cls, trace: Tracer, truths: Any) -> Mask:
        """Return what a comparison found."""
        if trace.mask is trace.truths:
            return cls(trace, truths)
        # LLVM would pack truths that are combined into bytes, and unpack them again: it must not see that they are some
        wide = trace.builder.bitcast(trace.builder.sext(truths, trace.mask), trace.vector)
        return cls(trace, trace.builder.bitcast(trace.call("arithmetic.fence", wide), trace.mask), truths)

    @property
    def truths(self) -> Any:
        """LLVM's truths."""
        if self._truths is None:
            none = ir.Constant(self.value.type, [0] * self.trace.lanes)
            return self.trace.builder.icmp_signed("<", self.value, none)
        return self._truths


class Count(Value):
    """One whole number for all lanes."""

    kind, per_lane = "integer", False


class Counts(Value):
    """One whole number per lane."""

    kind, per_lane = "integer", True


class Real(Value):
    """One number for all lanes."""

    kind, per_lane = "number", False


class Vector(Value):
    """One number per lane."""

    kind, per_lane = "number", True


_INTEGERS = {"truth": _I1, "integer": _I64}
_FORMS: dict[tuple[str, bool], type[Value]] = {
    (x.kind, x.per_lane): x for x in (Flag, Mask, Count, Counts, Real, Vector)
}


#: The function that is being built; none: everything is done by NumPy, at once.
_TRACER: ContextVar[Tracer | None] = ContextVar("tracer", default=None)


@contextmanager
def tracing(tracer: Tracer) -> Iterator[None]:
    """Let loops, branches and variables below become instructions of a function."""
    token = _TRACER.set(tracer)
    try:
        yield
    finally:
        _TRACER.reset(token)


def _trace_of(*values: Any) -> Tracer | None:
    trace = None
    for x in values:
        if isinstance(x, Value):
            trace = x.trace
            if x.per_lane:
                break
    return trace


def constant(x: Any) -> Any:
    """Return a truth, a whole or a real number that is known beforehand, traced where a function is being built."""
    trace = _TRACER.get()
    if trace is None or isinstance(x, Value):
        return x
    form = Flag if isinstance(x, bool) else Count if isinstance(x, int) else Real
    return form(trace, form.lift(trace, x))


def _function(name: str, twin: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function of numbers: an LLVM intrinsic, or its twin on arrays."""

    def apply(*values: Any) -> Any:
        trace = _trace_of(*values)
        if trace is None:
            return twin(*values)
        return Vector(trace, trace.call(name, *(Vector.lift(trace, x) for x in values)))

    return apply


#: a b + c, rounded once where it is traced.
fma = _function("fma", lambda a, b, c: a * b + c)
#: Square root, absolute value, and x to a power.
sqrt, size, power = _function("sqrt", np.sqrt), _function("fabs", np.abs), _function("pow", np.power)


#: Binary logarithm of the largest number that `roughly_power` finds.
MOST_DOUBLINGS = 120.0


def roughly_power(x: Any, exponent: float) -> Any:
    """Return x >= 0 to a power, to six figures: for lengths of steps. `power` asks a library, lane by lane."""
    # nothing is larger or smaller than 2**MOST_DOUBLINGS and its inverse, which stands for zero
    log2 = [2.0 / (math.log(2.0) * k) for k in (1, 3, 5, 7, 9)]
    exp2 = [math.log(2.0) ** k / math.factorial(k) for k in range(8)]
    trace = _trace_of(x)
    # in single precision: x is `rest`, from the root of a half to that of two, as often doubled as `halvings` says
    halvings: Any
    rest: Any
    if trace is None:
        bits = np.asarray(x, np.float32).view(np.int32)
        halvings = (bits - _ROOT_HALF) >> 23
        rest, halvings = (bits - (halvings << 23)).view(np.float32), halvings.astype(np.float32)
    else:
        b, t = trace.builder, Tracer(trace.builder, "float32", trace.lanes)
        integers = ir.VectorType(_I32, trace.lanes)
        root_half, shift = (ir.Constant(integers, [number] * trace.lanes) for number in (_ROOT_HALF, 23))
        bits = b.bitcast(x.value if trace.size == 4 else b.fptrunc(x.value, t.vector), integers)
        halvings = b.ashr(b.sub(bits, root_half), shift)
        rest = Vector(t, b.bitcast(b.sub(bits, b.shl(halvings, shift)), t.vector))
        halvings = Vector(t, b.sitofp(halvings, t.vector))
    z = (rest - 1.0) / (rest + 1.0)
    y = minimum(maximum((halvings + z * _sum_up(log2, z * z)) * exponent, -MOST_DOUBLINGS), MOST_DOUBLINGS)
    y0 = where(y < 0.0, y - 0.5, y + 0.5)
    if trace is None:
        doublings = y0.astype(np.int32)
        result = _sum_up(exp2, y - doublings.astype(np.float32)).view(np.int32) + (doublings << 23)
        return result.view(np.float32).astype(float)
    doublings = b.fptosi(y0.value, integers)
    result = b.bitcast(_sum_up(exp2, y - Vector(t, b.sitofp(doublings, t.vector))).value, integers)
    result = b.bitcast(b.add(result, b.shl(doublings, shift)), t.vector)
    return Vector(trace, result if trace.size == 4 else b.fpext(result, trace.vector))


def _sum_up(coefficients: Sequence[float], at: Any) -> Any:
    """Sum of a polynomial, each step rounded."""
    total: Any = coefficients[-1]
    for coefficient in reversed(coefficients[:-1]):
        total = total * at + coefficient
    return total


def where(condition: Any, a: Any, b: Any) -> Any:
    """Return a in the lanes of a mask (or at a flag), b elsewhere."""
    return _where(condition, a, b, fenced=True)


def _where(condition: Any, a: Any, b: Any, fenced: bool) -> Any:
    trace = _trace_of(condition, a, b)
    if trace is None:
        return np.where(condition, a, b)
    traced = next((x for x in (a, b) if isinstance(x, Value)), None)
    wide = not isinstance(condition, Flag) or any(isinstance(x, Value) and x.per_lane for x in (a, b))
    form = _FORMS[traced.kind if traced is not None else "number", wide]
    branches = [form.lift(trace, x) for x in (a, b)]
    if fenced and form is Vector and isinstance(condition, Mask):
        # what is chosen and written where one of both was read would become a masked store: tens of cycles on many
        # processors without AVX-512, and it hands its value to no load before the cache has it
        branches = [trace.call("arithmetic.fence", x) if isinstance(x, LoadInstr) else x for x in branches]
    return form(
        trace, trace.builder.select(condition.value if isinstance(condition, Flag) else condition.truths, *branches)
    )


def maximum(a: Any, b: Any) -> Any:
    """Return the larger number; a where b is none."""
    return _where(a < b, b, a, fenced=False)


def minimum(a: Any, b: Any) -> Any:
    """Return the smaller number; a where b is none."""
    return _where(a > b, b, a, fenced=False)


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


def any_lane(mask: Any) -> Any:
    """Whether a mask holds in any lane."""
    trace = _trace_of(mask)
    if trace is None:
        return bool(np.any(mask))
    integer = ir.IntType(trace.lanes)
    bits = trace.builder.bitcast(mask.truths, integer)
    return Flag(trace, trace.builder.icmp_unsigned("!=", bits, ir.Constant(integer, 0)))


@contextmanager
def when_any(mask: Any) -> Iterator[None]:
    """Leave out what follows where no lane asks for it; it must leave all other lanes as they are."""
    trace = _trace_of(mask)
    if trace is None:
        with np.errstate(all="ignore"):
            yield
        return
    with trace.builder.if_then(any_lane(mask).value):
        yield


def once_if(flag: Any) -> Iterator[None]:
    """Go once through what follows if `flag` holds: ``for _ in once_if(flag)``."""
    trace = _trace_of(flag)
    if trace is None:
        if flag:
            yield
        return
    with trace.builder.if_then(flag.value):
        yield


def count_to(n: Any) -> Iterator[Any]:
    """Count from 0 to n - 1, at run time where a function is being built."""
    trace = _TRACER.get()
    if trace is None:
        yield from range(n)
        return
    number = Cell(0)
    now: list[Count] = []

    def asks() -> Any:
        now[:] = [number.now]
        return (now[0] < n).value

    for _ in trace.go_round(asks):
        yield now[0]
        number.now = now[0] + 1


def while_any(asks: Callable[[], Any], at_most: int = 0) -> Iterator[None]:
    """Go round while any lane asks for it, `at_most` so often (0: without end); `asks` is called before each round."""
    trace = _TRACER.get()
    if trace is None:
        rounds = 0
        while bool(np.any(asks())) and (not at_most or rounds < at_most):
            rounds += 1
            yield
        return
    left = Cell(at_most) if at_most else None

    def condition() -> Any:
        active = asks()
        flag = any_lane(active) if isinstance(active, Mask) else active
        return (flag & (left.now > 0) if left is not None else flag).value

    for _ in trace.go_round(condition):
        yield
        if left is not None:
            left.now -= 1


class Cell:
    """A variable that branches and loops may change; at a `place` in memory, what it is there stays."""

    def __init__(self, x: Any, place: Any = None) -> None:
        x = constant(x)
        self._trace, self._form, self._x, self._place = _trace_of(x), type(x), x, place
        if self._trace is not None and place is None:
            with self._trace.builder.goto_entry_block():
                self._place = self._trace.builder.alloca(x.value.type)
            self.now = x

    @property
    def now(self) -> Any:
        """Its value."""
        if self._trace is not None:
            return self._form(self._trace, self._trace.builder.load(self._place))
        return self._x.copy() if isinstance(self._x, np.ndarray) else self._x  # `cell.now |= x` changes arrays in place

    @now.setter
    def now(self, x: Any) -> None:
        if self._trace is None:
            self._x = x
        else:
            self._trace.builder.store(self._form.lift(self._trace, x), self._place)

    def _one(self, lane: Any) -> tuple[Any, type[Value]]:
        """Where the number of one lane lies, and its form."""
        b = self._trace.builder  # type: ignore[union-attr]
        numbers = b.bitcast(self._place, self._place.type.pointee.element.as_pointer())
        return b.gep(numbers, [lane.value], inbounds=True), _FORMS[self._form.kind, False]

    def lane(self, lane: Any) -> Any:
        """Return the number of one lane."""
        if self._trace is None:
            return self._x[lane]
        place, form = self._one(lane)
        return form(self._trace, self._trace.builder.load(place))

    def put_lane(self, lane: Any, x: Any) -> None:
        """Change the number of one lane."""
        if self._trace is None:
            self._x = self._x.copy()
            self._x[lane] = x
            return
        place, form = self._one(lane)
        self._trace.builder.store(form.lift(self._trace, x), place)


class Ledger:
    """Variables that several functions of a kernel share, `CELL_BYTES` bytes of memory for each."""

    # pointer: where they begin: whole numbers; None: NumPy, where all is one function
    # begins: whether they have their first values from this function

    #: Of the widest variable, a whole number of each lane, and what it is aligned to.
    CELL_BYTES = 128

    def __init__(self, pointer: Any = None, begins: bool = True) -> None:
        self._pointer, self._begins, self._count = pointer, begins, 0

    def cell(self, x: Any) -> Cell:
        """Return the next variable, of a first value."""
        x = constant(x)
        trace = _trace_of(x)
        if trace is None:
            return Cell(x)
        at = self._count * (self.CELL_BYTES // 8)
        self._count += 1
        place = trace.builder.gep(self._pointer, [ir.Constant(_I64, at)], inbounds=True)
        cell = Cell(x, trace.builder.bitcast(place, x.value.type.as_pointer()))
        if self._begins:
            cell.now = x
        return cell


class Table:
    """Numbers one after another, of the kernel's format or in `double` precision: one, or one in each lane."""

    # trace: None: NumPy, whose `pointer` is a flat array
    # pointer: where the first of them lies

    def __init__(self, trace: Tracer | None, pointer: Any, lanes: int, double: bool = False) -> None:
        self.trace, self.pointer, self.lanes, self._double = trace, pointer, lanes, double

    def number(self, at: Any, fixed: bool = False) -> Any:
        """Return one of them."""
        return self.pointer[at] if self.trace is None else self._read(Real, at, fixed)

    def vector(self, at: Any) -> Any:
        """Return as many as there are lanes, from one on."""
        return self.pointer[at : at + self.lanes].copy() if self.trace is None else self._read(Vector, at)

    def put_number(self, at: Any, x: Any) -> None:
        """Write one of them."""
        if self.trace is None:
            self.pointer[at] = x
        else:
            self._write(Real, at, x)

    def put_vector(self, at: Any, x: Any) -> None:
        """Write as many as there are lanes, from one on."""
        if self.trace is None:
            self.pointer[at : at + self.lanes] = x
        else:
            self._write(Vector, at, x)

    def _place(self, form: type[Value], at: Any) -> tuple[Any, Any, Any]:
        """Where numbers lie, and LLVM's types of the format of the lanes and of that in which they are stored."""
        t: Any = self.trace
        place = t.builder.gep(self.pointer, [Count.lift(t, at)], True)
        number = _DOUBLE if self._double else t.real
        return (place, t.vector, ir.VectorType(number, t.lanes)) if form is Vector else (place, t.real, number)

    def _read(self, form: type[Value], at: Any, fixed: bool = False) -> Any:
        t: Any = self.trace
        place, kind, stored = self._place(form, at)
        x = t.load(place, stored, 8 if self._double else t.size, fixed)
        return form(t, x if kind == stored else t.builder.fptrunc(x, kind))

    def _write(self, form: type[Value], at: Any, x: Any) -> None:
        t: Any = self.trace
        value = form.lift(t, x)
        place, _, stored = self._place(form, at)
        if value.type != stored:
            value = (t.builder.fpext if self._double or t.size == 8 else t.builder.fptrunc)(value, stored)
        t.builder.store(value, t.builder.bitcast(place, stored.as_pointer())).align = 8 if self._double else t.size


class Rows:
    """Named rows of lanes in one flat table: ``rows[name, i]``."""

    # trace: None: NumPy
    # counts: rows of each name
    # lanes: lanes of the kernel
    # pointer: where the first lane of the first row lies
    # stride: numbers from one row to the next; `lanes` unless given

    def __init__(
        self,
        trace: Tracer | None,
        counts: Mapping[str, int],
        lanes: int,
        pointer: Any = None,
        stride: int = 0,
        double: bool = False,
    ) -> None:
        self.trace, self.first, self.count, self.size = trace, {}, counts, 0
        for name, count in counts.items():
            self.first[name] = self.size
            self.size += count
        self._stride = stride or lanes
        if trace is None:
            pointer = np.zeros(self.size * self._stride) if pointer is None else pointer.reshape(-1)
        self.table = Table(trace, pointer, lanes, double)

    def _row(self, key: Any) -> Any:
        name, i = key if isinstance(key, tuple) else (key, 0)
        if isinstance(i, int) and not 0 <= i < self.count[name]:
            raise IndexError(f"row {name}[{i}] of {self.count[name]}")
        return (self.first[name] + i) * self._stride

    def __getitem__(self, key: Any) -> Any:
        return self.table.vector(self._row(key))

    def __setitem__(self, key: Any, x: Any) -> None:
        self.table.put_vector(self._row(key), x)

    def put(self, lanes: Any, x: Any, name: str, i: Any = 0) -> None:
        """Write a row in some lanes (None: all)."""
        self[name, i] = x if lanes is None else where(lanes, x, self[name, i])

    def lane(self, row: Any, lane: Any) -> Any:
        """Return a lane's number in a row, by the row's number."""
        return self.table.number(row * self._stride + lane)

    def put_lane(self, row: Any, lane: Any, x: Any) -> None:
        """Write a lane's number in a row."""
        self.table.put_number(row * self._stride + lane, x)

    def number(self, name: str, i: Any) -> Any:
        """Return number `i` of the rows of a name, which lie one after another."""
        return self.table.number(self.first[name] * self._stride + i)

    def vector(self, name: str, i: Any) -> Any:
        """Return as many numbers as there are lanes, from number `i` of the rows of a name on."""
        return self.table.vector(self.first[name] * self._stride + i)

    def put_number(self, name: str, i: Any, x: Any) -> None:
        """Write number `i` of the rows of a name."""
        self.table.put_number(self.first[name] * self._stride + i, x)


def narrow(trace: Tracer | None, x: Any) -> Any:
    """Return numbers of double precision in the format of `trace`."""
    if trace is None or x.trace.size == trace.size:
        return x if trace is None else type(x)(trace, x.value)
    return type(x)(trace, trace.builder.fptrunc(x.value, trace.vector if isinstance(x, Vector) else trace.real))


def side_by_side(trace: Tracer | None, numbers: Sequence[Any]) -> Any:
    """Return numbers, as many as there are lanes, in these."""
    if trace is None:
        return np.array(numbers, float)
    vector = ir.Constant(trace.vector, [0.0 if isinstance(x, Real) else trace.number(x).constant for x in numbers])
    for i, x in enumerate(numbers):
        if isinstance(x, Real):
            vector = trace.builder.insert_element(vector, x.value, ir.Constant(_I32, i))
    return Vector(trace, vector)


def shifted(x: Any) -> Any:
    """Return each lane's next neighbour; the last lane's is its own."""
    trace = _trace_of(x)
    if trace is None:
        return np.append(x[1:], x[-1])
    return Vector(trace, trace.shuffle(x.value, x.value, [*range(1, trace.lanes), trace.lanes - 1]))


def transposed(rows: Sequence[Any]) -> list[Any]:
    """Of as many vectors as there are lanes, let those be lanes that were vectors."""
    trace = _trace_of(*rows)
    if trace is None:
        return list(np.array(rows).T)
    vectors, n = list(rows), trace.lanes
    distance = n // 2
    while distance:  # squares of so many change places
        low = [i if not i & distance else n + i - distance for i in range(n)]
        high = [i + distance if not i & distance else n + i for i in range(n)]
        for i in (i for i in range(n) if not i & distance):
            a, b = vectors[i].value, vectors[i + distance].value
            for place, order in ((i, low), (i + distance, high)):
                vectors[place] = Vector(trace, trace.shuffle(a, b, order))
        distance //= 2
    return vectors


def fold(x: Any, combine: Callable[[Any, Any], Any]) -> Any:
    """Combine the numbers of all lanes into one, halves first."""
    trace = _trace_of(x)
    n = lanes = len(x) if trace is None else trace.lanes
    while n > 1:
        n //= 2
        order = [(i + n) % lanes for i in range(lanes)]
        x = combine(x, x[order] if trace is None else Vector(trace, trace.shuffle(x.value, x.value, order)))
    return lane_of(x, 0)


def lane_of(x: Any, lane: Any) -> Any:
    """Return the number (whole or real) of a lane."""
    trace = _trace_of(x)
    if trace is None:
        return x[lane]
    number = trace.builder.extract_element(x.value, lane.value if isinstance(lane, Count) else ir.Constant(_I32, lane))
    return _FORMS[x.kind, False](trace, number)


def _bits(mask: Mask) -> Any:
    """Truths of all lanes as the bits of a whole number."""
    t = mask.trace
    return t.builder.zext(t.builder.bitcast(mask.truths, ir.IntType(t.lanes)), _I64)


def first_true(mask: Any) -> Any:
    """Return the first lane in which a mask holds; the number of lanes where it holds in none."""
    trace = _trace_of(mask)
    if trace is None:
        return int(np.argmax(mask)) if np.any(mask) else len(mask)
    bits = trace.builder.or_(_bits(mask), ir.Constant(_I64, 1 << trace.lanes))
    return Count(trace, trace.builder.cttz(bits, ir.Constant(_I1, 1)))


def iter_lanes(mask: Any) -> Iterator[Any]:
    """Go through the lanes in which a mask holds."""
    trace = _trace_of(mask)
    if trace is None:
        yield from np.flatnonzero(mask)
        return
    b, left = trace.builder, Cell(Count(trace, _bits(mask)))
    for _ in trace.go_round(lambda: b.icmp_signed("!=", left.now.value, ir.Constant(_I64, 0))):
        bits = left.now.value
        lane = Count(trace, b.cttz(bits, ir.Constant(_I1, 1)))
        left.now = Count(trace, b.and_(bits, b.sub(bits, ir.Constant(_I64, 1))))
        yield lane


def lesser(a: Any, b: Any) -> Any:
    """Return the smaller of two whole numbers."""
    return where(a < b, a, b) if isinstance(a, Count) else min(a, b)


class Lookup:
    """Numbers that are known beforehand, to be looked up at run time: whole ones, or all in the kernel's format."""

    def __init__(self, numbers: Sequence[float]) -> None:
        self._numbers = list(numbers)

    def __getitem__(self, i: Any) -> Any:
        if not isinstance(i, Count):
            return self._numbers[i]
        t, form = i.trace, Count if all(isinstance(x, int) for x in self._numbers) else Real
        numbers = self._numbers if form is Count else [t.number(x).constant for x in self._numbers]
        kind = ir.ArrayType(_I64 if form is Count else t.real, len(numbers))
        name = "_".join(map(str, ["table", kind.element, *numbers]))
        if name not in t.module.globals:
            table = ir.GlobalVariable(t.module, kind, name)
            table.linkage, table.global_constant, table.initializer = "internal", True, ir.Constant(kind, numbers)
        place = t.builder.gep(t.module.globals[name], [ir.Constant(_I64, 0), i.value], inbounds=True)
        return form(t, t.builder.load(place))


def everywhere(trace: Tracer | None, x: Any, lanes: int) -> Any:
    """Return a truth or a number, whole or real, in all lanes: as it is where it is there."""
    if trace is None:
        return np.array(np.broadcast_to(x, lanes))
    form = Mask if isinstance(x, bool) else Counts if isinstance(x, int) else Vector
    return x if isinstance(x, form) else form(trace, form.lift(trace, x))


def not_(x: Any) -> Any:
    """Whether a truth does not hold."""
    return ~x if isinstance(x, Flag) else not x


def real(x: Any) -> Any:
    """Return a whole number as a real one."""
    return Real(x.trace, x.trace.builder.sitofp(x.value, x.trace.real)) if isinstance(x, Count) else float(x)


def rounded(x: Any) -> Any:
    """Return a real number that is whole as a whole one."""
    return Count(x.trace, x.trace.builder.fptosi(x.value, _I64)) if isinstance(x, Real) else int(x)
