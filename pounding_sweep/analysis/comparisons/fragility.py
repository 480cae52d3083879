"""Fragility: the probability that something happens, against the intensity of the ground motion."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.comparisons import MOTION_DIMS, Row, check_needs, comparison, over_text, plain_rows
from pounding_sweep.analysis.events import get_event
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
    check_levels,
    described,
    labelled,
    pounding_only,
    scenario_dims,
    touched,
    trusted,
    values,
)
from pounding_sweep.base.errors import InputError, unknown

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
    columns = {"trials": result["trials"], "happened": result["happened_count"]}
    columns |= {name: result[name] for name in ("median", "dispersion")}
    if result["median_interval"].notnull().any():
        for name, (i, bound) in product(("median", "dispersion"), enumerate(BOUNDS)):
            columns[f"{name}_{bound}"] = result[f"{name}_interval"].isel(bound=i)
    for i, q in enumerate(result["fractile"]["quantile"].values.tolist() if "fractile" in result else []):
        columns[f"at {q:g}"] = result["fractile"].isel(quantile=i)
    columns |= {"status": whole, **{end: result["median_between"].isel(bound=i) for i, end in enumerate(BOUNDS)}}
    table = xr.Dataset({name: part.reset_coords(drop=True) for name, part in columns.items()}).transpose(*dims)
    rows = plain_rows(table)
    for row in rows:
        low, high = (np.nan if end is None else end for end in (row.pop(end) for end in BOUNDS))
        row["units"] = str(result["median"].attrs["units"])
        row["over"] = str(result.attrs["trials_of"])
        row["fit"] = FIT_STATUS[row.pop("status")].words(low, high, row["units"])
    return rows


@comparison(
    "probability that a pair touches, or of another event, against intensity: a fitted lognormal",
    needs="pairs, a law with contact, and records or scales of several intensities",
    requires={"several": MOTION_DIMS},
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
    what = f"the fragility of {event!r}"
    if confidence is not None and not 0.0 < confidence < 1.0:
        raise InputError(
            f"confidence is {confidence!r}; it must be between 0 and 1, 0.95 for instance, or None for no intervals"
        )
    if not all(0.0 < q < 1.0 for q in quantiles):
        raise InputError(f"quantiles are {list(quantiles)}; of a fragility they must be between 0 and 1")
    if about.per == "pair":
        check_needs(cube, what, pairs=True, laws=1)
        cube = pounding_only(cube)
    if about.variable and level is not None:
        check_needs(cube, what, outputs=[about.variable])
        response = values(cube, about.variable)
        happened = (response > level).astype(np.float64).where(response.notnull())
    else:
        happened = touched(cube, what)
    happened = happened.max("storey") if "storey" in happened.dims else happened
    ok = trusted(cube).broadcast_like(happened.isel({about.per: 0}, drop=True, missing_dims="ignore"))
    strength = intensity_of(cube, intensity, records=records, folders=folders)
    trials = ("record", next((dim for dim in TRIALS[1:] if dim in cube.dims), "scale"))
    for dim in trials:
        happened, ok, strength = (
            part if dim in part.dims else part.expand_dims(dim) for part in (happened, ok, strength)
        )
    happened, strength = happened.transpose(..., *trials), strength.transpose(*trials)
    inner = happened.isel(dict.fromkeys(trials, 0), drop=True)
    for axis in one_dispersion:
        if axis not in inner.dims:
            raise InputError(unknown("axis of one dispersion", axis, (str(dim) for dim in inner.dims)))
    apart = [dim for dim in inner.dims if dim not in one_dispersion]
    order = (*apart, *(dim for dim in inner.dims if dim in one_dispersion))
    x = np.asarray(strength.values, dtype=float)
    if levels is None and x.max() <= 0.0:
        raise InputError("every ground motion of this cube has intensity 0; run the sweep with scales above zero")
    units, name, words = strength.attrs["units"], strength.attrs["long_name"], about.words(level)
    at = np.linspace(x.max() / LEVELS, x.max(), LEVELS) if levels is None else check_levels(levels, units)
    n_groups = int(np.prod([inner.sizes[dim] for dim in apart]))
    alike: dict[bytes, list[dict[str, Any]]] = {}  # many are: some laws ignore some axes
    cells: list[dict[str, Any]] = []
    for tables in happened.transpose(*order, *trials).values.reshape(n_groups, -1, *x.shape):
        key = tables.tobytes()
        if key not in alike:
            alike[key] = _cells(tables, x, at, confidence)
        cells += alike[key]

    coords: dict[str, Any] = {str(k): c for k, c in inner.coords.items() if k in inner.dims or not c.dims}
    coords["bound"] = ("bound", list(BOUNDS), {"long_name": "end of the confidence interval"})
    coords["intensity"] = ("intensity", at, {"units": units, "long_name": name})
    variables = {}
    for variable, (dims, unit, text) in _VARIABLES.items():
        stacked = np.array([cell[variable] for cell in cells])
        attributes = {"units": units if unit is None else unit, "long_name": text.format(event=words)}
        shape = (*(inner.sizes[dim] for dim in order), *stacked.shape[1:])
        variables[variable] = ((*order, *dims), stacked.reshape(shape), attributes)
    dataset = xr.Dataset(variables, coords).transpose(*inner.dims, ...)
    dataset["fit_status"].attrs |= {
        "flag_values": np.array([int(s) for s in FIT_STATUS], np.int8),
        "flag_meanings": " ".join(s.label for s in FIT_STATUS),
    }
    left_out = (~ok).sum(trials).astype(np.int64)
    dataset["left_out"] = described(left_out, "1", "scenarios left out: their status is not ok", bare=True)
    dataset["happened"] = described(happened, "1", f"1 where {words}, 0 where not", bare=True)
    dataset["trial_intensity"] = described(strength, units, name, bare=True)
    if len(quantiles):
        index = labelled("quantile", quantiles, f"probability that {words}", "1")
        away = np.exp(dataset["dispersion"] * index.copy(data=ndtri(index.values)))
        dataset["fractile"] = described(dataset["median"] * away, units, f"intensity at that probability that {words}")
    about_it = {"one_dispersion": ", ".join(one_dispersion), "curves_cross": crossed(dataset), "confidence": confidence}
    return dataset.assign_attrs(
        event=about.key,
        event_in_words=words,
        intensity=f"{name} ({units})",
        trials_of=over_text(dict(zip(trials, x.shape, strict=True))),
        **{key: value for key, value in about_it.items() if value},
    )


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


def _cells(tables: np.ndarray, x: np.ndarray, at: np.ndarray, confidence: float | None) -> list[dict[str, Any]]:
    """Fit curves that share their dispersion, or one by itself, all of shape (record, scale); returns `_VARIABLES`."""

    def fits(records: np.ndarray) -> list[LognormalFit]:
        known = [np.isfinite(table) & records[:, None] for table in tables]
        trials = [(x[these], table[these] > 0.0) for table, these in zip(tables, known, strict=True)]
        return [fit_lognormal(*trials[0])] if len(trials) == 1 else fit_with_one_dispersion(trials)

    whole = fits(np.ones(len(x), bool))
    fitted = [fit.status == FitStatus.FITTED for fit in whole]
    owns = np.isfinite(tables).any(axis=2)  # whether a curve has trials of a record
    without = {}
    if confidence is not None and any(fitted):
        without = {one: fits(np.arange(len(x)) != one) for one in np.flatnonzero(owns.any(axis=0))}
    cells = []
    for number, (table, fit) in enumerate(zip(tables, whole, strict=True)):
        others = [without[one][number] for one in np.flatnonzero(owns[number])] if without and fitted[number] else []
        median, dispersion, band = jackknife(fit, others, at, confidence or np.nan)
        cells.append(
            {
                "fit_status": np.int8(fit.status),
                "median": fit.median,
                "dispersion": fit.dispersion,
                "median_interval": median,
                "dispersion_interval": dispersion,
                "median_between": [fit.low, fit.high],
                "trials": int(np.isfinite(table).sum()),
                "happened_count": int((table > 0.0).sum()),
                "probability": probability(fit, at),
                "probability_interval": band,
            }
        )
    return cells


def crossed(dataset: xr.Dataset) -> str:
    """Say which curves of neighbouring values cross at the intensities given, and where; "" where none do."""
    count, first, at = 0, "", dataset["intensity"].values
    fits = dataset[["median", "dispersion"]]
    for axis in (str(dim) for dim in fits["median"].dims if dim not in ("law", "pair", "building")):
        median, dispersion = (np.moveaxis(part.transpose(axis, ...).values, 0, -1) for part in fits.values())
        where, share = crossing(median[..., :-1], dispersion[..., :-1], median[..., 1:], dispersion[..., 1:])
        seen = (at.min() <= where) & (where <= at.max()) & (np.minimum(share, 1.0 - share) > SEEN)
        for place in map(tuple, np.argwhere(seen)[:1]):
            labels = " and ".join(f"{label:g}" for label in dataset[axis].values[place[-1] :][:2].tolist())
            units = dataset["median"].attrs["units"]
            first = first or f"of {axis} {labels} at {where[place]:.3g} {units}, probability {share[place]:.2g}"
        count += int(seen.sum())
    more = f", and {count - 1} more" if count > 1 else ""
    return first and f"{first}{more}: their dispersions are fitted apart"
