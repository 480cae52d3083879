"""The row of buildings: its equation of motion, its energies, its accelerations.

Displacements U of floors are those relative to the free field: with the displacement u and rotation theta of a rigid
base and the elevation h of a floor, U = u + h theta + (the building's own), so that masses stay apart. A storey's drift
is U_i - U_(i-1) - (h_i - h_(i-1)) theta, with u in place of U_0; Rayleigh's a m acts on w_i = U_i - u - h_i theta. Both
are stretches of elements, whose forces push each end by its share: all that is here is one loop over them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import reduce
from operator import add
from typing import Any

from pounding_sweep.kernel.group import Contact, Element, Group, Part, signed_sum
from pounding_sweep.kernel.types import ByFloor, Forces, Index, Instant, Lanes
from pounding_sweep.lanes import fma


def accelerations(
    group: Group,
    part: Part,
    x: Sequence[Lanes],
    y: Sequence[Lanes],
    ground: Instant | None,
    push: Sequence[Forces],
    constant: bool = True,
    loads: bool = False,
) -> list[Lanes]:
    """Accelerations of displacements x and velocities y, under forces `push` at each place; times masses if `loads`.

    They are relative to the ground, whose acceleration is `ground`; None: total ones.
    """
    forces: list[list[tuple[int, Lanes]]] = [[] for _ in part.dofs]
    w = list(x)  # x + beta y, of whose stretch the force of a storey is a share; a single one has no beta
    for b, places, _, elements in part.blocks:
        if len(places) > 1 and any(element.is_plain for element in elements):
            for p in places:
                w[p] = fma(group.prop("beta", b), y[p], x[p])
        for element in elements:
            for p, sign, force in element.pushes(x, y, w, constant):
                forces[p].append((sign, force))
    result: list[Lanes] = [None] * len(part.dofs)
    for b, places, on_ground, _ in part.blocks:
        for p in places:
            i, net = part.dofs[p], signed_sum([*forces[p], *(push[p] if push else ())])
            drag = None if ground is None or group.rocks(i) else ground(b)
            if on_ground:
                alpha = group.prop("alpha", b)
                drag = alpha * y[p] if drag is None else fma(alpha, y[p], drag)
            if drag is None:
                result[p] = net if loads else group.prop("im", i) * net
            else:
                result[p] = fma(-group.prop("m", i), drag, net) if loads else fma(group.prop("im", i), net, -drag)
    return result


class Pushes:
    """Forces of contacts and links: of a long row summed up in rows of its state, else one by one."""

    def __init__(self, group: Group, rows: bool | None = None) -> None:
        self._group, self._rows = group, group.looped if rows is None else rows
        self._signed: dict[Index, list[tuple[int, Lanes]]] = {}
        for i in group.indices(group.spec.n_dof) if self._rows else ():
            group.state["push", i] = 0.0

    def add(self, element: Element, force: Lanes) -> None:
        """Add the force of an element."""
        for i, sign, part in element.on_ends(force):
            if self._rows:
                self._group.state["push", i] = signed_sum([(1, self._group.state["push", i]), (sign, part)])
            else:
                self._signed.setdefault(i, []).append((sign, part))

    def add_links(self, x: ByFloor, y: ByFloor) -> None:
        """Add the forces of all links, of displacements and velocities by floor or by name."""
        for link in self._group.iter_links(straight=not self._rows):
            self.add(link, link.force(x, y))

    def on(self, dofs: Iterable[Index]) -> Sequence[Forces]:
        """Return the forces on each of some degrees of freedom; none at all where there is no force."""
        if self._rows:
            return [[(1, self._group.state["push", i])] for i in dofs]
        return [self._signed.get(i, ()) for i in dofs] if self._signed else ()


def powers(group: Group, part: Part, y: Sequence[Lanes], ground: Instant) -> list[tuple[Lanes, Lanes]]:
    """Powers (kW) of the ground and of damping on each building, at the velocities y."""
    result = []
    for b, places, on_ground, elements in part.blocks:
        moving = [(group.prop("m", part.dofs[p]), y[p]) for p in places if not group.rocks(part.dofs[p])]
        momentum = reduce(add, [m * v for m, v in moving])
        damped = [element.lost(y) for element in elements]
        if on_ground:
            damped.insert(0, group.prop("alpha", b) * reduce(add, [m * v * v for m, v in moving]))
        result.append((-ground(b) * momentum, reduce(add, damped)))
    return result


def kinetic(group: Group, b: Index, floors: list[Index]) -> Lanes:
    """v'Mv/2 of a building."""
    moving = group.part((b, floors)).dofs
    return reduce(add, [0.5 * group.prop("m", i) * group.state["v", i] * group.state["v", i] for i in moving])


def strain(group: Group, b: Index, floors: list[Index], about_rest: bool = False) -> Lanes:
    """u'Ku/2 of a building, of storeys that yield of their elastic parts, or about the drifts at which they rest."""
    dofs, (block,) = group.part((b, floors))
    u = [group.state["u", i] for i in dofs]
    return reduce(add, [element.stored(u, about_rest) for element in block.elements])


def iter_powers(contact: Contact, force: Lanes, y: ByFloor) -> Iterator[tuple[Index, Lanes]]:
    """Go through the buildings that a contact presses, and what each gives to it: power (kW) of a force (kN)."""
    # `y` are the floors' velocities, or the name of their rows; a building may come up more than once
    for floor, sign, pushed in contact.on_ends(force):
        yield contact.group.home_of(floor)[2], (-pushed if sign > 0 else pushed) * contact.group.floor(y, floor)


def put_accelerations(
    group: Group, name: str, x: ByFloor, y: ByFloor, at: Instant | None = None, rates: bool = False
) -> None:
    """Find accelerations of displacements x and velocities y without contacts, as `accelerations` does, in rows."""
    # x and y are names of rows or functions of floors; of `rates`, the accelerations' rates are found
    for part in group.iter_parts():
        xs, ys = ([group.floor(values, i) for i in part.dofs] for values in (x, y))
        for i, a in zip(part.dofs, accelerations(group, part, xs, ys, at, (), not rates), strict=True):
            group.state[name, i] = a
    for link in group.iter_links():  # the ground's acceleration is the same on both sides
        _accelerate(group, name, link, link.force(x, y))


def add_forces(group: Group, name: str, forces: Any) -> None:
    """Add what contact forces (or their rates), of rows or a function, do to accelerations (or theirs) in rows."""
    for contact in group.iter_contacts():
        _accelerate(group, name, contact, forces(contact) if callable(forces) else getattr(contact, forces))


def _accelerate(group: Group, name: str, element: Element, force: Lanes) -> None:
    """Add what the force of an element does to accelerations in rows."""
    for i, sign, part in element.on_ends(force):
        group.state[name, i] = signed_sum([(1, group.state[name, i]), (sign, group.prop("im", i) * part)])
