"""Shapes of values in the cube, and what stands where there is nothing."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pounding_sweep.base.errors import InputError
from pounding_sweep.model.scene import Scene
from pounding_sweep.outputs.variables import STATUS, Variable, get_variable


def inner_shape(variable: str | Variable, scene: Scene) -> tuple[int, ...]:
    """Return the shape of one scenario's values of `variable`."""
    sizes = {"building": len(scene.buildings), "pair": len(scene.pair_labels), "storey": scene.n_storeys}
    return tuple(sizes[dim] for dim in get_variable(variable).dims)


def mask_invalid(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Remove the values of scenarios that have none: diverged, refused or not run."""
    if "status" not in arrays:
        msg = f"the results have no 'status', only {', '.join(sorted(arrays)) or 'nothing'}"
        raise InputError(msg)
    status = np.asarray(arrays["status"])
    bad = np.isin(status, [int(s) for s in STATUS if not s.has_values])
    result: dict[str, np.ndarray] = {}
    for name, given in arrays.items():
        values = np.asarray(given)
        fill = get_variable(name).fill
        if fill is not None and bad.any():
            values = values.copy()
            values[bad] = fill
        result[name] = values
    return result
