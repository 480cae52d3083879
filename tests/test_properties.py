"""Axes over building properties, against scenes whose buildings are built with the properties themselves."""

from __future__ import annotations

import itertools
import json
import math
import textwrap
import tracemalloc

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scenes import EVERY, OUTPUTS, motions, pair, row

import pounding_sweep as ps
from pounding_sweep.engine import compile
from pounding_sweep.engine.postprocess import displacement_limit, energy_limit, phase_error
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel.spec import LANES, input_slots, property_slots
from pounding_sweep.model.building import Building
from pounding_sweep.model.laws import get_law
from pounding_sweep.model.scene import ContactProperties, Scene, Wall
from pounding_sweep.model.variants import Variants
from pounding_sweep.plan import plan as planning
from pounding_sweep.plan.advice import approach_speeds, highest_frequency, shortest_contact
from pounding_sweep.plan.plan import PLAN_BYTES, make_plan
from pounding_sweep.request.build import build_spec
from pounding_sweep.request.spec import to_json
from pounding_sweep.request.toml import load_spec
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.schemes.stability import largest_step
from pounding_sweep.variables.registry import reducers_for

PERIODS, MASSES, RATIOS = {"a": [0.8, 1.0, 1.5]}, {"b": [2.0, 1.0]}, [0.02, 0.05]
AXES = {"period_factors": PERIODS, "mass_factors": MASSES, "damping_ratios": RATIOS}


def built(scene, periods=(), masses=(), ratio=None):
    """The scene with buildings made anew from their factored masses and stiffnesses."""
    f, g = dict(periods), dict(masses)
    items = [
        item
        if isinstance(item, Wall)
        else Building(
            item.name,
            [m * g.get(item.name, 1.0) for m in item.masses],
            [k * g.get(item.name, 1.0) / f.get(item.name, 1.0) ** 2 for k in item.stiffnesses],
            item.damping_ratio if ratio is None else ratio,
            item.storey_heights,
        )
        for item in scene.row
    ]
    return Scene(items, scene.gaps, scene.contact)


def tall():
    """Two buildings of several storeys, one with a damping ratio of its own for each mode, and a wall."""
    return Scene(
        [
            Building("a", [100.0, 90.0, 80.0], [9e4, 8e4, 7e4], (0.03, 0.05)),
            Building("b", [120.0, 60.0], [2e5, 1e5]),
            Wall("moat"),
        ],
        gaps=[0.004, 0.006],
        contact=ContactProperties(linear_stiffness=2e5, hertz_stiffness=1e6, restitution=0.5),
    )


def some_variants(scene, n, seed=0):
    """Random variants, the first the scene as given, the second with its own damping."""
    rng = np.random.default_rng(seed)
    size = (n, len(scene.buildings))
    found = Variants(scene, rng.uniform(0.4, 2.5, size), rng.uniform(0.3, 3.0, size), rng.uniform(0.0, 0.3, n))
    found.period_factor[0] = found.mass_factor[0] = 1.0
    found.damping_ratio[:2] = np.nan
    return found


def scenes_of(variants):
    """Each row as a scene that is built so."""
    names = [b.name for b in variants.scene.buildings]
    return [
        built(
            variants.scene,
            zip(names, variants.period_factor[i], strict=True),
            zip(names, variants.mass_factor[i], strict=True),
            None if np.isnan(variants.damping_ratio[i]) else float(variants.damping_ratio[i]),
        )
        for i in range(len(variants))
    ]


@pytest.mark.parametrize("law", ["linear", "kelvin_voigt", "hertz_damped"])
@pytest.mark.parametrize("method", ["rk4", "exact", "newmark"])
def test_limits_are_those_of_buildings_built_so(law, method):
    variants, k, e = some_variants(tall(), 12), np.geomspace(1e3, 1e7, 12), np.linspace(0.2, 1.0, 12)
    more = {"method": method, "beta": 0.1}
    found = largest_step(variants, get_law(law), k, e, **more)
    want = [largest_step(s, get_law(law), k[[i]], e[[i]], **more)[0] for i, s in enumerate(scenes_of(variants))]
    np.testing.assert_allclose(found, want, rtol=1e-12)
    assert len(set(want)) > 6


def test_estimates_are_those_of_buildings_built_so():
    variants, record = some_variants(tall(), 12), motions()[0]
    scenes, k, e = scenes_of(variants), np.geomspace(1e3, 1e7, 12), np.linspace(0.2, 1.0, 12)
    speeds = approach_speeds(variants, record)
    for method in ("rk4", "newmark"):
        numerics = Numerics(method, 0.004)
        want = [phase_error(s, record, numerics)[0] for s in scenes]
        np.testing.assert_allclose(phase_error(variants, record, numerics), want, rtol=1e-11)
    for i, scene in enumerate(scenes):
        np.testing.assert_allclose(highest_frequency(variants)[i], highest_frequency(scene)[0], rtol=1e-12)
        np.testing.assert_allclose(speeds[i], approach_speeds(scene, record)[0], rtol=1e-10)
        one, some = np.ones(1), np.ones(12)
        energy = energy_limit(scene, record, one)
        np.testing.assert_allclose(energy_limit(variants, record, some)[i], energy[0], rtol=1e-12)
        far = displacement_limit(scene, energy)[0]
        np.testing.assert_allclose(displacement_limit(variants, energy_limit(variants, record, some))[i], far)
        for law in ("kelvin_voigt", "hertz_damped"):
            lasting = shortest_contact(scene, get_law(law), k[[i]], e[[i]], speeds[[i]])
            found = shortest_contact(variants, get_law(law), k, e, speeds)[i]
            np.testing.assert_allclose(found, lasting[0], rtol=1e-12)


def inputs_of(kernel, record, monkeypatch, variants=None, n=1):
    """What the kernel is called with: constants, and inputs of each scenario."""
    taken = {}

    def kernel_of(shape):
        del shape

        def run(acceleration, dt, intervals, steps, flight_substeps, constants, lanes, *more):
            del acceleration, dt, intervals, steps, flight_substeps, more
            taken["constants"] = constants.copy()
            taken.setdefault("lanes", []).append(lanes.copy())

        return run

    monkeypatch.setattr(compile, "get_kernel", kernel_of)
    pairs = len(kernel.scene.pair_names)
    given = {"scale": np.ones(n), "gaps": np.full((n, pairs), 0.01), "stiffness": np.full(n, 2e5)}
    kernel.run(record, **given, restitution=np.full(n, 0.5), variants=variants)
    slots = input_slots(kernel.shape).size
    lanes = np.concatenate(taken["lanes"]).reshape(-1, slots, LANES).transpose(0, 2, 1).reshape(-1, slots)
    return taken["constants"], lanes


@pytest.mark.parametrize(
    "law", ["none", "kelvin_voigt", *(pytest.param(law, marks=pytest.mark.slow) for law in ("linear", "hertz"))]
)
@pytest.mark.parametrize("method", ["rk4", "newmark", "exact"])
def test_lanes_hold_the_constants_of_buildings_built_so(law, method, monkeypatch):
    monkeypatch.setattr("pounding_sweep.engine.row_kernel.TABLE_BYTES", 20_000)  # handed over in several parts
    scene, record = tall(), motions()[0]
    variants = some_variants(scene, 50)
    dt = 0.02 if method == "exact" else 0.002
    more = (get_law(law), Numerics(method, dt), reducers_for(["impact_force_max", "displacement_max"]))
    kernel = RowKernel(scene, *more, varied=True)
    assert not RowKernel(scene, *more).shape.varied
    _, lanes = inputs_of(kernel, record, monkeypatch, variants, 50)
    assert len(lanes) == 64
    assert (lanes[50:] == lanes[49]).all()  # idle lanes repeat the last scenario
    inputs = input_slots(kernel.shape)
    for i, other in enumerate(scenes_of(variants)):
        own = RowKernel(other, *more)
        constants, alone = inputs_of(own, record, monkeypatch)
        theirs = property_slots(own.shape)
        for name, first in inputs.first.items():
            values = lanes[i, first : first + inputs.count[name]]
            if name.startswith("p_"):
                at = theirs.first[name[2:]]
                want = constants[at : at + inputs.count[name]]
                np.testing.assert_allclose(values, want, rtol=1e-11, atol=1e-13 * np.abs(want).max(), err_msg=name)
            elif name != "tables":
                at = input_slots(own.shape).first[name]
                np.testing.assert_allclose(values, alone[0, at : at + len(values)], rtol=1e-12, err_msg=name)
    varied = {name for name in inputs.first if name.startswith("p_")}
    contact = {"p_reduced", *(["p_longest"] if method == "exact" else [])} if law != "none" else set()
    if law == "hertz" and method == "exact":  # of which those of stiffer modes have shorter sub-steps
        assert len(set(lanes[:50, inputs.first["p_longest"]])) > 10
    assert varied == {"p_m", "p_im", "p_k", "p_alpha", "p_beta"} | contact


WHOLE = {
    "laws": ["linear", "none", "kelvin_voigt"],
    "gaps": [0.0005, 0.5, 0.002],
    "dt": 0.005,
    "audit": 0,
    "outputs": EVERY,
}


def test_results_do_not_depend_on_how_scenarios_are_cut(stub_engine, monkeypatch):
    axes = {"period_factors": {"a": ps.Range(0.5, 2.0, 9)}, "damping_ratios": RATIOS}
    more = {**WHOLE, "records": motions()[0], "laws": "kelvin_voigt", "gaps": [0.0005, 0.002, 0.003]}
    whole = Sweep(pair(), **more, **axes).run(scheduler="synchronous")
    monkeypatch.setattr(planning, "CHUNK_SECONDS", 1e-9)
    sweep = Sweep(pair(), **more, **axes)
    assert len(sweep.plan().chunks(np.arange(54))) == 4
    xr.testing.assert_identical(sweep.run(scheduler="threads", workers=2).drop_attrs(), whole.drop_attrs())


def test_the_audit_of_a_sweep_over_properties_is_of_its_own_scenarios(stub_engine):
    changes = {"records": motions(), "audit": 0.2, "laws": "kelvin_voigt", "dt": 0.002}
    sweep = Sweep(pair(), **{**WHOLE, **changes}, **AXES)
    cube = sweep.run(scheduler="synchronous")
    found, plan = sweep.last_audit, sweep.plan()
    variants = plan.variants[plan.unique.variant[found.rows]]
    assert len(set(plan.unique.variant[found.rows].tolist())) > 2
    np.testing.assert_array_equal(cube["audit_period_factor"], variants.period_factor)
    np.testing.assert_array_equal(cube["audit_mass_factor"], variants.mass_factor)
    np.testing.assert_array_equal(cube["audit_damping_ratio"], variants.damping_ratio)
    assert found.error.max() < 1e-2  # the same buildings again, not others


def plan_of(scene=None, **changes):
    return make_plan(build_spec(scene=scene or row(), **{**WHOLE, "records": motions(), **changes}))


def test_runs_without_pounding_are_shared_by_what_they_have_in_common(monkeypatch):
    monkeypatch.setattr("pounding_sweep.plan.plan.FEW_SCENARIOS", 0)
    plan = plan_of(**AXES, scales=[0.5, 1.0])
    assert len(plan.uncoupled_runs) == 2 * 2 * 12
    table, of = plan.unique, plan.uncoupled_of
    for name in ("record", "scale", "variant"):
        np.testing.assert_array_equal(getattr(plan.uncoupled_runs, name)[of], getattr(table, name))
    assert set(plan.uncoupled_to_run) == set(range(48))
    # what a motion could spare must be worth its own run
    assert not len(plan_of(laws="linear", gaps=[0.01, 0.02, 0.03], **AXES).uncoupled_to_run)
    assert len(plan_of(laws="linear", gaps=[0.01, 0.02, 0.03, 0.04], **AXES).uncoupled_to_run) == 24
    assert len(plan_of(laws="none", gaps=0.01, **AXES).uncoupled_to_run) == 24


@given(
    st.lists(st.sampled_from([0.5, 0.8, 1.0, 2.0]), min_size=1, max_size=3, unique=True),
    st.lists(st.sampled_from([0.5, 1.0, 3.0]), min_size=1, max_size=3, unique=True),
    st.none() | st.lists(st.sampled_from([0.0, 0.05, 0.3]), min_size=1, max_size=3, unique=True),
    st.lists(st.sampled_from([0.001, 0.01, 0.02]), min_size=1, max_size=3, unique=True),
)
def test_every_asked_scenario_is_answered_by_one_of_its_properties(periods, masses, ratios, gaps):
    laws = ["kelvin_voigt", "none", "linear"]
    axes = {"period_factors": {"c": periods}, "mass_factors": {"a": masses}, "damping_ratios": ratios}
    plan = plan_of(laws=laws, gaps=gaps, records=motions()[0], restitutions=[0.5, 0.9], **axes)
    asked = itertools.product(laws, gaps, [0.5, 0.9], periods, masses, ratios or [math.nan])
    seen = {}
    for i, (law, gap, e, f, g, z) in enumerate(asked):
        own = 0.05 if math.isnan(z) else z
        effective = (law, None if law == "none" else gap, e if law == "kelvin_voigt" else None, f, g, own)
        at = int(plan.inverse[i])
        assert seen.setdefault(effective, at) == at
        variants, variant = plan.variants, int(plan.unique.variant[at])
        assert variants.period_factor[variant].tolist() == [1.0, 1.0, f]
        assert variants.mass_factor[variant].tolist() == [g, 1.0, 1.0]
        found = variants.damping_ratio[variant]
        assert (0.05 if math.isnan(found) else found) == own
        assert plan.laws[plan.unique.law[at]].key == law
        assert plan.unique.gaps[at, 0] == (math.inf if law == "none" else gap)
    assert len(set(seen.values())) == len(seen) == len(plan.unique)


def test_steps_and_limits_follow_the_buildings():
    factors = [0.1, 1.0, 3.0]
    common = {"records": motions(), "laws": ["hertz", "none"], "gaps": [0.002], "audit": 0, "outputs": OUTPUTS}
    plan = make_plan(build_spec(scene=tall(), **common, period_factors={"b": factors}, accuracy=1e-4))
    assert len(set(plan.steps.tolist())) > 2
    chosen = {"method": plan.numerics.method, "precision": plan.numerics.precision}
    refusing = make_plan(build_spec(scene=tall(), **common, period_factors={"b": factors}, dt=0.015))
    assert 0 < refusing.refused.sum() < len(refusing.unique)
    for i, factor in enumerate(factors):
        other = built(tall(), {"b": factor})
        own = make_plan(build_spec(scene=other, **common, accuracy=1e-4, **chosen))
        mine = plan.unique.variant == 1 + i
        assert plan.steps[mine].tolist() == own.steps.tolist()
        assert plan.uncoupled_steps[:, 1 + i].tolist() == own.uncoupled_steps[:, 0].tolist()
        alone = make_plan(build_spec(scene=other, **common, dt=0.015))
        assert refusing.refused[mine].tolist() == alone.refused.tolist()
        np.testing.assert_allclose(refusing.limit[mine], alone.limit, rtol=1e-12)


HUNDRED, GAPS = ps.Range(0.5, 2.0, 100), ps.Range(0.001, 0.05, 1000)
PROPERTIES = {"period_factors": {"left": HUNDRED}, "mass_factors": {"right": HUNDRED}}


@pytest.mark.parametrize(
    "axes",
    [
        pytest.param({"gaps": GAPS, "restitutions": ps.Range(0.3, 0.9, 100)}, marks=pytest.mark.slow),
        pytest.param({"gaps": GAPS, "period_factors": {"left": HUNDRED}}, marks=pytest.mark.slow),
        PROPERTIES | {"damping_ratios": ps.Range(0.01, 0.1, 10)},
    ],
    ids=["gaps", "periods", "properties"],
)
def test_planning_takes_the_memory_it_says(axes):
    spec = build_spec(scene="mate2015", records="el_centro", laws="kelvin_voigt", **axes)
    make_plan(build_spec(scene="mate2015", records="el_centro", laws="kelvin_voigt"))  # what is made once
    tracemalloc.start()
    try:
        plan = make_plan(spec)
        plan.chunks(plan.uncoupled_to_run, uncoupled=True)
        plan.chunks(np.arange(len(plan.unique)))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert spec.n_scenarios >= 100_000
    assert peak <= PLAN_BYTES * spec.n_scenarios


def named(*names):
    return Scene(
        [Building(name, [100.0 + i], [1e4]) for i, name in enumerate(names)],
        [0.01] * (len(names) - 1),
        ContactProperties(2e5, 1e6, 0.5),
    )


def test_a_cube_says_what_its_buildings_are(stub_engine, tmp_path):
    out = tmp_path / "out.nc"
    sweep = Sweep(
        row(), motions()[0], "none", outputs=["displacement_max"], **AXES | {"period_factors": {"c": [2.0], **PERIODS}}
    )
    made = sweep.run(out, scheduler="synchronous")
    with ps.open_cube(out) as cube:
        dims = ["period_factor_a", "period_factor_c", "mass_factor_b", "damping_ratio"]
        assert list(cube["status"].dims[-4:]) == dims
        for dim, values in zip(dims, (PERIODS["a"], [2.0], MASSES["b"], RATIOS), strict=True):
            assert cube[dim].values.tolist() == values
            assert cube[dim].attrs["units"] == "1"
        own = row().buildings
        np.testing.assert_allclose(cube["period_a"], own[0].periods[0] * np.array(PERIODS["a"]))
        assert cube["period_a"].attrs["units"] == "s"
        np.testing.assert_allclose(cube["mass_b"], [160.0, 80.0])
        ratio = cube["period_ratio_b_c"]
        assert ratio.dims == ("period_factor_c",)
        np.testing.assert_allclose(ratio, own[1].periods[0] / (2.0 * own[2].periods[0]))
        assert cube["mass_ratio_a_b"].values.tolist() == [100.0 / 160.0, 100.0 / 80.0]
        assert "mass_a" not in cube
        assert json.loads(cube.attrs["sweep"])["mass_factors"] == [["b", [2.0, 1.0]]]
        xr.testing.assert_equal(cube.load(), made)


def test_a_ratio_of_two_varied_neighbours_has_both_their_axes(stub_engine):
    factors = {"a": [1.0, 2.0], "b": [1.0, 3.0, 4.0]}
    sweep = Sweep(row(), motions()[0], "none", outputs=["displacement_max"], period_factors=factors)
    ratio = sweep.run(scheduler="synchronous")["period_ratio_a_b"]
    assert ratio.dims == ("period_factor_a", "period_factor_b")
    own = row().buildings
    want = own[0].periods[0] / own[1].periods[0] * np.array([[1.0], [2.0]]) / np.array([[1.0, 3.0, 4.0]])
    np.testing.assert_allclose(ratio, want)


def test_names_of_buildings_become_names_of_netcdf():
    scene = named("tower 1", "tower-1", "Süd")
    factors = {name: [1.0, 2.0] for name in ("Süd", "tower-1", "tower 1")}
    spec = build_spec(scene=scene, records=motions()[0], laws="none", mass_factors=factors)
    names = ["tower_1", "tower_1_no2", "S_d"]
    assert [axis.dimension for axis in spec.named_axes("building")] == [f"mass_factor_{name}" for name in names]
    assert [axis.name for axis in spec.named_axes("building")] == ["tower 1", "tower-1", "Süd"]  # as in the row


FILE = """
[scene]
gaps = [0.01]
contact = { linear_stiffness = 2e5 }

[[scene.row]]
name = "left"
masses = [100.0]
stiffnesses = [1e4]

[[scene.row]]
name = "tower 1"
masses = [80.0]
stiffnesses = [2e4]

[sweep]
records = ["el_centro"]
"""


def load(tmp_path, text):
    file = tmp_path / "sweep.toml"
    file.write_text(FILE + textwrap.dedent(text), encoding="utf-8")
    return load_spec(file)


def test_a_file_and_python_say_the_same(tmp_path):
    spec = load(
        tmp_path,
        """
        laws = "linear"
        damping_ratios = [0.02, 0.05]
        building."tower 1".mass_factor = { start = 0.5, stop = 2.0, count = 4, spacing = "log" }
        building.left.period_factor = [0.8, 1.25]
        building.left.mass_factor = 2
        """,
    )
    same = build_spec(
        scene=spec.scene,
        records="el_centro",
        laws="linear",
        damping_ratios=[0.02, 0.05],
        period_factors={"left": [0.8, 1.25]},
        mass_factors={"tower 1": ps.Range(0.5, 2.0, 4, "log"), "left": 2},
    )
    assert to_json(spec) == to_json(same)
    assert {k: len(v) for k, v in spec.axes.items() if "_" in k} == {
        "stiffness_factor": 1,
        "period_factor_left": 2,
        "mass_factor_left": 1,
        "mass_factor_tower_1": 4,
        "damping_ratio": 2,
    }


def test_cases_in_a_file(tmp_path):
    spec = load(
        tmp_path,
        """
        [[sweep.cases]]
        law = "linear"
        building.left.period_factor = 1.25
        building."tower 1" = { mass_factor = 2.0, period_factor = 1.0 }
        damping_ratio = 0.02

        [[sweep.cases]]
        law = "linear"
        """,
    )
    first, second = spec.cases
    assert first.period_factors == (("left", 1.25),)
    assert first.mass_factors == (("tower 1", 2.0),)
    assert first.damping_ratio == 0.02
    assert (second.period_factors, second.mass_factors, second.damping_ratio) == ((), (), None)
