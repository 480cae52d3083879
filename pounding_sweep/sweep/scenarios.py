"""The scenarios of a sweep as a table, each that differs in something that matters once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pounding_sweep.contact.laws import Law
from pounding_sweep.sweep.spec import SweepSpec, contact_stiffness


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


def unique_scenarios(spec: SweepSpec, laws: Sequence[Law]) -> tuple[Scenarios, np.ndarray]:
    """Reduce what a sweep asks for to what can matter.

    Parameters
    ----------
    spec : SweepSpec
        A valid sweep.
    laws : sequence of Law
        Laws by the index that the table uses; the last is no pounding.

    Returns
    -------
    scenarios : Scenarios
        The unique ones.
    inverse : ndarray of int, shape (n_asked,)
        Row that answers each asked scenario, in the order of the cube.
    """
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
    return Scenarios(law_u.astype(int), record_u.astype(int), scale_u, k_u, e_u, gaps), inverse.reshape(-1)


def _index(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct rows of a table, and which of them each row is."""
    found, inverse = np.unique(values, axis=0, return_inverse=True)
    return found, inverse.reshape(-1)


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
