"""The paper's Figures 4 to 21, drawn from a study and saved as PNG and SVG."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.figures.gallery.spectra import ground_motion
from pounding_sweep.figures.style import COLOURS, finish, in_style, subplots
from pounding_sweep.model.laws import LAWS, MATE2015_MODELS
from pounding_sweep.paper.report import Picture
from pounding_sweep.paper.study import BUILDINGS, PAIRS, PAPER, READINGS, STOREYS, Study, record_title
from pounding_sweep.run.execute import Progress

#: Names of models in legends: number in the paper, and law.
_LABELS = {law: f"{LAWS[law].model}: {LAWS[law].title}" for law in MATE2015_MODELS}
#: Base and floors.
_FLOORS = (0, *STOREYS)


@in_style()
def draw_models(
    of_study: Callable[[Study], Any],
    lines_of: Callable[[Any], Iterable[tuple[Any, Any]]],
    x: str,
    y: str,
    properties: dict[str, Any],
    building: str,
    study: Study,
    *,
    sharey: Any = "row",
) -> Figure:
    """Draw a panel for each reading and record of one building, and in it the lines (x, y) of each model."""
    values = of_study(study).sel(building=building)
    readings, records, laws = (values[dim].values.tolist() for dim in ("reading", "record", "law"))
    size = (max(1.0, 5.0 - 2.5 * len(records)), 2.5, 1.3, 2.5)
    axes = subplots(len(readings), len(records), size, sharex="col", sharey=sharey)
    for ax, (reading, record) in zip(axes.flat, product(readings, records), strict=True):
        for law in laws:
            for line in lines_of(values.sel(reading=reading, record=record, law=law)):
                ax.plot(*line, label=_LABELS[law], **PAPER["looks"][law])
        if x.startswith("displacement"):
            ax.axvline(0.0, color="0.4", linewidth=0.8)
    for ax in axes.flat:
        ax.set(**properties)
        ax.minorticks_off()
    for ax, record in zip(axes[0], records, strict=True):
        ax.set_title(record_title(record))
    return finish(axes, x, [f"{READINGS[reading].label}\n{y}" for reading in readings], legend=4)


@in_style()
def draw_roofs(history: str, factor: float, label: str, place: str, study: Study) -> Figure:
    """Draw the displacement of a roof, on that without pounding, or the force between roofs, without its quiet end."""
    values = factor * study.histories[history]
    alone, record = "building" in values.dims, study.records[-1].name
    values = values.sel({"record": record, "building" if alone else "pair": place}).dropna("time", how="all")
    readings, time = values["reading"].values.tolist(), values["time"].values
    laws = [law for law in values["law"].values.tolist() if law != "none"]
    loud = abs(values).max(["reading", "law"])
    last = float(time[loud >= 0.1 * loud.max()][-1])
    axes = subplots(len(laws), len(readings), (2.0, 4.2, 0.8, 1.25), sharey=alone)
    for ax, (law, reading) in zip(axes.flat, product(laws, readings), strict=True):
        one = values.sel(reading=reading)
        if alone:
            ax.plot(time, one.sel(law="none"), color="0.6", linewidth=1.6, label="no pounding")
        ax.plot(time, one.sel(law=law), color=COLOURS[1], linewidth=0.9, label="with pounding")
        above = f"{record_title(record)}, {READINGS[reading].label}\n" if law == laws[0] else ""
        ax.set_title(above + _LABELS[law], loc="left", fontsize=8)
        ax.set_xlim(0.0, 1.05 * last)
        if not alone:
            ax.set_ylim(bottom=0)
    figure = finish(axes, "time (s)", "", legend=2 * alone)
    figure.supylabel(label, fontsize=9)
    return figure


#: By the first of the figures in a row: what they show, of which buildings or pairs, and how.
_ROWS: dict[int, tuple[str, Sequence[str], Callable[[str, Study], Figure]]] = {
    5: (
        *("Signed peak displacements of the floors", BUILDINGS),
        partial(
            draw_models,
            lambda study: 1e3 * study.cube[["displacement_max", "displacement_min"]],
            lambda one: [([0.0, *peaks.values], _FLOORS) for peaks in one.data_vars.values()],
            *("displacement (mm)", "floor", {"yticks": _FLOORS}),
        ),
    ),
    8: (
        *("Peak storey shears", BUILDINGS),
        partial(
            draw_models,
            lambda study: 1e-3 * study.cube["storey_shear_max"],
            lambda one: [(np.repeat(one.values, 2), np.repeat(_FLOORS, 2)[1:-1])],  # constant over a storey
            *("storey shear (MN)", "floor", {"xlim": (0, None), "yticks": _FLOORS}),
        ),
    ),
    11: (
        *("Structural energy", BUILDINGS),
        partial(
            draw_models,
            lambda study: study.histories["structural_energy"],
            lambda one: [(one["time"][one.notnull()], one.dropna("time"))],
            *("time (s)", "energy (kN m)", {"xmargin": 0.0, "ylim": (0, None)}),
            sharey=False,  # records differ by an order of magnitude
        ),
    ),
    14: (
        *("5 % spectra of the roof's total acceleration", BUILDINGS),
        partial(
            draw_models,
            lambda study: study.histories["pseudo_acceleration"] / STANDARD_GRAVITY,
            lambda one: [(one["period"], one)],
            *("period (s)", "spectral acceleration (g)"),
            {"xscale": "log", "yscale": "log", "xticks": (ticks := [0.03, 0.1, 0.3, 1, 3]), "xticklabels": ticks},
        ),
    ),
    17: ("Roof displacement", BUILDINGS, partial(draw_roofs, "roof_displacement", 1e3, "displacement (mm)")),
    20: ("Impact force between the roofs", PAIRS, partial(draw_roofs, "roof_force", 1e-3, "force (MN)")),
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
        figure.savefig(path, dpi=110)
        figure.savefig(path.with_suffix(".svg"))
        pictures.append((number, title, path))
        progress.advance(1)
    return pictures
