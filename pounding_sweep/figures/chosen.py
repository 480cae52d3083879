"""The one scenario, or the few, that a figure shows of a cube with more axes than it can draw."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import InputError
from pounding_sweep.figures.style import unit_text
from pounding_sweep.output.audited import AUDIT_DIMS
from pounding_sweep.outputs.variables import INNER_DIMS, STATUS
from pounding_sweep.run.one_scenario import SCENARIO_ATTRIBUTE

if TYPE_CHECKING:
    import xarray as xr

#: Characters in a line of a figure's title, of figures 7.2 inches wide.
WIDTH = 100


def middle(cube: xr.Dataset, keep: Collection[str], drawn: Collection[str] | None = None) -> tuple[xr.Dataset, str]:
    """Take the middle value of every scenario axis that a figure does not draw."""
    inner = {*INNER_DIMS, *AUDIT_DIMS}
    varied = {str(dim): size for dim, size in cube.sizes.items() if dim not in inner and dim not in keep}
    cube = cube.isel(_place(cube, {dim: (size - 1) // 2 for dim, size in varied.items()}, drawn))
    names = ["law", "gap", "stiffness", "stiffness_factor", "restitution", "record", "scale", "damping_ratio", "case"]
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
    said = [f"median of {of}{records} records", shown]
    return result.median("record", keep_attrs=True), "; ".join(part for part in said if part)


def along(cube: xr.Dataset, axis: str) -> xr.Dataset:
    """Return a cube with that axis as a dimension, of one value where it is a scalar coordinate."""
    if axis in cube.dims:
        return cube
    if cube[axis].ndim:
        msg = f"a figure along {axis!r} needs that axis, and this cube lists cases; draw one of them, with --at case=N"
        raise InputError(msg)
    return cube.expand_dims(axis)


def heading(one: xr.Dataset, more: str = "", width: int | None = None) -> str:
    """Return what a simulated scenario is: its title, its gaps, and what else tells it from others of its sweep."""
    gaps = [f"{1e3 * gap:.4g}" for gap in one.pair_gap.values] if "pair_gap" in one.coords else []
    said = f"; gap{'s' * (len(set(gaps)) > 1)} {', '.join(gaps if len(set(gaps)) > 1 else gaps[:1])} mm" if gaps else ""
    details = one.attrs.get(SCENARIO_ATTRIBUTE, "")
    text = "; ".join(part for part in (f"{one.attrs.get('title', 'one scenario')}{said}", details, more) if part)
    if width is None:
        return text
    whole = text.replace(" ", "\xa0").replace(";\xa0", "; ")  # lines end between parts only
    return fill(whole, width, break_long_words=False, break_on_hyphens=False).replace("\xa0", " ")
