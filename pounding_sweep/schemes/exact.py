"""Exact flight between contacts, in which each lane has a clock of its own; beside contacts, Runge-Kutta.

Between impacts a building is linear, and the ground acceleration is linear between record
points; over a step h its state x = (u, v) then moves by

    x' = A x + s (p g0 + q g1),    A = exp(F h),  F = [[0, I], [-M^-1 K, -M^-1 C]]

without error at any h (Nigam & Jennings 1969, here for a whole building at once). A, p and
q are constants of the scene and the step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pounding_sweep.kernel import forces, located
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import (
    Cell,
    any_lane,
    count_to,
    counts,
    first_whole,
    flag,
    fma,
    gather,
    least_lane,
    not_,
    when,
    when_any,
    where,
    while_any,
)
from pounding_sweep.kernel.peaks import largest_accelerations, turning, turns
from pounding_sweep.schemes.rk4 import Rk4


class Exact(Rk4):
    """Exact flight; a step with contact is one of `Rk4`."""

    name = "exact"
    title = "exact flight between contacts in long steps, `rk4` in short ones beside them"
    source = "Nigam & Jennings 1969"
    flies_exactly = True
    follows_yielding = False
    step_cost = 0.8
    ladder = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0)
    finest_float32 = 2.0

    def march(self, group: Group, ground: Any, note: Callable[[Any], None] | None) -> None:
        """Take every lane over the record in steps of its own."""
        March(group, ground).run(note)


#: Long steps by which lanes may be ahead of one that waits in contact, so that others join it there.
WINDOW = 8
#: What a lane wants to do next.
GLIDING, STEPPING, TOUCHING, ENDED = 0.0, 1.0, 2.0, 3.0
#: Storeys up to which the step of a building in a long row is one straight line.
STRAIGHT = 4


def flight(group: Group, table: Any) -> None:
    """Take an exact step of all buildings by one of both tables; the present state becomes its start."""
    s = group.state
    g0, g1 = s["g0"], s["g1"]
    places: Any = group.table_places if group.long else []
    at = 0
    for b, floors in group.each_building():
        before = [s["u", i] for i in floors] + [s["v", i] for i in floors]
        for name, values in (("u0", before[: len(floors)]), ("v0", before[len(floors) :])):
            for i, x in zip(floors, values, strict=True):
                s[name, i] = x
        width = len(before) + 2
        first = places[b] if group.long else at
        if group.long and len(floors) > STRAIGHT:
            _rows_of_flight(group, table, first, floors)
            continue
        for row in range(len(before)):
            a = [group.transition(table, first + (row * width + column)) for column in range(width)]
            now = fma(a[-2], g0, a[-1] * g1)
            for column, x in enumerate(before):
                now = fma(a[column], x, now)
            s["u" if row < len(floors) else "v", floors[row % len(floors)]] = now
        at += len(before) * width


def _rows_of_flight(group: Group, table: Any, first: Any, floors: Any) -> None:
    """Step of a high building: row by row of its table, the columns in one straight line."""
    s = group.state
    g0, g1, n = s["g0"], s["g1"], len(floors)
    before = [s["u0", i] for i in floors] + [s["v0", i] for i in floors]
    width = 2 * n + 2
    for half, name in enumerate("uv"):
        for p in count_to(n, group.trace):
            at = first + (p + half * n) * width
            a = [group.transition(table, at + column) for column in range(width)]
            now = fma(a[-2], g0, a[-1] * g1)
            for column, x in enumerate(before):
                now = fma(a[column], x, now)
            s[name, floors[0] + p] = now


def flight_energies(group: Group, h: Any) -> None:
    """Add what the ground put in and what damping took over an exact step, without any quadrature."""
    s = group.state
    flies = where(s["h"] > 0.0, 1.0, group.full(0.0))
    g0, g1 = s["g0"], s["g1"]
    for b, floors in group.each_building():
        alpha, beta = group.prop("alpha", b), group.prop("beta", b)
        passed = gained = given = group.full(0.0)
        pull: list[Any] = []
        for i in reversed(floors):  # storey forces, from the top
            m = group.prop("m", i)
            dv = s["v", i] - s["v0", i] + alpha * (s["u", i] - s["u0", i])
            passed = passed - m * (0.5 * h * (g0 + g1) + dv)
            pull.append(passed)
            gained = gained + 0.5 * m * ((s["v", i] - s["v0", i]) * (s["v", i] + s["v0", i]))
        passed = group.full(0.0)
        for p, i in enumerate(floors):
            m, k, below = group.prop("m", i), group.prop("k", i), p > 0
            passed = passed + pull.pop() / k
            area = passed - beta * (s["u", i] - s["u0", i])
            slope = (g1 - g0) / h
            given = given - m * (g1 * s["u", i] - g0 * s["u0", i] - slope * area)
            end = s["u", i] - s["u", i - 1] if below else s["u", i]
            start = s["u0", i] - s["u0", i - 1] if below else s["u0", i]
            gained = gained + 0.5 * k * ((end - start) * (end + start))
        s["e_in", b] = s["e_in", b] + flies * given
        damped = ~((alpha == 0.0) & (beta == 0.0))  # else what is missing is rounding
        s["e_damp", b] = s["e_damp", b] + where(damped, flies * (given - gained), group.full(0.0))


class March:
    """A lane group under exact flight: each lane's own step and what it does next.

    Parameters
    ----------
    group : Group
        The lanes.
    ground : Ground
        Its acceleration at the ends of all short steps; steps of both lengths.
    """

    def __init__(self, group: Group, ground: Any) -> None:
        self.group, self.track, self.h, self.long = group, ground.track, ground.h, ground.long
        #: Short steps in a long one, and in all.
        self.short, self.last = ground.steps // ground.substeps, ground.intervals * ground.steps
        self.at = Cell(counts(group.trace, 0, group.lanes))
        self.doing = Cell(group.full(GLIDING))
        group.number = lambda: self.at.now

    def _ground(self, places: Any) -> Any:
        return self.group.state["scale"] * gather(self.group.trace, self.track, places)

    def _meet(self, lanes: Any) -> None:
        """Let some lanes begin a short step that their contacts may cut."""
        at = self.at.now
        safe = where(at < self.last, at, at + -1)  # a lane that is at its end begins none
        self.doing.now = where(lanes, TOUCHING, self.doing.now)
        located.begin(self.group, lanes, self._ground(safe), self._ground(safe + 1), self.h)

    def _go_on(self) -> None:
        """Lanes whose step is over begin the next: with their contacts, or in flight."""
        group = self.group
        over = (self.doing.now == TOUCHING) & ~(group.state["time_left"] > 0.0)
        with when_any(over):
            self.at.now = where(over, self.at.now + 1, self.at.now)
            ends, closed = over & (self.at.now >= self.last), forces.is_closed(group)
            on = where(self.at.now % self.short == 0, GLIDING, group.full(STEPPING))
            self.doing.now = where(over, where(ends, ENDED, on), self.doing.now)
            touching = over & ~ends & closed
            with when_any(touching):
                self._meet(touching)
            if located.needs_ends(group):
                located.clear_forces(group, over & ~closed)

    def _fly(self, stepping: Any, limit: Any) -> None:
        """Take an exact step of every lane that wants one of this kind; where it may touch it is taken back."""
        group, s = self.group, self.group.state
        kind = where(stepping, group.full(STEPPING), group.full(GLIDING))
        stride = where(stepping, self.short * 0 + 1, self.short)
        h = where(stepping, self.h, self.long)
        at = self.at.now
        flies = (self.doing.now == kind) & (at < limit)
        s["h"] = where(flies, h, 0.0)
        to = where(flies, at + stride, at)
        s["g0"], s["g1"] = self._ground(at), self._ground(to)
        flight(group, stepping)
        turned = turning(group)
        if group.touching:
            hit = flies & located.may_touch(group, h)
            with when_any(hit):
                s["h"] = where(hit, 0.0, s["h"])
                shorter = hit & (kind == GLIDING)
                many = self.short > 1
                self.doing.now = where(shorter, where(many, group.full(STEPPING), self.doing.now), self.doing.now)
                meets = hit & ~(
                    where(many, group.full(1.0), group.full(0.0)) * where(shorter, 1.0, group.full(0.0)) > 0.0
                )
                with when_any(meets):
                    self._meet(meets)
            waits = ~(s["h"] > 0.0)
            with when_any(waits):
                for now, before in (("u", "u0"), ("v", "v0")):
                    for i in group.each(group.spec.n_dof):
                        s[now, i] = where(waits, s[before, i], s[now, i])
        with when_any(turned <= 0.0):
            turns(group)
        if "energy" in group.asked:
            flight_energies(group, h)
        if "acceleration" in group.asked:
            largest_accelerations(group, located=True)
        at = where(s["h"] > 0.0, self.at.now + stride, self.at.now)
        self.at.now = at
        self.doing.now = where(at >= self.last, ENDED, self.doing.now)
        home = (self.doing.now == STEPPING) & (kind == STEPPING) & (at % self.short == 0)
        self.doing.now = where(home, GLIDING, self.doing.now)

    def run(self, note: Any = None) -> None:
        """Go through the whole motion; `note` is told of each row of a history."""
        group = self.group
        if not group.touching:
            for _ in while_any(lambda: self.at.now < self.last, group.trace):
                self._fly(flag(group.trace, False), self.last)
                if note is not None:
                    note(first_whole(self.at.now))
            return
        written = Cell(first_whole(self.at.now))
        inside = Cell(flag(group.trace, False))
        none = where(self.last > 0, group.full(GLIDING), group.full(ENDED))
        self.doing.now = none  # a record of one point has no motion
        for _ in while_any(lambda: ~(self.doing.now == ENDED), group.trace):
            touches = self.doing.now == TOUCHING
            ahead = self.at.now + self.short * WINDOW
            limit = least_lane(where(touches, where(ahead < self.last, ahead, self.last), self.last))
            free = self.at.now < limit
            stepping = any_lane((self.doing.now == STEPPING) & free)
            gliding = any_lane((self.doing.now == GLIDING) & free)
            stays = inside.now & any_lane(touches) if group.trace is not None else inside.now and any_lane(touches)
            in_contact = stays | not_(stepping | gliding)
            for _ in when(in_contact):
                for _ in when(not_(inside.now)):
                    located.keep_start(group)
                inside.now = flag(group.trace, True)
                located.substep(group, self.h)
                self._go_on()
            for _ in when(not_(in_contact)):
                inside.now = flag(group.trace, False)
                self._fly(stepping, limit)
            if note is not None:
                row = first_whole(self.at.now)
                for _ in when(row > written.now):
                    written.now = row
                    note(row)
