"""The planner: what it leaves out must not matter, what matters it must not; what cannot be modelled is said."""

from __future__ import annotations

import dataclasses
import inspect
import itertools
import math
import re
from xml.etree import ElementTree

import netCDF4
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import OUTPUTS, make, motions, row, yielding_pair

import pounding_sweep as ps
from pounding_sweep.base.errors import SceneError
from pounding_sweep.base.files import read_data
from pounding_sweep.cli.records import print_read, read_as
from pounding_sweep.engine import compile
from pounding_sweep.engine.postprocess import variables_of
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.model.building import Building, Foundation
from pounding_sweep.model.frames import typical_building
from pounding_sweep.model.laws import Law, get_law
from pounding_sweep.model.scene import Bumper, ContactProperties, Link, Scene, Wall
from pounding_sweep.output.netcdf import open_cube
from pounding_sweep.plan import plan as planning
from pounding_sweep.plan.plan import make_plan, untouched
from pounding_sweep.records import Record
from pounding_sweep.request.axes import contact_stiffness
from pounding_sweep.request.build import Arguments, build_spec
from pounding_sweep.request.spec import digest
from pounding_sweep.run import execute
from pounding_sweep.run.simulate import simulate
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.schemes.stability import largest_step
from pounding_sweep.variables.registry import Status, get_variable, inner_shape, reducers_for, scatter_contact

VALUES = (*OUTPUTS, "status", "steps_per_contact")


PRODUCT = {
    "laws": ["linear", "none", "hertz", "kelvin_voigt"],
    "gaps": [0.5, 0.001, 0.005, 0.05, 0.02],  # the first can never close, the last two only sometimes
    "stiffness_factors": [1.0, 0.5],
    "restitutions": [0.4, 0.8],
    "scales": [0.5, 1.0],
    "method": "rk4",
    "dt": 0.005,
    "audit": 0.0,
    "outputs": OUTPUTS,
}


def alone(scene, record, law, k, e, gaps, scale):
    """One scenario by itself: nothing shared with others, nothing left out, the law in its own kernel."""
    outputs = tuple(OUTPUTS)
    kernel = RowKernel(scene, get_law(law), Numerics("rk4", 0.005, rest=np.inf), reducers_for(outputs))
    raw = kernel.run(
        record,
        scale=np.array([scale]),
        gaps=np.array([gaps], dtype=float),
        stiffness=np.array([k]),
        restitution=np.array([e]),
    )
    return {name: values[0] for name, values in variables_of(kernel, raw, outputs, record).items()}


def as_in_cube(name, value):
    """A value as a cube holds it: missing integers are NaN."""
    variable = get_variable(name)
    value = np.asarray(value, dtype=float)
    return np.where(value == variable.fill, np.nan, value) if variable.dtype == "i4" else value


def exactly(found, expected, what=""):
    """Equal to the last bit, NaN where NaN."""
    np.testing.assert_array_equal(np.asarray(found, float), np.asarray(expected, float), err_msg=str(what))


# -- against brute force -----------------------------------------------------------------------------------------------


def test_product_equals_brute_force():
    scene, records = row(), motions()
    sweep = Sweep(scene, records, **PRODUCT)
    cube = sweep.run(scheduler="threads", workers=2)
    values, touched, never = cube[list(VALUES)], 0, 0
    axes = [PRODUCT[name] for name in ("laws", "gaps", "stiffness_factors", "restitutions")]
    for law, gap, factor, e, record, scale in itertools.product(*axes, records, PRODUCT["scales"]):
        k = contact_stiffness(scene, law, stiffness_factor=factor)
        expected = alone(scene, record, law, k, e, [gap, gap], scale)
        where = {"law": law, "gap": gap, "stiffness_factor": factor, "restitution": e, "scale": scale}
        where["record"] = record.name
        found = values.sel(where)
        for name in VALUES:
            exactly(found[name], as_in_cube(name, expected[name]), (name, where))
        hit = np.nansum(np.maximum(expected["impact_count"], 0)) > 0
        touched, never = touched + hit, never + (not hit and law != "none")
    assert touched > 100
    assert never > 50  # both kinds are really there
    outcome = sweep.last_outcome
    # none: 2 records x 2 scales; linear, hertz: x 5 gaps x 2 factors; kelvin_voigt: x 2 restitutions besides
    assert sweep.plan().n_asked == 4 * 5 * 2 * 2 * 2 * 2
    assert sweep.plan().n_unique == 4 + 40 + 40 + 80
    assert outcome.run + outcome.untouched == sweep.plan().n_unique
    # a gap of 0.5 m never closes: 4 motions x (2 + 2 + 4) at the least
    assert outcome.untouched >= 32
    assert cube.attrs["scenarios_run"] == outcome.run


def test_copies_are_told_from_runs(stub_engine, tmp_path):
    """Each scenario has the number of the run that answers it, the first of a number is that run, others its copies."""
    sweep = Sweep(row(), motions(), **{**PRODUCT, "laws": ["linear", "kelvin_voigt", "none"]})
    sweep.run(tmp_path / "cube.nc", workers=1).close()
    with netCDF4.Dataset(tmp_path / "cube.nc") as file:
        assert file["run"].dtype == np.int32
        assert file["origin"].flag_meanings == "run equal never_touches not_run"
    with open_cube(tmp_path / "cube.nc") as stored:
        cube = stored[["run", "origin", "status", *OUTPUTS]].load()
    assert (cube.run.dtype, cube.origin.dtype) == (np.int32, np.int8)
    table = cube.stack(scenario=cube.status.dims)
    never = ~(table.impact_count > 0).any(("pair", "storey")).values
    kinds, seen, has_run = [], {}, set()
    for i, (law, gap, factor, e, record, scale) in enumerate(table.scenario.values):
        # what never touches is answered by the run of its motion without pounding
        key = ("none" if never[i] else (law, gap, factor, e if law == "kelvin_voigt" else 1.0), record, scale)
        number = seen.setdefault(key, len(seen) + 1)
        kinds.append((int(number in has_run) if law == "none" or not never[i] else 2, number))
        if kinds[-1][0] == 0:
            has_run.add(number)
    assert [*zip(table.origin.values.tolist(), table.run.values.tolist(), strict=True)] == kinds
    assert {kind for kind, _ in kinds} == {0, 1, 2}
    assert cube.run.max() == len(seen) == sweep.last_outcome.run
    # one row of each number has every result once
    first = table.isel(scenario=np.unique(table.run, return_index=True)[1])
    for name in OUTPUTS:
        exactly(first[name].isel(scenario=table.run.values - 1), table[name], name)


def test_what_has_no_result_has_no_run(stub_engine):
    cube = Sweep(
        row(), motions(), "linear", gaps=[0.001, 0.5], stiffness_factors=[1.0, 1e6], method="rk4", dt=5e-3
    ).run()
    refused = cube.status == Status.BEYOND_STABILITY_LIMIT
    assert refused.any()
    assert ((cube.run == 0) == refused).all()
    assert ((cube.origin == 3) == refused).all()
    assert cube.run.max() == (cube.run > 0).sum() == 4


@pytest.mark.parametrize(
    ("law", "n_gaps", "accuracy", "expected"),
    [
        ("hertz_damped", 8, 1e-3, ["float32"]),  # one in double precision is compiled where a scenario needs it
        ("linear", 8, 1e-3, ["float32"]),
        ("hertz_damped", 64, 1e-6, ["float64"]),
    ],
)
def test_kernels_are_known_beforehand(law, n_gaps, accuracy, expected):
    plan = ps.Sweep("mate2015", "el_centro", law, gaps=np.linspace(0.004, 0.02, n_gaps), accuracy=accuracy).plan()
    assert [shape.precision for shape in plan.shapes()] == expected  # none without contacts for so few scenarios
    assert plan.summary()["kernels"] == len(plan.shapes())


@pytest.mark.slow
def test_no_other_kernel_is_asked_for_where_scenarios_are_refined(monkeypatch, tmp_path):
    gaps = np.linspace(0.004, 0.02, 64)
    sweep = ps.Sweep("mate2015", "el_centro", "hertz_damped", gaps=gaps, accuracy=1e-3, outputs=["impact_force_max"])
    asked, ask = set(), compile.get_kernel

    def get_kernel(shape):
        asked.add(shape)
        return ask(shape)

    monkeypatch.setattr(compile, "get_kernel", get_kernel)
    sweep.run(tmp_path / "cube.nc", scheduler="synchronous").close()
    assert asked == set(sweep.plan().shapes())


@pytest.mark.slow
def test_few_scenarios_without_pounding_run_in_the_kernel_of_a_law(monkeypatch):
    """As in a kernel of their own, to the last bit; restrainers do not act there either."""
    link = ps.Restrainer("a-b", stiffness=6e4, slack=0.001)
    scene = Scene(yielding_pair().row, [0.01], ContactProperties(2e5), restrainers=[link])
    sweep = Sweep(scene, motions(), ["none", "linear"], gaps=[0.002, 1.0], method="exact", dt=1e-3, outputs=OUTPUTS)
    few = sweep.run()
    monkeypatch.setattr(planning, "FEW_YIELDING", 0)
    many = sweep.run()
    assert len(sweep.plan().uncoupled_to_run) == 2
    for name in OUTPUTS:
        exactly(few[name], many[name])


def test_listed_cases_equal_brute_force(monkeypatch):
    monkeypatch.setattr(planning, "LEAST_SHARED", 1)
    scene, records = row(), motions()
    cases = [
        {"law": "hertz", "gap": (0.004, 0.03), "record": "two"},
        {"law": "hertz", "gap": (0.03, 0.004), "record": "two"},
        {"law": "none", "record": "one", "gap": 0.2},
        {"law": "none", "record": "one"},
        {"law": "linear", "record": "one", "stiffness": 3.1e5, "restitution": 0.2},
        {"law": "linear", "record": "one", "stiffness": 3.1e5, "restitution": 0.9},
        {"law": "kelvin_voigt", "record": "one", "gap": 0.002, "restitution": 0.65, "scale": 1.25},
        {"law": "kelvin_voigt", "record": "one", "gap": (0.002, 0.9), "scale": -1.0},
        {"law": "kelvin_voigt", "record": "two", "gap": (0.9, 0.9)},
    ]
    sweep = Sweep(scene, records, cases=cases, method="rk4", dt=0.005, audit=0.0, outputs=OUTPUTS)
    cube = sweep.run(workers=1)
    by_name = {r.name: r for r in records}
    for i, case in enumerate(cases):
        gap = case.get("gap", scene.gaps)
        gaps = [gap] * 2 if isinstance(gap, float) else list(gap)
        k = case.get("stiffness", contact_stiffness(scene, case["law"]))
        e = case.get("restitution", 0.5)
        expected = alone(scene, by_name[case["record"]], case["law"], k, e, gaps, case.get("scale", 1.0))
        for name in VALUES:
            exactly(cube[name][i], as_in_cube(name, expected[name]), (name, case))
        exactly(cube["pair_gap"][i], gaps)
    assert sweep.plan().n_unique == len(cases) - 2  # none ignores the gap, linear the restitution
    assert sweep.last_outcome.untouched == 1
    assert cube.sizes["case"] == len(cases)
    assert [str(v) for v in cube["law"].values] == [case["law"] for case in cases]


@pytest.mark.parametrize(
    ("law", "dt", "divisor"),
    [("hertz_damped", 5e-3, 2.5), ("hertz_damped", 1e-3, 1.0), ("hertz_damped", 1.0, 4.0), ("kelvin_voigt", 5e-3, 1.0)],
)
def test_long_steps_of_stages_are_divided(law, dt, divisor):
    scene = Scene([Building("a", [100.0], [2e4]), Wall()], [0.01])
    cases = [{"law": law, "stiffness": 1e6, "restitution": 0.6}]
    for method, expected in (("exact", divisor), ("rk4", 1.0)):
        spec = build_spec(scene=scene, records=motions()[0], cases=cases, method=method, dt=dt, force_unstable=True)
        assert make_plan(spec).numerics.refinement == pytest.approx(expected)


def test_no_floors_meet():
    """Where no floors are level, no law has anything to do."""
    scene = Scene(
        [Building("a", [100.0], [1e4]), Building("b", [80.0], [2.5e4], storey_heights=[4.0])],
        gaps=[0.01],
        contact=ContactProperties(2e5, 1e6, 0.5),
        allow_unmet=True,
    )
    plan = Sweep(scene, motions(), ["linear", "hertz"], gaps=[0.0, 0.1], scales=[1.0, 2.0]).plan()
    assert (plan.n_asked, plan.n_unique) == (16, 4)
    assert plan.no_contact.all()
    assert plan.kernel(0).shape.law is None


def test_a_single_building(stub_engine):
    scene = Scene([Building("a", [100.0], [1e4])])
    record = motions()[1]
    sweep = Sweep(scene, record, "none", scales=[1.0, 2.0], method="rk4", dt=0.005, outputs=["displacement_max"])
    cube = sweep.run(workers=1)
    assert sweep.plan().n_unique == 2
    assert sweep.last_outcome.run == 2
    assert (cube.status == Status.OK).all()
    assert "pair" not in cube.dims
    peaks = cube["displacement_max"].values.ravel()
    assert peaks[1] == 2.0 * peaks[0] > 0.0  # a power of two: linear to the last bit


@st.composite
def closings(draw):
    n_storeys = draw(st.lists(st.integers(1, 3), min_size=1, max_size=4))
    items = [Building(f"b{i}", [100.0] * n, [1e5] * n) for i, n in enumerate(n_storeys)]
    if len(items) == 1 or draw(st.booleans()):
        items.append(Wall())
    n_pairs = len(items) - 1
    size = st.sampled_from([0.0, 0.01, 0.02, 0.03])
    cases = draw(st.lists(st.tuples(*[size] * n_pairs), min_size=1, max_size=6, unique=True))
    scene = Scene(items, gaps=[0.01] * n_pairs, contact=ContactProperties(2e5))
    found = draw(st.lists(st.sampled_from([-0.01, 0.0, 0.005, 0.015, 0.025, math.inf]), min_size=8, max_size=12))
    return scene, cases, np.array((found * 2)[: len(scene.contacts)])


@given(closings())
def test_never_touching_by_hand(drawn):
    scene, gaps, displacement = drawn
    record = Record("r", 0.1, [0.0, 1.0])
    plan = make_plan(build_spec(scene=scene, records=record, cases=[{"law": "linear", "gap": g} for g in gaps]))
    closing = scatter_contact(displacement[None, :], scene)
    found = untouched(plan, closing)
    assert not untouched(plan, np.full_like(closing, np.inf)).any()  # nothing known: everything runs
    for i, g in enumerate(gaps):
        open_everywhere = all(g[c.pair] >= max(x, 0.0) for c, x in zip(scene.contacts, displacement, strict=True))
        assert found[plan.inverse[i]] == open_everywhere, g


# -- asked -> unique ---------------------------------------------------------------------------------------------------

numbers = st.sampled_from([0.001, 0.002, 0.01, 0.5, 1.0])


def effective(scene, law, gap, k, e, record, scale):
    """What can matter to a scenario, by the definitions."""
    if law == "none" or not scene.contacts:
        return (record, "none", scale)
    gaps = scene.gaps if gap is None else (gap,) * len(scene.gaps) if isinstance(gap, float) else tuple(gap)
    return (record, law, scale, k, e if get_law(law).takes_restitution else None, gaps)


def effective_row(plan, i):
    table, law = plan.unique, plan.laws[plan.unique.law[i]]
    start = (int(table.record[i]), law.key, float(table.scale[i]))
    if not law.has_contact:
        assert np.isinf(table.gaps[i]).all()
        return start
    e = float(table.restitution[i]) if law.takes_restitution else None
    return (*start, float(table.stiffness[i]), e, tuple(float(g) for g in table.gaps[i]))


def check_plan(plan, asked):
    assert plan.n_asked == len(asked)
    rows = [effective_row(plan, i) for i in range(len(plan.unique))]
    assert len(set(rows)) == len(rows) == len(set(asked))
    assert [rows[i] for i in plan.inverse] == asked


def some(values):
    return st.lists(values, min_size=1, max_size=3, unique=True)


LAW_KEYS = st.sampled_from(["none", "linear", "hertz", "kelvin_voigt", "hertz_damped", "modified_kelvin"])


@given(
    some(LAW_KEYS),
    st.none() | some(numbers),
    some(numbers),
    some(numbers),
    some(numbers | st.just(-1.0)),
    st.booleans(),
)
def test_every_asked_scenario_of_a_product_has_its_row(laws, gaps, factors, restitutions, scales, both):
    scene, records = row(), motions()[: 1 + both]
    axes = {"laws": laws, "gaps": gaps, "stiffness_factors": factors, "restitutions": restitutions, "scales": scales}
    asked = [
        effective(scene, law, g, contact_stiffness(scene, law, stiffness_factor=f), e, r, s)
        for law, g, f, e, r, s in itertools.product(
            laws, gaps or [None], factors, restitutions, range(len(records)), scales
        )
    ]
    check_plan(make_plan(build_spec(scene=scene, records=records, **axes)), asked)


GAPS = st.none() | numbers | st.tuples(numbers, numbers)
CASES = st.tuples(LAW_KEYS, GAPS, numbers.map(lambda f: f * 1e6), numbers, st.integers(0, 1), numbers)


@given(st.lists(CASES, min_size=1, max_size=12, unique=True))
def test_every_listed_case_has_its_row(drawn):
    scene, records = row(), motions()
    cases = [
        {"law": law, "gap": g, "stiffness": k, "restitution": e, "record": records[r].name, "scale": s}
        for law, g, k, e, r, s in drawn
    ]
    plan = make_plan(build_spec(scene=scene, records=records, cases=cases))
    check_plan(plan, [effective(scene, *case) for case in drawn])


def test_many_random_cases_keep_their_parameters():
    """A random sample has as many values on every axis as cases: their product is far beyond 64 bits."""
    n = 60_000
    rng = np.random.default_rng(5)
    g, k, e, s = rng.uniform(0.1, 1.0, (4, n))
    spec = build_spec(scene=row(), records=motions()[0], cases=[{"law": "kelvin_voigt"}])
    one = spec.cases[0]
    cases = tuple(
        dataclasses.replace(one, gap=a, stiffness=b, stiffness_factor=None, restitution=c, scale=d)
        for a, b, c, d in zip(g.tolist(), k.tolist(), e.tolist(), s.tolist(), strict=True)
    )
    plan = make_plan(dataclasses.replace(spec, cases=cases))
    found = plan.unique[plan.inverse]
    for name, values in (("stiffness", k), ("restitution", e), ("scale", s)):
        exactly(getattr(found, name), values, name)
    exactly(found.gaps, np.stack([g, g], axis=1))


# -- determinism -------------------------------------------------------------------------------------------------------


def keys_of(plan):
    return [chunk.key for chunk in plan.chunks(np.flatnonzero(~plan.refused))]


def test_the_same_sweep_gives_the_same_plan(monkeypatch):
    monkeypatch.setattr("pounding_sweep.plan.plan.CHUNK_SECONDS", 0.0)
    first, second = (Sweep(row(), motions(), **PRODUCT).plan() for _ in range(2))
    assert first.digest == second.digest == digest(first.spec)
    exactly(first.inverse, second.inverse)
    for name in first.unique.__dataclass_fields__:
        exactly(getattr(first.unique, name), getattr(second.unique, name), name)
    keys, chunks = keys_of(first), first.chunks(np.arange(len(first.unique)))
    assert keys == keys_of(second)
    assert not {*keys} & {*keys_of(Sweep(row(), motions(), **PRODUCT | {"locate": False}).plan())}
    assert len(set(keys)) == len(keys) == first.summary()["chunks"]
    assert sorted(np.concatenate([chunk.rows for chunk in chunks])) == list(range(len(first.unique)))  # each once
    for chunk in chunks:
        assert len(chunk.rows) <= 16
        assert set(first.unique.law[chunk.rows]) == {chunk.law}
        assert set(first.unique.record[chunk.rows]) == {chunk.record}


def test_the_summary_counts():
    plan = Sweep(row(), motions(), **{**PRODUCT, "stiffness_factors": [1.0, 1e4]}).plan()
    found = plan.summary(workers=2)
    assert found["asked"] == plan.n_asked
    assert found["refused"] == int(plan.refused.sum()) == 4 * 5 + 4 * 10  # the stiff linear and kelvin_voigt ones
    assert found["at_most"] == plan.n_unique == len(plan.unique) - plan.refused.sum()
    assert found["steps"] == {"one": 149 * 4, "two": 149 * 2}
    assert found["kernels"] == 3  # linear runs in the kernel of kelvin_voigt
    assert 0 < found["seconds"] == plan.summary(workers=1)["seconds"] / 2
    # 2 x 3 floors, 3 x 2 pairs (4 bytes the counts), status, what did not settle and steps per contact
    assert found["cube_bytes"] == 320 * (2 * 3 * 8 + 2 * (8 + 4 + 8) + 1 + 1 + 8)


# -- the stability limit -----------------------------------------------------------------------------------------------


def test_refused_rows_are_those_beyond_the_limit():
    plan = Sweep(row(), motions(), **{**PRODUCT, "stiffness_factors": [1.0, 30.0, 1e4]}).plan()
    table = plan.unique
    for i in range(len(table)):
        law = plan.laws[table.law[i]]
        k, e = float(table.stiffness[i]), float(table.restitution[i])
        limit = largest_step(plan.spec.scene, law, np.array([k]), np.array([e]), method="rk4")
        assert plan.refused[i] == (limit[0] < 0.005)
    assert 0 < plan.refused.sum() < len(table)
    forced = Sweep(row(), motions(), **{**PRODUCT, "stiffness_factors": [1e4], "force_unstable": True}).plan()
    assert not forced.refused.any()


def test_a_gap_that_is_just_closed_is_run():
    """Only a gap of at least the closing displacement leaves a scenario out, and of that by a rounding error more."""
    closing = 0.02
    gaps = [closing * share for share in (0.995, 0.999, 1.0, 1.001)]
    plan = make_plan(build_spec(scene=row(), records=motions()[0], laws="linear", gaps=gaps, method="rk4", dt=0.005))
    found = untouched(plan, np.full((len(plan.uncoupled_runs), *inner_shape("closing_max", plan.spec.scene)), closing))
    assert found[np.argsort(plan.unique.gaps[:, 0])].tolist() == [False, False, False, True]


def cells_of(item):
    return [[cell.text for cell in line] for line in ElementTree.fromstring(item._repr_html_()).iter("tr")]


def test_a_plan_is_printed_as_the_command_prints_it():
    plan = Sweep(row(), motions(), **PRODUCT, title="A <plan>").plan()
    lines = str(plan).splitlines()
    assert lines[0] == "sweep      A <plan>"
    assert "axes       4 laws x 5 gaps x 2 stiffness factors x 2 restitutions x 2 records x 2 scales" in lines
    assert f"scenarios  {plan.n_asked} asked, at most {plan.n_unique} to run" in lines
    assert repr(plan) == f"Plan({plan.n_asked} scenarios asked, at most {plan.n_unique} to run)"
    assert ElementTree.fromstring(plan._repr_html_()).findtext("caption") == "A <plan>"
    assert [f"{name or '':9}  {text}" for name, text in cells_of(plan)] == lines[1:]


def test_scenes_and_sweeps_in_notebooks():
    scene = Scene([Building("a <b>", [100.0, 50.0], [1e5, 1e5]), Building("c", [80.0], [2e5]), Wall()], [0.01, 0.02])
    table = cells_of(scene)
    assert table[1] == ["a <b>", "2", "150", f"{scene.buildings[0].periods[0]:.4g}", "10"]
    assert table[3] == ["wall", "wall", None, None, None]
    table = cells_of(Sweep(row(), motions()[0], ["linear", "none"], gaps=[0.001 * i for i in range(1, 13)]))
    assert table[1] == ["law", "2", "['linear', 'none']"]
    assert table[2][2].startswith("[0.001, 0.002, ")


def test_a_run_is_timed_by_some_scenarios_of_each_law(monkeypatch):
    """Where every scenario takes three times its estimate, so does the run."""
    plan, clock, laws = make().plan(), [0.0], []

    def run(task):
        steps = task.kernel.numerics.steps(task.record)
        index = [record.name for record in plan.spec.records].index(task.record.name)
        clock[0] += 3.0 * plan.scenario_seconds(index, steps) * len(task.table)
        laws.append(task.kernel.law.key)

    monkeypatch.setattr(execute, "run_scenarios", run)
    monkeypatch.setattr(execute.time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(execute, "missing_kernels", lambda shapes: ([], []))
    assert execute.measured_seconds(plan) == pytest.approx(3.0 * plan.summary()["seconds"])
    assert {*laws} == {"linear", "kelvin_voigt", "none"}
    monkeypatch.setattr(execute, "missing_kernels", lambda shapes: (shapes, []))
    assert execute.measured_seconds(plan) is None


def test_a_plan_of_many_records_is_short(capsys):
    """One line for records that were read alike, the range of their steps, and how many there are."""
    records = [Record(f"r{i}", 0.01, np.sin(np.arange(100.0 + i))) for i in range(44)]
    rows = dict(Sweep(row(), records, "linear", method="rk4", dt=0.005).plan().rows())
    assert rows["steps"] == f"{99 * 2} to {142 * 2} (44 records) per scenario"
    few = dict(Sweep(row(), records[:2], "linear", method="rk4", dt=0.005).plan().rows())
    assert few["steps"] == "198 (r0), 200 (r1) per scenario"
    print_read([read_as(record) for record in records], [], [])
    (line,) = re.sub(r"\n +", " ", capsys.readouterr().out).splitlines()
    assert line.startswith("44 records  r0 to r43: 100 to 143 points, dt 0.01 s, PGA 0.1")
    print_read([read_as(record) for record in records[:3]], [], [])
    assert capsys.readouterr().out.count(" points, dt 0.01 s") == 3


def test_keys_of_what_cannot_be_modelled_are_not_keys_that_are_valid():
    valid = {
        name
        for cls in (Building, Scene, Link, Bumper, Foundation, Law, Record)
        for name in inspect.signature(cls).parameters
    }
    valid |= {*Arguments.model_fields, *inspect.signature(simulate).parameters}
    patterns = [topic["keys"] for topic in read_data("unmodelled.toml").values()]
    assert [name for name in sorted(valid) if any(re.match(pattern, name) for pattern in patterns)] == []
    with pytest.raises(
        SceneError, match=r"unknown key 'delay'.* cannot be modelled; take from the gap .*'What cannot be modelled'"
    ):
        Building("a", [1.0], [1.0], delay=0.1)


def test_a_plan_names_two_periods_of_tall_buildings():
    tall, low = Building("tall", [100.0] * 4, 1e5), Building("low", [100.0] * 3, 1e5)
    walls = typical_building("walls", 5, 0.4, 100.0)  # no chain
    rows = dict(Sweep(Scene([tall, low, walls], 0.01, ContactProperties(2e6)), "el_centro", "linear").plan().rows())
    w = 2.0 * np.sqrt(1e5 / 100.0) * np.sin(np.array([1, 3]) * np.pi / 18)  # a uniform chain of four
    first, second = 2.0 * np.pi / w
    assert rows["model"].endswith(
        f"compare its first two periods with the building's: tall {first:.3g} and {second:.3g} s"
    )
    assert "model" not in dict(Sweep(Scene([low]), "el_centro", "none").plan().rows())
