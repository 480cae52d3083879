"""Storeys that lose all strength: infill that drops out, storeys that fall, factors on what they can bear."""

from __future__ import annotations

import imk
import numpy as np
import pytest
from against_reference import motion
from test_bilinear import reference as bilinear

import pounding_sweep as ps
from pounding_sweep.base.errors import SweepError
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.variables.registry import Status

K, STRENGTH, R = 4e4, 150.0, 0.05
WALL = {"law": "pinching", "cap_drift": 0.004, "post_cap": -0.3, "pinch_force": 0.3, "pinch_drift": 0.4}
OWN = {"law": "peak_oriented", "cap_drift": 0.01, "post_cap": -0.05, "residual": 0.2}
at_night = pytest.mark.slow
each_method = pytest.mark.parametrize(
    ("method", "dt"),
    [("exact", 4e-3), pytest.param("rk4", 2e-3, marks=at_night), pytest.param("newmark", 1e-3, marks=at_night)],
)


def simulate(points, scale, method, dt, **building):
    row = ps.Scene([ps.Building("a", [100.0], [K], yield_strengths=[STRENGTH], hardening=R, **building)])
    return ps.simulate(row, motion(points, scale), law="none", method=method, dt=dt, rest=0.0)


@each_method
@pytest.mark.usefixtures("twin")
def test_infill_drops_out_for_good_and_the_frame_goes_on(method, dt):
    infill = ps.Infill(2e4, 60.0, hysteresis=WALL)
    one = simulate(51, 1.5, method, dt, infill=infill)
    drift, shear = one.storey_drift.values.ravel(), one.storey_shear.values.ravel()
    wall = imk.shears(drift, 2e4, 60.0 / 2e4, 0.0, cap=0.004, post_cap=-0.3, pinch=(0.3, 0.4))
    want = bilinear(drift, K, STRENGTH / K, R) + wall
    np.testing.assert_allclose(shear, want, atol=1.0)
    when, (lasts,) = one.infill_failure_time.item(), np.flatnonzero(wall)[-1:]
    assert one.time.values[lasts] <= when <= one.time.values[lasts + 1]
    assert 0.1 < when < one.time.values[-1] - 0.1
    assert one.strength_left.item() == pytest.approx(STRENGTH / (STRENGTH + 60.0))  # of both springs
    assert int(one.status) == Status.OK
    work = np.sum(0.5 * (shear[1:] + shear[:-1]) * np.diff(drift))
    lost = one.hysteretic_energy.item() + one.strain.values[-1].item()
    assert lost == pytest.approx(work, abs=0.01 * np.abs(shear).max() * np.ptp(drift))


@each_method
@pytest.mark.parametrize("side", ["positive", pytest.param("negative", marks=at_night)])
@pytest.mark.usefixtures("twin")
def test_a_storey_falls_at_its_ultimate_drift_of_either_side(side, method, dt):
    free = simulate(51, 2.0, "exact", 1e-2, hysteresis=OWN)
    extreme = free.displacement_max if side == "positive" else free.displacement_min
    limit = 0.6 * abs(extreme.item())
    limits = {"positive": 1.0, "negative": 1.0} | {side: limit}
    one = simulate(51, 2.0, method, dt, hysteresis=OWN | {"ultimate_drift": limits})
    assert int(one.status) == Status.COLLAPSED
    reached = one.displacement_max if side == "positive" else -one.displacement_min
    assert reached.item() == pytest.approx(limit, rel=1e-6)
    drift = free.displacement.values.ravel() * (1.0 if side == "positive" else -1.0)
    first = np.flatnonzero(drift > limit)[0]
    assert free.time.values[first - 1] - 1e-3 <= one.collapse_time.item() <= free.time.values[first] + 1e-3
    assert one.collapsed_storey.item() == 1
    assert one.strength_left.item() == 0.0


@pytest.mark.usefixtures("twin")
def test_what_is_left_is_what_the_backbone_still_reaches():
    one = simulate(61, 1.3, "exact", 1e-2, hysteresis=OWN)
    cap = STRENGTH + R * K * (0.01 - STRENGTH / K)
    sides = [one.displacement_max.item(), -one.displacement_min.item()]
    left = [max(cap - 0.05 * K * (x - 0.01), 0.2 * STRENGTH) / cap if x > 0.01 else 1.0 for x in sides]
    assert one.strength_left.item() == pytest.approx(min(left), rel=1e-3)
    assert 0.3 < min(left) < 0.95


def test_factors_are_on_capacities_and_deterioration_of_all_springs():
    own = OWN | {"ultimate_drift": {"positive": [0.1, 0.2], "negative": 0.3}, "deterioration": {"strength": [1.0, 2.0]}}
    walls = {"stiffnesses": 5e4, "yield_strengths": 60.0, "hysteresis": WALL}
    strengths = {"yield_strengths": [90.0, 80.0]}
    building = ps.Building("a", [100.0, 80.0], [1e5, 8e4], **strengths, hysteresis=own, infill=walls)
    scene, one = ps.Scene([building]), np.ones((1, 1))
    rows = Variants(scene, one, one, np.full(1, np.nan), one, np.nan * one, 1.5 * one, 3.0 * one)
    made = variants_of(rows.scene_of(0))
    law = made.scene.buildings[0].hysteresis
    assert law.cap_drift == pytest.approx(0.015)
    assert law.ultimate_drift.positive == pytest.approx((0.15, 0.3))
    assert law.deterioration.strength == pytest.approx((3.0, 6.0))
    assert made.scene.buildings[0].infill.hysteresis.cap_drift == pytest.approx(0.006)
    assert any(
        (rows.spring_constants[name] != variants_of(scene).spring_constants[name]).any()
        for name in made.spring_constants
    )
    for name, constants in rows.spring_constants.items():
        np.testing.assert_allclose(constants, made.spring_constants[name], rtol=1e-12, err_msg=name)


@pytest.mark.parametrize(
    ("axes", "message"),
    [
        ({"ductility_capacity_factors": {"a": [2.0]}}, "'a' has no storey law with cap_drift or ultimate_drift"),
        ({"deterioration_factors": {"b": [2.0]}}, "'b' has no storey law with deterioration"),
        ({"ductilities": [2.0]}, "storeys lose strength at drifts of their own"),
    ],
)
def test_axes_of_what_storeys_do_not_lose_are_refused(axes, message):
    row = [
        ps.Building("a", [1.0], [1e3], yield_strengths=[1.0]),
        ps.Building("b", [1.0], [1e3], yield_strengths=[1.0], hysteresis=OWN),
    ]
    with pytest.raises(SweepError, match=message):
        ps.Sweep(ps.Scene(row, [0.01]), "el_centro", "none", **axes)
