"""The cubes of the main job, a sample of its scenarios against the independent oracle, and of the classic map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import reference

import pounding_sweep as ps
from pounding_sweep.analysis import amplification, required_gap
from pounding_sweep.request.axes import contact_stiffness

pytestmark = pytest.mark.slow

SWEEPS = Path(__file__).parents[1] / "sweeps"
LAWS = ["linear", "kelvin_voigt", "modified_kelvin_voigt", "hertz", "hertz_damped", "nonlinear_viscoelastic"]


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    path = tmp_path_factory.mktemp("quickstart") / "quickstart.nc"
    ps.load_sweep(SWEEPS / "quickstart.toml").run(path, workers=2)
    with ps.open_cube(path) as found:
        yield found.load()


def test_it_is_the_job_that_was_asked_for(cube):
    sizes = {"law": 7, "gap": 12, "stiffness_factor": 3, "restitution": 4, "record": 1, "scale": 1}
    assert {name: cube.sizes[name] for name in sizes} == sizes
    assert cube.record.values.tolist() == ["el_centro"]
    assert not cube.status.values.any()


def test_a_required_gap_holds_only_together_with_those_of_the_other_pairs(cube):
    exact = required_gap(cube).exact.squeeze(drop=True)
    count = cube.impact_count.fillna(0)
    touches = (count > 0).any([dim for dim in count.dims if dim not in ("gap", "pair")])
    assert not touches.sel(gap=cube.gap > float(exact.max())).any()
    beyond = touches.sel(pair="middle-right", gap=cube.gap > float(exact.sel(pair="middle-right")))
    assert beyond.any()  # left and middle pound, and bring the middle one nearer to the right


@pytest.mark.parametrize("law", LAWS)
def test_a_sampled_scenario_equals_the_oracle(cube, law):
    """The whole record, a gap at which floors meet a dozen times; every default output."""
    rng = np.random.default_rng(sum(map(ord, law)))
    scenario = {"gap": float(rng.choice(cube.gap.values[3:7]))}
    scenario |= {name: float(rng.choice(cube[name].values)) for name in ("stiffness_factor", "restitution")}
    scene, record = ps.get_preset("mate2015"), ps.find_record("el_centro")
    buildings = [reference.ShearBuilding(list(b.masses), list(b.stiffnesses)) for b in scene.buildings]
    stiffness = contact_stiffness(scene, law, stiffness_factor=scenario["stiffness_factor"])
    e = scenario["restitution"] if ps.get_law(law).takes_restitution else None
    gaps, motion = [scenario["gap"]] * 2, (record.acceleration, record.dt)
    want = reference.run(buildings, gaps, *motion, law, stiffness, e, rtol=1e-9, atol=1e-11)
    got = cube.sel(law=law, **scenario).squeeze(drop=True)
    assert got.impact_count.values.tolist() == [list(map(float, n)) for n in want["impact_count"]]
    tolerance = 2e-3 if law == "nonlinear_viscoelastic" else 3e-4
    for name in ("displacement_max", "displacement_min", "drift_max", "storey_shear_max", "impact_force_max"):
        expected = np.array([list(map(float, row)) for row in want[name]])
        atol = tolerance * np.abs(expected).max()
        np.testing.assert_allclose(got[name].values, expected, rtol=0, atol=atol, err_msg=name)
    assert float(got.impact_force_max.max()) > 100.0
    first = np.array([[np.nan if t is None else t for t in row] for row in want["first_impact_time"]], dtype=float)
    # a floor that touches later does so after contacts whose own error moves it
    late = 1e-5 if law == "nonlinear_viscoelastic" else 1e-6
    np.testing.assert_allclose(got.first_impact_time.values, first, rtol=0, atol=late)


def test_equal_periods_never_touch_and_unequal_ones_do():
    cube = ps.load_sweep(SWEEPS / "period_ratio.toml").run(workers=2)
    assert not cube.status.values.any()
    touching = cube.impact_count.sel(law="kelvin_voigt").max("storey").squeeze() > 0
    for factor in cube.period_factor_left.values:
        here = touching.sel(period_factor_left=factor)
        assert here.any() == (factor != 1.0)
    closing = np.array([amplification(cube).touches.squeeze().sel(gap=g).sum() for g in cube.gap.values])
    assert (np.diff(closing) <= 0).all()  # a wider gap is no likelier to be closed
