"""Links between neighbours' floors: springs and dashpots that pull as well as push.

    F = k d + c d',    d = u_left - u_right

Floors x and their rates y are sequences of all floors, or names of rows.
"""

from __future__ import annotations

from pounding_sweep.kernel.group import BENDS, Group, Spring
from pounding_sweep.kernel.types import ByFloor, Lanes
from pounding_sweep.lanes import fma, maximum, size, where

#: Shortest step (s) over which a rate is a difference: one that no lane takes.
_LEAST_STEP = 1e-15


def declare_rows(group: Group) -> None:
    """Declare the sums over the stages of a step."""
    if "links" in group.requested:
        group.declare(group.spec.n_buildings, "dlink")
        group.declare(len(group.spec.links), "dlink_loss")


def clear_powers(group: Group) -> None:
    """Let the sums over a step be none."""
    for name, n in (("dlink", group.spec.n_buildings), ("dlink_loss", len(group.spec.links))):
        for k in group.indices(n):
            group.state[name, k] = 0.0


def add_powers(group: Group, x: ByFloor, y: ByFloor, weight: Lanes, first: bool) -> None:
    """Add to the sums over a step what buildings give to links and what their dashpots lose, at one state."""
    s = group.state
    if first:
        clear_powers(group)
    for link in group.iter_links():
        for floor, sign, pull in link.on_ends(weight * link.force(x, y)):
            b, v = group.home_of(floor)[2], group.floor(y, floor)
            s["dlink", b] += (-1.0 if sign > 0 else 1.0) * pull * v
        s["dlink_loss", link.index] += weight * link.lost(y)


def record(group: Group, h6: Lanes) -> None:
    """Add energies of a step, from those sums, which are of six."""
    s = group.state
    for b in group.indices(group.spec.n_buildings):
        s["e_link", b] = fma(h6, s["dlink", b], s["e_link", b])
    for link in group.iter_links():
        link.link_lost = fma(h6, link.dlink_loss, link.link_lost)


# peaks ---------------------------------------------------------------------------------------------------------------


def motion(link: Spring, name: str) -> Lanes:
    """Force of a link at an end of the step (``u``, ``u0``), its rate (``v``, ``v0``), or what its polynomial has."""
    group = link.group
    if name.startswith("u"):
        return link.force(name, name.replace("u", "v"))
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
        pull = link.stiffness * link.between(name)
        for row, factor in factors.items():
            pull = fma(link.damping * factor, link.between(row), pull)
        return pull
    d0, d1, v0, v1 = (link.between(row) for row in ("u0", "u", "v0", "v"))
    h = group.full(group.state["h"])
    per = 1.0 / maximum(h, _LEAST_STEP)
    chord = 6.0 * (d1 - d0) * per
    bend = chord - 4.0 * v0 - 2.0 * v1 if name == "v0" else 2.0 * v0 + 4.0 * v1 - chord
    # in a short sub-step the difference is one of rounding: velocities go straight
    far = link.between("u", rounding=True)
    moves = h * (size(v0) + size(v1)) > group.limit.moved * far
    bend = where(moves, bend, v1 - v0)
    return fma(link.damping, bend * per, link.stiffness * (v0 if name == "v0" else v1))


def sample(group: Group) -> None:
    """Take the forces at the end of a step: cubics on both sides of it have two rates there, and may miss a peak."""
    for name in ("u0", "u") if group.spec.impulsive else ("u",):  # those just after a jump, too
        for link in group.iter_links():
            link.link_force = maximum(link.link_force, size(motion(link, name)))
