"""Fragility: the probability that something happens, against the intensity of the ground motion, as a lognormal.

P(event | x) = Phi(ln(x / median) / dispersion), by maximum likelihood (Baker 2015, Earthquake Spectra 31(1)): in a + b
ln x the likelihood is log-concave, with one maximum or none at any finite value. Curves may share one dispersion, and
then never cross (Shinozuka, Feng, Lee & Naganuma 2000, J. Eng. Mech. 126(12)).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from pounding_sweep.analysis import comparisons, scenarios
from pounding_sweep.analysis.comparisons import Row, check_needs, comparison, get_event, over_text, plain_rows
from pounding_sweep.analysis.hazard import Hazard, hazard_of, log_normal_share
from pounding_sweep.analysis.rebuild import intensity_axis, intensity_of, periods_of
from pounding_sweep.analysis.scenarios import described, labelled, numbers_in, pounding_only, scenario_dims, trusted
from pounding_sweep.base.errors import InputError, PoundingSweepError, check_choice
from pounding_sweep.base.files import FilePath, read_data
from pounding_sweep.base.text import counts_text

#: Intensities that differ by less than this share are one.
SAME = 1e-9
#: A median farther than by this factor outside the intensities tried is no result.
FARTHEST = 10.0
#: A dispersion above this is no result: the probability then hardly changes over any intensities that are tried.
WIDEST = 5.0
#: Least dispersion of the curves that intervals are made of, points of their grids, each refined from the one before,
#: and by how much the logarithm of a likelihood that does not count is lower than the largest.
SHARPEST, _GRIDS, _UNLIKELY = 1e-3, (24, 24, 24, 24, 64), 8.0
#: Intensities at which curves are given, where none are: so many at equal steps, and of their logarithms.
LEVELS = 60
#: Curves are said to cross where the probability is farther from 0 and 1 than this.
SEEN = 1e-3
#: Ends of an interval.
BOUNDS = ("lower", "upper")


class FitStatus(IntEnum):
    """Whether trials have a fit, or why not."""

    FITTED = 0
    NO_DATA = 1
    NEVER = 2
    ALWAYS = 3
    SEPARATED = 4
    ONE_LEVEL = 5
    NOT_RISING = 6
    UNKNOWN = 7


#: What the statuses mean, by their values.
MEANINGS = (
    "fitted",
    "no trials: no scenario is ok, or nothing of the kind exists there",
    "never happened, even under the strongest motion tried",
    "always happened, even under the weakest motion tried",
    "weaker and stronger motions do not overlap, so there is no dispersion",
    "all trials have one intensity, so there is no curve",
    "does not get more likely as the intensity rises, or hardly so over the intensities tried: no "
    "lognormal describes it",
    "never happened in the scenarios that count, and stronger motions are left out: the statuses say why",
)
#: Why there is no band: an interval whose ends differ by more than a factor is of no use, or there is none.
WIDE = 10.0
TOO_WIDE = f"no band: the confidence interval of the median or dispersion spans more than a factor of {WIDE:g}"
NO_INTERVAL = "no band: one record alone, or records that too often go back and forth as the intensity rises"
#: Records from which intervals are dependable.
ENOUGH = 20


class LognormalFit(NamedTuple):
    """A fitted lognormal, or why there is none."""

    status: FitStatus  # whether there is one
    #: logarithm of the median and dispersion, of separated trials what they tend to; NaN where there is no fit
    log_median: float = np.nan
    dispersion: float = np.nan
    low: float = np.nan  # what is known of the median without a fit; NaN where nothing is
    high: float = np.nan


def fit_lognormals(trials: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[LognormalFit]:
    """Fit lognormals to sets of trials (intensities, whether it happened), of one dispersion where there are more."""
    usable = [(merged(x[x > 0.0]), np.asarray(happened, dtype=bool)[x > 0.0]) for x, happened in trials]
    fits = [_fit_alone(*one) for one in usable]
    together = [i for i, fit in enumerate(fits) if fit.status in (FitStatus.FITTED, FitStatus.SEPARATED)]
    if len(together) > 1 and any(fit.status == FitStatus.FITTED for fit in fits):
        for i, fit in zip(together, _likeliest([usable[i] for i in together]), strict=True):
            fits[i] = fit
    return fits


def merged(x: np.ndarray) -> np.ndarray:
    """Return values of which those that differ by rounding alone are equal: records scaled to one intensity."""
    order = np.argsort(x)
    ordered = x[order]
    starts = np.append(True, ordered[1:] > ordered[:-1] * (1.0 + SAME))[: len(x)]
    result = np.empty_like(x)
    result[order] = ordered[np.flatnonzero(starts)][np.cumsum(starts) - 1]
    return result


def _fit_alone(x: np.ndarray, y: np.ndarray) -> LognormalFit:
    """Fit one set of trials, all above zero intensity."""
    if not x.size:
        return LognormalFit(FitStatus.NO_DATA)
    if not y.any():
        return LognormalFit(FitStatus.NEVER, low=float(x.max()))
    if y.all():
        return LognormalFit(FitStatus.ALWAYS, high=float(x.min()))
    low, high = float(x[~y].max()), float(x[y].min())
    if low > high:
        return LognormalFit(FitStatus.NOT_RISING) if x[y].max() <= x[~y].min() else _likeliest([(x, y)])[0]
    limit = 0.5 * math.log(low * high)
    if low == high:  # the share there tells on which side of it the median is
        share, at = y[x == low].mean(), low
        low = at if share <= 0.5 else max(x[x < at], default=np.nan)
        high = at if share >= 0.5 else min(x[x > at], default=np.nan)
    if x.min() == x.max():
        return LognormalFit(FitStatus.ONE_LEVEL, low=low, high=high)
    return LognormalFit(FitStatus.SEPARATED, limit, 0.0, low, high)


def _likeliest(trials: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[LognormalFit]:
    """Find where the slope of the likelihood is zero, which it is at one place: its maximum."""
    # each set of trials has a median, and all one dispersion
    from scipy.optimize import root
    from scipy.special import log_ndtr

    log_x, y = np.log(np.concatenate([x for x, _ in trials])), np.concatenate([y for _, y in trials])
    middle, spread = float(log_x.mean()), float(log_x.std())
    members = np.repeat(np.eye(len(trials)), [len(x) for x, _ in trials], axis=0)
    columns = np.where(y, 1.0, -1.0)[:, None] * np.column_stack([members, (log_x - middle) / spread])

    def slope(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        t = columns @ p
        ratio = np.exp(-0.5 * t**2 - 0.5 * np.log(2.0 * np.pi) - log_ndtr(t))  # both underflow far out
        return -ratio @ columns, (columns * (ratio * (ratio + t))[:, None]).T @ columns

    solution = root(slope, np.append(np.zeros(len(trials)), 1.0), jac=True, method="hybr")
    if np.abs(solution.fun).max() > 1e-6 * len(y):  # its own verdict fails where the root is met to the last digit
        raise PoundingSweepError(f"the maximum of the likelihood of {len(y)} trials was not found: {solution.message}")
    *offsets, b = (float(p) for p in solution.x)
    fits = []
    for (x, _), a in zip(trials, offsets, strict=True):
        log_median = middle - spread * a / b if spread <= WIDEST * b else math.inf
        inside = np.log(x.min() / FARTHEST) <= log_median <= np.log(x.max() * FARTHEST)
        fits.append(
            LognormalFit(FitStatus.FITTED, log_median, spread / b) if inside else LognormalFit(FitStatus.NOT_RISING)
        )
    return fits


def record_capacities(happened: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return logarithms of the intensities between which a record begins, as the fewest of its trials contradict."""
    levels, number = np.unique(merged(x), return_inverse=True)
    yes, no = (np.bincount(number, part, len(levels)) for part in (happened, ~happened))
    contradict = np.append(0.0, yes.cumsum()) + np.append(no[::-1].cumsum()[::-1], 0.0)
    best, ends = np.flatnonzero(contradict == contradict.min()), np.array([-np.inf, *np.log(levels), np.inf])
    return ends[[best[0], best[-1] + 1]]


def plausible_curves(capacities: Sequence[np.ndarray]) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return logarithms of medians, dispersions and how plausible they are together, of curves of one dispersion.

    Each curve has the capacities of its records, shape (record, 2). Curves of the same records tell no more of the
    dispersion together than one: the mean of their likelihoods counts.
    """
    sets = [np.unique(part, axis=0, return_counts=True) for part in capacities]
    finite = [part[np.isfinite(part)] for part in capacities]
    medians = [(part.min() - np.log(FARTHEST), part.max() + np.log(FARTHEST)) for part in finite]
    spreads = np.log(SHARPEST), np.log(WIDEST)
    for step, size in enumerate(_GRIDS):
        axis, grids, seen = np.linspace(*spreads, size), [np.linspace(*ends, size) for ends in medians], []
        for grid, (cells, count) in zip(grids, sets, strict=True):
            z = (cells - grid[:, None, None, None]) / np.exp(axis)[:, None, None]
            seen.append(log_normal_share(z[..., 0], z[..., 1]) @ count)
        own = [np.logaddexp.reduce(part) for part in seen]  # of the dispersion
        logs = [part - alone + np.mean(own, axis=0) for part, alone in zip(seen, own, strict=True)]
        inside = [part > part.max() - _UNLIKELY for part in logs]
        medians = [_around(grid, part.any(axis=1)) for grid, part in zip(grids, inside, strict=True)]
        if step > 1:  # medians between points of a coarse grid seem to disperse
            spreads = _around(axis, np.any([part.any(axis=0) for part in inside], axis=0))
    weights = [np.exp(part - part.max()) for part in logs]
    return [(grid, np.exp(axis), part / part.sum()) for grid, part in zip(grids, weights, strict=True)]


def _around(grid: np.ndarray, inside: np.ndarray) -> tuple[float, float]:
    """Return the points of a grid just outside of some of it."""
    places = np.flatnonzero(inside)
    return float(grid[max(places[0] - 1, 0)]), float(grid[min(places[-1] + 1, len(grid) - 1)])


def intervals_of(
    curves: tuple[np.ndarray, np.ndarray, np.ndarray], at: np.ndarray, confidence: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return intervals of the median, the dispersion and the probability at n intensities: (2,), (2,) and (2, n)."""
    from scipy.special import ndtr

    medians, dispersions, weights = curves
    ends = np.array([0.5 - 0.5 * confidence, 0.5 + 0.5 * confidence])
    middle, spread = (
        np.interp(ends, part.cumsum() - 0.5 * part, grid)
        for grid, part in ((medians, weights.sum(axis=1)), (np.log(dispersions), weights.sum(axis=0)))
    )
    rows, columns = np.nonzero(weights > np.exp(-_UNLIKELY) * weights.max())
    # every curve rises, and so do fractiles of them
    z = (np.log(at)[:, None] - medians[rows]) / dispersions[columns]
    order = np.argsort(z, axis=1)
    below = weights[rows, columns][order].cumsum(axis=1)
    places = [np.take_along_axis(order, (below < end * below[:, -1:]).sum(axis=1)[:, None], axis=1) for end in ends]
    return np.exp(middle), np.exp(spread), ndtr([np.take_along_axis(z, place, axis=1)[:, 0] for place in places])


def equal_axes(result: xr.Dataset) -> list[str]:
    """Return the axes along which trial by trial the same happened in all scenarios, so that all fits are equal."""
    part = result["happened"].fillna(-1.0)
    return [dim for dim in scenario_dims(result["median"]) if part.sizes[dim] > 1 and (part == part[{dim: 0}]).all()]


def fit_rows(result: xr.Dataset) -> list[Row]:
    """Return a row per fit of a fragility, one for all values of the axes that it does not depend on."""
    names = ["trials", "happened_count", "median", "dispersion"]
    if result["median_interval"].notnull().any():
        names += ["median_interval", "dispersion_interval"]
    table = result[names].rename(happened_count="happened")
    for q in result["quantile"].values.tolist() if "fractile" in result else []:
        table[f"at {q:g}"] = result["fractile"].sel(quantile=q, drop=True)
    if "annual_rate" in result:
        table["per year"] = result["annual_rate"]
    table = table.assign(fit=result["fit_status"], between=result["median_between"]).reset_coords(drop=True)
    table = table.isel(dict.fromkeys(equal_axes(result), 0), drop=True)
    units, dims = str(result["median"].attrs["units"]), scenario_dims(table["median"])
    rows = plain_rows(table.transpose(*dims, "pair", "building", ..., missing_dims="ignore"))
    for row in rows:
        wide = any((row.get(f"{name}_upper") or 0.0) > WIDE * (row.get(f"{name}_lower") or 0.0) for name in names[2:4])
        between = (np.nan if end is None else end for end in (row.pop("between_lower"), row.pop("between_upper")))
        fit = {"fit_status": row.pop("fit"), "median_between": between, "median": result["median"]}
        row |= {"units": units, "over": str(result.attrs["trials_of"]), "fit": sentence(fit) + f"; {TOO_WIDE}" * wide}
    return rows


def check_site(
    site: Hazard, cube: xr.Dataset, intensity: str | xr.DataArray | None, strength: xr.DataArray
) -> dict[str, Any]:
    """Return what is said of a hazard, which must be of the intensity that is asked for."""
    units, measure = strength.attrs["units"], site.measure
    if not isinstance(intensity, xr.DataArray):
        intensity = intensity or intensity_axis(cube)
        same = measure in ("", intensity)
        if measure.startswith("sa") and intensity.startswith("sa") and not same:  # perhaps called by another period
            periods = list(periods_of(cube, intensity).values())
            same = measure == "sa" or np.allclose(periods, float(measure[3:-1]), rtol=0.01)
        if not same:
            name = "sa(PERIOD)" if measure == "sa" else measure
            raise InputError(
                f"the hazard {site.source} is of {measure} by its heading, the intensity is {intensity}; "
                f"name the curve's own intensity (--intensity {name!r}), or give a curve of {intensity}"
            )
    if site.units not in ("", units):
        raise InputError(
            f"the hazard {site.source} is of {site.units}, the intensity in {units}; give one of that intensity"
        )
    return {"hazard": site.source, "intensity": f"{strength.attrs['long_name']} ({units})"}


@comparison
def fragility(
    cube: xr.Dataset,
    event: str = "touch",
    level: str | float | None = None,
    *,
    intensity: str | xr.DataArray | None = None,
    confidence: float | None = 0.95,
    levels: Sequence[float] | None = None,
    quantiles: Sequence[float] = (),
    one_dispersion: Sequence[str] = (),
    hazard: Hazard | FilePath | None = None,
    records: Any = None,
    folders: Any = None,
) -> xr.Dataset:
    """Fit the probability of an event against intensity.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with the axes ``record`` or ``scale``, or both: each record at each scale is one trial. Everything else
        is fitted apart.
    event : str
        A key of `pounding_sweep.analysis.comparisons.EVENTS`.
    level : float or str, optional
        What must be exceeded, in the event's unit; needed by all but "touch" and "collapse".
    intensity, records, folders : optional
        As for `pounding_sweep.analysis.rebuild.intensity_of`.
    confidence : float or None
        Of the intervals, in (0, 1); None for no intervals, which take a fit per record.
    levels : sequence of float, optional
        Intensities at which curves are given; by default about 2 `LEVELS` of them, up to the largest of the cube.
    quantiles : sequence of float
        Probabilities, in (0, 1), at which the intensity is given.
    one_dispersion : sequence of str
        Axes, such as "gap", along which all curves have one dispersion, so that they never cross.
    hazard : Hazard, str or path, optional
        Of the intensity (see `pounding_sweep.analysis.hazard.hazard_of`), for the annual rate of the event.

    Returns
    -------
    xarray.Dataset
        On the cube's other axes and ``pair`` or ``building``: ``fit_status``; ``median`` (in the intensity's unit) and
        ``dispersion``, with intervals on ``bound``; ``median_between`` (bound) without a fit; ``trials``,
        ``happened_count`` and ``left_out`` (not ok); ``fractile`` (quantile), intensities at the `quantiles`; with a
        hazard ``annual_rate`` (per year); on ``intensity`` ``probability`` and ``probability_interval``; trial by
        trial ``happened`` and ``trial_intensity``.

    Raises
    ------
    InputError
        An argument is not valid, or the cube lacks what it needs.

    Notes
    -----
    How intervals are had, and where they are missing: "Fragility" in ``docs/comparisons.md``.

    Examples
    --------
    >>> import xarray as xr
    >>> count = (("record", "pair"), [[0.0], [0.0], [1.0], [0.0], [2.0], [1.0]])
    >>> pga = ("record", [1.0, 2.0, 2.5, 3.0, 3.5, 4.0])
    >>> axes = {"record": list("abcdef"), "record_pga": pga, "pair": ["left-right"]}
    >>> curve = fragility(xr.Dataset({"impact_count": count}, axes), confidence=None)
    >>> round(curve["median"].item(), 2), sentence(curve.squeeze())
    (2.67, 'fitted')
    """
    from scipy.special import ndtri

    about, level = get_event(event, level)
    what = f"the fragility of {event!r}"
    if len(quantiles):
        numbers_in("(0, 1)", quantiles, "quantiles of a fragility")
    if about.per == "pair":
        check_needs(cube, what, pairs=True, laws=1)
        cube = pounding_only(cube)
    strength = intensity_of(cube, intensity, records=records, folders=folders)
    trials = ["record", next((dim for dim in comparisons.MOTION_DIMS[1:] if dim in cube.dims), "scale")]
    cube = cube.expand_dims([dim for dim in trials if dim not in cube.dims])
    strength = strength.expand_dims([dim for dim in trials if dim not in strength.dims]).transpose(*trials)
    happened = scenarios.exceeds(cube, what, about.variable, level).transpose(..., *trials)
    dims = happened.dims[:-2]
    for axis in one_dispersion:
        check_choice("axis of one dispersion", axis, dims)
    x = np.asarray(strength.values, dtype=float)
    if levels is None and x.max() <= 0.0:
        raise InputError("every ground motion of this cube has intensity 0; run the sweep with scales above zero")
    units, name = strength.attrs["units"], strength.attrs["long_name"]
    words = about.in_words(level)
    at = np.union1d(*(space(x.max() / LEVELS, x.max(), LEVELS)[:-1] for space in (np.linspace, np.geomspace)))
    at = np.append(at, x.max())
    if levels is not None:
        at = np.asarray(levels)
    cache: dict[bytes, tuple[np.ndarray, ...]] = {}  # many tables are the same: some laws ignore some axes

    def fit(tables: np.ndarray) -> tuple[np.ndarray, ...]:
        key, sizes = tables.tobytes(), tables.shape[: len(one_dispersion)]
        if key not in cache:
            parts = zip(*_fits(tables.reshape(-1, *x.shape), x, at, confidence), strict=True)
            cache[key] = tuple(np.reshape(part, (*sizes, *np.shape(part)[1:])) for part in parts)
        return cache[key]

    parts = xr.apply_ufunc(
        fit,
        happened,
        input_core_dims=[[*one_dispersion, *trials]],
        output_core_dims=[[*one_dispersion, *inner] for inner, _, _ in _VARIABLES.values()],
        vectorize=True,
    )
    coords = {
        **{dim: cube[dim] for dim in one_dispersion},
        "bound": labelled("bound", BOUNDS, "end of the confidence interval"),
        "intensity": labelled("intensity", at, name, units),
    }
    variables = {
        variable: described(part, unit or units, text.format(event=words))
        for (variable, (_, unit, text)), part in zip(_VARIABLES.items(), parts, strict=True)
    }
    dataset = xr.Dataset(variables, coords).transpose(*dims, ...)
    dataset["fit_status"].attrs |= {
        "flag_values": np.array(FitStatus, np.int8),
        "flag_meanings": " ".join(status.name.lower() for status in FitStatus),
    }
    left_out = (~trusted(cube)).broadcast_like(happened.isel({about.per: 0}, missing_dims="ignore")).sum(trials)
    dataset["left_out"] = described(left_out, "1", "scenarios left out: their status is not ok", bare=True)
    dataset["happened"] = described(happened, "1", f"1 where {words}, 0 where not", bare=True)
    dataset["trial_intensity"] = described(strength, units, name, bare=True)
    if len(quantiles):
        index = labelled("quantile", quantiles, f"probability that {words}", "1")
        away = np.exp(dataset["dispersion"] * index.copy(data=ndtri(index.values)))
        dataset["fractile"] = described(dataset["median"] * away, units, f"intensity at that probability that {words}")
    about_site: dict[str, Any] = {"intensity": f"{name} ({units})"}
    if hazard is not None:
        site = hazard_of(hazard)
        about_site |= check_site(site, cube, intensity, strength)
        rate = site.touching(dataset["median"].values, dataset["dispersion"].values)
        dataset["annual_rate"] = described(dataset["median"].copy(data=rate), "1", f"times a year that {words}")
    few = f"{counts_text({'record': len(x)}, '')}: give {ENOUGH} or more" if len(x) < ENOUGH else ""
    optional = {
        "advice": few,
        "equal_along": ", ".join(equal_axes(dataset)),
        "one_dispersion": ", ".join(one_dispersion),
        "curves_cross": crossed(dataset),
    }
    return dataset.assign_attrs(
        event=about.key,
        event_in_words=words,
        trials_of=over_text(dict(zip(trials, x.shape, strict=True))),
        **{key: value for key, value in (about_site | optional | {"confidence": confidence}).items() if value},
    )


def sentence(fit: xr.Dataset | Mapping[str, Any]) -> str:
    """Say in words what the fit of one cell is, or why there is none, and what is known of the median."""
    words = median_words(fit)
    return MEANINGS[int(fit["fit_status"])] + (f"; the median is {words}" if words else "")


def median_words(fit: xr.Dataset | Mapping[str, Any]) -> str:
    """Say what is known of a median without a fit; "" if nothing is."""
    low, high = (float(end) for end in fit["median_between"])
    units = fit["median"].attrs["units"]
    if low < high:
        return f"between {low:.4g} and {high:.4g} {units}"
    words = "about" if low == high else "below" if np.isnan(low) else "above"
    return "" if np.isnan(low) and np.isnan(high) else f"{words} {np.nanmax([low, high]):.4g} {units}"


#: Results of a fit: dimensions of their own, unit ("": the intensity's), and what they are.
_VARIABLES: dict[str, tuple[list[str], str, str]] = read_data("comparisons.toml")["fit"]


def _fits(tables: np.ndarray, x: np.ndarray, at: np.ndarray, confidence: float | None) -> list[tuple[Any, ...]]:
    """Fit curves that share their dispersion, or one by itself, all of shape (record, scale); returns `_VARIABLES`."""
    from scipy.special import ndtr

    tried = np.isfinite(tables)
    fits = fit_lognormals([(x[part], table[part] > 0.0) for table, part in zip(tables, tried, strict=True)])
    for i, fit in enumerate(fits):
        if fit.status == FitStatus.NEVER and (x[~tried[i]] > fit.low).any():
            fits[i] = LognormalFit(FitStatus.UNKNOWN)
    fitted = [i for i, fit in enumerate(fits) if fit.status == FitStatus.FITTED and confidence]
    # of each curve, the records that have motions
    rows = [
        [(tables[i, r, ok] > 0.0, x[r, ok]) for r, ok in enumerate(tried[i] & (x > 0.0)) if ok.any()] for i in fitted
    ]
    plausible = plausible_curves([np.array([record_capacities(*row) for row in part]) for part in rows]) if rows else []
    intervals = {
        i: intervals_of(curves, at, confidence or np.nan)
        for i, part, curves in zip(fitted, rows, plausible, strict=True)
        if len(part) > 1
    }
    results = []
    for i, (table, fit) in enumerate(zip(tables, fits, strict=True)):
        values = (np.exp(fit.log_median), fit.dispersion) if fit.status == FitStatus.FITTED else (np.nan, np.nan)
        parts = intervals.get(i)
        if parts is None or any(not low <= value <= high for value, (low, high) in zip(values, parts, strict=False)):
            parts = np.full(2, np.nan), np.full(2, np.nan), np.full((2, len(at)), np.nan)
        counts, curve = (tried[i].sum(), (table > 0.0).sum()), ndtr(np.log(at / values[0]) / values[1])
        results.append((np.int8(fit.status), *values, *parts[:2], fit[3:], *counts, curve, parts[2]))
    return results


def crossed(dataset: xr.Dataset) -> str:
    """Say where curves of neighbouring values first cross at the intensities given; "" where none do."""
    from scipy.special import ndtr

    at, fits = dataset["intensity"].values, dataset[["median", "dispersion"]]
    for axis in (str(dim) for dim in fits["median"].dims if dim not in ("law", "pair", "building")):
        median, dispersion = (np.moveaxis(part.transpose(axis, ...).values, 0, -1) for part in fits.values())
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):  # of one dispersion, or hardly another
            away = np.diff(np.log(median)) / -np.diff(dispersion)
            where, share = median[..., :-1] * np.exp(dispersion[..., :-1] * away), ndtr(away)
        seen = (at.min() <= where) & (where <= at.max()) & (np.minimum(share, 1.0 - share) > SEEN)
        for place in map(tuple, np.argwhere(seen)[:1]):
            labels = " and ".join(f"{label:g}" for label in dataset[axis].values[place[-1] :][:2].tolist())
            place_words = f"at {where[place]:.3g} {dataset['median'].attrs['units']}, probability {share[place]:.2g}"
            return f"of {axis} {labels} {place_words}: their dispersions are fitted apart"
    return ""
