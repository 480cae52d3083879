"""What every other part stands on: errors, text, files, and names that are loaded where they are first used."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from inspect import isfunction
from typing import Any

from pounding_sweep.base.errors import checked_arguments

STANDARD_GRAVITY = 9.81
"""Acceleration of one g in m/s2, as in the pounding literature (not 9.80665)."""


def attribute(package: str, home: Mapping[str, str], name: str) -> Any:
    """Return a name of a package, as its ``__getattr__`` (PEP 562); functions and classes then check arguments."""
    if name in home:
        value = getattr(module := import_module(home[name]), name)
        for owner, part in ((module, name), (value, "__init__"), (value, "run")):
            function = getattr(owner, part, None)
            if isfunction(function) and not hasattr(function, "__wrapped__"):
                setattr(owner, part, checked_arguments(function))  # the same object everywhere, as pickle asks
        return getattr(module, name)
    raise AttributeError(f"module {package!r} has no attribute {name!r}")
