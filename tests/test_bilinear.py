"""Bilinear storeys: what the tests over the registry of storey laws ask for."""

from __future__ import annotations

import numpy as np

PARAMETERS = {}


def reference(drifts, k, dy, r):
    """Shears along a history of drifts: the plastic drift is dragged along at the yield drift."""
    p, shears = 0.0, []
    for d in drifts:
        p = min(max(p, d - dy), d + dy)
        shears.append(r * k * d + (1.0 - r) * k * (d - p))
    return np.array(shears)
