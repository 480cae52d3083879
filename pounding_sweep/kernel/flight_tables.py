"""The motion without pounding of a row of buildings, as exact flight reads it: at all points of a grid, and in windows.

The modes move from point to point in double precision, whatever the number format of the
kernel; what is watched, and its extremes in windows, follow side by side in the lanes.
"""

from __future__ import annotations

from typing import Any

from pounding_sweep.kernel.flight import ACCELERATION, HEAD, WIDE, Flight
from pounding_sweep.kernel.lanes import (
    Cell,
    Tracer,
    count_to,
    fma,
    load,
    load_one,
    maximum,
    minimum,
    narrow,
    size,
    sqrt,
    store,
    store_one,
    when,
    where,
    whole,
)
from pounding_sweep.kernel.peaks import septic_extremes


class Tables:
    """Fills the tables of flight for the rows of buildings of a call."""

    # flight: whose tables they are
    # decays: in double precision: the ground's acceleration at all points of the grid, then the rows of
    #     `Layout.decays` of each row of buildings
    # wide: double precision; None: NumPy
    # margin: share of its largest size by which what is watched is widened in windows

    def __init__(self, flight: Flight, decays: Any, wide: Tracer | None, margin: float) -> None:
        self.flight, self.layout, self.lanes = flight, flight.layout, flight.lanes
        self.trace, self.wide, self.decays, self.margin = flight.trace, wide, decays, margin
        self.points, self.last = flight.points, flight.last

    def fill(self, rows: Any) -> None:
        """Fill the tables of so many rows of buildings; of none where they are filled already."""
        flight = self.flight
        for row in count_to(rows, self.trace):
            flight.base.now = self.layout.base(row, self.points)
            own = row * (len(self.layout.decays) * self.layout.wide_modes) + self.points + HEAD
            flight.put_decays(self.wide, self.decays, own)
            for part in range(self.layout.wide_modes // self.lanes):
                self._move(own + part * self.lanes, part)
                if "given" in self.layout.timed:
                    self._give_back(own + part * self.lanes, part)
            for m in count_to(self.layout.modes, self.trace):
                self._turn_over(m)
            self._put_ground()
            for part in range(self.layout.wide_watched // self.lanes):
                self._weigh_ground(part)
                if flight.group.spec.windows:
                    self._follow(part)
                    self._widen(part)

    def _ground(self, t: Any) -> Any:
        return load_one(self.wide, self.decays, t + HEAD)

    def _constants(self, own: Any) -> dict[str, Any]:
        names, many = self.layout.decays, self.layout.wide_modes
        return {name: load(self.wide, self.decays, own + k * many, self.lanes) for k, name in enumerate(names)}

    def _put(self, name: str, t: Any, part: int, x: Any) -> None:
        at = self.flight.place_of(name) + t * self.layout.timed[name] + part * self.lanes
        store(self.trace, self.flight.tables, at, x)

    def _move(self, own: Any, part: int) -> None:
        """Motions of the modes of one vector from point to point; what the ground puts in."""
        c = self._constants(own)
        zero = c["push"] * 0.0
        energies = "given" in self.layout.timed
        q, p, given, most = Cell(zero), Cell(zero), Cell(zero), Cell(zero)
        for t in count_to(self.points, self.trace):
            self._put("q", t, part, q.now)
            self._put("p", t, part, p.now)
            if energies:
                self._put("given", t, part, given.now)
            for _ in when(t < self.last):
                g0, g1 = self._ground(t), self._ground(t + 1)
                rise = (g1 - g0) * load_one(self.wide, self.decays, whole(self.trace, 1))
                second = -fma(c["square"], q.now, c["damping"] * p.now) - c["push"] * g0
                third = (-fma(c["square"], p.now, c["damping"] * second) - c["push"] * rise) * c["slowness"]
                most.now = maximum(most.now, fma(second, second, third * third))
                q0, p0 = q.now, p.now
                q1 = fma(c["qq"], q0, fma(c["qp"], p0, fma(c["q0"], g0, c["q1"] * g1)))
                p1 = fma(c["pq"], q0, fma(c["pp"], p0, fma(c["p0"], g0, c["p1"] * g1)))
                if energies:
                    h = load_one(self.wide, self.decays, whole(self.trace, 0))
                    area = (p1 - p0) + c["damping"] * (q1 - q0) + c["push"] * ((g0 + g1) * (0.5 * h))
                    gained = g0 * (q1 - q0) + (g1 - g0) * (q1 + c["area"] * area)
                    given.now = fma(c["weight"], gained, given.now)
                q.now, p.now = q1, p1
        self.flight.rows["amplitude", part] = narrow(self.trace, sqrt(most.now))

    def _give_back(self, own: Any, part: int) -> None:
        """Fill in what a free motion will still take from the ground, backwards from its end."""
        c = self._constants(own)
        zero = c["push"] * 0.0
        q, p = Cell(zero), Cell(zero)
        for k in count_to(self.points, self.trace):
            t = self.last - k
            for _ in when(k > 0):
                g0, rise = self._ground(t), self._ground(t + 1) - self._ground(t)
                q1, p1 = q.now, p.now
                q.now = fma(c["qq"], q1, fma(c["pq"], p1, fma(c["adjoint_q"], g0, c["adjoint_rise_q"] * rise)))
                p.now = fma(c["qp"], q1, fma(c["pp"], p1, fma(c["adjoint_p"], g0, c["adjoint_rise_p"] * rise)))
            self._put("adjoint_q", t, part, q.now)
            self._put("adjoint_p", t, part, p.now)

    def _turn_over(self, m: Any) -> None:
        """Let a mode's values and rates lie one after another."""
        f, many = self.flight, self.points + self.lanes
        h = load_one(self.trace, f.tables, f.place_of("step"))
        x, rate = (f.place_of(name) + m * many for name in ("x", "rate"))
        q, p = (f.place_of(name) + m for name in ("q", "p"))
        for t in count_to(self.points, self.trace):
            at = t * self.layout.wide_modes
            store_one(self.trace, f.tables, x + t, load_one(self.trace, f.tables, q + at))
            store_one(self.trace, f.tables, rate + t, h * load_one(self.trace, f.tables, p + at))
        for k in count_to(self.lanes, self.trace):
            for row in (x, rate):
                store_one(self.trace, f.tables, row + self.points + k, 0.0)

    def _put_ground(self) -> None:
        """Let the ground's accelerations lie beside the modes."""
        f = self.flight
        at = f.place_of("ground")
        for t in count_to(self.points, self.trace):
            store_one(self.trace, f.tables, at + t, narrow(self.trace, self._ground(t)))
        for k in count_to(self.lanes, self.trace):
            store_one(self.trace, f.tables, at + self.points + k, 0.0)

    def _weigh_ground(self, part: int) -> None:
        """Find how far what is watched leaves its chords, and the hulls of cubics, at most, without pounding."""
        f, wide = self.flight, self.layout.wide_watched
        h = load_one(self.trace, f.tables, f.place_of("step"))
        for name, tables, share in (("bulge0", self.layout.bounds, 8.0), ("missed0", self.layout.bulges, 48.0)):
            total = Cell(f.times.full(0.0))
            for table, factor in tables:
                at, own = f.place_of(table) + part * self.lanes, f.place_of(factor) if factor else None
                for m in count_to(self.layout.modes, self.trace):
                    a = f.rows.number("amplitude", m)
                    a = a if own is None else a * load_one(self.trace, f.tables, own + m)
                    total.now = fma(load(self.trace, f.tables, at + m * wide, self.lanes), a, total.now)
            store(self.trace, f.tables, f.place_of(name) + part * self.lanes, total.now * (h * h * (1.0 / share)))

    def _watched_at(self, t: Any, part: int) -> list[Any]:
        """Find what is watched at point t and three rates, times the step; the rise of the ground is apart."""
        f, layout = self.flight, self.layout
        names = (
            "square",
            "damping",
            "push",
            "inverse",
            "step",
            "across",
            *(("across_rate",) if layout.coupled else ()),
        )
        of = {name: f.place_of(name) for name in names}
        h, per = (load_one(self.trace, f.tables, of[name]) for name in ("step", "inverse"))
        ground = narrow(self.trace, self._ground(t))
        sums = [Cell(f.times.full(0.0)) for _ in range(4)]
        shakes = any(each.kind == ACCELERATION for each in self._mine(part))
        moves = any(each.kind != ACCELERATION for each in self._mine(part))
        shaken = load(self.trace, f.tables, f.place_of("shaken") + part * self.lanes, self.lanes) > 0.5
        at = t * layout.wide_modes
        q_at, p_at = f.place_of("q") + at, f.place_of("p") + at
        for m in f.each(layout.modes, 4):
            q = load_one(self.trace, f.tables, q_at + m)
            rate = h * load_one(self.trace, f.tables, p_at + m)
            stiff, damped, push = (
                load_one(self.trace, f.tables, of[name] + m) for name in ("square", "damping", "push")
            )
            total = -(stiff * q + damped * rate)
            second = total - push * ground
            third = -(stiff * rate + damped * second)
            values: list[Any] = [q, rate, second, third]
            place = m * layout.wide_watched + part * self.lanes
            if layout.coupled:
                higher = [rate, second, third, -(stiff * second + damped * third)]
                own = load(self.trace, f.tables, of["across_rate"] + place, self.lanes)
                for value, cell in zip(higher, sums, strict=True):
                    cell.now = fma(own, value, cell.now)
            elif shakes:
                fourth = -(stiff * second + damped * third)
                shake = [each * per for each in (total, third, fourth, -(stiff * third + damped * fourth))]
                values = (
                    [where(shaken, a, f.times.full(b)) for a, b in zip(shake, values, strict=True)] if moves else shake
                )
            weight = load(self.trace, f.tables, of["across"] + place, self.lanes)
            for value, cell in zip(values, sums, strict=True):
                cell.now = fma(weight, value, cell.now)
        return [cell.now for cell in sums]

    def _pushed(self, part: int) -> list[Any]:
        """How much of the ground's rise in a step the second and the third rate of what is watched take off."""
        f, sums = self.flight, [Cell(self.flight.times.full(0.0)) for _ in range(2)]
        per, across = load_one(self.trace, f.tables, f.place_of("inverse")), f.place_of("across") + part * self.lanes
        shaken = load(self.trace, f.tables, f.place_of("shaken") + part * self.lanes, self.lanes) > 0.5
        rates = f.place_of("across_rate") + part * self.lanes if self.layout.coupled else None
        for m in f.each(self.layout.modes):
            weight = load(self.trace, f.tables, across + m * self.layout.wide_watched, self.lanes)
            stiff, damped, push = (
                load_one(self.trace, f.tables, f.place_of(name) + m) for name in ("square", "damping", "push")
            )
            if self.layout.coupled:
                own = load(self.trace, f.tables, rates + m * self.layout.wide_watched, self.lanes)
                sums[0].now = fma(own, push, sums[0].now)
                sums[1].now = fma(weight - damped * own, push, sums[1].now)
                continue
            lift, lift5 = -damped * push * per, (damped * damped - stiff) * push * per
            for value, other, cell in ((lift, 0.0, sums[0]), (lift5, push, sums[1])):
                cell.now = fma(weight, where(shaken, f.times.full(value), f.times.full(other)), cell.now)
        return [cell.now for cell in sums]

    def _mine(self, part: int) -> list[Any]:
        return self.layout.watched[part * self.lanes : (part + 1) * self.lanes]

    def _follow(self, part: int) -> None:
        """Extremes of what is watched in each step of the grid, and up to each point."""
        f = self.flight
        zero, none = f.times.full(0.0), whole(self.trace, 0)
        x, *rates = self._watched_at(none, part)
        before, pushed = [Cell(value) for value in (x, *rates)], self._pushed(part)
        peak, trough = Cell(x), Cell(x)
        self._put("peak", none, part, x)
        self._put("trough", none, part, x)
        for k in count_to(self.last, self.trace):
            t = k + 1
            now = self._watched_at(t, part)
            (x0, s0, c0, j0), (x1, s1, c1, j1) = [cell.now for cell in before], now
            rise = narrow(self.trace, self._ground(t) - self._ground(k))
            c, j = (each * rise for each in pushed)
            start, end = (x0, s0, c0 - c, j0 - j), (x1, s1, c1 - c, j1 - j)
            above, below = septic_extremes(f.times, f.times.lanes_where(True), start, end)
            self._put("widest", k, part, above)
            self._put("widest_least", k, part, below)
            peak.now, trough.now = maximum(peak.now, above), minimum(trough.now, below)
            self._put("peak", t, part, peak.now)
            self._put("trough", t, part, trough.now)
            for cell, value in zip(before, now, strict=True):
                cell.now = value
        self._put("widest", self.last, part, before[0].now)
        self._put("widest_least", self.last, part, before[0].now)
        f.rows["reach", part] = maximum(size(peak.now), size(trough.now)) * self.margin + zero

    def _widen(self, part: int) -> None:
        """Extremes of windows from each point on, out of those of single steps."""
        length = self.lanes - 1
        for near, far, better, sign in (("most", "widest", maximum, 1.0), ("least", "widest_least", minimum, -1.0)):
            width = 1
            while 2 * width <= WIDE:
                if width <= length < 2 * width:
                    self._combine(near, far, part, length - width, better, sign)
                self._combine(far, far, part, width, better, 0.0)
                width *= 2
            self._combine(far, far, part, WIDE - width, better, sign)

    def _combine(self, to: str, of: str, part: int, later: int, better: Any, sign: float) -> None:
        """Extremes at each point and one so much later, widened where there is a sign."""
        f = self.flight
        margin = f.rows["reach", part] * sign if sign else None
        at, width = f.place_of(of) + part * self.lanes, self.layout.timed[of]
        for t in count_to(self.points, self.trace):
            best = Cell(load(self.trace, f.tables, at + t * width, self.lanes))
            for _ in when(t + later < self.points):
                best.now = better(best.now, load(self.trace, f.tables, at + (t + later) * width, self.lanes))
            self._put(to, t, part, best.now if margin is None else best.now + margin)
