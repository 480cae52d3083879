"""Comparisons of cubes: amplification, laws, required gaps, impacts, energies, suites, fragility, spectra.

Names are loaded where they are first used. Each function takes a labelled cube
(`xarray.Dataset`), or scenes and records, and returns a labelled dataset.
"""

from __future__ import annotations

from typing import Any

from pounding_sweep.base.deferred import attribute

_HOME = {
    "amplification": "pounding_sweep.analysis.comparisons.amplification",
    "compare_laws": "pounding_sweep.analysis.comparisons.laws",
    "required_gap": "pounding_sweep.analysis.comparisons.required_gap",
    "BehaviourFactors": "pounding_sweep.analysis.separation_rules",
    "SEPARATION_RULES": "pounding_sweep.analysis.separation_rules",
    "impact_statistics": "pounding_sweep.analysis.comparisons.impacts",
    "energy_budget": "pounding_sweep.analysis.comparisons.energy",
    "fractiles": "pounding_sweep.analysis.comparisons.fractiles",
    "incremental_curves": "pounding_sweep.analysis.comparisons.incremental",
    "fragility": "pounding_sweep.analysis.comparisons.fragility",
    "response_spectrum": "pounding_sweep.analysis.spectra",
    "floor_spectra": "pounding_sweep.analysis.spectra",
    "COMPARISONS": "pounding_sweep.analysis.comparisons",
}


def __getattr__(name: str) -> Any:
    return attribute(__name__, _HOME, name)


def __dir__() -> list[str]:
    return sorted(_HOME)
