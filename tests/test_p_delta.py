"""P-Delta: weights that take part of the storeys' stiffness: by formula, and where a row falls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from against_reference import both, motion, simulate, truth
from kernels_used import LEANING, LEANING_YIELDS
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

import pounding_sweep as ps
from pounding_sweep.engine.postprocess import variables_of
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.model.laws import LAWS
from pounding_sweep.model.variants import Variants
from pounding_sweep.plan.sanity import doubts
from pounding_sweep.request.spec import overview
from pounding_sweep.variables.registry import VARIABLES, Status, reducers_for

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
