"""Scenarios that are refined: an accuracy is reached whatever the step that they begin with."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import AXES, EVERY, OUTPUTS, motions, row

import pounding_sweep as ps
from pounding_sweep.model.laws import LAWS
from pounding_sweep.outputs.variables import CHANGE, OK_CLAIM, SETTLED, Status, comparable, relative_errors
from pounding_sweep.plan import advice
from pounding_sweep.plan.advice import CLASSES, Curve, Measured
from pounding_sweep.run import refinement
from pounding_sweep.run.refinement import differences

FEW = {"laws": ["linear", "kelvin_voigt"], "gaps": [0.001, 0.003], "restitutions": [0.6], "audit": 0.0}


def make(**changes):
    return ps.Sweep(**{"scene": row(), "records": motions(), **AXES, **FEW, **changes})


def lying(monkeypatch, precision="float64"):
    """Measurements that promise everything for the coarsest steps."""
    curve = Curve((0.5, 1.0), (1e-9, 1e-12))
    keys = [("rk4", precision, law, kind) for law in LAWS for kind in CLASSES]
    known = Measured(dict.fromkeys(keys, curve), {("rk4", precision): 1.0}, {"quantile": 0.9})
    monkeypatch.setattr(advice, "load_measured", lambda: known)


def flat(cube):
    """Values of all scenarios of a cube, shape (scenarios, ...)."""
    dims = cube["status"].dims
    return {
        name: np.reshape(cube[name].values, (cube["status"].size, *cube[name].shape[len(dims) :]))
        for name in cube.data_vars
        if cube[name].dims[: len(dims)] == dims
    }


@pytest.mark.parametrize(
    ("accuracy", "precision"),
    [(1e-2, "float64"), (1e-4, "float64"), pytest.param(1e-5, "float32", marks=pytest.mark.slow)],
)
def test_a_table_that_lies_costs_time_and_no_truth(monkeypatch, accuracy, precision):
    """Where rounding hides what was asked for, a wider format finds it."""
    fine = flat(make(dt=1e-4).run(scheduler="synchronous"))
    lying(monkeypatch, precision)
    sweep = make(accuracy=accuracy, dt=None, method=None, precision=precision)
    found = flat(sweep.run(scheduler="synchronous"))
    assert (found["status"] == Status.OK).all()
    errors = np.max(list(relative_errors(OUTPUTS, found, fine).values()), axis=0)
    assert errors.max() <= accuracy
    assert (found["error_estimate"] <= accuracy).all()
    begun = motions()[0].dt / sweep.plan().steps.min()
    assert found["time_step"].min() < 0.3 * begun  # some needed more than the first halving


def test_the_estimate_is_a_fifth_of_the_difference_of_the_last_two_steps():
    one = {"laws": ["linear"], "gaps": [0.001], "stiffness_factors": [1.0], "records": motions()[0]}
    one |= {"method": "rk4", "precision": "float64"}
    found = flat(make(**one, accuracy=1e-3, dt=None).run(scheduler="synchronous"))
    twice = flat(make(**one, dt=2.0 * found["time_step"][0]).run(scheduler="synchronous"))
    by_hand = differences(comparable(OUTPUTS), twice, found)[0] / 5.0
    assert found["error_estimate"][0] == pytest.approx(by_hand, rel=0.5)


def test_scenarios_of_many_impacts_are_held_to_less(monkeypatch):
    lying(monkeypatch)
    plain = flat(make(accuracy=1e-4, dt=None, method=None).run(scheduler="synchronous"))
    monkeypatch.setattr(refinement, "GRAZES", 0.1)
    found = flat(make(accuracy=1e-4, dt=None, method=None).run(scheduler="synchronous"))
    most = found["impact_count"].reshape(len(found["status"]), -1).max(axis=1)
    assert (found["error_estimate"] <= 1e-4 / np.maximum(1.0, 10.0 * most)).all()
    assert (found["time_step"] < plain["time_step"]).any()
    assert (found["time_step"] <= plain["time_step"]).all()


def test_what_does_not_settle_says_so(monkeypatch):
    monkeypatch.setattr(refinement, "MOST_HALVINGS", 1)
    lying(monkeypatch)
    found = flat(make(accuracy=1e-6, dt=None, method=None).run(scheduler="synchronous"))
    unsettled = found["status"] == Status.UNSETTLED
    assert unsettled.any()
    np.testing.assert_array_equal(unsettled, (found["error_estimate"] > 1e-6))
    assert np.isfinite(found["displacement_max"][unsettled]).any()  # it has the values of the finest run


def test_a_scenario_is_refined_alike_whatever_is_beside_it(monkeypatch):
    lying(monkeypatch)
    whole = make(accuracy=1e-4, dt=None, method=None).run(scheduler="synchronous")
    monkeypatch.setattr("pounding_sweep.plan.plan.CHUNK_SECONDS", 0.0)
    parts = make(accuracy=1e-4, dt=None, method=None).run(scheduler="threads", workers=3)
    one = make(accuracy=1e-4, dt=None, method=None, gaps=[0.003]).run(scheduler="synchronous")
    np.testing.assert_array_equal(whole["run"], parts["run"])
    for name in whole.drop_vars(["run", "origin"]).data_vars:  # numbers of runs depend on what is asked for
        np.testing.assert_array_equal(whole[name].values, parts[name].values, err_msg=name)
        np.testing.assert_array_equal(whole[name].sel(gap=[0.003]).values, one[name].values, err_msg=name)


@pytest.mark.slow
def test_one_storey_beside_a_wall_reaches_it_too():
    """Transfers of energy between a light contact and a building are what no calibration had foreseen."""
    scene = ps.Scene([ps.Building("b", [200.0], [450e3], 0.02), ps.Wall("w")], [0.0024])
    outputs = ["impact_force_max", "energy_strain", "energy_transfer_max", "energy_transfer_min", "contact_work"]
    one = {"laws": "hertz_damped", "stiffnesses": 2e6, "restitutions": 0.8, "outputs": outputs}
    asked, fine = (
        flat(ps.Sweep(scene, "el_centro", **one, audit=0.0, **how).run(scheduler="synchronous"))
        for how in ({"accuracy": 1e-2}, {"dt": 1e-4})
    )
    errors = relative_errors(outputs, asked, fine)
    assert max(float(e[0]) for e in errors.values()) <= 1e-2


def test_a_given_step_tells_its_error_where_it_is_asked_to():
    names = [*OUTPUTS, "error_estimate"]
    plain, told, half = (
        flat(make(dt=dt, outputs=outputs).run(scheduler="synchronous"))
        for dt, outputs in ((0.005, OUTPUTS), (0.005, names), (0.0025, OUTPUTS))
    )
    touched = ~np.isnan(plain["steps_per_contact"])
    for name in OUTPUTS:
        np.testing.assert_array_equal(plain[name], told[name], err_msg=name)
    by_hand = np.max(list(relative_errors(OUTPUTS, plain, half).values()), axis=0)
    assert (told["error_estimate"][touched] > 0.0).all()
    # sub-steps of contacts are halved beside the step, so it is no more than about what a smaller step alone gives
    ratio = told["error_estimate"][touched] / by_hand[touched]
    assert 0.3 < np.median(ratio) < 3.0
    off = told["error_estimate"] > SETTLED
    np.testing.assert_array_equal(told["status"] == Status.UNSETTLED, off & (plain["status"] == Status.OK))


@pytest.mark.slow
def test_a_run_that_half_the_step_contradicts_is_not_ok():
    """Of scenarios that are ok by the rules and off by more than 5 %, all are told."""
    buildings = [ps.Building(b.name, b.masses, b.stiffnesses, 0.01) for b in row().buildings]
    outputs = ["impact_force_max", "displacement_max", "displacement_min"]
    sweep = {
        "scene": ps.Scene(buildings, row().gaps, row().contact),
        "records": ps.synthetic_record(3, duration=16.0, dt=0.02, pga=6.0),
        "laws": ["kelvin_voigt"],
        "gaps": [1e-4, 3e-4, 1e-3, 3e-3, 1e-2],
        "stiffness_factors": [1.0, 10.0],
        "restitutions": [0.9],
    }
    fine, plain, told = (
        flat(make(**sweep, dt=dt, outputs=[*outputs, *more]).run(scheduler="synchronous"))
        for dt, more in ((1e-4, ["error_estimate"]), (2e-3, []), (2e-3, ["error_estimate"]))
    )
    error = np.max(list(relative_errors(outputs, plain, fine).values()), axis=0)
    wrong = (plain["status"] == Status.OK) & (error > OK_CLAIM) & (fine["error_estimate"] < 0.1 * OK_CLAIM)
    assert wrong.any()
    assert (told["status"][wrong] == Status.UNSETTLED).all()


def test_the_amplification_is_that_of_all_inputs():
    cube = make(dt=0.005, laws="kelvin_voigt", outputs=[*OUTPUTS, "amplification"]).run(scheduler="synchronous")
    gap = float(cube["gap"].values[0])
    less = make(
        dt=0.005,
        laws="kelvin_voigt",
        gaps=[gap * (1.0 + CHANGE)],
        scales=[s * (1.0 - CHANGE) for s in cube["scale"].values.tolist()],
        stiffness_factors=[f * (1.0 + CHANGE) for f in cube["stiffness_factor"].values.tolist()],
    ).run(scheduler="synchronous")
    own = flat(cube.isel(gap=[0]))
    by_hand = np.max(list(relative_errors(OUTPUTS, flat(less), own).values()), axis=0) / CHANGE
    np.testing.assert_allclose(own["amplification"], by_hand, rtol=1e-3)
    assert (own["amplification"] > 0.5).all()  # displacements follow the ground motion at least


@pytest.mark.slow
def test_simulate_is_refined_as_a_sweep_is(monkeypatch):
    lying(monkeypatch)
    one = {"restitution": 0.6, "accuracy": 1e-4}
    got = ps.simulate(row().with_gaps([0.003, 0.003]), motions()[1], law="kelvin_voigt", **one)
    sweep = make(
        laws="kelvin_voigt", gaps=[0.003], stiffness_factors=[1.0], accuracy=1e-4, dt=None, method=None, outputs=EVERY
    )
    cube = sweep.run().sel(record=motions()[1].name).squeeze()
    for name in OUTPUTS:
        np.testing.assert_array_equal(got[name].squeeze(), cube[name], err_msg=name)
    assert got.attrs["time_step"] == cube["time_step"] <= motions()[1].dt / 4
    assert got.sizes["time"] == round(motions()[1].duration / got.attrs["time_step"]) + 1
