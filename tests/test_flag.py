"""Self-centring storeys: a reference step by step, and the material of OpenSees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from against_reference import check_against_opensees, check_reference, random_drifts
from scenes import yielding_pair

import pounding_sweep as ps
from pounding_sweep.base.errors import SceneError

PARAMETERS = {"beta": 0.7}


def reference(drifts, k, dy, r):
    """Shears along a history of drifts: z = d - p stays between both lines of the side to which p lies."""
    shears, p = [], 0.0
    for d in drifts:
        for side in (1.0, -1.0):
            if side * p > 0.0:  # down to the lower line, which draws p back to zero at most
                p = side * min(side * p, max(side * d - (1.0 - PARAMETERS["beta"]) * dy, 0.0))
        p = min(max(p, d - dy), d + dy)
        shears.append(r * k * d + (1.0 - r) * k * (d - p))
    return np.array(shears)


@pytest.mark.parametrize(("beta", "hardening"), [(0.05, 0.0), (0.7, 0.1), (1.0, 0.02)])
def test_shears_are_those_of_opensees(beta, hardening):
    """Histories stop at the corner of the flag: SelfCentering keeps an old state where a step cuts it."""
    k, strength, flag = 4e4, 150.0, {"law": "flag", "beta": beta}
    building = ps.Building("a", [100.0], [k], yield_strengths=[strength], hardening=hardening, hysteresis=flag)
    corner = (1.0 - beta) * strength / k + 1e-13
    drifts = random_drifts(5, 0.03, histories=350, corners=(corner, -corner))
    check_against_opensees(building, "SelfCentering", (k, hardening * k, strength, beta), drifts)


def flags():
    """A row that leans, and one whose storeys have a flag beside a bilinear element and dampers that soften."""
    row, flag = yielding_pair(), {"law": "flag", **PARAMETERS}
    a, b = row.buildings
    parts = [
        flag | {"stiffness_share": 0.4, "strength_share": 0.6},
        {"law": "bilinear", "stiffness_share": 0.6, "strength_share": 0.4},
    ]
    return replace(row, row=[replace(a, hysteresis=flag, p_delta=True), replace(b, hysteresis=parts)])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "dt", "near"), [("exact", 5e-3, 1e-8), ("rk4", 1e-3, 1e-5), ("newmark", 1e-3, 4e-3)]
)
def test_a_pounding_row_moves_as_scipy_says(method, dt, near):
    got = check_reference(flags(), "kelvin_voigt", near, 126, 2.0, method=method, dt=dt)
    assert got.impact_count.sum() > 3
    assert (got.ductility_max > 10.0).sum() == 3
    assert got.residual_drift.values[0].tolist() == [0.0, 0.0]
    assert abs(got.energy_residual.item()) < near


@pytest.mark.parametrize("beta", [0.0, 1.1])
def test_flags_that_are_none_are_refused(beta):
    with pytest.raises(SceneError, match=r"hysteresis.*beta"):
        ps.Building("a", [1.0], [1.0], yield_strengths=[1.0], hysteresis={"law": "flag", "beta": beta})
