"""From a sweep to the scenarios that must really run.

Every combination that was asked for is reduced to what can matter to it: a
law without restitution ignores that axis, no pounding ignores gap, stiffness
and restitution, a row in which no floors meet ignores the law. What remains
once is run once and broadcast back into the cube. A scenario whose every gap
is at least the largest closing displacement of the run without pounding never
touches: it is that run.

Where the sweep asks for an accuracy, scheme and steps are chosen here too, for
each scenario by what it must resolve.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from pounding_sweep.contact.laws import Law, get_law
from pounding_sweep.cube.variables import check_outputs, cube_variables, get_variable, reducers_for
from pounding_sweep.sweep.blocks import Numerics, RowKernel
from pounding_sweep.sweep.scenarios import Scenarios, unique_scenarios
from pounding_sweep.sweep.spec import SweepSpec, digest
from pounding_sweep.sweep.stability import largest_step

#: Cost of one scenario and step (ns per degree of freedom), for estimates and chunk sizes only.
NS_PER_DOF_AND_STEP = {"rk4": 2.6, "newmark": 4.5, "exact": 0.8}
#: Wanted duration of one chunk (s) by that estimate; never depends on the machine or the workers.
CHUNK_SECONDS = 0.25
#: Memory of one scenario while it is planned, by measurement.
PLAN_BYTES = 400
#: Margin by which a gap must exceed the closing displacement to be left out.
CLOSING_MARGIN = 1e-9


@dataclass(frozen=True)
class Chunk:
    """Scenarios of one kernel and one record that one task runs.

    Attributes
    ----------
    key : str
        Digest of the sweep and of the scenarios: the same chunk of the same sweep has the same key.
    law, record : int
        Index into the plan's laws and records.
    rows : ndarray of int
        Rows of the plan's table of unique scenarios, neighbouring gaps side by side.
    steps : int
        Steps per record interval.
    """

    key: str
    law: int
    record: int
    rows: np.ndarray
    steps: int


@dataclass(frozen=True)
class Plan:
    """What a sweep will run.

    Attributes
    ----------
    spec : SweepSpec
        The sweep.
    unique : Scenarios
        Scenarios that differ in something that matters.
    inverse : ndarray of int, shape (n_asked,)
        Row of `unique` that answers each asked scenario, in the order of the cube.
    refused : ndarray of bool
        Rows whose step is beyond the stability limit (none with ``force_unstable``).
    limit : ndarray of float
        Largest stable step (s) of each row.
    numerics : Numerics
        Scheme and largest step of the sweep.
    steps : ndarray of int
        Steps per record interval of each row.
    still : tuple of int
        Steps per record interval of the runs without pounding, by record.
    choice : str
        What was chosen for the accuracy asked for, and why; "" where the sweep gives scheme and step.
    """

    spec: SweepSpec
    unique: Scenarios
    inverse: np.ndarray
    refused: np.ndarray
    limit: np.ndarray
    numerics: Numerics
    steps: np.ndarray
    still: tuple[int, ...]
    choice: str = ""

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """Laws by the index that `unique` uses; the last is no pounding."""
        return _laws(self.spec)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the sweep's description."""
        return digest(self.spec)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Variables that are asked for, the step among them where it was chosen."""
        return self.spec.outputs if self.spec.accuracy is None else check_outputs((*self.spec.outputs, "time_step"))

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
        numerics = self.numerics
        if record is not None and steps is not None:
            numerics = replace(numerics, dt=self.spec.records[record].dt / steps)
        reducers = reducers_for(self.spec.outputs) | ({"closing"} if closing else frozenset())
        return RowKernel(
            self.spec.scene,
            self.laws[law],
            numerics,
            reducers,
            host=self._host(law),
            basis=self.spec.restitution_basis,
        )

    def kernels(self) -> dict[tuple[int, bool], RowKernel]:
        """Return the kernels that a run needs by (law, closing); the last law's decides who can touch."""
        runnable = ~self.refused
        if not runnable.any():
            return {}
        last = len(self.laws) - 1
        contact = [int(law) for law in np.unique(self.unique.law[runnable]) if law != last]
        return {**{(law, False): self.kernel(law) for law in contact}, (last, True): self.kernel(last, closing=True)}

    def _host(self, law: int) -> Law | None:
        """Return the law of this sweep whose kernel an undamped law can run in.

        An undamped law is the damped law of the same elastic force with c = 0, to
        the last bit: F = E + 0 v. One kernel less is compiled.
        """
        own = self.laws[law]
        if not own.has_contact or own.damper:
            return None
        both = [item for item in self.laws if item.damper and item.elastic == own.elastic]
        simple = [item for item in both if not (item.approach_only or item.tension or item.impulsive)]
        return simple[0] if simple else None

    @cached_property
    def motions(self) -> list[tuple[int, float]]:
        """Record and scale of each run without pounding that decides which scenarios can touch.

        Only where a scenario could be left out, or asks for no pounding itself.
        """
        found = np.unique(np.stack([self.unique.record.astype(float), self.unique.scale]), axis=1)
        return [(int(r), float(s)) for r, s in found.T]

    def chunks(self, rows: np.ndarray) -> list[Chunk]:
        """Cut `rows` of the unique table into chunks; depends on nothing but the sweep and the rows."""
        table = self.unique
        result: list[Chunk] = []
        order = rows[
            np.lexsort(
                (
                    *(table.gaps[rows, p] for p in reversed(range(table.gaps.shape[1]))),
                    table.restitution[rows],
                    table.stiffness[rows],
                    table.scale[rows],
                    self.steps[rows],
                    table.law[rows],
                    table.record[rows],
                )
            )
        ]
        kinds = np.stack([table.record[order], table.law[order], self.steps[order]], axis=1)
        edges = np.flatnonzero(np.any(np.diff(kinds, axis=0) != 0, axis=1)) + 1
        for part in np.split(order, edges):
            if not len(part):
                continue
            record, law, steps = (int(values[part[0]]) for values in (table.record, table.law, self.steps))
            seconds = self.scenario_seconds(record, steps)
            size = max(16, 16 * int(CHUNK_SECONDS / max(seconds, 1e-12) // 16))
            for first in range(0, len(part), size):
                mine = part[first : first + size]
                text = f"{self.digest}:{record}:{law}:{self.numerics.method}:{steps}:".encode()
                text += np.ascontiguousarray(mine, dtype="<i8").tobytes()
                result.append(Chunk(hashlib.sha256(text).hexdigest()[:32], law, record, mine, steps))
        return result

    def scenario_seconds(self, record: int, steps: Any) -> Any:
        """Estimated seconds of one scenario on one core, with `steps` (one number or an array) per record interval."""
        total = (self.spec.records[record].n_points - 1) * steps
        return total * self.spec.scene.n_dof * NS_PER_DOF_AND_STEP[self.numerics.method] * 1e-9

    @property
    def bytes_per_scenario(self) -> int:
        """Bytes of one scenario's values."""
        from pounding_sweep.cube.assemble import inner_shape

        return sum(
            np.dtype(get_variable(name).dtype).itemsize * math.prod(inner_shape(name, self.spec.scene))
            for name in cube_variables(self.outputs)
        )

    def summary(self, workers: int = 1) -> dict[str, Any]:
        """Return counts and estimates, before anything is run.

        Returns
        -------
        dict
            ``asked``, ``at_most`` (scenarios to run before those that never touch
            are left out), ``refused``, ``kernels``, ``steps`` and ``steps_least`` (most and
            least per scenario of each record), ``seconds`` (estimate, all workers),
            ``cube_bytes``, ``chunks``, ``accuracy_choice`` ("" where the sweep gives scheme and step).
        """
        rows = np.flatnonzero(~self.refused)
        seconds, most, least = 0.0, {}, {}
        for index, motion in enumerate(self.spec.records):
            mine = self.steps[rows[self.unique.record[rows] == index]]
            seconds += float(self.scenario_seconds(index, mine).sum())
            each = mine if len(mine) else np.array([self.still[index]])
            most[motion.name] = (motion.n_points - 1) * int(each.max())
            least[motion.name] = (motion.n_points - 1) * int(each.min())
        return {
            "asked": self.n_asked,
            "at_most": self.n_unique,
            "refused": int(self.refused.sum()),
            "kernels": len({kernel.shape for kernel in self.kernels().values()}),
            "steps": most,
            "steps_least": least,
            "seconds": seconds / max(1, workers),
            "cube_bytes": self.n_asked * self.bytes_per_scenario,
            "chunks": len(self.chunks(rows)),
            "accuracy_choice": self.choice,
        }


def _laws(spec: SweepSpec) -> tuple[Law, ...]:
    return (*(get_law(key) for key in spec.laws if key != "none"), get_law("none"))


def make_plan(spec: SweepSpec, *, initial_speed: float = 0.0) -> Plan:
    """Reduce a sweep to its unique scenarios.

    Parameters
    ----------
    spec : SweepSpec
        A valid sweep.
    initial_speed : float
        Largest speed (m/s) of approach at the start, which an accuracy must allow for.

    Returns
    -------
    Plan
        The same for the same sweep, always.

    Raises
    ------
    SweepError
        The accuracy asked for was not reached by any scheme when errors were measured.
    """
    laws = _laws(spec)
    unique, inverse = unique_scenarios(spec, laws)
    advice = None
    if spec.accuracy is None:
        assert spec.method is not None
        assert spec.dt is not None
        numerics = Numerics(spec.method, spec.dt, spec.locate, spec.beta, spec.gamma, spec.precision)
        still = tuple(numerics.steps(r) for r in spec.records)
        steps = np.array(still)[unique.record]
    else:
        from pounding_sweep.accuracy.advice import advise

        advice = advise(spec, laws, unique, initial_speed=initial_speed)
        still, steps = advice.still, advice.steps
        largest = max(r.dt / n for r, n in zip(spec.records, still, strict=True))
        numerics = Numerics(advice.method, largest, spec.locate, spec.beta, spec.gamma, spec.precision)
    limit = _limits(spec, laws, unique, numerics)
    step = np.array([r.dt for r in spec.records])[unique.record] / steps
    refused = np.zeros(len(unique), bool) if spec.force_unstable else step > limit
    return Plan(spec, unique, inverse, refused, limit, numerics, steps, still, advice.sentence if advice else "")


def _limits(spec: SweepSpec, laws: tuple[Law, ...], unique: Scenarios, numerics: Numerics) -> np.ndarray:
    """Largest stable step (s) of each row."""
    limit = np.full(len(unique), np.inf)
    for i, item in enumerate(laws):
        rows = np.flatnonzero(unique.law == i)
        if len(rows):
            limit[rows] = largest_step(
                spec.scene,
                item,
                unique.stiffness[rows],
                unique.restitution[rows],
                method=numerics.method,
                beta=spec.beta,
                gamma=spec.gamma,
                basis=spec.restitution_basis,
            )
    return limit


def untouched(plan: Plan, closing: dict[tuple[int, float], np.ndarray]) -> np.ndarray:
    """Rows of the unique table in which no pair can ever touch.

    Parameters
    ----------
    plan : Plan
        The plan.
    closing : dict
        (record, scale) -> largest closing displacement (m) of each contact without pounding.

    Returns
    -------
    ndarray of bool
        True where every gap is at least the closing displacement at all of its floors.
    """
    table = plan.unique
    result = plan.no_contact.copy()
    pairs = np.array([c.pair for c in plan.spec.scene.contacts], dtype=int)
    for (record, scale), displacement in closing.items():
        rows = np.flatnonzero((table.record == record) & (table.scale == scale) & ~result)
        if len(rows) and np.all(np.isfinite(displacement)):
            limit = np.maximum(displacement, 0.0) * (1.0 + CLOSING_MARGIN)
            result[rows] = np.all(table.gaps[np.ix_(rows, pairs)] >= limit[None, :], axis=1)
    return result
