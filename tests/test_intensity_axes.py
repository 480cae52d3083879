"""Axes of intensity: records scaled to peak or spectral accelerations, strengths found for constant ductility."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
import xarray as xr
from kernels_used import YIELDING_SWEEP
from scenes import OUTPUTS, motions, pair, row, yielding_pair

import pounding_sweep as ps
from pounding_sweep.analysis import required_gap, response_spectrum, scaled_to_sa
from pounding_sweep.analysis.comparisons import MOTION_DIMS
from pounding_sweep.analysis.rebuild import intensity_of
from pounding_sweep.base.errors import InputError, PoundingSweepError, RecordError, SweepError
from pounding_sweep.engine import spectrum
from pounding_sweep.output.merge import merge_cubes
from pounding_sweep.plan.plan import make_plan
from pounding_sweep.request.axes import DIMENSIONS, Case
from pounding_sweep.request.build import build_spec
from pounding_sweep.request.spec import digest, to_json
from pounding_sweep.request.toml import load_spec
from pounding_sweep.run.simulate import scenario_of, selectors, simulate_one
from pounding_sweep.variables.registry import Status

PGAS = [1.5, 4.0]


def build(**changes):
    return build_spec(**{"scene": row(), "records": motions(), "laws": ["linear", "none"], **changes})


# -- peak ground accelerations -----------------------------------------------------------------------------------------


def test_every_record_has_every_peak():
    spec = build(pgas=PGAS)
    assert spec.axes["pga"] == (1.5, 4.0)
    assert "scale" not in spec.axes
    assert json.loads(to_json(spec))["pgas"] == PGAS
    assert "pga" not in json.loads(to_json(build(scales=[2.0])))
    plan = make_plan(spec)
    table = plan.unique[plan.inverse]
    peaks = table.scale * np.array([record.pga for record in spec.records])[table.record]
    shape = [len(values) for values in spec.axes.values()]
    np.testing.assert_allclose(peaks.reshape(shape), np.broadcast_to(PGAS, shape), rtol=1e-15)
    assert scenario_of(spec)["pga"] == 1.5


def test_files_and_cases_have_it_too(tmp_path):
    head = '[scene]\npreset = "mate2015"\n[sweep]\nrecords = ["el_centro"]\n'
    (tmp_path / "axis.toml").write_text(f'{head}laws = "linear"\npgas = {{ start = 1.0, stop = 3.0, count = 3 }}\n')
    assert load_spec(tmp_path / "axis.toml").pgas == (1.0, 2.0, 3.0)
    (tmp_path / "cases.toml").write_text(f'{head}[[sweep.cases]]\nlaw = "none"\npga = 2.0\n')
    spec = load_spec(tmp_path / "cases.toml")
    assert spec.cases == (Case("none", record="el_centro", pga=2.0),)
    assert make_plan(spec).unique.scale.tolist() == [2.0 / spec.records[0].pga]


def test_a_cube_says_the_factor_on_each_record():
    cube = ps.Sweep(row(), motions(), "none", pgas=PGAS, outputs=["displacement_max"], method="rk4", audit=0.0).run()
    assert cube["pga"].attrs["units"] == "m s-2"
    assert cube["scale"].dims == ("record", "pga")
    np.testing.assert_allclose(cube["scale"] * cube["record_pga"], np.broadcast_to(PGAS, (cube.sizes["record"], 2)))


# -- spectral accelerations --------------------------------------------------------------------------------------------


def sweep(**more):
    given = {"sas": [2.0, 5.0], "sa_period": 0.6, "gaps": [0.002], "method": "rk4", "dt": 0.005, "outputs": OUTPUTS}
    return ps.Sweep(pair(), motions(), "linear", **given | more)


@pytest.mark.parametrize("period", [0.05, 0.6, 3.0])
def test_every_record_has_the_spectral_acceleration_asked_for(period):
    spec = sweep(sa_period=period).spec
    axis, values = spec.needed_axis("scale")
    for record in spec.records:
        for value in values:
            scaled = record.scaled(spec.scale(axis, value, record))
            found = response_spectrum(scaled, [period])["pseudo_acceleration"].item()
            assert found == pytest.approx(value, rel=1e-12)


@pytest.mark.usefixtures("stub_engine")
def test_a_cube_has_the_axis_and_the_factors(tmp_path):
    job = sweep()
    job.run(tmp_path / "a.nc", scheduler="synchronous").close()
    with ps.open_cube(tmp_path / "a.nc") as cube:
        assert cube["sa"].values.tolist() == [2.0, 5.0]
        assert cube["sa"].attrs["units"] == "m s-2"
        assert float(cube.attrs["sa_period"]) == 0.6
        assert cube["scale"].dims == ("record", "sa")
        want = [[v / response_spectrum(r, [0.6])["pseudo_acceleration"].item() for v in (2.0, 5.0)] for r in motions()]
        np.testing.assert_allclose(cube["scale"].values, want, rtol=1e-12)
    grown = sweep(sas=[2.0, 5.0, 8.0]).run(tmp_path / "b.nc", scheduler="synchronous", extend=tmp_path / "a.nc")
    assert json.loads(grown.attrs["extended_from"])["scenarios_taken"] >= 2
    grown.close()
    sweep(sa_period=0.7).run(tmp_path / "c.nc", scheduler="synchronous").close()
    with pytest.raises(InputError, match="study: sa_period is 0"):
        merge_cubes([tmp_path / "a.nc", tmp_path / "c.nc"], tmp_path / "d.nc")


@pytest.mark.usefixtures("stub_engine")
def test_it_is_the_intensity_of_comparisons():
    assert ("record", *DIMENSIONS["scale"]) == MOTION_DIMS
    cube = sweep().run(workers=1)
    own, pga = intensity_of(cube), intensity_of(cube, "pga")
    measured = intensity_of(cube, "sa(0.60)", records=motions())  # another spelling: from the motions
    xr.testing.assert_allclose(own, measured.transpose(*own.dims), rtol=1e-12)
    assert own.attrs == measured.attrs | {"long_name": own.attrs["long_name"]}
    assert float(pga.std("record").min()) > 0.0 == float(own.std("record").max())
    need = required_gap(cube, motions())
    assert need.sizes["sa"] == 2
    ratio = need["exact"].isel(sa=1) / need["exact"].isel(sa=0)
    assert float(ratio.min()) > 0.0


def test_listed_cases_take_it_too():
    spec = ps.Sweep(pair(), motions()[0], cases=[Case("linear", sa=4.0), Case("linear", scale=2.0)], sa_period=1.0).spec
    found = response_spectrum(motions()[0], [1.0])["pseudo_acceleration"].item()
    assert [spec.case_value(case, "scale") for case in spec.cases] == pytest.approx([4.0 / found, 2.0])


def test_one_record_is_scaled(tmp_path):
    """In Python, by name and from a file, to 5 m/s2 at 0.4 s."""
    file = tmp_path / "motion.csv"
    record = ps.find_record("el_centro")
    points = zip(record.time, record.acceleration, strict=True)
    file.write_text("time (s),acc (m/s2)\n" + "".join(f"{t:.6g},{float(a)!r}\n" for t, a in points), encoding="utf-8")
    given = [{"record": "el_centro", "sa": 5.0, "sa_period": 0.4}, {"path": str(file), "sa": 5.0, "sa_period": 0.4}]
    given.append(scaled_to_sa(ps.find_record("el_centro"), 5.0, period=0.4).renamed("third"))
    records = ps.Sweep("mate2015", given, "linear", dt=0.01, force_unstable=True).spec.records
    assert [each.name for each in records] == ["el_centro", "motion", "third"]
    for each in records:
        assert response_spectrum(each, [0.4])["pseudo_acceleration"].item() == pytest.approx(5.0, rel=1e-9)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"sa": 5.0}, "sa_period: is missing; give The period"),
        ({"sa_period": 0.4}, "sa: is missing; give A spectral acceleration"),
        ({"sa": 5.0, "sa_period": 0.4, "pga": 2.0}, "sa and pga exclude each other"),
        ({"sa": 5.0, "sa_period": 0.4, "scale": 2.0}, "sa and scale exclude each other"),
        ({"sa": -5.0, "sa_period": 0.4}, "spectral acceleration to scale to"),
        ({"sa": 5.0, "sa_period": 1e-9}, r"can't be scaled .* at 1e-09 s; give a period of 0\.000"),
        ({"sa": 5.0, "sa_period": "x"}, "must be a valid number"),
    ],
)
def test_a_record_that_can_not_be_scaled_so(given, said):
    with pytest.raises(PoundingSweepError, match=said):
        ps.Sweep("mate2015", [{"record": "el_centro", **given}], "linear")


def test_no_motion_has_no_scale():
    still = ps.Record("still", 0.01, np.zeros(5))
    with pytest.raises(RecordError, match="zero throughout"):
        scaled_to_sa(still, 1.0, 0.5)


GIVEN = {key: value for key, value in YIELDING_SWEEP.items() if key not in ("strength_factors", "hardenings")}
SWEEP = GIVEN | {"gaps": [0.001, 0.004], "ductilities": [1.5, 4.0]}


@lru_cache
def swept():
    sweep = ps.Sweep(**SWEEP)
    return sweep, sweep.run()


def reached(cube):
    """Largest ductility of each building."""
    return cube.ductility_max.max("storey").transpose("case", "building").values


def test_without_pounding_each_building_reaches_it():
    _, cube = swept()
    assert (cube.status == Status.OK).all()
    still = cube.isel(case=cube.law.values == "none")
    assert still.sizes["case"] == 2 * 2 * 2 * 2
    assert set(still.ductility.values) == {1.5, 4.0}
    np.testing.assert_allclose(reached(still), np.repeat(still.ductility.values[:, None], 2, axis=1), rtol=2e-4)
    apart = cube.isel(case=(cube.law.values != "none") & (cube.pair_gap.values[:, 0] == 0.001))
    assert np.abs(reached(apart) / apart.ductility.values[:, None] - 1.0).max() > 0.1  # what pounding does to it


def test_strengths_are_those_of_the_analysis_and_grow_with_the_motion():
    _, cube = swept()
    found = ps.analysis.constant_ductility(yielding_pair(), motions(), [1.5, 4.0]).strength_factor
    for i in range(cube.sizes["case"]):
        want = found.sel(record=str(cube.record.values[i]), ductility=float(cube.ductility.values[i]))
        np.testing.assert_allclose(cube.strength_factor.values[i], want * cube.scale.values[i], rtol=1e-8)


def test_nothing_is_run_twice():
    sweep, cube = swept()
    plan = sweep.plan()
    assert plan.n_asked == cube.sizes["case"] == 2 * 2 * 2 * 2 * 2
    # records, scales and ductilities each decide on a run without pounding, gaps and laws don't
    assert len(plan.uncoupled_runs) == 2 * 2 * 2
    assert plan.n_unique == 8 + 2 * 8


def test_the_cube_can_be_unfolded():
    """As the documentation says."""
    _, cube = swept()
    gap = cube.pair_gap.isel(pair=0).drop_vars("pair")
    table = cube[["ductility_max"]].reset_coords(drop=True)
    table = table.assign_coords({"gap": gap, **{n: cube[n] for n in ("law", "record", "scale", "ductility")}})
    table = table.set_index(case=["law", "gap", "record", "scale", "ductility"]).unstack("case")
    one = table.sel(law="none", gap=0.001, record="one", scale=0.5, ductility=4.0)
    np.testing.assert_allclose(one.ductility_max.max("storey").values, [4.0, 4.0], rtol=2e-4)


@pytest.mark.slow
def test_other_properties_of_buildings_are_as_given():
    """Periods, damping and hardening each have strengths of their own; masses have none."""
    more = {
        "period_factors": {"a": [1.0, 1.4]},
        "mass_factors": {"b": [1.0, 3.0]},
        "damping_ratios": [0.02],
        "hardenings": {"a": [0.0, 0.1]},
    }
    given = GIVEN | {"laws": ["none"], "records": motions()[0], "gaps": [1e3], "scales": [1.0], "ductilities": 3.0}
    cube = ps.Sweep(**given, **more).run()
    assert cube.sizes["case"] == 8
    np.testing.assert_allclose(reached(cube), 3.0, rtol=2e-4)
    factors = {tuple(row) for row in cube.strength_factor.values.round(9)}
    assert len(factors) == 4


def test_listed_cases_have_a_ductility():
    cases = [Case("none", ductility=2.0), Case("none", scale=-2.0, ductility=2.0), Case("none")]
    known = replace(cases[0], strength_factors={"a": 0.5})
    spec = ps.Sweep(yielding_pair(), motions()[0], cases=[*cases, known]).spec
    once, twice = (dict(case.strength_factors) for case in spec.cases[:2])
    assert twice == pytest.approx({name: 2.0 * factor for name, factor in once.items()}, rel=1e-8)
    assert spec.cases[2].strength_factors == ()
    assert spec.cases[3].strength_factors == (("a", 0.5),)  # they were found before
    again = ps.Sweep(yielding_pair(), motions()[0], cases=spec.cases).spec
    assert digest(again) == digest(spec)


@pytest.mark.slow
def test_one_of_its_scenarios_is_simulated():
    spec = swept()[0].spec
    one = simulate_one(spec, case=2)
    assert spec.cases[1].ductility == 4.0
    np.testing.assert_allclose(one.ductility_max.max("storey").values, 4.0, rtol=2e-4)
    assert "ductility" not in selectors(spec)


@pytest.mark.slow
def test_points_of_a_design_take_it():
    inputs = {"ductility": {"distribution": "uniform", "low": 1.5, "high": 3.0}}
    design = {"kind": "latin_hypercube", "samples": 4, "inputs": inputs}
    given = GIVEN | {"laws": ["none"], "records": motions()[0], "gaps": [1e3], "scales": [1.0]}
    cube = ps.Sweep(**given, design=design).run()
    np.testing.assert_allclose(reached(cube), np.repeat(cube.ductility.values[:, None], 2, axis=1), rtol=3e-4)


def test_a_ductility_that_is_not_reached_is_refused(monkeypatch):
    monkeypatch.setattr(spectrum, "REACH", 0.3)
    with pytest.raises(
        SweepError, match=r"ductilities: 4 of building 'a' is not reached under 'one', not even at 1 / 1.2"
    ):
        ps.Sweep(**SWEEP | {"ductilities": 4.0})
