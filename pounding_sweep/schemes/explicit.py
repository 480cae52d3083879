"""Explicit schemes: a step of a row follows from its accelerations at a few stages."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pounding_sweep.kernel import impulse
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import fma
from pounding_sweep.kernel.peaks import add_powers
from pounding_sweep.kernel.row import accelerations, powers
from pounding_sweep.schemes.base import Scheme


@dataclass
class Step:
    """What a step found: motion at its end, acceleration at its start, and sums over its stages (of weight x rate)."""

    u: list[Any]
    v: list[Any]
    a0: list[Any]
    powers: list[tuple[Any, Any]] = field(default_factory=list)
    work: list[Any] = field(default_factory=list)
    impulse: list[Any] = field(default_factory=list)


#: Contact forces at a state, or what makes floors that rest on each other accelerate alike.
Forces = Callable[[Sequence[Any], Sequence[Any]], Sequence[Any]]


class Explicit(Scheme):
    """A scheme of stages: a subclass says where they lie and what state follows from each.

    Attributes
    ----------
    undamped_radius, damped_radius : float
        Largest stable product of step and frequency without damping; and with any, of step and frequency or damping
        rate, the larger of them.
    nodes : tuple of (float, float)
        Of each stage: the share of the step at which it takes the ground (0, 0.5 or 1), and the weight of what acts
        there in the integrals of work, impulse and energy, in sixths of the step.
    """

    undamped_radius: float
    damped_radius: float
    nodes: tuple[tuple[float, float], ...]

    @abstractmethod
    def after(self, stage: int, u: Any, v: Any, x: Any, a: Sequence[Any], h: Any) -> tuple[Any, Any]:
        """Displacement and velocity of a floor after a stage (from 1): the next one's, after the last those of the end.

        `u` and `v` are the start, `x` is the displacement of this stage, `a` the accelerations up to it.
        """

    def stability_limit(self, w2: np.ndarray, rate: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        """By the radii."""
        # an overdamped mode has no frequency: its rate is at most that of the dampers, where they are largest
        fastest = np.maximum(np.sqrt(w2), rate)
        return np.asarray(np.where(rate > 0.0, self.damped_radius, self.undamped_radius) / fastest)

    def step(
        self,
        group: Group,
        u: Sequence[Any],
        v: Sequence[Any],
        h: Any,
        ground: tuple[Any, Any],
        forces: Forces | None = None,
        join: Callable[[list[Any]], tuple[list[Any], list[Any]]] | None = None,
    ) -> Step:
        """Return where a step of length `h` leads, the ground moving from one acceleration to another."""
        asked, every = group.asked, range(group.spec.n_dof)
        places = {0.0: ground[0], 0.5: 0.5 * (ground[0] + ground[1]), 1.0: ground[1]}
        found, x, y, a = Step([], [], []), list(u), list(v), []

        def total(sums: Sequence[Any], values: Sequence[Any]) -> list[Any]:
            scaled = [weight * value for value in values]
            return [old + new for old, new in zip(sums, scaled, strict=True)] if sums else scaled

        for number, (place, weight) in enumerate(self.nodes, 1):
            held: Sequence[Any] = forces(x, y) if forces is not None else ()
            now = accelerations(group, x, y, places[place], held)
            if join is not None:
                now, held = join(now)
            a.append(now)
            if "energy" in asked:
                gained, lost = zip(*powers(group, y, places[place]), strict=True)
                sums = [total([p[side] for p in found.powers], new) for side, new in enumerate((gained, lost))]
                found.powers = list(zip(*sums, strict=True))
            if held and "work" in asked and join is None:
                speeds = [group.between(y, j) for j in range(len(held))]
                weighted = [weight * force * w for force, w in zip(held, speeds, strict=True)]
                found.work = [o + n for o, n in zip(found.work, weighted, strict=True)] if found.work else weighted
            if held and "impulse" in asked:
                found.impulse = total(found.impulse, held)
            states = [self.after(number, u[i], v[i], x[i], [each[i] for each in a], h) for i in every]
            x, y = ([state[side] for state in states] for side in (0, 1))
        found.u, found.v, found.a0 = x, y, a[0]
        return found

    def flight(self, group: Group, h: Any) -> Callable[[], None]:
        """Take a step of all lanes without contact."""
        return self._whole(group, h, None)

    def plain(self, group: Group, h: Any) -> Callable[[], None]:
        """Take a step of all lanes whose contacts follow from the present state alone."""
        s, law = group.state, group.law
        assert law is not None
        every = range(len(group.contacts))
        k, c, gaps, run = (
            s["k"],
            [s["c", j] for j in every],
            [group.gap(j) for j in every],
            [s["vrun", j] for j in every],
        )

        def press(x: Sequence[Any], y: Sequence[Any]) -> list[Any]:
            return [law.memoryless(k, c[j], run[j], group.between(x, j) - gaps[j], group.between(y, j)) for j in every]

        return self._whole(group, h, press)

    def _whole(self, group: Group, h: Any, press: Forces | None) -> Callable[[], None]:
        s = group.state
        u, v = group.floors("u"), group.floors("v")
        group.put("u0", u)
        group.put("v0", v)
        step = self.step(group, u, v, h, (s["g0"], s["g1"]), press)
        group.put("u", step.u)
        group.put("v", step.v)
        return _record(group, step)

    def trial(self, group: Group) -> Callable[[], None]:
        """Try a sub-step of every lane's own length, modes frozen."""
        s, law = group.state, group.law
        assert law is not None
        every = range(len(group.contacts))
        u0, v0, ground, h = group.floors("u0"), group.floors("v0"), (s["g0"], s["g1"]), s["h"]
        if group.spec.impulsive:
            rests = impulse.resting(group)
            step = self.step(group, u0, v0, h, ground, join=lambda a: impulse.join(group, a, rests))
        else:
            k, c, gaps = [s["ke", j] for j in every], [s["ce", j] for j in every], [group.gap(j) for j in every]

            def press(x: Sequence[Any], y: Sequence[Any]) -> list[Any]:
                return [law.pressing(k[j], c[j], group.between(x, j) - gaps[j], group.between(y, j)) for j in every]

            step = self.step(group, u0, v0, h, ground, press)
        group.put("a0", step.a0)
        group.put("u", step.u)
        group.put("v", step.v)
        return _record(group, step)


def _record(group: Group, step: Step) -> Callable[[], None]:
    """Return what adds energies, work and impulse of a step, once it is taken."""

    def add() -> None:
        s = group.state
        h6 = s["h"] * (1.0 / 6.0)
        if "energy" in group.asked:
            add_powers(group, step.powers, h6)
        for j, x in enumerate(step.work):
            s["work", j] = fma(h6, x, s["work", j])
        for j, x in enumerate(step.impulse):
            s["impulse", j] = fma(h6, x, s["impulse", j])

    return add
