"""Free flight of one scenario, many instants side by side.

Between impacts the displacements are u = s u0 + w: s u0 is the motion without pounding under
the record's scale s, whose tables all scenarios share, and w decays freely, in modes

    q'' + 2 zeta omega q' + omega**2 q = 0.

What is watched, a gap or a peak so far, is a linear function x of the floors' motions. Since
omega**2 q**2 + q'**2 never grows, w adds to x at most

    B = sum over modes |x_m| a_m,    a_m = sqrt(q_m**2 + (q_m' / omega_m)**2)

from now on, so that windows of the record in which s u0 keeps farther than B from gaps and
peaks are passed in one step. In the others, x is looked at in all lanes: its values and rates
at successive points of a grid.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import (
    Cell,
    Rows,
    Table,
    after,
    any_lane,
    count_to,
    each_lane,
    first_true,
    flag,
    fma,
    lane_numbers,
    lane_of,
    largest_lane,
    lesser,
    load,
    load_one,
    maximum,
    minimum,
    not_,
    one,
    real,
    size,
    sqrt,
    when,
    where,
    while_any,
    whole,
)
from pounding_sweep.kernel.peaks import cubic_extreme, followed
from pounding_sweep.kernel.row import kinetic, strain
from pounding_sweep.kernel.spec import property_slots

#: Steps of the grid in a wide window.
WIDE = 60
#: Rounds of code that are written one after another instead of in a loop.
STRAIGHT = 48
#: What may happen to a watched quantity.
TOUCH, TURN, ACCELERATION = 0, 1, 2


@dataclass(frozen=True)
class Watched:
    """What flight watches: a linear function of the floors.

    Attributes
    ----------
    kind : int
        `TOUCH`: it may reach a gap; `TURN`: it may turn beyond its peak so far; `ACCELERATION`: the same of total
        accelerations.
    weights : tuple of float
        Of each floor.
    most, least : int
        Rows of the state that hold the gap or the peaks; `least` < 0: none, and of one whose size counts, that of
        `most`.
    sized : bool
        It is its size that counts.
    """

    kind: int
    weights: tuple[float, ...]
    most: int
    least: int
    sized: bool


def watched(group: Group) -> list[Watched]:
    """Return what the flight of a lane group watches: contacts first."""
    n = group.spec.n_dof
    # in a kernel that is traced, constants are not known: which floors count does not depend on them
    known = group.constants if isinstance(group.constants, np.ndarray) else np.ones(property_slots(group.spec).size)
    probe = Group(group.spec, group.scheme, group.reducers, None, n, known)
    for i in range(n):
        probe.state["u", i] = np.arange(n) == i
    first = probe.state.first
    found = [
        Watched(TOUCH, tuple(probe.between("u", j)), first["gap"] + pair, -1, False)
        for j, (_, _, pair) in enumerate(probe.contacts)
    ]
    for motion in followed(probe, straight=True):
        most, least = (-1 if row is None else first[row[0]] + row[1] for row in (motion.most, motion.least))
        found.append(Watched(TURN, tuple(motion.of("u")), most, least, motion.sized))
    if "acceleration" in group.asked:
        eye = np.eye(n)
        found += [Watched(ACCELERATION, tuple(eye[i]), first["acc"] + i, -1, True) for i in range(n)]
    return found


class Layout:
    """Where the numbers of flight's tables lie, for one row of buildings under one record.

    Those of `fixed` come first, then those of `timed`, as many at each point of the grid, then `series`, each over
    all points and `lanes` more.

    Parameters
    ----------
    group : Group
        The lanes.
    """

    def __init__(self, group: Group) -> None:
        spec, lanes = group.spec, group.lanes
        self.lanes, self.watched = lanes, watched(group)
        self.modes = n = spec.n_dof

        def padded(count: int) -> int:
            return -(-count // lanes) * lanes

        self.wide_modes, self.wide_watched = padded(n), padded(max(1, len(self.watched)))
        #: Modes that each watched quantity has a part in: first and number.
        home = [(spec.home(b), k) for b, k in enumerate(spec.storeys)]
        self.ranges = []
        for each in self.watched:
            buildings = sorted({spec.building_of[i] for i in np.flatnonzero(each.weights)})
            low, high = home[buildings[0]][0], sum(home[buildings[-1]])
            self.ranges.append((low, high - low))
        q, m, wide = len(self.watched), self.wide_modes, self.wide_watched
        self.fixed = {
            "step": lanes,
            "inverse": lanes,
            "slowness": m,
            "square": m,
            "damping": m,
            "push": m,
            "bound": n * wide,
            "bulge": n * wide,
            "bulge0": wide,
            "remainder": wide,
            "sized": wide,
            "shaken": wide,
            "advance": (lanes + 1) * 4 * m,
            "times": n * 4 * lanes,
            "shape": max(1, q) * n,
            "across": n * wide,
            "floors": n * m,
            "modal": n * m,
        }
        extremes = ("most", "least", "widest", "widest_least", "peak", "trough") if spec.windows else ()
        self.timed = dict.fromkeys(extremes, wide) | {"q": m, "p": m}
        if "energy" in spec.reducers:
            self.timed |= {"given": m, "adjoint_q": m, "adjoint_p": m}
        self.series = {"x": n, "rate": n, "ground": 1}
        #: Rows of modes in double precision from which the motion without pounding follows.
        self.decays = ["qq", "qp", "pq", "pp", "q0", "p0", "q1", "p1", "square", "damping", "slowness", "push"]
        if "energy" in spec.reducers:
            self.decays += ["weight", "area", "adjoint_q", "adjoint_p", "adjoint_rise_q", "adjoint_rise_p"]
        self.first: dict[str, int] = {}
        for block in (self.fixed, self.timed, self.series):
            at = 0
            for name, count in block.items():
                self.first[name], at = at, at + count
        self.sizes = [sum(block.values()) for block in (self.fixed, self.timed, self.series)]

    def size(self, points: Any) -> Any:
        """How many numbers the tables have over a grid of so many points."""
        fixed, timed, series = self.sizes
        return (points + self.lanes) * series + points * timed + fixed

    def place(self, name: str, points: Any) -> Any:
        """Where the numbers of a name begin."""
        fixed, timed, _ = self.sizes
        at = self.first[name]
        if name in self.fixed:
            return at
        if name in self.timed:
            return points * at + fixed
        return points * timed + (points + self.lanes) * at + fixed

    def view(self, table: Any, name: str, points: int) -> Any:
        """Numbers of a name in the tables of one row of buildings, an array."""
        at = self.place(name, points)
        if name in self.fixed:
            return table[at : at + self.fixed[name]]
        many = points * self.timed[name] if name in self.timed else (points + self.lanes) * self.series[name]
        return table[at : at + many]


class Flight:
    """Flight of the scenarios of a lane group, one at a time.

    Parameters
    ----------
    group : Group
        The lanes.
    tables : LLVM pointer or ndarray
        Tables of flight, a `Layout` for each row of buildings.
    points : Count or int
        Points of the grid.
    memory : LLVM pointer, optional
        Where flight's own rows lie.
    """

    def __init__(self, group: Group, tables: Any, points: Any, memory: Any = None) -> None:
        self.group, self.trace, self.lanes = group, group.trace, group.lanes
        self.tables, self.points, self.last = tables, points, points - 1
        self.layout = layout = Layout(group)
        self.rows = Rows(self.trace, list(scratch(layout).items()), self.lanes, memory)
        #: Where the tables of the scenario that flies begin, and the record's scale.
        self.base, self.scale = Cell(points), Cell(one(self.trace, 1.0))
        self.at, self.hits = Cell(points), Cell(flag(self.trace, False))
        self.going, self.steps = Cell(flag(self.trace, True)), Cell(points)
        self.rated = Cell(flag(self.trace, False))

    # tables --------------------------------------------------------------------------------------------------------

    @cached_property
    def _places(self) -> dict[str, Any]:
        return {name: Cell(self.layout.place(name, self.points)) for name in (*self.layout.timed, *self.layout.series)}

    def place_of(self, name: str) -> Any:
        """Where the numbers of a name begin."""
        if name in self.layout.fixed:
            return self.base.now + self.layout.place(name, self.points)
        return self.base.now + self._places[name].now

    def _vector(self, at: Any) -> Any:
        return load(self.trace, self.tables, at, self.lanes)

    def _number(self, at: Any) -> Any:
        return load_one(self.trace, self.tables, at)

    def _then(self, name: str, t: Any, part: Any = 0) -> Any:
        """Vector number `part` of a name at point t."""
        width = self.layout.timed[name]
        return self._vector(self.place_of(name) + t * width + part * self.lanes)

    def each(self, n: int, times: int = 1) -> Iterator[Any]:
        """Count to n: in one straight line where that is short."""
        yield from range(n) if n * times <= STRAIGHT else count_to(n, self.trace)

    @property
    def _mode_parts(self) -> range:
        return range(self.layout.wide_modes // self.lanes)

    @property
    def _watched_parts(self) -> range:
        return range(self.layout.wide_watched // self.lanes)

    # from and to lanes ---------------------------------------------------------------------------------------------

    def leave(self, lane: Any, t: Any) -> None:
        """Take a scenario out of its lane at point t: the decaying modes follow from its motion."""
        s, w, n = self.group.state, self.rows, self.layout.modes
        at = self.place_of("modal")
        for name, motion in (("q", "u"), ("p", "v")):
            sums = [Cell(self.group.full(0.0)) for _ in self._mode_parts]
            for i in self.each(n, len(sums)):
                x = s.lane(s.first[motion] + i, lane)
                for part, total in enumerate(sums):
                    coefficient = self._vector(at + (i * self.layout.wide_modes + part * self.lanes))
                    total.now = fma(coefficient, x, total.now)
            for part, total in enumerate(sums):
                w[name, part] = total.now - self.scale.now * self._then(name, t, part)
        self._account(lane, t, 1.0)

    def enter(self, lane: Any, t: Any) -> None:
        """Put a scenario into its lane at point t."""
        s, w, n = self.group.state, self.rows, self.layout.modes
        at, scale = self.place_of("floors"), self.group.full(self.scale.now)
        for name, motion in (("q", "u"), ("p", "v")):
            for part in self._mode_parts:
                w["amplitude", part] = fma(scale, self._then(name, t, part), w[name, part])
            sums = [Cell(self.group.full(0.0)) for _ in self._mode_parts]
            for m in self.each(n, len(sums)):
                x = w.number("amplitude", m)
                for part, total in enumerate(sums):
                    shape = self._vector(at + (m * self.layout.wide_modes + part * self.lanes))
                    total.now = fma(shape, x, total.now)
            for part, total in enumerate(sums):
                w["floor", part] = total.now
            for i in self.each(n):
                x = w.number("floor", i)
                s.put_lane(s.first[motion] + i, lane, x)
                s.put_lane(s.first[motion + "0"] + i, lane, x)
        self._account(lane, t, -1.0)

    def _account(self, lane: Any, t: Any, sign: float) -> None:
        """Energies of a flight that begins (1) or ends (-1) at point t: input, and what of it is not held any more."""
        group, s, w = self.group, self.group.state, self.rows
        if "energy" not in group.asked:
            return
        given, late = self.place_of("given") + t * self.layout.timed["given"], {}
        for name in ("adjoint_q", "adjoint_p"):
            late[name] = self.place_of(name) + t * self.layout.timed[name]
        scale = self.scale.now
        for b, floors in group.each_building():
            held = lane_of(kinetic(group, floors) + strain(group, floors), lane)
            gained = one(self.trace, 0.0)
            for m in floors:
                q, p = w.number("q", m), w.number("p", m)
                more = self._number(late["adjoint_q"] + m) * q + self._number(late["adjoint_p"] + m) * p
                gained = gained + scale * (more - scale * self._number(given + m))
            gained = gained * lane_of(group.full(group.prop("m", floors[0])), lane)
            change = sign * gained
            e_in, e_damp = s.first["e_in"] + b, s.first["e_damp"] + b
            s.put_lane(e_in, lane, s.lane(e_in, lane) + change)
            alpha, beta = (lane_of(group.full(group.prop(x, b)), lane) for x in ("alpha", "beta"))
            undamped = (alpha == 0.0) & (beta == 0.0)
            for _ in when(not_(undamped)):  # else what is missing is rounding
                s.put_lane(e_damp, lane, s.lane(e_damp, lane) + change + sign * held)

    # flight --------------------------------------------------------------------------------------------------------

    def fly(self, lane: Any, note: Callable[[Any], None] | None = None) -> None:
        """Fly from point `at` on to where floors may touch in the step to come (`hits`), or to the last point."""
        # with a `note` of each point's motion, windows are one step long
        self._take_thresholds(lane)
        self.hits.now = flag(self.trace, False)
        self.going.now = flag(self.trace, True)
        leaps = note is None and self.group.spec.windows
        self._bounds()
        for _ in when(self._undisturbed()) if leaps else ():
            self._begin()
        for _ in while_any(lambda: self.going.now & (self.at.now < self.last), self.trace):
            t = self.at.now
            self._bounds()
            room = self.last - t
            far = flag(self.trace, False)
            if leaps:
                far = not_(room < WIDE) & not_(self._near(t, "widest", "widest_least"))
            for _ in when(far):
                self._advance(self.lanes)
                self.at.now = t + WIDE
            for _ in when(not_(far)):
                room = lesser(room, whole(self.trace, self.lanes - 1 if note is None else 1))
                self.steps.now = room
                for _ in when(self._near(t, "most", "least")) if self.group.spec.windows else self._ask_all():
                    self._look(t, room)
                steps = self.steps.now
                self._advance(steps)
                self.at.now = t + steps
                self.hits.now = steps < room
                self.going.now = not_(steps < room)
                if note is not None:
                    self.enter(lane, t + steps)
                    note(t + steps)
                    self.leave(lane, t + steps)
        self._keep_peaks(lane)

    @cached_property
    def _row_numbers(self) -> tuple[Table, Table]:
        found = self.layout.watched
        most, least = [each.most for each in found] or [0], [each.least for each in found] or [0]
        return Table(self.trace, most), Table(self.trace, least)

    def _take_thresholds(self, lane: Any) -> None:
        """Gaps and peaks so far; what is in no lane's way is far."""
        s, w, far = self.group.state, self.rows, self.group.limit.far
        for part in self._watched_parts:
            w["high", part], w["low", part] = self.group.full(far), self.group.full(-far)
        for low, high, least, sized in self._alike:
            for q in self._run(low, high):
                x = s.lane(self._row_numbers[0][q], lane)
                w.put_number("high", q, x)
                if sized:
                    w.put_number("low", q, -x)
                elif least:
                    w.put_number("low", q, s.lane(self._row_numbers[1][q], lane))

    @cached_property
    def _alike(self) -> list[tuple[int, int, bool, bool]]:
        """Runs of watched quantities that are alike: first, end, whether they have a least value, or are sized."""
        found: list[tuple[int, int, bool, bool]] = []
        for q, each in enumerate(self.layout.watched):
            kind = (each.least >= 0, each.sized)
            if found and found[-1][2:] == kind:
                found[-1] = (found[-1][0], q + 1, *kind)
            else:
                found.append((q, q + 1, *kind))
        return found

    def _run(self, low: int, high: int) -> Iterator[Any]:
        for q in count_to(high - low, self.trace) if high - low > 4 else range(high - low):
            yield q + low

    def _keep_peaks(self, lane: Any) -> None:
        s, w = self.group.state, self.rows
        touches = sum(each.kind == TOUCH for each in self.layout.watched)
        for low, high, least, _ in self._alike:
            for q in self._run(max(low, touches), high):
                s.put_lane(self._row_numbers[0][q], lane, w.number("high", q))
                if least:
                    s.put_lane(self._row_numbers[1][q], lane, w.number("low", q))

    def _bounds(self) -> None:
        """Amplitudes of the modes, and the most that they add to what is watched."""
        w = self.rows
        slowness = self.place_of("slowness")
        for part in self._mode_parts:
            q, p = w["q", part], w["p", part] * self._vector(slowness + part * self.lanes)
            w["amplitude", part] = sqrt(fma(q, q, p * p))
        self._weigh("bound", "reach", None)

    def _weigh(self, table: str, row: str, begin: str | None) -> None:
        """Sum of the amplitudes, weighted for all that is watched."""
        w, at, wide = self.rows, self.place_of(table), self.layout.wide_watched
        sums = []
        for part in self._watched_parts:
            start = self.group.full(0.0)
            if begin is not None:
                start = size(self.group.full(self.scale.now)) * self._vector(self.place_of(begin) + part * self.lanes)
            sums.append(Cell(start))
        for m in self.each(self.layout.modes, len(sums)):
            a = w.number("amplitude", m)
            for part, total in enumerate(sums):
                total.now = fma(self._vector(at + (m * wide + part * self.lanes)), a, total.now)
        for part, total in enumerate(sums):
            w[row, part] = total.now

    def _undisturbed(self) -> Any:
        """Whether nothing but the record moves the row, and it has not begun."""
        w, most = self.rows, Cell(self.group.full(0.0))
        for part in self._mode_parts:
            most.now = maximum(most.now, w["amplitude", part])
        return not_(any_lane(most.now > 0.0)) & (self.at.now < 1)

    def _begin(self) -> None:
        """Go to the last point before floors may touch, by the running extremes of the motion without pounding."""
        w, touches = self.rows, sum(each.kind == TOUCH for each in self.layout.watched)
        low, high = Cell(whole(self.trace, 0)), Cell(self.last)
        parts = range(-(-touches // self.lanes))

        def touched(t: Any) -> Any:
            met = self.group.lanes_where(False)
            for part in parts:
                number = lane_numbers(self.trace, self.lanes) + float(part * self.lanes)
                most, _ = self._extremes(t, "peak", "trough", part)
                met = met | ((most >= w["high", part]) & (number < float(touches)))
            return any_lane(met)

        for _ in when(touched(self.last)):
            for _ in while_any(lambda: high.now - low.now > 1, self.trace):
                middle = (low.now + high.now) // 2
                for _ in when(touched(middle)):
                    high.now = middle
                for _ in when(not_(touched(middle))):
                    low.now = middle
            self.hits.now = flag(self.trace, True)
            self.going.now = flag(self.trace, False)
        for _ in when(not_(self.hits.now)):
            low.now = self.last
        self.at.now = low.now
        for part in self._watched_parts:
            most, least = self._extremes(self.at.now, "peak", "trough", part)
            number = lane_numbers(self.trace, self.lanes) + float(part * self.lanes)
            moves = ~(number < float(touches))
            largest, sized = (
                maximum(size(most), size(least)),
                self._vector(self.place_of("sized") + part * self.lanes) > 0.5,
            )
            high_now, low_now = w["high", part], w["low", part]
            w["high", part] = where(moves, maximum(high_now, where(sized, largest, most)), high_now)
            w["low", part] = where(moves, minimum(low_now, where(sized, -largest, least)), low_now)

    def _extremes(self, t: Any, most: str, least: str, part: int) -> tuple[Any, Any]:
        """Extremes at point t of the motion without pounding, of the table of a unit scale."""
        scale = self.scale.now
        above, below = self._then(most, t, part), self._then(least, t, part)
        up = scale >= 0.0
        return scale * where(up, above, below), scale * where(up, below, above)

    def _near(self, t: Any, most: str, least: str) -> Any:
        """Whether a gap or a peak may be reached in a window from point t on; which of them, in ``asks``."""
        w, found = self.rows, Cell(self.group.lanes_where(False))
        for part in self._watched_parts:
            above, below = self._extremes(t, most, least, part)
            reach = w["reach", part]
            asks = (above + reach >= w["high", part]) | (below - reach <= w["low", part])
            if most == "most":
                w["asks", part] = where(asks, 1.0, self.group.full(0.0))
            found.now = found.now | asks
        return any_lane(found.now)

    def _ask_all(self) -> Iterator[None]:
        """Let all that is watched be looked at."""
        for part in self._watched_parts:
            self.rows["asks", part] = self.group.full(1.0)
        yield

    def _advance(self, steps: Any) -> None:
        """Let the modes decay over steps of the grid; as many as there are lanes stand for a wide window."""
        w, m = self.rows, self.layout.wide_modes
        at = self.place_of("advance") + steps * (4 * m)
        for part in self._mode_parts:
            q, p = w["q", part], w["p", part]
            e = [self._vector(at + (k * m + part * self.lanes)) for k in range(4)]
            w["q", part], w["p", part] = fma(e[0], q, e[1] * p), fma(e[2], q, e[3] * p)

    # looking -------------------------------------------------------------------------------------------------------

    def _look(self, t: Any, room: Any) -> None:
        """Look at a window of `room` steps from point t on; ``steps`` becomes those before floors may touch."""
        w = self.rows
        for m in self.each(self.layout.modes, 4):
            w["y", m] = self._moved(m, t, 0)
        self.rated.now = flag(self.trace, False)
        self._weigh("bulge", "bulge", "bulge0")
        for q in self._asked(TOUCH):
            self._touch(q, t)
        kinds = {each.kind for each in self.layout.watched}
        for _ in when(self.steps.now > 0) if kinds - {TOUCH} else ():
            turning = any_lane(self._asking(TURN)) | any_lane(self._asking(ACCELERATION))
            for _ in when(turning):
                self._bend(t, ACCELERATION in kinds)
            for q in self._asked(TURN):
                self._turn(q, "y", "rate", "second")
            for q in self._asked(ACCELERATION):
                self._turn(q, "shake", "jerk", "")

    def _moved(self, m: Any, t: Any, row: int) -> Any:
        """Mode m at the lanes' instants (row 0), or its rate times the step (row 2)."""
        at = self.place_of("times") + (m * 4 + row) * self.lanes
        q, p = self.rows.number("q", m), self.rows.number("p", m)
        free = self._vector(self.place_of("rate" if row else "x") + m * (self.points + self.lanes) + t)
        return fma(self._vector(at), q, fma(self._vector(at + self.lanes), p, self.scale.now * free))

    def _know_rates(self, t: Any) -> None:
        """Find the rates of all modes, once in a window."""
        for _ in when(not_(self.rated.now)):
            for m in self.each(self.layout.modes, 4):
                self.rows["rate", m] = self._moved(m, t, 2)
            self.rated.now = flag(self.trace, True)

    def _bend(self, t: Any, shakes: bool) -> None:
        """Find second rates of all modes, and what accelerations ask for."""
        w = self.rows
        square, damping, push, inverse = (self.place_of(name) for name in ("square", "damping", "push", "inverse"))
        self._know_rates(t)
        ground = self.scale.now * self._vector(self.place_of("ground") + t)
        for m in self.each(self.layout.modes, 4):
            stiff, damped, rate = self._number(square + m), self._number(damping + m), w["rate", m]
            total = -fma(stiff, w["y", m], damped * rate)
            second = fma(-self._number(push + m), ground, total)
            w["second", m] = second
            if shakes:
                per = self._number(inverse)
                w["shake", m], w["jerk", m] = total * per, -fma(stiff, rate, damped * second) * per

    def _asked(self, kind: int) -> Iterator[Any]:
        """Go through the watched quantities of a kind that may reach something."""
        for part, asks in self._asking_parts(kind):
            for lane in each_lane(asks):
                yield lane + part * self.lanes

    def _asking_parts(self, kind: int) -> Iterator[tuple[int, Any]]:
        """Go through the rows of what is watched of a kind: their number, and which may reach something."""
        mine = [q for q, each in enumerate(self.layout.watched) if each.kind == kind]
        for part in range(mine[0] // self.lanes, mine[-1] // self.lanes + 1) if mine else ():
            number = lane_numbers(self.trace, self.lanes) + float(part * self.lanes)
            yield part, (self.rows["asks", part] > 0.5) & (number <= float(mine[-1])) & (number >= float(mine[0]))

    def _asking(self, kind: int) -> Any:
        """Lanes of what is watched of a kind that may reach something."""
        found = self.group.lanes_where(False)
        for _, asks in self._asking_parts(kind):
            found = found | asks
        return found

    def _sum(self, q: Any, row: str) -> Any:
        """Sum up a watched quantity at the lanes' instants, of rows of the modes."""
        lows, counts = self._ranges
        low, many = lows[q], counts if isinstance(counts, int) else counts[q]
        shape = self.place_of("shape") + q * self.layout.modes + low
        total = Cell(self.group.full(0.0))
        for k in self.each(many) if isinstance(many, int) else count_to(many, self.trace):
            total.now = fma(self._number(shape + k), self.rows[row, low + k], total.now)
        return total.now

    @cached_property
    def _ranges(self) -> tuple[Table, Table | int]:
        lows, counts = zip(*(self.layout.ranges or [(0, 0)]), strict=True)
        same = counts[0] if len(set(counts)) == 1 else None
        return Table(self.trace, lows), same or Table(self.trace, counts)

    def _touch(self, q: Any, t: Any) -> None:
        """End the window before the first step in which a contact may touch."""
        w, number = self.rows, lane_numbers(self.trace, self.lanes)
        x, bulge = self._sum(q, "y") - w.number("high", q), w.number("bulge", q)
        for _ in when(any_lane((x + bulge > 0.0) & (number <= real(self.steps.now)))):
            self._know_rates(t)
            s0 = self._sum(q, "rate") * (1.0 / 3.0)
            x1, s1 = after(x), after(s0)
            # a cubic keeps within the hull of its ends and of where their tangents are at a third of the step
            hull = maximum(maximum(x, x1), maximum(x + s0, x1 - s1))
            may = hull + bulge * self._number(self.place_of("remainder") + q) > 0.0
            first = first_true(may & (number < real(self.steps.now)))
            self.steps.now = lesser(first, self.steps.now)

    def _turn(self, q: Any, value: str, rate: str, second: str) -> None:
        """Take the peaks of a motion in the window."""
        w, far, number = self.rows, self.group.limit.far, lane_numbers(self.trace, self.lanes)
        points, steps = number <= real(self.steps.now), number < real(self.steps.now)
        x, bulge = self._sum(q, value), w.number("bulge", q)
        high, low = w.number("high", q), w.number("low", q)
        for _ in when(any_lane(((x + bulge > high) | (x - bulge < low)) & points)):
            s0 = self._sum(q, rate)
            x1, s1 = after(x), after(s0)
            turns = (s0 * s1 < 0.0) & steps
            if second:
                c0 = self._sum(q, second)
                inner = quintic_extreme(x, x1, s0, s1, c0, after(c0))
            else:
                inner = cubic_extreme(x, x1, s0, s1)
            inner = where(turns, inner, x)
            up = largest_lane(where(points, maximum(x, inner), -far))
            down = -largest_lane(where(points, -minimum(x, inner), -far))
            sized = self._number(self.place_of("sized") + q) > 0.5
            for _ in when(sized):
                most = where(-down > up, -down, up)
                most = where(most > high, most, high)
                w.put_number("high", q, most)
                w.put_number("low", q, -most)
            for _ in when(not_(sized)):
                w.put_number("high", q, where(up > high, up, high))
                w.put_number("low", q, where(down < low, down, low))


def scratch(layout: Layout) -> dict[str, int]:
    """Rows of flight's own."""
    parts, wide = layout.wide_modes // layout.lanes, layout.wide_watched // layout.lanes
    rows = dict.fromkeys(("q", "p", "amplitude", "floor"), parts)
    rows |= dict.fromkeys(("high", "low", "reach", "bulge", "asks"), wide)
    return rows | dict.fromkeys(("y", "rate", "second", "shake", "jerk"), layout.modes)


def quintic_extreme(x0: Any, x1: Any, s0: Any, s1: Any, c0: Any, c1: Any) -> Any:
    """Extreme inside a step of the quintic with values, rates and second rates (times the step) at its ends."""
    r, r1, r2 = x1 - x0 - s0 - 0.5 * c0, s1 - s0 - c0, c1 - c0
    b3 = 10.0 * r - 4.0 * r1 + 0.5 * r2
    b4 = -15.0 * r + 7.0 * r1 - r2
    b5 = 6.0 * r - 3.0 * r1 + 0.5 * r2
    t = s0 / (s0 - s1)
    for _ in range(2):
        rate = s0 + t * (c0 + t * (3.0 * b3 + t * (4.0 * b4 + t * (5.0 * b5))))
        bend = c0 + t * (6.0 * b3 + t * (12.0 * b4 + t * (20.0 * b5)))
        next_t = t - rate / bend
        t = where((next_t >= 0.0) & (next_t <= 1.0), next_t, t)
    return x0 + t * (s0 + t * (0.5 * c0 + t * (b3 + t * (b4 + t * b5))))
