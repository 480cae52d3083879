"""Examples in docstrings run as they stand."""

from __future__ import annotations

import doctest
import importlib
from pathlib import Path

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
