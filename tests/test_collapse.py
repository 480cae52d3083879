"""What comparisons and exports make of buildings that fall: on a cube made by hand, and on a row that is run."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from analysis_cubes import hand_cube

import pounding_sweep as ps
from pounding_sweep.analysis import fractiles, fragility, incremental
from pounding_sweep.analysis.comparisons.fragility import FitStatus, sentence
from pounding_sweep.analysis.exchange import export_pelicun
from pounding_sweep.analysis.scenarios import values
from pounding_sweep.figures.gallery import cubes as drawn
from pounding_sweep.run.refinement import differences
from pounding_sweep.variables.registry import Status

SCALES = [1.0, 2.0, 3.0, 4.0]
RECORDS = ["r1", "r2", "r3", "r4"]  # of 1 m/s2 each


def leaning(name, n):
    return ps.Building(name, [100.0] * n, [5e3] * n, yield_strengths=[200.0] * n, p_delta=True)


@pytest.fixture
def cube():
    """Building a drifts by the scale times 10 mm, and falls under scale 3 of two records of four, and above of all."""
    scene = ps.Scene([leaning("a", 2), leaning("b", 1)], gaps=[0.05])
    drift = 0.01 * np.multiply.outer(np.ones(4), SCALES)
    falls = np.array([[0, 0, 1, 1], [0, 0, 1, 1], [0, 0, 0, 1], [0, 0, 0, 1]])
    storey = np.stack([2 * falls, 0 * falls], axis=-1)
    fill = {
        "drift_max": np.where(falls, 3.0, drift)[..., None, None] * [[0.5, 1.0], [0.1, 0.0]],
        "impact_count": falls[..., None, None],
        "collapsed_storey": storey,
        "collapse_time": np.where(storey > 0, 4.0, np.nan),
    }
    status = np.where(falls, Status.COLLAPSED, Status.OK)
    return hand_cube({"record": RECORDS, "scale": SCALES}, fill, scene=scene, status=status)


def test_a_fallen_building_exceeds_every_level(cube):
    """Even one above the height at which its drift was taken; the other only what it did before that."""
    for level in (0.035, 2.0, 50.0):
        result = fragility(cube, "drift", level, confidence=None)
        assert result.happened_count.sel(building="a").item() == 6
    assert result.fit_status.sel(building="a").item() == FitStatus.SEPARATED
    assert result.happened.sel(building="b").isnull().values.tolist() == (cube.status != 0).values.tolist()
    assert result.trials.values.tolist() == [16, 10]
    low = fragility(cube, "drift", 0.0025, confidence=None)  # b: 4 of scale 3, two of them by 0.3 m as the other falls
    assert low.happened_count.sel(building="b").item() == 2 + 6
    fallen = fragility(cube, "collapse", confidence=None)
    assert fallen.happened_count.values.tolist() == [6, 0]
    assert fallen.attrs["event_in_words"] == "the building falls"
    np.testing.assert_array_equal(fallen["median"], fragility(cube, "drift", 2.0, confidence=None)["median"])
    assert fallen.attrs["falls"].startswith("6 of 16 scenarios end where a storey falls")


def test_what_stronger_motions_did_not_tell_is_not_said_never_to_happen(cube):
    result = fragility(cube, "drift", 50.0, confidence=None).sel(building="b")
    assert sentence(result) == (
        "never happened in the scenarios that count, and stronger motions are left out: the statuses say why"
    )
    stands = cube.isel(scale=[0, 1])
    assert "even under the strongest motion tried; the median is above 2 m s-2" in sentence(
        fragility(stands, "drift", 50.0, confidence=None).sel(building="b")
    )


def test_fractiles_and_curves_end_where_half_have_fallen(cube):
    drift = fractiles(cube, [0.16, 0.5, 0.84]).drift_max_fractiles.sel(building="a", storey=2)
    np.testing.assert_allclose(drift.sel(scale=[1.0, 2.0]), 3 * [[0.01, 0.02]])
    np.testing.assert_array_equal(drift.sel(scale=3.0), [0.03, np.inf, np.inf])
    np.testing.assert_array_equal(drift.sel(scale=4.0), np.inf)
    curves = incremental(cube, levels=[1.5, 2.5, 3.0, 4.0], quantiles=[0.5])
    np.testing.assert_allclose(
        curves.drift_max_fractiles.sel(building="a", storey=2).squeeze(), [0.015, np.inf, np.inf, np.inf]
    )
    assert curves.collapse_share.sel(building="a").values.tolist() == [0.0, 0.5, 0.5, 1.0]
    assert "collapsed_storey" not in curves
    assert values(cube, "impact_count").sum() == 6.0  # up to the falls
    assert fractiles(cube).scenarios.values.tolist() == [4, 4, 4, 4]


def test_demands_tell_of_falls(cube, tmp_path):
    for building, n, falls in (("a", 16, 6), ("b", 10, 0)):
        assert export_pelicun(cube, tmp_path / f"{building}.csv", building) == n
        header, _, *rows = csv.reader((tmp_path / f"{building}.csv").read_text().splitlines())
        assert ("1-COLLAPSE-0-1" in header) == (falls > 0)
        if falls:
            fallen = [row for row in rows if row[header.index("1-COLLAPSE-0-1")] == "1"]
            assert len(fallen) == falls
            assert {row[header.index("1-PID-2-1")] for row in fallen} == {"1"}


def test_two_runs_that_fall_agree_by_time_storey_and_what_came_before():
    names = ["drift_max", "collapse_time", "collapsed_storey"]
    run = {
        "drift_max": np.array([[[3.0, 0.1]], [[3.0, 0.1]], [[3.0, 0.1]], [[3.0, 0.1]]]),
        "collapse_time": np.array([[4.0], [4.0], [4.0], [np.nan]]),
        "collapsed_storey": np.array([[1], [1], [1], [0]]),
        "status": np.array([8, 8, 8, 0]),
    }
    other = {name: each.copy() for name, each in run.items()}
    other["collapse_time"][:] = [[4.0], [4.04], [4.0], [4.0]]
    other["collapsed_storey"][:] = [[1], [1], [2], [1]]
    np.testing.assert_allclose(differences(names, run, other).max(axis=1), [0.0, 0.04 / 4.04, 0.5, np.inf])


@pytest.mark.slow
def test_fragility_of_a_row_that_falls(tmp_path):
    """By an accuracy none of 96 scenarios is left out or halved without end; medians as from all of them."""

    def building(name, period, strength):
        stiffness = 200.0 * (2 * np.pi / period) ** 2
        return ps.Building(name, [100.0] * 2, [stiffness] * 2, yield_strengths=[strength] * 2, p_delta=True)

    contact = ps.ContactProperties(linear_stiffness=1e5, restitution=0.6)
    scene = ps.Scene([building("A", 0.8, 200.0), building("B", 0.45, 300.0)], gaps=[0.05], contact=contact)
    records = [ps.synthetic_record(seed, pga=2.0) for seed in range(1, 13)]
    sweep = {"laws": ["kelvin_voigt"], "gaps": [0.05], "pgas": [1, 2, 3, 4, 6, 8, 12, 16], "outputs": ["drift_max"]}
    for numerics in ({"dt": 0.002}, {"accuracy": 1e-3}):
        cube = ps.Sweep(scene, records=records, **sweep, **numerics).run()
        assert {*cube.status.values.ravel().tolist()} == {Status.OK, Status.COLLAPSED}
        for level, median, dispersion in ((0.1, 2.417, 0.251), (0.15, 2.580, 0.234), (0.3, 3.044, 0.223)):
            fit = fragility(cube, "drift", level, confidence=None).sel(building="A").squeeze()
            assert (round(fit["median"].item(), 3), round(fit["dispersion"].item(), 3)) == (median, dispersion)
    assert float(cube.error_estimate.max()) <= 1e-3
    assert float(cube.time_step.min()) >= 1e-3


def test_ida_curves_are_flat_from_where_the_building_falls(cube):
    ax = drawn.incremental(cube, value="drift_max").axes[0]
    assert ax.get_title().endswith("building a")
    assert ax.get_xlim() == pytest.approx((0.0, 1.05 * 30.0))  # mm, of what stands
    (x, y) = next(line.get_data() for line in ax.lines if line.get_label() == "median")
    beyond = np.flatnonzero(x > 1e3)[0]
    slope = np.diff(y)[beyond - 1] / np.diff(x)[beyond - 1]
    assert abs(slope) * 31.5 < 1e-6
