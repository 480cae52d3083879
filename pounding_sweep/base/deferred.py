"""Names that are loaded where they are first used, so that importing the package is fast."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any


def attribute(package: str, home: Mapping[str, str], name: str) -> Any:
    """Return a name of a package: its module-level ``__getattr__`` (PEP 562)."""
    if name in home:
        return getattr(import_module(home[name]), name)
    raise AttributeError(f"module {package!r} has no attribute {name!r}")
