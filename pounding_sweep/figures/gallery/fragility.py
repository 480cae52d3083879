"""Fragility curves: fitted probability with its band, and the shares that were observed."""

from __future__ import annotations

from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.analysis.comparisons.fragility import TRIALS, crossed, sentence
from pounding_sweep.analysis.events import EVENTS
from pounding_sweep.analysis.lognormal import FitStatus, merged
from pounding_sweep.figures import CONTACT, figure_of
from pounding_sweep.figures.shown import along, first_varied, lines_of, middle, records_of, result_of, told
from pounding_sweep.figures.sides import draw_intensities, intensity_label
from pounding_sweep.figures.style import COLOURS, LINES, MARKERS, put_title, subplots, unit_text

#: Trials of many intensities are put together into so many classes of about equal size to show their shares.
_CLASSES = 6
#: Characters of a line of the legend.
_ENTRY = 48


@figure_of(
    "cube",
    "probability that a pair touches, against intensity, with its confidence",
    needs=("pair", CONTACT),
    several=("|".join(TRIALS),),
)
def fragility(cube: xr.Dataset) -> Figure:
    """Draw the probability of an event against intensity.

    One panel per pair or building. Lines are the values of the first axis that varies (gap, stiffness, ...), five at
    most, evenly chosen, or else the laws; of the other axes, and of the laws, the middle value is shown. Bands are
    confidence intervals, between the least and the greatest intensity tried; marks are the shares observed at each
    intensity where trials share them (stripes), else in classes of about equal numbers of trials. The title says where
    curves cross. Where there is no fit, the legend says why.
    """
    from matplotlib.transforms import ScaledTranslation

    result = result_of(cube, "fragility")
    own = (*TRIALS, "bound", "intensity", "quantile")
    event = EVENTS[result.attrs["event"]]
    per, words = event.per, _spelt(result.attrs["event_in_words"], event.units)
    for dim in ("law", per):
        result = along(result, dim) if dim in result.coords else result
    axis = first_varied(result, but=own) or "law"
    result, shown = middle(result, (*own, axis), ["happened"])
    result = result if axis in result.dims else result.expand_dims({axis: [""]})
    ends, drawn = result[per].values.tolist(), lines_of(result, axis)
    figure, axes = subplots(1, len(ends), (1.4 + 3.4 * len(ends), 4.6))
    label = intensity_label(result)
    below = ScaledTranslation(0.0, -0.4 - 0.16 * label.count("\n"), figure.dpi_scale_trans)  # of the label
    for ax, end in zip(axes[0], ends, strict=True):
        for number, place in enumerate(drawn):
            part = result.isel({axis: place}).sel({per: end})
            _line(ax, part, number, told(result, axis, result[axis].values[place].item()))
        ax.set(ylim=(-0.02, 1.02), title=f"{per} {end}")
        ax.set_xlabel(label)
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), bbox_transform=ax.transAxes + below, fontsize=8)
    cross = "curves cross, as each has its own dispersion" if crossed(result.isel({axis: drawn})) else ""
    one = f"one dispersion along {result.attrs['one_dispersion']}" if "one_dispersion" in result.attrs else ""
    draw_intensities(axes[0, 0], result)  # shared: nothing drawn later would move it
    axes[0, 0].set_ylabel(f"probability that\n{words} (-)")
    put_title(figure, words, records_of(result), shown, cross, one)
    return figure


def _spelt(text: str, units: str) -> str:
    """Write the unit in a text as figures do."""
    return text.replace(f" {units}", f" {unit_text({'units': units})}") if units else text


def _line(ax: Any, part: xr.Dataset, number: int, label: str) -> None:
    """Draw one fit with its band and the observed shares."""
    label = f"{label}: " if label else ""
    colour, at = COLOURS[number % len(COLOURS)], part["intensity"].values
    x, happened = part["trial_intensity"].values.ravel(), part["happened"].values.ravel()
    there = np.isfinite(happened)
    if int(part["fit_status"]) == FitStatus.FITTED:
        band = part["probability_interval"].values
        if np.isfinite(band).all():
            tried = (at >= x[there].min()) & (at <= x[there].max())
            ax.fill_between(at, *band, where=tried, color=colour, alpha=0.15, linewidth=0)
        units = unit_text(part["median"].attrs)
        fitted = f"{label}median {float(part['median']):.3g} {units}, dispersion {float(part['dispersion']):.2g}"
        look = {"color": colour, "linestyle": LINES[number % len(LINES)]}
        ax.plot(at, part["probability"].values, label=fill(fitted, _ENTRY), **look)
    else:
        why = label + _spelt(sentence(part), part["median"].attrs["units"])
        ax.plot([], [], color=colour, marker=MARKERS[number], linestyle="none", label=fill(why, _ENTRY))
    for group in _groups(x[there]):
        ax.plot(x[there][group].mean(), happened[there][group].mean(), color=colour, marker=MARKERS[number])


def _groups(x: np.ndarray) -> list[np.ndarray]:
    """Return the trials of each mark: those of one intensity, where that is shared by several each, else of a class."""
    order = np.argsort(x, kind="stable")
    stripes = np.split(order, np.flatnonzero(np.diff(merged(x)[order])) + 1) if x.size else []
    if stripes and min(map(len, stripes)) > 1:
        return stripes
    return [group for group in np.array_split(order, _CLASSES) if group.size]
