"""A lognormal distribution of capacity, fitted to intensities at which something did or did not happen.

P(event | x) = Phi(ln(x / median) / dispersion), by maximum likelihood of independent trials that happened or not (Baker
2015, "Efficient analytical fragility function fitting using dynamic structural analysis", Earthquake Spectra 31(1)). In
a + b ln x = ln(x / median) / dispersion the likelihood is log-concave, so that there is one maximum, or none at any
finite value: those cases are told beforehand. Curves of several gaps or limit states may share one dispersion, and then
never cross (Shinozuka, Feng, Lee & Naganuma 2000, "Statistical analysis of fragility curves", J. Eng. Mech. 126(12),
1224-1231).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from pounding_sweep.base.errors import PoundingSweepError

#: Intensities that differ by less than this share are one.
SAME = 1e-9
#: A median farther than by this factor outside the intensities tried is no result.
FARTHEST = 10.0
#: A dispersion above this is no result: the probability then hardly changes over any intensities that are tried.
WIDEST = 5.0


class FitStatus(IntEnum):
    """Whether trials have a fit, or why not."""

    meaning: str

    def __new__(cls, code: int, meaning: str) -> FitStatus:
        """Make the member of value `code`."""
        member = int.__new__(cls, code)
        member._value_ = code
        member.meaning = meaning
        return member

    FITTED = (0, "fitted")
    NO_DATA = (1, "no trials: no scenario is ok, or nothing of the kind exists there")
    NEVER = (2, "never happened: the median is above {low} {units}, the strongest motion tried")
    ALWAYS = (3, "always happened: the median is below {high} {units}, the weakest motion tried")
    SEPARATED = (
        4,
        "weaker and stronger motions do not overlap: the median is {between}, and the dispersion can't be told",
    )
    ONE_LEVEL = (5, "all trials have one intensity, {low} {units}: no curve follows from them")
    NOT_RISING = (
        6,
        "does not get more likely as the intensity rises, or hardly so over the intensities tried: no lognormal "
        "describes it",
    )

    @property
    def label(self) -> str:
        """Name in ``flag_meanings``."""
        return self.name.lower()

    def words(self, low: float, high: float, units: str) -> str:
        """Return the meaning with what is known of the median."""
        if np.isnan(high):
            between = f"above {low:.4g} {units}, the strongest motion tried, at which less than half have it"
        elif np.isnan(low):
            between = f"below {high:.4g} {units}, the weakest motion tried, at which more than half have it"
        else:
            between = f"about {low:.4g} {units}" if low == high else f"between {low:.4g} and {high:.4g} {units}"
        return self.meaning.format(low=f"{low:.4g}", high=f"{high:.4g}", units=units, between=between)


#: Every status, by rising value.
FIT_STATUS: tuple[FitStatus, ...] = tuple(FitStatus)


@dataclass(frozen=True)
class LognormalFit:
    """A fitted lognormal, or why there is none."""

    status: FitStatus  # whether there is one
    median: float = np.nan  # intensity at which the event is as likely as not; NaN without a fit
    dispersion: float = np.nan  # standard deviation of the logarithm of the capacity; NaN without a fit
    low: float = np.nan  # what is known of the median without a fit; NaN where nothing is
    high: float = np.nan
    limit: float = np.nan  # what the median tends to where trials are separated

    @property
    def limits(self) -> tuple[float, float]:
        """Logarithm of the median and dispersion, of separated trials what they tend to; NaN where there is no fit."""
        if self.status == FitStatus.SEPARATED:
            return float(np.log(self.limit)), 0.0
        return float(np.log(self.median)), self.dispersion


def fit_lognormal(intensity: np.ndarray, happened: np.ndarray) -> LognormalFit:
    """Fit a lognormal to trials."""
    x, y = _usable(intensity, happened)
    if not x.size:
        return LognormalFit(FitStatus.NO_DATA)
    if not y.any():
        return LognormalFit(FitStatus.NEVER, low=float(x.max()))
    if y.all():
        return LognormalFit(FitStatus.ALWAYS, high=float(x.min()))
    if x.min() == x.max():
        return LognormalFit(FitStatus.ONE_LEVEL, low=float(x[0]))
    if x[~y].max() <= x[y].min():
        return _separated(x, y)
    if x[y].max() <= x[~y].min():
        return LognormalFit(FitStatus.NOT_RISING)
    logs = np.log(x)
    return _likeliest(logs, y, np.zeros(len(x), int), np.array([logs.mean()]), float(logs.std()))[0]


def _usable(intensity: np.ndarray, happened: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the trials above zero intensity."""
    used = intensity > 0.0
    return merged(intensity[used]), np.asarray(happened, dtype=bool)[used]


def _separated(x: np.ndarray, y: np.ndarray) -> LognormalFit:
    """Tell where the median of separated trials is: beyond an intensity at which less than half happened."""
    low, high = float(x[~y].max()), float(x[y].min())
    limit = float(np.sqrt(low * high))
    if low == high:
        share = float(y[x == low].mean())
        if share < 0.5:
            high = float(x[x > low].min(initial=np.inf))
        elif share > 0.5:
            low = float(x[x < high].max(initial=-np.inf))
    low, high = (end if np.isfinite(end) else np.nan for end in (low, high))
    return LognormalFit(FitStatus.SEPARATED, low=low, high=high, limit=limit)


def merged(x: np.ndarray) -> np.ndarray:
    """Return values of which those that differ by rounding alone are equal: records scaled to one intensity."""
    order = np.argsort(x)
    ordered = x[order]
    starts = np.append(True, ordered[1:] > ordered[:-1] * (1.0 + SAME))[: len(x)]
    result = np.empty_like(x)
    result[order] = ordered[np.flatnonzero(starts)][np.cumsum(starts) - 1]
    return result


def fit_with_one_dispersion(trials: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[LognormalFit]:
    """Fit lognormals of one dispersion to several sets of trials, intensities and whether it happened."""
    # a set that has no fit of its own has none here, but where trials are separated: the others tell the dispersion
    fits = [fit_lognormal(*each) for each in trials]
    among = [i for i, fit in enumerate(fits) if fit.status in (FitStatus.FITTED, FitStatus.SEPARATED)]
    dispersions = [fits[i].dispersion for i in among if fits[i].status == FitStatus.FITTED]
    if len(among) > 1 and dispersions:
        x, y = zip(*(_usable(*trials[i]) for i in among), strict=True)
        sets = np.repeat(np.arange(len(among)), [len(part) for part in x])
        start = np.array([fits[i].limits[0] for i in among]), float(np.median(dispersions))
        joint = _likeliest(np.log(np.concatenate(x)), np.concatenate(y), sets, *start)
        for i, fit in zip(among, joint, strict=True):
            fits[i] = fit
    return fits


def _likeliest(
    log_x: np.ndarray, y: np.ndarray, sets: np.ndarray, log_medians: np.ndarray, dispersion: float
) -> list[LognormalFit]:
    """Find where the slope of the likelihood is zero, which it is at one place: its maximum."""
    # `sets` is the number of the set of each trial; each set has a median and all one dispersion, which start as given
    from scipy.optimize import root
    from scipy.special import log_ndtr

    middle, spread = float(log_x.mean()), float(log_x.std())
    members = sets[:, None] == np.arange(len(log_medians))
    columns = np.where(y, 1.0, -1.0)[:, None] * np.column_stack([members, (log_x - middle) / spread])

    def slope(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        t = columns @ p
        ratio = np.exp(-0.5 * t**2 - 0.5 * np.log(2.0 * np.pi) - log_ndtr(t))  # both underflow far out
        return -ratio @ columns, (columns * (ratio * (ratio + t))[:, None]).T @ columns

    start = np.append((middle - log_medians) / dispersion, spread / dispersion)
    solution = root(slope, start, jac=True, method="hybr")
    if np.abs(solution.fun).max() > 1e-6 * len(y):  # its own verdict fails where the root is met to the last digit
        raise PoundingSweepError(f"the maximum of the likelihood of {len(y)} trials was not found: {solution.message}")
    *offsets, b = (float(p) for p in solution.x)
    fits = []
    for number, a in enumerate(offsets):
        tried = log_x[members[:, number]]
        log_median = middle - spread * a / b if b > 0.0 else np.inf
        inside = tried.min() - np.log(FARTHEST) <= log_median <= tried.max() + np.log(FARTHEST)
        if inside and spread <= WIDEST * b:
            fits.append(LognormalFit(FitStatus.FITTED, float(np.exp(log_median)), spread / b))
        else:
            fits.append(LognormalFit(FitStatus.NOT_RISING))
    return fits


def crossing(median: Any, dispersion: Any, other_median: Any, other_dispersion: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the intensities at which curves cross, and their probability there; not finite where they don't."""
    from scipy.special import ndtr

    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # of one dispersion, or hardly another
        away = np.log(np.divide(other_median, median)) / np.subtract(dispersion, other_dispersion)
        return median * np.exp(dispersion * away), ndtr(np.where(np.isfinite(away), away, np.nan))


def probability(fit: LognormalFit, intensity: np.ndarray) -> np.ndarray:
    """Return the probability of the event at intensities above zero; NaN without a fit."""
    from scipy.special import ndtr

    return np.asarray(ndtr(np.log(intensity / fit.median) / fit.dispersion))


def jackknife(
    fit: LognormalFit, without: Sequence[LognormalFit], intensity: np.ndarray, confidence: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return confidence intervals of a fit from those without one record each.

    They are of the median, the dispersion and the probability at n intensities, each by itself, shapes (2,), (2,) and
    (2, n); NaN where there is none.
    """
    from scipy.special import ndtr, stdtrit

    n, missing = len(without), (np.full(2, np.nan), np.full(2, np.nan), np.full((2, len(intensity)), np.nan))
    if n < 2:
        return missing
    pseudo = n * np.array(fit.limits) - (n - 1) * np.array([other.limits for other in without])
    log_median, dispersion = pseudo.mean(axis=0)
    if not (np.isfinite(pseudo).all() and dispersion > 0.0):
        return missing
    covariance = np.cov(pseudo.T) / n
    wide = float(stdtrit(n - 1, 0.5 + confidence / 2.0))
    ends = wide * np.array([-1.0, 1.0])
    of_median, mixed, of_dispersion = (covariance / fit.dispersion**2)[[0, 0, 1], [0, 1, 1]]
    away = (np.log(intensity) - log_median) / dispersion
    low = high = away
    if wide**2 * of_dispersion > 1.0:
        level = np.sqrt(max(of_median * of_dispersion - mixed**2, 0.0) / (wide**2 * of_dispersion - 1.0))
        low = np.minimum(away, (level - mixed) / of_dispersion)
        high = np.maximum(away, -(level + mixed) / of_dispersion)
    bounds = np.stack([low, high])
    # of two records it may round below zero
    variance = np.maximum(of_median + 2.0 * mixed * bounds + of_dispersion * bounds**2, 0.0)
    return (
        np.exp(log_median + ends * np.sqrt(covariance[0, 0])),
        dispersion * np.exp(ends * np.sqrt(of_dispersion)),
        ndtr(bounds + ends[:, None] * np.sqrt(variance)),
    )
