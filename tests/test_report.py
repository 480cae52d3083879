"""The report of a cube: its sections and numbers, the sweep file in it, and cubes with nothing to report."""

from __future__ import annotations

import json

import numpy as np
import pytest
from html_page import Page
from scenes import call

import pounding_sweep as ps
from pounding_sweep.analysis import required_gap
from pounding_sweep.base.errors import InputError
from pounding_sweep.pages.report import _sweep_file
from pounding_sweep.request.spec import digest, to_json
from pounding_sweep.variables.registry import DEFAULT_OUTPUTS, Status

pytestmark = pytest.mark.usefixtures("stub_module")

SUITE = [ps.synthetic_record(seed, pga=1.0, duration=4.0) for seed in (1, 2, 3)]
NAMES = [
    ps.Building('M\u00fcller & "S\u00f6hne" <b>', [100.0] * 2, [1e5] * 2),
    ps.Building("B's house", [80.0] * 3, [2e5] * 3),
]
OUTPUTS = [*DEFAULT_OUTPUTS, "closing_max", "acceleration_max"]


@pytest.fixture(autouse=True)
def coarse_pictures(monkeypatch):
    monkeypatch.setattr("pounding_sweep.pages.report._DPI", 10)


@pytest.fixture(scope="module")
def suite():
    return ps.Sweep(
        "mate2015", SUITE, ["linear", "none"], gaps=[0.005, 0.01], scales=[1.0, 2.0], outputs=OUTPUTS, title="Suite"
    ).run()


@pytest.fixture(scope="module")
def page(suite, tmp_path_factory):
    return Page(ps.report(suite, tmp_path_factory.mktemp("page") / "report.html"))


def test_a_page_has_what_the_axes_allow_and_loads_nothing(page):
    assert {source[:22] for source in page.loaded} == {"data:image/png;base64,"}
    for words in (
        "24 of 24 scenarios have results",
        "1. The row",
        "Figure 2. Acceleration histories and response spectra",
        "EN 1998-1:2004; 4.4.2.7",
        "Factors: 1 (elastic displacements).",
        "Responses with pounding over responses without",
        "as records are scaled up",
        "Probability that a pair touches",
        "pip install pounding-sweep==",
        "the energy budget needs",
        "needs two laws with contact",
    ):  # fmt: skip
        assert words in page.words, words
    assert "--at" not in page.words


def test_numbers_of_a_page_are_those_of_the_cube(suite, page):
    rows = {row[0]: row for row in page.table("Largest responses")}
    assert float(rows["largest contact force"][2]) == pytest.approx(suite.impact_force_max.max().item(), rel=5e-3)
    assert float(rows["largest interstorey drift"][2]) == pytest.approx(1e3 * suite.drift_max.max().item(), rel=5e-3)
    gaps = required_gap(suite, folders=[])
    rows = {row[0]: row for row in page.table("left-middle: required gap, the largest of 3 records, 2 scales")}
    assert float(rows["exact"][2]) == pytest.approx(1e3 * gaps.exact.sel(pair="left-middle").max().item(), rel=5e-3)
    eurocode = gaps.ratio.sel(pair="left-middle", rule="ec8")
    assert float(rows["Eurocode 8"][3]) == pytest.approx(eurocode.min().item(), rel=5e-3)


def test_tables_go_into_a_spreadsheet(page):
    headings, *rows = page.table("largest contact force (kN); law: Linear spring")
    assert headings[:4] == ["pair", "storey", "elevation (m)", "touching"]
    assert len(rows) == 6
    for row in rows:
        assert all(cell == "" or np.isfinite(float(cell)) for cell in row[1:])


def designed():
    inputs = {"gap": {"distribution": "uniform", "low": 0.005, "high": 0.02}, "record": {"distribution": "any"}}
    inputs["building"] = {"left": {"period_factor": {"distribution": "uniform", "low": 0.9, "high": 1.1}}}
    return ps.Sweep("mate2015", SUITE, "linear", design={"kind": "sobol", "samples": 8, "inputs": inputs})


def quoted():
    varied = {"stiffnesses": [2e6], "restitutions": [0.6], "period_factors": {NAMES[0].name: [1.0, 1.2]}}
    return ps.Sweep(ps.Scene(NAMES, [0.01]), "el_centro", "kelvin_voigt", title='"Umlaute" & <\u00fc>', **varied)


def pulsed():
    pulse = ps.pulse_record("ricker", amplitude=3.0, period=0.4, dt=0.01, name="mine", duration=3.0)
    return ps.Sweep("mate2015", [pulse, ps.find_record("el_centro").scaled(2.0)], "linear", gaps=[0.01])


@pytest.mark.parametrize("make", [designed, quoted, pulsed])
def test_the_sweep_file_is_that_of_the_cube(make, tmp_path):
    sweep = make()
    (tmp_path / "sweep.toml").write_text(_sweep_file(json.loads(to_json(sweep.spec))), encoding="utf-8")
    assert digest(ps.load_sweep(tmp_path / "sweep.toml").spec) == digest(sweep.spec)


def test_the_sweep_file_in_a_page_is_that_of_the_cube(suite, page, tmp_path):
    (tmp_path / "sweep.toml").write_text(page.blocks[1], encoding="utf-8")
    assert digest(ps.load_sweep(tmp_path / "sweep.toml").spec) == suite.attrs["sweep_sha256"]
    assert suite.attrs["sweep_sha256"] in page.words


def test_a_page_of_scenarios_that_are_not_ok_says_so(suite, tmp_path):
    failed = suite.copy(deep=True)
    failed["status"][...] = int(Status.DIVERGED)
    for name in failed.data_vars:
        if failed[name].dtype.kind == "f":
            failed[name][...] = np.nan
    page = Page(ps.report(failed, tmp_path / "report.html"))
    assert "NO SCENARIO of 24 has results" in page.words
    assert page.table("Scenarios by status")[1][:2] == ["diverged", "24"]
    assert "Largest contact force" not in page.words


def test_values_of_scenarios_that_are_not_ok_are_not_shown(tmp_path):
    failed = quoted().run()
    failed["status"][...] = int(Status.UNDER_RESOLVED_CONTACT)  # which have values
    page = Page(ps.report(failed, tmp_path / "report.html"))
    assert f"{NAMES[0].name}-{NAMES[1].name} needs a gap of" in page.words
    assert "figure 'force-gap' has nothing to draw: 2 of 2 scenarios are under_resolved_contact." in page.words
    assert "Largest" not in page.words


def test_what_is_no_report_is_refused(suite, tmp_path):
    with pytest.raises(InputError, match="no page; give a file that ends in"):
        ps.report(suite, tmp_path / "report.nc")
    with pytest.raises(InputError, match="option of a report 'behavior'; did you mean 'behaviour'"):
        ps.report(suite, tmp_path / "report.html", behavior=None)
    with pytest.raises(InputError, match="no statuses"):
        ps.report(suite.drop_vars("status"), tmp_path / "report.html")


def test_report_command(suite, tmp_path):
    suite.to_netcdf(tmp_path / "suite.nc")
    done = call(
        "report", tmp_path / "suite.nc", "-o", tmp_path / "r.html", "--at", "scale=2", "--q", "3", "--title", "Joint"
    )
    assert done.stdout.strip() == str(tmp_path / "r.html")
    page = Page(tmp_path / "r.html")
    assert page.words.startswith("Joint")
    assert "Factors: q = 3" in page.words
    assert "Cube suite.nc" in page.words
