"""Exact steps of modes, any number side by side: lanes of a kernel, or arrays of NumPy's (Nigam & Jennings 1969).

The ground acceleration being linear over a step h, the state x = (q, q') moves by x' = A x + p g0 + q g1. A, p and q
follow from exp(Z), phi1(Z) = (exp(Z) - 1) / Z and phi2(Z) = (exp(Z) - 1 - Z) / Z**2 of

    Z = [[0, 1], [-(w h)**2, -2 zeta w h]]

each f0 + f1 Z with two real numbers, by the power series of a halved Z and by doubling it again: one formula for modes
that are under-, critically and over-damped.
"""

from __future__ import annotations

import math

from pounding_sweep.kernel.types import Lanes
from pounding_sweep.lanes import Cell, fma, maximum, sqrt, where, while_any

#: Largest frequency or damping, times the step, for which the series is summed, and its number of terms:
#: 0.5**16 / 16! is below the last place.
_SMALL, _TERMS = 0.5, 16
#: Most halvings: what is larger has decayed to nothing, or is no number.
_HALVINGS = 64
#: Numbers of a step: what q and q' at its end are by those at its start, and by the ground at its start and end.
MOVES = ("qq", "qp", "pq", "pp", "q0", "p0", "q1", "p1")

#: f0 + f1 Z
_Function = tuple[Lanes, Lanes]


def step(w: Lanes, c: Lanes, push: Lanes, h: Lanes) -> dict[str, Lanes]:
    """Return `MOVES` over a step of `h` (s), of frequencies, decay 2 zeta w, and what the ground pushes by."""
    square, damping = (w * h) * (w * h), c * h
    # each by its own number of halvings, so that none depends on those beside it
    largest = maximum(maximum(sqrt(square), damping), _SMALL)
    share = Cell(square * 0.0 + 1.0)
    for _ in while_any(lambda: largest * share.now > _SMALL, _HALVINGS):
        share.now = where(largest * share.now > _SMALL, 0.5 * share.now, share.now)
    scale = share.now
    less, damped = square * scale * scale, damping * scale

    def times(f: _Function, g: _Function) -> _Function:  # Z**2 = -lost Z - less
        product = f[1] * g[1]
        return fma(f[0], g[0], -less * product), fma(f[0], g[1], fma(f[1], g[0], -damped * product))

    # Horner's rule for phi2, whose series is sum Z**i / (i + 2)!; the others follow from it
    f0, f1 = less * 0.0 + 1.0 / math.factorial(_TERMS + 1), less * 0.0
    for i in range(_TERMS - 2, -1, -1):
        f0, f1 = fma(-less, f1, 1.0 / math.factorial(i + 2)), fma(-damped, f1, f0)
    phi2 = Cell(f0), Cell(f1)
    phi1 = Cell(1.0 - less * f1), Cell(f0 - damped * f1)
    grown = Cell(1.0 - less * phi1[1].now), Cell(phi1[0].now - damped * phi1[1].now)

    def now(cells: tuple[Cell, Cell]) -> _Function:
        return cells[0].now, cells[1].now

    for _ in while_any(lambda: share.now < 1.0):
        more, (a0, a1), (b0, b1) = share.now < 1.0, times(now(phi1), now(phi1)), times(now(grown), now(phi1))
        twice = times(now(grown), now(grown))
        new = (0.25 * (a0 + 2.0 * phi2[0].now), 0.25 * (a1 + 2.0 * phi2[1].now))
        half = (0.5 * (b0 + phi1[0].now), 0.5 * (b1 + phi1[1].now))
        for cells, values in ((phi2, new), (phi1, half), (grown, twice)):
            for cell, value in zip(cells, values, strict=True):
                cell.now = where(more, value, cell.now)
        share.now = where(more, 2.0 * share.now, share.now)
    (e0, e1), (p0, p1), (q0, q1) = ((x.now, z.now * scale) for x, z in (grown, phi1, phi2))
    moves = [e0, e1 * h, -(w * w) * (e1 * h), e0 - damping * e1]
    for f0, f1 in ((p0 - q0, p1 - q1), (q0, q1)):
        moves += [-(f1 * (push * h) * h), -((f0 - damping * f1) * (push * h))]
    return dict(zip(MOVES, moves, strict=True))
