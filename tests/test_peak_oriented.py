"""Storeys with a backbone and deterioration, of all three laws: beside OpenSees's materials, and beside `imk`."""

from __future__ import annotations

from itertools import pairwise

import imk
import numpy as np
import pytest
from opensees_material import check_against_opensees, opensees_shears, random_drifts

import pounding_sweep as ps

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
        assert error[-1] < max(0.2 * error[-2], 1e-8), error
        plain, _ = drawn(law, np.random.default_rng(seed))
        acts += not np.allclose(got, ps.cyclic_test(plain, turns).shear, atol=1e-3)
    assert acts >= 0.5 * histories
