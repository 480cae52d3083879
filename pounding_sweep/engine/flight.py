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
from pounding_sweep.kernel.flight import ACCELERATION, STATE, WIDE, Layout
from pounding_sweep.model.variants import Variants

#: Largest frequency or damping, times the step, for which the series is summed, and its number of terms:
#: 0.5**16 / 16! is below the last place.
_SMALL, _TERMS = 0.5, 16

#: Most points of the grid in a long step.
LONGEST = 4

#: Memory of each thread.
_KEPT = threading.local()
#: Filled tables that a thread keeps for its next calls, at most (bytes).
FILLED_BYTES = 1 << 24

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

    def step(self, h: float) -> tuple[np.ndarray, np.ndarray]:
        """Motion over one step of `h` (s), as rows of four numbers of each mode, shape (4, variants, modes).

        exp(F h), row by row, and what the ground adds: q, q' by its start, q, q' by its end.
        """
        square, damping = (self.w * h) ** 2, self.c * h
        (e0, e1), (p0, p1), (q0, q1) = _functions(square, damping)
        over = np.stack([e0, h * e1, -(self.w**2) * h * e1, e0 - damping * e1])
        added = []
        for f0, f1 in ((p0 - q0, p1 - q1), (q0, q1)):
            added += [-(h**2) * f1, -h * (f0 - damping * f1)]
        return over, np.stack(added) * self.participation


def flight_tables(layout: Layout, stops: int, fixed: np.ndarray, stay: bool = False) -> np.ndarray:
    """Return tables of flight over so many points or blocks, with all that a kernel does not fill in itself."""
    # those that do not `stay` stand until the thread's next call
    precision, numbers = str(fixed.dtype), len(fixed) * int(layout.size(stops))
    tables = np.empty(numbers, precision) if stay else _room(numbers, precision, precision)
    tables.reshape(len(fixed), -1)[:, : layout.given] = fixed
    return tables


def filled_tables(fixed: np.ndarray) -> np.ndarray | None:
    """Return the tables that a call of this thread has filled with these `fixed` ones, if they are still there."""
    kept: list[tuple[np.ndarray, np.ndarray]] = getattr(_KEPT, "filled", [])
    return next((tables for of, tables in kept if of is fixed), None)


def keep_tables(fixed: np.ndarray, tables: np.ndarray) -> None:
    """Keep tables that are filled, the latest of this thread that find room."""
    kept = [(fixed, tables), *((of, those) for of, those in getattr(_KEPT, "filled", []) if of is not fixed)]
    while sum(those.nbytes for _, those in kept) > FILLED_BYTES:
        kept.pop()
    _KEPT.filled = kept


def fixed_tables(
    layout: Layout, row: Variants, ground: np.ndarray, h: float, precision: str, substeps: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Return what of the tables of all variants holds at any time, and what a kernel fills the others from."""
    # `ground`: accelerations (m/s2) at all points of a grid of step `h` (s), linear between every one of `substeps`
    scene, n, count, q = row.scene, layout.modes, len(row), len(layout.watched)
    modes, floors = _modes(row)
    tables = np.zeros((count, layout.given), precision)

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
    masses = np.concatenate([b.masses for b in scene.buildings])
    put("floors", floors.T[None])
    put("modal", (floors * masses[:, None])[None])
    kinds = np.array([each.kind for each in layout.watched], int)
    shape = np.array([each.weights for each in layout.watched]).reshape(q, n) @ floors
    if q:
        put("shape", shape[None])
    if q and "across" in layout.fixed:
        put("across", shape.T[None])
    # what a mode of unit amplitude reaches at most, and its second and fourth rates: see the theory
    ratio, square = c / w, w**2
    near = np.sqrt(1.0 + ratio**2)
    far = np.hypot(near, 1.0 + ratio * near)
    shakes = kinds == ACCELERATION
    widened = np.abs(shape.T)[None] * (1.0 + 10.0 * MARGIN[precision])

    def weighed(shaken: np.ndarray, moved: np.ndarray) -> np.ndarray:
        return widened * (
            np.where(shakes, shaken[:, :, None], moved[:, :, None]) if shakes.any() else moved[:, :, None]
        )

    put("bound", weighed(square * near, np.ones_like(w)))
    put("bulge", weighed(square**2 * near * far, square * near) * (h**2 / 8.0))
    missed = np.where(widened > 0.0, (square * far)[:, :, None] * (h**2 / 48.0), 0.0)
    put("remainder", missed.max(axis=1, initial=0.0))
    put("sized", np.array([[each.sized for each in layout.watched]], float))
    put("shaken", shakes[None].astype(float))
    own = _decays(layout, modes, h)
    if not layout.strides:
        return tables, np.concatenate([[h, 1.0 / h, 1.0, WIDE], ground, own])
    stride = stride_of(substeps)
    block = layout.block // stride * stride
    parts = [h, 1.0 / (stride * h), stride, block], ground, own, _strides(layout, modes, stride * h)
    given, states = np.concatenate(parts), len(parts[-1]) // len(layout.strides) * STATE
    room = _room(len(given) + states * stops_of(layout, len(ground), substeps) + STATE * layout.wide_modes, "decays")
    room[: len(given)] = given
    return tables, room


def _room(numbers: int, name: str, precision: str = "float64") -> np.ndarray:
    """Room of a name, the same again for each call of a thread: new memory costs as much as filling it."""
    kept: np.ndarray | None = getattr(_KEPT, name, None)
    if kept is None or len(kept) < numbers:
        kept = np.empty(numbers, precision)
        setattr(_KEPT, name, kept)
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


def _decays(layout: Layout, modes: _Modes, h: float) -> np.ndarray:
    """Rows of modes from which a kernel finds the motion without pounding, of each variant."""
    w, c = modes.w, modes.c
    a, pushed = modes.step(h)
    found = dict(zip(("qq", "qp", "pq", "pp"), a, strict=True))
    found |= dict(zip(("q0", "p0", "q1", "p1"), pushed, strict=True))
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
    return rows.ravel()


def _strides(layout: Layout, modes: _Modes, h: float) -> np.ndarray:
    """Rows of variants side by side in lanes, from which a kernel finds their motion in long steps."""
    lanes, w, c = layout.lanes, modes.w, modes.c
    a, pushed = modes.step(h)
    found = dict(zip(("qq", "qp", "pq", "pp"), a, strict=True))
    found |= dict(zip(("q0", "p0", "q1", "p1"), pushed, strict=True))
    found |= {"square": w**2, "damping": c, "slowness": 1.0 / w, "push": modes.participation}
    found |= {"heft": w**2 * np.sqrt(1.0 + (c / w) ** 2)}
    groups = -(-len(w) // lanes)
    those = np.minimum(np.arange(groups * lanes), len(w) - 1)  # idle lanes repeat the last one
    rows = np.empty((groups, len(layout.strides), layout.modes, lanes))
    for k, name in enumerate(layout.strides):
        values = np.broadcast_to(found[name], w.shape)[those]
        rows[:, k] = values.reshape(groups, lanes, layout.modes).transpose(0, 2, 1)
    return rows.ravel()


def stride_of(substeps: int) -> int:
    """Points of the grid in a long step, of so many in a record interval."""
    return next(n for n in range(LONGEST, 0, -1) if substeps % n == 0)


def stops_of(layout: Layout, points: int, substeps: int) -> int:
    """How many points or blocks the tables of a grid of so many points have."""
    if not layout.strides:
        return points
    stride = stride_of(substeps)
    return -(-(points - 1) // (layout.block // stride * stride))


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
