"""Storeys of Bouc and Wen: by closed forms, order, and the bilinear limit; `test_kinds_of_rows` has the reference."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from against_reference import lane_values, motion, simulate
from kernels_used import SMOOTH, SMOOTHING

import pounding_sweep as ps
from pounding_sweep.base.errors import SweepError
from pounding_sweep.engine.row_kernel import Numerics
from pounding_sweep.model.laws import LAWS
from pounding_sweep.variables.registry import VARIABLES, Status

NOT_HERE = ("closing_max", "time_step", "error_estimate", "amplification")
OUTPUTS = [name for name, each in VARIABLES.items() if name not in NOT_HERE and each.only != "columns"]
CONTACT = 8e5
PARAMETERS = {"n": 2.0, "beta": 0.6, "gamma": 0.3}


def reference(drifts, k, dy, r):
    """Shears along a history of drifts: dz = dd (1 - |z / dy|^n (gamma + beta sign(z dd))), in many little steps."""
    n, beta, gamma = PARAMETERS.values()
    z, zs, parts = 0.0, [0.0], 50
    for d0, d1 in pairwise(drifts):
        for _ in range(parts):
            step = (d1 - d0) / parts

            def rate(z, step=step):
                return step * (1.0 - abs(z / dy) ** n * (gamma + beta * np.sign(z * step)))

            z += rate(z + 0.5 * rate(z))
        zs.append(z)
    return r * k * np.asarray(drifts) + (1.0 - r) * k * np.array(zs)


each_scheme = pytest.mark.parametrize("method", SMOOTHING)


@pytest.mark.parametrize(
    ("method", "law", "longest", "low", "high"),
    [
        ("rk4", "none", 2e-2, 3.5, 5.5),
        pytest.param("newmark", "none", 1e-2, 1.7, 2.3, marks=pytest.mark.slow),
        ("newmark", "linear", 1e-2, 1.7, 2.3),
    ],
)
def test_order_of_convergence(method, law, longest, low, high):
    """Sub-steps end at kinks, so that the order is the scheme's."""
    steps = [longest / n for n in (1, 2, 4, 8)]

    def moved(method, dt):
        return simulate(SMOOTH, law, 151, dt=dt, method=method).displacement.values[:: round(0.02 / dt)]

    total = [np.abs(moved(method, dt) - moved("rk4", 3.125e-4)).max() for dt in steps]
    slope = np.polyfit(np.log(steps), np.log(total), 1)[0]
    assert low < slope < high, (slope, total)


@pytest.mark.parametrize(
    ("method", "near"), [("exact", 1e-9), ("rk4", 1e-8), pytest.param("newmark", 1e-5, marks=pytest.mark.slow)]
)
def test_loading_for_the_first_time_follows_its_closed_form(method, near):
    """n = 2, beta + gamma = 1: z = dy tanh(d / dy), at whatever speed."""
    one = simulate(SMOOTH, "none", 251, dt=1e-3, method=method)
    d, p = (one[name].values[:, 1, 0] for name in ("storey_drift", "plastic_drift"))
    b = SMOOTH.buildings[1]
    assert (b.hysteresis.n, b.hysteresis.beta + b.hysteresis.gamma) == (2.0, 1.0)
    dy = b.yield_strengths[0] / b.stiffnesses[0]
    way = np.sign(d[5])
    turned = int(np.argmax(np.diff(way * d[1:]) < 0.0)) + 1
    assert way * d[turned] > 0.3 * dy
    np.testing.assert_allclose((d - p)[:turned], dy * np.tanh(d[:turned] / dy), atol=near * dy)


def lanes(scene, scales, law="none", dt=5e-3, twin=False, method="rk4", precision="float64"):
    numerics, given = Numerics(method, dt, precision=precision), {"scale": scales, "restitution": 1.0}
    return lane_values(scene, law, OUTPUTS, motion(101), numerics, history=not twin, twin=twin, **given)


@pytest.mark.parametrize(
    "factor", [1e-6, 1.0, 1e9, *(pytest.param(factor, marks=pytest.mark.slow) for factor in (1e-3, 1e3))]
)
@pytest.mark.parametrize("method", ["exact", "rk4", pytest.param("newmark", marks=pytest.mark.slow)])
def test_strengths_from_hardly_any_to_never(method, factor):
    """Where it yields too much within a step even for sub-steps, it says so."""
    row = [replace(b, yield_strengths=[factor * v for v in b.yield_strengths], p_delta=False) for b in SMOOTH.row]
    _, one = lanes(ps.Scene(row, [1e3], SMOOTH.contact), [1.0], "linear", method=method)
    if factor < 1e-4:
        said = {"exact": Status.DIVERGED, "rk4": Status.DIVERGED, "newmark": Status.UNDER_RESOLVED_CONTACT}
        assert one["status"].tolist() == [said[method]]
        return
    assert one["status"].tolist() == [Status.OK]
    assert (one["energy_residual"] < 1e-3).all()
    if factor >= 1e3:
        elastic = ps.Scene([replace(b, yield_strengths=None, hysteresis=None, hardening=0.0) for b in row], [1e3])
        want = lanes(elastic, [1.0], twin=True, method=method)[1]
        near = {"exact": 1e-6, "rk4": 1e-6, "newmark": 1e-4}[method]  # its steps are cut at kinks, small as they are
        np.testing.assert_allclose(one["drift_max"], want["drift_max"], rtol=max(2.0 / factor, near))


@pytest.mark.slow
@each_scheme
def test_single_precision_finds_its_kinks(method):
    """Rounding moves a kink by more than in double precision: it must not be looked for without end."""
    scales = np.linspace(-2.0, 2.0, 33)
    raw, one = lanes(SMOOTH, scales, "linear", dt=2e-3, method=method, precision="float32")
    want = lanes(SMOOTH, scales, "linear", dt=2e-3, method=method)[1]
    assert (raw["flags"] == 0.0).all()
    np.testing.assert_allclose(one["drift_max"], want["drift_max"], rtol=3e-3, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["links", "foundation", "beside bilinear", "one storey of two", "stereomechanical"])
def test_newmark_has_its_order_whatever_stands_beside(kind):
    a, b = SMOOTH.buildings
    base = ps.Foundation(mass=70.0, inertia=500.0, sway_stiffness=2.5e5, rocking_stiffness=6e6, sway_damping=900.0)
    row, more = {
        "links": ([a, b], {"links": [ps.Link("a-b", [2], 2e3, 30.0)]}),
        "foundation": ([replace(a, foundation=base, p_delta=False), replace(b, p_delta=False)], {}),
        "beside bilinear": ([a, replace(b, hysteresis=None)], {}),
        "one storey of two": ([replace(a, yield_strengths=[150.0, float("inf")]), b], {}),
    }.get(kind, ([a, b], {}))
    scene, steps = ps.Scene(row, SMOOTH.gaps, SMOOTH.contact, **more), [4e-3, 2e-3, 1e-3, 5e-4]
    law = kind if kind in LAWS else "linear"
    options = {"law": law, "stiffness": None if law == kind else CONTACT}
    record = motion(101, 1.5)

    def moved(method, dt):
        one = ps.simulate(scene, record, method=method, dt=dt, rest=0.0, **options)
        assert int(one.impact_count.sum()) >= 2
        return one.displacement.values[:: round(0.02 / dt)]

    want = moved("rk4", 2.5e-4)
    total = [np.nanmax(np.abs(moved("newmark", dt) - want)) for dt in steps]
    slope = np.polyfit(np.log(steps), np.log(total), 1)[0]
    assert 1.7 < slope < 2.3, (slope, total)


@pytest.mark.parametrize("law", ["linear", pytest.param("none", marks=pytest.mark.slow)])
def test_series_do_not_depend_on_the_step(law):
    """Kinks and contacts are located, and what series leave out is of the size of rounding."""
    moved = [
        simulate(SMOOTH, law, 126, 2.0, dt=dt, method="exact").displacement.values[:: round(0.02 / dt)]
        for dt in (5e-3, 2e-3)
    ]
    np.testing.assert_allclose(moved[0], moved[1], atol=1e-9 * np.abs(moved[1]).max())


@pytest.mark.parametrize(("method", "dt", "near"), [("rk4", 1e-3, 4e-6), ("newmark", 2.5e-4, 2e-5)])
def test_peaks_are_those_of_series(method, dt, near):
    got, want = (simulate(SMOOTH, "linear", 126, 2.0, dt=h, method=m) for m, h in ((method, dt), ("exact", 5e-3)))
    for name in ("acceleration_max", "storey_shear_max", "drift_max", "impact_force_max"):
        np.testing.assert_allclose(got[name], want[name], rtol=near, err_msg=name)


def test_a_record_of_one_point_moves_nothing():
    one = simulate(SMOOTH, "linear", 1, dt=5e-3, method="exact")
    assert one.sizes["time"] == 1
    assert (one.displacement_max.values == 0.0).all()
    assert int(one.status) == Status.OK


@pytest.mark.slow
@pytest.mark.parametrize(("law", "n"), [("hertz", 2.0), ("linear", 1.5), ("stereomechanical", 1.0)])
def test_exact_goes_by_its_stages_where_forces_or_flow_are_no_polynomials(law, n):
    scene = ps.Scene(
        [replace(b, hysteresis={"law": "bouc_wen", "n": n}) for b in SMOOTH.row], SMOOTH.gaps, SMOOTH.contact
    )
    options = {"law": law, "stiffness": {"hertz": 2e6, "linear": CONTACT}.get(law)}

    def moved(method, dt):
        one = ps.simulate(scene, motion(101, 1.5), method=method, dt=dt, **options)
        assert int(one.impact_count.sum()) >= 2
        return one.displacement.values[:: round(0.02 / dt)]

    want = moved("rk4", 2.5e-4)
    coarse, fine = (np.nanmax(np.abs(moved("exact", dt) - want)) / np.nanmax(np.abs(want)) for dt in (4e-3, 1e-3))
    assert fine < 1e-6, (coarse, fine)
    assert fine < 0.1 * coarse, (coarse, fine)


def test_central_differences_are_refused():
    with pytest.raises(SweepError, match=r"method: 'central_difference' does not follow storeys of law 'bouc_wen'"):
        ps.Sweep(SMOOTH, motion(11), "linear", method="central_difference")


@pytest.mark.parametrize("law", ["linear", "hertz"])
@pytest.mark.parametrize("accuracy", [1e-3, 1e-5])
def test_an_accuracy_takes_exact_by_series_and_by_stages_all_along(law, accuracy):
    """It costs least: `rk4` takes 1.5 to 4 times as long."""
    assert ps.Sweep(SMOOTH, motion(11), law, stiffnesses=2e6, accuracy=accuracy).plan().numerics.method == "exact"
