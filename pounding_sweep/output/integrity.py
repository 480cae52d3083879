"""Whether a cube is whole, so that its results may be taken into another one.

Checksums tell damaged values when they are read. Attributes have none, nor have texts of earlier files, and a file
may have been changed by hand: what a cube says of itself is held against its sweep here.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import InputError
from pounding_sweep.output.audited import AUDIT_DIMS
from pounding_sweep.output.netcdf import reading
from pounding_sweep.output.provenance import ORIGINS, origins
from pounding_sweep.output.scenario_key import MOTION
from pounding_sweep.outputs.variables import INNER_DIMS, STATUS, VARIABLES
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
#: What helps where a cube is not as it was made.
REMEDY = "give the cube as it was made, not a part of it"


def outer_dims(cube: xr.Dataset) -> list[str]:
    """Axes of a cube, in its order."""
    return [str(dim) for dim in cube["status"].dims]


def damaged(path: str, what: str) -> InputError:
    """Return the error that a cube is not what a sweep wrote."""
    return InputError(
        f"{path!r} is damaged, or was changed after it was made: {what}; {REMEDY}, or run its sweep again"
    )


def recorded_sweep(path: str, cube: xr.Dataset) -> dict[str, Any]:
    """Return what a cube says of its sweep."""
    try:
        text = cube.attrs["sweep"]
        found = json.loads(text)
        whole = hashlib.sha256(text.encode()).hexdigest() == cube.attrs["sweep_sha256"] and _well_formed(found)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):  # any JSON, or an attribute of any type
        whole = False
    if not whole:
        msg = f"{path!r} does not say what its sweep was: its attribute 'sweep' is damaged; make the cube again"
        raise InputError(msg)
    return dict(found)


def _well_formed(told: Mapping[str, Any]) -> bool:
    """Whether JSON has the form of a sweep, as far as its axes, cases and records go; any error means the same."""
    lists = [told["records"], told["records_left_out"], told["outputs"]]
    lists += [told[key] for key in {*AXIS_KEYS, "cases"} if told.get(key) is not None]
    lists += [values for key in BUILDING_AXES for _, values in told.get(key, ())]
    axes.axes_of(told)  # an error where one lacks
    records = all(record.keys() >= {"name", *MOTION} for record in told["records"])
    cases = all(case.keys() >= {"law", "record"} for case in told["cases"] or ())
    keys = told.keys() >= {*FREE, "accuracy"} - {"design"}
    return keys and all(isinstance(each, list) for each in lists) and records and cases


def differing_laws(one: Mapping[str, Any], two: Mapping[str, Any]) -> list[tuple[str, Any, Any]]:
    """Return the laws of a user's own that two sweeps have by one key, but not as one law, with their digests."""
    a, b = one.get(OWN_LAWS, {}), two.get(OWN_LAWS, {})
    both = [(key, a[key]["sha256"], b[key]["sha256"]) for key in sorted(a.keys() & b.keys())]
    return [(f"law {key!r} as SHA-256", here[:12], there[:12]) for key, here, there in both if here != there]


def check_axes(path: str, cube: xr.Dataset, wanted: Mapping[str, Sequence[Any] | int]) -> None:
    """Raise `InputError` where a cube has other axes than its sweep, or other values on them."""
    here = outer_dims(cube)
    if set(here) != set(wanted):
        msg = f"{path!r} has the axes {', '.join(here) or 'none'}, its sweep had {', '.join(wanted)}; {REMEDY}"
        raise InputError(msg)
    for name, values in wanted.items():
        if name not in cube.coords:
            raise damaged(path, f"axis {name!r} has no values")
        given = cube[name].values.tolist()
        if isinstance(values, int):
            if len(given) != values:
                msg = f"{path!r} has {len(given)} values of {name}, its sweep had {values}; {REMEDY}"
                raise InputError(msg)
            continue
        if given != list(values):
            raise InputError(other_values(path, name))
        if len(set(given)) < len(given):
            raise damaged(path, f"axis {name!r} has a value twice")


def other_values(path: str, name: str) -> str:
    """Say that a cube does not have the values of its sweep."""
    return f"{path!r} has other values of {name} than its sweep; {REMEDY}"


def recorded_axes(cube: xr.Dataset, told: Mapping[str, Any]) -> dict[str, Sequence[Any] | int]:
    """Return the axes that a cube should have by what it says of its sweep, for `check_axes`."""
    if told["cases"] is not None:
        return {"case": len(told["cases"])}
    given = axes.axes_of(told)
    found: dict[str, Any] = given.along(told["laws"], [record["name"] for record in told["records"]])
    found["gap"] = given.gaps or 1
    properties = [(axis.kind, axis.values) for axis in axes.property_axes(given)]
    there = [dim for dim in outer_dims(cube) if dim not in found]  # their names are made from those of the buildings
    for i, (stem, values) in enumerate(properties):
        found[there[i] if i < len(there) and there[i].startswith(stem) else stem] = values
    return found


def check_variables(path: str, cube: xr.Dataset, names: Iterable[str]) -> None:
    """Raise `InputError` where an output is missing in a file, or does not have the form in which sweeps store it."""
    for name in names:
        if name not in cube.data_vars:
            raise damaged(path, f"it has no variable {name!r}")
        variable, array = VARIABLES[name], cube[name]
        dims = (*outer_dims(cube), *variable.dims)
        if set(array.dims) != set(dims):
            raise damaged(path, f"variable {name!r} has dimensions {array.dims}, not {dims}")
        kind, fill = np.dtype(array.encoding.get("dtype", array.dtype)), array.encoding.get("_FillValue")
        missing = (
            fill is None
            if variable.fill is None
            else fill is not None and np.array_equal(fill, variable.fill, equal_nan=True)
        )
        if kind != variable.dtype or not missing:
            wanted = f"{np.dtype(variable.dtype)}, missing as {variable.fill}"
            raise damaged(path, f"variable {name!r} is stored as {kind}, missing as {fill}, not as {wanted}")


def check_statuses(path: str, status: np.ndarray) -> None:
    """Raise `InputError` where a status has no meaning."""
    strange = np.setdiff1d(status, [int(known) for known in STATUS])
    if strange.size:
        known = ", ".join(f"{int(each)} {each.label}" for each in STATUS)
        raise damaged(path, f"status {', '.join(map(str, strange[:5].tolist()))} has no meaning; valid: {known}")


def load_labels(path: str, cube: xr.Dataset) -> None:
    """Read the coordinates of a cube and its audit, and check that they lie along its dimensions."""
    known = {*outer_dims(cube), *INNER_DIMS, *AUDIT_DIMS}
    for name, array in cube.variables.items():
        if name in cube.coords or AUDIT_DIMS[0] in array.dims:
            if not known >= set(array.dims):
                raise damaged(path, f"{name!r} has dimensions {array.dims}, which sweeps don't make")
            with reading(path):
                array.load()


def check_attributes(path: str, cube: xr.Dataset, told: Mapping[str, Any]) -> None:
    """Raise `InputError` where the attributes that are added up over cubes are not what sweeps write."""
    attributes = cube.attrs
    for key in ("scenarios_asked", "scenarios_run", "scenarios_never_touching"):
        if not isinstance(attributes.get(key, 0), int | np.integer):
            raise damaged(path, f"attribute {key!r} is {attributes[key]!r}, no number of scenarios")
    names = [(record["name"], record["sha256"]) for record in told["records"]]
    try:
        whole = [(each["name"], each["sha256"]) for each in json.loads(attributes["records"])] == names
    except (ValueError, TypeError, KeyError, RecursionError):  # any JSON, or any attribute
        whole = False
    if not whole:
        raise damaged(path, "attribute 'records' is not what a sweep writes")
    check_origins(path, attributes)
    steps = np.atleast_1d(attributes.get("time_step", 0.0))
    if told["accuracy"] is None and (steps.dtype.kind != "f" or steps.shape != (len(names),)):
        raise damaged(path, "attribute 'time_step' is not one step for each record")
    if told["accuracy"] is not None and not isinstance(attributes.get("accuracy_choice"), str):
        raise damaged(path, "attribute 'accuracy_choice' is no text")
    audit = [attributes[key] for key in ("audit_touching", "audit_share") if "audit_error" in cube]
    if not all(np.isfinite(value) and value > 0 for value in audit):
        raise damaged(path, "attributes of its audit are no positive numbers")


def check_origins(path: str, attributes: Mapping[Any, Any]) -> None:
    """Raise `InputError` where what a cube says of those that its results were taken from is not what is written."""
    for key in ORIGINS:
        if key in attributes:
            try:
                told = [each for _, _, each in origins({key: attributes[key]})]
                whole = isinstance(attributes[key], str) and bool(told) and all(map(_counts_runs, told))
            except (ValueError, TypeError, RecursionError):  # any JSON
                whole = False
            if not whole:
                raise damaged(path, f"attribute {key!r} is not what a sweep writes")


def _counts_runs(told: Mapping[str, Any]) -> bool:
    """Whether what is said of a cube has numbers where those of several are added up."""
    counts = [told.get(key, 0) for key in ("scenarios_run", "scenarios_never_touching")]
    audit = [told[key] for key in ("audit_touching", "audit_share") if key in told]
    whole = len(audit) in (0, 2) and all(isinstance(value, int | float) for value in audit)
    return whole and all(isinstance(count, int) for count in counts) and all(0 < value < math.inf for value in audit)
