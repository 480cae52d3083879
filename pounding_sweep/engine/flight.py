"""Tables of free flight, of any number of variants of a scene at once.

Between impacts a building is linear, and the ground acceleration is linear
between record points; over a step h the state x = (q, q') of a mode then moves by

    x' = A x + p g0 + q g1

without error at any h (Nigam & Jennings 1969). Rayleigh damping leaves the modes
apart, so that A, p and q follow from functions of a 2 x 2 matrix per mode:

    Z = [[0, 1], [-(w h)**2, -2 zeta w h]],    exp(Z),    phi1(Z), phi2(Z)

with phi1(z) = (e**z - 1) / z and phi2(z) = (e**z - 1 - z) / z**2. By Cayley and
Hamilton each of them is f0 + f1 Z with two real numbers, found from the power
series of a halved Z and by doubling it again: one formula for modes that are
under-, critically and over-damped.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pounding_sweep.kernel.flight import ACCELERATION, WIDE, Layout, quintic_extreme
from pounding_sweep.kernel.peaks import cubic_extreme
from pounding_sweep.model.variants import Variants

#: Largest frequency or damping, times the step, for which the series is summed, and its number of terms:
#: 0.5**16 / 16! is below the last place.
_SMALL, _TERMS = 0.5, 16
#: Steps that are taken side by side with those of other parts of a record.
_BLOCK = 64
#: Share by which bounds are widened for the rounding of what is compared with them.
_MARGIN = {"float64": 1e-12, "float32": 4e-6}

#: f0 + f1 Z
_Function = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class _Modes:
    """Modes of all buildings, one building after another; each of shape (variants, modes)."""

    w: np.ndarray
    c: np.ndarray
    #: Of all masses of the building, as the scene has them: sum of m phi.
    participation: np.ndarray

    def over(self, times: np.ndarray) -> np.ndarray:
        """exp(F t) of each mode, row by row, for some times (s), shape (times, 4, variants, modes)."""
        t = times[:, None, None]
        square, damping = (self.w * t) ** 2, self.c * t
        (e0, e1), _, _ = _functions(square, damping)
        return np.stack([e0, t * e1, -(self.w**2) * t * e1, e0 - damping * e1], axis=1)

    def pushed(self, h: float) -> np.ndarray:
        """Return what the ground adds in a step: q, q' by its start, q, q' by its end, shape (4, variants, modes)."""
        damping = self.c * h
        _, (p0, p1), (q0, q1) = _functions((self.w * h) ** 2, damping)
        found = []
        for f0, f1 in ((p0 - q0, p1 - q1), (q0, q1)):
            found += [-(h**2) * f1, -h * (f0 - damping * f1)]
        return np.stack(found) * self.participation


def flight_tables(layout: Layout, row: Variants, ground: np.ndarray, h: float, precision: str) -> np.ndarray:
    """Return the tables of flight of all variants, shape (variants, numbers); `ground` at all points of the grid."""
    shape = np.zeros((layout.modes, layout.modes))
    w, c, taken = [], [], []
    for index, building in enumerate(row.scene.buildings):
        w.append(row.frequencies(index))
        a, b = row.rayleigh(index)
        c.append(a[:, None] + b[:, None] * w[-1] ** 2)
        at, n = sum(x.shape[1] for x in w[:-1]), building.n_storeys
        shapes, masses = building.modes[1], np.asarray(building.masses)
        shape[at : at + n, at : at + n] = shapes
        taken.append(masses @ shapes)
    modes = _Modes(np.concatenate(w, 1), np.concatenate(c, 1), np.concatenate(taken)[None])
    masses = np.concatenate([b.masses for b in row.scene.buildings])
    points = len(ground)
    tables = np.zeros((len(row), int(layout.size(points))), precision)
    still = _without_pounding(modes, ground, h)
    for v in range(len(row)):
        mine = _Modes(modes.w[v : v + 1], modes.c[v : v + 1], modes.participation)
        _fill(layout, tables[v], mine, shape, masses, (ground, h), still[..., v, :], row[v : v + 1])
    return tables


def _scan(step: np.ndarray, added: np.ndarray) -> np.ndarray:
    """All states of x' = A x + f from rest, of shape (2, n + 1, variants, modes) for f of shape (2, n, ...)."""
    n, rest = added.shape[1], added.shape[2:]
    blocks = -(-n // _BLOCK)
    f = np.zeros((2, blocks * _BLOCK, *rest))
    f[:, :n] = added
    f = f.reshape(2, blocks, _BLOCK, *rest)
    a, b, c, d = step
    local, powers = np.empty_like(f), np.empty((4, _BLOCK, *rest))
    q, p = np.zeros((2, blocks, *rest))
    e = np.broadcast_to(np.array([1.0, 0.0, 0.0, 1.0])[:, None, None], (4, *rest))
    for k in range(_BLOCK):
        q, p = a * q + b * p + f[0, :, k], c * q + d * p + f[1, :, k]
        local[0, :, k], local[1, :, k] = q, p
        e = np.stack([a * e[0] + b * e[2], a * e[1] + b * e[3], c * e[0] + d * e[2], c * e[1] + d * e[3]])
        powers[:, k] = e
    starts = np.zeros((2, blocks, *rest))
    for k in range(1, blocks):
        q, p = starts[:, k - 1]
        starts[0, k] = e[0] * q + e[1] * p + local[0, k - 1, -1]
        starts[1, k] = e[2] * q + e[3] * p + local[1, k - 1, -1]
    q, p = starts[:, :, None]
    local[0] += powers[0] * q + powers[1] * p
    local[1] += powers[2] * q + powers[3] * p
    states = local.reshape(2, -1, *rest)[:, :n]
    return np.concatenate([np.zeros((2, 1, *rest)), states], axis=1)


def _without_pounding(modes: _Modes, ground: np.ndarray, h: float) -> np.ndarray:
    """q, q' of all modes at all points of the grid, shape (2, points, variants, modes)."""
    q0, p0, q1, p1 = modes.pushed(h)
    g0, g1 = ground[:-1, None, None], ground[1:, None, None]
    return _scan(modes.over(np.array([h]))[0], np.stack([q0 * g0 + q1 * g1, p0 * g0 + p1 * g1]))


def _fill(
    layout: Layout,
    table: np.ndarray,
    modes: _Modes,
    floors: np.ndarray,
    masses: np.ndarray,
    base: tuple[np.ndarray, float],
    still: np.ndarray,
    row: Variants,
) -> None:
    """Fill the tables of one variant; `floors` are the shapes of the modes, shape (floors, modes)."""
    (ground, h), precision = base, str(table.dtype)
    w, c, part = modes.w[0], modes.c[0], modes.participation[0]
    n, points, lanes, q = layout.modes, len(ground), layout.lanes, len(layout.watched)

    def put(name: str, values: np.ndarray) -> None:
        """Put in values of shape (..., columns), padded to the width of the table."""
        where = layout.view(table, name, points).reshape(*values.shape[:-1], -1)
        where[..., : values.shape[-1]] = values

    put("inverse", np.array([1.0 / h**2]))
    put("slowness", 1.0 / w)
    put("square", (w * h) ** 2)
    put("damping", c * h)
    steps = modes.over(h * np.append(np.arange(lanes), WIDE))[:, :, 0]
    put("advance", steps)
    times = steps[:lanes].transpose(2, 1, 0).copy()
    times[:, 2:] *= h
    put("times", times)
    put("floors", floors.T)
    put("modal", floors * masses[:, None])
    kinds = np.array([each.kind for each in layout.watched], int)
    shape = np.array([each.weights for each in layout.watched]).reshape(q, n) @ floors
    put("shape", shape if q else np.zeros((1, n)))
    # what a mode of unit amplitude reaches at most, and its second and fourth rates: see the theory
    ratio = c / w
    near = np.sqrt(1.0 + ratio**2)
    far = np.hypot(near, 1.0 + ratio * near)
    shakes = (kinds == ACCELERATION)[:, None]
    size = np.abs(shape)
    bound = size * np.where(shakes, w**2 * near, 1.0)
    bulge = size * np.where(shakes, w**4 * near * far, w**2 * near) * (h**2 / 8.0)
    widened = 1.0 + 10.0 * _MARGIN[precision]
    put("bound", bound.T * widened)
    put("bulge", bulge.T * widened)
    g = ground[:, None]
    second = -(w**2) * still[0] - c * still[1] - part * g
    jerk = -(w**2) * still[1] - c * second
    slope = np.diff(ground, append=ground[-1])[:, None] / h
    amplitude = np.hypot(second, (jerk - part * slope) / w).max(axis=0)
    put("bulge0", (size * np.where(shakes, w**2 * near, 1.0) * amplitude).sum(axis=1) * (h**2 / 8.0) * widened)
    put("remainder", np.where(size > 0.0, (w * h) ** 2 * far / 48.0, 0.0).max(axis=1, initial=0.0))
    put("sized", np.array([each.sized for each in layout.watched], float))
    put("u", still[0] @ floors.T)
    put("v", still[1] @ floors.T)
    total = second + part * g
    moves = shape.T * (kinds != ACCELERATION)
    shaken = shape.T * (kinds == ACCELERATION)
    x = still[0] @ moves + total @ shaken
    rate = h * (still[1] @ moves + jerk @ shaken)
    bend = h**2 * (second @ moves)
    for name, values in (("x", x), ("rate", rate), ("second", bend)):
        put(name, np.pad(values.T, ((0, max(0, 1 - q)), (0, lanes)), mode="edge" if q else "constant"))
    _put_extremes(put, layout, x, rate, bend, precision)
    if "given" in layout.timed:
        owner = np.repeat(np.arange(len(row.scene.buildings)), [b.n_storeys for b in row.scene.buildings])
        _put_energies(put, modes, base, still, row.mass_factor[0], owner)


def _put_extremes(
    put: Callable[[str, np.ndarray], None],
    layout: Layout,
    x: np.ndarray,
    rate: np.ndarray,
    bend: np.ndarray,
    precision: str,
) -> None:
    """Extremes of windows from each point on, and of all that went before it."""
    x0, x1 = x[:-1], x[1:]
    inner, turns = x0.copy(), rate[:-1] * rate[1:] < 0.0
    turns, shaken = np.nonzero(turns), np.array([each.kind == ACCELERATION for each in layout.watched], bool)
    ends = [values[side][turns] for values in (x, rate, bend) for side in (slice(None, -1), slice(1, None))]
    with np.errstate(all="ignore"):
        inner[turns] = np.where(shaken[turns[1]], cubic_extreme(*ends[:4]), quintic_extreme(*ends))
    above, below = (f(f(x0, x1), inner) for f in (np.maximum, np.minimum))
    margin = _MARGIN[precision] * np.abs(x).max(axis=0, initial=0.0)
    up, down = ("most", "widest", "peak"), ("least", "widest_least", "trough")
    for sign, names, values in ((1.0, up, above), (-1.0, down, -below)):
        padded = np.concatenate([values, sign * x[-1:]])
        for name, length in zip(names, (layout.lanes - 1, WIDE), strict=False):
            put(name, sign * (_sliding(padded, length) + margin))
        put(names[2], sign * np.maximum.accumulate(np.concatenate([sign * x[:1], values]), axis=0))


def _sliding(x: np.ndarray, length: int) -> np.ndarray:
    """Largest of each row and those after it, `length` in all."""
    x, width = np.concatenate([x, np.full((length, x.shape[1]), -np.inf)]), 1
    while 2 * width <= length:
        x[:-width] = np.maximum(x[:-width], x[width:])
        width *= 2
    if width < length:
        x[: width - length] = np.maximum(x[: width - length], x[length - width :])
    return x[:-length]


def _put_energies(
    put: Callable[[str, np.ndarray], None],
    modes: _Modes,
    base: tuple[np.ndarray, float],
    still: np.ndarray,
    factors: np.ndarray,
    owner: np.ndarray,
) -> None:
    """Energy that the ground has put in without pounding, and what a free motion will still take from it."""
    ground, h = base
    w, c, part = modes.w[0], modes.c[0], modes.participation[0]
    weight = -part * factors[owner]
    g0, dg = ground[:-1, None], np.diff(ground)[:, None]
    q0, q1, p0, p1 = still[0, :-1], still[0, 1:], still[1, :-1], still[1, 1:]
    area = -(p1 - p0 + c * (q1 - q0) + part * (h * (g0 + 0.5 * dg))) / w**2
    given = weight * (g0 * (q1 - q0) + dg * (q1 - area / h))
    total = np.cumsum(np.concatenate([np.zeros((1, len(w))), given]), axis=0)
    put("given", np.stack([total[:, owner == b].sum(axis=1) for b in range(len(factors))], axis=1))
    a = modes.over(np.array([h]))[0, :, 0]
    e, f, end = np.stack([a[0] - 1.0, a[1]]), np.stack([a[2], a[3] - 1.0]), np.stack([a[0], a[1]])
    local = weight * (g0 * e[:, None] + dg * (end[:, None] + (f + c * e)[:, None] / (h * w**2)))
    back = _scan(np.stack([a[0], a[2], a[1], a[3]])[:, None], local[:, ::-1, None])[:, ::-1, 0]
    put("adjoint_q", back[0])
    put("adjoint_p", back[1])


def _functions(square: np.ndarray, damping: np.ndarray) -> tuple[_Function, _Function, _Function]:
    """exp, phi1 and phi2 of Z = [[0, 1], [-square, -damping]], elementwise."""
    # each by its own number of halvings, so that none depends on those beside it
    largest = np.maximum(np.maximum(np.sqrt(square), damping), _SMALL)
    halvings = np.ceil(np.log2(largest / _SMALL)).astype(int)
    scale = 0.5**halvings
    s, c = square * scale**2, damping * scale

    def times(f: _Function, g: _Function) -> _Function:  # Z**2 = -c Z - s
        both = f[1] * g[1]
        return f[0] * g[0] - s * both, f[0] * g[1] + f[1] * g[0] - c * both

    # Horner's rule for phi2, whose series is sum Z**i / (i + 2)!; the others follow from it
    f0, f1 = np.full_like(s, 1.0 / math.factorial(_TERMS + 1)), np.zeros_like(s)
    for i in range(_TERMS - 2, -1, -1):
        f0, f1 = 1.0 / math.factorial(i + 2) - s * f1, f0 - c * f1
    phi2 = f0, f1
    phi1 = 1.0 - s * f1, f0 - c * f1
    grown = 1.0 - s * phi1[1], phi1[0] - c * phi1[1]
    for k in range(int(halvings.max(initial=0))):
        more = halvings > k
        (a0, a1), (b0, b1) = times(phi1, phi1), times(grown, phi1)
        phi2 = _where(more, (0.25 * (a0 + 2.0 * phi2[0]), 0.25 * (a1 + 2.0 * phi2[1])), phi2)
        phi1 = _where(more, (0.5 * (b0 + phi1[0]), 0.5 * (b1 + phi1[1])), phi1)
        grown = _where(more, times(grown, grown), grown)
    return (grown[0], grown[1] * scale), (phi1[0], phi1[1] * scale), (phi2[0], phi2[1] * scale)


def _where(condition: np.ndarray, a: _Function, b: _Function) -> _Function:
    return np.where(condition, a[0], b[0]), np.where(condition, a[1], b[1])
