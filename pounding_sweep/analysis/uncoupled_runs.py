"""Runs without pounding of a row or of a cube: taken from the cube where it holds them, made again where it does not.

They are the planner's own runs, by which scenarios that never touch are left out of
sweeps: the law "none" with the output ``closing_max``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.rebuild import records_of, stored_sweep
from pounding_sweep.analysis.scenarios import (
    IGNORED,
    NO_POUNDING,
    law_keys,
    present,
    scenarios_only,
    uncoupled_cases,
    values,
    without_pounding,
)
from pounding_sweep.base.errors import InputError
from pounding_sweep.model.scene import CONTACTS, Scene
from pounding_sweep.outputs.variables import INNER_DIMS
from pounding_sweep.records import Record, resolve_records
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.spec.axes import AXES, PropertyAxis, axes_of, case_of, property_axes
from pounding_sweep.spec.spec import scene_of

#: What a run without pounding must report.
OUTPUTS = ("displacement_max", "displacement_min", "closing_max")
#: Step (s) of the exact scheme, whose free flight has no error: peaks are looked for inside it.
STEP = 1e-3


@dataclass(frozen=True)
class UncoupledRuns:
    """Runs without pounding."""

    scene: Scene  # the row
    cube: xr.Dataset  # `OUTPUTS` on ``record``, and on ``scale``, building properties or ``case``
    periods: xr.DataArray  # first periods (s) of the buildings, along ``building`` and what varies them
    damping: xr.DataArray  # damping ratios of their first modes


def runs_of_row(scene: Scene | str, records: Any, folders: Any) -> UncoupledRuns:
    """Run a row without pounding, once for each record."""
    sweep = Sweep(scene, records, NO_POUNDING, folders=folders, **_settings(scene))
    _check_pairs(sweep.spec.scene)
    if (row := with_columns(sweep.spec.scene)) != sweep.spec.scene:
        sweep = Sweep(row, sweep.spec.records, NO_POUNDING, **_settings(row))
    cube = _reduced(sweep.run()).isel(scale=0, drop=True)
    return UncoupledRuns(sweep.spec.scene, cube, *_first_modes(sweep.spec.scene, ()))


def runs_of_cube(cube: xr.Dataset, records: Any, folders: Any) -> UncoupledRuns:
    """Return the runs without pounding that belong to a cube; see `required_gap`."""
    cube = scenarios_only(cube)
    sweep = stored_sweep(cube)
    own = scene_of(sweep["scene"])
    scene = with_columns(own)
    _check_pairs(scene)
    row: dict[str, list[Any]] = {"building": [building.name for building in own.buildings]}
    row |= {"pair": list(own.pair_labels), "storey": list(range(1, own.n_storeys + 1))}
    # a part of the row is no row
    whole = all(dim in cube.dims and sorted(cube[dim].values.tolist()) == sorted(row[dim]) for dim in row)
    cube = cube.sel(row) if whole else cube  # in the row's order, which a user may have changed
    there = whole and scene == own and NO_POUNDING in law_keys(cube) and len(present(cube, OUTPUTS)) == len(OUTPUTS)
    if sweep["cases"] is not None:
        if there and min(uncoupled_cases(cube)) >= 0:
            runs = cube.isel(case=np.flatnonzero(cube["law"].values.astype(str) == NO_POUNDING))
        else:
            runs = _run_cases(scene, sweep, records, folders)
        return UncoupledRuns(scene, runs, *_first_modes_of_cases(scene, runs))
    axes = property_axes(axes_of(sweep))
    runs = _reduced(cube) if there else _selected(_run_product(scene, sweep, records, folders), cube)
    modes = [_selected(part, cube if there else runs).reset_coords(drop=True) for part in _first_modes(scene, axes)]
    return UncoupledRuns(scene, runs, *modes)


def with_columns(scene: Scene) -> Scene:
    """Return a row in which floors meet columns too."""
    return replace(scene, contacts=CONTACTS[1])


def _check_pairs(scene: Scene) -> None:
    if not scene.pair_names:
        msg = "the required gap needs a pair of neighbours, and this row is a single building; add a wall or a building"
        raise InputError(msg)


def _settings(scene: Scene | str) -> dict[str, Any]:
    """Solver of runs without pounding: exact where all is elastic."""
    exact = not isinstance(scene, Scene) or not (any(scene.yields) or SCHEMES["exact"].refuses(scene))
    method = "exact" if exact else "rk4"
    return {"outputs": list(OUTPUTS), "method": method, "dt": STEP, "audit": 0.0}


def _reduced(cube: xr.Dataset) -> xr.Dataset:
    """Return the runs without pounding of a product without the axes that they ignore."""
    uncoupled = without_pounding(cube, "the required gap")
    return uncoupled.isel(dict.fromkeys((dim for dim in IGNORED if dim in uncoupled.dims), 0)).reset_coords(drop=True)


def _found_again(sweep: dict[str, Any], records: Any, folders: Any) -> list[Record]:
    try:
        return records_of(sweep, resolve_records(records, folders), folders)
    except InputError as error:
        msg = f"{error}; or run the sweep with the law {NO_POUNDING!r} and the outputs {', '.join(OUTPUTS)}"
        raise InputError(msg) from None


def _run_product(scene: Scene, sweep: dict[str, Any], records: Any, folders: Any) -> xr.Dataset:
    """Run a product sweep without pounding; an elastic row once for each sign of its scales, by which it grows."""
    given = axes_of(sweep)
    kept: dict[str, Any] = {
        name: dict(getattr(given, name)) if axis.by_building else getattr(given, name)
        for name, axis in AXES.items()
        if (axis.of_buildings or axis.column == "scale") and getattr(given, name)
    }
    elastic = not any(scene.yields)
    signs = [-1.0 if scale < 0.0 else 1.0 for scale in given.scales] if elastic else []
    if signs:
        kept["scales"] = sorted(set(signs))
    found = _found_again(sweep, records, folders)
    alone = Sweep(scene, found, NO_POUNDING, **kept, **_parameters(sweep), **_settings(scene))
    unit = _reduced(alone.run())
    if not signs:
        return unit
    about = {"units": "1", "long_name": "factor on the record"}
    scales = xr.DataArray(list(given.scales), dims="scale", coords={"scale": list(given.scales)}, attrs=about)
    unit = unit.sel(scale=signs).assign_coords(scale=scales)
    grown = {name: (values(unit, name) * abs(unit["scale"])).assign_attrs(unit[name].attrs) for name in OUTPUTS}
    return unit.assign(grown)


def _selected(part: Any, cube: xr.Dataset) -> Any:
    """Return what belongs to a cube, which may be a selection from what its sweep has."""
    return part.sel({dim: cube[dim].values for dim in part.dims if dim in cube.coords and dim not in INNER_DIMS})


def _parameters(sweep: dict[str, Any]) -> dict[str, Any]:
    """Return what the axes of a stored sweep need beside their values."""
    names = {axis.parameter for axis in AXES.values() if axis.parameter}
    return {name: sweep[name] for name in names & sweep.keys()}


def _run_cases(scene: Scene, sweep: dict[str, Any], records: Any, folders: Any) -> xr.Dataset:
    """Run each record, scale and building of listed cases once without pounding."""
    ignored: dict[str, Any] = dict.fromkeys(IGNORED)
    cases = [replace(case_of(case), law=NO_POUNDING, **ignored) for case in sweep["cases"]]
    found = _found_again(sweep, records, folders)
    return Sweep(scene, found, cases=list(dict.fromkeys(cases)), **_parameters(sweep), **_settings(scene)).run()


def _first_modes(scene: Scene, axes: Sequence[PropertyAxis]) -> tuple[xr.DataArray, xr.DataArray]:
    """First periods (s) and damping ratios of the buildings, along ``building`` and the axes that vary them."""
    names = [b.name for b in scene.buildings]
    periods = xr.DataArray([float(b.periods[0]) for b in scene.buildings], dims="building", coords={"building": names})
    damping = periods.copy(data=[b.first_damping for b in scene.buildings])
    for axis in axes:
        along = xr.DataArray(list(axis.values), dims=axis.dimension, coords={axis.dimension: list(axis.values)})
        if axis.kind == "period_factor":
            periods = periods * xr.where(periods["building"] == axis.building, along, 1.0)
        elif axis.kind == "damping_ratio":
            damping = _first_damping(scene, xr.zeros_like(damping) + along)
    return periods, damping


def _first_damping(scene: Scene, ratio: xr.DataArray) -> xr.DataArray:
    """Damping ratios of first modes, along ``building`` too, where those are the ones given for the buildings."""
    for b in scene.foundations:  # the rest is their dashpots'
        building = scene.buildings[b]
        none, half = (replace(building, damping_ratio=given).first_damping for given in (0.0, 0.5))
        ratio = ratio.where(ratio["building"] != building.name, none + 2.0 * (half - none) * ratio)
    return ratio


def _first_modes_of_cases(scene: Scene, cube: xr.Dataset) -> tuple[xr.DataArray, xr.DataArray]:
    """First periods (s) and damping ratios of the buildings along listed cases, as their coordinates say."""
    periods, damping = _first_modes(scene, ())
    if "fundamental_period" in cube.coords:
        periods = cube["fundamental_period"].reset_coords(drop=True)
    if "damping_ratio" in cube.coords:
        given = cube["damping_ratio"].reset_coords(drop=True)
        given = _first_damping(scene, given + 0.0 * damping)
        damping = given.where(given.notnull(), damping)
    return periods, damping
