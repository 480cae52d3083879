"""Parts of cubes by value, and cubes in other formats: every number where a slow loop over scenarios puts it."""

from __future__ import annotations

import csv
import itertools
import json
import math
import os
from functools import lru_cache

import h5py
import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scenes import call, hand_cube, motions, pair, random_fill

from pounding_sweep import Sweep, simulate
from pounding_sweep.analysis.rebuild import with_intensities
from pounding_sweep.analysis.spectra import response_spectrum
from pounding_sweep.base.errors import InputError, OutputError, WriteError
from pounding_sweep.cli.app import axis_values
from pounding_sweep.output import export as exporting
from pounding_sweep.output import export as tables
from pounding_sweep.output.export import Table, export_cube
from pounding_sweep.output.netcdf import open_cube, write_cube
from pounding_sweep.output.select import NEAR, select
from pounding_sweep.records.record import record_measures
from pounding_sweep.request.spec import scene_of

pytestmark = pytest.mark.usefixtures("stub_module")

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
                if isinstance(text, str) and not isinstance(value, str) and name not in AXES:
                    value = float(f"{value:.7g}")
                assert text == value if isinstance(value, str) else float(text) == value, name


def read(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_csv_is_what_loops_over_the_cube_give(cube, tmp_path, monkeypatch):
    monkeypatch.setattr(exporting, "CELLS_AT_A_TIME", 7)
    found = read(export_cube(cube, tmp_path / "all.csv"))
    expected = list(rows_of(cube, ["building", "pair"]))
    assert len(found) == len(expected) == 18 * (3 + 2) == Table(cube, wide=False, constants=False).n_rows
    check(found, expected)
    assert list(found[0])[:3] == ["law", "gap", "record"]
    assert {"record_pga", "building", "pair", "storey", "status", *NAMES} <= set(found[0])
    assert not {"law_title", "law_formula", "audit"} & set(found[0])
    assert {row["impact_count"] for row in found} <= {"", "0", "1", "2", "3"}  # whole numbers stay whole
    assert {row["drift_max"] == "" for row in found if row["pair"]} == {True}
    assert sum(row["status"] == "1" for row in found) == 5


def test_texts_are_texts_however_a_cube_was_opened(cube, tmp_path):
    """xarray reads labels along listed cases as bytes; origins stand in words too."""
    labels = {"law": ("case", np.array(["linear", "none"])), "record": ("case", np.array(["ä", "b"]))}
    origin = ("case", np.array([0, 2], np.int8), {"flag_meanings": "run equal never_touches not_run"})
    data = {"status": ("case", np.zeros(2, np.int8)), "origin": origin, "run": ("case", np.array([1, 2], np.int32))}
    path = write_cube(xr.Dataset(data, {"case": [1, 2], **labels}), tmp_path / "cases.nc")
    with xr.open_dataset(path) as plain:
        assert plain.law.dtype.kind == "S"
        rows = read(export_cube(plain, tmp_path / "cases.csv"))
    columns = ("law", "record", "origin", "origin_name", "run")
    assert [[row[name] for name in columns] for row in rows] == [
        ["linear", "ä", "0", "run", "1"],
        ["none", "b", "2", "never_touches", "2"],
    ]


def test_one_kind_of_variables_leaves_no_cell_empty(cube, tmp_path):
    path = export_cube(cube.isel(law=0), tmp_path / "force.csv", ["impact_force_max", "status"])
    found = read(path)
    check(found, rows_of(cube.isel(law=0)[["impact_force_max", "status"]], ["pair"]))
    assert len(found) == 6 * 2
    assert all(text for row in found for name, text in row.items() if name != "right_storey")  # a wall has none
    assert "building" not in found[0]
    assert {row["law"] for row in found} == {"none"}


def test_a_part_of_a_cube(cube, tmp_path):
    part = select(cube, {"gap": 0.1, "record": "two", "law": "linear"}).sel(pair="a-b")
    found = read(export_cube(part, tmp_path / "part.csv", ["impact_force_max", "drift_max"]))
    force = [row for row in found if row["pair"]]
    floors = [row for row in found if row["building"]]
    assert [row["impact_force_max"] for row in force] == [f"{part.impact_force_max.values[0]:.7g}"]
    expected = part.drift_max.values.ravel()
    assert [row["drift_max"] for row in floors] == [f"{value:.7g}" for value in expected[~np.isnan(expected)]]
    assert len(found) == 4
    assert {row["gap"] for row in found} == {"0.1"}


@pytest.mark.parametrize("table", [False, True])
def test_units_stand_beside_the_table_or_in_it(cube, tmp_path, monkeypatch, table):
    """As do statuses in words; only scenarios of a status, and constants of the row, are written where asked for."""
    monkeypatch.setattr(exporting, "CELLS_AT_A_TIME", 7)
    path, places = tmp_path / "t.csv", 1 if table else 5
    export_cube(cube, path, table=table, units=True, status=["not-ok"])
    units, *rows = read(path)
    told = [(row["law"], row["gap"], row["record"], row["status_name"]) for row in rows]
    assert told == [("linear", str(1 / 3), "one", "diverged")] * places
    about = json.loads((tmp_path / "t.csv.json").read_text(encoding="utf-8"))
    assert about["rows"] == places
    assert [(key, column.get("units", "")) for key, column in about["columns"].items()] == [*units.items()]
    assert (units["gap"], next(text for name, text in units.items() if name.startswith("impact_force"))) == ("m", "kN")
    assert about["columns"]["status"]["flag_meanings"].split()[1] == "diverged"
    assert (about["cube"]["title"], about["cube"]["rates"]) == ("a, b", [1.0, 2.0])
    export_cube(cube, path, table=table, constants=True, status=["ok"], overwrite=True)
    found = read(path)
    assert len(found) == 17 * places
    added = {name.partition("_")[0] for name in found[0].keys() - units}
    assert added == {"floor", "contact", "fundamental", "first", "left", "right"}
    with pytest.raises(InputError, match="no scenario has the status 'not_run'; this cube has: ok, diverged"):
        export_cube(cube, path, status=["ok", "not_run"], overwrite=True)


def test_parquet(cube, tmp_path, monkeypatch):
    pq = pytest.importorskip("pyarrow.parquet")
    monkeypatch.setattr(exporting, "CELLS_AT_A_TIME", 11)
    file = pq.ParquetFile(export_cube(cube, tmp_path / "all.parquet"))
    assert file.num_row_groups > 1
    found = file.read()
    check(found.to_pylist(), rows_of(cube, ["building", "pair"]))
    assert found.schema.field("impact_force_max").metadata[b"units"] == b"kN"
    assert str(found.schema.field("impact_count").type) == "int32"
    assert json.loads(found.schema.metadata[b"title"]) == "a, b"


def test_zarr(cube, tmp_path, monkeypatch):
    pytest.importorskip("zarr")
    monkeypatch.setattr(exporting, "BLOCK_BYTES", 100)
    path = export_cube(cube, tmp_path / "cube.zarr")
    with xr.open_zarr(path) as found:
        xr.testing.assert_identical(found.load(), cube.load())
        assert len(found.status.encoding["chunks"]) == 3
        assert max(found.status.encoding["chunks"]) < 18
    with pytest.raises(OutputError, match="folders are not replaced"):
        export_cube(cube, path, overwrite=True)


NEEDS = {".csv": "csv", ".parquet": "pyarrow", ".zarr": "zarr"}


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
    assert "Nothing was replaced" in call("export", source, "-o", path, "--overwrite", code=1).stderr
    assert {each.name: each.read_bytes() for each in tmp_path.iterdir()} == before


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
    path = export_cube(cube, tmp_path / "all.csv")
    with pytest.raises(OutputError, match="exists; give another path"):
        export_cube(cube, path)
    export_cube(cube, path, ["status"], overwrite=True)
    assert len(read(path)) == 18
    path.unlink()
    with pytest.raises(OutputError, match=r"all\.csv\.json' exists; give another path"):
        export_cube(cube, path)
    assert not path.exists()


@pytest.fixture
def trade(tmp_path):
    """A file of several tables, as 'tradeoff' writes one."""
    data = {
        "error": (("scenario", "scheme"), np.arange(6.0).reshape(3, 2)),
        "sensitive": ("scenario", [0, 1, 0]),
        "count": (("scheme", "status"), np.arange(8.0).reshape(2, 4)),
    }
    labels = {"scheme": ["rk4", "exact"], "time_step": (("record", "step"), np.ones((5, 7)))}
    return write_cube(xr.Dataset(data, labels, {"pounding_sweep_version": "1"}), tmp_path / "trade.nc")


def test_variables_that_share_no_dimensions_make_several_tables(trade, tmp_path):
    said = r"\(scenario, scheme\): error, sensitive; \(scheme, status\): count; export each set apart"
    with open_cube(trade) as cube, pytest.raises(InputError, match=said):
        export_cube(cube, tmp_path / "all.csv")
    asked = ("export", trade, "-o", tmp_path / "all.csv")
    first, second = (tmp_path / f"all-{dims}.csv" for dims in ("scenario-scheme", "scheme-status"))
    assert call(*asked).stdout.split() == [str(first), str(second)]
    assert [(row["scheme"], row["error"]) for row in read(first)] == [
        (scheme, f"{value:g}") for value, scheme in zip(np.arange(6.0), ["rk4", "exact"] * 3, strict=True)
    ]
    assert [float(row["count"]) for row in read(second)] == [*range(8)]
    assert call(*asked, "--var", "sensitive").stdout.strip() == str(tmp_path / "all.csv")
    assert [row["sensitive"] for row in read(tmp_path / "all.csv")] == ["0", "1", "0"]


def test_the_size_of_a_large_table_is_said(cube, tmp_path, monkeypatch):
    monkeypatch.setattr(exporting, "MANY_ROWS", 89)
    with pytest.warns(RuntimeWarning, match=r"all.csv' will have 90 rows of \d+ columns, about .* kB as text; take"):
        export_cube(cube, tmp_path / "all.csv")


def test_command(cube, tmp_path):
    asked = ("export", write_cube(cube.load(), tmp_path / "source.nc"), "-o", tmp_path / "t.csv")  # in no other hands
    assert call(*asked, "--at", "gap=0.1", "--var", "drift_max").stdout.strip() == str(asked[-1])
    assert len(read(asked[-1])) == 6 * 3
    assert "--overwrite" in call(*asked, code=2).stderr


def line(axis, values):
    """A dataset whose x tells the place on its axis."""
    return xr.Dataset({"x": (axis, np.arange(len(values)))}, {axis: values})


@pytest.mark.parametrize("value", [1_400_000, "1400000", 1_400_000.0, "1.4e6", np.int64(1_400_000)])
def test_numbers_of_cases_are_exact(value):
    cases = line("case", np.arange(1, 1_500_001))
    assert int(select(cases, {"case": value}).x) == 1_399_999


@pytest.mark.parametrize("value", [0.5, 1_500_001, "9" * 5000, 10**400, "nan", "x"])
def test_what_is_no_case_is_refused_in_few_words(value):
    with pytest.raises(InputError, match=r"it has 1500000 values from 1 to 1500000|it has 1500000 values") as caught:
        select(line("case", np.arange(1, 1_500_001)), {"case": value})
    assert len(str(caught.value)) < 500


def test_neighbours_are_named():
    with pytest.raises(InputError, match=r"from 0\.0 to 0\.99; next to that: 0\.1 and 0\.11"):
        select(line("gap", np.arange(100) / 100), {"gap": "0.105"})
    with pytest.raises(InputError, match=r"next to that: 0\.99$"):
        select(line("gap", np.arange(100) / 100), {"gap": "2"})


def test_values_that_are_nearly_equal_are_told_apart():
    gaps = line("gap", [0.01, 0.01 * (1 + 3e-7), 0.02])
    for place, gap in enumerate(gaps.gap.values.tolist()):
        assert int(select(gaps, {"gap": repr(gap)}).x) == place
    with pytest.raises(InputError, match=r"'0\.0100000001' is within 1e-06 of 2 values .*0\.01, .*give all figures"):
        select(gaps, {"gap": "0.0100000001"})
    assert int(select(gaps, {"gap": "0.020000001"}).x) == 2


@given(
    st.lists(st.floats(1e-6, 1e3), min_size=1, max_size=30, unique=True),
    st.integers(0, 29),
    st.floats(-2 * NEAR, 2 * NEAR),
)
def test_the_right_value_or_none(values, place, off):
    place %= len(values)
    number = values[place] * (1 + off)
    near = [abs(value - number) <= NEAR * number for value in values]
    dataset = line("gap", values)
    if number in values:
        assert values[int(select(dataset, {"gap": number}).x)] == number
    elif sum(near) == 1:
        assert near[int(select(dataset, {"gap": number}).x)]
    else:
        with pytest.raises(InputError, match=r"not on the axis|give all figures"):
            select(dataset, {"gap": number})


def test_several_values_keep_the_axis():
    dataset = line("gap", [0.01, 0.02, 0.03]).expand_dims(law=["linear", "hertz"])
    part = select(dataset, axis_values(["gap=0.03", "law = hertz", "gap=0.01"]))
    assert part.gap.values.tolist() == [0.01, 0.03]
    assert part.x.values.tolist() == [0, 2]
    assert part.law.item() == "hertz"
    assert select(dataset, axis_values(["gap=0.03", "gap=0.030"])).x.dims == ("law",)
    assert select(dataset, {"law": ["hertz", "linear"]}).law.values.tolist() == ["linear", "hertz"]
    with pytest.raises(InputError, match="no value of gap is given"):
        select(dataset, {"gap": []})


def test_an_audit_has_no_scenarios_to_select():
    dataset = line("gap", [0.01, 0.02]).assign(audit_error=(("audit", "output"), np.zeros((2, 1))))
    dataset = dataset.assign_coords(output=["drift_max"], audit=[1, 2])
    with pytest.raises(InputError, match=r"unknown axis 'output'; valid: gap$"):
        select(dataset, {"output": "drift_max"})
    with pytest.raises(InputError, match=r"unknown axis 'gab'; did you mean 'gap'\? Valid: gap$"):
        select(dataset, {"gab": 1})
    assert select(line("output", ["drift_max", "impulse"]), {"output": "impulse"}).x == 1  # such as of a trade-off


def test_many_labels_are_listed_in_part():
    with pytest.raises(InputError, match=r"unknown record 'no'; valid: .*, and 9950 more$") as caught:
        select(line("record", [f"station-{n}" for n in range(10_000)]), {"record": "no"})
    assert len(str(caught.value)) < 2000


def test_cases_are_chosen_by_what_they_list():
    """All that have one of the values, as they stand; what is along other axes is none of that."""
    listed = {"law": ("case", ["none", "hertz", "none"]), "gap": ("case", [0.01, 0.02, 0.03]), "case": [1, 2, 5]}
    cases = xr.Dataset({"x": ("case", [0, 1, 2])}, {**listed, "height": ("storey", [3.0])})
    assert select(cases, {"law": "none"}).x.values.tolist() == [0, 2]
    assert select(cases, {"law": "none"})["case"].values.tolist() == [1, 5]
    assert select(cases, {"law": "none", "gap": 0.03}).x.values.tolist() == [2]
    assert select(cases, {"gap": ["0.02", 0.03 * (1.0 + 0.5 * NEAR)]}).x.values.tolist() == [1, 2]
    with pytest.raises(InputError, match="unknown law 'linear'; valid: hertz, none"):
        select(cases, {"law": "linear"})
    with pytest.raises(InputError, match="unknown axis 'height'; valid: case, gap, law, storey"):
        select(cases, {"height": 3.0})


OUTPUTS = ["displacement_max", "impact_force_max", "impact_count"]
DESIGN = {
    "kind": "halton",
    "samples": 4,
    "inputs": {
        "gap": {"distribution": "uniform", "low": 0.001, "high": 0.01},
        "damping_ratio": {"distribution": "uniform", "low": 0.02, "high": 0.08},
        "period_factors": {"b": {"distribution": "lognormal", "median": 1.0, "dispersion": 0.3}},
    },
}
SWEEPS = {
    "axes": {"gaps": [0.0002, 0.001], "restitutions": [0.4, 0.6], "scales": [1.0, -2.0]},
    "pgas": {"gaps": [0.001], "pgas": [2.0, 3.0]},
    "buildings": {"period_factors": {"b": [1.0, 1.3]}, "mass_factors": {"a": [0.7]}, "damping_ratios": [0.02, 0.05]},
    "cases": {"laws": None, "cases": [
        {"law": "linear", "record": "one"}, {"law": "stereomechanical", "record": "two", "scale": 2.0, "gap": 0.001},
        {"law": "kelvin_voigt", "record": "two", "gap": 0.0003, "damping_ratio": 0.02, "period_factors": {"b": 1.4}},
    ]},
    "design": {"design": DESIGN},
}  # fmt: skip


def made(name):
    settings = {"laws": ["none", "kelvin_voigt", "stereomechanical"], "records": motions(), "dt": 0.005}
    settings |= {"outputs": OUTPUTS, "audit": 1.0, "force_unstable": True}
    return Sweep(pair(0.0005), **{**settings, **SWEEPS[name]}).run(workers=1)


@pytest.fixture(
    scope="module", params=[pytest.param(name, marks=pytest.mark.slow) if name == "pgas" else name for name in SWEEPS]
)
def wide(stub_module, request):
    return made(request.param)


def same_cell(text, value):
    """A cell and its value, of which files have seven digits."""
    if isinstance(value, str):
        return text == value
    return (text == "" and math.isnan(value)) or (text != "" and float(text) == float(f"{value:.7g}"))


@lru_cache
def measured(record, scale):
    return record_measures(record.scaled(scale))


@lru_cache
def ordinate(record, scale, period):
    return float(response_spectrum(record.scaled(scale), [period], 0.05)["pseudo_acceleration"].squeeze())


@pytest.mark.slow
def test_one_row_for_each_scenario(wide, tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "CELLS_AT_A_TIME", 300)
    rows = read(export_cube(wide, tmp_path / "t.csv", table=True))
    status = wide["status"]
    dims, records = status.dims, {each.name: each for each in motions()}
    u, n = (
        wide["displacement_max"].sel(building="b", storey=[1, 2]),
        wide["impact_count"].sel(storey=[1, 2], pair="a-b"),
    )
    floors = [each.transpose(*dims, "storey").values for each in (u, n)]
    about = [wide[name].broadcast_like(status).transpose(*dims).values for name in (*dims, "record", "scale")]
    assert len(rows) == status.size
    for place, row in zip(np.ndindex(status.shape), rows, strict=True):
        *labels, record, scale = (each[place].item() for each in about)
        assert all(same_cell(row[dim], label) for dim, label in zip(dims, labels, strict=True))
        assert same_cell(row["status"], status.values[place].item())
        for i, storey in enumerate((1, 2)):
            assert same_cell(row[f"displacement_max_b_{storey}"], floors[0][place][i].item())
            assert same_cell(row[f"impact_count_a_b_{storey}"], floors[1][place][i].item())
        measures = measured(records[record], scale)
        for name in ("pga", "pgv", "arias_intensity", "significant_duration", "duration"):
            assert float(row[f"ground_{name}"]) == pytest.approx(getattr(measures, name), rel=1e-6)


def test_audited_errors_stand_with_their_scenarios(wide, tmp_path):
    """Each audited scenario is found by what the cube says of it, by a loop; no other row has an error."""
    rows = read(export_cube(wide, tmp_path / "t.csv", table=True))
    texts = {name: [row[f"audited_error_{name}"] for row in rows] for name in wide["output"].values.tolist()}
    held = set()
    assert wide.sizes["audit"] >= 1
    places = [
        wide[["status", "displacement_max", "impact_count"]].isel(dict(zip(wide["status"].dims, at, strict=True)))
        for at in np.ndindex(wide["status"].shape)
    ]
    for i in range(wide.sizes["audit"]):
        one = wide.isel(audit=i)
        law = str(one["audit_law"].item())
        alike = []
        for place, here in enumerate(places):
            ok = here["law"].item() == law and here["record"].item() == one["audit_record"].item()
            ok &= float(here["scale"]) == float(one["audit_scale"])
            ok &= float(here["pair_gap"].values[0]) == float(one["audit_gap"].values[0])
            ok &= law == "linear" or float(here["restitution"]) == float(one["audit_restitution"])
            if "audit_period_factor" in wide.coords:
                periods = [b.periods[0] for b in scene_of(json.loads(wide.attrs["sweep"])["scene"]).buildings]
                ok &= np.allclose(here["fundamental_period"], periods * one["audit_period_factor"], rtol=1e-12)
                masses = here["floor_mass"].values[:, 0] / np.array([120.0, 80.0])
                ok &= np.allclose(masses, one["audit_mass_factor"].values, rtol=1e-12)
                ratio = float(one["audit_damping_ratio"])
                own = 0.05 if math.isnan(ratio) else ratio
                ok &= float(here["first_damping_ratio"].values[0]) == pytest.approx(own, rel=1e-9)
            alike += [place] if ok else []
        assert alike
        held |= {*alike}
        for j, name in enumerate(texts):
            assert all(same_cell(texts[name][place], float(one["audit_error"].values[j])) for place in alike)
    assert {i for i, text in enumerate(texts["displacement_max"]) if text} == held


def test_a_part_of_the_row_leaves_out_columns_alone(tmp_path):
    """Scenarios are known by the whole row, here by a factor on the other building; a part alone tells no errors."""
    wide = made("buildings")
    path, whole = write_cube(wide, tmp_path / "a.nc"), read(export_cube(wide, tmp_path / "t.csv", table=True))
    for at, gone in (("building=a", "_b"), ("pair=a-b", ""), ("storey=1", "_2")):
        call("export", path, "-o", tmp_path / "p.csv", "--table", "--overwrite", "--at", at)
        rows = read(tmp_path / "p.csv")
        left_out = [name for name in whole[0] if name not in rows[0]]
        assert all(gone in name for name in left_out)
        assert bool(left_out) == bool(gone)
        assert rows == [{name: text for name, text in row.items() if name in rows[0]} for row in whole]
        assert any(row["audited_error_displacement_max"] for row in rows)
    alone = read(export_cube(wide.sel(building="a"), tmp_path / "p.csv", table=True, overwrite=True))
    assert [row["displacement_max_1"] for row in alone] == [row["displacement_max_a_1"] for row in whole]
    assert not [name for name in alone[0] if name.startswith("audited")]


def test_inputs_are_columns(tmp_path):
    wide = made("design")
    export_cube(wide, tmp_path / "t.csv", ["impact_force_max"], table=True)
    rows = read(tmp_path / "t.csv")
    columns = json.loads((tmp_path / "t.csv.json").read_text())["columns"]
    assert {"gap", "damping_ratio", "period_factor_b", "design_sample", "law", "record", "status"} <= {*rows[0]}
    assert not {"displacement_max_a_1", "audited_error_displacement_max"} & {*rows[0]}
    assert not [name for name in rows[0] if name.endswith("_no2")]
    assert {"audited_error_impact_force_max", "floor_mass_a_1", "fundamental_period_b"} <= {*rows[0]}
    assert columns["gap"]["units"] == "m"
    assert columns["ground_arias_intensity"]["units"] == "m s-1"


@pytest.mark.parametrize(
    "name", [*(pytest.param(name, marks=pytest.mark.slow) for name in ("axes", "pgas")), "cases", "design"]
)
def test_chosen_intensities_are_columns(name, tmp_path):
    """Spectral accelerations of the records as scaled, by their response spectra, a scenario at a time."""
    wide = with_intensities(made(name), ["sa(0.3)", "sa(b)"], records=motions())
    rows = read(export_cube(wide, tmp_path / "t.csv", ["impact_force_max"], table=True))
    first = pair().buildings[1].periods[0]
    wide = wide[["status"]]
    dims = wide["status"].dims
    for place, row in zip(np.ndindex(wide["status"].shape), rows, strict=True):
        one = wide.isel(dict(zip(dims, place, strict=True)))
        (record,) = [each for each in motions() if each.name == one["record"].item()]
        for column, period in (("ground_sa_0_3", 0.3), ("ground_sa_b", first)):
            assert float(row[column]) == pytest.approx(ordinate(record, float(one["scale"]), period), rel=1e-6)


def test_a_part_and_a_file(tmp_path):
    path = write_cube(made("axes"), tmp_path / "a.nc")
    at = ["--at", "law=kelvin_voigt", "--at", "record=two"]
    call("export", path, "-o", tmp_path / "t.csv", "--table", *at)
    rows = read(tmp_path / "t.csv")
    assert len(rows) == 8
    assert {row["law"] for row in rows} == {"kelvin_voigt"}
    with open_cube(path) as wide:
        part = select(wide, {"law": "kelvin_voigt", "record": "two"})
        largest = part["displacement_max"].values[..., 0, 1].ravel().tolist()
        assert all(same_cell(row["displacement_max_a_2"], value) for row, value in zip(rows, largest, strict=True))


@pytest.fixture(scope="module")
def one(stub_module):
    return simulate(pair(), motions()[0], law="linear", dt=0.01)


def test_histories_have_a_row_for_each_moment(one, tmp_path):
    """No cell is written twice: as many numbers as histories have."""
    rows = read(export_cube(one, tmp_path / "one.csv"))
    histories = [name for name, array in one.data_vars.items() if "time" in array.dims]
    assert len(rows) == one.sizes["time"]
    assert len(rows[0]) == 1 + sum(one[name].size // one.sizes["time"] for name in histories)
    for moment in (0, 7, -1):
        here = one.isel(time=moment)
        assert float(rows[moment]["time"]) == here["time"].item()
        assert same_cell(rows[moment]["displacement_b_2"], here["displacement"].sel(building="b", storey=2).item())
        assert same_cell(rows[moment]["contact_force_a_b_1"], here["contact_force"].values[0, 0])
        assert same_cell(rows[moment]["ground_acceleration"], here["ground_acceleration"].item())


def test_peaks_of_a_scenario_are_exported_alone(one, tmp_path):
    rows = read(export_cube(one, tmp_path / "peaks.csv", ["displacement_max", "impact_force_max"]))
    assert len(rows) == 4 + 2
    with pytest.raises(InputError, match="Zarr holds cubes, no tables"):
        export_cube(one, tmp_path / "table.zarr", table=True)
    with pytest.raises(InputError, match="one scenario with its histories"):
        export_cube(one, tmp_path / "table.csv", table=True)
