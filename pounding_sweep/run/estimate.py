"""How long a run will take: a few of its scenarios run and timed, for ``plan``, where its kernels are ready."""

from __future__ import annotations

import time

import numpy as np

from pounding_sweep.engine.compile import missing_kernels
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.plan.plan import Plan
from pounding_sweep.run.refinement import run_scenarios


def measured_seconds(plan: Plan) -> float | None:
    """Return the seconds that the scenarios of a plan take on one core, by some of each law; None without kernels.

    Of a law's estimate by steps, so many times are taken as of that of two groups of its scenarios, which are timed.
    """
    if missing_kernels(plan.shapes())[0]:
        return None
    total, table, random = 0.0, plan.unique, np.random.default_rng(0)
    rows = np.flatnonzero(~plan.refused)
    for law in np.unique(table.law[rows]).tolist():
        of_law = rows[table.law[rows] == law]
        first = random.choice(of_law)
        alike = of_law[(table.record[of_law] == table.record[first]) & (plan.steps[of_law] == plan.steps[first])]
        group = random.choice(alike, 2 * LANES)
        record, steps = int(table.record[first]), int(plan.steps[first])
        task = plan.task(table[group], law, record, steps)
        run_scenarios(task)
        started = time.perf_counter()
        run_scenarios(task)
        seconds = (time.perf_counter() - started) / len(group)
        total += float(plan.seconds_of(of_law).sum()) * seconds / plan.scenario_seconds(record, steps)
    return total
