"""The report of the paper: figures, one page that needs nothing else, and the command from El Centro to both."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from paper_study import histories, make_study, outputs
from typer.testing import CliRunner

import pounding_sweep as ps
from pounding_sweep.analysis.comparisons.contacts import energy_transfer
from pounding_sweep.cli.app import app
from pounding_sweep.paper.figures import PAPER_FIGURES, roof_histories, save_figures
from pounding_sweep.paper.published import READINGS, sweep_of
from pounding_sweep.paper.report import Picture, contents_of, render, summary
from pounding_sweep.paper.study import INTERVAL, scenario, thin_out

#: Eight bytes that begin every PNG file.
PNG = b"\x89PNG\r\n\x1a\n"


class Page(HTMLParser):
    """What a page loads, links to and says, and whether its tags match."""

    def __init__(self, text):
        super().__init__()
        self.loaded, self.open, self.text, self.tables = [], [], [], 0
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.loaded += [value for key, value in attrs if key in ("src", "href", "srcset", "data", "action", "poster")]
        self.tables += tag == "table"
        if tag not in ("meta", "img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)

    @property
    def words(self):
        return " ".join("".join(self.text).split())


@pytest.fixture(scope="module")
def made():
    return make_study()


@pytest.fixture(scope="module")
def picture(tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "figure_05.png"
    path.write_bytes(PNG + b"nothing more")
    return Picture(5, "A & B", path)


def test_the_page_says_what_there_is_and_loads_nothing(made, picture):
    said = contents_of(made)
    text = render(said, [picture])
    page = Page(text)
    assert page.open == []
    assert [source[:22] for source in page.loaded] == ["data:image/png;base64,"]
    assert "url(" not in text
    for words in (
        "as probably run",
        "record 'arleta' is missing: get it from https://example.org",
        "Figure 5. A & B.",
        "Table 3: peak displacements",
        "Models without a first impact",
        "beyond stability limit",
        "Relative difference to a run with steps of at most 0.25 ms",
    ):
        assert words in page.words, words
    # records, 4 of agreement, Hertz, largest steps, steps of 2 readings, energy, errors, 4 in full
    assert page.tables == 1 + 4 + 1 + 1 + 2 + 1 + 1 + 4
    begin = page.words.index("The verdict")
    assert begin < page.words.index("1. What was computed")
    for part in said["opening"]:
        assert f"{part.word}, {part.reading} {'; '.join(part.items)}" in page.words[begin:]
    assert [grid.title for grid in summary(said)][:2] == ["The verdict", "The paper's conclusions"]
    verdicts = said["judgements"]
    assert len(verdicts) == 5 * len(READINGS)
    assert all(one.verdict.value in page.words for one in verdicts)


def test_a_report_of_one_reading_has_no_other(picture):
    one = outputs(readings=("as_run",))
    whole = make_study()
    parts = {name: getattr(whole, name).sel(reading=["as_run"]) for name in ("histories", "floor_spectra", "steps")}
    study = make_study(cube=one, **parts)
    page = Page(render(contents_of(study), [picture]))
    assert "one reading of the paper's data" in page.words
    assert "as printed (scene" not in page.words


@pytest.mark.parametrize("one", PAPER_FIGURES, ids=lambda one: str(one.number))
def test_every_figure_shows_its_data(made, one):
    figure = one.draw(made)
    axes = figure.get_axes()
    assert all(ax.lines for ax in axes)
    labels = [ax.get_xlabel() for ax in axes] + [ax.get_ylabel() for ax in axes]
    labels += [part.get_supxlabel() + part.get_supylabel() for part in (figure, *figure.subfigs)]
    assert any("(" in label for label in labels if label)
    drawn = np.concatenate([np.asarray(line.get_xydata(), float) for ax in axes for line in ax.lines])
    assert (np.ptp(drawn[np.isfinite(drawn).all(axis=1)], axis=0) > 0.0).all()


def test_figures_4_to_21_are_drawn():
    assert [one.number for one in PAPER_FIGURES] == list(range(4, 22))
    assert len({one.title for one in PAPER_FIGURES}) == 18


def test_figures_are_saved_in_two_formats(made, tmp_path, monkeypatch):
    monkeypatch.setattr("pounding_sweep.paper.figures.PAPER_FIGURES", PAPER_FIGURES[4:5])
    found = save_figures(made, tmp_path)
    assert [picture.path.name for picture in found] == ["figure_08.png"]
    for picture in found:
        assert picture.path.read_bytes().startswith(PNG)
        assert "<svg" in picture.path.with_suffix(".svg").read_text()


def test_displacements_and_shears_stand_at_their_floors(made):
    from pounding_sweep.paper.figures import displacement_profiles, shear_profiles

    storey = xr.DataArray([1.0, 2.0, 3.0], dims="storey", coords={"storey": [1, 2, 3]})
    cube = outputs(displacement_max=1e-3 * storey, displacement_min=-2e-3 * storey, storey_shear_max=4e3 - 1e3 * storey)
    forth, back = displacement_profiles(cube, "left").axes[0].lines[:2]
    assert [line.get_xdata().tolist() for line in (forth, back)] == [[0.0, 1.0, 2.0, 3.0], [0.0, -2.0, -4.0, -6.0]]
    line = shear_profiles(cube, "left").axes[0].lines[0]
    assert line.get_xdata().tolist() == [3.0, 3.0, 2.0, 2.0, 1.0, 1.0]
    assert line.get_ydata().tolist() == [0, 1, 1, 2, 2, 3]


def test_the_quiet_end_of_a_record_is_not_drawn():
    one = histories()
    late = one.where(one.time < 2.0, 0.0)
    figure = roof_histories(late, "el_centro", pair="left-middle")
    assert figure.axes[0].get_xlim()[1] < 2.2


def test_histories_keep_the_peaks_of_forces():
    time = np.arange(0.0, 0.1, 0.001)
    time = np.append(time, 0.1)
    rng = np.random.default_rng(1)
    force, floors = rng.random((time.size, 2, 3)), rng.random((time.size, 3, 3))
    energies = {name: (("time", "building"), rng.random((time.size, 3))) for name in ("kinetic", "strain", "damping")}
    one = xr.Dataset(
        {
            "contact_force": (("time", "pair", "storey"), force),
            "displacement": (("time", "building", "storey"), floors),
            **energies,
        },
        {"time": time, "storey": [1, 2, 3]},
    )
    found = thin_out(one)
    every = round(INTERVAL / 0.001)
    np.testing.assert_allclose(found.time, np.arange(0.0, 0.1001, INTERVAL))
    for i in range(10):
        np.testing.assert_array_equal(found.roof_force[i], force[every * i : every * (i + 1), :, 2].max(axis=0))
    np.testing.assert_array_equal(found.roof_displacement, floors[::every, :, 2])
    total = sum(values for _, values in energies.values())
    np.testing.assert_allclose(found.structural_energy, total[::every])
    assert {found[name].attrs["units"] for name in ("roof_force", "structural_energy")} == {"kN", "kN m"}


def cli(*args):
    env = {key: value for key, value in os.environ.items() if key != "POUNDING_SWEEP_RECORDS"}
    done = subprocess.run(
        [sys.executable, "-m", "pounding_sweep", *map(str, args)], capture_output=True, text=True, env=env, check=False
    )
    assert done.returncode == 0, done.stderr
    return done


def test_the_command_refuses_what_it_cannot_use(tmp_path):
    (tmp_path / "report.html").write_text("mine")
    (tmp_path / "file").write_text("")
    for words, said in (
        (("-o", tmp_path), "exists"),
        ((tmp_path / "none.nc", "-o", tmp_path / "new"), "does not exist"),
        (("-o", tmp_path / "file"), "is not a folder"),
    ):
        done = CliRunner().invoke(app, ["paper", *map(str, words)])
        assert done.exit_code == 2
        assert said in done.stderr


@pytest.mark.release
def test_a_fresh_machine_gets_the_report_of_el_centro(tmp_path):
    """Without cubes both readings are run; the same readings from cubes give the same verdicts."""
    done = cli("paper", "-o", tmp_path / "both", "--json", "--quiet")
    both = json.loads(done.stdout)
    assert both["records"] == ["el_centro"]
    assert list(both["missing"]) == ["arleta", "santa_monica", "san_fernando"]
    assert done.stderr.count("left out: record") == len(done.stderr.splitlines()) == 3
    assert not both["warnings"]
    page = Page((tmp_path / "both" / "report.html").read_text())
    assert page.open == []
    assert len(page.loaded) == len(both["figures"]) == 18
    assert all(source.startswith("data:image/png;base64,") for source in page.loaded)
    assert page.words.count("ngawest2.berkeley.edu") == 3

    sweep = Path(__file__).parents[1] / "sweeps" / "mate2015.toml"
    cli("run", sweep, "-o", tmp_path / "mate2015.nc", "--skip-missing-records", "--quiet")
    one = cli("paper", tmp_path / "mate2015.nc", "-o", tmp_path / "one")
    assert "as printed" in one.stdout
    assert "as probably run" not in one.stdout
    assert {part["word"] for part in both["verdict"]} >= {"Reproduced", "Not reproduced", "Can't be"}
    own = [verdict for verdict in both["verdicts"] if verdict["reading"] == "as_printed"]
    with ps.open_cube(tmp_path / "mate2015.nc") as cube:
        assert float(cube.energy_residual.max()) < 1e-5
        assert not cube.status.values.any()
    assert len(own) == 5
    assert all(claim["numbers"] in one.stdout for verdict in own for claim in verdict["claims"])


@pytest.mark.slow
@pytest.mark.parametrize("law", ["linear", "hertz_damped"])
def test_histories_are_those_of_the_cube(law):
    """Peaks of the histories, sampled at the steps, come near those that the sweep located, and never beyond."""
    reading, record = READINGS["as_printed"], ps.find_record("el_centro")
    spec = replace(sweep_of(reading, [record], audit=0.0).spec, laws=(law, "none"))  # each alone is compiled faster
    cube = ps.Sweep.from_spec(spec).run().squeeze(drop=True).sel(law=law)
    one = scenario(reading, record, law)
    found = thin_out(one)
    roofs = cube.isel(storey=-1)
    for peak, largest in (
        (found.roof_force.max("time"), roofs.impact_force_max),
        (found.roof_displacement.max("time"), roofs.displacement_max),
        (-found.roof_displacement.min("time"), -roofs.displacement_min),
    ):
        assert (peak <= largest * (1.0 + 1e-9)).all()
        np.testing.assert_allclose(peak, largest, rtol=0.02)
    balance = one.input.isel(time=-1) - one.transfer.isel(time=-1)
    np.testing.assert_allclose(found.structural_energy.isel(time=-1), balance, rtol=1e-9)
    np.testing.assert_allclose(one.transfer.isel(time=-1), energy_transfer(cube), atol=1e-4)
