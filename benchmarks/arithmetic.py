"""The engine's arithmetic beside a C kernel of the same step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.c_kernel import WIDTHS, CKernel, find_compiler
from benchmarks.engine import OUTPUTS
from benchmarks.timing import medians
from benchmarks.work import Work, neighbouring_gaps
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.model.laws import get_law
from pounding_sweep.variables.registry import reducers_for

#: Time step (s) of both, and lane groups of one call.
STEP, GROUPS = 1e-3, 2

Job = Callable[[], dict[str, np.ndarray]]


@dataclass(frozen=True)
class Arithmetic:
    """Time of the engine's Runge-Kutta kernels over that of the C kernel, on the same scenarios and steps."""

    plain: float  # of the kernel that does just the same: contacts switched at stages, peaks sampled at steps
    located: float  # of the kernel that sweeps use, which locates contacts and peaks inside the step
    width: int  # doubles to a vector of the C kernel, the fastest that was tried


def engine_job(work: Work, *, locate: bool) -> Job:
    """Return the engine's Runge-Kutta kernel, compiled and warm: ``umax``, ``umin``, ``fmax`` and ``count`` by lane."""
    kernel = RowKernel(work.scene, get_law("linear"), Numerics("rk4", STEP, locate=locate), reducers_for(OUTPUTS))
    values = _lanes(work)

    def run() -> dict[str, np.ndarray]:
        return kernel.run(work.record, restitution=np.ones(GROUPS * LANES), **values)

    run()
    return run


def c_jobs(work: Work) -> dict[int, Job]:
    """Return the C kernel by vector width; empty without a compiler."""
    compiler, steps = find_compiler(), Numerics("rk4", STEP).steps(work.record)
    widths = WIDTHS if compiler else ()
    values = _lanes(work)
    return {
        width: CKernel(str(compiler), width).prepare(work.scene, work.record, steps=steps, **values) for width in widths
    }


def _lanes(work: Work) -> dict[str, Any]:
    """Whole lane groups of neighbouring gaps."""
    n = GROUPS * LANES
    gaps = np.repeat(neighbouring_gaps(n)[:, None], len(work.scene.pair_names), axis=1)
    return {"scale": np.ones(n), "gaps": gaps, "stiffness": np.full(n, work.stiffness)}


def measure_c(work: Work, rounds: int) -> Arithmetic | None:
    """Time both against each other; None without a compiler."""
    others = c_jobs(work)
    if not others:
        return None
    own = [engine_job(work, locate=locate) for locate in (False, True)]
    plain, located, *theirs = medians(*own, *others.values(), rounds=rounds)
    best, width = min(zip(theirs, others, strict=True))
    return Arithmetic(plain / best, located / best, width)
