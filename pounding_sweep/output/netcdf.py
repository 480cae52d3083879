"""The one writer and reader of cubes, large ones a slab at a time.

HDF5 is not thread-safe: what touches a netCDF file holds `NETCDF_LOCK`, and so does who reads values of an open cube.
"""

from __future__ import annotations

import errno
import fcntl
import itertools
import math
import os
import shutil
import stat
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import OutputError, WriteError
from pounding_sweep.base.files import FilePath, absolute, failure, remove_leftovers, replacing
from pounding_sweep.base.text import bytes_text
from pounding_sweep.output.dataset import TEXT, VERSION_ATTRIBUTE, CubeParts, encoding_of

if TYPE_CHECKING:
    import netCDF4
    import xarray as xr

#: A part of the dimensions of scenarios.
Slab = tuple[slice, ...]
#: Wanted size (bytes) of one stored block of the largest variable, and of what is held of a cube at a time.
BLOCK_BYTES, SLAB_BYTES = 2**20, 2**25
#: How characters are to be read. Only texts that are labels of their dimension, or alone, say so in the file: xarray
#: reads others that do as objects, of which dask can't tell the size, so that ``chunks="auto"`` would fail.
ENCODING = "utf-8"
#: Endings of files that are not netCDF: sweep files, and what cubes are exported to.
_OTHER_ENDINGS = frozenset({".csv", ".parquet", ".zarr", ".toml"})
#: How arrays are compressed, except those that are written slab by slab, and the least size (bytes) of one that is: to
#: begin with it costs as much as to write it.
COMPRESSION: Any = {"complevel": 4, "shuffle": True}
LEAST_COMPRESSED = 2**14
#: Held by the thread that reads or writes a netCDF file; a thread may take it several times.
NETCDF_LOCK = threading.RLock()
os.register_at_fork(after_in_child=NETCDF_LOCK._at_fork_reinit)  # type: ignore[attr-defined]


class _ReadLock:
    """Held while values of an open cube are read: `NETCDF_LOCK`, then that under which xarray writes files."""

    def __init__(self) -> None:
        from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK

        self._xarray = NETCDF4_PYTHON_LOCK

    def acquire(self, blocking: bool = True) -> bool:
        if NETCDF_LOCK.acquire(blocking):
            if self._xarray.acquire(blocking):
                return True
            NETCDF_LOCK.release()
        return False

    def release(self, *_: object) -> None:
        self._xarray.release()
        NETCDF_LOCK.release()

    __enter__, __exit__ = acquire, release


def block_shape(sizes: Sequence[int], most: int) -> tuple[int, ...]:
    """Return the largest block of at most `most` elements that lie side by side."""
    shape = [1] * len(sizes)
    for axis in reversed(range(len(sizes))):
        count = max(1, most // math.prod(shape))
        if count < sizes[axis]:
            shape[axis] = math.ceil(sizes[axis] / math.ceil(sizes[axis] / count))
            break
        shape[axis] = max(1, sizes[axis])
    return tuple(shape)


def slabs(sizes: Sequence[int], most: int, block: Sequence[int] | None = None) -> Iterator[Slab]:
    """Go through slabs of at most `most` elements, made of whole blocks (at least one) where these are given."""
    block = block or (1,) * len(sizes)
    counts = [math.ceil(size / along) for size, along in zip(sizes, block, strict=True)]
    numbers = block_shape(counts, max(1, most // math.prod(block)))
    steps = [along * number for along, number in zip(block, numbers, strict=True)]
    yield from itertools.product(
        *(
            [slice(i, min(i + step, size)) for i in range(0, size, step)]
            for size, step in zip(sizes, steps, strict=True)
        )
    )


def _target(path: FilePath) -> tuple[Path, int | None]:
    """Return the file that `path` stands for, links followed, so that a link stays one, and its mode if it exists."""
    try:
        target = absolute(path)
        return target, target.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return target, None
    except (OSError, ValueError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise OutputError(f"path {os.fspath(path)!r} is not usable ({reason}); give another path") from None


def check_output(path: FilePath, overwrite: bool = False, *, netcdf: bool = True) -> Path:
    """Check, before a long run, that a cube can be written to `path`; leftovers of killed writers are removed."""
    if netcdf and Path(path).suffix.lower() in _OTHER_ENDINGS:
        raise OutputError(
            f"output {str(path)!r} won't do: netCDF is written here, such as {str(Path(path).with_suffix('.nc'))!r}; "
            "tables are made of a cube by 'pounding-sweep export'"
        )
    target, mode = _target(path)
    folder = target.parent
    fault = ""
    if mode is not None and stat.S_ISDIR(mode):
        fault = f"is a folder; give the path of a file, such as {str(target / 'out.nc')!r}"
    elif mode is not None and not stat.S_ISREG(mode):
        fault = "is not a regular file; give the path of a file to be written"
    elif mode is not None and not overwrite:
        fault = "exists; give another path, or overwrite it (overwrite=True, on the command line --overwrite)"
    elif not folder.is_dir():
        fault = f"is in {str(folder)!r}, which is not a folder; make it first or give another path"
    if fault:
        raise OutputError(f"output {str(path)!r} {fault}")
    remove_leftovers(folder)
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        reason = error.strerror or error
        raise OutputError(
            f"the folder {str(folder)!r} of output {str(path)!r} can't be written ({reason}); give another path"
        ) from None
    return target


def check_space(folder: Path, needed: int, what: str) -> None:
    """Raise `OutputError` if the disk of `folder` has less than `needed` bytes free for `what`."""
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise OutputError(
            f"{what} needs about {bytes_text(needed)} of disk, {bytes_text(free)} are free in "
            f"{str(folder)!r}; free some space, give a path on another disk, or take fewer values on an axis"
        )


def _access_fault(path: Path, remedy: str = "copy the cube to another drive") -> str:
    """Say why a file can't be opened, if its content is not to blame: permissions, the drive, or another program."""
    try:
        with path.open("rb") as file:
            file.read(1)
            if os.environ.get("HDF5_USE_FILE_LOCKING", "").upper() not in ("FALSE", "0"):
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in (errno.EAGAIN, errno.EACCES) and error.filename is None:
            return "another program has it open for writing; wait until that is done, or close it there"
        if error.errno in (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP):
            return f"its drive grants no locks: set HDF5_USE_FILE_LOCKING=FALSE or {remedy}"
        return f"{error.strerror or error}; check the permissions of the file, and its drive"
    return ""


def unreadable(what: str, path: FilePath, error: Exception) -> OutputError:
    """Return the error that a cube, or `what` of it, can't be read: it is damaged only if the file is accessible."""
    fault, name = _access_fault(Path(path)), os.fspath(path)
    if not fault and isinstance(error, OSError) and (error.errno or 0) > 0:
        fault = f"{error.strerror or error}; check the permissions of the file, and its drive"
    if fault:
        return OutputError(f"{what} {name!r} can't be read: {fault}")
    damaged = "it is damaged or another kind of file. Run its sweep again, or leave it out"
    return OutputError(f"{what} {name!r} can't be read as netCDF ({error}): {damaged}")


@contextmanager
def reading(path: str) -> Iterator[None]:
    """Read values of a cube in the block; if that fails, the error names the file."""
    try:
        yield
    except OutputError:
        raise
    except Exception as error:  # the libraries raise anything at a damaged file
        raise unreadable("values of cube", path, error) from error


def _encoded(attributes: Mapping[Any, Any]) -> dict[Any, Any]:
    """Encode text beyond ASCII: else it becomes a string of any length, which not every reader knows."""
    return {
        key: text.encode() if isinstance(text, str) and not text.isascii() else text for key, text in attributes.items()
    }


def write_cube(dataset: xr.Dataset, path: FilePath, overwrite: bool = False) -> Path:
    """Write a dataset as a netCDF-4 file that is either complete or not there."""
    loaded = dataset.compute(scheduler="synchronous")  # other threads of dask would wait for the lock
    parts = CubeParts({}, {}, dataset.attrs)
    for name, variable in loaded.variables.items():
        part = parts.coords if name in dataset.coords else parts.data_vars
        values = variable.values.astype("i1") if variable.dtype.kind == "b" else variable.values
        part[str(name)] = (tuple(map(str, variable.dims)), values, variable.attrs)
    return write_in_slabs(parts, path, overwrite=overwrite)


def write_in_slabs(
    cube: CubeParts,
    path: FilePath,
    values_of: Callable[[Slab], Mapping[str, np.ndarray]] | None = None,
    *,
    overwrite: bool = False,
    folder: Path | None = None,
) -> Path:
    """Write a cube as `write_cube` does; with `values_of`, results of scenarios are made while it is written."""
    import netCDF4

    target = check_output(path, overwrite)
    try:
        with NETCDF_LOCK, replacing(target, folder) as temporary:
            try:
                file = netCDF4.Dataset(temporary, "w")
            except OSError as error:
                if temporary.exists() and (fault := _access_fault(temporary, "give a path on another drive")):
                    raise WriteError(f"{str(path)!r} can't be written: {fault}") from error
                raise
            with file:
                _write(file, cube, values_of)
    except OutputError:  # what is written can't be read
        raise
    except (OSError, RuntimeError) as error:
        raise WriteError(f"{failure(f'writing {str(path)!r}', error)}. Nothing was replaced") from error
    return target


def _write(
    file: netCDF4.Dataset, cube: CubeParts, values_of: Callable[[Slab], Mapping[str, np.ndarray]] | None
) -> None:
    """Fill an open file."""
    outer, later = cube.data_vars["status"][:2] if values_of else ((), np.empty(0))
    blocks, sizes = dict[str, tuple[int, ...]](), later.shape
    if values_of is not None:
        arrays = {name: array for name, (dims, array, _) in cube.data_vars.items() if dims[: len(outer)] == outer}
        inner = {name: array.shape[len(sizes) :] for name, array in arrays.items()}
        widths = [encoding_of(name, arrays[name].dtype)["dtype"].itemsize * math.prod(inner[name]) for name in arrays]
        block = block_shape(sizes, BLOCK_BYTES // max(widths))
        blocks = {name: (*block, *inner[name]) for name in arrays}
    # the attribute ``coordinates`` of each variable, as xarray has it: the file's names those of none
    labels = {name: set(label[0]) for name, label in cube.coords.items() if name not in label[0]}
    belong = {name: {label for label in labels if labels[label] <= set(v[0])} for name, v in cube.data_vars.items()}
    belong[""] = set(labels).difference(*belong.values())
    coordinates = {name: {"coordinates": " ".join(sorted(names))} for name, names in belong.items() if names}
    file.setncatts(_encoded(cube.attrs) | coordinates.get("", {}))
    file.set_fill_off()
    # all are made before values are written: what is made later costs the library as much as many values
    declared = {}
    for name, (dims_of, raw, attributes) in {**cube.data_vars, **cube.coords}.items():
        dims, values, text = dims_of, raw, {}
        if raw.dtype.kind in "OSUT":
            texts = np.char.encode(raw.astype(str), ENCODING)
            values = texts.reshape(*texts.shape, 1).view("S1")
            dims = (*dims_of, f"string{values.shape[-1]}")
            text = {"_Encoding": ENCODING} if dims_of in ((), (name,)) else {}
        encoding = encoding_of(name, raw.dtype, is_coordinate=name in cube.coords)
        fill, dtype = encoding["_FillValue"], np.dtype(encoding.get("dtype", values.dtype))
        if dtype.kind == "i" and raw.dtype.kind == "f" and name not in blocks:
            with np.errstate(invalid="ignore"):
                values = np.where(np.isnan(raw), fill or 0, raw).astype(dtype)
            if not np.array_equal(np.where(values == fill, np.nan, values), raw, equal_nan=True):
                values, fill, dtype = raw, np.nan, raw.dtype  # such as the median of numbers of impacts
        for dim, size in zip(dims, values.shape, strict=True):
            if dim not in file.dimensions:
                file.createDimension(dim, size)
        # checksums: damage is found when it is read; they cost next to nothing
        stored: netCDF4.Variable[Any] = file.createVariable(
            name,
            dtype,
            dims,
            fletcher32=bool(dims),
            fill_value=False if fill is None else fill,
            chunksizes=blocks.get(name),
            zlib=name not in blocks and values.nbytes >= LEAST_COMPRESSED,
            **COMPRESSION,
        )
        stored.set_auto_maskandscale(False)
        stored.set_auto_chartostring(False)
        if name in blocks:
            stored.set_var_chunk_cache(size=1)  # none: whole blocks are written (0 stands for the default)
        stored.setncatts(_encoded(attributes) | text | coordinates.get(name, {}))
        declared[name] = stored, values
    for name, (stored, values) in declared.items():
        if name not in blocks:
            stored[...] = values
    if values_of is not None:
        for slab in slabs(sizes, SLAB_BYTES // (2 * sum(widths)), block):
            made = values_of(slab)
            for name in blocks:
                declared[name][0][slab] = made[name]


def with_texts(cube: xr.Dataset) -> xr.Dataset:
    """Return a cube that xarray opened with its texts as `open_cube` reads them, and not as bytes and objects."""
    texts = {}
    for name, variable in cube.variables.items():
        if variable.dtype.kind in "OS":
            values = variable.values
            text = values.astype(str) if values.dtype.kind == "O" else np.char.decode(values, ENCODING)
            encoding = {**TEXT, **COMPRESSION, "zlib": True, "fletcher32": True}  # for who writes it anew with xarray
            texts[name] = (variable.dims, text, variable.attrs, encoding)
    return cube.assign(texts)


def open_cube(path: FilePath) -> xr.Dataset:
    """Open a cube; its values are read where they are used.

    Parameters
    ----------
    path : path-like
        A file made by this package.

    Returns
    -------
    xarray.Dataset
        To be closed by the caller: ``with open_cube(path) as cube: ...``

    Raises
    ------
    OutputError
        There is no such file, or it is not finished; it can't be read as netCDF, or it is no cube of this package.

    Notes
    -----
    Every array carries checksums: where the values of a damaged file are read later, the library raises RuntimeError.

    Examples
    --------
    >>> import tempfile
    >>> import pounding_sweep as ps
    >>> sweep = ps.Sweep("mate2015", records="el_centro", laws="linear", gaps=[0.01, 0.02])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     sweep.run(f"{folder}/gaps.nc").close()
    ...     with open_cube(f"{folder}/gaps.nc") as cube:
    ...         print(cube["gap"].values)
    [0.01 0.02]
    """
    import netCDF4
    import xarray as xr

    target, mode = _target(path)
    if mode is None and os.path.isfile(f"{target}.parts/manifest.jsonl"):
        raise OutputError(
            f"cube {str(path)!r} is not finished: its chunks wait in {f'{target}.parts'!r}; the same 'run' command "
            f"completes it, 'pounding-sweep info {path}' tells what is missing"
        )
    if mode is None or not stat.S_ISREG(mode):
        what = "does not exist" if mode is None else "is not a file"
        raise OutputError(f"cube {str(path)!r} {what}; give the path of a file made by 'pounding-sweep run'")
    try:
        with NETCDF_LOCK:
            cache = netCDF4.get_chunk_cache()
            netCDF4.set_chunk_cache(2**22)  # the library's 64 MiB are too much for each of many variables
            try:  # one handle: two on a file may crash the library
                store = xr.backends.NetCDF4DataStore.open(target, lock=_ReadLock())
            finally:
                netCDF4.set_chunk_cache(*cache)
            try:
                dataset = xr.open_dataset(store, decode_times=False)
                cube = with_texts(dataset)
            except BaseException:
                store.close()
                raise
    except Exception as error:  # the libraries raise anything at a damaged file
        raise unreadable("cube", path, error) from None
    cube.set_close(dataset.close)
    cube.encoding["source"] = str(target)  # as xarray names files that it opens itself
    if VERSION_ATTRIBUTE not in cube.attrs:
        cube.close()
        raise OutputError(
            f"{str(path)!r} is a netCDF file, but not one of this package (no attribute {VERSION_ATTRIBUTE!r}); "
            "give a file made by 'pounding-sweep run'"
        )
    return cube
