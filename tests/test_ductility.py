"""Sweeps of constant ductility: strengths that are found for each record before anything is planned."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from kernels_used import YIELDING_SWEEP
from scenes import motions, yielding_pair

import pounding_sweep as ps
from pounding_sweep.base.errors import SweepError
from pounding_sweep.engine import spectrum
from pounding_sweep.request.axes import Case
from pounding_sweep.request.spec import digest
from pounding_sweep.run.simulate import selectors, simulate_one
from pounding_sweep.variables.registry import Status

GIVEN = {key: value for key, value in YIELDING_SWEEP.items() if key not in ("strength_factors", "hardenings")}
SWEEP = GIVEN | {"gaps": [0.001, 0.004], "ductilities": [1.5, 4.0]}


@lru_cache
def swept():
    sweep = ps.Sweep(**SWEEP)
    return sweep, sweep.run()


def reached(cube):
    """Largest ductility of each building."""
    return cube.ductility_max.max("storey").transpose("case", "building").values


def test_without_pounding_each_building_reaches_it():
    _, cube = swept()
    assert (cube.status == Status.OK).all()
    still = cube.isel(case=cube.law.values == "none")
    assert still.sizes["case"] == 2 * 2 * 2 * 2
    assert set(still.ductility.values) == {1.5, 4.0}
    np.testing.assert_allclose(reached(still), np.repeat(still.ductility.values[:, None], 2, axis=1), rtol=2e-4)
    apart = cube.isel(case=(cube.law.values != "none") & (cube.pair_gap.values[:, 0] == 0.001))
    assert np.abs(reached(apart) / apart.ductility.values[:, None] - 1.0).max() > 0.1  # what pounding does to it


def test_strengths_are_those_of_the_analysis_and_grow_with_the_motion():
    _, cube = swept()
    found = ps.analysis.constant_ductility(yielding_pair(), motions(), [1.5, 4.0]).strength_factor
    for i in range(cube.sizes["case"]):
        want = found.sel(record=str(cube.record.values[i]), ductility=float(cube.ductility.values[i]))
        np.testing.assert_allclose(cube.strength_factor.values[i], want * cube.scale.values[i], rtol=1e-8)


def test_nothing_is_run_twice():
    sweep, cube = swept()
    plan = sweep.plan()
    assert plan.n_asked == cube.sizes["case"] == 2 * 2 * 2 * 2 * 2
    # records, scales and ductilities each decide on a run without pounding, gaps and laws don't
    assert len(plan.uncoupled_runs) == 2 * 2 * 2
    assert plan.n_unique == 8 + 2 * 8


def test_the_cube_can_be_unfolded():
    """As the documentation says."""
    _, cube = swept()
    gap = cube.pair_gap.isel(pair=0).drop_vars("pair")
    table = cube[["ductility_max"]].reset_coords(drop=True)
    table = table.assign_coords({"gap": gap, **{n: cube[n] for n in ("law", "record", "scale", "ductility")}})
    table = table.set_index(case=["law", "gap", "record", "scale", "ductility"]).unstack("case")
    one = table.sel(law="none", gap=0.001, record="one", scale=0.5, ductility=4.0)
    np.testing.assert_allclose(one.ductility_max.max("storey").values, [4.0, 4.0], rtol=2e-4)


@pytest.mark.slow
def test_other_properties_of_buildings_are_as_given():
    """Periods, damping and hardening each have strengths of their own; masses have none."""
    more = {
        "period_factors": {"a": [1.0, 1.4]},
        "mass_factors": {"b": [1.0, 3.0]},
        "damping_ratios": [0.02],
        "hardenings": {"a": [0.0, 0.1]},
    }
    given = GIVEN | {"laws": ["none"], "records": motions()[0], "gaps": [1e3], "scales": [1.0], "ductilities": 3.0}
    cube = ps.Sweep(**given, **more).run()
    assert cube.sizes["case"] == 8
    np.testing.assert_allclose(reached(cube), 3.0, rtol=2e-4)
    factors = {tuple(row) for row in cube.strength_factor.values.round(9)}
    assert len(factors) == 4


def test_listed_cases_take_it_too():
    cases = [Case("none", ductility=2.0), Case("none", scale=-2.0, ductility=2.0), Case("none")]
    known = replace(cases[0], strength_factors={"a": 0.5})
    spec = ps.Sweep(yielding_pair(), motions()[0], cases=[*cases, known]).spec
    once, twice = (dict(case.strength_factors) for case in spec.cases[:2])
    assert twice == pytest.approx({name: 2.0 * factor for name, factor in once.items()}, rel=1e-8)
    assert spec.cases[2].strength_factors == ()
    assert spec.cases[3].strength_factors == (("a", 0.5),)  # they were found before
    again = ps.Sweep(yielding_pair(), motions()[0], cases=spec.cases).spec
    assert digest(again) == digest(spec)


@pytest.mark.slow
def test_one_of_its_scenarios_is_simulated():
    spec = swept()[0].spec
    one = simulate_one(spec, case=2)
    assert spec.cases[1].ductility == 4.0
    np.testing.assert_allclose(one.ductility_max.max("storey").values, 4.0, rtol=2e-4)
    assert "ductility" not in selectors(spec)


@pytest.mark.slow
def test_points_of_a_design_take_it():
    inputs = {"ductility": {"distribution": "uniform", "low": 1.5, "high": 3.0}}
    design = {"kind": "latin_hypercube", "samples": 4, "inputs": inputs}
    given = GIVEN | {"laws": ["none"], "records": motions()[0], "gaps": [1e3], "scales": [1.0]}
    cube = ps.Sweep(**given, design=design).run()
    np.testing.assert_allclose(reached(cube), np.repeat(cube.ductility.values[:, None], 2, axis=1), rtol=3e-4)


def test_a_ductility_that_is_not_reached_is_refused(monkeypatch):
    monkeypatch.setattr(spectrum, "REACH", 0.3)
    with pytest.raises(
        SweepError, match=r"ductilities: 4 of building 'a' is not reached under 'one', not even at 1 / 1.2"
    ):
        ps.Sweep(**SWEEP | {"ductilities": 4.0})
