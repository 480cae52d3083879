"""Error against time of every tool, on logarithmic axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from benchmarks.compare import Point
from pounding_sweep.figures.style import MARKED, in_style, subplots

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: What the engine's rows begin with; they are drawn in filled markers, the peers in hollow ones.
ENGINE = "engine"


@in_style()
def speed(points: Sequence[Point], caption: str) -> Figure:
    """Draw the worst error of the peak impact forces against milliseconds per scenario, one line per tool."""
    ax = subplots(1, 1, (6.4, 0.0, 5.2, 0.0))[0, 0]
    titles = list(dict.fromkeys(p.title for p in points))
    for title, look in zip(titles, MARKED, strict=False):
        own = [p for p in points if p.title == title and p.error > 0.0]
        mine = title.startswith(ENGINE)
        style = look | {
            "linestyle": "-" if mine else "--",
            "markerfacecolor": look["color"] if mine else "white",
            "label": title,
        }
        ax.plot([p.milliseconds for p in own], [p.error for p in own], **style)
    ax.set(
        xscale="log",
        yscale="log",
        xlabel="processor time of one scenario (ms)",
        ylabel="worst relative error of a peak impact force",
    )
    ax.set_title(caption)
    figure = ax.figure
    figure.legend(loc="outside lower center", ncols=3, fontsize=7)
    return figure
