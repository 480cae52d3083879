"""What must be and what can't be: energies of the computed cubes that add up, and impossible numbers of the tables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from pounding_sweep.analysis.comparisons.energy import energy_transfer
from pounding_sweep.model.laws import LAWS
from pounding_sweep.paper.published import published, record_title
from pounding_sweep.paper.readings import READINGS


@dataclass(frozen=True)
class Check:
    """One check of the energies of one reading."""

    text: str  # what must be
    reading: str  # key of the reading
    value: float  # the largest departure from it, over all scenarios (kN m)
    scale: float  # what it is to be compared with (kN m)

    @property
    def relative(self) -> float:
        """Departure over scale."""
        return self.value / self.scale if self.scale else float("inf") if self.value else 0.0


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


def findings(cube: xr.Dataset) -> list[Finding]:
    """List what is impossible in the paper's tables."""
    return [_no_first_touch(cube), _transfer_alone(cube), _all_receive(cube), _misprint(cube)]


def silent_models(table: xr.Dataset) -> dict[str, list[str]]:
    """Return by record the laws of Table 5 that have no impact where another law has some."""
    count = table["impact_count"].sum(["pair", "storey"])
    some = count.max("law") > 0
    silent = {
        str(record): [str(law) for law in count["law"].values[count.sel(record=record).values == 0]]
        for record in count["record"].values[some.values]
    }
    return {record: laws for record, laws in silent.items() if laws}


def _no_first_touch(cube: xr.Dataset) -> Finding:
    table = published(5)
    parts = []
    for record, laws in silent_models(table).items():
        most = int(table["impact_count"].sel(record=record).max())
        models = " and ".join(LAWS[law].model for law in laws)
        parts.append(f"{record_title(record)}: Models {models} have none, another has {most} at one floor")
    first = cube["first_impact_time"].drop_sel(law="none").min(["pair", "storey"])
    spread = float((first.max("law") - first.min("law")).max())
    touched = int((first.notnull()).sum())
    valued = cube["impact_count"].drop_sel(law="none").notnull().all(["pair", "storey"])
    return Finding(
        "Models without a first impact",
        "Table 5. " + "; ".join(parts) + ".",
        "Until floors meet for the first time no contact force acts, so all models share one motion: they touch at the "
        "same instant or not at all.",
        f"Floors meet in {touched} of {int(valued.sum())} scenarios with pounding; over the models of a record the "
        f"first impact differs by {spread:.1g} s at most.",
    )


def _transfer_alone(cube: xr.Dataset) -> Finding:
    table = published(6).sel(law="none")
    least = table["energy_transfer_min"]
    wrong = int(((least != 0) | (table["energy_transfer_max"] != 0)).sum())
    transfer = np.abs(energy_transfer(cube.sel(law="none")))
    scale = float(cube["energy_input"].sel(law="none").max())
    return Finding(
        "Energy transferred without contact",
        f"Table 6, Model VII: {wrong} of {least.size} buildings receive or give energy, up to "
        f"{-float(least.min()):g} kN m.",
        "Model VII has no contact: nothing can be received from anyone.",
        f"At most {float(transfer.max()):.1g} kN m remain of an input of up to {scale:.0f} kN m: the error of the time "
        "integration.",
    )


def unbalanced(released: xr.DataArray, received: xr.DataArray) -> xr.DataArray:
    """Where some building receives more than all others together ever give."""
    others = released.sum("building") - released
    return (-received > others + 1e-6 * np.abs(received)).any("building")


def _all_receive(cube: xr.Dataset) -> Finding:
    table = published(6)
    wrong = unbalanced(table["energy_transfer_max"], table["energy_transfer_min"])
    pounding = cube.drop_sel(law="none")
    unequal = unbalanced(pounding["energy_transfer_max"], pounding["energy_transfer_min"])
    valued = pounding["energy_transfer_max"].notnull().all("building")
    return Finding(
        "All receive, none gives",
        f"Table 6: in {int(wrong.sum())} of {wrong.size} rows a building receives more than the other two ever give.",
        "The buildings' transfers sum to the work that the contacts take in, which no passive contact makes negative: "
        "what one building has received, the others have given.",
        f"This is so in {int((~unequal & valued).sum())} of {int(valued.sum())} computed scenarios with pounding.",
    )


def _misprint(cube: xr.Dataset) -> Finding:
    def of_models(force: xr.DataArray) -> xr.DataArray:
        return force.sel(law="nonlinear_viscoelastic") / force.sel(law="hertz_damped").where(lambda values: values > 0)

    force = published(5)["impact_force_max"]
    ratio = of_models(force).stack(cell=("record", "pair", "storey")).dropna("cell")
    ratio = ratio.sortby(ratio)
    computed = of_models(cube["impact_force_max"])
    texts = [
        f"{float(computed.sel(reading=key).max()):.2f} ({READINGS[str(key)].label})" for key in cube["reading"].values
    ]
    place = dict(zip(("record", "pair", "storey"), ratio["cell"].values[-1], strict=True))
    value = float(force.sel({**place, "law": "nonlinear_viscoelastic"}))
    return Finding(
        "A probable misprint",
        f"Table 5, {record_title(str(place['record']))}, {place['pair']}, storey {place['storey']}, Model VI: "
        f"{value:.0f} kN, {float(ratio[-1]):.1f} times Model V.",
        f"Not impossible, but alone: the next largest ratio of Model VI to Model V is {float(ratio[-2]):.1f}, "
        f"the median {float(ratio.median()):.1f}.",
        f"The largest computed ratio of the two is {' and '.join(texts)}.",
        impossible=False,
    )
