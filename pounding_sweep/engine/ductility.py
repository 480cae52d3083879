"""Strengths at which buildings reach a given ductility without pounding."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.model.laws import get_law
from pounding_sweep.model.variants import Variants
from pounding_sweep.outputs.variables import reducers_for
from pounding_sweep.records import Record

#: Strength reductions that are looked at for the first one that reaches a ductility: their number, and the largest
#: over the ductility asked for.
REDUCTIONS, REACH = 192, 8.0
#: Halvings of the bracket then.
HALVINGS = 30
#: Factor on strengths at which all is elastic.
NEVER = 1e9
#: Largest time step (s) of the scheme rk4 by which they are found.
STEP = 1e-3


def strengths_for(
    row: Variants, record: Record, ductilities: np.ndarray, dt: float = STEP
) -> tuple[np.ndarray, np.ndarray]:
    """Return factors on yield strengths, and reductions, at which each building alone reaches the ductility asked."""
    # Of shape (rows, buildings); NaN where a building does not yield, or does not reach it. `ductilities` has one for
    # each row of building properties, whose own strength factors are passed over.
    demand = _demand(row, record, dt)
    elastic = NEVER * demand(np.full((len(row), 1, len(row.scene.buildings)), NEVER))[:, 0]  # NaN: it does not yield
    elastic = np.where(elastic > 0.0, elastic, np.nan)
    reductions = np.geomspace(1.0, REACH * ductilities, REDUCTIONS, axis=1)  # (rows, reductions)
    reached = demand(elastic[:, None] / reductions[:, :, None]) >= ductilities[:, None, None] * (1.0 - 1e-9)
    first = np.where(reached.any(axis=1), reached.argmax(axis=1), -1)
    high = np.where(first >= 0, np.take_along_axis(reductions, np.maximum(first, 0), axis=1), np.nan)
    low = np.where(first > 0, np.take_along_axis(reductions, np.maximum(first - 1, 0), axis=1), high)
    for _ in range(HALVINGS):
        middle = np.sqrt(low * high)
        above = demand((elastic / middle)[:, None])[:, 0] >= ductilities[:, None]
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return elastic / high, high


def _demand(row: Variants, record: Record, dt: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return what gives ductilities by strength factors of each building alone, of shape (rows, any, buildings)."""
    scene, none = row.scene, get_law("none")
    kernel = RowKernel(scene, none, Numerics("rk4", dt), reducers_for(["drift_max"]), varied=True)

    def demand(factors: np.ndarray) -> np.ndarray:
        n, m, nb = factors.shape
        known = np.where(np.isnan(factors), 1.0, factors).reshape(n * m, nb)
        given = (np.repeat(column, m, axis=0) for column in row.columns)
        period, mass, ratio, _, hardening = given
        variants = Variants(scene, period, mass, ratio, known, hardening)
        gaps, ones = np.full((n * m, len(scene.pair_names)), np.inf), np.ones(n * m)
        lanes: dict[str, Any] = {"scale": ones, "gaps": gaps, "stiffness": np.zeros(n * m), "restitution": ones}
        drift = kernel.run(record, variants=variants, **lanes)["drift"]
        ductility = drift / np.where(np.isfinite(variants.yield_drifts), variants.yield_drifts, np.inf)
        largest = np.maximum.reduceat(ductility, scene.offsets[:-1], axis=1).reshape(n, m, nb)
        return np.where(np.isnan(factors), np.nan, largest)

    return demand
