"""Fragility against a naive likelihood, its degenerate cases in words, and rates under hazards."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scenes import hand_cube
from scipy.integrate import quad
from scipy.optimize import minimize
from scipy.special import ndtr, ndtri
from scipy.stats import beta, chi2, nct, norm
from scipy.stats import t as student

from pounding_sweep.analysis import fragility
from pounding_sweep.analysis.comparisons import EVENTS
from pounding_sweep.analysis.comparisons.fragility import (
    FitStatus,
    fit_lognormals,
    fit_rows,
    record_capacities,
    sentence,
)
from pounding_sweep.analysis.hazard import Hazard, hazard_of, read_hazard
from pounding_sweep.base.errors import InputError
from pounding_sweep.figures import FIGURES
from pounding_sweep.variables.registry import VARIABLES, Status

_PLACE = importlib.util.spec_from_file_location(
    "interval_coverage", Path(__file__).parents[1] / "docs" / "interval_coverage.py"
)
interval_coverage = importlib.util.module_from_spec(_PLACE)
_PLACE.loader.exec_module(interval_coverage)


def fit_one(x, happened):
    (fit,) = fit_lognormals([(np.asarray(x, float), np.asarray(happened, bool))])
    return fit


def naive_loss(log_median, dispersion, x, happened):
    """Negative log-likelihood of Baker (2015), trial by trial."""
    loss = 0.0
    for intensity, yes in zip(x, happened, strict=True):
        z = (math.log(intensity) - log_median) / dispersion
        loss -= math.log(0.5 * math.erfc(-z / math.sqrt(2) if yes else z / math.sqrt(2)))
    return loss


# -- the fit -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_no_neighbour_is_likelier(seed):
    rng = np.random.default_rng(seed)
    x = rng.uniform(0.3, 6.0, 40)
    happened = x > 2.0 * np.exp(0.4 * rng.standard_normal(40))
    fit = fit_one(x, happened)
    assert fit.status == FitStatus.FITTED
    best = naive_loss(fit.log_median, fit.dispersion, x, happened)
    for shift in np.linspace(-0.7, 0.7, 15):
        for factor in np.geomspace(0.5, 2.0, 15):
            assert naive_loss(fit.log_median + shift, fit.dispersion * factor, x, happened) >= best - 1e-10


@given(st.lists(st.tuples(st.sampled_from([0.0, 0.5, 1.0, 2.0, 4.0]), st.booleans()), max_size=12))
def test_never_a_nonsense_number(trials):
    """Whatever the trials: a fit with finite, sensible numbers, or a reason without any."""
    fit = fit_one([t[0] for t in trials], [t[1] for t in trials])
    if fit.status == FitStatus.FITTED:
        assert 0.05 <= math.exp(fit.log_median) <= 40.0
        assert 0.0 < fit.dispersion <= 5.0


NEAR = 2.0 * (1 + 1e-15)


@pytest.mark.parametrize(
    ("x", "happened", "status", "low", "high"),
    [
        ([], [], FitStatus.NO_DATA, None, None),
        ([0.0, 0.0], [0, 1], FitStatus.NO_DATA, None, None),
        ([1.0, 3.0], [0, 0], FitStatus.NEVER, 3.0, None),
        ([1.0, 3.0], [1, 1], FitStatus.ALWAYS, None, 1.0),
        ([2.0, NEAR], [1, 0], FitStatus.ONE_LEVEL, 2.0, 2.0),
        ([2.0, 2.0, 2.0], [1, 0, 1], FitStatus.ONE_LEVEL, None, 2.0),
        ([1.0, 2.0, 3.0], [0, 0, 1], FitStatus.SEPARATED, 2.0, 3.0),
        ([1.0, NEAR, 2.0, 3.0], [0, 0, 1, 1], FitStatus.SEPARATED, 2.0, 2.0),
        ([1.0, *[2.0] * 88, 3.0], [0, *[1] * 87, 0, 1], FitStatus.SEPARATED, 1.0, 2.0),
        ([1.0, *[2.0] * 88, 3.0], [0, *[0] * 87, 1, 1], FitStatus.SEPARATED, 2.0, 3.0),
        ([2.0, 2.0, 2.0, 3.0], [1, 0, 1, 1], FitStatus.SEPARATED, None, 2.0),
        ([1.0, 2.0, 3.0], [1, 0, 0], FitStatus.NOT_RISING, None, None),
        ([1.0, 1.0, 2.0, 2.0], [0, 1, 0, 1], FitStatus.NOT_RISING, None, None),
        ([1.0, 2.0, 3.0, 4.0], [1, 0, 1, 0], FitStatus.NOT_RISING, None, None),
    ],
)
def test_degenerate_trials_are_told(x, happened, status, low, high):
    fit = fit_one(x, happened)
    assert fit.status == status
    for end, expected in ((fit.low, low), (fit.high, high)):
        assert np.isnan(end) if expected is None else end == expected


@pytest.mark.parametrize(
    ("status", "between", "words"),
    [
        ("SEPARATED", (0.85, 1.56), "so there is no dispersion; the median is between 0.85 and 1.56 m s-2"),
        ("SEPARATED", (2.0, 2.0), "the median is about 2 m s-2"),
        ("ONE_LEVEL", (np.nan, 4.0), "one intensity, so there is no curve; the median is below 4 m s-2"),
        ("NEVER", (4.0, np.nan), "never happened, even under the strongest motion tried; the median is above 4 m s-2"),
    ],
)
def test_words_say_what_is_known_of_the_median(status, between, words):
    cell = {
        "fit_status": FitStatus[status],
        "median_between": between,
        "median": xr.DataArray(0, attrs={"units": "m s-2"}),
    }
    assert sentence(cell).endswith(words)


# -- of a cube ---------------------------------------------------------------------------------------------------------

RECORDS = [f"r{i}" for i in range(12)]
SCALES = [0.25, 0.5, 1.0, 2.0, 4.0]


def suite(seed=0, status=None):
    """Return counts of a pair that touches from a threshold of each record on; PGA 1 m/s2 each."""
    rng = np.random.default_rng(seed)
    threshold = 1.2 * np.exp(0.6 * rng.standard_normal(len(RECORDS)))
    touches = np.array(SCALES)[None, :] > threshold[:, None]
    count = np.zeros((2, 2, len(RECORDS), len(SCALES), 2, 2))
    count[1, 0] = touches[..., None, None]
    axes = {"law": ["none", "linear"], "gap": [0.01, 0.5], "record": RECORDS, "scale": SCALES}
    return hand_cube(axes, {"impact_count": count}, status=status), touches


def of_pair(cube, **settings):
    return fragility(cube, **settings).sel(law="linear", gap=0.01, pair="a-b")


def test_fit_of_each_cell():
    cube, touches = suite()
    curves = fragility(cube)
    cell, fit = curves.sel(law="linear", gap=0.01, pair="a-b"), fit_one(np.tile(SCALES, 12), touches.ravel())
    assert float(cell["median"]) == pytest.approx(math.exp(fit.log_median), rel=1e-12)
    assert float(cell.dispersion) == fit.dispersion
    assert (cell.trials, cell.happened_count) == (60, touches.sum())
    away = (np.log(cell.intensity.values) - fit.log_median) / fit.dispersion
    np.testing.assert_allclose(cell.probability, ndtr(away))
    assert curves["median"].attrs["units"] == curves.intensity.attrs["units"] == "m s-2"
    assert curves.sel(law="linear", gap=0.5, pair="a-b").fit_status == FitStatus.NEVER
    assert curves.law.values.tolist() == ["linear"]


@pytest.mark.parametrize(("n", "dispersion"), [(5, 0.4), (30, 0.05), (80, 0.01)])
def test_intervals_of_known_capacities_are_the_exact_ones(n, dispersion):
    """Of Student, chi-square and noncentral t, where the scales are so fine that each record's capacity is known."""
    capacity = np.exp(dispersion * np.random.default_rng(n).standard_normal(n))
    scales = np.geomspace(0.9 * capacity.min(), 1.1 * capacity.max(), 3000)
    count = (scales > capacity[:, None])[..., None].astype(float)
    axes = {
        "record": [f"r{i}" for i in range(n)],
        "scale": scales,
        "pair": ["a-b"],
        "record_pga": ("record", [1.0] * n),
    }
    middle, spread = np.log(capacity).mean(), np.log(capacity).std(ddof=1)
    away, ends = np.array([-2.0, -1.0, 0.5]), np.array([0.05, 0.95])
    cube = xr.Dataset({"impact_count": (("record", "scale", "pair"), count)}, axes)
    cell = fragility(cube, confidence=0.9, levels=np.exp(middle + spread * away)).squeeze()
    wide = student.ppf(ends, n - 1) / math.sqrt(n)
    np.testing.assert_allclose((np.log(cell.median_interval) - middle) / spread, wide, rtol=0.03)
    np.testing.assert_allclose(
        cell.dispersion_interval / spread, np.sqrt((n - 1) / chi2.ppf(1 - ends, n - 1)), rtol=0.02
    )
    for z, bounds in zip(away, ndtri(cell.probability_interval.values.T), strict=True):
        # as likely as this or further away from the statistic that was found
        np.testing.assert_allclose(nct.cdf(math.sqrt(n) * z, n - 1, math.sqrt(n) * bounds), 1 - ends, atol=0.012)


@pytest.mark.parametrize(
    ("x", "happened", "low", "high"),
    [
        ([3.0, 1.0, 2.0], [1, 0, 1], 1.0, 2.0),
        ([1.0, 2.0], [0, 0], 2.0, np.inf),
        ([1.0, 2.0], [1, 1], 0.0, 1.0),
        ([1.0, 2.0, 3.0, 4.0], [0, 1, 0, 1], 1.0, 4.0),  # after 1 or after 3, either against one trial
        ([1.0, 2.0, 3.0, 4.0, 5.0], [0, 1, 0, 1, 1], 1.0, 4.0),
        ([1.0, 2.0, 3.0, 4.0, 5.0], [0, 1, 1, 0, 1], 1.0, 2.0),
        ([1.0, 1.0, 2.0, 2.0], [0, 1, 1, 1], 0.0, 2.0),  # both ways of a record that differ
        ([1.0, NEAR, 2.0, 3.0], [0, 0, 0, 1], 2.0, 3.0),
    ],
)
def test_between_which_intensities_a_record_begins(x, happened, low, high):
    ends = np.exp(record_capacities(np.array(happened) > 0, np.array(x)))
    assert ends == pytest.approx([low, high])


def test_bounds_of_the_probability_rise_with_the_intensity():
    """However uncertain the dispersion: of few records that are nearly separated, and of others."""
    for seed in range(8):
        cube, _ = suite(seed=seed)
        cell = of_pair(cube.isel(record=slice(8)), levels=np.geomspace(0.05, 20.0, 200))
        band = cell.probability_interval
        assert (band.diff("intensity") >= 0.0).all()
        assert (band[0] <= cell.probability).all()
        assert (cell.probability <= band[1]).all()
        # the table's intervals are the band's: where a bound is one half, the median has its other one
        at = [float(np.interp(0.5, band[i], np.log(band["intensity"]))) for i in (1, 0)]
        assert at == pytest.approx(np.log(cell.median_interval.values).tolist(), abs=0.04)


def test_no_band_where_nothing_exceeds():
    """None of 16 records at seven levels, few at the stronger ones: no bound above the binomial one of a level."""
    levels = np.array([0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 6.0, 8.0])
    count = np.zeros((16, 9, 1))
    count[0, 7:] = count[1:5, 8] = 1.0
    axes = {
        "record": [f"r{i}" for i in range(16)],
        "scale": levels,
        "pair": ["a-b"],
        "record_pga": ("record", [1.0] * 16),
    }
    cell = fragility(xr.Dataset({"impact_count": (("record", "scale", "pair"), count)}, axes), levels=levels).squeeze()
    assert cell.happened_count == 6
    assert (cell.probability_interval[1] <= beta.ppf(0.975, np.r_[[1.0] * 7, 2, 6], np.r_[[16.0] * 7, 15, 11])).all()


@pytest.mark.parametrize(
    ("records", "design"),
    [
        (10, "6 high levels"),
        *(pytest.param(n, name, marks=pytest.mark.slow) for n in (10, 20) for name in ("8 scales", "3 scales")),
    ],
)
def test_intervals_hold_what_the_suites_were_drawn_from(records, design):
    """As often as they promise, within what 400 suites can tell and the table in the documentation shows."""
    curves = interval_coverage.measure(records, *interval_coverage.DESIGNS[design], suites=400)
    intervals = [(curves["median_interval"], 1.0), (curves["dispersion_interval"], interval_coverage.DISPERSION)]
    shares = enumerate(interval_coverage.SHARES)
    intervals += [(curves["probability_interval"].isel(intensity=i), true) for i, true in shares]
    for interval, true in intervals:
        assert 0.9 <= interval_coverage.share(interval, true) <= 0.99


def single_trials(x, count):
    """Return the fragility of a pair of records with one motion each."""
    axes = {"record": [f"r{i}" for i in range(len(x))], "record_pga": ("record", x), "pair": ["a-b"]}
    counts = (("record", "pair"), np.array(count, float)[:, None])
    return fragility(xr.Dataset({"impact_count": counts}, axes)).squeeze("pair")


def test_intervals_of_nearly_separated_trials_and_of_records_that_go_back_and_forth():
    cell = single_trials([1.0, 1.5, 2.0, 2.2, 3.0, 4.0, 5.0], [0, 0, 0, 1, 0, 1, 1])
    assert cell.median_interval[0] < cell["median"] < cell.median_interval[1]
    assert 0.0 < cell.dispersion_interval[0] < cell.dispersion < cell.dispersion_interval[1]
    coin = np.random.default_rng(0).random((12, 5)) < [0.1, 0.3, 0.5, 0.6, 0.9]  # a scale of a record is as good as any
    cube = hand_cube({"record": RECORDS, "scale": SCALES}, {"impact_count": coin[..., None, None].astype(float)})
    cell = fragility(cube).sel(pair="a-b")
    assert cell.fit_status == FitStatus.FITTED
    assert cell.median_interval.isnull().all()


def test_scenarios_that_are_not_ok_are_no_trials():
    status = np.zeros((2, 2, 12, 5))
    status[1, 0, :3] = int(Status.UNDER_RESOLVED_CONTACT)
    cube, touches = suite(status=status)
    cell = of_pair(cube, confidence=None)
    assert (cell.trials, cell.left_out) == (45, 15)
    fit = fit_one(np.tile(SCALES, 9), touches[3:].ravel())
    assert float(cell["median"]) == pytest.approx(math.exp(fit.log_median), rel=1e-9)
    assert cell.median_interval.isnull().all()


def test_levels_of_other_events():
    rng = np.random.default_rng(1)
    drift = rng.uniform(0.2, 2.0, (len(RECORDS), len(SCALES), 2, 2)) * np.array(SCALES)[:, None, None]
    cube = hand_cube({"record": RECORDS, "scale": SCALES}, {"drift_max": drift})
    curves = fragility(cube, "drift", 0.8, confidence=None)
    fit = fit_one(np.tile(SCALES, 12), (drift[..., 0, :].max(axis=-1) > 0.8).ravel())
    assert float(curves["median"].sel(building="a")) == pytest.approx(math.exp(fit.log_median), rel=1e-9)
    assert curves.attrs["event_in_words"] == "interstorey drift above 0.8 m"
    assert curves.happened_count.sel(building="b") == (drift[..., 1, 0] > 0.8).sum()  # one storey only


def test_one_record_has_no_interval_and_records_alone_need_no_scale():
    count = np.array([0, 1, 0, 1, 1])[:, None, None]
    one = fragility(hand_cube({"scale": SCALES, "record": ["one"]}, {"impact_count": count[:, None]}))
    assert one.median_interval.isnull().all()
    assert one.trial_intensity.dims == ("record", "scale")
    several = hand_cube({"record": RECORDS[:5]}, {"impact_count": count})
    sa = xr.DataArray([1.0, 2, 3, 4, 5], dims="record", coords={"record": RECORDS[:5]}, attrs={"units": "g"})
    median = fragility(several, intensity=sa)["median"].sel(pair="a-b")
    assert float(median) == pytest.approx(math.exp(fit_one(sa.values, count.ravel() > 0).log_median), rel=1e-9)


def test_rows_are_the_fits():
    cube, _ = suite()
    curves = fragility(cube)
    rows = fit_rows(curves)
    assert len(rows) == curves.fit_status.size == 4
    for row in rows:
        cell = curves.sel({dim: row[dim] for dim in ("law", "gap", "pair")})
        assert (row["trials"], row["happened"], row["fit"]) == (cell.trials, cell.happened_count, sentence(cell))
        for name in ("median", "dispersion"):
            values = [cell[name], *cell[f"{name}_interval"].values]
            for key, value in zip((name, f"{name}_lower", f"{name}_upper"), values, strict=True):
                assert row[key] == value if np.isfinite(value) else row[key] is None
    assert "median_lower" not in fit_rows(fragility(cube, confidence=None))[0]


def test_axes_that_a_fit_does_not_depend_on_have_one_row():
    """One pair alone touches from the same intensity on, whatever the stiffness; of a gap that none closes likewise."""
    cube, _ = suite()
    several = xr.concat([cube, cube], xr.Variable("stiffness", [1e5, 1e6], {"units": "kN m-1"}))
    curves = fragility(several, confidence=None)
    assert (curves.attrs["equal_along"], curves.sizes["stiffness"]) == ("stiffness", 2)
    assert fit_rows(curves) == fit_rows(fragility(cube, confidence=None))
    several["impact_count"][1, 1, 0, 0, 0] = 1.0
    assert "equal_along" not in fragility(several, confidence=None).attrs


def test_events_are_outputs():
    for event in EVENTS.values():
        if event.variable:
            assert event.per in VARIABLES[event.variable].dims
            assert event.units == ("" if event.key == "collapse" else VARIABLES[event.variable].units)


@pytest.mark.parametrize(
    ("change", "arguments", "message"),
    [
        ({}, {"event": "fire"}, "unknown event 'fire'"),
        ({}, {"event": "collapse"}, "no storey of this row may fall"),
        ({}, {"event": "force"}, "needs a level that impact_force_max must exceed"),
        ({}, {"level": 1.0}, "takes no level"),
        ({}, {"event": "force", "level": 10.0}, "'impact_force_max', which this cube lacks"),
        ({}, {"event": "force", "level": -1.0}, "not -1"),
        ({}, {"event": "drift", "level": "1%"}, "level '1%' of event 'drift' is in per cent, which drift_ratio"),
        ({}, {"event": "drift_ratio", "level": "1%"}, "'drift_ratio_max', which this cube lacks"),
        ({}, {"confidence": 95}, r"confidence: 95 is not in \(0, 1\)"),
        ({}, {"levels": [0.0]}, r"levels: 0 is not in \(0, inf\)"),
        ({}, {"quantiles": [1.0]}, r"quantiles of a fragility: 1 is not in \(0, 1\)"),
        ({}, {"one_dispersion": ["scale"]}, "unknown axis of one dispersion 'scale'; valid: gap, law, pair"),
        ({"law": [0]}, {}, "a law with contact, this cube has only 'none'"),
        ({"record": [0], "scale": [1]}, {}, "needs several values of 'record' or 'scale', and this cube has one"),
        ({"record": 0, "scale": 1}, {}, "needs the axis 'record'"),
    ],
)
def test_what_is_not_valid(change, arguments, message):
    with pytest.raises(InputError, match=message):
        fragility(suite()[0].isel(change), **arguments)


# -- one dispersion for several curves ---------------------------------------------------------------------------------

GAPS = (0.004, 0.008, 0.02)


def gaps():
    """Return counts of a pair, and whether it touches: small gaps by weak motions, and more alike than large ones."""
    away = np.random.default_rng(4).standard_normal((len(RECORDS), 1))
    count = np.zeros((1, len(GAPS), len(RECORDS), len(SCALES), 2, 2))
    for i, (median, spread) in enumerate(((0.6, 0.2), (1.0, 0.5), (1.8, 0.9))):
        count[0, i] = (np.array(SCALES)[None, :] > median * np.exp(spread * away))[..., None, None]
    axes = {"law": ["linear"], "gap": list(GAPS), "record": RECORDS, "scale": SCALES}
    return hand_cube(axes, {"impact_count": count}), count[0, ..., 0, 0] > 0


def test_the_joint_fit_is_likeliest():
    """Against a search that knows only likelihoods, trial by trial."""
    x = np.tile(SCALES, len(RECORDS))
    trials = [(x, part.ravel()) for part in gaps()[1]]
    fits = fit_lognormals(trials)
    assert {fit.status for fit in fits} == {FitStatus.FITTED}
    assert len({fit.dispersion for fit in fits}) == 1

    def loss(p):
        return sum(naive_loss(p[i], math.exp(p[-1]), *one) for i, one in enumerate(trials))

    best = minimize(loss, [0.0, 0.0, 0.0, -0.5], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12}).x
    assert [fit.log_median for fit in fits] == pytest.approx(best[:3], abs=1e-5)
    assert fits[0].dispersion == pytest.approx(math.exp(best[3]), rel=1e-5)


def test_separated_trials_are_fitted_with_the_dispersion_of_others():
    x = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    apart, mixed = (x, x > 2.5), (x, np.array([0, 0, 1, 0, 1, 1]) > 0)
    one, other, last = fit_lognormals([apart, mixed, (x, np.zeros(6, bool))])
    assert one.dispersion == other.dispersion
    assert 2.0 < math.exp(one.log_median) < 3.0 < math.exp(other.log_median) < 5.0
    assert last.status == FitStatus.NEVER
    assert {fit.status for fit in fit_lognormals([apart, apart])} == {
        FitStatus.SEPARATED
    }  # nobody tells the dispersion


def test_curves_of_gaps_do_not_cross_with_one_dispersion():
    """A larger gap is never likelier to be closed; with dispersions of their own the fits say so all the same."""
    cube, _ = gaps()
    apart, one = (fragility(cube, one_dispersion=axes, levels=np.geomspace(0.01, 30.0, 300)) for axes in ([], ["gap"]))
    assert one.attrs["one_dispersion"] == "gap"
    assert "curves_cross" not in one.attrs
    assert apart.attrs["curves_cross"].startswith("of gap 0.008 and 0.02 at 0.302 m s-2, probability 0.027: their")
    at = {"pair": "a-b", "law": "linear"}
    low, high = (apart["probability"].sel(at).sel(gap=gap) for gap in GAPS[1:])
    crossing = float(high.intensity[np.argmax(np.diff(np.sign(low - high)) != 0)])
    assert crossing == pytest.approx(0.302, rel=0.05)  # or it is the first of both, where none is likely
    rising = one["probability"].sel(at).diff("gap")
    assert float(rising.max()) <= 0.0
    assert float(apart["probability"].sel(at).diff("gap").max()) > 1e-3
    low, high = one["dispersion_interval"].sel(at).transpose("bound", "gap").values
    dispersion = one["dispersion"].sel(at).values
    assert ((low < dispersion) & (dispersion < high)).all()
    assert "curves cross" in str(FIGURES["fragility"].draw(apart).caption)
    assert "one dispersion along gap" in str(FIGURES["fragility"].draw(one).caption)


def test_the_annual_rate_of_an_event_is_that_of_its_lognormal_under_a_hazard():
    """Of a power law k0 x^-k, k0 m^-k exp(k^2 b^2 / 2); of collapses as of touches."""
    count = xr.DataArray(np.array([0.0, 0.0, 1.0, 0.0, 2.0, 1.0])[:, None], dims=["record", "pair"])
    pga = xr.DataArray([1.0, 2.0, 2.5, 3.0, 3.5, 4.0], dims="record", attrs={"units": "m s-2"})
    cube = xr.Dataset({"impact_count": count}, {"record": list("abcdef"), "record_pga": pga, "pair": ["a-b"]})
    fit = fragility(cube, confidence=None, hazard="k0=1e-3,kappa=2.5")
    median, dispersion = fit["median"].item(), fit["dispersion"].item()
    want = 1e-3 * median**-2.5 * np.exp(0.5 * (2.5 * dispersion) ** 2)
    assert fit["annual_rate"].item() == pytest.approx(want, rel=1e-9)
    assert fit_rows(fit)[0]["per year"] == pytest.approx(want, rel=1e-9)
    assert "annual_rate" not in fragility(cube, confidence=None)


CURVE = Hazard((0.5, 1.0, 2.0, 5.0, 12.0), (0.1, 0.04, 0.008, 5e-4, 2e-5))


def integral(hazard, median, dispersion):
    """The rate as the integral of P(x) |d lambda|, over ln x, with slopes by differences of logarithms."""

    def density(u):
        h = 1e-6
        rate, ends = float(hazard.exceeded(math.exp(u))), hazard.exceeded(np.exp([u - h, u + h]))
        return norm.cdf((u - math.log(median)) / dispersion) * rate * -np.diff(np.log(ends))[0] / (2 * h)

    bends = [*np.log(hazard.intensity), math.log(median)]
    return quad(density, math.log(median) - 12.0, math.log(median) + 25.0, points=sorted(bends), limit=400)[0]


@given(st.floats(0.05, 50.0), st.floats(0.05, 1.5), st.floats(1e-5, 1.0), st.floats(0.5, 5.0))
def test_a_power_law_has_the_closed_form(median, dispersion, k0, kappa):
    rate = Hazard.power_law(k0, kappa).touching(np.array(median), np.array(dispersion))
    assert float(rate) == pytest.approx(k0 * median**-kappa * math.exp(0.5 * (kappa * dispersion) ** 2), rel=1e-9)


@pytest.mark.parametrize(
    ("median", "dispersion"),
    [(0.3, 0.6), (1.0, 0.05), (20.0, 0.9), *(pytest.param(*p, marks=pytest.mark.slow) for p in ((3.0, 0.6), (8, 0.2)))],
)
def test_a_curve_is_integrated_exactly(median, dispersion):
    rate = float(CURVE.touching(np.array(median), np.array(dispersion)))
    assert rate == pytest.approx(integral(CURVE, median, dispersion), rel=1e-6)
    closed = 0.01 * median**-2.0 * math.exp(2.0 * dispersion**2)
    assert integral(Hazard.power_law(0.01, 2.0), median, dispersion) == pytest.approx(closed, rel=1e-6)


def test_a_sharp_capacity_is_met_as_often_as_its_intensity():
    np.testing.assert_allclose(CURVE.exceeded(np.array(CURVE.intensity)), CURVE.rate)
    assert float(CURVE.exceeded(math.sqrt(2.0))) == pytest.approx(math.sqrt(0.04 * 0.008))  # straight in logarithms
    for x in (0.2, 1.5, 40.0):
        assert float(CURVE.touching(np.array(x), np.array(1e-6))) == pytest.approx(float(CURVE.exceeded(x)), rel=1e-4)


@pytest.mark.parametrize("rate", [1e-7, 2e-4, 0.05, 3.0])
def test_a_rate_gives_back_its_capacity(rate):
    spreads = np.array([0.05, 0.4, 1.2])
    np.testing.assert_allclose(CURVE.touching(CURVE.median_at(rate, spreads), spreads), rate, rtol=1e-9)
    capacities = np.array([1.0, 2.0, np.inf, 5.0])  # one that nothing reaches
    factor = CURVE.factor_at(rate, capacities)
    assert float(CURVE.exceeded(factor * capacities[[0, 1, 3]]).sum()) / 4 == pytest.approx(rate, rel=1e-9)


def test_what_stems_from_beyond_the_points_is_told():
    at = np.array(11.0), np.array(0.5)

    def density(u):
        return norm.pdf((u - math.log(11.0)) / 0.5) / 0.5 * float(CURVE.exceeded(math.exp(u)))

    share = quad(density, math.log(12.0), 12.0)[0] / float(CURVE.touching(*at))
    assert float(CURVE.beyond(*at)) == pytest.approx(share, rel=1e-3)
    assert float(Hazard.power_law(1e-3, 2.0).beyond(*at)) == 0.0


@pytest.mark.parametrize(
    ("heading", "measure", "units"),
    [
        ("# Somewhere\nsa (g),annual rate", "sa", "m s-2"),
        ("pga [cm/s2];rate", "pga", "m s-2"),
        ("PGV (cm/s),rate", "pgv", "m s-1"),
        ("Sa(0.6 s) [g],rate", "sa(0.6)", "m s-2"),
        ("SA(T1=0.6) (g),rate", "sa(0.6)", "m s-2"),
        ("Sa(0,6 s) [g];rate", "sa(0.6)", "m s-2"),
        ("intensity (g),rate", "", "m s-2"),
    ],
)
def test_headings_tell_intensity_and_unit(tmp_path, heading, measure, units):
    path = tmp_path / "site.csv"
    rows = "0,1;1e-2\n\n0,5;1,5e-3\n" if ";" in heading else "0.1,1e-2\n\n0.5,1.5e-3\n"
    path.write_text(f"{heading}\n{rows}")
    site = read_hazard(path)
    assert (site.measure, site.units, site.rate, site.source) == (measure, units, (1e-2, 1.5e-3), "site.csv")
    size = 9.81 if "g" in heading.replace("pg", "") else 0.01
    assert site.intensity == pytest.approx((0.1 * size, 0.5 * size))


@pytest.mark.parametrize(
    ("heading", "years"),
    [
        *(("poe in 50 years", 50.0), ("PoE (50 yr)", 50.0), ("probability of exceedance in 2,5 y", 2.5)),
        *(("annual probability of exceedance", 1.0), ("poe-50y", 50.0), ("exceedance probability per year", 1.0)),
        *(("Annual Frequency of Exceedance", 0.0), ("annual_rate", 0.0), ("rate of exceedance in 50 years", 0.0)),
    ],
)
def test_second_heading_tells_probabilities_from_rates(tmp_path, heading, years):
    """A probability in N years is that of a Poisson process: 1 - exp(-rate N)."""
    path = tmp_path / "site.csv"
    path.write_text(f"PGA (g);{heading}\n0,1;0,6\n1,0;0,005\n")
    rates = np.array(read_hazard(path).rate)
    shares = 1.0 - np.exp(-rates * years) if years else rates
    np.testing.assert_allclose(shares, [0.6, 0.005], rtol=1e-12)


@pytest.mark.parametrize("heading", ["x,rate\n", "pga,annual rate\n", "Sa(0.6),rate\n", "a_g,rate\n"])
def test_a_curve_without_a_unit_is_refused(tmp_path, heading):
    path = tmp_path / "site.csv"
    path.write_text(f"{heading}0.05,1e-2\n0.8,1e-3\n")
    with pytest.raises(InputError, match=r"site.csv:1: .*'PGA \(g\)', or give it: --hazard-units g"):
        read_hazard(path)
    assert hazard_of(path, "g").intensity[0] == pytest.approx(0.05 * 9.81)
    assert hazard_of(" k0 = 1e-3, kappa=2", "g").exceeded(9.81) == pytest.approx(1e-3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x,rate\n0.1,1e-2\n0.2,2e-2\n", "site.csv:3: annual rate 0.02 follows 0.01: a stronger motion must be rarer"),
        ("x (g),AFE\n0.1,1e-2\n0.2,1e-2\n", "site.csv:3: annual rate 0.01 follows 0.01"),
        ("x,rate\n0.2,1e-2\n0.1,1e-3\n", "site.csv:3: intensity 0.1 follows 0.2; sort the points"),
        ("x,rate\n0.1,1e-2\n0.2,0\n", "site.csv:3: annual rate 0.0 is no number above 0; leave out"),
        ("x,rate\nnan,1e-2\n0.2,1e-3\n", "site.csv:2: intensity nan is no number above 0"),
        ("pga (g),poe in 50 years\n0.1,1\n0.2,0.1\n", "site.csv:2: probability 1.0 is no number in (0, 1); leave out"),
        ("pga (g),poe\n0.1,0.5\n0.2,0.1\n", "site.csv:1: the second column is a probability in an unknown time"),
        ("pga (g),poe in 0 years\n0.1,0.5\n0.2,0.1\n", "site.csv:1: the second column is a probability in an unknown"),
        ("pga (g),value\n0.1,0.5\n0.2,0.1\n", "site.csv:1: the second column is no rate and no probability by its"),
        ("0.1,0.5\n0.2,0.1\n", "site.csv:1: the second column is no rate and no probability by its heading ''"),
        ("0.1,1e-2\n0.2;1e-3\n", "site.csv:2: '0.2;1e-3' won't do; give two numbers"),
        ("", "site.csv: 0 points; a hazard curve has 2 or more"),
        ("pga (kg),rate\n1,1\n2,0.5\n", "site.csv:1: the unit 'kg' of the intensity is unknown; head the intensities"),
        ("pga (m/s),rate\n1,1\n2,0.5\n", "site.csv:1: pga is not measured in m/s; mend the heading"),
    ],
)
def test_files_that_are_no_hazard_are_told_with_their_line(tmp_path, text, said):
    path = tmp_path / "site.csv"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_hazard(path)
    assert str(caught.value).startswith(said)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: hazard_of("k0=1"), "won't do; give a CSV file, or k0=RATE,kappa=SLOPE"),
        (lambda: hazard_of("k0=a,kappa=2"), "won't do; give a CSV file, or k0=RATE,kappa=SLOPE"),
        (lambda: hazard_of("k0=1,kappa=-1"), r"kappa of the hazard: -1 is not in \(0, inf\)"),
        (lambda: hazard_of("/nowhere/none.csv"), "can't read the hazard curve"),
        (lambda: Hazard((1.0, 2.0), (1, 2)), "point 2 of the hazard: annual rate 2 follows 1"),
        (lambda: Hazard((1.0,), (1.0, 0.5)), "1 intensities and 2 rates"),
    ],
)
def test_other_hazards_that_are_none(make, said):
    with pytest.raises(InputError, match=said):
        make()
