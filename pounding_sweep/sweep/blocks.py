"""Between scenes and kernels: what a kernel needs of a scene, and what its lanes mean.

A `RowKernel` is a scene under one law and one scheme, ready to run any number
of scenarios side by side; `variables_of` turns what its lanes hold into the
variables of the cube.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from pounding_sweep.contact.laws import Law
from pounding_sweep.cube.assemble import inner_shape, scatter_contact, scatter_dof
from pounding_sweep.cube.variables import Status, cube_variables, get_variable
from pounding_sweep.kernels.shape import (
    CONTACT_REDUCERS,
    LANES,
    KernelShape,
    LawShape,
    input_slots,
    output_slots,
    property_slots,
)
from pounding_sweep.records import Record
from pounding_sweep.scene import Scene
from pounding_sweep.sweep.resolution import MAX_ENERGY, displacement_limit, energy_limit, resolution_status

#: Largest product of an exact flight step and a modal frequency, of a building's first mode, its second and all
#: others: peaks are looked for between the ends by a cubic, which errs by (w h)**4 / 384 of what a mode contributes.
GLIDE = (0.3, 0.8, 1.2)
#: The same where accelerations are asked for, in which high modes weigh more.
ACCELERATION_GLIDE = (0.2, 0.3, 0.5)


@dataclass(frozen=True)
class Numerics:
    """How scenarios are integrated.

    Attributes
    ----------
    method : {"rk4", "newmark", "exact"}
        Scheme.
    dt : float
        Largest time step (s); a record interval is cut into equal steps no longer than it.
    locate : bool
        Locate contacts and peaks inside the step.
    beta, gamma : float
        Newmark's parameters.
    precision : {"float64", "float32"}
        Number format of the kernel.
    """

    method: str
    dt: float
    locate: bool = True
    beta: float = 0.25
    gamma: float = 0.5
    precision: str = "float64"

    def steps(self, record: Record) -> int:
        """Return the steps per record interval."""
        return max(1, math.ceil(record.dt / self.dt - 1e-9))


def kernel_shape(
    scene: Scene, law: Law, numerics: Numerics, reducers: Iterable[str], history: bool = False
) -> KernelShape:
    """Return what the kernel of a scene under a law is compiled for; no contact code where none can touch."""
    touching = law.has_contact and bool(scene.contacts)
    wanted = frozenset(reducers)
    if not touching:
        wanted -= (CONTACT_REDUCERS - {"closing"}) | {"transfer"}
    if not scene.contacts:
        wanted -= {"closing"}
    compiled = None
    if touching:
        compiled = LawShape(
            law.elastic,
            law.elastic_slope,
            law.damper,
            law.damper_slope,
            law.exponent or 1.0,
            law.approach_only,
            law.tension,
            law.damping == "elastic",
            law.damper_exponent,
            law.impulsive,
        )
    return KernelShape(
        storeys=tuple(b.n_storeys for b in scene.buildings),
        contacts=tuple((c.left, c.right, c.pair) for c in scene.contacts) if touching or "closing" in wanted else (),
        n_pairs=len(scene.pair_names),
        law=compiled,
        scheme=numerics.method,
        located=numerics.locate,
        reducers=wanted,
        history=history,
        precision=numerics.precision,
    )


@lru_cache(maxsize=64)
def _transitions(scene: Scene, h: float) -> np.ndarray:
    """Transition matrices of all buildings over a step h (s), each row with what the ground adds."""
    from pounding_sweep.kernels.exact import transition

    rows = []
    for b in scene.buildings:
        masses = np.asarray(b.masses)
        alpha, beta = b.rayleigh
        damping = alpha * np.diag(masses) + beta * b.stiffness_matrix
        rows.append(np.column_stack(transition(masses, damping, b.stiffness_matrix, h)).ravel())
    return np.concatenate(rows)


@dataclass(frozen=True)
class RowKernel:
    """A scene under one law and one scheme, ready to run.

    Attributes
    ----------
    scene : Scene
        The row.
    law : Law
        Contact law.
    numerics : Numerics
        Scheme and step.
    reducers : frozenset of str
        What is kept of each scenario.
    history : bool
        Keep the state of the first scenario after every step.
    initial_velocity : tuple of float, optional
        Velocity (m/s) of every floor, building by building; at rest where not given.
    host : Law, optional
        Damped law in whose kernel this undamped one runs, with c = 0.
    basis : {"published", "realised"}
        Whether damping follows from the restitution by the law's published formula,
        or so that two free masses rebound at exactly it.
    """

    scene: Scene
    law: Law
    numerics: Numerics
    reducers: frozenset[str]
    history: bool = False
    initial_velocity: tuple[float, ...] | None = None
    host: Law | None = None
    basis: str = "published"

    @cached_property
    def shape(self) -> KernelShape:
        """What the kernel is compiled for."""
        return kernel_shape(self.scene, self.host or self.law, self.numerics, self.reducers, self.history)

    @cached_property
    def constants(self) -> np.ndarray:
        """Scene constants in the kernel's layout."""
        slots = property_slots(self.shape)
        values = np.zeros(slots.size, self.numerics.precision)

        def put(name: str, numbers: Any) -> None:
            numbers = np.atleast_1d(np.asarray(numbers, dtype=float))
            values[slots.first[name] : slots.first[name] + slots.count[name]] = numbers[: slots.count[name]]

        buildings = self.scene.buildings
        masses = np.concatenate([b.masses for b in buildings])
        put("m", masses)
        put("im", 1.0 / masses)
        put("k", np.concatenate([b.stiffnesses for b in buildings]))
        if self.initial_velocity is not None:
            put("v0", self.initial_velocity)
        put("alpha", [b.rayleigh[0] for b in buildings])
        put("beta", [b.rayleigh[1] for b in buildings])
        if self.shape.contacts:
            put("reduced", [c.mass for c in self.scene.contacts])
        put("newmark_beta", self.numerics.beta)
        put("newmark_gamma", self.numerics.gamma)
        return values

    def glides(self, record: Record) -> int:
        """Return the exact steps of free flight per record interval: a divisor of the steps.

        They are short beside the fastest mode, because peaks are looked for between their
        ends, and as short as the steps where a history is kept.
        """
        steps = self.numerics.steps(record)
        if self.history:
            return steps
        caps = ACCELERATION_GLIDE if "acceleration" in self.reducers else GLIDE
        rates = [w / cap for b in self.scene.buildings for w, cap in zip(b.frequencies[:2], caps, strict=False)]
        need = record.dt * max(*rates, *(b.frequencies[-1] / caps[-1] for b in self.scene.buildings))
        return next((n for n in range(1, steps) if steps % n == 0 and n >= need), steps)

    def constants_for(self, record: Record) -> np.ndarray:
        """Scene constants, with the transition matrices of this record's steps where the scheme has any."""
        if self.numerics.method != "exact":
            return self.constants
        slots = property_slots(self.shape)
        values = self.constants.copy()
        for name, parts in (("glide", self.glides(record)), ("short", self.numerics.steps(record))):
            first = slots.first[name]
            values[first : first + slots.count[name]] = _transitions(self.scene, record.dt / parts)
        return values

    def run(
        self,
        record: Record,
        *,
        scale: np.ndarray,
        gaps: np.ndarray,
        stiffness: np.ndarray,
        restitution: np.ndarray,
        history: np.ndarray | None = None,
    ) -> dict[str, np.ndarray]:
        """Integrate scenarios over a record.

        Parameters
        ----------
        record : Record
            Ground motion (m/s2).
        scale : ndarray, shape (n,)
            Factors on the record.
        gaps : ndarray, shape (n, pairs)
            Gaps (m).
        stiffness : ndarray, shape (n,)
            Contact stiffness (kN/m**exponent).
        restitution : ndarray, shape (n,)
            Coefficients of restitution; ignored by laws that take none.
        history : ndarray, shape (steps + 1, history slots), optional
            Filled with the states of the first scenario.

        Returns
        -------
        dict of str to ndarray
            Kernel outputs by name, shape (n, slots).
        """
        from pounding_sweep.kernels.cache import get_kernel

        n = len(scale)
        groups = -(-n // LANES)
        inputs, outputs = input_slots(self.shape), output_slots(self.shape)
        padded = np.minimum(np.arange(groups * LANES), n - 1)  # idle lanes repeat the last scenario
        lanes = np.empty((inputs.size, groups * LANES))

        def put(name: str, values: np.ndarray) -> None:
            lanes[inputs.first[name] : inputs.first[name] + inputs.count[name]] = values[padded].T

        put("scale", np.asarray(scale, float)[:, None])
        if "gap" in inputs.first:
            put("gap", np.asarray(gaps, float))
        if self.shape.law is not None:
            k = np.asarray(stiffness, float)[:, None]
            e = np.asarray(restitution, float)[:, None]
            put("k", k)
            masses = np.array([c.mass for c in self.scene.contacts])[None, :]
            damping = self.law.damping_coefficient(e, k, masses, self.basis)
            put("c", np.broadcast_to(damping, (n, len(self.scene.contacts))))
        blocks = np.ascontiguousarray(lanes.reshape(inputs.size, groups, LANES).transpose(1, 0, 2))
        results = np.zeros((groups, outputs.size * LANES))
        if history is None:
            history = np.zeros((1, 1))
        kernel = get_kernel(self.shape)
        kernel(
            np.array(record.acceleration),
            float(record.dt),
            self.numerics.steps(record),
            self.glides(record),
            self.constants_for(record),
            blocks.reshape(groups, -1),
            results,
            history,
        )
        by_scenario = results.reshape(groups, outputs.size, LANES).transpose(0, 2, 1).reshape(-1, outputs.size)[:n]
        found = {name: by_scenario[:, i : i + outputs.count[name]] for name, i in outputs.first.items()}
        # what the status asks of the scenario beside its results
        found["scale"] = np.asarray(scale, float)[:, None]
        if self.shape.law is not None:
            found["quickening"] = self.law.quickening(e, self.basis)
        return found


def _energy_residual(raw: Mapping[str, np.ndarray], scene: Scene, initial_kinetic: float) -> np.ndarray:
    """|sum of transfers - sum of contact works| over the largest energy in the balance."""
    gained = raw["e_kin"] + raw["e_strain"] + raw["e_damp"]
    left = raw["e_in"].sum(axis=1) - gained.sum(axis=1) + initial_kinetic
    work = raw["work"].sum(axis=1) if "work" in raw else np.zeros(len(left))
    size = np.maximum.reduce([np.abs(raw["e_in"]).sum(axis=1), gained.sum(axis=1), np.abs(work)])
    return np.asarray(np.abs(left - work) / np.where(size > 0, size, 1.0))


def _pair_sum(values: np.ndarray, scene: Scene) -> np.ndarray:
    result = np.zeros((len(values), len(scene.pair_names)))
    for j, contact in enumerate(scene.contacts):
        result[:, contact.pair] += values[:, j]
    return result


#: Variable -> how it is read from the kernel's outputs (dof, contact or building values).
_DIRECT: dict[str, tuple[str, str]] = {
    "displacement_max": ("umax", "dof"),
    "displacement_min": ("umin", "dof"),
    "drift_max": ("drift", "dof"),
    "acceleration_max": ("acc", "dof"),
    "impact_force_max": ("fmax", "contact"),
    "penetration_max": ("dmax", "contact"),
    "impulse": ("impulse", "contact"),
    "approach_speed_max": ("vmax", "contact"),
    "closing_max": ("closing", "contact"),
    "energy_input": ("e_in", "building"),
    "energy_damping": ("e_damp", "building"),
    "energy_kinetic": ("e_kin", "building"),
    "energy_strain": ("e_strain", "building"),
    "energy_transfer_max": ("tmax", "building"),
    "energy_transfer_min": ("tmin", "building"),
}


#: What a law without a contact force (velocities jump) can't answer.
NEEDS_FORCE = frozenset({"impact_force_max", "penetration_max"})


@np.errstate(over="ignore", invalid="ignore")  # the numbers of a diverged scenario, which are not reported
def variables_of(
    kernel: RowKernel, raw: Mapping[str, np.ndarray], outputs: Sequence[str], record: Record
) -> dict[str, Any]:
    """Turn a kernel's outputs into the variables of the cube.

    Parameters
    ----------
    kernel : RowKernel
        What ran.
    raw : mapping
        What `RowKernel.run` returned for n scenarios.
    outputs : sequence of str
        Variables asked for; those in every cube are added.
    record : Record
        The record, for the length of a step.

    Returns
    -------
    dict of str to ndarray
        Shape (n, *inner dimensions). What needs contact is zero (missing for the
        first impact time) where nothing can touch.
    """
    scene = kernel.scene
    n = len(raw["flags"])
    result: dict[str, Any] = {}
    steps = np.full(n, np.nan)
    if "shortest" in raw:
        lasted = raw["shortest"][:, 0] / (record.dt / kernel.numerics.steps(record))
        steps = np.where(lasted < 1e30, lasted, np.nan)
    for name in cube_variables(outputs):
        variable = get_variable(name)
        shape = (n, *inner_shape(variable, scene))
        source, kind = _DIRECT.get(name, ("", ""))
        if kernel.law.impulsive and name in NEEDS_FORCE:
            result[name] = np.full(shape, np.nan)
        elif source in raw:
            scatter: dict[str, Callable[[Any, Scene], np.ndarray]] = {"dof": scatter_dof, "contact": scatter_contact}
            result[name] = scatter[kind](raw[source], scene) if kind in scatter else np.array(raw[source])
        elif kind == "contact":
            result[name] = scatter_contact(np.zeros((n, len(scene.contacts))), scene)
        elif name == "storey_shear_max":
            stiffness = np.concatenate([b.stiffnesses for b in scene.buildings])
            result[name] = scatter_dof(raw["drift"] * stiffness, scene)
        elif name == "impact_count":
            counts = raw["count"] if "count" in raw else np.zeros((n, len(scene.contacts)))
            result[name] = scatter_contact(counts.astype(np.int32), scene)
        elif name == "first_impact_time":
            times = raw["tfirst"] if "tfirst" in raw else np.full((n, len(scene.contacts)), -1.0)
            result[name] = scatter_contact(np.where(times < 0, np.nan, times), scene)
        elif name == "contact_work":
            result[name] = _pair_sum(raw["work"], scene) if "work" in raw else np.zeros(shape)
        elif name == "energy_residual":
            result[name] = _energy_residual(raw, scene, _initial_kinetic(kernel))
        elif name == "steps_per_contact":
            result[name] = steps
        elif name == "time_step":
            result[name] = np.full(n, record.dt / kernel.numerics.steps(record))
        elif name == "status":
            result[name] = _status(kernel, raw, steps, record)
        else:
            result[name] = np.zeros(shape)
    return result


def _initial_kinetic(kernel: RowKernel) -> float:
    if kernel.initial_velocity is None:
        return 0.0
    masses = np.concatenate([b.masses for b in kernel.scene.buildings])
    return float(0.5 * (masses * np.square(kernel.initial_velocity)).sum())


def _impossible(kernel: RowKernel, raw: Mapping[str, np.ndarray], record: Record) -> np.ndarray:
    """Whether floors went farther than the energy that the ground can bring in allows, where that was kept."""
    if "umax" not in raw:
        return np.zeros(len(raw["flags"]), dtype=bool)
    energy = energy_limit(kernel.scene, record, raw["scale"][:, 0], kernel.initial_velocity)
    limit = displacement_limit(kernel.scene, MAX_ENERGY * energy)
    far = np.maximum(raw["umax"], -raw["umin"])
    return np.asarray(np.any(~(far <= limit), axis=1))


def _status(kernel: RowKernel, raw: Mapping[str, np.ndarray], steps: np.ndarray, record: Record) -> np.ndarray:
    from pounding_sweep.kernels.loop import FLAG_DIVERGED, FLAG_FALLBACK, FLAG_UNSOLVED

    flags = raw["flags"][:, 0].astype(int)
    quickening = raw["quickening"][:, 0] if "quickening" in raw else np.ones(len(flags))
    status = resolution_status(kernel.scene, record, kernel.numerics, steps, quickening)
    status[flags & FLAG_FALLBACK > 0] = Status.UNDER_RESOLVED_CONTACT
    status[flags & FLAG_UNSOLVED > 0] = Status.NEWTON_NOT_CONVERGED
    status[(flags & FLAG_DIVERGED > 0) | _impossible(kernel, raw, record)] = Status.DIVERGED
    return status
