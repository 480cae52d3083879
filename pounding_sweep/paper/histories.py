"""Histories of the paper's scenarios, brought down to what its Figures 11 to 21 show."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.model.laws import MATE2015_MODELS, get_law
from pounding_sweep.paper.readings import METHOD, RESTITUTION, STEP, Reading
from pounding_sweep.records import Record
from pounding_sweep.run.simulate import simulate

if TYPE_CHECKING:
    import xarray as xr

#: Interval (s) of the histories that are kept; a divisor of every record's step.
INTERVAL = 0.01
#: Damping ratio of the spectra, and their periods (s): from 0.02 to 3 s.
DAMPING = 0.05
PERIODS = np.geomspace(0.02, 3.0, 150)


def scenario(reading: Reading, record: Record, law: str) -> xr.Dataset:
    """Run one of the paper's scenarios with full histories; see `pounding_sweep.simulate`."""
    restitution = RESTITUTION if get_law(law).takes_restitution else None
    return simulate(reading.preset, record, law=law, restitution=restitution, method=METHOD, dt=STEP)


def kept(one: xr.Dataset) -> xr.Dataset:
    """Bring the histories of one scenario down to those of the figures."""
    import xarray as xr

    every = round(INTERVAL / (float(one["time"][1]) - float(one["time"][0])))
    at = one.isel(time=slice(None, None, every))
    energy = at["kinetic"] + at["damping"] + at["strain"]
    roofs = one["contact_force"].isel(storey=-1)
    force = roofs.coarsen(time=every, boundary="pad", coord_func="min").max()
    about = {"units": "kN", "long_name": "largest contact force at the roofs in each interval"}
    return xr.Dataset(
        {
            "roof_displacement": at["displacement"].isel(storey=-1).assign_attrs(long_name="roof displacement"),
            "structural_energy": energy.assign_attrs(
                units="kN m", long_name="structural energy", comment="kinetic + damping + strain energy of a building"
            ),
            "roof_force": force.assign_attrs(about),
        }
    ).reset_coords(drop=True)


def paper_histories(
    reading: Reading, records: Sequence[Record], advance: Callable[[int], None] = lambda count: None
) -> tuple[xr.Dataset, xr.Dataset]:
    """Run Models I to VII of one reading under all records."""
    import xarray as xr

    from pounding_sweep.analysis.spectra import floor_spectra

    histories: list[list[Any]] = []
    spectra: list[list[Any]] = []
    for law in MATE2015_MODELS:
        histories.append([])
        spectra.append([])
        for record in records:
            one = scenario(reading, record, law)
            histories[-1].append(kept(one))
            roofs = floor_spectra(one.isel(storey=[-1]), PERIODS, DAMPING)
            spectra[-1].append(roofs.isel(storey=0).reset_coords(drop=True))
            advance(1)
    labels = {
        "law": xr.DataArray(list(MATE2015_MODELS), dims="law", attrs={"long_name": "contact law"}),
        "record": xr.DataArray([r.name for r in records], dims="record", attrs={"long_name": "ground-motion record"}),
    }

    def together(parts: list[list[Any]]) -> xr.Dataset:
        rows = [xr.concat(row, "record", join="outer", combine_attrs="override") for row in parts]
        return xr.concat(rows, "law", combine_attrs="override").assign_coords(labels).assign_attrs(reading=reading.key)

    return together(histories), together(spectra)
