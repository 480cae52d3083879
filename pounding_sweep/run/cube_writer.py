"""Results of unique scenarios broadcast to all that were asked for, a slab at a time, in memory or into a file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.output.dataset import CubeParts, as_read, label, unfilled
from pounding_sweep.output.labels import global_attributes, scenario_axes
from pounding_sweep.output.netcdf import BLOCK_BYTES, SLAB_BYTES, block_shape, slab_shape, slabs
from pounding_sweep.output.results import table_type
from pounding_sweep.outputs.variables import inner_shape, mask_invalid
from pounding_sweep.run.audit import Audit, add_to_cube

if TYPE_CHECKING:
    from pounding_sweep.output.results import Outcome
    from pounding_sweep.plan.plan import Plan
    from pounding_sweep.run.execute import Progress


def cube_in_memory(
    plan: Plan, outcome: Outcome, found: Audit | None, progress: Progress, more: Mapping[str, Any]
) -> CubeParts:
    """Return the cube of a sweep and its audit, if there is one; `more` are further global attributes."""
    cube, sizes = _labelled(plan, outcome, more)
    for name in outcome.results.names:
        if name in cube.data_vars:
            dims, values, attributes = cube.data_vars[name]
            cube.data_vars[name] = (dims, np.empty(values.shape, values.dtype), attributes)
    for slab, arrays in _slabs(plan, outcome, sizes, (1,) * len(sizes), progress):
        for name, (_, values, _) in cube.data_vars.items():
            values[slab] = as_read(name, arrays[name])
    return add_to_cube(cube, plan, found)


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

    cube, sizes = _labelled(plan, outcome, more)
    inner = {name: inner_shape(name, plan.spec.scene) for name in cube.data_vars}
    largest = max(table_type([name], plan.spec.scene).itemsize for name in inner)
    block = block_shape(sizes, BLOCK_BYTES // largest)
    slabs = _slabs(plan, outcome, sizes, block, progress)
    blocks = {name: (*block, *shape) for name, shape in inner.items()}
    write_in_slabs(add_to_cube(cube, plan, found), path, blocks, slabs, overwrite=overwrite, folder=folder)
    return cube


def _labelled(plan: Plan, outcome: Outcome, more: Mapping[str, Any]) -> tuple[CubeParts, tuple[int, ...]]:
    """Return the cube of a sweep without its values, and the sizes of its axes."""
    axes, extra = scenario_axes(plan)
    sizes, scene = tuple(len(values) for _, values, _ in axes.values()), plan.spec.scene
    data = {name: unfilled(name, (*sizes, *inner_shape(name, scene))) for name in outcome.results.names}
    return label(scene, axes, data, {**global_attributes(plan, outcome), **more}, extra), sizes


def _slabs(
    plan: Plan, outcome: Outcome, sizes: tuple[int, ...], block: tuple[int, ...], progress: Progress
) -> Iterator[tuple[tuple[slice, ...], dict[str, np.ndarray]]]:
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
