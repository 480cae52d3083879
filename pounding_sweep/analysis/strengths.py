"""Strengths at which buildings reach a given ductility without pounding."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import InputError, shown
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.model.laws import get_law
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import Variants
from pounding_sweep.outputs.variables import reducers_for
from pounding_sweep.records import Record, resolve_records

if TYPE_CHECKING:
    import xarray as xr

#: Strength reductions that are looked at for the first one that reaches a ductility: their number, and the largest
#: over the largest ductility asked for.
REDUCTIONS, REACH = 192, 8.0
#: Halvings of the bracket then.
HALVINGS = 30
#: Factor on strengths at which all is elastic.
NEVER = 1e9


def constant_ductility(
    scene: Scene, records: Any, ductilities: Sequence[float] | float, *, dt: float = 1e-3, folders: Any = None
) -> xr.Dataset:
    """Find the factors on yield strengths at which each building alone reaches given ductilities.

    Parameters
    ----------
    scene : Scene
        A row in which storeys yield (kN, t, m, s); its contacts are left out.
    records : Record, str, path, or several
        Ground motions: records, names or files.
    ductilities : float or several
        Largest storey ductilities of a building that are aimed at, at least 1.
    dt : float
        Largest time step (s) of the scheme rk4.
    folders : path or several, optional
        Where to find records by name.

    Returns
    -------
    xarray.Dataset
        On ``record``, ``ductility`` and ``building``: ``strength_factor``, by which all yield strengths
        of the building are to be multiplied, as the axis and the cases of a sweep take them, and
        ``strength_reduction``, the factor at which it just stays elastic over that. Of several
        factors with that ductility it is the largest. Missing where a building has no storeys
        that yield, or none within a reduction of 8 times the largest ductility reaches it.

    Raises
    ------
    InputError
        No storey yields, or a ductility is below 1.

    References
    ----------
    Chopra, Dynamics of Structures, Prentice Hall: response spectra of constant ductility.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> tower = ps.Building("tower", [100.0], [4.0e3], yield_strengths=[50.0])
    >>> found = constant_ductility(ps.Scene([tower]), "el_centro", [1.0, 2.0, 4.0])  # doctest: +SKIP
    """
    import xarray as xr

    targets = np.atleast_1d(np.asarray(ductilities, float))
    if not (targets.size and np.isfinite(targets).all() and (targets >= 1.0).all()):
        msg = f"ductilities are {shown(ductilities)}; give one or several numbers of at least 1"
        raise InputError(msg)
    if not any(scene.yields):
        msg = "no storey of this row yields; give its buildings yield_strengths"
        raise InputError(msg)
    motions = resolve_records(records, folders=folders)
    found = np.stack([_of_record(scene, motion, targets, dt) for motion in motions])
    dims = ("record", "ductility", "building")
    about = (
        ("strength_factor", "factor on all yield strengths"),
        ("strength_reduction", "strength at which it just stays elastic, over that of the factor"),
    )
    return xr.Dataset(
        {
            name: (dims, found[..., i], {"units": "1", "long_name": long_name})
            for i, (name, long_name) in enumerate(about)
        },
        {
            "record": [motion.name for motion in motions],
            "ductility": ("ductility", targets, {"units": "1", "long_name": "largest storey ductility"}),
            "building": [building.name for building in scene.buildings],
        },
    )


def _of_record(scene: Scene, record: Record, targets: np.ndarray, dt: float) -> np.ndarray:
    """Factors and reductions, shape (ductilities, buildings, 2)."""
    demand = _demand(scene, record, dt)
    elastic = NEVER * demand(np.full((1, len(scene.buildings)), NEVER))[0]  # of NaN where a building does not yield
    elastic = np.where(elastic > 0.0, elastic, np.nan)
    reductions = np.geomspace(1.0, REACH * targets.max(), REDUCTIONS)
    reached = demand(elastic / reductions[:, None])
    result = np.full((len(targets), len(scene.buildings), 2), np.nan)
    enough = reached[None] >= targets[:, None, None] * (1.0 - 1e-9)
    first = np.where(enough.any(axis=1), enough.argmax(axis=1), -1)
    high = np.where(first >= 0, reductions[first], np.nan)
    low = np.where(first > 0, reductions[first - 1], high)
    for _ in range(HALVINGS):
        middle = np.sqrt(low * high)
        above = demand(elastic / middle) >= targets[:, None]
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    result[..., 0], result[..., 1] = elastic / high, high
    return result


def _demand(scene: Scene, record: Record, dt: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return what gives the ductility of each building alone, by its strength factor, both of shape (n, buildings)."""
    kernel = RowKernel(scene, get_law("none"), Numerics("rk4", dt), reducers_for(["drift_max"]), varied=True)

    def demand(factors: np.ndarray) -> np.ndarray:
        n, ones = len(factors), np.ones(factors.shape)
        known = np.where(np.isnan(factors), 1.0, factors)
        variants = Variants(scene, ones, ones, np.full(n, np.nan), known)
        gaps = np.full((n, len(scene.pair_names)), math.inf)
        lanes: dict[str, Any] = {"scale": np.ones(n), "gaps": gaps, "stiffness": np.zeros(n), "restitution": np.ones(n)}
        drift = kernel.run(record, variants=variants, **lanes)["drift"]
        ductility = drift / np.where(np.isfinite(variants.yield_drifts), variants.yield_drifts, np.inf)
        largest = np.maximum.reduceat(ductility, scene.offsets[:-1], axis=1)
        return np.where(np.isnan(factors), np.nan, largest)

    return demand
