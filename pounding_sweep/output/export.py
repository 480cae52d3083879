"""Cubes, or parts of them, in other formats, a part at a time: CSV and Parquet as tables, Zarr as it is."""

from __future__ import annotations

import csv
import json
import math
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from pounding_sweep.base.errors import InputError, OutputError, WriteError, check_choice, unknown
from pounding_sweep.base.files import FilePath, expanded, failure, replacing
from pounding_sweep.base.text import CSV_NUMBER, bytes_text
from pounding_sweep.output.audited import AUDIT_DIMS, has_audit
from pounding_sweep.output.dataset import encoding_of
from pounding_sweep.output.identity import plain
from pounding_sweep.output.netcdf import BLOCK_BYTES, block_shape, check_output, slabs, unreadable, with_texts
from pounding_sweep.output.scenario_rows import cube_columns, places_of, scenario_keys
from pounding_sweep.output.select import select
from pounding_sweep.records.record import MEASURES
from pounding_sweep.request.axes import plain_name
from pounding_sweep.request.spec import scene_of
from pounding_sweep.variables.registry import INNER_DIMS, ORIGINS, OUTPUT_NAMES, STATUS, VARIABLES, Status

if TYPE_CHECKING:
    import pandas as pd

#: Cells of a table that are made at a time.
CELLS_AT_A_TIME = 1 << 21
#: Rows beyond which the size of a table is said before it is written, and bytes of one cell of it as text.
MANY_ROWS, CELL_BYTES = 10_000_000, 12
#: Coordinates that describe a law at length; its key tells it.
PROSE = ("law_model", "law_title", "law_formula")
#: Coordinate that is missing at the places of its dimensions where there is nothing.
_PLACES: dict[tuple[str, ...], str] = {
    ("building", "storey"): "floor_elevation",
    ("pair", "storey"): "contact_elevation",
}
#: Variables of which a further column says in words what their numbers mean, and these words.
_WORDS = {"status": np.array([status.label for status in STATUS]), "origin": np.array(ORIGINS)}
_WORDS["unsettled_output"] = np.array(OUTPUT_NAMES)
#: Statuses but "ok", as `export_cube` takes them.
NOT_OK = "not-ok"
#: Dimension of histories.
TIME = "time"


def scenarios_of(cube: xr.Dataset, names: Iterable[str] = ()) -> xr.Dataset:
    """Return the variables `names` of a cube, or all, without its audit."""
    if has_audit(cube):
        cube = cube.drop_dims(AUDIT_DIMS)
    requested: list[Any] = list(dict.fromkeys(names))
    for name in requested:
        check_choice("variable", name, cube.data_vars)
    if not cube.data_vars:
        raise InputError("the cube has no variables; give one made by 'pounding-sweep run'")
    return cube[requested or list(cube.data_vars)]


def outer_dims(dims: Iterable[Any]) -> tuple[str, ...]:
    """Return the dimensions that are not inside a scenario."""
    return tuple(str(dim) for dim in dims if dim not in INNER_DIMS)


def sets_of_dimensions(cube: xr.Dataset) -> dict[tuple[str, ...], list[str]]:
    """Return the dimensions of each table that a dataset needs, and the variables in it: one for a cube of a sweep."""
    tables: dict[tuple[str, ...], list[str]] = {}
    for name in sorted(cube.data_vars, key=lambda name: -len(outer_dims(cube[name].dims))):
        outer = outer_dims(cube[name].dims)
        tables.setdefault(next((table for table in tables if {*outer} <= {*table}), outer), []).append(str(name))
    return tables


class Column(NamedTuple):
    """One column of a table."""

    variable: str  # whose values it has
    at: Mapping[str, int]  # where in that they are, by dimension
    kinds: Sequence[int]  # of rows that have it
    dtype: np.dtype[Any]  # text: object; whole numbers may be missing, too
    attributes: dict[str, str]  # ``units``, ``long_name`` and ``comment``, as far as the cube has them


class Table:
    """A table of a cube: with a row for each floor and contact of each scenario, or `wide`, for each scenario alone."""

    def __init__(self, cube: xr.Dataset, *, wide: bool, constants: bool) -> None:
        self.cube, self.outer, self.columns = cube, outer_dims(cube.dims), dict[str, Column]()
        inner = dict.fromkeys(_inner_dims(cube[name]) for name in cube.data_vars)
        #: dimensions of the places inside a scenario that have rows of their own
        self._kinds = [()] if wide else [kind for kind in inner if not any({*kind} < {*other} for other in inner)]
        self._existing = [np.flatnonzero(_exists(cube, kind)) for kind in self._kinds]
        #: lines that follow the headings of a CSV file
        self.lines: list[list[str]] = []
        #: scenarios that have rows
        self.selected = np.ones([cube.sizes[dim] for dim in self.outer], bool)
        #: returns a part of the cube with what is to be computed of it
        self.complete: Callable[[xr.Dataset], xr.Dataset] = lambda part: part
        names = [str(name) for name in cube.coords if name not in PROSE]
        last = [name for name in INNER_DIMS if name in names]
        first = [*(dim for dim in self.outer if dim in names), *(name for name in names if name not in last)]
        for name in dict.fromkeys([*first, *([] if wide else last), *map(str, cube.data_vars)]):
            array, about = cube[name], dict[str, str]()
            constant = name in names and array.dims and {*array.dims} <= {*INNER_DIMS} - {name}
            dims = (name,) if name in INNER_DIMS else _inner_dims(array)
            kinds = [i for i, kind in enumerate(self._kinds) if wide or {*dims} <= {*kind}]
            for key, value in array.attrs.items():
                if key in ("units", "unit_text", "long_name", "comment") or key.startswith("flag_"):
                    about[key.replace("unit_text", "units")] = " ".join(map(str, np.ravel(value).tolist()))
            # a whole number that may be missing is read as a float
            stored = np.dtype(array.encoding.get("dtype", array.dtype))
            dtype = stored if array.dtype.kind == "f" and stored.kind == "i" else array.dtype
            dtype = dtype if dtype.kind in "iuf" else np.dtype(object)
            inside = [dim for dim in INNER_DIMS if dim in array.dims] if wide else []
            places = np.argwhere(_exists(cube, inside)).tolist() if kinds and (constants or not constant) else []
            for place in places:
                at = dict(zip(inside, place, strict=True))
                label = "_".join([name, *(str(cube[dim].values[i]) for dim, i in at.items())])
                twin = cube.coords.get(plain_name(label, ()))
                # an input of a design is told for all buildings, too
                if not at or twin is None or not np.array_equal(twin.values, array.isel(at).values):
                    label = plain_name(label, self.columns) if wide else name
                    self.columns[label] = Column(name, at, kinds, dtype, about)

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return int(self.selected.sum()) * sum(map(len, self._existing))

    def select(self, names: Iterable[str]) -> None:
        """Give rows to the scenarios of these statuses alone."""
        codes = scenarios_of(self.cube, ["status"])["status"].transpose(*self.outer).values
        self.selected[...] = False
        for name in names:
            chosen = np.equal(_WORDS["status"], Status.OK.label if name == NOT_OK else name)[codes] ^ (name == NOT_OK)
            if not chosen.any():
                present = ", ".join(_WORDS["status"][np.unique(codes)])
                raise InputError(f"no scenario has the status {name!r}; this cube has: {present}")
            self.selected |= chosen

    def parts(self) -> Iterator[pd.DataFrame]:
        """Make the table part by part."""
        import pandas as pd

        cells = max(1, len(self.columns) * sum(map(len, self._existing)))
        for slab in slabs([self.cube.sizes[dim] for dim in self.outer], CELLS_AT_A_TIME // cells):
            part = self.complete(self.cube.isel(dict(zip(self.outer, slab, strict=True))).load())
            selected, frames = self.selected[slab].ravel(), []
            n = len(selected)
            for kind, existing in enumerate(self._existing):
                sizes = {dim: part.sizes[dim] for dim in (*self.outer, *self._kinds[kind]) if dim in part.dims}
                values = {}
                for label, column in self.columns.items():
                    if kind in column.kinds:
                        variable = part.variables[column.variable].isel(column.at)
                        if label == f"{column.variable}_name":
                            variable = variable.copy(data=_WORDS[column.variable][variable.values.astype(int)])
                        if column.dtype.kind == "O":
                            variable = variable.astype(object)
                        values[label] = variable.set_dims(sizes).values.reshape(n, -1)[selected][:, existing].ravel()
                frames.append(pd.DataFrame(values, index=np.repeat(np.arange(selected.sum()), len(existing))))
            rows = frames[0] if len(frames) == 1 else pd.concat(frames).sort_index(kind="stable")
            integers = {label: column.dtype.name for label, column in self.columns.items() if column.dtype.kind == "i"}
            wanted = {label: name.capitalize() for label, name in integers.items() if rows[label].dtype != name}
            yield rows.astype(wanted)[[*self.columns]]


def _exists(cube: xr.Dataset, kind: Sequence[str]) -> np.ndarray:
    """Return which places of a scenario exist, along those dimensions of a `kind` that a selection has left."""
    name, dims = _PLACES.get(tuple(kind), ""), [dim for dim in kind if dim in cube.dims]
    if name not in cube.coords or set(cube[name].dims) != set(dims):
        return np.ones([cube.sizes[dim] for dim in dims], bool)
    return cube[name].transpose(*dims).notnull().values


def _inner_dims(array: xr.DataArray) -> tuple[str, ...]:
    """Dimensions inside a scenario that something belongs to, whether or not a selection took them away."""
    if array.name in VARIABLES:
        return VARIABLES[str(array.name)].dims
    return tuple(str(dim) for dim in array.dims if dim in INNER_DIMS)


def scenario_table(cube: xr.Dataset, names: Sequence[str] = (), constants: bool = False) -> Table:
    """Return the table of scenarios: inputs, measures of their ground motion, outputs, measured errors."""
    if has_histories(cube):
        raise InputError("this is one scenario with its histories; give a cube of a sweep")
    always = [name for name in ("status", "run") if names and name in cube.data_vars]
    chosen = scenarios_of(cube, [*names, *always])
    chosen = chosen.assign_coords(scenarios_of(cube).coords).assign(_measures(cube))
    table = Table(chosen, wide=True, constants=constants)
    # without all buildings and pairs of the row scenarios can't be told apart
    row = scene_of(json.loads(cube.attrs["sweep"])["scene"]) if has_audit(cube) else None
    sizes = [np.size(cube.coords.get(dim, [])) for dim in ("building", "pair")]
    if row is not None and sizes == [len(row.buildings), len(row.pair_labels)]:
        table.complete = lambda part: part.assign(audited_error=_audited_errors(part, cube))
        for i, output in enumerate(cube["output"].values.tolist()):
            if not names or output in names:
                about = {"units": "1", "long_name": f"relative error of {output}, measured at half the step"}
                column = Column("audited_error", {"output": i}, [0], np.dtype(float), about)
                table.columns[f"audited_error_{output}"] = column
    return table


def has_histories(cube: xr.Dataset, names: Iterable[str] = ()) -> bool:
    """Whether the requested variables have histories; a table then has a row for each moment."""
    return any(TIME in cube[name].dims for name in list(names) or cube.data_vars if name in cube.data_vars)


def _measures(cube: xr.Dataset) -> dict[str, xr.Variable]:
    """Return measures of the records as scaled."""
    records = {str(record["name"]): record for record in json.loads(cube.attrs.get("records", "[]"))}
    measures = {}
    for name, (units, text, *powers) in MEASURES.items():
        has_all = powers and records and all(name in record for record in records.values())
        if has_all and "record" in cube.coords:
            record = cube["record"].variable
            values = [float(records[str(key)][name]) for key in np.ravel(record.values)]
            measure = record.copy(data=np.reshape(values, record.shape))
            if "scale" in cube.coords:
                measure = measure * abs(cube["scale"].variable) ** powers[0]
            measure.attrs = {"units": units, "long_name": f"{text}, of the record as scaled"}
            measures[f"ground_{name}"] = measure
    return measures


def _audited_errors(part: xr.Dataset, cube: xr.Dataset) -> xr.Variable:
    """Return the errors of scenarios by output, as the audit of their cube measured them; missing without."""
    outer = {dim: part.sizes[dim] for dim in outer_dims(part.dims)}
    columns = cube_columns(part, json.loads(cube.attrs["sweep"]), outer)
    columns = {name: values for name, values in columns.items() if f"audit_{name}" in cube.coords}
    keys = scenario_keys({name: cube[f"audit_{name}"].transpose("audit", ...).values for name in columns})
    order = np.argsort(keys)
    place = places_of(scenario_keys(columns), keys[order])
    errors = cube["audit_error"].transpose("audit", "output").values[order][place]
    errors[place < 0] = np.nan
    return xr.Variable((*outer, "output"), errors.reshape(*outer.values(), -1))


def export_cube(
    cube: xr.Dataset,
    path: FilePath,
    names: str | Iterable[str] = (),
    *,
    overwrite: bool = False,
    table: bool = False,
    constants: bool = False,
    status: Collection[str] = (),
    units: bool = False,
    parts: Mapping[str, Any] = MappingProxyType({}),
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
    table : bool
        One row for each scenario, with all that is known of it in columns, instead of one for each floor and contact.
    constants : bool
        Whether masses, stiffnesses, periods and elevations that are the same in all scenarios have columns, too.
    status : collection of str
        Only scenarios that ended so, such as ``["diverged"]``; "not-ok" stands for every status but "ok".
    units : bool
        Whether the second line of a CSV file has the units of its columns.
    parts : mapping of str to str, int or sequence of them
        With `table`, values of ``building``, ``pair`` or ``storey``: there are columns of these places only.

    Returns
    -------
    Path
        The absolute path of the file or folder.

    Raises
    ------
    InputError
        The ending, a variable or a status is unknown, no scenario has that status, or what writes the format is not
        installed.
    OutputError
        The path is not usable, or the cube's values can't be read.
    WriteError
        Writing failed, such as on a full disk; the message says whether anything was replaced.

    Notes
    -----
    The table has a row for each floor and each contact of each scenario. With `table` it has one for each scenario:
    what tells scenarios apart, every output at every place (``impact_force_max_left_middle_3``), status,
    ``ground_pga`` and other measures of its record, and ``audited_error_<output>`` where the audit ran it again. Of a
    scenario with its histories the table has a row for each moment.

    ``status_name`` and ``origin_name`` have each status and origin in words, and a CSV file 7 digits of values that are
    no axis. Units and long names stand in ``FILE.csv.json``, or in the metadata of a Parquet file.

    Examples
    --------
    >>> import tempfile
    >>> import xarray as xr
    >>> cube = xr.Dataset({"peak": ("gap", [3.0, 4.0], {"units": "kN"})}, {"gap": [0.01, 0.02]})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     print(export_cube(cube, f"{folder}/peaks.csv").read_text(), end="")
    gap,peak
    0.01,3
    0.02,4
    """
    ending = Path(path).suffix.lower()
    if ending not in _WRITERS:
        raise InputError(f"{str(path)!r}: {unknown('format', ending, _WRITERS)}")
    needs, write = _WRITERS[ending]
    names = [names] if isinstance(names, str) else list(names)
    if (table or constants or status) and ending == ".zarr":
        raise InputError(
            f"{str(path)!r}: Zarr holds cubes, no tables; give .csv or .parquet, or leave out table, constants and "
            "status"
        )
    if needs:
        try:
            import_module(needs)
        except ImportError:
            raise InputError(
                f"{ending} needs the package {needs}, which is not installed; "
                "install it with: pip install 'pounding-sweep[export]'"
            ) from None
    if ending == ".zarr" and expanded(path).exists():
        raise OutputError(f"output {str(path)!r} exists, and folders are not replaced; remove it or give another path")
    target = check_output(path, overwrite, netcdf=False)
    if ending == ".csv":
        check_output(f"{target}.json", overwrite, netcdf=False)
    cube = with_texts(cube)
    try:
        made = scenarios_of(cube, names) if ending == ".zarr" else _table(cube, path, names, table, constants, status)
        if parts and isinstance(made, Table):  # columns of other places are left out
            chosen = {dim: select(made.cube, parts, INNER_DIMS)[dim].values for dim in parts}
            made.columns = {
                label: column
                for label, column in made.columns.items()
                if all(cube[dim].values[i] in chosen[dim] for dim, i in column.at.items() if dim in parts)
            }
        if units and isinstance(made, Table):
            made.lines.append([column.attributes.get("units", "") for column in made.columns.values()])
        write(cube, target, made)
    except RuntimeError as error:  # of the netCDF library
        files = (variable.encoding.get("source") for variable in cube.variables.values())
        raise unreadable("values of cube", next(filter(None, files), "in memory"), error) from error
    except OSError as error:
        raise WriteError(f"{failure(f'writing {str(path)!r}', error)}. Nothing was replaced") from error
    return target


def export_tables(cube: xr.Dataset, path: FilePath, names: Sequence[str] = (), **options: Any) -> list[Path]:
    """Write a table as `export_cube` does, or one for each set of dimensions, which its file is named by."""
    single = options.get("table") or has_histories(cube, names) or Path(path).suffix.lower() == ".zarr"
    tables = {} if single else sets_of_dimensions(scenarios_of(cube, names))
    if len(tables) < 2:
        return [export_cube(cube, path, names, **options)]
    stem = Path(path).stem
    paths = {dims: Path(path).with_stem("-".join([stem, *dims])) for dims in tables}
    return [export_cube(cube, paths[dims], variables, **options) for dims, variables in tables.items()]


def _table(
    cube: xr.Dataset, path: FilePath, names: Sequence[str], by_scenario: bool, constants: bool, status: Collection[str]
) -> Table:
    """Return the table of a cube, or of one scenario with its histories; its size is said if it is large."""
    names = [*names, "status"] if names and status else names
    if by_scenario:
        table = scenario_table(cube, names, constants)
    elif has_histories(cube, names):
        of_time = [str(name) for name, array in cube.data_vars.items() if TIME in array.dims]
        table = Table(scenarios_of(cube, names or of_time), wide=True, constants=constants)
    else:
        chosen = scenarios_of(cube, names)
        sets = sets_of_dimensions(chosen)
        if len(sets) > 1:
            listed = "; ".join(f"({', '.join(dims)}): {', '.join(variables)}" for dims, variables in sets.items())
            raise InputError(
                f"{str(path)!r}: the variables do not share their dimensions, so they make no one table: {listed}; "
                "export each set apart"
            )
        table = Table(chosen, wide=False, constants=constants)
    for name in (name for name in _WORDS if name in table.cube.data_vars):
        about = {"long_name": f"{name} in words"}
        table.columns[f"{name}_name"] = table.columns[name]._replace(dtype=np.dtype(object), attributes=about)
    if status:
        table.select(status)
    if table.n_rows > MANY_ROWS:
        size = bytes_text(table.n_rows * len(table.columns) * CELL_BYTES)
        warnings.warn(
            f"the table {str(path)!r} will have {table.n_rows:,} rows of {len(table.columns)} columns, about {size} as "
            "text; take a part by --at, or some variables by --var",
            RuntimeWarning,
            stacklevel=3,
        )
    return table


def _csv(cube: xr.Dataset, path: Path, table: Table) -> None:
    about = {
        "table": path.name,
        "rows": table.n_rows,
        "columns": {label: column.attributes for label, column in table.columns.items()},
        "cube": {str(key): plain(value) for key, value in cube.attrs.items()},
    }
    axes = {label: object for label, column in table.columns.items() if column.variable in cube.dims}
    with replacing(path.with_name(f"{path.name}.json")) as description, replacing(path) as temporary:
        description.write_text(json.dumps(about, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        with temporary.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([[*table.columns], *table.lines])
            for part in table.parts():
                part.astype(axes).to_csv(file, index=False, header=False, float_format=CSV_NUMBER)


def _parquet(cube: xr.Dataset, path: Path, table: Table) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = pa.schema(
        [
            pa.field(label, pa.string() if kind.kind == "O" else pa.from_numpy_dtype(kind), metadata=about)
            for label, (_, _, _, kind, about) in table.columns.items()
        ],
        metadata={str(key): json.dumps(plain(value), ensure_ascii=False) for key, value in cube.attrs.items()},
    )
    with replacing(path) as temporary, pq.ParquetWriter(temporary, schema) as file:
        for part in table.parts():
            file.write_table(pa.Table.from_pandas(part, schema, preserve_index=False).cast(schema))


def _zarr(cube: xr.Dataset, path: Path, chosen: xr.Dataset) -> None:
    outer = outer_dims(chosen.dims)
    sizes = [chosen.sizes[dim] for dim in outer]
    largest = max(array.nbytes for array in chosen.data_vars.values()) // max(1, math.prod(sizes))
    block = dict(zip(outer, block_shape(sizes, BLOCK_BYTES // max(1, largest)), strict=True))
    encoding: Any = {
        name: {key: value for key, value in encoding_of(str(name), array.dtype).items() if value is not None}
        for name, array in chosen.data_vars.items()
        if array.dtype.kind not in "OSUT"
    }
    with replacing(path) as unfinished:  # in format 2: the later one has no agreed way to store text
        blocks = chosen.drop_encoding().chunk(block)
        writing = blocks.to_zarr(unfinished, mode="w-", encoding=encoding, zarr_format=2, compute=False)
        writing.compute(scheduler="synchronous")  # as little in memory as can be


#: Ending -> package that it needs, and what writes it.
_WRITERS: dict[str, tuple[str, Callable[[xr.Dataset, Path, Any], None]]] = {
    ".csv": ("", _csv),
    ".parquet": ("pyarrow", _parquet),
    ".zarr": ("zarr", _zarr),
}
