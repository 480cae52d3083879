"""Designs: what is drawn, how it becomes listed cases, and that these run, go on, extend and merge like any others."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scenes import call, motions, row
from scipy import stats

from pounding_sweep import Sweep
from pounding_sweep.output.merge import merge_cubes
from pounding_sweep.output.netcdf import open_cube
from pounding_sweep.request.build import build_spec
from pounding_sweep.request.design import DISTRIBUTIONS, design_of, read_distribution
from pounding_sweep.request.spec import digest, to_json
from pounding_sweep.request.toml import load_spec


def drawn(kind, **numbers):
    return read_distribution({"distribution": kind, **numbers})


SHARES = np.linspace(0.001, 0.999, 97)
INPUTS = {
    "gap": {"distribution": "log_uniform", "low": 0.0005, "high": 0.02},
    "restitution": {"distribution": "uniform", "low": 0.3, "high": 0.7},
    "period_factors": {"b": {"distribution": "lognormal", "median": 1.0, "dispersion": 0.2}},
}


def told(kind="saltelli", samples=8, seed=1, **inputs):
    return {"kind": kind, "samples": samples, "seed": seed, "inputs": inputs or INPUTS}


def sweep(design=None, **changes):
    settings = {"laws": ["linear", "none", "kelvin_voigt"], "records": motions(), "stiffness_factors": 1.0, "dt": 0.005}
    settings |= {"outputs": ["displacement_max", "impact_force_max"], "audit": 0.0}
    return Sweep(row(), design=design or told(), **{**settings, **changes})


@pytest.mark.parametrize(
    ("given", "exact"),
    [
        (drawn("uniform", low=-1.0, high=3.0), stats.uniform(-1.0, 4.0)),
        (drawn("log_uniform", low=0.1, high=10.0), stats.loguniform(0.1, 10.0)),
        (drawn("normal", mean=2.0, std=0.5), stats.norm(2.0, 0.5)),
        (drawn("normal", mean=2.0, std=0.5, low=1.8), stats.truncnorm(-0.4, np.inf, 2.0, 0.5)),
        (drawn("normal", mean=0.0, std=1.0, low=-0.5, high=3.0), stats.truncnorm(-0.5, 3.0)),
        (drawn("lognormal", median=2.0, dispersion=0.4), stats.lognorm(0.4, scale=2.0)),
    ],
)
def test_quantiles_are_those_of_scipy(given, exact):
    assert given.values(SHARES) == pytest.approx(exact.ppf(SHARES), rel=1e-12)


def test_a_lognormal_between_ends_is_a_normal_of_its_logarithm():
    ends = drawn("lognormal", median=2.0, dispersion=0.4, low=1.0, high=3.0)
    normal = drawn("normal", mean=np.log(2.0), std=0.4, low=0.0, high=np.log(3.0))
    assert ends.values(SHARES) == pytest.approx(np.exp(normal.values(SHARES)), rel=1e-12)
    assert ends.values(np.array([1e-12, 1.0 - 1e-12])) == pytest.approx([1.0, 3.0], rel=1e-9)
    assert drawn("lognormal", median=2.0, dispersion=0.4, low=0.0).values(SHARES) == pytest.approx(
        stats.lognorm(0.4, scale=2.0).ppf(SHARES), rel=1e-12
    )
    assert set(DISTRIBUTIONS) == {"uniform", "log_uniform", "normal", "lognormal"}  # all of them are above


def points(kind, samples, seed=0):
    uniform = {"distribution": "uniform", "low": 0.0, "high": 1.0}
    design = told(kind, samples, seed, gap=uniform, scale=uniform, stiffness_factor={**uniform, "low": 1e-300})
    return build_spec(scene="mate2015", records="el_centro", laws="linear", design=design).design.shares


@pytest.mark.parametrize("kind", ["latin_hypercube", "sobol"])
def test_each_share_of_an_input_has_one_point(kind):
    found = np.sort(np.floor(points(kind, 32) * 32), axis=0)
    assert (found == np.arange(32)[:, None]).all()


@pytest.mark.parametrize("kind", ["latin_hypercube", "sobol", "halton", "saltelli"])
def test_a_seed_gives_the_same_points_and_another_seed_others(kind):
    assert (points(kind, 16) == points(kind, 16)).all()
    assert (points(kind, 16) != points(kind, 16, seed=1)).all()
    discrepancy = stats.qmc.discrepancy(points(kind, 128)[:128])
    assert discrepancy < 0.1 * stats.qmc.discrepancy(np.random.default_rng(0).random((16, 3)))


def test_blocks_of_saltelli_differ_in_one_input():
    a, b, *mixed = points("saltelli", 16).reshape(5, 16, 3)
    assert (a != b).all()
    for i, block in enumerate(mixed):
        own = np.arange(3) == i
        assert (block[:, own] == b[:, own]).all()
        assert (block[:, ~own] == a[:, ~own]).all()


FILE = """\
[scene]
preset = "mate2015"
[sweep]
records = ["el_centro"]
laws = ["linear", "kelvin_voigt"]
scales = [1.0, 2.0]
[design]
kind = "latin_hypercube"
samples = 5
seed = 7
[design.inputs]
restitution = { distribution = "uniform", low = 0.3, high = 0.7 }
building.left.period_factor = { distribution = "lognormal", median = 1.0, dispersion = 0.2 }
gap = { distribution = "uniform", low = 0.01, high = 0.02 }
"""


def test_files_and_arguments_give_the_same_sweep_in_any_order(tmp_path):
    (tmp_path / "s.toml").write_text(FILE)
    found = load_spec(tmp_path / "s.toml")
    inputs = {
        "gap": {"distribution": "uniform", "low": 0.01, "high": 0.02},
        "period_factors": {"left": {"distribution": "lognormal", "median": 1.0, "dispersion": 0.2}},
        "restitution": {"distribution": "uniform", "low": 0.3, "high": 0.7},
    }
    given = {"scene": "mate2015", "records": "el_centro", "laws": ["linear", "kelvin_voigt"], "scales": [1.0, 2.0]}
    assert digest(found) == digest(build_spec(**given, design=told("latin_hypercube", 5, 7, **inputs)))
    assert digest(found) != digest(build_spec(**given, design=told("latin_hypercube", 5, 8, **inputs)))
    assert [each.name for each in found.design.inputs] == ["gap", "restitution", "period_factor_left"]
    assert design_of(json.loads(to_json(found))["design"]) == found.design
    first, last = found.cases[0], found.cases[-1]
    assert (len(found.cases), found.axes, found.laws) == (20, {}, ("linear", "kelvin_voigt"))
    assert (first.law, first.scale, last.law, last.scale) == ("linear", 1.0, "kelvin_voigt", 2.0)
    at = found.design.shares
    assert first.gap == pytest.approx(0.01 + 0.01 * at[0, 0], rel=1e-12)
    assert last.restitution == pytest.approx(0.3 + 0.4 * at[4, 1], rel=1e-12)
    assert dict(last.period_factors) == {"left": pytest.approx(np.exp(0.2 * stats.norm.ppf(at[4, 2])))}
    assert found.cases[5].gap == first.gap  # every point at every scale


def test_factors_on_other_buildings_stand_beside_those_drawn():
    found = sweep(told("sobol", 2), laws="kelvin_voigt", period_factors={"c": [0.9, 1.0], "a": 1.1}, gaps=None).spec
    assert len(found.cases) == 2 * 2 * 2
    drawn = [dict(case.period_factors)["b"] for case in found.cases]
    expected = [("a", 1.1), ("b", drawn[0]), ("c", 0.9)]
    assert found.cases[0].period_factors == tuple(expected)
    assert found.cases[2].period_factors == (("a", 1.1), ("b", drawn[0]))  # a factor of 1 is left out
    assert found.cases[0].stiffness_factor == 1.0
    assert sweep(told("sobol", 2), laws="none").spec.cases[0].stiffness_factor is None


def test_plan_tells_the_design(tmp_path):
    (tmp_path / "s.toml").write_text(FILE)
    said = " ".join(call("plan", tmp_path / "s.toml").stdout.split())
    assert "latin_hypercube design, 5 points (seed 7) of gap, restitution, period_factor_left" in said
    assert "20 asked" in said


def test_records_may_be_drawn():
    records = motions()
    inputs = {"record": {"distribution": "any"}, **INPUTS}
    spec = sweep(told("sobol", 16, **inputs), records=records).spec
    assert len(spec.cases) == 3 * 16
    assert [sum(case.record == record.name for case in spec.cases) for record in records] == [24, 24]


@pytest.mark.usefixtures("stub_engine")
class TestRuns:
    def test_the_cube_has_what_was_drawn(self):
        job = sweep()
        cube = job.run(workers=1)
        assert cube.sizes["case"] == 3 * 2 * 8 * 5
        for name, key in (("gap", "gap"), ("restitution", "restitution")):
            assert cube[name].values.tolist() == [getattr(case, key) for case in job.spec.cases]
        assert cube["gap"].attrs["units"] == "m"
        own = cube["period_factor"].sel(building="b")
        assert (cube["period_factor_b"].values == own.values).all()
        blocks = cube["design_block"].values.reshape(6, 5, 8)
        assert (blocks == np.array(["A", "B", "gap", "restitution", "period_factor_b"])[:, None]).all()
        assert (cube["design_sample"].values.reshape(30, 8) == np.arange(1, 9)).all()
        still = cube.isel(case=cube["law"].values == "none")
        same = still["displacement_max"].values.reshape(2, 5, -1)
        assert (same[:, 0] == same[:, 2]).all()  # without pounding a gap changes nothing
        assert job.plan().n_unique < cube.sizes["case"] - 40

    def test_cubes_of_two_designs_are_merged_as_cases(self, tmp_path):
        more = {**INPUTS, "scale": {"distribution": "uniform", "low": 0.5, "high": 2.0}}
        sweep(told("sobol", 4)).run(tmp_path / "a.nc", workers=1).close()
        sweep(told("latin_hypercube", 3, 5, **more)).run(tmp_path / "b.nc", workers=1).close()
        merge_cubes([tmp_path / "a.nc", tmp_path / "b.nc"], tmp_path / "both.nc")
        with open_cube(tmp_path / "both.nc") as cube:
            assert cube.sizes["case"] == 3 * 2 * (4 + 3)
            assert {"design_sample", "gap", "period_factor_b"} & {*cube.coords} == set()
            assert {"scale", "restitution"} <= {*cube.coords}
            assert "design" not in json.loads(cube.attrs["sweep"])
