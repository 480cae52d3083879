"""``records``, ``records plot``, and sweeps that go on without a missing record."""

from __future__ import annotations

import json
import re
from dataclasses import asdict

import pytest
from scenes import call
from test_cli import TINY, at2, write

import pounding_sweep as ps
from pounding_sweep.base.errors import SweepError
from pounding_sweep.records import RECORD_SETS, find_record, record_measures

PULSE = '{ pulse = "sine", amplitude = 5.0, period = 0.5, dt = 0.01, duration = 2.0 }'
assert TINY.count(PULSE) == 1


def asking(*records):
    """Return the tiny sweep with more records."""
    return TINY.replace(PULSE, ", ".join((PULSE, *records)))


@pytest.fixture(autouse=True)
def _no_records(monkeypatch):
    monkeypatch.delenv("POUNDING_SWEEP_RECORDS", raising=False)
    monkeypatch.setenv("COLUMNS", "100")


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "records"
    path.mkdir()
    (path / "ARL090.AT2").write_text(at2(50))
    return path


@pytest.mark.filterwarnings("always:a record:UserWarning")  # printed, as in a process of its own
def test_folders_and_patterns_in_sweep_files(tmp_path, folder):
    """The plan says how many records were found, and that components of one station are several."""
    (folder / "ARL360.AT2").write_text(at2(60))
    for item in ('"records/*.AT2"', '"records"', '{ path = "records/A*", scale = 0.5 }'):
        plan = call("plan", write(tmp_path, asking(item))).stdout
        assert "record files in order of name: 2; components of one station are" in " ".join(plan.split())
        assert plan.index("ARL090  ") < plan.index("ARL360  ")
        report = json.loads(call("plan", write(tmp_path, asking(item)), "--json").stdout)
        assert [record["name"] for record in report["records"]][1:] == ["ARL090", "ARL360"]
        assert {record["scale"] for record in report["records"][1:]} == {0.5 if "scale" in item else 1.0}
    failed = call("plan", write(tmp_path, asking('"records/*.V2"')), code=2).stderr
    assert "records/*.V2: no record file matches" in failed
    report = call("plan", write(tmp_path, asking('"records/*.V2"')), "--skip-missing-records", "--json").stdout
    assert json.loads(report)["records_left_out"] == ["records/*.V2"]


# -- records -----------------------------------------------------------------------------------------------------------


def test_list_has_the_measures_of_each_record(folder):
    found = json.loads(call("records", "--records", folder, "--json").stdout)
    row, measures = found["records"][0], record_measures(find_record("el_centro"))
    assert (row["name"], row["unit_from"]) == ("el_centro", "'acc (g)', line 1")
    assert asdict(measures).items() <= row.items()
    sets = [(each["name"], each["records"]) for each in found["sets"]]
    assert sets == [(key, item.components) for key, item in RECORD_SETS.items()]
    assert {each["name"]: "ngawest2" in each["place"] for each in found["missing"]}["santa_monica"]
    text = call("records", "--records", folder).stdout
    for line in (
        r"record +PGA g +PGV m/s +Arias m/s +CAV m/s +5-95 % s +duration s +dt s +points",
        rf"el_centro .* {measures.pgv:.3g} .* {measures.significant_duration:.2f} .*",
        r"fema_p695_far_field +FEMA P695 far-field set, as recorded +44",
    ):
        assert re.search(f"^{line}$", text, re.M)
    wrapped = re.sub(r"\n +", " ", text)
    assert re.search(r"^el_centro .*unit g: 'acc \(g\)', line 1; step: 'time', line 1$", wrapped, re.M)


def test_list_warns_of_doubts_and_takes_a_component(folder):
    rows = "".join(f"{i / 100},{v},{v + 1}\n" for i, v in enumerate((0.0, 0.5, -0.5) * 9))
    (folder / "two.csv").write_text(f"t,acc_x (g),acc_y (g)\n{rows}")
    several = "two.csv: has 2 components: 'acc_x (g)' (2), 'acc_y (g)' (3); give column="
    assert several in call("records", "--records", folder).stderr
    done = call("records", "--records", folder, "--column", "acc_y", "--json")
    assert "record 'two' has a mean of 67% of its PGA" in done.stderr
    rows = {row["name"]: row for row in json.loads(done.stdout)["records"]}
    assert (rows["two"]["column"], rows["two"]["pga_g"], rows["arleta"]["column"]) == ("acc_y (g)", 1.5, None)


@pytest.mark.usefixtures("stub_engine")
def test_plan_and_run_show_what_was_read(tmp_path):
    wrapped = '{ path = "w.txt", layout = "rows", dt = 0.01, units = "mg" }'
    path = write(tmp_path, asking('{ path = "a.csv", column = 3, name = "y" }', wrapped))
    rows = "".join(f"{i / 100},{i % 2},{i % 5}\n" for i in range(100))
    (tmp_path / "a.csv").write_text(f"t,acc_x (g),acc_y (mm/s2)\n{rows}")
    (tmp_path / "w.txt").write_text("0 1 0 -1\n" * 50)
    for words in (["plan", path], ["run", path, "-o", tmp_path / "out.nc", "--quiet"]):
        found = re.sub(r"\n +", " ", call(*words).stdout)
        assert (
            "y     100 points, dt 0.01 s, PGA 0.0004077 g; column acc_y (mm/s2); unit mm/s2: 'acc_y (mm/s2)', line 1; "
        ) in found
        assert "w     200 points, dt 0.01 s, PGA 0.001 g; unit mg: given; step: given" in found
    rows = json.loads(call("plan", path, "--json").stdout)["records"]
    assert [row["unit"] for row in rows] == [None, "mm/s2", "mg"]


def test_plot_draws_the_records_named(folder, not_rendered):
    data, out = folder / "motions.nc", folder / "motions.png"
    printed = call("records", "--records", folder, "plot", "arleta", "--damping", "0.02", "-o", out, "--data", data)
    assert printed.stdout.split() == [str(out), str(data)]
    measures = record_measures(find_record("arleta", folder))
    with ps.open_cube(data) as found:
        assert found["pgv"].attrs["units"] == "m s-1"
        assert (found["pgv"].item(), found["record"].item()) == (measures.pgv, "arleta")
        assert found["pseudo_acceleration"].dims == ("record", "period")
        assert found["damping_ratio"].item() == 0.02
    call("plot", data, "response-spectra", "-o", folder / "again.png")
    assert len(not_rendered) == 2


def test_plot_says_what_is_wrong(folder):
    out, data = folder / "a.png", folder / "ARL090.AT2"
    for words, said in (
        (["el_centro", "-o", out, "--data", data], "exists"),
        (["santa_monica", "--records", folder, "-o", out], "ngawest2"),
        (["--damping", "1", "-o", out], "in [0, 1)"),
        (["-o", folder / "a.what"], ".png, .svg or .pdf"),
    ):
        assert said in call("records", "plot", *words, code=2).stderr


# -- sweeps without a missing record -----------------------------------------------------------------------------------


@pytest.mark.usefixtures("stub_engine")
@pytest.mark.filterwarnings("always:a record:UserWarning")  # printed, as in a process of its own
def test_a_missing_record_stops_a_sweep_unless_told_otherwise(tmp_path):
    path = write(tmp_path, asking('"arleta"', '{ record = "santa_monica", scale = 2.0 }', '{ path = "gone.csv" }'))
    with pytest.raises(SweepError) as caught:
        ps.load_sweep(path)
    for i, (said, text) in enumerate(zip(("RSN 949", "RSN 1077", "no such file"), caught.value.problems, strict=True)):
        assert said in text
        assert f"sweep.records[{i + 1}]" in text
    run = ["run", path, "-o", tmp_path / "out.nc", "--quiet"]
    for words in (["plan", path], run):
        assert "RSN 949" in call(*words, code=2).stderr
        done = call(*words, "--skip-missing-records")
        assert re.search(r"^left out +arleta, santa_monica, gone: no such record at hand$", done.stdout, re.M)
        assert done.stderr.count("a record is left out: ") == 3
    left_out = ["arleta", "santa_monica", "gone"]
    assert json.loads(call("plan", path, "--skip-missing-records", "--json").stdout)["records_left_out"] == left_out
    with ps.open_cube(tmp_path / "out.nc") as cube:
        assert json.loads(cube.attrs["records_left_out"]) == left_out
        assert cube["record"].values.tolist() == ["sine"]
    assert re.search(r'records_left_out +\["arleta", ', call("info", tmp_path / "out.nc").stdout)


def test_going_on_without_hides_no_other_fault(folder):
    given = {"scene": "mate2015", "laws": "none", "folders": folder, "skip_missing_records": True}
    none = "none is left: santa_monica, nothing missing; get at least one"
    with pytest.warns(UserWarning, match="santa_monica"), pytest.raises(SweepError, match=none):
        ps.Sweep(records=["santa_monica", "nothing"], **given)
    (folder / "short.AT2").write_text(at2(50, said=60))
    with pytest.raises(SweepError, match=r"records\[1\].*60"):
        ps.Sweep(records=["arleta", "short"], **given)


def test_listed_cases_of_a_missing_record_are_left_out_too(tmp_path):
    head = TINY.partition("[sweep]")[0]
    sweep = f'[sweep]\nrecords = [{PULSE}, {{ record = "arleta", name = "A", scale = 2.0 }}]\n'
    names = ("A", "sine", "A", "sine")
    cases = [f'[[sweep.cases]]\nlaw = "linear"\nrecord = "{name}"\ngap = 0.00{i}\n' for i, name in enumerate(names, 1)]
    path = write(tmp_path, head + sweep + "\n".join(cases))
    with pytest.raises(SweepError, match="RSN 949"):
        ps.load_sweep(path)
    with pytest.warns(UserWarning, match="left out") as warned:
        spec = ps.load_sweep(path, skip_missing_records=True).spec
    assert re.search(r"a record is left out: .* RSN 949", str(warned[0].message))
    assert re.search(r"2 of 4 listed cases .* numbered anew", str(warned[1].message))
    assert spec.records_left_out == ("A",)
    assert [(case.record, case.gap) for case in spec.cases] == [("sine", 0.002), ("sine", 0.004)]
    path = write(tmp_path, head + sweep + cases[0])
    with pytest.warns(UserWarning, match="left out"), pytest.raises(SweepError, match="cases: none is left: 1 of 1"):
        ps.load_sweep(path, skip_missing_records=True)


def test_a_sweep_finds_its_records_in_a_named_folder(folder, tmp_path):
    path = write(tmp_path, asking('"arleta"', '{ record = "arleta", pga = 2.0, name = "twice" }'))
    assert "arleta" in call("plan", path, code=2).stderr
    call("plan", path, "--records", folder)
    spec = ps.load_sweep(path, folders=folder).spec
    assert [record.name for record in spec.records][1:] == ["arleta", "twice"]
    assert spec.records[2].pga == pytest.approx(2.0)
