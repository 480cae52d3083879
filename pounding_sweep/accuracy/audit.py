"""The audit: a sample of a sweep's own scenarios run again at half the step.

A cube then carries the error of its own numbers, by measurement. The sample
is drawn by a generator that the sweep's digest seeds, so that the same sweep
has the same audit, whoever runs it and however often it was interrupted.

Each group of lanes holds scenarios at half the step, and the same ones with
gaps, contact stiffness and record changed by a relative 1e-9 (in single
precision, by some units of the last place). Where such a change, far below
any engineering meaning, changes the answer visibly, no step size helps: the
scenario is sensitive, and is reported as such, apart from the others, never
left out.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pounding_sweep.accuracy.measure import PERTURBATION, SENSITIVE, comparable, relative_errors
from pounding_sweep.cube.variables import STATUS, Status
from pounding_sweep.kernels.shape import LANES
from pounding_sweep.sweep.execute import run_chunk
from pounding_sweep.sweep.scenarios import Scenarios

if TYPE_CHECKING:
    import xarray as xr

    from pounding_sweep.sweep.execute import Outcome
    from pounding_sweep.sweep.plan import Plan

#: Scenarios of one lane group; each is there twice.
GROUP = LANES // 2
#: Steps of the audit in one step of the sweep.
FINER = 2
#: Error of an ok scenario beyond which a warning is given, where the sweep asked for none.
TOLERANCE = 0.05
#: How the flag is spelt in a cube.
FLAGS = {"flag_values": np.array([0, 1], np.int8), "flag_meanings": "steady sensitive"}


@dataclass(frozen=True)
class Sample:
    """Scenarios of one law, record and step that are run again together.

    Attributes
    ----------
    rows : ndarray of int
        Rows of the plan's unique scenarios, at most `GROUP`.
    law, record, steps : int
        Index of the law and the record, and steps per record interval in the sweep.
    """

    rows: np.ndarray
    law: int
    record: int
    steps: int

    def cost(self, plan: Plan) -> int:
        """Lane-steps that it takes; a group costs all its lanes, filled or not."""
        return LANES * FINER * self.steps * (plan.spec.records[self.record].n_points - 1)


@dataclass(frozen=True)
class Audit:
    """Measured errors of a sample of scenarios.

    Attributes
    ----------
    rows : ndarray of int, shape (n,)
        Rows of the plan's unique scenarios, rising.
    outputs : tuple of str
        Outputs that have an error.
    error, sensitivity : ndarray, shape (n, outputs)
        Relative difference to half the step, and relative change by the perturbation.
    status : ndarray of int, shape (n,)
        How the scenario ended in the sweep.
    sensitive : ndarray of bool, shape (n,)
        Where no step size helps.
    touching : int
        Touching scenarios of the sweep that the sample was drawn from.
    share : float
        Cost over that of the touching scenarios in the sweep, in lane-steps.
    tolerance : float
        Error that was asked for, or `TOLERANCE`.
    """

    rows: np.ndarray
    outputs: tuple[str, ...]
    error: np.ndarray
    sensitivity: np.ndarray
    status: np.ndarray
    sensitive: np.ndarray
    touching: int
    share: float
    tolerance: float

    @property
    def exceeding(self) -> np.ndarray:
        """Scenarios with status ok, not sensitive, whose error is beyond the tolerance."""
        return ~self.sensitive & (self.status == Status.OK) & (self.error.max(axis=1) > self.tolerance)


def candidates(plan: Plan, outcome: Outcome) -> np.ndarray:
    """Rows of the unique scenarios that touched and have values.

    A velocity jump has no contact that lasts, by which it would be known: all that might touch count.
    """
    if outcome.left_out is None:
        return np.zeros(0, dtype=int)
    valued = np.isin(outcome.values["status"], [int(s) for s in STATUS if s.has_values])
    impulsive = np.array([law.impulsive for law in plan.laws])[plan.unique.law]
    touched = impulsive | np.isfinite(outcome.values["steps_per_contact"])
    return np.flatnonzero(valued & touched & ~outcome.left_out)


def sweep_cost(plan: Plan, rows: np.ndarray) -> int:
    """Lane-steps of the scenarios `rows` in the sweep."""
    points = np.array([record.n_points - 1 for record in plan.spec.records])
    return int((plan.steps[rows] * points[plan.unique.record[rows]]).sum())


def draw(plan: Plan, rows: np.ndarray) -> list[Sample]:
    """Draw the groups of an audit.

    Parameters
    ----------
    plan : Plan
        The sweep.
    rows : ndarray of int
        Rows to draw from; of their cost, `plan.spec.audit` is the share that may be spent.

    Returns
    -------
    list of Sample
        Groups without a common row, drawn with probability proportional to the number of
        scenarios, those left out that the rest of the budget can't pay; at least one where
        there are rows, at most half the rows together.
    """
    if not len(rows) or plan.spec.audit <= 0.0:
        return []
    random = np.random.Generator(np.random.PCG64(int(plan.digest[:16], 16)))
    table = plan.unique
    kinds = np.stack([table.record[rows], table.law[rows], plan.steps[rows]], axis=1)
    groups: list[Sample] = []
    for record, law, steps in np.unique(kinds, axis=0).tolist():
        mine = random.permutation(rows[(kinds == (record, law, steps)).all(axis=1)])
        groups += [Sample(mine[i : i + GROUP], law, record, steps) for i in range(0, len(mine), GROUP)]
    sizes = np.array([len(group.rows) for group in groups], dtype=float)
    order = random.choice(len(groups), size=len(groups), replace=False, p=sizes / sizes.sum())
    left, budget = max(1, len(rows) // 2), plan.spec.audit * sweep_cost(plan, rows)
    drawn = [groups[index] for index in order.tolist()]
    affordable = [group for group in drawn if group.cost(plan) <= budget] or drawn[:1]
    chosen: list[Sample] = []
    for group in affordable:
        if left and (not chosen or group.cost(plan) <= budget):
            chosen.append(Sample(np.sort(group.rows[:left]), group.law, group.record, group.steps))
            left -= len(chosen[-1].rows)
            budget -= group.cost(plan)
    return chosen


def audit(plan: Plan, outcome: Outcome) -> Audit | None:
    """Run a sample of a sweep's scenarios again at half the step.

    Parameters
    ----------
    plan : Plan
        The sweep.
    outcome : Outcome
        Its results. The kernels are those that it compiled.

    Returns
    -------
    Audit or None
        None where nothing touched, nothing has an error, or the sweep wants no audit.

    Warns
    -----
    RuntimeWarning
        An ok scenario's error is beyond what was asked for (5 % where nothing was), or the sample could not be run.
    """
    outputs = comparable(plan.spec.outputs)
    rows = candidates(plan, outcome)
    samples = draw(plan, rows) if outputs else []
    if not samples:
        return None
    tolerance = TOLERANCE if plan.spec.accuracy is None else plan.spec.accuracy
    error, sensitivity, sensitive = [], [], []
    for sample in samples:
        found = _run(plan, sample)
        if isinstance(found, str):
            warnings.warn(f"the audit has no result: {found}", RuntimeWarning, stacklevel=3)
            return None
        fine, moved = found
        own = {name: outcome.values[name][sample.rows] for name in outputs}
        error.append(_table(relative_errors(outputs, own, fine)))
        sensitivity.append(_table(relative_errors(outputs, moved, fine)))
        sensitive.append(_counts_differ(moved, fine) | (sensitivity[-1].max(axis=1) > min(SENSITIVE, tolerance)))
    where = np.concatenate([sample.rows for sample in samples])
    order = np.argsort(where)
    where = where[order]
    result = Audit(
        rows=where,
        outputs=outputs,
        error=np.concatenate(error)[order],
        sensitivity=np.concatenate(sensitivity)[order],
        status=outcome.values["status"][where],
        sensitive=np.concatenate(sensitive)[order],
        touching=len(rows),
        share=sum(sample.cost(plan) for sample in samples) / sweep_cost(plan, rows),
        tolerance=tolerance,
    )
    _warn(plan, result)
    return result


def _run(plan: Plan, sample: Sample) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]] | str:
    """Results at half the step, as they are and with everything a little changed; or what went wrong.

    Gaps and stiffness are changed one way and the record the other: a linear
    contact that is scaled as a whole would answer in proportion.
    """
    table, n = plan.unique[sample.rows], len(sample.rows)
    change = PERTURBATION[plan.numerics.precision]
    more, less = 1.0 + change, 1.0 - change
    both = Scenarios(
        np.concatenate([table.law, table.law]),
        np.concatenate([table.record, table.record]),
        np.concatenate([table.scale, table.scale * less]),
        np.concatenate([table.stiffness, table.stiffness * more]),
        np.concatenate([table.restitution, table.restitution]),
        np.concatenate([table.gaps, table.gaps * more]),
    )
    kernel = plan.kernel(sample.law, record=sample.record, steps=FINER * sample.steps)
    found = run_chunk(kernel, plan.spec.records[sample.record], both, plan.outputs)
    if isinstance(found, str):
        return found
    return {name: values[:n] for name, values in found.items()}, {name: values[n:] for name, values in found.items()}


def _counts_differ(first: dict[str, np.ndarray], second: dict[str, np.ndarray]) -> np.ndarray:
    """Whether impacts were won or lost, where the sweep counts them."""
    n = len(first["status"])
    if "impact_count" not in first:
        return np.zeros(n, bool)
    return np.asarray((first["impact_count"] != second["impact_count"]).reshape(n, -1).any(axis=1))


def _table(errors: dict[str, np.ndarray]) -> np.ndarray:
    """One column per output."""
    return np.stack(list(errors.values()), axis=1)


def _warn(plan: Plan, found: Audit) -> None:
    exceeding = found.exceeding
    if not exceeding.any():
        return
    worst = np.where(exceeding[:, None], found.error, 0.0).max(axis=0)
    output = int(np.argmax(worst))
    asked = f"the {found.tolerance:g} asked for" if plan.spec.accuracy is not None else f"{found.tolerance:.0%}"
    remedy = "ask for a smaller accuracy" if plan.spec.accuracy is not None else "use a smaller dt"
    warnings.warn(
        f"the audit of {len(found.rows)} scenarios found {int(exceeding.sum())} with status ok whose error is beyond "
        f"{asked}, the worst {worst[output]:.2g} in {found.outputs[output]}; {remedy} (see audit_error in the cube)",
        RuntimeWarning,
        stacklevel=4,
    )


def add_to_cube(cube: xr.Dataset, plan: Plan, found: Audit) -> xr.Dataset:
    """Put an audit into a cube: dimensions ``audit`` and ``output``, and attributes on every output.

    Parameters
    ----------
    cube : xarray.Dataset
        The cube of the plan.
    plan : Plan
        The sweep.
    found : Audit
        Its audit.

    Returns
    -------
    xarray.Dataset
        With ``audit_error``, ``audit_sensitivity`` (audit, output), ``audit_sensitive`` and
        ``audit_status`` (audit), and coordinates that say which scenario each row is.
    """
    table = plan.unique[found.rows]
    dt = np.array([record.dt for record in plan.spec.records])[table.record] / plan.steps[found.rows]
    errors, rows = ("audit", "output"), ("audit",)
    change = PERTURBATION[plan.numerics.precision]
    about_status = {key: cube["status"].attrs[key] for key in ("flag_values", "flag_meanings")}
    data = {
        "audit_error": (errors, found.error, "relative error, by the difference to half the time step", "1"),
        "audit_sensitivity": (errors, found.sensitivity, f"relative change by a change of {change:g}", "1"),
        "audit_sensitive": (rows, found.sensitive.astype(np.int8), "whether no step size helps", "1"),
        "audit_status": (rows, found.status.astype(np.int8), "status of the scenario in the sweep", "1"),
    }
    names = np.array([law.key for law in plan.laws])
    coordinates = {
        "audit": (rows, np.arange(1, len(found.rows) + 1, dtype=np.int32), "scenario run again", "1"),
        "output": (("output",), np.array(found.outputs), "output whose error it is", ""),
        "audit_law": (rows, names[table.law], "contact law", ""),
        "audit_record": (rows, np.array([r.name for r in plan.spec.records])[table.record], "ground-motion record", ""),
        "audit_scale": (rows, table.scale, "factor on the record", "1"),
        "audit_stiffness": (rows, table.stiffness, "contact stiffness (kN/m**exponent of the law)", ""),
        "audit_restitution": (rows, table.restitution, "nominal coefficient of restitution, 1 for laws without", "1"),
        "audit_gap": ((*rows, "pair"), table.gaps, "gap of the pair", "m"),
        "audit_time_step": (rows, dt, "time step in the sweep", "s"),
    }
    import xarray as xr

    def array(dims: tuple[str, ...], values: np.ndarray, long_name: str, units: str) -> xr.Variable:
        stored = xr.Variable(dims, values, {"long_name": long_name, **({"units": units} if units else {})})
        stored.encoding = {"_FillValue": None}
        return stored

    result = cube.assign({name: array(*item) for name, item in data.items()})
    result = result.assign_coords({name: array(*item) for name, item in coordinates.items()})
    result["audit_sensitive"].attrs |= FLAGS
    result["audit_status"].attrs |= about_status
    steady = ~found.sensitive
    for i, name in enumerate(found.outputs):
        if steady.any() and name in result:
            result[name].attrs["audit_error_max"] = float(found.error[steady, i].max())
            result[name].attrs["audit_error_median"] = float(np.median(found.error[steady, i]))
    result.attrs["audit_scenarios"] = len(found.rows)
    result.attrs["audit_touching"] = found.touching
    result.attrs["audit_share"] = found.share
    result.attrs["audit_perturbation"] = change
    return result
