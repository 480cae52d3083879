"""What of the paper is reproduced: Tables 3 to 6 side by side, impossible numbers, conclusions i to v, the verdict.

The paper gives no numbers for "more or less the same" or "drastically"; the limits below are this package's, and no
cube changes them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import groupby, product

import numpy as np
import xarray as xr

from pounding_sweep.analysis.comparisons.contacts import energy_transfer
from pounding_sweep.model.laws import LAWS, MATE2015_MODELS
from pounding_sweep.outputs.variables import get_variable
from pounding_sweep.paper.published import READINGS, published, record_title

#: Differences up to these count as agreement, in summaries.
CLOSE = (0.1, 0.25)
#: In place of a record, in summaries: all together.
ALL = "all"
#: How outputs are written: heading, factor, unit, digits.
_WRITTEN = {
    "displacement_max": ("forth", 1e3, "mm", 1),
    "displacement_min": ("back", 1e3, "mm", 1),
    "impact_force_max": ("peak force", 1.0, "kN", 0),
    "impact_count": ("impacts", 1.0, "", 0),
    "energy_transfer_max": ("given at most", 1.0, "kN m", 1),
    "energy_transfer_min": ("received at most", 1.0, "kN m", 1),
}
_SOURCES = {"sap2000": "paper, SAP2000", "matlab": "paper, MATLAB", "paper": "paper"}


@dataclass(frozen=True)
class Grid:
    """A table as text."""

    title: str  # above it
    headings: Sequence[tuple[str, str]]  # group and heading of each column
    rows: Sequence[Sequence[str]]  # cells

    @property
    def groups(self) -> list[tuple[str, int]]:
        """Groups of the headings with their widths; none where no heading has one."""
        groups = [(group, len(list(columns))) for group, columns in groupby(self.headings, key=lambda pair: pair[0])]
        return groups if any(group for group, _ in groups) else []


def ungrouped(*texts: str) -> list[tuple[str, str]]:
    """Return headings without groups."""
    return [("", text) for text in texts]


def side_by_side(number: int, cube: xr.Dataset) -> xr.Dataset:
    """Put a table of the paper beside the same outputs of both readings."""
    table = published(number)
    table = table.sel(record=[name for name in table["record"].values if name in cube["record"].values])
    computed = cube[list(table.data_vars)].sel(record=table["record"].values)
    computed = computed.sel(law=table["law"].values) if "law" in table.dims else computed.sel(law="linear", drop=True)
    if "program" in table.dims:
        sources, paper = table.rename(program="source"), table.sel(program="matlab", drop=True)
    else:
        sources, paper = table.expand_dims(source=["paper"]), table
    values = xr.concat([sources, computed.rename(reading="source")], "source", combine_attrs="drop_conflicts")
    difference = computed / paper.where(paper != 0) - 1.0
    for name, off in difference.data_vars.items():
        long_name = f"{get_variable(str(name)).long_name}, over the paper's, less 1"
        values[f"{name}_difference"] = off.assign_attrs(units="1", long_name=long_name)
    return values.assign_attrs(table.attrs)


def outputs_of(compared: xr.Dataset) -> list[str]:
    """Return the outputs that a table of `side_by_side` compares."""
    return [name for name in _WRITTEN if name in compared]


def paper_source(compared: xr.Dataset) -> str:
    """Return the source that a table of `side_by_side` compares with."""
    return "matlab" if "matlab" in compared["source"].values else "paper"


def table_grid(compared: xr.Dataset) -> Grid:
    """Write a table of `side_by_side` as text, one row per place."""
    places = [dim for dim in ("law", "record", "building", "pair", "storey") if dim in compared.dims]
    stacked = compared.stack(place=places)
    columns = [
        (("", dim.replace("law", "model")), [_label(dim, value) for value in stacked[dim].values]) for dim in places
    ]
    for name, source in product(outputs_of(compared), compared["source"].values.tolist()):
        what, _, unit, _ = _WRITTEN[name]
        group = f"{what} ({unit})" if unit else what
        numbers = [_number(name, value) for value in stacked[name].sel(source=source).values]
        columns.append(((group, READINGS[source].label if source in READINGS else _SOURCES[source]), numbers))
        if source in READINGS:
            off = stacked[f"{name}_difference"].sel(reading=source).values
            columns.append(((group, "difference"), ["-" if np.isnan(value) else f"{value:+.0%}" for value in off]))
    headings, cells = zip(*columns, strict=True)
    return Grid(str(compared.attrs["title"]), headings, [list(row) for row in zip(*cells, strict=True)])


def agreement(compared: xr.Dataset) -> Grid:
    """Sum up a table of `side_by_side`: how near each reading comes to the paper, over all records and by record."""
    headings = ungrouped("output", "reading", "record", "cells", "median difference")
    headings += [("cells that agree", f"within {share:.0%}") for share in CLOSE]
    headings += ungrouped("zero in one of the two alone")
    rows = []
    readings, records = compared["reading"].values.tolist(), compared["record"].values.tolist()
    for name, reading, record in product(outputs_of(compared), readings, [ALL, *records]):
        one = compared if record == ALL else compared.sel(record=record)
        difference = one[f"{name}_difference"].sel(reading=reading).values
        paper, computed = (one[name].sel(source=source).values for source in (paper_source(compared), reading))
        off = np.abs(difference[np.isfinite(difference)])
        shares = [f"{int((off <= share).sum())} of {off.size}" for share in CLOSE]
        one_zero = int((np.isfinite(computed) & ((paper == 0) != (np.abs(computed) < resolution(name)))).sum())
        place = [_WRITTEN[name][0], READINGS[reading].label, _label("record", record)]
        rows.append([*place, str(paper.size), f"{np.median(off):.0%}" if off.size else "-", *shares, str(one_zero)])
    return Grid(f"Agreement with {compared.attrs['title'].partition(':')[0]}", headings, rows)


def resolution(name: str) -> float:
    """Half a unit of the last digit that is written: less is zero."""
    _, factor, _, digits = _WRITTEN[name]
    return float(0.5 * 10.0**-digits / factor)


def _number(name: str, value: float) -> str:
    _, factor, _, digits = _WRITTEN[name]
    return "-" if np.isnan(value) else f"{round(value * factor, digits) + 0.0:.{digits}f}"  # no -0


def _label(dim: str, value: object) -> str:
    if dim == "law":
        return LAWS[str(value)].model
    return record_title(str(value)) if dim == "record" and value != ALL else str(value)


@dataclass(frozen=True)
class Check:
    """One check of the energies of one reading."""

    text: str  # what must be
    reading: str  # key of the reading
    value: float  # the largest departure from it, over all scenarios (kN m)
    scale: float  # what it is to be compared with (kN m)


def energy_checks(cube: xr.Dataset) -> list[Check]:
    """Check the energy balance of every scenario."""
    transfer, work = energy_transfer(cube), cube["contact_work"].fillna(0.0)
    alone = cube.sel(law="none")
    of_alone = [transfer.sel(law="none"), alone["energy_transfer_max"], alone["energy_transfer_min"]]
    departures: dict[str, list[xr.DataArray]] = {
        "the buildings' transfers sum to the work of the contacts, in every scenario": [
            transfer.sum("building") - work.sum("pair")
        ],
        "the linear spring (Model I) takes in no work over a contact": [work.sel(law="linear")],
        "without pounding (Model VII) no building transfers energy": of_alone,
        "no contact gives energy: its work is not negative": [work.clip(max=0.0)],
    }
    return [
        Check(
            text,
            reading,
            max(float(abs(part.sel(reading=reading)).max()) for part in parts),
            float(cube["energy_input"].sel(reading=reading).max()),
        )
        for reading in cube["reading"].values.tolist()
        for text, parts in departures.items()
    ]


@dataclass(frozen=True)
class Finding:
    """One thing that can't be, or hardly."""

    title: str  # what is wrong, in one line
    printed: str  # what the table says
    why: str  # why it can't be
    computed: str  # what the computed cubes say in its place
    impossible: bool = True  # rather than hardly possible


def silent_models(table: xr.Dataset) -> dict[str, list[str]]:
    """Return by record the laws of Table 5 that have no impact where another law has some."""
    count = table["impact_count"].sum(["pair", "storey"])
    count = count.sel(record=(count > 0).any("law") & (count == 0).any("law")).transpose("record", "law")
    return {str(one["record"].item()): one["law"].values[one.values == 0].tolist() for one in count}


def unbalanced(released: xr.DataArray, received: xr.DataArray) -> xr.DataArray:
    """Where some building receives more than all others together ever give."""
    others = released.sum("building") - released
    return (-received > others + 1e-6 * np.abs(received)).any("building")


def findings(cube: xr.Dataset) -> list[Finding]:
    """List what is impossible in the paper's tables."""
    five, six, pounding = published(5), published(6), cube.drop_sel(law="none")
    silent = []
    for record, laws in silent_models(five).items():
        models = " and ".join(LAWS[law].model for law in laws)
        most = int(five["impact_count"].sel(record=record).max())
        silent.append(f"{record_title(record)}: Models {models} have none, another has {most} at one floor")
    first = pounding["first_impact_time"].min(["pair", "storey"])
    apart = float((first.max("law") - first.min("law")).max())
    valued = pounding["impact_count"].notnull().all(["pair", "storey"])

    alone = six.sel(law="none")
    least = alone["energy_transfer_min"]
    receiving = int(((least != 0) | (alone["energy_transfer_max"] != 0)).sum())
    transfer = float(np.abs(energy_transfer(cube.sel(law="none"))).max())
    scale = float(cube["energy_input"].sel(law="none").max())

    wrong = unbalanced(six["energy_transfer_max"], six["energy_transfer_min"])
    unequal = unbalanced(pounding["energy_transfer_max"], pounding["energy_transfer_min"])
    balanced = pounding["energy_transfer_max"].notnull().all("building")

    force = five["impact_force_max"]
    ratio, computed = (
        one.sel(law="nonlinear_viscoelastic") / one.sel(law="hertz_damped").where(lambda values: values > 0)
        for one in (force, cube["impact_force_max"])
    )
    ratio = ratio.stack(cell=("record", "pair", "storey")).dropna("cell")
    ratio = ratio.sortby(ratio)
    record, pair, storey = ratio["cell"].values[-1]
    misprint = float(force.sel(record=record, pair=pair, storey=storey, law="nonlinear_viscoelastic"))
    largest = [
        f"{float(computed.sel(reading=key).max()):.2f} ({READINGS[key].label})"
        for key in cube["reading"].values.tolist()
    ]
    return [
        Finding(
            "Models without a first impact",
            "Table 5. " + "; ".join(silent) + ".",
            "Until floors meet for the first time no contact force acts, so all models share one motion: they touch at "
            "the same instant or not at all.",
            f"Floors meet in {int(first.notnull().sum())} of {int(valued.sum())} scenarios with pounding; over the "
            f"models of a record the first impact differs by {apart:.1g} s at most.",
        ),
        Finding(
            "Energy transferred without contact",
            f"Table 6, Model VII: {receiving} of {least.size} buildings receive or give energy, up to "
            f"{-float(least.min()):g} kN m.",
            "Model VII has no contact: nothing can be received from anyone.",
            f"At most {transfer:.1g} kN m remain of an input of up to {scale:.0f} kN m: the error of the time "
            "integration.",
        ),
        Finding(
            "All receive, none gives",
            f"Table 6: in {int(wrong.sum())} of {wrong.size} rows a building receives more than the other two ever "
            "give.",
            "The buildings' transfers sum to the work that the contacts take in, which no passive contact makes "
            "negative: what one building has received, the others have given.",
            f"This is so in {int((~unequal & balanced).sum())} of {int(balanced.sum())} computed scenarios with "
            "pounding.",
        ),
        Finding(
            "A probable misprint",
            f"Table 5, {record_title(record)}, {pair}, storey {storey}, Model VI: {misprint:.0f} kN, "
            f"{float(ratio[-1]):.1f} times Model V.",
            f"Not impossible, but alone: the next largest ratio of Model VI to Model V is {float(ratio[-2]):.1f}, "
            f"the median {float(ratio.median()):.1f}.",
            f"The largest computed ratio of the two is {' and '.join(largest)}.",
            impossible=False,
        ),
    ]


#: A claim holds where it is true in this share of its cases; it holds partly down to the second share.
HOLDS_SHARE, PARTLY_SHARE = 0.9, 0.5
#: Peak displacements this near to the median of the models are more or less the same.
SAME_DISPLACEMENT = 0.10
#: Peak forces whose largest is at most this multiple of the smallest are the same.
SAME_FORCE = 1.25
#: Numbers of impacts differ little up to this many, or this share of the largest.
SAME_COUNT, SAME_COUNT_SHARE = 2, 0.25
#: A spectrum whose peak grows by this factor grows drastically.
DRASTIC = 1.5
#: A spectrum is spread over the periods at which it is above this share of its peak, on a logarithmic axis ...
SPREAD_LEVEL = 0.5
#: ... and its spread grows significantly where it grows by this factor.
SPREAD_FACTOR = 1.5

_POUNDING = list(MATE2015_MODELS[:-1])
_LINEAR = [key for key in _POUNDING if LAWS[key].exponent == 1.0]
_NONLINEAR = [key for key in _POUNDING if LAWS[key].exponent == 1.5]
_DAMPED = ["hertz_damped", "nonlinear_viscoelastic"]
_FLOORS = "Cases: records, pairs and storeys"


class Verdict(StrEnum):
    """What became of a claim or a conclusion."""

    HOLDS = "holds"
    PARTLY = "holds partly"
    FAILS = "does not hold"
    UNTESTED = "not tested"


@dataclass(frozen=True)
class Support:
    """How often a claim is true."""

    held: int  # cases in which it is true, of how many
    cases: int
    numbers: str  # the values that decided, in words

    @property
    def verdict(self) -> Verdict:
        """Verdict by the share of cases; not tested where there is none."""
        if not self.cases:
            return Verdict.UNTESTED
        share = self.held / self.cases
        return Verdict.HOLDS if share >= HOLDS_SHARE else Verdict.PARTLY if share >= PARTLY_SHARE else Verdict.FAILS


@dataclass(frozen=True)
class Claim:
    """A part of a conclusion that can be true or false."""

    text: str  # the claim, in this package's words
    criterion: str  # when it is true, and what a case is
    test: Callable[[xr.Dataset, xr.Dataset], Support]  # of the outputs of one reading, and floor spectra of the roofs


@dataclass(frozen=True)
class Conclusion:
    """A conclusion of the paper."""

    key: str  # its number
    text: str  # in this package's words
    claims: tuple[Claim, ...]  # what it says, part by part


@dataclass(frozen=True)
class Judgement:
    """A conclusion, judged for one reading."""

    conclusion: Conclusion
    reading: str
    outcomes: tuple[Support, ...]

    @property
    def verdict(self) -> Verdict:
        """Verdict over all claims; see `overall`."""
        return overall([outcome.verdict for outcome in self.outcomes])


def overall(verdicts: Sequence[Verdict]) -> Verdict:
    """Sum up claims: a conclusion holds if all that were tested hold, fails if all fail, else holds partly."""
    tested = {verdict for verdict in verdicts if verdict is not Verdict.UNTESTED}
    if not tested:
        return Verdict.UNTESTED
    return tested.pop() if len(tested) == 1 else Verdict.PARTLY


def judge(cube: xr.Dataset, spectra: xr.Dataset) -> list[Judgement]:
    """Test every conclusion on every reading."""
    return [
        Judgement(
            conclusion,
            reading,
            tuple(claim.test(cube.sel(reading=reading), spectra.sel(reading=reading)) for claim in conclusion.claims),
        )
        for conclusion in CONCLUSIONS.values()
        for reading in cube["reading"].values.tolist()
    ]


def _support(values: xr.DataArray, true: xr.DataArray, numbers: str) -> Support:
    """Count the cases, those that have a value, in which a claim is true; `numbers` names statistics of the values."""
    valid = values.notnull()
    if not valid.any():
        return Support(0, 0, "no case")
    statistics = {"median": float(values.median()), "least": float(values.min()), "most": float(values.max())}
    return Support(int((true & valid).sum()), int(valid.sum()), numbers.format(**statistics))


def _peaks(one: xr.Dataset, laws: list[str]) -> xr.DataArray:
    """Absolute peak displacements (m) both ways, on ``law``, ``record``, ``building``, ``storey``, ``way``."""
    return abs(xr.concat([one["displacement_max"], one["displacement_min"]], "way")).sel(law=laws)


def _force_ratio(one: xr.Dataset, above: list[str], below: list[str]) -> xr.DataArray:
    """Largest peak force of some laws over the smallest of others, at the floors at which all of them touch."""
    top, bottom = (one["impact_force_max"].sel(law=laws) for laws in (above, below))
    touching = (top > 0).all("law") & (bottom > 0).all("law")
    return top.max("law").where(touching) / bottom.min("law")


def _same_displacements(off: xr.DataArray, numbers: str) -> Support:
    return _support(off, off <= SAME_DISPLACEMENT, f"{numbers} {{most:.0%}}, median over the cases {{median:.0%}}")


def _less_force(ratio: xr.DataArray, numbers: str) -> Support:
    return _support(ratio, ratio < 1.0, numbers)


def _same_forces(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    ratio = _force_ratio(one, _LINEAR, _LINEAR)
    return _support(ratio, ratio <= SAME_FORCE, "largest over smallest: median {median:.2f}, at most {most:.2f}")


def _shear_turns(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    shear = one["storey_shear_max"].isel(building=-1)
    ratio = shear.isel(storey=-1) / shear.isel(storey=-2)
    pounding, alone = ratio.sel(law=_POUNDING), ratio.sel(law="none")
    numbers = (
        f"top over storey below: up to {float(pounding.max()):.2f} with pounding, above 1 in "
        f"{int((pounding > 1.0).sum())} of {pounding.size} scenarios; up to {{most:.2f}} without"
    )
    return _support(alone, (pounding.max("law") > 1.0) & (alone <= 1.0), numbers)


def _same_counts(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    count = one["impact_count"].sel(law=_LINEAR)
    most = count.max("law")
    span = (most - count.min("law")).where(most > 0)
    numbers = f"largest difference {{most:.0f}} impacts of {int(count.max())} at most"
    return _support(span, span <= np.maximum(SAME_COUNT, SAME_COUNT_SHARE * most), numbers)


def _spectra_grow(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    ordinates = spectra["pseudo_acceleration"]
    pounding, alone = ordinates.sel(law=_POUNDING), ordinates.sel(law="none")
    ratio = pounding.max("period") / alone.max("period")
    numbers = (
        "peak over that without pounding: median {median:.2f}, {least:.2f} to {most:.2f}; at single periods up to "
        f"{float((pounding / alone).max()):.1f} times"
    )
    return _support(ratio, ratio >= DRASTIC, numbers)


def spread(spectra: xr.DataArray) -> xr.DataArray:
    """Width (natural logarithm of periods) over which spectra are above `SPREAD_LEVEL` of their own peak."""
    width = spectra["period"].copy(data=np.gradient(np.log(spectra["period"].values)))
    return width.where(spectra >= SPREAD_LEVEL * spectra.max("period"), 0.0).sum("period")


def _spectra_spread(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    width = spread(spectra["pseudo_acceleration"])
    ratio = width.sel(law=_POUNDING) / width.sel(law="none")
    numbers = "spread over that without pounding: median {median:.2f}, up to {most:.2f}"
    return _support(ratio, ratio >= SPREAD_FACTOR, numbers)


#: The paper's conclusions by number.
CONCLUSIONS = {
    conclusion.key: conclusion
    for conclusion in (
        Conclusion(
            "i",
            "The contact model hardly matters for peak displacements.",
            (
                Claim(
                    "Peak displacements are more or less the same under Models I to VI.",
                    f"No model is further than {SAME_DISPLACEMENT:.0%} from the median of the six. Cases: records, "
                    "floors, both ways.",
                    lambda one, _: _same_displacements(
                        abs(_peaks(one, _POUNDING) / _peaks(one, _POUNDING).median("law") - 1.0).max("law"),
                        "largest departure",
                    ),
                ),
            ),
        ),
        Conclusion(
            "ii",
            "In the right building, the most flexible as printed, pounding can bring more shear into the top storey "
            "than into the one below.",
            (
                Claim(
                    "With pounding the top storey's shear may exceed that of the storey below, without it does not.",
                    "It does under at least one of Models I to VI, and does not under Model VII. Cases: records.",
                    _shear_turns,
                ),
            ),
        ),
        Conclusion(
            "iii",
            "Contact elements with a linear spring give the same impacts; nonlinear ones with damping give less force.",
            (
                Claim(
                    "Models I to III give the same peak forces.",
                    f"Largest at most {SAME_FORCE:g} times the smallest. {_FLOORS} that touch in all three.",
                    _same_forces,
                ),
                Claim(
                    "Models I to III give the same numbers of impacts.",
                    f"They differ by at most {SAME_COUNT}, or {SAME_COUNT_SHARE:.0%} of the largest. {_FLOORS} that "
                    "touch in any.",
                    _same_counts,
                ),
                Claim(
                    "Models V and VI give less force than the undamped Model IV.",
                    f"Both less than Model IV. {_FLOORS} that touch in all three.",
                    lambda one, _: _less_force(
                        _force_ratio(one, _DAMPED, ["hertz"]),
                        "the larger of V and VI over IV: median {median:.2f}, at most {most:.2f}",
                    ),
                ),
            ),
        ),
        Conclusion(
            "iv",
            "Nonlinear springs give smaller impact forces than linear ones, at the same displacements.",
            (
                Claim(
                    "Models IV to VI give less force than Models I to III.",
                    f"The largest of IV to VI is below the smallest of I to III. {_FLOORS} that touch in all six.",
                    lambda one, _: _less_force(
                        _force_ratio(one, _NONLINEAR, _LINEAR),
                        "largest of IV to VI over smallest of I to III: median {median:.2f}, {least:.2f} to {most:.2f}",
                    ),
                ),
                Claim(
                    "Peak displacements are the same under both kinds.",
                    f"Medians of IV to VI and of I to III differ by {SAME_DISPLACEMENT:.0%} at most. Cases: records, "
                    "floors, both ways.",
                    lambda one, _: _same_displacements(
                        abs(_peaks(one, _NONLINEAR).median("law") / _peaks(one, _LINEAR).median("law") - 1.0),
                        "largest difference",
                    ),
                ),
            ),
        ),
        Conclusion(
            "v",
            "Pounding raises floor spectra drastically and spreads their peak over a long range of periods.",
            (
                Claim(
                    "Pounding raises the peak of the roofs' acceleration spectra drastically.",
                    f"Peak at least {DRASTIC:g} times that of Model VII. Cases: Models I to VI, records, buildings.",
                    _spectra_grow,
                ),
                Claim(
                    "With pounding the peak is spread over a longer range of periods.",
                    f"The range of periods (logarithm) above {SPREAD_LEVEL:.0%} of the spectrum's own peak is at least "
                    f"{SPREAD_FACTOR:g} times that of Model VII. Cases: Models I to VI, records, buildings.",
                    _spectra_spread,
                ),
            ),
        ),
    )
}

#: What the tables hold, in words, and the outputs that are it.
_CONTENTS: dict[int, dict[str, tuple[str, ...]]] = {
    3: {"displacements": ("displacement_max", "displacement_min")},
    4: {"peak forces": ("impact_force_max",), "impacts": ("impact_count",)},
    5: {"peak forces": ("impact_force_max",), "impacts": ("impact_count",)},
    6: {"energies transferred": ("energy_transfer_max", "energy_transfer_min")},
}
#: Verdicts of claims in this verdict's words.
_WORDS = {
    Verdict.HOLDS: "Reproduced",
    Verdict.PARTLY: "Reproduced in part",
    Verdict.FAILS: "Not reproduced",
    Verdict.UNTESTED: "Not tested",
}
#: When something is reproduced.
RULE = (
    f"Numbers of a table are reproduced where {HOLDS_SHARE:.0%} of those that are not zero in both are within "
    f"{CLOSE[-1]:.0%}, in part from {PARTLY_SHARE:.0%}; a conclusion is where it holds."
)


@dataclass(frozen=True)
class Reproduction:
    """What is reproduced, or is not, of one reading; or what can't be."""

    word: str
    reading: str
    items: tuple[str, ...]


def table_outcome(compared: xr.Dataset, names: Sequence[str], reading: str) -> Support:
    """Count the cells of a table of `side_by_side`, not zero in both, that a reading comes near to."""
    held = cases = 0
    for name in names:
        printed, computed = (compared[name].sel(source=source).values for source in (paper_source(compared), reading))
        cell = np.isfinite(computed) & ((printed != 0.0) | (np.abs(computed) >= resolution(name)))
        near = np.abs(computed - printed) <= CLOSE[-1] * np.abs(printed)
        held, cases = held + int((near & cell).sum()), cases + int(cell.sum())
    return Support(held, cases, f"{held} of {cases} numbers within {CLOSE[-1]:.0%}")


def verdict_of_all(
    compared: Mapping[int, xr.Dataset], judgements: Sequence[Judgement], impossible: Sequence[str]
) -> list[Reproduction]:
    """Return what the report opens with; `compared` are the tables side by side by their number."""
    parts = []
    for reading in compared[3]["reading"].values.tolist():
        items_by_verdict: dict[Verdict, list[str]] = {verdict: [] for verdict in _WORDS}
        for number, contents in _CONTENTS.items():
            for what, names in contents.items():
                outcome = table_outcome(compared[number], names, reading)
                items_by_verdict[outcome.verdict].append(f"{what} of Table {number} ({outcome.numbers})")
        for one in judgements:
            if one.reading == reading:
                items_by_verdict[one.verdict].append(f"conclusion {one.conclusion.key}: {one.conclusion.text}")
        parts += [
            Reproduction(_WORDS[verdict], READINGS[reading].label, tuple(items) or ("nothing",))
            for verdict, items in items_by_verdict.items()
            if items or verdict is not Verdict.UNTESTED
        ]
    return [*parts, Reproduction("Can't be", "in the paper itself", tuple(impossible))]


def opening_grid(parts: Sequence[Reproduction]) -> Grid:
    """Write the verdict, a row for each item."""
    rows = [
        [part.word, part.reading, item] if item is part.items[0] else ["", "", item]
        for part in parts
        for item in part.items
    ]
    return Grid("The verdict", ungrouped("verdict", "reading", "what"), rows)


def verdict_grid(judgements: Sequence[Judgement]) -> Grid:
    """Write the verdicts: one row per conclusion and reading, and one per claim."""
    rows = []
    for judgement in judgements:
        label = READINGS[judgement.reading].label
        rows.append([judgement.conclusion.key, label, judgement.verdict.value, "", judgement.conclusion.text])
        for claim, outcome in zip(judgement.conclusion.claims, judgement.outcomes, strict=True):
            cases = f"{outcome.held}/{outcome.cases}"
            rows.append(["", "", outcome.verdict.value, cases, f"{claim.text} {outcome.numbers}"])
    headings = ungrouped("", "reading", "verdict", "cases", "conclusion, and its claims with the numbers")
    return Grid("The paper's conclusions", headings, rows)
