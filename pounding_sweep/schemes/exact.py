"""Exact flight between contacts, from one possible touch to the next; beside contacts, Runge-Kutta.

Between impacts a building is linear, and the ground acceleration is linear between record
points, so that its motion is known without error at any instant (Nigam & Jennings 1969):
see `pounding_sweep.kernel.flight`. Only floors that touch, or may in the step to come, are
stepped, scenarios side by side in the lanes, each at its own time. One whose contacts are all
open at a point of flight's grid flies on at once, and comes back to its lane where it may touch
next; one at its end leaves its lane to the next scenario.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pounding_sweep.kernel import forces, hysteresis, located, series
from pounding_sweep.kernel.flight import Flight
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import (
    Cell,
    any_lane,
    counts,
    each_lane,
    first_whole,
    flag,
    gather,
    lane_numbers,
    lane_of,
    not_,
    put_lane,
    real,
    when,
    when_any,
    where,
    while_any,
    whole,
)
from pounding_sweep.kernel.march import begin, conclude
from pounding_sweep.kernel.peaks import samples
from pounding_sweep.model.scene import Scene
from pounding_sweep.schemes.rk4 import Rk4


class Exact(Rk4):
    """Exact flight; a step with contact is a series, or one of `Rk4`."""

    name = "exact"
    title = "exact flight between contacts, Taylor series beside them or, where forces are roots, `rk4`"
    source = "Nigam & Jennings 1969"
    flies_exactly = True
    follows_smooth = False
    step_cost = 0.4
    ladder = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0)
    finest_float32 = 2.0

    def refuses(self, scene: Scene) -> str | None:
        """Rows that do not fly in modes of their buildings, and storeys that yield under their weights."""
        why = super().refuses(scene)
        if why is not None:
            return why
        if not scene.has_own_modes:
            dashed = (f"building {b.name!r} has dashpots" for b in scene.buildings if any(b.dashed))
            what = next(dashed, None) or f"buildings of pair {scene.links[0].pair!r} are linked"
            return f"flies in modes that damping leaves apart, and {what}"
        for building in scene.buildings:
            if building.p_delta and any(building.yields):
                return f"does not follow storeys that yield under P-Delta, as those of building {building.name!r} do"
        return None


class Events:
    """All scenarios of a kernel call, through the lanes of one group.

    Parameters
    ----------
    group : Group
        The lanes.
    ground : Ground
        Its acceleration at the ends of all short steps; steps of both lengths.
    flight : Flight
        Flight of one scenario.
    scenarios : object
        Gives lanes their inputs and takes their results: ``count``, ``put(i, lane)``, ``take(i, lane)`` and
        ``tables(i)``, where a scenario's tables begin.
    note : callable, optional
        Keeps the motion after so many short steps: of one scenario, in lane 0.
    """

    def __init__(
        self, group: Group, ground: Any, flight: Flight, scenarios: Any, note: Callable[[Any], None] | None
    ) -> None:
        self.group, self.ground, self.flight, self.scenarios, self.note = group, ground, flight, scenarios, note
        #: Short steps in one of flight's grid, and in all.
        self.short, self.last = ground.steps // ground.substeps, ground.intervals * ground.steps
        trace, lanes = group.trace, group.lanes
        #: Of each lane: short steps done, the number of its scenario, and whether it has one.
        self.at, self.scenario = Cell(counts(trace, 0, lanes)), Cell(counts(trace, 0, lanes))
        self.busy = Cell(group.full(0.0))
        #: Short steps that are left of flight's.
        self.left = Cell(group.full(0.0))
        self.next, self.settled = Cell(whole(trace, 0)), Cell(flag(trace, False))
        self.leaves = Cell(group.lanes_where(True))
        group.number = lambda: self.at.now

    def run(self) -> None:
        """Take all scenarios over the record."""
        group, s = self.group, self.group.state
        more = Cell(flag(group.trace, True))
        for _ in while_any(lambda: more.now, group.trace):
            for lane in each_lane(self.leaves.now):
                self._serve(lane)
            more.now = any_lane(self.busy.now > 0.0)
            if not group.eventful:
                continue
            for _ in when(more.now):
                starts = (self.busy.now > 0.0) & ~(s["time_left"] > 0.0)
                with when_any(starts):
                    at = self.at.now
                    located.begin(group, starts, self._ground(at), self._ground(at + 1), self.ground.h)
                (series if group.spec.series else located).substep(group, self.ground.h)
                self._go_on()

    def _ground(self, places: Any) -> Any:
        safe = where(places < self.last, places, places * 0 + self.last)  # an idle lane may be at its end
        return self.group.state["scale"] * gather(self.group.trace, self.ground.track, safe)

    def _go_on(self) -> None:
        """Find the lanes that leave: open at a point of flight's grid, or at the end of the record."""
        group, s = self.group, self.group.state
        over = (self.busy.now > 0.0) & ~(s["time_left"] > 0.0)
        self.leaves.now = over & ~over
        with when_any(over):
            self.at.now = at = where(over, self.at.now + 1, self.at.now)
            left = self.left.now - 1.0
            whole_step = over & ~(left > 0.0)
            self.left.now = where(whole_step, real(self.short), where(over, left, self.left.now))
            closed, ends = forces.is_closed(group), over & (at >= self.last)
            stays = closed | hysteresis.is_yielding(group) if group.spec.yielding else closed
            for _ in when(any_lane(over)) if self.note is not None else ():
                assert self.note is not None
                self.note(first_whole(at))
            self.leaves.now = ends | (whole_step & ~stays)
            if located.needs_ends(group):
                located.clear_forces(group, over & ~closed)
            with when_any(ends):
                samples(group, ends)

    def _serve(self, lane: Any) -> None:
        """Fly the scenario of a lane to its next possible touch, or take others until one may touch."""
        group, flight = self.group, self.flight
        has = Cell(lane_of(self.busy.now, lane) > 0.0)
        self.settled.now = flag(group.trace, False)
        for _ in when(has.now):
            self._know(lane)
            flight.at.now = lane_of(self.at.now, lane) // self.short
            flight.leave(lane, flight.at.now)
        for _ in while_any(lambda: not_(self.settled.now), group.trace):
            for _ in when(not_(has.now)):
                none_left = not_(self.next.now < self.scenarios.count)
                for _ in when(none_left):
                    put_lane(self.busy, lane, 0.0)
                    self.settled.now = flag(group.trace, True)
                for _ in when(not_(none_left)):
                    self._begin(lane)
                    has.now = flag(group.trace, True)
            for _ in when(has.now):
                flight.fly(lane, self._note_point if self.note is not None else None)
                flight.enter(lane, flight.at.now)
                for _ in when(flight.hits.now):
                    put_lane(self.at, lane, flight.at.now * self.short)
                    put_lane(self.left, lane, real(self.short))
                    self.settled.now = flag(group.trace, True)
                for _ in when(not_(flight.hits.now)):
                    conclude(group)
                    self.scenarios.take(lane_of(self.scenario.now, lane), lane)
                    has.now = flag(group.trace, False)

    def _note_point(self, point: Any) -> None:
        assert self.note is not None
        self.note(point * self.short)

    def _know(self, lane: Any) -> None:
        """Let flight know whose tables it reads."""
        s = self.group.state
        self.flight.scale.now = s.lane(s.first["scale"], lane)
        self.flight.base.now = self.scenarios.tables(lane_of(self.scenario.now, lane))

    def _begin(self, lane: Any) -> None:
        """Let the next scenario begin in a lane."""
        group, number = self.group, self.next.now
        group.state.clear_lane(lane)
        self.scenarios.put(number, lane)
        put_lane(self.scenario, lane, number)
        put_lane(self.busy, lane, 1.0)
        put_lane(self.at, lane, whole(group.trace, 0))
        self.next.now = number + 1
        mine = lane_numbers(group.trace, group.lanes) == real(lane)
        begin(group, self.ground.start(), mine)
        if self.note is not None:
            self.note(whole(group.trace, 0))
        self._know(lane)
        self.flight.at.now = whole(group.trace, 0)
        self.flight.leave(lane, self.flight.at.now)
