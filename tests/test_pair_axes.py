"""Axes by pair: each value is that of its pair alone, in products, cases and designs, from files and from Python."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
import xarray as xr
from scenes import OUTPUTS, make, motions, row

import pounding_sweep as ps
from pounding_sweep.analysis.comparisons.gaps import required_gap
from pounding_sweep.base.errors import InputError, SweepError
from pounding_sweep.output.merge import merge_cubes
from pounding_sweep.output.select import select
from pounding_sweep.request.axes import Case
from pounding_sweep.request.spec import digest
from pounding_sweep.run.simulate import scenario_of, selectors, simulate_one

pytestmark = pytest.mark.usefixtures("stub_by_day")

GAPS, OF_PAIR = [0.002, 0.02], [0.001, 0.004, 0.5]
SETTINGS = {"method": "rk4", "dt": 0.005, "outputs": OUTPUTS, "audit": 0.0, "laws": ["none", "kelvin_voigt"]}


def sweep(scene=None, **changes):
    """A sweep over gaps of all pairs and of one."""
    axes = {"gaps": GAPS, "pair_gaps": {"b-c": OF_PAIR}}
    return ps.Sweep(scene or row(), **{"records": motions()[:1], **SETTINGS, **axes, **changes})


@pytest.fixture(scope="module")
def cube():
    return sweep().run(workers=1)


def test_each_scenario_is_that_of_the_row_with_its_gaps(cube):
    assert list(cube["status"].dims)[:3] == ["law", "gap", "gap_b_c"]
    assert cube["pair_gap"].dims == ("gap", "gap_b_c", "pair")
    assert cube["gap"].attrs["long_name"] == "gap of every pair without gaps of its own"
    assert cube["gap_b_c"].attrs == {"units": "m", "long_name": "gap of pair b-c"}
    peaks = []
    for gap, of_pair in itertools.product(GAPS, OF_PAIR):
        expected = sweep(row((gap, of_pair)), gaps=None, pair_gaps=None).run(workers=1).isel(gap=0, drop=True)
        part = cube.sel(gap=gap, gap_b_c=of_pair, drop=True)
        np.testing.assert_array_equal(part["pair_gap"], [gap, of_pair])
        for name in OUTPUTS:
            np.testing.assert_array_equal(part[name], expected[name], err_msg=name)
        peaks.append(float(part["impact_force_max"].sel(pair="b-c").max()))
    assert len({*peaks}) >= 3


def test_what_differs_is_run_once():
    plan = sweep().plan()
    assert (plan.n_asked, plan.n_unique) == (12, 7)  # one without contact
    both = sweep(gaps=None, pair_gaps={"a-b": GAPS, "b-c": OF_PAIR})
    assert both.plan().n_unique == 7
    assert {tuple(gaps) for gaps in both.plan().unique.gaps} == {tuple(gaps) for gaps in plan.unique.gaps}
    never = sweep(gaps=[5.0], pair_gaps={"b-c": [5.0, 6.0]})
    never.run(workers=1)
    assert never.last_outcome.untouched == 2
    (other,) = sweep(row((0.03, 0.01)), gaps=None).spec.axes["gap"]
    assert other is None


def test_files_say_what_python_does(tmp_path):
    job, path = sweep(), tmp_path / "sweep.toml"
    again = ps.load_sweep(job.to_toml(path))
    assert again.spec == job.spec
    text = path.read_text()
    old = next(line for line in text.splitlines() if line.startswith("pair_gaps"))
    path.write_text(text.replace(old, f'pair."b-c".gap = {OF_PAIR}'))
    assert digest(ps.load_sweep(path).spec) == digest(again.spec)
    assert digest(sweep(pair_gaps={"a-b": OF_PAIR}).spec) != digest(job.spec)


def test_cases_and_designs_take_them():
    cases = [
        {"law": "linear", "gap": 0.02, "pair": {"b-c": {"gap": 1.0}}},
        Case("linear", pair_gaps={"a-b": 0.001}),
        {"law": "linear", "gap": [0.02, 1.0]},
    ]
    job = sweep(laws=None, gaps=None, pair_gaps=None, cases=cases)
    listed = job.run(workers=1)
    np.testing.assert_array_equal(listed["pair_gap"], [[0.02, 1.0], [0.001, 0.02], [0.02, 1.0]])
    assert job.plan().n_unique == 2
    inputs = {"pair": {"a-b": {"gap": {"distribution": "uniform", "low": 0.002, "high": 0.02}}}}
    design = sweep(gaps=None, pair_gaps={"b-c": [0.01, 1.0]}, design={"kind": "sobol", "samples": 4, "inputs": inputs})
    drawn = design.run(workers=1)
    assert (len(drawn["case"]), design.spec.design.inputs[0].name) == (16, "gap_a_b")
    np.testing.assert_array_equal(drawn["gap_a_b"], drawn["pair_gap"].sel(pair="a-b"))
    assert {*drawn["pair_gap"].sel(pair="b-c").values.tolist()} == {0.01, 1.0}


def test_one_scenario_is_chosen_by_them():
    spec = sweep().spec
    assert scenario_of(spec)["gap_b_c"] == 0.004
    assert selectors(spec)["gap_a_b"] == ("pair_gaps", "a-b")
    for choice, gaps in (
        ({}, [0.002, 0.004]),
        ({"gap_b_c": 0.03}, [0.002, 0.03]),
        ({"gap": 0.01, "gap_a_b": 0.05}, [0.05, 0.004]),
        ({"gap": [0.01, 0.03]}, [0.01, 0.03]),
    ):
        one = simulate_one(spec, **choice)
        np.testing.assert_array_equal(one["pair_gap"], gaps)
    with pytest.raises(InputError, match="at least 0"):
        simulate_one(spec, gap_b_c=-1.0)


def test_cubes_are_extended_and_merged(tmp_path, cube):
    less, more = tmp_path / "less.nc", tmp_path / "more.nc"
    sweep(pair_gaps={"b-c": OF_PAIR[:2]}).run(less, workers=1).close()
    whole = sweep().run(tmp_path / "whole.nc", extend=less, workers=1)
    assert json.loads(whole.attrs["extended_from"])["scenarios_taken"] == 4
    sweep(pair_gaps={"b-c": OF_PAIR[1:]}).run(more, workers=1).close()
    merge_cubes([less, more], tmp_path / "both.nc")
    with xr.open_dataset(tmp_path / "both.nc") as both:
        for found in (whole, both):
            for name in OUTPUTS:
                np.testing.assert_array_equal(found[name], cube[name], err_msg=name)
        assert json.loads(both.attrs["sweep"])["pair_gaps"] == [["b-c", OF_PAIR]]
    assert select(whole, {"gap_b_c": "0.004"})["pair_gap"].dims == ("gap", "pair")
    whole.close()
    # gaps given to all pairs and by pair are the same scenario
    same = ps.Sweep(row(), records=motions()[:1], gaps=GAPS, **SETTINGS)
    taken = same.run(tmp_path / "same.nc", extend=tmp_path / "whole.nc", workers=1)
    assert "extended_from" in taken.attrs


def test_required_gaps_know_no_gaps(cube):
    expected = required_gap(make(laws=["none"], outputs=OUTPUTS).spec.scene, motions()[:1])
    found = required_gap(cube, motions()[:1])
    assert {*found["exact"].dims} == {"record", "scale", "pair"}
    np.testing.assert_array_equal(found["exact"].squeeze(), expected["exact"].squeeze())


def test_faults_name_the_pair():
    with pytest.raises(SweepError, match=r"pair_gaps\.a-c: unknown pair 'a-c'.*Valid: a-b, b-c"):
        sweep(pair_gaps={"a-c": [0.01]})
    with pytest.raises(SweepError, match=r"pair\.b-c\.gaps: unknown key 'gaps'"):
        sweep(pair_gaps=None, pair={"b-c": {"gaps": [0.01]}})
    with pytest.raises(SweepError, match="every pair has gaps of its own"):
        sweep(pair_gaps={"a-b": [0.01], "b-c": [0.02]})
    padded = ps.Scene(row().row, [0.05, 0.05], row().contact, bumpers=[ps.Bumper("b-c", "linear", 1e4, thickness=0.01)])
    with pytest.raises(SweepError, match=r"pair_gaps: a gap of 0\.001 m has no room"):
        sweep(padded, gaps=None)


CONTACTS = {"pair": {"a-b": {"stiffness_factor": [1.0, 2.0]}, "b-c": {"restitution": [0.3, 0.5]}}}


def of_contacts(**changes):
    """A sweep over contact stiffness and restitution of one pair each, those of all pairs varied too."""
    axes = {"stiffness_factors": [1.0, 0.5], "restitutions": [0.5, 0.7], "gaps": [0.002], "pair_gaps": None}
    laws = ["none", "linear", "kelvin_voigt", "stereomechanical"]
    return sweep(**{"laws": laws, **axes, **CONTACTS, **changes})


def test_contacts_of_pairs_differ():
    job = of_contacts()
    cube, table = job.run(workers=1), job.plan().unique
    # no pounding once, linear by stiffness, Kelvin and Voigt by both, stereomechanical by restitution
    assert len(table) == 1 + 4 + 4 * 4 + 4
    assert cube["contact_stiffness"].dims == ("law", "stiffness_factor", "stiffness_factor_a_b", "pair")
    part = cube.sel(stiffness_factor=0.5, stiffness_factor_a_b=2.0, restitution=0.7, restitution_b_c=0.3)
    np.testing.assert_array_equal(part["contact_stiffness"].sel(law="linear"), [2e5, 1e5])
    np.testing.assert_array_equal(part["pair_restitution"], [0.7, 0.3])
    assert {(0.7, 0.3), (0.5, 0.5)} < {tuple(row) for row in table.restitution.tolist()}
    plain = of_contacts(pair=None)
    same = {"stiffness_factor_a_b": 1.0, "restitution_b_c": 0.5, "restitution": 0.5}
    expected = plain.run(workers=1).sel(restitution=0.5)
    for name in OUTPUTS:
        np.testing.assert_array_equal(cube[name].sel(same), expected[name], err_msg=name)
    touching = cube["impact_force_max"].sel(law="kelvin_voigt", stiffness_factor=1.0, restitution=0.5, drop=True)
    assert len(np.unique(touching.sel(pair="a-b"))) > 1


def test_contacts_of_pairs_are_found_again(tmp_path):
    whole = of_contacts()
    expected = whole.run(tmp_path / "whole.nc", workers=1)
    of_contacts(pair=None).run(tmp_path / "plain.nc", workers=1).close()
    with of_contacts().run(tmp_path / "new.nc", extend=tmp_path / "plain.nc", workers=1) as found:
        assert json.loads(found.attrs["extended_from"])["scenarios_taken"] > 4
        for name in OUTPUTS:
            np.testing.assert_array_equal(found[name], expected[name], err_msg=name)
    more = {"a-b": {"stiffness_factor": [3.0]}, "b-c": {"restitution": [0.3, 0.5]}}
    of_contacts(pair=more).run(tmp_path / "more.nc", workers=1).close()
    merge_cubes([tmp_path / "whole.nc", tmp_path / "more.nc"], tmp_path / "both.nc")
    with xr.open_dataset(tmp_path / "both.nc") as both:
        assert both["stiffness_factor_a_b"].values.tolist() == [1.0, 2.0, 3.0]
        assert int((both["status"] == 0).sum()) == both["status"].size
    assert digest(whole.spec) != digest(of_contacts(pair=None).spec)
    expected.close()


def test_one_scenario_and_cases_have_contacts_of_pairs():
    case = {
        "law": "kelvin_voigt",
        "stiffness_factor": 0.5,
        "pair": {"a-b": {"stiffness_factor": 2.0, "restitution": 0.3}},
    }
    other = {"law": "kelvin_voigt", "restitution": 0.6}
    listed = sweep(laws=None, gaps=None, pair_gaps=None, cases=[case, other]).run(workers=1)
    np.testing.assert_array_equal(listed["contact_stiffness"], [[2e5, 1e5], [2e5, 2e5]])
    np.testing.assert_array_equal(listed["pair_restitution"], [[0.3, 0.5], [0.6, 0.6]])
    spec = of_contacts().spec
    one = simulate_one(spec, law="kelvin_voigt", stiffness_factor_a_b=4.0)
    expected = ps.simulate(
        row((0.002, 0.002)), motions()[0], law="kelvin_voigt", restitution=0.5, method="rk4", dt=0.005,
        pair_stiffness_factors={"a-b": 4.0}, pair_restitutions={"b-c": 0.3},
    )  # fmt: skip
    np.testing.assert_array_equal(one["impact_force_max"], expected["impact_force_max"])
    assert one.attrs["scenario"].startswith("stiffness factor 1; restitution 0.5; stiffness factor of a-b 4")
    with pytest.raises(SweepError, match=r"restitution 0\.0 is outside the validity of law 'modified_kelvin_voigt'"):
        sweep(laws=["modified_kelvin_voigt"], restitutions=[0.5], pair={"b-c": {"restitution": [0.0]}})


@pytest.mark.slow
@pytest.mark.parametrize("method", ["exact", "rk4", "newmark", "central_difference"])
@pytest.mark.parametrize("law", ["kelvin_voigt", "hertz_damped", "stereomechanical"])
def test_kernels_have_contacts_of_pairs(method, law):
    """A pair whose neighbours are out of reach is what the whole row is, with its stiffness and restitution."""
    settings = {"law": law, "method": method, "dt": 0.002, "rest": 0.0}
    if method == "central_difference" and law == "stereomechanical":
        settings["dt"] = 0.001
    pairs = {"pair_stiffness_factors": {"a-b": 3.0}, "pair_restitutions": {"a-b": 0.4}}
    found = ps.simulate(row((0.004, 5.0)), motions()[0], restitution=0.8, **pairs, **settings)
    k = None if law == "stereomechanical" else 3.0 * {"kelvin_voigt": 2e5, "hertz_damped": 1e6}[law]
    expected = ps.simulate(row((0.004, 5.0)), motions()[0], restitution=0.4, stiffness=k, **settings)
    assert float(expected["impact_count"].max()) > 0
    for name in ("impact_force_max", "displacement_max", "acceleration_max", "impulse", "contact_work"):
        np.testing.assert_allclose(found[name], expected[name], rtol=1e-9, atol=1e-12, err_msg=name)
