"""The audit: what it reports is what a comparison by hand gives, and what it can't judge it says."""

from __future__ import annotations

import json
import warnings
from unittest.mock import patch

import netCDF4
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import AXES, OUTPUTS, make, motions, row

from pounding_sweep.base.text import number_text
from pounding_sweep.engine.postprocess import variables_of
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.kernel.spec import LANES
from pounding_sweep.model.building import Building
from pounding_sweep.model.laws import get_law
from pounding_sweep.model.scene import Scene
from pounding_sweep.output.audited import audit_table, errors_by_law, errors_sentence
from pounding_sweep.output.describe import describe
from pounding_sweep.plan.plan import make_plan
from pounding_sweep.records import synthetic_record
from pounding_sweep.request.build import build_spec
from pounding_sweep.run import audit
from pounding_sweep.run.audit import draw
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.variables.registry import Status, reducers_for, relative_error

#: Several groups of lanes in the audit, by this title of both laws that touch.
LARGER = {"gaps": [0.0005, 0.5, 0.001, 0.002, 0.003, 0.005, 0.01, 0.02], "audit": 1.0, "title": "two", "rest": 0.0}


@pytest.fixture(scope="module")
def audited():
    """A sweep with several groups in its audit, its cube and what was found."""
    sweep = make(**LARGER)
    cube = sweep.run(scheduler="synchronous")
    return sweep, cube


# -- against a comparison by hand --------------------------------------------------------------------------------------


def alone(cube, i, numerics):
    """The scenario of row `i` of an audit, by itself."""
    record = next(r for r in motions() if r.name == str(cube["audit_record"][i].values))
    law = get_law(str(cube["audit_law"][i].values))
    kernel = RowKernel(row(), law, numerics, reducers_for(OUTPUTS), host=get_law("kelvin_voigt"))
    raw = kernel.run(
        record,
        scale=cube["audit_scale"].values[i : i + 1],
        gaps=cube["audit_gap"].values[i : i + 1],
        stiffness=cube["audit_stiffness"].values[i : i + 1],
        restitution=cube["audit_restitution"].values[i : i + 1],
    )
    return variables_of(kernel, raw, tuple(OUTPUTS), record)


def by_hand(cube, i, name, fine):
    """The error of an output of that scenario beside a finer run of it."""
    own = alone(cube, i, Numerics("rk4", 0.005))
    both = np.maximum(np.nanmax(np.abs(fine["displacement_max"])), np.nanmax(np.abs(fine["displacement_min"])))
    return relative_error(name, own[name], fine[name], np.array([both]) if name.startswith("displacement") else None)[0]


def test_errors_are_those_of_a_comparison_by_hand(audited):
    """All scenarios of a small sweep beside exact flight."""
    sweep, cube = audited
    assert cube.attrs["audit_reference"] == "exact"
    assert cube.sizes["audit"] == cube.attrs["audit_touching"] == sweep.last_audit.touching > LANES
    assert {str(name) for name in cube["audit_law"].values} <= {"linear", "kelvin_voigt"}
    assert (cube["audit_time_step"] == 0.005).all()
    for i in range(0, cube.sizes["audit"], 5):
        fine = alone(cube, i, Numerics("exact", 1e-3))
        for j, name in enumerate(cube["output"].values.tolist()):
            assert cube["audit_error"].values[i, j] == pytest.approx(by_hand(cube, i, name, fine), rel=1e-6, abs=1e-12)


@pytest.fixture
def sampled(monkeypatch):
    """Audits that may not compare all scenarios, of few more than those that stand for a law."""
    monkeypatch.setattr(audit, "exact_kernel", lambda plan: None)
    monkeypatch.setattr(audit, "LEAST_SECONDS", 0.0)
    monkeypatch.setattr(audit, "LANES", 4)


def test_a_sample_runs_again_at_half_the_step(sampled):
    sweep = make(**{**LARGER, "audit": 0.5})
    cube = sweep.run(scheduler="synchronous")
    found = sweep.last_audit
    assert found.random.any()
    assert not found.random.all()
    assert {str(name) for name in cube["audit_law"].values} == {"linear", "kelvin_voigt"}
    for law in ("linear", "kelvin_voigt"):  # the extremes of each are among them
        touching = (cube.impact_count.sel(law=law).fillna(0) > 0).any(["building", "pair", "storey"][1:])
        assert touching.any()
        here = cube.audit_law == law
        assert set(cube.audit_stiffness.values[here]) == set((cube.stiffness_factor * 2e5).values.tolist())
    for i in range(0, cube.sizes["audit"], 7):
        fine = alone(cube, i, Numerics("rk4", 0.0025, refinement=2.0))
        for j, name in enumerate(cube["output"].values.tolist()):
            assert cube["audit_error"].values[i, j] == by_hand(cube, i, name, fine), (i, name)
    said = errors_sentence(cube, cube.attrs)
    drawn = int((cube.audit_random.values & ~cube.audit_undecided.values).sum())
    assert f"with 95% confidence at most {1 - 0.05 ** (1 / drawn):.1%} of the others err more" in said
    assert (
        f"{cube.sizes['audit']} of {found.touching} touching scenarios, all laws, compared with half the step" in said
    )
    worst = float(cube.audit_error.where(cube.audit_undecided == 0).max())
    assert f"largest error {worst:.2g} (" in said


def test_a_row_is_a_scenario_of_the_sweep(audited):
    sweep, cube = audited
    plan = sweep.plan()
    rows = sweep.last_audit.rows
    assert len(set(rows.tolist())) == len(rows)
    np.testing.assert_array_equal(plan.unique.gaps[rows], cube["audit_gap"].values)
    np.testing.assert_array_equal(plan.unique.restitution[rows], cube["audit_restitution"].values)
    assert sweep.last_outcome.results.touched[rows].all()
    assert (cube["audit_status"] == Status.OK).all()
    for name in OUTPUTS:
        column = cube["audit_error"].sel(output=name).where(cube["audit_undecided"] == 0)
        assert cube[name].attrs["audit_error_max"] == float(column.max())
        assert cube[name].attrs["audit_error_median"] == float(column.median())


def test_the_audit_is_the_same_whoever_runs_it(audited, monkeypatch):
    monkeypatch.setattr("pounding_sweep.plan.plan.CHUNK_SECONDS", 0.0)
    _, cube = audited
    again = make(**LARGER).run(scheduler="threads", workers=3)
    for name in cube.variables:
        np.testing.assert_array_equal(cube[name].values, again[name].values, err_msg=str(name))


def test_a_check_compares_all_scenarios(monkeypatch):
    monkeypatch.setattr(audit, "LEAST_SECONDS", 0.0)
    monkeypatch.setattr(audit, "SHARE_OF_ALL", 0.0)
    some, cube = (
        make(**{**LARGER, "audit": 1e-3}).run(scheduler="synchronous", check=check) for check in (False, True)
    )
    assert some.attrs["audit_scenarios"] < some.attrs["audit_touching"] == cube.attrs["audit_scenarios"]
    assert cube.attrs["audit_reference"] == "exact"
    rows = {(row["law"], row["output"]): row for row in errors_by_law(cube)}
    assert {*rows} == {(law, name) for law in ("linear", "kelvin_voigt") for name in OUTPUTS}
    errors = cube["audit_error"].where(cube.audit_undecided == 0)
    for (law, name), found in rows.items():
        part = errors.sel(output=name)[cube.audit_law.values == law]
        assert (found["largest"], found["median"]) == (part.max().item(), part.median().item())
    assert errors_by_law({}) == []


# -- its cost ----------------------------------------------------------------------------------------------------------


def plan_of(n_gaps, share, **changes):
    gaps = np.linspace(0.001, 0.02, n_gaps).tolist()
    return make_plan(
        build_spec(
            **{"scene": row(), "records": motions(), **AXES, "gaps": gaps, "audit": share, "rest": 0.0, **changes}
        )
    )


@pytest.mark.parametrize("n_gaps", [60, 400])
def test_it_costs_no_more_than_its_share(monkeypatch, n_gaps):
    monkeypatch.setattr(audit, "LEAST_SECONDS", 0.0)
    plan = plan_of(n_gaps, 0.05)
    rows = np.flatnonzero(~plan.no_contact)
    assert len(rows) >= 700
    sample, random, share = draw(plan, rows)
    assert 2 * plan.steps[sample].sum() / plan.steps[rows].sum() <= share <= 0.05
    assert n_gaps == 60 or random.sum() > LANES


@given(share=st.floats(0.0, 1.0), n=st.integers(0, 150), seed=st.integers(0, 2**31))
def test_scenarios_are_drawn_fairly(share, n, seed):
    plan = plan_of(30, share, title=str(seed))
    every = np.flatnonzero(~plan.no_contact)
    rows = np.sort(np.random.default_rng(seed).permutation(every)[:n])
    with patch.object(audit, "LEAST_SECONDS", 0.0):
        sample, random, cost = draw(plan, rows)
        np.testing.assert_array_equal(draw(plan, rows)[0], sample)
    assert len(np.unique(sample)) == len(sample) == len(random)
    assert set(sample) <= set(rows)
    assert bool(len(sample)) == bool(cost) == (n > 0 and share > 0.0)
    if random.any():
        assert cost <= share


def test_no_share_leaves_no_trace(audited):
    cube = make(**{**LARGER, "audit": 0}).run(scheduler="synchronous")
    names = [*cube.dims, *cube.variables, *cube.attrs, *(a for v in cube.variables.values() for a in v.attrs)]
    assert not [name for name in names if "audit" in str(name) or name == "output"]
    assert (audit_table(cube), errors_sentence(cube, cube.attrs)) == ([], "")
    estimated = {"error_estimate": np.array([1e-4, np.nan]), "status": np.zeros(2, np.int8)}
    told = [errors_sentence(estimated | more, {}) for more in ({}, {"impact_count": np.ones(2)})]
    assert ["shallower than that may be counted or not" in text for text in told] == [False, True]
    assert "Audit" not in describe(cube)
    for name in cube.data_vars:
        np.testing.assert_array_equal(cube[name].values, audited[1][name].values)


# -- what it can't judge, and what it finds ----------------------------------------------------------------------------


def chaotic(duration):
    """Lightly damped buildings side by side: every hard impact magnifies what differs, the more the longer it lasts."""
    buildings = [Building(b.name, b.masses, b.stiffnesses, 0.01) for b in row().buildings]
    return Sweep(
        Scene(buildings, row().gaps, row().contact),
        synthetic_record(3, duration=duration, dt=0.02, pga=6.0),
        ["linear", "kelvin_voigt"],
        gaps=[1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 2e-2],
        stiffness_factors=[1.0, 10.0],
        restitutions=[0.9],
        method="rk4",
        dt=1e-3,
        outputs=OUTPUTS,
        audit=1.0,
    )


@pytest.fixture
def halved_only(monkeypatch):
    """Audits that run scenarios again at half the step, as of rows that exact flight refuses."""
    monkeypatch.setattr(audit, "exact_kernel", lambda plan: None)


def test_undecided_scenarios_are_told(halved_only, monkeypatch):
    monkeypatch.setattr("pounding_sweep.run.refinement.MOST_HALVINGS", 2)  # else hardly any is undecided
    for duration in (16.0, 12.0, 20.0, 24.0):
        sweep = chaotic(duration)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            cube = sweep.run(scheduler="synchronous")
        undecided = cube["audit_undecided"].values.astype(bool)
        if undecided.any() and not undecided.all():
            break
    else:
        pytest.fail("no scenario of this row is undecided any more: look for others")
    # those that no step settles are told, and are in no average
    error = cube["audit_error"].sel(output="impact_force_max").values
    item = next(item for item in audit_table(cube) if item["output"] == "impact_force_max")
    counts = int(undecided.sum()), int((~undecided).sum())
    assert (item["undecided"], item["scenarios"]) == counts
    assert item["error_max"] == float(error[~undecided].max()) == cube["impact_force_max"].attrs["audit_error_max"]
    assert cube.attrs["audit_undecided_share"] == undecided.mean()
    said = f"{counts[0]} ({undecided.mean():.1%}) undecided and set apart"
    assert said in errors_sentence(cube, cube.attrs)
    assert f"max undecided {number_text(item['error_max_undecided'])}" in describe(cube)
    assert not (sweep.last_audit.exceeding & undecided).any()


def test_few_undecided_scenarios_are_followed(halved_only, monkeypatch):
    """What no step settles takes the most of them; beyond a bound the error that was found stands."""
    monkeypatch.setattr(audit, "LEAST_SECONDS", 0.0)
    monkeypatch.setattr(audit, "LANES", 1)
    followed, compare = [], audit.compare

    def run(*arguments):
        *_, rows, accuracy = arguments
        followed.append((len(rows), accuracy))
        return compare(*arguments)

    monkeypatch.setattr(audit, "compare", run)
    monkeypatch.setattr(audit, "TOLERANCE", 1e-12)  # beyond which all are
    with pytest.warns(RuntimeWarning, match="status ok whose error is beyond 1e-12"):
        make(**LARGER).run(scheduler="synchronous")
    (n, _), (few, accuracy) = followed
    assert (few, accuracy) == (1, audit.CONVERGED * 1e-12)
    assert n > 8


def test_what_a_smaller_step_settles_is_an_error_of_the_sweep(halved_only):
    for duration in (16.0, 12.0, 20.0, 24.0):
        sweep = chaotic(duration)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", RuntimeWarning)
            cube = sweep.run(scheduler="synchronous")
        flags = ~cube["audit_undecided"].values.astype(bool)
        wrong = flags & (cube["audit_error"].values.max(axis=1) > audit.TOLERANCE) & (cube["audit_status"].values == 0)
        if wrong.any():
            break
    else:
        pytest.fail("no scenario of this row is off any more: look for others")
    assert (sweep.last_audit.exceeding == wrong).all()
    assert any("status ok whose error is beyond 0.05" in str(w.message) for w in said)


def test_a_broken_promise_is_told(monkeypatch):
    monkeypatch.setattr(audit, "TOLERANCE", 1e-9)
    sweep = make(audit=0.5)
    with pytest.warns(RuntimeWarning, match=r"status ok whose error is beyond 1e-09.*smaller dt") as said:
        cube = sweep.run(scheduler="synchronous")
    assert len([w for w in said if "audit" in str(w.message)]) == 1
    bad = sweep.last_audit.exceeding
    assert bad.any()
    assert (cube["audit_error"].values[bad].max(axis=1) > 1e-9).all()


def test_an_audit_that_can_not_run_costs_no_sweep(monkeypatch):
    true_run = RowKernel.run

    def run(self, record, **arguments):
        if self.numerics.method == "exact":
            raise MemoryError("the machine is on fire")
        return true_run(self, record, **arguments)

    monkeypatch.setattr(RowKernel, "run", run)
    with pytest.warns(RuntimeWarning, match="the audit has no result: MemoryError: the machine"):
        cube = make().run(scheduler="synchronous")
    assert (cube["status"] == Status.OK).all()
    assert "audit" not in cube.dims


# -- kinds of sweeps ---------------------------------------------------------------------------------------------------


def test_nothing_to_audit(stub_engine):
    single = Scene([Building("a", [100.0], [1e4])])
    for sweep in (
        Sweep(single, motions()[1], "none", dt=0.005, outputs=["displacement_max"]),
        make(laws="none"),
        make(gaps=[0.5]),
        make(outputs=["steps_per_contact"]),
    ):
        cube = sweep.run(scheduler="synchronous")
        assert sweep.last_audit is None
        assert "audit" not in cube.dims


def test_the_file_holds_it(tmp_path):
    out = tmp_path / "out.nc"
    cube = make(rest=0.0).run(out, scheduler="synchronous").load()
    text = describe(cube)
    assert "Audit: relative errors" in text
    assert errors_sentence(cube, cube.attrs) in text
    assert "audit" not in text.partition("Scenario axes")[2].partition("\n\n")[0]
    with netCDF4.Dataset(out) as file:
        np.testing.assert_array_equal(file["audit_error"][:], cube["audit_error"])
        assert file["audit_random"].dtype == np.int8
        assert file["audit_random"].flag_meanings == "chosen random"
        assert (file["audit_error"].units, file["audit_gap"].units) == ("1", "m")
        assert file["audit_status"].flag_meanings == file["status"].flag_meanings
    json.dumps(audit_table(cube), allow_nan=False)


@pytest.mark.slow
def test_velocity_jumps_are_audited():
    """They have no contact that lasts, and so no steps in it."""
    sweep = make(laws="stereomechanical", gaps=[0.002, 0.02], stiffness_factors=None, records=motions()[0], dt=1e-3)
    cube = sweep.run(scheduler="synchronous")
    assert np.isnan(cube["steps_per_contact"]).all()
    assert cube["impact_count"].max() > 0
    assert cube.sizes["audit"] > 0
