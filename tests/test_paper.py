"""The paper's tables, readings and conclusions: hand-made cubes whose answer is known both ways."""

from __future__ import annotations

import csv
import tomllib
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from paper_study import LAWS, by_law, outputs, run_cube, spectra, steps

import pounding_sweep as ps
from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.base.errors import InputError
from pounding_sweep.model.presets import PRESETS
from pounding_sweep.paper.compare import (
    CONCLUSIONS,
    Judgement,
    Support,
    Verdict,
    agreement,
    energy_checks,
    findings,
    judge,
    opening_grid,
    overall,
    side_by_side,
    silent_models,
    spread,
    table_grid,
    table_outcome,
    unbalanced,
    verdict_of_all,
)
from pounding_sweep.paper.published import (
    GROUND_MOTIONS,
    READINGS,
    RECORDS,
    RESCALED,
    TABLES,
    paper_records,
    published,
    reading_of,
    sweep_of,
)
from pounding_sweep.paper.study import force_fit, largest_steps, step_grid, study

SWEEPS = Path(__file__).resolve().parent.parent / "sweeps"


# --- what the paper prints ---------------------------------------------------------------------------------------


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
    three, four, five, six = (published(number) for number in TABLES)
    at = {"record": "santa_monica", "building": "right", "storey": 3, "program": "sap2000"}
    assert (three.displacement_max.sel(at).item(), three.displacement_min.sel(at).item()) == (0.040, -0.027)
    at = {"record": "arleta", "pair": "middle-right", "storey": 2, "program": "matlab"}
    assert (four.impact_force_max.sel(at).item(), four.impact_count.sel(at).item()) == (710.0, 5.0)
    at = {"law": "nonlinear_viscoelastic", "record": "san_fernando", "pair": "middle-right", "storey": 3}
    assert (five.impact_force_max.sel(at).item(), five.impact_count.sel(at).item()) == (471.0, 24.0)
    at = {"law": "none", "record": "santa_monica", "building": "right"}
    assert (six.energy_transfer_max.sel(at).item(), six.energy_transfer_min.sel(at).item()) == (14.6, -56.2)


def test_model_one_is_the_same_in_tables_4_and_5():
    matlab, one = published(4).sel(program="matlab", drop=True), published(5).sel(law="linear", drop=True)
    xr.testing.assert_equal(matlab, one.transpose(*matlab.impact_force_max.dims))


def test_a_table_without_results_is_refused():
    with pytest.raises(InputError, match="unknown table of results 2; valid: 3, 4, 5, 6"):
        published(2)


# --- readings and their sweeps -----------------------------------------------------------------------------------


@pytest.mark.parametrize("reading", READINGS.values(), ids=list(READINGS))
def test_the_sweep_file_is_the_sweep_of_the_reading(reading, monkeypatch):
    monkeypatch.delenv("POUNDING_SWEEP_RECORDS", raising=False)
    records, missing = paper_records()
    assert [record.name for record in records] == ["el_centro"]
    assert list(missing) == list(RECORDS[1:])
    assert all("https://ngawest2.berkeley.edu" in text for text in missing.values())
    with pytest.warns(UserWarning, match="is left out: record"):
        spec = ps.load_sweep(SWEEPS / f"{reading.preset}.toml", skip_missing_records=True).spec
    assert spec.records_left_out == RECORDS[1:]
    assert replace(spec, records_left_out=()) == sweep_of(reading, records).spec


@pytest.mark.parametrize("reading", READINGS.values(), ids=list(READINGS))
def test_the_sweep_file_asks_for_the_papers_peak(reading):
    """To the last digit: cubes are known to be run with the record by its hash."""
    asked = tomllib.loads((SWEEPS / f"{reading.preset}.toml").read_text())["sweep"]["records"]
    named = {one["record"]: one["pga"] for one in asked if isinstance(one, dict)}
    assert named == {name: GROUND_MOTIONS[name][0] * STANDARD_GRAVITY for name in RESCALED}


def test_with_all_records_the_sweep_files_are_those_of_the_readings():
    records, missing = paper_records()
    if missing:
        pytest.skip(f"needs the records {', '.join(missing)} in POUNDING_SWEEP_RECORDS")
    for reading in READINGS.values():
        assert ps.load_sweep(SWEEPS / f"{reading.preset}.toml").spec == sweep_of(reading, records).spec
    assert records[-1].pga == pytest.approx(1.16 * 9.81, rel=1e-12)


def test_the_row_as_run_differs_in_three_values():
    printed, run = (PRESETS[reading.preset].scene for reading in READINGS.values())
    assert run.buildings[:2] == printed.buildings[:2]
    assert run.buildings[2].masses == printed.buildings[2].masses
    assert run.buildings[2].stiffnesses == pytest.approx([2 * 333.472e3] * 3)
    assert (run.gaps, run.contact.restitution) == (printed.gaps, printed.contact.restitution)
    assert run.contact.linear_stiffness == printed.contact.linear_stiffness / 10


def test_the_hertz_stiffness_as_run_follows_from_the_printed_equations():
    """Eqs 9 to 11 with their square root and 1 - nu, and E = 5000 sqrt(25) of IS 456 without its unit."""
    r1, r2 = ((3.0 * m / (4.0 * np.pi * 2.5)) ** 0.5 for m in (133.956, 136.286))
    h = (1.0 - 0.2) / (np.pi * 5000.0 * 25.0**0.5)
    k = 4.0 / (3.0 * np.pi * 2.0 * h) * (r1 * r2 / (r1 + r2)) ** 0.5
    assert ps.get_preset("mate2015_as_run").contact.hertz_stiffness == pytest.approx(k, rel=2e-3)


@pytest.mark.parametrize("key", READINGS)
def test_a_cube_tells_its_reading(key):
    assert reading_of(run_cube(key)).key == key


#: What is done to cubes, and what is said of them.
REFUSED = [
    (lambda c: [c.assign_attrs(sweep='{"scene": {"row": []}}')], "cube 1 was run for another row of .*mate2015_as_run"),
    (lambda c: [c.drop_vars("contact_work")], "cube 1 lacks contact_work"),
    (lambda c: [c.drop_attrs(deep=False)], "cube 1 was run for another row"),
    (lambda c: [c.drop_sel(law="hertz")], "lacks law hertz; make it with"),
    (lambda c: [c.assign_coords(gap=[0.02])], "lacks gap 0.01"),
    (
        lambda c: [c.assign_attrs(records="[]")],
        "no record of the cubes can be used: .*record 'el_centro' at hand is not",
    ),
    (
        lambda c: [c.assign_attrs(records='[{"name": "el_centro", "sha256": "0"}]')],
        "record 'el_centro' at hand is not a motion that the cubes were run with",
    ),
]


@pytest.mark.parametrize(("cubes", "said"), REFUSED)
def test_a_cube_that_lacks_something_is_refused_with_the_remedy(cubes, said):
    with pytest.raises(InputError, match=said):
        study(cubes(run_cube()), folders=[])


# --- side by side ------------------------------------------------------------------------------------------------


def numbers_of(number):
    """A table's own numbers under El Centro, those of the paper's MATLAB program."""
    table = published(number).sel(record=["el_centro"])
    table = table.sel(program="matlab", drop=True) if "program" in table.dims else table
    return dict((table.reindex(law=LAWS, fill_value=0.0) if "law" in table.dims else table).data_vars)


def table_as_cube(number, factor):
    """A cube that holds a table's own numbers times a factor, in both readings."""
    return outputs(**{name: factor * values for name, values in numbers_of(number).items()})


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
        assert difference.attrs["units"] == "1"
        assert compared[name].attrs["units"] == published(number)[name].attrs["units"]


def test_a_table_is_written_with_the_paper_beside_the_readings():
    grid = table_grid(side_by_side(5, table_as_cube(5, 1.1)))
    assert len(grid.rows) == 6 * 1 * 2 * 3
    assert all(len(row) == len(grid.headings) for row in grid.rows)
    row = next(row for row in grid.rows if row[:4] == ["I", "El Centro", "left-middle", "3"])
    assert row[4:9] == ["1184", "1302", "+10%", "1302", "+10%"]


def test_agreement_counts_cells():
    def rows(cube):
        grid = agreement(side_by_side(5, cube))
        return [row[2:] for row in grid.rows if row[:2] == ["peak force", "as printed"]]

    touching = int((published(5).impact_force_max.sel(record="el_centro") > 0).sum())
    cells = ["36", "20%", f"0 of {touching}", f"{touching} of {touching}", "0"]
    assert rows(table_as_cube(5, 1.2)) == [["all", *cells], ["El Centro", *cells]]
    assert [row[-1] for row in rows(outputs())] == [str(36 - touching)] * 2


# --- conclusions -------------------------------------------------------------------------------------------------

FLOORS = 2 * 3
SHEAR = xr.DataArray([3.0, 2.0, 1.0], dims="storey", coords={"storey": [1, 2, 3]})
#: Peak forces (kN) by model that bear the paper out in every respect.
FORCES = by_law(100, 95, 90, 50, 20, 10, 0)


def verdict_of(key, cube, spectrum=None):
    with pytest.MonkeyPatch.context() as patch:  # of the others other tests tell
        patch.setattr("pounding_sweep.paper.compare.CONCLUSIONS", {key: CONCLUSIONS[key]})
        own = {one.reading: one for one in judge(cube, spectra() if spectrum is None else spectrum)}
    assert list(own) == list(READINGS)
    return own["as_printed"]


def top_heavy(*laws):
    """Shears that fall with height, but for the right building's top under some laws."""
    heavy = xr.DataArray([law in laws for law in LAWS], dims="law", coords={"law": LAWS})
    place = xr.DataArray([False, False, True], dims="building", coords={"building": ["left", "middle", "right"]})
    return xr.where(heavy & place & (SHEAR.storey == 3), 2.5, SHEAR)


#: Cubes and spectra that bear a conclusion out, and that contradict it.
AGREES = {
    "i": (outputs(displacement_max=by_law(10, 10.5, 9.5, 10, 10, 10, 99)), spectra()),
    "ii": (outputs(storey_shear_max=top_heavy("kelvin_voigt")), spectra()),
    "iii": (outputs(impact_force_max=FORCES, impact_count=by_law(20, 18, 17, 30, 1, 1, 0)), spectra()),
    "iv": (outputs(impact_force_max=FORCES), spectra()),
    "v": (outputs(), spectra(grow=1.6)),
}
RISING, TWICE = by_law(1, 2, 3, 4, 5, 6, 7), by_law(1, 1, 1, 2, 2, 2, 1)
ANY_FORCE, ANY_COUNT = by_law(100, 70, 90, 50, 60, 10, 0), by_law(20, 10, 20, 1, 1, 1, 0)
HERTZ_HIGH = by_law(100, 95, 90, 99, 20, 10, 0)
DISAGREES = {
    "i": (outputs(displacement_max=by_law(10, 14, 6, 14, 6, 10, 10), displacement_min=RISING), None),
    "ii": (outputs(storey_shear_max=top_heavy("linear", "none")), None),
    "iii": (outputs(impact_force_max=ANY_FORCE, impact_count=ANY_COUNT), None),
    "iv": (outputs(impact_force_max=HERTZ_HIGH, displacement_max=TWICE, displacement_min=TWICE), None),
    "v": (outputs(), spectra(grow=1.2, wide=False)),
}


@pytest.mark.parametrize("key", CONCLUSIONS)
def test_a_conclusion_holds_where_the_cube_bears_it_out(key):
    found = verdict_of(key, *AGREES[key])
    assert found.verdict is Verdict.HOLDS, found.outcomes
    assert all(outcome.cases and outcome.numbers for outcome in found.outcomes)


@pytest.mark.parametrize("key", CONCLUSIONS)
def test_a_conclusion_fails_where_the_cube_contradicts_it(key):
    found = verdict_of(key, *DISAGREES[key])
    assert found.verdict is Verdict.FAILS, found.outcomes


def test_one_claim_of_two_holds_partly():
    found = verdict_of("v", outputs(), spectra(grow=1.2, wide=True))
    assert [outcome.verdict for outcome in found.outcomes] == [Verdict.FAILS, Verdict.HOLDS]
    assert found.verdict is Verdict.PARTLY


def test_floors_that_do_not_touch_are_no_cases():
    found = verdict_of("iv", outputs(impact_force_max=0.0))
    assert (found.outcomes[0].cases, found.outcomes[0].verdict) == (0, Verdict.UNTESTED)
    assert found.verdict is Verdict.HOLDS
    pair = xr.DataArray([1.0, 0.0], dims="pair", coords={"pair": ["left-middle", "middle-right"]})
    found = verdict_of("iv", outputs(impact_force_max=FORCES * pair))
    assert (found.outcomes[0].held, found.outcomes[0].cases) == (FLOORS // 2, FLOORS // 2)


HOLDS, PARTLY, FAILS, UNTESTED = Verdict


@pytest.mark.parametrize(
    ("held", "cases", "verdict"),
    [(0, 0, UNTESTED), (9, 10, HOLDS), (89, 100, PARTLY), (5, 10, PARTLY), (49, 100, FAILS), (0, 1, FAILS)],
)
def test_a_claims_verdict_follows_its_share(held, cases, verdict):
    assert Support(held, cases, "").verdict is verdict


@pytest.mark.parametrize(
    ("claims", "verdict"),
    [
        ([UNTESTED, UNTESTED], UNTESTED),
        ([HOLDS, UNTESTED, HOLDS], HOLDS),
        ([FAILS, FAILS, UNTESTED], FAILS),
        ([HOLDS, FAILS], PARTLY),
        ([PARTLY, HOLDS], PARTLY),
        ([PARTLY, FAILS], PARTLY),
    ],
)
def test_a_conclusion_holds_if_all_its_claims_do(claims, verdict):
    assert overall(claims) is verdict


def test_the_spread_of_a_bell_is_its_width():
    """exp(-x^2 / 2 s^2) in the logarithm x of the period is above a half over 2 s sqrt(2 ln 2)."""
    period = np.geomspace(0.02, 3.0, 2000)
    bell = np.exp(-0.5 * (np.log(period / 0.3) / 0.2) ** 2)
    values = xr.DataArray(7.0 * bell, dims="period", coords={"period": period})
    assert float(spread(values)) == pytest.approx(0.4 * np.sqrt(2.0 * np.log(2.0)), rel=0.01)
    assert float(spread(xr.ones_like(values))) == pytest.approx(np.log(3.0 / 0.02), rel=0.01)


# --- what can't be, and what must be -----------------------------------------------------------------------------


def test_table_5_has_models_without_a_first_impact():
    damped = ["hertz_damped", "nonlinear_viscoelastic"]
    assert silent_models(published(5)) == {"el_centro": damped, "arleta": damped}
    touching = xr.Dataset({"impact_count": xr.ones_like(published(5).impact_count)})
    assert silent_models(touching) == {}


@pytest.mark.parametrize(
    ("given_most", "received_most", "wrong"),
    [((0, 0, 0), (-1, 0, 0), True), ((0, 1, 0), (-1, 0, 0), False), ((2, 0, 0), (0, -1, -1), False)],
)
def test_nothing_is_received_that_was_not_given(given_most, received_most, wrong):
    building = {"dims": "building", "coords": {"building": list("abc")}}
    given_most, received_most = (xr.DataArray(np.array(v, float), **building) for v in (given_most, received_most))
    assert bool(unbalanced(given_most, received_most)) is wrong


def test_table_6_is_unbalanced_in_every_row():
    six = published(6)
    wrong = unbalanced(six.energy_transfer_max, six.energy_transfer_min)
    assert int(wrong.sum()) == wrong.size == 7 * 4


def test_findings_tell_the_computed_numbers():
    late = by_law(1.0, 1.0, 1.0, 1.0, 1.0, 1.25, np.nan)
    force = by_law(1, 1, 1, 1, 2, 3, 0)
    texts = [f.computed for f in findings(outputs(first_impact_time=late, impact_force_max=force))]
    assert "differs by 0.2 s at most" in texts[0]
    assert "At most 2 kN m remain" in texts[1]
    assert "in 12 of 12 computed scenarios" in texts[2]
    assert "1.50 (as printed)" in texts[3]


def test_energy_checks_measure_what_is_missing():
    balanced = {"energy_input": 10.0, "energy_damping": 4.0, "energy_kinetic": 3.0, "energy_strain": 3.0}
    none = {"energy_transfer_max": 0.0, "energy_transfer_min": 0.0, "contact_work": 0.0}
    assert [check.value for check in energy_checks(outputs(**balanced, **none))] == [0.0] * 8
    work = by_law(0.25, 0.0, 0.0, -0.5, 0.0, 0.0, 0.0)
    found = energy_checks(outputs(**balanced, **{**none, "contact_work": work, "energy_transfer_min": -0.125}))[:4]
    assert [check.value for check in found] == [1.0, 0.25, 0.125, 0.5]
    assert found[0].scale == 10.0


@given(factor=st.floats(0.1, 10.0))
@settings(max_examples=5)
def test_the_hertz_fit_is_the_ratio_to_table_5(factor):
    table = published(5).impact_force_max.sel(law=["hertz", "hertz_damped"])
    found = force_fit((factor * table).expand_dims(stiffness=[1e4, 1e7]))
    np.testing.assert_allclose(found.force_ratio, factor)
    np.testing.assert_allclose(found.ratio_spread, 1.0)
    assert found.cells.isel(stiffness=0).values.tolist() == [20, 12]


def test_a_model_without_a_force_in_table_5_has_no_fit():
    table = published(5).impact_force_max.sel(law=["hertz", "hertz_damped"], record=["el_centro"])
    found = force_fit(table + 5.0)
    assert found.cells.values.tolist() == [4, 0]
    assert found.force_ratio.isnull().values.tolist() == [False, True]


# --- the time step -----------------------------------------------------------------------------------------------


def test_the_table_of_steps_has_a_row_for_every_way():
    grid = step_grid(steps(), READINGS["as_run"])
    rows = grid.rows
    assert len(rows) == 2 * 2 * 2
    assert all(len(row) == len(grid.headings) for row in rows)
    assert rows[0][:3] == ["rk4", "no", "20"]
    assert set(rows[0][3:7]) == {"-"}
    assert rows[1][3:] == ["1.0e-06"] * 4 + ["ok"]


def test_the_largest_step_is_the_last_before_an_error():
    made = steps(step=[1e-2, 5e-3, 2e-3, 1e-3])
    error = xr.zeros_like(made.error)
    error.loc[{"output": "impact_force_max", "step": 1e-2}] = 0.011
    error.loc[{"output": "impact_count", "scheme": "newmark", "step": 2e-3}] = 0.1
    error.loc[{"output": "displacement_min", "reading": "as_run", "step": 1e-3}] = 0.5
    found = largest_steps(made.assign(error=error))
    assert found.sel(reading="as_printed", scheme="rk4").values.tolist() == [5e-3, 5e-3]
    assert found.sel(reading="as_printed", scheme="newmark").values.tolist() == [1e-3, 1e-3]
    assert found.sel(reading="as_run").isnull().all()
    assert found.attrs["units"] == "s"


# --- the verdict ---------------------------------------------------------------------------------------------------


def _judged(cube, verdict):
    compared = {number: side_by_side(number, cube) for number in TABLES}
    outcome = Support(*{Verdict.HOLDS: (9, 10), Verdict.PARTLY: (5, 10), Verdict.FAILS: (1, 10)}[verdict], "")
    judgements = [Judgement(one, key, (outcome,)) for one in CONCLUSIONS.values() for key in READINGS]
    return {(part.word, part.reading): "; ".join(part.items) for part in verdict_of_all(compared, judgements, [])}


def test_what_is_the_papers_own_is_reproduced():
    """One reading has the paper's numbers, the other three times those."""
    numbers = {name: values for number in TABLES for name, values in numbers_of(number).items()}
    factor = xr.DataArray([1.0, 3.0], dims="reading", coords={"reading": list(READINGS)})
    cube = outputs(**{name: values * factor for name, values in numbers.items()})
    # Table 4 is Model I of Table 5
    said = _judged(cube, Verdict.PARTLY)
    labels = [reading.label for reading in READINGS.values()]
    assert said["Reproduced", labels[0]].count("Table") == 6
    assert said["Not reproduced", labels[0]] == "nothing"
    assert "displacements of Table 3 (18 of 18 numbers within 25%)" in said["Reproduced", labels[0]]
    assert said["Reproduced in part", labels[0]] == "; ".join(
        f"conclusion {one.key}: {one.text}" for one in CONCLUSIONS.values()
    )
    assert said["Reproduced", labels[1]] == "nothing"
    assert said["Not reproduced", labels[1]].count("(0 of ") == 6


@pytest.mark.parametrize(
    ("shares", "word"),
    [pytest.param(0, "Not reproduced", marks=pytest.mark.slow), (9, "Reproduced in part"), (17, "Reproduced")],
)
def test_a_table_is_reproduced_by_its_share_of_cells(shares, word):
    three = published(3).sel(record=["el_centro"], program="matlab", drop=True)
    off = xr.where(xr.DataArray(np.arange(9).reshape(3, 3), dims=("building", "storey")) < shares / 2, 1.2, 1.3)
    cube = outputs(displacement_max=three.displacement_max * off, displacement_min=three.displacement_min * off)
    said = _judged(cube, Verdict.HOLDS)
    assert "displacements of Table 3" in said[word, "as printed"]
    assert "conclusion ii" in said["Reproduced", "as printed"]


def test_zero_in_one_alone_is_no_agreement_and_in_both_no_case():
    compared = side_by_side(4, outputs(impact_force_max=0.0))
    printed = published(4).impact_force_max.sel(record="el_centro", program="matlab")
    found = table_outcome(compared, ["impact_force_max"], "as_printed")
    assert (found.held, found.cases) == (0, int((printed > 0).sum()))
    touching = side_by_side(4, outputs(impact_force_max=1.0))
    assert table_outcome(touching, ["impact_force_max"], "as_printed").cases == printed.size


def test_the_verdict_says_what_cannot_be():
    cube = outputs()
    *parts, last = verdict_of_all({n: side_by_side(n, cube) for n in TABLES}, [], ["one", "two"])
    assert last.word == "Can't be"
    assert [row[2] for row in opening_grid([*parts, last]).rows[-2:]] == ["one", "two"]
    assert [one.impossible for one in findings(cube)] == [True, True, True, False]
