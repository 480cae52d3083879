"""The one writer and reader of cubes.

A file appears under its name only when it is complete and on disk. HDF5 is
not thread-safe: everything of this package that touches a netCDF file holds
`NETCDF_LOCK`, as does whoever reads values of a cube that `open_cube` has opened.
"""

from __future__ import annotations

import errno
import itertools
import math
import os
import shutil
import stat
import tempfile
import threading
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import OutputError, WriteError
from pounding_sweep.base.files import failure, remove_leftovers, replacing
from pounding_sweep.base.paths import absolute
from pounding_sweep.base.tables import bytes_text
from pounding_sweep.output.audited import AUDIT_DIMS
from pounding_sweep.output.dataset import TEXT, VERSION_ATTRIBUTE, encoding_of, stored_as
from pounding_sweep.output.frame import Array, Frame
from pounding_sweep.output.slabs import cuts
from pounding_sweep.outputs.variables import VARIABLES

if TYPE_CHECKING:
    import h5py
    import netCDF4
    import numpy.typing as npt
    import xarray as xr


#: Bytes of the checksum behind a block.
_CHECKSUM = 4


def wrongly_stored(path: Path) -> str | None:
    """Say what in a file is not stored as this package does it; None if nothing, or if it is no HDF5 file."""
    import h5py

    if not h5py.is_hdf5(path):
        return None
    taken: set[int] = set()
    with h5py.File(path, "r") as file:
        for name in file.id:
            if file.id.links.get_info(name).type != h5py.h5l.TYPE_HARD:
                return f"{name.decode()!r} is a link to something else"
            found = h5py.h5o.open(file.id, name)
            if isinstance(found, h5py.h5g.GroupID):  # the netCDF library would look into it before it can be refused
                return "it has groups, or types of its own"
            if isinstance(found, h5py.h5d.DatasetID):
                kept = found.get_create_plist()
                if kept.get_external_count() or kept.get_layout() == h5py.h5d.VIRTUAL:
                    return f"the values of {name.decode()!r} stand in other files"
                if kept.get_layout() == h5py.h5d.CHUNKED and not _blocks_are_whole(found, kept, taken):
                    return f"blocks of the values of {name.decode()!r} are missing, or without checksums"
    return None


def _blocks_are_whole(values: h5py.h5d.DatasetID, kept: h5py.h5p.PropDCID, taken: set[int]) -> bool:
    """Whether each block is there once, is found where it belongs, and is read with its checksum, if there are any."""
    import h5py

    filters = [kept.get_filter(i)[0] for i in range(kept.get_nfilters())]
    checked = sum(1 << i for i, each in enumerate(filters) if each == h5py.h5z.FILTER_FLETCHER32)
    blocks: list[Any] = []
    if all(values.shape):
        values.chunk_iter(blocks.append)
    starts = [range(0, size, block) for size, block in zip(values.shape, kept.get_chunk(), strict=True)]
    if len(blocks) != math.prod(map(len, starts)):  # which may be more than can be counted
        return False
    corners = list(itertools.product(*starts))
    places = {block.byte_offset for block in blocks}
    shared = places & taken
    taken |= places
    return (
        {block.chunk_offset for block in blocks} == set(corners)
        and len(places) == len(blocks) == len(corners)
        and not shared
        and not any(block.filter_mask & checked for block in blocks)
        and not any(checked and block.size <= _CHECKSUM for block in blocks)  # at which the library crashes
        and all(_is_found(values, corner) for corner in corners)
    )


def _is_found(values: h5py.h5d.DatasetID, corner: tuple[int, ...]) -> bool:
    """Whether the library finds a block when it reads: it looks it up, and then sees that there is no room for it."""
    try:
        values.read_direct_chunk(corner, out=bytearray())
    except ValueError:
        return True
    except RuntimeError:
        pass
    return False


#: No compressed file holds more bytes per byte of its own: the limit of deflate, and something for headers.
MOST_PACKED = 1100
#: Attributes of variables that change what is read; this package writes none of them.
_RECODING = ("scale_factor", "add_offset", "dtype", "_Unsigned", "missing_value", "valid_range")
#: Values of an axis at most, characters of a text, and of all texts together: they are in memory while a cube is open.
LONGEST_AXIS, LONGEST_TEXT, MOST_CHARACTERS = 2**24, 2**12, 2**29
#: How characters are to be read. Only texts that are labels of their dimension, or alone, say so in the file: xarray
#: reads others that do as objects, of which dask can't tell the size, so that ``chunks="auto"`` would fail.
ENCODING = "utf-8"
#: Attributes that are text where they are there.
_TEXTS = ("units", "unit_text", "long_name", "coordinates", "standard_name", "comment")
#: Numbers of the audit among the attributes of a cube.
_AUDIT_NUMBERS = ("audit_touching", "audit_share", "audit_perturbation", "audit_undecided_share")


def _header_faults(file: netCDF4.Dataset, size: int) -> Iterator[str]:
    """Say what in a netCDF file's header is not as this package writes it."""
    if file.groups or file.cmptypes or file.vltypes or file.enumtypes:
        yield "it has groups, or types of its own"
    texts = sum(variable.size for variable in file.variables.values() if _is_of_characters(variable))
    if texts > MOST_CHARACTERS:
        yield f"its texts have {texts} characters, more than {MOST_CHARACTERS}"
    for name, variable in file.variables.items():
        dtype = np.dtype(variable.dtype)
        if dtype.kind not in "iufS":  # nor text of any length
            yield f"variable {name!r} has type {dtype}, neither number nor characters"
        labels = variable.dimensions[:1] == (name,)  # names of statuses, along which a trade counts
        characters = _is_of_characters(variable)
        if name in VARIABLES and not labels and characters:
            yield f"variable {name!r} is text"
        if len(set(variable.dimensions)) < len(variable.dimensions):
            yield f"variable {name!r} has a dimension twice"
        count = math.prod(len(dim) for dim in variable.get_dims())
        most = size if variable.chunking() == "contiguous" else MOST_PACKED * size
        if count * dtype.itemsize > most:
            yield f"variable {name!r} has {count} values, more than a file of {size} bytes can hold"
        if labels and len(variable) > LONGEST_AXIS:
            yield f"axis {name!r} has {len(variable)} values, more than {LONGEST_AXIS}"
        if characters and variable.shape and variable.shape[-1] > LONGEST_TEXT:
            yield f"texts of {name!r} have {variable.shape[-1]} characters, more than {LONGEST_TEXT}"
        attributes = {key: variable.getncattr(key) for key in variable.ncattrs()}
        for key in _RECODING:
            if key in attributes:
                yield f"variable {name!r} has an attribute {key!r}"
        says = characters and _says_encoding(name, variable.dimensions[:-1])
        # xarray writes it for all texts
        encoding = attributes.get("_Encoding", ENCODING if characters and not says else None)
        if encoding != (ENCODING if characters else None):
            yield (
                f"variable {name!r} has {'no' if characters else 'an'} attribute '_Encoding'"
                f"{f' of {ENCODING!r}' * characters}"
            )
        for key in _TEXTS:
            if not isinstance(attributes.get(key, ""), str):
                yield f"attribute {key!r} of variable {name!r} is no text"
    yield from _audit_faults(file)


def _says_encoding(name: Hashable, dims: Sequence[Hashable]) -> bool:
    """Whether a text of a file says how it is encoded."""
    return tuple(dims) in ((), (name,))


def _is_of_characters(variable: netCDF4.Variable) -> bool:
    return bool(np.dtype(variable.dtype).kind == "S")


def _audit_faults(file: netCDF4.Dataset) -> Iterator[str]:
    """Find what is missing of an audit that is there in part."""
    if "audit_error" not in file.variables:
        return
    if set(file["audit_error"].dimensions) != set(AUDIT_DIMS):
        yield f"variable 'audit_error' has dimensions {file['audit_error'].dimensions}, not {AUDIT_DIMS}"
    sample, outputs = AUDIT_DIMS
    for name, dimension in (("audit_sensitive", sample), ("audit_undecided", sample), ("output", outputs)):
        dimensions = file[name].dimensions if name in file.variables else ()
        if dimensions[: 1 if name == "output" else None] != (dimension,):  # then the characters of its texts
            yield f"variable {name!r} is missing, or is not along {dimension!r}"
    for name in _AUDIT_NUMBERS:
        value = file.getncattr(name) if name in file.ncattrs() else None
        if not isinstance(value, (int, float, np.number)):
            yield f"attribute {name!r} is {value!r}, no number"


class _OneLock(type(threading.RLock())):  # type: ignore[misc]
    """A lock of the process that one thread may hold several times; what is pickled with it finds that of its own."""

    def __reduce__(self) -> str:
        return "NETCDF_LOCK"


NETCDF_LOCK = _OneLock()
os.register_at_fork(after_in_child=NETCDF_LOCK._at_fork_reinit)


class _ReadLock:
    """What is held while values of an open cube are read: `NETCDF_LOCK`, then that under which xarray writes files."""

    def acquire(self, blocking: bool = True) -> bool:
        from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK

        if not NETCDF_LOCK.acquire(blocking):
            return False
        if not NETCDF4_PYTHON_LOCK.acquire(blocking):
            NETCDF_LOCK.release()
            return False
        return True

    def release(self) -> None:
        from xarray.backends.netCDF4_ import NETCDF4_PYTHON_LOCK

        NETCDF4_PYTHON_LOCK.release()
        NETCDF_LOCK.release()

    def __enter__(self) -> None:
        self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()


#: Endings of what is no netCDF file: sweep files, and what cubes are exported to.
_OTHER_ENDINGS = frozenset({".csv", ".parquet", ".zarr", ".toml"})
#: What an unfinished run has beside its cube, as long as it can go on.
_UNFINISHED = ".parts/identity.json"
#: Memory (bytes) in which a variable of an opened cube keeps what was read last; the library's 64 MiB are too much
#: for the many variables of a cube.
READ_CACHE = 2**22
#: How the arrays of a dataset that is written in one piece are compressed, and checked when they are read.
COMPRESSION = {"zlib": True, "complevel": 4, "shuffle": True, "fletcher32": True}
#: Least size (bytes) of a label that is compressed by `write_in_slabs`: to begin with it costs as much as to write it.
LEAST_COMPRESSED = 2**14


def _target(path: str | os.PathLike[str]) -> tuple[Path, int | None]:
    """Return the file that `path` stands for, links followed, so that a link stays one, and its mode if it is there."""
    try:
        target = absolute(path)
        str(target).encode()  # the netCDF library opens no other names
        return target, target.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return target, None
    except (OSError, ValueError, RuntimeError) as error:
        reason = "no UTF-8" if isinstance(error, UnicodeError) else getattr(error, "strerror", None) or error
        msg = f"path {os.fspath(path)!r} is not usable ({reason}); give another path"
        raise OutputError(msg) from None


def check_output(path: str | os.PathLike[str], overwrite: bool = False, *, netcdf: bool = True) -> Path:
    """Check, before a long run, that a cube can be written to `path`; what killed writers left beside it is removed."""
    if netcdf and Path(path).suffix.lower() in _OTHER_ENDINGS:
        msg = (
            f"output {str(path)!r} won't do: netCDF is written here, such as {str(Path(path).with_suffix('.nc'))!r}; "
            "tables are made of a cube by 'pounding-sweep export'"
        )
        raise OutputError(msg)
    target, mode = _target(path)
    if mode is not None and stat.S_ISDIR(mode):
        msg = f"output path {str(path)!r} is a folder; give the path of a file, such as {str(target / 'out.nc')!r}"
        raise OutputError(msg)
    if mode is not None and not stat.S_ISREG(mode):
        msg = f"output path {str(path)!r} is not a regular file; give the path of a file to be written"
        raise OutputError(msg)
    if mode is not None and not overwrite:
        msg = (
            f"output file {str(path)!r} exists; give another path, or overwrite it "
            "(overwrite=True, on the command line --overwrite)"
        )
        raise OutputError(msg)
    if _is_too_long(target):
        msg = f"the name of output {str(path)!r} is too long for what stands beside it in a run; give a shorter path"
        raise OutputError(msg)
    folder = target.parent
    if not folder.is_dir():
        what = "is not a folder" if folder.exists() else "does not exist"
        msg = f"the folder {str(folder)!r} of output {str(path)!r} {what}; make it first or give another path"
        raise OutputError(msg)
    remove_leftovers(folder)
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        reason = error.strerror or error
        msg = f"the folder {str(folder)!r} of output {str(path)!r} can't be written ({reason}); give another path"
        raise OutputError(msg) from None
    return target


def _is_too_long(target: Path) -> bool:
    """Whether a chunk, in the folder beside a cube, would have a name or a path that is too long."""
    try:
        os.stat(f"{target}.parts/{'x' * 64}")
    except OSError as error:
        return error.errno == errno.ENAMETOOLONG
    return False


def free_space(folder: Path) -> int | None:
    """Return the bytes that are free on the disk of `folder`; None where its file system does not say."""
    usage = shutil.disk_usage(folder)
    return usage.free if usage.total else None


def check_space(folder: Path, needed: int, what: str) -> None:
    """Raise `OutputError` where the disk of `folder` has less than `needed` bytes free for `what`."""
    free = free_space(folder)
    if free is not None and needed > free:
        msg = (
            f"{what} needs about {bytes_text(needed)} of disk, {bytes_text(free)} are free in "
            f"{str(folder)!r}; free some space, give a path on another disk, or take fewer values on an axis"
        )
        raise OutputError(msg)


def _encoding(name: Hashable, array: xr.DataArray, is_coordinate: bool) -> dict[str, Any]:
    encoding = stored_as(name, array.variable, is_coordinate)
    if encoding.get("dtype") == TEXT["dtype"]:
        return {**encoding, **COMPRESSION}
    if array.dtype.kind == "f" and not _holds(encoding.get("dtype", array.dtype), encoding["_FillValue"], array):
        encoding = {"_FillValue": array.dtype.type(np.nan)}  # such as the median of numbers of impacts
    if array.ndim and array.dtype.kind in "iuf":
        encoding.update(COMPRESSION)
    return encoding


def _plain(attributes: Mapping[Any, Any]) -> dict[Any, Any]:
    """Encode text beyond ASCII: else it becomes a string of any length, which not every reader knows."""
    beyond = {key: text for key, text in attributes.items() if isinstance(text, str) and not text.isascii()}
    return {**attributes, **{key: text.encode() for key, text in beyond.items()}}


def _with_plain_attributes(dataset: xr.Dataset) -> xr.Dataset:
    found = dataset.assign_attrs(_plain(dataset.attrs))
    for variable in found.variables.values():  # of a copy
        variable.attrs = _plain(variable.attrs)
    return found


def _beside(dataset: xr.Dataset) -> dict[Hashable, xr.Variable]:
    """Return texts that do not say their encoding as bytes, as which xarray writes them so."""
    texts = {name: array for name, array in dataset.variables.items() if array.dtype.kind in "OUT"}
    return {
        name: array.copy(data=np.char.encode(array.values.astype(str), ENCODING))
        for name, array in texts.items()
        if not _says_encoding(name, array.dims)
    }


def _holds(dtype: npt.DTypeLike, fill: Any, array: xr.DataArray) -> bool:
    """Whether numbers stay what they are when they are stored as that type, where `fill` stands for a missing one."""
    if not np.issubdtype(dtype, np.integer):
        return True
    limits = np.iinfo(np.dtype(dtype))
    for cut in cuts(array):
        numbers = array.isel(cut).values
        missing = np.isnan(numbers)
        there = numbers[~missing]
        if missing.any() if fill is None else (there == fill).any():
            return False
        if ((there != np.rint(there)) | (there < limits.min) | (there > limits.max)).any():
            return False
    return True


@contextmanager
def _written(path: str | os.PathLike[str], target: Path, folder: Path | None = None) -> Iterator[Path]:
    """Give a temporary name, held alone; what is written there in the block becomes `target`, or nothing does."""
    try:
        with NETCDF_LOCK, replacing(target, folder) as temporary:
            yield temporary
    except OutputError:  # what is written can't be read
        raise
    except (OSError, RuntimeError) as error:
        msg = f"{failure(f'writing {str(path)!r}', error)}. Nothing was replaced"
        raise WriteError(msg) from error


def write_cube(dataset: xr.Dataset, path: str | os.PathLike[str], overwrite: bool = False) -> Path:
    """Write a dataset as a netCDF-4 file that is either complete or not there."""
    target = check_output(path, overwrite)
    truths = [name for name, variable in dataset.variables.items() if variable.dtype.kind == "b"]
    if truths:
        dataset = dataset.assign({name: dataset[name].astype("i1") for name in truths})
    encoding = {name: _encoding(name, dataset[name], name in dataset.coords) for name in dataset.variables}
    dataset = _with_plain_attributes(dataset.assign(_beside(dataset)))
    with _written(path, target) as temporary:
        writing = dataset.to_netcdf(temporary, engine="netcdf4", format="NETCDF4", encoding=encoding, compute=False)
        writing.compute(scheduler="synchronous")  # other threads would wait for the lock
    return target


def write_in_slabs(
    cube: Frame,
    path: str | os.PathLike[str],
    blocks: Mapping[str, Sequence[int]],
    slabs: Iterable[tuple[tuple[slice, ...], Mapping[str, np.ndarray]]],
    *,
    overwrite: bool = False,
    folder: Path | None = None,
) -> Path:
    """Write a cube, some variables of which are made while it is written, as `write_cube` would."""
    import netCDF4

    target = check_output(path, overwrite)
    beside, beyond = _coordinates_of(cube)
    with _written(path, target, folder) as temporary, netCDF4.Dataset(temporary, "w") as file:
        file.setncatts(_plain(cube.attrs) | ({"coordinates": beyond} if beyond else {}))
        file.set_fill_off()
        # all are made before values are written: what is made later costs the library as much as many values
        known = [_declare_label(file, name, label) for name, label in cube.coords.items()]
        for name, variable in cube.data_vars.items():
            stored = _declare(file, name, variable, encoding_of(name, variable), chunksizes=blocks.get(name))
            if name in blocks:
                stored.set_var_chunk_cache(size=1)  # none: whole blocks are written (0 stands for the default)
            stored.setncatts(_plain(variable.attrs) | ({"coordinates": beside[name]} if beside[name] else {}))
            if name not in blocks:
                known.append((stored, variable.values))
        for stored, numbers in known:
            stored[...] = numbers
        stored_in = {name: file[name] for name in blocks}
        with _lasting(temporary) as begin:
            for number, (slab, values) in enumerate(slabs):
                if number:
                    begin()
                for name, stored in stored_in.items():
                    stored[slab] = values[name]
    return target


@contextmanager
def _lasting(path: Path) -> Iterator[Callable[[], None]]:
    """Give what has the disk take up, beside the block, what was written of a file so far."""
    handle = os.open(path, os.O_RDONLY)
    try:
        with ThreadPoolExecutor(max_workers=1, thread_name_prefix="disk") as beside:
            under_way: list[Future[None]] = []

            def begin() -> None:
                if under_way and not under_way[-1].done():
                    return
                for future in under_way:
                    future.result()  # a disk tells of a failure once
                under_way[:] = [beside.submit(os.fsync, handle)]

            yield begin
            for future in under_way:
                future.result()
    finally:
        os.close(handle)


def _coordinates_of(cube: Frame) -> tuple[dict[str, str], str]:
    """Return the attribute ``coordinates`` of each variable, as CF asks for it, and that of the whole file."""
    # as xarray writes and reads it: the file's names those that belong to no variable
    beside = {name: set(label.dims) for name, label in cube.coords.items() if name not in label.dims}
    found = {
        name: sorted(label for label, dims in beside.items() if dims <= set(variable.dims))
        for name, variable in cube.data_vars.items()
    }
    beyond = set(beside).difference(*found.values())
    return {name: " ".join(labels) for name, labels in found.items()}, " ".join(sorted(beyond))


def _declare_label(file: netCDF4.Dataset, name: str, label: Array) -> tuple[netCDF4.Variable, np.ndarray]:
    """Make a coordinate, text as characters; returns it and what is to be written."""
    values, dims, attributes = label.values, label.dims, _plain(label.attrs)
    if values.dtype.kind in "OSUT":
        texts = np.array([str(text).encode(ENCODING) for text in values.ravel()], bytes)
        values = texts.reshape(*values.shape, 1).view("S1")
        attributes = {**attributes, **({"_Encoding": ENCODING} if _says_encoding(name, dims) else {})}
        dims = (*dims, f"string{values.shape[-1]}")
    how = COMPRESSION if values.nbytes >= LEAST_COMPRESSED else {}
    stored = _declare(file, name, Array(dims, values, {}), {"_FillValue": None}, **how)
    stored.setncatts(attributes)
    return stored, values


def _declare(
    file: netCDF4.Dataset, name: str, array: Array, encoding: Mapping[str, Any], **how: Any
) -> netCDF4.Variable:
    """Make a variable in an open file."""
    for dim, size in zip(array.dims, array.values.shape, strict=True):
        if dim not in file.dimensions:
            file.createDimension(dim, size)
    fill = encoding["_FillValue"]
    # checksums: damage is found when it is read; they cost next to nothing
    how = {"fletcher32": bool(array.dims), "fill_value": False if fill is None else fill, **how}
    stored = file.createVariable(name, encoding.get("dtype", array.dtype), array.dims, **how)
    stored.set_auto_maskandscale(False)
    stored.set_auto_chartostring(False)
    return stored


@contextmanager
def _chunk_cache(size: int) -> Iterator[None]:
    """Let variables of files that are opened in the block keep at most so many bytes in memory."""
    import netCDF4

    before = netCDF4.get_chunk_cache()
    netCDF4.set_chunk_cache(size)
    try:
        yield
    finally:
        netCDF4.set_chunk_cache(*before)


def _open_checked(path: str | os.PathLike[str], target: Path) -> xr.Dataset:
    """Open a file whose header is in order, else raise `OutputError`; one handle, as two on a file may crash."""
    import xarray as xr

    def refuse(fault: str | None) -> None:
        if fault is not None:
            msg = f"cube {str(path)!r} is damaged, or not made by this package ({fault}); run the sweep again"
            raise OutputError(msg)

    refuse(wrongly_stored(target))
    store = xr.backends.NetCDF4DataStore.open(target, lock=_ReadLock())
    try:
        refuse(next(_header_faults(store.ds, target.stat().st_size), None))
        return _with_texts(xr.open_dataset(store, decode_times=False, create_default_indexes=False))
    except BaseException:
        store.close()
        raise


def with_texts(cube: xr.Dataset) -> xr.Dataset:
    """Return a cube that xarray opened with its texts as `open_cube` reads them, and not as bytes and objects."""
    odd = {name: values for name, values in cube.variables.items() if values.dtype.kind in "OS"}
    for name, values in odd.items():
        cube = cube.assign({name: (values.dims, _text(values.values), values.attrs)})
    return cube


def _text(values: np.ndarray) -> np.ndarray:
    return values.astype(str) if values.dtype.kind == "O" else np.char.decode(values, ENCODING)


def _with_texts(dataset: xr.Dataset) -> xr.Dataset:
    """Make texts of characters what they were when they were written, for which they are read, and index the axes."""
    import xarray as xr

    for values in dataset.variables.values():
        if values.dtype.kind in "OS":
            values.data = _text(values.values)
            values.encoding = {**TEXT, **COMPRESSION}  # for who writes it anew with xarray
    inner, coordinates = (
        {name: dataset.variables[name] for name in names} for names in (dataset.data_vars, dataset.coords)
    )
    found = xr.Dataset(inner, coordinates, dataset.attrs)
    found.encoding = dataset.encoding
    found.set_close(dataset.close)
    return found


def open_cube(path: str | os.PathLike[str]) -> xr.Dataset:
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
    The header is checked before values are read (`pounding_sweep.output.netcdf`), and every array carries
    checksums: where the values of a damaged file are read later, the library raises RuntimeError.
    """
    target, mode = _target(path)
    if mode is None and os.path.isfile(f"{target}{_UNFINISHED}"):
        msg = (
            f"cube {str(path)!r} is not finished: its chunks wait in {f'{target}.parts'!r}; the same 'run' command "
            f"completes it, 'pounding-sweep info {path}' tells what is missing"
        )
        raise OutputError(msg)
    if mode is None or not stat.S_ISREG(mode):
        what = "does not exist" if mode is None else "is not a file"
        msg = f"cube {str(path)!r} {what}; give the path of a file made by 'pounding-sweep run'"
        raise OutputError(msg)
    try:
        with NETCDF_LOCK, _chunk_cache(READ_CACHE):
            dataset = _open_checked(path, target)
    except OutputError:
        raise
    except Exception as error:  # the libraries raise anything at a damaged file
        reason = getattr(error, "strerror", None) or error
        msg = (
            f"cube {str(path)!r} can't be read as netCDF ({reason}); it is damaged or another kind of file. "
            "Run the sweep again or give a file made by 'pounding-sweep run'"
        )
        raise OutputError(msg) from None
    if VERSION_ATTRIBUTE not in dataset.attrs:
        dataset.close()
        msg = (
            f"{str(path)!r} is a netCDF file, but not one of this package (no attribute {VERSION_ATTRIBUTE!r}); "
            "give a file made by 'pounding-sweep run'"
        )
        raise OutputError(msg)
    return dataset
