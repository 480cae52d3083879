"""Wide tables: every number where a slow loop over scenarios, moments and places puts it."""

from __future__ import annotations

import json
import math
from functools import lru_cache

import numpy as np
import pytest
from scenes import call, motions, pair
from test_export import read

from pounding_sweep import Sweep, simulate
from pounding_sweep.analysis.rebuild import with_intensities
from pounding_sweep.analysis.spectra import response_spectrum
from pounding_sweep.base.errors import InputError
from pounding_sweep.output import export as tables
from pounding_sweep.output.export import export_cube
from pounding_sweep.output.netcdf import open_cube, write_cube
from pounding_sweep.output.select import select
from pounding_sweep.records.record import record_measures
from pounding_sweep.request.spec import scene_of

pytestmark = pytest.mark.usefixtures("stub_module")
OUTPUTS = ["displacement_max", "impact_force_max", "impact_count"]
DESIGN = {
    "kind": "halton",
    "samples": 4,
    "inputs": {
        "gap": {"distribution": "uniform", "low": 0.001, "high": 0.01},
        "damping_ratio": {"distribution": "uniform", "low": 0.02, "high": 0.08},
        "period_factors": {"b": {"distribution": "lognormal", "median": 1.0, "dispersion": 0.3}},
    },
}
SWEEPS = {
    "axes": {"gaps": [0.0002, 0.001], "restitutions": [0.4, 0.6], "scales": [1.0, -2.0]},
    "pgas": {"gaps": [0.001], "pgas": [2.0, 3.0]},
    "buildings": {"period_factors": {"b": [1.0, 1.3]}, "mass_factors": {"a": [0.7]}, "damping_ratios": [0.02, 0.05]},
    "cases": {"laws": None, "cases": [
        {"law": "linear", "record": "one"}, {"law": "stereomechanical", "record": "two", "scale": 2.0, "gap": 0.001},
        {"law": "kelvin_voigt", "record": "two", "gap": 0.0003, "damping_ratio": 0.02, "period_factors": {"b": 1.4}},
    ]},
    "design": {"design": DESIGN},
}  # fmt: skip


def made(name):
    settings = {"laws": ["none", "kelvin_voigt", "stereomechanical"], "records": motions(), "dt": 0.005}
    settings |= {"outputs": OUTPUTS, "audit": 1.0, "force_unstable": True}
    return Sweep(pair(0.0005), **{**settings, **SWEEPS[name]}).run(workers=1)


@pytest.fixture(
    scope="module", params=[pytest.param(name, marks=pytest.mark.slow) if name == "pgas" else name for name in SWEEPS]
)
def cube(stub_module, request):
    return made(request.param)


def same(text, value):
    if isinstance(value, str):
        return text == value
    """A cell and its value, of which files have seven digits."""
    return (text == "" and math.isnan(value)) or (text != "" and float(text) == float(f"{value:.7g}"))


@lru_cache
def measured(record, scale):
    return record_measures(record.scaled(scale))


@lru_cache
def ordinate(record, scale, period):
    return float(response_spectrum(record.scaled(scale), [period], 0.05)["pseudo_acceleration"].squeeze())


@pytest.mark.slow
def test_one_row_for_each_scenario(cube, tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "CELLS_AT_A_TIME", 300)
    rows = read(export_cube(cube, tmp_path / "t.csv", table=True))
    status = cube["status"]
    dims, records = status.dims, {each.name: each for each in motions()}
    u, n = (
        cube["displacement_max"].sel(building="b", storey=[1, 2]),
        cube["impact_count"].sel(storey=[1, 2], pair="a-b"),
    )
    floors = [each.transpose(*dims, "storey").values for each in (u, n)]
    about = [cube[name].broadcast_like(status).transpose(*dims).values for name in (*dims, "record", "scale")]
    assert len(rows) == status.size
    for place, row in zip(np.ndindex(status.shape), rows, strict=True):
        *labels, record, scale = (each[place].item() for each in about)
        assert all(same(row[dim], label) for dim, label in zip(dims, labels, strict=True))
        assert same(row["status"], status.values[place].item())
        for i, storey in enumerate((1, 2)):
            assert same(row[f"displacement_max_b_{storey}"], floors[0][place][i].item())
            assert same(row[f"impact_count_a_b_{storey}"], floors[1][place][i].item())
        measures = measured(records[record], scale)
        for name in ("pga", "pgv", "arias_intensity", "significant_duration", "duration"):
            assert float(row[f"ground_{name}"]) == pytest.approx(getattr(measures, name), rel=1e-12)


def test_audited_errors_stand_with_their_scenarios(cube, tmp_path):
    """Each audited scenario is found by what the cube says of it, by a loop; no other row has an error."""
    rows = read(export_cube(cube, tmp_path / "t.csv", table=True))
    texts = {name: [row[f"audited_error_{name}"] for row in rows] for name in cube["output"].values.tolist()}
    held = set()
    assert cube.sizes["audit"] >= 1
    places = [
        cube[["status", "displacement_max", "impact_count"]].isel(dict(zip(cube["status"].dims, at, strict=True)))
        for at in np.ndindex(cube["status"].shape)
    ]
    for i in range(cube.sizes["audit"]):
        one = cube.isel(audit=i)
        law = str(one["audit_law"].item())
        alike = []
        for place, here in enumerate(places):
            ok = here["law"].item() == law and here["record"].item() == one["audit_record"].item()
            ok &= float(here["scale"]) == float(one["audit_scale"])
            ok &= float(here["pair_gap"].values[0]) == float(one["audit_gap"].values[0])
            ok &= law == "linear" or float(here["restitution"]) == float(one["audit_restitution"])
            if "audit_period_factor" in cube.coords:
                periods = [b.periods[0] for b in scene_of(json.loads(cube.attrs["sweep"])["scene"]).buildings]
                ok &= np.allclose(here["fundamental_period"], periods * one["audit_period_factor"], rtol=1e-12)
                masses = here["floor_mass"].values[:, 0] / np.array([120.0, 80.0])
                ok &= np.allclose(masses, one["audit_mass_factor"].values, rtol=1e-12)
                ratio = float(one["audit_damping_ratio"])
                own = 0.05 if math.isnan(ratio) else ratio
                ok &= float(here["first_damping_ratio"].values[0]) == pytest.approx(own, rel=1e-9)
            alike += [place] if ok else []
        assert alike
        held |= {*alike}
        for j, name in enumerate(texts):
            assert all(same(texts[name][place], float(one["audit_error"].values[j])) for place in alike)
    assert {i for i, text in enumerate(texts["displacement_max"]) if text} == held


def test_a_part_of_the_row_leaves_out_columns_alone(tmp_path):
    """Scenarios are known by the whole row, here by a factor on the other building; a part alone tells no errors."""
    cube = made("buildings")
    path, whole = write_cube(cube, tmp_path / "a.nc"), read(export_cube(cube, tmp_path / "t.csv", table=True))
    for at, gone in (("building=a", "_b"), ("pair=a-b", ""), ("storey=1", "_2")):
        call("export", path, "-o", tmp_path / "p.csv", "--table", "--overwrite", "--at", at)
        rows = read(tmp_path / "p.csv")
        left_out = [name for name in whole[0] if name not in rows[0]]
        assert all(gone in name for name in left_out)
        assert bool(left_out) == bool(gone)
        assert rows == [{name: text for name, text in row.items() if name in rows[0]} for row in whole]
        assert any(row["audited_error_displacement_max"] for row in rows)
    alone = read(export_cube(cube.sel(building="a"), tmp_path / "p.csv", table=True, overwrite=True))
    assert [row["displacement_max_1"] for row in alone] == [row["displacement_max_a_1"] for row in whole]
    assert not [name for name in alone[0] if name.startswith("audited")]


def test_inputs_are_columns(tmp_path):
    cube = made("design")
    export_cube(cube, tmp_path / "t.csv", ["impact_force_max"], table=True)
    rows = read(tmp_path / "t.csv")
    columns = json.loads((tmp_path / "t.csv.json").read_text())["columns"]
    assert {"gap", "damping_ratio", "period_factor_b", "design_sample", "law", "record", "status"} <= {*rows[0]}
    assert not {"displacement_max_a_1", "audited_error_displacement_max"} & {*rows[0]}
    assert not [name for name in rows[0] if name.endswith("_no2")]
    assert {"audited_error_impact_force_max", "floor_mass_a_1", "fundamental_period_b"} <= {*rows[0]}
    assert columns["gap"]["units"] == "m"
    assert columns["ground_arias_intensity"]["units"] == "m s-1"


@pytest.mark.parametrize(
    "name", [*(pytest.param(name, marks=pytest.mark.slow) for name in ("axes", "pgas")), "cases", "design"]
)
def test_chosen_intensities_are_columns(name, tmp_path):
    """Spectral accelerations of the records as scaled, by their response spectra, a scenario at a time."""
    cube = with_intensities(made(name), ["sa(0.3)", "sa(b)"], records=motions())
    rows = read(export_cube(cube, tmp_path / "t.csv", ["impact_force_max"], table=True))
    first = pair().buildings[1].periods[0]
    cube = cube[["status"]]
    dims = cube["status"].dims
    for place, row in zip(np.ndindex(cube["status"].shape), rows, strict=True):
        one = cube.isel(dict(zip(dims, place, strict=True)))
        (record,) = [each for each in motions() if each.name == one["record"].item()]
        for column, period in (("ground_sa_0_3", 0.3), ("ground_sa_b", first)):
            assert float(row[column]) == pytest.approx(ordinate(record, float(one["scale"]), period), rel=1e-6)


def test_a_part_and_a_file(tmp_path):
    path = write_cube(made("axes"), tmp_path / "a.nc")
    at = ["--at", "law=kelvin_voigt", "--at", "record=two"]
    call("export", path, "-o", tmp_path / "t.csv", "--table", *at)
    rows = read(tmp_path / "t.csv")
    assert len(rows) == 8
    assert {row["law"] for row in rows} == {"kelvin_voigt"}
    with open_cube(path) as cube:
        part = select(cube, {"law": "kelvin_voigt", "record": "two"})
        largest = part["displacement_max"].values[..., 0, 1].ravel().tolist()
        assert all(same(row["displacement_max_a_2"], value) for row, value in zip(rows, largest, strict=True))


@pytest.fixture(scope="module")
def one(stub_module):
    return simulate(pair(), motions()[0], law="linear", dt=0.01)


def test_histories_have_a_row_for_each_moment(one, tmp_path):
    """No cell is written twice: as many numbers as histories have."""
    rows = read(export_cube(one, tmp_path / "one.csv"))
    histories = [name for name, array in one.data_vars.items() if "time" in array.dims]
    assert len(rows) == one.sizes["time"]
    assert len(rows[0]) == 1 + sum(one[name].size // one.sizes["time"] for name in histories)
    for moment in (0, 7, -1):
        here = one.isel(time=moment)
        assert float(rows[moment]["time"]) == here["time"].item()
        assert same(rows[moment]["displacement_b_2"], here["displacement"].sel(building="b", storey=2).item())
        assert same(rows[moment]["contact_force_a_b_1"], here["contact_force"].values[0, 0])
        assert same(rows[moment]["ground_acceleration"], here["ground_acceleration"].item())


def test_peaks_of_a_scenario_are_exported_alone(one, tmp_path):
    rows = read(export_cube(one, tmp_path / "peaks.csv", ["displacement_max", "impact_force_max"]))
    assert len(rows) == 4 + 2
    with pytest.raises(InputError, match="Zarr holds cubes, no tables"):
        export_cube(one, tmp_path / "table.zarr", table=True)
    with pytest.raises(InputError, match="one scenario with its histories"):
        export_cube(one, tmp_path / "table.csv", table=True)
