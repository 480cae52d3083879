"""The slow twin of a compiled kernel: the same source, run on NumPy arrays."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from pounding_sweep.emit.spec import LANES, KernelSpec, input_slots
from pounding_sweep.kernel import life, located
from pounding_sweep.kernel.exact import March
from pounding_sweep.kernel.group import Group


def run(spec: KernelSpec, ag: Any, dtr: float, steps: int, substeps: int, constants: Any, given: Any, results: Any) -> None:
    """Do what the compiled kernel of `spec` does, one lane group after another."""
    h = dtr / steps
    ground = SimpleNamespace(
        intervals=len(ag) - 1,
        steps=steps,
        h=h,
        ends=lambda i, j: (
            ag[i] + (ag[i + 1] - ag[i]) * (j / steps),
            ag[i + 1] if j == steps - 1 else ag[i] + (ag[i + 1] - ag[i]) * ((j + 1) / steps),
        ),
        time=lambda number: number * h,
    )
    share = np.arange(steps) / steps
    track = np.append((ag[:-1, None] + (ag[1:] - ag[:-1])[:, None] * share).ravel(), ag[-1])
    with np.errstate(all="ignore"):
        for each in range(len(given)):
            group = Group(spec, None, LANES, constants)
            rows, at = given[each].reshape(-1, LANES), 0
            for name, n in input_slots(spec).count.items():
                for i in range(n):
                    group.state[name, i] = rows[at + i]
                at += n
            life.begin(group, ag[0])
            if spec.scheme == "exact":
                march = March(group, track, steps // substeps, (len(ag) - 1) * steps, (h, dtr / substeps))
                march.run(lambda group=group: located.substep(group, life.rk4_trial, h))
            else:
                life.FixedSteps(group, ground, None).run()
            life.finish(group)
            found = [group.state[name, i] for name, n in life.outputs(group) for i in range(n)]
            results[each] = np.concatenate(found)
