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
from pounding_sweep.analysis.scenarios import described, labelled
from pounding_sweep.analysis.spectra import response_spectrum
from pounding_sweep.base.errors import InputError
from pounding_sweep.records import record_measures, resolve_records
from pounding_sweep.spec.axes import plain_name
from pounding_sweep.spec.spec import scene_of

#: Damping ratio of spectral accelerations.
DAMPING = 0.05
_SPECTRAL = re.compile(r"sa(?:\((.+)\))?")
_SPECTRAL_NAME = f"spectral acceleration, {DAMPING:.0%} damping,"
#: What an intensity may be called.
NAMES = "pga, pgv, sa(PERIOD in s), sa(BUILDING) at its first period, sa: geometric mean at those of all buildings"


def intensity_of(
    cube: xr.Dataset, intensity: str | xr.DataArray | None = None, *, records: Any = None, folders: Any = None
) -> xr.DataArray:
    """Return the intensity of each record at each scale, along ``record`` and what scales it."""
    # by one of `NAMES`, or given for the records at scale 1; by default what they are scaled to. `records` are looked
    # through before others are looked for by name
    if "record" not in cube.coords:
        raise InputError("the intensity of the ground motion needs the record of each scenario (coordinate 'record')")
    scaled_to = own_intensity(cube)
    intensity = scaled_to if intensity is None else intensity
    if isinstance(intensity, str) and intensity == scaled_to != "pga":
        name = f"{_SPECTRAL_NAME} at {cube.attrs['sa_period']:g} s"
        return described(cube["sa"].broadcast_like(cube["scale"]).reset_coords(drop=True), "m s-2", name)
    record = cube["record"]
    names = [str(name) for name in np.atleast_1d(record.values)]
    if isinstance(intensity, str) and intensity == "pga":
        base = cube["record_pga"] if "record_pga" in cube.coords else _stored_pga(cube, names)
        base = described(base, "m s-2", "peak ground acceleration")
    else:
        base = _measured(cube, intensity, records, folders) if isinstance(intensity, str) else intensity
        if base.dims != ("record",) or "record" not in base.coords:
            raise InputError(f"the intensity has dimensions {base.dims}; it must be along 'record' alone, at scale 1")
        lacking = sorted(set(names) - {str(name) for name in base["record"].values})
        if lacking:
            which = f"record{'s' * (len(lacking) > 1)} {', '.join(lacking)}"
            raise InputError(f"the intensity is not given for the {which} of this cube")
        base = base.sel(record=record).assign_attrs(base.attrs)
    scale = abs(cube["scale"]) if "scale" in cube.coords else xr.DataArray(1.0)
    units, long_name = (str(base.attrs.get(key, other)) for key, other in (("units", "1"), ("long_name", "intensity")))
    return described((base * scale).reset_coords(drop=True), units, long_name)


def _stored_pga(cube: xr.Dataset, names: Iterable[str]) -> xr.DataArray:
    """Return the peak ground accelerations (m/s2) that a cube's attributes tell of its records."""
    try:
        peaks = {str(entry["name"]): float(entry["pga"]) for entry in json.loads(cube.attrs["records"])}
        record = cube["record"]
        return xr.DataArray(np.reshape([peaks[name] for name in names], record.shape), {"record": record}, record.dims)
    except (KeyError, TypeError, ValueError):
        raise InputError(
            "this cube does not say the peak ground accelerations of its records (coordinate 'record_pga'); give the "
            "intensity as a DataArray along 'record'"
        ) from None


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
        coordinate = plain_name(f"ground_{name}".rstrip(")"), [str(each) for each in cube.coords])
        cube = cube.assign_coords({coordinate: intensity_of(cube, name, records=records, folders=folders)})
    return cube


def with_intensity(rows: Iterable[Mapping[str, Any]], strength: xr.DataArray, name: str) -> list[dict[str, Any]]:
    """Return rows of a table with an intensity before their values; None where they are of several motions."""
    result = []
    for row in rows:
        at = {dim: row.get(str(dim)) for dim in strength.dims if strength.sizes[dim] > 1}
        value = None if None in at.values() else float(strength.sel(at).values.item())
        before, items = list(row).index("values"), list(row.items())
        result.append(dict([*items[:before], (f"{name} {strength.attrs['units']}", value), *items[before:]]))
    return result


def own_intensity(cube: xr.Dataset) -> str:
    """Return what the records of a cube are scaled to: a spectral acceleration, else "pga"."""
    scaled = "sa" in cube.coords and bool(cube["sa"].notnull().all())
    return f"sa({cube.attrs['sa_period']:g})" if scaled else "pga"


def check_intensity(name: str) -> None:
    """Raise `InputError` unless a text names an intensity."""
    if name not in ("pga", "pgv") and not _SPECTRAL.fullmatch(name):
        raise InputError(
            f"unknown intensity {name!r}; valid: {NAMES}; or, from Python, a DataArray along 'record' with its units"
        )


def periods_of(cube: xr.Dataset, name: str) -> dict[str, float]:
    """Return the periods (s) of a spectral intensity by what has them, a building or ""; none of another."""
    check_intensity(name)
    spectral = _SPECTRAL.fullmatch(name)
    if not spectral:
        return {}
    first = {b.name: float(b.periods[0]) for b in scene_of(stored_sweep(cube)["scene"]).buildings}
    asked = spectral[1]
    if asked is None:
        return first
    if asked in first:
        return {asked: first[asked]}
    try:
        period = float(asked)
    except ValueError:
        period = math.nan
    if not (math.isfinite(period) and period > 0.0):
        raise InputError(
            f"intensity 'sa({asked})': {asked!r} is no period above 0 s, and no building; there are {', '.join(first)}"
        )
    return {"": period}


def _measured(cube: xr.Dataset, name: str, records: Any, folders: Any) -> xr.DataArray:
    """Return an intensity of the records at scale 1 by its name, from their motions."""
    periods = periods_of(cube, name)
    sweep, wanted = stored_sweep(cube), {str(one) for one in np.atleast_1d(cube["record"].values)}
    sweep["records"] = [entry for entry in sweep["records"] if entry["name"] in wanted]
    motions = records_of(sweep, [] if records is None else resolve_records(records, folders), folders)
    if periods:
        mean = "geometric mean " * (len(periods) > 1)
        of = f" of {name[3:-1]}" * (name[3:-1] in periods)
        at = ", ".join(f"{period:{'g' if key == '' else '.3g'}}" for key, period in periods.items())
        units, long_name = "m s-2", f"{_SPECTRAL_NAME} {mean}at {at} s{of}"
        logs: Any = np.log(response_spectrum(motions, list(periods.values()), DAMPING)["pseudo_acceleration"])
        found = np.exp(logs.mean("period")).values
    else:
        units, long_name = "m s-1", "peak ground velocity"
        found = np.array([record_measures(motion).pgv for motion in motions])
    names = labelled("record", (motion.name for motion in motions), "ground-motion record")
    return described(xr.DataArray(found, {"record": names}, ("record",)), units, long_name)
