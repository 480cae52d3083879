"""The report of the paper: figures, one page that needs nothing else, and the command from El Centro to both."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from html_page import Page
from paper_study import along, histories, make_study, outputs
from scenes import call

import pounding_sweep as ps
from pounding_sweep.analysis.comparisons.responses import energy_transfer
from pounding_sweep.paper.figures import PAPER_FIGURES, save_figures
from pounding_sweep.paper.report import contents_of, summary, write_report
from pounding_sweep.paper.study import READINGS, scenario, sweep_of, thin_out

#: Eight bytes that begin every PNG file.
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def study():
    return make_study()


@pytest.fixture
def picture(tmp_path):
    path = tmp_path / "figure_05.png"
    path.write_bytes(PNG + b"nothing more")
    return 5, "A & B", path


def test_the_page_says_what_there_is_and_loads_nothing(study, picture, tmp_path):
    contents = contents_of(study)
    page = Page(write_report(contents, [picture], tmp_path / "report.html"))
    assert [source[:22] for source in page.loaded] == ["data:image/png;base64,"]
    assert "url(" not in (tmp_path / "report.html").read_text()
    for words in (
        "as probably run",
        "record 'arleta' is missing: get it from https://example.org",
        "Figure 5. A & B.",
        "Table 3: peak displacements",
        "Models without a first impact",
        "beyond stability limit",
        "Relative difference to a run with steps of at most 0.25 ms",
        "where 90% of those that are not zero in both are within 25%, in part from 50%",
    ):
        assert words in page.words, words
    # records, 4 of agreement, Hertz, largest steps, steps of 2 readings, energy, errors, 4 in full
    assert page.tables == 1 + 4 + 1 + 1 + 2 + 1 + 1 + 4
    assert page.words.index("The verdict") < page.words.index("1. What was computed")
    for part in contents["opening"]:
        assert f"{part.word}, {part.reading} {'; '.join(part.items)}" in page.words
    assert [grid.title for grid in summary(contents)][:2] == ["The verdict", "The paper's conclusions"]
    assert len(contents["judgements"]) == 5 * len(READINGS)
    assert all(one.verdict.value in page.words for one in contents["judgements"])


def test_every_figure_shows_its_data(study):
    assert list(PAPER_FIGURES) == list(range(4, 22))
    assert len({title for title, _ in PAPER_FIGURES.values()}) == 18
    for _, draw in PAPER_FIGURES.values():
        figure = draw(study)
        axes = figure.get_axes()
        assert all(ax.lines for ax in axes)
        labels = [ax.get_xlabel() for ax in axes] + [ax.get_ylabel() for ax in axes]
        labels += [part.get_supxlabel() + part.get_supylabel() for part in (figure, *figure.subfigs)]
        assert any("(" in label for label in labels if label)
        drawn = np.concatenate([np.asarray(line.get_xydata(), float) for ax in axes for line in ax.lines])
        assert (np.ptp(drawn[np.isfinite(drawn).all(axis=1)], axis=0) > 0.0).all()


def test_figures_are_saved_in_two_formats(study, tmp_path, monkeypatch):
    monkeypatch.setattr("pounding_sweep.paper.figures.PAPER_FIGURES", {8: PAPER_FIGURES[8]})
    ((number, _, path),) = save_figures(study, tmp_path)
    assert (number, path) == (8, tmp_path / "figure_08.png")
    assert path.read_bytes().startswith(PNG)
    assert "<svg" in path.with_suffix(".svg").read_text()


def test_figures_show_numbers_where_they_belong(study):
    storey = along("storey", 1, 2, 3)
    cube = outputs(displacement_max=1e-3 * storey, displacement_min=-2e-3 * storey, storey_shear_max=4e3 - 1e3 * storey)
    displacements, shears = (PAPER_FIGURES[number][1](replace(study, cube=cube)).axes[0].lines for number in (5, 8))
    assert [line.get_xdata().tolist() for line in displacements[:2]] == [[0, 1, 2, 3], [0, -2, -4, -6]]
    assert shears[0].get_xdata().tolist() == [3.0, 3.0, 2.0, 2.0, 1.0, 1.0]
    assert shears[0].get_ydata().tolist() == [0, 1, 1, 2, 2, 3]
    late = PAPER_FIGURES[20][1](replace(study, histories=histories(quiet_after=2.0)))
    assert late.axes[0].get_xlim()[1] < 2.2  # the quiet end of a record is not drawn


def test_the_command_refuses_what_it_cannot_use(tmp_path):
    (tmp_path / "report.html").write_text("mine")
    (tmp_path / "file").write_text("")
    for words, message in (
        (("-o", tmp_path), "exists"),
        ((tmp_path / "none.nc", "-o", tmp_path / "new"), "does not exist"),
        (("-o", tmp_path / "file"), "is not a folder"),
    ):
        assert message in call("paper", *words, code=2).stderr


def cli(*args):
    env = {key: value for key, value in os.environ.items() if key != "POUNDING_SWEEP_RECORDS"}
    command = [sys.executable, "-m", "pounding_sweep", *map(str, args)]
    done = subprocess.run(command, capture_output=True, text=True, env=env, check=False)
    assert done.returncode == 0, done.stderr
    return done


@pytest.mark.release
def test_a_fresh_machine_gets_the_report_of_el_centro(tmp_path):
    """Without cubes both readings are run; the same readings from cubes give the same verdicts."""
    done = cli("paper", "-o", tmp_path / "both", "--json", "--quiet")
    both = json.loads(done.stdout)
    assert both["records"] == ["el_centro"]
    assert list(both["missing"]) == ["arleta", "santa_monica", "san_fernando"]
    assert done.stderr.count("left out: record") == len(done.stderr.splitlines()) == 3
    assert not both["warnings"]
    page = Page(tmp_path / "both" / "report.html")
    assert len(page.loaded) == len(both["figures"]) == 18
    assert all(source.startswith("data:image/png;base64,") for source in page.loaded)
    assert page.words.count("ngawest2.berkeley.edu") == 3

    sweep, cube = Path(__file__).parents[1] / "sweeps" / "mate2015.toml", tmp_path / "mate2015.nc"
    cli("run", sweep, "-o", cube, "--skip-missing-records", "--quiet")
    one = cli("paper", cube, "-o", tmp_path / "one")
    assert "as printed" in one.stdout
    assert "as probably run" not in one.stdout
    assert {part["word"] for part in both["verdict"]} >= {"Reproduced", "Not reproduced", "Can't be"}
    printed = [verdict for verdict in both["verdicts"] if verdict["reading"] == "as_printed"]
    with ps.open_cube(cube) as dataset:
        assert float(dataset.energy_residual.max()) < 1e-5
        assert not dataset.status.values.any()
    assert len(printed) == 5
    assert all(claim["numbers"] in one.stdout for verdict in printed for claim in verdict["claims"])


@pytest.mark.slow
@pytest.mark.parametrize("law", ["linear", "hertz_damped"])
def test_histories_are_those_of_the_cube(law):
    """Peaks of the histories, sampled at the steps, come near those that the sweep located, and never beyond."""
    reading, record = READINGS["as_printed"], ps.find_record("el_centro")
    spec = replace(sweep_of(reading, [record], audit=0.0).spec, laws=(law, "none"))  # each alone is compiled faster
    cube = ps.Sweep.from_spec(spec).run().squeeze(drop=True).sel(law=law)
    one = scenario(reading, record, law)
    thin, roofs = thin_out(one), cube.isel(storey=-1)
    for peak, largest in (
        (thin.roof_force.max("time"), roofs.impact_force_max),
        (thin.roof_displacement.max("time"), roofs.displacement_max),
        (-thin.roof_displacement.min("time"), -roofs.displacement_min),
    ):
        assert (peak <= largest * (1.0 + 1e-9)).all()
        np.testing.assert_allclose(peak, largest, rtol=0.02)
    balance = one.input.isel(time=-1) - one.transfer.isel(time=-1)
    np.testing.assert_allclose(thin.structural_energy.isel(time=-1), balance, rtol=1e-9)
    np.testing.assert_allclose(one.transfer.isel(time=-1), energy_transfer(cube), atol=1e-4)
