"""The motion without pounding of rows of buildings, as exact flight reads it: at all points of a grid, or by blocks.

The modes move from point to point in double precision, whatever the number format of the
kernel; what is watched, and its extremes in windows or blocks, follow side by side in the lanes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from itertools import groupby
from operator import or_
from typing import Any

from pounding_sweep.kernel.flight import ACCELERATION, HEAD, SPAN, STATE, WIDE, Flight
from pounding_sweep.kernel.modal_steps import MOVES, step
from pounding_sweep.kernel.peaks import septic_extremes
from pounding_sweep.kernel.types import Index, Lanes, Truths
from pounding_sweep.lanes import (
    Cell,
    Count,
    Lookup,
    Table,
    any_lane,
    constant,
    count_to,
    fma,
    lesser,
    maximum,
    minimum,
    narrow,
    not_,
    once_if,
    real,
    rounded,
    size,
    sqrt,
    transposed,
    where,
)

#: Groups of rows of buildings that are filled together, block by block.
BUNDLE = 16


def _step(c: Mapping[str, Lanes], q: Lanes, p: Lanes, g0: Lanes, g1: Lanes) -> list[Lanes]:
    """Return modes and their rates after a step, by `MOVES` and the ground at its ends."""
    return [fma(c[x + "q"], q, fma(c[x + "p"], p, fma(c[x + "0"], g0, c[x + "1"] * g1))) for x in "qp"]


class _Filler:
    # flight: whose motions they are
    # decays: numbers in double precision that they follow from
    # margin: share by which what is watched is widened for rounding

    def __init__(self, flight: Flight, decays: Table, margin: float) -> None:
        self.flight, self.layout, self.lanes = flight, flight.layout, flight.lanes
        self.modes, self.decays, self.margin = flight.layout.modes, decays, margin
        self.points, self.last = flight.points, flight.points - 1

    def narrow(self, x: Lanes) -> Lanes:
        """Return numbers of double precision in the kernel's format."""
        return narrow(self.flight.trace, x)

    def _ground(self, point: Index) -> Lanes:
        return self.decays.number(point + HEAD)


class Tables(_Filler):
    """Fills the tables of flight for the rows of buildings of a call, at all points of the grid."""

    # decays: the ground's acceleration at all points of the grid, then the rows of `Layout.decays` of each row of
    #     buildings

    def fill(self, rows: Index) -> None:
        """Fill the tables of so many rows of buildings; of none where they are filled already."""
        flight, layout, lanes = self.flight, self.layout, self.lanes
        for row in count_to(rows):
            flight.base.now = layout.base(row, self.points)
            start = row * (len(layout.decays) * layout.wide_modes) + self.points + HEAD
            flight.put_decays(self.decays, start)
            for part in count_to(len(flight.mode_parts)):
                c = {
                    name: self.decays.vector(start + (k * layout.wide_modes + part * lanes))
                    for k, name in enumerate(layout.decays)
                }
                self._move(c, part)
                if "input" in layout.timed:
                    self._give_back(c, part)
            self._turn_over()
            for shaken, run in groupby(flight.watched_parts, self._shaken_in):
                first, *others = run
                for k in count_to(1 + len(others)):
                    self._weigh_ground(first + k)
                    if flight.group.spec.windows:
                        self._follow(first + k, shaken)
                        self._widen(first + k)

    def _shaken_in(self, part: int) -> frozenset[bool]:
        """Whether what is watched in a part is total accelerations: all, some or none of it."""
        watched = self.layout.watched[part * self.lanes : (part + 1) * self.lanes]
        return frozenset(quantity.kind == ACCELERATION for quantity in watched)

    def _put(self, name: str, t: Index, part: Index, x: Lanes) -> None:
        at = t * self.layout.timed[name] + part * self.lanes
        self.flight.tables.put_vector(self.flight.place_of(name) + at, x)

    def _move(self, c: dict[str, Lanes], part: Index) -> None:
        """Motions of the modes of one vector from point to point; what the ground puts in."""
        zero = c["push"] * 0.0
        energies = "input" in self.layout.timed
        q, p, energy, most = Cell(zero), Cell(zero), Cell(zero), Cell(zero)
        for t in count_to(self.points):
            self._put("q", t, part, q.now)
            self._put("p", t, part, p.now)
            if energies:
                self._put("input", t, part, energy.now)
            for _ in once_if(t < self.last):
                g0, g1 = self._ground(t), self._ground(t + 1)
                rise = (g1 - g0) * self.decays.number(1)
                second = -fma(c["square"], q.now, c["damping"] * p.now) - c["push"] * g0
                third = (-fma(c["square"], p.now, c["damping"] * second) - c["push"] * rise) * c["slowness"]
                most.now = maximum(most.now, fma(second, second, third * third))
                q1, p1 = _step(c, q.now, p.now, g0, g1)
                if energies:
                    h = self.decays.number(0)
                    area = (p1 - p.now) + c["damping"] * (q1 - q.now) + c["push"] * ((g0 + g1) * (0.5 * h))
                    gained = g0 * (q1 - q.now) + (g1 - g0) * (q1 + c["area"] * area)
                    energy.now = fma(c["weight"], gained, energy.now)
                q.now, p.now = q1, p1
        self.flight.rows["amplitude", part] = self.narrow(sqrt(most.now))

    def _give_back(self, c: dict[str, Lanes], part: Index) -> None:
        """Fill in what a free motion will still take from the ground, backwards from its end."""
        zero = c["push"] * 0.0
        q, p = Cell(zero), Cell(zero)
        for k in count_to(self.points):
            t = self.last - k
            for _ in once_if(k > 0):
                g0, rise = self._ground(t), self._ground(t + 1) - self._ground(t)
                q1, p1 = q.now, p.now
                q.now = fma(c["qq"], q1, fma(c["pq"], p1, fma(c["adjoint_q"], g0, c["adjoint_rise_q"] * rise)))
                p.now = fma(c["qp"], q1, fma(c["pp"], p1, fma(c["adjoint_p"], g0, c["adjoint_rise_p"] * rise)))
            self._put("adjoint_q", t, part, q.now)
            self._put("adjoint_p", t, part, p.now)

    def _turn_over(self) -> None:
        """Let each mode's values and rates, and the ground's accelerations, lie one after another."""
        f, many, put = self.flight, self.points + self.lanes, self.flight.tables.put_number
        h = f.number("step")
        for t in count_to(self.points):
            for m in count_to(self.modes):
                at = t * self.layout.wide_modes + m
                put(f.place_of("x") + m * many + t, f.number("q", at))
                put(f.place_of("rate") + m * many + t, h * f.number("p", at))
            put(f.place_of("ground") + t, self.narrow(self._ground(t)))

    def _weigh_ground(self, part: Index) -> None:
        """Find how far what is watched leaves its chords, and the hulls of cubics, at most, without pounding."""
        f, h = self.flight, self.flight.number("step")
        for name, tables, share in (("bulge0", self.layout.bounds, 8.0), ("missed0", self.layout.bulges, 48.0)):
            total = f.times.cell(0.0)
            for table, factor in tables:
                for m in count_to(self.modes):
                    a = f.rows.number("amplitude", m)
                    a = a * f.number(factor, m) if factor else a
                    total.now = fma(self._across(table, m, part), a, total.now)
            f.tables.put_vector(f.place_of(name) + part * self.lanes, total.now * (h * h * (1.0 / share)))

    def _across(self, name: str, m: Index, part: Index) -> Lanes:
        """Return what mode m adds to what is watched."""
        return self.flight.vector(name, m * self.layout.wide_watched + part * self.lanes)

    def _watched_at(
        self, t: Index, part: Index, shaken_in: frozenset[bool], first: int = 0, count: int = 4
    ) -> list[Lanes]:
        """Find what is watched at point t, and its rates times powers of the step, from the `first` on.

        What the rise of the ground adds to them is apart.
        """
        f, ground = self.flight, self.narrow(self._ground(t))
        sums = [f.times.cell(0.0) for _ in range(count)]
        h, per, shaken = f.number("step"), f.number("inverse"), f.part("shaken", part) > 0.5
        for m in count_to(self.modes) if first else f.indices(self.modes, 4):
            q, p = (f.number(name, t * self.layout.wide_modes + m) for name in "qp")
            stiff, damped, push = (f.number(name, m) for name in ("square", "damping", "push"))
            total = -(stiff * q + damped * (h * p))
            rates: list[Lanes] = [q, h * p, total - push * ground]
            while len(rates) < first + count + 2:
                rates.append(-(stiff * rates[-2] + damped * rates[-1]))
            values = rates[first : first + count]
            if f.coupled:
                for value, cell in zip(rates[first + 1 :], sums, strict=False):
                    cell.now = fma(self._across("across_rate", m, part), value, cell.now)
            elif True in shaken_in:
                for k, rate in enumerate(rates[first + 2 : first + count + 2]):
                    shake = per * (rate if first + k else total)
                    values[k] = where(shaken, shake, f.times.full(values[k])) if False in shaken_in else shake
            for value, cell in zip(values, sums, strict=True):
                cell.now = fma(self._across("across", m, part), value, cell.now)
        return [cell.now for cell in sums]

    def _pushed(self, part: Index) -> list[Lanes]:
        """How much of the ground's rise in a step the second to the fifth rate of what is watched take off."""
        f, sums = self.flight, [Cell(self.flight.times.full(0.0)) for _ in range(4)]
        per, shaken, full = f.number("inverse"), f.part("shaken", part) > 0.5, f.times.full
        for m in f.indices(self.modes):
            weight = self._across("across", m, part)
            stiff, damped, push = (f.number(name, m) for name in ("square", "damping", "push"))
            rates = [0.0 * push, push]
            while len(rates) < 6:
                rates.append(-(stiff * rates[-2] + damped * rates[-1]))
            for k, cell in enumerate(sums):
                if f.coupled:
                    cell.now = fma(self._across("across_rate", m, part), rates[k + 1], cell.now)
                x = full(rates[k]) if f.coupled else where(shaken, full(per * rates[k + 2]), full(rates[k]))
                cell.now = fma(weight, x, cell.now)
        return [cell.now for cell in sums]

    def _follow(self, part: Index, shaken_in: frozenset[bool]) -> None:
        """Extremes of what is watched in each step of the grid, and up to each point."""
        f = self.flight
        x, *rates = self._watched_at(0, part, shaken_in)
        before, pushed = [Cell(value) for value in (x, *rates)], self._pushed(part)
        peak, trough = Cell(x), Cell(x)
        self._put("peak", 0, part, x)
        self._put("trough", 0, part, x)
        for k in count_to(self.last):
            now = self._watched_at(k + 1, part, shaken_in)
            (x0, s0, c0, j0), (x1, s1, c1, j1) = [cell.now for cell in before], now
            rise = self.narrow(self._ground(k + 1) - self._ground(k))
            c, j, *more = (share * rise for share in pushed)
            start, end = (x0, s0, c0 - c, j0 - j), (x1, s1, c1 - c, j1 - j)

            def higher(k: Index = k, more: Sequence[Lanes] = more) -> list[tuple[Lanes, Lanes]]:
                early, late = (self._watched_at(t, part, shaken_in, 4, 2) for t in (k, k + 1))
                return [(x - less, y - less) for x, y, less in zip(early, late, more, strict=True)]

            so_far = peak.now, trough.now
            above, below = septic_extremes(f.times, f.times.full(True), start, end, so_far, higher)
            peak.now, trough.now = maximum(peak.now, above), minimum(trough.now, below)
            for name, extreme in (("widest", above), ("widest_least", below)):
                self._put(name, k, part, extreme)
            for name, extreme in (("peak", peak.now), ("trough", trough.now)):
                self._put(name, k + 1, part, extreme)
            for cell, value in zip(before, now, strict=True):
                cell.now = value
        for name in ("widest", "widest_least"):
            self._put(name, self.last, part, before[0].now)
        f.rows["reach", part] = maximum(size(peak.now), size(trough.now)) * self.margin

    def _widen(self, part: Index) -> None:
        """Extremes of windows from each point on, out of those of single steps."""
        f, length = self.flight, self.lanes - 1
        for near, wide, better, sign in (("most", "widest", maximum, 1.0), ("least", "widest_least", minimum, -1.0)):
            spans, width = [], 1  # to which table, how much later, and whether it is widened
            while 2 * width <= WIDE:
                spans += [(near, length - width, True)] if width <= length < 2 * width else []
                spans, width = [*spans, (wide, width, False)], 2 * width
            for to, later, last in [*spans, (wide, WIDE - width, True)]:
                margin = f.rows["reach", part] * sign if last else None
                for t in count_to(self.points):
                    best = Cell(f.part(wide, part, t))
                    for _ in once_if(t + later < self.points):
                        best.now = better(best.now, f.part(wide, part, t + later))
                    self._put(to, t, part, best.now if margin is None else best.now + margin)


class Blocks(_Filler):
    """Fills blocks of rows of buildings that each have a motion of their own, many side by side in the lanes."""

    # tables of all points would cost more than the impacts; what stays is the state at the beginning of each block and
    # bounds of what is watched in it: a block that these don't rule out is gone through again, for one scenario

    # decays: `HEAD` numbers, the ground's acceleration at all points of the grid, what it pushes each mode by, the rows
    #     of `Layout.strides` of each group of rows of buildings, of which the first two are known, and room for those
    #     of `Layout.decays` of each row of buildings and for states
    # rows: rows of buildings
    # cell: makes a variable that is there at the next call of flight, of a first value

    def __init__(self, flight: Flight, decays: Table, margin: float, rows: Index, cell: Callable[[Any], Cell]) -> None:
        super().__init__(flight, decays, margin)
        layout, wide = self.layout, self.layout.wide_modes
        step, per_stride, stride, length = (decays.number(k) for k in range(HEAD))
        self.step, self.per_stride = self.narrow(step), per_stride
        #: Points of the grid in a long step, in a block, and long steps in a block.
        self.stride, self.length = (rounded(self.narrow(x)) for x in (stride, length))
        self.steps = self.length // self.stride
        #: By what the bulge of one step is less than that of a long one.
        self.per_square = 1.0 / (real(self.stride) * real(self.stride))
        self.blocks = (self.last + (self.length - 1)) // self.length
        self.groups = groups = (rows + (self.lanes - 1)) // self.lanes
        self.push_at = flight.points + HEAD
        self.strides_at = self.push_at + wide
        self.modes_at = self.strides_at + groups * (len(layout.strides) * self.modes * self.lanes)
        self.states_at = self.modes_at + groups * (self.lanes * len(layout.decays) * wide)
        #: Where the states of the modes of one row of buildings are put together.
        self.desk = self.states_at + groups * (self.blocks * (self.modes * STATE * self.lanes))
        self.lows = Lookup([low for low, _ in layout.ranges] or [0])
        self.shakes = any(quantity.kind == ACCELERATION for quantity in layout.watched)
        #: The block that lies point by point, and whose: where its tables begin.
        self.filled, self.owner = cell(0), cell(0)

    def _modes_of(self, number: Index) -> Index:
        """Where the rows of modes of a row of buildings begin."""
        return self.modes_at + number * (len(self.layout.decays) * self.layout.wide_modes)

    def _state(self, group: Index, block: Index, m: Index) -> Index:
        """Where the states of a mode at the beginning of a block lie."""
        at = (group * self.blocks + block) * self.modes + m
        return self.states_at + at * (STATE * self.lanes)

    # all of them -----------------------------------------------------------------------------------------------

    def fill(self) -> None:
        """Fill all blocks of all rows of buildings, as many side by side as there are lanes."""
        f = self.flight
        self.filled.now = -1
        for name in ("above", "below", "swell"):
            for q in count_to(self.layout.wide_watched):
                f.rows[name, q] = f.times.full(0.0)
        for group in count_to(self.groups):
            self._prepare(group)
        for bundle in count_to((self.groups + (BUNDLE - 1)) // BUNDLE):
            first = bundle * BUNDLE
            for block in count_to(self.blocks):
                left = (self.last - block * self.length) // self.stride
                for k in count_to(lesser(self.groups - first, BUNDLE)):
                    self._fill_block(first + k, block, lesser(left, self.steps))

    def _fill_block(self, group: Index, block: Index, steps: Index) -> None:
        """Fill a block of a group; what moves as in the group before it has been found there."""
        self.flight.base.now = self.layout.base(group * self.lanes, self.blocks)
        for m in count_to(self.modes):
            new = self._is_new(group, m)
            for _ in once_if(new):
                self._move(group, block, m, steps)
            for _ in once_if(not_(new) & (block + 1 < self.blocks)):
                to, source = (self._state(group - before, block + 1, m) for before in (0, 1))
                for k in range(STATE):
                    self.decays.put_vector(to + k * self.lanes, self.decays.vector(source + k * self.lanes))
        kinds = [quantity.kind for quantity in self.layout.watched]
        for (kind, many), run in groupby(range(len(kinds)), lambda q: (kinds[q], self.layout.ranges[q][1])):
            numbers = list(run)
            for q in count_to(len(numbers)):
                number = q + numbers[0]
                new = reduce(or_, [self._is_new(group, self.lows[number] + k) for k in range(many)], constant(False))
                for _ in once_if(new):
                    self._watch(number, many, kind == ACCELERATION, steps)
        self._hand_out(block)

    def _row(self, group: Index, name: str, m: Index) -> Index:
        """Where a row of a mode of a group lies."""
        row = group * len(self.layout.strides) + self.layout.strides.index(name)
        return self.strides_at + (row * self.modes + m) * self.lanes

    def _is_new(self, group: Index, m: Index) -> Truths:
        """Whether a mode moves otherwise in a group than in the one before it."""
        return self.decays.number(self._row(group, "new", m)) > 0.5

    # how their modes move ----------------------------------------------------------------------------------------

    def _prepare(self, group: Index) -> None:
        """Find how the modes of a group move, over one step and a long one, and let them be at rest."""
        decays, wide = self.decays, self.decays.trace
        early = (group - group // BUNDLE * BUNDLE) == 0
        for long in count_to(lesser(self.stride, 2)):
            steps = (self.stride - 1) * long + 1
            length = decays.number(0) * (float(steps) if wide is None else real(Count(wide, steps.value)))
            for m in count_to(self.modes):
                w, c = (decays.vector(self._row(group, name, m)) for name in ("w", "c"))
                for name, x in step(w, c, decays.number(self.push_at + m), length).items():
                    decays.put_vector(self._row(group, name, m), x)
            for _ in once_if(long == 0):
                self._hand_over(group)
        before = group - lesser(group, 1)
        for m in count_to(self.modes):
            w, c, w0, c0 = (decays.vector(self._row(g, name, m)) for g in (group, before) for name in ("w", "c"))
            new = early | any_lane(~(w == w0) | ~(c == c0))
            decays.put_number(self._row(group, "new", m), where(new, 1.0, 0.0))
            rows = {"square": w * w, "slowness": 1.0 / w}
            if self.shakes:
                ratio = c / w
                rows["heft"] = w * w * sqrt(ratio * ratio + 1.0)
            for name, x in rows.items():
                decays.put_vector(self._row(group, name, m), x)
            for k in range(STATE):
                decays.put_vector(self._state(group, 0, m) + k * self.lanes, w * 0.0)

    def _hand_over(self, group: Index) -> None:
        """Give each row of buildings how its modes move over one step, and how they decay over several."""
        f, n, lanes, wide = self.flight, self.modes, self.lanes, self.layout.wide_modes
        for k in count_to(len(MOVES)):
            first, at = self._row(group, MOVES[0], k * n), self._modes_of(group * lanes) + k * wide
            for part in f.mode_parts:
                modes = [self.decays.vector(first + m * lanes) for m in range(part * lanes, min(n, (part + 1) * lanes))]
                modes += [modes[0] * 0.0] * (lanes - len(modes))
                for lane, x in enumerate(transposed(modes)):
                    self.decays.put_vector(at + part * lanes + len(MOVES) * wide * lane, x)
        for lane in count_to(lanes):
            f.base.now = self.layout.base(group * lanes + lane, self.blocks)
            f.put_decays(self.decays, self._modes_of(group * lanes + lane))

    # through a block ---------------------------------------------------------------------------------------------

    def _move(self, group: Index, block: Index, m: Index, steps: Index) -> None:
        """Motions of one mode of all lanes through a block, and the most that it bends and reaches."""
        f, n = self.flight, self.modes
        c = {
            name: self.decays.vector(self._row(group, name, m)) for name in ("c", *MOVES, "square", "slowness", "heft")
        }
        slowness = self.narrow(c["slowness"])
        pull, damp = (-self.narrow(c[name]) for name in ("square", "c"))
        push = -self.narrow(self.decays.number(self.push_at + m))
        rising = push * self.narrow(self.per_stride)
        slow_pull, slow_damp, slow_rising = (x * slowness for x in (pull, damp, rising))
        at = self._state(group, block, m)
        q, p = Cell(self.decays.vector(at)), Cell(self.decays.vector(at + self.lanes))
        zero = f.times.full(0.0)
        bends, reach, shook = Cell(zero), Cell(zero), Cell(zero)
        row, start = m * SPAN, block * self.length

        def keep(k: Index) -> tuple[Lanes, Lanes, Lanes]:
            x, rate = self.narrow(q.now), self.narrow(p.now)
            total = fma(pull, x, damp * rate)
            f.rows["track", row + k] = x
            reach.now = maximum(reach.now, size(x))
            if self.shakes:
                f.rows["shook", row + k] = total
                shook.now = maximum(shook.now, size(total))
            return x, rate, total

        for k in count_to(steps):
            at = start + k * self.stride
            g0, g1 = self._ground(at), self._ground(at + self.stride)
            _, rate, total = keep(k)
            second = fma(push, self.narrow(g0), total)
            third = fma(slow_pull, rate, fma(slow_damp, second, slow_rising * self.narrow(g1 - g0)))
            bends.now = maximum(bends.now, fma(second, second, third * third))
            q.now, p.now = _step(c, q.now, p.now, g0, g1)
        keep(steps)
        for _ in once_if(block + 1 < self.blocks):
            for k, cell in enumerate((q, p)):
                self.decays.put_vector(self._state(group, block + 1, m) + k * self.lanes, cell.now)
        f.rows["bends", m], f.rows["reaches", m] = sqrt(bends.now), reach.now
        if self.shakes:
            f.rows["bends", n + m] = sqrt(bends.now) * self.narrow(c["heft"])
            f.rows["reaches", n + m] = shook.now

    def _watch(self, q: Index, many: int, shaken: bool, steps: Index) -> None:
        """Bounds of what is watched in a block."""
        f, n = self.flight, self.modes
        low = self.lows[q]
        shape = [f.number("shape", q * n + low + k) for k in range(many)]
        track, most = "shook" if shaken else "track", n if shaken else 0
        above, below = f.times.cell(-f.group.limit.far), f.times.cell(f.group.limit.far)
        for k in count_to(steps + 1):
            x = f.times.full(0.0)
            for j, weight in enumerate(shape):
                x = fma(weight, f.rows[track, (low + j) * SPAN + k], x)
            above.now, below.now = maximum(above.now, x), minimum(below.now, x)
        bends = reach = f.times.full(0.0)
        for j, weight in enumerate(shape):
            bends = fma(size(weight), f.rows["bends", low + most + j], bends)
            reach = fma(size(weight), f.rows["reaches", low + most + j], reach)
        long = self.step * real(self.stride)
        swell = fma(bends, long * long * (0.125 * (1.0 + 10.0 * self.margin)), reach * (10.0 * self.margin))
        f.rows["above", q], f.rows["below", q], f.rows["swell", q] = above.now + swell, below.now - swell, swell

    def _hand_out(self, block: Index) -> None:
        """Put the bounds of a block into the tables of each lane's row of buildings."""
        f, lanes, stride = self.flight, self.lanes, self.layout.size(self.blocks)
        for part in f.watched_parts:
            for name, row in (("most", "above"), ("least", "below")):
                those = transposed([f.rows[row, part * lanes + q] for q in range(lanes)])
                at = f.place_of(name) + block * self.layout.wide_watched + part * lanes
                for lane in range(lanes):
                    f.tables.put_vector(at + stride * lane, those[lane])
            # the most of all blocks so far lies there by what is watched, in the end by rows of buildings
            at, missed = (f.place_of(name) + part * lanes for name in ("bulge0", "missed0"))
            most = [f.rows["swell", part * lanes + q] for q in range(lanes)]
            for q in range(lanes):
                before = f.tables.vector(at + stride * q)
                most[q] = maximum(most[q], where(block == 0, 0.0, before))
                f.tables.put_vector(at + stride * q, most[q])
            for _ in once_if(block + 1 == self.blocks):
                for lane, swell in enumerate(transposed(most)):
                    bulge = swell * self.per_square
                    share = f.tables.vector(missed + stride * lane)
                    f.tables.put_vector(at + stride * lane, bulge)
                    f.tables.put_vector(missed + stride * lane, share * bulge)

    # one of them -----------------------------------------------------------------------------------------------

    @property
    def start(self) -> Index:
        """First point of the block that is known."""
        return self.filled.now * self.length

    def of(self, t: Index) -> Index:
        """Block in which point t lies; of the last point, the one that ends there."""
        return lesser(t // self.length, self.blocks - 1)

    def know(self, block: Index) -> None:
        """Go through a block of the scenario that flies, point by point, where it is not the last one that was."""
        f = self.flight
        same = (self.filled.now == block) & (self.owner.now == f.base.now)
        for _ in once_if(not_(same)):
            self.filled.now, self.owner.now = block, f.base.now
            self._expand(block)

    def _expand(self, block: Index) -> None:
        f, layout, lanes = self.flight, self.layout, self.lanes
        number = (f.base.now - layout.start) // layout.size(self.blocks)
        group = number // lanes
        lane, start = number - group * lanes, block * self.length
        steps = lesser(self.last - start, self.length)
        for m in count_to(self.modes):
            for k in range(STATE):
                x = self.decays.number(self._state(group, block, m) + lane + k * lanes)
                self.decays.put_number(self.desk + m + k * layout.wide_modes, x)
        for first in f.mode_parts[::2]:  # two at a time wait less for each other's steps
            parts = f.mode_parts[first : first + 2]
            moves = [
                {
                    name: self.decays.vector(self._modes_of(number) + (k * layout.wide_modes + part * lanes))
                    for k, name in enumerate(layout.decays)
                }
                for part in parts
            ]
            state = [
                [Cell(self.decays.vector(self.desk + part * lanes + k * layout.wide_modes)) for k in range(STATE)]
                for part in parts
            ]
            for k in count_to(steps):
                g0, g1 = self._ground(start + k), self._ground(start + k + 1)
                for part, c, (q, p) in zip(parts, moves, state, strict=True):
                    self._keep(part, k, q.now, p.now)
                    q.now, p.now = _step(c, q.now, p.now, g0, g1)
            for part, (q, p) in zip(parts, state, strict=True):
                self._keep(part, steps, q.now, p.now)
                for name, row, unit in (("free_x", "point_q", 1.0), ("free_rate", "point_p", self.step)):
                    for k in range(0, SPAN, lanes):
                        rows = [f.rows[row, part * SPAN + k + lane] for lane in range(lanes)]
                        for m, series in enumerate(transposed(rows)[: self.modes - part * lanes]):
                            place = (part * lanes + m) * layout.series_rows + k // lanes
                            f.rows[name, place] = series * unit
        for k in range(SPAN // lanes):
            f.rows["free_ground", k] = self.narrow(self.decays.vector(start + (HEAD + k * lanes)))

    def _keep(self, part: int, k: Index, q: Lanes, p: Lanes) -> None:
        for name, x in (("point_q", q), ("point_p", p)):
            self.flight.rows[name, k + part * SPAN] = self.narrow(x)
