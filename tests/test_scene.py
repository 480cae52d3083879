"""Scenes, presets and the table of contact laws."""

import itertools
import json
import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pounding_sweep.base.errors import LawError, SceneError
from pounding_sweep.model.laws import LAWS, MATE2015_MODELS, Law, damping_number, get_law, hertz_stiffness
from pounding_sweep.model.presets import PRESETS, get_preset
from pounding_sweep.model.scene import Building, Bumper, ContactProperties, Link, Scene, Wall
from pounding_sweep.spec.spec import json_data

NAN = float("nan")
INF = float("inf")


def building(name="b", n=2, **more):
    return Building(name, [100.0 + i for i in range(n)], [1e5 - 1e3 * i for i in range(n)], **more)


def modal_damping(b):
    """Damping ratios of C = a M + b K in the undamped modes, computed apart from the class."""
    mass = np.diag(b.masses)
    a, beta = b.rayleigh
    values, vectors = np.linalg.eig(np.linalg.solve(mass, b.stiffness_matrix))
    order = np.argsort(values.real)
    shapes = vectors.real[:, order]
    w = np.sqrt(values.real[order])
    c = shapes.T @ (a * mass + beta * b.stiffness_matrix) @ shapes
    m = shapes.T @ mass @ shapes
    return np.diag(c) / (2 * w * np.diag(m))


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
    np.testing.assert_array_equal(b.stiffness_matrix, [[30, -20, 0], [-20, 50, -30], [0, -30, 30]])
    w, shapes = b.modes
    np.testing.assert_allclose(shapes.T @ np.diag(b.masses) @ shapes, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(shapes.T @ b.stiffness_matrix @ shapes, np.diag(w**2), atol=1e-11)
    assert (np.diff(w) > 0).all()
    np.testing.assert_allclose(b.periods, 2 * np.pi / w)


@pytest.mark.parametrize("zeta", [0.0, 0.02, 0.05, 0.3, (0.03, 0.05), (0.05, 0.05), (0.05, 0.06), [0.02, 0.03]])
@pytest.mark.parametrize("n", [2, 3, 7])
def test_rayleigh_gives_the_asked_ratios_in_the_first_two_modes(n, zeta):
    b = building(n=n, damping_ratio=zeta)
    asked = tuple(zeta) if isinstance(zeta, tuple | list) else (zeta, zeta)
    np.testing.assert_allclose(modal_damping(b)[:2], asked, rtol=1e-9, atol=1e-12)
    assert b.damping_ratio == (zeta if isinstance(zeta, float) else asked)


@given(
    st.lists(st.tuples(st.floats(1.0, 1e3), st.floats(1e3, 1e6)), min_size=2, max_size=6),
    st.floats(1e-4, 0.5),
)
def test_rayleigh_random(storeys, zeta):
    masses, stiffnesses = zip(*storeys, strict=True)
    b = Building("b", masses, stiffnesses, damping_ratio=zeta)
    np.testing.assert_allclose(modal_damping(b)[:2], zeta, rtol=1e-6)
    assert min(b.rayleigh) >= 0


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
        *(
            (lambda given, name=name: changed(**{name: given}), given)
            for name, given in {
                "masses": [1.0, 2.0],
                "stiffnesses": [1e3, 2e3],
                "damping_ratio": [0.05, 0.04],
                "storey_heights": [3.0, 4.0],
                "yield_strengths": [3.0, INF],
                "slab_depths": [0.2, 0.0],
                "column_stiffnesses": [3.0, 4.0],
                "dashpots": [1.0, 0.0],
            }.items()
        ),
        (lambda given: changed(yield_strengths=[1.0, 2.0], bouc_wen=given), [1.0, 0.5, 0.5]),
        (lambda given: Scene(changed().row, given), [0.1]),
        (lambda given: replace(changed(), row=given), list(changed().row)),
        (lambda given: replace(changed(), storeys={"a-b": given}), [1, 2]),
        (lambda given: replace(changed(), links=[Link("a-b", given, 1e3)]), [1, 2]),
        (lambda given: replace(changed(), links=[Link("a-b", given, 1e3)]), [[1, 2], [2, 1]]),
        (lambda given: replace(changed(), links=given), [Link("a-b", [1], 1e3)]),
        (lambda given: replace(changed(), bumpers=[Bumper("a-b", "linear", 1e3, storeys=given)]), [1]),
        (lambda given: replace(changed(), bumpers=given), [Bumper("a-b", "linear", 1e3)]),
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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": ""}, "name: must be a name, a non-empty text, not ''"),
        ({"name": None}, "name: must be a name, a non-empty text, not None"),
        ({"masses": [1.0, -2.0]}, r"masses\[1\]: -2\.0 won't do; it must be greater than 0"),
        ({"masses": [0.0, 2.0]}, r"masses\[0\]: 0\.0 won't do; it must be greater than 0"),
        ({"masses": [1.0, NAN]}, r"masses\[1\]: nan won't do; it must be greater than 0"),
        ({"masses": [1.0, INF]}, r"masses\[1\]: inf won't do; it must be a finite number"),
        (
            {"masses": [10**400, 1.0]},
            r"masses\[0\]: 100000000000000000000000000000000000000000000000000000000000000000000000000000000000",
        ),
        ({"masses": []}, r"masses: \[\] won't do; it must have at least 1 item after validation, not 0"),
        ({"masses": "12"}, "masses: must be a list, not '12'"),
        ({"masses": 3.0}, r"masses: must be a list, not 3\.0"),
        ({"masses": ["a", "b"]}, r"masses\[0\]: 'a' won't do; it must be a valid number"),
        ({"stiffnesses": [1e5]}, "stiffnesses: 1 values for 2 masses; give one per storey"),
        ({"stiffnesses": [1e5, 0.0]}, r"stiffnesses\[1\]: 0\.0 won't do; it must be greater than 0"),
        ({"stiffnesses": [-1e5, 1.0]}, r"stiffnesses\[0\]: -100000\.0 won't do; it must be greater than 0"),
        ({"storey_heights": [3.0]}, "storey_heights: 1 values for 2 masses; give one per storey"),
        ({"storey_heights": [3.0, -3.0]}, r"storey_heights\[1\]: -3\.0 won't do; it must be greater than 0"),
        ({"slab_depths": [0.3]}, "slab_depths: 1 values for 2 masses; give one per storey"),
        ({"slab_depths": "0.3"}, r"slab_depths: must be a list, not '0\.3'"),
        ({"slab_depths": [0.3, -0.1]}, r"slab_depths\[1\]: -0\.1 won't do; it must be greater than or equal to 0"),
        ({"slab_depths": [0.3, NAN]}, r"slab_depths\[1\]: nan won't do; it must be greater than or equal to 0"),
        ({"slab_depths": [3.0, 0.3]}, r"slab_depths\[0\]: is 3 m; it must be less than the storey's height of 3 m"),
        ({"damping_ratio": -0.01}, r"damping_ratio: -0\.01 won't do; it must be greater than or equal to 0"),
        ({"damping_ratio": 1.0}, r"damping_ratio: 1\.0 won't do; it must be less than 1"),
        ({"damping_ratio": NAN}, "damping_ratio: nan won't do; it must be greater than or equal to 0"),
        ({"damping_ratio": "5 %"}, "damping_ratio: '5 %' won't do; it must be a valid number"),
        (
            {"damping_ratio": (0.1, 0.2, 0.3)},
            r"damping_ratio: \(0\.1, 0\.2, 0\.3\) won't do; it must have at most 2 items after validation, not 3",
        ),
        (
            {"damping_ratio": (0.2, 0.01)},
            r"damping_ratio: \(0\.2, 0\.01\) gives the Rayleigh factors \(8\.97817603530342, -0\.0030384790733364204",
        ),
        (
            {"damping_ratio": (0.01, 0.5)},
            r"damping_ratio: \(0\.01, 0\.5\) gives the Rayleigh factors \(-8\.282671366722274, 0\.02270764970292784\)",
        ),
    ],
)
def test_bad_buildings(change, message):
    good = {"name": "b", "masses": [1.0, 1.0], "stiffnesses": [1e3, 1e3]}
    with pytest.raises(SceneError, match=message):
        Building(**{**good, **change})


# --- floors and contacts --------------------------------------------------------------------------------------------


def test_default_heights_and_elevations():
    assert building(n=3).elevations.tolist() == [3.0, 6.0, 9.0]
    assert building(n=2, storey_heights=[4.0, 3.5]).elevations.tolist() == [4.0, 7.5]


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


@pytest.mark.parametrize(
    ("storeys", "message"),
    [
        ({"a-c": [1]}, r"storeys: unknown pair 'a-c'; did you mean 'a-b'\? Valid: a-b"),
        ({"a-b": [3]}, "storeys: storey 3 of pair 'a-b' meets nothing; those that do: 1, 2"),
        ({"a-b": ["roof"]}, r"storeys\.a-b\[0\]: 'roof' won't do; it must be a valid integer"),
        ({"a-b": []}, r"storeys\.a-b: \[\] won't do; it must have at least 1 item after validation, not 0"),
        ({"a-b": 1}, r"storeys\.a-b: must be a list, not 1"),
        (7, "storeys: 7 won't do; it must be a valid dictionary"),
    ],
)
def test_bad_limits(storeys, message):
    with pytest.raises(SceneError, match=message):
        Scene([building("a", 3), building("b", 2)], [0.1], storeys=storeys)


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


def test_single_building_has_no_pairs():
    scene = Scene([building()])
    assert (scene.pair_names, scene.gaps, scene.contacts, scene.n_dof) == ((), (), (), 2)


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


def test_scenes_are_values():
    scene = get_preset("mate2015")
    again = pickle.loads(pickle.dumps(scene))
    assert again == scene
    assert hash(again) == hash(scene)
    assert scene != scene.with_gaps([0.01, 0.02])


@pytest.mark.parametrize(
    ("row", "gaps", "message"),
    [
        ([], [], "at least one building"),
        ([Wall("a"), Wall("b")], [0.1], "at least one building"),
        ([building("a"), Wall(), building("b")], [0.1, 0.1], "number 2 of the row; a wall may only be the first or"),
        ([building("a"), building("a")], [0.1], "names must differ within a row; repeated: 'a'"),
        (
            [building("a"), "b"],
            [0.1],
            r"row\[1\]: must be a Building or a table of name, masses, stiffnesses, damping_ratio, storey_heigh",
        ),
        (
            building("a"),
            [],
            r"row: must be a list, not Building\(name='a', masses=\(100\.0, 101\.0\), stiffnesses=\(100000\.0, 99000",
        ),
        (3, [], "row: must be a list, not 3"),
        ([building("a"), building("b")], [], "0 gaps for a row of 2; give 1"),
        ([building("a"), building("b")], [0.1, 0.2], "2 gaps for a row of 2; give 1"),
        ([building("a"), building("b")], [-0.01], r"gaps\[0\]: -0\.01 won't do; it must be greater than or equal to 0"),
        ([building("a"), building("b")], [NAN], r"gaps\[0\]: nan won't do; it must be greater than or equal to 0"),
        ([building("a"), building("b")], [INF], r"gaps\[0\]: inf won't do; it must be a finite number"),
        ([building("a"), building("b")], 0.01, r"gaps: must be a list, not 0\.01"),
        ([building("a"), building("b")], "1", "gaps: must be a list, not '1'"),
        ([building("a"), building("b")], ["x"], r"gaps\[0\]: 'x' won't do; it must be a valid number"),
        ([building(n) for n in ("a-b", "c", "a", "b-c")], [0.1] * 3, "two pairs of the row have the same name"),
    ],
)
def test_bad_scenes(row, gaps, message):
    with pytest.raises(SceneError, match=message):
        Scene(row, gaps)


@pytest.mark.parametrize("name", ["", "  ", 3, None])
def test_bad_wall_names(name):
    with pytest.raises(SceneError, match=r"Wall.*: name: must be a name"):
        Wall(name)


@pytest.mark.parametrize("what", ["linear_stiffness", "hertz_stiffness"])
@pytest.mark.parametrize("value", [0.0, -1.0, NAN, INF, "2e6", [1.0]])
def test_bad_contact_stiffness(what, value):
    with pytest.raises(SceneError, match=rf"ContactProperties: {what}: .* won't do; it must be"):
        ContactProperties(**{what: value})


@pytest.mark.parametrize("value", [-0.1, 1.1, NAN, "0.6"])
def test_bad_contact_restitution(value):
    with pytest.raises(SceneError, match=r"ContactProperties: restitution: .* won't do; it must be"):
        ContactProperties(restitution=value)


def test_contact_properties_may_be_a_table():
    assert Scene([building()], contact={"linear_stiffness": 1.0}).contact == ContactProperties(1.0)


def test_reference_by_exponent():
    contact = ContactProperties(linear_stiffness=1.0, hertz_stiffness=2.0)
    assert [contact.reference(x) for x in (1.0, 1.5, 2.0)] == [1.0, 2.0, None]
    assert ContactProperties().reference(1.0) is None


# --- contact laws ---------------------------------------------------------------------------------------------------

WITH_CONTACT = [law for law in LAWS.values() if law.has_contact]
TAKING_E = [law for law in LAWS.values() if law.takes_restitution]


def evaluate(expression, d, k=2.0e6, c=3.0e3):
    names = {"d": d, "r": math.sqrt(d), "k": k, "c": c, "sqrt": math.sqrt, "max": max, "__builtins__": {}}
    return float(eval(expression, names)) if expression else 0.0


def test_registry_is_complete():
    assert list(LAWS) == [law.key for law in LAWS.values()]
    assert len(LAWS) == 15
    for law in LAWS.values():
        assert law.title
        assert law.formula
        assert law.reference
        assert law.impulsive == (law.exponent is None and law.has_contact)
        assert law.takes_restitution == (law.damping != "none") == bool(law.number_text)
        assert bool(law.damper or law.yields) == (law.takes_restitution and not law.impulsive)
        assert law.exponent in (None, 1.0, 1.5)
        assert law.stiffness_unit == {None: "", 1.0: "kN m-1", 1.5: "kN m-1.5"}[law.exponent]
    assert [LAWS[key].model for key in MATE2015_MODELS] == ["I", "II", "III", "IV", "V", "VI", "VII"]
    assert [law.key for law in LAWS.values() if law.tension] == ["kelvin_voigt_tension"]


@pytest.mark.parametrize("law", WITH_CONTACT, ids=lambda law: law.key)
@pytest.mark.parametrize("d", [1e-6, 1e-4, 3e-3, 0.05])
def test_slopes_agree_with_finite_differences(law, d):
    h = 1e-4 * d
    for value, slope in ((law.elastic, law.elastic_slope), (law.damper, law.damper_slope)):
        difference = (evaluate(value, d + h) - evaluate(value, d - h)) / (2 * h)
        assert evaluate(slope, d) == pytest.approx(difference, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(
    "law", [law for law in WITH_CONTACT if not (law.impulsive or law.yields)], ids=lambda law: law.key
)
def test_elastic_force_has_the_stated_exponent(law):
    assert evaluate(law.elastic, 0.01) == pytest.approx(2.0e6 * 0.01**law.exponent, rel=1e-14)


@pytest.mark.parametrize("law", [law for law in TAKING_E if not law.impulsive], ids=lambda law: law.key)
def test_damping_numbers(law):
    e = np.array([0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0])
    numbers = damping_number(law, e)
    assert numbers[-1] == 0.0
    assert (np.diff(numbers) < 0).all()
    assert np.isfinite(numbers).all()
    if law.zero_restitution:
        assert np.isfinite(damping_number(law, 0.0)).all()


@pytest.mark.parametrize(
    ("key", "expected"),
    [  # at e = 0.6, from the published formulas by hand
        ("kelvin_voigt", 0.16049),
        ("kelvin_voigt_tension", 0.16049),
        ("modified_kelvin_voigt", 3 * 0.64 / 0.72),
        ("hertz_damped", 0.48),
        ("nonlinear_viscoelastic", 4.5 * math.sqrt(5) * 0.64 / (0.6 * (0.6 * (9 * math.pi - 16) + 16))),
        ("linear_viscoelastic", 0.64 / (0.6 * (0.6 * (math.pi - 2) + 2))),
        ("modified_kelvin", 1.0),
        ("hunt_crossley", 0.6),
        ("ye_hertz", 3.2 / 3.0),
        ("gonthier", 0.64 / 0.6),
        ("hysteretic", 0.64),
    ],
)
def test_damping_number_values(key, expected):
    assert float(damping_number(get_law(key), 0.6)) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("law", LAWS.values(), ids=lambda law: law.key)
def test_damping_coefficient(law):
    k, m = np.array([1e6, 2e6]), np.array([[50.0], [60.0], [70.0]])
    c = law.damping_coefficient(0.6, k, m)
    assert c.shape == (3, 2)
    if law.damping == "viscous":
        np.testing.assert_allclose(c, 2 * damping_number(law, 0.6) * np.sqrt(k * m))
    elif law.damping == "elastic":
        np.testing.assert_allclose(c, damping_number(law, 0.6) * k * np.ones_like(m))
    elif law.impulsive:
        assert (c == 0.6).all()
    elif law.yields:
        assert (c == 0.64).all()
    else:
        assert not c.any()


@pytest.mark.parametrize("law", LAWS.values(), ids=lambda law: law.key)
def test_validity_of_restitution(law):
    for e in (1e-6, 0.5, 1.0):
        law.check_restitution(e)
    if not law.takes_restitution:
        law.check_restitution(None)
        law.check_restitution(-3.0)  # ignored
        assert "takes none" in law.validity
        return
    for e in (-0.1, 1.1, NAN, INF):
        with pytest.raises(LawError, match=f"outside the validity of law '{law.key}'; give {law.validity}"):
            law.check_restitution(e)
    with pytest.raises(LawError, match="needs a coefficient of restitution"):
        law.check_restitution(None)
    if law.zero_restitution:
        law.check_restitution(0.0)
    else:
        with pytest.raises(LawError, match="0 < e <= 1"):
            law.check_restitution(0.0)


def test_get_law():
    law = get_law("hertz")
    assert isinstance(law, Law)
    assert get_law(law) is law
    with pytest.raises(LawError, match=r"unknown contact law 'herz'; did you mean 'hertz'\? Valid: gonthier"):
        get_law("herz")
    for bad in (None, ["hertz"], {}):
        with pytest.raises(LawError, match="unknown contact law"):
            get_law(bad)


def test_hertz_stiffness():
    r = [(3 * m / (4 * math.pi * 2.5)) ** (1 / 3) for m in (133.956, 136.286)]
    by_masses = hertz_stiffness(133.956, 136.286)
    assert by_masses == pytest.approx(1.88e7, rel=2e-3)
    assert by_masses == pytest.approx(hertz_stiffness(radii=tuple(r)), rel=1e-14)
    # two equal spheres of steel against the textbook: 4/3 E* sqrt(R*), E* = E / (2 (1 - nu^2))
    expected = 4 / 3 * 210e6 / (2 * (1 - 0.09)) * math.sqrt(0.5)
    assert hertz_stiffness(radii=(1.0, 1.0), young_modulus=210e6, poisson_ratio=0.3) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "two masses"),
        ({"mass_1": 1.0}, "two masses"),
        ({"mass_1": 1.0, "mass_2": -1.0}, "mass_2: -1.0"),
        ({"radii": (0.0, 1.0)}, "radii"),
        ({"radii": (1.0, 1.0), "young_modulus": 0.0}, "young_modulus"),
        ({"radii": (1.0, 1.0), "poisson_ratio": 0.5}, "poisson_ratio"),
        ({"mass_1": 1.0, "mass_2": 1.0, "density": NAN}, "density"),
    ],
)
def test_bad_hertz_stiffness(arguments, message):
    with pytest.raises(LawError, match=message):
        hertz_stiffness(**arguments)
