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

from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import fma
from pounding_sweep.kernel.row import accelerations, powers

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


def step(
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
    g0, g1 = ground
    middle = 0.5 * (g0 + g1)
    hh = 0.5 * h
    q, h2, h6 = hh * hh, hh * h, h * (1.0 / 6.0)
    h26 = h * h6
    found = Step([], [], [])

    def stage(number: int, x: Sequence[Any], y: Sequence[Any], g: Any) -> list[Any]:
        push = forces(x, y) if forces is not None else ()
        a = accelerations(group, x, y, g, push)
        held: Sequence[Any] = push
        if join is not None:
            a, held = join(a)
        weight = WEIGHTS[number]

        def add(sums: list[Any], values: Sequence[Any]) -> list[Any]:
            scaled = [weight * value for value in values]
            return scaled if number == 0 else [old + new for old, new in zip(sums, scaled, strict=True)]

        if "energy" in asked:
            now = powers(group, y, g)
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

    a1 = stage(0, u, v, g0)
    x = [fma(hh, v[i], u[i]) for i in every]
    a2 = stage(1, x, y := [fma(hh, a1[i], v[i]) for i in every], middle)
    x = [fma(q, a1[i], x[i]) for i in every]
    a3 = stage(2, x, y := [fma(hh, a2[i], v[i]) for i in every], middle)
    x = [fma(h2, a2[i], fma(h, v[i], u[i])) for i in every]
    y = [fma(h, a3[i], v[i]) for i in every]
    a4 = stage(3, x, y, g1)
    found.u = [fma(h26, a1[i] + a2[i] + a3[i], fma(h, v[i], u[i])) for i in every]
    found.v = [fma(h6, fma(2.0, a2[i] + a3[i], a1[i] + a4[i]), v[i]) for i in every]
    found.a0 = a1
    return found
