"""Energies that buildings give to their contacts, in steps by series: integrals of powers that are polynomials.

A contact's force F and the velocity v of a floor it presses are series in the same time, and so is their product. What
a building has given changes by the integral of these, and has its extremes where their sum changes its sign.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pounding_sweep.kernel.forces import OPEN
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import (
    Cell,
    Lookup,
    Tracer,
    count_to,
    fma,
    maximum,
    minimum,
    real,
    size,
    when_any,
    where,
)
from pounding_sweep.kernel.roots import Series, newton
from pounding_sweep.kernel.row import each_given

#: Parts of a step, shorter beside its ends, at whose ends a power's sign is asked for.
PARTS = 16
#: Share of a step's mean power by which that at its ends may go against it unseen: its square is what is lost.
AGAINST = 1e-4
#: Room for what Gauss points miss of the integral of a power's size.
ROOM = 1.5


def begin(group: Group) -> None:
    """Let nothing be transferred in the step yet."""
    for name in ("gain", "swing", "early", "late"):
        for b in group.each(group.spec.n_buildings):
            group.state[name, b] = group.full(0.0)


def add(group: Group, j: Any, force: Any, weight: Any) -> None:
    """Add the powers of a contact at a Gauss point, at which floors have the velocities ``y``."""
    s = group.state
    for b, power in each_given(group, j, force, "y"):
        s["gain", b] = fma(weight, power, s["gain", b])
        s["swing", b] = fma(weight, size(power), s["swing", b])


def conclude(group: Group, force_of: Callable[[Group, Any], Series]) -> None:
    """Take the largest and smallest transfers of the step, whose Gauss points have been added."""
    s, nb = group.state, group.spec.n_buildings
    any_closed = Cell(group.lanes_where(False))
    for j in group.each_contact():
        closed = (s["mode", j] > OPEN) & (s["h"] > 0.0)
        any_closed.now = any_closed.now | closed
        with when_any(closed):
            series = force_of(group, j)
            for name, force, v in (("early", series.read(0), "v0"), ("late", series.value(s["fraction"]), "v")):
                held = where(closed, force, 0.0)
                for b, power in each_given(group, j, held, v):
                    s[name, b] = s[name, b] + power
    with when_any(any_closed.now):
        asks = Cell(group.lanes_where(False))
        for b in group.each(nb, straight=False):
            s["now", b] = s["now", b] + s["gain", b]
            s["tmax", b], s["tmin", b] = maximum(s["tmax", b], s["now", b]), minimum(s["tmin", b], s["now", b])
            asks.now = asks.now | _may_turn(group, b)
        with when_any(asks.now):
            _multiply(group, force_of)
            for b in group.each(nb, straight=False):
                turning = _may_turn(group, b)
                with when_any(turning):
                    _take_turns(group, b, turning)


def _may_turn(group: Group, b: Any) -> Any:
    """Lanes in which a transfer may have had an extreme of its own inside the step."""
    s = group.state
    gain, swing, high = s["gain", b], s["swing", b], s["now", b]
    ends = s["h"] * minimum(s["early", b] * gain, s["late", b] * gain)
    turns = (swing - size(gain) > group.limit.same_time * swing) | (ends < -AGAINST * gain * gain)
    reach = 0.5 * (ROOM * swing - gain)  # beyond the end, if all that goes one way came first
    return turns & ((high + reach > s["tmax", b]) | (high - (reach + gain) < s["tmin", b]))


def _multiply(group: Group, force_of: Callable[[Group, Any], Series]) -> None:
    """Find the series of the powers on buildings, in energies per step."""
    s, order = group.state, group.spec.series
    many = 2 * order - 1
    for k in count_to(group.spec.n_buildings * many, group.trace):
        s["power", k] = group.full(0.0)
    for j in group.each_contact():
        closed = s["mode", j] > OPEN
        with when_any(closed):
            series = force_of(group, j)
            for k in count_to(order, group.trace):
                force = where(closed, series.read(k), 0.0)
                for m in count_to(order, group.trace):
                    for b, power in each_given(group, j, force, _Rate(group, m)):
                        at = b * many + (k + m)
                        s["power", at] = s["power", at] + power


class _Rate:
    """One coefficient of all floors' velocities, by the time of a step."""

    def __init__(self, group: Group, k: Any) -> None:
        self._state, self._begin, self._factor = group.state, (k + 1) * group.spec.n_dof, real(k + 1)

    def __getitem__(self, i: Any) -> Any:
        return self._state["jet", i + self._begin] * self._factor


@dataclass(frozen=True)
class _Power(Series):
    """Power on a building: a series with as many coefficients as are gone through at run time."""

    trace: Tracer | None

    def value(self, t: Any) -> Any:
        """Its value."""
        return self.with_slope(t)[0]

    def with_slope(self, t: Any) -> tuple[Any, Any]:
        """Its value, and that of its derivative."""
        x, slope = Cell(self.read(self.order)), Cell(0.0 * t)
        for k in count_to(self.order, self.trace):
            slope.now = fma(t, slope.now, x.now)
            x.now = fma(t, x.now, self.read((self.order - 1) - k))
        return x.now, slope.now

    def integral(self, t: Any) -> Any:
        """Its integral from the start of the step on."""
        x = Cell(0.0 * t)
        for k in count_to(self.order + 1, self.trace):
            n = self.order - k
            x.now = fma(t, x.now, self.read(n) * (1.0 / real(n + 1)))
        return t * x.now


def _take_turns(group: Group, b: Any, lanes: Any) -> None:
    """Take the transfers of a building at which its power changes its sign, in some lanes."""
    s, end, many = group.state, group.state["fraction"], 2 * group.spec.series - 1
    power = _Power(lambda k: s["power", b * many + k], many - 1, group.trace)
    table = Lookup(group.trace, [*(0.5 - 0.5 * np.cos(np.pi * np.arange(1, PARTS + 1) / PARTS))])
    begun, low, at_low = s["now", b] - s["gain", b], Cell(0.0 * end), Cell(power.read(0))
    for q in count_to(PARTS, group.trace):
        a, high = low.now, end * table[q]
        x = power.value(high)
        rises = x > 0.0
        turns = lanes & ~(at_low.now * x > 0.0)
        with when_any(turns):
            t = newton(group, turns, a, high, power, where(rises, 1.0, group.full(-1.0)))
            there = begun + power.integral(t)
            s["tmax", b] = maximum(s["tmax", b], where(turns, there, s["tmax", b]))
            s["tmin", b] = minimum(s["tmin", b], where(turns, there, s["tmin", b]))
        low.now, at_low.now = high, x
