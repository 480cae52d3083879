"""The row moving, impacts marked, as GIF or MP4."""

from __future__ import annotations

import os
from itertools import cycle, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.animation import FFMpegWriter, PillowWriter

from pounding_sweep.base.errors import InputError, OutputError
from pounding_sweep.figures import require
from pounding_sweep.figures.gallery.row import Stage, contact_forces, find_strongest
from pounding_sweep.figures.select import scenario_title
from pounding_sweep.figures.style import COLOURS, DASHED, in_style, legend_beside, wrap_title

#: Periods of the motion that are shown by default, and how long that takes to watch (s).
PERIODS, WATCHED = 4.0, 6.0
#: How much of a mark is left in the next frame: impacts are over within a frame or two.
_FADING = 0.6


def animate(
    one: xr.Dataset,
    path: str | os.PathLike[str],
    *,
    start: float | None = None,
    end: float | None = None,
    frames: int = 40,
    speed: float | None = None,
) -> Path:
    """Write an animation of the row.

    Displacements and gaps are drawn larger than they are, by the factor in the
    title. A star marks each impact since the frame before, its area the force, and
    fades. Below run the ground acceleration and the largest contact force of each pair.

    Parameters
    ----------
    one : xarray.Dataset
        What `pounding_sweep.simulate` returned.
    path : path
        File to write: ``.gif``, or ``.mp4`` where ffmpeg is installed.
    start, end : float, optional
        Part of the record (s); by default four periods of the motion, round the strongest impact.
    frames : int
        Number of pictures, at least 2.
    speed : float, optional
        Seconds of the record per second of the animation; by default such that it takes 6 s.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        The dataset lacks what is drawn, or a number is not valid.
    OutputError
        The file can't be written, or nothing here can write such a file.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> one = ps.simulate("mate2015", "el_centro", law="linear")
    >>> path = animate(one, "row.gif", frames=20)  # doctest: +SKIP
    """
    target = Path(path)
    check_movie(target, frames, speed)
    require(one, "row")
    time, forces, stage = one.time.values, contact_forces(one), Stage(one)
    first, last = _choose_window(one, start, end)
    shown = np.unique(np.searchsorted(time, np.linspace(first, last, frames)).clip(max=len(time) - 1))
    inside = (time >= first) & (time <= last)
    pairs = one.pair.values.tolist() if forces.shape[1] else []
    writer: Any = PillowWriter if target.suffix.lower() == ".gif" else FFMpegWriter
    writer = writer(fps=(frames - 1) / ((last - first) / speed) if speed else frames / WATCHED)
    with in_style():
        figure, (_, ground, *strips) = stage.draw(below=2 if pairs else 1)
        ground.plot(time[inside], one.ground_acceleration.values[inside], color="black", linewidth=0.8)
        ground.set_ylabel("ground\n(m/s²)")
        ground.tick_params(labelbottom=not pairs)
        for number, (pair, style) in enumerate(zip(pairs, cycle(DASHED))):
            largest = forces[inside, number].max(axis=1)
            strips[0].plot(time[inside], largest, label=pair, linewidth=1.0, **style)
            strips[0].set_ylabel("force\n(kN)")
            legend_beside(strips[0])
        strips = [ground, *strips]
        strips[-1].set_xlabel("time (s)")
        cursors = [strip.axvline(first, color=COLOURS[2], linewidth=1.0) for strip in strips]
        for strip in strips:
            strip.set_xlim(first, last)
        title = wrap_title(7.2, scenario_title(one), f"displacements and gaps drawn {stage.factor:g} times")
        heading = figure.suptitle(f"{title}\n{first:.2f} s")
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # nothing moves from frame to frame but the row
        marks = fading_marks(forces / (forces[inside].max(initial=0.0) or 1.0), shown)
        try:
            with writer.saving(figure, str(target), dpi=70):
                for number, areas in zip(shown.tolist(), marks, strict=True):
                    stage.show(number, areas)
                    heading.set_text(f"{title}\n{time[number]:.2f} s")
                    for cursor in cursors:
                        cursor.set_xdata([time[number]] * 2)
                    writer.grab_frame()
        except (OSError, ValueError) as error:
            raise OutputError(f"can't write {str(target)!r} ({error}); give a file in a folder that exists") from error
    return target


def fading_marks(forces: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """Return the areas of marks in the frames at those instants: the largest force since the frame before, fading."""
    starts = np.concatenate([shown[:1], shown[:-1] + 1])
    marks = np.maximum.reduceat(forces[: shown[-1] + 1], starts, axis=0)
    for before, now in pairwise(marks):
        np.maximum(now, np.where(before > 0.05, _FADING * before, 0.0), out=now)
    return marks


def check_movie(path: str | os.PathLike[str], frames: int, speed: float | None) -> None:
    """Raise `InputError` or `OutputError` where an animation can't be made, before anything is run for it."""
    suffix = Path(path).suffix.lower()
    if suffix not in (".gif", ".mp4"):
        raise OutputError(f"can't write {os.fspath(path)!r}; give a file ending in .gif or .mp4")
    if suffix == ".mp4" and not FFMpegWriter.isAvailable():
        raise OutputError(
            f"can't write {os.fspath(path)!r}: there is no ffmpeg here; install it, or give a file ending in .gif"
        )
    if frames < 2:
        raise InputError(f"frames is {frames!r}; an animation needs at least 2")
    if speed is not None and not speed > 0.0:
        raise InputError(f"speed is {speed!r}; it must be a positive number of record seconds per second")


def _choose_window(one: xr.Dataset, start: float | None, end: float | None) -> tuple[float, float]:
    """Return the part of the record (s) that is shown: by default, four periods round the strongest impact."""
    time = one.time.values
    rates = float(np.square(one.velocity).mean()) if "velocity" in one else 0.0
    squares = float(np.square(one.displacement).mean())
    period = 2.0 * np.pi * np.sqrt(squares / rates) if rates else time[-1] - time[0]  # of the motion of all floors
    if start is None:
        start = time[find_strongest(one)] - 0.25 * PERIODS * period if end is None else end - PERIODS * period
    end = start + PERIODS * period if end is None else end
    first, last = max(float(time[0]), start), min(float(time[-1]), end)
    if not first < last:
        raise InputError(
            f"nothing lies between {start:g} s and {end:g} s; the record runs from {time[0]:g} s to {time[-1]:g} s"
        )
    return first, last
