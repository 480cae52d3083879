"""The paper's Figures 4 to 21, drawn from a study and saved as PNG and SVG."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.figures.gallery.spectra import ground_motion
from pounding_sweep.figures.style import COLOURS, in_style, label_edges, legend_below
from pounding_sweep.model.laws import LAWS, MATE2015_MODELS
from pounding_sweep.paper.published import BUILDINGS, PAIRS, READINGS, record_title
from pounding_sweep.paper.report import Picture
from pounding_sweep.paper.study import Study
from pounding_sweep.run.execute import Progress

#: Data of one model at one reading and record -> its lines (x, y).
Lines = Callable[[Any], Sequence[tuple[Any, Any]]]

_DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (5, 1.5, 1, 1.5)), (0, (1, 1)), (0, (3, 1)), (0, (8, 2)))
#: A record's end is not drawn once everything stays below this share of the largest value.
QUIET = 0.1


def model_label(law: str) -> str:
    """Name of a model in legends: its number in the paper and its law."""
    return f"{LAWS[law].model}: {LAWS[law].title}"


def model_look(law: str) -> dict[str, Any]:
    """Colour, dashes and width of a model's line: no pounding thick and grey, behind the others."""
    if law == "none":
        return {"color": "0.6", "linestyle": "-", "linewidth": 2.6, "zorder": 1.5}
    number = MATE2015_MODELS.index(law)
    return {"color": COLOURS[number], "linestyle": _DASHES[number], "linewidth": 1.2}


def model_grid(data: Any, lines: Lines, x: str, y: str, share_y: bool = True) -> Figure:
    """Draw a panel for each reading and record, and in it lines for each model."""
    readings, records, laws = (data[dim].values.tolist() for dim in ("reading", "record", "law"))
    size = (max(5.0, 1.0 + 2.5 * len(records)), 1.3 + 2.5 * len(readings))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(len(readings), len(records), squeeze=False, sharex="col", sharey="row" if share_y else False)
    for (i, reading), (j, record), law in product(enumerate(readings), enumerate(records), laws):
        label = model_label(law)
        for across, up in lines(data.sel(reading=reading, record=record, law=law)):
            axes[i, j].plot(across, up, label=label, **model_look(law))
            label = ""
        axes[0, j].set_title(record_title(record))
    label_edges(axes, x, [f"{READINGS[reading].label}\n{y}" for reading in readings])
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4 if len(records) > 2 else 2)
    return figure


@in_style()
def structural_energy(histories: xr.Dataset, building: str) -> Figure:
    """Draw the structural energy of a building against time, model by model."""
    energy = histories["structural_energy"].sel(building=building)

    # records differ by an order of magnitude
    figure = model_grid(
        energy,
        lambda one: [(one["time"][one.notnull()], one.dropna("time"))],
        "time (s)",
        "energy (kN m)",
        share_y=False,
    )
    for ax in figure.axes:
        ax.set_xlim(0.0, np.asarray(ax.lines[0].get_xdata())[-1])
        ax.set_ylim(bottom=0)
    return figure


@in_style()
def displacement_profiles(cube: xr.Dataset, building: str) -> Figure:
    """Draw the signed peak displacements of a building's floors, model by model."""
    here = cube[["displacement_max", "displacement_min"]].sel(building=building) * 1e3
    floors = np.concatenate([[0], here["storey"].values])

    figure = model_grid(
        here,
        lambda one: [(np.concatenate([[0.0], peaks.values]), floors) for peaks in one.data_vars.values()],
        *("displacement (mm)", "floor"),
    )
    for ax in figure.axes:
        ax.axvline(0.0, color="0.4", linewidth=0.8)
        ax.set_yticks(floors)
    return figure


@in_style()
def shear_profiles(cube: xr.Dataset, building: str) -> Figure:
    """Draw the peak shears of a building's storeys, model by model."""
    shear = cube["storey_shear_max"].sel(building=building) * 1e-3
    edges = np.concatenate([[0], shear["storey"].values])  # constant over a storey: from one floor to the next

    figure = model_grid(
        shear, lambda one: [(np.repeat(one.values, 2), np.repeat(edges, 2)[1:-1])], "storey shear (MN)", "floor"
    )
    for ax in figure.axes:
        ax.set_xlim(left=0)
        ax.set_yticks(edges)
    return figure


@in_style()
def roof_spectra(spectra: xr.Dataset, building: str) -> Figure:
    """Draw the pseudo-acceleration spectra of a roof, model by model."""
    ordinates = spectra["pseudo_acceleration"].sel(building=building) / STANDARD_GRAVITY
    figure = model_grid(ordinates, lambda one: [(one["period"], one)], "period (s)", "spectral acceleration (g)")
    for ax in figure.axes:
        ax.set(xscale="log", yscale="log")
        ax.set_xticks([0.03, 0.1, 0.3, 1, 3], labels=["0.03", "0.1", "0.3", "1", "3"])
        ax.minorticks_off()
    return figure


@in_style()
def roof_histories(histories: xr.Dataset, record: str, **place: str) -> Figure:
    """Draw the displacement of a roof (`building`), on that without pounding, or the force between two (`pair`)."""
    # one row per model with contact, one column per reading; without the quiet end of the record
    alone = "building" in place
    name, factor, label = ("displacement", 1e3, "displacement (mm)") if alone else ("force", 1e-3, "force (MN)")
    values = factor * histories[f"roof_{name}"].sel({"record": record, **place}).dropna("time", how="all")
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
        ax.set_title(above + model_label(law), loc="left", fontsize=8)
        ax.set_xlim(0.0, 1.05 * last)
        if not alone:
            ax.set_ylim(bottom=0)
    label_edges(axes, "time (s)", [""] * len(laws))
    if alone:
        legend_below(figure, axes[0, 0], most=2)
    figure.supylabel(label, fontsize=9)
    return figure


#: Dots per inch of the PNG files.
DPI = 110


@dataclass(frozen=True)
class PaperFigure:
    """One figure of the paper."""

    number: int  # its number
    title: str  # what it shows, in this package's words
    draw: Callable[[Study], Figure]  # `Study` -> figure


#: By the first of the figures in a row: what they show, of which buildings or pairs, and how.
_IN_A_ROW: dict[int, tuple[str, Sequence[str], Callable[[str, Study], Figure]]] = {
    5: ("Signed peak displacements of the floors", BUILDINGS, lambda b, study: displacement_profiles(study.cube, b)),
    8: ("Peak storey shears", BUILDINGS, lambda b, study: shear_profiles(study.cube, b)),
    11: ("Structural energy", BUILDINGS, lambda b, study: structural_energy(study.histories, b)),
    14: (
        "5 % spectra of the roof's total acceleration",
        BUILDINGS,
        lambda b, study: roof_spectra(study.floor_spectra, b),
    ),
    17: (
        "Roof displacement",
        BUILDINGS,
        lambda b, study: roof_histories(study.histories, study.records[-1].name, building=b),
    ),
    20: (
        "Impact force between the roofs",
        PAIRS,
        lambda p, study: roof_histories(study.histories, study.records[-1].name, pair=p),
    ),
}


PAPER_FIGURES: tuple[PaperFigure, ...] = (
    PaperFigure(4, "Ground motions and their 5 % spectra", lambda study: ground_motion(study.motions)),
    *(
        PaperFigure(first + i, f"{title}, {name}{' building' * (names is BUILDINGS)}", partial(draw, name))
        for first, (title, names, draw) in _IN_A_ROW.items()
        for i, name in enumerate(names)
    ),
)
"""Every figure of results, in the paper's order. Its Figures 20 and 21 have one caption; here each has its pair.
Histories are of the paper's record, San Fernando, or of the last one at hand."""


def save_figures(study: Study, folder: Path, progress: Progress | None = None) -> list[Picture]:
    """Draw every figure into a folder, as ``figure_NN.png`` and ``figure_NN.svg``."""
    progress = progress or Progress()
    progress.stage("figures", len(PAPER_FIGURES))
    pictures = []
    for one in PAPER_FIGURES:
        figure = one.draw(study)
        path = folder / f"figure_{one.number:02d}.png"
        figure.savefig(path, dpi=DPI)
        figure.savefig(path.with_suffix(".svg"))
        pictures.append(Picture(one.number, one.title, path))
        progress.advance(1)
    return pictures
