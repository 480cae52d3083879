"""The audit: what it reports is what a comparison by hand gives, and what it can't judge it says."""

from __future__ import annotations

import json
import warnings

import netCDF4
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import AXES, OUTPUTS, make, motions, row

from pounding_sweep.engine.postprocess import variables_of
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.model.laws import get_law
from pounding_sweep.model.scene import Building, Scene
from pounding_sweep.output.audited import audit_sentence, audit_table
from pounding_sweep.output.describe import describe
from pounding_sweep.outputs.variables import Status, reducers_for, relative_error
from pounding_sweep.plan.plan import make_plan
from pounding_sweep.records import synthetic_record
from pounding_sweep.run import audit
from pounding_sweep.run.audit import draw
from pounding_sweep.run.sweep import Sweep
from pounding_sweep.spec.build import build_spec

#: Several groups of lanes in the audit, by this title of both laws that touch.
LARGER = {"gaps": [0.0005, 0.5, 0.001, 0.002, 0.003, 0.005, 0.01, 0.02], "audit": 1.0, "title": "two"}


@pytest.fixture(scope="module")
def audited():
    """A sweep with several groups in its audit, its cube and what was found."""
    sweep = make(**LARGER)
    cube = sweep.run(scheduler="synchronous")
    return sweep, cube


# -- against a comparison by hand --------------------------------------------------------------------------------------


def alone(cube, i, dt, change=0.0, refinement=1.0):
    """The scenario of row `i` of an audit, by itself."""
    record = next(r for r in motions() if r.name == str(cube["audit_record"][i].values))
    law = get_law(str(cube["audit_law"][i].values))
    kernel = RowKernel(
        row(), law, Numerics("rk4", dt, refinement=refinement), reducers_for(OUTPUTS), host=get_law("kelvin_voigt")
    )
    raw = kernel.run(
        record,
        scale=np.array([float(cube["audit_scale"][i]) * (1 - change)]),
        gaps=cube["audit_gap"].values[i : i + 1] * (1 + change),
        stiffness=np.array([float(cube["audit_stiffness"][i]) * (1 + change)]),
        restitution=np.array([float(cube["audit_restitution"][i])]),
    )
    return variables_of(kernel, raw, tuple(OUTPUTS), record)


def test_errors_are_those_of_a_comparison_by_hand(audited):
    _, cube = audited
    assert cube.sizes["audit"] > audit.GROUP
    assert {str(name) for name in cube["audit_law"].values} <= {"linear", "kelvin_voigt"}
    assert (cube["audit_time_step"] == 0.005).all()
    for i in range(cube.sizes["audit"]):
        own, fine, moved = alone(cube, i, 0.005), alone(cube, i, 0.0025, 0.0, 2.0), alone(cube, i, 0.0025, 1e-6, 2.0)
        both = np.maximum(np.nanmax(np.abs(fine["displacement_max"])), np.nanmax(np.abs(fine["displacement_min"])))
        for j, name in enumerate(cube["output"].values.tolist()):
            scale = np.array([both]) if name.startswith("displacement") else None
            for column, values in (("audit_error", own), ("audit_sensitivity", moved)):
                by_hand = relative_error(name, values[name], fine[name], scale)[0]
                assert cube[column].values[i, j] == by_hand, (column, i, name)


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
    other = make(**{**LARGER, "title": "another"}).run(scheduler="synchronous")
    assert not all(np.array_equal(cube[f"audit_{n}"], other[f"audit_{n}"]) for n in ("law", "stiffness", "restitution"))


# -- its cost ----------------------------------------------------------------------------------------------------------


def plan_of(n_gaps, share, **changes):
    gaps = np.linspace(0.001, 0.02, n_gaps).tolist()
    return make_plan(
        build_spec(**{"scene": row(), "records": motions(), **AXES, "gaps": gaps, "audit": share, **changes})
    )


@pytest.mark.parametrize("accuracy", [None, 1e-3])
@pytest.mark.parametrize("n_gaps", [60, 400])
def test_it_costs_less_than_its_share(n_gaps, accuracy):
    change = {"accuracy": accuracy, "dt": None, "method": None} if accuracy else {}
    plan = plan_of(n_gaps, 0.05, **change)
    rows = np.flatnonzero(~plan.no_contact)
    assert len(rows) >= 700
    sample, share = draw(plan, rows)
    # refined for an accuracy, a scenario takes its steps and half of them, and ends with the latter
    whole = plan.steps[rows].sum() * (3 if accuracy else 1)
    assert plan.steps[sample].sum() * (4 if accuracy else 2) / whole < share <= 0.05
    assert len(sample) > (0 if n_gaps == 60 else 3 * audit.GROUP)


@given(share=st.floats(0.0, 1.0), n=st.integers(0, 150), seed=st.integers(0, 2**31))
def test_scenarios_are_drawn_fairly(share, n, seed):
    plan = plan_of(30, share, title=str(seed))
    every = np.flatnonzero(~plan.no_contact)
    rows = np.sort(np.random.default_rng(seed).permutation(every)[:n])
    sample, cost = draw(plan, rows)
    np.testing.assert_array_equal(draw(plan, rows)[0], sample)
    assert len(np.unique(sample)) == len(sample) <= max(1, n // 2)
    assert set(sample) <= set(rows)
    assert bool(len(sample)) == bool(cost) == (n > 0 and share > 0.0)
    if len(sample) > audit.GROUP:
        assert cost <= share


def test_no_share_leaves_no_trace(audited):
    cube = make(**{**LARGER, "audit": 0}).run(scheduler="synchronous")
    names = [*cube.dims, *cube.variables, *cube.attrs, *(a for v in cube.variables.values() for a in v.attrs)]
    assert not [name for name in names if "audit" in str(name) or name == "output"]
    assert (audit_table(cube), audit_sentence(audit_table(cube), cube.attrs)) == ([], "")
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


def test_sensitive_and_undecided_scenarios_are_told(monkeypatch):
    monkeypatch.setattr("pounding_sweep.run.refinement.MOST_HALVINGS", 2)  # else hardly any is undecided
    for duration in (16.0, 12.0, 20.0, 24.0):
        sweep = chaotic(duration)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            cube = sweep.run(scheduler="synchronous")
        sensitive, undecided = (cube[f"audit_{name}"].values.astype(bool) for name in ("sensitive", "undecided"))
        if sensitive.any() and undecided.any() and not undecided.all():
            break
    else:
        pytest.fail("no scenario of this row is undecided any more: look for others")
    assert (sensitive >= (cube["audit_sensitivity"].max("output").values > audit.TOLERANCE)).all()
    # those that no step settles are told, and are in no average; the sensitive ones are
    error = cube["audit_error"].sel(output="impact_force_max").values
    item = next(item for item in audit_table(cube) if item["output"] == "impact_force_max")
    counts = int(sensitive.sum()), int(undecided.sum()), int((~undecided).sum())
    assert (item["sensitive"], item["undecided"], item["scenarios"]) == counts
    assert item["error_max"] == float(error[~undecided].max()) == cube["impact_force_max"].attrs["audit_error_max"]
    assert cube.attrs["audit_undecided_share"] == undecided.mean()
    assert f"{counts[0]} of them ({sensitive.mean():.1%}) sensitive" in audit_sentence(audit_table(cube), cube.attrs)
    assert f"{counts[1]} ({undecided.mean():.1%}) undecided and set apart" in audit_sentence(
        audit_table(cube), cube.attrs
    )
    assert "undecided ones up to" in describe(cube)
    assert not (sweep.last_audit.exceeding & undecided).any()


def test_a_sensitive_scenario_that_a_smaller_step_settles_is_not_excused():
    """However ill-conditioned: what half the step or a wider format mends is an error of the sweep."""
    for duration in (16.0, 12.0, 20.0, 24.0):
        sweep = chaotic(duration)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always", RuntimeWarning)
            cube = sweep.run(scheduler="synchronous")
        flags = cube["audit_sensitive"].values.astype(bool) & ~cube["audit_undecided"].values.astype(bool)
        wrong = flags & (cube["audit_error"].values.max(axis=1) > audit.TOLERANCE) & (cube["audit_status"].values == 0)
        if wrong.any():
            break
    else:
        pytest.fail("no sensitive scenario of this row is off any more: look for others")
    assert (sweep.last_audit.exceeding >= wrong).all()
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
        if self.numerics.dt < 0.005:
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
    cube = make().run(out, scheduler="synchronous").load()
    text = describe(cube)
    assert "Audit: relative error, by the difference to half the step" in text
    assert audit_sentence(audit_table(cube), cube.attrs) in text
    assert "audit" not in text.partition("Scenario axes")[2].partition("\n\n")[0]
    with netCDF4.Dataset(out) as file:
        np.testing.assert_array_equal(file["audit_error"][:], cube["audit_error"])
        assert file["audit_sensitive"].dtype == np.int8
        assert file["audit_sensitive"].flag_meanings == "steady sensitive"
        assert (file["audit_error"].units, file["audit_gap"].units) == ("1", "m")
        assert file["audit_status"].flag_meanings == file["status"].flag_meanings
    json.dumps(audit_table(cube), allow_nan=False)


@pytest.mark.slow
def test_velocity_jumps_are_audited():
    """They have no contact that lasts, and so no steps in it."""
    sweep = make(
        laws="stereomechanical", gaps=[0.002, 0.02, 0.5], stiffness_factors=None, records=motions()[0], dt=1e-3
    )
    cube = sweep.run(scheduler="synchronous")
    assert np.isnan(cube["steps_per_contact"]).all()
    assert cube["impact_count"].max() > 0
    assert 0 < cube.sizes["audit"] <= 3
    assert (cube["audit_gap"] < 0.5).all()
