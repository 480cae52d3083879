"""Comparisons of cubes: amplification, laws, required gaps, impacts, energies, suites, fragility, spectra.

Names are loaded where they are first used. Each function takes a labelled cube
(`xarray.Dataset`), or scenes and records, and returns a labelled dataset.
"""

from __future__ import annotations

from typing import Any

from pounding_sweep.analysis.comparisons import COMPARISONS
from pounding_sweep.base.deferred import attribute

#: Public names beside the comparisons.
_HOME = {
    "BehaviourFactors": "pounding_sweep.analysis.separation_rules",
    "Hazard": "pounding_sweep.analysis.hazard",
    "read_hazard": "pounding_sweep.analysis.hazard",
    "SEPARATION_RULES": "pounding_sweep.analysis.separation_rules",
    "constant_ductility": "pounding_sweep.analysis.strengths",
    "export_nrml": "pounding_sweep.analysis.exchange",
    "export_pelicun": "pounding_sweep.analysis.exchange",
    "response_spectrum": "pounding_sweep.analysis.spectra",
    "floor_spectra": "pounding_sweep.analysis.spectra",
    "scaled_to_sa": "pounding_sweep.engine.spectrum",
    "with_intensities": "pounding_sweep.analysis.intensity",
}


def _homes() -> dict[str, str]:
    return {item.make.__name__: item.make.__module__ for item in COMPARISONS.values()} | _HOME


def __getattr__(name: str) -> Any:
    return attribute(__name__, {} if name.startswith("__") else _HOME if name in _HOME else _homes(), name)


def __dir__() -> list[str]:
    return sorted((*_homes(), "COMPARISONS"))
