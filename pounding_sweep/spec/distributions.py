"""What inputs of a design are drawn from: distributions of scipy, between ends."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, ValidationInfo, model_validator

from pounding_sweep.base.errors import InputError, SceneError, unknown
from pounding_sweep.spec.faults import Number, Table, key, number

#: Share of a distribution that must lie between its ends.
_LEAST_WITHIN = 1e-6


def _above_low(high: float | None, info: ValidationInfo) -> float | None:
    low = info.data.get("low")
    if high is not None and low is not None and low >= high:
        raise InputError(f"is {high!r}; it must be above low = {low!r}")
    return high


_High = Annotated[Number, AfterValidator(_above_low)]


class Distribution(Table):
    """What an input is drawn from: a distribution of scipy, cut off at `low` and `high` if they are given."""

    distribution: str = key("a name")
    low: Number | None = number("the lower end", None)
    high: _High | None = number("the upper end", None)

    @property
    def _frozen(self) -> Any:
        from scipy import stats

        return _FROZEN[self.distribution](stats, self)

    @property
    def within(self) -> tuple[float, float]:
        """Shares of the distribution below `low` and below `high`."""
        ends = (-np.inf if self.low is None else self.low, np.inf if self.high is None else self.high)
        return tuple(self._frozen.cdf(ends).tolist())

    def values(self, shares: np.ndarray) -> np.ndarray:
        """Return the values below which the distribution has those shares."""
        first, last = self.within
        return np.clip(self._frozen.ppf(first + shares * (last - first)), self.low, self.high)  # within rounding

    @model_validator(mode="after")
    def _has_width(self) -> Distribution:
        first, last = self.within
        if last - first < _LEAST_WITHIN:
            raise InputError(f"has less than {_LEAST_WITHIN:g} of itself between low and high; give wider ends")
        return self


class Uniform(Distribution):
    """Every value between `low` and `high` is as likely."""

    low: Number = number("the lower end")
    high: _High = number("the upper end")


class LogUniform(Distribution):
    """The logarithm is uniform."""

    low: Number = number("the lower end", gt=0.0)
    high: _High = number("the upper end", gt=0.0)


class Normal(Distribution):
    """A normal distribution."""

    mean: Number = number("the mean")
    std: Number = number("the standard deviation", gt=0.0)


class Lognormal(Distribution):
    """The logarithm is normal, of standard deviation `dispersion`."""

    median: Number = number("the median", gt=0.0)
    dispersion: Number = number("the standard deviation of the logarithm", gt=0.0)
    low: Number | None = number("the lower end", None, ge=0.0)


#: Distribution -> what makes it of `scipy.stats`.
_FROZEN: dict[str, Callable[[Any, Any], Any]] = {
    "uniform": lambda stats, it: stats.uniform(it.low, it.high - it.low),
    "log_uniform": lambda stats, it: stats.loguniform(it.low, it.high),
    "normal": lambda stats, it: stats.norm(it.mean, it.std),
    "lognormal": lambda stats, it: stats.lognorm(it.dispersion, scale=it.median),
}
DISTRIBUTIONS: dict[str, type[Distribution]] = {
    "uniform": Uniform,
    "log_uniform": LogUniform,
    "normal": Normal,
    "lognormal": Lognormal,
}


def read_distribution(value: dict[str, Any]) -> Distribution:
    """Check a distribution given as a table."""
    kind, valid = value.get("distribution"), ", ".join(DISTRIBUTIONS)
    if not isinstance(kind, str) or kind not in DISTRIBUTIONS:
        text = unknown("distribution", kind, DISTRIBUTIONS) if kind is not None else f"is missing; give one of {valid}"
        raise SceneError(text, ("distribution",))
    return DISTRIBUTIONS[kind].model_validate(value)
