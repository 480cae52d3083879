"""Free flight of one scenario, many instants side by side.

Between impacts the displacements are u = s u0 + w: s u0 is the motion without pounding under the record's scale s,
whose tables all scenarios share, and w decays freely in modes, q'' + 2 zeta omega q' + omega**2 q = 0. What is watched,
a gap or a peak so far, is a linear function x of the floors' motions, to which w adds at most

    B = sum over modes |x_m| a_m,    a_m = sqrt(q_m**2 + (q_m' / omega_m)**2)

from now on: windows of the record in which s u0 keeps farther than B from gaps and peaks are passed in one step, in the
others values and rates of x at successive points of a grid lie in the lanes. Where dashpots or links couple the modes,
x is the sum of x_m q_m and y_m q_m', and energies are sums of powers over Gauss points. A row whose storeys may yield
flies, while all are elastic, about the set at which it would rest; storeys begin to yield as floors touch, on either
side. See docs/theory.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from copy import copy
from dataclasses import dataclass
from functools import cached_property, partial, reduce
from itertools import accumulate, groupby
from operator import add
from typing import Any

import numpy as np

from pounding_sweep.kernel import hysteresis
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.modal_steps import MOVES
from pounding_sweep.kernel.peaks import followed, septic_extremes
from pounding_sweep.kernel.row import kinetic, strain
from pounding_sweep.kernel.spec import LANES, KernelSpec, property_slots
from pounding_sweep.kernel.types import ByFloor, Index, Lanes, Note, Truths
from pounding_sweep.lanes import (
    Cell,
    Lookup,
    Rows,
    Table,
    Tracer,
    any_lane,
    constant,
    count_to,
    first_true,
    fma,
    fold,
    iter_lanes,
    lane_of,
    lesser,
    maximum,
    minimum,
    not_,
    once_if,
    real,
    rounded,
    shifted,
    side_by_side,
    size,
    sqrt,
    transposed,
    where,
    while_any,
)

#: Steps of the grid in a wide window.
WIDE = 60
#: Points of a block of the grid that lie side by side, where motions are known by blocks.
SPAN = 32
#: Numbers before the ground's accelerations: the step of the grid (s), the inverse of a long one, points in one, and
#: points in a wide window or a block.
HEAD = 4
#: Numbers of a mode's state.
STATE = 2
#: Gauss points in a step, in both number formats: the fastest mode turns by up to 2.8 rad, its powers by twice that.
NODES = {"float64": 8, "float32": 6}
#: Numbers by which the state at one follows: q by q, by its rate, by the ground at both ends; q' by the same.
NODE_STATE = 8
#: Sums of which one is added up.
CHAINS = 3
#: Rounds of code that are written one after another instead of in a loop.
STRAIGHT = 48
#: What may happen to a watched quantity.
TOUCH, TURN, ACCELERATION, ONSET = 0, 1, 2, 3
#: Rows of modes, of three rates of them, and of what the ground adds to the last two ("": nothing); the same of their
#: accelerations.
MOVED = ("y", "rate", "second", "third", "", "rise")
SHAKEN = ("shake", "jerk", "fourth", "fifth", "lift", "lift5")
#: Rows of coupled modes that a row's rates, times the step, are in; what the ground adds to the last two.
RATES = {"y": "rate", "rate": "second", "second": "third", "third": "fourth", "rise": "lift", "": "rise"}
#: What coupled modes know of displacements and velocities, and these of the modes.
TO_FLOORS, TO_MODES = ("floors", "floors_up", "floors_vq", "floors_vp"), ("modal", "modal_qv", "modal_pu", "modal_pv")


@dataclass(frozen=True)
class Watched:
    """What flight watches: a linear function of the floors."""

    #: `TOUCH`: it may reach a gap; `TURN`: it may turn beyond its peak so far; `ACCELERATION`: the same of total
    #: accelerations; `ONSET`: it may reach limits on both sides, within which a storey is elastic
    kind: int
    #: of each floor's displacement, and of its velocity: a dashpot's force, () where none counts
    weights: tuple[float, ...]
    #: rows of the state that hold the gap or the peaks; `least` < 0: none, and of one whose size counts, that of `most`
    most: int
    least: int
    sized: bool  # it is its size that counts
    #: floor above the storey whose drift it is, to which yielding sets limits or whose shear is kept; -1: none
    storey: int = -1
    rates: tuple[float, ...] = ()


def watched(group: Group) -> list[Watched]:
    """Return what the flight of a lane group watches: contacts first."""
    n = group.spec.n_moving
    # in a kernel that is traced, constants are not known: which floors count does not depend on them
    constants = group.constants if isinstance(group.constants, np.ndarray) else np.ones(property_slots(group.spec).size)
    probe = Group(group.spec, group.scheme, group.reducers, None, n, constants)

    def weights(read: Callable[[ByFloor], Lanes], moved: str = "u") -> tuple[float, ...]:
        for i in range(n):
            for name in "uv":
                probe.state[name, i] = (np.arange(n) == i) * float(name == moved)
        return tuple(read("u"))

    first = probe.state.first
    quantities = [
        Watched(TOUCH, weights(contact.between), first["gap"] + contact.gap_index, -1, False)
        for contact in probe.iter_contacts()
    ]
    for floor, *_ in group.spec.hysteretic:
        quantities.append(Watched(ONSET, weights(probe.storey(floor).drift), -1, -1, False, floor))
    for motion in followed(probe, straight=True):
        most, least = (-1 if row is None else first[row[0]] + row[1] for row in (motion.most, motion.least))
        i = motion.shear
        of = weights(motion.of if i < 0 else probe.storey(i).drift)  # of a shear the drift
        rates = weights(motion.of, "v") if motion.pulls else ()
        quantities.append(Watched(TURN, of, most, least, motion.sized and i < 0, i, rates))
    if "acceleration" in group.requested:
        floors = enumerate(np.eye(group.spec.n_dof, n))
        quantities += [Watched(ACCELERATION, tuple(x), first["acc"] + i, -1, True) for i, x in floors]
    return quantities


@dataclass(frozen=True)
class Power:
    """A linear function of the floors' motion that is a factor of a power."""

    #: of a building, in masses of its first floor; of a link, its stretch and the velocities of its floors; one of
    #: {"momentum", "stretch", "left", "right"}
    kind: str
    number: int  # of the building or the link
    modes: tuple[int, int]  # first mode that it has a part in, and their number


def powers(spec: KernelSpec) -> list[Power]:
    """Return what the powers of a row are made of that are asked for."""
    factors = []
    if "energy" in spec.reducers:
        factors = [Power("momentum", b, _modes_of(spec, {spec.floors[b][0]})) for b in range(spec.n_buildings)]
    for j, (left, _) in enumerate(spec.links if spec.reducers & {"energy", "links"} else ()):
        factors += [Power(kind, j, _modes_of(spec, {left})) for kind in ("stretch", "left", "right")]
    return factors


def _modes_of(spec: KernelSpec, moved: Set[int]) -> tuple[int, int]:
    """First mode of what moves as one with some degrees of freedom, and number of modes."""
    ends = [0, *accumulate(map(len, spec.coupled_groups))]
    parts = [k for k, group in enumerate(spec.coupled_groups) if moved & set(group)]
    return ends[parts[0]], ends[parts[-1] + 1] - ends[parts[0]]


def nodes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss points of a step, in shares of it, and their weights."""
    at, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 + 0.5 * at, 0.5 * weights


class Layout:
    """Where the numbers of flight's tables lie, under one record."""

    # Those of `shared` come first, then those of each row of buildings: `fixed`, then `timed`, as many at each
    # point of the grid, then `series`, each over all points and `lanes` more. Where motions are known by blocks,
    # these stand for points.

    def __init__(self, group: Group) -> None:
        # as many instants at once on every processor, for the same results
        spec, lanes = group.spec, LANES // 2 if group.spec.precision == "float64" else LANES
        self.lanes, self.watched, self.yields, self.coupled = lanes, watched(group), bool(spec.yielding), spec.coupled
        self.modes = n = spec.n_moving
        #: How many watched quantities, the first of all, end a flight where they reach something.
        self.touches = sum(quantity.kind in (TOUCH, ONSET) for quantity in self.watched)

        def padded(count: int) -> int:
            return -(-count // lanes) * lanes

        self.wide_modes, self.wide_watched = padded(n), padded(max(1, len(self.watched)))
        #: Modes that each watched quantity has a part in: first and number.
        moved = [{*np.flatnonzero(each.weights), *np.flatnonzero(each.rates)} for each in self.watched]
        self.ranges = [_modes_of(spec, dofs) for dofs in moved]
        q, m, wide, coupled = len(self.watched), self.wide_modes, self.wide_watched, self.coupled
        shakes = not coupled and any(quantity.kind == ACCELERATION for quantity in self.watched)
        energies, sums = "energy" in spec.reducers and not coupled, spec.windows or self.yields
        #: Motions whose powers are added up between the points of the grid, where modes are coupled.
        self.powers: list[Power] = powers(spec) if coupled else []
        self.nodes = NODES[spec.precision]
        #: Factors of modes' amplitudes by what they add to what is watched, and to its excursions from chords: those
        #: of total accelerations are apart; and to those from the hulls of cubics, of what ends a flight.
        self.bounds = [("bound", "")] + [("bound_shaken", "shake")] * shakes
        self.bulges = [("bulge", "")] if coupled else [("bound", "bend")] + [("bound_shaken", "shake_bend")] * shakes
        self.misses = [("missed", "")] if coupled else [("bound", "missed")]
        #: Numbers of each table, by name: shared by all rows of buildings; of each of these; at each point of the grid,
        #: or in each block of it; and one after another over all points.
        self.shared, self.fixed, self.timed, self.series = (dict[str, int]() for _ in range(4))
        worked_out = dict[str, int]()  # by the kernel
        of_modes = self.fixed if coupled else self.shared  # shapes of coupled modes are not those of all rows
        held, shifted_by = spec.links or spec.foundations, 2 * n * len(self.powers)
        for tables, count, names, present in (
            (self.shared, lanes, ("step", "inverse"), True),
            (self.shared, wide, ("sized", "shaken"), True),
            (self.shared, n * wide, ("bound_shaken",), shakes),
            (self.fixed, m, ("slowness", "square", "damping"), True),
            (self.fixed, wide, ("bulge0", "missed0"), True),
            (self.fixed, m, ("bend", "missed"), not coupled),
            (self.fixed, m, ("shake", "shake_bend"), shakes),
            (of_modes, m, ("push",), True),
            (of_modes, n * max(1, q), ("shape", "shape_rate")[: 1 + coupled], True),
            (of_modes, n * m, (*TO_FLOORS, *TO_MODES) if coupled else ("floors", "modal"), True),
            (of_modes, n * wide, ("bound",), True),
            (of_modes, n * wide, ("across", "across_rate")[: 1 + coupled], sums),
            (self.fixed, n * wide, ("bulge", "missed"), coupled),
            (self.fixed, shifted_by, ("powers",), self.powers),
            (self.fixed, NODE_STATE * n * self.nodes, ("nodes",), self.powers),
            (self.fixed, n * spec.n_dof, ("sets",), self.yields and held),
            (worked_out, (lanes + 1) * 4 * m, ("advance",), True),
            (worked_out, n * 4 * lanes, ("times",), True),
            (self.timed, wide, ("most", "least"), spec.windows or spec.blocks),
            (self.timed, wide, ("widest", "widest_least", "peak", "trough"), spec.windows),
            (self.timed, m, ("q", "p"), not spec.blocks),
            (self.timed, m, ("input", "adjoint_q", "adjoint_p"), energies),
            (self.series, n, ("x", "rate"), not spec.blocks),
            (self.series, 1, ("ground",), not spec.blocks),
        ):
            tables.update(dict.fromkeys(names, count) if present else {})
        #: How many numbers are known before a kernel runs.
        self.n_precomputed = sum(map(padded, self.fixed.values()))
        self.fixed |= worked_out
        #: Rows of modes in double precision from which the motion without pounding follows.
        self.decays = [*MOVES, *([] if spec.blocks else ["square", "damping", "slowness", "push"])]
        if energies:
            self.decays += ["weight", "area", "adjoint_q", "adjoint_p", "adjoint_rise_q", "adjoint_rise_p"]
        #: Rows of modes of several rows of buildings in lanes, where motions are known by blocks: frequencies, twice
        #: their damping, and what kernels find from them; most steps in a block, and rows of its series.
        self.strides = ["w", "c", *MOVES, "square", "slowness", "heft", "new"] if spec.blocks else []
        self.block, self.series_rows = SPAN - SPAN // lanes, SPAN // lanes + 1
        #: Where the tables of the first row of buildings begin.
        self.start = sum(map(padded, self.shared.values()))
        #: Of each name, how many numbers for each point lie before its own, and how many others.
        self.places: dict[str, tuple[int, int]] = {}
        for tables in (self.shared, self.fixed):  # vectors lie where memory is read as such
            ends = accumulate(map(padded, tables.values()), initial=0)
            self.places |= {name: (0, end) for name, end in zip(tables, ends, strict=False)}
        per_point, others = 0, sum(map(padded, self.fixed.values()))
        for name, count in self.timed.items():
            self.places[name], per_point = (per_point, others), per_point + padded(count)
        for name, count in self.series.items():
            self.places[name], per_point, others = (per_point, others), per_point + count, others + lanes * count
        self._numbers = per_point, others

    @property
    def scratch(self) -> dict[str, int]:
        """Rows of flight's own."""
        n, parts, wide = self.modes, self.wide_modes // self.lanes, self.wide_watched // self.lanes
        factors = [f"amplitude_{factor}" for _, factor in (*self.bounds, *self.bulges, *self.misses) if factor]
        rows = dict.fromkeys(("q", "p", "whole_q", "whole_p", "amplitude", "floor", *factors), parts)
        rows |= dict.fromkeys(("high", "low", "reach", "bulge", "missed", "asks"), wide)
        rows |= {"shift": wide} if self.yields else {}
        rows |= dict.fromkeys(("y", "rate", "second", "third", "rise"), n) | {"reached": self.touches}
        if self.coupled:
            rows |= dict.fromkeys(("fourth", "lift"), n)
            rows |= dict.fromkeys(("node_q", "node_p"), n) if self.powers else {}
        elif "bound_shaken" in self.shared:
            rows |= dict.fromkeys(SHAKEN, n)
        if not self.strides:
            return rows
        rows |= dict.fromkeys(("track", "shook"), n * SPAN) | dict.fromkeys(("bends", "reaches"), 2 * n)
        rows |= dict.fromkeys(("above", "below", "swell"), self.wide_watched) | dict.fromkeys(("crest", "trough"), wide)
        rows |= dict.fromkeys(("point_q", "point_p"), parts * SPAN) | {"free_ground": self.series_rows}
        return rows | dict.fromkeys(("free_x", "free_rate"), n * self.series_rows)

    def size(self, points: Index) -> Index:
        """How many numbers the tables of a row of buildings have over a grid of so many points."""
        per_point, others = self._numbers
        return (points * per_point + (others + self.lanes - 1)) // self.lanes * self.lanes

    def base(self, row: Index, points: Index) -> Index:
        """Where the tables of a row of buildings begin."""
        return row * self.size(points) + self.start

    def place(self, name: str, points: Index) -> Index:
        """Where the numbers of a name begin, from where those of the row of buildings do."""
        per_point, others = self.places[name]
        return points * per_point + others if per_point else others


class Flight:
    """Flight of the scenarios of a lane group, one at a time."""

    # tables: tables of flight, a `Layout` for each row of buildings
    # points: points of the grid
    # memory: where flight's own rows lie

    def __init__(self, group: Group, tables: Any, points: Index, memory: Any = None) -> None:
        self.group, self.layout = group, (layout := Layout(group))
        #: Instants of the scenario that flies, side by side.
        self.times = copy(group)
        self.times.lanes = layout.lanes
        if group.trace is not None:
            self.times.trace = Tracer(group.trace.builder, group.spec.precision, layout.lanes)
        self.trace, self.lanes, self.coupled, self.yields = (
            self.times.trace,
            layout.lanes,
            layout.coupled,
            layout.yields,
        )
        self.tables, self.points = Table(self.trace, tables, self.lanes), points
        #: Last point that the scenario flies to, and whether nothing changes any more.
        self.last, self.quiet = Cell(points), Cell(False)
        self.rows = Rows(self.trace, layout.scratch, self.lanes, memory)
        #: Where the tables of the scenario that flies begin, and the record's scale.
        self.base, self.scale = Cell(points), Cell(1.0)
        self.at, self.hits, self.active, self.steps = Cell(points), Cell(False), Cell(True), Cell(points)
        #: Whether rates, and what leaves hulls of cubics, are known in a window.
        self.rated, self.weighed = Cell(False), Cell(False)
        #: Whether a peak may have grown.
        self.peaked = Cell(False)
        #: Blocks of the grid, where motions are known by them.
        self.blocks: Any = None
        self.mode_parts, self.watched_parts = (
            range(wide // self.lanes) for wide in (layout.wide_modes, layout.wide_watched)
        )

    # tables --------------------------------------------------------------------------------------------------------

    def place_of(self, name: str) -> Index:
        """Where the numbers of a name begin."""
        place = self.layout.place(name, self.points if self.blocks is None else self.blocks.blocks)
        return place if name in self.layout.shared else self.base.now + place

    def number(self, name: str, i: Index = 0) -> Lanes:
        """Return number `i` of a name."""
        return self.tables.number(self.place_of(name) + i)

    def vector(self, name: str, i: Index = 0) -> Lanes:
        """Return numbers of a name, from number `i` on, as many as there are lanes."""
        return self.tables.vector(self.place_of(name) + i)

    def part(self, name: str, part: Index, t: Index = 0) -> Lanes:
        """Vector number `part` of a name, at point t."""
        width = self.layout.timed.get(name, 0)
        return self.vector(name, t * width + part * self.lanes if width else part * self.lanes)

    def _table_point(self, t: Index) -> Index:
        """Point of the tables that stands for t: the last one in the rest after the ground's motion."""
        return lesser(t, self.points - 1)

    def _still(self, name: str, t: Index, part: Index) -> Lanes:
        """Modes, or their rates, of the motion without pounding at point t, of tables of a unit scale."""
        if self.blocks is None:
            return self.part(name, part, self._table_point(t))
        return self.rows[f"point_{name}", self._table_point(t) - self.blocks.start + part * SPAN]

    def _free(self, name: str, m: Index, t: Index) -> Lanes:
        """Return a mode, its rate times the step, or the ground, without pounding, at successive points from t on."""
        scale, t = self.scale.now, self._table_point(t)
        if self.blocks is None:
            free = self.vector(name, m * (self.points + self.lanes) + t)
        else:
            at = m * self.layout.series_rows * self.lanes + (t - self.blocks.start)
            free = self.rows.vector(f"free_{name}", at)
        return where(scale == 0.0, 0.0, scale * free)  # beyond the last point there may be any numbers

    def put_decays(self, decays: Table, start: Index) -> None:
        """Fill in how modes decay over 0, 1 ... steps and a wide window or a block, from their one step at `start`."""
        many, lanes, at = self.layout.wide_modes, self.lanes, self.place_of("advance")
        h, leap = self.number("step"), rounded(decays.number(HEAD - 1))
        for part in self.mode_parts:
            a = [decays.vector(start + (k * many + part * lanes)) for k in range(4)]
            e = [Cell(a[0] * 0.0 + first) for first in (1.0, 0.0, 0.0, 1.0)]
            for k in count_to(leap + 1):
                place = at + lesser(k, k * 0 + lanes) * (
                    4 * many
                )  # after the last lane's is replaced, up to the leap's
                for row, cell in enumerate(e):
                    self.tables.put_vector(place + (row * many + part * lanes), cell.now)
                e0, e1, e2, e3 = (cell.now for cell in e)
                e[0].now, e[1].now = fma(a[0], e0, a[1] * e2), fma(a[0], e1, a[1] * e3)
                e[2].now, e[3].now = fma(a[2], e0, a[3] * e2), fma(a[2], e1, a[3] * e3)
            for row in range(4):
                decay = [self.tables.vector(at + ((k * 4 + row) * many + part * lanes)) for k in range(lanes)]
                for m, series in enumerate(transposed(decay)[: self.layout.modes - part * lanes]):
                    place = self.place_of("times") + ((part * lanes + m) * 4 + row) * lanes
                    self.tables.put_vector(place, series * h if row >= 2 else series)

    def indices(self, n: int, times: int = 1) -> Iterator[Index]:
        """Count to n: in one straight line where that is short."""
        yield from range(n) if n * times <= STRAIGHT else count_to(n)

    # from and to lanes ---------------------------------------------------------------------------------------------

    def to_modes(self, lane: Index, t: Index) -> None:
        """Take a scenario out of its lane at point t: the decaying modes follow from its motion."""
        if self.blocks is not None:
            self.blocks.know(self.blocks.of(t))
        s = self.group.state
        if self.yields:
            self._shift(lane)

        def moved(i: Index) -> Lanes:
            x = s.lane(s.first["u"] + i, lane)
            return x - s.lane(s.first["set"] + i, lane) if self.yields else x

        def moves(i: Index) -> Lanes:
            return s.lane(s.first["v"] + i, lane)

        tables = TO_MODES if self.coupled else ("modal", "", "", "modal")
        for name, by in (("q", tables[:2]), ("p", tables[2:])):
            for part, total in enumerate(self._mix(zip(by, (moved, moves), strict=True))):
                self.rows[name, part] = total - self.scale.now * self._still(name, t, part)
        self._account(lane, t, 1.0)

    def to_floors(self, lane: Index, t: Index) -> None:
        """Put a scenario into its lane at point t."""
        if self.blocks is not None:
            self.blocks.know(self.blocks.of(t))
        s, w, scale = self.group.state, self.rows, self.times.full(self.scale.now)
        tables = TO_FLOORS if self.coupled else ("floors", "", "", "floors")
        for name in "qp":
            for part in self.mode_parts:
                w[f"whole_{name}", part] = fma(scale, self._still(name, t, part), w[name, part])
        readers = [partial(w.number, f"whole_{name}") for name in "qp"]
        for motion, by in (("u", tables[:2]), ("v", tables[2:])):
            for part, total in enumerate(self._mix(zip(by, readers, strict=True))):
                w["floor", part] = total
            for i in self.indices(self.layout.modes):
                x = w.number("floor", i)
                if motion == "u" and self.yields:
                    x = x + s.lane(s.first["set"] + i, lane)
                s.put_lane(s.first[motion] + i, lane, x)
                s.put_lane(s.first[motion + "0"] + i, lane, x)
        self._account(lane, t, -1.0)

    def _mix(self, readers: Iterable[tuple[str, Callable[[Index], Lanes]]]) -> list[Lanes]:
        """Sum up what functions read, weighted by rows of tables ("": of none)."""
        terms = [(self.place_of(name), read) for name, read in readers if name]
        sums = [self.times.cell(0.0) for _ in self.mode_parts]
        for i in self.indices(self.layout.modes, len(sums) * len(terms)):
            for at, read in terms:
                value = read(i)
                for part, total in enumerate(sums):
                    coefficient = self.tables.vector(at + (i * self.layout.wide_modes + part * self.lanes))
                    total.now = fma(coefficient, value, total.now)
        return [total.now for total in sums]

    # energies ------------------------------------------------------------------------------------------------------

    def _account(self, lane: Index, t: Index, sign: float) -> None:
        """Energies of a flight that begins (1) or ends (-1) at point t: input, and what of it is not held any more."""
        group, w, m_wide = self.group, self.rows, self.layout.wide_modes
        if "energy" not in group.requested:
            return
        for b, floors in enumerate(group.spec.floors) if self.coupled else group.iter_buildings():
            stored, gained = lane_of(kinetic(group, b, floors) + strain(group, b, floors), lane), constant(0.0)
            for m in () if self.coupled else floors:
                q, p, at = w.number("q", m), w.number("p", m), self._table_point(t) * m_wide + m
                more = self.number("adjoint_q", at) * q + self.number("adjoint_p", at) * p
                gained = gained + self.scale.now * (more - self.scale.now * self.number("input", at))
            if not self.coupled:
                gained = sign * (gained * lane_of(group.full(group.prop("m", floors[0])), lane))
                self._add("e_in", b, lane, gained)
            for _ in self._damped(b, lane):
                if not self.coupled:
                    self._add("e_damp", b, lane, gained)
                self._add("e_damp", b, lane, sign * stored)

    def _add(self, name: str, i: Index, lane: Index, x: Lanes) -> None:
        s = self.group.state
        s.put_lane(s.first[name] + i, lane, s.lane(s.first[name] + i, lane) + x)

    def _damped(self, b: Index, lane: Index) -> Iterator[None]:
        """Go on where a building has damping: else what is missing of its energy is rounding."""
        group = self.group
        by_matrix = isinstance(b, int) and group.spec.letters(b) not in ("", "k")
        if by_matrix or group.spec.base(b) or any(group.spec.building_of[i] == b for i in group.spec.dashpots):
            yield
            return
        alpha, beta = (lane_of(group.full(group.prop(x, b)), lane) for x in ("alpha", "beta"))
        yield from once_if(not_((alpha == 0.0) & (beta == 0.0)))

    def _gather(self, lane: Index, t: Index, steps: Index) -> None:
        """Add the powers over so many steps from point t on, which lie in the lanes."""
        group, w, layout, zero = self.group, self.rows, self.layout, self.times.full(0.0)
        s, spec, count = group.state, group.spec, layout.nodes
        table = Lookup([float(x) for x in np.concatenate(nodes(count))])
        for m in self.indices(layout.modes, 4):
            w["y", m], w["rate", m] = self.moved(m, t, 0), self.moved(m, t, 2)
        early = self._free("ground", 0, t)
        late = shifted(early)
        gained, link_energy, dissipated = (
            [Cell(zero) for _ in range(n)] for n in (spec.n_buildings, spec.n_buildings, len(spec.links))
        )
        for k in count_to(count):
            share, weight = table[k], table[k + count]
            for m in self.indices(layout.modes, 8):
                c = [self.number("nodes", (m * count + k) * NODE_STATE + i) for i in range(NODE_STATE)]
                q, rate = w["y", m], w["rate", m]
                for name, first in (("node_q", 0), ("node_p", 4)):
                    free = fma(c[first], q, c[first + 1] * rate)
                    w[name, m] = fma(c[first + 2], early, fma(c[first + 3], late, free))
            values = [self._power(i, power.modes) for i, power in enumerate(layout.powers)]
            ground = fma(share, late - early, early)
            for i, power in enumerate(layout.powers):
                if power.kind == "momentum":
                    cell = gained[power.number]
                    cell.now = fma(-weight * ground, values[i], cell.now)
                if power.kind != "stretch":
                    continue
                j, (stretch, left, right) = power.number, values[i : i + 3]
                damping, rate = group.prop("link_c", j), left - right
                spring = group.prop("link_k", j) * stretch
                if self.yields:  # what flies is the motion about the set
                    left_set, right_set = (s.lane(s.first["set"] + floor, lane) for floor in spec.links[j])
                    spring = spring + group.prop("link_k", j) * (left_set - right_set)
                pull = weight * fma(damping, rate, spring)
                dissipated[j].now = fma(weight * damping * rate, rate, dissipated[j].now)
                for floor, v, sign in zip(spec.links[j], (left, right), (1.0, -1.0), strict=True):
                    cell = link_energy[spec.building_of[floor]]
                    cell.now = fma(sign * pull, v, cell.now)
        h, inside = self.number("step"), self._numbers_of(0) < real(steps)

        def total(cell: Cell) -> Lanes:
            return h * fold(where(inside, cell.now, 0.0), add)

        for b in range(spec.n_buildings):
            to_links = total(link_energy[b])
            if "links" in group.requested:
                self._add("e_link", b, lane, to_links)
            if "energy" in group.requested:
                put_in = total(gained[b]) * lane_of(group.full(group.prop("m", spec.floors[b][0])), lane)
                self._add("e_in", b, lane, put_in)
                for _ in self._damped(b, lane):
                    self._add("e_damp", b, lane, put_in - to_links)
        for j, cell in enumerate(dissipated if "links" in group.requested else ()):
            self._add("link_lost", j, lane, total(cell))

    def _power(self, i: int, modes: tuple[int, int]) -> Lanes:
        """Return the factor of a power at a node."""
        n, (low, many) = self.layout.modes, modes
        at, total = 2 * n * i + low, self.times.cell(0.0)
        for m in self.indices(many, 2):
            total.now = fma(self.number("powers", at + m), self.rows["node_q", low + m], total.now)
            total.now = fma(self.number("powers", at + n + m), self.rows["node_p", low + m], total.now)
        return total.now

    # storeys that yield --------------------------------------------------------------------------------------------

    def _find_sets(self) -> None:
        """Find the displacements at which the row would rest, as its storeys have yielded."""
        group = self.group
        s, n = group.state, group.spec.n_dof
        if "sets" not in self.layout.fixed:
            hysteresis.find_sets(group)
            return
        for i in self.indices(self.layout.modes):  # links and foundations hold back, too
            rest = group.cell(0.0)
            for j in self.indices(n):
                drift = s["ct", j] / group.prop("k", j)
                rest.now = fma(-self.number("sets", i * n + j), drift, rest.now)
            s["set", i] = rest.now

    def _shift(self, lane: Index) -> None:
        """Find what the set of a scenario adds to all that is watched; total accelerations do not know it."""
        self._find_sets()
        s, w, wide = self.group.state, self.rows, self.layout.wide_watched
        sums = [self.times.cell(0.0) for _ in self.watched_parts]
        for to_modes, to_watched in (("modal", "across"), ("modal_pu", "across_rate"))[: 1 + self.coupled]:
            # of rates times the step
            unit = self.number("step") if to_watched == "across_rate" else 1.0
            for part, total in enumerate(self._mix([(to_modes, lambda i: s.lane(s.first["set"] + i, lane))])):
                w["amplitude", part] = unit * total
            for m in self.indices(self.layout.modes, len(sums)):
                q = w.number("amplitude", m)
                for part, cell in enumerate(sums):
                    cell.now = fma(self.vector(to_watched, m * wide + part * self.lanes), q, cell.now)
        for part, cell in enumerate(sums):
            w["shift", part] = where(self.part("shaken", part) > 0.5, 0.0, cell.now)

    def _storey_stiffness(self, i: Index) -> Lanes:
        """Stiffness of a storey, of the shear that it bears."""
        k = self.group.prop("k", i)
        return k + self.group.prop("geometric", i) if self.group.spec.p_delta else k

    def _peak_drifts(self, i: Index, lane: Index) -> tuple[Lanes, Lanes]:
        """Drifts of an elastic storey at which its shear is the largest so far, to either side."""
        s, k = self.group.state, self._storey_stiffness(i)
        middle, reach = -s["ct", i] / k, s["shear", i] / k
        return lane_of(middle - reach, lane), lane_of(middle + reach, lane)

    def _put_elastic_limits(self, lane: Index) -> None:
        """Drifts at which the elastic branch of each spring ends, or its storey falls, to either side."""
        group, w = self.group, self.rows
        first = sum(quantity.kind == TOUCH for quantity in self.layout.watched)
        for spring in group.iter_springs(straight=12 * len(group.spec.hysteretic) <= STRAIGHT):
            gauges: Any = hysteresis.gauges(spring)
            low, high = reduce(maximum, [x.low for x in gauges]), reduce(minimum, [x.high for x in gauges])
            w.put_number("high", first + spring.number, lane_of(high, lane))
            w.put_number("low", first + spring.number, lane_of(low, lane))

    # flight --------------------------------------------------------------------------------------------------------

    def advance_free(self, lane: Index, note: Note = None) -> None:
        """Fly from point `at` on to where floors may touch in the step to come (`hits`), or to the last point."""
        # with a `note` of each point's motion, windows are one step long
        self._take_thresholds(lane)
        self.hits.now, self.quiet.now, self.active.now, self.peaked.now = False, False, True, False
        # in the rest after the ground's motion the amplitudes of the modes, which decay, bound all that follows
        rests = self.at.now > self.points - 2
        settles = self.group.prop("settles") > 0.0 if self.group.spec.rest_is_bounded else constant(False)
        far, ahead = Cell(False), Cell(self.points)
        windows, blocks = self.group.spec.windows, self.blocks
        leaps = note is None and windows and not self.layout.powers
        for _ in once_if(self.at.now < 1) if leaps or blocks is not None else ():
            self._bounds()
            amplitudes = [self.rows["amplitude", part] for part in self.mode_parts]
            moves = any_lane(reduce(maximum, amplitudes, self.times.full(0.0)) > 0.0)
            for _ in once_if(not_(moves)):  # nothing but the record moves the row
                self._skip_to_first() if leaps else self._skip_free_blocks()
        for _ in while_any(lambda: self.active.now & (self.at.now < self.last.now)):
            t = self.at.now
            self._bounds()
            far.now, ahead.now = False, self.last.now - t
            for _ in once_if(rests & settles):
                far.now = self.quiet.now = not_(self._near(t, "", ""))
                self.active.now = not_(far.now)
            for _ in once_if(not_(rests)) if blocks is not None else ():
                block = blocks.of(t)
                ahead.now = lesser(ahead.now, (block + 1) * blocks.length - t)
                far.now = not_(self._near(block, "most", "least"))
                for _ in once_if(far.now):  # pass what is left of the block
                    left = Cell(ahead.now)
                    for _ in once_if(ahead.now == blocks.length):
                        self._advance(self.lanes)
                        left.now = 0
                    for _ in while_any(lambda: left.now > 0):  # noqa: B023
                        steps = lesser(left.now, self.lanes - 1)
                        self._advance(steps)
                        left.now -= steps
                    self.at.now += ahead.now
            for _ in once_if(not_(rests)) if leaps else ():
                # by the bounds that modes have now
                for _ in while_any(
                    lambda: (
                        not_(self.last.now - self.at.now < WIDE)
                        & not_(self._near(self.at.now, "widest", "widest_least"))
                    )
                ):
                    self._advance(self.lanes)
                    self.at.now += WIDE
                far.now = self.at.now > t
            for _ in once_if(not_(far.now)):
                steps_left = lesser(ahead.now, self.lanes - 1 if note is None else 1)
                self.steps.now = steps_left
                if blocks is not None:
                    blocks.know(blocks.of(t))
                for part in () if windows or blocks is not None else self.watched_parts:
                    self.rows["asks", part] = self.times.full(1.0)
                for _ in once_if(self._near(t, "most", "least")) if windows else range(1):
                    self._scan_window(t)
                steps = self.steps.now
                if self.layout.powers:
                    self._gather(lane, t, steps)
                self._advance(steps)
                self.at.now = t + steps
                self.hits.now = steps < steps_left
                self.active.now = not_(steps < steps_left)
                if note is not None:
                    self.to_floors(lane, t + steps)
                    note(t + steps)
                    self.to_modes(lane, t + steps)
        for _ in once_if(self.peaked.now):
            self._keep_peaks(lane)

    @cached_property
    def _lookups(self) -> list[Lookup]:
        """Rows of the state of each watched quantity's most and least value, its storey, and its modes."""
        columns = [
            (quantity.most, quantity.least, quantity.storey, *modes)
            for quantity, modes in zip(self.layout.watched, self.layout.ranges, strict=True)
        ]
        return [Lookup(column) for column in zip(*columns or [(0,) * 5], strict=True)]

    def _runs(self, storeys: bool, kinds: Sequence[int]) -> Iterator[tuple[Index, Watched]]:
        """Go through the watched quantities of storeys, or all others, of some kinds: number, and one alike."""

        def kind_of(q: int) -> tuple[int, bool, bool, bool]:
            quantity = self.layout.watched[q]
            return quantity.kind, quantity.least >= 0, quantity.sized, quantity.storey >= 0

        for (kind, *_, of_storey), run in groupby(range(len(self.layout.watched)), kind_of):
            numbers = list(run)
            if of_storey == storeys and kind in kinds:
                for q in self.indices(len(numbers), 12 if storeys else 1):
                    yield q + numbers[0], self.layout.watched[numbers[0]]

    def _take_thresholds(self, lane: Index) -> None:
        """Gaps and peaks so far; what is in no lane's way is far."""
        s, w, far = self.group.state, self.rows, self.group.limit.far
        highs, lows = ([x] * self.layout.wide_watched for x in (far, -far))
        # numbers that are put in one by one are waited for where vectors are read
        for q, quantity in enumerate(self.layout.watched):
            if quantity.storey < 0:
                highs[q] = x = s.lane(quantity.most, lane)
                lows[q] = -x if quantity.sized else s.lane(quantity.least, lane) if quantity.least >= 0 else -far
        for part in self.watched_parts:
            place = slice(part * self.lanes, (part + 1) * self.lanes)
            w["high", part], w["low", part] = (side_by_side(self.trace, numbers[place]) for numbers in (highs, lows))
        self._put_elastic_limits(lane)
        for q, _ in self._runs(True, (TURN,)):
            down, up = self._peak_drifts(self._lookups[2][q], lane)
            w.put_number("high", q, up)
            w.put_number("low", q, down)

    def _keep_peaks(self, lane: Index) -> None:
        group, s, w, (most, least, storeys, *_) = self.group, self.group.state, self.rows, self._lookups
        for q, _ in self._runs(True, (TURN,)):  # by shears of drifts that went farther
            down, up = self._peak_drifts(storeys[q], lane)
            more = maximum(w.number("high", q) - up, down - w.number("low", q))
            k = group.full(self._storey_stiffness(storeys[q]))
            self._add("shear", storeys[q], lane, lane_of(k, lane) * more)
        for q, quantity in self._runs(False, (TURN, ACCELERATION)):
            s.put_lane(most[q], lane, w.number("high", q))
            if quantity.least >= 0:
                s.put_lane(least[q], lane, w.number("low", q))

    def _bounds(self) -> None:
        """Amplitudes of the modes, and the most that they add to what is watched."""
        w = self.rows
        for part in self.mode_parts:
            q, p = w["q", part], w["p", part] * self.part("slowness", part)
            w["amplitude", part] = sqrt(fma(q, q, p * p))
        self._weigh(self.layout.bounds, "reach")

    def _free_excursion(self, name: str, part: int) -> Lanes:
        """How far what is watched leaves chords (`bulge0`) or hulls (`missed0`) without pounding."""
        return size(self.times.full(self.scale.now)) * self.part(name, part)

    def _weigh(self, tables: Sequence[tuple[str, str]], row: str, excursion: str = "") -> None:
        """Sum of the amplitudes, weighted for all that is watched; plus the free motion's `excursion`."""
        w, wide, zero = self.rows, self.layout.wide_watched, self.times.full(0.0)
        # all that follows waits for these sums: their parts do not wait for each other
        sums = [[Cell(zero) for _ in range(CHAINS)] for _ in self.watched_parts]
        for _, factor in tables:
            for part in self.mode_parts if factor else ():
                w[f"amplitude_{factor}", part] = self.part(factor, part) * w["amplitude", part]
        places = [self.place_of(table) for table, _ in tables]
        for m in self.indices(self.layout.modes, len(sums) * len(tables)):
            for at, (_, factor) in zip(places, tables, strict=True):
                a = w.number(f"amplitude_{factor}" if factor else "amplitude", m)
                for part, chains in enumerate(sums):
                    total = chains[m % CHAINS if isinstance(m, int) else 0]
                    total.now = fma(self.tables.vector(at + (m * wide + part * self.lanes)), a, total.now)
        for part, chains in enumerate(sums):
            first = self._free_excursion(excursion, part) if excursion else zero
            w[row, part] = sum((chain.now for chain in chains), start=first)

    def _skip_to_first(self) -> None:
        """Go to the last point before floors may touch, by the running extremes of the motion without pounding."""
        low, high = Cell(0), Cell(self.last.now)
        for _ in once_if(self._met(self._extremes(self.last.now, "peak", "trough"))):
            for _ in while_any(lambda: high.now - low.now > 1):
                middle = (low.now + high.now) // 2
                met = self._met(self._extremes(middle, "peak", "trough"))
                for _ in once_if(met):
                    high.now = middle
                for _ in once_if(not_(met)):
                    low.now = middle
            self.hits.now, self.active.now = True, False
        for _ in once_if(not_(self.hits.now)):
            low.now = self.last.now
        self.at.now = low.now
        for part, (most, least) in enumerate(self._extremes(self.at.now, "peak", "trough")):
            self._take_peaks(part, most, least)

    def _met(self, extremes: Sequence[tuple[Lanes, Lanes]]) -> Truths:
        """Whether floors may touch, or storeys yield, by extremes of the motion without pounding, part by part."""
        met, touches = self.times.full(False), self.layout.touches
        for part, (above, below) in enumerate(extremes[: -(-touches // self.lanes)]):
            reached = above >= self.rows["high", part]
            if self.yields:
                reached = reached | (below <= self.rows["low", part])
            met = met | (reached & (self._numbers_of(part) < float(touches)))
        return any_lane(met)

    def _take_peaks(self, part: int, most: Lanes, least: Lanes) -> None:
        """Take what is reached at least of a part of what is watched, touches left out."""
        w, sized, self.peaked.now = self.rows, self.part("sized", part) > 0.5, True
        moves, largest = ~(self._numbers_of(part) < float(self.layout.touches)), maximum(most, -least)
        high, low = w["high", part], w["low", part]
        w["high", part] = where(moves, maximum(high, where(sized, largest, most)), high)
        w["low", part] = where(moves, minimum(low, where(sized, -largest, least)), low)

    def _numbers_of(self, part: int) -> Lanes:
        """Numbers of what is watched in a part, or of the lanes' instants."""
        return side_by_side(self.trace, range(self.lanes)) + float(part * self.lanes)

    def _extremes(self, t: Index, most: str, least: str) -> list[tuple[Lanes, Lanes]]:
        """Extremes at point t of the motion without pounding, of tables of a unit scale, part by part."""
        scale, extremes, t = self.scale.now, [], self._table_point(t)
        for part in self.watched_parts:
            above, below = self.part(most, part, t), self.part(least, part, t)
            up = scale >= 0.0
            extremes.append((scale * where(up, above, below), scale * where(up, below, above)))
        return extremes

    def _near(self, t: Index, most: str, least: str) -> Truths:
        """Whether a gap or a peak may be reached in a window from point t on ("": ever); which of them, in ``asks``."""
        w, near, zero = self.rows, self.times.cell(False), self.times.full(0.0)
        extremes = self._extremes(t, most, least) if most else [(zero, zero)] * len(self.watched_parts)
        for part, (above, below) in enumerate(extremes):
            reach, high, low = w["reach", part], w["high", part], w["low", part]
            up, down = (x + w["shift", part] if self.yields else x for x in (above, below))
            asks = (up + reach >= high) | (down - reach <= low)
            if not most:
                asks = (up + reach > high) | (down - reach < low)
            if most in ("most", ""):
                w["asks", part] = where(asks, 1.0, 0.0)
            near.now |= asks
        return any_lane(near.now)

    def _advance(self, steps: Index) -> None:
        """Let the modes decay over steps of the grid; as many as there are lanes stand for a wide window or a block."""
        w, m = self.rows, self.layout.wide_modes
        for part in self.mode_parts:
            q, p = w["q", part], w["p", part]
            e = [self.vector("advance", steps * (4 * m) + (k * m + part * self.lanes)) for k in range(4)]
            w["q", part], w["p", part] = fma(e[0], q, e[1] * p), fma(e[2], q, e[3] * p)

    def _skip_free_blocks(self) -> None:
        """Go through blocks to the first in which floors may touch; what their peaks are at least are peaks so far."""
        w, far = self.rows, self.group.limit.far
        for part in self.watched_parts:
            w["crest", part], w["trough", part] = self.times.full(-far), self.times.full(far)
        free, block = Cell(True), Cell(0)
        blocks = Cell(self.blocks.blocks)
        for _ in once_if(self.last.now < self.points - 1):  # the others are not all of this scenario's
            blocks.now = self.last.now // self.blocks.length
        for _ in while_any(lambda: free.now & (block.now < blocks.now)):
            extremes = self._extremes(block.now, "most", "least")
            free.now = not_(self._met(extremes))
            for _ in once_if(free.now):
                for part, (above, below) in enumerate(extremes):
                    w["crest", part] = maximum(w["crest", part], above)
                    w["trough", part] = minimum(w["trough", part], below)
                block.now += 1
        for _ in once_if(block.now > 0):
            for part in self.watched_parts:
                less = self._free_excursion("bulge0", part) * (2.0 / self.blocks.per_square)  # bounds beyond points
                self._take_peaks(part, w["crest", part] - less, w["trough", part] + less)

    # looking -------------------------------------------------------------------------------------------------------

    def _scan_window(self, t: Index) -> None:
        """Look at a window of `steps` from point t on, which become those before floors may touch, or storeys yield."""
        w, coupled = self.rows, self.coupled
        for m in self.indices(self.layout.modes, 4):
            w["y", m] = self.moved(m, t, 0)
        self.rated.now = self.weighed.now = False
        if coupled:
            self._bend(t, shakes=False)
        self._weigh(self.layout.bulges, "bulge", "bulge0")
        kinds = {quantity.kind for quantity in self.layout.watched}
        for kind in sorted(kinds & {TOUCH, ONSET}):
            for q in self._reaching(kind):
                for _ in once_if(self._crosses(q, kind == ONSET)):
                    for _ in once_if(not_(self.weighed.now)):
                        self._know_rates(t)
                        self._weigh(self.layout.misses, "missed", "missed0")
                        self.weighed.now = True
                    self._end_before(q, kind == ONSET)
        for _ in once_if(self.steps.now > 0) if kinds - {TOUCH, ONSET} else ():
            turning: Truths = False
            for _, asks in (row for kind in (TURN, ACCELERATION) for row in self._reaching_lanes(kind)):
                turning = turning | any_lane(asks)
            for _ in once_if(turning) if not coupled else ():
                self._bend(t, ACCELERATION in kinds)
            for q in self._reaching(TURN):
                self._turn(q, MOVED)
            for q in self._reaching(ACCELERATION):
                self._turn(q, MOVED if coupled else SHAKEN)

    def moved(self, m: Index, t: Index, row: int) -> Lanes:
        """Mode m at the lanes' instants (row 0), or its rate times the step (row 2)."""
        at, (q, p) = (m * 4 + row) * self.lanes, (self.rows.number(name, m) for name in "qp")
        free = self._free("rate" if row else "x", m, t)
        return fma(self.vector("times", at), q, fma(self.vector("times", at + self.lanes), p, free))

    def _know_rates(self, t: Index) -> None:
        """Find the rates of all modes, once in a window."""
        for _ in once_if(not_(self.rated.now)):
            for m in self.indices(self.layout.modes, 4):
                self.rows["rate", m] = self.moved(m, t, 2)
            self.rated.now = True

    def _bend(self, t: Index, shakes: bool) -> None:
        """Find second and third rates of all modes, and what accelerations ask for."""
        # Of third rates, the part of the ground's is apart: it jumps at the points of the grid.
        w = self.rows
        self._know_rates(t)
        ground = self._free("ground", 0, t)
        rise = shifted(ground) - ground
        for m in self.indices(self.layout.modes, 4):
            stiff, damped, pushed = (self.number(name, m) for name in ("square", "damping", "push"))
            rate = w["rate", m]
            total = -fma(stiff, w["y", m], damped * rate)
            second = fma(-pushed, ground, total)
            third, rising = -fma(stiff, rate, damped * second), -pushed * rise
            w["second", m], w["third", m], w["rise", m] = second, third, rising
            if not (self.coupled or shakes):
                continue
            fourth, lift = -fma(stiff, second, damped * third), -damped * rising
            if self.coupled:
                w["fourth", m], w["lift", m] = fourth, lift
            if shakes:
                fifth, lift5 = -fma(stiff, third, damped * fourth), -fma(stiff, rising, damped * lift)
                per = self.number("inverse")
                for name, x in zip(SHAKEN, (total, third, fourth, fifth, lift, lift5), strict=True):
                    w[name, m] = x * per

    def _reaching(self, kind: int) -> Iterator[Index]:
        """Go through the watched quantities of a kind that may reach something."""
        for part, asks in self._reaching_lanes(kind):
            for lane in iter_lanes(asks):
                yield lane + part * self.lanes

    def _reaching_lanes(self, kind: int) -> Iterator[tuple[int, Index]]:
        """Go through the rows of what is watched of a kind: their number, and which may reach something."""
        those = [q for q, quantity in enumerate(self.layout.watched) if quantity.kind == kind]
        for part in range(those[0] // self.lanes, those[-1] // self.lanes + 1) if those else ():
            number = self._numbers_of(part)
            yield part, (self.rows["asks", part] > 0.5) & (number <= float(those[-1])) & (number >= float(those[0]))

    def _sum(self, q: Index, row: str) -> Lanes:
        """Sum up a watched quantity at the lanes' instants, of rows of the modes."""
        *_, lows, counts = self._lookups
        low, many = lows[q], {many for _, many in self.layout.ranges}
        total, (shape, *rates) = self.times.cell(0.0), self._shapes(q)
        for k in self.indices(many.pop()) if len(many) == 1 else count_to(counts[q]):
            if row:
                total.now = fma(self.tables.number(shape + k), self.rows[row, low + k], total.now)
            for at in rates:
                total.now = fma(self.tables.number(at + k), self.rows[RATES[row], low + k], total.now)
        return total.now

    def _shapes(self, q: Index) -> list[Index]:
        """Where what modes, and coupled ones by their rates, add to a watched quantity begins."""
        first = q * self.layout.modes + self._lookups[3][q]
        return [self.place_of(name) + first for name in ("shape", "shape_rate")[: 1 + self.coupled]]

    def _crosses(self, q: Index, onset: bool) -> Truths:
        """Whether a watched quantity may reach its limit in the window; how far beyond it is, in ``reached``."""
        w = self.rows
        limit = w.number("high", q)
        if onset:  # the middle between its limits
            limit = 0.5 * (limit + w.number("low", q))
        if self.yields:
            limit = limit - w.number("shift", q)
        w["reached", q] = x = self._sum(q, "y") - limit
        reaches = self._excess(x, q, onset) + w.number("bulge", q) > 0.0
        return any_lane(reaches & (self._numbers_of(0) <= real(self.steps.now)))

    def _excess(self, x: Lanes, q: Index, onset: bool) -> Lanes:
        """Return how far beyond its limit a watched quantity is; an onset has one on either side."""
        w = self.rows
        return size(x) - 0.5 * (w.number("high", q) - w.number("low", q)) if onset else x

    def _end_before(self, q: Index, onset: bool) -> None:
        """End the window before the first step in which a watched quantity may reach its limit."""
        x, s0 = self.rows["reached", q], self._sum(q, "rate") * (1.0 / 3.0)
        x1, s1 = shifted(x), shifted(s0)
        # a cubic keeps within the hull of its ends and of where their tangents are at a third of the step
        hull = self._excess(x, q, onset)
        for value in (x1, x + s0, x1 - s1):
            hull = maximum(hull, self._excess(value, q, onset))
        may = hull + self.rows.number("missed", q) > 0.0
        first = first_true(may & (self._numbers_of(0) < real(self.steps.now)))
        self.steps.now = lesser(first, self.steps.now)

    def _rates(self, q: Index, name: str, rise: str) -> tuple[Lanes, Lanes]:
        """Return a higher rate at the starts and the ends of steps, `rise` being the ground's part in it."""
        start = self._sum(q, name)
        end = shifted(start)
        if not (rise or self.coupled):
            return start, end
        added = self._sum(q, rise)
        return start + added, end + added

    def _higher_rates(self, q: Index, names: Sequence[str]) -> list[tuple[Lanes, Lanes]]:
        """Return the fourth and fifth rates at the starts and the ends of steps, by the equations of the modes."""
        w, (_, _, _, lows, counts), zero = self.rows, self._lookups, self.times.full(0.0)
        free, pushed = ([Cell(zero), Cell(zero)] for _ in "..")
        for k in count_to(counts[q]):
            m = lows[q] + k
            stiff, damped = self.number("square", m), self.number("damping", m)
            weights = [self.tables.number(at + k) for at in self._shapes(q)]
            for sums, rows in ((free, names[2:4]), (pushed, names[4:])):
                rates = [w[row, m] if row else zero for row in rows]
                for _ in range(2 + self.coupled):
                    rates.append(-fma(stiff, rates[-2], damped * rates[-1]))
                for i, cell in enumerate(sums):
                    for weight, rate in zip(weights, rates[2 + i :], strict=False):
                        cell.now = fma(weight, rate, cell.now)
        return [(x.now + g.now, shifted(x.now) + g.now) for x, g in zip(free, pushed, strict=True)]

    def _turn(self, q: Index, names: Sequence[str]) -> None:
        """Take the peaks of a motion in the window, by rows of its rates and what the ground adds to the last two."""
        w, far, number = self.rows, self.group.limit.far, self._numbers_of(0)
        points, steps = number <= real(self.steps.now), number < real(self.steps.now)
        x, bulge = self._sum(q, names[0]), w.number("bulge", q)
        if self.yields:
            x = x + w.number("shift", q)
        high, low = w.number("high", q), w.number("low", q)
        for _ in once_if(any_lane(((x + bulge > high) | (x - bulge < low)) & points)):
            self.peaked.now = True
            s0 = self._sum(q, names[1])
            x1, s1 = shifted(x), shifted(s0)
            (c0, c1), (j0, j1) = (self._rates(q, names[k], names[k + 2]) for k in (2, 3))
            ends, higher = ((x, s0, c0, j0), (x1, s1, c1, j1)), partial(self._higher_rates, q, names)
            most, least = septic_extremes(self.times, steps, *ends, (high, low), higher, bounds=True)
            up = fold(where(steps, most, where(points, x, -far)), maximum)
            down = -fold(where(steps, -least, where(points, -x, -far)), maximum)
            sized = self.number("sized", q) > 0.5
            for _ in once_if(sized):
                most = where(-down > up, -down, up)
                most = where(most > high, most, high)
                w.put_number("high", q, most)
                w.put_number("low", q, -most)
            for _ in once_if(not_(sized)):
                w.put_number("high", q, where(up > high, up, high))
                w.put_number("low", q, where(down < low, down, low))
