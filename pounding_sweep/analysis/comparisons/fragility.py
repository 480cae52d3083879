"""Fragility: the probability that something happens, against the intensity of the ground motion."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, product
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.comparisons import MOTION_DIMS, Row, comparison, over_text
from pounding_sweep.analysis.events import Event, get_event
from pounding_sweep.analysis.intensity import intensity_of
from pounding_sweep.analysis.lognormal import (
    FIT_STATUS,
    FitStatus,
    LognormalFit,
    crossing,
    fit_lognormal,
    fit_with_one_dispersion,
    jackknife,
    probability,
)
from pounding_sweep.analysis.scenarios import (
    described,
    finished,
    labelled,
    law_keys,
    need_dims,
    need_variables,
    pounding_only,
    scenario_dims,
    scenarios_only,
    touched,
    trusted,
    values,
)
from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.base.tables import finite

#: Intensities at which curves are given, where none are.
LEVELS = 60
#: Axes along which scenarios are trials of one thing.
TRIALS = MOTION_DIMS
#: Curves are said to cross where the probability is farther from 0 and 1 than this.
SEEN = 1e-3
#: Ends of an interval.
BOUNDS = ("lower", "upper")


def fit_rows(result: xr.Dataset) -> list[Row]:
    """Return a row per fit of a fragility."""
    whole = result["fit_status"]
    dims = [dim for dim in (*scenario_dims(whole), "pair", "building") if dim in whole.dims]
    units = str(result["median"].attrs["units"])
    labels = [[finite(label) for label in result[dim].values.tolist()] for dim in dims]
    column = {str(name): result[name].transpose(*dims, ...).values for name in _FIT}
    given = np.isfinite(column["median_interval"]).any()
    rows = []
    for place in np.ndindex(tuple(map(len, labels))):
        row: Row = {dim: each[i] for dim, each, i in zip(dims, labels, place, strict=True)}
        row |= {"trials": int(column["trials"][place]), "happened": int(column["happened_count"][place])}
        row |= {name: finite(float(column[name][place])) for name in ("median", "dispersion")}
        for name, (i, bound) in product(("median", "dispersion") if given else (), enumerate(BOUNDS)):
            row[f"{name}_{bound}"] = finite(float(column[f"{name}_interval"][(*place, i)]))
        if "fractile" in result:
            at = result["fractile"].transpose(*dims, "quantile")
            for q, value in zip(at["quantile"].values.tolist(), at.values[place].tolist(), strict=True):
                row[f"at {q:g}"] = finite(value)
        low, high = column["median_between"][place].tolist()
        status = FIT_STATUS[int(column["fit_status"][place])]
        words = {"units": units, "over": str(result.attrs["trials_of"]), "fit": status.words(low, high, units)}
        rows.append(row | words)
    return rows


#: What the rows of a fragility are made of.
_FIT = (
    "fit_status",
    "median",
    "dispersion",
    "median_interval",
    "dispersion_interval",
    "median_between",
    "trials",
    "happened_count",
)


@comparison(
    "probability that a pair touches, or of another event, against intensity: a fitted lognormal",
    needs="pairs, a law with contact, and records or scales of several intensities",
    columns=("law", "gap", "pair"),
    variables=("median", "dispersion"),
    figure="fragility",
    arguments=("event", "level", "intensity", "quantiles", "one_dispersion", "folders"),
    summary={"confidence": None},
    rows=fit_rows,
)
def fragility(
    cube: xr.Dataset,
    event: str = "touch",
    level: float | None = None,
    *,
    intensity: str | xr.DataArray | None = None,
    confidence: float | None = 0.95,
    levels: Sequence[float] | None = None,
    quantiles: Sequence[float] = (),
    one_dispersion: Sequence[str] = (),
    records: Any = None,
    folders: Any = None,
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
    intensity, records, folders : optional
        As for `pounding_sweep.analysis.intensity.intensity_of`.
    confidence : float or None
        Of the intervals, in (0, 1); None for no intervals, which take a fit per record.
    levels : sequence of float, optional
        Intensities at which curves are given; by default `LEVELS` of them, up to the largest of the cube.
    quantiles : sequence of float
        Probabilities, in (0, 1), at which the intensity is given.
    one_dispersion : sequence of str
        Axes, such as "gap", along which all curves have one dispersion, so that they never cross; by default each
        curve has its own.

    Returns
    -------
    xarray.Dataset
        On the cube's other axes (without the law "none" where the event is a pair's) and
        ``pair`` or ``building``: ``fit_status``; ``median`` (in the intensity's unit) and
        ``dispersion`` of the lognormal; their intervals on ``bound``;
        ``median_between`` (bound) where there is no fit; ``trials``, ``happened_count`` and
        ``left_out`` (scenarios that are not ok); ``fractile`` (quantile), the intensities at the
        `quantiles`. On ``intensity``: ``probability`` and
        ``probability_interval`` (bound). Trial by trial: ``happened`` and ``trial_intensity``.

    Raises
    ------
    InputError
        The event, level or confidence is not valid, or the cube lacks what they need.

    Notes
    -----
    Intervals come from leaving out one record after the other with all its trials
    (see `pounding_sweep.analysis.lognormal.jackknife`): trials of one record at many scales are not independent.
    They are missing where there is one record only, or where the others have no fit without one of them.
    How often such intervals hold the true values is measured: see the page on comparisons.

    Examples
    --------
    >>> import xarray as xr
    >>> count = (("record", "pair"), [[0.0], [0.0], [1.0], [0.0], [2.0], [1.0]])
    >>> pga = ("record", [1.0, 2.0, 2.5, 3.0, 3.5, 4.0])
    >>> axes = {"record": list("abcdef"), "record_pga": pga, "pair": ["left-right"]}
    >>> found = fragility(xr.Dataset({"impact_count": count}, axes), confidence=None)
    >>> round(found["median"].item(), 2), sentence(found.squeeze())
    (2.67, 'fitted')
    """
    from scipy.special import ndtri

    about = get_event(event, level)
    cube = scenarios_only(cube)
    _check(cube, confidence)
    if not all(0.0 < q < 1.0 for q in quantiles):
        msg = f"quantiles are {list(quantiles)}; of a fragility they must be between 0 and 1"
        raise InputError(msg)
    found, ok = _happened(cube, about, level)
    strength = intensity_of(cube, intensity, records=records, folders=folders)
    trials = ("record", next((dim for dim in TRIALS[1:] if dim in cube.dims), "scale"))
    for dim in trials:
        found, ok, strength = (part if dim in part.dims else part.expand_dims(dim) for part in (found, ok, strength))
    found, strength = found.transpose(..., *trials), strength.transpose(*trials)
    table, x = found.values, np.asarray(strength.values, dtype=float)
    at = _levels(levels, x)
    places = {place: table[place].tobytes() for place in np.ndindex(table.shape[:-2])}  # of each curve
    kept = found.isel(dict.fromkeys(trials, 0), drop=True)
    shared = _shared(kept, one_dispersion)
    groups: dict[tuple[int, ...], list[tuple[int, ...]]] = {}
    for place in places:
        groups.setdefault(tuple(i for n, i in enumerate(place) if n not in shared), []).append(place)
    alike: dict[tuple[bytes, ...], list[dict[str, Any]]] = {}  # many are: some laws ignore some axes
    fits: dict[tuple[int, ...], dict[str, Any]] = {}
    for group in groups.values() if shared else ([place] for place in places):
        key = tuple(places[place] for place in group)
        if key not in alike:
            alike[key] = _cells([table[place] for place in group], x, at, confidence)
        fits |= zip(group, alike[key], strict=True)

    units, name, words = strength.attrs["units"], strength.attrs["long_name"], about.words(level)
    coords: dict[str, xr.DataArray] = {str(k): c for k, c in kept.coords.items() if k in kept.dims or not c.dims}
    for dim, labels, more in (
        ("bound", list(BOUNDS), {"long_name": "end of the confidence interval"}),
        ("intensity", at, {"units": units, "long_name": name}),
    ):
        coords[dim] = xr.DataArray(labels, dims=dim, attrs=more)
    variables = {}
    for variable, (dims, unit, text) in _VARIABLES.items():
        stacked = np.array([fits[place][variable] for place in places])
        attributes = {"units": units if unit is None else unit, "long_name": text.format(event=words)}
        variables[variable] = ((*kept.dims, *dims), stacked.reshape((*kept.shape, *stacked.shape[1:])), attributes)
    dataset = xr.Dataset(variables, coords=coords)
    dataset["fit_status"].attrs |= {
        "flag_values": np.array([int(s) for s in FIT_STATUS], np.int8),
        "flag_meanings": " ".join(s.label for s in FIT_STATUS),
    }
    left_out = (~ok).sum(trials).astype(np.int64)
    dataset["left_out"] = described(left_out, "1", "scenarios left out: their status is not ok", bare=True)
    dataset["happened"] = described(found, "1", f"1 where {words}, 0 where not", bare=True)
    dataset["trial_intensity"] = described(strength, units, name, bare=True)
    if len(quantiles):
        index = labelled("quantile", quantiles, f"probability that {words}", "1")
        away = np.exp(dataset["dispersion"] * index.copy(data=ndtri(index.values)))
        dataset["fractile"] = described(dataset["median"] * away, units, f"intensity at that probability that {words}")
    sizes = {dim: size for dim, size in zip(trials, x.shape, strict=True)}
    about_it: dict[str, Any] = {"event": about.key, "event_in_words": words, "intensity": f"{name} ({units})"}
    about_it["trials_of"] = over_text(sizes)
    if one_dispersion:
        about_it["one_dispersion"] = ", ".join(one_dispersion)
    if where := crossed(dataset):
        about_it["curves_cross"] = where
    if confidence is not None:
        about_it["confidence"] = confidence
    return finished(dataset, cube, "fragility", **about_it)


def sentence(dataset: xr.Dataset) -> str:
    """Say in words what the fit of one cell is, or why there is none."""
    status = FIT_STATUS[int(dataset["fit_status"])]
    low, high = (float(value) for value in dataset["median_between"])
    return status.words(low, high, str(dataset["median"].attrs["units"]))


#: Results of a fit: dimensions of their own, unit (None: the intensity's), and what they are.
_VARIABLES: dict[str, tuple[tuple[str, ...], str | None, str]] = {
    "fit_status": ((), "1", "whether there is a fit"),
    "median": ((), None, "intensity at which it is as likely as not that {event}"),
    "dispersion": ((), "1", "standard deviation of the logarithm of that intensity"),
    "median_interval": (("bound",), None, "confidence interval of the median"),
    "dispersion_interval": (("bound",), "1", "confidence interval of the dispersion"),
    "median_between": (("bound",), None, "what is known of the median where there is no fit"),
    "trials": ((), "1", "scenarios that count"),
    "happened_count": ((), "1", "scenarios in which {event}"),
    "probability": (("intensity",), "1", "probability that {event}"),
    "probability_interval": (("bound", "intensity"), "1", "confidence interval of the probability"),
}


def _cells(
    tables: Sequence[np.ndarray], x: np.ndarray, at: np.ndarray, confidence: float | None
) -> list[dict[str, Any]]:
    """Fit curves that share their dispersion, or one by itself, all of shape (record, scale); returns `_VARIABLES`."""

    def fits(kept: np.ndarray) -> list[LognormalFit]:
        there = [np.isfinite(table) & kept[:, None] for table in tables]
        trials = [(x[known], table[known] > 0.0) for table, known in zip(tables, there, strict=True)]
        return [fit_lognormal(*trials[0])] if len(trials) == 1 else fit_with_one_dispersion(trials)

    everyone = np.ones(len(x), bool)
    whole, without = fits(everyone), {}
    owners = [np.flatnonzero(np.isfinite(table).any(axis=1)).tolist() for table in tables]
    if confidence is not None and any(fit.status == FitStatus.FITTED for fit in whole):
        without = {one: fits(np.arange(len(x)) != one) for one in sorted({*np.concatenate(owners).astype(int)})}
    cells = []
    for number, (table, fit) in enumerate(zip(tables, whole, strict=True)):
        there = np.isfinite(table)
        fitted = fit.status == FitStatus.FITTED
        others = [without[one][number] for one in owners[number]] if without and fitted else []
        intervals = jackknife(fit, others, at, confidence or np.nan)
        cells.append(
            {
                "fit_status": np.int8(fit.status),
                "median": fit.median,
                "dispersion": fit.dispersion,
                "median_interval": intervals.median,
                "dispersion_interval": intervals.dispersion,
                "median_between": [fit.low, fit.high],
                "trials": int(there.sum()),
                "happened_count": int((table[there] > 0.0).sum()),
                "probability": probability(fit, at),
                "probability_interval": intervals.probability,
            }
        )
    return cells


def _shared(kept: xr.DataArray, axes: Sequence[str]) -> list[int]:
    """Return the places of axes along which curves have one dispersion."""
    for axis in axes:
        if axis not in kept.dims:
            raise InputError(unknown("axis of one dispersion", axis, (str(dim) for dim in kept.dims)))
    return [kept.dims.index(axis) for axis in axes]


def crossed(dataset: xr.Dataset) -> str:
    """Say which curves of neighbouring values cross at the intensities given, and where; "" where none do."""
    count, first, at = 0, "", dataset["intensity"].values
    whole = dataset["fit_status"]
    for axis in (str(dim) for dim in whole.dims if whole.sizes[dim] > 1 and dim not in ("law", "pair", "building")):
        order = (axis, *(dim for dim in whole.dims if dim != axis))
        status, median, dispersion = (
            dataset[name].transpose(*order).values for name in ("fit_status", "median", "dispersion")
        )
        for place in np.ndindex(status.shape[1:]):
            curves = [
                LognormalFit(FIT_STATUS[int(status[(i, *place)])], median[(i, *place)], dispersion[(i, *place)])
                for i in range(len(status))
            ]
            for i, (one, other) in enumerate(pairwise(curves)):
                intensity, share = crossing(one, other)
                if at.min() <= intensity <= at.max() and min(share, 1.0 - share) > SEEN:
                    count += 1
                    values = " and ".join(f"{dataset[axis].values[i + n].item():g}" for n in (0, 1))
                    units = dataset["median"].attrs["units"]
                    first = first or f"of {axis} {values} at {intensity:.3g} {units}, probability {share:.2g}"
    more = f", and {count - 1} more" if count > 1 else ""
    return first and f"{first}{more}: their dispersions are fitted apart"


def _check(cube: xr.Dataset, confidence: float | None) -> None:
    if not set(TRIALS) & set(cube.dims):
        need_dims(cube, "a fragility", TRIALS[:1])
    if all(cube.sizes.get(dim, 1) < 2 for dim in TRIALS):
        msg = (
            "a fragility needs ground motions of several intensities, and this cube has one record at one scale; run "
            "a sweep over several records or scales"
        )
        raise InputError(msg)
    if confidence is not None and not 0.0 < confidence < 1.0:
        msg = f"confidence is {confidence!r}; it must be between 0 and 1, 0.95 for instance, or None for no intervals"
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
