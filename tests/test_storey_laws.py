"""Storey laws: what every entry of the registry holds, what of a row's kernels follows from it, pushovers."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib import import_module
from itertools import product

import numpy as np
import pytest
from against_reference import check_against_opensees, motion, random_drifts
from PIL import Image
from typer.testing import CliRunner

import pounding_sweep as ps
from pounding_sweep.base.errors import InputError, SceneError
from pounding_sweep.cli.app import app
from pounding_sweep.engine.row_kernel import Numerics, kernel_shape
from pounding_sweep.kernel.spec import from_json, history_slots, property_slots, to_json
from pounding_sweep.model.laws import LAWS
from pounding_sweep.model.storeys import STOREY_LAWS
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.run.cyclic import fema_461
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.variables.registry import reducers_for

each_law = pytest.mark.parametrize("name", STOREY_LAWS)


def by_day(*others):
    """Laws and others; at night peak-oriented storeys, of which pinching ones do all, and flight of Bouc and Wen's."""
    slow = lambda case: "peak_oriented" in case or {"bouc_wen", "exact"} <= {*case}  # noqa: E731
    return [pytest.param(*case, marks=[pytest.mark.slow] * slow(case)) for case in product(STOREY_LAWS, *others)]


#: Test module of each law, named as it: its `PARAMETERS`, and shears by a `reference` that follows drifts one by one.
MODULES = {name: import_module(f"test_{name}") for name in STOREY_LAWS}


def table(name):
    return {"law": name, **MODULES[name].PARAMETERS}


def row(name):
    return ps.Scene(
        [
            ps.Building("a", [100.0, 80.0], [1e5, 8e4], yield_strengths=[np.inf, 90.0], hysteresis=table(name)),
            ps.Building("b", [90.0], [1.2e5]),
        ],
        [0.01],
    )


@pytest.mark.parametrize(("name", "method"), by_day(["rk4", "newmark", "exact"]))
@pytest.mark.usefixtures("twin")
def test_shears_are_those_of_the_reference(name, method):
    building = ps.Building("a", [100.0], [4e4], yield_strengths=[150.0], hardening=0.1, hysteresis=table(name))
    dt = 4e-3 if method == "exact" else 2e-3
    one = ps.simulate(ps.Scene([building]), motion(21, 1.6), law="none", method=method, dt=dt, rest=0.0)
    drift, shear = one.storey_drift.values.ravel(), one.storey_shear.values.ravel()
    assert one.ductility_max.item() > 1.5
    np.testing.assert_allclose(shear, MODULES[name].reference(drift, 4e4, 150.0 / 4e4, 0.1), atol=0.5)
    work = np.sum(0.5 * (shear[1:] + shear[:-1]) * np.diff(drift))
    lost = one.hysteretic_energy.item()
    assert lost > 0.1
    assert lost + one.strain.values[-1].item() == pytest.approx(work, abs=0.01 * np.abs(shear).max() * np.ptp(drift))


@each_law
def test_a_law_is_named_in_a_table(name):
    building = row(name).buildings[0]
    assert building.elements == (building.hysteresis,)
    assert isinstance(building.hysteresis, STOREY_LAWS[name].Parameters)
    assert building.hysteresis.law == name
    again = ps.Building("a", [100.0, 80.0], [1e5, 8e4], yield_strengths=[np.inf, 90.0], hysteresis=building.hysteresis)
    assert again == building


@pytest.mark.parametrize(
    ("hysteresis", "message"),
    [
        ({"law": "bilinar"}, "unknown storey law 'bilinar'; did you mean 'bilinear'"),
        ({}, "has no law; give the name of a storey law, one of bilinear, bouc_wen, flag"),
        ("bilinear", "must be a table with a law, one of bilinear, bouc_wen, flag"),
        ({"law": "bilinear", "n": 2.0}, "unknown key 'n'"),
    ],
)
def test_what_names_no_law_is_refused(hysteresis, message):
    with pytest.raises(SceneError, match=message):
        ps.Building("a", [1.0], [1.0], yield_strengths=[1.0], hysteresis=hysteresis)


@each_law
def test_kernels_have_the_rows_and_constants_of_a_law_for_its_springs_alone(name):
    law, scene = STOREY_LAWS[name], row(name)
    shape = kernel_shape(scene, LAWS["none"], Numerics("rk4", 1e-3), reducers_for(["drift_max"]))
    assert shape.yielding == (1,)
    assert from_json(json.loads(json.dumps(to_json(shape)))) == shape
    for slots, names in ((property_slots(shape), law.constants), (history_slots(shape), law.rows)):
        assert all(slots.count[each] == 1 for each in names)
    constants = variants_of(scene).spring_constants
    assert set(constants) == {*law.constants, "stiffness_share"}
    assert all(np.isfinite(values).all() and values.shape == (1, 1) for values in constants.values())
    assert variants_of(scene).spring_numbers[0].yield_drift == pytest.approx(90.0 / 8e4)


def test_a_constant_is_not_named_as_a_property_of_kernels(monkeypatch):
    """Else one would be the other."""
    shape = kernel_shape(row("flag"), LAWS["none"], Numerics("rk4", 1e-3), reducers_for(["drift_max"]))
    monkeypatch.setattr(type(STOREY_LAWS["flag"]), "constants", ("hardening", "alpha"))
    with pytest.raises(AssertionError, match="'alpha'} of a storey law have names of the kernel's own"):
        property_slots(shape)


@each_law
def test_exact_flies_where_the_first_branch_has_the_stiffness_of_the_storey(name):
    shape = kernel_shape(row(name), LAWS["linear"], Numerics("exact", 1e-3), reducers_for(["drift_max"]))
    assert shape.flies_exactly == STOREY_LAWS[name].flies
    refused = [scheme.name for scheme in SCHEMES.values() if scheme.refuses(row(name))]
    assert refused == ([] if STOREY_LAWS[name].straight else ["central_difference"])


@pytest.mark.parametrize(("second", "way", "method"), by_day(["elements", "infill"], ["rk4", "exact"]))
@pytest.mark.usefixtures("twin")
def test_springs_of_a_storey_bear_the_sum_of_their_shears(way, second, method):
    """Each has a law, a state and a strength of its own, infill a hardening too."""
    k, strength, r = 4e4, 150.0, 0.1
    shares, laws, hardenings = [(0.7, 0.4), (0.3, 0.6)], [table("bilinear"), table(second)], [r, r]
    if way == "elements":
        elements = [
            law | {"stiffness_share": stiff, "strength_share": strong}
            for law, (stiff, strong) in zip(laws, shares, strict=True)
        ]
        building = ps.Building("a", [100.0], [k], yield_strengths=[strength], hardening=r, hysteresis=elements)
    else:
        hardenings[1] = 0.2
        (stiff, strong), (infill, its_strength) = [(k * x, strength * y) for x, y in shares]
        infill = ps.Infill(infill, its_strength, hardening=0.2, hysteresis=laws[1])
        own = {"yield_strengths": [strong], "hardening": r}
        building = ps.Building("a", [100.0], [stiff], **own, infill=infill, p_delta=True)
        softer = k - building.geometric_stiffnesses[0]
        assert building.periods[0] == pytest.approx(2.0 * np.pi * np.sqrt(100.0 / softer))
    one = ps.simulate(ps.Scene([building]), motion(21, 2.0), law="none", method=method, dt=4e-3, rest=0.0)
    drift, shear = one.storey_drift.values.ravel(), one.storey_shear.values.ravel()
    parts = [
        MODULES[law["law"]].reference(drift, stiff * k, strong * strength / (stiff * k), hardening)
        for law, (stiff, strong), hardening in zip(laws, shares, hardenings, strict=True)
    ]
    want = np.sum(parts, axis=0)
    np.testing.assert_allclose(shear, want, atol=1.0)
    assert np.abs(want - MODULES[second].reference(drift, k, strength / k, r)).max() > 5.0
    weights = shear - building.geometric_stiffnesses[0] * drift
    work = np.sum(0.5 * (weights[1:] + weights[:-1]) * np.diff(drift))
    assert one.hysteretic_energy.item() > 0.1
    assert one.hysteretic_energy.item() + one.strain.values[-1].item() == pytest.approx(
        work, abs=0.01 * np.abs(shear).max() * np.ptp(drift)
    )


def test_factors_on_a_building_are_on_its_infill_too():
    walls = {"stiffnesses": [0.0, 6e4], "yield_strengths": [0.0, 80.0], "hardening": 0.02}
    building = ps.Building("a", [100.0, 80.0], [1e5, 8e4], yield_strengths=[90.0, np.inf], infill=walls, p_delta=True)
    scene, own = ps.Scene([building]), np.array([[1.3], [1.0]])
    factors = np.array([[0.8], [1.0]]), np.array([[1.2], [1.0]]), np.full(2, np.nan), own
    rows = Variants(scene, *factors)
    assert [(spring.floor, spring.is_infill) for spring in scene.springs] == [(0, False), (1, False), (1, True)]
    made, plain = (variants_of(rows.scene_of(row)) for row in (0, 1))
    assert plain.scene == scene
    walls = made.scene.buildings[0].infill
    np.testing.assert_allclose(walls.stiffnesses, [0.0, 6e4 * 1.2 / 0.64])
    np.testing.assert_allclose(walls.yield_strengths, [0.0, 80.0 * 1.2 * 1.3])
    for name, constants in rows.spring_constants.items():
        np.testing.assert_allclose(constants[:1], made.spring_constants[name], rtol=1e-12, err_msg=name)
    for numbers, again in zip(rows.spring_numbers, made.spring_numbers, strict=True):
        np.testing.assert_allclose([x[0] for x in numbers[:3]], [x[0] for x in again[:3]], rtol=1e-12)


@pytest.mark.parametrize(
    ("walls", "message"),
    [
        ({"stiffnesses": [1.0, 1.0], "yield_strengths": 1.0}, "infill.stiffnesses: 2 values for 1 masses"),
        ({"stiffnesses": 1.0, "yield_strengths": 0.0}, "is 0 in a storey whose infill has a stiffness"),
        ({"stiffnesses": 1.0}, "yield_strengths: is missing"),
        ({"stiffnesses": 1.0, "yield_strengths": 1.0, "strength": 2.0}, "unknown key 'strength'"),
    ],
)
def test_infill_that_is_none_is_refused(walls, message):
    with pytest.raises(SceneError, match=message):
        ps.Building("a", [1.0], [1.0], infill=walls)


@pytest.mark.parametrize(
    ("shares", "message"),
    [
        ([0.5, 0.6], "the sum of stiffness_share of all elements is 1.1; it must be 1"),
        ([0.0, 1.0], "hysteresis.0.stiffness_share|stiffness_share"),
    ],
)
def test_shares_that_are_no_parts_of_a_storey_are_refused(shares, message):
    elements = [{"law": "bilinear", "stiffness_share": share, "strength_share": 0.5} for share in shares]
    with pytest.raises(SceneError, match=message):
        ps.Building("a", [1.0], [1.0], yield_strengths=[1.0], hysteresis=elements)


@each_law
def test_imposed_drifts_meet_the_shears_of_the_reference(name):
    """Wherever points lie, also beyond several branches; energies balance; several elements bear the sum."""
    k, strength, r = 4e4, 150.0, 0.1
    building = ps.Building("a", [100.0], [k], yield_strengths=[strength], hardening=r, hysteresis=table(name))
    drifts = random_drifts(3, 5.0 * strength / k, points=40, histories=3)
    test = ps.cyclic_test(building, drifts)
    want = np.array([MODULES[name].reference(column, k, strength / k, r) for column in drifts.T]).T
    np.testing.assert_allclose(test.shear, want, atol=0.5)
    cycle = 4.0 * strength / k * np.sin(np.linspace(0.0, 2.0 * np.pi, 201))
    loops = ps.cyclic_test(building, np.concatenate([cycle, cycle, cycle])).isel(point=slice(401, None))
    area = np.trapezoid(loops.shear, loops.drift)
    assert float(loops.energy[-1] - loops.energy[0]) == pytest.approx(area, rel=1e-3)
    shares = [{"stiffness_share": 0.3, "strength_share": 0.6}, {"stiffness_share": 0.7, "strength_share": 0.4}]
    laws = [table("bilinear"), table(name)]
    both = replace(building, hysteresis=[law | share for law, share in zip(laws, shares, strict=True)])
    parts = [
        replace(building, stiffnesses=[stiff * k], yield_strengths=[strong * strength], hysteresis=law)
        for law, (stiff, strong) in zip(laws, (share.values() for share in shares), strict=True)
    ]
    total = sum(ps.cyclic_test(part, drifts) for part in parts)
    for variable in ("shear", "stiffness", "energy"):
        np.testing.assert_allclose(ps.cyclic_test(both, drifts)[variable], total[variable], rtol=1e-9, atol=1e-9)


def test_imposed_drifts_on_storeys_that_lean_fall_or_stay_elastic():
    pushed = {"storey_heights": [3.0], "p_delta": True}
    building = ps.Building("a", [100.0], [4e4], yield_strengths=[150.0], **pushed)
    test = ps.cyclic_test(building, [0.001, 0.1, 3.0, 0.0])
    assert test.shear.values == pytest.approx([40.0, 150.0, np.nan, np.nan], nan_ok=True)
    assert test.stiffness.values[:2] == pytest.approx([4e4, 0.0], abs=1e-6)
    elastic = ps.Building("a", [100.0, 80.0], [4e4, 3e4], yield_strengths=[150.0, np.inf])
    assert ps.cyclic_test(elastic, [0.01, 0.02], storey=2).shear.values == pytest.approx([300.0, 600.0])


@pytest.mark.parametrize(
    ("drifts", "storey", "message"),
    [
        ([0.0], 2, "storey is 2, but building 'a' has no such storey"),
        ([np.nan], 1, "drifts must be finite numbers"),
        ("up", 1, "drifts must be finite numbers"),
    ],
)
def test_what_no_storey_can_be_tested_with_is_refused(drifts, storey, message):
    with pytest.raises(ps.PoundingSweepError, match=message):
        ps.cyclic_test(ps.Building("a", [1.0], [1.0], yield_strengths=[1.0]), drifts, storey=storey)


def test_bilinear_storeys_are_steel01_of_opensees():
    building = ps.Building("a", [100.0], [4e4], yield_strengths=[150.0], hardening=0.1)
    drifts = random_drifts(11, 0.03)
    assert check_against_opensees(building, "Steel01", (150.0, 4e4, 0.1), drifts).energy.values[-1].min() > 0.0


def test_fema_461_is_two_cycles_of_each_amplitude():
    drifts = fema_461(0.03, points=1)
    peaks = drifts[1:-1:2]
    assert np.array_equal(drifts[2:-1:2], -peaks)
    assert np.array_equal(peaks[::2], peaks[1::2])
    assert peaks[::2] == pytest.approx(0.03 / 1.4 ** np.arange(9, -1, -1))
    assert np.diff(fema_461(0.03, 0.02)).max() <= 0.0006 + 1e-12
    assert fema_461(0.03, 0.02).max() == 0.03
    with pytest.raises(InputError, match=r"from 0\.1 m to 0\.03 m"):
        fema_461(0.03, 0.1)


def test_the_command_draws_loops_of_a_storey(tmp_path):
    command = ["storey", "sweeps/yielding.toml", "soft", "--storey", "3", "-o", str(tmp_path / "loops.png")]
    assert CliRunner().invoke(app, command).exit_code == 0
    with Image.open(tmp_path / "loops.png") as picture:
        assert min(picture.size) > 300
    refused = CliRunner().invoke(app, [*command[:2], "sof", *command[3:]])
    assert refused.exit_code == 2
    assert "unknown building 'sof'; did you mean 'soft'" in refused.stderr


K, STRENGTH = 4e4, 200.0


def known(hardening, slope, residual):
    """Corners of a backbone: yield, cap at six yield drifts, residual, and an end."""
    dy, cap = STRENGTH / K, 6.0 * STRENGTH / K
    top = STRENGTH * (1.0 + 5.0 * hardening)
    corners = [(0.0, 0.0), (dy, STRENGTH), (cap, top)]
    if slope:
        least = residual * STRENGTH
        at = cap + (top - least) / (-slope * K)
        corners += [(at, least), (at + 4.0 * dy, least)] if residual else [(at, 0.0)]
    return np.transpose(corners)


def sampled(corners, points=241):
    d = np.unique(np.concatenate([np.linspace(0.0, corners[0, -1], points), corners[0]]))
    return d, np.interp(d, *corners)


FORMS = {
    "heading": (1e3, 1.0, ",", "Step,Drift (mm),Base shear (kN)"),
    "line of units": (1e2, 1e-3, "\t", "Step\tdisp\tforce\n\tcm\tMN"),
    "pairs": (1.0 / 0.0254, 1.0 / 4.4482216152605, ";", "No;top_in;V [kip]"),
}


def write(path, d, v, form="heading"):
    length, force, mark, heading = FORMS[form]
    rows = [mark.join(f"{x:.10g}" for x in row) for row in zip(range(len(d)), length * d, force * v, strict=True)]
    text = "\n".join([heading, *rows])
    path.write_text(text.replace(".", ",") if mark == ";" else text)
    return path


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    ("hardening", "slope", "residual"),
    [(0.05, -0.1, 0.3), (0.02, -0.3, 0.8), (0.1, -0.05, 0.0), (0.0, -0.1, 0.2), (0.05, 0.0, 0.0), (0.0, 0.0, 0.0)],
)
def test_a_known_backbone_is_found_again(tmp_path, capsys, hardening, slope, residual, form):
    d, v = sampled(known(hardening, slope, residual))
    fit = ps.backbone_from_pushover(write(tmp_path / "curve.csv", -d, -v, form), law="flag")
    values = fit.stiffness, fit.yield_strength, fit.hardening
    assert values == pytest.approx((K, STRENGTH, hardening), rel=1e-6, abs=1e-7)
    wanted = {"cap_drift": 6.0 * STRENGTH / K, "post_cap": slope} if slope else {}
    wanted |= {"residual": residual} if residual else {}
    assert fit.hysteresis.pop("law") == "flag"
    assert fit.hysteresis == pytest.approx(wanted, rel=1e-5)
    assert fit.error < 1e-5
    printed = capsys.readouterr().out
    assert f"hardening       {hardening:.3g}" in printed
    assert ("residual" in printed) == bool(residual)


def test_noise_moves_it_by_its_size(tmp_path):
    d, v = sampled(known(0.1, -0.1, 0.3))
    noisy = v + 0.003 * STRENGTH * np.random.default_rng(3).standard_normal(len(v)) * (d > 0.0)
    fit = ps.backbone_from_pushover(write(tmp_path / "curve.csv", d, noisy))
    values = fit.stiffness, fit.yield_strength, fit.hardening, *list(fit.hysteresis.values())[1:]
    assert values == pytest.approx((K, STRENGTH, 0.1, 0.03, -0.1, 0.3), rel=0.05)
    assert 0.002 < fit.error < 0.02


def test_a_smooth_curve_meets_the_conditions_of_the_rule(tmp_path):
    """The secant at 0.6 Vy, equal areas to the cap, the post-cap line through 0.6 Vy, the residual of its end."""
    d = np.linspace(0.0, 0.15, 1501)
    v = 300.0 * np.tanh(d / 0.008) * (0.2 + 0.8 / (1.0 + (d / 0.09) ** 6))
    fit = ps.backbone_from_pushover(write(tmp_path / "curve.csv", d, v))
    x, y = fit.curve.corner_drift.values, fit.curve.corner_shear.values
    assert (len(x), fit.hysteresis["cap_drift"], x[2], y[2]) == (
        5,
        x[2],
        pytest.approx(d[v.argmax()]),
        pytest.approx(v.max()),
    )
    assert np.interp(0.6 * fit.yield_strength / fit.stiffness, d, v) == pytest.approx(0.6 * fit.yield_strength)
    part = d < x[2] + 1e-9
    assert np.trapezoid(y[:3], x[:3]) == pytest.approx(np.trapezoid(v[part], d[part]), rel=1e-7)
    assert v[-1] < fit.hysteresis["residual"] * fit.yield_strength < 1.1 * v[-1]
    falls = np.interp(-0.6 * fit.yield_strength, -v[v.argmax() :], d[v.argmax() :])
    slope = (0.6 * fit.yield_strength - y[2]) / (falls - x[2]) / fit.stiffness
    assert fit.hysteresis["post_cap"] == pytest.approx(slope)
    assert fit.error < 0.12
    short = ps.backbone_from_pushover(tmp_path / "curve.csv", target_drift=0.02)
    assert short.curve.corner_drift.values[2] == 0.02


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("a,b\n0,0\n1,2\n2,3", {}, "no column of drift whose unit is known, its headings being a, b"),
        ("a,b\n0,0\n1,2\n2,3", {"units": ("mm", "t")}, "no column of shear whose unit is known.*valid for shear: kn"),
        ("d (mm),V (kN)\n0,0\n1,2\n2,3", {"shear": "moment"}, "no column of shear"),
        ("d (mm),V (kN)\n0,0\n1,0\n2,0", {}, "shears do not rise with the drift"),
        ("d (mm),V (kN)\n0,0\n1,2\n2,3", {"target_drift": 1e-4}, "it must be beyond the first drift, 0.001 m"),
        ("", {}, "no column of drift"),
    ],
)
def test_curves_that_cannot_be_read_are_refused(tmp_path, text, options, message):
    file = tmp_path / "curve.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        ps.backbone_from_pushover(file, **options)
    with pytest.raises(InputError, match="could not be read"):
        ps.backbone_from_pushover(tmp_path / "none.csv")
