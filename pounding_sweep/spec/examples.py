"""The example sweeps that the package comes with: those of the folder ``sweeps`` of its source."""

from __future__ import annotations

import re
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

from pounding_sweep.base.files import near_file

_PACKAGE = Path(__file__).parents[1]
#: Where the examples are: in an installed package, and beside the package in a clone.
_FOLDERS = (_PACKAGE / "sweeps", _PACKAGE.parent / "sweeps")


@cache
def examples() -> dict[str, Path]:
    """Return the file of each example sweep, by its name."""
    files = next((found for folder in _FOLDERS if (found := sorted(folder.glob("*.toml")))), [])
    return {file.stem: file for file in files}


def _read(name: str) -> dict[str, Any]:
    return tomllib.loads(examples()[name].read_text(encoding="utf-8"))


def example_title(name: str) -> str:
    """Return what an example shows."""
    return str(_read(name)["title"])


def example_records(name: str) -> list[str]:
    """Return the records that an example takes by name."""
    return [record for record in _read(name)["sweep"]["records"] if isinstance(record, str)]


def example_files(name: str) -> list[Path]:
    """Return the files beside an example that it needs: its contact laws."""
    file = examples()[name]
    needed = re.findall(r"[\"'](\w+\.py):\w+[\"']", file.read_text(encoding="utf-8"))
    return [file.parent / law_file for law_file in dict.fromkeys(needed)]


def sweep_file_hint(path: str) -> str:
    """Say how a sweep file that does not exist can be written, or which one was meant."""
    name = Path(path).stem
    if name in examples():
        return f"; `pounding-sweep init {name}.toml --from {name}` writes it"
    near = near_file(Path(path)).strip()
    return f"; {near}" if near else "; `pounding-sweep init --list` shows the examples to begin with"
