"""Scenarios run at ever finer steps until a finer one changes nothing that was asked for.

An accuracy is a promise about every scenario, and no rule that is known beforehand
keeps it: a touch that only just happens, or a row of impacts that each magnify the
last, multiplies the error of a step by whatever it likes. So each scenario is run at
the step that was chosen for it and at half of it, and the latter is kept. Its error is
taken for three times what the order of the scheme makes of their difference, for twice
all of it where that is one of rounding, and for all of it in a number of impacts. What
errs by more than was asked is run at half the step again, in double precision, and so on.
The last estimate is reported with the scenario.

Two runs in single precision round the same inputs alike, and where steps are exact all else
too. So one of them is run with its inputs, and its floors' distance, changed by as much as
that: what is magnified until it tells shows in their difference.

What is done with a scenario follows from its own results alone, so it does not depend
on the chunk that it is in.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pounding_sweep.engine.postprocess import variables_of
from pounding_sweep.engine.row_kernel import RowKernel
from pounding_sweep.kernel.spec import history_slots
from pounding_sweep.model.variants import Variants
from pounding_sweep.outputs.variables import CHANGE, SETTLED, Status, comparable, get_variable, relative_errors
from pounding_sweep.plan.advice import ORDERLY, rounding
from pounding_sweep.plan.scenarios import Scenarios, changed
from pounding_sweep.records import Record
from pounding_sweep.spec.spec import step_fault

#: Halvings of a step after which single precision, and after which a scenario is given up, the first included.
SINGLE_HALVINGS, MOST_HALVINGS = 1, 6
#: Relative change of inputs between two runs in single precision, and of their gaps beside how far floors go: a few
#: units of its last place.
APART = 5e-7
#: Impacts of one floor beyond which a scenario is held to less than what was asked, in proportion: the more often
#: floors meet, the likelier some graze each other by less than the error, and are counted or not.
GRAZES = 16.0

#: What the difference of two runs is divided by where it is one of rounding: either errs as much as the other.
ROUNDS = 0.5

Values = dict[str, np.ndarray]
#: Name of the states of a scenario beside its variables, shape (1, instants, slots).
STATES = "states"


def halved(kernel: RowKernel, record: Record) -> RowKernel:
    """Return the kernel at half of all its steps."""
    numerics = kernel.numerics
    half = replace(numerics, dt=record.dt / (2 * numerics.steps(record)), refinement=2.0 * numerics.refinement)
    return replace(kernel, numerics=half)


def ended(kernel: RowKernel, record: Record, steps: int) -> RowKernel:
    """Return the kernel with which a scenario ended that began with this one and was refined to so many steps."""
    for halving in range(round(math.log2(steps / kernel.numerics.steps(record)))):
        kernel = halved(kernel if halving < SINGLE_HALVINGS else kernel.in_double, record)
    return kernel


def leeway(kernel: RowKernel, accuracy: float, allowed: np.ndarray) -> np.ndarray:
    """By what the difference to a run at twice the step is divided, where it follows from the scheme's order."""
    # steps by series differ by their rounding, velocities that jump by when they do
    ordered = not kernel.law.impulsive and accuracy <= ORDERLY
    single = kernel.numerics.precision == "float32"
    rounds = kernel.shape.series > 0 or (single & (allowed < rounding(kernel.numerics.method)))
    return np.where(rounds, ROUNDS, kernel.numerics.scheme.leeway if ordered else 1.0)


def apart(kernel: RowKernel, table: Scenarios, found: Values) -> Scenarios:
    """Return scenarios as the run has them by which what was `found` is judged."""
    if kernel.numerics.precision != "float32":
        return table
    far = np.zeros(len(table))
    for name in ("displacement_max", "displacement_min"):
        if name in found:
            far = np.fmax(far, np.fmax.reduce(np.abs(found[name]).reshape(len(table), -1), axis=1, initial=0.0))
    moved = changed(table, APART)
    return replace(moved, gaps=moved.gaps + APART * np.where(np.isfinite(far), far, 0.0)[:, None])


def run_once(kernel: RowKernel, record: Record, table: Scenarios, variants: Variants, outputs: Sequence[str]) -> Values:
    """Run scenarios at the kernel's step, those together that fly in equally long steps whatever is run beside them.

    Returns variables of shape (n, *inner), and where the kernel has a history the `STATES` of the one scenario.
    """
    if kernel.numerics.scheme.flies_exactly and kernel.varied:
        flight_substeps = kernel.flight_substeps(record, variants)
        if len(kinds := np.unique(flight_substeps)) > 1:
            parts = [np.flatnonzero(flight_substeps == kind) for kind in kinds]
            found = [run_once(kernel, record, table[rows], variants[rows], outputs) for rows in parts]
            order = np.argsort(np.concatenate(parts), kind="stable")
            return {name: np.concatenate([part[name] for part in found])[order] for name in found[0]}
    states = None
    if kernel.history:
        instants = (record.n_points - 1) * kernel.numerics.steps(record) + 1
        states = np.zeros((instants, max(1, history_slots(kernel.shape).size)))
    raw = kernel.run(
        record,
        scale=table.scale,
        gaps=table.gaps,
        stiffness=table.stiffness,
        restitution=table.restitution,
        variants=variants,
        history=states,
    )
    result = variables_of(kernel, raw, outputs, record, variants)
    return result if states is None else {**result, STATES: states[None]}


def differences(outputs: Sequence[str], coarse: Values, fine: Values, leeway: float | np.ndarray = 1.0) -> np.ndarray:
    """Largest relative difference of an output between two runs, shape (n,); infinite where one has no values."""
    # That of what varies smoothly is divided by `leeway`.
    found = relative_errors(outputs, coarse, fine)
    found = {name: each / leeway if get_variable(name).dtype == "f8" else each for name, each in found.items()}
    worst = np.max(list(found.values()), axis=0, initial=0.0) if found else np.zeros(len(fine["status"]))
    lost = (coarse["status"] == Status.DIVERGED) | (fine["status"] == Status.DIVERGED)
    return np.where(lost, np.inf, worst)


def amplification(
    kernel: RowKernel, record: Record, table: Scenarios, variants: Variants, outputs: Sequence[str], found: Values
) -> np.ndarray:
    """How much more an output of what was `found` changes, relatively, than all inputs together, shape (n,)."""
    moved = run_once(kernel, record, changed(table), variants, outputs)
    return differences(comparable(outputs), moved, found) / CHANGE


def run_refined(
    kernel: RowKernel,
    record: Record,
    table: Scenarios,
    variants: Variants,
    outputs: Sequence[str],
    accuracy: float,
) -> Values:
    """Run scenarios until half the step changes no output by more than `accuracy`."""
    judged = comparable(outputs)
    rows = np.arange(len(table))
    result: Values = {}
    estimate, halvings = np.full(len(table), np.inf), 0
    while len(rows) and halvings < MOST_HALVINGS and not step_fault(record, 2.0 * kernel.numerics.steps(record)):
        begun, kernel, halvings = kernel, halved(kernel, record), halvings + 1
        if halvings > SINGLE_HALVINGS:
            kernel = kernel.in_double
        mine, own = (table, variants) if halvings == 1 else (table[rows], variants[rows])
        fine = run_once(kernel, record, mine, own, outputs)
        if halvings == 1:
            coarse = run_once(begun, record, apart(begun, table, fine), variants, outputs)
        if "amplification" in outputs:
            fine["amplification"] = amplification(kernel, record, mine, own, outputs, fine)
        allowed = accuracy / strictness(fine)
        estimate[rows] = differences(judged, coarse, fine, leeway(kernel, accuracy, allowed))
        rest = (estimate[rows] > allowed) | (fine["status"] != Status.OK)
        if len(rows) == len(table):
            result = fine
        else:
            for name, values in fine.items():
                result[name][rows] = values
        coarse, rows = {name: values[rest] for name, values in fine.items()}, rows[rest]
    if not halvings:  # half the step is more of them than can be run
        result = run_once(kernel, record, table, variants, outputs)
    result["status"][(result["status"] == Status.OK) & ~(estimate <= accuracy)] = Status.UNSETTLED
    result["error_estimate"] = estimate
    return result


def strictness(found: Values) -> np.ndarray:
    """By how much scenarios whose impacts are counted are held to less than what was asked, shape (n,)."""
    if "impact_count" not in found:
        return np.ones(len(found["status"]))
    most = found["impact_count"].reshape(len(found["status"]), -1).max(axis=1, initial=0)
    return np.maximum(1.0, most / GRAZES)


def run_scenarios(
    kernel: RowKernel, record: Record, table: Scenarios, variants: Variants, outputs: Sequence[str]
) -> Values:
    """Run scenarios to the kernel's accuracy, or at its step, and what else their outputs ask for; see `run_once`."""
    if kernel.accuracy is not None:
        return run_refined(kernel, record, table, variants, outputs, kernel.accuracy)
    result = run_once(kernel, record, table, variants, outputs)
    if "amplification" in outputs:
        result["amplification"] = amplification(kernel, record, table, variants, outputs, result)
    if "error_estimate" not in outputs:
        return result
    fine = run_once(halved(kernel, record), record, apart(kernel, table, result), variants, outputs)
    estimate = differences(comparable(outputs), result, fine)
    result["status"][(result["status"] == Status.OK) & ~(estimate <= SETTLED)] = Status.UNSETTLED
    result["error_estimate"] = estimate
    return result
