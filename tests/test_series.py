"""Steps of exact flight beside contacts whose forces are polynomials: exact at any step, whatever happens within it."""

from __future__ import annotations

import math

import naive
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import motions, pair
from test_columns import twins

import pounding_sweep as ps
from pounding_sweep.engine.kernel import make_group
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel import series
from pounding_sweep.kernel.forces import OPEN, PRESSING
from pounding_sweep.kernel.lanes import roughly_power
from pounding_sweep.kernel.roots import Series, cubic_turn, with_slope
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.model.laws import LAWS
from pounding_sweep.model.scene import Building, Scene
from pounding_sweep.outputs.variables import reducers_for

POLYNOMIAL = [
    "linear",
    "kelvin_voigt",
    "kelvin_voigt_tension",
    "linear_viscoelastic",
    "modified_kelvin",
    "modified_kelvin_voigt",
]
OUTPUTS = ["displacement_max", "drift_max", "acceleration_max", "impact_force_max", "impact_count"]
OUTPUTS += ["penetration_max", "impulse", "contact_time", "energy_input", "energy_damping", "contact_work"]
OUTPUTS += ["energy_transfer_max", "energy_transfer_min"]


def found(scene, law, record, stiffness, restitution, outputs=OUTPUTS):
    """What the kernels' own source, run as Python, finds at the record's own step."""
    numerics = Numerics("exact", record.dt)
    kernel = RowKernel(scene, LAWS[law], numerics, reducers_for(outputs))
    assert kernel.shape.series > 0
    n, gaps = len(stiffness), np.tile(scene.gaps, (len(stiffness), 1))
    given = {"stiffness": np.array(stiffness), "restitution": np.array(restitution)}
    assert n <= LANES
    return kernel.run(record, scale=np.ones(n), gaps=gaps, **given, twin=True)


def test_which_laws_have_series():
    def order(law, precision):
        numerics = Numerics("exact", 0.01, precision=precision)
        return RowKernel(pair(), LAWS[law], numerics, reducers_for(OUTPUTS)).shape.series

    assert {law for law in LAWS if order(law, "float64")} == set(POLYNOMIAL)
    assert order("linear", "float32") < order("linear", "float64")


@pytest.mark.parametrize(
    "law",
    [law if law == "kelvin_voigt" else pytest.param(law, marks=pytest.mark.slow) for law in POLYNOMIAL],
)
def test_contacts_are_exact_at_the_step_of_the_record(law):
    scene, record = pair(0.003), motions()[0]
    record = ps.Record("short", record.dt, 2.0 * record.acceleration[:31])
    stiffness, restitution = [1.5e6], [0.5]
    ours = found(scene, law, record, stiffness, restitution)
    for i, (k, e) in enumerate(zip(stiffness, restitution, strict=True)):
        other = naive.run(twins(scene), scene.gaps, record.acceleration, record.dt, law, k, e, rtol=1e-12, atol=1e-14)
        assert other["impact_count"][0].sum() > 1
        np.testing.assert_array_equal(ours["count"][i], other["impact_count"][0])
        for name, want in (
            ("fmax", other["impact_force_max"][0]),
            ("dmax", other["penetration_max"][0]),
            ("impulse", other["impulse"][0]),
            ("tclosed", other["contact_time"][0]),
            ("e_in", other["energy_input"]),
            ("e_damp", other["energy_damping"]),
            ("work", other["contact_work"][0]),
            ("tmax", other["energy_transfer_max"]),
            ("tmin", other["energy_transfer_min"]),
        ):
            atol = 1e-8 * np.abs(other["energy_input"]).max() if name == "work" else 1e-8 * np.abs(want).max()
            np.testing.assert_allclose(ours[name][i], want, rtol=1e-7, atol=atol, err_msg=name)
        for name, key in (("acc", "acceleration_max"), ("drift", "drift_max"), ("umax", "displacement_max")):
            np.testing.assert_allclose(ours[name][i], np.concatenate(other[key]), rtol=1e-5, err_msg=name)


@pytest.mark.slow
def test_a_force_that_ends_and_returns_within_a_step():
    """Two floors part so fast that the damper would pull, and are pressed together again before the step ends."""
    scene = Scene(
        [Building("a", [100.0], [4e4]), Building("b", [150.0], [6e4]), Building("c", [90.0], [3e4])], [1e-4] * 2
    )
    t = np.arange(60) * 0.02
    record = ps.Record("hard", 0.02, 6.0 * np.sin(9.0 * t) + 4.0 * np.sin(23.0 * t))
    ours = found(scene, "kelvin_voigt", record, [3e4, 2e5, 1e6], [0.2, 0.3, 0.5])
    for i, (k, e) in enumerate(((3e4, 0.2), (2e5, 0.3), (1e6, 0.5))):
        other = naive.run(
            twins(scene), scene.gaps, record.acceleration, 0.02, "kelvin_voigt", k, e, rtol=1e-12, atol=1e-14
        )
        want = {name: np.concatenate(other[name]) for name in ("impulse", "contact_time", "impact_count")}
        np.testing.assert_array_equal(ours["count"][i], want["impact_count"])
        np.testing.assert_allclose(ours["impulse"][i], want["impulse"], rtol=1e-7)
        np.testing.assert_allclose(ours["tclosed"][i], want["contact_time"], rtol=1e-6)


@pytest.mark.parametrize("exponent", [1.0 / 12.0, 1.0 / 20.0, 0.4, -0.5])
def test_rough_powers_have_six_figures(exponent):
    x = np.geomspace(1e-20, 1e20, 4001)
    np.testing.assert_allclose(roughly_power(x, exponent), x**exponent, rtol=3e-6)
    if exponent > 0.0:
        assert (roughly_power(np.zeros(8), 12.0 * exponent + 1.0) < 1e-30).all()


@pytest.mark.parametrize("order", [3, 8, 13])
def test_value_and_slope_of_a_polynomial(order):
    coefficients = np.random.default_rng(order).normal(size=order)
    t = np.linspace(0.0, 1.5, 7)
    polynomial = np.polynomial.Polynomial(coefficients)
    for found, want in zip(with_slope(t, list(coefficients)), (polynomial(t), polynomial.deriv()(t)), strict=True):
        np.testing.assert_allclose(found, want, rtol=1e-12, atol=1e-12)


def test_a_cubic_turns_where_its_rate_is_zero():
    rng = np.random.default_rng(4)
    x0, x1, s0, s1 = rng.normal(size=500), rng.normal(size=500), rng.exponential(size=500), -rng.exponential(size=500)
    t = cubic_turn(x0, x1, s0, s1)
    rise = x1 - x0
    rate = s0 + 2.0 * (3.0 * rise - 2.0 * s0 - s1) * t + 3.0 * (s0 + s1 - 2.0 * rise) * t**2
    assert np.all((t > 0.0) & (t < 1.0))
    np.testing.assert_allclose(rate, 0.0, atol=1e-9)


@given(st.integers(0, 10_000), st.floats(0.5, 2.8))
def test_a_motion_leaves_the_cubic_of_its_ends_by_no_more_than_its_bulge(seed, turn):
    """Of three modes, of which the fastest turns by so much in a step."""
    rng = np.random.default_rng(seed)
    w, phase, size = rng.uniform(0.1, 1.0, 3) * turn, rng.uniform(0.0, 2.0 * np.pi, 3), rng.normal(size=3)
    w[0] = turn
    terms = [
        sum(size * w**n * np.cos(phase + n * np.pi / 2.0)) / math.factorial(n) for n in range(13)
    ]  # of size cos(w t + phase)
    motion = Series(lambda n: terms[n], 12)
    t = np.linspace(0.0, 1.0, 501)
    x = np.cos(np.outer(t, w) + phase) @ size
    r0, r1 = (-(size * w) @ np.sin(w * end + phase) for end in (0.0, 1.0))
    cubic = x[0] * (1 - t) ** 2 * (1 + 2 * t) + x[-1] * t * t * (3 - 2 * t)
    cubic += r0 * t * (1 - t) ** 2 - r1 * t * t * (1 - t)
    assert abs(x - cubic).max() <= motion.bulge(1.0) + 1e-4 * abs(size).sum() * (turn / 2.8) ** 13


def _taylor(rng, order, shape):
    """Coefficients of sines that turn by up to 2 rad in a step, which may have a constant."""
    turn, phase, size = rng.uniform(0.2, 2.0, shape), rng.uniform(0.0, 2.0 * np.pi, shape), rng.normal(size=shape)
    terms = [size * turn**k * np.sin(phase + 0.5 * np.pi * k) / math.factorial(k) for k in range(order)]
    terms[0] = terms[0] + rng.choice([0.0, 1.0], shape) * rng.normal(size=shape)
    return np.array(terms)


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 6))])
def test_extremes_of_transfers_lie_where_powers_change_their_sign(seed):
    """Random forces and motions of a pair of two storeys: against the same products, sampled densely."""
    kernel = RowKernel(pair(), LAWS["kelvin_voigt"], Numerics("exact", 0.01), reducers_for(OUTPUTS))
    group, rng = make_group(kernel.shape, None, LANES, kernel.constants()), np.random.default_rng(seed)
    s, order, n, nc = group.state, kernel.shape.series, 4, 2
    forces, rates = _taylor(rng, order, (nc, LANES)), _taylor(rng, order, (n, LANES))
    s["span"], s["fraction"] = np.full(LANES, 0.01), rng.uniform(0.5, 1.0, LANES)
    s["h"] = s["span"] * s["fraction"]
    for i in range(n):
        s["v0", i], s["v", i] = (
            rates[0, i] / 0.01,
            np.polynomial.polynomial.polyval(s["fraction"], rates[:, i], tensor=False) / 0.01,
        )
        for k in range(order):
            s["jet", i + (k + 1) * n] = rates[k, i] / (k + 1)
    for j in range(nc):
        s["mode", j] = rng.choice([OPEN, PRESSING], LANES)
        for k in range(order):
            s["fj", j + k * nc] = forces[k, j]
            s["dj", j + (k + 1) * nc] = (rates[k, j] - rates[k, j + 2]) / (k + 1)
    series._integrate(group)
    t, turned = np.linspace(0.0, 1.0, 4001)[:, None] * s["fraction"], False
    for b, sign in enumerate((1.0, -1.0)):
        given = np.zeros((len(t), LANES))
        for lane in range(LANES):
            held = [j for j in range(nc) if s["mode", j][lane] > OPEN]
            for j in held:
                force, rate = (np.polynomial.Polynomial(x) for x in (forces[:, j, lane], rates[:, j + 2 * b, lane]))
                given[:, lane] += sign * (force * rate).integ()(t[:, lane])
        np.testing.assert_allclose(s["now", b], given[-1], atol=1e-8)
        np.testing.assert_allclose(s["tmax", b], given.max(axis=0), atol=1e-6)
        np.testing.assert_allclose(s["tmin", b], given.min(axis=0), atol=1e-6)
        inside = np.maximum(
            given.max(axis=0) - np.maximum(given[-1], 0.0), np.minimum(given[-1], 0.0) - given.min(axis=0)
        )
        turned = turned or bool((inside > 1e-2).any())
    assert turned
    np.testing.assert_allclose(s["now", 0] + s["now", 1], s["work", 0] + s["work", 1], atol=1e-12)
