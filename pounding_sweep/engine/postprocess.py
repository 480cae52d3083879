"""What the outputs of a kernel mean: the variables of the cube, and the status of each scenario."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pounding_sweep.engine.resolution import MAX_ENERGY, displacement_limit, energy_limit, resolution_status
from pounding_sweep.engine.row_kernel import RowKernel
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.outputs.layout import inner_shape
from pounding_sweep.outputs.readout import KernelResults
from pounding_sweep.outputs.variables import Status, cube_variables, get_variable
from pounding_sweep.records import Record


@np.errstate(over="ignore", invalid="ignore")  # the numbers of a diverged scenario, which are not reported
def variables_of(
    kernel: RowKernel,
    raw: Mapping[str, np.ndarray],
    outputs: Sequence[str],
    record: Record,
    variants: Variants | None = None,
) -> dict[str, Any]:
    """Turn a kernel's outputs into the variables of the cube."""
    row = variants_of(kernel.scene) if variants is None else variants
    step = record.dt / kernel.numerics.steps(record)
    kept = KernelResults(kernel.scene, raw, row, step, kernel.initial_velocity)
    result: dict[str, Any] = {}
    for name in cube_variables(outputs):
        variable = get_variable(name)
        if name == "status":
            result[name] = _status(kernel, raw, kept.steps_per_contact, record, row)
        elif variable.readout is None:
            result[name] = np.zeros((len(kept), *inner_shape(variable, kernel.scene)))
        else:
            values = variable.readout(kept)
            # where velocities jump, kernels leave a mark instead of what a law without a force can't answer
            result[name] = (
                np.where(values > 0.0, np.nan, values) if kernel.law.impulsive and variable.of_force else values
            )
    return result


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
    from pounding_sweep.kernel.march import FLAG_DIVERGED, FLAG_FALLBACK, FLAG_UNSOLVED

    flags = raw["flags"][:, 0].astype(int)
    quickening = raw["quickening"][:, 0] if "quickening" in raw else np.ones(len(flags))
    status = resolution_status(row, record, kernel.numerics, steps, quickening)
    touching = kernel.shape.law is not None  # else it is storeys that yield too often within a step
    status[flags & FLAG_FALLBACK > 0] = Status.UNDER_RESOLVED_CONTACT if touching else Status.UNDER_RESOLVED_MOTION
    status[flags & FLAG_UNSOLVED > 0] = Status.NEWTON_NOT_CONVERGED
    status[(flags & FLAG_DIVERGED > 0) | _impossible(kernel, raw, record, row)] = Status.DIVERGED
    return status
