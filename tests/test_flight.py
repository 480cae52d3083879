"""Exact flight: how modes move, what it leaves out of the record, scenarios on their way through the lanes."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference import ShearBuilding, modal_exact
from scenes import EVERY, motions, pair
from scipy.linalg import expm
from test_properties import some_variants

import pounding_sweep as ps
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel.modal_steps import step
from pounding_sweep.model.building import Building
from pounding_sweep.model.laws import get_law
from pounding_sweep.model.scene import Scene, Wall
from pounding_sweep.variables.registry import reducers_for


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
