"""What of the paper is reproduced: Tables 3 to 6 side by side, energies, impossible numbers, conclusions i to v."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from pounding_sweep.analysis.comparisons.responses import energy_transfer
from pounding_sweep.model.laws import LAWS, MATE2015_MODELS
from pounding_sweep.paper.study import PAPER, READINGS, published, record_title

LIMITS: dict[str, Any] = PAPER["limits"]
#: Differences up to these count as agreement, in summaries.
CLOSE = LIMITS["close"]
#: How outputs are written: heading, factor, unit, digits.
WRITTEN: dict[str, Any] = PAPER["written"]
#: The paper's conclusions, the criteria of their claims with the limits.
CONCLUSIONS: list[dict[str, Any]] = [
    conclusion
    | {"claims": [claim | {"criterion": claim["criterion"].format(**LIMITS)} for claim in conclusion["claims"]]}
    for conclusion in PAPER["conclusions"]
]
_POUNDING = list(MATE2015_MODELS[:-1])
_LINEAR = [key for key in _POUNDING if LAWS[key].exponent == 1.0]
_NONLINEAR = [key for key in _POUNDING if LAWS[key].exponent == 1.5]
_DAMPED = ["hertz_damped", "nonlinear_viscoelastic"]


def side_by_side(number: int, cube: xr.Dataset) -> xr.Dataset:
    """Put a table of the paper beside the same outputs of both readings, and their relative differences to it."""
    table = published(number)
    table = table.sel(record=[name for name in table["record"].values if name in cube["record"].values])
    computed = cube[list(table.data_vars)].sel(record=table["record"].values)
    computed = computed.sel(law=table["law"].values) if "law" in table.dims else computed.sel(law="linear", drop=True)
    if "program" in table.dims:
        sources, paper = table.rename(program="source"), table.sel(program="matlab", drop=True)
    else:
        sources, paper = table.expand_dims(source=["paper"]), table
    values = xr.concat([sources, computed.rename(reading="source")], "source", combine_attrs="drop_conflicts")
    differences = computed / paper.where(paper != 0) - 1.0
    return values.assign({f"{name}_difference": part for name, part in differences.items()}).assign_attrs(table.attrs)


def paper_and_computed(compared: xr.Dataset, name: str, reading: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return an output of the paper (of its MATLAB program), of a reading, and where the latter is not written as 0."""
    source = "matlab" if "matlab" in compared["source"].values else "paper"
    paper, computed = (compared[name].sel(source=key).values for key in (source, reading))
    _, factor, _, digits = WRITTEN[name]
    return paper, computed, np.abs(computed) >= 0.5 * 10.0**-digits / factor


def energy_checks(cube: xr.Dataset) -> xr.Dataset:
    """Return the largest departure from what energies must be (kN m), on ``check`` and ``reading``, and the input."""
    transfer, work = energy_transfer(cube), cube["contact_work"].fillna(0.0)
    of_none = cube[["energy_transfer_max", "energy_transfer_min"]].assign(transfer=transfer).sel(law="none", drop=True)
    departures = {
        "the buildings' transfers sum to the work of the contacts, in every scenario": (
            transfer.sum("building") - work.sum("pair")
        ),
        "the linear spring (Model I) takes in no work over a contact": work.sel(law="linear", drop=True),
        "without pounding (Model VII) no building transfers energy": of_none.to_dataarray(),
        "no contact gives energy: its work is not negative": work.clip(max=0.0),
    }
    stacked = xr.concat([abs(part).max(set(part.dims) - {"reading"}) for part in departures.values()], "check")
    energies = cube["energy_input"]
    largest = energies.max(set(energies.dims) - {"reading"})
    return xr.Dataset({"departure": stacked.assign_coords(check=list(departures)), "input": largest})


def silent_models(table: xr.Dataset) -> dict[str, list[str]]:
    """Return by record the laws of Table 5 that have no impact where another law has some."""
    count = table["impact_count"].sum(["pair", "storey"])
    count = count.sel(record=(count > 0).any("law") & (count == 0).any("law")).transpose("record", "law")
    return {str(one["record"].item()): one["law"].values[one.values == 0].tolist() for one in count}


def unbalanced(transfers: xr.Dataset) -> xr.DataArray:
    """Where some building receives more than all others together ever give."""
    released, received = transfers["energy_transfer_max"], -transfers["energy_transfer_min"]
    others = released.sum("building") - released
    return (received > others + 1e-6 * abs(received)).any("building")


def findings(cube: xr.Dataset) -> list[dict[str, Any]]:
    """List what is impossible in the paper's tables: title, what is printed, why it can't be, and what is computed."""
    five, six, pounding = published(5), published(6), cube.drop_sel(law="none")
    silent = [
        f"{record_title(record)}: Models {' and '.join(LAWS[law].model for law in laws)} have none, another has "
        f"{int(five['impact_count'].sel(record=record).max())} at one floor"
        for record, laws in silent_models(five).items()
    ]
    first = pounding["first_impact_time"].min(["pair", "storey"])
    alone, computed_alone = six.sel(law="none"), cube.sel(law="none")
    wrong, valued = unbalanced(six), pounding["energy_transfer_max"].notnull().all("building")
    ratio, computed_ratio = (
        force.sel(law="nonlinear_viscoelastic") / force.sel(law="hertz_damped").where(lambda values: values > 0)
        for force in (five["impact_force_max"], cube["impact_force_max"])
    )
    ratio = ratio.stack(cell=("record", "pair", "storey")).dropna("cell")
    ratio = ratio.sortby(ratio)
    place = dict(zip(("record", "pair", "storey"), ratio["cell"].values[-1], strict=True))
    largest = computed_ratio.max(["record", "pair", "storey"])
    numbers = {
        "silent": "; ".join(silent),
        "met": int(first.notnull().sum()),
        "pounding": int(pounding["impact_count"].notnull().all(["pair", "storey"]).sum()),
        "apart": float((first.max("law") - first.min("law")).max()),
        "receiving": int((alone != 0).to_dataarray().any("variable").sum()),
        "buildings": alone["energy_transfer_min"].size,
        "received": -float(alone["energy_transfer_min"].min()),
        "transfer": float(abs(energy_transfer(computed_alone)).max()),
        "input": float(computed_alone["energy_input"].max()),
        "wrong": int(wrong.sum()),
        "rows": wrong.size,
        "balanced": int((~unbalanced(pounding) & valued).sum()),
        "valued": int(valued.sum()),
        **place,
        "record": record_title(place["record"]),
        "force": float(five["impact_force_max"].sel(place, drop=True).sel(law="nonlinear_viscoelastic")),
        "ratio": float(ratio[-1]),
        "next": float(ratio[-2]),
        "median": float(ratio.median()),
        "largest": " and ".join(f"{one:.2f} ({READINGS[str(one['reading'].item())].label})" for one in largest),
    }
    texts = ("title", "printed", "why", "computed")
    return [finding | {key: finding[key].format(**numbers) for key in texts} for finding in PAPER["findings"]]


class Verdict(StrEnum):
    """What became of a claim or a conclusion."""

    HOLDS = "holds"
    PARTLY = "holds partly"
    FAILS = "does not hold"
    UNTESTED = "not tested"


#: Verdicts in the words of the report's opening, in their order.
_WORDS = ("Reproduced", "Reproduced in part", "Not reproduced", "Not tested")


@dataclass(frozen=True)
class Outcome:
    """How often a claim is true."""

    true_cases: int  # cases in which it is true, of how many
    cases: int
    numbers: str  # the values that decided, in words

    @property
    def verdict(self) -> Verdict:
        """Verdict by the share of cases; not tested where there is none."""
        if not self.cases:
            return Verdict.UNTESTED
        share = self.true_cases / self.cases
        if share >= LIMITS["holds"]:
            return Verdict.HOLDS
        return Verdict.PARTLY if share >= LIMITS["partly"] else Verdict.FAILS


class Judgement(NamedTuple):
    """A conclusion of ``paper.toml``, judged for one reading, claim by claim."""

    conclusion: dict[str, Any]
    reading: str
    outcomes: Sequence[Outcome]

    @property
    def verdict(self) -> Verdict:
        """A conclusion holds if all claims that were tested hold, fails if all fail, else holds partly."""
        verdicts = {outcome.verdict for outcome in self.outcomes}
        tested = verdicts - {Verdict.UNTESTED} or verdicts
        return tested.pop() if len(tested) == 1 else Verdict.PARTLY


def judge(cube: xr.Dataset, spectra: xr.DataArray) -> list[Judgement]:
    """Test every conclusion on every reading: outputs of the cube, and floor spectra of the roofs."""
    cases = {key: _cases(cube.sel(reading=key), spectra.sel(reading=key)) for key in cube["reading"].values.tolist()}
    return [
        Judgement(conclusion, reading, list(map(_outcome, conclusion["claims"], by_key[conclusion["key"]])))
        for conclusion in CONCLUSIONS
        for reading, by_key in cases.items()
    ]


#: Values that decide a claim, the cases in which it is true, and further numbers of its text.
_Case = tuple[xr.DataArray, xr.DataArray, dict[str, float]]


def _cases(one: xr.Dataset, spectra: xr.DataArray) -> dict[str, list[_Case]]:
    """Return the cases of every claim, by conclusion: of the outputs of one reading, and its floor spectra."""
    moved = abs(xr.concat([one["displacement_max"], one["displacement_min"]], "way"))
    middle = moved.sel(law=_POUNDING).median("law")
    departure = abs(moved.sel(law=_POUNDING) / middle - 1.0).max("law")
    change = abs(moved.sel(law=_NONLINEAR).median("law") / moved.sel(law=_LINEAR).median("law") - 1.0)
    shear = one["storey_shear_max"].isel(building=-1)
    shear = shear.isel(storey=-1) / shear.isel(storey=-2)
    sheared = shear.sel(law=_POUNDING)
    shears = {"pounding": float(sheared.max()), "above": int((sheared > 1.0).sum()), "scenarios": sheared.size}
    ratios = []  # of peak forces, at the floors at which all of these laws touch
    for laws in ((_LINEAR, _LINEAR), (_NONLINEAR, _LINEAR), (_DAMPED, ["hertz"])):
        top, bottom = (one["impact_force_max"].sel(law=keys) for keys in laws)
        touching = (top > 0).all("law") & (bottom > 0).all("law")
        ratios.append(top.max("law").where(touching) / bottom.min("law"))
    linear, softer, damped = ratios
    count = one["impact_count"].sel(law=_LINEAR)
    most = count.max("law")
    span = (most - count.min("law")).where(most > 0)
    growth = spectra.sel(law=_POUNDING) / spectra.sel(law="none")
    peaks, width = spectra.max("period"), spread(spectra)
    growth_of_peak, growth_of_width = (part.sel(law=_POUNDING) / part.sel(law="none") for part in (peaks, width))
    few = np.maximum(LIMITS["same_count"], LIMITS["same_count_share"] * most)
    alone = shear.sel(law="none")
    return {
        "i": [(departure, departure <= LIMITS["same_displacement"], {})],
        "ii": [(alone, (sheared.max("law") > 1.0) & (alone <= 1.0), shears)],
        "iii": [
            (linear, linear <= LIMITS["same_force"], {}),
            (span, span <= few, {"largest": int(count.max())}),
            (damped, damped < 1.0, {}),
        ],
        "iv": [(softer, softer < 1.0, {}), (change, change <= LIMITS["same_displacement"], {})],
        "v": [
            (growth_of_peak, growth_of_peak >= LIMITS["drastic"], {"single": float(growth.max())}),
            (growth_of_width, growth_of_width >= LIMITS["spread_factor"], {}),
        ],
    }


def spread(spectra: xr.DataArray) -> xr.DataArray:
    """Width (natural logarithm of periods) over which spectra are above a share of their own peak."""
    width = spectra["period"].copy(data=np.gradient(np.log(spectra["period"].values)))
    return width.where(spectra >= LIMITS["spread_level"] * spectra.max("period"), 0.0).sum("period")


def _outcome(claim: dict[str, str], case: _Case) -> Outcome:
    """Count the cases, those that have a value, in which a claim is true."""
    values, true, numbers = case
    valid = values.notnull()
    if not valid.any():
        return Outcome(0, 0, "no case")
    statistics = {"median": float(values.median()), "least": float(values.min()), "most": float(values.max())}
    return Outcome(int((true & valid).sum()), int(valid.sum()), claim["numbers"].format(**statistics, **numbers))


@dataclass(frozen=True)
class Reproduction:
    """What is reproduced, or is not, of one reading; or what can't be."""

    word: str
    reading: str
    items: tuple[str, ...]


def table_outcome(compared: xr.Dataset, names: Sequence[str], reading: str) -> Outcome:
    """Count the cells of a table of `side_by_side`, not zero in both, that a reading comes near to."""
    true_cases = cases = 0
    for name in names:
        paper, computed, written = paper_and_computed(compared, name, reading)
        cell = np.isfinite(computed) & ((paper != 0.0) | written)
        true_cases += int((cell & (np.abs(computed - paper) <= CLOSE[-1] * np.abs(paper))).sum())
        cases += int(cell.sum())
    return Outcome(true_cases, cases, f"{true_cases} of {cases} numbers within {CLOSE[-1]:.0%}")


def verdict_of_all(
    compared: Mapping[int, xr.Dataset], judgements: Sequence[Judgement], impossible: Sequence[str]
) -> list[Reproduction]:
    """Return what the report opens with; `compared` are the tables side by side by their number."""
    parts = []
    for reading in compared[3]["reading"].values.tolist():
        items: dict[Verdict, list[str]] = {verdict: [] for verdict in Verdict}
        for number, contents in PAPER["contents"].items():
            for what, names in contents.items():
                outcome = table_outcome(compared[int(number)], names, reading)
                items[outcome.verdict].append(f"{what} of Table {number} ({outcome.numbers})")
        for one in judgements:
            if one.reading == reading:
                items[one.verdict].append(f"conclusion {one.conclusion['key']}: {one.conclusion['text']}")
        for verdict, word in zip(Verdict, _WORDS, strict=True):
            if items[verdict] or verdict is not Verdict.UNTESTED:
                parts.append(Reproduction(word, READINGS[reading].label, tuple(items[verdict]) or ("nothing",)))
    return [*parts, Reproduction("Can't be", "in the paper itself", tuple(impossible))]
