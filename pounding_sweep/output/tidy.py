"""The long table of a cube: a row for each floor and contact of each scenario, made a part at a time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.output.audited import AUDIT_DIMS
from pounding_sweep.output.dataset import encoding_of
from pounding_sweep.output.slabs import block_shape, slabs
from pounding_sweep.outputs.variables import INNER_DIMS, VARIABLES

#: Rows of a table that are made at a time.
ROWS_AT_A_TIME = 1 << 17
#: Coordinates that describe a law at length; its key tells it.
PROSE = ("law_model", "law_title", "law_formula")
#: Coordinate that is missing at the places of its dimensions where there is nothing.
_PLACES: dict[tuple[str, ...], str] = {
    ("building", "storey"): "floor_elevation",
    ("pair", "storey"): "contact_elevation",
}


@dataclass(frozen=True)
class Column:
    """One column of the table."""

    name: str  # name of the variable or coordinate
    dtype: np.dtype[Any]  # type of its values; text is of kind "U"
    attributes: dict[str, str]  # ``units``, ``long_name`` and ``comment``, as far as the cube has them


#: Values of a column, and where it has none
Cells = tuple[np.ndarray, np.ndarray]


class TidyTable:
    """The long table of a cube."""

    def __init__(self, cube: xr.Dataset, names: Iterable[str] = ()) -> None:
        cube = scenarios_of(cube, names)
        self._cube = cube
        self._outer = [str(dim) for dim in cube.dims if dim not in INNER_DIMS]
        self._sizes = [cube.sizes[dim] for dim in self._outer]
        kinds = [_inner(cube[name]) for name in cube.data_vars]
        whole = [kind for kind in dict.fromkeys(kinds) if not any(set(kind) < set(other) for other in kinds)]
        self._groups = [_Group(cube, kind, self._outer) for kind in whole]
        coordinates = [str(name) for name in cube.coords if name not in PROSE]
        axes = [name for name in self._outer if name in coordinates]
        places = [name for name in INNER_DIMS if name in coordinates]
        more = [name for name in coordinates if name not in (*axes, *places)]
        wanted = [*axes, *more, *places, *map(str, cube.data_vars)]
        self.columns = tuple(
            column_of(cube[name]) for name in wanted if any(group.takes(cube[name]) for group in self._groups)
        )
        self.n_rows = math.prod(self._sizes) * sum(group.size for group in self._groups)

    def parts(self) -> Iterator[dict[str, Cells]]:
        """Make the table part by part."""
        each = sum(group.size for group in self._groups)
        shape = block_shape(self._sizes, max(1, ROWS_AT_A_TIME // max(1, each)))
        for slab in slabs(self._sizes, shape):
            part = self._cube.isel(dict(zip(self._outer, slab, strict=True))).load()
            sizes = [part.sizes[dim] for dim in self._outer]
            yield {column.name: self._cells(part[column.name], column, sizes) for column in self.columns}

    def _cells(self, given: xr.DataArray, column: Column, sizes: Sequence[int]) -> Cells:
        values, missing = [], []
        for group in self._groups:
            if group.takes(given):
                found = group.spread(given, sizes)
                gone = np.isnan(found) if found.dtype.kind == "f" else np.zeros(found.shape, bool)
                if column.dtype.kind in "iu" and found.dtype.kind == "f":
                    found = np.where(gone, 0, found)
                values.append(found.astype(column.dtype))
                missing.append(gone)
            else:
                values.append(np.zeros((math.prod(sizes), group.size), column.dtype))
                missing.append(np.ones(values[-1].shape, bool))
        return np.concatenate(values, axis=1).ravel(), np.concatenate(missing, axis=1).ravel()


@dataclass(frozen=True)
class _Group:
    """Places of one kind in a scenario: floors, contacts, buildings, pairs, or the scenario as a whole."""

    cube: xr.Dataset
    kind: tuple[str, ...]
    outer: list[str]

    @property
    def dims(self) -> list[str]:
        """Dimensions of the places, without those that a selection took away."""
        return [dim for dim in self.kind if dim in self.cube.dims]

    @property
    def there(self) -> np.ndarray:
        """Which of the places exist, shape (places,)."""
        return exists(self.cube, self.dims, self.kind).reshape(-1)

    @property
    def size(self) -> int:
        """Rows of one scenario."""
        return int(self.there.sum())

    def takes(self, given: xr.DataArray) -> bool:
        """Whether a variable or coordinate has a value at such a place."""
        name = str(given.name)
        inner = (name,) if name in INNER_DIMS else _inner(given)
        return set(inner) <= set(self.kind)

    def spread(self, given: xr.DataArray, sizes: Sequence[int]) -> np.ndarray:
        """Values at each place of each scenario, shape (scenarios, places that exist)."""
        dims = [*self.outer, *self.dims]
        lengths = [*sizes, *(self.cube.sizes[dim] for dim in self.dims)]
        own = given.transpose(*(dim for dim in dims if dim in given.dims))
        shape = [length if dim in given.dims else 1 for dim, length in zip(dims, lengths, strict=True)]
        full = np.broadcast_to(own.values.reshape(shape), lengths)
        return full.reshape(math.prod(sizes), -1)[:, self.there]


def exists(cube: xr.Dataset, dims: Sequence[str], kind: Sequence[str] | None = None) -> np.ndarray:
    """Return which places of a scenario exist, along `dims`, those of a `kind` that a selection has left."""
    name = _PLACES.get(tuple(dims if kind is None else kind), "")
    if name not in cube.coords or set(cube[name].dims) != set(dims):
        return np.ones([cube.sizes[dim] for dim in dims], bool)
    return np.asarray(cube[name].transpose(*dims).notnull().values)


def scenarios_of(cube: xr.Dataset, names: Iterable[str] = ()) -> xr.Dataset:
    """Return the variables `names` of a cube, or all, without its audit."""
    cube = cube.drop_dims([dim for dim in AUDIT_DIMS if dim in cube.dims])
    asked = list(dict.fromkeys(names))
    for name in asked:
        if name not in cube.data_vars:
            raise InputError(unknown("variable", name, map(str, cube.data_vars)))
    if not cube.data_vars:
        msg = "the cube has no variables; give one made by 'pounding-sweep run'"
        raise InputError(msg)
    return cube[asked] if asked else cube


def _inner(given: xr.DataArray) -> tuple[str, ...]:
    """Dimensions inside a scenario that something belongs to, whether or not a selection took them away."""
    if given.name in VARIABLES:
        return VARIABLES[str(given.name)].dims
    return tuple(str(dim) for dim in given.dims if dim in INNER_DIMS)


def column_of(given: xr.DataArray) -> Column:
    """Return the column of a variable or coordinate."""
    about = {key: given.attrs[key] for key in ("units", "unit_text", "long_name", "comment") if key in given.attrs}
    if "unit_text" in about:
        about["units"] = about.pop("unit_text")
    for key in ("flag_values", "flag_meanings"):
        if key in given.attrs:
            about[key] = " ".join(map(str, np.ravel(given.attrs[key]).tolist()))
    dtype = given.dtype
    if dtype.kind == "f":  # a whole number that may be missing is read as a float
        stored = np.dtype(encoding_of(str(given.name), given.variable).get("dtype", dtype))
        dtype = stored if stored.kind in "iu" else dtype
    elif dtype.kind not in "iu":
        dtype = np.dtype(np.str_)
    return Column(str(given.name), dtype, about)
