"""Whether an HDF5 file takes what is in it from other files.

Links, virtual datasets and external storage may name any path on the machine, and the
netCDF library follows them silently: a cube of a stranger could show what stands there.
"""

from __future__ import annotations

from pathlib import Path


def refers_elsewhere(path: Path) -> str | None:
    """Say what in a file leads out of it; None if nothing does, or if it is no HDF5 file.

    Parameters
    ----------
    path : Path
        Any file; nothing that it refers to is opened.

    Raises
    ------
    Exception
        Whatever the library raises at a file that it can't read.
    """
    import h5py

    if not h5py.is_hdf5(path):
        return None
    with h5py.File(path, "r") as file:
        for name in file:
            if not isinstance(file.get(name, getlink=True), h5py.HardLink):
                return f"{name!r} is a link to something else"
            found = file[name]
            if isinstance(found, h5py.Group):  # the netCDF library would look into it before it can be refused
                return "it has groups, or types of its own"
            if isinstance(found, h5py.Dataset) and (found.external or found.is_virtual):
                return f"the values of {name!r} stand in other files"
    return None
