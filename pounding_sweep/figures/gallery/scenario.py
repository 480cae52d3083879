"""Figures of one scenario: histories against time and against each other, and the row at an instant and in motion."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from itertools import cycle, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.animation import FFMpegWriter, PillowWriter
from matplotlib.figure import Figure

from pounding_sweep.analysis.rebuild import stored_scene
from pounding_sweep.base.errors import InputError, OutputError
from pounding_sweep.base.files import FilePath
from pounding_sweep.figures import figure_of, require
from pounding_sweep.figures.select import drawn_unit, panels, scenario_title, time_slice
from pounding_sweep.figures.style import (
    COLOURS,
    DASHED,
    MARKED,
    finish,
    in_style,
    join_nonempty,
    legend_beside,
    put_title,
    subplots,
)
from pounding_sweep.model.scene import Scene, Wall
from pounding_sweep.run.cyclic import cyclic_test

#: Histories that are drawn against time, and the peaks that are reported of them.
_PEAKS = {"displacement": ("displacement_max", "displacement_min"), "contact_force": ("impact_force_max",)}


@figure_of("histories", "histories", "several time, ground_acceleration, displacement")
def histories(one: xr.Dataset, *, start: float | None = None, end: float | None = None) -> Figure:
    """Draw ground acceleration, floor displacements and contact forces against time, peaks marked, from 'simulate'.

    Circles are the peaks that are reported, located between the instants of the histories, at the instant next to them.
    """
    part = time_slice(one, start, end)
    pairs = one.pair.values.tolist() if "contact_force" in one else []
    axes = subplots(2 + len(pairs), 1, (7.2, 0.0, 1.4, 1.5), sharey=False, styles=DASHED)
    ground, top, *contacts = axes[:, 0]
    ground.set_xlim(part.time[0], part.time[-1])
    ground.plot(part.time, part.ground_acceleration, color="black", linewidth=0.7)
    lines = [
        (top, "displacement", building, _top_floor(one.sel(building=building))) for building in one.building.values
    ]
    for panel, pair in zip(contacts, pairs, strict=True):
        places = (one.sel(pair=pair, storey=storey) for storey in one.storey.values)
        lines += [(panel, "contact_force", f"storey {place.storey:d}", place) for place in places]
    for panel, name, label, place in lines:
        line = drawn_unit(one[name].attrs)[1] * place.fillna(0.0)
        values = line[name].sel(time=part.time)
        moves = bool(values.any())
        (curve,) = panel.plot(part.time, values, label=label * moves, linewidth=1.0, visible=moves)
        for peak in _PEAKS[name] if moves else ():
            at = line[name].idxmin() if peak == "displacement_min" else line[name].idxmax()
            if peak in place and part.time[0] <= at <= part.time[-1]:
                panel.plot(at, line[peak], "o", color=curve.get_color(), markerfacecolor="none", markersize=6)
    for panel in contacts[1:]:
        panel.sharey(contacts[0])
    for panel in (top, *contacts):
        legend_beside(panel)
    for panel in contacts:
        _say_no_contact(panel)
    if pairs and not (part.contact_force < 0.0).any():
        contacts[0].set_ylim(bottom=0.0)
    labels = ["ground acc. (m/s²)", "top floor (mm)", *(f"{pair}\nforce (kN)" for pair in pairs)]
    return finish(axes, "time (s)", labels, scenario_title(one), legend=0)


def _top_floor(building: xr.Dataset) -> xr.Dataset:
    """Return the highest storey that a building has."""
    return building.dropna("storey", how="all", subset=["displacement"]).isel(storey=-1)


def _say_no_contact(ax: Any) -> None:
    """Write into a panel without lines why there are none."""
    if not any(line.get_visible() for line in ax.lines):
        ax.text(0.5, 0.5, "no contact", transform=ax.transAxes, ha="center", va="center", color="0.35")


@figure_of("closing", "histories", "several time, pair, displacement")
def closing(one: xr.Dataset, *, start: float | None = None, end: float | None = None, ax: Any = None) -> Figure:
    """Draw the relative displacement of floors that can meet, beside their gap, onsets marked, from 'simulate'.

    It is the displacement of each left floor less that of the right one: they touch where it reaches the gap.
    Circles mark the onsets of contact that the histories show. Where there are bumpers, floors touch their
    thickness earlier.
    """
    part = time_slice(one, start, end)
    scene, time = stored_scene(one), part.time.values
    floors = 1e3 * part.displacement.stack(floor=("building", "storey")).dropna("floor", how="all").values
    axes = subplots(len(scene.gaps), 1, (7.2, 0.0, 1.2, 2.0), ax, styles=DASHED)
    for number, (panel, gap) in enumerate(zip(axes[:, 0], 1e3 * np.array(scene.gaps), strict=True)):
        faces = {gap}
        for contact, thickness in zip(scene.contacts, scene.thicknesses(), strict=True):
            if contact.pair != number or contact.restrainer:
                continue
            relative = sum(share * floors[:, floor] for floor, share in contact.ends)
            label = f"storey {contact.storey}{' and columns' if contact.struck >= 0 else ''}"
            (curve,) = panel.plot(time, relative, label=label, linewidth=1.0)
            face = gap - 1e3 * thickness
            onsets = time[1:][np.diff(np.int8(relative > face)) > 0]
            ring: Any = {"color": curve.get_color(), "markerfacecolor": "white", "markersize": 5, "zorder": 3}
            panel.plot(onsets, np.full(len(onsets), face), "o", **ring)
            faces.add(face)
        for face in sorted(faces, reverse=True):
            words, dashes = ("gap", "-") if face == gap else ("bumpers", "--")
            panel.axhline(face, color="0.4", linewidth=1.6, linestyle=dashes, label=words)
        panel.axhspan(gap, max(gap, panel.get_ylim()[1]), color="0.9", linewidth=0.0, zorder=0)
        legend_beside(panel)
    axes[0, 0].set_xlim(time[0], time[-1])
    labels = [f"{pair}\nrelative displacement (mm)" for pair in scene.pair_names]
    return finish(axes, "time (s)", labels, scenario_title(one), legend=0)


@figure_of("phase", "histories", "several time, displacement, velocity")
def phase(one: xr.Dataset, *, start: float | None = None, end: float | None = None, ax: Any = None) -> Figure:
    """Draw velocity against displacement of the top floors, in contact and out of it, from 'simulate'.

    In contact lines are bold.
    """
    part, scene = time_slice(one, start, end), stored_scene(one)
    members = [item.name for item in scene.row]
    axes = subplots(1, one.sizes["building"], (1.4, 2.6, 3.6, 0.0), ax)
    for panel, building in panels(axes[0], part, "building"):
        top = _top_floor(building)
        panel.plot(1e3 * top.displacement, top.velocity, color="0.55", linewidth=0.7, label="apart")
        if "contact_force" in part:
            right = members.index(building.building.item())  # number of the pair on its right
            pairs = sorted({contact.place for contact in scene.contacts if contact.pair in (right - 1, right)})
            touches = (abs(part.contact_force.isel(pair=pairs)) > 0.0).any(["pair", "storey"])
            bold = {"color": COLOURS[2], "linewidth": 1.8, "label": "in contact"}
            panel.plot(1e3 * top.displacement.where(touches), top.velocity.where(touches), **bold)
    axes[0, 0].legend(loc="upper left", fontsize=8)
    return finish(axes, "top floor displacement (mm)", "velocity (m/s)", scenario_title(one), legend=0)


@figure_of("force-penetration", "histories", "several time, contact_force, penetration")
def force_penetration(
    one: xr.Dataset, *, start: float | None = None, end: float | None = None, ax: Any = None
) -> Figure:
    """Draw contact force against penetration, pair by pair, from 'simulate'.

    There is one loop per impact, whose area is the energy it took; where the force jumps at a touch the line is
    upright. Contacts are short: smaller steps of the histories (``output_step``) draw rounder loops.
    """
    part = time_slice(one, start, end)
    axes = subplots(1, one.sizes["pair"], (1.4, 3.2, 3.8, 0.0), ax, styles=DASHED)
    for panel, pair in panels(axes[0], part, "pair"):
        for storey in pair.storey.values:
            depth, force = _loops(*(pair[name].sel(storey=storey).values for name in ("penetration", "contact_force")))
            label = f"storey {storey}" if len(depth) else ""
            panel.plot(1e3 * depth, force, label=label, linewidth=1.0, visible=bool(label))
        if panel.get_legend_handles_labels()[1]:
            panel.legend(loc="upper left", fontsize=8)
        _say_no_contact(panel)
    return finish(axes, "penetration (mm)", "contact force (kN)", scenario_title(one), legend=0)


def _loops(depth: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Return penetration and force of each contact, NaN between them; from no force and back, upright at a jump."""
    parts, bounds = [np.empty((2, 0))], np.flatnonzero(np.diff(np.concatenate([[False], depth > 0.0, [False]])))
    for start, end in bounds.reshape(-1, 2).tolist():
        d, f, limits = depth[start:end], force[start:end], []
        for i, j in ((0, 1), (-1, -2)):  # on the line through the two instants next to each touch, if of their sign
            slope = (f[j] - f[i]) / (d[j] - d[i]) if len(d) > 1 and d[j] > d[i] else f[i] / d[i]
            limits.append(max((f[i] - slope * d[i]) * np.sign(f[i]), 0.0) * np.sign(f[i]))
        parts.append(np.array([[0.0, 0.0, *d, 0.0, 0.0, np.nan], [0.0, limits[0], *f, limits[1], 0.0, np.nan]]))
    return np.concatenate(parts, axis=1)


@figure_of("hysteresis", "histories", "time, storey_drift, storey_shear, plastic_drift")
def hysteresis(one: xr.Dataset) -> Figure:
    """Draw storey shear against drift of the storeys that yield, with their backbones, from 'simulate'.

    Backbones, dashed, are what storeys resist that are pushed for the first time, as far as they moved.
    """
    scene = stored_scene(one)
    axes = subplots(1, one.sizes["building"], (1.0, 3.1, 3.9, 0.0), sharey=True)
    for ax, building in panels(axes[0], one, "building"):
        storeys = building.dropna("storey", how="all", subset=["storey_drift"])
        largest = np.argsort(-np.abs(storeys.storey_drift).max("time").values)[:4]
        for number in sorted(largest.tolist(), reverse=True):  # the lowest storey is drawn last
            storey = storeys.isel(storey=number)
            label = f"storey {int(storey.storey)}{'' if storey.plastic_drift.any() else ', elastic'}"
            colour = COLOURS[number % len(COLOURS)]
            reach = float(np.abs(storey.storey_drift).max())
            _draw_backbone(ax, scene, building.building.item(), int(storey.storey), reach, 1e3, 1e-3)
            ax.plot(storey.storey_drift * 1e3, storey.storey_shear * 1e-3, color=colour, linewidth=0.7, label=label)
        ax.set_title(building.building.item())
        ax.legend(loc="upper left", fontsize=7, reverse=True)
    return finish(axes, "drift (mm)", "storey shear (MN)", scenario_title(one), legend=0)


def _draw_backbone(ax: Any, scene: Scene, name: str, storey: int, reach: float, *factors: float) -> None:
    """Draw what a storey that may yield resists when it is pushed to a drift (m) to either side."""
    item = next(building for building in scene.buildings if building.name == name)
    if item.yields[storey - 1]:
        away = np.linspace(0.0, reach, 201)
        push = cyclic_test(item, np.array([-away, away]).T, storey)
        drift, shear = (np.concatenate([x[::-1, 0], x[1:, 1]]) for x in (push.drift.values, push.shear.values))
        label = "" if "backbone" in ax.get_legend_handles_labels()[1] else "backbone"
        style: Any = {"color": COLOURS[5], "linewidth": 1.2, "linestyle": "--", "zorder": 3}
        ax.plot(factors[0] * drift, factors[1] * shear, label=label, **style)


@figure_of("loops", "test", "point, drift, shear")
def loops(test: xr.Dataset, *, ax: Any = None) -> Figure:
    """Draw the loops of a storey under imposed drifts, and its backbone, dashed."""
    scene, name, storey = stored_scene(test), test.attrs["building"], int(test.attrs["storey"])
    axes = subplots(1, 1, (4.6, 0.0, 3.6, 0.0), ax)
    axes[0, 0].plot(1e3 * test.drift, test.shear, color=COLOURS[1], linewidth=0.8, label="loops")
    _draw_backbone(axes[0, 0], scene, name, storey, float(np.abs(test.drift).max()), 1e3, 1.0)
    axes[0, 0].legend(loc="upper left", fontsize=8)
    subject = f"{name}, storey {storey}; {float(test.energy.max()):.3g} kN m dissipated"
    return finish(axes, "drift (mm)", "storey shear (kN)", subject, legend=0)


@figure_of("pushover", "pushover", "drift, shear, corner_drift, corner_shear")
def pushover(curve: xr.Dataset, *, ax: Any = None) -> Figure:
    """Draw the pushover curve of a storey, and the backbone that is fitted to it."""
    axes = subplots(1, 1, (4.6, 0.0, 3.6, 0.0), ax)
    axes[0, 0].plot(1e3 * curve.drift, curve.shear, color=COLOURS[1], label="pushover")
    axes[0, 0].plot(1e3 * curve.corner_drift, curve.corner_shear, "o--", color=COLOURS[2], label="backbone")
    axes[0, 0].legend(loc="best", fontsize=8)
    return finish(axes, "drift (mm)", "storey shear (kN)", "Backbone of a pushover curve", legend=0)


#: Width of a building in the drawing, and the largest sway drawn, in heights of the highest building.
_WIDTH, _SWAY = 0.5, 0.14
#: Largest gap drawn, and the thickness of a wall, in widths of a building.
_GAP, _WALL = 0.8, 0.2
#: Modes of a building that are drawn.
_MODES = 3


@figure_of("modes", "cube", "floor_elevation")
def modes(cube: xr.Dataset) -> Figure:
    """Draw the first mode shapes of each building over its height, with their periods.

    They are those of the row without factors of axes, on a fixed base, and 1 where they are largest.
    """
    scene = stored_scene(cube)
    axes = subplots(1, len(scene.buildings), (1.0, 2.4, 3.6, 0.0), sharex=True, sharey=True)
    for panel, item in zip(axes[0], scene.buildings, strict=True):
        fixed = item.on_fixed_base
        shapes = np.pad(fixed.modes[1][:, :_MODES], ((1, 0), (0, 0)))  # from the ground up
        largest = np.take_along_axis(shapes, abs(shapes).argmax(axis=0, keepdims=True), axis=0)
        for number, (shape, style) in enumerate(zip((shapes / largest).T, MARKED, strict=False), 1):
            panel.plot(shape, np.append(0.0, item.elevations), label=f"mode {number}", **style)
        panel.axvline(0.0, color="0.6", linewidth=0.8, zorder=0)
        panel.set_title(f"{item.name}\n{', '.join(f'{period:.3g}' for period in fixed.periods[:_MODES])} s")
    axes[0, 0].set_ylim(bottom=0)
    return finish(axes, "mode shape (1)", "height (m)", "Mode shapes and periods")


#: Bending of a column between two floors that don't turn, along its height.
_ALONG = np.linspace(0.0, 1.0, 9)
_BENT = _ALONG**2 * (3.0 - 2.0 * _ALONG)


@figure_of("row", "histories", "several time, floor_elevation, displacement")
def row(one: xr.Dataset, *, ax: Any = None) -> Figure:
    """Draw the row at the instant of its strongest impact, from 'simulate'.

    Without impacts it is that of its largest displacement.
    """
    number = find_strongest(one)
    axes, factor, show = draw_row(one, ax=ax)
    forces = contact_forces(one)[number]
    show(number, forces / (forces.max(initial=0.0) or 1.0))
    largest = f", largest force {forces.max():.0f} kN" if forces.any() else ""
    when = f"{one.time.values[number]:.3f} s{largest}"
    axes[0, 0].set_xlabel(f"displacements and gaps drawn {factor:g} times")
    return put_title(axes, join_nonempty(scenario_title(one), when))


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


def draw_at_rest(cube: xr.Dataset) -> Figure:
    """Draw the row of a cube at rest, with its masses (t), stiffnesses (kN/m) and gaps (mm)."""
    still = xr.zeros_like(cube["floor_elevation"], float).expand_dims(time=[0.0])
    one = cube.drop_vars([*cube.data_vars]).assign(displacement=still)
    with in_style():
        axes, factor, show = draw_row(one, numbers=True)
        show(0, np.zeros((0, 0)))
        axes[0, 0].set_xlabel(f"gaps drawn {factor:g} times; masses (t) at floors, stiffnesses (kN/m) of storeys")
        return put_title(axes, "The row at rest")


def draw_row(
    one: xr.Dataset, below: int = 0, ax: Any = None, *, numbers: bool = False
) -> tuple[Any, float, Callable[[int, np.ndarray], None]]:
    """Draw a row; return panels, the factor on its motion, and what moves it to an instant, marks of areas 0 to 1."""
    scene = stored_scene(one)
    is_wall = np.array([isinstance(item, Wall) for item in scene.row])
    still = xr.zeros_like(one.displacement.isel(storey=0, drop=True).reset_coords(drop=True))
    motion = {name: one.get(name, still) for name in ("displacement", "foundation_sway", "foundation_rotation")}
    row = xr.Dataset(motion).reindex(building=[item.name for item in scene.row])  # walls do not move
    row = row.transpose("time", "building", "storey")
    heights = [np.append(0.0, z[np.isfinite(z)]) for z in row.floor_elevation.values]
    top = max(z[-1] for z in heights)
    row, gaps = row.fillna(0.0), np.array(scene.gaps)
    limits = {_SWAY: float(abs(row.displacement).max()), _GAP * _WIDTH: gaps.max(initial=0.0)}
    largest = min((share * top / value for share, value in limits.items() if value > 0.0), default=1.0)
    power = 10.0 ** math.floor(math.log10(largest))
    factor = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= largest * (1.0 + 1e-12))
    # motion of each member's base and floors, and the turning of bases, as they are drawn
    moved = factor * np.concatenate([row.foundation_sway.values[..., None], row.displacement.values], axis=2)
    turned = factor * row.foundation_rotation.values
    width = np.where(is_wall, _WALL, 1.0) * _WIDTH * top
    left = np.append(0.0, np.cumsum(width[:-1] + factor * gaps))  # faces of members at rest
    right = left + width
    sway = np.where(is_wall, 0.0, 1.2 * _SWAY * top)
    low, high = (left - sway).min(), (right + sway).max()
    tall = min(5.0, max(2.4, 7.2 * 0.85 * 1.15 * top / (high - low)))
    flat: Any = {"height_ratios": [tall, *[0.95] * below], "sharex": False}
    axes = subplots(1 + below, 1, (7.2, 0.0, tall - 0.05, 0.95), ax, **flat)
    ax = axes[0, 0]
    ax.set(xlim=(low, high), ylim=(-0.12 * top, 1.1 * top), aspect="equal", ylabel="elevation (m)")
    ax.grid(visible=False)
    ax.spines["bottom"].set_visible(False)
    ax.spines["left"].set_bounds(0.0, 1.1 * top)
    ax.set(xticks=[], yticks=[tick for tick in ax.get_yticks() if 0.0 <= tick <= 1.1 * top])
    ax.axhline(0.0, color="black", linewidth=1.2)
    lines, colours = [], cycle(COLOURS)
    for number, item in enumerate(scene.row):
        edges = left[number], right[number]
        if isinstance(item, Wall):
            met = [c for c in scene.contacts if c.pair in (number - 1, number)]
            wall = max((one.contact_elevation.values[c.place, c.storey - 1] for c in met), default=top)
            ax.fill_between(edges, 0.0, wall, facecolor="0.85", edgecolor="0.4", hatch="///")
            continue
        colour = next(colours)
        columns = ax.plot([], [], [], [], color=colour, linewidth=1.4)
        floors = ax.plot([], [], color=colour, linewidth=2.6, solid_capstyle="butt")
        lines.append((number, *columns, *floors))
        ax.text(sum(edges) / 2.0, -0.03 * top, item.name, ha="center", va="top")
        floors_at = zip(pairwise(heights[number]), item.masses, item.storey_stiffnesses, strict=True) if numbers else ()
        for (low_end, high_end), mass, stiffness in floors_at:
            words: Any = {"x": sum(edges) / 2.0, "ha": "center", "fontsize": 7}
            ax.text(y=high_end - 0.01 * top, s=f"{mass:.4g}", va="top", **words)
            if np.isfinite(stiffness):  # of a building by its matrix no storey has one
                ax.text(y=0.5 * (low_end + high_end), s=f"{stiffness:.4g}", va="center", color="0.35", **words)
    for pair, gap in enumerate(scene.gaps if numbers else ()):
        middle = 0.5 * (right[pair] + left[pair + 1])
        ax.text(middle, 1.02 * top, f"{1e3 * gap:.4g} mm", ha="center", va="bottom", fontsize=7)
    marks = ax.scatter([], [], marker="*", color=COLOURS[2], edgecolor="black", linewidth=0.5, zorder=5)
    contacts = {(contact.place, contact.storey - 1): contact for contact in scene.contacts}

    def show(instant: int, impacts: np.ndarray) -> None:
        for number, left_column, right_column, floors in lines:
            z = heights[number]
            at, step = moved[instant, number, : len(z)], np.diff(z)[:, None]
            rocked = turned[instant, number] * step  # columns turn with the base, and bend by the rest
            bent = (np.diff(at)[:, None] - rocked) * _BENT + rocked * _ALONG
            x, y = (at[:-1, None] + bent).ravel(), (z[:-1, None] + step * _ALONG).ravel()
            left_column.set_data(left[number] + x, y)
            right_column.set_data(right[number] + x, y)
            ends = np.column_stack([left[number] + at[1:], right[number] + at[1:], np.full(len(step), np.nan)])
            floors.set_data(ends.ravel(), np.repeat(z[1:], 3))  # separate lines
        offsets = []
        for pair, storey in np.argwhere(impacts > 0.0).tolist():
            contact = contacts[pair, storey]  # at the floor that strikes columns, else at the left floor or wall
            face, number = (left, contact.pair + 1) if contact.struck == 0 else (right, contact.pair)
            height = one.contact_elevation.isel(pair=pair, storey=storey).item()
            offsets.append((face[number] + moved[instant, number, storey + 1], height))
        marks.set_offsets(np.reshape(offsets, (-1, 2)))
        marks.set_sizes(60.0 + 400.0 * impacts[impacts > 0.0])

    return axes, factor, show


def animate(
    one: xr.Dataset,
    path: FilePath,
    *,
    start: float | None = None,
    end: float | None = None,
    frames: int = 40,
    speed: float | None = None,
) -> Path:
    """Write an animation of the row.

    Displacements and gaps are drawn larger than they are, by the factor below them. A star marks each impact since
    the frame before, its area the force, and fades. Below run ground acceleration and largest force of each pair.

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
    >>> import tempfile
    >>> import pounding_sweep as ps
    >>> one = ps.simulate("mate2015", "el_centro", law="linear")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     animate(one, f"{folder}/row.gif", frames=4).name
    'row.gif'
    """
    target = Path(path)
    check_movie(target, frames, speed)
    require(one, "row")
    time, forces = one.time.values, contact_forces(one)
    moved, rate = (float(np.square(one[name]).mean()) for name in ("displacement", "velocity"))
    length = 4.0 * 2.0 * np.pi * np.sqrt(moved / rate) if rate else time[-1] - time[0]  # four periods of all floors
    if start is None:
        start = time[find_strongest(one)] - 0.25 * length if end is None else end - length
    part = time_slice(one, start, start + length if end is None else end)
    first, last = part.time.values[[0, -1]]
    instants = np.unique(np.searchsorted(time, np.linspace(first, last, frames)))
    forces_in_part = contact_forces(part)
    writer: Any = PillowWriter if target.suffix.lower() == ".gif" else FFMpegWriter
    writer = writer(fps=(frames - 1) / ((last - first) / speed) if speed else frames / 6.0)  # 6 s to watch
    with in_style():
        axes, factor, show = draw_row(one, below=2)
        _, ground, contacts = axes[:, 0]
        ground.plot(part.time, part.ground_acceleration, color="black", linewidth=0.8)
        ground.set_ylabel("ground\n(m/s²)")
        ground.tick_params(labelbottom=False)
        contacts.set_prop_cycle(DASHED)
        for pair, line in enumerate(forces_in_part.max(axis=2).T):
            contacts.plot(part.time, line, label=one.pair.values[pair], linewidth=1.0)
        contacts.set(xlabel="time (s)", ylabel="force\n(kN)")
        legend_beside(contacts)
        cursors = [strip.axvline(first, color=COLOURS[2], linewidth=1.0) for strip in (ground, contacts)]
        for strip in (ground, contacts):
            strip.set_xlim(first, last)
        axes[0, 0].set_xlabel(f"displacements and gaps drawn {factor:g} times")
        figure = put_title(axes, scenario_title(one))
        title = figure.get_suptitle()
        heading = figure.suptitle(f"{title}\n{first:.2f} s")
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # nothing moves from frame to frame but the row
        marks = fading_marks(forces / (forces_in_part.max(initial=0.0) or 1.0), instants)
        try:
            with writer.saving(figure, str(target), dpi=70):
                for number, areas in zip(instants.tolist(), marks, strict=True):
                    show(number, areas)
                    heading.set_text(f"{title}\n{time[number]:.2f} s")
                    for cursor in cursors:
                        cursor.set_xdata([time[number]] * 2)
                    writer.grab_frame()
        except (OSError, ValueError) as error:
            raise OutputError(f"can't write {str(target)!r} ({error}); give a file in a folder that exists") from error
    return target


def fading_marks(forces: np.ndarray, instants: np.ndarray) -> np.ndarray:
    """Return areas of marks in frames: the largest force since the frame before, fading as impacts are short."""
    starts = np.append(instants[0], instants[:-1] + 1)
    marks = np.maximum.reduceat(forces[: instants[-1] + 1], starts, axis=0)
    for before, now in pairwise(marks):
        np.maximum(now, np.where(before > 0.05, 0.6 * before, 0.0), out=now)
    return marks


def check_movie(path: FilePath, frames: int, speed: float | None) -> None:
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
