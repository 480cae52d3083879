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

from pounding_sweep.kernel import bouc_wen, impulse, links
from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import fma, where
from pounding_sweep.kernel.located import keep_start
from pounding_sweep.kernel.row import Pushes, accelerations, powers, storey_force
from pounding_sweep.schemes import implicit
from pounding_sweep.schemes.base import Scheme


class Newmark(Scheme):
    """Newmark's method with its beta and gamma, average acceleration by default."""

    name = "newmark"
    title = "Newmark's method, with contact implicit; average acceleration unless `beta` and `gamma` are given"
    source = "Newmark 1959"
    order = 2
    implicit = True
    min_ground_steps = 8.0
    follows_smooth = True
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
        s = group.state
        if group.spec.smooth:
            keep_start(group)
            return self.trial(group)
        if group.spec.whole:
            keep_start(group)
            for name, values in zip("uva", whole_step(group, h), strict=True):
                group.put(name, values)
            return lambda: add_gains(group)
        for b, floors in group.each_building():
            before = [[s[name, i] for i in floors] for name in "uva"]
            u, v, a = before
            for name, old, new in zip("uva", before, step(group, b, floors, u, v, a, h, s["g1"]), strict=True):
                for i, x, y in zip(floors, old, new, strict=True):
                    s[f"{name}0", i], s[name, i] = x, y
        return lambda: add_gains(group)

    def plain(self, group: Group, h: Any) -> Callable[[], None]:
        """Take a step of all lanes whose contacts follow from the present state alone."""
        add = self.flight(group, h)
        implicit.correct(group, h)
        return add

    def trial(self, group: Group) -> Callable[[], None]:
        """Try a sub-step of every lane's own length, contacts implicit."""
        for _ in bouc_wen.rounds(group) if group.spec.smooth else (None,):
            self._reach(group, group.state["h"])
        return lambda: add_gains(group)

    def _reach(self, group: Group, h: Any) -> None:
        """Go to the end of a sub-step, shears of storeys in straight lines."""
        s = group.state
        if group.spec.whole:
            u, v, a = whole_step(group, h)
            group.put("u", u)
            group.put("v", v)
            group.put("a", [where(h > 0.0, x, s["a0", i]) for i, x in enumerate(a)])
        for b, floors in group.each_building() if not group.spec.whole else ():
            u, v, before = ([s[name, i] for i in floors] for name in ("u0", "v0", "a0"))
            now = step(group, b, floors, u, v, before, h, s["g1"])
            for p, i in enumerate(floors):
                s["u", i], s["v", i] = now[0][p], now[1][p]
                # a lane that is done waits with h = 0: its acceleration, contact included, stays as it is
                s["a", i] = where(h > 0.0, now[2][p], before[p])
        if group.spec.impulsive:
            implicit.correct_resting(group, h)
        elif group.touching:
            implicit.correct(group, h)

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
    group: Group,
    b: Any,
    floors: Sequence[Any],
    u: Sequence[Any],
    v: Sequence[Any],
    a: Sequence[Any],
    h: Any,
    ground: Any,
) -> tuple[list[Any], list[Any], list[Any]]:
    """Return displacements, velocities and accelerations of a building after a step, the ground at its end given."""
    beta, gamma = group.prop("newmark_beta"), group.prop("newmark_gamma")
    h = group.full(h)
    be, gg, pu, pv = beta * (h * h), gamma * h, h * h * (0.5 - beta), h * (1.0 - gamma)
    x = [fma(pu, a[i], fma(h, v[i], u[i])) for i in range(len(floors))]
    y = [fma(pv, a[i], v[i]) for i in range(len(floors))]
    alpha, stiff = group.prop("alpha", b), fma(gg, group.prop("beta", b), be)
    k = [group.prop("k", i) for i in floors]
    each = range(len(floors))
    if apart := any(map(group.own_damper, floors)):
        drifts, rates = ([z[s] - z[s - 1] if s else z[s] for s in each] for z in (x, y))
        f = [storey_force(group, b, i, drifts[s], rates[s]) for s, i in enumerate(floors)]
        own = [implicit.storey_stiffness(group, b, i, be, gg) for i in floors]
    else:
        w = [fma(group.prop("beta", b), y[s], x[s]) for s in each]
        f = [k[s] * (w[s] - w[s - 1] if s else w[s]) for s in each]
    right: list[Any] = []
    inverse: list[Any] = []  # in flight the same in all steps: divided once
    off: list[Any] = [None]
    top = len(floors) - 1
    for s, i in enumerate(floors):
        m = group.prop("m", i)
        net = -f[s] if s == top else f[s + 1] - f[s]
        r = fma(-m, fma(alpha, y[s], ground), net)
        if apart:
            e = fma(m, gg * alpha, m) + (own[s] if s == top else own[s] + own[s + 1])
        else:
            e = fma(m, gg * alpha, m) + stiff * (k[s] if s == top else k[s] + k[s + 1])
        if s:
            off.append(own[s] if apart else stiff * k[s])
            low = off[s] * inverse[s - 1]
            e, r = fma(-low, off[s], e), fma(low, right[s - 1], r)
        inverse.append(1.0 / e)
        right.append(r)
    ends: list[Any] = [None] * len(floors)
    for s in range(top, -1, -1):
        ends[s] = (right[s] if s == top else fma(off[s + 1], ends[s + 1], right[s])) * inverse[s]
    after = [fma(be, ends[s], x[s]) for s in range(len(floors))]
    return after, [fma(gg, ends[s], y[s]) for s in range(len(floors))], ends


def whole_step(group: Group, h: Any) -> tuple[list[Any], list[Any], list[Any]]:
    """Return displacements, velocities and accelerations of a row that moves as one after a step from its start."""
    beta, gamma, every = group.prop("newmark_beta"), group.prop("newmark_gamma"), range(group.spec.n_moving)
    h = group.full(h)
    be, gg, pu, pv = beta * (h * h), gamma * h, h * h * (0.5 - beta), h * (1.0 - gamma)
    u, v, a = (group.floors(f"{name}0") for name in "uva")
    x = [fma(pu, a[i], fma(h, v[i], u[i])) for i in every]
    y = [fma(pv, a[i], v[i]) for i in every]
    row = list(enumerate(group.building_floors))
    push = Pushes(group, rows=False)
    push.add_links(x, y)
    own = [implicit.storey_stiffness(group, b, i, be, gg) for b, floors in row for i in floors]
    load = accelerations(group, row, x, y, group.state["g1"], push.on(every))
    right = [group.prop("m", i) * each for i, each in enumerate(load)]
    ends = links.solve(group, be, gg, own, right)
    return [fma(be, ends[i], x[i]) for i in every], [fma(gg, ends[i], y[i]) for i in every], ends


def add_gains(group: Group) -> None:
    """Add the energies of a step: powers of input and damping at both ends, by the trapezoid."""
    s = group.state
    h6 = s["h"] * (1.0 / 6.0)
    for part, moving in group.each_part() if "energy" in group.asked else ():
        early = powers(group, part, [s["v0", i] for i in moving], s["g0"])
        late = powers(group, part, [s["v", i] for i in moving], s["g1"])
        for (b, _), first, last in zip(part, early, late, strict=True):
            s["e_in", b] = fma(h6, 3.0 * (first[0] + last[0]), s["e_in", b])
            s["e_damp", b] = fma(h6, 3.0 * (first[1] + last[1]), s["e_damp", b])
    if group.spec.smooth:
        bouc_wen.add_lost(group)
    if "links" in group.asked:
        links.add_powers(group, "u0", "v0", 3.0, first=True)
        links.add_powers(group, "u", "v", 3.0, first=False)
        links.record(group, h6)
