"""Rubber bumpers: their law against an independent solver and the slow twin, their thickness, their flat end."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from pathlib import Path

import naive
import numpy as np
import pytest
from against_twin import errors, motion, number_of, twins
from kernels_used import BUMPER
from scenes import pair

import pounding_sweep as ps
from pounding_sweep.accuracy.law_check import solved_restitution
from pounding_sweep.base.errors import LawError, SweepError
from pounding_sweep.engine.row_kernel import Numerics, kernel_shape
from pounding_sweep.model import formula as formulas
from pounding_sweep.model.laws import Law, realised_restitution
from pounding_sweep.outputs.variables import Status
from pounding_sweep.plan.plan import untouched

GAP, K = 0.012, 3e8
SCENE = pair(GAP)
FLAT = 0.8 * BUMPER.thickness


@lru_cache
def truth(points, scale, law=BUMPER, stop=1.0):
    record = motion(points, scale)
    rule = naive.Law(
        law.exponent, "proportional", rebound_only=True, published=number_of, flat=0.8 * law.thickness, stop=stop
    )
    found = naive.run(twins(SCENE), [GAP - law.thickness], record.acceleration, record.dt, rule, K, 0.6, rtol=1e-10)
    return {**found, "law": law.key}


def simulate(points, scale, law=BUMPER, **options):
    return ps.simulate(SCENE, motion(points, scale), law=law, stiffness=K, restitution=0.6, **options)


# -- the force ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("e", [0.2, 0.8, *(pytest.param(e, marks=pytest.mark.slow) for e in (0.5, 0.99))])
@pytest.mark.parametrize(("speed", "stop"), [(0.05, 1.0), pytest.param(0.6, 1.0, marks=pytest.mark.slow), (0.6, 12.0)])
def test_free_masses_rebound_as_asked_for_at_any_speed(e, speed, stop):
    pad = ps.rubber_bumper(0.01, stop=stop)
    assert solved_restitution(pad, e, mass=40.0, stiffness=K, speed=speed) == pytest.approx(e, abs=1e-8)
    assert realised_restitution(pad, e) == pytest.approx(e, rel=1e-12)


def test_the_damping_is_the_root_of_the_closed_form():
    e = np.array([1e-5, 0.3, 0.5, 0.9, 1.0 - 1e-9])
    found = BUMPER.damping_coefficient(e, 1.0, 1.0)
    # D near 1 / e at one end; 3 (1 - e) at the other, where ln(1 - x) = -x - x^2 / 2 - x^3 / 3
    assert found[0] == pytest.approx(1e5, rel=1e-9)
    assert found[-1] == pytest.approx(3e-9, rel=1e-6)
    np.testing.assert_allclose(found[1:4], [number_of(x) for x in e[1:4]], rtol=1e-9)
    with pytest.raises(LawError, match=r"restitution 0\.0 is outside the validity"):
        BUMPER.check_restitution(0.0)


def test_the_force_has_no_jump_and_the_slope_is_its_derivative():
    stiff, flat = ps.rubber_bumper(0.02, limit=0.5, stop=8.0, exponent=2.0), 0.01
    at = np.array([0.3 * flat, 0.999999 * flat, 1.000001 * flat, 2.0 * flat])
    force, slope = (formulas.on_arrays(text, d=at, k=1e6) for text in (stiff.elastic, stiff.elastic_slope))
    line = 1e6 * (flat**2 + 16.0 * flat * (at - flat))
    np.testing.assert_allclose(force, np.where(at < flat, 1e6 * at**2, line), rtol=1e-12)
    np.testing.assert_allclose(slope, 1e6 * np.where(at < flat, 2.0 * at, 16.0 * flat), rtol=1e-12)
    assert formulas.slope("max(k*d - 3.0, 0.0)") == "max(k * d - 3.0, 0.0) / max(k * d - 3.0, 1e-30) * k"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"thickness": 0.0}, r"rubber bumper 'rubber_bumper': thickness is 0.0; it must be a positive number \(m\)"),
        ({"thickness": "5 cm"}, "thickness is '5 cm'"),
        ({"thickness": 0.1, "limit": 1.2}, r"limit is 1.2; it must be in \(0, 1\]"),
        ({"thickness": 0.1, "stop": 0.5}, "stop is 0.5; it must be a number >= 1"),
        ({"thickness": 0.1, "exponent": 0.5}, r"exponent is 0.5; it must be in \[1, 10\]"),
    ],
)
def test_a_bumper_that_is_none_says_why(given, said):
    with pytest.raises(LawError, match=said):
        ps.rubber_bumper(**given)


def test_a_law_is_damped_on_one_side_and_has_a_thickness():
    given = {"key": "mine", "exponent": 2.0, "damper": "c*d**2", "damping": "elastic"}
    with pytest.raises(LawError, match="can't act on approach only and on rebound only"):
        Law(**given, approach_only=True, rebound_only=True)
    with pytest.raises(LawError, match=r"its thickness is -0\.1 m"):
        Law(**given, thickness=-0.1)
    assert Law(**given, rebound_only=True).relation == "rebound"


# -- in a row ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "dt", "bound"), [("rk4", 1e-3, 1e-5), pytest.param("newmark", 5e-4, 6e-3, marks=pytest.mark.slow)]
)
def test_every_variable_equals_the_twins(method, dt, bound):
    got, want = simulate(81, 2.0, method=method, dt=dt), truth(81, 2.0)
    assert int(got.status) == Status.OK
    assert float(got.penetration_max.max()) > FLAT  # squeezed flat
    assert int(got.impact_count.sum()) > 3
    assert float(got.contact_force.min()) == 0.0
    found = errors(got, want, SCENE)
    assert max(found.values()) < bound, found


@pytest.mark.slow
@pytest.mark.parametrize("stop", [1.0, 6.0])
@pytest.mark.parametrize(
    ("method", "order", "bound"), [("rk4", 3.0, 1e-5), ("exact", -1.0, 1e-6), ("newmark", 1.8, 3e-3)]
)
def test_the_order_is_kept_where_the_force_has_no_corner(method, order, bound, stop):
    law = ps.rubber_bumper(BUMPER.thickness, stop=stop)
    # `exact` has steps of its own beside contacts, whose errors are the twin's, but where a corner is met
    steps = np.array([2e-3, 1e-3, 5e-4, 2.5e-4]) / (4.0 if method == "exact" else 1.0)
    off = [
        max(errors(simulate(81, 2.0, law, method=method, dt=dt), truth(81, 2.0, law, stop), SCENE).values())
        for dt in steps
    ]
    slope = np.polyfit(np.log(steps), np.log(off), 1)[0]
    assert slope > (order if stop == 1.0 else 1.2), off
    assert off[-1] < bound * (1.0 if stop == 1.0 else 50.0), off


@pytest.mark.slow
def test_pressing_that_a_row_ends_early_is_cut_at_zero():
    """Where the structure pulls a pair apart faster than 1 / D of the approach the force would pull."""
    scene = ps.Scene([ps.Building("soft", [200.0], [1e5]), ps.Building("light", [2.0], [4e6])], gaps=[0.006])
    pad = ps.rubber_bumper(0.006, key="pad")
    found = ps.simulate(scene, motion(200, 2.0), law=pad, stiffness=2e8, restitution=0.1, dt=5e-4)
    force, depth = found.contact_force.values.ravel(), found.penetration.values.ravel()
    assert force.min() == 0.0
    assert ((force == 0.0) & (depth > 1e-5)).any()
    assert float(abs(found.energy_residual)) < 1e-5


@pytest.mark.slow
def test_steps_that_are_not_split_find_the_same_impacts():
    want = simulate(81, 2.0, dt=2e-4)
    for method in ("rk4", "newmark"):
        got = simulate(81, 2.0, method=method, dt=2e-4, locate=False)
        assert got.impact_count.equals(want.impact_count)
        np.testing.assert_allclose(got.impact_force_max, want.impact_force_max, rtol=0.02)


def test_a_stiff_end_counts_as_the_shorter_contact_that_it_is():
    """Else steps that are too long for it would pass as good."""
    soft, hard = (ps.rubber_bumper(0.01, stop=stop, key=f"pad{stop:g}") for stop in (1.0, 100.0))
    from pounding_sweep.kernel.group import LaneLaw as Formulas

    shapes = [kernel_shape(SCENE, law, Numerics("rk4", 1e-3), frozenset()).law for law in (soft, hard)]
    slow, fast = (
        [float(Formulas(shape, 4, 1e-16).duration(np.full(1, K), np.full(1, v), 40.0)[0]) for v in (0.01, 0.5)]
        for shape in shapes
    )
    assert slow[0] == pytest.approx(fast[0], rel=1e-12)  # it does not reach its end
    assert 5.0 < slow[1] / fast[1] < 20.0
    slope = float(formulas.on_arrays(hard.elastic_slope, d=0.02, k=K))
    assert np.pi * np.sqrt(40.0 / slope) == pytest.approx(fast[1], rel=0.5)


# -- in sweeps ---------------------------------------------------------------------------------------------------------


def sweep(**more):
    given = {"scene": SCENE, "records": motion(20), "laws": [BUMPER], "restitutions": [0.6], "stiffnesses": [K]}
    return ps.Sweep(**{**given, "gaps": [GAP], **more})


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"gaps": [0.02, 0.005]}, "gaps: a gap of 0.005 m has no room for the 0.01 m of law 'bumper'; give a wider"),
        ({"gaps": None, "scene": pair(0.004)}, "scene.gaps: a gap of 0.004 m has no room"),
        (
            dict.fromkeys(("gaps", "laws", "restitutions", "stiffnesses"))
            | {"cases": [{"law": BUMPER, "gap": g, "restitution": 0.5, "stiffness": K} for g in (0.02, 0.003)]},
            r"cases\[1\].gap: a gap of 0.003 m has no room",
        ),
    ],
)
def test_a_gap_has_room_for_its_bumpers(given, said):
    with pytest.raises(SweepError, match=said):
        sweep(**given).plan()


def test_what_never_touches_is_told_by_the_gap_that_bumpers_leave():
    plan = sweep(laws=[BUMPER, "linear"], gaps=[0.010, 0.014, 0.018], stiffnesses=None, stiffness_factors=1.0).plan()
    alone = untouched(plan, np.full((len(plan.uncoupled_runs), 2), 0.006))
    rows = {
        (plan.laws[law].key, float(gap)): bool(told)
        for law, (gap,), told in zip(plan.unique.law, plan.unique.gaps, alone, strict=True)
    }
    assert rows == {
        ("bumper", 0.010): False,
        ("bumper", 0.014): False,
        ("bumper", 0.018): True,
        ("linear", 0.010): True,
        ("linear", 0.014): True,
        ("linear", 0.018): True,
    }


def test_a_sweep_keeps_its_bumpers():
    again = Law(**dataclasses.asdict(BUMPER))
    assert again == BUMPER
    assert sweep().plan().digest != sweep(laws=[ps.rubber_bumper(0.009, key="bumper")]).plan().digest


def test_the_sweep_of_the_repository_names_its_bumpers():
    plan = ps.load_sweep(Path(__file__).parents[1] / "sweeps" / "bumpers.toml").plan()
    assert [law.thickness for law in plan.laws] == [0.0, 0.03, 0.06, 0.0]
    assert [law.key for law in plan.laws[1:3]] == ["bumper_30_mm", "bumper_60_mm"]
