"""What is kept of the motion: extremes inside a step, energies, accelerations.

Peaks are the extremes of the cubic through value and rate at both ends of a step. A
trajectory only peaks in a step where its rate changes sign, so what turns in no lane is
left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import fma, maximum, minimum, size, when_any, where
from pounding_sweep.kernel.row import total_accelerations, transferred

#: Most that a cubic leaves its ends by, in its rates there times the step.
REACH = 4.0 / 27.0


def cubic_extreme(x0: Any, x1: Any, s0: Any, s1: Any) -> Any:
    """Extreme inside a step of a cubic with values x and rates s (times the step) at its ends, about where s turns."""
    t = where(s0 * s1 < 0.0, s0 / (s0 - s1), 0.0)
    b = -3.0 * (x0 - x1) - (2.0 * s0 + s1)
    return x0 + t * (s0 + t * (b + t * (2.0 * (x0 - x1) + (s0 + s1))))


@dataclass(frozen=True)
class Motion:
    """A motion whose extremes are kept.

    Attributes
    ----------
    most, least : (str, int)
        Rows of its largest and its smallest value; without a `least` one that of the largest.
    sized : bool
        It is its absolute value that counts.
    of : callable
        Takes it, or its rate, from what there is of each floor.
    """

    most: tuple[str, int]
    least: tuple[str, int] | None
    sized: bool
    of: Callable[[Sequence[Any]], Any]


class _Floors(Sequence[Any]):
    """A row of each floor, loaded where it is used."""

    def __init__(self, group: Group, name: str) -> None:
        self._group, self._name = group, name

    def __len__(self) -> int:
        return self._group.spec.n_dof

    def __getitem__(self, i: Any) -> Any:
        return self._group.state[self._name, i]


def _followed(group: Group) -> Iterator[Motion]:
    for reducer in group.reducers:
        if reducer.follows:
            yield from reducer.follows(group)


def turns(group: Group) -> None:
    """Take the extremes of the motion that lie inside the step just taken."""
    s = group.state
    h = s["h"]
    for motion in _followed(group):
        x0, x1, v0, v1 = (motion.of(_Floors(group, name)) for name in ("u0", "u", "v0", "v"))
        high, sized, least = s[motion.most], motion.sized, motion.least
        reach = REACH * h * (size(v0) + size(v1))
        above = (maximum(size(x0), size(x1)) if sized else maximum(x0, x1)) + reach - high
        if least is not None:
            above = maximum(above, s[least] - minimum(x0, x1) + reach)
        with when_any((v0 * v1 <= 0.0) & (above > 0.0)):
            p = cubic_extreme(x0, x1, h * v0, h * v1)
            if sized:
                s[motion.most] = maximum(high, maximum(size(p), maximum(size(x0), size(x1))))
            else:
                s[motion.most] = maximum(high, maximum(p, maximum(x0, x1)))
            if least is not None:
                s[least] = minimum(s[least], minimum(p, minimum(x0, x1)))


def samples(group: Group) -> None:
    """Take the motion at the present state."""
    s = group.state
    for motion in _followed(group):
        x = motion.of(_Floors(group, "u"))
        s[motion.most] = maximum(s[motion.most], size(x) if motion.sized else x)
        if motion.least is not None:
            s[motion.least] = minimum(s[motion.least], x)


def turning(group: Group) -> Any:
    """Return what is zero or less where some of the motion that is followed turns in the step just taken."""
    found = group.full(1.0)
    for motion in _followed(group):
        found = minimum(found, motion.of(_Floors(group, "v0")) * motion.of(_Floors(group, "v")))
    return found


def add_powers(group: Group, powers: list[tuple[Any, Any]], h6: Any) -> None:
    """Add energies over a step, from sums of powers over its stages."""
    s = group.state
    for b, (gained, lost) in enumerate(powers):
        s["e_in", b] = fma(h6, gained, s["e_in", b])
        s["e_damp", b] = fma(h6, lost, s["e_damp", b])


def largest_accelerations(group: Group, located: bool) -> None:
    """Take the total accelerations of all floors over the step just taken."""
    s, n = group.state, group.spec.n_dof
    held = range(len(group.contacts)) if group.touching else ()

    def end(u: str, v: str, force: str, slope: str, ground: str) -> tuple[list[Any], list[Any]]:
        x, y = group.floors(u), group.floors(v)
        total = total_accelerations(group, x, y, [s[force, j] for j in held])
        if not located:
            return total, []
        relative = [a - s[ground] for a in total]
        return total, total_accelerations(group, y, relative, [s[slope, j] for j in held])

    late, late_rate = end("u", "v", "f1", "q1", "g1")
    if not located:
        for i in range(n):
            s["acc", i] = maximum(s["acc", i], size(late[i]))
        return
    early, early_rate = end("u0", "v0", "f0", "q0", "g0")
    h = s["h"]
    for i in range(n):
        p = cubic_extreme(early[i], late[i], h * early_rate[i], h * late_rate[i])
        most = maximum(size(p), maximum(size(early[i]), size(late[i])))
        # of a lane that waits, forces may be of another instant
        s["acc", i] = maximum(s["acc", i], where(h > 0.0, most, 0.0))


def transfers(group: Group) -> None:
    """Take the transferred energies at the present state."""
    s = group.state
    for b in range(group.spec.n_buildings):
        e = transferred(group, b)
        s["tmax", b] = maximum(s["tmax", b], e)
        s["tmin", b] = minimum(s["tmin", b], e)
