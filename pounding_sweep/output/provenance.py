"""What made a cube: the package, its source and libraries, and the cubes that results were taken from.

The attribute ``merged_from`` lists the cubes that one was merged from, ``extended_from`` names the one that a sweep
took results from. What they say of a cube is what it said of itself, so that either may hold others of both kinds.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Hashable, Iterator, Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from pounding_sweep.output.dataset import SOURCE_ATTRIBUTE

#: Libraries that the bits of a result depend on.
LIBRARIES = ("numba", "llvmlite", "numpy")
#: Attributes that name cubes -> how results came from those.
ORIGINS = {"merged_from": "merged from", "extended_from": "extended from"}
#: What is kept of a cube whose results are in another one, beside its versions.
_KEPT = (
    *("history", "sweep_sha256", "scenarios_asked", "scenarios_run", "scenarios_never_touching"),
    *("audit_touching", "audit_share", SOURCE_ATTRIBUTE),
)


def plain(value: Any) -> Any:
    """Return the value of an attribute as JSON can hold it."""
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else value


def library_attribute(library: str) -> str:
    """Return the attribute in which a cube names the version of a library."""
    return f"{library}_version"


#: Attributes that say by what results were made, beside the package's version.
MAKER_ATTRIBUTES = (SOURCE_ATTRIBUTE, *map(library_attribute, LIBRARIES))


class Maker(NamedTuple):
    """What made results, of one version of the package; None where a cube does not name it."""

    source: str | None
    numba: str | None
    llvmlite: str | None
    numpy: str | None


def makers(told: Mapping[Any, Any]) -> set[Maker]:
    """Return what made the results of a cube: several only where it was merged."""
    parts = _listed(told, "merged_from")
    if parts:
        return set().union(*map(makers, parts))
    return {Maker(*(str(told[key]) if key in told else None for key in MAKER_ATTRIBUTES))}


def origin(file: str, attributes: Mapping[Hashable, Any]) -> dict[str, Any]:
    """Return what a cube says of one that results were taken from."""
    found: dict[str, Any] = {"file": file}
    found |= {key: plain(attributes[key]) for key in _KEPT if key in attributes}
    found |= {str(key): plain(value) for key, value in attributes.items() if str(key).endswith("_version")}
    return found | {key: json.loads(attributes[key]) for key in ORIGINS if key in attributes}


def runs(file: str, attributes: Mapping[Hashable, Any]) -> dict[str, dict[str, Any]]:
    """Return what is said of the runs that the results of a cube are from: several only where it was merged."""
    return _runs(origin(file, attributes))


def _runs(told: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    for part in _listed(told, "merged_from"):
        found |= _runs(part)
    if found and ("audit_touching" not in told or any("audit_touching" in part for part in found.values())):
        return found
    nameless = {key: value for key, value in told.items() if key != "file"}
    return {json.dumps(nameless, sort_keys=True): dict(told)}


def origins(told: Mapping[Any, Any], depth: int = 0) -> Iterator[tuple[int, str, dict[str, Any]]]:
    """Go through the cubes that results were taken from, and through those that theirs were taken from."""
    for key, how in ORIGINS.items():
        for each in _listed(told, key):
            if not isinstance(each, dict) or not isinstance(each.get("file"), str):
                msg = f"{key} names no file"
                raise ValueError(msg)
            yield depth, how, each
            yield from origins(each, depth + 1)


def _listed(told: Mapping[Any, Any], key: str) -> list[Any]:
    """Return what an attribute names: JSON in a file, one object or a list of some."""
    found = told.get(key, [])
    found = json.loads(found) if isinstance(found, str) else found
    return [found] if isinstance(found, dict) else list(found)


@cache
def package_digest() -> str:
    """Digest of the package's own source: chunks and cubes of another version of it are never taken up."""
    from importlib.resources import files

    found = hashlib.sha256()
    folders = [files("pounding_sweep")]
    while folders:
        for entry in sorted(folders.pop().iterdir(), key=lambda e: e.name):
            if entry.name.startswith("."):  # locks and copies of editors
                continue
            if entry.is_dir() and entry.name != "__pycache__":
                folders.append(entry)
            elif entry.name.endswith((".py", ".json")):  # the second: measured costs, by which methods are chosen
                found.update(entry.name.encode() + b"\0" + entry.read_bytes())
    return found.hexdigest()


@cache
def library_versions() -> Mapping[str, str]:
    """Return the versions of the libraries that the bits of a result depend on."""
    from importlib.metadata import version

    return MappingProxyType({name: version(name) for name in LIBRARIES})


def libraries() -> str:
    """Name those libraries, with their versions."""
    return ", ".join(f"{name} {version}" for name, version in library_versions().items())


@cache
def fingerprint() -> str:
    """Say what the bits of a result depend on beside the sweep: processes that share a sweep must agree in it."""
    from pounding_sweep.output.dataset import package_version

    return f"pounding_sweep {package_version()} (source {package_digest()[:12]}), {libraries()}"
