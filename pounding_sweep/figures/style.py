"""One style for all figures: readable in print and for colour-blind readers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from textwrap import fill
from typing import TYPE_CHECKING, Any

from pounding_sweep.base.errors import InputError

if TYPE_CHECKING:
    import numpy as np

#: Colours of Okabe & Ito (2008), told apart by colour-blind readers, with black first.
COLOURS = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C510A")
#: Drawn beside the colours, so that lines are told apart without them.
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
LINES = ("-", "--", "-.", ":")
#: Characters of a title in an inch.
_CHARACTERS = 14

_SETTINGS: dict[str, Any] = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.grid": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "lines.linewidth": 1.4,
    "lines.markersize": 4,
    "legend.frameon": False,
}


@contextmanager
def in_style() -> Iterator[None]:
    """Draw in the package's style, whatever the reader's matplotlib settings are."""
    import matplotlib as mpl

    settings: Any = dict(mpl.rcParamsDefault)
    settings.update(_SETTINGS)
    with mpl.rc_context(settings):
        yield


def subplots(rows: int, columns: int, size: tuple[float, float], ax: Any = None) -> tuple[Any, Any]:
    """Return a figure and its axes, always a 2-D array; `size` in inches."""
    # with `ax`, the one panel is drawn into these axes, which stand for the figure too: titles and legends go there
    import numpy as np
    from matplotlib.figure import Figure

    if ax is not None:
        if rows * columns != 1:
            msg = (
                f"the figure has {rows} x {columns} panels, and axes for one are given; choose one value of what they "
            )
            msg += "are for (pair, building, law or response), or leave ax out"
            raise InputError(msg)
        return ax, np.array([[ax]], dtype=object)
    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, sharex=True, sharey="row")


def start_at_zero(ax: Any) -> None:
    """Have the y of a panel, and of those that share it, begin at 0 and end above all that is drawn."""
    ax.set_ylim(0.0, 1.03 * ax.get_ylim()[1])


def label_edges(axes: Any, x: str, rows: Sequence[str]) -> None:
    """Write the axis labels of a grid at its edges: that of x below, one of y for each row."""
    for ax in axes[-1]:
        ax.set_xlabel(x)
    for ax, label in zip(axes[:, 0], rows, strict=True):
        ax.set_ylabel(label)


def unit_text(attributes: Mapping[str, Any]) -> str:
    """Write the unit of a variable as engineers do; "" where it has none."""
    units = str(attributes.get("units", attributes.get("unit_text", "1")))
    above: list[str] = []
    below: list[str] = []
    for name, sign, power in re.findall(r"([A-Za-z%]+)(-?)([\d.]*)", units):
        raised = {"": "", "1": "", "2": "²", "3": "³"}.get(power, f"^{power}")
        (below if sign else above).append(name + raised)
    under = f"/({' '.join(below)})" if len(below) > 1 else f"/{below[0]}" if below else ""
    return (" ".join(above) or "1" * bool(below)) + under


def axis_label(name: str, attributes: Mapping[str, Any]) -> str:
    """Return the label of an axis: its name and its unit, "-" where it has none."""
    return f"{name} ({unit_text(attributes) or '-'})"


def legend_below(figure: Any, ax: Any, most: int = 3) -> None:
    """Put a legend of the lines of one panel below all, in so many columns at most as the figure is wide enough for."""
    handles, labels = ax.get_legend_handles_labels()
    if figure is ax and labels:
        ax.legend(handles, labels)
    elif labels:
        each = 0.6 + 0.07 * max(map(len, labels))  # width of an entry (inches): line, name, space
        columns = max(1, min(most, len(labels), int(figure.get_figwidth() / each)))
        figure.legend(handles, labels, loc="outside lower center", ncols=columns)


def cell_edges(values: np.ndarray, *, even: bool = False) -> np.ndarray:
    """Return the edges of cells around values: halfway between their logarithms, or `even`, between themselves."""
    import numpy as np

    if not even:
        return np.asarray(np.exp(cell_edges(np.log(values), even=True)))
    half = 0.5 * np.diff(values) if len(values) > 1 else np.array([np.log(2.0)])
    return np.concatenate([[values[0] - half[0]], values[:-1] + half[: len(values) - 1], [values[-1] + half[-1]]])


def joined(*parts: str) -> str:
    """Join those parts of a title that are there."""
    return "; ".join(filter(None, parts))


def put_title(figure: Any, *parts: str) -> None:
    """Write above a figure, or above axes given for it, what it shows; lines end between parts."""
    text = joined(*parts)
    if hasattr(figure, "suptitle"):
        figure.suptitle(wrapped(text, int(_CHARACTERS * figure.get_figwidth())), fontsize=9)
    else:
        figure.set_title("\n".join(filter(None, (figure.get_title(), text))), fontsize=9)


def wrapped(text: str, width: int) -> str:
    """Break a title into lines of so many characters, between its parts only."""
    whole = text.replace(" ", "\xa0").replace(";\xa0", "; ")
    return fill(whole, width, break_long_words=False, break_on_hyphens=False).replace("\xa0", " ")


def history_look(number: int) -> dict[str, Any]:
    """Return colour and line style of a history: it has too many points for markers."""
    return {"color": COLOURS[number % len(COLOURS)], "linestyle": LINES[number % len(LINES)], "linewidth": 1.0}


def legend_beside(ax: Any) -> None:
    """Put the legend of a panel beside it, where it hides nothing."""
    if ax.get_legend_handles_labels()[1]:
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)


def look(number: int) -> dict[str, Any]:
    """Return colour, marker and line style of the `number`-th line."""
    return {
        "color": COLOURS[number % len(COLOURS)],
        "marker": MARKERS[number % len(MARKERS)],
        "linestyle": LINES[(number // len(COLOURS)) % len(LINES)],
    }
