"""Scenarios that are refined: an accuracy is reached whatever the step that they begin with."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import AXES, EVERY, OUTPUTS, motions, row

import pounding_sweep as ps
from pounding_sweep.model.laws import LAWS
from pounding_sweep.output.audited import errors_sentence
from pounding_sweep.plan import advice
from pounding_sweep.plan.advice import CLASSES, Curve, Measured
from pounding_sweep.plan.scenarios import ChunkTask
from pounding_sweep.run import execute as execution
from pounding_sweep.run import refinement
from pounding_sweep.run.refinement import differences
from pounding_sweep.variables.registry import (
    AT_REST,
    CHANGE,
    DEFAULT_OUTPUTS,
    OK_CLAIM,
    OUTPUT_NAMES,
    SETTLED,
    Status,
    comparable,
    relative_errors,
)

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
    by_hand = differences(comparable(OUTPUTS), twice, found).max(axis=1)[0] / 5.0
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


def runs_of(monkeypatch, values):
    """Refine one scenario in single precision whose outputs are those of a formula; steps and formats of its runs."""
    runs = []

    def run_once(task):
        kernel = task.kernel
        n, halvings = len(task.table), int(np.log2(kernel.numerics.refinement / begun.numerics.refinement) + 0.5)
        runs.extend([(kernel.numerics.precision, halvings)] * n)
        displacement, count = values(kernel.numerics.precision, halvings)
        status = np.full(n, int(Status.OK), np.int8)
        named = {"unsettled_output": np.zeros(n, np.int8), "error_estimate": np.zeros(n), "status": status}
        return {"displacement_max": np.full((n, 1), displacement), "impact_count": np.full((n, 1), count)} | named

    plan = make(
        laws="linear", gaps=[0.003], stiffness_factors=[1.0], records=motions()[0], dt=None, method=None, accuracy=1e-3
    ).plan()
    begun = plan.kernel(0, record=0, steps=int(plan.steps[0]))
    assert begun.numerics.precision == "float32"
    monkeypatch.setattr(refinement, "run_once", run_once)
    outputs = ["displacement_max", "impact_count", "error_estimate"]
    table = plan.unique[:1]
    task = ChunkTask(begun, plan.spec.records[0], table, plan.variants[table.variant], outputs)
    return runs, Status(int(refinement.run_scenarios(task)["status"][0]))


SINGLE = [("float32", 1), ("float32", 0)]


@pytest.mark.parametrize(
    ("values", "doubles", "status"),
    [
        # what rounds is the run in single precision
        (lambda form, n: (1.0 + 0.01 * (form == "float32") * n, 7), [2, 1], Status.OK),
        # all is settled but a number of impacts, which never will be
        (lambda form, n: (1.0, 7 + n % 2), [2, 1], Status.UNSETTLED),
        # the difference falls by the order, late
        (lambda form, n: (1.0 + 16.0 ** (2 - n), 7), [2, 1, 3, 4, 5, 6], Status.OK),
        # it does not fall
        (lambda form, n: (1.0 + 0.01 * (n % 2), 7), [2, 1, 3, 4], Status.UNSETTLED),
    ],
)
def test_refinement_ends_where_finer_steps_change_nothing(monkeypatch, values, doubles, status):
    runs, ended = runs_of(monkeypatch, values)
    assert runs == [*SINGLE, *(("float64", n) for n in doubles)]
    assert ended == status


@pytest.mark.slow
def test_one_run_of_each_is_enough_where_a_sample_agrees(monkeypatch, tmp_path):
    monkeypatch.setattr("pounding_sweep.plan.plan.LEAST_SAMPLE", 8)
    sweep = {"laws": ["linear", "kelvin_voigt"], "gaps": np.linspace(0.001, 0.012, 12).tolist(), "restitutions": [0.6]}
    names = ("displacement_max", "displacement_min", "impact_force_max")

    def run(accuracy, **options):
        cube = make(**sweep, accuracy=accuracy, dt=None, method="exact", outputs=OUTPUTS).run(workers=2, **options)
        touching = ~np.isnan(cube["steps_per_contact"].values).ravel()
        estimates = ~np.isnan(cube["error_estimate"].values).ravel()
        values = {name: cube[name].values.reshape(len(touching), -1) for name in names}
        return cube, values, int((touching & estimates).sum()), int(touching.sum())

    (cube, values, judged, touching), (_, fine, every, _) = run(1e-2), run(1e-4)
    assert 0 < judged < 16 < touching == every
    errors = np.max([*relative_errors(names, values, fine).values()], axis=0)
    assert 0.0 < errors.max() < 1e-2
    assert "estimated in a sample of" in errors_sentence(cube, cube.attrs)
    assert "one run of each where a sample of them allows it" in cube.attrs["accuracy_choice"]
    again = run(1e-2, out=tmp_path / "again.nc")[1]
    for name in names:
        np.testing.assert_array_equal(again[name], values[name])
    monkeypatch.setattr(execution, "is_refined", lambda plan, rows, table: np.full(len(rows), True))
    assert run(1e-2)[2] == touching  # the sample disagrees: all run twice


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


def test_floors_that_rest_on_each_other_are_compared_with_half_the_step():
    """Either run errs as much as the other; a number of impacts is named where all else agrees."""
    sweep = {"gaps": [0.0, 0.003], "stiffness_factors": [0.5, 1.0, 2.0, 4.0, 8.0], "audit": 0.0}
    sweep["records"] = ps.synthetic_record(7, duration=20.0, pga=3.0)
    found, half = (flat(make(**sweep, dt=dt).run(scheduler="synchronous")) for dt in (0.002, 0.001))
    errors = relative_errors(OUTPUTS, found, half)
    motions_and_forces = 2.0 * np.max(
        [errors[name] for name in OUTPUTS if name in AT_REST and name != "impact_count"], axis=0
    )
    resting = np.tile(np.repeat([True, False], 5), 2)
    unsettled = resting & (np.maximum(motions_and_forces, errors["impact_count"]) > SETTLED)
    assert 3 < unsettled.sum() < 10
    np.testing.assert_array_equal(found["status"] == Status.UNSETTLED, unsettled)
    assert (found["status"][~resting] == Status.OK).all()
    names = np.array(OUTPUT_NAMES)[found["unsettled_output"].astype(int)]
    np.testing.assert_array_equal(names == "none", ~unsettled)
    np.testing.assert_array_equal(names == "impact_count", unsettled & (motions_and_forces <= SETTLED))
    for i in np.flatnonzero(unsettled & (motions_and_forces > SETTLED)):
        assert errors[names[i]][i] > SETTLED / 2.0


@pytest.mark.usefixtures("stub_engine")
def test_only_floors_at_rest_are_run_twice(stub_engine):
    counts = []
    for changes in ({"gaps": [0.001]}, {"gaps": [0.0]}, {"gaps": [0.0], "method": "exact"}):
        before = stub_engine.scenarios
        make(**changes, laws="linear", stiffness_factors=[0.5, 1.0], records=motions()[0]).run(workers=1)
        counts.append(stub_engine.scenarios - before)
    assert counts[0] == counts[2]
    assert counts[1] == counts[0] + 2


@pytest.mark.slow
@pytest.mark.parametrize(("method", "dt"), [("rk4", 5e-3), ("rk4", 1e-3), ("newmark", 1e-3), ("newmark", 1e-4)])
def test_no_step_passes_wrong_forces_of_floors_at_rest(method, dt):
    """Forces of three buildings that rest on each other, by an independent series solution; two of them stay ok."""
    buildings = [
        ps.Building("left", [200.0, 160.0], [1.6e5, 1.2e5]),
        ps.Building("middle", [220.0, 220.0, 180.0], [1.0e5, 0.9e5, 0.8e5]),
        ps.Building("right", [180.0, 150.0], [3.0e5, 2.5e5]),
    ]
    for n in (2, 3):
        scene = ps.Scene(buildings[:n], [0.0] * (n - 1), ps.ContactProperties(linear_stiffness=1e6, restitution=0.6))
        sweep = {"scene": scene, "laws": ["linear"], "gaps": None, "restitutions": [0.6], "audit": 0.0}
        sweep |= {"stiffness_factors": [0.25, 0.5, 1.0, 2.0, 4.0], "scales": [0.25, 0.5, 1.0]}
        sweep |= {"records": ps.synthetic_record(7, duration=20.0, pga=3.0), "outputs": DEFAULT_OUTPUTS}
        exact, found = (
            make(**sweep | {"method": m, "dt": h}).run(workers=2) for m, h in (("exact", 1e-3), (method, dt))
        )
        if n == 3:
            forces = exact["impact_force_max"].sel(scale=0.25, stiffness_factor=4.0).squeeze().values[:, :2]
            np.testing.assert_allclose(forces, [[2197.6, 2964.7], [1931.1, 3849.8]], rtol=5e-5)
        error = relative_errors(["impact_force_max"], flat(found), flat(exact))["impact_force_max"]
        ok = flat(found)["status"] == Status.OK
        assert error[ok].max() < 0.01
        assert ok.all() if n == 2 else not ok.all()


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
