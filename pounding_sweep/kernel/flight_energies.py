"""Energies of a flight in coupled modes: sums of powers over Gauss points of each step of the grid.

The state at any instant of a step follows from its start and the ground's accelerations at both
ends without error. What the ground puts in and what links take are integrated; what of it is not
held any more is the loss in damping.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import (
    Cell,
    Lookup,
    after,
    count_to,
    fma,
    lane_numbers,
    lane_of,
    not_,
    real,
    sum_lanes,
    when,
    where,
)
from pounding_sweep.kernel.row import kinetic, strain
from pounding_sweep.kernel.spec import KernelSpec

#: Gauss points in a step, in both number formats: the fastest mode turns by up to 2.8 rad, its powers by twice that.
NODES = {"float64": 8, "float32": 6}
#: Numbers by which the state at a node follows: q by q, by its rate, by the ground at both ends; q' by the same.
STATE = 8


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
    asked = spec.reducers & {"energy", "links"}

    def part(floor: int) -> tuple[int, int]:
        return next(each for each in spec.flocks if each[0] <= floor < sum(each))

    found = [Power("momentum", b, part(spec.home(b))) for b in range(spec.n_buildings)] if "energy" in asked else []
    for j, (left, _) in enumerate(spec.links if asked else ()):
        found += [Power(kind, j, part(left)) for kind in ("stretch", "left", "right")]
    return found


def count_nodes(spec: KernelSpec) -> int:
    """Return the number of Gauss points in a step."""
    return NODES[spec.precision]


def nodes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss points of a step, in shares of it, and their weights."""
    at, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 + 0.5 * at, 0.5 * weights


def gather(flight: Any, lane: Any, t: Any, steps: Any) -> None:
    """Add the powers over so many steps from point t on, which lie in the lanes."""
    group, w, layout, trace = flight.group, flight.rows, flight.layout, flight.trace
    s, spec, count = group.state, group.spec, count_nodes(group.spec)
    at, weights = nodes(count)
    table = Lookup(trace, [*map(float, at), *map(float, weights)])
    for m in flight.each(layout.modes, 4):
        w["y", m], w["rate", m] = flight.moved(m, t, 0), flight.moved(m, t, 2)
    early = flight.scale.now * flight.ground(t)
    late = after(early)
    gained = [Cell(flight.times.full(0.0)) for _ in range(spec.n_buildings)]
    given, lost = ([Cell(flight.times.full(0.0)) for _ in range(n)] for n in (spec.n_buildings, len(spec.links)))
    energies, linked = (name in group.asked for name in ("energy", "links"))
    for k in count_to(count, trace):
        share, weight = table[k], table[k + count]
        for m in flight.each(layout.modes, 8):
            place = flight.place_of("nodes") + ((m * count + k) * STATE)
            c = [flight.number(place + i) for i in range(STATE)]
            q, rate = w["y", m], w["rate", m]
            for name, first in (("node_q", 0), ("node_p", 4)):
                own = fma(c[first], q, c[first + 1] * rate)
                w[name, m] = fma(c[first + 2], early, fma(c[first + 3], late, own))
        values = [_sum(flight, i, power) for i, power in enumerate(layout.powers)]
        ground = fma(share, late - early, early)
        for power, x in zip(layout.powers, values, strict=True):
            if power.kind == "momentum":
                cell = gained[power.number]
                cell.now = fma(-weight * ground, x, cell.now)
        links = [(power.number, values[i : i + 3]) for i, power in enumerate(layout.powers) if power.kind == "stretch"]
        for j, (stretch, left, right) in links:
            damping, rate = group.prop("link_c", j), left - right
            spring = group.prop("link_k", j) * stretch
            if flight.yields:  # what flies is the motion about the set
                one, other = (s.lane(s.first["set"] + floor, lane) for floor in spec.links[j])
                spring = spring + group.prop("link_k", j) * (one - other)
            pull = weight * fma(damping, rate, spring)
            lost[j].now = fma(weight * damping * rate, rate, lost[j].now)
            for floor, v, sign in zip(spec.links[j], (left, right), (1.0, -1.0), strict=True):
                cell = given[spec.building_of[floor]]
                cell.now = fma(sign * pull, v, cell.now)
    h, mine = flight.number(flight.place_of("step")), lane_numbers(trace, flight.lanes) < real(steps)

    def total(cell: Cell) -> Any:
        return h * sum_lanes(where(mine, cell.now, 0.0))

    for b in range(spec.n_buildings):
        taken = total(given[b])
        if linked:
            _add(s, s.first["e_link"] + b, lane, taken)
        if energies:
            put_in = total(gained[b]) * lane_of(group.full(group.prop("m", spec.home(b))), lane)
            _add(s, s.first["e_in"] + b, lane, put_in)
            for _ in _damped(group, b, lane):
                _add(s, s.first["e_damp"] + b, lane, put_in - taken)
    for j, cell in enumerate(lost if linked else ()):
        _add(s, s.first["link_lost"] + j, lane, total(cell))


def _sum(flight: Any, i: int, power: Power) -> Any:
    """Return a linear function of the state at a node."""
    n, (low, many) = flight.layout.modes, power.modes
    at, total = flight.place_of("powers") + (2 * n * i + low), Cell(flight.times.full(0.0))
    for m in flight.each(many, 2):
        total.now = fma(flight.number(at + m), flight.rows["node_q", low + m], total.now)
        total.now = fma(flight.number(at + (m + n)), flight.rows["node_p", low + m], total.now)
    return total.now


def _add(s: Any, row: Any, lane: Any, x: Any) -> None:
    s.put_lane(row, lane, s.lane(row, lane) + x)


def _damped(group: Group, b: int, lane: Any) -> Iterator[None]:
    """Go on where a building has damping: else what is missing of its energy is rounding."""
    spec = group.spec
    if any(spec.building_of[i] == b for i in spec.dashpots):
        yield
        return
    alpha, beta = (lane_of(group.full(group.prop(x, b)), lane) for x in ("alpha", "beta"))
    yield from when(not_((alpha == 0.0) & (beta == 0.0)))


def account(flight: Any, lane: Any, sign: float) -> None:
    """Count what buildings hold as a flight begins (1) or ends (-1) into what is lost in damping."""
    group, s = flight.group, flight.group.state
    for b, floors in enumerate(group.building_floors) if "energy" in group.asked else ():
        held = lane_of(kinetic(group, floors) + strain(group, floors), lane)
        for _ in _damped(group, b, lane):
            _add(s, s.first["e_damp"] + b, lane, sign * held)
