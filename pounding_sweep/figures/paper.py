"""The paper's Figures 4 to 21, drawn from a study and saved as PNG and SVG."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pounding_sweep.base.errors import OutputError
from pounding_sweep.figures.paper_histories import roof_displacement, roof_force, structural_energy
from pounding_sweep.figures.paper_profiles import displacement_profiles, shear_profiles
from pounding_sweep.figures.paper_spectra import roof_spectra
from pounding_sweep.paper.published import BUILDINGS, PAIRS
from pounding_sweep.paper.report import Picture
from pounding_sweep.run.execute import Progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pounding_sweep.paper.study import Study

#: Dots per inch of the PNG files.
DPI = 110


@dataclass(frozen=True)
class PaperFigure:
    """One figure of the paper.

    Attributes
    ----------
    number : int
        Its number.
    title : str
        What it shows, in this package's words.
    draw : callable
        `Study` -> figure.
    """

    number: int
    title: str
    draw: Callable[[Study], Figure]


def _ground_motion(study: Study) -> Figure:
    from pounding_sweep.figures.ground_motion import ground_motion

    return ground_motion(study.motions)


def shown_record(study: Study) -> str:
    """Record of the histories of Figures 17 to 21: the paper's, San Fernando, or the last one at hand."""
    return study.records[-1].name


def _profile(kind: Callable[..., Figure], building: str, study: Study) -> Figure:
    return kind(study.cube, building)


def _energy(building: str, study: Study) -> Figure:
    return structural_energy(study.histories, building)


def _spectra(building: str, study: Study) -> Figure:
    return roof_spectra(study.floor_spectra, building)


def _displacement(building: str, study: Study) -> Figure:
    return roof_displacement(study.histories, building, shown_record(study))


def _force(pair: str, study: Study) -> Figure:
    return roof_force(study.histories, pair, shown_record(study))


def _each(first: int, title: str, draw: Callable[[str, Study], Figure]) -> list[PaperFigure]:
    """Three figures in a row: left, middle and right building."""
    return [PaperFigure(first + i, f"{title}, {b} building", partial(draw, b)) for i, b in enumerate(BUILDINGS)]


FIGURES: tuple[PaperFigure, ...] = (
    PaperFigure(4, "Ground motions and their 5 % spectra", _ground_motion),
    *_each(5, "Signed peak displacements of the floors", partial(_profile, displacement_profiles)),
    *_each(8, "Peak storey shears", partial(_profile, shear_profiles)),
    *_each(11, "Structural energy", _energy),
    *_each(14, "5 % spectra of the roof's total acceleration", _spectra),
    *_each(17, "Roof displacement", _displacement),
    *(PaperFigure(20 + i, f"Impact force between the roofs, {p}", partial(_force, p)) for i, p in enumerate(PAIRS)),
)
"""Every figure of results, in the paper's order. Its Figures 20 and 21 have one caption; here each has its pair."""


def save_figures(study: Study, folder: Path, progress: Progress | None = None) -> list[Picture]:
    """Draw every figure into a folder, as ``figure_NN.png`` and ``figure_NN.svg``.

    Parameters
    ----------
    study : Study
        What was computed.
    folder : Path
        An existing folder.
    progress : Progress, optional
        Display.

    Returns
    -------
    list of Picture
        In the paper's order.

    Raises
    ------
    OutputError
        A file can't be written.
    """
    progress = progress or Progress()
    progress.stage("figures", len(FIGURES))
    found = []
    for one in FIGURES:
        figure = one.draw(study)
        path = folder / f"figure_{one.number:02d}.png"
        try:
            figure.savefig(path, dpi=DPI)
            figure.savefig(path.with_suffix(".svg"))
        except OSError as error:
            msg = f"can't write {str(path)!r} ({error.strerror or error}); free some space or give another folder"
            raise OutputError(msg) from error
        found.append(Picture(one.number, one.title, path))
        progress.advance(1)
    return found
