"""Building properties that vary from scenario to scenario: a scene and factors on it, which keep mode shapes.

- a period factor f multiplies all periods of a building: stiffnesses / f**2 (with P-Delta what weights leave of them),
  dashpots / f, masses and strengths kept;
- a mass factor multiplies its masses, stiffnesses, dashpots and strengths; both apply to its foundation too;
- a damping ratio replaces the ratios of the first two modes of all buildings;
- a strength factor multiplies the yield strengths of a building, a hardening replaces that of all its storeys;
- a ductility capacity factor multiplies the drifts at which its springs lose strength, a deterioration factor the
  reference drifts of their cyclic deterioration.

What dashpots and links couple has the state x = (Omega y, y') in the coordinates y of its undamped modes, and x' = A x
- b ag. A pair z1, z2 of A's modes, conjugate or both real, with z' = lambda z - Gamma ag, moves like one classical
mode: for q = t1 z1 + t2 z2 with t1 Gamma1 + t2 Gamma2 = 0

    q' = p,    p' = -w**2 q - c p - push ag,    w**2 = lambda1 lambda2,  c = -(lambda1 + lambda2).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from pounding_sweep.model.building import Building, Foundation, Infill
from pounding_sweep.model.meeting import column_softness, effective_mass
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.storeys import Numbers

#: Drift (m) of storeys that never yield or fall, in kernels.
ELASTIC = 1e30
#: Rows of linked buildings whose modes are found at a time.
_BLOCK = 4096
#: By number format: what rounding takes of a number, the largest error of modes that nearly coincide, and shares by
#: which damping grows unevenly where it is more.
FORMATS = {
    "float64": (2.0**-52, 1e-10, (1e-11, 1e-10, 1e-9, 1e-8, 1e-7)),
    "float32": (2.0**-23, 1e-5, (1e-7, 1e-6, 1e-5, 1e-4)),
}


def _scaled(
    read: Callable[[Building], Sequence[float]], mass: int = 0, period: int = 0, strength: int = 0
) -> cached_property[np.ndarray]:
    """Make a property of all buildings side by side, shape (n, ...): their numbers times powers of the factors."""

    def values(row: Variants) -> np.ndarray:
        factors = (row.mass_factor**mass / row.period_factor**period * row.strength_factor**strength).T
        parts = [np.outer(read(item), factor) for item, factor in zip(row.scene.buildings, factors, strict=True)]
        return np.concatenate(parts).T  # those of each number side by side in memory

    return cached_property(values)


def _of_base(name: str, **powers: int) -> cached_property[np.ndarray]:
    """Make a property of all foundations, sway and rocking of each, shape (n, 2 foundations)."""
    return _scaled(lambda building: getattr(building.foundation, name, ()), **powers)


@dataclass(frozen=True, eq=False)
class Variants:
    """A table of building properties, one row per variant of a scene."""

    scene: Scene
    #: Factors on all natural periods and on all masses, shape (n, buildings).
    period_factor: np.ndarray
    mass_factor: np.ndarray
    #: Damping ratio of all buildings, shape (n,); NaN: the scene's own.
    damping_ratio: np.ndarray
    #: Factors on all yield strengths, and hardening, NaN: the scene's own, shape (n, buildings).
    strength_factor: np.ndarray = None  # type: ignore[assignment]
    hardening: np.ndarray = None  # type: ignore[assignment]
    #: Factors on drifts at which strength is lost, and on reference drifts of deterioration, shape (n, buildings).
    ductility_capacity_factor: np.ndarray = None  # type: ignore[assignment]
    deterioration_factor: np.ndarray = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        ones = dict.fromkeys(("strength_factor", "ductility_capacity_factor", "deterioration_factor"), 1.0)
        for name, default in (ones | {"hardening": np.nan}).items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, np.broadcast_to(default, np.shape(self.period_factor)))

    def __len__(self) -> int:
        return len(self.damping_ratio)

    def __getitem__(self, rows: Any) -> Variants:
        if len(self) == 1:  # stands for any number of scenarios
            return self
        if isinstance(rows, slice) and rows.indices(len(self)) == (0, len(self), 1):  # with all that follows from it
            return self
        return Variants(self.scene, *(column[rows] for column in self.columns))

    @property
    def columns(self) -> tuple[np.ndarray, ...]:
        """All properties, in the order of the arguments."""
        return (
            *(self.period_factor, self.mass_factor, self.damping_ratio, self.strength_factor, self.hardening),
            *(self.ductility_capacity_factor, self.deterioration_factor),
        )

    def scene_of(self, row: int) -> Scene:
        """Return the scene whose buildings have the properties of a row themselves."""
        tables = {"masses": self.masses, "stiffnesses": self.elastic_stiffnesses, "dashpots": self.dashpots}
        tables |= {"yield_strengths": self.yield_strengths, "column_stiffnesses": self._column_stiffnesses}
        scaled = []
        for b, item in enumerate(self.scene.buildings):
            floors, names = slice(*self.scene.offsets[b : b + 2]), {n for n in tables if getattr(item, n) is not None}
            changed: dict[str, Any] = {name: tables[name][row, floors].tolist() for name in names}
            if b in self.scene.foundations:
                i = 2 * self.scene.foundations.index(b)
                bases = self.base_masses, self.base_stiffnesses, self.base_dashpots
                changed["foundation"] = Foundation(*np.concatenate([table[row, i : i + 2] for table in bases]))
            mass, period = self.mass_factor[row, b], self.period_factor[row, b]
            if item.stiffness_matrix is not None:  # with P-Delta what the weights leave of it is scaled by the period
                weights = np.subtract(item.stiffness_matrix, item.lateral_matrix)
                changed["stiffness_matrix"] = mass * (item.lateral_matrix / period**2 + weights)
            if item.damping_matrix is not None:
                changed["damping_matrix"] = mass / period * np.array(item.damping_matrix)
            factors = float(self.ductility_capacity_factor[row, b]), float(self.deterioration_factor[row, b])
            own, walls = (
                [element.with_factors(*factors) for element in elements]
                for elements in (item.elements, item.infill_elements)
            )
            if item.hysteresis is not None:
                changed["hysteresis"] = own if isinstance(item.hysteresis, tuple) else own[0]
            if item.infill is not None:
                k, strengths = (x[row, floors].tolist() for x in (self.infill_stiffnesses, self.infill_strengths))
                changed["infill"] = Infill(k, strengths, item.infill.hardening, item.infill.hysteresis and walls[0])
            ratio = "damping_ratio" if item.modal_damping is None else "modal_damping"
            varied = {ratio: self.damping_ratio[row], "hardening": self.hardening[row, b]}
            changed |= {name: float(value) for name, value in varied.items() if not np.isnan(value)}
            scaled.append(replace(item, **changed))
        buildings = iter(scaled)
        items = [next(buildings) if isinstance(item, Building) else item for item in self.scene.row]
        return replace(self.scene, row=items)

    def flights(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows whose motions without pounding differ from those before them, and of each row which of them it has."""
        properties = [*self.period_factor.T, np.where(np.isnan(self.damping_ratio), -1.0, self.damping_ratio)]
        properties += [*self.mass_factor.T] if self.scene.links else []  # links are what they are
        columns = np.array([column for column in properties if (column != column[0]).any()] or properties[:1])
        _, first, which = np.unique(columns, axis=1, return_index=True, return_inverse=True)
        return np.sort(first), np.argsort(np.argsort(first))[which.reshape(-1)]

    #: Floor masses (t), lateral storey stiffnesses (kN/m), with P-Delta less P / h, and P / h (kN/m).
    masses = _scaled(lambda building: building.masses, mass=1)
    stiffnesses = _scaled(lambda building: building.lateral_stiffnesses, mass=1, period=2)
    geometric_stiffnesses = _scaled(lambda building: building.geometric_stiffnesses, mass=1)
    #: Displacements of floors under a unit force on each (m/kN).
    flexibilities = _scaled(lambda b: [*np.linalg.inv(b.system_matrix).diagonal()[: b.n_storeys]], -1, -2)
    #: Yield strengths (kN), infinite where storeys never yield, and dashpots of storeys (kN s/m).
    yield_strengths = _scaled(lambda b: b.yield_strengths or (math.inf,) * b.n_storeys, mass=1, strength=1)
    dashpots = _scaled(lambda b: b.dashpots or (0.0,) * b.n_storeys, mass=1, period=1)
    #: Stiffnesses (kN/m) and strengths (kN) of infill, zeros without it.
    infill_stiffnesses = _scaled(lambda b: b.infill_stiffnesses, mass=1, period=2)
    infill_strengths = _scaled(lambda b: b.of_infill("yield_strengths"), mass=1, strength=1)
    #: Masses (t) and moments of inertia (t m2) of foundations, their stiffnesses (kN/m, kN m/rad) and dashpots.
    base_masses = _of_base("masses", mass=1)
    base_stiffnesses = _of_base("stiffnesses", mass=1, period=2)
    base_dashpots = _of_base("dashpots", mass=1, period=1)
    _column_stiffnesses = _scaled(lambda b: b.column_stiffnesses or b.storey_stiffnesses, mass=1, period=2)

    @cached_property
    def storey_heights(self) -> np.ndarray:
        """Heights of storeys (m), shape (floors,)."""
        return np.concatenate([b.storey_heights or () for b in self.scene.buildings])

    @cached_property
    def drift_limits(self) -> np.ndarray:
        """Drifts at which storeys fall (m), infinite where they never do, shape (floors,)."""
        return np.concatenate([b.drift_limits for b in self.scene.buildings])

    @cached_property
    def elastic_stiffnesses(self) -> np.ndarray:
        """Stiffnesses of the storeys themselves (kN/m), without infill, shape (n, floors)."""
        return self.own_stiffnesses + self.geometric_stiffnesses

    @cached_property
    def own_stiffnesses(self) -> np.ndarray:
        """Lateral stiffnesses of storeys (kN/m) without infill, shape (n, floors)."""
        return self.stiffnesses - self.infill_stiffnesses

    @cached_property
    def yield_drifts(self) -> np.ndarray:
        """Drifts at first yield (m), infinite where storeys never yield, shape (n, floors)."""
        return self.yield_strengths / self.elastic_stiffnesses

    @cached_property
    def elastic_hardenings(self) -> np.ndarray:
        """Hardening of the storeys themselves, shape (n, floors)."""
        varied = np.repeat(self.hardening, [b.n_storeys for b in self.scene.buildings], axis=1)
        of_scene = np.concatenate([b.hardenings for b in self.scene.buildings])
        return np.where(np.isnan(varied), of_scene, varied)

    @cached_property
    def hardenings(self) -> np.ndarray:
        """Lateral stiffness of storeys that yield over their elastic one, with P-Delta negative where they soften."""
        geometric, elastic = self.geometric_stiffnesses, self.elastic_hardenings
        left = (elastic * self.elastic_stiffnesses - geometric) / self.own_stiffnesses
        return np.where((geometric > 0.0) & np.isfinite(self.yield_strengths), left, elastic)

    def dense(self, name: str) -> np.ndarray:
        """Triangles of stiffness or damping matrices of all buildings that have one, shape (n, entries)."""
        parts = []
        for b, item in enumerate(self.scene.buildings):
            mass, period = self.mass_factor[:, b], self.period_factor[:, b]
            below = np.tril_indices(len(item.inertias))
            if name == "dense_k" and "k" in item.letters:
                parts.append(np.outer(mass / period**2, item.damping_matrices[1][below]))
            elif name == "dense_c" and item.letters not in ("", "k"):
                parts.append((mass / period)[:, None] * self._damping_matrices(b)[:, 3, *below])
        return np.concatenate(parts, axis=1)

    @cached_property
    def stiffness_factors(self) -> np.ndarray:
        """Factors on all stiffnesses of buildings, shape (n, buildings)."""
        return self.mass_factor / self.period_factor**2

    def softness(self, name: str) -> np.ndarray:
        """Square of the largest shear of each storey, or moment of each building, over twice the energy."""
        parts = []
        for item, factor in zip(self.scene.buildings, self.stiffness_factors.T, strict=True):
            rows = item.shears if name == "shear" else item.moment[None]
            parts.append(np.outer(1.0 / factor, np.diag(rows @ np.linalg.solve(item.system_matrix, rows.T))))
        return np.concatenate(parts, axis=1)

    @cached_property
    def spring_numbers(self) -> list[Numbers]:
        """What storey laws ask of each spring, shape (n,) each."""
        numbers, of_floors = [], np.repeat(np.arange(len(self.scene.buildings)), np.diff(self.scene.offsets))
        storeys = (self.own_stiffnesses, self.hardenings, self.yield_drifts)
        hardenings = np.concatenate([b.of_infill("hardening") for b in self.scene.buildings])[None]
        with np.errstate(divide="ignore", invalid="ignore"):  # of storeys without it
            infill = self.infill_stiffnesses, hardenings, self.infill_strengths / self.infill_stiffnesses
        for i, _, element, is_infill in self.scene.springs:
            stiffness, drift = element.stiffness_share, element.strength_share / element.stiffness_share
            k, r, dy = (table[:, i] for table in (infill if is_infill else storeys))
            weights = 0.0 if is_infill else stiffness * self.geometric_stiffnesses[:, i]
            factors = (x[:, of_floors[i]] for x in (self.ductility_capacity_factor, self.deterioration_factor))
            numbers.append(Numbers(stiffness * k, r, np.minimum(drift * dy, ELASTIC), weights, *factors))
        return numbers

    @cached_property
    def spring_constants(self) -> dict[str, np.ndarray]:
        """Constants of storey laws by name, shape (n, springs), zero for springs of other laws."""
        springs, result = self.scene.springs, dict[str, np.ndarray]()
        for e, (spring, numbers) in enumerate(zip(springs, self.spring_numbers, strict=True)):
            share = {"stiffness_share": numbers.stiffness / self.stiffnesses[:, spring.floor]}
            for name, values in (spring.law.values(spring.parameters, numbers) | share).items():
                result.setdefault(name, np.zeros((len(self), len(springs))))[:, e] = values
        return result

    @cached_property
    def frequencies(self) -> list[np.ndarray]:
        """Natural circular frequencies of buildings on their foundations (rad/s), rising, shape (n, modes) each."""
        buildings = enumerate(self.scene.buildings)
        return [(b.frequencies[:, None] / self.period_factor[:, i]).T for i, b in buildings]  # each mode's side by side

    @cached_property
    def systems(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Undamped frequencies (rad/s), rising, and decay 2 zeta w (1/s), (n, modes) each, of all that moves as one."""
        # dashpots of a single building on a fixed base are left out, linked buildings are one with theirs
        result, (first, which) = [], self.flights()
        for group in self.scene.linked_buildings:
            if len(group) > 1 or self.scene.buildings[group[0]].foundation:
                parts = []
                for k in range(0, len(first), _BLOCK):
                    *_, w, drag = self[first[k : k + _BLOCK]].modal(group)
                    parts.append((w, np.diagonal(drag, axis1=1, axis2=2).copy()))
                w, decay = (np.concatenate(arrays)[which] for arrays in zip(*parts, strict=True))
            else:
                w = self.frequencies[group[0]]
                decay = 2.0 * self.modal_damping(group[0]) * w
            result.append((w, decay))
        return result

    def matrices(self, group: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Masses (t), K (kN/m) and C (kN s/m) of what moves as one, shapes (n, floors and bases, ...)."""
        scene, dofs = self.scene, self.scene.dofs_of(group)
        masses = np.zeros((len(self), len(dofs)))
        stiff, damped = np.zeros((2, *masses.shape, len(dofs)))
        for b in group:
            item, at = scene.buildings[b], np.flatnonzero(np.isin(dofs, scene.dofs_of([b])))
            mass, period, (alpha, beta) = self.mass_factor[:, b], self.period_factor[:, b], self.rayleigh(b)
            masses[:, at] = np.outer(mass, item.inertias)
            stiff[:, at[:, None], at] = np.multiply.outer(mass / period**2, item.system_matrix)
            shares = np.stack([alpha * mass, beta * mass / period**2, mass / period, mass / period])
            damped[:, at[:, None], at] = np.einsum("pn,npij->nij", shares, self._damping_matrices(b))
        for link in scene.linked_floors:
            if link.left in dofs:
                across = 1.0 * (dofs == link.left) - (dofs == link.right)
                stiff += link.stiffness * np.outer(across, across)
                damped += link.damping * np.outer(across, across)
        return masses, stiff, damped

    def modal(self, group: tuple[int, ...]) -> tuple[np.ndarray, ...]:
        """Displacements by undamped modes of what moves as one, modes by displacements, frequencies, and C of modes."""
        masses, stiff, damped = self.matrices(group)
        root = np.sqrt(masses)
        values, shapes = np.linalg.eigh(stiff / root[:, :, None] / root[:, None, :])
        light, heavy = shapes / root[:, :, None], np.swapaxes(shapes, 1, 2) * root[:, None, :]
        return light, heavy, np.sqrt(np.maximum(values, 0.0)), np.swapaxes(light, 1, 2) @ damped @ light

    def _damping_matrices(self, building: int) -> np.ndarray:
        """Return what Rayleigh's factors, dashpots and modes damp: `Building.damping_matrices`, of each row or one."""
        item, ratio = self.scene.buildings[building], self.damping_ratio
        if item.modal_damping is None or np.isnan(ratio).all():
            return item.damping_matrices[None]
        result = np.repeat(item.damping_matrices[None], len(self), axis=0)
        varied = ~np.isnan(ratio)
        result[varied, 3] = np.multiply.outer(ratio[varied], item.damping_of_modes(1.0))
        return result

    def modal_damping(self, building: int) -> np.ndarray:
        """Damping ratios of a building's modes, of its dashpots only if it has a foundation, shape (n, modes)."""
        item, period = self.scene.buildings[building], self.period_factor[:, building, None]
        w, shapes = item.modes
        shares = np.einsum("im,npij,jm->pnm", shapes, self._damping_matrices(building), shapes) / (2.0 * w)
        (a, b), (mass, stiff, dashpots, dense) = self.rayleigh(building), shares
        others = dense + dashpots * (item.foundation is not None)
        return a[:, None] * mass * period + b[:, None] * stiff / period + others

    def rayleigh(self, building: int) -> tuple[np.ndarray, np.ndarray]:
        """Factors (a, b) of C = a M + b K of a building (1/s, s), shape (n,) each."""
        a, b = self.rayleigh_factors
        return a[:, building], b[:, building]

    @cached_property
    def rayleigh_factors(self) -> tuple[np.ndarray, np.ndarray]:
        """Factors (a, b) of C = a M + b K of all buildings (1/s, s), shape (n, buildings) each."""
        buildings = self.scene.buildings
        scene_factors = np.array([building.rayleigh for building in buildings]).T
        unit = np.array([building.rayleigh_of((1.0, 1.0)) for building in buildings]).T
        ratio = self.damping_ratio[:, None]
        a, b = (np.where(np.isnan(ratio), x, ratio * y) for x, y in zip(scene_factors, unit, strict=True))
        return a / self.period_factor, b * self.period_factor

    @cached_property
    def contact_masses(self) -> np.ndarray:
        """Effective masses of all contacts (t), the floor's own at a wall, shape (n, contacts)."""
        contacts = self.scene.contacts
        masses = [effective_mass(contact.ends, self.masses.T) for contact in contacts]
        return np.array(masses).T.reshape(len(self), len(contacts))

    def contact_stiffnesses(self, stiffness: np.ndarray) -> np.ndarray:
        """Stiffness of each contact (kN/m**exponent), shape (n, contacts): in series with struck columns."""
        scene = self.scene
        columns = self._column_stiffnesses
        result = scene.of_contacts(stiffness)
        for j, contact in enumerate(scene.contacts):
            if contact.struck >= 0:
                k = columns[:, (contact.left, contact.right)[contact.struck]]
                result[:, j] /= 1.0 + column_softness(contact.xi) * result[:, j] / k
        return result


def variants_of(row: Scene | Variants) -> Variants:
    """Return a table of variants; of a scene as given, its one row stands for any number of scenarios."""
    return row if isinstance(row, Variants) else _single_variant(row)


@lru_cache(maxsize=16)
def _single_variant(scene: Scene) -> Variants:
    """One row, kept with all that follows from it."""
    ones, none = np.ones((1, len(scene.buildings))), np.array([np.nan])
    ones.flags.writeable = none.flags.writeable = False
    return Variants(scene, ones, ones, none)


@dataclass(frozen=True)
class CoupledModes:
    """Modes of a row of buildings, of some variants."""

    #: of the equation of each mode; shape (variants, modes)
    w: np.ndarray
    c: np.ndarray
    push: np.ndarray
    floors: np.ndarray  # displacements by q and p, velocities by q and p, shape (variants, 4, floors, modes)
    modal: np.ndarray  # q by displacements and velocities, p by both, shape (variants, 4, modes, floors)
    error: np.ndarray  # share by which states may change on their way to modes and back, shape (variants,)


def coupled_modes(row: Variants, precision: str = "float64") -> CoupledModes:
    """Return the modes of a row for a kernel's number format, one group of buildings that move as one after another."""
    scene, count, at = row.scene, len(row), 0
    n = scene.n_moving
    w, c, push, error = (np.empty((count, n)) for _ in range(4))
    floors, modal = np.zeros((count, 4, n, n)), np.zeros((count, 4, n, n))
    for group in scene.linked_buildings:
        light, heavy, omega, drag = row.modal(group)
        cols, dofs = slice(at, at := at + (half := omega.shape[1])), scene.dofs_of(group)
        rotations = (dofs >= scene.n_dof) & ((dofs - scene.n_dof) % 2 == 1)  # which the ground does not push
        load = heavy[:, :, ~rotations].sum(axis=2)
        w[:, cols], c[:, cols], push[:, cols], x, y, worst = _modes_of(omega, drag, load, precision)
        error[:, cols] = worst[:, None]
        pairs = [(k, j) for k in (0, 1) for j in (0, 1)]
        to, back = (light / omega[:, None, :], light), (omega[:, :, None] * heavy, heavy)
        floors[:, :, dofs, cols] = np.stack([to[k] @ x[:, j, k * half : (k + 1) * half] for k, j in pairs], 1)
        modal[:, :, cols, dofs] = np.stack([y[:, k, :, j * half : (j + 1) * half] @ back[j] for k, j in pairs], 1)
    return CoupledModes(w, c, push, floors, modal, error.max(axis=1))


def _modes_of(omega: np.ndarray, drag: np.ndarray, load: np.ndarray, precision: str) -> list[np.ndarray]:
    """Modes of groups of undamped frequencies, damping and load in undamped modes, as `_pairs` returns them."""
    rounding, largest, nudges = FORMATS[precision]
    modes = _pairs(omega, drag, load, rounding)
    # modes that coincide without being independent: those of a damping next to it
    uneven = np.sqrt(np.arange(1.0, omega.shape[1] + 1.0))
    for nudge in nudges:
        poor = np.flatnonzero(modes[-1] > largest)
        if not len(poor):
            break
        grown = 1.0 + nudge * uneven
        others = _pairs(omega[poor], drag[poor] * grown[:, None] * grown, load[poor], rounding)
        others[-1] = np.maximum(others[-1], nudge)
        better = others[-1] < modes[-1][poor]
        for mode, other in zip(modes, others, strict=True):
            mode[poor[better]] = other[better]
    return modes


def _pairs(omega: np.ndarray, drag: np.ndarray, load: np.ndarray, rounding: float) -> list[np.ndarray]:
    """Return w, c and push of pairs of modes of x' = A x - b ag, slowest first, and how far they are from what A does.

    Before the last, states by q and p, shape (n, 2, 2 modes, modes), and q and p by states.
    """
    count, n = omega.shape
    a = np.zeros((count, 2 * n, 2 * n))
    every = np.arange(n)
    a[:, every, n + every], a[:, n + every, every] = omega, -omega
    a[:, n:, n:] = -drag
    values, right = (array.astype(complex) for array in np.linalg.eig(a))
    try:
        left = np.linalg.inv(right)
    except np.linalg.LinAlgError:
        left = np.linalg.pinv(right)
    gamma = np.einsum("nmi,ni->nm", left[:, :, n:], load.astype(complex))
    # real modes lie in pairs of those that the ground moves alike; conjugate ones do from the start
    order = np.argsort(np.where(values.imag == 0.0, -np.abs(gamma), 1.0), axis=1, kind="stable")
    pairs = np.arange(count)[:, None], order
    values, gamma = (array[pairs].reshape(count, n, 2) for array in (values, gamma))
    left, right = (array[pairs].reshape(count, n, 2, 2 * n) for array in (left, np.swapaxes(right, 1, 2)))
    w = np.sqrt(np.prod(values, axis=2).real)
    c = np.maximum(-values.sum(axis=2).real, 0.0)
    turned = np.where(values.imag[..., :1] == 0.0, 1.0, 1.0j)
    still = np.abs(gamma).max(axis=2, keepdims=True) < 1e-12 * np.linalg.norm(load, axis=1)[:, None, None]
    t = np.where(still, 1.0, turned * gamma[..., ::-1] * np.array([1.0, -1.0]))
    with np.errstate(all="ignore"):
        per = 1.0 / (t * (values[..., ::-1] - values))
        x = np.stack([np.einsum("nmji,nmj->nim", right, part).real for part in (per * values[..., ::-1], -per)], 1)
        unit = np.stack([w, np.ones_like(w)], 1)
        spread = np.linalg.norm(x, axis=2) / unit
        size = 0.5 * spread.sum(axis=1)
        x, t, spread = x / size[:, None, None, :], t * size[..., None], spread / size[:, None]
        y = np.stack([np.einsum("nmji,nmj->nmi", left, part).real for part in (t, t * values)], 1)
        push = np.sum(t * values * gamma, axis=2).real
        again = x[:, 0] @ y[:, 1] - (x[:, 1] * (w**2)[:, None, :]) @ y[:, 0] - (x[:, 1] * c[:, None, :]) @ y[:, 1]
        missed = np.abs(again - a).max(axis=(1, 2)) / np.abs(a).max(axis=(1, 2))
        missed = np.maximum(missed, np.abs(x[:, 0] @ y[:, 0] + x[:, 1] @ y[:, 1] - np.eye(2 * n)).max(axis=(1, 2)))
        back = np.linalg.norm(y, axis=3) * unit
        error = np.maximum(missed, rounding * (spread * back).sum(axis=(1, 2)))
    slow = np.argsort(w, axis=1)
    w, c, push = (np.take_along_axis(array, slow, 1) for array in (w, c, push))
    x, y = np.take_along_axis(x, slow[:, None, None, :], 3), np.take_along_axis(y, slow[:, None, :, None], 2)
    return [w, c, push, x, y, np.where(np.isfinite(error), error, np.inf)]
