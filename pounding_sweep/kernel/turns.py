"""Turns of scenarios: which one each lane has, and how they come from flight to lanes and back.

Only floors that touch, or may in the step to come, are stepped, scenarios side by side in the lanes, each at its own
time. One whose contacts are all open at a point of flight's grid, and none about to close, flies on at once, and comes
back to its lane where it may touch next; one at its end leaves its lane to the next scenario. Rows with storeys of Bouc
and Wen, which are never elastic, stay in their lanes throughout.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from pounding_sweep.kernel import collapse, forces, hysteresis, march, rest, series
from pounding_sweep.kernel.flight import Flight
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.peaks import samples
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.kernel.types import Index, Lanes, Note, Truths
from pounding_sweep.lanes import (
    Cell,
    Rows,
    Table,
    any_lane,
    constant,
    count_to,
    fma,
    iter_lanes,
    lane_of,
    lesser,
    not_,
    once_if,
    real,
    rounded,
    side_by_side,
    when_any,
    where,
    while_any,
)

#: Steps of flight within which floors that near each other are not worth a flight.
AHEAD = 2.0


class Course:
    """How far the scenario of each lane has come: what flight and the steps beside contacts share."""

    def __init__(self, group: Group, cell: Callable[[Any], Cell]) -> None:
        #: Of each lane: short steps done and in all, and the number of its scenario.
        self.at, self.last, self.scenario = (cell(group.full(0)) for _ in range(3))
        #: Whether it has one, short steps that are left of flight's, and whether it leaves its steps.
        self.busy, self.left = (cell(group.full(0.0)) for _ in range(2))
        self.leaves = cell(group.full(True))
        #: The next scenario.
        self.next = cell(0)


@dataclass
class Turns:
    """Which scenario of a kernel call each lane has: one at its end leaves its lane to the next."""

    group: Group
    ground: Any
    course: Course
    inputs: Rows  # of `LANES` scenarios, one block after another
    results: Rows  # the same
    count: Index  # scenarios in all
    persistent: Index  # rows of the state that a step leaves to the next
    short: Index  # short steps in one of flight's grid
    note: Note  # keeps the motion after so many short steps, of one scenario, in lane 0

    def serve(self) -> None:
        """Give the lanes that leave their scenarios others."""
        course = self.course
        for lane in iter_lanes(course.leaves.now):
            for _ in once_if(course.busy.lane(lane) > 0.0):
                self._finish(lane)
            for _ in once_if(self._takes_next(lane)):
                course.left.put_lane(lane, real(self.short))

    def _takes_next(self, lane: Index) -> Truths:
        """Let the next scenario begin in a lane; returns whether there is one."""
        has = self.course.next.now < self.count
        for _ in once_if(has):
            self._begin(lane)
        for _ in once_if(not_(has)):
            self.course.busy.put_lane(lane, 0.0)
        return has

    def _finish(self, lane: Index) -> None:
        """Keep the results of the scenario of a lane, which is at its end."""
        at, end = self.course.at.lane(lane), self.ground.record * self.ground.steps
        for _ in once_if(at < end) if self.group.spec.falling else ():
            rest.note_energies(self.group, self._only(lane))
        march.conclude(self.group, self._only(lane), at)
        for row, place, column in self._scenario_rows(self.results, self.course.scenario.lane(lane)):
            self.results.put_lane(place, column, self.group.state.lane(row, lane))

    def _only(self, lane: Index) -> Truths:
        """Return one lane as a mask."""
        return side_by_side(self.group.trace, range(self.group.lanes)) == real(lane)

    def _scenario_rows(self, rows: Rows, number: Index) -> Iterator[tuple[Index, Index, Index]]:
        """Go through the rows of a scenario: the row of the state, its own, and its lane."""
        block, first = number // LANES, self.group.state.first
        for name, n in rows.count.items():
            for i in count_to(n) if n > 8 else range(n):
                yield first[name] + i, block * rows.size + rows.first[name] + i, number - block * LANES

    def _begin(self, lane: Index) -> None:
        """Let the next scenario begin in a lane."""
        group, course, number = self.group, self.course, self.course.next.now
        for row in count_to(self.persistent):
            group.state.put_lane(row, lane, 0.0)
        for row, place, column in self._scenario_rows(self.inputs, number):
            group.state.put_lane(row, lane, self.inputs.lane(place, column))
        intervals = self.ground.record + rounded(group.state.lane(group.state.first["rests"], lane))
        last = intervals * self.ground.steps
        for cell, x in ((course.scenario, number), (course.busy, 1.0), (course.at, 0), (course.last, last)):
            cell.put_lane(lane, x)
        course.next.now = number + 1
        march.begin(group, self.ground.start(), self._only(lane))
        if self.note is not None:
            self.note(constant(0))


class Flights(Turns):
    """Turns of scenarios that fly from lane to lane: nothing in it depends on the contact law."""

    def __init__(self, flight: Flight, fill: Callable[[], None], stops: Index, *turns: Any) -> None:
        super().__init__(*turns)
        # `fill` fills flight's tables; `stops` are the points or blocks that these have
        self.flight, self._fill, self._stops = flight, fill, stops
        self.settled = Cell(False)

    def serve(self) -> None:
        """Fly the scenarios of the lanes that leave to their next possible touch, or take others."""
        flight, course, note = self.flight, self.course, self.note
        note_point = None if note is None else lambda point: note(point * self.short)
        for _ in once_if(course.next.now == 0):
            self._fill()
        for lane in iter_lanes(course.leaves.now):
            has = Cell(course.busy.lane(lane) > 0.0)
            self.settled.now = False
            s = self.group.state
            for _ in once_if(has.now & (s.lane(s.first["collapsed"], lane) > 0.0)) if self.group.spec.falling else ():
                self._finish(lane)
                has.now = False
            for _ in once_if(has.now):
                self._leave(lane, course.at.lane(lane) // self.short)
            for _ in while_any(lambda: not_(self.settled.now)):
                for _ in once_if(not_(has.now)):
                    has.now = self._takes_next(lane)
                    self.settled.now = not_(has.now)
                for _ in once_if(has.now):
                    flight.advance_free(lane, note_point)
                    flight.to_floors(lane, flight.at.now)
                    course.at.put_lane(lane, flight.at.now * self.short)
                    # a record of one point has no step
                    hits, at = flight.hits.now & (flight.at.now < flight.last.now), flight.at.now
                    over = flight.quiet.now | not_(at * self.short < course.last.lane(lane))
                    for _ in once_if(hits):
                        course.left.put_lane(lane, real(self.short))
                        self.settled.now = True
                    for _ in once_if(not_(hits)):
                        for _ in once_if(at == self.ground.record * self.ground.substeps):
                            rest.note_energies(self.group, self._only(lane))
                        for _ in once_if(over):
                            self._finish(lane)
                            has.now = False
                        for _ in once_if(not_(over)):
                            self._leave(lane, at)

    def _leave(self, lane: Index, point: Index) -> None:
        """Take the scenario of a lane into flight, by the tables of its row of buildings, as far as the ground goes."""
        s, number, flight, inputs = self.group.state, self.course.scenario.lane(lane), self.flight, self.inputs
        last, ground = self.course.last.lane(lane) // self.short, self.ground
        end, still = (n * ground.substeps for n in (ground.record, ground.intervals))
        flight.scale.now = s.lane(s.first["scale"], lane)
        flight.last.now = lesser(last, end if "energy" in self.group.requested else still)
        for _ in once_if(not_(point < end)):
            flight.last.now = lesser(last, still)
        for _ in once_if(not_(point < still)):
            flight.last.now, flight.scale.now = last, 0.0
        row, block = number * 0, number // LANES
        if "tables" in inputs.first:
            row = rounded(inputs.lane(block * inputs.size + inputs.first["tables"], number - block * LANES))
        flight.base.now = flight.layout.base(row, self._stops)
        flight.at.now = point
        flight.to_modes(lane, point)

    def _begin(self, lane: Index) -> None:
        super()._begin(lane)
        self._leave(lane, constant(0))


def run_scenarios(group: Group, ground: Any, serve: Callable[[], None], course: Course, note: Note) -> None:
    """Take all scenarios of a kernel call over the record, through the lanes of one group."""
    # short steps in one of flight's grid, and in all
    s, short, last = group.state, ground.steps // ground.substeps, ground.intervals * ground.steps
    track = Table(group.trace, ground.track, group.lanes)
    group.number = lambda: course.at.now
    more = Cell(True)

    def ground_at(places: Index) -> Lanes:
        safe = where(places < last, places, places * 0 + last)  # an idle lane may be at its end
        numbers = [track.number(lane_of(safe, lane)) for lane in range(group.lanes)]
        return s["scale"] * side_by_side(group.trace, numbers)

    for _ in while_any(lambda: more.now):
        for _ in once_if(any_lane(course.leaves.now)):
            serve()
        more.now = any_lane(course.busy.now > 0.0)
        for _ in once_if(more.now) if group.has_events else ():
            more_steps = course.at.now < course.last.now  # a record of one point has none
            starts = (course.busy.now > 0.0) & ~(s["time_left"] > 0.0) & more_steps
            with when_any(starts):
                march.begin_step(group, starts, ground_at(course.at.now), ground_at(course.at.now + 1), ground.h)
            (series if group.spec.series else march).substep(group, ground.h)
            # lanes leave where all is open at a point of flight's grid, or at the end of the record
            over = (course.busy.now > 0.0) & ~(s["time_left"] > 0.0)
            course.leaves.now = group.full(False)
            with when_any(over):
                course.at.now = at = where(over & more_steps, course.at.now + 1, course.at.now)
                left = course.left.now - 1.0
                full_step = over & ~(left > 0.0)
                course.left.now = where(full_step, real(short), where(over, left, course.left.now))
                closed, ends = forces.is_closed(group), over & (at >= course.last.now)
                ends = over & (ends | ~collapse.stands(group)) if group.spec.falling else ends
                with when_any(passes := over & (at == ground.record * ground.steps)):
                    rest.note_energies(group, passes)
                stays, ahead = Cell(closed), AHEAD * group.full(ground.long)
                for contact in group.iter_contacts(straight=True):
                    stays.now |= fma(ahead, contact.between("v"), contact.penetration()) > 0.0
                if group.spec.yielding:
                    stays.now |= hysteresis.is_yielding(group)
                if note is not None:
                    for _ in once_if(any_lane(over)):
                        note(lane_of(at, 0))
                course.leaves.now = ends | (full_step & ~stays.now) if group.spec.flies_exactly else ends
                if march.needs_ends(group):
                    march.clear_forces(group, over & ~closed)
                with when_any(ends):
                    samples(group, ends)
