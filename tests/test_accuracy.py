"""Accuracy asked for: what is chosen is measured against converged runs of scenarios that the calibration never saw."""

from __future__ import annotations

import json
import math
import re
import tomllib
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from reference import ShearBuilding, modal_exact, two_mass_impact
from scenes import OUTPUTS, pair, row

import pounding_sweep as ps
from pounding_sweep.base.errors import SweepError
from pounding_sweep.model.building import Building
from pounding_sweep.model.laws import LAWS, Law, get_law
from pounding_sweep.model.scene import Scene, Wall
from pounding_sweep.plan import advice
from pounding_sweep.plan.advice import CLASSES, Curve, Measured, classes_of, load_measured, shortest_contact
from pounding_sweep.plan.plan import make_plan
from pounding_sweep.records import Record, synthetic_record
from pounding_sweep.request.build import build_spec
from pounding_sweep.request.spec import with_accuracy
from pounding_sweep.run.execute import Dispatcher, execute
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.variables.registry import VARIABLES, Status, comparable, relative_error, relative_errors

pytestmark = pytest.mark.usefixtures("stub_by_day")


def motions():
    return [
        synthetic_record(501, duration=5.0, dt=0.02, pga=3.0, name="one"),
        synthetic_record(502, duration=5.0, dt=0.01, pga=4.0, ground_frequency=8.0, name="two"),
    ]


AXES = {
    "laws": ["linear", "hertz", "kelvin_voigt", "hertz_damped", "none"],
    "gaps": [0.003, 0.006, 0.012, 0.02],
    "stiffness_factors": [0.1, 1.0, 10.0],
    "restitutions": [0.3, 0.7],
    "outputs": OUTPUTS,
}


def make(**changes):
    return Sweep(**{"scene": row(), "records": motions(), **AXES, **changes})


def values_of(sweep):
    """Results of the unique scenarios."""
    plan = sweep.plan()
    results = execute(plan, Dispatcher("synchronous", 1)).results
    return results.gather(np.arange(len(results.status)))


@pytest.fixture(scope="module")
def converged():
    """Unique scenarios at a tiny step, and which of them an eighth of the step changes by less than 1e-5."""
    exact = values_of(make(dt=2.5e-5, audit=0))
    plain = values_of(make(dt=2e-4, audit=0))
    assert (exact["status"] == Status.OK).all()
    known = np.max(list(relative_errors(OUTPUTS, plain, exact).values()), axis=0) < 1e-5
    assert known.mean() > 0.95
    return exact, known


@pytest.mark.slow
@pytest.mark.parametrize(
    ("asked", "least"),
    [
        ({"accuracy": 1e-2}, 0.99),
        pytest.param({"accuracy": 1e-3}, 0.99, marks=pytest.mark.release),
        ({"accuracy": 1e-4}, 0.99),
        ({"accuracy": 1e-6}, 0.99),
        ({"accuracy": 1e-2, "method": "newmark"}, 0.98),
        pytest.param({"accuracy": 1e-3, "method": "newmark"}, 0.98, marks=pytest.mark.release),
        ({"accuracy": 1e-2, "precision": "float32"}, 0.98),
        ({"accuracy": 1e-3, "precision": "float32"}, 0.98),
    ],
    ids=str,
)
def test_what_is_asked_for_is_reached(converged, asked, least):
    """But for a number of impacts, one off where floors graze each other by less than the error that is allowed."""
    exact, known = converged
    values = values_of(make(**asked, audit=0))
    assert (values["status"] == Status.OK).all()
    assert (np.isfinite(values["steps_per_contact"]) & known).sum() > 60
    for name, error in relative_errors(OUTPUTS, values, exact).items():
        share = least if name == "impact_count" else 1.0
        assert (error[known] <= asked["accuracy"]).mean() >= share, (name, np.sort(error)[-9:])


@pytest.mark.slow
@pytest.mark.parametrize("law", ["hertz_damped", "linear"])
def test_noise_of_a_few_points_is_within_it_too(law):
    """What excites high modes at every point: peaks between these, twice in a step, and steps beside contacts."""
    outputs = ["displacement_max", "drift_max", "acceleration_max", "impact_force_max", "approach_speed_max"]
    errors = []
    for seed in range(1000, 1030):
        rng = np.random.default_rng(seed)
        record = Record("noise", float(rng.choice([0.01, 0.02])), rng.normal(0.0, 4.0, rng.integers(8, 40)))
        sweep = {"gaps": [1e-4, 1e-3, 4e-3], "outputs": outputs, "method": "exact", "audit": 0}
        runs = ({"accuracy": 1e-3}, {"method": "rk4", "dt": 1e-4, "precision": "float64"})
        cubes = (Sweep(ps.get_preset("mate2015"), record, law, **sweep | each).run(workers=1) for each in runs)
        found = ({name: cube[name].values.reshape(3, -1) for name in outputs} for cube in cubes)
        errors.append(np.max(list(relative_errors(outputs, *found).values())))
    assert np.mean(np.array(errors) <= 1e-3) >= 0.95
    assert np.max(errors) < 2e-3


def test_smaller_errors_cost_more():
    costs = []
    for accuracy in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6):
        plan = make(accuracy=accuracy, method="rk4", precision="float64").plan()
        costs.append(plan.summary()["seconds"])
        assert (plan.steps * 1.0 >= np.array([r.dt for r in motions()])[plan.unique.record] / plan.limit).all()
    assert all(fine >= coarse for coarse, fine in pairwise(costs))
    assert costs[2] > 1.5 * costs[0]
    assert costs[4] > 1.5 * costs[2]


def test_the_loosest_accuracies_begin_with_the_same_steps():
    loosest, loose = (make(accuracy=accuracy).plan() for accuracy in (1e-1, 1e-2))
    assert (loosest.numerics, loosest.steps.tolist()) == (loose.numerics, loose.steps.tolist())
    assert "0.1: exact float32" in loosest.choice


@pytest.mark.parametrize("dt", [0.02, 0.001])
def test_what_is_elastic_flies_however_short_the_intervals_of_the_record(dt):
    record = synthetic_record(503, duration=5.0, dt=dt, pga=3.0)
    plan = Sweep("mate2015", record, ["linear", "hertz"], gaps=[0.01], accuracy=1e-3).plan()
    assert plan.numerics.method == "exact"
    assert min(plan.choice_numbers["relative_cost_of_others"].values()) > 1.0


def test_contacts_by_series_run_together_however_stiff():
    steps = [make(laws=law, records=motions()[0], accuracy=1e-3).plan().steps for law in ("linear", "hertz")]
    assert [len(np.unique(counts)) for counts in steps] == [1, 2]


@pytest.mark.parametrize(
    "changes",
    [
        {"accuracy": 1e-3},
        {"gaps": [0.0, 0.002]},
        {"laws": ["linear", "hertz"]},
        {"precision": "float64"},
        {
            "scene": Scene(
                [replace(b, yield_strengths=[50.0] * b.n_storeys) for b in row().buildings], row().gaps, row().contact
            )
        },
    ],
)
def test_what_magnifies_errors_always_runs_twice(changes):
    sweep = {"laws": "linear", "gaps": [0.001, 0.002], "accuracy": 1e-2}
    assert make(**sweep).plan().once
    assert not make(**sweep | changes).plan().once


def test_the_cube_says_what_was_chosen(tmp_path):
    out = tmp_path / "out.nc"
    sweep = make(accuracy=1e-3, laws=["linear", "kelvin_voigt", "none"])
    cube = sweep.run(out, scheduler="threads", workers=2)
    plan = sweep.plan()
    steps = np.array([r.dt for r in motions()])[plan.unique.record] / plan.steps
    touched = ~np.isnan(cube["steps_per_contact"].values.ravel())
    halvings = np.log2(steps[plan.inverse][touched] / cube["time_step"].values.ravel()[touched])
    assert (halvings >= 1.0 - 1e-9).all()
    np.testing.assert_allclose(halvings, np.rint(halvings), atol=1e-9)
    # what never touches is the run without pounding, whose step may be larger
    alone = cube["time_step"].sel(law="none")
    assert (cube["time_step"].where(np.isnan(cube["steps_per_contact"])) <= alone.max()).any()
    assert cube.attrs["accuracy"] == 1e-3
    assert cube.attrs["method"] in ("rk4", "exact")
    assert "time_step" not in cube.attrs
    said = cube.attrs["accuracy_choice"]
    for part in ("0.001", cube.attrs["method"], cube.attrs["precision"], "steps per record interval", "times the cost"):
        assert part in said
    numbers = json.loads(cube.attrs["accuracy_numbers"])
    assert numbers["refinement"]["linear"] > 0.0
    assert numbers["relative_cost_of_others"]["newmark float64"] > 1.0
    with ps.open_cube(out) as stored:
        assert stored["time_step"].attrs["units"] == "s"
        np.testing.assert_array_equal(stored["time_step"], cube["time_step"])
    assert json.loads(cube.attrs["sweep"])["accuracy"] == 1e-3


@pytest.mark.slow
def test_long_records_of_undamped_buildings_take_smaller_steps():
    """The period error of a fixed step adds up over the record, which nothing forgets."""
    undamped = Scene([Building(b.name, b.masses, b.stiffnesses, 0.0) for b in row().buildings], row().gaps)
    found = []
    for duration in (5.0, 500.0):
        record = synthetic_record(7, duration=duration, dt=0.02)
        found.append(int(Sweep(undamped, record, "none", accuracy=1e-4, method="rk4").plan().steps[0]))
    assert found[1] > 1.5 * found[0]
    # the promise holds there too
    run = {"records": synthetic_record(7, duration=120.0, dt=0.02), "laws": "none", "outputs": ["displacement_max"]}
    exact = Sweep(undamped, dt=5e-4, **run).run(scheduler="synchronous")["displacement_max"].values.reshape(1, -1)
    for method in ("rk4", "exact"):
        asked = Sweep(undamped, accuracy=1e-4, method=method, **run).run(scheduler="synchronous")
        assert relative_error("displacement_max", asked["displacement_max"].values.reshape(1, -1), exact)[0] < 1e-4


def test_a_method_that_is_named_is_kept():
    plan = make(accuracy=1e-3, method="newmark").plan()
    assert plan.numerics.method == "newmark"
    assert "newmark float" in plan.choice
    assert plan.steps.mean() > 2 * make(accuracy=1e-3).plan().steps.mean()
    plan = make(method="rk4", dt=0.005).plan()  # without accuracy nothing is chosen
    assert (plan.choice, plan.outputs, set(plan.steps.tolist())) == ("", plan.spec.outputs, {4, 2})


def largest_error(one, exact):
    """Largest relative error of an output of one scenario."""
    errors = relative_errors(OUTPUTS, *({name: run[name].values[None] for name in OUTPUTS} for run in (one, exact)))
    return max(float(error[0]) for error in errors.values())


def test_simulate_needs_the_wide_format_for_its_energies():
    """The format that is asked for stays, as far as it reaches the accuracy."""
    assert make(scene=pair(), laws="linear", accuracy=1e-2).plan().numerics.precision == "float32"
    wide, named = (
        ps.simulate(pair(), motions()[1], law="linear", accuracy=1e-2, precision=asked) for asked in (None, "float32")
    )
    assert (wide.attrs["precision"], named.attrs["precision"]) == ("float64", "float32")
    assert largest_error(named, wide) < 2e-2


def test_simulate_allows_for_the_speed_at_the_start():
    still = Record("still", 0.01, np.zeros(20))
    steps = []
    for speed in (0.01, 10.0):
        spec = build_spec(scene=row(), records=still, laws="hertz", stiffnesses=1e8, accuracy=1e-4)
        steps.append(int(make_plan(spec, initial_speed=speed).steps[0]))
    assert steps[1] > 2 * steps[0]  # 1000 ** 0.2 = 4 times as short a contact


def measured(**curves):
    """Made-up measurements: the same curve for all but the given (method, law) pairs."""
    usual = Curve((1.0, 10.0, 1000.0), (1e-1, 1e-3, 1e-7))
    every = {
        (method, "float64", law, kind): curves.get(f"{method}_{law}", usual)
        for method in ("rk4", "newmark")
        for law in LAWS
        for kind in CLASSES
    }
    about = {"quantile": 0.95, "safety": 2.0}
    return Measured(every, {("rk4", "float64"): 3.0, ("newmark", "float64"): 5.0}, about)


def advised(monkeypatch, known, **changes):
    monkeypatch.setattr(advice, "load_measured", lambda: known)
    return make(**changes).plan()


def test_the_cheaper_scheme_that_reaches_it_is_chosen(monkeypatch):
    assert advised(monkeypatch, measured(), accuracy=1e-3).numerics.method == "rk4"
    slow, poor = Curve((1.0, 100.0, 1e6), (1e-1, 1e-2, 1e-7)), Curve((1.0, 10.0), (1e-1, 1e-3))
    plan = advised(monkeypatch, measured(**{f"rk4_{law}": slow for law in AXES["laws"]}), accuracy=1e-3)
    assert plan.numerics.method == "newmark"
    assert "rk4 float64: " in plan.choice
    assert advised(monkeypatch, measured(rk4_linear=poor), accuracy=1e-4).numerics.method == "newmark"
    known = measured(rk4_linear=poor, newmark_linear=poor)
    reached = r"rk4 float64 reaches 0\.001 with law linear, newmark float64 reaches 0\.001"
    with pytest.raises(SweepError, match=rf"0\.0001 was not reached.*{reached}"):
        advised(monkeypatch, known, accuracy=1e-4)
    known.curves.pop(("rk4", "float64", "hertz", "contacts"))
    with pytest.raises(SweepError, match=r"no errors of law 'hertz' with rk4.*benchmarks\.calibrate"):
        advised(monkeypatch, known, accuracy=1e-4)


def test_a_law_of_ones_own_begins_as_the_one_that_asks_for_most(monkeypatch):
    known = measured(rk4_gonthier=Curve((1.0, 30.0, 1e6), (1e-1, 1e-2, 1e-7)))
    law = Law(key="mine", exponent=2.0, reference_stiffness=1e7)
    settings = {"scene": pair(), "records": motions()[0], "stiffness_factors": None, "method": "rk4"}
    plan = advised(monkeypatch, known, **settings, accuracy=1e-3, laws=["linear", "gonthier", law, "none"])
    needed = plan.choice_numbers["steps_in_shortest_time"]
    assert needed["mine"] == needed["gonthier"] > needed["linear"]
    assert plan.choice_numbers["laws_not_measured"] == ["mine"]
    poor = Curve((1.0, 10.0), (1e-1, 2e-2))
    with pytest.raises(SweepError, match=r"rk4 float64 reaches 0\.02 with law mine"):
        advised(monkeypatch, measured(rk4_gonthier=poor), **settings, accuracy=1e-2, laws=[law])


def test_every_law_was_measured():
    uneven = Curve((1.0, 2.0, 4.0, 8.0), (1e-5, 1e-2, 1e-3, 1e-6))  # a lucky coarse step is not used
    assert uneven.needed(1e-4) > 4.0 > uneven.needed(0.5) == 1.0
    known = load_measured()
    for law in LAWS.values():
        # a jump leaves floors at rest on each other, and how they rest depends on the step: lower order, other counts
        finest = 1e-2 if law.impulsive else 1e-6
        for kind in CLASSES:
            double, single = (known.curves["rk4", precision, law.key, kind] for precision in ("float64", "float32"))
            newmark = known.curves["newmark", "float64", law.key, kind]
            assert double.needed(finest) < 200, (law.key, kind)
            assert single.error[-1] > double.error[-1], (law.key, kind)
            assert newmark.needed(1e-3) > double.needed(1e-3), (law.key, kind)
    for precision in ("float64", "float32"):
        assert 0.2 < known.cost["rk4", precision] / known.cost["newmark", precision] < 2.0
        assert 0.2 < known.cost["exact", precision] / known.cost["rk4", precision] < 10.0  # a long step


def test_every_output_has_a_class():
    found = {name: variable.error for name, variable in VARIABLES.items()}
    assert {name for name in found if name not in comparable(VARIABLES)} == {
        *("status", "energy_residual", "steps_per_contact", "time_step", "error_estimate", "amplification"),
        *("origin", "run", "unsettled_output"),
    }
    assert set(found.values()) <= {*CLASSES, "unmeasured", ""}
    assert "closing_max" in CLASSES["motions"]
    assert classes_of(["impact_force_max", "drift_max", "status"]) == ("motions", "contacts")
    assert classes_of(["status"]) == ("motions",)


@pytest.mark.parametrize(("law", "k"), [("linear", 2e5), ("hertz", 1e6)])
def test_durations_are_those_of_two_masses(law, k):
    for speed in (0.05, 0.8):
        exact = two_mass_impact(law, k, 1.0, 100.0, 80.0, speed)["duration"]
        found = advice.elastic_duration(LAWS[law].exponent, np.array(k), np.array(100 * 80 / 180), np.array(speed))
        assert float(found) == pytest.approx(exact, rel=1e-6)


def test_the_shortest_contact_is_that_of_the_lightest_pair():
    scene = Scene([Building("a", [100.0, 20.0], [1e4, 1e4]), Building("b", [80.0, 10.0], [1e4, 1e4])], [0.01])
    k = np.array([1e5, 4e5])
    found = shortest_contact(scene, get_law("linear"), k, np.ones(2), np.zeros((2, 1)))
    np.testing.assert_allclose(found, math.pi * np.sqrt(20 * 10 / 30 / k))
    strong = shortest_contact(scene, get_law("modified_kelvin"), k, np.full(2, 0.1), np.zeros((2, 1)))
    np.testing.assert_allclose(strong, found / math.sqrt(1 + 3 * 0.9 / 0.2))
    assert np.isinf(shortest_contact(scene, get_law("stereomechanical"), k, np.ones(2), np.zeros((2, 1)))).all()


def test_speeds_are_those_of_the_first_modes():
    record = synthetic_record(9, duration=4.0)
    scene = Scene([Building("a", [100.0], [1.0e4]), Building("b", [80.0], [2.5e4]), Wall()], [0.01, 0.01])
    velocities = [
        modal_exact(ShearBuilding(list(b.masses), list(b.stiffnesses)), record.acceleration, record.dt)[1][:, -1]
        for b in scene.buildings
    ]
    expected = [np.abs(velocities[0] - velocities[1]).max(), np.abs(velocities[1]).max()]
    np.testing.assert_allclose(advice.approach_speeds(scene, record), [expected], rtol=1e-9)


def test_errors_of_one_range_share_their_scale():
    up, down = np.array([[0.1, 0.2]]), np.array([[-1e-6, -2e-6]])
    off = {"displacement_max": up, "displacement_min": down * 1.5}
    found = relative_errors(list(off), off, {"displacement_max": up, "displacement_min": down})
    assert found["displacement_min"][0] == pytest.approx(5e-6)
    # an undamped contact takes in no work: its rounding errors are small beside what passed through it
    values = {"contact_work": np.array([[3e-9]]), "impact_force_max": np.array([[100.0]])}
    values["penetration_max"] = np.array([[0.01]])
    found = relative_errors(list(values), values, {**values, "contact_work": np.array([[1e-9]])})
    assert found["contact_work"][0] == pytest.approx(2e-9)
    assert relative_error("contact_work", np.array([[3e-9]]), np.array([[1e-9]]))[0] == pytest.approx(2.0)


def test_floors_that_rest_on_each_other_from_the_start_touch_at_no_time_that_has_digits():
    for name, least in (("first_impact_time", 0.01), ("approach_speed_max", 1e-4)):
        near, late = np.array([[1e-13, 2e-13], [0.5, 0.6]]), np.array([[3e-12, 2e-13], [0.5, 0.606]])
        assert relative_error(name, late, near) == pytest.approx([2.9e-12 / least, 0.01])


@pytest.mark.parametrize("path", sorted((Path(__file__).parents[1] / "sweeps").glob("*.toml")), ids=lambda p: p.stem)
def test_shipped_sweeps_tell_what_the_work_of_their_contacts_is_small_beside(path):
    outputs = tomllib.loads(path.read_text()).get("output", {}).get("variables", [])
    if "contact_work" in outputs:
        values = {name: np.ones((1, 1)) for name in outputs}
        off, none = ({**values, "contact_work": np.array([[work]])} for work in (3e-9, 1e-9))
        assert relative_errors(outputs, off, none)["contact_work"][0] == pytest.approx(2e-9)


@pytest.mark.parametrize(
    ("settings", "method", "accuracy", "says"),
    [
        ({}, None, 1e-3, "0.001: exact"),
        ({"dt": 2e-3}, "exact", None, "none: exact at steps of 0.002 s"),
        ({"locate": False}, "rk4", None, "none: rk4 at steps of 0.001 s, since locate = false"),
        ({"method": "newmark"}, "newmark", None, ""),
        ({"dt": 2e-3, "force_unstable": True}, "exact", None, "none: exact at steps of 0.002 s"),
    ],
)
def test_what_is_not_named_is_the_best_there_is(settings, method, accuracy, says):
    plan = Sweep("mate2015", "el_centro", "hertz", gaps=[0.01], **settings).plan()
    assert (plan.spec.method, plan.spec.accuracy) == (method, accuracy)
    assert plan.choice.startswith(says)
    assert (says == "") == (plan.choice == "")


def test_a_default_accuracy_that_cannot_be_kept_gives_way_to_a_step(monkeypatch):
    """No row that runs is refused for what nobody asked; an accuracy that is asked for is."""
    monkeypatch.setattr(advice, "load_measured", lambda: Measured({}, {}, {"quantile": 0.9}))
    plan = Sweep("mate2015", "el_centro", "hertz", gaps=[0.01]).plan()
    assert (plan.numerics.method, plan.numerics.dt, plan.spec.accuracy) == ("exact", 1e-3, None)
    assert re.fullmatch("none: exact at steps of 0.001 s, since accuracy: no errors .* were measured.*", plan.choice)
    with pytest.raises(SweepError, match="accuracy: no errors"):
        Sweep("mate2015", "el_centro", "hertz", gaps=[0.01], accuracy=1e-3).plan()


def test_an_accuracy_leaves_a_scheme_alone_only_if_it_was_named():
    given = {"scene": "mate2015", "records": "el_centro", "laws": "hertz", "gaps": [0.01]}
    assert make_plan(with_accuracy(build_spec(**given, dt=1e-3), 1e-4)).numerics.method == "exact"
    assert make_plan(with_accuracy(build_spec(**given, method="rk4", dt=1e-3), 1e-4)).numerics.method == "rk4"


def test_a_simulation_keeps_instants_of_a_millisecond(stub_engine):
    one = ps.simulate("mate2015", "el_centro", law="hertz", gaps=0.01)
    assert one.attrs["accuracy"] == 1e-3
    assert one.attrs["precision"] == "float64"
    assert np.diff(one.time).max() <= 1e-3 * (1.0 + 1e-9)
