"""The classical Runge-Kutta step of a row.

Written for second-order systems: with stage accelerations a1..a4,

    u' = u + h v + h^2/6 (a1 + a2 + a3)
    v' = v + h/6 (a1 + 2 a2 + 2 a3 + a4)

which is the classical fourth-order method of Kutta with fewer operations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from pounding_sweep.kernel.group import Group, is_wall
from pounding_sweep.kernel.lanes import fma
from pounding_sweep.kernel.row import Part, accelerations, powers, pushes

#: Weights (of h/6) of the stages.
WEIGHTS = (1.0, 2.0, 2.0, 1.0)


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


class Lengths:
    """A step's length, and what its stages make of it."""

    def __init__(self, h: Any) -> None:
        self.h, self.hh = h, 0.5 * h
        self.q, self.h2, self.h6 = self.hh * self.hh, self.hh * h, h * (1.0 / 6.0)
        self.h26 = h * self.h6

    def state(self, number: int, u: Any, v: Any, x: Any, a: Sequence[Any]) -> tuple[Any, Any]:
        """Displacement and velocity of a floor at a stage after the first, of the accelerations of earlier ones."""
        if number == 1:
            return fma(self.hh, v, u), fma(self.hh, a[0], v)
        if number == 2:
            return fma(self.q, a[0], x), fma(self.hh, a[1], v)
        return fma(self.h2, a[1], fma(self.h, v, u)), fma(self.h, a[2], v)

    def end(self, u: Any, v: Any, a: Sequence[Any]) -> tuple[Any, Any]:
        """Displacement and velocity of a floor at the end."""
        now = fma(self.h26, a[0] + a[1] + a[2], fma(self.h, v, u))
        return now, fma(self.h6, fma(2.0, a[1] + a[2], a[0] + a[3]), v)


def step(
    group: Group,
    part: Part,
    u: Sequence[Any],
    v: Sequence[Any],
    h: Any,
    ground: tuple[Any, Any],
    forces: Forces | None = None,
    join: Callable[[list[Any]], tuple[list[Any], list[Any]]] | None = None,
) -> Step:
    """Return where a step of length `h` leads a part of the row, the ground moving from one acceleration to another."""
    asked, every, lengths = group.asked, range(len(u)), Lengths(h)
    g0, g1 = ground
    middle = 0.5 * (g0 + g1)
    found = Step([], [], [])

    def stage(number: int, x: Sequence[Any], y: Sequence[Any], g: Any) -> list[Any]:
        push = forces(x, y) if forces is not None else ()
        a = accelerations(group, part, x, y, g, pushes(group, push))
        held: Sequence[Any] = push
        if join is not None:
            a, held = join(a)
        weight = WEIGHTS[number]

        def add(sums: list[Any], values: Sequence[Any]) -> list[Any]:
            scaled = [weight * value for value in values]
            return scaled if number == 0 else [old + new for old, new in zip(sums, scaled, strict=True)]

        if "energy" in asked:
            now = powers(group, part, y, g)
            gained = add([p[0] for p in found.powers], [p[0] for p in now])
            lost = add([p[1] for p in found.powers], [p[1] for p in now])
            found.powers = list(zip(gained, lost, strict=True))
        if held and "work" in asked and join is None:
            speeds = [group.between(y, j) for j in range(len(held))]
            weighted = [weight * force * w for force, w in zip(held, speeds, strict=True)]
            found.work = weighted if number == 0 else [o + n for o, n in zip(found.work, weighted, strict=True)]
        if held and "impulse" in asked:
            found.impulse = add(found.impulse, held)
        return a

    x, y = list(u), list(v)
    stages: list[list[Any]] = []
    for number, g in enumerate((g0, middle, middle, g1)):
        if number:
            states = [lengths.state(number, u[i], v[i], x[i], [a[i] for a in stages]) for i in every]
            x, y = [now[0] for now in states], [now[1] for now in states]
        stages.append(stage(number, x, y, g))
    ended = [lengths.end(u[i], v[i], [a[i] for a in stages]) for i in every]
    found.u, found.v, found.a0 = [now[0] for now in ended], [now[1] for now in ended], stages[0]
    return found


def step_long(group: Group, h: Any, press: Callable[[Any], Any] | None, join: Callable[[str], None] | None) -> None:
    """Step from ``u0`` and ``v0`` to ``u`` and ``v`` in a long row in contact, stage by stage, `press` a contact's force.

    The sums over its stages are left in ``din``, ``ddamp``, ``dwork`` and ``dimpulse``; where floors rest on each
    other, `join` makes their accelerations in a row alike and leaves the forces in ``force``.
    """
    s, r, lengths = group.state, group.asked, Lengths(h)
    n = group.spec.n_dof
    for i in group.each(n):
        s["x", i], s["y", i] = s["u0", i], s["v0", i]
    for number in range(4):
        g0, g1 = s["g0"], s["g1"]
        ground = (g0, 0.5 * (g0 + g1), 0.5 * (g0 + g1), g1)[number]
        weight, name = WEIGHTS[number], f"s{number}"
        if number:
            for i in group.each(n):
                before = [s[f"s{k}", i] for k in range(number)]
                s["x", i], s["y", i] = lengths.state(number, s["u0", i], s["v0", i], s["x", i], before)

        def add(row: str, k: Any, value: Any, weight: float = weight, number: int = number) -> None:
            s[row, k] = weight * value if number == 0 else s[row, k] + weight * value

        for i in group.each(n):
            s["push", i] = 0.0
        for j in group.each_contact() if press is not None else ():
            force = press(j)
            left, right, _ = group.sides(j)
            if not is_wall(left):
                s["push", left] = s["push", left] - force
            if not is_wall(right):
                s["push", right] = s["push", right] + force
            if "work" in r:
                add("dwork", j, force * group.between("y", j))
            if "impulse" in r:
                add("dimpulse", j, force)
        for b, floors in group.each_building():
            x, y = [s["x", i] for i in floors], [s["y", i] for i in floors]
            push = [[("+", s["push", i])] for i in floors]
            for i, a in zip(floors, accelerations(group, [(b, floors)], x, y, ground, push), strict=True):
                s[name, i] = a
            for gained, lost in powers(group, [(b, floors)], y, ground) if "energy" in r else ():
                add("din", b, gained)
                add("ddamp", b, lost)
        if join is not None:
            join(name)
            for j in group.each_contact() if "impulse" in r else ():
                add("dimpulse", j, s["force", j])
    for i in group.each(n):
        s["a0", i] = s["s0", i]
        s["u", i], s["v", i] = lengths.end(s["u0", i], s["v0", i], [s[f"s{k}", i] for k in range(4)])
