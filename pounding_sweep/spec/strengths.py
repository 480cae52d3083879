"""Strengths of scenarios that ask for a ductility: found for each record, before anything is planned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pounding_sweep.base.errors import SweepError
from pounding_sweep.model.variants import Variants
from pounding_sweep.spec.axes import Case
from pounding_sweep.spec.spec import SweepSpec

#: Digits of the factors that are found: more than any result shows, and fewer than tell machines apart.
DIGITS = 9


def with_strengths(spec: SweepSpec) -> SweepSpec:
    """Return a sweep whose cases have the factors on strengths for the ductilities that they ask for."""
    # a motion twice as strong reaches the same ductility at twice the strength, and a building's masses change neither:
    # one search serves all scales, laws, gaps and masses of a record
    if spec.cases is None:
        return spec
    cases = list(spec.cases)
    groups: dict[str, dict[Case, list[int]]] = {}
    for i, case in enumerate(cases):
        if case.ductility is not None and not case.strength_factors:
            alike = Case(
                "none",
                period_factors=case.period_factors,
                damping_ratio=case.damping_ratio,
                hardenings=case.hardenings,
                ductility=case.ductility,
            )
            groups.setdefault(case.record or spec.records[0].name, {}).setdefault(alike, []).append(i)
    for name, group in groups.items():
        found = _found(spec, name, list(group))
        for each, rows in zip(found, group.values(), strict=True):
            for i in rows:
                scale = abs(spec.case_value(cases[i], "scale")) or 1.0
                factors = {building: float(f"{factor * scale:.{DIGITS}g}") for building, factor in each.items()}
                cases[i] = replace(cases[i], strength_factors=tuple(factors.items()))
    return replace(spec, cases=tuple(cases)) if groups else spec


def _found(spec: SweepSpec, record: str, cases: Sequence[Case]) -> list[dict[str, float]]:
    """Return the factors at scale 1 of buildings that yield, by name."""
    from pounding_sweep.engine.ductility import REACH, strengths_for

    buildings = spec.scene.buildings
    periods, hardenings = (
        np.array([[dict(getattr(case, name)).get(b.name, own) for b in buildings] for case in cases], float)
        for name, own in (("period_factors", 1.0), ("hardenings", np.nan))
    )
    ratios = np.array([np.nan if case.damping_ratio is None else case.damping_ratio for case in cases])
    row = Variants(spec.scene, periods, np.ones(periods.shape), ratios, None, hardenings)  # type: ignore[arg-type]
    targets = np.array([case.ductility for case in cases], float)
    factors, _ = strengths_for(row, spec.record(record), targets)
    result = []
    for case, each in zip(cases, factors, strict=True):
        own = {b.name: factor for b, factor in zip(buildings, each.tolist(), strict=True) if any(b.yields)}
        if lacking := [name for name, factor in own.items() if np.isnan(factor)]:
            msg = (
                f"ductilities: {case.ductility:g} of building {lacking[0]!r} is not reached under {record!r}, not even "
                f"at 1 / {REACH * (case.ductility or 1.0):g} of the strength at which it stays elastic; leave it out"
            )
            raise SweepError(msg, [msg])
        result.append(own)
    return result
