"""``pounding-sweep compare`` as users meet it, on cubes made by hand."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from analysis_cubes import hand_cube, low_and_high, random_fill, sweep_attribute
from typer.testing import CliRunner

from pounding_sweep import Record
from pounding_sweep.analysis.comparisons import COMPARISONS, table_rows
from pounding_sweep.analysis.rebuild import intensity_of
from pounding_sweep.cli import app as cli_app
from pounding_sweep.output.netcdf import open_cube, write_cube
from pounding_sweep.outputs.variables import Status


@pytest.fixture(scope="module")
def cube_file(tmp_path_factory):
    """Make a cube of random numbers: some scenarios touch; its records are nowhere to be found."""
    axes = {"law": ["none", "linear", "hertz_damped"], "gap": [0.002, 0.01], "restitution": [0.4, 0.6]}
    axes |= {"record": ["one", "two"], "scale": [0.1, 0.3, 1.0, 2.0]}
    names = [
        "displacement_max",
        "displacement_min",
        "drift_max",
        "acceleration_max",
        "impact_count",
        "impact_force_max",
    ]
    records = [Record(name, 0.01, np.sin(12.0 * np.arange(50) * 0.01)) for name in axes["record"]]
    about = sweep_attribute(low_and_high(), records, laws="none", scales=axes["scale"])
    cube = hand_cube(axes, random_fill(1, *names), attributes=about)
    cube["impact_count"][0] = 0
    return write_cube(cube, tmp_path_factory.mktemp("compare") / "cube.nc")


def run(*arguments):
    """Run the command; return what it printed."""
    return CliRunner().invoke(cli_app.app, ["compare", *map(str, arguments)])


def rows_of(*arguments):
    """Return the rows of one comparison as JSON has them."""
    result = run(*arguments, "--json")
    assert result.exit_code == 0, result.stderr
    ((_, told),) = json.loads(result.stdout).items()
    return told["rows"]


@pytest.fixture(scope="module")
def written(cube_file, tmp_path_factory):
    """What a summary says, and the folder of what it wrote, with no picture made of its figures."""
    folder = tmp_path_factory.mktemp("written") / "new" / "folder"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("matplotlib.figure.Figure.savefig", lambda figure, file, **_: Path(file).touch())
        result = run(cube_file, "-o", folder)
    assert result.exit_code == 0, result.stderr
    return result.stdout, folder


def test_summary_lists_what_is_possible_and_why_the_rest_is_not(written):
    stdout, _ = written
    possible, _, impossible = stdout.partition("Not possible with this cube")
    for key in ("amplification", "laws", "impacts", "fractiles", "incremental", "fragility"):
        assert f"  {key}" in possible
        assert f"\n{key}: {COMPARISONS[key].title}" in stdout
    assert "  required-gap         2 of the 2 records" in impossible
    assert "  energy               the energy budget needs 'energy_input'" in impossible


def test_one_scenario_with_its_histories(tmp_path):
    counts = random_fill(1, "impact_count", "drift_max")
    one = hand_cube({"law": ["linear"]}, counts).isel(law=0, drop=True)
    one["velocity"] = (("time", "building"), np.zeros((5, one.sizes["building"])))
    result = run(write_cube(one, tmp_path / "one.nc"), "--json")
    assert result.exit_code == 0, result.stderr
    told = json.loads(result.stdout)
    assert [key for key, part in told.items() if part["possible"]] == ["impacts"]
    shares = [row for row in told["impacts"]["rows"] if row["variable"] == "pair_touching_share"]
    touched = (one.impact_count > 0).max("storey")
    assert [row["median"] for row in shares] == touched.values.tolist()


@pytest.mark.parametrize("key", ["amplification", pytest.param("impacts", marks=pytest.mark.slow)])
def test_one_comparison_prints_the_rows_of_its_result(cube_file, key):
    rows = rows_of(cube_file, "--what", key)
    with open_cube(cube_file) as cube:
        apart = {"over": ["gap", "restitution"]} if key == "impacts" else {}
        expected = table_rows(COMPARISONS[key].make(cube, **apart), COMPARISONS[key])
    assert rows == json.loads(json.dumps(expected))
    text = run(cube_file, "--what", key).stdout
    assert text.startswith(f"{key}: ")
    assert len(text.splitlines()) >= len(rows) + 2


def test_files(cube_file, written):
    _, folder = written
    made = {path.name for path in folder.iterdir()}
    for key in ("amplification", "laws", "incremental", "fragility"):
        assert {f"{key}.csv", f"{key}.nc", f"{key}.png"} <= made
    assert {"impacts.csv", "impacts.nc", "fractiles.csv", "fractiles.nc"} <= made
    with open_cube(cube_file) as cube:
        expected = COMPARISONS["amplification"].make(cube).load()
    with open_cube(folder / "amplification.nc") as stored:
        xr.testing.assert_allclose(stored, expected)
        assert stored.displacement_peak_ratio.attrs["units"] == "1"
    with (folder / "amplification.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    first = rows[0]
    assert first["variable"] == "displacement_max_ratio"
    assert (first["record"], first["scale"], first["over"]) == ("one", "0.1", "2 gaps, 2 restitutions, 2 storeys")
    touching = expected.displacement_max_ratio.where(expected.touches == 1.0)
    touching = touching.sel(law="linear", building="a", record="one", scale=0.1)
    assert float(first["largest"]) == float(touching.max())
    assert float(first["median"]) == pytest.approx(float(touching.median()))


def test_data_that_are_there_are_replaced_only_when_told(cube_file, tmp_path):
    """Nothing is computed, and no file changed, for a folder that holds one of the tables or results."""
    for name in ("impacts.nc", "impacts.csv", "impacts.png", "laws.csv"):
        (tmp_path / name).write_text("mine")
    what = ("--what", "impacts", "-o", tmp_path)
    for name in ("impacts.csv", "impacts.nc"):
        refused = run(cube_file, *what)
        assert refused.exit_code == 2
        assert f"'{tmp_path / name}' exists" in refused.stderr
        assert "--overwrite" in refused.stderr
        assert refused.stdout == ""
        assert (tmp_path / "impacts.nc").read_text() == "mine"
        (tmp_path / "impacts.csv").unlink(missing_ok=True)
    told = run(cube_file, *what, "--overwrite")
    assert told.exit_code == 0, told.stderr
    with open_cube(tmp_path / "impacts.nc") as found:
        assert "pair_touching_share" in found
    with (tmp_path / "impacts.csv").open(newline="") as file:
        assert next(csv.reader(file))[0] == "variable"
    assert (tmp_path / "laws.csv").read_text() == "mine"  # not asked for
    assert "impacts.csv' exists" in run(cube_file, "-o", tmp_path).stderr  # a summary writes them all


def test_fractiles_of_counts_are_kept_as_they_are(cube_file, tmp_path):
    """They are no whole numbers, as counts are."""
    run(cube_file, "--what", "fractiles", "-o", tmp_path)
    with xr.open_dataset(tmp_path / "fractiles.nc") as stored, open_cube(cube_file) as cube:
        expected = cube.impact_count.median("record")
        np.testing.assert_allclose(stored.impact_count_fractiles.sel(quantile=0.5), expected)
        assert float((expected % 1.0).max()) == 0.5


def test_settings(cube_file):
    for words, attribute in (
        (("--what", "laws", "--reference", "linear"), ("reference_law", "linear")),
        (("--what", "fragility", "--event", "force", "--level", "50"), ("event_in_words", "contact force above 50 kN")),
    ):
        (part,) = json.loads(run(cube_file, *words, "--json").stdout).values()
        assert attribute in part["attributes"].items()


def test_a_table_has_no_column_that_is_the_same_in_all_rows(tmp_path):
    axes = {"law": ["linear", "none"], "gap": [0.01, 0.02], "record": ["one"], "scale": [1.0]}
    path = write_cube(hand_cube(axes, random_fill(1, "drift_max", "impact_count")), tmp_path / "one.nc")
    lines = run(path, "--what", "amplification").stdout.splitlines()
    assert lines[1].startswith("  variable: drift_max_ratio; units: 1; law: linear")
    assert max(map(len, lines)) <= 100


def test_wrong_usage(cube_file, tmp_path):
    for arguments, said in (
        ((cube_file, "--what", "amplificaton"), "did you mean 'amplification'"),
        ((cube_file, "--what", "energy"), "energy_input"),
        ((tmp_path / "none.nc",), "does not exist"),
    ):
        result = run(*arguments)
        assert result.exit_code == 2
        assert said in result.stderr


def test_options_that_would_do_nothing_are_refused(cube_file, tmp_path):
    """Before anything is computed, in a summary too, and before files are written."""
    for arguments, said in (
        (("--event", "tuch"), "unknown event 'tuch'; did you mean 'touch'? Valid: "),
        (("--event", "force"), "event 'force' needs a level"),
        (("--level", "3"), "event 'touch' takes no level"),
        (("--reference", "liner"), "unknown reference law 'liner'; did you mean 'linear'? Valid: "),
        (("--reference", "none"), "unknown reference law 'none'"),
        (("--what", "impacts", "--event", "touch"), "--event is for the comparison 'fragility'; leave it out, or add"),
        (("--what", "laws", "--level", "3"), "--level is for the comparison 'fragility'"),
        (("--what", "impacts", "--reference", "linear"), "--reference is for the comparison 'laws'"),
        (("--what", "laws", "--records", tmp_path), "--records is for the comparisons 'fragility', 'gap-for-prob"),
        (("--what", "sensitivity", "--intensity", "sa"), "--intensity is for the comparisons 'amplification', 'ener"),
        (("--what", "laws", "--probability", "0.1"), "--probability is for the comparison 'gap-for-probability'"),
        (("--probability", "1.5"), "probabilities: 1.5 is not in (0, 1)"),
        (("--intensity", "sv"), "unknown intensity 'sv'; valid: pga, pgv, sa(PERIOD in s)"),
        (("--quantile", "2"), "quantiles: 2 is not in [0, 1]"),
        (("--years", "50"), "--years are those of a hazard; add --hazard"),
        (("--hazard", "k0=1e-3"), "hazard 'k0=1e-3' won't do; give a CSV file, or k0=RATE,kappa=SLOPE"),
        (("--over", "gap"), "unknown axis to take together 'gap'; did you mean 'pga'? Valid: pga, record, sa, scale"),
        (("--at", "gap=0.003"), "gap '0.003' is not on the axis; it has 0.002, 0.01"),
        (("--at", "building=c"), "unknown building 'c'; valid: a, b"),
    ):
        refused = run(cube_file, *arguments, "-o", tmp_path / "out")
        assert refused.exit_code == 2
        assert said in refused.stderr
        assert refused.stdout == ""
        assert not (tmp_path / "out").exists()


def test_scenarios_that_are_left_out_are_counted(tmp_path):
    axes = {"law": ["linear", "none"], "gap": [0.01, 0.02, 0.03], "record": ["one"], "scale": [1.0]}
    status = np.zeros((2, 3, 1, 1))
    status[0, 1:], status[1, 0] = int(Status.NOT_RUN), int(Status.DIVERGED)
    fill = random_fill(1, "drift_max", "impact_count")
    holes, whole = (
        write_cube(hand_cube(axes, fill, status=given), tmp_path / f"{name}.nc")
        for name, given in (("holes", status), ("whole", None))
    )
    for arguments in ((), ("--what", "impacts")):
        first = run(holes, *arguments).stdout.splitlines()[0]
        assert first == "3 of 6 scenarios are left out, as they are not ok: 1 diverged, 2 not_run"
        assert "left out" not in run(whole, *arguments).stdout
    for path, left_out in ((holes, {"diverged": 1, "not_run": 2}), (whole, {})):
        assert json.loads(run(path, "--what", "impacts", "--json").stdout)["impacts"]["left_out"] == left_out


def test_listed_cases_have_tables_and_say_why_there_is_no_figure(tmp_path):
    coords = {"law": (("case",), ["none", "linear", "hertz"], {}), "record": (("case",), ["one"] * 3, {})}
    fill = random_fill(1, "drift_max") | {"impact_count": np.ones(1)}
    cube = hand_cube({"case": [1, 2, 3]}, fill, coords=coords)
    path = write_cube(cube, tmp_path / "cases.nc")
    result = run(path, "--what", "amplification", "-o", tmp_path / "out")
    assert result.exit_code == 0, result.stderr
    assert (
        "no figure of amplification: the figure needs the axis 'law', and this cube lists its scenarios as cases"
        in result.stderr
    )
    assert "linear" in result.stdout
    assert "hertz" in result.stdout


def test_records_and_scales_are_apart_and_what_is_pooled_is_named(cube_file):
    apart = rows_of(cube_file, "--what", "laws", "--at", "gap=0.01")
    assert {row["over"] for row in apart if row["pair"]} == {"2 restitutions, 2 storeys"}
    assert {(row["record"], row["scale"]) for row in apart} == {
        (r, s) for r in ("one", "two") for s in (0.1, 0.3, 1, 2)
    }
    pooled = rows_of(cube_file, "--what", "laws", "--at", "gap=0.01", "--over", "record", "--at", "scale=2")
    assert {row["over"] for row in pooled if row["pair"]} == {"2 restitutions, 2 records, 2 storeys"}
    assert "record" not in pooled[0]
    with open_cube(cube_file) as cube:
        ratio = COMPARISONS["laws"].make(cube.sel(gap=[0.01], scale=[2.0])).impact_force_max_ratio
        expected = ratio.sel(law="linear", pair="a-b", basis="nominal").median()
    (mine,) = [
        row
        for row in pooled
        if (row["variable"], row["law"], row["pair"], row["basis"])
        == ("impact_force_max_ratio", "linear", "a-b", "nominal")
    ]
    assert mine["median"] == pytest.approx(float(expected))


def test_quantiles_of_a_table(cube_file):
    (row,) = rows_of(
        cube_file, "--what", "amplification", "--at", "law=linear", "--at", "law=none", "--at", "building=b", "--over",
        "record", "--over", "scale", "--quantile", "0.25", "--quantile", "0.9",
    )[:1]  # fmt: skip
    with open_cube(cube_file) as cube:
        found = COMPARISONS["amplification"].make(cube.sel(law=["none", "linear"]))
        values = found.displacement_max_ratio.where(found.touches == 1.0).sel(building="b").values
    low, high = np.nanquantile(values, [0.25, 0.9])
    assert (row["0.25 fractile"], row["0.9 fractile"]) == (pytest.approx(low), pytest.approx(high))
    assert "median" not in row
    fits = rows_of(cube_file, "--what", "fragility", "--event", "force", "--level", "1", "--quantile", "0.1")
    fitted = [row for row in fits if row["fit"] == "fitted"]
    for row in fitted:
        assert row["at 0.1"] == pytest.approx(row["median"] * np.exp(-1.2815515655 * row["dispersion"]))
    assert all(row["over"] == "2 records, 4 scales" for row in fits)


def test_tables_of_records_and_scales_tell_the_intensity(cube_file):
    """Of the motion of each row; where motions are taken together there is none."""
    rows = rows_of(cube_file, "--what", "impacts", "--intensity", "pga")
    with open_cube(cube_file) as cube:
        strength = intensity_of(cube, "pga")
        for row in rows:
            own = strength.sel(record=row["record"], scale=row["scale"])
            assert row["pga m s-2"] == pytest.approx(float(own))
    whole = rows_of(cube_file, "--what", "amplification", "--intensity", "pga", "--over", "record")
    assert {row["pga m s-2"] for row in whole} == {None}


def test_the_question_of_a_gap_for_one_percent(tmp_path):
    """From runs without pounding alone; parts of the row are taken of what the whole row gives."""
    axes = {"law": ["none"], "record": ["one", "two", "three"]}
    records = [Record(name, 0.01, np.sin(12.0 * np.arange(50) * 0.01)) for name in axes["record"]]
    about = sweep_attribute(low_and_high(), records, laws="none")
    cube = hand_cube(axes, random_fill(2, "displacement_max", "displacement_min", "closing_max"), attributes=about)
    path = write_cube(cube, tmp_path / "still.nc")
    asked = ("--what", "gap-for-probability", "--probability", "0.01", "--intensity", "pga", "--given", "2")
    rows = rows_of(path, *asked, "--hazard", "k0=1e-3,kappa=2", "--years", "10", "--at", "pair=a-b")
    assert [row["given"] for row in rows] == ["intensity 2", "in 10 years", "the row's gap"]
    per_pga = cube.closing_max.isel(law=0).sel(pair="a-b").max("storey") / cube.record_pga * 2.0
    logs = np.log(per_pga.values)
    assert rows[0]["gap"] == pytest.approx(np.exp(logs.mean() + 2.3263478740 * logs.std(ddof=1)))
    assert rows[1]["rate"] == pytest.approx(-np.log(0.99) / 10)
    text = run(path, *asked, "--at", "pair=a-b").stdout
    assert "intensity: peak ground acceleration (m s-2)" in text
    refused = run(path, *asked, "--at", "building=a")
    assert refused.exit_code == 2
    assert (
        "'gap-for-probability' does not tell one building from another, only pair; leave building out" in refused.stderr
    )
    (tmp_path / "site.csv").write_text("1,1e-3\n2,2e-3\n")
    refused = run(path, *asked, "--hazard", tmp_path / "site.csv")
    assert refused.exit_code == 2
    assert "site.csv:2: rate 0.002 follows 0.001: a stronger motion must be rarer" in refused.stderr
