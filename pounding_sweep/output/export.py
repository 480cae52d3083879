"""Cubes, or parts of them, in other formats: CSV and Parquet as one long table, Zarr as it is.

All are written a part at a time, so that a cube larger than memory can be
exported, and appear under their name only when they are complete.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.base.errors import InputError, OutputError, WriteError, unknown
from pounding_sweep.base.files import failure, replacing, sync, sync_folder
from pounding_sweep.base.paths import expanded
from pounding_sweep.output.dataset import encoding_of
from pounding_sweep.output.netcdf import check_output, reading
from pounding_sweep.output.provenance import plain
from pounding_sweep.output.slabs import BLOCK_BYTES, block_shape
from pounding_sweep.output.tidy import Cells, TidyTable, scenarios_of
from pounding_sweep.output.wide import HistoryTable, ScenarioTable, WideTable, has_histories
from pounding_sweep.outputs.variables import INNER_DIMS


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
    needs, write_table = _WRITERS[ending]
    names = [names] if isinstance(names, str) else list(names)
    kind: type[TidyTable | WideTable] = (
        ScenarioTable if table else HistoryTable if has_histories(cube, names) else TidyTable
    )
    if table and write_table is None:
        msg = f"{str(path)!r}: Zarr holds cubes, no tables; give .csv or .parquet, or leave out the table"
        raise InputError(msg)
    if needs:
        _need(needs, ending)
    target = _new_folder(path) if ending == ".zarr" else check_output(path, overwrite, netcdf=False)
    if ending == ".csv":
        check_output(f"{target}.json", overwrite, netcdf=False)
    try:
        if write_table is None:
            _zarr(cube, target, names)
        else:
            write_table(cube, target, kind(cube, names))
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


def _parts(cube: xr.Dataset, table: TidyTable | WideTable) -> Iterator[dict[str, Cells]]:
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


def _csv(cube: xr.Dataset, path: Path, table: TidyTable | WideTable) -> None:
    import pandas as pd

    about = {
        "table": path.name,
        "rows": table.n_rows,
        "columns": {column.name: column.attributes for column in table.columns},
        "cube": {str(key): plain(value) for key, value in cube.attrs.items()},
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


def _parquet(cube: xr.Dataset, path: Path, table: TidyTable | WideTable) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = pa.schema(
        [
            pa.field(
                column.name,
                pa.string() if column.dtype.kind == "U" else pa.from_numpy_dtype(column.dtype),
                metadata=column.attributes,
            )
            for column in table.columns
        ],
        metadata={str(key): json.dumps(plain(value), ensure_ascii=False) for key, value in cube.attrs.items()},
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
            writing = blocks.to_zarr(unfinished, mode="w-", encoding=encoding, zarr_format=2, compute=False)
            writing.compute(scheduler="synchronous")  # as little in memory as can be
            _sync(unfinished)
    except RuntimeError:  # of the netCDF library: zarr's are of the system
        with reading(_source(cube)):
            raise


def _sync(folder: Path) -> None:
    """Put all files below a folder on disk, and their names."""
    for within, _, names in os.walk(folder):
        for name in names:
            sync(Path(within, name))
        sync_folder(Path(within))


def _count(array: xr.DataArray, dims: Iterable[Any]) -> int:
    return int(np.prod([array.sizes[dim] for dim in dims if dim in array.dims], initial=1))


#: Ending -> package that it needs, and what writes a table; None: it holds cubes.
_WRITERS: dict[str, tuple[str, Callable[[xr.Dataset, Path, TidyTable | WideTable], None] | None]] = {
    ".csv": ("", _csv),
    ".parquet": ("pyarrow", _parquet),
    ".zarr": ("zarr", None),
}
