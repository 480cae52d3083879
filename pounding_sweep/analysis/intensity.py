"""How strong the ground motion of each scenario is."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.rebuild import records_of, stored_sweep
from pounding_sweep.analysis.scenarios import described
from pounding_sweep.analysis.spectra import response_spectrum
from pounding_sweep.base.errors import InputError
from pounding_sweep.model.scene import Scene
from pounding_sweep.records import record_measures, resolve_records
from pounding_sweep.spec.axes import plain_name
from pounding_sweep.spec.spec import scene_of

#: Damping ratio of spectral accelerations.
DAMPING = 0.05
_SPECTRAL = re.compile(r"sa(?:\((.+)\))?")
#: What an intensity may be called.
NAMES = "pga, pgv, sa(PERIOD in s), sa(BUILDING) at its first period, sa: geometric mean at those of all buildings"


def intensity_of(
    cube: xr.Dataset, intensity: str | xr.DataArray | None = None, *, records: Any = None, folders: Any = None
) -> xr.DataArray:
    """Return the intensity of each record at each scale, along ``record`` and what scales it."""
    # by one of `NAMES`, or given for the records at scale 1; by default what they are scaled to. `records` are looked
    # through before others are looked for by name
    if "record" not in cube.coords:
        msg = "the intensity of the ground motion needs the record of each scenario (coordinate 'record')"
        raise InputError(msg)
    own = own_intensity(cube)
    intensity = own if intensity is None else intensity
    if isinstance(intensity, xr.DataArray):
        base = _given(cube, intensity)
    elif intensity == own != "pga":
        told = _spectral_name(f"at {cube.attrs['sa_period']:g} s")
        return described(cube["sa"].broadcast_like(cube["scale"]).reset_coords(drop=True), "m s-2", told)
    elif intensity == "pga":
        base = _pga(cube)
    else:
        base = _given(cube, _measured(cube, str(intensity), records, folders))
    scale = abs(cube["scale"]) if "scale" in cube.coords else xr.DataArray(1.0)
    units, name = (str(base.attrs.get(key, other)) for key, other in (("units", "1"), ("long_name", "intensity")))
    return described((base * scale).reset_coords(drop=True), units, name)


def with_intensities(cube: xr.Dataset, names: Iterable[str], *, records: Any = None, folders: Any = None) -> xr.Dataset:
    """Return a cube with intensities of its ground motions as coordinates: ``ground_sa_0_5`` for ``sa(0.5)``.

    A table of it has a column for each.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with records.
    names : iterable of str
        Intensities, see `intensity_of`.
    records, folders : optional
        As for `intensity_of`.

    Returns
    -------
    xarray.Dataset
        The cube, with coordinates along ``record`` and what scales it.

    Raises
    ------
    InputError
        An intensity is unknown, or the cube or its records do not tell it.

    Examples
    --------
    >>> import xarray as xr
    >>> cube = xr.Dataset({"drift": ("record", [0.01])}, {"record": ["a"], "record_pga": ("record", [2.0])})
    >>> with_intensities(cube, ["pga"]).ground_pga.values.tolist()
    [2.0]
    """
    for name in names:
        own = plain_name(f"ground_{name}".rstrip(")"), [str(each) for each in cube.coords])
        cube = cube.assign_coords({own: intensity_of(cube, name, records=records, folders=folders)})
    return cube


def with_intensity(rows: Iterable[Mapping[str, Any]], strength: xr.DataArray, name: str) -> list[dict[str, Any]]:
    """Return rows of a table with an intensity before their values; None where they are of several motions."""
    column, found = f"{name} {strength.attrs['units']}", []
    for row in rows:
        at = {dim: row.get(str(dim)) for dim in strength.dims if strength.sizes[dim] > 1}
        value = None if None in at.values() else float(strength.sel(at).values.item())
        before, items = list(row).index("values"), list(row.items())
        found.append(dict([*items[:before], (column, value), *items[before:]]))
    return found


def own_intensity(cube: xr.Dataset) -> str:
    """Return what the records of a cube are scaled to: a spectral acceleration, else "pga"."""
    scaled = "sa" in cube.coords and bool(cube["sa"].notnull().all())
    return f"sa({cube.attrs['sa_period']:g})" if scaled else "pga"


def periods_of(cube: xr.Dataset, name: str) -> list[float]:
    """Return the periods (s) of a spectral intensity; none of another."""
    check_intensity(name)
    spectral = _SPECTRAL.fullmatch(name)
    return _periods(scene_of(stored_sweep(cube)["scene"]), spectral[1])[0] if spectral else []


def _spectral_name(told: str) -> str:
    """Say what a spectral intensity is."""
    return f"spectral acceleration, {DAMPING:.0%} damping, {told}"


def check_intensity(name: str) -> None:
    """Raise `InputError` unless a text names an intensity."""
    if name not in ("pga", "pgv") and not _SPECTRAL.fullmatch(name):
        msg = f"unknown intensity {name!r}; valid: {NAMES}; or, from Python, a DataArray along 'record' with its units"
        raise InputError(msg)


def _measured(cube: xr.Dataset, name: str, records: Any, folders: Any) -> xr.DataArray:
    """Return an intensity of the records at scale 1 by its name, from their motions."""
    check_intensity(name)
    spectral = _SPECTRAL.fullmatch(name)
    sweep = stored_sweep(cube)
    wanted = {str(one) for one in np.atleast_1d(cube["record"].values)}
    sweep |= {"records": [entry for entry in sweep["records"] if entry["name"] in wanted]}
    periods, told = _periods(scene_of(sweep["scene"]), spectral[1]) if spectral else ([], "")
    found = records_of(sweep, [] if records is None else resolve_records(records, folders), folders)
    names = {"record": [one.name for one in found]}
    if not spectral:
        about = {"units": "m s-1", "long_name": "peak ground velocity"}
        return xr.DataArray([record_measures(one).pgv for one in found], names, ("record",), attrs=about)
    ordinates = response_spectrum(found, periods, DAMPING)["pseudo_acceleration"]
    about = {"units": "m s-2", "long_name": _spectral_name(told)}
    logs: Any = np.log(ordinates)
    return np.exp(logs.mean("period")).assign_attrs(about).reset_coords(drop=True)


def _periods(scene: Scene, asked: str | None) -> tuple[list[float], str]:
    """Return the periods (s) of a spectral intensity, and what they are in words."""
    first = {building.name: float(building.periods[0]) for building in scene.buildings}
    if asked is None:
        told = ", ".join(f"{period:.3g}" for period in first.values())
        one = f"at {told} s"
        return list(first.values()), one if len(first) == 1 else f"geometric mean {one}"
    if asked in first:
        return [first[asked]], f"at {first[asked]:.3g} s of {asked}"
    try:
        period = float(asked)
    except ValueError:
        period = math.nan
    if not (math.isfinite(period) and period > 0.0):
        msg = (
            f"intensity 'sa({asked})': {asked!r} is no period above 0 s, and no building; there are {', '.join(first)}"
        )
        raise InputError(msg)
    return [period], f"at {period:g} s"


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
