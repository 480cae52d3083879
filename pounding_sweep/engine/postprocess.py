"""What the outputs of a kernel mean: the variables of the cube, and the status of each scenario."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from pounding_sweep.engine.resolution import MAX_ENERGY, displacement_limit, energy_limit, resolution_status
from pounding_sweep.engine.row_kernel import RowKernel
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.outputs.layout import inner_shape, scatter_contact, scatter_dof
from pounding_sweep.outputs.variables import Status, cube_variables, get_variable
from pounding_sweep.records import Record


def _energy_residual(raw: Mapping[str, np.ndarray], initial_kinetic: np.ndarray | float) -> np.ndarray:
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


#: What a law without a contact force (velocities jump) can't answer where floors touched; kernels leave a mark there.
NEEDS_FORCE = frozenset({"impact_force_max", "penetration_max"})


@np.errstate(over="ignore", invalid="ignore")  # the numbers of a diverged scenario, which are not reported
def variables_of(
    kernel: RowKernel,
    raw: Mapping[str, np.ndarray],
    outputs: Sequence[str],
    record: Record,
    variants: Variants | None = None,
) -> dict[str, Any]:
    """Turn a kernel's outputs into the variables of the cube."""
    scene = kernel.scene
    row = variants_of(scene) if variants is None else variants
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
        if kernel.law.impulsive and source in raw and name in NEEDS_FORCE:
            result[name] = scatter_contact(np.where(raw[source] > 0.0, np.nan, 0.0), scene)
        elif source in raw:
            scatter: dict[str, Callable[[Any, Scene], np.ndarray]] = {"dof": scatter_dof, "contact": scatter_contact}
            result[name] = scatter[kind](raw[source], scene) if kind in scatter else np.array(raw[source])
        elif kind == "contact":
            result[name] = scatter_contact(np.zeros((n, len(scene.contacts))), scene)
        elif name == "storey_shear_max":
            result[name] = scatter_dof(raw["drift"] * row.stiffnesses, scene)
        elif name == "impact_count":
            counts = raw["count"] if "count" in raw else np.zeros((n, len(scene.contacts)))
            result[name] = scatter_contact(counts.astype(np.int32), scene)
        elif name == "first_impact_time":
            times = raw["tfirst"] if "tfirst" in raw else np.full((n, len(scene.contacts)), -1.0)
            result[name] = scatter_contact(np.where(times < 0, np.nan, times), scene)
        elif name == "contact_work":
            result[name] = _pair_sum(raw["work"], scene) if "work" in raw else np.zeros(shape)
        elif name == "energy_residual":
            result[name] = _energy_residual(raw, _initial_kinetic(kernel, row))
        elif name == "steps_per_contact":
            result[name] = steps
        elif name == "time_step":
            result[name] = np.full(n, record.dt / kernel.numerics.steps(record))
        elif name == "status":
            result[name] = _status(kernel, raw, steps, record, row)
        else:
            result[name] = np.zeros(shape)
    return result


def _initial_kinetic(kernel: RowKernel, row: Variants) -> np.ndarray | float:
    if kernel.initial_velocity is None:
        return 0.0
    return np.asarray(0.5 * (row.masses * np.square(kernel.initial_velocity)).sum(axis=1))


def _impossible(kernel: RowKernel, raw: Mapping[str, np.ndarray], record: Record, row: Variants) -> np.ndarray:
    """Whether floors went farther than the energy that the ground can bring in allows, where that was kept."""
    if "umax" not in raw:
        return np.zeros(len(raw["flags"]), dtype=bool)
    energy = energy_limit(row, record, raw["scale"][:, 0], kernel.initial_velocity)
    limit = displacement_limit(row, MAX_ENERGY * energy)
    far = np.maximum(raw["umax"], -raw["umin"])
    return np.asarray(np.any(~(far <= limit), axis=1))


def _status(
    kernel: RowKernel, raw: Mapping[str, np.ndarray], steps: np.ndarray, record: Record, row: Variants
) -> np.ndarray:
    from pounding_sweep.engine.loop import FLAG_DIVERGED, FLAG_FALLBACK, FLAG_UNSOLVED

    flags = raw["flags"][:, 0].astype(int)
    quickening = raw["quickening"][:, 0] if "quickening" in raw else np.ones(len(flags))
    status = resolution_status(row, record, kernel.numerics, steps, quickening)
    status[flags & FLAG_FALLBACK > 0] = Status.UNDER_RESOLVED_CONTACT
    status[flags & FLAG_UNSOLVED > 0] = Status.NEWTON_NOT_CONVERGED
    status[(flags & FLAG_DIVERGED > 0) | _impossible(kernel, raw, record, row)] = Status.DIVERGED
    return status
