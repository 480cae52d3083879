"""What the outputs of a kernel mean: the variables of the cube, and the status of each scenario."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from pounding_sweep.engine.resolution import MAX_ENERGY, displacement_limit, energy_limit, resolution_status
from pounding_sweep.engine.row_kernel import RowKernel
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.outputs.declare import KernelResults
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
    raw = {name: np.asfortranarray(values) for name, values in raw.items()}  # scenarios side by side: see `scatter`
    step = record.dt / kernel.numerics.steps(record)
    kept = KernelResults(kernel.scene, raw, row, step, kernel.initial_velocity)
    result: dict[str, Any] = {}
    for name in cube_variables(outputs):
        variable = get_variable(name)
        if name == "status":
            result[name] = _status(kernel, raw, kept.steps_by_law, record, row)
        else:
            values = variable.read(kept)
            # where velocities jump, kernels leave a mark instead of what a law without a force can't answer
            result[name] = (
                np.where(values > 0.0, np.nan, values) if kernel.law.impulsive and variable.of_force else values
            )
    return result


def _impossible(kernel: RowKernel, raw: Mapping[str, np.ndarray], record: Record, row: Variants) -> np.ndarray:
    """Whether floors went farther than the energy that the ground can bring in allows, where that was kept."""
    if "umax" not in raw:
        return np.zeros(len(raw["flags"]), dtype=bool)
    scale = raw["scale"][:, 0]
    if len(row) == 1 and (scale == scale[0]).all():  # one limit for all
        limit = _farthest(row, record, float(scale[0]), kernel.initial_velocity)
        highest, lowest = raw["umax"].max(axis=0), raw["umin"].min(axis=0)
        if np.all((highest <= limit) & (-lowest <= limit)):  # as a rule
            return np.zeros(len(scale), dtype=bool)
    else:
        limit = displacement_limit(row, MAX_ENERGY * energy_limit(row, record, scale, kernel.initial_velocity))
    return ~np.all((raw["umax"] <= limit) & (-raw["umin"] <= limit), axis=1)


@lru_cache(maxsize=64)
def _farthest(row: Variants, record: Record, scale: float, initial_velocity: tuple[float, ...] | None) -> np.ndarray:
    """How far floors of a single row can get (m), shape (1, floors): each chunk asks for it."""
    return displacement_limit(row, MAX_ENERGY * energy_limit(row, record, np.array([scale]), initial_velocity))


def _fallen(raw: Mapping[str, np.ndarray], row: Variants) -> np.ndarray:
    """Whether a storey that softens under the weight above it drifted as far as it is high."""
    if not any(b.p_delta and any(b.yields) for b in row.scene.buildings):
        return np.zeros(len(raw["flags"]), dtype=bool)
    return np.any((row.hardenings < 0.0) & ~(raw["drift"] < row.storey_heights), axis=1)


def _status(
    kernel: RowKernel, raw: Mapping[str, np.ndarray], steps: np.ndarray, record: Record, row: Variants
) -> np.ndarray:
    from pounding_sweep.kernel.march import FLAG_DIVERGED, FLAG_FALLBACK, FLAG_UNSOLVED

    flags = raw["flags"][:, 0].astype(int)
    fastest = np.fmin.reduce(steps / raw.get("quickening", 1.0), axis=1)
    status = resolution_status(row, record, kernel.numerics, fastest)
    touching = kernel.shape.law is not None  # else it is storeys that yield too often within a step
    status[flags & FLAG_FALLBACK > 0] = Status.UNDER_RESOLVED_CONTACT if touching else Status.UNDER_RESOLVED_MOTION
    status[flags & FLAG_UNSOLVED > 0] = Status.NEWTON_NOT_CONVERGED
    impossible = _impossible(kernel, raw, record, row) | _fallen(raw, row)
    status[(flags & FLAG_DIVERGED > 0) | impossible] = Status.DIVERGED
    return status
