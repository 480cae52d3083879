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
    """One check of one reading."""

    text: str  # what must be
    reading: str  # key of the reading
    value: float  # the largest departure from it, over all scenarios
    unit: str  # of the value
    scale: float  # what it is to be compared with, in the same unit

    @property
    def relative(self) -> float:
        """Departure over scale."""
        return self.value / self.scale if self.scale else float("inf") if self.value else 0.0


def energy_checks(cube: xr.Dataset) -> list[Check]:
    """Check the energy balance of every scenario."""
    found = []
    for reading in READINGS:
        if reading not in cube["reading"].values:
            continue
        one = cube.sel(reading=reading)
        transfer, work = energy_transfer(one), one["contact_work"].fillna(0.0)
        scale = float(one["energy_input"].max())
        residual = np.abs(transfer.sum("building") - work.sum("pair"))
        alone = transfer.sel(law="none")
        extremes = [np.abs(one[name].sel(law="none")).max() for name in ("energy_transfer_max", "energy_transfer_min")]
        alone_most = max(float(np.abs(alone).max()), *(float(value) for value in extremes))
        spring = float(np.abs(work.sel(law="linear")).max())
        for text, value in (
            ("the buildings' transfers sum to the work of the contacts, in every scenario", float(residual.max())),
            ("the linear spring (Model I) takes in no work over a contact", spring),
            ("without pounding (Model VII) no building transfers energy", alone_most),
            ("no contact gives energy: its work is not negative", float(np.maximum(-work, 0.0).max())),
        ):
            found.append(Check(text, reading, value, "kN m", scale))
    return found


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


def _models(laws: list[str]) -> str:
    return " and ".join(LAWS[law].model for law in laws)


def _no_first_touch(cube: xr.Dataset) -> Finding:
    table = published(5)
    parts = []
    for record, laws in silent_models(table).items():
        most = int(table["impact_count"].sel(record=record).max())
        parts.append(f"{record_title(record)}: Models {_models(laws)} have none, another has {most} at one floor")
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
    own = np.abs(energy_transfer(cube.sel(law="none")))
    scale = float(cube["energy_input"].sel(law="none").max())
    return Finding(
        "Energy transferred without contact",
        f"Table 6, Model VII: {wrong} of {least.size} buildings receive or give energy, up to "
        f"{-float(least.min()):g} kN m.",
        "Model VII has no contact: nothing can be received from anyone.",
        f"At most {float(own.max()):.1g} kN m remain of an input of up to {scale:.0f} kN m: the error of the time "
        "integration.",
    )


def unbalanced(given: xr.DataArray, received: xr.DataArray) -> xr.DataArray:
    """Where some building receives more than all others together ever give."""
    others = given.sum("building") - given
    return (-received > others + 1e-6 * np.abs(received)).any("building")


def _all_receive(cube: xr.Dataset) -> Finding:
    table = published(6)
    wrong = unbalanced(table["energy_transfer_max"], table["energy_transfer_min"])
    pounding = cube.drop_sel(law="none")
    own = unbalanced(pounding["energy_transfer_max"], pounding["energy_transfer_min"])
    valued = pounding["energy_transfer_max"].notnull().all("building")
    return Finding(
        "All receive, none gives",
        f"Table 6: in {int(wrong.sum())} of {wrong.size} rows a building receives more than the other two ever give.",
        "The buildings' transfers sum to the work that the contacts take in, which no passive contact makes negative: "
        "what one building has received, the others have given.",
        f"This is so in {int((~own & valued).sum())} of {int(valued.sum())} computed scenarios with pounding.",
    )


def _misprint(cube: xr.Dataset) -> Finding:
    force = published(5)["impact_force_max"]
    ratio = (force.sel(law="nonlinear_viscoelastic") / force.sel(law="hertz_damped")).stack(
        cell=("record", "pair", "storey")
    )
    ratio = ratio.where(np.isfinite(ratio), drop=True).sortby(ratio.where(np.isfinite(ratio), drop=True))
    texts = []
    own = cube["impact_force_max"]
    for reading in cube["reading"].values:
        one = own.sel(reading=reading)
        most = (one.sel(law="nonlinear_viscoelastic") / one.sel(law="hertz_damped").where(lambda f: f > 0)).max()
        texts.append(f"{float(most):.2f} ({READINGS[str(reading)].label})")
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
