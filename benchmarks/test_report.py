"""The report: costs at equal error, tables, JSON, figure."""

from __future__ import annotations

import json
import math

import pytest

from benchmarks.arithmetic import Arithmetic
from benchmarks.compare import Point, best_cost, cost_at
from benchmarks.figure import speed
from benchmarks.million import Run
from benchmarks.report import Report, Size, equal_error
from benchmarks.scaling import Growth
from benchmarks.sizes import Start
from benchmarks.throughput import Throughput


def line(title, *pairs):
    return [Point(title, title, "linear", "dt", 1e-3 / i, e, t) for i, (e, t) in enumerate(pairs, 1)]


POINTS = line("engine a", (1e-2, 1.0), (1e-4, 10.0)) + line("peer", (1e-3, 100.0), (1e-5, 400.0))


def test_costs_between_settings_lie_on_a_straight_line():
    assert cost_at(POINTS[2:], 1e-4) == pytest.approx(200.0)
    assert cost_at(POINTS[2:], 1e-3) == 100.0
    assert cost_at(POINTS[2:], 1e-1) == 100.0
    assert math.isnan(cost_at(POINTS[2:], 1e-6))
    assert best_cost(POINTS, 1e-5) == ("peer", 400.0)


def test_a_finer_setting_that_errs_more_is_never_preferred():
    """Errors need not fall along a line: the cheapest way over all of it counts."""
    assert cost_at(line("a", (1e-3, 1.0), (1e-5, 2.0), (1e-2, 4.0), (1e-6, 8.0)), 1e-5) == 2.0


def test_equal_errors_are_compared_with_the_cheapest_row_of_the_engine():
    assert equal_error(POINTS, "linear", 1e-4) == [
        ("engine a", pytest.approx(10.0), pytest.approx(1.0)),
        ("peer", pytest.approx(200.0), pytest.approx(20.0)),
    ]
    assert [title for title, _, _ in equal_error(POINTS, "linear", 1e-5)] == ["peer"]


@pytest.fixture
def report():
    return Report(
        {"processor": "one"},
        "The work.",
        points=POINTS,
        agreement=1e-9,
        missing=["tool: can't be imported"],
        arithmetic=Arithmetic(1.1, 1.2, 8),
        sizes=[Size(3, 3, 2.0, 1.0, Start(10.0, 0.1)), Size(2, 1, 4.0, 2.0, None)],
        axes={"scale": 0.9},
        growth=[Growth("workers", "s", (1.0, 2.0, 4.0), (8.0, 4.0, 2.0)), Growth("one", "s", (1.0,), (1.0,))],
        throughput=[Throughput(20_000, 2, 1.0, 1.8)],
        plan_seconds={1_000_000: 1.5},
        start={"python": 0.01},
        million=Run(1_000_000, 50.0, 2**29, 2**28),
    )


def test_report_is_json_with_what_follows_from_it(report):
    data = json.loads(report.to_json_text())
    assert data["growth"][0]["exponent"] == pytest.approx(-1.0)
    assert data["growth"][1]["exponent"] is None
    assert data["throughput"][0]["efficiency"] == pytest.approx(0.9)
    assert data["equal_error"][0]["tool"] == "engine a"


def test_tables_hold_every_part(report):
    text = report.to_markdown()
    rows = ("| 0.0001 | peer | 200 | 20.0 |", "| 3 x 3 | 9 | 2.00 | 1.00 | 10.0 | 0.100 |", "| `scale` | 0.90 |")
    for part in (*rows, "-1.00", "90%", "1,000,000", "1.10 times", "512 MiB", "tool: can't be imported"):
        assert part in text


def test_figure_has_a_line_of_its_own_for_every_tool():
    axes = speed(POINTS, "caption").axes[0]
    looks = {(one.get_color(), one.get_marker(), one.get_markerfacecolor()) for one in axes.get_lines()}
    assert [one.get_label() for one in axes.get_lines()] == ["engine a", "peer"]
    assert len(looks) == 2
    assert axes.get_xscale() == axes.get_yscale() == "log"
