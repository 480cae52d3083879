"""Exact flight in modes that dashpots and links couple: their algebra, outputs against the twin, what it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from against_reference import motion, simulate
from hypothesis import given
from hypothesis import strategies as st
from kernels_used import LINKED
from kinds import DASHED
from test_links import exact, matrices

import pounding_sweep as ps
from pounding_sweep.base.errors import SweepError
from pounding_sweep.model.variants import coupled_modes, variants_of
from pounding_sweep.schemes import SCHEMES

A, B = LINKED.buildings


def state_matrix(scene):
    m, c, k = matrices(scene)
    n = len(m)
    return np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(m, k), -np.linalg.solve(m, c)]])


def energy_scales(scene):
    m, _, k = matrices(scene)
    return np.sqrt(np.concatenate([np.diag(k), np.diag(m)]))


coefficient = st.one_of(st.just(0.0), st.floats(0.0, 5.0).map(lambda x: 10.0**x))


def check_modes(scene, bound):
    """They are those of the state matrix, and the ground moves no q at once."""
    modes, a, scales, n = coupled_modes(variants_of(scene)), state_matrix(scene), energy_scales(scene), scene.n_dof
    to, back = (np.block([[x[0, 0], x[0, 1]], [x[0, 2], x[0, 3]]]) for x in (modes.floors, modes.modal))
    own = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(modes.w[0] ** 2), -np.diag(modes.c[0])]])
    assert np.abs((to @ back - np.eye(2 * n)) * scales[:, None] / scales).max() < bound
    scaled = a * scales[:, None] / scales
    assert np.abs((to @ own @ back) * scales[:, None] / scales - scaled).max() < bound * np.abs(scaled).max()
    pushed = back @ np.repeat([0.0, -1.0], n)
    assert np.abs(pushed[:n] * modes.w[0]).max() < bound * max(1.0, np.abs(pushed[n:]).max())
    np.testing.assert_allclose(pushed[n:], -modes.push[0], atol=bound * np.abs(modes.push).max())
    assert (modes.c >= 0.0).all()


@given(st.lists(coefficient, min_size=4, max_size=4), coefficient, coefficient, st.sampled_from([0.0, 0.05, 0.7]))
def test_modes_are_those_of_the_state_matrix(dashpots, stiffness, damping, ratio):
    links = [ps.Link("a-b", [(1, 2), 2], stiffness, damping)] if stiffness or damping else []
    a, b = (
        replace(x, dashpots=own, damping_ratio=ratio)
        for x, own in zip((A, B), (dashpots[:2], dashpots[2:]), strict=True)
    )
    check_modes(ps.Scene([a, b], [1.0], links=links), 1e-6)


@pytest.mark.parametrize("ratio", [0.999, 1.0 - 1e-9, 1.0, 1.0 + 1e-12, 1.0 + 1e-6, 1.5, 300.0])
def test_critical_damping_is_no_special_case(ratio):
    m, w = 100.0, 10.0
    check_modes(ps.Scene([ps.Building("a", [m], [m * w * w], 0.0, dashpots=[2.0 * ratio * w * m])]), 1e-9)


def coalescing(off=0.0):
    """Two oscillators whose complex modes are one and the same, but for `off`: (s^2 + a s + b)^2 = 0."""
    w1, w2, right = 10.0, 11.0, 3.0
    left = right * w1 / w2
    c = np.sqrt((w2 - w1) ** 2 - 0.25 * (left - right) ** 2)
    one = ps.Building("a", [1.0], [w1 * w1], 0.0, dashpots=[left - c])
    other = ps.Building("b", [1.0], [w2 * w2], 0.0, dashpots=[right - c])
    return ps.Scene([one, other], [1.0], links=[ps.Link("a-b", [1], 0.0, c * (1.0 + off))])


@pytest.mark.parametrize("off", [0.0, 1e-14, 1e-12, 1e-9, 1e-6, 1e-3])
def test_modes_that_coincide_are_those_of_a_damping_next_to_it(off):
    scene = coalescing(off)
    values = np.linalg.eigvals(state_matrix(scene))
    if not off:
        assert np.abs(values - values.mean().real).min() > 1.0
        assert abs(np.subtract(*values[values.imag > 0.0])) < 1e-6
    check_modes(scene, 1e-8)
    assert coupled_modes(variants_of(scene)).error[0] < 1e-8
    assert coupled_modes(variants_of(scene), "float32").error[0] < 3e-4


def test_equal_buildings_have_equal_modes():
    """Modes that coincide and are independent: three towers, as good as unlinked, and linked by dashpots alone."""
    row = [replace(A, name=name, dashpots=None) for name in "abc"]
    for stiffness, damping, bound in ((1e-9, 0.0, 1e-12), (0.0, 1e5, 1e-9)):
        links = [ps.Link(name, [2], stiffness, damping) for name in ("a-b", "b-c")]
        check_modes(ps.Scene(row, [0.1, 0.1], links=links), bound)


def test_undamped_frequencies_are_those_of_classical_modes():
    """Dashpots in the shares of stiffness leave modes apart."""
    bare = replace(A, damping_ratio=0.0, dashpots=[1e-3 * k for k in A.stiffnesses])
    modes = coupled_modes(variants_of(ps.Scene([bare])))
    np.testing.assert_allclose(modes.w[0], bare.frequencies, rtol=1e-12)
    np.testing.assert_allclose(modes.c[0], 1e-3 * bare.frequencies**2, rtol=1e-12)
    np.testing.assert_allclose(np.abs(modes.floors[0, 0]), np.abs(bare.modes[1]), rtol=1e-9)
    assert np.abs(modes.floors[0, 1]).max() < 1e-12


def test_flight_without_pounding_is_the_exponential():
    record, want = motion(101, 1.5), exact(*matrices(LINKED), motion(101, 1.5))
    for dt in (1e-3, 2e-2):
        got = simulate(replace(LINKED, gaps=[1.0]), "kelvin_voigt", 101, 1.5, method="exact", dt=dt)
        every = round(record.dt / float(got.time[1]))
        for name, part in (("displacement", want[:, :4]), ("velocity", want[:, 4:])):
            mine = got[name].values[::every].reshape(len(want), -1)
            assert np.abs(mine - part).max() < 1e-12 * np.abs(part).max()


def test_modes_that_a_number_format_can_not_hold_are_refused():
    heavy = replace(DASHED, row=[A, replace(B, dashpots=[0.0, 5.151e4])])
    assert SCHEMES["exact"].refuses(heavy) is None
    message = r"precision: method 'exact' flies in modes, and those of this row's dashpots and links lose .* in float32"
    with pytest.raises(SweepError, match=message):
        ps.Sweep(heavy, motion(51), "linear", method="exact", precision="float32")
    plan = ps.Sweep(heavy, motion(51), "kelvin_voigt", accuracy=1e-3, method="exact").plan()
    assert (plan.numerics.method, plan.numerics.precision) == ("exact", "float64")
