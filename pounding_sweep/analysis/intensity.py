"""How strong the ground motion of each scenario is."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np

from pounding_sweep.analysis.scenarios import described
from pounding_sweep.base.errors import InputError

if TYPE_CHECKING:
    import xarray as xr


def intensity_of(cube: xr.Dataset, intensity: str | xr.DataArray = "pga") -> xr.DataArray:
    """Return the intensity of each record at each scale."""
    import xarray as xr

    if "record" not in cube.coords:
        msg = "the intensity of the ground motion needs the record of each scenario (coordinate 'record')"
        raise InputError(msg)
    if isinstance(intensity, xr.DataArray):
        base = _given(cube, intensity)
    elif intensity == "pga":
        base = _pga(cube)
    else:
        msg = (
            f"unknown intensity {intensity!r}; give 'pga', or a DataArray along 'record' of the intensity at scale 1 "
            "with its units"
        )
        raise InputError(msg)
    scale = abs(cube["scale"]) if "scale" in cube.coords else xr.DataArray(1.0)
    units, name = (str(base.attrs.get(key, other)) for key, other in (("units", "1"), ("long_name", "intensity")))
    return described((base * scale).reset_coords(drop=True), units, name)


def _given(cube: xr.Dataset, intensity: xr.DataArray) -> xr.DataArray:
    wanted = [str(name) for name in np.atleast_1d(cube["record"].values)]
    if intensity.dims != ("record",) or "record" not in intensity.coords:
        msg = f"the intensity has dimensions {intensity.dims}; it must be along 'record' alone, at scale 1"
        raise InputError(msg)
    lacking = sorted(set(wanted) - {str(name) for name in intensity["record"].values})
    if lacking:
        msg = f"the intensity is not given for the record{'s' * (len(lacking) > 1)} {', '.join(lacking)} of this cube"
        raise InputError(msg)
    return intensity.sel(record=cube["record"]).assign_attrs(intensity.attrs)


def _pga(cube: xr.Dataset) -> xr.DataArray:
    import xarray as xr

    about = {"units": "m s-2", "long_name": "peak ground acceleration"}
    if "record_pga" in cube.coords:
        return cube["record_pga"].assign_attrs(about)
    try:
        peaks = {str(entry["name"]): float(entry["pga"]) for entry in json.loads(cube.attrs["records"])}
        found = [peaks[str(name)] for name in np.atleast_1d(cube["record"].values)]
    except (KeyError, TypeError, ValueError):
        msg = (
            "this cube does not say the peak ground accelerations of its records (coordinate 'record_pga'); give the "
            "intensity as a DataArray along 'record'"
        )
        raise InputError(msg) from None
    record = cube["record"]
    return xr.DataArray(np.reshape(found, record.shape), dims=record.dims, coords={"record": record}, attrs=about)
