"""The faults of `mutants.py` are faults of the package as it is."""

from __future__ import annotations

import mutants
import pytest

import pounding_sweep


@pytest.mark.parametrize(("name", "text"), [each[:2] for each in mutants.MUTANTS], ids=lambda x: x[:30])
def test_what_a_fault_changes_is_there(name, text):
    file = mutants.Path(pounding_sweep.__file__).parent / name
    assert text in file.read_text(encoding="utf-8")
