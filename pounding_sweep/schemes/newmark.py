"""Newmark's method; contact is added implicitly.

Acceleration form: predictors

    u~ = u + h v + h^2 (1/2 - beta) a,    v~ = v + h (1 - gamma) a

then (M + gamma h C + beta h^2 K) a' = -M g' - C v~ - K u~ (+ contact), and
u' = u~ + beta h^2 a', v' = v~ + gamma h a'. The matrix is tridiagonal per building.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from pounding_sweep.kernel import impulse
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import fma, where
from pounding_sweep.kernel.peaks import add_powers
from pounding_sweep.kernel.row import powers
from pounding_sweep.schemes import implicit
from pounding_sweep.schemes.base import Scheme


class Newmark(Scheme):
    """Newmark's method with its beta and gamma, average acceleration by default."""

    name = "newmark"
    title = "Newmark's method, with contact implicit; average acceleration unless `beta` and `gamma` are given"
    source = "Newmark 1959"
    order = 2
    implicit = True
    follows_ground = False
    parameters = ("beta", "gamma")
    without_limit = "beta >= (gamma + 0.5)^2 / 4, which has no limit,"
    min_steps_located = 12.0
    step_cost = 4.5
    ladder = (1, 2, 4, 8, 16, 32, 64, 128, 256)  # its second order needs many
    finest_float32 = 128

    def stability_limit(self, w2: np.ndarray, rate: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        """Of the undamped motion, which damping only extends; infinite where beta and gamma leave none."""
        if beta >= 0.25 * (gamma + 0.5) ** 2 or gamma / 2.0 - beta <= 0.0:
            return np.full(w2.shape, np.inf)
        return np.asarray(1.0 / np.sqrt(w2 * (gamma / 2.0 - beta)))

    def phase_error(self, x: np.ndarray, beta: float, gamma: float) -> np.ndarray:
        """By the first terms."""
        return np.hypot((0.5 * beta - 1.0 / 24.0) * x * x, 0.5 * (gamma - 0.5) * x)

    def begin(self, group: Group) -> None:
        """Accelerations at the start, which are part of the state."""
        if group.spec.impulsive and group.touching:
            impulse.rest(group, group.state["scale"] == group.state["scale"])
        else:
            implicit.balance(group, None, group.state["g1"], pressed=True)

    def flight(self, group: Group, h: Any) -> Callable[[], None]:
        """Take a step of all lanes without contact."""
        _whole(group, h)
        # what is added is that of the state then
        return lambda: _add(group, gains(group)) if "energy" in group.asked else None

    def plain(self, group: Group, h: Any) -> Callable[[], None]:
        """Take a step of all lanes whose contacts follow from the present state alone."""
        _whole(group, h)
        implicit.correct(group, h)
        gained = gains(group) if "energy" in group.asked else []
        return lambda: _add(group, gained)

    def trial(self, group: Group) -> Callable[[], None]:
        """Try a sub-step of every lane's own length, contacts implicit."""
        s = group.state
        h, before = s["h"], group.floors("a0")
        u, v, a = step(group, group.floors("u0"), group.floors("v0"), before, h, s["g1"])
        group.put("u", u)
        group.put("v", v)
        # a lane that is done waits with h = 0: its acceleration, contact included, stays as it is
        group.put("a", [where(h > 0.0, x, old) for x, old in zip(a, before, strict=True)])
        if group.spec.impulsive:
            implicit.correct_resting(group, h)
        else:
            implicit.correct(group, h)
        gained = gains(group) if "energy" in group.asked else []
        return lambda: _add(group, gained)

    def soften(self, group: Group) -> None:
        """Mark lanes in which a closed contact is too stiff for the next sub-step."""
        implicit.soften(group)

    def settle(self, group: Group, lanes: Any) -> None:
        """Work, peaks and modes of the closed contacts of marked lanes at the end of their sub-step."""
        implicit.settle(group, lanes)

    def balance(self, group: Group, lanes: Any) -> None:
        """Accelerations that the equation of motion asks for at the present state."""
        implicit.balance(group, lanes, group.state["g1"], pressed=True)

    def touch_miss(self, group: Group) -> Any:
        """Time (s) by which a lane's sub-step went beyond (or fell short of) the touch that ends it."""
        return implicit.touch_miss(group)


def step(
    group: Group, u: Sequence[Any], v: Sequence[Any], a: Sequence[Any], h: Any, ground: Any
) -> tuple[list[Any], list[Any], list[Any]]:
    """Return displacements, velocities and accelerations after a step of length `h`, the ground at its end given."""
    beta, gamma = group.prop("newmark_beta"), group.prop("newmark_gamma")
    h = group.full(h)
    be, gg, pu, pv = beta * (h * h), gamma * h, h * h * (0.5 - beta), h * (1.0 - gamma)
    found: tuple[list[Any], list[Any], list[Any]] = ([], [], [])
    for b, floors in enumerate(group.building_floors):
        x = [fma(pu, a[i], fma(h, v[i], u[i])) for i in floors]
        y = [fma(pv, a[i], v[i]) for i in floors]
        alpha, stiff = group.prop("alpha", b), fma(gg, group.prop("beta", b), be)
        k = [group.prop("k", i) for i in floors]
        w = [fma(group.prop("beta", b), y[s], x[s]) for s in range(len(floors))]
        f = [k[s] * (w[s] - w[s - 1] if s else w[s]) for s in range(len(floors))]
        right: list[Any] = []
        diagonal: list[Any] = []
        off: list[Any] = [None]
        top = len(floors) - 1
        for s, i in enumerate(floors):
            m = group.prop("m", i)
            net = -f[s] if s == top else f[s + 1] - f[s]
            r = fma(-m, fma(alpha, y[s], ground), net)
            e = fma(m, gg * alpha, m) + stiff * (k[s] if s == top else k[s] + k[s + 1])
            if s:
                off.append(stiff * k[s])
                low = off[s] / diagonal[s - 1]
                e, r = fma(-low, off[s], e), fma(low, right[s - 1], r)
            diagonal.append(e)
            right.append(r)
        ends: list[Any] = [None] * len(floors)
        for s in range(top, -1, -1):
            ends[s] = (right[s] if s == top else fma(off[s + 1], ends[s + 1], right[s])) / diagonal[s]
        found[0].extend(fma(be, ends[s], x[s]) for s in range(len(floors)))
        found[1].extend(fma(gg, ends[s], y[s]) for s in range(len(floors)))
        found[2].extend(ends)
    return found


def gains(group: Group) -> list[tuple[Any, Any]]:
    """Powers of input and damping at both ends, in the weights of Simpson's h/6 (3 and 3: the trapezoid)."""
    s = group.state
    early, late = powers(group, group.floors("v0"), s["g0"]), powers(group, group.floors("v"), s["g1"])
    return [(3.0 * (p[0] + q[0]), 3.0 * (p[1] + q[1])) for p, q in zip(early, late, strict=True)]


def _whole(group: Group, h: Any) -> None:
    u, v, a = group.floors("u"), group.floors("v"), group.floors("a")
    for name, values in (("u0", u), ("v0", v), ("a0", a)):
        group.put(name, values)
    for name, values in zip("uva", step(group, u, v, a, h, group.state["g1"]), strict=True):
        group.put(name, values)


def _add(group: Group, gained: list[tuple[Any, Any]]) -> None:
    add_powers(group, gained, group.state["h"] * (1.0 / 6.0))
