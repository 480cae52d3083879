"""P-Delta: weights that take part of the storeys' stiffness: by formula, and where a row falls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from against_twin import motion
from kernels_used import LEANING, LEANING_YIELDS
from scipy.linalg import eigh

import pounding_sweep as ps
from pounding_sweep.engine.postprocess import variables_of
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.model.laws import LAWS
from pounding_sweep.model.variants import Variants
from pounding_sweep.outputs.variables import VARIABLES, Status, reducers_for
from pounding_sweep.plan.sanity import doubts
from pounding_sweep.spec.spec import overview

G = 9.81
NOT_HERE = ("closing_max", "time_step", "error_estimate", "amplification")
OUTPUTS = [name for name, each in VARIABLES.items() if name not in NOT_HERE and each.exists_in(LEANING_YIELDS)]


def upright(scene):
    """The row without P-Delta."""
    return ps.Scene([replace(b, p_delta=False) for b in scene.row], scene.gaps, scene.contact)


def test_a_period_grows_as_its_storey_leans():
    """One storey: T = T0 / sqrt(1 - theta), theta = P / (k h)."""
    m, k, h = 100.0, 3000.0, 4.0
    plain, leaning = (ps.Building("a", [m], [k], 0.04, [h], p_delta=p) for p in (False, True))
    theta = m * G / (k * h)
    assert leaning.stability_coefficients == pytest.approx((theta,))
    assert leaning.periods[0] == pytest.approx(plain.periods[0] / np.sqrt(1.0 - theta), rel=1e-12)
    assert leaning.rayleigh[0] == pytest.approx(2.0 * 0.04 * 2.0 * np.pi / leaning.periods[0])


def test_modes_are_those_under_all_weights():
    """K less a geometric stiffness that is put together floor by floor, each leaning on all storeys below it."""
    masses, stiffnesses, heights = [90.0, 80.0, 60.0], [5e3, 4e3, 2e3], [4.5, 3.0, 3.5]
    building = ps.Building("a", masses, stiffnesses, (0.03, 0.05), heights, p_delta=True)
    n = len(masses)
    drift = np.eye(n) - np.eye(n, k=-1)
    taken = np.zeros((n, n))
    for floor, mass in enumerate(masses):
        for storey in range(floor + 1):
            taken += mass * G / heights[storey] * np.outer(drift[storey], drift[storey])
    want = eigh(drift.T @ np.diag(stiffnesses) @ drift - taken, np.diag(masses), eigvals_only=True)
    np.testing.assert_allclose(building.frequencies**2, want, rtol=1e-12)
    a, b = building.rayleigh
    w = np.sqrt(want[:2])
    np.testing.assert_allclose(0.5 * (a / w + b * w), [0.03, 0.05], rtol=1e-12)


def test_a_period_factor_is_one_under_the_weights():
    """Storeys get what weights take and what the factor leaves; a mass factor changes weights too, and no period."""
    n = len(LEANING.buildings)
    periods, masses, hardening = np.array([[2.0, 0.5]]), np.array([[3.0, 0.7]]), np.full((1, n), 0.1)
    row = Variants(LEANING_YIELDS, periods, masses, np.array([np.nan]), None, hardening)
    for i, building in enumerate(LEANING_YIELDS.buildings):
        here = slice(LEANING_YIELDS.offsets[i], LEANING_YIELDS.offsets[i + 1])
        stiffer = replace(
            building,
            masses=row.masses[0, here],
            stiffnesses=row.elastic_stiffnesses[0, here],
            hardening=0.1,
            yield_strengths=row.yield_strengths[0, here],
        )
        np.testing.assert_allclose(stiffer.periods, periods[0, i] * building.periods, rtol=1e-12)
        np.testing.assert_allclose(row.frequencies[i][0], stiffer.frequencies, rtol=1e-12)
        np.testing.assert_allclose(row.stiffnesses[0, here], stiffer.lateral_stiffnesses, rtol=1e-12)
        np.testing.assert_allclose(row.yield_drifts[0, here], np.divide(stiffer.yield_strengths, stiffer.stiffnesses))
        k, taken = np.array(stiffer.stiffnesses), np.array(stiffer.geometric_stiffnesses)
        slopes = np.where(stiffer.yields, 0.1 * k - taken, 0.1 * (k - taken))
        np.testing.assert_allclose((row.hardenings * row.stiffnesses)[0, here], slopes, rtol=1e-12)


@pytest.mark.parametrize(("share", "falls"), [pytest.param(0.999, False, marks=pytest.mark.slow), (1.001, True)])
def test_a_storey_falls_beyond_the_drift_at_which_nothing_holds_it(share, falls):
    """Without damping or ground motion the start decides: m v^2 / 2 against the work up to the drift Vy h / P.

    There the storey's shear is just what its weight pushes; beyond, the weight wins.
    """
    m, k, h, strength = 100.0, 3e3, 3.0, 200.0
    pushed = m * G / h
    yields, top = strength / k, strength / pushed
    work = 0.5 * (k - pushed) * yields**2 + strength * (top - yields) - 0.5 * pushed * (top**2 - yields**2)
    start = share * np.sqrt(2.0 * work / m)
    scene = ps.Scene([ps.Building("a", [m], [k], 0.0, [h], yield_strengths=[strength], p_delta=True)])
    numerics = Numerics("rk4", 0.01)
    kernel = RowKernel(scene, LAWS["none"], numerics, reducers_for(OUTPUTS), initial_velocity=(start,))
    still = ps.Record("still", 0.02, np.zeros(301))
    lanes = {"scale": np.ones(1), "gaps": np.ones((1, 0)), "stiffness": np.zeros(1), "restitution": np.ones(1)}
    raw = kernel.run(still, twin=True, **lanes)
    found = variables_of(kernel, raw, OUTPUTS, still)
    assert found["status"].tolist() == [Status.DIVERGED if falls else Status.OK]
    if falls:
        assert raw["drift"].max() > h
    else:
        held = 0.5 * m * (start / share) ** 2 * (1.0 - share**2)  # what is missing to the top
        assert raw["drift"].max() == pytest.approx(top - np.sqrt(2.0 * held / pushed), rel=1e-5)
        assert found["ductility_max"].max() < top / yields


def test_a_storey_rests_where_its_weight_and_its_spring_agree():
    """(k - P / h) d = (1 - r) k p: by the twin; and where that is beyond what it holds, it does not rest."""
    got = ps.simulate(LEANING_YIELDS, motion(251, 1.5), law="kelvin_voigt", method="rk4", dt=5e-4)
    a = LEANING_YIELDS.buildings[0]
    plastic = got.plastic_drift.values[-1, 0]
    want = 0.95 * np.array(a.stiffnesses) * plastic / np.array(a.lateral_stiffnesses)
    np.testing.assert_allclose(got.residual_drift.values[0], want, rtol=1e-9)
    assert (np.abs(want) > np.abs(0.95 * plastic)).all()


def test_a_row_in_words_tells_how_near_it_is_to_falling():
    told = dict(overview(LEANING))["a"]
    assert told.endswith("with P-Delta, stability coefficients up to 0.086")
    assert "P-Delta" not in dict(overview(upright(LEANING)))["a"]
    near = ps.Building("a", [100.0], [1e3], storey_heights=[2.5], p_delta=True)
    found = doubts(ps.Sweep(ps.Scene([near]), motion(51), laws="none").spec)
    assert any(text.startswith("stability coefficient P / (k h) of a storey 0.3924 (a, storey 1)") for text in found)
