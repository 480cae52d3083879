"""Contacts of several kinds in one row: bumpers, and floors that strike columns."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import reference
import xarray as xr
from against_reference import buildings_of, errors, motion, number_of, simulate, truth
from hypothesis import given
from hypothesis import strategies as st
from kernels_used import BUMPED, BUMPER, FRAMED, STAGGERED
from scenes import pair
from scipy.integrate import solve_ivp
from test_analysis_gaps import told

import pounding_sweep as ps
from pounding_sweep.accuracy.law_check import solved_restitution
from pounding_sweep.analysis import gap_for_probability, required_gap
from pounding_sweep.base.errors import InputError, LawError, SceneError, SweepError
from pounding_sweep.model import formula as formulas
from pounding_sweep.model.laws import LAWS, Law, realised_restitution
from pounding_sweep.model.meeting import column_shares, column_softness
from pounding_sweep.model.variants import variants_of
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


#: Contacts of the staggered row: label along ``pair``, storey of the floor that strikes; in the order of the reference.
PLACES = [("a-b columns of b", 1), ("a-b columns of a", 1), ("a-b columns of a", 2), ("b-wall", 1)]


@given(st.floats(0.01, 0.99), st.floats(1.0, 1e7))
def test_shares_and_softness_are_those_of_a_beam(xi, stiffness):
    lower, upper, soft = reference.struck_beam(xi, stiffness)
    assert column_shares(xi) == pytest.approx((lower, upper), abs=1e-9)
    assert column_softness(xi) / stiffness == pytest.approx(soft, rel=1e-8)


def test_a_column_struck_at_its_end_is_the_floor():
    assert (column_shares(0.0), column_shares(1.0)) == ((1.0, 0.0), (0.0, 1.0))
    assert column_softness(0.0) == column_softness(1.0) == 0.0


def test_what_strikes_what():
    """Floors at 3 and 6 m beside floors at 2 and 5.5 m; a roof above its neighbour's strikes nothing."""
    assert STAGGERED.pair_labels == ("a-b", "a-b columns of b", "a-b columns of a", "b-wall")
    assert STAGGERED.pair_of_label == (0, 0, 0, 1)
    assert [(c.place, c.storey, c.struck, c.left, c.right, c.below) for c in STAGGERED.contacts] == [
        (1, 1, 1, 0, 3, 2),
        (2, 1, 0, 0, 2, -1),
        (2, 2, 0, 1, 3, 0),
        (3, 1, -1, 2, -1, -1),
    ]
    np.testing.assert_allclose([c.xi for c in STAGGERED.contacts], [1 / 3.5, 2 / 3, 2.5 / 3, 1.0])
    twin = reference._Row(buildings_of(STAGGERED), STAGGERED.gaps, columns=True)
    np.testing.assert_allclose([c.mass for c in STAGGERED.contacts], twin.meff[:4], rtol=1e-12)
    stiffness = variants_of(STAGGERED).contact_stiffnesses(np.array([8e5]))[0]
    np.testing.assert_allclose(1.0 / (1.0 / 8e5 + np.array(twin.softness[:4])), stiffness, rtol=1e-12)


def test_a_slab_strikes_at_its_middle():
    a = ps.Building("a", [1.0], [1e3], slab_depths=[0.5])
    b = ps.Building("b", [1.0], [1e3], storey_heights=[4.0])
    (contact,) = ps.Scene([a, b], [0.1], contacts="floors and columns").contacts
    assert (contact.struck, contact.xi) == (1, 2.75 / 4.0)


def test_what_the_model_does_not_cover_is_refused():
    for law in ("hysteretic", "stereomechanical"):
        with pytest.raises(InputError, match=f"law '{law}' has no force linear in d, which floors that strike columns"):
            ps.Sweep(STAGGERED, "el_centro", ["linear", law])
    assert ps.Sweep(STAGGERED, "el_centro", ["linear", "none"], stiffnesses=8e5).plan().n_asked == 2
    floors = replace(STAGGERED, contacts="floors", allow_unmet=True)
    assert ps.Sweep(floors, "el_centro", "hertz", stiffnesses=8e5).plan().n_asked == 1


class Frame:
    """Two rigid floors on columns of Euler-Bernoulli elements without mass, fixed against rotation at floors and base.

    The upper floor of another building strikes a joint of the upper columns through a spring. Displacements of joints
    follow from equilibrium, contact spring included; nothing is condensed by hand.
    """

    def __init__(self, striker, frame, z, gap, spring):
        self.masses = np.array([*striker.masses, *frame.masses])
        _, damping, self.stiffness = buildings_of(ps.Scene([striker]))[0].matrices()
        self.damping = np.zeros((4, 4))
        self.damping[:2, :2] = damping
        self.gap, self.spring = gap, spring
        levels = np.concatenate([[0.0], frame.elevations])
        joints = sorted({*np.linspace(*levels[:2], 4), *np.linspace(levels[1], z, 4), *np.linspace(z, levels[2], 4)})
        whole = np.zeros((2 * len(joints), 2 * len(joints)))
        for e, (low, high) in enumerate(itertools.pairwise(joints)):
            storey = 0 if high <= levels[1] + 1e-9 else 1
            ei, h = frame.stiffnesses[storey] * frame.storey_heights[storey] ** 3 / 12.0, high - low
            bending = np.array(
                [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h], [-12, -6 * h, 12, -6 * h],
                 [6 * h, 2 * h * h, -6 * h, 4 * h * h]]
            )  # fmt: skip
            whole[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += ei / h**3 * bending
        floors = [2 * int(np.argmin(np.abs(np.array(joints) - level))) for level in levels[1:]]
        held = {0, 1, *(i + 1 for i in floors)}
        inner = [i for i in range(len(whole)) if i not in held and i not in floors]
        self.at = inner.index(2 * int(np.argmin(np.abs(np.array(joints) - z))))
        self.ii, self.ib, self.bb = (
            whole[np.ix_(*both)] for both in ((inner, inner), (inner, floors), (floors, floors))
        )

    def forces(self, u, closed):
        """Elastic forces on all floors, the contact force, and the penetration without it."""
        k, load = self.ii.copy(), -self.ib @ u[2:]
        if closed:
            k[self.at, self.at] += self.spring
            load[self.at] += self.spring * (u[1] - self.gap)
        x = np.linalg.solve(k, load)
        d = u[1] - x[self.at] - self.gap
        force = self.spring * d if closed else 0.0
        own = -self.stiffness @ u[:2] - [0.0, force]
        return np.concatenate([own, -(self.bb @ u[2:] + self.ib.T @ x)]), force, d

    def run(self, motion):
        state, t, closed, peak, history = np.zeros(8), 0.0, False, 0.0, [np.zeros(4)]
        for i in range(motion.n_points - 1):
            end = (i + 1) * motion.dt
            while t < end - 1e-12:

                def rhs(now, y, closed=closed):
                    ground = np.interp(now, motion.time, motion.acceleration)
                    elastic = self.forces(y[:4], closed)[0] - self.damping @ y[4:]
                    return np.concatenate([y[4:], elastic / self.masses - ground])

                def touch(now, y, closed=closed):
                    return self.forces(y[:4], closed)[2] - (-1e-15 if closed else 1e-15)

                touch.terminal, touch.direction = True, -1.0 if closed else 1.0
                tolerance = {"rtol": 1e-9, "atol": 1e-12, "method": "DOP853", "max_step": 2e-3}
                found = solve_ivp(rhs, (t, end), state, events=touch, **tolerance)
                peak = max([peak, *(self.forces(y[:4], closed)[1] for y in found.y.T)])
                t, state = found.t[-1], found.y[:, -1]
                closed = closed ^ (found.status == 1)
            history.append(state[:4])
        return np.array(history), peak


def test_a_frame_of_beams_moves_alike():
    """Columns as beams, the contact spring at a joint inside them: the same peak force, the same motion."""
    record, spring = motion(70, 1.5), 3e5
    a, b = FRAMED.buildings
    (contact,) = FRAMED.contacts
    assert (contact.struck, contact.storey, contact.xi) == (1, 2, pytest.approx(1.0 / 3.2))
    frame = Frame(a, b, 4.0, FRAMED.gaps[0], spring)
    u, peak = frame.run(record)
    one = ps.simulate(FRAMED, record, law="kelvin_voigt", stiffness=spring, restitution=1.0, method="rk4", dt=2.5e-4)
    here = one.sel(pair="a-b columns of b", storey=2)
    assert here.impact_count >= 3
    assert float(here.impact_force_max) == pytest.approx(peak, rel=1e-3)  # the frame's is the largest of its steps
    assert here.impact_force_max < 0.9 * spring * here.penetration_max  # the column gives way
    got = one.displacement.values[:: round(record.dt / 2.5e-4)].reshape(len(u), 4)
    np.testing.assert_allclose(got, u, rtol=0, atol=1e-6 * np.abs(u).max())


def test_a_cube_labels_columns(stub_engine):
    outputs = ["impact_force_max", "column_shear_bottom_max", "column_shear_top_max", "contact_work"]
    cube = ps.Sweep(STAGGERED, motion(126, 1.5), "linear", gaps=[0.001, 0.002], outputs=outputs).run()
    cube = cube.squeeze(drop=True)
    assert cube.pair.values.tolist() == list(STAGGERED.pair_labels)
    np.testing.assert_array_equal(cube.pair_gap, np.repeat([[0.001], [0.002]], 4, axis=1))
    heights = [float(cube.contact_elevation.sel(pair=pair, storey=storey)) for pair, storey in PLACES]
    assert heights == [3.0, 2.0, 5.5, 2.0]
    assert int(cube.contact_elevation.notnull().sum()) == 4
    there = cube.contact_elevation.notnull().values
    np.testing.assert_array_equal(cube.impact_force_max.isel(gap=0).notnull(), there)
    lower, upper = column_shares(STAGGERED.contacts[0].xi)
    place = {"pair": PLACES[0][0], "storey": PLACES[0][1]}
    force = cube.impact_force_max.sel(place).values
    np.testing.assert_allclose(cube.column_shear_bottom_max.sel(place), lower * force)
    np.testing.assert_allclose(cube.column_shear_top_max.sel(place), upper * force)


@pytest.mark.slow
def test_the_sweep_to_copy_equals_the_twin():
    """Slabs with depths, columns softer than their storeys."""
    sweep = ps.load_sweep(Path(__file__).parents[1] / "sweeps" / "columns.toml")
    scene, (record,) = sweep.spec.scene.with_gaps([0.01, 0.01]), sweep.spec.records
    given = {"columns": True, "only": {scene.pair_names.index(pair): storeys for pair, storeys in scene.storeys}}
    ground = record.acceleration, record.dt
    want = reference.run(
        buildings_of(scene), scene.gaps, *ground, "kelvin_voigt", 1e6, scene.contact.restitution, **given
    )
    got = sweep.run().sel(law="kelvin_voigt", gap=0.01).squeeze(drop=True)
    for name in ("impact_force_max", "impact_count"):
        mine = [float(got[name].sel(pair=scene.pair_labels[c.place], storey=c.storey)) for c in scene.contacts]
        np.testing.assert_allclose(mine, np.concatenate(want[name]), rtol=1e-5, err_msg=name)
    assert np.count_nonzero(mine) >= 3
    np.testing.assert_allclose(got.displacement_max, want["displacement_max"][:2], rtol=1e-6)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"yield_strengths": [100.0, 100.0]}, "strength inf"),
        ({"p_delta": True}, "with p_delta"),
        ({"foundation": ps.Foundation(70.0, 500.0, 2.5e5, 6e6)}, "on a foundation"),
    ],
)
def test_columns_whose_shape_is_not_known_are_not_struck(options, why):
    def row(**options):
        low = ps.Building("low", [50.0], [1e4], storey_heights=[4.0])
        high = ps.Building("high", [50.0] * 2, [1e4] * 2, **options)
        return ps.Scene([low, high], gaps=[0.01], contacts="floors and columns", allow_unmet=True)

    assert any(contact.struck >= 0 for contact in row(yield_strengths=[100.0, float("inf")]).contacts)
    with pytest.raises(SceneError, match=rf"strike columns whose shape is not known.*{why}"):
        row(**options)
