"""Tables of a cube, made a slab at a time: a row for each floor and contact of each scenario, or one per scenario."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.model.laws import get_law
from pounding_sweep.output.audited import AUDIT_DIMS, has_audit
from pounding_sweep.output.netcdf import reading
from pounding_sweep.output.scenario_key import numbered, places_of, scenario_keys
from pounding_sweep.output.slabs import block_shape, slabs
from pounding_sweep.outputs.variables import INNER_DIMS, VARIABLES
from pounding_sweep.records.measures import RecordMeasures
from pounding_sweep.spec.axes import axes_of, plain_name, property_axes
from pounding_sweep.spec.spec import scene_of

if TYPE_CHECKING:
    import pandas as pd

#: Cells of a table that are made at a time.
CELLS_AT_A_TIME = 1 << 21
#: Coordinates that describe a law at length; its key tells it.
PROSE = ("law_model", "law_title", "law_formula")
#: Coordinate that is missing at the places of its dimensions where there is nothing.
_PLACES: dict[tuple[str, ...], str] = {
    ("building", "storey"): "floor_elevation",
    ("pair", "storey"): "contact_elevation",
}
#: Dimension of histories.
TIME = "time"
#: Powers of the record's scale that measures of a ground motion grow with, by name.
_GROWS = {"pga": 1, "pgv": 1, "arias_intensity": 2, "significant_duration": 0, "duration": 0}


def scenarios_of(cube: xr.Dataset, names: Iterable[str] = ()) -> xr.Dataset:
    """Return the variables `names` of a cube, or all, without its audit."""
    if has_audit(cube):
        cube = cube.drop_dims(AUDIT_DIMS)
    requested: list[Any] = list(dict.fromkeys(names))
    for name in requested:
        if name not in cube.data_vars:
            raise InputError(unknown("variable", name, map(str, cube.data_vars)))
    if not cube.data_vars:
        raise InputError("the cube has no variables; give one made by 'pounding-sweep run'")
    return cube[requested or list(cube.data_vars)]


def outer_dims(dims: Iterable[Any]) -> tuple[str, ...]:
    """Return the dimensions that are not inside a scenario."""
    return tuple(str(dim) for dim in dims if dim not in INNER_DIMS)


def sets_of_dimensions(cube: xr.Dataset) -> dict[tuple[str, ...], list[str]]:
    """Return the dimensions of each table that a dataset needs, and the variables in it: one for a cube of a sweep."""
    dims = {str(name): outer_dims(array.dims) for name, array in cube.data_vars.items()}
    kinds = sorted(dict.fromkeys(dims.values()), key=len, reverse=True)
    largest = [one for i, one in enumerate(kinds) if not any(set(one) <= set(other) for other in kinds[:i])]
    tables: dict[tuple[str, ...], list[str]] = {kind: [] for kind in largest}
    for name, outer in dims.items():
        tables[next(kind for kind in largest if set(outer) <= set(kind))].append(name)
    return tables


def has_histories(cube: xr.Dataset, names: Iterable[str] = ()) -> bool:
    """Whether the requested variables have histories; a table then has a row for each moment."""
    return any(TIME in cube[name].dims for name in list(names) or cube.data_vars if name in cube.data_vars)


def with_histories(histories: xr.Dataset, names: Sequence[str]) -> xr.Dataset:
    """Return the requested variables of one scenario, or all that have histories."""
    requested = names or [str(name) for name, array in histories.data_vars.items() if TIME in array.dims]
    peaks = [name for name in requested if name in histories.data_vars and TIME not in histories[name].dims]
    if peaks:
        raise InputError(
            f"{', '.join(peaks)} {'has' if len(peaks) == 1 else 'have'} no history, and others have; export what "
            "has one and what has none apart, by --var"
        )
    return scenarios_of(histories, requested)


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    name: str
    dtype: np.dtype[Any]  # text: object; whole numbers may be missing, too
    attributes: dict[str, str]  # ``units``, ``long_name`` and ``comment``, as far as the cube has them


def column_of(array: xr.DataArray, name: str = "") -> Column:
    """Return the column of a variable or coordinate."""
    about = {key: array.attrs[key] for key in ("units", "unit_text", "long_name", "comment") if key in array.attrs}
    if "unit_text" in about:
        about["units"] = about.pop("unit_text")
    for key in ("flag_values", "flag_meanings"):
        if key in array.attrs:
            about[key] = " ".join(map(str, np.ravel(array.attrs[key]).tolist()))
    dtype = array.dtype
    if dtype.kind == "f":  # a whole number that may be missing is read as a float
        stored = np.dtype(array.encoding.get("dtype", dtype))
        dtype = stored if stored.kind == "i" else dtype
    return Column(name or str(array.name), dtype if dtype.kind in "iuf" else np.dtype(object), about)


class Table:
    """A table of a cube; `kinds` are the dimensions of the places inside a scenario that have rows of their own."""

    def __init__(self, cube: xr.Dataset, kinds: Sequence[tuple[str, ...]]) -> None:
        self.cube, self._kinds = cube, kinds
        self._outer = outer_dims(cube.dims)
        self._sizes = [cube.sizes[dim] for dim in self._outer]
        self.columns: list[Column] = []
        #: of each column: kinds of rows that have it, its variable, and where in that it is, by dimension
        self._sources: list[tuple[list[int], str, dict[str, int]]] = []
        self._dims = [[dim for dim in kind if dim in cube.dims] for kind in kinds]
        places = zip(self._dims, kinds, strict=True)
        self._existing = [np.flatnonzero(_exists(cube, dims, kind)) for dims, kind in places]
        self.n_rows = math.prod(self._sizes) * sum(map(len, self._existing))

    def add(self, name: str, label: str = "", at: Mapping[str, int] | None = None) -> None:
        """Add a column, of one place of a variable or coordinate, or of all where these have rows."""
        array = self.cube[name]
        inner = (name,) if name in INNER_DIMS else _inner_dims(array)
        mine = [i for i, kind in enumerate(self._kinds) if at is not None or set(inner) <= set(kind)]
        if mine:
            self.columns.append(column_of(array, label))
            self._sources.append((mine, name, dict(at or {})))

    def complete(self, part: xr.Dataset) -> xr.Dataset:
        """Return a part of the cube with what is to be computed of it."""
        return part

    def parts(self) -> Iterator[pd.DataFrame]:
        """Make the table part by part."""
        import pandas as pd

        cells = max(1, len(self.columns) * sum(map(len, self._existing)))
        for slab in slabs(self._sizes, block_shape(self._sizes, max(1, CELLS_AT_A_TIME // cells))):
            with reading(file_of(self.cube)):
                part = self.complete(self.cube.isel(dict(zip(self._outer, slab, strict=True))).load())
            frames = [self._rows(part, kind) for kind in range(len(self._kinds))]
            rows = frames[0] if len(frames) == 1 else pd.concat(frames).sort_index(kind="stable")
            for column in self.columns:
                if column.dtype.kind == "i" and rows[column.name].dtype != column.dtype:
                    rows[column.name] = rows[column.name].astype(column.dtype.name.capitalize())
            yield rows[[column.name for column in self.columns]]

    def _rows(self, part: xr.Dataset, kind: int) -> pd.DataFrame:
        """Return the rows of one kind, numbered by scenario."""
        import pandas as pd

        sizes = {dim: part.sizes[dim] for dim in (*self._outer, *self._dims[kind])}
        n = math.prod(part.sizes[dim] for dim in self._outer)
        values = {}
        for column, (kinds, name, at) in zip(self.columns, self._sources, strict=True):
            if kind in kinds:
                variable = part.variables[name].isel(at)
                if is_text := variable.dtype.kind not in "iuf":
                    texts, codes = np.unique(variable.values, return_inverse=True)
                    variable = xr.Variable(variable.dims, codes.reshape(variable.shape))
                cells = variable.set_dims(sizes).values.reshape(n, -1)[:, self._existing[kind]].ravel()
                values[column.name] = pd.Categorical.from_codes(cells, texts.astype(object)) if is_text else cells
        return pd.DataFrame(values, index=np.repeat(np.arange(n), len(self._existing[kind])))


def file_of(cube: xr.Dataset) -> str:
    """Name the file that a cube is read from."""
    files = (variable.encoding.get("source") for variable in cube.variables.values())
    return str(next(filter(None, files), "in memory"))


def _exists(cube: xr.Dataset, dims: Sequence[str], kind: Sequence[str]) -> np.ndarray:
    """Return which places of a scenario exist, along `dims`, those of a `kind` that a selection has left."""
    name = _PLACES.get(tuple(kind), "")
    if name not in cube.coords or set(cube[name].dims) != set(dims):
        return np.ones([cube.sizes[dim] for dim in dims], bool)
    return np.asarray(cube[name].transpose(*dims).notnull().values)


def _inner_dims(array: xr.DataArray) -> tuple[str, ...]:
    """Dimensions inside a scenario that something belongs to, whether or not a selection took them away."""
    if array.name in VARIABLES:
        return VARIABLES[str(array.name)].dims
    return tuple(str(dim) for dim in array.dims if dim in INNER_DIMS)


def long_table(cube: xr.Dataset) -> Table:
    """Return the table with a row for each floor and contact of each scenario."""
    inner = dict.fromkeys(_inner_dims(cube[name]) for name in cube.data_vars)
    table = Table(cube, [kind for kind in inner if not any(set(kind) < set(other) for other in inner)])
    names = [str(name) for name in cube.coords if name not in PROSE]
    first, last = ([name for name in dims if name in names] for dims in (outer_dims(cube.dims), INNER_DIMS))
    for name in (*first, *(name for name in names if name not in (*first, *last)), *last, *map(str, cube.data_vars)):
        table.add(name)
    return table


class WideTable(Table):
    """A table with one row for all places of a scenario, or of a moment: each place has a column."""

    def __init__(self, cube: xr.Dataset) -> None:
        super().__init__(cube, [()])
        coordinates = [str(name) for name in cube.coords if name not in (*PROSE, *INNER_DIMS)]
        axes = [name for name in self._outer if name in coordinates]
        for name in dict.fromkeys([*axes, *coordinates]):
            if set(self._outer) & set(cube[name].dims) or not cube[name].dims:
                self._spread(name)
        for name in map(str, cube.data_vars):
            self._spread(name)

    def _spread(self, name: str) -> None:
        """Add a column for each existing place of a variable or coordinate."""
        array = self.cube[name]
        inner = [dim for dim in INNER_DIMS if dim in array.dims]
        existing = _exists(self.cube, inner, inner)
        for place in product(*(range(array.sizes[dim]) for dim in inner)):
            at = dict(zip(inner, place, strict=True))
            labels = [name, *(str(self.cube[dim].values[i]) for dim, i in at.items())]
            twin = self.cube.coords.get(plain_name("_".join(labels), ()))
            if inner and twin is not None and np.array_equal(twin.values, array.isel(at).values):
                continue  # an input of a design that is told for all buildings, too
            if existing[place]:
                self.add(name, plain_name("_".join(labels), [column.name for column in self.columns]), at)


class ScenarioTable(WideTable):
    """One row for each scenario of a cube: inputs, measures of its ground motion, outputs, measured errors."""

    def __init__(self, cube: xr.Dataset, names: Sequence[str] = ()) -> None:
        if has_histories(cube):
            raise InputError("this is one scenario with its histories; give a cube of a sweep")
        chosen = scenarios_of(cube, [*names, *(name for name in ("status",) if names and name in cube.data_vars)])
        super().__init__(chosen.assign_coords(scenarios_of(cube).coords).assign(_measures(cube)))
        self._audit = _AuditErrors(cube) if has_audit(cube) else None
        for i, output in enumerate(cube["output"].values.tolist() if self._audit else ()):
            if not names or output in names:
                about = {"units": "1", "long_name": f"relative error of {output}, measured at half the step"}
                self.columns.append(Column(f"audited_error_{output}", np.dtype(float), about))
                self._sources.append(([0], _AuditErrors.NAME, {"output": i}))

    def complete(self, part: xr.Dataset) -> xr.Dataset:
        """Add the errors of those scenarios that the audit ran again."""
        return part if self._audit is None else part.assign({_AuditErrors.NAME: self._audit.of(part)})


def _measures(cube: xr.Dataset) -> dict[str, xr.DataArray]:
    """Return measures of the records as scaled."""
    try:
        records = {str(each["name"]): each for each in json.loads(cube.attrs["records"])}
    except (KeyError, TypeError, ValueError):
        return {}
    about = {each.name: each.metadata for each in fields(RecordMeasures)}
    measures = {}
    for name, power in _GROWS.items():
        if "record" in cube.coords and all(name in each for each in records.values()):
            record = cube["record"]
            values = [float(records[str(each)][name]) for each in np.ravel(record.values)]
            measure = xr.DataArray(np.reshape(values, record.shape), dims=record.dims)
            if "scale" in cube.coords:
                measure = measure * abs(cube["scale"].variable) ** power
            text = f"{about[name]['long_name']}, of the record as scaled"
            measures[f"ground_{name}"] = measure.assign_attrs({**about[name], "long_name": text})
    return measures


class _AuditErrors:
    """Errors that the audit of a cube measured, by what the scenarios are."""

    NAME = "audited_error"
    #: what the audited scenarios are known by
    KNOWN_BY = (
        *("law", "record", "scale", "stiffness", "restitution", "gap"),
        *("period_factor", "mass_factor", "damping_ratio", "strength_factor", "hardening"),
    )

    def __init__(self, cube: xr.Dataset) -> None:
        self._sweep = json.loads(cube.attrs["sweep"])
        self._codes: dict[str, int] = {}
        audited = {
            name: numbered(cube[f"audit_{name}"].transpose("audit", ...).values, self._codes)
            for name in self.KNOWN_BY
            if f"audit_{name}" in cube.coords
        }
        self._names, keys = list(audited), scenario_keys(audited)
        order = np.argsort(keys)
        self._keys, self._errors = keys[order], cube["audit_error"].transpose("audit", "output").values[order]

    def of(self, part: xr.Dataset) -> xr.Variable:
        """Return the errors of scenarios by output; missing if the audit did not run them."""
        sizes = {dim: part.sizes[dim] for dim in outer_dims(part.dims)}
        known = {}
        for name, values in self._known(part).items():
            if name in self._names:
                variable = values.variable.copy(data=numbered(values.values, self._codes))
                inner = {dim: size for dim, size in variable.sizes.items() if dim not in sizes}
                known[name] = variable.set_dims(sizes | inner).values.reshape(math.prod(sizes.values()), -1)
        place = places_of(scenario_keys({name: known[name] for name in self._names}), self._keys)
        errors = np.where(place[:, None] < 0, np.nan, self._errors[place])
        return xr.Variable((*sizes, "output"), errors.reshape(*sizes.values(), -1))

    def _known(self, part: xr.Dataset) -> dict[str, xr.DataArray]:
        """Return what the scenarios of a part are known by, as an audit names it."""
        law = part["law"]
        takes = [get_law(key).takes_restitution for key in np.ravel(law.values).astype(str)]
        stiffness = part["contact_stiffness"] if "contact_stiffness" in part.coords else part["stiffness"]
        known: dict[str, xr.DataArray] = {
            "law": law,
            "record": part["record"],
            "scale": part["scale"],
            "stiffness": stiffness.fillna(0.0),
            "restitution": xr.where(law.copy(data=np.reshape(takes, law.shape)), part["restitution"], 1.0),
            "gap": part["pair_gap"],
        }
        axes = property_axes(axes_of(self._sweep)) if self._sweep["cases"] is None else ()
        for kind in ("period_factor", "mass_factor", "strength_factor", "hardening"):
            default = np.nan if kind == "hardening" else 1.0
            values = part[kind] if kind in part.coords else xr.full_like(part["building"], default, dtype=float)
            for axis in axes:
                if axis.kind == kind:
                    values = xr.where(part["building"] == axis.building, part[axis.dimension], values)
            known[kind] = values
        # missing where it is the building's own
        buildings = [item for item in self._sweep["scene"]["row"] if "masses" in item]
        scene_values = [building.uniform_hardening for building in scene_of(self._sweep["scene"]).buildings]
        hardening = xr.DataArray(scene_values, dims="building")
        known["hardening"] = known["hardening"].where(known["hardening"] != hardening)
        known["damping_ratio"] = part["damping_ratio"] if "damping_ratio" in part.coords else xr.DataArray(np.nan)
        ratios = {json.dumps(item["damping_ratio"]) for item in buildings}
        if len(ratios) == 1:
            known["damping_ratio"] = known["damping_ratio"].where(known["damping_ratio"] != json.loads(ratios.pop()))
        return known
