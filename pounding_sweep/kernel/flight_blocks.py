"""The motion without pounding of rows of buildings that each have one of their own, as exact flight reads it.

Where hardly any scenarios share a motion, tables of all its points would cost more than the
impacts. So many rows of buildings move side by side in the lanes, in double precision and in
steps as long as the ground allows; what is kept is their state at the beginning of each block
of the grid, and bounds of what is watched in it. A block that these don't rule out is gone
through again, point by point, for the one scenario that flies.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import groupby
from typing import Any

from pounding_sweep.kernel.flight import ACCELERATION, HEAD, SPAN, STATE, Flight
from pounding_sweep.kernel.lanes import (
    Cell,
    Table,
    Tracer,
    count_to,
    flag,
    fma,
    lesser,
    load,
    load_one,
    maximum,
    minimum,
    narrow,
    not_,
    real,
    rounded,
    size,
    sqrt,
    store,
    store_one,
    transposed,
    when,
    whole,
)

#: Groups of rows of buildings that are filled together, block by block.
BUNDLE = 16


class Blocks:
    """Fills the blocks of a call's rows of buildings, and goes through them point by point.

    Parameters
    ----------
    flight : Flight
        Whose motions they are.
    decays : LLVM pointer or ndarray
        In double precision: `HEAD` numbers, the ground's acceleration at all points of the grid, the rows of
        `Layout.decays` of each row of buildings, those of `Layout.strides` of each group of them, and room for states.
    wide : Tracer or None
        Double precision; None: NumPy.
    margin : float
        Share by which what is watched is widened for rounding.
    rows : Count or int
        Rows of buildings.
    cell : callable
        Makes a variable that is there at the next call of flight, of a first value.
    """

    def __init__(
        self,
        flight: Flight,
        decays: Any,
        wide: Tracer | None,
        margin: float,
        rows: Any,
        cell: Callable[[Any], Cell],
    ) -> None:
        self.flight, self.layout, self.lanes, self.trace = flight, flight.layout, flight.lanes, flight.trace
        self.wide, self.decays, self.margin, self.rows = wide, decays, margin, rows
        step, per_stride, stride, length = (load_one(wide, decays, whole(self.trace, k)) for k in range(HEAD))
        self.step, self.per_stride = narrow(self.trace, step), per_stride
        #: Points of the grid in a long step, in a block, and long steps in a block.
        self.stride, self.length = (rounded(narrow(self.trace, x)) for x in (stride, length))
        self.steps = self.length // self.stride
        self.blocks = (flight.last + (self.length - 1)) // self.length
        own, groups = len(self.layout.decays) * self.layout.wide_modes, (rows + (self.lanes - 1)) // self.lanes
        self.modes_at = flight.points + HEAD
        self.strides_at = self.modes_at + rows * own
        self.states_at = self.strides_at + groups * (len(self.layout.strides) * self.layout.modes * self.lanes)
        #: Where the states of the modes of one row of buildings are put together.
        self.desk = self.states_at + groups * (self.blocks * (self.layout.modes * STATE * self.lanes))
        self.groups = groups
        self.lows = Table(self.trace, [low for low, _ in self.layout.ranges] or [0])
        self.shakes = any(each.kind == ACCELERATION for each in self.layout.watched)
        #: The block that lies point by point, and whose: where its tables begin.
        self.known, self.owner = (cell(whole(self.trace, 0)) for _ in range(2))

    def _wide(self, at: Any) -> Any:
        return load(self.wide, self.decays, at, self.lanes)

    def _ground(self, point: Any) -> Any:
        return load_one(self.wide, self.decays, point + HEAD)

    def _own(self, number: Any) -> Any:
        """Where the rows of modes of a row of buildings begin."""
        return self.modes_at + number * (len(self.layout.decays) * self.layout.wide_modes)

    def _state(self, group: Any, block: Any, m: Any) -> Any:
        """Where the states of a mode at the beginning of a block lie."""
        at = (group * self.blocks + block) * self.layout.modes + m
        return self.states_at + at * (STATE * self.lanes)

    # all of them -----------------------------------------------------------------------------------------------

    def fill(self) -> None:
        """Fill all blocks of all rows of buildings, as many side by side as there are lanes."""
        f = self.flight
        self.known.now = whole(self.trace, -1)
        for name in ("above", "below", "swell"):
            for q in count_to(self.layout.wide_watched, self.trace):
                f.rows[name, q] = f.group.full(0.0)
        for number in count_to(self.rows, self.trace):
            f.base.now = number * self.layout.size(self.blocks)
            f.put_decays(self.wide, self.decays, self._own(number))
        for group in count_to(self.groups, self.trace):
            for m in count_to(self.layout.modes, self.trace):
                for k in range(STATE):
                    zero = self._wide(self.strides_at) * 0.0
                    store(self.wide, self.decays, self._state(group, whole(self.trace, 0), m) + k * self.lanes, zero)
        for bundle in count_to((self.groups + (BUNDLE - 1)) // BUNDLE, self.trace):
            first = bundle * BUNDLE
            for block in count_to(self.blocks, self.trace):
                left = (f.last - block * self.length) // self.stride
                for k in count_to(lesser(self.groups - first, whole(self.trace, BUNDLE)), self.trace):
                    self._fill_block(first + k, block, lesser(left, self.steps))

    def _fill_block(self, group: Any, block: Any, steps: Any) -> None:
        """Fill a block of a group; what moves as in the group before it has been found there."""
        f = self.flight
        f.base.now = group * self.lanes * self.layout.size(self.blocks)
        for m in count_to(self.layout.modes, self.trace):
            new = self._is_new(group, m)
            for _ in when(new):
                self._move(group, block, m, steps)
            for _ in when(not_(new) & (block + 1 < self.blocks)):
                here, there = (self._state(group - before, block + 1, m) for before in (0, 1))
                for k in range(STATE):
                    store(self.wide, self.decays, here + k * self.lanes, self._wide(there + k * self.lanes))
        for (_, many, shaken), run in groupby(range(len(self.layout.watched)), self._kind):
            mine = list(run)
            for q in count_to(len(mine), self.trace):
                new = flag(self.trace, False)
                for k in range(many):
                    new = new | self._is_new(group, self.lows[q + mine[0]] + k)
                for _ in when(new):
                    self._watch(q + mine[0], many, shaken, steps)
        self._hand_out(group, block)

    def _is_new(self, group: Any, m: Any) -> Any:
        """Whether a mode moves otherwise in a group than in the one before it."""
        row = group * len(self.layout.strides) + self.layout.strides.index("new")
        return load_one(self.wide, self.decays, self.strides_at + (row * self.layout.modes + m) * self.lanes) > 0.5

    def _kind(self, q: int) -> tuple[int, int, bool]:
        each = self.layout.watched[q]
        return each.kind, self.layout.ranges[q][1], each.kind == ACCELERATION

    def _move(self, group: Any, block: Any, m: Any, steps: Any) -> None:
        """Motions of one mode of all lanes through a block, and the most that it bends and reaches."""
        f, n = self.flight, self.layout.modes
        first = self.strides_at + (group * (len(self.layout.strides) * n) + m) * self.lanes
        c = {name: self._wide(first + k * n * self.lanes) for k, name in enumerate(self.layout.strides)}
        square, damping, push, slowness = (
            narrow(self.trace, c[name]) for name in ("square", "damping", "push", "slowness")
        )
        at = self._state(group, block, m)
        q, p = Cell(self._wide(at)), Cell(self._wide(at + self.lanes))
        zero = f.group.full(0.0)
        bends, reach, shook = Cell(zero), Cell(zero), Cell(zero)
        row, start = m * SPAN, block * self.length

        def keep(k: Any) -> tuple[Any, Any, Any]:
            x, rate = narrow(self.trace, q.now), narrow(self.trace, p.now)
            total = -fma(square, x, damping * rate)
            f.rows["track", row + k] = x
            reach.now = maximum(reach.now, size(x))
            if self.shakes:
                f.rows["shook", row + k] = total
                shook.now = maximum(shook.now, size(total))
            return x, rate, total

        for k in count_to(steps, self.trace):
            here = start + k * self.stride
            g0, g1 = self._ground(here), self._ground(here + self.stride)
            _, rate, total = keep(k)
            second = total - push * narrow(self.trace, g0)
            slope = narrow(self.trace, (g1 - g0) * self.per_stride)
            third = (-fma(square, rate, damping * second) - push * slope) * slowness
            bends.now = maximum(bends.now, fma(second, second, third * third))
            q0, p0 = q.now, p.now
            q.now = fma(c["qq"], q0, fma(c["qp"], p0, fma(c["q0"], g0, c["q1"] * g1)))
            p.now = fma(c["pq"], q0, fma(c["pp"], p0, fma(c["p0"], g0, c["p1"] * g1)))
        keep(steps)
        for _ in when(block + 1 < self.blocks):
            for k, cell in enumerate((q, p)):
                store(self.wide, self.decays, self._state(group, block + 1, m) + k * self.lanes, cell.now)
        f.rows["bends", m], f.rows["reaches", m] = sqrt(bends.now), reach.now
        if self.shakes:
            f.rows["bends", n + m] = sqrt(bends.now) * narrow(self.trace, c["heft"])
            f.rows["reaches", n + m] = shook.now

    def _watch(self, q: Any, many: int, shaken: bool, steps: Any) -> None:
        """Bounds of what is watched in a block."""
        f, n = self.flight, self.layout.modes
        low = self.lows[q]
        shape = [load_one(self.trace, f.tables, f.place_of("shape") + q * n + low + k) for k in range(many)]
        track, most = "shook" if shaken else "track", n if shaken else 0
        above, below = Cell(f.group.full(-f.group.limit.far)), Cell(f.group.full(f.group.limit.far))
        for k in count_to(steps + 1, self.trace):
            x = f.group.full(0.0)
            for j, weight in enumerate(shape):
                x = fma(weight, f.rows[track, (low + j) * SPAN + k], x)
            above.now, below.now = maximum(above.now, x), minimum(below.now, x)
        bends, reach = f.group.full(0.0), f.group.full(0.0)
        for j, weight in enumerate(shape):
            bends = fma(size(weight), f.rows["bends", low + most + j], bends)
            reach = fma(size(weight), f.rows["reaches", low + most + j], reach)
        swell = bends * (self.step * self.step * (0.125 * (1.0 + 10.0 * self.margin)))
        long = real(self.stride)
        wide = fma(swell, long * long, reach * (10.0 * self.margin))
        f.rows["above", q], f.rows["below", q], f.rows["swell", q] = above.now + wide, below.now - wide, swell

    def _hand_out(self, group: Any, block: Any) -> None:
        """Put the bounds of a block into the tables of each lane's row of buildings."""
        f, lanes, base = self.flight, self.lanes, self.flight.base.now
        for part in range(self.layout.wide_watched // lanes):
            found = {
                name: transposed([f.rows[row, part * lanes + q] for q in range(lanes)])
                for name, row in (("most", "above"), ("least", "below"), ("swell", "swell"))
            }
            for lane in range(lanes):
                for _ in when(group * lanes + lane < self.rows):
                    f.base.now = base + self.layout.size(self.blocks) * lane
                    for name, those in found.items():
                        at = f.place_of(name) + block * self.layout.wide_watched + part * lanes
                        store(self.trace, f.tables, at, those[lane])
        f.base.now = base

    # one of them -----------------------------------------------------------------------------------------------

    @property
    def start(self) -> Any:
        """First point of the block that is known."""
        return self.known.now * self.length

    def of(self, t: Any) -> Any:
        """Block in which point t lies; of the last point, the one that ends there."""
        return lesser(t // self.length, self.blocks - 1)

    def know(self, block: Any) -> None:
        """Go through a block of the scenario that flies, point by point, where it is not the last one that was."""
        f = self.flight
        same = (self.known.now == block) & (self.owner.now == f.base.now)
        for _ in when(not_(same)):
            self.known.now, self.owner.now = block, f.base.now
            self._expand(block)

    def _expand(self, block: Any) -> None:
        f, layout, lanes = self.flight, self.layout, self.lanes
        number = f.base.now // layout.size(self.blocks)
        group = number // lanes
        lane, start = number - group * lanes, block * self.length
        steps = lesser(f.last - start, self.length)
        for m in count_to(layout.modes, self.trace):
            for k in range(STATE):
                x = load_one(self.wide, self.decays, self._state(group, block, m) + lane + k * lanes)
                store_one(self.wide, self.decays, self.desk + m + k * layout.wide_modes, x)
        for part in range(layout.wide_modes // lanes):
            own = self._own(number) + part * lanes
            c = {name: self._wide(own + k * layout.wide_modes) for k, name in enumerate(layout.decays)}
            q, p = (Cell(self._wide(self.desk + part * lanes + k * layout.wide_modes)) for k in range(STATE))
            for k in count_to(steps, self.trace):
                g0, g1 = self._ground(start + k), self._ground(start + k + 1)
                self._keep(part, k, q.now, p.now)
                q0, p0 = q.now, p.now
                q.now = fma(c["qq"], q0, fma(c["qp"], p0, fma(c["q0"], g0, c["q1"] * g1)))
                p.now = fma(c["pq"], q0, fma(c["pp"], p0, fma(c["p0"], g0, c["p1"] * g1)))
            self._keep(part, steps, q.now, p.now)
            for name, row, unit in (("free_x", "point_q", 1.0), ("free_rate", "point_p", self.step)):
                for first in range(0, SPAN, lanes):
                    rows = [f.rows[row, part * SPAN + first + k] for k in range(lanes)]
                    for m, series in enumerate(transposed(rows)[: layout.modes - part * lanes]):
                        place = (part * lanes + m) * layout.series_rows + first // lanes
                        f.rows[name, place] = series * unit
        for k in count_to(steps + 1, self.trace):
            f.rows.put_number("free_ground", k, narrow(self.trace, self._ground(start + k)))

    def _keep(self, part: int, k: Any, q: Any, p: Any) -> None:
        for name, x in (("point_q", q), ("point_p", p)):
            self.flight.rows[name, k + part * SPAN] = narrow(self.trace, x)
