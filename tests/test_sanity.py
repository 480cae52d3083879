"""Warnings of what no real building has: each names the value, its place and the slip of units that is likely."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import call

import pounding_sweep as ps
from pounding_sweep.base.errors import SceneError, SweepError, UnlikelyWarning
from pounding_sweep.model.building import Building
from pounding_sweep.model.scene import Bumper, ContactProperties, Scene, Wall
from pounding_sweep.model.variants import variants_of
from pounding_sweep.plan.sanity import doubts, doubts_of, record_doubts
from pounding_sweep.request.axes import Case
from pounding_sweep.request.spec import scene_variants

ROOT = Path(__file__).parents[1]
STEEL = Building("steel", [170.0] * 3, [5.5e5] * 3)


def row(masses=(100.0,), stiffnesses=(1e5,), contact=(2e6, 1.9e7, 0.6), **more):
    return Scene(
        [STEEL, Building("b", masses, stiffnesses, **more)], [0.01], ContactProperties(*contact), allow_unmet=True
    )


def told(scene=None, laws=("linear", "hertz"), **axes):
    return doubts(ps.Sweep(scene or row(), "el_centro", laws, **axes).spec)


@pytest.mark.parametrize(
    ("scene", "axes", "said"),
    [
        ({}, {"gaps": [0.01, 5.0, 20.0]}, "gap 5 m, 20 m: real ones lie up to 1 m; likely mm given for m (0.02 m)"),
        ({"masses": [1.7e5]}, {}, "floor mass 1.7e+05 t (b, floor 1): .* likely kg given for t (170 t)"),
        ({"stiffnesses": [2e8]}, {}, "storey stiffness 2e+08 kN/m (b, storey 1): .* N/m given for kN/m (2e+05 kN/m)"),
        ({"stiffnesses": [1e8]}, {}, "first period 0.006283 s (b): .* stiffnesses in N/m for kN/m (0.1987 s)"),
        ({"stiffnesses": [20]}, {}, "first period 14.05 s (b): .* stiffnesses in MN/m for kN/m (0.4443 s)"),
        ({"storey_heights": [3000]}, {}, "storey height 3000 m (b, storey 1): .* likely mm given for m (3 m)"),
        ({"damping_ratio": 0.5}, {}, "damping ratio 0.5 (b): real ones lie up to 0.3; likely per cent given"),
        ({}, {"pgas": [3.0, 400.0]}, "peak ground acceleration 400 m/s2 (el_centro .* likely cm/s2 (gal)"),
        ({}, {"pgas": [0.1, 0.5]}, "strongest motion 0.5 m/s2 .* likely g given for m/s2 (4.905 m/s2)"),
        ({}, {"scales": [-1.0, 1.0]}, "record scale -1 (el_centro) is negative: it turns the ground motion round"),
        *(
            ({}, {"scales": [0.5, s]}, f"record scale {s:g} (el_centro) converts units")
            for s in (9.81, 386.4, -9.80665)
        ),
        (
            {},
            {"pgas": [19.7]},
            "peak ground acceleration 19.7 m/s2 .* the strongest recorded ones lie up to 19.62 m/s2",
        ),
        ({}, {"scales": [0.0, 1.0]}, "record scale 0 (el_centro) leaves the ground standing still"),
        ({}, {"stiffness_factors": [1.0, 1000.0]}, "contact stiffness 2e+09 kN/m: .* N/m given for kN/m (2e+06 kN/m)"),
        ({"contact": (2e6, 1.9e10, 0.6)}, {}, "contact stiffness of Hertz 1.9e+10 kN/m^1.5: .* (1.9e+07 kN/m^1.5)"),
        ({}, {"period_factors": {"b": [1.0, 100.0]}}, "first period 19.87 s (b)"),
        ({}, {"scales": [0, 5, 1, 6]}, "scales [0.0, 5.0, 1.0, 6.0]: decimals have a point: give [0.5, 1.6]"),
        ({"stiffnesses": [0.4]}, {}, "storey stiffness 0.4 kN/m (b, .* or a period in s given for a stiffness"),
        (
            {"yield_strengths": [3e5]},
            {"strength_factors": {"b": [1e-3]}},
            "yield strength over the weight carried 305.8 (b, storey 1): real ones lie up to 3; likely N given for kN",
        ),
        (
            {"contact": (2e3, 1.9e7, 0.6)},
            {},
            "softest storey struck 0.02 (steel-b): .* likely MN/m given for kN/m (20)",
        ),
        ({}, {"mass_factors": {"b": [1.0, 500.0]}}, "floor mass 5e+04 t (b, floor 1)"),
        ({}, {"damping_ratios": [0.05, 0.9]}, "damping ratio 0.9 (steel)"),
    ],
)
def test_a_slip_of_units_is_named(scene, axes, said):
    parts = said.split(" .* ")
    found = [text for text in told(row(**scene), **axes) if all(part in text for part in parts)]
    assert len(found) == 1


def test_a_sweep_without_a_slip_is_not_doubted():
    factors = {"period_factors": {"b": [0.5, 3.0]}, "mass_factors": {"b": [0.5, 2.0]}}
    assert told() == told(**factors, gaps=[0.0, 1.0], pgas=[0.5, 19.6]) == []


@pytest.mark.parametrize("axes", [{}, {"gaps": [0.01, 0.02]}, {"cases": [Case("linear", gap=(0.01,))]}])
def test_gaps_of_the_row_are_doubted_where_others_replace_them(axes):
    laws = () if "cases" in axes else ("linear",)
    (text,) = told(row().with_gaps([10.0]), laws or None, **axes)
    assert text.startswith("gap 10 m (the row's own): real ones lie up to 1 m; likely mm given for m (0.01 m)")


def test_listed_cases_are_doubted_too():
    cases = [
        Case("linear", gap=(30.0,)),
        Case("linear", scale=40.0),
        Case("hertz", stiffness=1e11, mass_factors={"b": 1e3}),
    ]
    found = doubts(ps.Sweep(row(), "el_centro", cases=cases).spec)
    assert [text.split(" ")[0] for text in found] == ["gap", "floor", "peak", "contact"]
    assert "gap 30 m" in found[0]


def motion(tmp_path, values, header="time (s),acc (g)", **how):
    """Read a record from a file of values at 0.01 s."""
    path = tmp_path / "motion.csv"
    path.write_text(f"{header}\n" + "".join(f"{i * 0.01:.2f},{v}\n" for i, v in enumerate(values)))
    return ps.read_record(path, **how)


SINE = np.round(0.3 * np.sin(np.arange(400) * np.pi / 40), 6)  # five cycles


@pytest.mark.parametrize(
    ("values", "how", "said"),
    [
        (SINE + 0.05, {}, "has a mean of 14% of its PGA: an offset; take it out"),
        (np.tile(SINE, 3)[:841], {}, "ends at 100% of its PGV: a drift, or cut off; correct its baseline"),
        (np.append(SINE, [-9999.0, 0.0]), {}, "has values of -9999 g, which mark what is missing; cut or mend them"),
        *(
            (SINE, {"scale": s}, f"has scale {s:g}, a factor between units")
            for s in (9.81, 9.80665, 981, 386.4, 0.0102)
        ),
    ],
)
def test_doubts_about_a_record_that_was_read(tmp_path, values, how, said):
    record = motion(tmp_path, values, **how)
    found = record_doubts(record)
    assert f"record 'motion' {said}" in " ".join(found)
    spec = ps.Sweep(row(), record, "linear").spec
    assert [text for text in doubts(spec) if "record 'motion'" in text] == found


def test_records_that_are_not_doubted(tmp_path):
    assert record_doubts(motion(tmp_path, SINE)) == record_doubts(motion(tmp_path, SINE, scale=2.0)) == []
    assert record_doubts(ps.pulse_record("half_sine", amplitude=3.0, period=1.0, dt=0.01)) == []


def test_masses_that_look_like_weights():
    plain, weights = [170.0] * 3, [170.0 * 9.81] * 3
    text = "floor masses of b of about 1668 t with a first period of 0.26 s a storey: are they weights in kN?"
    assert any(text in each for each in told(row(masses=weights, stiffnesses=[5.5e5] * 3)))
    for masses, stiffnesses in ((plain, [5.5e5] * 3), (weights, [5.5e6] * 3), (plain, [5.5e4] * 3), ([2000.0], [5e4])):
        assert not any("weights" in each for each in told(row(masses=masses, stiffnesses=stiffnesses)))


SWEEPS = [
    pytest.param(path, marks=pytest.mark.slow) if path.stem == "constant_ductility" else path  # finds strengths first
    for folder in ("sweeps", "docs/gallery_sweeps")
    for path in sorted((ROOT / folder).glob("*.toml"))
]


@pytest.mark.parametrize("path", SWEEPS, ids=lambda path: path.stem)
def test_no_ready_sweep_is_doubted(path):
    try:
        spec = ps.load_sweep(path).spec
    except SweepError as error:
        if "record" not in str(error):
            raise
        pytest.skip("a record is not at hand")
    assert doubts(spec) == []


def test_drifts_are_doubted_once_they_are_known():
    variants = variants_of(row(masses=[100.0, 100.0], stiffnesses=[1e5, 1e5], storey_heights=[4.0, 3.0]))
    drift = np.array([[0.1, 0.1, 0.29], [0.39, 0.31, np.nan]])
    (text,) = doubts_of(variants, {"drift_max": drift})
    assert "over the storey's height 0.1033 (b, storey 2): real ones lie up to 0.1; a linear spring knows" in text
    assert [*doubts_of(variants, {"drift_max": 0.5 * drift})] == []


def test_drifts_of_isolators_are_not_doubted():
    """Linear ones and such that yield; a soft storey that yields, and a storey above isolators, are."""
    frame = ps.Building("a", [150.0] * 3, [3e5] * 3, 0.02)
    drift = np.array([[0.4, 0.001, 0.001, 0.001]])
    for building in (ps.base_isolated(frame, 150.0, 2.5, 0.05, strength=s) for s in (0.0, 250.0)):
        variants = variants_of(ps.Scene([building]))
        assert [*doubts_of(variants, {"drift_max": drift})] == []
        (text,) = doubts_of(variants, {"drift_max": drift[:, ::-1]})
        assert "(a, storey 4)" in text
    soft = ps.Building("a", [150.0] * 2, [1e5, 3e5], yield_strengths=[500.0, 1e4], hardening=0.02)
    (text,) = doubts_of(variants_of(ps.Scene([soft])), {"drift_max": drift[:, :2]})
    assert "(a, storey 1)" in text


def test_a_row_that_may_yield_and_does_not_is_doubted():
    scene, drift = row(stiffnesses=[1e5], yield_strengths=[300.0]), np.array([[0.1] * 3, [2.9e-5] * 3])  # 3 mm at yield
    (text,) = doubts_of(variants_of(scene), {"drift_max": drift})
    assert text.startswith("no storey reaches 1% of its yield drift: the largest share is 0.0097 (b, storey 1)")
    weak = scene_variants(scene, 1, [("strength_factor", "b", np.array([0.5]))])
    assert [*doubts_of(weak, {"drift_max": drift})] == [*doubts_of(variants_of(row()), {"drift_max": drift})] == []


def test_deep_penetration_of_bare_floors_is_doubted():
    scene = row(masses=[100.0, 100.0], stiffnesses=[1e5, 1e5])
    depth = np.array([[0.02, 0.06, np.nan]])
    (text,) = doubts_of(variants_of(scene), {"penetration_max": depth})
    assert text.startswith(
        "penetration of floors without bumpers 0.06 m (steel-b, storey 2): real ones lie up to 0.05 m"
    )
    thick = ps.Law(key="thick", exponent=1.0, thickness=0.05, reference_stiffness=1e6)
    assert [*doubts_of(variants_of(scene), {"penetration_max": depth}, [thick])] == []
    padded = replace(
        scene, bumpers=[Bumper("steel-b", "rubber_bumper", stiffness=2e6, restitution=0.5, thickness=0.05)]
    )
    assert [*doubts_of(variants_of(padded), {"penetration_max": depth})] == []


@pytest.mark.parametrize(
    "scene",
    [
        Scene([STEEL, Wall()], [0.01], ContactProperties(2e3, restitution=0.6)),
        replace(ps.get_preset("mate2015"), contact=ContactProperties(2e3, restitution=0.6)),
    ],
)
def test_a_soft_contact_of_walls_and_presets_is_not_doubted(scene):
    assert not any("softest" in text for text in told(scene, "linear"))


def test_one_number_stands_for_all_storeys_and_gaps():
    one = Building("b", [100.0] * 3, 1e5, storey_heights=4.0, yield_strengths=500.0, slab_depths=0.3, dashpots=2.0)
    lists = {"storey_heights": [4.0] * 3, "yield_strengths": [500.0] * 3, "slab_depths": [0.3] * 3}
    assert one == Building("b", [100.0] * 3, [1e5] * 3, **lists, dashpots=[2.0] * 3)
    assert Scene([one, STEEL, Wall()], 0.02, allow_unmet=True).gaps == (0.02, 0.02)
    with pytest.raises(SceneError, match="1 values for 3 masses"):
        Building("b", [100.0] * 3, [1e5])


@pytest.mark.usefixtures("stub_engine")
def test_runs_and_plans_say_so_and_go_on(tmp_path):
    sweep = ps.Sweep(row(), "el_centro", "linear", gaps=[5.0], dt=0.005, outputs="default")
    with pytest.warns(UnlikelyWarning, match="gap 5 m"):
        sweep.plan()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        cube = sweep.run()
    said = [str(each.message) for each in caught]
    assert sum("gap 5 m" in text for text in said) == 1
    assert any("storey drift" in text for text in said) == (float(cube["drift_max"].max()) > 0.3)
    file = tmp_path / "one.toml"
    file.write_text('[scene]\npreset = "mate2015"\n[sweep]\nrecords = ["el_centro"]\nlaws = "linear"\ngaps = [10]\n')
    said = "gap 10 m: real ones lie up to 1 m; likely mm given for m (0.01 m)"
    for words in (("plan", file), ("run", file, "-o", tmp_path / "c.nc")):
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            got = call(*words, "--json")
        assert f"pounding-sweep: warning: {said}" in got.stderr
        assert "gap 10 m" in json.loads(got.stdout)["warnings"][0]
