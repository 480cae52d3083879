"""Explicit schemes: a step of a row follows from its accelerations at a few stages."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np

from pounding_sweep.kernel import hysteresis, impulse, links
from pounding_sweep.kernel.group import BENDS, Contact, Group, Part
from pounding_sweep.kernel.march import keep_start
from pounding_sweep.kernel.row import Pushes, accelerations, iter_powers, powers
from pounding_sweep.kernel.types import ByFloor, Index, Lanes
from pounding_sweep.lanes import any_lane, fma, once_if
from pounding_sweep.schemes.base import Scheme

#: Force of a contact (of displacements, velocities), these by floor or by the name of their rows.
Press = Callable[[Contact, ByFloor, ByFloor], Lanes]


class Explicit(Scheme):
    """A scheme of stages: a subclass says where they lie and what state follows from each."""

    #: largest stable product of step and frequency without damping; and with any, of step and frequency or damping
    #: rate, the larger of them
    undamped_radius: float
    damped_radius: float
    #: of each stage: the share of the step at which it takes the ground, and the weight of what acts there in the
    #: integrals of work, impulse and energies, in sixths of the step
    nodes: tuple[tuple[float, float], ...]

    @abstractmethod
    def after(self, stage: int, u: Lanes, v: Lanes, x: Lanes, a: Sequence[Lanes], h: Lanes) -> tuple[Lanes, Lanes]:
        """Displacement and velocity of a floor after a stage (from 1): of the next one, at last of the end."""
        # `u` and `v` are the start, `x` is the displacement of this stage, `a` the accelerations up to it

    def declare_rows(self, group: Group) -> None:
        """Declare those of stages, and of sums over them, where they do not stay in registers."""
        super().declare_rows(group)
        spec = group.spec
        group.declare(0 if spec.fused else spec.n_buildings, "din", "ddamp")
        if not spec.fused and (group.has_events or spec.links):
            group.declare(spec.n_moving, "x", "y", "push", *(f"s{k}" for k in range(len(self.nodes))))
            group.declare(len(spec.contacts), "dwork", "dimpulse")
        group.declare(spec.n_moving if spec.staged else 0, *BENDS, passing=True)

    def keep(self, group: Group, i: Index, a: Sequence[Lanes]) -> None:
        """Keep what a sub-step asks of the accelerations of floor i in its stages."""
        group.state["a0", i] = a[0]

    def stability_limit(self, w2: np.ndarray, rate: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        """By the radii."""
        # an overdamped mode has no frequency: its rate is at most that of the dampers, where they are largest
        fastest = np.maximum(np.sqrt(w2), rate)
        return np.where(rate > 0.0, self.damped_radius, self.undamped_radius) / fastest

    def step(
        self, group: Group, h: Lanes, part: Part | None = None, press: Press | None = None, joins: bool = False
    ) -> Any:
        """Step stage by stage from ``u0`` and ``v0`` to ``u`` and ``v``; returns where these lie, and sums over stages.

        Of a long row in contact (`part`: None) they lie in rows of state. Else they are values by place in the part,
        whose ``u0`` and ``v0`` are those of the state.
        """
        # Sums are of powers (``din``, ``ddamp``), works, impulses and energies given (``gain``); floors that rest on
        # each other are given one acceleration if `joins`.
        s, requested, spec = group.state, group.requested, group.spec
        grounds = {place: group.ground.at(float(place)) for place, _ in self.nodes}
        rows, flow = part is None, hysteresis.Flow(group) if spec.flowing else None
        floors = [] if part is None else part.dofs
        m: Any = s if rows else {(name, p): s[name, i] for p, i in enumerate(floors) for name in ("u0", "v0")}

        def every() -> Iterable[Index]:
            return group.indices(spec.n_dof) if rows else range(len(floors))

        for i in every():
            m["x", i], m["y", i] = m["u0", i], m["v0", i]
        for b in group.indices(spec.n_buildings) if rows and "transfer" in requested and group.touching else ():
            s["gain", b] = 0.0
        for number, (place, weight) in enumerate(self.nodes, 1):
            now, ground = f"s{number - 1}", grounds[place]
            x, y = ("x", "y") if rows else ([m[name, i] for i in every()] for name in "xy")
            push = Pushes(group, rows)
            if flow is not None:
                flow.set_stage(x, y, weight)

            def add(name: str, k: Index, value: Lanes, number: int = number, weight: float = weight) -> None:
                value = weight * value
                m[name, k] = value if number == 1 else m[name, k] + value

            def count(contact: Contact, force: Lanes, y: ByFloor = y, weight: float = weight, add: Any = add) -> None:
                if "impulse" in requested:
                    add("dimpulse", contact.index, force)
                for b, power in iter_powers(contact, force, y) if "transfer" in requested else ():
                    has_gain = rows or ("gain", b) in m
                    m["gain", b] = fma(weight, power, m["gain", b]) if has_gain else weight * power

            for contact in group.iter_contacts(straight=True) if press is not None else ():
                assert press is not None
                force = press(contact, x, y)
                push.add(contact, force)
                if "work" in requested:
                    add("dwork", contact.index, force * contact.between(y))
                count(contact, force)
            push.add_links(x, y)
            if "links" in requested:
                links.add_powers(group, x, y, weight, number == 1)
            for piece in [part] if part is not None else group.iter_parts():
                moving = piece.dofs if rows else every()
                xs, ys = ([m[name, i] for i in moving] for name in "xy")
                for i, a in zip(moving, accelerations(group, piece, xs, ys, ground, push.on(moving)), strict=True):
                    m[now, i] = a
                for k, (gained, damped) in enumerate(powers(group, piece, ys, ground)) if "energy" in requested else ():
                    add("din", piece.blocks[0].b if rows else k, gained)
                    add("ddamp", piece.blocks[0].b if rows else k, damped)
            if joins:
                impulse.equalise_rows(group, now, memory=m)
                for contact in group.iter_contacts(straight=True):
                    count(contact, m["force", contact.index])
            names = ("x", "y") if number < len(self.nodes) else ("u", "v")
            for i in every():
                a = [m[f"s{k}", i] for k in range(number)]
                moved = self.after(number, m["u0", i], m["v0", i], m["x", i], a, h)
                m[names[0], i], m[names[1], i] = moved
            if flow is not None:
                flow.advance(self.after, number, h)
        if flow is not None:
            flow.store_end()
            m |= {("travel", i): x for i, x in flow.dissipated.items()}
        return m

    def flight(self, group: Group, h: Lanes) -> Callable[[], None]:
        """Take a step of all lanes without contact."""
        if not group.looped or group.spec.links:  # the row moves as one
            return self._take(group, h)
        s = group.state
        for b, floors in group.iter_buildings():
            for i in floors:
                s["u0", i], s["v0", i] = s["u", i], s["v", i]
            m = self.step(group, h, group.part((b, floors)))
            for p, i in enumerate(floors):
                s["u", i], s["v", i] = m["u", p], m["v", p]
            for name in ("din", "ddamp") if "energy" in group.requested else ():
                s[name, b] = m[name, 0]
        return partial(_add_sums, group, s, touching=False)

    def plain(self, group: Group, h: Lanes) -> Callable[[], None]:
        """Take a step of all lanes whose contacts follow from the present state alone."""

        def press(contact: Contact, x: ByFloor, y: ByFloor) -> Lanes:
            d, law = contact.between(x) - contact.gap, contact.law
            return law.memoryless(contact.stiffness, contact.c, contact.fastest, d, contact.between(y))

        return self._take(group, h, press)

    def _take(self, group: Group, h: Lanes, press: Press | None = None) -> Callable[[], None]:
        """Take a step of the whole row."""
        keep_start(group)
        m = self.step(group, h, _row(group), press)
        _put(group, m)
        return partial(_add_sums, group, m, touching=press is not None)

    def trial(self, group: Group) -> Callable[[], None]:
        """Try a sub-step of every lane's own length, modes frozen."""
        s = group.state

        def read(contact: Contact) -> tuple[Lanes, Lanes, Lanes]:
            return contact.k_active, contact.c_active, contact.gap

        # of a short row once for all stages
        constants = {} if group.looped else {c.index: read(c) for c in group.iter_contacts(straight=True)}
        presses = {j: any_lane(~(k == 0.0) | ~(c == 0.0)) for j, (k, c, _) in constants.items()}

        def press(contact: Contact, x: ByFloor, y: ByFloor) -> Lanes:
            force, (k, c, gap) = group.cell(0.0), constants[contact.index] if constants else read(contact)
            for _ in once_if(presses[contact.index]) if constants else (None,):
                d, v = contact.between(x) - gap, contact.between(y)
                force.now = contact.law.pressing(k, c, d, v)
            return force.now

        joins = group.spec.impulsive and group.touching
        m = self.step(group, s["h"], _row(group), press if group.touching and not joins else None, joins)
        for i in group.indices(group.spec.n_moving):
            self.keep(group, i, [m[f"s{k}", i] for k in range(len(self.nodes))])
        _put(group, m)
        return partial(_add_sums, group, m, touching=group.touching)


def _row(group: Group) -> Part | None:
    """All buildings of a short row, and their floors; None of a long one."""
    return None if group.looped else group.part(*enumerate(group.spec.floors))


def _put(group: Group, m: Any) -> None:
    """Write the end of a step of a short row."""
    for i in range(group.spec.n_moving) if m is not group.state else ():
        group.state["u", i], group.state["v", i] = m["u", i], m["v", i]


def _add_sums(group: Group, m: Any, touching: bool) -> None:
    """Add energies, works and impulses of a step, once it is taken, by its sums `m`."""
    s, requested = group.state, group.requested
    rows, h6 = m is s, s["h"] * (1.0 / 6.0)
    sums = [("energy", "e_in", "din"), ("energy", "e_damp", "ddamp"), ("work", "work", "dwork")]
    for wants, name, of in (*sums, ("impulse", "impulse", "dimpulse")):
        by_building = wants == "energy"
        if wants not in requested or not (by_building or touching) or (wants == "work" and group.spec.impulsive):
            continue
        for k in group.indices(group.spec.n_buildings if by_building else len(group.contacts)):
            s[name, k] = fma(h6, m[of, k], s[name, k])
    if "links" in requested:
        links.record(group, h6)
    for b in group.indices(group.spec.n_buildings) if "transfer" in requested and touching else ():
        if rows or ("gain", b) in m:
            s["gain", b] = h6 * m["gain", b]
    for spring in hysteresis.flowing(group) if "hysteretic" in requested else ():
        spring.travel = fma(h6, m["travel", spring.number], spring.travel)


class Rk4(Explicit):
    """The classical method of Kutta, with fewer operations for second-order systems.

    With stage accelerations a1..a4,

        u' = u + h v + h^2/6 (a1 + a2 + a3)
        v' = v + h/6 (a1 + 2 a2 + 2 a3 + a4)
    """

    name = "rk4"
    title = "classical fourth-order Runge-Kutta"
    source = "Hairer, Nørsett & Wanner 1993"
    order = 4
    phase = ((4, 120.0), (5, 144.0))
    follows_flow = True
    min_steps_located = 1.5
    min_ground_steps = 1.0
    step_cost = 2.6
    ladder = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96)
    finest_float32 = 64
    undamped_radius = 2.0 * math.sqrt(2.0)
    damped_radius = 2.615
    nodes = ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0))

    def after(self, stage: int, u: Lanes, v: Lanes, x: Lanes, a: Sequence[Lanes], h: Lanes) -> tuple[Lanes, Lanes]:
        """State that each stage leads to."""
        half = 0.5 * h
        if stage == 1:
            return fma(half, v, u), fma(half, a[0], v)
        if stage == 2:
            return fma(half * half, a[0], x), fma(half, a[1], v)
        if stage == 3:
            return fma(half * h, a[1], fma(h, v, u)), fma(h, a[2], v)
        sixth = h * (1.0 / 6.0)
        return fma(h * sixth, a[0] + a[1] + a[2], fma(h, v, u)), fma(sixth, fma(2.0, a[1] + a[2], a[0] + a[3]), v)


class CentralDifference(Explicit):
    """Central differences (velocity Verlet): half the work of a Runge-Kutta step, no energy of its own without dampers.

    With the acceleration a1 at the start and a2 at the end, where the dampers see the predicted velocity v + h a1,

        u' = u + h v + h^2/2 a1
        v' = v + h/2 (a1 + a2)

    Of the step of an oscillator with x = omega h and y = c h / m, the trace is 2 - x^2 - y + x^2 y/4 + y^2/2 and the
    determinant 1 - y + y^2/2 - x^2 y/4, so that it is stable where y <= 2 and x^2 <= 4 - 2 y + y^2: undamped to x = 2,
    and whatever y to the least of that, x^2 = 3 at y = 1.
    """

    name = "central_difference"
    title = "explicit central differences (velocity Verlet), dampers by a predicted velocity"
    source = "Newmark 1959 (beta = 0); Swope et al. 1982"
    order = 2
    phase = ((2, 24.0),)
    min_ground_steps = 8.0
    min_steps_located = 1.5
    step_cost = 1.6
    undamped_radius = 2.0
    damped_radius = math.sqrt(3.0)
    nodes = ((0.0, 3.0), (1.0, 3.0))

    def after(self, stage: int, u: Lanes, v: Lanes, x: Lanes, a: Sequence[Lanes], h: Lanes) -> tuple[Lanes, Lanes]:
        """State that each stage leads to."""
        half = 0.5 * h
        if stage == 1:
            return fma(half * h, a[0], fma(h, v, u)), fma(h, a[0], v)
        return x, fma(half, a[0] + a[1], v)
