"""Response and floor spectra against period."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.base.errors import InputError
from pounding_sweep.figures import figure_of
from pounding_sweep.figures.shown import law_name, record_name
from pounding_sweep.figures.style import COLOURS, LINES, put_title, subplots

#: More lines than this in one panel are drawn grey, with their median and fractiles.
MOST_LINES = len(COLOURS)
_FRACTILES = (0.84, 0.5, 0.16)


@figure_of(
    "spectra",
    "response or floor spectra: pseudo-acceleration and displacement against period",
    needs=("period", "pseudo_acceleration", "spectral_displacement"),
)
def response_spectra(spectra: xr.Dataset) -> Figure:
    """Draw pseudo-acceleration and displacement spectra against period."""
    parts = [spectra]
    if "building" in spectra.dims:
        parts = [spectra.isel(building=index) for index in range(spectra.sizes["building"])]
    figure, axes = subplots(2, len(parts), (2.6 + 3.4 * len(parts), 5.6))
    for column, part in enumerate(parts):
        draw_spectra(axes[0, column], part["pseudo_acceleration"], "pseudo-acceleration (m/s²)" if column == 0 else "")
        draw_spectra(axes[1, column], part["spectral_displacement"] * 1e3, "displacement (mm)" if column == 0 else "")
        axes[1, column].set_xlabel("period (s)")
        if len(parts) > 1:
            axes[0, column].set_title(str(part["building"].item()))
    for row in axes:
        row[0].set_ylim(bottom=0)
    entries = {label: handle for ax in axes[0] for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    if len(entries) > 1:
        columns = min(2 * len(parts), len(entries))
        figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=columns)
    put_title(figure, _title(spectra))
    return figure


def _title(spectra: xr.Dataset) -> str:
    """Say what is the same for all lines."""
    parts = [str(spectra.attrs.get("title", "Response spectra"))]
    for name in ("record", "law"):
        if name not in spectra.dims and (name in spectra.coords or name in spectra.attrs):
            key = str(spectra[name].item() if name in spectra.coords else spectra.attrs[name])
            parts.append(record_name(key) if name == "record" else law_name(spectra, key))
    if "damping_ratio" in spectra.coords and not spectra["damping_ratio"].ndim:
        parts.append(f"damping ratio {spectra['damping_ratio'].item():g}")
    return "; ".join(parts)


def draw_spectra(ax: Any, values: xr.DataArray, label: str) -> None:
    """Draw one ordinate on ``period``, one line per place along its other dimensions."""
    lines = _lines(values)
    if not lines:
        msg = "there is no spectrum to draw: none holds finite numbers"
        raise InputError(msg)
    periods = values["period"].values
    even = periods.size < 3 or np.allclose(np.diff(periods), periods[1] - periods[0])
    if len(lines) > MOST_LINES:
        if len(lines) > values.sizes.get("record", 0):
            msg = (
                f"{len(lines)} spectra in one panel can't be told apart: select at most {MOST_LINES} of "
                f"{', '.join(f'{size} {dim}' for dim, size in values.sizes.items() if dim != 'period')}"
            )
            raise InputError(msg)
        array = np.array([line for _, line in lines])
        ax.plot(periods, array.T, color="0.75", linewidth=0.6)
        for share, style in zip(_FRACTILES, (":", "-", "--"), strict=True):
            name = "median" if share == 0.5 else f"{share:.0%} fractile"
            ax.plot(periods, np.quantile(array, share, axis=0), color=COLOURS[0], linestyle=style, label=name)
    else:
        for number, (name, line) in enumerate(lines):
            ax.plot(periods, line, label=name, color=COLOURS[number], linestyle=LINES[number % len(LINES)])
    if not even:
        ax.set_xscale("log")
        ax.xaxis.set_major_formatter("{x:g}")
    positive = periods[periods > 0]
    if positive.size > 1:
        ax.set_xlim(0.0 if even else positive.min(), positive.max())
    ax.set_ylabel(label)


def _lines(values: xr.DataArray) -> list[tuple[str, np.ndarray]]:
    """Return name and values of each line that holds finite numbers."""
    values = values.transpose(..., "period")
    found = []
    for place in np.ndindex(values.shape[:-1]):
        line = values.values[place]
        if np.isfinite(line).all():
            found.append((_name(values, place), line))
    return found


def _name(values: xr.DataArray, place: tuple[int, ...]) -> str:
    """Name a line by its labels: those of texts alone, numbers with the name of their dimension."""
    parts = []
    for dim, index in zip(values.dims, place, strict=False):
        if values.sizes[dim] > 1 or len(place) == 1:
            label = values[dim].values[index]
            text = record_name(label) if dim == "record" else label
            parts.append(text if isinstance(text, str) else f"{str(dim).replace('_', ' ')} {text:g}")
    return ", ".join(parts)
