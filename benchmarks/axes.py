"""Sweeps over other things than gaps, ``python -m benchmarks.axes``: what a scenario costs along each axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.engine import BATCH, OUTPUTS, run_chunks
from benchmarks.timing import medians
from benchmarks.work import GAPS, Work, make_work
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
    plans = {axis: plan_axis(work, axis, **settings) for axis in dict.fromkeys(("gap", *axes))}
    jobs = [lambda plan=plan: run_chunks(plan) for plan in plans.values()]
    for job in jobs:  # compiled
        job()
    seconds = dict(zip(plans, medians(*jobs, rounds=rounds), strict=True))
    return {axis: seconds["gap"] / seconds[axis] for axis in axes if axis != "gap"}


def main() -> None:
    """Print scenarios per second along each axis over those along gaps, under some of the record and all of it."""
    found = [relative_throughput(make_work(short=short), 25, method="exact", dt=2.5e-3) for short in (True, False)]
    print(f"{'':32}{'short':>8}{'whole':>8}")
    for axis in found[0]:
        print(f"{axis:32}{found[0][axis]:8.2f}{found[1][axis]:8.2f}")


if __name__ == "__main__":
    main()
