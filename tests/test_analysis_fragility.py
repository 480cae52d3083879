"""Fragility: the fit against a naive likelihood, its degenerate cases in words, and the cube around it."""

from __future__ import annotations

import math

import numpy as np
import pytest
import xarray as xr
from analysis_cubes import LAWS, hand_cube, random_fill
from hypothesis import given, settings
from hypothesis import strategies as st

from pounding_sweep.analysis import fragility
from pounding_sweep.analysis.events import EVENTS
from pounding_sweep.analysis.fragilities import sentence
from pounding_sweep.analysis.lognormal import FIT_STATUS, FitStatus, LognormalFit, fit_lognormal, limit, probability
from pounding_sweep.analysis.rows import fit_rows
from pounding_sweep.cube.variables import VARIABLES, Status
from pounding_sweep.errors import InputError


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

    def test_scipys_other_optimiser_finds_the_same(self):
        from scipy.optimize import minimize

        x, happened = simulated(60, seed=5)
        fit = fit_lognormal(x, happened)
        found = minimize(
            lambda p: naive_loss(math.exp(p[0]), math.exp(p[1]), x, happened),
            [0.0, 0.0],
            method="Nelder-Mead",
            options={"xatol": 1e-9, "fatol": 1e-12},
        )
        np.testing.assert_allclose([fit.median, fit.dispersion], np.exp(found.x), rtol=1e-6)

    def test_many_trials_give_back_what_they_were_drawn_from(self):
        fit = fit_lognormal(*simulated(50_000, 1.7, 0.35, seed=3))
        errors = np.sqrt(np.diag(fit.covariance))
        assert abs(math.log(fit.median / 1.7)) < 4 * errors[0]
        assert abs(math.log(fit.dispersion / 0.35)) < 4 * errors[1]
        assert errors.max() < 0.03

    def test_covariance_is_that_of_the_naive_likelihood(self):
        x, happened = simulated(50, seed=7)
        fit = fit_lognormal(x, happened)
        at = np.log([fit.median, fit.dispersion])
        h = 1e-3
        hessian = np.empty((2, 2))
        for i, j in np.ndindex(2, 2):
            total = 0.0
            for si, sj in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
                p = at + h * (si * np.eye(2)[i] + sj * np.eye(2)[j]) / (2 if i == j else 1)
                total += si * sj * naive_loss(*np.exp(p), x, happened) if i != j else 0.0
            if i == j:
                e = h * np.eye(2)[i]
                total = naive_loss(*np.exp(at + e), x, happened) + naive_loss(*np.exp(at - e), x, happened)
                total -= 2 * naive_loss(*np.exp(at), x, happened)
            hessian[i, j] = total / (h**2 if i == j else 4 * h**2)
        np.testing.assert_allclose(np.linalg.inv(hessian), fit.covariance, rtol=2e-3)

    @given(st.floats(1e-3, 1e3), st.integers(0, 3))
    def test_units_of_the_intensity_do_not_matter(self, factor, seed):
        x, happened = simulated(30, seed=seed)
        one, other = fit_lognormal(x, happened), fit_lognormal(factor * x, happened)
        assert other.status == one.status
        np.testing.assert_allclose([other.median, other.dispersion], [factor * one.median, one.dispersion], rtol=1e-5)

    @given(st.lists(st.integers(0, 4), min_size=12, max_size=12))
    def test_a_weight_is_a_number_of_trials(self, weights):
        x, happened = simulated(12, dispersion=0.8, seed=2)
        one = fit_lognormal(x, happened, np.array(weights, float))
        other = fit_lognormal(np.repeat(x, weights), np.repeat(happened, weights))
        assert one.status == other.status
        np.testing.assert_allclose([one.median, one.dispersion], [other.median, other.dispersion], rtol=1e-5)

    @settings(max_examples=300)
    @given(st.lists(st.tuples(st.sampled_from([0.0, 0.5, 1.0, 2.0, 4.0]), st.booleans()), max_size=12))
    def test_never_a_nonsense_number(self, trials):
        """Whatever the trials: a fit with finite, sensible numbers, or a reason without any."""
        x = np.array([t[0] for t in trials], float)
        happened = np.array([t[1] for t in trials], bool)
        fit = fit_lognormal(x, happened)
        if fit.status == FitStatus.FITTED:
            assert 0.05 <= fit.median <= 40.0
            assert 0.0 < fit.dispersion <= 5.0
            assert np.isfinite(fit.covariance).all()
            assert (np.diag(fit.covariance) > 0).all()
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
            ([1.0, 1.0, 2.0, 2.0], [0, 1, 0, 1], FitStatus.NOT_RISING, None, None),
            ([1.0, 2.0, 3.0, 4.0], [1, 0, 1, 0], FitStatus.NOT_RISING, None, None),
        ],
    )
    def test_degenerate_trials_are_told(self, x, happened, status, low, high):
        fit = fit_lognormal(np.array(x), np.array(happened, bool))
        assert fit.status == status
        for found, expected in ((fit.low, low), (fit.high, high)):
            assert np.isnan(found) if expected is None else found == expected

    def test_probability_and_limits(self):
        fit = LognormalFit(FitStatus.FITTED, 2.0, 0.5)
        np.testing.assert_allclose(probability(fit, np.array([2.0, 2.0 * math.exp(0.5)])), [0.5, 0.8413447], rtol=1e-6)
        x = np.array([1.0, 2.0, 4.0, 8.0])
        step = limit(fit_lognormal(x, x > 3.0))
        assert step.median == pytest.approx(math.sqrt(8.0))
        np.testing.assert_array_equal(probability(step, x), [0.0, 0.0, 1.0, 1.0])
        np.testing.assert_array_equal(probability(limit(fit_lognormal(x, x > 9.0)), x), 0.0)
        np.testing.assert_array_equal(probability(limit(fit_lognormal(x, x > 0.0)), x), 1.0)
        assert np.isnan(probability(limit(fit_lognormal(x, x < 3.0)), x)).all()

    def test_every_status_has_words(self):
        for status in FIT_STATUS:
            assert status.meaning.format(low="1", high="2", units="m s-2")

    def test_separated_trials_are_told_from_the_weaker_side(self):
        x = np.array([0.5, 0.85, 1.56, 2.0])
        fit = fit_lognormal(x, x > 1.0)
        told = fit.status.words(fit.low, fit.high, "m s-2")
        assert told.startswith("the strongest motion without it has 0.85 m s-2, the weakest with it 1.56 m s-2:")


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
        found = fragility(cube, resamples=20)
        cell = found.sel(law="linear", gap=0.01, pair="a-b")
        x = np.broadcast_to(SCALES, touches.shape)
        fit = fit_lognormal(x.ravel(), touches.ravel())
        assert float(cell["median"]) == fit.median
        assert float(cell.dispersion) == fit.dispersion
        assert cell.trials == 60
        assert cell.happened_count == touches.sum()
        z = 1.959964
        expected = fit.median * np.exp(np.array([-z, z]) * math.sqrt(fit.covariance[0, 0]))
        np.testing.assert_allclose(cell.median_interval.sel(interval="information"), expected, rtol=1e-6)
        np.testing.assert_allclose(cell.probability, probability(fit, cell.intensity.values))
        assert found["median"].attrs["units"] == found.intensity.attrs["units"] == "m s-2"
        never = found.sel(law="linear", gap=0.5, pair="a-b")
        assert never.fit_status == FitStatus.NEVER
        assert sentence(never) == "never happened: the median is above 4 m s-2, the strongest motion tried"
        assert found.law.values.tolist() == ["linear"]

    def test_bootstrap_draws_whole_records(self):
        """Against a plain loop over resamples, in which the trials of a drawn record are repeated."""
        cube, touches = suite(seed=1)
        found = fragility(cube, resamples=150, seed=11, confidence=0.9).sel(law="linear", gap=0.01, pair="a-b")
        rng = np.random.default_rng(11)
        medians = []
        for draw in rng.multinomial(12, np.full(12, 1 / 12), size=150):
            rows = np.repeat(np.arange(12), draw)
            fit = limit(fit_lognormal(np.tile(SCALES, 12), touches[rows].ravel()))
            medians.append(fit.median)
        low = np.quantile(medians, 0.05, method="lower")
        high = np.quantile(medians, 0.95, method="higher")
        np.testing.assert_allclose(found.median_interval.sel(interval="bootstrap"), [low, high], rtol=1e-5)
        again = fragility(cube, resamples=150, seed=11, confidence=0.9).sel(law="linear", gap=0.01, pair="a-b")
        xr.testing.assert_identical(found, again)

    def test_bootstrap_is_wider_where_records_repeat(self):
        """Fifty scales of one record are hardly more than one trial: only the bootstrap knows."""
        rng = np.random.default_rng(4)
        scales = np.linspace(0.2, 4.0, 50)
        threshold = 1.3 * np.exp(0.5 * rng.standard_normal(15))
        count = (scales[None, :] > threshold[:, None])[..., None, None]
        records = [f"r{i}" for i in range(15)]
        cube = hand_cube({"record": records, "scale": scales}, {"impact_count": count})
        spans = np.log(fragility(cube).median_interval.sel(pair="a-b")).diff("bound").squeeze()
        assert float(spans.sel(interval="bootstrap")) > 1.5 * float(spans.sel(interval="information"))

    def test_scenarios_that_are_not_ok_are_no_trials(self):
        status = np.zeros((2, 2, 12, 5))
        status[1, 0, :3] = int(Status.UNDER_RESOLVED_CONTACT)
        cube, touches = suite(status=status)
        cell = fragility(cube, resamples=0).sel(law="linear", gap=0.01, pair="a-b")
        fit = fit_lognormal(np.tile(SCALES, 9), touches[3:].ravel())
        assert cell.trials == 45
        assert cell.left_out == 15
        assert float(cell["median"]) == pytest.approx(fit.median, rel=1e-9)
        assert cell.median_interval.sel(interval="bootstrap").isnull().all()

    def test_levels_of_other_events(self):
        drift = np.zeros((len(RECORDS), len(SCALES), 2, 2))
        rng = np.random.default_rng(1)
        drift[:] = rng.uniform(0.2, 2.0, drift.shape) * np.array(SCALES)[:, None, None]
        cube = hand_cube({"record": RECORDS, "scale": SCALES}, {"drift_max": drift})
        found = fragility(cube, "drift", 0.8, resamples=0)
        expected = fit_lognormal(np.tile(SCALES, 12), (drift[..., 0, :].max(axis=-1) > 0.8).ravel())
        assert float(found["median"].sel(building="a")) == pytest.approx(expected.median, rel=1e-9)
        assert found.attrs["event_in_words"] == "interstorey drift above 0.8 m"
        single = drift[..., 1, 0] > 0.8
        assert found.happened_count.sel(building="b") == single.sum()  # one storey only

    def test_one_record_has_no_bootstrap_and_records_alone_need_no_scale(self):
        count = np.array([0, 1, 0, 1, 1])[:, None, None]
        one = fragility(hand_cube({"scale": SCALES, "record": ["one"]}, {"impact_count": count[:, None]}))
        assert one.median_interval.sel(interval="bootstrap").isnull().all()
        assert one.bootstrap_without_fit.isnull().all()
        assert one.trial_intensity.dims == ("record", "scale")
        several = hand_cube({"record": RECORDS[:5]}, {"impact_count": count})
        sa = xr.DataArray(
            [1.0, 2.0, 3.0, 4.0, 5.0], dims="record", coords={"record": RECORDS[:5]}, attrs={"units": "g"}
        )
        found = fragility(several, intensity=sa, resamples=0)
        expected = fit_lognormal(sa.values, count.ravel() > 0)
        assert float(found["median"].sel(pair="a-b")) == pytest.approx(expected.median, rel=1e-9)

    def test_what_is_not_valid(self):
        cube, _ = suite()
        for arguments, text in (
            (("collapse",), "unknown event 'collapse'"),
            (("force",), "needs a level that impact_force_max must exceed"),
            (("touch", 1.0), "takes no level"),
            (("force", 10.0), "'impact_force_max', which this cube lacks"),
            (("force", -1.0), "not -1"),
        ):
            with pytest.raises(InputError, match=text):
                fragility(cube, *arguments)
        with pytest.raises(InputError, match="confidence is 95"):
            fragility(cube, confidence=95)
        with pytest.raises(InputError, match="resamples is -1"):
            fragility(cube, resamples=-1)
        with pytest.raises(InputError, match=r"levels are \[0\.0\]"):
            fragility(cube, levels=[0.0])
        with pytest.raises(InputError, match="a law with contact"):
            fragility(cube.sel(law=["none"]))
        with pytest.raises(InputError, match="one record at one scale"):
            fragility(cube.isel(record=[0], scale=[1]))
        with pytest.raises(InputError, match="needs the axis 'record'"):
            fragility(hand_cube({"law": LAWS}, random_fill(1, "impact_count")))

    def test_rows_are_the_fits(self):
        cube, _ = suite()
        found = fragility(cube, resamples=30)
        rows = fit_rows(found)
        assert len(rows) == found.fit_status.size == 4
        for row in rows:
            cell = found.sel({dim: row[dim] for dim in ("law", "gap", "pair")})
            assert row["trials"] == cell.trials
            assert row["happened"] == cell.happened_count
            assert row["fit"] == sentence(cell)
            ends = cell.median_interval.sel(interval="bootstrap", bound="upper")
            for name, value in (("median", cell["median"]), ("median_upper_bootstrap", ends)):
                assert row[name] == value if np.isfinite(value) else row[name] is None
        assert "median_lower_bootstrap" not in fit_rows(fragility(cube, resamples=0))[0]

    def test_events_are_outputs(self):
        for event in EVENTS.values():
            if event.variable:
                assert event.per in VARIABLES[event.variable].dims
                assert event.units == VARIABLES[event.variable].units
