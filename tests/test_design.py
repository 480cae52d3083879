"""Designs of experiments, and what inputs matter."""

from __future__ import annotations

import json
from functools import lru_cache

import numpy as np
import pytest
import xarray as xr
from scenes import call, hand_cube, motions, random_fill, row
from scipy import stats

from pounding_sweep import Sweep, pulse_record
from pounding_sweep.analysis import sensitivity
from pounding_sweep.analysis.comparisons.sensitivity import bootstrap_intervals, index_rows, sobol_indices
from pounding_sweep.base.errors import InputError
from pounding_sweep.output.merge import merge_cubes
from pounding_sweep.output.netcdf import open_cube, write_cube
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


UNIFORM = {"distribution": "uniform", "low": 0.0, "high": 1.0}
MATTERING = {
    "gap": {"distribution": "uniform", "low": 0.002, "high": 0.02},
    "scale": {"distribution": "uniform", "low": 0.8, "high": 1.2},
    "damping_ratio": {"distribution": "uniform", "low": 0.02, "high": 0.08},
}


@lru_cache(4)
def samples_of(samples, seed):
    """Return the points of a Saltelli design of the package, shape (blocks, samples, inputs)."""
    design = {"kind": "saltelli", "samples": samples, "seed": seed, "inputs": dict.fromkeys(MATTERING, UNIFORM)}
    spec = build_spec(scene="mate2015", records="el_centro", laws="linear", design=design)
    return spec.design.shares.reshape(5, samples, 3)


def evaluated(model, samples, seed=0):
    return np.stack([model(block) for block in samples_of(samples, seed)])


def ishigami(x):
    """sin x1 + a sin^2 x2 + b x3^4 sin x1, each x uniform in -pi..pi (Ishigami & Homma 1990)."""
    x = np.pi * (2.0 * x - 1.0)
    return np.sin(x[..., 0]) + 7.0 * np.sin(x[..., 1]) ** 2 + 0.1 * x[..., 2] ** 4 * np.sin(x[..., 0])


def ishigami_indices(a=7.0, b=0.1):
    one = 0.5 * (1.0 + b * np.pi**4 / 5.0) ** 2
    two = a**2 / 8.0
    both = b**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    return np.array([[one, two, 0.0], [one + both, two, both]]) / (one + two + both)


WEIGHTS = np.array([0.0, 1.0, 4.5])


def g_function(x):
    """Product of (|4 x_i - 2| + a_i) / (1 + a_i) (Sobol' 1993)."""
    return np.prod((np.abs(4.0 * x - 2.0) + WEIGHTS) / (1.0 + WEIGHTS), axis=-1)


def g_function_indices():
    parts = 1.0 / (3.0 * (1.0 + WEIGHTS) ** 2)
    whole = np.prod(1.0 + parts)
    return np.array([parts, parts * whole / (1.0 + parts)]) / (whole - 1.0)


@pytest.mark.parametrize(
    ("model", "exact"), [(ishigami, ishigami_indices()), (g_function, g_function_indices())], ids=["ishigami", "g"]
)
def test_models_with_known_indices(model, exact):
    few, many = (np.abs(sobol_indices(evaluated(model, n)) - exact).max() for n in (1 << 8, 1 << 12))
    assert many < 5e-3
    assert many < 0.2 * few  # they go on getting better


@pytest.mark.slow
def test_intervals_hold_the_known_indices_as_often_as_they_say():
    exact, inside = ishigami_indices(), []
    for seed in range(40):
        low, high = bootstrap_intervals(evaluated(ishigami, 128, seed), 0.9, 200, seed)
        inside.append((low <= exact) & (exact <= high))
    # scrambled Sobol' points are better than random ones, which the bootstrap takes them for
    assert 0.85 < np.mean(inside) <= 1.0


def test_what_does_not_vary_has_no_indices():
    rounded = evaluated(lambda x: 1.0 + 1e-12 * x[..., 0], 64)
    assert np.isnan(sobol_indices(rounded)).all()
    assert np.isnan(bootstrap_intervals(rounded, 0.9, 20)).all()
    two = np.stack([evaluated(ishigami, 64), rounded], axis=1)
    assert np.isfinite(sobol_indices(two)[0]).tolist() == [[True, False]] * 3  # the one beside is not touched by it


# -- of a sweep --------------------------------------------------------------------------------------------------------


def study(**changes):
    settings = {"laws": ["linear", "none"], "records": "el_centro", "dt": 0.005, "audit": 0.0, "method": "rk4"}
    settings |= {"outputs": ["displacement_max", "impact_force_max", "first_impact_time"]}
    settings |= {"design": {"kind": "saltelli", "samples": 32, "seed": 2, "inputs": MATTERING}}
    return Sweep(**{"scene": "mate2015", **settings, **changes})


@pytest.fixture(scope="module")
def cube(stub_module):
    return study().run(workers=1)


def test_indices_of_a_sweep(cube):
    """As by hand, from the rows of the cube; without pounding the gap is nothing and the scale almost all."""
    result = sensitivity(cube, resamples=50)
    assert result["law"].values.tolist() == ["linear", "none"]
    assert result["record"].values.tolist() == ["el_centro", "el_centro"]
    assert result["input"].values.tolist() == [*MATTERING]
    assert "first_impact_time_first" not in result
    table = cube["displacement_max"].values.reshape(2, 5, 32, 3, 3)
    for law in range(2):
        for what, indices in zip(("first", "total"), sobol_indices(table[law].transpose(0, 2, 3, 1)), strict=True):
            np.testing.assert_allclose(result[f"displacement_max_{what}"].values[law], indices, atol=1e-12)
    still = result["displacement_max_total"].isel(group=1)
    assert (still.sel(input="gap") == 0.0).all()
    assert (still.sel(input="scale") + still.sel(input="damping_ratio") == pytest.approx(1.0, abs=0.25)).all()
    assert (result["displacement_max_samples"] == 32).all()
    low, high = (result["displacement_max_total_interval"].sel(bound=end) for end in ("lower", "upper"))
    assert bool((low <= high).all())


def test_failed_scenarios_take_their_point_along(cube):
    status = cube["status"].copy(deep=True)
    status[{"case": [3, 32 * 2 + 7]}] = 1
    samples = sensitivity(cube.assign(status=status), ["displacement_max"], resamples=10)["displacement_max_samples"]
    assert (samples.isel(group=0) == 30).all()
    assert (samples.isel(group=1) == 32).all()


def test_rows_may_stand_in_any_order(cube):
    mixed = cube.isel(case=np.random.default_rng(0).permutation(cube.sizes["case"]))
    one, two = (sensitivity(each, ["displacement_max"], resamples=10) for each in (cube, mixed))
    xr.testing.assert_equal(one, two)


def test_other_axes_are_told_apart_and_records_may_be_drawn(stub_engine):
    design = {"kind": "saltelli", "samples": 16, "inputs": {**MATTERING, "record": {"distribution": "any"}}}
    pulse = pulse_record("sine", amplitude=2.0, period=0.6, dt=0.02, name="pulse")
    other = study(design=design, records=["el_centro", pulse], stiffness_factors=[1.0, 2.0])
    result = sensitivity(other.run(workers=1), ["displacement_max"], resamples=10)
    assert result["record"].values.tolist() == ["drawn"] * 3
    assert result["beside"].values.tolist() == ["stiffness_factor=1.0", "stiffness_factor=2.0", ""]
    assert float(result["displacement_max_total"].sel(input="record").min()) > 0.1


@pytest.mark.parametrize(
    ("make", "arguments", "message"),
    [
        (lambda cube: cube.isel(case=slice(1, None)), {}, "1 of the 160 points of the design with linear are not in"),
        (lambda cube: cube, {"variables": ["impuls"]}, "unknown output 'impuls'"),
        (lambda cube: cube, {"confidence": 2.0}, r"confidence: 2 is not in \(0, 1\)"),
        (
            lambda _: study(design={"kind": "sobol", "samples": 4, "inputs": MATTERING}).run(workers=1),
            {},
            'kind "saltelli", and this cube is a part of one of kind "sobol"',
        ),
        (
            lambda _: study(design=None, gaps=[0.01]).run(workers=1),
            {},
            "needs an axis of several values, or a design",
        ),
    ],
)
def test_what_can_not_be_done(cube, stub_engine, make, arguments, message):
    with pytest.raises(InputError, match=message):
        sensitivity(make(cube), **arguments)


@pytest.mark.parametrize("lost", [[], [1, 4]])
def test_shares_of_a_grid(lost):
    """As sums of squares over rows of a table, without those that are not ok or have no contact."""
    axes = {"law": ["none", "linear"], "gap": [0.1, 0.2, 0.3], "record": ["one", "two"], "scale": [1.0]}
    status = np.zeros((2, 6))
    status[1, lost] = 1
    made = hand_cube(axes, random_fill(3, "drift_max"), status=status.reshape(2, 3, 2, 1))
    result = sensitivity(made, ["drift_max"]).isel(group=0).sel(building="a", storey=2)
    rows = made.drift_max.where(made.status == 0).sel(law="linear", building="a", storey=2).to_series().dropna()
    squares, names = rows.groupby, {"gap": "gap (m)", "record": "record"}
    for axis, other in (("gap", "record"), ("record", "gap")):
        one, whole = result.sel(input=names[axis]), ((rows - rows.mean()) ** 2).sum()
        means = squares(axis).transform("mean")
        assert one.drift_max_first == pytest.approx(((means - rows.mean()) ** 2).sum() / whole)
        assert one.drift_max_total == pytest.approx(((rows - squares(other).transform("mean")) ** 2).sum() / whole)
        assert one.drift_max_mean_interval.values.tolist() == pytest.approx([means.min(), means.max()])
        at = [squares(axis).mean().idxmin(), squares(axis).mean().idxmax()]
        assert one.drift_max_at_interval.values.tolist() == at
    assert result.drift_max_samples == 6 - len(lost)
    assert len(index_rows(sensitivity(made, ["drift_max"]))) == 2 * 3


def test_command(cube, tmp_path):
    path, out = write_cube(cube, tmp_path / "a.nc"), tmp_path / "out"
    result = call("compare", path, "--what", "sensitivity", "-o", out, "--json")
    rows = json.loads(result.stdout)["sensitivity"]["rows"]
    assert {row["variable"] for row in rows} == {"displacement_max", "impact_force_max"}
    assert rows == index_rows(sensitivity(cube))
    assert len(rows) == 3 * (2 * 9 + 6)
    assert rows[0].keys() >= {"variable", "law", "record", "building", "storey", "input", "first", "total_lower"}
    assert [row["total"] for row in rows[:3]] == sorted((row["total"] for row in rows[:3]), reverse=True)
    assert (out / "sensitivity.csv").exists()
