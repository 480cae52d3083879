"""What made a result: the package's own source, and the compiler that its kernels went through."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType

from pounding_sweep.output.provenance import LIBRARIES


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
