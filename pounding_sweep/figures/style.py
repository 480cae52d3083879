"""One style for all figures: readable in print and for colour-blind readers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Colours of Okabe & Ito (2008), told apart by colour-blind readers, with black first.
COLOURS = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C510A")
#: Drawn beside the colours, so that lines are told apart without them.
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
LINES = ("-", "--", "-.", ":")

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


def styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """Make a function draw in the package's style."""

    @wraps(draw)
    def drawn(*args: Any, **kwargs: Any) -> Figure:
        with in_style():
            return draw(*args, **kwargs)

    return drawn


def subplots(rows: int, columns: int, size: tuple[float, float]) -> tuple[Figure, Any]:
    """Return a figure and its axes, always a 2-D array; `size` in inches."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, sharex=True, sharey="row")


def look(number: int) -> dict[str, Any]:
    """Return colour, marker and line style of the `number`-th line."""
    return {
        "color": COLOURS[number % len(COLOURS)],
        "marker": MARKERS[number % len(MARKERS)],
        "linestyle": LINES[(number // len(COLOURS)) % len(LINES)],
    }
