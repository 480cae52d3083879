"""Names that are loaded where they are first used, so that importing the package is fast."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def attribute(package: str, home: Mapping[str, str], name: str) -> Any:
    """Return a name of a package: its module-level ``__getattr__`` (PEP 562)."""
    if name in home:
        return getattr(import_module(home[name]), name)
    msg = f"module {package!r} has no attribute {name!r}"
    raise AttributeError(msg)


def function_at(place: str) -> Callable[..., Any]:
    """Return the function of a place in a registry, ``module:function``."""
    module, _, name = place.partition(":")
    found: Callable[..., Any] = getattr(import_module(module), name)
    return found
