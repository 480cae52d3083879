"""Strengths at which buildings reach a given ductility without pounding."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.base.errors import InputError, shown
from pounding_sweep.engine.ductility import STEP, strengths_for
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.records import resolve_records


def constant_ductility(
    scene: Scene, records: Any, ductilities: Sequence[float] | float, *, dt: float = STEP, folders: Any = None
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
        On ``record``, ``ductility`` and ``building``: ``strength_factor``, by which all yield strengths of the building
        are to be multiplied, as the axis and the cases of a sweep take them, and ``strength_reduction``, the factor at
        which it just stays elastic over that. Of several factors with that ductility it is the largest. Missing where a
        building has no storeys that yield, or none within a reduction of 8 times the largest ductility reaches it.

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
    targets = np.atleast_1d(np.asarray(ductilities, float))
    if not (targets.size and np.isfinite(targets).all() and (targets >= 1.0).all()):
        raise InputError(f"ductilities are {shown(ductilities)}; give one or several numbers of at least 1")
    if not any(scene.yields):
        raise InputError("no storey of this row yields; give its buildings yield_strengths")
    motions = resolve_records(records, folders=folders)
    rows = Variants(scene, *(np.repeat(column, len(targets), axis=0) for column in variants_of(scene).columns))
    found = np.stack([np.stack(strengths_for(rows, motion, targets, dt), axis=-1) for motion in motions])
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
