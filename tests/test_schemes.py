"""What every scheme says of itself, held against its own arithmetic: order, phase, stability limit. No kernel runs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import row
from scipy.linalg import expm

from pounding_sweep.base.errors import SweepError
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel.spec import property_slots
from pounding_sweep.model.building import Building
from pounding_sweep.model.laws import LAWS, get_law
from pounding_sweep.model.scene import Scene, Wall
from pounding_sweep.plan import advice
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.schemes.explicit import Explicit
from pounding_sweep.schemes.stability import DAMPED, largest_step
from pounding_sweep.variables.registry import reducers_for

EXPLICIT = [scheme for scheme in SCHEMES.values() if isinstance(scheme, Explicit)]


def step(scheme, m, c, k, h, ground=(0.0, 0.0), beta=0.25, gamma=0.5):
    """One step as a matrix of the state (u, v) and what the ground (linear in it) adds."""
    n = len(m)
    u, v = np.eye(2 * n + 1)[:n], np.eye(2 * n + 1)[n : 2 * n]
    one = np.eye(2 * n + 1)[2 * n :]

    def accelerate(u, v, g):
        return -(k @ u + c @ v) / m[:, None] - g * one

    if scheme.implicit:
        start = accelerate(u, v, ground[0])
        x, y = u + h * v + h * h * (0.5 - beta) * start, v + h * (1.0 - gamma) * start
        left = np.diag(m) + gamma * h * c + beta * h * h * k
        end = np.linalg.solve(left, -k @ x - c @ y - ground[1] * m[:, None] * one)
        u, v = x + beta * h * h * end, y + gamma * h * end
    else:
        x, y, a = u, v, []
        for stage, (place, _) in enumerate(scheme.nodes, 1):
            a.append(accelerate(x, y, ground[0] + place * (ground[1] - ground[0])))
            x, y = scheme.after(stage, u, v, x, a, h)
        u, v = x, y
    whole = np.vstack([u, v])
    return whole[:, :-1], whole[:, -1]


def oscillator(w=1.0, zeta=0.0):
    return np.ones(1), np.array([[2.0 * zeta * w]]), np.array([[w * w]])


def growth(scheme, system, h, **more):
    return np.abs(np.linalg.eigvals(step(scheme, *system, h, **more)[0])).max()


# -- what a scheme says of itself --------------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", SCHEMES.values(), ids=SCHEMES)
def test_every_scheme_has_the_order_that_it_says(scheme):
    """Damped, and pushed by a ground that is linear over the steps, as records are."""
    m, c, k = oscillator(w=2.0, zeta=0.05)
    pushed = np.zeros((4, 4))  # u, v, and the ground with its slope
    pushed[0, 1], pushed[1], pushed[2, 3] = 1.0, [-k[0, 0], -c[0, 0], -1.0, 0.0], 1.0
    errors = []
    for n in (16, 32, 64, 128):
        state, h = np.array([0.3, -0.2]), 3.0 / n
        for i in range(n):
            matrix, push = step(scheme, m, c, k, h, ground=(1.0 + 0.5 * i * h, 1.0 + 0.5 * (i + 1) * h))
            state = matrix @ state + push
        errors.append(np.abs(state - (expm(3.0 * pushed) @ [0.3, -0.2, 1.0, 0.5])[:2]).max())
    order = np.log2(errors[-2] / errors[-1])
    smooth = scheme.order + scheme.flies_exactly  # whose order is that of contacts, as their forces begin with a root
    assert smooth - 0.1 < order < smooth + 0.5, errors


@pytest.mark.parametrize("scheme", SCHEMES.values(), ids=SCHEMES)
def test_the_error_of_the_phase_is_the_one_that_statuses_judge_by(scheme):
    x = 0.05
    value = np.linalg.eigvals(step(scheme, *oscillator(), x)[0])[0]
    true = np.hypot(abs(abs(np.angle(value)) - x), abs(abs(value) - 1.0)) / x
    assert float(scheme.phase_error(np.array(x), 0.25, 0.5)) == pytest.approx(true, rel=0.02)


@pytest.mark.parametrize("scheme", SCHEMES.values(), ids=SCHEMES)
def test_a_linear_ground_is_integrated_twice_where_a_scheme_says_so(scheme):
    _, (u, v) = step(scheme, *oscillator(w=0.0), 0.1, ground=(2.0, -3.0))
    assert v == pytest.approx(-0.1 * (2.0 - 3.0) / 2.0)
    assert (u == pytest.approx(-0.01 * (2.0 / 3.0 - 3.0 / 6.0))) == (scheme.min_ground_steps <= 1.0)


@pytest.mark.parametrize("scheme", EXPLICIT, ids=lambda scheme: scheme.name)
def test_the_weights_of_works_and_energies_are_those_of_a_whole_step(scheme):
    assert sum(weight for _, weight in scheme.nodes) == 6.0


def test_the_same_scheme_everywhere():
    assert list(SCHEMES)[:3] == ["rk4", "newmark", "exact"]
    for name, scheme in SCHEMES.items():
        assert scheme.name == name
        assert scheme.title
        assert scheme.source
        assert ((name, "float64") in advice.load_measured().cost) == bool(scheme.ladder)


def test_accuracy_says_which_scheme_was_not_measured(monkeypatch):
    known = advice.load_measured()
    cost = {scheme: value for scheme, value in known.cost.items() if scheme[0] != "newmark"}
    monkeypatch.setattr(advice, "load_measured", lambda: advice.Measured(known.curves, cost, known.about))
    sweep = Sweep(row(), "el_centro", laws=["linear"], gaps=[0.01], stiffness_factors=[1.0], accuracy=1e-2)
    assert sweep.plan().numerics.method != "newmark"
    with pytest.raises(SweepError, match=r"no errors of newmark were measured; give dt instead, or .*calibrate"):
        Sweep(row(), "el_centro", laws=["linear"], gaps=[0.01], accuracy=1e-2, method="newmark").plan()
    with pytest.raises(SweepError, match=r"no errors of central_difference were measured; give dt instead$"):
        Sweep(row(), "el_centro", laws=["linear"], gaps=[0.01], accuracy=1e-2, method="central_difference").plan()


# -- the stability limit -----------------------------------------------------------------------------------------------


def closed_system(scene, law, k, e):
    """M, C and K with every contact of a linear law closed."""
    n = scene.n_dof
    m = np.concatenate([b.masses for b in scene.buildings])
    c, s = np.zeros((n, n)), np.zeros((n, n))
    for b, first in zip(scene.buildings, scene.offsets[:-1], strict=True):
        part = slice(first, first + b.n_storeys)
        alpha, beta = b.rayleigh
        s[part, part] = b.system_matrix
        c[part, part] = alpha * np.diag(b.masses) + beta * b.system_matrix
    for contact in scene.contacts if law.exponent == 1.0 else ():
        shape = np.zeros(n)
        if contact.left >= 0:
            shape[contact.left] = 1.0
        if contact.right >= 0:
            shape[contact.right] = -1.0
        damper = float(law.damping_coefficient(e, k, contact.mass)) if law.damping == "viscous" else 0.0
        s += k * np.outer(shape, shape)
        c += damper * np.outer(shape, shape)
    return m, c, s


def limit_of(scheme, scene, law, k, e, **more):
    return float(largest_step(scene, law, np.array([k]), np.array([e]), method=scheme.name, **more)[0])


stiff = st.floats(4.0, 8.0).map(lambda x: 10.0**x)
viscous = st.sampled_from([LAWS[name] for name in ("linear", "kelvin_voigt", "kelvin_voigt_tension", "none", "hertz")])
# contacts of exact flight have sub-steps of their own
limited = st.sampled_from([scheme for scheme in EXPLICIT if not scheme.flies_exactly])


@st.composite
def rows(draw, spread=10.0):
    items = []
    for i in range(draw(st.integers(1, 3))):
        n = draw(st.integers(1, 4))
        masses = draw(st.lists(st.floats(10.0, 10.0 * spread), min_size=n, max_size=n))
        springs = draw(st.lists(st.floats(1e4, 1e4 * spread), min_size=n, max_size=n))
        items.append(Building(f"b{i}", masses, springs, draw(st.sampled_from([0.0, 0.02, 0.05, 0.2]))))
    if draw(st.booleans()):
        items.insert(0, Wall("w"))
    if len(items) == 1 or draw(st.booleans()):
        items.append(Wall("x"))
    return Scene(items, gaps=[0.01] * (len(items) - 1))


@given(limited, rows(), viscous, stiff, st.sampled_from([0.0, 0.3, 0.6, 0.9, 1.0]))
def test_no_step_within_the_limit_grows(scheme, scene, law, k, e):
    limit, system = limit_of(scheme, scene, law, k, e), closed_system(scene, law, k, e)
    for share in (0.1, 0.5, 0.8, 1.0):
        assert growth(scheme, system, share * (1.0 - 1e-6) * limit) <= 1.0 + 1e-8, share


@pytest.mark.parametrize("zeta", [0.0, 1e-5, DAMPED, 1e-3, 0.01, 0.1, 0.5, 1.0, 3.0])
def test_the_stages_beside_exact_flight_are_stable_at_any_damping(zeta):
    exact = SCHEMES["exact"]
    radius = exact.damped_radius if zeta >= DAMPED else exact.undamped_radius
    for h in np.linspace(0.01, 1.0, 50) * radius / max(1.0, 2.0 * zeta):
        assert growth(exact, oscillator(zeta=zeta), h) <= 1.0 + 1e-12


@pytest.mark.parametrize(
    ("damping", "dashpots", "radius"), [(0.0, None, 0.85), (0.0, [30.0], 0.85), (0.05, None, 1.25)]
)
@pytest.mark.parametrize("dt", [1e-3, 0.01, 0.5])
def test_sub_steps_beside_exact_flight_keep_to_the_radius_at_any_step(dt, damping, dashpots, radius):
    stiff = Building("b", [100.0], [3e4], damping, dashpots=dashpots)
    scene = Scene([Building("a", [100.0], [1e4]), stiff], gaps=[0.01])
    within = radius / math.sqrt(300.0)
    for rough, outputs, least, most in (
        (False, ["displacement_max"], 0.9, 2.001),
        (True, ["displacement_max"], 0.9, 1.001),
        (True, ["acceleration_max"], 0.45, 0.501),
    ):
        kernel = RowKernel(scene, get_law("hertz"), Numerics("exact", dt), reducers_for(outputs))
        longest = kernel.constants(rough)[property_slots(kernel.shape).first["longest"]]
        assert min(least * dt, 0.9 * within) < longest < min(most * dt, 1.001 * within)


@pytest.mark.parametrize("scheme", [s for s in EXPLICIT if not s.flies_exactly], ids=lambda scheme: scheme.name)
def test_the_limit_of_overdamped_contacts_beside_a_stiff_building(scheme):
    """The overdamped mode of a soft contact is not the mode that sets the highest frequency."""
    for key, e in (("linear_viscoelastic", 0.05), ("linear_viscoelastic", 0.2), ("kelvin_voigt", 0.0)):
        for stiffness in 10.0 ** np.linspace(5.0, 10.0, 21):
            scene = Scene(
                [Building("a", [100.0], [1e4]), Building("b", [100.0], [1e4]), Building("c", [100.0], [stiffness])],
                gaps=[0.01, 0.01],
            )
            limit = limit_of(scheme, scene, get_law(key), 1e6, e)
            assert growth(scheme, closed_system(scene, get_law(key), 1e6, e), limit * (1.0 - 1e-6)) <= 1.0 + 1e-8


@given(limited, rows(spread=1.5), viscous, stiff, st.sampled_from([0.6, 0.9, 1.0]))
def test_the_limit_is_within_a_factor_of_two(scheme, scene, law, k, e):
    limit, system = limit_of(scheme, scene, law, k, e), closed_system(scene, law, k, e)
    assert any(growth(scheme, system, share * limit) > 1.0 + 1e-6 for share in (1.4, 1.7, 2.0001))


def test_newmark_has_no_limit_unless_its_parameters_give_one():
    scene, law, newmark = row(), get_law("linear"), SCHEMES["newmark"]
    assert math.isinf(limit_of(newmark, scene, law, 2e5, 1.0))
    system = closed_system(scene, law, 2e5, 1.0)
    for beta in (0.0, 1.0 / 6.0):  # central differences, linear acceleration
        limit = limit_of(newmark, scene, law, 2e5, 1.0, beta=beta)
        w = math.sqrt(np.linalg.eigvals(system[2] / system[0][:, None]).real.max())
        true = 1.0 / w / math.sqrt(0.25 - beta)
        assert 0.5 * true <= limit <= true
        growths = [
            np.abs(np.linalg.eigvals(step(newmark, *system, h, beta=beta)[0])).max() for h in (limit, 2.1 * true)
        ]
        assert growths[0] <= 1.0 + 1e-9 < growths[1]


def test_stiffer_linear_contacts_lower_the_limit():
    rk4 = SCHEMES["rk4"]
    assert limit_of(rk4, row(), get_law("linear"), 2e5, 1.0) < limit_of(rk4, row(), get_law("linear"), 1e5, 1.0)
    # a Hertz-type contact has no stiffness before it closes, one beside exact flight has sub-steps of its own
    for scheme, key in ((rk4, "hertz"), (SCHEMES["exact"], "linear")):
        assert limit_of(scheme, row(), get_law(key), 1e9, 1.0) == limit_of(rk4, row(), get_law("none"), 0.0, 1.0)


def test_where_central_differences_are_stable():
    """By the closed form of `schemes/central_difference.py`, in steps x of the frequency and y of the damper."""
    scheme = SCHEMES["central_difference"]
    for y in np.linspace(0.0, 2.0, 9):
        x = math.sqrt(4.0 - 2.0 * y + y * y)
        for share, stable in ((0.5, True), (0.999, True), (1.001, False)):
            system = np.ones(1), np.array([[y]]), np.array([[(share * x) ** 2]])
            assert (growth(scheme, system, 1.0) <= 1.0 + 1e-8) == stable, (x, y)
    assert (scheme.undamped_radius, scheme.damped_radius) == (2.0, math.sqrt(3.0))
    with pytest.raises(SweepError, match="no errors of central_difference were measured"):
        Sweep(row(), "el_centro", laws=["linear"], gaps=[0.01], accuracy=1e-2, method="central_difference").plan()
