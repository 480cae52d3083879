"""Fragility: the probability that something happens, against the intensity of the ground motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pounding_sweep.analysis.events import Event, get_event
from pounding_sweep.analysis.intensity import intensity_of
from pounding_sweep.analysis.lognormal import FIT_STATUS, FitStatus, fit_lognormal, limit, probability
from pounding_sweep.analysis.scenarios import (
    described,
    finished,
    law_keys,
    need_dims,
    need_variables,
    pounding_only,
    scenarios_only,
    touched,
    trusted,
    values,
)
from pounding_sweep.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

#: Intensities at which curves are given, where none are.
LEVELS = 60
#: Resamples without a fit or a limit of one, as a share, above which the bootstrap gives no interval.
MOST_LEFT_OUT = 0.1
#: Axes along which scenarios are trials of one thing.
TRIALS = ("record", "scale")
#: How intervals are found.
INTERVALS = ("information", "bootstrap")
#: Ends of an interval.
BOUNDS = ("lower", "upper")


def fragility(
    cube: xr.Dataset,
    event: str = "touch",
    level: float | None = None,
    *,
    intensity: str | xr.DataArray = "pga",
    confidence: float = 0.95,
    resamples: int = 200,
    seed: int = 0,
    levels: Sequence[float] | None = None,
) -> xr.Dataset:
    """Fit the probability of an event against intensity.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with the axes ``record`` or ``scale``, or both: each record at each scale
        is one trial. Everything else is fitted apart.
    event : str
        A key of `pounding_sweep.analysis.events.EVENTS`.
    level : float, optional
        What must be exceeded, in the event's unit; needed by all but "touch".
    intensity : str or DataArray
        As for `pounding_sweep.analysis.intensity.intensity_of`.
    confidence : float
        Of the intervals, in (0, 1).
    resamples : int
        Of the bootstrap over records; 0 for none.
    seed : int
        Of the bootstrap.
    levels : sequence of float, optional
        Intensities at which curves are given; by default `LEVELS` of them, up to the
        largest of the cube.

    Returns
    -------
    xarray.Dataset
        On the cube's other axes (without the law "none" where the event is a pair's) and
        ``pair`` or ``building``: ``fit_status``; ``median`` (in the intensity's unit) and
        ``dispersion`` of the lognormal; their intervals on ``interval`` and ``bound``;
        ``median_between`` (bound) where there is no fit; ``trials``, ``happened_count`` and
        ``left_out`` (scenarios that are not ok); ``bootstrap_without_fit``, the share of
        resamples that have no fit. On ``intensity``: ``probability`` and, by the bootstrap,
        ``probability_interval``. Trial by trial: ``happened`` and ``trial_intensity``.

    Raises
    ------
    InputError
        The event, level or confidence is not valid, or the cube lacks what they need.

    Notes
    -----
    The information matrix takes all trials for independent. Those of one record at many
    scales are not, so that its interval is too narrow there; the bootstrap draws whole
    records and allows for it. It needs two records. Of few, many resamples have no fit
    because weaker and stronger motions are separated, or because all or none did it:
    they count with what a fit tends to there (see `pounding_sweep.analysis.lognormal.limit`),
    and ``bootstrap_without_fit`` tells their share. Where an end of the median's interval
    is infinite or zero, it is missing.

    Examples
    --------
    >>> import xarray as xr
    >>> count = (("record", "pair"), [[0.0], [0.0], [1.0], [0.0], [2.0], [1.0]])
    >>> pga = ("record", [1.0, 2.0, 2.5, 3.0, 3.5, 4.0])
    >>> axes = {"record": list("abcdef"), "record_pga": pga, "pair": ["left-right"]}
    >>> found = fragility(xr.Dataset({"impact_count": count}, axes), resamples=0)
    >>> round(found["median"].item(), 2), sentence(found.squeeze())
    (2.67, 'fitted')
    """
    import xarray as xr

    about = get_event(event, level)
    cube = scenarios_only(cube)
    _check(cube, confidence, resamples)
    found, ok = _happened(cube, about, level)
    strength = intensity_of(cube, intensity)
    for dim in TRIALS:
        found, ok, strength = (part if dim in part.dims else part.expand_dims(dim) for part in (found, ok, strength))
    found, strength = found.transpose(..., *TRIALS), strength.transpose(*TRIALS)
    table, x = found.values, np.asarray(strength.values, dtype=float)
    at = _levels(levels, x)
    draws = _draws(len(x), resamples, seed)
    places = {place: table[place].tobytes() for place in np.ndindex(table.shape[:-2])}
    alike = {key: place for place, key in places.items()}  # many cells are: some laws ignore some axes
    fits = {key: _cell(table[place], x, at, draws, confidence) for key, place in alike.items()}

    kept = found.isel(dict.fromkeys(TRIALS, 0), drop=True)
    units, name, words = strength.attrs["units"], strength.attrs["long_name"], about.words(level)
    coords: dict[str, xr.DataArray] = {str(k): c for k, c in kept.coords.items() if k in kept.dims or not c.dims}
    for dim, labels, more in (
        ("interval", list(INTERVALS), {"long_name": "how the interval was found"}),
        ("bound", list(BOUNDS), {"long_name": f"end of the {confidence:.0%} interval"}),
        ("intensity", at, {"units": units, "long_name": name}),
    ):
        coords[dim] = xr.DataArray(labels, dims=dim, attrs=more)
    variables = {}
    for variable, (dims, unit, text) in _VARIABLES.items():
        stacked = np.array([getattr(fits[key], variable) for key in places.values()])
        attributes = {"units": units if unit is None else unit, "long_name": text.format(event=words)}
        variables[variable] = ((*kept.dims, *dims), stacked.reshape((*kept.shape, *stacked.shape[1:])), attributes)
    dataset = xr.Dataset(variables, coords=coords)
    dataset["fit_status"].attrs |= {
        "flag_values": np.array([int(s) for s in FIT_STATUS], np.int8),
        "flag_meanings": " ".join(s.label for s in FIT_STATUS),
    }
    left_out = (~ok).sum(TRIALS).astype(np.int64)
    dataset["left_out"] = _plain(left_out, "1", "scenarios left out: their status is not ok")
    dataset["happened"] = _plain(found, "1", f"1 where {words}, 0 where not")
    dataset["trial_intensity"] = _plain(strength, units, name)
    about_it = {"event": about.key, "event_in_words": words, "confidence": confidence, "seed": seed}
    return finished(dataset, cube, "fragility", **about_it)


def sentence(dataset: xr.Dataset) -> str:
    """Say in words what the fit of one cell is, or why there is none.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `fragility`, with one value selected on every axis of the fits.
    """
    status = FIT_STATUS[int(dataset["fit_status"])]
    low, high = (float(value) for value in dataset["median_between"])
    return status.words(low, high, str(dataset["median"].attrs["units"]))


#: Results of a fit: dimensions of their own, unit (None: the intensity's), and what they are.
_VARIABLES: dict[str, tuple[tuple[str, ...], str | None, str]] = {
    "fit_status": ((), "1", "whether there is a fit"),
    "median": ((), None, "intensity at which it is as likely as not that {event}"),
    "dispersion": ((), "1", "standard deviation of the logarithm of that intensity"),
    "median_interval": (("interval", "bound"), None, "confidence interval of the median"),
    "dispersion_interval": (("interval", "bound"), "1", "confidence interval of the dispersion"),
    "median_between": (("bound",), None, "what is known of the median where there is no fit"),
    "trials": ((), "1", "scenarios that count"),
    "happened_count": ((), "1", "scenarios in which {event}"),
    "bootstrap_without_fit": ((), "1", "share of the resamples that have no fit"),
    "probability": (("intensity",), "1", "probability that {event}"),
    "probability_interval": (("bound", "intensity"), "1", "confidence interval of the probability, by the bootstrap"),
}


@dataclass(frozen=True)
class _Cell:
    """The fit of one cell; see `_VARIABLES`."""

    fit_status: np.int8
    median: float
    dispersion: float
    median_interval: np.ndarray
    dispersion_interval: np.ndarray
    median_between: np.ndarray
    trials: int
    happened_count: int
    bootstrap_without_fit: float
    probability: np.ndarray
    probability_interval: np.ndarray


def _cell(table: np.ndarray, x: np.ndarray, at: np.ndarray, draws: np.ndarray, confidence: float) -> _Cell:
    """Fit one cell; all of shape (record, scale), `draws` of shape (resamples, record): how often each is drawn."""
    there = np.isfinite(table)
    trials, flags = x[there], table[there] > 0.0
    owner = np.broadcast_to(np.arange(len(x))[:, None], x.shape)[there]
    fit = fit_lognormal(trials, flags)
    ends = np.array([-1.0, 1.0])
    medians, dispersions = np.full((2, 2), np.nan), np.full((2, 2), np.nan)
    curves, without = np.full((2, len(at)), np.nan), np.nan
    if fit.status == FitStatus.FITTED:
        from scipy.special import ndtri

        wide = ndtri(0.5 + confidence / 2.0) * np.sqrt(np.diag(fit.covariance))
        medians[0] = fit.median * np.exp(ends * wide[0])
        dispersions[0] = fit.dispersion * np.exp(ends * wide[1])
        if len(draws):
            fits = [fit_lognormal(trials, flags, draw[owner]) for draw in draws]
            without = float(np.mean([one.status != FitStatus.FITTED for one in fits]))
            counted = [one for one in map(limit, fits) if one.status == FitStatus.FITTED]
            if len(counted) >= (1.0 - MOST_LEFT_OUT) * len(draws):
                tails = _tails([one.median for one in counted], confidence)
                medians[1] = np.where(np.isfinite(tails) & (tails > 0.0), tails, np.nan)
                dispersions[1] = _tails([one.dispersion for one in counted if one.dispersion >= 0.0], confidence)
                curves = _tails([probability(one, at) for one in counted], confidence)
    return _Cell(
        np.int8(fit.status),
        fit.median,
        fit.dispersion,
        medians,
        dispersions,
        np.array([fit.low, fit.high]),
        int(there.sum()),
        int(flags.sum()),
        without,
        probability(fit, at),
        curves,
    )


def _tails(found: Sequence[float] | Sequence[np.ndarray], confidence: float) -> np.ndarray:
    """Return the ends of a percentile interval; some of the values may be infinite, so none lies between two."""
    ends = [
        np.quantile(found, 0.5 - confidence / 2.0, axis=0, method="lower"),
        np.quantile(found, 0.5 + confidence / 2.0, axis=0, method="higher"),
    ]
    return np.array(ends)


def _check(cube: xr.Dataset, confidence: float, resamples: int) -> None:
    if not set(TRIALS) & set(cube.dims):
        need_dims(cube, "a fragility", TRIALS[:1])
    if all(cube.sizes.get(dim, 1) < 2 for dim in TRIALS):
        msg = (
            "a fragility needs ground motions of several intensities, and this cube has one record at one scale; run "
            "a sweep over several records or scales"
        )
        raise InputError(msg)
    if not 0.0 < confidence < 1.0:
        msg = f"confidence is {confidence!r}; it must be between 0 and 1, 0.95 for instance"
        raise InputError(msg)
    if resamples < 0:
        msg = f"resamples is {resamples!r}; it must be 0 (no bootstrap) or more"
        raise InputError(msg)


def _happened(cube: xr.Dataset, event: Event, level: float | None) -> tuple[xr.DataArray, xr.DataArray]:
    """Return 1, 0 or missing for each scenario, along the event's pair or building; and which scenarios are ok."""
    what = f"the fragility of {event.key!r}"
    if event.per == "pair":
        if "pair" not in cube.coords or law_keys(cube) == ["none"]:
            msg = f"{what} needs a pair of neighbours and a law with contact, which this cube lacks; sweep over such"
            raise InputError(msg)
        cube = pounding_only(cube)
    if event.variable and level is not None:
        need_variables(cube, what, [event.variable])
        given = values(cube, event.variable)
        found = (given > level).astype(np.float64).where(given.notnull())
    else:
        found = touched(cube, what)
    found = found.max("storey") if "storey" in found.dims else found
    outer = found.isel({event.per: 0}, drop=True, missing_dims="ignore")
    return found, trusted(cube).broadcast_like(outer)


def _levels(levels: Sequence[float] | None, x: np.ndarray) -> np.ndarray:
    if levels is None:
        highest = float(x.max())
        if highest <= 0.0:
            msg = "every ground motion of this cube has intensity 0; run the sweep with scales above zero"
            raise InputError(msg)
        return np.linspace(highest / LEVELS, highest, LEVELS)
    found = np.asarray(levels, dtype=float)
    if found.ndim != 1 or not found.size or not (np.isfinite(found) & (found > 0.0)).all():
        msg = f"levels are {levels!r}; give one or more intensities above zero"
        raise InputError(msg)
    return found


def _draws(records: int, resamples: int, seed: int) -> np.ndarray:
    """How often each record is drawn in each resample, the same for every cell; none of a single record."""
    if records < 2 or not resamples:
        return np.empty((0, records))
    equal = np.full(records, 1.0 / records)
    return np.random.default_rng(seed).multinomial(records, equal, size=resamples).astype(np.float64)


def _plain(part: xr.DataArray, units: str, text: str) -> xr.DataArray:
    return described(part.reset_coords(drop=True), units, text)
