"""Random rows by the exact scheme and by heyoka, and by the reference solver of the tests."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.agreement import by_engine, by_heyoka, by_reference, difference, draw


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1000, 1020))
def test_three_programs_give_one_answer(seed):
    pytest.importorskip("heyoka")
    case = draw(seed)
    mine, taylor = by_engine(case), by_heyoka(case)
    assert mine["impact_count"].sum() > 0
    assert difference(mine, taylor) < 1e-9
    assert difference(mine, by_reference(case)) < 1e-6


def test_differences():
    one = {"impact_count": np.array([2.0]), "impact_force_max": np.array([50.0, 100.0])}
    assert difference(one, one | {"impact_force_max": np.array([51.0, 100.0])}) == pytest.approx(0.01)
    assert difference(one, one | {"impact_count": np.array([3.0])}) == np.inf
