"""Comparisons of cubes: amplification, laws, required gaps, impacts, energies, suites, fragility, spectra.

Names are loaded where they are first used. Each function takes a labelled cube
(`xarray.Dataset`), or scenes and records, and returns a labelled dataset.
"""

from __future__ import annotations

from typing import Any

from pounding_sweep.base.deferred import attribute

_HOME = {
    "amplification": "pounding_sweep.analysis.amplified",
    "compare_laws": "pounding_sweep.analysis.law_comparison",
    "required_gap": "pounding_sweep.analysis.gaps",
    "BehaviourFactors": "pounding_sweep.analysis.separation_rules",
    "SEPARATION_RULES": "pounding_sweep.analysis.separation_rules",
    "impact_statistics": "pounding_sweep.analysis.impacts",
    "energy_budget": "pounding_sweep.analysis.energies",
    "fractiles": "pounding_sweep.analysis.suites",
    "incremental_curves": "pounding_sweep.analysis.incremental",
    "fragility": "pounding_sweep.analysis.fragilities",
    "response_spectrum": "pounding_sweep.analysis.spectra",
    "floor_spectra": "pounding_sweep.analysis.spectra",
    "COMPARISONS": "pounding_sweep.analysis.comparisons",
}


def __getattr__(name: str) -> Any:
    return attribute(__name__, _HOME, name)


def __dir__() -> list[str]:
    return sorted(_HOME)
