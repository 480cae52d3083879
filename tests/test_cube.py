"""The registry of outputs, cubes from arrays to files and text, and what labels tell."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import re
from concurrent.futures import ThreadPoolExecutor
from unittest.mock import Mock

import netCDF4
import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scenes import CubeAxis, assemble, pair

from pounding_sweep import Sweep
from pounding_sweep.analysis.rebuild import stored_sweep
from pounding_sweep.base import files
from pounding_sweep.base.errors import InputError, OutputError
from pounding_sweep.model.building import Building
from pounding_sweep.model.scene import Scene, Wall
from pounding_sweep.output import netcdf as writing
from pounding_sweep.output.dataset import VERSION_ATTRIBUTE
from pounding_sweep.output.describe import about, describe
from pounding_sweep.output.netcdf import check_output, open_cube, write_cube
from pounding_sweep.output.select import select
from pounding_sweep.request.spec import scene_of
from pounding_sweep.resume import MANIFEST, parts_folder
from pounding_sweep.variables.registry import (
    DEFAULT_OUTPUTS,
    INNER_DIMS,
    INTEGER_FILL,
    REDUCERS,
    STATUS,
    VARIABLES,
    Status,
    check_outputs,
    inner_shape,
    scatter_contact,
    scatter_dof,
)

pytestmark = pytest.mark.usefixtures("stub_module")


def building(name, n, height=3.0):
    return Building(name, [100.0] * n, [1e5] * n, storey_heights=[height] * n)


SCENE = Scene([building("left", 3), building("right", 2)], gaps=[0.01])
AXES = [
    CubeAxis("law", ["none", "kelvin_voigt"], "", "contact law"),
    CubeAxis("gap", [0.01, 0.02, 0.05], "m", "gap"),
    CubeAxis("record", ["el_centro", "Düzce"], "", "ground motion"),
]


def results(scene, axes, names=tuple(VARIABLES), seed=1):
    """Arrays as a sweep hands them over, every scenario ok."""
    rng = np.random.default_rng(seed)
    lengths = tuple(axis.size for axis in axes)
    arrays = {}
    for name in names:
        variable = VARIABLES[name]
        if name == "status":
            arrays[name] = np.zeros(lengths, dtype=np.int8)
        elif "storey" in variable.dims:
            scatter, n = (
                (scatter_contact, len(scene.contacts)) if "pair" in variable.dims else (scatter_dof, scene.n_dof)
            )
            flat = rng.normal(size=(*lengths, n))
            arrays[name] = scatter((np.abs(flat) * 9).astype("i4") if variable.dtype == "i4" else flat, scene)
        else:
            arrays[name] = rng.normal(size=lengths + inner_shape(name, scene))
    return arrays


@pytest.fixture
def cube():
    arrays = results(SCENE, AXES)
    arrays["status"][0, 0, 0] = Status.DIVERGED
    arrays["status"][1, 2, 1] = Status.UNDER_RESOLVED_CONTACT
    return assemble(
        SCENE,
        AXES,
        arrays,
        {"sweep": {"gaps": [0.01, 0.02, 0.05]}, "scenarios_asked": 12, "scenarios_run": 7, "numba_version": "0.68"},
        {"record_pga": (("record",), [3.1, 5.0], {"units": "m s-2", "long_name": "peak ground acceleration"})},
    )


class TestRegistry:
    @pytest.mark.parametrize("variable", VARIABLES.values(), ids=lambda v: v.name)
    def test_entry_is_complete(self, variable):
        assert re.fullmatch(r"[a-z][a-z_]*", variable.name)
        assert VARIABLES[variable.name] is variable
        # Names with whole-number powers, products by blanks: the part of UDUNITS that is used.
        assert re.fullmatch(r"1|rad|(kN|m|s)(-\d)?( (kN|m|s)(-\d)?)*", variable.units)
        assert variable.long_name
        assert variable.long_name[0].islower()
        assert variable.definition.endswith(".")
        assert set(variable.dims) <= set(INNER_DIMS)
        assert list(variable.dims) == sorted(variable.dims, key=INNER_DIMS.index)
        assert variable.needs <= set(REDUCERS)
        assert variable.dtype in {"f8", "i4", "i1"}
        assert bool(variable.flag_values) == bool(variable.flag_meanings)

    def test_status(self):
        assert VARIABLES["status"].flag_values == (0, 1, 2, 3, 4, 5, 6, 7, 8)
        assert VARIABLES["status"].flag_meanings.split() == [s.label for s in STATUS]
        assert VARIABLES["status"].fill is None
        assert all(s.meaning for s in STATUS)
        assert all(s.remedy for s in STATUS if s is not Status.OK)
        assert {s for s in STATUS if not s.has_values} == {
            Status.DIVERGED,
            Status.BEYOND_STABILITY_LIMIT,
            Status.NOT_RUN,
        }
        assert Status(2) is Status.UNDER_RESOLVED_CONTACT

    def test_outputs_are_checked(self):
        assert check_outputs(DEFAULT_OUTPUTS) == DEFAULT_OUTPUTS
        assert check_outputs(["impulse", "drift_max", "impulse"]) == ("drift_max", "impulse")
        assert check_outputs([]) == ()
        with pytest.raises(InputError, match=r"'impact_forces_max'; did you mean 'impact_force_max'\?"):
            check_outputs(["drift_max", "impact_forces_max"])
        with pytest.raises(InputError, match="list of names"):
            check_outputs("drift_max")
        with pytest.raises(InputError, match="unknown output"):
            check_outputs([["drift_max"]])
        with pytest.raises(InputError, match="list of names"):
            check_outputs(None)


class TestScatter:
    @given(
        heights=st.lists(st.tuples(st.integers(1, 5), st.sampled_from([2.5, 3.0, 5.0])), min_size=1, max_size=4),
        walls=st.tuples(st.booleans(), st.booleans()),
        data=st.data(),
    )
    def test_every_value_is_found_where_its_label_says(self, heights, walls, data):
        row = [building(f"b{i}", n, h) for i, (n, h) in enumerate(heights)]
        row = [Wall("west")] * walls[0] + row + [Wall("east")] * walls[1]
        scene = Scene(row, gaps=[0.01] * (len(row) - 1), allow_unmet=True)
        lead = data.draw(st.lists(st.integers(0, 3), max_size=2).map(tuple))
        floors = np.arange(np.prod(lead, dtype=int) * scene.n_dof, dtype=float).reshape(*lead, scene.n_dof)
        got = scatter_dof(floors, scene)
        kept = [(b, s) for b, item in enumerate(scene.buildings) for s in range(item.n_storeys)]
        for dof, (b, s) in enumerate(kept):
            np.testing.assert_array_equal(got[..., b, s], floors[..., dof])
        assert np.isfinite(got).sum() == floors.size
        counts = np.arange(np.prod(lead, dtype=int) * len(scene.contacts)).reshape(*lead, len(scene.contacts))
        got = scatter_contact(counts, scene)
        for i, contact in enumerate(scene.contacts):
            np.testing.assert_array_equal(got[..., contact.pair, contact.storey - 1], counts[..., i])
        assert (got != INTEGER_FILL).sum() == counts.size


class TestAssemble:
    def test_labels(self, cube):
        assert cube["impact_force_max"].dims == ("law", "gap", "record", "pair", "storey")
        there = (name for name, each in VARIABLES.items() if each.exists_in(SCENE))
        assert list(cube.data_vars) == list(there)
        assert cube["building"].values.tolist() == ["left", "right"]
        assert cube["pair"].values.tolist() == ["left-right"]
        assert cube["storey"].values.tolist() == [1, 2, 3]
        assert cube["law_model"].values.tolist() == ["VII", "II"]
        assert cube["floor_elevation"].sel(building="left").values.tolist() == [3.0, 6.0, 9.0]
        np.testing.assert_array_equal(cube["contact_elevation"].sel(pair="left-right"), [3.0, 6.0, np.nan])
        assert cube.attrs["Conventions"] == "CF-1.11"
        assert json.loads(cube.attrs["sweep"]) == {"gaps": [0.01, 0.02, 0.05]}

    def test_listed_cases(self, tmp_path):
        axes = [CubeAxis("case", np.arange(3), "1", "listed case")]
        extra = {
            "law": (("case",), ["hertz", "none", "hertz"], {"long_name": "contact law"}),
            "stiffness": (("case",), [1e6, None, 2e6], {"units": "kN m-1.5", "long_name": "contact stiffness"}),
            "restitution": (("case",), [None, None, None], {"units": "1", "long_name": "restitution"}),
        }
        cube = assemble(SCENE, axes, results(SCENE, axes), None, extra)
        assert cube["law_model"].values.tolist() == ["IV", "VII", "IV"]
        np.testing.assert_array_equal(cube["stiffness"], [1e6, np.nan, 2e6])
        assert cube["restitution"].isnull().all()
        assert cube["drift_max"].dims == ("case", "building", "storey")
        # UDUNITS would read "kN m-1.5" as 0.5 kN/m.
        assert "units" not in cube["stiffness"].attrs
        assert cube["stiffness"].attrs["unit_text"] == "kN m-1.5"
        write_cube(cube, tmp_path / "cases.nc")
        with open_cube(tmp_path / "cases.nc") as again:
            xr.testing.assert_identical(again.load(), cube)


class TestFile:
    def test_round_trip_through_xarray(self, cube, tmp_path):
        path = write_cube(cube, tmp_path / "cube.nc")
        with open_cube(path) as again:
            assert not again["drift_max"].variable._in_memory
            xr.testing.assert_identical(again.load(), cube)
            for name in cube.variables:
                assert again[name].dtype.kind == cube[name].dtype.kind
        with xr.open_dataset(path) as plain:
            beside = {
                name: plain[name].load().str.decode("utf-8") for name in ("law_title", "law_model", "law_formula")
            }
            assert all(plain[name].dtype.kind == "S" for name in beside)
            xr.testing.assert_identical(plain.load().assign_coords(beside), cube)
            assert plain["first_impact_time"].dtype == np.float64

    def test_derived_numbers_are_integers_where_the_type_holds_them(self, cube, tmp_path):
        """Else they keep their own: such as the file type can't hold, or takes for missing."""
        for values in ([0.5, 2.0], [3.0, 2.0**31], [-1.0, 4.0], [np.inf, 1.0]):
            counts = xr.DataArray([*values, np.nan], dims="gap")
            path = write_cube(xr.Dataset({"impact_count": counts}), tmp_path / "derived.nc", overwrite=True)
            with xr.open_dataset(path) as again:
                assert again["impact_count"].encoding["dtype"] == np.float64
                np.testing.assert_array_equal(again["impact_count"], counts)
        largest = cube.max("gap", keep_attrs=True)[["impact_count", "status"]]
        with netCDF4.Dataset(write_cube(largest, tmp_path / "largest.nc")) as file:
            assert (file["impact_count"].dtype, file["status"].dtype) == (np.int32, np.int8)
        some = write_cube(cube[["status"]].where(cube["gap"] > cube["gap"][0]), tmp_path / "some.nc")
        with xr.open_dataset(some) as again:  # a status that is missing stays so
            assert (again["status"].isnull() == (again["gap"] == again["gap"][0])).all()

    def test_every_bit_is_kept(self, tmp_path):
        arrays = results(SCENE, AXES)
        arrays["drift_max"][0, 0, 0, 0, :3] = [5e-324, -0.0, np.nextafter(1.0, 2.0)]
        cube = assemble(SCENE, AXES, arrays)
        with open_cube(write_cube(cube, tmp_path / "cube.nc")) as again:
            for name in cube.data_vars:
                assert again[name].values.tobytes() == cube[name].values.tobytes()

    def test_texts_are_read_as_they_were_written(self, tmp_path):
        """Also such as are no labels, one alone, none at all, and those beyond ASCII."""
        texts = {"why": ("gap", ["", "Gebäude \u2116 5"]), "one": ((), "alone")}
        labels = {"gap": [1.0, 2.0], "law": ("law", ["linear", "hertz"]), "none": ("none", np.array([], "U1"))}
        dataset = xr.Dataset(texts, labels, {VERSION_ATTRIBUTE: "0.1.0"})
        with open_cube(write_cube(dataset, tmp_path / "cube.nc")) as again:
            assert again.identical(dataset)
            assert set(again.data_vars) == set(texts)
        with xr.open_dataset(tmp_path / "cube.nc") as plain:
            assert plain["why"].str.decode("utf-8").values.tolist() == texts["why"][1]
            assert plain["law"].values.tolist() == labels["law"][1]
            assert plain["one"].item() == "alone"

    def test_plain_netcdf4(self, cube, tmp_path):
        path = write_cube(cube, tmp_path / "cube.nc")
        with netCDF4.Dataset(path) as file:
            assert file.data_model == "NETCDF4"
            assert not {**file.groups, **file.cmptypes, **file.vltypes, **file.enumtypes}
            assert file.Conventions == "CF-1.11"
            assert {"title", "history", "source", VERSION_ATTRIBUTE} <= set(file.ncattrs())
            for name, variable in file.variables.items():
                attributes = set(variable.ncattrs())
                assert "long_name" in attributes, name
                assert variable.dtype is not str, name  # which not every reader knows
                if variable.dtype.kind != "S":
                    assert "units" in attributes, name
                assert variable.filters()["fletcher32"]
                if name in cube.coords:
                    assert "_FillValue" not in attributes, name
                else:
                    assert variable.dtype == VARIABLES[name].dtype, name
                    assert variable.units == VARIABLES[name].units
                    assert variable.comment == VARIABLES[name].definition
                assert "standard_name" not in attributes
            status = file["status"]
            assert status.dtype == np.int8
            assert status.flag_values.dtype == np.int8
            assert status.flag_values.tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 8]
            assert len(status.flag_meanings.split()) == 9
            assert "_FillValue" not in status.ncattrs()
            counts = file["impact_count"]
            assert counts._FillValue == INTEGER_FILL
            assert counts[1, 0, 0, 0, 2] is np.ma.masked
            assert np.isnan(file["drift_max"]._FillValue)
            assert set(file["impact_force_max"].coordinates.split()) >= {"contact_elevation", "law_model"}

    def test_other_datasets_are_written_too(self, tmp_path):
        other = xr.Dataset(
            {"touching": ("time", [True, False]), "u": ("time", [0.5, np.nan]), "n": ("time", [1, 2]), "one": 4.0},
            coords={"time": [0.0, 0.1]},
        )
        with xr.open_dataset(write_cube(other, tmp_path / "o.nc")) as again:
            assert again["touching"].dtype == np.int8
            assert again["touching"].values.tolist() == [1, 0]
            np.testing.assert_array_equal(again["u"], other["u"])
            assert again["n"].dtype.kind == "i"
            assert float(again["one"]) == 4.0

    def test_existing_file(self, cube, tmp_path):
        path = tmp_path / "cube.nc"
        path.write_text("precious")
        for attempt in (lambda: check_output(path), lambda: write_cube(cube, path)):
            with pytest.raises(OutputError, match=r"exists.*--overwrite"):
                attempt()
        assert path.read_text() == "precious"
        check_output(path, overwrite=True)
        assert path.read_text() == "precious"
        write_cube(cube, path, overwrite=True)
        open_cube(path).close()

    def test_unusable_paths(self, cube, tmp_path, monkeypatch):
        (tmp_path / "file").write_text("")
        os.mkfifo(tmp_path / "pipe")
        for path, reason in [
            (tmp_path, "is a folder; give the path of a file"),
            (tmp_path / "none" / "cube.nc", "not a folder; make it first"),
            (tmp_path / "file" / "cube.nc", "is not a folder"),
            (tmp_path / "pipe", "not a regular file"),
            (tmp_path / ("x" * 300), "not usable"),
            ("a\0b", "not usable"),
        ]:
            with pytest.raises(OutputError, match=reason):
                check_output(path, overwrite=True)
            with pytest.raises(OutputError, match=reason):
                write_cube(cube, path, overwrite=True)
        closed = Mock(side_effect=PermissionError(errno.EACCES, "Permission denied"))
        monkeypatch.setattr(writing.tempfile, "TemporaryFile", closed)
        with pytest.raises(OutputError, match=r"can't be written \(Permission denied\)"):
            check_output(tmp_path / "cube.nc")

    @pytest.mark.parametrize("name", ["out.csv", "out.Zarr", "study.toml"])
    def test_endings_of_other_files(self, cube, tmp_path, name):
        path = tmp_path / name
        path.write_text("precious")
        said = rf"{name}' won't do: netCDF is written here, such as '.*\.nc'; tables are made of a cube by .*export"
        for attempt in (lambda: check_output(path, True), lambda: write_cube(cube, path, True)):
            with pytest.raises(OutputError, match=said):
                attempt()
        assert path.read_text() == "precious"
        assert check_output(path, True, netcdf=False) == path
        for ending in ("nc4", "cdf", "h5", "v1.2"):
            check_output(tmp_path / f"out.{ending}")
        check_output(tmp_path / "out")

    def test_a_link_stays_a_link(self, cube, tmp_path):
        (tmp_path / "real").mkdir()
        link = tmp_path / "cube.nc"
        link.symlink_to(tmp_path / "real" / "data.nc")
        write_cube(cube, link)
        assert link.is_symlink()
        assert (tmp_path / "real" / "data.nc").is_file()

    @pytest.mark.parametrize("error", [KeyboardInterrupt, OSError(28, "No space left on device"), RuntimeError("HDF")])
    def test_interrupted_write_leaves_no_file(self, cube, tmp_path, monkeypatch, error):
        def broken(file, *_):
            file.createDimension("half", 1)
            raise error

        monkeypatch.setattr(writing, "_write", broken)
        with pytest.raises(KeyboardInterrupt if error is KeyboardInterrupt else OutputError):
            write_cube(cube, tmp_path / "cube.nc")
        assert list(tmp_path.iterdir()) == []
        (tmp_path / "old.nc").write_text("old")
        with pytest.raises(KeyboardInterrupt if error is KeyboardInterrupt else OutputError):
            write_cube(cube, tmp_path / "old.nc", overwrite=True)
        assert [p.read_text() for p in tmp_path.iterdir()] == ["old"]

    def test_opening_what_is_no_cube(self, cube, tmp_path):
        text = tmp_path / "text.nc"
        text.write_text("not netCDF")
        torn = tmp_path / "torn.nc"
        whole = write_cube(cube, tmp_path / "whole.nc").read_bytes()
        torn.write_bytes(whole[: len(whole) // 2])
        foreign = tmp_path / "foreign.nc"
        xr.Dataset({"t": ("x", [1.0])}).to_netcdf(foreign)
        for path, reason in [
            (tmp_path / "none.nc", "does not exist"),
            (tmp_path, "is not a file"),
            (text, "can't be read as netCDF"),
            (torn, "can't be read as netCDF"),
            (foreign, "not one of this package"),
        ]:
            with pytest.raises(OutputError, match=reason):
                open_cube(path)

    def test_a_cube_that_another_program_writes(self, cube, tmp_path):
        path = write_cube(cube, tmp_path / "cube.nc")
        with path.open("rb") as other:
            fcntl.flock(other, fcntl.LOCK_EX)
            with pytest.raises(OutputError, match="read: another program has it open for writing; wait") as caught:
                open_cube(path)
        assert "damaged" not in str(caught.value)
        open_cube(path).close()

    @pytest.mark.parametrize(
        ("number", "reason"),
        [
            (errno.ENOLCK, "its drive grants no locks: set HDF5_USE_FILE_LOCKING=FALSE or copy the cube"),
            (errno.EIO, "Input/output error; check the permissions of the file, and its drive"),
        ],
    )
    def test_a_drive_that_refuses(self, cube, tmp_path, monkeypatch, number, reason):
        """Neither opening nor reading values calls a sound file damaged, or has it made again."""
        path = write_cube(cube, tmp_path / "cube.nc")
        monkeypatch.setattr(fcntl, "flock", Mock(side_effect=OSError(number, os.strerror(number))))
        with pytest.raises(OutputError, match=reason) as values, writing.reading(str(path)):
            raise RuntimeError("NetCDF: HDF error")
        failing = Mock(side_effect=OSError(-101, "NetCDF: HDF error"))
        monkeypatch.setattr(xr.backends.NetCDF4DataStore, "open", failing)
        with pytest.raises(OutputError, match=reason) as opening:
            open_cube(path)
        assert not re.search("damaged|again", f"{values.value}{opening.value}")
        monkeypatch.setenv("HDF5_USE_FILE_LOCKING", "FALSE")
        with pytest.raises(OutputError, match=r"HDF error\): it is damaged"):
            open_cube(path)

    def test_opening_what_is_not_finished(self, cube, tmp_path):
        path, parts = tmp_path / "night.nc", tmp_path / "night.nc.parts"
        parts.mkdir()
        (parts / MANIFEST).write_text("{}")
        with pytest.raises(OutputError, match=r"night\.nc' is not finished: its chunks wait in '.*night\.nc\.parts'"):
            open_cube(path)
        with pytest.raises(OutputError, match=r"'run' command completes it, 'pounding-sweep info .*night\.nc' tells"):
            open_cube(path)
        assert parts == parts_folder(path)
        write_cube(cube, path)  # of an earlier run
        open_cube(path).close()


class TestDescribe:
    def test_cube(self, cube):
        about = {"name": "el_centro", "pga": 3.1, "points": 1560, "sha256": "0123456789abcdef" * 4}
        cube.attrs["records"] = json.dumps([{**about, "source": f"{'Imperial Valley 1940; ' * 5}end"}])
        text = describe(cube)
        lines = [" ".join(line.split()) for line in text.splitlines()]
        assert lines[0] == cube.attrs["title"]
        assert "12 scenarios asked, 7 run" in lines
        assert "law 2 none, kelvin_voigt (contact law)" in lines
        assert "gap 3 0.01, 0.02, 0.05 m (gap)" in lines
        assert f"10 ok {Status.OK.meaning}" in lines
        assert any(line.startswith("1 diverged") and Status.DIVERGED.remedy in line for line in lines)
        source = f"{'Imperial Valley 1940; ' * 5}end"
        assert f"el_centro PGA 3.1 m/s2 points 1560, sha256 0123456789ab, source {source}" in lines
        assert "numba 0.68" in lines
        for name in cube.data_vars:
            assert name in text
        ok = cube["drift_max"].where(cube["status"] == 0)
        low, high = float(ok.min()), float(ok.max())
        expected = f"drift_max m {low:.6g} to {high:.6g} largest interstorey drift, per building and storey"
        assert expected in lines

    @pytest.mark.parametrize(
        "given",
        [
            {},
            {"data_vars": {"a": ("x", ["p", "q"]), "b": ("x", [np.nan, np.nan])}},
            {"data_vars": {"a": ("x", np.zeros(0))}, "coords": {"x": np.zeros(0)}},
            {"data_vars": {"status": ("x", np.zeros(2, "i1")), "a": ("y", [1.0])}},
        ],
    )
    def test_any_dataset(self, given):
        dataset = xr.Dataset(**given, attrs={"sweep": '{"a": NaN}', "title": "3"})
        assert describe(dataset).startswith("3\n")
        json.dumps(about(dataset), allow_nan=False)


def test_files_written_side_by_side_take_nothing_from_one_another(tmp_path):
    """A folder that is just being made is no leftover of a killed process."""

    def write(writer):
        for i in range(10):
            with files.replacing(tmp_path / f"{writer}-{i}.txt") as path:
                path.write_text("whole", encoding="utf-8")

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(write, range(8)))
    assert len(list(tmp_path.iterdir())) == 8 * 10


def test_a_folder_without_its_lock_is_no_leftover_before_a_minute(tmp_path, monkeypatch):
    """Whoever looks for leftovers while one is made, before it is locked, leaves it alone."""
    (left := tmp_path / ".pounding_sweep-0.part").mkdir()
    (left / "half.nc").touch()
    os.utime(left, (0.0, 0.0))
    acquire = files.acquire_lock

    def acquire_late(folder, timeout=-1.0):
        if timeout:  # else it is that of a leftover
            files.remove_leftovers(tmp_path)
            assert folder.exists()
        return acquire(folder, timeout)

    monkeypatch.setattr(files, "acquire_lock", acquire_late)
    with files.replacing(tmp_path / "a.txt") as path:
        path.write_text("whole", encoding="utf-8")
    assert [file.name for file in tmp_path.iterdir()] == ["a.txt"]


NAMES = (
    *("floor_mass", "storey_stiffness", "fundamental_period", "second_period"),
    *("first_damping_ratio", "second_damping_ratio"),
)


def sweep(scene=None, **changes):
    settings = {"records": "el_centro", "laws": "linear", "outputs": ["drift_max"], "dt": 0.01, "audit": 0.0}
    return Sweep(scene or pair(), **{**settings, "force_unstable": True, **changes})


def check(cube, building, factors, ratio):
    """Compare what a cube says of a building with that building made by hand."""
    (period, mass) = factors
    masses, stiffnesses = np.array(building.masses) * mass, np.array(building.stiffnesses) * mass / period**2
    own = Building(building.name, masses, stiffnesses, building.damping_ratio if ratio is None else ratio)
    here = cube.sel(building=building.name)
    n = own.n_storeys
    assert here["floor_mass"].values[:n] == pytest.approx(masses)
    assert here["storey_stiffness"].values[:n] == pytest.approx(stiffnesses)
    periods = [*own.periods[:2], np.nan][:2]
    found = [float(here[name]) for name in ("fundamental_period", "second_period")]
    assert found == pytest.approx(periods, nan_ok=True)
    ratios = own.damping_ratio if isinstance(own.damping_ratio, tuple) else (own.damping_ratio,) * 2
    found = [float(here[name]) for name in ("first_damping_ratio", "second_damping_ratio")]
    assert found == pytest.approx([ratios[0], ratios[1] if n > 1 else np.nan], nan_ok=True)


def test_buildings_as_given():
    scene = Scene(
        [Building("low", [100.0], [1e4], 0.02), Building("high", [90.0, 80.0], [3e4, 2e4], (0.03, 0.07))], [1]
    )
    cube = sweep(scene, laws="none").run(workers=1)
    assert [cube[name].dims for name in NAMES] == [("building", "storey")] * 2 + [("building",)] * 4
    for building in scene.buildings:
        check(cube, building, (1.0, 1.0), None)
    assert np.isnan(cube["floor_mass"].sel(building="low", storey=2))


def test_buildings_along_their_axes():
    axes = {
        "period_factors": {"a": [0.8, 1.2]},
        "mass_factors": {"a": 2.0, "b": [1.0, 1.5]},
        "damping_ratios": [0.01, 0.1],
    }
    cube = sweep(**axes, gaps=[0.001, 0.5]).run(workers=1)
    assert cube["floor_mass"].dims == ("mass_factor_a", "mass_factor_b", "building", "storey")
    assert cube["fundamental_period"].dims == ("period_factor_a", "building")
    assert cube["first_damping_ratio"].dims == ("damping_ratio", "building")
    one = select(cube, {"period_factor_a": 1.2, "mass_factor_a": 2.0, "mass_factor_b": 1.5, "damping_ratio": 0.1})
    check(one, pair().buildings[0], (1.2, 2.0), 0.1)
    check(one, pair().buildings[1], (1.0, 1.5), 0.1)


def test_buildings_of_listed_cases(tmp_path):
    cases = [
        {"law": "none", "period_factors": {"b": 1.3}},
        {"law": "none", "mass_factors": {"a": 3.0}, "damping_ratio": 0.2},
    ]
    sweep(laws=None, cases=cases).run(tmp_path / "a.nc", workers=1).close()
    with open_cube(tmp_path / "a.nc") as cube:
        assert cube["floor_mass"].dims == ("case", "building", "storey")
        check(cube.sel(case=1), pair().buildings[1], (1.3, 1.0), None)
        check(cube.sel(case=2), pair().buildings[0], (1.0, 3.0), 0.2)
        assert scene_of(stored_sweep(cube)["scene"]) == pair()
        np.testing.assert_array_equal(cube["period_factor"], [[1.0, 1.3], [1.0, 1.0]])
        np.testing.assert_array_equal(cube["mass_factor"], [[1.0, 1.0], [3.0, 1.0]])
        np.testing.assert_array_equal(cube["damping_ratio"], [np.nan, 0.2])
    plain = sweep(laws=None, cases=[{"law": "none"}]).run(workers=1)
    assert plain["floor_mass"].dims == ("building", "storey")
    check(plain, pair().buildings[0], (1.0, 1.0), None)


def test_cubes_are_read_in_chunks(tmp_path):
    """By xarray too, which can't cut texts that it reads as objects: those beside the axes are read as bytes."""
    sweep(gaps=[0.0001, 0.0002], audit=1.0).run(tmp_path / "a.nc", workers=1).close()
    with open_cube(tmp_path / "a.nc") as cube, xr.open_dataset(tmp_path / "a.nc", chunks="auto") as plain:
        for chunked in (cube.chunk("auto"), plain):
            assert chunked["drift_max"].chunks == tuple((size,) for size in cube["drift_max"].shape)
            np.testing.assert_array_equal(chunked["drift_max"].compute(scheduler="synchronous"), cube["drift_max"])
        for name in ("law_title", "law_formula", "audit_law", "audit_record"):
            read = plain[name].compute(scheduler="synchronous")
            assert read.dtype.kind == "S"
            assert read.str.decode("utf-8").values.tolist() == cube[name].values.tolist()
        assert plain["building"].values.tolist() == ["a", "b"]


def test_storeys_that_meet():
    """A left building with floors at 2, 4 and 6 m, a right one at 4 and 8 m, and a wall."""
    left = Building("left", [10.0] * 3, [1e4] * 3, storey_heights=[2.0] * 3)
    right = Building("right", [10.0] * 2, [1e4] * 2, storey_heights=[4.0] * 2)
    cube = sweep(Scene([left, right, Wall()], [0.1, 0.1]), laws="none").run(workers=1)
    stored = {side: cube[f"{side}_storey"].sel(pair="left-right").values.tolist() for side in ("left", "right")}
    assert stored["left"] == pytest.approx([np.nan, 2.0, np.nan], nan_ok=True)
    assert stored["right"] == pytest.approx([np.nan, 1.0, np.nan], nan_ok=True)
    wall = cube.sel(pair="right-wall")
    assert wall["left_storey"].values.tolist() == pytest.approx([1.0, 2.0, np.nan], nan_ok=True)
    assert wall["right_storey"].isnull().all()
    assert (
        cube["contact_elevation"].notnull() == (cube["left_storey"].notnull() | cube["right_storey"].notnull())
    ).all()
