"""The row of buildings as it stands at one instant, impacts marked."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.analysis.rebuild import stored_scene
from pounding_sweep.figures import figure_of
from pounding_sweep.figures.select import scenario_title
from pounding_sweep.figures.style import COLOURS, put_title, subplots
from pounding_sweep.model.scene import Wall

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
    *("several time", "floor_elevation", "displacement"),
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
    put_title(figure, scenario_title(one), when, f"displacements and gaps drawn {stage.factor:g} times")
    return figure


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
