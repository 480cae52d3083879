"""The paper's Figures 4 to 21, drawn from a study and saved as PNG and SVG."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.figures.gallery.spectra import ground_motion
from pounding_sweep.figures.style import COLOURS, in_style, label_edges, legend_below
from pounding_sweep.model.laws import LAWS, MATE2015_MODELS
from pounding_sweep.paper.report import Picture
from pounding_sweep.paper.study import BUILDINGS, PAIRS, READINGS, STOREYS, Study, record_title
from pounding_sweep.run.execute import Progress

_DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (5, 1.5, 1, 1.5)), (0, (1, 1)), (0, (3, 1)), (0, (8, 2)))
#: Colour, dashes and width of the models' lines: no pounding thick and grey, behind the others.
_LOOKS: dict[str, dict[str, Any]] = {
    law: {"color": colour, "linestyle": dashes, "linewidth": 1.2}
    for law, colour, dashes in zip(MATE2015_MODELS, COLOURS, _DASHES, strict=False)
} | {"none": {"color": "0.6", "linestyle": "-", "linewidth": 2.6, "zorder": 1.5}}
#: Names of models in legends: number in the paper, and law.
_LABELS = {law: f"{LAWS[law].model}: {LAWS[law].title}" for law in MATE2015_MODELS}
#: A record's end is not drawn once everything stays below this share of the largest value.
QUIET = 0.1
#: Dots per inch of the PNG files.
DPI = 110
#: Base and floors.
_FLOORS = (0, *STOREYS)


@dataclass(frozen=True)
class Models:
    """Figures of all models, a panel for each reading and record."""

    values: Callable[[Study], Any]  # what is drawn
    lines: Callable[[Any], Iterable[tuple[Any, Any]]]  # of one model at one reading and record: its lines (x, y)
    x: str
    y: str
    panel: dict[str, Any]  # properties of the panels
    sharey: Any = "row"


_MODELS = {
    "displacements": Models(
        lambda study: 1e3 * study.cube[["displacement_max", "displacement_min"]],
        lambda one: [([0.0, *peaks.values], _FLOORS) for peaks in one.data_vars.values()],
        *("displacement (mm)", "floor", {"yticks": _FLOORS}),
    ),
    "shears": Models(
        lambda study: 1e-3 * study.cube["storey_shear_max"],
        lambda one: [(np.repeat(one.values, 2), np.repeat(_FLOORS, 2)[1:-1])],  # constant over a storey
        *("storey shear (MN)", "floor", {"xlim": (0, None), "yticks": _FLOORS}),
    ),
    "energy": Models(  # records differ by an order of magnitude
        lambda study: study.histories["structural_energy"],
        lambda one: [(one["time"][one.notnull()], one.dropna("time"))],
        *("time (s)", "energy (kN m)", {"xmargin": 0.0, "ylim": (0, None)}, False),
    ),
    "spectra": Models(
        lambda study: study.histories["pseudo_acceleration"] / STANDARD_GRAVITY,
        lambda one: [(one["period"], one)],
        *("period (s)", "spectral acceleration (g)"),
        {"xscale": "log", "yscale": "log", "xticks": (ticks := [0.03, 0.1, 0.3, 1, 3]), "xticklabels": ticks},
    ),
}


@in_style()
def draw_models(kind: str, building: str, study: Study) -> Figure:
    """Draw a panel for each reading and record of one building, and in it lines for each model."""
    models = _MODELS[kind]
    values = models.values(study).sel(building=building)
    readings, records, laws = (values[dim].values.tolist() for dim in ("reading", "record", "law"))
    size = (max(5.0, 1.0 + 2.5 * len(records)), 1.3 + 2.5 * len(readings))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(len(readings), len(records), squeeze=False, sharex="col", sharey=models.sharey)
    for (row, reading), (column, record) in product(enumerate(readings), enumerate(records)):
        ax = axes[row, column]
        for law in laws:
            for x, y in models.lines(values.sel(reading=reading, record=record, law=law)):
                ax.plot(x, y, label=_LABELS[law], **_LOOKS[law])
        if kind == "displacements":
            ax.axvline(0.0, color="0.4", linewidth=0.8)
        if row == 0:
            ax.set_title(record_title(record))
    for ax in axes.flat:
        ax.set(**models.panel)
        ax.minorticks_off()
    label_edges(axes, models.x, [f"{READINGS[reading].label}\n{models.y}" for reading in readings])
    legend_below(figure, axes[0, :1], most=4)
    return figure


@in_style()
def draw_roofs(dim: str, place: str, study: Study) -> Figure:
    """Draw the displacement of a building's roof, on that without pounding, or the force between the roofs of a pair.

    A row for each model with contact, a column for each reading; without the quiet end of the record.
    """
    alone = dim == "building"
    name, factor, label = ("displacement", 1e3, "displacement (mm)") if alone else ("force", 1e-3, "force (MN)")
    record = study.records[-1].name
    values = factor * study.histories[f"roof_{name}"].sel({"record": record, dim: place}).dropna("time", how="all")
    readings, time = values["reading"].values.tolist(), values["time"].values
    laws = [law for law in values["law"].values.tolist() if law != "none"]
    loud = abs(values).max([dim for dim in values.dims if dim != "time"])
    last = float(time[np.flatnonzero(loud >= QUIET * loud.max())[-1]])
    figure = Figure(figsize=(2.0 + 4.2 * len(readings), 0.8 + 1.25 * len(laws)), layout="constrained")
    axes = figure.subplots(len(laws), len(readings), squeeze=False, sharex=True, sharey=alone)
    for (row, law), (column, reading) in product(enumerate(laws), enumerate(readings)):
        ax, one = axes[row, column], values.sel(reading=reading)
        if alone:
            ax.plot(time, one.sel(law="none"), color="0.6", linewidth=1.6, label="no pounding")
        ax.plot(time, one.sel(law=law), color=COLOURS[1], linewidth=0.9, label="with pounding")
        above = "" if row else f"{record_title(record)}, {READINGS[reading].label}\n"
        ax.set_title(above + _LABELS[law], loc="left", fontsize=8)
        ax.set_xlim(0.0, 1.05 * last)
        if not alone:
            ax.set_ylim(bottom=0)
    label_edges(axes, "time (s)", [""] * len(laws))
    if alone:
        legend_below(figure, axes[0, :1], most=2)
    figure.supylabel(label, fontsize=9)
    return figure


#: By the first of the figures in a row: what they show, of which buildings or pairs, and how.
_ROWS: dict[int, tuple[str, Sequence[str], Callable[[str, Study], Figure]]] = {
    5: ("Signed peak displacements of the floors", BUILDINGS, partial(draw_models, "displacements")),
    8: ("Peak storey shears", BUILDINGS, partial(draw_models, "shears")),
    11: ("Structural energy", BUILDINGS, partial(draw_models, "energy")),
    14: ("5 % spectra of the roof's total acceleration", BUILDINGS, partial(draw_models, "spectra")),
    17: ("Roof displacement", BUILDINGS, partial(draw_roofs, "building")),
    20: ("Impact force between the roofs", PAIRS, partial(draw_roofs, "pair")),
}
#: Every figure of results by its number: what it shows, and how it is drawn. The paper's Figures 20 and 21 have one
#: caption; here each has its pair. Histories are of the paper's record, San Fernando, or of the last one at hand.
PAPER_FIGURES: dict[int, tuple[str, Callable[[Study], Figure]]] = {
    4: ("Ground motions and their 5 % spectra", lambda study: ground_motion(study.motions))
} | {
    first + i: (f"{title}, {place}{' building' * (places is BUILDINGS)}", partial(draw, place))
    for first, (title, places, draw) in _ROWS.items()
    for i, place in enumerate(places)
}


def save_figures(study: Study, folder: Path, progress: Progress | None = None) -> list[Picture]:
    """Draw every figure into a folder, as ``figure_NN.png`` and ``figure_NN.svg``."""
    progress = progress or Progress()
    progress.stage("figures", len(PAPER_FIGURES))
    pictures = []
    for number, (title, draw) in PAPER_FIGURES.items():
        figure = draw(study)
        path = folder / f"figure_{number:02d}.png"
        figure.savefig(path, dpi=DPI)
        figure.savefig(path.with_suffix(".svg"))
        pictures.append((number, title, path))
        progress.advance(1)
    return pictures
