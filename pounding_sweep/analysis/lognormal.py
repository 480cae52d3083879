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


def fit_lognormal(intensity: np.ndarray, happened: np.ndarray) -> LognormalFit:
    """Fit a lognormal to trials."""
    used = intensity > 0.0
    x, y = merged(intensity[used]), np.asarray(happened, dtype=bool)[used]
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
    return _maximum(np.log(x), y)[0]


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
    found = np.empty_like(x)
    found[order] = ordered[np.flatnonzero(starts)][np.cumsum(starts) - 1]
    return found


def fit_with_one_dispersion(trials: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[LognormalFit]:
    """Fit lognormals of one dispersion to several sets of trials, intensities and whether it happened."""
    # a set that has no fit of its own has none here, but where trials are separated: the others tell the dispersion
    alone = [fit_lognormal(*each) for each in trials]
    among = [i for i, fit in enumerate(alone) if fit.status in (FitStatus.FITTED, FitStatus.SEPARATED)]
    own = [alone[i].dispersion for i in among if alone[i].status == FitStatus.FITTED]
    if len(among) < 2 or not own:
        return alone
    used = [(merged(x[x > 0.0]), np.asarray(y, dtype=bool)[x > 0.0]) for x, y in (trials[i] for i in among)]
    log_x, y = np.log(np.concatenate([x for x, _ in used])), np.concatenate([y for _, y in used])
    of = np.repeat(np.arange(len(used)), [len(x) for x, _ in used])
    places = np.array([_tends_to(alone[i])[0] for i in among])
    found = _maximum(log_x, y, of, (places, float(np.median(own))))
    return [found[among.index(i)] if i in among else fit for i, fit in enumerate(alone)]


def _maximum(
    log_x: np.ndarray, y: np.ndarray, of: np.ndarray | None = None, start: tuple[np.ndarray, float] | None = None
) -> list[LognormalFit]:
    """Find where the slope of the likelihood is zero, which it is at one place: its maximum."""
    # With `of`, the set of each trial, each has a median and all one dispersion; `start`, logarithms of medians, and
    # it.
    from scipy.optimize import root
    from scipy.special import log_ndtr

    middle, spread = float(log_x.mean()), float(log_x.std())
    sign = np.where(y, 1.0, -1.0)
    sets = np.ones((len(y), 1)) if of is None else (of[:, None] == np.arange(of[-1] + 1)).astype(float)
    columns = sign[:, None] * np.column_stack([sets, (log_x - middle) / spread])
    first = np.append(np.zeros(sets.shape[1]), 1.0)
    if start is not None:
        first = np.append((middle - start[0]) / start[1], spread / start[1])

    def ratio(t: np.ndarray) -> np.ndarray:  # density over distribution, which both underflow far out
        return np.asarray(np.exp(-0.5 * t**2 - 0.5 * np.log(2.0 * np.pi) - log_ndtr(t)))

    def slope(p: np.ndarray) -> np.ndarray:
        return np.asarray(-ratio(columns @ p) @ columns)

    def curvature(p: np.ndarray) -> np.ndarray:
        t = columns @ p
        r = ratio(t)
        return np.asarray((columns * (r * (r + t))[:, None]).T @ columns)

    found = root(slope, first, jac=curvature, method="hybr")
    if np.abs(slope(found.x)).max() > 1e-6 * len(y):  # its own verdict fails where the root is met to the last digit
        msg = f"the maximum of the likelihood of {len(y)} trials was not found: {found.message}"
        raise PoundingSweepError(msg)
    *places, b = (float(p) for p in found.x)
    fits = []
    for number, a in enumerate(places):
        mine = log_x if of is None else log_x[of == number]
        log_median = middle - spread * a / b if b > 0.0 else np.inf
        inside = mine.min() - np.log(FARTHEST) <= log_median <= mine.max() + np.log(FARTHEST)
        fitted = inside and spread <= WIDEST * b
        fits.append(
            LognormalFit(FitStatus.FITTED, float(np.exp(log_median)), spread / b)
            if fitted
            else LognormalFit(FitStatus.NOT_RISING)
        )
    return fits


def crossing(one: LognormalFit, other: LognormalFit) -> tuple[float, float]:
    """Return the intensity at which two curves cross, and their probability there; NaN where they don't."""
    from scipy.special import ndtr

    if one.status != FitStatus.FITTED or other.status != FitStatus.FITTED or one.dispersion == other.dispersion:
        return np.nan, np.nan
    away = float(np.log(other.median / one.median)) / (one.dispersion - other.dispersion)
    with np.errstate(over="ignore"):  # dispersions that hardly differ: the curves cross far away
        return float(one.median * np.exp(one.dispersion * away)), float(ndtr(away))


def probability(fit: LognormalFit, intensity: np.ndarray) -> np.ndarray:
    """Return the probability of the event at intensities above zero; NaN without a fit."""
    from scipy.special import ndtr

    return np.asarray(ndtr(np.log(intensity / fit.median) / fit.dispersion))


@dataclass(frozen=True)
class Intervals:
    """Confidence intervals of a fit, each of lower and upper end; NaN where there is none."""

    median: np.ndarray  # of the fit's parameters
    dispersion: np.ndarray
    probability: np.ndarray  # of the probability at n intensities, each by itself


def jackknife(
    fit: LognormalFit, without: Sequence[LognormalFit], intensity: np.ndarray, confidence: float
) -> Intervals:
    """Return confidence intervals of a fit from those without one record each."""
    from scipy.special import ndtr, stdtrit

    n = len(without)
    missing = Intervals(np.full(2, np.nan), np.full(2, np.nan), np.full((2, len(intensity)), np.nan))
    if n < 2:
        return missing
    pseudo = n * np.array(_tends_to(fit)) - (n - 1) * np.array([_tends_to(one) for one in without])
    log_median, dispersion = pseudo.mean(axis=0)
    if not (np.isfinite(pseudo).all() and dispersion > 0.0):
        return missing
    covariance = np.cov(pseudo.T) / n
    wide = float(stdtrit(n - 1, 0.5 + confidence / 2.0))
    ends = wide * np.array([-1.0, 1.0])
    own, both, other = (covariance / fit.dispersion**2)[[0, 0, 1], [0, 1, 1]]
    away = (np.log(intensity) - log_median) / dispersion
    low = high = away
    if wide**2 * other > 1.0:
        level = np.sqrt(max(own * other - both**2, 0.0) / (wide**2 * other - 1.0))
        low, high = np.minimum(away, (level - both) / other), np.maximum(away, -(level + both) / other)
    bounds = np.stack([low, high])
    variance = np.maximum(own + 2.0 * both * bounds + other * bounds**2, 0.0)  # of two records it may round below
    return Intervals(
        np.exp(log_median + ends * np.sqrt(covariance[0, 0])),
        dispersion * np.exp(ends * np.sqrt(other)),
        ndtr(bounds + ends[:, None] * np.sqrt(variance)),
    )


def _tends_to(fit: LognormalFit) -> tuple[float, float]:
    """Return ln median and dispersion, of separated trials what they tend to; NaN where there is no fit."""
    if fit.status == FitStatus.SEPARATED:
        return float(np.log(fit.limit)), 0.0
    return float(np.log(fit.median)), fit.dispersion
