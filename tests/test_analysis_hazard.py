"""Hazards: their rates against integrals done otherwise, and files that are none."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import norm

from pounding_sweep.analysis.hazard import Hazard, hazard_of, read_hazard
from pounding_sweep.base.errors import InputError

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
