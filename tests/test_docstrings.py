"""The sources: examples in docstrings run, imports are declared, the faults of `mutants.py` are there."""

from __future__ import annotations

import doctest
import importlib
import re
import sys
import tomllib
from pathlib import Path

import mutants
import pytest

import pounding_sweep

PACKAGE = Path(pounding_sweep.__file__).parent
#: Modules whose docstrings hold an example, by the name under which they are imported.
MODULES = [
    ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")
    for path in sorted(PACKAGE.rglob("*.py"))
    if any(">>> " in line and "+SKIP" not in line for line in path.read_text(encoding="utf-8").splitlines())
]
#: Those whose examples run kernels.
RUN = {
    *(
        "accuracy.certificate",
        "accuracy.law_check",
        "accuracy.tradeoff",
        "analysis.comparisons.gaps",
        "analysis.spectra",
        "figures",
        "figures.gallery.scenario",
    ),
    *("output.audited", "output.describe", "output.merge", "output.netcdf", "pages.report", "pages.view"),
    "run.simulate",
}


@pytest.mark.parametrize(
    "module", [pytest.param(name, marks=[pytest.mark.slow] * (name.partition(".")[2] in RUN)) for name in MODULES]
)
def test_examples_run(module):
    result = doctest.testmod(importlib.import_module(module))
    assert result.attempted > 0
    assert result.failed == 0


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


@pytest.mark.parametrize(("name", "text"), [each[:2] for each in mutants.MUTANTS], ids=lambda x: x[:30])
def test_what_a_fault_changes_is_there(name, text):
    file = mutants.Path(pounding_sweep.__file__).parent / name
    assert text in file.read_text(encoding="utf-8")
