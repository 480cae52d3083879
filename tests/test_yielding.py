"""Storeys that yield: the kernels how they move, extremes, flight, and what sweeps do."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from against_reference import buildings_of, lane_values, motion, simulate
from kernels_used import LEANING_YIELDS, YIELDING, YIELDING_SWEEP
from kinds import YIELDS
from reference import run
from scenes import EVERY, motions, pair
from test_flight import some_scenarios

import pounding_sweep as ps
from pounding_sweep.base.errors import InputError
from pounding_sweep.engine.postprocess import variables_of
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.model.laws import LAWS
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.variables.registry import VARIABLES, Status, reducers_for

NOT_HERE = ("closing_max", "time_step", "error_estimate", "amplification")
OUTPUTS = [name for name, each in VARIABLES.items() if name not in NOT_HERE and each.exists_in(YIELDS)]


@pytest.mark.parametrize(("scene", "points"), [(YIELDS, 151), (LEANING_YIELDS, 251)], ids=["upright", "leaning"])
def test_a_loop_is_bilinear(scene, points):
    """The shear follows drift along k and r k, never beyond what hardening allows, whatever the contacts do."""
    one = simulate(scene, "kelvin_voigt", points, method="rk4", dt=1e-3)
    k, strength, r = scene.buildings[0].stiffnesses[0], scene.buildings[0].yield_strengths[0], 0.05
    d, v = (one[name].values[:, 0, 0] for name in ("storey_drift", "storey_shear"))
    assert np.abs(v - r * k * d).max() == pytest.approx((1.0 - r) * strength, rel=1e-9)
    moves = np.abs(np.diff(d)) > 1e-6
    slopes = np.diff(v)[moves] / np.diff(d)[moves] / k
    elastic, hard = np.abs(slopes - 1.0) < 1e-6, np.abs(slopes - r) < 1e-6
    assert elastic.mean() > 0.3
    assert hard.mean() > 0.05
    assert (elastic | hard).mean() > 0.95  # else it begins to yield, or turns, within the step
    assert one.storey_shear_max.values[0, 0] == pytest.approx(np.abs(v).max(), rel=1e-4)


def lanes(scene, scales, method="rk4", dt=1e-3, law="kelvin_voigt", points=101, gaps=None):
    given = {"scale": scales, "gaps": [scene.gaps] if gaps is None else gaps}
    return lane_values(scene, law, OUTPUTS, motion(points), Numerics(method, dt), history=True, **given)


def scaled(scene, factor, **changes):
    row = [replace(b, yield_strengths=[factor * v for v in b.yield_strengths], **changes) for b in scene.row]
    return ps.Scene(row, scene.gaps, scene.contact)


@pytest.mark.parametrize("method", YIELDING)
def test_half_the_motion_at_half_the_strength_and_gap_is_half_the_answer(method):
    _, whole = lanes(YIELDS, [1.5], method)
    _, half = lanes(scaled(YIELDS, 0.5), [0.75], method, gaps=[[0.5 * YIELDS.gaps[0]]])
    assert whole["impact_count"].sum() > 0
    for name, power in (("displacement_max", 1), ("storey_shear_max", 1), ("residual_drift", 1), ("ductility_max", 0)):
        np.testing.assert_allclose(half[name], 0.5**power * whole[name], rtol=1e-8, err_msg=name)
    np.testing.assert_allclose(half["hysteretic_energy"], 0.25 * whole["hysteretic_energy"], rtol=1e-8)
    _, twice = lanes(YIELDS, [0.75], method)  # and at the same strength it is not
    assert np.abs(2.0 * twice["displacement_max"] - whole["displacement_max"]).max() > 1e-3


def flying(scene=YIELDS, **numerics):
    """The kernel that leaves out windows of the record."""
    return RowKernel(scene, LAWS["kelvin_voigt"], Numerics("exact", 5e-4, **numerics), reducers_for(EVERY))


@pytest.mark.parametrize("law", [pytest.param("kelvin_voigt_tension", marks=pytest.mark.slow), "modified_kelvin_voigt"])
def test_contacts_beside_storeys_that_yield_do_the_work_that_buildings_transfer(law):
    """Of laws that press until floors part: what is left of a force then is no force of open contacts."""
    outputs, record = ["contact_work", "hysteretic_energy", "energy_residual"], motion(20)
    kernel = RowKernel(YIELDS, LAWS[law], Numerics("exact", 5e-4), reducers_for(outputs))
    given = {"scale": [2.0], "gaps": [[0.001]], "stiffness": [8e5], "restitution": [0.5]}
    raw = kernel.run(record, **{name: np.array(values) for name, values in given.items()}, twin=True)
    found = variables_of(kernel, raw, outputs, record)
    assert found["contact_work"].max() > 0.0
    assert np.nanmax(found["hysteretic_energy"]) > 0.0
    assert found["energy_residual"][0] < 1e-9


def test_a_row_in_touch_begins_from_rest():
    """No displacement, velocity or acceleration tells how large its first motion is: the ground begins with a ramp."""
    ground = np.concatenate([[0.0], motion(60).acceleration])
    gaps = np.array([[0.0], [1e-9]])
    given = {"scale": np.ones(2), "gaps": gaps, "stiffness": np.full(2, 8e5), "restitution": np.full(2, 0.6)}
    kernel = flying()
    record = ps.Record("ramp", 0.02, ground)
    outputs = ["displacement_max", "impact_force_max"]
    found = variables_of(kernel, kernel.run(record, **given), outputs, record)
    for name in outputs:
        touching, apart = found[name]
        assert np.all(apart > 0.0), name
        np.testing.assert_allclose(touching, apart, rtol=1e-5, err_msg=name)


def test_what_is_left_out_of_a_flight_changes_nothing():
    """Windows of a record are passed where neither a touch, nor an onset, nor a peak may be: against every step."""
    given, record = some_scenarios(24), motion(151)
    found = flying().run(record, **given)
    numerics = Numerics("exact", 5e-4)
    whole = RowKernel(YIELDS, LAWS["kelvin_voigt"], numerics, reducers_for(OUTPUTS), history=True)
    steps = np.zeros((150 * numerics.steps(record) + 1, 100))
    for i in range(24):
        one = {name: values[[i]] for name, values in given.items()}
        want = whole.run(record, **one, history=steps)
        for name, values in want.items():
            if name == "ended":  # of histories alone
                continue
            near = {"rtol": 2e-4, "atol": 2e-4 * np.abs(found[name]).max()}  # steps are of other lengths
            np.testing.assert_allclose(found[name][i], values[0], **near, err_msg=f"{name} {i}")
            if name in ("count", "flags"):
                assert (found[name][i] == values[0]).all(), (name, i)


@pytest.mark.parametrize("method", YIELDING)
@pytest.mark.parametrize("hardening", [0.0, pytest.param(0.05, marks=pytest.mark.slow), 0.999999])
def test_strengths_from_hardly_any_to_never(hardening, method):
    factors = [1e-6, 1e-4, 1e-2, 0.1, 0.5, 1.0, 10.0, 1e4, 1e9]
    shears = []
    for factor in factors:
        _, one = lanes(scaled(YIELDS, factor, hardening=hardening), [1.0, 2.0], method, dt=5e-4)
        assert (one["status"] == Status.OK).all(), factor
        for name in ("displacement_max", "residual_drift", "hysteretic_energy", "acceleration_max"):
            assert np.isfinite(one[name]).all(), (factor, name)
        assert (one["energy_residual"] < {4: 1e-5, 2: 2e-3}[SCHEMES[method].order]).all(), (
            factor,
            one["energy_residual"],
        )
        assert (one["hysteretic_energy"] >= 0.0).all()
        shears.append(one["storey_shear_max"][0])
    assert (one["hysteretic_energy"] == 0.0).all()
    assert (one["residual_drift"] == 0.0).all()
    elastic = ps.Scene([replace(b, **ELASTIC) for b in YIELDS.row], YIELDS.gaps, YIELDS.contact)
    want = simulate(elastic, "kelvin_voigt", 101, 1.0, method=method, dt=5e-4) if method == "rk4" else None
    if want is not None:
        np.testing.assert_allclose(shears[-1], want.storey_shear_max, rtol=1e-9)


ELASTIC = {"yield_strengths": None, "hardening": 0.0, "damping_stiffness": "initial"}


@lru_cache
def swept():
    sweep = ps.Sweep(**YIELDING_SWEEP)
    return sweep, sweep.plan(), sweep.run()


def test_runs_without_pounding_are_shared_by_what_they_do_not_depend_on_and_no_more():
    _, plan, cube = swept()
    # strengths, hardening, records and scales each decide on them: 3 x 2 x 2 x 2
    assert len(plan.uncoupled_runs) == 24
    assert plan.n_unique == 24 + 3 * 24
    still = cube.sel(law="none")
    assert (still.isel(gap=0).displacement_max == still.isel(gap=-1).displacement_max).all()
    grown = still.ductility_max.sel(scale=1.0) / still.ductility_max.sel(scale=0.5)
    weak, strong = (grown.sel(strength_factor_a=f, building="a") for f in (0.5, 1e3))
    np.testing.assert_allclose(strong, 2.0, rtol=1e-9)  # elastic
    assert (np.abs(weak - 2.0) > 0.02).any()


@pytest.mark.slow
def test_the_required_gap_of_a_yielding_row_is_found_at_each_scale():
    """Of elastic rows one run serves all scales; here none does."""
    scales = [0.5, 1.0]
    sweep = ps.Sweep(**(YIELDING_SWEEP | {"laws": ["kelvin_voigt"], "scales": scales, "gaps": [0.001, 0.004]}))
    needed = ps.analysis.required_gap(sweep.run(), records=motions())
    assert needed.sizes["scale"] == 2
    want = swept()[2].sel(law="kelvin_voigt")
    touched = want.impact_count.fillna(0).sum(("pair", "storey")) > 0
    for gap in (0.001, 0.004):
        enough = needed.exact.max("pair") <= gap
        assert bool((enough == ~touched.sel(gap=gap)).all())


def test_cases_vary_strengths_and_hardening():
    cases = [
        {"law": "none", "strength_factors": {"a": 0.5}},
        {"law": "none", "strength_factors": {"a": 0.5}, "hardenings": {"b": 0.2, "a": 0.05}},
        {"law": "none", "strength_factors": {"a": 1.0}},
        {"law": "none", "mass_factors": {"a": 2.0}},
    ]
    plan = ps.Sweep(YIELDS, motions()[0], cases=cases).plan()
    assert plan.n_unique == 4
    variants = plan.variants[plan.unique.variant[plan.inverse]]
    assert variants.yield_strengths[:, 0].tolist() == [110.0, 110.0, 220.0, 440.0]
    assert variants.hardenings[:, [0, 2]].tolist() == [[0.05, 0.0], [0.05, 0.2], [0.05, 0.0], [0.05, 0.0]]


@pytest.mark.slow
@pytest.mark.parametrize("accuracy", [1e-3, 1e-5])
def test_accuracy_holds_where_storeys_yield(accuracy):
    given = {"scene": YIELDS, "records": motions()[0], "laws": ["kelvin_voigt"], "gaps": [0.001, 0.002, 0.004]}
    got = ps.Sweep(**given, accuracy=accuracy).run()
    want = ps.Sweep(**given, method="rk4", dt=1e-4).run()
    assert got.attrs["method"] == "exact"
    assert (got.impact_count == want.impact_count).all()
    for name in ("displacement_max", "drift_max", "storey_shear_max", "impact_force_max"):
        assert float(abs(got[name] - want[name]).max() / abs(want[name]).max()) < accuracy, name


@pytest.mark.slow
def test_strengths_of_constant_ductility_by_the_twin():
    """At the strength that is found, each building alone has the ductility; with a little more, less of it."""
    targets, record = [1.0, 2.0, 6.0], motion(251, 1.5)
    found = ps.analysis.constant_ductility(YIELDS, record, targets)
    factors = found.strength_factor.values[0]
    assert (np.diff(factors, axis=0) < 0.0).all()
    np.testing.assert_allclose(found.strength_reduction[0, 0], 1.0, rtol=1e-9)
    for each, target in zip(factors, targets, strict=True):
        for b, twin in enumerate(buildings_of(YIELDS)):
            for more, sign in ((1.0, 0.0), (1.01, -1.0)):
                strong = replace(twin, yield_strengths=[each[b] * more * v for v in twin.yield_strengths])
                mu = np.nanmax(run([strong], [], record.acceleration, record.dt, "none")["ductility_max"][0])
                if sign == 0.0:
                    assert mu == pytest.approx(target, rel=1e-5), (b, target)
                else:
                    assert mu < target * (1.0 - 1e-4), (b, target)


@pytest.mark.slow
def test_a_long_period_keeps_its_displacement():
    """Newmark and Hall: where displacements are equal the reduction is the ductility; a stiff building has less than
    that of equal energies."""
    masses, w = [1.0], [2.0 * np.pi / period for period in (4.0, 0.06)]
    row = [ps.Building(n, masses, [x**2], yield_strengths=[1.0]) for n, x in zip(("soft", "stiff"), w, strict=True)]
    found = ps.analysis.constant_ductility(ps.Scene(row, [1.0]), "el_centro", [2.0])
    soft, stiff = found.strength_reduction[0, 0].values
    assert soft == pytest.approx(2.0, rel=0.25)
    assert 1.0 < stiff < np.sqrt(2.0 * 2.0 - 1.0)


@pytest.mark.parametrize(
    ("scene", "targets", "message"),
    [
        (pair(), [2.0], "no storey of this row yields; give its buildings yield_strengths"),
        (YIELDS, [2.0, 0.5], r"ductilities: 0.5 is not in \[1, inf\)"),
        (YIELDS, [], "ductilities: "),
    ],
)
def test_ductilities_that_cannot_be_are_refused(scene, targets, message):
    with pytest.raises(InputError, match=message):
        ps.analysis.constant_ductility(scene, motions()[0], targets)


@pytest.mark.slow
def test_storeys_yield_alike_in_single_precision():
    """A storey that is beyond its range for a moment, between two turns of a long step, yields there too."""
    stiff = ps.Building("b", [101.0, 128.0], [4.94e5, 5.38e5], 0.01, yield_strengths=[120.0, 67.0], hardening=0.1)
    double, single = (
        ps.Sweep(
            ps.Scene([ps.Building("a", [104.0, 115.0], [1.24e5, 1.05e5], 0.1), stiff], gaps=[1.0]),
            "el_centro",
            "linear",
            stiffnesses=1e6,
            gaps=[1.0],
            scales=np.linspace(0.1, 0.6, 64),
            strength_factors={"b": [0.6, 0.8, 1.0, 1.2]},
            accuracy=1e-3,
            method="exact",
            precision=precision,
            outputs=["displacement_max", "drift_max", "ductility_max"],
        ).run()
        for precision in ("float64", "float32")
    )
    assert (double.ductility_max > 1.0).sum() > 100
    for name in ("displacement_max", "drift_max"):
        off = abs(single[name] - double[name]).max(["building", "storey"])
        assert float((off / double[name].max(["building", "storey"])).max()) < 1.5e-6, name
