"""From a sweep to the scenarios that must really run.

Every combination is reduced to what can matter to it: a law without restitution ignores that axis, no pounding ignores
gap, stiffness and restitution. What differs is run once and broadcast back into the cube. A scenario whose every gap is
at least the largest closing displacement of the run without pounding never touches: it is that run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from pounding_sweep.base.errors import SweepError
from pounding_sweep.base.text import bytes_text, counts_text, html_table, pairs_text, seconds_text
from pounding_sweep.engine.row_kernel import REST_PERIODS, SMALL_MOTION, Numerics, RowKernel, kernel_shape, longest_rest
from pounding_sweep.kernel.spec import KernelSpec
from pounding_sweep.model.laws import Law, get_law
from pounding_sweep.model.variants import Variants
from pounding_sweep.plan import scenarios
from pounding_sweep.plan.advice import COARSEST, Choice, Demand, advise
from pounding_sweep.plan.scenarios import Scenarios
from pounding_sweep.request.spec import (
    DEFAULT_ACCURACY,
    SweepSpec,
    digest,
    seconds_of_rest,
    with_accuracy,
    with_default_scheme,
)
from pounding_sweep.variables import registry
from pounding_sweep.variables.registry import reducers_for

#: Storeys of a building up to which it may be taken for a chain of storeys unasked.
_FEW_STOREYS = 3
#: Records up to which a plan tells the steps of each.
_FEW_RECORDS = 3
#: Steps that most scenarios take in all, over those that they begin with.
REFINED = 3
#: Largest acceleration of a record over one of its last period at which rests take no time that counts.
LATE = 20.0
#: Fixed step (s) of exact flight beyond which sub-steps of stages are divided by how much longer it is, at most by so
#: much: at 5 ms errors fall 20 times for a quarter more time.
STAGED_STEP, MOST_REFINEMENT = 2e-3, 4.0
#: Wanted duration of one chunk (s) by that estimate; never depends on the machine or the workers.
CHUNK_SECONDS = 0.25
#: Largest size (bytes) of the results of one chunk.
CHUNK_BYTES = 2**22
#: Memory of one scenario while it is planned, by measurement.
PLAN_BYTES = 780
#: Scenarios that must share a run without pounding for the extremes of its windows to be worth finding, and where
#: energies are asked for, which runs that are known by blocks have not.
LEAST_SHARING, LEAST_SHARING_ENERGIES = 32, 6
#: Scenarios that must share a run without pounding for it to be run: it costs about what one of them does.
LEAST_SHARED = 4
#: Scenarios up to which a sweep of exact flight, of elastic rows and of others, has no runs without pounding: their
#: kernel takes longer to compile than all scenarios that never touch to run.
FEW_SCENARIOS, FEW_YIELDING = 2000, 250
#: Scenarios of a sample, at least in number and in share, and multiples of them from which on one is taken.
LEAST_SAMPLE, SAMPLE_SHARE, LEAST_SAMPLED = 96, 0.03, 10
#: Margin by which a gap must exceed the closing displacement to be left out.
CLOSING_MARGIN = 1e-9


@dataclass(frozen=True, repr=False)
class Plan:
    """What a sweep will run.

    Attributes
    ----------
    spec, unique : SweepSpec and Scenarios
        The sweep, and its scenarios that differ in something that matters.
    laws, variants : tuple of Law and Variants
        By the index that `unique` uses: the last law is no pounding, row 0 of the buildings the scene as given.
    inverse : ndarray of int, shape (n_asked,)
        Row of `unique` that answers each asked scenario, in the order of the cube.
    refused, limit, steps : ndarray of bool, float and int
        Of each row of `unique`: whether its step is beyond the stability limit (of none with ``force_unstable``), the
        largest stable step (s), and the steps per record interval.
    numerics : Numerics
        Scheme and largest step of the sweep.
    uncoupled_steps : ndarray of int, shape (records, variants)
        Steps per record interval of the runs without pounding.
    uncoupled_runs, uncoupled_of : Scenarios and ndarray of int
        Distinct runs without pounding of all rows of `unique`, and which of them is that of each row.
    once : bool
        Whether one run of each scenario is enough, where a sample that runs twice agrees.
    choice, choice_numbers : str and dict
        What was chosen for the accuracy asked for, and the numbers that led to it; "" and None at a given step.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> plan = ps.Sweep("mate2015", "el_centro", "linear", gaps=[0.01, 0.02]).plan()
    >>> plan.n_asked, plan.numerics.method
    (2, 'exact')
    """

    spec: SweepSpec
    laws: tuple[Law, ...]
    unique: Scenarios
    variants: Variants
    inverse: np.ndarray
    refused: np.ndarray
    limit: np.ndarray
    numerics: Numerics
    steps: np.ndarray
    uncoupled_steps: np.ndarray
    uncoupled_runs: Scenarios
    uncoupled_of: np.ndarray
    once: bool = False
    choice: str = ""
    choice_numbers: Mapping[str, Any] | None = None

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the sweep's description."""
        return digest(self.spec)

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """Variables that are asked for; where steps were chosen, the step and the estimated error; falls."""
        chosen = [] if self.spec.accuracy is None else ["time_step", "error_estimate"]
        chosen += ["collapse_time", "collapsed_storey"] if any(self.spec.scene.falls) else []
        return registry.check_outputs((*self.spec.outputs, *chosen))

    @property
    def n_asked(self) -> int:
        """Scenarios asked for."""
        return len(self.inverse)

    @property
    def n_unique(self) -> int:
        """Scenarios that may have to run."""
        return int(len(self.unique) - self.refused.sum())

    @cached_property
    def no_contact(self) -> np.ndarray:
        """Rows of `unique` without pounding."""
        return self.unique.law == len(self.laws) - 1

    def kernel(
        self, law: int, closing: bool = False, *, record: int | None = None, steps: int | None = None
    ) -> RowKernel:
        """Return the kernel of a law; `closing` adds the largest closing displacements.

        With so many `steps` per interval of a `record`; else with the largest step of the sweep.
        """
        numerics, acting = self.numerics, self.laws[law]
        if record is not None and steps is not None:
            numerics = replace(numerics, dt=self.spec.records[record].dt / steps)
        # the law of this sweep whose kernel an undamped law, or none, can run in
        damped = (item for item in self.laws if item.damper and item.elastic == acting.elastic)
        plain = (item for item in damped if not (item.approach_only or item.rebound_only or item.tension))
        host = next(plain, None) if acting.has_contact and not acting.damper else None
        if self.shares_kernel and acting is self.laws[-1] and not closing:
            host = self.kernel(0).host or self.laws[0]
        return RowKernel(
            self.spec.scene,
            acting,
            numerics,
            reducers_for(self.spec.outputs) | ({"closing"} if closing else frozenset()),
            host=host,
            basis=self.spec.restitution_basis,
            varied=len(self.variants) > 1,
            windows=self._shares_flight,
            by_pair=self.unique.stiffness.ndim > 1,
            accuracy=self.spec.accuracy,
        )

    def task(
        self,
        table: Scenarios,
        law: int,
        record: int,
        steps: int,
        *,
        closing: bool = False,
        outputs: Sequence[str] | None = None,
    ) -> scenarios.ChunkTask:
        """Return the task that runs scenarios of a law and a record, see `kernel`."""
        kernel = self.kernel(law, closing, record=record, steps=steps)
        variants, outputs = self.variants[table.variant], self.outputs if outputs is None else outputs
        return scenarios.ChunkTask(kernel, self.spec.records[record], table, variants, outputs, self.once)

    @cached_property
    def shares_kernel(self) -> bool:
        """Whether scenarios without pounding run in the kernel of a law, at gaps that nothing reaches."""
        scene, exact = self.spec.scene, self.numerics.scheme.flies_exactly and not self.once
        few = len(self.unique) <= (FEW_YIELDING if any(scene.yields) else FEW_SCENARIOS)
        return exact and few and bool(scene.contacts) and len(self.laws) > 1

    @cached_property
    def _shares_flight(self) -> bool:
        """Whether scenarios of a law and a record that share a run without pounding are enough for its windows."""
        runs = len(self.variants.flights()[0]) * len(self.laws) * len(self.spec.records)
        energies = "energy" in reducers_for(self.spec.outputs)
        least = LEAST_SHARING_ENERGIES if energies else LEAST_SHARING
        return len(self.variants) == 1 or len(self.unique) >= least * runs

    def shapes(self) -> list[KernelSpec]:
        """Return the kernels that every run needs, none twice; refinement may compile others in double precision."""
        last, laws = len(self.laws) - 1, self.unique.law[~self.refused]
        kernels = [self.kernel(law) for law in np.unique(laws[(laws != last) | self.shares_kernel]).tolist()]
        if len(laws) and len(self.uncoupled_to_run):
            kernels.append(self.kernel(last, closing=True))
        return list(dict.fromkeys(kernel.shape for kernel in kernels))

    @cached_property
    def uncoupled_to_run(self) -> np.ndarray:
        """Rows of `uncoupled_runs` that are asked for, or tell of `LEAST_SHARED` or more scenarios if they touch."""
        if self.shares_kernel:
            return np.zeros(0, int)
        weights = np.where(self.refused, 0, np.where(self.no_contact, LEAST_SHARED, 1))
        return np.flatnonzero(np.bincount(self.uncoupled_of, weights, len(self.uncoupled_runs)) >= LEAST_SHARED)

    def chunks(self, rows: np.ndarray, uncoupled: bool = False) -> list[scenarios.Chunk]:
        """Cut rows of `unique`, or of `uncoupled_runs`, into chunks; depends on nothing but the sweep and the rows."""
        name = f"{self.digest}:{self.numerics.method}{':once' * self.once}"
        table, steps = self.unique, self.steps
        if uncoupled:
            name, table = f"{name}:without pounding", self.uncoupled_runs
            steps = self.uncoupled_steps[table.record, table.variant]
        flights = np.broadcast_to(np.int16(0), len(table))
        if self.numerics.scheme.flies_exactly and len(self.variants) > 1:
            flights = np.zeros(len(table), np.int32)
            for index, count, rows_of in table.by_step(steps):
                kernel = self.kernel(len(self.laws) - 1, record=index, steps=count)
                variants = self.variants[table.variant[rows_of]]
                flights[rows_of] = kernel.flight_substeps(self.spec.records[index], variants)
        most, seconds = CHUNK_BYTES // self.bytes_per_scenario, self.scenario_seconds
        settings: dict[str, Any] = {"name": name, "longest": CHUNK_SECONDS, "most": most, "seconds": seconds}
        return scenarios.cut(table, rows, steps, flights, elastic=not any(self.spec.scene.yields), **settings)

    def scenario_seconds(self, record: int, steps: int) -> float:
        """Estimated seconds of one scenario on one core, with `steps` per record interval."""
        total = (self.spec.records[record].n_points - 1 + self._rest_points(record)) * steps
        total *= 1 if self.spec.accuracy is None or self.once else REFINED
        return total * self.spec.scene.n_dof * self.numerics.scheme.step_cost * 1e-9

    def seconds_of(self, rows: np.ndarray) -> np.ndarray:
        """Estimated seconds of each of these rows of `unique` on one core."""
        of_one = np.array([self.scenario_seconds(record, 1) for record in range(len(self.spec.records))])
        return of_one[self.unique.record[rows]] * self.steps[rows]

    def _rest_points(self, record: int) -> float:
        """Estimated record intervals of the rest: until a motion as strong as the end of the record is a twentieth."""
        motion, rest = self.spec.records[record], self.numerics.rest
        if rest == math.inf:
            (longest,), (small,) = longest_rest(self.spec.scene)
            late = np.abs(motion.acceleration[-1 - int(longest / REST_PERIODS / motion.dt) :]).max()
            strong = max(1.0, LATE * late / motion.pga) if motion.pga else 1.0
            rest = small * math.log(strong) / math.log(1.0 / SMALL_MOTION)
        return rest / motion.dt

    def sample(self, rows: np.ndarray) -> np.ndarray:
        """Return rows to be run twice before one run of each may be enough; none where they are most of the cost."""
        count = max(LEAST_SAMPLE, round(SAMPLE_SHARE * len(rows)))
        if not self.once or len(rows) < LEAST_SAMPLED * count:
            return rows[:0]
        return np.sort(np.random.default_rng(int(self.digest[:16], 16)).permutation(rows)[:count])

    @cached_property
    def bytes_per_scenario(self) -> int:
        """Bytes of one scenario's values."""
        return sum(
            np.dtype(registry.get_variable(name).dtype).itemsize
            * math.prod(registry.inner_shape(name, self.spec.scene))
            for name in registry.cube_variables(self.outputs)
        )

    def summary(self, workers: int = 1) -> dict[str, Any]:
        """Return counts and estimates: ``at_most`` scenarios are run, ``steps`` and ``steps_least`` are by record.

        ``seconds`` are those of all `workers`, without compilation; ``accuracy_choice`` and ``accuracy_numbers`` are ""
        and None where the sweep gives scheme and step.
        """
        rows = np.flatnonzero(~self.refused)
        seconds, most, least = float(self.seconds_of(rows).sum()), {}, {}
        for index, record in enumerate(self.spec.records):
            steps = self.steps[~self.refused & (self.unique.record == index)]
            steps = (record.n_points - 1) * (steps if len(steps) else self.uncoupled_steps[index])
            most[record.name], least[record.name] = int(steps.max()), int(steps.min())
        return {
            "asked": self.n_asked,
            "at_most": self.n_unique,
            "refused": int(self.refused.sum()),
            "kernels": len(self.shapes()),
            "steps": most,
            "steps_least": least,
            "seconds": seconds / max(1, workers),
            "cube_bytes": self.n_asked * self.bytes_per_scenario,
            "chunks": len(self.chunks(rows)),
            "accuracy_choice": self.choice,
            "accuracy_numbers": self.choice_numbers,
        }

    def rows(self, summary: Mapping[str, Any] | None = None) -> list[tuple[str, str]]:
        """Say what would be run, at what cost, as names with texts.

        `summary` is that of the plan, with ``workers``; with ``kernels_to_compile`` and ``compile_seconds`` (CPU time)
        the time is that with compilation.
        """
        plan = summary or {**self.summary(), "workers": 1}
        axes = counts_text({name: len(values) for name, values in self.spec.axes.items()})
        ranges = {name: dict.fromkeys((plan["steps_least"][name], most)) for name, most in plan["steps"].items()}
        steps = ", ".join(f"{' to '.join(map(str, counts))} ({name})" for name, counts in ranges.items())
        if len(ranges) > _FEW_RECORDS:
            least, most = min(plan["steps_least"].values()), max(plan["steps"].values())
            steps = f"{' to '.join(map(str, dict.fromkeys((least, most))))} ({len(ranges)} records)"
        missing = plan.get("kernels_to_compile")
        run = "under a second" if plan["seconds"] < 1.0 else f"about {seconds_text(plan['seconds'])}"
        kernels = "" if missing is None else f", {missing} to compile" if missing else ", all compiled"
        workers = f"{plan['workers']} worker{'s' * (plan['workers'] != 1)}"
        if missing:
            run = f"about {seconds_text(plan['compile_seconds'] / plan['workers'])} to compile, then {run} to run"
        rows = [
            ("axes", axes or (str(self.spec.design) if self.spec.design else f"{plan['asked']} listed cases")),
            ("scenarios", f"{plan['asked']} asked, at most {plan['at_most']} to run"),
        ]
        if len(self.uncoupled_to_run):
            rows.append(("", "(scenarios that never touch are skipped after the no-contact run)"))
        if self.refused.any():
            stable = f"every scenario is stable at dt <= {self.limit[self.refused].min():.3g} s"
            remedy = f"{registry.Status.BEYOND_STABILITY_LIMIT.remedy}; {stable}"
            rows.append(("refused", f"{plan['refused']}: beyond the stability limit; {remedy}"))
        rows += [("kernels", f"{plan['kernels']}{kernels}"), ("steps", f"{steps} per scenario")]
        rows += [("accuracy", self.choice)] if self.choice else []
        tall = [b for b in self.spec.scene.buildings if b.stiffness_matrix is None and b.n_storeys > _FEW_STOREYS]
        if tall:
            periods = ", ".join(f"{b.name} {b.periods[0]:.3g} and {b.periods[1]:.3g} s" for b in tall)
            rows.append(("model", f"a chain of storeys; compare its first two periods with the building's: {periods}"))
        rows.append(("time", f"{run}, with {workers}{', without compilation' if missing is None else ''}"))
        return [*rows, ("cube", f"{bytes_text(plan['cube_bytes'])} of values")]

    def __repr__(self) -> str:
        return f"Plan({self.n_asked} scenarios asked, at most {self.n_unique} to run)"

    def __str__(self) -> str:
        return pairs_text([("sweep", self.spec.title), *self.rows()] if self.spec.title else self.rows())

    def _repr_html_(self) -> str:
        return html_table(self.rows(), caption=self.spec.title)


def make_plan(spec: SweepSpec, *, initial_speed: float = 0.0) -> Plan:
    """Reduce a sweep to its unique scenarios."""
    laws = (*(spec.law(key) for key in spec.laws if key != "none"), get_law("none"))
    unique, variants, inverse = scenarios.unique_scenarios(spec, laws)
    table, repeats = scenarios.but_for_gaps(unique)  # no step depends on gaps
    spec, choice = _choose(spec, laws, table, repeats, variants, initial_speed)
    limit = scenarios.stable_steps(spec, laws, table, variants, choice.numerics.method)
    interval = np.array([record.dt for record in spec.records])
    refused = np.zeros(len(table), bool) if spec.force_unstable else interval[table.record] / choice.steps > limit

    def repeated(column: np.ndarray) -> np.ndarray:
        """Return a column for all scenarios; where all rows agree, in the memory of one."""
        constant = len(column) > 0 and (column == column[0]).all()
        return np.broadcast_to(column[0], len(unique)) if constant else np.repeat(column, repeats)

    uncoupled_runs, uncoupled_of = scenarios.uncoupled_runs_of(unique, len(laws) - 1)
    return Plan(
        spec=spec,
        laws=laws,
        unique=unique,
        variants=variants,
        inverse=inverse,
        refused=repeated(refused),
        limit=repeated(limit),
        numerics=choice.numerics,
        steps=repeated(choice.steps),
        uncoupled_steps=choice.uncoupled_steps,
        uncoupled_runs=uncoupled_runs,
        uncoupled_of=uncoupled_of,
        once=choice.once and bool((unique.gaps > max(law.thickness for law in laws)).all()),
        choice=choice.text,
        choice_numbers=choice.numbers,
    )


def _choose(
    spec: SweepSpec,
    laws: tuple[Law, ...],
    table: Scenarios,
    repeats: np.ndarray,
    variants: Variants,
    initial_speed: float,
) -> tuple[SweepSpec, Choice]:
    """Return the sweep with what it leaves open, and the scheme and steps of the rows of a table."""
    is_open, reason = spec.method is None and spec.accuracy is None, "" if spec.dt else ", since locate = false"
    if is_open and not spec.dt and spec.locate:  # nothing is named: the default is an accuracy
        spec = with_accuracy(spec, DEFAULT_ACCURACY)
    if spec.accuracy is not None:
        try:
            return spec, advise(
                Demand(spec, min(spec.accuracy, COARSEST), laws, table, repeats, variants, initial_speed)
            )
        except SweepError as error:
            if not is_open:
                raise
            spec, reason = replace(spec, accuracy=None), f", since {error}"
    spec = with_default_scheme(spec) if is_open else spec
    names = "method", "dt", "locate", "beta", "gamma", "precision"
    settings: Any = {name: getattr(spec, name) for name in names} | {"rest": seconds_of_rest(spec.rest)}
    numerics = Numerics(**settings)
    # stages beside contacts take sub-steps by the contacts' durations rather than by a long step
    coarser = min(min(numerics.dt, max(record.dt for record in spec.records)) / STAGED_STEP, MOST_REFINEMENT)
    if coarser > 1.0 and any(kernel_shape(spec.scene, law, numerics, ()).staged for law in laws):
        numerics = replace(numerics, refinement=coarser)
    of_record = np.array([numerics.steps(record) for record in spec.records], np.int32)
    uncoupled = np.broadcast_to(of_record[:, None], (len(of_record), len(variants)))
    text = f"none: {spec.method} at steps of {numerics.dt:g} s{reason}" if is_open else ""
    return spec, Choice(numerics, of_record[table.record], uncoupled, text)


def untouched(plan: Plan, closing: np.ndarray) -> np.ndarray:
    """Rows of the unique table in which no pair can ever touch, by the ``closing_max`` of `uncoupled_runs`."""
    scene, table = plan.spec.scene, plan.unique
    laws, result = np.array([law.thickness for law in plan.laws])[table.law], np.ones(len(table), bool)
    clearances = scene.clearances(table.gaps, laws)
    for j, contact in enumerate(scene.contacts):
        most = np.maximum(closing[:, contact.place, contact.storey - 1], 0.0)  # infinite or NaN where it is not known
        result &= clearances[:, j] >= (most * (1.0 + CLOSING_MARGIN))[plan.uncoupled_of]
    return result | plan.no_contact
