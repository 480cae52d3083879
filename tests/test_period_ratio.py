"""The sweep of the classic map: its axes, a sample of its scenarios against the independent oracle, and its figure."""

from __future__ import annotations

from pathlib import Path

import naive
import numpy as np
import pytest

import pounding_sweep as ps
from pounding_sweep.analysis import amplification
from pounding_sweep.figures import FIGURES
from pounding_sweep.output.labels import product_coordinates

SWEEP = Path(__file__).parents[1] / "sweeps" / "period_ratio.toml"


def test_its_axes_are_the_ratio_of_two_periods_and_the_gap():
    spec = ps.load_sweep(SWEEP).spec
    assert (spec.laws, [r.name for r in spec.records]) == (("kelvin_voigt", "none"), ["el_centro"])
    left, right = spec.scene.buildings
    assert left.periods == pytest.approx(right.periods)
    dims, ratio, about = product_coordinates(spec.scene, spec.property_axes)["period_ratio_left_right"]
    assert dims == ("period_factor_left",)
    np.testing.assert_allclose(ratio, np.geomspace(0.4, 2.5, 25))
    assert about["long_name"] == "period ratio T1/T2 of left and right"
    assert about["comment"] == "fundamental period of building left over that of building right"
    np.testing.assert_allclose(spec.gaps, 0.005 * np.arange(1, 21))


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    path = tmp_path_factory.mktemp("periods") / "period_ratio.nc"
    ps.load_sweep(SWEEP).run(path, workers=2)
    with ps.open_cube(path) as found:
        yield found.load()


@pytest.mark.slow
def test_equal_periods_never_touch_and_unequal_ones_do(cube):
    assert not cube.status.values.any()
    touching = cube.impact_count.sel(law="kelvin_voigt").max("storey").squeeze() > 0
    for factor in cube.period_factor_left.values:
        here = touching.sel(period_factor_left=factor)
        assert here.any() == (factor != 1.0)
    closing = np.array([amplification(cube).touches.squeeze().sel(gap=g).sum() for g in cube.gap.values])
    assert (np.diff(closing) <= 0).all()  # a wider gap is no likelier to be closed


@pytest.mark.slow
@pytest.mark.parametrize(("place", "gap"), [(2, 0.03), (8, 0.005), (21, 0.06)])
def test_a_sampled_scenario_equals_the_oracle(cube, place, gap):
    """The whole record; periods are varied here by dividing stiffnesses."""
    spec = ps.load_sweep(SWEEP).spec
    factor = float(cube.period_factor_left.values[place])
    left, right = spec.scene.buildings
    buildings = [
        naive.NaiveBuilding(list(left.masses), [k / factor**2 for k in left.stiffnesses]),
        naive.NaiveBuilding(list(right.masses), list(right.stiffnesses)),
    ]
    record, shown = spec.records[0], {}
    for law in ("kelvin_voigt", "none"):
        want = naive.run(buildings, [gap], record.acceleration, record.dt, law, 2e6, 0.6, rtol=1e-9, atol=1e-11)
        shown[law] = np.array([list(map(float, row)) for row in want["drift_max"]])
        got = cube.sel(law=law, gap=gap, period_factor_left=factor).squeeze(drop=True)
        np.testing.assert_allclose(got.drift_max.values, shown[law], rtol=3e-4)
        forces = np.array([list(map(float, row)) for row in want["impact_force_max"]])[0]
        np.testing.assert_allclose(got.impact_force_max.values, forces, rtol=0, atol=3e-4 * max(forces.max(), 1.0))
        assert (forces.max() > 1000.0) == (law == "kelvin_voigt")
    figure = FIGURES["map"].draw(cube, value="drift_max_ratio")
    ratio = (shown["kelvin_voigt"] / shown["none"]).max(axis=1)
    for ax, want in zip(figure.axes, ratio, strict=False):
        cells = ax.collections[1].get_array()
        assert cells[cube.gap.values.tolist().index(gap), place] == pytest.approx(want, rel=1e-3)
        assert ax.get_xscale() == "log"
        assert ax.get_xlabel().replace("\n", " ") == "period ratio T1/T2 of left and right (-)"
