"""The gap that each pair needs: exactly, by separation rules, and so that it touches with a given probability.

A rule is a table of ``data/comparisons.toml`` and a function in `_GAPS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from pounding_sweep.analysis import scenarios
from pounding_sweep.analysis.comparisons import Row, check_needs, comparison, over_text, plain_rows
from pounding_sweep.analysis.comparisons.fragility import check_site
from pounding_sweep.analysis.comparisons.stripes import gaps_of_stripes
from pounding_sweep.analysis.hazard import Hazard, hazard_of
from pounding_sweep.analysis.rebuild import intensity_of, stored_scene, uncoupled_runs
from pounding_sweep.analysis.scenarios import ROUND_OFF, described, fell, labelled, peak_displacement, values
from pounding_sweep.base.errors import InputError
from pounding_sweep.base.files import FilePath, read_data
from pounding_sweep.model.building import Building
from pounding_sweep.model.scene import Scene
from pounding_sweep.records import Record
from pounding_sweep.request.axes import DIMENSIONS

#: What is said of every clause of a standard.
FROM_MEMORY = "stated from memory of the standard; the standard was not consulted"


@dataclass(frozen=True)
class BehaviourFactors:
    """Factors by which standards turn reduced displacements into real ones, of all buildings or by their names.

    ``cd``, the deflection amplification Cd of ASCE 7, ``importance``, its Ie, a divisor, ``q``, the displacement
    behaviour factor of Eurocode 8, and ``r``, R of IS 1893. All are 1 by default, as linear runs reduce nothing.
    """

    cd: float | Mapping[str, float] = 1.0
    importance: float | Mapping[str, float] = 1.0
    q: float | Mapping[str, float] = 1.0
    r: float | Mapping[str, float] = 1.0

    def of(self, factor: str, building: str) -> float:
        """Return a factor of a building, a positive number."""
        value = getattr(self, factor)
        if isinstance(value, Mapping):
            if building not in value:
                answer = ", ".join(map(repr, value))
                raise InputError(f"factor {factor!r} of building {building!r} is missing beside {answer}; give it, too")
            value = value[building]
        if not 0.0 < value < math.inf:
            raise InputError(
                f"factor {factor!r} of building {building!r} is {value!r}; give every building a positive number"
            )
        return float(value)


def read_factors(texts: Mapping[str, Sequence[str]]) -> BehaviourFactors:
    """Return factors from texts by name: "1.5" for all buildings, or "BUILDING=1.5" for each.

    Raises
    ------
    InputError
        A text has no number.

    Examples
    --------
    >>> read_factors({"q": ["tower=1.5", "annex=3"], "r": ["5"]})
    BehaviourFactors(cd=1.0, importance=1.0, q={'tower': 1.5, 'annex': 3.0}, r=5.0)
    """
    factors: dict[str, Any] = {}
    for name, parts in texts.items():
        try:
            numbers = {building: float(x) for building, _, x in (text.rpartition("=") for text in parts)}
        except ValueError:
            raise InputError(f"factor {name} {parts}: give one number, or BUILDING=NUMBER for each") from None
        factors[name] = numbers if len(numbers) > 1 else numbers.get("", numbers)
    return BehaviourFactors(**factors)


class SeparationRule(NamedTuple):
    """A rule for the distance between two buildings."""

    key: str  # name in results
    gap: Callable[[xr.Dataset], xr.DataArray]  # what `_neighbours` returns -> needed gap (m)
    name: str  # name in tables and figures
    title: str  # the rule in words
    formula: str  # of the displacements u1 and u2 (m)
    clause: str = "-"  # where it is from
    edition: str = "-"
    note: str = FROM_MEMORY  # what else is to be said of it


def cqc_correlation(
    period_1: xr.DataArray, period_2: xr.DataArray, damping_1: xr.DataArray, damping_2: xr.DataArray
) -> xr.DataArray:
    """Correlation of the responses of two oscillators to broad-band ground motion."""
    r = period_2 / period_1
    product = damping_1 * damping_2
    top = 8.0 * product**0.5 * (damping_2 + damping_1 * r) * r**1.5
    bottom = (1.0 - r**2) ** 2 + 4.0 * product * r * (1.0 + r**2) + 4.0 * (damping_1**2 + damping_2**2) * r**2
    same = bottom == 0.0  # undamped, equal periods
    return (top + same) / (bottom + same)


_GAPS: dict[str, Callable[[xr.Dataset], xr.DataArray]] = {
    "abs": lambda ends: ends.left + ends.right,
    "srss": lambda ends: np.hypot(ends.left, ends.right),
    "double_difference": lambda ends: (
        (ends.left**2 + ends.right**2 - 2.0 * ends.correlation * ends.left * ends.right).clip(min=0.0) ** 0.5
    ),
    "asce7": lambda ends: np.hypot(
        ends.left * ends.cd_left / ends.importance_left, ends.right * ends.cd_right / ends.importance_right
    ),
    "ec8": lambda ends: np.hypot(ends.left * ends.q_left, ends.right * ends.q_right) * (1.0 - 0.3 * ends.level),
    "is1893": lambda ends: (ends.left * ends.r_left + ends.right * ends.r_right) * (1.0 - 0.5 * ends.level),
}
#: All rules by key.
SEPARATION_RULES = {
    key: SeparationRule(key, _GAPS[key], **rule) for key, rule in read_data("comparisons.toml")["rule"].items()
}


@comparison
def required_gap(
    source: Scene | str | xr.Dataset,
    records: Record | FilePath | Iterable[Record | FilePath] | None = None,
    *,
    behaviour: BehaviourFactors | None = None,
    folders: FilePath | Sequence[FilePath] | None = None,
) -> xr.Dataset:
    """Find the gap at which each pair just does not touch, and what separation rules ask for.

    Parameters
    ----------
    source : Scene, str or xarray.Dataset
        A row, the name of a preset, or a cube; of one without the law "none", ``closing_max``, ``displacement_max``
        and ``displacement_min`` the run without pounding is made again by the sweep that it carries.
    records : Record, str, path, or several, optional
        Ground motions; needed with a row. With a cube: records to look through before they are looked for by name.
    behaviour : BehaviourFactors, optional
        Factors of the standards, all 1 by default.
    folders : path or several, optional
        Where to find records by name.

    Returns
    -------
    xarray.Dataset
        On ``record``, and on ``scale``, building properties or ``case`` where the cube has them: ``closing`` (pair,
        storey; m), the largest closing displacement of the floors; ``exact`` (pair; m), its largest value over storeys,
        0 where it is rounding, which ``never`` (pair) tells by 1; ``rule_gap`` (rule, pair; m), and ``ratio`` (rule,
        pair) to the exact one; ``correlation`` (pair) of the first modes. The ``thickness`` (pair; m) of bumpers is in
        the gaps. Missing where no floors meet.

    Raises
    ------
    InputError
        A row without records or pairs, or a cube whose row or records can't be known; the message says what is missing.

    Notes
    -----
    The exact gap of a pair holds only where every pair of the row has at least its own: once another pair pounds, this
    one may touch at a larger gap.

    Examples
    --------
    >>> round(required_gap("mate2015", "el_centro").exact.sel(pair="left-middle").item(), 4)
    0.0206
    """
    factors = behaviour or BehaviourFactors()
    scene, runs = uncoupled_runs(source, records, folders)
    closing = values(runs, "closing_max").where(~fell(runs))  # it may go on closing after the fall
    ends = _neighbours(scene, runs, factors)
    closest = closing.where(~(closing <= ROUND_OFF * (ends.left + ends.right)), 0.0)
    exact, reach = (closest + ends.thickness).max("storey"), closest.max("storey")
    rules = list(SEPARATION_RULES.values())
    index = labelled("rule", SEPARATION_RULES, "separation rule")
    rule_gap = xr.concat([(rule.gap(ends) + ends.thickness).max("storey") for rule in rules], dim=index)
    variables = {
        "closing": (closing, "m", "largest closing displacement"),
        "exact": (exact, "m", "exact required gap"),
        "never": ((reach == 0.0).where(reach.notnull()), "1", "1 where the pair never touches, 0 where it does"),
        "rule_gap": (rule_gap, "m", "required gap by the rule"),
        "ratio": (rule_gap / exact.where(exact > 0.0), "1", "required gap by the rule over the exact one"),
        "correlation": (ends.correlation, "1", "correlation of the first modes"),
    }
    result = xr.Dataset({name: described(*about, bare=True) for name, about in variables.items()})
    for name in ("name", "title", "formula", "clause", "edition", "note"):
        texts = [getattr(rule, name) for rule in rules]
        result.coords[f"rule_{name}"] = ("rule", texts, {"long_name": f"{name} of the rule"})
    gaps = [scene.gaps[pair] for pair in scene.pair_of_label]
    result.coords["row_gap"] = ("pair", gaps, {"units": "m", "long_name": "gap of the row"})
    if ends.thickness.any():
        result.coords["thickness"] = described(ends.thickness.max("storey"), "m", "thickness of bumpers")
    other = {name: str(value).strip("{}").replace("'", "") for name, value in vars(factors).items() if value != 1.0}
    words = [f"{name} = {value}" for name, value in other.items()]
    only = "others 1; right only if the motion was divided by them, else displacements are elastic"
    return result.assign_attrs(factors="; ".join([*words, only if words else "1 (elastic displacements)"]))


def _neighbours(scene: Scene, runs: xr.Dataset, factors: BehaviourFactors) -> xr.Dataset:
    """Return what rules are made of, on pair and storey: peaks of both floors, correlation, level, factors, bumpers."""
    labels = {"pair": list(scene.pair_labels)}
    floors = {**labels, "storey": np.arange(1, scene.n_storeys + 1)}
    shape = len(labels["pair"]), scene.n_storeys
    # at each side of what could meet: the shares of the floors that it moves with, those beside struck columns
    moves, thickness = np.zeros((2, *shape, scene.n_dof)), np.zeros(shape)
    for contact, thick in zip(scene.contacts, scene.thicknesses(), strict=True):
        at = contact.place, contact.storey - 1
        thickness[at] = thick
        for dof, share in contact.ends:
            moves[int(share < 0.0), *at, dof] += abs(share)
    of_dof = [(b, storey) for b, item in enumerate(scene.buildings) for storey in range(item.n_storeys)]
    building, storey = (xr.DataArray(list(numbers), dims="dof") for numbers in zip(*of_dof, strict=True))
    peaks = peak_displacement(runs).isel(building=building, storey=storey).reset_coords(drop=True)
    meets = xr.DataArray(moves.any((0, 3)), floors, ("pair", "storey"))
    left, right = (xr.dot(xr.DataArray(side, floors, ("pair", "storey", "dof")), peaks).where(meets) for side in moves)
    result = {"left": left, "right": right, "thickness": meets.copy(data=thickness)}
    names = [item.name for item in scene.buildings]
    modes = ("fundamental_period", "first_damping_ratio")
    if not {*modes} <= {*runs.coords}:
        raise InputError(
            f"separation rules need {' and '.join(modes)}, which this cube lacks; give a cube of 'pounding-sweep run'"
        )
    properties = {name: runs[name].reset_coords(drop=True) for name in modes}
    for name in vars(factors):
        properties[name] = xr.DataArray([factors.of(name, building) for building in names], dims="building")
    row = np.array([names.index(item.name) if isinstance(item, Building) else -1 for item in scene.row])
    sides = [xr.DataArray(row[np.add(scene.pair_of_label, side)], labels, ("pair",)) for side in (0, 1)]
    for end, side in zip(("left", "right"), sides, strict=True):
        for name, part in properties.items():
            result[f"{name}_{end}"] = part.isel(building=side).where(side >= 0, 1.0).reset_coords(drop=True)
    two = (sides[0] >= 0) & (sides[1] >= 0)
    level = [
        sum(contact.pair == pair and contact.struck < 0 and not contact.restrainer for contact in scene.contacts)
        == min(item.n_storeys for item in scene.row[pair : pair + 2] if isinstance(item, Building))
        for pair in scene.pair_of_label
    ]
    result["level"] = two & level
    correlation = cqc_correlation(*(result[f"{name}_{end}"] for name in modes for end in ("left", "right")))
    result["correlation"] = correlation.where(two, 0.0).transpose("pair", ...)
    return xr.Dataset(result)


#: Probabilities at which curves are given.
CURVE = tuple(np.geomspace(1e-3, 0.9, 30).tolist())
#: Parts of equal probability into which each of the two distributions behind an interval is cut.
_PARTS = 50
#: Endings of the names of a gap's, and of a rate's, numbers, and how they are had; what these numbers are.
_ENDS, _MEANINGS = (read_data("comparisons.toml")[key] for key in ("ends", "meanings"))


def gap_rows(result: xr.Dataset) -> list[Row]:
    """Return a row per gap that is asked for; with a hazard, also one per pair for the gap that it has."""
    years = float(result.attrs.get("years", math.nan))
    tables = {
        "gap": "intensity" if "intensity" in result.dims else "the suite as it is",
        "gap_in_years": f"in {years:g} years",
        "rate": "the row's gap",
    }
    stems = [stem for stem in tables if stem in result]
    others = [str(dim) for dim in result[stems[0]].dims if dim not in ("pair", "intensity", "probability")]
    first = ("given", *others, "pair", "probability", *(["rate"] if "rate" in result else []), "gap")
    about = {"units": result[stems[0]].attrs["units"], "over": over_text({"record": int(result.attrs["suite"])})}
    rows: list[Row] = []
    for stem in stems:
        names = {f"{stem}{end}": f"{stem.partition('_')[0]}{end}" for end in _ENDS}
        if stem == "rate":
            names |= {"beyond": "beyond", "row_gap": "gap"}
        elif stem == "gap_in_years":
            names |= {"more_than": "more than", "less_than": "less than", "falls": "share of falls"}
        names |= {"records": "records", "never": "never touches"}
        names = {name: heading for name, heading in names.items() if name in result.variables}
        for row in plain_rows(result.reset_coords()[[*names]].rename(names)):
            level, number = row.pop("intensity", None), row.pop("gap_number", None)
            given = tables[stem] if number is None else "the cube's gap"
            row["given"] = given if level is None else f"{given} {level:.4g} {result['intensity'].attrs['units']}"
            if stem == "gap_in_years":
                row["rate"] = -math.log1p(-row["probability"]) / years
            elif stem == "rate":
                row["probability"] = row["rate"] and -math.expm1(-row["rate"] * years)
            rows.append({name: row.get(name) for name in first} | row | about)
    return rows


def answers(result: xr.Dataset) -> str:
    """Say which gap each pair needs for each probability, and how likely its own touches; "" of several motions."""
    rows = gap_rows(result)
    row_gaps = {
        row["pair"]: f"; the {1e3 * row['gap']:g} mm of the file with {100 * row['probability']:.3g} %"
        for row in rows
        if row["given"] == "the row's gap" and row["probability"]
    }
    rows = [row for row in rows if row["given"].startswith("in " * ("gap_in_years" in result))]
    rows = [row for row in rows if row["gap"] or "more than" in row]
    pairs: dict[str, list[str]] = {}
    for row in rows:
        words = _gap_words(row, result.attrs)
        pairs.setdefault(row["pair"], []).append(f"{words} with {100 * row['probability']:g} %")
    texts = {pair: ", ".join(parts).replace(" with", " touch with", 1) for pair, parts in pairs.items()}
    when = f"probability{' given' * ('gap_in_years' not in result)}"
    lines = [f"{pair}: {text} {when} {rows[0]['given']}{row_gaps.get(pair, '')}" for pair, text in texts.items()]
    return "; ".join(lines) if len(rows) <= result.sizes.get("pair", 1) * result.sizes["probability"] else ""


def _gap_words(row: Row, about: Mapping[str, Any]) -> str:
    """Return a gap with its interval, or what is known where the runs of a cube do not go as far, and what to run."""
    low, gap, high = (row[name] and f"{1e3 * row[name]:.0f}" for name in ("gap_lower", "gap", "gap_upper"))
    if gap:
        return f"{gap} mm ({f'{low or 0} to {high}' if high else f'{low} or more'})"
    for side, place, way in (("more", 1, "above"), ("less", 0, "below")):
        if last := row[f"{side} than"]:
            end, motions = about["gaps"][place], f"{about['tried'][place]:.3g} {about['tried_units']}"
            add = f"add {f'gaps {way} {1e3 * end:g} mm' if last == end else f'motions {way} {motions}'} to the sweep"
            if side == "more" and row["share of falls"] > 0.5:
                add = f"{100 * row['share of falls']:.0f} % of the touches at the largest gap are falls alone"
            return f"{side} than {1e3 * last:g} mm ({add})"
    return "gaps unknown from these runs (add weaker or stronger motions to the sweep, or gaps)"


@comparison
def gap_for_probability(
    cube: xr.Dataset,
    probabilities: Sequence[float] = (0.5, 0.16, 0.1, 0.05, 0.02, 0.01),
    *,
    intensity: str | xr.DataArray | None = None,
    levels: Sequence[float] | None = None,
    behaviour: BehaviourFactors | None = None,
    hazard: Hazard | FilePath | None = None,
    years: float = 50.0,
    confidence: float = 0.95,
    curve: Sequence[float] = CURVE,
    records: Any = None,
    folders: Any = None,
) -> xr.Dataset:
    """Find the gap at which a pair touches under a given share of the motions that a suite stands for.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with the axis ``record``, or the result of `pounding_sweep.analysis.required_gap`; of a row that yields,
        with a hazard, one with contact and several gaps.
    probabilities : sequence of float
        Shares of the motions under which the pair may touch, in (0, 1).
    intensity : str or DataArray, optional
        As for `pounding_sweep.analysis.rebuild.intensity_of`: every record is taken as scaled to one intensity.
        Without it, the motions are those of the cube, at each of its scales.
    levels : sequence of float, optional
        Those intensities, in the hazard's own unit if there is one; by default the suite's median at each scale of the
        cube, of equal ones their own.
    behaviour : BehaviourFactors, optional
        As for `pounding_sweep.analysis.required_gap`.
    hazard : Hazard, str or path, optional
        How often intensities are exceeded at the site: a curve, its CSV file, or "k0=1e-3,kappa=2.5"; the intensity is
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
        On ``probability``, ``pair``, ``intensity`` or ``scale``, and building properties, all in m: ``gap`` by a
        lognormal distribution of the records' exact required gaps; ``gap_lower`` and ``gap_upper``, its confidence
        interval; ``gap_observed``, the fractile of the required gaps themselves. Beside them ``median`` (m) and
        ``dispersion``, ``records`` that count, and ``never``, those under which the pair never touches. With a hazard
        ``gap_in_years`` (and ``_lower``, ``_upper``, ``_observed``), the risk-targeted gaps; ``rate`` (and so on), how
        often a year the pair touches with the gap ``row_gap`` of the row; ``beyond``, the share of that rate from
        intensities beyond the hazard's; ``rule_gap``, the median of the gaps by each rule at the intensity that is
        exceeded with 10 % probability in 50 years. ``trial_gap`` are the required gaps, ``curve_...`` the same numbers
        along ``curve``. Missing with fewer than two records that count, and, but for what is observed, where a pair
        never touches under one of them.

    Raises
    ------
    InputError
        The cube has no several records, a required gap can't be had from it, gaps do not grow with the intensity, or a
        number or the hazard is not valid.

    Notes
    -----
    As for every required gap, all pairs must have theirs. Formulas, intervals and their sources: "Gap for a probability
    of pounding" in ``docs/comparisons.md``. The attribute ``answer`` says what to add to a sweep of a row that yields
    where its gaps do not reach a probability.

    Examples
    --------
    >>> import xarray as xr
    >>> exact = (("record", "pair"), [[0.01], [0.02], [0.04]])
    >>> gaps = xr.Dataset({"exact": exact}, {"pair": ["left-right"]}, {"comparison": "required-gap"})
    >>> gap_for_probability(gaps, [0.5]).gap.round(6).values.tolist()
    [[0.02]]
    """
    site = None if hazard is None else hazard_of(hazard)
    if site is not None and _row_yields(cube):
        if levels is not None or behaviour is not None:
            raise InputError(
                "of a row that yields, gaps for a hazard are those of its own runs; leave intensities (--given) and "
                "factors of rules out"
            )
        motions = {"intensity": intensity, "records": records, "folders": folders}
        strength = intensity_of(cube, **motions)
        context = check_site(site, cube, intensity, strength) | {"years": years, "confidence": confidence}
        targets = -np.log1p(-np.array([*probabilities, *curve])) / years
        gap_of, numbers = gaps_of_stripes(cube, site, strength, targets, confidence=confidence, **motions)
        stated, size = site.stated_unit if site.stated_unit[1] != 1.0 else (strength.attrs["units"], 1.0)
        context |= {
            "suite": cube.sizes.get("record", 1),
            "gaps": [gap_of["row_gap"].min().item(), gap_of["row_gap"].max().item()],
            "tried": [strength.where(strength > 0.0).min().item() / size, strength.max().item() / size],
            "tried_units": stated,
        }
        gap_of |= {
            name: gap_of[name].isel(probability=slice(len(probabilities))) for name in ("more_than", "less_than")
        }
        return _with_numbers(gap_of, numbers, probabilities, curve, context)
    gaps = cube
    if cube.attrs.get(scenarios.COMPARISON) != "required-gap":
        gaps = required_gap(cube, records, behaviour=behaviour, folders=folders)
    check_needs(gaps, "a gap for a probability", several=["record"])
    exact, level, units = gaps["exact"], xr.DataArray(1.0), ""
    attributes: dict[str, Any] = {"confidence": confidence, "suite": gaps.sizes["record"]}
    if intensity is not None or site is not None:
        strength = intensity_of(cube, intensity, records=records, folders=folders)
        if site is not None and site.stated_unit[1] != 1.0 and site.units == strength.attrs["units"]:
            stated, size = site.stated_unit
            strength = (strength / size).assign_attrs(strength.attrs | {"units": stated})
            site = replace(site, intensity=tuple(x / size for x in site.intensity), units=stated)
        name, units = strength.attrs["long_name"], strength.attrs["units"]
        attributes["intensity"] = f"{name} ({units})"
        exact = _per_intensity(exact, strength, cube)
        middles = np.atleast_1d(strength.median("record").values)
        at = sorted({float(f"{x:.12g}") for x in middles.tolist() if x > 0.0})
        level = labelled("intensity", at if levels is None else levels, name, units)
    elif levels is not None:
        raise InputError(
            "intensities are given, but not of what; add intensity='pga', or another measure (--intensity)"
        )
    if site is not None:
        attributes |= check_site(site, cube, intensity, strength) | {"years": years}
    bounds = 0.5 - 0.5 * confidence, 0.5 + 0.5 * confidence
    median, spread, count, never, gap, in_years, rate, beyond = xr.apply_ufunc(
        partial(_of_pair, (*probabilities, *curve), bounds, site, years),
        *(exact, gaps.coords.get("row_gap", np.nan)),
        input_core_dims=[["record"], []],
        output_core_dims=[[], [], [], [], ["number", "probability"], ["number", "probability"], ["number"], []],
        vectorize=True,
    )
    variables = {
        "trial_gap": described(exact * level, "m", "required gap of the record"),
        "median": described(median * level, "m", "median required gap"),
        "dispersion": described(spread, "1", "standard deviation of the logarithm of the required gap"),
        "records": described(count, "1", "records that count"),
        "never": described(never, "1", "records under which the pair never touches"),
    }
    if site is not None and "rule_gap" in gaps:
        design = float(site.factor_at(-math.log(0.9) / 50.0, np.ones(1)))  # what standards design for
        rules = _per_intensity(gaps["rule_gap"], strength, cube).median("record") * design
        about = f"exceeded with 10 % probability in 50 years, factors {gaps.attrs['factors']}"
        variables["rule_gap"] = described(
            rules, "m", f"strokes: gaps by rules, median at {design:.3g} {units}, {about}"
        )
    numbers = {"gap": gap * level}
    if site is not None:
        numbers["gap_in_years"] = in_years
        if "row_gap" in gaps.coords:
            numbers["rate"] = rate
            variables["beyond"] = described(beyond, "1", "share of the rate from intensities beyond the hazard's")
    return _with_numbers(variables, numbers, probabilities, curve, attributes)


def _with_numbers(
    variables: dict[str, xr.DataArray],
    numbers: Mapping[str, xr.DataArray],
    probabilities: Sequence[float],
    curve: Sequence[float],
    attributes: Mapping[str, Any],
) -> xr.Dataset:
    """Return a result with gaps and rates, each with its ends, and the answer in words."""
    n = len(probabilities)
    for stem, parts in numbers.items():
        for end, part in zip(_ENDS, parts.transpose("number", "probability", ..., missing_dims="ignore"), strict=False):
            name, units = f"{stem}{end}", "year-1" if stem == "rate" else "m"
            array = described(part, units, f"{_MEANINGS[stem]}, {_ENDS[end]}")
            if stem != "rate" and name != "gap_observed":
                variables[f"curve_{name}"] = array.isel(probability=slice(n, None)).rename(probability="curve")
            variables[name] = array.isel({"probability": slice(n)}, missing_dims="ignore")
    shares = {"probability": probabilities, "curve": curve}
    coords = {dim: labelled(dim, part, "probability that the pair touches", "1") for dim, part in shares.items()}
    result = xr.Dataset(variables, coords, attributes)
    return result.assign_attrs(answer=answers(result))


def _row_yields(cube: xr.Dataset) -> bool:
    """Whether a cube says that a storey of its row yields."""
    return "sweep" in cube.attrs and any(stored_scene(cube).yields)


def _per_intensity(exact: xr.DataArray, strength: xr.DataArray, cube: xr.Dataset) -> xr.DataArray:
    """Return required gaps per intensity, which they must grow with, of scales of both signs along ``direction``."""
    if _row_yields(cube):
        raise InputError(
            "required gaps of a row that yields do not grow in proportion to the intensity, so that those at others "
            "can't be told; leave the intensity out, for gaps at each scale of the cube, or add a hazard, for those of "
            "its runs with contact"
        )
    if "thickness" in exact.coords:
        raise InputError(
            "bumpers take their thickness of the gap, so that the required gap does not grow in proportion to the "
            "intensity; leave them out of the row, and add their thickness to the gap that is found"
        )
    ratio = exact / strength.where(strength > 0.0)
    dim = next((dim for dim in DIMENSIONS["scale"] if dim in ratio.dims), None)
    if dim is None:
        return ratio
    ways = {"as recorded": ratio[dim] > 0.0, "reversed": ratio[dim] < 0.0}
    names = [name for name, way in ways.items() if way.any()]
    parts = xr.concat([ratio.where(ways[name]) for name in names], labelled("direction", names, "ground motion"))
    wrong = parts.max(dim) - parts.min(dim) > 1e-3 * parts.max(dim)  # beyond errors of their runs
    if wrong.any():
        record = str(wrong["record"][wrong.any([dim for dim in wrong.dims if dim != "record"])].values[0])
        raise InputError(
            f"required gaps of record {record!r} do not grow in proportion to its scale, so that those at other "
            "intensities can't be told; leave the intensity out, for gaps at each scale of the cube"
        )
    return parts.mean(dim).squeeze("direction", drop=True) if len(names) == 1 else parts.mean(dim)


@lru_cache
def _deviates(shares: Sequence[float], bounds: Sequence[float], n: int) -> np.ndarray:
    """Return the normal quantile for each share, and the ends of its interval of n records, shape (3, shares)."""
    from scipy.stats import nct, norm

    z = norm.isf(shares)
    return np.stack([z, *(nct.ppf(bound, n - 1, z * n**0.5) / n**0.5 for bound in bounds)])


def _of_pair(
    shares: Sequence[float],
    bounds: Sequence[float],
    site: Hazard | None,
    years: float,
    exact: np.ndarray,
    row_gap: float,
) -> tuple[Any, ...]:
    """Return median, dispersion, counts, gaps and rates of a pair: by the lognormal, its interval, and the records."""
    from scipy.stats import chi2, norm

    exact = exact[np.isfinite(exact)]
    n, never, probability = exact.size, int((exact <= 0.0).sum()), np.array(shares)
    gaps, rates = np.full((2, len(_ENDS), len(shares)), np.nan), np.full(len(_ENDS), np.nan)
    middle = spread = beyond = np.nan
    if n > 1 and not never:
        middle, spread = np.log(exact).mean(), np.log(exact).std(ddof=1)
        gaps[0, :3] = np.exp(middle + spread * _deviates(shares, bounds, n))
    if n:
        gaps[0, 3] = np.where(probability * n >= 1.0, np.quantile(exact, 1.0 - probability), np.nan)
    if n and site is not None:
        rate, degrees, parts = -np.log1p(-probability) / years, max(n - 1, 1), (np.arange(_PARTS) + 0.5) / _PARTS
        spreads = spread * np.sqrt(degrees / chi2.ppf(parts, degrees))[None, :]
        away = norm.ppf(parts)[:, None] * spreads / n**0.5  # what the middle may miss by
        drawn = middle + away + np.log(site.median_at(*np.broadcast_arrays(rate[:, None, None], spreads)))
        with np.errstate(divide="ignore"):
            capacities = 1.0 / exact
        gaps[1, 0] = np.exp(middle) * site.median_at(rate, np.full(rate.shape, spread))
        gaps[1, 1:3] = np.exp(np.quantile(drawn.reshape(rate.size, -1), bounds, axis=1))
        gaps[1, 3] = site.factor_at(rate, capacities)
        if row_gap > 0.0:
            median = row_gap / np.exp(middle)
            rates[1:3] = np.quantile(site.touching(median / np.exp(away), spreads), bounds)
            rates[0], beyond = (float(part(median, np.array(spread))) for part in (site.touching, site.beyond))
            rates[3] = site.exceeded(row_gap * capacities).mean()
    return np.exp(middle), spread, n, never, *gaps, rates, beyond
