"""The stability suite: extreme scenarios through both schemes, every one judged.

`run_extremes` runs the families of `pounding_sweep.accuracy.extreme_scenes` and random scenes, judges each scenario by
what `pounding_sweep.accuracy.judge` demands, and counts.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pounding_sweep.accuracy.extreme_scenes import (
    FAMILIES,
    Batch,
    family_batches,
    kernel_of,
    random_batches,
    run_batch,
    schemes_of,
)
from pounding_sweep.accuracy.judge import BatchVerdict, judge, make_reference
from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.engine.compile import prepare
from pounding_sweep.model.laws import LAWS, Law, get_law
from pounding_sweep.outputs.variables import STATUS, Status
from pounding_sweep.plan.advice import measured_schemes
from pounding_sweep.run.execute import Progress

#: Name of the family of random scenes.
RANDOM = "random"
#: Random scenes where their number is not given.
DEFAULT_SCENES = 320


@dataclass
class FamilyResult:
    """What the judge found of a family in one scheme."""

    #: family and scheme
    family: str
    method: str
    scenarios: int = 0  # scenarios, each step counted
    statuses: Counter[str] = field(default_factory=Counter)  # scenarios by label of their status
    #: ok scenarios that are off by more than the claim, and those of them that are sensitive
    missed: int = 0
    sensitive: int = 0
    unknown: int = 0  # ok scenarios without a converged reference
    #: worst relative error of a peak among ok scenarios that half the step does not give away and that are not
    #: sensitive
    worst_error: float = 0.0
    #: most energy created by contacts of an ok scenario, relative to the largest energy of its balance
    worst_created_energy: float = 0.0
    worst_energy: float = 0.0  # largest energy of any scenario, relative to what the ground can have brought in
    #: scenarios that failed a demand, each with what is needed to run it again
    violations: list[dict[str, Any]] = field(default_factory=list)
    seconds: float = 0.0  # wall time of the runs, references and compilation not counted

    def add(self, verdict: BatchVerdict) -> None:
        """Count one run of a batch."""
        ok = verdict.status == Status.OK
        self.scenarios += len(verdict.status)
        self.statuses.update(STATUS[s].label for s in verdict.status)
        self.missed += int(verdict.missed.sum())
        self.sensitive += int(verdict.sensitive.sum())
        self.unknown += int(verdict.unknown.sum())
        errors = verdict.error[~verdict.told & ~verdict.sensitive & np.isfinite(verdict.error)]
        for name, found in (
            ("worst_error", errors),
            ("worst_created_energy", verdict.created[ok]),
            ("worst_energy", verdict.energy),
        ):
            setattr(self, name, max(getattr(self, name), float(found.max(initial=0.0))))
        self.violations += [_fault(verdict, row, text) for row, text in verdict.faults]
        self.seconds += verdict.seconds

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return vars(self) | {"statuses": {s.label: self.statuses[s.label] for s in STATUS if self.statuses[s.label]}}


def _fault(verdict: BatchVerdict, row: int, text: str) -> dict[str, Any]:
    batch = verdict.batch
    return {
        "fault": text,
        "family": batch.family,
        "case": batch.case,
        "law": batch.law.key,
        "method": verdict.method,
        "precision": verdict.precision,
        "dt": verdict.dt,
        "status": STATUS[int(verdict.status[row])].label,
        "gaps": batch.gaps[row].tolist(),
        "stiffness": float(batch.stiffness[row]),
        "restitution": float(batch.restitution[row]),
        "scale": float(batch.scale[row]),
    }


@dataclass(frozen=True)
class Extremes:
    """What a run of the suite found."""

    results: list[FamilyResult]  # family by family, scheme by scheme
    laws: tuple[str, ...]
    scenes: int  # random ones
    seed: int  # of these
    seconds: float  # wall time, references included, compilation of kernels not
    compile_seconds: float  # time until all kernels were ready

    @property
    def faults(self) -> list[dict[str, Any]]:
        """Every violation."""
        return [fault for result in self.results for fault in result.violations]


def run_extremes(
    scenes: int = DEFAULT_SCENES,
    *,
    seed: int = 1,
    laws: Iterable[str | Law] | None = None,
    families: Iterable[str] | None = None,
    methods: Iterable[str] | None = None,
    precision: str = "float64",
    workers: int = 1,
    progress: Progress | None = None,
) -> Extremes:
    """Run the stability suite, in the schemes that ``accuracy`` chooses from unless others are given."""
    schemes = measured_schemes() if methods is None else tuple(methods)
    chosen = [law for law in (get_law(key) for key in (LAWS if laws is None else laws)) if law.has_contact]
    if not chosen:
        msg = f"no law with contact is given; give some of {', '.join(k for k, v in LAWS.items() if v.has_contact)}"
        raise InputError(msg)
    keys = list(dict.fromkeys([*FAMILIES, RANDOM] if families is None else families))
    for key in keys:
        if key not in FAMILIES and key != RANDOM:
            raise InputError(unknown("family", key, [*FAMILIES, RANDOM]))
    if scenes < 0 or seed < 0:
        msg = f"scenes = {scenes} and seed = {seed} must not be negative"
        raise InputError(msg)
    shown = progress or Progress()
    start = time.perf_counter()
    batches = _prepare(keys, chosen, scenes, seed, schemes, precision, workers, shown)
    ready = time.perf_counter()
    results: dict[tuple[str, str], FamilyResult] = {}
    shown.stage("batches", len(batches))
    for batch in batches:
        for verdict in run_judged(batch, precision, schemes):
            key2 = (batch.family, verdict.method)
            results.setdefault(key2, FamilyResult(*key2)).add(verdict)
        shown.advance(1)
    end = time.perf_counter()
    return Extremes(list(results.values()), tuple(law.key for law in chosen), scenes, seed, end - ready, ready - start)


def _prepare(
    keys: Sequence[str],
    laws: Sequence[Law],
    scenes: int,
    seed: int,
    methods: Sequence[str],
    precision: str,
    workers: int,
    progress: Progress,
) -> list[Batch]:
    """Make the batches, and the kernels of all of them."""
    batches = family_batches([key for key in keys if key in FAMILIES], laws)
    batches += random_batches(scenes, seed, laws) if RANDOM in keys else []
    formats = dict.fromkeys(("float64", precision))
    each = [(batch, method) for batch in batches for method in schemes_of(batch, methods)]
    shapes = [kernel_of(batch, method, batch.steps[0], f).shape for batch, method in each for f in formats]
    wanted = list(dict.fromkeys(shapes))
    progress.stage("kernels", len(wanted))
    prepare(wanted, workers, progress.advance)
    return batches


def run_judged(batch: Batch, precision: str = "float64", methods: Sequence[str] | None = None) -> list[BatchVerdict]:
    """Run a batch in each scheme at every step, and judge all runs against one reference."""
    runs = []
    wanted = np.zeros(len(batch), bool)
    shortest = np.full(len(batch), np.inf)
    for method in schemes_of(batch, measured_schemes() if methods is None else methods):
        for dt in batch.steps:
            start = time.perf_counter()
            found = run_batch(batch, method, dt, precision)
            runs.append((method, dt, found, time.perf_counter() - start))
            ok = found["status"] == Status.OK
            wanted |= ok
            step = batch.record.dt / kernel_of(batch, method, dt).numerics.steps(batch.record)
            lasted = np.where(ok, found["steps_per_contact"] * step, np.nan)
            shortest = np.fmin(shortest, lasted)
    reference = make_reference(batch, wanted, shortest)
    return [
        judge(batch, method, dt, found, reference, seconds=seconds, precision=precision)
        for method, dt, found, seconds in runs
    ]
