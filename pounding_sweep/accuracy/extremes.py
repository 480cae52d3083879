"""The stability suite: extreme scenarios in every scheme, every one judged and counted."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pounding_sweep.accuracy.extreme_scenes import Batch, families, family_batches, random_batches
from pounding_sweep.accuracy.judge import Run, Verdict, judge, make_reference
from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.base.text import seconds_text
from pounding_sweep.engine.compile import prepare, still_to_compile
from pounding_sweep.model.laws import LAWS, Law, get_law
from pounding_sweep.outputs.variables import OK_CLAIM, STATUS, Status
from pounding_sweep.plan.advice import measured_schemes
from pounding_sweep.run.execute import Progress

#: Name of the family of random scenes, and how many there are where no number is given.
RANDOM, DEFAULT_SCENES = "random", 320


@dataclass
class FamilyResult:
    """What the judge found of a family in one scheme."""

    family: str
    method: str
    scenarios: int = 0  # each step counted
    statuses: Counter[str] = field(default_factory=Counter)  # scenarios by label of their status
    #: ok scenarios that are off by more than the claim, those of them that are sensitive, and ok ones without reference
    missed: int = 0
    sensitive: int = 0
    unknown: int = 0
    worst_error: float = 0.0  # of ok scenarios that half the step does not give away and that are not sensitive
    worst_created_energy: float = 0.0  # by contacts of an ok scenario, relative to the largest energy of its balance
    worst_energy: float = 0.0  # of any scenario, relative to what the ground can have brought in
    #: scenarios that failed a demand, each with what is needed to run it again
    violations: list[dict[str, Any]] = field(default_factory=list)
    seconds: float = 0.0  # CPU time of the runs, without references and compilation

    def add(self, verdict: Verdict) -> None:
        """Count one run of a batch."""
        status = verdict.run.status
        self.scenarios += len(status)
        self.statuses.update(STATUS[s].label for s in status)
        for name in ("missed", "sensitive", "unknown"):
            setattr(self, name, getattr(self, name) + int(getattr(verdict, name).sum()))
        errors = verdict.error[~verdict.told & ~verdict.sensitive & np.isfinite(verdict.error)]
        created = verdict.created[status == Status.OK]
        worst = {"worst_error": errors, "worst_created_energy": created, "worst_energy": verdict.energy}
        for name, values in worst.items():
            setattr(self, name, float(values.max(initial=getattr(self, name))))
        self.violations += [_violation(verdict.run, row, text) for row, text in verdict.faults]
        self.seconds += verdict.run.seconds

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return vars(self) | {"statuses": {s.label: self.statuses[s.label] for s in STATUS if self.statuses[s.label]}}


def _violation(run: Run, row: int, text: str) -> dict[str, Any]:
    batch = run.batch
    values = {name: getattr(batch.table, name)[row].tolist() for name in ("gaps", "stiffness", "restitution", "scale")}
    status = STATUS[int(run.status[row])].label
    where = {"fault": text, "family": batch.family, "case": batch.case, "law": batch.law.key, "method": run.method}
    return {**where, "precision": run.precision, "dt": run.dt, "status": status, **values}


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
        return [violation for result in self.results for violation in result.violations]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        results = [result.as_dict() for result in self.results]
        return {"claim": OK_CLAIM, **vars(self), "results": results, "violations": len(self.faults)}


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
    tell: Callable[[str], None] | None = None,
) -> Extremes:
    """Run the stability suite, in the schemes that ``accuracy`` chooses from unless others are given.

    `tell` hears beforehand how long it will take.
    """
    schemes = measured_schemes() if methods is None else tuple(methods)
    chosen = [law for law in (get_law(key) for key in (LAWS if laws is None else laws)) if law.has_contact]
    if not chosen:
        raise InputError(
            f"no law with contact is given; give some of {', '.join(k for k, v in LAWS.items() if v.has_contact)}"
        )
    if scenes < 0 or seed < 0:
        raise InputError(f"scenes = {scenes} and seed = {seed} must not be negative")
    progress, start = progress or Progress(), time.perf_counter()
    batches = _batches(families, chosen, scenes, seed)
    runs = [(batch, method) for batch in batches for method in batch.schemes(schemes)]
    formats = dict.fromkeys(("float64", precision))
    shapes = list(dict.fromkeys(b.kernel(method, b.steps[0], f).shape for b, method in runs for f in formats))
    missing, seconds = still_to_compile(shapes)
    if tell and missing:
        tell(f"{missing} of {len(shapes)} kernels to compile, once: about {seconds_text(seconds / workers)}")
    progress.stage("compiling" if missing else "kernels", len(shapes))
    prepare(shapes, workers, progress.advance)
    ready = time.perf_counter()
    results: dict[tuple[str, str], FamilyResult] = {}
    progress.stage("batches", len(batches))
    for batch in batches:
        for verdict in run_judged(batch, precision, schemes):
            key = (batch.family, verdict.run.method)
            results.setdefault(key, FamilyResult(*key)).add(verdict)
        progress.advance(1)
    end = time.perf_counter()
    return Extremes(list(results.values()), tuple(law.key for law in chosen), scenes, seed, end - ready, ready - start)


def _batches(keys: Iterable[str] | None, laws: Sequence[Law], scenes: int, seed: int) -> list[Batch]:
    valid = [*families(), RANDOM]
    keys = valid if keys is None else list(dict.fromkeys(keys))
    for key in keys:
        if key not in valid:
            raise InputError(unknown("family", key, valid))
    batches = family_batches([key for key in keys if key != RANDOM], laws)
    return batches + (random_batches(scenes, seed, laws) if RANDOM in keys else [])


def run_judged(batch: Batch, precision: str = "float64", methods: Sequence[str] | None = None) -> list[Verdict]:
    """Run a batch in each scheme at every step, and judge all runs against one reference."""
    runs, wanted, shortest = [], np.zeros(len(batch), bool), np.full(len(batch), np.inf)
    for method in batch.schemes(measured_schemes() if methods is None else methods):
        for dt in batch.steps:
            start = time.process_time()  # machines may be busy with other work
            values = batch.run(method, dt, precision)
            runs.append(Run(batch, method, dt, values, precision, time.process_time() - start))
            ok = values["status"] == Status.OK
            wanted |= ok
            shortest = np.fmin(shortest, np.where(ok, values["steps_per_contact"] * batch.step(method, dt), np.nan))
    reference = make_reference(batch, wanted, shortest)
    return [judge(run, reference) for run in runs]
