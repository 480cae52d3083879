"""What the package imports is declared, each by the distribution that brings it."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
#: Modules of distributions that others pin to one version.
PINNED = {"pydantic_core": "pydantic"}
#: A line that imports: ``import x.y``, ``from x.y import z``.
IMPORT = re.compile(r"^ *(?:import (\w+)|from (\w+)[\w.]* import )", re.M)


def imported(folder):
    """Top-level names of all modules imported below a folder, wherever in a file."""
    for file in folder.rglob("*.py"):
        for whole, first in IMPORT.findall(file.read_text(encoding="utf-8")):
            yield whole or first


def plain(name):
    return re.sub(r"[-_.]+", "_", name).lower()


def test_every_import_is_declared():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = [*project["optional-dependencies"]["records"], *project["optional-dependencies"]["export"]]
    declared = {plain(re.split(r"[<>=\[]", each)[0]) for each in [*project["dependencies"], *extras]}
    found = {PINNED.get(name, name) for name in imported(ROOT / "pounding_sweep")}
    unknown = {name for name in found if name not in sys.stdlib_module_names and plain(name) not in declared}
    assert unknown == {"pounding_sweep"}
