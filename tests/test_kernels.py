"""The compiled kernels against the reference solver, `reference.py`: every law, scheme, row and variable."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from against_reference import buildings_of, check_reference, error_by_step, errors, motion
from kernels_used import SMOOTH, SMOOTHING
from kinds import YIELDS
from reference import modal_exact, run
from scenes import EVERY, pair, run_in_any_company
from test_simulate import A, B

import pounding_sweep as ps
from pounding_sweep.engine.postprocess import variables_of
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel.spec import history_slots
from pounding_sweep.model.laws import LAWS
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.variables.registry import VARIABLES, Status, reducers_for

pytestmark = pytest.mark.usefixtures("pair_kernels")

PAPER = replace(ps.get_preset("mate2015"), contact=ps.ContactProperties(2e6, hertz_stiffness=1.88e7, restitution=0.6))

CONTACT = ps.ContactProperties(linear_stiffness=8e5, hertz_stiffness=7.52e6, restitution=0.6)
PAIR = ps.Scene([A, B], [0.006], CONTACT)
ROWS = {
    "pair": PAIR,
    "paper": PAPER,
    # four buildings of one and two storeys behind a wall
    "four": ps.Scene(
        [
            ps.Wall(),
            ps.Building("w", [60.0], [4.0e4]),
            ps.Building("x", [100.0, 90.0], [1.2e5, 1.0e5]),
            ps.Building("y", [70.0], [6.0e4]),
            ps.Building("z", [150.0], [8.0e4], damping_ratio=0.02),
        ],
        gaps=[0.006, 0.004, 0.006, 0.008],
        contact=CONTACT,
    ),
    # a tall ground floor meets the neighbour's roof only; the wall on the right meets both floors
    "uneven": ps.Scene(
        [
            ps.Building("low", [140.0], [9.0e4], storey_heights=[6.0]),
            ps.Building("high", [90.0, 80.0], [1.6e5, 1.3e5], storey_heights=[3.0, 3.0]),
            ps.Wall("barrier"),
        ],
        gaps=[0.003, 0.007],
        contact=CONTACT,
    ),
    # more floors than one straight line of code holds: loops split within and between buildings
    "tall": ps.Scene(
        [
            ps.Building("tower", np.linspace(130.0, 80.0, 12), np.linspace(6e5, 3e5, 12)),
            ps.Building("annex", [120.0] * 5, [3.5e5] * 5),
        ],
        gaps=[0.01],
        contact=CONTACT,
    ),
}


#: Outputs of `simulate`.
ALL = [name for name in VARIABLES if name != "closing_max"]


def row_kernel(row, law, method, dt, locate=True, host=None):
    """The kernel that `simulate` compiles."""
    numerics = Numerics(method, dt, locate)
    host = None if host is None else LAWS[host]
    return RowKernel(ROWS[row], LAWS[law], numerics, reducers_for(ALL), history=True, host=host)


def run_lanes(kernel, record, scale, gaps, stiffness, restitution):
    steps = (record.n_points - 1) * kernel.numerics.steps(record)
    return kernel.run(
        record,
        scale=np.asarray(scale),
        gaps=np.asarray(gaps),
        stiffness=np.asarray(stiffness),
        restitution=np.asarray(restitution),
        history=np.zeros((steps + 1, history_slots(kernel.shape).size)),
    )


# Largest error of any variable at the step of the test; two to four times what is measured.
RK4_BOUND = dict.fromkeys(LAWS, 8e-6) | {"modified_kelvin_voigt": 2e-5}
SECOND_ORDER_BOUND = 1.5e-3


def check(row, law, points, scale, method, dt, bound):
    got = check_reference(ROWS[row], law, bound, points, scale, method=method, dt=dt)
    assert law == "none" or int(got.impact_count.sum()) >= 3


@pytest.mark.parametrize("law", list(LAWS))
def test_rk4_equals_the_twin_for_every_law(law):
    check("pair", law, 76, 1.5, "rk4", 5e-4, RK4_BOUND[law])


@pytest.mark.parametrize("law", list(LAWS))
@pytest.mark.parametrize("method", [method for method in SCHEMES if method != "rk4"])  # laws of a kind: see `test_laws`
def test_every_other_scheme_equals_the_twin(method, law):
    dt, bound = (5e-4, RK4_BOUND[law]) if SCHEMES[method].order == 4 else (2e-4, SECOND_ORDER_BOUND)
    check("pair", law, 76, 1.5, method, dt, bound)


OTHER_ROWS = [
    ("tall", "kelvin_voigt", 31, "rk4", 5e-4, 1e-5),
    ("paper", "linear", 251, "rk4", 5e-4, 1e-5),
    pytest.param("paper", "hertz_damped", 251, "rk4", 5e-4, 1e-5, marks=pytest.mark.slow),
    pytest.param("uneven", "kelvin_voigt", 101, "rk4", 5e-4, 1e-5, marks=pytest.mark.slow),
    pytest.param("four", "hertz_damped", 101, "rk4", 5e-4, 1e-5, marks=pytest.mark.slow),
    pytest.param("paper", "hertz_damped", 251, "newmark", 2e-4, 2e-3, marks=pytest.mark.slow),
    ("tall", "linear", 31, "rk4", 5e-4, 1e-5),
    ("tall", "linear", 31, "newmark", 2e-4, 2e-3),
    ("tall", "linear", 31, "exact", 5e-4, 1e-5),
    pytest.param("four", "kelvin_voigt", 101, "exact", 5e-4, 1e-5, marks=pytest.mark.slow),
    pytest.param("tall", "hysteretic", 31, "rk4", 5e-4, 1e-5, marks=pytest.mark.slow),
    ("paper", "hysteretic", 251, "newmark", 2e-4, 2e-3),
]


@pytest.mark.parametrize(("row", "law", "points", "method", "dt", "bound"), OTHER_ROWS)
def test_other_rows_equal_the_twin(row, law, points, method, dt, bound):
    check(row, law, points, 3.0 if row == "tall" else 1.0, method, dt, bound)


PEAKS = ("displacement_max", "displacement_min", "impact_force_max", "penetration_max", "impulse", "approach_speed_max")


@pytest.mark.slow
@pytest.mark.parametrize(("method", "dt", "bound"), [("rk4", 1e-3, 4e-6), ("newmark", 5e-4, 4e-3)])
def test_a_contact_yields_again_and_again(method, dt, bound):
    """Pressed against a wall while the ground shakes: more yielding and unloading than there are contacts."""
    t = np.arange(401) * 0.01
    pull = (
        -6.0 * np.minimum(t, 0.5) - 2.4 * np.sin(4.6 * np.pi * t) * (t > 0.5) - 3.0 * np.sin(18 * np.pi * t) * (t > 1.2)
    )
    scene = ps.Scene([ps.Building("b", [150.0], [4e3], damping_ratio=0.02), ps.Wall()], gaps=[0.004])
    record = ps.Record("push", 0.01, pull)
    got = ps.simulate(scene, record, law="hysteretic", stiffness=2e6, restitution=0.5, method=method, dt=dt)
    want = run(buildings_of(scene), [0.004], pull, 0.01, "hysteretic", 2e6, 0.5)
    count = int(want["impact_count"][0][0])
    assert want["event_count"] > 6 * count  # a contact that yields once has five events
    assert int(got.impact_count.sum()) == count
    found = errors(got, {**want, "law": "hysteretic"}, scene)
    assert max(found.values()) < bound, found
    mine, theirs = got.displacement.values[:: round(0.01 / dt), 0, 0], want["displacement"][0][:, 0]
    assert np.abs(mine - theirs).max() < bound * np.abs(theirs).max()


@pytest.mark.parametrize("law", [law for law in LAWS if law != "none"])
@pytest.mark.parametrize("method", SCHEMES)
def test_order_of_convergence(method, law):
    """All laws, also those whose force jumps at the touch, or rises there like t^1.5 or t^1/4."""
    order, total = error_by_step(PAIR, law, method, PEAKS, [2e-3, 1e-3, 5e-4, 2.5e-4], 76)
    assert order >= 0.9 * SCHEMES[method].order - 0.1 or total[-1] < (1e-8 if method == "exact" else 1e-10), (
        order,
        total,
    )  # exact between jumps: only rounding is left
    assert order < 6.0, (order, total)  # steeper would be an accident


@pytest.mark.parametrize("method", ["rk4", "exact"])
@pytest.mark.parametrize("law", ["kelvin_voigt"])
def test_a_touch_that_is_over_within_a_step_is_found(method, law):
    """Floors that come no nearer than a hair beyond the gap, between the ends of a step."""
    shake = {"law": law, "stiffness": 8e5, "restitution": 0.6, "method": method, "rest": 0.0}
    u = ps.simulate(ps.Scene([A, B], gaps=[1.0]), motion(76, 1.5), dt=1e-4, **shake).displacement
    closing = u.sel(building="a") - u.sel(building="b")
    nearest = float(closing.max())
    at_steps = float(closing.isel(time=slice(None, None, 100)).max())  # at the ends of those of 0.01 s
    gap = nearest - 0.5 * (nearest - at_steps)
    assert nearest > gap > at_steps
    one = ps.simulate(ps.Scene([A, B], gaps=[gap]), motion(76, 1.5), dt=1e-2, **shake)
    assert int(one.impact_count.sum()) == 1


def test_a_stiff_contact_has_steps_of_its_own():
    """A hundred times stiffer than the step resolves: the same as with steps of a fiftieth."""
    coarse = row_kernel("pair", "kelvin_voigt", "rk4", 1e-3)
    fine = replace(coarse, numerics=replace(coarse.numerics, dt=2e-5, refinement=4.0))
    one = ([1.0], [[0.006]], [1e8], [0.6])
    got, want = (run_lanes(kernel, motion(76, 1.5), *one) for kernel in (coarse, fine))
    assert want["count"].sum() >= 3
    for name in ("count", "fmax", "dmax", "impulse", "umax"):
        np.testing.assert_allclose(got[name], want[name], rtol=0, atol=2e-4 * np.abs(want[name]).max(), err_msg=name)


@pytest.mark.parametrize("law", ["kelvin_voigt", "hertz_damped"])
@pytest.mark.parametrize("method", ["rk4", "newmark"])
@pytest.mark.parametrize("locate", [False])
def test_unlocated_steps_converge_too(method, law, locate):
    order, total = error_by_step(PAIR, law, method, PEAKS, [2e-3, 1e-3, 5e-4, 2e-4, 1e-4, 5e-5], 76, locate=locate)
    assert order >= 0.8, (order, total)
    assert total[-1] < 2e-3


#: Scheme, law, whether contacts are located, the row, and by day whether `simulate` runs it or flight without history.
LANES_CASES = [
    *(("rk4", law, True, PAIR) for law in ("hertz_damped", "kelvin_voigt", "nonlinear_viscoelastic")),
    *(("newmark", law, True, PAIR) for law in ("kelvin_voigt", "hertz_damped", "modified_kelvin_voigt")),
    *((method, law, True, PAIR) for method in ("exact", "newmark") for law in ("hysteretic", "stereomechanical")),
    *(("exact", law, True, PAIR) for law in ("linear", "hertz_damped", "kelvin_voigt")),
    *((method, "hertz_damped", False, PAIR) for method in ("rk4", "newmark")),
    ("newmark", "kelvin_voigt", False, PAIR),
    *((method, "kelvin_voigt", True, YIELDS) for method in ("rk4", "exact")),
    *(pytest.param(method, "linear", True, SMOOTH) for method in SMOOTHING),
]


@pytest.mark.parametrize(("method", "law", "locate", "scene"), LANES_CASES)
def test_a_scenario_does_not_know_its_neighbours(method, law, locate, scene):
    kernel = RowKernel(scene, LAWS[law], Numerics(method, 2e-3, locate), reducers_for(ALL), history=True)
    found = run_in_any_company(kernel, motion(76), some_scenarios(CONTACT.reference(LAWS[law].exponent) or 0.0))
    assert len(np.unique(found["umax"][:, 1])) == 70
    assert 0 < np.count_nonzero(found["count"].sum(axis=1)) < 70


@pytest.mark.parametrize("precision", ["float64", pytest.param("float32", marks=pytest.mark.slow)])
@pytest.mark.parametrize("scene", [pair(), YIELDS], ids=["pair", "yields"])
def test_flown_scenarios_do_not_know_their_neighbours(scene, precision):
    kernel = RowKernel(scene, LAWS["kelvin_voigt"], Numerics("exact", 5e-4, precision=precision), reducers_for(EVERY))
    found = run_in_any_company(kernel, motion(151), some_scenarios(8e5))
    assert found["count"].sum() > 50
    assert scene is not YIELDS or np.count_nonzero(found["travel"].sum(axis=1)) > 10


def some_scenarios(stiffness, n=70):
    rng = np.random.default_rng(7)
    gaps = rng.uniform(0.0, 0.02, (n, 1))
    gaps[3], gaps[20] = 0.0, 1.0
    given = {"scale": rng.choice([-1.0, 1.0], n) * rng.uniform(0.2, 2.0, n), "gaps": gaps}
    return given | {"stiffness": stiffness * 10 ** rng.uniform(-0.7, 0.7, n), "restitution": rng.uniform(0.1, 1.0, n)}


def test_a_wild_neighbour_does_no_harm():
    """A scenario that leaves the range of numbers stays in its own lane."""
    kernel, record = row_kernel("pair", "kelvin_voigt", "rk4", 2e-3), motion(76)
    calm = run_lanes(kernel, record, [1.0], [[0.006]], [8e5], [1.0])
    mixed = run_lanes(kernel, record, [1.0, 1e300, 1.0], [[0.006]] * 3, [8e5, 8e5, 8e5], [1.0] * 3)
    assert mixed["flags"][1, 0] > 0
    for name, values in calm.items():
        assert np.array_equal(mixed[name][[0]], values), name
        assert np.array_equal(mixed[name][[2]], values), name
    values = variables_of(kernel, mixed, ["impact_count"], record)
    assert values["status"].tolist() == [Status.OK, Status.DIVERGED, Status.OK]


@pytest.mark.parametrize("method", SCHEMES)
@pytest.mark.parametrize(("law", "host"), [("linear", "kelvin_voigt"), ("hertz", "hertz_damped")])
def test_an_undamped_law_in_the_kernel_of_a_damped_one_to_the_last_bit(law, host, method):
    record = motion(76, 1.5)
    arguments = ([1.0, 0.7], [[0.006], [0.004]], [CONTACT.reference(LAWS[law].exponent)] * 2, [0.6, 0.6])
    own = run_lanes(row_kernel("pair", law, method, 1e-3), record, *arguments)
    guest = run_lanes(row_kernel("pair", law, method, 1e-3, host=host), record, *arguments)
    assert own["count"].sum() > 0
    for name, values in own.items():
        assert np.array_equal(guest[name], values), name


@pytest.mark.slow
def test_asking_for_less_changes_nothing():
    """A kernel without energies, histories and accelerations gives the same bits for what is left."""
    record = motion(76, 1.5)
    full = row_kernel("pair", "hertz_damped", "rk4", 1e-3)
    bare = RowKernel(PAIR, full.law, full.numerics, reducers_for(["impact_force_max", "impact_count", "drift_max"]))
    assert "energy" not in bare.shape.reducers
    arguments = {"scale": np.ones(1), "gaps": np.array([[0.006]]), "stiffness": np.array([7.5e6])}
    few = bare.run(record, restitution=np.array([0.6]), **arguments)
    many = run_lanes(full, record, restitution=np.array([0.6]), **arguments)
    assert set(few) < set(many)
    assert few["count"].sum() > 0
    for name, values in few.items():
        assert np.array_equal(values, many[name]), name


def test_flight_is_exact_whatever_the_step():
    """Buildings that touch nothing, in steps as long as the record's, against their modal solutions."""
    record = motion(251)
    far = ps.Scene([A, B], gaps=[1.0])
    given = {"stiffness": 8e5, "restitution": 0.6, "method": "exact", "dt": record.dt, "rest": 0.0}
    one = ps.simulate(far, record, law="kelvin_voigt", **given)
    for i, twin in enumerate(buildings_of(PAIR)):
        want = modal_exact(twin, record.acceleration, record.dt)[0]
        np.testing.assert_allclose(one.displacement.isel(building=i).values, want, rtol=0, atol=1e-12)
