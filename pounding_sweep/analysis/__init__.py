"""Comparisons of cubes, hazard, spectra and other formats; names are loaded where they are first used."""

from __future__ import annotations

from typing import Any

from pounding_sweep.analysis.comparisons import COMPARISONS
from pounding_sweep.base import attribute

#: Public names and the modules that have them.
_HOME = {
    "BehaviourFactors": "pounding_sweep.analysis.comparisons.gaps",
    "Hazard": "pounding_sweep.analysis.hazard",
    "read_hazard": "pounding_sweep.analysis.hazard",
    "SEPARATION_RULES": "pounding_sweep.analysis.comparisons.gaps",
    "constant_ductility": "pounding_sweep.analysis.spectra",
    "export_nrml": "pounding_sweep.analysis.exchange",
    "export_pelicun": "pounding_sweep.analysis.exchange",
    "response_spectrum": "pounding_sweep.analysis.spectra",
    "floor_spectra": "pounding_sweep.analysis.spectra",
    "scaled_to_sa": "pounding_sweep.engine.spectrum",
    "with_intensities": "pounding_sweep.analysis.rebuild",
}
_HOME |= {
    key.replace("-", "_"): f"pounding_sweep.analysis.comparisons.{item.module}" for key, item in COMPARISONS.items()
}


def __getattr__(name: str) -> Any:
    return attribute(__name__, _HOME, name)


def __dir__() -> list[str]:
    return sorted((*_HOME, "COMPARISONS"))
