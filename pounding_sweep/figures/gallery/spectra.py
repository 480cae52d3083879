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
from pounding_sweep.figures.style import COLOURS, DASHED, NotebookFigure, finish, join_nonempty, subplots

#: More lines than this in one panel are drawn grey, with their median and fractiles.
MOST_LINES = len(COLOURS)
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
    columns = -(-n // 12)
    rows = -(-n // columns)
    width = 4.6 if columns == 1 else 2.7 * columns
    figure = NotebookFigure(figsize=(width + 4.2, max(4.2, 0.6 + 0.95 * rows)), layout="constrained")
    halves: Any = figure.subfigures(1, 2, width_ratios=[width, 4.2])
    left, right = halves
    axes = left.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for ax in axes.T.flat[n:]:
        ax.set_axis_off()
    for number, ax in enumerate(axes.T.flat[:n]):
        motion = motions.isel(record=number)
        peak = motion.isel(point=int(abs(motion["ground_acceleration"]).argmax("point")))
        colour = COLOURS[number] if n <= MOST_LINES else COLOURS[0]
        ax.plot(motion["time"], motion["ground_acceleration"], linewidth=0.7, color=colour)
        ax.plot(peak["time"], peak["ground_acceleration"], "o", markersize=3.5, color=colour)
        title = f"{record_name(motion['record'].item())}: {abs(peak['ground_acceleration'].item()):.3g} m/s²"
        ax.set_title(title, loc="left", fontsize=7, pad=2)
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
    single = {str(name): coord.item() for name, coord in spectra.coords.items() if not coord.ndim}
    values = {"title": "Response spectra", "record": "", "law": ""} | spectra.attrs | single
    names = record_name(values["record"]), law_name(spectra, values["law"])
    damping = f"damping ratio {values['damping_ratio']:g}" if "damping_ratio" in single else ""
    return _draw_both(spectra, join_nonempty(values["title"], *names, damping))


@figure_of("floor-spectra", "histories", "time, acceleration")
def floor_response(histories: xr.Dataset) -> Figure:
    """Draw 5 % response spectra of the floors' total accelerations, from 'simulate'."""
    subject = join_nonempty(scenario_title(histories), "floor spectra, damping ratio 0.05")
    return _draw_both(floor_spectra(histories), subject)


def _draw_both(spectra: xr.Dataset, subject: str) -> Figure:
    """Draw pseudo-acceleration above displacement, in a column for each building, if there are any."""
    spectra = spectra if "building" in spectra.dims else spectra.expand_dims(building=[""])
    columns = spectra.sizes["building"]
    axes = subplots(2, columns, (2.6, 3.4, 5.6, 0.0))
    for row, (name, (_, factor)) in zip(axes, _ORDINATES.items(), strict=True):
        for ax, building in zip(row, spectra["building"].values, strict=True):
            _draw_spectra(ax, spectra[name].sel(building=building) * factor)
            ax.set_title(building)
        row[0].set_ylim(bottom=0.0)
    legend = 2 * columns if len(axes[0, 0].lines) > 1 else 0
    return finish(axes, "period (s)", [label for label, _ in _ORDINATES.values()], subject, legend=legend)


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
        for share, dashes, name in ((0.84, ":", "84% fractile"), (0.5, "-", "median"), (0.16, "--", "16% fractile")):
            ax.plot(periods, np.quantile(curves, share, axis=0), color=COLOURS[0], linestyle=dashes, label=name)
    else:
        ax.set_prop_cycle(DASHED)
        ax.plot(periods, np.transpose([*lines.values()]), label=[*lines])
    positive = periods[periods > 0]
    start = 0.0
    if len(periods) > 2 and not np.allclose(np.diff(periods), periods[1] - periods[0]):
        start = positive.min()
        ax.set_xscale("log")
        ax.xaxis.set_major_formatter("{x:g}")
    if positive.size > 1:
        ax.set_xlim(start, positive.max())
