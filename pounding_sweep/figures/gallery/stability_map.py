"""Error of the peak force over contact stiffness and time step, with the statuses that warn of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.figures import figure_of
from pounding_sweep.figures.style import axis_label, cell_edges, label_edges, put_title, subplots
from pounding_sweep.outputs.variables import Status

#: Mark of a status, and what it is called in the legend.
_MARKS: dict[Status, tuple[dict[str, Any], str]] = {
    Status.BEYOND_STABILITY_LIMIT: ({"marker": "x", "color": "0.35"}, "refused: beyond the stability limit"),
    Status.UNDER_RESOLVED_CONTACT: ({"marker": ".", "color": "black"}, "under-resolved contact"),
    Status.UNDER_RESOLVED_MOTION: ({"marker": "_", "color": "black"}, "under-resolved motion"),
    Status.NEWTON_NOT_CONVERGED: ({"marker": "^", "color": "black"}, "implicit contact not solved"),
    Status.DIVERGED: ({"marker": "D", "color": "#D55E00"}, "diverged"),
}


@figure_of(
    "map",
    "error and status over contact stiffness and time step, from 'extremes --map'",
    needs=("peak_force_error", "status", "scheme", "stiffness", "dt"),
)
def stability_map(cube: xr.Dataset) -> Figure:
    """Draw a map of `pounding_sweep.accuracy.stability_map`: one panel per scheme and number format."""
    from matplotlib.colors import LogNorm

    schemes = cube.scheme.values.tolist()
    columns = min(2, len(schemes))
    rows = -(-len(schemes) // columns)
    figure, axes = subplots(rows, columns, (1.2 + 3.4 * columns, 1.2 + 2.8 * rows))
    edges = [cell_edges(cube[name].values) for name in ("dt", "stiffness")]
    shown: dict[Status, Any] = {}
    mesh = None
    for number, scheme in enumerate(schemes):
        ax = axes[number // columns, number % columns]
        part = cube.sel(scheme=scheme).transpose("stiffness", "dt", ...)
        error = np.clip(part.peak_force_error.values, 1e-8, 1.0)
        mesh = ax.pcolormesh(*edges, error, norm=LogNorm(1e-8, 1.0), cmap="viridis_r")
        for status, (look, label) in _MARKS.items():
            i, j = np.nonzero(part.status.values == int(status))
            if len(i):
                dots = ax.scatter(
                    cube.dt.values[j], cube.stiffness.values[i], s=14, linewidths=0.8, label=label, **look
                )
                shown.setdefault(status, dots)
        ax.set(xscale="log", yscale="log", title=scheme)
        ax.grid(visible=False)
    for ax in axes.ravel()[len(schemes) :]:
        ax.set_visible(False)
    label_edges(axes, "time step (s)", [axis_label("contact stiffness", cube.stiffness.attrs)] * rows)
    if mesh is not None:
        figure.colorbar(mesh, ax=axes, label="relative error of the peak contact force")
    if shown:
        figure.legend(handles=list(shown.values()), loc="outside lower center", ncols=2)
    if "title" in cube.attrs:
        put_title(figure, str(cube.attrs["title"]))
    return figure
