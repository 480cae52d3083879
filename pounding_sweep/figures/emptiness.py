"""Whether a drawn figure shows any value, and why it does not."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.figures.chosen import middle
from pounding_sweep.outputs.variables import STATUS, Status

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


def shows_values(figure: Figure) -> bool:
    """Whether any line, bar, mark or map of a figure has a finite value; lines across a whole panel are none."""
    return any(_finite(artist, ax) for ax in figure.axes for artist in ax.get_children())


def _finite(artist: Any, ax: Any) -> bool:
    """Whether an artist of a panel stands for a finite value of the data."""
    from matplotlib.collections import Collection, PathCollection
    from matplotlib.lines import Line2D
    from matplotlib.patches import Rectangle

    rows: Any = []
    if isinstance(artist, Line2D) and artist.get_transform() is ax.transData:
        rows = np.column_stack(artist.get_data())
    elif isinstance(artist, Rectangle) and artist is not ax.patch:
        rows = [[artist.get_width(), artist.get_height()]]
    elif isinstance(artist, PathCollection):  # marks
        rows = artist.get_offsets()
    elif isinstance(artist, Collection) and (cells := artist.get_array()) is not None:  # of a map
        rows = np.reshape(cells, (-1, 1))
    elif isinstance(artist, Collection):
        rows = np.concatenate([path.vertices for path in artist.get_paths()] or [np.empty((0, 2))])
    points: np.ndarray = np.ma.filled(np.ma.asarray(rows, dtype=float), np.nan)
    return bool(points.size) and bool(np.isfinite(points).all(axis=1).any())


def nothing_to_draw(dataset: xr.Dataset, key: str) -> str:
    """Say that a figure has nothing to draw of a dataset, why, and what to do."""
    shown = middle(dataset, [str(dim) for dim in dataset.sizes])[1]
    return f"figure {key!r} has nothing to draw{f' at {shown}' if shown else ''}: {_why(dataset)}"


def _why(dataset: xr.Dataset) -> str:
    status = dataset["status"].values if "status" in dataset.data_vars else np.array(int(Status.OK))
    counts = [(one.label, int((status == int(one)).sum())) for one in STATUS if one != Status.OK]
    failed = [f"{count} of {status.size} scenarios are {label}" for label, count in counts if count]
    return f"{', '.join(failed) or 'none of its values is a number'}; choose others with --at"
