"""Wide tables: one row per scenario of a cube, or per moment of one scenario, and a column for each place in it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import fields
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.base.errors import InputError
from pounding_sweep.model.laws import get_law
from pounding_sweep.output import tidy
from pounding_sweep.output.audited import has_audit
from pounding_sweep.output.scenario_key import numbered, places_of, scenario_keys
from pounding_sweep.output.slabs import block_shape, slabs
from pounding_sweep.output.tidy import Cells, Column, column_of, exists, scenarios_of
from pounding_sweep.outputs.variables import INNER_DIMS
from pounding_sweep.records.measures import RecordMeasures
from pounding_sweep.spec.axes import axes_of, plain_name, property_axes
from pounding_sweep.spec.spec import scene_of

#: Dimension of histories.
TIME = "time"
#: Powers of the record's scale that measures of a ground motion grow with, by name.
_GROWS = {"pga": 1, "pgv": 1, "arias_intensity": 2, "significant_duration": 0, "duration": 0}
#: What the audited scenarios are known by.
_KNOWN = (
    *("law", "record", "scale", "stiffness", "restitution", "gap"),
    *("period_factor", "mass_factor", "damping_ratio", "strength_factor", "hardening"),
)
#: Values of a column, shape of the rows, made of a part of the cube.
Make = Callable[["xr.Dataset"], Any]


class WideTable:
    """A table of rows along all dimensions that lie not inside a scenario."""

    def __init__(self, cube: xr.Dataset, names: Iterable[str] = ()) -> None:
        self._cube = cube = scenarios_of(cube, names).assign_coords(scenarios_of(cube).coords)
        self._outer = [str(dim) for dim in cube.dims if dim not in INNER_DIMS]
        self._sizes = [cube.sizes[dim] for dim in self._outer]
        self._made: dict[str, tuple[Column, Make]] = {}
        coordinates = [str(name) for name in cube.coords if name not in (*tidy.PROSE, *INNER_DIMS)]
        for name in dict.fromkeys([*(n for n in self._outer if n in coordinates), *coordinates]):
            if set(self._outer) & set(cube[name].dims) or not cube[name].dims:
                self._spread(name)
        for name in map(str, cube.data_vars):
            self._spread(name)
        self.n_rows = math.prod(self._sizes)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Columns, in their order."""
        return tuple(column for column, _ in self._made.values())

    def _spread(self, name: str) -> None:
        """Add a column for each place of a variable or coordinate that exists."""
        given = self._cube[name]
        inner = [dim for dim in INNER_DIMS if dim in given.dims]
        there = exists(self._cube, inner)
        for place in product(*(range(given.sizes[dim]) for dim in inner)):
            if there[place]:
                at = dict(zip(inner, place, strict=True))
                labels = [str(self._cube[dim].values[i]) for dim, i in at.items()]
                twin = self._cube.coords.get(plain_name("_".join([name, *labels]), ()))
                if inner and twin is not None and np.array_equal(twin.values, given.isel(at).values):
                    continue  # an input of a design that is told for all buildings, too
                self._add(name, column_of(given), partial(_taken, name=name, at=at), labels)

    def _add(self, name: str, about: Column, make: Make, labels: Iterable[str] = ()) -> None:
        own = plain_name("_".join([name, *labels]), self._made)
        self._made[own] = Column(own, about.dtype, about.attributes), make

    def parts(self) -> Iterator[dict[str, Cells]]:
        """Make the table part by part."""
        shape = block_shape(self._sizes, max(1, tidy.ROWS_AT_A_TIME // max(1, len(self._made))))
        for slab in slabs(self._sizes, shape):
            part = self._cube.isel(dict(zip(self._outer, slab, strict=True))).load()
            yield {name: self._cells(column, make(part), part) for name, (column, make) in self._made.items()}

    def _cells(self, column: Column, given: xr.DataArray, part: xr.Dataset) -> Cells:
        own = given.transpose(*(dim for dim in self._outer if dim in given.dims))
        shape = [part.sizes[dim] if dim in given.dims else 1 for dim in self._outer]
        values = np.broadcast_to(own.values.reshape(shape), [part.sizes[dim] for dim in self._outer]).ravel()
        missing = np.isnan(values) if values.dtype.kind == "f" else np.zeros(values.shape, bool)
        if column.dtype.kind in "iu" and values.dtype.kind == "f":
            values = np.where(missing, 0, values)
        return values.astype(column.dtype), missing


class HistoryTable(WideTable):
    """The histories of one scenario: one row for each moment."""

    def __init__(self, one: xr.Dataset, names: Iterable[str] = ()) -> None:
        asked = list(names) or [str(name) for name, array in one.data_vars.items() if TIME in array.dims]
        peaks = [name for name in asked if name in one.data_vars and TIME not in one[name].dims]
        if peaks:
            msg = (
                f"{', '.join(peaks)} {'has' if len(peaks) == 1 else 'have'} no history, and others have; export what "
                "has one and what has none apart, by --var"
            )
            raise InputError(msg)
        super().__init__(one, asked)


def has_histories(cube: xr.Dataset, names: Iterable[str] = ()) -> bool:
    """Whether what is asked for of a dataset has histories; a table then has a row for each moment."""
    asked = list(names) or list(map(str, cube.data_vars))
    return any(TIME in cube[name].dims for name in asked if name in cube.data_vars)


class ScenarioTable(WideTable):
    """One row for each scenario of a cube: inputs, measures of its ground motion, outputs, measured errors."""

    def __init__(self, cube: xr.Dataset, names: Iterable[str] = ()) -> None:
        asked = list(names)
        if has_histories(cube):
            msg = "this is one scenario with its histories; give a cube of a sweep"
            raise InputError(msg)
        super().__init__(cube, [*asked, *(name for name in ("status",) if asked and name in cube.data_vars)])
        self._add_measures(cube)
        if has_audit(cube):
            self._add_audit(cube, asked)

    def _add_measures(self, cube: xr.Dataset) -> None:
        """Add what the records are, as they were scaled."""
        try:
            told = {str(each["name"]): each for each in json.loads(cube.attrs["records"])}
        except (KeyError, TypeError, ValueError):
            return
        about = {each.name: each.metadata for each in fields(RecordMeasures)}
        for name, power in _GROWS.items():
            if "record" in self._cube.coords and all(name in each for each in told.values()):

                def measure(part: xr.Dataset, name: str = name, power: int = power) -> xr.DataArray:
                    record = part["record"]
                    values = [float(told[str(each)][name]) for each in np.ravel(record.values)]
                    own = record.copy(data=np.reshape(values, record.shape))
                    return own * abs(part["scale"]) ** power if "scale" in part.coords else own

                text = {**about[name], "long_name": f"{about[name]['long_name']}, of the record as scaled"}
                self._add(f"ground_{name}", Column("", np.dtype(float), text), measure)

    def _add_audit(self, cube: xr.Dataset, asked: list[str]) -> None:
        """Add the measured errors of the scenarios that were run again; missing for others."""
        texts: dict[str, int] = {}
        known = {
            name: numbered(cube[f"audit_{name}"].transpose("audit", ...).values, texts)
            for name in _KNOWN
            if f"audit_{name}" in cube.coords
        }
        keys = scenario_keys(known)
        order = np.argsort(keys)
        error = cube["audit_error"].transpose("audit", "output").values[order]
        latest: list[Any] = [None, None]  # a part, and the errors of all outputs there

        def errors(part: xr.Dataset, at: int) -> xr.DataArray:
            if latest[0] is not part:
                mine, dims, shape = _known(part, known, texts, cube)
                place = places_of(scenario_keys(mine), keys[order])
                whole = np.where(place[:, None] < 0, np.nan, error[place])
                latest[:] = part, xr.DataArray(whole.reshape(*shape, -1), dims=[*dims, "output"])
            return latest[1].isel(output=at)

        for i, output in enumerate(cube["output"].values.tolist()):
            if not asked or output in asked:
                text = {"units": "1", "long_name": f"relative error of {output}, measured at half the step"}
                self._add(f"audited_error_{output}", Column("", np.dtype(float), text), partial(errors, at=i))


def _taken(part: xr.Dataset, name: str, at: Mapping[str, int]) -> xr.DataArray:
    return part[name].isel(at)


def _known(
    part: xr.Dataset, wanted: Mapping[str, Any], texts: dict[str, int], cube: xr.Dataset
) -> tuple[dict[str, np.ndarray], list[str], list[int]]:
    """Return what the scenarios of a part are known by, as an audit names it, and their dimensions and sizes."""
    dims = [str(dim) for dim in part["status"].dims]
    shape = [part.sizes[dim] for dim in dims]
    told = json.loads(cube.attrs["sweep"])
    laws = np.ravel(part["law"].values).astype(str)
    takes = part["law"].copy(data=np.reshape([get_law(law).takes_restitution for law in laws], part["law"].shape))
    varied = property_axes(axes_of(told)) if told["cases"] is None else ()
    stiffness = part["contact_stiffness"] if "contact_stiffness" in part.coords else part["stiffness"]
    given: dict[str, xr.DataArray] = {
        "law": part["law"],
        "record": part["record"],
        "scale": part["scale"],
        "stiffness": stiffness.fillna(0.0),
        "restitution": xr.where(takes, part["restitution"], 1.0),
        "gap": part["pair_gap"],
    }
    kinds = {"period_factor": 1.0, "mass_factor": 1.0, "strength_factor": 1.0, "hardening": np.nan}
    for kind, usual in kinds.items():
        own = part[kind] if kind in part.coords else xr.full_like(part["building"], usual, dtype=float)
        for axis in varied:
            if axis.kind == kind:
                own = xr.where(part["building"] == axis.building, part[axis.dimension], own)
        given[kind] = own
    hardening = [building.uniform_hardening for building in scene_of(told["scene"]).buildings]
    given["hardening"] = given["hardening"].where(given["hardening"] != xr.DataArray(hardening, dims="building"))
    given["damping_ratio"] = part["damping_ratio"] if "damping_ratio" in part.coords else xr.DataArray(np.nan)
    ratios = {json.dumps(each["damping_ratio"]) for each in told["scene"]["row"] if "masses" in each}
    if len(ratios) == 1:  # of all buildings, as a scenario with that ratio is the scene as given
        given["damping_ratio"] = given["damping_ratio"].where(given["damping_ratio"] != json.loads(ratios.pop()))
    found = {}
    for name in wanted:
        own = given[name].reset_coords(drop=True)
        own = own.copy(data=numbered(own.values, texts))
        inner = [str(dim) for dim in own.dims if dim not in dims]
        whole = own.broadcast_like(part["status"].reset_coords(drop=True)).transpose(*dims, *inner)
        found[name] = whole.values.reshape(math.prod(shape), -1)
    return found, dims, shape
