"""What the package imports is declared, each by the distribution that brings it."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
#: Modules of distributions that others pin to one version.
PINNED = {"pydantic_core": "pydantic"}


def statements(node):
    """All below a node; expressions, which hold none, are passed over."""
    for part in ("body", "orelse", "finalbody", "handlers", "cases"):
        for child in getattr(node, part, ()):
            yield child
            yield from statements(child)


def imported(folder):
    """Top-level names of all modules imported below a folder, wherever in a file."""
    for file in folder.rglob("*.py"):
        for node in statements(ast.parse(file.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module] if isinstance(node, ast.ImportFrom) and not node.level else []
            yield from (name.partition(".")[0] for name in names)


def plain(name):
    return re.sub(r"[-_.]+", "_", name).lower()


def test_every_import_is_declared():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = [*project["optional-dependencies"]["records"], *project["optional-dependencies"]["export"]]
    declared = {plain(re.split(r"[<>=\[]", each)[0]) for each in [*project["dependencies"], *extras]}
    found = {PINNED.get(name, name) for name in imported(ROOT / "pounding_sweep")}
    unknown = {name for name in found if name not in sys.stdlib_module_names and plain(name) not in declared}
    assert unknown == {"pounding_sweep"}
