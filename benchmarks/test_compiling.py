"""Kernels are compiled in little time: beside a plain function that numba compiles in the same process."""

from __future__ import annotations

import pytest

from benchmarks.compiling import OUTPUTS, kernel, measure, over_plain, quickstart
from pounding_sweep.engine.compile import compiling_seconds

#: The paper's row.
STOREYS = (3, 3, 3)


def test_the_first_kernels_take_few_plain_functions(measured, benchmark):
    """The quickstart's five kernels take about as long as three functions of 200 lines; as much again is too much."""
    ratios = measured(lambda: over_plain(quickstart()), lambda r: r <= 6.0)
    benchmark.extra_info["quickstart_over_plain"] = ratios
    assert ratios[-1] <= 6.0


@pytest.mark.parametrize(("method", "most"), [pytest.param("rk4", 2.0, marks=pytest.mark.slow), ("exact", 5.0)])
def test_a_new_row_with_all_outputs_takes_little(method, most, measured, benchmark):
    """What compiles before the first scenario of a row with all outputs: its runs without pounding and one law."""
    shapes = [kernel(STOREYS, method, law, OUTPUTS["all"]) for law in ("none", "hertz_damped")]
    ratios = measured(lambda: over_plain(shapes), lambda r: r <= most)
    benchmark.extra_info["row_over_plain"] = ratios
    assert ratios[-1] <= most


def test_another_law_takes_its_contacts_alone(measured, benchmark):
    """The second law of a row by `exact` finds its flight compiled."""
    first, second = (kernel(STOREYS, "exact", law, OUTPUTS["default"]) for law in ("hertz_damped", "hysteretic"))

    def share():
        alone, (_, after) = measure([second])[1][0], measure([first, second])[1]
        return after / alone

    ratios = measured(share, lambda r: r <= 0.7)
    benchmark.extra_info["another_law"] = ratios
    assert ratios[-1] <= 0.7


def test_the_estimate_knows_what_takes_long(measured, benchmark):
    """`plan` and `doctor` tell how long compiling takes: in ratios, whatever the machine, within a factor of two."""
    shapes = [
        kernel(STOREYS, "rk4", "none", OUTPUTS["default"]),
        kernel(STOREYS, "rk4", "linear", OUTPUTS["few"]),
        kernel(STOREYS, "newmark", "linear", OUTPUTS["all"]),
    ]

    def spread():
        seconds = [
            taken / compiling_seconds(shape.pieces) for taken, shape in zip(measure(shapes)[1], shapes, strict=True)
        ]
        return max(seconds) / min(seconds)

    found = measured(spread, lambda ratio: ratio <= 2.0)
    benchmark.extra_info["spread"] = found
    assert found[-1] <= 2.0
