"""What scenarios, sweeps and results are known by: what made a cube, and whether it is what its sweep wrote.

The attribute ``merged_from`` lists the runs that the results of a merged cube are from, ``extended_from`` names the
cube that a sweep took results from.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import InputError
from pounding_sweep.output.dataset import SOURCE_ATTRIBUTE, package_version
from pounding_sweep.output.netcdf import reading
from pounding_sweep.spec import axes

if TYPE_CHECKING:
    import xarray as xr


#: What of a record decides on results, in the description of a sweep.
MOTION = ("sha256", "dt", "n_points", "scale")
#: What tells scenarios of one study apart, as coordinates of listed cases are named.
KNOWN_BY = (
    *("law", "record", "scale", "restitution", "contact_stiffness", "pair_gap"),
    *("period_factor", "mass_factor", "damping_ratio", "strength_factor", "hardening"),
)


def motion_of(record: object) -> tuple[object, ...]:
    """Return what a record, or what a cube says of one, is known by, whatever its name."""
    return tuple(record[key] if isinstance(record, Mapping) else getattr(record, key) for key in MOTION)


#: Shifts and pairs of odd factors by which each number changes all bits of a key (MurmurHash3 and SplitMix64).
_MIXING = [
    (np.uint64(33), np.array([0xFF51AFD7ED558CCD, 0xBF58476D1CE4E5B9], np.uint64)),
    (np.uint64(29), np.array([0xC4CEB9FE1A85EC53, 0x94D049BB133111EB], np.uint64)),
]


def scenario_keys(known: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return 16 bytes for each scenario by values of shape (scenarios, ...): the same where all values are equal."""
    keys = np.zeros((len(next(iter(known.values()))), 2), np.uint64)
    for column in known.values():
        numbers = column
        if column.dtype.kind not in "iuf":
            texts, index = np.unique(column.astype(str), return_inverse=True)
            digests = [hashlib.blake2b(text.encode(), digest_size=6).digest() for text in texts.tolist()]
            numbers = np.array([int.from_bytes(digest) for digest in digests])[index.reshape(column.shape)]
        for values in numbers.reshape(len(numbers), -1).T:
            bits = values.astype(float) + 0.0  # -0.0 is 0.0
            bits[np.isnan(bits)] = np.nan  # which may have many forms
            keys ^= bits.view(np.uint64)[:, None]
            for shift, factors in _MIXING:
                keys ^= keys >> shift
                keys *= factors
            keys ^= keys >> np.uint64(32)
    return keys.view("V16")[:, 0]


def places_of(wanted: np.ndarray, rising: np.ndarray) -> np.ndarray:
    """Return where keys stand among rising ones; -1 where they don't."""
    places = np.searchsorted(rising, wanted).clip(max=len(rising) - 1)
    return np.where(rising[places] == wanted, places, -1)


#: Libraries that the bits of a result depend on.
LIBRARIES = ("numba", "llvmlite", "numpy")
#: Attributes that name cubes -> how results came from those.
ORIGINS = {"merged_from": "merged from", "extended_from": "extended from"}
#: Attributes of a cube that others say of it, next to its versions.
_DESCRIBED = (
    *("history", "sweep_sha256", "scenarios_asked", "scenarios_run", "scenarios_never_touching"),
    *("audit_touching", "audit_share", SOURCE_ATTRIBUTE),
)


def plain(value: Any) -> Any:
    """Return the value of an attribute as JSON can hold it."""
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else value


#: Attributes that say by what results were made, next to the package's version.
MAKER_ATTRIBUTES = (SOURCE_ATTRIBUTE, *(f"{name}_version" for name in LIBRARIES))


def sources(attributes: Mapping[Any, Any], key: str) -> list[dict[str, Any]]:
    """Return what an attribute says of the cubes that results were taken from."""
    found = json.loads(attributes.get(key, "[]"))
    return [found] if isinstance(found, dict) else list(found)


def source(file: str, attributes: Mapping[Any, Any]) -> dict[str, Any]:
    """Return what a cube says of one that results were taken from."""
    described = [key for key in attributes if key in _DESCRIBED or str(key).endswith("_version")]
    made_from = [each["file"] for key in ORIGINS for each in sources(attributes, key)]
    return {
        "file": file,
        **{str(key): plain(attributes[key]) for key in described},
        **({"made_from": made_from} if made_from else {}),
    }


def runs(cubes: Mapping[str, Mapping[Any, Any]]) -> list[dict[str, Any]]:
    """Return the runs that the results of cubes are from, by their files and attributes; copies count once."""
    found: dict[str, dict[str, Any]] = {}
    for file, attributes in cubes.items():
        for run in sources(attributes, "merged_from") or [source(file, attributes)]:
            found.setdefault(json.dumps({**run, "file": ""}, sort_keys=True), run)
    return list(found.values())


def makers(attributes: Mapping[Any, Any]) -> set[tuple[str | None, ...]]:
    """Return the source and libraries that made the results of a cube: several only if it was merged."""
    return {tuple(run.get(key) and str(run[key]) for key in MAKER_ATTRIBUTES) for run in runs({"": attributes})}


@cache
def package_digest() -> str:
    """Digest of the package's own source: chunks and cubes of another version of it are never reused."""
    digest, root = hashlib.sha256(), Path(__file__).parents[1]
    for path in sorted(root.rglob("*")):
        name = f"/{path.relative_to(root)}"
        # the second: measured costs, by which methods are chosen; what is hidden is of editors
        if name.endswith((".py", ".json")) and "/." not in name:
            digest.update(name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


@cache
def library_versions() -> Mapping[str, str]:
    """Return the versions of the libraries that the bits of a result depend on."""
    from importlib.metadata import version

    return {name: version(name) for name in LIBRARIES}


def libraries() -> str:
    """Name those libraries, with their versions."""
    return ", ".join(f"{name} {version}" for name, version in library_versions().items())


@cache
def fingerprint() -> str:
    """Say what the bits of a result depend on beside the sweep: processes that share a sweep must agree in it."""
    return f"pounding_sweep {package_version()} (source {package_digest()[:12]}), {libraries()}"


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


def differing_sweeps(one: Mapping[str, Any], two: Mapping[str, Any]) -> list[tuple[str, Any, Any]]:
    """Return in what two recorded sweeps are not of one study, laws of a user's own by their digests."""
    a, b = one.get(OWN_LAWS, {}), two.get(OWN_LAWS, {})
    laws = [(f"law {key!r} as SHA-256", *(each[key]["sha256"][:12] for each in (a, b))) for key in sorted(a.keys() & b)]
    keys = sorted({*one, *two} - AXIS_KEYS - BUILDING_AXES - FREE - {OWN_LAWS})
    pairs = [*laws, *((key, one.get(key), two.get(key)) for key in keys)]
    return [pair for pair in pairs if pair[1] != pair[2]]


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


def recorded_axes(sweep: Mapping[str, Any]) -> dict[str, Sequence[Any] | int]:
    """Return the axes that the cube of a recorded sweep should have, for `check_axes`."""
    if sweep["cases"] is not None:
        return {"case": len(sweep["cases"])}
    arguments = axes.axes_of(sweep)
    found: dict[str, Any] = arguments.along(sweep["laws"], [record["name"] for record in sweep["records"]])
    found["gap"] = arguments.gaps or 1
    return found
