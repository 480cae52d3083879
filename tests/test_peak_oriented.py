"""Storeys with a backbone and deterioration, of all three laws: beside OpenSees's materials, and beside `imk`."""

from __future__ import annotations

from itertools import pairwise

import imk
import numpy as np
import pytest
from against_reference import check_against_opensees, motion, opensees_shears, random_drifts
from scipy.integrate import solve_ivp

import pounding_sweep as ps
from pounding_sweep.base.errors import SceneError
from pounding_sweep.variables.registry import Status

PARAMETERS = {"cap_drift": 0.012, "residual": 0.3}
K, DY = 1000.0, 0.01
STRENGTH = K * DY
MATERIALS = {"peak_oriented": "IMKPeakOriented", "pinching": "IMKPinching", "bilinear": "IMKBilin"}
MODES = {"strength": 0, "post_cap": 1, "reloading": 2, "unloading": 3}
#: Reference drift of a mode that does not deteriorate, for OpenSees: at zero its sums over steps may pass the energy.
NEVER = 1e12
each_law = pytest.mark.parametrize("law", MATERIALS)


def reference(drifts, k, dy, r):
    """Shears along a history of drifts."""
    return imk.shears(drifts, k, dy, r, cap=0.012, residual=0.3)


def storey(law, hardening, **backbone):
    hysteresis = {"law": law, **backbone}
    return ps.Building("a", [10.0], [K], yield_strengths=[STRENGTH], hardening=hardening, hysteresis=hysteresis)


def drawn(law, rng, **modes):
    """A storey of a law with a random backbone, and the arguments of OpenSees's material.

    In three cases OpenSees's `IMKBilin` is another rule than that of Lignos & Krawinkler (2011), which is taken:
    once the residual is reached it unloads along half the elastic stiffness, at an ultimate drift it fails to one side
    only, and with strength it deteriorates the slope beyond the cap. Its hardening line is turned where it would pass
    below the residual. Bilinear storeys are drawn so that they meet none of them.
    """
    u, plain, wide = rng.uniform, law == "bilinear", "strength" in modes
    r, sides, more = u(0.0, 0.03), [], []
    caps = u(25.0, 30.0, 2) if plain and wide else u(2.0, 8.0, 2)
    for cap in caps * DY:
        peak = STRENGTH + r * K * (cap - DY)
        falls, ends = (-u(0.01, 0.03), 40.0) if plain else (-u(0.03, 0.3), u(8.0, 20.0))
        rest = u(0.0, 0.3) if not modes else u(0.05, 0.3)
        sides.append({"cap_drift": cap, "post_cap": falls, "residual": rest, "ultimate_drift": ends * DY})
        more += [cap - DY, peak / (-falls * K), ends * DY, STRENGTH, peak / STRENGTH, rest]
    backbone = {name: {"positive": sides[0][name], "negative": sides[1][name]} for name in sides[0]}
    pinch = {"pinch_force": u(0.2, 0.9), "pinch_drift": u(0.1, 0.9)} if law == "pinching" else {}
    rates = [modes.get(mode, NEVER) for mode in MODES if not (plain and mode == "reloading")]
    more += [*rates, *[1.0] * len(rates), 1.0, 1.0, *pinch.values()]
    own = {"deterioration": modes} if modes else {}
    return storey(law, r, **backbone, **pinch, **own), (K, *more)


@each_law
@pytest.mark.parametrize("buildings", [10, pytest.param(200, marks=pytest.mark.slow)])
def test_storeys_are_those_of_opensees_without_deterioration(law, buildings):
    """At every point of random histories, through caps, residuals and to their ends."""
    lost = 0
    for seed in range(buildings):
        building, arguments = drawn(law, np.random.default_rng(seed))
        drifts = random_drifts(seed, 16.0 * DY, points=80, histories=5)
        test = check_against_opensees(building, MATERIALS[law], arguments, drifts)
        lost += int((test.shear.values[-1] == 0.0).sum())
    assert lost == 0 if law == "bilinear" else lost > buildings // 2


@each_law
@pytest.mark.parametrize("modes", [*([mode] for mode in MODES), [*MODES]], ids=" ".join)
@pytest.mark.parametrize("histories", [1, pytest.param(20, marks=pytest.mark.slow)])
def test_storeys_are_those_of_opensees_with_deterioration(law, modes, histories):
    """OpenSees sums energies over its steps: what it differs by falls with them."""
    drifts = {mode: 3.0 for mode in modes if not (law == "bilinear" and mode == "reloading")}
    if not drifts:
        pytest.skip("bilinear storeys do not reload")
    acts = 0
    for seed in range(histories):
        building, arguments = drawn(law, np.random.default_rng(seed), **drifts)
        turns = np.append(0.0, 6.0 * DY * np.random.default_rng(seed).uniform(-1.0, 1.0, 16))
        got, error = ps.cyclic_test(building, turns).shear.values, []
        for steps in (100, 1000) if seed > 2 or histories == 1 else (100, 1000, 10_000):
            path = np.concatenate([[0.0], *(np.linspace(*pair, steps + 1)[1:] for pair in pairwise(turns))])
            want = opensees_shears(MATERIALS[law], arguments, path[:, None])[::steps, 0]
            error.append(np.abs(got - want).max() / STRENGTH)
        assert error[1] < 1e-6
        assert error[-1] < (1e-8 if len(error) == 3 else max(0.2 * error[0], 1e-8)), error
        plain, _ = drawn(law, np.random.default_rng(seed))
        acts += not np.allclose(got, ps.cyclic_test(plain, turns).shear, atol=1e-3)
    assert acts >= 0.5 * histories


def fall(building, record, **parameters):
    """Time at which a building of one storey falls, by scipy from branch to branch of `imk`; infinite if it stands."""
    (k,), (m,), (strength,) = building.stiffnesses, building.masses, building.yield_strengths
    spring, c = imk.Spring(k, strength / k, building.hardening, **parameters), building.rayleigh[0] * m
    y = np.zeros(2)
    for n, (start, end) in enumerate(pairwise(record.time)):
        before, after = record.acceleration[n : n + 2]
        t = start
        while t < end:
            ends = [(lambda d, w, s=s, x=x: s * (d - x), go) for s, (x, go) in spring.ends.items() if abs(x) < 1e3]
            ends += [(lambda d, w, way=spring.way: -way * w, spring.turn)] if spring.way else []
            events = [lambda t, y, value=value: value(*y) for value, _ in ends]
            for event in events:
                event.terminal, event.direction = True, 1.0

            def rates(t, y, at=start, ground=(before, (after - before) / record.dt)):
                return [y[1], -(spring.force(y[0]) + c * y[1]) / m - ground[0] - ground[1] * (t - at)]

            step = solve_ivp(rates, (t, end), y, method="DOP853", rtol=1e-11, atol=1e-13, events=events)
            t, y = step.t[-1], step.y[:, -1]
            for (_, go), times in zip(ends, step.t_events, strict=True):
                if len(times):
                    spring.move(y[0])
                    go()
                    break
            if spring.failed:
                return t
    return np.inf


@pytest.mark.parametrize(
    ("law", "more", "method"),
    [
        ("peak_oriented", {"ultimate": 0.09}, "exact"),
        pytest.param("bilinear", {"residual": 0.0}, "exact", marks=pytest.mark.slow),
        pytest.param("bilinear", {"lambdas": {"strength": 0.3, "unloading": 2.0}}, "exact", marks=pytest.mark.slow),
        pytest.param("pinching", {"ultimate": 0.09}, "rk4", marks=pytest.mark.slow),
        pytest.param("peak_oriented", {"ultimate": 0.09}, "newmark", marks=pytest.mark.slow),
    ],
)
@pytest.mark.usefixtures("twin")
def test_a_storey_without_strength_has_fallen(law, more, method):
    """At its ultimate drift, at no residual, or with all energy of a mode taken; one that falls does not diverge."""
    own = {"cap": 0.03, "residual": 0.2, **more}
    names = {"cap": "cap_drift", "ultimate": "ultimate_drift", "lambdas": "deterioration"}
    backbone = {names.get(name, name): x for name, x in own.items()}
    own |= {"pinch": (0.3, 0.3)} if law == "pinching" else {"bilinear": law == "bilinear"}
    building = ps.Building(
        "a", [100.0], [8e3], yield_strengths=[120.0], hardening=0.03, hysteresis={"law": law, **backbone}
    )
    record = motion(91 if "ultimate" in more else 201, 2.0)
    want = fall(building, record, **own)
    dt = 2e-2 if method == "exact" else 2e-3
    one = ps.simulate(ps.Scene([building]), record, law="none", method=method, dt=dt, rest=0.0)
    assert int(one.status) == Status.COLLAPSED
    assert one.collapse_time.item() == pytest.approx(want, abs={"exact": 1e-8, "rk4": 1e-6, "newmark": 1e-3}[method])
    assert one.strength_left.item() == 0.0
    assert float(one.energy_residual) < {"exact": 1e-12, "rk4": 1e-6, "newmark": 1e-3}[method]


@pytest.mark.parametrize(
    ("law", "backbone", "message"),
    [
        ("peak_oriented", {"cap_drift": -1.0}, r"hysteresis.cap_drift: is -1; it must be above 0 m"),
        ("peak_oriented", {"residual": 0.1}, "hysteresis.residual: is that beyond a cap; give cap_drift too"),
        ("pinching", {"post_cap": {"positive": 0.1, "negative": -0.1}}, r"post_cap: is 0.1; it must be below 0"),
        ("bilinear", {"residual": [0.1, 1.0]}, r"residual: is 1; it must be at least 0 and below 1"),
        ("bilinear", {"deterioration": {"reloading": 1.0}}, "bilinear storeys do not reload to a drift"),
        ("peak_oriented", {"cap_drift": {"positive": [0.1, 0.2], "negative": 0.1}}, "2 values for 1 masses"),
    ],
)
def test_backbones_that_no_storey_has_are_refused(law, backbone, message):
    with pytest.raises(SceneError, match=message):
        storey(law, 0.0, **backbone)
