"""The oracle itself against closed forms, exact linear solutions and conservation laws."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from naive import (
    LAWS,
    WALL,
    NaiveBuilding,
    damping_coefficient,
    modal_exact,
    run,
    two_mass_impact,
    two_mass_restitution,
)
from scipy.linalg import expm
from scipy.optimize import brentq

# the solver of the tests, not the package: kernels that disagree with it are found by every default run
pytestmark = pytest.mark.slow
NOMINAL = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95]
# Restitution two free masses really get from the published damping. From converged independent integrations.
REALISED = {
    "kelvin_voigt_tension": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95],
    "kelvin_voigt": [0.253, 0.325, 0.397, 0.472, 0.550, 0.632, 0.718, 0.808, 0.902, 0.951],
    "modified_kelvin_voigt": [0.114, 0.224, 0.328, 0.428, 0.525, 0.620, 0.714, 0.807, 0.902, 0.951],
    "linear_viscoelastic": [0.102, 0.205, 0.307, 0.407, 0.506, 0.605, 0.703, 0.801, 0.900, 0.950],
    "modified_kelvin": [0.074, 0.166, 0.271, 0.380, 0.488, 0.594, 0.697, 0.799, 0.900, 0.950],
    "hertz_damped": [0.665, 0.672, 0.684, 0.702, 0.725, 0.756, 0.796, 0.847, 0.913, 0.954],
    "hunt_crossley": [0.516, 0.547, 0.581, 0.620, 0.663, 0.712, 0.768, 0.833, 0.909, 0.952],
    "ye_hertz": [0.069, 0.156, 0.256, 0.363, 0.470, 0.577, 0.683, 0.789, 0.894, 0.947],
    "gonthier": [0.101, 0.205, 0.304, 0.398, 0.488, 0.577, 0.670, 0.768, 0.876, 0.936],
    "hysteretic": [0.609, 0.619, 0.636, 0.660, 0.692, 0.734, 0.784, 0.845, 0.917, 0.957],
    "nonlinear_viscoelastic": [0.093, 0.191, 0.292, 0.393, 0.495, 0.596, 0.698, 0.799, 0.900, 0.950],
}
DAMPED = list(REALISED)
ALL_LAWS = ["linear", "hertz", *DAMPED]
M1, M2, V0 = 150.0, 210.0, 0.4
MEFF = M1 * M2 / (M1 + M2)


def stiffness_of(law):
    return 2.0e6 if LAWS[law].exponent == 1.0 else 1.88e7


def shear(masses, stiffness, **options):
    return NaiveBuilding(list(masses), [stiffness] * len(masses), **options)


def left_building():
    return shear([173.331, 173.331, 133.956], 555.55e3)


def middle_building():
    return shear([175.661, 175.661, 136.286], 355.55e3)


def right_building():
    return shear([182.041, 182.041, 140.641], 333.472e3)


def motion(seconds=2.5, dt=0.01, strength=1.0, seed=3):
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds / dt) + 1) * dt
    ag = sum(
        rng.normal() * np.sin(2 * np.pi * f * t + rng.uniform(0, 2 * np.pi)) for f in np.linspace(0.7, 8.0, 16)
    ) * np.sin(np.pi * t / t[-1])
    return strength * 4.0 * ag / np.max(np.abs(ag))


def free_pair(law, e, *, gap=0.01, v_left=V0, v_right=0.0, dt=0.01, points=13, k=None):
    """Two masses on springs so soft that they are free, run into each other by the full solver."""
    soft = [NaiveBuilding([m], [1e-7], damping_ratio=0.0) for m in (M1, M2)]
    k = stiffness_of(law) if k is None and law != "stereomechanical" else k
    return run(soft, [gap], np.zeros(points), dt, law, k, e, initial_velocity=[[v_left], [v_right]])


def flat(parts):
    return np.concatenate([np.ravel(p) for p in parts])


# -- two free masses ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", DAMPED)
def test_restitution_table(law):
    got = [two_mass_restitution(law, stiffness_of(law), e, M1, M2, V0) for e in NOMINAL]
    np.testing.assert_allclose(got, REALISED[law], rtol=0, atol=5.1e-4)


@pytest.mark.parametrize("law", ALL_LAWS)
def test_restitution_knows_no_speed_mass_or_stiffness(law):
    reference = two_mass_restitution(law, stiffness_of(law), 0.55, M1, M2, V0)
    for k, m1, m2, v0 in [
        (stiffness_of(law), M1, M2, 0.02),
        (3.3e5, M1, M2, 2.0),
        (stiffness_of(law), 40.0, 900.0, V0),
    ]:
        assert two_mass_restitution(law, k, 0.55, m1, m2, v0) == pytest.approx(reference, rel=1e-9)
    assert two_mass_restitution(law, stiffness_of(law), 1.0, M1, M2, V0) == pytest.approx(1.0, rel=1e-10)


@pytest.mark.parametrize("e", [0.15, 0.5, 0.9])
def test_restitution_of_linear_dashpots_in_closed_form(e):
    def g(z):
        ratio = np.arccos(z) / np.sqrt(1 - z * z) if z < 1 else np.arccosh(z) / np.sqrt(z * z - 1)
        return np.exp(-z * ratio)

    z = damping_coefficient("kelvin_voigt", e)
    got = {law: two_mass_restitution(law, stiffness_of(law), e, M1, M2, V0) for law in DAMPED}
    assert got["kelvin_voigt_tension"] == pytest.approx(e, rel=1e-9)
    assert got["kelvin_voigt"] == pytest.approx(g(z) ** 2, rel=1e-9)
    assert got["linear_viscoelastic"] == pytest.approx(g(damping_coefficient("linear_viscoelastic", e)), rel=1e-9)
    xi = damping_coefficient("nonlinear_viscoelastic", e)
    assert got["nonlinear_viscoelastic"] == pytest.approx(g(2 * xi / np.sqrt(5)), rel=1e-7)


@pytest.mark.parametrize("e", [0.15, 0.5, 0.9])
@pytest.mark.parametrize("law", ["modified_kelvin", "hertz_damped", "hunt_crossley", "ye_hertz", "gonthier"])
def test_restitution_of_proportional_dampers_in_closed_form(law, e):
    d = damping_coefficient(law, e)
    got = two_mass_restitution(law, stiffness_of(law), e, M1, M2, V0)
    assert d * (1 + got) == pytest.approx(np.log((1 + d) / (1 - d * got)), rel=1e-6)


@pytest.mark.parametrize("e", [0.15, 0.5, 0.9])
def test_restitution_of_approach_only_proportional_damper_in_closed_form(e):
    d = damping_coefficient("modified_kelvin_voigt", e)
    got = two_mass_restitution("modified_kelvin_voigt", 2e6, e, M1, M2, V0)
    assert got**2 == pytest.approx(2 * (d - np.log1p(d)) / d**2, rel=1e-8)


def test_elastic_contacts_in_closed_form():
    k = 2.0e6
    got = two_mass_impact("linear", k, None, M1, M2, V0)
    assert got["duration"] == pytest.approx(np.pi * np.sqrt(MEFF / k), rel=1e-10)
    assert got["penetration_max"] == pytest.approx(V0 * np.sqrt(MEFF / k), rel=1e-10)
    assert got["force_max"] == pytest.approx(V0 * np.sqrt(MEFF * k), rel=1e-10)
    k = 1.88e7
    got = two_mass_impact("hertz", k, None, M1, M2, V0)
    assert got["penetration_max"] == pytest.approx((5 * MEFF * V0**2 / (4 * k)) ** 0.4, rel=1e-10)
    assert got["duration"] == pytest.approx(3.218 * (MEFF**2 / (k**2 * V0)) ** 0.2, rel=1e-4)
    assert got["duration"] == pytest.approx(2.943 * got["penetration_max"] / V0, rel=1e-4)


# -- the same collision through the full solver ------------------------------------------------------------------------


@pytest.mark.parametrize(("e", "gap"), [(0.2, 0.01), (0.6, 0.01), (0.6, 0.0)])
@pytest.mark.parametrize("law", ALL_LAWS)
def test_collision_in_a_row(law, e, gap):
    out = free_pair(law, e, gap=gap, dt=0.03)
    alone = two_mass_impact(law, stiffness_of(law), e, M1, M2, V0)
    v1, v2 = flat(out["velocity_final"])
    assert M1 * v1 + M2 * v2 == pytest.approx(M1 * V0, rel=1e-9)
    assert (v2 - v1) / V0 == pytest.approx(alone["restitution"], rel=1e-7)
    assert out["approach_speed_max"][0][0] == pytest.approx(V0, rel=1e-9)
    assert out["first_impact_time"][0][0] == pytest.approx(gap / V0, rel=1e-9)
    assert out["impact_count"][0][0] == 1
    assert out["event_count"] <= 5
    assert out["penetration_max"][0][0] == pytest.approx(alone["penetration_max"], rel=1e-8)
    assert out["impact_force_max"][0][0] == pytest.approx(alone["force_max"], rel=1e-8)
    assert out["acceleration_max"][0][0] == pytest.approx(alone["force_max"] / M1, rel=1e-8)
    assert out["impulse"][0][0] == pytest.approx(MEFF * V0 * (1 + alone["restitution"]), rel=1e-7)
    assert out["contact_work"][0][0] == pytest.approx(alone["energy_lost"], rel=1e-7, abs=1e-7)
    assert out["energy_transfer_final"].sum() == pytest.approx(out["contact_work"][0][0], abs=1e-8)


def test_stereomechanical_collision():
    out = free_pair("stereomechanical", 0.6)
    v1, v2 = flat(out["velocity_final"])
    assert v1 == pytest.approx(V0 - 1.6 * M2 / (M1 + M2) * V0, rel=1e-9)
    assert v2 == pytest.approx(1.6 * M1 / (M1 + M2) * V0, rel=1e-9)
    assert out["impulse"][0][0] == pytest.approx(1.6 * MEFF * V0, rel=1e-9)
    assert out["contact_work"][0][0] == pytest.approx(0.5 * MEFF * V0**2 * (1 - 0.36), rel=1e-9)
    assert out["energy_transfer_final"].sum() == pytest.approx(out["contact_work"][0][0], abs=1e-9)


@pytest.mark.parametrize("law", ["linear", "kelvin_voigt", "hertz_damped", "nonlinear_viscoelastic"])
def test_wall_is_an_infinite_mass(law):
    k = stiffness_of(law)
    body = NaiveBuilding([M1], [1e-7], damping_ratio=0.0)
    out = run([body, WALL], [0.01], np.zeros(9), 0.02, law, k, 0.6, initial_velocity=[[V0], None])
    alone = two_mass_impact(law, k, 0.6, M1, 1e15, V0)
    assert out["velocity_final"][0][0] == pytest.approx(-alone["restitution"] * V0, rel=1e-7)
    assert out["impact_force_max"][0][0] == pytest.approx(alone["force_max"], rel=1e-8)
    assert out["floors"] == [[(1, None)]]
    other = run([WALL, body], [0.01], np.zeros(9), 0.02, law, k, 0.6, initial_velocity=[None, [-V0]])
    assert other["velocity_final"][1][0] == pytest.approx(-out["velocity_final"][0][0], rel=1e-12)
    assert other["displacement_min"][1][0] == pytest.approx(-out["displacement_max"][0][0], rel=1e-9)


def test_resting_contact():
    """A mass pressed onto a wall from rest by a steady ground acceleration: one onset, at t = 0, with v0 = 0."""
    body, pull, seconds = NaiveBuilding([M1], [1e-7], damping_ratio=0.0), 2.0, 0.3
    ag = np.full(31, -pull)
    # Largest penetration over that at rest: elastic 2 and 2.5^(2/3), damped 1 + e.
    for law, overshoot in [("linear", 2.0), ("hertz", 2.5 ** (2 / 3)), ("kelvin_voigt", 1.3)]:
        out = run([body, WALL], [0.0], ag, 0.01, law, stiffness_of(law), 0.3)
        rest = (M1 * pull / stiffness_of(law)) ** (1 / LAWS[law].exponent)
        assert out["penetration_max"][0][0] == pytest.approx(overshoot * rest, rel=1e-8)
        assert out["first_impact_time"] == [[0.0]]
        assert out["impact_count"][0][0] == 1
        assert out["approach_speed_max"][0][0] < 1e-6
    # A law that divides by v0 takes 1 mm/s and creeps: k d (1 + D v/v0) = m a, so -x - ln(1 - x) = v0 t/(D rest).
    for law in ["modified_kelvin", "modified_kelvin_voigt"]:
        out = run([body, WALL], [0.0], ag, 0.01, law, 2.0e6, 0.5)
        rest = M1 * pull / 2.0e6
        x = out["displacement_final"][0][0] / rest
        assert -x - np.log(1 - x) == pytest.approx(1e-3 * seconds / (damping_coefficient(law, 0.5) * rest), rel=0.02)
        assert out["impact_count"][0][0] == 1


# -- linear structures -------------------------------------------------------------------------------------------------


def test_free_vibration():
    m, k, zeta, v0 = 120.0, 6.0e4, 0.05, 0.3
    w = np.sqrt(k / m)
    wd = w * np.sqrt(1 - zeta**2)
    out = run([NaiveBuilding([m], [k], zeta)], [], np.zeros(201), 0.01, "none", initial_velocity=[[v0]])
    t = np.arange(201) * 0.01
    exact = v0 / wd * np.exp(-zeta * w * t) * np.sin(wd * t)
    np.testing.assert_allclose(out["displacement"][0][:, 0], exact, atol=1e-10)
    t_top = np.arctan2(np.sqrt(1 - zeta**2), zeta) / wd
    top = v0 / wd * np.exp(-zeta * w * t_top) * np.sin(wd * t_top)
    assert out["displacement_max"][0][0] == pytest.approx(top, rel=1e-9)
    assert out["storey_shear_max"][0][0] == pytest.approx(k * top, rel=1e-9)
    lost = 0.5 * m * v0**2 - out["kinetic_final"][0] - out["strain_final"][0]
    assert out["energy_damping"][0] == pytest.approx(lost, rel=1e-8)
    assert out["energy_transfer_max"][0] == pytest.approx(0.0, abs=1e-8)


def test_row_without_contact_is_the_exact_linear_solution():
    ag = motion()
    buildings = [left_building(), shear([150.0] * 5, 4.0e5), right_building()]
    out = run(buildings, [0.0, 0.0], ag, 0.01, "none")
    apart = run(buildings, [5.0, 5.0], ag, 0.01, "linear", 2e6)
    for b, building in enumerate(buildings):
        u, v = modal_exact(building, ag, 0.01)
        np.testing.assert_allclose(out["displacement"][b], u, atol=1e-10)
        np.testing.assert_allclose(out["velocity"][b], v, atol=1e-8)
        np.testing.assert_allclose(apart["displacement"][b], u, atol=1e-10)
        # Peaks: at least the samples, and those of a hundred times finer exact samples.
        fine = np.interp(np.arange(100 * (len(ag) - 1) + 1) * 1e-4, np.arange(len(ag)) * 0.01, ag)
        u, v = modal_exact(building, fine, 1e-4)
        m, c, k = building.matrices()
        total = -(u @ k.T + v @ c.T) / np.diag(m)
        drift = np.diff(u, axis=1, prepend=0.0)
        for got, want in [
            (out["displacement_max"][b], u.max(axis=0)),
            (-out["displacement_min"][b], -u.min(axis=0)),
            (out["drift_max"][b], np.abs(drift).max(axis=0)),
            (out["acceleration_max"][b], np.abs(total).max(axis=0)),
        ]:
            np.testing.assert_allclose(got, want, rtol=1e-5)
            assert np.all(got >= want * (1 - 1e-9))
        np.testing.assert_allclose(
            out["storey_shear_max"][b], np.diag(np.diag(building.stiffnesses)) * out["drift_max"][b]
        )
    np.testing.assert_allclose(out["energy_transfer_max"], 0.0, atol=1e-7)
    np.testing.assert_allclose(out["energy_transfer_min"], 0.0, atol=1e-7)
    assert out["event_count"] == 0
    assert flat(apart["impact_count"]).sum() == 0
    assert apart["first_impact_time"] == [[None] * 3, [None] * 3]


# -- rows that pound ---------------------------------------------------------------------------------------------------


def test_linear_contact_against_matrix_exponentials():
    """Two one-storey buildings, undamped contact: piecewise linear, so exact between located switches."""
    m, k, gap, kc, dt = np.array([100.0, 160.0]), np.array([4.0e4, 2.0e4]), 0.004, 5.0e5, 0.02
    c = 2 * 0.05 * np.sqrt(k * m)
    ag = motion(2.0, dt, strength=0.6, seed=8)
    b = np.array([1.0, -1.0])

    def generator(closed):
        a = np.zeros((7, 7))  # u1 u2 v1 v2 | 1, ag, slope
        a[:2, 2:4] = np.eye(2)
        stiffness = np.diag(k) + closed * kc * np.outer(b, b)
        a[2:4, :2] = -stiffness / m[:, None]
        a[2:4, 2:4] = -np.diag(c / m)
        a[2:4, 4] = closed * kc * gap * b / m
        a[2:4, 5] = -1.0
        a[5, 6] = 1.0
        return a

    generators = [generator(0), generator(1)]
    x, closed, onsets, largest, impulse_free = np.zeros(4), 0, [], 0.0, []
    for i in range(len(ag) - 1):
        tau, z = 0.0, np.concatenate([x, [1.0, ag[i], (ag[i + 1] - ag[i]) / dt]])
        grid = np.linspace(0.0, dt, 161)
        while True:
            ahead = [expm(generators[closed] * (g - tau)) @ z for g in grid if g > tau]
            d = np.array([b @ s[:2] - gap for s in ahead])
            if closed:
                largest = max(largest, d.max())
            wrong = np.flatnonzero(d < 0) if closed else np.flatnonzero(d > 0)
            if wrong.size == 0:
                x = ahead[-1][:4]
                break
            times = grid[grid > tau]
            j = wrong[0]
            low = times[j - 1] if j else tau + 1e-9
            root = brentq(
                lambda g, t=tau, s=z, n=closed: b @ (expm(generators[n] * (g - t)) @ s)[:2] - gap,
                low,
                times[j],
                xtol=1e-16,
            )
            z = expm(generators[closed] * (root - tau)) @ z
            tau, closed = root, 1 - closed
            if closed:
                onsets.append(i * dt + tau)
        impulse_free.append(x)
    buildings = [NaiveBuilding([m[i]], [k[i]], 0.05) for i in range(2)]
    out = run(buildings, [gap], ag, dt, "linear", kc)
    assert len(onsets) >= 3
    assert out["impact_count"][0][0] == len(onsets)
    assert out["first_impact_time"][0][0] == pytest.approx(onsets[0], rel=1e-9)
    np.testing.assert_allclose(np.hstack(out["displacement"])[1:], np.array(impulse_free)[:, :2], atol=2e-9)
    assert out["penetration_max"][0][0] == pytest.approx(largest, rel=2e-3)
    assert out["impact_force_max"][0][0] == pytest.approx(kc * out["penetration_max"][0][0], rel=1e-12)


def three(law, e, ag, **options):
    row = [left_building(), middle_building(), right_building()]
    return run(row, [0.006, 0.008], ag, 0.01, law, stiffness_of(law), e, **options)


@pytest.mark.parametrize("law", ["linear", "kelvin_voigt", "hertz_damped", "nonlinear_viscoelastic"])
def test_converged_in_the_tolerance(law):
    ag = motion(0.9, strength=2.0)
    out, finer = three(law, 0.6, ag), three(law, 0.6, ag, rtol=1e-12, atol=1e-14)
    assert flat(out["impact_count"]).sum() > 3
    np.testing.assert_array_equal(flat(out["impact_count"]), flat(finer["impact_count"]))
    for name in ["displacement_max", "drift_max", "acceleration_max", "impact_force_max", "penetration_max", "impulse"]:
        np.testing.assert_allclose(flat(out[name]), flat(finer[name]), rtol=1e-6, atol=1e-8 * flat(finer[name]).max())


# -- storeys that yield ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hardening", [0.0, 0.1, 0.5])
def test_a_storey_that_yields_moves_as_energy_says(hardening):
    """Undamped, pushed once: it stops where its work is the kinetic energy, and unloads from there."""
    m, k, strength, v0, dt = 100.0, 4.0e4, 300.0, 0.5, 0.01
    building = NaiveBuilding([m], [k], 0.0, yield_strengths=[strength], hardening=hardening)
    limit = strength / k
    # m v0^2 / 2 = Vy dy / 2 + Vy (d - dy) + r k (d - dy)^2 / 2
    left = 0.5 * m * v0**2 - 0.5 * strength * limit
    beyond = brentq(lambda x: strength * x + 0.5 * hardening * k * x**2 - left, 0.0, 1.0)
    until = np.pi / np.sqrt(k / m) + beyond / (0.3 * v0)  # past the turn, not back at yield
    points = int(until / dt)
    one = run([building], [], np.zeros(points), dt, "none", initial_velocity=[[v0]])
    assert one["drift_max"][0][0] == pytest.approx(limit + beyond, rel=1e-10)
    assert one["ductility_max"][0][0] == pytest.approx(1.0 + beyond / limit, rel=1e-10)
    assert one["storey_shear_max"][0][0] == pytest.approx(strength + hardening * k * beyond, rel=1e-10)
    long = run([building], [], np.zeros(600), dt, "none", initial_velocity=[[v0]])
    for found in (one, long):
        balance = found["kinetic_initial"] - found["kinetic_final"] - found["strain_final"] - found["energy_hysteretic"]
        assert balance == pytest.approx(0.0, abs=1e-9)
    assert long["energy_hysteretic"][0] >= (1.0 - hardening) * strength * beyond * (1.0 - 1e-10)
    if hardening == 0.0:  # it swings on about where it unloads to, elastically
        assert long["energy_hysteretic"][0] == pytest.approx(strength * beyond, rel=1e-10)
        assert long["residual_drift"][0][0] == pytest.approx(beyond, rel=1e-10)
        middle = 0.5 * (long["displacement"][0][300:].max() + long["displacement"][0][300:].min())
        assert middle == pytest.approx(beyond, abs=2e-3 * limit)


def test_a_loop_of_yielding_is_that_of_springs_in_parallel():
    """Bilinear: an elastic spring beside a perfectly plastic one, here as a slider that an ODE of its own drags."""
    m, k, strength, r, dt = 80.0, 3.0e4, 150.0, 0.2, 0.02
    ag = 4.0 * np.sin(np.arange(200) * dt * 9.0)
    one = run([NaiveBuilding([m], [k], 0.05, yield_strengths=[strength], hardening=r)], [], ag, dt, "none")
    c = 2.0 * 0.05 * np.sqrt(k * m)
    u = v = z = 0.0
    h, limit, found = dt / 2000, strength / k, []
    for a0, a1 in pairwise(ag):
        for i in range(2000):  # semi-implicit Euler, the slider by return mapping
            g = a0 + (a1 - a0) * (i + 1) / 2000
            v += h * (-g - (c * v + r * k * u + (1.0 - r) * k * z) / m)
            u += h * v
            z = min(max(z + h * v, -limit), limit)
        found.append(u)
    assert one["ductility_max"][0][0] > 2.0
    assert one["event_count"] > 10
    assert np.abs(one["displacement"][0][1:, 0] - found).max() < 1e-3 * np.abs(found).max()
