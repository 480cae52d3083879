"""What a cube says of its buildings and of the floors that meet, swept or not."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scenes import pair

from pounding_sweep import Building, Scene, Sweep, Wall
from pounding_sweep.analysis.rebuild import stored_sweep
from pounding_sweep.output.netcdf import open_cube
from pounding_sweep.output.select import select
from pounding_sweep.request.spec import scene_of

pytestmark = pytest.mark.usefixtures("stub_module")
NAMES = (
    *("floor_mass", "storey_stiffness", "fundamental_period", "second_period"),
    *("first_damping_ratio", "second_damping_ratio"),
)


def sweep(scene=None, **changes):
    settings = {"records": "el_centro", "laws": "linear", "outputs": ["drift_max"], "dt": 0.01, "audit": 0.0}
    return Sweep(scene or pair(), **{**settings, "force_unstable": True, **changes})


def check(cube, building, factors, ratio):
    """Compare what a cube says of a building with that building made by hand."""
    (period, mass) = factors
    masses, stiffnesses = np.array(building.masses) * mass, np.array(building.stiffnesses) * mass / period**2
    own = Building(building.name, masses, stiffnesses, building.damping_ratio if ratio is None else ratio)
    here = cube.sel(building=building.name)
    n = own.n_storeys
    assert here["floor_mass"].values[:n] == pytest.approx(masses)
    assert here["storey_stiffness"].values[:n] == pytest.approx(stiffnesses)
    periods = [*own.periods[:2], np.nan][:2]
    found = [float(here[name]) for name in ("fundamental_period", "second_period")]
    assert found == pytest.approx(periods, nan_ok=True)
    ratios = own.damping_ratio if isinstance(own.damping_ratio, tuple) else (own.damping_ratio,) * 2
    found = [float(here[name]) for name in ("first_damping_ratio", "second_damping_ratio")]
    assert found == pytest.approx([ratios[0], ratios[1] if n > 1 else np.nan], nan_ok=True)


def test_buildings_as_given():
    scene = Scene(
        [Building("low", [100.0], [1e4], 0.02), Building("high", [90.0, 80.0], [3e4, 2e4], (0.03, 0.07))], [1]
    )
    cube = sweep(scene, laws="none").run(workers=1)
    assert [cube[name].dims for name in NAMES] == [("building", "storey")] * 2 + [("building",)] * 4
    for building in scene.buildings:
        check(cube, building, (1.0, 1.0), None)
    assert np.isnan(cube["floor_mass"].sel(building="low", storey=2))


def test_buildings_along_their_axes():
    axes = {
        "period_factors": {"a": [0.8, 1.2]},
        "mass_factors": {"a": 2.0, "b": [1.0, 1.5]},
        "damping_ratios": [0.01, 0.1],
    }
    cube = sweep(**axes, gaps=[0.001, 0.5]).run(workers=1)
    assert cube["floor_mass"].dims == ("mass_factor_a", "mass_factor_b", "building", "storey")
    assert cube["fundamental_period"].dims == ("period_factor_a", "building")
    assert cube["first_damping_ratio"].dims == ("damping_ratio", "building")
    one = select(cube, {"period_factor_a": 1.2, "mass_factor_a": 2.0, "mass_factor_b": 1.5, "damping_ratio": 0.1})
    check(one, pair().buildings[0], (1.2, 2.0), 0.1)
    check(one, pair().buildings[1], (1.0, 1.5), 0.1)


def test_buildings_of_listed_cases(tmp_path):
    cases = [
        {"law": "none", "period_factors": {"b": 1.3}},
        {"law": "none", "mass_factors": {"a": 3.0}, "damping_ratio": 0.2},
    ]
    sweep(laws=None, cases=cases).run(tmp_path / "a.nc", workers=1).close()
    with open_cube(tmp_path / "a.nc") as cube:
        assert cube["floor_mass"].dims == ("case", "building", "storey")
        check(cube.sel(case=1), pair().buildings[1], (1.3, 1.0), None)
        check(cube.sel(case=2), pair().buildings[0], (1.0, 3.0), 0.2)
        assert scene_of(stored_sweep(cube)["scene"]) == pair()
        np.testing.assert_array_equal(cube["period_factor"], [[1.0, 1.3], [1.0, 1.0]])
        np.testing.assert_array_equal(cube["mass_factor"], [[1.0, 1.0], [3.0, 1.0]])
        np.testing.assert_array_equal(cube["damping_ratio"], [np.nan, 0.2])
    plain = sweep(laws=None, cases=[{"law": "none"}]).run(workers=1)
    assert plain["floor_mass"].dims == ("building", "storey")
    check(plain, pair().buildings[0], (1.0, 1.0), None)


def test_cubes_are_read_in_chunks(tmp_path):
    """By xarray too, which can't cut texts that it reads as objects: those beside the axes are read as bytes."""
    sweep(gaps=[0.0001, 0.0002], audit=1.0).run(tmp_path / "a.nc", workers=1).close()
    with open_cube(tmp_path / "a.nc") as cube, xr.open_dataset(tmp_path / "a.nc", chunks="auto") as plain:
        for chunked in (cube.chunk("auto"), plain):
            assert chunked["drift_max"].chunks == tuple((size,) for size in cube["drift_max"].shape)
            np.testing.assert_array_equal(chunked["drift_max"].compute(scheduler="synchronous"), cube["drift_max"])
        for name in ("law_title", "law_formula", "audit_law", "audit_record"):
            read = plain[name].compute(scheduler="synchronous")
            assert read.dtype.kind == "S"
            assert read.str.decode("utf-8").values.tolist() == cube[name].values.tolist()
        assert plain["building"].values.tolist() == ["a", "b"]


def test_storeys_that_meet():
    """A left building with floors at 2, 4 and 6 m, a right one at 4 and 8 m, and a wall."""
    left = Building("left", [10.0] * 3, [1e4] * 3, storey_heights=[2.0] * 3)
    right = Building("right", [10.0] * 2, [1e4] * 2, storey_heights=[4.0] * 2)
    cube = sweep(Scene([left, right, Wall()], [0.1, 0.1]), laws="none").run(workers=1)
    stored = {side: cube[f"{side}_storey"].sel(pair="left-right").values.tolist() for side in ("left", "right")}
    assert stored["left"] == pytest.approx([np.nan, 2.0, np.nan], nan_ok=True)
    assert stored["right"] == pytest.approx([np.nan, 1.0, np.nan], nan_ok=True)
    wall = cube.sel(pair="right-wall")
    assert wall["left_storey"].values.tolist() == pytest.approx([1.0, 2.0, np.nan], nan_ok=True)
    assert wall["right_storey"].isnull().all()
    assert (
        cube["contact_elevation"].notnull() == (cube["left_storey"].notnull() | cube["right_storey"].notnull())
    ).all()
