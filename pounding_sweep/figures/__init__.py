"""Figures: each takes a dataset and returns a matplotlib figure.

matplotlib is imported here and nowhere else in the package.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pounding_sweep.base.deferred import function_at
from pounding_sweep.base.errors import InputError, OutputError, unknown
from pounding_sweep.base.paths import expanded

if TYPE_CHECKING:
    import xarray as xr

#: What figures are drawn from: name -> where such a file comes from.
SOURCES: dict[str, str] = {
    "cube": "a cube of 'pounding-sweep run'",
    "histories": "histories of 'pounding-sweep simulate'",
    "trade": "the file of 'pounding-sweep tradeoff'",
    "map": "the file of 'pounding-sweep extremes --map MAP.nc'",
    "spectra": "the file of 'pounding-sweep records plot --data MOTIONS.nc'",
}


@dataclass(frozen=True)
class Kind:
    """A figure by name.

    Attributes
    ----------
    key : str
        Name on the command line.
    title : str
        What it shows.
    place : str
        ``module:function`` that draws it.
    source : str
        What it is drawn from, a key of `SOURCES`.
    needs : tuple of str
        Variables, coordinates, dimensions, `CONTACT` or `NO_CONTACT` that the dataset must have; of
        alternatives, separated by ``|``, any one.
    several : tuple of str
        Axes of which it must have more than one value, again with alternatives; of the
        laws those with contact count.
    """

    key: str
    title: str
    place: str
    source: str = "cube"
    needs: tuple[str, ...] = ()
    several: tuple[str, ...] = ()

    def load(self) -> Callable[..., Any]:
        """Return the function that draws it."""
        return function_at(self.place)

    def lacks(self, dataset: xr.Dataset) -> tuple[str, ...]:
        """Return in words what of `needs` and `several` a dataset has not."""
        there = {*map(str, dataset.variables), *map(str, dataset.sizes), *_kinds_of_laws(dataset)}
        needs = [need.split("|") for need in self.needs]
        several = [axes.split("|") for axes in self.several]
        absent = [" or ".join(names) for names in needs if there.isdisjoint(names)]
        single = [axes for axes in several if all(_size(dataset, axis) < 2 for axis in axes)]
        return (*absent, *(f"several {' or '.join(_PLURAL[axis] for axis in axes)}" for axes in single))


#: A law with contact, and the one without, as needs.
CONTACT, NO_CONTACT = "a law with contact", "the law 'none'"


def _kinds_of_laws(dataset: xr.Dataset) -> set[str]:
    """Return which of `CONTACT` and `NO_CONTACT` a dataset has; both where it does not say."""
    from pounding_sweep.analysis.scenarios import law_keys

    return {NO_CONTACT if law == "none" else CONTACT for law in law_keys(dataset) or ("", "none")}


#: What several values of an axis are called.
_PLURAL = {"law": "laws with contact", "record": "records", "scale": "scales"}


def _size(dataset: xr.Dataset, axis: str) -> int:
    """Return the number of values along an axis, of laws with contact where it is theirs; 1 where it is none."""
    if axis == "law" and axis in dataset.dims:
        return int((dataset[axis] != "none").sum())
    return int(dataset.sizes.get(axis, 1))


#: What a comparison with no pounding gives.
_RATIOS = "|".join(
    f"{name}_ratio"
    for name in ("displacement_max", "displacement_min", "drift_max", "storey_shear_max", "acceleration_max")
)
#: All figures by name.
FIGURES: dict[str, Kind] = {
    kind.key: kind
    for kind in (
        Kind(
            "force-gap",
            "peak impact force and impacts of each pair against the gap, law by law",
            "pounding_sweep.figures.gallery.force_gap:force_gap",
            needs=("law", "gap", "pair", "impact_force_max", "impact_count", CONTACT),
        ),
        Kind(
            "profiles",
            "peak displacement, drift, storey shear and acceleration over the height, law by law",
            "pounding_sweep.figures.gallery.profiles:profiles",
            needs=(
                "law",
                "floor_elevation",
                "displacement_max|displacement_min|drift_max|storey_shear_max|acceleration_max",
            ),
        ),
        Kind(
            "amplification",
            "responses with pounding over responses without, by building and law",
            "pounding_sweep.figures.gallery.amplification:amplification",
            needs=(
                "law",
                f"displacement_max|displacement_min|drift_max|storey_shear_max|acceleration_max|{_RATIOS}",
                CONTACT,
                f"{NO_CONTACT}|{_RATIOS}",
            ),
        ),
        Kind(
            "law-comparison",
            "impact forces over those of a reference law, at equal nominal and at equal realised restitution",
            "pounding_sweep.figures.gallery.law_comparison:law_comparison",
            needs=(
                "law",
                "pair",
                "impact_force_max|penetration_max|impulse|approach_speed_max|impact_count|impact_force_max_compared"
                "|penetration_max_compared|impulse_compared|approach_speed_max_compared|impact_count_compared",
            ),
            several=("law",),
        ),
        Kind(
            "required-gap",
            "the gap that each pair needs, exactly and by separation rules",
            "pounding_sweep.figures.gallery.required_gap:required_gap",
            needs=("pair", "record|case|exact"),
        ),
        Kind(
            "energy-budget",
            "where the energy of each building went, law by law",
            "pounding_sweep.figures.gallery.energy_budget:energy_budget",
            needs=("building", "energy_input", "energy_damping", "energy_kinetic", "energy_strain"),
        ),
        Kind(
            "incremental",
            "response against intensity, record by record, with the fractiles of the suite",
            "pounding_sweep.figures.gallery.incremental:incremental",
            several=("scale",),
        ),
        Kind(
            "fragility",
            "probability that a pair touches, against intensity, with its confidence",
            "pounding_sweep.figures.gallery.fragility:fragility",
            needs=("pair", CONTACT),
            several=("record|scale",),
        ),
        Kind(
            "histories",
            "ground acceleration, floor displacements and contact forces against time, from 'simulate'",
            "pounding_sweep.figures.gallery.histories:histories",
            source="histories",
            needs=("time", "ground_acceleration", "displacement"),
        ),
        Kind(
            "row",
            "the row at the instant of its strongest impact, from 'simulate'",
            "pounding_sweep.figures.gallery.row:row",
            source="histories",
            needs=("time", "floor_elevation", "displacement"),
        ),
        Kind(
            "floor-spectra",
            "5 % response spectra of the floors' total accelerations, from 'simulate'",
            "pounding_sweep.figures.gallery.response_spectra:floor_response",
            source="histories",
            needs=("time", "acceleration"),
        ),
        Kind(
            "response-spectra",
            "response or floor spectra: pseudo-acceleration and displacement against period",
            "pounding_sweep.figures.gallery.response_spectra:response_spectra",
            source="spectra",
            needs=("period", "pseudo_acceleration", "spectral_displacement"),
        ),
        Kind(
            "ground-motion",
            "acceleration histories and response spectra of records, as 'records plot' draws them",
            "pounding_sweep.figures.gallery.ground_motion:ground_motion",
            source="spectra",
            needs=("record", "time", "ground_acceleration", "period", "pseudo_acceleration", "damping_ratio"),
        ),
        Kind(
            "work-precision",
            "worst error of schemes, steps and number formats against their cost, from 'tradeoff'",
            "pounding_sweep.figures.gallery.work_precision:work_precision",
            source="trade",
            needs=("scheme", "located", "error", "cost"),
        ),
        Kind(
            "stability-map",
            "error and status over contact stiffness and time step, from 'extremes --map'",
            "pounding_sweep.figures.gallery.stability_map:stability_map",
            source="map",
            needs=("peak_force_error", "status", "scheme", "stiffness", "dt"),
        ),
    )
}


#: Dots per inch that a page can be drawn in.
_DPI = (10, 1200)


def require(dataset: xr.Dataset, key: str) -> None:
    """Raise `InputError` where a dataset lacks what a figure needs."""
    kind = FIGURES[key]
    lacking = kind.lacks(dataset)
    if lacking:
        msg = (
            f"figure {key!r} needs {', '.join(lacking)}, which this file has not; it is drawn from "
            f"{SOURCES[kind.source]}"
        )
        if kind.source == "cube" and "status" in dataset.variables:
            msg += ": choose others with --at, or run the sweep again with such a law, axis or output"
        raise InputError(msg)


def plot(dataset: xr.Dataset, kind: str, path: str | os.PathLike[str], *, dpi: float = 150.0) -> Path:
    """Draw a figure of a dataset into a file (PNG, SVG, PDF by its suffix).

    Parameters
    ----------
    dataset : xarray.Dataset
        A cube, or what else the figure is drawn from.
    kind : str
        A key of `FIGURES`.
    path : path
        File to write.
    dpi : float
        Dots per inch of a PNG, 10 to 1200.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        The figure is unknown, the dataset lacks what it needs or has no value to be drawn,
        or `dpi` is out of range.
    OutputError
        The file can't be written.
    """
    from pounding_sweep.figures.shown import nothing_to_draw, shows_values

    if kind not in FIGURES:
        raise InputError(unknown("figure", kind, FIGURES))
    low, high = _DPI
    if not low <= dpi <= high:
        msg = f"dpi is {dpi:g}; it must be from {low} to {high}"
        raise InputError(msg)
    require(dataset, kind)
    target = expanded(path)
    figure = FIGURES[kind].load()(dataset)
    if not shows_values(figure):
        raise InputError(nothing_to_draw(dataset, kind))
    try:
        figure.savefig(target, dpi=dpi)
    except (OSError, ValueError) as error:
        msg = (
            f"can't write {str(target)!r} ({error}); give a file in a folder that exists, ending in .png, .svg or .pdf"
        )
        raise OutputError(msg) from error
    return target
