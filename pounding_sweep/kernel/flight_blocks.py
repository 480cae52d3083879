"""The motion without pounding of rows of buildings that each have one of their own, as exact flight reads it.

Where hardly any scenarios share a motion, tables of all its points would cost more than the
impacts. So many rows of buildings move side by side in the lanes, in double precision and in
steps as long as the ground allows; what is kept is their state at the beginning of each block
of the grid, and bounds of what is watched in it. A block that these don't rule out is gone
through again, point by point, for the one scenario that flies.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import groupby
from typing import Any

from pounding_sweep.kernel.flight import ACCELERATION, HEAD, SPAN, STATE, Flight
from pounding_sweep.kernel.lanes import (
    Cell,
    Count,
    Lookup,
    Tracer,
    any_lane,
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
    one,
    real,
    rounded,
    size,
    sqrt,
    store,
    store_one,
    transposed,
    when,
    where,
    whole,
)
from pounding_sweep.kernel.modal_steps import MOVES, step

#: Groups of rows of buildings that are filled together, block by block.
BUNDLE = 16


class Blocks:
    """Fills the blocks of a call's rows of buildings, and goes through them point by point."""

    # flight: whose motions they are
    # decays: in double precision: `HEAD` numbers, the ground's acceleration at all points of the grid, what it pushes
    #     each mode by, the rows of `Layout.strides` of each group of rows of buildings, of which the first two are
    #     known, and room for those of `Layout.decays` of each row of buildings and for states
    # wide: double precision; None: NumPy
    # margin: share by which what is watched is widened for rounding
    # rows: rows of buildings
    # cell: makes a variable that is there at the next call of flight, of a first value

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
        #: By what the bulge of one step is less than that of a long one.
        self.per_square = 1.0 / (real(self.stride) * real(self.stride))
        self.blocks = (flight.last + (self.length - 1)) // self.length
        self.groups = groups = (rows + (self.lanes - 1)) // self.lanes
        self.push_at = flight.points + HEAD
        self.strides_at = self.push_at + self.layout.wide_modes
        self.modes_at = self.strides_at + groups * (len(self.layout.strides) * self.layout.modes * self.lanes)
        self.states_at = self.modes_at + groups * (self.lanes * len(self.layout.decays) * self.layout.wide_modes)
        #: Where the states of the modes of one row of buildings are put together.
        self.desk = self.states_at + groups * (self.blocks * (self.layout.modes * STATE * self.lanes))
        self.lows = Lookup(self.trace, [low for low, _ in self.layout.ranges] or [0])
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
                f.rows[name, q] = f.times.full(0.0)
        for group in count_to(self.groups, self.trace):
            self._prepare(group)
        for bundle in count_to((self.groups + (BUNDLE - 1)) // BUNDLE, self.trace):
            first = bundle * BUNDLE
            for block in count_to(self.blocks, self.trace):
                left = (f.last - block * self.length) // self.stride
                for k in count_to(lesser(self.groups - first, whole(self.trace, BUNDLE)), self.trace):
                    self._fill_block(first + k, block, lesser(left, self.steps))

    def _fill_block(self, group: Any, block: Any, steps: Any) -> None:
        """Fill a block of a group; what moves as in the group before it has been found there."""
        f = self.flight
        f.base.now = self._base(group)
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
        self._hand_out(block)

    def _base(self, group: Any) -> Any:
        """Where the tables of the first row of buildings of a group begin."""
        return self.layout.base(group * self.lanes, self.blocks)

    def _row(self, group: Any, name: str, m: Any) -> Any:
        """Where a row of a mode of a group lies."""
        row = group * len(self.layout.strides) + self.layout.strides.index(name)
        return self.strides_at + (row * self.layout.modes + m) * self.lanes

    def _is_new(self, group: Any, m: Any) -> Any:
        """Whether a mode moves otherwise in a group than in the one before it."""
        return load_one(self.wide, self.decays, self._row(group, "new", m)) > 0.5

    # how their modes move ----------------------------------------------------------------------------------------

    def _prepare(self, group: Any) -> None:
        """Find how the modes of a group move, over one step and a long one, and let them be at rest."""
        wide, h = self.wide, load_one(self.wide, self.decays, whole(self.trace, 0))
        early = (group - group // BUNDLE * BUNDLE) == 0
        for long in count_to(lesser(self.stride, whole(self.trace, 2)), self.trace):
            steps = (self.stride - 1) * long + 1
            length = h * (float(steps) if wide is None else real(Count(wide, steps.value)))
            for m in count_to(self.layout.modes, self.trace):
                w, c = (self._wide(self._row(group, name, m)) for name in ("w", "c"))
                push = load_one(wide, self.decays, self.push_at + m)
                for name, x in step(wide, w, c, push, length).items():
                    store(wide, self.decays, self._row(group, name, m), x)
            for _ in when(long == 0):
                self._hand_over(group)
        before = group - lesser(group, whole(self.trace, 1))
        for m in count_to(self.layout.modes, self.trace):
            (w, w0), (c, c0) = ([self._wide(self._row(g, name, m)) for g in (group, before)] for name in ("w", "c"))
            new = early | any_lane(~(w == w0) | ~(c == c0))
            store_one(wide, self.decays, self._row(group, "new", m), where(new, one(wide, 1.0), one(wide, 0.0)))
            found = {"square": w * w, "slowness": 1.0 / w}
            if self.shakes:
                ratio = c / w
                found["heft"] = w * w * sqrt(ratio * ratio + 1.0)
            for name, x in found.items():
                store(wide, self.decays, self._row(group, name, m), x)
            for k in range(STATE):
                store(wide, self.decays, self._state(group, whole(self.trace, 0), m) + k * self.lanes, w * 0.0)

    def _hand_over(self, group: Any) -> None:
        """Give each row of buildings how its modes move over one step, and how they decay over several."""
        f, layout, lanes = self.flight, self.layout, self.lanes
        n, size, base = layout.modes, layout.size(self.blocks), self._base(group)
        h, first, rows = f.number(f.place_of("step")), self._row(group, MOVES[0], 0), len(MOVES) * layout.wide_modes
        for k in count_to(len(MOVES), self.trace):
            mine, at = first + k * (n * lanes), self._own(group * lanes) + k * layout.wide_modes
            self._side_by_side(partial(self._move_of, mine), self.wide, self.decays, at, rows)
        for m in count_to(n, self.trace):
            a = [self._wide(first + (m + row * n) * lanes) for row in range(4)]
            e = [Cell(a[0] * 0.0 + start) for start in (1.0, 0.0, 0.0, 1.0)]
            for k in count_to(self.length + 1, self.trace):
                place = lesser(k, k * 0 + lanes)  # what comes after the last lane's is replaced, up to the block's
                for row, cell in enumerate(e):
                    f.rows["decay", (place * 4 + row) * n + m] = narrow(self.trace, cell.now)
                e0, e1, e2, e3 = (cell.now for cell in e)
                e[0].now, e[1].now = fma(a[0], e0, a[1] * e2), fma(a[0], e1, a[1] * e3)
                e[2].now, e[3].now = fma(a[2], e0, a[3] * e2), fma(a[2], e1, a[3] * e3)
            for row in count_to(4, self.trace):
                unit = where(row < 2, one(self.trace, 1.0), h)
                those = transposed([f.rows["decay", (row + k * 4) * n + m] * unit for k in range(lanes)])
                at = base + layout.place("times", self.blocks) + (m * 4 + row) * lanes
                for lane in range(lanes):
                    store(self.trace, f.tables, at + size * lane, those[lane])
        for k in count_to((lanes + 1) * 4, self.trace):
            at = base + layout.place("advance", self.blocks) + k * layout.wide_modes
            self._side_by_side(partial(self._decay_of, k * n), self.trace, f.tables, at, size)

    def _move_of(self, at: Any, m: Any) -> Any:
        return self._wide(at + m * self.lanes)

    def _decay_of(self, at: Any, m: Any) -> Any:
        return self.flight.rows["decay", at + m]

    def _side_by_side(self, of: Callable[[Any], Any], trace: Any, to: Any, at: Any, size: Any) -> None:
        """Put numbers of all modes side by side, of each lane into a table of its own, so many numbers apart."""
        lanes, (parts, rest) = self.lanes, divmod(self.layout.modes, self.lanes)
        for part in count_to(parts, self.trace) if parts else ():
            for lane, x in enumerate(transposed([of(part * lanes + m) for m in range(lanes)])):
                store(trace, to, at + part * lanes + size * lane, x)
        if rest:
            mine = [of(parts * lanes + m) for m in range(rest)]
            for lane, x in enumerate(transposed(mine + [mine[0] * 0.0] * (lanes - rest))):
                store(trace, to, at + parts * lanes + size * lane, x)

    # through a block ---------------------------------------------------------------------------------------------

    def _kind(self, q: int) -> tuple[int, int, bool]:
        each = self.layout.watched[q]
        return each.kind, self.layout.ranges[q][1], each.kind == ACCELERATION

    def _move(self, group: Any, block: Any, m: Any, steps: Any) -> None:
        """Motions of one mode of all lanes through a block, and the most that it bends and reaches."""
        f, n = self.flight, self.layout.modes
        c = {name: self._wide(self._row(group, name, m)) for name in ("c", *MOVES, "square", "slowness", "heft")}
        slowness = narrow(self.trace, c["slowness"])
        pull, damp = (-narrow(self.trace, c[name]) for name in ("square", "c"))
        push = -narrow(self.trace, load_one(self.wide, self.decays, self.push_at + m))
        rising = push * narrow(self.trace, self.per_stride)
        slow_pull, slow_damp, slow_rising = (x * slowness for x in (pull, damp, rising))
        at = self._state(group, block, m)
        q, p = Cell(self._wide(at)), Cell(self._wide(at + self.lanes))
        zero = f.times.full(0.0)
        bends, reach, shook = Cell(zero), Cell(zero), Cell(zero)
        row, start = m * SPAN, block * self.length

        def keep(k: Any) -> tuple[Any, Any, Any]:
            x, rate = narrow(self.trace, q.now), narrow(self.trace, p.now)
            total = fma(pull, x, damp * rate)
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
            second = fma(push, narrow(self.trace, g0), total)
            third = fma(slow_pull, rate, fma(slow_damp, second, slow_rising * narrow(self.trace, g1 - g0)))
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
        above, below = Cell(f.times.full(-f.group.limit.far)), Cell(f.times.full(f.group.limit.far))
        for k in count_to(steps + 1, self.trace):
            x = f.times.full(0.0)
            for j, weight in enumerate(shape):
                x = fma(weight, f.rows[track, (low + j) * SPAN + k], x)
            above.now, below.now = maximum(above.now, x), minimum(below.now, x)
        bends, reach = f.times.full(0.0), f.times.full(0.0)
        for j, weight in enumerate(shape):
            bends = fma(size(weight), f.rows["bends", low + most + j], bends)
            reach = fma(size(weight), f.rows["reaches", low + most + j], reach)
        long = self.step * real(self.stride)
        swell = fma(bends, long * long * (0.125 * (1.0 + 10.0 * self.margin)), reach * (10.0 * self.margin))
        f.rows["above", q], f.rows["below", q], f.rows["swell", q] = above.now + swell, below.now - swell, swell

    def _hand_out(self, block: Any) -> None:
        """Put the bounds of a block into the tables of each lane's row of buildings."""
        f, lanes, apart = self.flight, self.lanes, self.layout.size(self.blocks)
        for part in range(self.layout.wide_watched // lanes):
            for name, row in (("most", "above"), ("least", "below")):
                those = transposed([f.rows[row, part * lanes + q] for q in range(lanes)])
                at = f.place_of(name) + block * self.layout.wide_watched + part * lanes
                for lane in range(lanes):
                    store(self.trace, f.tables, at + apart * lane, those[lane])
            # the most of all blocks so far lies there by what is watched, in the end by rows of buildings
            at, missed = (f.place_of(name) + part * lanes for name in ("bulge0", "missed0"))
            most = [f.rows["swell", part * lanes + q] for q in range(lanes)]
            for q in range(lanes):
                before = load(self.trace, f.tables, at + apart * q, lanes)
                most[q] = maximum(most[q], where(block == 0, f.times.full(0.0), before))
                store(self.trace, f.tables, at + apart * q, most[q])
            for _ in when(block + 1 == self.blocks):
                for lane, swell in enumerate(transposed(most)):
                    bulge = swell * self.per_square
                    share = load(self.trace, f.tables, missed + apart * lane, lanes)
                    store(self.trace, f.tables, at + apart * lane, bulge)
                    store(self.trace, f.tables, missed + apart * lane, share * bulge)

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
        number = (f.base.now - layout.start) // layout.size(self.blocks)
        group = number // lanes
        lane, start = number - group * lanes, block * self.length
        steps = lesser(f.last - start, self.length)
        for m in count_to(layout.modes, self.trace):
            for k in range(STATE):
                x = load_one(self.wide, self.decays, self._state(group, block, m) + lane + k * lanes)
                store_one(self.wide, self.decays, self.desk + m + k * layout.wide_modes, x)
        parts = range(layout.wide_modes // lanes)
        for mine in (parts[k : k + 2] for k in parts[::2]):  # two at a time wait less for each other's steps
            own = [self._own(number) + part * lanes for part in mine]
            moves = [{n: self._wide(at + k * layout.wide_modes) for k, n in enumerate(layout.decays)} for at in own]
            state = [
                [Cell(self._wide(self.desk + part * lanes + k * layout.wide_modes)) for k in range(STATE)]
                for part in mine
            ]
            for k in count_to(steps, self.trace):
                g0, g1 = self._ground(start + k), self._ground(start + k + 1)
                for part, c, (q, p) in zip(mine, moves, state, strict=True):
                    q0, p0 = q.now, p.now
                    self._keep(part, k, q0, p0)
                    q.now = fma(c["qq"], q0, fma(c["qp"], p0, fma(c["q0"], g0, c["q1"] * g1)))
                    p.now = fma(c["pq"], q0, fma(c["pp"], p0, fma(c["p0"], g0, c["p1"] * g1)))
            for part, (q, p) in zip(mine, state, strict=True):
                self._keep(part, steps, q.now, p.now)
                for name, row, unit in (("free_x", "point_q", 1.0), ("free_rate", "point_p", self.step)):
                    for first in range(0, SPAN, lanes):
                        rows = [f.rows[row, part * SPAN + first + k] for k in range(lanes)]
                        for m, series in enumerate(transposed(rows)[: layout.modes - part * lanes]):
                            place = (part * lanes + m) * layout.series_rows + first // lanes
                            f.rows[name, place] = series * unit
        for k in range(SPAN // lanes):
            f.rows["free_ground", k] = narrow(self.trace, self._wide(start + (HEAD + k * lanes)))

    def _keep(self, part: int, k: Any, q: Any, p: Any) -> None:
        for name, x in (("point_q", q), ("point_p", p)):
            self.flight.rows[name, k + part * SPAN] = narrow(self.trace, x)
