"""The paper's conclusions i to v, each tested against computed cubes by criteria that stand here.

The paper gives no numbers for "more or less the same" or "drastically"; the
limits below are this package's, and no cube changes them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import xarray as xr

from pounding_sweep.model.laws import LAWS, MATE2015_MODELS

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

_POUNDING = MATE2015_MODELS[:-1]
_LINEAR = tuple(key for key in _POUNDING if LAWS[key].exponent == 1.0)
_NONLINEAR = tuple(key for key in _POUNDING if LAWS[key].exponent == 1.5)
_DAMPED = ("hertz_damped", "nonlinear_viscoelastic")


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
    #: (outputs of one reading, floor spectra of the roofs) -> `Support`
    test: Callable[[xr.Dataset, xr.Dataset], Support]


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
            str(reading),
            tuple(claim.test(cube.sel(reading=reading), spectra.sel(reading=reading)) for claim in conclusion.claims),
        )
        for conclusion in CONCLUSIONS.values()
        for reading in cube["reading"].values
    ]


def _peaks(one: xr.Dataset) -> xr.DataArray:
    """Absolute peak displacements (m) both ways, on ``law``, ``record``, ``building``, ``storey``, ``way``."""
    return abs(xr.concat([one["displacement_max"], one["displacement_min"]], "way"))


def _count(true: xr.DataArray, valid: xr.DataArray, numbers: str) -> Support:
    true, valid = true.broadcast_like(valid), valid.broadcast_like(true)
    return Support(int((true & valid).sum()), int(valid.sum()), numbers if bool(valid.any()) else "no case")


def _displacement_of_models(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    peaks = _peaks(one.sel(law=list(_POUNDING)))
    median = peaks.median("law")
    off = abs(peaks / median - 1.0).max("law")
    text = f"largest departure {float(off.max()):.0%}, median over the cases {float(off.median()):.0%}"
    return _count(off <= SAME_DISPLACEMENT, off.notnull(), text)


def _displacement_of_families(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    linear, other = (_peaks(one.sel(law=list(laws))).median("law") for laws in (_LINEAR, _NONLINEAR))
    off = abs(other / linear - 1.0)
    text = f"largest difference {float(off.max()):.0%}, median over the cases {float(off.median()):.0%}"
    return _count(off <= SAME_DISPLACEMENT, off.notnull(), text)


def _top_over_below(one: xr.Dataset) -> xr.DataArray:
    shear = one["storey_shear_max"].sel(building=one["building"].values[-1])
    return shear.isel(storey=-1) / shear.isel(storey=-2)


def _shear_turns(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    ratio = _top_over_below(one)
    pounding, alone = ratio.sel(law=list(_POUNDING)), ratio.sel(law="none")
    over = int((pounding > 1.0).sum())
    text = (
        f"top over storey below: up to {float(pounding.max()):.2f} with pounding, above 1 in {over} of {pounding.size} "
        f"scenarios; up to {float(alone.max()):.2f} without"
    )
    return _count((pounding.max("law") > 1.0) & (alone <= 1.0), alone.notnull(), text)


def _forces(one: xr.Dataset, laws: Sequence[str]) -> tuple[xr.DataArray, xr.DataArray]:
    """Peak forces (kN) of some laws, and the floors at which all of them touch."""
    force = one["impact_force_max"].sel(law=list(laws))
    return force, (force > 0).all("law")


def _linear_forces(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    force, touch = _forces(one, _LINEAR)
    ratio = (force.max("law") / force.min("law").where(touch)).where(touch)
    text = f"largest over smallest: median {float(ratio.median()):.2f}, at most {float(ratio.max()):.2f}"
    return _count(ratio <= SAME_FORCE, touch, text)


def _linear_counts(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    count = one["impact_count"].sel(law=list(_LINEAR))
    touch = (count > 0).any("law")
    span = count.max("law") - count.min("law")
    limit = np.maximum(SAME_COUNT, SAME_COUNT_SHARE * count.max("law"))
    return _count(span <= limit, touch, f"largest difference {int(span.max())} impacts of {int(count.max())} at most")


def _damped_below_hertz(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    force, touch = _forces(one, ("hertz", *_DAMPED))
    ratio = (force.sel(law=list(_DAMPED)).max("law") / force.sel(law="hertz").where(touch)).where(touch)
    text = f"the larger of V and VI over IV: median {float(ratio.median()):.2f}, at most {float(ratio.max()):.2f}"
    return _count(ratio < 1.0, touch, text)


def _nonlinear_below_linear(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    force, touch = _forces(one, _POUNDING)
    largest, smallest = force.sel(law=list(_NONLINEAR)).max("law"), force.sel(law=list(_LINEAR)).min("law")
    ratio = (largest / smallest.where(touch)).where(touch)
    text = (
        f"largest of IV to VI over smallest of I to III: median {float(ratio.median()):.2f}, "
        f"{float(ratio.min()):.2f} to {float(ratio.max()):.2f}"
    )
    return _count(ratio < 1.0, touch, text)


def _spectra_grow(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    ordinates = spectra["pseudo_acceleration"]
    pounding, alone = ordinates.sel(law=list(_POUNDING)), ordinates.sel(law="none")
    ratio = pounding.max("period") / alone.max("period")
    text = (
        f"peak over that without pounding: median {float(ratio.median()):.2f}, {float(ratio.min()):.2f} to "
        f"{float(ratio.max()):.2f}; at single periods up to {float((pounding / alone).max()):.1f} times"
    )
    return _count(ratio >= DRASTIC, ratio.notnull(), text)


def spread(spectra: xr.DataArray) -> xr.DataArray:
    """Width (natural logarithm of periods) over which spectra are above `SPREAD_LEVEL` of their own peak."""
    share = np.gradient(np.log(spectra["period"].values))
    width = xr.DataArray(share, dims="period", coords={"period": spectra["period"]})
    return width.where(spectra >= SPREAD_LEVEL * spectra.max("period"), 0.0).sum("period")


def _spectra_spread(one: xr.Dataset, spectra: xr.Dataset) -> Support:
    width = spread(spectra["pseudo_acceleration"])
    ratio = width.sel(law=list(_POUNDING)) / width.sel(law="none")
    text = f"spread over that without pounding: median {float(ratio.median()):.2f}, up to {float(ratio.max()):.2f}"
    return _count(ratio >= SPREAD_FACTOR, ratio.notnull(), text)


_FLOORS = "Cases: records, pairs and storeys"
_ALL = (
    Conclusion(
        "i",
        "The contact model hardly matters for peak displacements.",
        (
            Claim(
                "Peak displacements are more or less the same under Models I to VI.",
                f"No model is further than {SAME_DISPLACEMENT:.0%} from the median of the six. Cases: records, floors, "
                "both ways.",
                _displacement_of_models,
            ),
        ),
    ),
    Conclusion(
        "ii",
        "In the right building, the most flexible as printed, pounding can bring more shear into the top storey than "
        "into the one below.",
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
                _linear_forces,
            ),
            Claim(
                "Models I to III give the same numbers of impacts.",
                f"They differ by at most {SAME_COUNT}, or {SAME_COUNT_SHARE:.0%} of the largest. {_FLOORS} that touch "
                "in any.",
                _linear_counts,
            ),
            Claim(
                "Models V and VI give less force than the undamped Model IV.",
                f"Both less than Model IV. {_FLOORS} that touch in all three.",
                _damped_below_hertz,
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
                _nonlinear_below_linear,
            ),
            Claim(
                "Peak displacements are the same under both kinds.",
                f"Medians of IV to VI and of I to III differ by {SAME_DISPLACEMENT:.0%} at most. Cases: records, "
                "floors, both ways.",
                _displacement_of_families,
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
CONCLUSIONS: dict[str, Conclusion] = {conclusion.key: conclusion for conclusion in _ALL}
"""The paper's conclusions by number."""
