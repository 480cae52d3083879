"""The grid that the paper's figures share: one row per reading of its data, one column per record."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from pounding_sweep.contact.laws import LAWS, MATE2015_MODELS
from pounding_sweep.figures.style import COLOURS
from pounding_sweep.paper.published import record_title
from pounding_sweep.paper.readings import READINGS

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

_DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (5, 1.5, 1, 1.5)), (0, (1, 1)), (0, (3, 1)), (0, (8, 2)))


def model_label(law: str) -> str:
    """Name of a model in legends: its number in the paper and its law."""
    return f"{LAWS[law].model}: {LAWS[law].title}"


def model_look(law: str) -> dict[str, Any]:
    """Colour, dashes and width of a model's line: no pounding thick and grey, behind the others."""
    if law == "none":
        return {"color": "0.6", "linestyle": "-", "linewidth": 2.6, "zorder": 1.5}
    number = MATE2015_MODELS.index(law)
    return {"color": COLOURS[number], "linestyle": _DASHES[number], "linewidth": 1.2}


def record_grid(data: xr.Dataset, share_y: bool = True) -> tuple[Figure, Iterator[tuple[Any, dict[str, str]]]]:
    """Return a figure with a panel for each reading and record, and the panels with their places.

    Parameters
    ----------
    data : xarray.Dataset
        On ``reading`` and ``record``.
    share_y : bool
        Whether the panels of a row share y.

    Returns
    -------
    figure : matplotlib.figure.Figure
        Columns share x.
    panels : iterator of (axes, dict)
        Axes, and the labels that select the panel's data.
    """
    from matplotlib.figure import Figure

    readings, records = data["reading"].values.tolist(), data["record"].values.tolist()
    size = (max(5.0, 1.0 + 2.5 * len(records)), 1.3 + 2.5 * len(readings))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(len(readings), len(records), squeeze=False, sharex="col", sharey="row" if share_y else False)
    for column, record in enumerate(records):
        axes[0, column].set_title(record_title(record))
    panels = [
        (axes[i, j], {"reading": reading, "record": record})
        for i, reading in enumerate(readings)
        for j, record in enumerate(records)
    ]
    return figure, iter(panels)


def label_grid(figure: Figure, readings: list[str], x: str, y: str) -> None:
    """Write axis labels at the edges of a grid, the reading with that of y, and one legend below."""
    axes = figure.axes
    columns = len(axes) // len(readings)
    for row, reading in enumerate(readings):
        axes[row * columns].set_ylabel(f"{READINGS[reading].label}\n{y}")
    for ax in axes[-columns:]:
        ax.set_xlabel(x)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4 if columns > 2 else 2)
