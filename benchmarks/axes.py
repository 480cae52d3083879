"""Sweeps over other things than gaps: what a scenario costs along each axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.engine import BATCH, OUTPUTS
from benchmarks.sizes import job_of
from benchmarks.timing import medians
from benchmarks.work import GAPS, Work
from pounding_sweep.plan.plan import Plan
from pounding_sweep.run.sweep import Sweep

#: Values of each axis, of one building where an axis has one; the gap axis is what the others are compared with.
AXES: dict[str, dict[str, Any]] = {
    "gap": {"gaps": np.linspace(*GAPS, BATCH)},
    "building.left.period_factor": {"period_factors": {"left": np.linspace(0.8, 1.25, BATCH)}},
    "building.left.mass_factor": {"mass_factors": {"left": np.linspace(0.5, 2.0, BATCH)}},
    "damping_ratio": {"damping_ratios": np.linspace(0.02, 0.10, BATCH)},
    "scale": {"scales": np.linspace(0.5, 2.0, BATCH)},
}


def plan_axis(work: Work, axis: str, **settings: Any) -> Plan:
    """Return the plan of a sweep of the work along one of `AXES`, all else as the scene has it."""
    sweep = Sweep(
        work.scene, work.record, work.law, stiffnesses=work.stiffness, outputs=OUTPUTS, **AXES[axis], **settings
    )
    return sweep.plan()


def relative_throughput(
    work: Work, rounds: int, axes: Sequence[str] = tuple(AXES), **settings: Any
) -> dict[str, float]:
    """Return scenarios per second along each axis over those along gaps, the plans taking turns."""
    jobs = {axis: job_of(plan_axis(work, axis, **settings)) for axis in dict.fromkeys(("gap", *axes))}
    seconds = dict(zip(jobs, medians(*jobs.values(), rounds=rounds), strict=True))
    return {axis: seconds["gap"] / seconds[axis] for axis in axes if axis != "gap"}
