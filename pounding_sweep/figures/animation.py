"""The row moving, impacts marked, as GIF or MP4."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.animation import FFMpegWriter, PillowWriter

from pounding_sweep.base.errors import InputError, OutputError
from pounding_sweep.figures import require
from pounding_sweep.figures.gallery.row import Stage, forces_of, strongest
from pounding_sweep.figures.shown import WIDTH, heading
from pounding_sweep.figures.style import COLOURS, LINES, in_style

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
    first, last = _window(one, start, end)
    rate = (frames - 1) / ((last - first) / speed) if speed else frames / WATCHED
    kind: Any = PillowWriter if target.suffix.lower() == ".gif" else FFMpegWriter
    writer = kind(fps=rate)
    time = one.time.values
    shown = np.unique(np.searchsorted(time, np.linspace(first, last, frames)).clip(max=len(time) - 1))
    with in_style():
        picture = _Picture(one, first, last)
        try:
            with writer.saving(picture.figure, str(target), dpi=70):
                before = shown[0]
                for number in shown:
                    picture.show(before, number)
                    writer.grab_frame()
                    before = number
        except (OSError, ValueError) as error:
            msg = f"can't write {str(target)!r} ({error}); give a file in a folder that exists"
            raise OutputError(msg) from error
    return target


def check_movie(path: str | os.PathLike[str], frames: int, speed: float | None) -> None:
    """Raise `InputError` or `OutputError` where an animation can't be made, before anything is run for it."""
    suffix = Path(path).suffix.lower()
    if suffix not in (".gif", ".mp4"):
        msg = f"can't write {os.fspath(path)!r}; give a file ending in .gif or .mp4"
        raise OutputError(msg)
    if suffix == ".mp4" and not FFMpegWriter.isAvailable():
        msg = f"can't write {os.fspath(path)!r}: there is no ffmpeg here; install it, or give a file ending in .gif"
        raise OutputError(msg)
    if frames < 2:
        msg = f"frames is {frames!r}; an animation needs at least 2"
        raise InputError(msg)
    if speed is not None and not speed > 0.0:
        msg = f"speed is {speed!r}; it must be a positive number of record seconds per second"
        raise InputError(msg)


def _window(one: xr.Dataset, start: float | None, end: float | None) -> tuple[float, float]:
    """Return the part of the record (s) that is shown."""
    time = one.time.values
    centre, length = strongest(one), PERIODS * _period(one)
    if start is None:
        start = centre - 0.25 * length if end is None else end - length
    if end is None:
        end = start + length
    first, last = max(float(time[0]), start), min(float(time[-1]), end)
    if not first < last:
        msg = f"nothing lies between {start:g} s and {end:g} s; the record runs from {time[0]:g} s to {time[-1]:g} s"
        raise InputError(msg)
    return first, last


def _period(one: xr.Dataset) -> float:
    """Period (s) of the motion, by displacement beside velocity: 2 pi rms(u) / rms(v) of all floors."""
    rates = float(np.square(one.velocity).mean()) if "velocity" in one else 0.0
    if rates == 0.0:
        return float(one.time[-1] - one.time[0])
    return 2.0 * np.pi * float(np.sqrt(np.square(one.displacement).mean() / rates))


class _Picture:
    """The figure of an animation, and what changes in it."""

    def __init__(self, one: xr.Dataset, first: float, last: float) -> None:
        self.time, self.forces = one.time.values, forces_of(one)
        self.stage = Stage(one)
        pairs = one.pair.values.tolist() if self.forces.shape[1] else []
        self.figure, (ax, ground, *force) = self.stage.figure(below=2 if pairs else 1)
        self.stage.draw(ax)
        inside = (self.time >= first) & (self.time <= last)
        ground.plot(self.time[inside], one.ground_acceleration.values[inside], color="black", linewidth=0.8)
        ground.set_ylabel("ground\n(m/s²)")
        for number, pair in enumerate(pairs):
            largest = self.forces[inside, number].max(axis=1)
            colour, line = COLOURS[number % len(COLOURS)], LINES[number % len(LINES)]
            force[0].plot(self.time[inside], largest, color=colour, linestyle=line, linewidth=1.0, label=pair)
            force[0].set_ylabel("force\n(kN)")
            force[0].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
        below = [ground, *force]
        for strip in below:
            strip.set_xlim(first, last)
        ground.tick_params(labelbottom=not force)
        below[-1].set_xlabel("time (s)")
        self.cursors = [strip.axvline(first, color=COLOURS[2], linewidth=1.0) for strip in below]
        self.title = heading(one, f"displacements and gaps drawn {self.stage.factor:g} times", WIDTH)
        self.heading = self.figure.suptitle(f"{self.title}\n{first:.2f} s", fontsize=9)
        self.highest = self.forces[inside].max(initial=0.0)
        self.marks = np.zeros(self.forces.shape[1:])
        self.figure.draw_without_rendering()
        self.figure.set_layout_engine("none")  # nothing moves from frame to frame but the row

    def show(self, before: int, number: int) -> None:
        """Show an instant, and the impacts since an earlier one."""
        if self.highest > 0.0:
            since = self.forces[min(before + 1, number) : number + 1].max(axis=0) / self.highest
            faded = np.where(self.marks > 0.05, _FADING * self.marks, 0.0)
            self.marks = np.maximum(since, faded)
        self.stage.show(number, self.marks)
        for cursor in self.cursors:
            cursor.set_xdata([self.time[number]] * 2)
        self.heading.set_text(f"{self.title}\n{self.time[number]:.2f} s")
