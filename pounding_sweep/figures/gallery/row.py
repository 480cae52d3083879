"""The row of buildings as it stands at one instant, impacts marked."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.analysis.rebuild import stored_scene
from pounding_sweep.figures import figure_of, one_instant
from pounding_sweep.figures.shown import heading
from pounding_sweep.figures.style import COLOURS, put_title
from pounding_sweep.model.scene import Wall

#: Width of a building in the drawing, and the largest sway drawn, in heights of the highest building.
_WIDTH, _SWAY = 0.5, 0.14
#: Largest gap drawn, in widths of a building.
_GAP = 0.8
_IMPACT = COLOURS[2]
#: Bending of a column between two floors that don't turn, along its height.
_ALONG = np.linspace(0.0, 1.0, 9)
_BENT = _ALONG**2 * (3.0 - 2.0 * _ALONG)


@figure_of(
    "histories",
    "the row at the instant of its strongest impact, from 'simulate'",
    needs=("time", "floor_elevation", "displacement"),
    also=one_instant,
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
    number = int(np.searchsorted(one.time.values, strongest(one)))
    stage = Stage(one)
    figure, panel = stage.figure() if ax is None else (ax, ax)
    stage.draw(panel)
    forces = forces_of(one)[number]
    stage.show(number, forces / forces.max(initial=0.0) if forces.any() else forces)
    largest = f", largest force {forces.max():.0f} kN" if forces.any() else ""
    when = f"{one.time.values[number]:.3f} s{largest}"
    put_title(figure, heading(one), when, f"displacements and gaps drawn {stage.factor:g} times")
    return figure


def forces_of(one: xr.Dataset) -> np.ndarray:
    """Contact forces (kN) that press, shape (times, pairs, storeys); zero where floors never meet."""
    if "contact_force" not in one:
        return np.zeros((one.sizes["time"], 0, one.sizes["storey"]))
    forces = one.contact_force.transpose("time", "pair", "storey").values
    return np.maximum(np.nan_to_num(forces), 0.0)


def strongest(one: xr.Dataset) -> float:
    """Time (s) of the largest contact force, or, where nothing touches, of the largest displacement."""
    forces = forces_of(one).reshape(one.sizes["time"], -1).max(axis=1, initial=0.0)
    if not forces.any():
        forces = np.nan_to_num(np.abs(one.displacement)).reshape(one.sizes["time"], -1).max(axis=1)
    return float(one.time.values[np.argmax(forces)])


class Stage:
    """Where everything of a row stands in a drawing."""

    def __init__(self, one: xr.Dataset) -> None:
        self.names = one.building.values.tolist()
        self.heights = [z[np.isfinite(z)] for z in one.floor_elevation.transpose("building", "storey").values]
        self.motion = one.displacement.transpose("time", "building", "storey").values
        bases = (one[name] for name in ("foundation_sway", "foundation_rotation") if name in one)
        self.bases = [base.transpose("time", "building").values for base in bases]
        self.top = max(z[-1] for z in self.heights)
        self.width = _WIDTH * self.top
        scene = stored_scene(one)
        gaps = np.array(scene.gaps)
        moved = float(np.nanmax(np.abs(self.motion), initial=0.0))
        limits = [_SWAY * self.top / moved] if moved > 0 else []
        limits += [_GAP * self.width / gaps.max()] if gaps.any() else []
        self.factor = _round_down(min(limits, default=1.0))
        self.walls = isinstance(scene.row[0], Wall), isinstance(scene.row[-1], Wall)
        first = 1 if self.walls[0] else 0
        self.left = np.zeros(len(self.names))  # left faces at rest, the first building's at 0
        for i in range(1, len(self.names)):
            self.left[i] = self.left[i - 1] + self.width + self.factor * gaps[i - 1 + first]
        right = self.left[-1] + self.width
        self.wall_faces = (
            -self.factor * gaps[0] if self.walls[0] else None,
            right + self.factor * gaps[-1] if self.walls[1] else None,
        )
        margin = 1.2 * _SWAY * self.top
        low, high = -margin, right + margin
        if self.wall_faces[0] is not None:
            low = min(low, self.wall_faces[0] - 0.2 * self.width)
        if self.wall_faces[1] is not None:
            high = max(high, self.wall_faces[1] + 0.2 * self.width)
        self.limits = (low, high)
        none = np.zeros((0, one.sizes["storey"]))
        self.contact_height = one.contact_elevation.values if "contact_elevation" in one.coords else none
        self.contacts = {(contact.place, contact.storey - 1): contact for contact in scene.contacts}
        self.first = first

    def figure(self, below: int = 0) -> tuple[Figure, Any]:
        """Return a figure of fitting size and its axes: one for the row, and `below` flat ones under it."""
        width = 7.2
        tall = min(5.0, max(2.4, width * 0.85 * 1.15 * self.top / (self.limits[1] - self.limits[0])))
        figure = Figure(figsize=(width, tall + 0.9 + 0.95 * below), layout="constrained")
        axes = figure.subplots(1 + below, 1, height_ratios=[tall, *[0.95] * below], squeeze=False)[:, 0]
        return figure, axes if below else axes[0]

    def draw(self, ax: Any) -> None:
        """Draw what does not move, and make what does."""
        ax.set(xlim=self.limits, ylim=(-0.12 * self.top, 1.1 * self.top), aspect="equal")
        ax.set_xticks([])
        ax.set_ylabel("elevation (m)")
        ax.grid(visible=False)
        ax.spines["bottom"].set_visible(False)
        ax.spines["left"].set_bounds(0.0, 1.1 * self.top)
        ax.set_yticks([tick for tick in ax.get_yticks() if 0.0 <= tick <= 1.1 * self.top])
        ax.axhline(0.0, color="black", linewidth=1.2)
        for face, side in zip(self.wall_faces, (-1.0, 1.0), strict=True):
            if face is not None:
                edges = sorted((face, face + side * 0.2 * self.width))
                ax.fill_between(edges, 0.0, 1.05 * self.top, facecolor="0.85", edgecolor="0.4", hatch="///")
        self._frames: list[Any] = []
        for number, name in enumerate(self.names):
            colour = COLOURS[number % len(COLOURS)]
            columns = [ax.plot([], [], color=colour, linewidth=1.4)[0] for _ in range(2)]
            floors = ax.plot([], [], color=colour, linewidth=2.6, solid_capstyle="butt")[0]
            self._frames.append((*columns, floors))
            ax.text(self.left[number] + 0.5 * self.width, -0.03 * self.top, name, ha="center", va="top")
        self._marks = ax.scatter([], [], marker="*", color=_IMPACT, edgecolor="black", linewidth=0.5, zorder=5)

    def show(self, number: int, impacts: np.ndarray) -> None:
        """Move the row to instant `number`; `impacts` are the areas of the marks, 0 to 1, per pair and storey."""
        sway = self.factor * np.nan_to_num(self.motion[number])
        bases = [self.factor * np.nan_to_num(base[number]) for base in self.bases] or np.zeros((2, len(sway)))
        for (left, right, floors), z, x0, u, *base in zip(
            self._frames, self.heights, self.left, sway, *bases, strict=True
        ):
            at, height = np.concatenate([[base[0]], u[: len(z)]]), np.concatenate([[0.0], z])
            rocked = base[1] * np.diff(height)  # columns turn with the base, and bend by the rest
            bent = (np.diff(at) - rocked)[:, None] * _BENT + rocked[:, None] * _ALONG
            column = (at[:-1, None] + bent).ravel()
            up = (height[:-1, None] + np.diff(height)[:, None] * _ALONG).ravel()
            left.set_data(x0 + column, up)
            right.set_data(x0 + self.width + column, up)
            gap = np.full(len(z), np.nan)  # floors are separate lines
            x = np.column_stack([x0 + at[1:], x0 + self.width + at[1:], gap]).ravel()
            floors.set_data(x, np.repeat(z, 3))
        marked = [(int(pair), int(storey)) for pair, storey in zip(*np.nonzero(impacts > 0.0), strict=True)]
        places = [(self._face(pair, storey, sway), self.contact_height[pair, storey]) for pair, storey in marked]
        self._marks.set_offsets(np.array(places).reshape(-1, 2))
        self._marks.set_sizes([60.0 + 400.0 * impacts[where] for where in marked])

    def _face(self, pair: int, storey: int, sway: np.ndarray) -> float:
        """Face of a contact: of the left building's floor, of a wall, or of the floor that strikes its columns."""
        contact = self.contacts[pair, storey]
        building = contact.pair - self.first
        if building < 0:
            assert self.wall_faces[0] is not None
            return float(self.wall_faces[0])
        if contact.struck == 0:
            return float(self.left[building + 1] + sway[building + 1, storey])
        return float(self.left[building] + self.width + sway[building, storey])


def _round_down(value: float) -> float:
    """Return the largest of 1, 2 or 5 times a power of ten that is not above a positive number."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (5.0, 2.0, 1.0) if step * power <= value * (1.0 + 1e-12))
