"""Explicit schemes: a step of a row follows from its accelerations at a few stages."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pounding_sweep.kernel import bouc_wen, impulse, links
from pounding_sweep.kernel.group import Group, part_of
from pounding_sweep.kernel.lanes import Cell, any_lane, fma, when
from pounding_sweep.kernel.located import keep_start
from pounding_sweep.kernel.peaks import add_powers
from pounding_sweep.kernel.row import Part, accelerations, each_given, powers, pushes
from pounding_sweep.schemes.base import Scheme


@dataclass
class Step:
    """What a step found: motion at its end, accelerations of its stages, and sums over these."""

    u: list[Any]
    v: list[Any]
    a: list[list[Any]]
    powers: list[tuple[Any, Any]] = field(default_factory=list)
    work: list[Any] = field(default_factory=list)
    given: dict[int, Any] = field(default_factory=dict)
    impulse: list[Any] = field(default_factory=list)
    travel: dict[int, Any] = field(default_factory=dict)


#: Contact forces at a state, or what makes floors that rest on each other accelerate alike.
Forces = Callable[[Sequence[Any], Sequence[Any]], Sequence[Any]]


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
    def after(self, stage: int, u: Any, v: Any, x: Any, a: Sequence[Any], h: Any) -> tuple[Any, Any]:
        """Displacement and velocity of a floor after a stage (from 1): of the next one, at last of the end."""
        # `u` and `v` are the start, `x` is the displacement of this stage, `a` the accelerations up to it

    def keep(self, group: Group, i: Any, a: Sequence[Any]) -> None:
        """Keep what a sub-step asks of the accelerations of floor i in its stages."""
        group.state["a0", i] = a[0]

    def stability_limit(self, w2: np.ndarray, rate: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        """By the radii."""
        # an overdamped mode has no frequency: its rate is at most that of the dampers, where they are largest
        fastest = np.maximum(np.sqrt(w2), rate)
        return np.asarray(np.where(rate > 0.0, self.damped_radius, self.undamped_radius) / fastest)

    def _grounds(self, group: Group) -> dict[float, Any]:
        """Ground accelerations at the places of the stages."""
        g0, g1 = group.state["g0"], group.state["g1"]
        known = {0.0: g0, 0.5: 0.5 * (g0 + g1), 1.0: g1}
        return known | {c: fma(c, g1 - g0, g0) for c, _ in self.nodes if c not in known}

    def step(
        self,
        group: Group,
        part: Part,
        u: Sequence[Any],
        v: Sequence[Any],
        h: Any,
        forces: Forces | None = None,
        join: Callable[[list[Any]], tuple[list[Any], list[Any]]] | None = None,
    ) -> Step:
        """Return where a step of length `h` leads a part of the row."""
        asked, every = group.asked, range(len(u))
        grounds, found, x, y, a = self._grounds(group), Step([], [], []), list(u), list(v), []

        def total(sums: Sequence[Any], values: Sequence[Any]) -> list[Any]:
            scaled = [weight * value for value in values]
            return [old + new for old, new in zip(sums, scaled, strict=True)] if sums else scaled

        flow = bouc_wen.Flow(group) if group.spec.smooth else None
        for number, (place, weight) in enumerate(self.nodes, 1):
            if flow is not None:
                flow.hold(x, y, weight)
            held: Sequence[Any] = forces(x, y) if forces is not None else ()
            push = pushes(group, held)
            if group.spec.links:
                push = links.pushes(group, links.forces(group, x, y), push)
                if "links" in asked:
                    links.add_powers(group, x, y, weight, number == 1)
            now = accelerations(group, part, x, y, grounds[place], push)
            if join is not None:
                now, held = join(now)
            a.append(now)
            if "energy" in asked:
                gained, lost = zip(*powers(group, part, y, grounds[place]), strict=True)
                sums = [total([p[side] for p in found.powers], new) for side, new in enumerate((gained, lost))]
                found.powers = list(zip(*sums, strict=True))
            if held and "work" in asked and join is None:
                speeds = [group.between(y, j) for j in range(len(held))]
                weighted = [weight * force * w for force, w in zip(held, speeds, strict=True)]
                found.work = [o + n for o, n in zip(found.work, weighted, strict=True)] if found.work else weighted
            for j, force in enumerate(held) if "transfer" in asked else ():
                for b, power in each_given(group, j, force, y):
                    found.given[b] = fma(weight, power, found.given[b]) if b in found.given else weight * power
            if held and "impulse" in asked:
                found.impulse = total(found.impulse, held)
            states = [self.after(number, u[i], v[i], x[i], [each[i] for each in a], h) for i in every]
            x, y = ([state[side] for state in states] for side in (0, 1))
            if flow is not None:
                flow.advance(self.after, number, h)
        if flow is not None:
            flow.end()
            found.travel = flow.lost
        found.u, found.v, found.a = x, y, a
        return found

    def step_long(
        self, group: Group, h: Any, press: Callable[[Any], Any] | None, join: Callable[[str], None] | None
    ) -> None:
        """Step from ``u0`` and ``v0`` to ``u`` and ``v`` in a long row in contact, stage by stage."""
        # `press` is a contact's force. The sums over the stages are left in `din`, `ddamp`, `dwork`, `dimpulse` and
        # `gain`; where floors rest on each other, `join` makes their accelerations in a row alike and leaves the
        # forces in `force`.
        s, r, n, grounds = group.state, group.asked, group.spec.n_dof, self._grounds(group)
        for i in group.each(n):
            s["x", i], s["y", i] = s["u0", i], s["v0", i]
        for b in group.each(group.spec.n_buildings) if "transfer" in r and group.touching else ():
            s["gain", b] = 0.0
        for number, (place, weight) in enumerate(self.nodes, 1):

            def add(row: str, k: Any, value: Any, weight: float = weight, number: int = number) -> None:
                s[row, k] = weight * value if number == 1 else s[row, k] + weight * value

            def give(j: Any, force: Any, weight: float = weight) -> None:
                for b, power in each_given(group, j, force, "y"):
                    s["gain", b] = fma(weight, power, s["gain", b])

            for i in group.each(n):
                s["push", i] = 0.0
            for j in group.each_contact() if press is not None else ():
                assert press is not None
                force = press(j)
                for floor, sign, share in group.ends(j):
                    before, part = s["push", floor], part_of(force, share)
                    s["push", floor] = before - part if sign == "-" else before + part
                if "work" in r:
                    add("dwork", j, force * group.between("y", j))
                if "impulse" in r:
                    add("dimpulse", j, force)
                if "transfer" in r:
                    give(j, force)
            if group.spec.links:
                links.push_rows(group, "push", "x", "y")
                if "links" in r:
                    links.add_powers(group, "x", "y", weight, number == 1)
            for b, floors in group.each_building():
                x, y = [s["x", i] for i in floors], [s["y", i] for i in floors]
                push = [[("+", s["push", i])] for i in floors]
                now = accelerations(group, [(b, floors)], x, y, grounds[place], push)
                for i, a in zip(floors, now, strict=True):
                    s[f"s{number - 1}", i] = a
                for gained, lost in powers(group, [(b, floors)], y, grounds[place]) if "energy" in r else ():
                    add("din", b, gained)
                    add("ddamp", b, lost)
            if join is not None:
                join(f"s{number - 1}")
                for j in group.each_contact() if r & {"impulse", "transfer"} else ():
                    if "impulse" in r:
                        add("dimpulse", j, s["force", j])
                    if "transfer" in r:
                        give(j, s["force", j])
            names = ("x", "y") if number < len(self.nodes) else ("u", "v")
            for i in group.each(n):
                a = [s[f"s{k}", i] for k in range(number)]
                for name, value in zip(names, self.after(number, s["u0", i], s["v0", i], s["x", i], a, h), strict=True):
                    s[name, i] = value
        for i in group.each(n):
            self.keep(group, i, [s[f"s{k}", i] for k in range(len(self.nodes))])

    def flight(self, group: Group, h: Any) -> Callable[[], None]:
        """Take a step of all lanes without contact."""
        s = group.state
        if not group.long:
            return self._whole(group, h, None)
        if group.spec.links:  # the row moves as one
            keep_start(group)
            self.step_long(group, h, None, None)
            return lambda: _record_long(group)
        for b, floors in group.each_building():
            u, v = [s["u", i] for i in floors], [s["v", i] for i in floors]
            step = self.step(group, [(b, floors)], u, v, h)
            for p, i in enumerate(floors):
                s["u0", i], s["v0", i], s["u", i], s["v", i] = u[p], v[p], step.u[p], step.v[p]
            for gained, lost in step.powers:
                s["din", b], s["ddamp", b] = gained, lost
        return lambda: _record_long(group)

    def plain(self, group: Group, h: Any) -> Callable[[], None]:
        """Take a step of all lanes whose contacts follow from the present state alone."""
        s = group.state
        if group.long:
            keep_start(group)

            def push(j: Any) -> Any:
                d = group.between("x", j) - group.gap(j)
                law = group.law_of(j)
                return law.memoryless(group.stiffness(j), s["c", j], s["vrun", j], d, group.between("y", j))

            self.step_long(group, h, push, None)
            return lambda: _record_contacts(group)
        every = range(len(group.contacts))
        k = [group.stiffness(j) for j in every] if group.spec.own_stiffness else [group.stiffness(0)] * len(every)
        c, gaps = [s["c", j] for j in every], [group.gap(j) for j in every]
        run = [s["vrun", j] for j in every]

        def press(x: Sequence[Any], y: Sequence[Any]) -> list[Any]:
            return [
                group.law_of(j).memoryless(ki, ci, fastest, group.between(x, j) - gap, group.between(y, j))
                for j, (ki, ci, fastest, gap) in enumerate(zip(k, c, run, gaps, strict=True))
            ]

        return self._whole(group, h, press)

    def _whole(self, group: Group, h: Any, press: Forces | None) -> Callable[[], None]:
        u, v = group.floors("u"), group.floors("v")
        group.put("u0", u)
        group.put("v0", v)
        if group.spec.smooth:
            bouc_wen.keep(group)
        step = self.step(group, _row(group), u, v, h, press)
        group.put("u", step.u)
        group.put("v", step.v)
        return _record(group, step)

    def trial(self, group: Group) -> Callable[[], None]:
        """Try a sub-step of every lane's own length, modes frozen."""
        s = group.state
        if group.long:

            def push(j: Any) -> Any:
                d = group.between("x", j) - group.gap(j)
                return group.law_of(j).pressing(s["ke", j], s["ce", j], d, group.between("y", j))

            if group.spec.impulsive:
                self.step_long(group, s["h"], None, lambda name: impulse.join_rows(group, name))
            else:
                self.step_long(group, s["h"], push if group.touching else None, None)
            return lambda: _record_contacts(group)
        every = range(len(group.contacts))
        u0, v0, h = group.floors("u0"), group.floors("v0"), s["h"]
        if group.spec.impulsive:
            rests = impulse.resting(group)
            step = self.step(group, _row(group), u0, v0, h, join=lambda a: impulse.join(group, a, rests))
        elif not group.touching:
            step = self.step(group, _row(group), u0, v0, h)
        else:
            k, c, gaps = [s["ke", j] for j in every], [s["ce", j] for j in every], [group.gap(j) for j in every]

            presses = [any_lane(~(k[j] == 0.0) | ~(c[j] == 0.0)) for j in every]

            def press(x: Sequence[Any], y: Sequence[Any]) -> list[Any]:
                found = [Cell(group.full(0.0)) for _ in every]
                for j, force in enumerate(found):
                    for _ in when(presses[j]):
                        d, v = group.between(x, j) - gaps[j], group.between(y, j)
                        force.now = group.law_of(j).pressing(k[j], c[j], d, v)
                return [force.now for force in found]

            step = self.step(group, _row(group), u0, v0, h, press)
        for i in range(group.spec.n_moving):
            self.keep(group, i, [each[i] for each in step.a])
        group.put("u", step.u)
        group.put("v", step.v)
        return _record(group, step)


def _row(group: Group) -> Part:
    """All buildings of a short row, and their floors."""
    return list(enumerate(group.building_floors))


def _record(group: Group, step: Step) -> Callable[[], None]:
    """Return what adds energies, work and impulse of a step, once it is taken."""

    def add() -> None:
        s = group.state
        h6 = s["h"] * (1.0 / 6.0)
        if "energy" in group.asked:
            add_powers(group, step.powers, h6)
        for j, x in enumerate(step.work):
            s["work", j] = fma(h6, x, s["work", j])
        if "links" in group.asked:
            links.record(group, h6)
        for j, x in enumerate(step.impulse):
            s["impulse", j] = fma(h6, x, s["impulse", j])
        for b, x in step.given.items():
            s["gain", b] = h6 * x
        for i, x in step.travel.items():
            s["travel", i] = fma(h6, x, s["travel", i])

    return add


def _record_long(group: Group) -> None:
    """Add energies of a step of a long row, which left its sums in rows."""
    s = group.state
    h6 = s["h"] * (1.0 / 6.0)
    for b in group.each(group.spec.n_buildings) if "energy" in group.asked else ():
        s["e_in", b] = fma(h6, s["din", b], s["e_in", b])
        s["e_damp", b] = fma(h6, s["ddamp", b], s["e_damp", b])
    if "links" in group.asked:
        links.record(group, h6)


def _record_contacts(group: Group) -> None:
    """Add energies, works and impulses of a step of a long row."""
    s = group.state
    h6 = s["h"] * (1.0 / 6.0)
    _record_long(group)
    for name in ("work", "impulse"):
        if name in group.asked and not (name == "work" and group.spec.impulsive):
            for j in group.each(len(group.contacts)):
                s[name, j] = fma(h6, s[f"d{name}", j], s[name, j])
    for b in group.each(group.spec.n_buildings) if "transfer" in group.asked else ():
        s["gain", b] = h6 * s["gain", b]
