"""Whether a cube is what its sweep wrote, so that its results may be reused in another one."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pounding_sweep.base.errors import InputError
from pounding_sweep.output.netcdf import reading
from pounding_sweep.spec import axes

if TYPE_CHECKING:
    import xarray as xr


#: Axes in the description of a sweep.
AXIS_KEYS = frozenset({"laws", *(name for name, axis in axes.AXES.items() if not axis.by_building)})
#: Axes there that are given for some buildings: [name, values].
BUILDING_AXES = frozenset(axes.FACTOR_KINDS)
#: What else sweeps of one study may differ in: no result of a scenario depends on it.
FREE = frozenset({"cases", "design", "records", "records_left_out", "title", "audit"})
#: Laws of a user's own there, by key.
OWN_LAWS = "own_laws"
#: What helps if a cube is not as it was made.
REMEDY = "give the cube as it was made, not a part of it"


def outer_dims(cube: xr.Dataset) -> list[str]:
    """Axes of a cube, in its order."""
    return [str(dim) for dim in cube["status"].dims]


def recorded_sweep(path: str, cube: xr.Dataset) -> dict[str, Any]:
    """Return what a cube says of its sweep."""
    text = str(cube.attrs["sweep"])
    if hashlib.sha256(text.encode()).hexdigest() != cube.attrs.get("sweep_sha256"):
        raise InputError(
            f"{path!r} does not say what its sweep was: its attribute 'sweep' is damaged; make the cube again"
        )
    return dict(json.loads(text))


def differing_laws(one: Mapping[str, Any], two: Mapping[str, Any]) -> list[tuple[str, Any, Any]]:
    """Return the laws of a user's own that two sweeps have by one key, but not as one law, with their digests."""
    a, b = one.get(OWN_LAWS, {}), two.get(OWN_LAWS, {})
    both = [(key, a[key]["sha256"], b[key]["sha256"]) for key in sorted(a.keys() & b.keys())]
    return [(f"law {key!r} as SHA-256", here[:12], there[:12]) for key, here, there in both if here != there]


def check_axes(path: str, cube: xr.Dataset, expected: Mapping[str, Sequence[Any] | int]) -> None:
    """Raise `InputError` if a cube has other axes than its sweep, or other values on them; its labels are read."""
    axis_names = outer_dims(cube)
    if set(axis_names) != set(expected):
        raise InputError(
            f"{path!r} has the axes {', '.join(axis_names) or 'none'}, its sweep had {', '.join(expected)}; {REMEDY}"
        )
    with reading(path):
        for name in cube.coords:
            cube[name].load()
    for name, values in expected.items():
        labels = cube[name].values.tolist() if name in cube.coords else []
        if isinstance(values, int) and len(labels) != values:
            raise InputError(f"{path!r} has {len(labels)} values of {name}, its sweep had {values}; {REMEDY}")
        if not isinstance(values, int) and labels != list(values):
            raise other_values(path, name)


def other_values(path: str, name: str) -> InputError:
    """Return the error that a cube does not have the values of its sweep."""
    return InputError(f"{path!r} has other values of {name} than its sweep; {REMEDY}")


def recorded_axes(cube: xr.Dataset, sweep: Mapping[str, Any]) -> dict[str, Sequence[Any] | int]:
    """Return the axes that a cube should have by what it says of its sweep, for `check_axes`."""
    if sweep["cases"] is not None:
        return {"case": len(sweep["cases"])}
    arguments = axes.axes_of(sweep)
    found: dict[str, Any] = arguments.along(sweep["laws"], [record["name"] for record in sweep["records"]])
    found["gap"] = arguments.gaps or 1
    properties = [(axis.kind, axis.values) for axis in axes.property_axes(arguments)]
    others = [dim for dim in outer_dims(cube) if dim not in found]  # their names are made from those of the buildings
    for i, (stem, values) in enumerate(properties):
        found[others[i] if i < len(others) and others[i].startswith(stem) else stem] = values
    return found
