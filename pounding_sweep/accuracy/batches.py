"""Scenarios side by side, run as a sweep would: the same refusals, the same statuses, the same masks."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pounding_sweep.engine.postprocess import variables_of
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.model.laws import Law
from pounding_sweep.model.scene import Scene
from pounding_sweep.outputs.layout import inner_shape, mask_invalid
from pounding_sweep.outputs.variables import Status, cube_variables, get_variable, reducers_for
from pounding_sweep.records import Record
from pounding_sweep.schemes.stability import largest_step

#: Peaks whose error is judged.
PEAKS = ("displacement_max", "displacement_min", "impact_force_max", "penetration_max")
#: What every run reports.
OUTPUTS = (
    *PEAKS,
    "energy_input",
    "energy_damping",
    "energy_kinetic",
    "energy_strain",
    "contact_work",
    "energy_residual",
)


@dataclass(frozen=True)
class Batch:
    """Scenarios of one row, law and record, to be run by both schemes at several steps.

    Attributes
    ----------
    family : str
        What is stretched.
    case : str
        What is extreme about it, for messages.
    scene : Scene
        The row; its own gaps are not used.
    law : Law
        Contact law.
    record : Record
        Ground motion (m/s2).
    gaps : ndarray, shape (n, pairs)
        Gaps (m).
    stiffness, restitution, scale : ndarray, shape (n,)
        Contact stiffness (kN/m**exponent), coefficient of restitution, factor on the record.
    steps : tuple of float
        Time steps (s).
    initial_velocity : tuple of float, optional
        Velocity (m/s) of every floor, building by building.
    """

    family: str
    case: str
    scene: Scene
    law: Law
    record: Record
    gaps: np.ndarray
    stiffness: np.ndarray
    restitution: np.ndarray
    scale: np.ndarray
    steps: tuple[float, ...]
    initial_velocity: tuple[float, ...] | None = None

    def __len__(self) -> int:
        return len(self.scale)


def kernel_of(batch: Batch, method: str, dt: float, precision: str = "float64", finer: float = 1.0) -> RowKernel:
    """Return the kernel that runs a batch."""
    numerics = Numerics(method, dt, precision=precision, finer=finer)
    return RowKernel(batch.scene, batch.law, numerics, reducers_for(OUTPUTS), initial_velocity=batch.initial_velocity)


def take(batch: Batch, rows: np.ndarray) -> Batch:
    """Return some scenarios of a batch."""
    return replace(
        batch, **{name: getattr(batch, name)[rows] for name in ("gaps", "stiffness", "restitution", "scale")}
    )


def stable_step(batch: Batch, method: str) -> np.ndarray:
    """Largest stable step (s) of each scenario."""
    return largest_step(batch.scene, batch.law, batch.stiffness, batch.restitution, method=method)


def run_batch(
    batch: Batch, method: str, dt: float, precision: str = "float64", finer: float = 1.0
) -> dict[str, np.ndarray]:
    """Run every scenario of a batch."""
    kernel = kernel_of(batch, method, dt, precision, finer)
    step = batch.record.dt / kernel.numerics.steps(batch.record)
    rows = np.flatnonzero(step <= stable_step(batch, method))
    result: dict[str, np.ndarray] = {}
    for name in cube_variables(OUTPUTS):
        variable = get_variable(name)
        empty = math.nan if variable.fill is None else variable.fill
        result[name] = np.full((len(batch), *inner_shape(variable, batch.scene)), empty)
    result["status"] = np.full(len(batch), int(Status.BEYOND_STABILITY_LIMIT), dtype=np.int8)
    if len(rows):
        part = take(batch, rows)
        raw = kernel.run(
            part.record, scale=part.scale, gaps=part.gaps, stiffness=part.stiffness, restitution=part.restitution
        )
        for name, values in variables_of(kernel, raw, OUTPUTS, part.record).items():
            result[name][rows] = values
    return mask_invalid(result)
