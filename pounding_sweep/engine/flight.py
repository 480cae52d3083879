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
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pounding_sweep.engine.kernel import MARGIN
from pounding_sweep.kernel.flight import ACCELERATION, STATE, TO_FLOORS, TO_MODES, WIDE, Layout
from pounding_sweep.kernel.flight_blocks import BUNDLE
from pounding_sweep.kernel.flight_energies import nodes
from pounding_sweep.model.coupled_modes import CoupledModes, coupled_modes
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
    #: Mass of the building's first floor (t), as the scene has it; NaN where modes are coupled.
    first_mass: np.ndarray | float = math.nan

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

    def compact(self) -> tuple[_Modes, Callable[[dict[str, np.ndarray], list[str]], np.ndarray]]:
        """Return modes that are the same in all variants once, in one row with all others, and what spreads values."""
        shape = self.w.shape
        given = [np.broadcast_to(each, shape) for each in (self.w, self.c, self.participation, self.first_mass)]
        varies = np.any([(each[1:] != each[:1]).any(axis=0) for each in (self.w, self.c, self.participation)], axis=0)

        def spread(found: dict[str, np.ndarray], names: list[str]) -> np.ndarray:
            """Return values of those names of all modes, shape (names, variants, modes)."""
            values, each = np.empty((len(names), *shape)), np.concatenate([found[name] for name in names])
            many = shape[0] * int(varies.sum())
            values[:, :, varies] = each[:, :many].reshape(len(names), shape[0], -1)
            values[:, :, ~varies] = each[:, None, many:]
            return values

        return _Modes(*(np.concatenate([x[:, varies].ravel(), x[0, ~varies]])[None] for x in given)), spread


def room_for_tables(layout: Layout, stops: int, count: int, precision: str) -> np.ndarray:
    """Room for the tables of flight of so many rows of buildings, until the thread's next call."""
    return _room(count * int(layout.size(stops)), precision, precision)


def flight_tables(layout: Layout, stops: int, fixed: np.ndarray, stay: bool = False) -> np.ndarray:
    """Return tables of flight over so many points or blocks, with all that a kernel does not fill in itself."""
    # those that do not `stay` stand until the thread's next call
    precision, numbers = str(fixed.dtype), len(fixed) * int(layout.size(stops))
    tables = np.empty(numbers, precision) if stay else room_for_tables(layout, stops, len(fixed), precision)
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
    layout: Layout,
    row: Variants,
    ground: np.ndarray,
    h: float,
    precision: str,
    substeps: int = 1,
    room: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return what of the tables of all variants holds at any time, and what a kernel fills the others from."""
    # `ground`: accelerations (m/s2) at all points of a grid of step `h` (s), linear between every one of `substeps`;
    # `room`: of whole tables, which the first lie in then
    scene, n, count, q = row.scene, layout.modes, len(row), len(layout.watched)
    coupled = coupled_modes(row, precision) if layout.coupled else None
    modes, floors = _modes(row) if coupled is None else (_Modes(coupled.w, coupled.c, coupled.push), None)
    tables = np.empty((count, layout.given), precision) if room is None else room.reshape(count, -1)[:, : layout.given]
    tables[:] = 0.0

    def put(name: str, values: np.ndarray, times: np.ndarray | float = 1.0) -> None:
        """Put in values of shape (variants or 1, ..., columns), padded to the width of the table."""
        at = layout.first[name]
        where = tables[:, at : at + layout.fixed[name]].reshape(count, *values.shape[1:-1], -1)
        np.multiply(values, times, out=where[..., : values.shape[-1]], casting="same_kind")

    w, c = modes.w, modes.c
    put("step", np.array([[h]]))
    put("inverse", np.array([[1.0 / h**2]]))
    put("slowness", 1.0 / w)
    put("square", (w * h) ** 2)
    put("damping", c * h)
    put("push", modes.participation * h**2)
    kinds = np.array([each.kind for each in layout.watched], int)
    put("sized", np.array([[each.sized for each in layout.watched]], float))
    put("shaken", (kinds == ACCELERATION)[None].astype(float))
    if coupled is not None:
        _put_coupled(layout, row, coupled, h, precision, put)
        return tables, np.concatenate([[h, 1.0 / h, 1.0, WIDE], ground, _decays(layout, modes, h)[0]])
    assert floors is not None
    masses = np.concatenate([b.masses for b in scene.buildings])
    put("floors", floors.T[None])
    put("modal", (floors * masses[:, None])[None])
    shape = np.array([each.weights for each in layout.watched]).reshape(q, n) @ floors
    if q:
        put("shape", shape[None])
    if q and "across" in layout.fixed:
        put("across", shape.T[None])
    # what a mode of unit amplitude reaches at most, and its second and fourth rates: see the theory
    ratio, square = c / w, w**2
    near = np.sqrt(1.0 + ratio**2)
    far = np.sqrt(near**2 + (1.0 + ratio * near) ** 2)
    shakes = kinds == ACCELERATION
    widened = np.abs(shape.T)[None] * (1.0 + 10.0 * MARGIN[precision])

    def weighed(shaken: np.ndarray, moved: np.ndarray) -> np.ndarray:
        return np.where(shakes, shaken[:, :, None], moved[:, :, None]) if shakes.any() else moved[:, :, None]

    put("bound", widened, weighed(square * near, np.ones((1, n))))
    put("bulge", widened, weighed(square**2 * near * far * (h**2 / 8.0), square * near * (h**2 / 8.0)))
    missed, remainder = square * far * (h**2 / 48.0), np.zeros((count, q))
    mine = [tuple(np.flatnonzero(each).tolist()) for each in widened[0].T]
    for part in set(mine):
        remainder[:, [each == part for each in mine]] = missed[:, list(part)].max(axis=1, initial=0.0, keepdims=True)
    put("remainder", remainder)
    stride = stride_of(substeps)
    own, strides = _decays(layout, modes, h, stride)
    if not layout.strides:
        return tables, np.concatenate([[h, 1.0 / h, 1.0, WIDE], ground, own])
    block = layout.block // stride * stride
    parts = np.array([h, 1.0 / (stride * h), stride, block]), ground, own, strides
    numbers, states = sum(len(part) for part in parts), len(strides) // len(layout.strides) * STATE
    decays = _room(numbers + states * stops_of(layout, len(ground), substeps) + STATE * layout.wide_modes, "decays")
    np.concatenate(parts, out=decays[:numbers])
    return tables, decays


def _put_coupled(
    layout: Layout, row: Variants, modes: CoupledModes, h: float, precision: str, put: Callable[[str, np.ndarray], None]
) -> None:
    """Put in what coupled modes do to floors and to what is watched; those of velocities are times the step."""
    w, c, n, q = modes.w, modes.c, layout.modes, len(layout.watched)
    uq, up, vq, vp = np.moveaxis(modes.floors, 1, 0)
    for k, (floors, modal) in enumerate(zip(TO_FLOORS, TO_MODES, strict=True)):
        put(floors, np.swapaxes(modes.floors[:, k], 1, 2))
        put(modal, np.swapaxes(modes.modal[:, k], 1, 2))
    shakes = np.array([each.kind == ACCELERATION for each in layout.watched], bool)
    moved = np.array([each.weights for each in layout.watched]).reshape(q, n)
    pulled = np.array([each.rates or (0.0,) * n for each in layout.watched]).reshape(q, n)

    def along(u: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return all that is watched by q or p, of displacements, velocities and rates of velocities by them."""
        return np.where(shakes[:, None], moved @ a, moved @ u + pulled @ v)

    by_q, by_p = along(uq, vq, -(w**2)[:, None] * vp), along(up, vp, vq - c[:, None] * vp)
    for name, values in (("", by_q), ("_rate", by_p / h)) if q else ():
        put(f"shape{name}", values)
        if "across" in layout.fixed:
            put(f"across{name}", np.swapaxes(values, 1, 2))
    # (w q, p) moves by `turn`; what a mode of unit amplitude reaches at most, and its second and fourth rates
    turn = np.zeros((*w.shape, 2, 2))
    turn[..., 0, 1], turn[..., 1, 0], turn[..., 1, 1] = w, -w, -c
    twice = turn @ turn
    both = np.stack([by_q, w[:, None] * by_p], axis=3).swapaxes(1, 2)
    widened = 1.0 + 10.0 * MARGIN[precision]
    reach = [np.linalg.norm(each, axis=3) * widened for each in (both, both @ twice)]
    put("bound", reach[0])
    put("bulge", reach[1] * (h**2 / 8.0))
    missed = np.where(reach[0] > 0.0, np.linalg.norm(twice, 2, axis=(2, 3))[:, :, None] * (h**2 / 48.0), 0.0)
    put("remainder", missed.max(axis=1, initial=0.0))
    if layout.powers:
        put("powers", _power_shapes(layout, row, modes).reshape(len(w), -1))
        put("nodes", _node_steps(layout, _Modes(w, c, modes.push), h).reshape(len(w), -1))
    if "sets" in layout.fixed:
        put("sets", _sets(row).reshape(len(w), -1))


def _power_shapes(layout: Layout, row: Variants, modes: CoupledModes) -> np.ndarray:
    """Factors of powers by q and by q' of all modes, shape (variants, factors, 2, modes)."""
    scene, n, found = row.scene, layout.modes, []
    uq, up, vq, vp = np.moveaxis(modes.floors, 1, 0)
    masses = np.concatenate([b.masses for b in scene.buildings])
    for power in layout.powers:
        weights, moves = np.zeros(n), power.kind != "stretch"
        if power.kind == "momentum":
            floors = slice(*scene.offsets[power.number : power.number + 2])
            weights[floors] = masses[floors] / masses[floors.start]
        else:
            link = scene.linked_floors[power.number]
            weights[link.left] += power.kind != "right"
            weights[link.right] += {"stretch": -1.0, "left": 0.0, "right": 1.0}[power.kind]
        found.append(np.stack([weights @ each for each in ((vq, vp) if moves else (uq, up))], axis=1))
    return np.stack(found, axis=1)


def _node_steps(layout: Layout, modes: _Modes, h: float) -> np.ndarray:
    """How modes move from a point to each Gauss node of the step, shape (variants, modes, nodes, numbers)."""
    found = []
    for share in nodes(layout.nodes)[0]:
        over, (q0, p0, q1, p1) = modes.step(share * h)
        ground = [(q0 + (1.0 - share) * q1, share * q1), (p0 + (1.0 - share) * p1, share * p1)]
        found.append(np.stack([over[0], over[1] / h, *ground[0], over[2], over[3] / h, *ground[1]], axis=2))
    return np.stack(found, axis=2)


def _sets(row: Variants) -> np.ndarray:
    """Displacements at which a row rests whose storeys have drifts without shear, shape (variants, floors, storeys)."""
    n, at = row.scene.n_dof, 0
    found = np.zeros((len(row), n, n))
    for group in row.scene.linked_buildings:
        _, stiff, _ = row.matrices(group)
        here = slice(at, at := at + stiff.shape[1])
        bottom = [s == 0 for b in group for s in range(row.scene.buildings[b].n_storeys)]
        drift = np.eye(len(bottom)) - np.diag([0.0 if first else 1.0 for first in bottom[1:]], -1)
        found[:, here, here] = np.linalg.solve(stiff, drift.T * row.stiffnesses[:, None, here])
    return found


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


def _decays(layout: Layout, modes: _Modes, h: float, stride: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Rows of modes from which a kernel finds the motion without pounding, of each variant; those of `_strides`."""
    modes, spread = modes.compact()
    w, c = modes.w, modes.c
    a, pushed = modes.step(h)
    bends = {"square": w**2, "damping": c, "slowness": 1.0 / w, "push": modes.participation}
    found = _moves(a, pushed) | bends
    if "weight" in layout.decays:  # energies of a unit mass at the first floor
        weight, area = -modes.participation / modes.first_mass, 1.0 / (h * w**2)
        found |= {"weight": weight, "area": area}
        found |= {"adjoint_q": weight * (a[0] - 1.0), "adjoint_p": weight * a[1]}
        found |= {
            "adjoint_rise_q": weight * (a[0] + area * (a[2] + c * (a[0] - 1.0))),
            "adjoint_rise_p": weight * (a[1] + area * (a[3] - 1.0 + c * a[1])),
        }
    values = spread(found, layout.decays)
    rows = np.zeros((values.shape[1], len(layout.decays), layout.wide_modes))
    rows[:, :, : layout.modes] = values.transpose(1, 0, 2)
    if not layout.strides:
        return rows.ravel(), np.empty(0)
    long = _moves(*modes.step(stride * h)) if stride > 1 else found
    long = long | bends | {"heft": w**2 * np.sqrt(1.0 + (c / w) ** 2)}
    return rows.ravel(), _strides(layout, spread(long, layout.strides[:-1]))


def _moves(over: np.ndarray, added: np.ndarray) -> dict[str, np.ndarray]:
    """Numbers of a step by their names."""
    return dict(zip(("qq", "qp", "pq", "pp", "q0", "p0", "q1", "p1"), (*over, *added), strict=True))


def _strides(layout: Layout, values: np.ndarray) -> np.ndarray:
    """Rows of variants side by side in lanes, from which a kernel finds their motion in long steps."""
    lanes, (names, count, modes) = layout.lanes, values.shape
    groups = -(-count // lanes)
    those = np.minimum(np.arange(groups * lanes), count - 1)  # idle lanes repeat the last one
    rows = np.ones((groups, names + 1, modes, lanes))
    rows[:, :-1] = values[:, those].reshape(names, groups, lanes, modes).transpose(1, 0, 3, 2)
    # modes that move otherwise than those of the group before, or are the first of all that are filled together
    rows[1:, -1] = (rows[1:, :-1] != rows[:-1, :-1]).any(axis=(1, 3))[..., None]
    rows[::BUNDLE, -1] = 1.0
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
