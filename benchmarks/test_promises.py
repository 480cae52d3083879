"""The judge of promises: what it counts as kept, missed and unknown."""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from benchmarks.drawn_rows import CASES, KINDS, SHAPES, draw, earthquakes
from benchmarks.promises import ACCURACIES, ASKED, STEPS, Kept, judge, judged, reference, run_cases
from pounding_sweep.model.laws import LAWS
from pounding_sweep.variables.registry import CHANGE, Status, relative_errors

PROMISED = 1e-3
#: What each of seven scenarios is: right, off by two and by ten times what was promised, off and said so, diverged, off
#: from what did not converge, right but sensitive.
ERRORS = PROMISED * np.array([0.5, 2.0, 10.0, 50.0, 0.0, 50.0, 0.9])
STATUS = np.array([Status.OK, Status.OK, Status.OK, Status.UNSETTLED, Status.DIVERGED, Status.OK, Status.OK])


def tally():
    right = {name: np.ones((7, 1, 1)) for name in ("displacement_max", "impact_force_max")}
    found = {name: values.copy() for name, values in right.items()} | {"status": STATUS}
    found["impact_force_max"][:, 0, 0] += ERRORS
    change = np.full(7, 1e-6)
    change[5] = 0.2 * PROMISED
    amplification = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0 * PROMISED / CHANGE])
    return judged(found, (right, change), list(right), PROMISED, amplification)


def test_scenarios_that_miss_a_promise_are_counted():
    found = tally()
    assert (found.scenarios, found.unknown, found.unsettled, found.sensitive) == (4, 1, 1, 1)
    assert (found.missed, found.far, found.outputs) == (2, 1, Counter({"impact_force_max": 2}))
    np.testing.assert_allclose(found.worst, 10.0, rtol=0.02)


def test_tallies_add_up():
    more = Kept(scenarios=3, missed=1, worst=40.0, outputs=Counter({"impact_force_max": 1, "drift_max": 1}))
    total = tally() + more
    assert (total.scenarios, total.missed, total.far, total.worst) == (7, 3, 1, 40.0)
    assert total.outputs == {"impact_force_max": 3, "drift_max": 1}


@pytest.mark.parametrize("number", [2, 5])  # two buildings, and one between a wall and another
@pytest.mark.usefixtures("stub_module")
def test_a_drawn_row_is_judged_against_what_steps_converge_to(number):
    found = judge(number, 3, ["kelvin_voigt"], [], ["plain"], status=True)
    shape = "with a wall" if number == 5 else "several storeys"
    classes = {("all", ""), ("row", shape), ("kind", "plain"), ("law", "kelvin_voigt")}
    assert {tuple(of) for _, *of in found} == classes
    for (promise, *_), each in found.items():
        assert each == found[promise, "all", ""]
        assert 0.0 < each.worst < 1.0  # the error of these kernels shrinks with the step
        assert (each.missed, each.unknown, each.unsettled) == (0, 0, 0)
    promises = [f"accuracy {each:g}{of}" for each in ACCURACIES for of in ASKED]
    assert all(found[promise, "all", ""].scenarios == CASES for promise in promises)
    assert found["ok, by rules, rk4", "all", ""].scenarios == CASES * len(STEPS)
    assert 0 < found["ok, error_estimate, newmark", "all", ""].scenarios < CASES * len(STEPS)  # others are not ok


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.usefixtures("stub_module")
def test_rows_of_all_kinds_can_be_drawn(kind):
    laws, records = ["hertz_damped", "kelvin_voigt"], earthquakes()
    for number, storeys in enumerate(SHAPES):
        spec, plain = draw(1, number, laws, records, [kind]), draw(1, number, laws, records)
        if kind == "columns":
            assert spec.laws == ("kelvin_voigt",)
            continue
        assert spec.laws == plain.laws
        assert [each.scale for each in spec.cases] == [each.scale for each in plain.cases]
        alone = all(0 in both for both in pairwise(storeys))
        same = kind in ("plain", "varied") or (kind == "links" and alone)
        assert (spec.scene == plain.scene) == same
        assert (spec.cases == plain.cases) == (kind != "varied")


#: A storey without hardening that drifts 125 times its yield drift; floors that touch, part and near each other again
#: within one step; impacts that magnify what two runs in single precision round alike; a floor whose acceleration turns
#: twice as a soft bumper lets it go; a building beside such a bumper that has next to no energy left at the end.
MISSED_ONCE = [
    (43, 10, 8, 1e-4, "float32", ", no energies"),
    (43, 37, 3, 1e-3, "float64", ", no energies"),
    (43, 53, 3, 1e-3, None, ", no energies"),
    (43, 86, 15, 1e-3, "float64", ", no energies"),
    (44, 60, 14, 1e-3, None, ""),
]


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "number", "case", "accuracy", "precision", "asked"), MISSED_ONCE)
def test_what_was_missed_once_is_kept(seed, number, case, accuracy, precision, asked):
    folder = Path(os.environ.get("POUNDING_SWEEP_RECORDS", ""))
    files = [folder / f"{name}.AT2" for name in ("ARL090", "STM090", "PUL254")]
    if missing := [str(file) for file in files if not file.is_file()]:
        pytest.skip(f"no {missing[0]}: POUNDING_SWEEP_RECORDS does not name a folder of real records")
    spec = draw(seed, number, [key for key, law in LAWS.items() if law.has_contact], earthquakes(files), list(KINDS))
    spec = replace(spec, cases=(spec.cases[case],))
    truth, change = reference(spec)
    outputs = ASKED[asked]
    found = run_cases(replace(spec, outputs=outputs, accuracy=accuracy, method=None, dt=None, precision=precision))
    assert change[0] <= 0.1 * accuracy
    assert found["status"][0] == Status.OK
    assert max(error[0] for error in relative_errors(outputs, found, truth).values()) <= accuracy
