"""Cubes, or parts of them, in other formats: CSV and Parquet as tables, Zarr as it is.

All are written a part at a time, so that a cube larger than memory can be
exported, and appear under their name only when they are complete.
"""

from __future__ import annotations

import json
import math
import os
import warnings
from collections.abc import Callable, Iterable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import xarray as xr

from pounding_sweep.base.errors import InputError, OutputError, WriteError, unknown
from pounding_sweep.base.files import expanded, failure, replacing, sync, sync_folder
from pounding_sweep.base.text import bytes_text
from pounding_sweep.output.dataset import encoding_of
from pounding_sweep.output.netcdf import check_output, reading
from pounding_sweep.output.provenance import plain
from pounding_sweep.output.slabs import BLOCK_BYTES, block_shape
from pounding_sweep.output.tables import (
    ScenarioTable,
    Table,
    WideTable,
    file_of,
    has_histories,
    long_table,
    outer_dims,
    scenarios_of,
    sets_of_dimensions,
    with_histories,
)

#: Rows beyond which the size of a table is said before it is written, and bytes of one cell of it as text.
MANY_ROWS, CELL_BYTES = 10_000_000, 12


def export_cube(
    cube: xr.Dataset,
    path: str | os.PathLike[str],
    names: str | Iterable[str] = (),
    *,
    overwrite: bool = False,
    table: bool = False,
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
    The table has a row for each floor and each contact of each scenario. With `table` it has one for each scenario: the
    axes and what else tells scenarios apart, every output at every place (``impact_force_max_left_middle_3``), status,
    ``ground_pga``, ``ground_pgv``, ``ground_arias_intensity``, ``ground_significant_duration`` and ``ground_duration``
    of its record as scaled, and ``audited_error_<output>`` where the audit ran it again. Of one scenario with its
    histories the table has a row for each moment; what has no history is exported alone.

    Units and long names stand in ``FILE.csv.json``, or in the metadata of the columns of a Parquet file. In Zarr all is
    as in the cube, without its audit.

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
    names = [names] if isinstance(names, str) else list(names)
    if table and ending == ".zarr":
        raise InputError(f"{str(path)!r}: Zarr holds cubes, no tables; give .csv or .parquet, or leave out the table")
    if needs:
        _need(needs, ending)
    target = _new_folder(path) if ending == ".zarr" else check_output(path, overwrite, netcdf=False)
    if ending == ".csv":
        check_output(f"{target}.json", overwrite, netcdf=False)
    try:
        write(cube, target, scenarios_of(cube, names) if ending == ".zarr" else _table(cube, path, names, table))
    except OutputError:  # what is read, and what is said already
        raise
    except OSError as error:
        raise WriteError(f"{failure(f'writing {str(path)!r}', error)}. Nothing was replaced") from error
    return target


def export_tables(
    cube: xr.Dataset,
    path: str | os.PathLike[str],
    names: Sequence[str] = (),
    *,
    overwrite: bool = False,
    table: bool = False,
) -> list[Path]:
    """Write a table as `export_cube` does, or one for each set of dimensions that the variables `names` have.

    Parameters
    ----------
    cube, path, names, overwrite, table
        As for `export_cube`; the dimensions are added to the name of the file if there are several tables.

    Returns
    -------
    list of Path
        The files.
    """
    single = table or not names or has_histories(cube, names) or Path(path).suffix.lower() == ".zarr"
    tables = {} if single else sets_of_dimensions(scenarios_of(cube, names))
    if len(tables) < 2:
        return [export_cube(cube, path, names, overwrite=overwrite, table=table)]
    stem = Path(path).stem
    paths = {dims: Path(path).with_stem("-".join([stem, *dims])) for dims in tables}
    return [export_cube(cube, paths[dims], some, overwrite=overwrite) for dims, some in tables.items()]


def _table(cube: xr.Dataset, path: str | os.PathLike[str], names: Sequence[str], by_scenario: bool) -> Table:
    """Return the table of a cube, or of one scenario with its histories; its size is said if it is large."""
    if by_scenario:
        table: Table = ScenarioTable(cube, names)
    elif has_histories(cube, names):
        table = WideTable(with_histories(cube, names))
    else:
        chosen = scenarios_of(cube, names)
        sets = sets_of_dimensions(chosen)
        if len(sets) > 1:
            sizes = {dims: math.prod(cube.sizes[dim] for dim in dims) for dims in sets}
            listed = [f"({', '.join(dims)}), {sizes[dims]:,} rows: {', '.join(some)}" for dims, some in sets.items()]
            raise InputError(
                f"{str(path)!r}: the variables do not share their dimensions, so they make no one table: "
                f"{'; '.join(listed)}. Name those of one set by --var, such as --var {next(iter(sets.values()))[0]}; "
                "variables of several sets that are named make a table for each set"
            )
        table = long_table(chosen)
    if table.n_rows > MANY_ROWS:
        size = bytes_text(table.n_rows * len(table.columns) * CELL_BYTES)
        warnings.warn(
            f"the table {str(path)!r} will have {table.n_rows:,} rows of {len(table.columns)} columns, about {size} as "
            "text; take a part by --at, or some variables by --var",
            RuntimeWarning,
            stacklevel=3,
        )
    return table


def _need(module: str, ending: str) -> None:
    try:
        import_module(module)
    except ImportError:
        raise InputError(
            f"{ending} needs the package {module}, which is not installed; "
            "install it with: pip install 'pounding-sweep[export]'"
        ) from None


def _new_folder(path: str | os.PathLike[str]) -> Path:
    target = expanded(path)
    if target.exists() or target.is_symlink():
        raise OutputError(f"output {str(path)!r} exists, and folders are not replaced; remove it or give another path")
    return check_output(target, netcdf=False)


def _csv(cube: xr.Dataset, path: Path, table: Table) -> None:
    import pandas as pd

    names = [column.name for column in table.columns]
    about = {
        "table": path.name,
        "rows": table.n_rows,
        "columns": {column.name: column.attributes for column in table.columns},
        "cube": {str(key): plain(value) for key, value in cube.attrs.items()},
    }
    description = path.with_name(f"{path.name}.json")
    written = False
    try:
        with replacing(description) as text:
            text.write_text(json.dumps(about, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
            with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
                pd.DataFrame(columns=names).to_csv(file, index=False)
                for part in table.parts():
                    part.to_csv(file, index=False, header=False)
            written = True
    except OSError as error:
        if written:  # two names can't change at once
            raise WriteError(
                f"{str(path)!r} is complete, but {failure(f'writing {str(description)!r}', error)}, with --overwrite"
            ) from error
        raise


def _parquet(cube: xr.Dataset, path: Path, table: Table) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    kinds = [pa.string() if column.dtype.kind == "O" else pa.from_numpy_dtype(column.dtype) for column in table.columns]
    columns = zip(table.columns, kinds, strict=True)
    schema = pa.schema(
        [pa.field(column.name, kind, metadata=column.attributes) for column, kind in columns],
        metadata={str(key): json.dumps(plain(value), ensure_ascii=False) for key, value in cube.attrs.items()},
    )
    with replacing(path) as temporary, pq.ParquetWriter(temporary, schema) as file:
        for part in table.parts():
            file.write_table(pa.Table.from_pandas(part, schema, preserve_index=False).cast(schema))


def _zarr(cube: xr.Dataset, path: Path, chosen: xr.Dataset) -> None:
    outer = outer_dims(chosen.dims)
    sizes = [chosen.sizes[dim] for dim in outer]
    largest = max(
        array.nbytes // max(1, math.prod(array.sizes[dim] for dim in outer if dim in array.dims))
        for array in chosen.data_vars.values()
    )
    block = dict(zip(outer, block_shape(sizes, BLOCK_BYTES // max(1, largest)), strict=True))
    encoding: Any = {}
    for name, array in chosen.data_vars.items():
        if array.dtype.kind not in "OSUT":
            stored = encoding_of(str(name), array.dtype, array.encoding)
            encoding[name] = {key: value for key, value in stored.items() if value is not None}
    try:
        with replacing(path) as unfinished:
            # format 2: the later one has no agreed way to store text
            blocks = chosen.drop_encoding().chunk(block)
            writing = blocks.to_zarr(unfinished, mode="w-", encoding=encoding, zarr_format=2, compute=False)
            writing.compute(scheduler="synchronous")  # as little in memory as can be
            _sync(unfinished)
    except RuntimeError:  # of the netCDF library: zarr's are of the system
        with reading(file_of(cube)):
            raise


def _sync(folder: Path) -> None:
    """Put all files below a folder on disk, and their names."""
    for within, _, names in os.walk(folder):
        for name in names:
            sync(Path(within, name))
        sync_folder(Path(within))


#: Ending -> package that it needs, and what writes it.
_WRITERS: dict[str, tuple[str, Callable[[xr.Dataset, Path, Any], None]]] = {
    ".csv": ("", _csv),
    ".parquet": ("pyarrow", _parquet),
    ".zarr": ("zarr", _zarr),
}
