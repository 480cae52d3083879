"""``pounding-sweep compare`` as users meet it, on cubes made by hand."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scenes import call, hand_cube, low_and_high, random_fill, sweep_attribute

from pounding_sweep import Record
from pounding_sweep.analysis.comparisons import COMPARISONS, table_rows
from pounding_sweep.analysis.rebuild import intensity_of
from pounding_sweep.model.building import Building
from pounding_sweep.model.scene import Scene
from pounding_sweep.output.netcdf import open_cube, write_cube
from pounding_sweep.variables.registry import Status

NAMES = (
    "displacement_max",
    "displacement_min",
    "drift_max",
    "acceleration_max",
    "impact_count",
    "impact_force_max",
    "drift_ratio_max",
)


def sines(names):
    """Records that are nowhere to be found."""
    return [Record(name, 0.01, np.sin(12.0 * np.arange(50) * 0.01)) for name in names]


@pytest.fixture(scope="module")
def cube_file(tmp_path_factory):
    """Make a cube of random numbers: some scenarios touch."""
    axes = {"law": ["none", "linear", "hertz_damped"], "gap": [0.002, 0.01], "restitution": [0.4, 0.6]}
    axes |= {"record": ["one", "two"], "scale": [0.1, 0.3, 1.0, 2.0]}
    about = sweep_attribute(low_and_high(), sines(axes["record"]), laws="none", scales=axes["scale"])
    cube = hand_cube(axes, random_fill(1, *NAMES), attributes=about)
    cube["impact_count"][0] = 0
    return write_cube(cube, tmp_path_factory.mktemp("compare") / "cube.nc")


def run(*arguments, code=0):
    """Run the command, its words apart or in one text; return what it printed."""
    return call("compare", *(word for text in arguments for word in str(text).split()), code=code)


def told(*arguments):
    """Return what one comparison says as JSON."""
    ((_, part),) = json.loads(run(*arguments, "--json").stdout).items()
    return part


@pytest.fixture(scope="module")
def written(cube_file, tmp_path_factory):
    """What a summary says, and the folder of what it wrote, with no picture made of its figures."""
    folder = tmp_path_factory.mktemp("written") / "new" / "folder"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("matplotlib.figure.Figure.savefig", lambda figure, file, **_: Path(file).touch())
        return run(cube_file, "-o", folder).stdout, folder


def test_summary_lists_what_is_possible_and_why_the_rest_is_not(written):
    possible, _, impossible = written[0].partition("Not possible with this cube")
    for key in ("amplification", "laws", "impacts", "fractiles", "incremental", "fragility"):
        assert f"  {key}" in possible
        assert f"\n{key}: {COMPARISONS[key].title}" in written[0]
    assert "  required-gap         2 of the 2 records" in impossible
    assert "  energy               the energy budget needs 'energy_input'" in impossible


def test_one_scenario_with_its_histories(tmp_path):
    one = hand_cube({"law": ["linear"]}, random_fill(1, "impact_count", "drift_max")).isel(law=0, drop=True)
    one["velocity"] = (("time", "building"), np.zeros((5, one.sizes["building"])))
    report = json.loads(run(write_cube(one, tmp_path / "one.nc"), "--json").stdout)
    assert [key for key, part in report.items() if part["possible"]] == ["impacts"]
    shares = [row["median"] for row in report["impacts"]["rows"] if row["variable"] == "pair_touching_share"]
    assert shares == (one.impact_count > 0).max("storey").values.tolist()


@pytest.mark.parametrize("key", ["amplification", pytest.param("impacts", marks=pytest.mark.slow)])
def test_one_comparison_prints_the_rows_of_its_result(cube_file, key):
    rows = told(cube_file, "--what", key)["rows"]
    with open_cube(cube_file) as cube:
        together = [dim for dim in cube["status"].dims if dim in ("gap", "restitution", "record")]
        apart = {"over": together} if key == "impacts" else {}
        expected = table_rows(COMPARISONS[key].make(cube, **apart), COMPARISONS[key])
    assert rows == json.loads(json.dumps(expected))
    text = run(cube_file, "--what", key).stdout
    assert text.startswith(f"{key}: ")
    assert len(text.splitlines()) >= len(rows) + 2


def test_files(cube_file, written):
    _, folder = written
    made = {path.name for path in folder.iterdir()}
    for key in ("amplification", "laws", "incremental", "fragility", "impacts", "fractiles"):
        assert {f"{key}.csv", f"{key}.nc", *([f"{key}.png", f"{key}.txt"] if COMPARISONS[key].figure else [])} <= made
    with open_cube(cube_file) as cube, open_cube(folder / "amplification.nc") as stored:
        expected = COMPARISONS["amplification"].make(cube)
        xr.testing.assert_allclose(stored, expected)
        assert stored.displacement_peak_ratio.attrs["units"] == "1"
    with (folder / "amplification.csv").open(newline="") as file:
        first = next(csv.DictReader(file))
    assert first["variable"] == "displacement_max_ratio"
    assert (first["record"], first["scale"], first["over"]) == ("one", "0.1", "2 gaps, 2 restitutions, 2 storeys")
    touching = expected.displacement_max_ratio.where(expected.touches == 1.0)
    touching = touching.sel(law="linear", building="a", record="one", scale=0.1)
    assert first["largest"] == f"{float(touching.max()):.7g}"
    assert float(first["median"]) == pytest.approx(float(touching.median()))


def test_fractiles_of_counts_are_no_whole_numbers(cube_file, written):
    with xr.open_dataset(written[1] / "fractiles.nc") as stored, open_cube(cube_file) as cube:
        expected = cube.impact_count.median("record")
        np.testing.assert_allclose(stored.impact_count_fractiles.sel(quantile=0.5), expected)
        assert float((expected % 1.0).max()) == 0.5


def test_data_that_are_there_are_replaced_only_when_told(cube_file, tmp_path):
    """Nothing is computed, and no file changed, for a folder that holds one of the tables or results."""
    for name in ("impacts.nc", "impacts.csv", "impacts.png", "laws.csv"):
        (tmp_path / name).write_text("mine")
    what = ("--what", "impacts", "-o", tmp_path)
    for name in ("impacts.csv", "impacts.nc"):
        refused = run(cube_file, *what, code=2)
        assert f"'{tmp_path / name}' exists" in refused.stderr
        assert "--overwrite" in refused.stderr
        assert refused.stdout == ""
        assert (tmp_path / "impacts.nc").read_text() == "mine"
        (tmp_path / "impacts.csv").unlink(missing_ok=True)
    run(cube_file, *what, "--overwrite")
    with open_cube(tmp_path / "impacts.nc") as result:
        assert "pair_touching_share" in result
    assert (tmp_path / "impacts.csv").read_text().startswith("variable,")
    assert (tmp_path / "laws.csv").read_text() == "mine"  # not asked for
    assert "impacts.csv' exists" in run(cube_file, "-o", tmp_path, code=2).stderr  # a summary writes them all


@pytest.mark.parametrize(
    ("words", "attribute"),
    [
        ("laws --reference linear", ("reference_law", "linear")),
        ("fragility --event force --level 50", ("event_in_words", "contact force above 50 kN")),
        ("fragility --event drift_ratio --level 1.5%", ("event_in_words", "interstorey drift ratio above 1.5 %")),
        ("fragility --event drift_ratio --level 0.015", ("event_in_words", "interstorey drift ratio above 1.5 %")),
    ],
)
def test_settings(cube_file, words, attribute):
    assert attribute in told(cube_file, "--what", words)["attributes"].items()


def test_a_table_has_no_column_that_is_the_same_in_all_rows(tmp_path):
    axes = {"law": ["linear", "none"], "gap": [0.01, 0.02], "record": ["one"], "scale": [1.0]}
    path = write_cube(hand_cube(axes, random_fill(1, "drift_max", "impact_count")), tmp_path / "one.nc")
    lines = run(path, "--what", "amplification").stdout.splitlines()
    assert lines[1].startswith("  variable: drift_max_ratio; units: 1; law: linear")
    assert max(map(len, lines)) <= 100


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--what amplificaton", "did you mean 'amplification'"),
        ("--what energy", "energy_input"),
        ("--event tuch", "unknown event 'tuch'; did you mean 'touch'? Valid: "),
        ("--event force", "event 'force' needs a level"),
        ("--level 3", "event 'touch' takes no level"),
        ("--event drift --level 1%", "level '1%' of event 'drift' is in per cent, which drift_ratio and the like take"),
        ("--event drift --level x", "'x' is no number; give one, such as 0.01, or 1%"),
        ("--event drift_ratio --level 2", "level 2 of event 'drift_ratio' is 200%; give a ratio below 1"),
        ("--reference liner", "unknown reference law 'liner'; did you mean 'linear'? Valid: "),
        ("--reference none", "unknown reference law 'none'"),
        ("--what impacts --event touch", "--event is for the comparison 'fragility'; leave it out, or add"),
        ("--what laws --records .", "--records is for the comparisons 'fragility', 'gap-for-prob"),
        ("--what sensitivity --intensity sa", "--intensity is for the comparisons 'amplification', 'ener"),
        ("--what laws --probability 0.1", "--probability is for the comparison 'gap-for-probability'"),
        *(
            (f"--probability {text}", said)
            for text, said in (
                ("1", "probabilities: 1 is not in (0, 1)"),
                ("0%", "probabilities: 0 is not in (0, 1)"),
                ("one", "probabilities: ['one']; give a number in (0, 1), or a list of one or more"),
            )
        ),
        ("--q left", "factor q ['left']: give one number, or BUILDING=NUMBER for each"),
        ("--what laws --ie 1.5", "--cd, --ie, --q, --r is for the comparisons 'gap-for-probability', 'required-gap'"),
        ("--intensity sv", "unknown intensity 'sv'; valid: pga, pgv, sa(PERIOD in s)"),
        ("--quantile 2", "quantiles: 2 is not in [0, 1]"),
        ("--years 50", "--years are those of a hazard; add --hazard"),
        ("--hazard k0=1e-3", "hazard 'k0=1e-3' won't do; give a CSV file, or k0=RATE,kappa=SLOPE"),
        ("--over gap", "unknown axis to take together 'gap'; did you mean 'pga'? Valid: pga, record, sa, scale"),
        ("--at gap=0.003", "gap '0.003' is not on the axis; it has 0.002, 0.01"),
        ("--at building=c", "unknown building 'c'; valid: a, b"),
    ],
)
def test_wrong_options_are_refused(cube_file, tmp_path, words, said):
    """Before anything is computed, in a summary too, and before files are written."""
    refused = run(cube_file, words, "-o", tmp_path / "out", code=2)
    assert said in refused.stderr
    assert refused.stdout == ""
    assert not (tmp_path / "out").exists()


def test_scenarios_that_are_left_out_are_counted(tmp_path):
    axes = {"law": ["linear", "none"], "gap": [0.01, 0.02, 0.03], "record": ["one"], "scale": [1.0]}
    status = np.zeros((2, 3, 1, 1))
    status[0, 1:], status[1, 0] = int(Status.NOT_RUN), int(Status.DIVERGED)
    fill = random_fill(1, "drift_max", "impact_count")
    for given, left_out in ((status, {"diverged": 1, "not_run": 2}), (None, {})):
        path = write_cube(hand_cube(axes, fill, status=given), tmp_path / f"{len(left_out)}.nc")
        for arguments in ((), ("--what", "impacts")):
            first = run(path, *arguments).stdout.splitlines()[0]
            said = "3 of 6 scenarios are left out, as they are not ok: 1 diverged, 2 not_run"
            assert (first == said) if left_out else ("left out" not in first)
        assert told(path, "--what", "impacts")["left_out"] == left_out


def test_listed_cases_have_tables_and_say_why_there_is_no_figure(tmp_path):
    coords = {"law": (("case",), ["none", "linear", "hertz"], {}), "record": (("case",), ["one"] * 3, {})}
    fill = random_fill(1, "drift_max") | {"impact_count": np.ones(1)}
    path = write_cube(hand_cube({"case": [1, 2, 3]}, fill, coords=coords), tmp_path / "cases.nc")
    result = run(path, "--what", "amplification", "-o", tmp_path / "out")
    why = "the figure needs the axis 'law', and this cube lists its scenarios as cases"
    assert f"no figure of amplification: {why}" in result.stderr
    assert "linear" in result.stdout
    assert "hertz" in result.stdout


def test_records_and_scales_are_apart_and_what_is_pooled_is_named(cube_file):
    apart = told(cube_file, "--what", "laws", "--at", "gap=0.01")["rows"]
    assert {row["over"] for row in apart if row["pair"]} == {"2 restitutions, 2 storeys"}
    motions = {(row["record"], row["scale"]) for row in apart}
    assert motions == {(r, s) for r in ("one", "two") for s in (0.1, 0.3, 1, 2)}
    pooled = told(cube_file, "--what laws --at gap=0.01 --over record --at scale=2")["rows"]
    assert {row["over"] for row in pooled if row["pair"]} == {"2 restitutions, 2 records, 2 storeys"}
    assert "record" not in pooled[0]
    with open_cube(cube_file) as cube:
        ratio = COMPARISONS["laws"].make(cube.sel(gap=[0.01], scale=[2.0])).impact_force_max_ratio
        expected = ratio.sel(law="linear", pair="a-b", basis="nominal").median()
    wanted = {"variable": "impact_force_max_ratio", "law": "linear", "pair": "a-b", "basis": "nominal"}
    (row,) = (row for row in pooled if wanted.items() <= row.items())
    assert row["median"] == pytest.approx(float(expected))


def test_quantiles_of_a_table(cube_file):
    words = "--what amplification --at law=linear --at law=none --at building=b --over record --over scale"
    row = told(cube_file, words, "--quantile 0.25 --quantile 0.9")["rows"][0]
    with open_cube(cube_file) as cube:
        ratios = COMPARISONS["amplification"].make(cube.sel(law=["none", "linear"]))
        values = ratios.displacement_max_ratio.where(ratios.touches == 1.0).sel(building="b").values
    assert [row["0.25 fractile"], row["0.9 fractile"]] == pytest.approx(np.nanquantile(values, [0.25, 0.9]))
    assert "median" not in row
    fits = told(cube_file, "--what fragility --event force --level 1 --quantile 0.1")["rows"]
    for row in (row for row in fits if row["fit"] == "fitted"):
        assert row["at 0.1"] == pytest.approx(row["median"] * np.exp(-1.2815515655 * row["dispersion"]))
    assert all(row["over"] == "2 records, 4 scales" for row in fits)


def test_tables_of_records_and_scales_tell_the_intensity(cube_file):
    """Of the motion of each row; where motions are taken together there is none."""
    rows = told(cube_file, "--what impacts --intensity pga")["rows"]
    with open_cube(cube_file) as cube:
        strength = intensity_of(cube, "pga")
    for row in rows:
        assert row["pga m s-2"] == pytest.approx(float(strength.sel(record=row["record"], scale=row["scale"])))
    whole = told(cube_file, "--what amplification --intensity pga --over record")["rows"]
    assert {row["pga m s-2"] for row in whole} == {None}


def test_the_question_of_a_gap_for_one_percent(tmp_path):
    """From runs without pounding alone; parts of the row are taken of what the whole row gives."""
    axes = {"law": ["none"], "record": ["one", "two", "three"]}
    about = sweep_attribute(low_and_high(), sines(axes["record"]), laws="none")
    cube = hand_cube(axes, random_fill(2, "displacement_max", "displacement_min", "closing_max"), attributes=about)
    asked = (write_cube(cube, tmp_path / "still.nc"), "--what", "gap-for-probability", "--probability", "1%")
    asked = (*asked, "--intensity", "pga", "--given", "2")
    rows = told(*asked, "--hazard k0=1e-3,kappa=2 --years 10 --at pair=a-b")["rows"]
    assert [row["given"] for row in rows] == ["intensity 2 m s-2", "in 10 years", "the row's gap"]
    per_pga = cube.closing_max.isel(law=0).sel(pair="a-b").max("storey") / cube.record_pga * 2.0
    logs = np.log(per_pga.values)
    assert rows[0]["gap"] == pytest.approx(np.exp(logs.mean() + 2.3263478740 * logs.std(ddof=1)))
    assert rows[1]["rate"] == pytest.approx(-np.log(0.99) / 10)
    assert "intensity: peak ground acceleration (m s-2)" in run(*asked, "--at", "pair=a-b").stdout
    said = "'gap-for-probability' does not tell one building from another, only pair; leave building out"
    assert said in run(*asked, "--at", "building=a", code=2).stderr
    (tmp_path / "site.csv").write_text("x,rate\n1,1e-3\n2,2e-3\n")
    refused = run(*asked, "--hazard", tmp_path / "site.csv", code=2)
    assert "site.csv:3: annual rate 0.002 follows 0.001: a stronger motion must be rarer" in refused.stderr


@pytest.fixture(scope="module")
def floors_file(tmp_path_factory):
    """Two buildings of two storeys that meet at 3 and 6 m, five records: the lower floors touch under two of them."""
    scene = Scene([Building(name, [100.0, 80.0], [2e4, 1e4]) for name in "ab"], gaps=[0.01])
    force = np.array([[[0, 0, 0, 10, 30], [50, 100, 200, 400, 800]], [[0] * 5, [0] * 5]], float)  # law, storey, record
    force = force.transpose(0, 2, 1)[:, None, :, None, :]  # law, gap, record, pair, storey
    shear = np.array([[[7.0, 99.0], [5.0, 99.0]], [[4.0, 99.0], [3.0, 99.0]]])[:, None, None]  # law, building, storey
    axes = {"law": ["linear", "none"], "gap": [0.01], "record": list("vwxyz")}
    fill = {"impact_force_max": force, "storey_shear_max": shear, "impact_count": (force > 0).astype(int)}
    return write_cube(hand_cube(axes, fill, scene=scene), tmp_path_factory.mktemp("floors") / "cube.nc")


@pytest.mark.parametrize(
    ("words", "lower", "counted"),
    [
        ("impacts", {"values": 2, "16 %": 13.2, "median": 20, "84 %": 26.8, "largest": 30}, "do not count as 0"),
        ("fractiles --at law=linear", {"values": 5, "16 %": 0, "median": 0, "84 %": 17.2, "largest": 30}, "count as 0"),
    ],
)
def test_forces_floor_by_floor(floors_file, words, lower, counted):
    part = told(floors_file, "--what", words)
    rows = [row for row in part["rows"] if row["variable"] == "impact_force_max_fractiles"]
    upper = {"values": 5, "16 %": 82.0, "median": 200.0, "84 %": 544.0, "largest": 800.0}
    for row, storey, share, numbers in zip(rows, (1, 2), (0.4, 1.0), (lower, upper), strict=True):
        assert (row["storey"], row["elevation (m)"], row["touching"]) == (storey, 3.0 * storey, share)
        assert {name: row[name] for name in numbers} == pytest.approx(numbers)
    assert counted in part["attributes"]["counted"]
    assert f"counted: {part['attributes']['counted']}" in run(floors_file, "--what", words).stdout


def test_base_shear_with_pounding_and_without(floors_file):
    rows = told(floors_file, "--what amplification --over record")["rows"]
    shears = {(row["variable"], row["building"]): row["median"] for row in rows if row["units"] == "kN"}
    with_pounding, without = (dict(zip("ab", pair, strict=True)) for pair in ((7.0, 5.0), (4.0, 3.0)))
    for building in "ab":
        assert shears["base_shear", building] == with_pounding[building]
        assert shears["base_shear_without", building] == without[building]


def test_many_rows_are_summed_up_in_print_alone(tmp_path):
    axes = {"law": ["linear", "none"], "gap": [0.01], "record": [f"r{i}" for i in range(120)]}
    path = write_cube(hand_cube(axes, random_fill(1, "drift_max", "impact_count")), tmp_path / "many.nc")
    rows = told(path, "--what amplification")["rows"]
    printed = run(path, "--what amplification").stdout
    assert len(rows) > 200
    assert "over: 120 records" in printed
    assert f"summary of {len(rows)} rows: choose with --at and --over, or write all with -o FOLDER" in printed
    assert "r7" not in printed
    assert "r7" in run(path, "--what amplification --at record=r7 --at record=r8").stdout
