"""Results of unique scenarios broadcast to all that were asked for, a slab at a time, in memory or into a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pounding_sweep.output.dataset import CubeParts, as_read, label, unfilled
from pounding_sweep.output.labels import global_attributes, scenario_axes
from pounding_sweep.output.netcdf import Slab
from pounding_sweep.output.results import number_runs
from pounding_sweep.resume import parts_folder
from pounding_sweep.run.audit import Audit, add_to_cube
from pounding_sweep.variables.registry import NEVER_TOUCHES, NOT_RUN, Status, inner_shape, mask_invalid

if TYPE_CHECKING:
    from pounding_sweep.output.results import Outcome
    from pounding_sweep.plan.plan import Plan
    from pounding_sweep.run.execute import Progress


def write_cube_of(
    plan: Plan,
    outcome: Outcome,
    audit: Audit | None,
    progress: Progress,
    path: Path | None = None,
    *,
    overwrite: bool = False,
) -> CubeParts:
    """Return the cube of a sweep and its audit, if there is one.

    With a `path` it is written there, no more than a slab of it is ever in memory, and what is returned has no values.
    """
    from pounding_sweep.output.netcdf import write_in_slabs

    axes, extra = scenario_axes(plan)
    scene, about = plan.spec.scene, global_attributes(plan, outcome)
    row_of = plan.inverse.reshape([len(values) for _, values, _ in axes.values()])
    without = np.isin(outcome.results.status, [Status.NOT_RUN, Status.BEYOND_STABILITY_LIMIT])
    origin = np.select([without, outcome.left_out & ~plan.no_contact], [NOT_RUN, NEVER_TOUCHES], 0)
    # a unique scenario runs itself, or is answered by its run without pounding
    run = np.where(outcome.left_out, -1 - plan.uncoupled_of, np.arange(len(plan.unique)))
    numbered = number_runs(origin.astype(np.int8)[plan.inverse], run.astype(np.int32)[plan.inverse])
    of_cube = dict(zip(("origin", "run"), numbered, strict=True))
    names = (*outcome.results.names, *of_cube)
    data = {name: unfilled(name, (*row_of.shape, *inner_shape(name, scene))) for name in names}
    cube = label(scene, axes, data, about, extra)

    def values_of(slab: Slab) -> dict[str, np.ndarray]:
        """Return values as they are stored; the scenarios count as done."""
        rows = row_of[slab]
        gathered = mask_invalid(outcome.results.gather(rows.ravel()))
        gathered |= {name: values.reshape(row_of.shape)[slab] for name, values in of_cube.items()}
        progress.advance(rows.size)
        return {name: values.reshape(*rows.shape, *inner_shape(name, scene)) for name, values in gathered.items()}

    if path is None:
        values = values_of((slice(None),) * row_of.ndim)
        for name, (dims, _, attributes) in cube.data_vars.items():
            cube.data_vars[name] = (dims, as_read(name, values[name]), attributes)
    if audit is not None:
        add_to_cube(cube, plan, audit)
    if path is not None:
        write_in_slabs(cube, path, values_of, overwrite=overwrite, folder=parts_folder(path))
    return cube
