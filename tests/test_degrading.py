"""Storeys that lose all strength: infill that drops out, storeys that fall, and what is made of them."""

from __future__ import annotations

import csv

import imk
import numpy as np
import pytest
from against_reference import motion
from scenes import hand_cube
from test_bilinear import reference as bilinear

import pounding_sweep as ps
from pounding_sweep.analysis import fractiles, fragility, incremental
from pounding_sweep.analysis.comparisons.fragility import FitStatus, sentence
from pounding_sweep.analysis.exchange import export_pelicun
from pounding_sweep.analysis.scenarios import values
from pounding_sweep.base.errors import SweepError
from pounding_sweep.figures.gallery import cubes as drawn
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.run.refinement import differences
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
    one = simulate(31, 2.0, method, dt, infill=infill)
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
    free = simulate(31, 2.5, "exact", 1e-2, hysteresis=OWN)
    extreme = free.displacement_max if side == "positive" else free.displacement_min
    limit = 0.6 * abs(extreme.item())
    limits = {"positive": 1.0, "negative": 1.0} | {side: limit}
    one = simulate(31, 2.5, method, dt, hysteresis=OWN | {"ultimate_drift": limits})
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
        ({"ductility_capacity_factors": {"a": [2.0]}}, "'a' has no cap_drift or ultimate_drift"),
        ({"deterioration_factors": {"b": [2.0]}}, "'b' has no deterioration"),
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


@pytest.mark.slow
def test_a_drift_that_turns_and_goes_on_at_once_is_seen_in_a_long_step():
    """Points between those of a record change nothing, but for the length of steps."""

    def degrading(caps, post_cap, ultimate, *rates):
        modes = zip(("strength", "post_cap", "unloading", "reloading"), rates, strict=True)
        backbone = {"cap_drift": caps, "post_cap": post_cap, "ultimate_drift": ultimate}
        return {"law": "peak_oriented", **backbone, "deterioration": dict(modes)}

    wall = {"law": "pinching", "cap_drift": [8.238e-4, 2.946e-4], "post_cap": -0.1, "residual": 0.0}
    rates = [0.06894, 0.02465], [0.2408, 0.0861], [0.1351, 0.0483], [0.06472, 0.02314]
    soft = ps.Building(
        *("soft", [57.05, 48.81], [38810.0, 50050.0], 0.1),
        yield_strengths=[99.5, 45.88],
        hardening=0.1,
        hysteresis=degrading([0.01188, 0.004249], -0.0715, [0.08244, 0.02948], *rates) | {"residual": 0.0},
        infill={
            "stiffnesses": [72110.0, 92990.0],
            "yield_strengths": [29.7, 13.7],
            "hysteresis": wall | {"pinch_force": 0.3, "pinch_drift": 0.3},
        },
    )
    rates = [0.03965, 0.02955], [0.01996, 0.01487], [0.02472, 0.01842], [0.04715, 0.03513]
    stiff = ps.Building(
        *("stiff", [277.5, 280.6], [842700.0, 568600.0]),
        yield_strengths=[463.7, 233.2],
        hysteresis=degrading([0.003088, 0.002301], -0.09158, [0.008797, 0.006555], *rates) | {"residual": 0.1},
    )
    record = ps.find_record("el_centro").scaled(0.23277179659174954)
    points = np.arange(record.n_points)
    between = np.interp(np.arange(5 * points[-1] + 1) / 5, points, record.acceleration)
    works = [
        ps.Sweep(
            ps.Scene([soft, stiff], [0.01]),
            motion,
            "kelvin_voigt",
            gaps=[0.00086, 0.001032, 0.001204, 0.001376, 0.00172],
            stiffnesses=[173300.0],
            restitutions=[0.85],
            **{"method": "exact", "dt": 1e-3, "rest": 0.0, "outputs": ["energy_input"]},
        )
        .run()
        .energy_input.values
        for motion in (record, ps.Record(name="between", acceleration=between, dt=record.dt / 5))
    ]
    np.testing.assert_allclose(works[0], works[1], rtol=1e-9)


SCALES = [1.0, 2.0, 3.0, 4.0]
RECORDS = ["r1", "r2", "r3", "r4"]  # of 1 m/s2 each


def leaning(name, n):
    return ps.Building(name, [100.0] * n, [5e3] * n, yield_strengths=[200.0] * n, p_delta=True)


@pytest.fixture
def cube():
    """Building a drifts by the scale times 10 mm, and falls under scale 3 of two records of four, and above of all."""
    scene = ps.Scene([leaning("a", 2), leaning("b", 1)], gaps=[0.05])
    drift = 0.01 * np.multiply.outer(np.ones(4), SCALES)
    falls = np.array([[0, 0, 1, 1], [0, 0, 1, 1], [0, 0, 0, 1], [0, 0, 0, 1]])
    storey = np.stack([2 * falls, 0 * falls], axis=-1)
    fill = {
        "drift_max": np.where(falls, 3.0, drift)[..., None, None] * [[0.5, 1.0], [0.1, 0.0]],
        "impact_count": falls[..., None, None],
        "collapsed_storey": storey,
        "collapse_time": np.where(storey > 0, 4.0, np.nan),
    }
    status = np.where(falls, Status.COLLAPSED, Status.OK)
    return hand_cube({"record": RECORDS, "scale": SCALES}, fill, scene=scene, status=status)


def test_a_fallen_building_exceeds_every_level(cube):
    """Even one above the height at which its drift was taken; the other only what it did before that."""
    for level in (0.035, 2.0, 50.0):
        result = fragility(cube, "drift", level, confidence=None)
        assert result.happened_count.sel(building="a").item() == 6
    assert result.fit_status.sel(building="a").item() == FitStatus.SEPARATED
    assert result.happened.sel(building="b").isnull().values.tolist() == (cube.status != 0).values.tolist()
    assert result.trials.values.tolist() == [16, 10]
    low = fragility(cube, "drift", 0.0025, confidence=None)  # b: 4 of scale 3, two of them by 0.3 m as the other falls
    assert low.happened_count.sel(building="b").item() == 2 + 6
    fallen = fragility(cube, "collapse", confidence=None)
    assert fallen.happened_count.values.tolist() == [6, 0]
    assert fallen.attrs["event_in_words"] == "the building falls"
    np.testing.assert_array_equal(fallen["median"], fragility(cube, "drift", 2.0, confidence=None)["median"])
    assert fallen.attrs["falls"].startswith("6 of 16 scenarios end where a storey falls")


def test_what_stronger_motions_did_not_tell_is_not_said_never_to_happen(cube):
    result = fragility(cube, "drift", 50.0, confidence=None).sel(building="b")
    assert sentence(result) == (
        "never happened in the scenarios that count, and stronger motions are left out: the statuses say why"
    )
    stands = cube.isel(scale=[0, 1])
    assert "even under the strongest motion tried; the median is above 2 m s-2" in sentence(
        fragility(stands, "drift", 50.0, confidence=None).sel(building="b")
    )


def test_fractiles_and_curves_end_where_half_have_fallen(cube):
    drift = fractiles(cube, [0.16, 0.5, 0.84]).drift_max_fractiles.sel(building="a", storey=2)
    np.testing.assert_allclose(drift.sel(scale=[1.0, 2.0]), 3 * [[0.01, 0.02]])
    np.testing.assert_array_equal(drift.sel(scale=3.0), [0.03, np.inf, np.inf])
    np.testing.assert_array_equal(drift.sel(scale=4.0), np.inf)
    curves = incremental(cube, levels=[1.5, 2.5, 3.0, 4.0], quantiles=[0.5])
    np.testing.assert_allclose(
        curves.drift_max_fractiles.sel(building="a", storey=2).squeeze(), [0.015, np.inf, np.inf, np.inf]
    )
    assert curves.collapse_share.sel(building="a").values.tolist() == [0.0, 0.5, 0.5, 1.0]
    assert "collapsed_storey" not in curves
    assert values(cube, "impact_count").sum() == 6.0  # up to the falls
    assert fractiles(cube).scenarios.values.tolist() == [4, 4, 4, 4]


def test_demands_tell_of_falls(cube, tmp_path):
    for building, n, falls in (("a", 16, 6), ("b", 10, 0)):
        assert export_pelicun(cube, tmp_path / f"{building}.csv", building) == n
        header, _, *rows = csv.reader((tmp_path / f"{building}.csv").read_text().splitlines())
        assert ("1-COLLAPSE-0-1" in header) == (falls > 0)
        if falls:
            fallen = [row for row in rows if row[header.index("1-COLLAPSE-0-1")] == "1"]
            assert len(fallen) == falls
            assert {row[header.index("1-PID-2-1")] for row in fallen} == {"1"}


def test_two_runs_that_fall_agree_by_time_storey_and_what_came_before():
    names = ["drift_max", "collapse_time", "collapsed_storey"]
    run = {
        "drift_max": np.array([[[3.0, 0.1]], [[3.0, 0.1]], [[3.0, 0.1]], [[3.0, 0.1]]]),
        "collapse_time": np.array([[4.0], [4.0], [4.0], [np.nan]]),
        "collapsed_storey": np.array([[1], [1], [1], [0]]),
        "status": np.array([8, 8, 8, 0]),
    }
    other = {name: each.copy() for name, each in run.items()}
    other["collapse_time"][:] = [[4.0], [4.04], [4.0], [4.0]]
    other["collapsed_storey"][:] = [[1], [1], [2], [1]]
    np.testing.assert_allclose(differences(names, run, other).max(axis=1), [0.0, 0.04 / 4.04, 0.5, np.inf])


@pytest.mark.slow
def test_fragility_of_a_row_that_falls(tmp_path):
    """By an accuracy none of 96 scenarios is left out or halved without end; medians as from all of them."""

    def building(name, period, strength):
        stiffness = 200.0 * (2 * np.pi / period) ** 2
        return ps.Building(name, [100.0] * 2, [stiffness] * 2, yield_strengths=[strength] * 2, p_delta=True)

    contact = ps.ContactProperties(linear_stiffness=1e5, restitution=0.6)
    scene = ps.Scene([building("A", 0.8, 200.0), building("B", 0.45, 300.0)], gaps=[0.05], contact=contact)
    records = [ps.synthetic_record(seed, pga=2.0) for seed in range(1, 13)]
    sweep = {"laws": ["kelvin_voigt"], "gaps": [0.05], "pgas": [1, 2, 3, 4, 6, 8, 12, 16], "outputs": ["drift_max"]}
    for numerics in ({"dt": 0.002}, {"accuracy": 1e-3}):
        cube = ps.Sweep(scene, records=records, **sweep, **numerics).run()
        assert {*cube.status.values.ravel().tolist()} == {Status.OK, Status.COLLAPSED}
        for level, median, dispersion in ((0.1, 2.417, 0.251), (0.15, 2.580, 0.234), (0.3, 3.044, 0.223)):
            fit = fragility(cube, "drift", level, confidence=None).sel(building="A").squeeze()
            assert (round(fit["median"].item(), 3), round(fit["dispersion"].item(), 3)) == (median, dispersion)
    assert float(cube.error_estimate.max()) <= 1e-3
    assert float(cube.time_step.min()) >= 1e-3


def test_ida_curves_are_flat_from_where_the_building_falls(cube):
    ax = drawn.incremental(cube, value="drift_max").axes[0]
    assert ax.get_title().endswith("building a")
    assert ax.get_xlim() == pytest.approx((0.0, 1.05 * 30.0))  # mm, of what stands
    (x, y) = next(line.get_data() for line in ax.lines if line.get_label() == "median")
    beyond = np.flatnonzero(x > 1e3)[0]
    slope = np.diff(y)[beyond - 1] / np.diff(x)[beyond - 1]
    assert abs(slope) * 31.5 < 1e-6
