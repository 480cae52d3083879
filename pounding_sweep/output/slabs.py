"""Large cubes a part at a time: blocks in which files store them, slabs in which they are made and read."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pounding_sweep.outputs.variables import INNER_DIMS

if TYPE_CHECKING:
    import xarray as xr

#: Wanted size (bytes) of one stored block of the largest variable.
BLOCK_BYTES = 2**20
#: Wanted size (bytes) of what is held of a cube at a time.
SLAB_BYTES = 2**25


def block_shape(sizes: Sequence[int], most: int) -> tuple[int, ...]:
    """Return the largest block of at most `most` elements that lie side by side."""
    shape = [1] * len(sizes)
    for axis in reversed(range(len(sizes))):
        room = max(1, most // math.prod(shape))
        if room < sizes[axis]:
            shape[axis] = math.ceil(sizes[axis] / math.ceil(sizes[axis] / room))
            break
        shape[axis] = max(1, sizes[axis])
    return tuple(shape)


def slab_shape(sizes: Sequence[int], block: Sequence[int], most: int) -> tuple[int, ...]:
    """Return the shape of a slab of about `most` elements that is made of whole blocks, at least one."""
    shape = list(block)
    for axis in reversed(range(len(sizes))):
        blocks = max(1, most // math.prod(shape))  # that fit along this dimension
        shape[axis] = min(sizes[axis], blocks * block[axis])
        if shape[axis] < sizes[axis]:
            break
    return tuple(shape)


def slabs(sizes: Sequence[int], shape: Sequence[int]) -> Iterator[tuple[slice, ...]]:
    """Go through all slabs of that shape, the last ones of a dimension cut off where it ends."""
    along = [
        [slice(first, min(first + step, size)) for first in range(0, size, step)]
        for size, step in zip(sizes, shape, strict=True)
    ]
    yield from itertools.product(*along)


def cuts(variable: xr.DataArray | xr.Variable) -> Iterator[dict[str, slice]]:
    """Go through a variable in parts that fit into memory."""
    if variable.nbytes <= SLAB_BYTES:
        yield {}
        return
    dims = [str(dim) for dim in variable.dims if dim not in INNER_DIMS]
    sizes = [variable.sizes[dim] for dim in dims]
    each = variable.nbytes // math.prod(sizes)
    for slab in slabs(sizes, block_shape(sizes, SLAB_BYTES // each)):
        yield dict(zip(dims, slab, strict=True))


def status_counts(status: xr.DataArray) -> dict[int, int]:
    """Count the scenarios of each status that occurs, by rising code."""
    found: Counter[int] = Counter()
    for cut in cuts(status):
        codes, counts = np.unique(status.isel(cut).values, return_counts=True)
        found.update(dict(zip(codes.tolist(), counts.tolist(), strict=True)))
    return dict(sorted(found.items()))
