"""Physical completeness of the computed cubes: energies add up, and nothing is transferred without contact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pounding_sweep.analysis.energies import energy_transfer
from pounding_sweep.paper.readings import READINGS

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Check:
    """One check of one reading.

    Attributes
    ----------
    text : str
        What must be.
    reading : str
        Key of the reading.
    value : float
        The largest departure from it, over all scenarios.
    unit : str
        Of the value.
    scale : float
        What it is to be compared with, in the same unit.
    """

    text: str
    reading: str
    value: float
    unit: str
    scale: float

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
