"""What the package imports is declared, each by the distribution that brings it."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
#: A line that imports: ``import x.y``, ``from x.y import z``.
IMPORT = re.compile(r"^ *(?:import (\w+)|from (\w+)[\w.]* import )", re.M)


def test_every_import_is_declared():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    texts = [*project["dependencies"], *extras["records"], *extras["export"]]
    declared = {re.sub(r"[-_.]+", "_", re.split(r"[<>=\[]", text)[0]).lower() for text in texts}
    files = (file.read_text(encoding="utf-8") for file in (ROOT / "pounding_sweep").rglob("*.py"))
    imported = {whole or first for text in files for whole, first in IMPORT.findall(text)}
    imported -= {"pounding_sweep", "pydantic_core", *sys.stdlib_module_names}  # pydantic pins its core
    assert {name for name in imported if name.lower() not in declared} == set()
