"""Links between neighbours' floors: springs and dashpots that pull as well as push.

    F = k d + c d',    d = u_left - u_right

Floors x and their rates y are sequences of all floors, or names of rows.
"""

from __future__ import annotations

from typing import Any

from pounding_sweep.kernel.group import BENDS, Group
from pounding_sweep.lanes import fma, maximum, size, where

#: Shortest step (s) over which a rate is a difference: one that no lane takes.
_LEAST_STEP = 1e-15


def _across(group: Group, ends: tuple[Any, Any], x: Any) -> Any:
    """Left floor less right one."""
    left, right = ends
    return group.floor(x, left) - group.floor(x, right)


def force(group: Group, j: Any, ends: tuple[Any, Any], x: Any, y: Any) -> Any:
    """Force of link j (kN)."""
    return fma(group.prop("link_c", j), _across(group, ends, y), group.prop("link_k", j) * _across(group, ends, x))


def accelerate(group: Group, name: str, x: Any, y: Any) -> None:
    """Add what links do to accelerations, or to their rates where x and y are rates."""
    s = group.state
    for j, (left, right) in group.iter_links():
        pull = force(group, j, (left, right), x, y)
        s[name, left] -= group.prop("im", left) * pull
        s[name, right] += group.prop("im", right) * pull


# energies ------------------------------------------------------------------------------------------------------------


def clear_powers(group: Group) -> None:
    """Let the sums over a step be none."""
    for name, n in (("dlink", group.spec.n_buildings), ("dlink_loss", len(group.spec.links))):
        for k in group.indices(n):
            group.state[name, k] = 0.0


def add_powers(group: Group, x: Any, y: Any, weight: Any, first: bool) -> None:
    """Add to the sums over a step what buildings give to links and what their dashpots lose, at one state."""
    s = group.state
    if first:
        clear_powers(group)
    for j, (left, right) in group.iter_links():
        pull, rate = weight * force(group, j, (left, right), x, y), _across(group, (left, right), y)
        for floor, sign in ((left, 1.0), (right, -1.0)):
            b, v = group.home_of(floor)[2], group.floor(y, floor)
            s["dlink", b] += sign * pull * v
        s["dlink_loss", j] += weight * group.prop("link_c", j) * (rate * rate)


def record(group: Group, h6: Any) -> None:
    """Add energies of a step, from those sums, which are of six."""
    s = group.state
    for b in group.indices(group.spec.n_buildings):
        s["e_link", b] = fma(h6, s["dlink", b], s["e_link", b])
    for j, _ in group.iter_links():
        s["link_lost", j] = fma(h6, s["dlink_loss", j], s["link_lost", j])


def conclude(group: Group) -> None:
    """Energies that springs of links hold at the end."""
    for j, ends in group.iter_links():
        d = _across(group, ends, "u")
        group.state["link_held", j] = 0.5 * group.prop("link_k", j) * (d * d)


# peaks ---------------------------------------------------------------------------------------------------------------


def motion(group: Group, j: Any, ends: tuple[Any, Any], name: str) -> Any:
    """Force of a link at an end of the step (``u``, ``u0``), its rate (``v``, ``v0``), or what its polynomial has."""
    if name.startswith("u"):
        return force(group, j, ends, name, name.replace("u", "v"))
    if group.spec.staged:  # d is a quintic, in whose own polynomial the force has what lies in the row of that of d
        per = 1.0 / maximum(group.full(group.state["h"]), _LEAST_STEP)
        factors = {
            "v": dict(zip(("a0", *BENDS), (1.0, 6.0, 12.0, 20.0), strict=True)),
            "v0": {"a0": 1.0},
            "a0": {"c3": 6.0 * per},
            "c3": {"c4": 4.0 * per},
            "c4": {"c5": 5.0 * per},
            "c5": {},
        }[name]
        pull = group.prop("link_k", j) * _across(group, ends, name)
        for row, factor in factors.items():
            pull = fma(group.prop("link_c", j) * factor, _across(group, ends, row), pull)
        return pull
    d0, d1, v0, v1 = (_across(group, ends, row) for row in ("u0", "u", "v0", "v"))
    h = group.full(group.state["h"])
    per = 1.0 / maximum(h, _LEAST_STEP)
    chord = 6.0 * (d1 - d0) * per
    bend = chord - 4.0 * v0 - 2.0 * v1 if name == "v0" else 2.0 * v0 + 4.0 * v1 - chord
    # in a short sub-step the difference is one of rounding: velocities go straight
    far = size(group.state["u", ends[0]]) + size(group.state["u", ends[1]])
    moves = h * (size(v0) + size(v1)) > group.limit.moved * far
    bend = where(moves, bend, v1 - v0)
    return fma(group.prop("link_c", j), bend * per, group.prop("link_k", j) * (v0 if name == "v0" else v1))


def sample(group: Group) -> None:
    """Take the forces at the end of a step: cubics on both sides of it have two rates there, and may miss a peak."""
    s = group.state
    for name in ("u0", "u") if group.spec.impulsive else ("u",):  # those just after a jump, too
        for j, ends in group.iter_links():
            s["link_force", j] = maximum(s["link_force", j], size(motion(group, j, ends, name)))
