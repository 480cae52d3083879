"""Contacts of one row with laws of their own: against the slow twin, and what sweeps, plans, files make of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from against_twin import errors, motion, simulate, truth
from kernels_used import BUMPED, PADDED
from scenes import OUTPUTS, pair
from test_analysis_gaps import told

import pounding_sweep as ps
from pounding_sweep.analysis import gap_for_probability, required_gap
from pounding_sweep.base.errors import InputError, SceneError, SweepError
from pounding_sweep.engine.postprocess import variables_of
from pounding_sweep.engine.row_kernel import Numerics, RowKernel, kernel_shape
from pounding_sweep.kernel.spec import from_json, to_json
from pounding_sweep.model.laws import LAWS
from pounding_sweep.outputs.variables import Status, reducers_for
from pounding_sweep.plan.advice import shortest_contact
from pounding_sweep.plan.plan import untouched
from pounding_sweep.schemes.stability import largest_step
from pounding_sweep.spec.overview import overview
from pounding_sweep.spec.spec import scene_data

PAD, STOP = BUMPED.bumpers
# -- against the twin --------------------------------------------------------------------------------------------------


def test_contacts_of_several_laws_are_stepped_by_one_series():
    """Where all are polynomials of the motion, at any step."""
    got, want = simulate(PADDED, "kelvin_voigt", 51, method="exact", dt=5e-3), truth(PADDED, "kelvin_voigt", 51)
    found = errors(got, want, PADDED)
    assert max(found.values()) < 5e-6, found
    shapes = [kernel_shape(scene, LAWS["kelvin_voigt"], Numerics("exact", 1e-3), ()) for scene in (PADDED, BUMPED)]
    assert [bool(shape.series) for shape in shapes] == [True, False]


@pytest.mark.slow
def test_the_order_is_kept():
    steps = np.array([2e-3, 1e-3, 5e-4])
    off = [
        max(errors(simulate(BUMPED, "hertz_damped", dt=dt), truth(BUMPED, "hertz_damped"), BUMPED).values())
        for dt in steps
    ]
    assert np.polyfit(np.log(steps), np.log(off), 1)[0] > 3.0, off


@pytest.mark.slow
@pytest.mark.parametrize("method", ["rk4", "newmark"])
def test_steps_that_are_not_split_find_the_same_impacts(method):
    got, want = (simulate(BUMPED, "kelvin_voigt", method=method, dt=1e-4, locate=each) for each in (False, True))
    assert got.impact_count.equals(want.impact_count)
    np.testing.assert_allclose(got.impact_force_max, want.impact_force_max, rtol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["rk4", "exact", "newmark"])
def test_bumpers_of_the_law_of_the_sweep_change_nothing(method):
    bare = replace(BUMPED, bumpers=())
    same = replace(
        BUMPED, bumpers=[ps.Bumper("a-b", "kelvin_voigt", 8e5, 0.6), ps.Bumper("c-wall", "kelvin_voigt", 8e5, 0.6)]
    )
    one, other = (simulate(scene, "kelvin_voigt", method=method, dt=1e-3) for scene in (bare, same))
    for name in ("impact_force_max", "displacement_max", "energy_damping", "steps_per_contact"):
        np.testing.assert_allclose(other[name], one[name], rtol=1e-9)


# -- what is compiled --------------------------------------------------------------------------------------------------


def test_a_scene_without_bumpers_asks_for_the_kernel_that_it_had():
    numerics = Numerics("rk4", 1e-3)
    plain = kernel_shape(replace(BUMPED, bumpers=[]), LAWS["linear"], numerics, reducers_for(OUTPUTS))
    assert (plain.bumpers, plain.bumped, plain.n_gaps) == ((), (), 3)
    assert [gap for *_, gap in plain.contacts] == [0, 0, 1, 1, 2, 2]
    assert "bumpers" not in scene_data(pair())
    mine = kernel_shape(BUMPED, LAWS["linear"], numerics, reducers_for(OUTPUTS))
    assert mine.bumped == (1, 1, 0, 0, 2, 0)
    assert from_json(json.loads(json.dumps(to_json(mine)))) == mine
    # under no pounding bumpers do not act
    still = kernel_shape(BUMPED, LAWS["none"], numerics, reducers_for(OUTPUTS))
    assert still == replace(plain, law=None, contacts=(), reducers=still.reducers)
    # two bumpers of one law are one law
    twice = replace(BUMPED, bumpers=[replace(STOP, storeys=[1]), replace(STOP, storeys=[2], stiffness=1e5)])
    assert kernel_shape(twice, LAWS["linear"], numerics, frozenset()).bumped == (0, 0, 0, 0, 1, 1)


def test_contacts_of_each_law_have_a_status_of_their_own():
    """A contact is too short by the damping of its own law, not by that of another one."""
    kernel = RowKernel(BUMPED, LAWS["kelvin_voigt"], Numerics("rk4", 1e-3), reducers_for(["impact_count"]))
    quick = kernel._quickening(np.array([0.02, 0.6]))
    assert quick[:, 0] == pytest.approx(LAWS["kelvin_voigt"].quickening([0.02, 0.6]))
    assert quick[:, 1:].tolist() == [[PAD.quickening("published"), STOP.quickening("published")]] * 2
    need = kernel.numerics.scheme.min_steps_per_contact(True)
    raw = {"flags": np.zeros((3, 1)), "quickening": np.ones((3, 3)) * [1.0, 3.0, 1.0], "scale": np.ones((3, 1))}
    lasts = np.array([[10.0, 10.0, 10.0], [10.0, 2.0, 1e30], [1e30, 1e30, 2.0]]) * need * 1e-3
    found = variables_of(
        kernel, {**raw, "shortest": lasts}, ["steps_per_contact", "status"], ps.find_record("el_centro")
    )
    np.testing.assert_allclose(found["steps_per_contact"], [10.0 * need, 2.0 * need, 2.0 * need], rtol=1e-9)
    assert found["status"].tolist() == [Status.OK, Status.UNDER_RESOLVED_CONTACT, Status.OK]


# -- in sweeps ---------------------------------------------------------------------------------------------------------


def sweep(**more):
    given = {"scene": BUMPED, "records": motion(20), "laws": "linear", "gaps": [0.012]}
    return ps.Sweep(**{**given, **more})


def test_what_never_touches_is_told_by_the_gap_that_each_bumper_leaves():
    plan = sweep(gaps=[0.010, 0.014, 0.018]).plan()
    closing = np.full((len(plan.uncoupled_runs), 6), 0.006)

    def found():
        return dict(zip(plan.unique.gaps[:, 0].tolist(), untouched(plan, closing).tolist(), strict=True))

    assert found() == {0.010: False, 0.014: False, 0.018: True}  # 9 mm of each are rubber
    closing[:, :2] = 0.0  # between the pair nothing closes
    assert found() == {0.010: True, 0.014: True, 0.018: True}


def test_where_all_contacts_have_bumpers_laws_are_run_once():
    whole = replace(BUMPED, bumpers=[PAD, replace(STOP, storeys=()), replace(STOP, pair="b-c", storeys=())])
    asked = {"laws": ["none", "linear", "hertz_damped"], "restitutions": [0.3, 0.6], "stiffness_factors": [0.5, 1.0]}
    few, many = (sweep(scene=scene, gaps=[0.012, 0.02], **asked).plan() for scene in (whole, BUMPED))
    assert (few.n_asked, len(few.unique), len(many.unique)) == (24, 2 + 1, 2 * (2 + 4) + 1)
    assert len(few.shapes()) == 2
    cases = [
        {"law": law, "gap": 0.012, "restitution": 0.4, "stiffness_factor": k}
        for law in asked["laws"][1:]
        for k in (1, 2)
    ]
    assert len(sweep(scene=whole, laws=None, gaps=None, cases=cases).plan().unique) == 1
    assert len(sweep(scene=BUMPED, laws=None, gaps=None, cases=cases).plan().unique) == 4


def test_steps_follow_from_the_stiffest_contact():
    none, one = np.ones(1), np.ones(1)
    stiff = replace(BUMPED, bumpers=[PAD, replace(STOP, stiffness=1e8, law="linear", restitution=None)])
    alone = ps.Scene([*BUMPED.row[2:]], [0.01], storeys={"c-wall": [1]})  # the same contact under a law of the sweep
    limits = [
        float(largest_step(scene, LAWS["linear"], k * one, one, method="rk4")[0])
        for scene, k in ((BUMPED, 8e5), (stiff, 1e-6), (alone, 1e8))
    ]
    assert limits[1] == pytest.approx(limits[2], rel=1e-9)
    assert limits[1] < 0.3 * limits[0]
    assert largest_step(stiff, LAWS["linear"], 8e5 * one, one, method="newmark") == np.inf
    still = [
        largest_step(scene, LAWS["none"], none, one, method="rk4") for scene in (stiff, replace(stiff, bumpers=()))
    ]
    assert still[0] == still[1]  # where nothing touches
    # contacts of bumpers are as short as their own law makes them
    speeds = np.full((1, 3), 0.3)
    shorter = [float(shortest_contact(s, LAWS["linear"], 8e5 * none, none, speeds)[0]) for s in (BUMPED, stiff)]
    assert shorter[1] == pytest.approx(np.pi * np.sqrt(100.0 / 1e8), rel=1e-9)
    assert shorter[0] > 5.0 * shorter[1]
    plan = sweep(accuracy=1e-3, dt=None).plan()
    assert plan.choice_numbers["laws_not_measured"] == ["rubber_bumper"]


def test_required_gaps_have_room_for_bumpers():
    bare, found = (required_gap(told(scene)) for scene in (replace(BUMPED, bumpers=()), BUMPED))
    np.testing.assert_allclose(found.closing, bare.closing)
    assert np.array_equal(found.never, bare.never)
    for name in ("exact", "rule_gap"):
        more = (found[name] - bare[name]).transpose("pair", ...).values.reshape(3, -1)
        np.testing.assert_allclose(more, np.repeat([[PAD.thickness], [0.0], [0.0]], more.shape[1], axis=1), atol=1e-12)
    assert found.thickness.values.tolist() == [PAD.thickness, 0.0, 0.0]
    assert "thickness" not in bare.coords
    # of one storey only the larger of both sums counts
    one = required_gap(told(replace(BUMPED, bumpers=[replace(PAD, storeys=[2])])))
    sums = (found.closing.sel(pair="a-b") + np.array([0.0, PAD.thickness])).max("storey")
    np.testing.assert_allclose(one.exact.sel(pair="a-b"), sums)
    with pytest.raises(InputError, match="bumpers take their thickness of the gap"):
        gap_for_probability(found, [0.1], intensity=xr.DataArray([1.0, 2.0], coords={"record": found.record}))


def test_a_cube_tells_its_bumpers(stub_engine):
    del stub_engine
    from pounding_sweep.output.describe import describe

    text = describe(sweep().run())
    assert "storeys 1, 2 with bumpers 'rubber_bumper': 9 mm, k = 3e+08 kN/m^2.65, e = 0.5" in text
    told = dict(overview(BUMPED))
    assert (
        told["c-wall"]
        == "floors meet at 3, 6 m; storey 1 with bumpers 'modified_kelvin_voigt': k = 2e+05 kN/m, e = 0.4"
    )
    assert told["b-c"] == "floors meet at 3, 6 m"


def test_a_file_describes_them(tmp_path):
    (tmp_path / "pads.py").write_text("import pounding_sweep as ps\nthin = ps.rubber_bumper(0.004, stiffness=2e7)\n")
    path = tmp_path / "sweep.toml"
    path.write_text(
        """
[scene]
preset = "mate2015"
[[scene.bumpers]]
pair = "left-middle"
law = "kelvin_voigt"
stiffness = 5e4
restitution = 0.4
thickness = 0.002
storeys = [1, 3]
[[scene.bumpers]]
pair = "middle-right"
law = "pads.py:thin"
restitution = 0.5
[sweep]
records = ["el_centro"]
laws = ["linear"]
"""
    )
    scene = ps.load_sweep(path).spec.scene
    assert [(bumper.law.key, bumper.stiffness, bumper.thickness) for bumper in scene.bumpers] == [
        ("kelvin_voigt", 5e4, 0.002),
        ("rubber_bumper", 2e7, 0.004),
    ]
    first, second = scene.bumpers
    assert scene.bumper_of == (first, None, first, second, second, second)
    assert scene.thicknesses(0.001).tolist() == [0.002, 0.001, 0.002, 0.004, 0.004, 0.004]


def test_the_sweep_of_the_repository_has_bumpers_of_one_pair():
    plan = ps.load_sweep(Path(__file__).parents[1] / "sweeps" / "bumpers_of_a_pair.toml").plan()
    assert [bool(bumper) for bumper in plan.spec.scene.bumper_of] == [True, True, False, False]


# -- refusals ----------------------------------------------------------------------------------------------------------


def test_what_does_not_go_with_bumpers_is_refused():
    mine = ps.Law(key="mine", exponent=1.0, damper="c", damping="viscous", number=lambda e: 1.0 - e)
    with pytest.raises(SceneError, match="gives its damping number as a function"):
        ps.Bumper("a-b", mine, 1e5, 0.5)
    with pytest.raises(SweepError, match="law 'stereomechanical' has no force, and does not go beside bumpers"):
        sweep(laws="stereomechanical", restitutions=0.5)
    with pytest.raises(SweepError, match=r"cases\[0\].law: law 'stereomechanical' has no force"):
        sweep(laws=None, gaps=None, cases=[{"law": "stereomechanical", "restitution": 0.5}])
    memory = replace(BUMPED, bumpers=[ps.Bumper("a-b", "hysteretic", 1e6, 0.5)])
    with pytest.raises(SweepError, match="law 'hysteretic' follows its own past by located events"):
        sweep(scene=memory, locate=False)
    deep = replace(memory.bumpers[0], restitution=0.1)
    with pytest.raises(
        SweepError, match=r"scene.bumpers\[0\]: bumper of pair 'a-b': restitution 0.1 can't be realised"
    ):
        sweep(scene=replace(memory, bumpers=[deep]), restitution_basis="realised")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            {"gaps": [0.02, 0.005]},
            "gaps: a gap of 0.005 m has no room for the 0.009 m of bumpers of 'a-b'; give a wider",
        ),
        ({"gaps": None, "scene": replace(BUMPED, gaps=[0.004, 0.1, 0.1])}, "scene.gaps: a gap of 0.004 m has no room"),
        (
            {"gaps": None, "laws": None, "cases": [{"law": "linear", "gap": g} for g in ([0.02, 0, 0], [0.003, 1, 1])]},
            r"cases\[1\].gap: a gap of 0.003 m has no room",
        ),
    ],
)
def test_a_gap_has_room_for_its_bumpers(given, said):
    with pytest.raises(SweepError, match=said):
        sweep(**given)
    sweep(gaps=None)  # the narrow gap beside is that of bare floors
