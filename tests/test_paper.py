"""The paper's tables, readings and conclusions on hand-made cubes, and its report from El Centro to the page."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
import tomllib
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from html_page import Page
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import call

import pounding_sweep as ps
from pounding_sweep.analysis.comparisons.responses import energy_transfer
from pounding_sweep.analysis.spectra import response_spectrum
from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.base.errors import InputError
from pounding_sweep.model.laws import MATE2015_MODELS
from pounding_sweep.model.presets import PRESETS
from pounding_sweep.paper import compare
from pounding_sweep.paper.compare import Judgement, Outcome, Verdict, judge, side_by_side
from pounding_sweep.paper.figures import PAPER_FIGURES, save_figures
from pounding_sweep.paper.report import agreement, contents_of, summary, table_grid, write_report
from pounding_sweep.paper.study import (
    BUILDINGS,
    HERTZ_LAWS,
    OUTPUTS,
    PAIRS,
    READINGS,
    RECORDS,
    STEP_OUTPUTS,
    STOREYS,
    TABLES,
    Study,
    force_fit,
    paper_records,
    published,
    scenario,
    study,
    sweep_of,
    thin_out,
)
from pounding_sweep.records import find_record, records_dataset
from pounding_sweep.request.spec import to_json
from pounding_sweep.variables.registry import Status, get_variable

LAWS = list(MATE2015_MODELS)
OUTER = {"reading": list(READINGS), "law": LAWS, "record": ["el_centro"]}
INNER = {"building": list(BUILDINGS), "pair": list(PAIRS), "storey": list(STOREYS)}


def along(dim, *values):
    """One number for each label of a dimension."""
    labels = (OUTER | INNER)[dim]
    return xr.DataArray(np.array(values, float), dims=dim, coords={dim: labels})


def outputs(**values):
    """Outputs of a cube: those of `values` (anything that broadcasts), all others 1 and 0 without contact."""
    coords = OUTER | INNER
    contact = along("law", 1, 1, 1, 1, 1, 1, 0)
    result = {}
    for name in OUTPUTS:
        dims = ("reading", "law", "record", *get_variable(name).dims)
        ones = xr.DataArray(np.ones([len(coords[dim]) for dim in dims]), {dim: coords[dim] for dim in dims}, dims)
        value = values.get(name, contact if "pair" in dims else 1.0)
        result[name] = (0.0 * ones + value).transpose(*dims)
    return xr.Dataset(result)


def spectra(grow=2.0, wide=True):
    """Spectra that are narrow without pounding; with it `grow` times as high, and flat or as narrow."""
    period = np.geomspace(0.02, 3.0, 150)
    narrow = np.exp(-0.5 * (np.log(period / 0.3) / 0.1) ** 2)
    values = np.stack([grow * (np.ones_like(period) if wide else narrow)] * 6 + [narrow])
    data = xr.DataArray(values, {"law": LAWS, "period": ("period", period, {"units": "s"})}, ("law", "period"))
    return data.expand_dims(reading=OUTER["reading"], record=OUTER["record"], building=INNER["building"])


def histories(quiet_after=8.0):
    """Waves that fade, and forces at their crests; and `spectra`."""
    time = np.arange(0.0, 8.0, 0.01)
    wave = np.exp(-0.2 * time) * np.sin(9.0 * time) * (time < quiet_after)
    parts = {
        "roof_displacement": (0.02 * wave, "building"),
        "structural_energy": (np.cumsum(wave**2), "building"),
        "roof_force": (np.maximum(wave - 0.5, 0.0) * 1e3, "pair"),
    }
    coords = {"time": ("time", time, {"units": "s"})}
    made = {
        name: xr.DataArray(values, coords, ("time",)).expand_dims({**OUTER, dim: INNER[dim]})
        for name, (values, dim) in parts.items()
    }
    return xr.Dataset({**made, "pseudo_acceleration": spectra()})


def steps(step=(2e-2, 1e-3)):
    """Errors that fall with the square of the step; the largest step is refused."""
    step = np.array(step)
    coords = {"reading": OUTER["reading"], "scheme": ["rk4", "newmark"], "located": np.array([1, 0], np.int8)}
    coords |= {"step": step, "output": list(STEP_OUTPUTS)}
    shape = [len(values) for values in coords.values()]
    status = np.where(step > 1e-2, Status.BEYOND_STABILITY_LIMIT, Status.OK).astype(np.int8)
    data = {
        "error": (list(coords), np.broadcast_to(step[:, None] ** 2, shape)),
        "status": (list(coords)[:-1], np.broadcast_to(status, shape[:-1])),
    }
    return xr.Dataset(data, coords)


def hertz():
    """Ratios of 20 and 1."""
    coords = {"law": list(HERTZ_LAWS), "stiffness": [1.88e7, 2.79e4], "law_model": ("law", ["IV", "V", "VI"])}
    values = {"force_ratio": np.broadcast_to([20.0, 1.0], (3, 2)), "ratio_spread": np.full((3, 2), np.nan)}
    values["cells"] = np.full((3, 2), 4, np.int32)
    return xr.Dataset({name: (("law", "stiffness"), part) for name, part in values.items()}, coords)


def make_study():
    """A study of El Centro alone."""
    record = find_record("el_centro")
    cube = outputs(storey_shear_max=along("storey", 3, 2, 1))
    error = xr.Dataset({name: xr.full_like(cube["energy_residual"], 1e-6) for name in OUTPUTS})
    missing = {"arleta": "record 'arleta' is missing: get it from https://example.org"}
    motions = records_dataset([record]).merge(response_spectrum([record], [0.1, 0.5, 1.0]))
    return Study(cube, (record,), missing, motions, histories(), error, steps(), hertz())


def run_cube(reading="as_printed", **values):
    """A cube as `run` makes it, with the axes of a sweep and what its attributes say."""
    spec = sweep_of(READINGS[reading], [find_record("el_centro")]).spec
    cube = outputs(**values).sel(reading=reading, drop=True)
    cube = cube.expand_dims(gap=[0.01], stiffness_factor=[1.0], restitution=[0.6], scale=[1.0])
    records = [{"name": record.name, "sha256": record.sha256} for record in spec.records]
    cube["status"] = xr.zeros_like(cube["energy_residual"], dtype=np.int8)
    return cube.assign_attrs(sweep=to_json(spec), records=json.dumps(records))


SWEEPS = Path(__file__).resolve().parent.parent / "sweeps"
HOLDS, PARTLY, FAILS, UNTESTED = Verdict


@pytest.mark.parametrize("number", TABLES)
def test_every_number_of_a_table_is_read_once(number):
    text = files("pounding_sweep").joinpath("data", "mate2015", f"table{number}.csv").read_text("utf-8")
    units = ("_m", "_kN", "_kNm", "impacts")
    rows = csv.DictReader(text.splitlines())
    printed = sorted(abs(float(cell)) for row in rows for name, cell in row.items() if name.endswith(units))
    table = published(number)
    read = np.sort(np.abs(np.concatenate([values.values.ravel() for values in table.data_vars.values()])))
    np.testing.assert_array_equal(read, printed)


def test_numbers_stand_where_the_paper_has_them():
    for number, dims, labels, numbers in (
        (3, "record building storey program", ("santa_monica", "right", 3, "sap2000"), (0.040, -0.027)),
        (4, "record pair storey program", ("arleta", "middle-right", 2, "matlab"), (710.0, 5.0)),
        (5, "law record pair storey", ("nonlinear_viscoelastic", "san_fernando", "middle-right", 3), (471.0, 24.0)),
        (6, "law record building", ("none", "santa_monica", "right"), (14.6, -56.2)),
    ):
        place = published(number).sel(dict(zip(dims.split(), labels, strict=True)))
        assert tuple(part.item() for part in place.data_vars.values()) == numbers


def test_model_one_is_the_same_in_tables_4_and_5():
    matlab, one = published(4).sel(program="matlab", drop=True), published(5).sel(law="linear", drop=True)
    xr.testing.assert_equal(matlab, one.transpose(*matlab.impact_force_max.dims))


@pytest.mark.parametrize("reading", READINGS.values(), ids=list(READINGS))
def test_the_sweep_file_is_the_sweep_of_the_reading(reading, monkeypatch):
    everything, missing = paper_records()
    if not missing:
        assert ps.load_sweep(SWEEPS / f"{reading.preset}.toml").spec == sweep_of(reading, everything).spec
        assert everything[-1].pga == pytest.approx(1.16 * 9.81, rel=1e-12)
    monkeypatch.delenv("POUNDING_SWEEP_RECORDS", raising=False)
    records, missing = paper_records()
    assert [record.name for record in records] == ["el_centro"]
    assert list(missing) == list(RECORDS[1:])
    assert all("https://ngawest2.berkeley.edu" in text for text in missing.values())
    with pytest.warns(UserWarning, match="is left out: record"):
        spec = ps.load_sweep(SWEEPS / f"{reading.preset}.toml", skip_missing_records=True).spec
    assert spec.records_left_out == RECORDS[1:]
    assert replace(spec, records_left_out=()) == sweep_of(reading, records).spec
    # the paper's peak to the last digit: cubes are known to be run with the record by its hash
    asked = tomllib.loads((SWEEPS / f"{reading.preset}.toml").read_text())["sweep"]["records"]
    peaks = {one["record"]: one["pga"] for one in asked if isinstance(one, dict)}
    assert peaks == {"san_fernando": 1.16 * STANDARD_GRAVITY}


def test_the_row_as_run_differs_in_three_values():
    printed, run = (PRESETS[reading.preset].scene for reading in READINGS.values())
    assert run.buildings[:2] == printed.buildings[:2]
    assert run.buildings[2].masses == printed.buildings[2].masses
    assert run.buildings[2].stiffnesses == pytest.approx([2 * 333.472e3] * 3)
    assert (run.gaps, run.contact.restitution) == (printed.gaps, printed.contact.restitution)
    assert run.contact.linear_stiffness == printed.contact.linear_stiffness / 10
    # Hertz: Eqs 9 to 11 with their square root and 1 - nu, and E = 5000 sqrt(25) of IS 456 without its unit
    r1, r2 = ((3.0 * m / (4.0 * np.pi * 2.5)) ** 0.5 for m in (133.956, 136.286))
    h = (1.0 - 0.2) / (np.pi * 5000.0 * 25.0**0.5)
    k = 4.0 / (3.0 * np.pi * 2.0 * h) * (r1 * r2 / (r1 + r2)) ** 0.5
    assert run.contact.hertz_stiffness == pytest.approx(k, rel=2e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.assign_attrs(sweep='{"scene": {"row": []}}'), "cube 1 was run for another row .*mate2015_as_run"),
        (lambda c: c.drop_vars("contact_work"), "cube 1 lacks contact_work"),
        (lambda c: c.drop_sel(law="hertz"), "lacks law hertz; make it with"),
        (lambda c: c.assign_coords(gap=[0.02]), "lacks gap 0.01"),
        (lambda c: c.assign_attrs(records="[]"), "no record of the cubes can be used: .*'el_centro' at hand is not"),
        (
            lambda c: c.assign_attrs(records='[{"name": "el_centro", "sha256": "0"}]'),
            "record 'el_centro' at hand is not a motion that the cubes were run with",
        ),
    ],
)
def test_a_cube_that_lacks_something_is_refused_with_the_remedy(change, message):
    with pytest.raises(InputError, match=message):
        study([change(run_cube())], folders=[])


def table_as_cube(number, factor):
    """A cube that holds a table's own numbers under El Centro (of the MATLAB program) times a factor."""
    table = published(number).sel(record=["el_centro"])
    table = table.sel(program="matlab", drop=True) if "program" in table.dims else table
    table = table.reindex(law=LAWS, fill_value=0.0) if "law" in table.dims else table
    return outputs(**{name: factor * values for name, values in table.data_vars.items()})


@pytest.mark.parametrize("number", TABLES)
@settings(max_examples=5)
@given(factor=st.floats(0.5, 2.0))
def test_differences_are_relative_to_the_papers_numbers(number, factor):
    compared = side_by_side(number, table_as_cube(number, factor))
    for name in published(number).data_vars:
        difference = compared[f"{name}_difference"]
        paper = compared[name].isel(source=-3)  # before the two readings: the MATLAB program's, or the only one
        np.testing.assert_allclose(difference.where(paper != 0.0, factor - 1.0), factor - 1.0, atol=1e-12)
        assert difference.where(paper == 0.0).isnull().all()
        assert compared[name].attrs["units"] == published(number)[name].attrs["units"]


def test_tables_are_written_beside_the_readings_and_summed_up():
    grid = table_grid(side_by_side(5, table_as_cube(5, 1.1)))
    assert len(grid.rows) == 6 * 1 * 2 * 3
    row = next(row for row in grid.rows if row[:4] == ("I", "El Centro", "left-middle", "3"))
    assert row[4:9] == ("1184", "1302", "+10%", "1302", "+10%")

    def rows(cube):
        grid = agreement(side_by_side(5, cube))
        return [row[2:] for row in grid.rows if row[:2] == ["peak force", "as printed"]]

    touching = int((published(5).impact_force_max.sel(record="el_centro") > 0).sum())
    cells = ["36", "20%", f"0 of {touching}", f"{touching} of {touching}", "0"]
    assert rows(table_as_cube(5, 1.2)) == [["all", *cells], ["El Centro", *cells]]
    assert [row[-1] for row in rows(outputs())] == [str(36 - touching)] * 2


def judged(key, spectrum=None, **values):
    """One conclusion judged by a cube as printed."""
    judgements = judge(outputs(**values), spectra() if spectrum is None else spectrum)
    assert [one.conclusion["key"] for one in judgements] == [c["key"] for c in compare.CONCLUSIONS for _ in READINGS]
    return next(one for one in judgements if one.conclusion["key"] == key and one.reading == "as_printed")


def by_law(*values):
    return along("law", *values)


def top_heavy(*laws):
    """Shears that fall with height, but for the right building's top under some laws."""
    heavy = along("law", *(law in laws for law in LAWS)) * along("building", 0, 0, 1) * along("storey", 0, 0, 1)
    return along("storey", 3, 2, 1) + 1.5 * heavy


#: Peak forces (kN) by model that bear the paper out in every respect.
FORCES = by_law(100, 95, 90, 50, 20, 10, 0)
RISING, TWICE = by_law(1, 2, 3, 4, 5, 6, 7), by_law(1, 1, 1, 2, 2, 2, 1)
ANY_FORCE, ANY_COUNT = by_law(100, 70, 90, 50, 60, 10, 0), by_law(20, 10, 20, 1, 1, 1, 0)
HERTZ_HIGH = {"impact_force_max": by_law(100, 95, 90, 99, 20, 10, 0), "displacement_max": TWICE}


@pytest.mark.parametrize(
    ("key", "verdict", "values"),
    [
        ("i", HOLDS, {"displacement_max": by_law(10, 10.5, 9.5, 10, 10, 10, 99)}),
        ("ii", HOLDS, {"storey_shear_max": top_heavy("kelvin_voigt")}),
        ("iii", HOLDS, {"impact_force_max": FORCES, "impact_count": by_law(20, 18, 17, 30, 1, 1, 0)}),
        ("iv", HOLDS, {"impact_force_max": FORCES}),
        ("v", HOLDS, {"spectrum": spectra(grow=1.6)}),
        ("i", FAILS, {"displacement_max": by_law(10, 14, 6, 14, 6, 10, 10), "displacement_min": RISING}),
        ("ii", FAILS, {"storey_shear_max": top_heavy("linear", "none")}),
        ("iii", FAILS, {"impact_force_max": ANY_FORCE, "impact_count": ANY_COUNT}),
        ("iv", FAILS, {**HERTZ_HIGH, "displacement_min": TWICE}),
        ("v", FAILS, {"spectrum": spectra(grow=1.2, wide=False)}),
    ],
)
def test_a_conclusion_is_judged_by_the_cube(key, verdict, values):
    result = judged(key, **values)
    assert result.verdict is verdict, result.outcomes
    assert all(outcome.cases and outcome.numbers for outcome in result.outcomes)


def test_claims_are_judged_apart_and_floors_that_do_not_touch_are_no_cases():
    result = judged("v", spectra(grow=1.2, wide=True))
    assert [outcome.verdict for outcome in result.outcomes] == [FAILS, HOLDS]
    assert result.verdict is PARTLY
    result = judged("iv", impact_force_max=0.0)
    assert (result.outcomes[0].cases, result.outcomes[0].verdict) == (0, UNTESTED)
    assert result.verdict is HOLDS
    result = judged("iv", impact_force_max=FORCES * along("pair", 1, 0))
    assert (result.outcomes[0].true_cases, result.outcomes[0].cases) == (3, 3)


SHARES = {HOLDS: (9, 10), PARTLY: (5, 10), FAILS: (1, 10), UNTESTED: (0, 0)}


def test_table_5_has_models_without_a_first_impact():
    damped = ["hertz_damped", "nonlinear_viscoelastic"]
    assert compare.silent_models(published(5)) == {"el_centro": damped, "arleta": damped}
    touching = xr.Dataset({"impact_count": xr.ones_like(published(5).impact_count)})
    assert compare.silent_models(touching) == {}


def test_nothing_is_received_that_was_not_given():
    for given_most, received_most, wrong in (
        ((0, 0, 0), (-1, 0, 0), True),
        ((0, 1, 0), (-1, 0, 0), False),
        ((2, 0, 0), (0, -1, -1), False),
    ):
        transfers = {"energy_transfer_max": given_most, "energy_transfer_min": received_most}
        transfers = xr.Dataset({name: along("building", *values) for name, values in transfers.items()})
        assert bool(compare.unbalanced(transfers)) is wrong
    printed = compare.unbalanced(published(6))
    assert int(printed.sum()) == printed.size == 7 * 4


def test_findings_tell_the_computed_numbers():
    late = by_law(1.0, 1.0, 1.0, 1.0, 1.0, 1.25, np.nan)
    found = compare.findings(outputs(first_impact_time=late, impact_force_max=by_law(1, 1, 1, 1, 2, 3, 0)))
    assert [one["impossible"] for one in found] == [True, True, True, False]
    words = "differs by 0.2 s at most", "At most 1 kN m remain", "in 12 of 12 computed scenarios", "1.50 (as printed)"
    assert all(text in one["computed"] for text, one in zip(words, found, strict=True))


def test_energy_checks_measure_what_is_missing():
    balanced = {"energy_input": 10.0, "energy_damping": 4.0, "energy_held": 6.0}
    none = {"energy_transfer_max": 0.0, "energy_transfer_min": 0.0, "contact_work": 0.0}
    assert not compare.energy_checks(outputs(**balanced, **none)).departure.any()
    work = by_law(0.25, 0.0, 0.0, -0.5, 0.0, 0.0, 0.0)
    checks = compare.energy_checks(outputs(**balanced, **{**none, "contact_work": work, "energy_transfer_min": -0.125}))
    assert checks.departure.sel(reading="as_run").values.tolist() == [1.0, 0.25, 0.125, 0.5]
    assert checks.input.values.tolist() == [10.0, 10.0]


@given(factor=st.floats(0.1, 10.0))
@settings(max_examples=5)
def test_the_hertz_fit_is_the_ratio_to_table_5(factor):
    table = published(5).impact_force_max.sel(law=["hertz", "hertz_damped"])
    fit = force_fit((factor * table).expand_dims(stiffness=[1e4, 1e7]))
    np.testing.assert_allclose(fit.force_ratio, factor)
    np.testing.assert_allclose(fit.ratio_spread, 1.0)
    assert fit.cells.isel(stiffness=0).values.tolist() == [20, 12]
    fit = force_fit(table.sel(record=["el_centro"]) + 5.0)  # where one model has no force in the table
    assert fit.cells.values.tolist() == [4, 0]
    assert fit.force_ratio.isnull().values.tolist() == [False, True]


def opening(cube, verdict):
    """What the report opens with, if all conclusions have one verdict: items by word and reading."""
    compared = {number: side_by_side(number, cube) for number in TABLES}
    outcome = Outcome(*SHARES[verdict], "")
    judgements = [Judgement(one, key, (outcome,)) for one in compare.CONCLUSIONS for key in READINGS]
    return {
        (part.word, part.reading): "; ".join(part.items) for part in compare.verdict_of_all(compared, judgements, ["a"])
    }


def test_what_is_the_papers_own_is_reproduced():
    """One reading has the paper's numbers, the other three times those."""
    cubes = [table_as_cube(number, along("reading", 1, 3)) for number in TABLES]
    numbers = {name: cube[name] for number, cube in zip(TABLES, cubes, strict=True) for name in published(number)}
    parts = opening(outputs(**numbers), PARTLY)
    printed, run = (reading.label for reading in READINGS.values())
    assert parts["Reproduced", printed].count("Table") == 6
    assert parts["Not reproduced", printed] == "nothing"
    assert "displacements of Table 3 (18 of 18 numbers within 25%)" in parts["Reproduced", printed]
    assert parts["Reproduced in part", printed].count("conclusion ") == 5
    assert parts["Reproduced", run] == "nothing"
    assert parts["Not reproduced", run].count("(0 of ") == 6
    assert parts["Can't be", "in the paper itself"] == "a"


def test_zero_in_one_alone_is_no_agreement_and_in_both_no_case():
    printed = published(4).impact_force_max.sel(record="el_centro", program="matlab")
    for force, cases in ((0.0, int((printed > 0).sum())), (1.0, printed.size)):
        outcome = compare.table_outcome(
            side_by_side(4, outputs(impact_force_max=force)), ["impact_force_max"], "as_printed"
        )
        assert (outcome.true_cases, outcome.cases) == (0, cases)


#: Eight bytes that begin every PNG file.
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def made():
    return make_study()


@pytest.fixture
def picture(tmp_path):
    path = tmp_path / "figure_05.png"
    path.write_bytes(PNG + b"nothing more")
    return 5, "A & B", path


def test_the_page_says_what_there_is_and_loads_nothing(made, picture, tmp_path):
    contents = contents_of(made)
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


def test_every_figure_shows_its_data(made):
    assert list(PAPER_FIGURES) == list(range(4, 22))
    assert len({title for title, _ in PAPER_FIGURES.values()}) == 18
    for _, draw in PAPER_FIGURES.values():
        figure = draw(made)
        axes = figure.get_axes()
        assert all(ax.lines for ax in axes)
        labels = [ax.get_xlabel() for ax in axes] + [ax.get_ylabel() for ax in axes]
        labels += [part.get_supxlabel() + part.get_supylabel() for part in (figure, *figure.subfigs)]
        assert any("(" in label for label in labels if label)
        drawn = np.concatenate([np.asarray(line.get_xydata(), float) for ax in axes for line in ax.lines])
        assert (np.ptp(drawn[np.isfinite(drawn).all(axis=1)], axis=0) > 0.0).all()


def test_figures_are_saved_in_two_formats(made, tmp_path, monkeypatch):
    monkeypatch.setattr("pounding_sweep.paper.figures.PAPER_FIGURES", {8: PAPER_FIGURES[8]})
    ((number, _, path),) = save_figures(made, tmp_path)
    assert (number, path) == (8, tmp_path / "figure_08.png")
    assert path.read_bytes().startswith(PNG)
    assert "<svg" in path.with_suffix(".svg").read_text()


def test_figures_show_numbers_where_they_belong(made):
    storey = along("storey", 1, 2, 3)
    cube = outputs(displacement_max=1e-3 * storey, displacement_min=-2e-3 * storey, storey_shear_max=4e3 - 1e3 * storey)
    displacements, shears = (PAPER_FIGURES[number][1](made._replace(cube=cube)).axes[0].lines for number in (5, 8))
    assert [line.get_xdata().tolist() for line in displacements[:2]] == [[0, 1, 2, 3], [0, -2, -4, -6]]
    assert shears[0].get_xdata().tolist() == [3.0, 3.0, 2.0, 2.0, 1.0, 1.0]
    assert shears[0].get_ydata().tolist() == [0, 1, 1, 2, 2, 3]
    late = PAPER_FIGURES[20][1](made._replace(histories=histories(quiet_after=2.0)))
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
