"""Floors that strike columns of their neighbour: against beams, against the independent solver, and in sweeps."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import reference
from against_reference import buildings_of, motion
from hypothesis import given
from hypothesis import strategies as st
from kernels_used import FRAMED, STAGGERED
from scipy.integrate import solve_ivp

import pounding_sweep as ps
from pounding_sweep.base.errors import InputError, SceneError
from pounding_sweep.model.meeting import column_shares, column_softness
from pounding_sweep.model.variants import variants_of

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
