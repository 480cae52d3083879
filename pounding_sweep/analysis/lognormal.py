"""A lognormal distribution of capacity, fitted to intensities at which something did or did not happen.

P(event | x) = Phi(ln(x / median) / dispersion), by maximum likelihood of independent
trials that happened or not (Baker 2015, "Efficient analytical fragility function
fitting using dynamic structural analysis", Earthquake Spectra 31(1)). In a + b ln x
= ln(x / median) / dispersion the likelihood is log-concave, so that there is one
maximum, or none at any finite value: those cases are told beforehand.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from pounding_sweep.errors import PoundingSweepError

#: Intensities that differ by less than this share are one.
SAME = 1e-9
#: A median farther than by this factor outside the intensities tried is no result.
FARTHEST = 10.0
#: A dispersion above this is no result: the probability then hardly changes over any intensities that are tried.
WIDEST = 5.0


class FitStatus(IntEnum):
    """Whether trials have a fit, or why not.

    Attributes
    ----------
    meaning : str
        In words; ``{low}``, ``{high}`` and ``{units}`` stand for what is known of the median.
    """

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
        "the strongest motion without it has {low} {units}, the weakest with it {high} {units}: the median lies there, "
        "and the dispersion can't be told",
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
        """Return the meaning with what is known of the median.

        Examples
        --------
        >>> FitStatus.NEVER.words(3.0, float("nan"), "m s-2")
        'never happened: the median is above 3 m s-2, the strongest motion tried'
        >>> FitStatus.SEPARATED.words(0.85, 1.56, "m s-2").partition(":")[0]
        'the strongest motion without it has 0.85 m s-2, the weakest with it 1.56 m s-2'
        """
        return self.meaning.format(low=f"{low:.4g}", high=f"{high:.4g}", units=units)


#: Every status, by rising value.
FIT_STATUS: tuple[FitStatus, ...] = tuple(FitStatus)


def _unknown() -> np.ndarray:
    return np.full((2, 2), np.nan)


@dataclass(frozen=True)
class LognormalFit:
    """A fitted lognormal, or why there is none.

    Attributes
    ----------
    status : FitStatus
        Whether there is one.
    median : float
        Intensity at which the event is as likely as not; NaN without a fit.
    dispersion : float
        Standard deviation of the logarithm of the capacity; NaN without a fit.
    covariance : ndarray, shape (2, 2)
        Of (ln median, ln dispersion), by the observed information.
    low, high : float
        What is known of the median without a fit; NaN where nothing is.
    """

    status: FitStatus
    median: float = np.nan
    dispersion: float = np.nan
    covariance: np.ndarray = field(default_factory=_unknown)
    low: float = np.nan
    high: float = np.nan


def fit_lognormal(intensity: np.ndarray, happened: np.ndarray, weights: np.ndarray | None = None) -> LognormalFit:
    """Fit a lognormal to trials.

    Parameters
    ----------
    intensity : ndarray, shape (n,)
        Of each trial, above zero; trials at zero tell nothing and are left out.
    happened : ndarray of bool, shape (n,)
        Whether the event happened.
    weights : ndarray, shape (n,), optional
        How often each trial counts; 1 by default.

    Returns
    -------
    LognormalFit
        Of the maximum likelihood; its `status` says where there is none.

    Examples
    --------
    >>> x = np.array([1.0, 2.0, 2.0, 3.0, 3.0, 4.0])
    >>> round(fit_lognormal(x, np.array([0, 0, 1, 0, 1, 1], bool)).median, 3)
    2.367
    >>> fit_lognormal(x, x > 2.5).status.label
    'separated'
    """
    weights = np.ones(len(intensity)) if weights is None else weights
    used = (intensity > 0.0) & (weights > 0.0)
    x, y, w = _merged(intensity[used]), np.asarray(happened, dtype=bool)[used], weights[used]
    if not x.size:
        return LognormalFit(FitStatus.NO_DATA)
    if not y.any():
        return LognormalFit(FitStatus.NEVER, low=float(x.max()))
    if y.all():
        return LognormalFit(FitStatus.ALWAYS, high=float(x.min()))
    if x.min() == x.max():
        return LognormalFit(FitStatus.ONE_LEVEL, low=float(x[0]))
    if x[~y].max() <= x[y].min():
        return LognormalFit(FitStatus.SEPARATED, low=float(x[~y].max()), high=float(x[y].min()))
    if x[y].max() <= x[~y].min():
        return LognormalFit(FitStatus.NOT_RISING)
    return _maximum(np.log(x), y, w)


def _merged(x: np.ndarray) -> np.ndarray:
    """Return values of which those that differ by rounding alone are equal: records scaled to one intensity."""
    order = np.argsort(x)
    ordered = x[order]
    starts = np.append(True, ordered[1:] > ordered[:-1] * (1.0 + SAME))[: len(x)]
    found = np.empty_like(x)
    found[order] = ordered[np.flatnonzero(starts)][np.cumsum(starts) - 1]
    return found


def _maximum(log_x: np.ndarray, y: np.ndarray, w: np.ndarray) -> LognormalFit:
    """Find where the slope of the likelihood is zero, which it is at one place: its maximum."""
    from scipy.optimize import root
    from scipy.special import log_ndtr

    middle, spread = float(log_x.mean()), float(log_x.std())
    sign = np.where(y, 1.0, -1.0)
    columns = sign[:, None] * np.stack([np.ones_like(log_x), (log_x - middle) / spread], axis=1)

    def ratio(t: np.ndarray) -> np.ndarray:  # density over distribution, which both underflow far out
        return np.asarray(np.exp(-0.5 * t**2 - 0.5 * np.log(2.0 * np.pi) - log_ndtr(t)))

    def slope(p: np.ndarray) -> np.ndarray:
        return np.asarray(-(w * ratio(columns @ p)) @ columns)

    def curvature(p: np.ndarray) -> np.ndarray:
        t = columns @ p
        r = ratio(t)
        return np.asarray((columns * (w * r * (r + t))[:, None]).T @ columns)

    found = root(slope, np.array([0.0, 1.0]), jac=curvature, method="hybr")
    if np.abs(slope(found.x)).max() > 1e-6 * w.sum():  # its own verdict fails where the root is met to the last digit
        msg = f"the maximum of the likelihood of {len(y)} trials was not found: {found.message}"
        raise PoundingSweepError(msg)
    a, b = (float(p) for p in found.x)
    log_median = middle - spread * a / b if b > 0.0 else np.inf
    inside = log_x.min() - np.log(FARTHEST) <= log_median <= log_x.max() + np.log(FARTHEST)
    if not inside or spread > WIDEST * b:
        return LognormalFit(FitStatus.NOT_RISING)
    # of ln median = middle - spread a / b and ln dispersion = ln(spread / b)
    jacobian = np.array([[-spread / b, spread * a / b**2], [0.0, -1.0 / b]])
    covariance = jacobian @ np.linalg.inv(curvature(found.x)) @ jacobian.T
    return LognormalFit(FitStatus.FITTED, float(np.exp(log_median)), spread / b, covariance)


def limit(fit: LognormalFit) -> LognormalFit:
    """Return what a fit that does not exist tends to, so that it can be counted among others that do.

    Where trials are separated, the likelihood rises without end as the dispersion goes to
    zero, at any median in between: the geometric mean is taken. Where the event never or
    always happened, the median goes to infinity or to zero. Others have no limit.
    """
    if fit.status == FitStatus.SEPARATED:
        return LognormalFit(FitStatus.FITTED, float(np.sqrt(fit.low * fit.high)), 0.0)
    if fit.status == FitStatus.NEVER:
        return LognormalFit(FitStatus.FITTED, np.inf)
    if fit.status == FitStatus.ALWAYS:
        return LognormalFit(FitStatus.FITTED, 0.0)
    return fit


def probability(fit: LognormalFit, intensity: np.ndarray) -> np.ndarray:
    """Return the probability of the event at intensities above zero; NaN without a fit. See `limit` for a step."""
    from scipy.special import ndtr

    if fit.status != FitStatus.FITTED:
        return np.full(np.shape(intensity), np.nan)
    if not (fit.dispersion > 0.0 and 0.0 < fit.median < np.inf):
        return np.heaviside(np.asarray(intensity) - fit.median, 0.5)
    return np.asarray(ndtr(np.log(intensity / fit.median) / fit.dispersion))
