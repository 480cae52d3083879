"""Results in the formats of other tools: fragility for OpenQuake, demands for FEMA P-58 assessments with Pelicun."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
import pandas as pd
import xarray as xr

from pounding_sweep.analysis.comparisons import MOTION_DIMS, get_event
from pounding_sweep.analysis.comparisons.fragility import equal_axes, fragility, sentence
from pounding_sweep.analysis.rebuild import intensity_axis, intensity_of, periods_of
from pounding_sweep.analysis.scenarios import OTHER_DIMS, fell, law_keys, need_variables, scenario_dims, trusted
from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.base.errors import InputError, OutputError, check_choice
from pounding_sweep.base.files import FilePath, failure, replacing
from pounding_sweep.base.text import CSV_NUMBER
from pounding_sweep.output.netcdf import check_output

#: Namespace of NRML.
NRML = "http://openquake.org/xmlns/nrml/0.5"
#: What names of functions, and those of limit states, may not have in OpenQuake.
_NO_IDENTIFIER, _NO_NAME = re.compile(r"[^\w\-=.+]", re.ASCII), re.compile(r"[^\w-]", re.ASCII)
#: Intensities without periods: what OpenQuake calls them, and the factor to its unit there (g, cm/s).
_MEASURES = {"pga": ("PGA", 1.0 / STANDARD_GRAVITY), "pgv": ("PGV", 100.0)}
#: Demands of Pelicun, and the output that each is made of.
_DEMANDS = {"PID": "drift_max", "PFA": "acceleration_max"}
_UNITS_OF = {"PID": "rad", "PFA": "g", "COLLAPSE": "unitless"}


def export_nrml(
    cube: xr.Dataset,
    path: FilePath,
    limit_states: Mapping[str, tuple[str, float | str | None]],
    *,
    intensity: str | None = None,
    folders: Any = None,
    overwrite: bool = False,
) -> dict[str, str]:
    """Write the fragility of every pair or building as NRML 0.5 of OpenQuake.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with records or scales of several intensities; see `pounding_sweep.analysis.fragility`.
    path : path-like
        The file, ``.xml``.
    limit_states : mapping of str to (str, float, str or None)
        Name of a limit state -> event and level, the mildest first: ``{"touch": ("touch", None)}``,
        ``{"slight": ("drift", 0.01), "severe": ("drift", 0.03)}``. All are of pairs, or all of buildings.
    intensity, folders : optional
        As for `pounding_sweep.analysis.rebuild.intensity_of`, but for the mean over several buildings, which
        OpenQuake has no name for.
    overwrite : bool
        Whether a file that is there may be replaced.

    Returns
    -------
    dict of str to str
        Functions that were left out, as a limit state has no fit: their identifier, and why.

    Raises
    ------
    InputError
        A limit state or the intensity is not valid, the cube lacks what it needs, or no function has all its fits.
    OutputError
        The file can't be written.

    Notes
    -----
    One function, with all limit states, for each pair or building and each combination of the cube's axes but records
    and scales: ``left-middle_linear_gap=0.01``, without axes of one value or that the fragility does not depend on.
    Accelerations are in g (9.81 m/s2), PGV in cm/s; with median theta and dispersion beta, `mean` = theta
    exp(beta^2 / 2), `stddev` = mean sqrt(exp(beta^2) - 1).
    `minIML` and `maxIML` are the weakest and the strongest motion tried.
    """
    if not limit_states:
        raise InputError('no limit states: give at least one, {"touch": ("touch", None)} for instance')
    for name in limit_states:
        if not name or _NO_NAME.search(name):
            raise InputError(f"limit state {name!r} is no name that NRML takes; give letters, digits, '_' and '-'")
    per, *others = {get_event(event, level)[0].per for event, level in limit_states.values()}
    if others:
        raise InputError("limit states are of pairs or of buildings in a file, and these are of both; write two files")
    target = check_output(path, overwrite, netcdf=False)
    intensity = intensity or intensity_axis(cube)
    periods = list(periods_of(cube, intensity).values())
    if len(periods) > 1:
        raise InputError(
            f"OpenQuake has no name for {intensity!r}, a mean over buildings; give sa(PERIOD), sa(BUILDING) or pga"
        )
    measure, factor = _MEASURES.get(intensity) or (f"SA({periods[0]:.4g})", 1.0 / STANDARD_GRAVITY)
    fits = {
        name: fragility(cube, event, level, intensity=intensity, folders=folders, confidence=None)
        for name, (event, level) in limit_states.items()
    }
    equal = set.intersection(*({*equal_axes(fit)} for fit in fits.values()))
    for name, fit in fits.items():  # a part of the row may have been taken
        one = fit.isel(dict.fromkeys(equal, 0), drop=True)
        fits[name] = one if per in one.dims else one.expand_dims(per)
    first = next(iter(fits.values()))
    tried = np.abs(first["trial_intensity"].values) * factor
    tried = tried[np.isfinite(tried) & (tried != 0.0)]
    dims = [per, *(dim for dim in scenario_dims(first["fit_status"]) if dim != per)]
    functions: list[str] = []
    left_out: dict[str, str] = {}
    for place in np.ndindex(*(first.sizes[dim] for dim in dims)):
        at = dict(zip(dims, place, strict=True))
        labels = {dim: first[dim].values[i].item() for dim, i in at.items() if dim == per or first.sizes[dim] > 1}
        parts = [str(value) if isinstance(value, str) else f"{dim}={value:g}" for dim, value in labels.items()]
        identifier = _NO_IDENTIFIER.sub("_", "_".join(parts))
        cells = {name: fit.isel(at) for name, fit in fits.items()}
        why = [f"{name} {sentence(cell)}" for name, cell in cells.items() if int(cell["fit_status"])]
        if why:
            left_out[identifier] = "; ".join(why)
            continue
        functions.append(f'<fragilityFunction id="{identifier}" format="continuous" shape="logncdf">')
        functions.append(f'    <imls imt="{measure}" minIML="{tried.min():.9g}" maxIML="{tried.max():.9g}"/>')
        for name, cell in cells.items():
            beta = float(cell["dispersion"])
            mean = float(cell["median"]) * factor * math.exp(0.5 * beta**2)
            deviation = mean * math.sqrt(math.expm1(beta**2))
            functions.append(f'    <params ls="{name}" mean="{mean:.9g}" stddev="{deviation:.9g}"/>')
        functions.append("</fragilityFunction>")
    if not functions:
        reasons = "; ".join(f"{key}: {why}" for key, why in list(left_out.items())[:5])
        raise InputError(
            f"no fragility has a fit in all its limit states ({reasons}); run more intensities, or other levels"
        )
    words = "; ".join(f"{name}: {fit.attrs['event_in_words']}" for name, fit in fits.items())
    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        f'<nrml xmlns="{NRML}">',
        '<fragilityModel id="pounding" assetCategory="buildings" lossCategory="structural">',
        f"<description>{escape(str(cube.attrs.get('title', 'pounding_sweep')))}. {escape(words)}</description>",
        f"<limitStates>{' '.join(limit_states)}</limitStates>",
        *functions,
        "</fragilityModel>",
        "</nrml>",
    ]
    _write(path, target, "\n".join([*lines, ""]).encode())
    return left_out


def export_pelicun(cube: xr.Dataset, path: FilePath, building: str, *, overwrite: bool = False) -> int:
    """Write the demands of a building as Pelicun and other tools of FEMA P-58 read them.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube with ``drift_max`` or ``acceleration_max``, of one law and one value of every axis but records and
        scales, or of cases of one law: each scenario that is ok is a sample, and each that ends as the building falls.
    path : path-like
        The file, ``.csv``.
    building : str
        Name of the building.
    overwrite : bool
        Whether a file that is there may be replaced.

    Returns
    -------
    int
        Number of samples.

    Raises
    ------
    InputError
        The building is unknown, the outputs are missing, or samples of several laws or axes would be mixed.
    OutputError
        The file can't be written.

    Notes
    -----
    Columns are EVENT-TYPE-LOCATION-DIRECTION: ``1-PID-2-1`` is the peak drift ratio of storey 2 (``drift_max`` over
    its height, rad), ``1-PFA-3-1`` the peak total acceleration of floor 3 and ``1-PFA-0-1`` that of the ground (g of
    9.81 m/s2). The first row has the units. Where the building falls ``1-COLLAPSE-0-1`` is 1, and demands are those up
    to there: 1 rad in the storey that falls.
    """
    cube = cube.drop_dims(OTHER_DIMS, errors="ignore")
    stored = need_variables(cube, "a file of demands", list(_DEMANDS.values()), one=True)
    check_choice("building", building, np.atleast_1d(cube["building"].values).tolist())
    storeys = np.atleast_1d(cube["storey"].values).tolist()
    if "storey" not in cube.dims or storeys != list(range(1, len(storeys) + 1)):
        raise InputError(f"a file of demands is of all storeys, and this cube has {storeys}; leave storey out of --at")
    mixed = [dim for dim in scenario_dims(cube) if cube.sizes[dim] > 1 and dim not in (*MOTION_DIMS, "case")]
    mixed += ["law"] if "law" not in mixed and len(law_keys(cube)) > 1 else []
    if mixed:
        raise InputError(
            f"samples of several values of {', '.join(mixed)} would be mixed; choose one of each (--at {mixed[0]}=...)"
        )
    target = check_output(path, overwrite, netcdf=False)
    part = cube.sel(building=building) if "building" in cube.dims else cube
    heights = np.diff(part["floor_elevation"].dropna("storey").values, prepend=0.0)
    falls = falls_of(cube, building)
    demands = xr.Dataset({"ok": trusted(part) & (~fell(part) | falls)})
    for kind, output in _DEMANDS.items():
        if kind == "PFA" and "record" in part.coords:
            demands["1-PFA-0-1"] = abs(intensity_of(part, "pga")) / STANDARD_GRAVITY
        for storey, height in enumerate(heights if output in stored else ()):
            demand = part[output].astype(float).isel(storey=storey)  # where it falls up to there
            demands[f"1-{kind}-{storey + 1}-1"] = demand / (height if kind == "PID" else STANDARD_GRAVITY)
    if falls.any():
        demands["1-COLLAPSE-0-1"] = falls.astype(float)
    demands = demands.reset_coords(drop=True).expand_dims("_row")  # one scenario makes a row, too
    table = demands.to_dataframe(dim_order=["_row", *scenario_dims(part)]).reset_index(drop=True)
    table = table[table.pop("ok") & np.isfinite(table).all(axis=1)].reset_index(drop=True)
    if table.empty:
        raise InputError(
            f"no scenario of building {building!r} is ok; see the statuses of the cube ('pounding-sweep info')"
        )
    units = pd.DataFrame({name: [_UNITS_OF[name.split("-")[1]]] for name in table}, index=["Units"])
    _write(path, target, pd.concat([units, table.map(CSV_NUMBER.__mod__)]).to_csv(lineterminator="\r\n").encode())
    return len(table)


def falls_of(cube: xr.Dataset, building: str) -> xr.DataArray:
    """Whether a building falls, scenario by scenario."""
    part = cube.sel(building=building) if "building" in cube.dims else cube
    return part["collapsed_storey"] > 0 if "collapsed_storey" in part else xr.DataArray(False)


def _write(path: FilePath, target: Path, data: bytes) -> None:
    """Write a whole file, or nothing."""
    try:
        with replacing(target) as temporary:
            temporary.write_bytes(data)
    except OSError as error:
        raise OutputError(f"{failure(f'writing {str(path)!r}', error)}. Nothing was replaced") from error
