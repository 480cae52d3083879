"""Pinching storeys: what the tests over the registry of storey laws ask for; `test_peak_oriented` has the rest."""

from __future__ import annotations

from imk import shears

PARAMETERS = {"cap_drift": 0.012, "residual": 0.3, "pinch_force": 0.4, "pinch_drift": 0.5}


def reference(drifts, k, dy, r):
    """Shears along a history of drifts."""
    return shears(drifts, k, dy, r, cap=0.012, residual=0.3, pinch=(0.4, 0.5))
