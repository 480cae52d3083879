"""One style for all figures, readable in print and for colour-blind readers, and the panels they are made of."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import partial
from io import BytesIO
from itertools import chain
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler
from matplotlib.style import context
from matplotlib.text import Text
from matplotlib.ticker import FixedLocator

from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.base.errors import InputError

#: Colours of Okabe & Ito (2008), told apart by colour-blind readers, with black first.
COLOURS = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C510A")
#: Drawn with the colours, so that lines are told apart without them.
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
#: Styles of lines in turn, told apart by dashes or by markers.
DASHED = cycler(color=COLOURS, linestyle=("-", "--", "-.", ":") * 2)
MARKED = cycler(color=COLOURS * 2, marker=MARKERS * 2, linestyle=("-",) * 8 + ("--",) * 8)

#: A context, and decorator, that draws in the package's style whatever the user's matplotlib settings.
in_style = partial(context, Path(__file__).parents[1] / "data" / "figures.mplstyle", after_reset=True)


class NotebookFigure(Figure):
    """A figure that notebooks show, though pyplot knows nothing of it, and its caption."""

    #: what it shows, then of which values and how many, and what to do for others
    caption: list[str]

    def name_subject(self, study: str = "") -> None:
        """Write the title: the study, if there is one, and the subject, in two lines at most."""
        width, subject = int(14 * self.get_figwidth()), self.caption[0]
        above = [study] if study and max(len(study), len(subject)) <= width else []  # else both do not fit
        parts = (part if len(part) > width else part.replace(" ", "\xa0") for part in subject.split("; "))  # unbroken
        lines = fill("; ".join(parts), width, max_lines=2, placeholder=" ...").replace("\xa0", " ")
        self.suptitle("\n".join([*above, lines]))
        self.caption = [join_nonempty(study, subject), *self.caption[1:]]

    def _repr_png_(self) -> bytes:
        file = BytesIO()
        self.savefig(file, format="png")
        return file.getvalue()


def subplots(
    rows: int,
    columns: int,
    size: tuple[float, float, float, float],
    ax: Any = None,
    *,
    styles: Any = None,
    **sharing: Any,
) -> Any:
    """Return the panels of a new figure, a 2-D array; with `ax`, these axes are the only panel.

    The size (inches) is a width and what each column adds to it, a height and what each row adds.
    """
    if ax is None:
        width, column, height, row = size
        figure = NotebookFigure(figsize=(width + column * columns, height + row * rows), layout="constrained")
        options: Any = {"sharex": True, "sharey": "row"} | sharing
        axes = figure.subplots(rows, columns, squeeze=False, **options)
    elif rows * columns == 1:
        axes = np.array([[ax]], dtype=object)
    else:
        raise InputError(
            f"the figure has {rows} x {columns} panels, and axes for one are given; choose one value of what they "
            "are for (pair, building, law or response), or leave ax out"
        )
    for panel in axes.flat:
        panel.set_prop_cycle(styles)
    return axes


def finish(axes: Any, x: str, y: str | Sequence[str], subject: str = "", *notes: str, legend: int = 3) -> Any:
    """Label panels at the edges of their grid, y by one text or one a row, with a legend below; notes are captions."""
    for column in axes.T:
        column[-1].set_xlabel(x)
        for ax in column[1:]:
            if ax.get_title() == column[0].get_title():
                ax.set_title("")
    for ax, label in zip(axes[:, 0], [y] * len(axes) if isinstance(y, str) else y, strict=True):
        ax.set_ylabel(label)
    if legend:
        legend_below(axes[0], legend)
    return put_title(axes, subject, *notes)


def legend_below(panels: Any, most: int) -> None:
    """Put a legend of some panels below all, each label once, in as many columns as fit the figure, `most` at most."""
    pairs = (zip(*ax.get_legend_handles_labels()[::-1], strict=True) for ax in panels)
    handles, figure = dict(chain.from_iterable(pairs)), panels[0].figure
    if not isinstance(figure, NotebookFigure):
        panels[0].legend(handles.values(), handles)
    elif handles:
        entry = 0.6 + 0.07 * max(map(len, handles))  # width in inches: line, name, space
        columns = max(1, min(most, len(handles), int(figure.get_figwidth() / entry)))
        figure.legend(handles.values(), handles, loc="outside lower center", ncols=columns)


def legend_beside(ax: Any) -> None:
    """Put the legend of a panel beside it, where it hides nothing."""
    if ax.get_legend_handles_labels()[1]:
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)


def put_title(axes: Any, subject: str, *notes: str) -> Any:
    """Write what a figure shows above it, or above the one panel in a figure of the user's; return the figure."""
    panel, figure = axes.flat[0], axes.flat[0].figure
    if isinstance(figure, NotebookFigure):
        figure.caption = [" ".join(subject.split()), *filter(None, notes)]
        figure.name_subject()
    else:
        panel.set_title("\n".join(filter(None, (panel.get_title(), subject))))
    return figure


def join_nonempty(*parts: str) -> str:
    """Join those parts of a text that are not empty."""
    return "; ".join(filter(None, parts))


def unit_text(attributes: Mapping[str, Any]) -> str:
    """Write the unit of a variable as engineers do; "" where it has none."""
    units = str(attributes.get("units", attributes.get("unit_text", "1")))
    text = spell_units(units)
    return "" if units == "1" else text.replace("/", "1/", text.startswith("/"))


def spell_units(text: str) -> str:
    """Return a text whose units are written as engineers do: m/s² for m s-2."""
    raised = {"1": "", "2": "²", "3": "³"}
    return re.sub(r" ?([A-Za-z]+)-(\d+(?:\.\d+)?)", lambda m: f"/{m[1]}{raised.get(m[2], f'^{m[2]}')}", text)


def cell_edges(values: np.ndarray, *, even: bool = False) -> np.ndarray:
    """Return the edges of cells around values: halfway between their logarithms, or `even`, between themselves."""
    at = values if even else np.log(values)
    half = 0.5 * np.diff(at) if len(at) > 1 else np.array([np.log(2.0)])
    edges = np.append(at - np.append(half[0], half)[: len(at)], at[-1] + half[-1])
    return edges if even else np.asarray(np.exp(edges))


def show_in_g(figure: Any) -> None:
    """Write the accelerations (m/s²) of a figure in g: on its axes and in its texts."""
    one, number = STANDARD_GRAVITY, re.compile(r"[\d.]+(?:e[+-]\d+)?(?= (?:and \S+ )?m/s²)")
    labels = [(ax.xaxis, ax.get_xlabel()) for ax in figure.axes]
    labels += [(ax.yaxis, ax.get_ylabel() or ax.figure.get_supylabel()) for ax in figure.axes]
    axes = [axis for axis, label in labels if "(m/s²)" in label]
    for locator in {axis.get_major_locator() for axis in axes}:  # that axes may share
        if not isinstance(locator, FixedLocator):
            ticks = locator.tick_values
            locator.tick_values = lambda low, high, ticks=ticks: one * np.asarray(ticks(low / one, high / one))
    for axis in axes:
        axis.set_major_formatter(lambda value, _: f"{value / one:.3g}")
    for text in figure.findobj(Text):
        words = number.sub(lambda match: f"{float(match[0]) / one:.3g}", text.get_text())
        text.set_text(words.replace("m/s²", "g"))
