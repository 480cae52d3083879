"""Cubes, or parts of them, in other formats: CSV and Parquet as one long table, Zarr as it is.

All are written a part at a time, so that a cube larger than memory can be
exported, and appear under their name only when they are complete.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import InputError, OutputError, WriteError, unknown
from pounding_sweep.base.files import failure, replacing, sync_folder
from pounding_sweep.base.paths import expanded
from pounding_sweep.output.audited import AUDIT_DIMS
from pounding_sweep.output.dataset import encoding_of
from pounding_sweep.output.integrity import reading
from pounding_sweep.output.netcdf import check_output
from pounding_sweep.output.slabs import BLOCK_BYTES, block_shape, slabs
from pounding_sweep.outputs.variables import INNER_DIMS, VARIABLES

if TYPE_CHECKING:
    import xarray as xr


#: Rows of a table that are made at a time.
ROWS_AT_A_TIME = 1 << 17
#: Coordinates that describe a law at length; its key tells it.
_PROSE = ("law_model", "law_title", "law_formula")
#: Coordinate that is missing at the places of its dimensions where there is nothing.
_PLACES: dict[tuple[str, ...], str] = {
    ("building", "storey"): "floor_elevation",
    ("pair", "storey"): "contact_elevation",
}


@dataclass(frozen=True)
class Column:
    """One column of the table.

    Attributes
    ----------
    name : str
        Name of the variable or coordinate.
    dtype : numpy.dtype
        Type of its values; text is of kind "U".
    attributes : dict of str to str
        ``units``, ``long_name`` and ``comment``, as far as the cube has them.
    """

    name: str
    dtype: np.dtype[Any]
    attributes: dict[str, str]


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
        coordinates = [str(name) for name in cube.coords if name not in _PROSE]
        axes = [name for name in self._outer if name in coordinates]
        places = [name for name in INNER_DIMS if name in coordinates]
        more = [name for name in coordinates if name not in (*axes, *places)]
        wanted = [*axes, *more, *places, *map(str, cube.data_vars)]
        self.columns = tuple(
            _column(cube[name]) for name in wanted if any(group.takes(cube[name]) for group in self._groups)
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
        name = _PLACES.get(self.kind, "")
        if name not in self.cube.coords or set(self.cube[name].dims) != set(self.dims):
            return np.ones(math.prod(self.cube.sizes[dim] for dim in self.dims), bool)
        return np.asarray(self.cube[name].transpose(*self.dims).notnull().values).reshape(-1)

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


def _column(given: xr.DataArray) -> Column:
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


def export_cube(
    cube: xr.Dataset, path: str | os.PathLike[str], names: str | Iterable[str] = (), *, overwrite: bool = False
) -> Path:
    """Write a cube, or a selection of it, in another format.

    Parameters
    ----------
    cube : xarray.Dataset
        As `pounding_sweep.open_cube` gives it, or a part of it (`pounding_sweep.output.select.select`).
    path : path-like
        Its ending tells the format: ``.csv``, ``.parquet`` or ``.zarr`` (a folder).
    names : str or iterable of str, optional
        Variables; all by default.
    overwrite : bool
        Whether a file that is there may be replaced; a folder never is.

    Returns
    -------
    Path
        The absolute path of the file or folder.

    Raises
    ------
    InputError
        The ending or a variable is unknown, or what writes the format is not installed.
    OutputError
        The path is not usable, or the cube's values can't be read.
    WriteError
        Writing failed, such as on a full disk; the message says whether anything was replaced.

    Notes
    -----
    See `TidyTable` for the rows of the table. Units and long names stand in ``FILE.csv.json``, or in the metadata of
    the columns of a Parquet file. In Zarr all is as in the cube, without its audit.

    Examples
    --------
    >>> import tempfile
    >>> import xarray as xr
    >>> cube = xr.Dataset({"peak": ("gap", [3.0, 4.0], {"units": "kN"})}, {"gap": [0.01, 0.02]})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     print(export_cube(cube, f"{folder}/peaks.csv").read_text(), end="")
    gap,peak
    0.01,3.0
    0.02,4.0
    """
    ending = Path(path).suffix.lower()
    if ending not in _WRITERS:
        raise InputError(f"{str(path)!r}: {unknown('format', ending, _WRITERS)}")
    needs, write = _WRITERS[ending]
    if needs:
        _need(needs, ending)
    target = _new_folder(path) if ending == ".zarr" else check_output(path, overwrite, netcdf=False)
    if ending == ".csv":
        check_output(f"{target}.json", overwrite, netcdf=False)
    try:
        write(cube, target, [names] if isinstance(names, str) else names)
    except OutputError:  # what is read, and what is said already
        raise
    except OSError as error:
        msg = f"{failure(f'writing {str(path)!r}', error)}. Nothing was replaced"
        raise WriteError(msg) from error
    return target


def _source(cube: xr.Dataset) -> str:
    """Name the file that a cube is read from."""
    places = (variable.encoding.get("source") for variable in cube.variables.values())
    return str(next(filter(None, places), "given"))


def _parts(cube: xr.Dataset, table: TidyTable) -> Iterator[dict[str, Cells]]:
    """Read a table part by part; where that fails, the cube is at fault and not what is written."""
    parts = table.parts()
    while True:
        with reading(_source(cube)):
            part = next(parts, None)
        if part is None:
            return
        yield part


def _need(module: str, ending: str) -> None:
    try:
        import_module(module)
    except ImportError:
        msg = (
            f"{ending} needs the package {module}, which is not installed; "
            "install it with: pip install 'pounding-sweep[export]'"
        )
        raise InputError(msg) from None


def _new_folder(path: str | os.PathLike[str]) -> Path:
    target = expanded(path)
    if target.exists() or target.is_symlink():
        msg = f"output {str(path)!r} exists, and folders are not replaced; remove it or give another path"
        raise OutputError(msg)
    return check_output(target, netcdf=False)


def _csv(cube: xr.Dataset, path: Path, names: Iterable[str]) -> None:
    import pandas as pd

    table = TidyTable(cube, names)
    about = {
        "table": path.name,
        "rows": table.n_rows,
        "columns": {column.name: column.attributes for column in table.columns},
        "cube": {str(key): _plain(value) for key, value in cube.attrs.items()},
    }
    beside = path.with_name(f"{path.name}.json")
    written = False
    try:
        with replacing(beside) as description:
            description.write_text(json.dumps(about, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
            with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
                pd.DataFrame(columns=[column.name for column in table.columns]).to_csv(file, index=False)
                for part in _parts(cube, table):
                    cells = {name: _text_of(*given) for name, given in part.items()}
                    pd.DataFrame(cells).to_csv(file, index=False, header=False)
            written = True
    except OSError as error:
        if written:  # two names can't change at once
            msg = f"{str(path)!r} is complete, but {failure(f'writing {str(beside)!r}', error)}, with --overwrite"
            raise WriteError(msg) from error
        raise


def _text_of(values: np.ndarray, missing: np.ndarray) -> Any:
    """Return cells as pandas writes them: nothing where they are missing, whole numbers without a point."""
    import pandas as pd

    if values.dtype.kind in "iu":
        return pd.arrays.IntegerArray(values, missing) if missing.any() else values
    if values.dtype.kind == "f":
        return np.where(missing, np.nan, values)
    codes = np.unique(values, return_inverse=True)
    return pd.Categorical.from_codes(np.where(missing, -1, codes[1]), categories=codes[0].astype(object))


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _parquet(cube: xr.Dataset, path: Path, names: Iterable[str]) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = TidyTable(cube, names)
    schema = pa.schema(
        [
            pa.field(
                column.name,
                pa.string() if column.dtype.kind == "U" else pa.from_numpy_dtype(column.dtype),
                metadata=column.attributes,
            )
            for column in table.columns
        ],
        metadata={str(key): json.dumps(_plain(value), ensure_ascii=False) for key, value in cube.attrs.items()},
    )
    with replacing(path) as temporary, pq.ParquetWriter(temporary, schema) as file:
        for part in _parts(cube, table):
            cells = [
                pa.array(values.astype(object) if values.dtype.kind == "U" else values, field.type, mask=missing)
                for field, (values, missing) in zip(schema, part.values(), strict=True)
            ]
            file.write_table(pa.table(cells, schema=schema))


def _zarr(cube: xr.Dataset, path: Path, names: Iterable[str]) -> None:
    chosen = scenarios_of(cube, names)
    outer = [dim for dim in chosen.dims if dim not in INNER_DIMS]
    sizes = [chosen.sizes[dim] for dim in outer]
    each = max(array.nbytes // max(1, _count(array, outer)) for array in chosen.data_vars.values())
    block = dict(zip(outer, block_shape(sizes, BLOCK_BYTES // max(1, each)), strict=True))
    encoding: dict[Any, dict[str, Any]] = {}
    for name, stored in chosen.variables.items():
        kept = encoding_of(name, stored) if name in chosen.data_vars else {}
        encoding[name] = {key: value for key, value in kept.items() if value is not None}
    try:
        with replacing(path) as unfinished:
            # format 2: the later one has no agreed way to store text
            blocks = chosen.drop_encoding().chunk(block)
            job = blocks.to_zarr(unfinished, mode="w-", encoding=encoding, zarr_format=2, compute=False)
            job.compute(scheduler="synchronous")  # as little in memory as can be
            _sync(unfinished)
    except RuntimeError:  # of the netCDF library: zarr's are of the system
        with reading(_source(cube)):
            raise


def _sync(folder: Path) -> None:
    """Put all files below a folder on disk, and their names."""
    for within, _, names in os.walk(folder):
        for name in names:
            handle = os.open(os.path.join(within, name), os.O_RDONLY)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)
        sync_folder(Path(within))


def _count(array: xr.DataArray, dims: Iterable[Any]) -> int:
    return int(np.prod([array.sizes[dim] for dim in dims if dim in array.dims], initial=1))


#: Ending -> package that it needs, and what writes it.
_WRITERS: dict[str, tuple[str, Callable[[xr.Dataset, Path, Iterable[str]], None]]] = {
    ".csv": ("", _csv),
    ".parquet": ("pyarrow", _parquet),
    ".zarr": ("zarr", _zarr),
}
