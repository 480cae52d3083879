"""Bumpers: the law of rubber, its thickness and flat end; contacts of one row with laws of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from against_reference import errors, motion, number_of, simulate, truth
from kernels_used import BUMPED, BUMPER
from scenes import pair
from test_analysis_gaps import told

import pounding_sweep as ps
from pounding_sweep.accuracy.law_check import solved_restitution
from pounding_sweep.analysis import gap_for_probability, required_gap
from pounding_sweep.base.errors import InputError, LawError, SweepError
from pounding_sweep.model import formula as formulas
from pounding_sweep.model.laws import LAWS, Law, realised_restitution
from pounding_sweep.plan.advice import shortest_contact
from pounding_sweep.plan.plan import untouched
from pounding_sweep.request.spec import overview
from pounding_sweep.schemes.stability import largest_step
from pounding_sweep.variables.registry import inner_shape

GAP, K = 0.012, 3e8
SCENE = pair(GAP)


@pytest.mark.parametrize("e", [0.2, 0.8, *(pytest.param(e, marks=pytest.mark.slow) for e in (0.5, 0.99))])
@pytest.mark.parametrize(("speed", "stop"), [(0.05, 1.0), pytest.param(0.6, 1.0, marks=pytest.mark.slow), (0.6, 12.0)])
def test_free_masses_rebound_as_asked_for_at_any_speed(e, speed, stop):
    pad = ps.rubber_bumper(0.01, stop=stop)
    assert solved_restitution(pad, e, mass=40.0, stiffness=K, speed=speed) == pytest.approx(e, abs=1e-8)
    assert realised_restitution(pad, e) == pytest.approx(e, rel=1e-12)


def test_the_damping_is_the_root_of_the_closed_form():
    e = np.array([1e-5, 0.3, 0.5, 0.9, 1.0 - 1e-9])
    found = BUMPER.damping_coefficient(e, 1.0, 1.0)
    # D near 1 / e at one end; 3 (1 - e) at the other, where ln(1 - x) = -x - x^2 / 2 - x^3 / 3
    assert found[0] == pytest.approx(1e5, rel=1e-9)
    assert found[-1] == pytest.approx(3e-9, rel=1e-6)
    np.testing.assert_allclose(found[1:4], [number_of(x) for x in e[1:4]], rtol=1e-9)
    with pytest.raises(LawError, match=r"restitution 0\.0 is outside the validity"):
        BUMPER.check_restitution(0.0)


def test_the_force_has_no_jump_and_the_slope_is_its_derivative():
    stiff, flat = ps.rubber_bumper(0.02, limit=0.5, stop=8.0, exponent=2.0), 0.01
    at = np.array([0.3 * flat, 0.999999 * flat, 1.000001 * flat, 2.0 * flat])
    force, slope = (formulas.on_arrays(text, d=at, k=1e6) for text in (stiff.elastic, stiff.elastic_slope))
    line = 1e6 * (flat**2 + 16.0 * flat * (at - flat))
    np.testing.assert_allclose(force, np.where(at < flat, 1e6 * at**2, line), rtol=1e-12)
    np.testing.assert_allclose(slope, 1e6 * np.where(at < flat, 2.0 * at, 16.0 * flat), rtol=1e-12)
    assert formulas.slope("max(k*d - 3.0, 0.0)") == "max(k * d - 3.0, 0.0) / max(k * d - 3.0, 1e-30) * k"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"thickness": 0.0}, "rubber_bumper: thickness: 0.0 won't do; it must be greater than 0"),
        ({"thickness": "5 cm"}, "thickness: '5 cm' won't do"),
        ({"thickness": 0.1, "limit": 1.2}, "limit: 1.2 won't do; it must be less than or equal to 1"),
        ({"thickness": 0.1, "stop": 0.5}, "stop: 0.5 won't do; it must be greater than or equal to 1"),
        ({"thickness": 0.1, "exponent": 0.5}, "exponent: 0.5 won't do; it must be greater than or equal to 1"),
    ],
)
def test_a_bumper_that_is_none_says_why(given, said):
    with pytest.raises(LawError, match=said):
        ps.rubber_bumper(**given)


def test_a_law_is_damped_on_one_side_and_has_a_thickness():
    given = {"key": "mine", "exponent": 2.0, "damper": "c*d**2", "damping": "elastic"}
    with pytest.raises(LawError, match="can't act on approach only and on rebound only"):
        Law(**given, approach_only=True, rebound_only=True)
    with pytest.raises(LawError, match=r"thickness: -0.1 won't do"):
        Law(**given, thickness=-0.1)
    assert Law(**given, rebound_only=True).relation == "rebound"


@pytest.mark.slow
@pytest.mark.parametrize("stop", [1.0, 6.0])
@pytest.mark.parametrize(
    ("method", "order", "bound"), [("rk4", 3.0, 1e-5), ("exact", -1.0, 1e-6), ("newmark", 1.8, 3e-3)]
)
def test_the_order_is_kept_where_the_force_has_no_corner(method, order, bound, stop):
    law = ps.rubber_bumper(BUMPER.thickness, stop=stop, stiffness=K)
    # `exact` has steps of its own beside contacts, whose errors are the reference's, but where a corner is met
    steps = np.array([2e-3, 1e-3, 5e-4, 2.5e-4]) / (4.0 if method == "exact" else 1.0)
    want = truth(SCENE, law, 81, 2.0, stop)
    off = [max(errors(simulate(SCENE, law, 81, 2.0, method=method, dt=dt), want, SCENE).values()) for dt in steps]
    slope = np.polyfit(np.log(steps), np.log(off), 1)[0]
    assert slope > (order if stop == 1.0 else 1.2), off
    assert off[-1] < bound * (1.0 if stop == 1.0 else 50.0), off


@pytest.mark.slow
def test_pressing_that_a_row_ends_early_is_cut_at_zero():
    """Where the structure pulls a pair apart faster than 1 / D of the approach the force would pull."""
    scene = ps.Scene([ps.Building("soft", [200.0], [1e5]), ps.Building("light", [2.0], [4e6])], gaps=[0.006])
    pad = ps.rubber_bumper(0.006, key="pad")
    found = ps.simulate(scene, motion(200, 2.0), law=pad, stiffness=2e8, restitution=0.1, dt=5e-4)
    force, depth = found.contact_force.values.ravel(), found.penetration.values.ravel()
    assert force.min() == 0.0
    assert ((force == 0.0) & (depth > 1e-5)).any()
    assert float(abs(found.energy_residual)) < 1e-5


def sweep(**more):
    given = {"scene": SCENE, "records": motion(20), "laws": [BUMPER], "restitutions": [0.6], "stiffnesses": [K]}
    return ps.Sweep(**{**given, "gaps": [GAP], **more})


def row_sweep(**more):
    given = {"scene": BUMPED, "records": motion(20), "laws": "linear", "gaps": [0.012]}
    return ps.Sweep(**{**given, **more})


BOTH_WAYS = dict.fromkeys(("gaps", "laws", "restitutions", "stiffnesses"))
OF_LAW = {"law": BUMPER, "restitution": 0.5, "stiffness": K}


@pytest.mark.parametrize(
    ("make", "given", "said"),
    [
        (sweep, {"gaps": [0.02, 0.005]}, "gaps: a gap of 0.005 m has no room for the 0.01 m of law 'bumper'; give a"),
        (sweep, {"gaps": None, "scene": pair(0.004)}, "scene.gaps: a gap of 0.004 m has no room"),
        (sweep, BOTH_WAYS | {"cases": [OF_LAW | {"gap": g} for g in (0.02, 0.003)]}, r"cases\[1\].gap: .* 0.003 m has"),
        (row_sweep, {"gaps": [0.02, 0.005]}, "gaps: a gap of 0.005 m has no room for the 0.009 m of bumpers of 'a-b'"),
        (row_sweep, {"gaps": None, "scene": replace(BUMPED, gaps=[0.004, 0.1, 0.1])}, "a gap of 0.004 m has no room"),
        (row_sweep, BOTH_WAYS | {"cases": [{"law": "linear", "gap": g} for g in ([0.02, 0, 0], [0.003, 1, 1])]},
         r"cases\[1\].gap: a gap of 0.003 m has no room"),
    ],
)  # fmt: skip
def test_a_gap_has_room_for_its_bumpers(make, given, said):
    with pytest.raises(SweepError, match=said):
        make(**given).plan()
    row_sweep(gaps=None)  # the narrow gap beside is that of bare floors


PAD, STOP = BUMPED.bumpers


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


def test_what_never_touches_is_told_by_the_gap_that_each_bumper_leaves():
    plan = row_sweep(gaps=[0.010, 0.014, 0.018]).plan()
    closing = np.full((len(plan.uncoupled_runs), *inner_shape("closing_max", BUMPED)), 0.006)

    def found():
        return dict(zip(plan.unique.gaps[:, 0].tolist(), untouched(plan, closing).tolist(), strict=True))

    assert found() == {0.010: False, 0.014: False, 0.018: True}  # 9 mm of each are rubber
    closing[:, 0] = 0.0  # between the pair nothing closes
    assert found() == {0.010: True, 0.014: True, 0.018: True}


def test_where_all_contacts_have_bumpers_laws_are_run_once():
    whole = replace(BUMPED, bumpers=[PAD, replace(STOP, storeys=()), replace(STOP, pair="b-c", storeys=())])
    asked = {"laws": ["none", "linear", "hertz_damped"], "restitutions": [0.3, 0.6], "stiffness_factors": [0.5, 1.0]}
    few, many = (row_sweep(scene=scene, gaps=[0.012, 0.02], **asked).plan() for scene in (whole, BUMPED))
    assert (few.n_asked, len(few.unique), len(many.unique)) == (24, 2 + 1, 2 * (2 + 4) + 1)
    assert len(few.shapes()) == 1  # none runs in it, too
    cases = [
        {"law": law, "gap": 0.012, "restitution": 0.4, "stiffness_factor": k}
        for law in asked["laws"][1:]
        for k in (1, 2)
    ]
    assert len(row_sweep(scene=whole, laws=None, gaps=None, cases=cases).plan().unique) == 1
    assert len(row_sweep(scene=BUMPED, laws=None, gaps=None, cases=cases).plan().unique) == 4


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
    plan = row_sweep(accuracy=1e-3, dt=None).plan()
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

    text = describe(row_sweep().run())
    assert "storeys 1, 2 with bumpers 'rubber_bumper': 9 mm, k = 3e+08 kN m-2.65, e = 0.5" in text
    told = dict(overview(BUMPED))
    assert (
        told["c-wall"]
        == "floors meet at 3, 6 m; storeys 1 with bumpers 'modified_kelvin_voigt': k = 2e+05 kN m-1, e = 0.4"
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


def test_a_damping_number_is_no_function():
    with pytest.raises(LawError, match=r"number: .* must be a valid string"):
        ps.Law(key="mine", exponent=1.0, damper="c", damping="viscous", number=lambda e: 1.0 - e)
