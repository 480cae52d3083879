"""Fragility: the fit against a naive likelihood, its degenerate cases in words, and the cube around it."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from analysis_cubes import hand_cube
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtr

from pounding_sweep.analysis import fragility
from pounding_sweep.analysis.comparisons import EVENTS
from pounding_sweep.analysis.comparisons.fragility import (
    FitStatus,
    LognormalFit,
    crossing,
    fit_lognormal,
    fit_rows,
    fit_with_one_dispersion,
    sentence,
)
from pounding_sweep.base.errors import InputError
from pounding_sweep.figures import FIGURES
from pounding_sweep.outputs.variables import VARIABLES, Status

_PLACE = importlib.util.spec_from_file_location(
    "interval_coverage", Path(__file__).parents[1] / "docs" / "interval_coverage.py"
)
interval_coverage = importlib.util.module_from_spec(_PLACE)
_PLACE.loader.exec_module(interval_coverage)


def probability(fit, intensity):
    return ndtr(np.log(intensity / fit.median) / fit.dispersion)


def naive_loss(median, dispersion, x, happened):
    """Negative log-likelihood of Baker (2015), trial by trial."""
    loss = 0.0
    for intensity, yes in zip(x, happened, strict=True):
        z = math.log(intensity / median) / dispersion
        loss -= math.log(0.5 * math.erfc(-z / math.sqrt(2) if yes else z / math.sqrt(2)))
    return loss


def simulated(n, median=2.0, dispersion=0.4, seed=0):
    """Return trials of a known lognormal."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(0.3, 6.0, n)
    return x, x > median * np.exp(dispersion * rng.standard_normal(n))


class TestFit:
    @pytest.mark.parametrize("seed", range(4))
    def test_no_neighbour_is_likelier(self, seed):
        x, happened = simulated(40, seed=seed)
        fit = fit_lognormal(x, happened)
        assert fit.status == FitStatus.FITTED
        best = naive_loss(fit.median, fit.dispersion, x, happened)
        for f in np.geomspace(0.5, 2.0, 15):
            for g in np.geomspace(0.5, 2.0, 15):
                if (f, g) != (1.0, 1.0):
                    assert naive_loss(fit.median * f, fit.dispersion * g, x, happened) >= best - 1e-10

    @given(st.lists(st.tuples(st.sampled_from([0.0, 0.5, 1.0, 2.0, 4.0]), st.booleans()), max_size=12))
    def test_never_a_nonsense_number(self, trials):
        """Whatever the trials: a fit with finite, sensible numbers, or a reason without any."""
        x = np.array([t[0] for t in trials], float)
        happened = np.array([t[1] for t in trials], bool)
        fit = fit_lognormal(x, happened)
        if fit.status == FitStatus.FITTED:
            assert 0.05 <= fit.median <= 40.0
            assert 0.0 < fit.dispersion <= 5.0
        else:
            assert np.isnan([fit.median, fit.dispersion]).all()

    @pytest.mark.parametrize(
        ("x", "happened", "status", "low", "high"),
        [
            ([], [], FitStatus.NO_DATA, None, None),
            ([0.0, 0.0], [0, 1], FitStatus.NO_DATA, None, None),
            ([1.0, 3.0], [0, 0], FitStatus.NEVER, 3.0, None),
            ([1.0, 3.0], [1, 1], FitStatus.ALWAYS, None, 1.0),
            ([2.0, 2.0], [0, 1], FitStatus.ONE_LEVEL, 2.0, None),
            ([1.0, 2.0, 3.0], [0, 0, 1], FitStatus.SEPARATED, 2.0, 3.0),
            ([1.0, 2.0, 2.0], [0, 0, 1], FitStatus.SEPARATED, 2.0, 2.0),
            ([1.0, 2.0, 3.0], [1, 0, 0], FitStatus.NOT_RISING, None, None),
            ([2.0, 2.0 * (1 + 1e-15)], [1, 0], FitStatus.ONE_LEVEL, 2.0, None),
            ([1.0, 2.0 * (1 + 1e-15), 2.0, 3.0], [0, 0, 1, 1], FitStatus.SEPARATED, 2.0, 2.0),
            ([1.0, 2.0, 2.0, 2.0], [0, 0, 0, 1], FitStatus.SEPARATED, 2.0, None),
            ([1.0, 1.0, 1.0, 2.0], [1, 0, 1, 1], FitStatus.SEPARATED, None, 1.0),
            ([1.0, 2.0, 2.0, 2.0, 3.0], [0, 0, 0, 1, 1], FitStatus.SEPARATED, 2.0, 3.0),
            ([1.0, 1.0, 2.0, 2.0], [0, 1, 0, 1], FitStatus.NOT_RISING, None, None),
            ([1.0, 2.0, 3.0, 4.0], [1, 0, 1, 0], FitStatus.NOT_RISING, None, None),
        ],
    )
    def test_degenerate_trials_are_told(self, x, happened, status, low, high):
        fit = fit_lognormal(np.array(x), np.array(happened, bool))
        assert fit.status == status
        for found, expected in ((fit.low, low), (fit.high, high)):
            assert np.isnan(found) if expected is None else found == expected

    def test_separated_trials_are_told_from_the_weaker_side(self):
        x = np.array([0.5, 0.85, 1.56, 2.0])
        fit = fit_lognormal(x, x > 1.0)
        told = fit.status.words(fit.low, fit.high, "m s-2")
        assert told.startswith("weaker and stronger motions do not overlap: the median is between 0.85 and 1.56 m s-2,")
        assert not any("{" in status.words(1.0, 2.0, "m s-2") for status in FitStatus)
        above = FitStatus.SEPARATED.words(3.0, float("nan"), "m s-2")
        assert "the median is above 3 m s-2, the strongest motion tried, at which less than half" in above


RECORDS = [f"r{i}" for i in range(12)]
SCALES = [0.25, 0.5, 1.0, 2.0, 4.0]


def suite(seed=0, status=None, **changes):
    """Return counts of a pair that touches from a threshold of each record on; PGA 1 m/s2 each."""
    rng = np.random.default_rng(seed)
    threshold = 1.2 * np.exp(0.6 * rng.standard_normal(len(RECORDS)))
    touches = np.array(SCALES)[None, :] > threshold[:, None]
    count = np.zeros((2, 2, len(RECORDS), len(SCALES), 2, 2))
    count[1, 0] = touches[..., None, None]
    axes = {"law": ["none", "linear"], "gap": [0.01, 0.5], "record": RECORDS, "scale": SCALES}
    return hand_cube(axes, {"impact_count": count, **changes}, status=status), touches


class TestCube:
    def test_fit_of_each_cell(self):
        cube, touches = suite()
        found = fragility(cube)
        cell = found.sel(law="linear", gap=0.01, pair="a-b")
        x = np.broadcast_to(SCALES, touches.shape)
        fit = fit_lognormal(x.ravel(), touches.ravel())
        assert float(cell["median"]) == fit.median
        assert float(cell.dispersion) == fit.dispersion
        assert cell.trials == 60
        assert cell.happened_count == touches.sum()
        np.testing.assert_allclose(cell.probability, probability(fit, cell.intensity.values))
        assert found["median"].attrs["units"] == found.intensity.attrs["units"] == "m s-2"
        never = found.sel(law="linear", gap=0.5, pair="a-b")
        assert never.fit_status == FitStatus.NEVER
        assert sentence(never) == "never happened: the median is above 4 m s-2, the strongest motion tried"
        assert found.law.values.tolist() == ["linear"]

    def test_intervals_are_of_pseudo_values_of_whole_records(self):
        """Against scipy's own interval of a mean, of numbers that a plain loop over the records gives."""
        from scipy.stats import t

        cube, touches = suite(seed=0)
        level = 1.3
        cell = fragility(cube, confidence=0.9, levels=[level]).sel(law="linear", gap=0.01, pair="a-b")
        whole = fit_lognormal(np.tile(SCALES, 12), touches.ravel())
        logs, widths = [], []
        for record in range(12):
            fit = fit_lognormal(np.tile(SCALES, 11), np.delete(touches, record, axis=0).ravel())
            logs.append(12 * math.log(whole.median) - 11 * math.log(fit.median))
            widths.append(12 * whole.dispersion - 11 * fit.dispersion)
        low, high = t.interval(0.9, 11, np.mean(logs), np.std(logs, ddof=1) / math.sqrt(12))
        np.testing.assert_allclose(cell.median_interval, np.exp([low, high]), rtol=1e-9)
        centre, error = np.mean(widths), np.std(widths, ddof=1) / math.sqrt(12) / whole.dispersion
        low, high = t.interval(0.9, 11, math.log(centre), error)
        np.testing.assert_allclose(cell.dispersion_interval, np.exp([low, high]), rtol=1e-9)
        away = (math.log(level) - np.mean(logs)) / centre
        turned = (np.array(logs) + away * np.array(widths)) / whole.dispersion
        low, high = t.interval(0.9, 11, away, np.std(turned, ddof=1) / math.sqrt(12))
        np.testing.assert_allclose(cell.probability_interval[:, 0], ndtr([low, high]), rtol=1e-9)
        assert fragility(cube, confidence=0.9).attrs["confidence"] == 0.9

    def test_bounds_of_the_probability_rise_with_the_intensity(self):
        """However uncertain the dispersion: of few records that are nearly separated, and of others."""
        levels = np.geomspace(0.05, 20.0, 200)
        spans = []
        for seed in range(8):
            cube, _ = suite(seed=seed)
            cell = fragility(cube.isel(record=slice(8)), levels=levels).sel(law="linear", gap=0.01, pair="a-b")
            band = cell.probability_interval
            assert (band.diff("intensity") >= -1e-12).all()
            assert (band[0] <= cell.probability).all()
            assert (cell.probability <= band[1]).all()
            spans.append(float(band[1, -1] - band[0, -1]))
        assert max(spans) > 0.2  # one of them would turn back
        assert min(spans) < 0.1

    @pytest.mark.parametrize(
        ("records", "design"),
        [(10, "8 scales"), (20, "8 scales"), (20, "3 scales")],
    )
    @pytest.mark.slow
    def test_intervals_hold_what_the_suites_were_drawn_from(self, records, design):
        """As often as they promise, within what 400 suites can tell and the table in the documentation shows."""
        found = interval_coverage.measure(records, *interval_coverage.DESIGNS[design], suites=400)
        intervals = [(found["median_interval"], 1.0), (found["dispersion_interval"], interval_coverage.DISPERSION)]
        intervals.append((found["probability_interval"].isel(intensity=1), 0.5))
        for interval, true in intervals:
            assert 0.91 <= interval_coverage.share(interval, true) <= 0.99

    def test_trials_that_are_separated_without_one_record_still_have_intervals(self):
        """The dispersion tends to zero there, which widens the intervals."""
        x = np.array([1.0, 1.5, 2.0, 2.2, 3.0, 4.0, 5.0])
        count = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0])
        assert fit_lognormal(np.delete(x, 3), np.delete(count, 3)).status == FitStatus.SEPARATED
        axes = {"record": [f"r{i}" for i in range(7)], "record_pga": ("record", x), "pair": ["a-b"]}
        cell = fragility(xr.Dataset({"impact_count": (("record", "pair"), count[:, None])}, axes)).squeeze("pair")
        assert cell.median_interval[0] < cell["median"] < cell.median_interval[1]
        assert 0.0 < cell.dispersion_interval[0] < cell.dispersion < cell.dispersion_interval[1]
        never = xr.Dataset(
            {"impact_count": (("record", "pair"), [[0.0], [1.0], [0.0]])},
            axes | {"record": list("abc")} | {"record_pga": ("record", x[:3])},
        )
        never = fragility(never).squeeze("pair")  # without the second record it never happens
        assert never.fit_status == FitStatus.FITTED
        assert never.median_interval.isnull().all()

    def test_scenarios_that_are_not_ok_are_no_trials(self):
        status = np.zeros((2, 2, 12, 5))
        status[1, 0, :3] = int(Status.UNDER_RESOLVED_CONTACT)
        cube, touches = suite(status=status)
        cell = fragility(cube, confidence=None).sel(law="linear", gap=0.01, pair="a-b")
        fit = fit_lognormal(np.tile(SCALES, 9), touches[3:].ravel())
        assert cell.trials == 45
        assert cell.left_out == 15
        assert float(cell["median"]) == pytest.approx(fit.median, rel=1e-9)
        assert cell.median_interval.isnull().all()

    def test_levels_of_other_events(self):
        drift = np.zeros((len(RECORDS), len(SCALES), 2, 2))
        rng = np.random.default_rng(1)
        drift[:] = rng.uniform(0.2, 2.0, drift.shape) * np.array(SCALES)[:, None, None]
        cube = hand_cube({"record": RECORDS, "scale": SCALES}, {"drift_max": drift})
        found = fragility(cube, "drift", 0.8, confidence=None)
        expected = fit_lognormal(np.tile(SCALES, 12), (drift[..., 0, :].max(axis=-1) > 0.8).ravel())
        assert float(found["median"].sel(building="a")) == pytest.approx(expected.median, rel=1e-9)
        assert found.attrs["event_in_words"] == "interstorey drift above 0.8 m"
        single = drift[..., 1, 0] > 0.8
        assert found.happened_count.sel(building="b") == single.sum()  # one storey only

    def test_one_record_has_no_interval_and_records_alone_need_no_scale(self):
        count = np.array([0, 1, 0, 1, 1])[:, None, None]
        one = fragility(hand_cube({"scale": SCALES, "record": ["one"]}, {"impact_count": count[:, None]}))
        assert one.median_interval.isnull().all()
        assert one.trial_intensity.dims == ("record", "scale")
        several = hand_cube({"record": RECORDS[:5]}, {"impact_count": count})
        sa = xr.DataArray(
            [1.0, 2.0, 3.0, 4.0, 5.0], dims="record", coords={"record": RECORDS[:5]}, attrs={"units": "g"}
        )
        found = fragility(several, intensity=sa)
        expected = fit_lognormal(sa.values, count.ravel() > 0)
        assert float(found["median"].sel(pair="a-b")) == pytest.approx(expected.median, rel=1e-9)

    def test_rows_are_the_fits(self):
        cube, _ = suite()
        found = fragility(cube)
        rows = fit_rows(found)
        assert len(rows) == found.fit_status.size == 4
        for row in rows:
            cell = found.sel({dim: row[dim] for dim in ("law", "gap", "pair")})
            assert row["trials"] == cell.trials
            assert row["happened"] == cell.happened_count
            assert row["fit"] == sentence(cell)
            for name in ("median", "dispersion"):
                ends = cell[f"{name}_interval"].values
                for key, value in ((name, cell[name]), (f"{name}_lower", ends[0]), (f"{name}_upper", ends[1])):
                    assert row[key] == value if np.isfinite(value) else row[key] is None
        assert "median_lower" not in fit_rows(fragility(cube, confidence=None))[0]

    def test_events_are_outputs(self):
        for event in EVENTS.values():
            if event.variable:
                assert event.per in VARIABLES[event.variable].dims
                assert event.units == VARIABLES[event.variable].units


@pytest.mark.parametrize(
    ("change", "arguments", "message"),
    [
        ({}, {"event": "collapse"}, "unknown event 'collapse'"),
        ({}, {"event": "force"}, "needs a level that impact_force_max must exceed"),
        ({}, {"level": 1.0}, "takes no level"),
        ({}, {"event": "force", "level": 10.0}, "'impact_force_max', which this cube lacks"),
        ({}, {"event": "force", "level": -1.0}, "not -1"),
        ({}, {"confidence": 95}, "confidence is 95"),
        ({}, {"levels": [0.0]}, r"levels are \[0\.0\]"),
        ({}, {"quantiles": [1.0]}, "of a fragility they must be between 0 and 1"),
        ({}, {"one_dispersion": ["scale"]}, "unknown axis of one dispersion 'scale'; valid: gap, law, pair"),
        ({"law": [0]}, {}, "a law with contact, this cube has only 'none'"),
        ({"record": [0], "scale": [1]}, {}, "needs several values of 'record' or 'scale', and this cube has one"),
        ({"record": 0, "scale": 1}, {}, "needs the axis 'record'"),
    ],
)
def test_what_is_not_valid(change, arguments, message):
    with pytest.raises(InputError, match=message):
        fragility(suite()[0].isel(change), **arguments)


# -- one dispersion for several curves --------------------------------------------------------------------------------

#: Intensity at which each record touches, by gap: small gaps by weak motions, and all more alike than large ones.
GAPS = (0.004, 0.008, 0.02)


def gaps(spreads=(0.2, 0.5, 0.9), medians=(0.6, 1.0, 1.8), seed=4):
    """Return counts of a pair that touches from a threshold on that grows with the gap, and whether it touches."""
    rng = np.random.default_rng(seed)
    away = rng.standard_normal((len(RECORDS), 1))
    count = np.zeros((1, len(GAPS), len(RECORDS), len(SCALES), 2, 2))
    for i, (median, spread) in enumerate(zip(medians, spreads, strict=True)):
        count[0, i] = (np.array(SCALES)[None, :] > median * np.exp(spread * away))[..., None, None]
    axes = {"law": ["linear"], "gap": list(GAPS), "record": RECORDS, "scale": SCALES}
    return hand_cube(axes, {"impact_count": count}), count[0, ..., 0, 0] > 0


def test_the_joint_fit_is_likeliest():
    """Against a search that knows only likelihoods, trial by trial."""
    from scipy.optimize import minimize

    _, touches = gaps()
    x = np.tile(SCALES, len(RECORDS))
    trials = [(x, part.ravel()) for part in touches]
    fits = fit_with_one_dispersion(trials)
    assert {fit.status for fit in fits} == {FitStatus.FITTED}
    assert len({fit.dispersion for fit in fits}) == 1

    def loss(p):
        return sum(naive_loss(math.exp(p[i]), math.exp(p[-1]), *each) for i, each in enumerate(trials))

    best = minimize(loss, [0.0, 0.0, 0.0, -0.5], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12}).x
    assert [fit.median for fit in fits] == pytest.approx(np.exp(best[:3]), rel=1e-5)
    assert fits[0].dispersion == pytest.approx(math.exp(best[3]), rel=1e-5)
    alone = fit_lognormal(*trials[0])
    assert fit_with_one_dispersion(trials[:1]) == [alone]


def test_separated_trials_are_fitted_with_the_dispersion_of_others():
    x = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    apart, mixed = x > 2.5, np.array([0, 0, 1, 0, 1, 1]) > 0
    assert fit_lognormal(x, apart).status == FitStatus.SEPARATED
    never = np.zeros(6, bool)
    one, other, last = fit_with_one_dispersion([(x, apart), (x, mixed), (x, never)])
    assert one.dispersion == other.dispersion
    assert 2.0 < one.median < 3.0 < other.median < 5.0
    assert last.status == FitStatus.NEVER
    both = fit_with_one_dispersion([(x, apart), (x, apart)])  # nobody tells the dispersion
    assert [fit.status for fit in both] == [FitStatus.SEPARATED] * 2


@given(st.floats(0.1, 10), st.floats(0.1, 2), st.floats(0.1, 10), st.floats(0.1, 2))
def test_curves_cross_where_they_are_equal(median, dispersion, other_median, other_dispersion):
    at, share = crossing(median, dispersion, other_median, other_dispersion)
    one = LognormalFit(FitStatus.FITTED, median, dispersion)
    other = LognormalFit(FitStatus.FITTED, other_median, other_dispersion)
    if dispersion == other_dispersion:
        assert math.isnan(share)
    elif 1e-6 < share < 1.0 - 1e-6:
        assert probability(one, np.array([at])) == pytest.approx(share, rel=1e-6)
        assert probability(other, np.array([at])) == pytest.approx(share, rel=1e-6)


def test_curves_of_gaps_do_not_cross_with_one_dispersion():
    """A larger gap is never likelier to be closed; with dispersions of their own the fits say so all the same."""
    cube, _ = gaps()
    levels = np.geomspace(0.01, 30.0, 300)
    own, one = (fragility(cube, one_dispersion=axes, levels=levels) for axes in ([], ["gap"]))
    assert one.attrs["one_dispersion"] == "gap"
    assert "curves_cross" not in one.attrs
    assert own.attrs["curves_cross"].startswith("of gap 0.008 and 0.02 at 0.302 m s-2, probability 0.027, and 1 more")
    rising = one["probability"].sel(pair="a-b", law="linear").diff("gap")
    assert float(rising.max()) <= 0.0
    assert float(own["probability"].sel(pair="a-b", law="linear").diff("gap").max()) > 1e-3
    assert np.isfinite(one["median_interval"].sel(pair="a-b")).all()
    low, high = one["dispersion_interval"].sel(pair="a-b", law="linear").transpose("bound", "gap").values
    dispersion = one["dispersion"].sel(pair="a-b", law="linear").values
    assert ((low < dispersion) & (dispersion < high)).all()
    assert "curves cross" in FIGURES["fragility"].draw(own).get_suptitle()
    assert "one dispersion along gap" in FIGURES["fragility"].draw(one).get_suptitle()
