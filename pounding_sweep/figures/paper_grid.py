"""The grid that the paper's figures share: one row per reading of its data, one column per record."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import TYPE_CHECKING, Any

from pounding_sweep.figures.style import COLOURS, label_edges
from pounding_sweep.model.laws import LAWS, MATE2015_MODELS
from pounding_sweep.paper.published import record_title
from pounding_sweep.paper.readings import READINGS

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

#: (axes, data of one model at one reading and record, look)
Line = Callable[[Any, "xr.Dataset", dict[str, Any]], None]

_DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (5, 1.5, 1, 1.5)), (0, (1, 1)), (0, (3, 1)), (0, (8, 2)))


def model_label(law: str) -> str:
    """Name of a model in legends: its number in the paper and its law."""
    return f"{LAWS[law].model}: {LAWS[law].title}"


def model_look(law: str) -> dict[str, Any]:
    """Label, colour, dashes and width of a model's line: no pounding thick and grey, behind the others."""
    label = model_label(law)
    if law == "none":
        return {"label": label, "color": "0.6", "linestyle": "-", "linewidth": 2.6, "zorder": 1.5}
    number = MATE2015_MODELS.index(law)
    return {"label": label, "color": COLOURS[number], "linestyle": _DASHES[number], "linewidth": 1.2}


def model_grid(data: xr.Dataset, line: Line, x: str, y: str, share_y: bool = True) -> Figure:
    """Draw a panel for each reading and record, and in it a line for each model.

    Parameters
    ----------
    data : xarray.Dataset
        On ``reading``, ``record`` and ``law``.
    line : callable
        Draws the line of one model into one panel: given its axes, the data and the look of the line.
    x, y : str
        Labels of the axes.
    share_y : bool
        Whether the panels of a row share y.

    Returns
    -------
    matplotlib.figure.Figure
        Columns share x.
    """
    from matplotlib.figure import Figure

    readings, records = data["reading"].values.tolist(), data["record"].values.tolist()
    size = (max(5.0, 1.0 + 2.5 * len(records)), 1.3 + 2.5 * len(readings))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(len(readings), len(records), squeeze=False, sharex="col", sharey="row" if share_y else False)
    for column, record in enumerate(records):
        axes[0, column].set_title(record_title(record))
    for (i, reading), (j, record), law in product(enumerate(readings), enumerate(records), data["law"].values.tolist()):
        line(axes[i, j], data.sel(reading=reading, record=record, law=law), model_look(law))
    label_edges(axes, x, [f"{READINGS[reading].label}\n{y}" for reading in readings])
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4 if len(records) > 2 else 2)
    return figure
