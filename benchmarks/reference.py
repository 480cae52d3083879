"""The converged solution that errors are measured against, from two programs that share no code."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from benchmarks.engine import prepare
from benchmarks.work import ERROR_GAPS, Peaks, Work

sys.path.append(str(Path(__file__).parents[1] / "tests"))  # the reference solver lives there

#: Step (s) of the converged solution.
STEP = 5e-5


def converged(work: Work, gaps: np.ndarray = ERROR_GAPS) -> Peaks:
    """Return the engine's located Runge-Kutta solution at a step of `STEP`."""
    return prepare(work, method="rk4", dt=STEP)(gaps)


def independent(work: Work, gap: float) -> Peaks:
    """Return one scenario by the reference solver of the tests: scipy's DOP853 at 1e-10, every event located."""
    import reference

    buildings = [
        reference.ShearBuilding([*b.masses], [*b.storey_stiffnesses], rayleigh=b.rayleigh) for b in work.scene.buildings
    ]
    gaps = [gap] * (len(buildings) - 1)
    record = work.record
    found = reference.run(
        buildings, gaps, record.acceleration, record.dt, work.law, k=work.stiffness, e=work.restitution
    )
    names = ("impact_force_max", "impact_count", "displacement_max", "displacement_min")
    return Peaks(*(np.concatenate(found[name])[None].astype(float) for name in names))


def force_errors(found: Peaks, reference: Peaks) -> np.ndarray:
    """Relative error (n,) of the peak impact forces: the largest over a scenario's contacts, each of its own peak."""
    # a contact that only one of the two solutions closes has an infinite error
    off = np.abs(found.force - reference.force)
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.where(off == 0.0, 0.0, off / reference.force)
    return np.asarray(error.max(axis=1))
