"""What a stiffness matrix costs in place of a chain of storeys."""

from __future__ import annotations

import pytest

from benchmarks.frames import COSTS, row_cost


@pytest.mark.parametrize(
    ("storeys", "method"), [pytest.param(*row, marks=[pytest.mark.slow] * (row[0] > 3)) for row in COSTS]
)
def test_a_matrix_costs_little_more_than_its_chain(storeys, method, within):
    within(lambda: row_cost(storeys, method, 5), COSTS[storeys, method])
