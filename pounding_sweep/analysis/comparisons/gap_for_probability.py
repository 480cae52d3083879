"""The gap that a pair needs so that it touches with a given probability: under a suite, at an intensity, in some years.

Until something touches, the row is as linear as its buildings: the required gap of a record grows in proportion to
the intensity that the record is scaled to. One run without pounding of each record tells the gap at any intensity.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.along import fractiles_over
from pounding_sweep.analysis.comparisons import Row, comparison, over_text
from pounding_sweep.analysis.comparisons.required_gap import required_gap
from pounding_sweep.analysis.hazard import Hazard, check_measure, hazard_of
from pounding_sweep.analysis.intensity import intensity_of, own_intensity, periods_of
from pounding_sweep.analysis.rebuild import stored_sweep
from pounding_sweep.analysis.scenarios import COMPARISON, described, finished, labelled, need_several
from pounding_sweep.base.errors import InputError
from pounding_sweep.base.tables import finite
from pounding_sweep.spec.axes import DIMENSIONS
from pounding_sweep.spec.spec import scene_of

#: Shares of the motions that may make a pair touch.
PROBABILITIES = (0.5, 0.16, 0.1, 0.05, 0.02, 0.01)
#: Years in which a pair may touch with those probabilities, where a hazard is given.
YEARS = 50.0
#: Probabilities at which curves are given.
CURVE = tuple(np.geomspace(1e-3, 0.9, 30).tolist())
#: By so much the required gaps of a record may miss proportion to its scale: errors of their runs.
PROPORTIONAL = 1e-3
#: Parts of equal probability into which each of the two distributions behind an interval is cut.
_PARTS = 50
#: Numbers of a gap, and of a rate.
_NUMBERS = ("", "_lower", "_upper", "_observed")


def gap_rows(result: xr.Dataset) -> list[Row]:
    """Return a row per gap that is asked for; with a hazard, also one per pair for the gap that it has."""
    over = over_text({"record": int(result.attrs["suite"])})
    named = [str(name) for name in result.coords if name not in result.dims and "pair" not in result[name].dims]
    result = result.drop_vars([name for name in named if name != "row_gap"])
    counts = result[["records", "never"]].rename(never="never touches")
    kinds = [("gap", "intensity" if "intensity" in result.dims else "the suite as it is")]
    if "gap_in_years" in result:
        kinds.append(("gap_in_years", f"in {result.attrs['years']:g} years"))
    rows: list[Row] = []
    for kind, given in kinds:
        part = result[[f"{kind}{ending}" for ending in _NUMBERS]]
        part = part.rename({f"{kind}{ending}": f"gap{ending}" for ending in _NUMBERS}).assign(counts)
        for row in _plain(part.drop_vars("row_gap", errors="ignore")):
            level = row.pop("intensity", None)
            told: Row = {"given": given if level is None else f"{given} {level:.4g}"}
            if kind == "gap_in_years":
                told["rate"] = -math.log1p(-row["probability"]) / float(result.attrs["years"])
            rows.append(told | row)
    own = [f"rate{ending}" for ending in _NUMBERS] + ["beyond"]
    for row in _plain(result[own].assign(counts)) if "rate" in result else []:
        chance = row["rate"] and -math.expm1(-row["rate"] * float(result.attrs["years"]))
        rows.append({"given": "the row's gap", "probability": chance, "gap": row.pop("row_gap"), **row})
    others = [str(dim) for dim in result["median"].dims if dim not in ("pair", "intensity")]
    first = ("given", *others, "pair", "probability", *(["rate"] if "rate" in result else []), "gap")
    return [{name: row.get(name) for name in first} | row | {"units": "m", "over": over} for row in rows]


def _plain(part: xr.Dataset) -> list[Row]:
    """Return a row per label, None for numbers that are none."""
    table = part.to_dataframe(dim_order=[str(dim) for dim in part.dims]).reset_index().to_dict("records")
    return [{str(name): finite(value) for name, value in row.items()} for row in table]


@comparison(
    "the gap that a pair needs so that it touches with no more than a given probability",
    needs="several records; else what 'required-gap' needs",
    columns=("probability", "pair"),
    figure="gap-for-probability",
    arguments=("probabilities", "intensity", "levels", "hazard", "years", "folders"),
    rows=gap_rows,
    whole=True,
)
def gap_for_probability(
    cube: xr.Dataset,
    probabilities: Sequence[float] = PROBABILITIES,
    *,
    intensity: str | xr.DataArray | None = None,
    levels: Sequence[float] | None = None,
    hazard: Hazard | str | os.PathLike[str] | None = None,
    years: float = YEARS,
    confidence: float = 0.95,
    curve: Sequence[float] = CURVE,
    records: Any = None,
    folders: Any = None,
) -> xr.Dataset:
    """Find the gap at which a pair touches under a given share of the motions that a suite stands for.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with the axis ``record``, or the result of `pounding_sweep.analysis.required_gap`.
    probabilities : sequence of float
        Shares of the motions under which the pair may touch, in (0, 1).
    intensity : str or DataArray, optional
        As for `pounding_sweep.analysis.intensity.intensity_of`: every record is taken as scaled to one intensity.
        Without it, the motions are those of the cube, at each of its scales.
    levels : sequence of float, optional
        Those intensities; by default the suite's median at each scale of the cube, of equal ones their own.
    hazard : Hazard, str or path, optional
        How often intensities are exceeded at the site, see `pounding_sweep.analysis.hazard.hazard_of`; the intensity is
        "pga" then where none is given.
    years : float
        Years in which the pair may touch with those probabilities, under that hazard.
    confidence : float
        Of the intervals, in (0, 1).
    curve : sequence of float
        Probabilities of the curves in a figure.
    records, folders : optional
        As for `pounding_sweep.analysis.required_gap`.

    Returns
    -------
    xarray.Dataset
        On ``probability``, ``pair``, ``intensity`` where there is one (else ``scale``), and building properties where
        the cube has them, all in m: ``gap`` by a lognormal distribution of the records' exact required gaps;
        ``gap_lower`` and ``gap_upper``, its confidence interval; ``gap_observed``, the fractile of the required gaps
        themselves, missing where there are too few records for that probability. Beside them ``median`` (m) and
        ``dispersion`` of the lognormal, ``records``, how many count, and ``never``, under how many of these the pair
        never touches. With a hazard ``gap_in_years`` (and ``_lower``, ``_upper``, ``_observed``), the
        risk-targeted gaps; ``rate`` (and so on), how often a year the pair touches with the gap ``row_gap`` of the
        row; ``beyond``, the share of that rate from intensities that the hazard does not tell. ``trial_gap`` are the
        required gaps, ``curve_...`` the same numbers along ``curve``, probabilities of a figure. Directions of the
        ground motion are apart where the cube has scales of both signs. Missing with fewer than two records that
        count, and, but for what is observed, where a pair never touches under one of them.

    Raises
    ------
    InputError
        The cube has no several records, a required gap can't be had from it, gaps do not grow with the intensity, or a
        number or the hazard is not valid.

    Notes
    -----
    With m and s the mean and standard deviation of ln g over n records, and z the normal quantile of 1 - p, the gap
    is exp(m + z s), and the interval of the quantile is exact for a lognormal: exp(m + t s / sqrt(n)), t of
    Student's noncentral distribution with n - 1 degrees of freedom and noncentrality z sqrt(n). As for every required
    gap, all pairs of the row must have theirs.

    A gap g touches from intensity x = g / r on, r the required gap per intensity of a record. The annual rate of a
    touch is the mean of the hazard at these x: of the records' own for what is observed, of their lognormal else (see
    `pounding_sweep.analysis.hazard`). Intervals of what the hazard makes of m and s are generalised confidence
    intervals (Krishnamoorthy & Mathew 2003, J. Stat. Plan. Inference 115, 103-121): fractiles over m + Z s' / sqrt(n)
    and s' = s sqrt((n - 1) / C), Z normal and C chi-square distributed with n - 1 degrees of freedom. They are of the
    records alone: the hazard is taken as it is.

    Examples
    --------
    >>> import xarray as xr
    >>> exact = (("record", "pair"), [[0.01], [0.02], [0.04]])
    >>> gaps = xr.Dataset({"exact": exact}, {"pair": ["left-right"]}, {"comparison": "required-gap"})
    >>> gap_for_probability(gaps, [0.5]).gap.round(6).values.tolist()
    [[0.02]]
    """
    check_numbers(probabilities, confidence, years)
    site = None if hazard is None else hazard_of(hazard)
    own = cube.attrs.get(COMPARISON) == "required-gap"
    gaps = cube if own else required_gap(cube, records, folders=folders)
    need_several(gaps, "a gap for a probability", "record")
    exact = gaps["exact"]
    about: dict[str, Any] = {"confidence": confidence, "suite": gaps.sizes["record"]}
    strength = None
    if intensity is not None or site is not None:
        strength = intensity_of(cube, intensity, records=records, folders=folders)
        about |= {"intensity": f"{strength.attrs['long_name']} ({strength.attrs['units']})"}
        _check_elastic(cube)
        if "thickness" in gaps.coords:
            msg = (
                "bumpers take their thickness of the gap, so that the required gap does not grow in proportion to the "
                "intensity; leave them out of the row, and add their thickness to the gap that is found"
            )
            raise InputError(msg)
        exact = _per_intensity(exact, strength, cube)
    elif levels is not None:
        msg = "intensities are given, but not of what; add intensity='pga', or another measure (--intensity)"
        raise InputError(msg)
    at = labelled("probability", probabilities, "probability that the pair touches", "1")
    along = labelled("curve", curve, "probability that the pair touches", "1")
    fit = _Lognormal(exact, confidence)
    level: Any = 1.0
    if strength is not None:
        level = labelled("intensity", _levels(levels, strength), strength.attrs["long_name"], strength.attrs["units"])
    found = {f"gap{end}": part * level for end, part in fit.gaps(at).items()}
    found |= {f"curve_gap{end}": part * level for end, part in fit.gaps(along).items() if end != "_observed"}
    found |= {"trial_gap": exact * level, "median": np.exp(fit.middle) * level}
    if site is not None and strength is not None:
        if not isinstance(intensity, xr.DataArray):
            check_measure(site, intensity or own_intensity(cube), lambda name: periods_of(cube, name))
        if site.units not in ("", strength.attrs["units"]):
            units = strength.attrs["units"]
            msg = f"the hazard {site.source} is of {site.units}, the intensity in {units}; give one of that intensity"
            raise InputError(msg)
        for name, index in (("gap_in_years", at), ("curve_gap_in_years", along)):
            found |= {f"{name}{end}": part for end, part in fit.gaps_of_rate(site, index, years).items()}
        about |= {"hazard": site.source, "years": years}
    dataset = xr.Dataset(
        {
            name: described(part.transpose(part.dims[0], ...), "m", _text(name, confidence))
            for name, part in found.items()
        }
        | {
            "dispersion": described(fit.spread, "1", "standard deviation of the logarithm of the required gap"),
            "records": described(fit.count, "1", "records that count"),
            "never": described((exact <= 0.0).sum("record"), "1", "records under which the pair never touches"),
        },
        coords={str(index.dims[0]): index for index in (at, along, level) if np.ndim(index)},
    )
    if site is not None and "row_gap" in gaps.coords:
        rates = fit.rates(site, gaps["row_gap"])
        per_year = {name: described(part, "year-1", _text(name, confidence)) for name, part in rates.items()}
        dataset = dataset.assign(per_year)
        dataset["beyond"].attrs |= {"units": "1", "long_name": "share of the rate from intensities beyond the hazard's"}
    return finished(dataset, cube, "gap-for-probability", **about)


def _text(name: str, confidence: float) -> str:
    """Return the long name of a result."""
    stem, _, ending = name.rpartition("_")
    if ending in ("lower", "upper"):
        return f"{ending} end of the {confidence:.0%} confidence interval of {stem.removeprefix('curve_')}"
    kind = name.removeprefix("curve_").removesuffix("_observed")
    whose = "of the records themselves" if ending == "observed" else "by a lognormal"
    return {
        "gap": f"gap at which the pair touches with that probability, {whose}",
        "gap_in_years": f"gap at which the pair touches in the years with that probability, {whose}",
        "rate": f"annual rate at which the pair touches with the row's gap, {whose}",
        "median": "median required gap",
        "trial_gap": "required gap of the record",
    }.get(kind, kind)


def check_numbers(probabilities: Sequence[float], confidence: float = 0.95, years: float = YEARS) -> None:
    """Raise `InputError` unless probabilities are between 0 and 1 and the years are some."""
    if not len(probabilities) or not all(0.0 < p < 1.0 for p in (*probabilities, confidence)):
        msg = f"probabilities are {list(probabilities)}, confidence is {confidence!r}; all must be between 0 and 1"
        raise InputError(msg)
    if not (math.isfinite(years) and years > 0.0):
        msg = f"years are {years!r}; give a number above 0, such as 50"
        raise InputError(msg)


def _levels(levels: Sequence[float] | None, strength: xr.DataArray) -> list[float]:
    if levels is None:
        middles = np.atleast_1d(strength.median("record").values)
        return sorted({float(f"{x:.12g}") for x in middles.tolist() if x > 0.0})
    if not len(levels) or not all(math.isfinite(x) and x > 0.0 for x in levels):
        msg = f"intensities are {list(levels)}; give one or more above 0 ({strength.attrs['units']})"
        raise InputError(msg)
    return [float(x) for x in levels]


def _check_elastic(cube: xr.Dataset) -> None:
    """Raise `InputError` where storeys may yield: required gaps do not grow with the intensity there."""
    if "sweep" in cube.attrs and any(scene_of(stored_sweep(cube)["scene"]).yields):
        msg = (
            "required gaps of a row that yields do not grow in proportion to the intensity, so that those at others "
            "can't be told; leave the intensity and the hazard out, for gaps at each scale of the cube"
        )
        raise InputError(msg)


def _per_intensity(exact: xr.DataArray, strength: xr.DataArray, cube: xr.Dataset) -> xr.DataArray:
    """Return required gaps per intensity, of scales of both signs along ``direction``."""
    ratio = exact / strength.where(strength > 0.0)
    scaled = [dim for dim in DIMENSIONS["scale"] if dim in ratio.dims]
    if not scaled:
        return ratio
    (dim,) = scaled
    signs = np.sign(cube[dim].values) if dim == "scale" else np.ones(ratio.sizes[dim])
    ways = {text: np.flatnonzero(signs == sign) for sign, text in ((1.0, "as recorded"), (-1.0, "reversed"))}
    parts = []
    for way in (way for way in ways.values() if way.size):
        part = ratio.isel({dim: way})
        low, high = part.min(dim), part.max(dim)
        wrong = (high - low > PROPORTIONAL * high).fillna(False)
        if bool(wrong.any()):
            name = str(
                strength["record"].values[np.flatnonzero(wrong.any([d for d in wrong.dims if d != "record"]))[0]]
            )
            msg = (
                f"required gaps of record {name!r} do not grow in proportion to its scale, so that those at other "
                "intensities can't be told; leave the intensity out, for gaps at each scale of the cube"
            )
            raise InputError(msg)
        parts.append(part.mean(dim))
    if len(parts) == 1:
        return parts[0]
    return xr.concat(parts, labelled("direction", [text for text, way in ways.items() if way.size], "ground motion"))


class _Lognormal:
    """A lognormal of required gaps for each pair, and what it and the gaps themselves come to."""

    def __init__(self, exact: xr.DataArray, confidence: float) -> None:
        self.exact = exact
        self.ends = {"_lower": 0.5 - 0.5 * confidence, "_upper": 0.5 + 0.5 * confidence}
        self.count = exact.notnull().sum("record")
        logs: Any = np.log(exact.where((self.count > 1) & ~(exact <= 0.0).any("record")))
        self.middle, self.spread = logs.mean("record"), logs.std("record", ddof=1)

    def gaps(self, index: xr.DataArray) -> dict[str, xr.DataArray]:
        """Return the gap for each probability, its interval, and the fractile of the records."""
        from scipy.stats import nct, norm

        (dim,) = index.dims
        z = index.copy(data=norm.isf(index.values))
        found = {"": np.exp(self.middle + z * self.spread)}
        sizes, place = np.unique(self.count.values, return_inverse=True)  # quantiles take long, and sizes are few
        for name, share in self.ends.items():
            table = nct.ppf(share, np.where(sizes > 1, sizes - 1, np.nan), z.values[:, None] * sizes**0.5)
            t = xr.DataArray(table[:, place.reshape(self.count.shape)], dims=(dim, *self.count.dims))
            found[name] = np.exp(self.middle + t * self.spread / self.count**0.5)
        observed, _ = fractiles_over(self.exact, ["record"], [1.0 - p for p in index.values])
        observed = observed.rename(quantile=str(dim)).assign_coords({dim: index})
        found["_observed"] = observed.where(index * self.count >= 1.0)
        return {name: part.transpose(dim, ...) for name, part in found.items()}

    def gaps_of_rate(self, site: Hazard, index: xr.DataArray, years: float) -> dict[str, xr.DataArray]:
        """Return the gap for each probability of a touch in some years, its interval, and that of the records."""

        def gaps(exact: np.ndarray, middle: float, spread: float, count: int) -> np.ndarray:
            found = np.full((len(_NUMBERS), index.size), np.nan)
            z, spreads = self._drawn(spread, count)
            with np.errstate(divide="ignore"):
                capacities = 1.0 / exact[np.isfinite(exact)]
            for i, rate in enumerate(-np.log1p(-index.values) / years):
                if np.isfinite(spread):
                    found[0, i] = np.exp(middle) * site.median_at(rate, np.array(spread))
                    drawn = middle + z * spreads / count**0.5 + np.log(site.median_at(rate, spreads))
                    found[1:3, i] = np.exp(np.quantile(drawn, list(self.ends.values())))
                if np.isfinite(capacities).any():
                    found[3, i] = site.factor_at(rate, capacities)
            return found

        return self._each(gaps, index)

    def rates(self, site: Hazard, gap: xr.DataArray) -> dict[str, xr.DataArray]:
        """Return the annual rate at which a gap touches, its interval, that of the records; and ``beyond``."""
        own = gap.broadcast_like(self.middle).transpose(*self.middle.dims)

        def rates(exact: np.ndarray, middle: float, spread: float, count: int, gap: float) -> np.ndarray:
            found = np.full((len(_NUMBERS) + 1, 1), np.nan)
            if not gap > 0.0:
                return found
            if np.isfinite(spread):
                z, spreads = self._drawn(spread, count)
                median = gap / np.exp(middle)
                drawn = site.touching(gap / np.exp(middle + z * spreads / count**0.5), spreads[None, :])
                found[0], found[4] = site.touching(median, np.array(spread)), site.beyond(median, np.array(spread))
                found[1:3, 0] = np.quantile(drawn, list(self.ends.values()))
            with np.errstate(divide="ignore"):
                found[3] = site.exceeded(gap / exact[np.isfinite(exact)]).mean() if count else np.nan
            return found

        found = self._each(rates, None, own)
        return {f"rate{end}": found[end] for end in _NUMBERS} | {"beyond": found["beyond"]}

    def _drawn(self, spread: float, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return normal numbers, down, and spreads, across, that stand for what those of all motions may be."""
        from scipy.stats import chi2, norm

        shares = (np.arange(_PARTS) + 0.5) / _PARTS
        return norm.ppf(shares)[:, None], spread * np.sqrt((count - 1) / chi2.ppf(shares, max(count - 1, 1)))

    def _each(self, make: Any, index: xr.DataArray | None, *more: xr.DataArray) -> dict[str, xr.DataArray]:
        """Return numbers of each pair, those of `_NUMBERS`, then ``beyond``; along `index`, where given."""
        kept = self.middle.dims
        exact = self.exact.transpose(*kept, "record").values
        parts = [part.transpose(*kept).values for part in (self.middle, self.spread, self.count, *more)]
        found = np.array([make(exact[at], *(part[at] for part in parts)) for at in np.ndindex(self.middle.shape)])
        found = np.moveaxis(found, 0, -1).reshape(*found.shape[1:], *self.middle.shape)
        names = (*_NUMBERS, "beyond")[: len(found)]
        if index is None:
            return {n: self.middle.copy(data=part[0]) for n, part in zip(names, found, strict=True)}
        (dim,) = index.dims
        coords = {**self.middle.coords, dim: index}
        return {n: xr.DataArray(part, dims=(dim, *kept), coords=coords) for n, part in zip(names, found, strict=True)}
