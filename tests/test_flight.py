"""Exact flight and series: how modes move, what is left out of the record, contacts at any step, lanes."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import reference
from against_reference import buildings_of, motion, simulate
from hypothesis import given
from hypothesis import strategies as st
from kernels_used import LINKED
from kinds import DASHED
from reference import ShearBuilding, modal_exact
from scenes import EVERY, motions, pair
from scipy.linalg import expm
from test_foundations import exact, matrices
from test_properties import some_variants

import pounding_sweep as ps
from pounding_sweep.base.errors import SweepError
from pounding_sweep.engine.postprocess import variables_of
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel.modal_steps import step
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.model.building import Building
from pounding_sweep.model.laws import LAWS, get_law
from pounding_sweep.model.scene import Scene, Wall
from pounding_sweep.model.variants import coupled_modes, variants_of
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.variables.registry import Status, reducers_for


def kernel_of(scene, outputs=EVERY, law="kelvin_voigt", **numerics):
    return RowKernel(scene, get_law(law), Numerics("exact", 1e-3, **numerics), reducers_for(list(outputs)))


@given(st.floats(0.1, 300.0), st.sampled_from([0.0, 0.02, 0.7, 1.0 - 1e-7, 1.0, 1.0 + 1e-7, 3.0]), st.floats(-3.0, 1.0))
def test_a_mode_moves_as_the_matrix_exponential_says(w, ratio, log_turn):
    """From any start under a ground that is linear in time, under-, critically and over-damped."""
    h, c, push = 10.0**log_turn / w, 2.0 * ratio * w, 1.7
    state = np.zeros((4, 4))  # q, q', the ground, and its slope
    state[0, 1], state[1], state[2, 3] = 1.0, (-(w**2), -c, -push, 0.0), 1.0
    want = expm(state * h)[:2]
    want[:, 2:] = np.stack([want[:, 2] - want[:, 3] / h, want[:, 3] / h], axis=1)  # by the ground at both ends
    moves = step(np.full(1, w), np.full(1, c), push, h)
    got = np.array([[moves[f"{row}{column}"][0] for column in "qp01"] for row in "qp"])
    unit = np.outer([w, 1.0], [1.0 / w, 1.0, w, w])
    np.testing.assert_allclose(got * unit, want * unit, rtol=0, atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("windows", [True, False])
def test_what_is_left_out_changes_nothing(windows):
    """Windows of the record and blocks of it, against a flight that looks at all points."""
    scene, record, many = pair(), motions()[0], some_scenarios()
    every = replace(kernel_of(scene), windows=False).run(record, **many)
    quick = replace(kernel_of(scene, EVERY if windows else BLOCKS), windows=windows, varied=not windows)
    got = quick.run(record, **many)
    assert 0 < (every["count"].sum(axis=1) > 0).sum() < 70
    np.testing.assert_array_equal(got["count"], every["count"])
    for name in ("umax", "umin", "drift", "acc", "fmax", "dmax"):
        np.testing.assert_allclose(got[name], every[name], rtol=1e-9, atol=1e-12 * every[name].max(), err_msg=name)


@pytest.mark.slow
def test_a_graze_is_a_touch_and_a_near_miss_is_none():
    """The gap that is just closed, and peaks that nearly equal each other, to all digits but the last few."""
    scene, record = pair(), motions()[1]
    still = kernel_of(scene, ("closing_max",), "none")
    one = {"scale": np.ones(1), "stiffness": np.ones(1), "restitution": np.ones(1)}
    closing = float(still.run(record, gaps=np.zeros((1, 1)), **one)["closing"].max())
    kernel = kernel_of(scene)
    gaps = closing * (1.0 + np.array([-1e-3, -1e-6, -1e-8, 1e-12, 1e-8, 1e-3]))
    n = len(gaps)
    many = {"scale": np.ones(n), "stiffness": np.full(n, 8e5), "restitution": np.full(n, 0.6)}
    found = kernel.run(record, gaps=gaps[:, None], **many)
    assert (found["count"].sum(axis=1) > 0).tolist() == [True] * 3 + [False] * 3


def some_scenarios(n=70):
    rng = np.random.default_rng(3)
    return {
        "scale": rng.choice([-1.5, -1.0, 0.0, 0.7, 1.0, 1.3], n),
        "gaps": rng.choice([0.0, 0.001, 0.002, 0.004, 0.02], (n, 1)),
        "stiffness": 8e5 * 10.0 ** rng.uniform(-1.0, 1.0, n),
        "restitution": rng.uniform(0.2, 1.0, n),
    }


def test_tables_that_stay_are_those_of_their_record():
    kernel, (first, second), given = kernel_of(pair()), motions()[:2], some_scenarios()
    second = ps.Record("second", first.dt, second.acceleration[: first.n_points])

    def run(record):
        return kernel.run(record, **given)

    for record in (first, first, second, first):
        found = run(record)
        with ThreadPoolExecutor(1) as other:  # that has no tables yet
            alone = other.submit(run, record).result()
        for name, values in alone.items():
            np.testing.assert_array_equal(found[name], values, err_msg=name)


def finer(record, factor):
    """The same motion, linear between points, in steps that are shorter by a factor."""
    at = np.arange((record.n_points - 1) * factor + 1) / factor
    return ps.Record("finer", record.dt / factor, np.interp(at, np.arange(record.n_points), record.acceleration))


def test_peaks_do_not_depend_on_the_grid_of_flight():
    """Those of the motion without pounding beside exact steps, 200 in each of the record's, and with impacts."""
    scene, record, kernel = pair(), motions()[0], kernel_of(pair())
    apart = {"scale": np.ones(1), "stiffness": np.full(1, 8e5), "restitution": np.ones(1), "gaps": np.ones((1, 1))}
    alone = [ShearBuilding(list(b.masses), list(b.stiffnesses), rayleigh=b.rayleigh) for b in scene.buildings]
    fine = finer(record, 200)
    moved = np.concatenate([modal_exact(b, fine.acceleration, fine.dt)[0] for b in alone], axis=1)
    last = moved.argmax(axis=0)
    before, top, after = (moved[last + k, np.arange(len(last))] for k in (-1, 0, 1))
    want = top - (after - before) ** 2 / (8.0 * (after - 2.0 * top + before))  # of the parabola
    np.testing.assert_allclose(kernel.run(record, **apart)["umax"][0], want, rtol=1e-9)
    once, again = (kernel.run(each, **some_scenarios()) for each in (record, finer(record, 8)))
    assert once["count"].sum() > 100
    np.testing.assert_array_equal(once["count"], again["count"])
    for name in ("umax", "umin", "drift", "acc"):
        np.testing.assert_allclose(once[name], again[name], rtol=1e-9, atol=1e-12 * again[name].max(), err_msg=name)


def test_a_negative_scale_is_the_record_upside_down():
    kernel, record, given = kernel_of(pair()), motions()[0], some_scenarios()
    other = {**given, "scale": -given["scale"]}
    found, want = kernel.run(record, **given), kernel.run(record.scaled(-1.0), **other)
    np.testing.assert_array_equal(found["count"], want["count"])
    for name in ("umax", "umin", "fmax", "acc", "e_in"):
        np.testing.assert_allclose(found[name], want[name], rtol=1e-9, atol=1e-12 * np.abs(want[name]).max())


def test_equal_buildings_never_touch():
    a, b = (Building(name, [100.0, 80.0], [1e5, 9e4]) for name in "ab")
    kernel = kernel_of(Scene([a, b], gaps=[1e-9]))
    one = {"scale": np.ones(1), "stiffness": np.full(1, 8e5), "restitution": np.ones(1)}
    found = kernel.run(motions()[0], gaps=np.full((1, 1), 1e-9), **one)
    assert found["count"].sum() == 0
    assert found["umax"].max() > 1e-3


BLOCKS = [name for name in EVERY if "energy" not in reducers_for([name])]


@pytest.mark.parametrize(("windows", "outputs"), [(True, EVERY), (False, BLOCKS)])
@pytest.mark.parametrize(
    ("ground", "dt"), [([-200.0, 200.0], 0.01), ([100.0, -300.0], 0.01), ([-1.2, 0.8, 1.8, -2.9, 2.3, 0.8, 2.3], 0.02)]
)
def test_a_motion_that_goes_and_comes_back_in_a_step_has_its_peaks(ground, dt, windows, outputs):
    """From rest, or with two turns, so that its rate changes no sign from one end of the step to the other."""
    scene, record = pair(), ps.Record("few", dt, ground)
    kernel = replace(kernel_of(scene, outputs), windows=windows)
    one = {"scale": np.ones(1), "stiffness": np.full(1, 8e5), "restitution": np.ones(1)}
    found = kernel.run(record, gaps=np.ones((1, 1)), **one, twin=True)
    last = len(ground) - 1
    fine = np.interp(np.arange(2000 * last + 1) / 2000, np.arange(last + 1), ground)
    alone = [ShearBuilding(list(b.masses), list(b.stiffnesses), rayleigh=b.rayleigh) for b in scene.buildings]
    moved = [modal_exact(b, fine, record.dt / 2000)[0] for b in alone]
    drifted = [np.abs(np.diff(u, axis=1, prepend=0.0)) for u in moved]
    for name, values, best in (("umax", moved, np.max), ("umin", moved, np.min), ("drift", drifted, np.max)):
        want = best(np.concatenate(values, axis=1), axis=0)
        np.testing.assert_allclose(found[name][0], want, rtol=1e-5, atol=1e-7 * np.abs(want).max(), err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize(("windows", "outputs"), [(True, EVERY), (False, EVERY), (False, BLOCKS)])
def test_variants_side_by_side_are_those_of_their_own(windows, outputs, monkeypatch):
    """Tables of several rows of buildings in one call, and handed over in parts."""
    scene, record = Scene([Building("a", [100.0], [9e4]), Wall("w")], gaps=[0.004]), motions()[0]
    variants = some_variants(scene, 40)
    kernel = RowKernel(
        scene, get_law("linear"), Numerics("exact", 1e-3), reducers_for(list(outputs)), varied=True, windows=windows
    )
    rows = np.arange(80) % 40
    given = {"scale": np.ones(80), "gaps": np.full((80, 1), 0.004), "stiffness": np.full(80, 2e5)}
    given["restitution"] = np.ones(80)
    substeps = int(kernel.flight_substeps(record, variants).max())
    monkeypatch.setattr(RowKernel, "flight_substeps", lambda self, record, row=None: np.array([substeps]))
    found = kernel.run(record, **given, variants=variants[rows])
    assert 10 < (found["count"] > 0).sum() < 80
    monkeypatch.setattr("pounding_sweep.engine.row_kernel.TABLE_BYTES", 1)
    again = kernel.run(record, **given, variants=variants[rows])
    for name, values in found.items():
        np.testing.assert_array_equal(again[name], values, err_msg=name)
    for i in (0, 1, 7, 25):
        part = {name: values[[i]] for name, values in given.items()}
        alone = kernel.run(record, **part, variants=variants[[i]])
        for name, values in alone.items():
            np.testing.assert_array_equal(values[0], found[name][i], err_msg=name)


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
    "law", [law if law == "kelvin_voigt" else pytest.param(law, marks=pytest.mark.slow) for law in POLYNOMIAL]
)
def test_contacts_are_exact_at_the_step_of_the_record(law):
    scene, record = pair(0.003), motions()[0]
    record = ps.Record("short", record.dt, 2.0 * record.acceleration[:31])
    k, e = 1.5e6, 0.5
    ours = found(scene, law, record, [k], [e])
    other = reference.run(
        buildings_of(scene), scene.gaps, record.acceleration, record.dt, law, k, e, rtol=1e-12, atol=1e-14
    )
    assert other["impact_count"][0].sum() > 1
    np.testing.assert_array_equal(ours["count"][0], other["impact_count"][0])
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
        np.testing.assert_allclose(ours[name][0], want, rtol=1e-7, atol=atol, err_msg=name)
    for name, key in (("acc", "acceleration_max"), ("drift", "drift_max"), ("umax", "displacement_max")):
        np.testing.assert_allclose(ours[name][0], np.concatenate(other[key]), rtol=1e-5, err_msg=name)


def storey(period, mass):
    return Building(f"T = {period} s", [mass], [mass * (2.0 * np.pi / period) ** 2], 0.05)


@pytest.mark.parametrize(
    ("right", "stiffness", "points"),
    [(storey(0.3, 100.0), 1e9, 31), (storey(0.3, 0.01), 1e5, 31), (storey(0.02, 100.0), 1e6, 61)],
    ids=["stiff contact", "mass ratio", "short period"],
)
def test_rows_that_are_right_at_any_step_are_ok(right, stiffness, points):
    """Neither contacts much shorter than the step nor a period of four steps make series err."""
    scene, record = Scene([storey(0.44, 100.0), right], [1e-3]), motions()[0]
    ground, outputs = 2.0 * record.acceleration[:points], ["impact_force_max", "impact_count", "impulse"]
    kernel = RowKernel(scene, LAWS["kelvin_voigt"], Numerics("exact", 5e-3), reducers_for(outputs))
    given = {"gaps": np.array([scene.gaps]), "stiffness": np.array([stiffness]), "restitution": np.array([0.6])}
    record = ps.Record("short", record.dt, ground)
    ours = variables_of(kernel, kernel.run(record, scale=np.ones(1), twin=True, **given), outputs, record)
    assert ours["status"].tolist() == [Status.OK]
    other = reference.run(
        buildings_of(scene), scene.gaps, ground, record.dt, "kelvin_voigt", stiffness, 0.6, rtol=1e-12, atol=1e-15
    )
    assert other["impact_count"][0].sum() > 1
    for name in outputs:
        np.testing.assert_allclose(ours[name].ravel(), other[name][0], rtol=1e-7, err_msg=name)


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
        other = reference.run(
            buildings_of(scene), scene.gaps, record.acceleration, 0.02, "kelvin_voigt", k, e, rtol=1e-12, atol=1e-14
        )
        want = {name: np.concatenate(other[name]) for name in ("impulse", "contact_time", "impact_count")}
        np.testing.assert_array_equal(ours["count"][i], want["impact_count"])
        np.testing.assert_allclose(ours["impulse"][i], want["impulse"], rtol=1e-7)
        np.testing.assert_allclose(ours["tclosed"][i], want["contact_time"], rtol=1e-6)
