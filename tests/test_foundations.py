"""Foundations, dashpots of storeys and links: against exact answers, and what sweeps do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from against_reference import buildings_of, motion
from hypothesis import given
from hypothesis import strategies as st
from kernels_used import FOUNDED, LINKED
from kinds import BOTH, TOWER_ABOVE
from scenes import pair
from scipy.linalg import block_diag, eig, eigh, expm

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


LEFT, RIGHT = pair().buildings


def matrices(scene):
    """M, C, K of a whole row, its links included, from the buildings of the reference."""
    parts = zip(*(each.matrices() for each in buildings_of(scene)), strict=True)
    m, c, k = (block_diag(*part) for part in parts)
    for link in scene.linked_floors:
        across = np.eye(len(m))[link.left] - np.eye(len(m))[link.right]
        c += link.damping * np.outer(across, across)
        k += link.stiffness * np.outer(across, across)
    return m, c, k


def exact(m, c, k, record, pushed=None):
    """Displacements and velocities at the record's points without pounding: exp of the whole state."""
    n = len(m)
    a = np.zeros((2 * n + 2, 2 * n + 2))
    a[:n, n : 2 * n] = np.eye(n)
    a[n : 2 * n, : 2 * n] = -np.linalg.solve(m, np.hstack([k, c]))
    a[n : 2 * n, 2 * n] = -1.0 if pushed is None else -np.asarray(pushed)
    a[2 * n, 2 * n + 1] = 1.0
    step, x = expm(a * record.dt), np.zeros(2 * n)
    found = [x]
    for g0, g1 in zip(record.acceleration[:-1], record.acceleration[1:], strict=True):
        x = (step @ np.concatenate([x, [g0, (g1 - g0) / record.dt]]))[: 2 * n]
        found.append(x)
    return np.array(found)


def test_two_masses_on_a_link_by_hand():
    """Two equal masses: one mode knows nothing of the link, the other has twice its stiffness and damping."""
    m, k, c, kl, cl = 50.0, 2.0e4, 40.0, 6.0e3, 120.0
    w = np.sqrt(k / m)
    one = ps.Building("a", [m], [k], c / (2.0 * m * w))
    scene = ps.Scene([one, replace(one, name="b")], [1.0], links=[ps.Link("a-b", [1], kl, cl)])
    frequencies, decay = Variants(scene, np.ones((1, 2)), np.ones((1, 2)), np.array([np.nan])).systems[0]
    np.testing.assert_allclose(frequencies[0], [w, np.sqrt((k + 2.0 * kl) / m)], rtol=1e-12)
    np.testing.assert_allclose(decay[0], [c / m, (c + 2.0 * cl) / m], rtol=1e-12)
    assert scene.linked_buildings == ((0, 1),)


def test_a_rigid_link_makes_neighbours_one():
    """Periods of two equal towers, stiffly linked at every floor, are those of one."""
    twin = ps.Scene([LEFT, replace(LEFT, name="b")], [0.01], links=[ps.Link("a-b", [1, 2], 1e12)])
    apart = [2.0 * np.pi / np.sqrt(2.0 * 1e12 / m) for m in sorted(LEFT.masses, reverse=True)]
    periods = ", ".join(f"{t:.3g}" for t in [*LEFT.periods, *apart])
    assert dict(overview(twin))["a + b"] == f"linked, periods as one {periods} s"


def radius(method, h, m, c, k):
    """Spectral radius of an explicit step."""
    n, a = len(m), np.zeros((2 * len(m),) * 2)
    a[:n, n:] = np.eye(n)
    a[n:] = -np.linalg.solve(m, np.hstack([k, c]))
    if method == "rk4":
        x = h * a
        step = np.eye(2 * n) + x @ (np.eye(2 * n) + x @ (np.eye(2 * n) / 2 + x @ (np.eye(2 * n) / 6 + x / 24)))
    else:  # velocity Verlet, dampers by the predicted velocity
        first = a[n:]
        u = np.hstack([np.eye(n), h * np.eye(n)]) + 0.5 * h * h * first
        predicted = np.hstack([np.zeros((n, n)), np.eye(n)]) + h * first
        second = -np.linalg.solve(m, k @ u + c @ predicted)
        step = np.vstack([u, np.hstack([np.zeros((n, n)), np.eye(n)]) + 0.5 * h * (first + second)])
    return np.abs(np.linalg.eigvals(step)).max()


@given(
    st.lists(st.floats(0.0, 1e5), min_size=4, max_size=4),
    st.floats(0.0, 1e6),
    st.floats(0.0, 1e5),
    st.sampled_from(["rk4", "central_difference"]),
)
def test_steps_at_the_limit_of_dashpots_and_links_do_not_grow(dashpots, stiffness, damping, method):
    links = [ps.Link("a-b", [(1, 2), 2], stiffness, damping)] if stiffness or damping else []
    a, b = (replace(each, dashpots=own) for each, own in zip((LEFT, RIGHT), (dashpots[:2], dashpots[2:]), strict=True))
    scene = ps.Scene([a, b], [1.0], links=links)
    limit = float(largest_step(scene, LAWS["none"], np.zeros(1), np.ones(1), method=method)[0])
    assert radius(method, limit, *matrices(scene)) < 1.0 + 1e-9
    assert np.isinf(largest_step(scene, LAWS["none"], np.zeros(1), np.ones(1), method="newmark")[0])


def test_the_limit_of_a_stiff_link_is_its_own():
    """Two masses: undamped, the bound by row sums is within a factor of the exact limit."""
    stiff = replace(LINKED, links=[ps.Link("a-b", [2], 1e8)])
    limit = float(largest_step(stiff, LAWS["none"], np.zeros(1), np.ones(1), method="central_difference")[0])
    m, _, k = matrices(stiff)
    fastest = np.sqrt(eig(k, m)[0].real.max())
    assert 0.5 * 2.0 / fastest < limit < 2.0 / fastest


def test_an_isolated_building_has_the_numbers_that_were_asked_for():
    made = ps.base_isolated(TOWER_ABOVE, 150.0, 2.5, 0.05, 250.0, 0.01)
    total, k1, r = 600.0, made.stiffnesses[0], made.hardening
    assert 2.0 * np.pi * np.sqrt(total / (r * k1)) == pytest.approx(2.5)
    assert (made.yield_strengths[0] / k1, made.yield_strengths[0] * (1.0 - r)) == pytest.approx((0.01, 250.0))
    assert made.yields == (True, False, False, False)
    assert made.dashpots[0] / (2.0 * total * 2.0 * np.pi / 2.5) == pytest.approx(0.05)
    assert made.rayleigh == (0.0, 0.0)
    fixed = replace(TOWER_ABOVE, damping_ratio=0.0, dashpots=made.dashpots[1:])
    ((frequencies, _),) = Variants(ps.Scene([fixed]), *np.ones((2, 1, 1)), np.array([np.nan])).systems
    m, c, _ = matrices(ps.Scene([fixed]))
    shape = TOWER_ABOVE.modes[1][:, 0]
    assert shape @ c @ shape / (2.0 * frequencies[0, 0]) == pytest.approx(0.02)
    assert np.allclose(np.diag(m), 150.0)
    yielding = replace(TOWER_ABOVE, yield_strengths=[9.0, 8.0, np.inf], hardening=0.1)
    both = ps.base_isolated(yielding, 150.0, 2.5, 0.05, 250.0, 0.01)
    assert both == replace(
        made, yield_strengths=[made.yield_strengths[0], 9.0, 8.0, np.inf], hardening=[r, 0.1, 0.1, 0.1]
    )
    linear = ps.base_isolated(TOWER_ABOVE, 150.0, 2.5, 0.05)
    assert (linear.yield_strengths, linear.hardening) == (None, 0.0)
    assert linear.periods[0] == pytest.approx(2.5, rel=0.02)  # but for what the building above gives


def test_the_example_is_that_building():
    sweep = ps.load_sweep(Path(__file__).parents[1] / "sweeps" / "isolated.toml")
    (mine,) = sweep.spec.scene.buildings
    made = ps.base_isolated(TOWER_ABOVE, 150.0, period=2.5, damping_ratio=0.05, strength=250.0, yield_drift=0.01)
    assert mine == made
    stiff = np.array([made.stiffnesses, [made.hardening * made.stiffnesses[0], *made.stiffnesses[1:]]])
    said = []
    for k in stiff:  # of the whole, before and after the isolators yield
        matrix = np.diag(k) + np.diag([*k[1:], 0.0]) - np.diag(k[1:], 1) - np.diag(k[1:], -1)
        said.append(", ".join(f"{2.0 * np.pi / w:.3g}" for w in np.sqrt(np.linalg.eigvalsh(matrix / 150.0))[:2]))
    about = dict(overview(sweep.spec.scene))["tower"]
    assert f"periods {said[0]} s before its isolators yield, {said[1]} s after, weight" in about
    assert [(c.pair, c.storey) for c in sweep.spec.scene.contacts] == [(0, 1), (1, 1)]
    plan = sweep.plan()
    assert plan.n_asked == 96 * 2 // 2
    assert plan.numerics.method == "exact"
