"""Storey laws beside the uniaxial materials of OpenSees, along random histories of drifts."""

from __future__ import annotations

import numpy as np
import pytest

import pounding_sweep as ps


def random_drifts(seed, reach, points=60, histories=50, between=4, corners=()):
    """Return histories between random turns within a reach (m), shape (points, histories), which begin at zero.

    Each goes from turn to turn in `between` steps, and stops at those of the `corners` (m) that it passes.
    """
    rng, rising, rows = np.random.default_rng(seed), sorted(corners), [np.zeros(histories)]
    for turn in rng.uniform(-1.0, 1.0, (points // between, histories)) * rng.uniform(0.1, 1.0, histories) * reach:
        for end in np.linspace(rows[-1], turn, between + 1)[1:]:
            start = rows[-1]
            for up, down in zip(rising, rising[::-1], strict=True):
                corner = np.where(end >= start, up, down)
                rows.append(np.clip(corner, np.minimum(start, end), np.maximum(start, end)))
            rows.append(end)
    return np.array(rows)


def opensees_shears(material, arguments, drifts):
    """Return forces of a uniaxial material along each history, by OpenSees's material tester."""
    ops = pytest.importorskip("openseespy.opensees")
    shears = np.empty_like(drifts)
    for history, column in enumerate(drifts.T.tolist()):
        ops.wipe()
        ops.uniaxialMaterial(material, 1, *arguments)
        ops.testUniaxialMaterial(1)
        for point, drift in enumerate(column):
            ops.setStrain(drift)
            shears[point, history] = ops.getStress()
    ops.wipe()
    return shears


def check_against_opensees(building, material, arguments, drifts, near=1e-9):
    """Check the shears of a building's first storey at every point, to a share of its yield strength; the test."""
    test = ps.cyclic_test(building, drifts)
    error = np.abs(test.shear.values - opensees_shears(material, arguments, drifts)) / building.yield_strengths[0]
    assert error.max() < near, f"{error.max():.3g} at point and history {np.unravel_index(error.argmax(), error.shape)}"
    return test
