"""The sweep of the classic map: its axes, and what touches."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pounding_sweep as ps
from pounding_sweep.analysis import amplification
from pounding_sweep.output.labels import product_coordinates

SWEEP = Path(__file__).parents[1] / "sweeps" / "period_ratio.toml"


def test_its_axes_are_the_ratio_of_two_periods_and_the_gap():
    spec = ps.load_sweep(SWEEP).spec
    assert (spec.laws, [r.name for r in spec.records]) == (("kelvin_voigt", "none"), ["el_centro"])
    left, right = spec.scene.buildings
    assert left.periods == pytest.approx(right.periods)
    dims, ratio, about = product_coordinates(spec.scene, spec.named_axes("building"))["period_ratio_left_right"]
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
