"""What the calibration measures, and what it writes."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scenes import OUTPUTS, row

from benchmarks import calibrate
from pounding_sweep.model.laws import get_law
from pounding_sweep.plan import advice
from pounding_sweep.plan.advice import Curve


@pytest.mark.slow
def test_calibration_measures_an_order(monkeypatch):
    """A short calibration of one law finds the fourth order of RK4, and what it writes can be read."""
    monkeypatch.setattr(calibrate, "SCENARIOS", 16)
    monkeypatch.setattr(calibrate, "FEWEST", 8)
    monkeypatch.setattr(calibrate, "OUTPUTS", tuple(OUTPUTS))
    monkeypatch.setattr(calibrate, "scenes", lambda: (row(),))
    law = get_law("kelvin_voigt")
    cell = calibrate.RandomScenarios.draw(law, row(), calibrate.records()[0], seed=3)
    monkeypatch.setattr(calibrate, "CLASSES", {"contacts": ("impact_force_max",)})
    reference = cell.run("rk4", "float64", 128)
    points = calibrate.curve(calibrate.lines(cell, ("rk4", "float64"), reference, np.arange(16))["contacts"])
    known = Curve(*zip(*points, strict=True))
    order = math.log(known.needed(1e-8) / known.needed(1e-6)) / math.log(100.0)
    assert order == pytest.approx(1 / 4, abs=0.08)


def test_written_measurements_can_be_read(tmp_path):
    laws = {"linear": {"motions": [[1.0, 0.1], [2.0, 0.01]]}, "none": {"motions": [[4.0, 1e-3]]}}
    data = {"about": {"quantile": 0.9}, "cost": {"rk4/float64": 2.5}, "errors": {"rk4/float64": laws}}
    calibrate.write(data, tmp_path / "m.json")
    text = (tmp_path / "m.json").read_text()
    assert json.loads(text) == data
    known = advice.read_measured(json.loads(text))
    assert known.curves["rk4", "float64", "linear", "motions"] == Curve((1.0, 2.0), (0.1, 0.01))
    assert known.cost == {("rk4", "float64"): 2.5}
    # measuring one scheme again keeps the others
    again = {"about": {"quantile": 0.95}, "cost": {"newmark/float64": 4.0}, "errors": {"newmark/float64": {}}}
    both = calibrate.merged(data, again)
    assert both["about"] == again["about"]
    assert list(both["cost"]) == list(both["errors"]) == ["rk4/float64", "newmark/float64"]
