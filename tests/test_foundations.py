"""Buildings on foundations that sway and rock: against exact answers and the reference, and what sweeps do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from against_reference import buildings_of, motion, truth
from hypothesis import given
from hypothesis import strategies as st
from kernels_used import FOUNDED
from kinds import BOTH
from scenes import pair
from scipy.linalg import block_diag, eig, eigh
from test_links import exact, radius

import pounding_sweep as ps
from pounding_sweep.engine.postprocess import displacement_limit, energy_limit
from pounding_sweep.model.laws import LAWS
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.request.spec import overview
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.schemes.stability import largest_step

A, B = FOUNDED.buildings
SOFT = A.foundation
OUTPUTS = ("foundation_sway_max", "foundation_rotation_max")


def classical(building):
    """M, C, K of a building in its own displacements, the sway and the rotation of its base, masses coupled."""
    n, h, base = building.n_storeys, building.elevations, building.foundation
    m, c, k = buildings_of(ps.Scene([replace(building, foundation=None)]))[0].matrices()
    moved = np.column_stack([np.eye(n), np.ones(n), h])  # floors by (w, u, theta)
    mass = moved.T @ m @ moved + block_diag(np.zeros((n, n)), base.mass, base.inertia)
    return (
        mass,
        block_diag(c, base.sway_damping, base.rocking_damping),
        block_diag(k, base.sway_stiffness, base.rocking_stiffness),
    )


#: What the ground's acceleration pushes: the base.
OF_THE_BASE = (0.0, 0.0, 1.0, 0.0)


def of_floors(states, building=A):
    """Displacements of a building's two floors, shape (times, 2), by the states of `classical`."""
    return states[:2].T + states[2, :, None] + np.outer(states[3], building.elevations)


def periods(building):
    mass, _, stiff = classical(building)
    return 2.0 * np.pi / np.sqrt(eigh(stiff, mass, eigvals_only=True))


def test_modes_are_those_of_the_coupled_equations():
    for building in (A, *BOTH.buildings):
        np.testing.assert_allclose(building.periods, periods(building), rtol=1e-12)
        w, shapes = building.modes
        mass, damping, stiff = classical(building)
        own = np.eye(building.n_storeys + 2)  # (w, u, theta) of floors' displacements, sway and rotation
        own[: building.n_storeys, -2:] = np.column_stack([-np.ones(building.n_storeys), -building.elevations])
        there = own @ shapes
        np.testing.assert_allclose(there.T @ mass @ there, np.eye(len(w)), atol=1e-10)
        np.testing.assert_allclose(there.T @ stiff @ there, np.diag(w**2), rtol=1e-9, atol=1e-9 * w[-1] ** 2)
        decay = np.diag(there.T @ damping @ there)
        single = ps.Scene([building])
        given = Variants(single, np.array([[1.4]]), np.array([[0.7]]), np.array([np.nan]))
        ((frequencies, decays),) = given.systems
        np.testing.assert_allclose(frequencies[0], w / 1.4, rtol=1e-9)
        np.testing.assert_allclose(decays[0], decay / 1.4, rtol=1e-8)
        np.testing.assert_allclose(given.modal_damping(0)[0], decay / (2.0 * w), rtol=1e-9)


@given(
    st.floats(0.02, 5.0), st.floats(0.02, 5.0), st.floats(1.0, 20.0), st.floats(0.0, 0.2), st.floats(0.0, 0.1),
    st.floats(0.0, 0.1),
)  # fmt: skip
def test_periods_lengthen_as_by_veletsos(sway, rocking, height, ratio, soil_sway, soil_rocking):
    """A massless base: T~/T = sqrt(1 + k/K_h + k h^2/K_theta), each element's damping by its share of the strain."""
    m, k = 100.0, 1e5
    w = np.sqrt(k / m)
    k_sway, k_rock = k / sway, k * height**2 / rocking
    base = ps.Foundation(1e-7, 1e-7, k_sway, k_rock, 2.0 * soil_sway * k_sway / w, 2.0 * soil_rocking * k_rock / w)
    building = ps.Building("a", [m], [k], ratio, [height], foundation=base)
    longer = np.sqrt(1.0 + sway + rocking)
    assert building.periods[0] == pytest.approx(longer * building.on_fixed_base.periods[0], rel=1e-6)
    want = (ratio + soil_sway * sway + soil_rocking * rocking) / longer**3
    assert variants_of(ps.Scene([building])).modal_damping(0)[0, 0] == pytest.approx(want, rel=1e-5, abs=1e-12)


def test_a_rigid_building_on_springs_by_hand():
    """Two modes of a rigid body: (K_h - w^2 M)(K_theta - w^2 J) = w^4 S^2, of mass, first and second moments."""
    base = ps.Foundation(50.0, 300.0, 2e5, 5e6)
    rigid = ps.Building("a", [100.0, 80.0], [1e12, 1e12], 0.0, foundation=base)
    m, s, j = 230.0, 100.0 * 3.0 + 80.0 * 6.0, 300.0 + 100.0 * 9.0 + 80.0 * 36.0
    w2 = np.roots([m * j - s * s, -(m * 5e6 + j * 2e5), 2e5 * 5e6])
    np.testing.assert_allclose(rigid.frequencies[:2] ** 2, np.sort(w2), rtol=1e-5)


def test_stiff_springs_fix_the_base():
    firm = replace(A, foundation=replace(SOFT, sway_stiffness=1e13, rocking_stiffness=1e15))
    np.testing.assert_allclose(firm.periods[:2], A.on_fixed_base.periods, rtol=1e-6)
    assert A.on_fixed_base == pair().buildings[0]
    assert A.rayleigh == firm.rayleigh == pair().buildings[0].rayleigh
    assert B.on_fixed_base is B


def test_the_twin_is_exact_without_pounding():
    """The reference against the exponential of the state in other coordinates, in which masses are coupled."""
    want = of_floors(exact(*classical(A), motion(51, 1.5), OF_THE_BASE).T)
    found = truth(FOUNDED, "none", 51, 1.5)["displacement"][0]
    assert np.abs(found - want).max() < 1e-9 * np.abs(want).max()


@pytest.mark.parametrize("strength", [None, [1e6, 1e6]])
def test_a_base_that_hardly_holds_is_no_diverged_run(strength):
    """What energy allows floors to move is more on soft springs, and more with the mass of the base."""
    base = replace(SOFT, mass=700.0, sway_stiffness=2.5e2, rocking_stiffness=6e3, sway_damping=0.0, rocking_damping=0.0)
    soft = replace(FOUNDED, row=[replace(A, foundation=base, yield_strengths=strength), B], gaps=[1.0])
    limits = []
    for scene in (soft, replace(soft, row=[soft.buildings[0].on_fixed_base, B])):
        energy = energy_limit(scene, motion(151, 3.0), np.ones(1))
        limits.append(displacement_limit(scene, energy)[0])
    elastic = classical(replace(soft.buildings[0], yield_strengths=None))
    moved = np.abs(of_floors(exact(*elastic, motion(151, 3.0), OF_THE_BASE).T)).max(axis=0)
    assert (moved < limits[0][:2]).all()
    assert moved[0] > limits[1][0]
    np.testing.assert_array_equal(limits[0][2:] >= limits[1][2:], True)  # of more energy in the row


@given(
    st.floats(1e-3, 1e3), st.floats(1e-3, 1e3), st.floats(3.0, 9.0), st.floats(3.0, 9.0), st.floats(0.0, 6.0),
    st.floats(0.0, 6.0), st.sampled_from(["rk4", "central_difference"]),
)  # fmt: skip
def test_steps_at_the_limit_do_not_grow(mass, inertia, sway, rocking, sway_damping, rocking_damping, method):
    base = ps.Foundation(mass, inertia, 10**sway, 10**rocking, 10**sway_damping, 10**rocking_damping)
    building = replace(A, foundation=base, dashpots=[200.0, 0.0])
    limit = float(largest_step(ps.Scene([building]), LAWS["none"], np.zeros(1), np.ones(1), method=method)[0])
    assert radius(method, limit, *(buildings_of(ps.Scene([building]))[0].on_base()[:3])) < 1.0 + 1e-9
    m, _, k = buildings_of(ps.Scene([building]))[0].on_base()[:3]
    assert limit <= 2.0 * np.sqrt(2.0) / np.sqrt(eig(k, m)[0].real.max()) * (1.0 + 1e-9)


def test_the_limit_with_contacts_closed():
    """All contacts closed: the row with the springs of its contacts is stable at the limit too."""
    limit = float(largest_step(FOUNDED, LAWS["linear"], np.full(1, 8e5), np.ones(1), method="central_difference")[0])
    (m1, c1, k1), (m2, c2, k2) = (
        each[:3] for each in (buildings_of(FOUNDED)[0].on_base(), buildings_of(FOUNDED)[1].matrices())
    )
    m, c, k = (block_diag(*each) for each in ((m1, m2), (c1, c2), (k1, k2)))
    for i, j in ((0, 4), (1, 5)):
        across = np.eye(6)[i] - np.eye(6)[j]
        k = k + 8e5 * np.outer(across, across)
    assert radius("central_difference", limit, m, c, k) < 1.0 + 1e-9
    assert np.isinf(largest_step(FOUNDED, LAWS["linear"], np.full(1, 8e5), np.ones(1), method="newmark")[0])


def test_what_is_told_of_the_row_is_of_the_whole():
    told = dict(overview(FOUNDED))["a"]
    long, short = (", ".join(f"{t:.3g}" for t in each.periods[:2]) for each in (A, pair().buildings[0]))
    assert f"periods {long} s" in told
    assert f"on a foundation (on a fixed base {short} s)" in told
    plan = ps.Sweep(FOUNDED, motion(51), "kelvin_voigt", accuracy=1e-3).plan()
    assert SCHEMES[plan.numerics.method].refuses(FOUNDED) is None


def test_rules_of_gaps_take_periods_and_damping_of_the_whole(stub_engine):
    del stub_engine
    from pounding_sweep.analysis.rebuild import OUTPUTS as CLOSING
    from pounding_sweep.analysis.rebuild import uncoupled_runs

    ratios = (0.02, 0.08)
    settings = {"method": "rk4", "dt": 2e-3, "outputs": [*CLOSING]}
    _, runs = uncoupled_runs(ps.Sweep(FOUNDED, motion(51), "none", damping_ratios=ratios, **settings).run(), [], None)
    assert runs["fundamental_period"].sel(building="a") == pytest.approx(periods(A)[0])
    for ratio in ratios:
        found = runs["first_damping_ratio"].sel(damping_ratio=ratio)
        damped = variants_of(ps.Scene([replace(A, damping_ratio=ratio)]))
        assert float(found.sel(building="a")) == pytest.approx(damped.modal_damping(0)[0, 0])
        assert float(found.sel(building="b")) == pytest.approx(ratio)
    assert uncoupled_runs(FOUNDED, motion(51), None)[1].attrs["method"] == "exact"
