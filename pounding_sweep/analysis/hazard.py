"""How often the ground motion at a site exceeds an intensity, and what that makes of a lognormal capacity.

The annual rate of an event that happens from intensity X on is the mean of the hazard lambda(X), in closed form for a
lognormal X where lambda is a power of x between two points; of one power law k0 x^-kappa throughout it is
k0 median^-kappa exp((kappa dispersion)^2 / 2) (Cornell, Jalayer, Hamburger & Foutch 2002, J. Struct. Eng. 128(4)).
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pounding_sweep.analysis.scenarios import numbers_in
from pounding_sweep.base.errors import InputError
from pounding_sweep.base.files import FilePath, expanded
from pounding_sweep.records import UNITS
from pounding_sweep.records.reader import match_unit

#: Size of each unit of a file in m and s, and what that is.
_UNITS = {unit: (size, "m s-2") for unit, size in UNITS.items()} | {"m/s": (1.0, "m s-1"), "cm/s": (0.01, "m s-1")}
#: Intensity at the start of a heading; of a spectral one perhaps with its period: "Sa(0.6 s)", "SA(T1=0.6)".
_MEASURE = re.compile(
    r"(pga|pgv|p?sa)(?![^\W_])(?:\W*(?:t1?\s*=\s*)?(\d+(?:[.,]\d*)?|[.,]\d+)\s*s?\s*\))?", re.IGNORECASE
)
#: What a second heading says its column is; probabilities need their years: "poe in 50 years", "annual probability".
_RATE = re.compile(r"(?<![a-z])(?:rate|freq|m?afe(?![a-z])|lambda)", re.IGNORECASE)
_PROBABILITY = re.compile(r"(?<![a-z])(?:poe|prob|exceedance)", re.IGNORECASE)
_SPAN = re.compile(r"(\d+(?:[.,]\d+)?)[\s_-]*y|(annual|yearly|per year)", re.IGNORECASE)
_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
#: Logarithms of capacities that are looked for are this far from those of the points at most.
_FAR = 1e6


@dataclass(frozen=True)
class Hazard:
    """Annual rates at which intensities are exceeded.

    Between two points the rate is a power of the intensity; beyond the first and the last one the powers next to them
    go on.

    Parameters
    ----------
    intensity : tuple of float
        Two or more, rising, above zero, in the intensity's unit.
    rate : tuple of float
        How many motions in a year are stronger, falling, above zero.
    source : str
        What it is, in words.
    units : str
        Unit of the intensities, as `pounding_sweep.analysis` writes it; "" where it is not said.
    everywhere : bool
        Whether the powers beyond the ends are meant, as of a power law, and not prolonged.
    measure : str
        The intensity by its name: "pga", "pgv", "sa", "sa(PERIOD)"; "" where it is not said.
    stated_unit : tuple of str and float
        The unit that it was given in, such as "g", and its size in `units`: answers are in it.

    Examples
    --------
    >>> site = Hazard.power_law(1e-3, 2.0)
    >>> float(site.exceeded(2.0))
    0.00025
    """

    intensity: tuple[float, ...]
    rate: tuple[float, ...]
    source: str = "rates that were given"
    units: str = ""
    everywhere: bool = False
    measure: str = ""
    stated_unit: tuple[str, float] = ("", 1.0)

    def __post_init__(self) -> None:
        if np.shape(self.intensity) != np.shape(self.rate) or np.size(self.rate) < 2:
            sizes = f"{np.size(self.intensity)} intensities and {np.size(self.rate)} rates"
            raise InputError(f"a hazard of {sizes}; give two or more of each")
        points = zip(self.intensity, self.rate, strict=True)
        _check_points((f"point {i} of the hazard", x, y) for i, (x, y) in enumerate(points, 1))

    @classmethod
    def power_law(cls, k0: float, kappa: float) -> Hazard:
        """Return the hazard k0 x^-kappa: k0 motions a year are stronger than 1.

        Parameters
        ----------
        k0 : float
            Annual rate at which intensity 1 is exceeded, above 0.
        kappa : float
            Slope of the hazard, above 0.

        Returns
        -------
        Hazard
            That holds at all intensities.
        """
        for name, value in (("k0", k0), ("kappa", kappa)):
            numbers_in("(0, inf)", value, f"{name} of the hazard")
        return cls((1.0, math.e), (k0, k0 * math.exp(-kappa)), f"{k0:g} x^-{kappa:g}", everywhere=True)

    def exceeded(self, intensity: np.ndarray | float) -> np.ndarray:
        """Return the annual rate at which intensities above zero are exceeded."""
        x, rates, slopes = self._lines()
        at = np.log(np.asarray(intensity, dtype=float))
        piece = np.clip(np.searchsorted(x, at) - 1, 0, len(slopes) - 1)
        return np.exp(rates[piece] - slopes[piece] * (at - x[piece]))

    def touching(self, median: np.ndarray, dispersion: np.ndarray) -> np.ndarray:
        """Return the annual rate of what happens from a lognormal intensity on: the mean of its rates."""
        return self._pieces(np.log(median), dispersion).sum(axis=0)

    def beyond(self, median: np.ndarray, dispersion: np.ndarray) -> np.ndarray:
        """Return the share of that rate that stems from intensities beyond the points."""
        pieces = self._pieces(np.log(median), dispersion)
        return (not self.everywhere) * (pieces[0] + pieces[-1]) / pieces.sum(axis=0)

    def median_at(self, rate: np.ndarray | float, dispersion: np.ndarray) -> np.ndarray:
        """Return the median of the lognormal of that dispersion that is met at an annual rate."""
        return self._solve(lambda mu, beta: self._pieces(mu, beta).sum(axis=0), rate, dispersion)

    def factor_at(self, rate: np.ndarray | float, capacities: np.ndarray) -> np.ndarray:
        """Return the factor on capacities whose mean rate is this one; infinite ones are never reached."""
        finite = capacities[np.isfinite(capacities)]
        return self._solve(lambda x: self.exceeded(np.exp(x)[..., None] * finite).sum(axis=-1) / capacities.size, rate)

    def _solve(self, rates: Callable[..., np.ndarray], rate: Any, *args: Any) -> np.ndarray:
        """Return the capacity at which a rate, which falls with its logarithm, is that one."""
        from scipy.optimize.elementwise import find_root

        def excess(x: np.ndarray, target: np.ndarray, *more: np.ndarray) -> np.ndarray:
            with np.errstate(divide="ignore", over="ignore", invalid="ignore"):  # far out rates are none or endless
                return np.clip(np.log(rates(x, *more) / target), -_FAR, _FAR)

        ends = np.log(self.intensity[0]) - _FAR, np.log(self.intensity[-1]) + _FAR
        with np.errstate(over="ignore"):  # of dispersions that nearly nothing is known of
            return np.exp(find_root(excess, ends, args=(rate, *args)).x)

    def _lines(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return logarithms of the points, and the powers between them."""
        x, rates = np.log(self.intensity), np.log(self.rate)
        return x, rates, -np.diff(rates) / np.diff(x)

    def _pieces(self, log_median: np.ndarray, dispersion: np.ndarray) -> np.ndarray:
        """Return what each stretch between points, the first and the last beyond them, gives to the mean rate."""
        x, rates, slopes = self._lines()
        mu, beta = np.broadcast_arrays(np.asarray(log_median, float), np.maximum(dispersion, 1e-9))  # told from none
        # of each stretch: its ends, a point of it, and the power
        ends = np.concatenate([[-np.inf], x, [np.inf]])
        stretches = ends[:-1], ends[1:], np.append(x[0], x), np.append(rates[0], rates), np.pad(slopes, 1, "edge")
        bottom, top, base, at, k = (part.reshape(-1, *[1] * mu.ndim) for part in stretches)
        shifted = mu - k * beta**2
        with np.errstate(divide="ignore", invalid="ignore"):
            share = log_normal_share((bottom - shifted) / beta, (top - shifted) / beta)
            return np.exp(at - k * (mu - base) + 0.5 * (k * beta) ** 2 + share)


def log_normal_share(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the logarithm of the share of a standard normal between two values."""
    from scipy.special import log_ndtr

    z = np.stack(np.broadcast_arrays(low, high))
    with np.errstate(divide="ignore", invalid="ignore"):
        below, upto = log_ndtr(np.where(z[0] + z[1] > 0.0, -z[::-1], z))  # the side where the difference keeps digits
        return upto + np.log1p(-np.exp(np.minimum(below - upto, 0.0)))


def _check_points(
    points: Iterable[tuple[str, float, float]], what: str = "annual rate", most: float = math.inf
) -> None:
    """Raise `InputError` at the first place whose intensity and rate, or probability, are no point of a hazard."""
    before = (0.0, math.inf)
    for place, x, y in points:
        fault = ""
        if not 0.0 < x < math.inf:
            fault = f"intensity {x!r} is no number above 0"
        elif not 0.0 < y < most:
            interval = "above 0" if most == math.inf else "in (0, 1)"
            fault = f"{what} {y!r} is no number {interval}; leave out points that are never or certainly exceeded"
        elif x <= before[0]:
            fault = f"intensity {x!r} follows {before[0]!r}; sort the points by rising intensity"
        elif y >= before[1]:
            fault = f"{what} {y!r} follows {before[1]!r}: a stronger motion must be rarer"
        if fault:
            raise InputError(f"{place}: {fault}")
        before = x, y


def read_hazard(path: FilePath, units: str | None = None) -> Hazard:
    """Read a hazard curve from a CSV file of two columns: intensity, and how often or how likely it is exceeded.

    Parameters
    ----------
    path : path
        Columns are separated by commas, or by semicolons or tabs, with decimal commas or points. The heading of the
        intensity has its unit in brackets: "PGA (g)", "Sa(0.6 s) [g]"; that of the second column says whether it has
        annual rates ("annual rate", "frequency of exceedance") or probabilities p in N years ("poe in 50 years",
        "annual probability"), which are rates of -ln(1 - p) / N.
    units : str, optional
        Unit of the intensities: one of `pounding_sweep.records.UNITS`, "m/s" or "cm/s". Needed where no heading has it.

    Returns
    -------
    Hazard
        Its points, in m and s.

    Raises
    ------
    InputError
        The file can't be read, its headings do not say the unit or what the second column is, a line is none of two
        numbers, or intensities do not rise or rates do not fall.
    """
    target = expanded(path)
    try:
        lines = target.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or error
        raise InputError(
            f"can't read the hazard curve {str(target)!r} ({why}); give a CSV file headed 'PGA (g),annual rate'"
        ) from None
    rows = [(f"{target.name}:{n}", line) for n, line in enumerate(lines, 1) if line.strip()[:1] not in ("", "#")]
    separator = next((sign for sign in ";\t" if rows and sign in rows[0][1]), ",")
    heading, second, points = "", "", []
    for place, line in rows:
        cells = [cell.strip(" \t\"'") for cell in line.strip().split(separator)]
        try:
            x, y = (float(cell if separator == "," else cell.replace(",", ".")) for cell in cells)
        except ValueError:
            if place != rows[0][0] or re.match(r"[\d.]", cells[0]):
                raise InputError(
                    f"{place}: {line.strip()[:80]!r} won't do; give two numbers, intensity and rate or probability"
                ) from None
            heading, second = cells[0], " ".join(cells[1:])
        else:
            points.append((place, x, y))
    if len(points) < 2:
        raise InputError(f"{target.name}: {len(points)} points; a hazard curve has 2 or more")
    span, likely, years = _SPAN.search(second), bool(_PROBABILITY.search(second)), 0.0
    if not _RATE.search(second):
        years = float((span[1] or "1").replace(",", ".")) if span and likely else 0.0
        if not years:
            what = "a probability in an unknown time" if likely else "no rate and no probability"
            raise InputError(
                f"{rows[0][0]}: the second column is {what} by its heading {second!r}; head it 'annual rate' or, of "
                "probabilities of exceedance, 'poe in 50 years' with their own years"
            )
    _check_points(points, *(("probability", 1.0) if years else ()))
    match, measure = _MEASURE.match(heading), ""
    if match:
        period = f"({float(match[2].replace(',', '.')):g})" if match[2] else ""
        measure = match[1].lower().replace("psa", "sa") + period
    stated = re.findall(r"[(\[]([^()\[\]]*)[)\]]", heading[match.end() if match else 0 :])
    unit = units or "".join(stated[-1:]).strip()
    factor, metric = _unit(unit, rows[0][0], heading)
    if measure and metric != ("m s-1" if measure == "pgv" else "m s-2"):
        raise InputError(f"{rows[0][0]}: {measure} is not measured in {unit}; mend the heading {heading!r}")
    _, intensity, rate = zip(*points, strict=True)
    rates = tuple(-math.log1p(-p) / years for p in rate) if years else rate
    return Hazard(tuple(factor * x for x in intensity), rates, target.name, metric, False, measure, (unit, factor))


def hazard_of(curve: FilePath | Hazard, units: str | None = None) -> Hazard:
    """Return a hazard from a file, or from a text "k0=1e-3,kappa=2.5"; `units` are those of its intensities."""
    if isinstance(curve, Hazard):
        return curve
    text = os.fspath(curve)
    if "=" not in text:
        return read_hazard(text, units)
    match = re.fullmatch(rf"\s*k0\s*=\s*{_NUMBER}\s*,\s*kappa\s*=\s*{_NUMBER}\s*", text)
    if not match:
        raise InputError(f"hazard {text!r} won't do; give a CSV file, or k0=RATE,kappa=SLOPE such as k0=1e-3,kappa=2.5")
    site = Hazard.power_law(float(match[1]), float(match[2]))
    if units is None:
        return site
    factor, metric = _unit(units, "hazard", "")
    return replace(site, intensity=tuple(factor * x for x in site.intensity), units=metric, stated_unit=(units, factor))


def _unit(text: str, place: str, heading: str) -> tuple[float, str]:
    """Return the size of a unit in m and s, and what that is."""
    unit = match_unit(text) or text
    if unit in _UNITS:
        return _UNITS[unit]
    fault = f"the unit {text!r} of the intensity is unknown" if text else f"{heading!r} has no unit"
    raise InputError(
        f"{place}: {fault}; head the intensities with it, such as 'PGA (g)', or give it: --hazard-units g "
        f'(units="g" of read_hazard); one of {", ".join(_UNITS)}'
    )
