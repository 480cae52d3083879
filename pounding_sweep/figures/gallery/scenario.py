"""Histories of one scenario: ground, floors and contacts against time, and against each other."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.analysis.rebuild import stored_scene
from pounding_sweep.figures import figure_of
from pounding_sweep.figures.select import scenario_title, time_slice
from pounding_sweep.figures.style import COLOURS, DASHED, finish, legend_beside, put_title, subplots

#: Circles on lines.
_RING = {"marker": "o", "linestyle": "none"}
#: Panels in a row of loops, and storeys in a panel: those whose drifts are largest.
_COLUMNS, _STOREYS = 3, 4


@figure_of(
    "histories",
    "histories",
    "ground acceleration, floor displacements and contact forces against time, peaks marked, from 'simulate'",
    *("several time", "ground_acceleration", "displacement"),
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
        for storey in one.storey.values:
            here = one.sel(pair=pair, storey=storey)
            force = here.contact_force.fillna(0.0)
            rings = [(force, here.impact_force_max)] if "impact_force_max" in one else []
            _draw_history(panel, force.sel(time=part.time), f"storey {storey}", rings)
    for panel in axes[1:, 0]:
        legend_beside(panel)
    ends = [end for panel in contacts if (part.contact_force > 0.0).any() for end in panel.get_ylim()]
    for panel in contacts:
        panel.set_ylim(min(ends, default=0.0) if (part.contact_force < 0.0).any() else 0.0, max(ends, default=1.0))
        _say_no_contact(panel)
    labels = ["ground acc. (m/s²)", "top floor (mm)", *(f"{pair}\nforce (kN)" for pair in pairs)]
    finish(figure, axes, "time (s)", labels, scenario_title(one), legend=0)
    return figure


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
    *("several time", "pair", "displacement"),
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
    finish(figure, axes, "time (s)", labels, scenario_title(one), legend=0)
    return figure


@figure_of(
    "phase",
    "histories",
    "velocity against displacement of the top floors, in contact and out of it, from 'simulate'",
    *("several time", "displacement", "velocity"),
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
    finish(figure, axes, "top floor displacement (mm)", ["velocity (m/s)"], scenario_title(one), legend=0)
    return figure


@figure_of(
    "force-penetration",
    "histories",
    "contact force against penetration, pair by pair, from 'simulate'",
    *("several time", "contact_force", "penetration"),
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
    finish(figure, axes, "penetration (mm)", ["contact force (kN)"], scenario_title(one), legend=0)
    return figure


@figure_of(
    "hysteresis",
    "histories",
    "storey shear against drift of the storeys that yield, from 'simulate'",
    *("time", "storey_drift", "storey_shear", "plastic_drift"),
)
def hysteresis(one: xr.Dataset) -> Figure:
    """Draw the hysteresis loops of each building's storeys."""
    names = one.building.values.tolist()
    columns = min(_COLUMNS, len(names))
    rows = -(-len(names) // columns)
    figure, axes = subplots(rows, columns, (1.0 + 3.1 * columns, 0.9 + 3.0 * rows), sharey=True)
    for ax, building in zip(axes.flat, names, strict=False):
        here = one.sel(building=building).dropna("storey", how="all", subset=["storey_drift"])
        largest = np.argsort(-np.abs(here.storey_drift).max("time").values)[:_STOREYS]
        for number in sorted(largest.tolist(), reverse=True):  # the lowest storey is drawn last
            part = here.isel(storey=number)
            label = f"storey {int(part.storey)}{'' if (part.plastic_drift != 0.0).any() else ', elastic'}"
            colour = COLOURS[number % len(COLOURS)]
            ax.plot(part.storey_drift * 1e3, part.storey_shear * 1e-3, color=colour, linewidth=0.7, label=label)
        ax.set_title(building)
        ax.legend(loc="upper left", fontsize=7, reverse=True)
    for ax in axes.flat[len(names) :]:
        ax.remove()
    for ax in figure.axes[-columns:]:
        ax.set_xlabel("drift (mm)")
        ax.tick_params(labelbottom=True)
    for ax in axes[:, 0]:
        ax.set_ylabel("storey shear (MN)")
    put_title(figure, scenario_title(one))
    return figure
