"""Dashpots of single storeys, links between neighbours: against exact answers and the reference, and what sweeps do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from against_reference import buildings_of, motion, truth
from hypothesis import given
from hypothesis import strategies as st
from kernels_used import LINKED
from kinds import TOWER_ABOVE
from scenes import pair
from scipy.linalg import block_diag, eig, expm

import pounding_sweep as ps
from pounding_sweep.model.laws import LAWS
from pounding_sweep.model.variants import Variants
from pounding_sweep.request.spec import overview
from pounding_sweep.schemes.stability import largest_step

A, B = pair().buildings


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


def test_the_twin_is_exact_without_pounding():
    """Non-classical damping and links: the reference itself against the exponential of the whole state."""
    want = exact(*matrices(LINKED), motion(51, 1.5))
    moved = np.concatenate(truth(LINKED, "none", 51, 1.5)["displacement"], axis=1)
    assert np.abs(moved - want[:, :4]).max() < 1e-9 * np.abs(want[:, :4]).max()
    shapes = eig(*(matrices(LINKED)[i] for i in (2, 0)))[1].real  # damping does couple the modes
    coupled = shapes.T @ matrices(LINKED)[1] @ shapes
    assert np.abs(coupled - np.diag(np.diag(coupled))).max() > 0.05 * np.diag(coupled).max()


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
    twin = ps.Scene([A, replace(A, name="b")], [0.01], links=[ps.Link("a-b", [1, 2], 1e12)])
    apart = [2.0 * np.pi / np.sqrt(2.0 * 1e12 / m) for m in sorted(A.masses, reverse=True)]
    periods = ", ".join(f"{t:.3g}" for t in [*A.periods, *apart])
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
def test_steps_at_the_limit_do_not_grow(dashpots, stiffness, damping, method):
    links = [ps.Link("a-b", [(1, 2), 2], stiffness, damping)] if stiffness or damping else []
    a, b = (replace(each, dashpots=own) for each, own in zip((A, B), (dashpots[:2], dashpots[2:]), strict=True))
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
