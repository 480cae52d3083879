"""The row of buildings: its equation of motion, its energies, its accelerations.

Displacements U of floors are those relative to the free field: with the displacement u and rotation theta of a rigid
base and the elevation h of a floor, U = u + h theta + (the building's own), so that masses stay apart. A storey's drift
is U_i - U_(i-1) - (h_i - h_(i-1)) theta, with u in place of U_0; Rayleigh's a m acts on w_i = U_i - u - h_i theta:

    m_f u''     = V_1 + a sum m_i w_i' - K_h u - c_h u' - m_f g''
    I   theta'' = sum V_i (h_i - h_(i-1)) + a sum m_i h_i w_i' - K_theta theta - c_theta theta'
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import reduce
from operator import add
from typing import Any

from pounding_sweep.kernel import links
from pounding_sweep.kernel.group import Contact, Group, Storey, part_of
from pounding_sweep.lanes import fma

#: Some buildings, and their floors.
Part = Sequence[tuple[Any, Sequence[Any]]]


def storey_forces(group: Group, part: Part, x: Sequence[Any], y: Sequence[Any], constant: bool = True) -> list[Any]:
    """Storey forces f = k (w_i - w_(i-1)), w = x + beta y, by floors of the part; of rates without their `constant`."""
    forces, at, smooth = [], 0, dict(group.spec.smooth) if group.spec.series else {}
    for b, floors in part:
        places = range(at, at + len(floors))
        # storeys have dampers of their own, or drifts that a foundation's rocking is part of
        if any(map(group.has_separate_damper, floors)) or group.spec.base_of(floors[0]) is not None:
            for i, p in zip(floors, places, strict=True):
                drift, rate = (_drift(group, i, values, p, at) for values in (x, y))
                k, beta = group.prop("k", i), group.prop("beta", b)
                if not group.has_separate_damper(i):
                    forces.append(k * fma(beta, rate, drift))
                    continue
                elastic = k * drift
                if group.yields(i):
                    kt, ct = group.state["kt", i], group.state["ct", i]
                    elastic = fma(kt, drift, ct) if constant or (smooth and i in smooth) else kt * drift
                coefficient = beta * damper_stiffness(group, i)
                coefficient = coefficient + group.prop("dashpot", i) if group.dashed(i) else coefficient
                forces.append(fma(coefficient, rate, elastic))
            at += len(floors)
            continue
        w = [fma(group.prop("beta", b), y[p], x[p]) if len(floors) > 1 else x[p] for p in places]
        forces += [group.prop("k", i) * (w[s] - w[s - 1] if s else w[s]) for s, i in enumerate(floors)]
        at += len(floors)
    return forces


def _drift(group: Group, i: Any, x: Sequence[Any], p: Any, first: Any) -> Any:
    """Drift below floor i, whose value is number p of `x`, that of its building's lowest floor number `first`."""
    if group.spec.base_of(i) is not None:  # values are those of the whole row
        return group.storey(i).drift(x)
    return x[p] if p == first else x[p] - x[p - 1]


def damper_stiffness(group: Group, i: Any) -> Any:
    """Stiffness that the damper of a storey follows."""
    return group.state["kd", i] if group.spec.tangent and group.yields(i) else group.prop("k", i)


def accelerations(
    group: Group,
    part: Part,
    x: Sequence[Any],
    y: Sequence[Any],
    ground: Any,
    push: Sequence[Sequence[tuple[str, Any]]],
    constant: bool = True,
    loads: bool = False,
) -> list[Any]:
    """Accelerations of displacements x and velocities y, under forces `push` on each floor; times masses if `loads`.

    They are relative to the ground, whose acceleration is `ground`; None: total ones.
    """
    result: list[Any] = []
    f = storey_forces(group, part, x, y, constant)
    for b, floors in part:
        for s, i in enumerate(floors):
            p = len(result)
            net = -f[p] if s == len(floors) - 1 else f[p + 1] - f[p]
            for sign, force in push[p] if push else ():
                net = net - force if sign == "-" else net + force
            alpha, moves = group.prop("alpha", b), group.deformation(i, y, p)
            drag = alpha * moves if ground is None else fma(alpha, moves, ground)
            result.append(fma(-group.prop("m", i), drag, net) if loads else fma(group.prop("im", i), net, -drag))
    for b in group.spec.foundations:  # sway and rocking of each base, from the state of the whole row
        base: Any = group.spec.base(b)
        sway, moment = f[group.spec.home(b)], None
        for i in group.building_floors[b]:
            drag = group.prop("m", i) * (group.prop("alpha", b) * group.deformation(i, y, i))
            sway = sway + drag
            lever = fma(group.prop("elevation", i), drag, group.prop("height", i) * f[i])
            moment = lever if moment is None else moment + lever
        for i, load in zip(base, (sway, moment), strict=True):
            resistance = fma(group.prop("dashpot", i), y[i], group.prop("k", i) * x[i])
            a = group.prop("im", i) * (load - resistance)
            a = a if ground is None or group.rocks(i) else a - ground
            result.append(group.prop("m", i) * a if loads else a)
    return result


class Pushes:
    """Forces of contacts and links on floors: of a long row summed up in rows of its state, else one by one."""

    def __init__(self, group: Group, rows: bool | None = None) -> None:
        self._group, self._rows = group, group.looped if rows is None else rows
        self._signed: dict[Any, list[tuple[str, Any]]] = {}
        for i in group.indices(group.spec.n_dof) if self._rows else ():
            group.state["push", i] = 0.0

    def add(self, floor: Any, sign: str, force: Any) -> None:
        """Add a force on a floor, to the right if positive."""
        if not self._rows:
            self._signed.setdefault(floor, []).append((sign, force))
            return
        before = self._group.state["push", floor]
        self._group.state["push", floor] = before - force if sign == "-" else before + force

    def add_contact(self, contact: Contact, force: Any) -> None:
        """Add the force of a contact on its floors."""
        for floor, sign, share in contact.ends():
            self.add(floor, sign, part_of(force, share))

    def add_links(self, x: Any, y: Any) -> None:
        """Add the forces of all links, of displacements and velocities by floor or by name."""
        for j, ends in self._group.iter_links() if self._rows else enumerate(self._group.spec.links):
            force = links.force(self._group, j, ends, x, y)
            for floor, sign in zip(ends, "-+", strict=True):
                self.add(floor, sign, force)

    def on(self, floors: Iterable[Any]) -> Sequence[Sequence[tuple[str, Any]]]:
        """Return the signed forces on each of some floors; none at all where there is no force."""
        if self._rows:
            return [[("+", self._group.state["push", i])] for i in floors]
        return [self._signed.get(i, ()) for i in floors] if self._signed else ()


def powers(group: Group, part: Part, y: Sequence[Any], ground: Any) -> list[tuple[Any, Any]]:
    """Powers (kW) of the ground and of damping on each building, at the velocities y."""
    result, at = [], 0
    for b, floors in part:
        v = y[at : at + len(floors)]
        at += len(floors)
        momentum = reduce(add, [group.prop("m", i) * w for i, w in zip(floors, v, strict=True)])
        if (base := group.spec.base_of(floors[0])) is not None:
            momentum = fma(group.prop("m", base[0]), y[base[0]], momentum)
            v = [group.deformation(i, y, i) for i in floors]
        mass = reduce(add, [group.prop("m", i) * w * w for i, w in zip(floors, v, strict=True)])
        first = at - len(floors)
        drift = [_drift(group, i, y, p, first) for p, i in enumerate(floors, first)]
        stiff = reduce(add, [damper_stiffness(group, i) * dv * dv for i, dv in zip(floors, drift, strict=True)])
        gained, damped = -ground * momentum, group.prop("alpha", b) * mass + group.prop("beta", b) * stiff
        for i, dv in zip(floors, drift, strict=True):
            damped = fma(group.prop("dashpot", i), dv * dv, damped) if group.dashed(i) else damped
        for i in base or ():
            damped = fma(group.prop("dashpot", i), y[i] * y[i], damped)
        result.append((gained, damped))
    return result


def kinetic(group: Group, floors: Sequence[Any]) -> Any:
    """v'Mv/2 of a building."""
    all_of_it = (*floors, *(group.spec.base_of(floors[0]) or ()))
    return reduce(add, [0.5 * group.prop("m", i) * group.state["v", i] * group.state["v", i] for i in all_of_it])


def strain(group: Group, floors: Sequence[Any], about_rest: bool = False) -> Any:
    """u'Ku/2 of a building, of storeys that yield of their elastic parts, or about the drifts at which they rest."""
    terms, below, base = [], None, group.spec.base_of(floors[0])
    for i in floors:
        storey = Storey(group, i, below) if base is None else group.storey(i)
        below, drift = i, storey.drift()
        if group.yields(i) and about_rest:
            drift = drift - (1.0 - storey.hardening) * storey.slip
        if group.yields(i) and not about_rest:
            (hard, soft), z = storey.hardened, drift - storey.slip
            terms.append(0.5 * (hard * drift * drift + soft * z * z))
        else:
            terms.append(0.5 * storey.stiffness * drift * drift)
    terms += [0.5 * group.prop("k", i) * group.state["u", i] * group.state["u", i] for i in base or ()]
    return reduce(add, terms)


def iter_powers(contact: Contact, force: Any, y: Any) -> Iterator[tuple[Any, Any]]:
    """Go through the buildings that a contact presses, and what each gives to it: power (kW) of a force (kN)."""
    # `y` are the floors' velocities, or the name of their rows; a building may come up more than once
    for floor, side, share in contact.ends():
        pushed = part_of(force, share)
        yield contact.group.home_of(floor)[2], (pushed if side == "-" else -pushed) * contact.group.floor(y, floor)


def put_accelerations(group: Group, name: str, x: Any, y: Any, ground: Any = None, rates: bool = False) -> None:
    """Find accelerations of displacements x and velocities y without contacts, as `accelerations` does, in rows."""
    # x and y are names of rows or functions of floors; of `rates`, the accelerations' rates are found
    for part, moving in group.iter_parts():
        xs, ys = ([group.floor(values, i) for i in moving] for values in (x, y))
        for i, a in zip(moving, accelerations(group, part, xs, ys, ground, (), not rates), strict=True):
            group.state[name, i] = a
    if group.spec.links:  # the ground's acceleration is the same on both sides
        links.accelerate(group, name, x, y)


def add_forces(group: Group, name: str, forces: Any) -> None:
    """Add what contact forces (or their rates), of rows or a function, do to accelerations (or theirs) in rows."""
    s = group.state
    for contact in group.iter_contacts():
        force = forces(contact) if callable(forces) else getattr(contact, forces)
        for floor, sign, share in contact.ends():
            before = s[name, floor]
            change = group.prop("im", floor) * part_of(force, share)
            s[name, floor] = before - change if sign == "-" else before + change
