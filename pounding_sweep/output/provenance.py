"""What made a cube: the package, its source and libraries, and the cubes that results were taken from.

The attribute ``merged_from`` lists the runs that the results of a merged cube are from, ``extended_from`` names the
cube that a sweep took results from.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np

from pounding_sweep.output.dataset import SOURCE_ATTRIBUTE

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


def library_attribute(library: str) -> str:
    """Return the attribute in which a cube names the version of a library."""
    return f"{library}_version"


#: Attributes that say by what results were made, next to the package's version.
MAKER_ATTRIBUTES = (SOURCE_ATTRIBUTE, *map(library_attribute, LIBRARIES))


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
    from importlib.resources import files

    digest = hashlib.sha256()
    folders = [files("pounding_sweep")]
    while folders:
        for entry in sorted(folders.pop().iterdir(), key=lambda e: e.name):
            if entry.name.startswith("."):  # locks and copies of editors
                continue
            if entry.is_dir() and entry.name != "__pycache__":
                folders.append(entry)
            elif entry.name.endswith((".py", ".json")):  # the second: measured costs, by which methods are chosen
                digest.update(entry.name.encode() + b"\0" + entry.read_bytes())
    return digest.hexdigest()


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
