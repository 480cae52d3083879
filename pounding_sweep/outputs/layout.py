"""Where a degree of freedom or a contact of the kernels stands in the cube, and what stands where there is nothing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pounding_sweep.base.errors import InputError
from pounding_sweep.model.scene import Scene
from pounding_sweep.outputs.variables import INTEGER_FILL, STATUS, Variable, get_variable


def inner_shape(variable: str | Variable, scene: Scene) -> tuple[int, ...]:
    """Return the shape of one scenario's values of `variable`."""
    sizes = {"building": len(scene.buildings), "pair": len(scene.pair_names), "storey": scene.n_storeys}
    return tuple(sizes[dim] for dim in get_variable(variable).dims)


def _missing(dtype: np.dtype[Any]) -> Any:
    return INTEGER_FILL if np.issubdtype(dtype, np.integer) else np.nan


def _check_last(values: np.ndarray, size: int, what: str) -> None:
    if values.ndim == 0 or values.shape[-1] != size:
        msg = f"the last dimension of the values must be the scene's {size} {what}, not shape {values.shape}"
        raise InputError(msg)


def scatter_dof(values: Any, scene: Scene) -> np.ndarray:
    """Put values per degree of freedom where their building and storey are."""
    values = np.asarray(values)
    _check_last(values, scene.n_dof, "degrees of freedom")
    shape = (*values.shape[:-1], len(scene.buildings), scene.n_storeys)
    result = np.full(shape, _missing(values.dtype), dtype=values.dtype)
    for i, (start, stop) in enumerate(zip(scene.offsets[:-1], scene.offsets[1:], strict=True)):
        result[..., i, : stop - start] = values[..., start:stop]
    return result


def scatter_contact(values: Any, scene: Scene) -> np.ndarray:
    """Put values per contact where their pair and storey are."""
    values = np.asarray(values)
    _check_last(values, len(scene.contacts), "contacts")
    shape = (*values.shape[:-1], len(scene.pair_names), scene.n_storeys)
    result = np.full(shape, _missing(values.dtype), dtype=values.dtype)
    for i, contact in enumerate(scene.contacts):
        result[..., contact.pair, contact.storey - 1] = values[..., i]
    return result


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
