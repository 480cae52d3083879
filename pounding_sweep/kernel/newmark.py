"""The Newmark-beta step of a row, without its contacts.

Acceleration form: predictors

    u~ = u + h v + h^2 (1/2 - beta) a,    v~ = v + h (1 - gamma) a

then (M + gamma h C + beta h^2 K) a' = -M g' - C v~ - K u~ (+ contact), and
u' = u~ + beta h^2 a', v' = v~ + gamma h a'. The matrix is tridiagonal per building.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pounding_sweep.kernel.group import Group
from pounding_sweep.kernel.lanes import fma
from pounding_sweep.kernel.row import powers


def step(
    group: Group, b: Any, floors: Sequence[Any], u: Sequence[Any], v: Sequence[Any], a: Sequence[Any], h: Any, ground: Any
) -> tuple[list[Any], list[Any], list[Any]]:
    """Return displacements, velocities and accelerations of a building after a step of length `h`, the ground at its end given."""
    beta, gamma = group.prop("newmark_beta"), group.prop("newmark_gamma")
    h = group.full(h)
    be, gg, pu, pv = beta * (h * h), gamma * h, h * h * (0.5 - beta), h * (1.0 - gamma)
    x = [fma(pu, a[i], fma(h, v[i], u[i])) for i in range(len(floors))]
    y = [fma(pv, a[i], v[i]) for i in range(len(floors))]
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
    after = [fma(be, ends[s], x[s]) for s in range(len(floors))]
    return after, [fma(gg, ends[s], y[s]) for s in range(len(floors))], ends


def add_gains(group: Group) -> None:
    """Add the energies of a step: powers of input and damping at both ends, by the trapezoid."""
    s = group.state
    h6 = s["h"] * (1.0 / 6.0)
    for b, floors in group.each_building() if "energy" in group.asked else ():
        (early,) = powers(group, [(b, floors)], [s["v0", i] for i in floors], s["g0"])
        (late,) = powers(group, [(b, floors)], [s["v", i] for i in floors], s["g1"])
        s["e_in", b] = fma(h6, 3.0 * (early[0] + late[0]), s["e_in", b])
        s["e_damp", b] = fma(h6, 3.0 * (early[1] + late[1]), s["e_damp", b])
