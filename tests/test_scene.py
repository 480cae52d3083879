"""Scenes and presets, and rows that are none: what is wrong, and what to give instead. Files are in `bad_sweeps`."""

from __future__ import annotations

import itertools
import json
import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kernels_used import BUMPED
from kinds import TOWER_ABOVE, A, B

import pounding_sweep as ps
from pounding_sweep.base.errors import SceneError
from pounding_sweep.model.building import Building
from pounding_sweep.model.presets import PRESETS, get_preset
from pounding_sweep.model.scene import Bumper, ContactProperties, Link, Scene, Wall
from pounding_sweep.request.spec import json_data

INF = float("inf")


def building(name="b", n=2, **more):
    return Building(name, [100.0 + i for i in range(n)], [1e5 - 1e3 * i for i in range(n)], **more)


# --- buildings ------------------------------------------------------------------------------------------------------


def test_preset_periods_and_properties():
    scene = get_preset("mate2015")
    assert [round(float(b.periods[0]), 4) for b in scene.buildings] == [0.2337, 0.2944, 0.3091]
    assert [b.name for b in scene.buildings] == ["left", "middle", "right"]
    assert scene.gaps == (0.01, 0.01)
    assert scene.pair_names == ("left-middle", "middle-right")
    assert scene.contact == ContactProperties(linear_stiffness=2e6, hertz_stiffness=1.88e7, restitution=0.6)
    assert [b.damping_ratio for b in scene.buildings] == [0.05] * 3
    assert (scene.n_dof, scene.n_storeys, scene.offsets) == (9, 3, (0, 3, 6, 9))
    assert [(c.pair, c.storey, c.left, c.right) for c in scene.contacts] == [
        (0, 1, 0, 3), (0, 2, 1, 4), (0, 3, 2, 5), (1, 1, 3, 6), (1, 2, 4, 7), (1, 3, 5, 8),
    ]  # fmt: skip
    assert scene.contacts[2].mass == pytest.approx(133.956 * 136.286 / (133.956 + 136.286), rel=1e-15)


def test_unknown_preset_lists_and_suggests():
    with pytest.raises(SceneError, match=r"did you mean 'mate2015'\?"):
        get_preset("mate2016")
    for bad in (None, ["mate2015"], 3):
        with pytest.raises(SceneError, match="mate2015"):
            get_preset(bad)
    assert all(get_preset(key) is preset.scene for key, preset in PRESETS.items())


def test_stiffness_matrix_and_modes():
    b = Building("b", [2.0, 3.0, 4.0], [10.0, 20.0, 30.0])
    np.testing.assert_array_equal(b.system_matrix, [[30, -20, 0], [-20, 50, -30], [0, -30, 30]])
    w, shapes = b.modes
    np.testing.assert_allclose(shapes.T @ np.diag(b.masses) @ shapes, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(shapes.T @ b.system_matrix @ shapes, np.diag(w**2), atol=1e-11)
    assert (np.diff(w) > 0).all()
    np.testing.assert_allclose(b.periods, 2 * np.pi / w)


@pytest.mark.parametrize("zeta", [0.0, 0.02, 0.05, 0.3, (0.03, 0.05), (0.05, 0.05), (0.05, 0.06), [0.02, 0.03]])
@pytest.mark.parametrize("n", [2, 3, 7])
def test_rayleigh_gives_the_asked_ratios_in_the_first_two_modes(n, zeta):
    b = building(n=n, damping_ratio=zeta)
    asked = tuple(zeta) if isinstance(zeta, tuple | list) else (zeta, zeta)
    (a, beta), (w, shapes) = b.rayleigh, b.modes
    c = shapes.T @ (a * np.diag(b.masses) + beta * b.system_matrix) @ shapes
    np.testing.assert_allclose((np.diag(c) / (2 * w))[:2], asked, rtol=1e-9, atol=1e-12)
    assert b.damping_ratio == (zeta if isinstance(zeta, float) else asked)


def test_one_storey_damping_is_2_zeta_w_m():
    b = Building("b", [4.0], [100.0], damping_ratio=0.1)
    assert b.rayleigh == (pytest.approx(2 * 0.1 * 5.0), 0.0)
    assert b.periods == pytest.approx([2 * math.pi / 5.0])


def changed(**changes):
    """Two buildings, the first one changed."""
    return Scene([replace(building("a"), **changes), building("b")], [0.1])


@pytest.mark.parametrize(
    ("make", "given"),
    [
        (lambda given: changed(masses=given), [1.0, 2.0]),
        (lambda given: changed(damping_ratio=given), [0.05, 0.04]),
        (lambda given: changed(yield_strengths=given), [3.0, INF]),
        (lambda given: Scene(changed().row, given), [0.1]),
        (lambda given: replace(changed(), row=given), list(changed().row)),
        (lambda given: replace(changed(), storeys={"a-b": given}), [1, 2]),
        (lambda given: replace(changed(), links=[Link("a-b", given, 1e3)]), [[1, 2], [2, 1]]),
        (lambda given: replace(changed(), bumpers=[Bumper("a-b", "linear", 1e3, storeys=given)]), [1]),
    ],
)
def test_arrays_are_taken_as_lists_are(make, given):
    want, got = make(given), make(np.array(given))
    assert got == want
    assert hash(got) == hash(want)
    assert json.dumps(json_data(got)) == json.dumps(json_data(want))


@pytest.mark.parametrize("number", [np.float32(0.05), np.float64(0.05), 0])
def test_numpy_numbers_are_numbers(number):
    b = Building("b", np.array([1.0, 2.0], dtype=np.float32), np.array([3, 4]), damping_ratio=number)
    assert b.damping_ratio == float(number)
    assert b.masses == (1.0, 2.0)
    assert all(type(v) is float for v in (*b.masses, *b.stiffnesses, b.damping_ratio))


# --- floors and contacts --------------------------------------------------------------------------------------------


def test_unequal_heights_meet_where_elevations_agree():
    tall = building("tall", 5, storey_heights=[4.5, 3.0, 3.0, 3.0, 3.0])  # 4.5 7.5 10.5 13.5 16.5
    low = building("low", 3, storey_heights=[3.0, 4.5, 6.0])  # 3.0 7.5 13.5
    scene = Scene([tall, low], gaps=[0.01])
    assert [(c.storey, c.left, c.right) for c in scene.contacts] == [(2, 1, 6), (4, 3, 7)]
    mirrored = Scene([low, tall], gaps=[0.01])
    assert [(c.storey, c.left, c.right) for c in mirrored.contacts] == [(2, 1, 4), (3, 2, 6)]
    assert [c.mass for c in mirrored.contacts] == [c.mass for c in scene.contacts]
    assert scene.n_storeys == 5
    m1, m2 = tall.masses[1], low.masses[1]
    assert scene.contacts[0].mass == pytest.approx(m1 * m2 / (m1 + m2), rel=1e-15)


@pytest.mark.parametrize(("off", "meets"), [(0.0, True), (0.9e-3, True), (-0.9e-3, True), (1.1e-3, False)])
def test_floor_tolerance(off, meets):
    a, b = building("a", 1), building("b", 1, storey_heights=[3.0 + off])
    assert bool(Scene([a, b], [0.0], allow_unmet=True).contacts) is meets
    assert Scene([a, b], [0.0], tolerance=2e-3).contacts
    assert not Scene([a, b], [0.0], tolerance=0.5e-3, allow_unmet=True).contacts or off == 0.0


def test_floors_that_never_meet():
    row = [building("a", 2), building("b", 2, storey_heights=[4.0, 4.0])]
    with pytest.raises(
        SceneError, match=r"pair 'a-b' has no floors that meet: 'a' has floors at 3, 6 m, 'b' has .* 4, 8 m"
    ):
        Scene(row, [0.01])
    scene = Scene(row, [0.01], allow_unmet=True)
    assert scene.contacts == ()
    assert scene.pair_names == ("a-b",)


@pytest.mark.parametrize(
    ("low", "high", "meets"),
    [
        (0.0, 0.25, True),  # the higher slab reaches down to the lower floor
        (0.0, 0.2, True),
        (0.0, 0.196, True),  # within the tolerance
        (0.0, 0.19, False),
        (0.5, 0.0, False),  # the lower slab hangs farther down
    ],
)
def test_slabs_meet_where_they_overlap(low, high, meets):
    a = building("a", 2, storey_heights=[3.0, 3.0], slab_depths=[low] * 2)
    b = building("b", 2, storey_heights=[3.2, 3.0], slab_depths=[high] * 2)
    for row in ([a, b], [b, a]):
        scene = Scene(row, [0.0], allow_unmet=True, tolerance=5e-3)
        assert [(c.storey, c.left, c.right) for c in scene.contacts] == ([(1, 0, 2), (2, 1, 3)] if meets else [])


def test_a_floor_meets_one_of_its_neighbours():
    a = building("a", 1, storey_heights=[3.0], slab_depths=[0.9])
    split = building("split", 2, storey_heights=[2.3, 0.6])
    for row in ([a, split], [split, a]):
        with pytest.raises(SceneError, match="floor 1 of 'a' is level with 2 floors of its neighbour; give smaller"):
            Scene(row, [0.0])
    with pytest.raises(SceneError, match=r"tolerance: -1.0 won't do; it must be greater than or equal to 0"):
        Scene([a, split], [0.0], tolerance=-1.0)
    with pytest.raises(SceneError, match=r"tolerance: 1000.* won't do; it must be a valid number"):
        Scene([a, split], [0.0], tolerance=10**400)  # beyond all numbers with a point


def test_pairs_limited_to_storeys():
    """A moat wall meets the isolated floor alone."""
    a, b = building("a", 3), building("b", 2)
    scene = Scene([Wall("moat"), a, b], [0.1, 0.2], storeys={"moat-a": [1], "a-b": (2,)})
    assert [(c.pair, c.storey, c.left, c.right) for c in scene.contacts] == [(0, 1, -1, 0), (1, 2, 1, 4)]
    assert scene.with_gaps([0.3, 0.4]).contacts == scene.contacts
    assert pickle.loads(pickle.dumps(scene)) == scene
    assert hash(scene) != hash(Scene(scene.row, scene.gaps))


def test_walls_meet_every_floor():
    a, b = building("a", 2), building("b", 3, storey_heights=[1.0, 2.2, 0.7])
    scene = Scene([Wall("bank"), a, b, Wall("moat")], gaps=[0.1, 0.2, 0.3], allow_unmet=True)
    assert scene.pair_names == ("bank-a", "a-b", "b-moat")
    assert [(c.pair, c.storey, c.left, c.right, c.mass) for c in scene.contacts] == [
        (0, 1, -1, 0, 100.0), (0, 2, -1, 1, 101.0),
        (2, 1, 2, -1, 100.0), (2, 2, 3, -1, 101.0), (2, 3, 4, -1, 102.0),
    ]  # fmt: skip
    assert scene.buildings == (a, b)
    assert scene.offsets == (0, 2, 5)


def test_two_walls_of_the_same_name_are_told_apart():
    scene = Scene([Wall(), building(), Wall()], gaps=[0.1, 0.2])
    assert scene.pair_names == ("left wall-b", "b-right wall")


@given(st.lists(st.integers(1, 5), min_size=1, max_size=4), st.booleans(), st.booleans())
def test_contacts_of_random_rows(storeys, left_wall, right_wall):
    buildings = [building(f"b{i}", n) for i, n in enumerate(storeys)]
    row = [Wall("w0")] * left_wall + buildings + [Wall("w1")] * right_wall
    scene = Scene(row, gaps=[0.01] * (len(row) - 1))
    expected = [min(a, b) for a, b in itertools.pairwise(storeys)]
    expected = [storeys[0]] * left_wall + expected + [storeys[-1]] * right_wall
    per_pair = [sum(c.pair == i for c in scene.contacts) for i in range(len(expected))]
    assert per_pair == expected
    masses = [m for b in buildings for m in b.masses]
    elevations = [z for b in buildings for z in b.elevations]
    for c in scene.contacts:
        sides = [dof for dof in (c.left, c.right) if dof >= 0]
        assert c.mass == pytest.approx(1 / sum(1 / masses[dof] for dof in sides), rel=1e-14)
        assert len({round(elevations[dof], 6) for dof in sides}) == 1
    assert [(c.pair, c.storey) for c in scene.contacts] == sorted((c.pair, c.storey) for c in scene.contacts)


def test_with_gaps_keeps_the_row():
    scene = get_preset("mate2015")
    other = scene.with_gaps([0.0, 0.02])
    assert other.gaps == (0.0, 0.02)
    assert (other.row, other.contact) == (scene.row, scene.contact)
    with pytest.raises(SceneError, match="1 gaps for a row of 3"):
        scene.with_gaps([0.1])


A_AND_B = [building("a"), building("b")]


@pytest.mark.parametrize(
    ("row", "gaps", "message"),
    [
        ([Wall("a"), Wall("b")], [0.1], "at least one building"),
        ([building("a"), Wall(), building("b")], [0.1, 0.1], "number 2 of the row; a wall may only be the first or"),
        (building("a"), [], r"row: must be a list, not Building\(name='a', masses=\(100\.0, 101\.0\), stiffnesses="),
        (A_AND_B, [-0.01], r"gaps\[0\]: -0\.01 won't do; it must be greater than or equal to 0"),
        (A_AND_B, [INF], r"gaps\[0\]: inf won't do; it must be a finite number"),
        ([building(n) for n in ("a-b", "c", "a", "b-c")], [0.1] * 3, "two pairs of the row have the same name"),
    ],
)
def test_bad_scenes(row, gaps, message):
    with pytest.raises(SceneError, match=message):
        Scene(row, gaps)


def test_contact_properties_may_be_a_table():
    assert Scene([building()], contact={"linear_stiffness": 1.0}).contact == ContactProperties(1.0)


def test_reference_by_exponent():
    contact = ContactProperties(linear_stiffness=1.0, hertz_stiffness=2.0)
    assert [contact.reference(x) for x in (1.0, 1.5, 2.0)] == [1.0, 2.0, None]
    assert ContactProperties().reference(1.0) is None


def test_floors_meet_by_their_elevations_above_the_datum_of_the_row():
    """A neighbour up the hill, and one with a basement whose columns are struck above its base."""
    low = Building("low", [9.0] * 3, 1e5)
    hill = Building("hill", [9.0] * 2, 1e5, base_elevation=3.0)
    assert [(c.left, c.right) for c in Scene([low, hill], 0.1).contacts] == [(1, 3), (2, 4)]
    with pytest.raises(SceneError, match="'hill' has floors at 5, 8 m"):
        Scene([Building("low", [9.0], 1e5), Building("hill", [9.0] * 2, 1e5, base_elevation=2.0)], 0.1)
    deep = Building("deep", [9.0], 1e5, storey_heights=6.0, base_elevation=-2.0)
    scene = Scene([Building("shed", [9.0], 1e5, storey_heights=1.0), deep], 0.1, contacts="floors and columns")
    assert [(c.struck, c.xi) for c in scene.contacts] == [(1, 0.5)]  # 3 m above the base of a storey of 6 m
    # a floor below the base of its neighbour strikes nothing
    lifted = Building("lifted", [9.0], 1e5, base_elevation=3.5)
    above = Scene(
        [Building("shed", [9.0] * 2, 1e5, storey_heights=[3.0, 2.0]), lifted], 0.1, contacts="floors and columns"
    )
    assert [(c.storey, c.struck) for c in above.contacts] == [(2, 1)]
    assert hill.elevations.tolist() == [3.0, 6.0]  # of its own base, by which it rocks and its height is told


PAD = BUMPED.bumpers[0]
#: What is made of the values of a test.
MAKE = {
    "building": lambda given: replace(A, **given),
    "smooth": lambda given: replace(A, **({"yield_strengths": [10.0, 10.0]} | given)),
    "link": lambda given: ps.Scene([A, B, ps.Wall()], [0.1, 0.1], links=[ps.Link(*given)]),
    "bumper": lambda given: replace(BUMPED, bumpers=[ps.Bumper(*given)]),
    "bumpers": lambda given: replace(BUMPED, bumpers=given),
    "isolated": lambda given: ps.base_isolated(
        **({"building": TOWER_ABOVE, "base_mass": 150.0, "period": 2.5, "damping_ratio": 0.05, "strength": 250} | given)
    ),
}
REFUSED = {
    "building": [
        ({"yield_strengths": [1.0, 1.0], "hardening": True}, "hardening: True won't do; it must be a valid number"),
        ({"dashpots": []}, "dashpots: 0 values for 2 masses; give one per storey"),
        ({"masses": [10**400, 1.0]}, r"masses\[0\]: 10{80}"),
        ({"damping_ratio": np.nan}, "damping_ratio: nan won't do; it must be greater than or equal to 0"),
    ],
    "smooth": [
        (
            {"hysteresis": {"law": "bouc_wen"}, "damping_stiffness": "tangent"},
            r"bouc_wen has no tangent stiffness that is one",
        )
    ],
    "link": [
        (("a-b", [3], 1.0), r"links\[0\]: there is no storey 3 of 'a'; give one of 1 to 2"),
        (("a-b", [(1, 0)], 1.0), r"links\[0\]: there is no storey 0 of 'b'; give one of 1 to 2"),
    ],
    "bumper": [
        (("a-b", "linear", True), "stiffness: True won't do; it must be a valid number"),
        (("a-b", "kelvin_voigt", 1e5, "x"), "restitution: 'x' won't do; it must be a valid number"),
        (("a-b", PAD.law, 1e5, 0.5, 0.2), r"thickness is 0.2 m beside the 0.009 m of its law; leave it out"),
        (("a-b", "linear", 1e5, None, None, [1, 1]), r"storey 1 of pair 'a-b' has several bumpers; give one"),
        (("a-b", {"key": "x", "exponent": 0.1}, 1e5), "law: Law 'x': exponent: 0.1 won't do"),
    ],
    "bumpers": [([PAD, replace(PAD, storeys=[2])], "storey 2 of pair 'a-b' has several bumpers")],
    "isolated": [
        ({"period": 0.0}, r"base_isolated: period: 0\.0 won't do; it must be greater than 0"),
        ({"strength": -1.0}, r"base_isolated: strength: -1\.0 won't do; it must be greater than or equal to 0"),
        ({"base_mass": "x"}, "base_isolated: base_mass: 'x' won't do; it must be a valid number"),
    ],
}


@pytest.mark.parametrize(
    ("kind", "given", "message"), [(kind, *case) for kind, cases in REFUSED.items() for case in cases]
)
def test_what_is_no_part_of_a_row_is_refused(kind, given, message):
    with pytest.raises(SceneError, match=message):
        MAKE[kind](given)
