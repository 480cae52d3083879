"""Which scenarios of a sweep its speed-accuracy trade is measured on.

Errors are measured on scenarios drawn at random, costs on scenarios that stand
side by side in the sweep: neighbouring gaps share a lane group there, and
contacts that fall together cost less.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pounding_sweep.base.errors import InputError
from pounding_sweep.emit.spec import LANES
from pounding_sweep.engine.postprocess import variables_of
from pounding_sweep.engine.row_kernel import Numerics
from pounding_sweep.plan.plan import Plan, untouched
from pounding_sweep.schemes.stability import largest_step

#: Largest step (s) of the runs without pounding that tell which scenarios can touch.
CLOSING_STEP = 1.0e-3
#: Lane groups of one timed call.
TIMED_GROUPS = 2


@dataclass(frozen=True)
class Group:
    """Scenarios of one law and one record: one kernel call.

    Attributes
    ----------
    law, record : int
        Index into the plan's laws and records.
    rows : ndarray of int
        Rows of the plan's table of unique scenarios.
    """

    law: int
    record: int
    rows: np.ndarray


@dataclass(frozen=True)
class Sample:
    """What is run to measure a trade.

    Attributes
    ----------
    groups : tuple of Group
        Random scenarios, for errors.
    timed : tuple of Group
        One per law: scenarios that stand side by side in the sweep, in whole lane groups, for costs.
    touching : ndarray of bool
        Rows of the plan's table in which floors can meet.
    """

    groups: tuple[Group, ...]
    timed: tuple[Group, ...]
    touching: np.ndarray

    @property
    def rows(self) -> np.ndarray:
        """Rows of all scenarios whose errors are measured, group by group."""
        return np.concatenate([group.rows for group in self.groups])


def find_touching(plan: Plan) -> np.ndarray:
    """Rows of the plan's unique table in which floors can meet, found by runs without pounding."""
    last = len(plan.laws) - 1
    contacts = plan.spec.scene.contacts
    if not contacts:
        return np.zeros(len(plan.unique), bool)
    one = np.ones(len(plan.variants))
    limit = largest_step(plan.variants, plan.laws[last], 0.0 * one, one, method="rk4")
    step = min(CLOSING_STEP, 0.5 * float(limit.min()))
    kernel = replace(plan.kernel(last, closing=True), numerics=Numerics("rk4", step))
    motions = plan.uncoupled_runs
    closing = np.full((len(motions), len(contacts)), np.inf)
    for record in np.unique(motions.record):
        rows, motion = np.flatnonzero(motions.record == record), plan.spec.records[record]
        table = motions[rows]
        variants = plan.variants[table.variant]
        values = {"scale": table.scale, "stiffness": table.stiffness, "restitution": table.restitution}
        raw = kernel.run(motion, gaps=table.gaps, variants=variants, **values)
        found = variables_of(kernel, raw, ("closing_max",), motion, variants)["closing_max"]
        for j, contact in enumerate(contacts):
            closing[rows, j] = found[:, contact.pair, contact.storey - 1]
    return ~untouched(plan, closing)


def draw(plan: Plan, scenarios: int, seed: int) -> Sample:
    """Draw the scenarios of a trade: every law alike, records as often as the sweep has them."""
    rng = np.random.default_rng(seed)
    touching = find_touching(plan)
    table = plan.unique
    laws = np.unique(table.law[touching]).tolist()
    if not laws:
        msg = "no scenario of this sweep can touch, so there is no contact to compare schemes by; give smaller gaps"
        raise InputError(msg)
    size = min(LANES, -(-scenarios // len(laws)))
    n_groups = max(len(laws), round(scenarios / size))
    groups, timed = [], []
    for place, law in enumerate(laws):
        free = np.flatnonzero(touching & (table.law == law))
        record = int(table.record[rng.choice(free)])
        timed.append(Group(law, record, _side_by_side(plan, free[table.record[free] == record], rng)))
        for _ in range(n_groups // len(laws) + (place < n_groups % len(laws))):
            if not len(free):
                break
            record = int(table.record[rng.choice(free)])
            mine = free[table.record[free] == record]
            rows = np.sort(rng.choice(mine, min(size, len(mine)), replace=False))
            groups.append(Group(law, record, rows))
            free = np.setdiff1d(free, rows)
    return Sample(tuple(groups), tuple(timed), touching)


def _side_by_side(plan: Plan, rows: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Whole lane groups out of `rows` of one law and record, in the order in which a sweep runs them."""
    order = np.concatenate([chunk.rows for chunk in plan.chunks(rows)])
    size = TIMED_GROUPS * LANES
    first = int(rng.integers(max(1, len(order) - size + 1)))
    return np.resize(order[first : first + size], size)
