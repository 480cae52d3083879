"""Tables of free flight, of any number of variants of a scene at once.

What a kernel is given of them; it fills in how modes decay and what moves, by
`pounding_sweep.kernel.modal_steps`.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from pounding_sweep.engine.kernel import MARGIN
from pounding_sweep.kernel.flight import ACCELERATION, STATE, TO_FLOORS, TO_MODES, WIDE, Layout, nodes
from pounding_sweep.kernel.modal_steps import step
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import CoupledModes, Variants, coupled_modes

#: Most points of the grid in a long step.
LONGEST = 4

#: Bytes that the processor fetches at once, twice; and of the widest vector that a kernel has.
LINE = 128
#: Memory of each thread.
_KEPT = threading.local()


@dataclass(frozen=True, eq=False)
class Fixed:
    """What of the tables of rows of buildings holds at any time."""

    shared: np.ndarray  # the same of all rows of buildings
    own: np.ndarray  # those of each; shape (rows, numbers)


@dataclass(frozen=True)
class _Modes:
    """Modes of all buildings, one building after another; each of shape (variants, modes)."""

    w: np.ndarray
    c: np.ndarray
    #: Sum of m phi over the floors, of the masses as the scene has them.
    participation: np.ndarray
    #: Mass of the building's first floor (t), as the scene has it; NaN where modes are coupled.
    first_mass: np.ndarray | float = math.nan


def aligned(numbers: int, precision: str) -> np.ndarray:
    """Return room for numbers, none of whose vectors lies across two lines of the processor's cache."""
    room = np.empty(numbers + LINE, precision)
    first = -room.ctypes.data % LINE // room.itemsize
    return room[first : first + numbers]


def flight_tables(layout: Layout, stops: int, fixed: Fixed, stay: bool = False) -> np.ndarray:
    """Return tables of flight over so many points or blocks, with all that a kernel does not fill in itself."""
    # those that do not `stay` stand until the thread's next call
    precision, count = str(fixed.own.dtype), len(fixed.own)
    rows = -(-count // layout.lanes) * layout.lanes if layout.strides else count  # filled side by side in lanes
    numbers = layout.start + rows * int(layout.size(stops))
    tables = aligned(numbers, precision) if stay else _room(numbers, precision, precision)
    tables[: layout.start] = fixed.shared
    tables[layout.start :].reshape(rows, -1)[:count, : layout.given] = fixed.own
    return tables


def filled_tables(fixed: Fixed) -> np.ndarray | None:
    """Return the tables that this thread's latest call to fill some has filled with these `fixed` ones."""
    last, tables = getattr(_KEPT, "filled", (None, None))
    return tables if last is fixed else None


def keep_filled(fixed: Fixed, tables: np.ndarray) -> None:
    """Keep tables that a call has filled for this thread's next one."""
    _KEPT.filled = fixed, tables


def fixed_tables(
    layout: Layout, row: Variants, ground: np.ndarray, h: float, precision: str, substeps: int = 1
) -> tuple[Fixed, np.ndarray]:
    """Return what of the tables of all variants holds at any time, and what a kernel fills the others from."""
    # `ground`: accelerations (m/s2) at all points of a grid of step `h` (s), linear between every one of `substeps`
    coupled = coupled_modes(row, precision) if layout.coupled else None
    if coupled is None:
        shared, push, first_masses = _shared_tables(layout, row.scene, h, precision)
        every = range(len(row.scene.buildings))
        w = np.concatenate([row.frequencies[b].T for b in every]).T  # each mode's side by side
        a, b = (
            np.repeat(each.T, [b.n_storeys for b in row.scene.buildings], axis=0).T for each in row.rayleigh_factors
        )
        modes = _Modes(w, a + b * w**2, push, first_masses)
    else:
        shared, modes = np.zeros(layout.start, precision), _Modes(coupled.w, coupled.c, coupled.push)
    fixed = Fixed(shared, np.zeros((len(row), layout.given), precision))

    def put(name: str, values: np.ndarray) -> None:
        """Put in values of each row of buildings, shape (variants, ..., columns), padded to the width of the table."""
        _put(layout, name, fixed.own, values)

    w, c = modes.w, modes.c
    put("slowness", 1.0 / w)
    put("square", (w * h) ** 2)
    put("damping", c * h)
    if coupled is not None:
        _put_shared(layout, shared, h)
        put("push", modes.participation * h**2)
        _put_coupled(layout, row, coupled, h, precision, put)
        return fixed, np.concatenate([[h, 1.0 / h, 1.0, WIDE], ground, _decays(layout, modes, h)])
    # what a mode of unit amplitude reaches at most, and its second and fourth rates: see the theory
    ratio, square = c / w, w**2
    near = np.sqrt(1.0 + ratio**2)
    far = np.sqrt(near**2 + (1.0 + ratio * near) ** 2)
    put("bend", square * near * (h**2 / 8.0))
    put("missed", square**2 * near * far * (h**4 / 384.0))
    if layout.strides:  # of what a block leaves chords by; else the kernel finds it
        most = [(square * near)[:, low : low + many].max(axis=1) for low, many in layout.ranges]
        put("missed0", np.stack(most, axis=1) * (h**2 / 48.0) if most else np.zeros((len(w), 1)))
    if "shake" in layout.fixed:
        put("shake", square * near)
        put("shake_bend", square**2 * near * far * (h**2 / 8.0))
    if layout.strides:
        return fixed, _in_lanes(layout, modes, ground, h, substeps)
    return fixed, np.concatenate([[h, 1.0 / h, 1.0, WIDE], ground, _decays(layout, modes, h)])


def _put(layout: Layout, name: str, tables: np.ndarray, values: np.ndarray) -> None:
    """Put values into a table of a name, padded to its width; shape (rows of buildings, ..., columns)."""
    width = layout.fixed.get(name) or layout.shared[name]
    _, first = layout.places[name]
    where = tables[:, first : first + width]
    where.reshape(*values.shape[:-1], -1)[..., : values.shape[-1]] = values


def _put_shared(layout: Layout, shared: np.ndarray, h: float, **by_modes: np.ndarray) -> None:
    """Put in what is the same of all rows of buildings."""
    values: dict[str, Any] = {"step": [h], "inverse": [1.0 / h**2], **by_modes}
    values |= {"sized": [float(each.sized) for each in layout.watched]}
    values |= {"shaken": [float(each.kind == ACCELERATION) for each in layout.watched]}
    for name, each in values.items():
        if name in layout.shared and np.size(each):
            _put(layout, name, shared[None], np.asarray(each)[None])


@lru_cache(maxsize=16)
def _shared_tables(layout: Layout, scene: Scene, h: float, precision: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what all variants of a scene share; what pushes their modes; masses of first floors."""
    buildings, storeys = scene.buildings, [b.n_storeys for b in scene.buildings]
    floors, at = np.zeros((sum(storeys), sum(storeys))), 0
    for building in buildings:
        here = slice(at, at := at + building.n_storeys)
        floors[here, here] = building.modes[1]
    masses = np.concatenate([b.masses for b in buildings])
    push, first = masses @ floors, np.repeat([b.masses[0] for b in buildings], storeys)
    shape = np.array([each.weights for each in layout.watched]).reshape(-1, sum(storeys)) @ floors
    shakes = np.array([each.kind == ACCELERATION for each in layout.watched], bool)
    widened = np.abs(shape.T) * (1.0 + 10.0 * MARGIN[precision])
    by_modes = {"push": push * h**2, "floors": floors.T, "modal": floors * masses[:, None]}
    by_modes |= {"shape": shape, "across": shape.T}
    by_modes |= {"bound": np.where(shakes, 0.0, widened), "bound_shaken": np.where(shakes, widened, 0.0)}
    shared = np.zeros(layout.start, precision)
    _put_shared(layout, shared, h, **by_modes)
    return shared, push[None], first[None]


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
    for name, share in (("bound", 1.0), ("bulge", h**2 / 8.0), ("missed", h**4 / 384.0)):
        put(name, np.linalg.norm(both, axis=3) * (widened * share))
        both = both @ twice
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
        a = step(modes.w, modes.c, modes.participation, share * h)
        (q0, q1), (p0, p1) = ((a[f"{name}0"], a[f"{name}1"]) for name in "qp")
        ground = [(q0 + (1.0 - share) * q1, share * q1), (p0 + (1.0 - share) * p1, share * p1)]
        found.append(np.stack([a["qq"], a["qp"] / h, *ground[0], a["pq"], a["pp"] / h, *ground[1]], axis=2))
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
        kept = aligned(numbers, precision)
        setattr(_KEPT, name, kept)
    return kept[:numbers]


def _decays(layout: Layout, modes: _Modes, h: float) -> np.ndarray:
    """Rows of modes from which a kernel finds the motion without pounding, of each variant."""
    w, c = modes.w, modes.c
    a = step(w, c, modes.participation, h)
    found = a | {"square": w**2, "damping": c, "slowness": 1.0 / w, "push": modes.participation}
    if "weight" in layout.decays:  # energies of a unit mass at the first floor
        weight, area = -modes.participation / modes.first_mass, 1.0 / (h * w**2)
        found |= {"weight": weight, "area": area}
        found |= {"adjoint_q": weight * (a["qq"] - 1.0), "adjoint_p": weight * a["qp"]}
        found |= {
            "adjoint_rise_q": weight * (a["qq"] + area * (a["pq"] + c * (a["qq"] - 1.0))),
            "adjoint_rise_p": weight * (a["qp"] + area * (a["pp"] - 1.0 + c * a["qp"])),
        }
    rows = np.zeros((len(w), len(layout.decays), layout.wide_modes))
    for k, name in enumerate(layout.decays):
        rows[:, k, : layout.modes] = found[name]
    return rows.ravel()


def _in_lanes(layout: Layout, modes: _Modes, ground: np.ndarray, h: float, substeps: int) -> np.ndarray:
    """Return what a kernel finds the motions of variants from, side by side in lanes, and room for what it finds."""
    lanes, n, (count, _) = layout.lanes, layout.modes, modes.w.shape
    stride, groups, names = stride_of(substeps), -(-count // lanes), len(layout.strides)
    head = [h, 1.0 / (stride * h), stride, layout.block // stride * stride, *ground, *modes.participation[0]]
    head += [0.0] * (layout.wide_modes - n)
    numbers = groups * n * lanes * (names + STATE * stops_of(layout, len(ground), substeps))
    numbers += (groups * lanes * len(layout.decays) + STATE) * layout.wide_modes
    found = _room(len(head) + numbers, "decays")
    found[: len(head)], found[-STATE * layout.wide_modes :] = head, 0.0
    rows = found[len(head) :][: groups * names * n * lanes].reshape(groups, names, n, lanes)
    those = np.minimum(np.arange(groups * lanes), count - 1)  # idle lanes repeat the last one
    for k, each in enumerate((modes.w, modes.c)):
        rows[:, k] = each.T[:, those].reshape(n, groups, lanes).transpose(1, 0, 2)
    return found


def stride_of(substeps: int) -> int:
    """Points of the grid in a long step, of so many in a record interval."""
    return next(n for n in range(LONGEST, 0, -1) if substeps % n == 0)


def stops_of(layout: Layout, points: int, substeps: int) -> int:
    """How many points or blocks the tables of a grid of so many points have."""
    if not layout.strides:
        return points
    stride = stride_of(substeps)
    return -(-(points - 1) // (layout.block // stride * stride))
