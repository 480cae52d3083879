"""What a figure shows of a dataset that has more in it than it can draw, the axis it is drawn along, and the words."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from pounding_sweep.analysis.comparisons import COMPARISONS
from pounding_sweep.analysis.scenarios import COMPARISON, TOUCH_VARIABLES, long_name, scenario_dims
from pounding_sweep.base.errors import InputError, check_choice, unknown
from pounding_sweep.figures.style import join_nonempty, unit_text
from pounding_sweep.model.laws import LAWS
from pounding_sweep.records import NAMED_RECORDS
from pounding_sweep.request.axes import AXES, DIMENSIONS
from pounding_sweep.variables.registry import INNER_DIMS, VARIABLES

#: Responses that are drawn, the first that is there.
RESPONSES = (
    *("impact_force_max", "drift_max", "displacement_max", "acceleration_max", "storey_shear_max"),
    *("drift_ratio_max", "roof_drift_ratio_max"),
)
#: Ratios that are drawn in per cent, by their long names.
_PERCENT = {VARIABLES[name].long_name for name in ("drift_ratio_max", "roof_drift_ratio_max")}
#: Names of axes in titles, and beginnings of those that are there for each building.
_AXES = {*INNER_DIMS, "law", "record", "case", *(dim for dims in DIMENSIONS.values() for dim in dims)}
_BY_NAME = tuple(f"{axis.dimension}_" for axis in AXES.values() if axis.by)
#: Axes against which a comparison is drawn, the first of those that vary; then building properties.
_DRAWN_ALONG = ("gap", "stiffness_factor", "stiffness", *DIMENSIONS["scale"], "restitution")


class NothingToDrawError(InputError):
    """What a figure would draw has no value."""


def select_default(dataset: xr.Dataset, keep: Collection[str], drawn: Iterable[str]) -> tuple[xr.Dataset, str]:
    """Take of every axis that a figure does not `keep` the middle value at which floors touch, and say which.

    Laws, pairs and buildings without a value of `drawn` are left out.
    """
    drawn = [name for name in drawn if name in dataset]
    sizes = {dim: dataset.sizes[dim] for dim in scenario_dims(dataset) if dim not in keep}
    place = {dim: (size - 1) // 2 for dim, size in sizes.items()}
    if _score(dataset.isel(place), drawn, ()).max() < 2:  # else all of a large cube would be read
        score = _score(dataset, drawn, sizes)
        if not score.any():
            raise NothingToDrawError
        for dim, middle in place.items():
            score = score - 1e-6 * abs(xr.DataArray(np.arange(sizes[dim]), dims=dim) - middle)
        place = {str(dim): int(best) for dim, best in score.argmax([*sizes]).items()} if sizes else place
    dataset = dataset.isel(place)
    others = " or ".join(f"{dim}=..." for dim, size in sizes.items() if size > 1)
    words = join_nonempty(describe(dataset, sizes, but=keep), f"--at {others} for another" if others else "")
    valued = {dim: labels_with_values(dataset, dim, drawn) for dim in ("law", "pair", "building")}
    return dataset.sel({dim: labels for dim, labels in valued.items() if labels}), words


def several_records(dataset: xr.Dataset) -> list[str]:
    """Return the dimension of records if there are several."""
    return ["record"] * (dataset.sizes.get("record", 1) > 1)


def over_records(
    dataset: xr.Dataset, words: str, drawn: Collection[str], *, worst: bool = False
) -> tuple[xr.Dataset, str]:
    """Take the median, or the largest, of several records, and say so before the words."""
    if "record" not in dataset.dims:
        return dataset, words
    records, valued = dataset.sizes["record"], len(labels_with_values(dataset, "record", drawn))
    count = f"{valued} of {records}" if 0 < valued < records else str(records)
    result = dataset.max("record", keep_attrs=True) if worst else dataset.median("record", keep_attrs=True)
    return result, join_nonempty(f"{'worst' if worst else 'median'} of {count} records", words)


def _score(dataset: xr.Dataset, names: Collection[str], dims: Collection[str]) -> xr.DataArray:
    """Score places along `dims`: 2 where floors touch and there are values, 1 where there are values, else 0."""
    touch = next((dataset[name] > 0 for name in ("touches", *TOUCH_VARIABLES) if name in dataset), xr.DataArray(False))
    valued = dataset[[*names]].notnull().to_dataarray().any("variable")
    touch, valued = (part.any([dim for dim in INNER_DIMS if dim in part.dims]) for part in (touch, valued))
    score = valued * (1 + touch)
    return score.max([dim for dim in score.dims if dim not in dims])


def describe(dataset: xr.Dataset, sizes: Mapping[str, int] | None = None, but: Collection[str] = ()) -> str:
    """Say which single values of axes a dataset is of, and of how many (`sizes`) each was taken."""
    sizes, words = sizes or {}, []
    single = {str(name): coord.item() for name, coord in dataset.coords.items() if not coord.ndim and coord.notnull()}
    for name, value in single.items():
        size = sizes.get(name, 0)
        repeated = name == "scale" and not {"pga", "sa"}.isdisjoint(single)
        by_name = name.startswith(_BY_NAME) and name != "restitution_realised"  # which belongs to each law
        axis = name in _AXES or size or by_name
        if axis and name not in but and not repeated and not (size == 1 and value == 1.0):
            words.append(coord_text(dataset, name) + (f" (one of {size})" if size > 1 else ""))
    if dataset.sizes.get("storey") == 1 and "storey" not in but:
        words.append(f"storey {dataset['storey'].item():g}")
    return join_nonempty(*words)


def coord_text(dataset: xr.Dataset, name: str) -> str:
    """Say which value a coordinate of a single value has, as titles do; "" for an empty text."""
    value = dataset[name].item()
    if value == "" or name == "law":
        return law_name(dataset, value) if value else ""
    unit, factor = drawn_unit(dataset[name].attrs)
    value = record_name(value) if name == "record" else value
    text = str(value) if isinstance(value, str | int) else f"{float(f'{factor * value:.3g}'):g} {unit}".rstrip()
    return f"{name.replace('_', ' ')} {text}"


def select_lines(result: xr.Dataset, axis: str) -> xr.Dataset:
    """Return five values of an axis at most, evenly chosen: each has a line."""
    places = np.linspace(0, result.sizes[axis] - 1, 5).round()
    return result.isel({axis: np.unique(places).astype(int)})


def labels_with_values(dataset: xr.Dataset, axis: str, names: Iterable[str]) -> list[Any]:
    """Return the labels of an axis at which any of those variables has a value."""
    parts = dataset[[name for name in names if axis in dataset[name].dims]].notnull()
    if not parts:
        return []
    valued = parts.any([dim for dim in parts.dims if dim != axis]).to_dataarray().any("variable")
    labels: list[Any] = dataset[axis].values[valued.values].tolist()
    return labels


def with_dims(cube: xr.Dataset, *axes: str, absent: Any = None) -> xr.Dataset:
    """Return a cube with those axes as dimensions, of one value if it is a scalar coordinate, or `absent`."""
    for axis in axes:
        if axis in cube.coords and cube[axis].ndim and axis not in cube.dims:
            raise InputError(
                f"the figure needs the axis {axis!r}, and this cube lists its scenarios as cases; draw one of them, "
                "with --at case=N, or give the axes of the sweep"
            )
        if axis not in cube.dims:
            cube = cube.expand_dims(axis if axis in cube.coords or absent is None else {axis: [absent]})
    return cube


def result_of(dataset: xr.Dataset, key: str, **drawn: Any) -> xr.Dataset:
    """Return a comparison's result: the dataset itself if it is one, else what the comparison makes of the cube."""
    return dataset if dataset.attrs.get(COMPARISON) == key else COMPARISONS[key].make(dataset, **drawn)


def check_value(value: str | None, valid: Collection[str], alternatives: Iterable[str] = ()) -> None:
    """Raise `InputError` unless a value to draw is valid, or None: not chosen."""
    if value not in (None, *valid):
        raise InputError(unknown("value to draw", value, [*valid, *alternatives]))


def choose_response(cube: xr.Dataset, key: str, value: str | None = None) -> tuple[str, str, float, str]:
    """Return name, label, factor and dimension of a variable: the first of `RESPONSES` that the cube can draw."""
    contact = "law" not in cube.coords or bool((cube["law"] != "none").any())
    drawable = [name for name in RESPONSES if name in cube and (contact or "pair" not in cube[name].dims)]
    name = value or next(iter(drawable), None)
    if name is None:
        names = ", ".join(RESPONSES)
        raise InputError(f"figure {key!r} needs one of {names}, the first of a law with contact, which this cube lacks")
    unit, factor = drawn_unit(cube[name].attrs)
    per = next((dim for dim in ("pair", "building") if dim in cube[name].dims), "scenario")
    return name, f"{long_name(cube[name], name)} ({unit or '-'})", factor, per


def drawn_unit(attributes: Mapping[str, Any]) -> tuple[str, float]:
    """Return the unit in which figures show a variable, and the factor that brings it there: mm for m, % of drifts."""
    if attributes.get("long_name") in _PERCENT:
        return "%", 100.0
    return ("mm", 1e3) if attributes.get("units") == "m" else (unit_text(attributes), 1.0)


def law_name(cube: xr.Dataset | xr.DataArray, law: str) -> str:
    """Return what a contact law is called: by the registry, else by the cube, else its key."""
    if law in LAWS:
        return LAWS[law].title
    keys, titles = (np.atleast_1d(cube.coords.get(name, [])).tolist() for name in ("law", "law_title"))
    return str(dict(zip(keys, titles, strict=False)).get(law, law))


def record_name(key: str) -> str:
    """Return what a record is called: event, station and component of a known one, else its own name."""
    return NAMED_RECORDS[key].description if key in NAMED_RECORDS else key


def scenario_title(one: xr.Dataset) -> str:
    """Return what a simulated scenario is: its title, its gaps, and what else tells it from others of its sweep."""
    title = one.attrs.get("title", "one scenario")
    if {"record", "law"} <= one.attrs.keys():
        title = f"{record_name(one.attrs['record'])}: {law_name(one, one.attrs['law'])}"
    gaps = [f"{1e3 * gap:.3g}" for gap in one.pair_gap.values] if "pair_gap" in one.coords else []
    words = f"gaps {', '.join(gaps)} mm" if len({*gaps}) > 1 else "".join(f"gap {gap} mm" for gap in gaps[:1])
    return join_nonempty(title, words, one.attrs.get("scenario", ""))


def time_slice(one: xr.Dataset, start: float | None, end: float | None) -> xr.Dataset:
    """Return the part of histories from `start` to `end` (s); the whole if neither is given."""
    part = one.sel(time=slice(start, end))
    if part.sizes["time"] < 2:
        first, last = one["time"].values[[0, -1]]
        period = f"from {first if start is None else start:g} s to {last if end is None else end:g} s"
        raise InputError(
            f"fewer than two instants of the histories lie {period}; they run from {first:g} s to {last:g} s"
        )
    return part


class PlotAxis(NamedTuple):
    """An axis to draw along."""

    dim: str  # dimension of the cube
    name: str  # the dimension, or a coordinate along it by which it is drawn, such as the ratio of two periods
    label: str  # name with its unit
    factor: float  # from the unit of the cube to the one drawn

    def values(self, result: xr.Dataset | xr.DataArray) -> np.ndarray:
        """Return the values that are drawn."""
        values = result[self.name].values
        values = values if values.dtype.kind in "iuf" else np.arange(values.size) + 1  # names have numbers
        return values.astype(float) * self.factor


def plot_axis(result: xr.Dataset, name: str) -> PlotAxis:
    """Return an axis, or a coordinate along one, to draw along."""
    unit, factor = drawn_unit(result[name].attrs)
    words = "gap" if name == "gap" else long_name(result[name], name)
    words += f"\xa0({unit or '-'})" if result[name].dtype.kind in "iuf" else ""
    label = fill(words, 36).replace("\xa0", " ")  # a unit stays with the last word
    return PlotAxis(str(result[name].dims[0]), name, label, factor)


def plot_axes(result: xr.Dataset, labels: Iterable[str] = ()) -> dict[str, PlotAxis]:
    """Return what can be drawn along, by name: axes of several numbers, coordinates along one, and some `labels`."""
    numbers = [str(name) for name, coord in result.coords.items() if coord.ndim == 1 and coord.dtype.kind in "iuf"]
    dims = [dim for dim in scenario_dims(result) if dim in numbers and result.sizes[dim] > 1 and dim != "case"]
    along = [name for name in numbers if name not in dims and result[name].dims[0] in dims]
    labels = [name for name in labels if result.sizes.get(name, 1) > 1]
    return {name: plot_axis(result, name) for name in (*dims, *along, *labels)}


def choose_axis(
    result: xr.Dataset, requested: str | None, but: Collection[str] = (), labels: Collection[str] = ()
) -> PlotAxis | None:
    """Return the requested axis, else the first with several numbers, building properties and `labels` last."""
    axes = plot_axes(result, labels)
    if requested is None:
        free = [dim for dim in (*_DRAWN_ALONG, *scenario_dims(result)) if dim not in ("law", "record", "case")]
        dim = next((dim for dim in (*free, *labels) if dim in axes and dim not in but), None)
        ratios = [axis for axis in axes.values() if axis.dim == dim and "_ratio_" in axis.name]
        return ratios[0] if ratios else axes.get(str(dim))
    name = requested if requested in axes else next((key for key in axes if key.startswith(f"{requested}_")), requested)
    if name in result.coords and len(dims := result[name].dims) > 1:
        varied = " and ".join(map(str, dims))
        raise InputError(
            f"{name} varies with {varied}; choose one value of all but one of them with --at, such as {dims[0]}=..."
        )
    check_choice("axis to draw along", name, axes)
    if axes[name].dim in but:
        raise InputError(f"{name} and the other axis are the same, {axes[name].dim}; valid: {', '.join(axes)}")
    return axes[name]


def panels(axes: np.ndarray, data: xr.Dataset, *dims: str) -> Iterator[tuple[Any, xr.Dataset]]:
    """Yield every panel and its part of the data, whose labels on the dimensions (rows, columns) are its title."""
    for place, panel in np.ndenumerate(axes):
        part = data.isel(dict(zip(dims, place, strict=True)))
        panel.set_title("\n".join(filter(None, (coord_text(part, dim) for dim in dims))))
        yield panel, part


def scale_axis(axis: Any, values: np.ndarray, *, marked: bool = False) -> None:
    """Make an axis of a panel logarithmic if its values are; a tick at each if they are few and it is, or `marked`."""
    if log := is_log(values):
        use_logarithms(axis)
    if len(values) <= 8 and (log or marked):
        axis.set_ticks(values, [f"{value:g}" for value in values])


def use_logarithms(axis: Any) -> None:
    """Make an axis of a panel logarithmic, with ticks at 1, 2 and 5."""
    axis.axes.set(**{f"{axis.axis_name}scale": "log"})
    axis.minorticks_off()
    axis.get_major_locator().set_params(subs=(1.0, 2.0, 5.0))
    axis.set_major_formatter("{x:g}")


def is_log(values: np.ndarray) -> bool:
    """Whether values are spaced in even ratios rather than evenly, over a wide range."""
    if len(values) < 3 or values.min() <= 0.0 or values.max() < 3.999 * values.min():
        return False
    steps, ratios = np.diff(values), np.diff(np.log(values))
    return bool(np.ptp(ratios) / ratios.mean() < np.ptp(steps) / steps.mean())
