"""How often promises are kept: ``python -m benchmarks.promises``.

Random realistic rows under real and synthetic earthquakes, none of them known to the calibration, are run as a user's
sweep runs them and compared with converged runs: an accuracy asked for must be reached in every output, with energies
and without, and the peaks of a scenario of status ok must be within `OK_CLAIM`. Scenarios without a converged run are
left out, and counted.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, fields, replace
from itertools import product

import numpy as np

from benchmarks.calibrate import OUTPUTS
from benchmarks.drawn_rows import CASES, KINDS, SHAPES, draw, earthquakes, kind_of
from pounding_sweep.accuracy.extremes import PEAKS
from pounding_sweep.model.laws import LAWS
from pounding_sweep.plan.plan import Plan, make_plan
from pounding_sweep.plan.scenarios import ChunkTask
from pounding_sweep.request.spec import METHODS, SweepSpec
from pounding_sweep.run.execute import run_chunk
from pounding_sweep.schemes import SCHEMES, reference_scheme
from pounding_sweep.variables.registry import CHANGE, CLASSES, OK_CLAIM, Status, relative_errors

#: Relative errors that are asked for, and steps (s) at which schemes are run.
ACCURACIES = (1e-2, 1e-3, 1e-4)
STEPS = (5e-3, 2e-3, 1e-3, 5e-4)
#: Outputs that are asked for: all, and those that are found in single precision where the accuracy allows it.
ASKED = {"": OUTPUTS, ", no energies": tuple(name for name in OUTPUTS if name not in CLASSES["energies"])}
#: First step of a converged run (s), how often it is halved, and which change by a halving is none.
REFERENCE_STEP, REFERENCE_HALVINGS, CONVERGED = 1e-4, 4, 1e-5


def run_chunks(plan: Plan) -> dict[str, np.ndarray]:
    """Run all scenarios of a plan in this thread; returns variables of shape (unique scenarios, *inner)."""
    found: dict[str, np.ndarray] = {}
    for chunk in plan.chunks(np.arange(len(plan.unique))):
        kernel = plan.kernel(chunk.law, record=chunk.record, steps=chunk.steps)
        table = plan.unique[chunk.rows]
        record = plan.spec.records[chunk.record]
        part = run_chunk(ChunkTask(kernel, record, table, plan.variants[table.variant], plan.outputs))
        if isinstance(part, str):
            raise RuntimeError(part)
        for name in part.dtype.names or ():
            values = part[name]
            whole = found.setdefault(name, np.empty((len(plan.unique), *values.shape[1:]), values.dtype))
            whole[chunk.rows] = values
    return found


def run_cases(spec: SweepSpec) -> dict[str, np.ndarray]:
    """Run the cases of a sweep, in their order, as a worker does."""
    plan = make_plan(spec)
    found = run_chunks(plan)
    found["status"][plan.refused] = Status.BEYOND_STABILITY_LIMIT
    return {name: values[plan.inverse] for name, values in found.items()}


def reference(spec: SweepSpec) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Converged runs of a sweep's cases, and by how much the last halving of the step changed each."""
    assert spec.cases is not None
    step, rows = REFERENCE_STEP, np.arange(len(spec.cases))
    method = reference_scheme(spec.scene, np.array([case.gap for case in spec.cases], float))
    plain = replace(spec, method=method, dt=step, accuracy=None, precision="float64")
    coarse = result = run_cases(plain)
    change = np.full(len(rows), np.inf)
    for _ in range(REFERENCE_HALVINGS):
        step /= 2.0
        fine = run_cases(replace(plain, dt=step, cases=tuple(spec.cases[i] for i in rows)))
        change[rows] = np.max(list(relative_errors(OUTPUTS, coarse, fine).values()), axis=0)
        for name, values in fine.items():
            result[name][rows] = values
        rest = change[rows] > CONVERGED
        coarse, rows = {name: values[rest] for name, values in fine.items()}, rows[rest]
        if not len(rows):
            break
    return result, change


@dataclass
class Kept:
    """How one promise was kept by one class of scenarios."""

    #: ok ones with a converged run to compare with, and ok ones without
    scenarios: int = 0
    unknown: int = 0
    unsettled: int = 0  # those that said themselves that they did not reach it
    #: off by more than was promised, and by more than three times that
    missed: int = 0
    far: int = 0
    #: those that a change of all inputs by 1e-6 changes by more than was promised; none is excused for it
    sensitive: int = 0
    worst: float = 0.0  # largest error over what was promised
    outputs: Counter[str] = field(default_factory=Counter)  # missed ones by the output that is farthest off

    def __add__(self, other: Kept) -> Kept:
        sums = {each.name: getattr(self, each.name) + getattr(other, each.name) for each in fields(self)}
        return Kept(**{**sums, "worst": max(self.worst, other.worst)})


def judged(
    found: dict[str, np.ndarray],
    converged: tuple[dict[str, np.ndarray], np.ndarray],
    names: Sequence[str],
    promised: float,
    amplification: np.ndarray,
) -> Kept:
    """Count how often runs keep a promise about some outputs."""
    values, change = converged
    errors = relative_errors(names, found, values)
    keys, table = list(errors), np.stack(list(errors.values()))
    ok, known = found["status"] == Status.OK, change <= 0.1 * promised
    error = table.max(axis=0) / promised
    missed = ok & known & (error > 1.0)
    return Kept(
        scenarios=int((ok & known).sum()),
        unknown=int((ok & ~known).sum()),
        unsettled=int((found["status"] == Status.UNSETTLED).sum()),
        missed=int(missed.sum()),
        far=int((missed & (error > 3.0)).sum()),
        sensitive=int((ok & known & (amplification * CHANGE > promised)).sum()),
        worst=float(error[ok & known].max(initial=0.0)),
        outputs=Counter(keys[i] for i in table.argmax(axis=0)[missed].tolist()),
    )


def judge(
    number: int, seed: int, laws: Sequence[str], files: Sequence[str], kinds: Sequence[str], status: bool
) -> dict[tuple[str, ...], Kept]:
    """Judge both promises on one drawn row; tallies by promise and class."""
    spec = draw(seed, number, laws, earthquakes(files), kinds)
    law = spec.laws[0]
    storeys = SHAPES[number % len(SHAPES)]
    shape = "with a wall" if 0 in storeys else "one storey" if set(storeys) == {1} else "several storeys"
    converged = reference(spec)
    rough = run_cases(replace(spec, outputs=(*PEAKS, "amplification"), method="rk4", dt=1e-4, precision="float64"))
    found: dict[tuple[str, ...], Kept] = {}

    def count(promise: str, tally: Kept) -> None:
        for of in (("all", ""), ("row", shape), ("kind", kind_of(number, kinds, laws)), ("law", law)):
            found[promise, *of] = found.get((promise, *of), Kept()) + tally

    for accuracy, (of, outputs) in product(ACCURACIES, ASKED.items()):
        asked = run_cases(replace(spec, outputs=outputs, accuracy=accuracy, method=None, dt=None, precision=None))
        count(f"accuracy {accuracy:g}{of}", judged(asked, converged, outputs, accuracy, rough["amplification"]))
    methods = [name for name in METHODS if SCHEMES[name].refuses(spec.scene, "float64") is None]
    for method in methods if status else ():
        for step in STEPS:
            run = replace(spec, outputs=(*PEAKS, "error_estimate"), method=method, dt=step, precision="float64")
            told = run_cases(run)
            plain = run_cases(replace(run, outputs=PEAKS))
            for text, values in (("by rules", plain), ("error_estimate", told)):
                tally = judged(values, converged, PEAKS, OK_CLAIM, rough["amplification"])
                count(f"ok, {text}, {method}", tally)
    return found


def main() -> None:
    """Judge, and print the rates."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.promises", description=__doc__)
    parser.add_argument("--scenarios", type=int, default=2000, help="scenarios to draw")
    parser.add_argument("--seed", type=int, default=1, help="another seed draws others")
    keys = [key for key, law in LAWS.items() if law.has_contact]
    parser.add_argument("--laws", nargs="+", choices=keys, default=keys, help="contact laws; all by default")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS), help="of rows; all by default")
    parser.add_argument("--records", nargs="*", default=[], help="files of further records")
    parser.add_argument("--status", action="store_true", help="judge the status of fixed steps too")
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)), help="processes")
    arguments = parser.parse_args()
    numbers = range(-(-arguments.scenarios // CASES))
    total: dict[tuple[str, ...], Kept] = {}
    with ProcessPoolExecutor(arguments.workers) as pool:
        waiting = [
            pool.submit(judge, i, arguments.seed, arguments.laws, arguments.records, arguments.kinds, arguments.status)
            for i in numbers
        ]
        for done, each in enumerate(waiting, 1):
            for key, tally in each.result().items():
                total[key] = total.get(key, Kept()) + tally
            print(f"\r{done} of {len(numbers)} rows", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    heads = ("promise", "class", "scenarios", "missed", "rate", "> 3 x", "worst / promised", "sensitive")
    print("{:28} {:22} {:>9} {:>6} {:>8} {:>5} {:>16} {:>9} {:>9} {:>7}".format(*heads, "unsettled", "unknown"))
    for (promise, *of), tally in sorted(total.items()):
        name, rate = " ".join(of), tally.missed / max(1, tally.scenarios)
        print(
            f"{promise:28} {name:22} {tally.scenarios:9d} {tally.missed:6d} {rate:8.2%} {tally.far:5d} "
            f"{tally.worst:16.3g} {tally.sensitive:9d} {tally.unsettled:9d} {tally.unknown:7d}"
            + (f"  {dict(tally.outputs)}" if of[0] == "all" and tally.missed else "")
        )


if __name__ == "__main__":
    main()
