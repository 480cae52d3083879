"""Free vibration after the record: what it can still change of what is reported, and what it loses until it is at rest.

A row that vibrates freely loses energy: with E = v'Mv/2 + x'Kx/2 about the displacements at which it rests, no linear
function w'x of the displacements exceeds sqrt(2 E w'K^-1 w), and none of the velocities sqrt(2 E w'M^-1 w).
"""

from __future__ import annotations

from functools import reduce
from operator import add
from typing import Any

from pounding_sweep.kernel import collapse, forces, hysteresis
from pounding_sweep.kernel.group import Contact, Group, Matrices, Spring
from pounding_sweep.kernel.peaks import followed
from pounding_sweep.kernel.row import kinetic, strain
from pounding_sweep.kernel.types import Lanes, Truths
from pounding_sweep.lanes import size, sqrt, where

#: By what damping raises the bound of a total acceleration at most, squared: ratios of modes are below 0.86.
DAMPED = 4.0


def note_energies(group: Group, lanes: Truths) -> None:
    """Keep the energies that buildings hold at the last point of the record, in some lanes."""
    for b, floors in group.iter_buildings() if "energy" in group.requested else ():
        group.state.put(lanes, kinetic(group, b, floors), "e_kin", b)
        group.state.put(lanes, strain(group, b, floors), "e_strain", b)


def conclude(group: Group, lanes: Truths) -> None:
    """Let what buildings hold at the end go into their damping, if they come to rest, in some lanes."""
    s, settles = group.state, group.full(group.prop("settles") if group.spec.rest_is_bounded else 0.0)
    rests = s["rests"] > 0.0
    settles = where(rests & collapse.stands(group) if group.spec.falling else rests, settles, 0.0)
    for b, floors in group.iter_buildings() if "energy" in group.requested else ():
        moves = kinetic(group, b, floors)
        left = settles * (moves + strain(group, b, floors, about_rest=True))
        s.put(lanes, s["e_damp", b] + left, "e_damp", b)
        s.put(lanes, moves + strain(group, b, floors) - left, "e_held", b)
    for link in group.iter_links() if "links" in group.requested else ():
        link.link_held = link.stored("u")


def may_change(group: Group) -> Truths:
    """Lanes in which floors may still touch, storeys yield or fall, or a peak grow, the ground being at rest."""
    spec, s = group.spec, group.state
    twice, changes = group.cell(0.0), group.cell(False)
    for b, floors in group.iter_buildings():
        twice.now += 2.0 * (kinetic(group, b, floors) + strain(group, b, floors, about_rest=True))
    for link in group.iter_links():
        twice.now += 2.0 * link.stored("u")
    if spec.yielding:
        hysteresis.find_sets(group)
        changes.now = hysteresis.is_yielding(group)
    if group.touching:
        changes.now |= forces.is_closed(group)
    for contact in group.iter_contacts():
        middle = contact.between("set") if spec.yielding else 0.0
        changes.now |= middle + sqrt(twice.now * between(contact)) > contact.gap
    for spring in group.iter_springs():
        middle, reach = spring.storey.rest_drift, sqrt(twice.now / spring.stiffness)
        gauges: Any = hysteresis.gauges(spring)
        for gauge in gauges:
            changes.now |= (middle + reach > gauge.high) | (middle - reach < gauge.low)
    for motion in followed(group, straight=False):
        middle, reach = motion.of("set") if spec.yielding else 0.0, sqrt(twice.now * motion.soft())
        changes.now |= (size(middle) if motion.sized else middle) + reach > s[motion.most]
        if motion.least is not None:
            changes.now |= middle - reach < s[motion.least]
    for b, floors in group.iter_buildings() if "acceleration" in group.requested else ():
        for at, i in enumerate(floors):
            stiff = DAMPED * reduce(add, [group.prop("k", j) for j in floors[at : at + 2]])
            if "k" in spec.letters(b):
                stiff = DAMPED * Matrices(group, b, ()).against(at)
            for link in group.iter_links():
                stiff = stiff + DAMPED * link.stiffness
            changes.now |= group.prop("im", i) * sqrt(twice.now * stiff) > s["acc", i]
    return changes.now


def between(contact: Contact) -> Lanes:
    """Square of the most by which a contact closes, over twice the energy; struck columns as the floor above them."""
    return reduce(add, [contact.group.prop("flexibility", floor) for floor in contact.sides if floor is not None])


def of_link(link: Spring) -> Lanes:
    """Square of the largest force of a link, over twice the energy."""
    masses = reduce(add, [link.group.prop("im", i) for i, _, _ in link.ends])
    return link.group.full(link.stiffness + link.damping * link.damping * masses)
