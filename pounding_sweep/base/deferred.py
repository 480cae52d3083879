"""Names and entries that are loaded where they are first used, so that importing the package is fast."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, Generic, TypeVar

Entry = TypeVar("Entry")


def attribute(package: str, home: Mapping[str, str], name: str) -> Any:
    """Return a name of a package: its module-level ``__getattr__`` (PEP 562)."""
    if name in home:
        return getattr(import_module(home[name]), name)
    raise AttributeError(f"module {package!r} has no attribute {name!r}")


def key_of(module: str) -> str:
    """Return the key of what a module of a `Registry` defines: the module's own name, with hyphens."""
    return module.rpartition(".")[2].replace("_", "-")


class Registry(Mapping[str, Entry], Generic[Entry]):
    """Entries by key, one in each module of a package: keys are known by its file's name, entries by its import."""

    def __init__(self, package: str) -> None:
        self._package = package
        self._entries: dict[str, Entry] = {}

    @cached_property
    def _modules(self) -> dict[str, str]:
        names = sorted(module.name for module in iter_modules(import_module(self._package).__path__))
        return {key_of(name): f"{self._package}.{name}" for name in names}

    def add(self, module: str, entry: Entry) -> None:
        """Register what a module defines."""
        self._entries[key_of(module)] = entry

    def __getitem__(self, key: str) -> Entry:
        if key not in self._entries:
            import_module(self._modules[key])
        return self._entries[key]

    def __contains__(self, key: object) -> bool:
        return key in self._modules

    def __iter__(self) -> Iterator[str]:
        return iter(self._modules)

    def __len__(self) -> int:
        return len(self._modules)
