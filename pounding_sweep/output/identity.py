"""What cubes and results are known by: what made a cube, where its results are from, which sweep it is of."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import InputError, repr_short
from pounding_sweep.output.dataset import SOURCE_ATTRIBUTE, VERSION_ATTRIBUTE, package_version
from pounding_sweep.request.axes import AXES, FACTOR_KINDS, axes_of

if TYPE_CHECKING:
    import xarray as xr

#: Libraries that the bits of a result depend on.
LIBRARIES = ("numba", "llvmlite", "numpy")
#: Attributes that say by what results were made, next to the package's version.
MAKER_ATTRIBUTES = (SOURCE_ATTRIBUTE, *(f"{name}_version" for name in LIBRARIES))
#: What helps where two of them differ.
MAKERS_REMEDY = (
    "The same scenario may have another result with each: run one again with what made the other, or with the "
    "installed package"
)
#: Attributes that name cubes -> how results came from those.
ORIGINS = {"merged_from": "merged from", "extended_from": "extended from"}
#: Attributes of a cube that others say of it, next to its versions.
_DESCRIBED = (
    *("history", "sweep_sha256", "scenarios_asked", "scenarios_run", "scenarios_never_touching"),
    *("audit_touching", "audit_share", SOURCE_ATTRIBUTE),
)
#: What of a record decides on results, in the description of a sweep.
MOTION = ("sha256", "dt", "n_points", "scale")
#: Axes in the description of a sweep, and those that are given for some buildings or pairs: [name, values].
AXIS_KEYS = frozenset({"laws", *(name for name, axis in AXES.items() if not axis.by)})
NAMED_AXES = frozenset(FACTOR_KINDS)
#: What else sweeps of one study may differ in: no result of a scenario depends on it.
FREE = frozenset({"cases", "design", "records", "records_left_out", "title", "audit"})
#: Laws of a user's own there, by key.
CUSTOM_LAWS = "user_laws"


def plain(value: Any) -> Any:
    """Return the value of an attribute as JSON can hold it."""
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else value


def sources(attributes: Mapping[Any, Any], key: str) -> list[dict[str, Any]]:
    """Return what an attribute says of the cubes that results were taken from."""
    described = json.loads(attributes.get(key, "[]"))
    return [described] if isinstance(described, dict) else described


def source(file: str, attributes: Mapping[Any, Any]) -> dict[str, Any]:
    """Return what a cube says of one that results were taken from."""
    described = {str(key): plain(value) for key, value in attributes.items()}
    names = [name for name in described if name in _DESCRIBED or name.endswith("_version")]
    made_from = [item["file"] for key in ORIGINS for item in sources(attributes, key)]
    return {
        "file": file,
        **{name: described[name] for name in names},
        **({"made_from": made_from} if made_from else {}),
    }


def runs(cubes: Mapping[str, Mapping[Any, Any]]) -> list[dict[str, Any]]:
    """Return the runs that the results of cubes are from, by their files and attributes; copies count once."""
    result: dict[str, dict[str, Any]] = {}
    for file, attributes in cubes.items():
        for run in sources(attributes, "merged_from") or [source(file, attributes)]:
            result.setdefault(json.dumps({**run, "file": ""}, sort_keys=True), run)
    return list(result.values())


def makers(attributes: Mapping[Any, Any]) -> set[tuple[str | None, ...]]:
    """Return the source and libraries that made the results of a cube: several only if it was merged."""
    return {tuple(run.get(key) and str(run[key]) for key in MAKER_ATTRIBUTES) for run in runs({"": attributes})}


def made_by(attributes: Mapping[Any, Any]) -> dict[str, Any]:
    """Return the version, source and libraries that made a cube, by attribute; all of them if these are several."""
    columns = zip(MAKER_ATTRIBUTES, zip(*sorted(makers(attributes), key=str), strict=True), strict=True)
    several = {key: " and ".join(dict.fromkeys(map(str, values))) for key, values in columns}
    return {VERSION_ATTRIBUTE: plain(attributes.get(VERSION_ATTRIBUTE)), **several}


@cache
def package_digest() -> str:
    """Digest of the package's own source: chunks and cubes of another version of it are never reused."""
    digest, root = hashlib.sha256(), Path(__file__).parents[1]
    for path in sorted(root.rglob("*")):
        name = f"/{path.relative_to(root)}"
        # data too: laws and measured costs, by which methods are chosen; what is hidden is of editors
        if name.endswith((".py", ".json", ".toml")) and "/." not in name:
            digest.update(name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


@cache
def library_versions() -> Mapping[str, str]:
    """Return the versions of the libraries that the bits of a result depend on."""
    from importlib.metadata import version

    return {name: version(name) for name in LIBRARIES}


def installed() -> dict[str, str]:
    """Return what `made_by` gives for a cube that is made now."""
    versions = {f"{name}_version": version for name, version in library_versions().items()}
    return {VERSION_ATTRIBUTE: package_version(), SOURCE_ATTRIBUTE: package_digest(), **versions}


@cache
def libraries() -> str:
    """Name those libraries, with their versions."""
    return ", ".join(f"{name} {version}" for name, version in library_versions().items())


@cache
def fingerprint() -> str:
    """Say what the bits of a result depend on beside the sweep: processes that share a sweep must agree in it."""
    return f"pounding_sweep {package_version()} (source {package_digest()[:12]}), {libraries()}"


def recorded_sweep(path: str, cube: xr.Dataset) -> dict[str, Any]:
    """Return what a cube says of its sweep; raises `InputError` if it is a part of what that sweep made."""
    text = str(cube.attrs["sweep"])
    if hashlib.sha256(text.encode()).hexdigest() != cube.attrs.get("sweep_sha256"):
        raise InputError(
            f"{path!r} does not say what its sweep was: its attribute 'sweep' is damaged; make the cube again"
        )
    sweep: dict[str, Any] = json.loads(text)
    axes, records = axes_of(sweep), [record["name"] for record in sweep["records"]]
    expected: dict[str, Any] = {"case": sweep["cases"]}
    if sweep["cases"] is None:
        expected = {**axes.along(sweep["laws"], records), "gap": axes.gaps}
    dims, fault = [str(dim) for dim in cube["status"].dims], ""
    if {*dims} != {*expected}:
        fault = f"the axes {', '.join(dims) or 'none'}, its sweep had {', '.join(expected)}"
    for name in dims if not fault else ():
        values = cube[name].values.tolist()
        if name == "case" and len(values) != len(expected[name]):
            fault = f"{len(values)} values of case, its sweep had {len(expected[name])}"
        elif name != "case" and expected[name] is not None and values != list(expected[name]):
            fault = f"other values of {name} than its sweep"
    if fault:
        raise InputError(f"{path!r} has {fault}; give the cube as it was made, not a part of it")
    return sweep


def motions_of(sweep: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Return what the records of a sweep are known by, by their names."""
    return {record["name"]: [record[key] for key in MOTION] for record in sweep["records"]}


def differing_sweeps(one: Mapping[str, Any], two: Mapping[str, Any]) -> list[tuple[str, Any, Any]]:
    """Return in what two recorded sweeps are not of one study, laws of a user's own by their digests."""
    a, b = one.get(CUSTOM_LAWS, {}), two.get(CUSTOM_LAWS, {})
    laws = [(f"law {key!r} as SHA-256", a[key]["sha256"][:12], b[key]["sha256"][:12]) for key in sorted(a.keys() & b)]
    keys = sorted({*one, *two} - AXIS_KEYS - NAMED_AXES - FREE - {CUSTOM_LAWS})
    pairs = [*laws, *((key, one.get(key), two.get(key)) for key in keys)]
    return [pair for pair in pairs if pair[1] != pair[2]]


def check_one_study(first: str, second: str, rows: Iterable[tuple[str, Any, Any]], remedy: str) -> None:
    """Raise `InputError` where two cubes, or a cube and a sweep, differ; what they are, and both values, are given."""
    texts = [f"{key} is {repr_short(a)} in the first and {repr_short(b)} in the second" for key, a, b in rows if a != b]
    if texts:
        raise InputError(f"{first} and {second} are not parts of one study: {'; '.join(texts)}. {remedy}")
