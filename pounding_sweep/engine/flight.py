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
import threading
from dataclasses import dataclass

import numpy as np

from pounding_sweep.engine.kernel import MARGIN
from pounding_sweep.kernel.flight import ACCELERATION, WIDE, Layout
from pounding_sweep.model.variants import Variants

#: Largest frequency or damping, times the step, for which the series is summed, and its number of terms:
#: 0.5**16 / 16! is below the last place.
_SMALL, _TERMS = 0.5, 16

#: Memory of each thread.
_KEPT = threading.local()

#: f0 + f1 Z
_Function = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class _Modes:
    """Modes of all buildings, one building after another; each of shape (variants, modes)."""

    w: np.ndarray
    c: np.ndarray
    #: Sum of m phi over the floors, of the masses as the scene has them.
    participation: np.ndarray
    #: Mass of the building's first floor (t), as the scene has it.
    first_mass: np.ndarray

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


def flight_tables(layout: Layout, points: int, fixed: np.ndarray) -> np.ndarray:
    """Return tables of flight over so many points with all that a kernel does not fill in itself, one after another."""
    # they stand until the thread's next call
    tables = _room(len(fixed) * int(layout.size(points)), str(fixed.dtype))
    tables.reshape(len(fixed), -1)[:, : layout.sizes[0]] = fixed
    return tables


def fixed_tables(
    layout: Layout, row: Variants, ground: np.ndarray, h: float, precision: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return what of the tables of all variants holds at any time, and what a kernel fills the others from."""
    # `ground`: accelerations (m/s2) at all points of a grid of step `h` (s)
    scene, n, count, q = row.scene, layout.modes, len(row), len(layout.watched)
    modes, floors = _modes(row)
    tables = np.zeros((count, layout.sizes[0]), precision)

    def put(name: str, values: np.ndarray) -> None:
        """Put in values of shape (variants or 1, ..., columns), padded to the width of the table."""
        at = layout.first[name]
        where = tables[:, at : at + layout.fixed[name]].reshape(count, *values.shape[1:-1], -1)
        where[..., : values.shape[-1]] = values

    w, c = modes.w, modes.c
    put("step", np.array([[h]]))
    put("inverse", np.array([[1.0 / h**2]]))
    put("slowness", 1.0 / w)
    put("square", (w * h) ** 2)
    put("damping", c * h)
    put("push", modes.participation * h**2)
    steps = modes.over(h * np.append(np.arange(layout.lanes), WIDE))
    put("advance", steps.transpose(2, 0, 1, 3))
    times = steps[: layout.lanes].transpose(2, 3, 1, 0).copy()
    times[:, :, 2:] *= h
    put("times", times)
    masses = np.concatenate([b.masses for b in scene.buildings])
    put("floors", floors.T[None])
    put("modal", (floors * masses[:, None])[None])
    kinds = np.array([each.kind for each in layout.watched], int)
    shape = np.array([each.weights for each in layout.watched]).reshape(q, n) @ floors
    if q:
        put("shape", shape[None])
        put("across", shape.T[None])
    # what a mode of unit amplitude reaches at most, and its second and fourth rates: see the theory
    ratio = (c / w)[:, :, None]
    near = np.sqrt(1.0 + ratio**2)
    far = np.hypot(near, 1.0 + ratio * near)
    shakes, square = kinds == ACCELERATION, w[:, :, None] ** 2
    widened = np.abs(shape.T)[None] * (1.0 + 10.0 * MARGIN[precision])
    put("bound", widened * np.where(shakes, square * near, 1.0))
    put("bulge", widened * np.where(shakes, square**2 * near * far, square * near) * (h**2 / 8.0))
    missed = np.where(widened > 0.0, square * h**2 * far / 48.0, 0.0)
    put("remainder", missed.max(axis=1, initial=0.0))
    put("sized", np.array([[each.sized for each in layout.watched]], float))
    put("shaken", shakes[None].astype(float))
    return tables, _decays(layout, modes, ground, h)


def _room(numbers: int, precision: str) -> np.ndarray:
    """Room for tables, the same again for each call of a thread: new memory costs as much as filling it."""
    kept: np.ndarray | None = getattr(_KEPT, precision, None)
    if kept is None or len(kept) < numbers:
        kept = np.empty(numbers, precision)
        setattr(_KEPT, precision, kept)
    return kept[:numbers]


def _modes(row: Variants) -> tuple[_Modes, np.ndarray]:
    """Return the modes of all buildings, and their shapes, shape (floors, modes)."""
    n = sum(b.n_storeys for b in row.scene.buildings)
    floors = np.zeros((n, n))
    w, c, taken, first, at = [], [], [], [], 0
    for index, building in enumerate(row.scene.buildings):
        w.append(row.frequencies(index))
        a, b = row.rayleigh(index)
        c.append(a[:, None] + b[:, None] * w[-1] ** 2)
        here = slice(at, at := at + building.n_storeys)
        floors[here, here] = building.modes[1]
        taken.append(np.asarray(building.masses) @ building.modes[1])
        first += [building.masses[0]] * building.n_storeys
    modes = _Modes(np.concatenate(w, 1), np.concatenate(c, 1), np.concatenate(taken)[None], np.array(first)[None])
    return modes, floors


def _decays(layout: Layout, modes: _Modes, ground: np.ndarray, h: float) -> np.ndarray:
    """Rows of modes from which a kernel finds the motion without pounding, after the ground's accelerations."""
    w, c = modes.w, modes.c
    a = modes.over(np.array([h]))[0]
    found = dict(zip(("qq", "qp", "pq", "pp"), a, strict=True))
    found |= dict(zip(("q0", "p0", "q1", "p1"), modes.pushed(h), strict=True))
    found |= {"square": w**2, "damping": c, "slowness": 1.0 / w, "push": modes.participation}
    # energies of a unit mass at the first floor
    weight, area = -modes.participation / modes.first_mass, 1.0 / (h * w**2)
    found |= {"weight": weight, "area": area}
    found |= {"adjoint_q": weight * (a[0] - 1.0), "adjoint_p": weight * a[1]}
    found |= {
        "adjoint_rise_q": weight * (a[0] + area * (a[2] + c * (a[0] - 1.0))),
        "adjoint_rise_p": weight * (a[1] + area * (a[3] - 1.0 + c * a[1])),
    }
    rows = np.zeros((len(w), len(layout.decays), layout.wide_modes))
    for k, name in enumerate(layout.decays):
        rows[:, k, : layout.modes] = found[name]
    return np.concatenate([[h, 1.0 / h], ground, rows.ravel()])


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
