"""How the values of an HDF5 file are stored: in the file itself, all of them, each where it belongs.

Links, virtual datasets and external storage may name any path on the machine, and the
netCDF library follows them silently: a cube of a stranger could show what stands there.
Blocks of values carry checksums, but the tree by which they are found carries none: where
it is damaged the library gives missing values for a block, or does not look at its checksum.
"""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import h5py

#: Bytes of the checksum behind a block.
_CHECKSUM = 4


def wrongly_stored(path: Path) -> str | None:
    """Say what in a file is not stored as this package does it; None if nothing, or if it is no HDF5 file.

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
    taken: set[int] = set()
    with h5py.File(path, "r") as file:
        for name in file:
            if not isinstance(file.get(name, getlink=True), h5py.HardLink):
                return f"{name!r} is a link to something else"
            found = file[name]
            if isinstance(found, h5py.Group):  # the netCDF library would look into it before it can be refused
                return "it has groups, or types of its own"
            if isinstance(found, h5py.Dataset):
                if found.external or found.is_virtual:
                    return f"the values of {name!r} stand in other files"
                if found.chunks and not _blocks_are_whole(found, taken):
                    return f"blocks of the values of {name!r} are missing, or without checksums"
    return None


def _blocks_are_whole(values: h5py.Dataset, taken: set[int]) -> bool:
    """Whether each block is there once, is found where it belongs, and is read with its checksum, if there are any.

    `taken` are the places of other variables' blocks, to which these are added: no two share one.
    """
    import h5py

    pipeline = values.id.get_create_plist()
    filters = [pipeline.get_filter(i)[0] for i in range(pipeline.get_nfilters())]
    checked = sum(1 << i for i, each in enumerate(filters) if each == h5py.h5z.FILTER_FLETCHER32)
    blocks: list[Any] = []
    if values.size:
        values.id.chunk_iter(blocks.append)
    starts = [range(0, size, block) for size, block in zip(values.shape, values.chunks, strict=True)]
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


def _is_found(values: h5py.Dataset, corner: tuple[int, ...]) -> bool:
    """Whether the library finds a block when it reads: it looks it up, and then sees that there is no room for it."""
    try:
        values.id.read_direct_chunk(corner, out=bytearray())
    except ValueError:
        return True
    except RuntimeError:
        pass
    return False
