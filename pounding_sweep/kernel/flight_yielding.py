"""Flight of rows in which storeys may yield.

Where all storeys are elastic, their shears are k (d - (1 - r) p), and p stands still. With the
displacements y = u - c, where the set c of a floor sums (1 - r) p over the storeys below it,

    M y'' + C y' + K y = -M ag,

the equation of the elastic row: y flies. What is watched in u is watched in y with the value that
it has at c added. An elastic storey begins to yield where its drift reaches p + dy, or p - dy:
like a touch, on either side. Once it yields, the row is stepped until all storeys are elastic again.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.hysteresis import hardened
from pounding_sweep.kernel.lanes import Cell, Lookup, count_to, fma, lane_of, load, maximum, where


def find_sets(flight: Any) -> None:
    """Find the displacements at which the row would rest, as its storeys have yielded."""
    group = flight.group
    s, n = group.state, group.spec.n_dof
    if group.spec.links:  # which hold back, too
        at = flight.place_of("sets")
        for i in flight.each(n):
            rest = Cell(group.full(0.0))
            for j in flight.each(n):
                own = (1.0 - group.prop("hardening", j)) * s["slip", j]
                rest.now = fma(flight.number(at + (i * n + j)), own, rest.now)
            s["set", i] = rest.now
        return
    for _, floors in group.each_building():
        total = None
        for i in floors:
            own = (1.0 - group.prop("hardening", i)) * s["slip", i]
            total = own if total is None else total + own
            s["set", i] = total


def _vector(flight: Any, at: Any) -> Any:
    return load(flight.trace, flight.tables, at, flight.lanes)


def shift(flight: Any, lane: Any) -> None:
    """Find what the set of a scenario adds to all that is watched; total accelerations do not know it."""
    layout, group, rows = flight.layout, flight.group, flight.rows
    s, lanes = group.state, flight.lanes
    sums = [Cell(flight.times.full(0.0)) for _ in range(layout.wide_watched // lanes)]
    tables = (("modal", "across"), ("modal_pu", "across_rate"))
    for to_modes, to_watched in tables if layout.coupled else tables[:1]:
        at, unit = flight.place_of(to_modes), 1.0
        if to_watched == "across_rate":  # of rates times the step
            unit = flight.number(flight.place_of("step"))
        modes = [Cell(flight.times.full(0.0)) for _ in range(layout.wide_modes // lanes)]
        for i in flight.each(layout.modes, len(modes)):
            x = s.lane(s.first["set"] + i, lane)
            for part, total in enumerate(modes):
                total.now = fma(_vector(flight, at + (i * layout.wide_modes + part * lanes)), x, total.now)
        for part, total in enumerate(modes):
            rows["amplitude", part] = total.now if to_watched == "across" else unit * total.now
        at = flight.place_of(to_watched)
        for m in flight.each(layout.modes, len(sums)):
            q = rows.number("amplitude", m)
            for part, total in enumerate(sums):
                total.now = fma(_vector(flight, at + (m * layout.wide_watched + part * lanes)), q, total.now)
    shaken = flight.place_of("shaken")
    for part, total in enumerate(sums):
        rows["shift", part] = where(_vector(flight, shaken + part * lanes) > 0.5, 0.0, total.now)


def _storeys(flight: Any, low: int, high: int, group: Group) -> Iterator[tuple[Any, Any]]:
    """Go through what is watched of storeys: its number, and the storey."""
    table, n = Lookup(group.trace, [each.storey for each in flight.layout.watched[low:high]]), high - low
    for k in count_to(n, group.trace) if n > 4 else range(n):
        yield k + low, table[k]


def take_onsets(flight: Any, lane: Any, low: int, high: int) -> None:
    """Drifts at which storeys begin to yield, to either side."""
    group, w = flight.group, flight.rows
    for q, i in _storeys(flight, low, high, group):
        p, dy = group.state["slip", i], group.prop("yield_drift", i)
        w.put_number("high", q, lane_of(p + dy, lane))
        w.put_number("low", q, lane_of(p - dy, lane))


def _reached(group: Group, i: Any, lane: Any) -> tuple[Any, Any, Any]:
    """Stiffness of a storey, and the drifts at which its shear is the largest so far."""
    s, k = group.state, group.prop("k", i)
    k = k + group.prop("geometric", i) if group.spec.p_delta else k  # of the shear that it bears
    middle, reach = hardened(group, i)[1] / k * s["slip", i], s["shear", i] / k
    return k, lane_of(middle - reach, lane), lane_of(middle + reach, lane)


def take_shears(flight: Any, lane: Any, low: int, high: int) -> None:
    """Drifts at which storeys have the largest shears so far."""
    for q, i in _storeys(flight, low, high, flight.group):
        _, least, most = _reached(flight.group, i, lane)
        flight.rows.put_number("high", q, most)
        flight.rows.put_number("low", q, least)


def keep_shears(flight: Any, lane: Any, low: int, high: int) -> None:
    """Keep the shears of drifts that went farther."""
    group, w = flight.group, flight.rows
    s = group.state
    for q, i in _storeys(flight, low, high, group):
        k, least, most = _reached(group, i, lane)
        more = maximum(w.number("high", q) - most, least - w.number("low", q))
        grown = lane_of(group.full(k), lane) * more
        row = s.first["shear"] + i
        s.put_lane(row, lane, s.lane(row, lane) + grown)
