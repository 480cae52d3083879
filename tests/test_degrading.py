"""Storeys that lose strength or lean: infill that drops out, storeys that fall, and what is made of them."""

from __future__ import annotations

import csv
from dataclasses import replace

import imk
import numpy as np
import pytest
from against_reference import both, motion, simulate, truth
from kernels_used import LEANING, LEANING_YIELDS
from scenes import hand_cube
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from test_bilinear import reference as bilinear

import pounding_sweep as ps
from benchmarks.drawn_rows import draw, earthquakes
from pounding_sweep.analysis import fractiles, fragility, incremental
from pounding_sweep.analysis.comparisons.fragility import FitStatus, sentence
from pounding_sweep.analysis.exchange import export_pelicun
from pounding_sweep.analysis.scenarios import values
from pounding_sweep.base.errors import SweepError
from pounding_sweep.engine.postprocess import variables_of
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.figures.gallery import cubes as drawn
from pounding_sweep.model.laws import LAWS
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.plan.sanity import doubts
from pounding_sweep.request.spec import overview
from pounding_sweep.run.refinement import differences
from pounding_sweep.variables.registry import VARIABLES, Status, reducers_for

K, STRENGTH, R = 4e4, 150.0, 0.05
WALL = {"law": "pinching", "cap_drift": 0.004, "post_cap": -0.3, "pinch_force": 0.3, "pinch_drift": 0.4}
OWN = {"law": "peak_oriented", "cap_drift": 0.01, "post_cap": -0.05, "residual": 0.2}
at_night = pytest.mark.slow
each_method = pytest.mark.parametrize(
    ("method", "dt"),
    [("exact", 4e-3), pytest.param("rk4", 2e-3, marks=at_night), pytest.param("newmark", 1e-3, marks=at_night)],
)


def shaken(points, scale, method, dt, **building):
    row = ps.Scene([ps.Building("a", [100.0], [K], yield_strengths=[STRENGTH], hardening=R, **building)])
    return ps.simulate(row, motion(points, scale), law="none", method=method, dt=dt, rest=0.0)


@each_method
@pytest.mark.usefixtures("twin")
def test_infill_drops_out_for_good_and_the_frame_goes_on(method, dt):
    infill = ps.Infill(2e4, 60.0, hysteresis=WALL)
    one = shaken(31, 2.0, method, dt, infill=infill)
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
    free = shaken(31, 2.5, "exact", 1e-2, hysteresis=OWN)
    extreme = free.displacement_max if side == "positive" else free.displacement_min
    limit = 0.6 * abs(extreme.item())
    limits = {"positive": 1.0, "negative": 1.0} | {side: limit}
    one = shaken(31, 2.5, method, dt, hysteresis=OWN | {"ultimate_drift": limits})
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
    one = shaken(61, 1.3, "exact", 1e-2, hysteresis=OWN)
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


@pytest.mark.slow
def test_storeys_that_degrade_come_to_rest_without_gaining_energy():
    spec = draw(631, 4, ["kelvin_voigt"], earthquakes(), ["degrading pinching"])
    case, record = spec.cases[2], spec.records[0]
    given = {"law": case.law, "stiffness": case.stiffness, "restitution": case.restitution}
    runs = [
        ps.simulate(ps.Scene(spec.scene.row, case.gap), record.scaled(case.scale), method=method, dt=dt, **given)
        for method, dt in (("exact", 1e-3), ("rk4", 2e-4))
    ]
    np.testing.assert_allclose(*(run.energy_damping.values for run in runs), rtol=1e-5)


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

    There the storey's shear is just what its weight pushes; beyond, the weight wins, and the run ends at the height.
    """
    m, k, h, strength = 100.0, 3e3, 3.0, 200.0
    pushed = m * G / h
    yields, top = strength / k, strength / pushed
    work = 0.5 * (k - pushed) * yields**2 + strength * (top - yields) - 0.5 * pushed * (top**2 - yields**2)
    start = share * np.sqrt(2.0 * work / m)
    scene = ps.Scene([ps.Building("a", [m], [k], 0.0, [h], yield_strengths=[strength], p_delta=True)])
    found, raw = one_lane(scene, "rk4", 0.01, ps.Record("still", 0.02, np.zeros(301)), (start,))
    assert found["status"].tolist() == [Status.COLLAPSED if falls else Status.OK]
    assert found["collapsed_storey"].tolist() == [[int(falls)]]
    if not falls:
        held = 0.5 * m * (start / share) ** 2 * (1.0 - share**2)  # what is missing to the top
        assert raw["drift"].max() == pytest.approx(top - np.sqrt(2.0 * held / pushed), rel=1e-5)
        assert found["ductility_max"].max() < top / yields
        assert np.isnan(found["collapse_time"]).all()
        return

    def reached(_, y):
        return y[0] - h

    reached.terminal = True
    want = solve_ivp(
        lambda _, y: [y[1], (pushed * y[0] - min(k * y[0], strength)) / m],
        (0.0, 6.0), [0.0, start], events=reached, rtol=1e-11, atol=1e-12, max_step=0.01,
    )  # fmt: skip
    assert found["collapse_time"] == pytest.approx(want.t_events[0][0], rel=1e-7)
    np.testing.assert_allclose(found["drift_max"].ravel(), h, rtol=1e-9)
    energy = 0.5 * m * want.y_events[0][0][1] ** 2
    assert found["energy_kinetic"].ravel() == pytest.approx(energy, rel=1e-7)
    assert np.isnan(found["residual_drift"]).all()  # it does not rest


def one_lane(scene, method, dt, record, velocity=None):
    """Run the twin of a kernel; the variables of its one scenario, and raw results."""
    lanes = {"scale": np.ones(1), "gaps": np.ones((1, 0)), "stiffness": np.zeros(1), "restitution": np.ones(1)}
    kernel = RowKernel(scene, LAWS["none"], Numerics(method, dt), reducers_for(OUTPUTS), initial_velocity=velocity)
    raw = kernel.run(record, twin=True, **lanes)
    return variables_of(kernel, raw, OUTPUTS, record), raw


def test_a_fall_in_steps_that_do_not_resolve_it_is_none():
    """At 12 m/s the drift passes more than a quarter of its height in one step of 0.1 s: nobody knows what it did."""
    scene = ps.Scene([ps.Building("a", [100.0], [3e3], 0.0, [3.0], yield_strengths=[200.0], p_delta=True)])
    status = [
        one_lane(scene, "rk4", dt, ps.Record("still", 0.1, np.zeros(20)), (12.0,))[0]["status"].tolist()
        for dt in (0.1, 0.01)
    ]
    assert status == [[Status.DIVERGED], [Status.COLLAPSED]]


@pytest.mark.parametrize(
    ("method", "dt", "bound"),
    [
        ("rk4", 1e-3, 1e-5),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in (("exact", 5e-3, 1e-8), ("newmark", 2e-4, 1e-4), ("central_difference", 2e-4, 3e-4))
        ),
    ],
)
def test_a_row_that_falls_is_its_twin_up_to_the_fall(method, dt, bound):
    """Time, storey and all values of the row against the independent solver, which ends at the same event."""
    want = truth(LEANING_YIELDS, "kelvin_voigt", 401, 6.0)
    got = simulate(LEANING_YIELDS, "kelvin_voigt", 401, 6.0, method=method, dt=dt)
    time, building, storey = want["fallen"]
    assert int(got.status) == Status.COLLAPSED
    assert got.collapse_time.values[building] == pytest.approx(time, rel=0.1 * bound)
    assert got.collapsed_storey.values.tolist() == [storey if b == building else 0 for b in range(2)]
    assert time - 2.0 * dt < got.time[-1] <= time
    values = both(got, want, LEANING_YIELDS)
    for name, (mine, theirs) in values.items():
        if name not in ("displacement", "plastic_drift_end", "residual_drift"):
            size = np.nanmax(np.abs(theirs)) or 1.0
            np.testing.assert_allclose(mine / size, theirs / size, rtol=0, atol=bound, err_msg=name)


def test_a_smooth_storey_falls_when_scipy_says_so():
    """Bouc and Wen with P-Delta, its three equations written out."""
    m, k, h, strength, r, n, beta, gamma = 100.0, 3e3, 3.0, 150.0, 0.02, 2.0, 0.5, 0.5
    law = {"law": "bouc_wen", "n": n, "beta": beta, "gamma": gamma}
    building = ps.Building(
        "a", [m], [k], 0.0, [h], yield_strengths=[strength], hardening=r, p_delta=True, hysteresis=law
    )
    time = np.arange(301) * 0.01
    ground = 3.0 * np.sin(1.6 * np.pi * time) + 0.3

    def rates(t, y):
        d, v, p = y
        z = d - p
        force = r * k * d + (1.0 - r) * k * z - m * G / h * d
        flow = abs(z * k / strength) ** n * (gamma * v + beta * abs(v) * np.sign(z))
        return [v, -force / m - np.interp(t, time, ground), flow]

    def reached(_, y):
        return abs(y[0]) - h

    reached.terminal = True
    want = solve_ivp(rates, (0.0, 3.0), [0.0] * 3, events=reached, rtol=1e-9, atol=1e-11, max_step=0.005).t_events[0]
    found, _ = one_lane(ps.Scene([building]), "rk4", 0.01, ps.Record("shake", 0.01, ground))
    assert found["status"].tolist() == [Status.COLLAPSED]
    assert found["collapse_time"].ravel() == pytest.approx(want, rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("strength", [180.0, 1.4e4])
def test_exact_flight_ends_where_an_elastic_storey_falls(strength):
    """A low storey that yields late, beyond its height, or moves there by and by: time and values are those of rk4."""
    scene = ps.Scene(
        [ps.Building("a", [100.0], [4e4], 0.02, [0.3], yield_strengths=[strength], hardening=0.09, p_delta=True)]
    )
    scales = np.linspace(1.8, 12.0, 16) * (1.0 if strength < 1e3 else 5.0)
    lanes = {"scale": scales, "gaps": np.ones((16, 0)), "stiffness": np.ones(16), "restitution": np.ones(16)}
    record, found = motion(1201), []
    for method, dt in (("rk4", 5e-4), ("exact", 5e-3)):
        kernel = RowKernel(scene, LAWS["none"], Numerics(method, dt), reducers_for(OUTPUTS))
        found.append(variables_of(kernel, kernel.run(record, **lanes), OUTPUTS, record))
    assert {*found[0]["status"].tolist()} == {Status.OK, Status.COLLAPSED}
    for name in ("status", "collapse_time", "drift_max", "energy_input"):
        np.testing.assert_allclose(found[0][name], found[1][name], rtol=1e-7, err_msg=name)


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
