"""What the error of an output is: one number per scenario."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache, reduce

import numpy as np

from pounding_sweep.outputs.variables import VARIABLES, check_outputs, get_variable

#: Relative change of gaps, contact stiffness and ground motion that no engineer can tell: where it changes an output
#: by more than a tolerance, the scenario is sensitive at that tolerance. Its error is counted all the same.
CHANGE = 1.0e-6


def comparable(outputs: Iterable[str]) -> tuple[str, ...]:
    """Return those of `outputs` that have an error, in the order of the registry."""
    return tuple(name for name in check_outputs(outputs) if VARIABLES[name].error)


def relative_error(name: str, values: np.ndarray, reference: np.ndarray, scale: np.ndarray | None = None) -> np.ndarray:
    """Largest error of each scenario over its floors, pairs or buildings, relative to its largest value or `scale`."""
    variable = get_variable(name)
    x = np.asarray(values, dtype=float).reshape(len(values), -1)
    y = np.asarray(reference, dtype=float).reshape(len(reference), -1)
    if variable.dtype != "f8" and ((x < 0).any() or (y < 0).any()):  # integers are missing where they are negative
        x, y = np.where(x < 0, np.nan, x), np.where(y < 0, np.nan, y)
    if not x.shape[1]:
        return np.zeros(len(x))
    gap = x - y
    off = np.maximum.reduce(np.abs(gap, out=gap), axis=1)
    missing = np.flatnonzero(np.isnan(off))
    if len(missing):
        some, others = x[missing], y[missing]
        off[missing] = np.fmax.reduce(np.abs(some - others), axis=1, initial=0.0)
    size = np.maximum(_largest(name, y) if scale is None else scale, variable.least)
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.where(off == 0.0, 0.0, np.where(size > 0.0, off / size, np.inf))
    if len(missing):
        error[missing[(np.isnan(some) != np.isnan(others)).any(axis=1)]] = np.inf
    return error


def relative_errors(
    outputs: Iterable[str], values: Mapping[str, np.ndarray], reference: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """`relative_error` of every comparable output, by name; relative to what the registry says."""
    largest = cache(lambda name: _largest(name, reference[name]))
    return {
        name: relative_error(name, values[name], reference[name], _scale(name, reference, largest))
        for name in comparable(outputs)
    }


def _largest(name: str, values: np.ndarray) -> np.ndarray:
    """Largest absolute value of each scenario."""
    found = np.asarray(values, dtype=float).reshape(len(values), -1)
    high = np.fmax.reduce(found, axis=1, initial=0.0)
    if VARIABLES[name].dtype == "f8":  # integers are missing where they are negative
        high = np.maximum(high, -np.fmin.reduce(found, axis=1, initial=0.0))
    return np.asarray(high)


def _scale(name: str, reference: Mapping[str, np.ndarray], largest: Callable[[str], np.ndarray]) -> np.ndarray:
    """Return what an error of `name` is relative to: itself, and what else `reference` holds."""
    sizes = [largest(name)]
    for other in VARIABLES[name].relative_to:
        parts = (other,) if isinstance(other, str) else other
        if all(part in reference for part in parts):
            sizes.append(np.prod([largest(part) for part in parts], axis=0))
    return np.asarray(reduce(np.maximum, sizes))
