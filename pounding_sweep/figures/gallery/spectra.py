"""Ground motions and spectra: acceleration histories, response spectra of records and of floors."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.analysis.spectra import floor_spectra
from pounding_sweep.base.errors import InputError
from pounding_sweep.figures import figure_of
from pounding_sweep.figures.select import law_name, record_name, scenario_title
from pounding_sweep.figures.style import COLOURS, DASHED, NotebookFigure, put_title, subplots

#: More lines than this in one panel are drawn grey, with their median and fractiles.
MOST_LINES = len(COLOURS)
#: More histories than this in one column are too flat to be read.
_ROWS = 12
#: Label of a panel, and factor, of ordinates.
_ORDINATES = {
    "pseudo_acceleration": ("pseudo-acceleration (m/s²)", 1.0),
    "spectral_displacement": ("displacement (mm)", 1e3),
}


@figure_of("ground-motion", "spectra", "record, time, ground_acceleration, period, pseudo_acceleration, damping_ratio")
def ground_motion(motions: xr.Dataset) -> Figure:
    """Draw acceleration histories and response spectra of records, as 'records plot' draws them."""
    n = motions.sizes["record"]
    if not n:
        raise InputError("there is no record to draw; give at least one")
    columns = -(-n // _ROWS)
    rows = -(-n // columns)
    width = 4.6 if columns == 1 else 2.7 * columns
    figure = NotebookFigure(figsize=(width + 4.2, max(4.2, 0.6 + 0.95 * rows)), layout="constrained")
    halves: Any = figure.subfigures(1, 2, width_ratios=[width, 4.2])
    left, right = halves
    axes = left.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for number, ax in enumerate(axes.T.flat):
        if number >= n:
            ax.set_axis_off()
            continue
        motion = motions.isel(record=number)
        peak = motion.isel(point=int(abs(motion["ground_acceleration"]).argmax("point")))
        colour = COLOURS[number] if n <= MOST_LINES else COLOURS[0]
        ax.plot(motion["time"], motion["ground_acceleration"], linewidth=0.7, color=colour)
        ax.plot(peak["time"], peak["ground_acceleration"], "o", markersize=3.5, color=colour)
        words = f"{record_name(motion['record'].item())}: {abs(peak['ground_acceleration'].item()):.3g} m/s²"
        ax.set_title(words, loc="left", fontsize=7, pad=2)
        ax.tick_params(labelbottom=number in (n - 1, *range(rows - 1, n, rows)))
    limit = 1.3 * float(abs(motions["ground_acceleration"]).max() or 1.0)
    axes[0, 0].set(xlim=(0.0, float(motions["time"].max()) or 1.0), ylim=(-limit, limit))
    left.supxlabel("time (s)", fontsize=9)
    left.supylabel("ground acceleration (m/s²); dots: peaks", fontsize=9)
    ax = right.subplots()
    _draw_spectra(ax, motions["pseudo_acceleration"])
    title = f"response spectra, damping ratio {motions['damping_ratio'].item():g}"
    ax.set(xlabel="period (s)", ylabel=_ORDINATES["pseudo_acceleration"][0], ylim=(0.0, None), title=title)
    if n > 1:
        right.legend(loc="outside lower center", ncols=2)
    return figure


@figure_of("response-spectra", "spectra", "period, pseudo_acceleration, spectral_displacement")
def response_spectra(spectra: xr.Dataset) -> Figure:
    """Draw response or floor spectra: pseudo-acceleration and displacement against period."""
    title = [str(spectra.attrs.get("title", "Response spectra"))]
    for name in (name for name in ("record", "law") if name not in spectra.dims):
        key = str(spectra[name].item() if name in spectra.coords else spectra.attrs.get(name, ""))
        title.append(record_name(key) if name == "record" else law_name(spectra, key))
    if "damping_ratio" in spectra.coords and not spectra["damping_ratio"].ndim:
        title.append(f"damping ratio {spectra['damping_ratio'].item():g}")
    return _draw_both(spectra, *title)


@figure_of("floor-spectra", "histories", "time, acceleration")
def floor_response(histories: xr.Dataset) -> Figure:
    """Draw 5 % response spectra of the floors' total accelerations, from 'simulate'."""
    return _draw_both(floor_spectra(histories), scenario_title(histories), "floor spectra, damping ratio 0.05")


def _draw_both(spectra: xr.Dataset, *title: str) -> Figure:
    """Draw pseudo-acceleration above displacement, in a column for each building that there is."""
    buildings = spectra["building"].values.tolist() if "building" in spectra.dims else [""]
    figure, axes = subplots(2, len(buildings), (2.6, 3.4, 5.6, 0.0))
    entries: dict[str, Any] = {}
    for column, building in enumerate(buildings):
        part = spectra.sel(building=building) if building else spectra
        for ax, (name, (label, factor)) in zip(axes[:, column], _ORDINATES.items(), strict=True):
            _draw_spectra(ax, part[name] * factor)
            ax.set_ylabel(label * (column == 0))
            entries |= {label: handle for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
        axes[0, column].set_title(building)
        axes[1, column].set_xlabel("period (s)")
    for ax in axes[:, 0]:
        ax.set_ylim(bottom=0.0)
    if len(entries) > 1:
        columns = min(2 * len(buildings), len(entries))
        figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=columns)
    return put_title(figure, *title)


def _draw_spectra(ax: Any, values: xr.DataArray) -> None:
    """Draw one ordinate on ``period``, a line of finite numbers for each place along its other dimensions."""
    dims = [str(dim) for dim in values.dims if dim != "period"]
    named = [dim for dim in dims if values.sizes[dim] > 1 or len(dims) == 1]
    lines: dict[str, np.ndarray] = {}
    for line in values.expand_dims("line").stack(lines=["line", *dims]).transpose("lines", "period").dropna("lines"):
        labels = {dim.replace("_", " "): line[dim].item() for dim in named}  # a text alone, a number with its name
        words = [record_name(text) if isinstance(text, str) else f"{dim} {text:g}" for dim, text in labels.items()]
        lines[", ".join(words)] = line.values
    if not lines:
        raise InputError("there is no spectrum to draw: none holds finite numbers")
    periods = values["period"].values
    if len(lines) > MOST_LINES:
        curves = np.array([*lines.values()])
        ax.plot(periods, curves.T, color="0.75", linewidth=0.6)
        for share, dashes in ((0.84, ":"), (0.5, "-"), (0.16, "--")):
            name = "median" if share == 0.5 else f"{share:.0%} fractile"
            ax.plot(periods, np.quantile(curves, share, axis=0), color=COLOURS[0], linestyle=dashes, label=name)
    else:
        for (name, curve), style in zip(lines.items(), DASHED, strict=False):
            ax.plot(periods, curve, label=name, **style)
    even = periods.size < 3 or np.allclose(np.diff(periods), periods[1] - periods[0])
    if not even:
        ax.set_xscale("log")
        ax.xaxis.set_major_formatter("{x:g}")
    positive = periods[periods > 0]
    if positive.size > 1:
        ax.set_xlim(0.0 if even else positive.min(), positive.max())
