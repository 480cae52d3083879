"""Cubes in other formats: every number where a slow loop over scenarios and places puts it."""

from __future__ import annotations

import csv
import itertools
import json
import math
import os
import resource
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from analysis_cubes import hand_cube, random_fill
from typer.testing import CliRunner

from pounding_sweep.base.errors import InputError, OutputError, WriteError
from pounding_sweep.base.files import is_temporary
from pounding_sweep.cli.app import app
from pounding_sweep.output import export as exporting
from pounding_sweep.output import tidy
from pounding_sweep.output.export import export_cube
from pounding_sweep.output.netcdf import open_cube, write_cube
from pounding_sweep.output.select import select
from pounding_sweep.output.tidy import TidyTable

AXES = {"law": ["none", "linear", "hertz_damped"], "gap": [0.01, 0.1, 1 / 3], "record": ["one", "two"]}
NAMES = ("drift_max", "impact_force_max", "impact_count", "energy_input")


@pytest.fixture
def cube(tmp_path):
    """A cube in a file, one of whose scenarios diverged."""
    status = np.zeros((3, 3, 2))
    status[1, 2, 0] = 1
    made = hand_cube(AXES, random_fill(5, *NAMES), status=status, attributes={"title": "a, b", "rates": [1.0, 2.0]})
    with open_cube(write_cube(made, tmp_path / "cube.nc")) as found:
        yield found


def rows_of(cube, kinds):
    """Yield place and values of each row, by loops: every scenario's floors and contacts that exist."""
    outer = [dim for dim in cube.dims if dim in AXES]
    for scenario in itertools.product(*(cube[dim].values.tolist() for dim in outer)):
        here = cube.sel(dict(zip(outer, scenario, strict=True)))
        for kind in kinds:
            place = "floor_elevation" if kind == "building" else "contact_elevation"
            for item in here[kind].values.tolist():
                for storey in here.storey.values.tolist():
                    there = here.sel({kind: item, "storey": storey})
                    if math.isnan(there[place]):
                        continue
                    own = {kind, "storey"}
                    yield {
                        **dict(zip(outer, scenario, strict=True)),
                        kind: item,
                        "storey": storey,
                        **{
                            name: there[name].item()
                            for name in cube.data_vars
                            if set(cube[name].dims) - set(outer) <= own
                        },
                    }


def check(found, expected):
    """Compare rows of text with values; empty where there is none."""
    for row, values in itertools.zip_longest(found, expected):
        for name, text in row.items():
            if text in ("", None):
                assert name not in values or math.isnan(values[name]), name
            elif name in values:
                value = values[name]
                assert (text == value) if isinstance(value, str) else (float(text) == value), name


def read(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("at_a_time", [7, *(pytest.param(rows, marks=pytest.mark.slow) for rows in (1, 40, 10**6))])
def test_csv_is_what_loops_over_the_cube_give(cube, tmp_path, monkeypatch, at_a_time):
    monkeypatch.setattr(tidy, "ROWS_AT_A_TIME", at_a_time)
    found = read(export_cube(cube, tmp_path / "all.csv"))
    expected = list(rows_of(cube, ["building", "pair"]))
    assert len(found) == len(expected) == 18 * (3 + 2) == TidyTable(cube).n_rows
    check(found, expected)
    assert list(found[0])[:3] == ["law", "gap", "record"]
    assert {"record_pga", "building", "pair", "storey", "status", *NAMES} <= set(found[0])
    assert not {"law_title", "law_formula", "audit"} & set(found[0])
    assert {row["impact_count"] for row in found} <= {"", "0", "1", "2", "3"}  # whole numbers stay whole
    assert {row["drift_max"] == "" for row in found if row["pair"]} == {True}
    assert sum(row["status"] == "1" for row in found) == 5


def test_one_kind_of_variables_leaves_no_cell_empty(cube, tmp_path):
    path = export_cube(cube.isel(law=0), tmp_path / "force.csv", ["impact_force_max", "status"])
    found = read(path)
    check(found, rows_of(cube.isel(law=0)[["impact_force_max", "status"]], ["pair"]))
    assert len(found) == 6 * 2
    assert all(text for row in found for name, text in row.items() if name != "right_storey")  # a wall has none
    assert "building" not in found[0]
    assert {row["law"] for row in found} == {"none"}


def test_one_variable_needs_no_list(cube, tmp_path):
    one, listed = (
        export_cube(cube, tmp_path / name, given) for name, given in (("a.csv", "drift_max"), ("b.csv", ["drift_max"]))
    )
    assert one.read_text() == listed.read_text()


def test_values_of_scenarios_have_a_row_each(cube, tmp_path):
    found = read(export_cube(cube, tmp_path / "status.csv", ["status"]))
    assert [int(row["status"]) for row in found] == cube.status.values.ravel().tolist()
    assert set(found[0]) == {"law", "gap", "record", "record_pga", "status"}


def test_a_part_of_a_cube(cube, tmp_path):
    part = select(cube, {"gap": 0.1, "record": "two", "law": "linear"}).sel(pair="a-b")
    found = read(export_cube(part, tmp_path / "part.csv", ["impact_force_max", "drift_max"]))
    force = [row for row in found if row["pair"]]
    floors = [row for row in found if row["building"]]
    assert [float(row["impact_force_max"]) for row in force] == [part.impact_force_max.values[0]]
    expected = part.drift_max.values.ravel()
    assert [float(row["drift_max"]) for row in floors] == expected[~np.isnan(expected)].tolist()
    assert len(found) == 4
    assert {row["gap"] for row in found} == {"0.1"}


def test_units_stand_beside_the_table(cube, tmp_path):
    export_cube(cube, tmp_path / "all.csv")
    about = json.loads((tmp_path / "all.csv.json").read_text(encoding="utf-8"))
    assert about["rows"] == 90
    assert list(about["columns"]) == list(read(tmp_path / "all.csv")[0])
    assert about["columns"]["gap"]["units"] == "m"
    assert about["columns"]["impact_force_max"]["units"] == "kN"
    assert about["columns"]["status"]["flag_meanings"].split()[1] == "diverged"
    assert about["cube"]["title"] == "a, b"
    assert about["cube"]["rates"] == [1.0, 2.0]


def test_listed_cases_say_what_they_are(tmp_path):
    coords = {"law": (("case",), ["linear", "hertz"], {}), "scale": (("case",), [1.0, 2.5], {"units": "1"})}
    cases = hand_cube({"case": [1, 2]}, random_fill(2, "drift_max"), coords=coords)
    found = read(export_cube(cases, tmp_path / "cases.csv"))
    assert [(row["case"], row["law"], row["scale"]) for row in found[::3]] == [
        ("1", "linear", "1.0"),
        ("2", "hertz", "2.5"),
    ]


def test_parquet(cube, tmp_path, monkeypatch):
    pq = pytest.importorskip("pyarrow.parquet")
    monkeypatch.setattr(tidy, "ROWS_AT_A_TIME", 11)
    file = pq.ParquetFile(export_cube(cube, tmp_path / "all.parquet"))
    assert file.num_row_groups > 1
    found = file.read()
    check(found.to_pylist(), rows_of(cube, ["building", "pair"]))
    assert found.schema.field("impact_force_max").metadata[b"units"] == b"kN"
    assert str(found.schema.field("impact_count").type) == "int32"
    assert json.loads(found.schema.metadata[b"title"]) == "a, b"


@pytest.mark.parametrize("names", [(), pytest.param(("impact_count", "status"), marks=pytest.mark.slow)])
def test_zarr(cube, tmp_path, monkeypatch, names):
    pytest.importorskip("zarr")
    monkeypatch.setattr(exporting, "BLOCK_BYTES", 100)
    path = export_cube(cube, tmp_path / "cube.zarr", names)
    with xr.open_zarr(path) as found:
        xr.testing.assert_identical(found.load(), (cube[list(names)] if names else cube).load())
        assert len(found.status.encoding["chunks"]) == 3
        assert max(found.status.encoding["chunks"]) < 18
    with pytest.raises(OutputError, match="folders are not replaced"):
        export_cube(cube, path, overwrite=True)


def test_a_failed_zarr_leaves_nothing(cube, tmp_path, monkeypatch):
    pytest.importorskip("zarr")

    def full(self, path, **_):
        path.mkdir()
        (path / "half").write_text("")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(xr.Dataset, "to_zarr", full)
    with pytest.raises(WriteError, match=r"No space left on device\); free some space.*Nothing was replaced"):
        export_cube(cube, tmp_path / "cube.zarr")
    assert [path.name for path in tmp_path.iterdir()] == ["cube.nc"]


def test_a_zarr_that_gets_no_name_leaves_nothing(cube, tmp_path, monkeypatch):
    pytest.importorskip("zarr")

    def refused(self, target):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("pathlib.Path.replace", refused)
    with pytest.raises(WriteError, match="Input/output error"):
        export_cube(cube, tmp_path / "cube.zarr")
    assert [path.name for path in tmp_path.iterdir()] == ["cube.nc"]


NEEDS = {".csv": "csv", ".parquet": "pyarrow", ".zarr": "zarr"}


@pytest.mark.parametrize("ending", NEEDS)
def test_all_is_on_disk_before_it_has_its_name(cube, tmp_path, monkeypatch, ending):
    pytest.importorskip(NEEDS[ending])
    synced, named = set(), []
    fsync, replace = os.fsync, Path.replace

    def noted(handle):
        fsync(handle)
        synced.add(os.fstat(handle).st_ino)

    def checked(self, target):
        if is_temporary(self.name):  # zarr renames files too
            below = [self, *self.rglob("*")] if self.is_dir() else [self]
            assert {path.stat().st_ino for path in below} <= synced
            named.append((Path(target).name, len(below)))
        return replace(self, target)

    monkeypatch.setattr(os, "fsync", noted)
    monkeypatch.setattr("pathlib.Path.replace", checked)
    path = export_cube(cube, tmp_path / f"all{ending}")
    assert named[0][0] == path.name
    assert named[0][1] > (20 if ending == ".zarr" else 0)


@pytest.mark.parametrize("ending", [".csv", pytest.param(".parquet", marks=pytest.mark.slow)])
def test_a_full_disk_ends_with_a_remedy_and_replaces_nothing(cube, tmp_path, monkeypatch, ending):
    pytest.importorskip(NEEDS[ending])
    path = export_cube(cube, tmp_path / f"all{ending}", ["status"])
    source = write_cube(cube.load(), tmp_path / "source.nc")  # in no other hands
    before = {each.name: each.read_bytes() for each in tmp_path.iterdir()}

    def no_room(handle):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", no_room)
    with pytest.raises(WriteError, match=r"No space left on device\); free some space.*Nothing was replaced"):
        export_cube(cube, path, overwrite=True)
    done = CliRunner().invoke(app, ["export", str(source), "-o", str(path), "--overwrite"])
    assert (done.exit_code, "Nothing was replaced" in done.stderr) == (1, True)
    assert {each.name: each.read_bytes() for each in tmp_path.iterdir()} == before


def test_a_description_that_gets_no_name_is_told(cube, tmp_path, monkeypatch):
    path = export_cube(cube, tmp_path / "all.csv", ["status"])
    before = (tmp_path / "all.csv.json").read_bytes()
    replace = Path.replace

    def refused(self, target):
        if Path(target).suffix == ".json":
            raise OSError(5, "Input/output error")
        return replace(self, target)

    monkeypatch.setattr("pathlib.Path.replace", refused)
    with pytest.raises(WriteError, match=r"all\.csv' is complete, but writing .*all\.csv\.json' failed") as caught:
        export_cube(cube, path, overwrite=True)
    assert "Nothing was replaced" not in str(caught.value)
    assert len(read(path)) == 90
    assert (tmp_path / "all.csv.json").read_bytes() == before
    assert {each.name for each in tmp_path.iterdir()} == {"cube.nc", "all.csv", "all.csv.json"}


@pytest.mark.parametrize("ending", NEEDS)
def test_a_damaged_cube_is_no_full_disk(cube, tmp_path, ending):
    pytest.importorskip(NEEDS[ending])
    source = write_cube(cube.load(), tmp_path / "source.nc")
    with h5py.File(source) as file:
        info = file["impact_force_max"].id.get_chunk_info(0)
    with source.open("r+b") as file:
        file.seek(info.byte_offset + info.size // 2)
        file.write(b"damaged")
    with open_cube(source) as damaged:
        part = damaged.isel(gap=slice(0, 2))
        with pytest.raises(
            OutputError, match=r"values of cube '.*source\.nc' can't be read .* it is damaged"
        ) as caught:
            export_cube(part, tmp_path / f"all{ending}")
    assert not isinstance(caught.value, WriteError)
    assert {each.name for each in tmp_path.iterdir()} == {"cube.nc", "source.nc"}


@pytest.mark.parametrize("ending", [".parquet", ".zarr"])
def test_what_is_not_installed_is_named_with_the_remedy(cube, tmp_path, monkeypatch, ending):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(exporting, "import_module", missing)
    with pytest.raises(InputError, match=r"not installed; install it with: pip install 'pounding-sweep\[export\]'"):
        export_cube(cube, tmp_path / f"all{ending}")


def test_faults_are_named(cube, tmp_path):
    with pytest.raises(InputError, match=r"unknown format '.xls'; valid: .csv, .parquet, .zarr"):
        export_cube(cube, tmp_path / "all.xls")
    with pytest.raises(InputError, match=r"unknown variable 'drift'; did you mean 'drift_max'"):
        export_cube(cube, tmp_path / "all.csv", ["drift"])
    assert not (tmp_path / "all.csv").exists()
    path = export_cube(cube, tmp_path / "all.csv")
    with pytest.raises(OutputError, match="exists; give another path"):
        export_cube(cube, path)
    export_cube(cube, path, ["status"], overwrite=True)
    assert len(read(path)) == 18
    path.unlink()
    beside = path.with_name("all.csv.json")
    before = beside.read_bytes()
    with pytest.raises(OutputError, match=r"all\.csv\.json' exists; give another path"):
        export_cube(cube, path)
    assert beside.read_bytes() == before
    assert not path.exists()


def test_command(cube, tmp_path):
    run = CliRunner().invoke
    source = str(write_cube(cube.load(), tmp_path / "source.nc"))  # in no other hands
    out = tmp_path / "t.csv"
    made = run(app, ["export", source, "-o", str(out), "--at", "gap=0.1", "--var", "drift_max"])
    assert made.exit_code == 0, made.output
    assert made.stdout.strip() == str(out)
    assert len(read(out)) == 6 * 3
    again = run(app, ["export", source, "-o", str(out)])
    assert again.exit_code == 2
    assert "--overwrite" in again.stderr
    assert run(app, ["export", source, "-o", str(out), "--overwrite"]).exit_code == 0
    assert len(read(out)) == 90


def _small_files():
    resource.setrlimit(resource.RLIMIT_FSIZE, (1024, 1024))


@pytest.mark.slow  # by day the command is given a disk of no room in this process, see above
@pytest.mark.parametrize("ending", NEEDS)
def test_command_on_a_disk_that_takes_no_more(cube, tmp_path, ending):
    pytest.importorskip(NEEDS[ending])
    source = write_cube(cube.load(), tmp_path / "source.nc")
    out = tmp_path / f"all{ending}"
    # no bytecode (-B): Python would take a part of it for the whole afterwards
    command = [sys.executable, "-B", "-m", "pounding_sweep", "export", str(source), "-o", str(out)]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=300, preexec_fn=_small_files)
    assert done.returncode == 1, done.stderr
    assert "File too large" in done.stderr
    assert "see to the disk, or give a path on another one, and run again. Nothing was replaced" in done.stderr
    assert {each.name for each in tmp_path.iterdir()} == {"cube.nc", "source.nc"}


DIES = """
import os
import pathlib

from pounding_sweep import cli

pathlib.Path.replace = lambda *_: os.kill(os.getpid(), 9)
cli.main()
"""


@pytest.mark.slow
def test_what_a_killed_command_leaves_is_removed_by_the_next(cube, tmp_path):
    pytest.importorskip("zarr")
    folder = tmp_path / "out"
    folder.mkdir()
    source = write_cube(cube.load(), tmp_path / "source.nc")
    command = ["export", str(source), "-o", str(folder / "all.zarr")]
    assert subprocess.run([sys.executable, "-c", DIES, *command], check=False, timeout=300).returncode == -9
    (left,) = folder.iterdir()
    assert is_temporary(left.name)
    assert sum(path.stat().st_size for path in left.rglob("*")) > 1000
    again = [sys.executable, "-m", "pounding_sweep", *command]
    assert subprocess.run(again, check=False, timeout=300, capture_output=True).returncode == 0
    assert [path.name for path in folder.iterdir()] == ["all.zarr"]
