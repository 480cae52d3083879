"""Which scenarios a cube has, as keys of 16 bytes, and their results, read a slab at a time."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.model.laws import LAWS
from pounding_sweep.output.dataset import as_stored
from pounding_sweep.output.netcdf import reading
from pounding_sweep.request.axes import BUILDING_DEFAULTS, axes_of
from pounding_sweep.request.spec import laws_of, scene_of
from pounding_sweep.variables.registry import VARIABLES

if TYPE_CHECKING:
    import xarray as xr

    from pounding_sweep.model.laws import Law
    from pounding_sweep.plan.plan import Plan

#: Shifts and pairs of odd factors by which each number changes all bits of a key (MurmurHash3 and SplitMix64).
_MIXING = [
    (np.uint64(33), np.array([0xFF51AFD7ED558CCD, 0xBF58476D1CE4E5B9], np.uint64)),
    (np.uint64(29), np.array([0xC4CEB9FE1A85EC53, 0x94D049BB133111EB], np.uint64)),
]


def scenario_keys(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return 16 bytes for each scenario by values of shape (scenarios, ...): the same where all values are equal."""
    keys = np.zeros((len(next(iter(columns.values()))), 2), np.uint64)
    for column in columns.values():
        for values in _as_numbers(column).reshape(len(keys), -1).T:
            bits = values.astype(float) + 0.0  # -0.0 is 0.0
            bits[np.isnan(bits)] = np.nan  # which may have many forms
            keys ^= bits.view(np.uint64)[:, None]
            for shift, factors in _MIXING:
                keys ^= keys >> shift
                keys *= factors
            keys ^= keys >> np.uint64(32)
    return keys.view("V16")[:, 0]


def _as_numbers(values: np.ndarray) -> np.ndarray:
    """Return numbers as they are, texts as numbers that stand for them."""
    if values.dtype.kind in "iuf":
        return values
    texts, index = np.unique(values.astype(str), return_inverse=True)
    digests = [hashlib.blake2b(text.encode(), digest_size=6).digest() for text in texts.tolist()]
    return np.array([int.from_bytes(digest) for digest in digests])[index.reshape(values.shape)]


def places_of(wanted: np.ndarray, rising: np.ndarray) -> np.ndarray:
    """Return where keys stand among rising ones; -1 where they don't."""
    places = np.searchsorted(rising, wanted).clip(max=len(rising) - 1)
    return np.where(rising[places] == wanted, places, -1)


def planned_columns(plan: Plan, rows: np.ndarray) -> dict[str, np.ndarray]:
    """Return what unique scenarios of a plan are known by."""
    table, labels = plan.unique[rows], plan.spec.scene.pair_of_label
    pairs, shape = dict(stiffness=table.stiffness, restitution=table.restitution, gap=table.gaps), table.gaps.shape
    names = [law.key for law in plan.laws], [record.name for record in plan.spec.records]
    law, record = (_as_numbers(np.array(texts)) for texts in names)
    return {
        "law": law[table.law],
        "record": record[table.record],
        "scale": table.scale,
        **{name: np.broadcast_to(part.reshape(len(rows), -1), shape)[:, labels] for name, part in pairs.items()},
        **{name: getattr(plan.variants, name)[table.variant] for name in BUILDING_DEFAULTS},
    }


def cube_columns(part: xr.Dataset, sweep: Mapping[str, Any], dims: Iterable[str]) -> dict[str, np.ndarray]:
    """Return what the scenarios of a cube, or a part of it, are known by, along `dims`; as `planned_columns`."""
    import xarray as xr

    sizes = {dim: part.sizes[dim] for dim in dims}
    scene, law = scene_of(sweep["scene"]), part["law"]
    laws = LAWS | laws_of(sweep)
    first = next((key for key in sweep["laws"] if laws[key].has_contact), "")
    keys, index = np.unique(law.values, return_inverse=True)

    def by_law(value: Callable[[Law], Any]) -> xr.DataArray:
        return law.copy(data=np.array([value(laws[str(key)]) for key in keys])[index.reshape(law.shape)])

    # where all contacts have bumpers, no law acts
    stiffness = part["contact_stiffness" if "contact_stiffness" in part.coords else "stiffness"]
    gap = part.get("pair_gap", xr.DataArray(np.empty(0), dims="pair"))
    has_stiffness = by_law(lambda item: item.exponent is not None and not scene.padded)
    has_restitution = by_law(lambda item: item.takes_restitution and not scene.padded)
    columns = {
        "law": by_law(lambda item: first if scene.padded and item.has_contact else item.key),
        "record": part["record"],
        "scale": part["scale"],
        "stiffness": xr.where(has_stiffness, stiffness, 0.0),
        "restitution": xr.where(has_restitution, part.get("pair_restitution", part["restitution"]), 1.0),
        "gap": xr.where(by_law(lambda item: item.has_contact), gap, np.inf),
        **_building_columns(part, sweep),
    }
    result = {}
    for name, column in columns.items():
        numbers = column.variable.copy(data=_as_numbers(column.values))
        inner = {"pair": gap.sizes["pair"]} if name in ("stiffness", "restitution") else {}
        inner |= {str(dim): size for dim, size in numbers.sizes.items() if dim not in sizes}
        result[name] = numbers.set_dims(sizes | inner).values.reshape(math.prod(sizes.values()), -1)
    return result


def _building_columns(part: xr.Dataset, sweep: Mapping[str, Any]) -> dict[str, xr.DataArray]:
    """Return the building properties of scenarios; what is the building's own as in `BUILDING_DEFAULTS`."""
    import xarray as xr

    buildings, building = scene_of(sweep["scene"]).buildings, part["building"]
    columns: dict[str, xr.DataArray] = {}
    for kind, default in BUILDING_DEFAULTS.items():
        fallback = xr.DataArray(default) if kind == "damping_ratio" else xr.full_like(building, default, dtype=float)
        columns[kind] = part.get(kind, fallback)
    for axis in axes_of(sweep).named_axes("building") if sweep["cases"] is None else ():
        if axis.name is not None:
            columns[axis.kind] = xr.where(building == axis.name, part[axis.dimension], columns[axis.kind])
    hardening = xr.DataArray([item.uniform_hardening for item in buildings], dims="building")
    columns["hardening"] = columns["hardening"].where(columns["hardening"] != hardening)
    ratio, *others = {item.damping_ratio for item in buildings}
    if isinstance(ratio, float) and not others:
        columns["damping_ratio"] = columns["damping_ratio"].where(columns["damping_ratio"] != ratio)
    return columns


def varies_buildings(cube: xr.Dataset, sweep: Mapping[str, Any]) -> bool:
    """Whether building properties vary in a cube: such scenarios run in kernels of their own."""
    return any(
        bool(((column != BUILDING_DEFAULTS[kind]) & column.notnull()).any())
        for kind, column in _building_columns(cube, sweep).items()
    )


def read_rows(path: str, cube: xr.Dataset, where: Mapping[str, slice], kind: np.dtype) -> np.ndarray:
    """Return the results of scenarios that lie side by side as rows of a table."""
    rows = np.zeros([part.stop - part.start for part in where.values()], kind)
    for name in kind.names or ():
        if name in cube.variables:
            with reading(path):  # a variable alone: its coordinates would take most of the time
                values = cube.variables[name].isel(where).transpose(*where, *VARIABLES[name].dims).values
            rows[name] = as_stored(name, values)
    return rows.ravel()
