"""What a figure shows of a dataset with more in it than it can draw, and whether that is anything."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.analysis.comparisons import COMPARISONS
from pounding_sweep.analysis.scenarios import COMPARISON, TOUCH_VARIABLES, scenario_dims
from pounding_sweep.base.errors import InputError
from pounding_sweep.figures.style import COLOURS, joined, unit_text, wrapped
from pounding_sweep.model.laws import LAWS
from pounding_sweep.output.audited import AUDIT_DIMS
from pounding_sweep.outputs.variables import INNER_DIMS, STATUS, VARIABLES, Status
from pounding_sweep.records import KNOWN_RECORDS
from pounding_sweep.run.one_scenario import SCENARIO_ATTRIBUTE
from pounding_sweep.spec.axes import AXES, COLUMNS, DIMENSIONS

#: Characters in a line of a figure's title, of figures 7.2 inches wide.
WIDTH = 100

#: Attribute of an axis of which several values were asked for: a figure that draws one of them says so.
SEVERAL = "several_asked"
#: Lines in a panel at most, where nobody asked for more.
_LINES_SHOWN = 5

#: Responses that are drawn, the first that is there, and what they are called.
RESPONSES = {
    "impact_force_max": "peak impact force",
    "drift_max": "peak drift",
    "displacement_max": "peak displacement",
    "acceleration_max": "peak acceleration",
    "storey_shear_max": "peak storey shear",
}
#: Axes that titles tell, as far as a dataset has one value of them; those by building follow, then parts of the row.
_TOLD = (
    "law",
    *(dim for column in COLUMNS[:-1] for dim in DIMENSIONS[column]),
    "record",
    *reversed(DIMENSIONS["scale"]),
)
_BY_BUILDING = tuple(f"{axis.dimension}_" for axis in AXES.values() if axis.by_building)


def middle(cube: xr.Dataset, keep: Collection[str], drawn: Collection[str] | None = None) -> tuple[xr.Dataset, str]:
    """Take one value of every scenario axis that a figure does not draw: the middle one at which floors touch."""
    # where nothing touches it is the middle one that has values. The text tells what was taken, and of how many.
    inner = {*INNER_DIMS, *AUDIT_DIMS}
    varied = {str(dim): size for dim, size in cube.sizes.items() if dim not in inner and dim not in keep}
    for dim in varied:
        draws_one(cube, dim)
    cube = cube.isel(_place(cube, varied, drawn))
    single = [str(name) for name in cube.coords if not cube[name].ndim and str(name) not in keep]
    names = [*_TOLD, "damping_ratio", *(name for name in single if name.startswith(_BY_BUILDING)), "case", *varied]
    said = []
    for name in dict.fromkeys([*names, *INNER_DIMS]):
        if name not in single or (name == "scale" and {*single} & {*DIMENSIONS["scale"][1:]}):
            continue
        value, size = cube[name].item(), varied.get(name)
        usual = size == 1 and value == 1.0
        if name in ("law", "record") or not (usual or cube[name].isnull().item()):
            said.append(told(cube, name, value) + (f" (one of {size})" if size and size > 1 else ""))
    if cube.sizes.get("storey") == 1 and "storey" not in keep and "storey" in cube.coords:
        said.append(f"storey {cube['storey'].item():g}")
    return cube, joined(*said)


def draws_one(dataset: xr.Dataset, axis: str, most: int = 1) -> None:
    """Raise `InputError` where more values of an axis were asked for than the figure draws."""
    if axis in dataset.coords and SEVERAL in dataset[axis].attrs and dataset.sizes.get(axis, 1) > most:
        shows = "takes one value of that axis" if most == 1 else f"shows {most} of them at most"
        asked = f"{dataset.sizes[axis]} values of {axis} are asked for"
        msg = f"{asked}, and this figure {shows}; give fewer --at {axis}=VALUE"
        raise InputError(msg)


def told(cube: xr.Dataset, name: str, value: Any) -> str:
    """Say that a coordinate has a value, as titles do."""
    if name == "law":
        return law_name(cube, value) if value else ""
    if name == "record":
        return f"record {record_name(value)}"
    if isinstance(value, str):
        return f"{name.replace('_', ' ')} {value}"
    unit, factor = drawn_unit(cube[name].attrs)
    return f"{name.replace('_', ' ')} {factor * value:.6g} {unit}".rstrip()


def records_of(result: xr.Dataset) -> str:
    """Say which record, or how many, a result is of."""
    if result.sizes.get("record", 1) > 1:
        return f"{result.sizes['record']} records"
    return told(result, "record", result["record"].values.item()) if "record" in result.coords else ""


def lines_of(result: xr.Dataset, axis: str) -> list[int]:
    """Return the places on an axis of which each has a line: all that were asked for, else five, evenly chosen."""
    draws_one(result, axis, len(COLOURS))
    most = len(COLOURS) if axis in result.coords and SEVERAL in result[axis].attrs else _LINES_SHOWN
    return [int(place) for place in np.unique(np.linspace(0, result.sizes[axis] - 1, most).round())]


def drawn_unit(attributes: Mapping[str, Any]) -> tuple[str, float]:
    """Return the unit in which figures show a variable, and the factor that brings it there: mm for m, else its own."""
    return ("mm", 1e3) if attributes.get("units") == "m" else (unit_text(attributes), 1.0)


def law_name(cube: xr.Dataset, law: str) -> str:
    """Return what a contact law is called: by the registry, else by the cube, else its key."""
    if law in LAWS:
        return LAWS[law].title
    if {"law", "law_title"} <= set(cube.coords) and cube["law_title"].dims == cube["law"].dims:
        keys, titles = (np.atleast_1d(cube[name].values).astype(str) for name in ("law", "law_title"))
        return next(iter(titles[keys == law].tolist()), law)
    return law


def record_name(key: str) -> str:
    """Return what a record is called: event, station and component of a known one, else its own name."""
    return KNOWN_RECORDS[key].description if key in KNOWN_RECORDS else key


def _place(cube: xr.Dataset, varied: Mapping[str, int], drawn: Collection[str] | None) -> dict[str, int]:
    """Return the place next to the middle at which floors touch, else at which anything has values, else the middle."""
    centre = {dim: (size - 1) // 2 for dim, size in varied.items()}
    if not any(centre.values()) and max(varied.values(), default=1) == 1:
        return centre
    for touching in (True, False):
        if _valued(cube.isel(centre), (), drawn, touching).any():  # else all of a large cube would be read
            return centre
        there = _valued(cube, tuple(centre), drawn, touching)
        places = np.argwhere(there.values)
        if len(places):
            steps = np.abs(places - [centre[str(dim)] for dim in there.dims]).sum(axis=1)
            return centre | {str(dim): int(i) for dim, i in zip(there.dims, places[steps.argmin()], strict=True)}
    return centre


def _valued(cube: xr.Dataset, dims: Collection[str], names: Collection[str] | None, touching: bool) -> xr.DataArray:
    """Whether there are values, of rows whose floors touch, at each place along those of `dims` that the cube has."""
    if "status" in cube.data_vars:
        parts = [cube["status"].isin([int(status) for status in STATUS if status.has_values])]
    else:
        of = [cube[name] for name in cube.data_vars if names is None or name in names]
        parts = [part.notnull() for part in of if part.dtype.kind == "f"]
    touch = xr.DataArray(True)
    if touching:
        name = next((name for name in ("touches", *TOUCH_VARIABLES) if name in cube.data_vars), None)
        touch = xr.DataArray(False) if name is None else cube[name] > 0
        touch = touch.any([dim for dim in INNER_DIMS if dim in touch.dims])
    found = xr.DataArray(False)
    for part in (part & touch for part in parts):
        found = found | part.any([dim for dim in part.dims if str(dim) not in dims])
    return found


def labels_with_values(dataset: xr.Dataset, axis: str, names: Iterable[str]) -> list[Any]:
    """Return the labels of an axis at which any of those variables has a value: others have no line to be drawn."""
    there = np.zeros(dataset.sizes[axis], bool)
    for name in names:
        part = dataset[name].notnull()
        there |= part.any([dim for dim in part.dims if dim != axis]).values
    return [label for label, shown in zip(dataset[axis].values.tolist(), there, strict=True) if shown]


def panels_of(dataset: xr.Dataset, axis: str, names: Iterable[str]) -> list[Any]:
    """Return the labels of an axis that have a panel: not pairs without contacts, but all where none has a value."""
    return labels_with_values(dataset, axis, names) or dataset[axis].values.tolist()


def middle_over_records(result: xr.Dataset, keep: Collection[str], drawn: Collection[str]) -> tuple[xr.Dataset, str]:
    """Take the median of several records and the middle value of every other axis that a figure does not draw."""
    if result.sizes.get("record", 1) < 2:
        return middle(result, keep, drawn)
    return median_over_records(*middle(result, (*keep, "record"), drawn), drawn)


def median_over_records(result: xr.Dataset, shown: str, drawn: Collection[str]) -> tuple[xr.Dataset, str]:
    """Take the median of several records, and say so before the text of what is shown."""
    records = result.sizes["record"]
    valued = len(labels_with_values(result, "record", drawn))
    of = "" if valued in (0, records) else f"{valued} of "
    return result.median("record", keep_attrs=True), joined(f"median of {of}{records} records", shown)


def along(cube: xr.Dataset, axis: str, absent: Any = None) -> xr.Dataset:
    """Return a cube with that axis as a dimension, of one value where it is a scalar coordinate, or `absent`."""
    if axis in cube.dims:
        return cube
    if axis not in cube.coords and absent is not None:
        return cube.expand_dims({axis: [absent]})
    if cube[axis].ndim:
        msg = f"a figure along {axis!r} needs that axis, and this cube lists cases; draw one of them, with --at case=N"
        raise InputError(msg)
    return cube.expand_dims(axis)


def heading(one: xr.Dataset, more: str = "", width: int | None = None) -> str:
    """Return what a simulated scenario is: its title, its gaps, and what else tells it from others of its sweep."""
    gaps = [f"{1e3 * gap:.4g}" for gap in one.pair_gap.values] if "pair_gap" in one.coords else []
    said = f"; gap{'s' * (len(set(gaps)) > 1)} {', '.join(gaps if len(set(gaps)) > 1 else gaps[:1])} mm" if gaps else ""
    details = one.attrs.get(SCENARIO_ATTRIBUTE, "")
    title = one.attrs.get("title", "one scenario")
    if {"record", "law"} <= one.attrs.keys():
        title = f"{record_name(one.attrs['record'])}: {law_name(one, one.attrs['law'])}"
    text = joined(f"{title}{said}", details, more)
    return text if width is None else wrapped(text, width)


def zoomed(one: xr.Dataset, start: float | None, end: float | None) -> xr.Dataset:
    """Return the part of histories from `start` to `end` (s); the whole where neither is given."""
    part = one.sel(time=slice(start, end))
    if part.sizes["time"] < 2:
        time = one["time"].values
        asked = f"from {time[0] if start is None else start:g} s to {time[-1] if end is None else end:g} s"
        msg = f"fewer than two instants of the histories lie {asked}; they run from {time[0]:g} s to {time[-1]:g} s"
        raise InputError(msg)
    return part


#: Axes against which a comparison is drawn, the first of those that vary.
_AXES = ("gap", "stiffness_factor", "stiffness", *DIMENSIONS["scale"], "restitution")


def result_of(dataset: xr.Dataset, key: str, **drawn: Any) -> xr.Dataset:
    """Return a comparison's result: the dataset itself where it is one, else what the comparison makes of the cube."""
    return dataset if dataset.attrs.get(COMPARISON) == key else COMPARISONS[key].make(dataset, **drawn)


def drawn_response(result: xr.Dataset, key: str) -> tuple[str, str, float, str]:
    """Return name, label, factor and place ("pair" or "building") of the first of `RESPONSES` that can be drawn."""
    touching = "law" not in result.coords or bool((result["law"] != "none").any())
    for name, words in RESPONSES.items():
        per = VARIABLES[name].dims[0]
        if name in result and (touching or per == "building"):
            unit, factor = drawn_unit({"units": VARIABLES[name].units})
            return name, f"{words} ({unit})", factor, per
    names = ", ".join(RESPONSES)
    msg = f"figure {key!r} needs one of {names}, the first of a law with contact, which this cube lacks"
    raise InputError(msg)


def first_varied(result: xr.Dataset, but: Iterable[str]) -> str | None:
    """Return the axis to draw along: the first that has several values, building properties last; None without one."""
    others = [dim for dim in scenario_dims(result) if dim not in (*_AXES, "law", "record", "case", *but)]
    for axis in (*_AXES, *others):
        if result.sizes.get(axis, 1) > 1 and result[axis].dtype.kind in "iuf" and axis not in but:
            return axis
    return None


def over_storeys(part: xr.DataArray) -> xr.DataArray:
    """Return the largest value over storeys, of minima and first times the smallest; a single value as it is."""
    if "storey" not in part.dims:
        return part
    least = str(part.name).endswith("_min") or part.name == "first_impact_time"
    return part.min("storey") if least else part.max("storey")


def shows_values(figure: Figure) -> bool:
    """Whether any line, bar, mark or map of a figure has a finite value; lines across a whole panel are none."""
    return any(_finite(artist, ax) for ax in figure.axes for artist in ax.get_children())


def _finite(artist: Any, ax: Any) -> bool:
    """Whether an artist of a panel stands for a finite value of the data."""
    from matplotlib.collections import Collection, PathCollection
    from matplotlib.lines import Line2D
    from matplotlib.patches import Rectangle

    rows: Any = []
    if isinstance(artist, Line2D) and artist.get_transform() is ax.transData:
        rows = np.column_stack(artist.get_data())
    elif isinstance(artist, Rectangle) and artist is not ax.patch:
        rows = [[artist.get_width(), artist.get_height()]]
    elif isinstance(artist, PathCollection):  # marks
        rows = artist.get_offsets()
    elif isinstance(artist, Collection) and (cells := artist.get_array()) is not None:  # of a map
        rows = np.reshape(cells, (-1, 1))
    elif isinstance(artist, Collection):
        rows = np.concatenate([path.vertices for path in artist.get_paths()] or [np.empty((0, 2))])
    points: np.ndarray = np.ma.filled(np.ma.asarray(rows, dtype=float), np.nan)
    return bool(points.size) and bool(np.isfinite(points).all(axis=1).any())


def nothing_to_draw(dataset: xr.Dataset, key: str) -> str:
    """Say that a figure has nothing to draw of a dataset, why, and what to do."""
    shown = middle(dataset, [str(dim) for dim in dataset.sizes])[1]
    return f"figure {key!r} has nothing to draw{f' at {shown}' if shown else ''}: {_why(dataset)}"


def _why(dataset: xr.Dataset) -> str:
    status = dataset["status"].values if "status" in dataset.data_vars else np.array(int(Status.OK))
    counts = [(one.label, int((status == int(one)).sum())) for one in STATUS if one != Status.OK]
    failed = [f"{count} of {status.size} scenarios are {label}" for label, count in counts if count]
    return f"{', '.join(failed) or 'none of its values is a number'}; choose others with --at"
