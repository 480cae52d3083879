"""From arrays of results to a labelled dataset with CF attributes; xarray is loaded only for datasets in memory."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pounding_sweep.model.laws import LAWS, Law
from pounding_sweep.model.scene import Scene
from pounding_sweep.variables.registry import VARIABLES, mask_invalid, scatter_contact, scatter_dof

if TYPE_CHECKING:
    import xarray as xr

CONVENTIONS = "CF-1.11"
#: Global attribute by which a file is known as a cube of this package.
VERSION_ATTRIBUTE = "pounding_sweep_version"
#: Global attribute of a cube: digest of the source of the package that made it.
SOURCE_ATTRIBUTE = "package_sha256"

#: How text is stored in netCDF: as characters (UTF-8) along a dimension of their own, which every reader knows. The
#: library may crash where a file with texts of any length is open several times (HDF5, issue 5359).
TEXT: Mapping[str, Any] = {"dtype": "S1", "_FillValue": None}
#: name -> (dimensions, values, attributes)
Coordinates = dict[str, tuple[tuple[str, ...], Any, dict[str, Any]]]


#: Title of a dataset whose sweep has none.
UNTITLED = "Parametric sweep of seismic pounding of adjacent buildings"


@lru_cache(maxsize=1)
def package_version() -> str:
    """Return the installed version of this package, or "unknown"."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("pounding-sweep")
    except PackageNotFoundError:
        return "unknown"


def global_attributes(title: str) -> dict[str, str]:
    """Return the global attributes of every dataset that is made now: its title, and what made it."""
    version = package_version()
    return {
        "Conventions": CONVENTIONS,
        "title": title,
        "source": f"pounding_sweep {version}",
        "history": f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ} made by pounding_sweep {version}",
        VERSION_ATTRIBUTE: version,
    }


#: A power that is no whole number, which UDUNITS reads as something else: "m-1.5" is m-1 times 0.5.
_FRACTIONAL_POWER = re.compile(r"[A-Za-z][\^*]*[-+]?\d*\.\d")


def unit_attributes(units: str) -> dict[str, str]:
    """Return ``units``, or ``unit_text`` for a unit that UDUNITS can't spell."""
    if not units:
        return {}
    return {"unit_text" if _FRACTIONAL_POWER.search(units) else "units": units}


def coordinate(
    dims: Sequence[str], values: Any, units: str, long_name: str, comment: str = ""
) -> tuple[tuple[str, ...], Any, dict[str, Any]]:
    """Return a coordinate and what is said of it; what is empty is not."""
    return tuple(dims), values, {"units": units, "long_name": long_name, "comment": comment}


def _attributes(raw: Mapping[str, Any]) -> dict[str, Any]:
    """Return what netCDF attributes can hold: text, numbers, arrays of numbers, and JSON of all else."""
    result: dict[str, Any] = unit_attributes(str(raw.get("units", "")))
    for key, value in raw.items():
        if key == "units" or value is None or (key == "comment" and not value):
            continue
        result[key] = value
        if isinstance(value, bool | np.bool_):
            result[key] = "true" if value else "false"
        elif not isinstance(value, str | int | float | np.integer | np.floating):
            numbers = np.asarray(value if isinstance(value, list | tuple | np.ndarray) else [])
            text = json.dumps(value, sort_keys=True, default=str, ensure_ascii=False)
            result[key] = numbers if numbers.dtype.kind in "iuf" and numbers.ndim == 1 and numbers.size else text
    return result


def coordinate_values(values: Any) -> np.ndarray:
    """Return labels: text, or numbers of a type that every netCDF reader knows; None among numbers is NaN."""
    array = np.asarray(values)
    if array.dtype.kind == "O" and all(v is None or isinstance(v, (int, float)) for v in array.flat):
        return array.astype(np.float64)
    if array.dtype.kind in "OUST":
        return np.array([str(v) for v in np.ravel(array)]).reshape(array.shape)
    if array.dtype.kind == "b":
        return array.astype(np.int8)
    if array.dtype.kind in "iu":
        small = not array.size or (array.min() >= -(2**31) and array.max() < 2**31)
        return array.astype(np.int32 if small else np.int64)
    return array.astype(np.float64)


def _scene_coordinates(scene: Scene) -> Coordinates:
    elevations = np.concatenate([building.levels for building in scene.buildings])
    floors, contacts = ("building", "storey"), ("pair", "storey")
    names, numbers = [building.name for building in scene.buildings], np.arange(1, scene.n_storeys + 1)
    text = "elevation of the floor above the datum of the row"
    result = {
        "building": coordinate(floors[:1], names, "", "building, left to right"),
        "storey": coordinate(floors[1:], numbers, "1", "storey, 1 at the bottom"),
        "floor_elevation": coordinate(floors, scatter_dof(elevations, scene), "m", text),
    }
    if scene.pair_names:
        result["pair"] = coordinate(contacts[:1], list(scene.pair_labels), "", "pair of neighbours, left-right")
        # of a floor that strikes columns, the floor's; columns have the index of the floor above them
        meeting = [c.left if c.left >= 0 and c.struck != 0 else c.right for c in scene.contacts]
        meets, text = scatter_contact(elevations[meeting], scene), "elevation at which the floors of the pair meet"
        result["contact_elevation"] = coordinate(contacts, meets, "m", text)
        # the last for a wall, which has none
        storeys = np.concatenate([*(np.arange(1.0, item.n_storeys + 1) for item in scene.buildings), [np.nan]])
        for side in ("left", "right"):
            met = storeys[[getattr(contact, side) for contact in scene.contacts]]
            text = f"storey of the {side} building that meets there"
            result[f"{side}_storey"] = coordinate(contacts, scatter_contact(met, scene), "1", text)
    return result


def law_coordinates(dims: Sequence[str], laws: Any, registry: Mapping[str, Law] = LAWS) -> Coordinates:
    """Return what is known about the laws of a coordinate, as far as it is."""
    keys = np.ravel(np.asarray(laws)).astype(str).tolist()
    if len(dims) != 1 or not registry.keys() & keys:
        return {}
    texts = {
        "model": "model number in Mate, Bakre & Jaiswal (2015)",
        "title": "contact law in words",
        "formula": "contact force (kN) of penetration d and its rate v",
    }
    return {
        f"law_{name}": coordinate(dims, [str(getattr(registry.get(key), name, "")) for key in keys], "", text)
        for name, text in texts.items()
        if name == "model" or tuple(dims) == ("law",)  # else listed cases, of which there may be many
    }


def as_read(name: str, values: np.ndarray) -> np.ndarray:
    """Return stored values of a variable as a file gives them: missing integers are NaN, and then all are float64."""
    variable = VARIABLES[name]
    if variable.dtype == "f8":
        return np.asarray(values, dtype=np.float64)
    if variable.fill is None:
        return np.asarray(values, dtype=variable.dtype)
    return np.where(np.asarray(values) == variable.fill, np.nan, np.asarray(values, dtype=np.float64))


def as_stored(name: str, values: np.ndarray) -> np.ndarray:
    """Return values of a variable as they are stored, from what a file gave: the inverse of `as_read`."""
    variable = VARIABLES[name]
    if variable.dtype != "f8" and variable.fill is not None:
        values = np.where(np.isnan(values), variable.fill, values)
    return np.asarray(values, dtype=variable.dtype)


class CubeParts(NamedTuple):
    """What `xarray.Dataset` is made of: (dimensions, values, attributes) by name, and global attributes."""

    data_vars: Coordinates
    coords: Coordinates
    attrs: dict[str, Any]

    def to_dataset(self) -> xr.Dataset:
        """Return the dataset, which knows how it is stored in a file."""
        import xarray as xr

        dataset = xr.Dataset(*self)
        for name, variable in dataset.variables.items():
            variable.encoding = encoding_of(str(name), variable.dtype, is_coordinate=name in self.coords)
        return dataset


def assemble(
    scene: Scene,
    axes: Coordinates,
    arrays: Mapping[str, np.ndarray],
    attributes: Mapping[str, Any] | None = None,
    extra_coords: Coordinates | None = None,
) -> xr.Dataset:
    """Make a labelled dataset of results."""
    data = {name: as_read(name, values) for name, values in mask_invalid(arrays).items()}
    return label(scene, axes, data, attributes or {}, extra_coords or {}).to_dataset()


def unfilled(name: str, shape: Sequence[int]) -> np.ndarray:
    """Return an array of a variable, whose values are still to come, that takes no memory."""
    return np.broadcast_to(as_read(name, np.zeros(())), shape)


def label(
    scene: Scene,
    axes: Coordinates,
    data: Mapping[str, np.ndarray],
    attributes: Mapping[str, Any],
    extra_coords: Coordinates,
) -> CubeParts:
    """Label values that are as they are to be read (see `as_read`), which is not checked."""
    coordinates = {**axes, **extra_coords}
    if "law" in coordinates:
        coordinates = {**law_coordinates(*coordinates["law"][:2]), **coordinates}
    parts = CubeParts({}, {}, _attributes({**global_attributes(UNTITLED), **attributes}))
    for name, variable in VARIABLES.items():
        if name in data and variable.exists_in(scene):
            about = {"units": variable.units, "long_name": variable.long_name, "comment": variable.definition}
            flags: dict[str, Any] = {}
            if variable.flag_values:
                values = np.array(variable.flag_values, dtype=np.int8)
                flags = {"flag_values": values, "flag_meanings": variable.flag_meanings}
            parts.data_vars[name] = ((*axes, *variable.dims), data[name], about | flags)
    for name, (dims, raw, about) in {**coordinates, **_scene_coordinates(scene)}.items():
        parts.coords[name] = (tuple(dims), coordinate_values(raw), _attributes({"long_name": name, **about}))
    return parts


def encoding_of(name: str, dtype: np.dtype, *, is_coordinate: bool = False) -> dict[str, Any]:
    """Return how a variable stands in a netCDF file: text as characters, coordinates without missing values."""
    if dtype.kind in "OSUT":
        return dict(TEXT)
    if name in VARIABLES and not is_coordinate:
        stored, fill = np.dtype(VARIABLES[name].dtype), VARIABLES[name].fill
        return {"dtype": stored, "_FillValue": None if fill is None else stored.type(fill)}
    return {"_FillValue": dtype.type(np.nan) if dtype.kind == "f" and not is_coordinate else None}
