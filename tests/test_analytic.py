"""Runs whose answer is known in closed form, and laws of mechanics that every run must obey."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kernels_used import LAW_OF, SIMULATED
from kinds import FIVE
from reference import NOMINAL, REALISED, ShearBuilding, modal_exact
from scipy.integrate import cumulative_simpson
from scipy.special import gamma
from test_simulate import PAIR, A, B, shake, shaking, with_gap

import pounding_sweep as ps
from pounding_sweep.model.laws import LAWS
from pounding_sweep.request.spec import METHODS
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.variables.registry import Status

pytestmark = pytest.mark.usefixtures("pair_kernels")

CONTACT_LAWS = [key for key, law in LAWS.items() if law.has_contact]


def quiet(seconds, dt=0.01):
    return ps.Record("quiet", dt, np.zeros(round(seconds / dt) + 1))


def near(got, want, relative):
    want = np.asarray(want)
    np.testing.assert_allclose(got, want, rtol=0, atol=relative * np.abs(want).max())


@pytest.mark.parametrize("method", METHODS)
def test_multi_storey_buildings_follow_their_exact_solution(method):
    record = shaking(3.0)
    start = [[0.1, -0.2], [0.0, 0.3]]
    got = shake(
        LAW_OF[method], ps.Scene([A, B], gaps=[1.0]), record, method=method, dt=record.dt / 40, initial_velocity=start
    ).isel(time=slice(None, None, 40))
    for b, v0 in zip((A, B), start, strict=True):
        twin = ShearBuilding(list(b.masses), list(b.stiffnesses), b.damping_ratio)
        u, v = modal_exact(twin, record.acceleration, record.dt, velocity=v0)
        tolerance = 5e-7 if method == "rk4" else 2e-3
        near(got.displacement.sel(building=b.name), u, tolerance)
        near(got.velocity.sel(building=b.name), v, tolerance)


# Storeys so soft that each floor is a free mass: the roofs and the floors below them are two pairs of their own.
LEFT_MASSES, RIGHT_MASSES = np.array([60.0, 150.0]), np.array([90.0, 210.0])
FREE = ps.Scene(
    [
        ps.Building("a", LEFT_MASSES, [1e-10, 1e-10], damping_ratio=0.0),
        ps.Building("b", RIGHT_MASSES, [1e-10, 1e-10], damping_ratio=0.0),
    ],
    gaps=[0.004],
)
SPEEDS = [[0.1, 0.4], [-0.05, 0.1]]
CLOSING = np.array([0.15, 0.3])


@pytest.mark.slow
@pytest.mark.parametrize("law", ["linear", "kelvin_voigt"])
def test_two_that_touch_in_a_long_row_move_as_they_do_alone(law):
    contact = {"law": law, "stiffness": 8e5, "restitution": 0.6 if law != "linear" else None}
    five = ps.simulate(FIVE, shaking(), **contact)
    alone = ps.simulate(replace(FIVE, row=FIVE.row[1:3], gaps=FIVE.gaps[1:2]), shaking(), **contact)
    mine = five.sel(building=alone.building, pair=alone.pair)
    assert int(five.impact_count.sum()) == int(alone.impact_count.sum()) > 20
    for name in ("displacement", "acceleration_max", "impact_force_max", "energy_kinetic"):
        near(mine[name].fillna(0.0), alone[name].fillna(0.0), 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_a_row_that_never_touches_is_the_row_without_contact_to_the_last_bit(method):
    record = shaking()
    wide = ps.Scene([A, B], gaps=[1.0])
    free = ps.simulate(wide, record, law="none", method=method)
    assert float(free.displacement_max.max()) > 0.005
    for law in ("linear", "kelvin_voigt"):
        stiffness, e = 8e5, 0.6 if LAWS[law].takes_restitution else None
        open_row = ps.simulate(wide, record, law=law, stiffness=stiffness, restitution=e, method=method)
        assert not open_row.impact_count.values.any()
        assert np.isnan(open_row.first_impact_time.values).all()
        assert np.isnan(float(open_row.steps_per_contact))
        for name in free.data_vars:
            if name != "steps_per_contact":
                np.testing.assert_array_equal(open_row[name], free[name], err_msg=name)


def collide(law, e, method="rk4", seconds=0.5, basis="published"):
    dt = 2.5e-4 if method == "rk4" else 1e-4
    k = 2.0e6 if LAWS[law].exponent == 1.0 else 1.88e7
    e = e if LAWS[law].takes_restitution else None
    return ps.simulate(
        FREE,
        quiet(seconds),
        law=law,
        stiffness=k,
        restitution=e,
        method=method,
        dt=dt,
        initial_velocity=SPEEDS,
        restitution_basis=basis,
    )


@pytest.mark.parametrize("law", list(REALISED))
@pytest.mark.parametrize("method", METHODS)
def test_two_free_masses_rebound_as_they_should(method, law):
    for e in (0.2, 0.5, 0.8):
        realised = REALISED[law][NOMINAL.index(e)]
        got = collide(law, e, method)
        assert int(got.status) == Status.OK
        assert got.impact_count.values.tolist() == [[1, 1]]
        apart = got.velocity[-1].sel(building="b").values - got.velocity[-1].sel(building="a").values
        np.testing.assert_allclose(apart / CLOSING, realised, rtol=0, atol=2e-3)
        np.testing.assert_allclose(got.first_impact_time[0], 0.004 / CLOSING, rtol=1e-9)
        np.testing.assert_allclose(got.approach_speed_max[0], CLOSING, rtol=1e-9)
        # work of both contacts: what the rebound lost
        reduced = LEFT_MASSES * RIGHT_MASSES / (LEFT_MASSES + RIGHT_MASSES)
        lost = np.sum(0.5 * reduced * (CLOSING**2 - apart**2))
        assert float(got.contact_work[0]) == pytest.approx(lost, rel=1e-4 if method == "rk4" else 3e-3)
        # the harder the damper, the more is lost: never more than there was
        assert 0 < lost < np.sum(0.5 * reduced * CLOSING**2)


@pytest.mark.parametrize("law", list(REALISED))
@pytest.mark.parametrize("method", METHODS)
def test_two_free_masses_rebound_at_the_realised_restitution(method, law):
    end = collide(law, 0.6, method, basis="realised").velocity[-1]
    apart = end.sel(building="b").values - end.sel(building="a").values
    np.testing.assert_allclose(apart / CLOSING, 0.6, rtol=0, atol=1e-5 if SCHEMES[method].order == 4 else 2e-3)


@pytest.mark.parametrize("law", CONTACT_LAWS)
@pytest.mark.parametrize("method", METHODS)
def test_momentum_is_kept_and_is_the_impulse(law, method):
    got = collide(law, 0.5, method)
    before = LEFT_MASSES * SPEEDS[0] + RIGHT_MASSES * SPEEDS[1]
    momentum = got.velocity.sel(building="a") * LEFT_MASSES + got.velocity.sel(building="b") * RIGHT_MASSES
    np.testing.assert_allclose(momentum, np.broadcast_to(before, momentum.shape), rtol=1e-9)
    given = LEFT_MASSES * (SPEEDS[0] - got.velocity[-1].sel(building="a").values)
    np.testing.assert_allclose(got.impulse[0], given, rtol=1e-6 if method == "rk4" else 1e-3)


@pytest.mark.parametrize("law", ["linear", "kelvin_voigt", "hertz", "hertz_damped"])
@pytest.mark.parametrize("method", METHODS)
def test_elastic_masses_meet_and_part_as_in_a_textbook(law, method):
    """Undamped laws, and damped ones at a restitution of 1."""
    got = collide(law, 1.0, method)
    m1, m2 = LEFT_MASSES, RIGHT_MASSES
    v1, v2 = np.array(SPEEDS[0]), np.array(SPEEDS[1])
    after = ((m1 - m2) * v1 + 2 * m2 * v2) / (m1 + m2)
    tolerance = 1e-6 if method == "rk4" else 1e-3
    np.testing.assert_allclose(got.velocity[-1].sel(building="a"), after, rtol=0, atol=tolerance)
    reduced = m1 * m2 / (m1 + m2)
    if LAWS[law].exponent == 1.0:
        depth = CLOSING * np.sqrt(reduced / 2.0e6)
        lasts = np.pi * np.sqrt(reduced / 2.0e6)
        force = 2.0e6 * depth
    else:
        depth = (5 * reduced * CLOSING**2 / (4 * 1.88e7)) ** 0.4
        force = 1.88e7 * depth**1.5
        lasts = 2.0 * np.sqrt(np.pi) * gamma(1.4) / gamma(0.9) * depth / CLOSING
    np.testing.assert_allclose(got.penetration_max[0], depth, rtol=tolerance * 10)
    np.testing.assert_allclose(got.impact_force_max[0], force, rtol=tolerance * 10)
    np.testing.assert_allclose(got.contact_time[0], lasts, rtol=tolerance)
    lost = np.sum(0.5 * reduced * CLOSING**2)
    assert abs(float(got.contact_work[0])) < 10 * tolerance * lost


@pytest.mark.parametrize("method", METHODS)
def test_the_first_impact_knows_no_law(method):
    first = {law: shake(law, method=method).first_impact_time.values for law in SIMULATED[method]}
    earliest = np.nanmin(first[LAW_OF[method]])
    assert 0 < earliest < 2.0
    near(np.array([np.nanmin(times) for times in first.values()]), earliest, 1e-9)  # roots of other polynomials


@pytest.mark.parametrize("method", ["exact", "rk4", "newmark"])
def test_floors_that_are_pressed_from_the_start_touch_at_once(method):
    def first(gap, push):
        record = ps.Record("push", 0.02, np.full(51, push))
        return shake(LAW_OF[method], with_gap(gap), record, method=method).first_impact_time.values.ravel()

    assert first(0.0, 3.0)[1] == 0.0
    assert (first(1e-9, -3.0) > 1e-3).all()  # a gap that the motion needs a while for
    if method == "exact":  # those that part by a picometre first, as `reference` has them
        np.testing.assert_allclose(first(0.0, -3.0), [7.14390069670e-4, 2.457371718e-2], rtol=1e-8)


@pytest.mark.parametrize(("beta", "gamma", "order"), [(1 / 6, 0.5, 1.8), (0.25, 0.5, 1.8), (0.3025, 0.6, 0.9)])
def test_parameters_of_newmark(beta, gamma, order):
    """gamma = 1/2 is second order, more of it damps and is first order; all reach the exact answer."""
    record = shaking(1.0)
    exact = modal_exact(ShearBuilding(list(A.masses), list(A.stiffnesses)), record.acceleration, record.dt)[0]
    steps, left = [20, 40, 80], []
    for n in steps:
        far = ps.Scene([A, B], gaps=[1.0])
        got = shake("hertz_damped", far, record, method="newmark", dt=record.dt / n, beta=beta, gamma=gamma)
        left.append(np.abs(got.displacement.sel(building="a").values[::n] - exact).max())
    found = -np.polyfit(np.log(steps), np.log(left), 1)[0]
    assert order <= found < order + 0.5, left


@pytest.mark.parametrize("law", CONTACT_LAWS)
@pytest.mark.parametrize("method", METHODS)
def test_energy_balance(method, law):
    got = shake(law, method=method, dt=5e-4)
    assert int(got.impact_count.sum()) >= 2
    assert float(got.energy_residual) < (1e-6 if method == "rk4" else 4e-4)
    # at every instant: what buildings gave away is what the contacts took, or hold
    size = float(got.input.max())
    gap = np.abs(got.transfer.sum("building") - got.work.sum("pair")).values
    assert gap.max() < (2e-6 if method == "rk4" else 1e-3) * size
    # the peaks over time are those of the history, or between its steps
    for b in ("a", "b"):
        here, top = got.transfer.sel(building=b), got.energy_transfer_max.sel(building=b)
        low = got.energy_transfer_min.sel(building=b)
        drift = (1e-6 if method == "rk4" else 1e-3) * size  # in flight, where nothing is exchanged
        assert float(top) >= float(here.max()) - drift
        assert float(low) <= float(here.min()) + drift
        reach = float(top - low)
        assert float(top) - float(here.max()) < 0.02 * reach
        assert float(here.min()) - float(low) < 0.02 * reach
    taken = float(got.contact_work.sum())
    assert taken > 0.01 * reach if LAWS[law].takes_restitution else abs(taken) < 1e-3 * reach


def test_histories_obey_the_equation_of_motion():
    """Independent of the kernel's own sums: forces, input and damping from u, v and F of the history."""
    record = shaking()
    got = shake("hertz_damped", record=record, method="rk4", dt=2.5e-4)
    masses = np.array([A.masses, B.masses])
    ag = got.ground_acceleration.values
    np.testing.assert_allclose(ag, np.interp(got.time, record.time, record.acceleration), atol=1e-12)
    for i, (b, sign) in enumerate(((A, -1.0), (B, 1.0))):
        alpha, beta = b.rayleigh
        stiff = b.system_matrix
        damping = alpha * np.diag(b.masses) + beta * stiff
        u, v = got.displacement[:, i].values, got.velocity[:, i].values
        force = sign * got.contact_force[:, 0].values
        want = (force - u @ stiff - v @ damping) / masses[i]
        near(got.acceleration[:, i], want, 1e-12)
        t = got.time.values
        near(cumulative_simpson(-ag * (v @ masses[i]), x=t, initial=0.0), got.input[:, i].values, 1e-4)
        near(
            cumulative_simpson(np.einsum("ti,ij,tj->t", v, damping, v), x=t, initial=0.0),
            got.damping[:, i].values,
            1e-4,
        )
        near(0.5 * v**2 @ masses[i], got.kinetic[:, i].values, 1e-12)
        near(0.5 * np.einsum("ti,ij,tj->t", u, stiff, u), got.strain[:, i].values, 1e-12)
    d = got.displacement[:, 0] - got.displacement[:, 1] - 0.006
    near(np.maximum(d.values, 0.0), got.penetration[:, 0].values, 1e-12)
    assert np.all(got.contact_force.values[got.penetration.values == 0] == 0)


ROOTS = ("gonthier", "hertz", "hertz_damped", "hunt_crossley", "nonlinear_viscoelastic")
AT_WALL = ps.Scene([ps.Building("a", [70.0], [1.9e5], 0.1), ps.Wall()], gaps=[0.002])
TIED = replace(PAIR, links=[ps.Link("a-b", [1], stiffness=3e4, damping=500.0)])
SMOOTH, FOUNDED = (
    ps.Scene([ps.Building("a", [70.0, 60.0], [1.9e5, 1.5e5], **kind), ps.Building("b", [40.0], [5e4])], gaps=[0.0005])
    for kind in (
        {"yield_strengths": [200.0, 150.0], "hardening": 0.05, "hysteresis": {"law": "bouc_wen", "n": 2.0}},
        {"foundation": ps.Foundation(60.0, 400.0, 6e5, 9e6, sway_damping=2e3, rocking_damping=2e4)},
    )
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "scene", "e", "method", "allowed"),
    [
        *((law, scene, e, "exact", {1e-2: 2e-4, 2e-3: 2e-6, 5e-4: 1e-6})
          for law in ROOTS for scene in (PAIR, AT_WALL) for e in (0.2, 0.6)),
        *((law, TIED, 0.6, "exact", {1e-2: 1e-5, 2e-3: 1e-8, 5e-4: 2e-10}) for law in ROOTS),
        ("hertz", SMOOTH, 0.6, "rk4", {2e-3: 5e-6, 1e-3: 1e-7}),
        ("gonthier", FOUNDED, 0.6, "rk4", {2e-3: 2e-5, 1e-3: 2e-6}),
    ],
)  # fmt: skip
def test_accelerations_beside_contacts_whose_forces_are_roots(law, scene, e, method, allowed):
    """A cubic through accelerations and rates misses peaks by 1e-4 and more, and has turns that no motion has.

    Rates are huge at the touch where a damper goes with the root of the penetration.
    """
    fine = shake(law, scene, e=e, method="rk4", dt=1e-4).acceleration_max.fillna(0.0).values
    for dt, most in allowed.items():
        near(shake(law, scene, e=e, method=method, dt=dt).acceleration_max.fillna(0.0).values, fine, most)


@pytest.mark.slow
@pytest.mark.parametrize("law", ["gonthier", "hertz_damped", "hunt_crossley"])
@pytest.mark.parametrize("seed", [3, 4])
def test_transferred_energies_that_are_small_beside_the_input(seed, law):
    """Of a storey that turns while it presses a wall: a hundredth of what the ground puts in, and in mid-step."""
    m, k, gap, e = (70.0, 1.9e5, 0.002, 0.3) if law == "gonthier" else (1100.0, 2.5e6, 0.0003, 0.9)
    scene, record = ps.Scene([ps.Building("a", [m], [k], 0.1), ps.Wall()], gaps=[gap]), shaking(seed=seed)
    fine, got, plain = (
        float(shake(law, scene, record, e=e, method=method, dt=dt).energy_transfer_max.max())
        for method, dt in (("rk4", 1e-4), ("exact", 1e-2), ("rk4", 1e-3))
    )
    assert got == pytest.approx(fine, rel=2e-4)
    assert plain == pytest.approx(fine, rel=2e-5)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("law", ["linear", "kelvin_voigt", "hertz"])
def test_gap_and_motion_scaled_together_scale_the_answer(law, method):
    factor, record = 2.7, shaking()
    k = 8e5 if law != "hertz" else 7.5e6
    one = shake(law, record=record, k=k, method=method)
    # a force that grows like d^1.5 stays similar with a stiffness that falls like d^-0.5
    larger_k = k if law != "hertz" else k / np.sqrt(factor)
    other = shake(law, ps.Scene([A, B], gaps=[factor * 0.006]), record.scaled(factor), k=larger_k, method=method)
    assert int(one.impact_count.sum()) >= 2
    np.testing.assert_array_equal(one.impact_count, other.impact_count)
    np.testing.assert_allclose(other.first_impact_time, one.first_impact_time, rtol=1e-9)
    for power, names in (
        (1, ("displacement_max", "displacement_min", "drift_max", "storey_shear_max", "acceleration_max")),
        (1, ("impact_force_max", "penetration_max", "impulse", "approach_speed_max", "displacement", "velocity")),
        (2, ("energy_input", "energy_damping", "energy_kinetic", "energy_strain", "energy_transfer_max")),
    ):
        for name in names:
            want = one[name].fillna(0.0).values * factor**power
            near(other[name].fillna(0.0).values, want, 1e-9)
