"""From a sweep to the scenarios that must really run.

Every combination that was asked for is reduced to what can matter to it: a
law without restitution ignores that axis, no pounding ignores gap, stiffness
and restitution, a row in which no floors meet ignores the law. What remains
once is run once and broadcast back into the cube. A scenario whose every gap
is at least the largest closing displacement of the run without pounding never
touches: it is that run.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pounding_sweep.contact.laws import Law, get_law
from pounding_sweep.cube.variables import cube_variables, get_variable, reducers_for
from pounding_sweep.sweep.blocks import Numerics, RowKernel
from pounding_sweep.sweep.spec import SweepSpec, contact_stiffness, digest
from pounding_sweep.sweep.stability import largest_step

#: Cost of one scenario and step (ns per degree of freedom), for estimates and chunk sizes only.
NS_PER_DOF_AND_STEP = {"rk4": 2.6, "newmark": 4.5}
#: Wanted duration of one chunk (s) by that estimate; never depends on the machine or the workers.
CHUNK_SECONDS = 0.25
#: Memory of one scenario while it is planned, by measurement.
PLAN_BYTES = 400
#: Margin by which a gap must exceed the closing displacement to be left out.
CLOSING_MARGIN = 1e-9


@dataclass(frozen=True)
class Scenarios:
    """A table of scenarios, one row each.

    Attributes
    ----------
    law, record : ndarray of int
        Index into the plan's laws and records.
    scale, stiffness, restitution : ndarray of float
        Values (stiffness in kN/m**exponent); 0 and 1 where the law ignores them.
    gaps : ndarray, shape (n, pairs)
        Gaps (m); infinite where nothing can touch.
    """

    law: np.ndarray
    record: np.ndarray
    scale: np.ndarray
    stiffness: np.ndarray
    restitution: np.ndarray
    gaps: np.ndarray

    def __len__(self) -> int:
        return len(self.law)

    def __getitem__(self, rows: Any) -> Scenarios:
        return Scenarios(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


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
    """

    key: str
    law: int
    record: int
    rows: np.ndarray


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
    """

    spec: SweepSpec
    unique: Scenarios
    inverse: np.ndarray
    refused: np.ndarray
    limit: np.ndarray

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """Laws by the index that `unique` uses; the last is no pounding."""
        return _laws(self.spec)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the sweep's description."""
        return digest(self.spec)

    @cached_property
    def numerics(self) -> Numerics:
        """Scheme and step."""
        s = self.spec
        return Numerics(s.method, s.dt, s.locate, s.beta, s.gamma)

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

    def kernel(self, law: int, closing: bool = False) -> RowKernel:
        """Return the kernel of a law; `closing` adds the largest closing displacements."""
        reducers = reducers_for(self.spec.outputs) | ({"closing"} if closing else frozenset())
        return RowKernel(self.spec.scene, self.laws[law], self.numerics, reducers, host=self._host(law))

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
        simple = [item for item in both if not item.approach_only and not item.tension]
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
                    table.law[rows],
                    table.record[rows],
                )
            )
        ]
        kinds = np.stack([table.record[order], table.law[order]], axis=1)
        edges = np.flatnonzero(np.any(np.diff(kinds, axis=0) != 0, axis=1)) + 1
        for part in np.split(order, edges):
            if not len(part):
                continue
            record, law = int(table.record[part[0]]), int(table.law[part[0]])
            size = max(16, 16 * int(CHUNK_SECONDS / max(self.scenario_seconds(record), 1e-12) // 16))
            for first in range(0, len(part), size):
                mine = part[first : first + size]
                text = f"{self.digest}:{record}:{law}:".encode() + np.ascontiguousarray(mine, dtype="<i8").tobytes()
                result.append(Chunk(hashlib.sha256(text).hexdigest()[:32], law, record, mine))
        return result

    def scenario_seconds(self, record: int) -> float:
        """Estimated seconds of one scenario on one core."""
        motion = self.spec.records[record]
        steps = (motion.n_points - 1) * self.numerics.steps(motion)
        return steps * self.spec.scene.n_dof * NS_PER_DOF_AND_STEP[self.spec.method] * 1e-9

    @property
    def bytes_per_scenario(self) -> int:
        """Bytes of one scenario's values."""
        from pounding_sweep.cube.assemble import inner_shape

        return sum(
            np.dtype(get_variable(name).dtype).itemsize * math.prod(inner_shape(name, self.spec.scene))
            for name in cube_variables(self.spec.outputs)
        )

    def summary(self, workers: int = 1) -> dict[str, Any]:
        """Return counts and estimates, before anything is run.

        Returns
        -------
        dict
            ``asked``, ``at_most`` (scenarios to run before those that never touch
            are left out), ``refused``, ``kernels``, ``steps`` per scenario of each
            record, ``seconds`` (estimate, all workers), ``cube_bytes``, ``chunks``.
        """
        rows = np.flatnonzero(~self.refused)
        per_record = np.array([self.scenario_seconds(r) for r in range(len(self.spec.records))])
        seconds = float(per_record[self.unique.record[rows]].sum()) if len(rows) else 0.0
        return {
            "asked": self.n_asked,
            "at_most": self.n_unique,
            "refused": int(self.refused.sum()),
            "kernels": len({kernel.shape for kernel in self.kernels().values()}),
            "steps": {r.name: (r.n_points - 1) * self.numerics.steps(r) for r in self.spec.records},
            "seconds": seconds / max(1, workers),
            "cube_bytes": self.n_asked * self.bytes_per_scenario,
            "chunks": len(self.chunks(rows)),
        }


def _laws(spec: SweepSpec) -> tuple[Law, ...]:
    return (*(get_law(key) for key in spec.laws if key != "none"), get_law("none"))


def _index(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct rows of a table, and which of them each row is."""
    found, inverse = np.unique(values, axis=0, return_inverse=True)
    return found, inverse.reshape(-1)


def make_plan(spec: SweepSpec) -> Plan:
    """Reduce a sweep to its unique scenarios.

    Parameters
    ----------
    spec : SweepSpec
        A valid sweep.

    Returns
    -------
    Plan
        The same for the same sweep, always.
    """
    laws = _laws(spec)
    keys = [law.key for law in laws]
    asked = _asked_cases(spec, keys) if spec.cases is not None else _asked_product(spec, keys)
    law, gap_rows, stiffness, restitution, record, scale, gap_table = asked
    # what the law ignores is set to one value, so that equal scenarios become equal rows
    ignores_all = law == len(laws) - 1
    if not spec.scene.contacts:
        law = np.full_like(law, len(laws) - 1)
        ignores_all = np.ones_like(ignores_all)
    takes = np.array([item.takes_restitution for item in laws])
    restitution = np.where(takes[law], restitution, 1.0)
    stiffness = np.where(ignores_all, 0.0, stiffness)
    gap_rows = np.where(ignores_all, len(gap_table), gap_rows)
    codes, size = np.zeros(len(law), dtype=np.int64), 1
    columns = (record, law, scale, stiffness, restitution, gap_rows)
    for column in columns:
        values, index = np.unique(column, return_inverse=True)
        if size * len(values) >= 2**62:  # many listed cases: renumber before the codes overflow
            found, codes = np.unique(codes, return_inverse=True)
            size = len(found)
        codes = codes * len(values) + index
        size *= len(values)
    _, first, inverse = np.unique(codes, return_index=True, return_inverse=True)
    record_u, law_u, scale_u, k_u, e_u, gap_u = (column[first] for column in columns)
    gaps = np.vstack([gap_table, np.full((1, gap_table.shape[1]), np.inf)])[gap_u.astype(int)]
    unique = Scenarios(law_u.astype(int), record_u.astype(int), scale_u, k_u, e_u, gaps)
    limit = np.full(len(unique), np.inf)
    for i, item in enumerate(laws):
        rows = np.flatnonzero(unique.law == i)
        if len(rows):
            limit[rows] = largest_step(
                spec.scene,
                item,
                unique.stiffness[rows],
                unique.restitution[rows],
                method=spec.method,
                beta=spec.beta,
                gamma=spec.gamma,
            )
    numerics = Numerics(spec.method, spec.dt, spec.locate, spec.beta, spec.gamma)
    step = np.array([r.dt / numerics.steps(r) for r in spec.records])[unique.record]
    refused = np.zeros(len(unique), bool) if spec.force_unstable else step > limit
    return Plan(spec, unique, inverse.reshape(-1), refused, limit)


def _stiffness(spec: SweepSpec, key: str, absolute: float | None, factor: float | None) -> float:
    return contact_stiffness(spec.scene, key, stiffness=absolute, stiffness_factor=factor)


def _asked_product(spec: SweepSpec, keys: list[str]) -> tuple[Any, ...]:
    axes = spec.axes
    sizes = [len(v) for v in axes.values()]
    grid = np.indices(sizes, dtype=np.int32).reshape(len(sizes), -1)
    n_pairs = len(spec.scene.pair_names)
    law_of = np.array([keys.index(key) for key in spec.laws])
    absolute = spec.stiffnesses is not None
    values = (spec.stiffnesses if absolute else spec.stiffness_factors) or ()
    table = np.array(
        [[_stiffness(spec, key, v if absolute else None, None if absolute else v) for v in values] for key in spec.laws]
    )
    gap_table = (
        np.array([spec.scene.gaps], dtype=float).reshape(1, n_pairs)
        if spec.gaps is None
        else np.repeat(np.array(spec.gaps, dtype=float)[:, None], n_pairs, axis=1)
    )
    return (
        law_of[grid[0]],
        grid[1].astype(int),
        table[grid[0], grid[2]],
        np.array(spec.restitutions, dtype=float)[grid[3]],
        grid[4].astype(int),
        np.array(spec.scales, dtype=float)[grid[5]],
        gap_table,
    )


def _asked_cases(spec: SweepSpec, keys: list[str]) -> tuple[Any, ...]:
    cases = spec.cases or ()
    n_pairs = len(spec.scene.pair_names)
    names = [r.name for r in spec.records]
    rows = np.empty((len(cases), n_pairs))
    for i, case in enumerate(cases):
        rows[i] = spec.scene.gaps if case.gap is None else case.gap
    gap_table, gap_rows = _index(rows)
    return (
        np.array([keys.index(c.law) for c in cases]),
        gap_rows,
        np.array([_stiffness(spec, c.law, c.stiffness, c.stiffness_factor) for c in cases]),
        np.array([1.0 if c.restitution is None else c.restitution for c in cases]),
        np.array([names.index(c.record) if c.record is not None else 0 for c in cases]),
        np.array([c.scale for c in cases], dtype=float),
        gap_table,
    )


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
