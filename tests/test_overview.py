"""What is said of a row before anything is run: in one place, by `plan`, `run` and `info`."""

from __future__ import annotations

import json

import pytest
from analysis_cubes import hand_cube, low_and_high, random_fill, sweep_attribute

from pounding_sweep import Building, Scene, Wall
from pounding_sweep.output.describe import about, describe
from pounding_sweep.request.spec import overview, overview_of


def row(**more):
    """Floors at 3, 6, 9 m beside floors at 3.5, 6, 9.5 m and a wall."""
    left = Building("left", [100.0] * 3, [1e5] * 3)
    right = Building("right", [50.0] * 3, [2e5] * 3, storey_heights=[3.5, 2.5, 3.5])
    return Scene([left, right, Wall("moat")], [0.01, 0.02], **more)


def test_each_building_and_pair_has_a_line():
    assert overview(row()) == [
        ("left", "3 storeys, 9 m high, periods 0.446, 0.159 s, weight 2943 kN"),
        ("right", "3 storeys, 9.5 m high, periods 0.223, 0.0797 s, weight 1472 kN"),
        ("left-right", "floors meet at 6 m; left passes through columns of right at 3, 9 m; right passes through "
         "columns of left at 3.5 m"),
        ("right-moat", "floors meet at 3.5, 6, 9.5 m"),
    ]  # fmt: skip


def test_limits_and_pairs_that_do_not_meet_are_told():
    told = dict(overview(row(storeys={"right-moat": [1]})))
    assert told["right-moat"] == "floors meet at 3.5 m (limited by the scene)"
    a, b = Building("a", [1.0], [9.0]), Building("b", [1.0], [9.0], storey_heights=[4.0])
    told = dict(overview(Scene([a, b], [0.1], allow_unmet=True)))
    assert told["a"] == "1 storey, 3 m high, period 2.09 s, weight 10 kN"
    assert told["a-b"].startswith("no floors meet; a passes through columns of b at 3 m")


def test_many_floors_are_counted():
    towers = [Building(name, [1.0] * 40, [9.0] * 40) for name in "ab"]
    assert overview(Scene(towers, [0.1]))[-1] == ("a-b", "floors meet at 3 to 120 (40) m")


def test_a_cube_tells_its_row():
    scene = low_and_high()
    cube = hand_cube(
        {"law": ["none"]}, random_fill(1, "drift_max"), attributes=sweep_attribute(scene, "el_centro", laws="none")
    )
    text = describe(cube)
    for name, said in overview(scene):
        assert f"{name}: ".ljust(8) in text
        assert said in text
    assert [tuple(each.values()) for each in about(cube)["row"]] == overview(scene)


@pytest.mark.parametrize("stored", ["", "3", "[]", "{}", '{"scene": 3}', '{"scene": {"row": [{}]}}', "[" * 10**6])
def test_a_file_may_hold_anything(stored):
    assert overview_of({"sweep": stored}) == []
    assert overview_of({}) == []


def test_the_row_of_one_scenario_is_told():
    from pounding_sweep.request.spec import json_data

    scene = row(storeys={"right-moat": [1]}, tolerance=2e-3)
    assert overview_of({"scene": json.dumps(json_data(scene))}) == overview(scene)
