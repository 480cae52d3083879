"""Tables of free flight, of any number of variants of a scene at once.

What a kernel is given of them; it fills in how modes decay and what moves, by
`pounding_sweep.kernel.modal_steps`.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass

import numpy as np

from pounding_sweep.engine.kernel import MARGIN
from pounding_sweep.kernel.flight import ACCELERATION, STATE, TO_FLOORS, TO_MODES, WIDE, Layout, nodes
from pounding_sweep.kernel.modal_steps import step
from pounding_sweep.model.variants import CoupledModes, Variants, coupled_modes

#: Most points of the grid in a long step.
LONGEST = 4

#: Bytes that the processor fetches at once, twice; and of the widest vector that a kernel has.
LINE = 128
#: Memory of each thread.
_MEMORY = threading.local()


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
    memory = np.empty(numbers + LINE, precision)
    first = -memory.ctypes.data % LINE // memory.itemsize
    return memory[first : first + numbers]


def flight_tables(
    layout: Layout,
    row: Variants,
    stops: int,
    ground: np.ndarray,
    h: float,
    precision: str,
    substeps: int = 1,
    stay: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Return tables of flight over so many points or blocks, and what a kernel fills the rest of them from."""
    # `ground`: accelerations (m/s2) at all points of a grid of step `h` (s), linear between every one of `substeps`;
    # both stand until the thread's next call, tables that `stay` as long as they are used
    count = len(row)
    if layout.coupled:
        coupled = coupled_modes(row, precision)
        modes = _Modes(coupled.w, coupled.c, coupled.push)
        values = _values_of_coupled(layout, row, coupled, h, precision)
    else:
        modes, values = _values_of_single(layout, row, h, precision)
    values |= {"slowness": 1.0 / modes.w, "square": (modes.w * h) ** 2, "damping": modes.c * h}
    values |= {"step": np.array([h]), "inverse": np.array([1.0 / h**2])}
    values["sized"] = np.array([float(item.sized) for item in layout.watched])
    values["shaken"] = _shakes(layout).astype(float)
    rows = -(-count // layout.lanes) * layout.lanes if layout.strides else count  # filled side by side in lanes
    size = layout.start + rows * int(layout.size(stops))
    tables = aligned(size, precision) if stay else _reused(size, precision, precision)
    varying = tables[layout.start :].reshape(rows, -1)[:count, : layout.n_precomputed]
    tables[: layout.start], varying[:] = 0.0, 0.0
    for name, numbers in values.items():  # each last axis is padded to the width of its table
        by_row = name in layout.fixed
        if numbers.size and (by_row or name in layout.shared):
            table, many = (varying, layout.fixed) if by_row else (tables[None], layout.shared)
            part = numbers if by_row else numbers[None]
            _, first = layout.places[name]
            place = table[:, first : first + many[name]].reshape(*part.shape[:-1], -1)
            place[..., : part.shape[-1]] = part
    if layout.strides:
        return tables, _in_lanes(layout, modes, ground, h, substeps)
    return tables, np.concatenate([[h, 1.0 / h, 1.0, WIDE], ground, _decays(layout, modes, h)])


def _shakes(layout: Layout) -> np.ndarray:
    """Whether each quantity that is watched is a total acceleration."""
    return np.array([item.kind == ACCELERATION for item in layout.watched], bool)


def _values_of_single(layout: Layout, row: Variants, h: float, precision: str) -> tuple[_Modes, dict[str, np.ndarray]]:
    """Return the modes of buildings that move by themselves, and what they do to floors and to what is watched."""
    buildings, storeys, n = row.scene.buildings, [b.n_storeys for b in row.scene.buildings], row.scene.n_dof
    floors, masses = np.zeros((n, n)), np.concatenate([b.masses for b in buildings])
    for building, at in zip(buildings, row.scene.offsets, strict=False):
        here = slice(at, at + building.n_storeys)
        floors[here, here] = building.modes[1]
    push = masses @ floors
    shape = np.array([item.weights for item in layout.watched]).reshape(-1, n) @ floors
    shakes, widened = _shakes(layout), np.abs(shape.T) * (1.0 + 10.0 * MARGIN[precision])
    w = np.concatenate([row.frequencies[b].T for b in range(len(buildings))]).T  # each mode's side by side
    decays = np.concatenate([2.0 * row.modal_damping(b).T for b in range(len(buildings))]).T * w
    modes = _Modes(w, decays, push[None], np.repeat([b.masses[0] for b in buildings], storeys)[None])
    # what a mode of unit amplitude reaches at most, and its second and fourth rates: see the theory
    ratio, square = modes.c / w, w**2
    near = np.sqrt(1.0 + ratio**2)
    far = np.sqrt(near**2 + (1.0 + ratio * near) ** 2)
    values = {
        "push": push * h**2,
        "floors": floors.T,
        "modal": floors * masses[:, None],
        "shape": shape,
        "across": shape.T,
        "bound": np.where(shakes, 0.0, widened),
        "bound_shaken": np.where(shakes, widened, 0.0),
        "bend": square * near * (h**2 / 8.0),
        "missed": square**2 * near * far * (h**4 / 384.0),
        "shake": square * near,
        "shake_bend": square**2 * near * far * (h**2 / 8.0),
    }
    if layout.strides and layout.ranges:  # of what a block leaves chords by; else the kernel finds it
        most = [(square * near)[:, low : low + many].max(axis=1) for low, many in layout.ranges]
        values["missed0"] = np.stack(most, axis=1) * (h**2 / 48.0)
    return modes, values


def _values_of_coupled(
    layout: Layout, row: Variants, modes: CoupledModes, h: float, precision: str
) -> dict[str, np.ndarray]:
    """Return what coupled modes do to floors and to what is watched; those of velocities are times the step."""
    w, c, n, q = modes.w, modes.c, layout.modes, len(layout.watched)
    uq, up, vq, vp = np.moveaxis(modes.floors, 1, 0)
    values = {"push": modes.push * h**2}
    for k, (floors, modal) in enumerate(zip(TO_FLOORS, TO_MODES, strict=True)):
        values |= {floors: np.swapaxes(modes.floors[:, k], 1, 2), modal: np.swapaxes(modes.modal[:, k], 1, 2)}
    shakes = _shakes(layout)
    moved = np.array([item.weights for item in layout.watched]).reshape(q, n)
    pulled = np.array([item.rates or (0.0,) * n for item in layout.watched]).reshape(q, n)

    def along(u: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Return all that is watched by q or p, of displacements, velocities and rates of velocities by them."""
        return np.where(shakes[:, None], moved @ a, moved @ u + pulled @ v)

    by_q, by_p = along(uq, vq, -(w**2)[:, None] * vp), along(up, vp, vq - c[:, None] * vp)
    for name, by_mode in (("", by_q), ("_rate", by_p / h)):
        values |= {f"shape{name}": by_mode, f"across{name}": np.swapaxes(by_mode, 1, 2)}
    # (w q, p) moves by `turn`; what a mode of unit amplitude reaches at most, and its second and fourth rates
    turn = np.zeros((*w.shape, 2, 2))
    turn[..., 0, 1], turn[..., 1, 0], turn[..., 1, 1] = w, -w, -c
    twice = turn @ turn
    paired = np.stack([by_q, w[:, None] * by_p], axis=3).swapaxes(1, 2)
    widened = 1.0 + 10.0 * MARGIN[precision]
    for name, share in (("bound", 1.0), ("bulge", h**2 / 8.0), ("missed", h**4 / 384.0)):
        values[name] = np.linalg.norm(paired, axis=3) * (widened * share)
        paired = paired @ twice
    if layout.powers:
        values["powers"] = _power_shapes(layout, row, modes).reshape(len(w), -1)
        values["nodes"] = _node_steps(layout, _Modes(w, c, modes.push), h).reshape(len(w), -1)
    if "sets" in layout.fixed:
        values["sets"] = _sets(row).reshape(len(w), -1)
    return values


def _power_shapes(layout: Layout, row: Variants, modes: CoupledModes) -> np.ndarray:
    """Factors of powers by q and by q' of all modes, shape (variants, factors, 2, modes)."""
    scene, n, shapes = row.scene, layout.modes, []
    uq, up, vq, vp = np.moveaxis(modes.floors, 1, 0)
    masses = np.concatenate([b.masses for b in scene.buildings])
    for power in layout.powers:
        weights, moves = np.zeros(n), power.kind != "stretch"
        if power.kind == "momentum":
            floors = slice(*scene.offsets[power.number : power.number + 2])
            weights[floors] = masses[floors] / masses[floors.start]
            if (foundation := scene.buildings[power.number].foundation) is not None:
                weights[scene.dofs_of([power.number])[-2]] = foundation.mass / masses[floors.start]
        else:
            link = scene.linked_floors[power.number]
            weights[link.left] += power.kind != "right"
            weights[link.right] += {"stretch": -1.0, "left": 0.0, "right": 1.0}[power.kind]
        shapes.append(np.stack([weights @ item for item in ((vq, vp) if moves else (uq, up))], axis=1))
    return np.stack(shapes, axis=1)


def _node_steps(layout: Layout, modes: _Modes, h: float) -> np.ndarray:
    """How modes move from a point to each Gauss node of the step, shape (variants, modes, nodes, numbers)."""
    steps = []
    for share in nodes(layout.nodes)[0]:
        a = step(modes.w, modes.c, modes.participation, share * h)
        (q0, q1), (p0, p1) = ((a[f"{name}0"], a[f"{name}1"]) for name in "qp")
        ground = [(q0 + (1.0 - share) * q1, share * q1), (p0 + (1.0 - share) * p1, share * p1)]
        steps.append(np.stack([a["qq"], a["qp"] / h, *ground[0], a["pq"], a["pp"] / h, *ground[1]], axis=2))
    return np.stack(steps, axis=2)


def _sets(row: Variants) -> np.ndarray:
    """Displacements at which a row rests whose storeys have drifts without shear, shape (variants, dofs, storeys)."""
    scene, drifts = row.scene, row.scene.of_buildings("drifts")
    rest = np.zeros((len(row), scene.n_moving, scene.n_dof))
    for group in scene.linked_buildings:
        dofs = scene.dofs_of(group)
        floors = dofs[dofs < scene.n_dof]
        pushed = drifts[np.ix_(floors, dofs)].T * row.stiffnesses[:, None, floors]
        rest[np.ix_(np.arange(len(row)), dofs, floors)] = np.linalg.solve(row.matrices(group)[1], pushed)
    return rest


def _reused(numbers: int, name: str, precision: str = "float64") -> np.ndarray:
    """Room of a name, the same again for each call of a thread: new memory costs as much as filling it."""
    memory: np.ndarray | None = getattr(_MEMORY, name, None)
    if memory is None or len(memory) < numbers:
        memory = aligned(numbers, precision)
        setattr(_MEMORY, name, memory)
    return memory[:numbers]


def _decays(layout: Layout, modes: _Modes, h: float) -> np.ndarray:
    """Rows of modes from which a kernel finds the motion without pounding, of each variant."""
    w, c = modes.w, modes.c
    a = step(w, c, modes.participation, h)
    values = a | {"square": w**2, "damping": c, "slowness": 1.0 / w, "push": modes.participation}
    if "weight" in layout.decays:  # energies of a unit mass at the first floor
        weight, area = -modes.participation / modes.first_mass, 1.0 / (h * w**2)
        values |= {
            "weight": weight,
            "area": area,
            "adjoint_q": weight * (a["qq"] - 1.0),
            "adjoint_p": weight * a["qp"],
            "adjoint_rise_q": weight * (a["qq"] + area * (a["pq"] + c * (a["qq"] - 1.0))),
            "adjoint_rise_p": weight * (a["qp"] + area * (a["pp"] - 1.0 + c * a["qp"])),
        }
    rows = np.zeros((len(w), len(layout.decays), layout.wide_modes))
    for k, name in enumerate(layout.decays):
        rows[:, k, : layout.modes] = values[name]
    return rows.ravel()


def _in_lanes(layout: Layout, modes: _Modes, ground: np.ndarray, h: float, substeps: int) -> np.ndarray:
    """Return what a kernel finds the motions of variants from, side by side in lanes, and room for what it finds."""
    lanes, n, (count, _) = layout.lanes, layout.modes, modes.w.shape
    stride, groups, names = stride_of(substeps), -(-count // lanes), len(layout.strides)
    head = [h, 1.0 / (stride * h), stride, layout.block // stride * stride, *ground, *modes.participation[0]]
    head += [0.0] * (layout.wide_modes - n)
    numbers = groups * n * lanes * (names + STATE * stops_of(layout, len(ground), substeps))
    numbers += (groups * lanes * len(layout.decays) + STATE) * layout.wide_modes
    memory = _reused(len(head) + numbers, "decays")
    memory[: len(head)], memory[-STATE * layout.wide_modes :] = head, 0.0
    rows = memory[len(head) :][: groups * names * n * lanes].reshape(groups, names, n, lanes)
    those = np.minimum(np.arange(groups * lanes), count - 1)  # idle lanes repeat the last one
    for k, item in enumerate((modes.w, modes.c)):
        rows[:, k] = item.T[:, those].reshape(n, groups, lanes).transpose(1, 0, 2)
    return memory


def stride_of(substeps: int) -> int:
    """Points of the grid in a long step, of so many in a record interval."""
    return next(n for n in range(LONGEST, 0, -1) if substeps % n == 0)


def stops_of(layout: Layout, points: int, substeps: int) -> int:
    """How many points or blocks the tables of a grid of so many points have."""
    if not layout.strides:
        return points
    stride = stride_of(substeps)
    return -(-(points - 1) // (layout.block // stride * stride))
