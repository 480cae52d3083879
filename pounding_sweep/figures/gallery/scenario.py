"""Figures of one scenario: histories against time and against each other, and the row at an instant and in motion."""

from __future__ import annotations

import math
import os
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.animation import FFMpegWriter, PillowWriter
from matplotlib.figure import Figure

from pounding_sweep.analysis.rebuild import stored_scene
from pounding_sweep.base.errors import InputError, OutputError
from pounding_sweep.figures import figure_of, require
from pounding_sweep.figures.select import scenario_title, time_slice
from pounding_sweep.figures.style import (
    COLOURS,
    DASHED,
    finish,
    in_style,
    legend_beside,
    put_title,
    subplots,
    wrap_title,
)
from pounding_sweep.model.scene import Wall

#: Circles on lines.
_RING = {"marker": "o", "linestyle": "none"}
#: Storeys in a panel of loops: those whose drifts are largest.
_STOREYS = 4


@figure_of(
    "histories",
    "histories",
    "ground acceleration, floor displacements and contact forces against time, peaks marked, from 'simulate'",
    "several time, ground_acceleration, displacement",
)
def histories(one: xr.Dataset, *, start: float | None = None, end: float | None = None) -> Figure:
    """Draw the histories of one scenario: ground acceleration, top floors, contact forces.

    Circles are the peaks that are reported, located between the instants of the histories, at the instant next to them.

    Parameters
    ----------
    one : xarray.Dataset
        What `pounding_sweep.simulate` returned.
    start, end : float, optional
        Part of the record that is drawn (s); all of it by default.
    """
    part = time_slice(one, start, end)
    pairs = one.pair.values.tolist() if "contact_force" in one else []
    rows = 2 + len(pairs)
    figure, axes = subplots(rows, 1, (7.2, 1.4 + 1.5 * rows), sharey=False, styles=DASHED)
    ground, top, *contacts = axes[:, 0]
    ground.set_xlim(part.time[0], part.time[-1])
    ground.plot(part.time, part.ground_acceleration, color="black", linewidth=0.7)
    for building in one.building.values:
        floor = one.sel(building=building).dropna("storey", how="all", subset=["displacement"]).isel(storey=-1)
        peaks = {name: sign for name, sign in (("displacement_max", 1), ("displacement_min", -1)) if name in one}
        rings = [(sign * floor.displacement, 1e3 * floor[name]) for name, sign in peaks.items()]
        _draw_history(top, 1e3 * floor.displacement.sel(time=part.time), building, rings)
    for panel, pair in zip(contacts, pairs, strict=True):
        if panel is not contacts[0]:
            panel.sharey(contacts[0])
        for storey in one.storey.values:
            here = one.sel(pair=pair, storey=storey)
            force = here.contact_force.fillna(0.0)
            rings = [(force, here.impact_force_max)] if "impact_force_max" in one else []
            _draw_history(panel, force.sel(time=part.time), f"storey {storey}", rings)
    for panel in axes[1:, 0]:
        legend_beside(panel)
    if pairs and not (part.contact_force < 0.0).any():
        contacts[0].set_ylim(bottom=0.0)
    for panel in contacts:
        _say_no_contact(panel)
    labels = ["ground acc. (m/s²)", "top floor (mm)", *(f"{pair}\nforce (kN)" for pair in pairs)]
    return finish(figure, axes, "time (s)", labels, scenario_title(one), legend=0)


def _draw_history(ax: Any, line: xr.DataArray, label: str, peaks: list[tuple[xr.DataArray, xr.DataArray]]) -> None:
    """Draw a history unless it is zero, and of reported peaks a ring where their own is largest, if that is drawn."""
    shown = bool(line.any())
    (curve,) = ax.plot(line.time, line, label=label * shown, linewidth=1.0, visible=shown)
    for series, peak in peaks if shown else ():
        at = series.idxmax("time")
        if line.time[0] <= at <= line.time[-1]:
            ax.plot(at, peak, color=curve.get_color(), markerfacecolor="none", markersize=6, **_RING)


def _say_no_contact(ax: Any) -> None:
    """Write into a panel without lines why there are none."""
    if not any(line.get_visible() for line in ax.lines):
        ax.text(0.5, 0.5, "no contact", transform=ax.transAxes, ha="center", va="center", color="0.35")


@figure_of(
    "closing",
    "histories",
    "relative displacement of the floors that can meet against time, beside their gap, onsets marked, from 'simulate'",
    "several time, pair, displacement",
)
def closing(one: xr.Dataset, *, start: float | None = None, end: float | None = None, ax: Any = None) -> Figure:
    """Draw the displacement of each left floor less that of the right one: they touch where it reaches the gap.

    Circles mark the onsets of contact that the histories show. Where there are bumpers, floors touch their thickness
    earlier.

    Parameters
    ----------
    one : xarray.Dataset
        What `pounding_sweep.simulate` returned.
    start, end : float, optional
        Part of the record that is drawn (s); all of it by default.
    ax : matplotlib.axes.Axes, optional
        Axes for a row of one pair.
    """
    part = time_slice(one, start, end)
    scene, time = stored_scene(one), part.time.values
    moved = 1e3 * part.displacement.transpose("time", "building", "storey").values
    u = np.column_stack([moved[:, b, : building.n_storeys] for b, building in enumerate(scene.buildings)])
    pairs, gaps = scene.pair_names, 1e3 * np.array(scene.gaps)
    figure, axes = subplots(len(pairs), 1, (7.2, 1.2 + 2.0 * len(pairs)), ax, styles=DASHED)
    for number, (panel, gap) in enumerate(zip(axes[:, 0], gaps, strict=True)):
        contacts = zip(scene.contacts, gap - 1e3 * scene.thicknesses(), strict=True)
        faces = {contact: face for contact, face in contacts if contact.pair == number}
        for contact, face in faces.items():
            relative = sum(share * u[:, floor] for floor, share in contact.ends)
            label = f"storey {contact.storey}{' and columns' if contact.struck >= 0 else ''}"
            (curve,) = panel.plot(time, relative, label=label, linewidth=1.0)
            closed = relative > face
            onsets = time[1:][closed[1:] & ~closed[:-1]]
            ring = {"color": curve.get_color(), "markerfacecolor": "white", "markersize": 5, "zorder": 3}
            panel.plot(onsets, np.full(len(onsets), face), **ring, **_RING)
        for face in sorted({gap, *faces.values()}, reverse=True):
            words, dashes = ("gap", "-") if face == gap else ("bumpers", "--")
            panel.axhline(face, color="0.4", linewidth=1.6, linestyle=dashes, label=words)
        panel.axhspan(gap, max(gap, panel.get_ylim()[1]), color="0.9", linewidth=0.0, zorder=0)
        panel.set_xlim(time[0], time[-1])
        legend_beside(panel)
    labels = [f"{pair}\nrelative displacement (mm)" for pair in pairs]
    return finish(figure, axes, "time (s)", labels, scenario_title(one), legend=0)


@figure_of(
    "phase",
    "histories",
    "velocity against displacement of the top floors, in contact and out of it, from 'simulate'",
    "several time, displacement, velocity",
)
def phase(one: xr.Dataset, *, start: float | None = None, end: float | None = None, ax: Any = None) -> Figure:
    """Draw the velocity of each building's top floor against its displacement; where the building is in contact, bold.

    Parameters
    ----------
    one : xarray.Dataset
        What `pounding_sweep.simulate` returned.
    start, end : float, optional
        Part of the record that is drawn (s); all of it by default.
    ax : matplotlib.axes.Axes, optional
        Axes for a row of one building.
    """
    part = time_slice(one, start, end)
    buildings, scene = one.building.values.tolist(), stored_scene(one)
    names = [item.name for item in scene.row]
    figure, axes = subplots(1, len(buildings), (1.4 + 2.6 * len(buildings), 3.6), ax)
    for panel, building in zip(axes[0], buildings, strict=True):
        top = part.sel(building=building).dropna("storey", how="all", subset=["displacement"]).isel(storey=-1)
        panel.plot(1e3 * top.displacement, top.velocity, color="0.55", linewidth=0.7, label="apart")
        if "contact_force" in part:
            at = names.index(building)
            places = sorted({contact.place for contact in scene.contacts if contact.pair in (at - 1, at)})
            near = (abs(part.contact_force.isel(pair=places)) > 0.0).any(["pair", "storey"])
            bold = {"color": COLOURS[2], "linewidth": 1.8, "label": "in contact"}
            panel.plot(1e3 * top.displacement.where(near), top.velocity.where(near), **bold)
        panel.set_title(f"building {building}")
    axes[0, 0].legend(loc="upper left", fontsize=8)
    return finish(figure, axes, "top floor displacement (mm)", ["velocity (m/s)"], scenario_title(one), legend=0)


@figure_of(
    "force-penetration",
    "histories",
    "contact force against penetration, pair by pair, from 'simulate'",
    "several time, contact_force, penetration",
)
def force_penetration(
    one: xr.Dataset, *, start: float | None = None, end: float | None = None, ax: Any = None
) -> Figure:
    """Draw the contact force against the penetration: one loop per impact, whose area is the energy it took.

    Parameters
    ----------
    one : xarray.Dataset
        What `pounding_sweep.simulate` returned. Contacts are short: smaller steps (``output_step``) draw rounder loops.
    start, end : float, optional
        Part of the record that is drawn (s); all of it by default.
    ax : matplotlib.axes.Axes, optional
        Axes for a row of one pair.
    """
    part = time_slice(one, start, end)
    pairs = one.pair.values.tolist()
    figure, axes = subplots(1, len(pairs), (1.4 + 3.2 * len(pairs), 3.8), ax, styles=DASHED)
    for panel, pair in zip(axes[0], pairs, strict=True):
        for storey in one.storey.values:
            here = part.sel(pair=pair, storey=storey)
            near = np.convolve(here.penetration > 0.0, [1, 1, 1], "same") > 0  # with an instant apart on each side
            words = f"storey {storey}" if near.any() else ""
            loops = 1e3 * here.penetration.where(near), here.contact_force.where(near)
            panel.plot(*loops, label=words, linewidth=1.0, visible=near.any())
        if (part.penetration.sel(pair=pair) > 0.0).any():
            panel.legend(loc="upper left", fontsize=8)
        _say_no_contact(panel)
        panel.set_title(f"pair {pair}")
    return finish(figure, axes, "penetration (mm)", ["contact force (kN)"], scenario_title(one), legend=0)


@figure_of(
    "hysteresis",
    "histories",
    "storey shear against drift of the storeys that yield, from 'simulate'",
    "time, storey_drift, storey_shear, plastic_drift",
)
def hysteresis(one: xr.Dataset) -> Figure:
    """Draw the hysteresis loops of each building's storeys."""
    names = one.building.values.tolist()
    figure, axes = subplots(1, len(names), (1.0 + 3.1 * len(names), 3.9), sharey=True)
    for ax, building in zip(axes[0], names, strict=True):
        here = one.sel(building=building).dropna("storey", how="all", subset=["storey_drift"])
        largest = np.argsort(-np.abs(here.storey_drift).max("time").values)[:_STOREYS]
        for number in sorted(largest.tolist(), reverse=True):  # the lowest storey is drawn last
            part = here.isel(storey=number)
            label = f"storey {int(part.storey)}{'' if (part.plastic_drift != 0.0).any() else ', elastic'}"
            colour = COLOURS[number % len(COLOURS)]
            ax.plot(part.storey_drift * 1e3, part.storey_shear * 1e-3, color=colour, linewidth=0.7, label=label)
        ax.set_title(building)
        ax.legend(loc="upper left", fontsize=7, reverse=True)
    return finish(figure, axes, "drift (mm)", ["storey shear (MN)"], scenario_title(one), legend=0)


#: Width of a building in the drawing, and the largest sway drawn, in heights of the highest building.
_WIDTH, _SWAY = 0.5, 0.14
#: Largest gap drawn, and the thickness of a wall, in widths of a building.
_GAP, _WALL = 0.8, 0.2
#: Bending of a column between two floors that don't turn, along its height.
_ALONG = np.linspace(0.0, 1.0, 9)
_BENT = _ALONG**2 * (3.0 - 2.0 * _ALONG)


@figure_of(
    "row",
    "histories",
    "the row at the instant of its strongest impact, from 'simulate'",
    "several time, floor_elevation, displacement",
)
def row(one: xr.Dataset, *, ax: Any = None) -> Figure:
    """Draw the row at the instant of its strongest impact, or, without impacts, of its largest displacement.

    Parameters
    ----------
    one : xarray.Dataset
        What `pounding_sweep.simulate` returned.
    ax : matplotlib.axes.Axes, optional
        Axes to draw into.
    """
    stage, number = Stage(one), find_strongest(one)
    figure, _ = stage.draw(ax=ax)
    forces = contact_forces(one)[number]
    stage.show(number, forces / (forces.max(initial=0.0) or 1.0))
    largest = f", largest force {forces.max():.0f} kN" if forces.any() else ""
    when = f"{one.time.values[number]:.3f} s{largest}"
    return put_title(figure, scenario_title(one), when, f"displacements and gaps drawn {stage.factor:g} times")


def contact_forces(one: xr.Dataset) -> np.ndarray:
    """Contact forces (kN) that press, shape (times, pairs, storeys); zero where floors never meet."""
    if "contact_force" not in one:
        return np.zeros((one.sizes["time"], 0, one.sizes["storey"]))
    return np.maximum(one.contact_force.transpose("time", "pair", "storey").fillna(0.0).values, 0.0)


def find_strongest(one: xr.Dataset) -> int:
    """Return the instant of the largest contact force, or, if nothing touches, of the largest displacement."""
    forces = contact_forces(one)
    values = forces if forces.any() else abs(one.displacement).transpose("time", ...).fillna(0.0).values
    return int(values.reshape(len(values), -1).max(axis=1).argmax())


class Stage:
    """Where the members of a row stand in a drawing, buildings and walls."""

    def __init__(self, one: xr.Dataset) -> None:
        scene = stored_scene(one)
        self.names = one.building.values.tolist()
        self.heights = [z[np.isfinite(z)] for z in one.floor_elevation.transpose("building", "storey").values]
        self.top = max(z[-1] for z in self.heights)
        motion = one.displacement.transpose("time", "building", "storey").fillna(0.0).values
        gaps, moved = np.array(scene.gaps), float(np.abs(motion).max(initial=0.0))
        limits = [_SWAY * self.top / moved] if moved > 0 else []
        limits += [_GAP * _WIDTH * self.top / gaps.max()] if gaps.any() else []
        self.factor = round_down(min(limits, default=1.0))
        #: motion of each member's base and floors, and the turning of the bases of buildings, as they are drawn
        self.is_wall = np.array([isinstance(item, Wall) for item in scene.row])
        members = [item.name for item in scene.row]
        self.inside = [members.index(name) for name in self.names]
        self.moved = np.zeros((len(motion), len(self.is_wall), motion.shape[2] + 1))
        self.moved[:, self.inside, 1:] = self.factor * motion
        self.turned = np.zeros((len(motion), len(self.is_wall)))
        for name, part in (("foundation_sway", self.moved[..., 0]), ("foundation_rotation", self.turned)):
            if name in one:
                part[:, self.inside] = self.factor * one[name].transpose("time", "building").fillna(0.0).values
        width = np.where(self.is_wall, _WALL, 1.0) * _WIDTH * self.top
        #: faces of members at rest
        self.left = np.concatenate([[0.0], np.cumsum(width[:-1] + self.factor * gaps)])
        self.right = self.left + width
        none = np.zeros((0, one.sizes["storey"]))
        self.contact_height = one.contact_elevation.values if "contact_elevation" in one.coords else none
        self.contacts = {(contact.place, contact.storey - 1): contact for contact in scene.contacts}

    def draw(self, below: int = 0, ax: Any = None) -> tuple[Any, Any]:
        """Draw what does not move, and make what does; return the figure and its axes, `below` flat ones last."""
        margin = 1.2 * _SWAY * self.top
        low = min(self.left[self.inside[0]] - margin, self.left[0])
        high = max(self.right[self.inside[-1]] + margin, self.right[-1])
        tall = min(5.0, max(2.4, 7.2 * 0.85 * 1.15 * self.top / (high - low)))
        flat: Any = {"height_ratios": [tall, *[0.95] * below], "sharex": False}
        size = (7.2, tall + 0.9 + 0.95 * below)
        figure, axes = subplots(1 + below, 1, size, ax, **flat)
        ax = axes[0, 0]
        ax.set(xlim=(low, high), ylim=(-0.12 * self.top, 1.1 * self.top), aspect="equal", ylabel="elevation (m)")
        ax.grid(visible=False)
        ax.spines["bottom"].set_visible(False)
        ax.spines["left"].set_bounds(0.0, 1.1 * self.top)
        ax.set(xticks=[], yticks=[tick for tick in ax.get_yticks() if 0.0 <= tick <= 1.1 * self.top])
        ax.axhline(0.0, color="black", linewidth=1.2)
        for edges in zip(self.left[self.is_wall], self.right[self.is_wall], strict=True):
            ax.fill_between(edges, 0.0, 1.05 * self.top, facecolor="0.85", edgecolor="0.4", hatch="///")
        self.frames: list[Any] = []
        for number, (name, item) in enumerate(zip(self.names, self.inside, strict=True)):
            colour = COLOURS[number % len(COLOURS)]
            columns = ax.plot([], [], [], [], color=colour, linewidth=1.4)
            floors = ax.plot([], [], color=colour, linewidth=2.6, solid_capstyle="butt")
            self.frames.append((item, *columns, *floors))
            ax.text(0.5 * (self.left[item] + self.right[item]), -0.03 * self.top, name, ha="center", va="top")
        self.marks = ax.scatter([], [], marker="*", color=COLOURS[2], edgecolor="black", linewidth=0.5, zorder=5)
        return figure, axes[:, 0]

    def show(self, number: int, impacts: np.ndarray) -> None:
        """Move the row to instant `number`; `impacts` are the areas of the marks, 0 to 1, per pair and storey."""
        for (item, left, right, floors), z in zip(self.frames, self.heights, strict=True):
            at, height = self.moved[number, item, : len(z) + 1], np.concatenate([[0.0], z])
            rocked = self.turned[number, item] * np.diff(height)  # columns turn with the base, and bend by the rest
            bent = (np.diff(at) - rocked)[:, None] * _BENT + rocked[:, None] * _ALONG
            column = (at[:-1, None] + bent).ravel()
            up = (height[:-1, None] + np.diff(height)[:, None] * _ALONG).ravel()
            left.set_data(self.left[item] + column, up)
            right.set_data(self.right[item] + column, up)
            gap = np.full(len(z), np.nan)  # floors are separate lines
            floors.set_data(
                np.column_stack([self.left[item] + at[1:], self.right[item] + at[1:], gap]).ravel(), np.repeat(z, 3)
            )
        offsets, sizes = [], []
        for pair, storey in np.argwhere(impacts > 0.0).tolist():
            contact = self.contacts[pair, storey]  # at the floor that strikes columns, else at the left floor or wall
            face, item = (self.left, contact.pair + 1) if contact.struck == 0 else (self.right, contact.pair)
            offsets.append((face[item] + self.moved[number, item, storey + 1], self.contact_height[pair, storey]))
            sizes.append(60.0 + 400.0 * impacts[pair, storey])
        self.marks.set_offsets(np.reshape(offsets, (-1, 2)))
        self.marks.set_sizes(sizes)


def round_down(value: float) -> float:
    """Return the largest of 1, 2 or 5 times a power of ten that is not above a positive number."""
    power = 10.0 ** math.floor(math.log10(value))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= value * (1.0 + 1e-12))


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
        for strip in strips:
            strip.set_prop_cycle(DASHED)
            strip.plot(time[inside], forces[inside].max(axis=2), label=pairs, linewidth=1.0)
            strip.set_ylabel("force\n(kN)")
            legend_beside(strip)
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
    shown = time_slice(one, start, start + PERIODS * period if end is None else end).time.values
    return float(shown[0]), float(shown[-1])
