"""The paper's conclusions i to v, each tested against computed cubes by criteria that stand here, and the verdict.

The paper gives no numbers for "more or less the same" or "drastically"; the limits below are this package's, and no
cube changes them. The verdict says what of the paper is reproduced, what is not, and what can't be.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
import xarray as xr

from pounding_sweep.model.laws import LAWS, MATE2015_MODELS
from pounding_sweep.paper.compare import CLOSE, Grid, paper_source, resolution, ungrouped
from pounding_sweep.paper.readings import READINGS

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


#: (outputs of one reading, floor spectra of the roofs) -> `Support`
Test = Callable[[xr.Dataset, xr.Dataset], Support]


@dataclass(frozen=True)
class Claim:
    """A part of a conclusion that can be true or false."""

    text: str  # the claim, in this package's words
    criterion: str  # when it is true, and what a case is
    test: Test


@dataclass(frozen=True)
class Conclusion:
    """A conclusion of the paper."""

    key: str  # its number
    text: str  # in this package's words
    claims: list[Claim] = field(default_factory=list)  # what it says, part by part

    def claim(self, text: str, criterion: str) -> Callable[[Test], Test]:
        """Add the function that it is put on as the test of a claim."""

        def add(test: Test) -> Test:
            self.claims.append(Claim(text, criterion, test))
            return test

        return add


#: The paper's conclusions by number.
CONCLUSIONS = {
    key: Conclusion(key, text)
    for key, text in {
        "i": "The contact model hardly matters for peak displacements.",
        "ii": "In the right building, the most flexible as printed, pounding can bring more shear into the top storey "
        "than into the one below.",
        "iii": "Contact elements with a linear spring give the same impacts; nonlinear ones with damping give less "
        "force.",
        "iv": "Nonlinear springs give smaller impact forces than linear ones, at the same displacements.",
        "v": "Pounding raises floor spectra drastically and spreads their peak over a long range of periods.",
    }.items()
}


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
            str(reading),
            tuple(claim.test(cube.sel(reading=reading), spectra.sel(reading=reading)) for claim in conclusion.claims),
        )
        for conclusion in CONCLUSIONS.values()
        for reading in cube["reading"].values
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


def _forces(one: xr.Dataset, laws: list[str]) -> xr.DataArray:
    """Peak forces (kN) of some laws, at the floors at which all of them touch."""
    force = one["impact_force_max"].sel(law=laws)
    return force.where((force > 0).all("law"))


@CONCLUSIONS["i"].claim(
    "Peak displacements are more or less the same under Models I to VI.",
    f"No model is further than {SAME_DISPLACEMENT:.0%} from the median of the six. Cases: records, floors, both ways.",
)
def _displacement_of_models(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    peaks = _peaks(one, _POUNDING)
    off = abs(peaks / peaks.median("law") - 1.0).max("law")
    numbers = "largest departure {most:.0%}, median over the cases {median:.0%}"
    return _support(off, off <= SAME_DISPLACEMENT, numbers)


@CONCLUSIONS["ii"].claim(
    "With pounding the top storey's shear may exceed that of the storey below, without it does not.",
    "It does under at least one of Models I to VI, and does not under Model VII. Cases: records.",
)
def _shear_turns(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    shear = one["storey_shear_max"].isel(building=-1)
    ratio = shear.isel(storey=-1) / shear.isel(storey=-2)
    pounding, alone = ratio.sel(law=_POUNDING), ratio.sel(law="none")
    numbers = (
        f"top over storey below: up to {float(pounding.max()):.2f} with pounding, above 1 in "
        f"{int((pounding > 1.0).sum())} of {pounding.size} scenarios; up to {{most:.2f}} without"
    )
    return _support(alone, (pounding.max("law") > 1.0) & (alone <= 1.0), numbers)


@CONCLUSIONS["iii"].claim(
    "Models I to III give the same peak forces.",
    f"Largest at most {SAME_FORCE:g} times the smallest. {_FLOORS} that touch in all three.",
)
def _linear_forces(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    force = _forces(one, _LINEAR)
    ratio = force.max("law") / force.min("law")
    return _support(ratio, ratio <= SAME_FORCE, "largest over smallest: median {median:.2f}, at most {most:.2f}")


@CONCLUSIONS["iii"].claim(
    "Models I to III give the same numbers of impacts.",
    f"They differ by at most {SAME_COUNT}, or {SAME_COUNT_SHARE:.0%} of the largest. {_FLOORS} that touch in any.",
)
def _linear_counts(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    count = one["impact_count"].sel(law=_LINEAR)
    most = count.max("law")
    span = (most - count.min("law")).where(most > 0)
    numbers = f"largest difference {{most:.0f}} impacts of {int(count.max())} at most"
    return _support(span, span <= np.maximum(SAME_COUNT, SAME_COUNT_SHARE * most), numbers)


@CONCLUSIONS["iii"].claim(
    "Models V and VI give less force than the undamped Model IV.",
    f"Both less than Model IV. {_FLOORS} that touch in all three.",
)
def _damped_below_hertz(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    force = _forces(one, ["hertz", *_DAMPED])
    ratio = force.sel(law=_DAMPED).max("law") / force.sel(law="hertz")
    numbers = "the larger of V and VI over IV: median {median:.2f}, at most {most:.2f}"
    return _support(ratio, ratio < 1.0, numbers)


@CONCLUSIONS["iv"].claim(
    "Models IV to VI give less force than Models I to III.",
    f"The largest of IV to VI is below the smallest of I to III. {_FLOORS} that touch in all six.",
)
def _nonlinear_below_linear(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    force = _forces(one, _POUNDING)
    ratio = force.sel(law=_NONLINEAR).max("law") / force.sel(law=_LINEAR).min("law")
    numbers = "largest of IV to VI over smallest of I to III: median {median:.2f}, {least:.2f} to {most:.2f}"
    return _support(ratio, ratio < 1.0, numbers)


@CONCLUSIONS["iv"].claim(
    "Peak displacements are the same under both kinds.",
    f"Medians of IV to VI and of I to III differ by {SAME_DISPLACEMENT:.0%} at most. Cases: records, floors, both "
    "ways.",
)
def _displacement_of_families(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    off = abs(_peaks(one, _NONLINEAR).median("law") / _peaks(one, _LINEAR).median("law") - 1.0)
    numbers = "largest difference {most:.0%}, median over the cases {median:.0%}"
    return _support(off, off <= SAME_DISPLACEMENT, numbers)


@CONCLUSIONS["v"].claim(
    "Pounding raises the peak of the roofs' acceleration spectra drastically.",
    f"Peak at least {DRASTIC:g} times that of Model VII. Cases: Models I to VI, records, buildings.",
)
def _spectra_grow(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    ordinates = spectra["pseudo_acceleration"]
    pounding, alone = ordinates.sel(law=_POUNDING), ordinates.sel(law="none")
    ratio = pounding.max("period") / alone.max("period")
    numbers = (
        "peak over that without pounding: median {median:.2f}, {least:.2f} to {most:.2f}; at single periods up to "
    )
    return _support(ratio, ratio >= DRASTIC, f"{numbers}{float((pounding / alone).max()):.1f} times")


def spread(spectra: xr.DataArray) -> xr.DataArray:
    """Width (natural logarithm of periods) over which spectra are above `SPREAD_LEVEL` of their own peak."""
    width = spectra["period"].copy(data=np.gradient(np.log(spectra["period"].values)))
    return width.where(spectra >= SPREAD_LEVEL * spectra.max("period"), 0.0).sum("period")


@CONCLUSIONS["v"].claim(
    "With pounding the peak is spread over a longer range of periods.",
    f"The range of periods (logarithm) above {SPREAD_LEVEL:.0%} of the spectrum's own peak is at least "
    f"{SPREAD_FACTOR:g} times that of Model VII. Cases: Models I to VI, records, buildings.",
)
def _spectra_spread(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    width = spread(spectra["pseudo_acceleration"])
    ratio = width.sel(law=_POUNDING) / width.sel(law="none")
    numbers = "spread over that without pounding: median {median:.2f}, up to {most:.2f}"
    return _support(ratio, ratio >= SPREAD_FACTOR, numbers)


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
