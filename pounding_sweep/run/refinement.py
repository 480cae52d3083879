"""Scenarios run at ever finer steps until a finer one changes nothing that was asked for.

A touch that only just happens, or a row of impacts, magnifies errors of a step by any factor, so each scenario runs at
its step and at half of it. Its error is three times what the order of the scheme makes of the difference, twice all of
it where that is one of rounding, and all of it in a number of impacts. Where it is too large, the step is halved again,
in double precision, until the error is small enough or no longer falls. Two runs in single precision round the same
inputs alike, so one has its inputs and gaps changed by as much as rounding.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pounding_sweep.engine.postprocess import variables_of
from pounding_sweep.engine.row_kernel import RowKernel
from pounding_sweep.kernel.spec import history_slots
from pounding_sweep.plan.advice import ORDERLY, rounding
from pounding_sweep.plan.scenarios import ChunkTask, Scenarios, changed
from pounding_sweep.records import Record
from pounding_sweep.request.spec import step_fault
from pounding_sweep.variables import registry
from pounding_sweep.variables.registry import CHANGE, OUTPUT_NAMES, SETTLED, VALID, Status, comparable, relative_errors

#: Halvings of a step after which single precision, and after which a scenario is given up, the first included.
SINGLE_HALVINGS, MOST_HALVINGS = 1, 6
#: Relative change of inputs between two runs in single precision, and of their gaps beside how far floors go: a few
#: units of its last place.
SHIFT = 5e-7
#: Impacts of one floor beyond which a scenario is held to less than what was asked, in proportion: the more often
#: floors meet, the likelier some graze each other by less than the error, and are counted or not.
GRAZES = 16.0

#: Difference of two runs in double precision within which smooth outputs change no more, and part of the one before
#: which it is at most while finer steps still help: a number of impacts, or what is chaotic, then settles at none.
SETTLED_SMOOTH, LEAST_FALL = 1e-9, 0.5

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


def shifted(kernel: RowKernel, table: Scenarios, result: Values) -> Scenarios:
    """Return scenarios as the run has them by which a `result` is judged."""
    if kernel.numerics.precision != "float32":
        return table
    far = np.zeros(len(table))
    for name in {"displacement_max", "displacement_min"} & result.keys():
        far = np.fmax(far, np.fmax.reduce(np.abs(result[name]).reshape(len(table), -1), axis=1, initial=0.0))
    moved = changed(table, SHIFT)
    far = np.where(np.isfinite(far), far, 0.0)[:, None] * (table.gaps > 0.0)  # floors at rest on each other stay so
    return replace(moved, gaps=moved.gaps + SHIFT * far)


def run_once(task: ChunkTask) -> Values:
    """Run scenarios at the kernel's step, those together that fly in equally long steps whatever is run beside them.

    Returns variables of shape (n, *inner), and where the kernel has a history the `STATES` of the one scenario.
    """
    kernel, record, table, variants, outputs, _ = task
    if kernel.numerics.scheme.flies_exactly and kernel.varied:
        kinds = kernel.flight_substeps(record, variants)
        parts = [np.flatnonzero(kinds == kind) for kind in np.unique(kinds)]
        if len(parts) > 1:
            results = [run_once(task.part(rows)) for rows in parts]
            order = np.argsort(np.concatenate(parts), kind="stable")
            return {name: np.concatenate([part[name] for part in results])[order] for name in results[0]}
    states = None
    if kernel.history:
        rest = int(kernel.intervals_of_rest(record, variants, table.gaps).max())
        instants = (record.n_points - 1 + rest) * kernel.numerics.steps(record) + 1
        states = np.zeros((instants, max(1, history_slots(kernel.shape).size)))
    lanes = {name: getattr(table, name) for name in ("scale", "gaps", "stiffness", "restitution")}
    raw = kernel.run(record, **lanes, variants=variants, history=states)
    result = variables_of(kernel, raw, outputs, record, variants)
    return result if states is None else {**result, STATES: states[None, : int(raw["ended"][0, 0]) + 1]}


def differences(outputs: Sequence[str], coarse: Values, fine: Values, leeway: float | np.ndarray = 1.0) -> np.ndarray:
    """Relative differences of outputs between two runs, shape (n, outputs); infinite where one has no values."""
    lost = (coarse["status"] == Status.DIVERGED) | (fine["status"] == Status.DIVERGED)
    errors = np.reshape([*relative_errors(outputs, coarse, fine).values()], (len(outputs), len(lost))).T
    counts = [fine[name].dtype.kind == "i" for name in outputs]
    return np.where(lost[:, None], np.inf, errors / np.where(counts, 1.0, leeway))  # a part of what varies smoothly


def mark_unsettled(result: Values, outputs: Sequence[str], errors: np.ndarray, accuracy: float) -> None:
    """Give scenarios with errors beyond `accuracy` their status, and name an output that has one."""
    estimate = errors.max(axis=1, initial=0.0)
    if "error_estimate" in result:
        result["error_estimate"] = estimate
    # a number of impacts is named where all else is settled
    weights = np.array([1.0 if result[name].dtype.kind == "f" else 1e-9 for name in outputs])
    for row in np.flatnonzero(np.isin(result["status"], VALID) & ~(estimate <= accuracy)):
        result["status"][row] = Status.UNSETTLED
        worst = int(np.argmax(np.where(errors[row] <= accuracy, 0.0, errors[row] * weights)))
        result["unsettled_output"][row] = OUTPUT_NAMES.index(outputs[worst])


def _run(task: ChunkTask) -> Values:
    """Run scenarios once, and where it is asked for again with all inputs changed: how much more an output does."""
    result = run_once(task)
    if "amplification" in task.outputs:
        moved = run_once(task._replace(table=changed(task.table)))
        result["amplification"] = differences(comparable(task.outputs), moved, result).max(axis=1, initial=0.0) / CHANGE
    return result


def _run_refined(task: ChunkTask, accuracy: float) -> Values:
    """Run scenarios until half the step changes no output by more than `accuracy`, or no longer changes them less."""
    kernel, record, table, *_ = task
    rows, result, halvings, outputs = np.arange(len(table)), Values(), 0, comparable(task.outputs)
    errors, earlier = np.full((len(table), len(outputs)), np.inf), np.full(len(table), np.inf)
    while len(rows) and halvings < MOST_HALVINGS and not step_fault(record, 2.0 * kernel.numerics.steps(record)):
        longer, kernel, halvings = kernel, halved(kernel, record), halvings + 1
        if halvings > SINGLE_HALVINGS:
            kernel = kernel.in_double
        fine = _run(task.part(rows)._replace(kernel=kernel))
        if halvings == 1:
            coarse = run_once(task._replace(table=shifted(task.kernel, table, fine)))
        impacts = fine.get("impact_count", np.zeros((len(rows), 1))).reshape(len(rows), -1).max(axis=1, initial=0)
        allowed = accuracy / np.maximum(1.0, impacts / GRAZES)
        is_valid = np.isin(fine["status"], VALID)
        errors[rows] = differences(outputs, coarse, fine, leeway(kernel, accuracy, allowed).reshape(-1, 1))
        beyond = (errors[rows].max(axis=1, initial=0.0) > allowed) & is_valid
        is_double = kernel.numerics.precision == "float64"
        if is_double and longer.in_double != longer and beyond.any():  # it may be the coarse run that rounds
            coarse = run_once(task.part(rows[beyond])._replace(kernel=longer.in_double))
            some = {name: values[beyond] for name, values in fine.items()}
            divisors = leeway(kernel, accuracy, allowed[beyond]).reshape(-1, 1)
            errors[rows[beyond]] = differences(outputs, coarse, some, divisors)
            beyond &= errors[rows].max(axis=1, initial=0.0) > allowed
        # a number of impacts may be one more or less at any step
        smooth = errors[rows][:, [fine[name].dtype.kind == "f" for name in outputs]].max(axis=1, initial=0.0)
        if is_double:
            beyond &= (smooth > SETTLED_SMOOTH) & ~(smooth > LEAST_FALL * earlier[rows])
        if halvings > SINGLE_HALVINGS + 1:
            earlier[rows] = smooth
        rest = beyond | ~is_valid
        if len(rows) == len(table):
            result = fine
        else:
            for name, values in fine.items():
                result[name][rows] = values
        coarse, rows = {name: values[rest] for name, values in fine.items()}, rows[rest]
    if not halvings:  # half the step is more of them than can be run
        result = run_once(task)
    mark_unsettled(result, outputs, errors, accuracy)
    return result


def run_scenarios(task: ChunkTask) -> Values:
    """Run scenarios to the kernel's accuracy, or at its step, and what else their outputs ask for; see `run_once`."""
    kernel, record, table, *_ = task
    if kernel.accuracy is not None:
        if not task.once:
            return _run_refined(task, kernel.accuracy)
        result = _run(task)
        result["error_estimate"][:] = np.nan
        if len(rows := np.flatnonzero(result["status"] != Status.OK)):
            for name, values in _run_refined(task.part(rows), kernel.accuracy).items():
                result[name][rows] = values
        return result
    result, outputs, is_asked = _run(task), comparable(task.outputs), "error_estimate" in task.outputs
    least = -np.inf if kernel.numerics.scheme.flies_exactly else kernel.law.thickness
    resting = np.asarray((table.gaps <= least).any(axis=1))
    rows = np.flatnonzero(resting | is_asked)
    if len(rows):
        coarse, errors = {name: values[rows] for name, values in result.items()}, np.zeros((len(table), len(outputs)))
        part = task.part(rows)._replace(kernel=halved(kernel, record))
        fine = run_once(part._replace(table=shifted(kernel, part.table, coarse)))
        # floors that rest on each other magnify errors by any factor: either run errs as much as the other
        judged = [name in registry.AT_REST for name in outputs]
        divisors = np.where(resting[rows, None] & judged, ROUNDS, 1.0 if is_asked else np.inf)
        errors[rows] = differences(outputs, coarse, fine, divisors)
        mark_unsettled(result, outputs, errors, SETTLED)
    return result
