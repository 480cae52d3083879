"""What a figure shows of a dataset with more in it than it can draw, and whether that is anything."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.analysis.comparisons import COMPARISONS
from pounding_sweep.analysis.scenarios import COMPARISON, scenario_dims
from pounding_sweep.base.errors import InputError
from pounding_sweep.figures.style import axis_label, joined, unit_text
from pounding_sweep.output.audited import AUDIT_DIMS
from pounding_sweep.outputs.variables import INNER_DIMS, STATUS, VARIABLES, Status
from pounding_sweep.run.one_scenario import SCENARIO_ATTRIBUTE
from pounding_sweep.spec.axes import COLUMNS, DIMENSIONS

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

#: Characters in a line of a figure's title, of figures 7.2 inches wide.
WIDTH = 100

#: Attribute of an axis of which several values were asked for: a figure that draws one of them says so.
SEVERAL = "several_asked"

#: Responses that are drawn, the first that is there, with their label and factor.
RESPONSES = (
    ("impact_force_max", "peak impact force (MN)", 1e-3),
    ("drift_max", "peak drift (mm)", 1e3),
    ("displacement_max", "peak displacement (mm)", 1e3),
    ("acceleration_max", "peak acceleration (m/s²)", 1.0),
    ("storey_shear_max", "peak storey shear (MN)", 1e-3),
)


def middle(cube: xr.Dataset, keep: Collection[str], drawn: Collection[str] | None = None) -> tuple[xr.Dataset, str]:
    """Take the middle value of every scenario axis that a figure does not draw."""
    inner = {*INNER_DIMS, *AUDIT_DIMS}
    varied = {str(dim): size for dim, size in cube.sizes.items() if dim not in inner and dim not in keep}
    for dim in varied:
        draws_one(cube, dim)
    cube = cube.isel(_place(cube, {dim: (size - 1) // 2 for dim, size in varied.items()}, drawn))
    names = ["law", *(dim for column in COLUMNS[:-1] for dim in DIMENSIONS[column])]
    names += ["record", *DIMENSIONS["scale"], "damping_ratio", "case"]
    names += [dim for dim in varied if dim not in names]
    said = []
    for name in names:
        if name in keep or name not in cube.coords or cube[name].ndim:
            continue
        value, alone = cube[name].item(), varied.get(name, 0) == 1
        silent = alone or cube[name].isnull().item() or (name == "scale" and value == 1.0)
        if name in ("law", "record") or not silent:
            text = value if isinstance(value, str) else f"{value:g}"
            said.append(f"{name.replace('_', ' ')} {text} {unit_text(cube[name].attrs)}".rstrip())
    return cube, "; ".join(said)


def draws_one(dataset: xr.Dataset, axis: str, most: int = 1) -> None:
    """Raise `InputError` where more values of an axis were asked for than the figure draws."""
    if axis in dataset.coords and SEVERAL in dataset[axis].attrs and dataset.sizes.get(axis, 1) > most:
        shows = "takes one value of that axis" if most == 1 else f"shows {most} of them at most"
        asked = f"{dataset.sizes[axis]} values of {axis} are asked for"
        msg = f"{asked}, and this figure {shows}; give fewer --at {axis}=VALUE"
        raise InputError(msg)


def _place(cube: xr.Dataset, centre: dict[str, int], drawn: Collection[str] | None) -> dict[str, int]:
    """Return the place next to `centre` at which anything has values; `centre` where nothing has."""
    if not centre or _valued(cube.isel(centre), (), drawn).any():  # else all of a large cube would be read
        return centre
    there = _valued(cube, tuple(centre), drawn)
    places = np.argwhere(there.values)
    if not len(places):
        return centre
    steps = np.abs(places - [centre[str(dim)] for dim in there.dims]).sum(axis=1)
    return centre | {str(dim): int(i) for dim, i in zip(there.dims, places[steps.argmin()], strict=True)}


def _valued(cube: xr.Dataset, dims: Collection[str], names: Collection[str] | None) -> xr.DataArray:
    """Whether there are values at each place along those of `dims` that the cube's values have."""
    import xarray as xr

    if "status" in cube.data_vars:
        parts = [cube["status"].isin([int(status) for status in STATUS if status.has_values])]
    else:
        of = [cube[name] for name in cube.data_vars if names is None or name in names]
        parts = [part.notnull() for part in of if part.dtype.kind == "f"]
    found = xr.DataArray(False)
    for part in parts:
        found = found | part.any([dim for dim in part.dims if str(dim) not in dims])
    return found


def labels_with_values(dataset: xr.Dataset, axis: str, names: Iterable[str]) -> list[Any]:
    """Return the labels of an axis at which any of those variables has a value: others have no line to be drawn."""
    there = np.zeros(dataset.sizes[axis], bool)
    for name in names:
        part = dataset[name].notnull()
        there |= part.any([dim for dim in part.dims if dim != axis]).values
    return [label for label, shown in zip(dataset[axis].values.tolist(), there, strict=True) if shown]


def middle_over_records(result: xr.Dataset, keep: Collection[str], drawn: Collection[str]) -> tuple[xr.Dataset, str]:
    """Take the median of several records and the middle value of every other axis that a figure does not draw."""
    records = result.sizes.get("record", 1)
    if records < 2:
        return middle(result, keep, drawn)
    result, shown = middle(result, (*keep, "record"), drawn)
    held = len(labels_with_values(result, "record", drawn))
    of = "" if held in (0, records) else f"{held} of "
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
    text = joined(f"{one.attrs.get('title', 'one scenario')}{said}", details, more)
    if width is None:
        return text
    whole = text.replace(" ", "\xa0").replace(";\xa0", "; ")  # lines end between parts only
    return fill(whole, width, break_long_words=False, break_on_hyphens=False).replace("\xa0", " ")


#: Axes against which a comparison is drawn, the first of those that vary.
_AXES = ("gap", "stiffness_factor", "stiffness", *DIMENSIONS["scale"], "restitution")

#: Characters in a line of an axis label.
_LABEL = 36


def result_of(dataset: xr.Dataset, key: str) -> xr.Dataset:
    """Return a comparison's result: the dataset itself where it is one, else what the comparison makes of the cube."""
    return dataset if dataset.attrs.get(COMPARISON) == key else COMPARISONS[key].make(dataset)


def drawn_response(result: xr.Dataset, key: str) -> tuple[str, str, float, str]:
    """Return name, label, factor and place ("pair" or "building") of the first of `RESPONSES` that can be drawn."""
    touching = "law" not in result.coords or bool((result["law"] != "none").any())
    for name, label, factor in RESPONSES:
        per = VARIABLES[name].dims[0]
        if name in result and (touching or per == "building"):
            return name, label, factor, per
    names = ", ".join(name for name, *_ in RESPONSES)
    msg = f"figure {key!r} needs one of {names}, the first of a law with contact, which this cube lacks"
    raise InputError(msg)


def first_varied(result: xr.Dataset, but: Iterable[str] = ()) -> str | None:
    """Return the axis to draw along: the first that has several values, building properties last; None without one."""
    others = [dim for dim in scenario_dims(result) if dim not in (*_AXES, "law", "record", "case", *but)]
    for axis in (*_AXES, *others):
        if result.sizes.get(axis, 1) > 1 and result[axis].dtype.kind in "iuf" and axis not in but:
            return axis
    return None


def over_storeys(part: xr.DataArray) -> xr.DataArray:
    """Return the largest value over storeys, or the value itself of a single one."""
    return part.max("storey") if "storey" in part.dims else part


def drawn_axis(result: xr.Dataset, axis: str) -> tuple[np.ndarray, str]:
    """Return the values of an axis to draw along, and its label with the unit."""
    if axis == "gap":
        return np.asarray(result[axis].values) * 1e3, "gap (mm)"
    ratios = [str(name) for name in result.coords if "_ratio_" in str(name) and result[name].dims == (axis,)]
    drawn = result[ratios[0] if ratios else axis]
    name = str(drawn.attrs.get("long_name", axis.replace("_", " ")))
    return np.asarray(drawn.values), fill(axis_label(name, drawn.attrs), _LABEL)


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
