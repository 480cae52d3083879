"""How often the ground motion at a site exceeds an intensity, and what that makes of a lognormal capacity.

With P(x) the probability of an event at intensity x and X the intensity from which on it happens, the annual rate of
the event is the integral of P(x) |d lambda(x)|; by parts, the mean of lambda(X). Where lambda is a power of x between
two points, that mean has a closed form for a lognormal X, and its sum over the points no further error. For one power
law k0 x^-kappa throughout it is k0 median^-kappa exp((kappa dispersion)^2 / 2) (Cornell, Jalayer, Hamburger & Foutch
2002, "Probabilistic basis for 2000 SAC FEMA steel moment frame guidelines", J. Struct. Eng. 128(4), 526-533).
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pounding_sweep.base.errors import InputError
from pounding_sweep.base.paths import expanded
from pounding_sweep.records import UNITS
from pounding_sweep.records.units import match_unit

#: Units of velocities of a file, each with its size in m/s.
_VELOCITIES = {"m/s": 1.0, "cm/s": 0.01}
#: Spectral acceleration in a heading, perhaps with its period: "Sa(0.6 s)", "SA(T=0.6)", "PSA 0.6s".
_SPECTRAL = re.compile(
    r"(?:p?s[_ ]?a|spectral acceleration)\b\W*(?:t(?:_?1)?\s*=\s*)?(\d+(?:[.,]\d*)?|[.,]\d+)?\s*(?:s(?:ec)?\b)?[)\]]?",
    re.IGNORECASE,
)
_PEAKS = {
    "pga": re.compile(r"pga(?![^\W_])|peak ground acc\w*", re.IGNORECASE),
    "pgv": re.compile(r"pgv(?![^\W_])|peak ground vel\w*", re.IGNORECASE),
}
#: Least dispersion that is told from none.
_SHARP = 1e-9
#: Points of a hazard file at most.
_MOST_POINTS = 10_000
#: Newton's steps towards a rate at most, and the last of them.
_STEPS, _CLOSE = 200, 1e-12


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

    def __post_init__(self) -> None:
        if len(self.intensity) != len(self.rate) or len(self.rate) < 2:
            msg = f"a hazard of {len(self.intensity)} intensities and {len(self.rate)} rates; give two or more of each"
            raise InputError(msg)
        fault = first_fault(self.intensity, self.rate)
        if fault:
            msg = f"point {fault[0] + 1} of the hazard: {fault[1]}"
            raise InputError(msg)

    @classmethod
    def power_law(cls, k0: float, kappa: float) -> Hazard:
        """Return the hazard k0 x^-kappa: k0 motions a year are stronger than 1.

        Parameters
        ----------
        k0 : float
            Annual rate at which intensity 1 is exceeded.
        kappa : float
            Slope of the hazard.

        Returns
        -------
        Hazard
            That holds at all intensities.

        Raises
        ------
        InputError
            A number is not finite and above zero.
        """
        for name, value in (("k0", k0), ("kappa", kappa)):
            if not (math.isfinite(value) and value > 0.0):
                msg = f"{name} of the hazard is {value!r}; it must be a number above 0"
                raise InputError(msg)
        words = f"{k0:g} x^-{kappa:g}"
        return cls((1.0, math.e), (k0, k0 * math.exp(-kappa)), words, everywhere=True)

    def exceeded(self, intensity: np.ndarray | float) -> np.ndarray:
        """Return the annual rate at which intensities above zero are exceeded."""
        x, rates, slopes = self._lines()
        at = np.log(np.asarray(intensity, dtype=float))
        piece = np.clip(np.searchsorted(x, at) - 1, 0, len(slopes) - 1)
        return np.asarray(np.exp(rates[piece] - slopes[piece] * (at - x[piece])))

    def touching(self, median: np.ndarray, dispersion: np.ndarray) -> np.ndarray:
        """Return the annual rate of what happens from a lognormal intensity on: the mean of its rates."""
        return np.asarray(self._pieces(np.log(median), dispersion).sum(axis=0))

    def beyond(self, median: np.ndarray, dispersion: np.ndarray) -> np.ndarray:
        """Return the share of that rate that stems from intensities beyond the points."""
        pieces = self._pieces(np.log(median), dispersion)
        if self.everywhere:
            return np.zeros(pieces.shape[1:])
        return np.asarray((pieces[0] + pieces[-1]) / pieces.sum(axis=0))

    def median_at(self, rate: float, dispersion: np.ndarray) -> np.ndarray:
        """Return the median of the lognormal of that dispersion that is met at an annual rate."""

        def rates(mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            pieces = self._pieces(mu, dispersion)
            slopes = self._lines()[2]
            slopes = np.concatenate([slopes[:1], slopes, slopes[-1:]])
            return pieces.sum(axis=0), np.tensordot(slopes, pieces, axes=1)

        return np.exp(self._solve(rates, rate, np.shape(dispersion)))

    def factor_at(self, rate: float, capacities: np.ndarray) -> float:
        """Return the factor on capacities whose mean rate is this one."""
        logs = np.log(capacities[np.isfinite(capacities)])
        x, points, slopes = self._lines()

        def rates(factor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            at = factor + logs
            piece = np.clip(np.searchsorted(x, at) - 1, 0, len(slopes) - 1)
            each = np.exp(points[piece] - slopes[piece] * (at - x[piece]))
            return each.sum() / capacities.size, (slopes[piece] * each).sum() / capacities.size

        return float(np.exp(self._solve(rates, rate, ())))

    def _solve(self, rates: Callable[[np.ndarray], Any], rate: float, shape: tuple[int, ...]) -> np.ndarray:
        """Return ln x at which a rate is that one, by Newton's steps; `rates` gives its fall as well."""
        x = np.full(shape, np.log(self.intensity).mean())
        low, high = np.full(shape, -np.inf), np.full(shape, np.inf)
        for _ in range(_STEPS):
            found, fall = rates(x)
            low, high = np.where(found >= rate, x, low), np.where(found <= rate, x, high)
            new = x + np.log(found / rate) * found / fall
            new = np.where((new >= low) & (new <= high), new, 0.5 * (low + high))
            moved, x = np.abs(new - x).max(initial=0.0), new
            if moved < _CLOSE:
                break
        return x

    def _lines(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return logarithms of the points, and the powers between them."""
        x, rates = np.log(self.intensity), np.log(self.rate)
        return x, rates, -np.diff(rates) / np.diff(x)

    def _pieces(self, log_median: np.ndarray, dispersion: np.ndarray) -> np.ndarray:
        """Return what each stretch between points, the first and the last beyond them, gives to the mean rate."""
        from scipy.special import log_ndtr

        x, rates, slopes = self._lines()
        slopes = np.concatenate([slopes[:1], slopes, slopes[-1:]])
        base, at = np.append(x[0], x), np.append(rates[0], rates)  # a point of each stretch
        ends = np.concatenate([[-np.inf], x, [np.inf]])
        mu, beta = np.broadcast_arrays(np.asarray(log_median, float), np.maximum(dispersion, _SHARP))
        along = (slice(None), *[None] * mu.ndim)
        k, top, bottom = slopes[along], ends[1:][along], ends[:-1][along]
        shifted = mu - k * beta**2
        with np.errstate(divide="ignore", invalid="ignore"):
            z = np.stack([(bottom - shifted) / beta, (top - shifted) / beta])
            z = np.where((z[0] + z[1] > 0.0)[None], -z[::-1], z)  # on the side where the difference keeps its digits
            low, high = log_ndtr(z)
            share = high + np.log1p(-np.exp(np.minimum(low - high, 0.0)))
            return np.exp(at[along] - k * (mu - base[along]) + 0.5 * (k * beta) ** 2 + share)


def first_fault(intensity: Sequence[float], rate: Sequence[float]) -> tuple[int, str] | None:
    """Return the position of the first point that is none of a hazard, and why; None where all are."""
    for place, (x, y) in enumerate(zip(intensity, rate, strict=True)):
        if not (math.isfinite(x) and x > 0.0):
            return place, f"intensity {x!r} is no number above 0"
        if not (math.isfinite(y) and y > 0.0):
            return place, f"annual rate {y!r} is no number above 0; leave out points that are never exceeded"
        if place and x <= intensity[place - 1]:
            return place, f"intensity {x!r} follows {intensity[place - 1]!r}; sort the points by rising intensity"
        if place and y >= rate[place - 1]:
            return place, (
                f"rate {y!r} follows {rate[place - 1]!r}: a stronger motion must be rarer, so that rates fall as "
                "intensities rise"
            )
    return None


def read_hazard(path: str | os.PathLike[str], units: str | None = None) -> Hazard:
    """Read a hazard curve from a CSV file of two columns: intensity and annual rate of exceedance.

    Parameters
    ----------
    path : path
        Columns are separated by commas, or by semicolons or tabs, with decimal commas or points. The heading of the
        intensity has its unit in brackets: "PGA (g)", "Sa(0.6 s) [g]".
    units : str, optional
        Unit of the intensities: one of `pounding_sweep.records.UNITS`, "m/s" or "cm/s". Needed where no heading has it.

    Returns
    -------
    Hazard
        Its points, in m and s.

    Raises
    ------
    InputError
        The file can't be read, has no unit, a line is none of two numbers, or intensities do not rise or rates do not
        fall.
    """
    target = expanded(path)
    name = Path(target).name
    try:
        with target.open(newline="", encoding="utf-8-sig") as file:
            lines = [(n, line) for n, line in enumerate(file, 1) if line.strip() and not line.lstrip().startswith("#")]
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or error
        msg = f"can't read the hazard curve {str(target)!r} ({why}); give a CSV file of intensities and annual rates"
        raise InputError(msg) from None
    separator = next((sign for sign in ";\t" if lines and sign in lines[0][1]), ",")
    rows = [(n, _cells(line, separator)) for n, line in lines]
    heading = ""
    if rows and not any(_is_number(cell) for cell in rows[0][1]):
        heading = rows[0][1][0].strip()
        rows = rows[1:]
    points = []
    for line, row in rows[: _MOST_POINTS + 1]:
        if len(row) != 2 or not all(_is_number(cell) for cell in row):
            msg = f"{name}:{line}: {','.join(row)[:80]!r} won't do; give two numbers, intensity and annual rate"
            raise InputError(msg)
        points.append((float(row[0]), float(row[1])))
    if not 2 <= len(points) <= _MOST_POINTS:
        msg = f"{name}: {len(rows)} points; a hazard curve has 2 to {_MOST_POINTS}"
        raise InputError(msg)
    intensity, rate = zip(*points, strict=True)
    fault = first_fault(intensity, rate)
    if fault:
        msg = f"{name}:{rows[fault[0]][0]}: {fault[1]}"
        raise InputError(msg)
    measure, stated = _measure_and_unit(heading)
    factor, metric = _unit(units or stated, f"{name}:{lines[0][0]}", heading)
    if metric != ("m s-1" if measure == "pgv" else "m s-2") and measure:
        msg = f"{name}:{lines[0][0]}: {measure} is not measured in {units or stated}; mend the heading {heading!r}"
        raise InputError(msg)
    return Hazard(tuple(factor * x for x in intensity), rate, name, metric, measure=measure)


def hazard_of(given: str | os.PathLike[str] | Hazard, units: str | None = None) -> Hazard:
    """Return a hazard from a file, or from a text "k0=1e-3,kappa=2.5"; `units` are those of its intensities."""
    if isinstance(given, Hazard):
        return given
    text = os.fspath(given)
    if "=" not in text:
        return read_hazard(text, units)
    found = re.fullmatch(r"\s*k0\s*=\s*([^,\s]+)\s*,\s*kappa\s*=\s*([^,\s]+)\s*", text)
    if found is None or not all(_is_number(part) for part in found.groups()):
        msg = f"hazard {text!r} won't do; give a CSV file, or k0=RATE,kappa=SLOPE such as k0=1e-3,kappa=2.5"
        raise InputError(msg)
    site = Hazard.power_law(*(float(part) for part in found.groups()))
    if units is None:
        return site
    factor, metric = _unit(units, "hazard", "")
    return replace(site, intensity=tuple(factor * x for x in site.intensity), units=metric)


def check_measure(site: Hazard, intensity: str, periods: Callable[[str], Sequence[float]]) -> None:
    """Raise `InputError` where the curve is headed with another intensity; `periods` gives those of a name."""
    measure = site.measure
    spectral = measure.startswith("sa") and intensity.startswith("sa")
    if not measure or measure == intensity or (measure == "sa" and spectral):
        return
    if spectral and np.allclose(periods(intensity), float(measure[3:-1]), rtol=0.01):
        return
    name = "sa(PERIOD)" if measure == "sa" else measure
    msg = (
        f"the hazard {site.source} is of {measure} by its heading, the intensity is {intensity}; "
        f"name the curve's own intensity (--intensity {name!r}), or give a curve of {intensity}"
    )
    raise InputError(msg)


def _cells(line: str, separator: str) -> list[str]:
    """Split a line; between semicolons or tabs commas are decimal signs."""
    cells = [cell.strip().strip("\"'").strip() for cell in line.strip().split(separator)]
    if separator == ",":
        return cells
    return [cell.replace(",", ".") if _is_number(cell.replace(",", ".")) else cell for cell in cells]


def _measure_and_unit(heading: str) -> tuple[str, str]:
    """Return the name of the intensity in a heading, and the text of its unit; "" for what it does not say."""
    measure = next((name for name, peak in _PEAKS.items() if peak.match(heading)), "")
    rest = heading
    if measure:
        rest = heading[_PEAKS[measure].match(heading).end() :]  # type: ignore[union-attr]
    elif match := _SPECTRAL.match(heading):
        measure = f"sa({float(match[1].replace(',', '.')):g})" if match[1] else "sa"
        rest = heading[match.end() if match[1] else re.match(r"[^(\[]*", heading).end() :]  # type: ignore[union-attr]
    bracket = re.findall(r"[(\[]([^()\[\]]*)[)\]]", rest)
    tail = re.search(r"(?:\bin\s+|_|\s)([^\s_]+)$", rest) if measure else None  # "a_g" is a symbol
    return measure, bracket[-1].strip() if bracket else tail[1] if tail and match_unit(tail[1]) else ""


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _unit(text: str, place: str, heading: str) -> tuple[float, str]:
    """Return the size of a unit in m and s, and what that is."""
    spelled = match_unit(text)
    if spelled:
        return UNITS[spelled], "m s-2"
    if text in _VELOCITIES:
        return _VELOCITIES[text], "m s-1"
    valid = ", ".join([*UNITS, *_VELOCITIES])
    if not text:
        shown = f"{heading!r} has no unit" if heading else "there is no heading with a unit"
        msg = (
            f"{place}: {shown}; head the intensities with it, such as 'PGA (g)', or give it: --hazard-units g "
            f'(units="g" of read_hazard); one of {valid}'
        )
    else:
        msg = f"{place}: the unit {text!r} of the intensity is unknown; give one of {valid}"
    raise InputError(msg)
