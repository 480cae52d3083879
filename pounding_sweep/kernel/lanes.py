"""Numbers of many scenarios side by side, one per lane.

A kernel is written once, as plain functions over these values. On NumPy arrays it runs as
Python, which is its slow, debuggable twin. On traced values every operation adds an
instruction to the LLVM function that a `Tracer` builds, and a loop adds its blocks.

What depends on lanes is written with masks: `where` chooses lane by lane, and what stands
below `when_any` is left out where no lane asks for it, so it must leave all other lanes as
they are. No fast-math flag is ever set: a lane's arithmetic is fixed by the source,
whatever its neighbours do.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from llvmlite.binding import get_host_cpu_features
from llvmlite.ir.instructions import LoadInstr

_I1, _I32, _I64 = ir.IntType(1), ir.IntType(32), ir.IntType(64)
#: Root of a half in single precision, as a whole number.
_ROOT_HALF = int(np.float32(0.5**0.5).view(np.int32))


@cache
def has_wide_registers() -> bool:
    """Whether code is compiled for a processor with registers of 64 bytes, and some for masks (AVX-512)."""
    from numba.core import config

    given = config.CPU_FEATURES  # type: ignore[attr-defined]
    return "+avx512f" in (given if given is not None else get_host_cpu_features().flatten()).split(",")


class Tracer:
    """The LLVM function that is being built."""

    # builder: stands where the next instruction goes
    # real: number format of the lanes
    # lanes: scenarios side by side

    def __init__(self, builder: Any, precision: str, lanes: int) -> None:
        self.builder, self.lanes, self.module = builder, lanes, builder.module
        self.real = ir.DoubleType() if precision == "float64" else ir.FloatType()
        self.size = 8 if precision == "float64" else 4
        self.vector, self.truths, self.whole = (ir.VectorType(kind, lanes) for kind in (self.real, _I1, _I64))
        #: A mask: of processors that keep masks in vectors, as wide as numbers, all bits of a lane alike.
        self.mask = self.truths if has_wide_registers() else ir.VectorType(ir.IntType(8 * self.size), lanes)

    def number(self, x: float) -> Any:
        """Return a constant, narrowed to what the number format holds."""
        x = float(x)
        if self.size == 4 and x != 0.0 and np.isfinite(x):
            x = float(np.float32(np.copysign(min(max(abs(x), 1e-37), 1e38), x)))
        return ir.Constant(self.real, x)

    def spread(self, x: Any) -> Any:
        """Return a value in all lanes."""
        kind = ir.VectorType(x.type, self.lanes)
        if isinstance(x, ir.Constant):
            return ir.Constant(kind, [x.constant] * self.lanes)
        one = self.builder.insert_element(ir.Constant(kind, ir.Undefined), x, ir.Constant(_I32, 0))
        order = ir.Constant(ir.VectorType(_I32, self.lanes), [0] * self.lanes)
        return self.builder.shuffle_vector(one, ir.Constant(kind, ir.Undefined), order)

    def call(self, name: str, *given: Any) -> Any:
        """Call an LLVM intrinsic of one vector type."""
        full = f"llvm.{name}.v{self.lanes}f{8 * self.size}"
        kind = ir.FunctionType(self.vector, [self.vector] * len(given))
        function = self.module.globals.get(full) or ir.Function(self.module, kind, full)
        return self.builder.call(function, given)

    def place(self, kind: Any) -> Any:
        """Reserve room for a value on the stack."""
        with self.builder.goto_entry_block():
            return self.builder.alloca(kind)

    def load(self, pointer: Any, kind: Any, align: int, fixed: bool = False) -> Any:
        """Load a value; a `fixed` one never changes while the kernel runs."""
        found = self.builder.load(self.builder.bitcast(pointer, kind.as_pointer()))
        found.align = align
        if fixed:
            found.set_metadata("invariant.load", self.module.add_metadata([]))
        return found


class Value:
    """A traced value."""

    __hash__ = None  # type: ignore[assignment]

    def __init__(self, trace: Tracer, value: Any) -> None:
        self.trace, self.value = trace, value

    def __bool__(self) -> bool:
        msg = "a traced value is not known while it is traced: use `where`, `when` or `when_any`"
        raise TypeError(msg)


class Flag(Value):
    """One truth for all lanes."""

    def __invert__(self) -> Flag:
        return Flag(self.trace, self.trace.builder.not_(self.value))

    def __and__(self, other: Flag) -> Flag:
        return Flag(self.trace, self.trace.builder.and_(self.value, other.value))

    def __or__(self, other: Flag) -> Flag:
        return Flag(self.trace, self.trace.builder.or_(self.value, other.value))


class Mask(Value):
    """One truth per lane."""

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

    def _of(self, other: Any) -> Any:
        return other.value if isinstance(other, Mask) else _mask(self.trace, bool(other))

    def __and__(self, other: Any) -> Mask:
        return Mask(self.trace, self.trace.builder.and_(self.value, self._of(other)))

    def __or__(self, other: Any) -> Mask:
        return Mask(self.trace, self.trace.builder.or_(self.value, self._of(other)))

    def __invert__(self) -> Mask:
        return Mask(self.trace, self.trace.builder.not_(self.value))


def _mask(trace: Tracer, x: bool) -> Any:
    """Return one truth in all lanes, as LLVM's mask."""
    return ir.Constant(trace.mask, [-int(x)] * trace.lanes)


class Count(Value):
    """One whole number for all lanes."""

    __hash__ = None

    def _of(self, other: Any) -> Any:
        return other.value if isinstance(other, Count) else ir.Constant(_I64, int(other))

    def __add__(self, other: Any) -> Count:
        return Count(self.trace, self.trace.builder.add(self.value, self._of(other)))

    def __sub__(self, other: Any) -> Count:
        return Count(self.trace, self.trace.builder.sub(self.value, self._of(other)))

    def __rsub__(self, other: Any) -> Count:
        return Count(self.trace, self.trace.builder.sub(self._of(other), self.value))

    def __mul__(self, other: Any) -> Count:
        return Count(self.trace, self.trace.builder.mul(self.value, self._of(other)))

    def __floordiv__(self, other: Any) -> Count:
        return Count(self.trace, self.trace.builder.sdiv(self.value, self._of(other)))

    __radd__, __rmul__ = __add__, __mul__

    def _compare(self, sign: str, other: Any) -> Flag:
        return Flag(self.trace, self.trace.builder.icmp_signed(sign, self.value, self._of(other)))

    def __eq__(self, other: Any) -> Flag:  # type: ignore[override]
        return self._compare("==", other)

    def __lt__(self, other: Any) -> Flag:
        return self._compare("<", other)

    def __gt__(self, other: Any) -> Flag:
        return self._compare(">", other)

    def __ge__(self, other: Any) -> Flag:
        return self._compare(">=", other)


class Counts(Value):
    """One whole number per lane."""

    __hash__ = None

    def _of(self, other: Any) -> Any:
        if isinstance(other, Counts):
            return other.value
        return self.trace.spread(other.value if isinstance(other, Count) else ir.Constant(_I64, int(other)))

    def __add__(self, other: Any) -> Counts:
        return Counts(self.trace, self.trace.builder.add(self.value, self._of(other)))

    __radd__ = __add__

    def __mul__(self, other: Any) -> Counts:
        return Counts(self.trace, self.trace.builder.mul(self.value, self._of(other)))

    def _compare(self, sign: str, other: Any) -> Mask:
        return Mask.compared(self.trace, self.trace.builder.icmp_signed(sign, self.value, self._of(other)))

    def __eq__(self, other: Any) -> Mask:  # type: ignore[override]
        return self._compare("==", other)

    def __lt__(self, other: Any) -> Mask:
        return self._compare("<", other)

    def __ge__(self, other: Any) -> Mask:
        return self._compare(">=", other)


_OPERATORS = {"add": "fadd", "sub": "fsub", "mul": "fmul", "truediv": "fdiv"}
_COMPARISONS = {"lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "=="}


class Real(Value):
    """One number for all lanes."""

    def _of(self, other: Any) -> Any:
        return other.value if isinstance(other, Real) else self.trace.number(other)

    def __neg__(self) -> Real:
        return Real(self.trace, self.trace.builder.fneg(self.value))


class Vector(Value):
    """One number per lane."""

    def _of(self, other: Any) -> Any:
        return _lanes(self.trace, other)

    def __neg__(self) -> Vector:
        return Vector(self.trace, self.trace.builder.fneg(self.value))


def _lanes(trace: Tracer, x: Any) -> Any:
    """Return the LLVM vector of a number, however it is given."""
    if isinstance(x, Vector):
        return x.value
    return trace.spread(x.value if isinstance(x, Real) else trace.number(x))


def _define(name: str, operation: str) -> None:
    def forward(self: Any, other: Any) -> Any:
        if isinstance(self, Real) and isinstance(other, Vector):
            return getattr(Vector(other.trace, _lanes(other.trace, self)), f"__{name}__")(other)
        return type(self)(self.trace, getattr(self.trace.builder, operation)(self.value, self._of(other)))

    def backward(self: Any, other: Any) -> Any:
        return type(self)(self.trace, getattr(self.trace.builder, operation)(self._of(other), self.value))

    for kind in (Real, Vector):
        setattr(kind, f"__{name}__", forward)
        setattr(kind, f"__r{name}__", backward)


def _define_comparison(name: str, sign: str) -> None:
    def compare(self: Any, other: Any) -> Any:
        if isinstance(self, Real) and isinstance(other, Vector):
            self = Vector(other.trace, _lanes(other.trace, self))
        kind: Any = Flag if isinstance(self, Real) else Mask.compared
        return kind(self.trace, self.trace.builder.fcmp_ordered(sign, self.value, self._of(other)))

    for kind in (Real, Vector):
        setattr(kind, f"__{name}__", compare)


for _name, _operation in _OPERATORS.items():
    _define(_name, _operation)
for _name, _sign in _COMPARISONS.items():
    _define_comparison(_name, _sign)


def _trace_of(*given: Any) -> Tracer | None:
    traced = [x for x in given if isinstance(x, Value)]
    side_by_side = (x for x in traced if isinstance(x, Vector | Mask | Counts))
    return next((x.trace for x in (*side_by_side, *traced)), None)


def fma(a: Any, b: Any, c: Any) -> Any:
    """Return a b + c, rounded once where it is traced."""
    trace = _trace_of(a, b, c)
    if trace is None:
        return a * b + c
    return Vector(trace, trace.call("fma", *(_lanes(trace, x) for x in (a, b, c))))


def sqrt(x: Any) -> Any:
    """Square root."""
    trace = _trace_of(x)
    return np.sqrt(x) if trace is None else Vector(trace, trace.call("sqrt", _lanes(trace, x)))


def power(x: Any, exponent: float) -> Any:
    """Return x to a power."""
    trace = _trace_of(x)
    if trace is None:
        return np.power(x, exponent)
    return Vector(trace, trace.call("pow", _lanes(trace, x), _lanes(trace, exponent)))


#: Binary logarithm of the largest number that `roughly_power` finds.
MOST_DOUBLINGS = 120.0


def roughly_power(x: Any, exponent: float) -> Any:
    """Return x >= 0 to a power, to six figures: for lengths of steps. `power` asks a library, lane by lane."""
    # nothing is larger or smaller than 2**MOST_DOUBLINGS and its inverse, which stands for zero
    log2 = [2.0 / (math.log(2.0) * k) for k in (1, 3, 5, 7, 9)]
    exp2 = [math.log(2.0) ** k / math.factorial(k) for k in range(8)]
    trace = _trace_of(x)
    if trace is None:
        bits = np.asarray(x, np.float32).view(np.int32)
        halvings = (bits - _ROOT_HALF) >> 23
        rest = (bits - (halvings << 23)).view(np.float32)
        z = (rest - 1) / (rest + 1)
        y = (halvings.astype(np.float32) + z * _sum_up(log2, z * z)) * np.float32(exponent)
        y = np.clip(y, -MOST_DOUBLINGS, MOST_DOUBLINGS)
        doublings = np.trunc(y + np.copysign(np.float32(0.5), y)).astype(np.int32)
        found = _sum_up(exp2, y - doublings.astype(np.float32)).view(np.int32) + (doublings << 23)
        return found.view(np.float32).astype(float)
    b, n = trace.builder, trace.lanes
    single, integer = ir.VectorType(ir.FloatType(), n), ir.VectorType(_I32, n)

    def of(number: float) -> Any:
        return ir.Constant(single, [float(np.float32(number))] * n)

    def whole_of(number: int) -> Any:
        return ir.Constant(integer, [number] * n)

    def sum_up(coefficients: Sequence[float], at: Any) -> Any:
        total = of(coefficients[-1])
        for each in reversed(coefficients[:-1]):
            total = b.fadd(b.fmul(total, at), of(each))
        return total

    given = x.value if trace.size == 4 else b.fptrunc(x.value, single)
    bits = b.bitcast(given, integer)
    halvings = b.ashr(b.sub(bits, whole_of(_ROOT_HALF)), whole_of(23))
    rest = b.bitcast(b.sub(bits, b.shl(halvings, whole_of(23))), single)  # from the root of a half to that of two
    z = b.fdiv(b.fsub(rest, of(1.0)), b.fadd(rest, of(1.0)))
    y = b.fadd(b.sitofp(halvings, single), b.fmul(z, sum_up(log2, b.fmul(z, z))))
    y = b.fmul(y, of(exponent))
    y = b.select(b.fcmp_ordered("<", y, of(MOST_DOUBLINGS)), y, of(MOST_DOUBLINGS))
    y = b.select(b.fcmp_ordered(">", y, of(-MOST_DOUBLINGS)), y, of(-MOST_DOUBLINGS))
    doublings = b.fptosi(b.fadd(y, b.select(b.fcmp_ordered("<", y, of(0.0)), of(-0.5), of(0.5))), integer)
    found = b.bitcast(sum_up(exp2, b.fsub(y, b.sitofp(doublings, single))), integer)
    found = b.bitcast(b.add(found, b.shl(doublings, whole_of(23))), single)
    return Vector(trace, found if trace.size == 4 else b.fpext(found, trace.vector))


def _sum_up(coefficients: Sequence[float], at: np.ndarray) -> np.ndarray:
    """Sum of a polynomial in single precision."""
    total = np.full_like(at, coefficients[-1])
    for each in reversed(coefficients[:-1]):
        total = total * at + np.float32(each)
    return total


def size(x: Any) -> Any:
    """Absolute value."""
    trace = _trace_of(x)
    return np.abs(x) if trace is None else Vector(trace, trace.call("fabs", _lanes(trace, x)))


def where(condition: Any, a: Any, b: Any) -> Any:
    """Return a in the lanes of a mask (or at a flag), b elsewhere."""
    return _where(condition, a, b, fenced=True)


def _where(condition: Any, a: Any, b: Any, fenced: bool) -> Any:
    trace = _trace_of(condition, a, b)
    if trace is None:
        return np.where(condition, a, b)
    select = trace.builder.select
    if isinstance(condition, Flag):
        kind = type(a)
        return kind(trace, select(condition.value, a.value, a._of(b)))
    if isinstance(a, Mask | Counts) or isinstance(b, Mask | Counts):
        known: Any = a if isinstance(a, Mask | Counts) else b
        return type(known)(trace, select(condition.truths, known._of(a), known._of(b)))
    both = [_lanes(trace, x) for x in (a, b)]
    if fenced:
        # what is chosen and written where one of both was read would become a masked store: tens of cycles on many
        # processors without AVX-512, and it hands its value to no load before the cache has it
        both = [trace.call("arithmetic.fence", x) if isinstance(x, LoadInstr) else x for x in both]
    return Vector(trace, select(condition.truths, *both))


def maximum(a: Any, b: Any) -> Any:
    """Return the larger number; a where b is none."""
    return _where(b > a, b, a, fenced=False) if not isinstance(b, float) else _where(a < b, b, a, fenced=False)


def minimum(a: Any, b: Any) -> Any:
    """Return the smaller number; a where b is none."""
    return _where(b < a, b, a, fenced=False) if not isinstance(b, float) else _where(a > b, b, a, fenced=False)


def any_lane(mask: Any) -> Any:
    """Whether a mask holds in any lane."""
    trace = _trace_of(mask)
    if trace is None:
        return bool(np.any(mask))
    whole = ir.IntType(trace.lanes)
    bits = trace.builder.bitcast(mask.truths, whole)
    return Flag(trace, trace.builder.icmp_unsigned("!=", bits, ir.Constant(whole, 0)))


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


def when(flag: Any) -> Iterator[None]:
    """Go once through what follows if `flag` holds: ``for _ in when(flag)``."""
    trace = _trace_of(flag)
    if trace is None:
        if flag:
            yield
        return
    with trace.builder.if_then(flag.value):
        yield


def count_to(n: Any, trace: Tracer | None) -> Iterator[Any]:
    """Count from 0 to n - 1."""
    if trace is None:
        yield from range(n)
        return
    b = trace.builder
    kept = trace.place(_I64)
    b.store(ir.Constant(_I64, 0), kept)
    head, body, out = (b.append_basic_block(name) for name in ("count", "counted", "over"))
    b.branch(head)
    b.position_at_end(head)
    now = b.load(kept)
    b.cbranch(b.icmp_signed("<", now, n.value if isinstance(n, Count) else ir.Constant(_I64, n)), body, out)
    b.position_at_end(body)
    yield Count(trace, now)
    b.store(b.add(now, ir.Constant(_I64, 1)), kept)
    b.branch(head)
    b.position_at_end(out)


def while_any(asks: Callable[[], Any], trace: Tracer | None, at_most: int = 0) -> Iterator[None]:
    """Go round while any lane asks for it, `at_most` so often (0: without end); `asks` is called before each round."""
    if trace is None:
        rounds = 0
        while bool(np.any(asks())) and (not at_most or rounds < at_most):
            rounds += 1
            yield
        return
    b = trace.builder
    left = trace.place(_I64) if at_most else None
    if at_most:
        b.store(ir.Constant(_I64, at_most), left)
    head, body, out = (b.append_basic_block(name) for name in ("ask", "round", "done"))
    b.branch(head)
    b.position_at_end(head)
    asked = asks()
    flag = (any_lane(asked) if isinstance(asked, Mask) else asked).value
    if at_most:
        flag = b.and_(flag, b.icmp_signed(">", b.load(left), ir.Constant(_I64, 0)))
    b.cbranch(flag, body, out)
    b.position_at_end(body)
    yield
    if at_most:
        b.store(b.sub(b.load(left), ir.Constant(_I64, 1)), left)
    b.branch(head)
    b.position_at_end(out)


def _one(trace: Tracer, x: Any) -> Any:
    """Return the LLVM number of a number, however it is given."""
    return x.value if isinstance(x, Real) else trace.number(x)


class Cell:
    """A variable that branches and loops may change; at a `place` in memory, what it is there stays."""

    def __init__(self, x: Any, place: Any = None) -> None:
        self._trace, self._kind, self._x, self._place = _trace_of(x), type(x), x, place
        if self._trace is not None and place is None:
            self._place = self._trace.place(x.value.type)
            self.now = x

    @property
    def now(self) -> Any:
        """Its value."""
        if self._trace is None:
            return self._x
        return self._kind(self._trace, self._trace.builder.load(self._place))

    @now.setter
    def now(self, x: Any) -> None:
        if self._trace is None:
            self._x = x
            return
        value = x.value if isinstance(x, Value) and not isinstance(x, Real) else None
        if value is None:
            value = _lanes(self._trace, x) if self._kind is Vector else x.value
        self._trace.builder.store(value, self._place)

    def _lane_at(self, lane: Any) -> Any:
        b = self._trace.builder  # type: ignore[union-attr]
        each = b.bitcast(self._place, self._place.type.pointee.element.as_pointer())
        return b.gep(each, [lane.value], inbounds=True)

    def lane(self, lane: Any) -> Any:
        """Return the number of one lane."""
        if self._trace is None:
            return self._x[lane]
        kind = Count if self._kind is Counts else Real
        return kind(self._trace, self._trace.builder.load(self._lane_at(lane)))

    def put_lane(self, lane: Any, x: Any) -> None:
        """Change the number of one lane."""
        if self._trace is None:
            self._x = self._x.copy()
            self._x[lane] = x
            return
        value = x.value if isinstance(x, Value) else _one(self._trace, x)
        self._trace.builder.store(value, self._lane_at(lane))


class Ledger:
    """Variables that several functions of a kernel share, `ROOM` bytes of memory for each."""

    # trace: None: NumPy, where all is one function
    # pointer: where they begin: whole numbers

    #: Of the widest variable, a whole number of each lane, and what it is aligned to.
    ROOM = 128

    def __init__(self, trace: Tracer | None, pointer: Any = None) -> None:
        self._trace, self._pointer, self._count = trace, pointer, 0

    def cell(self, x: Any) -> Cell:
        """Return the next variable, unchanged; `x` tells its kind, and where there is no memory its value."""
        if self._trace is None:
            return Cell(x)
        b, at = self._trace.builder, self._count * (self.ROOM // 8)
        self._count += 1
        place = b.gep(self._pointer, [ir.Constant(_I64, at)], inbounds=True)
        return Cell(x, b.bitcast(place, x.value.type.as_pointer()))


class Rows:
    """Named rows of lanes in one flat array: ``rows[name, i]``."""

    # trace: None: NumPy
    # counts: rows of each name
    # lanes: lanes of the kernel
    # pointer: where the first lane of the first row lies
    # stride: numbers from one row to the next; `lanes` unless given

    def __init__(
        self,
        trace: Tracer | None,
        counts: Sequence[tuple[str, int]],
        lanes: int,
        pointer: Any = None,
        stride: int | None = None,
        wide: bool = False,
    ) -> None:
        self.trace, self.first, self.count, self.size = trace, {}, dict(counts), 0
        for name, count in counts:
            self.first[name] = self.size
            self.size += count
        self.lanes, self.pointer, self.stride, self.wide = lanes, pointer, stride or lanes, wide
        if trace is None:
            self.array = np.zeros((self.size, lanes)) if pointer is None else pointer

    def __contains__(self, name: str) -> bool:
        return name in self.first

    def _at(self, key: Any) -> Any:
        name, i = key if isinstance(key, tuple) else (key, 0)
        if isinstance(i, int) and not 0 <= i < self.count[name]:
            msg = f"row {name}[{i}] of {self.count[name]}"
            raise IndexError(msg)
        return self.first[name] + i

    def _pointer(self, row: Any) -> Any:
        b = self.trace.builder  # type: ignore[union-attr]
        at = (row * self.stride).value if isinstance(row, Count) else ir.Constant(_I64, row * self.stride)
        return b.gep(self.pointer, [at], inbounds=True)

    def __getitem__(self, key: Any) -> Any:
        row, t = self._at(key), self.trace
        if t is None:
            return self.array[row].copy()
        if not self.wide or t.size == 8:
            return Vector(t, t.load(self._pointer(row), t.vector, t.size))
        found = t.load(self._pointer(row), ir.VectorType(ir.DoubleType(), t.lanes), 8)
        return Vector(t, t.builder.fptrunc(found, t.vector))

    def number(self, name: str, i: Any) -> Any:
        """Return number `i` of the rows of a name, which lie one after another."""
        if self.trace is None:
            return self.array.reshape(-1)[self.first[name] * self.lanes + i]
        t = self.trace
        return Real(t, t.load(self._number_at(self.first[name] * self.stride + i), t.real, t.size))

    def vector(self, name: str, i: Any) -> Any:
        """Return as many numbers as there are lanes, from number `i` of the rows of a name on."""
        at = self.first[name] * self.stride + i
        pointer = self.array.reshape(-1) if self.trace is None else self.pointer
        return load(self.trace, pointer, at, self.lanes)

    def put_number(self, name: str, i: Any, x: Any) -> None:
        """Write number `i` of the rows of a name."""
        if self.trace is None:
            self.array.reshape(-1)[self.first[name] * self.lanes + i] = x
            return
        kept = self.trace.builder.store(_one(self.trace, x), self._number_at(self.first[name] * self.stride + i))
        kept.align = self.trace.size

    def lane(self, row: Any, lane: Any) -> Any:
        """Return a lane's number in a row, by the row's number."""
        if self.trace is None:
            return self.array[row, lane]
        t = self.trace
        if not self.wide or t.size == 8:
            return Real(t, t.load(self._number_at(row * self.stride + lane), t.real, t.size))
        found = t.load(self._number_at(row * self.stride + lane), ir.DoubleType(), 8)
        return Real(t, t.builder.fptrunc(found, t.real))

    def put_lane(self, row: Any, lane: Any, x: Any) -> None:
        """Write a lane's number in a row."""
        if self.trace is None:
            self.array[row, lane] = x
            return
        t = self.trace
        value = _one(t, x)
        if self.wide and t.size == 4:
            value = t.builder.fpext(value, ir.DoubleType())
        pointer = self._number_at(row * self.stride + lane)
        t.builder.store(value, pointer).align = 8 if self.wide else t.size

    def clear_lane(self, lane: Any, rows: int) -> None:
        """Let a lane's numbers be zero in the first so many rows."""
        for row in count_to(rows, self.trace):
            self.put_lane(row, lane, 0.0)

    def _number_at(self, at: Any) -> Any:
        b = self.trace.builder  # type: ignore[union-attr]
        place = at.value if isinstance(at, Count) else ir.Constant(_I64, at)
        return b.gep(self.pointer, [place], inbounds=True)

    def row(self, i: Any) -> Any:
        """Return a row by its number."""
        if self.trace is None:
            return self.array[i].copy()
        return Vector(self.trace, self.trace.load(self._pointer(i), self.trace.vector, self.trace.size))

    def __setitem__(self, key: Any, x: Any) -> None:
        row, t = self._at(key), self.trace
        if t is None:
            self.array[row] = x
            return
        value, kind = _lanes(t, x), t.vector
        if self.wide and t.size == 4:
            kind = ir.VectorType(ir.DoubleType(), t.lanes)
            value = t.builder.fpext(value, kind)
        kept = t.builder.store(value, t.builder.bitcast(self._pointer(row), kind.as_pointer()))
        kept.align = 8 if self.wide else t.size


def narrow(trace: Tracer | None, x: Any) -> Any:
    """Return numbers of double precision in the format of `trace`."""
    if trace is None or x.trace.size == trace.size:
        return x if trace is None else type(x)(trace, x.value)
    kind = trace.vector if isinstance(x, Vector) else trace.real
    return type(x)(trace, trace.builder.fptrunc(x.value, kind))


def side_by_side(trace: Tracer | None, numbers: Sequence[Any]) -> Any:
    """Return numbers, as many as there are lanes, in these."""
    if trace is None:
        return np.array(numbers, float)
    found = ir.Constant(trace.vector, [0.0 if isinstance(x, Real) else trace.number(x).constant for x in numbers])
    for i, x in enumerate(numbers):
        if isinstance(x, Real):
            found = trace.builder.insert_element(found, x.value, ir.Constant(_I32, i))
    return Vector(trace, found)


def lane_numbers(trace: Tracer | None, lanes: int) -> Any:
    """Return the number of each lane."""
    if trace is None:
        return np.arange(lanes, dtype=float)
    return Vector(trace, ir.Constant(trace.vector, [float(lane) for lane in range(lanes)]))


def after(x: Any) -> Any:
    """Return each lane's next neighbour; the last lane's is its own."""
    trace = _trace_of(x)
    if trace is None:
        return np.append(x[1:], x[-1])
    order = ir.Constant(ir.VectorType(_I32, trace.lanes), [*range(1, trace.lanes), trace.lanes - 1])
    return Vector(trace, trace.builder.shuffle_vector(x.value, x.value, order))


def transposed(rows: Sequence[Any]) -> list[Any]:
    """Of as many vectors as there are lanes, let those be lanes that were vectors."""
    trace = _trace_of(*rows)
    if trace is None:
        return list(np.array(rows).T)
    found, n = list(rows), trace.lanes
    kind, apart = ir.VectorType(_I32, n), n // 2
    while apart:  # squares of so many change places
        low = ir.Constant(kind, [i if not i & apart else n + i - apart for i in range(n)])
        high = ir.Constant(kind, [i + apart if not i & apart else n + i for i in range(n)])
        for i in (i for i in range(n) if not i & apart):
            a, b = found[i].value, found[i + apart].value
            for place, order in ((i, low), (i + apart, high)):
                found[place] = Vector(trace, trace.builder.shuffle_vector(a, b, order))
        apart //= 2
    return found


def largest_lane(x: Any) -> Any:
    """Largest number of all lanes."""
    trace = _trace_of(x)
    if trace is None:
        return np.max(x)
    n = trace.lanes
    while n > 1:
        n //= 2
        order = ir.Constant(ir.VectorType(_I32, trace.lanes), [(i + n) % trace.lanes for i in range(trace.lanes)])
        x = maximum(x, Vector(trace, trace.builder.shuffle_vector(x.value, x.value, order)))
    return first_lane(x)


def sum_lanes(x: Any) -> Any:
    """Sum of the numbers of all lanes, halves first."""
    trace = _trace_of(x)
    n = lanes = len(x) if trace is None else trace.lanes
    while n > 1:
        n //= 2
        if trace is None:
            x = x + np.roll(x, -n)
            continue
        order = ir.Constant(ir.VectorType(_I32, lanes), [(i + n) % lanes for i in range(lanes)])
        x = x + Vector(trace, trace.builder.shuffle_vector(x.value, x.value, order))
    return x[0] if trace is None else first_lane(x)


def lane_of(x: Any, lane: Any) -> Any:
    """Return the number (whole or real) of a lane that is known at run time."""
    trace = _trace_of(x)
    if trace is None:
        return x[lane]
    found = trace.builder.extract_element(x.value, lane.value)
    return Count(trace, found) if isinstance(x, Counts) else Real(trace, found)


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


def each_lane(mask: Any) -> Iterator[Any]:
    """Go through the lanes in which a mask holds."""
    trace = _trace_of(mask)
    if trace is None:
        yield from np.flatnonzero(mask)
    else:
        yield from _each_bit(trace, _bits(mask))


def each_true(flags: Sequence[Any], trace: Tracer | None) -> Iterator[Any]:
    """Go through the numbers of the truths that hold, of so many that are known beforehand."""
    if trace is None:
        yield from (i for i, each in enumerate(flags) if each)
        return
    b, bits = trace.builder, ir.Constant(_I64, 0)
    for i, each in enumerate(flags):
        bits = b.or_(bits, b.shl(b.zext(each.value, _I64), ir.Constant(_I64, i)))
    yield from _each_bit(trace, bits)


def _each_bit(trace: Tracer, bits: Any) -> Iterator[Count]:
    """Go through the numbers of the bits that are set in a whole number."""
    b, left = trace.builder, trace.place(_I64)
    b.store(bits, left)
    head, body, out = (b.append_basic_block(name) for name in ("lanes", "lane", "served"))
    b.branch(head)
    b.position_at_end(head)
    b.cbranch(b.icmp_signed("!=", b.load(left), ir.Constant(_I64, 0)), body, out)
    b.position_at_end(body)
    bits = b.load(left)
    lane = Count(trace, b.cttz(bits, ir.Constant(_I1, 1)))
    b.store(b.and_(bits, b.sub(bits, ir.Constant(_I64, 1))), left)
    yield lane
    b.branch(head)
    b.position_at_end(out)


def lesser(a: Any, b: Any) -> Any:
    """Return the smaller of two whole numbers."""
    return where(a < b, a, b) if isinstance(a, Count) else min(a, b)


def load(trace: Tracer | None, pointer: Any, at: Any, lanes: int) -> Any:
    """Return as many numbers of a table as there are lanes, from place `at` on."""
    if trace is None:
        return pointer[at : at + lanes]
    place = at.value if isinstance(at, Count) else ir.Constant(_I64, at)
    return Vector(trace, trace.load(trace.builder.gep(pointer, [place], inbounds=True), trace.vector, trace.size))


def store(trace: Tracer | None, pointer: Any, at: Any, x: Any) -> None:
    """Write the numbers of all lanes into a table, in the format of `trace`."""
    if trace is None:
        pointer[at : at + len(x)] = x
        return
    b, kind = trace.builder, ir.VectorType(trace.real, trace.lanes)
    value = x.value if x.trace.size == trace.size else b.fptrunc(x.value, kind)
    place = b.gep(pointer, [at.value if isinstance(at, Count) else ir.Constant(_I64, at)], inbounds=True)
    b.store(value, b.bitcast(place, kind.as_pointer())).align = trace.size


def store_one(trace: Tracer | None, pointer: Any, at: Any, x: Any) -> None:
    """Write a number into a table."""
    if trace is None:
        pointer[at] = x
        return
    place = at.value if isinstance(at, Count) else ir.Constant(_I64, at)
    trace.builder.store(_one(trace, x), trace.builder.gep(pointer, [place], inbounds=True)).align = trace.size


def load_one(trace: Tracer | None, pointer: Any, at: Any) -> Any:
    """Return a number of a table."""
    if trace is None:
        return pointer[at]
    place = at.value if isinstance(at, Count) else ir.Constant(_I64, at)
    return Real(trace, trace.load(trace.builder.gep(pointer, [place], inbounds=True), trace.real, trace.size))


def gather(trace: Tracer | None, pointer: Any, places: Any) -> Any:
    """Each lane's own number of a table of the kernel's number format."""
    if trace is None:
        return pointer[places]
    b, found = trace.builder, ir.Constant(trace.vector, ir.Undefined)
    for lane in range(trace.lanes):
        at = ir.Constant(_I32, lane)
        x = trace.load(b.gep(pointer, [b.extract_element(places.value, at)], inbounds=True), trace.real, trace.size)
        found = b.insert_element(found, x, at)
    return Vector(trace, found)


class Lookup:
    """Numbers that are known beforehand, to be looked up at run time: whole ones, or all in the kernel's format."""

    def __init__(self, trace: Tracer | None, numbers: Sequence[float]) -> None:
        self._trace, self._numbers = trace, list(numbers)
        if trace is not None:
            self._whole = all(isinstance(x, int) for x in self._numbers)
            kind = ir.ArrayType(_I64 if self._whole else trace.real, len(self._numbers))
            self._table = ir.GlobalVariable(trace.module, kind, trace.module.get_unique_name("table"))
            self._table.linkage, self._table.global_constant = "internal", True
            given = self._numbers if self._whole else [trace.number(x) for x in self._numbers]
            self._table.initializer = ir.Constant(kind, given)

    def __getitem__(self, i: Any) -> Any:
        if not isinstance(i, Count):
            return self._numbers[i]
        b = i.trace.builder
        found = b.load(b.gep(self._table, [ir.Constant(_I64, 0), i.value], inbounds=True))
        return Count(i.trace, found) if self._whole else Real(i.trace, found)


class Contact(Count):
    """Number of a contact that is known at run time, and its sides: left floor, right floor (-1: a wall), gap."""

    # beside them the side whose columns are struck (-1: floors meet), whether these stand on the ground, and the law

    def __init__(self, count: Count, sides: tuple[Any, Any, Any], columns: tuple[int, bool], law: int) -> None:
        super().__init__(count.trace, count.value)
        self.sides, self.columns, self.law = sides, columns, law


def whole(trace: Tracer | None, x: int) -> Any:
    """Return a whole number that is known beforehand."""
    return x if trace is None else Count(trace, ir.Constant(_I64, x))


def one(trace: Tracer | None, x: float) -> Any:
    """Return a number that is known beforehand."""
    return x if trace is None else Real(trace, trace.number(x))


def counts(trace: Tracer | None, x: int, lanes: int) -> Any:
    """Return a whole number in all lanes."""
    return np.full(lanes, x) if trace is None else Counts(trace, trace.spread(ir.Constant(_I64, x)))


def mask(trace: Tracer, x: bool) -> Mask:
    """Return a truth in all lanes."""
    return Mask(trace, _mask(trace, x))


def flag(trace: Tracer | None, x: bool) -> Any:
    """Return a truth that is known beforehand."""
    return x if trace is None else Flag(trace, ir.Constant(_I1, int(x)))


def not_(x: Any) -> Any:
    """Whether a truth does not hold."""
    return ~x if isinstance(x, Flag) else not x


def flagged(trace: Tracer | None, x: Any) -> Any:
    """Return a truth as a kernel's own, where it is known beforehand."""
    return Flag(trace, ir.Constant(_I1, int(x))) if trace is not None and isinstance(x, bool) else x


def real(x: Any) -> Any:
    """Return a whole number as a real one."""
    return Real(x.trace, x.trace.builder.sitofp(x.value, x.trace.real)) if isinstance(x, Count) else float(x)


def rounded(x: Any) -> Any:
    """Return a real number that is whole as a whole one."""
    return Count(x.trace, x.trace.builder.fptosi(x.value, _I64)) if isinstance(x, Real) else int(x)


def first_lane(x: Any) -> Any:
    """Return the number of lane 0."""
    trace = _trace_of(x)
    return x[0] if trace is None else Real(trace, trace.builder.extract_element(x.value, ir.Constant(_I32, 0)))


def first_whole(x: Any) -> Any:
    """Return the whole number of lane 0."""
    trace = _trace_of(x)
    return int(x[0]) if trace is None else Count(trace, trace.builder.extract_element(x.value, ir.Constant(_I32, 0)))
