"""Schemes against what they say: order, phase, limits; and steps that an accuracy takes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from against_reference import apart, lanes, motion
from hypothesis import given
from hypothesis import strategies as st
from kernels_used import LINKED
from kinds import ALONE, YIELDS
from scenes import EVERY, motions, pair, row
from scipy.linalg import expm
from test_kernels import PAIR, PAPER, ROWS

import pounding_sweep as ps
from benchmarks.drawn_rows import draw, earthquakes
from pounding_sweep.base.errors import SweepError
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel.spec import property_slots
from pounding_sweep.model.building import Building
from pounding_sweep.model.laws import LAWS, get_law
from pounding_sweep.model.scene import Scene, Wall
from pounding_sweep.model.variants import Variants
from pounding_sweep.plan import advice
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.schemes.explicit import Explicit
from pounding_sweep.schemes.stability import DAMPED, largest_step
from pounding_sweep.variables.registry import DEFAULT_OUTPUTS, reducers_for

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


EL_CENTRO = ps.find_record("el_centro")


def exact(dt, refinement=1.0, precision="float64"):
    return Numerics("exact", dt, refinement=refinement, precision=precision)


def rk4(dt, precision="float64"):
    return Numerics("rk4", dt, precision=precision)


@dataclass(frozen=True)
class Case:
    scene: ps.Scene
    law: str
    record: ps.Record
    #: The numerics that are judged, and those that are right.
    one: Numerics
    other: Numerics
    #: Largest difference of results, over the largest of all lanes.
    near: dict
    given: dict = field(default_factory=dict)
    outputs: tuple = ("displacement_max", "impact_force_max", "impact_count")
    #: Differences are over the largest of each lane, and those of a quantile of lanes count.
    by_lane: bool = False
    quantile: float = 1.0
    least_touches: int = 20


def drawn(seed, n, low, high):
    """Random gaps, restitutions and stiffnesses; the last by powers of ten."""
    rng = np.random.default_rng(seed)
    given = {"gaps": rng.uniform(0.004, 0.02, (n, 1)), "restitution": rng.uniform(0.2, 0.9, n)}
    return given | {"stiffness": 7.52e6 * 10.0 ** rng.uniform(low, high, n)}


def some(n, gaps, pairs=1, seed=5):
    rng = np.random.default_rng(seed)
    return {
        "scale": rng.choice([-1.5, -1.0, 0.3, 0.7, 1.0, 1.3, 2.0], n),
        "gaps": rng.choice(gaps, (n, pairs)),
        "stiffness": 8e5 * 10.0 ** rng.uniform(-1.0, 1.0, n),
        "restitution": rng.uniform(0.2, 1.0, n),
    }


def product(gaps, restitutions, scales):
    gaps, restitution, scale = (x.ravel() for x in np.meshgrid(gaps, restitutions, scales, indexing="ij"))
    return {"gaps": gaps[:, None], "restitution": restitution, "scale": scale}


def resting():
    """Two of random scenarios."""
    rng, n = np.random.default_rng(5), 512
    given = {"scale": rng.uniform(0.3, 3.0, n), "gaps": rng.uniform(0.0, 0.01, (n, 1))}
    given |= {"stiffness": 2e5 * np.exp(rng.uniform(-2.0, 2.0, n)), "restitution": rng.uniform(0.1, 0.98, n)}
    return {name: values[[33, 118]] for name, values in given.items()}


def linked(n):
    rng = np.random.default_rng(6)
    factors = rng.uniform(0.7, 1.4, (n, 2)), rng.uniform(0.5, 2.0, (n, 2)), rng.choice([0.02, np.nan], n)
    return {**some(n, [0.001, 0.004, 0.05]), "variants": Variants(LINKED, *factors)}


def stiffer(factor):
    return replace(pair(), row=[replace(b, stiffnesses=[factor * k for k in b.stiffnesses]) for b in pair().row])


#: Two buildings all but level with each other, whose floors strike each other's columns 2 mm beside them.
TWICE = ps.Scene(
    [
        ps.Building("a", [40.0] * 2, [2e4] * 2, 0.05, [3.0, 3.0]),
        ps.Building("b", [60.0] * 2, [9e4] * 2, 0.05, [3.002, 3]),
    ],
    gaps=[0.01],
    contacts="floors and columns",
)
ONE_STOREY = [ps.Building("a", [630.0], [1.5e4]), ps.Building("b", [147.0, 145.0], [4460.0, 3420.0], 0.01)]
ONE_STOREY += [ps.Building("c", [147.0], [2.04e4], 0.01), ps.Building("d", [269.0, 224.0], [2.53e5, 1.71e5], 0.01)]
FOUR = [
    ps.Building("a", [120.0735], [19008.455], 0.05),
    ps.Building("b", [43.88994, 60.60579], [5016.0765, 4832.2155], 0.05),
    ps.Building("c", [63.43119], [3002.8039], 0.1),
    ps.Building("d", [120.7586, 67.86361], [69836.485, 50960.255], 0.05),
]
_T = 0.02 * np.arange(100)
SWAYS = ps.Building("a", [120.0, 90.0], [1.5e4, 1.2e4]), ps.Building("b", [80.0, 110.0], [1.4e4, 1.0e4])
COUNTS = {"count": 0.0}
FAST = {
    "several events in one step": Case(
        pair(), "kelvin_voigt", EL_CENTRO, exact(0.02), exact(0.0025, 8.0),
        COUNTS | {"impulse": 1e-11, "work": 1e-8, "tmax": 1e-8, "fmax": 1e-8},
        {"gaps": np.linspace(2e-4, 6e-3, 400)[:, None], "stiffness": 2e6}, tuple(EVERY), least_touches=100,
    ),
    **{
        f"a contact that turns twice, {factor} {seed}": Case(
            stiffer(factor), "kelvin_voigt", ps.synthetic_record(seed, duration=20.0, dt=0.02, pga=3.0),
            exact(0.02, 0.35), exact(0.0025, 8.0), COUNTS,
            {"gaps": np.geomspace(1e-4, 6e-3, 400)[:, None], "stiffness": 2e6}, tuple(EVERY),
        )
        for factor, seed in ((0.7, 1), (0.7, 2), (1.3, 2))
    },
}  # fmt: skip
SLOW = {
    **{
        f"sub-steps beside flight, {law}": Case(
            PAIR, law, motion(600), exact(5e-3), exact(5e-3, 12.0), {"umax": 6e-6, "umin": 6e-6, "fmax": 2e-4},
            drawn(4, 48, -0.6, 0.6), by_lane=True,
        )
        for law in ("hertz_damped", "nonlinear_viscoelastic")
    },
    **{
        f"forces in single precision, {law}": Case(
            PAIR, law, motion(600), exact(5e-3, precision="float32"), exact(5e-3), {"fmax": most},
            drawn(5, 96, 0.0, 3.0), by_lane=True, quantile=quantile,
        )
        for law in ("hertz_damped", "nonlinear_viscoelastic")
        for quantile, most in ((0.9, 1e-5), (1.0, 1e-4))
    },
    **{
        f"long steps of flight, {row}": Case(
            ROWS[row], "hertz_damped", motion(251, 1.0), exact(1e-3), rk4(2.5e-4),
            COUNTS | dict.fromkeys(("umax", "umin", "drift", "fmax", "e_in", "e_damp", "tmax", "work"), 2e-4),
            {"gaps": [[0.004], [0.006], [0.05]], "stiffness": ROWS[row].contact.hertz_stiffness},
            (*DEFAULT_OUTPUTS, "energy_input", "energy_damping", "contact_work", "energy_transfer_max"),
        )
        for row in ("paper", "four")
    },
    "a slow touch is one": Case(
        ps.Scene([ps.Building("b", [200.0], [450e3], 0.02), ps.Wall()], [0.002]), "nonlinear_viscoelastic",
        ps.synthetic_record(102, duration=10.0, dt=0.02, pga=3.0, ground_frequency=8.0), rk4(1e-3), rk4(1e-4), COUNTS,
        {"gaps": np.repeat([5e-4, 1e-3], 4)[:, None], "stiffness": np.tile([1e6, 1e7], 4),
         "restitution": np.tile([0.2, 0.2, 0.8, 0.8], 2)}, ("impact_count",), least_touches=100,
    ),
    "a force that is cut before its contact ends": Case(
        PAPER, "ye_hertz", EL_CENTRO, exact(5e-3), exact(2.5e-4, 8.0), {"umax": 3e-5},
        {"gaps": np.linspace(8.31e-3, 8.33e-3, 16)[:, None], "stiffness": 6.39e7, "restitution": 0.45},
    ),
    "floors at rest that are damped hard": Case(
        ps.Scene([ps.Building("a", [50.0, 34.0], [6.5e4, 3.1e4], 0.0), ps.Building("b", [216.0], [1.6e4], 0.0)], [0.0]),
        "hertz_damped", ps.Record("sine", 0.01, 8.0 * np.sin(8.0 * np.arange(60) * 0.01)), exact(0.01, 8.0), rk4(2e-4),
        COUNTS | {"fmax": 1e-6, "flags": 0.0}, {"stiffness": [2e8, 2e9], "restitution": [0.2, 0.5]}, least_touches=1,
    ),
    "forces that turn twice": Case(
        ps.Scene(ONE_STOREY, [0.0] * 3), "kelvin_voigt",
        ps.Record("cut", EL_CENTRO.dt, 1.2511315668464715 * EL_CENTRO.acceleration[104:224]), exact(5e-3),
        exact(5e-3, 4.0), {"fmax": 1e-5, "acc": 1e-5},
        {"scale": np.geomspace(0.6625, 0.9937, 200), "gaps": [(0.00036, 0.00318, 0.00672)], "stiffness": 1417790.0,
         "restitution": 0.28495}, ("impact_force_max", "acceleration_max", "impact_count"), by_lane=True,
    ),
    "displacements that turn twice": Case(
        ps.Scene(FOUR, [0.0] * 3), "kelvin_voigt",
        ps.Record("jump", 0.02, 5.841946823 * np.cos(19.39907072 * _T) * np.exp(-0.5 * _T)), exact(5e-3),
        exact(5e-3, 4.0), {"umax": 1e-5, "umin": 1e-5, "drift": 1e-5},
        {"scale": np.geomspace(1.6, 1.7, 200), "gaps": [(0.0, 0.00430913, 0.00625996)], "stiffness": 610750.7,
         "restitution": 0.23324}, ("displacement_max", "displacement_min", "drift_max", "impact_count"), by_lane=True,
    ),
    # a strong damper has the force of a light contact rise at once, and fall through most of a long step
    "a graze soon after its touch": Case(
        ps.get_preset("mate2015"), "modified_kelvin", EL_CENTRO, exact(5e-3), rk4(5e-4), {"fmax": 1e-5},
        {"gaps": [[5.80405e-3] * 2], "stiffness": 1.29644e6, "restitution": 0.478414}, least_touches=4,
    ),
    **{
        f"links, {name}": Case(
            scene, law, motion(121, 1.5), one, other, {"link_force": near},
            {"scale": np.linspace(0.3, 2.0, 64), "stiffness": np.geomspace(low, high, 64), "gaps": gaps,
             "restitution": np.linspace(0.3, 0.9, 64)},
            ("link_force_max", "impact_count"), by_lane=True, quantile=quantile,
        )
        for name, scene, law, one, other, near, gaps, low, high, quantile in [
            # a link's force is largest where that quintic of the motion turns which other peaks are read from
            ("turns", ps.Scene(SWAYS, [0.05], links=[ps.Link("a-b", [2], damping=50.0)]), "hertz_damped", exact(5e-4),
             exact(1.25e-4), 2e-10, 0.05 * np.linspace(0.2, 1.0, 64)[:, None], 1e6, 2e7, 0.95),
            ("single precision", ps.Scene([SWAYS[0], pair().row[1]], [0.0],
             links=[ps.Link("a-b", [1], stiffness=100.0, damping=200.0)]), "nonlinear_viscoelastic",
             rk4(1e-3, "float32"), rk4(1e-3), 1e-3,
             np.where(np.arange(64) % 4, 0.003 * np.linspace(0.0, 1.0, 64), 0.0)[:, None], 1e7, 1e9, 1.0),
            *(
                (f"velocity jumps {one.method}", ps.Scene([*SWAYS, ps.Wall()], [0.5, 0.0],
                 links=[ps.Link("a-b", [2], damping=50.0)]), "stereomechanical", one, rk4(1e-4), 1e-6,
                 np.stack([np.full(64, 0.5), 0.05 * np.linspace(0.1, 1.0, 64)], axis=1), 1e7, 1e9, 1.0)
                for one in (exact(5e-3), rk4(1e-3))
            ),
        ]
    },
    **{
        f"linked, {precision}, {len(outputs)}": Case(
            LINKED, "kelvin_voigt", motion(151), exact(1e-3, 4.0, precision), rk4(1e-4),
            COUNTS | {"": 2e-5 if precision == "float64" else 5e-3}, some(40, [0.001, 0.004, 0.05]), outputs,
            least_touches=100,
        )
        for precision in ("float64", "float32")
        for outputs in (tuple(EVERY), ("impact_force_max", "impact_count", "link_force_max", "displacement_max"))
    },
    **{
        f"the pair, {len(outputs)}": Case(
            pair(), "kelvin_voigt", motions()[0], exact(1e-3, 4.0), rk4(1e-4), COUNTS | {"": 2e-5},
            some(70, [0.0005, 0.001, 0.002, 0.004, 0.02]), outputs,
        )
        for outputs in (tuple(EVERY), ("impact_force_max", "impact_count"))
    },
    **{
        f"yielding, {law}, {len(scene.row)}": Case(
            scene, law, motion(101), exact(5e-4, 4.0), rk4(1e-4), {"": 5e-5},
            some(70, [0.0005, 0.001, 0.002, 0.004, 0.02], len(scene.gaps), 3), tuple(EVERY), least_touches=0,
        )
        for law, scene in [
            *((law, YIELDS) for law in ("none", "hertz_damped", "hysteretic", "stereomechanical")),
            ("kelvin_voigt", ALONE),
        ]
    },
    **{
        f"single precision, {law} {method}": Case(
            PAIR, law, motion(126, 1.5), Numerics(method, 1e-3, precision="float32"), Numerics(method, 1e-3),
            COUNTS | {"flags": 0.0} | dict.fromkeys(("umax", "umin", "drift", "fmax", "impulse", "vmax", "acc"), near),
            {"scale": [1.0, 0.7], "gaps": [[0.006], [0.004]], "stiffness": 7.52e6}, tuple(EVERY), least_touches=1,
        )
        # displacements of 0.1 m are known to 1e-8 m, within which a force like d**(1/4) rises to percents of its peak
        for method, law, near in (
            ("rk4", "nonlinear_viscoelastic", 3e-2),
            ("rk4", "stereomechanical", 2e-4),
            ("newmark", "hertz_damped", 2e-4),
        )
    },
    "jumps of small motions": Case(  # hops of less than a micrometre are told from rounding by how far floors are
        ps.Scene([ps.Building("a", [200.0] * 2, [4e5, 3.5e5], 0.02), ps.Building("b", [230.0], [2.8e5], 0.02)], [0.0]),
        "stereomechanical", EL_CENTRO, exact(1e-3, precision="float32"), exact(1e-3),
        COUNTS | {"umax": 1e-4, "impulse": 1e-4}, product(np.geomspace(2e-5, 2e-4, 8), [0.6, 0.9], [0.02, 0.05]),
        ("displacement_max", "impact_count", "impulse"), least_touches=1000,
    ),
    **{
        f"jumps, {one.method}, {other.dt}": Case(
            ps.get_preset("mate2015"), "stereomechanical", EL_CENTRO, one, other, COUNTS,
            product([5e-4, 2e-3, 1e-2], [0.2, 0.35, 0.5, 0.7, 0.9], [1.0]), ("impact_count",), least_touches=1000,
        )
        for make in (rk4, exact)
        for one, other in ((make(1e-3), make(5e-4)), (make(1e-3), make(2.5e-4)))
    },
    # the rate of a floor is nearly zero all along a step, and changes its sign three times: Newton's method goes astray
    "a floor that all but rests in a contact": Case(
        ps.Scene([ps.Wall(), pair().row[0], replace(pair().row[1], damping_ratio=0.03), ps.Wall("right")],
                 gaps=[0.004, 0.006, 0.005]),
        "kelvin_voigt_tension", ps.Record("start", EL_CENTRO.dt, EL_CENTRO.acceleration[:600]), exact(2.5e-3),
        rk4(5e-4), COUNTS | {"umax": 1e-4, "umin": 1e-4}, resting(), tuple(EVERY), by_lane=True, least_touches=1,
    ),
    "variants of a linked row": Case(
        LINKED, "kelvin_voigt", motion(101), exact(1e-3, 4.0), rk4(2e-4), COUNTS | {"": 2e-5}, linked(30),
        tuple(EVERY), least_touches=0,
    ),
    "two contacts that end all but at once": Case(
        TWICE, "linear", EL_CENTRO, exact(0.02, precision="float32"), exact(0.02), COUNTS,
        {"gaps": np.linspace(1e-3, 2e-2, 64)[:, None], "stiffness": 5e5}, ("impact_count",), least_touches=1000,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", [*FAST, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)])
def test_other_steps_find_the_same(name):
    case = (FAST | SLOW)[name]
    found, right = (
        lanes(case.scene, case.law, case.outputs, case.record, numerics, **case.given)
        for numerics in (case.one, case.other)
    )
    assert "count" not in right or right["count"].sum() >= case.least_touches
    default = case.near.get("")
    for each in right.keys() - {"shortest"} if default else case.near:
        off = apart(found[each], right[each], by_lane=case.by_lane).max(axis=tuple(range(1, right[each].ndim)))
        assert np.quantile(off, case.quantile) <= case.near.get(each, default), each
    assert (
        case.one.precision == case.other.precision
        or case.near == COUNTS
        or any((found[each] != right[each]).any() for each in found if each != "count")
    )  # it was not run in double


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("law", ["nonlinear_viscoelastic", "ye_hertz", "gonthier", "modified_kelvin"])
def test_contacts_that_hardly_rebound_change_their_mode_once(law, precision):
    """Where a rate or a force is zero at an event, and goes the other way first, the event is not found again."""
    rng, n = np.random.default_rng(3), 256
    stiffness = 2e6 if LAWS[law].exponent == 1.0 else 1.88e7
    given = {"gaps": rng.uniform(0.002, 0.02, (n, 1)), "stiffness": stiffness * np.exp(rng.uniform(-1.4, 1.4, n))}
    given["restitution"] = rng.uniform(0.05, 0.3, n)
    outputs = ["displacement_max", "impact_force_max", "impact_count"]
    found, right = (
        lanes(PAPER, law, outputs, EL_CENTRO, numerics, **given)
        for numerics in (exact(5e-3, precision=precision), rk4(5e-4))
    )
    assert not found["flags"].any()
    same = (found["count"] == right["count"]).all(axis=1)
    assert same.mean() > 0.95
    assert apart(found["umax"], right["umax"], by_lane=True)[same].max() < 1e-3


@pytest.mark.slow
def test_floors_that_part_and_touch_again_within_a_step_are_counted():
    """Roofs that part by 0.3 nm, and again 2 ms later: within one long step of open contacts, away at both its ends."""
    spec = draw(11, 29, [law for law in LAWS if LAWS[law].has_contact], earthquakes())
    case, record = spec.cases[2], spec.records[0]
    record = ps.Record("short", record.dt, record.acceleration[:887])
    given = {"scale": case.scale, "gaps": [case.gap], "stiffness": case.stiffness, "restitution": case.restitution}
    counts = [
        lanes(spec.scene, case.law, ["impact_count"], record, numerics, **given)["count"][0]
        for numerics in (exact(record.dt), rk4(1e-4))
    ]
    np.testing.assert_array_equal(*counts)
    assert counts[0][3] == 78
