"""Results of unique scenarios broadcast to all that were asked for, a slab at a time, in memory or into a file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.output.dataset import CubeParts, as_read, frame, label
from pounding_sweep.output.labels import global_attributes, scenario_axes
from pounding_sweep.output.netcdf import BLOCK_BYTES, SLAB_BYTES, block_shape, slab_shape, slabs
from pounding_sweep.output.results import table_type
from pounding_sweep.outputs.variables import inner_shape, mask_invalid
from pounding_sweep.run.audit import Audit, add_to_cube

if TYPE_CHECKING:
    from pounding_sweep.output.results import Outcome
    from pounding_sweep.plan.plan import Plan
    from pounding_sweep.run.execute import Progress


#: Part of a cube, and its values as they are stored.
Slab = tuple[tuple[slice, ...], Mapping[str, np.ndarray]]


def cube_in_memory(
    plan: Plan, outcome: Outcome, found: Audit | None, progress: Progress, more: Mapping[str, Any]
) -> CubeParts:
    """Return the cube of a sweep and its audit, if there is one; `more` are further global attributes."""
    axes, extra = scenario_axes(plan)
    sizes = tuple(axis.size for axis in axes)
    stored = table_type(outcome.results.names, plan.spec.scene)
    data = {}
    for name in outcome.results.names:
        kind = as_read(name, np.zeros(0, stored[name].base)).dtype
        data[name] = np.empty((*sizes, *stored[name].shape), kind)
    for slab, values in _slabs(plan, outcome, sizes, (1,) * len(sizes), progress):
        for name, array in data.items():
            array[slab] = as_read(name, values[name])
    attributes = {**global_attributes(plan, outcome), **more}
    return add_to_cube(label(plan.spec.scene, axes, data, attributes, extra), plan, found)


def write_cube_of(
    plan: Plan,
    outcome: Outcome,
    found: Audit | None,
    path: Path,
    progress: Progress,
    more: Mapping[str, Any],
    *,
    overwrite: bool,
    folder: Path,
) -> CubeParts:
    """Write the cube of a sweep and its audit, if there is one; no more than a slab of it is ever in memory."""
    from pounding_sweep.output.netcdf import write_in_slabs

    scene, names = plan.spec.scene, outcome.results.names
    axes, extra = scenario_axes(plan)
    cube = frame(scene, axes, names, {**global_attributes(plan, outcome), **more}, extra)
    sizes = tuple(axis.size for axis in axes)
    kept = [name for name in names if name in cube.data_vars]
    largest = max(table_type([name], scene).itemsize for name in kept)
    block = block_shape(sizes, BLOCK_BYTES // largest)
    blocks = {name: (*block, *inner_shape(name, scene)) for name in kept}
    whole = (
        (slab, {name: np.ascontiguousarray(each) for name, each in values.items()})
        for slab, values in _slabs(plan, outcome, sizes, block, progress)
    )
    write_in_slabs(add_to_cube(cube, plan, found), path, blocks, whole, overwrite=overwrite, folder=folder)
    return cube


def _slabs(
    plan: Plan, outcome: Outcome, sizes: tuple[int, ...], block: tuple[int, ...], progress: Progress
) -> Iterator[Slab]:
    """Values of the cube as they are stored, in slabs of whole blocks; scenarios without values have none.

    They count as done once they were used.
    """
    row_of = plan.inverse.reshape(sizes)
    each = table_type(outcome.results.names, plan.spec.scene).itemsize
    for slab in slabs(sizes, slab_shape(sizes, block, SLAB_BYTES // (2 * each))):
        rows = row_of[slab]
        found = mask_invalid(outcome.results.gather(rows.ravel()))
        yield slab, {name: values.reshape(*rows.shape, *values.shape[1:]) for name, values in found.items()}
        progress.advance(rows.size)
