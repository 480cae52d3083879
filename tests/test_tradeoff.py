"""The speed-accuracy trade: its errors against the independent oracle, its marks, its file, its command."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
import reference
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.text import Text
from scenes import EVERY, TOML_PAIR, call, pair

import pounding_sweep as ps
from pounding_sweep.accuracy import tradeoff as module
from pounding_sweep.accuracy.tradeoff import draw, measure, plan_trial, summarise, table_of, tradeoff
from pounding_sweep.base.errors import InputError
from pounding_sweep.figures import FIGURES, plot
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.output.describe import describe
from pounding_sweep.output.netcdf import write_cube
from pounding_sweep.run.execute import Progress
from pounding_sweep.schemes import SCHEMES, reference_scheme
from pounding_sweep.variables.registry import VARIABLES

pytestmark = pytest.mark.usefixtures("stub_by_day")

STEPS = (2e-2, 2e-3, 1e-3, 5e-4)
LAWS = ["kelvin_voigt", "linear"]  # which share their kernels
METHODS = ["rk4", "newmark", "exact"]
SCENE = pair()
#: Few: each kernel of the eight kinds of runs takes half as long to compile.
OUTPUTS = ["displacement_max", "displacement_min", "impact_force_max", "impact_count", "penetration_max"]
EL_CENTRO = ps.find_record("el_centro")
SHORT = ps.Record("short", EL_CENTRO.dt, EL_CENTRO.acceleration[50:200])  # 3 s
TINY = TOML_PAIR.format(seconds=1.2) + f"gaps = [0.002, 0.004, 9.0]\n[output]\nvariables = {json.dumps(EVERY)}\n"


def make_sweep(**settings):
    gaps = settings.pop("gaps", [0.003, 0.005, 0.007, 5.0])
    return ps.Sweep(SCENE, settings.pop("records", SHORT), LAWS, gaps=gaps, **{"outputs": OUTPUTS, **settings})


@pytest.fixture(scope="module")
def sweep():
    return make_sweep()


@pytest.fixture(scope="module")
def trade(sweep):
    return tradeoff(sweep, steps=STEPS, scenarios=6, repeats=2, methods=METHODS, located=(True, False))


#: One configuration of each step alone, on few scenarios.
ONE = {"methods": ["rk4"], "precisions": ["float64"], "accuracies": (), "scenarios": 2, "repeats": 1}


def fixed(trade, **labels):
    """Settings of fixed steps of a trade, by what they are."""
    grid = trade.isel(setting=trade.step.notnull().values)
    return grid.set_index(setting=["scheme", "located", "precision", "step"]).unstack("setting").sel(labels)


def chosen(trade, **labels):
    return fixed(trade, **{"population": "all", "statistic": "worst", **labels})


@pytest.fixture(scope="module")
def oracle(trade):
    """Peak contact force and displacement of every scenario of the sample, by the independent integrator."""
    buildings = [reference.ShearBuilding(list(b.masses), list(b.stiffnesses)) for b in SCENE.buildings]
    found = []
    for i in range(trade.sizes["scenario"]):
        one = trade.isel(scenario=i)
        scenario = [one[f"scenario_{name}"].item() for name in ("law", "stiffness", "restitution")]
        gaps = one.scenario_gap.values.tolist()
        exact = reference.run(buildings, gaps, SHORT.acceleration, SHORT.dt, *scenario, rtol=1e-11, atol=1e-13)
        found.append({name: np.array(exact[name], float) for name in ("impact_force_max", "displacement_max")})
        assert found[-1]["impact_force_max"].max() > 0.0
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "located", "dt"), [("rk4", True, 2e-3), ("rk4", False, 1e-3), ("newmark", True, 2e-3)]
)
def test_errors_are_those_against_the_oracle(trade, oracle, method, located, dt):
    """Within a factor of 2, or below what the converged solution resolves; the cube of the same step is the witness."""
    compared = 0
    for i, want in enumerate(oracle):
        one = fixed(trade.isel(scenario=i), scheme=method, located=int(located), precision="float64", step=dt)
        case = {name: one[f"scenario_{name}"].item() for name in ("gap", "stiffness", "restitution")}
        cases = [{"law": law, **case} for law in LAWS]
        cube = ps.Sweep(SCENE, SHORT, cases=cases, outputs=OUTPUTS, method=method, dt=dt, locate=located, audit=0.0)
        got = cube.run(scheduler="synchronous").isel(case=LAWS.index(one.scenario_law.item()))
        for name, expected in want.items():
            error = np.abs(got[name].values - expected).max() / np.abs(expected).max()
            claimed = one.scenario_error.sel(output=name).item()
            floor = 3.0 * one.scenario_reference_error.sel(output=name).item() + 1e-9  # the oracle's own error
            assert claimed == pytest.approx(error, rel=1.0, abs=floor), (name, case)
            assert error <= 2.0 * claimed + floor, (name, case)
            compared += claimed > 10.0 * floor
    assert compared >= len(oracle)


@pytest.mark.parametrize(("gap", "scheme"), [(0.0, "exact"), (1e-6, "rk4")])
def test_floors_at_rest_have_an_exact_reference(gap, scheme):
    assert reference_scheme(SCENE, np.array([[0.01], [gap]])) == scheme
    smooth = ps.Building("a", [120.0], [1e4], yield_strengths=[50.0], hysteresis={"law": "bouc_wen"})
    beside = ps.Scene([smooth, ps.Building("b", [80.0], [2e4])], [0.0])
    assert (reference_scheme(beside, np.zeros((1, 1))) == "exact") == (SCHEMES["exact"].refuses(beside) is None)


@pytest.mark.slow
def test_errors_of_floors_at_rest_are_those_beside_exact_flight():
    """Three buildings at a gap of 0 magnify the error of any step of RK4; the reference tells how well it is known."""
    row = [ps.Building(n, [100.0 + 20.0 * i], [1e4 * (1.0 + i)]) for i, n in enumerate("abc")]
    scene = ps.Scene(row, [0.0, 0.0], ps.ContactProperties(linear_stiffness=8e5))
    sweep = ps.Sweep(scene, ps.synthetic_record(7, duration=20.0, pga=3.0), "linear", outputs=OUTPUTS)
    trade = tradeoff(sweep, methods=["rk4", "exact"], steps=[2e-3, 5e-4], precisions=["float64"], scenarios=1)
    assert trade.attrs["reference"].startswith("exact")
    force = chosen(trade, output="impact_force_max")
    known = float(force.reference_error)
    assert 0.0 < known < 1e-4
    assert float(force.error.sel(scheme="rk4").max()) > 100.0 * known
    assert float(force.error.sel(scheme="exact").max()) <= 10.0 * known


@pytest.mark.slow
def test_what_the_pages_say_of_errors(trade):
    def errors(output="impact_force_max", **labels):
        return chosen(trade, output=output, **{"precision": "float64", **labels}).error

    located, sampled = (errors(scheme="rk4", located=where, step=list(STEPS[1:])).values for where in (1, 0))
    assert (sampled > 100.0 * located).all()
    for scheme, least, most in (("rk4", 3.0, 5.5), ("newmark", 1.7, 2.4)):  # the order of located schemes
        coarse, fine = errors(
            "displacement_max", scheme=scheme, located=1, statistic="median", step=[2e-3, 5e-4]
        ).values
        assert least <= np.log(coarse / fine) / np.log(4.0) <= most
    double, single = (errors(scheme="rk4", located=1, step=STEPS[-1], precision=p) for p in ("float64", "float32"))
    assert 10.0 * double < single < 1e-2
    reference = trade.reference_error.sel(population="all", statistic="worst", output="impact_force_max").item()
    others = errors(scheme=["rk4", "newmark"])  # exact flight of the linear law errs by rounding alone
    assert 0.0 < reference < min(1e-7, float(others.where(others > 0).min()))
    assert trade.attrs["reference_step"] <= STEPS[-1] / 4


def test_every_output_has_an_error():
    found = tradeoff(make_sweep(outputs=EVERY), steps=STEPS[1:3], **{**ONE, "scenarios": 4})
    assert found.output.values.tolist() == [name for name in VARIABLES if name in EVERY]
    finest = chosen(found, scheme="rk4", precision="float64", located=1, step=STEPS[2])
    assert finest.error.sel(output="impact_count").item() == 0.0


def test_statuses_are_counted_and_errors_of_the_ok_apart(trade):
    assert (trade.status_count.sum("status") == trade.sizes["scenario"]).all()
    assert (trade.status_count.sel(status="beyond_stability_limit") == 0).all()  # a run refuses them
    counts = (trade.scenario_status == 0).sum("scenario")
    assert (counts == trade.status_count.sel(status="ok", drop=True)).all()
    coarse = fixed(trade, scheme="newmark", located=1, precision="float64", step=2e-2, statistic="worst")
    assert coarse.status_count.sel(status="ok").item() == 0
    assert np.isnan(coarse.error.sel(population="ok", output="impact_force_max").item())
    assert coarse.error.sel(population="all", output="impact_force_max").item() > 1e-2


@pytest.mark.slow
def test_a_diverged_scenario_has_an_infinite_error_and_is_never_on_the_front():
    own = {"method": "rk4", "dt": 5e-3, "locate": False}
    stiff = make_sweep(stiffness_factors=[1e4], gaps=[0.003], force_unstable=True, **own)
    found = tradeoff(stiff, steps=[5e-3], **{**ONE, "located": [False]})
    at = {"population": "all", "statistic": "worst", "output": "impact_force_max"}
    one = found.sel(setting="rk4, not located, 5 ms", **at)
    assert one.status_count.sel(status="diverged").item() >= 1
    assert np.isinf(one.error.item())
    assert one.pareto.item() == 0
    assert one.cost.item() > 0.0
    headings, rows = table_of(found)
    assert rows[0][headings.index("force worst")].strip() == "diverged"
    with pytest.raises(InputError, match="all is refused or diverged"):
        plot(found, "work-precision", "never.png")


def measured_of(sweep):
    axes = {"scheme": ["rk4"], "located": [True], "precision": ["float64"], "step": [2e-3, 1e-3]}
    trial = plan_trial(sweep.spec, axes, choices=(), scenarios=6, seed=0)
    return measure(trial, repeats=1, workers=1, progress=Progress())


@pytest.fixture(scope="module")
def measured(sweep):
    return measured_of(sweep)


def test_sensitive_scenarios_are_counted_and_kept_apart(measured):
    steady = summarise(measured)
    assert steady.attrs["sensitive_scenarios"] == 0
    assert (steady.sensitivity < 1e-3).all()
    third = measured.scenario == 3
    sensitivity, errors = measured.sensitivity.where(~third, 0.3), measured.scenario_error.where(~third, 0.5)
    found = summarise(measured.assign(sensitivity=sensitivity, scenario_error=errors))
    assert found.attrs["sensitive_scenarios"] == 1
    assert found.sensitive.values.tolist() == [0, 0, 1, 0, 0, 0]
    assert (found.error.sel(population=["all", "sensitive", "ok"], statistic="worst") == 0.5).all()
    rest = measured.scenario_error.where(~third).max("scenario")
    xr.testing.assert_equal(
        found.error.sel(population="steady", statistic="worst", drop=True), rest.transpose(..., "output")
    )


def test_a_change_of_the_inputs_is_what_finds_them():
    """A floor that only just touches: the smallest change of the inputs is a large one of the penetration."""
    grazing = float(run_without_pounding().closing_max.max()) * (1.0 - 1e-6)
    found = tradeoff(make_sweep(gaps=[grazing]), steps=[2e-3], **ONE)
    assert found.attrs["sensitive_scenarios"] == 2


def run_without_pounding():
    sweep = ps.Sweep(SCENE, SHORT, ["none"], outputs=[*EVERY, "closing_max"], dt=2.5e-4, audit=0.0)
    return sweep.run(scheduler="synchronous")


def test_errors_below_the_converged_solution_are_marked(measured):
    doubtful = measured.scenario_reference_error * 0.0 + 1e-3
    found = summarise(measured.assign(scenario_reference_error=doubtful))
    assert (found.resolved.sel(population="all") == 0).all()
    assert summarise(measured).resolved.sel(population="all", output="impact_force_max").all()
    headings, rows = table_of(found)
    assert all(row[headings.index("force worst")].startswith("<3.0e-03") for row in rows)
    front = found.pareto.sel(population="all", statistic="worst", output="impact_force_max")
    assert (front == (found.cost == found.cost.min())).all()


@pytest.mark.slow
def test_costs_are_those_of_the_sweeps_own_mix(sweep, trade):
    plan = sweep.plan()
    touching = module.find_touching(plan)
    laws = [law.key for law in plan.laws]
    share = {law: (plan.unique.law[touching] == laws.index(law)).mean() for law in LAWS}
    mixed = sum(share[law] * trade.law_cost.sel(law=law) for law in LAWS)
    np.testing.assert_allclose(trade.cost, mixed, rtol=1e-12)
    fine = fixed(trade, scheme="rk4", located=0, precision="float64", step=[2e-3, 5e-4]).cost.values
    assert 1.2 < fine[1] / fine[0] < 12.0  # four times the steps, on a busy machine
    assert (trade.cost_median >= trade.cost).where(trade.cost.notnull(), True).all()


def test_only_touching_scenarios_are_drawn_and_always_the_same(sweep):
    plan = sweep.plan()
    sample = draw(plan, 6, seed=3)
    assert len(sample.rows) == 6
    assert len(np.unique(sample.rows)) == 6
    assert sample.touching[sample.rows].all()
    assert (plan.unique.gaps[sample.rows] < 1.0).all()
    np.testing.assert_array_equal(draw(plan, 6, seed=3).rows, sample.rows)


NUMBERS = st.floats(1e-12, 1e3) | st.just(np.inf) | st.just(np.nan)


@given(st.lists(st.tuples(NUMBERS, NUMBERS), max_size=30))
def test_no_point_beats_one_on_the_front_and_some_point_beats_every_other(points):
    cost, error = np.array(points).reshape(-1, 2).T
    front = module.pareto_front(cost, error)
    usable = [(c, e) for c, e in points if np.isfinite(c) and np.isfinite(e)]
    for (c, e), on in zip(points, front, strict=True):
        if not (np.isfinite(c) and np.isfinite(e)):
            assert not on
        else:
            beaten = any(x <= c and y <= e and (x < c or y < e) for x, y in usable)
            assert on == (not beaten)
    assert front.any() == bool(usable)


def test_the_file_holds_everything(trade, sweep, tmp_path):
    path = write_cube(trade, tmp_path / "trade.nc")
    with ps.open_cube(path) as again:
        again.load()
    for name, variable in trade.variables.items():
        np.testing.assert_array_equal(again[name].values, variable.values, err_msg=str(name))
        assert again[name].dtype.kind == variable.dtype.kind
    assert set(again.attrs) == set(trade.attrs)
    assert json.loads(again.attrs["sweep"])["outputs"] == list(sweep.spec.outputs)
    assert json.loads(again.attrs["machine"])["lanes_per_kernel"] == LANES
    for variable in again.data_vars.values():
        assert {"long_name", "units"} <= set(variable.attrs) or "flag_values" in variable.attrs
    assert module.trade_rows(again) == module.trade_rows(trade)
    text = describe(again)
    assert "Speed-accuracy trade" in text
    assert "scenario_error" in text


def test_true_steps_are_reported_and_equal_ones_measured_once():
    own = make_sweep(gaps=[0.003], method="rk4", dt=4e-3)
    found = tradeoff(own, steps=[1.1e-3, 3e-3, 2.9e-3], **ONE)
    assert found.setting.values.tolist() == ["rk4, 3 ms", "rk4, 1.1 ms", "rk4, 4 ms"]
    np.testing.assert_allclose(found.time_step.values, [[0.02 / 7, 0.02 / 19, 0.02 / 5]])


@pytest.mark.parametrize(
    ("settings", "label"),
    [
        ({}, "accuracy 1e-3"),
        ({"accuracy": 2.5e-3}, "accuracy 2.5e-3"),
        ({"dt": 2e-3}, "exact, 2 ms"),
        ({"locate": False}, "rk4, not located, 1 ms"),
        ({"method": "rk4", "dt": 2e-2}, ""),  # beyond its stability limit
        ({"method": "newmark", "dt": 1e-2, "precision": "float32"}, "newmark, float32, 10 ms"),
    ],
)
def test_the_sweeps_own_setting_is_one_more(measured, settings, label):
    found = measured_of(make_sweep(**settings))
    assert found.attrs["own_setting"] == label
    assert set(found.setting.values.tolist()) == {"rk4, 2 ms", "rk4, 1 ms", label} - {""}
    same = found.scenario_error.sel(setting=["rk4, 2 ms", "rk4, 1 ms"])
    xr.testing.assert_allclose(same, measured.scenario_error.sel(setting=same.setting), rtol=1e-6)


def answered(trade, own="", **settings):
    """What is answered of settings by their cost and error; an accuracy is told by its name."""
    values = {label: (cost, error) for label, (cost, error) in settings.items()}
    labels, (costs, errors) = list(values), np.array(list(values.values())).T
    made = trade.isel(setting=[0] * len(labels)).assign_coords(setting=labels)
    made = made.assign_coords(accuracy=("setting", [float(x[1:]) if x[0] == "a" else np.nan for x in labels]))
    made = made.assign(cost=("setting", costs), resolution=made.resolution * 0.0, error=made.error * 0.0)
    made = made.assign(error=made.error + xr.DataArray(errors, dims="setting", coords={"setting": labels}))
    return module.answer(made.assign_attrs(own_setting=own))


def test_the_answer_is_the_cheapest_accuracy_as_strict_as_the_sweeps_own(trade):
    settings = {"a1e-2": (1.0, 1e-3), "a1e-3": (3.0, 1e-4), "a1e-4": (2.0, 1e-5), "exact": (0.5, 5e-4)}
    found = answered(trade, **settings, rk4=(4.0, 2e-4), own="rk4")
    assert [found[name]["setting"] for name in ("best", "own", "fastest")] == ["a1e-4", "rk4", "exact"]
    assert (found["solver"], found["wanted"]) == ({"accuracy": 1e-4}, 1e-3)
    assert answered(trade, **settings, own="a1e-2")["best"]["setting"] == "a1e-2"
    near = {**settings, "a1e-3": (2.1, 1e-4)}  # within the noise of the cheapest
    assert answered(trade, **near, own="a1e-3")["best"]["setting"] == "a1e-3"
    assert answered(trade, **near)["best"]["setting"] == "a1e-3"  # the default
    assert answered(trade, **near, own="a1e-2")["best"]["setting"] == "a1e-2"


def test_without_accuracies_a_step_is_the_answer(trade):
    found = answered(trade, exact=(2.0, 1e-4), rk4=(1.0, 1e-2), own="rk4")
    assert found["best"]["setting"] == "exact"
    assert set(found["solver"]) == {"method", "dt", "locate", "precision"}
    assert answered(trade, exact=(2.0, 1e-2), rk4=(1.0, 1e-1))["best"]["setting"] == "exact"
    diverged = answered(trade, exact=(2.0, np.inf), rk4=(1.0, np.inf))["best"]
    assert (diverged["setting"], diverged["error"]) == ("rk4", None)


def test_the_table_is_short_or_of_all_settings(trade):
    rows = table_of(trade)[1]
    refused = [("rk4", mode, form, 2e-2) for mode in (0, 1) for form in ("float32", "float64")]
    assert len(rows) == (2 * 2 + 1) * 2 * len(STEPS) - len(refused) + 3  # exact flight is always located
    short = table_of(trade, full=False)[1]
    labels = [row[0] for row in short]
    assert {"accuracy 1e-2", "accuracy 1e-4"} < {label.strip("*") for label in labels}
    assert any(label.endswith(" (yours)") for label in labels)
    assert sum("*" in label for label in labels) >= len(short) - 3
    costs = [float(row[1]) for row in short]
    assert costs == sorted(costs)


def test_the_figure_tells_schemes_and_cores(trade):
    words = " ".join(text.get_text() for text in FIGURES["work-precision"].draw(trade).findobj(Text))
    for label in ("none cheaper", "your setting", "accuracy", ", single precision", "one core", "lower left"):
        assert label in words
    panel = FIGURES["work-precision"].draw(trade).axes[0]
    assert len([line for line in panel.lines if line.get_linestyle() != "None"]) == 6
    with pytest.raises(InputError, match="pounding-sweep tradeoff"):
        plot(run_without_pounding(), "work-precision", "never.png")


@pytest.mark.parametrize(
    ("settings", "arguments", "text"),
    [
        ({}, {"steps": []}, "no steps"),
        ({}, {"steps": [1e-3, -1.0]}, "-1.0"),
        ({}, {"steps": [float("nan")]}, "nan"),
        ({}, {"methods": ["rk5"]}, "did you mean 'rk4'"),
        ({}, {"precisions": ["float16"]}, "float16"),
        ({}, {"methods": []}, "no method"),
        ({}, {"scenarios": 0}, "scenarios = 0"),
        ({}, {"repeats": 0}, "repeats = 0"),
        ({}, {"located": []}, "located"),
        ({"gaps": [5.0]}, {}, "no scenario of this sweep can touch"),
        ({"outputs": ["status"]}, {}, "impact_force_max"),
    ],
)
def test_what_can_not_be_measured_is_refused(settings, arguments, text):
    with pytest.raises(InputError, match=text):
        tradeoff(make_sweep(**settings), **arguments)


@pytest.fixture
def tiny(tmp_path):
    path = tmp_path / "tiny.toml"
    path.write_text(TINY)
    return path


def test_the_command_measures_writes_draws_and_prints(tiny, tmp_path, not_rendered, monkeypatch):
    monkeypatch.setenv("COLUMNS", "160")
    out, figure = tmp_path / "trade.nc", tmp_path / "trade.png"
    done = call("tradeoff", tiny, "-o", out, "--steps", "2e-3", "--scenarios", "2", "--plot", figure, "--quiet")
    lines = done.stdout.splitlines()
    assert lines[0].startswith("Take accuracy 1e-")
    block = lines.index("[solver]")
    assert re.fullmatch(r"accuracy = 1e-\d", lines[block + 1])
    table = next(line for line in lines if line.startswith("setting"))
    assert len(table) <= 100
    assert sum(line.startswith(("exact", "rk4", "accuracy")) and "e-" in line[20:] for line in lines) >= 4
    assert "2 of 2 touching scenarios are measured" in done.stdout
    assert lines[-2:] == [str(figure), str(out)]
    call("plot", out, "work-precision", "-o", tmp_path / "again.png")
    assert figure.exists()
    assert len(not_rendered) == 2
    call("tradeoff", tiny, "-o", out, code=2)


def test_the_command_prints_json(tiny):
    report = json.loads(call("tradeoff", tiny, "--steps", "2e-3", "--scenarios", "2", "--json", "--quiet").stdout)
    assert (report["sample_scenarios"], len(report["settings"])) == (2, 3 + 2 * 2)
    assert report["answer"]["best"]["accuracy"] in {1e-3, 1e-4}
    first = next(row for row in report["settings"] if row["setting"] == "rk4, 2 ms")
    assert first["scheme"] == "rk4"
    assert first["cost"] > 0.0
    assert set(first["errors"]["impact_force_max"]) == set(module.POPULATIONS)
    assert first["errors"]["impact_force_max"]["all"]["worst"]["value"] > 0.0


@pytest.mark.parametrize("steps", ["1e-3,fast", ""])
def test_the_command_names_wrong_steps(tiny, steps):
    assert "is no list of numbers" in call("tradeoff", tiny, "--steps", steps, code=2).stderr
