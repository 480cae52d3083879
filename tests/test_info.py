"""What is said of rows and cubes: before anything is run, of cubes and of unfinished runs."""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray as xr
from scenes import call, hand_cube, low_and_high, random_fill, sweep_attribute

from pounding_sweep import Building, Scene, Wall
from pounding_sweep.output.describe import about, describe
from pounding_sweep.output.netcdf import write_cube
from pounding_sweep.request.spec import overview, overview_of
from pounding_sweep.resume import MANIFEST
from pounding_sweep.variables.registry import Status

AXES = {"law": ["none", "linear"], "gap": [0.01, 0.02, 0.03], "record": ["one", "two"]}
RECORDS = [{"name": "one", "pga": 1.5, "sha256": "3f2a"}, {"name": "two", "pga": 2.5, "sha256": "91bc"}]


def info(*arguments):
    return call("info", *arguments).stdout


def made():
    status = np.zeros((2, 3, 2))
    status[1, 2], status[0, 0, 0] = int(Status.NOT_RUN), int(Status.DIVERGED)
    told = {"title": "[A] row", "scenarios_asked": 12, "records": json.dumps(RECORDS), "numba_version": "0.61"}
    told |= {"extended_from": json.dumps({"file": "old.nc", "scenarios_taken": 3}), "rates": [1.0, np.nan]}
    return hand_cube(AXES, random_fill(3, "drift_max"), status=status, attributes=told)


def unfinished(folder):
    """Make the folder of a run of which nothing is done yet."""
    told = {"title": "Night", "asked": 9, "at_most": 7, "laws": ["none"], "records": ["one"]}
    told |= {"stage": "no pounding", "chunks": [["chunk-1", 0, 0, 4]]}
    folder.mkdir()
    lines = [{"sweep": {"package": "0.1.0"}}, told]
    (folder / MANIFEST).write_text("".join(f"{json.dumps(line)}\n" for line in lines))


def test_a_cube(tmp_path):
    cube = made()
    found = json.loads(info(write_cube(cube, tmp_path / "cube.nc"), "--json"))
    assert found["unfinished"] is None
    told = found["cube"]
    assert told["title"] == "[A] row"
    assert told["versions"]["numba"] == "0.61"
    assert told["dims"].keys() == set(cube.sizes)
    for name, size in cube.sizes.items():
        assert told["dims"][name]["size"] == size
        assert told["dims"][name]["values"] == cube[name].values.tolist()
    assert told["dims"]["gap"]["units"] == "m"
    assert told["variables"].keys() == set(cube.data_vars)
    drift = told["variables"]["drift_max"]
    assert drift == {"dims": list(cube.drift_max.dims), "units": "m", "long_name": cube.drift_max.attrs["long_name"]}
    assert told["statuses"] == {"ok": 9, "diverged": 1, "not_run": 2}
    assert [end["where"] for end in told["not_ok"]] == [
        "all 1 at law none; gap 0.01; record one",
        "all 2 at law linear; gap 0.03",
    ]
    for row in (row for end in told["not_ok"] for row in end["by_value"]):
        here = cube.status.sel({row["axis"]: row["value"]}).values
        assert row["of"] == here.size
        assert row["scenarios"] in (np.sum(here == Status.DIVERGED), np.sum(here == Status.NOT_RUN))
    text = info(tmp_path / "cube.nc", "--status")
    assert text.startswith("3 of 12 scenarios are not ok\n\n1 diverged: ")
    assert ["record", "one", "1", "6"] in map(str.split, text.splitlines())
    lost = write_cube(cube.assign(status=cube.status.clip(1)), tmp_path / "lost.nc")
    assert info(lost).splitlines()[:2] == ["No scenario is ok: 10 diverged, 2 not_run", "[A] row"]
    assert told["audit"] == []
    assert told["attributes"]["records"] == RECORDS
    assert told["attributes"]["extended_from"]["scenarios_taken"] == 3
    assert told["attributes"]["scenarios_asked"] == 12
    assert told["attributes"]["rates"] == [1.0, None]


def test_a_cube_that_was_cut_or_joined_tells_its_own_scenarios(tmp_path):
    cube = made()
    cut, joined = cube.isel(gap=[0]), xr.concat([cube, cube.assign_coords(gap=cube.gap + 0.1)], "gap")
    for other, size in ((cut, 4), (joined, 24)):
        path = write_cube(other, tmp_path / f"{size}.nc")
        assert f"  {size} scenarios (joined or cut after a run of 12)\n" in info(path)
        assert json.loads(info(path, "--json"))["cube"]["scenarios"] == size


def test_an_unfinished_run(tmp_path):
    parts = tmp_path / "out.nc.parts"
    unfinished(parts)
    expected = {"stage": "no pounding", "law": "none", "record": "one", "chunks": 1, "chunks_done": 0}
    for path in (tmp_path / "out.nc", parts):
        found = json.loads(info(path, "--json"))
        assert found["cube"] is None
        told = found["unfinished"]
        assert told["folder"] == str(parts)
        assert (told["title"], told["asked"], told["at_most"], told["planned"]) == ("Night", 9, 7, False)
        assert told["details"] == {"package": "0.1.0"}
        assert told["parts"] == [{**expected, "scenarios": 4, "scenarios_done": 0}]
        assert told["now"] is None
    write_cube(made(), tmp_path / "out.nc")
    both = json.loads(info(tmp_path / "out.nc", "--json"))
    assert both["cube"]["statuses"]["ok"] == 9
    assert both["unfinished"]["asked"] == 9
    assert info(tmp_path / "out.nc").endswith(f"\nAn unfinished run stands beside this cube:\n{info(parts)}")


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
